//! What is known of one pixel: a table of what the stages made of it.

use eframe::egui::{self, Button, DragValue, Ui};
use kernels::variant::{Flavour, Variant};

use crate::model::settings::Settings;
use crate::model::state::Model;
use kernels::oracle::{Derivative, Pixel, chosen, pixel_at, probe_of};

/// Splat texels of a cell, in their order.
const CORNERS: [&str; 4] = ["south-west", "south-east", "north-west", "north-east"];
const AXES: [&str; 3] = ["x", "y", "z"];

/// A line of the table.
#[derive(Debug, PartialEq)]
struct Row {
    name: String,
    value: String,
    about: &'static str,
}

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let Some(shown) = model.shown().cloned() else {
        ui.label("No picture yet.");
        return;
    };
    let rows = shown.pixel.as_ref().map(|pixel| rows(pixel, &shown.wish.settings)).unwrap_or_default();
    place(model, ui, shown.wish.size, &rows);
    if model.probe.is_none() {
        ui.label("Click a place in the picture, or give a pixel's column and row.");
    } else if shown.wish.probe != model.probe {
        ui.label("...").on_hover_text("The table is of the pixel before");
    } else if shown.draft {
        ui.label("A first look is not taken apart: wait for the scene's textures.");
    } else if shown.pixel.is_none() {
        ui.label("Sky: no terrain is seen there.");
    }
    egui::Grid::new("inspector").num_columns(2).striped(true).show(ui, |ui| {
        for row in &rows {
            ui.label(&row.name).on_hover_text(row.about);
            ui.label(&row.value).on_hover_text(row.about);
            ui.end_row();
        }
    });
}

/// Which pixel, and what is done with its table.
fn place(model: &mut Model, ui: &mut Ui, size: [u32; 2], rows: &[Row]) {
    let mut pixel = model.probe.map_or(size.map(|side| side / 2), |probe| pixel_at(probe, size));
    let mut moved = false;
    ui.horizontal_wrapped(|ui| {
        for ((at, side), (name, from)) in pixel.iter_mut().zip(size).zip([("Pixel x", "left"), ("Pixel y", "top")]) {
            let label = ui.label(name);
            let last = side.saturating_sub(1);
            let drag = ui.add(DragValue::new(at).range(0..=last).suffix(" px")).labelled_by(label.id);
            moved |= drag.on_hover_text(format!("Counted from 0 at the {from} of the picture as it was drawn, up to {last}")).changed();
        }
    });
    if moved {
        model.probe = Some(probe_of(pixel, size));
    }
    ui.horizontal_wrapped(|ui| {
        if ui.add_enabled(!rows.is_empty(), Button::new("Copy")).on_hover_text("The table as lines of name, tabulator, value").clicked() {
            let text: String = rows.iter().map(|row| format!("{}\t{}\n", row.name, row.value)).collect();
            ui.ctx().copy_text(text);
        }
        if ui
            .add_enabled(model.probe.is_some(), Button::new("Let go"))
            .on_hover_text("Follows no pixel any more: each picture is shaded only once")
            .clicked()
        {
            model.probe = None;
        }
    });
}

/// Unit vectors, and steps in metres.
fn vector([x, y, z]: [f64; 3], decimals: usize) -> String {
    format!("{x:.decimals$}, {y:.decimals$}, {z:.decimals$}")
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// The flavours of a mask by name, and its number.
fn flavours(mask: u8) -> String {
    Variant::new(mask).map_or_else(|| format!("none ({mask})"), |variant| format!("{variant} ({mask})"))
}

/// A normal with the slope that it stands for.
fn normal(n: [f64; 3]) -> String {
    format!("{}; slope {:.2} deg", vector(n, 5), n[2].clamp(-1.0, 1.0).acos().to_degrees())
}

/// The whole table of a pixel of a picture that was drawn with these settings.
fn rows(pixel: &Pixel, settings: &Settings) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut row = |name: &str, value: String, about: &'static str| rows.push(Row { name: name.to_owned(), value, about });
    row("Pixel", format!("{}, {} px", pixel.pixel[0], pixel.pixel[1]), "Column and row in the picture as it was drawn, from the top left");
    row(
        "World position",
        format!("{} m", vector(pixel.position, 4)),
        "East and north of the middle of the world, and elevation; from depth along the pixel's ray, in f64",
    );
    row("Sector", format!("{}, {}", pixel.sector[0], pixel.sector[1]), "From the world's south-west corner");
    row("Depth", format!("{:.4} m", pixel.depth_m), "Along the view direction: what the depth buffer holds, near / depth");
    row("Distance", format!("{:.4} m", pixel.distance_m), "Along the pixel's ray: what flavours go by");
    row("Shading normal", normal(pixel.shading_normal), "As stored: weights of flavours and projections follow it");
    row("Triangle normal", normal(pixel.triangle_normal), "As stored: derivatives follow it");
    match (pixel.triangle, pixel.normal_error()) {
        (Some(triangle), Some(error)) => {
            row("Exact triangle normal", normal(triangle.normal), "Of the world's triangle that is drawn here, in f64");
            row("Normal off by", format!("{:.3} deg", error.to_degrees()), "Angle between the stored and the exact normal of the triangle");
            row(
                "Triangle",
                format!("LOD {}, vertices {} m apart", triangle.lod, triangle.spacing_m),
                "Of the quadtree node drawn here; 0 is the finest LOD",
            );
        }
        _ => row(
            "Triangle",
            "not the world's".to_owned(),
            "No triangle of the world lies where depth says: the shader that places vertices was edited",
        ),
    }
    for (step, [name, exact, off]) in pixel
        .steps
        .iter()
        .zip([["Step right", "Step right, exact", "Step right, error"], ["Step down", "Step down, exact", "Step down, error"]])
    {
        row(name, format!("{} m", vector(step.shader, 5)), "Of the position to the next pixel, as the shader has it");
        let of_exact = step.exact.map_or_else(|| "none".to_owned(), |step| format!("{} m", vector(step, 5)));
        row(exact, of_exact, "To where the next pixel's ray meets the exact triangle's plane; none where it looks past it");
        row(
            off,
            derivative_error(step),
            "Difference as a share of the exact step; and how many mip levels textures are too coarse (above 0) or too fine",
        );
    }
    row("Flavours needed", flavours(pixel.mask), "The mask: flavours of which this pixel shows enough to see");
    row("Tile variant", flavours(pixel.variant), "The flavours that all pixels of its tile together need, or those forced");
    for (flavour, weight) in Flavour::ALL.into_iter().zip(pixel.flavours).filter(|(_, weight)| *weight > 0.0) {
        row(&format!("Weight of {}", flavour.name()), percent(weight), "Share of the flavour in this pixel, within the tile's variant");
    }
    for (texel, corner) in pixel.splat.iter().zip(CORNERS) {
        row(
            &format!("Material {corner}"),
            format!("{} (no. {}), {}, by height {}", texel.material, texel.index, percent(texel.weight), percent(texel.blended)),
            "Splat texel beside the pixel: material, place in the palette, bilinear weight, and what the materials' heights make of it in a blend of all four",
        );
    }
    choice(pixel, settings, &mut row);
    page(pixel, &mut row);
    rows
}

fn derivative_error(step: &Derivative) -> String {
    match (step.error(), step.mips()) {
        (Some(error), Some(mips)) => format!("{}, {mips:+.4} mips", percent(error)),
        _ => "not known".to_owned(),
    }
}

/// Thresholds, and what came of them.
fn choice(pixel: &Pixel, settings: &Settings, row: &mut impl FnMut(&str, String, &'static str)) {
    let named = |code: u32| match chosen(code) {
        None => "none".to_owned(),
        Some((texel, axis)) => {
            let material = format!("{} ({})", pixel.splat[texel].material, CORNERS[texel]);
            let axis = AXES.get(axis).copied().unwrap_or("?");
            if pixel.draw.is_some_and(|draw| draw.projection.is_none()) { material } else { format!("{material} along {axis}") }
        }
    };
    if let Some(draw) = pixel.draw {
        row(
            "Drawn by",
            format!("{}, {} noise", draw.flavour.name(), settings.frame.noise.name()),
            "The flavour that draws a random number first, and where the number is from",
        );
        if let Some(threshold) = draw.projection {
            let weights: Vec<String> = AXES.into_iter().zip(draw.projections).map(|(axis, w)| format!("{axis} {}", percent(w))).collect();
            row("Projection threshold", format!("{threshold:.6}"), "From 0 to 1: the projection is where weights, summed up, pass it");
            row("Projections", weights.join(", "), "Weights of the projections that look along east (x), north (y) and up (z)");
        }
        row(
            "Material threshold",
            format!("{:.6}", draw.material),
            "From 0 to 1: the material is where bilinear weights, summed up, pass it",
        );
    }
    row(
        "Choice",
        named(pixel.choice),
        "The first random choice as the shader recorded it: material, and the projection if that is random, too",
    );
    let verdict = if pixel.agrees() { "the same".to_owned() } else { named(pixel.draw.map_or(0, |draw| draw.expected)) };
    row(
        "Choice by reference",
        verdict,
        "What follows from the thresholds; within rounding of a border the shader may fall to the other side",
    );
}

fn page(pixel: &Pixel, row: &mut impl FnMut(&str, String, &'static str)) {
    let Some(page) = pixel.page else {
        row("Page", "none".to_owned(), "The virtual texture has no weight here");
        return;
    };
    let kernels::virtual_texture::PageId { level, x, y } = page.id;
    row(
        "Page",
        format!("level {level}, column {x}, row {y}"),
        "Asked for by this pixel; columns and rows of that level from the world's south-west corner",
    );
    row(
        "Place in page",
        format!("{:.2}, {:.2} of {} texels", page.texel[0], page.texel[1], kernels::virtual_texture::PAGE_TEXELS),
        "From the page's south-west corner",
    );
    row(
        "Footprint",
        format!("{:.2} x {:.2}, covered {:.2} texels", page.footprint[0], page.footprint[1], page.covered),
        "Texels of level 0 from pixel to pixel, seen from above, mip bias included; and what filtering covers, which anisotropy makes smaller",
    );
    row(
        "Page LOD",
        format!("{:.3}: level {level}, mip {:.3}", page.lod, page.mip),
        "log2 of what is covered: the whole of it is the level, the rest the mip in the page",
    );
    let served = match page.served {
        Some(served) if served == page.id => "the same".to_owned(),
        Some(kernels::virtual_texture::PageId { level, x, y }) => format!("level {level}, column {x}, row {y}"),
        None => "none: far atlas".to_owned(),
    };
    row("Page sampled", served, "A coarser one than asked for where not all pages of the frame fit");
}

#[cfg(test)]
mod tests {
    use kernels::scene;
    use kernels::virtual_texture::PageId;

    use super::*;
    use kernels::oracle::{Draw, Page, Texel, Triangle};

    fn pixel() -> Pixel {
        let texel = |index: u32, weight: f64| Texel { material: format!("rock {index}"), index, weight, blended: weight };
        Pixel {
            pixel: [12, 30],
            position: [1.5, -2.25, 700.0],
            sector: [80, 79],
            depth_m: 41.0,
            distance_m: 42.0,
            shading_normal: [0.0, 0.0, 1.0],
            triangle_normal: [0.6, 0.0, 0.8],
            triangle: Some(Triangle { lod: 2, spacing_m: 2.0, normal: [0.6, 0.0, 0.8] }),
            steps: [
                Derivative { shader: [2.0, 0.0, 0.0], exact: Some([1.0, 0.0, 0.0]) },
                Derivative { shader: [0.0, 1.0, 0.0], exact: None },
            ],
            mask: 4,
            variant: 20,
            flavours: [0.0, 0.0, 0.75, 0.0, 0.25],
            splat: [texel(0, 0.1), texel(1, 0.2), texel(2, 0.3), texel(3, 0.4)],
            choice: 2,
            draw: Some(Draw { flavour: Flavour::NearCliff, projection: None, material: 0.15, projections: [0.2, 0.5, 0.3], expected: 2 }),
            page: None,
        }
    }

    fn values(pixel: &Pixel) -> Vec<(String, String)> {
        let settings = Settings::new(scene::load(scene::DEFAULT).expect("built in"));
        rows(pixel, &settings).into_iter().map(|row| (row.name, row.value)).collect()
    }

    #[test]
    fn the_table_says_everything_once_with_its_unit() {
        let table = values(&pixel());
        let value = |name: &str| {
            let all: Vec<&str> = table.iter().filter(|(n, _)| n == name).map(|(_, value)| value.as_str()).collect();
            assert_eq!(all.len(), 1, "{name}: {table:?}");
            all[0].to_owned()
        };
        for (name, expected) in [
            ("World position", "1.5000, -2.2500, 700.0000 m"),
            ("Depth", "41.0000 m"),
            ("Triangle normal", "0.60000, 0.00000, 0.80000; slope 36.87 deg"),
            ("Normal off by", "0.000 deg"),
            ("Triangle", "LOD 2, vertices 2 m apart"),
            ("Step right, error", "100.00 %, +1.0000 mips"),
            ("Step down, exact", "none"),
            ("Step down, error", "not known"),
            ("Flavours needed", "near-cliff (4)"),
            ("Tile variant", "near-cliff+splat (20)"),
            ("Weight of near-cliff", "75.00 %"),
            ("Material south-east", "rock 1 (no. 1), 20.00 %, by height 20.00 %"),
            ("Drawn by", "near-cliff, hashed noise"),
            ("Material threshold", "0.150000"),
            ("Choice", "rock 1 (south-east)"),
            ("Choice by reference", "the same"),
            ("Page", "none"),
        ] {
            assert_eq!(value(name), expected, "{name}");
        }
        assert!(!table.iter().any(|(name, _)| name == "Weight of vt" || name == "Projection threshold"));
    }

    #[test]
    fn what_is_chosen_otherwise_and_what_is_virtual_is_said() {
        let mut pixel = pixel();
        pixel.draw =
            Some(Draw { flavour: Flavour::FarCliff, projection: Some(0.5), material: 0.95, projections: [0.2, 0.5, 0.3], expected: 8 });
        pixel.page = Some(Page {
            id: PageId { level: 3, x: 25, y: 23 },
            texel: [72.0, 240.0],
            footprint: [3.0, 9.0],
            covered: 9.0,
            lod: 3.17,
            mip: 0.17,
            served: Some(PageId { level: 3, x: 25, y: 23 }),
        });
        pixel.triangle = None;
        let table = values(&pixel);
        let has = |name: &str, value: &str| assert!(table.iter().any(|(n, v)| n == name && v == value), "{name} = {value}: {table:?}");
        has("Choice", "rock 1 (south-east) along x");
        has("Choice by reference", "rock 3 (north-east) along y");
        has("Projections", "x 20.00 %, y 50.00 %, z 30.00 %");
        has("Page", "level 3, column 25, row 23");
        has("Footprint", "3.00 x 9.00, covered 9.00 texels");
        has("Page LOD", "3.170: level 3, mip 0.170");
        has("Page sampled", "the same");
        has("Triangle", "not the world's");
        pixel.draw = None;
        pixel.choice = 0;
        let table = values(&pixel);
        assert!(table.iter().any(|(n, v)| n == "Choice" && v == "none") && !table.iter().any(|(n, _)| n == "Drawn by"));
    }
}

//! The panel *Inspector*: a table of how the stages computed one pixel.

use eframe::egui::{self, Button, DragValue, Ui};
use kernels::variant::{Flavour, Variant};

use crate::model::settings::Settings;
use crate::model::state::Model;
use kernels::oracle::{Derivative, Pixel, chosen, pixel_at, probe_of};

/// Names of the four splat texels around a pixel, in the order of [`Pixel::splat`].
const CORNERS: [&str; 4] = ["south-west", "south-east", "north-west", "north-east"];
const AXES: [&str; 3] = ["x", "y", "z"];

/// A row of the table.
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
        ui.label("...")
            .on_hover_text("The picture in which this pixel is inspected is not ready yet. Until then, the table may show another pixel.");
    } else if shown.draft {
        ui.label("This is only a preview (first look). The table appears when the textures of the scene are ready.");
    } else if shown.pixel.is_none() {
        ui.label("Sky: this pixel shows no terrain.");
    }
    egui::Grid::new("inspector").num_columns(2).striped(true).show(ui, |ui| {
        for row in &rows {
            ui.label(&row.name).on_hover_text(row.about);
            ui.label(&row.value).on_hover_text(row.about);
            ui.end_row();
        }
    });
}

/// The controls for the inspected pixel, and for its table.
fn place(model: &mut Model, ui: &mut Ui, size: [u32; 2], rows: &[Row]) {
    let mut pixel = model.probe.map_or(size.map(|side| side / 2), |probe| pixel_at(probe, size));
    let mut moved = false;
    ui.horizontal_wrapped(|ui| {
        for ((at, side), (name, from)) in pixel.iter_mut().zip(size).zip([("Pixel x", "left"), ("Pixel y", "top")]) {
            let label = ui.label(name);
            let last = side.saturating_sub(1);
            let drag = ui.add(DragValue::new(at).range(0..=last).suffix(" px")).labelled_by(label.id);
            moved |= drag.on_hover_text(format!("From 0 at the {from} of the rendered picture to {last}")).changed();
        }
    });
    if moved {
        model.probe = Some(probe_of(pixel, size));
    }
    ui.horizontal_wrapped(|ui| {
        let hint = "Copies the table to the clipboard, one row per line: name, tab, value";
        let copy = ui.add_enabled(!rows.is_empty(), Button::new("Copy"));
        if copy.on_hover_text(hint).on_disabled_hover_text("There are no values. Click on terrain in the picture.").clicked() {
            let text: String = rows.iter().map(|row| format!("{}\t{}\n", row.name, row.value)).collect();
            ui.ctx().copy_text(text);
        }
        if ui
            .add_enabled(model.probe.is_some(), Button::new("Stop inspecting"))
            .on_hover_text("Ends the inspection and removes the mark in the picture. A is then shaded once per picture instead of twice.")
            .on_disabled_hover_text("No pixel is inspected")
            .clicked()
        {
            model.probe = None;
        }
    });
}

/// Formats a vector.
fn vector([x, y, z]: [f64; 3], decimals: usize) -> String {
    format!("{x:.decimals$}, {y:.decimals$}, {z:.decimals$}")
}

fn percent(share: f64) -> String {
    format!("{:.2} %", 100.0 * share)
}

/// Formats a mask: the names of its flavours, and its number.
fn flavours(mask: u8) -> String {
    Variant::new(mask).map_or_else(|| format!("none ({mask})"), |variant| format!("{variant} ({mask})"))
}

/// Formats a normal and its slope.
fn normal(n: [f64; 3]) -> String {
    format!("{}; slope {:.2} deg", vector(n, 5), n[2].clamp(-1.0, 1.0).acos().to_degrees())
}

/// The table for a pixel of a picture that was drawn with these settings.
fn rows(pixel: &Pixel, settings: &Settings) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut row = |name: &str, value: String, about: &'static str| rows.push(Row { name: name.to_owned(), value, about });
    row("Pixel", format!("{}, {} px", pixel.pixel[0], pixel.pixel[1]), "Column and row in the rendered picture, from the top left");
    row(
        "World position",
        format!("{} m", vector(pixel.position, 4)),
        "Metres east and north of the centre of the world, and elevation. Computed from the depth along the ray of the pixel, in f64.",
    );
    row(
        "Sector",
        format!("{}, {}", pixel.sector[0], pixel.sector[1]),
        "Column and row of the sector, a square of the ground 64 m wide (wider in large imported worlds), from the south-west corner of the world",
    );
    row(
        "Depth",
        format!("{:.4} m", pixel.depth_m),
        "Distance along the view direction. The depth buffer stores the near-plane distance divided by this distance.",
    );
    row("Distance", format!("{:.4} m", pixel.distance_m), "Distance along the ray of the pixel. The weights of flavours depend on it.");
    row(
        "Shading normal",
        normal(pixel.shading_normal),
        "Normal for shading, as the geometry pass stored it: east, north, up. The weights of flavours and projections depend on it.",
    );
    row(
        "Triangle normal",
        normal(pixel.triangle_normal),
        "Normal of the triangle, as the geometry pass stored it, turned towards the camera. Derivatives of the position follow from it.",
    );
    match (pixel.triangle, pixel.normal_error()) {
        (Some(triangle), Some(error)) => {
            row(
                "Exact triangle normal",
                normal(triangle.normal),
                "Normal of the triangle that is drawn here, computed from the world data in f64",
            );
            row("Normal off by", format!("{:.3} deg", error.to_degrees()), "Angle between the stored and the exact normal of the triangle");
            row(
                "Triangle",
                format!("LOD {}, vertices {} m apart", triangle.lod, triangle.spacing_m),
                "Level of the quadtree node that is drawn here (the smaller, the finer), and the distance between its drawn vertices",
            );
        }
        _ => row(
            "Triangle",
            "not in the world data".to_owned(),
            "The world data has no triangle at this depth. This happens if the shader that places vertices was edited, or rarely by rounding.",
        ),
    }
    for (step, [name, exact, off]) in pixel
        .steps
        .iter()
        .zip([["Step right", "Step right, exact", "Step right, error"], ["Step down", "Step down, exact", "Step down, error"]])
    {
        row(
            name,
            format!("{} m", vector(step.shader, 5)),
            "Change of the position from this pixel to the next one in this direction, as computed by the shader",
        );
        let of_exact = step.exact.map_or_else(|| "none".to_owned(), |step| format!("{} m", vector(step, 5)));
        row(
            exact,
            of_exact,
            "Step from this pixel to the point where the next pixel's ray meets the plane of the exact triangle. `none`: there is no such point.",
        );
        row(
            off,
            derivative_error(step),
            "Error of the step, relative to the exact step. Error of the mip level: above 0, textures are too coarse; below 0, too fine.",
        );
    }
    row("Flavours needed", flavours(pixel.mask), "The mask of the pixel: the flavours that have a visible weight in it");
    row("Tile variant", flavours(pixel.variant), "All flavours that at least one pixel of the tile needs, or the flavours that are forced");
    for (flavour, weight) in Flavour::ALL.into_iter().zip(pixel.flavours).filter(|(_, weight)| *weight > 0.0) {
        row(
            &format!("Weight of {}", flavour.name()),
            percent(weight),
            "Weight of the flavour in this pixel, within the variant of its tile",
        );
    }
    for (texel, corner) in pixel.splat.iter().zip(CORNERS) {
        row(
            &format!("Material {corner}"),
            format!("{} (no. {}), {}, by height {}", texel.material, texel.index, percent(texel.weight), percent(texel.blended)),
            "Splat texel next to the pixel: material, index in the palette, bilinear weight, and weight when all four texels are blended by height",
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

/// The rows about the first random choice: thresholds, and the resulting choice.
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
            "The flavour that makes the first random choice, and the noise that gives its threshold",
        );
        if let Some(threshold) = draw.projection {
            let weights: Vec<String> = AXES.into_iter().zip(draw.projections).map(|(axis, w)| format!("{axis} {}", percent(w))).collect();
            row(
                "Projection threshold",
                format!("{threshold:.6}"),
                "Random number from 0 to 1. The first projection (x, y, z) whose cumulative weight exceeds it is chosen.",
            );
            row("Projections", weights.join(", "), "Weights of the projections along east (x), north (y) and up (z)");
        }
        row(
            "Material threshold",
            format!("{:.6}", draw.material),
            "Random number from 0 to 1. The first of the four materials above whose cumulative bilinear weight exceeds it is chosen.",
        );
    }
    row(
        "Choice",
        named(pixel.choice),
        "The first random choice, as recorded by the shader: the material, and also the projection if it is chosen at random",
    );
    let verdict = if pixel.agrees() { "the same".to_owned() } else { named(pixel.draw.map_or(0, |draw| draw.expected)) };
    row(
        "Choice by reference",
        verdict,
        "The choice that the CPU computes from the thresholds, to check the shader. The shader may choose differently because of rounding.",
    );
}

fn page(pixel: &Pixel, row: &mut impl FnMut(&str, String, &'static str)) {
    let Some(page) = pixel.page else {
        row("Page", "none".to_owned(), "The virtual texture has no weight in this pixel");
        return;
    };
    let kernels::virtual_texture::PageId { level, x, y } = page.id;
    row(
        "Page",
        format!("level {level}, column {x}, row {y}"),
        "The page of the virtual texture that this pixel requests. Columns and rows of its level count from the world's south-west corner.",
    );
    row(
        "Place in page",
        format!("{:.2}, {:.2} of {} texels", page.texel[0], page.texel[1], kernels::virtual_texture::PAGE_TEXELS),
        "Position in the page, from its south-west corner",
    );
    row(
        "Footprint",
        format!("{:.2} x {:.2}, covered {:.2} texels", page.footprint[0], page.footprint[1], page.covered),
        "Shorter and longer side of the pixel on the ground, seen from above, in texels of level 0, with mip bias. `covered`: the length that \
         decides the level, in the same unit.",
    );
    row(
        "Page LOD",
        format!("{:.3}: level {level}, mip {:.3}", page.lod, page.mip),
        "log2 of the length `covered`, at least 0. Its integer part, at most 13, is the level. The rest is the mip level in the page.",
    );
    let served = match page.served {
        Some(served) if served == page.id => "the same".to_owned(),
        Some(kernels::virtual_texture::PageId { level, x, y }) => format!("level {level}, column {x}, row {y}"),
        None => "none: far atlas".to_owned(),
    };
    row(
        "Page sampled",
        served,
        "The page that is sampled: the requested one or, if the cache cannot hold all pages of the frame, a coarser one or the far atlas",
    );
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
        has("Triangle", "not in the world data");
        pixel.draw = None;
        pixel.choice = 0;
        let table = values(&pixel);
        assert!(table.iter().any(|(n, v)| n == "Choice" && v == "none") && !table.iter().any(|(n, _)| n == "Drawn by"));
    }
}

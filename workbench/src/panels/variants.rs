//! The panel *Variants*: forcing one of the 31 variants, and choosing estimator, noise and other settings of shading.

use eframe::egui::{self, Color32, RichText, Ui};
use kernels::frame::FrameReport;
use kernels::settings::Kind;
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;
use kernels::variant::{Flavour, Variant};
use kernels::view::normals::NormalEncoding;

use super::control::control;
use crate::model::settings::{COUNTS, Settings, TIMES_VARIANTS, own_settings};
use crate::model::state::Model;

/// Columns of the table of 31 variants.
const COLUMNS: usize = 4;

/// Time of shading with one kernel: the specialised shader of a variant, or the generic shader.
#[derive(Clone, Debug, PartialEq)]
struct Timed {
    /// The variant; `None` = the generic kernel.
    variant: Option<Variant>,
    tiles: u32,
    ms: f64,
}

impl Timed {
    /// Nanoseconds per tile.
    fn ns_a_tile(&self) -> f64 {
        1e6 * self.ms / f64::from(self.tiles.max(1))
    }
}

/// Times of the kernels that had a separate pass, the longest first.
fn timed(report: &FrameReport) -> Vec<Timed> {
    let one = |name: &str, ms: f64| {
        let variant = if name == "generic" { None } else { Some(name.parse::<Variant>().ok()?) };
        let list = variant.map_or(0, |variant| usize::from(variant.mask()));
        Some(Timed { variant, tiles: report.tiles.get(list).copied().unwrap_or(0), ms })
    };
    let passes = report.passes.iter().filter_map(|pass| one(pass.name.strip_prefix(PASS)?, pass.time_ms));
    let mut timed: Vec<Timed> = passes.collect();
    timed.sort_by(|a, b| b.ms.total_cmp(&a.ms));
    timed
}

/// Prefix of the names of passes that shade with one kernel: a variant or the generic kernel.
pub(super) const PASS: &str = "shading: ";

/// Number of fetches that a pixel should take with the current estimator if it needs all flavours of a variant.
fn promised(settings: &Settings, variant: Variant) -> u32 {
    settings.frame.estimator.promised_fetches_of(variant)
}

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        if ui
            .selectable_label(model.settings.frame.variant.is_none(), "Automatic")
            .on_hover_text("Each tile is shaded with the flavours that its pixels need. Key: 0.")
            .clicked()
        {
            model.settings.frame.variant = None;
        }
        ui.checkbox(&mut model.settings.frame.generic, "Generic kernel").on_hover_text(
            "Uses one shader that reads the flavours of each tile at run time. It is the baseline for the 31 specialised shaders. Key: G.",
        );
    });
    ui.separator();
    ui.label("Flavours on every tile");
    ui.horizontal_wrapped(|ui| {
        for (key, flavour) in (1..).zip(Flavour::ALL) {
            let on = model.settings.frame.variant.is_some_and(|v| v.has(flavour));
            let text = RichText::new(format!("{key} {}", flavour.name()));
            let hint = format!(
                "{}. Key: {key}. Expected fetches per pixel with the current estimator, without those for colour modulation and a second tiling: {}.",
                about(flavour),
                model.settings.frame.estimator.promised_fetches(flavour)
            );
            if ui.selectable_label(on, text).on_hover_text(hint).clicked() {
                model.settings.toggle(flavour);
            }
        }
    });
    ui.separator();
    let tiles = model.shown().map(|shown| shown.picture.report.tiles.clone()).unwrap_or_default();
    let all = tiles.first().copied().unwrap_or(0).max(1);
    let times = model.shown().map(|shown| timed(&shown.picture.report)).unwrap_or_default();
    egui::Grid::new("31 variants").num_columns(COLUMNS).spacing([4.0, 4.0]).show(ui, |ui| {
        for (i, variant) in Variant::all().enumerate() {
            let own = times.iter().find(|timed| timed.variant == Some(variant));
            cell(model, ui, variant, [tiles.get(usize::from(variant.mask())).copied().unwrap_or(0), all], own);
            if i % COLUMNS == COLUMNS - 1 {
                ui.end_row();
            }
        }
    });
    control(ui, &TIMES_VARIANTS, &mut model.settings, |_| "");
    if model.settings.times_variants {
        table(model, ui, &times, all);
    }
    ui.separator();
    egui::Grid::new("estimator and noise").num_columns(2).show(ui, |ui| {
        for setting in own_settings().filter(|setting| matches!(setting.kind, Kind::Name(_) | Kind::Whole(..))) {
            let about: fn(&str) -> &'static str = match setting.name() {
                "normals" => of_normals,
                "estimator" => of_estimators,
                "noise" => of_noises,
                _ => |_| "",
            };
            control(ui, setting, &mut model.settings.frame, about);
            ui.end_row();
        }
    });
    // The control of the generic kernel is at the top of the panel.
    for setting in own_settings().filter(|setting| matches!(setting.kind, Kind::Flag) && setting.name() != "generic") {
        control(ui, setting, &mut model.settings.frame, |_| "");
    }
    control(ui, &COUNTS, &mut model.settings, |_| "");
}

/// The table of times, the longest first. `all` is the number of tiles with terrain.
fn table(model: &Model, ui: &mut Ui, times: &[Timed], all: u32) {
    let Some(shown) = model.shown().filter(|shown| shown.wish.settings.times_variants && !shown.draft) else { return };
    if times.is_empty() {
        ui.label("No times: the picture shows no terrain, or the device does not measure times.");
        return;
    }
    let settings = &shown.wish.settings;
    egui::Grid::new("times of variants").num_columns(6).striped(true).show(ui, |ui| {
        for (name, about) in [
            ("Variant", "The shaders that ran on at least one tile, the longest time first: variants or, as `generic`, the generic kernel"),
            ("Tiles", "Number of tiles of 8 x 8 pixels"),
            ("Share", "The number of tiles as a share of all tiles that show terrain"),
            (
                "Fetches",
                "Expected fetches of a pixel that needs all flavours of the variant, without those for colour modulation and a second tiling. \
                 `-`: the generic kernel runs, and the number differs from tile to tile.",
            ),
            ("ms", "Time of the pass that shades these tiles, as measured by the device, milliseconds"),
            ("ns a tile", "Time of the pass divided by the number of tiles, nanoseconds"),
        ] {
            ui.label(name).on_hover_text(about);
        }
        ui.end_row();
        for timed in times {
            ui.label(timed.variant.map_or_else(|| "generic".to_owned(), |variant| variant.to_string()));
            ui.label(timed.tiles.to_string());
            ui.label(format!("{:.1} %", 100.0 * f64::from(timed.tiles) / f64::from(all)));
            // The generic kernel runs the flavours that each tile needs. If no variant is forced, tiles have different numbers of fetches, so no
            // number is shown.
            let fetches = timed.variant.or(settings.frame.variant).map(|variant| promised(settings, variant));
            ui.label(fetches.map_or_else(|| "-".to_owned(), |fetches| fetches.to_string()));
            ui.label(format!("{:.3}", timed.ms));
            ui.label(format!("{:.0}", timed.ns_a_tile()));
            ui.end_row();
        }
    });
}

/// The button of a variant. It shows the number of the variant and its share of the tiles. The tooltip shows its fetches, its tiles, and its time if
/// known.
fn cell(model: &mut Model, ui: &mut Ui, variant: Variant, [tiles, all]: [u32; 2], timed: Option<&Timed>) {
    let forced = model.settings.frame.variant == Some(variant);
    let [r, g, b] = variant.colour();
    let share = if tiles > 0 { format!("{:.0} %", 100.0 * f64::from(tiles) / f64::from(all)) } else { String::new() };
    let fetches = promised(&model.settings, variant);
    let took = timed.map_or_else(String::new, |timed| format!(" Time: {:.3} ms, {:.0} ns a tile.", timed.ms, timed.ns_a_tile()));
    let dark = u32::from(r) * 3 + u32::from(g) * 6 + u32::from(b) < 1100;
    let running = tiles > 0;
    let text = RichText::new(format!("{} {share}", variant.mask())).color(match (running, dark) {
        (false, _) => ui.visuals().text_color(),
        (true, true) => Color32::WHITE,
        (true, false) => Color32::BLACK,
    });
    let mut button = egui::Button::new(text).selected(forced).min_size(egui::vec2(64.0, 20.0));
    if running {
        button = button.fill(Color32::from_rgb(r, g, b));
    }
    if forced {
        button = button.stroke(ui.visuals().selection.stroke);
    }
    let response = ui.add(button);
    let name = variant.to_string();
    response.widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, true, forced, format!("Variant {name}")));
    let hint = format!(
        "{name}. Expected fetches of a pixel that needs all these flavours, without those for colour modulation and a second tiling: {fetches}. \
         Tiles: {tiles}.{took}"
    );
    if response.on_hover_text(hint).clicked() {
        model.settings.frame.variant = if forced { None } else { Some(variant) };
    }
}

const fn about(flavour: Flavour) -> &'static str {
    match flavour {
        Flavour::VirtualTexture => "Virtual texture: materials blended as seen from above, and cached in pages",
        Flavour::FarAtlas => "Albedo and normal baked into the data of the terrain quadtree",
        Flavour::NearCliff => "Three projections. With the estimator fc5, each of them has one material, which is chosen at random",
        Flavour::FarCliff => {
            "Two tilings. With the estimator fc5, each of them has one projection and one material, which are chosen at random"
        }
        Flavour::Splat => "Three projections of four materials. With the estimator fc5, all of them are blended",
    }
}

/// The tooltip of an estimator.
fn of_estimators(name: &str) -> &'static str {
    match name.parse() {
        Ok(Estimator::Fc5) => "The method of Far Cry 5: cliffs take materials that are chosen at random, full splat blends all materials",
        Ok(Estimator::Exact) => "The exact blend: the mean of fc5 over all its random choices",
        Ok(Estimator::Biplanar) => "fc5 with the two projections that the surface faces most, instead of three",
        Ok(Estimator::Hex) => "fc5 with textures that are tiled by hexagons instead of a second tiling. The hexagons hide repetition.",
        Ok(Estimator::Stf) => "One texel of each texture: projection, material, tiling, mip level and texel are chosen at random",
        Ok(Estimator::Laplacian) => {
            "Two frequency bands of the textures: the coarse one blended smoothly, the fine one by height, so that details stay sharp"
        }
        Ok(Estimator::Luna8) => "Up to eight materials seen from above, each blended over those before it",
        Ok(Estimator::Snapped) => "Four materials in one projection: from above or, on steep ground, onto one of four vertical planes",
        Ok(Estimator::Variance | Estimator::BiplanarMean | Estimator::HexMean) | Err(_) => "",
    }
}

/// The tooltip of a kind of noise.
fn of_noises(name: &str) -> &'static str {
    match name.parse() {
        Ok(NoiseKind::HashedIsotropic) => {
            "Hashed alpha: fixed to the ground, in cells with the same width along all axes. `Noise cell` in Parameters sets their approximate \
             width on the screen."
        }
        Ok(NoiseKind::HashedAnisotropic) => "Anisotropic hashed alpha: like `hashed`, but the width of the cells differs from axis to axis",
        Ok(NoiseKind::WhiteScreen) => "White noise on the screen, new in every frame",
        Ok(NoiseKind::WhiteWorld) => "White noise that is fixed to the ground, in cells that are usually 6.25 cm wide at any distance",
        Ok(NoiseKind::InterleavedGradient) => "Interleaved gradient noise: a regular pattern on the screen, new in every frame",
        Ok(NoiseKind::Blue) => "Blue noise on the screen, the same in every frame unless the seed changes: fine grain without blotches",
        Ok(NoiseKind::SpatioTemporalBlue) => {
            "Blue noise on the screen and over time, new in every frame: fine grain that averages out quickly over frames"
        }
        Err(_) => "",
    }
}

/// The tooltip of an encoding of normals.
fn of_normals(name: &str) -> &'static str {
    match name.parse() {
        Ok(NormalEncoding::Octahedral) => "32 bits: 8 + 8 for the shading normal and 8 + 8 for the normal of the triangle, as in Far Cry 5",
        Ok(NormalEncoding::PlaneFirst) => {
            "32 bits: the shading normal as in Far Cry 5; the triangle's normal in steps that are 8 times finer, if it is near the shading normal"
        }
        Ok(NormalEncoding::Exact) => "128 bits without compression, to measure the error of the other encodings",
        Err(_) => "",
    }
}

#[cfg(test)]
mod tests {
    use kernels::gpu::PassTime;

    use super::*;

    #[test]
    fn times_are_those_of_passes_by_variant_and_the_longest_comes_first() {
        let pass = |name: &str, time_ms: f64| PassTime { name: name.to_owned(), time_ms };
        let mut report = FrameReport { tiles: vec![0; 32], ..FrameReport::default() };
        (report.tiles[0], report.tiles[2], report.tiles[17]) = (500, 400, 100);
        report.passes = vec![pass("geometry", 9.0), pass("shading: far-atlas", 0.5), pass("shading: vt+splat", 2.0), pass("lighting", 1.0)];
        let [splat, far] = [17, 2].map(|mask| Variant::new(mask).expect("a set"));
        let expected = [Timed { variant: Some(splat), tiles: 100, ms: 2.0 }, Timed { variant: Some(far), tiles: 400, ms: 0.5 }];
        assert_eq!(timed(&report), expected);
        assert!((expected[0].ns_a_tile() - 20_000.0).abs() < 1e-9 && (expected[1].ns_a_tile() - 1250.0).abs() < 1e-9);
        // The generic kernel runs on all tiles. A single pass for all variants gives no time per variant.
        report.passes = vec![pass("shading: generic", 3.0)];
        assert_eq!(timed(&report), [Timed { variant: None, tiles: 500, ms: 3.0 }]);
        report.passes = vec![pass("shading", 3.0), pass("shading: of the past", 1.0)];
        assert!(timed(&report).is_empty());
        assert!(Timed { variant: None, tiles: 0, ms: 0.0 }.ns_a_tile().abs() < 1e-9, "without tiles, nothing is divided by zero");
    }
}

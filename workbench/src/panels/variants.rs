//! Which shaders: the 31 sets of flavours, forced at a click, and what stands behind them.

use eframe::egui::{self, Color32, RichText, Ui};
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;
use kernels::variant::{Flavour, Variant};

use super::choose;
use crate::app::Workbench;

/// Columns of the 31.
const COLUMNS: usize = 4;

pub(crate) fn show(app: &mut Workbench, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        if ui.selectable_label(app.settings.forced.is_none(), "Automatic").on_hover_text("Each tile what its pixels need (0)").clicked() {
            app.settings.forced = None;
        }
        ui.checkbox(&mut app.settings.generic, "Generic kernel")
            .on_hover_text("One shader that takes the set at run time: what specialised ones are measured against (G)");
    });
    ui.separator();
    ui.label("Flavours on every tile");
    ui.horizontal_wrapped(|ui| {
        for (key, flavour) in (1..).zip(Flavour::ALL) {
            let on = app.settings.forced.is_some_and(|v| v.has(flavour));
            let text = RichText::new(format!("{key} {}", flavour.name()));
            let hint = format!("{}: {} fetches a pixel (key {key})", about(flavour), app.settings.estimator.promised_fetches(flavour));
            if ui.selectable_label(on, text).on_hover_text(hint).clicked() {
                app.settings.toggle(flavour);
            }
        }
    });
    ui.separator();
    let tiles = app.shown().map(|shown| shown.picture.report.tiles.clone()).unwrap_or_default();
    let all = tiles.first().copied().unwrap_or(0).max(1);
    egui::Grid::new("31 variants").num_columns(COLUMNS).spacing([4.0, 4.0]).show(ui, |ui| {
        for (i, variant) in Variant::all().enumerate() {
            cell(app, ui, variant, tiles.get(usize::from(variant.mask())).copied().unwrap_or(0), all);
            if i % COLUMNS == COLUMNS - 1 {
                ui.end_row();
            }
        }
    });
    ui.separator();
    egui::Grid::new("estimator and noise").num_columns(2).show(ui, |ui| {
        let shown = app.settings.estimator.name();
        let all = Estimator::ALL.into_iter().map(|e| (e, e.name().to_owned(), "")).collect();
        choose(ui, "Estimator", &mut app.settings.estimator, shown, all);
        ui.end_row();
        let shown = app.settings.noise.name();
        let all = NoiseKind::ALL.into_iter().map(|n| (n, n.name().to_owned(), "")).collect();
        choose(ui, "Noise", &mut app.settings.noise, shown, all);
        ui.end_row();
        let label = ui.label("Seed");
        ui.add(egui::DragValue::new(&mut app.settings.seed)).labelled_by(label.id);
        ui.end_row();
    });
    ui.checkbox(&mut app.settings.reseeds, "A seed a frame")
        .on_hover_text("Seed plus frame: what noise looks like that nothing holds still");
    ui.checkbox(&mut app.settings.two_tilings, "Two tilings").on_hover_text("Full splat at two scales of texture: 96 fetches");
    ui.checkbox(&mut app.settings.counts, "Count fetches").on_hover_text("By a slower shader; its time is not that of the plain one");
}

/// One of the 31: its number, its flavours as five stripes, its tiles.
fn cell(app: &mut Workbench, ui: &mut Ui, variant: Variant, tiles: u32, all: u32) {
    let forced = app.settings.forced == Some(variant);
    let [r, g, b] = variant.colour();
    let share = if tiles > 0 { format!("{:.0} %", 100.0 * f64::from(tiles) / f64::from(all)) } else { String::new() };
    let fetches: u32 = variant.flavours().map(|f| app.settings.estimator.promised_fetches(f)).sum();
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
    if response.on_hover_text(format!("{name}: {fetches} fetches a pixel, {tiles} of {all} tiles")).clicked() {
        app.settings.forced = if forced { None } else { Some(variant) };
    }
}

const fn about(flavour: Flavour) -> &'static str {
    match flavour {
        Flavour::VirtualTexture => "shaded from above once, kept in pages",
        Flavour::FarAtlas => "albedo and normal baked into the quadtree",
        Flavour::NearCliff => "three projections, one random material each",
        Flavour::FarCliff => "two tilings, one random projection and material each",
        Flavour::Splat => "three projections of four materials, all blended",
    }
}

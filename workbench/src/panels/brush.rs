//! The panel *Brush*: the settings of the next stroke, and the list of strokes.

use eframe::egui::{self, Button, Role, Ui, WidgetInfo};
use kernels::scene::{Stroke, StrokeKind};

use super::{Number, choose, number};
use crate::model::brush::{Brush, Ground, MOST_AMOUNT, RADII_M, length_m};
use crate::model::state::Model;

/// Both kinds of strokes, in the order of the menu.
const KINDS: [StrokeKind; 2] = [StrokeKind::Splat, StrokeKind::Mask];

const fn name(kind: StrokeKind) -> &'static str {
    match kind {
        StrokeKind::Splat => "Splat",
        StrokeKind::Mask => "Mask",
    }
}

const fn about(kind: StrokeKind) -> &'static str {
    match kind {
        StrokeKind::Splat => "Paints the material wherever the brush passes, regardless of the rules",
        StrokeKind::Mask => "Multiplies the weights of the material's rules by `Brush amount` where the brush passes, with a soft border",
    }
}

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    model.brush.fit(&model.settings.scene);
    ui.checkbox(&mut model.brush.paints, "Paint").on_hover_text(
        "Lets a drag or a click in the picture paint on the ground. To look around, hold Shift and drag. Key B switches this on or off.",
    );
    settings(model, ui);
    notes(model, ui);
    ui.separator();
    strokes(model, ui);
}

/// The settings of the next stroke.
fn settings(model: &mut Model, ui: &mut Ui) {
    let names: Vec<String> = model.settings.scene.materials.iter().map(|material| material.name.clone()).collect();
    let (brush, usual) = (&mut model.brush, Brush::default());
    egui::Grid::new("brush").num_columns(3).show(ui, |ui| {
        let all = KINDS.into_iter().map(|kind| (kind, name(kind).to_owned(), about(kind))).collect();
        let shown = name(brush.kind);
        choose(ui, "Brush kind", &mut brush.kind, shown, all).on_hover_text(about(brush.kind));
        ui.end_row();
        let shown = brush.material.clone();
        let all = names.into_iter().map(|name| (name.clone(), name, "")).collect();
        let hint = "A splat brush paints this material. A mask brush changes the weights of this material's rules.";
        choose(ui, "Brush material", &mut brush.material, &shown, all).on_hover_text(hint);
        ui.end_row();
        let about = "Radius of the brush on the ground, seen from above.";
        let row = Number { name: "Brush radius", unit: "m", range: RADII_M, logarithmic: true, about };
        number(ui, &row, &mut brush.radius_m, Some(usual.radius_m));
        if brush.kind == StrokeKind::Mask {
            let about = "Width of the soft border of a mask, measured inwards from the outline of the stroke. 0: hard border.";
            let row = Number { name: "Brush fade", unit: "m", range: [0.0, brush.radius_m], logarithmic: false, about };
            number(ui, &row, &mut brush.fade_m, Some(usual.fade_m));
            let about =
                "Factor on the weights of the rules for the material. Below 1, the material becomes rarer; above 1, it becomes more frequent.";
            let row = Number { name: "Brush amount", unit: "x", range: [0.0, MOST_AMOUNT], logarithmic: false, about };
            number(ui, &row, &mut brush.amount, Some(usual.amount));
        }
    });
}

/// Notes that say why painting has no effect, or why a drag was not painted completely.
fn notes(model: &Model, ui: &mut Ui) {
    let brush = &model.brush;
    let has_rule = model.settings.scene.rules.iter().any(|rule| rule.material == brush.material);
    let warn = ui.visuals().warn_fg_color;
    if brush.kind == StrokeKind::Mask && !has_rule {
        ui.colored_label(warn, format!("No rule uses `{}`, so a mask for it has no effect.", brush.material));
    }
    if brush.paints && model.shown_here().is_none_or(|shown| Ground::of(shown).is_none()) {
        ui.label("The position of the ground is not known yet: wait for the next picture.");
    }
    if let Some(full) = brush.full() {
        ui.colored_label(warn, full);
    }
}

/// The list of strokes, in their order in the scene.
fn strokes(model: &mut Model, ui: &mut Ui) {
    let strokes = &mut model.settings.scene.strokes;
    let count = strokes.len();
    ui.horizontal_wrapped(|ui| {
        ui.label(format!("{}, applied in this order", counted(count, "stroke")));
        let clear = ui.add_enabled(count > 0, Button::new("Clear strokes"));
        let hint = "Removes all strokes, including those with which the scene was opened. Undo restores them.";
        if clear.on_hover_text(hint).on_disabled_hover_text("There are no strokes").clicked() {
            strokes.clear();
        }
    });
    let mut unwanted = None;
    egui::Grid::new("strokes").num_columns(2).striped(true).show(ui, |ui| {
        for (i, stroke) in strokes.iter().enumerate() {
            let number = i + 1;
            ui.label(line(number, stroke)).on_hover_text(hint(stroke));
            let button = ui.add(Button::new("Remove").small());
            button.widget_info(|| WidgetInfo::labeled(Role::Button, true, format!("Remove stroke {number}")));
            if button.clicked() {
                unwanted = Some(i);
            }
            ui.end_row();
        }
    });
    if let Some(i) = unwanted {
        strokes.remove(i);
    }
}

fn line(number: usize, stroke: &Stroke) -> String {
    let points = counted(stroke.points.len(), "point");
    format!("Stroke {number}: {}, {}, {points}, {:.1} m long", name(stroke.kind), stroke.material, length_m(stroke))
}

fn counted(count: usize, what: &str) -> String {
    format!("{count} {what}{}", if count == 1 { "" } else { "s" })
}

fn hint(stroke: &Stroke) -> String {
    let radius = format!("Radius {} m", stroke.radius_m);
    match stroke.kind {
        StrokeKind::Splat => radius,
        StrokeKind::Mask => format!("{radius}, fade {} m, amount {} x", stroke.fade_m, stroke.amount),
    }
}

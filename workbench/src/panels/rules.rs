//! The panel *Rules*: the splat rules, which assign a material to each place that is not covered by a splat stroke.

use eframe::egui::{self, Button, CollapsingHeader, DragValue, Role, Ui, WidgetInfo};
use kernels::scene::Rule;

use super::{choose, outcome};
use crate::model::editing::usual_rules;
use crate::model::state::Model;

/// Describes a band: a range of one quantity of the ground (height, slope or curvature). Outside of the range, the weight of the rule falls to 0 over
/// an interval of this quantity. The width of the interval is called the fade.
struct Band {
    name: &'static str,
    unit: &'static str,
    /// Smallest and largest value that a scene file accepts for an end of the range.
    limits: [f64; 2],
    /// The range that a band has when the user switches it on. It is so wide that it usually changes nothing.
    whole: [f64; 2],
    /// Largest fade that a scene file accepts, in the unit of the quantity.
    most_fade: f64,
    /// Change of an end of the range, or of the fade, per point of a drag.
    speed: f64,
    about: &'static str,
}

const HEIGHT: Band = Band {
    name: "height",
    unit: " m",
    limits: [-1.0e7, 1.0e7],
    whole: [-1000.0, 9000.0],
    most_fade: 1.0e7,
    speed: 5.0,
    about: "elevation in metres",
};
const SLOPE: Band = Band {
    name: "slope",
    unit: " deg",
    limits: [0.0, 90.0],
    whole: [0.0, 90.0],
    most_fade: 90.0,
    speed: 0.2,
    about: "slope in degrees, from 0 (level ground) to 90 (a vertical wall)",
};
const CURVATURE: Band = Band {
    name: "curvature",
    unit: " 1/m",
    limits: [-1.0e3, 1.0e3],
    whole: [-10.0, 10.0],
    most_fade: 1.0e3,
    speed: 1e-3,
    about: "mean curvature in 1/m, below 0 in gullies and above 0 on ridges",
};

/// A change of the list of rules. It is made after the controls of all rules have been drawn.
enum Wanted {
    Up,
    Down,
    Gone,
}

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    ui.label("At each place, the rule with the largest weight assigns its material. If two weights are equal, the later rule wins. If all weights are 0, the first rule wins.");
    buttons(model, ui);
    ui.separator();
    let names: Vec<String> = model.settings.scene.materials.iter().map(|material| material.name.clone()).collect();
    let rules = &mut model.settings.scene.rules;
    let count = rules.len();
    let mut wanted = None;
    for (i, rule) in rules.iter_mut().enumerate() {
        let number = i + 1;
        CollapsingHeader::new(format!("Rule {number}: {}", rule.material)).id_salt(("rule", i)).show(ui, |ui| {
            ui.horizontal_wrapped(|ui| {
                for (able, text, name, what, why) in [
                    (i > 0, "Move up", format!("Move rule {number} up"), Wanted::Up, "This is the first rule"),
                    (number < count, "Move down", format!("Move rule {number} down"), Wanted::Down, "This is the last rule"),
                    (count > 1, "Remove", format!("Remove rule {number}"), Wanted::Gone, "A scene needs at least one rule"),
                ] {
                    let button = ui.add_enabled(able, Button::new(text));
                    button.widget_info(|| WidgetInfo::labeled(Role::Button, able, &name));
                    if button.on_disabled_hover_text(why).clicked() {
                        wanted = Some((i, what));
                    }
                }
            });
            egui::Grid::new(("rule", i)).num_columns(2).show(ui, |ui| one(ui, number, rule, &names));
        });
    }
    match wanted {
        Some((i, Wanted::Up)) => rules.swap(i - 1, i),
        Some((i, Wanted::Down)) => rules.swap(i, i + 1),
        Some((i, Wanted::Gone)) => drop(rules.remove(i)),
        None => {}
    }
}

/// The buttons for the list of rules.
fn buttons(model: &mut Model, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let rules = &mut model.settings.scene.rules;
        let add = ui.add_enabled(!rules.is_empty(), Button::new("Add rule"));
        let hint =
            "Adds a copy of the last rule. A copy without noise has no effect until you edit it. A copy with noise has other noise patches.";
        if add.on_hover_text(hint).on_disabled_hover_text("There is no rule to copy").clicked() {
            let last = rules.last().cloned();
            rules.extend(last);
        }
        let changed = *rules != model.original.rules;
        let reset = ui.add_enabled(changed, Button::new("Reset rules"));
        let reset = reset.on_hover_text("Restores the rules as they were when the scene was opened or last saved");
        if reset.on_disabled_hover_text("The rules are as they were when the scene was opened or last saved").clicked() {
            model.rules.said = match usual_rules(&model.settings.scene, &model.original) {
                Ok(rules) => {
                    model.settings.scene.rules = rules;
                    None
                }
                Err(why) => Some(Err(why)),
            };
        }
    });
    outcome(ui, "rule", model.rules.said.as_ref());
}

/// The controls of a rule, in a grid of two columns.
fn one(ui: &mut Ui, number: usize, rule: &mut Rule, names: &[String]) {
    let shown = rule.material.clone();
    let all = names.iter().map(|name| (name.clone(), name.clone(), "")).collect();
    choose(ui, &format!("Rule {number} material"), &mut rule.material, &shown, all).on_hover_text("The material of this rule");
    ui.end_row();
    let hint =
        "Factor on the weight that follows from the bands and the noise below, 0.000001 to 1000000. The default in a scene file is 1.";
    let label = ui.label(format!("Rule {number} weight"));
    value(ui, &mut rule.weight, [1.0e-6, 1.0e6], 0.01, "").labelled_by(label.id).on_hover_text(hint);
    ui.end_row();
    band(ui, number, &HEIGHT, &mut rule.height_m, &mut rule.height_fade_m);
    band(ui, number, &SLOPE, &mut rule.slope_deg, &mut rule.slope_fade_deg);
    band(ui, number, &CURVATURE, &mut rule.curvature, &mut rule.curvature_fade);
    let hint = "Size of the noise patches in which the rule applies, 0 to 100000 m. 0: it applies everywhere within its bands.";
    let label = ui.label(format!("Rule {number} noise"));
    value(ui, &mut rule.noise_m, [0.0, 1.0e5], 1.0, " m").labelled_by(label.id).on_hover_text(hint);
    ui.end_row();
    if rule.noise_m > 0.0 {
        let hint = "Approximate share of the ground that the noise patches cover, 0 to 1. The default in a scene file is 0.5.";
        let label = ui.label(format!("Rule {number} cover"));
        value(ui, &mut rule.noise_cover, [0.0, 1.0], 0.01, "").labelled_by(label.id).on_hover_text(hint);
        ui.end_row();
    }
}

/// A control for a number. It limits the number to the range only when the number is edited.
fn value(ui: &mut Ui, value: &mut f64, [low, high]: [f64; 2], speed: f64, unit: &str) -> egui::Response {
    let drag = DragValue::new(&mut *value).range(low..=high).clamp_existing_to_range(false).speed(speed).suffix(unit).max_decimals(4);
    let response = ui.add(drag);
    if response.changed() {
        *value = value.max(low).min(high);
    }
    response
}

/// The controls of a band: a checkbox that switches it on, its ends, and its fade.
fn band(ui: &mut Ui, number: usize, kind: &Band, band: &mut Option<[f64; 2]>, fade: &mut f64) {
    let Band { name, unit, limits: [lowest, highest], whole, most_fade, speed, about } = *kind;
    let mut has = band.is_some();
    if ui
        .checkbox(&mut has, format!("Rule {number} {name} band"))
        .on_hover_text(format!("Limits the rule to a range of one quantity: {about}."))
        .changed()
    {
        *band = has.then_some(whole);
    }
    let Some([from, to]) = band else {
        ui.label("everywhere");
        ui.end_row();
        return;
    };
    ui.horizontal(|ui| {
        let hint = format!(
            "Lower end of the range in which the rule has its full weight. Quantity: {about}. Accepted: {lowest}{unit} to the upper end."
        );
        let label = ui.label(format!("Rule {number} {name} from"));
        value(ui, from, [lowest, *to], speed, unit).labelled_by(label.id).on_hover_text(hint);
    });
    ui.end_row();
    ui.label("");
    ui.horizontal(|ui| {
        let hint = format!(
            "Upper end of the range in which the rule has its full weight. Quantity: {about}. Accepted: the lower end to {highest}{unit}."
        );
        let label = ui.label(format!("Rule {number} {name} to"));
        value(ui, to, [*from, highest], speed, unit).labelled_by(label.id).on_hover_text(hint);
    });
    ui.end_row();
    ui.label("");
    ui.horizontal(|ui| {
        let hint = format!(
            "Beyond each end of the range, the weight falls to 0 over an interval of this width, from 0 (abrupt) to {most_fade}{unit}."
        );
        let label = ui.label(format!("Rule {number} {name} fade"));
        value(ui, fade, [0.0, most_fade], speed, unit).labelled_by(label.id).on_hover_text(hint);
    });
    ui.end_row();
}

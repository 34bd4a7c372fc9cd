//! The panel *Parameters*: the numbers of the scene and the frame and the settings of the stages, with unit, range and a reset button.

use eframe::egui::{self, Slider, Ui};
use kernels::scene::Scene;
use kernels::settings::{Field as _, Kind, Setting, Slider as Ends};

use super::control::{control, reset_setting};
use super::reset;
use crate::model::settings::{SCALE, numbers, own_settings, stage_settings};
use crate::model::state::Model;

/// Width of a row without its slider, points.
const BESIDE: f32 = 310.0;
/// Smallest and largest width of a slider, points.
const SLIDER: [f32; 2] = [30.0, 200.0];

/// A number of the scene with the ends of its slider.
type Row = (&'static Setting<Scene>, Ends);

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    ui.spacing_mut().slider_width = (ui.available_width() - BESIDE).clamp(SLIDER[0], SLIDER[1]);
    ui.horizontal(|ui| {
        control(ui, &SCALE, &mut model.settings, |_| "");
        reset_setting(ui, &SCALE, &mut model.settings, &model.usual_scale.value());
    });
    // This loop shows numbers of a frame and the settings of its stages. The panel *Variants* shows the other settings of a frame that the workbench
    // has.
    let numbers_of_frame = own_settings().filter(|setting| matches!(setting.kind, Kind::Number(_) | Kind::OneOf(_)));
    for setting in numbers_of_frame.chain(stage_settings()) {
        let usual = if setting.name() == "vertex_stride" { Some(model.usual_stride.value()) } else { (setting.default)() };
        ui.horizontal(|ui| {
            control(ui, setting, &mut model.settings.frame, |_| "");
            if let Some(usual) = usual {
                reset_setting(ui, setting, &mut model.settings.frame, &usual);
            }
        });
    }
    let mut groups: Vec<(&str, Vec<Row>)> = Vec::new();
    for (setting, ends) in numbers() {
        match groups.last_mut() {
            Some((group, rows)) if *group == setting.listing.group => rows.push((setting, ends)),
            _ => groups.push((setting.listing.group, vec![(setting, ends)])),
        }
    }
    for (group, rows) in groups {
        egui::CollapsingHeader::new(group).default_open(true).show(ui, |ui| {
            egui::Grid::new(group).num_columns(3).show(ui, |ui| {
                for (setting, ends) in rows {
                    row(model, ui, setting, ends);
                    ui.end_row();
                }
            });
        });
    }
}

fn row(model: &mut Model, ui: &mut Ui, setting: &Setting<Scene>, ends: Ends) {
    let (Some(usual), Some(value)) =
        (setting.get(&model.original).and_then(|value| value.as_float()), setting.number(&mut model.settings.scene))
    else {
        return;
    };
    let suffix = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
    let hint = format!("{}\nKey: `{}`. Accepted: {}. The original value is {usual}{suffix}.", setting.about, setting.key, setting.kind);
    let label = ui.label(setting.label()).on_hover_text(&hint);
    let [least, most] = ends.ends;
    ui.add(
        Slider::new(value, least..=most).logarithmic(ends.logarithmic).clamping(egui::SliderClamping::Never).suffix(suffix).max_decimals(3),
    )
    .labelled_by(label.id)
    .on_hover_text(&hint);
    reset(ui, setting.label(), value, Some(&usual));
}

//! The scene's numbers, each with its unit, range, and a way back.

use eframe::egui::{self, Slider, Ui};
use kernels::geometry::STRIDES;
use kernels::quadtree::LOD_BIASES;

use super::{choose, reset};
use crate::model::parameters::{GROUPS, Parameter};
use crate::model::settings::SCALES;
use crate::model::state::Model;

/// Points that a row takes beside its slider, and the slider's narrowest and widest.
const BESIDE: f32 = 310.0;
const SLIDER: [f32; 2] = [30.0, 200.0];

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    ui.spacing_mut().slider_width = (ui.available_width() - BESIDE).clamp(SLIDER[0], SLIDER[1]);
    ui.horizontal(|ui| {
        let label = ui.label("Render scale");
        ui.add(Slider::new(&mut model.settings.scale, SCALES[0]..=SCALES[1]).logarithmic(true).clamping(egui::SliderClamping::Always))
            .labelled_by(label.id)
            .on_hover_text("Pixels drawn per pixel of the screen, along a side");
        reset(ui, "Render scale", &mut model.settings.scale, Some(&model.usual_scale));
    });
    ui.horizontal(|ui| {
        let label = ui.label("Node LOD bias");
        let [finest, coarsest] = LOD_BIASES;
        ui.add(
            Slider::new(&mut model.settings.lod_bias, finest..=coarsest)
                .clamping(egui::SliderClamping::Always)
                .suffix(" levels")
                .max_decimals(2),
        )
        .labelled_by(label.id)
        .on_hover_text("Levels that the terrain's nodes are drawn coarser, below 0 finer: geometry, splat map and baked colours alike");
        reset(ui, "Node LOD bias", &mut model.settings.lod_bias, Some(&0.0));
    });
    ui.horizontal(|ui| {
        let about =
            "Of a node's vertices along a side every so many-th is drawn. The ground's textures stay as fine; ridges lose their detail";
        let shown = model.settings.vertex_stride.to_string();
        let all = STRIDES.into_iter().map(|stride| (stride, stride.to_string(), "")).collect();
        choose(ui, "Vertex stride", &mut model.settings.vertex_stride, &shown, all).on_hover_text(about);
        reset(ui, "Vertex stride", &mut model.settings.vertex_stride, Some(&model.usual_stride));
    });
    for group in &GROUPS {
        egui::CollapsingHeader::new(group.name).default_open(true).show(ui, |ui| {
            egui::Grid::new(group.name).num_columns(3).show(ui, |ui| {
                for parameter in group.parameters {
                    row(model, ui, parameter);
                    ui.end_row();
                }
            });
        });
    }
}

fn row(model: &mut Model, ui: &mut Ui, parameter: &Parameter) {
    let usual = *(parameter.at)(&mut model.original);
    let value = (parameter.at)(&mut model.settings.scene);
    let hint = format!(
        "{}\n{} in a scene or an experiment; here from {} to {}, {usual} in this scene.",
        parameter.about, parameter.key, parameter.range[0], parameter.range[1]
    );
    let label = ui.label(parameter.name).on_hover_text(&hint);
    let suffix = if parameter.unit.is_empty() { String::new() } else { format!(" {}", parameter.unit) };
    ui.add(
        Slider::new(value, parameter.range[0]..=parameter.range[1])
            .logarithmic(parameter.logarithmic)
            .clamping(egui::SliderClamping::Never)
            .suffix(suffix)
            .max_decimals(3),
    )
    .labelled_by(label.id)
    .on_hover_text(&hint);
    reset(ui, parameter.name, value, Some(&usual));
}

//! What is measured of the pictures as they go by: numbers, and their course.

use eframe::egui::{self, Slider, Ui};
use egui_plot::{Legend, Line, Plot, PlotPoints};
use kernels::metrics::Summary;

use crate::model::metrics::{Metrics, Reading, WINDOWS};
use crate::model::state::Model;

/// One number of a summary.
struct Quantity {
    name: &'static str,
    about: &'static str,
    of: fn(&Summary) -> Option<f64>,
}

const QUANTITIES: [Quantity; 5] = [
    Quantity {
        name: "Flip rate",
        about: "Share of random choices that differ from the frame before, at the same surface point",
        of: |s| s.flip_rate,
    },
    Quantity {
        name: "Flicker",
        about: "Mean |difference| in luminance of linear albedo to the frame before, at the same surface point",
        of: |s| Some(s.flicker),
    },
    Quantity {
        name: "Noise",
        about: "Square root of the mean variance of luminance over frames, following the surface",
        of: |s| Some(s.variance.sqrt()),
    },
    Quantity { name: "Bias", about: "Mean A - B in luminance, where B is drawn", of: |s| s.bias },
    Quantity {
        name: "Clumping",
        about: "Variance of 5 x 5 blocks of this frame's noise, relative to white noise (1). Noise is A - B, or without B what differs from the running mean",
        of: |s| s.clumping,
    },
];

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let Metrics { on, window, frozen, resets, region } = &mut model.metrics;
    ui.horizontal_wrapped(|ui| {
        ui.checkbox(on, "Measure").on_hover_text("By shaders that record choices: times are not those of the plain ones");
        ui.checkbox(frozen, "Freeze").on_hover_text("The numbers stay as they are; let go, they begin anew");
        if ui.button("Begin anew").clicked() {
            *resets = resets.wrapping_add(1);
        }
        if ui
            .add_enabled(region.is_some(), egui::Button::new("Whole picture"))
            .on_hover_text("Ctrl and a drag measure a rectangle")
            .clicked()
        {
            *region = None;
        }
    });
    ui.horizontal(|ui| {
        let label = ui.label("Window");
        ui.add(Slider::new(window, WINDOWS[0]..=WINDOWS[1]).logarithmic(true).suffix(" frames"))
            .labelled_by(label.id)
            .on_hover_text("How far back numbers go: a frame weighs one part in so many");
    });
    let Some(shown) = model.shown().cloned() else { return };
    let Some(last) = shown.readings.last() else {
        ui.label("Nothing measured yet: `Measure`, or one of the layers Deviation, Flicker, Flips and Bias, and let time run.");
        return;
    };
    table(last, ui);
    for quantity in &QUANTITIES {
        plot(quantity, &shown.readings, ui);
    }
}

fn table(last: &Reading, ui: &mut Ui) {
    egui::Grid::new("metrics").num_columns(3).striped(true).show(ui, |ui| {
        for name in ["", "A", "B"] {
            ui.label(name);
        }
        ui.end_row();
        for quantity in &QUANTITIES {
            ui.label(quantity.name).on_hover_text(quantity.about);
            for side in &last.sides {
                ui.label(side.as_ref().and_then(quantity.of).map_or_else(|| "-".to_owned(), |value| format!("{value:.5}")));
            }
            ui.end_row();
        }
        ui.label("Pixels").on_hover_text("Of terrain");
        for side in &last.sides {
            ui.label(side.map_or_else(|| "-".to_owned(), |s| s.terrain.to_string()));
        }
        ui.end_row();
        ui.label("Frames").on_hover_text("That the median pixel was followed, at most the window");
        for side in &last.sides {
            ui.label(side.map_or_else(|| "-".to_owned(), |s| format!("{:.0}", s.frames)));
        }
        ui.end_row();
    });
}

fn plot(quantity: &Quantity, readings: &[Reading], ui: &mut Ui) {
    ui.label(quantity.name).on_hover_text(quantity.about);
    let plot = Plot::new(quantity.name).height(72.0).legend(Legend::default()).allow_drag(false).allow_zoom(false).allow_scroll(false);
    let response = plot.show(ui, |plot| {
        for (side, name) in [(0, "A"), (1, "B")] {
            let point = |r: &Reading| Some([f64::from(r.frame), r.sides[side].as_ref().and_then(quantity.of)?]);
            let points: Vec<[f64; 2]> = readings.iter().filter_map(point).collect();
            if !points.is_empty() {
                plot.line(Line::new(name, PlotPoints::from(points)));
            }
        }
    });
    let name = format!("{} over frames", quantity.name);
    response.response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &name));
}

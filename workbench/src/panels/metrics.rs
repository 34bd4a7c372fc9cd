//! The panel *Metrics*: live metrics of the pictures, as numbers and as plots over frames.

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

const QUANTITIES: [Quantity; 6] = [
    Quantity {
        name: "Flip rate",
        about: "Share of random choices that differ from those in the previous frame at the same surface point",
        of: |s| s.flip_rate,
    },
    Quantity {
        name: "Flicker",
        about: "Mean absolute change in the luminance of linear albedo since the previous frame, at the same surface point",
        of: |s| Some(s.flicker),
    },
    Quantity {
        name: "Residual",
        about: "Mean absolute change of A - B in luminance of albedo since the previous frame, at the same surface point: the change that only one \
                of the two pictures has. Measured for A only, while B is drawn.",
        of: |s| s.residual,
    },
    Quantity {
        name: "Noise",
        about: "Square root of the mean variance: the variance of the luminance of albedo over frames at each surface point, averaged over all \
                points",
        of: |s| Some(s.variance.sqrt()),
    },
    Quantity { name: "Bias", about: "Mean of A - B in luminance of albedo. Measured for A only, while B is drawn.", of: |s| s.bias },
    Quantity {
        name: "Clumping",
        about: "Variance of the means of the noise over blocks of 5 x 5 pixels, relative to white noise of the same variance; 1 = white, more = \
                blotches. The noise of A is A - B if B is drawn; otherwise, and for B, it is the deviation from the running mean.",
        of: |s| s.clumping,
    },
];

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let Metrics { on, window, frozen, resets, region } = &mut model.metrics;
    ui.horizontal_wrapped(|ui| {
        let hint = "Measures flicker, noise and other numbers in every frame, and shows them below. This uses shaders that record random choices, \
                    so times differ from those of the normal shaders.";
        ui.checkbox(on, "Measure").on_hover_text(hint);
        let hint = "New frames do not change the numbers. If the settings of A or B change meanwhile, or time advances by more than one frame, \
                    measuring starts again when you switch this off.";
        ui.checkbox(frozen, "Freeze").on_hover_text(hint);
        if ui.button("Restart").on_hover_text("Discards the frames measured so far and measures again").clicked() {
            *resets = resets.wrapping_add(1);
        }
        if ui
            .add_enabled(region.is_some(), egui::Button::new("Whole picture"))
            .on_hover_text("Removes the rectangle, so that the whole picture is measured")
            .on_disabled_hover_text("The whole picture is measured. To measure a rectangle only, hold Ctrl and drag in the picture.")
            .clicked()
        {
            *region = None;
        }
    });
    ui.horizontal(|ui| {
        let label = ui.label("Window");
        let hint = "Number of frames, 2 to 1024, over which the numbers are averaged, approximately: older frames count exponentially less. Until a \
                    surface point has been visible for that many frames, all its frames have the same weight; from then on, the newest frame has \
                    the weight 1 / this number.";
        let slider = Slider::new(window, WINDOWS[0]..=WINDOWS[1]).logarithmic(true).suffix(" frames");
        ui.add(slider).labelled_by(label.id).on_hover_text(hint);
    });
    let Some(shown) = model.shown().cloned() else { return };
    let Some(last) = shown.readings.last() else {
        ui.label("Nothing is measured yet. Switch `Measure` on, or choose the layer Deviation, Flicker, Flips, Bias or Residual, and let time run.");
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
        ui.label("Pixels").on_hover_text("Number of measured pixels that show terrain");
        for side in &last.sides {
            ui.label(side.map_or_else(|| "-".to_owned(), |s| s.terrain.to_string()));
        }
        ui.end_row();
        ui.label("Frames").on_hover_text(
            "Median over pixels: number of frames for which the surface point has been followed, at most the length of the window",
        );
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

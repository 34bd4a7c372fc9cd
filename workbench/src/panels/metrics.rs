//! The panel *Metrics*: live metrics of the pictures, as numbers and as plots over frames.

use eframe::egui::{self, Slider, Ui};
use egui_plot::{Legend, Line, Plot, PlotPoints};
use kernels::metrics::Summary;

use super::COMMAND;
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
        about: "Share of the random choices that differ from the choice in the previous frame at the same surface point",
        of: |s| s.flip_rate,
    },
    Quantity {
        name: "Flicker",
        about: "Mean absolute change in the luminance of linear albedo since the previous frame, at the same surface point",
        of: |s| Some(s.flicker),
    },
    Quantity {
        name: "Residual",
        about: "Mean absolute change of the difference A - B in luminance of albedo since the previous frame, at the same surface point. It is 0 \
                where A and B change alike. It is shown in column A while B is drawn.",
        of: |s| s.residual,
    },
    Quantity {
        name: "Noise",
        about: "Square root of the mean variance. The variance is that of the luminance of albedo over frames at a surface point. The mean is taken \
                over all points.",
        of: |s| Some(s.variance.sqrt()),
    },
    Quantity { name: "Bias", about: "Mean of A - B in luminance of albedo. It is shown in column A while B is drawn.", of: |s| s.bias },
    Quantity {
        name: "Clumping",
        about: "How blotchy the noise of the last frame is: the variance of its means over blocks of 5 x 5 pixels, relative to white noise of the \
                same variance. White noise has 1, blotches have more. If B is drawn, the noise of A is A - B. Otherwise, and for B, it is the \
                deviation from the mean over frames.",
        of: |s| s.clumping,
    },
];

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let Metrics { on, window, frozen, resets, region } = &mut model.metrics;
    ui.horizontal_wrapped(|ui| {
        let hint = "Measures flicker, noise and other numbers from frame to frame, and shows them below. This uses shaders that record random \
                    choices, so times differ from those of the normal shaders.";
        ui.checkbox(on, "Measure").on_hover_text(hint);
        let hint = "Keeps the numbers as they are, unless the size of the picture changes. When you switch this off, measuring starts again if the \
                    settings of A or B have changed, or if time has advanced by more than one frame.";
        ui.checkbox(frozen, "Freeze").on_hover_text(hint);
        if ui.button("Restart").on_hover_text("Discards the results so far and starts to measure again").clicked() {
            *resets = resets.wrapping_add(1);
        }
        if ui
            .add_enabled(region.is_some(), egui::Button::new("Whole picture"))
            .on_hover_text("Removes the rectangle, so that the whole picture is measured")
            .on_disabled_hover_text(format!("The whole picture is measured already. To measure a rectangle, hold {COMMAND} and drag in the picture."))
            .clicked()
        {
            *region = None;
        }
    });
    ui.horizontal(|ui| {
        let label = ui.label("Window");
        let hint = "Approximate number of past frames that count in the numbers, 2 to 1024. At first, all frames in which a surface point was \
                    visible have the same weight. After this number of frames, older frames count exponentially less.";
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
            "Number of frames for which surface points have been followed, at most the length of the window. This is the median over the pixels.",
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

//! The panel *Compare*: what B is, how A and B are shown, and how much they differ.

use eframe::egui::{self, Ui};
use experiments::judge;

use super::{COMMAND, choose};
use crate::model::compare::{Mode, Other, label};
use crate::model::picture::{Second, Shown};
use crate::model::state::Model;

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    ui.label("A is what the panels edit. A is compared with B.");
    egui::Grid::new("compare").num_columns(2).show(ui, |ui| {
        let all = Mode::ALL.into_iter().map(|m| (m, m.name().to_owned(), m.about())).collect();
        let shown = model.compare.mode.name();
        choose(ui, "Show", &mut model.compare.mode, shown, all);
        ui.end_row();
        let mut others = vec![
            (
                Other::Exact,
                Other::Exact.name().to_owned(),
                "The exact blend with the settings of A: the mean of `fc5` over all its random choices. It has no noise.",
            ),
            (
                Other::Full,
                Other::Full.name().to_owned(),
                "The reference blend: full splat with two tilings on every pixel. Cheaper shading is judged by it.",
            ),
        ];
        if let Other::Kept(kept) = &model.compare.other {
            others.push((Other::Kept(kept.clone()), model.compare.other.name().to_owned(), ""));
        }
        let shown = model.compare.other.name();
        choose(ui, "B is", &mut model.compare.other, shown, others);
        ui.end_row();
    });
    ui.horizontal_wrapped(|ui| {
        if ui.button("Keep A as B").on_hover_text("Stores the settings of A as B. Then change A to see the effect.").clicked() {
            model.compare.keep(&model.settings);
        }
        let drawn = model.compare.mode != Mode::Off;
        let why = "B is not drawn. Choose first in `Show` how to compare A with B.";
        let swap = ui
            .add_enabled(drawn, egui::Button::new("Swap A and B"))
            .on_hover_text("Exchanges A and B, so that the panels edit the former B");
        if swap.on_disabled_hover_text(why).clicked() {
            model.compare.swap(&mut model.settings);
            model.keep_viewpoint();
        }
        let hint = "Shows A and B one at a time, and switches to the other one. Key: X.";
        let other = ui.add_enabled(drawn, egui::Button::new("Other picture")).on_hover_text(hint);
        if other.on_disabled_hover_text(why).clicked() {
            flick(model);
        }
    });
    ui.separator();
    ui.horizontal_wrapped(|ui| {
        let label = ui.label("Zoom");
        ui.add(egui::Slider::new(&mut model.looking.zoom, 1.0..=64.0).logarithmic(true).suffix(" x")).labelled_by(label.id).on_hover_text(
            format!("Magnification of the picture, 1 to 64. To change it, hold {COMMAND} and turn the wheel over the picture."),
        );
        if ui.button("Fit").clicked() {
            (model.looking.zoom, model.looking.centre) = (1.0, [0.5; 2]);
        }
        ui.checkbox(&mut model.looking.loupe, "Loupe")
            .on_hover_text("Shows the place under the pointer 8 times larger, in A and, if B is drawn, in B. Key: L.");
    });
    if model.compare.mode == Mode::Wipe {
        let label = ui.label("Wipe at");
        ui.add(egui::Slider::new(&mut model.looking.wipe, 0.0..=1.0)).labelled_by(label.id);
    }
    if let Some(shown) = model.shown().cloned() {
        numbers(&shown, ui);
    }
}

/// In the mode that shows one picture at a time, switches to the other picture. In any other mode, changes to that mode and shows B.
pub(crate) fn flick(model: &mut Model) {
    if model.compare.mode == Mode::Flicker {
        model.looking.b ^= true;
    } else {
        model.compare.mode = Mode::Flicker;
        model.looking.b = true;
    }
}

/// Shows how much the two pictures differ.
fn numbers(shown: &Shown, ui: &mut Ui) {
    if let Some(alone) = &shown.alone {
        ui.colored_label(ui.visuals().warn_fg_color, alone);
    }
    let Some(second) = &shown.second else { return };
    let Second { rmse, mean, largest, .. } = second;
    ui.separator();
    ui.label(format!("A: {}", label(&shown.wish.settings, &second.settings)));
    ui.label(format!("B: {}", label(&second.settings, &shown.wish.settings)));
    let psnr = judge::psnr_db(rmse * rmse);
    egui::Grid::new("difference").num_columns(2).striped(true).show(ui, |ui| {
        let mut row = |name: &str, value: String, about: &str| {
            ui.label(name).on_hover_text(about);
            ui.label(value);
            ui.end_row();
        };
        row("RMSE", format!("{rmse:.5}"), "Root mean squared difference in lit linear colour, over the pixels of A that show terrain");
        row(
            "PSNR",
            if psnr.is_finite() { format!("{psnr:.2} dB") } else { "equal".to_owned() },
            "Peak signal-to-noise ratio: the ratio of the peak value 1 to the RMSE, in decibels",
        );
        row("Mean A - B", format!("{mean:+.5}"), "Mean difference in lit linear luminance, over the pixels of A that show terrain");
        row(
            "Largest |A - B|",
            format!("{largest:.4}"),
            "Largest absolute difference in lit linear luminance, over the pixels of A that show terrain",
        );
    });
    ui.label("These numbers compare the lit pictures of this frame, with one sample per pixel. Experiments compare with a supersampled reference.");
}

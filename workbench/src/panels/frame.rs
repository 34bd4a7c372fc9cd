//! The panel *Frame*: size, shading and times of the frame, and times to draw the window.

use std::collections::VecDeque;
use std::time::Duration;

use eframe::egui::{self, Color32, Sense, Ui, vec2};
use kernels::gpu::PassTime;

use super::variants::PASS;
use crate::model::state::Model;

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let Some(shown) = model.shown().cloned() else {
        ui.label("No picture yet.");
        return;
    };
    let report = &shown.picture.report;
    times(model, ui);
    let row = |ui: &mut Ui, name: &str, about: &str, value: String| {
        let label = ui.label(name);
        if !about.is_empty() {
            label.on_hover_text(about);
        }
        ui.label(value);
        ui.end_row();
    };
    egui::Grid::new("frame").num_columns(2).striped(true).show(ui, |ui| {
        row(ui, "Picture", "Size of the picture in pixels", format!("{} x {} px", shown.wish.size[0], shown.wish.size[1]));
        row(
            ui,
            "Shaded by",
            "`auto`: each tile is shaded by the variant that its pixels need. The name of a variant: this variant shades all tiles. `generic`: \
             the generic kernel is used.",
            shown.wish.settings.choice_name(),
        );
        let fetches = shown.picture.fetches_per_px.map_or_else(|| "not counted".to_owned(), |n| format!("{n:.2} a pixel"));
        row(ui, "Fetches", "Number of texture fetches of the shading pass per pixel, averaged over the pixels that show terrain", fetches);
        row(
            ui,
            "Drawn and read back",
            "Wall-clock time from the start of drawing until the pictures can be shown. It includes the loading of terrain nodes, and also B, the \
             inspected pixel and the live metrics, if there are any.",
            format!("{:.1} ms", shown.took.as_secs_f64() * 1e3),
        );
        row(
            ui,
            "Selection and culling",
            "Time in which the CPU selects and loads terrain nodes and culls patches",
            format!("{:.1} ms", report.selection_ms),
        );
        let device: f64 = report.passes.iter().map(|p| p.time_ms).sum();
        row(
            ui,
            "Passes, device time",
            "Sum of the times of the passes below, as measured by the device; without B. 0 if the device does not measure times.",
            format!("{device:.1} ms"),
        );
        for (name, ms) in passes(&report.passes) {
            row(ui, &name, "", format!("{ms:.2} ms"));
        }
    });
}

/// The passes with their times in milliseconds. If each variant was shaded in a separate pass, these passes are listed below their sum.
fn passes(passes: &[PassTime]) -> Vec<(String, f64)> {
    let mut rows: Vec<(String, f64)> = Vec::new();
    let mut sum = None;
    for PassTime { name, time_ms } in passes {
        let Some(variant) = name.strip_prefix(PASS) else {
            rows.push((format!("    {name}"), *time_ms));
            continue;
        };
        let at = *sum.get_or_insert_with(|| {
            rows.push(("    shading, variant by variant".to_owned(), 0.0));
            rows.len() - 1
        });
        rows[at].1 += time_ms;
        rows.push((format!("        {variant}"), *time_ms));
    }
    rows
}

/// Median and longest of the times, milliseconds; `None` = there are no times.
fn median_and_longest(times: &VecDeque<Duration>) -> Option<[f64; 2]> {
    let mut sorted: Vec<f64> = times.iter().map(|t| t.as_secs_f64() * 1e3).collect();
    sorted.sort_by(f64::total_cmp);
    Some([*sorted.get(sorted.len() / 2)?, *sorted.last()?])
}

/// The times from picture to picture, in words and as a bar chart, and the times to draw the window, in words.
fn times(model: &Model, ui: &mut Ui) {
    let Some([median, worst]) = median_and_longest(&model.times) else { return };
    ui.label(format!(
        "{:.1} pictures a second; median {median:.0} ms, longest {worst:.0} ms of the last {}",
        1e3 / median,
        model.times.len()
    ));
    if let Some([median, worst]) = median_and_longest(&model.answers) {
        let hint = "Time to draw the window itself, without the terrain pictures. The answer to a click waits for such a drawing.";
        ui.label(format!("Window: median {median:.0} ms, longest {worst:.0} ms of the last {}", model.answers.len())).on_hover_text(hint);
    }
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 48.0), Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Frame times"));
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let top = (median * 3.0).max(1e-3);
    let width = rect.width() / model.times.len() as f32;
    for (i, time) in model.times.iter().enumerate() {
        let ms = time.as_secs_f64() * 1e3;
        let height = ((ms / top).min(1.0) as f32) * rect.height();
        let left = rect.left() + i as f32 * width;
        let bar =
            egui::Rect::from_min_max(egui::pos2(left, rect.bottom() - height), egui::pos2(left + (width - 1.0).max(0.5), rect.bottom()));
        painter.rect_filled(bar, 0.0, if ms > 2.0 * median { Color32::from_rgb(213, 94, 0) } else { Color32::from_rgb(86, 180, 233) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_and_the_longest_of_times() {
        let times = |ms: &[u64]| ms.iter().map(|&ms| Duration::from_millis(ms)).collect::<VecDeque<_>>();
        assert_eq!(median_and_longest(&times(&[])), None);
        assert_eq!(median_and_longest(&times(&[30, 10, 200, 20, 15])), Some([20.0, 200.0]));
    }

    #[test]
    fn passes_by_variant_stand_below_their_sum() {
        let pass = |(name, time_ms): (&str, f64)| PassTime { name: name.to_owned(), time_ms };
        let one = [("geometry", 1.0), ("shading", 2.0), ("lighting", 0.5)].map(pass);
        let names = |passes: &[PassTime]| super::passes(passes).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert_eq!(names(&one), ["    geometry", "    shading", "    lighting"]);
        let many = [("geometry", 1.0), ("shading: vt", 2.0), ("shading: vt+splat", 0.25), ("lighting", 0.5)].map(pass);
        assert_eq!(
            super::passes(&many).iter().map(|(name, ms)| (name.trim(), *ms)).collect::<Vec<_>>(),
            [("geometry", 1.0), ("shading, variant by variant", 2.25), ("vt", 2.0), ("vt+splat", 0.25), ("lighting", 0.5)]
        );
        assert_eq!(names(&many)[2], "        vt");
    }
}

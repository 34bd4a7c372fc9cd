//! The panel *Frame*: size, shading and times of the frame, and times to draw the window.

use std::collections::VecDeque;
use std::time::Duration;

use eframe::egui::{self, Color32, Sense, Ui, vec2};
use kernels::base::section::mebibytes;

use super::variants::PASS;
use crate::model::state::Model;
use crate::model::times::Spread;

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
            "Memory",
            "Main memory that the program occupies, and memory that is allocated on the device for buffers and textures. On a software adapter, the \
             second is part of the first.",
            memory(memory_stats::memory_stats().map(|stats| stats.physical_mem as u64), shown.device_bytes),
        );
        let drawing = match (model.times.drawing(), model.times.first()) {
            (Some(spread), _) => in_words(spread, 1),
            (None, Some(first)) => format!("{:.0} ms for the first picture after a change", first.as_secs_f64() * 1e3),
            (None, None) => "no times yet".to_owned(),
        };
        row(
            ui,
            "Drawn and read back",
            "Wall-clock time from the start of drawing until the pictures can be shown. It includes the loading of terrain nodes, and also B, the \
             inspected pixel and the live metrics, if there are any. The first picture after a change is not counted with the others, because it \
             may wait for shaders to be compiled. n: number of pictures.",
            drawing,
        );
        row(
            ui,
            "Selection and culling",
            "Time in which the CPU selects and loads terrain nodes and culls patches, for the last picture",
            format!("{:.1} ms", report.selection_ms),
        );
        if report.passes.is_empty() {
            row(ui, "Passes, device time", "This device does not measure the times of passes", "not measured".to_owned());
            return;
        }
        let mut times: Vec<(&str, f64, String)> =
            model.times.passes().map(|(name, spread)| (name, spread.median, in_words(spread, 2))).collect();
        if times.is_empty() {
            times = report.passes.iter().map(|pass| (pass.name.as_str(), pass.time_ms, format!("{:.2} ms (first picture)", pass.time_ms))).collect();
        }
        let sum: f64 = times.iter().map(|(_, median, _)| median).sum();
        row(
            ui,
            "Passes, device time",
            "Sum of the medians of the passes below, as measured by the device; without B. Beside each median: first and third quartile, and the \
             number n of pictures. While there is only the first picture after a change, its times are shown.",
            format!("{sum:.1} ms"),
        );
        for (name, time) in passes(&times) {
            row(ui, &name, "", time);
        }
    });
}

/// The memory of the program and that on the device, bytes, in words; `None` = not known.
fn memory(program: Option<u64>, device: Option<u64>) -> String {
    let known = |bytes: Option<u64>| bytes.map_or_else(|| "not known".to_owned(), mebibytes);
    format!("{}; on the device: {}", known(program), known(device))
}

/// Median, quartiles and number of times.
fn in_words(spread: Spread, decimals: usize) -> String {
    let Spread { median, quartiles: [first, third], count, .. } = spread;
    format!("{median:.decimals$} ms ({first:.decimals$} to {third:.decimals$}, n = {count})")
}

/// The names of passes, and their times in words. `times`: name, milliseconds, and words. If each variant was shaded in a separate pass, these passes
/// are listed below their sum.
fn passes(times: &[(&str, f64, String)]) -> Vec<(String, String)> {
    let of_variant = |name: &str| name.strip_prefix(PASS).map(str::to_owned);
    let sum: f64 = times.iter().filter(|(name, ..)| of_variant(name).is_some()).map(|(_, ms, _)| ms).sum();
    let mut rows = Vec::new();
    let mut has_sum = false;
    for (name, _, words) in times {
        match of_variant(name) {
            None => rows.push((format!("    {name}"), words.clone())),
            Some(variant) => {
                if !std::mem::replace(&mut has_sum, true) {
                    rows.push(("    shading, variant by variant".to_owned(), format!("{sum:.2} ms")));
                }
                rows.push((format!("        {variant}"), words.clone()));
            }
        }
    }
    rows
}

/// The rate of pictures and the times from picture to picture, in words and as a bar chart, and the times to draw the window, in words.
fn times(model: &Model, ui: &mut Ui) {
    let milliseconds = |time: &Duration| time.as_secs_f64() * 1e3;
    let intervals = model.times.intervals();
    if let (Some(rate), Some(spread)) = (model.times.rate(), Spread::of(intervals.iter().copied())) {
        let hint = "The rate is that of the last two seconds in which time ran. The other numbers are times from picture to picture. Pauses, and the \
                    first picture after a change, do not count.";
        let Spread { median, longest, count, .. } = spread;
        ui.label(format!("{rate:.1} pictures a second; median {median:.0} ms, longest {longest:.0} ms of the last {count}"))
            .on_hover_text(hint);
        bars(ui, intervals, median);
    }
    if let Some(Spread { median, longest, count, .. }) = Spread::of(model.answers.iter().map(milliseconds)) {
        let hint = "Time to draw the window itself, without the terrain pictures. The effect of a click is visible after such a drawing.";
        ui.label(format!("Window: median {median:.0} ms, longest {longest:.0} ms of the last {count}")).on_hover_text(hint);
    }
}

/// A bar chart of times, milliseconds. Times above twice the median have another colour.
fn bars(ui: &mut Ui, times: &VecDeque<f64>, median: f64) {
    let (rect, response) = ui.allocate_exact_size(vec2(ui.available_width(), 48.0), Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Frame times"));
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
    let top = (median * 3.0).max(1e-3);
    let width = rect.width() / times.len() as f32;
    for (i, ms) in times.iter().enumerate() {
        let height = ((ms / top).min(1.0) as f32) * rect.height();
        let left = rect.left() + i as f32 * width;
        let bar =
            egui::Rect::from_min_max(egui::pos2(left, rect.bottom() - height), egui::pos2(left + (width - 1.0).max(0.5), rect.bottom()));
        painter.rect_filled(bar, 0.0, if *ms > 2.0 * median { Color32::from_rgb(213, 94, 0) } else { Color32::from_rgb(86, 180, 233) });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passes_by_variant_stand_below_their_sum() {
        let times = |passes: &[(&'static str, f64)]| -> Vec<(&'static str, f64, String)> {
            passes.iter().map(|(name, ms)| (*name, *ms, in_words(Spread::of([*ms, *ms]).expect("times"), 2))).collect()
        };
        let names = |passes: &[(&'static str, f64)]| super::passes(&times(passes)).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
        assert_eq!(names(&[("geometry", 1.0), ("shading", 2.0), ("lighting", 0.5)]), ["    geometry", "    shading", "    lighting"]);
        let rows = super::passes(&times(&[("geometry", 1.0), ("shading: vt", 2.0), ("shading: vt+splat", 0.25), ("lighting", 0.5)]));
        let rows: Vec<(&str, &str)> = rows.iter().map(|(name, time)| (name.as_str(), time.as_str())).collect();
        assert_eq!(
            rows,
            [
                ("    geometry", "1.00 ms (1.00 to 1.00, n = 2)"),
                ("    shading, variant by variant", "2.25 ms"),
                ("        vt", "2.00 ms (2.00 to 2.00, n = 2)"),
                ("        vt+splat", "0.25 ms (0.25 to 0.25, n = 2)"),
                ("    lighting", "0.50 ms (0.50 to 0.50, n = 2)"),
            ]
        );
    }
}

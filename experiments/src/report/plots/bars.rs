//! Draws times of passes as stacked bars.

use std::collections::BTreeMap;

use anyhow::Result;
use plotters::element::{Rectangle, Text};
use plotters::prelude::{ChartBuilder, Color, IntoDrawingArea, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{GREY, GRID, INK, Rgb, WIDTH, failed, inline, rgb, text};
use crate::report::html;
use crate::report::numbers::number;

/// Fill colours of the parts of a bar, in order. They are repeated if there are more parts. They are distinguishable for colour-blind readers (Okabe
/// and Ito 2008, *Color Universal Design*).
const BAR_COLOURS: [Rgb; 6] = [(86, 180, 233), (0, 158, 115), (240, 228, 66), (213, 94, 0), (0, 114, 178), (204, 121, 167)];

/// Passes of a frame in the order in which bars show them. Other timed passes come after these.
const PASSES: [&str; 6] = ["geometry", "occlusion", "classification", "page requests", "shading", "lighting"];

/// Draws the times of passes as a figure with a legend. Each row has a name and the milliseconds of its passes.
///
/// # Errors
/// The drawing backend fails.
pub(crate) fn passes(rows: &[(String, BTreeMap<String, f64>)], software: bool) -> Result<String> {
    let mut names: Vec<&str> = PASSES.into_iter().filter(|p| rows.iter().any(|(_, times)| times.contains_key(*p))).collect();
    for pass in rows.iter().flat_map(|(_, times)| times.keys()) {
        if !names.contains(&pass.as_str()) {
            names.push(pass);
        }
    }
    let of = |times: &BTreeMap<String, f64>| names.iter().map(|p| times.get(*p).copied().unwrap_or(0.0)).collect();
    let rows: Vec<(String, Vec<f64>)> = rows.iter().map(|(name, times)| (name.clone(), of(times))).collect();
    let unit = if software { "ms, software adapter: only ratios are meaningful" } else { "ms" };
    let svg = bars(&rows, "GPU time of each pass", &format!("GPU time per frame ({unit})"))?;
    let legend: String = names.iter().enumerate().map(|(index, name)| html::key(BAR_COLOURS[index % BAR_COLOURS.len()], name)).collect();
    Ok(html::figure(svg, &legend))
}

/// Draws a stacked bar for each name. The parts of a bar are the times of the passes, in order and with the colours of [`BAR_COLOURS`]. Returns
/// `None` if no time is above 0.
///
/// # Errors
/// The drawing backend fails.
fn bars(bars: &[(String, Vec<f64>)], title: &str, x_title: &str) -> Result<Option<String>> {
    let total = |parts: &[f64]| parts.iter().filter(|v| v.is_finite()).sum::<f64>();
    let longest = bars.iter().map(|(_, parts)| total(parts)).fold(0.0, f64::max);
    if longest <= 0.0 {
        return Ok(None);
    }
    let count = bars.len() as f64;
    let longest_name = bars.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let names_px = u32::try_from(longest_name * 8 + 16).unwrap_or(u32::MAX).clamp(76, 300);
    let mut svg = String::new();
    {
        let height = 70 + 46 * u32::try_from(bars.len()).unwrap_or(u32::MAX);
        let root = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
        let mut chart = ChartBuilder::on(&root)
            .margin_top(6)
            .margin_right(16)
            .x_label_area_size(52)
            .y_label_area_size(names_px)
            .build_cartesian_2d(0.0..longest * 1.12, 0.0..count)
            .map_err(failed)?;
        chart
            .configure_mesh()
            .disable_y_mesh()
            .y_labels(0)
            .bold_line_style(GRID)
            .light_line_style(GRID.mix(0.0))
            .axis_style(GREY)
            .label_style(text(12.0, INK))
            .axis_desc_style(text(13.0, INK))
            .x_label_formatter(&|v| number(*v))
            .x_desc(x_title)
            .draw()
            .map_err(failed)?;
        for (index, (name, parts)) in (0u32..).zip(bars) {
            let y = count - f64::from(index);
            let mut from = 0.0;
            for (pass, &ms) in parts.iter().enumerate().filter(|(_, ms)| ms.is_finite()) {
                let colour = rgb(BAR_COLOURS[pass % BAR_COLOURS.len()]);
                let corners = [(from, y - 0.18), (from + ms, y - 0.82)];
                chart.draw_series([Rectangle::new(corners, colour.filled())]).map_err(failed)?;
                from += ms;
            }
            let middle = |x: f64| chart.backend_coord(&(x, y - 0.5));
            let beside = |x: f64, dx: i32, anchor: HPos, words: String| {
                let (px, py) = middle(x);
                root.draw(&Text::new(words, (px + dx, py), text(13.0, INK).pos(Pos::new(anchor, VPos::Center)))).map_err(failed)
            };
            beside(0.0, -10, HPos::Right, name.clone())?;
            beside(from, 8, HPos::Left, format!("{} ms", number(from)))?;
        }
        root.present().map_err(failed)?;
    }
    Ok(Some(inline(&svg, title, "")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_without_length_are_left_out() {
        assert!(bars(&[("auto".to_owned(), vec![0.0])], "t", "x").expect("drawn").is_none());
        assert!(bars(&[("auto".to_owned(), vec![0.0, 2.0])], "t", "x").expect("drawn").is_some_and(|svg| svg.contains("2 ms")));
    }
}

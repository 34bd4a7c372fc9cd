//! The plots of a report, as SVG that is embedded in an HTML page.
//!
//! On a logarithmic axis, positions are log10 of the values, and the labels of ticks show the values.

mod bars;
mod labels;
mod lines;
mod pareto;

use std::fmt::Write as _;
use std::ops::Range;

use anyhow::{Result, anyhow};
use plotters::chart::ChartContext;
use plotters::coord::Shift;
use plotters::coord::ranged1d::{DefaultFormatting, KeyPointHint, Ranged};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::{Cartesian2d, ChartBuilder, Color, DrawingArea, IntoFont, RGBColor, SVGBackend, TextStyle};

pub(super) use bars::passes;
pub(super) use lines::{Curve, CurvePoint, Lines, lines};
pub(super) use pareto::{LEGEND as PARETO_LEGEND, Marker, Point, pareto};

use super::html::escape;
use super::numbers::number;

/// Width of a plot that fills the page, in SVG user units. One unit is a CSS pixel if the page is shown at full width.
const WIDTH: u32 = 1080;
/// Width of each of two plots that are side by side.
const HALF_WIDTH: u32 = 528;
/// plotters divides a given font size by this factor to obtain the `font-size` of the SVG. `text` multiplies by it to cancel the division.
const LINE_HEIGHT: f64 = 1.24;

const INK: RGBColor = RGBColor(31, 41, 51);
const GREY: RGBColor = RGBColor(150, 160, 172);
const GRID: RGBColor = RGBColor(230, 234, 239);

/// A colour as plain red, green and blue, for plots and for the HTML page.
pub(super) type Rgb = (u8, u8, u8);

/// Colours for values without an order. Six of them belong to a scheme whose colours are distinguishable for colour-blind readers (Tol 2021, *Colour
/// Schemes*, "muted"). The orange and the light blue are additions.
pub(super) const COLOURS: [Rgb; 8] =
    [(51, 34, 136), (204, 102, 119), (17, 119, 51), (230, 140, 30), (68, 170, 153), (170, 68, 153), (110, 170, 220), (153, 153, 51)];

/// Returns the colour of item `index` of `count` items. For ordered items, colours range from dark purple through blue and green to yellow. For other
/// items, the colour is one of [`COLOURS`].
pub(super) fn colour(index: usize, count: usize, ordered: bool) -> Rgb {
    if !ordered {
        return COLOURS[index % COLOURS.len()];
    }
    const STOPS: [[f64; 3]; 4] = [[68.0, 1.0, 84.0], [49.0, 104.0, 142.0], [53.0, 160.0, 110.0], [190.0, 190.0, 30.0]];
    let along = if count > 1 { index.min(count - 1) as f64 / (count - 1) as f64 } else { 0.0 } * 3.0;
    let stop = (along as usize).min(2);
    let mixed: [u8; 3] =
        std::array::from_fn(|k| (STOPS[stop][k] + (STOPS[stop + 1][k] - STOPS[stop][k]) * (along - stop as f64)).round() as u8);
    (mixed[0], mixed[1], mixed[2])
}

fn rgb((r, g, b): Rgb) -> RGBColor {
    RGBColor(r, g, b)
}

/// The tooltip of a mark, and the table row that contains its numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Hint {
    /// Text that names the choice and its values.
    pub(super) words: String,
    /// Anchor of the row in the page's table.
    pub(super) anchor: String,
    /// The plotted values x and y, not rounded.
    pub(super) values: [f64; 2],
}

/// The range of an axis. On a logarithmic axis, `from`, `to` and `ticks` are log10 of the values.
#[derive(Clone, Debug)]
struct Scale {
    logarithmic: bool,
    from: f64,
    to: f64,
    ticks: Vec<f64>,
    /// Names for the positions 0, 1, 2, ... Empty if the labels are numbers.
    names: Vec<String>,
}

impl Scale {
    /// Returns a scale between two finite values. For a logarithmic scale, both values must be above 0.
    fn new(from: f64, to: f64, logarithmic: bool) -> Scale {
        if logarithmic {
            let powers = ticks(from, to);
            // If the range is less than a decade, there may be too few of these ticks to read values.
            let values = if powers.len() < 3 { even_ticks(from, to, 5) } else { powers };
            let ticks = values.into_iter().map(f64::log10).collect();
            return Scale { logarithmic, from: from.log10(), to: to.log10(), ticks, names: Vec::new() };
        }
        Scale { logarithmic, from, to, ticks: even_ticks(from, to, 7), names: Vec::new() }
    }

    fn at(&self, value: f64) -> f64 {
        (if self.logarithmic { value.log10() } else { value }).clamp(self.from, self.to)
    }

    fn label(&self, drawn: f64) -> String {
        if !self.names.is_empty() {
            return self.names.get(drawn.round().max(0.0) as usize).cloned().unwrap_or_default();
        }
        number(if self.logarithmic { 10f64.powf(drawn) } else { drawn })
    }
}

/// Makes a scale usable as an axis of plotters. The axis is linear in the positions of the scale and has the ticks of the scale.
impl Ranged for Scale {
    type FormatOption = DefaultFormatting;
    type ValueType = f64;

    fn map(&self, drawn: &f64, limit: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.from..self.to).map(drawn, limit)
    }

    fn key_points<H: KeyPointHint>(&self, hint: H) -> Vec<f64> {
        if hint.weight().allow_light_points() { Vec::new() } else { self.ticks.clone() }
    }

    fn range(&self) -> Range<f64> {
        self.from..self.to
    }
}

type Chart<'a, 'svg> = ChartContext<'a, SVGBackend<'svg>, Cartesian2d<Scale, Scale>>;

/// Draws axes, grid and titles. Returns the chart, which converts positions to pixels.
fn axes<'a, 'svg>(root: &'a DrawingArea<SVGBackend<'svg>, Shift>, x: &Scale, y: &Scale, titles: [&str; 2]) -> Result<Chart<'a, 'svg>> {
    let mut chart = ChartBuilder::on(root)
        .margin_top(12)
        .margin_right(16)
        .x_label_area_size(52)
        .y_label_area_size(76)
        .build_cartesian_2d(x.clone(), y.clone())
        .map_err(failed)?;
    chart
        .configure_mesh()
        .bold_line_style(GRID)
        .light_line_style(GRID.mix(0.0))
        .axis_style(GREY)
        .label_style(text(12.0, INK))
        .axis_desc_style(text(13.0, INK))
        .x_label_formatter(&|v| x.label(*v))
        .y_label_formatter(&|v| y.label(*v))
        .x_desc(titles[0])
        .y_desc(titles[1])
        .draw()
        .map_err(failed)?;
    Ok(chart)
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("a plot could not be drawn: {error}")
}

fn text(px: f64, colour: RGBColor) -> TextStyle<'static> {
    let mut style = TextStyle::from(("sans-serif", px * LINE_HEIGHT).into_font());
    style.color = colour.to_backend_color();
    style
}

/// Returns the ticks of a logarithmic axis within the range: 1, 2 and 5 times powers of ten, or only powers of ten if the range spans more than four
/// decades.
fn ticks(from: f64, to: f64) -> Vec<f64> {
    let steps: &[f64] = if (to / from).log10() > 4.0 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let decades = from.log10().floor() as i32..=to.log10().floor() as i32;
    decades.flat_map(|d| steps.iter().map(move |k| k * 10f64.powi(d))).filter(|t| (from..=to).contains(t)).collect()
}

/// Returns evenly spaced ticks within the range, usually about `count`. Their distance is 1, 2 or 5 times a power of ten. If the range is empty, the
/// only tick is `from`.
fn even_ticks(from: f64, to: f64, count: u32) -> Vec<f64> {
    let rough = (to - from) / f64::from(count.max(1));
    if !(rough > 0.0 && rough.is_finite()) {
        return vec![from];
    }
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|k| k * power).find(|s| *s >= rough * 0.999).unwrap_or(10.0 * power);
    let first = (from / step).ceil() as i64;
    // Each tick is computed as a multiple of the step. Sums of steps would accumulate rounding errors and miss 0.
    (first..).map(|i| i as f64 * step).take_while(|t| *t <= to + step * 1e-6).collect()
}

/// Returns invisible circles that are drawn over the marks of a plot. Each has a tooltip and a link to the table row of its mark, because plotters
/// can draw neither.
fn overlay(marks: impl Iterator<Item = ((i32, i32), i32, Hint)>) -> String {
    let mut svg = String::new();
    for ((x, y), radius, hint) in marks {
        let [vx, vy] = hint.values;
        let _ = writeln!(
            svg,
            "<a href=\"#{}\"><circle class=\"hit\" cx=\"{x}\" cy=\"{y}\" r=\"{}\" data-x=\"{vx:e}\" data-y=\"{vy:e}\"><title>{}</title></circle></a>",
            escape(&hint.anchor),
            radius + 2,
            escape(&hint.words)
        );
    }
    svg
}

/// Prepares the SVG for the page: removes its fixed size, adds a name for screen readers, and appends `over`, the result of [`overlay`].
fn inline(svg: &str, title: &str, over: &str) -> String {
    let named = format!("<svg role=\"img\" aria-label=\"{}\"", escape(title));
    let start = svg.find(" viewBox").map_or(svg, |at| &svg[at..]);
    let body = start.trim_end().strip_suffix("</svg>").unwrap_or(start);
    format!("{named}{body}{over}</svg>\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_read_well() {
        assert_eq!(ticks(1.5, 60.0), [2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(ticks(0.03, 0.3).len(), 3);
        assert_eq!(ticks(0.9e-6, 2.0).len(), 7);
        assert_eq!(even_ticks(-0.1, 0.4, 5), [-0.1, 0.0, 0.1, 0.2, 0.30000000000000004, 0.4]);
        assert_eq!(even_ticks(0.0, 1.0, 7).len(), 6);
        assert_eq!(even_ticks(2.0, 2.0, 7), [2.0]);
        assert_eq!(Scale::new(0.0, 1.0, false).label(0.25), "0.25");
        assert_eq!(Scale::new(0.1, 10.0, true).label(0.0), "1");
        assert_eq!(Scale::new(9.6, 25.0, true).ticks, [10f64, 15.0, 20.0, 25.0].map(f64::log10));
    }

    #[test]
    fn colours_differ() {
        for ordered in [false, true] {
            let all: Vec<Rgb> = (0..8).map(|i| colour(i, 8, ordered)).collect();
            let nearest = |a: &Rgb, b: &Rgb| a.0.abs_diff(b.0).max(a.1.abs_diff(b.1)).max(a.2.abs_diff(b.2));
            assert!(all.iter().enumerate().all(|(i, a)| all[..i].iter().all(|b| nearest(a, b) > 20)), "{all:?}");
        }
        assert_eq!(colour(0, 1, true), (68, 1, 84));
    }
}

//! Draws curves with confidence bands over a parameter, a lag or a frequency.

use anyhow::Result;
use plotters::element::{Circle, PathElement, Polygon};
use plotters::prelude::{Color, IntoDrawingArea, LineSeries, SVGBackend};

use super::{GREY, HALF_WIDTH, Hint, Rgb, Scale, axes, even_ticks, failed, inline, overlay, rgb};

/// A point of a curve.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CurvePoint {
    /// Position on the horizontal axis.
    pub(crate) x: f64,
    /// Position on the vertical axis.
    pub(crate) y: f64,
    /// Half-width of the confidence interval of `y`; 0 = unknown, or the value is exact.
    pub(crate) half: f64,
    /// Tooltip of the point, and a link to the table row of its choice.
    pub(crate) hint: Option<Hint>,
}

/// A curve. If it has only one point, only this point and its confidence interval are drawn.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Curve {
    /// Colour of the curve.
    pub(crate) colour: Rgb,
    /// Points of the curve, by increasing x.
    pub(crate) points: Vec<CurvePoint>,
}

/// A plot of curves that takes half the width of the page.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines<'a> {
    /// Description of the plot for screen readers.
    pub(crate) title: &'a str,
    /// Title of the horizontal axis.
    pub(crate) x_title: &'a str,
    /// Title of the vertical axis.
    pub(crate) y_title: &'a str,
    /// Whether the horizontal axis is logarithmic. Points whose x is not above 0 are then omitted.
    pub(crate) x_logarithmic: bool,
    /// Whether the vertical axis is logarithmic. Points whose y is not above 0 are then omitted.
    pub(crate) y_logarithmic: bool,
    /// Names for the positions x = 0, 1, 2, ... Empty if the quantity on the horizontal axis is a number, which is then shown instead of a name.
    pub(crate) x_names: Vec<String>,
    /// Whether all x are whole numbers. Then each x gets a tick.
    pub(crate) x_whole: bool,
    /// A value that is drawn as a dashed line for comparison, and its name, which is not drawn.
    pub(crate) baseline: Option<(f64, &'a str)>,
}

/// Draws curves. Returns `None` if no point can be drawn.
///
/// # Errors
/// The drawing backend fails.
pub(crate) fn lines(curves: &[Curve], plot: &Lines<'_>) -> Result<Option<String>> {
    const HEIGHT: u32 = 300;
    let shown =
        |p: &&CurvePoint| p.x.is_finite() && p.y.is_finite() && (!plot.x_logarithmic || p.x > 0.0) && (!plot.y_logarithmic || p.y > 0.0);
    let all = || curves.iter().flat_map(|c| c.points.iter().filter(shown));
    if all().next().is_none() {
        return Ok(None);
    }
    let range = |values: &mut dyn Iterator<Item = f64>| values.fold((f64::MAX, f64::MIN), |(a, b), v| (v.min(a), v.max(b)));
    let (x_low, x_high) = range(&mut all().map(|p| p.x));
    let baseline = plot.baseline.map(|b| b.0).filter(|b| !plot.y_logarithmic || *b > 0.0);
    // A linear vertical axis also covers confidence intervals, but only within a limit, because a single very large interval would flatten the
    // curves. The axis extends beyond the values by at most their range, or by half of the largest value if that is more. A margin and a start at 0
    // can extend it further.
    let (y_low, y_high) = range(&mut all().map(|p| p.y).chain(baseline));
    let (reach_low, reach_high) = range(&mut all().flat_map(|p| [p.y - p.half, p.y + p.half]));
    let room = (y_high - y_low).max(0.5 * y_high.abs());
    let x_scale = if plot.x_logarithmic {
        Scale::new(x_low / 1.15, x_high * 1.15, true)
    } else {
        let margin = if x_high > x_low { 0.05 * (x_high - x_low) } else { 0.5 };
        let mut scale = Scale::new(x_low - margin, x_high + margin, false);
        if plot.x_whole || !plot.x_names.is_empty() {
            scale.ticks = even_ticks(x_low, x_high, (x_high - x_low) as u32);
            scale.names.clone_from(&plot.x_names);
        }
        scale
    };
    let y_scale = if plot.y_logarithmic {
        Scale::new(y_low / 1.3, y_high * 1.3, true)
    } else {
        // The axis normally starts at 0. If there are negative values, or if all values are far from 0 relative to their differences, it starts
        // slightly below the smallest value or interval that is shown.
        let low = reach_low.max(y_low - room);
        let high = reach_high.min(y_high + room).max(y_high);
        let from = if low < 0.0 || low > 0.7 * high { low - 0.08 * (high - low).max(0.02 * high.abs()) } else { 0.0 };
        let to = high + 0.08 * (high - from);
        Scale::new(from, if to > from { to } else { from + 1.0 }, false)
    };
    let place = |x: f64, y: f64| (x_scale.at(x), y_scale.at(if plot.y_logarithmic { y.max(1e-300) } else { y }));
    let mut svg = String::new();
    let over;
    {
        let root = SVGBackend::with_string(&mut svg, (HALF_WIDTH, HEIGHT)).into_drawing_area();
        let mut chart = axes(&root, &x_scale, &y_scale, [plot.x_title, plot.y_title])?;
        if let Some(value) = baseline {
            // The plot is divided into 80 steps along x. Every second step is a dash of the line.
            let (left, right) = (x_scale.from, x_scale.to);
            let along = |k: u32| left + (right - left) * f64::from(k) / 80.0;
            let dashes = (0..40).map(|k| vec![(along(2 * k), y_scale.at(value)), (along(2 * k + 1), y_scale.at(value))]);
            chart.draw_series(dashes.map(|dash| PathElement::new(dash, GREY.stroke_width(1)))).map_err(failed)?;
        }
        for curve in curves {
            let points: Vec<&CurvePoint> = curve.points.iter().filter(shown).collect();
            if points.len() > 1 && points.iter().any(|p| p.half > 0.0) {
                let upper = points.iter().map(|p| place(p.x, p.y + p.half));
                let lower = points.iter().rev().map(|p| place(p.x, p.y - p.half));
                let band: Vec<_> = upper.chain(lower).collect();
                chart.draw_series([Polygon::new(band, rgb(curve.colour).mix(0.15).filled())]).map_err(failed)?;
            } else {
                let bars = points.iter().filter(|p| p.half > 0.0).map(|p| vec![place(p.x, p.y - p.half), place(p.x, p.y + p.half)]);
                chart.draw_series(bars.map(|bar| PathElement::new(bar, rgb(curve.colour).stroke_width(1)))).map_err(failed)?;
            }
        }
        let mut marks = Vec::new();
        for curve in curves {
            let colour = rgb(curve.colour);
            let points: Vec<&CurvePoint> = curve.points.iter().filter(shown).collect();
            chart.draw_series(LineSeries::new(points.iter().map(|p| place(p.x, p.y)), colour.stroke_width(2))).map_err(failed)?;
            // If the points are dense, they are not marked, because marks would hide the curve.
            let radius = if points.len() > 24 { 0 } else { 3 };
            for point in points {
                let at = chart.backend_coord(&place(point.x, point.y));
                if radius > 0 {
                    root.draw(&Circle::new(at, radius, colour.filled())).map_err(failed)?;
                }
                marks.extend(point.hint.clone().map(|hint| (at, radius, hint)));
            }
        }
        over = overlay(marks.into_iter());
        root.present().map_err(failed)?;
    }
    Ok(Some(inline(&svg, plot.title, &over)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[(f64, f64, f64)]) -> Curve {
        let points = points.iter().map(|&(x, y, half)| CurvePoint { x, y, half, hint: None }).collect();
        Curve { colour: (1, 2, 3), points }
    }

    #[test]
    fn curves_have_bands_where_they_are_known() {
        let plot = Lines { title: "t", ..Lines::default() };
        let svg = |curves: &[Curve], plot: &Lines<'_>| lines(curves, plot).expect("drawn");
        let with = svg(&[curve(&[(1.0, 2.0, 0.5), (2.0, 3.0, 0.5)])], &plot).expect("points");
        let without = svg(&[curve(&[(1.0, 2.0, 0.0), (2.0, 3.0, 0.0)])], &plot).expect("points");
        assert!(with.contains("<polygon") && !without.contains("<polygon"));
        assert_eq!(with.matches("<circle").count(), 2);
        // Points that cannot be drawn are omitted, and a plot in which no point can be drawn is omitted as a whole.
        let lost = [(f64::NAN, 1.0, 0.0), (1.0, f64::INFINITY, 0.0)];
        assert!(svg(&[curve(&lost), curve(&[])], &plot).is_none());
        let logarithmic = Lines { y_logarithmic: true, x_logarithmic: true, ..plot };
        assert!(svg(&[curve(&[(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)])], &logarithmic).is_none());
        assert_eq!(svg(&[curve(&[(1.0, 0.1, 0.2), (10.0, 10.0, 20.0)])], &logarithmic).expect("points").matches("<circle").count(), 2);
    }

    #[test]
    fn one_point_and_named_places_can_be_drawn() {
        let names = ["exact", "a<b"].map(str::to_owned).to_vec();
        let plot = Lines { x_names: names, baseline: Some((1.0, "white")), ..Lines::default() };
        let svg = lines(&[curve(&[(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)])], &plot).expect("drawn").expect("points");
        assert!(svg.contains("exact") && svg.contains("a&lt;b"));
        assert!(lines(&[curve(&[(3.0, 0.0, 0.0)])], &Lines::default()).expect("drawn").is_some());
        assert!(lines(&[curve(&[(3.0, -2.0, 0.1)])], &Lines::default()).expect("drawn").is_some());
    }
}

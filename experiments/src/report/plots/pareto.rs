//! Draws plots of cost against error. Each choice with a known cost and error is a point, and a line connects the points of the Pareto front.

use anyhow::Result;
use plotters::element::{Circle, PathElement};
use plotters::prelude::{Color, IntoDrawingArea, LineSeries, RGBColor, SVGBackend, ShapeStyle};

use super::labels::{self, Box2, Wanted};
use super::{GREY, Hint, INK, Rgb, Scale, WIDTH, axes, failed, inline, overlay, rgb};

const FRONT: RGBColor = RGBColor(94, 113, 137);
const AUTO: RGBColor = RGBColor(200, 60, 50);
const GENERIC: RGBColor = RGBColor(29, 111, 165);

/// Legend (HTML) of the markers in [`pareto`], for plots in which every point has the colour of its marker.
pub(crate) const LEGEND: &str = "<span class=\"entry\"><span class=\"key auto\"></span>auto</span> \
    <span class=\"entry\"><span class=\"key generic\"></span>generic</span> \
    <span class=\"entry\"><span class=\"key flavour\"></span>one flavour</span> \
    <span class=\"entry\"><span class=\"key combination\"></span>several flavours</span> \
    <span class=\"entry\"><span class=\"key front\"></span>Pareto front (the table names the points without a label)</span>";

/// If a plot has more points than this, only the labels of points on the Pareto front are always shown. Other labels are shown if there is room.
const MANY: usize = 40;

/// The shape, the size and the default colour of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Marker {
    /// A large filled dot in the accent colour.
    Auto,
    /// A ring. It stays visible if another point has the same position.
    Generic,
    /// A dark dot.
    Flavour,
    /// A small grey dot.
    Combination,
}

impl Marker {
    fn radius(self) -> i32 {
        match self {
            Marker::Auto => 6,
            Marker::Generic => 9,
            Marker::Flavour => 5,
            Marker::Combination => 4,
        }
    }

    fn ink(self) -> RGBColor {
        match self {
            Marker::Auto => AUTO,
            Marker::Generic => GENERIC,
            Marker::Flavour | Marker::Combination => INK,
        }
    }

    fn style(self, colour: Option<Rgb>) -> ShapeStyle {
        let own = if self == Marker::Combination { GREY } else { self.ink() };
        let colour = colour.map_or(own, rgb);
        if self == Marker::Generic { colour.stroke_width(2) } else { colour.filled() }
    }
}

/// A choice in a plot of cost against error.
#[derive(Clone, Debug)]
pub(crate) struct Point {
    /// Name of the choice.
    pub(crate) label: String,
    /// The group of the point. Points of one group that are close together share a label.
    pub(crate) group: String,
    /// Cost. Points whose cost is not a finite number above 0 are not drawn.
    pub(crate) x: f64,
    /// Error, or added change. Points for which it is not finite are not drawn.
    pub(crate) y: f64,
    /// Half-widths of the confidence intervals of `x` and `y`; 0 = unknown, or the value is exact.
    pub(crate) half: [f64; 2],
    /// How the point is drawn.
    pub(crate) marker: Marker,
    /// Colour of the point; `None` = the colour of its marker.
    pub(crate) colour: Option<Rgb>,
    /// Whether the point is on the Pareto front. The line connects the points on the front.
    pub(crate) front: bool,
    /// Tooltip of the point, and a link to the table row of the choice.
    pub(crate) hint: Option<Hint>,
}

/// Draws cost on a logarithmic axis against error, with the Pareto front as a stepped line. Returns `None` if no point can be drawn.
///
/// # Errors
/// The drawing backend fails.
pub(crate) fn pareto(points: &[Point], title: &str, x_title: &str, y_title: &str) -> Result<Option<String>> {
    const HEIGHT: u32 = 430;
    let points: Vec<&Point> = points.iter().filter(|p| p.x > 0.0 && p.x.is_finite() && p.y.is_finite()).collect();
    let fold = |value: fn(&Point) -> f64, start: (f64, f64)| points.iter().map(|p| value(p)).fold(start, |(a, b), v| (v.min(a), v.max(b)));
    if points.is_empty() {
        return Ok(None);
    }
    let (x, y) = (fold(|p| p.x, (f64::MAX, 0.0)), fold(|p| p.y, (0.0, 0.0)));
    let x_scale = Scale::new(x.0 / 1.25, x.1 * 1.45, true);
    let y_max = if y.1 > 0.0 { y.1 * 1.08 } else { 1.0 };
    let y_scale = Scale::new(y.0 * 1.08, y_max, false);
    let place = |x: f64, y: f64| (x_scale.at(x), y_scale.at(y));
    let mut svg = String::new();
    let over;
    {
        let root = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        let mut chart = axes(&root, &x_scale, &y_scale, [x_title, y_title])?;

        let mut front: Vec<(f64, f64)> = points.iter().filter(|p| p.front).map(|p| place(p.x, p.y)).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        let line: Vec<(f64, f64)> = steps(&front, x_scale.to, y_scale.to).collect();
        chart.draw_series(LineSeries::new(line.iter().copied(), FRONT.stroke_width(2))).map_err(failed)?;
        for point in &points {
            let style = point.colour.map_or(GREY, rgb).mix(0.55).stroke_width(1);
            let [dx, dy] = point.half;
            let bars = [
                (dx > 0.0).then(|| vec![place((point.x - dx).max(x.0 / 1e3), point.y), place(point.x + dx, point.y)]),
                (dy > 0.0).then(|| vec![place(point.x, point.y - dy), place(point.x, point.y + dy)]),
            ];
            chart.draw_series(bars.into_iter().flatten().map(|bar| PathElement::new(bar, style))).map_err(failed)?;
        }

        // Small dots are drawn first, so that the more important points cover them.
        let at: Vec<(i32, i32)> = points.iter().map(|p| chart.backend_coord(&place(p.x, p.y))).collect();
        let order = [Marker::Combination, Marker::Flavour, Marker::Auto, Marker::Generic];
        let in_order = || order.into_iter().flat_map(|marker| points.iter().zip(&at).filter(move |(p, _)| p.marker == marker));
        for (point, centre) in in_order() {
            // If points with the same group, marker and position have different colours, only the colour that is drawn last would be visible. Such
            // points are drawn in the colour of their marker instead.
            let shared = points.iter().zip(&at).any(|(other, place)| {
                let near = (place.0 - centre.0).abs() <= 1 && (place.1 - centre.1).abs() <= 1;
                near && other.group == point.group && other.marker == point.marker && other.colour != point.colour
            });
            let colour = point.colour.filter(|_| !shared);
            root.draw(&Circle::new(*centre, point.marker.radius(), point.marker.style(colour))).map_err(failed)?;
        }

        let frame = chart.plotting_area().get_pixel_range();
        let line: Vec<(i32, i32)> = line.iter().map(|p| chart.backend_coord(p)).collect();
        let frame = Box2 {
            left: f64::from(frame.0.start),
            right: f64::from(frame.0.end),
            top: f64::from(frame.1.start),
            bottom: f64::from(frame.1.end),
        };
        for placed in labels::place(&wanted(&points, &at), &at, &line, frame) {
            labels::draw(&root, &placed)?;
        }
        over = overlay(in_order().filter_map(|(p, at)| Some((*at, p.marker.radius(), p.hint.clone()?))));
        root.present().map_err(failed)?;
    }
    Ok(Some(inline(&svg, title, &over)))
}

/// Returns the border of the region that is dominated by the Pareto front, from the top of the plot to its right edge.
fn steps(front: &[(f64, f64)], right: f64, top: f64) -> impl Iterator<Item = (f64, f64)> {
    let start = front.first().map(|f| (f.0, top));
    let end = front.last().map(|f| (right, f.1));
    let corners: Vec<_> = front.iter().zip(front.iter().skip(1)).map(|(a, b)| (b.0, a.1)).collect();
    let inner: Vec<_> = front.iter().zip(corners.into_iter().map(Some).chain([None])).flat_map(|(f, c)| [Some(*f), c]).flatten().collect();
    start.into_iter().chain(inner).chain(end)
}

/// Returns the labels of points, in descending order of importance. Points that are close together share a label. A combination of flavours has a
/// label only if it is on the front.
fn wanted(points: &[&Point], at: &[(i32, i32)]) -> Vec<Wanted> {
    let many = points.len() > MANY;
    let rank = |p: &Point| match p.marker {
        _ if many && p.front => Some(0),
        Marker::Auto => Some(0),
        Marker::Generic => Some(1),
        Marker::Flavour => Some(2),
        Marker::Combination => p.front.then_some(3),
    };
    let mut order: Vec<_> = points.iter().zip(at).filter_map(|(p, at)| Some((rank(p)?, *p, *at))).collect();
    order.sort_by_key(|(rank, _, _)| *rank);
    // Points of one group share a label even at larger distances, because the label then names the group. Points of different groups must be closer
    // together.
    let mut places: Vec<(Vec<&Point>, (i32, i32), u32)> = Vec::new();
    for (rank, point, at) in order {
        let near = |(others, place, _): &&mut (Vec<&Point>, (i32, i32), u32)| {
            let reach = if others.iter().all(|o| o.group == point.group) { 14 } else { 4 };
            (place.0 - at.0).abs() <= reach && (place.1 - at.1).abs() <= reach
        };
        match places.iter_mut().find(near) {
            Some((others, _, _)) => others.push(point),
            None => places.push((vec![point], at, rank)),
        }
    }
    let label = |(points, at, rank): (Vec<&Point>, (i32, i32), u32)| {
        let same_group = points.iter().all(|p| p.group == points[0].group);
        let words = match &points[..] {
            [one] => one.label.clone(),
            [one, ..] if same_group => format!("{} ({})", one.group, points.len()),
            [one, other] => format!("{}, {}", one.label, other.label),
            [one, others @ ..] => format!("{} and {} more", one.label, others.len()),
            [] => String::new(),
        };
        let radius = f64::from(points.iter().map(|p| p.marker.radius()).max().unwrap_or(0));
        let optional = if many { points.iter().all(|p| !p.front) } else { rank == 3 };
        Wanted { words, at, radius, ink: points.first().map_or(INK, |p| p.marker.ink()), optional }
    };
    places.into_iter().map(label).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(label: &str, marker: Marker, x: f64) -> Point {
        Point {
            label: label.to_owned(),
            group: label.to_owned(),
            x,
            y: 0.1,
            half: [0.0; 2],
            marker,
            colour: None,
            front: false,
            hint: None,
        }
    }

    #[test]
    fn points_in_one_place_share_a_label() {
        let points = [point("generic", Marker::Generic, 1.0), point("auto", Marker::Auto, 1.0), point("x", Marker::Combination, 1.0)];
        let points: Vec<&Point> = points.iter().collect();
        let words = |at: &[(i32, i32)]| wanted(&points, at).into_iter().map(|w| w.words).collect::<Vec<_>>();
        assert_eq!(words(&[(5, 5), (6, 5), (5, 5)]), ["auto, generic"]);
        assert_eq!(words(&[(5, 5), (60, 5), (5, 5)]), ["auto", "generic"]);
        // Three points of one group share a label at a distance at which points of different groups do not.
        let alike = |i: u32| Point { label: format!("vt \u{b7} {i}"), group: "vt".to_owned(), ..point("", Marker::Flavour, 1.0) };
        let (one, two, three) = (alike(1), alike(2), alike(3));
        let words = |all: &[&Point], at: &[(i32, i32)]| wanted(all, at).into_iter().map(|w| w.words).collect::<Vec<_>>();
        assert_eq!(words(&[&one, &two, &three], &[(5, 5), (15, 5), (9, 12)]), ["vt (3)"]);
        let other = point("splat", Marker::Flavour, 1.0);
        assert_eq!(words(&[&one, &other], &[(5, 5), (15, 5)]), ["vt \u{b7} 1", "splat"]);
    }

    #[test]
    fn points_in_one_place_have_no_colour_of_their_own() {
        let coloured = |colour: Rgb, x: f64| Point { colour: Some(colour), group: "vt".to_owned(), ..point("vt", Marker::Flavour, x) };
        let svg = |second: f64| {
            pareto(&[coloured((1, 2, 3), 2.0), coloured((200, 2, 3), second)], "t", "x", "y").expect("drawn").expect("points")
        };
        let has = |svg: &str| ["#010203", "#C80203"].map(|c| svg.contains(c));
        assert_eq!([has(&svg(9.0)), has(&svg(2.0))], [[true; 2], [false; 2]]);
    }

    #[test]
    fn of_many_points_only_the_front_must_be_named() {
        let all: Vec<Point> = (0..60)
            .map(|i| Point { front: i == 50, ..point(&format!("p{i}"), if i < 10 { Marker::Flavour } else { Marker::Combination }, 1.0) })
            .collect();
        let points: Vec<&Point> = all.iter().collect();
        let at: Vec<(i32, i32)> = (0..60).map(|i| (i * 30, 0)).collect();
        let texts = wanted(&points, &at);
        assert_eq!(texts.len(), 11);
        assert_eq!(texts.iter().filter(|w| !w.optional).map(|w| w.words.as_str()).collect::<Vec<_>>(), ["p50"]);
    }

    #[test]
    fn steps_go_right_then_down() {
        let line: Vec<_> = steps(&[(1.0, 5.0), (2.0, 3.0)], 9.0, 10.0).collect();
        assert_eq!(line, [(1.0, 10.0), (1.0, 5.0), (2.0, 5.0), (2.0, 3.0), (9.0, 3.0)]);
        assert_eq!(steps(&[], 9.0, 10.0).count(), 0);
    }

    #[test]
    fn a_plot_without_points_is_left_out() {
        let lost = Point { front: true, ..point("a", Marker::Auto, 0.0) };
        let hint = Hint { words: "row & <values>".to_owned(), anchor: "r1".to_owned(), values: [3.0, 0.1] };
        let good = Point { x: 3.0, label: "a<b".to_owned(), hint: Some(hint), half: [0.0, 0.2], ..lost.clone() };
        assert!(pareto(&[lost], "t", "x", "y").expect("drawn").is_none());
        let svg = pareto(&[good], "cost & error", "x", "y").expect("drawn").expect("a point");
        assert!(svg.contains("a&lt;b") && svg.contains("aria-label=\"cost &amp; error\"") && svg.ends_with("</svg>\n"));
        assert!(svg.contains("<title>row &amp; &lt;values&gt;</title>") && svg.contains("data-x=\"3e0\" data-y=\"1e-1\""));
        assert_eq!(svg.matches("</svg>").count(), 1);
    }
}

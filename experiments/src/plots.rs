//! The plots of a report, as SVG to be set inside an HTML page.

use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::element::{Circle, PathElement, Rectangle, Text};
use plotters::prelude::{
    ChartBuilder, Color, DrawingArea, IntoDrawingArea, IntoFont, LineSeries, RGBColor, SVGBackend, ShapeStyle, TextStyle,
};
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// Width of every plot in user units, which are CSS pixels at the page's full width.
const WIDTH: u32 = 1080;
/// plotters writes `font-size` = size / 1.24, its estimate of the line height of a font.
const LINE_HEIGHT: f64 = 1.24;
/// Mean advance of a character of a sans-serif face over its size, on the wide side: labels are placed before a browser measures them.
const ADVANCE: f64 = 0.57;
const LABEL_PX: f64 = 13.0;

const INK: RGBColor = RGBColor(31, 41, 51);
const GREY: RGBColor = RGBColor(150, 160, 172);
const GRID: RGBColor = RGBColor(230, 234, 239);
const FRONT: RGBColor = RGBColor(94, 113, 137);
const AUTO: RGBColor = RGBColor(200, 60, 50);
const GENERIC: RGBColor = RGBColor(29, 111, 165);

/// Fill colours of stacked bars, in order; told apart by the colour-blind (Okabe and Ito 2008, *Color Universal Design*).
pub(crate) const BAR_COLOURS: [(u8, u8, u8); 6] =
    [(86, 180, 233), (0, 158, 115), (240, 228, 66), (213, 94, 0), (0, 114, 178), (204, 121, 167)];

/// How a point is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Marker {
    /// Filled, in the accent colour.
    Auto,
    /// A ring, so that it shows around a point in the same place.
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

    fn style(self) -> ShapeStyle {
        match self {
            Marker::Auto => AUTO.filled(),
            Marker::Generic => GENERIC.stroke_width(2),
            Marker::Flavour => INK.filled(),
            Marker::Combination => GREY.filled(),
        }
    }

    fn ink(self) -> RGBColor {
        match self {
            Marker::Auto => AUTO,
            Marker::Generic => GENERIC,
            Marker::Flavour | Marker::Combination => INK,
        }
    }
}

/// A variant in a plot of cost against error.
#[derive(Clone, Debug)]
pub(crate) struct Point {
    /// Its name.
    pub(crate) label: String,
    /// Cost, > 0.
    pub(crate) x: f64,
    /// Error.
    pub(crate) y: f64,
    /// How it is drawn; all but combinations are labelled.
    pub(crate) marker: Marker,
    /// Whether no other point is at least as good in both: labelled, and on the line.
    pub(crate) front: bool,
}

/// A plot of cost (logarithmic) against error, with the front as a step line; `None` where no point can be drawn.
///
/// # Errors
/// When the backend fails.
pub(crate) fn pareto(points: &[Point], title: &str, x_title: &str, y_title: &str) -> Result<Option<String>> {
    const HEIGHT: u32 = 430;
    let points: Vec<&Point> = points.iter().filter(|p| p.x > 0.0 && p.x.is_finite() && p.y.is_finite()).collect();
    let fold = |value: fn(&Point) -> f64| points.iter().map(|p| value(p)).fold((f64::MAX, 0.0), |(a, b), v| (v.min(a), v.max(b)));
    let (x, y) = (fold(|p| p.x), fold(|p| p.y));
    if points.is_empty() {
        return Ok(None);
    }
    let x_range = x.0 / 1.25..x.1 * 1.45;
    let y_max = if y.1 > 0.0 { y.1 * 1.08 } else { 1.0 };
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (WIDTH, HEIGHT)).into_drawing_area();
        let mut chart = ChartBuilder::on(&root)
            .margin_top(12)
            .margin_right(16)
            .x_label_area_size(52)
            .y_label_area_size(76)
            .build_cartesian_2d(x_range.clone().log_scale().with_key_points(ticks(x_range.start, x_range.end)), 0.0..y_max)
            .map_err(failed)?;
        let decimals = if y_max < 0.02 { 4 } else { 3 };
        chart
            .configure_mesh()
            .bold_line_style(GRID)
            .light_line_style(GRID.mix(0.0))
            .axis_style(GREY)
            .label_style(text(12.0, INK))
            .axis_desc_style(text(13.0, INK))
            .x_label_formatter(&|v| number(*v))
            .y_label_formatter(&|v| format!("{v:.decimals$}"))
            .y_labels(7)
            .x_desc(x_title)
            .y_desc(y_title)
            .draw()
            .map_err(failed)?;

        let mut front: Vec<(f64, f64)> = points.iter().filter(|p| p.front).map(|p| (p.x, p.y)).collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.total_cmp(&a.1)));
        chart.draw_series(LineSeries::new(steps(&front, x_range.end, y_max), FRONT.stroke_width(2))).map_err(failed)?;

        // Small dots first, so that what is highlighted lies on top.
        let at: Vec<(i32, i32)> = points.iter().map(|p| chart.backend_coord(&(p.x, p.y))).collect();
        for marker in [Marker::Combination, Marker::Flavour, Marker::Auto, Marker::Generic] {
            for (_, centre) in points.iter().zip(&at).filter(|(p, _)| p.marker == marker) {
                root.draw(&Circle::new(*centre, marker.radius(), marker.style())).map_err(failed)?;
            }
        }

        let frame = chart.plotting_area().get_pixel_range();
        let line: Vec<(i32, i32)> = steps(&front, x_range.end, y_max).map(|p| chart.backend_coord(&p)).collect();
        let wanted = labels(&points, &at);
        let frame = Box2 {
            left: f64::from(frame.0.start),
            right: f64::from(frame.0.end),
            top: f64::from(frame.1.start),
            bottom: f64::from(frame.1.end),
        };
        for placed in place(&wanted, &at, &line, frame) {
            draw_label(&root, &placed)?;
        }
        root.present().map_err(failed)?;
    }
    Ok(Some(inline(&svg, title)))
}

/// Times of passes: a bar for each name, stacked in the order of the passes, which are coloured as in [`BAR_COLOURS`].
/// `None` without any time.
///
/// # Errors
/// When the backend fails.
pub(crate) fn bars(bars: &[(String, Vec<f64>)], title: &str, x_title: &str) -> Result<Option<String>> {
    let total = |parts: &[f64]| parts.iter().filter(|v| v.is_finite()).sum::<f64>();
    let longest = bars.iter().map(|(_, parts)| total(parts)).fold(0.0, f64::max);
    if longest <= 0.0 {
        return Ok(None);
    }
    let count = bars.len() as f64;
    let mut svg = String::new();
    {
        let height = 70 + 46 * u32::try_from(bars.len()).unwrap_or(u32::MAX);
        let root = SVGBackend::with_string(&mut svg, (WIDTH, height)).into_drawing_area();
        let mut chart = ChartBuilder::on(&root)
            .margin_top(6)
            .margin_right(16)
            .x_label_area_size(52)
            .y_label_area_size(76)
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
                let (r, g, b) = BAR_COLOURS[pass % BAR_COLOURS.len()];
                let corners = [(from, y - 0.18), (from + ms, y - 0.82)];
                chart.draw_series([Rectangle::new(corners, RGBColor(r, g, b).filled())]).map_err(failed)?;
                from += ms;
            }
            let middle = |x: f64| chart.backend_coord(&(x, y - 0.5));
            let beside = |x: f64, dx: i32, anchor: HPos, words: String| {
                let (px, py) = middle(x);
                root.draw(&Text::new(words, (px + dx, py), text(LABEL_PX, INK).pos(Pos::new(anchor, VPos::Center)))).map_err(failed)
            };
            beside(0.0, -10, HPos::Right, name.clone())?;
            beside(from, 8, HPos::Left, format!("{} ms", number(from)))?;
        }
        root.present().map_err(failed)?;
    }
    Ok(Some(inline(&svg, title)))
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("a plot could not be drawn: {error}")
}

fn text(px: f64, colour: RGBColor) -> TextStyle<'static> {
    let mut style = TextStyle::from(("sans-serif", px * LINE_HEIGHT).into_font());
    style.color = colour.to_backend_color();
    style
}

/// Three significant digits, without needless zeros.
fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return value.to_string();
    }
    let digits = (2.0 - value.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    let fixed = format!("{value:.digits$}");
    if fixed.contains('.') { fixed.trim_end_matches('0').trim_end_matches('.').to_owned() } else { fixed }
}

/// 1, 2 and 5 times powers of ten within the range.
fn ticks(from: f64, to: f64) -> Vec<f64> {
    let decades = from.log10().floor() as i32..=to.log10().floor() as i32;
    decades.flat_map(|d| [1.0, 2.0, 5.0].map(|k| k * 10f64.powi(d))).filter(|t| (from..=to).contains(t)).collect()
}

/// The border of what a front dominates, from the top of the plot to its right edge.
fn steps(front: &[(f64, f64)], right: f64, top: f64) -> impl Iterator<Item = (f64, f64)> {
    let start = front.first().map(|f| (f.0, top));
    let end = front.last().map(|f| (right, f.1));
    let corners: Vec<_> = front.iter().zip(front.iter().skip(1)).map(|(a, b)| (b.0, a.1)).collect();
    let inner: Vec<_> = front.iter().zip(corners.into_iter().map(Some).chain([None])).flat_map(|(f, c)| [Some(*f), c]).flatten().collect();
    start.into_iter().chain(inner).chain(end)
}

/// A rectangle in pixels, y downwards.
#[derive(Clone, Copy, Debug)]
struct Box2 {
    left: f64,
    right: f64,
    top: f64,
    bottom: f64,
}

impl Box2 {
    fn meets(&self, other: &Box2) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    fn around(centre: (i32, i32), radius: f64) -> Box2 {
        let (x, y) = (f64::from(centre.0), f64::from(centre.1));
        Box2 { left: x - radius, right: x + radius, top: y - radius, bottom: y + radius }
    }

    fn inside(&self, other: &Box2) -> bool {
        self.left >= other.left && self.right <= other.right && self.top >= other.top && self.bottom <= other.bottom
    }
}

/// A text that wants a place near a point.
#[derive(Clone, Debug)]
struct Wanted {
    words: String,
    at: (i32, i32),
    radius: f64,
    ink: RGBColor,
    /// Left out if it would hide anything but the line.
    optional: bool,
}

/// A text with its place.
#[derive(Clone, Debug)]
struct Placed {
    words: String,
    ink: RGBColor,
    area: Box2,
    /// From the point to the text, where they are far apart.
    leader: Option<[(i32, i32); 2]>,
}

/// The texts of a plot, the most important first; points in one place share one.
fn labels(points: &[&Point], at: &[(i32, i32)]) -> Vec<Wanted> {
    let rank = |p: &Point| match p.marker {
        Marker::Auto => Some(0),
        Marker::Generic => Some(1),
        Marker::Flavour => Some(2),
        Marker::Combination => p.front.then_some(3),
    };
    let mut order: Vec<_> = points.iter().zip(at).filter_map(|(p, at)| Some((rank(p)?, *p, *at))).collect();
    order.sort_by_key(|(rank, _, _)| *rank);
    let mut wanted: Vec<Wanted> = Vec::new();
    for (rank, point, at) in order {
        let radius = f64::from(point.marker.radius());
        match wanted.iter_mut().find(|w| (w.at.0 - at.0).abs() <= 4 && (w.at.1 - at.1).abs() <= 4) {
            Some(near) => {
                near.words = format!("{}, {}", near.words, point.label);
                near.radius = near.radius.max(radius);
            }
            None => wanted.push(Wanted { words: point.label.clone(), at, radius, ink: point.marker.ink(), optional: rank == 3 }),
        }
    }
    wanted
}

/// Gives each text, in turn, the nearest of some places around its point that hides least:
/// other texts above all, then points, then the line.
fn place(wanted: &[Wanted], points: &[(i32, i32)], line: &[(i32, i32)], frame: Box2) -> Vec<Placed> {
    const HIDES_POINT: f64 = 40.0;
    let markers: Vec<Box2> = points.iter().map(|p| Box2::around(*p, 4.0)).collect();
    let segments: Vec<Box2> = line
        .windows(2)
        .map(|w| {
            let (a, b) = (Box2::around(w[0], 1.0), Box2::around(w[1], 1.0));
            Box2 { left: a.left.min(b.left), right: a.right.max(b.right), top: a.top.min(b.top), bottom: a.bottom.max(b.bottom) }
        })
        .collect();
    let mut placed: Vec<Placed> = Vec::new();
    for text in wanted {
        let (width, height) = (text.words.chars().count() as f64 * LABEL_PX * ADVANCE + 4.0, LABEL_PX + 4.0);
        let (x, y) = (f64::from(text.at.0), f64::from(text.at.1));
        let mut best: Option<(f64, Placed)> = None;
        for gap in [4.0, 14.0, 26.0, 40.0, 56.0, 74.0].into_iter().filter(|g| !text.optional || *g < 30.0) {
            let r = text.radius + gap;
            let d = r * 0.7;
            // East first, as in writing; the offsets are to the text's left top corner.
            let corners = [
                (r, -height / 2.0),
                (d, -d - height),
                (d, d),
                (-width / 2.0, -r - height),
                (-width / 2.0, r),
                (-d - width, -d - height),
                (-d - width, d),
                (-r - width, -height / 2.0),
            ];
            for (turn, (dx, dy)) in (0u32..).zip(corners) {
                let area = Box2 { left: x + dx, right: x + dx + width, top: y + dy, bottom: y + dy + height };
                let hidden = |boxes: &[Box2]| boxes.iter().filter(|b| area.meets(b)).count() as f64;
                let texts = placed.iter().filter(|p| area.meets(&p.area)).count() as f64;
                let outside = if area.inside(&frame) { 0.0 } else { 1e4 };
                let cost = outside
                    + 1e3 * texts
                    + HIDES_POINT * hidden(&markers)
                    + 6.0 * hidden(&segments).min(3.0)
                    + 0.5 * gap
                    + 0.3 * f64::from(turn);
                if best.as_ref().is_none_or(|(least, _)| cost < *least) {
                    let leader = (gap > 10.0).then(|| {
                        let end = (x.clamp(area.left, area.right) as i32, y.clamp(area.top, area.bottom) as i32);
                        [text.at, end]
                    });
                    best = Some((cost, Placed { words: text.words.clone(), ink: text.ink, area, leader }));
                }
            }
        }
        placed.extend(best.filter(|(cost, _)| !text.optional || *cost < HIDES_POINT).map(|(_, p)| p));
    }
    placed
}

fn draw_label(root: &DrawingArea<SVGBackend<'_>, Shift>, label: &Placed) -> Result<()> {
    if let Some(ends) = label.leader {
        root.draw(&PathElement::new(ends, GREY.stroke_width(1))).map_err(failed)?;
    }
    let at = ((label.area.left + 2.0).round() as i32, f64::midpoint(label.area.top, label.area.bottom).round() as i32);
    let style = text(LABEL_PX, label.ink).pos(Pos::new(HPos::Left, VPos::Center));
    root.draw(&Text::new(label.words.clone(), at, style)).map_err(failed)
}

/// Lets the page decide the size, and gives the picture a name for those who do not see it.
fn inline(svg: &str, title: &str) -> String {
    let named = format!("<svg role=\"img\" aria-label=\"{}\"", crate::report::escape(title));
    let start = svg.find(" viewBox").map_or(svg, |at| &svg[at..]);
    format!("{named}{start}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wanted(words: &str, at: (i32, i32)) -> Wanted {
        Wanted { words: words.to_owned(), at, radius: 5.0, ink: INK, optional: false }
    }

    #[test]
    fn labels_of_close_points_do_not_meet() {
        let frame = Box2 { left: 0.0, right: 600.0, top: 0.0, bottom: 400.0 };
        let at = [(300, 200), (306, 203), (297, 209), (590, 10)];
        let texts: Vec<Wanted> = at.iter().map(|p| wanted("near-cliff+splat", *p)).collect();
        // Without points in the way: texts alone must keep texts apart.
        let placed = place(&texts, &[], &[], frame);
        assert_eq!(placed.len(), texts.len());
        for (i, a) in placed.iter().enumerate() {
            assert!(a.area.inside(&frame), "{a:?}");
            assert!(placed[..i].iter().all(|b| !a.area.meets(&b.area)), "{placed:?}");
        }
        // Where there is no room, an optional text is left out; others stay.
        let small = Box2 { left: 290.0, right: 420.0, top: 190.0, bottom: 214.0 };
        let kept = |optional: bool| {
            place(&[wanted("auto", at[0]), Wanted { optional, ..wanted("near-cliff+splat", at[1]) }], &at, &[], small).len()
        };
        assert_eq!([kept(true), kept(false)], [1, 2]);
        // Negative control: the same texts, each simply to the right of its point, do meet.
        let naive = |p: (i32, i32)| Box2 { left: f64::from(p.0) + 9.0, right: f64::from(p.0) + 120.0, ..Box2::around(p, 8.0) };
        assert!(naive(at[0]).meets(&naive(at[1])));
    }

    #[test]
    fn points_in_one_place_share_a_label() {
        let point = |label: &str, marker, x| Point { label: label.to_owned(), x, y: 0.1, marker, front: false };
        let points = [point("generic", Marker::Generic, 1.0), point("auto", Marker::Auto, 1.0), point("x", Marker::Combination, 1.0)];
        let points: Vec<&Point> = points.iter().collect();
        let words = |at: &[(i32, i32)]| labels(&points, at).into_iter().map(|w| w.words).collect::<Vec<_>>();
        assert_eq!(words(&[(5, 5), (6, 5), (5, 5)]), ["auto, generic"]);
        assert_eq!(words(&[(5, 5), (60, 5), (5, 5)]), ["auto", "generic"]);
    }

    #[test]
    fn steps_go_right_then_down() {
        let line: Vec<_> = steps(&[(1.0, 5.0), (2.0, 3.0)], 9.0, 10.0).collect();
        assert_eq!(line, [(1.0, 10.0), (1.0, 5.0), (2.0, 5.0), (2.0, 3.0), (9.0, 3.0)]);
        assert_eq!(steps(&[], 9.0, 10.0).count(), 0);
    }

    #[test]
    fn ticks_and_numbers_read_well() {
        assert_eq!(ticks(1.5, 60.0), [2.0, 5.0, 10.0, 20.0, 50.0]);
        assert_eq!(ticks(0.03, 0.3).len(), 3);
        assert_eq!([0.0, 0.05, 2.0, 9.876, 123.4, 4500.0].map(number), ["0", "0.05", "2", "9.88", "123", "4500"]);
    }

    #[test]
    fn a_plot_without_points_is_left_out() {
        let lost = Point { label: "a".to_owned(), x: 0.0, y: 0.1, marker: Marker::Auto, front: true };
        let good = Point { x: 3.0, label: "a<b".to_owned(), ..lost.clone() };
        assert!(pareto(&[lost], "t", "x", "y").expect("drawn").is_none());
        let svg = pareto(&[good], "cost & error", "x", "y").expect("drawn").expect("a point");
        assert!(svg.contains("a&lt;b") && svg.contains("aria-label=\"cost &amp; error\"") && svg.ends_with("</svg>\n"));
        assert!(bars(&[("auto".to_owned(), vec![0.0])], "t", "x").expect("drawn").is_none());
    }
}

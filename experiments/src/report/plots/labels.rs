//! Places the labels of a plot so that they hide each other as little as possible. Optional labels for which there is no room are left out.

use anyhow::Result;
use plotters::coord::Shift;
use plotters::element::{PathElement, Text};
use plotters::prelude::{Color, DrawingArea, RGBColor, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{GREY, failed, text};

/// Estimated mean advance width of a character in a sans-serif font, relative to the font size. The estimate is deliberately high, because the real
/// width is known only when a browser draws the text.
const ADVANCE: f64 = 0.57;
const LABEL_PX: f64 = 13.0;

/// A rectangle in pixels, y downwards.
#[derive(Clone, Copy, Debug)]
pub(super) struct Box2 {
    pub(super) left: f64,
    pub(super) right: f64,
    pub(super) top: f64,
    pub(super) bottom: f64,
}

impl Box2 {
    pub(super) fn meets(&self, other: &Box2) -> bool {
        self.left < other.right && other.left < self.right && self.top < other.bottom && other.top < self.bottom
    }

    pub(super) fn around(centre: (i32, i32), radius: f64) -> Box2 {
        let (x, y) = (f64::from(centre.0), f64::from(centre.1));
        Box2 { left: x - radius, right: x + radius, top: y - radius, bottom: y + radius }
    }

    pub(super) fn inside(&self, other: &Box2) -> bool {
        self.left >= other.left && self.right <= other.right && self.top >= other.top && self.bottom <= other.bottom
    }
}

/// A text that is to be placed near a point.
#[derive(Clone, Debug)]
pub(super) struct Wanted {
    pub(super) words: String,
    pub(super) at: (i32, i32),
    pub(super) radius: f64,
    pub(super) ink: RGBColor,
    /// Whether the text may be omitted. An optional text is omitted if every place for it would hide a point or another text, or leave the plot.
    pub(super) optional: bool,
}

/// A text and its chosen place.
#[derive(Clone, Debug)]
pub(super) struct Placed {
    words: String,
    ink: RGBColor,
    pub(super) area: Box2,
    /// A line from the point to the text; `None` if they are close together.
    leader: Option<[(i32, i32); 2]>,
}

/// Places the texts one after another. For each text, several places near its point are compared, and the place with the smallest cost is taken.
/// These faults of a place have a cost, from the most to the least serious: the text leaves `frame` (the area of the plot), hides another text, hides
/// one of `points`, or hides a part of `line`. A long distance from its own point has a small cost, too.
pub(super) fn place(wanted: &[Wanted], points: &[(i32, i32)], line: &[(i32, i32)], frame: Box2) -> Vec<Placed> {
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
            // Positions of the text's top left corner, relative to the point. With the first one, the text is on the right of the point.
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

pub(super) fn draw(root: &DrawingArea<SVGBackend<'_>, Shift>, label: &Placed) -> Result<()> {
    if let Some(ends) = label.leader {
        root.draw(&PathElement::new(ends, GREY.stroke_width(1))).map_err(failed)?;
    }
    let at = ((label.area.left + 2.0).round() as i32, f64::midpoint(label.area.top, label.area.bottom).round() as i32);
    let style = text(LABEL_PX, label.ink).pos(Pos::new(HPos::Left, VPos::Center));
    root.draw(&Text::new(label.words.clone(), at, style)).map_err(failed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plots::INK;

    fn wanted(words: &str, at: (i32, i32)) -> Wanted {
        Wanted { words: words.to_owned(), at, radius: 5.0, ink: INK, optional: false }
    }

    #[test]
    fn labels_of_close_points_do_not_meet() {
        let frame = Box2 { left: 0.0, right: 600.0, top: 0.0, bottom: 400.0 };
        let at = [(300, 200), (306, 203), (297, 209), (590, 10)];
        let texts: Vec<Wanted> = at.iter().map(|p| wanted("near-cliff+splat", *p)).collect();
        // Texts must not overlap even if their points are not given as obstacles.
        let placed = place(&texts, &[], &[], frame);
        assert_eq!(placed.len(), texts.len());
        for (i, a) in placed.iter().enumerate() {
            assert!(a.area.inside(&frame), "{a:?}");
            assert!(placed[..i].iter().all(|b| !a.area.meets(&b.area)), "{placed:?}");
        }
        // If there is not enough room, optional texts are omitted; other texts are kept.
        let small = Box2 { left: 290.0, right: 420.0, top: 190.0, bottom: 214.0 };
        let kept = |optional: bool| {
            place(&[wanted("auto", at[0]), Wanted { optional, ..wanted("near-cliff+splat", at[1]) }], &at, &[], small).len()
        };
        assert_eq!([kept(true), kept(false)], [1, 2]);
        // Negative control: if each text is placed to the right of its point, the texts of the first two points overlap.
        let naive = |p: (i32, i32)| Box2 { left: f64::from(p.0) + 9.0, right: f64::from(p.0) + 120.0, ..Box2::around(p, 8.0) };
        assert!(naive(at[0]).meets(&naive(at[1])));
    }
}

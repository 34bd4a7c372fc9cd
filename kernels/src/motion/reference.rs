//! Links between frames in f64: the reference for `motion.wgsl`.

use glam::DVec3;

use super::TOLERANCE;
use crate::shared::motion::{Past, expected_distance, past_ray, reproject};
use crate::view::camera::View;

/// The results of the geometry pass for one frame.
pub struct Seen {
    /// The view of the frame.
    pub view: View,
    /// For each pixel, the distance of its surface point along the view direction, metres; 0 = no terrain.
    pub distances: Vec<f64>,
    /// For each pixel, the unit normal of its triangle's plane.
    pub planes: Vec<DVec3>,
}

/// The position of a pixel's surface point in an earlier frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    /// The pixel nearest to the point's position in the earlier picture; `None` = the point was not seen.
    pub pixel: Option<usize>,
    /// The exact position, pixels; `None` = the point was not seen.
    pub position: Option<[f64; 2]>,
    /// Whether the rounding of f32 may change `pixel`. This is assumed in three cases: the position is close to a border between two pixels, the
    /// relative difference between the expected and the found depth is close to [`TOLERANCE`], or the expected depth is not above 0 but the found
    /// depth is.
    pub is_uncertain: bool,
}

impl Link {
    const NONE: Link = Link { pixel: None, position: None, is_uncertain: false };
}

/// Links pixel `at` of `now` to a pixel of `past`. Both pictures have the same size.
pub fn link(now: &Seen, past: &Seen, at: usize) -> Link {
    let [width, height] = now.view.size.map(f64::from);
    let distance = now.distances[at];
    if distance <= 0.0 {
        return Link::NONE;
    }
    let (x, y) = (at as f64 % width, (at as f64 / width).floor());
    let point = (now.view.ray(x, y) * distance).to_array();
    let between = Past::between(&now.view, &past.view);
    let [px, py, seen] = reproject(point, &between);
    // In f32, positions in pixels usually have an error of less than 1e-3. So the link counts as uncertain if the position is closer than this to the
    // border of a pixel.
    let is_close = [px, py].into_iter().any(|p| ((p - 0.5).rem_euclid(1.0) - 0.5).abs() > 0.499);
    let (column, row) = ((px + 0.5).floor(), (py + 0.5).floor());
    if seen <= 0.0 || column < 0.0 || row < 0.0 || column >= width || row >= height {
        return Link { is_uncertain: is_close, ..Link::NONE };
    }
    let there = (row * width + column) as usize;
    let expected = expected_distance(point, &between, past_ray(&between, [column, row]), now.planes[at].to_array());
    let found = past.distances[there];
    if found <= 0.0 || expected <= 0.0 {
        return Link { is_uncertain: is_close || expected <= 0.0 && found > 0.0, ..Link::NONE };
    }
    let apart = (found - expected).abs() / expected / f64::from(TOLERANCE);
    let is_uncertain = is_close || (apart - 1.0).abs() < 0.01;
    if apart > 1.0 {
        return Link { is_uncertain, ..Link::NONE };
    }
    Link { pixel: Some(there), position: Some([px, py]), is_uncertain }
}

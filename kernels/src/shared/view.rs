//! From a pixel and its depth to a place relative to the eye: `view.wgsl`.
//!
//! The place is `ray * distance`, relative to the eye, so that it is as good far from the world's origin as at it.

use super::bounded;
use super::real::{Real, add, scale};

/// A depth below this counts as nothing: f32 could not divide by it.
pub const MIN_DEPTH: f64 = 1e-30;

/// Ray of a pixel, 1 long along the view direction. `rays` = that of pixel (0, 0), and the steps to the right and down: `view_ray`.
pub fn ray<T: Real>(rays: [[T; 3]; 3], pixel: [T; 2]) -> [T; 3] {
    add(add(rays[0], scale(rays[1], pixel[0])), scale(rays[2], pixel[1]))
}

/// Distance along the view direction of a reversed depth (`near_m` over it), metres; 0 where nothing was drawn: `view_distance`.
pub fn distance<T: Real>(near_m: T, depth: T) -> T {
    let usable = bounded(depth, 0.0, 1e30);
    if usable > T::of(MIN_DEPTH) { near_m / usable } else { T::zero() }
}

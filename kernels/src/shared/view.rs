//! Computes a position relative to the eye from a pixel and its depth.
//!
//! The position is `ray * distance`. Because it is relative to the eye, its precision does not depend on the distance from the world's origin.

use super::bounded;
use super::real::{Real, add, scale};

/// A depth of at most this value means that nothing was drawn. The limit keeps the quotient of `near_m` and the depth in the range of f32.
pub const MIN_DEPTH: f64 = 1e-30;

/// Ray of a pixel. Its component along the view direction is 1. `rays` are the ray of pixel (0, 0) and its steps to the right and down. In
/// WGSL: `view_ray`.
pub fn ray<T: Real>(rays: [[T; 3]; 3], pixel: [T; 2]) -> [T; 3] {
    add(add(rays[0], scale(rays[1], pixel[0])), scale(rays[2], pixel[1]))
}

/// Distance along the view direction for a reversed depth, metres: `near_m` / depth, or 0 if nothing was drawn. In WGSL: `view_distance`.
pub fn distance<T: Real>(near_m: T, depth: T) -> T {
    let usable = bounded(depth, 0.0, 1e30);
    if usable > T::of(MIN_DEPTH) { near_m / usable } else { T::zero() }
}

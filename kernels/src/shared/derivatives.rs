//! Screen derivatives of the position, from depth and the triangle's plane.
//!
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018: the rays through the neighbouring pixels are intersected with the plane of the triangle
//! that the pixel shows. Let r be the ray of the pixel, P = t r the point that it shows, n the plane's normal, and r' = r + s the neighbour's ray.
//! The neighbour's ray meets the plane at t (n.r / n.r') r'. The derivative is this intersection minus P, which equals t (s - r' (n.s / n.r')). This
//! form avoids the subtraction of two long vectors that nearly cancel.

use super::octahedral::unit;
use super::real::{Real, add, dot, length, scale, sub};

/// Lower limit of |cosine| of the angle between the plane's normal and the neighbouring pixel's ray. A smaller |cosine| is replaced by this limit,
/// and so is a cosine of the other sign: beyond the horizon of the plane, the ray does not hit the plane at all. With this limit, the step along the
/// surface is at most about 100 times the step across the view. This is far more than the anisotropy of a texture filter.
pub const MIN_COSINE: f64 = 0.01;

/// Step, metres, from the point at which a pixel sees a plane to the point at which its neighbour sees the same plane. The pixel's point is
/// `ray * t`, relative to the eye. `ray_step` is the difference between the neighbour's ray and `ray`. `normal` is a normal of the plane, of any
/// length; a normal without usable direction counts as the z axis.
///
/// The result is zero if another input is not finite, or if a component of the neighbour's ray or of the step is beyond 1e18. Up to this limit,
/// squares of both vectors fit f32.
pub fn on_plane<T: Real>(ray: [T; 3], ray_step: [T; 3], t: T, normal: [T; 3]) -> [T; 3] {
    let n = unit(normal);
    let neighbour = add(ray, ray_step);
    let limit = (T::of(MIN_COSINE) * length(neighbour)).max(T::of(1e-20));
    // The neighbour's ray is assumed to meet the plane from the same side as `ray` does.
    let towards = dot(n, neighbour);
    let facing = if dot(n, ray) >= T::zero() { towards.max(limit) } else { towards.min(-limit) };
    let step = scale(sub(ray_step, scale(neighbour, dot(n, ray_step) / facing)), t);
    if neighbour.iter().chain(&step).all(|x| x.abs() <= T::of(1e18)) { step } else { [T::zero(); 3] }
}

//! Three axis-aligned projections. Axis 0 is the projection along x, 1 along y, 2 along z.
//!
//! Texture coordinates are signed and never mirrored. The components of a height gradient in a projection are therefore components of the gradient in
//! space, without a change of sign. Source: Mikkelsen, *Surface Gradient-Based Bump Mapping Framework*, JCGT 9(3), 2020, the sections on tri-planar
//! projection and on resolving a volume gradient.

use super::octahedral::unit;
use super::real::{Real, dot, scale, sub};
use super::{bounded, usable};

/// Sharpness is clamped to 0..=this value.
pub const MAX_SHARPNESS: f64 = 1e4;

/// Weights of the three projections: |n_i|^k, normalised to sum 1; k is `sharpness` >= 0. If `n` has no usable direction, it counts as the z axis.
/// 0^0 counts as 1.
pub fn weights<T: Real>(n: [T; 3], sharpness: T) -> [T; 3] {
    let a = unit(n).map(T::abs);
    let k = bounded(sharpness, 0.0, MAX_SHARPNESS);
    // Components are divided by the largest one, whose term is then 1, so the sum cannot underflow.
    let top = a[0].max(a[1]).max(a[2]);
    let w = a.map(|x| (x / top).powf(k));
    let sum = w[0] + w[1] + w[2];
    w.map(|x| x / sum)
}

/// Coordinates in the plane perpendicular to an axis: (y, z), (x, z), (x, y). An axis above 2 counts as 2. The function only copies numbers, NaN and
/// infinity included.
pub fn coordinates<T: Real>(p: [T; 3], axis: u32) -> [T; 2] {
    match axis {
        0 => [p[1], p[2]],
        1 => [p[0], p[2]],
        _ => [p[0], p[1]],
    }
}

/// Converts a height gradient (d/du, d/dv) in the plane perpendicular to an axis to a gradient in space. An axis above 2 counts as 2. The function
/// only copies numbers, NaN and infinity included.
pub fn from_gradient<T: Real>(g: [T; 2], axis: u32) -> [T; 3] {
    match axis {
        0 => [T::zero(), g[0], g[1]],
        1 => [g[0], T::zero(), g[1]],
        _ => [g[0], g[1], T::zero()],
    }
}

/// Largest magnitude of a component of a height gradient, metres per metre. A slope of this size is almost vertical.
const MAX_SLOPE: f64 = 1e6;

/// Normal of the surface displaced by a height whose gradient in space is `gradient` (metres per metre): n minus the part of `gradient` that is
/// tangent to the surface. If a component of `gradient` exceeds 1e6 in magnitude, `gradient` is scaled down until its largest component has the
/// magnitude 1e6. A gradient with a component that is NaN or beyond 1e30 counts as 0. The result is a unit vector.
pub fn perturb<T: Real>(n: [T; 3], gradient: [T; 3]) -> [T; 3] {
    let n = unit(n);
    let known = gradient.iter().all(|&g| usable(g) == g);
    let g = if known { gradient } else { [T::zero(); 3] };
    let size = g.iter().fold(T::zero(), |size, g| size.max(g.abs()));
    let g = if size > T::of(MAX_SLOPE) { scale(g, T::of(MAX_SLOPE) / size) } else { g };
    let surface_gradient = sub(g, scale(n, dot(n, g)));
    unit(sub(n, surface_gradient))
}

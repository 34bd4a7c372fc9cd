//! One projection: from above on gentle slopes, else the vertical plane whose azimuth is nearest among multiples of 45°.
//!
//! Planes 0, 1, 2 are the tri-planar ones (looking along x, y, z); 3 looks along (1, 1), 4 along (1, -1).
//! After Terrain3D (TokisanGames, `main.glsl`, `get_material`): there the normal at a splat texel, if its height is below a threshold (0.8),
//! is rounded to a coarse grid, and the projection is across it; here it is the pixel's normal, and only its azimuth is rounded.

use super::octahedral::unit;
use super::real::Real;
use super::triplanar;
use super::usable;

/// 1/√2 in 256ths, 0.013 % smaller, so that whole sectors count in exact fixed point.
const DIAGONAL: i32 = 181;

/// Plane of a normal; it is steep where its |z| is below `cosine`.
pub fn plane<T: Real>(n: [T; 3], cosine: T) -> u32 {
    let u = unit(n);
    let a = u.map(T::abs);
    let half_step = T::of(std::f64::consts::SQRT_2 - 1.0);
    if a[2] >= cosine {
        2
    } else if a[1] <= half_step * a[0] {
        0
    } else if a[0] <= half_step * a[1] {
        1
    } else if (u[0] > T::zero()) == (u[1] > T::zero()) {
        3
    } else {
        4
    }
}

/// Coordinates in a plane: horizontal, then vertical. A plane above 4 counts as 2; what is beyond 1e30 or not a number, as zero.
pub fn coordinates<T: Real>(p: [T; 3], plane: u32) -> [T; 2] {
    let p = p.map(usable);
    let diagonal = T::of(f64::from(DIAGONAL) / 256.0);
    match plane {
        3 => [(p[1] - p[0]) * diagonal, p[2]],
        4 => [(p[0] + p[1]) * diagonal, p[2]],
        _ => triplanar::coordinates(p, plane),
    }
}

/// Whole sectors along both coordinates, of `place` in sectors east, north, up. On a diagonal, to be counted at the rate of [`fixed`].
pub fn sectors(place: [i32; 3], plane: u32) -> [i32; 2] {
    let [x, y, z] = place;
    match plane {
        0 => [y, z],
        1 => [x, z],
        3 => [y.wrapping_sub(x), z],
        4 => [x.wrapping_add(y), z],
        _ => [x, y],
    }
}

/// Repeats per sector along the first coordinate, in the fixed point of [`super::tiling::fixed`], of which only the fraction is good on a
/// diagonal (a scale of 0).
pub fn fixed(per_sector_fixed: i32, plane: u32) -> i32 {
    match plane {
        3 | 4 => ((per_sector_fixed >> 8).wrapping_mul(DIAGONAL)).wrapping_add(((per_sector_fixed & 255) * DIAGONAL) >> 8),
        _ => per_sector_fixed,
    }
}

/// Height gradient in a plane, as gradient in the volume; what is beyond 1e30 or not a number counts as zero.
pub fn from_gradient<T: Real>(g: [T; 2], plane: u32) -> [T; 3] {
    let g = g.map(usable);
    let along = g[0] * T::of(std::f64::consts::FRAC_1_SQRT_2);
    match plane {
        3 => [-along, along, g[1]],
        4 => [along, along, g[1]],
        _ => triplanar::from_gradient(g, plane),
    }
}

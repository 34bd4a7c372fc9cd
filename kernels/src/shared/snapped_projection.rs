//! A single projection. Gentle slopes are projected from above. Steep slopes are projected horizontally, in the direction whose azimuth is the
//! multiple of 45° that is nearest to the normal's azimuth.
//!
//! Planes 0, 1 and 2 are those of tri-planar projection along x, y and z. Textures on plane 3 are projected along the horizontal direction (1, 1), on
//! plane 4 along (1, -1).
//!
//! After Terrain3D (TokisanGames, `main.glsl`, `get_material`). There, the normal at a splat texel is used. If its vertical component is below 0.8,
//! it is rounded to a coarse grid, and the texture is projected onto the plane perpendicular to the rounded normal. Here, the normal of the pixel is
//! used, and only its azimuth is rounded.

use super::octahedral::unit;
use super::real::Real;
use super::triplanar;
use super::usable;

/// 1/√2 in units of 1/256. 181/256 is 0.011 % too small, but [`fixed`] can multiply by it in integer arithmetic.
const DIAGONAL: i32 = 181;

/// Chooses the plane for a normal. The slope is steep if |z| of the unit normal is below `cosine`.
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

/// Projects a position to two coordinates in a plane: (horizontal, vertical) on a vertical plane, (x, y) on plane 2. A plane above 4 counts as 2.
/// Numbers beyond 1e30 and NaN count as zero.
pub fn coordinates<T: Real>(p: [T; 3], plane: u32) -> [T; 2] {
    let p = p.map(usable);
    let diagonal = T::of(f64::from(DIAGONAL) / 256.0);
    match plane {
        3 => [(p[1] - p[0]) * diagonal, p[2]],
        4 => [(p[0] + p[1]) * diagonal, p[2]],
        _ => triplanar::coordinates(p, plane),
    }
}

/// Converts a position in whole sectors to the two coordinates of a plane. `place` counts sectors east, north and up. On a diagonal plane, the first
/// coordinate lacks the factor 1 / sqrt 2, which [`fixed`] applies to the repeats per sector instead.
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

/// Converts the repeats per sector of [`super::tiling::per_sector_fixed`] to the repeats per sector along the first coordinate of a plane, in the
/// same fixed-point format: 24 fractional bits, modulo 2^32. On planes 3 and 4, the number is multiplied by 181/256. The input is known only up to a
/// multiple of 2^32. Multiplied by 181/256, such a multiple is a whole number of repeats. So on these planes, the fractional part of the result is
/// right, but the whole part may be wrong, and [`super::tiling::fixed`] must be called with scale 0.
pub fn fixed(per_sector_fixed: i32, plane: u32) -> i32 {
    match plane {
        3 | 4 => ((per_sector_fixed >> 8).wrapping_mul(DIAGONAL)).wrapping_add(((per_sector_fixed & 255) * DIAGONAL) >> 8),
        _ => per_sector_fixed,
    }
}

/// Converts a height gradient in a plane to a gradient in space. Numbers beyond 1e30 and NaN count as zero.
pub fn from_gradient<T: Real>(g: [T; 2], plane: u32) -> [T; 3] {
    let g = g.map(usable);
    let along = g[0] * T::of(std::f64::consts::FRAC_1_SQRT_2);
    match plane {
        3 => [-along, along, g[1]],
        4 => [along, along, g[1]],
        _ => triplanar::from_gradient(g, plane),
    }
}

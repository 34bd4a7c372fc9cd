//! Stochastic trilinear filtering: one mip level and one texel are chosen at random, so that the expected value of the texel is the filtered value.
//!
//! Source: Fajardo, Wronski, Salvi and Pharr, *Stochastic Texture Filtering*, 2023; Pharr et al., *Filtering After Shading with Stochastic Texture
//! Filtering*, I3D 2024. Each function takes a random number `u`, uniform in [0, 1). The level and each axis of the texel need independent numbers.

use super::bounded;
use super::real::Real;

/// Chooses a mip level of a texture with `levels` levels (at least 1): the floor or the ceiling of `lod`, clamped to the existing levels.
pub fn level<T: Real>(lod: T, levels: u32, u: T) -> u32 {
    let last = levels.max(1) - 1;
    let l = bounded(lod, 0.0, f64::from(last));
    let above = if u < l - l.floor() { 1 } else { 0 };
    (l.floor().to_u32().expect("clamped to the mip levels") + above).min(last)
}

/// Chooses a texel along one axis of a mip level of a repeating texture; the level has `size` texels (at least 1) along this axis. The result is one
/// of the two texels whose centres are nearest to the coordinate. The unit of the coordinate is one repeat of the texture. Coordinates beyond 10^5
/// and NaN count as 0.
pub fn texel<T: Real>(coordinate: T, size: u32, u: T) -> u32 {
    let texels = size.max(1);
    let c = if coordinate.abs() <= T::of(1e5) { coordinate } else { T::zero() };
    let x = (c - c.floor()) * T::of(f64::from(texels)) - T::of(0.5);
    let above = if u < x - x.floor() { 1 } else { 0 };
    let texel = x.floor().to_i64().expect("between -1 and the size") + above;
    u32::try_from(texel.rem_euclid(i64::from(texels))).expect("less than the size")
}

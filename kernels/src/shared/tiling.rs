//! Texture tiling: scales that follow distance, and coordinates that keep their precision far from the origin.
//!
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018 (cliffs keep their texel size on screen by blending two tilings).

use super::bounded;
use super::real::Real;

/// A pixel blends two neighbouring scales, s and s + 1. This is the largest s. At this scale, a repeat of a texture is 2^7 times as wide as at
/// scale 0; at the upper scale, it is 2^8 times as wide.
pub const MAX_LEVEL: f64 = 7.0;

/// Returns (s, f): blend scale s with weight 1 - f and scale s + 1 with weight f. At scale s, a repeat of a texture is 2^s times as wide as at
/// scale 0. On full cliff, s + f is the number of octaves of `distance` beyond `near` (both in metres), up to [`MAX_LEVEL`]. This number is
/// multiplied by `cliff`, 0..=1, the weight of cliff, so flat ground keeps scale 0.
pub fn scales<T: Real>(distance: T, near: T, cliff: T) -> (u32, T) {
    let near = bounded(near, 1e-6, 1e9);
    let octaves = (bounded(distance, 0.0, 1e9).max(near) / near).log2();
    let level = bounded(octaves, 0.0, MAX_LEVEL) * bounded(cliff, 0.0, 1.0);
    let scale = level.floor();
    (scale.to_u32().expect("a level is between 0 and 7"), level - scale)
}

/// Texture repeats per sector in the fixed-point format of [`fixed`]: 24 fractional bits, modulo 2^32 ([`fixed`] does not need the higher bits).
/// `sector_m` and `tile_m` are in metres, `tile_m` > 0. `tile_m` is the wanted edge of one repeat. The actual edge is `sector_m` divided by
/// the rounded repeats of [`repeats`]. For the part of a coordinate within the sector, also use the rounded repeats, so that textures are
/// continuous across sector borders.
#[allow(clippy::cast_possible_truncation, reason = "the fixed-point number wraps at 2^32")]
pub fn per_sector_fixed(sector_m: f64, tile_m: f64) -> i32 {
    rounded(sector_m, tile_m) as i64 as i32
}

/// Texture repeats per sector after rounding to 24 fractional bits.
pub fn repeats(sector_m: f64, tile_m: f64) -> f64 {
    rounded(sector_m, tile_m) / 16_777_216.0
}

fn rounded(sector_m: f64, tile_m: f64) -> f64 {
    // There are at most 2^28 repeats, so the product is at most 2^52. Up to this limit, f64 can hold every whole number.
    (bounded(sector_m / tile_m, -268_435_456.0, 268_435_456.0) * 16_777_216.0).round()
}

/// Texture coordinate of a sector's origin, [0, 1), rounded down to 24 bits: fract(sector c / 2^scale), where c, the repeats per sector, is given as
/// `per_sector_fixed` = c 2^24, see [`per_sector_fixed()`]. `scale` is clamped to 0..=8. Bit-equal in f32, f64 and the shader.
pub fn fixed<T: Real>(sector: i32, per_sector_fixed: i32, scale: u32) -> T {
    let scale = scale.min(8);
    let repeat = (i64::from(sector) * i64::from(per_sector_fixed)).rem_euclid(1 << (24 + scale));
    T::of(((repeat >> scale) as f64) / 16_777_216.0)
}

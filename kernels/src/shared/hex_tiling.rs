//! Hex tiling: the plane is divided into hexagons, each of which shows the texture at a random offset; around a point, three hexagons are blended.
//!
//! Source: Mikkelsen, *Practical Real-Time Hex-Tiling*, JCGT 11(2), 2022, after Heitz and Neyret, *High-Performance By-Example Noise using a
//! Histogram-Preserving Blending Operator*, HPG 2018. This module uses Mikkelsen's exponent 7 on barycentric weights, but neither his weighting by
//! luminance nor his rotations. **Contrast is not preserved**: blending three independent offsets multiplies the variance of a texture by Σ w², which
//! is a third where three hexagons meet. Heitz and Neyret divide the difference between the blend and the mean by √Σ w², which needs a texture with a
//! Gaussian histogram.
//!
//! Hexagons lie in the plane of the projection. Their centres form a skewed lattice. The skew, exactly 1/√3, is rounded to 37/64, and the number of
//! hexagons along a sector is a power of two. The edge of a sector is therefore a whole number of fixed-point steps, which are 2^-16 of the lattice
//! spacing. So the ids of hexagons are exact integers (modulo 2^16) at any distance from the origin.

use super::real::Real;
use super::{bounded, hash, usable};

/// Smallest and largest level: a sector has 2^level hexagons along its edge.
pub const LEVELS: [i32; 2] = [-10, 15];
/// The fraction 37/64, which replaces 1/√3. The two differ by 0.13 %.
const SKEW: (i64, f64) = (37, 64.0);

/// The hexagons around a point: ids, modulo 2^16, and weights, which sum to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HexTiling<T> {
    /// Column and row in the skewed lattice.
    pub ids: [[u32; 2]; 3],
    /// Barycentric coordinates to the seventh power, normalised.
    pub weights: [T; 3],
}

/// The level for a texture that repeats `repeats` times along a sector, which then has 2^level hexagons along its edge. The level is chosen so that
/// there are 2√3 hexagons per repeat, within a factor √2. It is clamped to [`LEVELS`].
pub fn level<T: Real>(repeats: T) -> i32 {
    let spacings = bounded(repeats, 1e-6, 1e6) * T::of(12.0_f64.sqrt());
    spacings.log2().round().to_i32().expect("bounded").clamp(LEVELS[0], LEVELS[1])
}

/// The hexagons around a point. Both coordinates of the point in the plane are given as `sector` whole sectors plus `position` metres.
pub fn at<T: Real>(sector: [i32; 2], position: [T; 2], sector_m: T, level: i32) -> HexTiling<T> {
    let level = level.clamp(LEVELS[0], LEVELS[1]);
    let skew = T::of(SKEW.0 as f64 / SKEW.1);
    // Whole sectors are computed in fixed point, exactly, in steps of 2^-16 of the lattice spacing. The edge of a sector has 2^(16 + level)
    // steps, which is 64 times `unit`.
    let unit = 1_i64 << (10 + level);
    let [sx, sy] = sector.map(i64::from);
    let whole = [sx * 64 * unit - sy * SKEW.0 * unit, 2 * sy * SKEW.0 * unit].map(|w| w.rem_euclid(1 << 32));
    let spacings = T::of(f64::from(level).exp2()) / bounded(sector_m, 1e-6, 1e30);
    let [x, y] = position.map(|p| bounded(usable(p) * spacings, -1e9, 1e9));
    let local = [x - skew * y, T::of(2.0) * skew * y];
    let mut id = [0_u32; 2];
    let mut f = [T::zero(); 2];
    for i in 0..2 {
        let at = T::of((whole[i] & 0xffff) as f64 / 65_536.0) + local[i];
        f[i] = bounded(at - at.floor(), 0.0, 1.0);
        let step = at.floor().to_i64().expect("bounded");
        id[i] = u32::try_from(((whole[i] >> 16) + step).rem_euclid(1 << 16)).expect("16 bits");
    }
    let one = T::one();
    let next = |v: u32| (v + 1) & 0xffff;
    let upper = f[0] + f[1] >= one;
    let (corner, w) =
        if upper { (id.map(next), [f[0] + f[1] - one, one - f[1], one - f[0]]) } else { (id, [one - f[0] - f[1], f[0], f[1]]) };
    let top = w[0].max(w[1]).max(w[2]);
    let sharp = w.map(|w| (w.max(T::zero()) / top).powi(7));
    let sum = sharp[0] + sharp[1] + sharp[2];
    HexTiling { ids: [corner, [next(id[0]), id[1]], [id[0], next(id[1])]], weights: sharp.map(|w| w / sum) }
}

/// Offset of the texture in a hexagon, [0, 1)²; `salt` distinguishes lattices. Bit-equal on every machine.
pub fn offset<T: Real>(id: [u32; 2], salt: u32) -> [T; 2] {
    let h = hash::pcg4d([id[0], id[1], salt, 0]);
    [hash::to_unit(h[0]), hash::to_unit(h[1])]
}

//! Random thresholds in [0, 1) for stochastic choices. Each call returns four thresholds, which are independent of each other over seeds: one for
//! each random decision of a pixel, such as the choice of a material.
//!
//! There are seven kinds of noise. Three are bound to the ground (hashed alpha in two forms, white noise of fixed cells), and four to the screen
//! (white noise, interleaved gradient noise, a blue-noise mask, a spatio-temporal blue-noise mask). Over seeds, the thresholds of each kind are
//! uniform. The kinds differ in how neighbouring pixels and frames are correlated.
//!
//! Hashed alpha (Wyman & McGuire, *Hashed Alpha Testing*, I3D 2017) divides space into cells that are about as wide as a pixel. The random numbers of
//! a point are a hash of the cell that contains the point. Cell sizes are powers of two. The random numbers of the two sizes next to the pixel's size
//! are blended, so that there is no visible jump when the camera moves. The blend is not uniform; its distribution function converts it to a uniform
//! number. Here cells are exact integers (sector index times cells per sector, plus cell in sector), so that the noise works equally well at the
//! origin and 1000 km from it.
//!
//! The anisotropic kind has one scale per axis, but a single blend factor. Its thresholds therefore jump where the scale of one axis passes a power
//! of two and the scales of the other axes do not. This is a limit of the published method.
//!
//! A position is computed in f32, so the same point of the ground has slightly different coordinates in two frames. If cells were as small as this
//! difference, points would often change their cells and random numbers when the camera moves. Three rules, which the paper does not have, make such
//! changes rare:
//!
//! - No cell is narrower than 2^[`STEPS`] steps of f32 ([`finest`]). A step is the distance between neighbouring f32 values. Along the elevation, the
//!   step depends on the elevation of the point: it is 0.06 mm at 700 m. Along east and north, the step is that at the coordinate
//!   [`HashedPoint::sector_m`]. This step is the same for all points, so that the noise does not depend on the sector relative to which a point is
//!   given.
//! - In the anisotropic kind, the footprint along an axis counts as at least [`LEAST_SHARE`] of the footprint along the axis on which it is widest.
//!   On level ground, the elevation does not change from pixel to pixel, so without this rule, cells would be smallest along the elevation. Then the
//!   rounding error of depth would move points to other cells. A share of the footprint is enough as a limit, because this error grows with the
//!   distance, as footprints do.
//! - Along the elevation, borders between cells are a third of a cell above the multiples of the cell width ([`BORDER`]). Otherwise, level ground at
//!   an elevation of whole metres would lie on a border, and one step of f32 would move all of it to other cells.
//!
//! Interleaved gradient noise (Jimenez, *Next Generation Post Processing in Call of Duty: Advanced Warfare*, SIGGRAPH 2014) is a sawtooth along one
//! direction: a rational lattice whose 3 x 3 neighbourhoods contain evenly spread values. Here, it is computed in fixed point, where the products are
//! exact. Two additions make the thresholds of the four decisions uniform and independent:
//!
//! - The decisions use the pixel coordinates in four ways: as they are, mirrored, transposed, and both. Each decision also shifts the coordinates by
//!   whole pixels, but a shift alone is not enough, because it changes all values by almost the same amount.
//! - Each decision adds a hashed offset, modulo 1. The published function alone is not uniform: its factor 52.98 is not a whole number, so values
//!   above 0.983 are 1.9 % too rare.

use std::fmt;
use std::str::FromStr;

use super::real::{Real, length};
use super::{blue_noise, bounded, hash, usable};
use crate::base::wgsl::Constant;

/// Scale of the largest cells, log2 of cells per metre.
pub const LEVEL_MIN: i32 = -5;
/// Scale of the smallest cells, log2 of cells per metre. [`finest`] returns the limit at a place, which may be lower.
pub const LEVEL_MAX: i32 = 16;
/// No cell is narrower than 2^`STEPS` times the distance between neighbouring f32 values at the coordinate of the cell.
pub const STEPS: i32 = 4;
/// Scale of the smallest cells along an axis whose largest coordinate is 1 m, before the limit [`LEVEL_MAX`] is applied. At 1 m, neighbouring f32
/// values are 2^-23 m apart.
const FINEST_AT_1_M: i32 = 23 - STEPS;
/// The bits after the leading one of the smallest f32 above √2. The finest scale along the elevation changes where the elevation passes 2^n √2 m
/// with n of at least 3. At lower elevations (below 11.3 m), the limit [`LEVEL_MAX`] applies. The scale does not change at 2^n m, because level
/// ground often has such an elevation, and rounding would then switch the scale from pixel to pixel.
const OCTAVE_BORDER: u32 = 0x35_04f4;
/// Lower limit of the footprint along any axis in the anisotropic kind, as a share of the footprint along the axis on which the footprint is widest.
/// A power of two, so that the product is exact.
pub const LEAST_SHARE: f64 = 1.0 / 16.0;
/// Along the elevation, borders between cells are above the multiples of the cell width by this share of the cell width: a third, as the nearest f32.
/// Elevations in data are usually rounded to decimals or to binary fractions, and thus not to a third of a cell. The share must not be close to 1.
/// The fraction of a small negative number is close to 1, and f32 rounds this fraction more coarsely than f64, so f32 and f64 could find different
/// cells.
pub const BORDER: f64 = 11_184_811.0 / 33_554_432.0;
/// The largest threshold: 1 - 2^-24, the largest f32 below 1.
pub const BELOW_ONE: f64 = 1.0 - 1.0 / 16_777_216.0;

/// Default scale of the cells of [`NoiseKind::WhiteWorld`], log2 of cells per metre: cells of 6.25 cm.
pub const WORLD_LEVEL: i32 = 4;
/// Interleaved gradient noise: Jimenez' slopes along x and y, 0.06711056 and 0.00583715, in units of 2^-32.
pub const IGN_SLOPES: [u32; 2] = [288_237_660, 25_070_368];
/// Interleaved gradient noise: the change from one frame to the next, a step of 5.588238 pixels along both axes, in units of 2^-32.
pub const IGN_FRAME: u32 = 1_750_839_832;
/// Interleaved gradient noise: the whole part of Jimenez' factor 52.9829189.
pub const IGN_WHOLE: u32 = 52;
/// Interleaved gradient noise: the fractional part of Jimenez' factor 52.9829189, in units of 2^-32.
pub const IGN_REST: u32 = 4_221_604_530;

/// A kind of noise: the source of thresholds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum NoiseKind {
    /// Hashed alpha with one scale for all axes.
    HashedIsotropic,
    /// Hashed alpha with one scale per axis.
    HashedAnisotropic,
    /// White noise that changes from pixel to pixel and from frame to frame.
    WhiteScreen,
    /// White noise per cell of a fixed grid in the world.
    WhiteWorld,
    /// Interleaved gradient noise, which depends on pixel and frame.
    InterleavedGradient,
    /// A blue-noise mask over the screen, the same in all frames with the same seed.
    Blue,
    /// A blue-noise mask that is also blue along time, with one slice per frame.
    SpatioTemporalBlue,
}

/// The error for a text that is not a kind of noise.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{given}` is not a kind of noise: give one of {}", NoiseKind::ALL.map(NoiseKind::name).join(", "))]
pub struct NotANoise {
    given: String,
}

/// Constants that the host passes to `noise.wgsl`.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("NOISE_HASHED_ISOTROPIC", Constant::U32(NoiseKind::HashedIsotropic.code())),
    ("NOISE_HASHED_ANISOTROPIC", Constant::U32(NoiseKind::HashedAnisotropic.code())),
    ("NOISE_WHITE_SCREEN", Constant::U32(NoiseKind::WhiteScreen.code())),
    ("NOISE_WHITE_WORLD", Constant::U32(NoiseKind::WhiteWorld.code())),
    ("NOISE_INTERLEAVED_GRADIENT", Constant::U32(NoiseKind::InterleavedGradient.code())),
    ("NOISE_BLUE", Constant::U32(NoiseKind::Blue.code())),
    ("NOISE_SPATIO_TEMPORAL_BLUE", Constant::U32(NoiseKind::SpatioTemporalBlue.code())),
    ("NOISE_LEVEL_MIN", Constant::real(LEVEL_MIN as f64)),
    ("NOISE_LEVEL_MAX", Constant::real(LEVEL_MAX as f64)),
    ("NOISE_FINEST_AT_1_M", Constant::real(FINEST_AT_1_M as f64)),
    ("NOISE_OCTAVE_BORDER", Constant::U32(OCTAVE_BORDER)),
    ("NOISE_LEAST_SHARE", Constant::real(LEAST_SHARE)),
    ("NOISE_BORDER", Constant::real(BORDER)),
    ("NOISE_MASK_EDGE", Constant::U32(blue_noise::EDGE)),
    ("NOISE_MASK_RANKS", Constant::U32(blue_noise::RANKS)),
    ("NOISE_MASK_SLICES", Constant::U32(blue_noise::SLICES)),
    ("NOISE_IGN_SLOPE_X", Constant::U32(IGN_SLOPES[0])),
    ("NOISE_IGN_SLOPE_Y", Constant::U32(IGN_SLOPES[1])),
    ("NOISE_IGN_FRAME", Constant::U32(IGN_FRAME)),
    ("NOISE_IGN_WHOLE", Constant::U32(IGN_WHOLE)),
    ("NOISE_IGN_REST", Constant::U32(IGN_REST)),
];

impl NoiseKind {
    /// Every kind, in the order of its code.
    pub const ALL: [NoiseKind; 7] = [
        NoiseKind::HashedIsotropic,
        NoiseKind::HashedAnisotropic,
        NoiseKind::WhiteScreen,
        NoiseKind::WhiteWorld,
        NoiseKind::InterleavedGradient,
        NoiseKind::Blue,
        NoiseKind::SpatioTemporalBlue,
    ];

    /// The kind's number in shaders.
    pub const fn code(self) -> u32 {
        match self {
            NoiseKind::HashedIsotropic => 0,
            NoiseKind::HashedAnisotropic => 1,
            NoiseKind::WhiteScreen => 2,
            NoiseKind::WhiteWorld => 3,
            NoiseKind::InterleavedGradient => 4,
            NoiseKind::Blue => 5,
            NoiseKind::SpatioTemporalBlue => 6,
        }
    }

    /// The name used in files, tables and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            NoiseKind::HashedIsotropic => "hashed",
            NoiseKind::HashedAnisotropic => "hashed-anisotropic",
            NoiseKind::WhiteScreen => "white",
            NoiseKind::WhiteWorld => "world",
            NoiseKind::InterleavedGradient => "ign",
            NoiseKind::Blue => "blue",
            NoiseKind::SpatioTemporalBlue => "stbn",
        }
    }

    /// Whether the thresholds come from [`blue_noise::ranks`]. In WGSL: `noise_needs_mask`.
    pub const fn needs_mask(self) -> bool {
        matches!(self, NoiseKind::Blue | NoiseKind::SpatioTemporalBlue)
    }

    /// Whether the thresholds change from frame to frame while neither the camera moves nor the seed changes.
    pub const fn is_per_frame(self) -> bool {
        matches!(self, NoiseKind::WhiteScreen | NoiseKind::InterleavedGradient | NoiseKind::SpatioTemporalBlue)
    }
}

impl fmt::Display for NoiseKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for NoiseKind {
    type Err = NotANoise;

    fn from_str(text: &str) -> Result<Self, NotANoise> {
        NoiseKind::ALL.into_iter().find(|kind| kind.name() == text).ok_or_else(|| NotANoise { given: text.to_owned() })
    }
}

/// The point for which a hashed threshold is computed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HashedPoint<T> {
    /// Sector index, east and north.
    pub sector: [i32; 2],
    /// Metres: x and y from the sector's south-west corner, z is elevation.
    pub position: [T; 3],
    /// Edge of a sector, metres: a power of two in 32..=16384.
    pub sector_m: T,
    /// Step of the position to the next pixel on the right, metres.
    pub ddx: [T; 3],
    /// Step of the position to the next pixel below, metres.
    pub ddy: [T; 3],
    /// Cell size in pixels, > 0 (the paper's g_HashScale).
    pub hash_scale: T,
}

/// The random numbers of two neighbouring scales, before they are blended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoScales<T> {
    /// Uniform numbers of the larger cell.
    pub coarse: [T; 4],
    /// Uniform numbers of the smaller cell.
    pub fine: [T; 4],
    /// Weight of the smaller cell, 0..=1.
    pub lerp_factor: T,
}

impl<T: Real> TwoScales<T> {
    /// The thresholds: the blend of both scales, made uniform by [`correct`].
    pub fn thresholds(&self) -> [T; 4] {
        self.blended().map(|x| correct(x, self.lerp_factor))
    }

    /// The blend alone. It is not uniform; [`correct`] makes it uniform.
    pub fn blended(&self) -> [T; 4] {
        let l = self.lerp_factor;
        std::array::from_fn(|i| self.coarse[i] * (T::one() - l) + self.fine[i] * l)
    }
}

/// Hashed-alpha thresholds with one scale for all axes. In WGSL: `noise_hashed_isotropic`.
pub fn hashed_isotropic<T: Real>(point: &HashedPoint<T>, seed: u32, salt: u32) -> [T; 4] {
    isotropic_scales(point, seed, salt).thresholds()
}

/// Hashed-alpha thresholds with one scale per axis. In WGSL: `noise_hashed_anisotropic`.
pub fn hashed_anisotropic<T: Real>(point: &HashedPoint<T>, seed: u32, salt: u32) -> [T; 4] {
    anisotropic_scales(point, seed, salt).thresholds()
}

/// The random numbers at two scales that [`hashed_isotropic`] blends.
pub fn isotropic_scales<T: Real>(point: &HashedPoint<T>, seed: u32, salt: u32) -> TwoScales<T> {
    let extent = length(point.ddx).max(length(point.ddy));
    let finest = finest_of_all(point);
    let (k, part) = split(level(point.hash_scale * extent, finest), finest);
    TwoScales { coarse: cell_units(point, [k; 3], seed, salt), fine: cell_units(point, [k + 1; 3], seed, salt), lerp_factor: part }
}

/// The random numbers at two scales that [`hashed_anisotropic`] blends.
pub fn anisotropic_scales<T: Real>(point: &HashedPoint<T>, seed: u32, salt: u32) -> TwoScales<T> {
    // A component of a derivative is at most as long as the derivative, so on average, cells would be smaller than those of the isotropic kind. The
    // square root of 2, the inverse of the paper's factor 0.707, compensates for this.
    let widen = T::of(std::f64::consts::SQRT_2) * point.hash_scale;
    let widths: [T; 3] = std::array::from_fn(|i| bounded(widen * point.ddx[i].abs().max(point.ddy[i].abs()), 0.0, 1e6));
    let least = T::of(LEAST_SHARE) * widths[0].max(widths[1]).max(widths[2]);
    let finest = finest(point);
    let axes: [(i32, T); 3] = std::array::from_fn(|i| split(level(widths[i].max(least), finest[i]), finest[i]));
    let k = axes.map(|(k, _)| k);
    let part = axes.map(|(_, part)| part);
    let (to_coarse, to_fine) = (length(part), length(part.map(|p| T::one() - p)));
    TwoScales {
        coarse: cell_units(point, k, seed, salt),
        fine: cell_units(point, k.map(|k| k + 1), seed, salt),
        lerp_factor: to_coarse / (to_coarse + to_fine),
    }
}

/// The probability that (1-l) U1 + l U2 < x, where U1 and U2 are independent and uniform, and l is `lerp_factor`. Both arguments are clamped
/// to 0..=1, and the result is limited to [`BELOW_ONE`]. Source: Wyman & McGuire 2017, the three cases of the distribution function. In WGSL:
/// `noise_correct`.
pub fn correct<T: Real>(x: T, lerp_factor: T) -> T {
    let one = T::one();
    let x = bounded(x, 0.0, 1.0);
    let l = bounded(lerp_factor, 0.0, 1.0);
    let a = l.min(one - l);
    let half = T::of(0.5);
    let p = if a <= T::zero() {
        x
    } else if x < a {
        half * (x / a) * x / (one - a)
    } else if x <= one - a {
        (x - half * a) / (one - a)
    } else {
        one - half * ((one - x) / a) * (one - x) / (one - a)
    };
    bounded(p, 0.0, BELOW_ONE)
}

/// White noise per pixel and frame. In WGSL: `noise_white_screen`.
pub fn white_screen<T: Real>(pixel: [u32; 2], frame: u32, seed: u32, salt: u32) -> [T; 4] {
    hash::pcg4d([pixel[0], pixel[1], frame, hash::mix(seed, salt, 0)]).map(hash::to_unit)
}

/// White noise per cell of a fixed grid in the world. Cells are 2^-`level` m wide. `level` is clamped to the range from [`LEVEL_MIN`] to the smallest
/// of the three results of [`finest`]. In WGSL: `noise_white_world`.
pub fn white_world<T: Real>(point: &HashedPoint<T>, level: i32, seed: u32, salt: u32) -> [T; 4] {
    cell_units(point, [level.clamp(LEVEL_MIN, finest_of_all(point)); 3], seed, salt)
}

/// Interleaved gradient noise as published, of a pixel and frame, in units of 2^-32. Each frame shifts the pixel by 5.588238 along both
/// axes. In WGSL: `noise_interleaved_gradient_value`.
pub fn interleaved_gradient_value(pixel: [u32; 2], frame: u32) -> u32 {
    let inner =
        pixel[0].wrapping_mul(IGN_SLOPES[0]).wrapping_add(pixel[1].wrapping_mul(IGN_SLOPES[1])).wrapping_add(frame.wrapping_mul(IGN_FRAME));
    let [_, _, _, _, rest @ ..] = (u64::from(inner) * u64::from(IGN_REST)).to_le_bytes();
    inner.wrapping_mul(IGN_WHOLE).wrapping_add(u32::from_le_bytes(rest))
}

/// Interleaved gradient noise for four decisions. For each decision, the pixel coordinates are shifted, transposed and mirrored
/// differently, and the value gets a different offset modulo 1. In WGSL: `noise_interleaved_gradient`.
pub fn interleaved_gradient<T: Real>(pixel: [u32; 2], frame: u32, seed: u32, salt: u32) -> [T; 4] {
    [0, 1, 2, 3].map(|decision| {
        let [right, down, rotation, _] = hash::pcg4d([seed, salt, decision, IGN_FRAME]);
        let [x, y] = [pixel[0].wrapping_add(right), pixel[1].wrapping_add(down)];
        let turned = [[x, y], [x, !y], [y, x], [y, !x]][decision as usize];
        hash::to_unit(interleaved_gradient_value(turned, frame).wrapping_add(rotation))
    })
}

/// Returns the index in [`blue_noise::ranks`] at which the rank of a pixel is stored. A pixel makes up to four random decisions, each with
/// a rank of its own; `decision` is 0..=3. The mask is repeated over the screen, and shifted by an offset that depends on seed, salt and
/// decision. The index is 0 for kinds of noise without a mask. In WGSL: `noise_rank_index`.
pub fn rank_index(kind: NoiseKind, pixel: [u32; 2], frame: u32, seed: u32, salt: u32, decision: u32) -> u32 {
    const EDGE: u32 = blue_noise::EDGE;
    let slice = match kind {
        NoiseKind::Blue => 0,
        NoiseKind::SpatioTemporalBlue => 1 + frame % blue_noise::SLICES,
        _ => return 0,
    };
    let [right, down, _, _] = hash::pcg4d([seed, salt, decision, EDGE]);
    let [x, y] = [pixel[0].wrapping_add(right) % EDGE, pixel[1].wrapping_add(down) % EDGE];
    slice * blue_noise::RANKS + y * EDGE + x
}

/// Converts four ranks of a mask to thresholds of 24 bits: (rank + jitter) / number of ranks. The jitter is a hash in [0, 1). It changes
/// with the frame only if the ranks change with the frame. In WGSL: `noise_mask`.
pub fn mask<T: Real>(kind: NoiseKind, pixel: [u32; 2], frame: u32, seed: u32, salt: u32, ranks: [u32; 4]) -> [T; 4] {
    let frame = if kind.is_per_frame() { frame } else { 0 };
    let jitter = hash::pcg4d([pixel[0], pixel[1], frame, hash::mix(seed, salt, 1)]);
    std::array::from_fn(|i| {
        let rank = ranks[i].min(blue_noise::RANKS - 1);
        hash::to_unit(rank << 20 | jitter[i] >> 12)
    })
}

/// The thresholds of the given kind of noise, for a point that is seen in a pixel of a frame. `world_level` is the level of [`white_world`]; the
/// other kinds do not use it. This function looks up the ranks of a mask itself; in WGSL (`noise_thresholds`), the caller loads them.
pub fn thresholds<T: Real>(
    kind: NoiseKind,
    point: &HashedPoint<T>,
    world_level: i32,
    pixel: [u32; 2],
    frame: u32,
    seed: u32,
    salt: u32,
) -> [T; 4] {
    match kind {
        NoiseKind::HashedIsotropic => hashed_isotropic(point, seed, salt),
        NoiseKind::HashedAnisotropic => hashed_anisotropic(point, seed, salt),
        NoiseKind::WhiteScreen => white_screen(pixel, frame, seed, salt),
        NoiseKind::WhiteWorld => white_world(point, world_level, seed, salt),
        NoiseKind::InterleavedGradient => interleaved_gradient(pixel, frame, seed, salt),
        NoiseKind::Blue | NoiseKind::SpatioTemporalBlue => {
            let masks = blue_noise::ranks();
            let ranks = [0, 1, 2, 3].map(|decision| masks[rank_index(kind, pixel, frame, seed, salt, decision) as usize]);
            mask(kind, pixel, frame, seed, salt, ranks)
        }
    }
}

/// The finest scale along each axis: log2 of cells per metre, clamped to the range from [`LEVEL_MIN`]` + 1` to [`LEVEL_MAX`]. Up to elevations of
/// 10 000 km, a cell of this scale is at least 2^[`STEPS`] times as wide as the distance between neighbouring f32 values. In WGSL: `noise_finest`.
pub fn finest<T: Real>(point: &HashedPoint<T>) -> [i32; 3] {
    let across = finest_along(bounded(point.sector_m, 0.0, 1e12));
    [across, across, finest_along(usable(point.position[2]))]
}

/// The finest scale along an axis whose coordinates have magnitudes up to that of `largest`, m.
fn finest_along<T: Real>(largest: T) -> i32 {
    // log2, rounded to the nearest whole number. It is read from the bits, because the function log2 is not exact, and its rounded result could be
    // wrong by 1.
    let (mantissa, exponent, _) = largest.integer_decode();
    let zeros = mantissa.leading_zeros();
    let is_above = mantissa.unbounded_shl(zeros + 1) >= u64::from(OCTAVE_BORDER) << 41;
    let octave = i32::from(exponent) + 63 - zeros.cast_signed() + i32::from(is_above);
    (FINEST_AT_1_M - octave).clamp(LEVEL_MIN + 1, LEVEL_MAX)
}

/// The finest scale of cells that are equally wide along all axes.
fn finest_of_all<T: Real>(point: &HashedPoint<T>) -> i32 {
    let [x, y, z] = finest(point);
    x.min(y).min(z)
}

/// The level, log2 of cells per metre, at which a cell is `footprint` metres wide, clamped to the range from [`LEVEL_MIN`] to `finest`. The level is
/// `finest` if the footprint is zero or NaN.
fn level<T: Real>(footprint: T, finest: i32) -> T {
    bounded(-bounded(footprint, 1e-6, 1e6).log2(), f64::from(LEVEL_MIN), f64::from(finest))
}

/// The lower of the two whole scales around a level, and the blend weight of the upper scale. The upper scale is always the next integer, at most
/// `finest`. If it were the level rounded up, both scales would be equal for a level that is a whole number.
fn split<T: Real>(level: T, finest: i32) -> (i32, T) {
    let k = level.floor().to_i32().expect("a level is finite and small").min(finest - 1);
    (k, level - T::of(f64::from(k)))
}

fn cell_units<T: Real>(point: &HashedPoint<T>, k: [i32; 3], seed: u32, salt: u32) -> [T; 4] {
    let packed = k.map(|k| (k + 128).cast_unsigned());
    let level = packed[0] | packed[1] << 8 | packed[2] << 16;
    let [x, y, z] = cell(point, k);
    hash::pcg4d([x, y, z, hash::mix(seed, salt, level)]).map(hash::to_unit)
}

/// Smallest position that does not count as 0: 2^-100 m. Its product with any number of cells per metre is not denormal.
const LEAST_M: f64 = 7.888_609_052_210_118e-31;

/// The cell that contains a point: one integer per axis, modulo 2^32. Cells are 2^-`k` m wide along each axis. Borders between cells are at the
/// multiples of the cell width. Along the elevation, they are higher by the share [`BORDER`] of the cell width. The hashed kinds and the white noise
/// of fixed cells hash these integers.
///
/// `k` should be in [`LEVEL_MIN`]`..=`[`LEVEL_MAX`]. With a smaller `k`, a cell could be wider than a sector, and a sector would not have a whole
/// number of cells. With a larger `k`, the number of a cell could exceed i32.
pub fn cell<T: Real>(point: &HashedPoint<T>, k: [i32; 3]) -> [u32; 3] {
    [0, 1, 2].map(|axis: usize| {
        let per_metre = T::of(f64::from(k[axis]).exp2());
        let position = point.position[axis];
        // Tiny positions count as 0. There is a border between two cells at 0. Some devices flush tiny negative numbers to zero and other devices do
        // not, so without this rule, devices would compute different cells.
        let place = if position.abs() >= T::of(LEAST_M) { position } else { T::zero() };
        let scaled = usable(place) * per_metre;
        let is_above = axis == 2 && scaled - scaled.floor() >= T::of(BORDER);
        let in_sector = whole(scaled.floor()) + i64::from(is_above);
        let sectors = point.sector.get(axis).map_or(0, |&s| i64::from(s) * whole(bounded(point.sector_m * per_metre, 0.0, 1e12)));
        wrapped(sectors.wrapping_add(in_sector))
    })
}

/// Converts a whole number to an integer, clamped to the range in which a shader can convert f32 to i32.
fn whole<T: Real>(x: T) -> i64 {
    bounded(x, -2_147_483_520.0, 2_147_483_520.0).to_i64().expect("bounded")
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the numbers of cells wrap at 2^32, as in the shader")]
fn wrapped(cell: i64) -> u32 {
    cell as u32
}

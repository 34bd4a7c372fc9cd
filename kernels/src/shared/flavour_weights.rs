//! Which shading flavours a point needs, and how much of each.
//!
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, "Terrain Shader Variations". Slope divides the surface into cliff, a splat
//! band just flatter than cliff, and ground; distance divides ground into virtual texture and far atlas, cliff into near cliff,
//! far cliff and far atlas; the splat band becomes ground where near cliffs end. Arrays are in the order of [`Flavour::ALL`].
//!
//! [`Flavour::ALL`]: crate::variant::Flavour::ALL

use super::bounded;
use super::real::Real;
use crate::base::wgsl::Constant;
use crate::variant::Flavour;

/// Weights up to this one count as zero: half a step of an 8-bit channel, not worth a flavour's cost.
pub const MIN_WEIGHT: f64 = 1.0 / 512.0;
/// Least weight, before normalisation, of each flavour of a forced variant.
pub const FORCED_WEIGHT: f64 = 1e-3;

/// What `flavour_weights.wgsl` is handed.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("FLAVOUR_BITS", Constant::U32(31)),
    ("FLAVOUR_FAR_ATLAS_BIT", Constant::U32(FAR_ATLAS)),
    ("FLAVOUR_MIN_WEIGHT", Constant::real(MIN_WEIGHT)),
    ("FLAVOUR_FORCED_WEIGHT", Constant::real(FORCED_WEIGHT)),
];

/// Where each flavour applies, as shaders read it (WGSL `FlavourParams`, 48 bytes).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct FlavourParams {
    /// Distance, metres, at which ground goes from virtual texture to far atlas.
    pub far_atlas_m: f32,
    /// Distance, metres, at which cliffs go to the far atlas.
    pub cliff_far_atlas_m: f32,
    /// Distance, metres, at which near cliff goes to far cliff, and splat to ground.
    pub cliff_near_m: f32,
    /// Half the width of a distance blend, as a share of its distance, 0..=1.
    pub distance_blend: f32,
    /// Normal's z at which all is cliff, and at which nothing is: first < second; second <= -1 = no cliffs.
    pub cliff_cos: [f32; 2],
    /// Normal's z at which all that is not cliff is splat, and at which nothing is: first < second.
    pub splat_cos: [f32; 2],
    /// Not 0 = there is a splat band.
    pub splat_enabled: u32,
    /// Not 0 = there is a virtual texture; ground is all far atlas otherwise.
    pub vt_enabled: u32,
    /// To a multiple of 16 bytes, as uniform buffers want it.
    pub padding: [u32; 2],
}

/// Blend weights of the five flavours, >= 0, summing to 1. `distance`: metres along the view ray; `normal_z`: of the unit normal.
/// What is not a number counts as far and flat, the cheapest.
pub fn weights<T: Real>(distance: T, normal_z: T, params: &FlavourParams) -> [T; 5] {
    let one = T::one();
    let distance = if distance < T::of(1e9) { distance.max(T::zero()) } else { T::of(1e9) };
    let normal_z = if normal_z < one { normal_z.max(-one) } else { one };
    let behind = |border: f32| behind(distance, border, params.distance_blend);
    let of_cliff = steep(normal_z, params.cliff_cos);
    let of_rest = if params.splat_enabled == 0 { T::zero() } else { steep(normal_z, params.splat_cos) };

    let near = one - behind(params.cliff_near_m);
    let beyond_cliff = behind(params.cliff_far_atlas_m);
    let beyond_ground = if params.vt_enabled == 0 { one } else { behind(params.far_atlas_m) };

    let cliff = of_cliff * (one - beyond_cliff);
    let splat = (one - of_cliff) * of_rest * near;
    let ground = (one - of_cliff) * (one - of_rest * near);
    [ground * (one - beyond_ground), ground * beyond_ground + of_cliff * beyond_cliff, cliff * near, cliff * (one - near), splat]
}

/// The set of flavours whose weight matters, as bits of [`crate::variant::Flavour`]; never empty (far atlas if nothing else).
pub fn mask<T: Real>(weights: [T; 5]) -> u32 {
    let bits = (0..5).filter(|&i| weights[i] > T::of(MIN_WEIGHT)).map(|i| 1 << i).sum();
    if bits == 0 { FAR_ATLAS } else { bits }
}

/// The weights within a variant's `mask`, summing to 1. What [`mask`] leaves out is zero here too, so that a pixel looks the same in every
/// variant that holds its mask. `forced`: every flavour of the mask gets at least [`FORCED_WEIGHT`], and so is really evaluated.
/// Equal shares where none of the mask has a weight; far atlas where the mask is empty.
pub fn weights_for<T: Real>(weights: [T; 5], mask: u32, forced: bool) -> [T; 5] {
    let mask = if mask & 31 == 0 { FAR_ATLAS } else { mask & 31 };
    let least = T::of(if forced { FORCED_WEIGHT } else { 0.0 });
    let held: [bool; 5] = std::array::from_fn(|i| mask >> i & 1 == 1);
    let cut = |w: T| if w > T::of(MIN_WEIGHT) { w.min(T::one()) } else { T::zero() };
    let mut w: [T; 5] = std::array::from_fn(|i| if held[i] { cut(weights[i]).max(least) } else { T::zero() });
    if w.iter().all(|&x| x <= T::zero()) {
        w = held.map(|h| if h { T::one() } else { T::zero() });
    }
    let sum = w.iter().fold(T::zero(), |s, &x| s + x);
    w.map(|x| x / sum)
}

const FAR_ATLAS: u32 = Flavour::FarAtlas.bit() as u32;

/// 0 below `low`, 1 above `high`, Hermite between; a step where they meet.
fn ramp<T: Real>(x: T, low: T, high: T) -> T {
    let t = bounded((x - low) / (high - low).max(T::of(1e-6)), 0.0, 1.0);
    t * t * (T::of(3.0) - T::of(2.0) * t)
}

/// 0 before a distance, 1 behind it. A distance of 0 is always passed.
fn behind<T: Real>(distance: T, border: f32, blend: f32) -> T {
    let border: T = bounded(T::of(f64::from(border)), 0.0, 1e9);
    let blend: T = bounded(T::of(f64::from(blend)), 0.0, 1.0);
    if border <= T::zero() {
        return T::one();
    }
    ramp(distance, border * (T::one() - blend), border * (T::one() + blend))
}

/// Weight of a slope: 1 where `normal_z` lies below a band of the normal's z (steeper), 0 above it. With [`FlavourParams::cliff_cos`] it is the
/// weight of cliff. 0 throughout if the band ends at -1 or below.
pub fn steep<T: Real>(normal_z: T, band: [f32; 2]) -> T {
    let [low, high]: [T; 2] = band.map(|z| bounded(T::of(f64::from(z)), -1.0, 1.0));
    if high <= -T::one() { T::zero() } else { T::one() - ramp(normal_z, low, high) }
}

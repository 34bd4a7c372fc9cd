//! Which shading flavours a point needs, and their weights. A flavour is one of the five ways in which terrain is shaded.
//!
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, "Terrain Shader Variations". By slope, the surface is divided into ground, the splat
//! band and cliff; the slopes of the splat band are just below those of cliffs. By distance, from near to far:
//!
//! - Ground is shaded by the flavours virtual texture and far atlas.
//! - Cliff is shaded by the flavours near cliff, far cliff and far atlas.
//! - The splat band is shaded by the flavour splat up to the distance at which near cliff ends, and as ground beyond it.
//!
//! Arrays are in the order of [`Flavour::ALL`].
//!
//! [`Flavour::ALL`]: crate::variant::Flavour::ALL

use super::bounded;
use super::real::Real;
use crate::base::wgsl::Constant;
use crate::variant::Flavour;

/// A weight of at most this value counts as zero: a flavour with such a weight changes an 8-bit channel by at most half a step, which is not worth
/// its cost.
pub const MIN_WEIGHT: f64 = 1.0 / 512.0;
/// Smallest weight, before normalisation, of each flavour of a forced variant. A forced variant is used on every tile, whatever flavours the pixels
/// need.
pub const FORCED_WEIGHT: f64 = 1e-3;

const fn place(flavour: Flavour) -> Constant {
    Constant::U32(flavour.index() as u32)
}

const fn bit(flavour: Flavour) -> Constant {
    Constant::U32(flavour.bit() as u32)
}

/// Constants that the host passes to `flavour_weights.wgsl`.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("FLAVOUR_VT", place(Flavour::VirtualTexture)),
    ("FLAVOUR_FAR_ATLAS", place(Flavour::FarAtlas)),
    ("FLAVOUR_NEAR_CLIFF", place(Flavour::NearCliff)),
    ("FLAVOUR_FAR_CLIFF", place(Flavour::FarCliff)),
    ("FLAVOUR_SPLAT", place(Flavour::Splat)),
    ("FLAVOUR_VT_BIT", bit(Flavour::VirtualTexture)),
    ("FLAVOUR_FAR_ATLAS_BIT", bit(Flavour::FarAtlas)),
    ("FLAVOUR_NEAR_CLIFF_BIT", bit(Flavour::NearCliff)),
    ("FLAVOUR_FAR_CLIFF_BIT", bit(Flavour::FarCliff)),
    ("FLAVOUR_SPLAT_BIT", bit(Flavour::Splat)),
    ("FLAVOUR_BITS", Constant::U32((1 << Flavour::ALL.len()) - 1)),
    ("FLAVOUR_MIN_WEIGHT", Constant::real(MIN_WEIGHT)),
    ("FLAVOUR_FORCED_WEIGHT", Constant::real(FORCED_WEIGHT)),
];

/// Distances and slopes at which the flavours change, in the layout that shaders read (WGSL `FlavourParams`, 48 bytes).
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
pub struct FlavourParams {
    /// Distance, metres, at which ground changes from virtual texture to far atlas.
    pub far_atlas_m: f32,
    /// Distance, metres, at which cliffs change to the far atlas.
    pub cliff_far_atlas_m: f32,
    /// Distance, metres, at which near cliff changes to far cliff, and splat to ground.
    pub cliff_near_m: f32,
    /// Half the width of the transition between two flavours, as a share of the distance at which they change, 0..=1.
    pub distance_blend: f32,
    /// Two values of the unit normal's z, first <= second. Surfaces with z below the first are shaded as cliff, surfaces with z above the second are
    /// not. Between the two values, the weight of cliff falls to 0. If the second value is -1 or less, there are no cliffs.
    pub cliff_cos: [f32; 2],
    /// Two values of the unit normal's z, first <= second. Surfaces nearer than `cliff_near_m` that are not cliff are shaded as splat if z is below
    /// the first, and as ground if z is above the second. Between the two values, the weight of splat falls to 0.
    pub splat_cos: [f32; 2],
    /// Not 0 if there is a splat band.
    pub splat_enabled: u32,
    /// Not 0 if there is a virtual texture; otherwise all ground is shaded from the far atlas.
    pub vt_enabled: u32,
    /// Padding to a multiple of 16 bytes, which uniform buffers require.
    pub padding: [u32; 2],
}

/// Blend weights of the five flavours, >= 0, summing to 1. `distance` is in metres along the view ray; `normal_z` is the z component of the unit
/// normal. A distance that is NaN counts as far, a normal that is NaN as flat.
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

/// The set of flavours whose weight is above [`MIN_WEIGHT`], as bits of [`crate::variant::Flavour`]. It is never empty: if no weight is large enough,
/// the set contains only the far atlas.
pub fn mask<T: Real>(weights: [T; 5]) -> u32 {
    let bits = (0..5).filter(|&i| weights[i] > T::of(MIN_WEIGHT)).map(|i| 1 << i).sum();
    if bits == 0 { FAR_ATLAS } else { bits }
}

/// The weights of the flavours in the `mask` of a variant (a shader that contains these flavours), summing to 1. An empty mask counts as far atlas.
/// If no weight of the mask is above [`MIN_WEIGHT`], all flavours of the mask get equal weights.
///
/// If not `forced`, weights of at most [`MIN_WEIGHT`] become 0, as in [`mask()`], so that a pixel looks the same in every variant that contains all
/// flavours of the pixel. If `forced`, every flavour of the mask gets at least [`FORCED_WEIGHT`] before normalisation, so that the shader evaluates
/// it.
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

/// 0 below `low`, 1 above `high`, Hermite interpolation in between; if `low` equals `high`, a step that is 1e-6 wide.
fn ramp<T: Real>(x: T, low: T, high: T) -> T {
    let t = bounded((x - low) / (high - low).max(T::of(1e-6)), 0.0, 1.0);
    t * t * (T::of(3.0) - T::of(2.0) * t)
}

/// 0 if `distance` is nearer than `border`, 1 if it is farther, with a smooth step around the border. `blend` is half the width of the
/// step, as a share of `border`. Every distance is farther than a border of 0.
fn behind<T: Real>(distance: T, border: f32, blend: f32) -> T {
    let border: T = bounded(T::of(f64::from(border)), 0.0, 1e9);
    let blend: T = bounded(T::of(f64::from(blend)), 0.0, 1.0);
    if border <= T::zero() {
        return T::one();
    }
    ramp(distance, border * (T::one() - blend), border * (T::one() + blend))
}

/// Weight of steep surfaces: 1 if `normal_z` is below `band` (steeper), 0 if it is above, and a smooth step inside. If `band` is
/// [`FlavourParams::cliff_cos`], the result is the weight of cliff. Always 0 if the band ends at -1 or below.
pub fn steep<T: Real>(normal_z: T, band: [f32; 2]) -> T {
    let [low, high]: [T; 2] = band.map(|z| bounded(T::of(f64::from(z)), -1.0, 1.0));
    if high <= -T::one() { T::zero() } else { T::one() - ramp(normal_z, low, high) }
}

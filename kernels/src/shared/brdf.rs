//! Microfacet specular reflection: GGX with Smith's height-correlated visibility and Schlick's Fresnel.
//!
//! alpha = perceptual_roughness², perceptual_roughness = 1 - smoothness. Cosines and reflectances are clamped to 0..=1.

use super::bounded;
use super::real::Real;

/// Lower limit of alpha. With a much smaller alpha, the highlight would be narrower than f32 can resolve in n.h.
pub const MIN_ALPHA: f64 = 0.002;

/// alpha for a perceptual roughness, which is clamped to 0..=1. The result is in [`MIN_ALPHA`]..=1.
pub fn alpha<T: Real>(perceptual_roughness: T) -> T {
    let r = bounded(perceptual_roughness, 0.0, 1.0);
    bounded(r * r, MIN_ALPHA, 1.0)
}

/// Normal distribution, 1/sr: alpha² / (pi ((n.h)² (alpha² - 1) + 1)²).
/// Walter et al., *Microfacet Models for Refraction through Rough Surfaces*, EGSR 2007, equation 33.
pub fn d_ggx<T: Real>(n_dot_h: T, alpha: T) -> T {
    let c = bounded(n_dot_h, 0.0, 1.0);
    let a = bounded(alpha, MIN_ALPHA, 1.0);
    // The bracket of the equation, (n.h)² (alpha² - 1) + 1, is computed as sin² + alpha² cos², which does not cancel near n.h = 1.
    let sine_squared = (T::one() - c) * (T::one() + c);
    let ratio = a / (sine_squared + a * a * c * c);
    ratio * ratio / T::of(std::f64::consts::PI)
}

/// Visibility G / (4 n.v n.l), a pure number.
/// Heitz, *Understanding the Masking-Shadowing Function in Microfacet-Based BRDFs*, JCGT 3(2), 2014, equation 99 (height-correlated). The result is
/// at most 5e6, which is its value if n.v and n.l are both 0.
pub fn v_smith_ggx_correlated<T: Real>(n_dot_v: T, n_dot_l: T, alpha: T) -> T {
    let [v, l] = [n_dot_v, n_dot_l].map(|x| bounded(x, 0.0, 1.0));
    let a = bounded(alpha, MIN_ALPHA, 1.0);
    // For a direction whose cosine to the normal is c, `slope` is c sqrt(1 + alpha² tan²). It is multiplied by the cosine of the other direction.
    let slope = |c: T| (c * c + a * a * (T::one() - c * c)).sqrt();
    T::of(0.5) / (l * slope(v) + v * slope(l)).max(T::of(1e-7))
}

/// Fresnel reflectance at cosine `u`; `f0` is the reflectance at normal incidence. Schlick, *An Inexpensive BRDF Model for Physically-based
/// Rendering*, Eurographics 1994.
pub fn f_schlick<T: Real>(f0: [T; 3], u: T) -> [T; 3] {
    let grazing = (T::one() - bounded(u, 0.0, 1.0)).powi(5);
    f0.map(|f| bounded(f, 0.0, 1.0)).map(|f| f + (T::one() - f) * grazing)
}

/// Directional albedo under uniform light, 0..=1. Compared with the integral of this module's BRDF at test points, the result is within 0.1 for
/// dielectrics, but up to 0.31 too dark for metals seen at a grazing angle. Karis, *Physically Based Shading on Mobile*, 2014: an analytic fit in
/// place of the split-sum table, after Lazarov, *Getting More Physical in Call of Duty: Black Ops II*, SIGGRAPH 2013.
pub fn env_approx<T: Real>(f0: [T; 3], perceptual_roughness: T, n_dot_v: T) -> [T; 3] {
    let roughness = bounded(perceptual_roughness, 0.0, 1.0);
    let term = |slope: f64, offset: f64| roughness * T::of(slope) + T::of(offset);
    let [x, y, z, w] = [term(-1.0, 1.0), term(-0.0275, 0.0425), term(-0.572, 1.04), term(0.022, -0.04)];
    let a004 = (x * x).min((T::of(-9.28) * bounded(n_dot_v, 0.0, 1.0)).exp2()) * x + y;
    let (scale, bias) = (T::of(-1.04) * a004 + z, T::of(1.04) * a004 + w);
    f0.map(|f| bounded(bounded(f, 0.0, 1.0) * scale + bias, 0.0, 1.0))
}

//! Lighting in f64 and f32: the reference for `light.wgsl`, written from the publications.

use crate::shared::brdf;
use crate::shared::octahedral;
use crate::shared::real::Real;

/// Reflectance at normal incidence of a dielectric with a refractive index of 1.5: ((1.5 - 1) / (1.5 + 1))².
pub const F0: f64 = 0.04;

/// The light of a scene: linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Light<T> {
    /// Unit vector towards the sun.
    pub sun_direction: [T; 3],
    /// Irradiance on a surface that faces the sun.
    pub sun_irradiance: [T; 3],
    /// Radiance of the sky at the zenith.
    pub zenith: [T; 3],
    /// Radiance of the sky at the horizon.
    pub horizon: [T; 3],
}

/// A point of the G-buffer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface<T> {
    /// Linear albedo.
    pub albedo: [T; 3],
    /// Unit normal.
    pub normal: [T; 3],
    /// 1 - perceptual roughness, 0..=1.
    pub smoothness: T,
    /// Specular occlusion: factor on all specular light, 0..=1.
    pub occlusion: T,
}

/// Radiance of the sky from a direction (unit vector). It is linear in the sine of the elevation angle, and never below 0.
pub fn sky_radiance<T: Real>(light: &Light<T>, direction: [T; 3]) -> [T; 3] {
    std::array::from_fn(|k| (light.horizon[k] + (light.zenith[k] - light.horizon[k]) * direction[2]).max(T::zero()))
}

/// Irradiance of the sky on a surface: the integral of radiance times cosine over the hemisphere around the normal. The radiance is a + b z: a is the
/// radiance at the horizon, b is the radiance at the zenith minus a, and z is the z component of the direction. The integral is then pi (a + 2/3 b
/// `normal[2]`). The factors pi and 2 pi / 3 are the coefficients of the cosine lobe in spherical harmonics of the orders 0 and 1 (Ramamoorthi and
/// Hanrahan 2001, *An Efficient Representation for Irradiance Environment Maps*, equation 8). If a + b z is below 0 in a part of the hemisphere, the
/// result is too small. A result below 0 is replaced by 0.
pub fn sky_irradiance<T: Real>(light: &Light<T>, normal: [T; 3]) -> [T; 3] {
    let two_thirds = T::of(2.0 / 3.0);
    let pi = T::of(std::f64::consts::PI);
    std::array::from_fn(|k| (pi * (light.horizon[k] + two_thirds * (light.zenith[k] - light.horizon[k]) * normal[2])).max(T::zero()))
}

fn dot<T: Real>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Returns two values: the radiance towards the eye, and the part of this radiance that is specular light of the sun. `to_eye`: unit vector.
///
/// Light of the sun is reflected in two ways: as diffuse light (albedo / pi, times 1 minus the Fresnel reflectance) and as specular light (GGX).
/// Light of the sky is also reflected in two ways: as diffuse light (albedo / pi, times irradiance) and as specular light (the fit of the split-sum
/// table, times the radiance from the mirror direction). At grazing angles, the normal of the G-buffer may face away from the eye. The dot product of
/// the normal and `to_eye` is therefore raised to at least 0.001, as in the shader. The mirror direction uses the dot product as it is.
pub fn radiance<T: Real>(surface: &Surface<T>, light: &Light<T>, to_eye: [T; 3]) -> ([T; 3], [T; 3]) {
    let n = surface.normal;
    let half = octahedral::unit(std::array::from_fn(|k| light.sun_direction[k] + to_eye[k]));
    let n_dot_v = dot(n, to_eye).max(T::of(1e-3));
    let n_dot_l = dot(n, light.sun_direction).max(T::zero());
    let roughness = T::one() - surface.smoothness;
    let alpha = brdf::alpha(roughness);
    let f0 = [T::of(F0); 3];
    let fresnel = brdf::f_schlick(f0, dot(light.sun_direction, half).max(T::zero()));
    let lobe = brdf::d_ggx(dot(n, half).max(T::zero()), alpha) * brdf::v_smith_ggx_correlated(n_dot_v, n_dot_l, alpha);
    let cosine = dot(n, to_eye);
    let mirrored = std::array::from_fn(|k| T::of(2.0) * cosine * n[k] - to_eye[k]);
    let (sky, environment, ambient) = (sky_radiance(light, mirrored), brdf::env_approx(f0, roughness, n_dot_v), sky_irradiance(light, n));
    let pi = T::of(std::f64::consts::PI);
    let highlight = std::array::from_fn(|k| lobe * fresnel[k] * surface.occlusion * light.sun_irradiance[k] * n_dot_l);
    let rest = |k: usize| {
        let diffuse = surface.albedo[k] / pi * ((T::one() - fresnel[k]) * light.sun_irradiance[k] * n_dot_l + ambient[k]);
        diffuse + environment[k] * sky[k] * surface.occlusion
    };
    (std::array::from_fn(|k| rest(k) + highlight[k]), highlight)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIGHT: Light<f64> =
        Light { sun_direction: [0.6, 0.0, 0.8], sun_irradiance: [3.0, 2.0, 1.0], zenith: [0.2, 0.4, 0.8], horizon: [0.5, 0.6, 0.7] };

    /// Unit vectors spread evenly over the sphere (a Fibonacci spiral).
    fn sphere(count: u32) -> impl Iterator<Item = [f64; 3]> {
        (0..count).map(move |i| {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(count);
            let turn = f64::from(i) * std::f64::consts::PI * (3.0 - 5f64.sqrt());
            let r = (1.0 - z * z).sqrt();
            [r * turn.cos(), r * turn.sin(), z]
        })
    }

    #[test]
    fn the_irradiance_of_the_sky_is_the_integral_of_its_radiance() {
        // The formula is exact if the radiance is above 0 everywhere. This horizon is bright enough for that.
        let light = Light { horizon: [1.0, 2.0, 0.9], ..LIGHT };
        let count = 20_000;
        for n in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, 1.0, 0.0], [0.0, -0.6, -0.8]] {
            let mut sums = [0.0; 3];
            for w in sphere(count) {
                let cosine = dot(n, w).max(0.0);
                let radiance = sky_radiance(&light, w);
                (0..3).for_each(|k| sums[k] += radiance[k] * cosine * 4.0 * std::f64::consts::PI / f64::from(count));
            }
            let exact = sky_irradiance(&light, n);
            assert!((0..3).all(|k| (sums[k] - exact[k]).abs() < 1e-3 * exact[k]), "{n:?}: {sums:?} {exact:?}");
        }
    }

    #[test]
    fn a_rough_white_surface_reflects_no_more_than_it_receives() {
        let surface = Surface { albedo: [1.0; 3], normal: [0.0, 0.0, 1.0], smoothness: 0.0, occlusion: 1.0 };
        let count = 4000;
        let mut out = [0.0; 3];
        for v in sphere(count).filter(|v| v[2] > 0.0) {
            let (radiance, _) = radiance(&surface, &LIGHT, v);
            (0..3).for_each(|k| out[k] += radiance[k] * v[2] * 4.0 * std::f64::consts::PI / f64::from(count));
        }
        let ambient = sky_irradiance(&LIGHT, surface.normal);
        for k in 0..3 {
            let received = LIGHT.sun_irradiance[k] * 0.8 + ambient[k];
            // For the sun, the Fresnel reflectance divides the received light between diffuse and specular reflection. For the sky, specular light is
            // added to diffuse light that is not reduced. The total may therefore exceed the received light, but only by a few per cent.
            assert!(out[k] > 0.9 * received && out[k] < 1.06 * received, "{k}: {} of {received}", out[k]);
        }
    }

    #[test]
    fn occlusion_removes_specular_light_and_nothing_else() {
        let lit = Surface { albedo: [0.0; 3], normal: [0.0, 0.0, 1.0], smoothness: 0.7, occlusion: 1.0 };
        let to_eye = [-0.6, 0.0, 0.8];
        let (all, highlight) = radiance(&lit, &LIGHT, to_eye);
        assert!((0..3).all(|k| highlight[k] > 0.0 && all[k] > highlight[k]));
        let (none, _) = radiance(&Surface { occlusion: 0.0, ..lit }, &LIGHT, to_eye);
        assert_eq!(none, [0.0; 3]);
        let (half, _) = radiance(&Surface { occlusion: 0.5, ..lit }, &LIGHT, to_eye);
        assert!((0..3).all(|k| (half[k] - 0.5 * all[k]).abs() < 1e-15));
    }
}

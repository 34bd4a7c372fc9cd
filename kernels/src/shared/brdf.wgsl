// Microfacet specular reflection: GGX with Smith's height-correlated visibility and Schlick's Fresnel.
// alpha = perceptual_roughness²; perceptual_roughness = 1 - smoothness.

// Lower limit of alpha. With a much smaller alpha, the highlight would be too narrow for f32 to resolve in n.h.
const BRDF_MIN_ALPHA: f32 = 0.002;
const BRDF_PI: f32 = 3.14159265;

fn brdf_unit(x: f32) -> f32 {
    return usable_positive_1(x, 1.0);
}

fn brdf_clamped_alpha(alpha: f32) -> f32 {
    return max(usable_positive_1(alpha, 1.0), BRDF_MIN_ALPHA);
}

// alpha for a perceptual roughness, which is clamped to 0..=1. The result is in BRDF_MIN_ALPHA..=1.
fn brdf_alpha(perceptual_roughness: f32) -> f32 {
    let r = brdf_unit(perceptual_roughness);
    return brdf_clamped_alpha(r * r);
}

// Normal distribution, 1/sr. Walter et al., "Microfacet Models for Refraction through Rough Surfaces", EGSR 2007.
fn brdf_d_ggx(n_dot_h: f32, alpha: f32) -> f32 {
    let c = brdf_unit(n_dot_h);
    let a = brdf_clamped_alpha(alpha);
    // d is 1 - c² (1 - a²). The part 1 - c² is written as a product, because the difference would cancel near c = 1.
    let d = (1.0 - c) * (1.0 + c) + c * c * a * a;
    return (a / d) * (a / d) / BRDF_PI;
}

// Visibility G / (4 n.v n.l), a pure number. Heitz, "Understanding the Masking-Shadowing Function", JCGT 3(2), 2014.
fn brdf_v_smith_ggx_correlated(n_dot_v: f32, n_dot_l: f32, alpha: f32) -> f32 {
    let v = brdf_unit(n_dot_v);
    let l = brdf_unit(n_dot_l);
    let a = brdf_clamped_alpha(alpha);
    let a2 = a * a;
    let lambda_v = l * sqrt(v * v * (1.0 - a2) + a2);
    let lambda_l = v * sqrt(l * l * (1.0 - a2) + a2);
    return 0.5 / max(lambda_v + lambda_l, 1e-7);
}

// Fresnel reflectance at cosine u; f0 is the reflectance at normal incidence. Schlick, "An Inexpensive BRDF Model", 1994.
fn brdf_f_schlick(f0: vec3<f32>, u: f32) -> vec3<f32> {
    let f = vec3<f32>(brdf_unit(f0.x), brdf_unit(f0.y), brdf_unit(f0.z));
    let m = 1.0 - brdf_unit(u);
    let m2 = m * m;
    return f + (vec3<f32>(1.0) - f) * (m2 * m2 * m);
}

// Directional albedo under uniform light, 0..=1. The result is within 0.1 of the integral of this file's BRDF for dielectrics, but up to 0.31 too
// dark for metals seen at a grazing angle. Karis, "Physically Based Shading on Mobile", 2014: an analytic fit in place of the split-sum table, after
// Lazarov, "Getting More Physical in Call of Duty: Black Ops II", SIGGRAPH 2013.
fn brdf_env_approx(f0: vec3<f32>, perceptual_roughness: f32, n_dot_v: f32) -> vec3<f32> {
    let f = vec3<f32>(brdf_unit(f0.x), brdf_unit(f0.y), brdf_unit(f0.z));
    let r = brdf_unit(perceptual_roughness) * vec4<f32>(-1.0, -0.0275, -0.572, 0.022) + vec4<f32>(1.0, 0.0425, 1.04, -0.04);
    let a004 = min(r.x * r.x, exp2(-9.28 * brdf_unit(n_dot_v))) * r.x + r.y;
    let ab = vec2<f32>(-1.04, 1.04) * a004 + r.zw;
    return clamp(f * ab.x + vec3<f32>(ab.y), vec3<f32>(0.0), vec3<f32>(1.0));
}

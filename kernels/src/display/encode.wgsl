// The mapping from linear radiance to what a screen shows: exposure, tone curve, sRGB.

struct DisplayUniforms {
    exposure: f32,              // factor on radiance
    curve: u32,                 // DISPLAY_REINHARD; any other value = clip
    pad_0: u32,
    pad_1: u32,
}

// Tone curve: Reinhard et al. 2002, equation 4, applied to the luminance. All channels get the same factor, so their ratios are kept.
fn display_reinhard(radiance: vec3<f32>) -> vec3<f32> {
    let luminance = dot(radiance, vec3<f32>(DISPLAY_RED, DISPLAY_GREEN, DISPLAY_BLUE));
    if luminance <= 0.0 {
        return vec3<f32>(0.0);
    }
    return radiance * ((1.0 + luminance / (DISPLAY_WHITE * DISPLAY_WHITE)) / (1.0 + luminance));
}

// Encodes linear values as sRGB (IEC 61966-2-1). Values are clamped to 0..=1; NaN becomes 0.
fn display_srgb(linear: vec3<f32>) -> vec3<f32> {
    let held = vec3<f32>(usable_positive_1(linear.r, 1.0), usable_positive_1(linear.g, 1.0), usable_positive_1(linear.b, 1.0));
    return select(1.055 * pow(held, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * held, held <= vec3<f32>(0.0031308));
}

// Maps linear radiance to sRGB-encoded values, 0..=1 up to rounding.
fn display_encode(radiance: vec3<f32>, how: DisplayUniforms) -> vec3<f32> {
    var linear = radiance * how.exposure;
    if how.curve == DISPLAY_REINHARD {
        linear = display_reinhard(linear);
    }
    return display_srgb(linear);
}

// Display: maps linear HDR radiance to sRGB-encoded values.

struct DisplayUniforms {
    exposure: f32,              // factor on radiance
    curve: u32,                 // DISPLAY_REINHARD; any other value = clip
    pad_0: u32,
    pad_1: u32,
}

@group(0) @binding(0) var<uniform> display: DisplayUniforms;
@group(0) @binding(1) var display_image: texture_2d<f32>;

@vertex
fn display_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return full_screen_position(vertex);
}

// Reinhard et al. 2002, equation 4, on luminance; the ratios of the channels are kept.
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

@fragment
fn display_fragment(@builtin(position) clip: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = textureLoad(display_image, vec2<u32>(clip.xy), 0);
    var linear = texel.rgb * display.exposure;
    if display.curve == DISPLAY_REINHARD {
        linear = display_reinhard(linear);
    }
    return vec4<f32>(display_srgb(linear), texel.a);
}

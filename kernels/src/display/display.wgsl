// Display: writes the sRGB-encoded picture of linear HDR radiance.

@group(0) @binding(0) var<uniform> display: DisplayUniforms;
@group(0) @binding(1) var display_image: texture_2d<f32>;

@vertex
fn display_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return full_screen_position(vertex);
}

@fragment
fn display_fragment(@builtin(position) clip: vec4<f32>) -> @location(0) vec4<f32> {
    let texel = textureLoad(display_image, vec2<u32>(clip.xy), 0);
    return vec4<f32>(display_encode(texel.rgb, display), texel.a);
}

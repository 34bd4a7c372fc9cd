// Lighting: writes the linear HDR radiance of each pixel.

@group(1) @binding(0) var g_albedo: texture_2d<f32>;
@group(1) @binding(1) var g_normal: texture_2d<f32>;
@group(1) @binding(2) var depth_target: texture_depth_2d;

@vertex
fn lighting_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return full_screen_position(vertex);
}

@fragment
fn lighting_fragment(@builtin(position) clip: vec4<f32>) -> @location(0) vec4<f32> {
    let index = vec2<u32>(clip.xy);
    let ray = normalize(frame_ray(vec2<f32>(index)));
    let depth = textureLoad(depth_target, index, 0);
    if depth <= 0.0 {
        return vec4<f32>(lighting_sky_radiance(vec3<f32>(ray.xy, max(ray.z, 0.0))), 0.0);
    }
    let albedo_occlusion = textureLoad(g_albedo, index, 0);
    let normal_smoothness = textureLoad(g_normal, index, 0);
    let surface = LightingSurface(albedo_occlusion.rgb, albedo_occlusion.a, normal_smoothness.xyz, normal_smoothness.w);
    return vec4<f32>(lighting_radiance(surface, ray), 1.0);
}

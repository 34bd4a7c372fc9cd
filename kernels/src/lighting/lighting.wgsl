// Lighting: linear HDR radiance under one sun (GGX + Lambert) and a sky that is linear in the sine of the elevation.

// The host passes the constant LIGHTING_F0: the reflectance of the ground at normal incidence.

@group(1) @binding(0) var g_albedo: texture_2d<f32>;
@group(1) @binding(1) var g_normal: texture_2d<f32>;
@group(1) @binding(2) var depth_target: texture_depth_2d;

@vertex
fn lighting_vertex(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return full_screen_position(vertex);
}

fn lighting_sky_radiance(direction: vec3<f32>) -> vec3<f32> {
    return max(mix(frame.sky_horizon, frame.sky_zenith, direction.z), vec3<f32>(0.0));
}

// Irradiance of the sky: the integral of radiance times cosine over the hemisphere around the normal. The radiance of the sky is a + b z, where z is
// the z component of the direction. The integral is then pi (a + 2/3 b normal.z).
fn lighting_sky_irradiance(normal: vec3<f32>) -> vec3<f32> {
    return max(BRDF_PI * (frame.sky_horizon + (2.0 / 3.0) * (frame.sky_zenith - frame.sky_horizon) * normal.z), vec3<f32>(0.0));
}

@fragment
fn lighting_fragment(@builtin(position) clip: vec4<f32>) -> @location(0) vec4<f32> {
    let index = vec2<u32>(clip.xy);
    let ray = normalize(frame_ray(vec2<f32>(index)));
    let depth = textureLoad(depth_target, index, 0);
    if depth <= 0.0 {
        return vec4<f32>(lighting_sky_radiance(vec3<f32>(ray.xy, max(ray.z, 0.0))), 0.0);
    }
    let surface = textureLoad(g_albedo, index, 0);
    let normal_smoothness = textureLoad(g_normal, index, 0);
    let n = normal_smoothness.xyz;
    let v = -ray;
    let l = frame.sun_direction;
    // If the view points straight at the sun, l + v is 0 and has no direction. `octahedral_unit` then returns the z axis and not NaN.
    let h = octahedral_unit(l + v);
    let roughness = 1.0 - normal_smoothness.w;
    let alpha = brdf_alpha(roughness);
    let n_dot_v = max(dot(n, v), 1e-3);
    let n_dot_l = max(dot(n, l), 0.0);
    let f0 = vec3<f32>(LIGHTING_F0);
    let fresnel = brdf_f_schlick(f0, max(dot(l, h), 0.0));
    let specular = brdf_d_ggx(max(dot(n, h), 0.0), alpha) * brdf_v_smith_ggx_correlated(n_dot_v, n_dot_l, alpha) * fresnel * surface.a;
    let sun = (surface.rgb / BRDF_PI * (1.0 - fresnel) + specular) * frame.sun_irradiance * n_dot_l;
    let sky_diffuse = surface.rgb / BRDF_PI * lighting_sky_irradiance(n);
    let sky_specular = brdf_env_approx(f0, roughness, n_dot_v) * lighting_sky_radiance(reflect(ray, n)) * surface.a;
    return vec4<f32>(sun + sky_diffuse + sky_specular, 1.0);
}

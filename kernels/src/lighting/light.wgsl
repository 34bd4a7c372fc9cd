// Radiance of a point of the ground under one sun (GGX + Lambert) and a sky whose radiance is linear in the sine of the elevation angle.

// The host passes the constant LIGHTING_F0: the reflectance of the ground at normal incidence.

// The surface at a pixel, as read from the G-buffer.
struct LightingSurface {
    albedo: vec3<f32>,
    occlusion: f32,     // factor on all specular light, 0..=1
    normal: vec3<f32>,  // unit
    smoothness: f32,    // 1 - perceptual roughness, 0..=1
}

fn lighting_sky_radiance(direction: vec3<f32>) -> vec3<f32> {
    return max(mix(frame.sky_horizon, frame.sky_zenith, direction.z), vec3<f32>(0.0));
}

// Irradiance of the sky: the integral of radiance times cosine over the hemisphere around the normal. The radiance of the sky is a + b z: a is the
// radiance at the horizon, b is the radiance at the zenith minus a, and z is the z component of the direction. The integral is then pi (a + 2/3 b
// normal.z). The formula is exact only if a + b z is nowhere below 0.
fn lighting_sky_irradiance(normal: vec3<f32>) -> vec3<f32> {
    return max(BRDF_PI * (frame.sky_horizon + (2.0 / 3.0) * (frame.sky_zenith - frame.sky_horizon) * normal.z), vec3<f32>(0.0));
}

// Radiance from a surface towards the eye. `ray`: unit vector from the eye to the surface.
fn lighting_radiance(surface: LightingSurface, ray: vec3<f32>) -> vec3<f32> {
    let n = surface.normal;
    let v = -ray;
    let l = frame.sun_direction;
    // If the view points straight at the sun, l + v is 0 and has no direction. `octahedral_unit` then returns the z axis and not NaN.
    let h = octahedral_unit(l + v);
    let roughness = 1.0 - surface.smoothness;
    let alpha = brdf_alpha(roughness);
    let n_dot_v = max(dot(n, v), 1e-3);
    let n_dot_l = max(dot(n, l), 0.0);
    let f0 = vec3<f32>(LIGHTING_F0);
    let fresnel = brdf_f_schlick(f0, max(dot(l, h), 0.0));
    let lobe = brdf_d_ggx(max(dot(n, h), 0.0), alpha) * brdf_v_smith_ggx_correlated(n_dot_v, n_dot_l, alpha);
    let specular = lobe * fresnel * surface.occlusion;
    let sun = (surface.albedo / BRDF_PI * (1.0 - fresnel) + specular) * frame.sun_irradiance * n_dot_l;
    let sky_diffuse = surface.albedo / BRDF_PI * lighting_sky_irradiance(n);
    let sky_specular = brdf_env_approx(f0, roughness, n_dot_v) * lighting_sky_radiance(reflect(ray, n)) * surface.occlusion;
    return sun + sky_diffuse + sky_specular;
}

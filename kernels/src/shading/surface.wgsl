// The surface of a pixel: the flavours of a mask, blended by their weights.

struct ShadedSurface {
    albedo: vec3<f32>,
    normal: vec3<f32>,          // not normalised
    smoothness: f32,
    occlusion: f32,
}

fn shade_surface(pixel: Pixel, mask: u32, weights: array<f32, 5>) -> ShadedSurface {
    var albedo = vec3<f32>(0.0);
    var normal = vec3<f32>(0.0);
    var smoothness = 0.0;
    var occlusion = 0.0;
    if RUNS_VT {
        if (mask & 1u) != 0u && weights[FLAVOUR_VT] > 0.0 {
            let s = shade_virtual_texture(pixel);
            let w = weights[FLAVOUR_VT];
            albedo += w * s.albedo;
            normal += w * triplanar_perturb(pixel.normal, s.gradient);
            smoothness += w * s.smoothness;
            occlusion += w * s.specular_occlusion;
        }
    }
    if (mask & 30u) != 0u {
        // All flavours but the virtual texture share one colour modulation; the pages of the virtual texture already contain it.
        var sum = surface_zero();
        var share = 0.0;
        if RUNS_FAR_ATLAS {
            if (mask & 2u) != 0u && weights[FLAVOUR_FAR_ATLAS] > 0.0 {
                let far = shade_far_atlas(pixel);
                let w = weights[FLAVOUR_FAR_ATLAS];
                sum = surface_add(sum, w, far.surface);
                normal += w * far.normal;
                share += w;
            }
        }
        if RUNS_NEAR_CLIFF {
            if (mask & 4u) != 0u && weights[FLAVOUR_NEAR_CLIFF] > 0.0 {
                let s = shade_near_cliff(pixel);
                let w = weights[FLAVOUR_NEAR_CLIFF];
                sum = surface_add(sum, w, s);
                normal += w * triplanar_perturb(pixel.normal, s.gradient);
                share += w;
            }
        }
        if RUNS_FAR_CLIFF {
            if (mask & 8u) != 0u && weights[FLAVOUR_FAR_CLIFF] > 0.0 {
                let s = shade_far_cliff(pixel);
                let w = weights[FLAVOUR_FAR_CLIFF];
                sum = surface_add(sum, w, s);
                normal += w * triplanar_perturb(pixel.normal, s.gradient);
                share += w;
            }
        }
        if RUNS_SPLAT {
            if (mask & 16u) != 0u && weights[FLAVOUR_SPLAT] > 0.0 {
                let s = shade_splat(pixel);
                let w = weights[FLAVOUR_SPLAT];
                sum = surface_add(sum, w, s);
                normal += w * triplanar_perturb(pixel.normal, s.gradient);
                share += w;
            }
        }
        if share > 0.0 {
            albedo += sum.albedo * terrain_colour_modulation(pixel.node);
            smoothness += sum.smoothness;
            occlusion += sum.specular_occlusion;
        }
    }
    return ShadedSurface(albedo, normal, smoothness, occlusion);
}

// The theoretical variance of a pixel's albedo over seeds. Only the stochastic flavours have a variance, and their random numbers are independent.
fn shade_variance(pixel: Pixel, mask: u32, weights: array<f32, 5>) -> ShadedSurface {
    var variance = vec3<f32>(0.0);
    if RUNS_NEAR_CLIFF {
        if (mask & 4u) != 0u && weights[FLAVOUR_NEAR_CLIFF] > 0.0 {
            variance += weights[FLAVOUR_NEAR_CLIFF] * weights[FLAVOUR_NEAR_CLIFF] * shade_near_cliff(pixel).albedo;
        }
    }
    if RUNS_FAR_CLIFF {
        if (mask & 8u) != 0u && weights[FLAVOUR_FAR_CLIFF] > 0.0 {
            variance += weights[FLAVOUR_FAR_CLIFF] * weights[FLAVOUR_FAR_CLIFF] * shade_far_cliff(pixel).albedo;
        }
    }
    let modulation = terrain_colour_modulation(pixel.node);
    // Scaled, so that f16 values stay out of the range of denormals.
    return ShadedSurface(variance * modulation * modulation * SHADING_VARIANCE_SCALE, pixel.normal, 0.0, 0.0);
}

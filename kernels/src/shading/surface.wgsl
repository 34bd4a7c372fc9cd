// The surface of a pixel: the flavours of a mask, blended by their weights.

struct ShadedSurface {
    albedo: vec3<f32>,
    normal: vec3<f32>,          // not normalised
    smoothness: f32,
    occlusion: f32,
}

// Weighted sum of the flavours that have been blended so far.
struct SurfaceSum {
    surface: Surface,
    normal: vec3<f32>,
    weight: f32,
}

// Whether a pixel evaluates a flavour: its bit is in the mask, and its weight is above 0.
fn shade_evaluates(mask: u32, bit: u32, weight: f32) -> bool {
    return flavour_is_in(mask, bit) && weight > 0.0;
}

// Adds a flavour to the sum. The gradient of its surface perturbs the shading normal.
fn shade_add(sum: ptr<function, SurfaceSum>, pixel: Pixel, weight: f32, s: Surface) {
    (*sum).surface = surface_add((*sum).surface, weight, s);
    (*sum).normal += weight * triplanar_perturb(pixel.normal, s.gradient);
    (*sum).weight += weight;
}

fn shade_surface(pixel: Pixel, mask: u32, weights: array<f32, 5>) -> ShadedSurface {
    var pages = SurfaceSum(surface_zero(), vec3<f32>(0.0), 0.0);
    if RUNS_VT {
        if shade_evaluates(mask, FLAVOUR_VT_BIT, weights[FLAVOUR_VT]) {
            shade_add(&pages, pixel, weights[FLAVOUR_VT], shade_virtual_texture(pixel));
        }
    }
    // All flavours except the virtual texture share one fetch of colour modulation. The pages of the virtual texture already contain this factor.
    var sum = SurfaceSum(surface_zero(), pages.normal, 0.0);
    if RUNS_FAR_ATLAS {
        if shade_evaluates(mask, FLAVOUR_FAR_ATLAS_BIT, weights[FLAVOUR_FAR_ATLAS]) {
            let far = shade_far_atlas(pixel);
            let w = weights[FLAVOUR_FAR_ATLAS];
            sum.surface = surface_add(sum.surface, w, far.surface);
            sum.normal += w * far.normal;
            sum.weight += w;
        }
    }
    if RUNS_NEAR_CLIFF {
        if shade_evaluates(mask, FLAVOUR_NEAR_CLIFF_BIT, weights[FLAVOUR_NEAR_CLIFF]) {
            shade_add(&sum, pixel, weights[FLAVOUR_NEAR_CLIFF], shade_near_cliff(pixel));
        }
    }
    if RUNS_FAR_CLIFF {
        if shade_evaluates(mask, FLAVOUR_FAR_CLIFF_BIT, weights[FLAVOUR_FAR_CLIFF]) {
            shade_add(&sum, pixel, weights[FLAVOUR_FAR_CLIFF], shade_far_cliff(pixel));
        }
    }
    if RUNS_SPLAT {
        if shade_evaluates(mask, FLAVOUR_SPLAT_BIT, weights[FLAVOUR_SPLAT]) {
            shade_add(&sum, pixel, weights[FLAVOUR_SPLAT], shade_splat(pixel));
        }
    }
    var shaded = ShadedSurface(pages.surface.albedo, sum.normal, pages.surface.smoothness, pages.surface.specular_occlusion);
    if sum.weight > 0.0 {
        shaded.albedo += sum.surface.albedo * terrain_colour_modulation(pixel.node);
        shaded.smoothness += sum.surface.smoothness;
        shaded.occlusion += sum.surface.specular_occlusion;
    }
    return shaded;
}

// Returns the theoretical variance of a pixel's albedo over seeds. Only near cliff and far cliff are stochastic. Their random numbers are
// independent, so their variances add with squared weights.
fn shade_variance(pixel: Pixel, mask: u32, weights: array<f32, 5>) -> ShadedSurface {
    var variance = vec3<f32>(0.0);
    if RUNS_NEAR_CLIFF {
        if shade_evaluates(mask, FLAVOUR_NEAR_CLIFF_BIT, weights[FLAVOUR_NEAR_CLIFF]) {
            variance += weights[FLAVOUR_NEAR_CLIFF] * weights[FLAVOUR_NEAR_CLIFF] * shade_near_cliff(pixel).albedo;
        }
    }
    if RUNS_FAR_CLIFF {
        if shade_evaluates(mask, FLAVOUR_FAR_CLIFF_BIT, weights[FLAVOUR_FAR_CLIFF]) {
            variance += weights[FLAVOUR_FAR_CLIFF] * weights[FLAVOUR_FAR_CLIFF] * shade_far_cliff(pixel).albedo;
        }
    }
    let modulation = terrain_colour_modulation(pixel.node);
    // The variance is scaled, so that usual values are not denormal in f16.
    return ShadedSurface(variance * modulation * modulation * SHADING_VARIANCE_SCALE, pixel.normal, 0.0, 0.0);
}

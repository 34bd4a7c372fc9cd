// The projections of an estimator, and the estimator's blend of all materials in one projection.

// Sets the projections of the estimator, and their weights.
fn shade_project(pixel: ptr<function, Pixel>) {
    (*pixel).planes = vec3<u32>(0u, 1u, 2u);
    if IS_BIPLANAR {
        shade_biplanar_project(pixel);
    } else if ESTIMATOR == ESTIMATOR_SNAPPED {
        shade_snapped_project(pixel);
    } else if ESTIMATOR == ESTIMATOR_LUNA8 {
        shade_luna8_project(pixel);
    } else {
        (*pixel).projections = triplanar_weights((*pixel).normal, frame.triplanar_sharpness);
    }
}

// Blends all materials of a splat cell by the method of the estimator. 16 fetches; 40 with hex tiling, 20 for `laplacian`, 28 for `luna8`.
fn shade_blend(pixel: Pixel, projection: Projection, scale: u32) -> Surface {
    if ESTIMATOR == ESTIMATOR_LAPLACIAN {
        return shade_laplacian_blend(pixel, projection, scale);
    }
    if ESTIMATOR == ESTIMATOR_LUNA8 {
        return shade_luna8_blend(pixel, projection, scale);
    }
    return terrain_splat_blend(pixel.cell, projection, scale);
}

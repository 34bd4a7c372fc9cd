// Far Cry 5's estimator (Moore, GDC 2018, "Cliff Shading"): random choices on cliffs. The estimators `biplanar` and, on near cliff, `hex` also call
// these functions.

// Blends all projections. Each projection uses one splat material that is chosen at random. 12 fetches; 8 with two projections, 30 with hex tiling.
fn shade_fc5_near_cliff(pixel: Pixel) -> Surface {
    var sum = surface_zero();
    let thresholds = shade_noise(pixel, SALT_NEAR_CLIFF);
    let weights = splat_blend_bilinear(pixel.cell.fraction);
    for (var i = 0u; i < shade_projections(); i++) {
        let texel = select_of_4(weights, thresholds[i]);
        // Diagnostics record the material that is chosen for the first projection. The projection itself is not chosen, because all projections are
        // blended.
        shade_choose(texel, 0u);
        let tap = terrain_tap(pixel.cell, texel, terrain_projection(pixel.planes[i], pixel.footprint), 0u);
        sum = surface_add(sum, pixel.projections[i], tap);
    }
    return sum;
}

// Blends two tiling scales. Each scale uses one projection and one material that are chosen at random. 8 fetches.
fn shade_fc5_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    let shares = vec2<f32>(1.0 - pixel.tiling.y, pixel.tiling.y);
    var sum = surface_zero();
    let thresholds = shade_noise(pixel, SALT_FAR_CLIFF);
    let weights = splat_blend_bilinear(pixel.cell.fraction);
    for (var t = 0u; t < frame.taps - 2u; t++) {
        let plane = pixel.planes[select_of_3(pixel.projections, thresholds[2u * t])];
        let texel = select_of_4(weights, thresholds[2u * t + 1u]);
        shade_choose(texel, plane);
        let tap = terrain_tap(pixel.cell, texel, terrain_projection(plane, pixel.footprint), lower + t);
        sum = surface_add(sum, shares[t], tap);
    }
    return sum;
}

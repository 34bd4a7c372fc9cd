// The exact blend: the mean over all random choices of `fc5`, `biplanar` or `hex`. It serves the estimators `exact`, `biplanar-mean` and `hex-mean`.

fn shade_mean_near_cliff(pixel: Pixel) -> Surface {
    var sum = surface_zero();
    for (var i = 0u; i < shade_projections(); i++) {
        let mean = terrain_splat_mean(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), 0u);
        sum = surface_add(sum, pixel.projections[i], mean);
    }
    return sum;
}

fn shade_mean_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    let shares = vec2<f32>(1.0 - pixel.tiling.y, pixel.tiling.y);
    var sum = surface_zero();
    for (var t = 0u; t < frame.taps - 2u; t++) {
        for (var i = 0u; i < shade_projections(); i++) {
            let mean = terrain_splat_mean(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), lower + t);
            sum = surface_add(sum, shares[t] * pixel.projections[i], mean);
        }
    }
    return sum;
}

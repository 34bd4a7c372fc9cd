// The theoretical variance of `fc5` over seeds, in place of albedo.

fn shade_variance_near_cliff(pixel: Pixel) -> Surface {
    var sum = surface_zero();
    // The materials of the three projections are chosen independently, so the variances of the projections add with squared weights.
    for (var i = 0u; i < shade_projections(); i++) {
        let moments = terrain_splat_moments(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), 0u);
        let w = pixel.projections[i];
        sum.albedo += w * w * max(moments.square - moments.mean * moments.mean, vec3<f32>(0.0));
    }
    return sum;
}

fn shade_variance_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    let shares = vec2<f32>(1.0 - pixel.tiling.y, pixel.tiling.y);
    var sum = surface_zero();
    // Each tiling scale has one choice among 3 projections x 4 materials. The choices of the two scales are independent.
    for (var t = 0u; t < frame.taps - 2u; t++) {
        var mean = vec3<f32>(0.0);
        var square = vec3<f32>(0.0);
        for (var i = 0u; i < shade_projections(); i++) {
            let moments = terrain_splat_moments(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), lower + t);
            mean += pixel.projections[i] * moments.mean;
            square += pixel.projections[i] * moments.square;
        }
        sum.albedo += shares[t] * shares[t] * max(square - mean * mean, vec3<f32>(0.0));
    }
    return sum;
}

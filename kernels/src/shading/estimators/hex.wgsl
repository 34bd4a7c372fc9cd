// Far cliff of the estimator `hex`: hex-tiled textures replace the second tiling scale (Mikkelsen, JCGT 11(2), 2022). Near cliff is shaded by the
// function of `fc5`, with hex-tiled textures.

// Samples one tiling scale, which is chosen at random from two. 10 fetches.
fn shade_hex_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    let thresholds = shade_noise(pixel, SALT_FAR_CLIFF);
    let weights = splat_blend_bilinear(pixel.cell.fraction);
    // `fc5` blends two scales to hide repetition. Hex tiling already hides it by random offsets, so one scale is enough. The scale is chosen at
    // random, because a fixed choice would change the scale abruptly at some distances.
    let plane = pixel.planes[select_of_3(pixel.projections, thresholds.x)];
    let texel = select_of_4(weights, thresholds.y);
    shade_choose(texel, plane);
    let scale = lower + select(0u, 1u, thresholds.z < pixel.tiling.y);
    return terrain_tap(pixel.cell, texel, terrain_projection(plane, pixel.footprint), scale);
}

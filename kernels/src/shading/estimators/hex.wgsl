// Hex-tiled textures in place of the second tiling scale (Mikkelsen, JCGT 11(2), 2022). Near cliff is that of `fc5` with hex-tiled textures.

// One scale, chosen at random from two: 10 fetches.
fn shade_hex_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    let thresholds = shade_noise(pixel, SALT_FAR_CLIFF);
    let weights = splat_blend_bilinear(pixel.cell.fraction);
    // The second scale would hide repetition; the random offsets of hex tiling do that already. Choosing the scale at random avoids a visible jump of
    // scale.
    let plane = pixel.planes[select_of_3(pixel.projections, thresholds.x)];
    let texel = select_of_4(weights, thresholds.y);
    shade_choose(texel, plane);
    let scale = lower + select(0u, 1u, thresholds.z < pixel.tiling.y);
    return terrain_tap(pixel.cell, texel, terrain_projection(plane, pixel.footprint), scale);
}

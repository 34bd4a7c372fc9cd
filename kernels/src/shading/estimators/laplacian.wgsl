// Two bands of a Laplacian pyramid (Burt and Adelson, 1983): the coarse band is blended with bilinear weights, the fine band with the weights of the
// height blend.

// Takes 20 fetches per projection.
fn shade_laplacian_blend(pixel: Pixel, projection: Projection, scale: u32) -> Surface {
    return terrain_splat_bands(pixel.cell, projection, scale);
}

fn shade_laplacian_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    var sum = surface_zero();
    // Only the lower of the two tiling scales is used, because blending both would double the cost. As a consequence, textures change abruptly at the
    // distances at which the lower scale changes.
    for (var i = 0u; i < shade_projections(); i++) {
        let blend = shade_laplacian_blend(pixel, terrain_projection(pixel.planes[i], pixel.footprint), lower);
        sum = surface_add(sum, pixel.projections[i], blend);
    }
    return sum;
}

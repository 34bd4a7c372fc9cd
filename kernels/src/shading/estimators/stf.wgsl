// Stochastic texture filtering (Fajardo et al., 2023).

// Reads one texel of each texture of one material, in one projection at one of two scales. Material, projection, scale, mip level and texel are
// chosen at random. 4 fetches. `scale` is the lower scale; `share` is the probability of the upper scale, `scale` + 1.
fn shade_stf(pixel: Pixel, salt: u32, scale: u32, share: f32) -> Surface {
    let u = shade_noise(pixel, salt);
    let plane = pixel.planes[select_of_3(pixel.projections, u.x)];
    let texel = select_of_4(splat_blend_bilinear(pixel.cell.fraction), u.y);
    shade_choose(texel, plane);
    let chosen = scale + select(0u, 1u, u.z < share);
    return terrain_tap_chosen(
        pixel.cell,
        texel,
        terrain_projection(plane, pixel.footprint),
        chosen,
        shade_noise(pixel, salt + SALT_TEXEL),
        shade_noise(pixel, salt + SALT_HEIGHT_TEXEL),
    );
}

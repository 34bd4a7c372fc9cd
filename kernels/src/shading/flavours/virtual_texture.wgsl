// Virtual texture: the blend of materials seen from above, sampled from cached pages. 4 fetches if the page of the footprint's level is cached.

fn shade_virtual_texture(pixel: Pixel) -> Surface {
    let place = pixel.footprint.place;
    for (var level = virtual_texture_level(pixel.footprint.ddx, pixel.footprint.ddy, 0.0); level < frame.page_levels; level++) {
        let address = virtual_texture_address(place, level);
        count_fetch();
        let entry = textureLoad(page_table, address.page & vec2<i32>(VIRTUAL_WINDOW - 1), level, 0).r;
        if (entry & VIRTUAL_LAYER_MASK) == 0u || (entry & ~VIRTUAL_LAYER_MASK) != virtual_texture_tag(address.page) {
            continue;
        }
        let layer = (entry & VIRTUAL_LAYER_MASK) - 1u;
        let uv = (address.uv * VIRTUAL_PAGE_TEXELS + VIRTUAL_BORDER_TEXELS) / VIRTUAL_STORED_TEXELS;
        let per_m = frame.page_texels_per_m * frame.gradient_scale * exp2(-f32(level)) / VIRTUAL_STORED_TEXELS;
        let uv_dx = pixel.footprint.ddx.xy * per_m;
        let uv_dy = pixel.footprint.ddy.xy * per_m;
        count_fetch();
        let albedo = textureSampleGrad(page_albedo, page_sampler, uv, layer, uv_dx, uv_dy).rgb;
        count_fetch();
        let properties = textureSampleGrad(page_properties, page_sampler, uv, layer, uv_dx, uv_dy).rg;
        count_fetch();
        let normal_xy = textureSampleGrad(page_normal, page_sampler, uv, layer, uv_dx, uv_dy).rg * 2.0 - 1.0;
        let normal_z = sqrt(max(1.0 - dot(normal_xy, normal_xy), 0.01));
        return Surface(albedo, 0.0, vec3<f32>(-normal_xy / normal_z, 0.0), properties.x, properties.y);
    }
    // No page that contains this position is cached, neither at the level of the footprint nor at a coarser one. The baked terrain of the far atlas
    // is always available.
    var baked = shade_far_atlas(pixel).surface;
    baked.albedo *= terrain_colour_modulation(pixel.node);
    return baked;
}

// Far atlas: albedo and normal baked into the quadtree's payload, 2 fetches.

struct FarAtlas {
    surface: Surface,
    normal: vec3<f32>,
}

fn shade_far_atlas(pixel: Pixel) -> FarAtlas {
    count_fetch();
    // Texels in holes are black and transparent. Dividing by the filtered alpha keeps this black out of the colour next to a hole.
    let texel = textureSampleLevel(albedo_atlas, atlas_sampler, terrain_atlas_uv(pixel.node.uv), pixel.node.slot, 0.0);
    let albedo = texel.rgb / max(texel.a, 0.25);
    count_fetch();
    let baked = terrain_normal(pixel.node.slot, pixel.node.uv);
    return FarAtlas(Surface(albedo, 0.0, vec3<f32>(0.0), baked.smoothness, baked.specular_occlusion), baked.normal);
}

// Four materials in one projection: from above or, on steep ground, horizontally in one of eight directions (after Terrain3D).

// SHADING_SNAPPED_COSINE: where the cosine of the slope is below this value, textures are projected horizontally.

fn shade_snapped_project(pixel: ptr<function, Pixel>) {
    (*pixel).planes.x = snapped_plane((*pixel).normal, SHADING_SNAPPED_COSINE);
    (*pixel).projections = vec3<f32>(1.0, 0.0, 0.0);
}

// Eight layers, projected from above. All layers are sampled at every pixel, and each is blended over the layers before it (Luna, 2016).

fn shade_luna8_project(pixel: ptr<function, Pixel>) {
    (*pixel).planes.x = 2u;
    (*pixel).projections = vec3<f32>(1.0, 0.0, 0.0);
}

// Takes 28 fetches.
fn shade_luna8_blend(pixel: Pixel, projection: Projection, scale: u32) -> Surface {
    return terrain_layers(pixel.cell, projection, scale);
}

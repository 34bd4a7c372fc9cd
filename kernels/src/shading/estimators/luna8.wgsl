// Eight layers, seen from above, all sampled at every pixel and blended one over the other (Luna, 2016).

fn shade_luna8_project(pixel: ptr<function, Pixel>) {
    (*pixel).planes.x = 2u;
    (*pixel).projections = vec3<f32>(1.0, 0.0, 0.0);
}

// 28 fetches.
fn shade_luna8_blend(pixel: Pixel, projection: Projection, scale: u32) -> Surface {
    return terrain_layers(pixel.cell, projection, scale);
}

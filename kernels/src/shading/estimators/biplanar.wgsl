// The two projections that the surface faces most (Quilez, 2020).

fn shade_biplanar_project(pixel: ptr<function, Pixel>) {
    let b = biplanar_projections((*pixel).normal, frame.triplanar_sharpness);
    (*pixel).planes = vec3<u32>(b.axes, 0u);
    (*pixel).projections = vec3<f32>(b.weights, 0.0);
}

// From a pixel of the geometry pass to its place on the terrain and its footprint there.

// World position from depth, derivatives from the triangle's plane: never from a texture coordinate.
fn surface_footprint(pixel: vec2<u32>, depth: f32, normals: vec4<f32>) -> Footprint {
    let ray = frame_ray(vec2<f32>(pixel));
    let t = frame.near_m / depth;
    let triangle_normal = octahedral_decode(octahedral_dequantise8(normals.zw));
    return Footprint(
        terrain_place(frame.camera_sector, frame.camera + ray * t),
        derivatives_on_plane(ray, frame.ray_dx, t, triangle_normal),
        derivatives_on_plane(ray, frame.ray_dy, t, triangle_normal),
    );
}

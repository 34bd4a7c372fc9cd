// From a pixel of the geometry pass to its place on the terrain and its footprint there.

// Where in its pixel a frame is sampled, relative to the centre, pixels. FlipQuad's samples lie on the left edges of one frame and the top edges of the
// next, a sixth off the edge's middle by turns, so that a pixel and its neighbours share four in four rows and four columns.
fn surface_sample_offset(pixel: vec2<u32>) -> vec2<f32> {
    let turn = select(vec2<f32>(0.16666667), vec2<f32>(-0.16666667), (pixel & vec2<u32>(1u)) == vec2<u32>(1u));
    if frame.sample_pattern == 1u {
        return vec2<f32>(-0.5, turn.x);
    }
    if frame.sample_pattern == 2u {
        return vec2<f32>(-turn.y, -0.5);
    }
    return vec2<f32>(0.0);
}

// World position from depth, derivatives from the triangle's plane: never from a texture coordinate.
fn surface_footprint(pixel: vec2<u32>, depth: f32, normals: vec4<f32>) -> Footprint {
    let centre = frame_ray(vec2<f32>(pixel));
    let triangle_normal = frame_plane(normals);
    // A sample off the centre lies on the plane of the triangle seen there. Grazing planes reach no farther than half or twice as far away.
    let offset = surface_sample_offset(pixel);
    let ray = centre + frame.ray_dx * offset.x + frame.ray_dy * offset.y;
    let facing = dot(triangle_normal, ray);
    let stretch = select(1.0, clamp(dot(triangle_normal, centre) / select(facing, 1.0, facing == 0.0), 0.5, 2.0), frame.sample_pattern != 0u);
    let t = view_distance(frame.near_m, depth) * stretch;
    return Footprint(
        terrain_place(frame.camera_sector, frame.camera + ray * t),
        derivatives_on_plane(ray, frame.ray_dx, t, triangle_normal),
        derivatives_on_plane(ray, frame.ray_dy, t, triangle_normal),
    );
}

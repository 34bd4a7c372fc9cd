// The position on the terrain that a pixel sees, and the pixel's footprint there, computed from the output of the geometry pass.

// Returns the position of the frame's sample in a pixel, relative to the centre of the pixel, in pixels.
//
// FlipQuad pattern: samples lie on the left edges of the pixels in one frame, and on the top edges in the next. A sample is a sixth of a pixel away
// from the middle of its edge. The direction of this offset alternates from column to column on left edges, and from row to row on top edges. The two
// frames together give each pixel four samples, one on each edge, which it shares with its neighbours. All four differ in x and in y. Pixels of the
// last column and row have fewer samples.
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

// Computes the world position from depth, and its derivatives from the plane of the triangle. `dpdx` and `dpdy` are not used, because a neighbouring
// pixel may be on a different triangle.
fn surface_footprint(pixel: vec2<u32>, depth: f32, normals: vec4<f32>) -> Footprint {
    let centre = frame_ray(vec2<f32>(pixel));
    let triangle_normal = frame_plane(normals);
    // A sample that is not at the centre is assumed to lie on the plane of the triangle that is visible at the centre. The distance of the sample is
    // limited to between half and twice the distance at the centre, because a plane at a grazing angle may be very far away at the sample.
    let offset = surface_sample_offset(pixel);
    let ray = centre + frame.ray_dx * offset.x + frame.ray_dy * offset.y;
    let facing = dot(triangle_normal, ray);
    let stretch = select(1.0, select(clamp(dot(triangle_normal, centre) / facing, 0.5, 2.0), 2.0, facing == 0.0), frame.sample_pattern != 0u);
    let t = view_distance(frame.near_m, depth) * stretch;
    return Footprint(
        terrain_place(frame.camera_sector, frame.camera + ray * t),
        derivatives_on_plane(ray, frame.ray_dx, t, triangle_normal),
        derivatives_on_plane(ray, frame.ray_dy, t, triangle_normal),
    );
}

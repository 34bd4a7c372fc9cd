// Screen derivatives of the position, from depth and the triangle's plane.
// Source: Moore, "Terrain Rendering in Far Cry 5", GDC 2018: rays through the neighbouring pixels are
// intersected with the plane of the triangle.

// Lower limit of |cosine| of the angle between the plane's normal and the neighbouring pixel's ray. A smaller |cosine| is replaced by this limit, and
// so is a cosine of the other sign: beyond the horizon of the plane, the ray does not hit the plane at all. With this limit, the step along the
// surface is at most about 100 times the step across the view. Texture filters cannot resolve much longer steps.
const DERIVATIVES_MIN_COSINE: f32 = 0.01;

// Step from the position that a pixel sees on a plane to the position that its neighbour sees on the same plane, metres. The pixel's position is
// ray * t, relative to the eye; `ray_step` is the neighbour's ray minus `ray`; `normal` is a normal of the plane, of any length. A normal without
// usable direction counts as the z axis. The result is zero if another input is not finite, or if a component of the neighbour's ray or of the step
// is beyond 1e18, because squares of longer vectors would leave the range of f32.
// The step is the neighbour's position minus the pixel's position. At large distances these two vectors nearly cancel, so the formula is rearranged
// to avoid their subtraction.
fn derivatives_on_plane(ray: vec3<f32>, ray_step: vec3<f32>, t: f32, normal: vec3<f32>) -> vec3<f32> {
    let n = octahedral_unit(normal);
    let neighbour = ray + ray_step;
    let limit = max(DERIVATIVES_MIN_COSINE * length(neighbour), 1e-20);
    let side = select(-1.0, 1.0, dot(n, ray) >= 0.0);
    let facing = side * max(side * dot(n, neighbour), limit);
    let step = t * (ray_step - neighbour * (dot(n, ray_step) / facing));
    return select(vec3<f32>(0.0), step, vec3<bool>(usable_within_3(neighbour, 1e18) && usable_within_3(step, 1e18)));
}

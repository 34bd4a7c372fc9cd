// Computes a position relative to the eye from a pixel and its depth.

// Ray of a pixel. Its component along the view direction is 1. `ray_00` is the ray of pixel (0, 0), `ray_dx` and `ray_dy` are its steps to the right
// and down.
fn view_ray(ray_00: vec3<f32>, ray_dx: vec3<f32>, ray_dy: vec3<f32>, pixel: vec2<f32>) -> vec3<f32> {
    return ray_00 + ray_dx * pixel.x + ray_dy * pixel.y;
}

// A depth of at most this value means that nothing was drawn. The limit keeps the quotient of `near_m` and the depth in the range of f32.
const VIEW_MIN_DEPTH: f32 = 1e-30;

// Distance along the view direction for a reversed depth, metres; 0 if nothing was drawn.
fn view_distance(near_m: f32, depth: f32) -> f32 {
    let usable = usable_positive_1(depth, 1e30);
    return select(0.0, near_m / usable, usable > VIEW_MIN_DEPTH);
}

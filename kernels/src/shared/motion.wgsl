// Computes, from depth and the two cameras, to which pixel of an earlier frame a point of this frame projects. This needs neither a velocity target
// nor a search. Positions are relative to an eye, and the host computes the vector between the two eyes in f64, so the result is as precise
// 1000 km from the origin as at the origin.

// An earlier camera relative to this frame's eye. If q is a point relative to the earlier eye, the earlier camera sees q at the distance
// d = dot(forward, q) and at the pixel (dot(x_row, q) / d - x_shift, dot(y_row, q) / d - y_shift).
struct MotionPast {
    offset: vec3<f32>,      // this eye minus the earlier one, metres
    x_shift: f32,
    forward: vec3<f32>,     // the earlier view direction
    y_shift: f32,
    x_row: vec3<f32>,       // pixel x = dot(x_row, q) / distance - x_shift, q relative to the earlier eye
    pad_0: f32,
    y_row: vec3<f32>,
    pad_1: f32,
}

// MOTION_MIN_DISTANCE, MOTION_FAR: a point is reprojected only if its distance along the earlier view direction is between these limits, metres.

// Returns (x, y, distance): the pixel at which the earlier camera sees `point`, and the distance along the earlier view direction. `point` is
// relative to this frame's eye; x and y are whole numbers at pixel centres. The result is (-1e9, -1e9, 0) if the distance is not between
// MOTION_MIN_DISTANCE and MOTION_FAR (also for points behind the earlier camera), if a coordinate of the pixel is beyond 1e9, or if the input is not
// finite.
fn motion_reproject(point: vec3<f32>, past: MotionPast) -> vec3<f32> {
    let q = point + past.offset;
    let distance = dot(q, past.forward);
    if !(distance > MOTION_MIN_DISTANCE && usable_number(distance) && distance < MOTION_FAR) {
        return vec3<f32>(-1e9, -1e9, 0.0);
    }
    let pixel = vec2<f32>(dot(q, past.x_row), dot(q, past.y_row)) / distance - vec2<f32>(past.x_shift, past.y_shift);
    let finite = usable_within_3(vec3<f32>(pixel, 0.0), 1e9);
    return select(vec3<f32>(-1e9, -1e9, 0.0), vec3<f32>(pixel, distance), finite);
}

// The distance along the earlier view direction at which `ray` meets the plane through `point` with the normal `normal`. `ray` is the ray of a pixel
// of the earlier camera; its component along the view direction is 1. If the point was not occluded, the distance that the earlier frame shows at
// this pixel is close to the result. The result is 0 if the plane is edge-on, or if the distance is not between MOTION_MIN_DISTANCE and MOTION_FAR.
fn motion_expected_distance(point: vec3<f32>, past: MotionPast, ray: vec3<f32>, normal: vec3<f32>) -> f32 {
    let along = dot(normal, ray);
    let to_plane = dot(normal, point + past.offset);
    let edge_on = abs(along) <= 1e-6 * length(ray);
    let distance = to_plane / select(along, 1.0, edge_on);
    return select(0.0, distance, !edge_on && distance > MOTION_MIN_DISTANCE && usable_number(distance) && distance < MOTION_FAR);
}

// The ray of a pixel of the earlier camera. The function inverts the computation of the pixel in motion_reproject. The formula holds because
// `forward`, `x_row` and `y_row` are perpendicular to each other. Zero if a component of the ray is NaN or beyond 1e30.
fn motion_past_ray(past: MotionPast, pixel: vec2<f32>) -> vec3<f32> {
    let x = (pixel.x + past.x_shift) / dot(past.x_row, past.x_row);
    let y = (pixel.y + past.y_shift) / dot(past.y_row, past.y_row);
    let ray = past.forward + past.x_row * x + past.y_row * y;
    return select(vec3<f32>(0.0), ray, vec3<bool>(usable_within_3(ray, 1e30)));
}

// Whether a surface at the distance `found` in the earlier frame is the surface that is expected at the distance `expected`. Both are metres along
// the earlier view direction, 0 = no surface. They may differ by at most `tolerance` times `expected`.
fn motion_same_surface(found: f32, expected: f32, tolerance: f32) -> bool {
    return found > 0.0 && expected > 0.0 && abs(found - expected) <= tolerance * expected;
}

// Returns one row of pixels of the group of four rows that begins at row `first`, a multiple of 4: the row that belongs to `quarter`, 0..=3. Costly
// measurements use only one quarter of the rows. A quarter consists of whole rows, because the pixels of a row share cache lines. From each group to
// the next, the position of its row in the group moves by one, so a pattern with a period of 2 or 4 rows is sampled evenly. Each row belongs to
// exactly one quarter.
fn motion_row_of_quarter(first: u32, quarter: u32) -> u32 {
    return first + ((quarter + first / 4u) & 3u);
}

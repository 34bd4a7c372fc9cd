// Where a point of this frame was seen by an earlier camera: exact, from depth and the two cameras. No velocity target, no search.
// Positions are relative to an eye, and the two eyes differ by one vector that the host takes in f64: as good 1000 km from the origin as at it.

// An earlier camera as seen from this frame's eye; rows of pixel coordinates come ready for a dot product.
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

// MOTION_MIN_DISTANCE, MOTION_FAR: nearest and farthest distance along the view direction at which a pixel is told, metres.

// Pixel (x, y; whole numbers are pixel centres) and distance along the earlier view direction of a point that is `point` from this frame's eye.
// Behind the earlier camera, or where the input is not finite: distance 0, pixel -1e9.
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

// The distance along the earlier view direction at which the ray through pixel centre `pixel` meets the plane through the point with normal
// `normal`; `ray` is that pixel's ray, 1 long along the view direction. What an unoccluded earlier depth must be close to.
// 0 where the plane is edge-on or the hit lies behind.
fn motion_expected_distance(point: vec3<f32>, past: MotionPast, ray: vec3<f32>, normal: vec3<f32>) -> f32 {
    let along = dot(normal, ray);
    let to_plane = dot(normal, point + past.offset);
    let edge_on = abs(along) <= 1e-6 * length(ray);
    let distance = to_plane / select(along, 1.0, edge_on);
    return select(0.0, distance, !edge_on && distance > MOTION_MIN_DISTANCE && usable_number(distance) && distance < MOTION_FAR);
}

// The ray of a pixel of the earlier camera, from its rows: the inverse of the pixel coordinates above, for perpendicular rows. Zero where the input
// gives none that is finite.
fn motion_past_ray(past: MotionPast, pixel: vec2<f32>) -> vec3<f32> {
    let x = (pixel.x + past.x_shift) / dot(past.x_row, past.x_row);
    let y = (pixel.y + past.y_shift) / dot(past.y_row, past.y_row);
    let ray = past.forward + past.x_row * x + past.y_row * y;
    return select(vec3<f32>(0.0), ray, vec3<bool>(usable_within_3(ray, 1e30)));
}

// Whether an earlier depth (metres along the view direction, 0 = none) belongs to the surface expected there.
fn motion_same_surface(found: f32, expected: f32, tolerance: f32) -> bool {
    return found > 0.0 && expected > 0.0 && abs(found - expected) <= tolerance * expected;
}

// Of the four pixels of row `y` from `first` on, a multiple of 4, the one that is of quarter 0..=3 of the picture: every fourth pixel of a row, two
// further on in the next. Four quarters are the picture.
fn motion_of_quarter(first: u32, y: u32, quarter: u32) -> u32 {
    return first + ((quarter + 2u * y) & 3u);
}

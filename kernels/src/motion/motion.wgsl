// Motion: finds, for each pixel, which pixel showed the same surface point 1 to 4 frames earlier, and the exact position of the point one frame
// earlier. Both follow from depth and cameras. Points that were hidden or outside the picture in the earlier frame have no link.

struct MotionFrame {
    past: array<MotionPast, 4>,     // cameras of the earlier frames, the latest first
    lags: u32,                      // number of earlier frames that are available, 0..=4
    slot: u32,                      // index in `distances` at which this frame begins
    tolerance: f32,                 // largest relative difference in depth between two points of one surface
    quarter: u32,                   // index, 0..=3, of the quarter of the rows that is linked at lags 2 to 4
    past_slots: vec4<u32>,          // index in `distances` at which each earlier frame begins
}

@group(1) @binding(0) var depth_target: texture_depth_2d;
@group(1) @binding(1) var normal_target: texture_2d<f32>;
@group(2) @binding(0) var<uniform> motion: MotionFrame;
// Distance of each pixel's surface point along the view direction, metres; 0 = no terrain. One picture per slot of the ring.
@group(2) @binding(1) var<storage, read_write> distances: array<f32>;
// For each pixel, the index of the pixel nearest to the earlier position of its surface point, or MOTION_NO_LINK; one picture per lag. For lags 2 to
// 4, only the rows of the quarter are written.
@group(2) @binding(2) var<storage, read_write> links: array<u32>;
// For each pixel, the exact position of its surface point one frame earlier, pixels; -1e9 = the point was not seen. Written only with
// MOTION_POSITIONS.
@group(2) @binding(3) var<storage, read_write> positions: array<vec2<f32>>;

// Whether `positions` is written. Only resolves read it.
override MOTION_POSITIONS: bool = true;

// The surface point of a pixel in this frame.
struct MotionPoint {
    point: vec3<f32>,
    normal: vec3<f32>,
    distance: f32,      // along the view direction, metres; 0 = no terrain
}

fn motion_point(pixel: vec2<u32>) -> MotionPoint {
    let depth = textureLoad(depth_target, pixel, 0);
    let distance = view_distance(frame.near_m, depth);
    return MotionPoint(frame_ray(vec2<f32>(pixel)) * distance, frame_plane(textureLoad(normal_target, pixel, 0)), distance);
}

// The position of a surface point in an earlier picture, and the index of the pixel nearest to that position.
struct MotionFound {
    link: u32,
    position: vec2<f32>,
}

fn motion_find(seen: MotionPoint, lag: u32) -> MotionFound {
    let nowhere = MotionFound(MOTION_NO_LINK, vec2<f32>(-1e9));
    if lag >= motion.lags || seen.distance <= 0.0 {
        return nowhere;
    }
    let past = motion.past[lag];
    let was = motion_reproject(seen.point, past);
    let nearest = floor(was.xy + 0.5);
    if was.z <= 0.0 || any(nearest < vec2<f32>(0.0)) || any(nearest >= vec2<f32>(frame.size)) {
        return nowhere;
    }
    let there = u32(nearest.y) * frame.size.x + u32(nearest.x);
    let expected = motion_expected_distance(seen.point, past, motion_past_ray(past, nearest), seen.normal);
    if !motion_same_surface(distances[motion.past_slots[lag] + there], expected, motion.tolerance) {
        return nowhere;
    }
    return MotionFound(there, was.xy);
}

// An invocation handles four rows of one column, so neighbouring invocations read neighbouring pixels. At lag 1, it links all four pixels. At lags 2
// to 4, it links only the pixel in the row of the quarter. The code for lags 2 to 4 is not a branch in the loop over the rows, because a processor
// that runs its lanes in lockstep would execute the branch for all four pixels.
@compute @workgroup_size(32, 2)
fn motion_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let count = frame.size.x * frame.size.y;
    let x = id.x;
    let first = 4u * id.y;
    if x >= frame.size.x {
        return;
    }
    for (var y = first; y < min(first + 4u, frame.size.y); y++) {
        let at = y * frame.size.x + x;
        let seen = motion_point(vec2<u32>(x, y));
        let found = motion_find(seen, 0u);
        distances[motion.slot + at] = seen.distance;
        links[at] = found.link;
        if MOTION_POSITIONS {
            positions[at] = found.position;
        }
    }
    let row = motion_row_of_quarter(first, motion.quarter);
    if row >= frame.size.y {
        return;
    }
    let at = row * frame.size.x + x;
    let seen = motion_point(vec2<u32>(x, row));
    for (var lag = 1u; lag < 4u; lag++) {
        links[lag * count + at] = motion_find(seen, lag).link;
    }
}

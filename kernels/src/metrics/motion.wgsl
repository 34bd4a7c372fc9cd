// Motion: where each pixel's surface point was seen 1 to 4 frames before, exact, from depth and cameras. Disoccluded points have no link.

struct MotionFrame {
    past: array<MotionPast, 4>,     // the cameras of the frames before, nearest first
    lags: u32,                      // how many of them there are
    slot: u32,                      // where this frame's distances go
    tolerance: f32,                 // relative difference of depth up to which two points are on one surface
    pad_0: u32,
    past_slots: vec4<u32>,          // where theirs are
}

@group(1) @binding(0) var depth_target: texture_depth_2d;
@group(1) @binding(1) var normal_target: texture_2d<f32>;
@group(2) @binding(0) var<uniform> motion: MotionFrame;
// Metres along the view direction, a picture a slot; 0 = no terrain.
@group(2) @binding(1) var<storage, read_write> distances: array<f32>;
// Index of the pixel nearest to where the point was, a picture a lag.
@group(2) @binding(2) var<storage, read_write> links: array<u32>;
// Where exactly it was one frame before, pixels; -1e9 = nowhere.
@group(2) @binding(3) var<storage, read_write> positions: array<vec2<f32>>;

const MOTION_NO_LINK: u32 = 0xffffffffu;

@compute @workgroup_size(8, 8)
fn motion_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.size) {
        return;
    }
    let count = frame.size.x * frame.size.y;
    let at = pixel.y * frame.size.x + pixel.x;
    let depth = textureLoad(depth_target, pixel, 0);
    let distance = select(0.0, frame.near_m / depth, depth > 0.0);
    distances[motion.slot + at] = distance;
    let point = frame_ray(vec2<f32>(pixel)) * distance;
    let normal = frame_normal(textureLoad(normal_target, pixel, 0).zw);
    var position = vec2<f32>(-1e9);
    for (var lag = 0u; lag < 4u; lag++) {
        var link = MOTION_NO_LINK;
        if lag < motion.lags && depth > 0.0 {
            let past = motion.past[lag];
            let was = motion_reproject(point, past);
            let nearest = floor(was.xy + 0.5);
            if was.z > 0.0 && all(nearest >= vec2<f32>(0.0)) && all(nearest < vec2<f32>(frame.size)) {
                let there = u32(nearest.y) * frame.size.x + u32(nearest.x);
                let expected = motion_expected_distance(point, past, motion_past_ray(past, nearest), normal);
                if motion_same_surface(distances[motion.past_slots[lag] + there], expected, motion.tolerance) {
                    link = there;
                    if lag == 0u {
                        position = was.xy;
                    }
                }
            }
        }
        links[lag * count + at] = link;
    }
    positions[at] = position;
}

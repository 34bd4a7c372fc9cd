// Temporal resolve of one stream of pictures, in two steps that are both optional. FlipQuad averages four samples from two frames. The exponential
// resolve clamps the history to the 3 x 3 colour box of the current frame and then blends the current colour into the clamped history.
// Sources: McAuley, "Rendering the World of Far Cry 4", GDC 2015 (temporal supersampling);
// Karis, "High Quality Temporal Supersampling", SIGGRAPH 2014.

struct TemporalFrame {
    size: vec2<u32>,
    slot: u32,                  // index in `signal` at which the picture of this frame begins
    past_slot: u32,             // index in `signal` at which the picture of the previous frame begins
    has_past: u32,              // 1 = there is a previous frame
    flipquad: u32,              // 1 = average FlipQuad's samples
    exponential: u32,           // 1 = blend into the history
    share: f32,                 // share of the current frame in the history, (0, 1]
    neighbour: vec2<u32>,       // step to the neighbour whose sample is the second sample of a pixel in this frame: (1, 0) or (0, 1); FlipQuad only
    past_neighbour: vec2<u32>,  // as `neighbour`, for the previous frame
    history_in: u32,            // index in `history` at which the previous history begins
    history_out: u32,           // index in `history` at which the new history begins
    pad_0: u32,
    pad_1: u32,
}

@group(0) @binding(0) var<uniform> temporal: TemporalFrame;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(0) @binding(2) var<storage, read> positions: array<vec2<f32>>;
@group(1) @binding(0) var<storage, read> signal: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read_write> resolved: array<vec2<u32>>;
// Colour, and 1 if the pixel has a history, else 0.
@group(1) @binding(2) var<storage, read_write> history: array<vec4<f32>>;

fn temporal_index(pixel: vec2<u32>) -> u32 {
    return pixel.y * temporal.size.x + pixel.x;
}

// Returns the mean of two samples of one frame on opposite edges of a pixel: the pixel's own sample and the sample of the neighbour at `step`. If the
// neighbour lies outside the picture or is not a valid terrain pixel, the result is the pixel's own sample.
fn temporal_pair(slot: u32, pixel: vec2<u32>, step: vec2<u32>) -> vec3<f32> {
    let own = signal_colour(signal[slot + temporal_index(pixel)]);
    let across = pixel + step;
    if any(across >= temporal.size) {
        return own;
    }
    let other = signal[slot + temporal_index(across)];
    return select(own, 0.5 * (own + signal_colour(other)), signal_is_terrain(other));
}

// Returns the bilinearly filtered history at a position. Only terrain pixels that have a history contribute. The result has w = 1, or w = 0 if the
// weights of these pixels sum to at most 0.001.
fn temporal_history(position: vec2<f32>) -> vec4<f32> {
    let corner = floor(position);
    let f = position - corner;
    var sum = vec4<f32>(0.0);
    for (var i = 0u; i < 4u; i++) {
        let d = vec2<f32>(f32(i & 1u), f32(i >> 1u));
        let at = corner + d;
        if all(at >= vec2<f32>(0.0)) && all(at < vec2<f32>(temporal.size)) {
            let w = mix(1.0 - f.x, f.x, d.x) * mix(1.0 - f.y, f.y, d.y);
            let texel = history[temporal.history_in + temporal_index(vec2<u32>(at))];
            sum += w * vec4<f32>(texel.rgb * texel.w, texel.w);
        }
    }
    return select(vec4<f32>(0.0), vec4<f32>(sum.rgb / max(sum.w, 1e-6), 1.0), sum.w > 1e-3);
}

@compute @workgroup_size(8, 8)
fn temporal_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= temporal.size) {
        return;
    }
    let at = temporal_index(pixel);
    let raw = signal[temporal.slot + at];
    if !signal_is_terrain(raw) {
        // Sky and invalid pixels are copied. An invalid pixel must stay invalid, so that it is counted.
        resolved[temporal.slot + at] = raw;
        history[temporal.history_out + at] = vec4<f32>(0.0);
        return;
    }
    let link = links[at];
    let linked = temporal.has_past != 0u && link != TEMPORAL_NO_LINK;
    var colour = signal_colour(raw);
    if temporal.flipquad != 0u {
        colour = temporal_pair(temporal.slot, pixel, temporal.neighbour);
        // The linked pixel may be invalid: its colour was not finite.
        if linked && signal_is_terrain(signal[temporal.past_slot + link]) {
            let before = vec2<u32>(link % temporal.size.x, link / temporal.size.x);
            colour = 0.5 * (colour + temporal_pair(temporal.past_slot, before, temporal.past_neighbour));
        }
    }
    if temporal.exponential != 0u && linked {
        let past = temporal_history(positions[at]);
        if past.w > 0.0 {
            var low = colour;
            var high = colour;
            let first = max(pixel, vec2<u32>(1u)) - 1u;
            let last = min(pixel + 1u, temporal.size - 1u);
            for (var y = first.y; y <= last.y; y++) {
                for (var x = first.x; x <= last.x; x++) {
                    let neighbour = signal[temporal.slot + temporal_index(vec2<u32>(x, y))];
                    if signal_is_terrain(neighbour) {
                        let c = signal_colour(neighbour);
                        low = min(low, c);
                        high = max(high, c);
                    }
                }
            }
            colour = mix(clamp(past.rgb, low, high), colour, temporal.share);
        }
    }
    resolved[temporal.slot + at] = signal_recolour(raw, colour);
    history[temporal.history_out + at] = vec4<f32>(colour, 1.0);
}

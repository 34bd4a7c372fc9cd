// This pass compares the current picture of a stream (the pictures of one way to shade) with its pictures of up to 4 earlier frames. It writes sums
// and histograms, which the host reads back in each frame, and remembered errors (`measure_remember`), which the host reads back only when it needs
// them.
// The picture is divided into blocks of 64 x 8 pixels, and each block into 8 parts: part i has the columns i, i + 8, ... of its block. One invocation
// sums a part, so no barrier is needed, and the order of the additions is fixed. Neighbouring invocations read neighbouring pixels at the same time,
// so they share cache lines.

struct MeasureFrame {
    size: vec2<u32>,
    blocks: vec2<u32>,          // number of blocks in each direction
    slot: u32,                  // index in `signal` at which the picture of this frame begins
    lags: u32,                  // number of earlier frames with which this frame is compared, 0..=4
    quarter: u32,               // index, 0..=3, of the quarter of the rows that is used for the box test, the histograms and lags 2 to 4
    referenced: u32,            // number of frames, 0..=5, whose picture `reference` contains; counted back from this frame without a gap
    past_slots: vec4<u32>,      // index in `signal` at which the picture of each earlier frame begins
    memory_slot: u32,           // index in `memory` at which this frame begins
    memory_before: u32,         // index in `memory` at which the previous frame begins
    adaptation: f32,            // share of a new frame in the remembered error, 0..1; see `measure_remember`
    pad_0: u32,
}

// Sums of a part. A part has at most 64 pixels, so a number of pixels fits 8 bits. A *change* is the luminance of a pixel minus the luminance of the
// linked pixel: dY in the stream, dR in the reference sequence. The error of a pixel is its luminance in the stream minus its luminance in the
// reference sequence, so dY - dR is the change of the error.
struct MeasurePart {
    // For each lag, four counts: linked pixels | linked pixels with a choice in both frames << 8 | pixels whose two choices differ << 16 | linked
    // pixels whose error is known in both frames << 24.
    links: vec4<u32>,
    // For each lag: sum of |dY|.
    differences: vec4<f32>,
    // For each lag, over the pixels whose error is known in both frames: sums of |dY - dR|, (dY - dR)^2, dY^2, dR^2 and dY dR.
    residuals: vec4<f32>,
    residual_squares: vec4<f32>,
    change_squares: vec4<f32>,
    reference_squares: vec4<f32>,
    products: vec4<f32>,
    terrain: u32,
    fetches: u32,
    // The history of a pixel is the colour of its surface point one frame earlier. The box test rejects a history outside the box of the current
    // colours of the 3 x 3 pixels around the pixel. Two counts: pixels whose history was tested | pixels whose history was rejected << 8.
    rejections: u32,
    // Number of terrain pixels in the quarter. At lags 2 to 4, the share of disoccluded pixels is relative to this number.
    quarter_terrain: u32,
    // Number of pixels of terrain whose colour is not finite. They are in no other sum.
    invalid: u32,
    pad_0: u32,
    pad_1: u32,
    pad_2: u32,
}

// `measure` is a storage buffer and not a uniform buffer, because lavapipe (Mesa's software driver for Vulkan) recompiles a shader for each
// new value of a uniform on which its branches depend. With a uniform buffer, lavapipe of Mesa 22.3 also leaked memory (measured: 170 kB per
// stream and frame).
@group(0) @binding(0) var<storage, read> measure: MeasureFrame;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(1) @binding(0) var<storage, read> signal: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read_write> parts: array<MeasurePart>;
// Two histograms at lag 1, over the rows of the quarter: of |dY| in the first MEASURE_BINS bins, of |dY - dR| in the other bins. 16 bins per octave;
// the first bin of each histogram also counts all values below 2^-14, and the last bin all larger values.
@group(1) @binding(2) var<storage, read_write> histogram: array<atomic<u32>, 512>;
// The pictures of the reference sequence, in the same slots as those of the stream.
@group(1) @binding(3) var<storage, read> reference: array<vec2<u32>>;
// For each pixel, the remembered error of its surface point (see `measure_remember`), and the number of frames in it. Two slots: this frame and the
// previous frame.
@group(1) @binding(4) var<storage, read_write> memory: array<vec2<f32>>;

// Tolerance of the box test, as a share of the bounds of the box: 2^-10. The history and the bounds are f16 values. Rounding changes each of them by
// a share of at most 2^-11, and the two errors can add up.
const MEASURE_BOX_SLACK: f32 = 0.0009765625;

fn measure_bin(difference: f32) -> u32 {
    let octave = log2(max(difference, 1e-30)) - MEASURE_LOWEST_OCTAVE;
    return u32(clamp(floor(octave * MEASURE_BINS_PER_OCTAVE), 0.0, MEASURE_BINS - 1.0));
}

// Returns whether a colour lies outside the box of the colours of the 3 x 3 pixels around `pixel`. Pixels without terrain do not count.
fn measure_outside_box(colour: vec3<f32>, pixel: vec2<u32>) -> bool {
    var low = vec3<f32>(1e30);
    var high = vec3<f32>(-1e30);
    for (var i = 0u; i < 9u; i++) {
        // A neighbour outside the picture is replaced by the nearest pixel of the picture, which is another one of the 3 x 3 pixels.
        let at = min(max(pixel + vec2<u32>(i % 3u, i / 3u), vec2<u32>(1u)) - 1u, measure.size - 1u);
        let neighbour = signal[measure.slot + at.y * measure.size.x + at.x];
        let is_terrain = vec3<bool>(signal_is_terrain(neighbour));
        let c = signal_colour(neighbour);
        low = min(low, select(vec3<f32>(1e30), c, is_terrain));
        high = max(high, select(vec3<f32>(-1e30), c, is_terrain));
    }
    return any(colour < low * (1.0 - MEASURE_BOX_SLACK)) || any(colour > high * (1.0 + MEASURE_BOX_SLACK));
}

// Luminance of a pixel in two pictures: that of the stream, and that of the reference sequence.
struct MeasureSeen {
    luminance: f32,
    reference: f32,
    known: bool,        // whether the reference shows terrain there, so that the error is known
}

fn measure_seen(stream: vec2<u32>, at: u32, referenced: bool) -> MeasureSeen {
    var seen = MeasureSeen(signal_luminance(signal_colour(stream)), 0.0, false);
    if referenced {
        let truth = reference[at];
        seen.known = signal_is_terrain(truth);
        seen.reference = select(0.0, signal_luminance(signal_colour(truth)), seen.known);
    }
    return seen;
}

// Change of a pixel since an earlier frame: its counts, packed as in `MeasurePart.links`; dY and dR; the signal of the earlier pixel.
struct MeasureChange {
    links: u32,
    luminance: f32,
    reference: f32,
    before: vec2<u32>,
}

// `link`: an element of `links`. `past_slot`: the index in `signal` at which the earlier picture begins.
fn measure_change(lag: u32, link: u32, past_slot: u32, now: MeasureSeen, choice: u32) -> MeasureChange {
    if link == MEASURE_NO_LINK {
        return MeasureChange(0u, 0.0, 0.0, vec2<u32>(0u));
    }
    let before = signal[past_slot + link];
    if !signal_is_terrain(before) {
        return MeasureChange(0u, 0.0, 0.0, vec2<u32>(0u));
    }
    let choice_before = signal_choice(before);
    let both = choice != 0u && choice_before != 0u;
    let then = measure_seen(before, past_slot + link, measure.referenced > lag);
    let known = now.known && then.known;
    let counts = 1u + select(0u, 256u, both) + select(0u, 65536u, both && choice != choice_before) + select(0u, 16777216u, known);
    return MeasureChange(counts, now.luminance - then.luminance, select(0.0, now.reference - then.reference, known), before);
}

// The sums of one lag that need the reference: |dY - dR|, (dY - dR)^2, dY^2, dR^2 and dY dR.
struct MeasureResidual {
    residual: f32,
    residual_square: f32,
    change_square: f32,
    reference_square: f32,
    product: f32,
}

fn measure_residual(sum: MeasureResidual, change: MeasureChange) -> MeasureResidual {
    if change.links < 16777216u {
        return sum;
    }
    let residual = change.luminance - change.reference;
    return MeasureResidual(
        sum.residual + abs(residual),
        sum.residual_square + residual * residual,
        sum.change_square + change.luminance * change.luminance,
        sum.reference_square + change.reference * change.reference,
        sum.product + change.luminance * change.reference,
    );
}

// Updates the remembered error of a pixel's surface point. It models an eye that follows the surface, as an exponential mean of the error over time:
// a new frame has the weight `adaptation`. While 1/n exceeds `adaptation`, the n-th frame of a point has the weight 1/n instead, so the result is the
// plain mean of the n frames. The mean starts again if the pixel has no link, if the previous frame has no picture of the reference sequence, or if
// the error of the linked pixel was not known. Where the error of this frame is not known, mean and number of frames are 0.
fn measure_remember(at: u32, link: u32, now: MeasureSeen) {
    if !now.known {
        memory[measure.memory_slot + at] = vec2<f32>(0.0);
        return;
    }
    let error = now.luminance - now.reference;
    var state = vec2<f32>(error, 1.0);
    if measure.referenced > 1u && link != MEASURE_NO_LINK {
        let before = memory[measure.memory_before + link];
        let frames = before.y + 1.0;
        state = vec2<f32>(mix(before.x, error, max(measure.adaptation, 1.0 / frames)), frames);
    }
    memory[measure.memory_slot + at] = state;
}

@compute @workgroup_size(64)
fn measure_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let block = id.x / 8u;
    if block >= measure.blocks.x * measure.blocks.y {
        return;
    }
    let count = measure.size.x * measure.size.y;
    let lane = id.x % 8u;
    let origin = vec2<u32>(block % measure.blocks.x, block / measure.blocks.x) * vec2<u32>(64u, 8u);
    let end = min(origin + vec2<u32>(64u, 8u), measure.size);
    let referenced = measure.referenced > 0u;
    // The code of each lag is written out, because sums with a variable index would be kept in memory and not in registers.
    var links_sum = vec4<u32>(0u);
    var differences = vec4<f32>(0.0);
    var lag_1 = MeasureResidual(0.0, 0.0, 0.0, 0.0, 0.0);
    var lag_2 = lag_1;
    var lag_3 = lag_1;
    var lag_4 = lag_1;
    var terrain = 0u;
    var invalid = 0u;
    var quarter_terrain = 0u;
    var fetches = 0u;
    var rejections = 0u;
    for (var y = origin.y; y < end.y; y++) {
        for (var x = origin.x + lane; x < end.x; x += 8u) {
            let at = y * measure.size.x + x;
            let now = signal[measure.slot + at];
            if !signal_is_terrain(now) {
                invalid += select(0u, 1u, signal_is_invalid(now));
                if referenced {
                    memory[measure.memory_slot + at] = vec2<f32>(0.0);
                }
                continue;
            }
            terrain++;
            fetches += signal_fetches(now);
            let seen = measure_seen(now, measure.slot + at, referenced);
            var link = MEASURE_NO_LINK;
            if measure.lags > 0u {
                link = links[at];
            }
            if referenced {
                measure_remember(at, link, seen);
            }
            if measure.lags > 0u {
                let change = measure_change(1u, link, measure.past_slots.x, seen, signal_choice(now));
                links_sum.x += change.links;
                differences.x += abs(change.luminance);
                lag_1 = measure_residual(lag_1, change);
            }
        }
    }
    // Box test, histograms and lags 2 to 4 are expensive, so they include only a quarter of the rows. They have a separate loop, because a processor
    // that runs its lanes in lockstep would execute a branch in the loop above for all pixels.
    for (var first = origin.y; first < end.y; first += 4u) {
        let y = motion_row_of_quarter(first, measure.quarter);
        if y >= end.y {
            continue;
        }
        for (var x = origin.x + lane; x < end.x; x += 8u) {
            let at = y * measure.size.x + x;
            let now = signal[measure.slot + at];
            if !signal_is_terrain(now) {
                continue;
            }
            quarter_terrain++;
            let seen = measure_seen(now, measure.slot + at, referenced);
            let choice = signal_choice(now);
            if measure.lags > 0u {
                let change = measure_change(1u, links[at], measure.past_slots.x, seen, choice);
                if change.links != 0u {
                    rejections += 1u + select(0u, 256u, measure_outside_box(signal_colour(change.before), vec2<u32>(x, y)));
                    atomicAdd(&histogram[measure_bin(abs(change.luminance))], 1u);
                }
                if change.links >= 16777216u {
                    atomicAdd(&histogram[u32(MEASURE_BINS) + measure_bin(abs(change.luminance - change.reference))], 1u);
                }
            }
            if measure.lags > 1u {
                let change = measure_change(2u, links[count + at], measure.past_slots.y, seen, choice);
                links_sum.y += change.links;
                differences.y += abs(change.luminance);
                lag_2 = measure_residual(lag_2, change);
            }
            if measure.lags > 2u {
                let change = measure_change(3u, links[2u * count + at], measure.past_slots.z, seen, choice);
                links_sum.z += change.links;
                differences.z += abs(change.luminance);
                lag_3 = measure_residual(lag_3, change);
            }
            if measure.lags > 3u {
                let change = measure_change(4u, links[3u * count + at], measure.past_slots.w, seen, choice);
                links_sum.w += change.links;
                differences.w += abs(change.luminance);
                lag_4 = measure_residual(lag_4, change);
            }
        }
    }
    parts[id.x] = MeasurePart(
        links_sum,
        differences,
        vec4<f32>(lag_1.residual, lag_2.residual, lag_3.residual, lag_4.residual),
        vec4<f32>(lag_1.residual_square, lag_2.residual_square, lag_3.residual_square, lag_4.residual_square),
        vec4<f32>(lag_1.change_square, lag_2.change_square, lag_3.change_square, lag_4.change_square),
        vec4<f32>(lag_1.reference_square, lag_2.reference_square, lag_3.reference_square, lag_4.reference_square),
        vec4<f32>(lag_1.product, lag_2.product, lag_3.product, lag_4.product),
        terrain,
        fetches,
        rejections,
        quarter_terrain,
        invalid,
        0u,
        0u,
        0u,
    );
}

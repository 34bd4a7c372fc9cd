// A stream is one way to shade, followed over frames. This pass compares the current picture of a stream with its pictures of up to 4 earlier frames,
// and writes sums per tile. Only the sums are read back, never a picture. One invocation handles a tile of 8 x 8 pixels, so no barrier is needed, and
// the order of the additions is fixed.

struct MeasureFrame {
    size: vec2<u32>,
    tiles: vec2<u32>,
    slot: u32,                  // index in `signal` at which the picture of this frame begins
    lags: u32,                  // number of earlier frames, 0..=4
    quarter: u32,               // index, 0..=3, of the quarter of the pixels that is used for the box test, the histogram and lags 2 to 4
    pad_0: u32,
    past_slots: vec4<u32>,      // index in `signal` at which the picture of each earlier frame begins
}

// Sums of a tile. A count is at most 64.
struct MeasureTile {
    // For each lag, three counts: linked pixels | linked pixels with a choice in both frames << 8 | pixels whose two choices differ << 16.
    links: vec4<u32>,
    // For each lag: sum of absolute differences in luminance.
    differences: vec4<f32>,
    terrain: u32,
    fetches: u32,
    // The history of a pixel is the colour of its surface point one frame earlier. The box test rejects it if it lies outside the box of the current
    // colours of the 3 x 3 pixels around the pixel. Two counts: pixels whose history was tested | pixels whose history was rejected << 8.
    rejections: u32,
    // Number of terrain pixels in the quarter. The results of lags 2 to 4 are shares of this number.
    quarter_terrain: u32,
}

// `measure` is a storage buffer and not a uniform buffer, because lavapipe (Mesa's software driver for Vulkan) recompiles a shader for each
// new value of a uniform on which its branches depend. In Mesa 22.3, each dispatch also leaks a copy of the shader (measured: 170 kB per
// stream and frame).
@group(0) @binding(0) var<storage, read> measure: MeasureFrame;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(1) @binding(0) var<storage, read> signal: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read_write> tiles: array<MeasureTile>;
// Histogram of absolute differences at lag 1: 16 bins per octave; the first bin also holds all differences below 2^-14.
@group(1) @binding(2) var<storage, read_write> histogram: array<atomic<u32>, 256>;

// Tolerance of the box test, as a share of the bounds of the box: 2^-10. The history and the bounds are f16 values. Rounding changes each of them by
// a share of at most 2^-11, and the two errors can add up.
const MEASURE_BOX_SLACK: f32 = 0.0009765625;

fn measure_bin(difference: f32) -> u32 {
    let octave = log2(max(difference, 1e-30)) - MEASURE_LOWEST_OCTAVE;
    return u32(clamp(floor(octave * MEASURE_BINS_PER_OCTAVE), 0.0, MEASURE_BINS - 1.0));
}

// Returns whether a colour lies outside the box of the 3 x 3 pixels around `pixel`. Only the terrain pixels among them form the box.
fn measure_outside_box(colour: vec3<f32>, pixel: vec2<u32>) -> bool {
    var low = vec3<f32>(1e30);
    var high = vec3<f32>(-1e30);
    let first = max(pixel, vec2<u32>(1u)) - 1u;
    let last = min(pixel + 1u, measure.size - 1u);
    for (var y = first.y; y <= last.y; y++) {
        for (var x = first.x; x <= last.x; x++) {
            let neighbour = signal[measure.slot + y * measure.size.x + x];
            if signal_is_terrain(neighbour) {
                let c = signal_colour(neighbour);
                low = min(low, c);
                high = max(high, c);
            }
        }
    }
    return any(colour < low * (1.0 - MEASURE_BOX_SLACK)) || any(colour > high * (1.0 + MEASURE_BOX_SLACK));
}

// Change of a pixel since an earlier frame: its counts, packed as in `MeasureTile.links`; the absolute difference in luminance; the signal of the
// earlier pixel.
struct MeasureChange {
    links: u32,
    difference: f32,
    before: vec2<u32>,
}

fn measure_change(link_at: u32, past_slot: u32, luminance: f32, choice: u32) -> MeasureChange {
    let link = links[link_at];
    if link == MEASURE_NO_LINK {
        return MeasureChange(0u, 0.0, vec2<u32>(0u));
    }
    let before = signal[past_slot + link];
    if !signal_is_terrain(before) {
        return MeasureChange(0u, 0.0, vec2<u32>(0u));
    }
    let choice_before = signal_choice(before);
    let both = choice != 0u && choice_before != 0u;
    let counts = 1u + select(0u, 256u, both) + select(0u, 65536u, both && choice != choice_before);
    return MeasureChange(counts, abs(luminance - signal_luminance(signal_colour(before))), before);
}

@compute @workgroup_size(64)
fn measure_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = id.x;
    if tile >= measure.tiles.x * measure.tiles.y {
        return;
    }
    let count = measure.size.x * measure.size.y;
    let origin = vec2<u32>(tile % measure.tiles.x, tile / measure.tiles.x) * 8u;
    let end = min(origin + 8u, measure.size);
    // The code of each lag is written out, because sums with a variable index would be kept in memory and not in registers.
    var links_sum = vec4<u32>(0u);
    var differences = vec4<f32>(0.0);
    var terrain = 0u;
    var quarter_terrain = 0u;
    var fetches = 0u;
    var rejections = 0u;
    for (var y = origin.y; y < end.y; y++) {
        for (var x = origin.x; x < end.x; x++) {
            let at = y * measure.size.x + x;
            let now = signal[measure.slot + at];
            if !signal_is_terrain(now) {
                continue;
            }
            terrain++;
            fetches += signal_fetches(now);
            let luminance = signal_luminance(signal_colour(now));
            let choice = signal_choice(now);
            if measure.lags > 0u {
                let change = measure_change(at, measure.past_slots.x, luminance, choice);
                links_sum.x += change.links;
                differences.x += change.difference;
            }
        }
    }
    // Box test, histogram and lags 2 to 4 are expensive, so they include only a quarter of the pixels. They have a loop of their own, because a
    // processor that runs its lanes in lockstep would pay for a branch in the loop above at all pixels.
    for (var y = origin.y; y < end.y; y++) {
        for (var first = origin.x; first < end.x; first += 4u) {
            let x = motion_of_quarter(first, y, measure.quarter);
            if x >= end.x {
                continue;
            }
            let at = y * measure.size.x + x;
            let now = signal[measure.slot + at];
            if !signal_is_terrain(now) {
                continue;
            }
            quarter_terrain++;
            let luminance = signal_luminance(signal_colour(now));
            let choice = signal_choice(now);
            if measure.lags > 0u {
                let change = measure_change(at, measure.past_slots.x, luminance, choice);
                if change.links != 0u {
                    rejections += 1u + select(0u, 256u, measure_outside_box(signal_colour(change.before), vec2<u32>(x, y)));
                    atomicAdd(&histogram[measure_bin(change.difference)], 1u);
                }
            }
            if measure.lags > 1u {
                let change = measure_change(count + at, measure.past_slots.y, luminance, choice);
                links_sum.y += change.links;
                differences.y += change.difference;
            }
            if measure.lags > 2u {
                let change = measure_change(2u * count + at, measure.past_slots.z, luminance, choice);
                links_sum.z += change.links;
                differences.z += change.difference;
            }
            if measure.lags > 3u {
                let change = measure_change(3u * count + at, measure.past_slots.w, luminance, choice);
                links_sum.w += change.links;
                differences.w += change.difference;
            }
        }
    }
    tiles[tile] = MeasureTile(links_sum, differences, terrain, fetches, rejections, quarter_terrain);
}

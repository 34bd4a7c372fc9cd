// What one stream did between this frame and 1 to 4 frames before: sums a tile, so that no picture is read back to be measured.
// An invocation a tile of 8 x 8 pixels: no barrier, and sums in an order that never changes.

struct MeasureFrame {
    size: vec2<u32>,
    tiles: vec2<u32>,
    slot: u32,                  // where this frame's picture begins
    lags: u32,                  // frames before that there are, 0..=4
    subset: u32,                // 0..=3: which quarter of the pixels this frame's box test and histogram take
    pad_0: u32,
    past_slots: vec4<u32>,
}

// Of a tile. A count is at most 64.
struct MeasureTile {
    // Of each lag: linked pixels, those of them with a choice at both ends << 8, choices that differ << 16.
    links: vec4<u32>,
    // Sum of absolute differences in luminance.
    differences: vec4<f32>,
    terrain: u32,
    fetches: u32,
    // Pixels whose history was tested against the 3 x 3 box, those rejected << 8.
    rejections: u32,
    pad_0: u32,
}

@group(0) @binding(0) var<uniform> measure: MeasureFrame;
@group(0) @binding(1) var<storage, read> links: array<u32>;
@group(1) @binding(0) var<storage, read> signal: array<vec2<u32>>;
@group(1) @binding(1) var<storage, read_write> tiles: array<MeasureTile>;
// Of absolute differences at lag 1: 16 bins an octave, the first for all below 2^-14.
@group(1) @binding(2) var<storage, read_write> histogram: array<atomic<u32>, 256>;

const MEASURE_NO_LINK: u32 = 0xffffffffu;
const MEASURE_BINS: f32 = 256.0;
const MEASURE_LOWEST_OCTAVE: f32 = -14.0;
const MEASURE_BINS_PER_OCTAVE: f32 = 16.0;
// A history is rejected if a channel leaves the box by more than this: the rounding of f16 to both sides.
const MEASURE_BOX_SLACK: f32 = 0.0009765625;

fn measure_bin(difference: f32) -> u32 {
    let octave = log2(max(difference, 1e-30)) - MEASURE_LOWEST_OCTAVE;
    return u32(clamp(floor(octave * MEASURE_BINS_PER_OCTAVE), 0.0, MEASURE_BINS - 1.0));
}

// Whether a colour lies outside the box of the 3 x 3 terrain pixels around `pixel`.
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

@compute @workgroup_size(64)
fn measure_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = id.x;
    if tile >= measure.tiles.x * measure.tiles.y {
        return;
    }
    let count = measure.size.x * measure.size.y;
    let origin = vec2<u32>(tile % measure.tiles.x, tile / measure.tiles.x) * 8u;
    let end = min(origin + 8u, measure.size);
    var sum: MeasureTile;
    for (var y = origin.y; y < end.y; y++) {
        for (var x = origin.x; x < end.x; x++) {
            let at = y * measure.size.x + x;
            let now = signal[measure.slot + at];
            if !signal_is_terrain(now) {
                continue;
            }
            sum.terrain++;
            sum.fetches += signal_fetches(now);
            let colour = signal_colour(now);
            let luminance = signal_luminance(colour);
            let choice = signal_choice(now);
            for (var lag = 0u; lag < measure.lags; lag++) {
                let link = links[lag * count + at];
                if link == MEASURE_NO_LINK {
                    continue;
                }
                let before = signal[measure.past_slots[lag] + link];
                if !signal_is_terrain(before) {
                    continue;
                }
                let colour_before = signal_colour(before);
                let choice_before = signal_choice(before);
                let difference = abs(luminance - signal_luminance(colour_before));
                let both = choice != 0u && choice_before != 0u;
                sum.links[lag] += 1u + select(0u, 256u, both) + select(0u, 65536u, both && choice != choice_before);
                sum.differences[lag] += difference;
                if lag == 0u && ((x + 2u * y) & 3u) == measure.subset {
                    sum.rejections += 1u + select(0u, 256u, measure_outside_box(colour_before, vec2<u32>(x, y)));
                    atomicAdd(&histogram[measure_bin(difference)], 1u);
                }
            }
        }
    }
    tiles[tile] = sum;
}

// Statistics over the pictures of one view with many seeds: the moments of each pixel over the seeds, and the clumping of each seed's error.
// Only sums per tile or block are read back, no pictures.

struct SeedFrame {
    size: vec2<u32>,
    tiles: vec2<u32>,
    blocks: vec2<u32>,          // whole blocks, across and down
    block: u32,                 // edge length of a block, pixels
    count: u32,                 // number of seeds so far, including this one
    offset: u32,                // index in `signal` at which the picture begins
    zero: u32,                  // always 0; moments.wgsl explains its use
    pad_1: u32,
    pad_2: u32,
}

@group(0) @binding(0) var<uniform> seeds: SeedFrame;
@group(1) @binding(0) var<storage, read> signal: array<vec2<u32>>;
// The picture of the exact blend, which makes no random choices. Apart from invalid pixels, it has terrain at the same pixels as `signal`.
@group(1) @binding(1) var<storage, read> exact: array<vec2<u32>>;
// Running moments: three states per pixel, one for each channel, see moments.wgsl.
@group(1) @binding(2) var<storage, read_write> moments: array<vec4<f32>>;
// Per tile, from `seeds_add`: sum over pixels and channels of the difference from the exact blend, sum of its square, number of pixels.
// From `seeds_finish`: sum over pixels and channels of (mean - exact), sum of the variance, number of pixels.
@group(1) @binding(3) var<storage, read_write> tiles: array<vec4<f32>>;
// Per block: square of the mean error in luminance, mean square of the error, 1. All three are 0 if the block is not all terrain.
@group(1) @binding(4) var<storage, read_write> blocks: array<vec4<f32>>;

// Limit that marks pixels to be left out: those that were not terrain, or had an invalid colour, with at least one seed. A pixel is marked by a sum
// of squares (z) below this limit in its first state. Unmarked sums are at least 0. Later samples cannot lift a marked sum above the limit, because
// what they add is far smaller.
const SEEDS_LEFT_OUT: f32 = -1e38;

@compute @workgroup_size(64)
fn seeds_add(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = id.x;
    if tile >= seeds.tiles.x * seeds.tiles.y {
        return;
    }
    let origin = vec2<u32>(tile % seeds.tiles.x, tile / seeds.tiles.x) * 8u;
    let end = min(origin + 8u, seeds.size);
    var sum = vec4<f32>(0.0);
    for (var y = origin.y; y < end.y; y++) {
        for (var x = origin.x; x < end.x; x++) {
            let at = y * seeds.size.x + x;
            let now = signal[seeds.offset + at];
            if !signal_is_terrain(now) || !signal_is_terrain(exact[at]) {
                moments[at * 3u] = vec4<f32>(0.0, 0.0, 2.0 * SEEDS_LEFT_OUT, 0.0);
                continue;
            }
            let colour = signal_colour(now);
            for (var channel = 0u; channel < 3u; channel++) {
                var state = vec4<f32>(0.0);
                if seeds.count > 1u {
                    state = moments[at * 3u + channel];
                }
                moments[at * 3u + channel] = moments_add(state, vec2<f32>(colour[channel], 0.0), f32(seeds.count), seeds.zero);
            }
            let error = colour - signal_colour(exact[at]);
            sum += vec4<f32>(error.r + error.g + error.b, dot(error, error), 1.0, 0.0);
        }
    }
    tiles[tile] = sum;
}

@compute @workgroup_size(64)
fn seeds_finish(@builtin(global_invocation_id) id: vec3<u32>) {
    let tile = id.x;
    if tile >= seeds.tiles.x * seeds.tiles.y {
        return;
    }
    let origin = vec2<u32>(tile % seeds.tiles.x, tile / seeds.tiles.x) * 8u;
    let end = min(origin + 8u, seeds.size);
    var sum = vec4<f32>(0.0);
    for (var y = origin.y; y < end.y; y++) {
        for (var x = origin.x; x < end.x; x++) {
            let at = y * seeds.size.x + x;
            if !signal_is_terrain(exact[at]) || moments[at * 3u].z < SEEDS_LEFT_OUT {
                continue;
            }
            let mean_exact = signal_colour(exact[at]);
            for (var channel = 0u; channel < 3u; channel++) {
                let state = moments[at * 3u + channel];
                sum.x += state.x + state.y - mean_exact[channel];
                sum.y += moments_variance(state, f32(seeds.count));
            }
            sum.z += 1.0;
        }
    }
    tiles[tile] = sum;
}

@compute @workgroup_size(64)
fn seeds_blocks(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= seeds.blocks.x * seeds.blocks.y {
        return;
    }
    let origin = vec2<u32>(id.x % seeds.blocks.x, id.x / seeds.blocks.x) * seeds.block;
    var sum = 0.0;
    var squares = 0.0;
    var whole = 1.0;
    for (var y = 0u; y < seeds.block; y++) {
        for (var x = 0u; x < seeds.block; x++) {
            let at = (origin.y + y) * seeds.size.x + origin.x + x;
            let now = signal[seeds.offset + at];
            if !signal_is_terrain(now) || !signal_is_terrain(exact[at]) {
                whole = 0.0;
                continue;
            }
            let error = signal_luminance(signal_colour(now)) - signal_luminance(signal_colour(exact[at]));
            sum += error;
            squares += error * error;
        }
    }
    let pixels = f32(seeds.block * seeds.block);
    blocks[id.x] = vec4<f32>((sum / pixels) * (sum / pixels), squares / pixels, whole, 0.0) * whole;
}

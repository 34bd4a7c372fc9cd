// Occlusion culling for one phase. The geometry pass draws the patches in phases, the nearest patches first. A batch is the set of patches that one
// indirect draw of the phase can draw. For each batch, this pass lists the patches that are not hidden by what earlier phases drew, and writes their
// number into the indirect draw.
// One workgroup handles a batch. A prefix sum finds the place of each patch in the list. The list therefore keeps the order of the patches and does
// not depend on the scheduling of the device.

struct OcclusionBatch {
    first: u32,         // index of the first patch of the batch
    count: u32,         // number of patches of the batch
    order: u32,         // index in `order` at which the list of the batch begins
    instances: u32,     // index in `arguments` of the number of instances that the batch draws
}

// The box of a patch in local coordinates, metres.
struct OcclusionBox {
    low: vec3<f32>,
    pad_0: f32,
    high: vec3<f32>,
    pad_1: f32,
}

@group(1) @binding(0) var<storage, read> batches: array<OcclusionBatch>;
@group(1) @binding(1) var<storage, read> boxes: array<OcclusionBox>;
@group(1) @binding(2) var<storage, read> pyramid: array<f32>;
// For each patch in `boxes` that this pass tests, 1 if it is not hidden, else 0. Patches of the first phase are not tested: they are always drawn.
@group(1) @binding(3) var<storage, read_write> shown: array<u32>;
@group(1) @binding(4) var<storage, read_write> order: array<u32>;
@group(1) @binding(5) var<storage, read_write> arguments: array<u32>;

const OCCLUSION_LANES: u32 = 256u;
// Difference between two levels of the pyramid: the level at which a box lies in at most 2 x 2 texels, and the finer level that the test reads. The
// test never reads a level below 1. At the tested level, the box lies in at most 8 x 8 texels. They extend less far beyond the box than coarser
// texels, so more hidden patches are recognised.
const OCCLUSION_FINER: u32 = 2u;

var<workgroup> occlusion_sums: array<u32, OCCLUSION_LANES>;

fn occlusion_at(level: u32, texel: vec2<u32>) -> f32 {
    return pyramid[occlusion_index(frame.size, level, texel)];
}

// Whether it is known that everything that was drawn at the pixels of a box is nearer than the box.
fn occlusion_hides(box: OcclusionBox) -> bool {
    let m = transpose(frame.clip_from_local);
    let cover = culling_cover(m[0], m[1], m[3], frame.near_m, box.low, box.high, frame.size);
    if !cover.known {
        return false;
    }
    let level = max(culling_level(cover.first, cover.last), OCCLUSION_FINER + 1u) - OCCLUSION_FINER;
    let low = cover.first >> vec2<u32>(level);
    let high = cover.last >> vec2<u32>(level);
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            if !culling_hidden(cover.depth, vec4<f32>(occlusion_at(level, vec2<u32>(x, y)))) {
                return false;
            }
        }
    }
    return true;
}

@compute @workgroup_size(OCCLUSION_LANES)
fn occlusion_cull(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let batch = batches[group.x];
    // Each lane handles consecutive patches.
    let share = (batch.count + OCCLUSION_LANES - 1u) / OCCLUSION_LANES;
    let first = batch.first + min(lane * share, batch.count);
    let end = batch.first + min((lane + 1u) * share, batch.count);
    var visible = 0u;
    for (var i = first; i < end; i++) {
        let is_shown = select(1u, 0u, occlusion_hides(boxes[i]));
        shown[i] = is_shown;
        visible += is_shown;
    }
    occlusion_sums[lane] = visible;
    workgroupBarrier();
    // After each iteration, an entry holds the sum over its own lane and the 2 * reach - 1 lanes before it, or all lanes before it if there are
    // fewer.
    for (var reach = 1u; reach < OCCLUSION_LANES; reach *= 2u) {
        var before = 0u;
        if lane >= reach {
            before = occlusion_sums[lane - reach];
        }
        workgroupBarrier();
        occlusion_sums[lane] += before;
        workgroupBarrier();
    }
    var at = batch.order + occlusion_sums[lane] - visible;
    for (var i = first; i < end; i++) {
        if shown[i] == 1u {
            order[at] = i;
            at++;
        }
    }
    if lane == OCCLUSION_LANES - 1u {
        arguments[batch.instances] = occlusion_sums[lane];
    }
}

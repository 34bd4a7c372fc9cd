// Computes the OR of a tile's masks by atomics in workgroup memory, which every adapter supports.

// Workgroup memory is 0 when a workgroup starts (WGSL, "Variable and value declarations").
var<workgroup> tile_mask: atomic<u32>;

@compute @workgroup_size(TILE * TILE)
fn classification_main(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    atomicOr(&tile_mask, classification_pixel_mask(tile.xy * TILE + vec2<u32>(thread % TILE, thread / TILE)));
    workgroupBarrier();
    if thread == 0u {
        classification_append(tile.xy, atomicLoad(&tile_mask));
    }
}

// Computes the OR of a tile's masks. A subgroup operation combines the masks of each subgroup, so that one atomic per subgroup is enough. The
// workgroup is one-dimensional because naga supports subgroup built-ins only in one-dimensional workgroups.

// Workgroup memory is 0 when a workgroup starts (WGSL, "Variable and value declarations").
var<workgroup> tile_mask: atomic<u32>;

@compute @workgroup_size(TILE * TILE)
fn classification_main(
    @builtin(workgroup_id) tile: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let combined = subgroupOr(classification_pixel_mask(tile.xy * TILE + vec2<u32>(thread % TILE, thread / TILE)));
    if lane == 0u {
        atomicOr(&tile_mask, combined);
    }
    workgroupBarrier();
    if thread == 0u {
        classification_append(tile.xy, atomicLoad(&tile_mask));
    }
}

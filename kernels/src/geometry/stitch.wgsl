// Stitching: a vertex on a side of a patch moves to the nearest vertex that all patches at this side have (rulings 3 and 8 in ARCHITECTURE.md).
// This file has no bindings, so that probes can compare it with its reference in Rust.

// Returns the index nearest to `index` at which a mesh that is `delta` levels coarser has a vertex; the lower index if two are equally near.
fn geometry_weld(index: u32, delta: u32) -> u32 {
    let step = 1u << delta;
    return (index + (step - 1u) / 2u) / step * step;
}

// `index`: index of a vertex in its node. `first`: index of the south-west corner of its patch, which has `quads` quads along a side. `deltas`: by
// how many levels the mesh on each side is coarser than the vertices of the node, 4 bits per side (north << 12 | east << 8 | south << 4 | west).
fn geometry_stitch(index: vec2<u32>, first: vec2<u32>, quads: u32, deltas: u32) -> vec2<u32> {
    let last = first + quads;
    var kept = index;
    if index.y == last.y { kept.x = geometry_weld(index.x, (deltas >> 12u) & 15u); }
    if index.x == last.x { kept.y = geometry_weld(index.y, (deltas >> 8u) & 15u); }
    if index.y == first.y { kept.x = geometry_weld(index.x, (deltas >> 4u) & 15u); }
    if index.x == first.x { kept.y = geometry_weld(index.y, deltas & 15u); }
    return kept;
}

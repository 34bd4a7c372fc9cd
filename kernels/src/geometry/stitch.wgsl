// Stitching: a vertex on the border to a coarser node moves to the nearest vertex of the coarser node on this border (rulings 3 and 8 in
// ARCHITECTURE.md).
// This file has no bindings, so that probes can compare it with its reference in Rust.

// Returns the index nearest to `index` at which a neighbour that is `delta` levels coarser has a vertex; the lower index if two are equally near.
fn geometry_weld(index: u32, delta: u32) -> u32 {
    let step = 1u << delta;
    return (index + (step - 1u) / 2u) / step * step;
}

fn geometry_stitch(index: vec2<u32>, deltas: u32) -> vec2<u32> {
    var kept = index;
    if index.y == GEOMETRY_NODE_QUADS { kept.x = geometry_weld(index.x, (deltas >> 12u) & 15u); }
    if index.x == GEOMETRY_NODE_QUADS { kept.y = geometry_weld(index.y, (deltas >> 8u) & 15u); }
    if index.y == 0u { kept.x = geometry_weld(index.x, (deltas >> 4u) & 15u); }
    if index.x == 0u { kept.y = geometry_weld(index.y, deltas & 15u); }
    return kept;
}

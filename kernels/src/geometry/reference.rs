//! Where vertices are drawn, in f64. [`weld`] and [`stitch`] are the references for `geometry_stitch`, written from the talk (Moore, GDC 2018) and
//! from ruling 8 in `ARCHITECTURE.md`. [`place`] and [`vertex`] are the reference for the positions of `geometry_vertex`.

use glam::{DVec2, DVec3};

use crate::world::{NodeId, World};

/// Moves a vertex along a side of its patch to the nearest vertex of a coarser mesh. `index`: index of the vertex in its node, along the side,
/// 0..=128. The coarser mesh has a vertex at every 2^`delta`-th index. Returns the nearest of these indices; the lower index if two are equally near.
pub fn weld(index: u32, delta: u32) -> u32 {
    let step = 1 << delta;
    let below = index / step * step;
    if index - below <= step / 2 { below } else { below + step }
}

/// Moves a vertex on a side of a patch to the nearest vertex that all patches at this side have. Other vertices stay. `index`: index of the vertex in
/// its node. `first`: index of the south-west corner of the patch, which has `quads` quads along a side. `deltas`: by how many levels the mesh at
/// each side is coarser than the vertices of the node, 4 bits per side (north << 12 | east << 8 | south << 4 | west).
pub fn stitch(index: [u32; 2], first: [u32; 2], quads: u32, deltas: u32) -> [u32; 2] {
    let [x, y] = index;
    let [east, north] = first.map(|at| at + quads);
    let along_x = if y == north {
        deltas >> 12
    } else if y == first[1] {
        deltas >> 4
    } else {
        0
    } & 15;
    let along_y = if x == east {
        deltas >> 8
    } else if x == first[0] {
        deltas
    } else {
        0
    } & 15;
    [weld(x, along_x), weld(y, along_y)]
}

/// Horizontal position at which vertex `index` (0..=128, already stitched) of a node is drawn, world metres. A vertex beyond the data is drawn at the
/// nearest point of the data.
pub fn place(world: &World, node: NodeId, index: [u32; 2]) -> DVec2 {
    let layout = world.layout();
    let at = node.origin_m(layout) + DVec2::from_array(index.map(f64::from)) * layout.spacing_m(node.lod);
    DVec2::from_array(world.drawn_at(at.to_array()))
}

/// Position at which vertex `index` (0..=128, already stitched) of a node is drawn, world metres.
pub fn vertex(world: &World, node: NodeId, index: [u32; 2]) -> DVec3 {
    place(world, node, index).extend(world.vertex_elevation_m(node, index))
}

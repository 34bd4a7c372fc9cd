//! Splits the drawn nodes into 8 x 8 patches of 16 x 16 quads, drops the patches outside the frustum, and packs LOD deltas for stitching.
//!
//! Source: Moore, GDC 2018, "Building the Visible Render Node List", "LOD Transitions"; rulings 3 and 8 in `ARCHITECTURE.md`.
//! Reads the drawn nodes and the LOD map. Writes the patch list. Runs on the CPU.
//!
//! Limits: culling tests only the frustum. `shared::culling` also has functions that test normal cones and occlusion. They are intended for culling
//! on the device, and this stage does not call them: cones are baked into payloads but not uploaded, and there is no depth pyramid. If a depth
//! pyramid is added, its levels must have the sizes of [`crate::shared::culling::level_size`]. Otherwise, visible patches are culled.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::quadtree::{NodeBounds, local_box};
use crate::view::camera::View;
use crate::world::{Layout, NodeId, SECTORS};

/// Patches along a node's edge.
pub const PATCHES: u32 = 8;
/// Quads along a patch's edge.
pub const PATCH_QUADS: u32 = 16;

/// One patch to draw; the layout matches `Patch` in `geometry.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Patch {
    /// South-west corner of the patch's *node*, in local coordinates: metres from the south-west corner of the camera's sector.
    pub node_origin: [f32; 2],
    /// Distance between neighbouring vertices of the node at vertex stride 1, metres.
    pub spacing: f32,
    /// Atlas slot, from 1.
    pub slot: u32,
    /// Column and row of the patch in its node, 0..8.
    pub patch: [u32; 2],
    /// LOD deltas, 4 bits a side: north << 12 | east << 8 | south << 4 | west.
    pub deltas: u32,
    /// The node's LOD.
    pub lod: u32,
}

/// LOD delta of a side: by how many levels the neighbour is coarser; 0 if it is not coarser.
pub fn delta(own: u8, neighbour: u8) -> u32 {
    u32::from(neighbour.saturating_sub(own))
}

/// Returns the packed LOD deltas of a patch, see [`Patch::deltas`]. Sides inside the node have the delta 0. `stride`: the vertex stride of all
/// patches. With a stride above 1, the drawn vertices of a coarser neighbour are `stride` times as far apart. So log2 of `stride` is added to the
/// delta of each side that has a coarser neighbour.
pub fn pack_deltas(node: NodeId, patch: [u32; 2], lod_map: &[u8], stride: u32) -> u32 {
    let edge = 1i32 << node.lod;
    let (x, y) = (i32::from(node.x) * edge, i32::from(node.y) * edge);
    // A coarser neighbour covers the whole side, so any sector along the side gives its LOD.
    let lod_at = |x: i32, y: i32| {
        let side = i32::from(SECTORS);
        let inside = (0..side).contains(&x) && (0..side).contains(&y);
        if inside { lod_map[usize::try_from(y * side + x).unwrap_or(0)] } else { 0 }
    };
    let last = PATCHES - 1;
    let side = |on: bool, x: i32, y: i32| match if on { delta(node.lod, lod_at(x, y)) } else { 0 } {
        0 => 0,
        coarser => coarser + stride.ilog2(),
    };
    side(patch[1] == last, x, y + edge) << 12
        | side(patch[0] == last, x + edge, y) << 8
        | side(patch[1] == 0, x, y - 1) << 4
        | side(patch[0] == 0, x - 1, y)
}

/// Returns those patches of the drawn nodes that may be visible from `eye`, in the order of the nodes. The field `node_origin` of a patch
/// is in the local coordinates of `view`. The two views are equal unless culling is frozen. `drawn`: the nodes to draw, each with its atlas slot and
/// its bounds. `stride`: a power of two, see [`pack_deltas`].
#[allow(clippy::cast_possible_truncation, reason = "local coordinates are multiples of the vertex spacing and exact in f32")]
pub fn cull(drawn: &[(NodeId, u32, NodeBounds)], lod_map: &[u8], layout: &Layout, [view, eye]: [&View; 2], stride: u32) -> Vec<Patch> {
    let mut patches = Vec::new();
    for &(node, slot, bounds) in drawn {
        let (low, high) = local_box(node, bounds, layout, eye);
        if !eye.sees(low, high) {
            continue;
        }
        let (origin, _) = local_box(node, bounds, layout, view);
        let patch_m = layout.node_m(node.lod) / f64::from(PATCHES);
        for row in 0..PATCHES {
            for column in 0..PATCHES {
                let corner = low + DVec3::new(f64::from(column), f64::from(row), 0.0) * patch_m;
                let opposite = (corner.truncate() + patch_m).extend(high.z);
                let deltas = pack_deltas(node, [column, row], lod_map, stride);
                // If the vertices of a coarser neighbour are farther apart than the edge of a patch, stitching draws triangles outside the box of the
                // patch. Such a patch is drawn whenever its node is visible.
                let reaches_out = (0..4).any(|side| (deltas >> (4 * side)) & 15 > PATCH_QUADS.ilog2());
                if reaches_out || eye.sees(corner, opposite) {
                    patches.push(Patch {
                        node_origin: [origin.x as f32, origin.y as f32],
                        spacing: (patch_m / f64::from(PATCH_QUADS)) as f32,
                        slot,
                        patch: [column, row],
                        deltas,
                        lod: u32::from(node.lod),
                    });
                }
            }
        }
    }
    patches
}

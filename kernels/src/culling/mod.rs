//! Splits the drawn nodes into 8 x 8 patches of 16 x 16 quads, drops patches that cannot be visible, and packs LOD deltas for stitching.
//!
//! A patch is dropped if the box around its vertices is outside the frustum, or if its normal cone proves that all its triangles face away from the
//! camera. The remaining patches are usually sorted by distance, so that the stage `occlusion` can drop those that nearer patches hide. Culling
//! should change no pixel; tests check this with llvmpipe. On hardware, a pixel may change in two rare cases. First, a triangle that faces away and
//! is much smaller than a pixel can face the camera after the rasteriser rounds its corners. Second, of two surfaces of equal depth, the one that is
//! drawn first is seen, and sorting changes the order of drawing.
//! Source: Moore, GDC 2018, "Building the Visible Render Node List", "LOD Transitions", "Back Face Culling"; rulings 3 and 8 in `ARCHITECTURE.md`.
//! Reads the drawn nodes and their levels. Writes the patch list. Runs on the CPU.

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use crate::quadtree::{NodeBounds, PatchBounds, local_box, patch_box};
use crate::shared::culling;
use crate::view::camera::View;
use crate::world::{Layout, NodeId};

mod levels;

pub use levels::{LOG2_LARGEST_STRIDE, Levels};

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
    /// LOD deltas, see [`Levels::deltas`].
    pub deltas: u32,
    /// The node's LOD.
    pub lod: u32,
}

/// A node to draw.
#[derive(Clone, Copy, Debug)]
pub struct DrawnNode<'a> {
    /// The node.
    pub node: NodeId,
    /// Its atlas slot.
    pub slot: u32,
    /// Its bounds.
    pub bounds: NodeBounds,
    /// The bounds of its 8 x 8 patches, row by row from the south-west corner.
    pub patches: &'a [PatchBounds],
}

/// Which tests are made, and in which order patches are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[allow(clippy::struct_excessive_bools, reason = "each test can be switched off alone, so that its use can be measured")]
pub struct Culls {
    /// Whether a patch is tested against the frustum with its own range of heights. If not, the range of its node is used.
    pub patch_heights: bool,
    /// Whether patches are removed if their normal cones prove that all their triangles face away from the camera.
    pub back_faces: bool,
    /// Whether the nearest patches are drawn first, so that the device can reject hidden pixels before it shades them.
    pub nearest_first: bool,
    /// Whether patches are removed if nearer patches hide them. It only has an effect with `nearest_first`.
    pub occlusion: bool,
}

impl Culls {
    /// All tests.
    pub const ALL: Culls = Culls { patch_heights: true, back_faces: true, nearest_first: true, occlusion: true };
    /// Only the frustum, with the range of heights of a node.
    pub const FRUSTUM: Culls = Culls { patch_heights: false, back_faces: false, nearest_first: false, occlusion: false };

    /// Whether hidden patches are removed.
    pub fn hides(self) -> bool {
        self.occlusion && self.nearest_first
    }
}

/// The conditions under which patches are culled.
#[derive(Clone, Copy, Debug)]
pub struct Conditions<'a> {
    /// How the quadtree covers the world.
    pub layout: &'a Layout,
    /// The vertex strides of the patches.
    pub levels: &'a Levels,
    /// Bound on the rounding error of the elevation of a vertex on the device, metres
    /// ([`World::elevation_rounding_m`](crate::world::World::elevation_rounding_m)).
    pub rounding_m: f64,
    /// The tests.
    pub culls: Culls,
}

/// Box that encloses the vertices of a patch, metres, with a margin for the rounding of elevations on the device. Its corners are in the local
/// coordinates of the view from which patches are culled. Infinite if stitching may move vertices out of the patch. The layout matches `OcclusionBox`
/// in `occlusion/cull.wgsl`.
#[allow(missing_docs, reason = "low and high corner, and padding")]
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct PatchBox {
    pub low: [f32; 3],
    pub pad_0: f32,
    pub high: [f32; 3],
    pub pad_1: f32,
}

impl PatchBox {
    #[allow(clippy::cast_possible_truncation, reason = "x and y are exact in f32, and the margin of z covers its rounding")]
    fn of([low, high]: [DVec3; 2]) -> PatchBox {
        PatchBox { low: low.as_vec3().to_array(), pad_0: 0.0, high: high.as_vec3().to_array(), pad_1: 0.0 }
    }
}

/// The patches to draw, and how many were removed by which test.
#[derive(Clone, Debug, Default)]
pub struct Culled {
    /// The patches to draw, the nearest first if they are sorted. The geometry pass keeps this order among the patches of a draw.
    pub patches: Vec<Patch>,
    /// Their boxes, in the same order.
    pub boxes: Vec<PatchBox>,
    /// Log2 of their vertex strides, in the same order.
    pub log2_strides: Vec<u32>,
    /// How many were removed.
    pub counts: CullCounts,
}

/// How many patches were removed by which test. A patch counts for the first test that removes it, in the order of the fields.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CullCounts {
    /// Patches outside the frustum.
    pub outside: usize,
    /// Patches whose normal cones prove that all their triangles face away from the camera.
    pub facing_away: usize,
    /// Patches that nearer patches hide.
    pub hidden: usize,
}

/// Returns those patches of the drawn nodes that may be visible from `eye`. `view` is the view that is drawn; the field `node_origin` of a patch is
/// in its local coordinates. The two views differ only if patches are culled from another pose than that of the camera.
#[allow(clippy::cast_possible_truncation, reason = "local coordinates are multiples of the vertex spacing and exact in f32")]
pub fn cull(nodes: &[DrawnNode<'_>], [view, eye]: [&View; 2], conditions: Conditions<'_>) -> Culled {
    let Conditions { layout, levels, rounding_m, culls } = conditions;
    let margin = DVec3::new(0.0, 0.0, rounding_m);
    let mut culled = Culled::default();
    let mut found: Vec<(f64, Patch, PatchBox, u32)> = Vec::new();
    for &DrawnNode { node, slot, bounds, patches } in nodes {
        let (low, high) = local_box(node, bounds, layout, eye);
        if !eye.sees(low - margin, high + margin) {
            culled.counts.outside += (PATCHES * PATCHES) as usize;
            continue;
        }
        let (origin, _) = local_box(node, bounds, layout, view);
        let patch_m = layout.node_m(node.lod) / f64::from(PATCHES);
        for ((row, column), patch) in (0..PATCHES).flat_map(|row| (0..PATCHES).map(move |column| (row, column))).zip(patches) {
            let (deltas, log2_stride) = (levels.deltas(node, [column, row]), levels.log2_stride(node, [column, row]));
            // If the vertices of a coarser neighbour are farther apart than the edge of a patch, stitching may draw triangles outside the box of the
            // patch. Such a patch is drawn whenever its node is visible.
            let reaches_out = Levels::reaches_out(deltas);
            let heights = if culls.patch_heights { patch.height_m } else { bounds.height_m };
            let (corner, opposite) = patch_box(node, [column, row], heights, layout, eye);
            let (corner, opposite) = (corner - margin, opposite + margin);
            if !reaches_out && !eye.sees(corner, opposite) {
                culled.counts.outside += 1;
                continue;
            }
            // The normal cone covers only the triangles at vertex stride 1 without stitching.
            if culls.back_faces && deltas == 0 && log2_stride == 0 && faces_away(patch, [corner, opposite], eye) {
                culled.counts.facing_away += 1;
                continue;
            }
            let patch = Patch {
                node_origin: [origin.x as f32, origin.y as f32],
                spacing: (patch_m / f64::from(PATCH_QUADS)) as f32,
                slot,
                patch: [column, row],
                deltas,
                lod: u32::from(node.lod),
            };
            let distance = eye.camera.distance_squared(eye.camera.clamp(corner, opposite));
            let [low, high] = [DVec3::NEG_INFINITY, DVec3::INFINITY];
            found.push((distance, patch, PatchBox::of(if reaches_out { [low, high] } else { [corner, opposite] }), log2_stride));
        }
    }
    if culls.nearest_first {
        found.sort_by(|(a, ..), (b, ..)| a.total_cmp(b));
    }
    for (_, patch, bounds, log2_stride) in found {
        culled.patches.push(patch);
        culled.boxes.push(bounds);
        culled.log2_strides.push(log2_stride);
    }
    culled
}

/// Whether the normal cone of a patch proves that all its triangles face away from a camera. `low` and `high` are the corners of the box around the
/// patch.
fn faces_away(patch: &PatchBounds, [low, high]: [DVec3; 2], eye: &View) -> bool {
    let middle = (low + high) / 2.0;
    culling::faces_away(patch.cone.axis, patch.cone.sin_half_angle, (middle - eye.camera).to_array(), middle.distance(high))
}

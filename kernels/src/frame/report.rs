//! The report of one frame.

use std::sync::Arc;

use crate::base::section::Section;
use crate::culling::{CullCounts, Levels};
use crate::frame::edit::EditCounts;
use crate::gpu::PassTime;
use crate::quadtree::Lag;
use crate::residency::AtlasCounts;
use crate::virtual_texture::{CacheCounts, PageCounts};
use crate::world::NodeId;

/// Numbers of one frame: what was drawn and loaded, and the times of the passes.
#[derive(Clone, Debug, Default)]
pub struct FrameReport {
    /// Time on the device of each timed pass. The times of passes of the same name are added. Passes that render pages of the virtual texture are not
    /// timed. Empty if the device has no timestamps.
    pub passes: Vec<PassTime>,
    /// Wall-clock time for selecting and loading nodes, culling patches and uploading the patch list, milliseconds. 0 if the geometry of the last
    /// frame was reused.
    pub selection_ms: f64,
    /// Number of nodes visited: the nodes selected for drawing, and their ancestors in the quadtree.
    pub visited: usize,
    /// Number of nodes that were baked for this frame, because they were not resident. Methods that select nodes without drawing, such as
    /// [`Renderer::drawn_ground_m`](crate::frame::Renderer::drawn_ground_m), also bake nodes; these count for the next frame. 0 if the geometry of
    /// the previous frame was reused.
    pub loaded: usize,
    /// Counts of the nodes and texture layers that were rebuilt since the previous frame, because the scene was edited.
    pub edited: EditCounts,
    /// Number of nodes selected for drawing, including those outside the frustum.
    pub nodes: usize,
    /// Number of patches drawn.
    pub patches: usize,
    /// Number of triangles drawn, including those outside the picture and those that face away.
    pub triangles: usize,
    /// Numbers of patches that were culled, by the test that removed them.
    pub culled: CullCounts,
    /// How much coarser the drawn nodes are than they would be if all nodes were available; zero if
    /// [`Residency::Settled`](crate::residency::Residency::Settled) was requested.
    pub lag: Lag,
    /// The nodes selected for drawing. They cover the ground and do not overlap.
    pub drawn: Vec<NodeId>,
    /// The levels (LOD of the node plus log2 of the vertex stride) of the patches of the nodes in `drawn`.
    pub levels: Arc<Levels>,
    /// Counts of the atlases, after the nodes of this frame were loaded.
    pub atlas: AtlasCounts,
    /// Numbers of virtual-texture pages that the frame requested and rendered.
    pub pages: PageCounts,
    /// Counts of the cached pages, after the missing pages of this frame were rendered.
    pub page_cache: CacheCounts,
    /// The number of tiles with terrain, followed by the number of tiles of each variant 1..=31.
    pub tiles: Vec<u32>,
    /// Numbers for people to read, stage by stage.
    pub sections: Vec<Section>,
}

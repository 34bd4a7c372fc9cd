//! The report of one frame.

use crate::base::section::Section;
use crate::frame::edit::EditCounts;
use crate::gpu::PassTime;
use crate::residency::AtlasCounts;
use crate::virtual_texture::{CacheCounts, PageCounts};
use crate::world::NodeId;

/// What was drawn, loaded and measured for one frame.
#[derive(Clone, Debug, Default)]
pub struct FrameReport {
    /// Time of each pass on the device.
    pub passes: Vec<PassTime>,
    /// Number of nodes visited: the nodes drawn, and their ancestors in the quadtree.
    pub visited: usize,
    /// Number of nodes that were not resident and were therefore baked for this frame.
    pub loaded: usize,
    /// Counts of the nodes and texture layers that were rebuilt since the previous frame, because the scene was edited.
    pub edited: EditCounts,
    /// Number of nodes drawn.
    pub nodes: usize,
    /// Number of patches drawn.
    pub patches: usize,
    /// The nodes drawn; they do not overlap.
    pub drawn: Vec<NodeId>,
    /// The atlases after this frame's loading.
    pub atlas: AtlasCounts,
    /// How many virtual-texture pages the frame requested and rendered.
    pub pages: PageCounts,
    /// The cached pages after this frame's rendering.
    pub page_cache: CacheCounts,
    /// The number of tiles with terrain, followed by the number of tiles of each variant 1..=31.
    pub tiles: Vec<u32>,
    /// Numbers for people to read, stage by stage.
    pub sections: Vec<Section>,
}

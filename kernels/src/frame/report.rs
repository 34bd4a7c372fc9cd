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
    /// Nodes visited: the nodes drawn, and the nodes above them.
    pub visited: usize,
    /// Nodes that were not resident and were baked for this frame.
    pub loaded: usize,
    /// How many nodes and texture layers edits of the scene have rebuilt since the previous frame.
    pub edited: EditCounts,
    /// Nodes drawn.
    pub nodes: usize,
    /// Patches drawn.
    pub patches: usize,
    /// The nodes drawn; they do not overlap.
    pub drawn: Vec<NodeId>,
    /// The atlases after this frame's loading.
    pub atlas: AtlasCounts,
    /// How many virtual-texture pages the frame requested and rendered.
    pub pages: PageCounts,
    /// The cached pages after this frame's rendering.
    pub page_cache: CacheCounts,
    /// Number of tiles: all tiles with terrain, then the tiles of each variant 1..=31.
    pub tiles: Vec<u32>,
    /// Numbers for people to read, stage by stage.
    pub sections: Vec<Section>,
}

//! Simulated streaming: the nodes that have arrived in each frame, as a function of the earlier views.
//!
//! Source: Moore, GDC 2018, "Stream Quad Tree": the terrain is drawn correctly whatever has arrived. Real loading depends on the disk, on threads and
//! on the clock, so its pictures cannot be repeated. Here, a node arrives a fixed number of frames after its request, and a limited number of nodes
//! is requested per frame. So a frame depends on its view and the earlier views, but not on what the atlases hold: a node that has arrived and was
//! replaced in the atlases is baked again when it is visited.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use super::CAPACITY;
use crate::quadtree::{Selection, Wanted};
use crate::world::{LODS, NodeId};

/// The nodes that a frame can draw.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Residency {
    /// All nodes. The frame waits for those that it visits.
    #[default]
    Settled,
    /// The nodes that have arrived according to an [`Arrivals`]. The number identifies the set of nodes
    /// ([`Renderer::arrive`](crate::frame::Renderer::arrive)).
    Arrived(u64),
}

/// The setting from which the [`Residency`] of a frame follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Loading {
    /// [`Residency::Settled`].
    #[default]
    Settled,
    /// [`Residency::Arrived`], with a [`Schedule`].
    Scheduled,
}

impl Loading {
    /// Both values.
    pub const ALL: [Loading; 2] = [Loading::Settled, Loading::Scheduled];

    /// The name used in files.
    pub const fn name(self) -> &'static str {
        match self {
            Loading::Settled => "settled",
            Loading::Scheduled => "scheduled",
        }
    }
}

/// The speed of simulated streaming.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Largest number of nodes that are requested in one frame, at least 1.
    pub nodes_per_frame: u32,
    /// Number of frames from the request of a node to the first frame that can draw it, at least 1.
    pub latency_frames: u32,
}

impl Default for Schedule {
    /// A payload has 72 419 bytes, so 8 nodes per frame are at most 17.4 MB/s at 30 frames per second.
    fn default() -> Schedule {
        Schedule { nodes_per_frame: 8, latency_frames: 8 }
    }
}

/// A set of nodes.
pub type NodeSet = Arc<BTreeSet<NodeId>>;

/// The state of simulated streaming.
#[derive(Clone, Debug)]
pub struct Arrivals {
    schedule: Schedule,
    /// Number of the next frame.
    frame: u64,
    /// For each node that has arrived, except the roots: the last frame that visited it or, before its first visit, the frame after which it arrived.
    used: BTreeMap<NodeId, u64>,
    /// For each node that was requested and has not arrived: the first frame that can draw it.
    requested: BTreeMap<NodeId, u64>,
    arrived: NodeSet,
}

fn is_root(node: NodeId) -> bool {
    node.lod + 1 == LODS
}

impl Arrivals {
    /// Starts the simulation. `nodes`: the nodes that have arrived before the first frame; those for which there is no room are left out. The roots
    /// have always arrived and are never replaced.
    pub fn new(schedule: Schedule, nodes: impl IntoIterator<Item = NodeId>) -> Arrivals {
        let mut arrivals = Arrivals { schedule, frame: 0, used: BTreeMap::new(), requested: BTreeMap::new(), arrived: NodeSet::default() };
        let room = arrivals.room();
        arrivals.used = nodes.into_iter().filter(|&node| !is_root(node)).take(room).map(|node| (node, 0)).collect();
        arrivals.publish();
        arrivals
    }

    /// Largest number of nodes that can be held in addition to the roots.
    fn room(&self) -> usize {
        CAPACITY as usize - NodeId::roots().count()
    }

    fn publish(&mut self) {
        self.arrived = Arc::new(NodeId::roots().chain(self.used.keys().copied()).collect());
    }

    /// The nodes that have arrived before the next frame, the roots included.
    pub fn arrived(&self) -> &NodeSet {
        &self.arrived
    }

    /// Number of nodes that were requested and have not arrived.
    pub fn pending(&self) -> usize {
        self.requested.len()
    }

    /// Ends a frame that drew `selection`. The most urgent of its wanted nodes are requested. Then the nodes that are due for the next frame arrive.
    /// If the atlases have no room for an arriving node, it replaces the node that has not been visited for the longest time. Nodes of the ended
    /// frame are not replaced. If there are no others, the arriving node is discarded, and has to be requested again.
    pub fn step(&mut self, selection: &Selection) {
        // Available nodes below a missing one count as visited, so that they are not replaced before they can be drawn.
        let held = selection.wanted.iter().filter(|wanted| wanted.is_available).map(|wanted| &wanted.node);
        for node in selection.visited.iter().chain(held) {
            if let Some(used) = self.used.get_mut(node) {
                *used = self.frame;
            }
        }
        let mut wanted: Vec<&Wanted> =
            selection.wanted.iter().filter(|wanted| !wanted.is_available && !self.requested.contains_key(&wanted.node)).collect();
        wanted.sort_by(|a, b| urgency(a, b));
        for wanted in wanted.into_iter().take(self.schedule.nodes_per_frame as usize) {
            self.requested.insert(wanted.node, self.frame + u64::from(self.schedule.latency_frames));
        }
        let ended = self.frame;
        self.frame += 1;
        let due: Vec<NodeId> = self.requested.iter().filter(|(_, frame)| **frame <= self.frame).map(|(&node, _)| node).collect();
        if due.is_empty() {
            return;
        }
        // The nodes that may be replaced: those that were not visited for the longest time come first. Of nodes whose last visit was in the same
        // frame, the finer ones come first, because a node can only be drawn if its ancestors have arrived.
        let mut idle: Vec<(u64, NodeId)> = self.used.iter().filter(|(_, used)| **used < ended).map(|(&node, &used)| (used, node)).collect();
        idle.sort_unstable();
        let mut idle = idle.into_iter();
        for node in due {
            self.requested.remove(&node);
            if self.used.len() >= self.room() {
                let Some((_, oldest)) = idle.next() else { continue };
                self.used.remove(&oldest);
            }
            self.used.insert(node, ended);
        }
        self.publish();
    }
}

/// Compares two requests by urgency. Nodes whose parent is in view come first. Then the distance of the parent decides, in units of the parent's edge
/// length; then coarse nodes come before fine ones. The identifiers decide the rest, so the order of the traversal does not matter.
///
/// The children of a node follow each other in this order, because they are needed together: a node is split only if all its children have arrived.
fn urgency(a: &Wanted, b: &Wanted) -> Ordering {
    (b.is_in_view.cmp(&a.is_in_view))
        .then(a.distance.total_cmp(&b.distance))
        .then(b.node.lod.cmp(&a.node.lod))
        .then(a.node.parent().cmp(&b.node.parent()))
        .then(a.node.cmp(&b.node))
}

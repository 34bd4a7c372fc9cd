//! The selection of nodes from those that are available, and simulated streaming.

use std::sync::atomic::{AtomicU64, Ordering};

use super::{RenderRequest, Renderer};
use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::quadtree::{self, Selection};
use crate::residency::{Arrivals, NodeSet, Residency, Schedule};
use crate::view::camera::View;

/// The set of nodes that had arrived before the last frame of simulated streaming.
#[derive(Default)]
pub(super) struct Arrived {
    /// Identifies the set, see [`Residency::Arrived`].
    number: u64,
    nodes: NodeSet,
}

impl Renderer<'_> {
    /// Starts simulated streaming. At the start, all nodes that the request needs have arrived.
    ///
    /// # Errors
    /// When [`RenderRequest::check`] refuses the request, the view needs more nodes than fit in the atlases, or the device fails.
    pub fn arrivals(&mut self, schedule: Schedule, request: &RenderRequest) -> Result<Arrivals> {
        let settled = request.with(|r| r.geometry.residency = Residency::Settled);
        let selection = self.selection(&settled)?;
        Ok(Arrivals::new(schedule, selection.visited))
    }

    /// Advances simulated streaming by one frame. Returns the [`Residency`] for this frame's request, which says what nodes may be drawn, and the
    /// selection of its nodes. Missing nodes are scheduled to arrive in later frames. A [`RenderRequest`] with the returned residency can be drawn at
    /// least until the next call of this method.
    ///
    /// # Errors
    /// The same errors as [`Renderer::arrivals`].
    pub fn arrive(&mut self, arrivals: &mut Arrivals, request: &RenderRequest) -> Result<(Residency, Selection)> {
        if self.arrived.nodes != *arrivals.arrived() {
            self.arrived = Arrived { number: self.arrived.number + 1, nodes: arrivals.arrived().clone() };
        }
        let residency = Residency::Arrived(self.arrived.number);
        let selection = self.selection(&request.with(|r| r.geometry.residency = residency))?;
        arrivals.step(&selection);
        Ok((residency, selection))
    }

    /// Selects the nodes of a request without drawing it.
    fn selection(&mut self, request: &RenderRequest) -> Result<Selection> {
        request.check(&self.gpu.device.limits(), self.options.tile)?;
        // The geometry of the last frame cannot be reused after a selection, because the selection may evict nodes of that frame from the atlases. A
        // frame with the reused geometry would still need these nodes for its pages and its shading.
        self.drawn = None;
        let eye = self.eye(request);
        self.select_nodes(request, &eye)
    }

    /// Selects the nodes for the view `eye` and makes them resident.
    pub(super) fn select_nodes(&mut self, request: &RenderRequest, eye: &View) -> Result<Selection> {
        let arrived = match request.geometry.residency {
            Residency::Settled => None,
            Residency::Arrived(number) if number == self.arrived.number => Some(self.arrived.nodes.clone()),
            Residency::Arrived(_) => {
                return Err(Error::Request(
                    "the request needs the nodes that had arrived in an earlier frame: make this frame again".to_owned(),
                ));
            }
        };
        self.streaming.begin_frame();
        let (streaming, world, means, progress, gpu) = (&mut self.streaming, &self.world, &self.means, self.progress, &self.gpu);
        let done = AtomicU64::new(0);
        let is_available = |node| arrived.as_ref().is_none_or(|arrived| arrived.contains(&node));
        quadtree::select(world, eye, request.geometry.lod_bias, is_available, |nodes| {
            let on_baked = || {
                let done = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(Progress { stage: "terrain nodes".to_owned(), done, total: 0 });
            };
            streaming.load(gpu, world, means, nodes, &on_baked)
        })
    }
}

//! Simulated streaming for the frames of a view (`frame.residency`).

use anyhow::Result;
use kernels::frame::{FrameSettings, RenderRequest, Renderer};
use kernels::residency::{Arrivals, Residency};

use super::views;
use crate::definition::Definition;

/// Simulated streaming of the view that is being drawn. The nodes of a frame depend on the settings, this frame and the earlier frames of the view.
/// Parts with the same setting therefore draw the same nodes, whatever the order of the parts and their division into shards.
#[derive(Default)]
pub(super) struct Streamed {
    last: Option<Last>,
}

/// The last frame whose residency was computed.
struct Last {
    view: String,
    frame: u32,
    arrivals: Arrivals,
    residency: Residency,
}

impl Streamed {
    /// Returns `request` with the residency of its frame, which is the set of terrain nodes that have arrived by then. If streaming is not simulated,
    /// the request is unchanged. `request` must draw frame `frame` of the view `view`. If the last call was for another view or a later frame,
    /// streaming starts again with frame 0 of the view.
    ///
    /// # Errors
    /// The view does not exist, or the device fails.
    pub(super) fn request(
        &mut self,
        renderer: &mut Renderer<'_>,
        definition: &Definition,
        choices: &FrameSettings,
        view: &str,
        frame: u32,
        request: RenderRequest,
    ) -> Result<RenderRequest> {
        let Some(schedule) = choices.schedule() else { return Ok(request) };
        let known = self.last.take().filter(|last| last.view == view && last.frame <= frame);
        let mut last = match known {
            Some(last) => last,
            None => {
                let first = choices.request(views::pose(definition, renderer, view, 0)?, definition.size, 0);
                let mut arrivals = renderer.arrivals(schedule, &first)?;
                let (residency, _) = renderer.arrive(&mut arrivals, &first)?;
                Last { view: view.to_owned(), frame: 0, arrivals, residency }
            }
        };
        while last.frame < frame {
            last.frame += 1;
            let next = choices.request(views::pose(definition, renderer, view, last.frame)?, definition.size, last.frame);
            (last.residency, _) = renderer.arrive(&mut last.arrivals, &next)?;
        }
        let residency = last.residency;
        self.last = Some(last);
        Ok(request.with(|r| r.geometry.residency = residency))
    }
}

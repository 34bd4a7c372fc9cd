//! Live metrics of the pictures A and B of a comparison ([`crate::model::compare`]) as they are drawn: variance, bias, flips, flicker, residual
//! flicker and clumping. Surface points are followed from frame to frame.

use std::collections::VecDeque;

use kernels::base::error::Result;
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::metrics::{Followed, Sample, Summary};
use kernels::motion::{Links, NO_LINK};
use kernels::shared::signal::luminance;
use kernels::variant::{Flavour, Variant};
use rayon::prelude::*;

use crate::model::metrics::{LAYERS, Metrics, Reading};
use crate::model::settings::Settings;

/// Maximum number of frames in the plots.
const HISTORY: usize = 240;

/// The state of the live metrics.
#[derive(Default)]
pub struct Live {
    links: Option<Links>,
    followed: [Followed; 2],
    /// The settings of A and B, and the value of `Metrics::resets`, for which the metrics were measured.
    of: Option<([Option<Settings>; 2], u32)>,
    /// The request of the last picture that was measured. A picture of the same frame and pose, for example with another layer, is not measured
    /// again.
    last: Option<RenderRequest>,
    /// The region of the picture ([`Metrics::region`]) for which the metrics were computed last.
    region: Option<[f32; 4]>,
    history: VecDeque<Reading>,
}

impl Live {
    /// Adds the pictures of A and B in one frame to the metrics. Call this right after they were drawn. `request` must be the request with which A
    /// was drawn.
    ///
    /// # Errors
    /// The device fails.
    pub fn take(
        &mut self,
        renderer: &mut Renderer<'_>,
        metrics: &Metrics,
        request: &RenderRequest,
        settings: [Option<&Settings>; 2],
        pictures: [Option<&Picture>; 2],
    ) -> Result<()> {
        let same_size = self.links.as_ref().is_some_and(|links| links.size() == request.view.size);
        if metrics.frozen && same_size && self.of.as_ref().is_some_and(|of| of.1 == metrics.resets) {
            self.sum_again(metrics, request.view.size);
            return Ok(());
        }
        let kept = |of: &([Option<Settings>; 2], u32)| {
            of.1 == metrics.resets
                && of.0.iter().zip(settings).all(|pair| match pair {
                    (Some(before), Some(now)) => before.looks_like(now),
                    (None, None) => true,
                    _ => false,
                })
        };
        if !self.of.as_ref().is_some_and(kept) || !same_size {
            self.followed.iter_mut().for_each(Followed::reset);
            self.history.clear();
            self.last = None;
            self.of = Some((settings.map(|s| s.cloned()), metrics.resets));
        }
        if !same_size {
            self.links = Some(renderer.links(request.view.size)?);
        }
        let again =
            self.last.as_ref().is_some_and(|last| (last.shading.frame, last.view.pose) == (request.shading.frame, request.view.pose));
        let Some(links) = self.links.as_mut().filter(|_| !again) else {
            self.sum_again(metrics, request.view.size);
            return Ok(());
        };
        let mut found = match renderer.drawn_as(request) {
            Ok(frame) => frame.link(links)?,
            // The geometry of the last picture is not that of A, for example because B was drawn with another LOD bias. The links between pixels of
            // two frames need the geometry of A, so draw A again with the cheapest shading.
            Err(_) => {
                let again = request.with(|r| {
                    r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
                    r.outputs.aovs = AovSet::default();
                    r.outputs.lit = false;
                    r.outputs.count_fetches = false;
                });
                renderer.draw(&again)?.link(links)?
            }
        };
        // Flips, flicker and residual flicker compare consecutive frames, or two pictures of one frame with different poses (a camera that moves
        // while time is paused). If a frame is missing, no surface point is followed across the gap.
        let follows = |last: &RenderRequest| {
            request.shading.frame == last.shading.frame || request.shading.frame == last.shading.frame.wrapping_add(1)
        };
        if !self.last.as_ref().is_some_and(follows) {
            found.fill(NO_LINK);
            self.history.clear();
        }
        let links = found;
        self.last = Some(*request);
        let [a, b] = pictures.map(|picture| picture.and_then(samples));
        if let (Some(a), Some(b)) = (&a, &b) {
            let against = |a: &Sample, b: &Sample| Sample { error: a.luminance - b.luminance, ..*a };
            let a: Vec<Sample> = a.par_iter().zip(b).map(|(a, b)| against(a, b)).collect();
            self.followed[0].take(request.view.size, &a, &links, metrics.window, true);
            self.followed[1].take(request.view.size, b, &links, metrics.window, false);
        } else if let Some(a) = &a {
            self.followed[0].take(request.view.size, a, &links, metrics.window, false);
        }
        if self.region != metrics.region {
            self.history.clear();
            self.region = metrics.region;
        }
        self.history.push_back(Reading { frame: request.shading.frame, sides: self.summaries(metrics, request.view.size) });
        if self.history.len() > HISTORY {
            self.history.pop_front();
        }
        Ok(())
    }

    /// If the region changed, computes the metrics of the last frame for the new region, and restarts the history with them.
    fn sum_again(&mut self, metrics: &Metrics, size: [u32; 2]) {
        if let (true, Some(last)) = (self.region != metrics.region, self.history.back().copied()) {
            self.region = metrics.region;
            self.history = VecDeque::from([Reading { sides: self.summaries(metrics, size), ..last }]);
        }
    }

    /// The current metrics of A and of B in the measured region; `None` = this side was not measured, or the region shows no terrain.
    fn summaries(&self, metrics: &Metrics, size: [u32; 2]) -> [Option<Summary>; 2] {
        let [left, top, right, bottom] = metrics.region.unwrap_or([0.0, 0.0, 1.0, 1.0]);
        let at = |share: f32, side: u32| (f64::from(share.clamp(0.0, 1.0)) * f64::from(side)).round() as usize;
        let (low, high) = ([at(left, size[0]), at(top, size[1])], [at(right, size[0]), at(bottom, size[1])]);
        self.followed.each_ref().map(|f| if f.points().is_empty() { None } else { f.summary(low, high) })
    }

    /// The statistics of each pixel of A (`index` 0) or of B (1).
    pub fn side(&self, index: usize) -> &Followed {
        &self.followed[index]
    }

    /// The readings of the last frames, the newest last.
    pub fn history(&self) -> Vec<Reading> {
        self.history.iter().copied().collect()
    }
}

/// The samples of all pixels of a picture, if it has the necessary layers.
fn samples(picture: &Picture) -> Option<Vec<Sample>> {
    let (albedo, choices) = (picture.vectors(LAYERS[0])?, picture.values(LAYERS[1])?);
    let sample = |((albedo, &choice), seen): ((&[f32; 3], &f32), &[f32; 4])| Sample {
        luminance: if seen[3] > 0.0 { luminance(*albedo) as f32 } else { -1.0 },
        choice: choice as u8,
        error: 0.0,
    };
    Some(albedo.par_iter().zip(choices).zip(&picture.hdr).map(sample).collect())
}

//! The flight of `bench`: how many patches culling removes along 10 km.

use anyhow::Result;
use glam::DVec3;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use serde::Serialize;

use crate::cli::BenchArgs;
use crate::process::check_interrupted;

/// Number of pictures of the flight.
const PICTURES: u32 = 32;
/// The target of the project for the share of patches that culling removes on the flight, as text.
const TARGET: &str = "at least 60 %";

/// Length of the flight, metres.
pub(super) const LENGTH_M: f64 = 10_000.0;

/// Returns a camera pose of the flight: 10 km in a straight line from the south-west to the north-east of the built-in world, 30 m above
/// the ground, with the camera pitched down by 10 degrees. `t`: 0 = start, 1 = end.
pub(super) fn pose(t: f64, ground_m: impl Fn(f64, f64) -> f64) -> Pose {
    let along = (t - 0.5) * LENGTH_M * std::f64::consts::FRAC_1_SQRT_2;
    Pose {
        position: DVec3::new(along, along, ground_m(along, along) + 30.0),
        yaw: 45f64.to_radians(),
        pitch: -10f64.to_radians(),
        fov: 60f64.to_radians(),
    }
}

/// The number of patches of the selected nodes on the flight, and how many of these patches culling removes.
pub(super) struct Flight {
    /// Number of patches of the selected nodes, over all pictures.
    patches: usize,
    /// Numbers of removed patches: those outside the frustum, those that face away from the camera, and those that are hidden.
    removed: [usize; 3],
}

impl Flight {
    pub(super) fn new(renderer: &mut Renderer<'_>, args: &BenchArgs, step: &dyn Fn(u64, u64)) -> Result<Flight> {
        let mut flown = Flight { patches: 0, removed: [0; 3] };
        for picture in 0..PICTURES {
            check_interrupted()?;
            step(picture.into(), PICTURES.into());
            let pose = pose(f64::from(picture) / f64::from(PICTURES - 1), |x, y| renderer.ground_m(x, y));
            // Only the geometry matters, so the shading is cheap.
            let request = RenderRequest::new(pose, args.size).with(|r| {
                r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
                r.outputs.lit = false;
            });
            let report = renderer.draw(&request)?.into_report();
            let removed = [report.culled.outside, report.culled.facing_away, report.culled.hidden];
            flown.patches += report.patches + removed.iter().sum::<usize>();
            flown.removed.iter_mut().zip(removed).for_each(|(sum, n)| *sum += n);
        }
        Ok(flown)
    }

    /// The share of the patches that was removed.
    pub(super) fn share(&self) -> f64 {
        self.removed.iter().sum::<usize>() as f64 / self.patches.max(1) as f64
    }

    /// The shares as text, with the target of the project.
    pub(super) fn text(&self) -> String {
        let percent = |n: usize| format!("{:.1} %", 100.0 * n as f64 / self.patches.max(1) as f64);
        let [outside, facing_away, hidden] = self.removed.map(percent);
        format!(
            "flight of 10 km, {PICTURES} pictures, {} patches\n  {:<46} {:>24}   target: {TARGET}\n    outside the frustum {outside}, facing away \
             {facing_away}, hidden {hidden}\n",
            self.patches,
            "patches that culling removes",
            percent(self.removed.iter().sum()),
        )
    }

    /// The counts in the output of `--json`.
    pub(super) fn figures(&self) -> Figures {
        let [outside, facing_away, hidden] = self.removed;
        Figures {
            pictures: PICTURES,
            patches: self.patches,
            patches_culled_share: self.share(),
            outside,
            facing_away,
            hidden,
            target: TARGET,
        }
    }
}

/// The counts of the flight in the output of `--json`. They are not estimates, so they have no interval.
#[derive(Serialize)]
pub(super) struct Figures {
    pictures: u32,
    /// Number of patches of the selected nodes, over all pictures.
    patches: usize,
    /// Share of these patches that culling removes.
    patches_culled_share: f64,
    outside: usize,
    facing_away: usize,
    hidden: usize,
    target: &'static str,
}

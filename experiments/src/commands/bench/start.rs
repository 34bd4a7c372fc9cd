//! The starts of `bench`: the time from a scene to its first picture, with an empty cache of nodes and textures and with a filled one.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use kernels::base::cache::Cache;
use kernels::frame::{RenderRequest, Renderer, RendererOptions};
use kernels::gpu::Gpu;
use kernels::scene::Scene;
use kernels::view::camera::Pose;

use crate::cli::BenchArgs;
use crate::process::check_interrupted;
use crate::rounds::{Estimate, Samples, Timed, Wanted};

/// Name of the ratio in the output of `--json`.
pub(super) const NAME: &str = "start_warm_over_cold";
/// The target of the project for this ratio, as text.
pub(super) const TARGET: &str = "at most 0.5";

/// The measured time: world, textures, shaders, nodes and the first picture.
const START: &str = "start (wall clock)";
/// The candidate whose cache is filled.
const WARM: usize = 0;
/// The candidate whose cache is empty.
const COLD: usize = 1;

/// A temporary folder for caches. It is removed when this value is dropped.
struct Folder(PathBuf);

impl Folder {
    fn new() -> Folder {
        Folder(std::env::temp_dir().join(format!("scree-bench-{}", std::process::id())))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // The folder does not exist if no node was written. A folder that cannot be removed is left behind.
        drop(std::fs::remove_dir_all(&self.0));
    }
}

/// Measures the times of both starts, with a view of the scene's first camera.
pub(super) fn measure(gpu: &Gpu, scene: &Scene, args: &BenchArgs, step: &dyn Fn(u64, u64)) -> Result<Samples> {
    let folder = Folder::new();
    let wanted = [Wanted { of: (WARM, START), over: Some((COLD, START)) }];
    // The first round, which is not timed, fills the cache of the candidate `WARM`.
    super::measure(2, &wanted, args, step, &mut |turn| {
        check_interrupted()?;
        let name = if turn.candidate == WARM { "warm".to_owned() } else { format!("cold-{}", turn.round) };
        let place = folder.0.join(name);
        let cache = Arc::new(Cache::new(place.clone(), u64::MAX));
        let began = Instant::now();
        let mut renderer = Renderer::with(gpu, scene, RendererOptions { cache: Some(cache), ..RendererOptions::default() }, &|_| {})?;
        let pose = Pose::of(&scene.cameras[0], |x, y| renderer.ground_m(x, y));
        renderer.render(&RenderRequest::new(pose, args.size))?;
        let ms = began.elapsed().as_secs_f64() * 1e3;
        if turn.candidate == COLD {
            drop(std::fs::remove_dir_all(place));
        }
        Ok(vec![Timed { candidate: turn.candidate, pass: START.to_owned(), ms }])
    })
}

/// The ratio of the two times.
pub(super) fn ratio(samples: &Samples) -> Option<Estimate> {
    samples.ratio((WARM, START), (COLD, START))
}

/// The ratio and the two times as text.
pub(super) fn text(samples: &Samples) -> String {
    let seconds = |candidate: usize| samples.time((candidate, START)).map_or(0.0, |time| time.value / 1e3);
    format!(
        "start, from a scene to its first picture: {:.1} s with an empty cache, {:.1} s with a filled one\n  {:<46} {:>24}   target: \
         {TARGET}\n",
        seconds(COLD),
        seconds(WARM),
        "start, filled cache / empty cache",
        super::shown(ratio(samples), false),
    )
}

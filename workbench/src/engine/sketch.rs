//! The first look at a scene: drawn from small textures on coarse terrain by the cheapest shader, while the scene's own textures are being made.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

use kernels::base::error::{Error, Result};
use kernels::base::progress::Progress;
use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::materials::Palette;
use kernels::quadtree::LOD_BIASES;
use kernels::scene::Scene;
use kernels::variant::{Flavour, Variant};

/// Edge of the textures that a scene is first drawn with, texels: they are made in less time than the first shader.
pub const TEXELS: u32 = 64;

/// How often it is asked whether they are there.
pub const INTERVAL: Duration = Duration::from_millis(30);

/// Tells how far something is.
pub type Tell = Arc<dyn Fn(Progress) + Send + Sync>;

/// A scene whose textures are in the making.
pub struct Sketch {
    /// What they are made for.
    scene: Scene,
    sector_m: f64,
    /// Where they come from, once they are being made.
    finished: Option<Receiver<Result<Palette>>>,
    /// Whether nobody waits for them any more.
    abandoned: Arc<AtomicBool>,
}

impl Sketch {
    /// Of the scene that a renderer draws, if it has only small textures for it.
    pub fn of(renderer: &Renderer<'_>) -> Option<Sketch> {
        let sector_m = renderer.world().layout().sector_m;
        renderer.is_sketch().then(|| Sketch { scene: renderer.scene().clone(), sector_m, finished: None, abandoned: Arc::default() })
    }

    /// Begins with the textures, unless that was done. They take every core, so that it is called once there is a picture; and workers of their own,
    /// since pictures that are drawn meanwhile have theirs.
    pub fn begin(&mut self, tell: &Tell) {
        let (scene, sector_m, tell, abandoned) = (self.scene.clone(), self.sector_m, tell.clone(), self.abandoned.clone());
        self.finished.get_or_insert_with(|| {
            let (sender, finished) = channel();
            std::thread::spawn(move || {
                let progress = |name: &str| {
                    if abandoned.load(Ordering::Relaxed) {
                        return Err(Error::Request("nobody waits for these textures any more".to_owned()));
                    }
                    tell(Progress { stage: name.to_owned(), done: 0, total: 0 });
                    Ok(())
                };
                let build = || Palette::build(&scene, sector_m, progress);
                let palette = match rayon::ThreadPoolBuilder::new().build() {
                    Ok(workers) => workers.install(build),
                    Err(_) => build(),
                };
                // Where another scene was opened, nobody does.
                let _ = sender.send(palette);
            });
            finished
        });
    }

    /// Takes the textures over once they are there. `None` = not yet; else whether the renderer draws with its scene's own textures now, or why there
    /// are none.
    pub fn step(&mut self, renderer: &mut Renderer<'_>) -> Option<std::result::Result<(), String>> {
        match self.finished.as_ref()?.try_recv() {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err("making textures stopped by an internal error; please report it".to_owned())),
            Ok(Err(error)) => Some(Err(error.to_string())),
            Ok(Ok(palette)) => {
                debug_assert!(self.scene.materials == renderer.scene().materials, "another palette was made for other materials");
                renderer.take_palette(palette);
                Some(Ok(()))
            }
        }
    }
}

impl Drop for Sketch {
    fn drop(&mut self) {
        self.abandoned.store(true, Ordering::Relaxed);
    }
}

/// The picture that is drawn in place of another for a first look.
pub fn draft(request: &RenderRequest) -> RenderRequest {
    request.with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
        r.geometry.lod_bias = LOD_BIASES[1];
        r.outputs.aovs = AovSet::default();
        r.outputs.count_fetches = false;
        r.outputs.time_variants = false;
    })
}

//! The first look at a scene (sketch). It is drawn with small textures, coarse terrain and the cheapest shader while the textures of the scene are
//! being made.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

use kernels::base::cache::Cache;
use kernels::base::error::{Error, Result};
use kernels::base::progress::Progress;
use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::materials::Palette;
use kernels::quadtree::LOD_BIASES;
use kernels::scene::Scene;
use kernels::variant::{Flavour, Variant};

/// Width and height of the textures of a first look, texels. Making these textures usually takes less time than compiling the first shader.
pub const TEXELS: u32 = 64;

/// Time between two checks whether the textures of the scene are ready.
pub const INTERVAL: Duration = Duration::from_millis(30);

/// Reports progress.
pub type Tell = Arc<dyn Fn(Progress) + Send + Sync>;

/// A scene whose textures are being made. Until they are ready, a first look at the scene is drawn.
pub struct Sketch {
    /// The scene for which the textures are made.
    scene: Scene,
    sector_m: f64,
    /// Where the textures are kept.
    cache: Option<Arc<Cache>>,
    /// Receives the finished textures; `None` = making them has not begun.
    finished: Option<Receiver<Result<Palette>>>,
    /// Whether the textures are no longer needed.
    abandoned: Arc<AtomicBool>,
}

impl Sketch {
    /// The sketch for the scene of a renderer; `None` = the renderer already has the full textures of the scene.
    pub fn of(renderer: &Renderer<'_>) -> Option<Sketch> {
        let sector_m = renderer.world().layout().sector_m;
        let cache = renderer.cache().cloned();
        renderer.is_sketch().then(|| Sketch { scene: renderer.scene().clone(), sector_m, cache, finished: None, abandoned: Arc::default() })
    }

    /// Begins to make the textures, unless this function was called before. Making them uses all cores, so call this function after the first
    /// picture. A separate thread pool is used, if one can be made, because drawing uses the global thread pool at the same time.
    pub fn begin(&mut self, tell: &Tell) {
        let (scene, sector_m, cache) = (self.scene.clone(), self.sector_m, self.cache.clone());
        let (tell, abandoned) = (tell.clone(), self.abandoned.clone());
        self.finished.get_or_insert_with(|| {
            let (sender, finished) = channel();
            std::thread::spawn(move || {
                let progress = |name: &str| {
                    if abandoned.load(Ordering::Relaxed) {
                        return Err(Error::Request("these textures are no longer needed".to_owned()));
                    }
                    tell(Progress { stage: name.to_owned(), done: 0, total: 0 });
                    Ok(())
                };
                let build = || Palette::kept(&scene, scene.detail_size, sector_m, cache.as_deref(), progress);
                let palette = match rayon::ThreadPoolBuilder::new().build() {
                    Ok(workers) => workers.install(build),
                    Err(_) => build(),
                };
                // Sending fails if another scene was opened in the meantime.
                let _ = sender.send(palette);
            });
            finished
        });
    }

    /// Passes the textures to the renderer once they are ready. `None` = they are not ready; `Ok` = the renderer now draws with them; `Err` = why
    /// they could not be made.
    pub fn step(&mut self, renderer: &mut Renderer<'_>) -> Option<std::result::Result<(), String>> {
        match self.finished.as_ref()?.try_recv() {
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => {
                Some(Err("making textures stopped because of an internal error; please report it".to_owned()))
            }
            Ok(Err(error)) => Some(Err(error.to_string())),
            Ok(Ok(palette)) => {
                debug_assert!(self.scene.materials == renderer.scene().materials, "the palette was made for different materials");
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

/// The request for a first look, derived from the request for the full picture.
pub fn draft(request: &RenderRequest) -> RenderRequest {
    request.with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
        r.geometry.lod_bias = LOD_BIASES[1];
        r.outputs.aovs = AovSet::default();
        r.outputs.count_fetches = false;
        r.outputs.time_variants = false;
    })
}

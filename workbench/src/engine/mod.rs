//! The drawing thread. It draws the pictures, so that the window does not wait for them.
//!
//! The window and the thread exchange messages through two mailboxes. The first mailbox stores one request ([`Wish`]); a newer request replaces an
//! older one. The second mailbox stores what the thread reports ([`News`]), including the last picture. The thread and the window use separate
//! devices, so pictures are passed as texels and not as textures of a shared device. There are two reasons for separate devices. On a software
//! adapter, they have separate queues, so a long frame does not delay clicks. And if the device of the thread is lost, it can be replaced; meanwhile,
//! the window stays usable but receives no new pictures.

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use kernels::base::progress::Progress;
use kernels::frame::picture::Picture;
use kernels::frame::{RenderRequest, Renderer, RendererOptions, VariantChoice};
use kernels::gpu::Gpu;
use kernels::metrics::Followed;
use kernels::scene::Scene;
use kernels::shared::signal::luminance;
use kernels::variant::Variant;
use kernels::view::camera::{Pose, along};

use crate::model::compare::Mode;
use crate::model::display;
use crate::model::metrics::LAYERS;
use crate::model::picture::{Adapter, News, Second, Shown, Wish};
use crate::model::settings::Settings;
use crate::model::viewpoint::{EYE_M, Viewpoint};
use kernels::oracle;

pub mod experiment;
pub mod live;
pub mod reload;
pub mod sketch;

mod pool;

use live::Live;
use reload::{INTERVAL, Reload};
use sketch::Sketch;

/// Width and height of a picture that is drawn only to compile a shader, pixels.
const WARMING_SIDE: u32 = 16;
/// Repaint delay for a new picture and other urgent news. With a delay of zero, egui would paint the window twice. On a software adapter, painting
/// the window takes about as long as drawing the picture.
const SOON: Duration = Duration::from_micros(1);
/// Repaint delay for the progress of a task. On a software adapter, painting the window for each step of the task, or animating a spinner, would make
/// the task take almost twice as long.
pub(crate) const PROGRESS: Duration = Duration::from_millis(500);
/// Maximum number of times that a lost device is replaced if no picture is finished in between. First looks do not count as pictures.
const DEVICES: u32 = 3;

#[derive(Default)]
struct Mail {
    wish: Option<Wish>,
    /// Whether to compile unused shaders between pictures.
    warming: bool,
    /// Whether the thread must forget what it drew, because its window has closed.
    rest: bool,
    /// Number of devices to destroy in a test, one before each picture.
    lose: u32,
    stop: bool,
    /// Whether the thread has ended, for whatever reason.
    ended: bool,
}

/// Called when the thread reports something. The argument is the longest time that the window may wait before it shows the report.
type Wake = Arc<dyn Fn(Duration) + Send + Sync>;

struct Boxes {
    mail: Mutex<Mail>,
    arrived: Condvar,
    /// Signals that the thread has forgotten what it drew, or has ended.
    rested: Condvar,
    news: Mutex<News>,
    /// Wakes the window that currently uses the thread.
    wake: Mutex<Wake>,
}

/// Locks a mutex, even if a thread panicked while it held the lock. This is correct here, because the data is consistent after every single change.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Boxes {
    fn new(wake: Wake) -> Boxes {
        Boxes {
            mail: Mutex::new(Mail::default()),
            arrived: Condvar::new(),
            rested: Condvar::new(),
            news: Mutex::new(News::default()),
            wake: Mutex::new(wake),
        }
    }

    fn tell(&self, change: impl FnOnce(&mut News)) {
        change(&mut lock(&self.news));
        self.wake(SOON);
    }

    /// Changes the reported state because of progress of a task. The window may show the change with a delay.
    fn report(&self, change: impl FnOnce(&mut News)) {
        change(&mut lock(&self.news));
        self.wake(PROGRESS);
    }

    fn wake(&self, within: Duration) {
        let wake = lock(&self.wake).clone();
        wake(within);
    }

    /// Returns the value for [`News::warm`].
    fn warmth(&self, warmed: &Warmed) -> [usize; 2] {
        if self.is_warming() { warmed.count() } else { [0; 2] }
    }

    /// Whether a test requests the loss of the device now. Each call uses up one request.
    fn is_to_lose(&self) -> bool {
        let mut mail = lock(&self.mail);
        let lose = mail.lose > 0;
        mail.lose = mail.lose.saturating_sub(1);
        lose
    }

    fn is_warming(&self) -> bool {
        lock(&self.mail).warming
    }

    /// Takes the newest request. If there is none, waits for one. `patience` is the longest wait; `None` = no limit. `cold`: whether shaders remain
    /// to be compiled in advance. If they do, and [`Engine::warm`] was called, the function does not wait.
    fn next(&self, cold: bool, patience: Option<Duration>) -> Next {
        let mut mail = lock(&self.mail);
        let mut waited = false;
        loop {
            if mail.stop {
                return Next::Stop;
            }
            if mail.rest {
                return Next::Rest;
            }
            if let Some(wish) = mail.wish.take() {
                return Next::Wish(Box::new(wish));
            }
            if waited || cold && mail.warming {
                return Next::Idle;
            }
            mail = match patience {
                None => self.arrived.wait(mail).unwrap_or_else(PoisonError::into_inner),
                Some(patience) => {
                    let (mail, end) = self.arrived.wait_timeout(mail, patience).unwrap_or_else(PoisonError::into_inner);
                    waited = end.timed_out();
                    mail
                }
            };
        }
    }
}

enum Next {
    Wish(Box<Wish>),
    Idle,
    /// Forget what was drawn, and signal that this is done.
    Rest,
    Stop,
}

/// The drawing thread.
pub struct Engine {
    boxes: Arc<Boxes>,
    thread: Option<JoinHandle<()>>,
    /// The scene that the thread draws, if the engine comes from the pool ([`Engine::shared`]).
    scene: Option<Box<Scene>>,
}

impl Engine {
    /// Starts the thread. `shaders` is a folder with the layout of `kernels/src`; the thread draws with the WGSL files in it and watches them for
    /// changes. `None` = it draws with the shaders of the program. `wake` is called when the thread reports something. Its argument is the longest
    /// time that the window may wait before it shows the report.
    pub fn start(shaders: Option<PathBuf>, wake: impl Fn(Duration) + Send + Sync + 'static) -> Engine {
        let boxes = Arc::new(Boxes::new(Arc::new(wake)));
        let own = boxes.clone();
        let thread = std::thread::spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| draw_on_devices(&own, shaders.map(Reload::new))));
            if outcome.is_err() {
                own.tell(|news| {
                    news.failure =
                        Some("drawing stopped because of an internal error; please report it, and restart the program".to_owned())
                });
            }
            own.ended();
        });
        Engine { boxes, thread: Some(thread), scene: None }
    }

    /// Requests a picture. The request replaces an earlier one that the thread has not started.
    pub fn wish(&self, wish: Wish) {
        lock(&self.boxes.mail).wish = Some(wish);
        self.boxes.arrived.notify_one();
    }

    /// For tests: destroys the device, as a driver may do at any time, before each of the next `count` pictures. First looks do not count.
    pub fn lose_devices(&self, count: u32) {
        lock(&self.boxes.mail).lose = count;
    }

    /// From now on, compiles shaders in advance: those of all variants, and the generic one, for the estimator, noise and tilings of the last
    /// picture. They are compiled while there is no picture to draw. If requests arrive without a pause, one shader is compiled after each picture.
    pub fn warm(&self) {
        lock(&self.boxes.mail).warming = true;
        self.boxes.arrived.notify_one();
    }

    /// The latest report of the thread.
    pub fn news(&self) -> News {
        lock(&self.boxes.news).clone()
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        if self.give_back() {
            return;
        }
        lock(&self.boxes.mail).stop = true;
        self.boxes.arrived.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic in the thread has been reported as a failure.
            let _ = thread.join();
        }
    }
}

/// Why drawing with a device or a scene ended.
enum End {
    Stop,
    /// The scene of this request is not loaded.
    Scene(Box<Wish>),
    /// The device failed while it drew the picture for this request.
    Device(Box<Wish>),
}

fn draw_on_devices(boxes: &Arc<Boxes>, mut reload: Option<Reload>) {
    let mut pending = None;
    let mut losses = 0;
    loop {
        let gpu = match Gpu::new() {
            Ok(gpu) => gpu,
            Err(error) => return boxes.tell(|news| news.failure = Some(error.to_string())),
        };
        boxes.tell(|news| {
            news.adapter =
                Some(Adapter { name: gpu.info.name.clone(), without_anisotropy: gpu.without_anisotropy(), software: gpu.is_software() })
        });
        match draw_scenes(boxes, &gpu, pending.take(), &mut losses, &mut reload) {
            End::Stop => return,
            End::Scene(wish) | End::Device(wish) => {
                if let Some(text) = reload.as_mut().and_then(|reload| reload.device_failed(&gpu)) {
                    boxes.tell(|news| news.shader_error = Some(text));
                }
                pending = Some(wish);
            }
        }
        losses += 1;
        if losses > DEVICES {
            let why = "the graphics device was lost several times in a row: draw a smaller picture, or another scene";
            boxes.tell(|news| {
                (news.progress, news.failure) = (None, Some(why.to_owned()));
                news.unloaded = pending.take().map(|wish| wish.opened);
            });
            // The next request may need less memory, or less time on the device, than the request that failed.
            let Some(wish) = awaited(boxes) else { return };
            boxes.tell(|news| news.failure = None);
            (pending, losses) = (Some(wish), 0);
        }
    }
}

/// Waits for the next request, without a time limit; `None` = the thread must stop.
fn awaited(boxes: &Boxes) -> Option<Box<Wish>> {
    loop {
        match boxes.next(false, None) {
            Next::Wish(wish) => return Some(wish),
            Next::Idle => {}
            Next::Rest => boxes.rested(),
            Next::Stop => return None,
        }
    }
}

/// Loads and draws one scene after another, until the device fails or the thread must stop.
fn draw_scenes(boxes: &Arc<Boxes>, gpu: &Gpu, mut pending: Option<Box<Wish>>, losses: &mut u32, reload: &mut Option<Reload>) -> End {
    let progress = |p: Progress| boxes.report(|news| news.progress = Some(p));
    loop {
        let wish = match pending.take() {
            Some(wish) => wish,
            None => match awaited(boxes) {
                Some(wish) => wish,
                None => return End::Stop,
            },
        };
        // An error of the previous scene does not apply to this one.
        boxes.tell(|news| {
            if news.unloaded != Some(wish.opened) {
                (news.failure, news.unloaded) = (None, None);
            }
        });
        let options = RendererOptions { editable: true, sketch: Some(sketch::TEXELS), ..RendererOptions::default() };
        match Renderer::with(gpu, &wish.settings.scene, options, &progress) {
            Ok(renderer) => match draw_pictures(boxes, renderer, wish, losses, reload) {
                End::Scene(wish) => pending = Some(wish),
                end => return end,
            },
            Err(kernels::base::error::Error::Gpu(_)) => return End::Device(wish),
            // The scene cannot be drawn. The next request may be for another scene.
            Err(error) => boxes.tell(|news| {
                (news.progress, news.failure) = (None, Some(error.to_string()));
                news.unloaded = Some(wish.opened);
            }),
        }
    }
}

/// Draws pictures of one scene, until another scene is requested, the device fails, or the thread must stop.
fn draw_pictures(boxes: &Arc<Boxes>, mut renderer: Renderer<'_>, first: Box<Wish>, losses: &mut u32, reload: &mut Option<Reload>) -> End {
    let opened = first.opened;
    let mut shaders = next_shaders();
    let mut warmed = Warmed::default();
    let mut live = Live::default();
    let mut next = Next::Wish(first);
    let mut last: Option<Box<Wish>> = None;
    let own = boxes.clone();
    let tell: sketch::Tell = Arc::new(move |progress| own.report(|news| news.progress = Some(progress)));
    let mut sketch = Sketch::of(&renderer);
    loop {
        // While no request arrives, the thread must still check regularly whether files in the shader folder have changed and whether textures are
        // ready.
        let patience = if sketch.is_some() { Some(sketch::INTERVAL) } else { reload.is_some().then_some(INTERVAL) };
        match sketch.as_mut().and_then(|sketch| sketch.step(&mut renderer)) {
            None => {}
            Some(Ok(())) => {
                sketch = None;
                next = again(next, last.take());
            }
            Some(Err(why)) => {
                boxes.tell(|news| (news.progress, news.failure, news.unloaded) = (None, Some(why), Some(opened)));
                // The textures could not be made. Wait for the next request, and load its scene anew.
                match boxes.next(false, None) {
                    Next::Wish(wish) => return End::Scene(wish),
                    Next::Idle => continue,
                    Next::Rest | Next::Stop => return End::Stop,
                }
            }
        }
        if let Some(outcome) = reload.as_mut().and_then(|reload| reload.step(&mut renderer)) {
            boxes.tell(|news| {
                news.shader_error = outcome.as_ref().err().cloned();
                news.shaders_edited = !renderer.gpu().sources().is_empty();
            });
            if outcome.is_ok_and(|report| !report.stages.is_empty()) {
                // Metrics of the old shaders, and the list of compiled shaders, are not valid for the new shaders.
                (live, warmed) = (Live::default(), Warmed::default());
                shaders = next_shaders();
                next = again(next, last.take());
            }
        }
        let wish = match next {
            Next::Stop => return End::Stop,
            // The window closed while the textures of the scene were being made. They are no longer needed, so end the thread.
            Next::Rest if sketch.is_some() => return End::Stop,
            Next::Rest => {
                // The next request comes from another window.
                (live, warmed, last) = (Live::default(), Warmed::default(), None);
                boxes.rested();
                next = boxes.next(false, patience);
                continue;
            }
            Next::Idle => {
                if warmed.is_open() && boxes.is_warming() {
                    if warmed.step(&mut renderer).is_err() {
                        warmed.give_up();
                    }
                    boxes.report(|news| news.warm = boxes.warmth(&warmed));
                }
                next = boxes.next(warmed.is_open(), patience);
                continue;
            }
            Next::Wish(wish) => wish,
        };
        if wish.opened != opened {
            return End::Scene(wish);
        }
        // The textures of the loaded scene are still being made. The requested scene needs different textures, but it can usually reuse most textures
        // of the loaded scene. Keep the request until the textures of the loaded scene are finished.
        if sketch.is_some() && renderer.needs_textures(&wish.settings.scene) {
            last = Some(wish);
            next = boxes.next(false, patience);
            continue;
        }
        match renderer.retune(&wish.settings.scene) {
            Ok(true) => {}
            Ok(false) => return End::Scene(wish),
            Err(error) => {
                boxes.tell(|news| news.failure = Some(error.to_string()));
                last = Some(wish);
                next = boxes.next(warmed.is_open(), patience);
                continue;
            }
        }
        last = Some(wish.clone());
        let is_draft = sketch.is_some();
        if !is_draft && boxes.is_to_lose() {
            renderer.gpu().device.destroy();
        }
        match if is_draft { draw_draft(&mut renderer, &wish) } else { draw(&mut renderer, &mut live, &wish) } {
            Ok((request, shown)) => {
                let shown = Shown { shaders, ..shown };
                if !is_draft {
                    *losses = 0;
                    warmed.drew(&request, &shown.picture);
                }
                if let Some(sketch) = &mut sketch {
                    sketch.begin(&tell);
                }
                boxes.tell(|news| {
                    news.shown = Some(Arc::new(shown));
                    news.warm = boxes.warmth(&warmed);
                    news.failure = None;
                    if !is_draft {
                        (news.progress, news.loaded, news.unloaded) = (None, Some(opened), None);
                    }
                });
            }
            Err(kernels::base::error::Error::Gpu(_)) => return End::Device(wish),
            Err(error) => {
                if let Some(sketch) = &mut sketch {
                    sketch.begin(&tell);
                }
                boxes.tell(|news| {
                    news.failure = Some(error.to_string());
                    if !is_draft {
                        // The scene is loaded; only this request is refused.
                        (news.progress, news.loaded, news.unloaded) = (None, Some(opened), None);
                    }
                });
            }
        }
        next = boxes.next(warmed.is_open(), patience);
        // If requests arrive without a pause, there is no idle time to compile shaders in advance. Therefore, compile one shader after each picture.
        if let (Next::Wish(_), true) = (&next, warmed.is_open() && boxes.is_warming()) {
            if warmed.step(&mut renderer).is_err() {
                warmed.give_up();
            }
            boxes.report(|news| news.warm = boxes.warmth(&warmed));
        }
    }
}

/// A number that has not been used for [`Shown::shaders`].
fn next_shaders() -> u64 {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    NEXT.fetch_add(1, Ordering::Relaxed)
}

/// Repeats the last request, unless there is a newer one.
fn again(next: Next, last: Option<Box<Wish>>) -> Next {
    match (next, last) {
        (Next::Idle, Some(wish)) => Next::Wish(wish),
        (next, _) => next,
    }
}

/// Draws a first look: a preview with small textures. It shows only A (see [`crate::model::compare`]), and has no metrics.
fn draw_draft(renderer: &mut Renderer<'_>, wish: &Wish) -> kernels::base::error::Result<(RenderRequest, Shown)> {
    let began = Instant::now();
    let pose = pose(renderer, wish)?;
    let request = sketch::draft(&wish.request(pose, &[]));
    let picture = renderer.render(&request)?;
    let shown = Shown {
        pose,
        texels: display::Layer::Lit.colours(&picture, &Followed::default()),
        legend: display::Layer::Lit.legend_for(&picture),
        draft: true,
        picture,
        second: None,
        pixel: None,
        alone: None,
        ground_m: renderer.ground_m(pose.position.x, pose.position.y),
        culled_ground_m: culled_ground_m(renderer, wish),
        layout: *renderer.world().layout(),
        mean_albedos: renderer.mean_albedos().to_vec(),
        readings: Vec::new(),
        device_bytes: renderer.gpu().memory_bytes(),
        shaders: 0,
        took: began.elapsed(),
        wish: wish.clone(),
    };
    Ok((request, shown))
}

/// Elevation of the ground below the pose at which culling is frozen, metres; `None` = culling is not frozen.
fn culled_ground_m(renderer: &Renderer<'_>, wish: &Wish) -> Option<f64> {
    wish.culled_from.map(|pose| renderer.ground_m(pose.position.x, pose.position.y))
}

/// Draws A, and B if it is requested, and measures the live metrics of both if they are requested.
fn draw(renderer: &mut Renderer<'_>, live: &mut Live, wish: &Wish) -> kernels::base::error::Result<(RenderRequest, Shown)> {
    let began = Instant::now();
    let pose = pose(renderer, wish)?;
    let measured = wish.is_measured();
    let request = wish.request(pose, &wish.layers());
    let picture = renderer.render(&request)?;
    // Read the mean albedos before B is drawn, because B may have different tints.
    let mean_albedos = renderer.mean_albedos().to_vec();
    let pixel = match wish.probe {
        Some(probe) => oracle::inspect(renderer, &request, oracle::pixel_at(probe, wish.size))?,
        None => None,
    };
    let b = wish.compare.b(&wish.settings);
    let (second, alone) = match b.as_ref().map(|b| draw_second(renderer, b, &request, measured)) {
        None => (None, None),
        Some(Ok(second)) => (Some(second), None),
        Some(Err(error @ kernels::base::error::Error::Gpu(_))) => return Err(error),
        // A can be shown without B.
        Some(Err(error)) => (None, Some(error.to_string())),
    };
    let b = b.filter(|_| second.is_some());
    if measured {
        live.take(renderer, &wish.metrics, &request, [Some(&wish.settings), b.as_ref()], [Some(&picture), second.as_ref()])?;
    }
    let layer = wish.settings.layer;
    let (texels, legend) = (layer.colours(&picture, live.side(0)), layer.legend_for(&picture));
    let second = second.zip(b).map(|(second, settings)| compared(wish, &picture, second, settings, live));
    let readings = if measured { live.history() } else { Vec::new() };
    let ground_m = renderer.ground_m(pose.position.x, pose.position.y);
    let layout = *renderer.world().layout();
    let shown = Shown {
        pose,
        texels,
        legend,
        draft: false,
        picture,
        second,
        pixel,
        alone,
        ground_m,
        culled_ground_m: culled_ground_m(renderer, wish),
        layout,
        mean_albedos,
        readings,
        device_bytes: renderer.gpu().memory_bytes(),
        shaders: 0,
        took: began.elapsed(),
        wish: wish.clone(),
    };
    Ok((request, shown))
}

/// Draws B with the view of A.
fn draw_second(
    renderer: &mut Renderer<'_>,
    settings: &Settings,
    a: &RenderRequest,
    measured: bool,
) -> kernels::base::error::Result<Picture> {
    if !renderer.retune(&settings.scene)? {
        let text = "B is not drawn: its scene needs other flavours than the scene of A (because a distance, slope or band differs), or has another \
                    world, anisotropy or texture size; press `Keep A as B` again, or undo the change";
        return Err(kernels::base::error::Error::Request(text.to_owned()));
    }
    let request = settings.request(a.view.pose, a.view.size, a.shading.frame, if measured { &LAYERS } else { &[] });
    renderer.render(&request.with(|r| {
        r.outputs.keep_geometry = true;
        r.geometry.culled_from = a.geometry.culled_from;
    }))
}

/// Prepares B for display, and measures how much A differs from it.
fn compared(wish: &Wish, a: &Picture, b: Picture, settings: Settings, live: &Live) -> Second {
    let pairs = a.hdr.iter().zip(&b.hdr).filter(|(a, _)| a[3] > 0.0);
    let (mut count, mut squares, mut sum, mut largest) = (0_u32, 0.0_f64, 0.0_f64, 0.0_f64);
    for (a, b) in pairs {
        let difference = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
        squares += difference.iter().map(|&d| f64::from(d) * f64::from(d)).sum::<f64>() / 3.0;
        let y = luminance(difference);
        sum += y;
        largest = largest.max(y.abs());
        count += 1;
    }
    let count = f64::from(count.max(1));
    Second {
        texels: wish.settings.layer.of_second().colours(&b, live.side(1)),
        legend: wish.settings.layer.of_second().legend_for(&b),
        difference: (wish.compare.mode == Mode::Difference).then(|| display::difference(a, &b)),
        rmse: (squares / count).sqrt(),
        mean: sum / count,
        largest,
        settings,
        picture: b,
    }
}

/// The pose of the camera for a request.
fn pose(renderer: &Renderer<'_>, wish: &Wish) -> kernels::base::error::Result<Pose> {
    let ground = |x: f64, y: f64| renderer.ground_m(x, y);
    let scene = renderer.scene();
    let missing = |kind: &str, name: &str| kernels::base::error::Error::Request(format!("scene `{}` has no {kind} `{name}`", scene.name));
    match &wish.viewpoint {
        Viewpoint::Camera(name) => {
            let camera = scene.cameras.iter().find(|c| c.name == *name).ok_or_else(|| missing("camera", name))?;
            Ok(Pose::of(camera, ground))
        }
        Viewpoint::Path(name) => {
            let path = scene.paths.iter().find(|p| p.name == *name).ok_or_else(|| missing("path", name))?;
            Ok(along(path, u32::try_from(u64::from(wish.frame) % path.frames().max(1)).unwrap_or(0), ground))
        }
        Viewpoint::Recorded(path) => Ok(path.pose(wish.frame)),
        Viewpoint::Free { pose, walking } => {
            let mut pose = *pose;
            if *walking {
                pose.position.z = ground(pose.position.x, pose.position.y) + EYE_M;
            }
            Ok(pose)
        }
    }
}

/// Which shaders have been compiled for the current estimator, noise and tilings, with or without the recording of diagnostics (fetches and choices).
/// A software adapter compiles a shader when the shader is used for the first time, so a small picture is drawn with each shader.
#[derive(Default)]
struct Warmed {
    like: Option<RenderRequest>,
    missing: Vec<VariantChoice>,
    ready: HashSet<VariantChoice>,
}

impl Warmed {
    /// All shaders that the panel *Variants* can select: one for each of the 31 variants, and the generic shader. With the automatic choice, tiles
    /// use the same 31 shaders.
    fn all() -> impl Iterator<Item = VariantChoice> {
        Variant::all().map(VariantChoice::Forced).chain([VariantChoice::GenericAuto])
    }

    /// Records which shaders were used to draw a picture.
    fn drew(&mut self, request: &RenderRequest, picture: &Picture) {
        let same = |like: &RenderRequest| {
            (like.shading.estimator, like.shading.noise, like.shading.two_tilings, like.wants_diagnostics())
                == (request.shading.estimator, request.shading.noise, request.shading.two_tilings, request.wants_diagnostics())
        };
        if !self.like.as_ref().is_some_and(same) {
            self.ready.clear();
            self.missing = Warmed::all().collect();
            // The last entry of the list is compiled first. Reverse the list, so that variants with large masks are compiled late. Large masks
            // usually have many flavours, and variants with many flavours take longest to compile and are needed least often.
            self.missing.reverse();
        }
        self.like = Some(*request);
        match request.shading.variant {
            VariantChoice::GenericAuto | VariantChoice::GenericForced(_) => {
                self.ready.insert(VariantChoice::GenericAuto);
            }
            VariantChoice::Auto | VariantChoice::Forced(_) => {
                let ran = |v: &Variant| picture.report.tiles.get(usize::from(v.mask())).is_some_and(|&tiles| tiles > 0);
                self.ready.extend(Variant::all().filter(ran).map(VariantChoice::Forced));
            }
        }
        let ready = &self.ready;
        self.missing.retain(|choice| !ready.contains(choice));
    }

    fn is_open(&self) -> bool {
        !self.missing.is_empty()
    }

    fn count(&self) -> [usize; 2] {
        let all = Warmed::all().count();
        [all - self.missing.len(), all]
    }

    /// Skips a variant that cannot be compiled for this scene. A request that needs that variant will report the error.
    fn give_up(&mut self) {
        self.missing.pop();
    }

    /// Compiles the next shader.
    fn step(&mut self, renderer: &mut Renderer<'_>) -> kernels::base::error::Result<()> {
        let (Some(like), Some(&choice)) = (&self.like, self.missing.last()) else { return Ok(()) };
        let size = [WARMING_SIDE; 2];
        renderer.draw(&like.with(|r| {
            r.shading.variant = choice;
            r.view.size = size;
            r.outputs.lit = false;
        }))?;
        self.missing.pop();
        self.ready.insert(choice);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_happens_is_shown_at_once_and_how_far_something_is_a_little_later() {
        let woken: Arc<Mutex<Vec<Duration>>> = Arc::default();
        let own = woken.clone();
        let boxes = Boxes::new(Arc::new(move |within| lock(&own).push(within)));
        boxes.tell(|news| news.failure = Some("it failed".to_owned()));
        boxes.report(|news| news.warm = [1, 2]);
        assert_eq!(*lock(&woken), [SOON, PROGRESS]);
        assert!(SOON > Duration::ZERO && PROGRESS > Duration::from_millis(100));
        let news = lock(&boxes.news).clone();
        assert_eq!((news.failure.as_deref(), news.warm), (Some("it failed"), [1, 2]));
    }
}

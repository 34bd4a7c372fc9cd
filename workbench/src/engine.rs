//! The thread that draws: the window never waits for a picture, and a picture never for the window.
//!
//! It has a device of its own. What is wanted next lies in a mailbox of one place, where the newest wish replaces an older one; what was drawn last lies
//! in another. Pictures come back as texels: on a software adapter two devices are two queues, so that a long frame holds up no click, and a device that
//! is lost is made anew without the window noticing more than a pause.

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use kernels::camera::{Pose, along};
use kernels::frame::{Progress, RenderRequest, Renderer, VariantChoice};
use kernels::gpu::Gpu;
use kernels::picture::Picture;
use kernels::variant::Variant;

use crate::settings::Settings;

/// Height of the eye when walking, metres.
pub const EYE_M: f64 = 1.7;
/// Edge of the picture that is drawn only to have a shader compiled.
const WARMING_SIDE: u32 = 16;
/// Times in a row that a lost device is made anew before giving up.
const DEVICES: u32 = 3;

/// Where a picture is taken from.
#[derive(Clone, Debug, PartialEq)]
pub enum Viewpoint {
    /// A camera of the scene.
    Camera(String),
    /// The frame's place on a path of the scene, over and over.
    Path(String),
    /// Anywhere.
    Free {
        /// Where.
        pose: Pose,
        /// Whether the eye keeps its height over the ground.
        walking: bool,
    },
}

/// A picture that is wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct Wish {
    /// How it looks.
    pub settings: Settings,
    /// From where.
    pub viewpoint: Viewpoint,
    /// Pixels.
    pub size: [u32; 2],
    /// The only time there is.
    pub frame: u32,
}

/// A picture that was drawn.
pub struct Shown {
    /// As it was wanted.
    pub wish: Wish,
    /// Where the camera stood.
    pub pose: Pose,
    /// sRGB, row by row from the top.
    pub texels: Vec<[u8; 3]>,
    /// The picture and its numbers.
    pub picture: Picture,
    /// From the wish to the texels.
    pub took: Duration,
}

/// The device that draws.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Name given by the driver.
    pub name: String,
    /// Whether it is a processor that only behaves as a graphics card: its times are good for ratios only.
    pub software: bool,
}

/// What the thread has to say.
#[derive(Clone, Default)]
pub struct News {
    /// The last picture.
    pub shown: Option<Arc<Shown>>,
    /// The device.
    pub adapter: Option<Adapter>,
    /// What is being done that takes a while.
    pub progress: Option<Progress>,
    /// Shaders that are compiled, of those that a click may ask for.
    pub warm: [usize; 2],
    /// Why the last wish was not fulfilled; one line.
    pub failure: Option<String>,
}

#[derive(Default)]
struct Mail {
    wish: Option<Wish>,
    stop: bool,
}

struct Boxes {
    mail: Mutex<Mail>,
    arrived: Condvar,
    news: Mutex<News>,
    wake: Box<dyn Fn() + Send + Sync>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Boxes {
    fn tell(&self, change: impl FnOnce(&mut News)) {
        change(&mut lock(&self.news));
        (self.wake)();
    }

    /// The newest wish; without one, waits for it, or returns at once if there is something else to do.
    fn next(&self, idle_work: bool) -> Next {
        let mut mail = lock(&self.mail);
        loop {
            if mail.stop {
                return Next::Stop;
            }
            if let Some(wish) = mail.wish.take() {
                return Next::Wish(Box::new(wish));
            }
            if idle_work {
                return Next::Idle;
            }
            mail = self.arrived.wait(mail).unwrap_or_else(PoisonError::into_inner);
        }
    }
}

enum Next {
    Wish(Box<Wish>),
    Idle,
    Stop,
}

/// The drawing thread.
pub struct Engine {
    boxes: Arc<Boxes>,
    thread: Option<JoinHandle<()>>,
}

impl Engine {
    /// Starts the thread. `wake` is called whenever there are news.
    pub fn start(wake: impl Fn() + Send + Sync + 'static) -> Engine {
        let boxes = Arc::new(Boxes {
            mail: Mutex::new(Mail::default()),
            arrived: Condvar::new(),
            news: Mutex::new(News::default()),
            wake: Box::new(wake),
        });
        let own = boxes.clone();
        let thread = std::thread::spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| draw_on_devices(&own)));
            if outcome.is_err() {
                own.tell(|news| {
                    news.failure = Some("drawing stopped by an internal error; please report it, and restart the program".to_owned())
                });
            }
        });
        Engine { boxes, thread: Some(thread) }
    }

    /// Asks for a picture; a wish that was not begun yet is replaced.
    pub fn wish(&self, wish: Wish) {
        lock(&self.boxes.mail).wish = Some(wish);
        self.boxes.arrived.notify_one();
    }

    /// What there is.
    pub fn news(&self) -> News {
        lock(&self.boxes.news).clone()
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        lock(&self.boxes.mail).stop = true;
        self.boxes.arrived.notify_one();
        if let Some(thread) = self.thread.take() {
            // A panic in there was told as a failure.
            let _ = thread.join();
        }
    }
}

/// Why drawing on a device or of a scene ended.
enum End {
    Stop,
    /// A wish for another scene than the one that is loaded.
    Scene(Box<Wish>),
    /// The device failed at this wish.
    Device(Box<Wish>),
}

fn draw_on_devices(boxes: &Boxes) {
    let mut pending = None;
    let mut losses = 0;
    loop {
        let gpu = match Gpu::new() {
            Ok(gpu) => gpu,
            Err(error) => return boxes.tell(|news| news.failure = Some(error.to_string())),
        };
        boxes.tell(|news| news.adapter = Some(Adapter { name: gpu.info.name.clone(), software: gpu.is_software() }));
        match draw_scenes(boxes, &gpu, pending.take(), &mut losses) {
            End::Stop => return,
            End::Scene(wish) | End::Device(wish) => pending = Some(wish),
        }
        losses += 1;
        if losses > DEVICES {
            return boxes.tell(|news| {
                news.failure =
                    Some("the graphics device was lost several times in a row: save what you want to keep, and restart".to_owned());
            });
        }
    }
}

/// Draws scene after scene until the device fails.
fn draw_scenes(boxes: &Boxes, gpu: &Gpu, mut pending: Option<Box<Wish>>, losses: &mut u32) -> End {
    let progress = |p: Progress| boxes.tell(|news| news.progress = Some(p));
    loop {
        let wish = match pending.take() {
            Some(wish) => wish,
            None => match boxes.next(false) {
                Next::Wish(wish) => wish,
                Next::Idle => continue,
                Next::Stop => return End::Stop,
            },
        };
        match Renderer::new(gpu, &wish.settings.scene, &progress) {
            Ok(renderer) => match draw_pictures(boxes, renderer, wish, losses) {
                End::Scene(wish) => pending = Some(wish),
                end => return end,
            },
            Err(kernels::error::Error::Gpu(_)) => return End::Device(wish),
            // The scene cannot be drawn: the next wish may bring another.
            Err(error) => boxes.tell(|news| {
                news.progress = None;
                news.failure = Some(error.to_string());
            }),
        }
    }
}

/// Draws pictures of one scene.
fn draw_pictures(boxes: &Boxes, mut renderer: Renderer<'_>, first: Box<Wish>, losses: &mut u32) -> End {
    let mut warmed = Warmed::default();
    let mut next = Next::Wish(first);
    loop {
        let wish = match next {
            Next::Stop => return End::Stop,
            Next::Idle => {
                if warmed.step(&mut renderer).is_err() {
                    warmed.give_up();
                }
                boxes.tell(|news| news.warm = warmed.count());
                next = boxes.next(warmed.is_open());
                continue;
            }
            Next::Wish(wish) => wish,
        };
        if wish.settings.scene != *renderer.scene() {
            match renderer.retune(&wish.settings.scene) {
                Ok(true) => {}
                Ok(false) => return End::Scene(wish),
                Err(error) => {
                    boxes.tell(|news| news.failure = Some(error.to_string()));
                    next = boxes.next(warmed.is_open());
                    continue;
                }
            }
        }
        let began = Instant::now();
        let drawn = pose(&renderer, &wish).and_then(|pose| {
            let request = wish.settings.request(pose, wish.size, wish.frame);
            let picture = renderer.render(&request)?;
            Ok((request, picture))
        });
        match drawn {
            Ok((request, picture)) => {
                *losses = 0;
                let texels = wish.settings.layer.colours(&picture);
                warmed.drew(&request, &picture);
                let shown = Arc::new(Shown { pose: request.pose, texels, picture, took: began.elapsed(), wish: *wish });
                boxes.tell(|news| {
                    news.shown = Some(shown);
                    news.warm = warmed.count();
                    (news.progress, news.failure) = (None, None);
                });
            }
            Err(kernels::error::Error::Gpu(_)) => return End::Device(wish),
            Err(error) => boxes.tell(|news| {
                news.progress = None;
                news.failure = Some(error.to_string());
            }),
        }
        next = boxes.next(warmed.is_open());
        // Wishes that come without a pause would leave no time for shaders that a click may want: one a picture.
        if let (Next::Wish(_), true) = (&next, warmed.is_open()) {
            if warmed.step(&mut renderer).is_err() {
                warmed.give_up();
            }
            boxes.tell(|news| news.warm = warmed.count());
        }
    }
}

/// Where a wish is taken from.
fn pose(renderer: &Renderer<'_>, wish: &Wish) -> kernels::error::Result<Pose> {
    let ground = |x: f64, y: f64| renderer.ground_m(x, y);
    let scene = renderer.scene();
    let missing = |kind: &str, name: &str| kernels::error::Error::Request(format!("scene `{}` has no {kind} `{name}`", scene.name));
    match &wish.viewpoint {
        Viewpoint::Camera(name) => {
            let camera = scene.cameras.iter().find(|c| c.name == *name).ok_or_else(|| missing("camera", name))?;
            Ok(Pose::of(camera, ground))
        }
        Viewpoint::Path(name) => {
            let path = scene.paths.iter().find(|p| p.name == *name).ok_or_else(|| missing("path", name))?;
            Ok(along(path, u32::try_from(u64::from(wish.frame) % path.frames().max(1)).unwrap_or(0), ground))
        }
        Viewpoint::Free { pose, walking } => {
            let mut pose = *pose;
            if *walking {
                pose.position.z = ground(pose.position.x, pose.position.y) + EYE_M;
            }
            Ok(pose)
        }
    }
}

/// Which shaders were made ready for the estimator, the noise and the counting in use: software adapters compile one when something is first drawn with
/// it, so something small is.
#[derive(Default)]
struct Warmed {
    like: Option<RenderRequest>,
    missing: Vec<VariantChoice>,
    ready: HashSet<VariantChoice>,
}

impl Warmed {
    /// All that the panel of variants can force. Automatic choice runs tiles by the same 31.
    fn all() -> impl Iterator<Item = VariantChoice> {
        Variant::all().map(VariantChoice::Forced).chain([VariantChoice::GenericAuto])
    }

    /// Takes note of what a picture was drawn by.
    fn drew(&mut self, request: &RenderRequest, picture: &Picture) {
        let same = |like: &RenderRequest| {
            (like.estimator, like.noise, like.two_tilings, like.wants_diagnostics())
                == (request.estimator, request.noise, request.two_tilings, request.wants_diagnostics())
        };
        if !self.like.as_ref().is_some_and(same) {
            self.ready.clear();
            self.missing = Warmed::all().collect();
            // The full sets come last: they take longest and are wanted least.
            self.missing.reverse();
        }
        self.like = Some(request.clone());
        match request.variant {
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

    /// A variant that this scene cannot run is refused when it is wanted, too.
    fn give_up(&mut self) {
        self.missing.pop();
    }

    /// Makes the next one ready.
    fn step(&mut self, renderer: &mut Renderer<'_>) -> kernels::error::Result<()> {
        let (Some(like), Some(&choice)) = (&self.like, self.missing.last()) else { return Ok(()) };
        let size = [WARMING_SIDE; 2];
        renderer.draw(&RenderRequest { variant: choice, size, lit: false, ..like.clone() })?;
        self.missing.pop();
        self.ready.insert(choice);
        Ok(())
    }
}

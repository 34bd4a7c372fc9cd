//! The window: panels around a picture, and what they have in common.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::util::undoer::Undoer;
use eframe::egui::{self, Key, KeyboardShortcut, Modifiers, TextureHandle, TextureOptions, Ui, WidgetText};
use egui_tiles::{Behavior, Container, LinearDir, SimplificationOptions, Tile, TileId, Tiles, Tree, UiResponse};
use glam::DVec3;
use kernels::scene::{self, Scene};
use kernels::variant::Flavour;
use kernels::view::camera::Pose;

use crate::brush::{Brush, Ground};
use crate::compare::Compare;
use crate::engine::{Engine, News, Shown, Viewpoint, Wish};
use crate::flight::{self, Flight, Orbit};
use crate::kept::{self, Keeper, Kept};
use crate::live::Metrics;
use crate::panels;
use crate::settings::Settings;

mod opening;

/// Pictures that the graph of frame times goes back.
const TIMES: usize = 120;
/// Pixels drawn per pixel of the screen, along a side, where a processor draws.
const SOFTWARE_SCALE: f64 = 0.5;
/// Vertices of the terrain that are drawn there, see [`Settings::vertex_stride`]: a processor takes its time by vertices; relief
/// near the eye and the edges of steep steps look coarser for it.
const SOFTWARE_STRIDE: u32 = 4;

/// A part of the window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pane {
    /// The picture.
    Viewport,
    /// Which shaders.
    Variants,
    /// Textures and how they lie on the ground.
    Materials,
    /// Which material lies where.
    Rules,
    /// What is painted over that.
    Brush,
    /// A beside B.
    Compare,
    /// What is measured of the pictures.
    Metrics,
    /// The scene's numbers.
    Parameters,
    /// What the frame took.
    Frame,
    /// One pixel, taken apart.
    Inspector,
    /// What each stage made of it: nodes on a map, atlases, pages, tiles.
    Machine,
    /// Experiments to save and to run.
    Experiments,
    /// Places to go back to, and paths to fly again.
    Places,
    /// What is to be seen, and the keys.
    Help,
}

impl Pane {
    /// All of them.
    pub const ALL: [Pane; 14] = [
        Pane::Viewport,
        Pane::Variants,
        Pane::Materials,
        Pane::Rules,
        Pane::Brush,
        Pane::Compare,
        Pane::Places,
        Pane::Help,
        Pane::Parameters,
        Pane::Metrics,
        Pane::Frame,
        Pane::Inspector,
        Pane::Machine,
        Pane::Experiments,
    ];

    /// Its title.
    pub const fn name(self) -> &'static str {
        match self {
            Pane::Viewport => "Viewport",
            Pane::Variants => "Variants",
            Pane::Materials => "Materials",
            Pane::Rules => "Rules",
            Pane::Brush => "Brush",
            Pane::Compare => "Compare",
            Pane::Metrics => "Metrics",
            Pane::Parameters => "Parameters",
            Pane::Frame => "Frame",
            Pane::Inspector => "Inspector",
            Pane::Machine => "Machine",
            Pane::Experiments => "Experiments",
            Pane::Places => "Places",
            Pane::Help => "Help",
        }
    }
}

/// The frame index and whether it goes on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clock {
    /// The frame that is wanted next, or was drawn last if paused.
    pub frame: u32,
    /// Whether time stands still.
    pub paused: bool,
}

/// How the pictures are looked at, which changes none of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Looking {
    /// Magnification, from 1.
    pub zoom: f32,
    /// The place in the middle of the viewport, as shares of the picture.
    pub centre: [f32; 2],
    /// Whether a magnified cut-out follows the pointer.
    pub loupe: bool,
    /// Where the line of a wipe is, as a share of the viewport's width.
    pub wipe: f32,
    /// Whether B is up, where one is shown at a time.
    pub b: bool,
    /// Whether the drag that is going on draws the rectangle that is measured.
    pub measures: bool,
}

impl Default for Looking {
    fn default() -> Self {
        Looking { zoom: 1.0, centre: [0.5; 2], loupe: false, wipe: 0.5, b: false, measures: false }
    }
}

/// The application.
pub struct Workbench {
    engine: Engine,
    pub(crate) news: News,
    /// What is on screen.
    pub settings: Settings,
    /// The scene as it was loaded: what a reset goes back to.
    pub(crate) original: Scene,
    /// What it is held against.
    pub compare: Compare,
    /// What is measured of it.
    pub metrics: Metrics,
    /// Place of the pixel that is taken apart, in shares of the picture; `None` = none is.
    pub probe: Option<[f32; 2]>,
    undoer: Undoer<(Settings, Compare)>,
    /// Where it is seen from.
    pub viewpoint: Viewpoint,
    pub(crate) flight: Flight,
    /// Where culling is frozen, if it is.
    pub culled_from: Option<Pose>,
    /// What a drag in the picture paints, if it does.
    pub brush: Brush,
    /// Time.
    pub clock: Clock,
    /// Size of the picture that the viewport has room for, pixels.
    pub(crate) room: [u32; 2],
    /// Longest side of a picture that the window can show, pixels.
    most_side: u32,
    pub(crate) textures: [Option<TextureHandle>; 3],
    /// How the pictures are looked at.
    pub(crate) looking: Looking,
    asked: Option<Wish>,
    /// Why the scene cannot be as the sliders have it.
    impossible: Option<String>,
    /// The last scene that could be: it goes on being drawn when files that it names are removed.
    checked: Option<Box<Scene>>,
    pub(crate) times: VecDeque<Duration>,
    /// How long the window took for each of its own drawings, which is how long a click waits at most.
    pub(crate) answers: VecDeque<Duration>,
    last_shown: Option<Instant>,
    /// Whether somebody chose the scale, and the vertex stride, at an earlier start.
    chosen: [bool; 2],
    /// Whether the window is closed even if edits are lost.
    leaves: bool,
    /// Whether what suits the adapter was chosen.
    adapted: bool,
    /// The scale that nobody chose.
    pub(crate) usual_scale: f64,
    /// The vertex stride that nobody chose.
    pub(crate) usual_stride: u32,
    pub(crate) places: panels::places::PlacesPanel,
    pub(crate) machine: panels::machine::MachinePanel,
    pub(crate) materials: panels::materials::MaterialsPanel,
    pub(crate) rules: panels::rules::RulesPanel,
    pub(crate) scenes: panels::scenes::ScenesPanel,
    /// What the scene was opened from, as [`scene::load`] takes it; `None` = from no file.
    given: Option<String>,
    /// Number of its opening, as [`Wish::opened`].
    opened: u32,
    /// The scene before it, until it is loaded.
    before: Option<Box<opening::Before>>,
    /// The scene's name in the window's title.
    titled: String,
    /// What writes what is kept; `None` = nothing is.
    keeping: Option<Keeper>,
    /// What somebody should know of what was kept and opened, until it is dismissed.
    notes: Vec<String>,
    pub(crate) experiments: panels::experiments::ExperimentsPanel,
    tree: Tree<Pane>,
}

impl Workbench {
    /// The window's contents for a scene; pictures follow as they are drawn.
    /// `shaders`: a folder of WGSL files to draw with and to follow, as [`Engine::start`] takes it.
    pub fn new(ctx: &egui::Context, scene: Scene, shaders: Option<PathBuf>) -> Workbench {
        let window = ctx.clone();
        Workbench::drawn_by(Engine::start(shaders, move |within| window.request_repaint_after(within)), scene)
    }

    /// As [`Workbench::new`], with a thread that draws, and wakes the window, already.
    pub fn drawn_by(engine: Engine, scene: Scene) -> Workbench {
        Workbench {
            engine,
            news: News::default(),
            settings: Settings::new(scene.clone()),
            compare: Compare::default(),
            metrics: Metrics::default(),
            probe: None,
            viewpoint: opening::usual_viewpoint(&scene),
            titled: scene.name.clone(),
            original: scene,
            undoer: Undoer::default(),
            flight: Flight::default(),
            culled_from: None,
            brush: Brush::default(),
            clock: Clock::default(),
            room: [0; 2],
            most_side: u32::MAX,
            textures: [None, None, None],
            looking: Looking::default(),
            asked: None,
            impossible: None,
            checked: None,
            times: VecDeque::new(),
            answers: VecDeque::new(),
            last_shown: None,
            chosen: [false; 2],
            leaves: false,
            adapted: false,
            usual_scale: 1.0,
            usual_stride: 1,
            places: panels::places::PlacesPanel::default(),
            machine: panels::machine::MachinePanel::default(),
            materials: panels::materials::MaterialsPanel::default(),
            rules: panels::rules::RulesPanel::default(),
            scenes: panels::scenes::ScenesPanel::default(),
            given: None,
            opened: 0,
            before: None,
            keeping: None,
            notes: Vec::new(),
            experiments: panels::experiments::ExperimentsPanel::default(),
            tree: layout(),
        }
    }

    /// Takes note of what the scene was opened from, as [`scene::load`] takes it: a file that is asked for may then be written over.
    #[must_use]
    pub fn opened(mut self, given: &str) -> Workbench {
        self.come_from(given);
        self
    }

    /// As [`Workbench::opened`].
    pub fn come_from(&mut self, given: &str) {
        self.materials.opened(given);
        let name = kept::scene_name(given);
        self.scenes.opened(&name);
        self.given = Some(name);
    }

    /// Takes up what is kept of the scene of this name ([`kept::scene_name`]), and keeps it from now on. `notes` are shown until they are dismissed.
    #[must_use]
    pub fn keeping(mut self, keeper: Keeper, scene_name: String, mut notes: Vec<String>) -> Workbench {
        let kept = keeper.kept();
        notes.extend(kept.apply_look(&mut self.settings));
        self.scenes.recent = kept.recent().to_vec();
        self.scenes.opened(&scene_name);
        if let Some(tree) = kept.tree(tree_id()) {
            self.tree = tree;
        }
        // Who chose a scale keeps it on a software adapter, too.
        self.chosen = kept.has_scale_and_stride();
        (self.keeping, self.given) = (Some(keeper), Some(scene_name));
        notes.extend(self.take_up());
        self.notes = notes;
        self
    }

    /// What there is to keep.
    fn present(&self, before: &Kept, scene_name: &str) -> Kept {
        let kept = Kept::of(before, scene_name, &self.settings, &self.original, &self.places.all, &self.tree);
        // What is usual is not known before the adapter is.
        if self.adapted { kept.without_usual(self.usual_scale, self.usual_stride) } else { kept.with_scale_and_stride_of(before) }
    }

    /// Keeps what has changed, now and then.
    fn keep(&mut self, ctx: &egui::Context) {
        let Some(name) = self.given.clone() else { return };
        let Some(mut keeper) = self.keeping.take() else { return };
        // Of a scene that may not be one nothing is kept.
        if self.before.is_none() {
            keeper.tend(Instant::now(), |before| self.present(before, &name));
        }
        self.keeping = Some(keeper);
        // A change that nothing follows would wait for the next one.
        ctx.request_repaint_after(kept::EVERY);
    }

    /// Keeps what has changed, and waits until it is written.
    fn keep_now(&mut self) {
        let Some(name) = self.given.clone() else { return };
        let Some(mut keeper) = self.keeping.take() else { return };
        // Why it could not be is in the keeper's failure.
        let _ = keeper.finish(|before| self.present(before, &name));
        self.keeping = Some(keeper);
    }

    /// The thread that draws.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// Makes every shader ready that a click may ask for, between pictures.
    pub fn warm(&self) {
        self.engine.warm();
    }

    /// The last picture.
    pub fn shown(&self) -> Option<&Arc<Shown>> {
        self.news.shown.as_ref()
    }

    /// The last picture, if it is of the scene that is open: until another one is loaded, the old one's picture stays.
    pub fn shown_here(&self) -> Option<&Arc<Shown>> {
        self.shown().filter(|shown| shown.wish.opened == self.opened)
    }

    /// Where a panel is in the window, points; `None` = it is behind another.
    pub fn place_of(&self, pane: Pane) -> Option<egui::Rect> {
        let tile = self.tree.tiles.find_pane(&pane)?;
        self.tree.tiles.is_visible(tile).then(|| self.tree.tiles.rect(tile)).flatten()
    }

    /// Whether the picture is the one that the controls ask for.
    pub fn is_settled(&self) -> bool {
        let Some(shown) = self.shown().filter(|shown| !shown.draft) else { return false };
        let same_time = !self.clock.paused || shown.wish.frame == self.clock.frame;
        same_time && shown.wish == Wish { frame: shown.wish.frame, ..self.wish() }
    }

    /// What is being done that takes a while.
    pub fn progress(&self) -> Option<&kernels::base::progress::Progress> {
        self.news.progress.as_ref()
    }

    /// Why there is no picture of what the controls ask for.
    pub fn failure(&self) -> Option<&str> {
        // Why another scene could not be loaded is no failure of this one.
        let own = self.news.unloaded.is_none_or(|opened| opened == self.opened);
        self.impossible.as_deref().or(self.news.failure.as_deref().filter(|_| own))
    }

    /// Why the shaders of the folder are not those that draw.
    pub fn shader_error(&self) -> Option<&str> {
        self.news.shader_error.as_deref()
    }

    /// Whether the viewport has room for a picture.
    pub fn has_room(&self) -> bool {
        !self.room.contains(&0)
    }

    /// Whether every shader that a click may ask for is ready.
    pub fn is_warm(&self) -> bool {
        self.news.warm[1] > 0 && self.news.warm[0] == self.news.warm[1]
    }

    /// Size of the picture to draw, pixels.
    fn size(&self) -> [u32; 2] {
        scaled(self.room, self.settings.scale, self.most_side)
    }

    /// Takes the engine's news over.
    fn listen(&mut self, ctx: &egui::Context) {
        self.most_side = ctx.input(|i| u32::try_from(i.max_texture_side).unwrap_or(u32::MAX));
        let before = self.news.shown.take();
        self.news = self.engine.news();
        self.settle_opening();
        if let Some(adapter) = &self.news.adapter {
            let untouched = [self.settings.scale == self.usual_scale, self.settings.vertex_stride == self.usual_stride];
            (self.usual_scale, self.usual_stride) = if adapter.software { (SOFTWARE_SCALE, SOFTWARE_STRIDE) } else { (1.0, 1) };
            if !std::mem::replace(&mut self.adapted, true) {
                if !self.chosen[0] && untouched[0] {
                    self.settings.scale = self.usual_scale;
                }
                if !self.chosen[1] && untouched[1] {
                    self.settings.vertex_stride = self.usual_stride;
                }
                // Nobody did this, so nobody takes it back.
                self.undoer = Undoer::default();
            }
        }
        let Some(shown) = self.news.shown.clone() else { return };
        if before.is_some_and(|before| Arc::ptr_eq(&before, &shown)) {
            return;
        }
        let second = shown.second.as_ref();
        let pictures = [Some(&shown.texels), second.map(|s| &s.texels), second.and_then(|s| s.difference.as_ref())];
        for (place, texels) in self.textures.iter_mut().zip(pictures) {
            let Some(texels) = texels else {
                *place = None;
                continue;
            };
            let texels: Vec<egui::Color32> = texels.iter().map(|&[r, g, b]| egui::Color32::from_rgb(r, g, b)).collect();
            let image = egui::ColorImage::new(shown.wish.size.map(|n| n as usize), texels);
            match place {
                Some(texture) => texture.set(image, TextureOptions::NEAREST),
                None => *place = Some(ctx.load_texture("viewport", image, TextureOptions::NEAREST)),
            }
        }
        let now = Instant::now();
        if let Some(last) = self.last_shown.replace(now) {
            remember(&mut self.times, now - last);
        }
    }

    /// Goes on to the next frame if this one was shown, so that none is left out.
    fn tick(&mut self) {
        let frame = self.clock.frame;
        if !self.clock.paused && self.shown_here().is_some_and(|shown| shown.wish.frame == frame) {
            self.clock.frame = frame.wrapping_add(1);
        }
    }

    /// The picture that the controls describe.
    fn wish(&self) -> Wish {
        Wish {
            settings: self.settings.clone(),
            compare: self.compare.clone(),
            metrics: self.metrics.clone(),
            viewpoint: self.viewpoint.clone(),
            size: self.size(),
            frame: self.clock.frame,
            probe: self.probe,
            seeks: self.brush.paints || self.flight.orbit == Orbit::Sought,
            culled_from: self.culled_from,
            opened: self.opened,
        }
    }

    /// Asks for the picture that the controls describe, unless it was asked for.
    fn ask(&mut self) {
        // What a slider made impossible is said, and the picture stays as it was.
        if self.checked.as_deref() != Some(&self.settings.scene) {
            self.impossible = scene::validate(&self.settings.scene).err().map(|error| error.to_string());
            self.checked = self.impossible.is_none().then(|| Box::new(self.settings.scene.clone()));
        }
        if self.impossible.is_some() || !self.has_room() || self.news.adapter.is_none() {
            return;
        }
        let wish = self.wish();
        if self.asked.as_ref() != Some(&wish) {
            self.asked = Some(wish.clone());
            self.engine.wish(wish);
        }
    }

    /// The pose of the last picture, to go on from.
    pub fn pose(&self) -> Option<Pose> {
        match &self.viewpoint {
            // A walker's height is known by the thread that draws; the place may be ahead of the picture.
            Viewpoint::Free { pose, walking: true } => {
                let z = self.shown_here().map_or(pose.position.z, |shown| shown.pose.position.z);
                Some(Pose { position: pose.position.with_z(z), ..*pose })
            }
            Viewpoint::Free { pose, walking: false } => Some(*pose),
            Viewpoint::Camera(_) | Viewpoint::Path(_) | Viewpoint::Recorded(_) => self.shown_here().map(|shown| shown.pose),
        }
    }

    /// Leaves a camera or a path, to fly on from where it is.
    pub(crate) fn fly(&mut self, pose: Pose) {
        self.viewpoint = Viewpoint::Free { pose, walking: self.flight.walking };
    }

    /// Begins to move about what is looked at, or ends it.
    pub(crate) fn orbit(&mut self, on: bool) {
        self.flight.orbit = if on { Orbit::Sought } else { Orbit::Off };
        self.flight.walking &= !on;
    }

    /// The place that the camera moves about, world metres; `None` = it flies or walks.
    pub fn orbited(&self) -> Option<DVec3> {
        self.flight.target()
    }

    /// Begins to move about a place as soon as the picture shows where that is.
    fn seek(&mut self) {
        if self.flight.orbit != Orbit::Sought {
            return;
        }
        let Some(shown) = self.shown_here().cloned().filter(|shown| shown.wish.probe == self.probe) else { return };
        let middle = || Some(Ground::of(&shown)?.at([0.5; 2]).unwrap_or_else(|| flight::ahead(&shown.pose, shown.ground_m)));
        let probed = shown.pixel.as_ref().map(|pixel| DVec3::from_array(pixel.position));
        if let (Some(target), Some(pose)) = (probed.or_else(middle), self.pose()) {
            self.flight.orbit = Orbit::About(target);
            self.fly(flight::facing(&pose, target));
        }
    }

    /// Goes on with the nodes and patches of this moment, or ends that.
    pub(crate) fn freeze_culling(&mut self) {
        self.culled_from = if self.culled_from.is_some() { None } else { self.pose() };
    }

    /// Goes one frame on and stops there.
    pub(crate) fn step(&mut self) {
        self.clock = Clock { frame: self.clock.frame.wrapping_add(u32::from(self.clock.paused)), paused: true };
    }

    /// What undo takes back.
    fn undoable(&self) -> (Settings, Compare) {
        (self.settings.clone(), self.compare.clone())
    }

    /// Makes what is on screen a point that undo goes back to, so that what was done before and what follows are taken back each for itself.
    pub(crate) fn undo_point(&mut self, ctx: &egui::Context) {
        let present = self.undoable();
        // It is fed first, since that is what ends a redo.
        self.undoer.feed_state(ctx.input(|i| i.time), &present);
        self.undoer.add_undo(&present);
    }

    /// Takes note of what has changed. A drag of the brush is one change, however long it is and however often it pauses.
    fn watch_changes(&mut self, ctx: &egui::Context) {
        let held = ctx.input(|i| i.pointer.primary_down());
        if self.brush.is_drawing() && held {
            return;
        }
        if self.brush.is_drawing() {
            self.brush.finish();
            self.undo_point(ctx);
        }
        self.undoer.feed_state(ctx.input(|i| i.time), &self.undoable());
    }

    pub(crate) fn undo(&mut self) {
        if let Some(before) = self.undoer.undo(&self.undoable()) {
            (self.settings, self.compare) = before.clone();
            self.keep_viewpoint();
        }
    }

    pub(crate) fn redo(&mut self) {
        if let Some(after) = self.undoer.redo(&self.undoable()) {
            (self.settings, self.compare) = after.clone();
            self.keep_viewpoint();
        }
    }

    pub(crate) fn can_undo(&self) -> bool {
        self.undoer.has_undo(&self.undoable())
    }

    pub(crate) fn can_redo(&self) -> bool {
        self.undoer.has_redo(&self.undoable())
    }

    /// Keys that work wherever no text is typed.
    fn keys(&mut self, ctx: &egui::Context) {
        if ctx.text_edit_focused() {
            return;
        }
        let command = |key| KeyboardShortcut::new(Modifiers::COMMAND, key);
        let redo = KeyboardShortcut::new(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
        if ctx.input_mut(|i| i.consume_shortcut(&redo) || i.consume_shortcut(&command(Key::Y))) {
            self.redo();
        }
        if ctx.input_mut(|i| i.consume_shortcut(&command(Key::Z))) {
            self.undo();
        }
        let pressed = |key| ctx.input(|i| i.modifiers.is_none() && i.key_pressed(key));
        for (key, flavour) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5].into_iter().zip(Flavour::ALL) {
            if pressed(key) {
                self.settings.toggle(flavour);
            }
        }
        if pressed(Key::Num0) {
            self.settings.forced = None;
        }
        if pressed(Key::G) {
            self.settings.generic ^= true;
        }
        if pressed(Key::Space) {
            self.clock.paused ^= true;
        }
        if pressed(Key::Period) {
            self.step();
        }
        if pressed(Key::F) {
            self.flight.walking ^= true;
        }
        if pressed(Key::O) {
            self.orbit(self.flight.orbit == Orbit::Off);
        }
        if pressed(Key::C) {
            self.freeze_culling();
        }
        if pressed(Key::X) {
            panels::compare::flick(self);
        }
        if pressed(Key::L) {
            self.looking.loupe ^= true;
        }
        if pressed(Key::B) {
            self.brush.paints ^= true;
        }
    }

    /// Takes over what was dropped on the window: a scene is opened, folders are textures.
    fn dropped(&mut self, ctx: &egui::Context) {
        let paths: Vec<PathBuf> = ctx.input(|i| i.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        for path in paths {
            let is_scene = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
            if is_scene || path.join(scene::FILE).is_file() {
                panels::scenes::open_file(self, &path);
            } else {
                panels::materials::dropped(self, &path);
            }
        }
    }

    /// One line above everything: scenes, undo, time, where the camera is.
    fn bar(&mut self, ui: &mut Ui) {
        ui.horizontal_wrapped(|ui| {
            panels::scenes::menu(self, ui);
            if ui.add_enabled(self.can_undo(), egui::Button::new("Undo")).on_hover_text("Ctrl+Z").clicked() {
                self.undo();
            }
            if ui.add_enabled(self.can_redo(), egui::Button::new("Redo")).on_hover_text("Ctrl+Shift+Z").clicked() {
                self.redo();
            }
            ui.separator();
            let label = if self.clock.paused { "Run" } else { "Pause" };
            if ui.button(label).on_hover_text("Space").clicked() {
                self.clock.paused ^= true;
            }
            if ui.button("Step").on_hover_text("Full stop: one frame on, and pause").clicked() {
                self.step();
            }
            ui.label(format!("frame {}", self.clock.frame))
                .on_hover_text("The only time there is: noise and paths follow it, never a clock");
            ui.separator();
            panels::viewport::viewpoints(self, ui);
        });
    }

    /// One line below everything: what is wrong, what is being done, who draws.
    fn status(&self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some(failure) = self.failure() {
                ui.colored_label(ui.visuals().error_fg_color, failure);
            } else if let Some(error) = self.shader_error() {
                ui.colored_label(ui.visuals().error_fg_color, error).on_hover_text("The last shaders that compiled draw on");
            } else if let Some(progress) = &self.news.progress {
                match (progress.done, progress.total) {
                    (0, 0) => drop(ui.label(format!("{} ...", progress.stage))),
                    (done, 0) => drop(ui.label(format!("{}: {done} ...", progress.stage))),
                    (done, all) => progress_bar(ui, &progress.stage, [done, all]),
                }
            } else if !self.is_warm() && self.news.warm[1] > 0 {
                progress_bar(ui, "shaders", self.news.warm.map(|count| count as u64));
            } else {
                ui.label("ready");
            }
            if let Some(adapter) = &self.news.adapter {
                ui.separator();
                let kind = if adapter.software { ", a software adapter: compare times, do not quote them" } else { "" };
                ui.label(format!("{}{kind}", adapter.name));
            }
            if let Some(failure) = self.keeping.as_ref().and_then(Keeper::failure) {
                ui.separator();
                ui.colored_label(ui.visuals().error_fg_color, failure);
            }
        });
    }
}

/// Has nothing glide or fade: it would have the window painted again and again, beside pictures that are timed.
pub fn still(ctx: &egui::Context) {
    ctx.all_styles_mut(|style| {
        style.animation_time = 0.0;
        style.scroll_animation = egui::style::ScrollAnimation::none();
    });
}

/// How far something is. No wheel turns beside it, since the window would be painted without a pause, see [`PROGRESS`](crate::engine::PROGRESS).
fn progress_bar(ui: &mut Ui, stage: &str, [done, all]: [u64; 2]) {
    ui.add(egui::ProgressBar::new(done as f32 / all as f32).desired_width(160.0).text(format!("{stage}: {done} of {all}")));
}

/// What the window's panes are remembered by.
fn tree_id() -> egui::Id {
    egui::Id::unique("workbench")
}

/// The picture on the left, everything else in two stacks on the right.
fn layout() -> Tree<Pane> {
    let mut tiles = Tiles::default();
    let viewport = tiles.insert_pane(Pane::Viewport);
    let upper: Vec<TileId> = [Pane::Variants, Pane::Materials, Pane::Rules, Pane::Brush, Pane::Compare, Pane::Places, Pane::Help]
        .into_iter()
        .map(|p| tiles.insert_pane(p))
        .collect();
    let lower: Vec<TileId> = [Pane::Parameters, Pane::Metrics, Pane::Frame, Pane::Inspector, Pane::Machine, Pane::Experiments]
        .into_iter()
        .map(|p| tiles.insert_pane(p))
        .collect();
    let (upper, lower) = (tiles.insert_tab_tile(upper), tiles.insert_tab_tile(lower));
    let right = tiles.insert_vertical_tile(vec![upper, lower]);
    let root = tiles.insert_horizontal_tile(vec![viewport, right]);
    if let Some(Tile::Container(Container::Linear(linear))) = tiles.get_mut(root) {
        debug_assert_eq!(linear.dir, LinearDir::Horizontal, "made just above");
        linear.shares.set_share(viewport, 0.66);
        linear.shares.set_share(right, 0.34);
    }
    Tree::new(tree_id(), root, tiles)
}

struct Panes<'a>(&'a mut Workbench);

impl Behavior<Pane> for Panes<'_> {
    fn pane_ui(&mut self, ui: &mut Ui, _: TileId, pane: &mut Pane) -> UiResponse {
        let app = &mut *self.0;
        let scrolled = |ui: &mut Ui, app: &mut Workbench, add: fn(&mut Workbench, &mut Ui)| {
            egui::Frame::new().inner_margin(8.0).show(ui, |ui| {
                egui::ScrollArea::both().auto_shrink(false).show(ui, |ui| add(app, ui));
            });
        };
        match pane {
            Pane::Viewport => panels::viewport::show(app, ui),
            Pane::Variants => scrolled(ui, app, panels::variants::show),
            Pane::Materials => scrolled(ui, app, panels::materials::show),
            Pane::Rules => scrolled(ui, app, panels::rules::show),
            Pane::Brush => scrolled(ui, app, panels::brush::show),
            Pane::Compare => scrolled(ui, app, panels::compare::show),
            Pane::Metrics => scrolled(ui, app, panels::metrics::show),
            Pane::Parameters => scrolled(ui, app, panels::parameters::show),
            Pane::Frame => scrolled(ui, app, panels::frame::show),
            Pane::Inspector => scrolled(ui, app, panels::inspector::show),
            Pane::Machine => scrolled(ui, app, panels::machine::show),
            Pane::Experiments => scrolled(ui, app, panels::experiments::show),
            Pane::Places => scrolled(ui, app, panels::places::show),
            Pane::Help => scrolled(ui, app, panels::help::show),
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> WidgetText {
        pane.name().into()
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions { all_panes_must_have_tabs: true, ..Default::default() }
    }
}

/// A size in the shape of `room`, `scale` times as large, but with no side longer than `most`; a side of 0 stays that.
fn scaled(room: [u32; 2], scale: f64, most: u32) -> [u32; 2] {
    let longest = f64::from(room[0].max(room[1]).max(1));
    let scale = scale.min(f64::from(most) / longest);
    room.map(|side| if side == 0 { 0 } else { ((f64::from(side) * scale).round() as u32).max(1) })
}

/// Adds a time to the last [`TIMES`].
fn remember(times: &mut VecDeque<Duration>, time: Duration) {
    times.push_back(time);
    if times.len() > TIMES {
        times.pop_front();
    }
}

impl eframe::App for Workbench {
    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        [0.0, 0.0, 0.0, 1.0]
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        if let Some(seconds) = frame.info().cpu_usage {
            remember(&mut self.answers, Duration::from_secs_f32(seconds.max(0.0)));
        }
        self.listen(&ctx);
        panels::materials::listen(self);
        panels::scenes::listen(self);
        self.dropped(&ctx);
        self.watch_closing(&ctx);
        self.seek();
        if let Some(shown) = self.shown_here().cloned() {
            self.places.watch(&shown);
        }
        self.keys(&ctx);
        self.tick();
        egui::Panel::top("bar").show(ui, |ui| self.bar(ui));
        if !self.notes.is_empty() {
            egui::Panel::top("notes").show(ui, |ui| {
                for note in &self.notes {
                    ui.colored_label(ui.visuals().warn_fg_color, note);
                }
                if ui.button("Dismiss").clicked() {
                    self.notes.clear();
                }
            });
        }
        panels::scenes::ask(self, ui);
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        egui::CentralPanel::no_frame().show(ui, |ui| {
            let mut tree = std::mem::replace(&mut self.tree, Tree::empty(tree_id()));
            tree.ui(&mut Panes(self), ui);
            self.tree = tree;
        });
        self.ask();
        self.watch_changes(&ctx);
        self.keep(&ctx);
        if self.titled != self.original.name {
            self.titled.clone_from(&self.original.name);
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(format!("Scree - {}", self.titled)));
        }
    }

    fn on_exit(&mut self) {
        // Of a scene that may not be one nothing is kept.
        if self.before.is_none() {
            self.keep_now();
        }
        if let Some(error) = self.keeping.as_ref().and_then(Keeper::failure) {
            // The window is gone.
            eprintln!("error: {error}");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::scaled;

    #[test]
    fn no_picture_is_larger_than_the_window_can_show() {
        assert_eq!(scaled([640, 360], 0.5, 8192), [320, 180]);
        assert_eq!(scaled([5120, 1440], 2.0, 8192), [8192, 2304]);
        assert_eq!(scaled([3, 5000], 2.0, 8192), [5, 8192]);
        assert_eq!((scaled([0, 100], 1.0, 8192), scaled([1, 100], 0.1, 8192)), ([0, 100], [1, 10]));
    }
}

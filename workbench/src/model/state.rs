//! The model: what is on screen, how it is looked at, what is undone and kept. Panels show and change it; the window asks for its pictures.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::util::undoer::Undoer;
use eframe::egui::{self, TextureHandle};
use egui_tiles::Tree;
use glam::DVec3;
use kernels::scene::{self, Scene};
use kernels::view::camera::Pose;

use super::brush::{Brush, Ground};
use super::compare::Compare;
use super::drafts::{MaterialsDraft, PlacesDraft, RulesDraft, Scenes};
use super::flight::{self, Flight, Orbit};
use super::kept::{self, Keeper, Kept};
use super::metrics::Metrics;
use super::panes::{self, Pane};
use super::picture::{News, Shown, Wish};
use super::settings::Settings;
use super::viewpoint::{Viewpoint, usual_viewpoint};

mod opening;

/// Pictures that the graph of frame times goes back.
const TIMES: usize = 120;
/// Pixels drawn per pixel of the screen, along a side, where a processor draws.
const SOFTWARE_SCALE: f64 = 0.5;
/// Vertices of the terrain that are drawn there, see [`FrameSettings::vertex_stride`](kernels::frame::FrameSettings::vertex_stride): a processor takes its time by vertices; relief
/// near the eye and the edges of steep steps look coarser for it.
const SOFTWARE_STRIDE: u32 = 4;

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

/// What the panels show and change.
pub struct Model {
    /// What the thread that draws said last.
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
    pub(crate) most_side: u32,
    pub(crate) textures: [Option<TextureHandle>; 3],
    /// How the pictures are looked at.
    pub(crate) looking: Looking,
    /// Why the scene cannot be as the sliders have it.
    impossible: Option<String>,
    /// The last scene that could be: it goes on being drawn when files that it names are removed.
    checked: Option<Box<Scene>>,
    pub(crate) times: VecDeque<Duration>,
    /// How long the window took for each of its own drawings, which is how long a click waits at most.
    pub(crate) answers: VecDeque<Duration>,
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
    pub(crate) places: PlacesDraft,
    pub(crate) materials: MaterialsDraft,
    pub(crate) rules: RulesDraft,
    pub(crate) scenes: Scenes,
    /// What the scene was opened from, as [`scene::load`] takes it; `None` = from no file.
    given: Option<String>,
    /// Number of its opening, as [`Wish::opened`].
    opened: u32,
    /// The scene before it, until it is loaded.
    before: Option<Box<opening::Before>>,
    /// What writes what is kept; `None` = nothing is.
    keeping: Option<Keeper>,
    /// What somebody should know of what was kept and opened, until it is dismissed.
    pub(crate) notes: Vec<String>,
    /// How the panes are arranged.
    pub(crate) tree: Tree<Pane>,
}

impl Model {
    /// A scene as it is opened first.
    pub(crate) fn new(scene: Scene) -> Model {
        Model {
            news: News::default(),
            settings: Settings::new(scene.clone()),
            compare: Compare::default(),
            metrics: Metrics::default(),
            probe: None,
            viewpoint: usual_viewpoint(&scene),
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
            impossible: None,
            checked: None,
            times: VecDeque::new(),
            answers: VecDeque::new(),
            chosen: [false; 2],
            leaves: false,
            adapted: false,
            usual_scale: 1.0,
            usual_stride: 1,
            places: PlacesDraft::default(),
            materials: MaterialsDraft::default(),
            rules: RulesDraft::default(),
            scenes: Scenes::default(),
            given: None,
            opened: 0,
            before: None,
            keeping: None,
            notes: Vec::new(),
            tree: panes::usual(),
        }
    }

    /// Takes note of what the scene was opened from, as [`scene::load`] takes it: a file that is asked for may then be written over.
    pub fn come_from(&mut self, given: &str) {
        self.materials.opened(given);
        let name = kept::scene_name(given);
        self.scenes.opened(&name);
        self.given = Some(name);
    }

    /// Takes up what is kept of the scene of this name ([`kept::scene_name`]), and keeps it from now on. `notes` are shown until they are dismissed.
    pub fn keep_with(&mut self, keeper: Keeper, scene_name: String, mut notes: Vec<String>) {
        let kept = keeper.kept();
        notes.extend(kept.apply_look(&mut self.settings));
        self.scenes.recent = kept.recent().to_vec();
        self.scenes.opened(&scene_name);
        if let Some(tree) = kept.tree(panes::tree_id()) {
            self.tree = tree;
        }
        // Who chose a scale keeps it on a software adapter, too.
        self.chosen = kept.has_scale_and_stride();
        (self.keeping, self.given) = (Some(keeper), Some(scene_name));
        notes.extend(self.take_up());
        self.notes = notes;
    }

    /// What there is to keep.
    fn present(&self, before: &Kept, scene_name: &str) -> Kept {
        let kept = Kept::of(before, scene_name, &self.settings, &self.original, &self.places.all, &self.tree);
        // What is usual is not known before the adapter is.
        if self.adapted { kept.without_usual(self.usual_scale, self.usual_stride) } else { kept.with_scale_and_stride_of(before) }
    }

    /// Keeps what has changed, now and then.
    pub(crate) fn keep(&mut self, ctx: &egui::Context) {
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
    pub(crate) fn keep_now(&mut self) {
        let Some(name) = self.given.clone() else { return };
        let Some(mut keeper) = self.keeping.take() else { return };
        // Why it could not be is in the keeper's failure.
        let _ = keeper.finish(|before| self.present(before, &name));
        self.keeping = Some(keeper);
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

    /// Goes on to the next frame if this one was shown, so that none is left out.
    pub(crate) fn tick(&mut self) {
        let frame = self.clock.frame;
        if !self.clock.paused && self.shown_here().is_some_and(|shown| shown.wish.frame == frame) {
            self.clock.frame = frame.wrapping_add(1);
        }
    }

    /// Chooses what suits the adapter, once it is known and where nobody chose otherwise.
    pub(crate) fn adapt(&mut self) {
        let Some(adapter) = &self.news.adapter else { return };
        let untouched = [self.settings.scale == self.usual_scale, self.settings.frame.vertex_stride == self.usual_stride];
        (self.usual_scale, self.usual_stride) = if adapter.software { (SOFTWARE_SCALE, SOFTWARE_STRIDE) } else { (1.0, 1) };
        if !std::mem::replace(&mut self.adapted, true) {
            if !self.chosen[0] && untouched[0] {
                self.settings.scale = self.usual_scale;
            }
            if !self.chosen[1] && untouched[1] {
                self.settings.frame.vertex_stride = self.usual_stride;
            }
            // Nobody did this, so nobody takes it back.
            self.undoer = Undoer::default();
        }
    }

    /// Adds to the times from one picture to the next.
    pub(crate) fn picture_took(&mut self, time: Duration) {
        remember(&mut self.times, time);
    }

    /// Adds to the times that the window took to be drawn.
    pub(crate) fn window_took(&mut self, time: Duration) {
        remember(&mut self.answers, time);
    }

    /// Whether a picture can be drawn as the controls describe it. What a slider made impossible is said, and the picture stays as it was.
    pub(crate) fn is_possible(&mut self) -> bool {
        if self.checked.as_deref() != Some(&self.settings.scene) {
            self.impossible = scene::validate(&self.settings.scene).err().map(|error| error.to_string());
            self.checked = self.impossible.is_none().then(|| Box::new(self.settings.scene.clone()));
        }
        self.impossible.is_none() && self.has_room() && self.news.adapter.is_some()
    }

    /// Why what is to be kept could not be written.
    pub(crate) fn keeping_failure(&self) -> Option<&str> {
        self.keeping.as_ref().and_then(Keeper::failure)
    }

    /// The picture that the controls describe.
    pub(crate) fn wish(&self) -> Wish {
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
    pub(crate) fn seek(&mut self) {
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
    pub(crate) fn watch_changes(&mut self, ctx: &egui::Context) {
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

//! The model: the current settings, how pictures are displayed, the undo history, and the saved state. Panels show and change it; the window requests
//! the pictures that it describes.

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
use super::times::{Times, remember};
use super::viewpoint::{Viewpoint, usual_viewpoint};

mod opening;

/// Default render scale on a software adapter: pixels drawn per pixel of the screen, along a side.
const SOFTWARE_SCALE: f64 = 0.5;
/// Default of [`FrameSettings::vertex_stride`](kernels::frame::FrameSettings::vertex_stride) on a software adapter, where vertices are expensive.
/// With this stride, relief near the camera and the edges of steep steps look coarser.
const SOFTWARE_STRIDE: u32 = 4;

/// The frame number, and whether time runs.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Clock {
    /// The frame that is drawn next, or the frame on screen while paused.
    pub frame: u32,
    /// Whether time is paused.
    pub paused: bool,
    /// Number of frames for which time may still run by itself; `None` = any number. In a script, it is 0 except during the step `frames`. The frame
    /// on screen then depends on the steps alone, and not on how long they wait.
    pub left: Option<u32>,
}

impl Clock {
    /// Whether the next frame begins by itself.
    pub fn runs(&self) -> bool {
        !self.paused && self.left != Some(0)
    }
}

/// How pictures are displayed; this does not change what is rendered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Looking {
    /// Magnification, from 1.
    pub zoom: f32,
    /// The position in the picture that is in the middle of the viewport, as shares of the width and height of the picture.
    pub centre: [f32; 2],
    /// Whether a magnified cut-out follows the pointer.
    pub loupe: bool,
    /// Position of the line in the mode *Wipe*, as a share of the width of the viewport.
    pub wipe: f32,
    /// In the mode *Flicker*, which shows one picture at a time: whether B is on screen.
    pub b: bool,
    /// Whether the current drag draws the rectangle in which the live metrics are computed.
    pub measures: bool,
}

impl Default for Looking {
    fn default() -> Self {
        Looking { zoom: 1.0, centre: [0.5; 2], loupe: false, wipe: 0.5, b: false, measures: false }
    }
}

/// The state of the application. The panels show and change it.
pub struct Model {
    /// The latest report of the drawing thread.
    pub(crate) news: News,
    /// The current settings: everything that decides how the terrain looks.
    pub settings: Settings,
    /// The scene as it was loaded, or last saved as a file; a reset restores values from it.
    pub(crate) original: Scene,
    /// The comparison of A with B.
    pub compare: Compare,
    /// Settings of the live metrics.
    pub metrics: Metrics,
    /// Position of the inspected pixel, as shares of the picture; `None` = no pixel is inspected.
    pub probe: Option<[f32; 2]>,
    undoer: Undoer<(Settings, Compare)>,
    /// The viewpoint.
    pub viewpoint: Viewpoint,
    pub(crate) flight: Flight,
    /// The pose at which culling is frozen; `None` = culling is not frozen.
    pub culled_from: Option<Pose>,
    /// The brush.
    pub brush: Brush,
    /// The frame number, and whether time runs.
    pub clock: Clock,
    /// Size of the viewport, pixels.
    pub(crate) room: [u32; 2],
    /// Longest side of a picture that the window can show, pixels.
    pub(crate) most_side: u32,
    pub(crate) textures: [Option<TextureHandle>; 3],
    /// How pictures are displayed.
    pub(crate) looking: Looking,
    /// Why the scene with the current settings is not valid; `None` = it is valid.
    impossible: Option<String>,
    /// The scene that was validated last; `None` = it is not valid, or none was validated yet. While the current scene is equal to this one, it is
    /// not validated again. The current scene is therefore still drawn after files that it names have been removed.
    checked: Option<Box<Scene>>,
    /// Times of the last pictures.
    pub(crate) times: Times,
    /// Durations of the last drawings of the window, without the drawing of the terrain pictures. The effect of a click is visible after such a
    /// drawing.
    pub(crate) answers: VecDeque<Duration>,
    /// Whether the saved state has a render scale (first) and a vertex stride (second). Saved values were chosen by the user.
    chosen: [bool; 2],
    /// Whether the window may close although edits would be lost.
    leaves: bool,
    /// Whether the defaults for the adapter have been applied.
    adapted: bool,
    /// The default render scale for the adapter.
    pub(crate) usual_scale: f64,
    /// The default vertex stride for the adapter.
    pub(crate) usual_stride: u32,
    pub(crate) places: PlacesDraft,
    pub(crate) materials: MaterialsDraft,
    pub(crate) rules: RulesDraft,
    pub(crate) scenes: Scenes,
    /// The argument of [`scene::load`] from which the scene was opened; `None` = it does not come from a file.
    given: Option<String>,
    /// Number that identifies this loading of the scene, see [`Wish::opened`].
    opened: u32,
    /// The state of the previous scene, until the drawing thread has loaded the current scene.
    before: Option<Box<opening::Before>>,
    /// Writes the saved state; `None` = nothing is saved.
    keeping: Option<Keeper>,
    /// Notes for the user, about the saved state and scenes that were opened. They are shown until dismissed.
    pub(crate) notes: Vec<String>,
    /// The arrangement of the panes.
    pub(crate) tree: Tree<Pane>,
}

impl Model {
    /// A model of a scene, with defaults for everything else.
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
            times: Times::default(),
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

    /// Records what the scene was opened from (the argument of [`scene::load`]). Saving may then overwrite that file, if the user asks for it.
    pub fn come_from(&mut self, given: &str) {
        self.materials.opened(given);
        let name = kept::scene_name(given);
        self.scenes.opened(&name);
        self.given = Some(name);
    }

    /// Applies the saved state: the settings, the arrangement of the panes, the recent scenes, and the state of the scene with this name
    /// ([`kept::scene_name`]). From now on, the state is saved. `notes` are shown until dismissed.
    pub fn keep_with(&mut self, keeper: Keeper, scene_name: String, mut notes: Vec<String>) {
        let kept = keeper.kept();
        notes.extend(kept.apply_look(&mut self.settings));
        self.scenes.recent = kept.recent().to_vec();
        self.scenes.opened(&scene_name);
        if let Some(tree) = kept.tree(panes::tree_id()) {
            self.tree = tree;
        }
        // A render scale or vertex stride that the user chose also applies on a software adapter.
        self.chosen = kept.has_scale_and_stride();
        (self.keeping, self.given) = (Some(keeper), Some(scene_name));
        notes.extend(self.take_up());
        self.notes = notes;
    }

    /// Returns the state to save.
    fn present(&self, before: &Kept, scene_name: &str) -> Kept {
        let kept = Kept::of(before, scene_name, &self.settings, &self.original, &self.places.all, &self.tree);
        // The default render scale and vertex stride depend on the adapter. While the adapter is unknown, keep the previously saved values.
        if self.adapted { kept.without_usual(self.usual_scale, self.usual_stride) } else { kept.with_scale_and_stride_of(before) }
    }

    /// Saves changed state at intervals.
    pub(crate) fn keep(&mut self, ctx: &egui::Context) {
        let Some(name) = self.given.clone() else { return };
        let Some(mut keeper) = self.keeping.take() else { return };
        // Do not save the state of a scene that has not loaded.
        if self.before.is_none() {
            keeper.tend(Instant::now(), |before| self.present(before, &name));
        }
        self.keeping = Some(keeper);
        // Without this request, a change would not be saved until the window is painted for another reason.
        ctx.request_repaint_after(kept::EVERY);
    }

    /// Saves changed state, and waits until it is written.
    pub(crate) fn keep_now(&mut self) {
        let Some(name) = self.given.clone() else { return };
        let Some(mut keeper) = self.keeping.take() else { return };
        // An error is not lost: [`Model::keeping_failure`] returns it.
        let _ = keeper.finish(|before| self.present(before, &name));
        self.keeping = Some(keeper);
    }

    /// The last picture.
    pub fn shown(&self) -> Option<&Arc<Shown>> {
        self.news.shown.as_ref()
    }

    /// The last picture, if it shows the current scene. While another scene is being loaded, the picture of the previous scene stays on screen.
    pub fn shown_here(&self) -> Option<&Arc<Shown>> {
        self.shown().filter(|shown| shown.wish.opened == self.opened)
    }

    /// Rectangle of a panel in the window, points; `None` = the panel is not visible, for example behind another one.
    pub fn place_of(&self, pane: Pane) -> Option<egui::Rect> {
        let tile = self.tree.tiles.find_pane(&pane)?;
        self.tree.tiles.is_visible(tile).then(|| self.tree.tiles.rect(tile)).flatten()
    }

    /// Whether the picture on screen is the one that the controls describe.
    pub fn is_settled(&self) -> bool {
        let Some(shown) = self.shown().filter(|shown| !shown.draft) else { return false };
        let same_time = self.clock.runs() || shown.wish.frame == self.clock.frame;
        same_time && shown.wish == Wish { frame: shown.wish.frame, ..self.wish() }
    }

    /// Progress of a long task of the drawing thread.
    pub fn progress(&self) -> Option<&kernels::base::progress::Progress> {
        self.news.progress.as_ref()
    }

    /// Why the picture that the controls describe cannot be drawn; `None` = it can be drawn, or is being drawn.
    pub fn failure(&self) -> Option<&str> {
        // Ignore a failure to load a different scene.
        let own = self.news.unloaded.is_none_or(|opened| opened == self.opened);
        self.impossible.as_deref().or(self.news.failure.as_deref().filter(|_| own))
    }

    /// Why the shaders in the watched folder are not in use.
    pub fn shader_error(&self) -> Option<&str> {
        self.news.shader_error.as_deref()
    }

    /// Whether the viewport has room for a picture.
    pub fn has_room(&self) -> bool {
        !self.room.contains(&0)
    }

    /// Whether all shaders that are compiled in advance are compiled, see [`News::warm`].
    pub fn is_warm(&self) -> bool {
        self.news.warm[1] > 0 && self.news.warm[0] == self.news.warm[1]
    }

    /// Size of the picture to draw, pixels.
    fn size(&self) -> [u32; 2] {
        scaled(self.room, self.settings.scale, self.most_side)
    }

    /// If time runs, advances to the next frame once the current frame is on screen, so that no frame is skipped.
    pub(crate) fn tick(&mut self) {
        let Clock { frame, left, .. } = self.clock;
        if self.clock.runs() && self.shown_here().is_some_and(|shown| shown.wish.frame == frame) {
            self.clock.frame = frame.wrapping_add(1);
            self.clock.left = left.map(|left| left - 1);
        }
    }

    /// Applies the defaults for the adapter once it is known. A value that the user chose is not changed.
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
            // The user did not make this change, so undo must not revert it.
            self.undoer = Undoer::default();
        }
    }

    /// Records how long a drawing of the window took.
    pub(crate) fn window_took(&mut self, time: Duration) {
        remember(&mut self.answers, time);
    }

    /// Whether the picture that the controls describe can be requested: the scene is valid, the viewport has room, and the adapter is known. If not,
    /// the last picture stays on screen. [`Model::failure`] says why a scene is not valid.
    pub(crate) fn is_possible(&mut self) -> bool {
        if self.checked.as_deref() != Some(&self.settings.scene) {
            self.impossible = scene::validate(&self.settings.scene).err().map(|error| error.to_string());
            self.checked = self.impossible.is_none().then(|| Box::new(self.settings.scene.clone()));
        }
        self.impossible.is_none() && self.has_room() && self.news.adapter.is_some()
    }

    /// Why the state could not be saved.
    pub(crate) fn keeping_failure(&self) -> Option<&str> {
        self.keeping.as_ref().and_then(Keeper::failure)
    }

    /// The request for the picture that the controls describe.
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

    /// The current pose of the camera, at which the next movement starts; `None` = it is not known yet.
    pub fn pose(&self) -> Option<Pose> {
        match &self.viewpoint {
            // Only the drawing thread can compute the height of the ground below a walking camera, so the elevation is that of the last picture. The
            // other coordinates are those of the viewpoint, which may be ahead of the last picture.
            Viewpoint::Free { pose, walking: true } => {
                let z = self.shown_here().map_or(pose.position.z, |shown| shown.pose.position.z);
                Some(Pose { position: pose.position.with_z(z), ..*pose })
            }
            Viewpoint::Free { pose, walking: false } => Some(*pose),
            Viewpoint::Camera(_) | Viewpoint::Path(_) | Viewpoint::Recorded(_) => self.shown_here().map(|shown| shown.pose),
        }
    }

    /// Changes to a free camera that starts at this pose.
    pub(crate) fn fly(&mut self, pose: Pose) {
        self.viewpoint = Viewpoint::Free { pose, walking: self.flight.walking };
    }

    /// Begins or ends orbiting. If orbiting begins, walking ends.
    pub(crate) fn orbit(&mut self, on: bool) {
        self.flight.orbit = if on { Orbit::Sought } else { Orbit::Off };
        self.flight.walking &= !on;
    }

    /// The place that the camera orbits, world metres; `None` = the camera flies or walks, or the place is not known yet.
    pub fn orbited(&self) -> Option<DVec3> {
        self.flight.target()
    }

    /// Begins to orbit as soon as the position of the orbited place can be computed from the picture on screen.
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

    /// Freezes culling at the current pose, or unfreezes it if it is frozen.
    pub(crate) fn freeze_culling(&mut self) {
        self.culled_from = if self.culled_from.is_some() { None } else { self.pose() };
    }

    /// Advances by one frame and pauses. If time runs, it only pauses, because the next frame has begun by itself.
    pub(crate) fn step(&mut self) {
        let frame = self.clock.frame.wrapping_add(u32::from(!self.clock.runs()));
        self.clock = Clock { frame, paused: true, ..self.clock };
    }

    /// The values that undo restores.
    fn undoable(&self) -> (Settings, Compare) {
        (self.settings.clone(), self.compare.clone())
    }

    /// Adds an undo point, so that the changes before it and those after it are undone separately.
    pub(crate) fn undo_point(&mut self, ctx: &egui::Context) {
        let present = self.undoable();
        // Feed the state first, because that discards the changes that redo would restore.
        self.undoer.feed_state(ctx.input(|i| i.time), &present);
        self.undoer.add_undo(&present);
    }

    /// Passes the current values to the undo history. A drag of the brush counts as one change, regardless of its length and of pauses in it.
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

/// Scales `room` by `scale`, or by less if a side would be longer than `most`. A side of 0 stays 0.
fn scaled(room: [u32; 2], scale: f64, most: u32) -> [u32; 2] {
    let longest = f64::from(room[0].max(room[1]).max(1));
    let scale = scale.min(f64::from(most) / longest);
    room.map(|side| if side == 0 { 0 } else { ((f64::from(side) * scale).round() as u32).max(1) })
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

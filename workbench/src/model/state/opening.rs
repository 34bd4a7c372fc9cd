//! Opening another scene in the same window. The state of the current scene is set aside, and restored if the other scene cannot be loaded.

use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

use eframe::egui;
use eframe::egui::util::undoer::Undoer;
use kernels::scene::{self, Scene};

use super::{Clock, Model};
use crate::model::compare::{Compare, Other};
use crate::model::drafts::{MaterialsDraft, PlacesDraft, RulesDraft, Waiting};
use crate::model::flight::Orbit;
use crate::model::kept;
use crate::model::settings::Settings;
use crate::model::viewpoint::{Viewpoint, usual_viewpoint};

/// The next value of [`Wish::opened`](crate::model::picture::Wish::opened). All windows of the program share this counter. The first scene of every
/// window has the number 0.
static NEXT: AtomicU32 = AtomicU32::new(1);

/// The state of the previous scene, until it is known whether the current one can be loaded.
pub(super) struct Before {
    scene: Scene,
    original: Scene,
    compare: Compare,
    undoer: Undoer<(Settings, Compare)>,
    viewpoint: Viewpoint,
    clock: Clock,
    probe: Option<[f32; 2]>,
    given: Option<String>,
    /// The drafts of the panels, if they were emptied for the current scene.
    panels: Option<(PlacesDraft, MaterialsDraft, RulesDraft)>,
}

/// Reads a scene. An error is one line.
fn load(name: &str) -> Result<Scene, String> {
    scene::load(name).map_err(|error| error.to_string().replace('\n', " "))
}

impl Model {
    /// Opens another scene; `given` is the argument of [`scene::load`]. The state of the current scene is saved first. Afterwards, the drawing
    /// thread reads the files that the new scene names. If this fails, the window returns to the previous scene, and a note says why.
    ///
    /// # Errors
    /// One line: the scene cannot be read (the error is also added to the notes), or edits that are not saved in a file would be lost (the window
    /// asks what to do). The current scene stays open.
    pub fn open(&mut self, given: &str) -> Result<(), String> {
        if !self.has_unsaved_edits() {
            return self.open_anyway(given);
        }
        self.scenes.waits = Some(Waiting::Open(kept::scene_name(given)));
        Err(format!("`{}` has edits that are not saved in a file: save it, or choose `Open without saving`", self.original.name))
    }

    /// Like [`Model::open`], but opens the scene even if unsaved edits are lost.
    pub(crate) fn open_anyway(&mut self, given: &str) -> Result<(), String> {
        self.scenes.waits = None;
        let name = kept::scene_name(given);
        match load(&name) {
            Ok(scene) => {
                self.take_over(name, scene);
                Ok(())
            }
            Err(why) => {
                self.say(why.clone());
                Err(why)
            }
        }
    }

    /// If the window is about to close and edits would be lost, keeps the window open and asks the user.
    pub(crate) fn watch_closing(&mut self, ctx: &egui::Context) {
        if ctx.input(|i| i.viewport().close_requested()) && !self.leaves && self.has_unsaved_edits() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.scenes.waits = Some(Waiting::Close);
        }
    }

    /// Closes the window, even if edits are lost.
    pub(crate) fn close_anyway(&mut self, ctx: &egui::Context) {
        self.scenes.waits = None;
        self.leaves = true;
        ctx.send_viewport_cmd(egui::ViewportCommand::Close);
    }

    /// Reads the file of the scene again and replaces the scene. Undo restores the previous state of the scene.
    ///
    /// # Errors
    /// One line, which is also shown as a note: the scene has no file, or its file no longer exists or cannot be read. The scene is not changed.
    pub(crate) fn reload(&mut self, ctx: &egui::Context) -> Result<(), String> {
        let read = match &self.given {
            None => Err("the scene does not come from a file: save it with `Save scene as...` first".to_owned()),
            Some(name) if name != scene::DEFAULT && !Path::new(name).exists() => {
                Err(format!("{name} no longer exists: the scene is not changed; `Save scene as...` writes it to a file again"))
            }
            Some(name) => load(name),
        };
        let scene = read.inspect_err(|why| self.say(why.clone()))?;
        self.brush.finish();
        self.undo_point(ctx);
        self.remember();
        self.settings.scene = scene.clone();
        self.original = scene;
        self.keep_viewpoint();
        self.opened = NEXT.fetch_add(1, Ordering::Relaxed);
        Ok(())
    }

    /// Returns to the default viewpoint if the scene no longer has the current camera or path.
    pub(crate) fn keep_viewpoint(&mut self) {
        let scene = &self.settings.scene;
        let is_there = match &self.viewpoint {
            Viewpoint::Camera(name) => scene.cameras.iter().any(|camera| camera.name == *name),
            Viewpoint::Path(name) => scene.paths.iter().any(|path| path.name == *name),
            Viewpoint::Recorded(_) | Viewpoint::Free { .. } => true,
        };
        if !is_there {
            self.viewpoint = usual_viewpoint(scene);
        }
    }

    /// Records that the scene was saved in a file. That file is the file of the scene from then on.
    pub(crate) fn saved_as(&mut self, file: &Path) {
        self.original = self.settings.scene.clone();
        // A file name that is not valid UTF-8 can neither be saved in the state nor be used to open the scene. In this case, the scene keeps its
        // previous file.
        let Some(name) = file.to_str().map(kept::scene_name).filter(|name| self.given.as_ref() != Some(name)) else { return };
        self.materials.opened(&name);
        self.scenes.opened(&name);
        self.given = Some(name);
        self.keep_now();
    }

    /// The argument of [`scene::load`] from which the scene was opened; `None` = it does not come from a file.
    pub fn given(&self) -> Option<&str> {
        self.given.as_deref()
    }

    /// Notes for the user that have not been dismissed; the newest last.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether the drawing thread is still loading the scene that was opened.
    pub fn is_opening(&self) -> bool {
        self.before.is_some()
    }

    /// Whether materials, rules or strokes have unsaved edits. Numbers do not count, because they are part of the saved state.
    fn has_unsaved_edits(&self) -> bool {
        let (now, file) = (&self.settings.scene, &self.original);
        now.materials != file.materials || now.rules != file.rules || now.strokes != file.strokes
    }

    /// Applies the saved state of the current scene. Returns a line for each part that cannot be applied.
    pub(super) fn take_up(&mut self) -> Vec<String> {
        let Some((keeper, name)) = self.keeping.as_ref().zip(self.given.as_ref()) else { return Vec::new() };
        self.places.all = keeper.kept().places(name);
        keeper.kept().apply_numbers(name, &mut self.settings.scene)
    }

    /// Replaces the current scene.
    fn take_over(&mut self, name: String, scene: Scene) {
        self.brush.finish();
        self.places.stop();
        // Do not save the state of a scene that has not loaded.
        if self.before.is_none() {
            self.keep_now();
        }
        self.remember();
        let panels = (std::mem::take(&mut self.places), std::mem::take(&mut self.materials), std::mem::take(&mut self.rules));
        if let Some(before) = &mut self.before {
            before.panels.get_or_insert(panels);
        }
        self.viewpoint = usual_viewpoint(&scene);
        self.brush.fit(&scene);
        self.settings.scene = scene.clone();
        self.original = scene;
        self.undoer = Undoer::default();
        self.clock.frame = 0;
        (self.probe, self.culled_from, self.flight.orbit) = (None, None, Orbit::Off);
        if matches!(self.compare.other, Other::Kept(_)) {
            // The stored settings belong to the previous scene.
            self.compare = Compare::default();
        }
        self.materials.opened(&name);
        self.scenes.opened(&name);
        self.given = Some(name);
        let said = self.take_up();
        self.notes.extend(said);
        self.opened = NEXT.fetch_add(1, Ordering::Relaxed);
    }

    /// Sets the state of the current scene aside. If the current scene is still being loaded, does nothing: the state of the scene before it is
    /// already set aside.
    fn remember(&mut self) {
        if self.before.is_some() {
            return;
        }
        self.before = Some(Box::new(Before {
            scene: self.settings.scene.clone(),
            original: self.original.clone(),
            compare: self.compare.clone(),
            undoer: self.undoer.clone(),
            viewpoint: self.viewpoint.clone(),
            clock: self.clock,
            probe: self.probe,
            given: self.given.clone(),
            panels: None,
        }));
    }

    /// Checks whether the scene that was opened has been loaded. If loading failed, returns to the previous scene.
    pub(crate) fn settle_opening(&mut self) {
        if self.news.loaded == Some(self.opened) {
            self.before = None;
        }
        if self.news.unloaded != Some(self.opened) {
            return;
        }
        let Some(before) = self.before.take() else { return };
        let Before { scene, original, compare, undoer, viewpoint, clock, probe, given, panels } = *before;
        let why = self.news.failure.clone().unwrap_or_default().replace('\n', " ");
        let name = self.given.clone().unwrap_or_else(|| self.original.name.clone());
        self.say(format!("{name} cannot be loaded: {why}"));
        self.brush.finish();
        if let Some((places, materials, rules)) = panels {
            (self.places, self.materials, self.rules) = (places, materials, rules);
        }
        self.settings.scene = scene;
        (self.original, self.compare, self.undoer, self.viewpoint) = (original, compare, undoer, viewpoint);
        (self.clock.frame, self.probe, self.given) = (clock.frame, probe, given);
        (self.culled_from, self.flight.orbit) = (None, Orbit::Off);
        self.brush.fit(&self.original);
        self.opened = NEXT.fetch_add(1, Ordering::Relaxed);
    }

    /// Adds a note, unless it is already there.
    pub(crate) fn say(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }
}

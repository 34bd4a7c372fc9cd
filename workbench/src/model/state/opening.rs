//! Another scene in the same window: what belongs to a scene is put away, and taken up again if the other one turns out not to be one.

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

/// The number of the next opening, of all windows; every window begins with 0.
static NEXT: AtomicU32 = AtomicU32::new(1);

/// What belongs to the scene that was open before, as long as it is not known whether the other one can be loaded.
pub(super) struct Before {
    scene: Scene,
    original: Scene,
    compare: Compare,
    undoer: Undoer<(Settings, Compare)>,
    viewpoint: Viewpoint,
    clock: Clock,
    probe: Option<[f32; 2]>,
    given: Option<String>,
    /// Drafts that were emptied, if they were.
    panels: Option<(PlacesDraft, MaterialsDraft, RulesDraft)>,
}

/// Reads a scene; what is wrong with it is one line.
fn load(name: &str) -> Result<Scene, String> {
    scene::load(name).map_err(|error| error.to_string().replace('\n', " "))
}

impl Model {
    /// Opens another scene, as [`scene::load`] takes it. What is kept of the one that is open is kept first. Files that the scene names are read
    /// afterwards: if that fails, the window goes back to the scene before, and a note says why.
    ///
    /// # Errors
    /// One line: the scene cannot be read, which a note says, too; or edits that are in no file would be lost, which the window asks about. The scene
    /// that is open stays.
    pub fn open(&mut self, given: &str) -> Result<(), String> {
        if !self.has_unsaved_edits() {
            return self.open_anyway(given);
        }
        self.scenes.waits = Some(Waiting::Open(kept::scene_name(given)));
        Err(format!("`{}` has edits that are in no file: save it, or choose `Open without saving`", self.original.name))
    }

    /// As [`Model::open`], whatever is lost.
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

    /// Keeps the window open and asks, if it is about to be closed and edits would be lost.
    pub(crate) fn watch_closing(&mut self, ctx: &egui::Context) {
        if ctx.input(|i| i.viewport().close_requested()) && !self.leaves && self.has_unsaved_edits() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.scenes.waits = Some(Waiting::Close);
        }
    }

    /// Closes the window, whatever is lost.
    pub(crate) fn close_anyway(&mut self, ctx: &egui::Context) {
        self.scenes.waits = None;
        self.leaves = true;
        ctx.send_viewport_cmd(egui::ViewportCommand::Close);
    }

    /// Reads the scene's file again: the scene is what that says, and undo brings back what it was.
    ///
    /// # Errors
    /// One line, which a note says, too: there is no file any more, or it cannot be read. The scene stays.
    pub(crate) fn reload(&mut self, ctx: &egui::Context) -> Result<(), String> {
        let read = match &self.given {
            None => Err("the scene is of no file: `Save scene as...` makes one".to_owned()),
            Some(name) if name != scene::DEFAULT && !Path::new(name).exists() => {
                Err(format!("{name} is gone: the scene goes on as it was read; `Save scene as...` writes it again"))
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

    /// Goes to the usual view if the scene has no such camera or path any more.
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

    /// Takes note that the scene was saved into a file, as it is: that is its file from now on.
    pub(crate) fn saved_as(&mut self, file: &Path) {
        self.original = self.settings.scene.clone();
        // A file whose name is no text cannot be opened by it, or kept.
        let Some(name) = file.to_str().map(kept::scene_name).filter(|name| self.given.as_ref() != Some(name)) else { return };
        self.materials.opened(&name);
        self.scenes.opened(&name);
        self.given = Some(name);
        self.keep_now();
    }

    /// What the scene was opened from, as [`scene::load`] takes it; `None` = from no file.
    pub fn given(&self) -> Option<&str> {
        self.given.as_deref()
    }

    /// What somebody should know, until it is dismissed; the newest last.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Whether it is not known yet whether the scene that was opened can be loaded.
    pub fn is_opening(&self) -> bool {
        self.before.is_some()
    }

    /// Whether materials, rules or strokes would be lost with another scene: numbers are kept.
    fn has_unsaved_edits(&self) -> bool {
        let (now, file) = (&self.settings.scene, &self.original);
        now.materials != file.materials || now.rules != file.rules || now.strokes != file.strokes
    }

    /// Takes up what is kept of the scene that is open; returns a line for everything that is not possible any more.
    pub(super) fn take_up(&mut self) -> Vec<String> {
        let Some((keeper, name)) = self.keeping.as_ref().zip(self.given.as_ref()) else { return Vec::new() };
        self.places.all = keeper.kept().places(name);
        keeper.kept().apply_numbers(name, &mut self.settings.scene)
    }

    /// Puts a scene in the place of the one that is open.
    fn take_over(&mut self, name: String, scene: Scene) {
        self.brush.finish();
        self.places.stop();
        // Of a scene that may not be one nothing is kept.
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
            // It is of the scene before.
            self.compare = Compare::default();
        }
        self.materials.opened(&name);
        self.scenes.opened(&name);
        self.given = Some(name);
        let said = self.take_up();
        self.notes.extend(said);
        self.opened = NEXT.fetch_add(1, Ordering::Relaxed);
    }

    /// Puts away what belongs to the scene that is open, unless it is itself one that may have to be left again.
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

    /// Takes note of whether the scene that was opened could be loaded, and goes back to the one before if not.
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

    /// Adds a note, once.
    pub(crate) fn say(&mut self, note: String) {
        if !self.notes.contains(&note) {
            self.notes.push(note);
        }
    }
}

//! Places to go back to, and paths to fly again.

use std::path::Path;
use std::sync::Arc;

use eframe::egui::{Button, TextEdit, Ui};

use super::{from_here, outcome};
use crate::app::{Clock, Workbench};
use crate::engine::{Shown, Viewpoint};
use crate::places::{Place, Places, Recorded, Recording};

/// Width of the text fields, points.
const FIELD: f32 = 180.0;

/// The places and paths of the scene, and what is being typed and recorded.
#[derive(Default)]
pub(crate) struct PlacesPanel {
    /// What is kept.
    pub(crate) all: Places,
    recording: Option<Recording>,
    name: String,
    file: String,
    /// What became of the last click, or why it could not be done.
    said: Option<Result<String, String>>,
}

impl PlacesPanel {
    /// Takes note of the picture on screen, if a path is recorded.
    pub(crate) fn watch(&mut self, shown: &Shown) {
        let Some(recording) = &mut self.recording else { return };
        if let Err(end) = recording.see(shown.wish.frame, shown.pose) {
            self.stop();
            self.said = Some(Err(end.to_string()));
        }
    }

    /// Ends the recording and keeps the path.
    pub(crate) fn stop(&mut self) {
        let Some(recording) = self.recording.take() else { return };
        let name = std::mem::take(&mut self.name);
        self.said = Some(recording.finish(&name).map(|path| {
            let frames = path.frames();
            format!("recorded `{}`, {frames} frames", self.all.add(path))
        }));
    }

    /// Reads a path from the file that is typed.
    fn read(&mut self) -> Result<String, String> {
        let path = Recorded::read(self.typed_file()?)?;
        let frames = path.frames();
        Ok(format!("read `{}`, {frames} frames", self.all.add(path)))
    }

    /// Writes a path to the file that is typed.
    fn write(&self, path: &Recorded) -> Result<String, String> {
        let file = self.typed_file()?;
        path.write(file)?;
        Ok(format!("wrote {}", file.display()))
    }

    fn typed_file(&self) -> Result<&Path, String> {
        match self.file.trim() {
            "" => Err("type the name of a .csv file under `Path file` first".to_owned()),
            name => Ok(Path::new(name)),
        }
    }
}

pub(crate) fn show(app: &mut Workbench, ui: &mut Ui) {
    let pose = app.pose();
    ui.horizontal_wrapped(|ui| {
        let label = ui.label("Place name");
        ui.add(TextEdit::singleline(&mut app.places.name).desired_width(FIELD).hint_text("of the next place or path"))
            .labelled_by(label.id);
        if ui.add_enabled(pose.is_some(), Button::new("Keep this place")).clicked()
            && let Some(pose) = pose
        {
            let name = std::mem::take(&mut app.places.name);
            app.places.said = Some(Ok(format!("kept `{}`", app.places.all.keep(&name, pose))));
        }
    });
    for place in app.places.all.places().to_vec() {
        bookmark(app, ui, &place);
    }
    ui.separator();
    record(app, ui);
    for path in app.places.all.paths().to_vec() {
        recorded(app, ui, &path);
    }
    ui.horizontal_wrapped(|ui| {
        let label = ui.label("Path file");
        let field = TextEdit::singleline(&mut app.places.file).desired_width(FIELD).hint_text("path.csv");
        ui.add(field).labelled_by(label.id).on_hover_text(format!("A .csv file. {}", from_here()));
        if ui.button("Read path").on_hover_text("A table with a pose a frame, as `Write ... to a file` makes it").clicked() {
            app.places.said = Some(app.places.read());
        }
    });
    outcome(ui, "path", app.places.said.as_ref());
}

fn bookmark(app: &mut Workbench, ui: &mut Ui, place: &Place) {
    ui.horizontal_wrapped(|ui| {
        let [x, y, z] = place.pose.position.to_array();
        let hint = format!("{x:.1} m east, {y:.1} m north, {z:.1} m high");
        if ui.button(format!("Go to {}", place.name)).on_hover_text(hint).clicked() {
            // A walker would be set down on the ground below.
            app.flight.walking = false;
            app.fly(place.pose);
        }
        if ui.button(format!("Forget {}", place.name)).clicked() {
            app.places.all.forget(&place.name);
        }
    });
}

/// The button that begins and ends a recording.
fn record(app: &mut Workbench, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let Some(frames) = app.places.recording.as_ref().map(Recording::frames) else {
            if ui.button("Record path").on_hover_text("Takes a pose a frame, from frame 0 on, until it is stopped").clicked() {
                app.places.recording = Some(Recording::default());
                app.places.said = None;
                // Where noise and paths begin, too: what is recorded and what is replayed are the same pictures.
                app.clock = Clock { frame: 0, ..app.clock };
            }
            return;
        };
        if ui.button("Stop recording").clicked() {
            app.places.stop();
        }
        ui.label(format!("{frames} frames so far"));
    });
}

fn recorded(app: &mut Workbench, ui: &mut Ui, path: &Recorded) {
    ui.horizontal_wrapped(|ui| {
        let hint = format!("{} frames, over and over, from frame 0", path.frames());
        if ui.button(format!("Replay {}", path.name)).on_hover_text(hint).clicked() {
            app.viewpoint = Viewpoint::Recorded(Arc::new(path.clone()));
            app.clock = Clock { frame: 0, ..app.clock };
        }
        if ui.button(format!("Forget path {}", path.name)).clicked() {
            app.places.all.forget_path(&path.name);
        }
        if ui.button(format!("Write {} to a file", path.name)).on_hover_text("To the file named under `Path file`").clicked() {
            app.places.said = Some(app.places.write(path));
        }
    });
}

//! The panel *Places*: stored places and recorded paths.

use std::sync::Arc;

use eframe::egui::{Button, TextEdit, Ui};

use super::{NO_CAMERA, from_here, outcome};
use crate::model::places::{Place, Recorded, Recording};
use crate::model::state::{Clock, Model};
use crate::model::viewpoint::Viewpoint;

/// Width of the text fields, points.
const FIELD: f32 = 180.0;

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let pose = model.pose();
    ui.horizontal_wrapped(|ui| {
        let label = ui.label("Place name");
        ui.add(TextEdit::singleline(&mut model.places.name).desired_width(FIELD).hint_text("of the next place or path"))
            .labelled_by(label.id);
        let keep = ui.add_enabled(pose.is_some(), Button::new("Keep this place"));
        if keep.on_disabled_hover_text(NO_CAMERA).clicked()
            && let Some(pose) = pose
        {
            let name = std::mem::take(&mut model.places.name);
            model.places.said = Some(Ok(format!("kept `{}`", model.places.all.keep(&name, pose))));
        }
    });
    for place in model.places.all.places().to_vec() {
        bookmark(model, ui, &place);
    }
    ui.separator();
    record(model, ui);
    for path in model.places.all.paths().to_vec() {
        recorded(model, ui, &path);
    }
    ui.horizontal_wrapped(|ui| {
        let label = ui.label("Path file");
        let field = TextEdit::singleline(&mut model.places.file).desired_width(FIELD).hint_text("path.csv");
        ui.add(field).labelled_by(label.id).on_hover_text(format!("Name of a .csv file. {}", from_here()));
        let hint =
            "Reads the file named in `Path file`: a table with one camera pose per frame, as the button `Write NAME to a file` writes it";
        if ui.button("Read path").on_hover_text(hint).clicked() {
            model.places.said = Some(model.places.read());
        }
    });
    outcome(ui, "path", model.places.said.as_ref());
}

fn bookmark(model: &mut Model, ui: &mut Ui, place: &Place) {
    ui.horizontal_wrapped(|ui| {
        let [x, y, z] = place.pose.position.to_array();
        let hint = format!("{x:.1} m east and {y:.1} m north of the centre of the world, elevation {z:.1} m");
        if ui.button(format!("Go to {}", place.name)).on_hover_text(hint).clicked() {
            // Stop walking, because walking would move the camera down to the ground.
            model.flight.walking = false;
            model.fly(place.pose);
        }
        if ui.button(format!("Forget {}", place.name)).clicked() {
            model.places.all.forget(&place.name);
        }
    });
}

/// The button that begins and ends a recording.
fn record(model: &mut Model, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let Some(frames) = model.places.recording.as_ref().map(Recording::frames) else {
            let hint = "Sets time to frame 0 and records the camera pose of each frame until you stop";
            if ui.button("Record path").on_hover_text(hint).clicked() {
                model.places.recording = Some(Recording::default());
                model.places.said = None;
                // Begin at frame 0, because a replay also begins at frame 0. Noise depends on the frame number, so each pose is replayed with the
                // noise of its recording.
                model.clock = Clock { frame: 0, ..model.clock };
            }
            return;
        };
        if ui.button("Stop recording").clicked() {
            model.places.stop();
        }
        ui.label(format!("Frames so far: {frames}"));
    });
}

fn recorded(model: &mut Model, ui: &mut Ui, path: &Recorded) {
    ui.horizontal_wrapped(|ui| {
        let hint = format!("Plays the path again and again, starting at frame 0. Number of frames: {}.", path.frames());
        if ui.button(format!("Replay {}", path.name)).on_hover_text(hint).clicked() {
            model.viewpoint = Viewpoint::Recorded(Arc::new(path.clone()));
            model.clock = Clock { frame: 0, ..model.clock };
        }
        if ui.button(format!("Forget path {}", path.name)).clicked() {
            model.places.all.forget_path(&path.name);
        }
        let hint = "Writes the path to a new file, named in `Path file`: a table with one camera pose per frame";
        if ui.button(format!("Write {} to a file", path.name)).on_hover_text(hint).clicked() {
            model.places.said = Some(model.places.write(path));
        }
    });
}

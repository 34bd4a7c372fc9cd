//! The menu of scenes, and the question about unsaved edits.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use eframe::egui::{self, Button, Ui};
use kernels::scene;

use crate::model::drafts::Waiting;
use crate::model::state::Model;

/// The menu of scenes.
pub(crate) fn menu(model: &mut Model, ui: &mut Ui) {
    let given = model.given().map(str::to_owned);
    let about = match &given {
        Some(name) => format!("Current scene: {name}"),
        None => format!("Current scene: {}, not from a file", model.settings.scene.name),
    };
    let mut wanted = None;
    let menu = ui.menu_button("Scene", |ui| {
        let idle = model.scenes.dialog.is_none();
        let open = ui.add_enabled(idle, Button::new("Open..."));
        let hint = "Opens a dialog to choose the .toml file of a scene. You can also drop a file on the window.";
        if open.on_hover_text(hint).on_disabled_hover_text("The dialog is already open").clicked() {
            let folder = given.as_deref().and_then(|name| Path::new(name).parent()).map(Path::to_owned);
            model.scenes.dialog = Some(choose_file(folder, ui.ctx().clone()));
            ui.close();
        }
        if ui.button("Default scene").on_hover_text("Opens the built-in scene").clicked() {
            wanted = Some(scene::DEFAULT.to_owned());
            ui.close();
        }
        let reload = ui.add_enabled(given.is_some(), Button::new("Reload scene"));
        let hint = "Reads the scene file again, and also the files that it names. Edits are discarded, but undo restores them.";
        if reload.on_hover_text(hint).on_disabled_hover_text("The current scene is not from a file").clicked() {
            // An error is shown as a note.
            let _ = model.reload(ui.ctx());
            ui.close();
        }
        let others = model.scenes.recent.iter().filter(|name| **name != scene::DEFAULT && Some(*name) != given.as_ref());
        let others: Vec<String> = others.cloned().collect();
        if others.is_empty() {
            return;
        }
        ui.separator();
        ui.label("Recent scenes");
        for name in others {
            if ui.button(&name).clicked() {
                wanted = Some(name);
                ui.close();
            }
        }
    });
    menu.response.on_hover_text(about);
    if let Some(name) = wanted {
        open(model, &name);
    }
}

/// Opens a scene. An error is shown as a note. If there are unsaved edits, the window asks first.
fn open(model: &mut Model, name: &str) {
    let _ = model.open(name);
}

/// Opens a scene file that was chosen or dropped.
pub(crate) fn open_file(model: &mut Model, file: &Path) {
    match file.to_str() {
        Some(name) => open(model, name),
        None => model.say(format!("{} cannot be opened, because its name is not valid Unicode: rename the file", file.display())),
    }
}

/// Opens the file that was chosen in the system dialog, once the user has chosen one. Call this whenever the window is drawn.
pub(crate) fn listen(model: &mut Model) {
    let Some(dialog) = model.scenes.dialog.take() else { return };
    match dialog.try_recv() {
        Err(TryRecvError::Empty) => model.scenes.dialog = Some(dialog),
        Ok(Some(file)) => open_file(model, &file),
        Ok(None) | Err(TryRecvError::Disconnected) => {
            model.say("No scene was chosen. You can also drop a file on the window, or name it on the command line.".to_owned());
        }
    }
}

/// Opens the system dialog for files without waiting for it.
fn choose_file(folder: Option<PathBuf>, ctx: egui::Context) -> Receiver<Option<PathBuf>> {
    let (sender, chosen) = channel();
    std::thread::spawn(move || {
        let dialog = rfd::FileDialog::new().set_title("Open a scene").add_filter("Scene", &["toml"]);
        let dialog = match folder.filter(|folder| folder.is_dir()) {
            Some(folder) => dialog.set_directory(folder),
            None => dialog,
        };
        // Sending fails if the program is ending.
        let _ = sender.send(dialog.pick_file());
        ctx.request_repaint();
    });
    chosen
}

/// If an action that would discard unsaved edits is pending, asks the user whether to continue.
pub(crate) fn ask(model: &mut Model, ui: &mut Ui) {
    let Some(waiting) = model.scenes.waits.clone() else { return };
    let (then, yes, hint) = match &waiting {
        Waiting::Open(name) => (
            format!("if {name} can be loaded, they are lost, and undo cannot restore them"),
            "Open without saving",
            "Opens the other scene without saving this one. If the other scene can be loaded, the edits are lost.",
        ),
        Waiting::Close => {
            ("closing the window discards them".to_owned(), "Close without saving", "Closes the window without saving. The edits are lost.")
        }
    };
    egui::Panel::top("unsaved").show(ui, |ui| {
        let text = format!("`{}` has materials, rules or strokes that are not saved in a file: {then}.", model.original.name);
        ui.colored_label(ui.visuals().warn_fg_color, text);
        ui.horizontal_wrapped(|ui| {
            if ui.button(yes).on_hover_text(hint).clicked() {
                match &waiting {
                    // An error is shown as a note.
                    Waiting::Open(name) => drop(model.open_anyway(name)),
                    Waiting::Close => model.close_anyway(ui.ctx()),
                }
            }
            if ui
                .button("Keep this scene")
                .on_hover_text("Keeps the scene and its edits. You can then save it with `Save scene as...` in the panel Materials.")
                .clicked()
            {
                model.scenes.waits = None;
            }
        });
    });
}

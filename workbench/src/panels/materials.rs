//! The panel *Materials*: the materials of the scene, and saving the edited scene as a file.

use std::path::{Path, PathBuf};
use std::sync::mpsc::{TryRecvError, channel};

use eframe::egui::{self, Button, Color32, DragValue, Key, Rgba, Role, Sense, StrokeKind, TextEdit, Ui, WidgetInfo, vec2};
use kernels::materials::procedural::NAMES;

use super::{Number, choose, from_here, number, outcome, reset};
use crate::model::drafts::Dialog;
use crate::model::editing;
use crate::model::state::Model;

/// Width of the text fields, points.
const FIELD: f32 = 170.0;
/// Width and height of a swatch of colour, points.
const SWATCH: f32 = 14.0;
/// Largest value that a scene file accepts for each component of the tint.
const MOST_TINT: f64 = 16.0;

/// The source of the textures of a material.
#[derive(Clone, PartialEq)]
enum Source {
    Procedural(String),
    Folder,
}

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    list(model, ui);
    ui.separator();
    let index = model.materials.selected;
    if index < model.settings.scene.materials.len() {
        egui::Grid::new("material").num_columns(3).show(ui, |ui| {
            name(model, ui, index);
            textures(model, ui, index);
            numbers(model, ui, index);
        });
    }
    if let Some(why) = &model.materials.misnamed {
        ui.colored_label(ui.visuals().error_fg_color, why);
    }
    outcome(ui, "material", model.materials.said.as_ref());
    ui.separator();
    saving(model, ui);
}

/// Applies the folder that was chosen in the system dialog, once the user has chosen one. Call this whenever the window is drawn.
pub(crate) fn listen(model: &mut Model) {
    let Some(dialog) = model.materials.dialog.take() else { return };
    let folder = match dialog.chosen.try_recv() {
        Err(TryRecvError::Empty) => {
            model.materials.dialog = Some(dialog);
            return;
        }
        Ok(Some(folder)) => folder,
        Ok(None) | Err(TryRecvError::Disconnected) => {
            model.materials.said = Some(Ok("No folder was chosen. You can also type one in `Texture folder`.".to_owned()));
            return;
        }
    };
    match model.settings.scene.materials.iter().position(|material| material.name == dialog.material) {
        Some(index) => take_folder(model, index, folder),
        None => model.materials.said = Some(Err(format!("the material `{}` does not exist any more: choose another one", dialog.material))),
    }
}

/// Takes the textures of the selected material from a folder that was dropped on the window.
pub(crate) fn dropped(model: &mut Model, path: &Path) {
    take_folder(model, model.materials.selected, path.to_owned());
}

/// Takes the textures of a material from a folder, and shows the outcome.
fn take_folder(model: &mut Model, index: usize, folder: PathBuf) {
    let Some(name) = model.settings.scene.materials.get(index).map(|material| material.name.clone()) else { return };
    let done = format!("`{name}` now uses the textures in {}.", folder.display());
    model.materials.said = Some(editing::take_folder(&mut model.settings.scene, index, folder).map(|()| done));
}

/// The list of materials, and the buttons for the selected one.
fn list(model: &mut Model, ui: &mut Ui) {
    let shown = model.shown_here().cloned();
    let panel = &mut model.materials;
    let scene = &mut model.settings.scene;
    panel.selected = panel.selected.min(scene.materials.len().saturating_sub(1));
    ui.horizontal_wrapped(|ui| {
        for (i, material) in scene.materials.iter().enumerate() {
            // Swatch and name are not grouped in a horizontal layout, because groups would not continue on the next line.
            swatch(ui, &material.name, shown.as_ref().and_then(|shown| shown.mean_albedo(&material.name)));
            let selected = panel.selected == i;
            let item = ui.selectable_label(selected, &material.name);
            item.widget_info(|| WidgetInfo::selected(Role::Button, true, selected, format!("Material {}", material.name)));
            if item.clicked() {
                (panel.selected, panel.said) = (i, None);
            }
        }
    });
    ui.horizontal_wrapped(|ui| {
        if ui.button("Add material").on_hover_text("Adds a copy of the selected material under a new name").clicked() {
            panel.said = match editing::add_material(scene, panel.selected) {
                Ok(added) => {
                    panel.selected = added;
                    Some(Ok(format!("`{}` is not used yet: give it a rule, or paint with it.", scene.materials[added].name)))
                }
                Err(why) => Some(Err(why)),
            };
        }
        if ui
            .button("Remove material")
            .on_hover_text("Removes the selected material. It must not be the only material, and no rule or stroke may use it.")
            .clicked()
        {
            panel.said = editing::remove_material(scene, panel.selected).err().map(Err);
        }
        let original = &model.original;
        let origin = editing::origin(scene, original, panel.selected);
        let changed = origin.is_some() && scene.materials.get(panel.selected) != origin;
        let reset = ui.add_enabled(changed, Button::new("Reset material"));
        let why = match origin {
            Some(_) => "The material is as it was when the scene was opened or last saved",
            None => "The scene as it was opened or last saved does not have this material",
        };
        if reset
            .on_hover_text("Restores the material as it was when the scene was opened or last saved")
            .on_disabled_hover_text(why)
            .clicked()
        {
            editing::reset_material(scene, original, panel.selected);
            panel.said = None;
        }
    });
}

/// A swatch of the mean colour of a material. It is empty if the colour is not known, because no picture with this material has been drawn yet.
fn swatch(ui: &mut Ui, name: &str, albedo: Option<[f32; 3]>) {
    let (rect, response) = ui.allocate_exact_size(vec2(SWATCH, SWATCH), Sense::hover());
    let Some([r, g, b]) = albedo.map(|albedo| albedo.map(|c| c.clamp(0.0, 1.0))) else {
        ui.painter().rect_stroke(rect, 2.0, ui.visuals().widgets.noninteractive.bg_stroke, StrokeKind::Inside);
        response.on_hover_text(format!("The mean colour of {name} is not known until the next picture is drawn"));
        return;
    };
    ui.painter().rect_filled(rect, 2.0, Color32::from(Rgba::from_rgb(r, g, b)));
    let text = format!("Mean albedo of {name}, tint included, linear red, green, blue: {r:.3}, {g:.3}, {b:.3}");
    response.on_hover_text(text);
}

/// The name of the material. Renaming it also changes the rules and strokes that use it.
fn name(model: &mut Model, ui: &mut Ui, index: usize) {
    let panel = &mut model.materials;
    let present = model.settings.scene.materials[index].name.clone();
    if panel.name[1] != present {
        panel.name = [present.clone(), present.clone()];
        panel.misnamed = None;
    }
    let label = ui.label("Material name");
    let field = ui.add(TextEdit::singleline(&mut panel.name[0]).desired_width(FIELD)).labelled_by(label.id);
    if field
        .on_hover_text(
            "A name that no other material has: 1 to 100 characters, not only spaces. Rules and strokes that use the material get the new name, too.",
        )
        .changed()
    {
        let wanted = panel.name[0].clone();
        panel.misnamed = editing::rename_material(&mut model.settings.scene, index, &wanted).err();
        if panel.misnamed.is_none() {
            if model.brush.material == present {
                model.brush.material.clone_from(&wanted);
            }
            panel.name[1] = wanted;
        }
    }
    ui.end_row();
}

/// The source of the textures of the material.
fn textures(model: &mut Model, ui: &mut Ui, index: usize) {
    let material = &model.settings.scene.materials[index];
    if model.materials.foldered != material.folder {
        model.materials.foldered.clone_from(&material.folder);
        if let Some(folder) = &material.folder {
            model.materials.folder = folder.display().to_string();
        }
    }
    let before = material.procedural.clone().map_or(Source::Folder, Source::Procedural);
    let mut source = before.clone();
    let shown = match &before {
        Source::Procedural(name) => name.clone(),
        Source::Folder => "folder".to_owned(),
    };
    let built_in = NAMES.into_iter().map(|name| (Source::Procedural(name.to_owned()), name.to_owned(), "generated by the program"));
    let all = built_in.chain([(Source::Folder, "folder".to_owned(), "images in the folder named in `Texture folder`")]).collect();
    choose(ui, "Texture source", &mut source, &shown, all).on_hover_text("Generated textures, or images in a folder");
    if source != before {
        match source {
            Source::Procedural(name) => {
                let material = &mut model.settings.scene.materials[index];
                (material.procedural, material.folder) = (Some(name), None);
                model.materials.said = None;
            }
            Source::Folder => take_typed_folder(model, index),
        }
    }
    ui.end_row();

    let label = ui.label("Texture folder");
    let field = ui.add(TextEdit::singleline(&mut model.materials.folder).desired_width(FIELD)).labelled_by(label.id);
    let entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
    field.on_hover_text(
        "Folder with images (.png, .jpg, .tga or .exr) named albedo, normal, height and roughness, or as Poly Haven, ambientCG and Quixel name \
         them. The path is absolute, or relative to the folder of the scene file.",
    );
    ui.end_row();

    ui.label("");
    if ui.button("Use texture folder").on_hover_text("Uses the textures in the folder named in `Texture folder`").clicked() || entered {
        take_typed_folder(model, index);
    }
    ui.end_row();

    ui.label("");
    let idle = model.materials.dialog.is_none();
    let load = ui.add_enabled(idle, Button::new("Load texture folder..."));
    let hint = "Opens a dialog to choose a folder of textures. You can also drop a folder on the window.";
    if load.on_hover_text(hint).on_disabled_hover_text("The dialog is already open").clicked() {
        model.materials.dialog = Some(choose_folder(model.settings.scene.materials[index].name.clone(), ui.ctx().clone()));
    }
    ui.end_row();
}

/// Applies the folder in the text field to a material.
fn take_typed_folder(model: &mut Model, index: usize) {
    let typed = model.materials.folder.trim().to_owned();
    if typed.is_empty() {
        model.materials.said = Some(Err("type the name of a folder under `Texture folder` first, or load one".to_owned()));
    } else {
        take_folder(model, index, PathBuf::from(typed));
    }
}

/// Opens the system dialog for folders without waiting for it.
fn choose_folder(material: String, ctx: egui::Context) -> Dialog {
    let (sender, chosen) = channel();
    let title = format!("Textures of {material}");
    std::thread::spawn(move || {
        let folder = rfd::FileDialog::new().set_title(title).pick_folder();
        // Sending fails if the program is ending.
        let _ = sender.send(folder);
        ctx.request_repaint();
    });
    Dialog { material, chosen }
}

/// The numbers that decide how the textures of the material look on the ground.
fn numbers(model: &mut Model, ui: &mut Ui, index: usize) {
    let usual = editing::origin(&model.settings.scene, &model.original, index).cloned();
    let usual = usual.as_ref();
    let material = &mut model.settings.scene.materials[index];
    let about = "Edge length of one repetition of the texture on the ground.";
    let row = Number { name: "Texture tile", unit: "m", range: [0.1, 1000.0], logarithmic: true, about };
    number(ui, &row, &mut material.tile_m, usual.map(|usual| usual.tile_m));
    let about = "Rotation of the texture on the ground.";
    let row = Number { name: "Texture turn", unit: "deg", range: [-360.0, 360.0], logarithmic: false, about };
    number(ui, &row, &mut material.orientation_deg, usual.map(|usual| usual.orientation_deg));
    let about = "Strength of the normal map. 0 is flat, 1 is unchanged.";
    let row = Number { name: "Normal strength", unit: "x", range: [0.0, 16.0], logarithmic: false, about };
    number(ui, &row, &mut material.normal_strength, usual.map(|usual| usual.normal_strength));
    tint(ui, &mut material.tint, usual.map(|usual| &usual.tint));
}

/// The controls for the tint: a colour picker for values up to 1, and number fields that also accept higher values.
fn tint(ui: &mut Ui, tint: &mut [f64; 3], usual: Option<&[f64; 3]>) {
    let hint = "Factor on the colour of the texture, linear RGB, 0 to 16. The colour mask of the texture decides where the factor applies: fully where \
                the mask is 1.";
    ui.label("Tint").on_hover_text(hint);
    ui.horizontal(|ui| {
        let mut colour = tint.map(|c| c.clamp(0.0, 1.0) as f32);
        let well = ui.color_edit_button_rgb(&mut colour);
        well.widget_info(|| WidgetInfo::labeled(Role::ColorWell, true, "Tint"));
        let about = "Opens a colour picker. It shows factors up to 1, as sRGB values from 0 to 255. The fields beside it show the factors themselves.";
        if well.on_hover_text(about).changed() {
            *tint = colour.map(f64::from);
        }
        for (channel, name) in tint.iter_mut().zip(["Tint red", "Tint green", "Tint blue"]) {
            let drag = DragValue::new(channel).range(0.0..=MOST_TINT).clamp_existing_to_range(false).speed(0.005).max_decimals(3);
            let field = ui.add(drag);
            field.widget_info(|| WidgetInfo::labeled(Role::SpinButton, true, name));
            field.on_hover_text(format!("{name}. {hint}"));
        }
    });
    reset(ui, "Tint", tint, usual);
    ui.end_row();
}

/// The controls for saving the scene as a file.
fn saving(model: &mut Model, ui: &mut Ui) {
    ui.horizontal_wrapped(|ui| {
        let panel = &mut model.materials;
        let label = ui.label("Scene file");
        let field = TextEdit::singleline(&mut panel.file).desired_width(FIELD).hint_text("scene.toml");
        ui.add(field).labelled_by(label.id).on_hover_text(format!("Name of a new .toml file, or of the scene's own file. {}", from_here()));
        ui.checkbox(&mut panel.overwrites, "Overwrite")
            .on_hover_text("Lets `Save scene as...` replace a file of this scene: one from which it was opened, or to which it was saved");
    });
    let hint = "Writes the scene with its materials, rules, strokes and numbers to a file for this program and `experiments`";
    if ui.button("Save scene as...").on_hover_text(hint).clicked() {
        let panel = &model.materials;
        let saved = match panel.file.trim() {
            "" => Err("type the name of a .toml file under `Scene file` first".to_owned()),
            file => editing::save(&model.settings.scene, Path::new(file), &panel.own, panel.overwrites),
        };
        model.materials.saved = Some(saved.map(|file| {
            model.saved_as(&file);
            format!("Saved {}", file.display())
        }));
    }
    outcome(ui, "scene", model.materials.saved.as_ref());
}

//! What is on screen as an experiment, and experiments that run beside the window.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use eframe::egui::{self, Button, DragValue, RichText, TextEdit, Ui};

use super::{from_here, outcome};
use crate::engine::PROGRESS;
use crate::engine::experiment::{self, Extent, Run};
use crate::model::state::Model;

/// Width of a text field, points.
const FIELD: f32 = 220.0;
/// Most frames and seeds offered; a definition may ask for more.
const MOST_FRAMES: u32 = 1000;
const MOST_SEEDS: u32 = 4096;

/// State of the panel.
pub(crate) struct ExperimentsPanel {
    /// Where saved experiments go, a folder each.
    folder: String,
    /// Name of the next one.
    name: String,
    frames: u32,
    seeds: u32,
    /// Where other definitions are: a folder or a file.
    definitions: String,
    /// Where results go.
    out: String,
    /// What came of the last saving, starting or opening: what was done, or what went wrong.
    said: Option<Result<String, String>>,
    listed: Listed,
    run: Option<Run>,
}

impl Default for ExperimentsPanel {
    fn default() -> Self {
        ExperimentsPanel {
            folder: "saved-experiments".to_owned(),
            name: "seen".to_owned(),
            // As the demo: enough to look four frames back, and for a variance.
            frames: 5,
            seeds: 16,
            definitions: experiment::shipped().map(|folder| folder.display().to_string()).unwrap_or_default(),
            out: "out".to_owned(),
            said: None,
            listed: Listed::default(),
            run: None,
        }
    }
}

/// The definitions that were found, and where that was: folders are read when another is named, not with every picture of the window.
#[derive(Default)]
struct Listed {
    places: Option<[String; 2]>,
    found: Vec<Found>,
    /// The drawing of the window that the panel was part of last: what was found may have changed while it was not.
    drawn: u64,
}

/// A definition, and why it cannot be run.
#[derive(Clone)]
struct Found {
    file: PathBuf,
    lacks: Option<String>,
}

impl ExperimentsPanel {
    fn is_running(&self) -> bool {
        self.run.as_ref().is_some_and(|run| !run.is_done())
    }

    /// Notes what came of something that was done.
    fn note(&mut self, outcome: Result<String>) {
        self.said = Some(outcome.map_err(|error| format!("{error:#}").replace('\n', " ")));
    }

    /// Definitions, saved ones first. `drawing`: number of the window's drawing.
    fn found(&mut self, drawing: u64) -> Vec<Found> {
        let places = [self.folder.clone(), self.definitions.clone()];
        let before = std::mem::replace(&mut self.listed.drawn, drawing);
        if self.listed.places.as_ref() != Some(&places) || before + 1 < drawing {
            let files = places.iter().flat_map(|place| experiment::definitions(Path::new(place)));
            self.listed.found = files.map(|file| Found { lacks: experiment::lacks(&file), file }).collect();
            self.listed.places = Some(places);
        }
        self.listed.found.clone()
    }

    fn start(&mut self, definition: &Path, ctx: egui::Context) {
        match Run::start(definition, Path::new(&self.out), move || ctx.request_repaint_after(PROGRESS)) {
            Ok(run) => {
                self.said = None;
                self.run = Some(run);
            }
            Err(error) => self.note(Err(error)),
        }
    }
}

pub(crate) fn show(panel: &mut ExperimentsPanel, model: &Model, ui: &mut Ui) {
    saving(panel, model, ui);
    ui.separator();
    list(panel, ui);
    ui.separator();
    running(panel, ui);
}

fn field(ui: &mut Ui, label: &str, text: &mut String, about: &str) {
    let name = ui.label(label);
    ui.add(TextEdit::singleline(text).desired_width(FIELD)).labelled_by(name.id).on_hover_text(about);
    ui.end_row();
}

fn place(ui: &mut Ui, label: &str, text: &mut String, about: &str) {
    field(ui, label, text, &format!("{about}. {}", from_here()));
}

fn count(ui: &mut Ui, label: &str, value: &mut u32, range: [u32; 2], about: &str) {
    let name = ui.label(label);
    ui.add(DragValue::new(value).range(range[0]..=range[1])).labelled_by(name.id).on_hover_text(about);
    ui.end_row();
}

/// What is on screen becomes a definition.
fn saving(panel: &mut ExperimentsPanel, model: &Model, ui: &mut Ui) {
    egui::Grid::new("saving").num_columns(2).show(ui, |ui| {
        place(ui, "Folder", &mut panel.folder, "Receives a folder for each experiment that is saved");
        field(ui, "Experiment name", &mut panel.name, "Name of its folder and of the .toml file in it: letters a to z, digits, - and _");
        count(
            ui,
            "Frames of the run",
            &mut panel.frames,
            [1, MOST_FRAMES],
            "From frame 0 on; at least 2 for flips and flicker, 5 to look four frames back",
        );
        count(
            ui,
            "Seeds of the run",
            &mut panel.seeds,
            [0, MOST_SEEDS],
            "Bias and variance are taken over them; 0 leaves those out, else at least 2",
        );
    });
    let hint = "Scene with its numbers, view, size, variant, estimator and noise, as `experiments run` and `check` read them";
    if ui.button("Save as experiment").on_hover_text(hint).clicked() {
        let saved = save(panel, model);
        // A folder may have appeared.
        panel.listed.places = None;
        panel.note(saved);
    }
    outcome(ui, "experiment", panel.said.as_ref());
}

fn save(panel: &ExperimentsPanel, model: &Model) -> Result<String> {
    let size = model.shown().context("there is no picture yet: wait for it")?.wish.size;
    ensure!(
        model.culled_from.is_none(),
        "a run draws what its own camera sees, and culling is frozen elsewhere: let go of `Freeze culling`"
    );
    ensure!(
        !model.news.shaders_edited,
        "a run draws with the program's own shaders, and edited ones are on screen: take the edits back, or build with them"
    );
    let extent = Extent { size, frames: panel.frames, seeds: panel.seeds };
    let folder = Path::new(&panel.folder).join(&panel.name);
    let file = experiment::save(&folder, &panel.name, &model.settings, &model.viewpoint, extent)?;
    Ok(format!("Saved {}", file.display()))
}

/// What can be run.
fn list(panel: &mut ExperimentsPanel, ui: &mut Ui) {
    egui::Grid::new("definitions").num_columns(2).show(ui, |ui| {
        place(ui, "Definitions", &mut panel.definitions, "A folder of definitions, or one .toml file");
        place(ui, "Results", &mut panel.out, "Receives a folder for each run");
    });
    let found = panel.found(ui.ctx().cumulative_frame_nr());
    if found.is_empty() {
        ui.label("No definition is there: save one, or name a folder or a .toml file.");
        return;
    }
    let idle = !panel.is_running();
    let mut wanted = None;
    ui.horizontal_wrapped(|ui| {
        for Found { file, lacks } in &found {
            let button = ui.add_enabled(idle && lacks.is_none(), Button::new(format!("Run {}", experiment::name(file))));
            let why = lacks.as_deref().unwrap_or("Another run is under way: wait for it, or cancel it");
            let button = button.on_disabled_hover_text(why);
            if button.on_hover_text(format!("{}; one that was stopped goes on", file.display())).clicked() {
                wanted = Some(file);
            }
        }
    });
    if let Some(file) = wanted {
        panel.start(file, ui.ctx().clone());
    }
}

/// The run under way, or the last one.
fn running(panel: &mut ExperimentsPanel, ui: &mut Ui) {
    let Some(run) = &panel.run else { return };
    let Some(outcome) = run.outcome() else {
        if ui.button("Cancel run").on_hover_text("What is finished is kept; once more to stop at once").clicked() {
            run.cancel();
        }
        // The button stays where it is whatever is said.
        ui.label(format!("{} runs for {} s: {}", run.name(), run.seconds(), run.progress()));
        ui.label("Times are true only while nothing else draws: pause the picture.");
        ui.ctx().request_repaint_after(Duration::from_secs(1));
        return;
    };
    let report = match outcome {
        Ok(report) => report,
        Err(error) => {
            ui.colored_label(ui.visuals().error_fg_color, format!("{}: {error}", run.name()));
            return;
        }
    };
    ui.label(format!("{} is done: {}", run.name(), report.page.display()));
    if ui.button("Open report").on_hover_text("In the browser").clicked() {
        let outcome = experiment::open(&report.page).map(|()| format!("Opened {}", report.page.display()));
        panel.note(outcome);
    }
    // Tables are wider than the panel, and unreadable with their lines broken.
    ui.add(egui::Label::new(RichText::new(report.excerpt).monospace()).extend());
}

//! The panel *Experiments*: saving the current settings as an experiment, and running experiments as separate processes.

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
/// Limits of the number of frames and of the number of seeds that the panel offers; a definition may have more.
const MOST_FRAMES: u32 = 1000;
const MOST_SEEDS: u32 = 4096;

/// State of the panel.
pub(crate) struct ExperimentsPanel {
    /// Folder for saved experiments. Each experiment gets a folder of its own in it.
    folder: String,
    /// Name of the next experiment.
    name: String,
    frames: u32,
    seeds: u32,
    /// Folder of further definitions, or one definition file.
    definitions: String,
    /// Folder for results.
    out: String,
    /// Result or error of the last action (saving, starting, opening).
    said: Option<Result<String, String>>,
    listed: Listed,
    run: Option<Run>,
}

impl Default for ExperimentsPanel {
    fn default() -> Self {
        ExperimentsPanel {
            folder: "saved-experiments".to_owned(),
            name: "seen".to_owned(),
            // The experiment `demo` has these numbers, too. Five frames suffice to compare two frames with a lag of 4, and 16 seeds suffice to
            // compute a variance.
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

/// The definitions that were found, and the places that were searched. Folders are not read each time the window is drawn, but when their names
/// change, when the panel appears, and after saving.
#[derive(Default)]
struct Listed {
    places: Option<[String; 2]>,
    found: Vec<Found>,
    /// Number of the last drawing of the window in which the panel was visible. Files may change while the panel is hidden, so the folders are read
    /// again when the panel appears.
    drawn: u64,
}

/// A definition, and the reason why it cannot be run; `None` = it can be run.
#[derive(Clone)]
struct Found {
    file: PathBuf,
    lacks: Option<String>,
}

impl ExperimentsPanel {
    fn is_running(&self) -> bool {
        self.run.as_ref().is_some_and(|run| !run.is_done())
    }

    /// Stores the outcome of an action, so that it is shown.
    fn note(&mut self, outcome: Result<String>) {
        self.said = Some(outcome.map_err(|error| format!("{error:#}").replace('\n', " ")));
    }

    /// The definitions, saved ones first. `drawing` is the number of the current drawing of the window.
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

/// The controls for saving the current settings as an experiment.
fn saving(panel: &mut ExperimentsPanel, model: &Model, ui: &mut Ui) {
    egui::Grid::new("saving").num_columns(2).show(ui, |ui| {
        place(ui, "Folder", &mut panel.folder, "Folder in which each saved experiment gets a folder of its own");
        field(ui, "Experiment name", &mut panel.name, "Name of the folder and of the .toml file in it: letters without accents, digits, - and _");
        count(
            ui,
            "Frames of the run",
            &mut panel.frames,
            [1, MOST_FRAMES],
            "Number of frames, 1 to 1000, from frame 0 on. Flips and residual flicker need 2 or more. A comparison of frames 4 apart needs 5.",
        );
        count(
            ui,
            "Seeds of the run",
            &mut panel.seeds,
            [0, MOST_SEEDS],
            "Number of random seeds for bias and variance: 2 to 4096, or 0 to measure neither",
        );
    });
    let hint = "Saves scene, view, picture size and settings as an experiment definition, for `experiments run` and `experiments check`";
    if ui.button("Save as experiment").on_hover_text(hint).clicked() {
        let saved = save(panel, model);
        // Read the folders again, because saving may have added a definition.
        panel.listed.places = None;
        panel.note(saved);
    }
    outcome(ui, "experiment", panel.said.as_ref());
}

fn save(panel: &ExperimentsPanel, model: &Model) -> Result<String> {
    let size = model.shown().context("there is no picture yet: wait for it")?.wish.size;
    ensure!(model.culled_from.is_none(), "a run culls for its own camera, but culling is frozen here: switch `Freeze culling` off");
    ensure!(
        !model.news.shaders_edited,
        "a run draws with the program's own shaders, but edited shaders are in use here: revert the edits, or build the programs with them"
    );
    let extent = Extent { size, frames: panel.frames, seeds: panel.seeds };
    let folder = Path::new(&panel.folder).join(&panel.name);
    let file = experiment::save(&folder, &panel.name, &model.settings, &model.viewpoint, extent)?;
    Ok(format!("Saved {}", file.display()))
}

/// The list of definitions, with a button to run each.
fn list(panel: &mut ExperimentsPanel, ui: &mut Ui) {
    egui::Grid::new("definitions").num_columns(2).show(ui, |ui| {
        place(ui, "Definitions", &mut panel.definitions, "A folder of experiment definitions (.toml files), or one such file");
        place(ui, "Results", &mut panel.out, "Folder in which each run gets a folder of its own");
    });
    let found = panel.found(ui.ctx().cumulative_frame_nr());
    if found.is_empty() {
        ui.label("No definitions were found: save one, or name a folder or a .toml file.");
        return;
    }
    let idle = !panel.is_running();
    let mut wanted = None;
    ui.horizontal_wrapped(|ui| {
        for Found { file, lacks } in &found {
            let button = ui.add_enabled(idle && lacks.is_none(), Button::new(format!("Run {}", experiment::name(file))));
            let why = lacks.as_deref().unwrap_or("Another run is in progress: wait until it ends, or cancel it");
            let button = button.on_disabled_hover_text(why);
            let hint = format!(
                "Runs {}. If the folder `Results` has a stopped run of it, that run continues. If it has a finished run, the report is written again.",
                file.display()
            );
            if button.on_hover_text(hint).clicked() {
                wanted = Some(file);
            }
        }
    });
    if let Some(file) = wanted {
        panel.start(file, ui.ctx().clone());
    }
}

/// The current run, or the last one.
fn running(panel: &mut ExperimentsPanel, ui: &mut Ui) {
    let Some(run) = &panel.run else { return };
    let Some(outcome) = run.outcome() else {
        if ui
            .button("Cancel run")
            .on_hover_text(
                "Stops the run and keeps its finished parts. On Linux and macOS, the first click lets the current step finish, and a second click \
                 stops the run at once. On Windows, the first click stops it at once.",
            )
            .clicked()
        {
            run.cancel();
        }
        // The text comes after the button, so that the button does not move when the text changes.
        let progress = run.progress();
        let now = if progress.is_empty() { String::new() } else { format!(": {progress}") };
        ui.label(format!("{} has been running for {} s{now}", run.name(), run.seconds()));
        ui.label("Times are valid only while nothing else draws: pause the picture.");
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
    if ui.button("Open report").on_hover_text("Opens the report in the program that the system uses for web pages").clicked() {
        let outcome = experiment::open(&report.page).map(|()| format!("Opened {}", report.page.display()));
        panel.note(outcome);
    }
    // Do not wrap: tables are wider than the panel, and would be unreadable with wrapped lines.
    ui.add(egui::Label::new(RichText::new(report.excerpt).monospace()).extend());
}

//! The window: panels around a picture. The window sends the requests of the model to the drawing thread, and copies the latest report of the thread
//! into the model.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, KeyboardShortcut, Modifiers, TextureOptions, Ui, WidgetText};
use egui_tiles::{Behavior, SimplificationOptions, TileId, Tree, UiResponse};
use kernels::scene::{self, Scene};
use kernels::variant::Flavour;

use crate::engine::Engine;
use crate::model::flight::Orbit;
use crate::model::panes::{Pane, tree_id};
use crate::model::picture::Wish;
use crate::model::state::Model;
use crate::model::times::Load;
use crate::panels::{self, COMMAND, Panels};

/// The application.
pub struct Workbench {
    engine: Engine,
    /// The state that the panels show and change.
    pub model: Model,
    panels: Panels,
    asked: Option<Wish>,
    last_shown: Option<Instant>,
    /// The scene name in the title of the window.
    titled: String,
}

impl Workbench {
    /// Creates the application for a scene. A thread draws the pictures, and the window shows the newest one. `shaders` is a folder of WGSL files to
    /// draw with and to watch for changes, see [`Engine::start`].
    pub fn new(ctx: &egui::Context, scene: Scene, shaders: Option<PathBuf>) -> Workbench {
        let window = ctx.clone();
        Workbench::drawn_by(Engine::start(shaders, move |within| window.request_repaint_after(within)), scene)
    }

    /// Like [`Workbench::new`], with a drawing thread that already runs and that can wake the window.
    pub fn drawn_by(engine: Engine, scene: Scene) -> Workbench {
        let titled = scene.name.clone();
        Workbench { engine, model: Model::new(scene), panels: Panels::default(), asked: None, last_shown: None, titled }
    }

    /// The drawing thread.
    pub fn engine(&self) -> &Engine {
        &self.engine
    }

    /// Lets the drawing thread compile shaders in advance, see [`Engine::warm`].
    pub fn warm(&self) {
        self.engine.warm();
    }

    /// Copies the latest report of the drawing thread into the model, and a new picture into textures.
    fn listen(&mut self, ctx: &egui::Context) {
        self.model.most_side = ctx.input(|i| u32::try_from(i.max_texture_side).unwrap_or(u32::MAX));
        if !self.model.clock.runs() {
            // While time is paused, the interval between pictures depends on the user, so it is not measured.
            self.last_shown = None;
        }
        let before = self.model.news.shown.take();
        self.model.news = self.engine.news();
        self.model.settle_opening();
        self.model.adapt();
        let Some(shown) = self.model.news.shown.clone() else { return };
        if before.is_some_and(|before| Arc::ptr_eq(&before, &shown)) {
            return;
        }
        let second = shown.second.as_ref();
        let pictures = [Some(&shown.texels), second.map(|s| &s.texels), second.and_then(|s| s.difference.as_ref())];
        for (place, texels) in self.model.textures.iter_mut().zip(pictures) {
            let Some(texels) = texels else {
                *place = None;
                continue;
            };
            let texels: Vec<egui::Color32> = texels.iter().map(|&[r, g, b]| egui::Color32::from_rgb(r, g, b)).collect();
            let image = egui::ColorImage::new(shown.wish.size.map(|n| n as usize), texels);
            match place {
                Some(texture) => texture.set(image, TextureOptions::NEAREST),
                None => *place = Some(ctx.load_texture("viewport", image, TextureOptions::NEAREST)),
            }
        }
        let now = Instant::now();
        let interval = self.last_shown.replace(now).map(|last| now - last);
        self.model.times.add(Load::of(&shown), shown.took, interval, &shown.picture.report.passes);
    }

    /// Requests the picture that the controls describe, unless it cannot be drawn or was the last one to be requested.
    fn ask(&mut self) {
        if !self.model.is_possible() {
            return;
        }
        let wish = self.model.wish();
        if self.asked.as_ref() != Some(&wish) {
            self.asked = Some(wish.clone());
            self.engine.wish(wish);
        }
    }

    /// Keyboard shortcuts, which work while no text field has the focus.
    fn keys(&mut self, ctx: &egui::Context) {
        if ctx.text_edit_focused() {
            return;
        }
        let command = |key| KeyboardShortcut::new(Modifiers::COMMAND, key);
        let redo = KeyboardShortcut::new(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
        if ctx.input_mut(|i| i.consume_shortcut(&redo) || i.consume_shortcut(&command(Key::Y))) {
            self.model.redo();
        }
        if ctx.input_mut(|i| i.consume_shortcut(&command(Key::Z))) {
            self.model.undo();
        }
        let pressed = |key| ctx.input(|i| i.modifiers.is_none() && i.key_pressed(key));
        for (key, flavour) in [Key::Num1, Key::Num2, Key::Num3, Key::Num4, Key::Num5].into_iter().zip(Flavour::ALL) {
            if pressed(key) {
                self.model.settings.toggle(flavour);
            }
        }
        if pressed(Key::Num0) {
            self.model.settings.frame.variant = None;
        }
        if pressed(Key::G) {
            self.model.settings.frame.generic ^= true;
        }
        if pressed(Key::Space) {
            self.model.clock.paused ^= true;
        }
        if pressed(Key::Period) {
            self.model.step();
        }
        if pressed(Key::F) {
            self.model.flight.walking ^= true;
        }
        if pressed(Key::O) {
            self.model.orbit(self.model.flight.orbit == Orbit::Off);
        }
        if pressed(Key::C) {
            self.model.freeze_culling();
        }
        if pressed(Key::X) {
            panels::compare::flick(&mut self.model);
        }
        if pressed(Key::L) {
            self.model.looking.loupe ^= true;
        }
        if pressed(Key::B) {
            self.model.brush.paints ^= true;
        }
    }

    /// Handles files and folders dropped on the window. A scene is opened. Anything else is taken as a texture folder for the selected material.
    fn dropped(&mut self, ctx: &egui::Context) {
        let paths: Vec<PathBuf> = ctx.input(|i| i.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        for path in paths {
            let is_scene = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
            if is_scene || path.join(scene::FILE).is_file() {
                panels::scenes::open_file(&mut self.model, &path);
            } else {
                panels::materials::dropped(&mut self.model, &path);
            }
        }
    }

    /// The bar at the top of the window: scenes, undo, time, and the controls that [`panels::viewport::viewpoints`] shows.
    fn bar(&mut self, ui: &mut Ui) {
        ui.horizontal_wrapped(|ui| {
            panels::scenes::menu(&mut self.model, ui);
            if ui
                .add_enabled(self.model.can_undo(), egui::Button::new("Undo"))
                .on_hover_text(format!("{COMMAND}+Z"))
                .on_disabled_hover_text("There is nothing to undo")
                .clicked()
            {
                self.model.undo();
            }
            if ui
                .add_enabled(self.model.can_redo(), egui::Button::new("Redo"))
                .on_hover_text(format!("{COMMAND}+Shift+Z or {COMMAND}+Y"))
                .on_disabled_hover_text("There is nothing to redo")
                .clicked()
            {
                self.model.redo();
            }
            ui.separator();
            let label = if self.model.clock.paused { "Run" } else { "Pause" };
            if ui.button(label).on_hover_text("Lets time run, or pauses it. Key: Space.").clicked() {
                self.model.clock.paused ^= true;
            }
            if ui.button("Step").on_hover_text("Pauses time. If it is already paused, shows the next frame. Key: full stop.").clicked() {
                self.model.step();
            }
            ui.label(format!("frame {}", self.model.clock.frame)).on_hover_text(
                "Number of the frame. Camera paths, and noise that changes over time, depend on this number and not on a clock.",
            );
            ui.separator();
            panels::viewport::viewpoints(&mut self.model, ui);
        });
    }

    /// The status line at the bottom of the window: errors, progress, and the adapter.
    fn status(&self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            if let Some(failure) = self.model.failure() {
                ui.colored_label(ui.visuals().error_fg_color, failure);
            } else if let Some(error) = self.model.shader_error() {
                ui.colored_label(ui.visuals().error_fg_color, error)
                    .on_hover_text("The shader files in their present state are not in use. To try them again, correct and save them.");
            } else if let Some(progress) = &self.model.news.progress {
                match (progress.done, progress.total) {
                    (0, 0) => drop(ui.label(format!("{} ...", progress.stage))),
                    (done, 0) => drop(ui.label(format!("{}: {done} ...", progress.stage))),
                    (done, all) => progress_bar(ui, &progress.stage, [done, all]),
                }
            } else if !self.model.is_warm() && self.model.news.warm[1] > 0 {
                progress_bar(ui, "shaders", self.model.news.warm.map(|count| count as u64));
            } else {
                ui.label("ready");
            }
            if let Some(adapter) = &self.model.news.adapter {
                ui.separator();
                let kind = if adapter.software { ", a software adapter: only ratios of times are meaningful" } else { "" };
                ui.label(format!("{}{kind}", adapter.name));
                if let Some(why) = adapter.without_anisotropy {
                    ui.label("anisotropy 1").on_hover_text(why);
                }
            }
            if let Some(failure) = self.model.keeping_failure() {
                ui.separator();
                ui.colored_label(ui.visuals().error_fg_color, failure);
            }
        });
    }
}

/// Switches animations off. Animations would repaint the window again and again, and distort the measured times of pictures.
pub fn still(ctx: &egui::Context) {
    ctx.all_styles_mut(|style| {
        style.animation_time = 0.0;
        style.scroll_animation = egui::style::ScrollAnimation::none();
    });
}

/// A progress bar. It has no spinner, because a spinner repaints the window without a pause, see [`PROGRESS`](crate::engine::PROGRESS).
fn progress_bar(ui: &mut Ui, stage: &str, [done, all]: [u64; 2]) {
    ui.add(egui::ProgressBar::new(done as f32 / all as f32).desired_width(160.0).text(format!("{stage}: {done} of {all}")));
}

/// Draws the panes of the tree.
struct Panes<'a> {
    model: &'a mut Model,
    panels: &'a mut Panels,
}

impl Behavior<Pane> for Panes<'_> {
    fn pane_ui(&mut self, ui: &mut Ui, _: TileId, pane: &mut Pane) -> UiResponse {
        self.panels.show(*pane, self.model, ui);
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &Pane) -> WidgetText {
        pane.name().into()
    }

    fn simplification_options(&self) -> SimplificationOptions {
        SimplificationOptions { all_panes_must_have_tabs: true, ..Default::default() }
    }
}

impl eframe::App for Workbench {
    fn clear_color(&self, _visuals: &egui::Visuals) -> [f32; 4] {
        [0.0, 0.0, 0.0, 1.0]
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        if let Some(seconds) = frame.info().cpu_usage {
            self.model.window_took(Duration::from_secs_f32(seconds.max(0.0)));
        }
        self.listen(&ctx);
        panels::materials::listen(&mut self.model);
        panels::scenes::listen(&mut self.model);
        self.dropped(&ctx);
        self.model.watch_closing(&ctx);
        self.model.seek();
        if let Some(shown) = self.model.shown_here().cloned() {
            self.model.places.watch(&shown);
        }
        self.keys(&ctx);
        self.model.tick();
        egui::Panel::top("bar").show(ui, |ui| self.bar(ui));
        if !self.model.notes.is_empty() {
            egui::Panel::top("notes").show(ui, |ui| {
                for note in &self.model.notes {
                    ui.colored_label(ui.visuals().warn_fg_color, note);
                }
                if ui.button("Dismiss").clicked() {
                    self.model.notes.clear();
                }
            });
        }
        panels::scenes::ask(&mut self.model, ui);
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        egui::CentralPanel::no_frame().show(ui, |ui| {
            let mut tree = std::mem::replace(&mut self.model.tree, Tree::empty(tree_id()));
            tree.ui(&mut Panes { model: &mut self.model, panels: &mut self.panels }, ui);
            self.model.tree = tree;
        });
        self.ask();
        self.model.watch_changes(&ctx);
        self.model.keep(&ctx);
        if self.titled != self.model.original.name {
            self.titled.clone_from(&self.model.original.name);
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(format!("Scree - {}", self.titled)));
        }
    }

    fn on_exit(&mut self) {
        // Do not save the state of a scene that has not loaded.
        if !self.model.is_opening() {
            self.model.keep_now();
        }
        if let Some(error) = self.model.keeping_failure() {
            // The window is closed, so the error cannot be shown in it.
            eprintln!("error: {error}");
        }
    }
}

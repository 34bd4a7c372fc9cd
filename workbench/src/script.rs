//! The application with an invisible window: carries out the steps of a script, then draws a picture of the window. It serves documentation, tests,
//! and machines without a display.
//!
//! A script controls time. No time passes while a step waits for its picture, because the wait depends on the machine. This applies to the frame
//! number, which only the step `frames` and the controls that advance by one frame increase. It also applies to the time of the window. From this
//! time, the undo history decides whether two changes are undone together. So the frame number and the undo history depend on the steps alone.
//! Measured times still differ from run to run.

use std::path::{Path, PathBuf};
use std::str::FromStr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow, bail, ensure};
use eframe::egui::{self, Key, Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use kernels::base::names::suggestion;
use kernels::scene::{self, Scene};

use crate::engine::Engine;
use crate::model::panes::Pane;
use crate::model::state::Model;
use crate::window::{Workbench, still};

/// Longest wait for a picture or another event.
const PATIENCE: Duration = Duration::from_secs(300);
/// Pause between two drawings of the window while a step waits.
const NAP: Duration = Duration::from_millis(5);
/// Number of drawings of the window in which a turn of the wheel takes full effect. egui spreads the turn over several drawings.
const SPREAD: usize = 60;
/// Number of drawings of the window before a step. Each drawing takes a quarter of a second of the window's time, so all of them take more than a
/// second. After a second without changes, the undo history treats the next change as separate. Each step is therefore undone by itself.
const PAUSE: usize = 5;

/// One step of a script.
#[derive(Clone, Debug, PartialEq)]
pub enum Step {
    /// Clicks the control with this name.
    Click(String),
    /// Presses a key.
    Key(Key),
    /// Sets the control with this name to a number.
    Set(String, f64),
    /// Enters a text into the field with this name.
    Type(String, String),
    /// Opens a scene: a file, a folder, or `default`.
    Open(String),
    /// Lets time run for this many frames, and waits for the picture of the last one.
    Frames(u32),
    /// Compiles shaders in advance, see [`Engine::warm`], and waits until they are compiled.
    Warm,
}

impl FromStr for Step {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Step> {
        let text = text.trim();
        let (word, rest) = text.split_once(' ').map_or((text, ""), |(word, rest)| (word, rest.trim()));
        match (word, rest) {
            ("click", name) if !name.is_empty() => Ok(Step::Click(name.to_owned())),
            ("key", name) => {
                Key::from_name(name).map(Step::Key).ok_or_else(|| anyhow!("`{name}` is not a key: give a name such as Space, W or 1"))
            }
            ("set", both) => {
                let (name, value) = both.rsplit_once('=').with_context(|| format!("`{text}`: write `set NAME = VALUE`"))?;
                let value = value.trim();
                Ok(Step::Set(name.trim().to_owned(), value.parse().with_context(|| format!("`{value}` is not a number"))?))
            }
            ("type", both) => {
                let (name, value) = both.split_once('=').with_context(|| format!("`{text}`: write `type NAME = TEXT`"))?;
                Ok(Step::Type(name.trim().to_owned(), value.trim().to_owned()))
            }
            ("open", given) if !given.is_empty() => Ok(Step::Open(given.to_owned())),
            ("frames", count) => Ok(Step::Frames(count.parse().with_context(|| format!("`{count}` is not a number of frames"))?)),
            ("warm", "") => Ok(Step::Warm),
            _ => {
                bail!(
                    "`{text}` is not a step: give `click NAME`, `key KEY`, `set NAME = VALUE`, `type NAME = TEXT`, `open FILE`, `frames N` or `warm`, with `;` between steps"
                )
            }
        }
    }
}

/// Parses the steps in a text, which are separated by `;` or line breaks.
///
/// # Errors
/// A part of the text is not a step.
pub fn steps(text: &str) -> Result<Vec<Step>> {
    text.split([';', '\n']).map(str::trim).filter(|step| !step.is_empty()).map(str::parse).collect()
}

/// Limit of the side of a texture, pixels. Windows of eframe usually have the same limit.
const MOST_SIDE: usize = 8192;

/// The application with an invisible window.
pub struct Stage {
    harness: Harness<'static, Workbench>,
}

impl Stage {
    /// Creates an invisible window of this size in points. It may use a drawing thread that served an earlier window, see [`Engine::shared`].
    pub fn new(scene: Scene, size: [u32; 2]) -> Stage {
        Stage::prepared(scene, size, |_| {})
    }

    /// Like [`Stage::new`]; `prepare` changes the application before the first picture is requested. This avoids drawing a picture that is not
    /// needed.
    pub fn prepared(scene: Scene, size: [u32; 2], prepare: impl FnOnce(&mut Workbench)) -> Stage {
        Stage::showing(size, |ctx| {
            let wake = ctx.clone();
            let mut app = Workbench::drawn_by(Engine::shared(&scene, move |_| wake.request_repaint()), scene);
            prepare(&mut app);
            app
        })
    }

    /// Like [`Stage::prepared`], but always starts a new drawing thread. If `shaders` is given, the thread draws with the WGSL files in that folder
    /// and reloads them when they change.
    pub fn with_shaders(scene: Scene, size: [u32; 2], shaders: Option<PathBuf>, prepare: impl FnOnce(&mut Workbench)) -> Stage {
        Stage::showing(size, |ctx| {
            let mut app = Workbench::new(ctx, scene, shaders);
            prepare(&mut app);
            app
        })
    }

    fn showing(size: [u32; 2], app: impl FnOnce(&egui::Context) -> Workbench) -> Stage {
        let size = size.map(|n| n as f32);
        let harness = Harness::builder()
            .with_size(egui::vec2(size[0], size[1]))
            .with_theme(egui::Theme::Dark)
            // As in a real window, a character that the fonts lack is drawn as a box and is not an error.
            .allow_missing_glyphs()
            .wgpu()
            .build_eframe(|cc| {
                // Without animations, a control does not move between the drawing in which its position was found and the click on that position.
                still(&cc.egui_ctx);
                let mut app = app(&cc.egui_ctx);
                app.model.clock.left = Some(0);
                app
            });
        let mut stage = Stage { harness };
        stage.harness.input_mut().max_texture_side = Some(MOST_SIDE);
        stage
    }

    /// How long the window waits before it is painted again if nothing happens.
    pub fn rests_for(&self) -> Duration {
        let outputs = &self.harness.output().viewport_output;
        outputs.values().map(|output| output.repaint_delay).min().unwrap_or(Duration::MAX)
    }

    /// The application.
    pub fn app(&mut self) -> &mut Workbench {
        self.harness.state_mut()
    }

    /// The state that the panels show and change.
    pub fn model(&mut self) -> &mut Model {
        &mut self.harness.state_mut().model
    }

    /// Requests that the window close, as the close button in its frame does. Returns whether it closes.
    pub fn close(&mut self) -> bool {
        let root = self.harness.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default();
        root.events.push(egui::ViewportEvent::Close);
        self.harness.step();
        let output = &self.harness.output().viewport_output;
        !output.values().any(|output| output.commands.contains(&egui::ViewportCommand::CancelClose))
    }

    /// Draws the window until `done` returns true. Meanwhile, the time of the window does not advance. `what` names the expected event in errors.
    ///
    /// # Errors
    /// The picture that the controls describe cannot be drawn (see [`Model::failure`]), or the event does not occur in time (300 s).
    pub fn until(&mut self, what: &str, done: impl Fn(&Model) -> bool) -> Result<()> {
        let now = self.harness.ctx.input(|i| i.time);
        self.harness.input_mut().time = Some(now);
        let outcome = self.draw_until(what, done);
        self.harness.input_mut().time = None;
        outcome
    }

    fn draw_until(&mut self, what: &str, done: impl Fn(&Model) -> bool) -> Result<()> {
        let began = Instant::now();
        loop {
            self.harness.step();
            let model = &self.harness.state().model;
            if done(model) {
                return Ok(());
            }
            if let Some(failure) = model.failure() {
                bail!("{failure}");
            }
            if began.elapsed() > PATIENCE {
                bail!("timed out after {} s of waiting for {what}", PATIENCE.as_secs());
            }
            std::thread::sleep(NAP);
        }
    }

    /// Waits for the picture that the controls describe.
    ///
    /// # Errors
    /// The window is too small for a picture. See also [`Stage::until`].
    pub fn settle(&mut self) -> Result<()> {
        // The window requests a picture only when it is drawn. Draw it once, so that a change that was just made is requested.
        self.harness.step();
        ensure!(self.harness.state().model.has_room(), "the window is too small for a picture: make it larger with --size");
        self.until("the picture", Model::is_settled)
    }

    /// Returns the accessible names of all elements on screen that have one, in alphabetical order and without duplicates.
    pub fn names(&self) -> Vec<String> {
        let mut names: Vec<String> = self
            .harness
            .root()
            .children_recursive()
            .filter_map(|node| node.accesskit_node().label().or(node.accesskit_node().value()))
            .collect();
        names.sort();
        names.dedup();
        names
    }

    /// Describes each element on screen as a screen reader does: its role, name, value and state.
    pub fn described(&self) -> Vec<String> {
        let nodes = self.harness.root().children_recursive();
        nodes
            .map(|node| {
                let node = node.accesskit_node();
                let values = (node.label(), node.value(), node.numeric_value(), node.toggled());
                format!("{:?} {values:?} {}", node.role(), if node.is_disabled() { "disabled" } else { "enabled" })
            })
            .collect()
    }

    /// Returns the role and the name of each control on screen that a click operates and that is not disabled.
    pub fn clickable(&self) -> Vec<(Role, String)> {
        let is_clicked = |role| matches!(role, Role::Button | Role::CheckBox | Role::RadioButton | Role::ComboBox | Role::Link);
        let nodes = self.harness.root().children_recursive();
        nodes
            .filter_map(|node| {
                let node = node.accesskit_node();
                let name = node.label().or(node.value())?;
                (is_clicked(node.role()) && !node.is_disabled()).then(|| (node.role(), name))
            })
            .collect()
    }

    /// Whether an element with this name is on screen.
    pub fn has(&self, name: &str) -> bool {
        self.harness.query_all_by_label(name).next().is_some()
    }

    /// Holds a key down for this many drawings of the window, then waits for the picture.
    ///
    /// # Errors
    /// See [`Stage::settle`].
    pub fn hold(&mut self, key: Key, drawings: u32) -> Result<()> {
        self.harness.key_down(key);
        for _ in 0..drawings {
            self.harness.step();
        }
        self.harness.key_up(key);
        self.settle()
    }

    /// Drags the picture by this many points, to the right and down, and waits for the resulting picture.
    ///
    /// # Errors
    /// The viewport is not on screen. See also [`Stage::settle`].
    pub fn drag(&mut self, by: [f32; 2]) -> Result<()> {
        self.drag_with(egui::Modifiers::NONE, by)
    }

    /// Like [`Stage::drag`], with modifier keys held.
    ///
    /// # Errors
    /// See [`Stage::drag`].
    pub fn drag_with(&mut self, held: egui::Modifiers, by: [f32; 2]) -> Result<()> {
        let Some(node) = self.find("Picture") else { return Err(self.missing("Picture")) };
        let from = node.rect().center();
        self.harness.event(egui::Event::ModifiersChanged(held));
        self.harness.hover_at(from);
        self.harness.step();
        self.harness.drag_at(from);
        self.harness.step();
        let to = from + egui::vec2(by[0], by[1]);
        self.harness.hover_at(to);
        self.harness.step();
        self.harness.drop_at(to);
        self.harness.event(egui::Event::ModifiersChanged(egui::Modifiers::NONE));
        self.settle()
    }

    /// Finds the control with this name. The label that gives the control its name is skipped.
    fn find<'a>(&'a self, name: &'a str) -> Option<egui_kittest::Node<'a>> {
        self.harness.query_all_by_label(name).find(|node| node.accesskit_node().role() != Role::Label)
    }

    fn missing(&self, name: &str) -> anyhow::Error {
        let names = self.names();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        anyhow!("nothing on screen is called `{name}`: {}", suggestion(name, &names))
    }

    /// Opens a scene and waits until it is loaded.
    fn open(&mut self, given: &str) -> Result<()> {
        let model = self.model();
        model.open(given).map_err(|why| anyhow!(why))?;
        let name = model.given().map(str::to_owned);
        self.until("the scene", |model| !model.is_opening())?;
        let model = &self.harness.state().model;
        let why = || model.notes().last().cloned().unwrap_or_default();
        ensure!(model.given() == name.as_deref(), "{}", why());
        Ok(())
    }

    /// Drops a file or folder on the window and waits for the resulting picture.
    ///
    /// # Errors
    /// See [`Stage::settle`].
    pub fn drop_file(&mut self, path: &Path) -> Result<()> {
        self.harness.input_mut().dropped_files.push(Arc::new(Dropped(path.to_owned())));
        self.harness.step();
        self.until("the scene", |model| !model.is_opening())?;
        self.settle()
    }

    /// Turns the mouse wheel by this many points, with the pointer over the picture. Positive is upwards.
    ///
    /// # Errors
    /// The viewport is not on screen. See also [`Stage::settle`].
    pub fn scroll(&mut self, points: f32) -> Result<()> {
        let Some(node) = self.find("Picture") else { return Err(self.missing("Picture")) };
        let at = node.rect().center();
        self.harness.hover_at(at);
        self.harness.step();
        self.harness.event(egui::Event::MouseWheel {
            unit: egui::MouseWheelUnit::Point,
            delta: egui::vec2(0.0, points),
            phase: egui::TouchPhase::Move,
            source: egui::MouseWheelSource::Unknown,
            modifiers: egui::Modifiers::NONE,
        });
        // egui spreads the turn over several drawings of the window.
        self.harness.run_steps(SPREAD);
        self.settle()
    }

    /// Carries out a step and waits for the resulting picture.
    ///
    /// # Errors
    /// Nothing on screen has the name, the scene cannot be opened, or [`Step::Frames`] is given while time is paused. See also [`Stage::settle`].
    pub fn take(&mut self, step: &Step) -> Result<()> {
        self.harness.run_steps(PAUSE);
        match step {
            Step::Click(name) => {
                // Scroll the control into view first, because a control out of view cannot be clicked.
                self.find(name).ok_or_else(|| self.missing(name))?.scroll_to_me();
                self.harness.run_steps(5);
                self.find(name).ok_or_else(|| self.missing(name))?.click();
            }
            Step::Key(key) => self.harness.key_press(*key),
            Step::Set(name, value) => {
                let Some(node) = self.find(name) else { return Err(self.missing(name)) };
                node.set_value_accesskit(*value);
            }
            Step::Type(name, text) => {
                let Some(node) = self.find(name) else { return Err(self.missing(name)) };
                node.set_text_value_accesskit(text);
            }
            Step::Open(given) => self.open(given)?,
            Step::Frames(_) if self.harness.state().model.clock.paused => {
                bail!("time stands still, so no further frame is drawn: let it run with `key Space`")
            }
            Step::Frames(count) => {
                self.model().clock.left = Some(*count);
                return self.until("the frame", |model| !model.clock.runs() && model.is_settled());
            }
            Step::Warm => {
                self.harness.state().warm();
                return self.until("the last shader", Model::is_warm);
            }
        }
        self.settle()
    }

    /// Writes a picture of the window as a PNG. The file is either complete or not written at all.
    ///
    /// # Errors
    /// The window cannot be drawn, or the file cannot be written.
    pub fn screenshot(&mut self, file: &Path) -> Result<()> {
        let (size, texels) = self.window()?;
        kernels::frame::export::write_png_texels(file, size, &texels)?;
        Ok(())
    }

    /// Draws the window. Returns its size in pixels, and its texels in sRGB, row by row.
    fn window(&mut self) -> Result<([u32; 2], Vec<[u8; 3]>)> {
        let image = self.harness.render().map_err(|what| anyhow!("the window cannot be drawn: {what}"))?;
        Ok(([image.width(), image.height()], image.pixels().map(|p| [p[0], p[1], p[2]]).collect()))
    }

    /// Draws the window like [`Stage::screenshot`], and cuts out the panel with this name. Returns the size of the panel in pixels, and its texels.
    ///
    /// # Errors
    /// No panel has this name, another panel is in front of it, or the window cannot be drawn.
    pub fn pane(&mut self, name: &str) -> Result<([u32; 2], Vec<[u8; 3]>)> {
        let pane = Pane::ALL.into_iter().find(|pane| pane.name() == name).with_context(|| format!("no panel is called `{name}`"))?;
        let place = self.model().place_of(pane).with_context(|| format!("`{name}` is behind another panel: click its tab first"))?;
        let ([width, height], texels) = self.window()?;
        // In this window, one point is one pixel.
        let [left, top] = [place.left(), place.top()].map(|x| x.round().max(0.0) as u32);
        let [right, bottom] = [(place.right(), width), (place.bottom(), height)].map(|(x, most)| (x.round().max(0.0) as u32).min(most));
        let row = |y: u32| &texels[(y * width + left) as usize..(y * width + right) as usize];
        Ok(([right - left, bottom - top], (top..bottom).flat_map(row).copied().collect()))
    }
}

/// A file or folder that is dropped on the window.
#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

/// Opens a scene (`given` is the argument of [`scene::load`]), carries out the steps, and writes a picture of the window.
///
/// # Errors
/// The scene cannot be read. See also [`Stage::take`] and [`Stage::screenshot`].
pub fn run(given: &str, size: [u32; 2], shaders: Option<PathBuf>, steps: &[Step], file: &Path) -> Result<()> {
    let mut stage = Stage::with_shaders(scene::load(given)?, size, shaders, |app| app.model.come_from(given));
    stage.settle()?;
    for step in steps {
        stage.take(step)?;
    }
    stage.screenshot(file)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_read_and_what_is_none_is_refused() {
        let expected = vec![
            Step::Click("Variant splat".to_owned()),
            Step::Key(Key::Space),
            Step::Set("Noise cell".to_owned(), 2.0),
            Step::Type("Folder".to_owned(), "a b".to_owned()),
            Step::Open("a b.toml".to_owned()),
            Step::Frames(3),
            Step::Warm,
        ];
        assert_eq!(
            steps("click Variant splat; key Space;\nset Noise cell = 2; type Folder = a b; open a b.toml; frames 3; warm;").expect("steps"),
            expected
        );
        for (text, part) in [
            ("clack x", "is not a step"),
            ("click", "is not a step"),
            ("open", "is not a step"),
            ("key Nonsense", "is not a key"),
            ("frames -1", "not a number"),
            ("set a", "NAME = VALUE"),
            ("type a", "NAME = TEXT"),
            ("set a = b", "is not a number"),
        ] {
            let error = steps(text).expect_err(text);
            assert!(format!("{error:#}").contains(part), "{text}: {error:#}");
        }
    }
}

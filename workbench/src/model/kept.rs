//! The state that is saved from one start to the next: the names of recent scenes, the arrangement of the panes, the settings of the frame and the
//! display, and for each scene its changed numbers, its places and its paths. The state is stored in a TOML file of the user ([`place`]), which can
//! be read and edited by hand. The workbench also starts without this file.
//!
//! The file is written completely or not at all. A file that is not a saved state of this program is not overwritten. If a file cannot be parsed at
//! the start, it is renamed, if that is possible. A file of a newer version of the program is not changed.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use eframe::egui;
use egui_tiles::Tree;
use kernels::base::document;
use kernels::base::error::one_line;
use kernels::base::files::{FolderKind, folder_of_user};
use kernels::scene::{self, Scene};
use kernels::settings::Field as _;
use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use toml::Value;

use super::files;
use super::panes::{Layout, Pane};
use super::places::{Place, Places, Recorded};
use super::settings::{Settings, differences, kept_names, numbers};

/// Version of the file format. It is raised when a key is added or changes its meaning. An older program does not change a file of a newer version.
pub const VERSION: u32 = 4;
/// Maximum number of scenes in the list of recent ones.
pub const MOST_RECENT: usize = 10;
/// Time between two checks whether the state has changed.
pub const EVERY: Duration = Duration::from_secs(3);
/// The settings whose defaults depend on the adapter: the render scale and the vertex stride.
const OF_ADAPTER: [&str; 2] = ["scale", "vertex_stride"];

/// The saved state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Kept {
    version: u32,
    /// The [`scene_name`] of each recent scene, the newest first, at most [`MOST_RECENT`].
    #[serde(default)]
    recent: Vec<String>,
    #[serde(default)]
    look: Look,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layout: Option<Layout>,
    /// The state that belongs to one scene, by the [`scene_name`] of the scene.
    #[serde(default, rename = "scene", skip_serializing_if = "BTreeMap::is_empty")]
    scenes: BTreeMap<String, OfScene>,
}

/// The saved settings of the frame and of the display, by their names ([`Settings::kept`]). [`Look::apply`] does not change a setting that is missing
/// here.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
struct Look(BTreeMap<String, Value>);

impl<'de> Deserialize<'de> for Look {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Look, D::Error> {
        let choices = BTreeMap::<String, Value>::deserialize(deserializer)?;
        let known = kept_names();
        let unknown = choices.keys().find(|name| !known.contains(&name.as_str())).cloned();
        match unknown {
            // Use the wording that the TOML reader has for this error: `document::read` adds a suggestion of a similar name to errors with this
            // wording.
            Some(name) => Err(D::Error::custom(format!("unknown field `{name}`, expected one of `{}`", known.join("`, `")))),
            None => Ok(Look(choices)),
        }
    }
}

/// The state that belongs to one scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct OfScene {
    /// The numbers of the scene that differ from its file, by their keys in that file. A number that is equal to the one in the file is not saved, so
    /// that a later edit of the file takes effect.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    numbers: BTreeMap<String, f64>,
    #[serde(rename = "place", skip_serializing_if = "Vec::is_empty")]
    places: Vec<Place>,
    #[serde(rename = "path", skip_serializing_if = "Vec::is_empty")]
    paths: Vec<Recorded>,
}

impl Default for Kept {
    fn default() -> Kept {
        Kept { version: VERSION, recent: Vec::new(), look: Look::default(), layout: None, scenes: BTreeMap::new() }
    }
}

impl Look {
    fn of(settings: &Settings) -> Look {
        Look(settings.kept().map(|(name, value)| (name.to_owned(), value)).collect())
    }

    /// Applies the settings. Returns a line for each value that is refused.
    fn apply(&self, settings: &mut Settings) -> Vec<String> {
        let refused = self.0.iter().filter_map(|(name, value)| settings.take(name, value).err());
        refused.map(|why| left_out(&why)).collect()
    }
}

/// The warning about a saved value that is not applied.
fn left_out(why: &str) -> String {
    format!("a saved value is left out: {}", one_line(why))
}

impl Kept {
    /// Builds the state to save. `before` is the previously saved state; its entries for other scenes are copied into the new state. `scene_name` is
    /// the name of the scene ([`scene_name`]), and `original` is the scene as it is in its file.
    pub fn of(before: &Kept, scene_name: &str, settings: &Settings, original: &Scene, places: &Places, tree: &Tree<Pane>) -> Kept {
        let changed = differences(&settings.scene, original).into_iter().filter(|(_, [now, _])| now.is_finite());
        let numbers = changed.map(|(parameter, [now, _])| (parameter.key.to_owned(), now));
        // Numbers that make the scene invalid would be refused at the next start. Keep the previously saved numbers instead.
        let numbers = match scene::validate(&settings.scene) {
            Ok(()) => numbers.collect(),
            Err(_) => before.scenes.get(scene_name).map(|scene| scene.numbers.clone()).unwrap_or_default(),
        };
        let here = OfScene { numbers, places: places.places().to_vec(), paths: places.paths().to_vec() };
        let mut scenes = before.scenes.clone();
        if here == OfScene::default() {
            scenes.remove(scene_name);
        } else {
            scenes.insert(scene_name.to_owned(), here);
        }
        let others = before.recent.iter().filter(|&name| name != scene_name).cloned();
        let recent = std::iter::once(scene_name.to_owned()).chain(others).take(MOST_RECENT).collect();
        Kept { version: VERSION, recent, look: Look::of(settings), layout: Layout::of(tree), scenes }
    }

    /// Applies the saved settings of the frame and of the display, but no numbers of the scene. Returns a line for each value that is refused; the
    /// setting of such a value is not changed.
    pub fn apply_look(&self, settings: &mut Settings) -> Vec<String> {
        self.look.apply(settings)
    }

    /// Applies the saved numbers of this scene, but no settings of the frame or of the display. Returns a line for each number that cannot be set. If
    /// the remaining numbers together make the scene invalid, none of them is applied, and a further line says why.
    pub fn apply_numbers(&self, scene_name: &str, scene: &mut Scene) -> Vec<String> {
        let mut said = Vec::new();
        let mut changed = scene.clone();
        for (key, &number) in self.scenes.get(scene_name).into_iter().flat_map(|scene| &scene.numbers) {
            let set = match numbers().find(|(setting, _)| setting.key == key) {
                Some((setting, _)) => setting.set(&mut changed, &Value::Float(number)),
                None => Err(format!("no number of a scene is called `{key}`")),
            };
            said.extend(set.err().map(|why| left_out(&why)));
        }
        match scene::validate(&changed) {
            Ok(()) => *scene = changed,
            Err(error) => said.push(format!("the saved numbers are left out, because they make the scene invalid: {error}")),
        }
        said
    }

    /// Replaces the render scale and the vertex stride of this state by those of `before`. Returns the state.
    #[must_use]
    pub fn with_scale_and_stride_of(mut self, before: &Kept) -> Kept {
        for name in OF_ADAPTER {
            self.look.0.remove(name);
            self.look.0.extend(before.look.0.get(name).map(|value| (name.to_owned(), value.clone())));
        }
        self
    }

    /// Removes the render scale from this state if it equals the default `scale`, and the vertex stride if it equals the default `stride`. Returns
    /// the state. For a value that is missing, the next start uses the default for its adapter.
    #[must_use]
    pub fn without_usual(mut self, scale: f64, stride: u32) -> Kept {
        for (name, usual) in OF_ADAPTER.into_iter().zip([scale.value(), stride.value()]) {
            self.look.0.retain(|kept, value| kept != name || *value != usual);
        }
        self
    }

    /// The saved arrangement of panes, with `id` as the identifier of the tree; `None` = the default arrangement.
    pub fn tree(&self, id: egui::Id) -> Option<Tree<Pane>> {
        self.layout.as_ref()?.tree(id)
    }

    /// The places and paths of a scene.
    pub fn places(&self, scene_name: &str) -> Places {
        self.scenes.get(scene_name).map_or_else(Places::default, |scene| Places::new(scene.places.clone(), scene.paths.clone()))
    }

    /// Recent scenes, in the form that [`scene::load`] accepts, the newest first, at most [`MOST_RECENT`].
    pub fn recent(&self) -> &[String] {
        &self.recent
    }

    /// Whether a render scale (first) and a vertex stride (second) are saved. The defaults for the adapter must not replace saved values.
    pub fn has_scale_and_stride(&self) -> [bool; 2] {
        OF_ADAPTER.map(|name| self.look.0.contains_key(name))
    }

    /// Reads the saved state, and returns a line if the user should know about a problem. If there is no file, the state is empty and there is no
    /// line. A file that is damaged or of another kind is renamed to `NAME.damaged` (`NAME.damaged-2`, and so on). If renaming fails, the file stays
    /// where it is. A file of a newer version, or one that cannot be read, is left as it is.
    pub fn load(path: &Path) -> (Kept, Option<String>) {
        let line = match Found::at(path) {
            Found::Nothing => return (Kept::default(), None),
            Found::Kept(kept) => return (*kept, None),
            Found::Refused(Refused::Foreign(what)) => match set_aside(path) {
                Ok(aside) => format!(
                    "{what}; the file is renamed to {}, and defaults are used: to use the file again, correct it and restore its name",
                    aside.display()
                ),
                Err(error) => format!("{what}; the file cannot be renamed ({error}), so nothing is saved: move the file away"),
            },
            Found::Refused(Refused::Newer(version)) => newer(path, version),
            Found::Unreadable(why) => unreadable(path, &why),
        };
        (Kept::default(), Some(line))
    }

    /// Parses the contents of a file of the saved state. `name` names the file in errors.
    ///
    /// # Errors
    /// Why the contents are refused.
    pub fn parse(bytes: Vec<u8>, name: &str) -> Result<Kept, Refused> {
        let Ok(text) = String::from_utf8(bytes) else { return Err(Refused::Foreign(format!("{name} is not UTF-8 text"))) };
        // Check the version first: in a newer version, every other key may have another meaning.
        if let Ok(Versioned { version }) = toml::from_str(&text)
            && version > i64::from(VERSION)
        {
            return Err(Refused::Newer(version));
        }
        match document::read::<Kept>(&text, |_| "") {
            Ok(kept) if (1..=VERSION).contains(&kept.version) => Ok(kept),
            Ok(kept) => Err(Refused::Foreign(format!("{name}: `version` is {}, must be 1 to {VERSION}", kept.version))),
            Err(wrong) => Err(Refused::Foreign(format!("{}: {}", wrong.place(name), wrong.what))),
        }
    }

    /// Writes the saved state, completely or not at all. There must be no file yet, or the existing file must be a saved state that can be parsed.
    ///
    /// # Errors
    /// One line: the existing file is of a newer version, of another kind, or cannot be read; or the file cannot be written. An existing file
    /// is not changed.
    pub fn save(&self, path: &Path) -> Result<(), String> {
        match Found::at(path) {
            Found::Nothing => {}
            Found::Kept(there) => return self.beside(*there).write(path),
            Found::Refused(Refused::Newer(version)) => return Err(newer(path, version)),
            Found::Refused(Refused::Foreign(what)) => {
                return Err(format!("{what}; the file is not overwritten, so nothing is saved: move the file away"));
            }
            Found::Unreadable(why) => return Err(unreadable(path, &why)),
        }
        self.write(path)
    }

    /// Merges this state with the state in the file (`there`), which another window may have changed. The entry of the current scene is that of this
    /// state; the entries of the other scenes are those of the file. Recent scenes that are only in the file are added at the end of the list.
    fn beside(&self, there: Kept) -> Kept {
        let own = self.recent.first();
        let mut scenes = there.scenes;
        if let Some(own) = own {
            scenes.remove(own);
            scenes.extend(self.scenes.get(own).map(|scene| (own.clone(), scene.clone())));
        }
        let others = there.recent.into_iter().filter(|name| !self.recent.contains(name));
        let recent = self.recent.iter().cloned().chain(others).take(MOST_RECENT).collect();
        Kept { scenes, recent, ..self.clone() }
    }

    fn write(&self, path: &Path) -> Result<(), String> {
        let text = toml::to_string(self).map_err(|error| format!("cannot write {}: {error}", path.display()))?;
        if let Some(folder) = path.parent() {
            let cannot = |error: std::io::Error| {
                format!("cannot make the folder {} ({error}): set SCREE_STATE to a file in another folder", folder.display())
            };
            fs::create_dir_all(folder).map_err(cannot)?;
        }
        files::write(path, text.as_bytes())
    }
}

/// Why the contents of a file are refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Refused {
    /// The file is of another kind or damaged: one line that says what is wrong, and where.
    Foreign(String),
    /// The file has this version, which is newer than [`VERSION`].
    Newer(i64),
}

/// The result of reading the file at a path.
enum Found {
    Nothing,
    Kept(Box<Kept>),
    Refused(Refused),
    /// The file cannot be read, for this reason.
    Unreadable(String),
}

/// The part of the file that is the same in every version of the format.
#[derive(Deserialize)]
struct Versioned {
    version: i64,
}

impl Found {
    fn at(path: &Path) -> Found {
        // Read only regular files, because reading from a device or pipe may never end.
        let bytes = match fs::metadata(path).map(|metadata| metadata.is_file()) {
            Ok(true) => fs::read(path),
            Ok(false) => return Found::Unreadable("it is not a regular file".to_owned()),
            Err(error) => Err(error),
        };
        let bytes = match bytes {
            Ok(bytes) => bytes,
            Err(error) if error.kind() == ErrorKind::NotFound => return Found::Nothing,
            Err(error) => return Found::Unreadable(error.to_string()),
        };
        match Kept::parse(bytes, &path.display().to_string()) {
            Ok(kept) => Found::Kept(Box::new(kept)),
            Err(refused) => Found::Refused(refused),
        }
    }
}

fn newer(path: &Path, version: i64) -> String {
    format!(
        "{} has version {version}, but this program knows only {VERSION}: it is not changed, so nothing is saved; use the newer program, \
         or set SCREE_STATE to another file",
        path.display()
    )
}

fn unreadable(path: &Path, why: &str) -> String {
    format!("cannot read {}: {why}; nothing is saved: remove the cause, or set SCREE_STATE to another file", path.display())
}

/// Renames a file to a free name in the same folder, and returns that name.
fn set_aside(path: &Path) -> std::io::Result<PathBuf> {
    let mut number = 1;
    loop {
        let mut name = path.file_name().unwrap_or_default().to_os_string();
        name.push(if number == 1 { ".damaged".to_owned() } else { format!(".damaged-{number}") });
        let aside = path.with_file_name(name);
        if aside.symlink_metadata().is_err() {
            return fs::rename(path, &aside).map(|()| aside);
        }
        number += 1;
    }
}

/// The file of the saved state: `$SCREE_STATE` if it is set, otherwise `workbench.toml` in the folder that [`folder_of_user`] gives for the state.
/// `None` = there is no such folder, and nothing is saved.
pub fn place() -> Option<PathBuf> {
    place_by(|name| std::env::var_os(name))
}

fn place_by(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let given = variable("SCREE_STATE").filter(|file| !file.is_empty());
    given.map(PathBuf::from).or_else(|| Some(folder_of_user(FolderKind::State, variable)?.join("workbench.toml")))
}

/// The name of a scene in the saved state: `default` for the built-in scene, otherwise the absolute path of the argument of [`scene::load`]. If there
/// is no such path, or if it is not valid Unicode, it is the argument itself.
pub fn scene_name(given: &str) -> String {
    let absolute = || std::path::absolute(given).ok()?.into_os_string().into_string().ok();
    if given == scene::DEFAULT { given.to_owned() } else { absolute().unwrap_or_else(|| given.to_owned()) }
}

/// Saves the state at intervals, on another thread, so that the window does not wait for a disk.
#[derive(Debug)]
pub struct Keeper {
    path: PathBuf,
    /// The state that was read from the file, or that was last collected for saving.
    kept: Kept,
    looked: Instant,
    writing: Option<JoinHandle<Result<(), String>>>,
    failure: Option<String>,
}

impl Keeper {
    /// Reads the saved state from a file. Also returns the line for the user that [`Kept::load`] returns.
    pub fn open(path: PathBuf) -> (Keeper, Option<String>) {
        let (kept, line) = Kept::load(&path);
        (Keeper { path, kept, looked: Instant::now(), writing: None, failure: None }, line)
    }

    /// The saved state.
    pub fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Why the last attempt to write failed, in one line; `None` = it did not fail.
    pub fn failure(&self) -> Option<&str> {
        self.failure.as_deref()
    }

    /// Call this whenever the window is drawn. If the last check is at least [`EVERY`] ago and nothing is being written, this function calls
    /// `present` to get the state to save. `present` receives the previously saved state. The function begins to write the state if the state has
    /// changed or the last attempt to write failed.
    pub fn tend(&mut self, now: Instant, present: impl FnOnce(&Kept) -> Kept) {
        if self.writing.as_ref().is_some_and(|writing| !writing.is_finished()) || now.saturating_duration_since(self.looked) < EVERY {
            return;
        }
        self.join();
        self.looked = now;
        if self.take(present) {
            let (kept, path) = (self.kept.clone(), self.path.clone());
            self.writing = Some(std::thread::spawn(move || kept.save(&path)));
        }
    }

    /// Writes the state if it has changed or the last attempt to write failed, and waits until it is written.
    ///
    /// # Errors
    /// See [`Kept::save`].
    pub fn finish(&mut self, present: impl FnOnce(&Kept) -> Kept) -> Result<(), String> {
        self.join();
        if self.take(present) {
            self.failure = self.kept.save(&self.path).err();
        }
        self.failure.clone().map_or(Ok(()), Err)
    }

    /// Replaces the stored state by the present state. Returns whether the state must be written: it has changed, or the last attempt to write
    /// failed.
    fn take(&mut self, present: impl FnOnce(&Kept) -> Kept) -> bool {
        let present = present(&self.kept);
        let changed = present != self.kept || self.failure.is_some();
        self.kept = present;
        changed
    }

    /// Waits for the thread that writes, and records its outcome.
    fn join(&mut self) {
        if let Some(writing) = self.writing.take() {
            let outcome =
                writing.join().unwrap_or_else(|_| Err("saving stopped because of an internal error; please report it".to_owned()));
            self.failure = outcome.err();
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use kernels::display::{Exposure, ToneCurve};
    use kernels::frame::FrameSettings;
    use kernels::shading::Estimator;
    use kernels::shared::noise::NoiseKind;
    use kernels::variant::{Flavour, Variant};
    use kernels::view::camera::Pose;
    use kernels::view::normals::NormalEncoding;

    use super::*;
    use crate::model::display::Layer;
    use crate::model::settings::frame_settings;
    use crate::test_folder::Folder;

    const ELSEWHERE: &str = "/elsewhere/scene.toml";

    fn file_of(folder: &Folder) -> PathBuf {
        folder.0.join("workbench.toml")
    }

    fn plain() -> Scene {
        scene::load(scene::DEFAULT).expect("built in")
    }

    fn apply(kept: &Kept, scene_name: &str, settings: &mut Settings) -> Vec<String> {
        let mut said = kept.apply_look(settings);
        said.extend(kept.apply_numbers(scene_name, &mut settings.scene));
        said
    }

    fn tree() -> Tree<Pane> {
        let panes = Pane::ALL.iter().map(|pane| Layout::Pane { name: pane.name().to_owned() }).collect();
        Layout::Tabs { open: 2, children: panes }.tree(egui::Id::unique("kept in a test")).expect("panes")
    }

    fn places() -> Places {
        let pose = Pose { position: DVec3::new(1.0, -2.5, 1e3 / 7.0), yaw: 1.0, pitch: -0.1, fov: 0.9 };
        let mut places = Places::default();
        places.keep("ridge", pose);
        places.add(Recorded::new("flight", vec![pose, Pose { yaw: 1.1, ..pose }]).expect("frames"));
        places
    }

    /// Settings that differ from the defaults in every setting of the frame and of the display, and in two numbers of the scene.
    fn changed() -> Settings {
        let mut settings = Settings::new(plain());
        settings.scene.blend.hash_scale = 2.0 / 3.0;
        settings.scene.sun.azimuth_deg = 12.5;
        settings.frame = FrameSettings {
            variant: Variant::new(Flavour::Splat.bit() | Flavour::VirtualTexture.bit()),
            generic: true,
            estimator: Estimator::Stf,
            noise: NoiseKind::Blue,
            seed: u32::MAX,
            reseeds: true,
            two_tilings: true,
            normals: NormalEncoding::PlaneFirst,
            lod_bias: -1.5,
            vertex_stride: 4,
            geometry_error: 0.5,
            ..settings.frame
        };
        settings.frame.stages.display = Exposure { exposure: 1.5, tone_curve: ToneCurve::Clip };
        let same = frame_settings().filter(|setting| setting.get(&settings.frame) == (setting.default)());
        assert_eq!(same.map(|setting| setting.key).collect::<Vec<_>>(), Vec::<&str>::new(), "these settings still have their defaults");
        Settings { scale: 0.7, layer: Layer::Tiles, counts: true, times_variants: true, ..settings }
    }

    fn kept() -> Kept {
        Kept::of(&Kept::default(), scene::DEFAULT, &changed(), &plain(), &places(), &tree())
    }

    #[test]
    fn everything_comes_back() {
        let folder = Folder::new("round");
        let file = folder.0.join("made/on/demand.toml");
        kept().save(&file).expect("written");
        let (read, line) = Kept::load(&file);
        assert_eq!((&read.look, &read.layout, &read.recent, line), (&kept().look, &kept().layout, &kept().recent, None));
        let mut settings = Settings::new(plain());
        assert_eq!(apply(&read, scene::DEFAULT, &mut settings), Vec::<String>::new());
        assert_eq!(settings, changed());
        let again = read.places(scene::DEFAULT);
        assert_eq!((again.places()[0].name.as_str(), again.paths()), ("ridge", places().paths()));
        let pose = again.places()[0].pose;
        assert!(pose.position == places().places()[0].pose.position && (pose.yaw - 1.0).abs() < 1e-15);
        assert!(
            read.has_scale_and_stride() == [true; 2] && read.tree(egui::Id::unique("again")).as_ref().and_then(Layout::of) == kept().layout
        );
        // The state that was read is saved again unchanged, so values do not drift from start to start.
        let mut original = plain();
        original.blend.mip_bias = 0.5;
        let mut settings = Settings::new(original.clone());
        apply(&read, scene::DEFAULT, &mut settings);
        assert!((settings.scene.blend.mip_bias - 0.5).abs() < 1e-12, "an edit of the scene's file must take effect");
        assert_eq!(Kept::of(&read, scene::DEFAULT, &settings, &original, &again, &tree()), read);
        let none = folder.0.join("nothing.toml");
        assert_eq!(Kept::load(&none), (Kept::default(), None));
    }

    #[test]
    fn scenes_do_not_share_numbers_and_places() {
        let usual = Settings::new(plain());
        let elsewhere = Kept::of(&kept(), ELSEWHERE, &usual, &plain(), &Places::default(), &tree());
        assert_eq!(elsewhere.recent(), [ELSEWHERE, scene::DEFAULT]);
        assert!(elsewhere.places(ELSEWHERE).is_empty() && elsewhere.places(scene::DEFAULT) == places());
        let mut settings = usual.clone();
        apply(&elsewhere, ELSEWHERE, &mut settings);
        assert_eq!(settings, usual);
        // The numbers of the built-in scene are still in `elsewhere`. Applying them changes the scene and no other setting.
        assert_eq!(elsewhere.apply_numbers(scene::DEFAULT, &mut settings.scene), Vec::<String>::new());
        assert_eq!(settings, Settings { scene: changed().scene, ..usual });
        apply(&elsewhere, scene::DEFAULT, &mut settings);
        assert_eq!(settings.scene, changed().scene);
    }

    #[test]
    fn recent_scenes_are_few_and_none_comes_twice() {
        let opened = |before: &Kept, name: &str| Kept::of(before, name, &Settings::new(plain()), &plain(), &Places::default(), &tree());
        let many = (0..15).fold(Kept::default(), |before, i| opened(&before, &format!("scene {i}")));
        assert_eq!((many.recent().len(), many.recent()[0].as_str(), many.recent()[9].as_str()), (MOST_RECENT, "scene 14", "scene 5"));
        let again = opened(&many, "scene 7");
        assert_eq!((again.recent().len(), again.recent()[0].as_str(), again.recent()[1].as_str()), (MOST_RECENT, "scene 7", "scene 14"));
        assert!(again.recent()[1..].iter().all(|name| name != "scene 7"));
    }

    #[test]
    fn what_is_damaged_or_foreign_is_set_aside_and_never_deleted() {
        let folder = Folder::new("damaged");
        let mut texts = vec![b"\xff\xfe".to_vec(), Vec::new(), b"[palette]\nred = 1\n".to_vec(), b"version = 0\n".to_vec()];
        texts.push(b"version = 1\n[look]\nnoises = 3\n".to_vec());
        texts.push(b"version = 1\n[look]\nnoise = ".to_vec());
        for (text, number) in texts.iter().zip(1..) {
            fs::write(file_of(&folder), text).expect("written");
            let refusal = kept().save(&file_of(&folder)).expect_err("not ours");
            assert!(refusal.contains("not overwritten") && fs::read(file_of(&folder)).expect("still there") == *text, "{refusal}");
            let (kept, line) = Kept::load(&file_of(&folder));
            let line = line.expect("a line for the user");
            let aside = if number == 1 { "workbench.toml.damaged".to_owned() } else { format!("workbench.toml.damaged-{number}") };
            assert!(kept == Kept::default() && line.contains(&aside) && !line.contains('\n'), "{line}");
            assert_eq!(fs::read(folder.0.join(aside)).expect("set aside"), *text);
            assert!(!file_of(&folder).exists());
        }
        fs::write(file_of(&folder), "version = 1\n[look]\nnoises = 3\n").expect("written");
        let line = Kept::load(&file_of(&folder)).1.expect("a line about the unknown key");
        assert!(line.contains("workbench.toml:3") && line.contains("did you mean `noise`"), "{line}");
        // There is a folder at the path of the file.
        fs::create_dir(file_of(&folder)).expect("made");
        let line = Kept::load(&file_of(&folder)).1.expect("a folder");
        assert!(line.contains("not a regular file") && file_of(&folder).is_dir() && kept().save(&file_of(&folder)).is_err(), "{line}");
    }

    #[test]
    fn a_newer_version_is_left_alone() {
        let folder = Folder::new("newer");
        let newer = VERSION + 1;
        let text = format!("version = {newer}\nlook = \"of another kind\"\n");
        fs::write(file_of(&folder), &text).expect("written");
        let (kept, line) = Kept::load(&file_of(&folder));
        assert!(kept == Kept::default() && line.as_ref().is_some_and(|line| line.contains(&format!("version {newer}"))), "{line:?}");
        assert!(kept.save(&file_of(&folder)).expect_err("not written over").contains("SCREE_STATE"));
        assert_eq!((fs::read_to_string(file_of(&folder)).expect("still there"), folder.names().len()), (text, 1));
    }

    #[test]
    fn names_that_are_gone_are_said_and_the_rest_is_taken() {
        let folder = Folder::new("names");
        let text = "version = 1\n[look]\nvariant = \"vt+lava\"\nestimator = \"stf\"\nnoise = \"pink\"\nlayer = \"Tile\"\nscale = 9.0\nlod_bias = nan\nvertex_stride = 3\nseed = 5\n\
            [scene.default.numbers]\n\"blend.hash_scale\" = 3.0\n\"blend.gone\" = 1.0\n\"sun.azimuth_deg\" = nan\n";
        fs::write(file_of(&folder), text).expect("written");
        let (kept, line) = Kept::load(&file_of(&folder));
        assert_eq!(line, None);
        let mut settings = Settings::new(plain());
        let said = apply(&kept, scene::DEFAULT, &mut settings);
        let parts = ["Tile", "frame.lod_bias", "pink", "look.scale", "vt+lava", "frame.vertex_stride", "blend.gone", "sun.azimuth_deg"];
        assert_eq!(said.len(), parts.len(), "{said:?}");
        for (line, part) in said.iter().zip(parts) {
            assert!(line.contains(part) && line.contains("left out") && !line.contains('\n'), "{line}");
        }
        let mut expected = Settings::new(plain());
        (expected.frame.estimator, expected.frame.seed) = (Estimator::Stf, 5);
        expected.scene.blend.hash_scale = 3.0;
        assert_eq!(settings, expected);
        // The saved number `flavours.cliff_near_m` makes the scene invalid.
        let mut impossible = Kept { look: Look::default(), ..kept.clone() };
        impossible.scenes.entry(scene::DEFAULT.to_owned()).or_default().numbers =
            BTreeMap::from([("flavours.cliff_near_m".to_owned(), 9000.0)]);
        let said = apply(&impossible, scene::DEFAULT, &mut settings);
        assert!(said.len() == 1 && said[0].contains("cliff_near_m") && settings.scene == expected.scene, "{said:?}");
        // Numbers that make the scene invalid are not saved. The previously saved numbers are kept.
        let mut numbers = changed();
        numbers.scene.flavours.cliff_near_m = 9000.0;
        let kept = Kept::of(&kept, scene::DEFAULT, &numbers, &plain(), &Places::default(), &tree());
        assert_eq!(kept.scenes[scene::DEFAULT].numbers.get("blend.hash_scale"), Some(&3.0));
    }

    #[test]
    fn a_writing_that_fails_leaves_the_old_file_whole() {
        let folder = Folder::new("whole");
        kept().save(&file_of(&folder)).expect("written");
        let before = fs::read(file_of(&folder)).expect("there");
        // The file cannot be written, because a folder already has the name of the temporary file.
        fs::create_dir(folder.0.join(format!("workbench.toml.{}.tmp", std::process::id()))).expect("made");
        let error = Kept::default().save(&file_of(&folder)).expect_err("cannot be written");
        assert!(error.contains("workbench.toml") && error.contains("make room"), "{error}");
        assert_eq!(fs::read(file_of(&folder)).expect("there"), before);
    }

    #[test]
    fn a_keeper_writes_changes_now_and_then_and_in_the_end() {
        let folder = Folder::new("keeper");
        let (mut keeper, line) = Keeper::open(file_of(&folder));
        assert!(line.is_none() && *keeper.kept() == Kept::default());
        let begun = Instant::now();
        keeper.tend(begun, |_| panic!("not so soon"));
        keeper.tend(begun + 2 * EVERY, |before| Kept { look: Look::of(&changed()), ..before.clone() });
        keeper.finish(Kept::clone).expect("written");
        assert_eq!(Kept::load(&file_of(&folder)).0.look, Look::of(&changed()));
        // Without a change, nothing is written.
        fs::remove_file(file_of(&folder)).expect("was there");
        keeper.finish(Kept::clone).expect("nothing to do");
        assert!(folder.names().is_empty());
        // A failure is reported until an attempt succeeds.
        fs::create_dir(file_of(&folder)).expect("made");
        assert!(keeper.finish(|_| kept()).is_err() && keeper.failure().is_some_and(|line| line.contains("not a regular file")));
        fs::remove_dir(file_of(&folder)).expect("was there");
        keeper.finish(Kept::clone).expect("mended");
        assert!(keeper.failure().is_none() && folder.names() == ["workbench.toml"]);
    }

    #[test]
    fn the_file_lies_where_the_machine_keeps_such() {
        let home = std::env::temp_dir();
        let by =
            |pairs: &[(&str, OsString)]| place_by(|name| pairs.iter().find(|(known, _)| *known == name).map(|(_, value)| value.clone()));
        let all = ["HOME", "APPDATA", "XDG_STATE_HOME"].map(|name| (name, home.clone().into_os_string()));
        assert!(by(&all).is_some_and(|file| file.starts_with(&home) && file.ends_with("scree/workbench.toml")));
        let own = [all[0].clone(), ("SCREE_STATE", OsString::from("own.toml"))];
        assert_eq!(by(&own), Some(PathBuf::from("own.toml")));
        assert_eq!(by(&[]), None);
    }

    #[test]
    fn a_scene_is_called_by_its_absolute_path() {
        assert_eq!(scene_name(scene::DEFAULT), scene::DEFAULT);
        let name = scene_name("some/scene.toml");
        assert!(Path::new(&name).is_absolute() && Path::new(&name).ends_with("some/scene.toml"), "{name}");
        assert_eq!(scene_name(&name), name);
    }
}

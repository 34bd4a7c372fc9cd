//! Saves the current settings and view as a definition that `experiments run` accepts, and runs experiments with that program while the window stays
//! usable.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, BufRead as _, BufReader, PipeReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Error, Result, bail, ensure};
use experiments::definition::{self, Definition, Reference, Small, Times, Viewing, variant_name};
use kernels::base::error::one_line;
use kernels::base::files::WholeFolder;
use kernels::frame::{self, FrameSettings};
use kernels::scene::{self, CameraPose, Scene};
use kernels::settings::Home;
use kernels::shared::signal::Signal;
use toml::Value;

use super::lock;
use crate::model::editing::with_absolute_paths;
use crate::model::settings::Settings;
use crate::model::viewpoint::{EYE_M, Viewpoint};

/// Name of the camera that is added to the scene for a free viewpoint. If the name is taken, a number is appended.
const CAMERA: &str = "workbench";
/// Maximum number of lines of a report that are shown. This is usually enough for the answer, the checks, the expectations, and most rows of the
/// table *Choices*.
const EXCERPT: usize = 40;
/// Time between two checks whether a process has ended.
const NAP: Duration = Duration::from_millis(10);
/// Longest wait for the process of a dropped [`Run`] to end after the interrupt. After this wait, the process is killed.
const FAREWELL: Duration = Duration::from_secs(3);

/// How much an experiment measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Extent {
    /// Width and height of a picture, pixels.
    pub size: [u32; 2],
    /// Number of frames of the sequence, which begins at frame 0. At least 1, or at least 2 for metrics that compare frames.
    pub frames: u32,
    /// Number of seeds for bias and variance, at least 2; 0 = neither is measured.
    pub seeds: u32,
}

/// Saves the current settings and view into a new folder, completely or not at all. The folder has `NAME.toml`, the definition. It also has
/// `scene.toml`, unless both of these conditions hold: the scene differs from the built-in one only in settings, and the viewpoint is a camera or
/// path of the scene. Returns the path of the definition.
///
/// Paths in the scene file become absolute. A run renders frames from 0 on. Frame n of the run has the seed and the camera pose that frame n has in
/// the window.
///
/// # Errors
/// One line with the remedy: the name is not suitable, the folder exists or cannot be written, a definition cannot describe the view (a recorded
/// path), or `experiments` would refuse the definition.
pub fn save(folder: &Path, name: &str, settings: &Settings, viewpoint: &Viewpoint, extent: Extent) -> Result<PathBuf> {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    ensure!(
        !name.is_empty() && name.chars().all(plain),
        "`{name}` is not a name for an experiment: use letters A to Z and a to z, digits, - and _"
    );
    ensure!(!name.eq_ignore_ascii_case("scene"), "`{name}` is reserved for the scene file next to the experiment: choose another name");
    ensure!(!folder.exists(), "{} already exists and is not overwritten: choose another name, or remove that folder", folder.display());
    let (view, camera) = view(&settings.scene, viewpoint)?;

    let staging = WholeFolder::beside(folder).with_context(|| format!("cannot write into {}: choose another folder", folder.display()))?;
    let changes = if camera.is_none() { changes(&settings.scene) } else { None };
    let source = if changes.is_some() {
        scene::DEFAULT
    } else {
        let mut copy = with_absolute_paths(&settings.scene).map_err(Error::msg)?;
        copy.cameras.extend(camera);
        write_in(&staging, scene::FILE, &toml::to_string(&copy).context("the scene cannot be written as TOML")?)?;
        scene::FILE
    };
    let choice = variant_name(settings.choice());
    let definition = Definition {
        name: name.to_owned(),
        question: format!(
            "What does {choice} cost, and how does it look, with estimator {} and {} noise, seen from {view}?",
            settings.frame.estimator,
            settings.frame.noise.name()
        ),
        analysis: String::new(),
        scene: Some(source.to_owned()),
        import: None,
        views: vec![view],
        moving_views: Vec::new(),
        size: extent.size,
        frames: extent.frames,
        warm_up: 0,
        seeds: extent.seeds,
        variants: vec![choice],
        estimators: vec![settings.frame.estimator.name().to_owned()],
        noises: vec![settings.frame.noise.name().to_owned()],
        temporal: vec!["off".to_owned()],
        vary: None,
        settings: changes.unwrap_or_default().into_iter().chain(frame_settings(settings)).collect(),
        metrics: Vec::new(),
        signals: Signal::ALL.map(|signal| signal.name().to_owned()).to_vec(),
        viewing: Viewing::default(),
        video: false,
        reference: Reference::default(),
        times: Times::default(),
        times_budget_s: definition::TIMES_BUDGET_S,
        small: Small::default(),
        expectations: Vec::new(),
        folder: PathBuf::new(),
    };
    let file = format!("{name}.toml");
    let text = format!("# Saved from the workbench. To run it: experiments run {file} --out out\n{}", definition.to_toml()?);
    // Check the text with the parser that a run uses, so that a definition that a run would refuse is not saved.
    definition::parse(&text, &file, staging.folder())?;
    write_in(&staging, &file, &text)?;
    staging.finish().with_context(|| format!("cannot make the folder {}: choose another", folder.display()))?;
    Ok(folder.join(file))
}

/// The settings of the frame that differ from the defaults of a run, by their keys in a definition.
fn frame_settings(settings: &Settings) -> BTreeMap<String, Value> {
    let usual = FrameSettings::default();
    let all = frame::settings().filter(|setting| setting.has_home(Home::Definition));
    let differing = all.filter_map(|setting| {
        setting.get(&settings.frame).filter(|value| setting.get(&usual).as_ref() != Some(value)).map(|value| (setting, value))
    });
    differing.map(|(setting, value)| (setting.key.to_owned(), value)).collect()
}

/// Returns the name of the view, and the camera that must be added to the scene for this view, if one is needed.
fn view(scene: &Scene, viewpoint: &Viewpoint) -> Result<(String, Option<CameraPose>)> {
    let is_camera = |name: &str| scene.cameras.iter().any(|camera| camera.name == name);
    match viewpoint {
        Viewpoint::Camera(name) => Ok((name.clone(), None)),
        Viewpoint::Path(name) => {
            ensure!(
                !is_camera(name),
                "scene `{}` also has a camera `{name}`, which a run would use instead of the path: rename one of the two",
                scene.name
            );
            Ok((name.clone(), None))
        }
        Viewpoint::Recorded(path) => {
            bail!(
                "the view is a replay of `{}`, which a definition cannot describe: go to a camera, a path of the scene, or a place",
                path.name
            )
        }
        Viewpoint::Free { pose, walking } => {
            let is_taken = |name: &str| is_camera(name) || scene.paths.iter().any(|path| path.name == name);
            let mut name = CAMERA.to_owned();
            let mut number = 1;
            while is_taken(&name) {
                number += 1;
                name = format!("{CAMERA}-{number}");
            }
            // When walking, save the height above the ground, because the elevation in the pose may be out of date. The run adds the elevation of the
            // ground.
            let z = if *walking { EYE_M } else { pose.position.z };
            let camera = CameraPose {
                name: name.clone(),
                position: [pose.position.x, pose.position.y, z],
                above_ground: *walking,
                yaw_deg: pose.yaw.to_degrees().rem_euclid(360.0),
                pitch_deg: pose.pitch.to_degrees(),
                fov_deg: pose.fov.to_degrees(),
            };
            Ok((name, Some(camera)))
        }
    }
}

/// The settings in which a scene differs from the built-in one, by their keys; `None` if there are other differences, too.
fn changes(scene: &Scene) -> Option<BTreeMap<String, Value>> {
    let mut built_in = scene::load(scene::DEFAULT).ok()?;
    // The built-in scene names no files, so its folder has no effect.
    let wanted = Scene { folder: built_in.folder.clone(), ..scene.clone() };
    let mut changes = BTreeMap::new();
    for setting in scene::settings() {
        let (Some(from), Some(to)) = (setting.get(&built_in), setting.get(&wanted)) else { continue };
        if from != to {
            setting.set(&mut built_in, &to).ok()?;
            changes.insert(setting.key.to_owned(), to);
        }
    }
    (built_in == wanted).then_some(changes)
}

fn write_in(staging: &WholeFolder, name: &str, text: &str) -> Result<()> {
    let file = staging.folder().join(name);
    fs::write(&file, text).with_context(|| format!("cannot write {}: make room, or choose another folder", file.display()))
}

/// The definitions in the folder `place`, sorted by path: the `.toml` files of the folder apart from `scene.toml`, and the files `NAME/NAME.toml`, as
/// [`save`] writes them. If `place` is a file, returns that file. If `place` does not exist, returns nothing.
pub fn definitions(place: &Path) -> Vec<PathBuf> {
    if place.is_file() {
        return vec![place.to_owned()];
    }
    let Ok(entries) = fs::read_dir(place) else { return Vec::new() };
    let mut found: Vec<PathBuf> = entries.filter_map(|entry| definition_at(entry.ok()?.path())).collect();
    found.sort();
    found
}

fn definition_at(path: PathBuf) -> Option<PathBuf> {
    if path.is_dir() {
        let own = path.join(format!("{}.toml", path.file_name()?.to_str()?));
        return own.is_file().then_some(own);
    }
    let is_definition =
        path.extension().is_some_and(|extension| extension == "toml") && path.file_name().is_some_and(|name| name != scene::FILE);
    is_definition.then_some(path)
}

/// Why a definition cannot be run, in one line: it has an error, or a file that it names does not exist. `None` = it can be run.
pub fn lacks(definition: &Path) -> Option<String> {
    definition::load(definition).err().map(|error| one_line(&format!("{error:#}")))
}

/// The folder `experiments/definitions`, whose definitions come with the program. The function searches for it in the working directory and in all
/// folders above the executable. `None` = it is in none of them.
pub fn shipped() -> Option<PathBuf> {
    let definitions = Path::new("experiments").join("definitions");
    let own = std::env::current_exe().unwrap_or_default();
    let places = own.ancestors().skip(1).map(|folder| folder.join(&definitions));
    std::iter::once(definitions.clone()).chain(places).find(|folder| folder.is_dir())
}

/// Name of a definition on buttons: the name of its file without extension.
pub fn name(definition: &Path) -> String {
    definition.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Opens a page with the default program of the system, without waiting for it.
///
/// # Errors
/// The command that opens it cannot be started.
pub fn open(page: &Path) -> Result<()> {
    let opener = match std::env::consts::OS {
        "windows" => "explorer",
        "macos" => "open",
        _ => "xdg-open",
    };
    let started = Command::new(opener).arg(page).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    let mut child = started.with_context(|| format!("`{opener}` cannot be started: open {} in a browser", page.display()))?;
    // The exit status of the opener is not reliable, so it is ignored. Waiting for the process only avoids a zombie process.
    thread::spawn(move || child.wait());
    Ok(())
}

/// Finds the program `experiments`: in the folder of the executable, in the folder above it (for tests), or on the search path.
fn program() -> Result<PathBuf> {
    let name = format!("experiments{}", std::env::consts::EXE_SUFFIX);
    let own = std::env::current_exe().unwrap_or_default();
    let near = own.ancestors().skip(1).take(2).map(Path::to_owned);
    let search_path = std::env::var_os("PATH").unwrap_or_default();
    let found = near.chain(std::env::split_paths(&search_path)).map(|folder| folder.join(&name)).find(|file| file.is_file());
    let profile = if cfg!(debug_assertions) { "" } else { " --release" };
    found.with_context(|| {
        format!(
            "the program `experiments` is neither next to this program nor on the search path: build it with `cargo build{profile} -p experiments`"
        )
    })
}

/// The result of a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Report {
    /// Path of the run's file report.html.
    pub page: PathBuf,
    /// The first lines of the file report.md next to `page`, in Markdown; empty if that file cannot be read.
    pub excerpt: String,
}

/// A run of the program `experiments`, in progress or ended. Dropping it stops the run.
pub struct Run {
    name: String,
    began: Instant,
    shared: Arc<Shared>,
}

struct Shared {
    child: Mutex<Child>,
    said: Mutex<Said>,
}

/// What is known about the process so far: the parts of its output that the panel needs, and its outcome.
#[derive(Default)]
struct Said {
    last: String,
    error: Option<String>,
    page: Option<PathBuf>,
    /// Number of times that the run has been asked to stop.
    cancelled: u32,
    outcome: Option<Result<Report, String>>,
}

impl Run {
    /// Runs a definition. The results are written to a folder with the name of the definition in `out`. If this folder contains a stopped run, the
    /// run continues. If it contains a finished run, only the report is written again. `wake` is called whenever there is something new to show.
    ///
    /// # Errors
    /// There is no program `experiments`, or it cannot be started.
    pub fn start(definition: &Path, out: &Path, wake: impl Fn() + Send + 'static) -> Result<Run> {
        let mut command = Command::new(program()?);
        command.arg("run").arg(definition).arg("--out").arg(out).arg("--resume");
        Run::follow(command, name(definition), wake)
    }

    /// Starts a process that prints lines like those of `experiments run`, and follows its output.
    fn follow(mut command: Command, name: String, wake: impl Fn() + Send + 'static) -> Result<Run> {
        // One pipe for standard output and standard error, so that their lines stay in order.
        let (output, input) = io::pipe().context("the run's output cannot be followed")?;
        let second = input.try_clone().context("the run's output cannot be followed")?;
        command.stdin(Stdio::null()).stdout(input).stderr(second);
        let child = command.spawn().with_context(|| format!("{} cannot be started", command.get_program().display()))?;
        // The command still owns writing ends of the pipe. As long as one of them is open, a reader of the pipe does not reach the end of the output.
        // So drop the command.
        drop(command);
        let shared = Arc::new(Shared { child: Mutex::new(child), said: Mutex::new(Said::default()) });
        let own = shared.clone();
        thread::spawn(move || own.listen(output, &wake));
        Ok(Run { name, began: Instant::now(), shared })
    }

    /// Whole seconds since the run was started.
    pub fn seconds(&self) -> u64 {
        self.began.elapsed().as_secs()
    }

    /// Name of the experiment.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The last line that the program printed; empty before the first one.
    pub fn progress(&self) -> String {
        lock(&self.shared.said).last.clone()
    }

    /// Whether the run has ended, successfully or not.
    pub fn is_done(&self) -> bool {
        lock(&self.shared.said).outcome.is_some()
    }

    /// The result of the run: the report, or one line that says why there is no report. `None` = the run is still in progress.
    pub fn outcome(&self) -> Option<Result<Report, String>> {
        lock(&self.shared.said).outcome.clone()
    }

    /// Asks the run to stop, as Ctrl-C does. Finished parts are kept, so that [`Run::start`] can continue from there. A second call kills the process
    /// of the run; on systems other than Unix, the first call does so.
    pub fn cancel(&self) {
        let shared = self.shared.clone();
        thread::spawn(move || shared.cancel());
    }
}

impl Drop for Run {
    fn drop(&mut self) {
        if self.is_done() {
            return;
        }
        // Do not use `Run::cancel`: it starts a thread, which might never run if this program is ending.
        self.shared.cancel();
        let began = Instant::now();
        while !self.is_done() {
            if began.elapsed() > FAREWELL {
                return self.shared.cancel();
            }
            thread::sleep(NAP);
        }
    }
}

impl Shared {
    /// Reads the output of the process until the process has ended. Then stores the outcome of the run.
    fn listen(&self, output: PipeReader, wake: &dyn Fn()) {
        for line in BufReader::new(output).split(b'\n') {
            let Ok(line) = line else { break };
            lock(&self.said).hear(&String::from_utf8_lossy(&line));
            wake();
        }
        let status = loop {
            // Poll, because waiting while holding the lock would block a cancellation.
            let ended = lock(&self.child).try_wait();
            match ended {
                Ok(None) => thread::sleep(NAP),
                Ok(Some(status)) => break Ok(status),
                Err(error) => break Err(error),
            }
        };
        // Read the report without holding the lock, so that the window does not wait for a disk.
        let page = lock(&self.said).page.clone();
        let report = page.map(|page| Report { excerpt: excerpt(&page), page });
        let mut said = lock(&self.said);
        let outcome = said.conclude(status, report);
        said.outcome = Some(outcome);
        drop(said);
        wake();
    }

    /// Interrupts the process at the first call. Kills it at later calls, or if it cannot be interrupted. While the lock is held, the process id
    /// cannot be reused, so no other process receives the signal.
    fn cancel(&self) {
        let mut child = lock(&self.child);
        if !matches!(child.try_wait(), Ok(None)) {
            return;
        }
        let mut said = lock(&self.said);
        said.cancelled += 1;
        let first = said.cancelled == 1;
        drop(said);
        if first && interrupt(&child) {
            return;
        }
        // Killing fails if the process has ended already. This failure needs no action.
        drop(child.kill());
    }
}

/// Sends the signal of Ctrl-C. Returns whether that was possible.
fn interrupt(child: &Child) -> bool {
    // `kill` is built into the usual shells, but a separate program `kill` may be missing. So run it in a shell.
    let kill = || Command::new("sh").arg("-c").arg(format!("kill -INT {}", child.id())).stdin(Stdio::null()).output();
    cfg!(unix) && kill().is_ok_and(|output| output.status.success())
}

impl Said {
    fn hear(&mut self, line: &str) {
        let line = line.trim();
        if line.is_empty() {
            return;
        }
        if let Some(error) = line.strip_prefix("error: ") {
            self.error = Some(error.to_owned());
        }
        if let Some(page) = line.strip_prefix("report: ") {
            self.page = Some(PathBuf::from(page));
        }
        line.clone_into(&mut self.last);
    }

    fn conclude(&self, status: io::Result<ExitStatus>, report: Option<Report>) -> Result<Report, String> {
        let status =
            status.map_err(|error| format!("the exit status of the run cannot be read ({error}): run the experiment again to continue"))?;
        match report {
            Some(report) if status.success() => Ok(report),
            _ if self.cancelled > 0 => Err("stopped; finished parts are kept: run the experiment again to continue from there".to_owned()),
            _ => Err(self.error.clone().unwrap_or_else(|| format!("the run ended without a report ({status}): {}", self.last))),
        }
    }
}

fn excerpt(page: &Path) -> String {
    let text = fs::read_to_string(page.with_extension("md")).unwrap_or_default();
    // The report has check marks and crosses, which the fonts of the window lack. Replace them by words.
    text.lines()
        .take(EXCERPT)
        .collect::<Vec<_>>()
        .join("\n")
        .replace('\u{2705}', "[holds]")
        .replace('\u{274c}', "[fails]")
        .replace('\u{2754}', "[open]")
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use kernels::scene::{Stroke, StrokeKind, World};
    use kernels::shading::Estimator;
    use kernels::shared::noise::NoiseKind;
    use kernels::variant::{Flavour, Variant};
    use kernels::view::camera::Pose;
    use kernels::view::normals::NormalEncoding;

    use super::*;
    use crate::test_folder::Folder;

    const EXTENT: Extent = Extent { size: [80, 72], frames: 3, seeds: 2 };

    fn settings() -> Settings {
        Settings::new(scene::load(scene::DEFAULT).expect("built in"))
    }

    fn camera(name: &str) -> Viewpoint {
        Viewpoint::Camera(name.to_owned())
    }

    /// The scene of a saved definition, with its folder replaced by that of the scene `like`, so that a comparison with `like` ignores the folder.
    fn saved_scene(definition: &Definition, like: &Scene) -> Scene {
        Scene { folder: like.folder.clone(), ..definition.scene(&None, None).expect("a scene") }
    }

    #[test]
    fn a_saved_definition_says_what_is_on_screen() {
        let folder = Folder::new("same");
        let mut settings = settings();
        settings.frame.variant = Variant::new(Flavour::Splat.bit() | Flavour::NearCliff.bit());
        settings.frame.estimator = Estimator::Biplanar;
        settings.frame.noise = NoiseKind::WhiteScreen;
        settings.scene.blend.hash_scale = 0.1 + 0.2;
        settings.scene.sun.azimuth_deg = 200.5;
        let file = save(&folder.0.join("seen"), "seen", &settings, &camera("cliff"), EXTENT).expect("it is saved");
        let definition = definition::load(&file).expect("it is read");
        assert_eq!((definition.size, definition.frames, definition.seeds), ([80, 72], 3, 2));
        assert_eq!(definition.view_names().collect::<Vec<_>>(), ["cliff"]);
        assert_eq!(definition.variant_choices().expect("a variant"), [("near-cliff+splat".to_owned(), settings.choice())]);
        for (list, name) in [(&definition.estimators, "biplanar"), (&definition.noises, "white"), (&definition.temporal, "off")] {
            assert_eq!(*list, [name]);
        }
        // The built-in scene with changed numbers needs no scene file.
        assert_eq!((definition.scene.as_deref(), definition.settings.len()), (Some(scene::DEFAULT), 2));
        assert_eq!(fs::read_dir(folder.0.join("seen")).expect("a folder").count(), 1);
        assert!(saved_scene(&definition, &settings.scene) == settings.scene);
        // A scene with a changed material needs a scene file.
        settings.scene.materials[0].tile_m *= 2.0;
        let file = save(&folder.0.join("other"), "other", &settings, &camera("cliff"), EXTENT).expect("it is saved");
        let definition = definition::load(&file).expect("it is read");
        assert_eq!((definition.scene.as_deref(), definition.settings.len()), (Some(scene::FILE), 0));
        assert!(saved_scene(&definition, &settings.scene) == settings.scene);
        // A scene with changed rules, tints and strokes also needs a scene file.
        let stroke = Stroke {
            kind: StrokeKind::Splat,
            material: settings.scene.materials[1].name.clone(),
            points: vec![[1.0 / 3.0, -2.0], [4.5, 0.0]],
            radius_m: 3.0,
            fade_m: 0.0,
            amount: 0.0,
        };
        settings.scene.strokes = vec![stroke.clone(), Stroke { kind: StrokeKind::Mask, fade_m: 1.5, amount: 0.25, ..stroke }];
        settings.scene.rules.swap(1, 2);
        settings.scene.materials[2].tint = [0.5, 1.0 / 3.0, 2.0];
        let file = save(&folder.0.join("painted"), "painted", &settings, &camera("cliff"), EXTENT).expect("it is saved");
        let definition = definition::load(&file).expect("it is read");
        assert!(saved_scene(&definition, &settings.scene) == settings.scene);
        // The automatic choice of variants is called `auto` or, with the generic kernel, `generic`. The view may also be a path of the scene.
        for (generic, name) in [(false, "auto"), (true, "generic")] {
            let mut settings = settings.clone();
            (settings.frame.variant, settings.frame.generic) = (None, generic);
            let path = Viewpoint::Path("sideways".to_owned());
            let file = save(&folder.0.join(name), name, &settings, &path, EXTENT).expect("it is saved");
            let definition = definition::load(&file).expect("it is read");
            assert_eq!(definition.variants, [name]);
            assert_eq!(definition.views, ["sideways"]);
        }
        let names: Vec<String> = definitions(&folder.0).iter().map(|file| super::name(file)).collect();
        assert_eq!(names, ["auto", "generic", "other", "painted", "seen"]);
        assert_eq!(definitions(&folder.0.join("other")), [folder.0.join("other").join("other.toml")]);
        assert_eq!(definitions(&file), std::slice::from_ref(&file));
        assert!(definitions(&folder.0.join("nowhere")).is_empty());
        assert_eq!(lacks(&file), None);
    }

    #[test]
    fn a_definition_whose_terrain_is_not_there_lacks_it() {
        let folder = Folder::new("lacking");
        let file = folder.0.join("imported.toml");
        let plain = "name = \"imported\"\nquestion = \"?\"\nviews = [\"ground\"]\nsize = [8, 8]\nframes = 1\nvariants = [\"splat\"]\n";
        let import = "[import]\nheightmap = \"height.png\"\nmetres_per_texel = 10.0\nheight_range_m = [0.0, 9.0]\n";
        fs::write(&file, format!("{plain}{import}")).expect("can be written");
        let lacking = lacks(&file).expect("there is no heightmap");
        assert!(lacking.contains("there is no file") && lacking.contains("height.png") && lacking.lines().count() == 1, "{lacking}");
        fs::write(folder.0.join("height.png"), b"not looked at").expect("can be written");
        assert_eq!(lacks(&file), None);
        fs::write(&file, "name = 1").expect("can be written");
        assert!(lacks(&file).is_some_and(|lacking| lacking.contains("imported.toml:1")), "{:?}", lacks(&file));
    }

    #[test]
    fn a_place_between_cameras_becomes_one() {
        let folder = Folder::new("free");
        let pose = Pose { position: DVec3::new(12.5, -7.25, 431.0), yaw: -0.3, pitch: 0.2, fov: 1.0 };
        let mut settings = settings();
        for (walking, name) in [(false, "workbench"), (true, "workbench-2")] {
            let folder = folder.0.join(name);
            let file = save(&folder, name, &settings, &Viewpoint::Free { pose, walking }, EXTENT).expect("it is saved");
            let definition = definition::load(&file).expect("it is read");
            assert_eq!(definition.views, [name]);
            let scene = saved_scene(&definition, &settings.scene);
            let camera = scene.cameras.last().expect("one was added");
            assert_eq!((camera.name.as_str(), scene.cameras.len()), (name, settings.scene.cameras.len() + 1));
            let found = Pose::of(camera, |_, _| 400.0);
            let expected = pose.position.with_z(if walking { 400.0 + EYE_M } else { 431.0 });
            assert_eq!(found.position, expected);
            // Converting to degrees and back does not keep the last bits.
            for (a, b) in found.axes().into_iter().zip(pose.axes()) {
                assert!((a - b).length() < 1e-14, "{a} {b}");
            }
            assert!((found.fov - pose.fov).abs() < 1e-15);
            settings.scene = scene;
        }
    }

    #[test]
    fn files_of_a_scene_are_found_from_the_copy() {
        let folder = Folder::new("paths");
        fs::create_dir_all(folder.0.join("scene").join("rock")).expect("a temporary folder");
        fs::write(folder.0.join("scene").join("height.png"), b"not looked at").expect("a temporary file");
        let mut settings = settings();
        settings.scene.folder = folder.0.join("scene");
        settings.scene.world = World::Heightmap {
            file: PathBuf::from("height.png"),
            metres_per_texel: 2.0,
            height_range_m: [0.0, 100.0],
            detail_m: 0.0,
            seed: 0,
            holes: Vec::new(),
            colour_modulation: 0.0,
        };
        let rock = &mut settings.scene.materials[0];
        (rock.procedural, rock.folder) = (None, Some(PathBuf::from("rock")));
        let file = save(&folder.0.join("seen"), "seen", &settings, &camera("cliff"), EXTENT).expect("it is saved");
        let scene = definition::load(&file).expect("it is read").scene(&None, None).expect("its files are found");
        let World::Heightmap { file, .. } = &scene.world else { panic!("another world") };
        assert!(file.is_absolute() && file.is_file(), "{}", file.display());
        let rock = scene.materials[0].folder.as_ref().expect("a folder");
        assert!(rock.is_absolute() && rock.is_dir(), "{}", rock.display());
    }

    #[test]
    fn choices_of_the_frame_are_saved_as_a_run_makes_them() {
        let folder = Folder::new("frame-choices");
        let mut settings = settings();
        settings.frame.variant = Some(Variant::only(Flavour::Splat));
        let frame = &mut settings.frame;
        (frame.generic, frame.seed, frame.reseeds, frame.two_tilings) = (true, u32::MAX, true, true);
        (frame.lod_bias, frame.vertex_stride, frame.normals) = (0.75, 4, NormalEncoding::PlaneFirst);
        let file = save(&folder.0.join("seen"), "seen", &settings, &camera("cliff"), EXTENT).expect("it is saved");
        let definition = definition::load(&file).expect("it is read");
        assert_eq!(definition.variant_choices().expect("a variant"), [("generic-splat".to_owned(), settings.choice())]);
        let choices = definition.frame_settings(&None).expect("choices");
        let pose = Pose { position: glam::DVec3::ZERO, yaw: 0.0, pitch: 0.0, fov: 1.0 };
        for frame in [0, 3] {
            let (run, seen) = (choices.request(pose, EXTENT.size, frame), settings.request(pose, EXTENT.size, frame, &[]));
            let of = |r: &kernels::frame::RenderRequest| {
                (r.shading.frame, r.shading.seed, r.shading.two_tilings, r.geometry.lod_bias, r.geometry.vertex_stride, r.geometry.normals)
            };
            assert_eq!(of(&run), of(&seen));
        }
    }

    #[test]
    fn what_cannot_be_said_is_refused_and_nothing_is_left() {
        let folder = Folder::new("refused");
        let error = |name: &str, change: &dyn Fn(&mut Settings), viewpoint: &Viewpoint, extent: Extent| {
            let mut settings = settings();
            change(&mut settings);
            let error = save(&folder.0.join("seen"), name, &settings, viewpoint, extent).expect_err("refused");
            assert_eq!(folder.names().len(), 0, "{error:#}");
            let text = format!("{error:#}");
            assert_eq!(text.lines().count(), 1, "{text}");
            text
        };
        let cliff = camera("cliff");
        let settings_that = |change: &dyn Fn(&mut Settings)| error("seen", change, &cliff, EXTENT);
        assert!(settings_that(&|s| s.scene.flavours.cliff_near_m = 9000.0).contains("cliff_near_m"));
        let nothing = |_: &mut Settings| {};
        for name in ["", "a b", "../a", "Scene"] {
            assert!(error(name, &nothing, &cliff, EXTENT).starts_with(&format!("`{name}`")), "{name}");
        }
        assert!(error("seen", &nothing, &camera("nowhere"), EXTENT).contains("no camera or path `nowhere`"));
        assert!(error("seen", &nothing, &cliff, Extent { seeds: 1, ..EXTENT }).contains("seeds"));
        let path = Viewpoint::Path("sideways".to_owned());
        assert!(error("seen", &nothing, &path, Extent { frames: 1000, ..EXTENT }).contains("more than path `sideways` has"));
        let twice = |s: &mut Settings| s.scene.cameras[0].name = "sideways".to_owned();
        assert!(error("seen", &twice, &path, EXTENT).contains("rename one"));
    }

    #[test]
    fn a_folder_that_exists_is_not_written_over() {
        let folder = Folder::new("twice");
        let seen = folder.0.join("seen");
        let file = save(&seen, "seen", &settings(), &camera("cliff"), EXTENT).expect("it is saved");
        let before = fs::read(&file).expect("written");
        let error = save(&seen, "seen", &settings(), &camera("ground"), EXTENT).expect_err("it is there").to_string();
        assert!(error.contains("seen already exists") && error.contains("choose another name"), "{error}");
        assert_eq!((fs::read(&file).expect("still there"), folder.names().len()), (before, 1));
        // A file, or an empty folder, is not overwritten either.
        fs::write(folder.0.join("file"), b"x").expect("a temporary file");
        fs::create_dir(folder.0.join("empty")).expect("a temporary folder");
        for name in ["file", "empty"] {
            assert!(save(&folder.0.join(name), "seen", &settings(), &camera("cliff"), EXTENT).is_err(), "{name}");
        }
    }

    #[cfg(unix)]
    fn shell(script: &str) -> Run {
        let mut command = Command::new("sh");
        command.arg("-c").arg(script);
        Run::follow(command, "trial".to_owned(), || {}).expect("there is a shell")
    }

    #[cfg(unix)]
    fn wait(run: &Run, what: &str, done: impl Fn(&Run) -> bool) {
        let began = Instant::now();
        while !done(run) {
            assert!(began.elapsed() < Duration::from_secs(60), "{what} did not come: {}", run.progress());
            thread::sleep(NAP);
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_run_says_what_it_does_and_what_came_of_it() {
        let folder = Folder::new("outcomes");
        fs::write(folder.0.join("report.md"), "# Question\n\nAnswer").expect("a temporary file");
        let page = folder.0.join("report.html");
        let run = shell(&format!("echo 'trial (%): 25/100' >&2; echo '  report: {}'", page.display()));
        wait(&run, "the end", Run::is_done);
        assert_eq!(run.outcome(), Some(Ok(Report { page, excerpt: "# Question\n\nAnswer".to_owned() })));
        for (script, says) in [
            ("echo 'error: no such file: give one' >&2; exit 1", "no such file: give one"),
            ("echo 'x: 1/2'; exit 3", "x: 1/2"),
            ("echo '  report: x.html'; echo 'error: the disk is full' >&2; exit 1", "the disk is full"),
            ("exit 0", "without a report"),
        ] {
            let run = shell(script);
            wait(&run, "the end", Run::is_done);
            let error = run.outcome().expect("it ended").expect_err(script);
            assert!(error.contains(says), "{script}: {error}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_run_is_stopped_when_asked_and_when_dropped() {
        const ENDLESS: &str = "echo $$; exec sleep 600";
        let run = shell(ENDLESS);
        wait(&run, "a word", |run| !run.progress().is_empty());
        assert!(!run.is_done() && run.outcome().is_none());
        // If the tests run in the background of a shell, the process may ignore the interrupt of the first call. The second call kills the process.
        run.cancel();
        thread::sleep(Duration::from_millis(500));
        run.cancel();
        wait(&run, "the end", Run::is_done);
        assert!(run.outcome().expect("it ended").expect_err("no report").starts_with("stopped"));

        let run = shell(ENDLESS);
        wait(&run, "a word", |run| !run.progress().is_empty());
        let shared = run.shared.clone();
        drop(run);
        let began = Instant::now();
        while lock(&shared.said).outcome.is_none() {
            assert!(began.elapsed() < Duration::from_secs(60), "the process still runs");
            thread::sleep(NAP);
        }
    }
}

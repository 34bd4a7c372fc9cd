//! Code shared by several tests: the small scene and its renderers, statistics, the built program, imported scenes, and temporary folders.
//!
//! Most tests that draw share two renderers of a small scene, because software Vulkan takes a tenth of a second to two seconds to compile a pipeline.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::SystemTime;

use kernels::base::error::Error;
use kernels::base::wgsl::Wgsl;
use kernels::decode::heightmap::ReadOptions;
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer, shader_files};
use kernels::gpu::{Gpu, GpuOptions, Sources};
use kernels::import::scene_folder::{self, ImportOptions};
use kernels::scene;
use kernels::view::camera::Pose;
use statrs::distribution::{ContinuousCDF, StudentsT};

pub(crate) const SIZE: [u32; 2] = [96, 64];

/// The built-in scene with small textures and without anisotropic filtering. Tests compare the other estimators with stochastic texture filtering
/// (`stf`), which cannot filter anisotropically.
pub(crate) fn small_scene() -> scene::Scene {
    let mut scene = scene::parse(scene::DEFAULT_TEXT, "default", Path::new(".")).expect("the built-in scene is valid");
    scene.detail_size = 64;
    scene.blend.anisotropy = 1;
    scene
}

/// Opens a device for tests. `make mutants` runs the tests with shaders that have one deliberate fault. It sets SCREE_MUTANT to a folder with the
/// changed shader files, which then replace the built-in ones.
pub(crate) fn open(options: GpuOptions) -> Gpu {
    let gpu = Gpu::with(options).expect("these tests need an adapter; `make setup` installs a software one");
    if let Some(folder) = std::env::var_os("SCREE_MUTANT") {
        let folder = Path::new(&folder);
        let planted: Vec<&Wgsl> = wgsl_files().into_iter().filter(|file| folder.join(file.path).is_file()).collect();
        assert!(!planted.is_empty(), "{} holds no shader", folder.display());
        gpu.override_shaders(Arc::new(Sources::read(folder, &planted).expect("a mutant")));
    }
    gpu
}

/// Returns the text of a WGSL file, or its replacement from the folder SCREE_MUTANT. For tests that put the text into another module.
pub(crate) fn wgsl_text(file: &Wgsl) -> String {
    let planted = std::env::var_os("SCREE_MUTANT").map(|folder| Path::new(&folder).join(file.path)).filter(|path| path.is_file());
    planted.map_or_else(|| file.text.to_owned(), |path| std::fs::read_to_string(path).expect("a mutant"))
}

/// Returns every WGSL file. Files that several modules use occur more than once.
pub(crate) fn wgsl_files() -> Vec<&'static Wgsl> {
    let mut files = shader_files();
    for module in [&kernels::temporal::MODULE, &kernels::metrics::MODULE, &kernels::metrics::SEEDS_MODULE] {
        files.extend(module.files());
    }
    files.extend(kernels::shared::WGSL);
    files
}

pub(crate) fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Gpu> = OnceLock::new();
    GPU.get_or_init(|| open(GpuOptions::default()))
}

fn shared(index: usize) -> MutexGuard<'static, Renderer<'static>> {
    static RENDERERS: [OnceLock<Mutex<Renderer<'static>>>; 2] = [OnceLock::new(), OnceLock::new()];
    let make = || Mutex::new(Renderer::new(gpu(), &small_scene(), &|_| {}).expect("the small scene renders"));
    RENDERERS[index].get_or_init(make).lock().unwrap_or_else(PoisonError::into_inner)
}

/// The renderer of the small scene, locked for one test at a time.
pub(crate) fn renderer() -> MutexGuard<'static, Renderer<'static>> {
    shared(0)
}

/// A second renderer of the small scene, for tests that do not use the shaders of the 31 variants. Such tests need not wait until a test that uses
/// the first renderer has compiled those shaders.
pub(crate) fn second_renderer() -> MutexGuard<'static, Renderer<'static>> {
    shared(1)
}

pub(crate) fn pose(renderer: &Renderer<'_>, camera: &str) -> Pose {
    let scene = renderer.scene();
    let camera = scene.cameras.iter().find(|c| c.name == camera).expect("a camera of the built-in scene");
    Pose::of(camera, |x, y| renderer.ground_m(x, y))
}

pub(crate) fn request(renderer: &Renderer<'_>, camera: &str) -> RenderRequest {
    let aovs = AovSet::from_names(&["albedo"]).expect("known layers");
    RenderRequest::new(pose(renderer, camera), SIZE).with(|r| {
        r.outputs.aovs = aovs;
        r.outputs.keep_geometry = true;
    })
}

pub(crate) fn terrain(picture: &Picture) -> Vec<bool> {
    picture.hdr.iter().map(|t| t[3] > 0.0).collect()
}

/// Largest difference between the albedo layers of two pictures, in units of 2^-11 of the larger value. Such a unit is half to one unit in the last
/// place of f16, the format of the G-buffer. Values below 2^-10 count as 2^-10.
pub(crate) fn largest_difference(a: &Picture, b: &Picture) -> f64 {
    let (left, right) = (a.vectors("albedo").expect("asked for"), b.vectors("albedo").expect("asked for"));
    let pairs = left.iter().flatten().zip(right.iter().flatten());
    pairs.map(|(&l, &r)| f64::from((l - r).abs()) / (f64::from(l.abs().max(r.abs())).max(1.0 / 1024.0) / 2048.0)).fold(0.0, f64::max)
}

/// Two-sided p-value of the hypothesis that independent samples have mean zero (Student's t-test).
pub(crate) fn p_of_zero_mean(samples: &[f64]) -> f64 {
    let n = samples.len() as f64;
    let mean = samples.iter().sum::<f64>() / n;
    let variance = samples.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let t = mean / (variance / n).sqrt();
    let student = StudentsT::new(0.0, 1.0, n - 1.0).expect("more than one sample");
    2.0 * student.cdf(-t.abs())
}

/// p-value of the hypothesis that independent vectors have mean zero in every component. The components of one vector may depend on each other.
///
/// One half of the vectors gives each component a weight: its mean there. The other half is tested: the sum of the components times their weights has
/// mean zero for each vector, because the weights do not depend on this half. A deviation that all vectors share gets weights of its own signs, so it
/// is found whatever its pattern is. Both halves are tested with the weights of the other, and the smaller p-value is doubled (Bonferroni). Components
/// with a weight of at most `least` are left out, so that rounding errors, which are equal in all vectors, are not found.
pub(crate) fn p_of_zero_means(vectors: &[Vec<f64>], least: f64) -> f64 {
    let (first, second) = vectors.split_at(vectors.len() / 2);
    let p = |weighing: &[Vec<f64>], tested: &[Vec<f64>]| {
        let mean = |component: usize| weighing.iter().map(|vector| vector[component]).sum::<f64>() / weighing.len() as f64;
        let weights: Vec<f64> = (0..weighing[0].len()).map(mean).map(|mean| if mean.abs() > least { mean } else { 0.0 }).collect();
        let sum = |vector: &Vec<f64>| vector.iter().zip(&weights).map(|(value, weight)| value * weight).sum();
        p_of_zero_mean(&tested.iter().map(sum).collect::<Vec<f64>>())
    };
    (2.0 * p(first, second).min(p(second, first))).min(1.0)
}

/// Path of the program `experiments`, which is in the folder above the folder of this test binary. Panics if the program is missing or older than its
/// sources, because a test of a stale program would prove nothing.
pub(crate) fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let here = std::env::current_exe().expect("the path of the test binary is known");
        let folder = here.parent().and_then(Path::parent).expect("tests lie in target/PROFILE/deps");
        let program = folder.join(format!("experiments{}", std::env::consts::EXE_SUFFIX));
        let profile = if folder.ends_with("release") { " --release" } else { "" };
        let remedy = format!("run `cargo build{profile} -p experiments` first, or `make test`");
        assert!(program.is_file(), "{} is missing: {remedy}", program.display());
        let built = fs::metadata(&program).and_then(|m| m.modified()).expect("the program file has a modification time");
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let newest = newest_source(&root.join("experiments/src")).max(newest_source(&root.join("kernels/src")));
        if let Some((time, source)) = newest {
            assert!(time <= built, "{} is older than {}: {remedy}", program.display(), source.display());
        }
        program
    })
}

/// The source file in a folder and its subfolders that was changed last, and the time of the change.
fn newest_source(folder: &Path) -> Option<(SystemTime, PathBuf)> {
    let entries = fs::read_dir(folder).ok()?.filter_map(Result::ok).map(|entry| entry.path());
    let newest = entries.filter_map(|path| match path.extension().and_then(|e| e.to_str()) {
        None if path.is_dir() => newest_source(&path),
        Some("rs" | "wgsl" | "toml") => Some((fs::metadata(&path).and_then(|m| m.modified()).ok()?, path)),
        _ => None,
    });
    newest.max()
}

pub(crate) fn run(arguments: &[&str]) -> Output {
    Command::new(program()).args(arguments).output().expect("the program can be started")
}

pub(crate) fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).expect("the program writes UTF-8")
}

/// Checks that the call is refused because its arguments are wrong: exit status 2, nothing on stdout, and one line on stderr that contains all of
/// `says`.
pub(crate) fn usage_error(arguments: &[&str], says: &[&str]) {
    let output = run(arguments);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    assert!(output.stdout.is_empty(), "{arguments:?} wrote to stdout");
    for part in says {
        assert!(stderr.contains(part), "{arguments:?}: `{part}` is not in: {stderr}");
    }
    // Only a call without arguments is answered with more than one line: the help text.
    assert!(arguments.is_empty() || stderr.lines().count() == 1, "{arguments:?}: {stderr:?}");
    assert!(!stderr.contains("internal error"), "{arguments:?}: {stderr}");
}

/// Checks that the program starts its work and fails: exit status 1, and one line on stderr that contains all of `says`.
pub(crate) fn failure(arguments: &[&str], says: &[&str]) {
    let output = run(arguments);
    let stderr = text(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {stderr}");
    assert!(stderr.starts_with("error: ") && stderr.ends_with('\n') && stderr.lines().count() == 1, "{arguments:?}: {stderr:?}");
    for part in says {
        assert!(stderr.contains(part), "{arguments:?}: `{part}` is not in: {stderr}");
    }
}

/// Checks that the exit status is 0. Returns the text on stdout.
pub(crate) fn success(arguments: &[&str]) -> String {
    let output = run(arguments);
    assert_eq!(output.status.code(), Some(0), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// The path of a file in `tests/cases`.
pub(crate) fn case(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("cases").join(name)
}

/// Imports a heightmap into the folder `out`, and loads the scene that was written there.
pub(crate) fn import_scene(source: &Path, options: &ImportOptions, out: &Path) -> scene::Scene {
    scene_folder::import(source, options, out).unwrap_or_else(|error| panic!("{error}"));
    scene::load(&out.display().to_string()).unwrap_or_else(|error| panic!("{error}"))
}

/// Imports a map of 201 x 150 samples, 4.3 m apart, as a scene. The map ends 430 m east and 320.35 m north of its centre. Vertices are 4 m apart at
/// LOD 3, the finest one, so no LOD has vertices exactly on the edges of the map. The ground rises steeply to the east and gently to the south.
pub(crate) fn island(temp: &Folder) -> scene::Scene {
    let (size, spacing) = ([201, 150], 4.3);
    let centred = |index: u32, count: u32| (f64::from(index) - f64::from(count - 1) / 2.0) * spacing;
    let height = |x: f64, y: f64| 500.0 + 0.6 * x - 0.15 * y + 5.0 * (x / 60.0).sin();
    let samples = (0..size[0] * size[1]).map(|k| height(centred(k % size[0], size[0]), -centred(k / size[0], size[1])) as f32);
    let file = temp.0.join("island.r32");
    fs::write(&file, samples.flat_map(f32::to_le_bytes).collect::<Vec<u8>>()).expect("a temporary file can be written");
    let read = ReadOptions { metres_per_texel: Some(spacing), raw_size: Some(size), ..ReadOptions::default() };
    import_scene(&file, &ImportOptions { read, ..ImportOptions::default() }, &temp.0.join("island"))
}

/// Imports a map of 257 x 257 samples, 1 m apart, as a scene: ground that rises by 1 mm per metre to the east.
pub(crate) fn level_ground(temp: &Folder) -> scene::Scene {
    let size = [257, 257];
    let samples = (0..size[0] * size[1]).map(|k| 100.0 + 0.001 * (k % size[0]) as f32);
    let file = temp.0.join("level.r32");
    fs::write(&file, samples.flat_map(f32::to_le_bytes).collect::<Vec<u8>>()).expect("a temporary file can be written");
    let read = ReadOptions { metres_per_texel: Some(1.0), raw_size: Some(size), ..ReadOptions::default() };
    import_scene(&file, &ImportOptions { read, ..ImportOptions::default() }, &temp.0.join("level"))
}

/// The text of an error. Panics if nothing was refused, or if the text is not one line.
pub(crate) fn one_line<T>(result: Result<T, Error>) -> String {
    let Err(error) = result else { panic!("nothing was refused") };
    let text = error.to_string();
    assert!(!text.contains(char::is_control), "an error is one line: {text:?}");
    text
}

/// Checks that a text contains all of `words`.
pub(crate) fn has(text: &str, words: &[&str]) {
    for word in words {
        assert!(text.contains(word), "`{word}` is missing in: {text}");
    }
}

/// A temporary folder of one test. It is removed from the disk when this value is dropped.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    pub(crate) fn new(name: &str) -> Folder {
        // Two tests that run at the same time may give the same name.
        static COUNT: AtomicUsize = AtomicUsize::new(0);
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = std::env::temp_dir().join(format!("scree-test-{name}-{}-{number}", std::process::id()));
        fs::create_dir_all(&path).expect("the temporary folder can be made");
        Folder(path)
    }

    pub(crate) fn path(&self, name: &str) -> String {
        self.0.join(name).display().to_string()
    }

    pub(crate) fn write(&self, name: &str, contents: &str) -> String {
        fs::write(self.0.join(name), contents).expect("a temporary file can be written");
        self.path(name)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

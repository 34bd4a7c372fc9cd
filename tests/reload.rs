//! Tests shaders that are edited while they are in use: which stages are rebuilt, what stays unchanged, and which error a mistake causes.
//!
//! Each test has a device of its own, because edited shader texts replace the embedded ones for all users of a device.

use std::path::{Path, PathBuf};

use kernels::base::error::{Error, Result};
use kernels::display::ToneCurve;
use kernels::frame::picture::Picture;
use kernels::frame::{ReloadReport, RenderRequest, Renderer, VariantChoice, shader_files};
use kernels::gpu::{Gpu, Sources};
use kernels::variant::{Flavour, Variant};
use workbench::model::state::Model;
use workbench::model::viewpoint::Viewpoint;
use workbench::script::Stage;

use crate::workbench::take;

use crate::fixtures::{request, small_scene, terrain};

const LIGHTING: &str = "lighting/lighting.wgsl";
const LIGHT: &str = "lighting/light.wgsl";
const LIT: &str = "return vec4<f32>(lighting_radiance(surface, ray), 1.0);";
const LIT_BY_HALF: &str = "return vec4<f32>(0.5 * lighting_radiance(surface, ray), 1.0);";
/// Returns NaN, infinity and a finite number. The first two are computed from the index of the pixel, so that the compiler cannot know them.
const LIT_BY_NO_NUMBER: &str =
    "return vec4<f32>(bitcast<f32>(0x7fc00000u | (index.x & 1u)), bitcast<f32>(0x7f800000u + (index.x - index.x)), 0.25, 1.0);";
const DISPLAY: &str = "display/display.wgsl";
const NORMAL: &str = "let normal_smoothness = textureLoad(g_normal, index, 0);";
const NO_SUCH_NAME: &str = "let normal_smoothness = textureLoad(no_such_name, index, 0);";

/// A folder with a copy of the embedded shaders.
struct Folder(PathBuf);

impl Folder {
    fn new(test: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("scree-shaders-{test}-{}", std::process::id()));
        copy(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../kernels/src"), &path);
        Folder(path)
    }

    /// Replaces text that occurs exactly once in a file. Returns the number of its line, counted from 1.
    fn edit(&self, name: &str, from: &str, to: &str) -> usize {
        let file = self.0.join(name);
        let text = std::fs::read_to_string(&file).expect("a shader");
        assert_eq!(text.matches(from).count(), 1, "{name}: {from}");
        std::fs::write(&file, text.replace(from, to)).expect("written");
        text.lines().position(|line| line.contains(from)).expect("counted just above") + 1
    }

    fn append(&self, name: &str, text: &str) {
        let file = self.0.join(name);
        let before = std::fs::read_to_string(&file).expect("a shader");
        std::fs::write(&file, before + text).expect("written");
    }

    fn sources(&self) -> Result<Sources> {
        Sources::read(&self.0, &shader_files())
    }

    fn reload(&self, renderer: &mut Renderer<'_>) -> Result<ReloadReport> {
        renderer.reload_shaders(self.sources()?)
    }

    fn refused(&self, renderer: &mut Renderer<'_>) -> String {
        self.reload(renderer).expect_err("a mistake").to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // An error is ignored: it only means that temporary files are not removed.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Copies the WGSL files of a folder and its subfolders.
fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).expect("a folder");
    for entry in std::fs::read_dir(from).expect("the sources") {
        let from = entry.expect("an entry").path();
        let to = to.join(from.file_name().expect("a name"));
        if from.is_dir() {
            copy(&from, &to);
        } else if from.extension().is_some_and(|e| e == "wgsl") {
            std::fs::write(&to, std::fs::read(&from).expect("a shader")).expect("copied");
        }
    }
}

fn draw(renderer: &mut Renderer<'_>, request: &RenderRequest) -> Picture {
    renderer.render(request).expect("renders")
}

/// Whether the radiance in `dim` is half of that in `bright` on terrain, and equal to it in the sky.
fn is_half_of(dim: &Picture, bright: &Picture) -> bool {
    dim.hdr.iter().zip(&bright.hdr).zip(terrain(bright)).all(|((dim, bright), on)| {
        let share = if on { 0.5 } else { 1.0 };
        (0..3).all(|i| (dim[i] - share * bright[i]).abs() <= 1e-5 * bright[i].abs())
    })
}

#[test]
fn an_edit_is_drawn_and_a_mistake_is_named_and_changes_nothing() {
    let folder = Folder::new("mistakes");
    assert!(
        folder.sources().expect("the folder has all files").is_empty(),
        "a file differs from the embedded one, or is not at the path that its name gives"
    );
    let gpu = Gpu::new().expect("an adapter");
    let mut renderer = Renderer::new(&gpu, &small_scene(), &|_| {}).expect("the small scene renders");
    // The files in the folder equal the embedded ones, so nothing is built.
    assert_eq!(folder.reload(&mut renderer).expect("no change"), ReloadReport::default());
    // The test draws one cheap variant, because compiling takes most of the time of these tests.
    let request = forced(&renderer, Flavour::FarAtlas.bit());
    let first = draw(&mut renderer, &request);
    assert!(!is_half_of(&first, &first), "negative control: a picture is not half of itself");

    folder.edit(LIGHTING, LIT, LIT_BY_HALF);
    let report = folder.reload(&mut renderer).expect("compiles");
    assert_eq!((report.files, report.stages), (vec![LIGHTING.to_owned()], vec!["lighting"]));
    let dim = draw(&mut renderer, &request);
    assert!(is_half_of(&dim, &first));
    // Reloading the same files again changes nothing.
    assert_eq!(folder.reload(&mut renderer).expect("no change"), ReloadReport::default());

    // Each kind of mistake is reported with its place, and the picture stays as it was.
    let stays = |renderer: &mut Renderer<'_>| assert_eq!(draw(renderer, &request).hdr, dim.hdr);
    let line = folder.edit(LIGHTING, NORMAL, NO_SUCH_NAME);
    let error = folder.refused(&mut renderer);
    assert!(error.contains(&format!("{LIGHTING}:{line}: ")) && error.contains("`no_such_name`"), "{error}");
    assert!(!error.contains('\n') && !error.contains('│'), "{error}");
    stays(&mut renderer);
    folder.edit(LIGHTING, NO_SUCH_NAME, NORMAL);

    let line = folder.edit(LIGHT, "let n_dot_v = max(dot(n, v), 1e-3);", "let n_dot_v = max(dot(n, v), vec3<f32>(1e-3));");
    let error = folder.refused(&mut renderer);
    assert!(error.contains(&format!("{LIGHT}:{line}: ")), "{error}");
    stays(&mut renderer);
    folder.edit(LIGHT, "max(dot(n, v), vec3<f32>(1e-3))", "max(dot(n, v), 1e-3)");

    folder.edit(LIGHTING, "fn lighting_fragment(", "fn lighting_fragments(");
    let error = folder.refused(&mut renderer);
    assert!(error.contains(LIGHTING) && error.contains("lighting_fragment"), "{error}");
    stays(&mut renderer);
    folder.edit(LIGHTING, "fn lighting_fragments(", "fn lighting_fragment(");

    let line = folder.edit("shared/hash.wgsl", "fn hash_pcg(v: u32) -> u32 {", "fn hash_pcg(v: u32) -> u33 {");
    let error = folder.refused(&mut renderer);
    assert!(error.contains(&format!("shared/hash.wgsl:{line}: ")), "{error}");
    stays(&mut renderer);
    folder.edit("shared/hash.wgsl", "-> u33 {", "-> u32 {");

    // While an editor saves a file, the file may be empty or missing for a moment.
    let text = std::fs::read(folder.0.join(LIGHTING)).expect("a shader");
    std::fs::write(folder.0.join(LIGHTING), "").expect("emptied");
    let error = folder.refused(&mut renderer);
    assert!(error.contains(LIGHTING), "{error}");
    std::fs::remove_file(folder.0.join(LIGHTING)).expect("removed");
    let error = folder.refused(&mut renderer);
    assert!(error.starts_with(&*folder.0.join(LIGHTING).to_string_lossy()), "{error}");
    stays(&mut renderer);
    std::fs::write(folder.0.join(LIGHTING), text).expect("written");

    // Refused shaders affect no other renderer of the device: a new renderer draws with the last shaders that compiled.
    let mut other = Renderer::new(&gpu, &small_scene(), &|_| {}).expect("the small scene renders");
    assert_eq!(draw(&mut other, &request).hdr, dim.hdr);

    folder.edit(LIGHTING, LIT_BY_HALF, LIT);
    assert_eq!(folder.reload(&mut renderer).expect("compiles").stages, ["lighting"]);
    assert_eq!(draw(&mut renderer, &request).hdr, first.hdr);
    gpu.check().expect("the device reports no error");
}

#[test]
fn a_change_of_the_display_alters_what_is_shown_and_nothing_that_is_measured() {
    let folder = Folder::new("display");
    let gpu = Gpu::new().expect("an adapter");
    let mut renderer = Renderer::new(&gpu, &small_scene(), &|_| {}).expect("the small scene renders");
    let request = forced(&renderer, Flavour::FarAtlas.bit()).with(|r| r.outputs.displayed = true);
    let first = draw(&mut renderer, &request);
    folder.edit(DISPLAY, "display_encode(texel.rgb,", "display_encode(texel.rgb * 0.0,");
    let report = folder.reload(&mut renderer).expect("compiles");
    assert_eq!((report.files, report.stages), (vec![DISPLAY.to_owned()], vec!["display"]));
    let black = draw(&mut renderer, &request);
    let codes = |picture: &Picture| picture.displayed.clone().expect("asked for");
    assert_eq!(black.hdr, first.hdr);
    assert!(codes(&black).iter().all(|code| code[..3] == [0; 3]) && codes(&first).iter().any(|code| code[..3] != [0; 3]));
    folder.edit(DISPLAY, "display_encode(texel.rgb * 0.0,", "display_encode(texel.rgb,");

    // With the tone curve `clip`, a channel whose radiance is NaN is displayed as 0, and a channel whose radiance is infinite as 255. The third
    // channel must not be affected.
    folder.edit(LIGHTING, LIT, LIT_BY_NO_NUMBER);
    let report = folder.reload(&mut renderer).expect("compiles");
    assert_eq!(report.stages, ["lighting", "display"]);
    let clipped = request.with(|r| r.stages.display.tone_curve = ToneCurve::Clip);
    let picture = draw(&mut renderer, &clipped);
    let mut count = 0;
    for (texel, code) in picture.hdr.iter().zip(codes(&picture)).filter(|(texel, _)| texel[3] > 0.0) {
        assert!(texel[0].is_nan() && texel[1] == f32::INFINITY && texel[2] == 0.25, "{texel:?}");
        assert_eq!(code, [0, 255, 137, 255]);
        count += 1;
    }
    assert!(count > 100, "{count} pixels of terrain");
}

fn forced(renderer: &Renderer<'_>, mask: u8) -> RenderRequest {
    request(renderer, "ground").with(|r| r.shading.variant = VariantChoice::Forced(Variant::new(mask).expect("a set")))
}

#[test]
fn stages_are_built_anew_whose_files_changed_and_pages_with_them() {
    let folder = Folder::new("stages");
    let gpu = Gpu::new().expect("an adapter");
    let mut renderer = Renderer::new(&gpu, &small_scene(), &|_| {}).expect("the small scene renders");
    let request = forced(&renderer, Flavour::FarAtlas.bit() | Flavour::VirtualTexture.bit());
    let first = draw(&mut renderer, &request);
    let pages = |picture: &Picture| (picture.report.pages.wanted, picture.report.pages.rendered);
    let (wanted, rendered) = pages(&first);
    assert!(wanted > 0 && rendered == wanted, "{wanted} pages, {rendered} rendered");
    assert_eq!(pages(&draw(&mut renderer, &request)), (wanted, 0));
    let all = ["geometry", "occlusion", "classification", "virtual texture", "shading", "lighting", "inspect", "composition", "links"];
    let cases: [(&str, &[&str], bool); 8] = [
        ("lighting/lighting.wgsl", &["lighting"], false),
        ("lighting/light.wgsl", &["lighting", "composition"], false),
        ("geometry/stitch.wgsl", &["geometry"], false),
        ("occlusion/pyramid.wgsl", &["occlusion"], false),
        ("virtual_texture/page.wgsl", &["virtual texture"], true),
        ("virtual_texture/virtual_texture.wgsl", &["virtual texture", "shading"], true),
        ("shared/signal.wgsl", &["composition"], false),
        ("view/frame.wgsl", &all, true),
    ];
    for (file, stages, pages_anew) in cases {
        folder.append(file, "// A remark.\n");
        let report = folder.reload(&mut renderer).expect("a remark compiles");
        assert_eq!((report.files, report.stages), (vec![file.to_owned()], stages.to_vec()));
        let picture = draw(&mut renderer, &request);
        assert_eq!(picture.hdr, first.hdr, "{file}");
        assert_eq!(pages(&picture), (wanted, if pages_anew { wanted } else { 0 }), "{file}");
    }
    // Each device uses only one of these two files.
    for file in ["classification/plain.wgsl", "classification/subgroup.wgsl"] {
        folder.append(file, "// A remark.\n");
        let used = (file == "classification/subgroup.wgsl") == gpu.features.contains(wgpu::Features::SUBGROUP);
        let report = folder.reload(&mut renderer).expect("a remark compiles");
        assert_eq!(report.stages, if used { vec!["classification"] } else { vec![] }, "{file}");
    }
}

#[test]
fn a_variant_that_alone_cannot_be_built_is_refused_when_it_is_wanted() {
    let folder = Folder::new("variant");
    let gpu = Gpu::new().expect("an adapter");
    let mut renderer = Renderer::new(&gpu, &small_scene(), &|_| {}).expect("the small scene renders");
    let forced = |variant| request(&renderer, "ground").with(|r| r.shading.variant = VariantChoice::Forced(variant));
    let (atlas, full) = (forced(Variant::only(Flavour::FarAtlas)), forced(Variant::new(31).expect("all five")));
    let first = draw(&mut renderer, &atlas);
    // The edit divides by 0 when a pipeline is specialised for the variant with all five flavours.
    let shading = "shading/shading.wgsl";
    folder.edit(
        "shading/pixel.wgsl",
        "override VARIANT: u32 = 0u;",
        "override VARIANT: u32 = 0u;\noverride BROKEN: u32 = 1u / (VARIANT ^ 31u);",
    );
    folder.edit(
        shading,
        "return shade(vec2<u32>(in.clip.xy), in.mask);",
        "return shade(vec2<u32>(in.clip.xy), in.mask + BROKEN - BROKEN);",
    );
    assert_eq!(folder.reload(&mut renderer).expect("compiles for the variant that was drawn").stages, ["shading"]);
    assert_eq!(draw(&mut renderer, &atlas).hdr, first.hdr);
    let error = renderer.render(&full).expect_err("cannot be built");
    // The request has failed, not the device, so the caller can keep the device.
    assert!(matches!(&error, Error::Request(text) if text.contains(shading)), "{error}");
    gpu.check().expect("the device reports no error");
    assert_eq!(draw(&mut renderer, &atlas).hdr, first.hdr);
    // If an edit breaks a variant that has already been drawn, the whole edit is refused.
    folder.edit("shading/pixel.wgsl", "(VARIANT ^ 31u)", "(VARIANT ^ 2u)");
    let error = folder.refused(&mut renderer);
    assert!(error.contains(shading), "{error}");
    assert_eq!(draw(&mut renderer, &atlas).hdr, first.hdr);
}

/// The application with the small scene and the shaders of a folder. Time and camera stand still.
fn stage(folder: &Folder) -> Stage {
    let mut stage = Stage::with_shaders(small_scene(), [1100, 700], Some(folder.0.clone()), |app| {
        app.model.clock.paused = true;
        app.model.settings.frame.variant = Some(Variant::only(Flavour::FarAtlas));
        app.model.settings.scale = 0.2;
        app.model.viewpoint = Viewpoint::Camera("ground".to_owned());
    });
    stage.settle().expect("a picture of the ground");
    stage
}

fn texels(model: &Model) -> &[[u8; 3]] {
    &model.shown().expect("a picture").texels
}

#[test]
fn the_workbench_starts_with_a_broken_shader_and_follows_the_folder() {
    let folder = Folder::new("workbench");
    folder.edit(LIGHTING, NORMAL, NO_SUCH_NAME);
    let mut stage = stage(&folder);
    stage.until("the complaint", |model| model.shader_error().is_some()).expect("an error");
    let error = stage.model().shader_error().expect("just seen").to_owned();
    assert!(error.contains(LIGHTING) && error.contains("no_such_name"), "{error}");
    let first = texels(stage.model()).to_vec();
    folder.edit(LIGHTING, NO_SUCH_NAME, NORMAL);
    stage.until("the mended shader", |model| model.shader_error().is_none()).expect("no error");
    assert_eq!(texels(stage.model()), first);
    let shaders = |stage: &mut Stage| stage.model().shown().expect("a picture").shaders;
    let before = shaders(&mut stage);
    // The picture must change without any input.
    folder.edit(LIGHTING, LIT, LIT_BY_HALF);
    stage.until("the edited shader", |model| texels(model) != first).expect("a picture");
    assert_eq!(stage.model().shader_error(), None);
    let dim = texels(stage.model()).to_vec();
    // Times of the old and the new shaders are not put into one statistic.
    let edited = shaders(&mut stage);
    assert_ne!(edited, before);
    // A run would not draw with the edited shaders, so the view cannot be saved as an experiment.
    let place = folder.0.display();
    take(&mut stage, &format!("click Experiments; type Folder = {place}; type Experiment name = dim; click Save as experiment"));
    assert!(stage.names().iter().any(|name| name.contains("the program's own shaders")), "{:?}", stage.names());
    assert!(!folder.0.join("dim").exists());
    let line = folder.edit(LIGHTING, NORMAL, NO_SUCH_NAME);
    stage.until("the complaint", |model| model.shader_error().is_some()).expect("an error");
    let error = stage.model().shader_error().expect("just seen").to_owned();
    assert!(error.contains(&format!("{LIGHTING}:{line}: ")), "{error}");
    assert!(stage.names().iter().any(|name| name.contains(LIGHTING)), "{:?}", stage.names());
    // Pictures must still be drawn with the last shaders that compiled. The test requests a different frame and then the same frame again, so that
    // the picture is really drawn again.
    let frame = stage.model().shown().expect("a picture").wish.frame;
    stage.model().clock.frame = frame + 1;
    stage.settle().expect("a picture");
    stage.model().clock.frame = frame;
    stage.settle().expect("a picture");
    assert_eq!(texels(stage.model()), dim);
    assert_eq!(shaders(&mut stage), edited);
    assert!(stage.model().shader_error().is_some(), "the error must be shown until the mistake is corrected");
    folder.edit(LIGHTING, NO_SUCH_NAME, NORMAL);
    stage.until("the mended shader", |model| model.shader_error().is_none()).expect("no error");
    assert_eq!(texels(stage.model()), dim);
    folder.edit(LIGHTING, LIT_BY_HALF, LIT);
    stage.until("the first shader", |model| texels(model) == first).expect("a picture");
}

//! The application without a window: tests operate controls by their accessible names, as screen readers do, and check the effects.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

use ::experiments::store::read_run;
use eframe::egui;
use kernels::base::section::mebibytes;
use kernels::frame::VariantChoice;
use kernels::scene::Scene;
use kernels::shared::noise::NoiseKind;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use kernels::world::payload::PAYLOAD_BYTES;
use workbench::engine::sketch;
use workbench::model::compare::{Mode, Other};
use workbench::model::display::Layer;
use workbench::model::panes::Pane;
use workbench::model::picture::Shown;
use workbench::model::settings::numbers;
use workbench::model::state::Model;
use workbench::model::viewpoint::{EYE_M, Viewpoint};
use workbench::script::{Stage, Step, steps};

use crate::fixtures::{Folder, gpu, program, small_scene};

const WINDOW: [u32; 2] = [1100, 1500];

/// Returns the application with a small scene. The clock is paused, the camera stands still, and the first picture has been drawn.
fn stage() -> Stage {
    standing(None)
}

/// Like [`stage`], but with one cheap variant, for tests in which the contents of the picture do not matter. Compiling takes most of the time of
/// these tests.
pub(crate) fn cheap_stage() -> Stage {
    standing(Some(Variant::only(Flavour::FarAtlas)))
}

fn standing(forced: Option<Variant>) -> Stage {
    let mut stage = Stage::prepared(small_scene(), WINDOW, |app| {
        app.model.clock.paused = true;
        app.model.settings.frame.variant = forced;
        app.model.settings.scale = 0.2;
        app.model.viewpoint = Viewpoint::Camera("ground".to_owned());
    });
    stage.settle().expect("a picture of the ground");
    stage
}

pub(crate) fn take(stage: &mut Stage, text: &str) {
    for step in steps(text).expect("steps") {
        stage.take(&step).unwrap_or_else(|error| panic!("{text}: {error:#}"));
    }
}

/// Returns the variants (sets of shading flavours) that at least one tile of the last picture uses.
fn running(stage: &mut Stage) -> Vec<Variant> {
    let shown = stage.model().shown().expect("a picture").clone();
    Variant::all().filter(|v| shown.picture.report.tiles[usize::from(v.mask())] > 0).collect()
}

#[test]
fn variants_are_forced_by_clicks_and_keys_and_undone() {
    let mut stage = stage();
    let automatic = running(&mut stage);
    assert!(automatic.len() > 1, "{automatic:?}");
    let splat = Variant::only(Flavour::Splat);
    take(&mut stage, "click Variant splat");
    assert_eq!(running(&mut stage), [splat]);
    // A second click returns to the automatic choice.
    take(&mut stage, "click Variant splat");
    assert_eq!(running(&mut stage), automatic);
    take(&mut stage, "key 5; key 1");
    assert_eq!(running(&mut stage), [Variant::new(17).expect("vt and splat")]);
    take(&mut stage, "key G");
    assert_eq!(
        stage.model().shown().expect("a picture").wish.settings.choice(),
        VariantChoice::GenericForced(Variant::new(17).expect("a set"))
    );
    take(&mut stage, "key 0; click Generic kernel");
    assert_eq!(running(&mut stage), automatic);
    // All 31 variants have a button.
    for variant in Variant::all() {
        assert!(stage.has(&format!("Variant {variant}")), "{variant}");
    }
    // The undo history stores a state that was unchanged for one second. Each call of `settle` advances the time of the window by a quarter of a
    // second, so 30 calls are enough to store the state with `far-atlas`.
    take(&mut stage, "click Variant far-atlas");
    for _ in 0..30 {
        stage.settle().expect("a picture");
    }
    take(&mut stage, "click Undo");
    assert_eq!(stage.model().settings.frame.variant, None);
    take(&mut stage, "click Redo");
    assert_eq!(stage.model().settings.frame.variant, Some(Variant::only(Flavour::FarAtlas)));
}

#[test]
fn every_parameter_is_set_and_reset_by_its_name() {
    let mut stage = cheap_stage();
    let original = stage.model().settings.scene.clone();
    for (setting, slider) in numbers() {
        let (name, value) = (setting.label(), |scene: &Scene| setting.get(scene).and_then(|value| value.as_float()).expect("a number"));
        let usual = value(&original);
        // The change is small, so that the scene stays valid.
        let wanted = usual + 0.01 * (slider.ends[1] - usual).abs().max(0.1);
        stage.take(&Step::Set(name.to_owned(), wanted)).unwrap_or_else(|e| panic!("{name}: {e:#}"));
        let now = value(&stage.model().shown().expect("a picture").wish.settings.scene);
        assert!(now != usual && (now - wanted).abs() <= 0.02 * wanted.abs(), "{name}: {now}, wanted {wanted}");
        stage.take(&Step::Click(format!("Reset {name}"))).unwrap_or_else(|e| panic!("{name}: {e:#}"));
        assert!(stage.model().settings.scene == original, "{name}");
    }
}

#[test]
fn a_processor_draws_half_of_the_pixels_a_side_unless_a_scale_was_chosen() {
    let drawn = |chosen: Option<f64>| {
        let mut stage = Stage::prepared(small_scene(), [640, 480], |app| {
            app.model.clock.paused = true;
            app.model.settings.frame.variant = Some(Variant::only(Flavour::FarAtlas));
            app.model.settings.scale = chosen.unwrap_or(app.model.settings.scale);
        });
        stage.settle().expect("a picture");
        let scale = stage.model().settings.scale;
        let [width, height] = stage.model().shown().expect("a picture").wish.size;
        // The user has changed nothing, so the click on Undo must not change the scale.
        take(&mut stage, "click Undo");
        assert_eq!(stage.model().settings.scale, scale);
        (scale, f64::from(width), f64::from(height))
    };
    let expected = if gpu().is_software() { 0.5 } else { 1.0 };
    let (automatic, chosen) = (drawn(None), drawn(Some(0.25)));
    assert_eq!((automatic.0, chosen.0), (expected, 0.25));
    // The size is proportional to the scale, except for rounding to a pixel.
    let times = expected / 0.25;
    assert!((automatic.1 - times * chosen.1).abs() <= times && (automatic.2 - times * chosen.2).abs() <= times, "{automatic:?} {chosen:?}");
}

#[test]
fn a_window_finds_nothing_of_the_one_before() {
    // Draws and measures three frames. The frame numbers of the second window follow those of the first, and the same thread probably draws both. So
    // measurements left over from the first window would be noticed.
    let seen = |frame: u32| {
        let mut stage = cheap_stage();
        stage.model().clock.frame = frame;
        take(&mut stage, "click Metrics; click Measure; key Period; key Period");
        let shown = stage.model().shown().expect("a picture").clone();
        assert_eq!(shown.wish.frame, frame + 2);
        let frames: Vec<u32> = shown.readings.iter().map(|reading| reading.frame).collect();
        assert_eq!(frames, [frame, frame + 1, frame + 2], "readings of this window alone");
        let last = shown.readings.last().and_then(|reading| reading.sides[0]).expect("measured");
        assert_eq!(last.frames, 3.0, "frames of this window alone");
        stage.model().settings.scene.sun.elevation_deg = 20.0;
        stage.model().viewpoint = Viewpoint::Camera("nowhere".to_owned());
        assert!(stage.settle().is_err(), "at the end, the drawing thread fails");
        shown.texels.clone()
    };
    let first = seen(0);
    // A window that has not requested a picture shows neither a picture nor an error.
    let mut stage = Stage::new(small_scene(), [1, 1]);
    for _ in 0..20 {
        stage.until("a drawing of the window", |_| true).expect("nothing is wrong");
        assert!(stage.model().shown().is_none() && stage.model().failure().is_none() && !stage.model().is_warm());
    }
    drop(stage);
    // The far atlas looks the same in every frame, so both windows must show the same texels. The first window changed the elevation of the sun
    // before it closed. This change must have no effect on a later window.
    assert!(seen(3) == first);
}

#[test]
fn a_scene_that_cannot_be_is_refused_and_the_picture_stays() {
    let mut stage = cheap_stage();
    let before = stage.model().shown().expect("a picture").texels.clone();
    stage.model().settings.scene.flavours.cliff_near_m = 9000.0;
    let error = stage.settle().expect_err("near cliff ends behind the far atlas").to_string();
    assert!(error.contains("cliff_near_m"), "{error}");
    // The window also shows the error, for as long as the scene is invalid.
    assert!(stage.settle().is_err() && stage.names().iter().any(|name| name.contains("cliff_near_m")), "{:?}", stage.names());
    assert_eq!(stage.model().shown().expect("still there").texels, before);
    stage.model().settings.scene = small_scene();
    stage.settle().expect("possible again");
    assert!(!stage.names().iter().any(|name| name.contains("cliff_near_m")));
}

#[test]
fn a_lost_device_is_made_anew_and_nothing_is_lost_with_it() {
    let mut stage = Stage::with_shaders(small_scene(), WINDOW, None, |app| {
        app.model.clock.paused = true;
        app.model.settings.frame.variant = Some(Variant::only(Flavour::FarAtlas));
        app.model.settings.scale = 0.2;
        app.model.viewpoint = Viewpoint::Camera("ground".to_owned());
    });
    stage.settle().expect("a picture");
    take(&mut stage, "set Sun above = 20");
    let before = stage.model().shown().expect("a picture").clone();
    stage.app().engine().lose_devices(1);
    stage.model().clock.frame += 1;
    stage.settle().expect("a picture by another device");
    let after = stage.model().shown().expect("a picture").clone();
    assert!(!std::sync::Arc::ptr_eq(&before, &after) && after.wish.frame == before.wish.frame + 1);
    assert!(after.wish.settings == before.wish.settings && after.texels == before.texels, "the same picture with the same numbers");
    assert_ne!(after.shaders, before.shaders, "the times of both devices would be put into one statistic");
}

#[test]
fn a_device_that_is_lost_again_and_again_is_given_up_until_another_picture_is_wanted() {
    // A first look is a preview with small textures. The textures of this scene are larger, so that each new device draws a first look.
    let scene = Scene { detail_size: 2 * sketch::TEXELS, ..small_scene() };
    let mut stage = Stage::with_shaders(scene, WINDOW, None, |app| {
        app.model.clock.paused = true;
        app.model.settings.frame.variant = Some(Variant::only(Flavour::FarAtlas));
        app.model.settings.scale = 0.2;
        app.model.viewpoint = Viewpoint::Camera("ground".to_owned());
    });
    stage.settle().expect("a picture");
    let first = stage.model().shown().expect("a picture").clone();
    // Each lost device is replaced by a new one, which draws a first look before it is lost, too.
    stage.app().engine().lose_devices(4);
    stage.model().clock.frame += 1;
    let error = stage.settle().expect_err("no device draws it").to_string();
    assert!(error.contains("lost several times") && error.contains("smaller picture") && !error.contains('\n'), "{error}");
    assert!(stage.model().notes().is_empty(), "{:?}", stage.model().notes());
    // The next requested picture must be drawn. Until then, the error of the previous request may still be shown.
    stage.model().clock.frame -= 1;
    let began = Instant::now();
    while stage.settle().is_err() && began.elapsed() < Duration::from_secs(60) {}
    stage.settle().expect("a picture by another device");
    assert!(stage.model().shown().expect("a picture").texels == first.texels);
}

#[test]
fn time_goes_by_frames_and_a_path_replays_the_same_pictures() {
    let mut stage = cheap_stage();
    stage.model().viewpoint = Viewpoint::Path("sideways".to_owned());
    stage.model().clock.frame = 0;
    stage.settle().expect("a picture");
    let mut first = Vec::new();
    for frame in 1..=3 {
        take(&mut stage, "click Step");
        let shown = stage.model().shown().expect("a picture").clone();
        assert_eq!(shown.wish.frame, frame);
        first.push((shown.pose, shown.texels.clone()));
    }
    assert!(first[0].0 != first[1].0 && first[0].1 != first[1].1, "the path moves");
    // The test goes to other frames and back: the same frames must give the same pictures.
    take(&mut stage, "key Period; key Period");
    for (frame, before) in (1..).zip(&first) {
        stage.model().clock.frame = frame;
        stage.settle().expect("a picture");
        let shown = stage.model().shown().expect("a picture").clone();
        assert_eq!((&shown.pose, &shown.texels), (&before.0, &before.1), "frame {frame}");
    }
    // While time runs, no frame is left out: the next frame is requested when a frame has been shown.
    let seen = RefCell::new(BTreeSet::new());
    take(&mut stage, "key Space");
    let from = stage.model().clock.frame;
    // Time runs without a limit, as in a window that no script controls.
    stage.model().clock.left = None;
    let look = |model: &Model| {
        seen.borrow_mut().extend(model.shown().map(|shown| shown.wish.frame));
        model.clock.frame >= from + 4
    };
    stage.until("four frames", look).expect("pictures");
    let seen = seen.into_inner();
    let (first, last) = (*seen.first().expect("some"), *seen.last().expect("some"));
    assert!(seen.len() >= 4 && seen.iter().copied().eq(first..=last), "{seen:?}");
    take(&mut stage, "key Space");
    assert!(stage.model().clock.paused);
}

#[test]
fn a_script_controls_time() {
    // The window opens with a path that plays. The steps must lead to the same frame and picture, however long each of them waits: on a slow machine,
    // the window is drawn more often while a step waits for its picture.
    let script = "set Sun above = 20; frames 3; key L; set Sun above = 30; key Period; click Run; frames 2; click Undo";
    let played = |drawings: u32| {
        let mut stage = Stage::prepared(small_scene(), WINDOW, |app| {
            app.model.settings.frame.variant = Some(Variant::only(Flavour::FarAtlas));
            app.model.settings.scale = 0.2;
        });
        let mut frames = Vec::new();
        stage.settle().expect("a picture");
        for step in steps(script).expect("steps") {
            for _ in 0..drawings {
                stage.until("a drawing", |_| true).expect("nothing is wrong");
                std::thread::sleep(Duration::from_millis(10));
            }
            stage.take(&step).unwrap_or_else(|error| panic!("{step:?}: {error:#}"));
            frames.push(stage.model().shown().expect("a picture").wish.frame);
        }
        assert!(stage.has("frame 6"), "{:?}", stage.names());
        let shown = stage.model().shown().expect("a picture").clone();
        assert!(matches!(shown.wish.viewpoint, Viewpoint::Path(_)), "{:?}", shown.wish.viewpoint);
        (frames, shown.pose, shown.wish.settings.scene.sun.elevation_deg, shown.texels.clone())
    };
    let (quick, slow) = (played(0), played(30));
    assert_eq!(quick.0, [0, 3, 3, 3, 4, 4, 6, 6], "frames after each step");
    assert_eq!(slow.0, quick.0, "frames after each step, if steps wait longer");
    assert!(slow == quick, "another picture if steps wait longer: {:?} and {:?}", (slow.1, slow.2), (quick.1, quick.2));
    // The last change alone is undone, so the sun is where the first step set it.
    assert!((quick.2 - 20.0).abs() < 1.0, "{}", quick.2);
}

#[test]
fn the_camera_flies_turns_and_walks() {
    let mut stage = cheap_stage();
    let pose = |stage: &mut Stage| stage.model().shown().expect("a picture").pose;
    let start = pose(&mut stage);
    stage.hold("W".parse_key(), 4).expect("a picture");
    let moved = pose(&mut stage);
    let along = (moved.position - start.position).dot(start.axes()[2]);
    assert!(along > 0.5 && (moved.position - start.position).length() < along * 1.001, "the camera must move forwards only: {along} m");
    stage.drag([0.0, -60.0]).expect("a picture");
    assert!(pose(&mut stage).pitch < moved.pitch, "a drag upwards makes the camera look down");
    take(&mut stage, "key F");
    let walking = pose(&mut stage);
    stage.hold("A".parse_key(), 4).expect("a picture");
    let after = pose(&mut stage);
    assert!((after.position - walking.position).length() > 0.1);
    // The eye must be EYE_M above the ground. Only the drawing thread has a renderer, which computes the height of the ground. So the test uses
    // another renderer of the same scene.
    {
        let renderer = crate::fixtures::renderer();
        for p in [walking.position, after.position] {
            let above = p.z - renderer.ground_m(p.x, p.y);
            assert!((above - EYE_M).abs() < 1e-9, "{above} m above the ground");
        }
    }
    // After walking ends, the camera continues from the same position.
    take(&mut stage, "key F");
    assert_eq!(pose(&mut stage).position, after.position);
}

trait ParseKey {
    fn parse_key(&self) -> egui::Key;
}

impl ParseKey for str {
    fn parse_key(&self) -> egui::Key {
        egui::Key::from_name(self).expect("a key")
    }
}

#[test]
fn layers_panels_and_what_is_not_there() {
    let mut stage = stage();
    let mut pictures = vec![stage.model().shown().expect("a picture").texels.clone()];
    for layer in Layer::ALL.into_iter().skip(1) {
        take(&mut stage, &format!("click Layer; click {}", layer.name()));
        let shown = stage.model().shown().expect("a picture").clone();
        assert_eq!(shown.wish.settings.layer, layer);
        // While the clock is paused, no pixel flickers or flips, so the layers that show measured values may look alike.
        assert!(layer.is_measured() || pictures.iter().all(|p| *p != shown.texels), "{} looks like another layer", layer.name());
        pictures.push(shown.texels.clone());
    }
    take(&mut stage, "click Count fetches; click Frame");
    assert!(
        stage.names().iter().any(|n| n.ends_with(" a pixel")) && stage.names().iter().any(|n| n.trim() == "shading"),
        "{:?}",
        stage.names()
    );
    take(&mut stage, "click Help");
    assert!(stage.names().iter().any(|name| name.contains("Far Cry 5")));
    let error = stage.take(&Step::Click("Variant splet".to_owned())).expect_err("no such thing").to_string();
    assert!(error.contains("nothing on screen is called `Variant splet`"), "{error}");
    let error = stage.take(&Step::Frames(1)).expect_err("it is paused").to_string();
    assert!(error.contains("time stands still"), "{error}");
    let error = Stage::new(small_scene(), [1, 1]).settle().expect_err("no room").to_string();
    assert!(error.contains("--size"), "{error}");
    let error = stage.screenshot(Path::new("/nowhere/at/all.png")).expect_err("no such folder").to_string();
    assert!(error.contains("/nowhere/at/all.png"), "{error}");
}

/// Draws the window until `done` returns true. The tests use it to wait for another process.
fn wait(stage: &mut Stage, what: &str, done: impl Fn(&Stage) -> bool) {
    let began = Instant::now();
    loop {
        stage.settle().expect("a picture");
        if done(stage) {
            return;
        }
        assert!(began.elapsed() < Duration::from_secs(300), "{what} did not come: {:?}", stage.names());
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// Returns the share of terrain pixels whose colour on screen differs from a picture by more than rounding, which changes a channel by at most 1 of
/// 255.
fn differing(picture: &image::RgbImage, shown: &Shown) -> f64 {
    assert_eq!([picture.width(), picture.height()], shown.wish.size);
    let terrain = shown.picture.hdr.iter().map(|texel| texel[3] > 0.0);
    let differs = |(a, b): (&image::Rgb<u8>, &[u8; 3])| (0..3).any(|k| a.0[k].abs_diff(b[k]) > 1);
    let on: Vec<bool> = picture.pixels().zip(&shown.texels).map(differs).zip(terrain).filter(|(_, on)| *on).map(|(d, _)| d).collect();
    assert!(on.len() * 4 > shown.texels.len(), "hardly any terrain: {} pixels", on.len());
    on.iter().filter(|differs| **differs).count() as f64 / on.len() as f64
}

#[test]
fn a_view_on_screen_is_saved_run_stopped_and_gone_on_with() {
    // The panel *Experiments* starts the program `experiments`. `program` fails if this program is missing or older than its sources.
    program();
    let folder = Folder::new("workbench-experiment");
    let out = folder.path("out");
    let mut stage = cheap_stage();
    let pose = stage.model().shown().expect("a picture").pose;
    let model = stage.model();
    model.settings.scale = 0.1;
    model.settings.layer = Layer::Lit;
    model.settings.frame.noise = NoiseKind::WhiteScreen;
    model.settings.scene.blend.mip_bias = 0.5;
    model.clock.frame = 2;
    // The view is not one of the scene's cameras: it is turned to the side, and after key F the camera walks on the ground.
    model.viewpoint = Viewpoint::Free { pose: Pose { yaw: pose.yaw + 0.2, ..pose }, walking: false };
    take(&mut stage, "key F; click Variant near-cliff");
    take(&mut stage, &format!("click Experiments; type Folder = {}; type Definitions = ; type Results = {out}", folder.0.display()));
    take(&mut stage, "type Experiment name = seen; set Frames of the run = 3; set Seeds of the run = 2");

    // Key C freezes culling. A run cannot draw such a view, so the view is not saved. The error names the control that must be switched off.
    take(&mut stage, "key C; click Save as experiment");
    assert!(stage.names().iter().any(|name| name.contains("switch `Freeze culling` off")), "{:?}", stage.names());
    assert!(!folder.0.join("seen").exists() && !stage.has("Run seen"));
    take(&mut stage, "key C; click Save as experiment");
    assert!(folder.0.join("seen").join("seen.toml").is_file() && stage.has("Run seen"), "{:?}", stage.names());
    // If the same name is used again, an error is shown and nothing is overwritten.
    take(&mut stage, "click Save as experiment");
    assert!(stage.names().iter().any(|name| name.contains("seen already exists")), "{:?}", stage.names());

    // The run is stopped in the middle and then resumed.
    take(&mut stage, "click Run seen");
    wait(&mut stage, "the first part", |stage| stage.names().iter().any(|name| name.contains("seen (%)")));
    take(&mut stage, "click Cancel run");
    wait(&mut stage, "the stop", |stage| stage.names().iter().any(|name| name.contains("seen: stopped")));
    take(&mut stage, "click Run seen");
    wait(&mut stage, "the report", |stage| stage.has("Open report"));
    assert!(stage.names().iter().any(|name| name.contains("What does near-cliff cost")), "{:?}", stage.names());

    // The run has measured the view and the settings that were on screen.
    let shown = stage.model().shown().expect("a picture").clone();
    let run = read_run(&Path::new(&out).join("seen")).expect("it is whole");
    assert!(run.complete && Path::new(&out).join("seen").join("report.html").is_file());
    assert_eq!((run.definition.size, run.definition.frames, run.definition.seeds), (shown.wish.size, 3, 2));
    let measured: Vec<_> = run.rows.iter().filter(|row| row.metric == "flip_rate").collect();
    assert!(!measured.is_empty() && run.rows.iter().any(|row| row.metric == "variance"));
    for row in measured {
        let labels = [&row.view, &row.variant, &row.estimator, &row.noise, &row.temporal];
        assert_eq!(labels, ["workbench", "near-cliff", "fc5", "white", "off"]);
    }
    // The picture of the run equals the one on screen. White noise differs in every frame, so frame, seed, view and scene must all be the same.
    let file = Path::new(&out).join("seen").join("pictures").join("sweep-workbench-fc5-white-off-near-cliff.png");
    let picture = image::open(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display())).to_rgb8();
    let same = differing(&picture, &shown);
    assert!(same <= 0.001, "{same} of the terrain differs");
    // Negative control: the previous frame differs.
    stage.model().clock.frame = 1;
    stage.settle().expect("a picture");
    let other = differing(&picture, stage.model().shown().expect("a picture"));
    assert!(other > 0.1, "only {other} of the terrain differs in another frame");
}

#[test]
fn a_place_is_kept_and_gone_back_to_as_the_same_picture() {
    let mut stage = cheap_stage();
    let seen = |stage: &mut Stage| {
        let shown = stage.model().shown().expect("a picture");
        (shown.pose, shown.texels.clone())
    };
    take(&mut stage, "click Places; click Keep this place");
    let before = seen(&mut stage);
    stage.hold("W".parse_key(), 4).expect("a picture");
    let elsewhere = seen(&mut stage);
    assert!(elsewhere.0 != before.0 && elsewhere.1 != before.1, "the camera must have moved");
    take(&mut stage, "click Keep this place; click Go to place");
    assert!(seen(&mut stage) == before, "the view must be that of the first place");
    take(&mut stage, "click Go to place 2");
    assert!(seen(&mut stage) == elsewhere, "the view must be that of the second place");
    take(&mut stage, "click Forget place");
    assert!(!stage.has("Go to place") && stage.has("Go to place 2"));
}

#[test]
fn a_recorded_flight_replays_the_same_pictures_frame_by_frame() {
    let mut stage = cheap_stage();
    stage.model().clock.frame = 40;
    stage.settle().expect("a picture");
    take(&mut stage, "click Places; click Record path");
    let mut flown = Vec::new();
    for frame in 0..4 {
        if frame > 0 {
            take(&mut stage, "click Step");
        }
        stage.hold("W".parse_key(), 2).expect("a picture");
        let shown = stage.model().shown().expect("a picture").clone();
        assert_eq!(shown.wish.frame, frame, "a recording begins at frame 0");
        flown.push((shown.pose, shown.texels.clone()));
    }
    assert!(flown.windows(2).all(|pair| pair[0] != pair[1]), "it moved");
    assert!(stage.has("Frames so far: 4"), "{:?}", stage.names());
    take(&mut stage, "click Stop recording; click View; click camera ground; click Replay path");
    for frame in 0..6_usize {
        if frame > 0 {
            take(&mut stage, "click Step");
        }
        let shown = stage.model().shown().expect("a picture").clone();
        assert!(matches!(&shown.wish.viewpoint, Viewpoint::Recorded(path) if path.frames() == 4));
        assert_eq!(shown.pose, flown[frame % 4].0, "frame {frame}: the path must repeat");
        assert!(frame >= 4 || shown.texels == flown[frame].1, "frame {frame}: the pixels differ");
    }
    // The field `Path file` is empty, so an error is shown and nothing is written.
    take(&mut stage, "click Write path to a file");
    assert!(stage.names().iter().any(|name| name.contains("Path file") && name.contains(".csv")), "{:?}", stage.names());
    take(&mut stage, "click Forget path path");
    assert!(!stage.has("Replay path"));
}

#[test]
fn a_and_b_differ_in_what_was_changed_and_nothing_else() {
    let mut stage = stage();
    let alone = stage.model().shown().expect("a picture").texels.clone();
    take(&mut stage, "click Compare; click Keep A as B");
    let shown = stage.model().shown().expect("a picture").clone();
    let second = shown.second.as_ref().expect("B");
    assert!(shown.texels == alone && second.texels == alone, "B must equal A");
    assert_eq!((second.rmse, second.largest), (0.0, 0.0), "there must be no difference");
    // Change a setting of the frame (the seed), then a setting of the scene (the sun). A must change, and B must stay the same.
    for change in ["set Seed = 7", "set Sun above = 20"] {
        take(&mut stage, &format!("click Variants; click Parameters; {change}; click Compare"));
        let shown = stage.model().shown().expect("a picture").clone();
        let second = shown.second.as_ref().expect("B");
        assert!(second.texels == alone && shown.texels != alone, "{change}");
        assert!(second.rmse > 0.0 && second.largest > 0.0 && second.largest >= second.mean.abs(), "{change}");
    }
    assert!(
        stage.names().iter().any(|n| n.starts_with("A: ") && n.contains("seed 7") && n.contains("Sun above 20 deg")),
        "{:?}",
        stage.names()
    );
    // Every way to show A and B uses the same pictures.
    let both = stage.model().shown().expect("a picture").clone();
    for mode in Mode::ALL.into_iter().filter(|m| *m != Mode::Off) {
        take(&mut stage, &format!("click Show; click {}", mode.name()));
        let shown = stage.model().shown().expect("a picture").clone();
        assert_eq!((shown.wish.compare.mode, &shown.texels), (mode, &both.texels));
        let difference = shown.second.as_ref().expect("B").difference.as_ref();
        assert_eq!(difference.is_some_and(|d| d.iter().any(|&c| c != d[0])), mode == Mode::Difference);
    }
    take(&mut stage, "click Swap A and B");
    let swapped = stage.model().shown().expect("a picture").clone();
    assert!(swapped.texels == alone && swapped.second.as_ref().expect("B").texels == both.texels, "A and B must be exchanged");
    take(&mut stage, "key X");
    assert_eq!(stage.model().compare.mode, Mode::Flicker);
    // The test now uses one variant, because the exact blend of each further variant needs another shader, and compiling takes long.
    stage.model().settings.frame.variant = Some(Variant::only(Flavour::NearCliff));
    take(&mut stage, "click B is; click exact blend of A");
    assert_eq!(stage.model().compare.other, Other::Exact);
    let shown = stage.model().shown().expect("a picture").clone();
    assert!(shown.texels != shown.second.as_ref().expect("B").texels, "B must not have the noise of A");
}

#[test]
fn live_metrics_tell_noise_that_stands_from_noise_that_flickers() {
    let mut stage = cheap_stage();
    let last = |stage: &mut Stage| stage.model().shown().expect("a picture").readings.last().copied().expect("measured");
    stage.model().viewpoint = Viewpoint::Camera("cliff".to_owned());
    stage.model().settings.frame.variant = Some(Variant::only(Flavour::FarCliff));
    take(&mut stage, "click Metrics; click Measure; key Period; key Period; key Period");
    let still = last(&mut stage).sides[0].expect("terrain");
    // The noise is fixed to the ground and the camera stands still, so nothing changes.
    assert_eq!((still.flip_rate, still.flicker, still.variance), (Some(0.0), 0.0, 0.0));
    assert_eq!(still.frames, 4.0);
    stage.model().settings.frame.reseeds = true;
    take(&mut stage, "key Period; key Period; key Period");
    let reseeded = last(&mut stage).sides[0].expect("terrain");
    assert!(reseeded.frames <= 4.0 && reseeded.flip_rate.expect("choices") > 0.3 && reseeded.flicker > 1e-3, "{reseeded:?}");
    // While the metrics are frozen, their values stay the same. After *Restart*, they are computed from one frame.
    take(&mut stage, "click Freeze; key Period");
    assert_eq!(last(&mut stage).sides[0], Some(reseeded));
    take(&mut stage, "click Freeze; click Restart");
    assert_eq!(last(&mut stage).sides[0].expect("terrain").frames, 1.0);
    // B is the exact blend. Two frames are enough to measure the clumping of A, and the bias of A against B. The bias must be almost 0.
    take(&mut stage, "click Compare; click Show; click Wipe; key Period");
    let against = last(&mut stage).sides;
    let (a, b) = (against[0].expect("A"), against[1].expect("B"));
    assert!(a.clumping.is_some_and(|c| c > 0.2) && b.flip_rate.is_none() && b.flicker == 0.0, "{a:?} {b:?}");
    assert!(a.bias.is_some_and(|bias| bias.abs() < 0.01) && b.bias.is_none(), "{a:?} {b:?}");
    // B does not change from frame to frame, so the change of A - B is the change of A.
    take(&mut stage, "key Period; key Period");
    let [moving, standing] = last(&mut stage).sides.map(|side| side.expect("terrain"));
    let residual = moving.residual.expect("B is drawn");
    assert!(residual > 1e-3 && (residual / moving.flicker - 1.0).abs() < 1e-3 && standing.residual.is_none(), "{moving:?} {standing:?}");
    // Metrics of a region must use fewer pixels than metrics of the whole picture. Afterwards, the test displays a layer that shows measured values.
    stage.model().metrics.region = Some([0.25, 0.5, 0.5, 0.75]);
    take(&mut stage, "key Period");
    assert!(last(&mut stage).sides[0].expect("terrain").terrain < a.terrain / 4);
    take(&mut stage, "click Whole picture; click Layer; click Flips");
    assert_eq!(stage.model().settings.layer, Layer::Flips);
}

/// Returns the legend of the map of nodes: the levels, and for each level the number of drawn nodes.
fn legend(stage: &Stage) -> Vec<(u8, usize)> {
    fn of(name: &str) -> Option<(u8, usize)> {
        let (level, rest) = name.strip_prefix("Level ")?.split_once(": ")?;
        let (_, nodes) = rest.rsplit_once(", ")?;
        Some((level.parse().ok()?, nodes.strip_prefix("nodes: ")?.parse().ok()?))
    }
    stage.names().iter().filter_map(|name| of(name)).collect()
}

#[test]
fn the_machine_shows_what_each_stage_reported() {
    let mut stage = stage();
    take(&mut stage, "click Machine");
    assert!(stage.has("Map of nodes"), "{:?}", stage.names());
    for (camera, step) in [("ground", "key Period"), ("vista", "set Map span = 9000")] {
        stage.model().viewpoint = Viewpoint::Camera(camera.to_owned());
        // The picture of the view `ground` has tiles of several variants. One cheap variant is enough for the view `vista`.
        stage.model().settings.frame.variant = (camera == "vista").then_some(Variant::only(Flavour::FarAtlas));
        take(&mut stage, step);
        let shown = stage.model().shown().expect("a picture").clone();
        let report = &shown.picture.report;

        // The legend counts every drawn node once, at the level of the node.
        let levels = legend(&stage);
        assert!(report.nodes > 0 && report.drawn.len() == report.nodes);
        assert_eq!(levels.iter().map(|(_, nodes)| nodes).sum::<usize>(), report.nodes, "{camera}: {levels:?}");
        assert!(levels.iter().filter(|(_, nodes)| *nodes > 0).count() > 1, "{camera}: one level only");
        for (level, nodes) in levels {
            assert_eq!(report.drawn.iter().filter(|node| node.lod == level).count(), nodes, "{camera}, level {level}");
        }

        // The reported numbers must be consistent.
        let (atlas, cache) = (report.atlas, report.page_cache);
        assert!(report.nodes <= report.visited && report.visited <= atlas.resident && atlas.resident <= atlas.capacity, "{report:?}");
        let slots = u64::try_from(atlas.capacity + 1).expect("few");
        let payload = u64::try_from(PAYLOAD_BYTES).expect("small");
        assert!((slots * payload / 2..=slots * payload).contains(&atlas.bytes), "{} bytes", atlas.bytes);
        assert_eq!(report.pages.wanted_by_level.iter().sum::<usize>(), report.pages.wanted);
        assert_eq!(cache.by_level.iter().sum::<usize>(), cache.resident);
        assert!(cache.resident <= cache.capacity && cache.bytes > 0, "{cache:?}");

        // The numbers must be on screen.
        let names = stage.names();
        let mut expected = vec![
            format!("{} of {}", atlas.resident, atlas.capacity),
            format!("{} of {}", cache.resident, cache.capacity),
            report.patches.to_string(),
        ];
        expected.extend(Variant::all().filter_map(|variant| {
            let tiles = report.tiles[usize::from(variant.mask())];
            (tiles > 0).then(|| format!("{tiles} ({:.1} %)", 100.0 * f64::from(tiles) / f64::from(report.tiles[0])))
        }));
        for text in expected {
            assert!(names.contains(&text), "{camera}: `{text}` is not in {names:?}");
        }
    }
    // A camera that stands still loads no node.
    take(&mut stage, "key Period");
    let shown = stage.model().shown().expect("a picture").clone();
    assert_eq!(shown.picture.report.loaded, 0);
    // The memory of the device includes the atlases and the pages.
    take(&mut stage, "click Frame");
    let (bytes, report) = (shown.device_bytes.expect("Vulkan reports its allocations"), &shown.picture.report);
    assert!(bytes > report.atlas.bytes + report.page_cache.bytes && bytes < 1 << 31, "{bytes} bytes on the device");
    let memory = format!("on the device: {}", mebibytes(bytes));
    let of_program = |name: &str| name.split_once(" MiB; ").filter(|(_, rest)| *rest == memory)?.0.parse::<f64>().ok();
    let found: Vec<f64> = stage.names().iter().filter_map(|name| of_program(name)).collect();
    assert!(matches!(found[..], [mib] if (100.0..16_000.0).contains(&mib)), "{found:?} MiB, {:?}", stage.names());
}

#[test]
fn a_click_takes_a_pixel_apart_and_lets_go_of_it() {
    // The test uses one variant with random choices, so that its pixels differ from those of the exact blend.
    let mut stage = standing(Some(Variant::only(Flavour::NearCliff)));
    stage.model().viewpoint = Viewpoint::Camera("cliff".to_owned());
    stage.settle().expect("a picture");
    let before = stage.model().shown().expect("a picture").texels.clone();
    take(&mut stage, "click Inspector");
    assert!(stage.model().shown().expect("a picture").pixel.is_none());
    // Select a pixel by its column and row, which the test enters into two fields.
    let size = stage.model().shown().expect("a picture").wish.size;
    let on: Vec<bool> = stage.model().shown().expect("a picture").picture.hdr.iter().map(|texel| texel[3] > 0.0).collect();
    let at = |index: usize| [index % size[0] as usize, index / size[0] as usize];
    let ground = at(on.len() - 1 - on.iter().rev().position(|on| *on).expect("terrain"));
    take(&mut stage, &format!("set Pixel x = {}; set Pixel y = {}", ground[0], ground[1]));
    let shown = stage.model().shown().expect("a picture").clone();
    let pixel = shown.pixel.as_ref().expect("terrain");
    assert_eq!(pixel.pixel.map(|n| n as usize), ground);
    assert!(pixel.draw.is_some(), "{pixel:?}");
    assert!(stage.has("World position") && stage.has(&format!("{}, {} px", ground[0], ground[1])), "{:?}", stage.names());
    assert_eq!(shown.texels, before, "the picture stays as it was");
    take(&mut stage, "click Copy");
    // During a comparison, the selected pixel is still that of A.
    take(&mut stage, "click Compare; click Show; click Wipe; click Inspector");
    assert_eq!(stage.model().shown().expect("a picture").pixel.as_ref(), Some(pixel));
    take(&mut stage, "click Stop inspecting");
    assert_eq!((stage.model().probe, stage.model().shown().expect("a picture").pixel.is_none()), (None, true));
    // Select the pixel in the middle of the viewport with the mouse. A drag only turns the camera and selects nothing.
    take(&mut stage, "click Compare; click Show; click Only A");
    stage.drag([40.0, 0.0]).expect("a picture");
    assert_eq!(stage.model().probe, None);
    take(&mut stage, "click Picture");
    let [x, y] = stage.model().probe.expect("a click");
    assert!((x - 0.5).abs() < 0.02 && (y - 0.5).abs() < 0.02, "{x} {y}");
}

/// Controls that [`no_control_is_without_effect`] does not click, by the beginning of their names, with the test that clicks them.
const NOT_CLICKED: [(&str, &str); 4] = [
    // Compiling all variants takes long.
    ("Variant ", "variants_are_forced_by_clicks_and_keys_and_undone"),
    // In `no_control_is_without_effect`, a click on `Restart` or `Cancel run` would change neither a text in the window nor the settings or the
    // viewpoint.
    ("Restart", "live_metrics_tell_noise_that_stands_from_noise_that_flickers"),
    ("Cancel run", "a_view_on_screen_is_saved_run_stopped_and_gone_on_with"),
    // The arrows that scroll the row of tabs. An arrow disappears when the row is scrolled to its end.
    ("Scroll tabs", "none: they belong to the library of panes"),
];

/// Pairs of a control that has no effect at first, and steps after which a click on this control has an effect.
const PREPARED: [(&str, &str); 4] = [
    ("Material grass", "click Material meadow"),
    ("Swap A and B", "key 2"),
    ("Fit", "set Zoom = 4"),
    ("Go to place", "click View; click camera vista"),
];

#[test]
fn no_control_is_without_effect() {
    // A click on a control must change the settings, the viewpoint, or what a screen reader says about the window. Drawing the window without input
    // must change none of them; otherwise, the test would not notice a control without effect.
    let results = Folder::new("controls");
    let mut stage = cheap_stage();
    let panes: Vec<&str> = Pane::ALL.into_iter().map(Pane::name).collect();
    let mut tried: BTreeSet<String> = BTreeSet::new();
    let mut without_effect = Vec::new();
    for pane in &panes {
        if *pane != "Viewport" {
            take(&mut stage, &format!("click {pane}"));
        }
        if *pane == "Experiments" {
            take(&mut stage, &format!("type Results = {}", results.0.display()));
        }
        loop {
            let is_new = |name: &String| {
                !tried.contains(name) && !panes.contains(&name.as_str()) && !NOT_CLICKED.iter().any(|(start, _)| name.starts_with(start))
            };
            let Some((role, name)) = stage.clickable().into_iter().find(|(_, name)| is_new(name)) else { break };
            tried.insert(name.clone());
            if let Some((_, steps)) = PREPARED.iter().find(|(prepared, _)| *prepared == name) {
                take(&mut stage, steps);
            }
            let began = Instant::now();
            // Wait until an action that an earlier click started, such as opening a dialog, has ended.
            let mut before = state(&mut stage);
            let is_idle = (0..50).any(|_| {
                let earlier = std::mem::replace(&mut before, state(&mut stage));
                earlier == before
            });
            let result = stage.take(&Step::Click(name.clone()));
            let after = state(&mut stage);
            println!("{pane}: {role:?} {name}: {:?} {:.2} s", result.as_ref().err(), began.elapsed().as_secs_f64());
            assert!(is_idle, "{name}: the window changes by itself, so a control without effect would not be noticed");
            if before == after {
                without_effect.push(format!("{pane}: {role:?} {name}"));
            }
            if !stage.has(pane) {
                take(&mut stage, "key Escape");
            }
        }
    }
    assert!(without_effect.is_empty(), "{without_effect:#?}");
    assert!(tried.len() > 60, "only {} controls", tried.len());
}

/// Returns the texts that a screen reader says about the window, and the settings and the viewpoint as text.
fn state(stage: &mut Stage) -> (Vec<String>, String) {
    stage.settle().expect("a picture");
    let model = stage.model();
    let kept = format!("{:?} {:?}", model.settings, model.viewpoint);
    (stage.described(), kept)
}

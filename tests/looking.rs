//! Tests of ways to look at a scene in the window: orbiting, frozen culling, times by variant, legends, and opening other scenes.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use eframe::egui::Key;
use glam::DVec3;
use kernels::scene::{self, Scene, World};
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use workbench::engine::Engine;
use workbench::model::display::Layer;
use workbench::model::kept::{Keeper, Kept};
use workbench::model::picture::Shown;
use workbench::model::state::Model;
use workbench::model::viewpoint::Viewpoint;
use workbench::script::{Stage, Step};
use workbench::window::Workbench;

use crate::workbench::{cheap_stage, take};

use crate::fixtures::{Folder, small_scene};

const WINDOW: [u32; 2] = [1100, 1500];

fn shown(stage: &mut Stage) -> Arc<Shown> {
    stage.model().shown().expect("a picture").clone()
}

fn pose(stage: &mut Stage) -> Pose {
    shown(stage).pose
}

fn says(stage: &Stage, text: &str) -> bool {
    stage.names().iter().any(|name| name.contains(text))
}

/// Moves the camera to a pose and waits for the picture from there.
fn go(stage: &mut Stage, pose: Pose) {
    stage.model().viewpoint = Viewpoint::Free { pose, walking: false };
    stage.settle().expect("a picture");
}

/// Distance between the view direction and the direction to a point (`place`), both as unit vectors: 2 sin of half the angle between them.
fn beside(pose: &Pose, place: DVec3) -> f64 {
    let [_, _, forward] = pose.axes();
    (place - pose.position).normalize_or_zero().distance(forward)
}

#[test]
fn the_camera_orbits_the_middle_or_what_is_probed() {
    let mut stage = cheap_stage();
    let start = pose(&mut stage);
    stage.model().probe = Some([0.5, 0.5]);
    stage.settle().expect("a picture");
    let middle = shown(&mut stage).pixel.as_ref().expect("ground in the middle").position;
    stage.model().probe = Some([0.3, 0.8]);
    stage.settle().expect("a picture");
    let probed = shown(&mut stage).pixel.as_ref().expect("ground at the bottom").position;

    // The surface point of the inspected (probed) pixel moves to the middle of the picture and stays there.
    take(&mut stage, "key O");
    assert_eq!(stage.model().orbited().map(|place| place.to_array()), Some(probed));
    let at = pose(&mut stage);
    assert!(beside(&at, DVec3::from_array(probed)) < 1e-9 && at.position.distance(start.position) < 1e-6, "turned towards it: {at:?}");
    take(&mut stage, "key O");
    assert_eq!(stage.model().orbited(), None);

    // If no pixel is inspected, the camera orbits the surface point in the middle of the picture, which is computed from the depth there.
    stage.model().probe = None;
    go(&mut stage, start);
    take(&mut stage, "click Orbit");
    let target = stage.model().orbited().expect("ground");
    assert_eq!(target.to_array(), middle);
    let distance_m = start.position.distance(target);
    assert!(says(&stage, &format!("{distance_m:.2} m away")), "{:?}", stage.names());
    let around = pose(&mut stage);
    stage.drag([80.0, 0.0]).expect("a picture");
    let turned = pose(&mut stage);
    let yaw = (turned.yaw - around.yaw).rem_euclid(TAU);
    assert!(yaw > 0.01 && yaw < PI && (turned.pitch - around.pitch).abs() < 1e-12, "dragged to the right: {yaw}");
    stage.drag([0.0, 60.0]).expect("a picture");
    let higher = pose(&mut stage);
    assert!(higher.pitch < turned.pitch && higher.position.z > turned.position.z, "dragged down: seen from higher up");
    for at in [around, turned, higher] {
        assert!(beside(&at, target) < 1e-9 && (at.position.distance(target) / distance_m - 1.0).abs() < 1e-9, "{at:?}");
    }

    // Scrolling upwards moves the camera nearer. The movement keys move the orbited point together with the camera.
    stage.scroll(100.0).expect("a picture");
    let near = pose(&mut stage);
    let share = near.position.distance(target) / distance_m;
    assert!(share > 0.6 && share < 0.9 && beside(&near, target) < 1e-9, "{share}");
    stage.hold(Key::W, 4).expect("a picture");
    let (moved, along) = (pose(&mut stage), stage.model().orbited().expect("still"));
    assert!(along.distance(target) > 0.1 && (along.z - target.z).abs() < 1e-9, "along the ground: {along}");
    assert!((moved.position.distance(along) / near.position.distance(target) - 1.0).abs() < 1e-9 && beside(&moved, along) < 1e-9);

    // Choosing another view ends orbiting, and so does walking.
    take(&mut stage, "click View; click camera ground");
    stage.settle().expect("a picture");
    assert_eq!(stage.model().orbited(), None);
    take(&mut stage, "key O");
    assert!(stage.model().orbited().is_some());
    take(&mut stage, "key F");
    assert_eq!(stage.model().orbited(), None);
    assert!(says(&stage, "m/s"), "{:?}", stage.names());

    // If the camera sees only sky, it orbits a point at some distance in front of it.
    take(&mut stage, "key F");
    let up = Pose { pitch: 1.2, ..start };
    go(&mut stage, up);
    take(&mut stage, "key O");
    let ahead = stage.model().orbited().expect("a place in the sky");
    assert!(ahead.distance(up.position) > 10.0 && beside(&pose(&mut stage), ahead) < 1e-9, "{ahead}");
}

#[test]
fn frozen_culling_keeps_its_nodes_while_the_camera_turns_away() {
    let folder = Folder::new("looking-frozen");
    let mut stage = cheap_stage();
    let drawn = |stage: &mut Stage| {
        let shown = shown(stage);
        // Hidden patches are drawn while culling is frozen, and removed otherwise. They are counted in both cases.
        let report = &shown.picture.report;
        (report.drawn.clone(), report.patches + report.culled.hidden)
    };
    let start = pose(&mut stage);
    // Turning changes the patches, and moving changes the nodes.
    let away = Pose { yaw: (start.yaw + PI).rem_euclid(TAU), position: start.position + DVec3::new(300.0, 0.0, 0.0), ..start };
    go(&mut stage, away);
    let other = drawn(&mut stage);
    go(&mut stage, start);
    let before = drawn(&mut stage);
    assert!(other.0 != before.0 && other.1 != before.1, "without frozen culling, nodes and patches must follow the camera");
    assert!(!says(&stage, "culling frozen"));

    take(&mut stage, "key C");
    assert_eq!(stage.model().culled_from, Some(start));
    assert!(drawn(&mut stage) == before && says(&stage, "culling frozen"), "{:?}", stage.names());
    go(&mut stage, away);
    assert!(drawn(&mut stage) == before, "the nodes and patches of the previous view must still be drawn");
    take(&mut stage, "click Machine");
    assert!(says(&stage, "yellow camera"), "{:?}", stage.names());

    // In a comparison, picture B is drawn from the same frozen nodes as picture A.
    take(&mut stage, "click Compare; click Keep A as B");
    let both = shown(&mut stage);
    assert!(both.second.as_ref().expect("B").texels == both.texels, "B must equal A");

    // A run would not freeze culling and would draw a different picture, so saving as an experiment is refused with a message.
    take(&mut stage, &format!("click Experiments; type Folder = {}; click Save as experiment", folder.0.display()));
    assert!(says(&stage, "switch `Freeze culling` off") && !folder.0.join("seen").exists(), "{:?}", stage.names());
    take(&mut stage, "click Freeze culling");
    assert_eq!(stage.model().culled_from, None);
    assert!(drawn(&mut stage) == other && !says(&stage, "culling frozen"));
}

/// Names of the shading passes.
fn shading(stage: &mut Stage) -> Vec<String> {
    let shown = shown(stage);
    let names = shown.picture.report.passes.iter().map(|pass| pass.name.clone());
    names.filter(|name| name.starts_with("shading")).collect()
}

#[test]
fn each_running_variant_has_a_time_of_its_own() {
    let mut stage = cheap_stage();
    take(&mut stage, "key 0");
    let plain = shown(&mut stage);
    assert_eq!(shading(&mut stage), ["shading"]);
    take(&mut stage, "click Time variants");
    let timed = shown(&mut stage);
    let running: Vec<Variant> = Variant::all().filter(|v| timed.picture.report.tiles[usize::from(v.mask())] > 0).collect();
    let expected: Vec<String> = running.iter().map(|variant| format!("shading: {variant}")).collect();
    assert!(running.len() > 1 && shading(&mut stage) == expected, "{expected:?}, {:?}", shading(&mut stage));
    let passes = timed.picture.report.passes.iter().filter(|pass| expected.contains(&pass.name));
    assert!(passes.clone().all(|pass| pass.time_ms >= 0.0) && passes.map(|pass| pass.time_ms).sum::<f64>() > 0.0);
    assert!(timed.texels == plain.texels, "the picture must not change");
    for name in running.iter().map(Variant::to_string).chain(["ns a tile".to_owned()]) {
        assert!(stage.has(&name), "{name} is not in the table: {:?}", stage.names());
    }
    // The list of passes shows the sum of the variants' times, and below it the times of the variants.
    take(&mut stage, "click Frame");
    let names: Vec<String> = stage.names().iter().map(|name| name.trim().to_owned()).collect();
    assert!(names.contains(&"shading, variant by variant".to_owned()) && names.contains(&"lighting".to_owned()), "{names:?}");
    take(&mut stage, "key G");
    assert_eq!(shading(&mut stage), ["shading: generic"]);
    take(&mut stage, "key G; click Time variants");
    assert_eq!(shading(&mut stage), ["shading"]);
    assert!(!stage.has("ns a tile"));
}

/// Returns the names of the legends on screen that begin with `Legend of {of}`, without this prefix.
fn legends(stage: &Stage, of: &str) -> BTreeSet<String> {
    let of = format!("Legend of {of}");
    stage.names().iter().filter_map(|name| name.strip_prefix(&of)).map(|rest| rest.trim_start_matches(": ").to_owned()).collect()
}

#[test]
fn every_layer_has_a_legend_of_what_it_shows() {
    let mut stage = cheap_stage();
    assert!(legends(&stage, "").is_empty(), "the lit picture has no legend");
    let named = |masks: &mut dyn Iterator<Item = u8>| -> BTreeSet<String> {
        masks.filter_map(Variant::new).map(|variant| format!("{variant} ({})", variant.mask())).collect()
    };
    for layer in Layer::ALL {
        take(&mut stage, &format!("click Layer; click {}", layer.name()));
        let found = legends(&stage, layer.name());
        let report = shown(&mut stage).picture.report.clone();
        let count = match layer {
            Layer::Lit | Layer::Albedo => 0,
            Layer::Normal => 3,
            Layer::Depth | Layer::Fetches | Layer::Deviation | Layer::Flicker | Layer::Flips | Layer::Bias | Layer::Residual => 1,
            Layer::Choice => 9,
            Layer::Lod => 6,
            Layer::Stride => 5,
            Layer::Mask => {
                let picture = shown(&mut stage);
                let masks = picture.picture.values("mask").expect("asked for");
                let expected = named(&mut masks.iter().map(|mask| *mask as u8));
                assert!(expected.len() > 1 && found == expected, "{found:?}, expected {expected:?}");
                expected.len()
            }
            Layer::Tiles => {
                let expected = named(&mut (1..32).filter(|mask| report.tiles[usize::from(*mask)] > 0));
                assert_eq!(found, expected);
                assert_eq!(found.len(), 1, "one variant is forced: {found:?}");
                1
            }
        };
        assert_eq!(found.len(), count, "{}: {found:?}", layer.name());
        // No legend of a different layer is left.
        assert_eq!(legends(&stage, "").len(), count, "{}: {:?}", layer.name(), legends(&stage, ""));
    }
    take(&mut stage, "click Layer; click Depth; click Compare; click Show; click Side by side");
    let expected = ["Depth of A: distance along the view direction", "Depth of B: distance along the view direction"];
    assert!(legends(&stage, "").into_iter().eq(expected), "{:?}", legends(&stage, ""));
    take(&mut stage, "click Show; click Difference");
    assert!(legends(&stage, "").into_iter().eq(["Difference: |A - B| in luminance"]), "{:?}", legends(&stage, ""));
}

/// Writes a scene file: the small scene with a different name and one change. Returns its path.
fn written(folder: &Folder, name: &str, change: impl FnOnce(&mut Scene)) -> String {
    let mut scene = small_scene();
    scene.name = name.to_owned();
    change(&mut scene);
    folder.write(&format!("{name}.toml"), &toml::to_string(&scene).expect("a scene is a document"))
}

/// Stops the clock and selects the cheapest shader and small pictures.
fn stand(model: &mut Model) {
    model.clock.paused = true;
    model.settings.frame.variant = Some(Variant::only(Flavour::FarAtlas));
    model.settings.scale = 0.2;
}

/// Creates a window with its own drawing thread. No other test shares this thread, because the tests that call this function open other scenes.
fn own_stage(prepare: impl FnOnce(&mut Workbench)) -> Stage {
    let mut stage = Stage::with_shaders(small_scene(), WINDOW, None, |app| {
        prepare(app);
        stand(&mut app.model);
    });
    stage.settle().expect("a picture");
    stage
}

fn open(stage: &mut Stage, file: &str) -> Result<(), String> {
    let outcome = stage.take(&Step::Open(file.to_owned())).map_err(|error| format!("{error:#}"));
    stage.settle().expect("a picture, whether or not the scene could be opened");
    outcome
}

fn name(stage: &mut Stage) -> String {
    let shown = shown(stage);
    assert_eq!(shown.wish.settings.scene, stage.model().settings.scene, "the picture shows a different scene");
    shown.wish.settings.scene.name.clone()
}

#[test]
fn another_scene_is_opened_and_the_old_one_stays_where_that_fails() {
    let folder = Folder::new("looking-scenes");
    let other = written(&folder, "other", |scene| scene.sun.azimuth_deg = 250.0);
    let third = written(&folder, "third", |_| {});
    let mut stage = own_stage(|_| {});
    let first = shown(&mut stage).texels.clone();
    stage.model().clock.frame = 3;
    stage.model().probe = Some([0.5, 0.5]);
    stage.model().settings.frame.seed = 7;
    stage.settle().expect("a picture");

    // The other scene starts with its own first view, and keeps the frame settings of the old scene. Undo does not lead back to the old scene.
    open(&mut stage, &other).expect("a scene");
    assert_eq!((name(&mut stage).as_str(), stage.model().given()), ("other", Some(other.as_str())));
    let model = stage.model();
    assert_eq!((model.viewpoint.clone(), model.clock.frame, model.probe), (Viewpoint::Path("forwards".to_owned()), 0, None));
    assert_eq!((model.settings.frame.seed, model.settings.frame.variant), (7, Some(Variant::only(Flavour::FarAtlas))));
    let lit = shown(&mut stage).texels.clone();
    assert!(lit != first, "the other scene has a different sun");
    take(&mut stage, "click Undo");
    assert_eq!(name(&mut stage), "other");

    // A file that is not a scene is refused with an error of one line, and nothing changes.
    let broken = folder.write("broken.toml", "name = ");
    let error = open(&mut stage, &broken).expect_err("no scene");
    assert!(error.contains("broken.toml") && !error.contains('\n') && says(&stage, &error), "{error}");
    assert_eq!((name(&mut stage).as_str(), stage.model().given()), ("other", Some(other.as_str())));
    // The message takes room in the window, so it is dismissed before pictures are compared.
    take(&mut stage, "click Dismiss");
    assert!(shown(&mut stage).texels == lit);
    assert!(!says(&stage, "broken.toml") && stage.model().notes().is_empty());

    // Nothing changes either if the scene's file is valid, but the heightmap that it names is not.
    folder.write("words.png", "plain words");
    let lacking = written(&folder, "lacking", |scene| {
        scene.world = World::Heightmap {
            file: "words.png".into(),
            metres_per_texel: 1.0,
            height_range_m: [0.0, 500.0],
            detail_m: 0.0,
            seed: 0,
            holes: Vec::new(),
            colour_modulation: 0.0,
        };
    });
    let error = open(&mut stage, &lacking).expect_err("no heightmap");
    assert!(error.contains("lacking.toml cannot be loaded") && error.contains("words.png") && !error.contains('\n'), "{error}");
    assert_eq!((name(&mut stage).as_str(), stage.model().given()), ("other", Some(other.as_str())));
    assert!(says(&stage, &error), "{:?}", stage.names());
    take(&mut stage, "click Dismiss");
    assert!(shown(&mut stage).texels == lit);

    // A change of the file is applied when the user asks for it, and can be undone. If the file no longer exists, the scene stays.
    written(&folder, "other", |scene| scene.sun.azimuth_deg = 20.0);
    take(&mut stage, "click Scene; click Reload scene");
    assert!((stage.model().settings.scene.sun.azimuth_deg - 20.0).abs() < 1e-9 && shown(&mut stage).texels != lit);
    take(&mut stage, "click Undo");
    assert!((stage.model().settings.scene.sun.azimuth_deg - 250.0).abs() < 1e-9 && shown(&mut stage).texels == lit);
    fs::remove_file(&other).expect("it is there");
    take(&mut stage, "click Scene; click Reload scene; key Period");
    assert!(says(&stage, "other.toml no longer exists") && name(&mut stage) == "other" && shown(&mut stage).wish.frame == 1);
    take(&mut stage, "click Dismiss");

    // Scenes are opened by dropping a file, and from the list of recent scenes.
    stage.drop_file(Path::new(&third)).expect("a picture");
    assert_eq!(name(&mut stage), "third");
    written(&folder, "other", |_| {});
    take(&mut stage, &format!("click Scene; click {other}"));
    assert_eq!(name(&mut stage), "other");

    // The user is asked before unsaved edits are lost.
    stage.model().settings.scene.materials[0].tint[0] *= 0.5;
    stage.settle().expect("a picture");
    let error = open(&mut stage, &third).expect_err("edits");
    assert!(error.contains("not saved in a file") && stage.has("Open without saving") && name(&mut stage) == "other", "{error}");
    take(&mut stage, "click Keep this scene");
    assert!(!stage.has("Open without saving") && name(&mut stage) == "other");
    open(&mut stage, &third).expect_err("edits");
    take(&mut stage, "click Open without saving");
    assert!(name(&mut stage) == "third" && !stage.has("Open without saving"));
}

#[test]
fn until_another_scene_is_loaded_nothing_is_done_in_the_picture_of_the_old_one() {
    let folder = Folder::new("looking-old-picture");
    let other = written(&folder, "other", |_| {});
    let mut stage = own_stage(|app| app.model.brush.paints = true);
    let before = stage.model().pose().expect("a picture");
    stage.model().open(&other).expect("a scene");
    assert!(
        stage.model().shown().is_some() && stage.model().shown_here().is_none(),
        "the old picture stays on screen, but does not count as a picture of the new scene"
    );
    assert!(stage.model().pose().is_none());
    stage.drag([60.0, 20.0]).expect("a picture");
    assert!(name(&mut stage) == "other" && stage.model().settings.scene.strokes.is_empty(), "the drag painted on the old ground");
    assert_eq!(stage.model().viewpoint, Viewpoint::Path("forwards".to_owned()), "the drag moved the old camera, {before:?}");
}

#[test]
fn a_saved_scene_is_its_file_and_what_undo_brings_back_is_not() {
    let folder = Folder::new("looking-saved");
    let [own, other] = ["own", "other"].map(|name| written(&folder, name, |_| {}));
    let copy = folder.path("copy.toml");
    let mut stage = own_stage(|_| {});
    open(&mut stage, &own).expect("a scene");
    take(&mut stage, &format!("click Materials; set Texture tile = 5; type Scene file = {own}; click Overwrite; click Save scene as..."));
    assert!(stage.close(), "nothing is lost: {:?}", stage.names());
    take(&mut stage, "click Undo");
    assert!((stage.model().settings.scene.materials[0].tile_m - 5.0).abs() > 0.1, "undone");
    let error = open(&mut stage, &other).expect_err("the restored edits are in no file");
    assert!(error.contains("not saved in a file"), "{error}");
    take(&mut stage, "click Keep this scene");
    // The window does not close without a question, either.
    assert!(!stage.close() && stage.has("Close without saving"));
    take(&mut stage, "click Keep this scene");
    // After saving under a different name, the scene belongs to that file.
    take(&mut stage, &format!("type Scene file = {copy}; click Save scene as..."));
    assert_eq!(stage.model().given(), Some(copy.as_str()));
    assert!(stage.model().shown_here().is_some() && stage.close());
    take(&mut stage, "click Scene");
    assert!(stage.has(&own), "the previous file must be in the list of recent scenes: {:?}", stage.names());
    take(&mut stage, "key Escape; set Texture tile = 7; click Scene; click Reload scene");
    assert!(
        (stage.model().settings.scene.materials[0].tile_m - 5.0).abs() > 0.1
            && (stage.model().settings.scene.materials[0].tile_m - 7.0).abs() > 0.1
    );
    // The window closes if the user chooses to close it without saving.
    take(&mut stage, "set Texture tile = 6");
    assert!(!stage.close());
    take(&mut stage, "click Close without saving");
    assert!(stage.close() && !stage.has("Close without saving"));
}

#[test]
fn the_window_is_not_painted_for_itself_while_a_scene_is_loaded() {
    // A first look is a draft with small textures. The textures of this scene are larger, so a first look is drawn before the final picture.
    let scene = Scene { detail_size: 128, ..small_scene() };
    let mut stage = Stage::prepared(scene.clone(), WINDOW, |app| {
        // The drawing thread does not wake the window, so only the window's own requests repaint it.
        *app = Workbench::drawn_by(Engine::start(None, |_| {}), scene);
        stand(&mut app.model);
    });
    let mut rested = 0;
    while rested < 3 {
        stage.until("a drawing", |_| true).expect("no failure");
        assert!(!stage.model().is_settled(), "the window was painted without a pause until the picture was there");
        rested += u32::from(stage.model().progress().is_some() && stage.rests_for() > Duration::from_millis(100));
    }
    // While only a first look is drawn, the window must show progress.
    let mut looks = 0;
    while !stage.model().is_settled() {
        stage.until("a drawing", |_| true).expect("no failure");
        if stage.model().shown().is_some_and(|shown| shown.draft) {
            looks += 1;
            assert!(stage.model().progress().is_some(), "the window shows no progress after a first look");
        }
    }
    assert!(looks > 0 && stage.model().progress().is_none());
}

#[test]
fn what_is_kept_of_each_scene_comes_back_with_it() {
    let folder = Folder::new("looking-kept");
    let [a, b] = ["a", "b"].map(|name| written(&folder, name, |_| {}));
    let file = folder.0.join("state.toml");
    let mut stage = own_stage(|app| {
        let (keeper, line) = Keeper::open(file.clone());
        assert_eq!(line, None);
        *app = Workbench::drawn_by(Engine::start(None, |_| {}), small_scene());
        app.model.come_from(scene::DEFAULT);
        app.model.keep_with(keeper, scene::DEFAULT.to_owned(), Vec::new());
    });
    let usual = small_scene().blend.hash_scale;
    open(&mut stage, &a).expect("a scene");
    stage.model().settings.scene.blend.hash_scale = usual + 1.0;
    take(&mut stage, "click Places; click Keep this place");

    // The state of scene a is in the file as soon as scene b is opened, and does not affect scene b.
    open(&mut stage, &b).expect("a scene");
    let (kept, line) = Kept::load(&file);
    assert_eq!((kept.places(&a).places().len(), line), (1, None));
    assert!(!stage.has("Go to place") && (stage.model().settings.scene.blend.hash_scale - usual).abs() < 1e-9);
    open(&mut stage, &a).expect("a scene");
    assert!(stage.has("Go to place") && (stage.model().settings.scene.blend.hash_scale - usual - 1.0).abs() < 1e-9);
    assert_eq!(stage.model().settings.frame.variant, Some(Variant::only(Flavour::FarAtlas)));
    // A scene that cannot be opened is not added to the recent scenes.
    let broken = folder.write("broken.toml", "name = ");
    open(&mut stage, &broken).expect_err("no scene");
    let (kept, _) = Kept::load(&file);
    assert!(kept.recent().contains(&a) && kept.recent().contains(&b) && !kept.recent().contains(&broken), "{:?}", kept.recent());
}

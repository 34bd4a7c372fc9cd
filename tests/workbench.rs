//! The application, without a window: what every control does, by the name that a screen reader has for it.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;

use eframe::egui;
use kernels::frame::VariantChoice;
use kernels::variant::{Flavour, Variant};
use workbench::app::Workbench;
use workbench::display::Layer;
use workbench::engine::{EYE_M, Viewpoint};
use workbench::parameters::GROUPS;
use workbench::script::{Stage, Step, steps};

use crate::frame::small_scene;

const WINDOW: [u32; 2] = [1100, 1500];

/// The application with a small scene, standing still at a camera, its first picture there.
fn stage() -> Stage {
    let mut stage = Stage::new(small_scene(), WINDOW);
    stage.settle().expect("the first picture");
    let app = stage.app();
    app.clock.paused = true;
    app.settings.scale = 0.2;
    app.viewpoint = Viewpoint::Camera("ground".to_owned());
    stage.settle().expect("a picture of the ground");
    stage
}

fn take(stage: &mut Stage, text: &str) {
    for step in steps(text).expect("steps") {
        stage.take(&step).unwrap_or_else(|error| panic!("{text}: {error:#}"));
    }
}

/// Tiles of the last picture by variant.
fn running(stage: &mut Stage) -> Vec<Variant> {
    let shown = stage.app().shown().expect("a picture").clone();
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
    // The same again lets go of it.
    take(&mut stage, "click Variant splat");
    assert_eq!(running(&mut stage), automatic);
    take(&mut stage, "key 5; key 1");
    assert_eq!(running(&mut stage), [Variant::new(17).expect("vt and splat")]);
    take(&mut stage, "key G");
    assert_eq!(
        stage.app().shown().expect("a picture").wish.settings.choice(),
        VariantChoice::GenericForced(Variant::new(17).expect("a set"))
    );
    take(&mut stage, "key 0; click Generic kernel");
    assert_eq!(running(&mut stage), automatic);
    // All 31 are there.
    for variant in Variant::all() {
        assert!(stage.has(&format!("Variant {variant}")), "{variant}");
    }
    // Undo goes back to what was before the last pause of a second: by then the choices above are one.
    take(&mut stage, "click Variant far-atlas");
    for _ in 0..30 {
        stage.settle().expect("a picture");
    }
    take(&mut stage, "click Undo");
    assert_eq!(stage.app().settings.forced, None);
    take(&mut stage, "click Redo");
    assert_eq!(stage.app().settings.forced, Some(Variant::only(Flavour::FarAtlas)));
}

#[test]
fn every_parameter_is_set_and_reset_by_its_name() {
    let mut stage = stage();
    let original = stage.app().settings.scene.clone();
    for parameter in GROUPS.iter().flat_map(|g| g.parameters) {
        let usual = *(parameter.at)(&mut original.clone());
        // A little, so that the scene stays possible.
        let wanted = usual + 0.01 * (parameter.range[1] - usual).abs().max(0.1);
        stage.take(&Step::Set(parameter.name.to_owned(), wanted)).unwrap_or_else(|e| panic!("{}: {e:#}", parameter.name));
        let now = *(parameter.at)(&mut stage.app().shown().expect("a picture").wish.settings.scene.clone());
        assert!(now != usual && (now - wanted).abs() <= 0.02 * wanted.abs(), "{}: {now}, wanted {wanted}", parameter.name);
        stage.take(&Step::Click(format!("Reset {}", parameter.name))).unwrap_or_else(|e| panic!("{}: {e:#}", parameter.name));
        assert!(stage.app().settings.scene == original, "{}", parameter.name);
    }
}

#[test]
fn a_scene_that_cannot_be_is_refused_and_the_picture_stays() {
    let mut stage = stage();
    let before = stage.app().shown().expect("a picture").texels.clone();
    stage.app().settings.scene.flavours.cliff_near_m = 9000.0;
    let error = stage.settle().expect_err("near cliff ends behind the far atlas").to_string();
    assert!(error.contains("cliff_near_m"), "{error}");
    // It stands in the window, too, for as long as it is so.
    assert!(stage.settle().is_err() && stage.names().iter().any(|name| name.contains("cliff_near_m")), "{:?}", stage.names());
    assert_eq!(stage.app().shown().expect("still there").texels, before);
    stage.app().settings.scene = small_scene();
    stage.settle().expect("possible again");
    assert!(!stage.names().iter().any(|name| name.contains("cliff_near_m")));
}

#[test]
fn numbers_are_where_their_keys_say_and_within_what_is_offered() {
    let plain = small_scene();
    let value = |scene: &kernels::scene::Scene, key: &str| {
        let document = toml::Value::try_from(scene).expect("a scene is a document");
        key.split('.').fold(document, |at, step| at[step].clone()).as_float().expect("a number")
    };
    for parameter in GROUPS.iter().flat_map(|g| g.parameters) {
        let usual = value(&plain, parameter.key);
        assert!((parameter.range[0]..=parameter.range[1]).contains(&usual), "{}: {usual}", parameter.key);
        let mut changed = plain.clone();
        *(parameter.at)(&mut changed) = usual + 1.0;
        assert!((value(&changed, parameter.key) - usual - 1.0).abs() < 1e-9, "{}", parameter.key);
    }
}

#[test]
fn time_goes_by_frames_and_a_path_replays_the_same_pictures() {
    let mut stage = stage();
    stage.app().viewpoint = Viewpoint::Path("sideways".to_owned());
    stage.app().clock.frame = 0;
    stage.settle().expect("a picture");
    let mut first = Vec::new();
    for frame in 1..=3 {
        take(&mut stage, "click Step");
        let shown = stage.app().shown().expect("a picture").clone();
        assert_eq!(shown.wish.frame, frame);
        first.push((shown.pose, shown.texels.clone()));
    }
    assert!(first[0].0 != first[1].0 && first[0].1 != first[1].1, "the path moves");
    // Forwards to elsewhere and back again: the same frames are the same pictures.
    take(&mut stage, "key Period; key Period");
    for (frame, before) in (1..).zip(&first) {
        stage.app().clock.frame = frame;
        stage.settle().expect("a picture");
        let shown = stage.app().shown().expect("a picture").clone();
        assert_eq!((&shown.pose, &shown.texels), (&before.0, &before.1), "frame {frame}");
    }
    // Running, no frame is left out: the next one is asked for when one was shown.
    let seen = RefCell::new(BTreeSet::new());
    take(&mut stage, "key Space");
    let from = stage.app().clock.frame;
    let look = |app: &Workbench| {
        seen.borrow_mut().extend(app.shown().map(|shown| shown.wish.frame));
        app.clock.frame >= from + 4
    };
    stage.until("four frames", look).expect("pictures");
    let seen = seen.into_inner();
    let (first, last) = (*seen.first().expect("some"), *seen.last().expect("some"));
    assert!(seen.len() >= 4 && seen.iter().copied().eq(first..=last), "{seen:?}");
    take(&mut stage, "key Space");
    assert!(stage.app().clock.paused);
}

#[test]
fn the_camera_flies_turns_and_walks() {
    let mut stage = stage();
    let pose = |stage: &mut Stage| stage.app().shown().expect("a picture").pose;
    let start = pose(&mut stage);
    stage.hold("W".parse_key(), 4).expect("a picture");
    let moved = pose(&mut stage);
    let along = (moved.position - start.position).dot(start.axes()[2]);
    assert!(along > 0.5 && (moved.position - start.position).length() < along * 1.001, "forward, and only that: {along} m");
    stage.drag([0.0, -60.0]).expect("a picture");
    assert!(pose(&mut stage).pitch < moved.pitch, "dragged up: looks down");
    take(&mut stage, "key F");
    let walking = pose(&mut stage);
    stage.hold("A".parse_key(), 4).expect("a picture");
    let after = pose(&mut stage);
    assert!((after.position - walking.position).length() > 0.1);
    // The eye is at its height over the ground, which only the drawing thread knows: held to a renderer of the same scene.
    {
        let renderer = crate::frame::renderer();
        for p in [walking.position, after.position] {
            let above = p.z - renderer.ground_m(p.x, p.y);
            assert!((above - EYE_M).abs() < 1e-9, "{above} m above the ground");
        }
    }
    // Off the ground again, it goes on from there.
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
    let mut pictures = vec![stage.app().shown().expect("a picture").texels.clone()];
    for layer in Layer::ALL.into_iter().skip(1) {
        take(&mut stage, &format!("click Layer; click {}", layer.name()));
        let shown = stage.app().shown().expect("a picture").clone();
        assert_eq!(shown.wish.settings.layer, layer);
        assert!(pictures.iter().all(|p| *p != shown.texels), "{} looks like another layer", layer.name());
        pictures.push(shown.texels.clone());
    }
    take(&mut stage, "click Count fetches; click Frame");
    assert!(
        stage.names().iter().any(|n| n.ends_with(" a pixel")) && stage.names().iter().any(|n| n.trim() == "shading"),
        "{:?}",
        stage.names()
    );
    take(&mut stage, "click What is this?");
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

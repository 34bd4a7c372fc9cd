//! Tests of editing materials, splat rules and brush strokes in the window: how the controls change the scene and the picture, and how changes are
//! undone.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use ::experiments::definition;
use eframe::egui::Modifiers;
use image::{Rgb, RgbImage};
use kernels::frame::Renderer;
use kernels::oracle::Pixel;
use kernels::scene::{self, Scene, StrokeKind};
use workbench::model::brush::{Ground, length_m};
use workbench::model::picture::Shown;
use workbench::model::viewpoint::Viewpoint;
use workbench::script::{Stage, Step};

use crate::workbench::{cheap_stage, take};

use crate::fixtures::{Folder, gpu};

/// The application with a view down onto a few metres of ground. The pixel in the middle of the picture is inspected.
fn stage() -> Stage {
    let mut stage = cheap_stage();
    let mut pose = stage.model().shown().expect("a picture").pose;
    (pose.position.z, pose.pitch) = (pose.position.z + 8.0, -0.8);
    stage.model().viewpoint = Viewpoint::Free { pose, walking: false };
    stage.model().probe = Some([0.5, 0.5]);
    stage.settle().expect("a picture");
    stage
}

fn shown(stage: &mut Stage) -> Arc<Shown> {
    stage.model().shown().expect("a picture").clone()
}

fn pixel(shown: &Shown) -> &Pixel {
    shown.pixel.as_ref().expect("ground in the middle of the picture")
}

/// Names of the materials of the splat texels around the inspected pixel.
fn lying(shown: &Shown) -> BTreeSet<String> {
    pixel(shown).splat.iter().map(|texel| texel.material.clone()).collect()
}

fn differing(a: &Shown, b: &Shown) -> usize {
    assert_eq!(a.picture.hdr.len(), b.picture.hdr.len());
    a.picture.hdr.iter().zip(&b.picture.hdr).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

/// The name of a material of the scene that is not in `lying`.
fn another(stage: &mut Stage, lying: &BTreeSet<String>) -> String {
    let materials = &stage.model().settings.scene.materials;
    materials.iter().map(|material| material.name.clone()).rfind(|name| !lying.contains(name)).expect("more materials than four")
}

fn says(stage: &Stage, text: &str) -> bool {
    stage.names().iter().any(|name| name.contains(text))
}

/// Selects the material of the inspected pixel in the panel of materials. Returns the picture that was shown before, and the material's name.
fn select_lying(stage: &mut Stage) -> (Arc<Shown>, String) {
    let before = shown(stage);
    let name = pixel(&before).splat[0].material.clone();
    take(stage, &format!("click Materials; click Material {name}"));
    (before, name)
}

#[test]
fn a_drag_paints_the_ground_and_undo_takes_the_whole_drag_back() {
    let mut stage = stage();
    take(&mut stage, "click Brush; click Paint");
    let before = shown(&mut stage);
    // The brush and the pixel inspector must find the same position on the ground.
    let ground = Ground::of(&before).expect("the depth is asked for");
    assert_eq!(ground.at([0.5, 0.5]).expect("ground").to_array(), pixel(&before).position);

    let name = another(&mut stage, &lying(&before));
    take(&mut stage, &format!("click Brush material; click {name}; set Brush radius = 4"));
    stage.drag([-100.0, 100.0]).expect("a picture");
    let painted = shown(&mut stage);
    let strokes = &painted.wish.settings.scene.strokes;
    let stroke = &strokes[0];
    assert_eq!((strokes.len(), stroke.kind, stroke.material.as_str(), stroke.radius_m), (1, StrokeKind::Splat, name.as_str(), 4.0));
    assert!((2..100).contains(&stroke.points.len()) && length_m(stroke) > 1.0, "{stroke:?}");
    assert_eq!(lying(&painted), BTreeSet::from([name]), "the painted material must be on all four texels");
    assert!(differing(&before, &painted) > 20, "{} pixels", differing(&before, &painted));
    assert_eq!(painted.pose, before.pose, "the camera must not move");

    take(&mut stage, "click Undo");
    let undone = shown(&mut stage);
    assert!(undone.wish.settings.scene.strokes.is_empty(), "one undo must remove the whole drag");
    assert_eq!((differing(&before, &undone), lying(&undone)), (0, lying(&before)));
    take(&mut stage, "click Redo");
    let redone = shown(&mut stage);
    assert_eq!(differing(&painted, &redone), 0);

    // A drag with Shift turns the camera even while the brush is active. A drag without the brush turns it, too.
    stage.drag_with(Modifiers::SHIFT, [40.0, 0.0]).expect("a picture");
    assert!(shown(&mut stage).pose != before.pose);
    let turned = shown(&mut stage).pose;
    take(&mut stage, "key B");
    stage.drag([-40.0, 0.0]).expect("a picture");
    assert!(shown(&mut stage).pose != turned);
    assert_eq!(stage.model().settings.scene.strokes.len(), 1);
}

#[test]
fn clicks_paint_dabs_that_are_listed_and_removed() {
    let mut stage = stage();
    take(&mut stage, "click Brush; key B");
    assert!(stage.model().brush.paints);
    let before = shown(&mut stage);
    let name = another(&mut stage, &lying(&before));
    take(&mut stage, &format!("click Brush material; click {name}; set Brush radius = 2"));
    stage.model().probe = None;
    take(&mut stage, "click Picture");
    assert_eq!(stage.model().probe, None, "a click of the brush must not inspect a pixel");
    assert!(stage.has(&format!("Stroke 1: Splat, {name}, 1 point, 0.0 m long")), "{:?}", stage.names());
    let dab = shown(&mut stage);
    assert!(differing(&before, &dab) > 0);
    // A mask is painted over the dab. It changes the weights of the splat rules, and this change fades out towards the edge of the mask.
    take(&mut stage, "click Brush kind; click Mask; set Brush fade = 1; set Brush amount = 0.5; click Picture");
    let strokes = stage.model().settings.scene.strokes.clone();
    assert_eq!((strokes.len(), strokes[1].kind, strokes[1].fade_m, strokes[1].amount), (2, StrokeKind::Mask, 1.0, 0.5));
    take(&mut stage, "click Remove stroke 2");
    assert_eq!((stage.model().settings.scene.strokes.len(), differing(&dab, &shown(&mut stage))), (1, 0));
    take(&mut stage, "click Picture; click Clear strokes");
    assert!(stage.model().settings.scene.strokes.is_empty());
    assert_eq!(differing(&before, &shown(&mut stage)), 0);
    // Clearing the strokes can be undone.
    take(&mut stage, "click Undo");
    assert_eq!(stage.model().settings.scene.strokes.len(), 2);
}

#[test]
fn a_tint_changes_the_picture_and_reset_brings_it_back() {
    let mut stage = stage();
    let (before, name) = select_lying(&mut stage);
    let original = stage.model().settings.scene.clone();
    let albedo = |shown: &Shown, name: &str| shown.mean_albedo(name).expect("it is in the scene");
    let usual = albedo(&before, &name);
    take(&mut stage, "set Tint red = 0.25");
    let dimmed = albedo(&shown(&mut stage), &name);
    assert!(dimmed[0] < 0.99 * usual[0] && dimmed[1..] == usual[1..] && usual[0] > 0.0, "{dimmed:?} of {usual:?}");
    take(&mut stage, "click Reset Tint");
    for (change, reset) in [
        ("set Tint red = 0.25", "click Reset Tint"),
        ("click Texture source; click sand", "click Reset material"),
        ("type Material name = stone", "click Reset material"),
    ] {
        take(&mut stage, change);
        let changed = shown(&mut stage);
        let has_new_name = change.contains("name");
        assert_eq!(differing(&before, &changed) == 0, has_new_name, "{change}");
        assert_eq!(lying(&changed).contains("stone"), has_new_name, "{change}: the rules must use the new name");
        take(&mut stage, reset);
        assert!(stage.model().settings.scene == original, "{change}");
        assert_eq!(differing(&before, &shown(&mut stage)), 0, "{reset} after {change}");
    }
    // Each control sets its own value.
    take(&mut stage, "set Texture tile = 7; set Texture turn = 45; set Normal strength = 0.5; set Tint blue = 3");
    let material = stage.model().settings.scene.materials.iter().find(|material| material.name == name).expect("it is there").clone();
    assert_eq!((material.tile_m, material.orientation_deg, material.normal_strength, material.tint[2]), (7.0, 45.0, 0.5, 3.0));
    take(&mut stage, "click Reset Texture tile; click Reset Texture turn; click Reset Normal strength; click Reset Tint");
    assert!(stage.model().settings.scene == original);
    // A material that is in use cannot be removed; an unused material can. A name that a different material already has is refused.
    take(&mut stage, "click Remove material");
    assert!(says(&stage, &format!("`{name}` is used by")) && stage.model().settings.scene == original, "{:?}", stage.names());
    take(&mut stage, &format!("click Material {name}; click Add material; type Material name = {name}"));
    assert!(says(&stage, "is the name of another material"), "{:?}", stage.names());
    assert_eq!(stage.model().settings.scene.materials.last().map(|material| material.name.clone()), Some(format!("{name} 2")));
    take(&mut stage, "click Remove material");
    assert!(stage.model().settings.scene == original);
}

#[test]
fn rules_are_removed_moved_and_brought_back() {
    let mut stage = stage();
    let before = shown(&mut stage);
    let original = stage.model().settings.scene.clone();
    let name = pixel(&before).splat[0].material.clone();
    take(&mut stage, "click Rules");
    let open = |stage: &mut Stage, number: usize| {
        let material = stage.model().settings.scene.rules[number - 1].material.clone();
        if !stage.has(&format!("Remove rule {number}")) {
            take(stage, &format!("click Rule {number}: {material}"));
        }
    };
    while let Some(i) = stage.model().settings.scene.rules.iter().position(|rule| rule.material == name) {
        open(&mut stage, i + 1);
        take(&mut stage, &format!("click Remove rule {}", i + 1));
    }
    let removed = shown(&mut stage);
    assert!(!lying(&removed).contains(&name) && differing(&before, &removed) > 0, "{name} is still on the ground");
    take(&mut stage, "click Reset rules");
    assert!(stage.model().settings.scene == original && differing(&before, &shown(&mut stage)) == 0);

    open(&mut stage, 1);
    take(&mut stage, "click Move rule 1 down");
    assert_eq!(stage.model().settings.scene.rules[1], original.rules[0]);
    open(&mut stage, 2);
    take(&mut stage, "click Move rule 2 up");
    assert!(stage.model().settings.scene == original);
    // A new rule is a copy of the last one, so it does not change the picture.
    take(&mut stage, "click Add rule");
    assert_eq!((stage.model().settings.scene.rules.len(), differing(&before, &shown(&mut stage))), (original.rules.len() + 1, 0));
    take(&mut stage, "click Reset rules");
    // The lower end of a height band cannot be moved above its upper end.
    let i = original.rules.iter().position(|rule| rule.height_m.is_some()).expect("a rule of the built-in scene");
    let [from, to] = original.rules[i].height_m.expect("just found");
    open(&mut stage, i + 1);
    take(&mut stage, &format!("set Rule {0} height from = {1}; set Rule {0} weight = 0.5", i + 1, to + 1000.0));
    let rule = stage.model().settings.scene.rules[i].clone();
    assert_eq!((rule.height_m, rule.weight), (Some([to, to]), 0.5));
    assert!(from < to);
    take(&mut stage, &format!("click Rule {} height band", i + 1));
    assert_eq!(stage.model().settings.scene.rules[i].height_m, None);
}

#[test]
fn a_folder_that_is_none_is_refused_in_one_line_and_the_picture_stays() {
    let folder = Folder::new("editing-textures");
    let mut stage = stage();
    let (before, _) = select_lying(&mut stage);
    let original = stage.model().settings.scene.clone();
    let typed = |stage: &mut Stage, path: &str| take(stage, &format!("type Texture folder = {path}; click Use texture folder"));
    let empty = folder.path(".");
    let refused =
        [("", "type the name of a folder"), ("/nowhere/at/all", "cannot read the folder /nowhere/at/all"), (empty.as_str(), "no albedo")];
    for (path, text) in refused {
        typed(&mut stage, path);
        assert!(says(&stage, text), "{path}: {:?}", stage.names());
        assert!(stage.model().settings.scene == original && differing(&before, &shown(&mut stage)) == 0, "{path}");
    }
    // If the files are not images, the drawing thread reports an error, and the picture does not change.
    for map in ["albedo", "normal", "height", "roughness"] {
        folder.write(&format!("{map}.png"), "no image");
    }
    take(&mut stage, &format!("type Texture folder = {}", folder.path(".")));
    let error = stage.take(&Step::Click("Use texture folder".to_owned())).expect_err("no images").to_string();
    assert!(error.contains("not a readable PNG") && error.lines().count() == 1, "{error}");
    assert_eq!(differing(&before, &shown(&mut stage)), 0);
    // Once the folder contains images, the material shows them.
    for (map, colour) in [("albedo", [250, 20, 20]), ("normal", [128, 128, 255]), ("height", [128; 3]), ("roughness", [200; 3])] {
        RgbImage::from_pixel(16, 16, Rgb(colour)).save(Path::new(&folder.path(&format!("{map}.png")))).expect("can be written");
    }
    stage.model().settings.scene = original.clone();
    stage.settle().expect("the picture that is there");
    for _ in 0..6000 {
        if stage.model().failure().is_none() {
            break;
        }
        std::thread::sleep(Duration::from_millis(10));
        stage.settle().expect("the picture that is there");
    }
    typed(&mut stage, &folder.path("."));
    assert!(differing(&before, &shown(&mut stage)) > 0);
    take(&mut stage, "click Reset material");
    assert!(stage.model().settings.scene == original && differing(&before, &shown(&mut stage)) == 0);
}

#[test]
fn what_was_edited_is_saved_and_drawn_from_the_file_as_it_was_on_screen() {
    let folder = Folder::new("editing-saved");
    let mut stage = stage();
    let (before, _) = select_lying(&mut stage);
    take(&mut stage, "set Tint red = 0.4; type Material name = red earth; set Texture tile = 2.5");
    stage.model().settings.scene.rules[0].weight = 0.06;
    let other = another(&mut stage, &lying(&before));
    take(&mut stage, &format!("click Brush; click Paint; click Brush material; click {other}; set Brush radius = 2.5"));
    stage.drag([-50.0, 70.0]).expect("a picture");
    let edited = shown(&mut stage);
    let scene = stage.model().settings.scene.clone();
    assert!(scene.strokes.len() == 1 && differing(&before, &edited) > 0);
    let same = |read: &Scene| Scene { folder: scene.folder.clone(), ..read.clone() } == scene;

    let file = folder.path("edited.toml");
    take(&mut stage, &format!("click Materials; type Scene file = {file}; click Save scene as..."));
    assert!(same(&scene::load(&file).expect("it is read")), "{:?}", stage.names());
    // An existing file is overwritten only if it is this scene's own file and `Overwrite` is ticked.
    let text = std::fs::read(&file).expect("it is there");
    take(&mut stage, "set Texture tile = 5; click Save scene as...");
    assert!(says(&stage, "tick `Overwrite`") && std::fs::read(&file).expect("still there") == text, "{:?}", stage.names());
    take(&mut stage, "click Overwrite; click Save scene as...");
    assert!(says(&stage, "Saved") && std::fs::read(&file).expect("there") != text, "{:?}", stage.names());
    let foreign = folder.write("foreign.toml", "mine");
    take(&mut stage, &format!("type Scene file = {foreign}; click Save scene as..."));
    assert!(says(&stage, "not this scene's own file") && std::fs::read(&foreign).expect("there") == b"mine", "{:?}", stage.names());

    // The scene is saved as an experiment. A run of the experiment must read the scene that is on screen and draw the same picture.
    take(&mut stage, "set Texture tile = 2.5; click Experiments");
    take(&mut stage, &format!("type Folder = {}; type Experiment name = painted; click Save as experiment", folder.0.display()));
    let saved = definition::load(&folder.0.join("painted").join("painted.toml")).expect("it is saved");
    let mut read = saved.scene(&None, None).expect("its scene is there");
    // The saved scene has one additional camera: the view on screen.
    assert_eq!(read.cameras.len(), scene.cameras.len() + 1);
    read.cameras.truncate(scene.cameras.len());
    assert!(same(&read));
    let mut renderer = Renderer::new(gpu(), &read, &|_| {}).expect("it can be drawn");
    let wish = &edited.wish;
    let drawn = renderer.render(&wish.settings.request(edited.pose, wish.size, wish.frame, &[])).expect("renders");
    let bits = |texels: &[[f32; 4]]| texels.iter().map(|texel| texel.map(f32::to_bits)).collect::<Vec<_>>();
    assert!(bits(&drawn.hdr) == bits(&edited.picture.hdr), "a run draws a different picture than the window");
}

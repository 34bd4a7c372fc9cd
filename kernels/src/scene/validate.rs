//! Validates the constraints on a scene that the Rust types cannot express: ranges, unique names, and references to names and files that must exist.

use super::settings::FAR_M;
use super::{CameraPose, Hole, Rule, Scene, Stroke, World};
use crate::base::document::{At, Checked};
use crate::base::error::{Error, Result, one_line};
use crate::base::names::suggestion;
use crate::settings;

/// Checks a scene that was read from a file or built in code: sizes, ranges, the uniqueness of names, and the existence of the names and files to
/// which the scene refers.
///
/// # Errors
/// The first problem, with its place in the scene.
pub fn validate(scene: &Scene) -> Result<()> {
    check(scene).map_err(|problem| Error::Scene { where_: format!("`{}`", one_line(&scene.name)), what: problem.to_string() })
}

/// Checks a scene against the data of its world: if the scene uses cliff flavours, the world must have slopes that are steep enough for cliffs.
///
/// `max_slope_deg`: the steepest slope of the world, degrees.
///
/// # Errors
/// The scene uses cliff flavours, but the steepest slope is less than `flavours.cliff_slope_deg`.
pub fn validate_against_world(scene: &Scene, max_slope_deg: f64) -> Result<()> {
    let asked = scene.flavours.cliff_slope_deg;
    // This form of the condition also refuses a slope of NaN.
    if !scene.flavours.has_cliffs() || max_slope_deg >= asked {
        return Ok(());
    }
    Err(Error::Scene {
        where_: format!("`{}`", scene.name),
        what: format!(
            "flavours, cliff_slope_deg: cliffs start at {asked} degrees, but the steepest slope of this world is {max_slope_deg:.1}: \
             lower cliff_slope_deg below that, add relief (world, detail_m), or set cliff_slope_deg to 90 for no cliffs"
        ),
    })
}

/// Largest number of points of one stroke. The number is limited, because splat texels near a stroke are compared with all points of the stroke.
const MOST_POINTS: usize = 65_536;

pub(super) fn check(scene: &Scene) -> Checked {
    let top = At::top();
    top.key("name").name(&scene.name)?;
    settings::check(super::settings(), scene)?;
    world(&top.key("world"), scene)?;
    materials(&top.key("material"), scene)?;
    rules(&top.key("rule"), scene)?;
    strokes(&top.key("stroke"), scene)?;
    flavours(&top.key("flavours"), scene)?;
    cameras(&top, scene)
}

fn world(at: &At, scene: &Scene) -> Checked {
    let hole_list = match &scene.world {
        World::Procedural { holes, .. } => holes,
        World::Heightmap { file, height_range_m, holes, .. } => {
            let [low, high] = *height_range_m;
            if low >= high {
                at.key("height_range_m").fail(format!(
                    "[{low}, {high}] must go from low to high: the elevations of the smallest and the largest possible sample"
                ))?;
            }
            let path = scene.folder.join(file);
            if !path.is_file() {
                at.key("file").fail(format!("there is no file {}: the name is relative to the scene file's folder", path.display()))?;
            }
            holes
        }
    };
    holes(&at.key("holes"), hole_list)
}

fn holes(at: &At, holes: &[Hole]) -> Checked {
    for (i, hole) in holes.iter().enumerate() {
        let at = at.index(i);
        at.key("centre").all_within(&hole.centre, -FAR_M, FAR_M)?;
        at.key("radius_m").positive(hole.radius_m, FAR_M)?;
    }
    Ok(())
}

fn materials(at: &At, scene: &Scene) -> Checked {
    let count = scene.materials.len();
    if count == 0 {
        at.fail("there is none: give at least one [[material]]")?;
    }
    if count > 256 {
        at.fail(format!("there are {count}, but the 8-bit index of a splat map allows at most 256: remove {}", count - 256))?;
    }
    at.unique_names(scene.materials.iter().map(|m| m.name.as_str()))?;
    for (i, material) in scene.materials.iter().enumerate() {
        let at = at.index(i);
        at.key("name").name(&material.name)?;
        match (&material.procedural, &material.folder) {
            (Some(_), None) => {}
            (None, Some(folder)) => {
                let path = scene.folder.join(folder);
                if !path.is_dir() {
                    at.key("folder")
                        .fail(format!("there is no folder {}: the name is relative to the scene file's folder", path.display()))?;
                }
            }
            (None, None) => at.fail(format!("`{}` has no textures: give `procedural` or `folder`", material.name))?,
            (Some(_), Some(_)) => at.fail(format!("`{}` gives both `procedural` and `folder`: remove one", material.name))?,
        }
        at.key("tile_m").positive(material.tile_m, 1.0e5)?;
        at.key("orientation_deg").within(material.orientation_deg, -360.0, 360.0)?;
        at.key("tint").all_within(&material.tint, 0.0, 16.0)?;
        at.key("normal_strength").within(material.normal_strength, 0.0, 16.0)?;
    }
    Ok(())
}

fn rules(at: &At, scene: &Scene) -> Checked {
    if scene.rules.is_empty() {
        at.fail("there is none: give at least one [[rule]]; without rules, splat texels have no material")?;
    }
    let names = material_names(scene);
    for (i, rule) in scene.rules.iter().enumerate() {
        one_rule(&at.index(i), rule, &names)?;
    }
    Ok(())
}

fn material_names(scene: &Scene) -> Vec<&str> {
    scene.materials.iter().map(|m| m.name.as_str()).collect()
}

fn known_material(at: &At, name: &str, materials: &[&str]) -> Checked {
    if materials.contains(&name) {
        return Ok(());
    }
    at.key("material").fail(format!("no material is called `{name}`: {}", suggestion(name, materials)))
}

fn one_rule(at: &At, rule: &Rule, materials: &[&str]) -> Checked {
    known_material(at, &rule.material, materials)?;
    at.key("weight").positive(rule.weight, 1.0e6)?;
    at.key("height_m").band(rule.height_m, -FAR_M, FAR_M)?;
    at.key("height_fade_m").within(rule.height_fade_m, 0.0, FAR_M)?;
    at.key("slope_deg").band(rule.slope_deg, 0.0, 90.0)?;
    at.key("slope_fade_deg").within(rule.slope_fade_deg, 0.0, 90.0)?;
    at.key("curvature").band(rule.curvature, -1.0e3, 1.0e3)?;
    at.key("curvature_fade").within(rule.curvature_fade, 0.0, 1.0e3)?;
    at.key("noise_m").within(rule.noise_m, 0.0, 1.0e5)?;
    at.key("noise_cover").within(rule.noise_cover, 0.0, 1.0)
}

fn strokes(at: &At, scene: &Scene) -> Checked {
    let names = material_names(scene);
    scene.strokes.iter().enumerate().try_for_each(|(i, stroke)| one_stroke(&at.index(i), stroke, &names))
}

fn one_stroke(at: &At, stroke: &Stroke, materials: &[&str]) -> Checked {
    known_material(at, &stroke.material, materials)?;
    let points = at.key("points");
    match stroke.points.len() {
        0 => points.fail("there is none: give at least one [x, y], world metres")?,
        1..=MOST_POINTS => {}
        count => points.fail(format!("there are {count}, must be at most {MOST_POINTS}: leave some out, or split the stroke in two"))?,
    }
    // There may be many points, so the path to a point in the file is built only for a point that is refused.
    if let Some(i) = stroke.points.iter().position(|point| !point.iter().all(|x| x.abs() <= FAR_M)) {
        points.index(i).all_within(&stroke.points[i], -FAR_M, FAR_M)?;
    }
    at.key("radius_m").positive(stroke.radius_m, FAR_M)?;
    if !(0.0..=stroke.radius_m).contains(&stroke.fade_m) {
        let (fade, radius) = (stroke.fade_m, stroke.radius_m);
        at.key("fade_m")
            .fail(format!("is {fade}, must lie in 0..={radius}: the soft edge lies inside the line, so it is at most radius_m wide"))?;
    }
    at.key("amount").within(stroke.amount, 0.0, 1.0e6)
}

/// Checks the relations between distances, and between slopes.
fn flavours(at: &At, scene: &Scene) -> Checked {
    let f = &scene.flavours;
    if !f.has_cliffs() {
        return Ok(());
    }
    if f.cliff_near_m >= f.cliff_far_atlas_m {
        at.key("cliff_near_m").fail(format!(
            "is {}, must be less than cliff_far_atlas_m = {}: the flavour far-cliff covers the distances between the two",
            f.cliff_near_m, f.cliff_far_atlas_m
        ))?;
    }
    if f.far_atlas_m > f.cliff_far_atlas_m {
        at.key("far_atlas_m").fail(format!(
            "is {}, must not exceed cliff_far_atlas_m = {}: cliffs must not change to the far atlas nearer than flat ground does",
            f.far_atlas_m, f.cliff_far_atlas_m
        ))?;
    }
    if f.splat_band_deg >= f.cliff_slope_deg {
        at.key("splat_band_deg").fail(format!(
            "is {}, must be less than cliff_slope_deg = {}: the band lies just below the cliffs",
            f.splat_band_deg, f.cliff_slope_deg
        ))?;
    }
    Ok(())
}

fn cameras(top: &At, scene: &Scene) -> Checked {
    let cameras = top.key("camera");
    cameras.unique_names(scene.cameras.iter().map(|c| c.name.as_str()))?;
    for (i, pose) in scene.cameras.iter().enumerate() {
        camera(&cameras.index(i), pose)?;
    }
    let paths = top.key("path");
    paths.unique_names(scene.paths.iter().map(|p| p.name.as_str()))?;
    for (i, path) in scene.paths.iter().enumerate() {
        let at = paths.index(i);
        at.key("name").file_stem(&path.name)?;
        at.key("frames_per_key").within(f64::from(path.frames_per_key), 1.0, 1.0e6)?;
        let keys = at.key("key");
        if path.keys.len() < 2 {
            keys.fail(format!("path `{}` has {} key poses, but a path needs at least two [[path.key]]", path.name, path.keys.len()))?;
        }
        for (i, pose) in path.keys.iter().enumerate() {
            camera(&keys.index(i), pose)?;
        }
    }
    Ok(())
}

fn camera(at: &At, pose: &CameraPose) -> Checked {
    at.key("name").file_stem(&pose.name)?;
    at.key("position").all_within(&pose.position, -FAR_M, FAR_M)?;
    at.key("yaw_deg").within(pose.yaw_deg, -3600.0, 3600.0)?;
    at.key("pitch_deg").within(pose.pitch_deg, -90.0, 90.0)?;
    at.key("fov_deg").within(pose.fov_deg, 1.0, 175.0)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::scene::{DEFAULT, DEFAULT_TEXT, StrokeKind, parse};

    fn painted() -> Scene {
        let mut scene = parse(DEFAULT_TEXT, DEFAULT, Path::new("")).expect("built in");
        scene.strokes = vec![Stroke {
            kind: StrokeKind::Mask,
            material: scene.materials[0].name.clone(),
            points: vec![[1.0, 2.0], [-3.5, 1.0e7]],
            radius_m: 4.0,
            fade_m: 4.0,
            amount: 0.0,
        }];
        scene
    }

    /// The error for a scene whose only stroke was changed.
    fn refused(change: impl FnOnce(&mut Stroke)) -> String {
        let mut scene = painted();
        change(&mut scene.strokes[0]);
        let text = validate(&scene).expect_err("refused").to_string();
        assert_eq!(text.lines().count(), 1, "{text}");
        text
    }

    #[test]
    fn strokes_at_their_limits_are_accepted() {
        let mut scene = painted();
        assert!(validate(&scene).is_ok());
        scene.strokes[0].points = vec![[0.0, 0.0]; MOST_POINTS];
        (scene.strokes[0].fade_m, scene.strokes[0].amount) = (0.0, 1.0e6);
        assert!(validate(&scene).is_ok());
    }

    #[test]
    fn a_stroke_that_cannot_be_laid_is_refused_with_its_place_and_remedy() {
        let name = painted().materials[0].name.clone();
        let text = refused(|stroke| stroke.material.push('x'));
        assert!(text.contains(&format!("stroke 1, material: no material is called `{name}x`: did you mean `{name}`?")), "{text}");
        let text = refused(|stroke| stroke.points.clear());
        assert!(text.contains("stroke 1, points: there is none: give at least one"), "{text}");
        let text = refused(|stroke| stroke.points = vec![[0.0, 0.0]; MOST_POINTS + 1]);
        assert!(text.contains("there are 65537, must be at most 65536"), "{text}");
        for wrong in [f64::NAN, f64::INFINITY, 1.1e7] {
            for k in [0, 1] {
                let text = refused(|stroke| stroke.points[1][k] = wrong);
                assert!(text.contains("stroke 1, points 2: is") && text.contains("must lie in"), "{wrong}: {text}");
            }
        }
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let text = refused(|stroke| stroke.radius_m = wrong);
            assert!(text.contains("stroke 1, radius_m: is") && text.contains("must be above 0"), "{wrong}: {text}");
        }
        for wrong in [-0.5, 4.5, f64::NAN] {
            let text = refused(|stroke| stroke.fade_m = wrong);
            assert!(text.contains("stroke 1, fade_m: is") && text.contains("must lie in 0..=4: "), "{wrong}: {text}");
        }
        for wrong in [-0.5, f64::NAN, f64::INFINITY] {
            let text = refused(|stroke| stroke.amount = wrong);
            assert!(text.contains("stroke 1, amount: is") && text.contains("must lie in 0..=1000000"), "{wrong}: {text}");
        }
    }
}

//! Changes of materials and rules that keep the scene consistent, and saving the scene as a file.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{self, Path, PathBuf};

use kernels::base::error::Error;
use kernels::base::files::write_whole;
use kernels::materials::folder::recognise;
use kernels::scene::{self, Material, Rule, Scene, World};

/// Maximum number of materials of a scene: as many as the index in a splat map can distinguish.
pub const MOST_MATERIALS: usize = 256;
/// Limit of the length of a name, characters.
const LONGEST_NAME: usize = 100;

/// Returns the scene with absolute paths, so that its file can be read from any folder.
///
/// # Errors
/// The path of a file that the scene names cannot be made absolute.
pub(crate) fn with_absolute_paths(scene: &Scene) -> Result<Scene, String> {
    let mut copy = scene.clone();
    let material_folders = copy.materials.iter_mut().filter_map(|material| material.folder.as_mut());
    let heightmap = match &mut copy.world {
        World::Heightmap { file, .. } => Some(file),
        World::Procedural { .. } => None,
    };
    for relative in material_folders.chain(heightmap) {
        let from_here = scene.folder.join(&*relative);
        *relative =
            path::absolute(&from_here).map_err(|error| format!("cannot make the path {} absolute: {error}", from_here.display()))?;
    }
    Ok(copy)
}

/// Renames a material, also in the rules and strokes that use it.
///
/// # Errors
/// One line: the name is not valid, or another material has it. Nothing is changed.
pub fn rename_material(scene: &mut Scene, index: usize, name: &str) -> Result<(), String> {
    if name.trim().is_empty() || name.chars().count() > LONGEST_NAME || name.chars().any(char::is_control) {
        return Err(format!("`{}` is not a valid name: give 1 to {LONGEST_NAME} characters on one line", name.escape_debug()));
    }
    if scene.materials.iter().enumerate().any(|(i, material)| i != index && material.name == name) {
        return Err(format!("`{name}` is the name of another material: give each material its own name"));
    }
    let Some(material) = scene.materials.get_mut(index) else { return Ok(()) };
    let before = std::mem::replace(&mut material.name, name.to_owned());
    let of_rules = scene.rules.iter_mut().map(|rule| &mut rule.material);
    let of_strokes = scene.strokes.iter_mut().map(|stroke| &mut stroke.material);
    for user in of_rules.chain(of_strokes).filter(|user| **user == before) {
        name.clone_into(user);
    }
    Ok(())
}

/// Adds a copy of the material with index `like`, under a new name. The copy is the last material, so that the indices of the other materials in the
/// palette do not change. Returns the index of the copy.
///
/// # Errors
/// One line: there is no material to copy, or the scene already has `MOST_MATERIALS` materials.
pub fn add_material(scene: &mut Scene, like: usize) -> Result<usize, String> {
    if scene.materials.len() >= MOST_MATERIALS {
        return Err(format!("there are {MOST_MATERIALS} materials, the most that a splat map can distinguish: remove one first"));
    }
    let Some(mut material) = scene.materials.get(like).cloned() else { return Err("there is no material to copy".to_owned()) };
    let is_taken = |name: &str| scene.materials.iter().any(|material| material.name == name);
    let mut number = 2;
    material.name = loop {
        let end = format!(" {number}");
        let room = LONGEST_NAME.saturating_sub(end.chars().count());
        let name: String = material.name.chars().take(room).chain(end.chars()).collect();
        if !is_taken(&name) {
            break name;
        }
        number += 1;
    };
    scene.materials.push(material);
    Ok(scene.materials.len() - 1)
}

/// Removes a material from the scene.
///
/// # Errors
/// One line: rules or strokes use the material, or it is the last material of the scene. Nothing is changed.
pub fn remove_material(scene: &mut Scene, index: usize) -> Result<(), String> {
    let Some(material) = scene.materials.get(index) else { return Ok(()) };
    let name = &material.name;
    let rules = scene.rules.iter().filter(|rule| rule.material == *name).count();
    let strokes = scene.strokes.iter().filter(|stroke| stroke.material == *name).count();
    let counted = |count: usize, what: &str| match count {
        0 => None,
        1 => Some(format!("1 {what}")),
        _ => Some(format!("{count} {what}s")),
    };
    let users: Vec<String> = [counted(rules, "rule"), counted(strokes, "stroke")].into_iter().flatten().collect();
    if !users.is_empty() {
        return Err(format!("`{name}` is used by {}: give these another material, or remove them first", users.join(" and ")));
    }
    if scene.materials.len() == 1 {
        return Err(format!("`{name}` is the last material, and a scene needs one: add another first"));
    }
    scene.materials.remove(index);
    Ok(())
}

/// Finds the material in the scene file (`original`) from which a material of the scene comes. `None` = there is none, or the conditions below do not
/// hold for a renamed material.
///
/// If a material in the file has the same name, the function returns that material. Otherwise, the material may have been renamed. The function then
/// returns the material in the file with the same index, under two conditions. First, no material of the scene has the name of the returned material.
/// Second, the scene has at least as many materials as the file. If it has fewer, materials were removed, and indices have shifted.
pub fn origin<'a>(scene: &Scene, original: &'a Scene, index: usize) -> Option<&'a Material> {
    let material = scene.materials.get(index)?;
    let namesake = original.materials.iter().find(|other| other.name == material.name);
    let has = |name: &str| scene.materials.iter().any(|material| material.name == name);
    let in_place = || original.materials.get(index).filter(|_| scene.materials.len() >= original.materials.len());
    namesake.or_else(|| in_place().filter(|other| !has(&other.name)))
}

/// Restores a material, including its name, from the file of the scene. A material for which [`origin`] finds none is not changed.
pub fn reset_material(scene: &mut Scene, original: &Scene, index: usize) {
    let Some(origin) = origin(scene, original, index) else { return };
    // Renaming succeeds: the name is valid, because the file has it, and no other material of the scene has this name.
    if rename_material(scene, index, &origin.name).is_ok()
        && let Some(material) = scene.materials.get_mut(index)
    {
        material.clone_from(origin);
    }
}

/// The rules in the file of the scene, with the current names of their materials.
///
/// # Errors
/// One line: a material that the rules use was removed.
pub fn usual_rules(scene: &Scene, original: &Scene) -> Result<Vec<Rule>, String> {
    let present = |name: &str| {
        let is_it = |&index: &usize| origin(scene, original, index).is_some_and(|material| material.name == name);
        (0..scene.materials.len()).find(is_it).map(|index| scene.materials[index].name.clone())
    };
    let named = |rule: &Rule| match present(&rule.material) {
        Some(material) => Ok(Rule { material, ..rule.clone() }),
        None => Err(format!("the rules of the file use `{}`, which was removed: add a material with that name first", rule.material)),
    };
    original.rules.iter().map(named).collect()
}

/// Takes the textures of a material from a folder. `folder` is absolute, or relative to the folder of the scene, as in a scene file.
///
/// # Errors
/// One line, see [`holds_textures`]. Nothing is changed.
pub fn take_folder(scene: &mut Scene, index: usize, folder: PathBuf) -> Result<(), String> {
    holds_textures(&scene.folder.join(&folder))?;
    if let Some(material) = scene.materials.get_mut(index) {
        (material.procedural, material.folder) = (None, Some(folder));
    }
    Ok(())
}

/// Checks that a folder contains the images of a material. Only the names of the files are checked. The drawing thread reads the images later,
/// because reading them takes longer.
///
/// # Errors
/// One line with the remedy, see [`recognise`].
pub fn holds_textures(folder: &Path) -> Result<(), String> {
    let wanted = "give a folder with images named albedo, normal, height, roughness";
    recognise(folder).map(drop).map_err(|what| format!("{what}; {wanted}"))
}

/// Returns the scene as it is written to a file in `folder`. If `folder` is not the folder of the scene, the paths in the scene become absolute.
fn from_folder(scene: &Scene, folder: &Path) -> Result<Scene, String> {
    let place = |folder: &Path| fs::canonicalize(if folder.as_os_str().is_empty() { Path::new(".") } else { folder }).ok();
    let stays = place(&scene.folder).is_some_and(|own| place(folder) == Some(own));
    let copy = if stays { scene.clone() } else { with_absolute_paths(scene)? };
    Ok(Scene { folder: folder.to_owned(), ..copy })
}

/// Writes a scene to a file, completely or not at all, after checking that [`scene::load`] reads it back unchanged. `own` are the files of this
/// scene. If `overwrites` is set, `file` may be one of these files, which is then overwritten. If `file` is any other existing file, it is not
/// overwritten. Returns the absolute path of the file.
///
/// # Errors
/// One line with the remedy: the scene is invalid, the file name is not suitable, the folder does not exist, the file exists already, or it cannot be
/// written or read back.
pub fn save(scene: &Scene, file: &Path, own: &[PathBuf], overwrites: bool) -> Result<PathBuf, String> {
    let shown = file.display();
    if file.extension().is_none_or(|extension| extension != "toml") {
        return Err(format!("`{shown}` is not a name for a scene file: give a file name that ends in .toml"));
    }
    scene::validate(scene).map_err(|error| format!("{error}; only a scene that can be drawn can be saved"))?;
    let file = path::absolute(file).map_err(|error| format!("cannot make {shown} absolute ({error}): give an absolute path"))?;
    let folder = file.parent().unwrap_or(Path::new("/"));
    if !folder.is_dir() {
        return Err(format!("there is no folder {}: create it, or choose another", folder.display()));
    }
    if file.symlink_metadata().is_ok() {
        let is_own = |own: &PathBuf| fs::canonicalize(own).is_ok_and(|own| fs::canonicalize(&file).is_ok_and(|file| file == own));
        if !own.iter().any(is_own) {
            return Err(format!("{shown} exists and is not this scene's own file, so it is not overwritten: choose another name"));
        }
        if !overwrites {
            return Err(format!("{shown} exists: tick `Overwrite` to replace this scene's own file, or choose another name"));
        }
    }
    let copy = from_folder(scene, folder)?;
    let text = toml::to_string(&copy).map_err(|error| format!("the scene cannot be written as TOML: {error}"))?;
    let done = write_whole(&file, |temporary| {
        let written = || -> std::io::Result<()> {
            let mut file = File::create(temporary)?;
            file.write_all(text.as_bytes())?;
            file.sync_all()
        };
        written().map_err(|source| Error::File { file: file.clone(), source })?;
        // Read the file in the same way as the next start does.
        let read = scene::load(&temporary.to_string_lossy())?;
        if read == copy { Ok(()) } else { Err(Error::Request("reading gives a different scene".to_owned())) }
    });
    done.map_err(|error| match error {
        Error::File { source, .. } => {
            format!("cannot write {shown}: {source}: make room if the disk is full, or choose a folder in which you may write")
        }
        Error::Scene { what, .. } | Error::Request(what) => {
            format!("{shown} is not written, because it could not be read back: {what}; if there are many or long strokes, remove some")
        }
        other => format!("cannot write {shown}: {other}"),
    })?;
    Ok(file)
}

#[cfg(test)]
mod tests {
    use kernels::materials;
    use kernels::scene::{Stroke, StrokeKind, World};

    use super::*;
    use crate::model::brush::{MOST_IN_ALL, MOST_STROKES};
    use crate::test_folder::Folder;

    fn plain() -> Scene {
        scene::load(scene::DEFAULT).expect("built in")
    }

    fn place(scene: &Scene, name: &str) -> usize {
        scene.materials.iter().position(|material| material.name == name).expect("a material")
    }

    /// The built-in scene with edits of materials, strokes and rules.
    fn edited() -> Scene {
        let mut scene = plain();
        let moss = place(&scene, "moss");
        scene.materials[moss].tint = [0.1 + 0.2, 1.0 / 3.0, 2.5];
        rename_material(&mut scene, moss, "old \"moss\" = {ü}").expect("a name");
        let added = add_material(&mut scene, moss).expect("there is room");
        let strokes = [StrokeKind::Splat, StrokeKind::Mask].map(|kind| Stroke {
            kind,
            material: scene.materials[added].name.clone(),
            points: vec![[1.0, -2.0], [1e-7, 3.0 / 7.0], [-1234.5, 0.0]],
            radius_m: 2.5,
            fade_m: 0.5,
            amount: 0.75,
        });
        scene.strokes.extend(strokes);
        scene.rules[1].height_m = None;
        scene.rules[2].curvature = Some([-0.5, 1e-3]);
        scene.rules.swap(0, 3);
        scene
    }

    #[test]
    fn a_new_name_goes_into_rules_and_strokes() {
        let mut scene = edited();
        let users = |scene: &Scene, name: &str| {
            let rules = scene.rules.iter().filter(|rule| rule.material == name).count();
            [rules, scene.strokes.iter().filter(|stroke| stroke.material == name).count()]
        };
        let granite = place(&scene, "granite");
        let before = users(&scene, "granite");
        scene.strokes[0].material = "granite".to_owned();
        rename_material(&mut scene, granite, "basalt").expect("a name");
        assert_eq!((users(&scene, "basalt"), users(&scene, "granite")), ([before[0], 1], [0, 0]));
        assert!(before[0] > 0 && scene::validate(&scene).is_ok());
        // An invalid name, or one that is taken, changes nothing.
        let was = scene.clone();
        for (name, says) in [("", "not a valid"), (" ", "not a valid"), ("a\nb", "not a valid"), ("grass", "another material")] {
            let error = rename_material(&mut scene, granite, name).expect_err(name);
            assert!(error.contains(says) && error.lines().count() == 1, "{error}");
            assert!(scene == was, "{name}");
        }
        assert!(rename_material(&mut scene, granite, &"x".repeat(101)).is_err() && scene == was);
        rename_material(&mut scene, granite, "basalt").expect("its own");
        assert!(scene == was);
    }

    #[test]
    fn a_copy_has_a_name_of_its_own() {
        let mut scene = plain();
        let long = "x".repeat(LONGEST_NAME);
        rename_material(&mut scene, 0, &long).expect("a name");
        for number in ["2", "3"] {
            let added = add_material(&mut scene, 0).expect("there is room");
            assert_eq!(scene.materials[added].name, format!("{} {number}", "x".repeat(LONGEST_NAME - 2)));
            assert_eq!(scene.materials[added].procedural, scene.materials[0].procedural);
        }
        assert!(scene::validate(&scene).is_ok());
        while scene.materials.len() < MOST_MATERIALS {
            add_material(&mut scene, 1).expect("there is room");
        }
        assert!(scene::validate(&scene).is_ok());
        assert!(add_material(&mut scene, 1).expect_err("full").contains("remove one first"));
    }

    #[test]
    fn what_is_used_is_not_removed() {
        let mut scene = plain();
        let grass = place(&scene, "grass");
        let refused = |scene: &mut Scene, says: &str| {
            let before = scene.clone();
            let error = remove_material(scene, grass).expect_err(says);
            assert!(error.contains(says) && *scene == before, "{error}");
        };
        refused(&mut scene, "`grass` is used by 1 rule:");
        let rule = scene.rules.iter().find(|rule| rule.material == "grass").expect("one").clone();
        scene.rules.push(rule);
        scene.strokes.push(Stroke { material: "grass".to_owned(), ..edited().strokes[0].clone() });
        refused(&mut scene, "`grass` is used by 2 rules and 1 stroke:");
        scene.rules.retain(|rule| rule.material != "grass");
        refused(&mut scene, "used by 1 stroke:");
        scene.strokes.clear();
        let count = scene.materials.len();
        remove_material(&mut scene, grass).expect("nothing uses it");
        assert!(scene.materials.len() == count - 1 && scene.materials.iter().all(|material| material.name != "grass"));
        assert!(scene::validate(&scene).is_ok());
        scene.materials.truncate(1);
        scene.rules.clear();
        assert!(remove_material(&mut scene, 0).expect_err("the last").contains("add another first"));
    }

    #[test]
    fn a_material_knows_what_it_was() {
        let original = plain();
        let mut scene = original.clone();
        let (moss, snow) = (place(&scene, "moss"), place(&scene, "snow"));
        scene.materials[moss].tile_m *= 2.0;
        rename_material(&mut scene, moss, "old moss").expect("a name");
        let added = add_material(&mut scene, snow).expect("there is room");
        assert_eq!(origin(&scene, &original, moss), Some(&original.materials[moss]));
        assert_eq!(origin(&scene, &original, snow), Some(&original.materials[snow]));
        assert_eq!(origin(&scene, &original, added), None);
        // A reset of the rules uses the current names of the materials.
        scene.rules.truncate(1);
        scene.rules = usual_rules(&scene, &original).expect("all are there");
        assert!(scene::validate(&scene).is_ok() && scene.rules.iter().any(|rule| rule.material == "old moss"));
        reset_material(&mut scene, &original, added);
        reset_material(&mut scene, &original, moss);
        scene.materials.pop();
        assert!(scene == original);
        scene.rules.retain(|rule| rule.material != "moss");
        remove_material(&mut scene, moss).expect("nothing uses it");
        let error = usual_rules(&scene, &original).expect_err("moss is gone");
        assert!(error.contains("`moss`") && error.contains("removed"), "{error}");
    }

    #[test]
    fn a_folder_without_textures_is_refused_and_the_material_stays() {
        let folder = Folder::new("textures");
        let mut scene = plain();
        scene.folder.clone_from(&folder.0);
        let before = scene.clone();
        let error = take_folder(&mut scene, 0, "nowhere".into()).expect_err("there is none");
        assert!(error.contains("nowhere") && error.contains("albedo, normal, height, roughness"), "{error}");
        fs::create_dir(folder.0.join("rock")).expect("can be made");
        // Add the images one by one, in different formats. Each time, `take_folder` and the reader of textures report the same missing images.
        let files = ["albedo.png", "normal.jpg", "height.jpeg", "roughness.png"];
        for (i, file) in files.into_iter().enumerate() {
            let error = take_folder(&mut scene, 0, "rock".into()).expect_err("not all are there");
            let missing = format!("no {} map in", ["albedo", "normal", "height", "roughness"][i..].join(", no "));
            assert!(error.contains(&missing) && error.lines().count() == 1, "{error}");
            assert!(scene == before);
            let reader = materials::folder::load("rock", &folder.0.join("rock"), 8).expect_err("not all are there").to_string();
            assert!(reader.contains(&missing), "{reader}");
            fs::write(folder.0.join("rock").join(file), b"no image").expect("can be written");
        }
        take_folder(&mut scene, 0, "rock".into()).expect("all are there");
        assert_eq!((&scene.materials[0].procedural, &scene.materials[0].folder), (&None, &Some(PathBuf::from("rock"))));
        assert!(scene::validate(&scene).is_ok());
        let reader = materials::folder::load("rock", &folder.0.join("rock"), 8).expect_err("no images").to_string();
        assert!(reader.contains("albedo.png") && reader.contains("not a readable PNG"), "{reader}");
    }

    #[test]
    fn a_saved_scene_is_read_back_equal() {
        let folder = Folder::new("saved");
        let scene = edited();
        let file = save(&scene, &folder.0.join("edited.toml"), &[], false).expect("it is saved");
        let read = scene::load(&file.display().to_string()).expect("it is read");
        assert_eq!(read.folder, folder.0);
        assert!(Scene { folder: scene.folder.clone(), ..read } == scene);
        assert_eq!(folder.names(), ["edited.toml"], "no temporary file is left");
    }

    #[test]
    fn as_much_as_can_be_painted_is_saved() {
        let folder = Folder::new("painted");
        let mut scene = plain();
        let point = |i: usize| [1e4 * (i as f64).sin(), -1e4 * (i as f64).cos()];
        let of = |count: usize| Stroke { points: (0..count).map(point).collect(), ..edited().strokes[0].clone() };
        scene.strokes = (0..MOST_STROKES).map(|i| of(MOST_IN_ALL / MOST_STROKES + usize::from(i < MOST_IN_ALL % MOST_STROKES))).collect();
        scene.strokes.iter_mut().for_each(|stroke| stroke.material = "moss".to_owned());
        assert_eq!(scene.strokes.iter().map(|stroke| stroke.points.len()).sum::<usize>(), MOST_IN_ALL);
        let began = std::time::Instant::now();
        let file = save(&scene, &folder.0.join("painted.toml"), &[], false).expect("it is saved");
        println!("{} points in {:.1?}", MOST_IN_ALL, began.elapsed());
        let read = scene::load(&file.display().to_string()).expect("it is read");
        assert!(Scene { folder: scene.folder.clone(), ..read } == scene);
    }

    #[test]
    fn folders_are_found_from_the_new_place_too() {
        let folder = Folder::new("moved");
        let (from, to) = (folder.0.join("from"), folder.0.join("to"));
        for name in [&from, &to, &from.join("rock")] {
            fs::create_dir_all(name).expect("can be made");
        }
        fs::write(from.join("height.png"), b"not looked at").expect("can be written");
        let mut scene = plain();
        scene.folder.clone_from(&from);
        (scene.materials[0].procedural, scene.materials[0].folder) = (None, Some("rock".into()));
        scene.world = World::Heightmap {
            file: "height.png".into(),
            metres_per_texel: 2.0,
            height_range_m: [0.0, 100.0],
            detail_m: 0.0,
            seed: 0,
            holes: Vec::new(),
            colour_modulation: 0.0,
        };
        // If the scene is saved in its own folder, relative paths stay as they are.
        let file = save(&scene, &from.join("scene.toml"), &[], false).expect("it is saved");
        assert!(scene::load(&file.display().to_string()).expect("it is read") == scene);
        let file = save(&scene, &to.join("scene.toml"), &[], false).expect("it is saved");
        let read = scene::load(&file.display().to_string()).expect("its files are found");
        assert_eq!(read.materials[0].folder, Some(from.join("rock")));
        assert!(matches!(&read.world, World::Heightmap { file, .. } if *file == from.join("height.png")));
    }

    #[test]
    fn no_file_is_written_over_unasked() {
        let folder = Folder::new("over");
        let scene = edited();
        let file = folder.0.join("scene.toml");
        let other = folder.0.join("other.toml");
        fs::write(&other, b"mine").expect("can be written");
        save(&scene, &file, &[], false).expect("it is saved");
        let before = fs::read(&file).expect("written");
        let changed = plain();
        for (place, own, overwrites, says) in [
            (&file, vec![file.clone()], false, "tick `Overwrite`"),
            (&file, Vec::new(), true, "choose another name"),
            (&other, vec![file.clone()], true, "choose another name"),
            (&folder.0.join("scene.png"), Vec::new(), true, "ends in .toml"),
            (&folder.0.join("nowhere").join("scene.toml"), Vec::new(), true, "there is no folder"),
        ] {
            let error = save(&changed, place, &own, overwrites).expect_err(says);
            assert!(error.contains(says) && error.lines().count() == 1, "{error}");
        }
        assert_eq!((fs::read(&file).expect("there"), fs::read(&other).expect("there")), (before.clone(), b"mine".to_vec()));
        // The scene's own file may be overwritten, also if it is given by a different path.
        let own = folder.0.join(".").join("scene.toml");
        save(&changed, &file, &[own], true).expect("its own, and asked for");
        assert!(fs::read(&file).expect("there") != before);
        // A scene that cannot be drawn or read back is not saved.
        let mut wrong = edited();
        wrong.rules.clear();
        let error = save(&wrong, &folder.0.join("wrong.toml"), &[], false).expect_err("no rules");
        assert!(error.contains("rule"), "{error}");
        let mut large = edited();
        large.strokes = vec![Stroke { points: vec![[1.0 / 3.0, -2.0 / 3.0]; 60_000], ..large.strokes[0].clone() }; 3];
        let error = save(&large, &folder.0.join("large.toml"), &[], false).expect_err("too large to be read");
        assert!(error.contains("could not be read back") && error.contains("remove some"), "{error}");
        assert_eq!(folder.names(), ["other.toml", "scene.toml"]);
    }
}

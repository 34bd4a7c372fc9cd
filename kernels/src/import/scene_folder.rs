//! Makes a scene folder from a heightmap.

use std::fs::File;
use std::path::{Path, PathBuf};

use super::viewpoints;
use crate::base::error::{Error, Result};
use crate::base::files::WholeFolder;
use crate::decode::heightmap::{Heightmap, ReadOptions, read};
use crate::scene::{self, Material, Rule, Scene};
use crate::world::World;
use crate::world::rules::Rules;

/// Makes a scene folder from a heightmap. It contains `heightmap.png` (16 bits: 0 is the lowest elevation of the map, 65535 the highest),
/// `scene.toml` (materials, rules that suit the slopes and elevations, and four cameras found in the terrain) and, if `materials` is given,
/// a folder `materials/` with its images. `materials` is a folder with one sub-folder per material; without it, the scene has procedural
/// materials.
///
/// `detail_m`: limit, in metres, of the offset by which procedural relief raises or lowers the ground between the samples of the heightmap. With
/// 0, no relief is added, and the finest LOD follows from the resolution of the data. The folder is made either completely or not at all. Returns
/// the scene as written.
///
/// # Errors
/// The errors of [`read`]; [`Error::Request`] if `out_dir` exists and is not an empty folder, or if `detail_m` is negative; [`Error::Material`]
/// if the folder `materials` has no or too many materials; [`Error::File`] and [`Error::Image`] if writing fails.
pub fn import(source: &Path, options: &ReadOptions, materials: Option<&Path>, detail_m: f64, out_dir: &Path) -> Result<Scene> {
    if !(detail_m.is_finite() && detail_m >= 0.0) {
        return Err(Error::Request(format!("the detail is {detail_m} m; it must be 0 (no added relief) or more")));
    }
    refuse_occupied(out_dir)?;
    let map = read(source, options)?;
    let staging = WholeFolder::beside(out_dir)?;
    let scene = write_scene(&map, source, materials, detail_m, staging.folder())?;
    staging.finish()?;
    Ok(Scene { folder: out_dir.to_owned(), ..scene })
}

fn refuse_occupied(out_dir: &Path) -> Result<()> {
    let occupied = match std::fs::read_dir(out_dir) {
        Ok(mut entries) => entries.next().is_some(),
        Err(_) => out_dir.exists(),
    };
    if occupied {
        return Err(Error::Request(format!(
            "{} exists and is not an empty folder; give a different folder, or remove this one first",
            out_dir.display()
        )));
    }
    Ok(())
}

fn write_scene(map: &Heightmap, source: &Path, materials: Option<&Path>, detail_m: f64, folder: &Path) -> Result<Scene> {
    let (low, high) = map.elevation_range_m();
    write_png(map, [low, high], &folder.join("heightmap.png"))?;
    let materials = match materials {
        Some(from) => copy_materials(from, &folder.join("materials"))?,
        None => PROCEDURAL.iter().map(|name| material(name, true)).collect(),
    };
    let name = source.file_stem().map_or_else(|| "imported".to_owned(), |s| s.to_string_lossy().into_owned());
    let mut scene = Scene {
        description: format!("{name}: {} x {} samples, {} m apart, {low:.1} to {high:.1} m.", map.width, map.height, map.metres_per_texel),
        name,
        world: scene::World::Heightmap {
            file: PathBuf::from("heightmap.png"),
            metres_per_texel: map.metres_per_texel,
            height_range_m: [low, high],
            detail_m,
            seed: 1,
            holes: Vec::new(),
            colour_modulation: 0.0,
        },
        rules: Vec::new(),
        strokes: Vec::new(),
        materials,
        detail_size: 1024,
        flavours: Default::default(),
        blend: Default::default(),
        sun: Default::default(),
        sky: Default::default(),
        cameras: Vec::new(),
        paths: Vec::new(),
        folder: folder.to_owned(),
    };
    let bare = World::from_heightmap(map.clone(), detail_m, 1, Vec::new(), 0.0, Rules::new(&scene), scene.materials.len());
    let steepest = bare.max_slope_deg();
    // The slope at which cliffs begin depends on the steepest slope of the map: 45 degrees for steep terrain, a smaller slope for gentle terrain,
    // and 90 degrees, which means no cliffs, for a plain.
    scene.flavours.cliff_slope_deg = match steepest {
        s if s >= 55.0 => 45.0,
        s if s >= 25.0 => (0.8 * s).round(),
        _ => 90.0,
    };
    scene.rules = rules_for(&scene.materials, [low, high], scene.flavours.cliff_slope_deg.min(60.0).min(steepest.max(10.0)));
    // The cameras must stand on the ground of the written file, whose heights are quantised.
    let world = World::new(&scene)?;
    scene.cameras = viewpoints::find(&world, &scene);
    let text = toml::to_string(&scene).map_err(|e| Error::Scene { where_: "scene.toml".to_owned(), what: e.to_string() })?;
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).map_err(|source| Error::File { file, source })?;
    Ok(scene)
}

fn write_png(map: &Heightmap, [low, high]: [f64; 2], file: &Path) -> Result<()> {
    use image::ImageEncoder;
    let code = |s: &f32| ((f64::from(*s) - low) / (high - low) * 65535.0).round().clamp(0.0, 65535.0) as u16;
    let bytes: Vec<u8> = map.samples.iter().flat_map(|s| code(s).to_ne_bytes()).collect();
    let output = File::create(file).map_err(|source| Error::File { file: file.to_owned(), source })?;
    let encoder = image::codecs::png::PngEncoder::new(std::io::BufWriter::new(output));
    encoder
        .write_image(&bytes, map.width, map.height, image::ExtendedColorType::L16)
        .map_err(|e| Error::Image { file: file.to_owned(), what: e.to_string() })
}

/// Names of the procedural materials of a scene that is imported without a material folder.
const PROCEDURAL: [&str; 9] = ["grass", "meadow", "forest-floor", "dirt", "gravel", "scree", "limestone", "granite", "snow"];

fn material(name: &str, procedural: bool) -> Material {
    Material {
        name: name.to_owned(),
        procedural: procedural.then(|| name.to_owned()),
        folder: (!procedural).then(|| Path::new("materials").join(name)),
        tile_m: match Role::of(name) {
            Role::Rock => 5.0,
            Role::Rubble | Role::Snow => 3.5,
            Role::Green | Role::Soil => 2.5,
        },
        orientation_deg: 0.0,
        tint: [1.0; 3],
        normal_strength: 1.0,
    }
}

fn copy_materials(from: &Path, to: &Path) -> Result<Vec<Material>> {
    let failed = |file: &Path| {
        let file = file.to_owned();
        move |source| Error::File { file, source }
    };
    let mut folders: Vec<PathBuf> =
        std::fs::read_dir(from).map_err(failed(from))?.filter_map(|entry| entry.ok().map(|e| e.path())).filter(|p| p.is_dir()).collect();
    folders.sort();
    let mut materials = Vec::new();
    for folder in folders {
        let Some(name) = folder.file_name().map(|n| n.to_string_lossy().into_owned()) else {
            continue;
        };
        let entries = std::fs::read_dir(&folder).map_err(failed(&folder))?;
        let mut files: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.is_file()).collect();
        files.sort();
        if !files.iter().any(|f| f.file_stem().is_some_and(|s| s.eq_ignore_ascii_case("albedo"))) {
            continue;
        }
        let target = to.join(&name);
        std::fs::create_dir_all(&target).map_err(failed(&target))?;
        for file in files {
            let extension = file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            // Text files are copied with the images: licences require that notes about the source stay with an image.
            if ["png", "jpg", "jpeg", "exr", "txt", "md"].contains(&extension.as_str())
                && let Some(file_name) = file.file_name()
            {
                std::fs::copy(&file, target.join(file_name)).map_err(failed(&file))?;
            }
        }
        materials.push(material(&name, false));
    }
    match materials.len() {
        0 => Err(Error::Material {
            name: from.display().to_string(),
            what: "no sub-folder contains an `albedo` image; give a folder with one folder per material".to_owned(),
        }),
        1..=256 => Ok(materials),
        n => Err(Error::Material {
            name: from.display().to_string(),
            what: format!("there are {n} materials, but a palette holds at most 256; remove some sub-folders"),
        }),
    }
}

/// The role of a material in the landscape, derived from its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Green,
    Soil,
    Rubble,
    Rock,
    Snow,
}

impl Role {
    fn of(name: &str) -> Role {
        let name = name.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|w| name.contains(w));
        if has(&["snow", "ice"]) {
            Role::Snow
        } else if has(&["cliff", "granite", "limestone", "basalt"]) {
            Role::Rock
        } else if has(&["grass", "meadow", "moss", "forest", "heath"]) {
            Role::Green
        } else if has(&["scree", "gravel", "pebble", "rubble", "talus", "boulder"]) {
            Role::Rubble
        } else if has(&["rock", "stone"]) {
            Role::Rock
        } else {
            Role::Soil
        }
    }
}

/// Returns splat rules by slope and elevation: vegetation on low and gentle ground, soil in patches, rubble on steep ground, rock on slopes near
/// and above `cliff_deg`, snow at high elevations.
fn rules_for(materials: &[Material], [low, high]: [f64; 2], cliff_deg: f64) -> Vec<Rule> {
    let relief = high - low;
    let at = |share: f64| (low + relief * share).round();
    let fade = (0.08 * relief).max(1.0).round();
    let mut rules = Vec::new();
    for role in [Role::Green, Role::Soil, Role::Rubble, Role::Rock, Role::Snow] {
        for (nth, material) in materials.iter().filter(|m| Role::of(&m.name) == role).enumerate() {
            // The first vegetation, rock and snow have no noise, so each of them covers all ground of its role. Every other material lies in patches;
            // `noise_m` gives their size, `noise_cover` the share of the ground that they cover.
            let (noise_m, noise_cover) = match (role, nth) {
                (Role::Green | Role::Rock | Role::Snow, 0) => (0.0, 0.5),
                (Role::Soil, 0) => (35.0, 0.22),
                (Role::Rubble, 0) => (28.0, 0.6),
                _ => (40.0 + 25.0 * nth as f64, 0.35),
            };
            let slope = |from: f64, to: f64, fade: f64| {
                (Some([(from * cliff_deg).round(), (to * cliff_deg).round()]), (fade * cliff_deg).round().max(1.0))
            };
            let (weight, height_m, (slope_deg, slope_fade_deg)) = match role {
                Role::Green => (1.0 + 0.1 * nth as f64, Some([low - 1.0, at(0.6)]), slope(0.0, 0.7, 0.2)),
                Role::Soil => (1.1 + 0.1 * nth as f64, Some([low - 1.0, at(0.75)]), slope(0.0, 0.8, 0.2)),
                Role::Rubble => (1.3 + 0.05 * nth as f64, None, slope(0.55, 0.9, 0.15)),
                Role::Rock => {
                    (2.0 + 0.1 * nth as f64, None, (Some([(0.92 * cliff_deg).round(), 90.0]), (0.15 * cliff_deg).round().max(1.0)))
                }
                Role::Snow => (1.6 + 0.1 * nth as f64, Some([at(0.72), high + 1.0]), slope(0.0, 0.75, 0.15)),
            };
            rules.push(Rule {
                material: material.name.clone(),
                weight,
                height_m,
                height_fade_m: if height_m.is_some() { fade } else { 0.0 },
                slope_deg,
                slope_fade_deg,
                noise_m,
                noise_cover,
                ..Rule::default()
            });
        }
    }
    // This rule has the lowest weight, so it applies to ground that no other rule covers. Its material is rubble; if there is no rubble, then rock,
    // soil or vegetation, in this order; and if none of these exists, the first material of the list.
    let ground =
        [Role::Rubble, Role::Rock, Role::Soil, Role::Green].into_iter().find_map(|r| materials.iter().find(|m| Role::of(&m.name) == r));
    if let Some(ground) = ground.or(materials.first()) {
        rules.insert(0, Rule { material: ground.name.clone(), weight: 0.05, noise_cover: 0.5, ..Rule::default() });
    }
    rules
}

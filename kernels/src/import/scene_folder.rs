//! Makes a scene folder from a heightmap. All input files are read and checked before the folder is written.

use std::fmt;
use std::fs::File;
use std::path::{Path, PathBuf};

use super::materials::{self, MaterialSurvey};
use super::role::Role;
use super::viewpoints;
use crate::base::error::{Error, Result, one_line};
use crate::base::files::WholeFolder;
use crate::decode::heightmap::{Heightmap, ReadOptions, Reading, Report, read};
use crate::materials::check_repeats;
use crate::scene::{self, Hole, Material, Rule, Scene};
use crate::world::rules::Rules;
use crate::world::{Layout, World};

/// Largest number of samples without data that can become holes; [`examine`] refuses a heightmap with more. Each such sample becomes a circle, and
/// vertices near the holes are tested against all circles.
const MAX_HOLES: usize = 512;

/// Radius of the hole at a sample without data, as a multiple of the distance between samples. It is above 0.707, half the diagonal of a square of
/// samples, so that there is no ground between neighbouring holes. It is below 1, so that the neighbouring samples with data lie outside the hole.
const HOLE_RADIUS: f64 = 0.75;

/// Largest number of characters in the name of a scene. Scene files have the same limit.
const LONGEST_NAME: usize = 100;

/// Options of an import.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImportOptions {
    /// How the heightmap is read.
    pub read: ReadOptions,
    /// A folder that holds materials, see [`materials::survey`]; without it, the scene has procedural materials.
    pub materials: Option<PathBuf>,
    /// Size of one repeat of every texture of the folder `materials`, metres. `None`: each size is taken from the names of folders and files or, if
    /// no name states it, from the kind of ground. Without the folder, the size is ignored.
    pub tile_m: Option<f64>,
    /// Limit, in metres, of the offset by which procedural relief raises or lowers the ground between the samples of the heightmap. With 0, no relief
    /// is added, and the finest LOD follows from the resolution of the data.
    pub detail_m: f64,
}

/// The result of reading the files of an import. `Display` writes it as several lines for the user, without a line break at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct Understood {
    /// Name of the scene, see [`name_of`].
    name: String,
    map: Heightmap,
    report: Report,
    holes: Vec<Hole>,
    materials: Option<MaterialSurvey>,
    detail_m: f64,
}

/// Reads the heightmap and the materials of an import. Nothing is written.
///
/// `stopped`: called between the steps of the work; returns whether the user wants to stop.
///
/// # Errors
/// The errors of [`read`]; [`Error::Heightmap`] if there are too many samples without data for holes; [`Error::Request`] if `detail_m` is
/// negative or not finite, or if the user stopped; the errors of [`materials::survey`] and [`MaterialSurvey::with_tile_m`].
pub fn examine(source: &Path, options: &ImportOptions, stopped: &dyn Fn() -> bool) -> Result<Understood> {
    let detail_m = options.detail_m;
    if !(detail_m.is_finite() && detail_m >= 0.0) {
        return Err(Error::Request(format!("the detail is {detail_m} m; it must be 0 (no added relief) or more")));
    }
    materials::go_on(stopped)?;
    let Reading { map, mut report, holes } = read(source, &options.read)?;
    report.notes.extend(note_of_fine_samples(&map, detail_m));
    if holes.len() > MAX_HOLES {
        let what = format!(
            "{} samples have no data, but a scene can have at most {MAX_HOLES} holes; fill them with --fill-voids, or give a --window with fewer",
            holes.len()
        );
        return Err(Error::Heightmap { file: source.to_owned(), what });
    }
    let materials = match &options.materials {
        Some(folder) => Some(materials::survey(folder, stopped)?.with_tile_m(options.tile_m)?),
        None => None,
    };
    Ok(Understood {
        name: name_of(source),
        holes: holes.iter().map(|&place| hole(&map, place)).collect(),
        map,
        report,
        materials,
        detail_m,
    })
}

/// Name of the scene: the name of the heightmap file without its extension, on one line and cut to [`LONGEST_NAME`] characters;
/// `imported` if nothing is left.
fn name_of(source: &Path) -> String {
    let stem = source.file_stem().map(|stem| one_line(&stem.to_string_lossy())).unwrap_or_default();
    if stem.is_empty() { "imported".to_owned() } else { stem.chars().take(LONGEST_NAME).collect() }
}

/// Makes a scene folder from a heightmap: [`examine`], then [`Understood::write`].
///
/// # Errors
/// The errors of these two functions; [`Error::Request`] if `out_dir` exists and is not an empty folder.
pub fn import(source: &Path, options: &ImportOptions, out_dir: &Path) -> Result<Scene> {
    refuse_occupied(out_dir)?;
    examine(source, options, &|| false)?.write(out_dir, &|| false)
}

/// A note if samples are closer together than vertices can be.
fn note_of_fine_samples(map: &Heightmap, detail_m: f64) -> Option<String> {
    let layout = Layout::of_heightmap(map, detail_m);
    let (samples, vertices) = (map.metres_per_texel, layout.spacing_m(layout.finest_lod));
    (samples < vertices).then(|| {
        format!("samples are {samples} m apart, but vertices cannot be closer together than {vertices} m; finer relief is not drawn")
    })
}

/// The hole at a sample without data. The sample is given by its column and row.
fn hole(map: &Heightmap, [column, row]: [u32; 2]) -> Hole {
    let [width, depth] = map.extent_m();
    let spacing = map.metres_per_texel;
    let centre = [f64::from(column) * spacing - width / 2.0, depth / 2.0 - f64::from(row) * spacing];
    Hole { centre, radius_m: HOLE_RADIUS * spacing }
}

impl Understood {
    /// The heightmap.
    pub fn map(&self) -> &Heightmap {
        &self.map
    }

    /// The report on the heightmap: how its file was interpreted.
    pub fn report(&self) -> &Report {
        &self.report
    }

    /// Notes for the user about the files, one line each.
    pub fn notes(&self) -> Vec<String> {
        let of_materials = self.materials.iter().flat_map(MaterialSurvey::notes);
        self.report.notes.iter().cloned().chain(of_materials).collect()
    }

    /// If a folder of materials was given: checks that it has materials, and that all can be drawn.
    ///
    /// # Errors
    /// The errors of [`MaterialSurvey::check`].
    pub fn check(&self) -> Result<()> {
        self.materials.as_ref().map_or(Ok(()), MaterialSurvey::check)
    }

    /// Writes the scene folder. It contains `heightmap.png` (16 bits: 0 is the lowest elevation of the map, 65535 the highest), `scene.toml`
    /// (materials, rules that suit the slopes and elevations, and four cameras) and, if the materials have images, a folder `materials/` with the
    /// images that are used and the texts beside them. The scene folder is made either completely or not at all. Returns the scene.
    ///
    /// `stopped`: called between the steps of the work; returns whether the user wants to stop. If so, no folder is left behind.
    ///
    /// # Errors
    /// [`Error::Request`] if `out_dir` exists and is not an empty folder, or if the user stopped; the errors of [`materials::chosen`] and
    /// [`World::new`]; [`Error::Material`] if a texture repeats too often along a sector; [`Error::File`], [`Error::Image`] or [`Error::Scene`] if
    /// writing fails.
    pub fn write(&self, out_dir: &Path, stopped: &dyn Fn() -> bool) -> Result<Scene> {
        refuse_occupied(out_dir)?;
        let go_on = || materials::go_on(stopped);
        go_on()?;
        let staging = WholeFolder::beside(out_dir)?;
        let scene = self.write_into(staging.folder(), &go_on)?;
        go_on()?;
        staging.finish()?;
        Ok(Scene { folder: out_dir.to_owned(), ..scene })
    }

    fn write_into(&self, folder: &Path, go_on: &dyn Fn() -> Result<()>) -> Result<Scene> {
        let Understood { map, name, detail_m, holes, .. } = self;
        let (low, high) = map.elevation_range_m();
        write_png(map, [low, high], &folder.join("heightmap.png"))?;
        go_on()?;
        let materials = match &self.materials {
            Some(survey) => materials::chosen(survey, folder)?,
            None => materials::procedural(),
        };
        go_on()?;
        let mut scene = Scene {
            name: name.clone(),
            description: format!(
                "{name}: {} x {} samples, {} m apart, {low:.1} to {high:.1} m.",
                map.width, map.height, map.metres_per_texel
            ),
            world: scene::World::Heightmap {
                file: PathBuf::from("heightmap.png"),
                metres_per_texel: map.metres_per_texel,
                height_range_m: [low, high],
                detail_m: *detail_m,
                seed: 1,
                holes: holes.clone(),
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
        let bare = World::from_heightmap(map.clone(), *detail_m, 1, holes.clone(), 0.0, Rules::new(&scene), scene.materials.len());
        let steepest = bare.max_slope_deg();
        // The slope at which cliffs begin depends on the steepest slope of the terrain, so that terrain of moderate slopes has cliffs, too. The value
        // 90 degrees means no cliffs.
        scene.flavours.cliff_slope_deg = match steepest {
            s if s >= 55.0 => 45.0,
            s if s >= 25.0 => (0.8 * s).round(),
            _ => 90.0,
        };
        scene.rules = rules_for(&scene.materials, [low, high], scene.flavours.cliff_slope_deg.min(60.0).min(steepest.max(10.0)));
        go_on()?;
        // The cameras are placed on the ground of the written file, whose heights are quantised.
        let world = World::new(&scene)?;
        check_repeats(&scene.materials, world.layout().sector_m)?;
        scene.cameras = viewpoints::find(&world, &scene);
        let text = toml::to_string(&scene).map_err(|e| Error::Scene { where_: "scene.toml".to_owned(), what: e.to_string() })?;
        let file = folder.join("scene.toml");
        std::fs::write(&file, text).map_err(|source| Error::File { file, source })?;
        Ok(scene)
    }
}

impl fmt::Display for Understood {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}", self.report)?;
        if !self.holes.is_empty() {
            writeln!(f, "holes: {}, each a circle with a radius of {} m", self.holes.len(), HOLE_RADIUS * self.map.metres_per_texel)?;
        }
        if self.detail_m > 0.0 {
            writeln!(f, "added relief: up to {} m", self.detail_m)?;
        }
        match &self.materials {
            Some(survey) => write!(f, "{survey}"),
            None => write!(f, "materials: {} procedural ones", materials::procedural().len()),
        }
    }
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

/// Returns splat rules by slope and elevation: vegetation on low and gentle ground, soil in patches, rubble on steep ground, rock on slopes near
/// and above `cliff_deg`, snow at high elevations.
fn rules_for(materials: &[Material], [low, high]: [f64; 2], cliff_deg: f64) -> Vec<Rule> {
    let relief = high - low;
    let at = |share: f64| (low + relief * share).round();
    let fade = (0.08 * relief).max(1.0).round();
    let mut rules = Vec::new();
    for role in [Role::Green, Role::Soil, Role::Rubble, Role::Rock, Role::Snow] {
        for (nth, material) in materials.iter().filter(|m| Role::of(&m.name) == role).enumerate() {
            // The rules of the first materials of vegetation, rock and snow have no noise, so noise leaves no gaps in them. Other materials occur
            // in patches: `noise_m` gives the size of the patches, `noise_cover` the share of the ground that they cover.
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

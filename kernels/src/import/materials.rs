//! The materials of an imported scene. Finds the materials in a folder of images, and lists the files that are used and those that are not.
//!
//! A material is accepted only after the [loader](crate::materials::folder) has read all its maps.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::role::Role;
use crate::base::error::{Error, Result, one_line};
use crate::materials::folder::{
    Convention, Loaded, Reading, Recognised, Set, Sorted, Unused, few, list, load_maps, shown, shown_name, sort_out, stated_tile_m,
};
use crate::materials::{MAX_LAYERS, MaterialMaps, SOURCES_AT_ONCE};
use crate::scene::Material;

/// Folder of the materials inside a scene folder.
const FOLDER: &str = "materials";

/// Names of the procedural materials of a scene that is imported without a material folder.
const PROCEDURAL: [&str; 9] = ["grass", "meadow", "forest-floor", "dirt", "gravel", "scree", "limestone", "granite", "snow"];

/// Largest depth of the sub-folders that are searched.
pub const MAX_DEPTH: usize = 16;
/// Largest number of files and folders below the folder of materials. A folder that contains more was probably given by mistake.
const MAX_ENTRIES: usize = 100_000;
/// Largest number of lines `refused`, and of lines `not used`, in the text of a survey. A further line says how many are not
/// listed.
const MOST_LINES: usize = 50;
/// Largest number of characters in the name of a material, without the number that [`make_unique`] may append.
const LONGEST_NAME: usize = 80;
/// Largest size of one repeat of a texture, metres. Scene files have the same limit.
const MAX_TILE_M: f64 = 1.0e5;
/// Edge to which a survey resamples all maps, texels. A survey only compares normals with the slopes of heights, so small maps are enough.
const SURVEY_SIZE: u32 = 128;
/// Threshold for the correlation between normals and the slopes of heights. They agree if it is above this number, and contradict each other if it is
/// below minus this number. Scanned materials usually have correlations of 0.1 to 0.9.
const CORRELATED: f64 = 0.3;

/// Names of folders that say nothing about the material in them.
const GENERIC: [&str; 8] = ["textures", "texture", "maps", "images", "1k", "2k", "4k", "8k"];

/// The contents of a folder of images. `Display` writes them as a list for the user: several lines, without a line break at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct MaterialSurvey {
    /// The folder.
    pub folder: PathBuf,
    /// Materials that can be drawn, in the order of their folders.
    pub found: Vec<Found>,
    /// Materials that cannot be drawn.
    pub refused: Vec<Refused>,
    /// Files and folders that are not used, with the reasons. They include unused maps of a material that can be drawn, such as a second normal map.
    pub unused: Vec<Unused>,
}

/// A material that can be drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Found {
    /// Name of the material in the scene: unique, and suitable as the name of a folder.
    pub name: String,
    /// Files of the material.
    pub recognised: Recognised,
    /// Side length of the image of each map, texels, in the order of [`Recognised::maps`].
    pub edges: Vec<usize>,
    /// Notes for the user about the images, one line each.
    pub remarks: Vec<String>,
    /// Size of one repeat of the texture.
    pub tile: Tile,
}

/// A material that cannot be drawn.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Name of the material.
    pub name: String,
    /// The reason and the remedy, one line.
    pub reason: String,
}

/// Size of one repeat of a texture, metres, and where the size comes from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Tile {
    /// The user gave the size.
    Given(f64),
    /// The name of the folder or of a file states the size.
    Named(f64),
    /// No name states the size. This size is usual for the kind of ground, which is guessed from the name of the material.
    Assumed(f64),
}

impl Tile {
    /// The size, metres.
    pub fn metres(self) -> f64 {
        match self {
            Tile::Given(metres) | Tile::Named(metres) | Tile::Assumed(metres) => metres,
        }
    }
}

impl fmt::Display for Tile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let from = match self {
            Tile::Given(_) => "as given",
            Tile::Named(_) => "from its name",
            Tile::Assumed(_) => "assumed; --tile-size or a name such as rock_2m states it",
        };
        write!(f, "{} m ({from})", self.metres())
    }
}

/// Returns an error if the user wants to stop.
///
/// # Errors
/// [`Error::Request`]: the user wants to stop.
pub(super) fn go_on(stopped: &dyn Fn() -> bool) -> Result<()> {
    if stopped() { Err(Error::Request("stopped; nothing was written".to_owned())) } else { Ok(()) }
}

/// Finds the materials in a folder and its sub-folders, and reads all their maps. A sub-folder may contain one material, or several
/// materials, which the names of the files tell apart. Links are followed, but no folder is read twice.
///
/// A group of files with at least two kinds of maps is a material. If it cannot be drawn, it is refused with a reason. Files that belong to no
/// material are listed as unused, and so are folders that are empty or cannot be searched. Text files are not listed: those in the folder of a
/// material are copied with its images ([`chosen`]).
///
/// `stopped`: called before each group of materials that are read in parallel; returns whether the user wants to stop.
///
/// # Errors
/// [`Error::File`]: the folder cannot be read. [`Error::Request`]: it has more than 100 000 files and folders, or more than [`MAX_LAYERS`]
/// materials; or the user stopped.
pub fn survey(folder: &Path, stopped: &dyn Fn() -> bool) -> Result<MaterialSurvey> {
    // An error in a sub-folder is listed, but the folder itself must be readable.
    drop(fs::read_dir(folder).map_err(|source| Error::File { file: shown(folder).into(), source })?);
    let mut walk = Walk::default();
    walk.enter(folder, 0)?;
    while let Some((link, depth)) = walk.links.pop_front() {
        walk.enter(&link, depth)?;
    }
    let Walk { mut places, mut refused, unused, .. } = walk;
    if places.len() > MAX_LAYERS {
        return Err(Error::Request(format!(
            "{} holds {} materials, but a scene can have at most {MAX_LAYERS} with textures of their own: take some out",
            shown(folder),
            places.len()
        )));
    }
    make_unique(folder, &mut places);
    let mut found = Vec::new();
    for chunk in places.chunks(SOURCES_AT_ONCE) {
        go_on(stopped)?;
        let outcomes: Vec<std::result::Result<Found, Refused>> = chunk.par_iter().map(Place::examine).collect();
        for outcome in outcomes {
            match outcome {
                Ok(material) => found.push(material),
                Err(reason) => refused.push(reason),
            }
        }
    }
    Ok(MaterialSurvey { folder: folder.to_owned(), found, refused, unused })
}

/// Copies the images and texts of the materials into `materials/` of a scene folder, each material into a separate folder. Returns the
/// materials for the scene file.
///
/// # Errors
/// The errors of [`MaterialSurvey::check`]; [`Error::File`] if copying fails.
pub fn chosen(survey: &MaterialSurvey, scene_folder: &Path) -> Result<Vec<Material>> {
    survey.check()?;
    let one = |found: &Found| -> Result<Material> {
        let folder = Path::new(FOLDER).join(&found.name);
        copy(&found.recognised, &scene_folder.join(&folder))?;
        Ok(Material { procedural: None, folder: Some(folder), ..material(&found.name, found.tile.metres()) })
    };
    survey.found.iter().map(one).collect()
}

/// The materials of a scene that is imported without images.
pub(super) fn procedural() -> Vec<Material> {
    PROCEDURAL.iter().map(|name| material(name, Role::of(name).tile_m())).collect()
}

/// A material with default settings and the procedural texture `name`.
fn material(name: &str, tile_m: f64) -> Material {
    Material {
        name: name.to_owned(),
        procedural: Some(name.to_owned()),
        folder: None,
        tile_m,
        orientation_deg: 0.0,
        tint: [1.0; 3],
        normal_strength: 1.0,
    }
}

impl MaterialSurvey {
    /// Sets the size of one repeat of every texture to `tile_m` metres, if it is given.
    ///
    /// # Errors
    /// [`Error::Request`]: `tile_m` is not above 0, or it is above 100 000 m.
    pub fn with_tile_m(mut self, tile_m: Option<f64>) -> Result<MaterialSurvey> {
        let Some(tile_m) = tile_m else { return Ok(self) };
        if !(tile_m > 0.0 && tile_m <= MAX_TILE_M) {
            return Err(Error::Request(format!("the tile size is {tile_m} m; it must be above 0 and at most {MAX_TILE_M} m")));
        }
        for found in &mut self.found {
            found.tile = Tile::Given(tile_m);
        }
        Ok(self)
    }

    /// Checks that there are materials, and that all can be drawn.
    ///
    /// # Errors
    /// [`Error::Material`] for the first material that cannot be drawn, or if there is no material.
    pub fn check(&self) -> Result<()> {
        if let Some(Refused { name, reason }) = self.refused.first() {
            let more = match self.refused.len() - 1 {
                0 => String::new(),
                more => format!(" ({more} more cannot be used either: --dry-run lists them)"),
            };
            let what = format!("{reason}; or move this material out of {}{more}", shown(&self.folder));
            return Err(Error::Material { name: name.clone(), what });
        }
        if self.found.is_empty() {
            let seen = match self.unused.len() {
                0 => "nothing".to_owned(),
                _ => few(self.unused.iter().map(|unused| self.relative(&unused.path))),
            };
            return Err(Error::Material {
                name: shown(&self.folder),
                what: format!(
                    "no folder holds the maps of a material (seen: {seen}); each needs images named albedo, normal, height and roughness, as in rock_albedo.png"
                ),
            });
        }
        Ok(())
    }

    /// Notes for the user about the materials that can be drawn and about the files that are not used, one line each.
    pub fn notes(&self) -> Vec<String> {
        let of_one = |found: &Found| found.remarks.iter().map(|remark| format!("{}: {remark}", found.name)).collect::<Vec<_>>();
        let mut notes: Vec<String> = self.found.iter().flat_map(of_one).collect();
        let is_assumed = |found: &&Found| matches!(found.tile, Tile::Assumed(_));
        let assumed: Vec<String> =
            self.found.iter().filter(is_assumed).map(|found| format!("{} {} m", found.name, found.tile.metres())).collect();
        if !assumed.is_empty() {
            notes.push(format!("assumed size of a repeat: {}; a name such as rock_2m states it", few(assumed)));
        }
        if !self.unused.is_empty() {
            let unused = few(self.unused.iter().map(|unused| self.relative(&unused.path)));
            notes.push(format!("not used from {}: {unused}", shown(&self.folder)));
        }
        notes
    }

    /// The path relative to the folder of the survey, for a message.
    fn relative(&self, path: &Path) -> String {
        let below = path.strip_prefix(&self.folder).unwrap_or(path);
        if below.as_os_str().is_empty() { shown(path) } else { shown(below) }
    }
}

impl fmt::Display for MaterialSurvey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "materials in {}: {}", shown(&self.folder), self.found.len())?;
        for Found { name, recognised, edges, remarks, tile } in &self.found {
            write!(f, "\n  {name}: one repeat is {tile}")?;
            for ((map, source), edge) in recognised.maps().zip(edges) {
                write!(f, "\n    {map}: {}, {edge} x {edge}{}", self.relative(&source.file), source.reading)?;
            }
            if recognised.occlusion.is_none() {
                f.write_str("\n    ao: none; specular occlusion is 1 everywhere")?;
            }
            for remark in remarks {
                write!(f, "\n    note: {remark}")?;
            }
        }
        for Refused { name, reason } in self.refused.iter().take(MOST_LINES) {
            write!(f, "\n  refused: {name}: {reason}")?;
        }
        more_lines(f, "refused", self.refused.len())?;
        let mut groups: BTreeMap<(&Path, &str), Vec<&Path>> = BTreeMap::new();
        for Unused { path, reason } in &self.unused {
            groups.entry((path.parent().unwrap_or(path), reason.as_str())).or_default().push(path);
        }
        for ((parent, reason), paths) in groups.iter().take(MOST_LINES) {
            let place = if *parent == self.folder { String::new() } else { format!(" in {}", self.relative(parent)) };
            write!(f, "\n  not used{place}: {}: {reason}", few(paths.iter().map(|path| shown_name(path))))?;
        }
        more_lines(f, "not used", groups.len())
    }
}

fn more_lines(f: &mut fmt::Formatter<'_>, what: &str, lines: usize) -> fmt::Result {
    match lines.saturating_sub(MOST_LINES) {
        0 => Ok(()),
        more => write!(f, "\n  {what}: {more} more (not listed)"),
    }
}

/// A material whose files were found.
struct Place {
    folder: PathBuf,
    name: String,
    recognised: Recognised,
}

/// The search for materials.
#[derive(Default)]
struct Walk {
    /// Canonical paths of the folders that were read.
    visited: BTreeSet<PathBuf>,
    entries: usize,
    /// Links to folders, and their depth. They are followed last, so that a folder below the root is read under its own path even if a link
    /// leads to it, too.
    links: VecDeque<(PathBuf, usize)>,
    places: Vec<Place>,
    refused: Vec<Refused>,
    unused: Vec<Unused>,
}

impl Walk {
    fn skip(&mut self, path: &Path, reason: impl Into<String>) {
        self.unused.push(Unused { path: path.to_owned(), reason: reason.into() });
    }

    fn enter(&mut self, folder: &Path, depth: usize) -> Result<()> {
        if depth > MAX_DEPTH {
            self.skip(folder, format!("more than {MAX_DEPTH} folders deep"));
            return Ok(());
        }
        let (canonical, listing) = match fs::canonicalize(folder).and_then(|canonical| Ok((canonical, list(folder)?))) {
            Ok(read) => read,
            Err(error) => {
                self.skip(folder, format!("cannot be read: {error}"));
                return Ok(());
            }
        };
        if !self.visited.insert(canonical.clone()) {
            self.skip(folder, "this folder was already read under another path");
            return Ok(());
        }
        let count = listing.files.len() + listing.folders.len() + listing.links.len() + listing.unused.len();
        if count == 0 {
            self.skip(folder, "an empty folder");
        }
        self.entries += count;
        if self.entries > MAX_ENTRIES {
            return Err(Error::Request(format!(
                "there are more than {MAX_ENTRIES} files and folders in the folder of materials: give a folder that holds only materials"
            )));
        }
        let Sorted { sets, unused } = sort_out(&listing.files);
        self.unused.extend(unused);
        self.unused.extend(listing.unused);
        let is_only = sets.len() == 1;
        for set in sets {
            let name = name_of(&canonical, &set, is_only);
            self.add(folder, name, set, &listing.files);
        }
        for sub_folder in &listing.folders {
            self.enter(sub_folder, depth + 1)?;
        }
        self.links.extend(listing.links.into_iter().map(|link| (link, depth + 1)));
        Ok(())
    }

    fn add(&mut self, folder: &Path, name: String, set: Set, files: &[PathBuf]) {
        if !set.is_material() {
            self.unused.extend(set.into_unused("it is the only map here; a material needs albedo, normal, height and roughness"));
            return;
        }
        match set.choose(folder, files) {
            Ok(mut recognised) => {
                self.unused.append(&mut recognised.unused);
                self.places.push(Place { folder: folder.to_owned(), name, recognised });
            }
            Err(reason) => self.refused.push(Refused { name, reason: one_line(&reason) }),
        }
    }
}

/// The name of a material: usually the name of its folder, whose canonical path is `folder`. If the folder contains several materials or
/// has a general name such as `textures`, the name is taken from the albedo file instead, such as `rock` from `rock_albedo.png`. If the
/// file name contains no name of a material, a general name is replaced by the name of the parent folder.
fn name_of(folder: &Path, set: &Set, is_only: bool) -> String {
    let name = |folder: &Path| folder.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let own = name(folder);
    let is_generic = GENERIC.contains(&own.to_lowercase().as_str());
    if !set.name.is_empty() && (!is_only || is_generic) {
        return plain(&set.name);
    }
    plain(&if is_generic { folder.parent().map(name).unwrap_or_default() } else { own })
}

/// Changes a text so that it is valid as the name of a material and, on the usual systems, as the name of a folder.
fn plain(text: &str) -> String {
    let safe = safe(text);
    let name = safe.trim_matches([' ', '.']);
    // Windows reserves the names of its devices, also with an extension.
    let first = name.split('.').next().unwrap_or_default().trim().to_lowercase();
    let is_device = matches!(first.as_str(), "con" | "prn" | "aux" | "nul")
        || ["com", "lpt"]
            .iter()
            .any(|port| first.strip_prefix(port).is_some_and(|n| n.chars().count() == 1 && n.chars().all(char::is_numeric)));
    let name = match name {
        "" => "material".to_owned(),
        name if is_device => format!("material {name}"),
        name => name.to_owned(),
    };
    name.chars().take(LONGEST_NAME).collect::<String>().trim_end_matches([' ', '.']).to_owned()
}

/// Replaces characters by `_`: those that are not allowed in names of files on some systems, and other unusual ones.
fn safe(name: &str) -> String {
    name.chars().map(|c| if c.is_alphanumeric() || "-_+(). ".contains(c) { c } else { '_' }).collect()
}

/// Makes the names unique, even on systems that do not distinguish upper and lower case. A name that occurs more than once is replaced by
/// the path from `root` to the folder, followed by the name if the path does not end with it. If a name is still taken, a number is appended.
fn make_unique(root: &Path, places: &mut [Place]) {
    let mut uses: BTreeMap<String, usize> = BTreeMap::new();
    for place in places.iter() {
        *uses.entry(place.name.to_lowercase()).or_default() += 1;
    }
    let mut taken = BTreeSet::new();
    for place in places {
        if uses.get(&place.name.to_lowercase()).is_some_and(|&count| count > 1) {
            let way = place.folder.strip_prefix(root).unwrap_or(&place.folder);
            let mut words: Vec<String> = way.iter().map(|part| part.to_string_lossy().into_owned()).collect();
            if words.last().is_none_or(|last| plain(last) != place.name) {
                words.push(place.name.clone());
            }
            place.name = plain(&words.join("_"));
        }
        let base = place.name.clone();
        for number in 2.. {
            if taken.insert(place.name.to_lowercase()) {
                break;
            }
            place.name = format!("{base} {number}");
        }
    }
}

impl Place {
    /// Reads all maps of the material.
    fn examine(&self) -> std::result::Result<Found, Refused> {
        let refuse = |reason: String| Refused { name: self.name.clone(), reason: one_line(&reason) };
        let tile = self.tile().map_err(refuse)?;
        let Loaded { maps, edges, mut remarks } = load_maps(&self.recognised, SURVEY_SIZE).map_err(|error| refuse(error.to_string()))?;
        remarks.extend(opposition(&maps, self.recognised.normal.reading));
        Ok(Found { name: self.name.clone(), recognised: self.recognised.clone(), edges, remarks, tile })
    }

    /// The size of one repeat, from the names of the folder, the material and the files. The name of the material is included because it
    /// may be that of the parent folder.
    fn tile(&self) -> std::result::Result<Tile, String> {
        let of_folder = self.folder.file_name().and_then(|name| stated_tile_m(&name.to_string_lossy()));
        let of_material = stated_tile_m(&self.name);
        let of_files = self.recognised.maps().filter_map(|(_, source)| source.tile_m);
        let mut stated: Vec<f64> = of_files.chain(of_folder).chain(of_material).collect();
        stated.sort_by(f64::total_cmp);
        stated.dedup();
        match stated.as_slice() {
            [] => Ok(Tile::Assumed(Role::of(&self.name).tile_m())),
            [metres] => Ok(Tile::Named(*metres)),
            [low, .., high] => Err(format!(
                "the names in {} state different sizes of a repeat, {low} m and {high} m: correct the names",
                shown(&self.folder)
            )),
        }
    }
}

/// Returns a remark if the normals contradict the slopes of the heights. If only green contradicts them, the convention of the normal map is probably
/// wrong (OpenGL or DirectX). `reading`: how the normal map was read.
fn opposition(maps: &MaterialMaps, reading: Reading) -> Option<String> {
    let size = maps.size as usize;
    let height = |column: usize, row: usize| maps.height.get(row % size * size + column % size).copied().map_or(0.0, f64::from);
    let correlation = |axis: usize| {
        let pairs = maps.normal.iter().enumerate().map(|(i, normal)| {
            let (column, row) = (i % size, i / size);
            let fall = match axis {
                0 => height(column + size - 1, row) - height(column + 1, row),
                _ => height(column, row + size - 1) - height(column, row + 1),
            };
            (fall, f64::from(normal[axis]))
        });
        correlation_of(pairs.collect())
    };
    let (x, y) = (correlation(0), correlation(1));
    let opposed = |r: f64| r < -CORRELATED;
    let agrees = |r: f64| r > CORRELATED;
    if agrees(x) && opposed(y) {
        let remedy = match reading {
            Reading::Normal(Convention::DirectX) => "if it is an OpenGL map, name it normal_gl",
            _ => "if it is a DirectX map, name it normal_dx",
        };
        return Some(format!("green of the normal map contradicts the slopes of the height map (correlation {y:.2}): {remedy}"));
    }
    if opposed(x) && agrees(y) {
        return Some(format!("red of the normal map contradicts the slopes of the height map (correlation {x:.2}): is it mirrored?"));
    }
    let both = opposed(x) && opposed(y);
    both.then(|| format!("normal map and height map contradict each other (correlations {x:.2} and {y:.2}): is one of them inverted?"))
}

/// Pearson's correlation coefficient; NaN if one of the quantities is constant.
fn correlation_of(pairs: Vec<(f64, f64)>) -> f64 {
    let count = pairs.len() as f64;
    let (a, b) = pairs.iter().fold((0.0, 0.0), |(a, b), pair| (a + pair.0 / count, b + pair.1 / count));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for pair in &pairs {
        let (da, db) = (pair.0 - a, pair.1 - b);
        ab += da * db;
        aa += da * da;
        bb += db * db;
    }
    ab / (aa * bb).sqrt()
}

fn copy(recognised: &Recognised, to: &Path) -> Result<()> {
    let failed = |file: &Path| {
        let file = PathBuf::from(shown(file));
        move |source| Error::File { file, source }
    };
    fs::create_dir_all(to).map_err(failed(to))?;
    // A packed image holds several maps. Because `images` is a set, such an image is copied only once.
    let images: BTreeSet<&Path> = recognised.maps().map(|(_, source)| source.file.as_path()).collect();
    let mut taken = BTreeSet::new();
    for file in images.into_iter().chain(recognised.notes.iter().map(PathBuf::as_path)) {
        let base = safe(&file.file_name().unwrap_or_default().to_string_lossy());
        let mut name = base.clone();
        for number in 2.. {
            if taken.insert(name.to_lowercase()) {
                break;
            }
            name = format!("{number} {base}");
        }
        fs::copy(file, to.join(name)).map_err(failed(file))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn maps(green: f32) -> MaterialMaps {
        let size = 32;
        let count = (size * size) as usize;
        let waves = |i: usize| (i as f32 * std::f32::consts::TAU / size as f32).sin();
        let slope = |i: usize| (i as f32 * std::f32::consts::TAU / size as f32).cos();
        let (column, row) = (|i: usize| i % size as usize, |i: usize| i / size as usize);
        MaterialMaps {
            size,
            albedo: vec![[0.5; 3]; count],
            normal: (0..count).map(|i| [-0.3 * slope(column(i)), -0.3 * green * slope(row(i))]).collect(),
            smoothness: vec![0.5; count],
            specular_occlusion: vec![1.0; count],
            height: (0..count).map(|i| 0.5 + 0.2 * waves(column(i)) + 0.2 * waves(row(i))).collect(),
            colour_mask: vec![1.0; count],
        }
    }

    #[test]
    fn normals_that_contradict_the_heights_are_reported() {
        assert_eq!(opposition(&maps(1.0), Reading::Normal(Convention::Unstated)), None);
        let said = opposition(&maps(-1.0), Reading::Normal(Convention::Unstated)).expect("green is inverted");
        assert!(said.contains("green") && said.contains("normal_dx"), "{said}");
        let mut inverted = maps(1.0);
        inverted.height.iter_mut().for_each(|h| *h = 1.0 - *h);
        let said = opposition(&inverted, Reading::Normal(Convention::OpenGl)).expect("the heights are inverted");
        assert!(said.contains("contradict each other"), "{said}");
        let mut flat = maps(-1.0);
        flat.height.fill(0.5);
        assert_eq!(opposition(&flat, Reading::Normal(Convention::Unstated)), None);
    }

    #[test]
    fn names_are_safe() {
        for (text, name) in
            [("granite", "granite"), ("a/b\\c:d", "a_b_c_d"), ("..", "material"), ("x\u{1b}[2J\n", "x__2J_"), ("", "material")]
        {
            assert_eq!(plain(text), name);
        }
        // Names that Windows reserves for devices.
        for (text, name) in [
            ("Con", "material Con"),
            ("nul.old", "material nul.old"),
            ("COM1", "material COM1"),
            ("lpt\u{b2}", "material lpt\u{b2}"),
            ("concrete", "concrete"),
            ("com12", "com12"),
        ] {
            assert_eq!(plain(text), name);
        }
        for text in ["long".repeat(100), "con.".to_owned() + &"x".repeat(100)] {
            assert!(plain(&text).chars().count() <= LONGEST_NAME);
        }
    }
}

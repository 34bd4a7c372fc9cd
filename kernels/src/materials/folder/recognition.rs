//! Finds out, from the names of the files in a folder, which file contains which map of a material. No file is opened.

use std::collections::BTreeMap;
use std::fmt;
use std::fs::{self, DirEntry};
use std::io;
use std::mem;
use std::path::{Path, PathBuf};

use super::decode::MAX_EDGE;
use super::names::{Convention, Held, Kind, Label, label};

/// File name extensions of images that can be read.
pub const READABLE: [&str; 5] = ["png", "jpg", "jpeg", "tga", "exr"];

/// File name extensions of other images. They are recognised so that an error can say that their format cannot be read.
const UNREADABLE: [&str; 16] =
    ["tif", "tiff", "bmp", "dds", "webp", "hdr", "psd", "psb", "gif", "jp2", "ktx", "ktx2", "avif", "heic", "tx", "tex"];

/// File name extensions of texts, which are kept with the images: some licences require that notes about the source stay with an image.
const TEXTS: [&str; 2] = ["txt", "md"];

/// Largest number of names that a message lists.
const MOST_NAMES: usize = 8;

/// How the texels of a file become a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reading {
    /// Albedo: linear in OpenEXR files; otherwise sRGB, unless a PNG file states another gamma.
    Colour,
    /// A normal map.
    Normal(Convention),
    /// Heights in this channel of an image, 0 = red; `None`: the image is grey, perhaps stored as RGB.
    Height(Option<usize>),
    /// Values from 0 to 1 in one channel of an image.
    Share {
        /// The channel, 0 = red; `None`: the image is grey, perhaps stored as RGB.
        channel: Option<usize>,
        /// Whether the map is 1 minus the value.
        inverted: bool,
    },
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let of_channel = |channel: Option<usize>| match channel {
            None => "",
            Some(0) => ", red channel",
            Some(1) => ", green channel",
            Some(_) => ", blue channel",
        };
        match *self {
            Reading::Colour => Ok(()),
            Reading::Normal(Convention::OpenGl) => f.write_str(", OpenGL"),
            Reading::Normal(Convention::Unstated) => f.write_str(", OpenGL assumed"),
            Reading::Normal(Convention::DirectX) => f.write_str(", DirectX: green inverted"),
            Reading::Height(channel) => f.write_str(of_channel(channel)),
            Reading::Share { channel, inverted } => {
                f.write_str(of_channel(channel))?;
                f.write_str(if inverted { ", inverted" } else { "" })
            }
        }
    }
}

/// The source of one map.
#[derive(Clone, Debug, PartialEq)]
pub struct Source {
    /// The file.
    pub file: PathBuf,
    /// How to read the file.
    pub reading: Reading,
    /// Size of one repeat of the texture, metres, if the name of the file states it.
    pub tile_m: Option<f64>,
}

/// A file or folder that is not used.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Unused {
    /// The file or folder.
    pub path: PathBuf,
    /// The reason, without the name of the file or folder.
    pub reason: String,
}

impl Unused {
    fn new(path: &Path, reason: impl Into<String>) -> Unused {
        Unused { path: path.to_owned(), reason: reason.into() }
    }
}

/// The maps of one material.
#[derive(Clone, Debug, PartialEq)]
pub struct Recognised {
    /// Albedo.
    pub albedo: Source,
    /// Normals.
    pub normal: Source,
    /// Heights.
    pub height: Source,
    /// Roughness.
    pub roughness: Source,
    /// Ambient occlusion; optional.
    pub occlusion: Option<Source>,
    /// Texts in the same folder.
    pub notes: Vec<PathBuf>,
    /// Files that are not used, with the reasons.
    pub unused: Vec<Unused>,
}

impl Recognised {
    /// The maps and their names, in the order in which they are read.
    pub fn maps(&self) -> impl Iterator<Item = (&'static str, &Source)> {
        let required = [("albedo", &self.albedo), ("normal", &self.normal), ("height", &self.height), ("roughness", &self.roughness)];
        required.into_iter().chain(self.occlusion.as_ref().map(|source| ("ao", source)))
    }
}

/// The contents of a folder, sorted by name.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Listing {
    /// Plain files.
    pub files: Vec<PathBuf>,
    /// Folders.
    pub folders: Vec<PathBuf>,
    /// Symbolic links to folders.
    pub links: Vec<PathBuf>,
    /// Everything else: hidden entries, devices, links that lead nowhere, entries that cannot be read.
    pub unused: Vec<Unused>,
}

/// Lists a folder. No entry is opened, because opening a pipe may never end.
///
/// # Errors
/// The folder cannot be read.
pub fn list(folder: &Path) -> io::Result<Listing> {
    let mut listing = Listing::default();
    for entry in fs::read_dir(folder)? {
        match entry {
            Ok(entry) => listing.add(&entry),
            Err(error) => listing.unused.push(Unused::new(folder, format!("one of its entries cannot be read: {error}"))),
        }
    }
    let Listing { files, folders, links, unused } = &mut listing;
    for paths in [files, folders, links] {
        paths.sort();
    }
    unused.sort_by(|a, b| a.path.cmp(&b.path));
    Ok(listing)
}

impl Listing {
    fn add(&mut self, entry: &DirEntry) {
        let path = entry.path();
        // Hidden files are skipped, because programs keep previews and resource forks (`._albedo.png`) in them.
        if entry.file_name().to_string_lossy().starts_with('.') {
            self.unused.push(Unused::new(&path, "hidden"));
            return;
        }
        let is_link = entry.file_type().is_ok_and(|kind| kind.is_symlink());
        match fs::metadata(&path) {
            Err(error) if is_link => self.unused.push(Unused::new(&path, format!("a link that cannot be followed: {error}"))),
            Err(error) => self.unused.push(Unused::new(&path, format!("cannot be read: {error}"))),
            Ok(at) if at.is_file() => self.files.push(path),
            Ok(at) if at.is_dir() && is_link => self.links.push(path),
            Ok(at) if at.is_dir() => self.folders.push(path),
            Ok(_) => self.unused.push(Unused::new(&path, "not a plain file")),
        }
    }
}

/// An image whose name says which map it contains.
#[derive(Clone, Debug)]
struct Candidate {
    file: PathBuf,
    label: Label,
    /// [`Label::material`] in lower case.
    key: String,
}

impl Candidate {
    fn is_readable(&self) -> bool {
        READABLE.contains(&extension(&self.file).as_str())
    }

    fn source(&self, reading: Reading) -> Source {
        Source { file: self.file.clone(), reading, tile_m: self.label.tile_m }
    }

    /// The source of a map that is one channel of this packed map; `None` if no channel contains the map. `reading`: returns how to read a
    /// channel, given its index.
    fn channel(&self, held: Held, reading: fn(usize) -> Reading) -> Option<Source> {
        let Kind::Packed(channels) = self.label.kind else { return None };
        let channel = channels.iter().position(|&in_channel| in_channel == held)?;
        Some(self.source(reading(channel)))
    }
}

/// The files of a folder that belong to one material, before one file per map is chosen.
#[derive(Clone, Debug)]
pub struct Set {
    /// Name of the material, from the name of an albedo file or, without an albedo, of another file. It is empty if the name of this file contains
    /// no material.
    pub name: String,
    candidates: Vec<Candidate>,
    notes: Vec<PathBuf>,
}

/// The files of a folder, sorted by materials.
#[derive(Clone, Debug, Default)]
pub struct Sorted {
    /// One set per material.
    pub sets: Vec<Set>,
    /// Files that belong to no material.
    pub unused: Vec<Unused>,
}

/// Sorts the files of one folder by the materials in their names.
///
/// Only images whose names state a usable map are put into sets. The folder holds several materials if at least two materials in the names each
/// have an albedo and another usable map. Each of these materials then forms a set, and the remaining images are unused. Otherwise, all images with
/// a usable map form one set.
pub fn sort_out(files: &[PathBuf]) -> Sorted {
    let mut sorted = Sorted::default();
    let mut notes = Vec::new();
    let mut groups: BTreeMap<String, Vec<Candidate>> = BTreeMap::new();
    for file in files {
        let extension = extension(file);
        let stem = file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
        let is_image = READABLE.contains(&extension.as_str()) || UNREADABLE.contains(&extension.as_str());
        let reason = match label(&stem) {
            _ if TEXTS.contains(&extension.as_str()) => {
                notes.push(file.clone());
                continue;
            }
            _ if !is_image => "not an image".to_owned(),
            None => "its name does not say which map it is (for example albedo or roughness)".to_owned(),
            Some(Label { kind: Kind::Other(what), .. }) => format!("its name states a map that is not used: {what}"),
            Some(label) => {
                let key = label.material.to_lowercase();
                groups.entry(key.clone()).or_default().push(Candidate { file: file.clone(), label, key });
                continue;
            }
        };
        sorted.unused.push(Unused::new(file, reason));
    }
    let is_whole = |group: &[Candidate]| {
        let albedos = group.iter().filter(|c| c.label.kind == Kind::Albedo).count();
        (1..group.len()).contains(&albedos)
    };
    let mut set = |candidates: Vec<Candidate>| {
        let named = candidates.iter().find(|c| c.label.kind == Kind::Albedo).or(candidates.first());
        let name = named.map(|c| c.label.material.clone()).unwrap_or_default();
        sorted.sets.push(Set { name, candidates, notes: notes.clone() });
    };
    if groups.values().filter(|group| is_whole(group)).count() < 2 {
        if !groups.is_empty() {
            set(groups.into_values().flatten().collect());
        }
        return sorted;
    }
    let mut left = Vec::new();
    for group in groups.into_values() {
        if is_whole(&group) { set(group) } else { left.extend(group) }
    }
    sorted
        .unused
        .extend(left.iter().map(|c| Unused::new(&c.file, "the folder holds several materials, and this file's name matches none of them")));
    sorted
}

/// Finds the maps of the only material in a folder, by the names of the files.
///
/// # Errors
/// One line: the folder cannot be read or holds several materials, or an error of [`Set::choose`].
pub fn recognise(folder: &Path) -> Result<Recognised, String> {
    let listing = list(folder)
        .map_err(|error| format!("cannot read the folder {}: {error}; correct `folder` (relative to the scene file)", shown(folder)))?;
    let Sorted { mut sets, unused } = sort_out(&listing.files);
    if sets.len() > 1 {
        let names = few(sets.iter().map(|set| shown(Path::new(&set.name))));
        return Err(format!("{} holds the maps of {} materials ({names}): give each a folder of its own", shown(folder), sets.len()));
    }
    let set = sets.pop().unwrap_or_else(|| Set { name: String::new(), candidates: Vec::new(), notes: Vec::new() });
    let mut recognised = set.choose(folder, &listing.files)?;
    recognised.unused.extend(unused);
    recognised.unused.extend(listing.unused);
    Ok(recognised)
}

impl Set {
    /// Whether the files count as a material: they hold at least two kinds of maps.
    pub fn is_material(&self) -> bool {
        let kind = |c: &Candidate| mem::discriminant(&c.label.kind);
        self.candidates.first().is_some_and(|first| self.candidates.iter().any(|c| kind(c) != kind(first)))
    }

    /// Returns all files of the set as unused, with this reason.
    pub fn into_unused(self, reason: &str) -> Vec<Unused> {
        self.candidates.iter().map(|c| Unused::new(&c.file, reason)).collect()
    }

    /// Chooses one file per map. `folder` and `files`, the files of the folder, are used in messages.
    ///
    /// If there are several files for one map, one is chosen by these criteria, in this order: the same material in the name as in the name of
    /// the albedo; a format that can be read; for normal maps, the convention (OpenGL, then an unstated convention, then DirectX); a finer level
    /// of detail; a higher resolution up to 8192, if all names state a resolution.
    ///
    /// Roughness comes from a roughness map, else from an inverted gloss map, else from a packed map. Height and occlusion also come from a
    /// packed map if they have no separate file.
    ///
    /// # Errors
    /// One line: a required map is missing (the message lists files of the folder), several files remain for one map, or the format of the chosen
    /// file of a map cannot be read.
    pub fn choose(self, folder: &Path, files: &[PathBuf]) -> Result<Recognised, String> {
        let mut chooser = Chooser { left: self.candidates, owner: None, unused: Vec::new(), folder };
        let share = Reading::Share { channel: None, inverted: false };
        let albedo = chooser.one("albedo", |kind| kind == Kind::Albedo)?;
        chooser.owner = albedo.as_ref().map(|albedo| albedo.key.clone());
        let albedo = albedo.map(|c| c.source(Reading::Colour));
        let normal = chooser.one("normal", |kind| matches!(kind, Kind::Normal(_)))?.map(|c| match c.label.kind {
            Kind::Normal(convention) => c.source(Reading::Normal(convention)),
            _ => c.source(Reading::Normal(Convention::Unstated)),
        });
        let height = chooser.one("height", |kind| kind == Kind::Height)?.map(|c| c.source(Reading::Height(None)));
        let roughness = chooser.roughness()?;
        let occlusion = chooser.one("ambient occlusion", |kind| kind == Kind::Occlusion)?.map(|c| c.source(share));

        let wanted = [(Held::Height, &height), (Held::Roughness, &roughness), (Held::Occlusion, &occlusion)];
        let wanted: Vec<Held> = wanted.into_iter().filter(|(_, source)| source.is_none()).map(|(held, _)| held).collect();
        let packed = chooser.packed(&wanted)?;
        let from_packed = |held: Held, reading: fn(usize) -> Reading| packed.as_ref().and_then(|c| c.channel(held, reading));
        let packed_share = |channel| Reading::Share { channel: Some(channel), inverted: false };
        let height = height.or_else(|| from_packed(Held::Height, |channel| Reading::Height(Some(channel))));
        let roughness = roughness.or_else(|| from_packed(Held::Roughness, packed_share));
        let occlusion = occlusion.or_else(|| from_packed(Held::Occlusion, packed_share));

        let required = [("albedo", &albedo), ("normal", &normal), ("height", &height), ("roughness", &roughness)];
        let missing: Vec<&str> = required.into_iter().filter(|(_, source)| source.is_none()).map(|(name, _)| name).collect();
        let (Some(albedo), Some(normal), Some(height), Some(roughness)) = (albedo, normal, height, roughness) else {
            return Err(missing_maps(&missing, folder, files));
        };
        Ok(Recognised { albedo, normal, height, roughness, occlusion, notes: self.notes, unused: chooser.unused })
    }
}

/// The message for a folder that lacks maps. `files`: the files of the folder.
fn missing_maps(missing: &[&str], folder: &Path, files: &[PathBuf]) -> String {
    let there = if files.is_empty() { "nothing".to_owned() } else { few(files.iter().map(|file| shown_name(file))) };
    let example = missing.first().copied().unwrap_or_default();
    format!(
        "no {} map in {} (the folder contains: {there}); add it, with a name such as {example}.png",
        missing.join(", no "),
        shown(folder)
    )
}

/// Chooses files from the candidates of a set.
struct Chooser<'a> {
    left: Vec<Candidate>,
    /// The key of the candidate that was chosen as the albedo.
    owner: Option<String>,
    unused: Vec<Unused>,
    folder: &'a Path,
}

impl Chooser<'_> {
    fn take(&mut self, is_wanted: impl Fn(Kind) -> bool) -> Vec<Candidate> {
        let (wanted, left) = mem::take(&mut self.left).into_iter().partition(|c| is_wanted(c.label.kind));
        self.left = left;
        wanted
    }

    fn drop_all(&mut self, is_wanted: impl Fn(Kind) -> bool, reason: &str) {
        let dropped = self.take(is_wanted);
        self.unused.extend(dropped.iter().map(|c| Unused::new(&c.file, reason)));
    }

    /// Chooses the roughness map, or a gloss map if there is none.
    fn roughness(&mut self) -> Result<Option<Source>, String> {
        let is_gloss = |kind: Kind| kind == Kind::Smoothness;
        let share = |inverted| Reading::Share { channel: None, inverted };
        if let Some(roughness) = self.one("roughness", |kind| kind == Kind::Roughness)? {
            self.drop_all(is_gloss, "the roughness map is used");
            return Ok(Some(roughness.source(share(false))));
        }
        Ok(self.one("gloss", is_gloss)?.map(|gloss| gloss.source(share(true))))
    }

    /// Chooses a packed map that holds at least one of the wanted maps.
    fn packed(&mut self, wanted: &[Held]) -> Result<Option<Candidate>, String> {
        let is_useful = |kind: Kind| match kind {
            Kind::Packed(channels) => wanted.iter().any(|held| channels.contains(held)),
            _ => false,
        };
        let packed = self.one("packed", is_useful)?;
        self.drop_all(|kind| matches!(kind, Kind::Packed(_)), "each of its maps also has a separate file, which is used");
        Ok(packed)
    }

    /// Chooses the file of one map; `None`: there is none.
    fn one(&mut self, what: &str, is_wanted: impl Fn(Kind) -> bool) -> Result<Option<Candidate>, String> {
        let mut found = self.take(is_wanted);
        if let Some(owner) = self.owner.clone() {
            // Names without a material fit all materials.
            let (own, foreign): (Vec<_>, Vec<_>) = found.into_iter().partition(|c| c.key == owner || c.key.is_empty() || owner.is_empty());
            self.unused.extend(
                foreign.iter().map(|c| Unused::new(&c.file, "its name states a different material than the name of the albedo map")),
            );
            found = own;
            self.prefer(&mut found, |c| u32::from(c.key != owner), "the map with the same name as the albedo is used");
        }
        self.prefer(&mut found, |c| u32::from(!c.is_readable()), "this format cannot be read; another file of the same map is used");
        self.prefer(
            &mut found,
            |c| match c.label.kind {
                Kind::Normal(Convention::Unstated) => 1,
                Kind::Normal(Convention::DirectX) => 2,
                _ => 0,
            },
            "another normal map is used; order of preference: OpenGL, no stated convention, DirectX",
        );
        self.prefer(&mut found, |c| c.label.lod.unwrap_or(0), "the finest level of detail is used");
        if found.iter().all(|c| c.label.resolution.is_some()) {
            let rank = |c: &Candidate| match c.label.resolution {
                Some(edge) if edge <= MAX_EDGE => MAX_EDGE - edge,
                edge => edge.unwrap_or(0),
            };
            self.prefer(&mut found, rank, "the map with the highest resolution up to 8192 is used");
        }
        if found.len() > 1 {
            let names = few(found.iter().map(|c| shown_name(&c.file)));
            return Err(format!("{} files in {} could be the {what} map: {names}; keep one", found.len(), shown(self.folder)));
        }
        let Some(found) = found.pop() else { return Ok(None) };
        if !found.is_readable() {
            return Err(format!(
                "{} holds the {what} map, but .{} files cannot be read: save it as 8- or 16-bit PNG",
                shown(&found.file),
                shown(Path::new(&extension(&found.file)))
            ));
        }
        Ok(Some(found))
    }

    /// Keeps the candidates with the lowest rank. The others are listed as unused, with this reason.
    fn prefer(&mut self, found: &mut Vec<Candidate>, rank: impl Fn(&Candidate) -> u32, reason: &str) {
        let Some(lowest) = found.iter().map(&rank).min() else { return };
        let (kept, dropped): (Vec<_>, Vec<_>) = mem::take(found).into_iter().partition(|c| rank(c) == lowest);
        *found = kept;
        self.unused.extend(dropped.iter().map(|c| Unused::new(&c.file, reason)));
    }
}

fn extension(file: &Path) -> String {
    file.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// A path for a message: characters that cannot be printed, such as line breaks and terminal escapes, are written as escape sequences.
pub fn shown(path: &Path) -> String {
    let escaped = |c: char| match c {
        '\'' | '"' | '\\' => c.to_string(),
        c => c.escape_debug().to_string(),
    };
    path.to_string_lossy().chars().map(escaped).collect()
}

/// The last component of a path, as [`shown`] writes it.
pub fn shown_name(path: &Path) -> String {
    path.file_name().map_or_else(|| shown(path), |name| shown(Path::new(name)))
}

/// A list of names for a message. If there are more than eight, the others are counted.
pub fn few(names: impl IntoIterator<Item = String>) -> String {
    let mut names = names.into_iter();
    let first: Vec<String> = names.by_ref().take(MOST_NAMES).collect();
    match names.count() {
        0 => first.join(", "),
        more => format!("{} and {more} more", first.join(", ")),
    }
}

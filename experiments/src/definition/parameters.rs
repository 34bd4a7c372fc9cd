//! Parameters that a definition sets or varies: settings of the scene file and of the frame.

use std::ffi::OsString;
use std::fs;
use std::hash::Hasher;
use std::io::{self, BufRead as _, BufReader};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use kernels::base::names::suggestion;
use kernels::decode::heightmap::ReadOptions;
use kernels::frame::{self, FRAME, FrameSettings};
use kernels::import::materials::MAX_DEPTH;
use kernels::import::scene_folder::ImportOptions;
use kernels::materials::folder::READABLE;
use kernels::scene::{self, Scene, SceneText};
use kernels::settings::Home;
use toml::{Table, Value};
use twox_hash::XxHash64;
use walkdir::{DirEntry, WalkDir};

use super::{Definition, Import, Setting};
use crate::process::check_interrupted;

/// Sets a parameter in the settings of the frame. Parameters of the scene are ignored.
pub(super) fn apply(settings: &mut FrameSettings, parameter: &str, value: &Value) -> Result<(), String> {
    match value {
        // If a definition contains the key `frame.tile` without quotes, TOML makes a table `frame` with the key `tile`.
        Value::Table(table) if is_of_frame(parameter, value) => {
            table.iter().try_for_each(|(key, value)| set_of_frame(settings, &format!("{FRAME}{key}"), value))
        }
        _ if is_of_frame(parameter, value) => set_of_frame(settings, parameter, value),
        _ => Ok(()),
    }
}

fn set_of_frame(settings: &mut FrameSettings, parameter: &str, value: &Value) -> Result<(), String> {
    let lists = |home: &Home| if let Home::DefinitionList(list) = home { Some(*list) } else { None };
    match frame::setting(parameter) {
        Some(setting) if setting.has_home(Home::Definition) => setting.set(settings, value),
        Some(setting) => Err(match setting.listing.homes.iter().find_map(lists) {
            Some(list) => format!("`{parameter}` cannot be set here: a definition gives it in `{list}`"),
            None => format!("`{parameter}` does not affect what an experiment measures: remove it (`render` and the workbench use it)"),
        }),
        None => Err(format!("`{parameter}` is not a setting of the frame: {}", suggestion(parameter, &frame_parameters()))),
    }
}

/// Returns the keys of the frame's settings that a definition may set or vary.
pub(super) fn frame_parameters() -> Vec<&'static str> {
    frame::settings().filter(|setting| setting.has_home(Home::Definition)).map(|setting| setting.key).collect()
}

/// Limit of the number of steps in the path of a scene parameter. The path `material.grass.tint.2` has four steps. Without the limit, a path of
/// thousands of steps would create nested tables of this depth and overflow the stack.
const MOST_STEPS: usize = 8;

/// Sets the value at `path` in a document. If the old and the new value are tables, they are merged. In a list, a step of the path selects an entry
/// by its number, counted from 1. In a list of tables, a step can also be the `name` of a table; names take precedence over numbers.
fn set(at: &mut Value, path: &[&str], value: &Value) -> Result<(), String> {
    let Some((step, rest)) = path.split_first() else {
        match (at, value) {
            (Value::Table(old), Value::Table(new)) => {
                for (key, value) in new {
                    set(old.entry(key.clone()).or_insert_with(|| Value::Table(Table::new())), &[], value)?;
                }
            }
            (at, value) => *at = value.clone(),
        }
        return Ok(());
    };
    match at {
        Value::Table(table) => set(table.entry((*step).to_owned()).or_insert_with(|| Value::Table(Table::new())), rest, value),
        Value::Array(items) => {
            let name = |item: &Value| item.get("name").and_then(Value::as_str).map(str::to_owned);
            let number = step.parse::<usize>().ok().and_then(|number| number.checked_sub(1)).filter(|&index| index < items.len());
            let Some(index) = items.iter().position(|item| name(item).as_deref() == Some(step)).or(number) else {
                let names: Vec<String> = items.iter().filter_map(name).collect();
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                return Err(if items.is_empty() {
                    format!("`{step}` is not an entry of this list, which is empty")
                } else if names.is_empty() {
                    format!("`{step}` is not an entry of this list of {}: give a number from 1 to {}", items.len(), items.len())
                } else {
                    format!("`{step}` is not in the list: {}", suggestion(step, &names))
                });
            };
            set(&mut items[index], rest, value)
        }
        other => Err(format!("{other} has no key `{step}`")),
    }
}

/// Resolves a file name of a definition. A leading `$SCREE_DATA` is replaced, and relative names refer to `folder`.
pub(super) fn resolve(text: &str, folder: &Path) -> Result<PathBuf, String> {
    resolve_with(text, folder, std::env::var_os("SCREE_DATA"))
}

fn resolve_with(text: &str, folder: &Path, data: Option<OsString>) -> Result<PathBuf, String> {
    let Some(rest) = text.strip_prefix("$SCREE_DATA").filter(|rest| rest.is_empty() || rest.starts_with(['/', '\\'])) else {
        return Ok(folder.join(text));
    };
    match data.filter(|value| !value.is_empty()) {
        Some(data) => Ok(Path::new(&data).join(rest.trim_start_matches(['/', '\\']))),
        None => Err(format!(
            "`{text}` needs the variable SCREE_DATA, which is not set: set it to the folder that contains the real terrain and materials"
        )),
    }
}

/// An import with resolved file names: they are absolute, or relative to the current folder.
pub(crate) struct ImportJob {
    /// The heightmap.
    pub(crate) heightmap: PathBuf,
    /// Options for reading the heightmap, for the materials, and for added relief.
    pub(crate) options: ImportOptions,
}

impl Import {
    /// Returns the import with its file names resolved; relative names refer to `folder`.
    ///
    /// # Errors
    /// `$SCREE_DATA` is needed but not set.
    pub(crate) fn job(&self, folder: &Path) -> Result<ImportJob, String> {
        Ok(ImportJob {
            heightmap: resolve(&self.heightmap, folder)?,
            options: ImportOptions {
                read: ReadOptions {
                    metres_per_texel: self.metres_per_texel,
                    height_range_m: self.height_range_m,
                    ..ReadOptions::default()
                },
                materials: self.materials.as_deref().map(|text| resolve(text, folder)).transpose()?,
                tile_m: None,
                detail_m: self.detail_m,
            },
        })
    }
}

/// The reason why the scene with changed settings is refused.
pub(super) struct Refused {
    /// Whether the cause is the name of a parameter, for example an unknown key. Otherwise the cause is a wrong value, or an error in the unchanged
    /// scene.
    pub(super) unknown_key: bool,
    pub(super) what: String,
}

impl Definition {
    /// Returns the text of the scene as it is before the settings of the definition are applied. `imported` is the folder of the imported scene, if
    /// there is one.
    pub(super) fn scene_text(&self, imported: Option<&Path>) -> Result<SceneText, String> {
        let path = match (&self.scene, &self.import, imported) {
            (_, Some(_), Some(folder)) => folder.to_owned(),
            (_, Some(_), None) => return Err("the scene has not been imported yet".to_owned()),
            (None, None, _) => PathBuf::from(scene::DEFAULT),
            (Some(name), None, _) if name == scene::DEFAULT => PathBuf::from(name),
            (Some(name), None, _) => resolve(name, &self.folder)?,
        };
        scene::text(&path.to_string_lossy()).map_err(|error| error.to_string())
    }

    /// Returns the scene of `text` after applying the settings of the definition and one value of the varied parameter.
    pub(super) fn altered(&self, text: &SceneText, setting: &Setting) -> Result<Scene, Refused> {
        // The unchanged text is parsed first, because line numbers in its error messages refer to the file.
        let plain = scene::parse(&text.text, &text.name, &text.folder);
        let plain = plain.map_err(|error| Refused { unknown_key: false, what: error.to_string() })?;
        let varied = self.vary.as_ref().map(|vary| vary.parameter.as_str()).zip(setting.as_ref());
        let of_scene = |(parameter, value): (&String, &Value)| !is_of_frame(parameter, value);
        let mut changes: Vec<(&str, &Value)> = self.settings.iter().filter(|&s| of_scene(s)).map(|(p, v)| (p.as_str(), v)).collect();
        changes.extend(varied.filter(|(parameter, _)| !parameter.starts_with(FRAME)));
        if changes.is_empty() {
            return Ok(plain);
        }
        let mut document =
            text.text.parse::<Table>().map(Value::Table).map_err(|error| Refused { unknown_key: false, what: error.to_string() })?;
        for (parameter, value) in changes {
            let path: Vec<&str> = parameter.split('.').collect();
            if path.len() > MOST_STEPS {
                let what = format!(
                    "the name of a parameter has {} steps (words between dots), but at most {MOST_STEPS} are accepted: correct the name",
                    path.len()
                );
                return Err(Refused { unknown_key: true, what });
            }
            set(&mut document, &path, value)
                .map_err(|what| Refused { unknown_key: true, what: format!("`{parameter}` is not in the scene: {what}") })?;
        }
        let altered = toml::to_string(&document).map_err(|error| Refused { unknown_key: false, what: error.to_string() })?;
        scene::parse(&altered, &text.name, &text.folder).map_err(|error| {
            // The line number is omitted, because it refers to the changed text, which the user cannot see.
            let what = match error {
                kernels::base::error::Error::Scene { what, .. } => what,
                other => other.to_string(),
            };
            Refused { unknown_key: what.starts_with("unknown key"), what }
        })
    }

    /// Returns the scene of a run: the settings of the definition and the value `setting` of the varied parameter are applied. `imported` is the
    /// folder of the imported scene, which must be given if the definition imports a scene.
    ///
    /// # Errors
    /// The scene cannot be read, is invalid, or has not been imported yet.
    pub fn scene(&self, setting: &Setting, imported: Option<&Path>) -> Result<Scene> {
        let text = self.scene_text(imported).map_err(|what| anyhow!("experiment `{}`: scene: {what}", self.name))?;
        self.altered(&text, setting).map_err(|refused| anyhow!("experiment `{}`: scene: {}", self.name, refused.what))
    }

    /// Returns the settings of the frame: the settings of the definition and the value `setting` of the varied parameter are applied.
    ///
    /// # Errors
    /// A setting is unknown or does not accept its value.
    pub fn frame_settings(&self, setting: &Setting) -> Result<FrameSettings, String> {
        let mut settings = FrameSettings::default();
        for (parameter, value) in &self.settings {
            apply(&mut settings, parameter, value)?;
        }
        if let (Some(vary), Some(value)) = (&self.vary, setting) {
            apply(&mut settings, &vary.parameter, value)?;
        }
        Ok(settings)
    }

    /// Returns the xxHash64 of the files from which the scene is made, as 16 hexadecimal digits. Without an import, these are the text of the scene
    /// file, and the heightmap and the images of materials that the scene reads. With an import, they are the imported heightmap and the images in
    /// the materials folder of the import.
    ///
    /// # Errors
    /// A source cannot be read, or Ctrl-C was pressed.
    pub(crate) fn source_hash(&self) -> Result<String> {
        let mut hasher = XxHash64::with_seed(0);
        match &self.import {
            Some(import) => {
                let job = import.job(&self.folder).map_err(|what| anyhow!("import: {what}"))?;
                add_content(&mut hasher, &job.heightmap)?;
                if let Some(folder) = &job.options.materials {
                    add_images(&mut hasher, folder, MAX_DEPTH)?;
                }
            }
            None => {
                let text = self.scene_text(None).map_err(|what| anyhow!("scene: {what}"))?;
                hasher.write(text.text.as_bytes());
                // A varied setting may be the name of a file.
                let settings: Vec<Setting> = match &self.vary {
                    Some(vary) => vary.values.iter().cloned().map(Some).collect(),
                    None => vec![None],
                };
                let mut paths: Vec<PathBuf> = Vec::new();
                for setting in &settings {
                    for path in self.altered(&text, setting).map_err(|refused| anyhow!("scene: {}", refused.what))?.sources() {
                        if !paths.contains(&path) {
                            paths.push(path);
                        }
                    }
                }
                for path in paths {
                    if path.is_dir() { add_images(&mut hasher, &path, 1)? } else { add_content(&mut hasher, &path)? }
                }
            }
        }
        Ok(digits(&hasher))
    }
}

/// Adds the content of a file to a hash, and then its length. Without the length, the hash would not show where one file ends and the next begins.
fn add_content(hasher: &mut XxHash64, file: &Path) -> Result<()> {
    check_interrupted()?;
    let length = add_bytes(hasher, file)?;
    hasher.write_u64(length.to_le());
    Ok(())
}

/// Adds the bytes of a file to a hash. Returns their number. The file is not read as a whole, because it can be larger than the memory.
pub(crate) fn add_bytes(hasher: &mut XxHash64, file: &Path) -> Result<u64> {
    let mut read = || -> io::Result<u64> {
        let mut input = BufReader::with_capacity(1 << 20, fs::File::open(file)?);
        let mut length = 0;
        loop {
            let bytes = input.fill_buf()?;
            if bytes.is_empty() {
                return Ok(length);
            }
            hasher.write(bytes);
            let count = bytes.len();
            length += count as u64;
            input.consume(count);
        }
    };
    read().with_context(|| format!("cannot read {}", file.display()))
}

/// Adds the names and contents of the images in a folder, down to `depth` levels, in alphabetical order. Names are relative to the folder, so a copy
/// of the folder has the same hash. Other files, hidden ones, and entries that cannot be read are left out: the scene does not read them either.
fn add_images(hasher: &mut XxHash64, folder: &Path, depth: usize) -> Result<()> {
    let is_hidden = |entry: &DirEntry| entry.depth() > 0 && entry.file_name().to_string_lossy().starts_with('.');
    let entries = WalkDir::new(folder).follow_links(true).max_depth(depth).sort_by_file_name().into_iter();
    for entry in entries.filter_entry(|entry| !is_hidden(entry)).filter_map(Result::ok) {
        let extension = entry.path().extension().unwrap_or_default().to_string_lossy().to_lowercase();
        if !entry.file_type().is_file() || !READABLE.contains(&extension.as_str()) {
            continue;
        }
        let name: Vec<String> =
            entry.path().strip_prefix(folder).unwrap_or(entry.path()).iter().map(|part| part.to_string_lossy().into_owned()).collect();
        hasher.write(name.join("/").as_bytes());
        add_content(hasher, entry.path())?;
    }
    Ok(())
}

fn is_of_frame(parameter: &str, value: &Value) -> bool {
    parameter.starts_with(FRAME) || parameter == FRAME.trim_end_matches('.') && value.is_table()
}

/// Returns the xxHash64 of `bytes` with seed 0, in the form that `xxhsum -H1` prints.
pub(crate) fn hash(bytes: &[u8]) -> String {
    let mut hasher = XxHash64::with_seed(0);
    hasher.write(bytes);
    digits(&hasher)
}

/// Returns the hash in 16 hexadecimal digits.
pub(crate) fn digits(hasher: &XxHash64) -> String {
    format!("{:016x}", hasher.finish())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_folder_is_put_in_or_asked_for() {
        let folder = Path::new("here");
        let data = || Some(OsString::from("/data"));
        assert_eq!(resolve_with("a/b.toml", folder, None), Ok(PathBuf::from("here/a/b.toml")));
        assert_eq!(resolve_with("$SCREE_DATA/dem/x.png", folder, data()), Ok(PathBuf::from("/data/dem/x.png")));
        assert_eq!(resolve_with("$SCREE_DATA", folder, data()), Ok(PathBuf::from("/data")));
        assert_eq!(resolve_with("$SCREE_DATABASE/x", folder, data()), Ok(PathBuf::from("here/$SCREE_DATABASE/x")));
        for unset in [None, Some(OsString::new())] {
            assert!(resolve_with("$SCREE_DATA/x", folder, unset).is_err_and(|what| what.contains("SCREE_DATA, which is not set")));
        }
    }

    #[test]
    fn paths_reach_tables_lists_and_names() {
        let text = "[blend]\nhash_scale = 1.0\n[[material]]\nname = \"a\"\ntint = [1.0, 1.0, 1.0]\n[[material]]\nname = \"b\"\n[[rule]]\nweight = 1.0\n";
        let mut document = Value::Table(text.parse().unwrap());
        let mut put = |path: &str, value: Value| {
            let path: Vec<&str> = path.split('.').collect();
            set(&mut document, &path, &value)
        };
        put("blend.hash_scale", Value::Float(2.0)).unwrap();
        put("material.b.tile_m", Value::Integer(3)).unwrap();
        put("material.1.tint.2", Value::Float(0.5)).unwrap();
        put("blend", Value::Table("mip_bias = 1.0".parse().unwrap())).unwrap();
        assert!(put("material.c.tile_m", Value::Integer(3)).is_err_and(|what| what.contains("the known names are a, b")));
        assert!(put("rule.2.weight", Value::Integer(3)).is_err_and(|what| what.contains("from 1 to 1")));
        assert!(put("blend.hash_scale.x", Value::Integer(3)).is_err_and(|what| what.contains("has no key `x`")));
        let at = |path: &[&str]| path.iter().fold(&document, |at, key| key.parse::<usize>().map_or_else(|_| &at[*key], |i| &at[i]));
        assert_eq!(at(&["blend", "hash_scale"]), &Value::Float(2.0));
        assert_eq!(at(&["blend", "mip_bias"]), &Value::Float(1.0));
        assert_eq!(at(&["material", "1", "tile_m"]), &Value::Integer(3));
        assert_eq!(at(&["material", "0", "tint", "1"]), &Value::Float(0.5));
    }

    #[test]
    fn hashes_are_those_of_xxhsum() {
        // The published xxHash64 of the empty input.
        assert_eq!(hash(b""), "ef46db3751d8e999");
        assert_ne!(hash(b"a"), hash(b"b"));
    }
}

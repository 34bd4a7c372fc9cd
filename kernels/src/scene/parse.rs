//! Reads scene files.

use std::path::{Path, PathBuf};

use super::Scene;
use super::validate::check;
use crate::base::document;
use crate::base::error::{Error, Result};
use crate::base::names::nearest;

/// Name of the built-in scene.
pub const DEFAULT: &str = "default";

/// Name of the scene file in a folder that holds a scene.
pub const FILE: &str = "scene.toml";

/// Text of the built-in scene. It also serves as an example of a scene file.
pub const DEFAULT_TEXT: &str = include_str!("default.toml");

/// The text of a scene file, before parsing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SceneText {
    /// The TOML.
    pub text: String,
    /// Name by which error messages refer to the text.
    pub name: String,
    /// Folder to which relative file names refer.
    pub folder: PathBuf,
}

/// Reads a scene. `default` names the built-in scene; any other text is the path of a `.toml` file or of a folder that holds `scene.toml`.
///
/// # Errors
/// As for [`text`] and [`parse`].
pub fn load(path_or_name: &str) -> Result<Scene> {
    let scene = text(path_or_name)?;
    parse(&scene.text, &scene.name, &scene.folder)
}

/// Reads the text of a scene. `path_or_name` is as for [`load`].
///
/// # Errors
/// The path does not exist, the folder holds no `scene.toml`, or the file cannot be read as text (see [`document::text_of`]).
pub fn text(path_or_name: &str) -> Result<SceneText> {
    if path_or_name == DEFAULT {
        return Ok(SceneText { text: DEFAULT_TEXT.to_owned(), name: DEFAULT.to_owned(), folder: PathBuf::new() });
    }
    let given = Path::new(path_or_name);
    let scene_error = |what: String| Error::Scene { where_: given.display().to_string(), what };
    let file: PathBuf = if given.is_dir() { given.join(FILE) } else { given.to_owned() };
    if !file.exists() {
        return Err(scene_error(if given.is_dir() {
            "the folder holds no scene.toml: give the path of the scene's .toml file".to_owned()
        } else {
            let hint = nearest(path_or_name, &[DEFAULT]).map_or_else(String::new, |near| format!(" (did you mean `{near}`?)"));
            format!("no such file or folder{hint}: give `{DEFAULT}`, a .toml file, or a folder with scene.toml")
        }));
    }
    let text = document::text_of(&file, "scene").map_err(scene_error)?;
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    Ok(SceneText { text, name: file.display().to_string(), folder })
}

/// Reads a scene from `text` and validates it. `where_` names the text in errors; relative file names refer to `folder`.
///
/// # Errors
/// If the text is not TOML, if a key is missing or unknown, if a value has the wrong type, or if [`super::validate`] refuses the scene. The error
/// gives the place as `where_:line` or, if the line is not known, as `where_`.
pub fn parse(text: &str, where_: &str, folder: &Path) -> Result<Scene> {
    let refuse = |wrong: document::Wrong| Error::Scene { where_: wrong.place(where_), what: wrong.what };
    let mut scene: Scene = document::read(text, remedy_of_missing).map_err(|wrong| refuse(in_words_of_settings(wrong, text)))?;
    scene.folder = folder.to_owned();
    check(&scene).map_err(|problem| refuse(problem.wrong(text)))?;
    Ok(scene)
}

/// Replaces the message about a value of the wrong type by the message of [`Setting::accept`](crate::settings::Setting::accept), if the value is a
/// setting.
fn in_words_of_settings(wrong: document::Wrong, text: &str) -> document::Wrong {
    let Ok(document) = text.parse::<toml::Table>() else { return wrong };
    let mut said = super::settings().filter_map(|setting| {
        let (tables, key) = setting.key.rsplit_once('.').map_or((None, setting.key), |(table, key)| (Some(table), key));
        let table = tables.map_or(Some(&document), |table| document.get(table)?.as_table())?;
        let what = setting.accept(table.get(key)?).err()?;
        Some(setting.place().sentence(what).wrong(text))
    });
    // A refused setting on another line is a different mistake, so `wrong` is returned unchanged.
    said.find(|said| said.line == wrong.line).unwrap_or(wrong)
}

fn remedy_of_missing(key: &str) -> &'static str {
    match key {
        "material" => ": give at least one [[material]]",
        "rule" => ": give at least one [[rule]]",
        "key" => ": a [[path]] needs at least two [[path.key]]",
        "kind" => ": write kind = \"procedural\" or kind = \"heightmap\" in [world]",
        _ => "",
    }
}

//! Reads a definition file.

use std::path::Path;

use anyhow::{Context, Result, anyhow};
use kernels::base::document;

use super::Definition;

/// Reads a definition file, and checks the definition and its scene.
///
/// # Errors
/// The file cannot be read, or [`parse`] refuses it.
pub fn load(file: &Path) -> Result<Definition> {
    let place = || format!("experiment {}", file.display());
    if !file.exists() {
        anyhow::bail!("{}: no such file: give the .toml file of a definition", place());
    }
    if file.is_dir() {
        anyhow::bail!("{} is a folder: give the .toml file of a definition in this folder", place());
    }
    let text = document::text_of(file, "definition").map_err(|what| anyhow!(what)).with_context(place)?;
    let folder = match file.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    parse(&text, &file.display().to_string(), folder)
}

/// Reads a definition from `text`, and checks the definition and its scene. `name` is the name of the text in error messages. Relative file names
/// refer to `folder`.
///
/// # Errors
/// The message is one line with the place in the text and, usually, the remedy. Possible causes are: invalid TOML, an unknown key, a wrong type or
/// value, a metric that needs more seeds or frames, an expectation that selects no rows, and a scene that is invalid or lacks something that the
/// definition needs.
pub fn parse(text: &str, name: &str, folder: &Path) -> Result<Definition> {
    let refuse = |wrong: document::Wrong| anyhow!("experiment {}: {}", wrong.place(name), wrong.what);
    let mut definition: Definition = document::read(text, remedy_of_missing).map_err(refuse)?;
    definition.folder = folder.to_owned();
    definition.check().map_err(|problem| refuse(problem.wrong(text)))?;
    Ok(definition)
}

/// Reads the definition that is stored with a run. Only the types of its values are checked. The scene is not checked, because its files may have
/// been removed.
///
/// # Errors
/// The text is not a definition.
pub fn stored(text: &str) -> Result<Definition> {
    document::read(text, remedy_of_missing).map_err(|wrong| anyhow!("{}: {}", wrong.place("stored definition"), wrong.what))
}

fn remedy_of_missing(key: &str) -> &'static str {
    match key {
        "name" => ": give the experiment (or the [[view]]) a short name",
        "question" => ": write the question that the run answers",
        "size" => ": write size = [480, 270]",
        "frames" => ": write frames = 16",
        "variants" => ": write variants = [\"all\"]",
        "range" => ": an [[expect]] needs the smallest and the largest value",
        _ => "",
    }
}

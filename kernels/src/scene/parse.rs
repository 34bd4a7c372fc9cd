//! Reading a scene file, and saying where in it something is wrong.

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Scene;
use super::validate::{Problem, Step, check};
use crate::error::{Error, Result};

/// Name of the built-in scene.
pub const DEFAULT: &str = "default";

/// Text of the built-in scene, an example of everything a scene file may say.
pub const DEFAULT_TEXT: &str = include_str!("default.toml");

/// Scene files are small; anything larger was given by mistake.
const MAX_BYTES: u64 = 4 << 20;

/// Reads a scene: `default` is the built-in one, anything else the path of a `.toml` file or of a folder that holds `scene.toml`.
///
/// # Errors
/// The path does not exist or cannot be read, or what [`parse`] refuses.
pub fn load(path_or_name: &str) -> Result<Scene> {
    if path_or_name == DEFAULT {
        return parse(DEFAULT_TEXT, DEFAULT, Path::new(""));
    }
    let given = Path::new(path_or_name);
    let scene_error = |what: String| Error::Scene { where_: given.display().to_string(), what };
    let file: PathBuf = if given.is_dir() { given.join("scene.toml") } else { given.to_owned() };
    if !file.exists() {
        return Err(scene_error(if given.is_dir() {
            "the folder holds no scene.toml: give the path of the scene's .toml file".to_owned()
        } else {
            let hint = nearest(path_or_name, &[DEFAULT]).map_or_else(String::new, |near| format!(" (did you mean `{near}`?)"));
            format!("no such file or folder{hint}: give `{DEFAULT}`, a .toml file, or a folder with scene.toml")
        }));
    }
    let unreadable = |source| Error::File { file: file.clone(), source };
    // A device or pipe has no end to read to.
    let metadata = fs::metadata(&file).map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(scene_error("is not a plain file: give a .toml file, or a folder with scene.toml".to_owned()));
    }
    if metadata.len() > MAX_BYTES {
        return Err(scene_error(format!("{} bytes is too large for a scene file (limit {MAX_BYTES}): is it a TOML file?", metadata.len())));
    }
    let bytes = fs::read(&file).map_err(unreadable)?;
    let text = String::from_utf8(bytes).map_err(|_| scene_error("is not UTF-8 text: a scene is a TOML file".to_owned()))?;
    let folder = file.parent().unwrap_or(Path::new("")).to_owned();
    parse(&text, &file.display().to_string(), &folder)
}

/// Reads a scene from `text` and validates it. `where_` names the text in errors; relative file names refer to `folder`.
///
/// # Errors
/// Not TOML, an unknown key (the nearest known one is named), a wrong type, or what [`super::validate`] refuses; the
/// place is given as `where_:line`.
pub fn parse(text: &str, where_: &str, folder: &Path) -> Result<Scene> {
    let mut scene: Scene = toml::from_str(text).map_err(|error| {
        let (line, what) = explain(text, &error);
        let place = line.map_or_else(|| where_.to_owned(), |line| format!("{where_}:{line}"));
        Error::Scene { where_: place, what }
    })?;
    scene.folder = folder.to_owned();
    check(&scene).map_err(|problem| {
        let line = line_of_problem(text, &problem).map_or_else(String::new, |line| format!(":{line}"));
        Error::Scene { where_: format!("{where_}{line}"), what: problem.to_string() }
    })?;
    Ok(scene)
}

/// The known word that `word` was probably meant to be: at most a third of its letters wrong (at least one letter may be, never
/// all). Case, `-` and `_` are not told apart; ties go to the earlier word.
pub fn nearest<'a>(word: &str, known: &[&'a str]) -> Option<&'a str> {
    let plain = |text: &str| text.to_lowercase().replace('_', "-");
    let wanted = plain(word);
    let length = wanted.chars().count();
    known
        .iter()
        .map(|&candidate| (strsim::osa_distance(&wanted, &plain(candidate)), candidate))
        .filter(|&(distance, candidate)| {
            let longer = length.max(candidate.chars().count());
            distance <= (longer / 3).max(1) && distance < length.max(1)
        })
        .min_by_key(|&(distance, _)| distance)
        .map(|(_, candidate)| candidate)
}

/// Line (from 1) and one-line text of what the TOML reader objected to.
fn explain(text: &str, error: &toml::de::Error) -> (Option<usize>, String) {
    let message = one_line(error.message());
    let span = error.span();
    let line = |at: &Range<usize>| line_at(text, at.start);
    let Some(rest) = message.strip_prefix("unknown field `") else {
        let what = match message.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`')) {
            Some(key) => format!("the key `{key}` is missing{}", place_of_missing(key)),
            None => match span.as_ref().and_then(|span| find_value(text, &message, span)) {
                Some((key, at)) => return (Some(line(&at)), format!("{key}: {message}")),
                None => message,
            },
        };
        return (span.as_ref().map(line), what);
    };
    let (key, expected) = rest.split_once('`').unwrap_or((rest, ""));
    // Backticked words at odd places of "expected one of `a`, `b`".
    let known: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    let hint = nearest(key, &known).map_or_else(
        || {
            let mut known = known.clone();
            known.sort_unstable();
            format!("known here: {}", known.join(", "))
        },
        |near| format!("did you mean `{near}`?"),
    );
    // The reader's span is that of the whole table where an enumeration is read through its tag.
    let at = find_key(text, key, span.as_ref()).or(span);
    (at.as_ref().map(line), format!("unknown key `{key}`: {hint}"))
}

fn place_of_missing(key: &str) -> &'static str {
    match key {
        "material" => ": give at least one [[material]]",
        "rule" => ": give at least one [[rule]]",
        "key" => ": a [[path]] needs at least two [[path.key]]",
        "kind" => ": write kind = \"procedural\" or kind = \"heightmap\" in [world]",
        _ => "",
    }
}

/// A key and the value it has, as they stand in the text.
struct Entry {
    key: String,
    key_at: Range<usize>,
    value_at: Range<usize>,
}

/// Every key of the text, from top to bottom; none where the text is not TOML.
fn entries(text: &str) -> Vec<Entry> {
    fn visit(table: &DeTable<'_>, found: &mut Vec<Entry>) {
        for (name, value) in table {
            found.push(Entry { key: name.get_ref().to_string(), key_at: name.span(), value_at: value.span() });
            visit_value(value.get_ref(), found);
        }
    }
    fn visit_value(value: &DeValue<'_>, found: &mut Vec<Entry>) {
        if let Some(table) = value.as_table() {
            visit(table, found);
        } else if let Some(array) = value.as_array() {
            array.iter().for_each(|item| visit_value(item.get_ref(), found));
        }
    }
    let mut found = Vec::new();
    if let Ok(document) = DeTable::parse(text) {
        visit(document.get_ref(), &mut found);
    }
    found.sort_by_key(|entry| entry.key_at.start);
    found
}

fn holds(outer: &Range<usize>, inner: &Range<usize>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

/// Where a key of this name is written, inside `within` if it is there.
fn find_key(text: &str, key: &str, within: Option<&Range<usize>>) -> Option<Range<usize>> {
    let mut entries = entries(text);
    entries.retain(|entry| entry.key == key);
    let inside = |entry: &&Entry| within.is_none_or(|outer| holds(outer, &entry.key_at));
    entries.iter().find(inside).or(entries.first()).map(|entry| entry.key_at.clone())
}

/// Key and place of the value that the reader objected to at `span`: the value there or, where the reader only knew the table,
/// the one that the message quotes.
fn find_value(text: &str, message: &str, span: &Range<usize>) -> Option<(String, Range<usize>)> {
    if !message.starts_with("invalid ") {
        return None;
    }
    let entries = entries(text);
    let quoted = message.split(['`', '"']).nth(1)?;
    let written = |entry: &&Entry| text.get(entry.value_at.clone()).is_some_and(|value| value.trim_matches('"') == quoted);
    // The last is the innermost.
    let exact = entries.iter().rev().find(|entry| holds(&entry.value_at, span) && !text[entry.value_at.clone()].starts_with('['));
    let found = exact.or_else(|| entries.iter().filter(|entry| entry.key_at.start >= span.start).find(written))?;
    Some((found.key.clone(), found.key_at.clone()))
}

/// Line of the deepest part of the problem's path that is written in the file; what is left out has its default value.
fn line_of_problem(text: &str, problem: &Problem) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let mut table: Option<&DeTable<'_>> = Some(document.get_ref());
    let mut value: Option<&Spanned<DeValue<'_>>> = None;
    let mut at = None;
    for step in &problem.path {
        value = match *step {
            Step::Key(name) => {
                let Some((key, next)) = table.and_then(|t| t.iter().find(|(key, _)| key.get_ref().as_ref() == name)) else {
                    break;
                };
                at = Some(key.span().start);
                Some(next)
            }
            Step::Index(index) => {
                let Some(next) = value.and_then(|v| v.get_ref().as_array()).and_then(|a| a.get(index)) else {
                    break;
                };
                at = Some(next.span().start);
                Some(next)
            }
        };
        table = value.and_then(|v| v.get_ref().as_table());
    }
    at.map(|at| line_at(text, at))
}

fn line_at(text: &str, byte: usize) -> usize {
    text.as_bytes()[..byte.min(text.len())].iter().filter(|&&b| b == b'\n').count() + 1
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

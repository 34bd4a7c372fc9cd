//! Reads TOML documents, such as scene files and definitions of experiments, into their types, and reports errors with their line.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::fs;
use std::ops::Range;
use std::path::Path;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::base::error::one_line;
use crate::base::names::nearest;

/// Largest accepted size of a document file, bytes. Documents are small, so a larger file was probably given by mistake.
const MAX_BYTES: u64 = 4 << 20;

/// The text of a document file, at most 4 MiB of UTF-8. `kind` names the expected kind of document, such as `scene`.
///
/// # Errors
/// The file is a folder, device or pipe, or is too large, unreadable, or not UTF-8. The error gives the reason in one line, without the file's name.
pub fn text_of(file: &Path, kind: &str) -> Result<String, String> {
    let unreadable = |error: std::io::Error| format!("cannot be read: {error}");
    // A device or a pipe is refused, because reading it may never end.
    let metadata = fs::metadata(file).map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(format!("is not a plain file: give the {kind}'s .toml file"));
    }
    if metadata.len() > MAX_BYTES {
        return Err(format!(
            "the file is too large ({} bytes, but at most {MAX_BYTES} are accepted): give the {kind}'s .toml file",
            metadata.len()
        ));
    }
    text(fs::read(file).map_err(unreadable)?, kind)
}

/// Decodes the bytes of a document file as text. `kind` is as for [`text_of`].
///
/// # Errors
/// The bytes are not UTF-8; the message is one line.
pub fn text(bytes: Vec<u8>, kind: &str) -> Result<String, String> {
    String::from_utf8(bytes).map_err(|_| format!("is not UTF-8 text: a {kind} is a TOML file"))
}

/// An error in the text of a document.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wrong {
    /// Line, counted from 1; `None` if it is not known.
    pub line: Option<usize>,
    /// What is wrong and how to fix it.
    pub what: String,
}

impl Wrong {
    /// The place of the error: the document's `name` and the line, if it is known.
    pub fn place(&self, name: &str) -> String {
        self.line.map_or_else(|| name.to_owned(), |line| format!("{name}:{line}"))
    }
}

/// Parses `text` as a `T`. If a key is missing, `remedy_of_missing(key)`, which may be empty, is appended to the message.
///
/// # Errors
/// The text is not TOML, a key is missing, or the text contains an unknown key, a value of a wrong type, or too many entries in a list of fixed
/// length. For an unknown key, the message names the nearest known key or, if none is near, all keys that are known at this place.
pub fn read<T: DeserializeOwned + Serialize>(text: &str, remedy_of_missing: fn(&str) -> &'static str) -> Result<T, Wrong> {
    let read: T = toml::from_str(text).map_err(|error| {
        let (line, what) = explain(text, &error, remedy_of_missing);
        Wrong { line, what }
    })?;
    // The TOML reader silently drops the surplus entries of a list of fixed length, so the result is compared with the document.
    let whole = |what: String| Wrong { line: None, what: one_line(&what) };
    let given = text.parse::<toml::Table>().map_err(|error| whole(error.to_string()))?;
    let taken = toml::Table::try_from(&read).map_err(|error| whole(error.to_string()))?;
    let problem = surplus(&toml::Value::Table(given), &toml::Value::Table(taken), &mut Vec::new());
    problem.map_or(Ok(read), |problem| Err(problem.wrong(text)))
}

/// Finds the first list that has fewer entries in `taken`, the result of the reader, than in `given`, the document.
fn surplus(given: &toml::Value, taken: &toml::Value, path: &mut Vec<Step>) -> Option<Problem> {
    let mut within = |step: Step, given: &toml::Value, taken: &toml::Value| {
        path.push(step);
        let found = surplus(given, taken, path);
        path.pop();
        found
    };
    match (given, taken) {
        (toml::Value::Table(given), toml::Value::Table(taken)) => {
            given.iter().find_map(|(key, value)| within(Step::Key(key.clone().into()), value, taken.get(key)?))
        }
        (toml::Value::Array(given), toml::Value::Array(taken)) if given.len() > taken.len() => {
            Some(At(path.clone()).problem(format!("has {} entries, must have {}", given.len(), taken.len())))
        }
        (toml::Value::Array(given), toml::Value::Array(taken)) => {
            given.iter().zip(taken).enumerate().find_map(|(i, (given, taken))| within(Step::Index(i), given, taken))
        }
        _ => None,
    }
}

/// One step of the path to a value in the file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// A key of a table.
    Key(Cow<'static, str>),
    /// An index in an array, from 0.
    Index(usize),
}

/// A problem with a value of the document.
#[derive(Clone, Debug)]
pub struct Problem {
    /// Path to the value in the file.
    pub path: Vec<Step>,
    /// What is wrong and how to fix it.
    pub what: String,
    /// Whether `what` is a complete sentence that names the value. If so, the path is not shown.
    is_sentence: bool,
}

impl fmt::Display for Problem {
    /// One line, such as `camera 3, pitch_deg: is 95, must lie in -90..=90`. Entries of lists are counted from 1.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.is_sentence {
            return f.write_str(&one_line(&self.what));
        }
        let mut text = String::new();
        for step in &self.path {
            match step {
                Step::Key(key) if text.is_empty() => text.push_str(key),
                Step::Key(key) => text.extend([", ", key]),
                Step::Index(index) => text.push_str(&format!(" {}", index + 1)),
            }
        }
        if !text.is_empty() {
            text.push_str(": ");
        }
        f.write_str(&one_line(&(text + &self.what)))
    }
}

/// The result of a check.
pub type Checked = Result<(), Problem>;

/// The place of a value in a document, as a path of keys and indices. Checks extend the path as they descend into the document.
#[derive(Clone, Debug, Default)]
pub struct At(Vec<Step>);

impl At {
    /// The top level of the document.
    pub fn top() -> At {
        At::default()
    }

    /// The place of the value of `key`, in the table at this place.
    pub fn key(&self, key: impl Into<Cow<'static, str>>) -> At {
        let mut path = self.0.clone();
        path.push(Step::Key(key.into()));
        At(path)
    }

    /// The place of an entry of the array at this place; `index` counts from 0.
    pub fn index(&self, index: usize) -> At {
        let mut path = self.0.clone();
        path.push(Step::Index(index));
        At(path)
    }

    /// A problem with the value at this place. `what` says what is wrong and how to fix it.
    pub fn problem(&self, what: impl Into<String>) -> Problem {
        Problem { path: self.0.clone(), what: what.into(), is_sentence: false }
    }

    /// A problem with the value at this place. `what` is a complete sentence that names the value.
    pub fn sentence(&self, what: String) -> Problem {
        Problem { path: self.0.clone(), what, is_sentence: true }
    }

    /// Refuses the value at this place.
    ///
    /// # Errors
    /// Always returns the problem that [`At::problem`] makes.
    pub fn fail(&self, what: impl Into<String>) -> Checked {
        Err(self.problem(what))
    }

    /// Checks that a number lies in `low..=high`.
    ///
    /// # Errors
    /// The value is not in `low..=high`, or it is NaN.
    pub fn within(&self, value: f64, low: f64, high: f64) -> Checked {
        if (low..=high).contains(&value) { Ok(()) } else { self.fail(format!("is {value}, must lie in {low}..={high}")) }
    }

    /// Checks that a number is positive and at most `high`.
    ///
    /// # Errors
    /// The value is not above 0, or it is above `high`, or it is NaN.
    pub fn positive(&self, value: f64, high: f64) -> Checked {
        if value > 0.0 && value <= high { Ok(()) } else { self.fail(format!("is {value}, must be above 0 and at most {high}")) }
    }

    /// Checks that all numbers lie in `low..=high`.
    ///
    /// # Errors
    /// [`At::within`] refuses one of the values.
    pub fn all_within(&self, values: &[f64], low: f64, high: f64) -> Checked {
        values.iter().try_for_each(|&value| self.within(value, low, high))
    }

    /// Checks a band `[from, to]`: both ends lie in `low..=high`, and `from` is at most `to`. `None` is accepted.
    ///
    /// # Errors
    /// An end is outside the limits, or `from` is above `to`.
    pub fn band(&self, band: Option<[f64; 2]>, low: f64, high: f64) -> Checked {
        let Some([from, to]) = band else { return Ok(()) };
        self.all_within(&[from, to], low, high)?;
        if from <= to { Ok(()) } else { self.fail(format!("[{from}, {to}] is reversed: write [{to}, {from}]")) }
    }

    /// Checks a name that is shown in tables and on terminals.
    ///
    /// # Errors
    /// The name is empty or consists of white space, has more than 100 characters, or contains a control character.
    pub fn name(&self, name: &str) -> Checked {
        if name.trim().is_empty() {
            return self.fail("is empty: give a name");
        }
        if name.chars().count() > 100 || name.chars().any(char::is_control) {
            return self.fail("must be at most 100 characters on one line");
        }
        Ok(())
    }

    /// Checks a name that becomes part of a file name.
    ///
    /// # Errors
    /// [`At::name`] refuses the text, or the text contains characters other than letters, digits, - and _.
    pub fn file_stem(&self, text: &str) -> Checked {
        self.name(text)?;
        let plain = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
        if text.chars().all(plain) { Ok(()) } else { self.fail(format!("`{text}` may contain only letters, digits, - and _")) }
    }

    /// Checks the names of the tables in the array at this place.
    ///
    /// # Errors
    /// A name is used twice.
    pub fn unique_names<'a>(&self, names: impl Iterator<Item = &'a str>) -> Checked {
        let mut seen = HashMap::new();
        for (i, name) in names.enumerate() {
            if let Some(before) = seen.insert(name, i) {
                return self.index(i).key("name").fail(format!("`{name}` is already the name of entry {}: names must differ", before + 1));
            }
        }
        Ok(())
    }
}

/// Line (from 1) and one-line description of an error of the TOML reader.
fn explain(text: &str, error: &toml::de::Error, remedy_of_missing: fn(&str) -> &'static str) -> (Option<usize>, String) {
    let message = one_line(error.message());
    let span = error.span();
    let line = |at: &Range<usize>| line_at(text, at.start);
    let Some(rest) = message.strip_prefix("unknown field `") else {
        let what = match message.strip_prefix("missing field `").and_then(|rest| rest.strip_suffix('`')) {
            Some(key) => format!("the key `{key}` is missing{}", remedy_of_missing(key)),
            None => match span.as_ref().and_then(|span| find_value(text, &message, span)) {
                Some((key, at)) => return (Some(line(&at)), format!("{key}: {message}")),
                // The error of the reader has a message and a position, but no key, so the key is found from the position.
                None => match span.as_ref().and_then(|span| key_of_value(text, span)) {
                    Some(key) if !message.contains(&format!("`{key}`")) => format!("{key}: {message}"),
                    _ => message,
                },
            },
        };
        return (span.as_ref().map(line), what);
    };
    let (key, expected) = rest.split_once('`').unwrap_or((rest, ""));
    // If the text "expected one of `a`, `b`" is split at the backticks, the names are the parts with odd indices.
    let known: Vec<&str> = expected.split('`').skip(1).step_by(2).collect();
    let hint = nearest(key, &known).map_or_else(
        || {
            let mut known = known.clone();
            known.sort_unstable();
            format!("known here: {}", known.join(", "))
        },
        |near| format!("did you mean `{near}`?"),
    );
    // In an internally tagged enumeration, the reader's span covers the whole table, so the key is searched inside the span.
    let at = find_key(text, key, span.as_ref()).or(span);
    (at.as_ref().map(line), format!("unknown key `{key}`: {hint}"))
}

/// A key, and the positions of the key and its value in the text.
struct Entry {
    key: String,
    key_at: Range<usize>,
    value_at: Range<usize>,
}

/// The innermost key whose value contains the first byte of `span`.
fn key_of_value(text: &str, span: &Range<usize>) -> Option<String> {
    let holding = entries(text).into_iter().filter(|entry| entry.value_at.contains(&span.start));
    holding.min_by_key(|entry| entry.value_at.len()).map(|entry| entry.key)
}

/// Every key of the text, from top to bottom; empty if the text is not TOML.
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

/// Position of a key with this name: the first one inside `within` or, if there is none, the first in the text.
fn find_key(text: &str, key: &str, within: Option<&Range<usize>>) -> Option<Range<usize>> {
    let mut entries = entries(text);
    entries.retain(|entry| entry.key == key);
    let inside = |entry: &&Entry| within.is_none_or(|outer| holds(outer, &entry.key_at));
    entries.iter().find(inside).or(entries.first()).map(|entry| entry.key_at.clone())
}

/// Finds the value that caused the reader's error. This is the value at `span` or, if the span covers a whole table, the value that the message
/// quotes. Returns the key of this value, and the position of the key; `None` if no value is found. The function examines only messages that begin
/// with `invalid` and quote something.
fn find_value(text: &str, message: &str, span: &Range<usize>) -> Option<(String, Range<usize>)> {
    if !message.starts_with("invalid ") {
        return None;
    }
    let entries = entries(text);
    let quoted = message.split(['`', '"']).nth(1)?;
    let written = |entry: &&Entry| text.get(entry.value_at.clone()).is_some_and(|value| value.trim_matches('"') == quoted);
    // The last entry that contains the span is the innermost one.
    let exact = entries.iter().rev().find(|entry| holds(&entry.value_at, span) && !text[entry.value_at.clone()].starts_with('['));
    let found = exact.or_else(|| entries.iter().filter(|entry| entry.key_at.start >= span.start).find(written))?;
    Some((found.key.clone(), found.key_at.clone()))
}

impl Problem {
    /// Returns the problem with the line of the value in `text`, the document. If the document omits the value because it has a default, `text`
    /// contains only the first steps of the path. The line is then that of the last step that `text` contains.
    pub fn wrong(&self, text: &str) -> Wrong {
        Wrong { line: line_of_problem(text, self), what: self.to_string() }
    }
}

fn line_of_problem(text: &str, problem: &Problem) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let mut table: Option<&DeTable<'_>> = Some(document.get_ref());
    let mut value: Option<&Spanned<DeValue<'_>>> = None;
    let mut at = None;
    for step in &problem.path {
        value = match step {
            Step::Key(name) => {
                let Some((key, next)) = table.and_then(|t| t.iter().find(|(key, _)| key.get_ref().as_ref() == name.as_ref())) else {
                    break;
                };
                at = Some(key.span().start);
                Some(next)
            }
            Step::Index(index) => {
                let Some(next) = value.and_then(|v| v.get_ref().as_array()).and_then(|a| a.get(*index)) else {
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

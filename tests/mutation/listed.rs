//! Mutants of Rust, as `cargo mutants --list --json` lists them. A mutant is the text of a source file with one small fault.

use std::ops::Range;

use anyhow::{Context as _, Result};
use serde::Deserialize;

/// A position in a file. Lines and columns are counted from 1, columns in characters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
struct Position {
    line: usize,
    column: usize,
}

/// A part of a file, without the character at `end`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
struct Span {
    start: Position,
    end: Position,
}

/// A mutant in the list of cargo-mutants.
#[derive(Clone, Debug, PartialEq, Eq, Deserialize)]
pub(crate) struct Listed {
    /// File, position and change, such as `kernels/src/shared/hash.rs:14:25: replace >> with << in pcg`.
    name: String,
    /// Path from the root of the project.
    pub(crate) file: String,
    span: Span,
    replacement: String,
    /// The kind of mutant, such as `BinaryOperator`.
    pub(crate) genre: String,
    /// Number of this mutant among the mutants of its line that have the same description, counted from 1; 0 = no other mutant has the description.
    #[serde(skip)]
    occurrence: usize,
}

/// Reads a list of mutants.
///
/// # Errors
/// If the text is not a list of mutants.
pub(crate) fn listed(json: &str) -> Result<Vec<Listed>> {
    let mut all: Vec<Listed> = serde_json::from_str(json).context("`cargo mutants --list --json` wrote no list of mutants")?;
    let described: Vec<(String, usize, String)> = all.iter().map(|m| (m.file.clone(), m.line(), m.any_occurrence())).collect();
    for (i, mutant) in all.iter_mut().enumerate() {
        if described.iter().filter(|other| **other == described[i]).count() > 1 {
            mutant.occurrence = 1 + described[..i].iter().filter(|other| **other == described[i]).count();
        }
    }
    Ok(all)
}

impl Listed {
    /// Number of the line in which the changed part begins, counted from 1.
    pub(crate) fn line(&self) -> usize {
        self.span.start.line
    }

    /// Describes the change in one line, in the words of cargo-mutants. If several changes in the line have the same description, the number of the
    /// occurrence follows.
    pub(crate) fn change(&self) -> String {
        let change = self.any_occurrence();
        if self.occurrence == 0 { change } else { format!("{change}, occurrence {}", self.occurrence) }
    }

    /// Describes the change without the number of the occurrence.
    pub(crate) fn any_occurrence(&self) -> String {
        let Position { line, column } = self.span.start;
        let change = self.name.strip_prefix(&format!("{}:{line}:{column}: ", self.file)).unwrap_or(&self.name);
        change.split_whitespace().collect::<Vec<_>>().join(" ")
    }

    /// Returns the text of the file with the fault.
    ///
    /// # Errors
    /// If the text does not have the changed part, or the change changes nothing: the list then belongs to another text.
    pub(crate) fn apply(&self, text: &str) -> Result<String> {
        let range = range(text, self.span).with_context(|| format!("{} is not a part of the text", self.name))?;
        anyhow::ensure!(text[range.clone()] != self.replacement, "{} changes nothing", self.name);
        Ok(format!("{}{}{}", &text[..range.start], self.replacement, &text[range.end..]))
    }
}

/// Returns the range of bytes of a span; `None` if the span exceeds the text.
fn range(text: &str, span: Span) -> Option<Range<usize>> {
    let [start, end] = [span.start, span.end].map(|position| offset(text, position));
    let range = start?..end?;
    (range.start <= range.end).then_some(range)
}

fn offset(text: &str, position: Position) -> Option<usize> {
    let above = position.line.checked_sub(1)?;
    let mut lines = text.split_inclusive('\n');
    let before: usize = lines.by_ref().take(above).map(str::len).sum();
    let line = lines.next()?;
    let mut columns = line.char_indices().map(|(at, _)| at).chain([line.len()]);
    Some(before + columns.nth(position.column.checked_sub(1)?)?)
}

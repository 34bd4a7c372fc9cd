//! Titled lists of numbers, for display.

/// A titled list of numbers about the last frame, for display.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// The title.
    pub name: &'static str,
    /// What the numbers describe, in one sentence.
    pub about: &'static str,
    /// Names and values. A row with an indented name gives a detail of the nearest row above whose name is not indented.
    pub rows: Vec<(String, String)>,
}

/// A row of a [`Section`].
pub fn row(name: &str, value: impl ToString) -> (String, String) {
    (name.to_owned(), value.to_string())
}

/// A number of bytes as text, in MiB.
pub fn mebibytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

//! Numbers for people to read.

/// Numbers of the last frame for people to read.
#[derive(Clone, Debug, PartialEq)]
pub struct Section {
    /// Its title.
    pub name: &'static str,
    /// What the numbers are of, one sentence.
    pub about: &'static str,
    /// Names and values. A name that is indented belongs to the row above.
    pub rows: Vec<(String, String)>,
}

/// A row of a [`Section`].
pub fn row(name: &str, value: impl ToString) -> (String, String) {
    (name.to_owned(), value.to_string())
}

/// A number of bytes for people: MiB.
pub fn mebibytes(bytes: u64) -> String {
    format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20))
}

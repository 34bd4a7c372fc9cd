//! The results of `make mutants` and `make mutants-rust`: a table with one row per mutant. If a call is interrupted, the next call continues its
//! table.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::Path;

use anyhow::{Context as _, Result};
use kernels::base::error::Error;
use kernels::base::files::write_whole;
use serde::{Deserialize, Serialize};

/// The outcome of testing a mutant.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Outcome {
    Killed,
    /// Killed by the time limit.
    Hung,
    Survived,
    Equivalent,
    NotCompiled,
}

/// A row of the results.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Row {
    pub(crate) file: String,
    pub(crate) line: usize,
    pub(crate) operator: String,
    pub(crate) change: String,
    pub(crate) outcome: Outcome,
    /// What decided the outcome: the test that failed, the time limit, or the reason why the mutant is equivalent.
    pub(crate) by: String,
    pub(crate) seconds: f64,
    /// Hash of the mutated text, by which a later call recognises the mutant.
    pub(crate) text: String,
}

/// A table to which rows are added one by one. Each row is on the disk before the next mutant is tested.
pub(crate) struct Table(csv::Writer<File>);

impl Table {
    /// Opens a table, and makes it if it does not exist. Also returns the rows that it has. An interrupted call may have left an empty file, a part
    /// of the header or a part of the last row. This function removes such a part. The mutant of a removed row is tested again.
    ///
    /// # Errors
    /// If the file cannot be read or written, or if a complete row is damaged.
    pub(crate) fn open(file: &Path) -> Result<(Table, Vec<Row>)> {
        let place = || file.display().to_string();
        let mut bytes = if file.exists() { fs::read(file).with_context(|| format!("cannot read {}", place()))? } else { Vec::new() };
        let whole = bytes.iter().rposition(|&byte| byte == b'\n').map_or(0, |end| end + 1);
        if whole < bytes.len() {
            bytes.truncate(whole);
            fs::write(file, &bytes).with_context(|| format!("cannot write {}", place()))?;
        }
        let rows: Result<Vec<Row>, _> = csv::Reader::from_reader(bytes.as_slice()).deserialize().collect();
        let rows = rows.with_context(|| format!("{} is damaged: remove it", place()))?;
        let to = OpenOptions::new().create(true).append(true).open(file).with_context(|| format!("cannot write {}", place()))?;
        Ok((Table(csv::WriterBuilder::new().has_headers(bytes.is_empty()).from_writer(to)), rows))
    }

    /// Adds a row, and writes it to the disk.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub(crate) fn add(&mut self, row: &Row) -> Result<()> {
        self.0.serialize(row)?;
        self.0.flush()?;
        Ok(())
    }
}

fn count(rows: &[Row], outcome: Outcome) -> usize {
    rows.iter().filter(|row| row.outcome == outcome).count()
}

/// Returns the number of mutants for each outcome: killed by tests, killed by the time limit, survived, equivalent, not compiled.
fn counts(rows: &[Row]) -> [usize; 5] {
    [Outcome::Killed, Outcome::Hung, Outcome::Survived, Outcome::Equivalent, Outcome::NotCompiled].map(|outcome| count(rows, outcome))
}

/// Returns the killed mutants as a percentage of the killed and the surviving mutants.
fn rate(rows: &[Row]) -> f64 {
    let [killed, hung, survived, ..] = counts(rows);
    100.0 * (killed + hung) as f64 / (killed + hung + survived).max(1) as f64
}

/// Returns a line with the counts of a table, and a line for each mutant that survived. `name`: the stage, or the files that were changed.
pub(crate) fn summary(name: &str, rows: &[Row], seconds: f64) -> String {
    let [killed, hung, survived, equivalent, failed] = counts(rows);
    let mut text = format!(
        "{name}: {:.1} % killed; {killed} by tests, {hung} by the time limit, {survived} survived, {equivalent} equivalent; {failed} did not compile; {seconds:.0} s\n",
        rate(rows)
    );
    for row in rows.iter().filter(|row| row.outcome == Outcome::Survived) {
        text += &format!("  {}:{} {} ({})\n", row.file, row.line, row.change, row.operator);
    }
    text
}

/// Writes the table `NAME.csv` to a folder. Adds a row with its counts to `strength.csv`, or replaces the earlier row of this name.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn record(folder: &Path, name: &str, date: &str, seed: u32, rows: &[Row]) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    let mut csv = csv::Writer::from_path(folder.join(format!("{name}.csv")))?;
    csv.write_record(["file", "line", "operator", "change", "outcome", "by"])?;
    for row in rows {
        let outcome = serde_json::to_value(row.outcome)?;
        csv.write_record([&row.file, &row.line.to_string(), &row.operator, &row.change, outcome.as_str().unwrap_or_default(), &row.by])?;
    }
    csv.flush()?;
    let file = folder.join("strength.csv");
    let head = "stage,date,seed,mutants,killed,hung,survived,equivalent,not_compiled,rate_percent";
    let old = fs::read_to_string(&file).unwrap_or_default();
    let mut lines: Vec<String> = old.lines().skip(1).filter(|line| line.split(',').next() != Some(name)).map(str::to_owned).collect();
    let counts = counts(rows);
    let sampled: usize = counts[..4].iter().sum();
    let counts = counts.map(|count| count.to_string()).join(",");
    lines.push(format!("{name},{date},{seed},{sampled},{counts},{:.1}", rate(rows)));
    lines.sort();
    let text = std::iter::once(head.to_owned()).chain(lines).map(|line| line + "\n").collect::<String>();
    write_whole(&file, |temporary| {
        File::create(temporary)
            .and_then(|mut file| file.write_all(text.as_bytes()))
            .map_err(|source| Error::File { file: temporary.to_owned(), source })
    })?;
    Ok(())
}

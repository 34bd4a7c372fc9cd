//! Reports of experiment runs, and of the stability lab ([`stability`]). The numbers in the report of a run are values of its rows, or are computed
//! from them.
//!
//! In the reports, a *choice* is one combination of view, variant, estimator, noise, temporal resolve and value of the varied parameter.
//!
//! Suggested reading order: [`summary`] (converts the rows of a run to one summary for each choice), [`numbers`] (comparisons that account for
//! chance, and the Pareto front), [`verdict`] (the answer to the question of the run), [`columns`] (the columns of the tables), [`run`] (the HTML
//! page), [`markdown`] (the short text for a pull request).

mod checks;
mod columns;
#[cfg(test)]
mod fake;
mod html;
mod load;
mod markdown;
mod numbers;
mod pictures;
#[cfg(test)]
mod planted;
mod plots;
mod run;
pub(crate) mod stability;
mod summary;
mod tested;
#[cfg(test)]
mod tests;
mod verdict;

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use crate::definition::Definition;
use crate::row::Row;
use crate::store::{REPORT_PAGE, REPORT_TEXT, write_with};

pub(crate) use crate::expectations::Verdict;
pub(crate) use load::{judge, of, read_run};

/// Everything that a report needs.
#[derive(Clone, Debug)]
pub(crate) struct RunData {
    /// The definition that was run.
    pub(crate) definition: Definition,
    /// The run's manifest. Reports use its entries `command`, `version`, `commit`, `adapter`, `driver`, `software` (true or false),
    /// `definition_hash`, `shard` and `without_anisotropy`.
    pub(crate) manifest: serde_json::Value,
    /// The rows of all metrics except device times.
    pub(crate) rows: Vec<Row>,
    /// The rows of device times and their ratios. Their metrics have names of the form `gpu_ms:PASS` and `gpu_ratio:PASS`.
    pub(crate) times: Vec<Row>,
    /// The run's folder, or the folder that holds the folders of its shards. The report is written into it.
    pub(crate) folder: PathBuf,
    /// Descriptions of the parts and files that the run still lacks, one in each entry.
    pub(crate) missing: Vec<String>,
    /// The folders that contain the files of the run: the folder of the run, or the folders of its shards.
    pub(crate) folders: Vec<PathBuf>,
}

impl RunData {
    /// Returns an entry of the manifest as text; `None` if it was not recorded.
    fn recorded(&self, key: &str) -> Option<String> {
        match self.manifest.get(key)? {
            serde_json::Value::Null => None,
            serde_json::Value::String(text) => (!text.is_empty()).then(|| text.clone()),
            other => Some(other.to_string()),
        }
    }

    /// Whether a software adapter was used; only ratios of times are then meaningful.
    fn is_software(&self) -> bool {
        self.manifest.get("software").and_then(serde_json::Value::as_bool).unwrap_or(false)
    }
}

/// The result of writing a report.
#[derive(Clone, Debug)]
pub(crate) struct Written {
    /// Path of the HTML page.
    pub(crate) page: PathBuf,
    /// The answer to the run's question: one sentence, and a line with details for each of at most three views.
    pub(crate) verdict: String,
}

/// Writes `report.html` and `report.md` into the run's folder.
///
/// # Errors
/// There is no row of a metric, a plot cannot be drawn, or a file cannot be written.
pub(crate) fn write_run(run: &RunData, verdicts: &[Verdict]) -> Result<Written> {
    ensure!(!run.rows.is_empty(), "{} has no metrics yet: finish the run with --resume", run.folder.display());
    let table = summary::Table::of(run);
    let answer = verdict::verdict(&table);
    let page = run::page(run, &table, verdicts, &answer)?;
    write_bytes(&run.folder, REPORT_PAGE, page.as_bytes())?;
    write_bytes(&run.folder, REPORT_TEXT, markdown::text(run, &table, verdicts, &answer).as_bytes())?;
    Ok(Written { page: run.folder.join(REPORT_PAGE), verdict: answer })
}

fn write_bytes(out_dir: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    write_with(&out_dir.join(name), |output| output.write_all(bytes))
}

//! Reads a run's folder, or its shards together, for its report.

use std::path::Path;

use anyhow::{Context, Result};

use super::{RunData, Verdict};
use crate::{expectations, store};

/// Everything a report is made from.
///
/// # Errors
/// No run is there, a file of it is damaged, or its shards do not belong together.
pub(crate) fn read_run(folder: &Path) -> Result<RunData> {
    of(store::read_run(folder)?)
}

/// The same of a run that was read already.
///
/// # Errors
/// When the manifest cannot be put into JSON.
pub(crate) fn of(run: store::RunData) -> Result<RunData> {
    Ok(RunData {
        definition: run.definition,
        manifest: serde_json::to_value(&run.manifest).context("the manifest cannot be put into JSON")?,
        rows: run.rows,
        times: run.times,
        missing: run.missing,
        folder: run.folder,
        folders: run.folders,
    })
}

/// What became of the run's expectations.
pub(crate) fn judge(run: &RunData) -> Vec<Verdict> {
    expectations::evaluate(&run.definition, &run.rows, &run.times)
}

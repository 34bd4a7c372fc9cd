//! Reads the data of a report from the folder of a run, or from the folders of its shards.

use std::path::Path;

use anyhow::{Context, Result};

use super::{RunData, Verdict};
use crate::{expectations, store};

/// Reads everything that a report needs.
///
/// # Errors
/// The folder contains no run, one of its files cannot be read or is damaged, or its shards do not belong together.
pub(crate) fn read_run(folder: &Path) -> Result<RunData> {
    of(store::read_run(folder)?)
}

/// Converts a run that [`store`] has read to the data of a report.
///
/// # Errors
/// The manifest cannot be written as JSON.
pub(crate) fn of(run: store::RunData) -> Result<RunData> {
    Ok(RunData {
        definition: run.definition,
        manifest: serde_json::to_value(&run.manifest).context("cannot convert the manifest to JSON")?,
        rows: run.rows,
        times: run.times,
        missing: run.missing,
        folder: run.folder,
        folders: run.folders,
    })
}

/// Compares the measured values with the expectations of the run's definition.
pub(crate) fn judge(run: &RunData) -> Vec<Verdict> {
    expectations::evaluate(&run.definition, &run.rows, &run.times)
}

//! Reads a run's folder for its report.
//!
//! SWAP: stands in until the store's `read_run` and the definition's own judging of expectations are here; only this file changes then.

use std::path::Path;

use anyhow::{Context, Result, bail};

use super::{RunData, Verdict};
use crate::definition::Definition;
use crate::row::Row;

/// Reads `definition.toml`, `manifest.json`, `metrics.csv` and `times.csv` of a run.
///
/// # Errors
/// No such folder, no metrics in it, or a damaged file.
pub(crate) fn read_run(folder: &Path) -> Result<RunData> {
    if !folder.is_dir() {
        bail!("there is no folder {}: give the folder that a run was written to", folder.display());
    }
    let metrics = folder.join("metrics.csv");
    if !metrics.is_file() {
        bail!("{} holds no metrics.csv: give the folder that a run was written to", folder.display());
    }
    let times = folder.join("times.csv");
    let text = |name: &str| {
        let file = folder.join(name);
        std::fs::read_to_string(&file).with_context(|| format!("cannot read {}: run again to write it anew", file.display()))
    };
    let damaged = |name: &str| format!("{} is damaged: run again to write it anew", folder.join(name).display());
    let mut definition: Definition = toml::from_str(&text("definition.toml")?).with_context(|| damaged("definition.toml"))?;
    folder.clone_into(&mut definition.folder);
    let run = RunData {
        definition,
        manifest: serde_json::from_str(&text("manifest.json")?).with_context(|| damaged("manifest.json"))?,
        rows: read_rows(&metrics)?,
        times: if times.is_file() { read_rows(&times)? } else { Vec::new() },
        folder: folder.to_owned(),
    };
    if run.rows.is_empty() {
        bail!("{} holds no row: finish the run, with --resume", metrics.display());
    }
    Ok(run)
}

fn read_rows(file: &Path) -> Result<Vec<Row>> {
    let mut reader = csv::Reader::from_path(file).with_context(|| format!("cannot read {}", file.display()))?;
    reader
        .deserialize()
        .collect::<Result<_, csv::Error>>()
        .with_context(|| format!("{} is damaged: run again to write it anew", file.display()))
}

/// What became of the run's expectations.
pub(crate) fn judge(_run: &RunData) -> Vec<Verdict> {
    Vec::new()
}

//! The description that a run stores of itself: `manifest.json`.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow};
use kernels::base::error::one_line;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use crate::definition::{self, Definition};
use crate::unit::Shard;

/// Name of the file.
pub(super) const FILE: &str = "manifest.json";

/// Version of the layout of a run's folder. Folders of other versions are refused.
const FORMAT: u32 = 1;

/// Where the numbers of a run come from: everything except its definition.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Provenance {
    /// Name of the graphics adapter.
    pub adapter: String,
    /// Driver of the adapter, with version.
    pub driver: String,
    /// Whether the adapter renders on the CPU. Only ratios of its times are then meaningful.
    pub software: bool,
    /// The reason why scenes were drawn without anisotropic filtering; `None` = anisotropic filtering was used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub without_anisotropy: Option<String>,
    /// The command line.
    pub command: String,
}

/// A run's description of itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the layout of the run's folder.
    pub format: u32,
    /// Version of the tables' columns.
    pub schema: String,
    /// Name of the definition.
    pub experiment: String,
    /// The definition that was run, as TOML.
    pub definition: String,
    /// xxHash64 of the text in `definition`.
    pub definition_hash: String,
    /// xxHash64 of the scene's text, or of the imported heightmap.
    pub source_hash: String,
    /// Whether the run was made by `check`, with the changes of the definition's section `small`.
    pub small: bool,
    /// The shard, such as `2/4`; absent = the whole run.
    pub shard: Option<String>,
    /// A sentence that says which numbers are random and how random numbers are generated.
    pub seed: String,
    /// Version of the program.
    pub version: String,
    /// Commit from which the program was built; absent if `SCREE_COMMIT` was not set when it was compiled.
    pub commit: Option<String>,
    /// Where the numbers come from.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// Whether all parts are finished and joined.
    pub complete: bool,
}

impl Manifest {
    /// Returns the manifest of a new run. If the run is small, `definition` already contains the changes of `small`.
    pub(super) fn new(definition: &Definition, small: bool, shard: Option<Shard>, provenance: &Provenance) -> Result<Manifest> {
        let text = definition.to_toml()?;
        Ok(Manifest {
            format: FORMAT,
            schema: super::table::SCHEMA.to_owned(),
            experiment: definition.name.clone(),
            definition_hash: definition::hash(text.as_bytes()),
            definition: text,
            source_hash: definition.source_hash()?,
            small,
            shard: shard.map(|shard| shard.to_string()),
            seed: format!(
                "frames count from 0; bias and variance are over the seeds 0 to {}, everything else has seed 0; every random number is an integer hash \
                 of place or pixel, frame and seed",
                definition.seeds.max(1) - 1
            ),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: option_env!("SCREE_COMMIT").filter(|commit| !commit.is_empty()).map(str::to_owned),
            provenance: provenance.clone(),
            complete: false,
        })
    }

    pub(super) fn read(folder: &Path) -> Result<Manifest> {
        let file = folder.join(FILE);
        let text = fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
        Manifest::parse(&text, &file)
    }

    /// Parses the text of a manifest. `file` is the name of the file in error messages.
    ///
    /// # Errors
    /// One line: the text is not JSON, has a different version, lacks a key, or has a value of the wrong type.
    pub fn parse(text: &str, file: &Path) -> Result<Manifest> {
        let broken = |what: String| {
            let what = one_line(&what);
            anyhow!(
                "{}: {what}: the manifest is damaged or was written by a different version: remove the folder, or choose a different one with --out",
                file.display()
            )
        };
        let format = serde_json::from_str::<serde_json::Value>(text).map_err(|error| broken(error.to_string()))?;
        let format = format.get("format").and_then(serde_json::Value::as_u64).unwrap_or(0);
        if format != u64::from(FORMAT) {
            return Err(broken(format!("format {format} is not {FORMAT}, the one that this version reads")));
        }
        serde_json::from_str(text).map_err(|error| broken(error.to_string()))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        super::table::write_with(&folder.join(FILE), |output| {
            serde_json::to_writer_pretty(&mut *output, self)?;
            output.write_all(b"\n")
        })
    }

    /// Compares this existing run with the requested run `other`. Returns a description of the first difference that would make their numbers
    /// incomparable; `None` if there is none.
    pub(super) fn difference(&self, other: &Manifest) -> Result<Option<String>> {
        let differs = |what: &str, there: &dyn std::fmt::Display, here: &dyn std::fmt::Display| {
            Some(format!("{what} is {} there and {} here", short(&there.to_string()), short(&here.to_string())))
        };
        let shard = |manifest: &Manifest| manifest.shard.clone().unwrap_or_else(|| "the whole run".to_owned());
        let size = |manifest: &Manifest| if manifest.small { "the small one, made by `check`" } else { "the full one, made by `run`" };
        let pairs = [
            ("the experiment", self.experiment.clone(), other.experiment.clone()),
            ("the run", size(self).to_owned(), size(other).to_owned()),
            ("the shard", shard(self), shard(other)),
        ];
        let machines = [
            ("the scene's content (its hash)", self.source_hash.clone(), other.source_hash.clone()),
            ("the adapter", self.provenance.adapter.clone(), other.provenance.adapter.clone()),
            ("the driver", self.provenance.driver.clone(), other.provenance.driver.clone()),
            ("the program's version", self.version.clone(), other.version.clone()),
            (
                "the program's commit",
                self.commit.clone().unwrap_or_else(|| "unknown".to_owned()),
                other.commit.clone().unwrap_or_else(|| "unknown".to_owned()),
            ),
        ];
        for (what, there, here) in &pairs {
            if there != here {
                return Ok(differs(what, there, here));
            }
        }
        if let Some((key, there, here)) = first_difference(&definition::stored(&self.definition)?, &definition::stored(&other.definition)?)?
        {
            return Ok(differs(&format!("`{key}`"), &there, &here));
        }
        Ok(machines.iter().find(|(_, there, here)| there != here).and_then(|(what, there, here)| differs(what, there, here)))
    }
}

/// Returns the first key that affects the measured numbers and differs between two definitions, with its two values.
fn first_difference(a: &Definition, b: &Definition) -> Result<Option<(String, String, String)>> {
    let table = |definition: &Definition| Table::try_from(definition.measured());
    let (a, b) = (table(a)?, table(b)?);
    let text = |value: Option<&Value>| value.map_or_else(|| "absent".to_owned(), ToString::to_string);
    let key = a.keys().chain(b.keys()).find(|key| a.get(*key) != b.get(*key));
    Ok(key.map(|key| (key.clone(), text(a.get(key)), text(b.get(key)))))
}

/// Returns a text on one line. It is cut after 57 characters if it is longer than 60 characters.
fn short(text: &str) -> String {
    let text = one_line(text);
    if text.chars().count() <= 60 { text } else { text.chars().take(57).chain("...".chars()).collect() }
}

//! The file `manifest.json`, in which a run stores its own description.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use kernels::base::error::one_line;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};
use twox_hash::XxHash64;

use super::table::{SCHEMA, other_schema};
use crate::definition::{self, Definition};
use crate::unit::Shard;

/// Name of the file.
pub(super) const FILE: &str = "manifest.json";

/// Version of the layout of a run's folder. Folders of other versions are refused.
const FORMAT: u32 = 1;

/// Key of the checksum of the file. It is not a field of [`Manifest`].
const CHECKSUM: &str = "checksum";

/// The provenance of a run's numbers: adapter, driver and command line.
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

/// The description of a run.
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
    /// xxHash64 of the scene's text, or of the imported heightmap, and of the files that the scene or the import reads.
    pub source_hash: String,
    /// Whether the run was made by `check`, with the changes of the definition's section `small`.
    pub small: bool,
    /// The shard, such as `2/4`; absent = the whole run.
    pub shard: Option<String>,
    /// A sentence that says which seeds are used and how random numbers are generated.
    pub seed: String,
    /// Version of the program.
    pub version: String,
    /// Commit from which the program was built; absent if `SCREE_COMMIT` was not set when it was compiled.
    pub commit: Option<String>,
    /// Adapter, driver and command line.
    #[serde(flatten)]
    pub provenance: Provenance,
    /// Whether all parts are finished and joined.
    pub complete: bool,
    /// xxHash64 of what identifies the run or shard: the experiment, the shard, `small`, the keys of the definition that affect the numbers, the
    /// source of the scene, the adapter, the driver, and the version and commit of the program. Every part stores this hash, so that a part of
    /// another run is recognised. Empty in manifests of older versions.
    #[serde(default)]
    pub identity: String,
    /// Hashes (xxHash64) by file name or folder name: of each table of a finished run, and of the folder of the imported scene. Empty in manifests of
    /// older versions.
    #[serde(default)]
    pub files: BTreeMap<String, String>,
}

/// A manifest in the form in which it is stored.
#[derive(Serialize)]
struct Stored<'a> {
    #[serde(flatten)]
    manifest: &'a Manifest,
    checksum: String,
}

/// The entries of a stored manifest.
type Entries = serde_json::Map<String, serde_json::Value>;

/// Returns the xxHash64 of all entries of a manifest except its checksum. The order of the entries has no effect.
fn checksum(entries: &Entries) -> Result<String> {
    let sorted: BTreeMap<&String, &serde_json::Value> = entries.iter().filter(|(key, _)| *key != CHECKSUM).collect();
    Ok(definition::hash(&serde_json::to_vec(&sorted)?))
}

/// Returns the xxHash64 of the bytes of a file.
pub(super) fn hash_of(file: &Path) -> Result<String> {
    let mut hasher = XxHash64::with_seed(0);
    definition::add_bytes(&mut hasher, file)?;
    Ok(definition::digits(&hasher))
}

impl Manifest {
    /// Returns the manifest of a new run. If `small` is true, `definition` already contains the changes of its section `small`.
    pub(super) fn new(definition: &Definition, small: bool, shard: Option<Shard>, provenance: &Provenance) -> Result<Manifest> {
        let text = definition.to_toml()?;
        let mut manifest = Manifest {
            format: FORMAT,
            schema: SCHEMA.to_owned(),
            experiment: definition.name.clone(),
            definition_hash: definition::hash(text.as_bytes()),
            definition: text,
            source_hash: definition.source_hash()?,
            small,
            shard: shard.map(|shard| shard.to_string()),
            seed: format!(
                "frames are numbered from 0; bias and variance are measured over {} consecutive seeds from the seed of the frame on, everything else with \
                 the seed of the frame, which is `frame.seed` of the definition (0 if it sets none), plus the number of the frame if it sets \
                 `frame.reseeds`; every random number is a function of the position or the pixel, the frame and the seed",
                definition.seeds.max(1)
            ),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            commit: option_env!("SCREE_COMMIT").filter(|commit| !commit.is_empty()).map(str::to_owned),
            provenance: provenance.clone(),
            complete: false,
            identity: String::new(),
            files: BTreeMap::new(),
        };
        let Manifest { experiment, source_hash, small, shard, version, commit, provenance: Provenance { adapter, driver, .. }, .. } =
            &manifest;
        let measured = definition.measured().to_toml()?;
        let identity = (experiment, small, shard, &measured, source_hash, adapter, driver, version, commit);
        manifest.identity = definition::hash(&serde_json::to_vec(&identity)?);
        Ok(manifest)
    }

    /// Records the hash of a table as it is now.
    pub(super) fn record(&mut self, folder: &Path, table: &str) -> Result<()> {
        self.files.insert(table.to_owned(), hash_of(&folder.join(table))?);
        Ok(())
    }

    /// Checks that a table has the bytes that were recorded. Tables of older versions, which have no record, are accepted.
    ///
    /// # Errors
    /// The table cannot be read, or its bytes differ.
    pub(super) fn check_table(&self, folder: &Path, table: &str) -> Result<()> {
        let Some(recorded) = self.files.get(table) else { return Ok(()) };
        let file = folder.join(table);
        if hash_of(&file)? != *recorded {
            bail!(
                "{}: its content is not what {FILE} records: one of the two files is damaged or belongs to another run; repeat the run, or restore a copy",
                file.display()
            );
        }
        Ok(())
    }

    /// Checks that the manifest in a folder is the one that was written. Manifests of older versions, which have no checksum, are accepted.
    ///
    /// # Errors
    /// The manifest cannot be read, or was changed.
    pub(super) fn check(folder: &Path) -> Result<()> {
        let file = folder.join(FILE);
        let text = fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
        let entries: Entries = serde_json::from_str(&text).with_context(|| format!("{} is damaged", file.display()))?;
        let Some(stored) = entries.get(CHECKSUM) else { return Ok(()) };
        let found = checksum(&entries)?;
        if stored.as_str() != Some(found.as_str()) {
            bail!(
                "{}: its checksum is {found}, but {stored} was stored: the manifest is damaged: restore a copy, or remove the folder",
                file.display()
            );
        }
        Ok(())
    }

    /// Refuses a run whose tables have the columns of another version.
    ///
    /// # Errors
    /// The schema is not that of this version. The message names the remedy.
    pub(super) fn check_schema(&self, folder: &Path) -> Result<()> {
        if self.schema != SCHEMA {
            bail!("{}: {}", folder.join(FILE).display(), other_schema(&self.schema));
        }
        Ok(())
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
            return Err(broken(format!("its format is {format}, but this version reads format {FORMAT}")));
        }
        serde_json::from_str(text).map_err(|error| broken(error.to_string()))
    }

    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        let entries: Entries = serde_json::from_value(serde_json::to_value(self)?)?;
        let stored = Stored { manifest: self, checksum: checksum(&entries)? };
        super::table::write_with(&folder.join(FILE), |output| {
            serde_json::to_writer_pretty(&mut *output, &stored)?;
            output.write_all(b"\n")
        })
    }

    /// Compares this manifest of an existing run ("there" in the description) with `other`, the manifest of the requested run ("here"). Returns a
    /// description of the first difference that would make their numbers incomparable; `None` if there is none.
    pub(super) fn difference(&self, other: &Manifest) -> Result<Option<String>> {
        let differs = |what: &str, there: &dyn std::fmt::Display, here: &dyn std::fmt::Display| {
            Some(format!("{what} is {} there and {} here", short(&there.to_string()), short(&here.to_string())))
        };
        let shard = |manifest: &Manifest| manifest.shard.clone().unwrap_or_else(|| "the whole run".to_owned());
        let size = |manifest: &Manifest| if manifest.small { "small (made by `check`)" } else { "full (made by `run`)" };
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

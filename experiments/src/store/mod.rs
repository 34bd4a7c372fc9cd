//! The folder of a run. The rules below say which files it contains at which time. They allow a run to be stopped at any time, resumed, split over
//! several machines, and read back.
//!
//! ```text
//! OUT/<experiment>[/shard-K-of-N]/
//!   lock               created first; locked by the process that does the run
//!   manifest.json      written before all other files but `lock`; at the end `complete` becomes true
//!   scene/             the imported scene, if the definition imports one
//!   reference/         converged references, and facts about them (JSON); reference sequences, until no unfinished sweep needs them
//!   pictures/, video/  pictures of the report; sequences of frames, if the definition requests them
//!   parts/             a file for each finished part; removed when all parts are finished and joined
//!   metrics.parquet    all rows of metrics, in the order of the parts; metrics.csv has the same rows
//!   times.parquet      device times, which differ from run to run; times.csv has the same rows
//!   report.html, .md   the report, as a page and as a short text
//! ```
//!
//! Every file but `lock` is written under a temporary name and then renamed. A file is therefore either complete or absent. The manifest, the parts
//! and the tables are flushed to the disk before they are renamed. The bytes of the metrics do not depend on how often the run was stopped and
//! resumed.
//!
//! Files can also be damaged later, or be replaced by files of another run. The manifest therefore contains a checksum of itself, and hashes of the
//! tables and of the imported scene. A part contains the identity of its run, and the part of a reference contains hashes of the reference's files.

use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use kernels::import::scene_folder;
use kernels::scene;
use kernels::shared::signal::Signal;

use crate::definition::{self, Definition, setting_text};
use crate::metrics;
use crate::process::{Unfit, check_interrupted};
use crate::row::Row;
use crate::unit::{Measure, Outcome, Shard, Share, Unit, Work, plan, share};

mod manifest;
mod pictures;
pub mod table;

pub(crate) use pictures::RunPicture;
pub(crate) use table::write_with;

use manifest::hash_of;
pub use manifest::{Manifest, Provenance};
use table::{Table, read_parquet, write_csv, write_parquet};

const LOCK: &str = "lock";
const PARTS: &str = "parts";
const SCENE: &str = "scene";
/// Folder of converged references and reference sequences.
pub(crate) const REFERENCE: &str = "reference";
/// Extension of the files with the pictures of reference sequences.
pub(crate) const SEQUENCE: &str = "frames";
/// Folder of pictures. It contains lists (`.json` files), each of which describes some of the pictures.
pub(crate) const PICTURES: &str = "pictures";
/// File name of the HTML report.
pub(crate) const REPORT_PAGE: &str = "report.html";
/// File name of the short report for a pull request.
pub(crate) const REPORT_TEXT: &str = "report.md";
/// Folder of PNG sequences.
pub(crate) const VIDEO: &str = "video";
const NOTE_PART: &str = "scree.part";
const NOTE_METRICS: &str = "scree.metrics";
const NOTE_RUN: &str = "scree.run";
/// Prefix of the name of a note that contains the hash of a reference's file. A note is an entry of the metadata of a Parquet file. The prefix is
/// followed by the name of the hashed file.
const NOTE_FILE: &str = "scree.file.";

/// Number of progress steps into which a part is divided.
const STEPS: u64 = 1000;

/// What to do if the folder already contains a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// Keep it, and report an error.
    Refuse,
    /// Continue it if it is the requested run. Otherwise report an error.
    Resume,
    /// If it is the requested run and was stopped, continue it. Otherwise, if it has the same name as the requested run, replace it. If the names
    /// differ, report an error.
    Replace,
}

/// The folder in which a run is stored, and the properties that identify the run.
#[derive(Clone, Copy, Debug)]
pub struct Place<'a> {
    /// The folder that contains the folders of all runs, or the folder of this run.
    pub out: &'a Path,
    /// Whether `out` is the folder of this run.
    pub own: bool,
    /// What to do about an existing run.
    pub existing: Existing,
    /// The shard; `None` = the run is not split.
    pub shard: Option<Shard>,
    /// Whether the run uses the definition with the changes of `small`.
    pub small: bool,
}

impl Place<'_> {
    /// Returns the folder of the whole run, even if `shard` is given.
    fn whole(&self, definition: &Definition) -> PathBuf {
        if self.own { self.out.to_owned() } else { self.out.join(&definition.name) }
    }

    /// Returns the folder of the run or, if `shard` is given, of the shard.
    pub fn folder(&self, definition: &Definition) -> PathBuf {
        let run = self.whole(definition);
        self.shard.map_or(run.clone(), |shard| run.join(format!("shard-{}-of-{}", shard.number, shard.count)))
    }
}

/// A run in progress. Its folder stays locked while this value exists.
#[derive(Debug)]
pub struct Run {
    folder: PathBuf,
    definition: Definition,
    manifest: Manifest,
    shares: Vec<Share>,
    /// Indices of finished parts.
    done: BTreeSet<usize>,
    /// Messages for the user about the state of the folder, and about a scene that was just imported.
    notes: Vec<String>,
    _lock: Lock,
}

impl Run {
    /// Starts or continues a run. It locks the folder, writes the manifest, imports the scene if the definition imports one, and finds the finished
    /// parts. If `place.small` is true, `definition` must be the result of [`Definition::small`].
    ///
    /// # Errors
    /// The message is one line with the remedy. Possible causes: the folder contains other files, a run that must not be resumed, or a different run
    /// (the message says what differs); another process uses the folder; the folder cannot be written; the scene cannot be imported, or lacks
    /// something that the definition needs.
    pub fn open(definition: &Definition, place: &Place<'_>, provenance: &Provenance) -> Result<Run> {
        let folder = place.folder(definition);
        let show = folder.display();
        let whole = place.whole(definition);
        if place.shard.is_some() && whole.join(manifest::FILE).exists() {
            bail!("{} holds the whole run: choose another --out for shards", whole.display());
        }
        fs::create_dir_all(&folder).with_context(|| format!("cannot make the folder {show}: choose another with --out"))?;
        let is_run = || folder.join(manifest::FILE).exists();
        if let Some(foreign) = foreign(&folder)?.filter(|_| !is_run()) {
            bail!("{show} holds `{foreign}`, which does not belong to a run: remove it, or choose another --out");
        }
        let lock = lock(&folder, &provenance.command)?;
        let mut manifest = Manifest::new(definition, place.small, place.shard, provenance)?;
        let there = if is_run() { Some(Manifest::read(&folder)?) } else { None };
        if there.is_some() {
            Manifest::check(&folder)?;
        }
        if let Some(there) = there {
            let may_replace = place.existing == Existing::Replace && there.experiment == definition.name;
            let difference = match there.check_schema(&folder) {
                Ok(()) => there.difference(&manifest)?,
                Err(error) if may_replace => Some(format!("{error:#}")),
                Err(error) => return Err(error),
            };
            let replaced = may_replace && (there.complete || difference.is_some());
            if replaced {
                remove_results(&folder)?;
            } else if place.existing == Existing::Refuse {
                let state = if there.complete { "a finished run" } else { "a run that was stopped" };
                // `check` has no --resume, because it takes only a short time.
                let go_on = if place.small { "" } else { "continue it with --resume, " };
                bail!("{show} holds {state}: {go_on}remove the folder, or choose another --out");
            } else if let Some(difference) = difference {
                bail!("{show} holds another run ({difference}): choose another --out, or remove the folder");
            } else {
                // The new manifest is stored, because the question, the analysis and the expectations of the definition may have changed.
                // It keeps the provenance of the existing run, so it contains the command that started the run.
                manifest.complete = there.complete;
                manifest.provenance = there.provenance;
                manifest.files = there.files;
            }
        }
        remove_leftovers(&folder)?;
        manifest.write(&folder)?;
        let mut run = Run {
            shares: share(&plan(definition), place.shard),
            definition: definition.clone(),
            manifest,
            done: BTreeSet::new(),
            notes: Vec::new(),
            _lock: lock,
            folder,
        };
        run.import()?;
        run.survey()?;
        Ok(run)
    }

    /// Returns the folder of the run.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns the folder of the imported scene, if the definition imports one.
    pub fn imported(&self) -> Option<PathBuf> {
        self.definition.import.as_ref().map(|_| self.folder.join(SCENE))
    }

    /// Returns messages for the user about the state of the folder, and about the scene if it was just imported, one per line.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the number of finished parts, and the number of all parts.
    pub fn progress(&self) -> (usize, usize) {
        (self.done.len(), self.shares.len())
    }

    fn import(&mut self) -> Result<()> {
        let (Some(import), Some(scene)) = (&self.definition.import, self.imported()) else { return Ok(()) };
        if scene.join(scene::FILE).exists() {
            let found = hash_of_folder(&scene)?;
            ensure!(
                self.manifest.files.get(SCENE).is_none_or(|recorded| *recorded == found),
                "{}: its files are not those that were imported: remove this folder, so that the scene is imported again",
                scene.display()
            );
        } else {
            let job = import.job(&self.definition.folder).map_err(|what| anyhow::anyhow!("import: {what}"))?;
            let stopped = || check_interrupted().is_err();
            let understood = scene_folder::examine(&job.heightmap, &job.options, &stopped)?;
            understood.write(&scene, &stopped)?;
            self.notes.extend(understood.notes().into_iter().map(|note| format!("import: {note}")));
        }
        self.manifest.files.insert(SCENE.to_owned(), hash_of_folder(&scene)?);
        self.manifest.write(&self.folder)?;
        self.definition.check_imported(&scene)
    }

    /// Finds the finished parts. Damaged parts are removed, so that they are measured again.
    fn survey(&mut self) -> Result<()> {
        // A finished run has no folder of parts. If its results are damaged, the folder is created again.
        let parts = self.folder.join(PARTS);
        if self.manifest.complete {
            match [METRICS, TIMES].into_iter().find(|name| read_table(&self.folder, &self.manifest, name).is_err()) {
                None => {
                    self.done = self.shares.iter().map(|share| share.unit.index).collect();
                    self.mend()?;
                }
                Some(damaged) => {
                    self.notes.push(format!("{} is damaged, so all parts are measured again", self.file(damaged, "parquet").display()));
                    self.manifest.complete = false;
                    self.manifest.files.retain(|name, _| name == SCENE);
                    self.manifest.write(&self.folder)?;
                    fs::create_dir_all(&parts).with_context(|| format!("cannot make the folder {}", parts.display()))?;
                }
            }
            return Ok(());
        }
        fs::create_dir_all(&parts).with_context(|| format!("cannot make the folder {}", parts.display()))?;
        for share in &self.shares {
            let file = part_file(&self.folder, &share.unit);
            if !file.exists() {
                continue;
            }
            match read_part(&file, &share.unit, &self.manifest.identity) {
                Ok(_) => {
                    self.done.insert(share.unit.index);
                }
                Err(error) => {
                    self.notes.push(format!("{error:#}; this part is measured again"));
                    fs::remove_file(&file).with_context(|| format!("cannot remove {}", file.display()))?;
                }
            }
        }
        self.survey_references()
    }

    /// Checks the files of each reference that an unfinished sweep needs. If a file is damaged, the reference's part is removed, so that the
    /// reference is rendered again.
    fn survey_references(&mut self) -> Result<()> {
        let references = self.shares.iter().map(|share| &share.unit).filter(|unit| unit.work == Work::Reference);
        let is_needed = |reference: &&Unit| {
            let measures =
                |unit: &Unit| matches!(unit.work, Work::Sweep { .. }) && unit.view == reference.view && unit.setting == reference.setting;
            self.done.contains(&reference.index)
                && self.shares.iter().any(|share| measures(&share.unit) && !self.done.contains(&share.unit.index))
        };
        for unit in references.filter(is_needed).cloned().collect::<Vec<_>>() {
            if let Err(error) = check_reference(&self.folder, &unit) {
                self.notes.push(format!("{error:#}; this reference is rendered again"));
                let part = part_file(&self.folder, &unit);
                fs::remove_file(&part).with_context(|| format!("cannot remove {}", part.display()))?;
                self.done.remove(&unit.index);
            }
        }
        Ok(())
    }

    /// Writes each CSV table of a finished run again if it is missing or damaged. The Parquet table has the same rows.
    fn mend(&mut self) -> Result<()> {
        for name in [METRICS, TIMES] {
            let csv = format!("{name}.csv");
            let file = self.folder.join(&csv);
            if file.is_file() && self.manifest.check_table(&self.folder, &csv).is_ok() {
                continue;
            }
            write_csv(&file, &mut std::iter::once(read_table(&self.folder, &self.manifest, name)))?;
            self.notes.push(format!("{} was missing or damaged, so it is written again from {name}.parquet", file.display()));
            self.manifest.record(&self.folder, &csv)?;
            self.manifest.write(&self.folder)?;
        }
        Ok(())
    }

    fn file(&self, name: &str, extension: &str) -> PathBuf {
        self.folder.join(format!("{name}.{extension}"))
    }

    /// Carries out the missing parts in order. `progress(done, total)` is called during the work. `go_on` is called before each missing part. If it
    /// returns an error, the run stops.
    ///
    /// # Errors
    /// A part fails, or `go_on` returns an error. The message names the part. Finished parts are kept.
    pub fn carry_out(&mut self, measure: &mut dyn Measure, progress: &dyn Fn(u64, u64), go_on: &dyn Fn() -> Result<()>) -> Result<()> {
        let total = self.shares.len() as u64 * STEPS;
        let missing: Vec<Share> = self.shares.iter().filter(|share| !self.done.contains(&share.unit.index)).cloned().collect();
        for share in missing {
            let before = self.done.len() as u64 * STEPS;
            progress(before, total);
            let step = |done: u64, of: u64| progress(before + (STEPS * done.min(of)).checked_div(of).unwrap_or(0), total);
            let unit = &share.unit;
            let measured = go_on().and_then(|()| measure.measure(unit, &self.folder, &step)).and_then(|outcome| self.keep(&share, outcome));
            measured.map_err(|error| {
                // The message gives no hint at --resume in two cases: `check` has no --resume, and a definition that cannot be measured must change.
                let go_on = if self.manifest.small || error.is::<Unfit>() {
                    ""
                } else {
                    ": to continue from here, repeat the command with --resume (`demo` needs no --resume)"
                };
                // In a shard, parts of other shards are not counted.
                let number = 1 + self.shares.iter().take_while(|other| other.unit.index != unit.index).count();
                let place = format!("`{}`, part {number} of {} ({}){go_on}", self.definition.name, self.shares.len(), unit.id);
                error.context(place)
            })?;
            self.done.insert(share.unit.index);
            self.remove_sequences()?;
        }
        progress(total, total);
        Ok(())
    }

    /// Stores the result of a part. If another shard stores the rows of the part ([`Share::kept`]), no rows are stored. The columns that follow from
    /// the part or from the metric are set here, so that rows cannot contradict them. If the metric is measured for each signal, the column `signal`
    /// keeps the value `lit`, and any other value is replaced by `albedo`.
    fn keep(&self, share: &Share, mut outcome: Outcome) -> Result<()> {
        let unit = &share.unit;
        if !share.kept {
            outcome = Outcome::default();
        }
        for (rows, deterministic) in [(&mut outcome.rows, true), (&mut outcome.times, false)] {
            for row in rows.iter_mut() {
                let metric = metrics::known(&row.metric).map_err(anyhow::Error::msg)?;
                if metric.is_deterministic() != deterministic {
                    bail!("`{}` is in the wrong table of the part's outcome", row.metric);
                }
                let is_lit = metric.signals == metrics::Signals::Each && row.signal == Signal::Lit.name();
                let signal = if is_lit { Signal::Lit } else { Signal::Albedo };
                metric.signal_column(signal).clone_into(&mut row.signal);
                row.unit = metric.unit_of(signal);
                self.identify(unit, row);
            }
            rows.retain(|row| self.definition.measures(&row.metric));
            rows.sort_by(Row::order);
        }
        let count = outcome.rows.len();
        let mut notes = vec![
            (NOTE_PART.to_owned(), part_name(unit)),
            (NOTE_METRICS.to_owned(), count.to_string()),
            (NOTE_RUN.to_owned(), self.manifest.identity.clone()),
        ];
        for file in reference_files(&self.folder, unit)? {
            let name = file.file_name().unwrap_or_default().to_string_lossy();
            notes.push((format!("{NOTE_FILE}{name}"), hash_of(&file)?));
        }
        outcome.rows.append(&mut outcome.times);
        let file = part_file(&self.folder, unit);
        write_parquet(&file, &mut std::iter::once(Ok(outcome.rows)), &notes)
    }

    fn identify(&self, unit: &Unit, row: &mut Row) {
        row.experiment.clone_from(&self.definition.name);
        row.view.clone_from(&unit.view);
        let varied = self.definition.vary.as_ref().zip(unit.setting.as_ref());
        row.parameter = varied.map(|(vary, _)| vary.parameter.clone()).unwrap_or_default();
        row.setting = varied.map(|(_, value)| setting_text(value)).unwrap_or_default();
        match &unit.work {
            Work::Reference => {}
            Work::Sweep { estimator, noise, temporal } => {
                row.estimator.clone_from(estimator);
                row.noise.clone_from(noise);
                row.temporal.clone_from(temporal);
            }
            Work::Timing { estimator, noise } => {
                row.estimator.clone_from(estimator);
                row.noise.clone_from(noise);
            }
        }
    }

    /// Joins the results of all parts in order; only one part at a time is in memory. Then marks the run as complete, and reads its rows back.
    ///
    /// # Errors
    /// Parts are missing, or the disk fails.
    pub fn finish(mut self) -> Result<RunData> {
        if !self.manifest.complete {
            let (done, all) = self.progress();
            if done < all {
                bail!("{} of {all} parts of `{}` are missing: repeat the command with --resume", all - done, self.definition.name);
            }
            for (name, times) in [(METRICS, false), (TIMES, true)] {
                let groups = || {
                    self.shares.iter().map(|share| {
                        let (metrics, clocks) = read_part(&part_file(&self.folder, &share.unit), &share.unit, &self.manifest.identity)?;
                        Ok(if times { clocks } else { metrics })
                    })
                };
                let room = "the parts cannot be joined; repeat the command with --resume to try again";
                write_parquet(&self.file(name, "parquet"), &mut groups(), &[]).context(room)?;
                write_csv(&self.file(name, "csv"), &mut groups()).context(room)?;
            }
            for table in [METRICS, TIMES].into_iter().flat_map(|name| ["parquet", "csv"].map(|extension| format!("{name}.{extension}"))) {
                self.manifest.record(&self.folder, &table)?;
            }
            self.manifest.complete = true;
            self.manifest.write(&self.folder)?;
        }
        let parts = self.folder.join(PARTS);
        if parts.exists() {
            fs::remove_dir_all(&parts).with_context(|| format!("cannot remove {}", parts.display()))?;
        }
        self.remove_sequences()?;
        read_run(&self.folder)
    }
}

impl Run {
    /// Removes the pictures of the reference sequences that no unfinished sweep needs. They usually take more space than the other files of a run.
    fn remove_sequences(&self) -> Result<()> {
        let units = || self.shares.iter().map(|share| &share.unit);
        let is_spent = |reference: &&Unit| {
            let needs =
                |unit: &Unit| matches!(unit.work, Work::Sweep { .. }) && unit.view == reference.view && unit.setting == reference.setting;
            !units().any(|unit| needs(unit) && !self.done.contains(&unit.index))
        };
        for file in units().filter(is_spent).flat_map(|unit| reference_files(&self.folder, unit).unwrap_or_default()) {
            if file.extension().is_some_and(|extension| extension == SEQUENCE) {
                fs::remove_file(&file).with_context(|| format!("cannot remove {}", file.display()))?;
            }
        }
        Ok(())
    }
}

const METRICS: &str = "metrics";
const TIMES: &str = "times";

fn part_name(unit: &Unit) -> String {
    format!("{:05}-{}", unit.index, unit.id)
}

fn part_file(folder: &Path, unit: &Unit) -> PathBuf {
    folder.join(PARTS).join(format!("{}.parquet", part_name(unit)))
}

/// Reads the metrics and the times of a part. `identity` is the identity of the run; empty = the run has none, because an older version wrote it.
fn read_part(file: &Path, unit: &Unit, identity: &str) -> Result<(Vec<Row>, Vec<Row>)> {
    let Table { rows: mut metrics, notes } = read_parquet(file)?;
    if !identity.is_empty() && notes.get(NOTE_RUN).is_none_or(|run| run != identity) {
        bail!("{} does not belong to the run that {} describes", file.display(), manifest::FILE);
    }
    // The checksum of the table does not cover the notes, which contain the number n of rows with metrics. This number is therefore
    // checked: the first n rows must be metrics, and the other rows must be times.
    let is_time = |row: &Row| metrics::find(&row.metric).is_some_and(|metric| !metric.is_deterministic());
    let count = notes.get(NOTE_METRICS).and_then(|count| count.parse::<usize>().ok()).filter(|&count| count <= metrics.len());
    match count.filter(|&count| !metrics[..count].iter().any(is_time) && metrics[count..].iter().all(is_time)) {
        Some(count) if notes.get(NOTE_PART) == Some(&part_name(unit)) => {
            let times = metrics.split_off(count);
            Ok((metrics, times))
        }
        _ => bail!("{} does not contain part {}", file.display(), part_name(unit)),
    }
}

/// Returns the files of the reference that a part has rendered. Empty if the part renders no reference.
fn reference_files(folder: &Path, unit: &Unit) -> Result<Vec<PathBuf>> {
    let own = folder.join(REFERENCE);
    if unit.work != Work::Reference || !own.is_dir() {
        return Ok(Vec::new());
    }
    let entries = fs::read_dir(&own).with_context(|| format!("cannot read the folder {}", own.display()))?;
    let mut files: Vec<PathBuf> = entries.filter_map(Result::ok).map(|entry| entry.path()).collect();
    files.retain(|file| file.file_stem().is_some_and(|stem| stem == unit.id.as_str()));
    files.sort();
    Ok(files)
}

/// Checks that the files of a reference have the bytes that they had when their part was finished.
fn check_reference(folder: &Path, unit: &Unit) -> Result<()> {
    let Table { notes, .. } = read_parquet(&part_file(folder, unit))?;
    for (name, hash) in notes.iter().filter_map(|(name, hash)| Some((name.strip_prefix(NOTE_FILE)?, hash))) {
        let file = folder.join(REFERENCE).join(name);
        ensure!(hash_of(&file)? == *hash, "{}: its content differs from what its part has written", file.display());
    }
    Ok(())
}

/// Returns the xxHash64 of the names and the contents of all files in a folder and its subfolders.
fn hash_of_folder(folder: &Path) -> Result<String> {
    let context = || format!("cannot read the folder {}", folder.display());
    let entries = fs::read_dir(folder).with_context(context)?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<PathBuf>>>().with_context(context)?;
    paths.sort();
    let mut list = String::new();
    for path in &paths {
        let hash = if path.is_dir() { hash_of_folder(path)? } else { hash_of(path)? };
        list += &format!("{hash} {}\n", path.file_name().unwrap_or_default().to_string_lossy());
    }
    Ok(definition::hash(list.as_bytes()))
}

/// Reads a table of a finished run.
fn read_table(folder: &Path, manifest: &Manifest, name: &str) -> Result<Vec<Row>> {
    let file = format!("{name}.parquet");
    let Table { rows, .. } = read_parquet(&folder.join(&file))?;
    manifest.check_table(folder, &file)?;
    Ok(rows)
}

/// Returns the name of the first entry of a folder that is neither a lock nor temporary; `None` if there is none. A run that was stopped before it
/// wrote its manifest leaves only a lock and temporary files.
fn foreign(folder: &Path) -> Result<Option<String>> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read the folder {}", folder.display()))?;
    let mut names: Vec<String> = entries.filter_map(Result::ok).map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    Ok(names.into_iter().find(|name| name != LOCK && !is_leftover(name)))
}

/// Whether the name is temporary. Files and folders have such names until they are complete and renamed.
fn is_leftover(name: &str) -> bool {
    name.ends_with(".tmp") || name.starts_with(&format!(".{SCENE}.part-"))
}

/// Removes the files and folders that a run writes, except its lock. Other entries of the folder are kept. The manifest is removed last. Until then,
/// the folder is recognised as the folder of a run.
fn remove_results(folder: &Path) -> Result<()> {
    let tables = [METRICS, TIMES].into_iter().flat_map(|name| ["parquet", "csv"].map(|extension| format!("{name}.{extension}")));
    let reports = [REPORT_PAGE, REPORT_TEXT].into_iter().map(str::to_owned);
    for name in tables.chain(reports) {
        remove(&folder.join(name))?;
    }
    for name in [PARTS, SCENE, REFERENCE, VIDEO, PICTURES] {
        remove(&folder.join(name))?;
    }
    remove(&folder.join(manifest::FILE))
}

/// Removes a file or a folder if it exists.
fn remove(path: &Path) -> Result<()> {
    let gone = if path.is_dir() && !path.is_symlink() { fs::remove_dir_all(path) } else { fs::remove_file(path) };
    match gone {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}: choose another --out", path.display()))
        }
        _ => Ok(()),
    }
}

fn remove_leftovers(folder: &Path) -> Result<()> {
    let context = |path: &Path| format!("cannot remove temporary files: {}", path.display());
    for entry in fs::read_dir(folder).with_context(|| context(folder))? {
        let path = entry.with_context(|| context(folder))?.path();
        let is_folder = path.is_dir() && !path.is_symlink();
        if path.file_name().is_some_and(|name| is_leftover(&name.to_string_lossy())) {
            if is_folder { fs::remove_dir_all(&path) } else { fs::remove_file(&path) }.with_context(|| context(&path))?;
        } else if is_folder {
            remove_leftovers(&path)?;
        }
    }
    Ok(())
}

/// The lock of a folder. The operating system releases it when the process ends, even if the process is killed.
#[derive(Debug)]
struct Lock(File);

impl Drop for Lock {
    fn drop(&mut self) {
        // Closing the file is not always enough to release the lock. If another thread has just forked a child process, the child also has a copy of
        // the file handle and keeps the lock. If unlocking fails, the lock is released when all copies are closed.
        drop(self.0.unlock());
    }
}

/// Locks the folder for this process.
fn lock(folder: &Path, command: &str) -> Result<Lock> {
    let path = folder.join(LOCK);
    let context = || format!("cannot lock {}", folder.display());
    let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path).with_context(context)?;
    match file.try_lock() {
        Ok(()) => {}
        Err(TryLockError::WouldBlock) => {
            let mut who = String::new();
            // If the file cannot be read, the message does not name the process that holds the lock.
            let _ = file.read_to_string(&mut who);
            let who = if who.trim().is_empty() { "another process".to_owned() } else { who.trim().to_owned() };
            bail!("{} is in use by {who}: wait until that process ends, or choose another --out", folder.display());
        }
        Err(TryLockError::Error(error)) => return Err(error).with_context(context),
    }
    file.set_len(0).and_then(|()| write!(file, "process {} (`{command}`)", std::process::id())).with_context(context)?;
    Ok(Lock(file))
}

/// A run that was read back. It is complete, combined from its shards, or consists of the parts that are finished.
#[derive(Clone, Debug)]
pub struct RunData {
    /// The definition that was run.
    pub definition: Definition,
    /// The manifest. If the run consists of shards, it is the manifest of the first shard.
    pub manifest: Manifest,
    /// The rows of metrics, sorted by the columns from left to right.
    pub rows: Vec<Row>,
    /// The rows of device times, sorted by the columns from left to right.
    pub times: Vec<Row>,
    /// Whether all parts are finished and joined.
    pub complete: bool,
    /// Descriptions of what is missing, one per line, such as a number of parts or a shard.
    pub missing: Vec<String>,
    /// The folder from which the run was read.
    pub folder: PathBuf,
    /// The folders that contain the files of the run: the folder that was given, or the folders of its shards.
    pub folders: Vec<PathBuf>,
}

/// Reads the run in a folder. If the folder contains shards, they are combined.
///
/// # Errors
/// There is no run, a file is damaged, or the shards do not belong together (the message says what differs).
pub fn read_run(folder: &Path) -> Result<RunData> {
    if folder.join(manifest::FILE).exists() {
        let manifest = Manifest::read(folder)?;
        return read_one(folder, manifest);
    }
    let show = folder.display();
    let entries = fs::read_dir(folder).with_context(|| format!("cannot read {show}: give the folder of a run, where manifest.json is"))?;
    let mut inside: Vec<PathBuf> = entries.filter_map(Result::ok).map(|e| e.path()).collect();
    inside.sort();
    let (below, others): (Vec<PathBuf>, Vec<PathBuf>) = inside.into_iter().partition(|p| p.join(manifest::FILE).exists());
    let is_shard = |p: &&PathBuf| {
        let name = p.file_name().unwrap_or_default().to_string_lossy();
        p.is_dir() && name.starts_with("shard-") && name.contains("-of-")
    };
    if let Some(shard) = others.iter().find(is_shard) {
        bail!(
            "{} has no {}, so it is unknown which run its numbers belong to: run that shard again, or remove the folder",
            shard.display(),
            manifest::FILE
        );
    }
    let shards: Vec<(PathBuf, Manifest, Shard)> = below
        .iter()
        .map(|path| {
            let manifest = Manifest::read(path)?;
            let shard: Option<Shard> = manifest.shard.as_deref().and_then(|text| text.parse().ok());
            match shard {
                Some(_) => manifest.check_schema(path)?,
                // The entry `shard` may be missing because the manifest is damaged. Without this check, the numbers of the shard would be left out.
                None => Manifest::check(path)?,
            }
            Ok(shard.map(|shard| (path.clone(), manifest, shard)))
        })
        .filter_map(Result::transpose)
        .collect::<Result<_>>()?;
    if let Some(run) = below.first().filter(|_| shards.is_empty()) {
        bail!("{show} is not a run but holds runs: give one of them, such as {}", run.display());
    }
    let Some((_, first, Shard { count, .. })) = shards.first().cloned() else {
        bail!("{show} holds no run: give a folder that `experiments run` has written, where manifest.json is");
    };
    let mut whole: Option<RunData> = None;
    for (path, manifest, shard) in &shards {
        let alike = Manifest { shard: first.shard.clone(), ..manifest.clone() };
        let counts = manifest.shard.as_deref().and_then(|shard| shard.split_once('/')).map(|(_, count)| count.to_owned());
        let place = || path.join(manifest::FILE).display().to_string();
        let difference = match first.difference(&alike).with_context(place)? {
            None if counts != Some(count.to_string()) => {
                Some(format!("the run has {count} shards there and {} here", counts.unwrap_or_default()))
            }
            difference => difference,
        };
        if let Some(difference) = difference {
            bail!(
                "{} does not belong to the same run as {}: {difference}: store the shards of different runs in different folders",
                path.display(),
                shards[0].0.display()
            );
        }
        let is_same = |other: &&(PathBuf, Manifest, Shard)| other.0 != *path && other.2 == *shard;
        if let Some((other, ..)) = shards.iter().find(is_same) {
            bail!("{} and {} both hold shard {shard}: remove one of the two folders", path.display(), other.display());
        }
        let data = read_one(path, manifest.clone())?;
        whole = Some(match whole {
            None => RunData { folder: folder.to_owned(), ..data },
            Some(mut whole) => {
                whole.rows.extend(data.rows);
                whole.times.extend(data.times);
                whole.missing.extend(data.missing);
                whole.folders.extend(data.folders);
                whole
            }
        });
    }
    let mut whole = whole.context("there is no shard")?;
    let there: BTreeSet<u32> = shards.iter().map(|(_, _, shard)| shard.number).collect();
    whole.missing.extend((1..=count).filter(|number| !there.contains(number)).map(|number| {
        let shard = Shard { number, count };
        format!("shard {shard}: run it with --shard {shard}, or copy its folder here")
    }));
    whole.complete = whole.missing.is_empty();
    whole.rows.sort_by(Row::order);
    whole.times.sort_by(Row::order);
    Ok(whole)
}

fn read_one(folder: &Path, manifest: Manifest) -> Result<RunData> {
    Manifest::check(folder)?;
    manifest.check_schema(folder)?;
    let context = || format!("{}: the definition in manifest.json", folder.display());
    let definition = definition::stored(&manifest.definition).with_context(context)?;
    let (mut rows, mut times, mut missing) = (Vec::new(), Vec::new(), Vec::new());
    if manifest.complete {
        rows = read_table(folder, &manifest, METRICS)?;
        times = read_table(folder, &manifest, TIMES)?;
        // The rows are read from the Parquet tables. The CSV tables are checked, too, because other programs read them.
        for csv in [METRICS, TIMES].map(|name| format!("{name}.csv")) {
            if folder.join(&csv).exists() {
                manifest.check_table(folder, &csv)?;
            }
        }
    } else {
        let shard = manifest.shard.as_deref().map(str::parse::<Shard>).transpose().map_err(anyhow::Error::msg)?;
        let shares = share(&plan(&definition), shard);
        let mut lacking = 0;
        for share in &shares {
            let file = part_file(folder, &share.unit);
            if file.exists() {
                let (metrics, clocks) = read_part(&file, &share.unit, &manifest.identity)?;
                rows.extend(metrics);
                times.extend(clocks);
            } else {
                lacking += 1;
            }
        }
        let what = match lacking {
            0 => "the tables, although all parts are finished,".to_owned(),
            _ => format!("{lacking} of {} parts", shares.len()),
        };
        missing.push(format!("{what} in {}: run the experiment again with --resume", folder.display()));
    }
    rows.sort_by(Row::order);
    times.sort_by(Row::order);
    Ok(RunData {
        complete: missing.is_empty(),
        definition,
        manifest,
        rows,
        times,
        missing,
        folder: folder.to_owned(),
        folders: vec![folder.to_owned()],
    })
}

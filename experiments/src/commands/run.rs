//! `run`: runs the experiments of definition files, one after another. `check` uses the same functions.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use kernels::gpu::Gpu;

use super::{Reporter, print};
use crate::cli::RunArgs;
use crate::definition::{self, Definition};
use crate::expectations::{self, Verdict};
use crate::process::{check_interrupted, error_line, watch_interrupts};
use crate::report;
use crate::runner::Runner;
use crate::store::{Existing, Place, Provenance, Run, RunData};
use crate::unit::Measure;

/// Returns an object that measures the parts of a run on a device. `imported` is the folder of the imported scene, if the definition imports one.
pub(crate) fn measurer<'a>(gpu: &'a Gpu, definition: &'a Definition, imported: Option<&'a Path>) -> Result<Box<dyn Measure + 'a>> {
    Ok(Box::new(Runner::new(gpu, definition, imported)?))
}

/// Runs the definitions. A definition that fails does not stop the others; Ctrl-C stops all.
pub(crate) fn run(args: &RunArgs) -> Result<()> {
    if let Some(jobs) = args.jobs {
        rayon::ThreadPoolBuilder::new().num_threads(jobs).build_global().context("cannot start the worker threads: omit --jobs")?;
    }
    let existing = if args.resume { Existing::Resume } else { Existing::Refuse };
    let place = Place { out: &args.out, own: false, existing, shard: args.shard, small: false };
    each(&args.definitions, |definition, session| session.answer(&definition, &place))
}

/// The device and the progress reporter that a command uses.
pub(crate) struct Session {
    gpu: Gpu,
    reporter: Reporter,
}

impl Session {
    /// Opens a device, and makes Ctrl-C request a clean stop.
    pub(crate) fn begin() -> Result<Session> {
        watch_interrupts()?;
        Ok(Session { gpu: Gpu::new()?, reporter: Reporter::new() })
    }

    /// Runs a definition, writes its report, and prints a summary. For a shard, no report is written, because a report needs all shards.
    pub(crate) fn answer(&self, definition: &Definition, place: &Place<'_>) -> Result<()> {
        let data = self.carry_out(definition, place)?;
        let verdicts = expectations::evaluate(definition, &data.rows, &data.times);
        let text = summary(&data, &verdicts);
        if data.manifest.shard.is_some() {
            return print(&text);
        }
        let written = report::write_run(&report::of(data)?, &verdicts)?;
        print(&format!("{text}  {}\n  report: {}\n", written.verdict.replace('\n', "\n  "), written.page.display()))
    }

    /// Carries out a run: measures its parts and joins their tables.
    pub(crate) fn carry_out(&self, definition: &Definition, place: &Place<'_>) -> Result<RunData> {
        let info = &self.gpu.info;
        let provenance = Provenance {
            adapter: info.name.clone(),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            software: self.gpu.is_software(),
            without_anisotropy: self.gpu.without_anisotropy().map(str::to_owned),
            command: exact_command(),
        };
        let mut run = Run::open(definition, place, &provenance)?;
        for note in run.notes() {
            eprintln!("note: {note}");
        }
        let (done, all) = run.progress();
        if done < all {
            let imported = run.imported();
            let mut measure = measurer(&self.gpu, definition, imported.as_deref())?;
            // A run has few parts, and each part takes a long time. The bar therefore shows a percentage of the work, not a number of parts.
            let show = |done: u64, total: u64| self.reporter.report(&format!("{} (%)", definition.name), done * 100 / total.max(1), 100);
            let outcome = run.carry_out(measure.as_mut(), &show, &check_interrupted);
            self.reporter.finish();
            outcome?;
        }
        run.finish()
    }
}

/// Loads all definitions, and then calls `act` for each of them. If there is only one definition, its error is returned. If there are several, each
/// error is printed, and the returned error gives the number of failures.
pub(crate) fn each(files: &[PathBuf], mut act: impl FnMut(Definition, &Session) -> Result<()>) -> Result<()> {
    let loaded: Vec<(&PathBuf, Result<Definition>)> = files.iter().map(|file| (file, definition::load(file))).collect();
    let names: Vec<(&PathBuf, &str)> = loaded.iter().filter_map(|(file, d)| Some((*file, d.as_ref().ok()?.name.as_str()))).collect();
    for (i, (file, name)) in names.iter().enumerate() {
        if let Some((before, _)) = names[..i].iter().find(|(_, other)| other.eq_ignore_ascii_case(name)) {
            let same = before.canonicalize().ok().zip(file.canonicalize().ok()).is_some_and(|(a, b)| a == b);
            ensure!(!same, "{} is given twice: name it once", file.display());
            bail!("{} and {} are both called `{name}` and would share a folder: rename one of them", before.display(), file.display());
        }
    }
    let mut session = None;
    let mut failed = Vec::new();
    for (file, definition) in loaded {
        let outcome = definition.and_then(|definition| {
            if session.is_none() {
                session = Some(Session::begin()?);
            }
            let session = session.as_ref().context("the session was not created")?;
            act(definition, session)
        });
        if let Err(error) = outcome {
            // Ctrl-C also stops the remaining definitions.
            if files.len() == 1 || check_interrupted().is_err() {
                return Err(error);
            }
            eprintln!("error: {}", error_line(&error));
            failed.push(file.display().to_string());
        }
    }
    if failed.is_empty() { Ok(()) } else { Err(anyhow!("{} of {} experiments failed: {}", failed.len(), files.len(), failed.join(", "))) }
}

/// Returns the command line, quoted for a shell.
fn exact_command() -> String {
    let quoted = |text: String| {
        let plain = |c: char| c.is_alphanumeric() || "-_./+=,:@%\\".contains(c);
        if !text.is_empty() && text.chars().all(plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
    };
    let arguments = std::env::args_os().skip(1).map(|argument| quoted(argument.to_string_lossy().into_owned()));
    std::iter::once("experiments".to_owned()).chain(arguments).collect::<Vec<_>>().join(" ")
}

fn summary(data: &RunData, verdicts: &[Verdict]) -> String {
    let folder = data.folder.display();
    let provenance = &data.manifest.provenance;
    let software = if provenance.software { ", a software adapter" } else { "" };
    let mut text = format!("{folder}: {} metrics and {} times, on {}{software}\n", data.rows.len(), data.times.len(), provenance.adapter);
    if data.manifest.shard.is_some() {
        if !verdicts.is_empty() {
            text += "  expectations are not judged yet: run `experiments report` when all shards are done\n";
        }
        return text;
    }
    for verdict in verdicts {
        text += &format!("  {verdict}\n");
    }
    text
}

//! The commands, one module for each, and shared functions for output and progress.

mod adapters;
mod bench;
mod check;
mod compare;
mod demo;
mod explain;
mod import;
mod probe;
mod render;
mod report;
mod run;
mod stability;

use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;

use crate::cli::{Cli, Command};

/// Runs the requested command.
pub(crate) fn run(cli: &Cli) -> Result<()> {
    match &cli.command {
        Command::Run(args) => run::run(args),
        Command::Check(args) => check::run(args),
        Command::Bench(args) => bench::run(args),
        Command::Demo(args) => demo::run(args),
        Command::Render(args) => render::run(args),
        Command::Import(args) => import::run(args),
        Command::Probe(args) => probe::run(args),
        Command::Stability(args) => stability::run(args),
        Command::Compare(args) => compare::run(args),
        Command::Explain(args) => explain::run(args),
        Command::Report(args) => report::run(args),
        Command::Adapters(args) => adapters::run(args),
    }
}

/// Writes to stdout. If the reader closes the pipe early (`| head`), this is not an error.
pub(crate) fn print(text: &str) -> Result<()> {
    let mut out = io::stdout().lock();
    match out.write_all(text.as_bytes()).and_then(|()| out.flush()) {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error).context("cannot write to standard output"),
        _ => Ok(()),
    }
}

/// Writes a value as indented JSON to stdout.
pub(crate) fn print_json(value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).context("cannot write the answer as JSON")?;
    print(&format!("{text}\n"))
}

/// Refuses an output file that cannot be written. Commands call this function before the work starts, so that no work is lost.
///
/// The check does not open the file. Output files are written under a temporary name and then renamed, so it is enough that their folder is writable.
pub(crate) fn check_output_file(path: &Path) -> Result<()> {
    if path.is_dir() {
        bail!("{} is a folder: give the name of a file", path.display());
    }
    if path.file_name().is_none() {
        bail!("{} does not name a file: give a file name", path.display());
    }
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    check_writable(folder)
}

/// Refuses a folder that does not exist or cannot be written to.
pub(crate) fn check_writable(folder: &Path) -> Result<()> {
    if !folder.exists() {
        bail!("there is no folder {}: create it, or correct the path", folder.display());
    }
    if !folder.is_dir() {
        bail!("{} is not a folder: correct the path", folder.display());
    }
    // Permission bits are not reliable (read-only mounts, access control lists). The function therefore tries to create a file.
    let trial = folder.join(format!(".scree-{}.tmp", std::process::id()));
    OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .open(&trial)
        .and_then(|_| fs::remove_file(&trial))
        .with_context(|| format!("cannot write into {}: change its permissions, or choose another folder", folder.display()))
}

/// Shows the progress of long work on stderr. If stderr is a terminal, it shows a bar. Otherwise it prints a line at the start of each stage and
/// after each quarter of a stage.
pub(crate) struct Reporter {
    terminal: bool,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    stage: String,
    quarter: u64,
    bar: Option<ProgressBar>,
}

impl Reporter {
    /// Returns a reporter that shows nothing before the first report.
    pub(crate) fn new() -> Reporter {
        Reporter { terminal: io::stderr().is_terminal(), state: Mutex::default() }
    }

    /// Shows that `done` of `total` steps of `stage` are finished; `total` = 0 if the number is unknown. A new `stage` ends the previous stage.
    pub(crate) fn report(&self, stage: &str, done: u64, total: u64) {
        // A poisoned lock means that another thread has panicked. That thread reports the panic.
        let Ok(mut state) = self.state.lock() else { return };
        let entered = state.stage != stage;
        if entered {
            stage.clone_into(&mut state.stage);
            state.quarter = 0;
            if let Some(bar) = state.bar.take() {
                bar.finish_and_clear();
            }
        }
        if self.terminal {
            let bar = state.bar.get_or_insert_with(|| bar(stage, total));
            bar.set_length(total);
            bar.set_position(done);
            return;
        }
        let quarter = (done * 4).checked_div(total).unwrap_or(0);
        if entered || quarter > state.quarter {
            state.quarter = quarter;
            if total == 0 {
                eprintln!("{stage}");
            } else {
                eprintln!("{stage}: {done}/{total}");
            }
        }
    }

    /// Removes the progress bar.
    pub(crate) fn finish(&self) {
        if let Some(bar) = self.state.lock().ok().and_then(|mut state| state.bar.take()) {
            bar.finish_and_clear();
        }
    }
}

fn bar(stage: &str, total: u64) -> ProgressBar {
    let bar = ProgressBar::new(total);
    let template = if total == 0 { "{spinner} {msg} {pos}" } else { "{msg:28} {bar:32} {pos}/{len} {eta}" };
    if let Ok(style) = ProgressStyle::with_template(template) {
        bar.set_style(style);
    }
    bar.set_message(stage.to_owned());
    bar.enable_steady_tick(Duration::from_millis(200));
    bar
}

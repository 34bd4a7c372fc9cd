//! State of the whole process: requests to stop, and the reporting of panics and errors.

use std::cell::Cell;
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail};
use kernels::base::error::one_line;

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs work that may panic because of a damaged file. After [`report_panics`], a panic of this work is not printed. Returns `None` if the work
/// panicked.
pub(crate) fn quietly<T>(work: impl FnOnce() -> T) -> Option<T> {
    QUIET.set(true);
    let outcome = panic::catch_unwind(panic::AssertUnwindSafe(work));
    QUIET.set(false);
    outcome.ok()
}

/// Reports panics on one line as internal errors of this program. The message of Rust's default hook has several lines, can include a stack trace,
/// and does not say that the fault is in the program and not in the user's input.
pub(crate) fn report_panics() {
    panic::set_hook(Box::new(|info| {
        if QUIET.get() {
            return;
        }
        let text = info.payload().downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| info.payload().downcast_ref::<String>().cloned()).unwrap_or_else(|| "no text".to_owned());
        let place = info.location().map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        eprintln!("internal error: {}{place}; please report it with the command that you ran", one_line(&text));
    }));
}

/// Returns an error and its causes on one line.
pub(crate) fn error_line(error: &anyhow::Error) -> String {
    let chain: Vec<String> = error.chain().map(ToString::to_string).collect();
    one_line(&chain.join(": "))
}

/// An error whose cause is the definition of a run. The error message does not suggest `--resume`, because the definition must change first.
#[derive(Debug)]
pub(crate) struct Unfit(pub(crate) String);

impl std::fmt::Display for Unfit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Unfit {}

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// Makes Ctrl-C request a clean stop, which [`check_interrupted`] reports. A second Ctrl-C ends the process immediately.
pub(crate) fn watch_interrupts() -> Result<()> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            // The exit status 128 + SIGINT, which shells expect after Ctrl-C.
            std::process::exit(130);
        }
        eprintln!("stopping after the current step; unfinished work is discarded; press Ctrl-C again to stop at once");
    })
    .context("cannot install a handler for Ctrl-C")
}

/// Returns an error if Ctrl-C was pressed.
pub(crate) fn check_interrupted() -> Result<()> {
    if INTERRUPTED.load(Ordering::SeqCst) {
        bail!("stopped by Ctrl-C: unfinished work is discarded, and finished files are kept");
    }
    Ok(())
}

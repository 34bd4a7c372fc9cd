//! State of the whole process: requests to stop, and how panics and errors are reported.

use std::cell::Cell;
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail};
use kernels::base::error::one_line;

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs work that may panic on a damaged file, without printing the panic; `None` if it panicked.
pub(crate) fn quietly<T>(work: impl FnOnce() -> T) -> Option<T> {
    QUIET.set(true);
    let outcome = panic::catch_unwind(panic::AssertUnwindSafe(work));
    QUIET.set(false);
    outcome.ok()
}

/// Reports panics in one line, as bugs of this program: they must not look like the user's mistake or fill the terminal with a stack trace.
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

/// The whole chain of an error on one line.
pub(crate) fn error_line(error: &anyhow::Error) -> String {
    let chain: Vec<String> = error.chain().map(ToString::to_string).collect();
    one_line(&chain.join(": "))
}

static INTERRUPTED: AtomicBool = AtomicBool::new(false);

/// After this call, Ctrl-C requests a clean stop ([`check_interrupted`]); a second Ctrl-C ends the process at once.
pub(crate) fn watch_interrupts() -> Result<()> {
    ctrlc::set_handler(|| {
        if INTERRUPTED.swap(true, Ordering::SeqCst) {
            // 128 + SIGINT, the exit status that shells expect after Ctrl-C.
            std::process::exit(130);
        }
        eprintln!("stopping; unfinished work is discarded; press Ctrl-C again to stop at once");
    })
    .context("cannot watch for Ctrl-C")
}

/// Fails once Ctrl-C was pressed.
pub(crate) fn check_interrupted() -> Result<()> {
    if INTERRUPTED.load(Ordering::SeqCst) {
        bail!("stopped by Ctrl-C; finished parts are complete");
    }
    Ok(())
}

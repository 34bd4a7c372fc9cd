//! Experiments on the terrain stack: what they are ([`definition`]), the numbers they make ([`row`]), where those are kept, and the command line.
//!
//! The program is [`main`]; everything else is a library, so that an application can run the same experiments.

pub mod definition;
pub mod expectations;
pub mod judge;
pub mod metrics;
pub mod row;
pub mod runner;
pub mod stability;
pub mod store;
pub mod unit;

mod cli;
mod commands;
mod report;

use std::cell::Cell;
use std::panic;
use std::process::ExitCode;

use kernels::base::error::one_line;

use crate::cli::Cli;

thread_local! {
    static QUIET: Cell<bool> = const { Cell::new(false) };
}

/// Runs what may panic over a damaged file, without a word of it; `None` if it did.
pub(crate) fn quietly<T>(work: impl FnOnce() -> T) -> Option<T> {
    QUIET.set(true);
    let outcome = panic::catch_unwind(panic::AssertUnwindSafe(work));
    QUIET.set(false);
    outcome.ok()
}

/// The program: reads the command line, runs the command, says in one line what failed.
pub fn main() -> ExitCode {
    // A defect of ours must not look like the user's fault, nor fill the terminal with a trace.
    panic::set_hook(Box::new(|info| {
        if QUIET.get() {
            return;
        }
        let text = info.payload().downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| info.payload().downcast_ref::<String>().cloned()).unwrap_or_else(|| "no text".to_owned());
        let place = info.location().map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        eprintln!("internal error: {}{place}; please report it, with the command that was run", one_line(&text));
    }));
    let outcome = panic::catch_unwind(|| {
        let cli = Cli::read();
        commands::run(&cli)
    });
    match outcome {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(error)) => {
            eprintln!("error: {}", commands::error_line(&error));
            ExitCode::FAILURE
        }
        Err(_) => ExitCode::FAILURE,
    }
}

//! Experiments on the terrain renderer. The library contains their definitions ([`definition`]), the numbers that they measure ([`row`]), the folders
//! in which these numbers are stored ([`store`]), and the command line.
//!
//! [`main`] is the program. The public modules are a library, with which other applications can run the same experiments.

pub mod definition;
pub mod expectations;
pub mod judge;
pub mod metrics;
pub mod row;
pub mod runner;
pub mod significance;
pub mod stability;
pub mod store;
pub mod unit;

mod cli;
mod commands;
mod process;
mod report;
mod rounds;
mod settings;

use std::panic;
use std::process::ExitCode;

use kernels::base::cache::Cache;

use crate::cli::Cli;

/// The program. It reads the command line and runs the command. If the command fails, it prints one line that says what failed.
pub fn main() -> ExitCode {
    process::report_panics();
    let outcome = panic::catch_unwind(|| {
        let cli = Cli::read();
        commands::run(&cli)
    });
    match outcome {
        Ok(Ok(())) => {
            if let Some(problem) = Cache::of_user().as_deref().and_then(Cache::problem) {
                eprintln!("note: {problem}");
            }
            ExitCode::SUCCESS
        }
        Ok(Err(error)) => {
            eprintln!("error: {}", process::error_line(&error));
            ExitCode::FAILURE
        }
        Err(_) => ExitCode::FAILURE,
    }
}

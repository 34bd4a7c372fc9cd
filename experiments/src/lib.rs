//! Experiments on the terrain stack: what they are ([`definition`]), the numbers they make ([`row`]), where those are kept, and the command line.
//!
//! The program is [`main`]; everything else is a library, so that an application can run the same experiments.

pub mod definition;
pub mod row;
pub mod unit;

mod cli;
mod commands;
mod measure;
mod report;

use std::panic;
use std::process::ExitCode;

use crate::cli::Cli;

/// The program: reads the command line, runs the command, says in one line what failed.
pub fn main() -> ExitCode {
    // A defect of ours must not look like the user's fault, nor fill the terminal with a trace.
    panic::set_hook(Box::new(|info| {
        let text = info.payload().downcast_ref::<&str>().map(|s| (*s).to_owned());
        let text = text.or_else(|| info.payload().downcast_ref::<String>().cloned()).unwrap_or_else(|| "no text".to_owned());
        let place = info.location().map_or_else(String::new, |at| format!(" ({}:{})", at.file(), at.line()));
        eprintln!("internal error: {}{place}; please report it, with the command that was run", commands::one_line(&text));
    }));
    let outcome = panic::catch_unwind(|| {
        let cli = Cli::read();
        commands::run(&cli)
    });
    match outcome {
        Ok(Ok(())) => ExitCode::SUCCESS,
        Ok(Err(error)) => {
            let chain: Vec<String> = error.chain().map(ToString::to_string).collect();
            eprintln!("error: {}", commands::one_line(&chain.join(": ")));
            ExitCode::FAILURE
        }
        Err(_) => ExitCode::FAILURE,
    }
}

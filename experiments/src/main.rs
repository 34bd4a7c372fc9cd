//! The command line of Scree. The library `experiments` contains its implementation.

use std::process::ExitCode;

fn main() -> ExitCode {
    experiments::main()
}

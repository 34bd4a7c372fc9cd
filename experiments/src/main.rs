//! The command line of Scree; see the library `experiments`.

use std::process::ExitCode;

fn main() -> ExitCode {
    experiments::main()
}

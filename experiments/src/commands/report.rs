//! `report`: writes the report of a run again, from its rows.

use anyhow::Result;

use super::print;
use crate::cli::ReportArgs;
use crate::report;

/// Writes both reports, and prints where they are and their verdict.
pub(crate) fn run(args: &ReportArgs) -> Result<()> {
    let run = report::read_run(&args.run)?;
    super::check_writable(&args.run)?;
    for missing in &run.missing {
        eprintln!("incomplete run: missing is {missing}");
    }
    let verdicts = report::judge(&run);
    let written = report::write_run(&run, &verdicts)?;
    print(&format!("{}\n{}\n", written.verdict, written.page.display()))
}

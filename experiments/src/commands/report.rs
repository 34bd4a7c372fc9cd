//! `report`: writes the report of a run again, from the stored rows.

use anyhow::Result;

use super::print;
use crate::cli::ReportArgs;
use crate::report;

/// Writes the report in both formats, and prints its verdict and the file name of the HTML report.
pub(crate) fn run(args: &ReportArgs) -> Result<()> {
    let run = report::read_run(&args.run)?;
    super::check_writable(&args.run)?;
    for missing in &run.missing {
        eprintln!("incomplete run; missing: {missing}");
    }
    let verdicts = report::judge(&run);
    let written = report::write_run(&run, &verdicts)?;
    print(&format!("{}\n{}\n", written.verdict, written.page.display()))
}

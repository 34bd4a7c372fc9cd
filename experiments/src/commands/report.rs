//! `report`: writes the report of a run again from its stored rows.

use anyhow::Result;

use super::print;
use crate::cli::ReportArgs;
use crate::report;

/// Writes the report as HTML and Markdown. Prints its verdict and the path of the HTML file.
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

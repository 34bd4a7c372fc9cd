//! `stability`: every kernel at its extremes, against f64.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use kernels::gpu::Gpu;
use kernels::picture::write_whole;

use super::{Reporter, check_interrupted, check_writable, print, watch_interrupts};
use crate::cli::StabilityArgs;
use crate::report::stability as report;
use crate::stability::extremes::{DEFAULT_TEXT, Extremes};
use crate::stability::kernels::{self as lab, Finding};

/// Measures, and writes a table and its report.
pub(crate) fn run(args: &StabilityArgs) -> Result<()> {
    let extremes = match &args.extremes {
        None => Extremes::parse(DEFAULT_TEXT, "the built-in table")?,
        Some(file) => {
            let text = fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))?;
            Extremes::parse(&text, &file.display().to_string())?
        }
    };
    fs::create_dir_all(&args.out).with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    check_writable(&args.out)?;
    watch_interrupts()?;
    let gpu = Gpu::new()?;
    let reporter = Reporter::new();
    let progress = |kernel: &str, done: usize, total: usize| {
        reporter.report(kernel, done as u64, total as u64);
        check_interrupted()
    };
    let findings = lab::measure(&extremes, &gpu, 1.0, progress)?;
    reporter.finish();
    // Each row is found by every measure of its kernel.
    let rows: BTreeMap<_, usize> =
        findings.iter().map(|finding| ((&finding.kernel, &finding.parameter, finding.value.to_bits()), finding.rows)).collect();
    let facts = [
        ("Adapter", gpu.info.name.clone()),
        ("Driver", gpu.info.driver_info.clone()),
        ("Rows", rows.values().sum::<usize>().to_string()),
        ("Truth", "the references in f64, of arguments rounded to f32".to_owned()),
    ];
    let text = report::text(&findings, &facts);
    write(&args.out, "results.csv", &csv(&findings)?)?;
    write(&args.out, "report.md", text.as_bytes())?;
    write(&args.out, "report.html", report::page(&findings, &facts)?.as_bytes())?;
    let failing: Vec<&Finding> = findings.iter().filter(|finding| !finding.pass).collect();
    print(&format!("{text}\n  report: {}\n", args.out.join("report.html").display()))?;
    if let Some(first) = failing.first() {
        let Finding { kernel, parameter, value, on, .. } = first;
        ensure!(false, "{} of {} findings fail, the first: {kernel} at {parameter} = {value} on {on}", failing.len(), findings.len());
    }
    Ok(())
}

/// Three significant digits, so that a difference between two tables is one of kernels.
fn csv(findings: &[Finding]) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for finding in findings {
        let rounded = |x: f64| format!("{x:.2e}").parse::<f64>().unwrap_or(x);
        writer.serialize(Finding {
            of_tolerance: rounded(finding.of_tolerance),
            worst_ulp: rounded(finding.worst_ulp),
            typical_ulp: rounded(finding.typical_ulp),
            worst: rounded(finding.worst),
            typical: rounded(finding.typical),
            ..finding.clone()
        })?;
    }
    writer.into_inner().context("the table cannot be made")
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    let file = folder.join(name);
    write_whole(&file, |temporary| fs::write(temporary, bytes).map_err(|source| kernels::error::Error::File { file: file.clone(), source }))
        .with_context(|| format!("cannot write {}", file.display()))
}

//! `stability`: compares kernels at extreme values with their references in f64. Also tests stored directions, derivatives, hashes and noise against
//! values that follow from theory, or that were published or recorded.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use kernels::base::files::write_whole;
use kernels::gpu::Gpu;
use serde::Serialize;

use super::{Reporter, check_writable, print};
use crate::cli::{Part, StabilityArgs};
use crate::process::{check_interrupted, watch_interrupts};
use crate::report::stability::{self as report, Lab};
use crate::stability::extremes::{DEFAULT_TEXT, Extremes};
use crate::stability::kernels::{self as kernel_lab, Finding};
use crate::stability::{Row, directions, motion, noise};

/// Runs the requested tests, and writes their tables and the report.
pub(crate) fn run(args: &StabilityArgs) -> Result<()> {
    let extremes = match &args.extremes {
        None => Extremes::parse(DEFAULT_TEXT, "the built-in table")?,
        Some(file) => {
            let text = fs::read_to_string(file)
                .map_err(|error| anyhow!("cannot read {}: {error}; give the file of a table of extremes", file.display()))?;
            Extremes::parse(&text, &file.display().to_string())?
        }
    };
    let parts: &[Part] = match (&args.only[..], &args.extremes) {
        ([], None) => &Part::ALL,
        // A table of extremes only affects kernels, so only kernels are tested if the user gives a table.
        ([], Some(_)) => &[Part::Kernels],
        (only, _) => only,
    };
    fs::create_dir_all(&args.out)
        .map_err(|error| anyhow!("cannot make the folder {}: {error}; choose a different folder with --out", args.out.display()))?;
    check_writable(&args.out)?;
    watch_interrupts()?;
    let reporter = Reporter::new();
    let mut facts = Vec::new();
    let mut findings = Vec::new();
    if parts.contains(&Part::Kernels) {
        let gpus = if args.every_adapter { Gpu::every()? } else { vec![Gpu::new()?] };
        for gpu in &gpus {
            facts.push(("Adapter", format!("{}, {}", gpu.info.name, gpu.info.driver_info)));
        }
        let progress = |kernel: &str, done: usize, total: usize| {
            reporter.report(kernel, done as u64, total as u64);
            check_interrupted()
        };
        findings = kernel_lab::measure(&extremes, &gpus.iter().collect::<Vec<_>>(), 1.0, progress)?;
        // The findings contain each row several times: for each measure and each device. Here each row is counted only once.
        let rows: BTreeMap<_, usize> =
            findings.iter().map(|finding| ((&finding.kernel, &finding.parameter, finding.value.to_bits()), finding.rows)).collect();
        facts.push(("Rows", rows.values().sum::<usize>().to_string()));
        facts.push(("Truth", "the references in f64, computed from arguments rounded to f32".to_owned()));
    }
    let of_part = |part: Part, name: &str, rows: fn() -> Vec<Row>| {
        if !parts.contains(&part) {
            return Ok(Vec::new());
        }
        reporter.report(name, 0, 1);
        let rows = rows();
        check_interrupted().map(|()| rows)
    };
    let directions = of_part(Part::Directions, "directions and derivatives", directions::rows)?;
    let noise = of_part(Part::Noise, "hashes and noise", noise::rows)?;
    let motion = of_part(Part::Noise, "noise in motion", motion::rows)?;
    reporter.finish();

    let bends = if parts.contains(&Part::Kernels) { &extremes.bends[..] } else { &[] };
    let lab = Lab { findings: &findings, bends, directions: &directions, noise: &noise, motion: &motion };
    let text = report::text(&lab, &facts);
    // The contents of all files are computed before the first file is written. If a computation fails, earlier files stay unchanged.
    let files = [
        ("results.csv", csv(findings.iter().map(shortened))?),
        ("directions.csv", csv(directions.iter().map(Row::shortened))?),
        ("noise.csv", csv(motion.iter().map(motion::recorded))?),
        ("report.md", text.clone().into_bytes()),
        ("report.html", report::page(&lab, &facts)?.into_bytes()),
    ];
    for (name, bytes) in files.iter().filter(|(_, bytes)| !bytes.is_empty()) {
        write(&args.out, name, bytes)?;
    }
    print(&format!("{text}\n  report: {}\n", args.out.join("report.html").display()))?;

    let failing: Vec<&Finding> = findings.iter().filter(|finding| !finding.pass).collect();
    if let Some(first) = failing.first() {
        let Finding { kernel, parameter, value, on, adapter, .. } = first;
        let on = if adapter.is_empty() { on } else { adapter };
        bail!("{} of {} findings fail, the first: {kernel} at {parameter} = {value} on {on}", failing.len(), findings.len());
    }
    let wrong: Vec<&Row> = [&directions, &noise, &motion].into_iter().flatten().filter(|row| !row.holds()).collect();
    ensure!(
        wrong.is_empty(),
        "{} numbers are out of their ranges, the first: {}",
        wrong.len(),
        wrong.first().map_or_else(String::new, |row| row.to_string())
    );
    Ok(())
}

/// Returns the finding with its errors rounded to three significant digits. Small differences between devices in the last digits then
/// rarely change the recorded table.
fn shortened(finding: &Finding) -> Finding {
    let rounded = |x: f64| format!("{x:.2e}").parse::<f64>().unwrap_or(x);
    Finding {
        of_tolerance: rounded(finding.of_tolerance),
        worst_ulp: rounded(finding.worst_ulp),
        typical_ulp: rounded(finding.typical_ulp),
        worst: rounded(finding.worst),
        typical: rounded(finding.typical),
        ..finding.clone()
    }
}

fn csv(rows: impl Iterator<Item = impl Serialize>) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    writer.into_inner().context("cannot complete the CSV table")
}

fn write(folder: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    let file = folder.join(name);
    write_whole(&file, |temporary| {
        fs::write(temporary, bytes).map_err(|source| kernels::base::error::Error::File { file: file.clone(), source })
    })
    .with_context(|| format!("cannot write {}", file.display()))
}

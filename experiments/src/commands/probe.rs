//! `probe`: evaluates a shared function for each row of a CSV table. Shared functions exist in WGSL and in Rust.

use std::fmt::Write as _;
use std::fs::File;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use kernels::base::files::write_whole;
use kernels::gpu::Gpu;
use kernels::probe::{Column, PROBES, Probe};
use serde::Serialize;

use super::{check_output_file, print, print_json};
use crate::cli::{On, ProbeArgs};

#[derive(Serialize)]
struct Listed {
    name: &'static str,
    about: &'static str,
    inputs: &'static [Column],
    outputs: &'static [Column],
}

/// A table that was read from CSV: its text, and the values of the columns that the probe needs.
struct Table {
    header: csv::StringRecord,
    rows: Vec<csv::StringRecord>,
    /// The values of the probe's input columns, row by row. Their order is that of the probe's list of columns.
    values: Vec<f64>,
}

/// Lists the probes, or evaluates one.
pub(crate) fn run(args: &ProbeArgs) -> Result<()> {
    if args.list {
        return list(args.json);
    }
    let (Some(kernel), Some(input), Some(output)) = (&args.kernel, &args.input, &args.output) else {
        bail!("give KERNEL, --input and --output, or --list");
    };
    let probe = Probe::find(kernel).map_err(|error| anyhow!("{error} (`probe --list` prints them all)"))?;
    check_output_file(output)?;
    if let (Ok(from), Ok(to)) = (input.canonicalize(), output.canonicalize())
        && from == to
    {
        bail!("--output {} is the input, which would be lost: give a different file", output.display());
    }
    let table = read(input, probe)?;
    // Each result is written with as few digits as possible, so that it is read back as the same number in the precision of the evaluation.
    #[allow(clippy::cast_possible_truncation, reason = "these are numbers of f32")]
    let single = |(x, column): (&f64, &Column)| if column.is_word() { x.to_string() } else { (*x as f32).to_string() };
    let in_single = |results: &[f64]| results.iter().zip(probe.outputs.iter().cycle()).map(single).collect();
    let results: Vec<String> = match args.on {
        On::F64 => probe.on_f64(&table.values).iter().map(ToString::to_string).collect(),
        On::F32 => in_single(&probe.on_f32(&table.values)),
        On::Gpu => in_single(&probe.on_gpu(&Gpu::new()?, &table.values)?),
    };
    write(output, probe, &table, &results)
}

fn list(json: bool) -> Result<()> {
    if json {
        let all = PROBES.iter().map(|p| Listed { name: p.name, about: p.about, inputs: p.inputs, outputs: p.outputs });
        return print_json(&all.collect::<Vec<_>>());
    }
    let mut text = String::new();
    // Writing into a String cannot fail.
    for probe in PROBES {
        let _ = writeln!(text, "{}\n  {}", probe.name, probe.about);
        for (title, columns) in [("in ", probe.inputs), ("out", probe.outputs)] {
            for column in columns {
                let whole = column.whole.map_or_else(String::new, |[low, high]| format!(" (whole, {low} to {high})"));
                let _ = writeln!(text, "    {title} {:<12} {}{whole}", column.name, column.unit);
            }
        }
    }
    text.push_str("\nValues are rounded to f32 for --on f32 and --on gpu, except words (whole, 0 to 4294967295).\n");
    print(&text)
}

fn read(path: &Path, probe: &Probe) -> Result<Table> {
    let name = path.display();
    let file = File::open(path).map_err(|error| anyhow!("cannot open the table {name}: {error}; correct --input"))?;
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(file);
    let header = reader.headers().map_err(|error| anyhow!("{name}: {}", explain(&error)))?.clone();
    let expected = || probe.inputs.iter().map(|column| column.name).collect::<Vec<_>>().join(",");
    if header.is_empty() {
        bail!("{name} is empty: give a header and rows; `{}` takes the columns {}", probe.name, expected());
    }
    let mut places = Vec::new();
    for column in probe.inputs {
        let mut found = header.iter().enumerate().filter(|(_, title)| *title == column.name).map(|(place, _)| place);
        let Some(place) = found.next() else {
            bail!("{name} has no column `{}`: `{}` takes the columns {}", column.name, probe.name, expected());
        };
        if found.next().is_some() {
            bail!("{name} has more than one column `{}`: keep one", column.name);
        }
        places.push((place, column));
    }
    if let Some(column) = probe.outputs.iter().find(|column| header.iter().any(|title| title == column.name)) {
        bail!("{name} already has a column `{}`, which is a result of `{}`: rename or remove it", column.name, probe.name);
    }
    let (mut rows, mut values) = (Vec::new(), Vec::new());
    for record in reader.records() {
        let record = record.map_err(|error| anyhow!("{name}: {}", explain(&error)))?;
        let line = record.position().map_or(0, csv::Position::line);
        for &(place, column) in &places {
            let cell = &record[place];
            let Ok(value) = cell.parse::<f64>() else {
                let what = if cell.is_empty() { "is empty".to_owned() } else { format!("`{cell}` is not a number") };
                bail!("{name}, line {line}, column `{}`: {what}: write a number, nan, inf or -inf", column.name);
            };
            column.accepts(value).map_err(|what| anyhow!("{name}, line {line}: {what}"))?;
            values.push(value);
        }
        rows.push(record);
    }
    if rows.is_empty() {
        bail!("{name} has a header and no rows: there is nothing to evaluate");
    }
    Ok(Table { header, rows, values })
}

fn explain(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos, expected_len, len } => {
            let line = pos.as_ref().map_or(0, csv::Position::line);
            format!("line {line} has {len} cells, but the header has {expected_len}: give a cell for each column")
        }
        csv::ErrorKind::Utf8 { pos, .. } => {
            format!("line {} is not UTF-8 text: give a CSV table in UTF-8", pos.as_ref().map_or(0, csv::Position::line))
        }
        _ => error.to_string(),
    }
}

/// Writes the table with its results. The file is written completely or not at all.
fn write(path: &Path, probe: &Probe, table: &Table, results: &[String]) -> Result<()> {
    write_whole(path, |temporary| -> Result<()> {
        let mut writer = csv::Writer::from_path(temporary)?;
        writer.write_record(table.header.iter().chain(probe.outputs.iter().map(|column| column.name)))?;
        for (row, made) in table.rows.iter().zip(results.chunks_exact(probe.outputs.len())) {
            writer.write_record(row.iter().chain(made.iter().map(String::as_str)))?;
        }
        Ok(writer.flush()?)
    })
    .with_context(|| format!("cannot write the table {}", path.display()))
}

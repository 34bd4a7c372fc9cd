//! `probe`: evaluates a shared function for each row of a CSV table. Shared functions exist in WGSL and in Rust.

mod text;

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail};
use kernels::base::error::one_line;
use kernels::base::files::write_whole;
use kernels::gpu::Gpu;
use kernels::probe::{Column, PROBES, Probe};
use serde::Serialize;

use self::text::Text;
use super::{check_output_file, print, print_json};
use crate::cli::{On, ProbeArgs};

/// Limit of the number of characters of a table's header in an error message.
const HEADER: usize = 200;

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
    /// Descriptions of how the table differs from the standard form, which is UTF-8 text with decimal points, and with commas between
    /// cells; empty if it does not differ.
    differs: Vec<String>,
}

/// Whether the numbers of a table have decimal points or decimal commas.
#[derive(Default)]
struct Decimals {
    /// The first line with a decimal point.
    point: Option<u64>,
    /// The first line with a decimal comma.
    comma: Option<u64>,
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
    // Each result is written with the fewest significant digits from which the same number is read back in the precision of the evaluation.
    #[allow(clippy::cast_possible_truncation, reason = "these are numbers of f32")]
    let single = |(x, column): (&f64, &Column)| if column.is_word() { x.to_string() } else { (*x as f32).to_string() };
    let in_single = |results: &[f64]| results.iter().zip(probe.outputs.iter().cycle()).map(single).collect();
    let results: Vec<String> = match args.on {
        On::F64 => probe.on_f64(&table.values).iter().map(ToString::to_string).collect(),
        On::F32 => in_single(&probe.on_f32(&table.values)),
        On::Gpu => in_single(&probe.on_gpu(&Gpu::new()?, &table.values)?),
    };
    write(output, probe, &table, &results)?;
    if table.differs.is_empty() {
        return Ok(());
    }
    let (read, written) = (input.display(), output.display());
    print(&format!("{read} was read with {}; {written} has decimal points, and commas between cells\n", table.differs.join(", ")))
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
    let columns: Vec<&str> = probe.inputs.iter().map(|column| column.name).collect();
    let text = Text::read(path, &columns)?;
    let mut reader = csv::ReaderBuilder::new().delimiter(text.delimiter).trim(csv::Trim::All).from_reader(text.body.as_bytes());
    let header = reader.headers().map_err(|error| anyhow!("{name}: {}", explain(&error, &text)))?.clone();
    let expected = || columns.join(",");
    if header.is_empty() {
        bail!("{name} is empty: give a header and rows; `{}` takes the columns {}", probe.name, expected());
    }
    let mut places = Vec::new();
    for column in probe.inputs {
        let mut found = header.iter().enumerate().filter(|(_, title)| *title == column.name).map(|(place, _)| place);
        let Some(place) = found.next() else {
            let there: String = one_line(&header.iter().collect::<Vec<_>>().join(", ")).chars().take(HEADER).collect();
            bail!(
                "{name} has no column `{}`: separated by {}, its columns are {there}; `{}` takes the columns {}",
                column.name,
                text.delimiter_words(),
                probe.name,
                expected()
            );
        };
        if found.next().is_some() {
            bail!("{name} has more than one column `{}`: keep one", column.name);
        }
        places.push((place, column));
    }
    if let Some(column) = probe.outputs.iter().find(|column| header.iter().any(|title| title == column.name)) {
        bail!("{name} already has a column `{}`, which is a result of `{}`: rename or remove it", column.name, probe.name);
    }
    let (mut rows, mut values, mut decimals) = (Vec::new(), Vec::new(), Decimals::default());
    for record in reader.records() {
        let mut record = record.map_err(|error| anyhow!("{name}: {}", explain(&error, &text)))?;
        let line = text.lines_before + record.position().map_or(0, csv::Position::line);
        let mut has_commas = false;
        for &(place, column) in &places {
            let cell = &record[place];
            let at = || format!("{name}, line {line}, column `{}`", column.name);
            let (value, has_comma) = number(cell, text.delimiter).map_err(|what| anyhow!("{}: {what}", at()))?;
            decimals.note(cell, has_comma, line).map_err(|what| anyhow!("{name}: {what}"))?;
            has_commas |= has_comma;
            column.accepts(value).map_err(|what| anyhow!("{name}, line {line}: {what}"))?;
            values.push(value);
        }
        if has_commas {
            let is_number = |place: usize| places.iter().any(|(number, _)| *number == place);
            let with_points = |(place, cell): (usize, &str)| if is_number(place) { cell.replace(',', ".") } else { cell.to_owned() };
            record = record.iter().enumerate().map(with_points).collect();
        }
        rows.push(record);
    }
    if rows.is_empty() {
        bail!("{name} has a header and no rows: there is nothing to evaluate");
    }
    let differs = [
        text.is_utf16.then(|| "UTF-16 text".to_owned()),
        (text.delimiter != b',').then(|| format!("{} between cells", text.delimiter_words())),
        decimals.comma.map(|_| "decimal commas".to_owned()),
    ];
    Ok(Table { header, rows, values, differs: differs.into_iter().flatten().collect() })
}

/// Parses a number. Also returns whether it has a decimal comma. Decimal commas are accepted only if `;` separates the cells, as in tables
/// of spreadsheets whose decimal sign is a comma. In other tables, the comma in `1,234` could also separate thousands.
fn number(cell: &str, delimiter: u8) -> Result<(f64, bool), String> {
    if let Ok(value) = cell.parse() {
        return Ok((value, false));
    }
    let with_point = cell.replacen(',', ".", 1);
    match with_point.parse() {
        Ok(value) if delimiter == b';' => Ok((value, true)),
        Ok(_) => Err(format!("`{cell}` has a decimal comma: write {with_point}, or separate cells by `;`")),
        Err(_) if cell.is_empty() => Err("is empty: write a number, nan, inf or -inf".to_owned()),
        Err(_) => Err(format!("`{}` is not a number: write a number, nan, inf or -inf", one_line(cell))),
    }
}

impl Decimals {
    /// Records which decimal sign a number has.
    ///
    /// # Errors
    /// The table contains both decimal points and decimal commas. One of the two could be a separator of thousands.
    fn note(&mut self, cell: &str, has_comma: bool, line: u64) -> Result<(), String> {
        if has_comma {
            self.comma.get_or_insert(line);
        } else if cell.contains('.') {
            self.point.get_or_insert(line);
        }
        match (self.point, self.comma) {
            (Some(point), Some(comma)) => {
                Err(format!("line {point} has a decimal point, and line {comma} a decimal comma: use one of them in the whole table"))
            }
            _ => Ok(()),
        }
    }
}

fn explain(error: &csv::Error, text: &Text) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths { pos, expected_len, len } => {
            let line = text.lines_before + pos.as_ref().map_or(0, csv::Position::line);
            let hint =
                if text.delimiter == b',' && len > expected_len { "; a decimal comma begins a new cell: write decimal points" } else { "" };
            format!(
                "line {line} has {len} cells (separated by {}), but the header has {expected_len}: give a cell for each column{hint}",
                text.delimiter_words()
            )
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

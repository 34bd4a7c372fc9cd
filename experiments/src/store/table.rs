//! Stores rows in files: as Parquet for programs, and as CSV for people and spreadsheets. Both formats store every number exactly, including NaN.
//!
//! The bytes of a file depend only on its groups of rows, its notes and the version of the program, because it contains neither a date nor a machine
//! name. The Parquet format does not require checksums. The metadata of a Parquet file therefore contain a checksum of all values, with which damaged
//! files are recognised and refused.

use std::collections::BTreeMap;
use std::fs::File;
use std::hash::Hasher;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail};
use kernels::base::error::{Error, one_line};
use kernels::base::files::write_whole;
use parquet::basic::Type;
use parquet::column::page::Page;
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, Int32Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::reader::{ChunkReader, FileReader, RowGroupReader, SerializedFileReader};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;
use twox_hash::XxHash64;

use crate::process::quietly;
use crate::row::{COLUMNS, Column, Field, Row};

/// Version of the columns and their meanings. Files of other versions are refused.
pub const SCHEMA: &str = "2";

const NOTE_SCHEMA: &str = "scree.schema";
const NOTE_ROWS: &str = "scree.rows";
const NOTE_CHECKSUM: &str = "scree.xxhash64";

/// Describes tables of another schema, with the remedy. A damaged note about the schema cannot be distinguished from the note of another version, so
/// the sentence names both causes.
pub(super) fn other_schema(schema: &str) -> String {
    let schema: String = one_line(schema).chars().take(20).collect();
    format!(
        "its schema is {schema}, but this version reads schema {SCHEMA}: another version wrote it, or it is damaged; repeat the run with another --out, or \
         read it with the version that wrote it"
    )
}

/// Number of values that are read from a column at once.
const BATCH: usize = 1 << 16;

/// The rows of a file, and its notes, which are key-value metadata.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// The rows, in the file's order.
    pub rows: Vec<Row>,
    /// The notes by name. They do not include the notes that every file has: schema, number of rows, checksum.
    pub notes: BTreeMap<String, String>,
}

/// Groups of rows. They are produced one after another, so that a file can be larger than the memory.
pub type Groups<'a> = &'a mut dyn Iterator<Item = Result<Vec<Row>>>;

/// Computes the checksum of all rows: the xxHash64 of every value in order.
struct Checksum {
    hasher: XxHash64,
    rows: u64,
}

impl Checksum {
    fn new() -> Checksum {
        Checksum { hasher: XxHash64::with_seed(0), rows: 0 }
    }

    fn add(&mut self, rows: &[Row]) {
        let number = |hasher: &mut XxHash64, value: Option<u64>| {
            hasher.write(&[u8::from(value.is_some())]);
            hasher.write(&value.unwrap_or(0).to_le_bytes());
        };
        self.rows += rows.len() as u64;
        for row in rows {
            for column in &COLUMNS {
                match column.field {
                    Field::Text(get, _) => {
                        let text = get(row).as_bytes();
                        number(&mut self.hasher, Some(text.len() as u64));
                        self.hasher.write(text);
                    }
                    Field::Count(get, _) => number(&mut self.hasher, get(row).map(u64::from)),
                    Field::Number(get, _) => number(&mut self.hasher, get(row).map(f64::to_bits)),
                    Field::Value(get, _) => number(&mut self.hasher, Some(get(row).to_bits())),
                }
            }
        }
    }

    fn notes(&self) -> [(String, String); 3] {
        let note = |name: &str, value: String| (name.to_owned(), value);
        [
            note(NOTE_SCHEMA, SCHEMA.to_owned()),
            note(NOTE_ROWS, self.rows.to_string()),
            note(NOTE_CHECKSUM, format!("{:016x}", self.hasher.finish())),
        ]
    }
}

/// Writes each item of `groups` that has rows as a row group of the file. Then writes the notes.
///
/// # Errors
/// A group cannot be produced, or the disk fails. The file is then absent, or unchanged if it existed before.
pub fn write_parquet(file: &Path, groups: Groups<'_>, notes: &[(String, String)]) -> Result<()> {
    write_with(file, |output| {
        let fields: String = COLUMNS.iter().map(declaration).collect();
        let schema = parse_message_type(&format!("message rows {{ {fields} }}")).map_err(failure)?;
        let properties = WriterProperties::builder()
            .set_created_by(concat!("scree ", env!("CARGO_PKG_VERSION")).to_owned())
            .set_statistics_enabled(EnabledStatistics::None)
            .set_offset_index_disabled(true)
            .build();
        let mut writer = SerializedFileWriter::new(output, Arc::new(schema), Arc::new(properties)).map_err(failure)?;
        let mut checksum = Checksum::new();
        for rows in groups {
            let rows = rows.map_err(|error| io::Error::other(format!("{error:#}")))?;
            if rows.is_empty() {
                continue;
            }
            checksum.add(&rows);
            let mut group = writer.next_row_group().map_err(failure)?;
            for column in &COLUMNS {
                let mut target = group.next_column().map_err(failure)?.ok_or_else(|| io::Error::other("a column is missing"))?;
                match column.field {
                    Field::Text(get, _) => {
                        let values: Vec<ByteArray> = rows.iter().map(|row| ByteArray::from(get(row))).collect();
                        target.typed::<ByteArrayType>().write_batch(&values, None, None)
                    }
                    Field::Count(get, _) => {
                        let levels: Vec<i16> = rows.iter().map(|row| i16::from(get(row).is_some())).collect();
                        let values: Vec<i32> = rows.iter().filter_map(get).map(u32::cast_signed).collect();
                        target.typed::<Int32Type>().write_batch(&values, Some(&levels), None)
                    }
                    Field::Number(get, _) => {
                        let levels: Vec<i16> = rows.iter().map(|row| i16::from(get(row).is_some())).collect();
                        let values: Vec<f64> = rows.iter().filter_map(get).collect();
                        target.typed::<DoubleType>().write_batch(&values, Some(&levels), None)
                    }
                    Field::Value(get, _) => {
                        let values: Vec<f64> = rows.iter().map(get).collect();
                        target.typed::<DoubleType>().write_batch(&values, None, None)
                    }
                }
                .map_err(failure)?;
                target.close().map_err(failure)?;
            }
            group.close().map_err(failure)?;
        }
        for (name, value) in checksum.notes().into_iter().chain(notes.iter().cloned()) {
            writer.append_key_value_metadata(KeyValue::new(name, value));
        }
        writer.close().map_err(failure)?;
        Ok(())
    })
}

fn declaration(column: &Column) -> String {
    let name = column.name;
    match column.field {
        Field::Text(..) => format!("REQUIRED BYTE_ARRAY {name} (STRING); "),
        Field::Count(..) => format!("OPTIONAL INT32 {name} (INTEGER(32,false)); "),
        Field::Number(..) => format!("OPTIONAL DOUBLE {name}; "),
        Field::Value(..) => format!("REQUIRED DOUBLE {name}; "),
    }
}

/// Writes rows as CSV with a header.
///
/// # Errors
/// See [`write_parquet`].
pub fn write_csv(file: &Path, groups: Groups<'_>) -> Result<()> {
    write_with(file, |output| {
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(output);
        writer.write_record(COLUMNS.map(|column| column.name))?;
        for rows in groups {
            for row in rows.map_err(|error| io::Error::other(format!("{error:#}")))? {
                writer.serialize(row)?;
            }
        }
        writer.flush()
    })
}

/// Writes a file completely or not at all. The file is flushed to the disk before it gets its final name.
pub(crate) fn write_with(file: &Path, write: impl FnOnce(&mut (dyn Write + Send)) -> io::Result<()>) -> Result<()> {
    let done = write_whole(file, |temporary| {
        let written = (|| {
            let mut output = BufWriter::new(File::create(temporary)?);
            write(&mut output)?;
            output.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()
        })();
        written.map_err(|source| Error::File { file: file.to_owned(), source })
    });
    done.map_err(|error| match error {
        Error::File { source, .. } => anyhow!("cannot write {}: {source}: make room if the disk is full", file.display()),
        other => anyhow!("cannot write {}: {other}", file.display()),
    })
}

/// Converts an error of the Parquet library. If it contains an error of the operating system, that error is returned.
fn failure(error: ParquetError) -> io::Error {
    match error {
        ParquetError::External(source) => match source.downcast::<io::Error>() {
            Ok(source) => *source,
            Err(source) => io::Error::other(source.to_string()),
        },
        other => io::Error::other(other.to_string()),
    }
}

/// Reads a file that [`write_parquet`] has written. Unknown columns are ignored.
///
/// # Errors
/// The message is one line. Possible causes: the file is not Parquet, is truncated or damaged, has a different schema version, lacks a column, has a
/// column of a different type, or contains values that do not match its checksum.
pub fn read_parquet(file: &Path) -> Result<Table> {
    decode_parquet(File::open(file).with_context(|| format!("cannot read {}", file.display()))?, file)
}

/// Reads the contents of a file that [`write_parquet`] has written. `file` is the name of the file in error messages.
///
/// # Errors
/// See [`read_parquet`].
pub fn decode_parquet(input: impl ChunkReader + 'static, file: &Path) -> Result<Table> {
    let damaged = |what: String| {
        let what = one_line(&what);
        anyhow!("{}: {what}: the file is damaged, or is not a result of a run; repeat the run, or restore a copy", file.display())
    };
    let reader = quietly(|| SerializedFileReader::new(input)).ok_or_else(|| damaged("its footer is inconsistent".to_owned()))?;
    let reader = reader.map_err(|error| damaged(format!("it is not a Parquet file ({error})")))?;
    // A damaged file can make the reader access an array beyond its bounds, so panics are caught.
    if let Some(schema) = quietly(|| schema_of(&reader)).flatten().filter(|schema| schema != SCHEMA) {
        bail!("{}: {}", file.display(), other_schema(&schema));
    }
    match quietly(|| read(&reader)) {
        Some(outcome) => outcome.map_err(|error| damaged(format!("{error:#}"))),
        None => Err(damaged("its pages are inconsistent".to_owned())),
    }
}

/// Returns the version of the columns of a file; `None` if the file has no note about this version.
fn schema_of(reader: &dyn FileReader) -> Option<String> {
    let notes = reader.metadata().file_metadata().key_value_metadata()?;
    notes.iter().find(|note| note.key == NOTE_SCHEMA)?.value.clone()
}

fn read(reader: &dyn FileReader) -> Result<Table> {
    let metadata = reader.metadata().file_metadata();
    let notes = metadata.key_value_metadata().into_iter().flatten();
    let mut notes: BTreeMap<String, String> = notes.map(|note| (note.key.clone(), note.value.clone().unwrap_or_default())).collect();
    let mut take = |name: &str| notes.remove(name).with_context(|| format!("the note `{name}` is missing"));
    let (_, count, checksum) = (take(NOTE_SCHEMA)?, take(NOTE_ROWS)?, take(NOTE_CHECKSUM)?);
    let description = metadata.schema_descr();
    let mut places = Vec::new();
    for column in &COLUMNS {
        let place = (0..description.num_columns()).find(|&i| description.column(i).path().string() == column.name);
        let place = place.with_context(|| format!("the column `{}` is missing", column.name))?;
        let (wanted, levels) = match column.field {
            Field::Text(..) => (Type::BYTE_ARRAY, 0),
            Field::Count(..) => (Type::INT32, 1),
            Field::Number(..) => (Type::DOUBLE, 1),
            Field::Value(..) => (Type::DOUBLE, 0),
        };
        let found = description.column(place);
        if found.physical_type() != wanted || found.max_def_level() != levels || found.max_rep_level() != 0 {
            bail!("the column `{}` has the wrong type; it must be {wanted}", column.name);
        }
        places.push(place);
    }
    // A damaged file can state any number of values. At most as many rows are read as the note about the number of rows states.
    let most: usize = count.parse().with_context(|| format!("`{count}` is not a number of rows"))?;
    let mut rows: Vec<Row> = Vec::new();
    for index in 0..reader.num_row_groups() {
        let group = reader.get_row_group(index).map_err(|error| anyhow!("row group {index}: {error}"))?;
        // The first column contains texts. The number of rows is the number of texts that are really read from it. A number in a damaged file must
        // not determine how much memory is allocated.
        let mut of_group: Vec<Row> = Vec::new();
        for (column, &place) in COLUMNS.iter().zip(&places) {
            let most = if place == places[0] { Some(most.saturating_sub(rows.len())) } else { None };
            read_column(group.as_ref(), column, place, most, &mut of_group)
                .with_context(|| format!("row group {index}, column `{}`", column.name))?;
        }
        rows.append(&mut of_group);
    }
    let mut found = Checksum::new();
    found.add(&rows);
    let [_, (_, found_count), (_, found_checksum)] = found.notes();
    if found_count != count || found_checksum != checksum {
        bail!("it has {found_count} rows with checksum {found_checksum}, but {count} rows with checksum {checksum} were written");
    }
    Ok(Table { rows, notes })
}

/// Reads a column into the rows of its group. For the first column, which creates the rows, `first` is the largest number of rows to create. For all
/// other columns, it is `None`.
fn read_column(group: &dyn RowGroupReader, column: &Column, place: usize, first: Option<usize>, rows: &mut Vec<Row>) -> Result<()> {
    check_dictionaries(group, place)?;
    let reader = group.get_column_reader(place)?;
    let most = first.unwrap_or(rows.len());
    match (column.field, reader) {
        (Field::Text(_, set), ColumnReader::ByteArrayColumnReader(mut reader)) => {
            let texts = values(&mut reader, false, most)?;
            if first.is_some() {
                rows.resize(texts.len(), Row::default());
            }
            fill(rows, texts, |row, text: Option<ByteArray>| {
                *set(row) = text.context("a text is absent")?.as_utf8()?.to_owned();
                Ok(())
            })
        }
        (Field::Count(_, set), ColumnReader::Int32ColumnReader(mut reader)) => {
            fill(rows, values(&mut reader, true, most)?, |row, value: Option<i32>| {
                *set(row) = value.map(i32::cast_unsigned);
                Ok(())
            })
        }
        (Field::Number(_, set), ColumnReader::DoubleColumnReader(mut reader)) => {
            fill(rows, values(&mut reader, true, most)?, |row, value| {
                *set(row) = value;
                Ok(())
            })
        }
        (Field::Value(_, set), ColumnReader::DoubleColumnReader(mut reader)) => {
            fill(rows, values(&mut reader, false, most)?, |row, value: Option<f64>| {
                *set(row) = value.context("a value is absent")?;
                Ok(())
            })
        }
        _ => bail!("it has a different type"),
    }
}

/// Refuses a dictionary that claims to contain more values than fit into its bytes. Otherwise the library would allocate memory for the claimed
/// number of values, which can be up to 2^31.
fn check_dictionaries(group: &dyn RowGroupReader, place: usize) -> Result<()> {
    let mut pages = group.get_column_page_reader(place)?;
    while let Some(page) = pages.get_next_page()? {
        // A value takes at least 4 bytes: those of an integer, or those of the length of a text.
        if let Page::DictionaryPage { buf, num_values, .. } = page
            && num_values as usize > buf.len() / 4
        {
            bail!("a dictionary claims to hold {num_values} values in {} bytes", buf.len());
        }
    }
    Ok(())
}

fn fill<T>(rows: &mut [Row], values: Vec<Option<T>>, set: impl Fn(&mut Row, Option<T>) -> Result<()>) -> Result<()> {
    if values.len() != rows.len() {
        bail!("{} values for {} rows", values.len(), rows.len());
    }
    rows.iter_mut().zip(values).try_for_each(|(row, value)| set(row, value))
}

/// Reads the values of a column of a row group. Fails if there are more than `most` values. If `optional` is true, absent values are included as
/// `None`.
fn values<T: DataType>(reader: &mut ColumnReaderImpl<T>, optional: bool, most: usize) -> Result<Vec<Option<T::T>>> {
    let mut all = Vec::new();
    loop {
        let (mut levels, mut values) = (Vec::new(), Vec::new());
        let (records, ..) = reader.read_records(BATCH, optional.then_some(&mut levels), None, &mut values)?;
        if records == 0 {
            return Ok(all);
        }
        let mut values = values.into_iter();
        if optional {
            all.extend(levels.into_iter().map(|level| if level == 0 { None } else { values.next() }));
        } else {
            all.extend(values.map(Some));
        }
        if all.len() > most {
            bail!("there are more than {most} values for {most} rows");
        }
    }
}

//! Tests how a run is read and resumed after files in its folder were damaged, exchanged or lost. A reader must then refuse the run in one
//! line that names the file, or return exactly the numbers of the undamaged run (of an interrupted run: those of the finished parts). It must never
//! accept other numbers. Nothing is rendered: a stand-in for the renderer makes up the measurements.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::Path;

use ::bytes::Bytes;
use ::experiments::definition::{self, Definition};
use ::experiments::row::Row;
use ::experiments::store::table::{SCHEMA, read_parquet, write_parquet};
use ::experiments::store::{Existing, Place, Run, RunData, read_run};
use ::experiments::unit::{Shard, plan};
use parquet::file::reader::{FileReader, SerializedFileReader};

use crate::fixtures::{Folder, failure};
use crate::measurer::{Fake, machine};

/// A run of 8 parts: for each of two views a reference (converged pictures), two sweeps (metrics) and a timing.
const TEXT: &str = r#"name = "trial"
question = "Are damaged files noticed?"
views = ["cliff", "ground"]
size = [64, 36]
frames = 3
variants = ["auto", "splat"]
noises = ["hashed"]
temporal = ["off", "exponential"]
metrics = ["rmse", "psnr", "flip_rate", "reference_se"]
times = "all"

[set]
"flavours.cliff_near_m" = 20.0
"#;

/// Number of finished parts of the interrupted run. The reference and the first sweep of the second view are finished. The second sweep,
/// which needs the same reference, is not.
const DONE: usize = 6;

/// The tables of a finished run.
const TABLES: [&str; 4] = ["metrics.parquet", "metrics.csv", "times.parquet", "times.csv"];

/// Largest number of bytes of a file that the tests change, one at a time.
const FLIPS: usize = 60;
/// Number of these changes for which the run is not only read but also resumed. The number is small, because resuming takes longer.
const RESUMED: usize = 6;

fn trial() -> Definition {
    definition::parse(TEXT, "trial.toml", Path::new(".")).expect("the trial definition is valid")
}

/// Returns the definition of a run that has the same parts as `trial`, but other numbers.
fn another() -> Definition {
    let text = TEXT.replace("cliff_near_m\" = 20.0", "cliff_near_m\" = 25.0");
    assert_ne!(text, TEXT);
    definition::parse(&text, "trial.toml", Path::new(".")).expect("the changed definition is valid")
}

// ---- Making runs. ----

fn open(definition: &Definition, run: &Path, existing: Existing) -> anyhow::Result<Run> {
    Run::open(definition, &Place { out: run, own: true, existing, shard: None, small: false }, &machine())
}

/// Carries out at most `parts` of the missing parts.
fn carry_out(run: &mut Run, definition: &Definition, parts: usize) {
    let left = Cell::new(parts);
    let go_on = || -> anyhow::Result<()> {
        anyhow::ensure!(left.get() > 0, "stopped");
        left.set(left.get() - 1);
        Ok(())
    };
    let outcome = run.carry_out(&mut Fake { times_repeat: true, ..Fake::of(definition) }, &|_, _| {}, &go_on);
    let (done, all) = run.progress();
    assert!(outcome.is_ok() == (done == all), "{done} of {all} parts: {outcome:?}");
}

/// Opens a run with `Existing::Resume` and finishes it. Panics if something fails after the run was opened.
fn resume(definition: &Definition, run: &Path) -> anyhow::Result<RunData> {
    let mut run = open(definition, run, Existing::Resume)?;
    carry_out(&mut run, definition, usize::MAX);
    Ok(run.finish().expect("a run that was opened can be finished"))
}

/// The contents of all files of a folder and its subfolders. The keys are paths relative to the folder.
type Files = BTreeMap<String, Vec<u8>>;

fn files_of(folder: &Path) -> Files {
    let mut files = Files::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        if path.is_dir() {
            files.extend(files_of(&path).into_iter().map(|(below, bytes)| (format!("{name}/{below}"), bytes)));
        } else {
            files.insert(name, fs::read(&path).expect("readable"));
        }
    }
    files
}

/// Makes a folder that holds these files and nothing else. The files are made in the order of the iterator.
fn make<'a>(folder: &Path, files: impl Iterator<Item = (&'a String, &'a Vec<u8>)>) {
    if folder.exists() {
        fs::remove_dir_all(folder).expect("can be removed");
    }
    fs::create_dir_all(folder).expect("can be made");
    for (name, bytes) in files {
        let file = folder.join(name);
        fs::create_dir_all(file.parent().expect("a folder")).expect("can be made");
        fs::write(file, bytes).expect("writable");
    }
}

/// The numbers and tables of an undamaged run.
struct Truth {
    rows: Vec<Row>,
    times: Vec<Row>,
    tables: [Vec<u8>; 4],
}

/// Makes a finished run. Returns its numbers and tables, and all its files.
fn finished(definition: &Definition, run: &Path) -> (Truth, Files) {
    let mut begun = open(definition, run, Existing::Refuse).expect("the run can be opened");
    carry_out(&mut begun, definition, usize::MAX);
    let data = begun.finish().expect("the run can be finished");
    let files = files_of(run);
    (Truth { rows: data.rows, times: data.times, tables: TABLES.map(|name| files[name].clone()) }, files)
}

/// Makes a run that was stopped after [`DONE`] parts. Returns its files.
fn interrupted(definition: &Definition, run: &Path) -> Files {
    let mut begun = open(definition, run, Existing::Refuse).expect("the run can be opened");
    carry_out(&mut begun, definition, DONE);
    drop(begun);
    files_of(run)
}

// ---- Comparing. ----

/// Whether both lists have the same rows. Numbers are compared bit by bit (NaN equals itself).
fn same(a: &[Row], b: &[Row]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.order(b).is_eq())
}

/// Whether all rows of `part` are in `whole`. Both lists must be sorted.
fn within(part: &[Row], whole: &[Row]) -> bool {
    let mut rest = whole.iter();
    part.iter().all(|row| rest.any(|other| row.order(other).is_eq()))
}

/// The outcome of reading the folder of a run.
#[derive(Debug, PartialEq)]
enum Seen {
    /// The run was refused, with this message.
    Refused(String),
    /// The numbers are those of the undamaged run.
    Same,
    /// The run is reported as incomplete, and every number that was read is also in the undamaged run.
    Part,
    /// The run was accepted, but its numbers differ from those of the undamaged run; or it was read as complete although parts are missing; or it was
    /// read as incomplete although no part is missing.
    Different,
}

impl Seen {
    fn of(read: anyhow::Result<RunData>, truth: &Truth) -> Seen {
        let data = match read {
            Ok(data) => data,
            Err(error) => return Seen::Refused(format!("{error:#}")),
        };
        if data.complete != data.missing.is_empty() {
            return Seen::Different;
        }
        match data.complete {
            true if same(&data.rows, &truth.rows) && same(&data.times, &truth.times) => Seen::Same,
            false if within(&data.rows, &truth.rows) && within(&data.times, &truth.times) => Seen::Part,
            _ => Seen::Different,
        }
    }
}

// ---- Damaging. ----

/// Returns at most `most` of the items, evenly spread.
fn spread<T: Clone>(items: &[T], most: usize) -> Vec<T> {
    items.iter().step_by(items.len().div_ceil(most).max(1)).cloned().collect()
}

/// Returns the positions between the records of a file: the ends of column chunks in a Parquet file, and the ends of lines in a text. For
/// other files, returns the positions after one third and two thirds.
fn borders(name: &str, bytes: &[u8]) -> Vec<usize> {
    let mut borders: Vec<usize> = if name.ends_with(".parquet") {
        let reader = SerializedFileReader::new(Bytes::copy_from_slice(bytes)).expect("a table");
        let chunks = reader.metadata().row_groups().iter().flat_map(|group| group.columns());
        chunks.map(|chunk| (chunk.byte_range().0 + chunk.byte_range().1) as usize).collect()
    } else if bytes.contains(&b'\n') {
        (1..bytes.len()).filter(|&at| bytes[at - 1] == b'\n').collect()
    } else {
        vec![bytes.len() / 3, bytes.len() * 2 / 3]
    };
    borders.retain(|&at| at > 0 && at < bytes.len());
    borders.sort_unstable();
    borders.dedup();
    borders
}

/// A damaged version of one file.
struct Damage {
    what: String,
    bytes: Vec<u8>,
    /// Whether the test also resumes the run with this damaged file.
    resumed: bool,
}

fn damages(name: &str, bytes: &[u8]) -> Vec<Damage> {
    let mut all: Vec<Damage> = Vec::new();
    let mut add = |what: String, bytes: Vec<u8>, resumed: bool| all.push(Damage { what, bytes, resumed });
    let borders = borders(name, bytes);
    for cut in [0, 1, bytes.len() / 2, bytes.len().saturating_sub(1)].into_iter().chain(spread(&borders, 4)) {
        add(format!("cut to {cut} bytes"), bytes[..cut.min(bytes.len())].to_vec(), true);
    }
    let places: Vec<usize> = (0..bytes.len()).collect();
    for (i, at) in spread(&places, FLIPS).into_iter().enumerate() {
        let mut flipped = bytes.to_vec();
        // XOR with these masks changes most digits into different digits.
        flipped[at] ^= [1, 2, 4][i % 3];
        add(format!("byte {at} changed"), flipped, i % (FLIPS / RESUMED) == 0);
    }
    let ends: Vec<usize> = std::iter::once(0).chain(borders).chain([bytes.len()]).collect();
    let blocks: Vec<Range<usize>> = ends.windows(2).map(|ends| ends[0]..ends[1]).collect();
    let replaced = |range: &Range<usize>, by: &[u8]| [&bytes[..range.start], by, &bytes[range.end..]].concat();
    let pairs: Vec<(Range<usize>, Range<usize>)> = blocks.windows(2).map(|pair| (pair[0].clone(), pair[1].clone())).collect();
    for (first, second) in spread(&pairs, 3) {
        let exchanged = [&bytes[second.clone()], &bytes[first.clone()]].concat();
        add(format!("{first:?} and {second:?} exchanged"), replaced(&(first.start..second.end), &exchanged), true);
    }
    for block in spread(&blocks, 3) {
        add(format!("{block:?} repeated"), replaced(&block, &bytes[block.clone()].repeat(2)), true);
        add(format!("{block:?} removed"), replaced(&block, &[]), true);
    }
    for garbage in [&b"\0"[..], b"\n7", b"PAR1"] {
        add(format!("followed by {garbage:?}"), [bytes, garbage].concat(), true);
    }
    all.retain(|damage| damage.bytes != bytes);
    all
}

/// The folder of a run that is damaged in many ways, one after another, and the expected results.
struct Bench<'a> {
    run: &'a Path,
    definition: &'a Definition,
    truth: &'a Truth,
    /// Whether the undamaged run is finished.
    is_finished: bool,
    refused: u32,
    accepted: u32,
}

impl Bench<'_> {
    /// Checks that a message is one line that names one of the files. If the file is a manifest, the message may name the run's folder instead,
    /// because the reader then finds no run or a different run in this folder.
    fn is_told(&mut self, what: &str, names: &[&str], message: &str) {
        let folder = self.run.display().to_string();
        let is_named = |name: &&str| {
            let own = name.rsplit('/').next().unwrap_or_default();
            message.contains(own) || own.starts_with("manifest.json") && message.contains(&folder)
        };
        assert!(message.lines().count() == 1 && names.iter().any(is_named), "{names:?}, {what}: {message:?}");
        self.refused += 1;
    }

    /// Reads a run with these files, and also resumes it if `resumed` is set. Checks both outcomes. `names` are the damaged files.
    fn try_files(&mut self, what: &str, names: &[&str], files: &Files, resumed: bool) {
        make(self.run, files.iter());
        match Seen::of(read_run(self.run), self.truth) {
            Seen::Refused(message) => self.is_told(what, names, &message),
            Seen::Same if self.is_finished => self.accepted += 1,
            Seen::Part if !self.is_finished => self.accepted += 1,
            seen => panic!("{names:?}, {what}: reading gives {seen:?}"),
        }
        if !resumed {
            return;
        }
        make(self.run, files.iter());
        match Seen::of(resume(self.definition, self.run), self.truth) {
            Seen::Refused(message) => self.is_told(what, names, &message),
            Seen::Same => {
                // The written tables must have the same bytes as those of the undamaged run. This includes the CSV tables, which `resume` does not
                // read.
                for (table, bytes) in TABLES.iter().zip(&self.truth.tables) {
                    assert!(fs::read(self.run.join(table)).expect("written") == *bytes, "{names:?}, {what}: {table} differs");
                }
                self.accepted += 1;
            }
            seen => panic!("{names:?}, {what}: resuming gives {seen:?}"),
        }
    }

    /// Damages every file in every way. `other` are the files of another run that is in the same state (finished or interrupted).
    fn try_all(&mut self, files: &Files, other: &Files) {
        for (name, bytes) in files {
            let with = |bytes: Option<Vec<u8>>| {
                let mut files = files.clone();
                files.remove(name);
                files.extend(bytes.map(|bytes| (name.clone(), bytes)));
                files
            };
            for Damage { what, bytes, resumed } in damages(name, bytes) {
                self.try_files(&what, &[name], &with(Some(bytes)), resumed);
            }
            self.try_files("removed", &[name], &with(None), true);
            let theirs = other.get(name).unwrap_or_else(|| panic!("the other run has no {name}"));
            self.try_files("of another run", &[name], &with(Some(theirs.clone())), true);
            let mut renamed = with(None);
            renamed.insert(format!("{name}.4711.tmp"), bytes.clone());
            self.try_files("not renamed yet", &[name], &renamed, true);
        }
        // Exchange two files that have the same file extension.
        let names: Vec<&String> = files.keys().collect();
        let kind = |name: &str| name.rsplit_once('.').map(|(_, extension)| extension.to_owned());
        for (i, first) in names.iter().enumerate() {
            for second in names[i + 1..].iter().filter(|second| kind(second) == kind(first)).take(2) {
                let mut exchanged = files.clone();
                exchanged.insert((*first).clone(), files[*second].clone());
                exchanged.insert((*second).clone(), files[*first].clone());
                self.try_files("exchanged", &[first, second], &exchanged, true);
            }
        }
    }
}

// ---- Tests. ----

#[test]
fn a_damaged_file_of_a_finished_run_is_refused_or_changes_nothing() {
    let folder = Folder::new("store-finished");
    let (trial, another) = (trial(), another());
    let (truth, files) = finished(&trial, &folder.0.join("one"));
    let (theirs, other) = finished(&another, &folder.0.join("other"));
    assert!(theirs.rows.len() == truth.rows.len() && theirs.times.len() == truth.times.len(), "the runs must have the same number of rows");
    assert!(truth.tables.iter().zip(&theirs.tables).all(|(one, other)| one != other), "the runs must have different numbers");
    let run = folder.0.join("damaged");
    let mut bench = Bench { run: &run, definition: &trial, truth: &truth, is_finished: true, refused: 0, accepted: 0 };
    bench.try_files("nothing", &[], &files, true);
    assert_eq!((bench.refused, bench.accepted), (0, 2));
    bench.try_all(&files, &other);
    // Replace a table by a valid table in which one number differs.
    make(&run, files.iter());
    let table = run.join("metrics.parquet");
    let mut rows = read_parquet(&table).expect("a table").rows;
    rows[0].value = rows[0].value.next_up();
    write_parquet(&table, &mut std::iter::once(Ok(rows)), &[]).expect("writable");
    bench.try_files("one number changed", &["metrics.parquet"], &files_of(&run), true);
    assert!(bench.refused > 250 && bench.accepted > 150, "{} refused, {} accepted", bench.refused, bench.accepted);
    // The command line reports a damaged file, too.
    let mut files = files;
    files.get_mut("metrics.csv").expect("there is one").truncate(100);
    make(&run, files.iter());
    failure(&["report", &run.display().to_string()], &["metrics.csv", "damaged"]);
}

#[test]
fn a_damaged_file_of_an_interrupted_run_is_refused_or_done_again() {
    let folder = Folder::new("store-interrupted");
    let (trial, another) = (trial(), another());
    let (truth, _) = finished(&trial, &folder.0.join("one"));
    let files = interrupted(&trial, &folder.0.join("two"));
    let other = interrupted(&another, &folder.0.join("other"));
    assert_eq!(files.keys().filter(|name| name.starts_with("parts/")).count(), DONE);
    assert_eq!(files.keys().filter(|name| name.starts_with("reference/")).count(), 4);
    let run = folder.0.join("damaged");
    let mut bench = Bench { run: &run, definition: &trial, truth: &truth, is_finished: false, refused: 0, accepted: 0 };
    bench.try_files("nothing", &[], &files, true);
    assert_eq!((bench.refused, bench.accepted), (0, 2));
    bench.try_all(&files, &other);
    // The checksum of a part covers its rows, but not its notes (the key-value metadata of its Parquet file). Change each byte from the beginning of
    // the notes to the end of the file.
    let part = plan(&trial).into_iter().nth(DONE - 1).map(|unit| format!("parts/{:05}-{}.parquet", unit.index, unit.id)).expect("a part");
    let bytes = &files[&part];
    let start = bytes.windows(12).position(|bytes| bytes == b"scree.schema").expect("the notes");
    for at in start..bytes.len() {
        for mask in [1, 4] {
            let mut files = files.clone();
            files.get_mut(&part).expect("the part")[at] ^= mask;
            bench.try_files(&format!("byte {at} of the notes changed"), &[&part], &files, false);
        }
    }
    assert!(bench.refused > 250 && bench.accepted > 150, "{} refused, {} accepted", bench.refused, bench.accepted);
}

/// Replaces the schema in the manifest of a run by that of the previous version, as if the previous version had made the run. Manifests of that
/// version had no checksum, so the checksum is removed.
fn make_old(run: &Path) {
    let file = run.join("manifest.json");
    let mut manifest: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(&fs::read(&file).expect("a manifest")).expect("an object");
    assert_eq!(manifest["schema"], SCHEMA, "the manifest records the schema of the tables");
    manifest.insert("schema".to_owned(), "1".into());
    manifest.remove("checksum").expect("a checksum");
    fs::write(&file, serde_json::to_vec_pretty(&manifest).expect("JSON")).expect("writable");
}

#[test]
fn a_run_of_an_earlier_schema_is_refused_in_one_line_with_the_remedy() {
    let folder = Folder::new("store-schema");
    let trial = trial();
    let (done, stopped) = (folder.0.join("done"), folder.0.join("stopped"));
    finished(&trial, &done);
    interrupted(&trial, &stopped);
    let is_clear = |error: String| {
        assert_eq!(error.lines().count(), 1, "{error}");
        for part in ["manifest.json", "its schema is 1", "this version reads schema 2", "repeat the run with another --out"] {
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
    };
    for run in [&done, &stopped] {
        make_old(run);
        is_clear(format!("{:#}", read_run(run).expect_err("another schema")));
        for existing in [Existing::Resume, Existing::Refuse] {
            is_clear(format!("{:#}", open(&trial, run, existing).expect_err("another schema")));
        }
    }
    failure(&["report", &done.display().to_string()], &["manifest.json", "its schema is 1", "repeat the run with another --out"]);
    // `demo` replaces its own earlier run, whatever its schema is.
    let replaced = open(&trial, &done, Existing::Replace).expect("the earlier run is replaced");
    assert_eq!(replaced.progress().0, 0, "nothing of it is kept");
}

/// The notebook and the script that records results read the tables, too. Both must name the schema of this version.
#[test]
fn the_notebook_and_its_recorder_read_this_schema() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let recorder = fs::read_to_string(root.join("scripts/record.py")).expect("a script");
    assert!(recorder.contains(&format!("\nSCHEMA = \"{SCHEMA}\"\n")), "scripts/record.py reads another schema");
    let notebook = fs::read_to_string(root.join("notebooks-data/headline.ipynb")).expect("a notebook");
    let notebook: serde_json::Value = serde_json::from_str(&notebook).expect("JSON");
    let lines: Vec<&str> = notebook["cells"]
        .as_array()
        .expect("cells")
        .iter()
        .flat_map(|cell| cell["source"].as_array())
        .flatten()
        .filter_map(|line| line.as_str())
        .collect();
    assert!(lines.contains(&format!("SCHEMA = \"{SCHEMA}\"\n").as_str()), "notebooks-data/headline.ipynb reads another schema");
}

#[test]
fn shards_are_not_mixed_up() {
    let folder = Folder::new("store-shards");
    let trial = trial();
    let (truth, _) = finished(&trial, &folder.0.join("whole"));
    let run = folder.0.join("run");
    for number in [1, 2] {
        let place = Place { out: &run, own: true, existing: Existing::Refuse, shard: Some(Shard { number, count: 2 }), small: false };
        let mut shard = Run::open(&trial, &place, &machine()).expect("the shard can be opened");
        carry_out(&mut shard, &trial, usize::MAX);
        shard.finish().expect("the shard can be finished");
    }
    let files = files_of(&run);
    let seen = |files: &Files| {
        make(&run, files.iter());
        Seen::of(read_run(&run), &truth)
    };
    assert_eq!(seen(&files), Seen::Same);
    // The order in which the folders and files were made has no effect.
    make(&run, files.iter().rev());
    assert_eq!(Seen::of(read_run(&run), &truth), Seen::Same);
    let refused = |what: &str, files: &Files, name: &str| match seen(files) {
        Seen::Refused(message) => assert!(message.contains(name) && message.lines().count() == 1, "{what}: {message}"),
        seen => panic!("{what}: {seen:?}"),
    };
    // A file of one shard has the content of the same file of the other shard.
    for name in TABLES.iter().chain(&["manifest.json"]) {
        let mut mixed = files.clone();
        mixed.insert(format!("shard-2-of-2/{name}"), files[&format!("shard-1-of-2/{name}")].clone());
        refused(name, &mixed, "shard-2-of-2");
    }
    // The folder contains shard 1 twice. In the first case, it has shard 1, shard 2, and a copy of shard 1. In the second case, it has shard 1, and a
    // copy of shard 1 under the name of shard 2.
    let shard = |from: &str, to: &str| {
        let own = files.iter().filter_map(|(name, bytes)| Some((format!("{to}{}", name.strip_prefix(from)?), bytes.clone())));
        own.collect::<Files>()
    };
    let mut twice = files.clone();
    twice.extend(shard("shard-1-of-2", "shard-1-of-2 (copy)"));
    refused("a shard twice", &twice, "shard-1-of-2 (copy)");
    let mut renamed = shard("shard-1-of-2", "shard-1-of-2");
    renamed.extend(shard("shard-1-of-2", "shard-2-of-2"));
    refused("a shard under the name of the other one", &renamed, "shard-2-of-2");
    // If a shard is missing, the run is reported as incomplete, and lacks the numbers of that shard.
    assert_eq!(seen(&shard("shard-1-of-2", "shard-1-of-2")), Seen::Part);
    // Change each byte of a manifest, including the number of the shard. If a wrong number were accepted, the shard would be left out, or
    // counted as a different shard.
    make(&run, files.iter());
    let mut manifest = files["shard-2-of-2/manifest.json"].clone();
    for at in 0..manifest.len() {
        let mask = [1, 2, 4][at % 3];
        manifest[at] ^= mask;
        fs::write(run.join("shard-2-of-2/manifest.json"), &manifest).expect("writable");
        manifest[at] ^= mask;
        match Seen::of(read_run(&run), &truth) {
            Seen::Refused(message) => assert!(message.contains("shard-2-of-2") && message.lines().count() == 1, "byte {at}: {message}"),
            Seen::Same => {}
            seen => panic!("byte {at}: {seen:?}"),
        }
    }
}

#[test]
fn what_an_import_notes_is_passed_on_once() {
    let folder = Folder::new("store-import-notes");
    let sample = |x: u32, y: u32| image::Luma([(x * 1100 + y * 310 + (x * y) % 97 * 60) as u16]);
    image::ImageBuffer::from_fn(37, 29, sample).save(folder.0.join("heightmap.png")).expect("writable");
    let grass = folder.0.join("materials").join("grass");
    fs::create_dir_all(&grass).expect("writable");
    for (name, colour) in [("albedo", [120, 110, 100]), ("normal", [128, 128, 255]), ("height", [90; 3]), ("roughness", [200; 3])] {
        image::RgbImage::from_pixel(8, 8, image::Rgb(colour)).save(grass.join(format!("{name}.png"))).expect("writable");
    }
    let import =
        "[import]\nheightmap = \"heightmap.png\"\nmetres_per_texel = 5.0\nheight_range_m = [100.0, 900.0]\nmaterials = \"materials\"\n";
    let definition = definition::parse(&format!("{TEXT}\n{import}"), "trial.toml", &folder.0).expect("the definition is valid");
    let run = folder.0.join("run");
    let begun = open(&definition, &run, Existing::Refuse).expect("the scene is imported");
    let notes = begun.notes().to_vec();
    assert!(notes.iter().any(|note| note.starts_with("import: assumed size of a repeat: grass 2.5 m")), "{notes:?}");
    drop(begun);
    let resumed = open(&definition, &run, Existing::Resume).expect("the scene is there");
    assert!(resumed.notes().is_empty(), "{:?}", resumed.notes());
}

#[test]
fn a_changed_file_of_an_imported_scene_is_refused() {
    let folder = Folder::new("store-import");
    // A slope with bumps.
    let sample = |x: u32, y: u32| image::Luma([(x * 1100 + y * 310 + (x * y) % 97 * 60) as u16]);
    image::ImageBuffer::from_fn(37, 29, sample).save(folder.0.join("heightmap.png")).expect("writable");
    let import = "[import]\nheightmap = \"heightmap.png\"\nmetres_per_texel = 5.0\nheight_range_m = [100.0, 900.0]\n";
    let definition = definition::parse(&format!("{TEXT}\n{import}"), "trial.toml", &folder.0).expect("the definition is valid");
    let run = folder.0.join("run");
    let mut begun = open(&definition, &run, Existing::Refuse).expect("the scene is imported");
    carry_out(&mut begun, &definition, DONE);
    drop(begun);
    let files = files_of(&run);
    drop(open(&definition, &run, Existing::Resume).expect("unchanged files are accepted"));
    let mut tried = 0;
    for name in files.keys().filter(|name| name.starts_with("scene/")) {
        let bytes = &files[name];
        let middle = bytes.len() / 2;
        let mut changed = bytes.clone();
        changed[middle] ^= 1;
        for damage in [Some(changed), Some(bytes[..middle].to_vec()), Some([&bytes[..], b"\n"].concat()), None] {
            let mut damaged = files.clone();
            damaged.remove(name);
            damaged.extend(damage.map(|bytes| (name.clone(), bytes)));
            make(&run, damaged.iter());
            let refused = open(&definition, &run, Existing::Resume).map(|run| run.progress());
            let message = format!("{:#}", refused.expect_err(name));
            assert!(message.contains(&run.join("scene").display().to_string()) && message.lines().count() == 1, "{name}: {message}");
            tried += 1;
        }
    }
    assert!(tried >= 8, "{tried} damages");
    // If the folder `scene` is missing, the scene is imported again, and the finished parts are kept.
    make(&run, files.iter().filter(|(name, _)| !name.starts_with("scene/")));
    assert_eq!(open(&definition, &run, Existing::Resume).expect("imported again").progress().0, DONE);
    assert!(
        files_of(&run)
            .iter()
            .filter(|(name, _)| name.starts_with("scene/"))
            .eq(files.iter().filter(|(name, _)| name.starts_with("scene/")))
    );
}

#[test]
fn the_comparison_notices_one_changed_number() {
    let folder = Folder::new("store-controls");
    let trial = trial();
    let (truth, _) = finished(&trial, &folder.0.join("one"));
    let data = read_run(&folder.0.join("one")).expect("a run");
    let seen = |change: &dyn Fn(&mut RunData)| {
        let mut data = data.clone();
        change(&mut data);
        Seen::of(Ok(data), &truth)
    };
    assert_eq!(seen(&|_| {}), Seen::Same);
    let last = data.rows.iter().rposition(|row| row.metric == "rmse").expect("a finite number");
    assert_eq!(seen(&|data| data.rows[last].value = data.rows[last].value.next_up()), Seen::Different);
    assert_eq!(seen(&|data| data.times[0].value = -data.times[0].value), Seen::Different);
    assert_eq!(seen(&|data| data.rows[0].standard_error = Some(f64::NAN)), Seen::Different);
    assert_eq!(seen(&|data| data.rows[0].noise.push('x')), Seen::Different);
    assert_eq!(seen(&|data| data.rows.swap(0, last)), Seen::Different);
    assert_eq!(seen(&|data| drop(data.rows.pop())), Seen::Different);
    let double = |data: &mut RunData| {
        let row = data.rows[0].clone();
        data.rows.insert(0, row);
    };
    assert_eq!(seen(&double), Seen::Different);
    // A run that is reported as incomplete may lack rows, but must not have changed or additional rows.
    let incomplete = |data: &mut RunData| {
        data.complete = false;
        data.missing.push("a part".to_owned());
    };
    let lacking = |data: &mut RunData| {
        incomplete(data);
        data.rows.remove(1);
    };
    assert_eq!(seen(&lacking), Seen::Part);
    let changed = |data: &mut RunData| {
        lacking(data);
        data.rows[2].value = data.rows[2].value.next_down();
    };
    assert_eq!(seen(&changed), Seen::Different);
    let doubled = |data: &mut RunData| {
        incomplete(data);
        double(data);
    };
    assert_eq!(seen(&doubled), Seen::Different);
    assert_eq!(seen(&|data| data.missing.push("a part".to_owned())), Seen::Different);
}

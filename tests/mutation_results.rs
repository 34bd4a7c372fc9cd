//! Tests the tables of `make mutants`: a table that an interrupted call left is continued, and is not an error. Also tests the printed rate of killed
//! mutants, and the recorded tables.

use std::fs;
use std::path::{Path, PathBuf};

use crate::fixtures::Folder;
use crate::mutation::results::{Outcome, Row, Table, record, summary};

/// A row with a comma and quotation marks, as a change of code may have them.
fn row(line: usize, outcome: Outcome) -> Row {
    Row {
        file: "shared/hash.wgsl".to_owned(),
        line,
        operator: "operator".to_owned(),
        change: "`f(a, \"b\")` -> `f(\"b\", a)`".to_owned(),
        outcome,
        by: "shared::hashes, or another".to_owned(),
        seconds: 1.5,
        text: format!("{line:016x}"),
    }
}

/// Writes two rows. Returns the file and its bytes.
fn two_rows(folder: &Folder) -> (PathBuf, Vec<u8>) {
    let file = folder.0.join("table.csv");
    let (mut table, rows) = Table::open(&file).expect("a new table");
    assert!(rows.is_empty());
    for line in [1, 2] {
        table.add(&row(line, Outcome::Killed)).expect("writes");
    }
    drop(table);
    let bytes = fs::read(&file).expect("written");
    (file, bytes)
}

/// Opens a table, adds a third row, and returns the rows that were there and the rows that are there now.
fn continued(file: &Path) -> (Vec<Row>, Vec<Row>) {
    let (mut table, before) = Table::open(file).expect("an interrupted table is continued");
    table.add(&row(3, Outcome::Survived)).expect("writes");
    drop(table);
    let (_, after) = Table::open(file).expect("a continued table is whole");
    (before, after)
}

#[test]
fn a_table_that_was_cut_anywhere_is_continued() {
    let folder = Folder::new("mutation-results-cut");
    let (file, bytes) = two_rows(&folder);
    let ends: Vec<usize> = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n').map(|(at, _)| at + 1).collect();
    assert_eq!(ends.len(), 3, "a header and two rows");
    // With length 0, the file is empty, as after a call that was interrupted before its first row. The next lengths leave a part of the header.
    for length in 0..=bytes.len() {
        fs::write(&file, &bytes[..length]).expect("writes");
        let whole = ends[1..].iter().filter(|end| **end <= length).count();
        let kept: Vec<Row> = (1..=whole).map(|line| row(line, Outcome::Killed)).collect();
        let (before, after) = continued(&file);
        assert_eq!(before, kept, "cut after {length} bytes");
        assert_eq!(after, [kept, vec![row(3, Outcome::Survived)]].concat(), "cut after {length} bytes");
        let text = fs::read_to_string(&file).expect("text");
        assert_eq!(text.matches("outcome").count(), 1, "cut after {length} bytes: one header: {text}");
    }
}

#[test]
fn a_table_that_does_not_exist_is_made_and_one_that_was_cut_inside_a_character_is_continued() {
    let folder = Folder::new("mutation-results-new");
    let (before, after) = continued(&folder.0.join("new.csv"));
    assert_eq!((before, after), (vec![], vec![row(3, Outcome::Survived)]));
    let (file, mut bytes) = two_rows(&folder);
    // The first byte of a character of two bytes, as in `alpha²`.
    bytes.extend([b'a', 0xc2]);
    fs::write(&file, &bytes).expect("writes");
    assert_eq!(continued(&file).0.len(), 2);
}

#[test]
fn a_complete_row_that_is_damaged_is_an_error() {
    let folder = Folder::new("mutation-results-damaged");
    let (file, bytes) = two_rows(&folder);
    let text = String::from_utf8(bytes).expect("text").replacen("killed", "kiled", 1);
    fs::write(&file, text).expect("writes");
    let error = Table::open(&file).err().expect("an unknown outcome").to_string();
    assert!(error.contains("table.csv") && error.contains("remove it"), "{error}");
}

#[test]
fn the_rate_counts_neither_equivalent_mutants_nor_those_that_do_not_compile() {
    let outcomes = [Outcome::Killed, Outcome::Hung, Outcome::Killed, Outcome::Survived, Outcome::Equivalent, Outcome::NotCompiled];
    let rows: Vec<Row> = (1..).zip(outcomes).map(|(line, outcome)| row(line, outcome)).collect();
    let text = summary("noise", &rows, 12.0);
    let counts = "noise: 75.0 % killed; 2 by tests, 1 by the time limit, 1 survived, 1 equivalent; 1 did not compile; 12 s";
    assert_eq!(text.lines().next(), Some(counts));
    // Each surviving mutant has a line with its file and line number.
    assert_eq!(text.lines().count(), 2);
    assert!(text.contains("shared/hash.wgsl:4 "), "{text}");
    assert!(summary("noise", &[], 0.0).starts_with("noise: 0.0 % killed"));

    let folder = Folder::new("mutation-results-record");
    let lines = || fs::read_to_string(folder.0.join("strength.csv")).expect("recorded").lines().map(str::to_owned).collect::<Vec<_>>();
    record(&folder.0, "noise", "2026-01-02", 7, &rows).expect("records");
    record(&folder.0, "hash", "2026-01-03", 8, &rows[..1]).expect("records");
    let [hash, noise] = ["hash,2026-01-03,8,1,1,0,0,0,0,100.0", "noise,2026-01-02,7,5,2,1,1,1,1,75.0"].map(str::to_owned);
    assert_eq!(lines()[1..], [hash.clone(), noise]);
    // A second record of a name replaces the first.
    record(&folder.0, "noise", "2026-01-04", 9, &rows[2..4]).expect("records");
    assert_eq!(lines()[1..], [hash, "noise,2026-01-04,9,2,1,0,1,0,0,50.0".to_owned()]);
    let table = fs::read_to_string(folder.0.join("noise.csv")).expect("recorded");
    assert_eq!(table.lines().count(), 3, "a header, and the two rows of the second record: {table}");
}

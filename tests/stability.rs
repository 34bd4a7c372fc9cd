//! Tests kernels (functions that exist in WGSL and as a Rust reference) at extreme inputs. Every result must be finite, and must differ from the f64
//! reference by at most the derived tolerance. If the recorded table has an error, the measured error must not be larger. Also tests the errors of
//! stored directions and of derivatives, the declarations of the probes, and the command `stability`.

use std::collections::BTreeMap;
use std::fs;
use std::process::Command;

use experiments::stability::extremes::{DEFAULT_TEXT, Extremes};
use experiments::stability::kernels::{Finding, measure};
use experiments::stability::{Row, directions};
use kernels::probe::{Draw, PROBES, Verdict};

use crate::fixtures::{Folder, gpu, program};

/// For each case, the share of its rows (sets of inputs) that the test measures.
const SHARE: f64 = 1.0 / 16.0;

/// The tables of kernels and of directions that `experiments stability --out notebooks-data/stability` wrote.
const RECORDED: &str = include_str!("../notebooks-data/stability/results.csv");
const DIRECTIONS: &str = include_str!("../notebooks-data/stability/directions.csv");

#[test]
fn kernels_hold_at_their_extremes_as_recorded() {
    let extremes = Extremes::parse(DEFAULT_TEXT, "extremes.toml").expect("the built-in table");
    let findings = measure(&extremes, &[gpu()], SHARE, |_, _, _| Ok(())).expect("a device");
    let failing: Vec<&Finding> = findings.iter().filter(|finding| !finding.pass).collect();
    assert!(failing.is_empty(), "{} of {} fail, the first: {:?}", failing.len(), findings.len(), failing[0]);
    let key =
        |f: &Finding| (f.kernel.clone(), f.parameter.clone(), f.measure.clone(), format!("{:?}", f.value), f.on.clone(), f.adapter.clone());
    let recorded: BTreeMap<_, Finding> = csv::Reader::from_reader(RECORDED.as_bytes())
        .deserialize()
        .map(|row| row.expect("a finding"))
        .map(|f: Finding| (key(&f), f))
        .collect();
    let mut compared = 0;
    for finding in &findings {
        // A finding is a measured error. Findings of the f32 reference must all be in the recorded table, because they are the same on every machine,
        // except for the last digits of library functions. Findings of two GPUs differ in the last digits. So a finding of a GPU may be missing if
        // the table was recorded on another GPU.
        let Some(before) = recorded.get(&key(finding)) else {
            assert!(
                finding.on == "gpu" && !recorded_on(&recorded, &finding.adapter),
                "not in the recorded table; record it again: {finding:?}"
            );
            continue;
        };
        compared += 1;
        // The table was recorded with all rows of each case. This test measures only the first sixteenth of these rows (`SHARE`), so its largest
        // error cannot exceed the recorded one. The tolerance of 1 % covers the rounding of recorded numbers to three digits.
        assert!(finding.worst <= before.worst * 1.01 + 1e-12, "the error is larger than the recorded one ({}): {finding:?}", before.worst);
    }
    assert!(compared * 2 >= findings.len(), "{compared} of {} are recorded", findings.len());
}

fn recorded_on<K>(recorded: &BTreeMap<K, Finding>, adapter: &str) -> bool {
    recorded.values().any(|finding| finding.adapter == adapter)
}

#[test]
fn directions_are_as_published_and_derivatives_within_their_law() {
    let rows = directions::rows();
    let wrong: Vec<&Row> = rows.iter().filter(|row| !row.holds()).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    let recorded: Vec<Row> = csv::Reader::from_reader(DIRECTIONS.as_bytes()).deserialize().map(|row| row.expect("a row")).collect();
    assert_eq!(rows.len(), recorded.len(), "the rows differ from the table: rewrite it with `experiments stability`");
    for (row, before) in rows.iter().zip(&recorded) {
        let same = [&row.kind, &row.view, &row.motion, &row.statistic] == [&before.kind, &before.view, &before.motion, &before.statistic];
        // The tolerance is necessary because the recorded numbers are rounded to four digits, and because the sines of mathematics libraries differ
        // in the last digit.
        assert!(same && (row.value - before.value).abs() <= 2e-3 * before.value.abs() + 1e-9, "{row:?}, recorded {before:?}");
    }
}

#[test]
fn every_kernel_is_asked_and_every_parameter_takes_its_value() {
    let extremes = Extremes::parse(DEFAULT_TEXT, "extremes.toml").expect("the built-in table");
    for probe in PROBES {
        assert!(
            extremes.bends.iter().any(|bend| bend.kernel == probe.name) || probe.name == "hash",
            "{} has no [[bend]] table in extremes.toml",
            probe.name
        );
        assert!(extremes.cases.iter().any(|case| case.kernel == probe.name), "{} has no case", probe.name);
        assert!(!probe.measures.is_empty(), "{}", probe.name);
        let draw = |row| Draw { row, column: 0, table: 0 };
        for name in probe.parameter_names() {
            assert!(probe.parameter_unit(name).is_some_and(|unit| !unit.is_empty()));
            let columns = probe.inputs.iter().filter(|column| column.name == name).count();
            let others = probe.parameters.iter().filter(|parameter| parameter.name == name).count();
            assert!(probe.outputs.iter().all(|output| output.name != name), "{}: {name} is also an output", probe.name);
            assert_eq!(columns + others, 1, "{}: {name} must be one input or one parameter", probe.name);
        }
        let row: Vec<f64> = (probe.random)(&mut draw(3));
        let truth = probe.on_f64(&row);
        assert_eq!((row.len(), truth.len()), (probe.inputs.len(), probe.outputs.len()), "{}", probe.name);
        assert_eq!(
            (probe.judge)(&row, &truth, &truth),
            Verdict::Agrees(0.0),
            "{}: the f64 reference must agree with itself exactly",
            probe.name
        );
        assert!(probe.measures.iter().all(|measure| (measure.error)(&row, &truth, &truth).abs() < 1e-9), "{}", probe.name);
        assert!(probe.row("nothing", 1.0, &mut draw(0)).is_none());
    }
}

#[test]
fn a_table_of_extremes_is_measured_and_failures_are_told() {
    let folder = Folder::new("stability");
    let table = folder.write("small.toml", "[[case]]\nkernel = \"select\"\nparameter = \"u\"\nvalues = [0, 0.5]\nrows = 16\n");
    let out = folder.path("out");
    let run = |table: &str| Command::new(program()).args(["stability", "--extremes", table, "--out", &out]).output().expect("it runs");
    let done = run(&table);
    assert!(done.status.success(), "{done:?}");
    for name in ["results.csv", "report.md", "report.html"] {
        assert!(fs::metadata(folder.0.join("out").join(name)).is_ok_and(|file| file.len() > 0), "{name}");
    }
    let rows = fs::read_to_string(folder.0.join("out/results.csv")).expect("written");
    assert_eq!(rows.lines().count(), 1 + 2 * 2, "{rows}");
    // f32 cannot meet this limit.
    let strict = folder.write("strict.toml", "[[case]]\nkernel = \"derivatives\"\nparameter = \"t\"\nvalues = [1]\nallow = 1e-12\n");
    let failed = run(&strict);
    let error = String::from_utf8_lossy(&failed.stderr);
    assert!(!failed.status.success() && error.contains("derivatives at t = 1"), "{error}");
    for (text, says) in
        [("[[case]]\nkernel = \"selct\"\nparameter = \"u\"\nvalues = [0]\n", "did you mean `select`"), ("\u{7f}", "broken.toml:1")]
    {
        let refused = run(&folder.write("broken.toml", text));
        let error = String::from_utf8_lossy(&refused.stderr);
        assert!(!refused.status.success() && error.contains(says) && error.trim().lines().count() == 1, "{error}");
    }
}

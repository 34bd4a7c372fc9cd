//! Tests that the checks of a run notice faults. One fault at a time is added to a sound run, first with a size at which its check must still pass,
//! and then with a size at which this check must not pass. If the check has a threshold, the two sizes lie close to it. The results of all other
//! checks must not change. The only exception is the check `numbers`, which must also notice a value of NaN.

use std::collections::{BTreeMap, BTreeSet};

use kernels::shading::Estimator;
use kernels::variant::Flavour;

use super::checks::Mark::{self, Fails, Unclear};
use super::checks::ROUNDING;
use super::columns::named_checks;
use super::fake::{self, FREEDOM, Folder};
use super::summary::Table;
use super::{RunData, judge};
use crate::definition::Expectation;
use crate::row::Row;
use crate::significance::{detectable, limit, sidak};

/// Number of seeds of the run, from which bias and variance are measured.
const SEEDS: u32 = 8;
/// The predicted variance in runs with a fault of the variance. It is a power of two, so multiplying it by a factor causes no rounding error.
const PREDICTED: f64 = 1.0 / 512.0;

/// Changes a sound run so that it has a fault of a given size.
type Plant = Box<dyn Fn(&mut RunData, f64)>;

/// A fault that one check must notice. If its size is NaN, the check `numbers` must notice it, too.
struct Fault {
    /// Name of the check.
    check: &'static str,
    what: String,
    /// A size of the fault at which the check still passes.
    passes: f64,
    /// A size of the fault at which the check does not pass. If the check has a threshold, the size is just beyond it.
    fails: f64,
    /// The result of the check at the size `fails`.
    mark: Mark,
    plant: Plant,
}

/// The checks that have nothing to report about a sound run.
const ONLY_FAULTS: [&str; 2] = ["numbers", "doubles"];

/// Returns a run that contains the data for every check. No check finds a fault in it.
fn sound(folder: &Folder) -> RunData {
    let mut run = fake::variants(folder.path(), &["cliff"], &["hashed"]);
    assert_eq!(run.definition.seeds, SEEDS);
    run.definition.expectations = vec![Expectation {
        claim: "Noise clumps a little".to_owned(),
        metric: "clumping".to_owned(),
        selection: [("variant".to_owned(), toml::Value::String("auto".to_owned()))].into(),
        over: None,
        range: [2.0, 4.0],
    }];
    run
}

/// The result of each check; `None` = it has nothing to check.
fn results(run: &RunData) -> BTreeMap<&'static str, Option<Mark>> {
    named_checks(run, &Table::of(run), &judge(run)).into_iter().map(|(name, check)| (name, check.map(|(mark, _)| mark))).collect()
}

/// Returns the row that a fault changes: the row of this metric and variant over all frames or, if there is none, that of the earliest frame. If
/// there are rows for both signals, it is the row of albedo. Rows with a lag are left out.
fn row<'a>(run: &'a mut RunData, metric: &str, variant: &str) -> &'a mut Row {
    let found = run.rows.iter_mut().filter(|row| row.metric == metric && row.variant == variant && row.lag.is_none());
    found.min_by_key(|row| row.frame).expect("every choice has this metric")
}

/// Number of tests of biases: two flavours draw random numbers, and each has a test of its mean and one of biases that cancel.
const BIAS_TESTS: usize = 4;
/// Number of tests of variances.
const VARIANCE_TESTS: usize = 2;

fn faults() -> Vec<Fault> {
    let mut all: Vec<Fault> = Vec::new();
    let mut add = |check: &'static str, what: &str, [passes, fails]: [f64; 2], mark: Mark, plant: Plant| {
        all.push(Fault { check, what: what.to_owned(), passes, fails, mark, plant });
    };
    // The expected range is 2 to 4. Both ends pass, and the next f64 numbers beyond them fail.
    let clumping = |run: &mut RunData, value: f64| row(run, "clumping", "auto").value = value;
    add("expectations", "a value above its range", [4.0, 4.0f64.next_up()], Fails, Box::new(clumping));
    add("expectations", "a value below its range", [2.0, 2.0f64.next_down()], Fails, Box::new(clumping));
    add("expectations", "a value of NaN", [3.0, f64::NAN], Fails, Box::new(clumping));
    // The fault sets the smallest RMSE to 0.001. The standard error of the reference may be at most a tenth of this RMSE: 0.0001 passes, and the next
    // larger f64 number fails.
    let tenth: f64 = 0.1 * 0.001;
    let reference = |run: &mut RunData, error: f64| {
        row(run, "rmse", "auto").value = 0.001;
        row(run, "reference_se", "reference").value = error;
    };
    add("references", "a standard error of the reference", [tenth, tenth.next_up()], Fails, Box::new(reference));
    add("references", "an unknown standard error", [tenth, f64::NAN], Fails, Box::new(reference));
    // Counts may differ from the promise by 0.01. For near cliff, 12.01 and 11.99 pass, and the next f64 numbers beyond them fail.
    for flavour in Flavour::ALL {
        let (name, promise) = (flavour.name(), f64::from(Estimator::Fc5.promised_fetches(flavour)));
        let count = move |run: &mut RunData, value: f64| row(run, "fetches_per_px", name).value = value;
        let (low, high) = (promise - 0.01, promise + 0.01);
        add("promises", &format!("too few fetches of {name}"), [low, low.next_down()], Fails, Box::new(count));
        if flavour == Flavour::FarAtlas {
            // It may take 3 fetches in a scene without colour modulation, too.
            let most: f64 = 3.0 + 0.01;
            add("promises", "too many fetches of the far atlas alone", [most, most.next_up()], Fails, Box::new(count));
            continue;
        }
        add("promises", &format!("too many fetches of {name}"), [high, high.next_up()], Fails, Box::new(count));
        // If all flavours take one more fetch, the scene has colour modulation. If only one flavour takes one more fetch, this is a fault.
        add("promises", &format!("one fetch more of {name}"), [promise, promise + 1.0], Fails, Box::new(count));
    }
    // For the far atlas, 2 to 3 fetches are accepted, with the same tolerance of 0.01: 3.01 passes, and the next larger f64 number fails. In a
    // scene with colour modulation, the other flavours, except the virtual texture, take one more fetch.
    let modulated = |run: &mut RunData, value: f64| {
        for flavour in [Flavour::NearCliff, Flavour::FarCliff, Flavour::Splat] {
            row(run, "fetches_per_px", flavour.name()).value += 1.0;
        }
        row(run, "fetches_per_px", Flavour::FarAtlas.name()).value = value;
    };
    add("promises", "too many fetches of the far atlas", [3.0 + 0.01, (3.0f64 + 0.01).next_up()], Fails, Box::new(modulated));
    let count_of_splat = |run: &mut RunData, value: f64| row(run, "fetches_per_px", "splat").value = value;
    let of_splat = f64::from(Estimator::Fc5.promised_fetches(Flavour::Splat));
    add("promises", "a count of NaN", [of_splat, f64::NAN], Fails, Box::new(count_of_splat));
    // The largest accepted bias is the limit of the test plus the allowance for rounding. The sizes of the fault are shares of this bias.
    let level = sidak(BIAS_TESTS);
    for sign in [1.0, -1.0] {
        let bias = move |run: &mut RunData, share: f64| {
            let row = row(run, "bias", "near-cliff");
            row.value = sign * share * (ROUNDING + limit(level, FREEDOM) * row.standard_error.expect("a bias has a standard error"));
        };
        add("bias", "a bias", [1.0 - 1e-9, 1.0 + 1e-9], Fails, Box::new(bias));
    }
    // A probability below the level of each test is a finding.
    let cancelling = |run: &mut RunData, probability: f64| row(run, "bias_squared_p", "far-cliff").value = probability;
    add("bias", "biases that cancel over the picture", [level, level.next_down()], Fails, Box::new(cancelling));
    // The check is unclear if the smallest bias that it would find is larger than 5 % of the albedo range. The sizes are shares of these 5 %.
    let coarse = move |run: &mut RunData, share: f64| {
        let row = row(run, "bias", "near-cliff");
        (row.value, row.standard_error) = (0.0, Some((share * 0.05 - ROUNDING) / detectable(level, FREEDOM)));
    };
    add("bias", "a standard error that is too large", [1.0 - 1e-9, 1.0 + 1e-9], Unclear, Box::new(coarse));
    let still = |run: &mut RunData, error: f64| {
        let row = row(run, "bias", "near-cliff");
        (row.value, row.standard_error) = (0.0, Some(error));
    };
    add("bias", "pictures that do not differ between seeds", [1e-9, 0.0], Unclear, Box::new(still));
    let value = |run: &mut RunData, value: f64| row(run, "bias", "near-cliff").value = value;
    add("bias", "a value of NaN", [0.0, f64::NAN], Unclear, Box::new(value));
    // The largest accepted deviation from the predicted variance is the limit of the test plus 1 % of the prediction. The sizes are shares of this
    // deviation. The standard error is 1 % of the prediction.
    let level = sidak(VARIANCE_TESTS);
    for (sign, what) in [(1.0, "a variance that is too large"), (-1.0, "a variance that is too small")] {
        let deviation = move |run: &mut RunData, share: f64| {
            row(run, "variance_theory", "near-cliff").value = PREDICTED;
            let measured = row(run, "exact_mse", "near-cliff");
            measured.value = PREDICTED * (1.0 + sign * share * (0.01 + 0.01 * limit(level, FREEDOM)));
            measured.standard_error = Some(0.01 * PREDICTED);
        };
        add("variance", what, [1.0 - 1e-9, 1.0 + 1e-9], Fails, Box::new(deviation));
    }
    // The check is unclear if the smallest deviation that it would find is larger than 25 % of the prediction. The sizes are shares of these 25 %.
    let coarse = move |run: &mut RunData, share: f64| {
        row(run, "variance_theory", "near-cliff").value = PREDICTED;
        let measured = row(run, "exact_mse", "near-cliff");
        measured.value = PREDICTED;
        measured.standard_error = Some(PREDICTED * (share * 0.25 - 0.01) / detectable(level, FREEDOM));
    };
    add("variance", "a standard error that is too large", [1.0 - 1e-9, 1.0 + 1e-9], Unclear, Box::new(coarse));
    let value = |run: &mut RunData, ratio: f64| {
        row(run, "variance_theory", "near-cliff").value = PREDICTED;
        row(run, "exact_mse", "near-cliff").value = ratio * PREDICTED;
    };
    add("variance", "a value of NaN", [1.0, f64::NAN], Unclear, Box::new(value));
    // A single pixel without a finite colour is too many.
    for signal in ["albedo", "lit"] {
        let invalid = move |run: &mut RunData, pixels: f64| {
            let is_count = |row: &&mut Row| row.metric == "invalid_px" && row.variant == "splat" && row.signal == signal;
            run.rows.iter_mut().find(is_count).expect("every choice has this metric").value = pixels;
        };
        add("invalid", &format!("an invalid pixel, {signal}"), [0.0, 1.0], Fails, Box::new(invalid));
        let of_reference = move |run: &mut RunData, pixels: f64| {
            let is_count = |row: &&mut Row| row.metric == "invalid_px" && row.variant == "reference" && row.signal == signal;
            run.rows.iter_mut().find(is_count).expect("every reference has this metric").value = pixels;
        };
        add("invalid", &format!("an invalid pixel of the reference, {signal}"), [0.0, 1.0], Fails, Box::new(of_reference));
    }
    // At least half of the terrain pixels must show a point that was visible in the previous frame. If there are fewer, the check is unclear: the
    // metrics are right, but they describe only a small part of the picture.
    let hidden = |run: &mut RunData, share: f64| {
        let rows = run.rows.iter_mut().filter(|row| row.metric == "disoccluded" && row.variant == "splat");
        rows.for_each(|row| row.value = share);
    };
    add("followed", "pixels that are not followed", [0.5, 0.5f64.next_up()], Unclear, Box::new(hidden));
    // A row without a number, in a metric that no other check reads.
    let number = |run: &mut RunData, value: f64| row(run, "ssim", "splat").value = value;
    add("numbers", "a value of NaN", [0.5, f64::NAN], Fails, Box::new(number));
    let time = |run: &mut RunData, value: f64| run.times[0].value = value;
    add("numbers", "a time of NaN", [0.5, f64::NAN], Fails, Box::new(time));
    // No value may be given by more than one row. The size of this fault is the number of copies of the row that are added, with another value.
    type IsOfKind = fn(&Row) -> bool;
    let kinds: [(&str, IsOfKind); 8] = [
        ("over all frames", |row| row.metric == "rmse" && row.frame.is_none()),
        ("of the first frame", |row| row.metric == "rmse" && row.frame == Some(0)),
        ("of a later frame", |row| row.metric == "rmse" && row.frame == Some(2)),
        ("with a lag", |row| row.metric == "added" && row.lag == Some(3)),
        ("of a spectrum", |row| row.metric == "power"),
        ("about a reference", |row| row.metric == "reference_se"),
        ("of a time", |row| row.metric == "gpu_ms:shading"),
        ("of a ratio of times", |row| row.metric == "gpu_ratio:shading"),
    ];
    for (what, is_of_kind) in kinds {
        let repeat = move |run: &mut RunData, copies: f64| {
            for table in [&mut run.rows, &mut run.times] {
                if let Some(row) = table.iter().find(|row| is_of_kind(row)).cloned() {
                    table.extend(std::iter::repeat_n(Row { value: row.value * 1.5, ..row }, copies as usize));
                }
            }
        };
        add("doubles", &format!("a second row {what}"), [0.0, 1.0], Fails, Box::new(repeat));
    }
    all
}

#[test]
fn each_check_notices_its_own_faults_and_no_other() {
    let folder = Folder::new("planted");
    let sound = sound(&folder);
    let undamaged = results(&sound);
    for (name, passes) in &undamaged {
        assert_eq!(*passes, (!ONLY_FAULTS.contains(name)).then_some(Mark::Passes), "{name}");
    }
    let faults = faults();
    let noticed: BTreeSet<&str> = faults.iter().map(|fault| fault.check).collect();
    assert_eq!(noticed, undamaged.keys().copied().collect::<BTreeSet<_>>(), "a check without a planted fault, or a fault without a check");
    for Fault { check, what, passes, fails, mark, plant } in &faults {
        let with = |size: f64| {
            let mut run = sound.clone();
            plant(&mut run, size);
            results(&run)
        };
        assert_eq!(with(*passes), undamaged, "{what} of size {passes} must pass");
        let mut expected = undamaged.clone();
        expected.insert(*check, Some(*mark));
        if fails.is_nan() {
            expected.insert("numbers", Some(Fails));
        }
        assert_eq!(with(*fails), expected, "{what} of size {fails} must be noticed by the check of {check}, and no other");
    }
}

/// A check whose rows are missing must not pass: it fails, or it is left out.
#[test]
fn checks_without_their_rows_do_not_pass() {
    let folder = Folder::new("planted-missing");
    let sound = sound(&folder);
    let without = |metric: &str| {
        let mut run = sound.clone();
        run.rows.retain(|row| row.metric != metric);
        results(&run)
    };
    for (check, metric, result) in [
        ("expectations", "clumping", Some(Fails)),
        ("references", "reference_se", Some(Fails)),
        ("promises", "fetches_per_px", None),
        ("bias", "bias", None),
        ("variance", "variance_theory", None),
        ("variance", "exact_mse", None),
        ("invalid", "invalid_px", None),
        ("followed", "disoccluded", None),
    ] {
        let mut expected = results(&sound);
        expected.insert(check, result);
        assert_eq!(without(metric), expected, "without {metric}");
    }
}

//! Plants one fault at a time into a run. The size of the fault is first just below the threshold of a check, where this check must pass, and then
//! just above the threshold, where it must fail. Every other check must pass in both cases.

use std::collections::{BTreeMap, BTreeSet};

use kernels::shading::Estimator;
use kernels::variant::Flavour;

use super::columns::named_checks;
use super::fake::{self, Folder};
use super::numbers::sidak_limit;
use super::summary::Table;
use super::{RunData, judge};
use crate::definition::Expectation;
use crate::row::Row;

/// Number of seeds of the run, from which bias and variance are measured.
const SEEDS: u32 = 8;
/// The predicted variance in runs with a fault. It is a power of two, so multiplying it by a factor causes no rounding error.
const PREDICTED: f64 = 1.0 / 512.0;

/// Changes a sound run so that it has a fault of a given size.
type Plant = Box<dyn Fn(&mut RunData, f64)>;

/// A fault that one check must notice.
struct Fault {
    /// Name of the check.
    check: &'static str,
    what: String,
    /// A size of the fault at which the check still passes.
    passes: f64,
    /// A size of the fault at which the check fails. If the check has a threshold, the size is just beyond it.
    fails: f64,
    plant: Plant,
}

/// Returns a run that contains the data for every check and passes all checks.
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

/// Whether each check passes; `None` = it has nothing to check.
fn results(run: &RunData) -> BTreeMap<&'static str, Option<bool>> {
    named_checks(run, &Table::of(run), &judge(run)).into_iter().map(|(name, check)| (name, check.map(|(passes, _)| passes))).collect()
}

/// Returns the row that the report uses for a metric of a variant: the row over all frames or, if there is none, the row of a single frame.
fn row<'a>(run: &'a mut RunData, metric: &str, variant: &str) -> &'a mut Row {
    let found = run.rows.iter_mut().filter(|row| row.metric == metric && row.variant == variant && row.lag.is_none());
    found.min_by_key(|row| row.frame).expect("every choice has this metric")
}

/// Returns the limit for the deviations of bias and variance, in standard errors. The limit depends on the number of estimates, which is
/// the number of stochastic choices.
fn limit(run: &RunData) -> f64 {
    let count = run.rows.iter().filter(|row| row.metric == "bias" && row.standard_error > Some(0.0)).count();
    assert!(count > 20, "{count} stochastic choices");
    sidak_limit(count, SEEDS)
}

fn faults() -> Vec<Fault> {
    let mut all: Vec<Fault> = Vec::new();
    let mut add = |check: &'static str, what: &str, [passes, fails]: [f64; 2], plant: Plant| {
        all.push(Fault { check, what: what.to_owned(), passes, fails, plant });
    };
    // The expected range is 2 to 4. Both ends pass, and the next numbers beyond them fail.
    let clumping = |run: &mut RunData, value: f64| row(run, "clumping", "auto").value = value;
    add("expectations", "a value above its range", [4.0, 4.0f64.next_up()], Box::new(clumping));
    add("expectations", "a value below its range", [2.0, 2.0f64.next_down()], Box::new(clumping));
    add("expectations", "a value of NaN", [3.0, f64::NAN], Box::new(clumping));
    // The smallest RMSE is 0.001. The standard error of the reference may be at most a tenth of it: 0.0001 passes, the next larger number fails.
    let tenth: f64 = 0.1 * 0.001;
    let reference = |run: &mut RunData, error: f64| {
        row(run, "rmse", "auto").value = 0.001;
        row(run, "reference_se", "reference").value = error;
    };
    add("references", "a standard error of the reference", [tenth, tenth.next_up()], Box::new(reference));
    add("references", "an unknown standard error", [tenth, f64::NAN], Box::new(reference));
    // Counts may differ from the promise by 0.01. For near cliff, 11.99 and 12.01 pass, and the next smaller and the next larger number
    // fail.
    for flavour in Flavour::ALL {
        let (name, promise) = (flavour.name(), f64::from(Estimator::Fc5.promised_fetches(flavour)));
        let count = move |run: &mut RunData, value: f64| row(run, "fetches_per_px", name).value = value;
        let (low, high) = (promise - 0.01, promise + 0.01);
        add("promises", &format!("too few fetches of {name}"), [low, low.next_down()], Box::new(count));
        if flavour == Flavour::FarAtlas {
            continue;
        }
        add("promises", &format!("too many fetches of {name}"), [high, high.next_up()], Box::new(count));
        // In a scene with colour modulation, all flavours except the virtual texture take one more fetch. If only one flavour takes one
        // more fetch, this is a fault.
        add("promises", &format!("one fetch more of {name}"), [promise, promise + 1.0], Box::new(count));
    }
    // For the far atlas, 2 to 3 fetches are accepted, with the same tolerance of 0.01: 3.01 passes, and the next larger number fails. A
    // scene in which the far atlas takes 3 fetches has colour modulation, so the other flavours, except the virtual texture, take one more
    // fetch, too.
    let modulated = |run: &mut RunData, value: f64| {
        for flavour in [Flavour::NearCliff, Flavour::FarCliff, Flavour::Splat] {
            row(run, "fetches_per_px", flavour.name()).value += 1.0;
        }
        row(run, "fetches_per_px", Flavour::FarAtlas.name()).value = value;
    };
    add("promises", "too many fetches of the far atlas", [3.0 + 0.01, (3.0f64 + 0.01).next_up()], Box::new(modulated));
    let count_of_splat = |run: &mut RunData, value: f64| row(run, "fetches_per_px", "splat").value = value;
    let of_splat = f64::from(Estimator::Fc5.promised_fetches(Flavour::Splat));
    add("promises", "a count of NaN", [of_splat, f64::NAN], Box::new(count_of_splat));
    // The largest bias must be less than the limit times its standard error. The sizes are shares of the limit.
    for sign in [1.0, -1.0] {
        let bias = move |run: &mut RunData, share: f64| {
            let limit = limit(run);
            let row = row(run, "bias", "auto");
            row.value = sign * share * limit * row.standard_error.expect("a bias has a standard error");
        };
        add("bias", "a bias", [1.0 - 1e-9, 1.0 + 1e-9], Box::new(bias));
    }
    let no_bias = |run: &mut RunData, value: f64| row(run, "bias", "auto").value = value;
    add("bias", "a bias of NaN", [0.0, f64::NAN], Box::new(no_bias));
    let error_of_bias = |run: &mut RunData, error: f64| {
        let row = row(run, "bias", "auto");
        (row.value, row.standard_error) = (0.0, Some(error));
    };
    add("bias", "a standard error of NaN", [1.0, f64::NAN], Box::new(error_of_bias));
    let predicted = |run: &mut RunData, value: f64| {
        row(run, "variance_theory", "auto").value = value;
        let measured = row(run, "variance", "auto");
        (measured.value, measured.standard_error) = (PREDICTED, Some(0.01 * PREDICTED));
    };
    add("variance", "a predicted variance of NaN", [PREDICTED, f64::NAN], Box::new(predicted));
    // The ratio of measured and predicted variance must lie between 0.8 and 1.25, both excluded: 1.2499999999999998 passes, 1.25 fails. The
    // standard error is 1 % of the variance, so no such deviation is chance.
    let ratio = |run: &mut RunData, ratio: f64| {
        row(run, "variance_theory", "auto").value = PREDICTED;
        let measured = row(run, "variance", "auto");
        (measured.value, measured.standard_error) = (ratio * PREDICTED, Some(0.01 * PREDICTED));
    };
    add("variance", "a variance that is too large", [1.25f64.next_down(), 1.25], Box::new(ratio));
    add("variance", "a variance that is too small", [0.8f64.next_up(), 0.8], Box::new(ratio));
    // A ratio of 1.5 lies outside that range. It passes nevertheless if the deviation, divided by its standard error, is less than the
    // number that `limit` returns. The planted quotient is this number times `share`.
    let deviation = |run: &mut RunData, share: f64| {
        let error = 0.5 * PREDICTED / (share * limit(run));
        row(run, "variance_theory", "auto").value = PREDICTED;
        let measured = row(run, "variance", "auto");
        (measured.value, measured.standard_error) = (1.5 * PREDICTED, Some(error));
    };
    add("variance", "a deviation that is not due to chance", [1.0 - 1e-9, 1.0 + 1e-9], Box::new(deviation));
    // No number may have two rows. The size of this fault is the number of additional rows.
    type IsOfKind = fn(&Row) -> bool;
    let kinds: [(&str, IsOfKind); 7] = [
        ("over all frames", |row| row.metric == "rmse" && row.frame.is_none()),
        ("of the first frame", |row| row.metric == "rmse" && row.frame == Some(0)),
        ("of a later frame", |row| row.metric == "rmse" && row.frame == Some(2)),
        ("with a lag", |row| row.metric == "flicker" && row.lag == Some(3)),
        ("of a spectrum", |row| row.metric == "power"),
        ("about a reference", |row| row.metric == "reference_se"),
        ("of a time", |row| row.metric == "gpu_ms:shading"),
    ];
    for (what, is_of_kind) in kinds {
        let repeat = move |run: &mut RunData, copies: f64| {
            for table in [&mut run.rows, &mut run.times] {
                if let Some(row) = table.iter().find(|row| is_of_kind(row)).cloned() {
                    table.extend(std::iter::repeat_n(Row { value: row.value * 1.5, ..row }, copies as usize));
                }
            }
        };
        add("doubles", &format!("a second row {what}"), [0.0, 1.0], Box::new(repeat));
    }
    all
}

#[test]
fn each_check_notices_its_own_faults_and_no_other() {
    let folder = Folder::new("planted");
    let sound = sound(&folder);
    let undamaged = results(&sound);
    for (name, passes) in &undamaged {
        // In a run without doubles, the check `doubles` has nothing to check.
        assert_eq!(*passes, (*name != "doubles").then_some(true), "{name}");
    }
    let faults = faults();
    let noticed: BTreeSet<&str> = faults.iter().map(|fault| fault.check).collect();
    assert_eq!(noticed, undamaged.keys().copied().collect::<BTreeSet<_>>(), "a check without a planted fault, or a fault without a check");
    for Fault { check, what, passes, fails, plant } in &faults {
        let with = |size: f64| {
            let mut run = sound.clone();
            plant(&mut run, size);
            results(&run)
        };
        assert_eq!(with(*passes), undamaged, "{what} of size {passes} must pass");
        let mut expected = undamaged.clone();
        expected.insert(*check, Some(false));
        assert_eq!(with(*fails), expected, "{what} of size {fails} must fail the check of {check}, and no other");
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
        ("expectations", "clumping", Some(false)),
        ("references", "reference_se", Some(false)),
        ("promises", "fetches_per_px", None),
        ("bias", "bias", None),
        ("variance", "variance_theory", None),
    ] {
        let mut expected = results(&sound);
        expected.insert(check, result);
        assert_eq!(without(metric), expected, "without {metric}");
    }
}

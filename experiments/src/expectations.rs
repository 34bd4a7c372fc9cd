//! Compares the measured values with the expectations of a definition.

use std::collections::BTreeMap;

use kernels::shared::signal::Signal;
use serde::Serialize;
use toml::Value;

use crate::definition::{Definition, Expectation, setting_text};
use crate::metrics;
use crate::rounds::is_stable;
use crate::row::{Field, Row};

/// The result of comparing a measured value with an expectation.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Verdict {
    /// The claim of the expectation.
    pub claim: String,
    /// The metric to which the claim applies.
    pub metric: String,
    /// The measured value; NaN if it does not exist.
    pub value: f64,
    /// The smallest and the largest expected value.
    pub range: [f64; 2],
    /// Whether the value lies in the range. It is false if the value does not exist or is NaN.
    pub met: bool,
    /// How the value was computed, or why it does not exist.
    pub why: String,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let word = if self.met { "holds" } else { "FAILS" };
        let [low, high] = self.range;
        write!(f, "{word}: {} [{}, expected {low} to {high}; {}]", self.claim.trim(), short(self.value), self.why)
    }
}

/// Formats a number with at most six decimals, without trailing zeros. A very small or very large number is written with six significant digits and
/// an exponent.
fn short(value: f64) -> String {
    match value.abs() {
        size if size == 0.0 || (1.0e-3..1.0e6).contains(&size) => {
            let text = format!("{value:.6}");
            text.trim_end_matches('0').trim_end_matches('.').to_owned()
        }
        _ => format!("{value:.5e}"),
    }
}

/// Returns a verdict for each expectation, in order.
///
/// `where` and `over` are keys of an expectation. Each of them gives values of columns and selects the rows with these values. The value is the mean
/// over the rows of the metric that match `where`. If `over` is given, this mean is divided by a second mean. The rows of the second mean match the
/// columns in `over`, and those columns of `where` that `over` does not contain. If no `frame` is given and the metric has rows over all frames, only
/// these rows are used. If no `signal` is given, rows of the lit picture are left out.
///
/// An expectation is not met if a selection has no rows, a mean is not finite, or the divisor is 0. An expectation about times or ratios of times is
/// also not met if the 95 % interval of a row is wider than ± 5 %, because the next run may then give a different answer.
pub fn evaluate(definition: &Definition, rows: &[Row], times: &[Row]) -> Vec<Verdict> {
    definition.expectations.iter().map(|expectation| judge(expectation, rows, times)).collect()
}

fn judge(expectation: &Expectation, rows: &[Row], times: &[Row]) -> Verdict {
    let result = value(expectation, rows, times);
    let [low, high] = expectation.range;
    let (value, met, why) = match result {
        Ok((value, why)) => (value, (low..=high).contains(&value), why),
        Err(why) => (f64::NAN, false, why),
    };
    Verdict { claim: expectation.claim.clone(), metric: expectation.metric.clone(), value, range: expectation.range, met, why }
}

fn value(expectation: &Expectation, rows: &[Row], times: &[Row]) -> Result<(f64, String), String> {
    let of = |metric: &str, selection: &BTreeMap<String, Value>| {
        let table = if metrics::find(metric).is_some_and(metrics::Metric::is_deterministic) { rows } else { times };
        mean(table, metric, selection)
    };
    let (first, count) = of(&expectation.metric, &expectation.selection)?;
    let Some(over) = &expectation.over else {
        return Ok((first, format!("mean of {count} rows of {}", expectation.metric)));
    };
    let mut selection = expectation.selection.clone();
    selection.extend(over.iter().map(|(column, value)| (column.clone(), value.clone())));
    let metric = match selection.remove("metric") {
        Some(value) => setting_text(&value),
        None => expectation.metric.clone(),
    };
    let (second, other_count) = of(&metric, &selection)?;
    let ratio = first / second;
    if !ratio.is_finite() {
        return Err(format!("{} divided by {} is not a finite number", short(first), short(second)));
    }
    Ok((ratio, format!("{} over {}, means of {count} and {other_count} rows", short(first), short(second))))
}

fn mean(table: &[Row], metric: &str, selection: &BTreeMap<String, Value>) -> Result<(f64, usize), String> {
    let agreeing = |row: &&Row| row.metric == metric && selection.iter().all(|(column, value)| agrees(row, column, value));
    let mut values: Vec<&Row> = table.iter().filter(agreeing).collect();
    if !selection.contains_key("signal") {
        values.retain(|row| row.signal != Signal::Lit.name());
    }
    if !selection.contains_key("frame") && values.iter().any(|row| row.frame.is_none()) {
        values.retain(|row| row.frame.is_none());
    }
    if values.is_empty() {
        let columns: Vec<String> = selection.iter().map(|(column, value)| format!("{column} = {}", setting_text(value))).collect();
        let place = if columns.is_empty() { String::new() } else { format!(" with {}", columns.join(", ")) };
        return Err(format!("there is no row of {metric}{place}"));
    }
    if metrics::is_time(metric) {
        let unstable = values.iter().filter(|row| !is_stable(row.value, row.standard_error)).count();
        if unstable > 0 {
            return Err(format!(
                "unstable rows of {metric}: {unstable} of {} (the 95 % interval is wider than \u{b1} 5 %, or not known): run it again while the machine has nothing \
                 else to do, or raise `times_budget_s`",
                values.len()
            ));
        }
    }
    let mean = values.iter().map(|row| row.value).sum::<f64>() / values.len() as f64;
    if mean.is_finite() { Ok((mean, values.len())) } else { Err(format!("the mean of {} rows of {metric} is {mean}", values.len())) }
}

fn agrees(row: &Row, column: &str, value: &Value) -> bool {
    match Row::column(column).map(|column| column.field) {
        Some(Field::Text(get, _)) => get(row) == setting_text(value),
        Some(Field::Count(get, _)) => get(row).map(i64::from) == value.as_integer(),
        Some(Field::Number(get, _)) => {
            let wanted = value.as_float().or_else(|| value.as_integer().map(|number| number as f64));
            // A definition gives the mean frequency of a band as a rounded decimal number, so a difference of one millionth is accepted.
            get(row).zip(wanted).is_some_and(|(found, wanted)| (found - wanted).abs() <= 1e-6 * wanted.abs().max(1.0))
        }
        Some(Field::Value(..)) | None => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(variant: &str, metric: &str, frame: Option<u32>, lag: Option<u32>, value: f64) -> Row {
        Row { variant: variant.to_owned(), metric: metric.to_owned(), frame, lag, value, ..Row::default() }
    }

    fn expectation(metric: &str, selection: &str, over: Option<&str>, range: [f64; 2]) -> Expectation {
        let table = |text: &str| text.parse::<toml::Table>().unwrap().into_iter().collect::<BTreeMap<_, _>>();
        Expectation { claim: "x".to_owned(), metric: metric.to_owned(), selection: table(selection), over: over.map(table), range }
    }

    fn verdict(expectation: &Expectation) -> Verdict {
        let rows = [
            row("auto", "rmse", Some(0), None, 1.0),
            row("auto", "rmse", Some(1), None, 3.0),
            row("splat", "rmse", None, None, 8.0),
            row("splat", "rmse", Some(0), None, 100.0),
            row("auto", "added", None, Some(1), 0.5),
            row("auto", "added", None, Some(2), 0.25),
            Row { signal: "lit".to_owned(), ..row("auto", "added", None, Some(1), 0.75) },
            Row { signal: "albedo".to_owned(), ..row("splat", "added", None, Some(1), 0.125) },
            Row { signal: "lit".to_owned(), ..row("splat", "added", None, Some(1), 0.375) },
            row("vt", "added", None, Some(1), 0.0),
            row("vt", "mse", None, None, f64::NAN),
            row("auto", "variance", None, None, 2.0),
            row("auto", "variance_theory", None, None, 2.5),
        ];
        // A standard error of 2.5 % gives an interval of ± 4.9 %, and one of 2.6 % gives ± 5.1 %.
        let time = |variant: &str, metric: &str, value: f64, share: f64| Row {
            standard_error: Some(share * value),
            ..row(variant, metric, None, None, value)
        };
        let times = [
            time("auto", "gpu_ms:shading", 2.0, 0.0),
            time("splat", "gpu_ms:shading", 12.0, 0.025),
            time("vt", "gpu_ms:shading", 3.0, 0.026),
            time("splat", "gpu_ratio:shading", 6.5, 0.025),
            time("vt", "gpu_ratio:shading", 1.5, 0.026),
            row("far-atlas", "gpu_ratio:shading", None, None, 1.0),
        ];
        judge(expectation, &rows, &times)
    }

    #[test]
    fn means_ratios_and_their_ranges() {
        let of = |metric, selection, over, range| verdict(&expectation(metric, selection, over, range));
        let mean = of("rmse", "variant = 'auto'", None, [2.0, 2.0]);
        assert!(mean.met && mean.value == 2.0, "{mean}");
        assert!(!of("rmse", "variant = 'auto'", None, [2.1, 9.0]).met);
        // If no frame is given, only rows over all frames are used.
        assert_eq!(of("rmse", "variant = 'splat'", None, [0.0, 9.0]).value, 8.0);
        assert_eq!(of("rmse", "variant = 'splat'\nframe = 0", None, [0.0, 9.0]).value, 100.0);
        assert_eq!(of("added", "variant = 'auto'\nlag = 2", None, [0.0, 1.0]).value, 0.25);
        // Rows of the lit picture are used only if they are selected explicitly.
        let (splat, lit) = ("variant = 'splat'\nlag = 1", "variant = 'splat'\nlag = 1\nsignal = 'lit'");
        assert_eq!(of("added", splat, None, [0.0, 1.0]).value, 0.125);
        assert_eq!(of("added", lit, None, [0.0, 1.0]).value, 0.375);
        assert_eq!(of("added", splat, Some("signal = 'lit'"), [0.0, 1.0]).value, 1.0 / 3.0);
        assert_eq!(of("added", lit, Some("variant = 'auto'"), [0.0, 1.0]).value, 0.5);
        let ratio = of("rmse", "variant = 'splat'", Some("variant = 'auto'"), [4.0, f64::INFINITY]);
        assert!(ratio.met && ratio.value == 4.0, "{ratio}");
        assert_eq!(of("gpu_ms:shading", "variant = 'splat'", Some("variant = 'auto'"), [0.0, 9.0]).value, 6.0);
        assert_eq!(of("gpu_ratio:shading", "variant = 'splat'", None, [0.0, 9.0]).value, 6.5);
        assert_eq!(of("variance", "variant = 'auto'", Some("metric = 'variance_theory'"), [0.0, 1.0]).value, 0.8);
    }

    #[test]
    fn nothing_found_and_no_number_fail_even_in_the_widest_range() {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        for (metric, selection, over) in [
            ("rmse", "variant = 'vt'", None),
            ("psnr", "", None),
            ("mse", "variant = 'vt'", None),
            ("added", "variant = 'auto'\nlag = 1", Some("variant = 'vt'")),
            ("rmse", "variant = 'auto'", Some("variant = 'far-atlas'")),
            ("gpu_ms:lighting", "", Some("variant = 'auto'")),
        ] {
            let verdict = verdict(&expectation(metric, selection, over, all));
            assert!(!verdict.met && verdict.value.is_nan() && !verdict.why.is_empty(), "{metric}: {verdict}");
        }
        assert!(verdict(&expectation("rmse", "variant = 'auto'", None, all)).met, "a finite value must lie in the infinite range");
    }

    #[test]
    fn unstable_times_meet_no_expectation() {
        let all = [f64::NEG_INFINITY, f64::INFINITY];
        for (metric, selection, over) in [
            ("gpu_ms:shading", "variant = 'vt'", Some("variant = 'auto'")),
            ("gpu_ms:shading", "variant = 'auto'", Some("variant = 'vt'")),
            ("gpu_ratio:shading", "variant = 'vt'", None),
            // A number without a standard error comes from fewer than six rounds.
            ("gpu_ratio:shading", "variant = 'far-atlas'", None),
        ] {
            let verdict = verdict(&expectation(metric, selection, over, all));
            assert!(!verdict.met && verdict.value.is_nan() && verdict.why.contains(": 1 of 1 ("), "{metric}: {verdict}");
            assert!(verdict.why.contains("unstable") && verdict.why.contains("times_budget_s"), "{verdict}");
        }
        // One unstable row makes the mean unusable.
        let verdict = verdict(&expectation("gpu_ms:shading", "", Some("variant = 'auto'"), all));
        assert!(!verdict.met && verdict.why.contains(": 1 of 3 ("), "{verdict}");
    }

    #[test]
    fn numbers_are_short() {
        assert_eq!(short(0.0), "0");
        assert_eq!(short(12.5), "12.5");
        assert_eq!(short(1.0 / 3.0), "0.333333");
        assert_eq!(short(1.0e-9), "1.00000e-9");
    }
}

//! Three checks of a run. They check whether the counted fetches are those that the flavours promise, whether chance explains the biases, and whether
//! variances agree with the theory. `columns.rs` has the other checks.

use kernels::variant::Flavour;
use serde::Serialize;

use super::numbers::number;
use crate::significance::{LEVEL, POWER, SMALLEST_PROBABILITY, detectable, limit, sidak};

/// The result of a check.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mark {
    /// The checked statement holds within the stated accuracy.
    Passes,
    /// The checked statement does not hold.
    Fails,
    /// The run has too few or unusable data: some rows cannot be judged, or the numbers describe only a small part of the picture.
    Unclear,
}

impl Mark {
    /// The mark of a check that has only two results.
    pub(super) fn of(passes: bool) -> Mark {
        if passes { Mark::Passes } else { Mark::Fails }
    }
}

/// A check: its result, and a sentence that describes it.
pub(super) type Check = (Mark, String);

/// The promised and the counted number of fetches of a flavour (one of the five ways to shade a terrain pixel). The promise is the number that the
/// estimator states for the flavour. In a scene with colour modulation, it is one more, except for the virtual texture. For the far atlas, the
/// promise is always the range 2 to 3.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct GoldenRow {
    /// The name of the flavour. If the run has several views, the name of the view follows.
    pub(crate) flavour: String,
    /// The promise: a number, a sum or a range.
    pub(crate) promised: String,
    /// Mean number of fetches per terrain pixel, counted in the shader; NaN if the row of the run contains NaN.
    pub(crate) counted: f64,
    /// Whether the count agrees with the promise.
    pub(crate) agrees: bool,
}

/// Largest accepted difference between the mean count and the promised number of fetches.
const COUNT_TOLERANCE: f64 = 0.01;

impl GoldenRow {
    /// Compares the counted fetches of a flavour with its promise. `promise`: the number that the estimator states. `modulated`: whether the scene
    /// has colour modulation.
    pub(crate) fn of(name: String, flavour: Flavour, promise: u32, counted: f64, modulated: bool) -> GoldenRow {
        let more = u32::from(modulated && flavour != Flavour::VirtualTexture);
        let (promised, low, high) = match flavour {
            Flavour::FarAtlas => ("2-3".to_owned(), 2.0, 3.0),
            _ if more > 0 => (format!("{promise} + {more}"), f64::from(promise + more), f64::from(promise + more)),
            _ => (promise.to_string(), f64::from(promise), f64::from(promise)),
        };
        let agrees = (low - COUNT_TOLERANCE..=high + COUNT_TOLERANCE).contains(&counted);
        GoldenRow { flavour: name, promised, counted, agrees }
    }
}

/// Checks whether all flavours take the promised number of fetches. Returns the result and its description; `None` if there are no rows.
pub(super) fn promises(rows: &[GoldenRow]) -> Option<Check> {
    let kept = rows.iter().filter(|g| g.agrees).count();
    let all = rows.len();
    let unknown: Vec<&str> = rows.iter().filter(|g| !g.counted.is_finite()).map(|g| g.flavour.as_str()).collect();
    (all > 0)
        .then(|| (Mark::of(kept == all), format!("{kept} of {all} flavours take the fetches they promise{}", without_number(&unknown))))
}

/// Limit of the number of rows that [`without_number`] names.
const NAMED: usize = 4;

/// Returns the end of the sentence of [`promises`]. `names`: the rows whose count is NaN or infinite. The result is empty if there are none.
fn without_number(names: &[&str]) -> String {
    if names.is_empty() {
        return String::new();
    }
    let more = if names.len() > NAMED { format!(" and {} more", names.len() - NAMED) } else { String::new() };
    let first: Vec<&str> = names.iter().take(NAMED).copied().collect();
    format!("; without a finite number: {}{more}", first.join(", "))
}

/// A measured mean, with what is needed to test it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Measured {
    /// Name of the choice.
    pub(super) name: String,
    /// The mean.
    pub(super) value: f64,
    /// The expected value of the mean; NaN = not known.
    pub(super) expected: f64,
    /// Standard error of the mean; `None` = not known.
    pub(super) standard_error: Option<f64>,
    /// Degrees of freedom of the standard error; `None` = not known.
    pub(super) freedom: Option<f64>,
    /// The p-value of a second test, which also finds deviations of opposite signs that cancel over the picture. It is the probability that chance
    /// alone causes deviations at least as large as the measured ones. `None` = not measured.
    pub(super) probability: Option<f64>,
}

/// What a check of means accepts, as a function of the expected value.
struct Rule {
    /// Deviations up to this size are accepted even if they are certain, because they have a known cause.
    slack: fn(f64) -> f64,
    /// Limit of the smallest deviation that the test would find. If this deviation is above the limit, the test says too little. The row then cannot
    /// be judged, unless its own deviation is too large to be accepted.
    useful: fn(f64) -> f64,
}

/// Largest bias that rounding can cause for albedos below 1/4, as linear albedo. Devices may round the values of the G-buffer to f16 towards 0. Over
/// many pixels, the blend then loses half a step of f16 on average. Each of its materials loses between nothing and a whole step. So the blend
/// differs from its materials by up to half a step, which is 2^-14 for albedos from 1/8 to 1/4.
pub(super) const ROUNDING: f64 = 1.0 / 16_384.0;

const BIAS: Rule = Rule { slack: |_| ROUNDING, useful: |_| 0.05 };
const VARIANCE: Rule = Rule { slack: |expected| 0.01 * expected, useful: |expected| 0.25 * expected };

/// A row that was tested.
struct Judged<'a> {
    row: &'a Measured,
    /// The absolute deviation from the expected value.
    deviation: f64,
    standard_error: f64,
    /// Largest deviation that chance explains, in standard errors. The slack of the rule is not included.
    limit: f64,
    /// Largest deviation that is accepted.
    allowed: f64,
    /// Smallest deviation that is found with the probability [`POWER`], if all pixels have this deviation.
    detectable: f64,
}

impl<'a> Judged<'a> {
    /// Tests a row.
    ///
    /// # Errors
    /// The reason why the row cannot be judged.
    fn of(row: &'a Measured, rule: &Rule, level: f64, seeds: u32) -> Result<Judged<'a>, String> {
        let &Measured { value, expected, standard_error, freedom, .. } = row;
        if !value.is_finite() {
            return Err("its value is not a number".to_owned());
        }
        if !expected.is_finite() {
            return Err("nothing is predicted for it".to_owned());
        }
        let Some(standard_error) = standard_error else {
            let reason = if seeds < 2 { "one seed has no standard error" } else { "its standard error is not known" };
            return Err(reason.to_owned());
        };
        if standard_error <= 0.0 {
            return Err("its pictures do not differ between seeds".to_owned());
        }
        let Some(freedom) = freedom else { return Err("the degrees of freedom of its standard error are not known".to_owned()) };
        let (slack, limit) = ((rule.slack)(expected), limit(level, freedom));
        let judged = Judged {
            row,
            deviation: (value - expected).abs(),
            standard_error,
            limit,
            allowed: slack + limit * standard_error,
            detectable: slack + detectable(level, freedom) * standard_error,
        };
        if !judged.is_off() && judged.detectable > (rule.useful)(expected) {
            return Err(format!("only a deviation of {} or more would be found", number(judged.detectable)));
        }
        Ok(judged)
    }

    /// Whether the deviation is larger than the largest accepted one.
    fn is_off(&self) -> bool {
        self.deviation > self.allowed
    }
}

/// The rows of a check and the results of their tests.
struct Family<'a> {
    judged: Vec<Judged<'a>>,
    /// Rows that cannot be judged, with the reasons.
    doubts: Vec<(&'a str, String)>,
    /// Number of tests.
    tests: usize,
    /// Level of each test.
    level: f64,
    seeds: u32,
}

impl<'a> Family<'a> {
    fn of(rows: &'a [Measured], rule: &Rule, seeds: u32) -> Family<'a> {
        let tests = rows.len() + rows.iter().filter(|row| row.probability.is_some()).count();
        let level = sidak(tests);
        let mut family = Family { judged: Vec::new(), doubts: Vec::new(), tests, level, seeds };
        for row in rows {
            match Judged::of(row, rule, level, seeds) {
                Ok(judged) => family.judged.push(judged),
                Err(reason) => family.doubts.push((row.name.as_str(), reason)),
            }
        }
        family
    }

    fn is_off(&self) -> bool {
        self.judged.iter().any(Judged::is_off)
    }

    /// Returns the row whose deviation is largest relative to the largest accepted deviation.
    fn furthest(&self) -> Option<&Judged<'a>> {
        self.judged.iter().max_by(|a, b| (a.deviation / a.allowed).total_cmp(&(b.deviation / b.allowed)))
    }

    /// Describes how far the row that [`Family::furthest`] returns is from its expected value. `what` names the deviation.
    fn largest(&self, what: &str) -> Option<String> {
        let Judged { row, deviation, standard_error, limit, .. } = self.furthest()?;
        Some(format!(
            "{what} is {:.1} standard errors ({}), at most {limit:.1} expected by chance (level {} % for all {} tests together, {} seeds)",
            deviation / standard_error,
            row.name,
            100.0 * LEVEL,
            self.tests,
            self.seeds
        ))
    }

    /// Names the rows that cannot be judged.
    fn doubts(&self) -> Option<String> {
        const NAMED: usize = 3;
        let named: Vec<String> = self.doubts.iter().take(NAMED).map(|(name, reason)| format!("{name} ({reason})")).collect();
        let more = self.doubts.len().saturating_sub(NAMED);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        (!named.is_empty()).then(|| format!("cannot tell for {}{more}", named.join(", ")))
    }

    /// Returns the mark of the check. `found`: whether another test of these rows has found a fault. `unclear`: whether another test was not
    /// possible.
    fn mark(&self, found: bool, unclear: bool) -> Mark {
        match (self.is_off() || found, unclear || !self.doubts.is_empty()) {
            (true, _) => Mark::Fails,
            (false, true) => Mark::Unclear,
            (false, false) => Mark::Passes,
        }
    }
}

/// Joins the parts of a sentence.
fn sentence(parts: impl IntoIterator<Item = Option<String>>) -> String {
    parts.into_iter().flatten().collect::<Vec<_>>().join("; ")
}

/// Says that compositions were not tested, and why not.
fn following(follow: usize, why: &str) -> Option<String> {
    (follow > 0).then(|| format!("{follow} other random rows are compositions of these flavours, and {why}"))
}

/// Checks whether chance and rounding explain the biases. Each row has a test of its mean over the picture. If it has a probability
/// ([`Measured::probability`]), it also has a test of biases that cancel over the picture. `follow` is the number of other rows, which combine
/// flavours of the given rows and are not tested. `None` if there are no rows.
pub(super) fn bias(rows: &[Measured], follow: usize, seeds: u32) -> Option<Check> {
    if rows.is_empty() {
        return None;
    }
    let family = Family::of(rows, &BIAS, seeds);
    let probabilities = || rows.iter().filter_map(|row| Some((row.probability.filter(|p| !p.is_nan())?, row.name.as_str())));
    let smallest = probabilities().min_by(|a, b| a.0.total_cmp(&b.0));
    let cancelling = probabilities().filter(|(p, _)| *p < family.level).count();
    // With very many rows, the level of each test may be smaller than the smallest probability that a test by random signs can give.
    let unreachable = smallest.is_some() && SMALLEST_PROBABILITY >= family.level;
    let is_off = |row: &Measured| {
        let mean = family.judged.iter().any(|judged| std::ptr::eq(judged.row, row) && judged.is_off());
        mean || row.probability.is_some_and(|p| p < family.level)
    };
    let off = rows.iter().filter(|row| is_off(row)).count();
    let mark = family.mark(cancelling > 0, unreachable);
    let (all, told) = (rows.len(), family.judged.len());
    let result = match mark {
        Mark::Fails => format!("{off} of {all} random rows are biased"),
        Mark::Passes => format!("none of {all} random rows is found to be biased"),
        Mark::Unclear if told == 0 => format!("cannot tell whether {all} random rows are biased"),
        Mark::Unclear => format!("of {all} random rows, {told} could be tested, and none of these is found to be biased"),
    };
    let patterns = match smallest {
        Some(_) if unreachable => Some(format!("biases that cancel over the picture cannot be tested in {all} rows at once")),
        Some((p, name)) => Some(format!(
            "biases that cancel over the picture have a probability of at least {} ({name}), and below {} they would be found",
            number(p),
            number(family.level)
        )),
        None => Some("biases that cancel over the picture were not tested".to_owned()),
    };
    // The row with the least power decides what the check as a whole would have found.
    let most = family.judged.iter().map(|judged| judged.detectable).max_by(f64::total_cmp);
    let power = most
        .map(|most| format!("a bias of {} % of the albedo range everywhere would be found with probability {POWER}", number(100.0 * most)));
    let follow = following(follow, "a weighted mean of unbiased values is unbiased");
    Some((mark, sentence([Some(result), family.largest("the largest"), patterns, power, family.doubts(), follow])))
}

/// Checks whether the mean squared differences from the exact blend are the predicted variances. `follow` is the number of other rows, which combine
/// flavours of the given rows and are not tested. `None` if there are no rows, or if nothing is predicted for any of them.
pub(super) fn variance(rows: &[Measured], follow: usize, seeds: u32) -> Option<Check> {
    if rows.iter().all(|row| row.expected.is_nan()) {
        return None;
    }
    let family = Family::of(rows, &VARIANCE, seeds);
    let mark = family.mark(false, false);
    let (all, told) = (rows.len(), family.judged.len());
    let ratios = || family.judged.iter().map(|judged| judged.row.value / judged.row.expected);
    let range = match (ratios().min_by(f64::total_cmp), ratios().max_by(f64::total_cmp)) {
        (Some(low), Some(high)) if high - low < 0.005 => Some(format!("{high:.2}")),
        (Some(low), Some(high)) => Some(format!("{low:.2} to {high:.2}")),
        _ => None,
    };
    let rows = if told < all { format!("{told} of {all} random rows") } else { format!("{all} random rows") };
    let result = match range {
        Some(range) => format!("the mean squared difference from the exact blend is {range} times the predicted variance in {rows}"),
        None => format!("cannot tell whether {all} random rows have the predicted variance"),
    };
    let most = family.judged.iter().map(|judged| judged.detectable / judged.row.expected).max_by(f64::total_cmp);
    let power = most.map(|most| format!("a deviation of {} % everywhere would be found with probability {POWER}", number(100.0 * most)));
    let follow = following(follow, "flavours draw independent numbers, so their variances add up");
    Some((mark, sentence([Some(result), family.largest("the largest deviation"), power, family.doubts(), follow])))
}

#[cfg(test)]
mod tests {
    use kernels::shading::Estimator;

    use super::*;

    /// With this many degrees of freedom, the uncertainty of the standard errors themselves is negligible.
    const MANY: f64 = 1e5;
    const SEEDS: u32 = 4;

    fn measured(name: &str, value: f64, standard_error: f64) -> Measured {
        let (standard_error, freedom) = (Some(standard_error), Some(MANY));
        Measured { name: name.to_owned(), value, expected: 0.0, standard_error, freedom, probability: None }
    }

    fn marked(rows: &[Measured]) -> Option<Mark> {
        bias(rows, 0, SEEDS).map(|check| check.0)
    }

    #[test]
    fn promises_are_kept_or_seen_broken() {
        let agrees = |flavour, counted, modulated| {
            GoldenRow::of(String::new(), flavour, Estimator::Fc5.promised_fetches(flavour), counted, modulated).agrees
        };
        assert!(agrees(Flavour::NearCliff, 12.0, false) && agrees(Flavour::NearCliff, 13.0, true) && agrees(Flavour::FarAtlas, 2.4, false));
        assert!(agrees(Flavour::VirtualTexture, 4.0, true));
        assert!(
            !agrees(Flavour::NearCliff, 12.02, false) && !agrees(Flavour::NearCliff, 13.0, false) && !agrees(Flavour::FarAtlas, 1.9, false)
        );
        assert!(!agrees(Flavour::VirtualTexture, 5.0, true) && !agrees(Flavour::Splat, f64::NAN, false));
        assert_eq!(promises(&[]), None);
        let rows = [12.0, 12.5].map(|counted| GoldenRow::of(String::new(), Flavour::NearCliff, 12, counted, false));
        assert_eq!(promises(&rows).map(|c| c.0), Some(Mark::Fails));
        assert_eq!(promises(&rows[..1]).map(|c| c.0), Some(Mark::Passes));
        let rows =
            [12.0, f64::NAN].map(|counted| GoldenRow::of(format!("near-cliff of {counted}"), Flavour::NearCliff, 12, counted, false));
        let (mark, text) = promises(&rows).expect("two rows");
        assert!(
            mark == Mark::Fails
                && text.ends_with("1 of 2 flavours take the fetches they promise; without a finite number: near-cliff of NaN"),
            "{text}"
        );
        assert_eq!(without_number(&["a", "b", "c", "d", "e", "f"]), "; without a finite number: a, b, c, d and 2 more");
    }

    #[test]
    fn biases_are_held_to_chance_and_rounding() {
        // If there is only one test, its limit is 3.29 standard errors. With the allowance of 0.61 standard errors for rounding, 3.9 are accepted.
        assert_eq!(marked(&[measured("a", 3.85e-4, 1e-4)]), Some(Mark::Passes));
        let (mark, text) = bias(&[measured("a", -3.95e-4, 1e-4)], 0, SEEDS).expect("a row");
        assert!(
            mark == Mark::Fails && text.contains("1 of 1 random rows are biased") && text.contains("3.9 standard errors (a)"),
            "{text}"
        );
        // The smallest bias that is found with a probability of 0.99 is 3.291 (limit) + 2.326 (power) + 0.610 (rounding) standard errors.
        assert!(text.contains("a bias of 0.0623 % of the albedo range everywhere would be found with probability 0.99"), "{text}");
        assert!(text.contains("biases that cancel over the picture were not tested") && !text.contains("compositions"), "{text}");
        // The same bias is accepted as chance if it is the largest of 600 biases, or if its standard error is uncertain.
        let many: Vec<Measured> = (0..600).map(|i| measured("a", if i == 7 { 3.95e-4 } else { 0.0 }, 1e-4)).collect();
        assert_eq!(marked(&many), Some(Mark::Passes));
        let uncertain = Measured { freedom: Some(3.0), ..measured("a", 3.95e-4, 1e-4) };
        assert_eq!(marked(std::slice::from_ref(&uncertain)), Some(Mark::Passes));
        assert!(bias(&[uncertain], 12, SEEDS).is_some_and(|(_, text)| text.contains("12 other random rows are compositions")));
        assert_eq!(bias(&[], 3, SEEDS), None);
    }

    #[test]
    fn biases_that_cancel_are_found_by_their_probability() {
        // Each of the two rows has two tests, so the level of each test is 0.001 / 4.
        let with = |probability: f64| {
            let row = |name: &str, p: f64| Measured { probability: Some(p), ..measured(name, 0.0, 1e-4) };
            bias(&[row("a", 0.4), row("b", probability)], 0, SEEDS).expect("two rows")
        };
        let (mark, text) = with(2.6e-4);
        assert!(mark == Mark::Passes && text.contains("at least 0.00026 (b), and below 0.00025"), "{text}");
        let (mark, text) = with(2.4e-4);
        assert!(mark == Mark::Fails && text.contains("1 of 2 random rows are biased"), "{text}");
        assert_eq!(with(f64::NAN).0, Mark::Passes);
        // With 1000 rows, the level of each test is smaller than the smallest probability that a test by random signs can give.
        let many: Vec<Measured> = (0..1000).map(|i| Measured { probability: Some(0.5), ..measured(&i.to_string(), 0.0, 1e-4) }).collect();
        let (mark, text) = bias(&many, 0, SEEDS).expect("rows");
        assert!(mark == Mark::Unclear && text.contains("cannot be tested in 1000 rows"), "{text}");
    }

    #[test]
    fn rows_without_power_are_named_and_never_pass() {
        let good = measured("good", 1e-5, 1e-4);
        let because = |row: Measured, seeds: u32, reason: &str| {
            let (mark, text) = bias(std::slice::from_ref(&row), 0, seeds).expect("a row");
            assert!(
                mark == Mark::Unclear && text.starts_with("cannot tell whether 1 random rows are biased") && text.contains(reason),
                "{text}"
            );
            assert!(!text.contains("would be found with probability"), "{text}");
            // If another row can be judged, the result is about that row only.
            let (mark, text) = bias(&[good.clone(), row.clone()], 0, seeds).expect("rows");
            assert!(
                mark == Mark::Unclear && text.starts_with("of 2 random rows, 1 could be tested, and none of these is found to be biased"),
                "{text}"
            );
            assert!(text.contains(&format!("cannot tell for bad ({reason}")), "{text}");
            // A bias of another row is found, although this row cannot be judged.
            let (mark, text) = bias(&[measured("off", 0.01, 1e-4), row], 0, seeds).expect("rows");
            assert!(
                mark == Mark::Fails && text.contains("1 of 2 random rows are biased") && text.contains("standard errors (off)"),
                "{text}"
            );
        };
        because(measured("bad", f64::NAN, 1e-4), SEEDS, "its value is not a number");
        because(measured("bad", 0.0, 0.0), SEEDS, "its pictures do not differ between seeds");
        because(Measured { standard_error: None, freedom: None, ..measured("bad", 0.0, 0.0) }, 1, "one seed has no standard error");
        because(Measured { standard_error: None, freedom: None, ..measured("bad", 0.0, 0.0) }, SEEDS, "its standard error is not known");
        because(Measured { freedom: None, ..measured("bad", 0.0, 1e-4) }, SEEDS, "the degrees of freedom");
        because(measured("bad", 0.0, 0.02), SEEDS, "only a deviation of");
        // With one degree of freedom, as from two seeds and one area, the limit is 637 standard errors if there is one test, and 1273 if there are
        // two.
        because(Measured { freedom: Some(1.0), ..measured("bad", 0.0, 1e-4) }, 2, "only a deviation of");
        // A deviation that is far beyond its limit is found even if smaller ones would not be.
        assert_eq!(marked(&[measured("off", 0.2, 0.02)]), Some(Mark::Fails));
        // At most three rows are named.
        let many: Vec<Measured> = (0..9).map(|i| measured(&format!("row {i}"), f64::NAN, 1e-4)).collect();
        let (_, text) = bias(&many, 0, SEEDS).expect("rows");
        assert!(text.contains("row 2 (") && !text.contains("row 3 (") && text.contains("and 6 more"), "{text}");
    }

    #[test]
    fn variances_are_held_to_the_prediction() {
        let with = |value: f64, error: f64| {
            let row = Measured { expected: 1.0, ..measured("a", value, error) };
            variance(&[row], 2, SEEDS).expect("a prediction")
        };
        // If there is only one test, its limit is 3.29 standard errors. In addition, 1 % of the prediction is accepted.
        assert_eq!([1.0 + 0.042, 1.0 - 0.042, 1.0 + 0.044, 1.0 - 0.044].map(|value| with(value, 0.01).0), {
            use Mark::{Fails, Passes};
            [Passes, Passes, Fails, Fails]
        });
        let (mark, text) = with(1.044, 0.01);
        assert!(mark == Mark::Fails && text.contains("is 1.04 times the predicted variance in 1 random rows"), "{text}");
        assert!(text.contains("a deviation of 6.62 % everywhere would be found with probability 0.99"), "{text}");
        assert!(text.contains("2 other random rows are compositions") && text.contains("4.4 standard errors (a)"), "{text}");
        // If only a deviation of more than a quarter would be found, the row cannot be judged.
        assert_eq!([with(1.0, 0.042).0, with(1.0, 0.044).0], [Mark::Passes, Mark::Unclear]);
        let (mark, text) = with(f64::NAN, 0.01);
        assert!(mark == Mark::Unclear && text.starts_with("cannot tell whether 1 random rows have the predicted variance"), "{text}");
        assert_eq!(variance(&[], 0, SEEDS), None);
        let unpredicted = Measured { expected: f64::NAN, ..measured("a", 1.0, 0.01) };
        assert_eq!(variance(std::slice::from_ref(&unpredicted), 0, SEEDS), None);
        let predicted = Measured { expected: 1.0, ..measured("b", 1.0, 0.01) };
        let (mark, text) = variance(&[unpredicted, predicted], 0, SEEDS).expect("one prediction");
        assert!(
            mark == Mark::Unclear && text.contains("in 1 of 2 random rows") && text.contains("a (nothing is predicted for it)"),
            "{text}"
        );
    }
}

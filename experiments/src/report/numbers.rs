//! Formats numbers, compares them by statistical tests, and computes Pareto fronts.

use crate::significance::{self, limit};

/// The significance level of a Pareto front, and of a ranking in a sentence: the accepted probability that chance alone causes at least one wrong
/// statement. A wrong statement puts a choice on the front that does not belong there, or says that a value of the ranking differs from the best one.
/// (The level of the checks is smaller: [`significance::LEVEL`].)
pub(super) const LEVEL: f64 = 0.05;

/// A measured value with its standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Estimate {
    pub(super) value: f64,
    /// Standard error; 0 = the value is exact, or its standard error is not known; infinite = the value must not count as different from any other.
    pub(super) error: f64,
    /// Degrees of freedom of the standard error, at least 1; infinite = the standard error is certain.
    pub(super) freedom: f64,
}

impl Estimate {
    /// Returns an estimate without a standard error.
    pub(super) fn exact(value: f64) -> Estimate {
        Estimate { value, error: 0.0, freedom: f64::INFINITY }
    }

    /// Whether this value is larger than `other` at the significance level `level`, which is at most 0.5. This is a one-sided test with Student's t
    /// distribution and the degrees of freedom by Welch and Satterthwaite. Values without standard errors are compared directly.
    pub(super) fn is_above(self, other: Estimate, level: f64) -> bool {
        let difference = self.value - other.value;
        let error = self.error.hypot(other.error);
        if !(difference > 0.0 && error > 0.0) {
            return difference > 0.0;
        }
        // `limit` expects the level of a two-sided test, which is twice that of a one-sided test.
        difference > limit(2.0 * level, freedom_of_sum([(self.error, self.freedom), (other.error, other.freedom)])) * error
    }

    /// Returns the half-width of the 95 % confidence interval; `None` = the standard error is 0 or infinite.
    pub(super) fn half(self) -> Option<f64> {
        (self.error > 0.0 && self.error.is_finite()).then(|| half_width(self.error, self.freedom))
    }

    /// Returns the ratio of this value to `other`, with its standard error by the delta method.
    pub(super) fn ratio(self, other: Estimate) -> Estimate {
        let value = self.value / other.value;
        let relative = |estimate: Estimate| (estimate.error / estimate.value).abs();
        let error = value.abs() * relative(self).hypot(relative(other));
        if [self, other].iter().any(|estimate| estimate.error.is_infinite()) {
            return Estimate { error: f64::INFINITY, ..Estimate::exact(value) };
        }
        if !(error > 0.0 && error.is_finite()) {
            return Estimate::exact(value);
        }
        Estimate { value, error, freedom: freedom_of_sum([(relative(self), self.freedom), (relative(other), other.freedom)]) }
    }
}

/// Returns the degrees of freedom of the standard error of a sum or difference. `terms`: the standard error of each term, with its degrees of freedom
/// (Welch 1947, Satterthwaite 1946).
fn freedom_of_sum(terms: [(f64, f64); 2]) -> f64 {
    let variance: f64 = terms.iter().map(|(error, _)| error * error).sum();
    let doubt: f64 = terms.iter().map(|(error, freedom)| error.powi(4) / freedom).sum();
    // Without rounding, the result would be at least the smaller of the two numbers of degrees of freedom. This is therefore used as its lower limit.
    // Otherwise, rounding could make the result smaller than 1, for which `limit` is infinite.
    let [(_, one), (_, other)] = terms;
    if doubt > 0.0 { (variance * variance / doubt).max(one.min(other)) } else { f64::INFINITY }
}

/// Returns the half-width of a 95 % confidence interval. If the standard error comes from few values, it is itself uncertain, so the half-width
/// is more than 1.96 standard errors.
pub(super) fn half_width(standard_error: f64, freedom: f64) -> f64 {
    limit(0.05, freedom) * standard_error
}

/// Returns the level for each of `count` statements, such that the level for all of them together is [`LEVEL`] (Šidák's correction).
pub(super) fn level_of_each(count: usize) -> f64 {
    significance::sidak_at(LEVEL, count)
}

/// Returns the level of [`Estimate::is_above`] for each comparison of a ranking. A ranking compares the best of `values` values with each of the
/// others. The data decide which value is the best, so any two values may be compared, in either direction. Each pair of values therefore counts as
/// one two-sided test, and [`Estimate::is_above`] is one side of it. `metrics` is the number of metrics by which a sentence may rank. The sentence
/// uses the first metric that shows a difference.
pub(super) fn level_of_ranking(values: usize, metrics: usize) -> f64 {
    level_of_each(values * values.saturating_sub(1) / 2 * metrics) / 2.0
}

/// Formats a value like [`significant`], but without trailing zeros after the decimal point, for axes and sentences. Only numbers with a power of ten
/// keep such zeros.
pub(super) fn number(value: f64) -> String {
    let fixed = significant(value);
    if fixed.contains('.') && !fixed.contains('e') { fixed.trim_end_matches('0').trim_end_matches('.').to_owned() } else { fixed }
}

/// Formats a value with three significant digits and with trailing zeros, for columns of tables. Values from 1000 on keep all digits before the
/// decimal point, but values of a million or more have a power of ten. Values closer to 0 than 0.0001 have two significant digits and a power of ten,
/// so that only the value 0 is written as 0. These limits apply to the value after it is rounded to three digits: 999 600 is written as 1.00e6.
pub(super) fn significant(value: f64) -> String {
    if value.is_infinite() {
        return if value > 0.0 { "\u{221e}" } else { "\u{2212}\u{221e}" }.to_owned();
    }
    if value == 0.0 || value.is_nan() {
        return value.abs().to_string();
    }
    // The number of decimals follows from the exponent after rounding. 9.996 is rounded to 10, so it is written as 10.0 and not as 10.00.
    let exponent: i32 = format!("{:.2e}", value.abs()).rsplit_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    match exponent {
        ..=-5 => format!("{value:.1e}"),
        6.. => format!("{value:.2e}"),
        _ => {
            let digits = usize::try_from(2 - exponent).unwrap_or(0);
            format!("{value:.digits$}")
        }
    }
}

/// Formats a value with the half-width of its confidence interval, if the half-width is known. The half-width has at least two significant digits,
/// and the value has the same number of decimals. If the half-width is extremely small or large, [`number`] formats both.
pub(super) fn with_interval(value: f64, half: Option<f64>) -> String {
    let Some(half) = half.filter(|half| *half > 0.0 && half.is_finite() && value.is_finite()) else { return number(value) };
    let exponent: i32 = format!("{half:.1e}").rsplit_once('e').and_then(|(_, e)| e.parse().ok()).unwrap_or(0);
    if !(-8..6).contains(&exponent) {
        return format!("{} \u{b1} {}", number(value), number(half));
    }
    let digits = usize::try_from(1 - exponent).unwrap_or(0);
    format!("{value:.digits$} \u{b1} {half:.digits$}")
}

/// A point of a plot of cost against error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Place {
    pub(super) cost: Estimate,
    pub(super) error: Estimate,
}

/// The Pareto front of a plot of cost against error.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Front {
    /// Indices of the points on the front, by increasing cost.
    pub(super) points: Vec<usize>,
    /// For each point on the front, the points off the front that are as good within chance: chance explains why such a point has a higher cost or a
    /// larger error. A point that is as good as several points on the front is listed only for the one whose error is closest to its own.
    pub(super) alike: Vec<Vec<usize>>,
}

impl Front {
    /// Whether a point is on the front.
    pub(super) fn contains(&self, point: usize) -> bool {
        self.points.contains(&point)
    }

    /// Whether a point is not on the front, but as good as one that is, within chance.
    pub(super) fn is_alike(&self, point: usize) -> bool {
        self.alike.iter().any(|alike| alike.contains(&point))
    }
}

/// Returns the Pareto front. Differences that chance explains do not count as advantages:
///
/// 1. Points are taken by increasing cost, and points of equal cost by increasing error. A point joins the front if its error is smaller than that of
///    every point that joined before it ([`Estimate::is_above`]).
/// 2. A point leaves the front if a point that joined later stays on it, and chance explains why the later point has the higher cost. The later point
///    has the smaller error, so it is better.
///
/// The first step makes one decision for each point but the cheapest one. If costs have standard errors, the second step makes the same number of
/// decisions. The level of each decision follows from the number of all decisions, so that chance alone puts a wrong point on the front with a
/// probability of about [`LEVEL`] or less. Points whose cost or error is not finite are left out.
pub(super) fn pareto_front(points: &[Place]) -> Front {
    let finite = |i: &usize| points[*i].cost.value.is_finite() && points[*i].error.value.is_finite();
    let mut order: Vec<usize> = (0..points.len()).filter(finite).collect();
    let key = |i: usize| (points[i].cost.value, points[i].error.value);
    order.sort_by(|&a, &b| key(a).0.total_cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)).then(a.cmp(&b)));
    let steps = if order.iter().any(|&i| points[i].cost.error > 0.0) { 2 } else { 1 };
    let each = level_of_each(order.len().saturating_sub(1) * steps);
    let is_dearer = |a: usize, b: usize| points[a].cost.is_above(points[b].cost, each);
    let is_worse = |a: usize, b: usize| points[a].error.is_above(points[b].error, each);
    let mut joined: Vec<usize> = Vec::new();
    for &point in &order {
        if joined.iter().all(|&before| is_worse(before, point)) {
            joined.push(point);
        }
    }
    let mut front: Vec<usize> = Vec::new();
    for &point in joined.iter().rev() {
        if front.iter().all(|&dearer| is_dearer(dearer, point)) {
            front.push(point);
        }
    }
    front.reverse();
    let mut alike = vec![Vec::new(); front.len()];
    for &point in order.iter().filter(|point| !front.contains(point)) {
        let distance = |k: &usize| (points[front[*k]].error.value - points[point].error.value).abs();
        let near = (0..front.len()).filter(|&k| !is_dearer(point, front[k]) && !is_worse(point, front[k]));
        if let Some(k) = near.min_by(|a, b| distance(a).total_cmp(&distance(b))) {
            alike[k].push(point);
        }
    }
    Front { points: front, alike }
}

/// Compares two times as a statement about speed, such as "4.20 ± 0.10 times as fast as". `time` belongs to the subject of the sentence, and `other`
/// to the choice with which it is compared. The interval assumes that the times are independent. It is too wide if both times are ratios to the same
/// third time. If it contains 1, the statement is "as fast within chance". `None` if a time is missing or not above 0.
pub(super) fn speed(time: Estimate, other: Estimate) -> Option<String> {
    if !(time.value > 0.0 && other.value > 0.0 && (other.value / time.value).is_finite()) {
        return None;
    }
    let ratio = other.ratio(time);
    let (faster, half) = (ratio.value, ratio.half());
    if let Some(half) = half.filter(|half| (faster - 1.0).abs() <= *half) {
        return Some(format!("as fast within chance (\u{b1} {:.0} %) as", 100.0 * half / faster));
    }
    let said = |ratio: Estimate| match ratio.half() {
        Some(half) => with_interval(ratio.value, Some(half)),
        None => format!("{:.2}", ratio.value),
    };
    Some(match faster {
        r if (0.98..=1.02).contains(&r) => "as fast as".to_owned(),
        r if r > 1.0 => format!("{} times as fast as", said(ratio)),
        _ => format!("{} times as slow as", said(time.ratio(other))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake::{TABLES, measured};

    #[test]
    fn only_nothing_reads_nought() {
        assert_eq!([0.0, 0.05, 2.0, 9.876, 123.4, 4500.0].map(number), ["0", "0.05", "2", "9.88", "123", "4500"]);
        assert_eq!([3.1e-8, -3.1e-8, 1e-4, 2.5e9].map(number), ["3.1e-8", "-3.1e-8", "0.0001", "2.50e9"]);
        assert_eq!([0.05, 9.996, 48.0, 0.0].map(significant), ["0.0500", "10.0", "48.0", "0"]);
        assert_eq!([f64::INFINITY, f64::NEG_INFINITY].map(number), ["\u{221e}", "\u{2212}\u{221e}"]);
    }

    #[test]
    fn intervals_set_the_digits_of_their_value() {
        let cases = [(0.05, 0.0196), (0.001_234_5, 0.000_098_7), (12.345, 0.5), (1234.4, 45.0), (0.3, 0.0996), (0.0, 0.02)];
        let texts = [
            "0.050 \u{b1} 0.020",
            "0.001234 \u{b1} 0.000099",
            "12.35 \u{b1} 0.50",
            "1234 \u{b1} 45",
            "0.30 \u{b1} 0.10",
            "0.000 \u{b1} 0.020",
        ];
        assert_eq!(cases.map(|(value, half)| with_interval(value, Some(half))), texts);
        assert_eq!([None, Some(f64::NAN), Some(0.0), Some(f64::INFINITY)].map(|half| with_interval(0.05, half)), ["0.05"; 4]);
        assert_eq!(with_interval(3e-9, Some(1e-10)), "3.0e-9 \u{b1} 1.0e-10");
    }

    #[test]
    fn intervals_are_wider_if_few_values_give_the_standard_error() {
        // Published tables of Student's t distribution, two-sided level 5 %.
        for (freedom, factor) in [(1.0, 12.706), (2.0, 4.303), (14.0, 2.145), (f64::INFINITY, 1.960)] {
            assert!((half_width(1.0, freedom) - factor).abs() < 1e-3, "{freedom}: {}", half_width(1.0, freedom));
        }
        // If both terms have the same standard error with n degrees of freedom, the sum has 2 n. A term whose standard error is 0 does not count.
        assert!((freedom_of_sum([(0.3, 7.0), (0.3, 7.0)]) - 14.0).abs() < 1e-9);
        assert!((freedom_of_sum([(0.3, 7.0), (0.0, 2.0)]) - 7.0).abs() < 1e-9);
        assert!(freedom_of_sum([(0.0, 7.0), (0.0, 2.0)]).is_infinite());
    }

    #[test]
    fn a_difference_is_told_if_chance_does_not_explain_it() {
        let estimate = |value: f64, error: f64, freedom: f64| Estimate { value, error, freedom };
        // The standard error of the difference is 0.05. If both standard errors are certain, the one-sided limit at 5 % is 1.645 standard errors:
        // 0.0822.
        let base = estimate(1.0, 0.03, f64::INFINITY);
        let with = |difference: f64, freedom: f64| estimate(1.0 + difference, 0.04, freedom).is_above(base, 0.05);
        // If only the standard error of `base` is certain, the degrees of freedom are 14 x (0.05 / 0.04)^4 = 34.2, and the limit is 1.691 standard
        // errors: 0.0845.
        assert_eq!([with(0.0840, 14.0), with(0.0850, 14.0)], [false, true]);
        assert_eq!([with(0.0820, f64::INFINITY), with(0.0830, f64::INFINITY)], [false, true]);
        assert!(!with(-1.0, 14.0), "it is smaller");
        // Without standard errors, the values are compared as they are.
        assert!(
            Estimate::exact(1.0f64.next_up()).is_above(Estimate::exact(1.0), 1e-9)
                && !Estimate::exact(1.0).is_above(Estimate::exact(1.0), 0.5)
        );
        assert!(!Estimate::exact(f64::NAN).is_above(base, 0.5) && !base.is_above(Estimate::exact(f64::NAN), 0.5));
        // Šidák's correction: 10 statements with this level each have a level of 5 % together.
        assert!((1.0 - (1.0 - level_of_each(10)).powi(10) - LEVEL).abs() < 1e-12);
        // Five values of a ranking have 10 pairs, each with two sides. Three metrics have 30 pairs.
        assert!((2.0 * level_of_ranking(5, 1) - level_of_each(10)).abs() < 1e-15);
        assert!((2.0 * level_of_ranking(5, 3) - level_of_each(30)).abs() < 1e-15);
        assert!((level_of_ranking(1, 1) - LEVEL / 2.0).abs() < 1e-15, "nothing is compared");
    }

    #[test]
    fn ratios_have_the_interval_of_the_delta_method() {
        let estimate = |value: f64, error: f64| Estimate { value, error, freedom: f64::INFINITY };
        // Relative standard errors of 3 % and 4 % give one of 5 %.
        let ratio = estimate(20.0, 0.6).ratio(estimate(5.0, 0.2));
        assert!((ratio.value - 4.0).abs() < 1e-12 && (ratio.half().expect("known") - 1.96 * 0.2).abs() < 1e-3);
        assert_eq!(Estimate::exact(20.0).ratio(Estimate::exact(5.0)), Estimate::exact(4.0));
        assert_eq!(Estimate::exact(4.0).half(), None);
    }

    /// A point without standard errors.
    fn at(cost: f64, error: f64) -> Place {
        Place { cost: Estimate::exact(cost), error: Estimate::exact(error) }
    }

    #[test]
    fn front_keeps_what_nothing_dominates() {
        let points = [at(8.0, 1.0), at(2.0, 5.0), at(4.0, 3.0), at(f64::NAN, 0.0), at(4.0, 3.0), at(1.0, f64::INFINITY)];
        let front = pareto_front(&points);
        // Points 2 and 4 are equal. Point 2 is on the front, and point 4 is as good.
        assert_eq!((front.points.as_slice(), front.alike.as_slice()), (&[1, 2, 0][..], &[vec![], vec![4], vec![]][..]));
        assert!(front.contains(2) && !front.contains(4) && front.is_alike(4) && !front.is_alike(2));
        // Negative controls: a point that is dominated in both coordinates, and points that are equal in one coordinate and dominated in the other.
        for dominated in [at(5.0, 4.0), at(4.0, 3.5), at(4.5, 3.0)] {
            let with = [&points[..], &[dominated]].concat();
            assert_eq!(pareto_front(&with), front, "{dominated:?}");
        }
        assert!(pareto_front(&[&points[..], &[at(3.0, 4.0)]].concat()).contains(6));
        assert_eq!(pareto_front(&[]), Front::default());
    }

    #[test]
    fn a_point_within_chance_of_the_front_is_named_beside_it() {
        let point =
            |cost: f64, error: f64| Place { cost: Estimate::exact(cost), error: Estimate { value: error, error: 0.01, freedom: 14.0 } };
        // Chance explains a difference of up to 2.36 standard errors (0.0334) for 4 decisions with 28 degrees of freedom. The second point is cheaper
        // than the third, and chance explains why its error is larger. The fourth point is dearer than the third, and chance explains why its error
        // is smaller. The last point is worse than all others.
        let points = [point(1.0, 1.0), point(2.0, 0.97), point(3.0, 0.94), point(4.0, 0.935), point(5.0, 2.0)];
        let front = pareto_front(&points);
        assert_eq!((front.points.as_slice(), front.alike.as_slice()), (&[0, 2][..], &[vec![], vec![1]][..]));
        // With a tenth of these standard errors, the errors of the second, third and fourth point are each smaller than that of the previous point by
        // more than chance explains.
        let sharp = points.map(|p| Place { error: Estimate { error: 0.001, ..p.error }, ..p });
        assert_eq!(pareto_front(&sharp).points, [0, 1, 2, 3]);
    }

    /// Counts the tables for whose front `holds` is true.
    fn count(table: impl Fn(u32) -> Vec<Place>, holds: impl Fn(&Front) -> bool) -> u32 {
        (0..TABLES).map(|seed| u32::from(holds(&pareto_front(&table(seed))))).sum()
    }

    /// Null hypothesis: noise alone puts a wrong point on the front in at most 5 % of all tables. There are 5 counts of 1000 tables. Each is tested
    /// at the level 1 - (1 - 0.001)^(1/5), so the family has the level 0.001 (Šidák). A binomial count of 1000 tables with a probability of 5 %
    /// exceeds 76 with a smaller probability than this level.
    const MOST: u32 = 76;

    #[test]
    fn noise_alone_seldom_puts_a_point_on_the_front() {
        let fetches = |point: u32| Estimate::exact(f64::from(point + 1));
        // All choices have the same true error, so only the cheapest belongs on the front.
        let alike = |points: u32, samples: u32| {
            move |seed: u32| -> Vec<Place> {
                (0..points).map(|point| Place { cost: fetches(point), error: measured(1.0, 0.1, samples, [seed, point, 1]) }).collect()
            }
        };
        let several = |front: &Front| front.points.len() > 1;
        for (points, samples) in [(12, 15), (12, 3), (40, 15)] {
            let wrong = count(alike(points, samples), several);
            assert!(wrong <= MOST, "{wrong} of {TABLES} tables of {points} choices");
        }
        // Negative control without standard errors: the front has one point only if the cheapest of the 12 choices has the smallest error by chance.
        // This is so in 1 of 12 tables.
        let blind = |seed: u32| -> Vec<Place> {
            alike(12, 15)(seed).into_iter().map(|p| Place { error: Estimate::exact(p.error.value), ..p }).collect()
        };
        assert!(count(blind, several) > 850, "the simulation has no noise");
        // The error of the first choice is larger than that of the others by so little that only about half of the tables show the difference. The
        // others have the same true error, so at most one of them belongs on the front.
        let two = |seed: u32| -> Vec<Place> {
            let error = |point: u32| measured(if point == 0 { 1.06 } else { 1.0 }, 0.1, 15, [seed, point, 2]);
            (0..12).map(|point| Place { cost: fetches(point), error: error(point) }).collect()
        };
        let wrong = count(two, |front| front.points.len() > 2);
        assert!(wrong <= MOST, "{wrong} of {TABLES} tables have two points of equal error on the front");
        let told = count(two, |front| front.points.len() == 2);
        assert!((TABLES / 4..TABLES * 3 / 4).contains(&told), "{told} of {TABLES} tables tell the first choice from the others");
        // 6 choices with the same true time, each timed three times, and errors without noise: only the choice with the smallest error belongs on the
        // front.
        let timed = |seed: u32| -> Vec<Place> {
            (0..6)
                .map(|point| Place { cost: measured(10.0, 0.3, 3, [seed, point, 3]), error: Estimate::exact(2.0 - 0.1 * f64::from(point)) })
                .collect()
        };
        let wrong = count(timed, |front| front.points != [5]);
        assert!(wrong <= MOST, "{wrong} of {TABLES} tables have a choice on the front that is cheaper by chance");
    }

    #[test]
    fn a_real_difference_is_on_the_front() {
        // The error of choice 7 is smaller by 7 s, where s = 0.1 sqrt(2/15) is the standard error of a difference. For 11 decisions with 28 degrees
        // of freedom, the limit is 2.79 s, so the difference exceeds the limit by more than 4 s. At least 990 of 1000 tables must therefore have the
        // choice on the front. With a difference of 5 s, 98 % would have it.
        let gap = 7.0 * 0.1 * (2.0f64 / 15.0).sqrt();
        let table = |seed: u32| -> Vec<Place> {
            let error = |point: u32| measured(if point == 7 { 1.0 - gap } else { 1.0 }, 0.1, 15, [seed, point, 4]);
            (0..12).map(|point| Place { cost: Estimate::exact(f64::from(point + 1)), error: error(point) }).collect()
        };
        let found = count(table, |front| front.contains(7));
        assert!(found >= 990, "{found} of {TABLES}");
        // Each of six choices costs twice as much as the one before. Chance explains none of these differences, so all six choices are on the front.
        let timed = |seed: u32| -> Vec<Place> {
            let cost = |point: u32| measured(f64::from(10u32 << point), 0.3, 3, [seed, point, 5]);
            (0..6).map(|point| Place { cost: cost(point), error: Estimate::exact(2.0 - 0.1 * f64::from(point)) }).collect()
        };
        let found = count(timed, |front| front.points.len() == 6);
        assert!(found >= 990, "{found} of {TABLES}");
    }

    #[test]
    fn speeds_are_said_both_ways() {
        let exactly = Estimate::exact;
        let said = |a: Estimate, b: Estimate| speed(a, b).expect("two times");
        assert_eq!(said(exactly(5.0), exactly(20.0)), "4.00 times as fast as");
        assert_eq!(said(exactly(20.0), exactly(5.0)), "4.00 times as slow as");
        assert_eq!(said(exactly(5.0), exactly(5.05)), "as fast as");
        assert_eq!([speed(exactly(0.0), exactly(1.0)), speed(exactly(f64::NAN), exactly(1.0))], [None, None]);
        // Relative standard errors of 3 % and 4 % combine to 5 %. The ratio is 4, so the half-width of its interval is 1.96 x 5 % x 4 = 0.392.
        let timed = |value: f64, share: f64, freedom: f64| Estimate { value, error: share * value, freedom };
        let (one, other) = (timed(5.0, 0.03, f64::INFINITY), timed(20.0, 0.04, f64::INFINITY));
        assert_eq!(said(one, other), "4.00 \u{b1} 0.39 times as fast as");
        assert_eq!(said(other, one), "4.00 \u{b1} 0.39 times as slow as");
        // Two degrees of freedom each: the interval of the ratio 4 has a half-width of 2.776 (4 degrees of freedom) x 4 x sqrt(2) %.
        assert_eq!(said(timed(5.0, 0.01, 2.0), timed(20.0, 0.01, 2.0)), "4.00 \u{b1} 0.16 times as fast as");
        // An interval that contains 1, and one that does not, although the difference is small.
        assert_eq!(said(timed(5.0, 0.02, f64::INFINITY), exactly(5.05)), "as fast within chance (\u{b1} 4 %) as");
        assert_eq!(said(timed(5.0, 0.1, 2.0), timed(6.0, 0.1, 2.0)), "as fast within chance (\u{b1} 39 %) as");
        assert_eq!(said(timed(5.0, 0.002, f64::INFINITY), exactly(5.05)), "as fast as");
    }
}

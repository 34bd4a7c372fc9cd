//! Formats numbers, and makes statistical statements about them.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Half-width of a 95 % confidence interval of a normal mean, in standard errors.
pub(super) const CONFIDENCE_95: f64 = 1.96;

/// Formats a value with three significant digits and without trailing zeros, for axes and sentences. Very small values are written with a power of
/// ten, so that only the value 0 is written as 0.
pub(super) fn number(value: f64) -> String {
    let fixed = significant(value);
    if fixed.contains('.') && !fixed.contains('e') { fixed.trim_end_matches('0').trim_end_matches('.').to_owned() } else { fixed }
}

/// Formats a value with three significant digits and with trailing zeros, for columns of tables.
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

/// Formats a value with the half-width of its 95 % confidence interval, if its standard error is known.
pub(super) fn with_interval(value: f64, standard_error: Option<f64>) -> String {
    match standard_error {
        Some(error) if error > 0.0 && error.is_finite() => format!("{} \u{b1} {}", number(value), number(CONFIDENCE_95 * error)),
        _ => number(value),
    }
}

/// Returns the limit for the largest of `count` deviations from expected values, in standard errors. If all expected values are right, the
/// largest deviation exceeds the limit with a probability of at most 0.1 %. The limit uses Šidák's correction, which remains valid if the
/// estimates share data. Each standard error is itself an estimate from `seeds` numbers, so the ratio of deviation and standard error
/// follows Student's t distribution with `seeds` - 1 degrees of freedom. With few seeds, such as 4, this makes the limit large.
pub(super) fn sidak_limit(count: usize, seeds: u32) -> f64 {
    let each = 1.0 - 0.999f64.powf(1.0 / count.max(1) as f64);
    // The distribution requires more than 0 degrees of freedom, so at least 2 seeds are assumed.
    StudentsT::new(0.0, 1.0, f64::from(seeds.max(2) - 1)).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - each / 2.0))
}

/// Returns the indices of the points on the Pareto front, by increasing x. A point is on the front if no other point dominates it. A point dominates
/// another one if it is at most as large in both coordinates and smaller in at least one. Points with NaN or infinite coordinates are omitted.
pub(super) fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let dominates = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let mut front: Vec<usize> =
        (0..points.len()).filter(|&i| finite(&points[i]) && !points.iter().any(|p| finite(p) && dominates(p, &points[i]))).collect();
    front.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(a.cmp(&b)));
    front
}

/// Compares two times as a statement about speed, such as "4.20 times as fast as". `ms` belongs to the subject of the sentence, and `other_ms` to the
/// choice with which it is compared. `None` if a time is missing.
pub(super) fn speed(ms: f64, other_ms: f64) -> Option<String> {
    let ratio = other_ms / ms;
    if !(ms > 0.0 && other_ms > 0.0 && ratio.is_finite()) {
        return None;
    }
    Some(match ratio {
        r if (0.98..=1.02).contains(&r) => "as fast as".to_owned(),
        r if r > 1.0 => format!("{r:.2} times as fast as"),
        r => format!("{:.2} times as slow as", 1.0 / r),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_nothing_reads_nought() {
        assert_eq!([0.0, 0.05, 2.0, 9.876, 123.4, 4500.0].map(number), ["0", "0.05", "2", "9.88", "123", "4500"]);
        assert_eq!([3.1e-8, -3.1e-8, 1e-4, 2.5e9].map(number), ["3.1e-8", "-3.1e-8", "0.0001", "2.50e9"]);
        assert_eq!([0.05, 9.996, 48.0, 0.0].map(significant), ["0.0500", "10.0", "48.0", "0"]);
        assert_eq!([f64::INFINITY, f64::NEG_INFINITY].map(number), ["\u{221e}", "\u{2212}\u{221e}"]);
        assert_eq!(with_interval(0.05, Some(0.01)), "0.05 \u{b1} 0.0196");
        assert_eq!(with_interval(0.05, Some(f64::NAN)), "0.05");
    }

    #[test]
    fn limits_grow_with_the_family() {
        // Published tables of Student's t distribution give these limits for a two-sided level of 0.1 %: 12.924 with 3 degrees of freedom, and 4.073
        // with 15.
        assert!((sidak_limit(1, 4) - 12.924).abs() < 1e-3 && (sidak_limit(1, 16) - 4.073).abs() < 1e-3);
        // With many seeds, the limit approaches that of the normal distribution. It is 3.29 for one estimate. For 33 estimates, each has a level of
        // about 0.001 / 33, and the limit is 4.17.
        assert!((sidak_limit(1, 1_000_000) - 3.2905).abs() < 1e-3 && (sidak_limit(33, 1_000_000) - 4.17).abs() < 0.01);
        assert!(sidak_limit(600, 16) > sidak_limit(33, 16));
    }

    #[test]
    fn front_keeps_what_nothing_dominates() {
        let points = [(8.0, 1.0), (2.0, 5.0), (4.0, 3.0), (f64::NAN, 0.0), (4.0, 3.0)];
        assert_eq!(pareto_front(&points), [1, 2, 4, 0]);
        // Negative controls: a point that is dominated in both coordinates, and points that are equal in one coordinate and dominated in the other.
        for dominated in [(5.0, 4.0), (4.0, 3.5), (4.5, 3.0)] {
            let with = [&points[..], &[dominated]].concat();
            assert_eq!(pareto_front(&with), [1, 2, 4, 0], "{dominated:?}");
        }
        assert!(pareto_front(&[&points[..], &[(3.0, 4.0)]].concat()).contains(&5));
    }

    #[test]
    fn speeds_are_said_both_ways() {
        assert_eq!(speed(5.0, 20.0).as_deref(), Some("4.00 times as fast as"));
        assert_eq!(speed(20.0, 5.0).as_deref(), Some("4.00 times as slow as"));
        assert_eq!(speed(5.0, 5.05).as_deref(), Some("as fast as"));
        assert_eq!([speed(0.0, 1.0), speed(f64::NAN, 1.0)], [None, None]);
    }
}

//! Formatting of numbers, and statistical statements about them.

use statrs::distribution::{ContinuousCDF, StudentsT};

/// Half-width of a 95 % confidence interval of a normal mean, in standard errors.
pub(super) const CONFIDENCE_95: f64 = 1.96;

/// Formats a value with three significant digits, without trailing zeros, for axes and sentences. Very small numbers are written with a power of ten,
/// so that only 0 is shown as 0.
pub(super) fn number(value: f64) -> String {
    let fixed = significant(value);
    if fixed.contains('.') && !fixed.contains('e') { fixed.trim_end_matches('0').trim_end_matches('.').to_owned() } else { fixed }
}

/// Formats a value with three significant digits, with trailing zeros, for columns.
pub(super) fn significant(value: f64) -> String {
    if value.is_infinite() {
        return if value > 0.0 { "\u{221e}" } else { "\u{2212}\u{221e}" }.to_owned();
    }
    if value == 0.0 || value.is_nan() {
        return value.abs().to_string();
    }
    // The exponent is that of the rounded value, so that 9.996 becomes 10.0 and not 10.00.
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

/// A value with its 95 % interval, if its standard error is known.
pub(super) fn with_interval(value: f64, standard_error: Option<f64>) -> String {
    match standard_error {
        Some(error) if error > 0.0 && error.is_finite() => format!("{} \u{b1} {}", number(value), number(CONFIDENCE_95 * error)),
        _ => number(value),
    }
}

/// Largest number of standard errors that the largest of `count` estimates may deviate from its expectation, for a family level of 0.1 %. It uses
/// Sidak's correction, whose inequality also holds for estimates that share data. The standard errors are themselves estimates from one number per
/// seed, so the ratio follows Student's t distribution with `seeds` - 1 degrees of freedom. The limit for 4 seeds is wide, because they give little
/// information.
pub(super) fn sidak_limit(count: usize, seeds: u32) -> f64 {
    let each = 1.0 - 0.999f64.powf(1.0 / count.max(1) as f64);
    // The distribution only requires that the degrees of freedom are positive.
    StudentsT::new(0.0, 1.0, f64::from(seeds.max(2) - 1)).map_or(f64::INFINITY, |t| t.inverse_cdf(1.0 - each / 2.0))
}

/// Indices of the points that no other point dominates (at most as large in both coordinates and smaller in one), by increasing x. Points that are
/// not finite are never included.
pub(super) fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let dominates = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let mut front: Vec<usize> =
        (0..points.len()).filter(|&i| finite(&points[i]) && !points.iter().any(|p| finite(p) && dominates(p, &points[i]))).collect();
    front.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(a.cmp(&b)));
    front
}

/// Compares the speed of a choice that takes `ms` with that of a choice that takes `other_ms`, in words such as "4.20 times as fast as"; `None` if a
/// time is missing.
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
        // Tables of Student's t, two-sided 0.1 %: 12.924 with 3 degrees of freedom, 4.073 with 15.
        assert!((sidak_limit(1, 4) - 12.924).abs() < 1e-3 && (sidak_limit(1, 16) - 4.073).abs() < 1e-3);
        // For many seeds, the limit approaches that of the normal distribution: 3.29 for one estimate, and 4.17 for 33 estimates together, each with
        // a level of about 0.001 / 33.
        assert!((sidak_limit(1, 1_000_000) - 3.2905).abs() < 1e-3 && (sidak_limit(33, 1_000_000) - 4.17).abs() < 0.01);
        assert!(sidak_limit(600, 16) > sidak_limit(33, 16));
    }

    #[test]
    fn front_keeps_what_nothing_dominates() {
        let points = [(8.0, 1.0), (2.0, 5.0), (4.0, 3.0), (f64::NAN, 0.0), (4.0, 3.0)];
        assert_eq!(pareto_front(&points), [1, 2, 4, 0]);
        // Negative controls: points dominated in both coordinates, and in one with the other equal.
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

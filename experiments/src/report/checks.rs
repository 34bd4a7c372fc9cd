//! The checks of a run: whether the counted fetches are those that the flavours promise, and whether bias and variance agree with the theory.

use kernels::variant::Flavour;
use serde::Serialize;

use super::numbers::sidak_limit;

/// The promised and the counted number of fetches of a flavour. The promise is the number of fetches that the estimator states for the
/// flavour.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct GoldenRow {
    /// The name of the flavour. If the run has several views, the name of the view follows.
    pub(crate) flavour: String,
    /// The promise: a number, a sum or a range.
    pub(crate) promised: String,
    /// Mean number of fetches per terrain pixel, counted in the shader; NaN if the row of the run says so.
    pub(crate) counted: f64,
    /// Whether the count agrees with the promise.
    pub(crate) agrees: bool,
}

/// Largest accepted difference between the mean count and the promised number of fetches.
const COUNT_TOLERANCE: f64 = 0.01;

impl GoldenRow {
    /// Compares the counted fetches of a flavour with its promise. `modulated` = whether the scene has colour modulation. With colour
    /// modulation, all flavours except the virtual texture take one additional fetch. For the far atlas, 2 to 3 fetches are accepted in
    /// both cases.
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
pub(super) fn promises(rows: &[GoldenRow]) -> Option<(bool, String)> {
    let kept = rows.iter().filter(|g| g.agrees).count();
    let all = rows.len();
    let unknown: Vec<&str> = rows.iter().filter(|g| !g.counted.is_finite()).map(|g| g.flavour.as_str()).collect();
    (all > 0).then(|| (kept == all, format!("{kept} of {all} flavours take the fetches they promise{}", without_number(&unknown))))
}

/// Limit of the number of names in a text.
const NAMED: usize = 4;

/// Returns the end of a text: the names of the rows that hold NaN or infinity; empty if there are none.
fn without_number(names: &[&str]) -> String {
    if names.is_empty() {
        return String::new();
    }
    let more = if names.len() > NAMED { format!(" and {} more", names.len() - NAMED) } else { String::new() };
    let first: Vec<&str> = names.iter().take(NAMED).copied().collect();
    format!("; without a finite number: {}{more}", first.join(", "))
}

/// Checks whether the largest of several biases can be explained by chance. Each row contains a bias, its standard error, if known, and its name.
/// `seeds` is the number of seeds from which each standard error was computed. It determines the limit, see [`sidak_limit`]. Rows without spread over
/// the seeds, whose standard error is 0, are left out. A row with NaN or infinity is named, and fails.
pub(super) fn bias<'a>(rows: impl IntoIterator<Item = (f64, Option<f64>, &'a str)>, seeds: u32) -> Option<(bool, String)> {
    let (unknown, known): (Vec<_>, Vec<_>) =
        rows.into_iter().partition(|(bias, error, _)| !bias.is_finite() || error.is_some_and(|e| !e.is_finite()));
    let unknown: Vec<&str> = unknown.into_iter().map(|(.., name)| name).collect();
    let scores = known.into_iter().filter_map(|(bias, error, name)| Some((bias.abs() / error?, name)));
    let scores: Vec<(f64, &str)> = scores.filter(|(z, _)| z.is_finite()).collect();
    let more = without_number(&unknown);
    let Some((z, name)) = scores.iter().max_by(|a, b| a.0.total_cmp(&b.0)) else {
        return (!unknown.is_empty()).then(|| (false, format!("no stochastic row has a bias{more}")));
    };
    let (count, limit) = (scores.len(), sidak_limit(scores.len(), seeds));
    Some((
        *z < limit && unknown.is_empty(),
        format!(
            "largest bias of {count} stochastic rows: {z:.1} standard errors ({name}); at most {limit:.1} expected by chance (level 0.1 % for all rows together, {seeds} seeds){more}"
        ),
    ))
}

/// Checks whether each measured variance is 0.8 to 1.25 times the predicted variance. Each row contains the measured variance, the predicted
/// variance, the standard error of the measured variance, if known, and its name. A ratio outside this range is accepted if the deviation from the
/// prediction can be chance, given the standard error and the number of seeds. A row with NaN or infinity is named, and fails.
pub(super) fn variance<'a>(rows: impl IntoIterator<Item = (f64, f64, Option<f64>, &'a str)>, seeds: u32) -> Option<(bool, String)> {
    let (unknown, known): (Vec<_>, Vec<_>) =
        rows.into_iter().partition(|(measured, predicted, ..)| !measured.is_finite() || !predicted.is_finite());
    let unknown: Vec<&str> = unknown.into_iter().map(|(.., name)| name).collect();
    let more = without_number(&unknown);
    let rows: Vec<(f64, f64)> = known
        .into_iter()
        .map(|(measured, predicted, error, _)| (measured / predicted, error.map_or(f64::INFINITY, |e| (measured - predicted).abs() / e)))
        .filter(|(ratio, _)| ratio.is_finite())
        .collect();
    let ratios = || rows.iter().map(|r| r.0);
    let (Some(low), Some(high)) = (ratios().min_by(f64::total_cmp), ratios().max_by(f64::total_cmp)) else {
        return (!unknown.is_empty()).then(|| (false, format!("no stochastic row has a variance{more}")));
    };
    let range = if high - low < 0.005 { format!("{high:.2}") } else { format!("{low:.2} to {high:.2}") };
    let limit = sidak_limit(rows.len(), seeds);
    let inside = |ratio: f64| ratio > 0.8 && ratio < 1.25;
    let outside: Vec<f64> = rows.iter().filter(|(ratio, _)| !inside(*ratio)).map(|(_, z)| *z).collect();
    let furthest = outside.iter().copied().max_by(f64::total_cmp);
    let but = match furthest {
        Some(z) if z.is_finite() => {
            format!(
                "; ratios outside this range deviate from the prediction by at most {z:.1} standard errors; up to {limit:.1} are expected by chance with {seeds} seeds"
            )
        }
        _ => String::new(),
    };
    Some((
        furthest.is_none_or(|z| z < limit) && unknown.is_empty(),
        format!("measured variance is {range} times the predicted variance; 0.8 to 1.25 expected{but}{more}"),
    ))
}

#[cfg(test)]
mod tests {
    use kernels::shading::Estimator;

    use super::*;

    /// With this many seeds, the uncertainty of the standard errors themselves is negligible.
    const MANY: u32 = 1_000_000;

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
        assert_eq!(promises(&rows).map(|c| c.0), Some(false));
        assert_eq!(promises(&rows[..1]).map(|c| c.0), Some(true));
        let rows =
            [12.0, f64::NAN].map(|counted| GoldenRow::of(format!("near-cliff of {counted}"), Flavour::NearCliff, 12, counted, false));
        let (kept, text) = promises(&rows).expect("two rows");
        assert!(
            !kept && text.ends_with("1 of 2 flavours take the fetches they promise; without a finite number: near-cliff of NaN"),
            "{text}"
        );
        assert_eq!(without_number(&["a", "b", "c", "d", "e", "f"]), "; without a finite number: a, b, c, d and 2 more");
    }

    #[test]
    fn bias_and_variance_are_held_to_their_limits() {
        let known = |bias: f64, error: f64, name: &'static str| (bias, Some(error), name);
        assert_eq!(bias([known(3e-4, 1e-4, "a"), known(0.0, 0.0, "b")], MANY).map(|c| c.0), Some(true));
        let (good, text) = bias([known(-4e-4, 1e-4, "a"), known(0.0, 0.0, "b")], MANY).expect("one row with a standard error above 0");
        assert!(!good && text.contains("4.0 standard errors (a)"), "{text}");
        // The same bias is accepted as chance if it is the largest of 600.
        let many = (0..600).map(|i| known(if i == 7 { 4e-4 } else { 0.0 }, 1e-4, "a"));
        assert_eq!(bias(many, MANY).map(|c| c.0), Some(true));
        // A bias of ten standard errors is accepted if the standard error comes from 4 seeds, and refused if it comes from 16 seeds.
        assert_eq!([4, 16].map(|seeds| bias([known(1e-3, 1e-4, "a")], seeds).map(|c| c.0)), [Some(true), Some(false)]);
        assert_eq!(bias([known(0.0, 0.0, "b"), (0.1, None, "c")], MANY), None);
        // NaN is not left out: the row is named, and the check fails, also if it is the only row.
        for rows in [vec![known(0.0, 1e-4, "a"), known(f64::NAN, 1e-4, "b")], vec![known(0.0, f64::NAN, "b")], vec![(f64::NAN, None, "b")]]
        {
            let (good, text) = bias(rows, MANY).expect("a row");
            assert!(!good && text.ends_with("; without a finite number: b"), "{text}");
        }
        let known = |ratios: &[f64], error: Option<f64>| variance(ratios.iter().map(|r| (*r, 1.0, error, "a")), MANY);
        assert_eq!(known(&[0.97, 1.03], None).map(|c| c.0), Some(true));
        for rows in [vec![(0.97, 1.0, None, "a"), (f64::NAN, 1.0, None, "b")], vec![(1.0, f64::NAN, None, "b")]] {
            let (good, text) = variance(rows, MANY).expect("a row");
            assert!(!good && text.ends_with("; without a finite number: b"), "{text}");
        }
        assert_eq!([known(&[0.5, 1.0], None), known(&[1.0, 1.5], None)].map(|c| c.map(|c| c.0)), [Some(false); 2]);
        // The measured variance is half of the predicted variance. It is accepted with a large standard error, which is typical of few seeds, and
        // refused with a small standard error.
        assert_eq!([0.2, 0.1].map(|e| known(&[0.5, 1.0], Some(e)).map(|c| c.0)), [Some(true), Some(false)]);
        assert_eq!(known(&[], None), None);
    }
}

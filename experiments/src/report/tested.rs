//! Selects the choices whose bias and variance are tested, and describes the biases of estimators that are biased by design. A *choice* is one
//! combination of view, variant, estimator, noise, temporal resolve and value of the varied parameter.
//!
//! A composition of flavours is a weighted sum of their pictures, with weights that do not depend on the seed. The results for compositions therefore
//! follow from tests of their flavours. Testing the compositions, too, would add tests to the family and thereby only make each test less sensitive.

use kernels::frame::VariantChoice;
use kernels::shading::Estimator;
use kernels::variant::{Flavour, Variant};

use super::checks::Measured;
use super::numbers::number;
use super::summary::{BIAS, BIAS_P, EXACT_MSE, Metric, Summary, THEORY, Table};
use crate::definition::variant_choice;
use crate::significance::limit;

/// The choices that are tested, and the number of the other choices that draw random numbers. The results of these other choices follow from the
/// tests.
struct Tested<'a> {
    members: Vec<&'a Summary>,
    follow: usize,
}

impl<'a> Tested<'a> {
    /// Selects the choices that draw random numbers, have a number of this metric, and have an estimator whose mean is the exact blend. Some of them
    /// are not tested but counted in `follow`, because their results follow from tests of single flavours. A choice follows if each of its random
    /// flavours is selected as a choice of its own, with the same values in all columns but the variant. A single flavour with its specialised
    /// pipeline never follows.
    fn of(table: &'a Table, metric: Metric) -> Tested<'a> {
        let random: Vec<(&Summary, Vec<Flavour>)> = table
            .summaries
            .iter()
            .filter(|summary| summary.number(metric).is_some())
            .map(|summary| (summary, drawing(summary)))
            .filter(|(summary, flavours)| !flavours.is_empty() && is_random(summary, metric))
            .collect();
        let is_member = |of: &Summary, flavour: Flavour| {
            let alone = |other: &Summary| {
                let mut key = other.key.clone();
                key.variant.clone_from(&of.key.variant);
                other.key.variant == flavour.name() && key == of.key
            };
            random.iter().any(|(other, _)| alone(other))
        };
        let follows = |(summary, flavours): &&(&Summary, Vec<Flavour>)| {
            let itself = flavours.iter().any(|flavour| summary.key.variant == flavour.name());
            !itself && flavours.iter().all(|flavour| is_member(summary, *flavour))
        };
        let members: Vec<&Summary> = random.iter().filter(|choice| !follows(choice)).map(|(summary, _)| *summary).collect();
        Tested { follow: random.len() - members.len(), members }
    }
}

/// Returns the estimator of a choice; an empty name counts as fc5. `None` if the name is unknown.
fn estimator(summary: &Summary) -> Option<Estimator> {
    if summary.key.estimator.is_empty() { Some(Estimator::Fc5) } else { summary.key.estimator.parse().ok() }
}

/// Returns the flavours that may draw random numbers in a choice; empty if the estimator is biased by design.
fn drawing(summary: &Summary) -> Vec<Flavour> {
    match (estimator(summary), variant_choice(&summary.key.variant)) {
        (Some(estimator), Ok(choice)) if estimator.bias().is_none() => {
            Flavour::ALL.into_iter().filter(|&flavour| choice.may_use(flavour) && estimator.is_stochastic(Variant::only(flavour))).collect()
        }
        _ => Vec::new(),
    }
}

/// Whether a choice that may draw random numbers is known to do so. A choice with forced flavours does, because forced flavours cover all pixels. An
/// automatic choice may have no pixel with a random flavour, so its measured numbers decide. A choice whose value of `metric` is NaN counts as
/// random, so that a check reports it.
fn is_random(summary: &Summary, metric: Metric) -> bool {
    let forced = matches!(variant_choice(&summary.key.variant), Ok(VariantChoice::Forced(_) | VariantChoice::GenericForced(_)));
    forced || summary.is_stochastic() || summary.value(metric).is_nan()
}

/// Returns the biases that should be 0, and the number of choices whose biases follow from them.
pub(super) fn biases(table: &Table) -> (Vec<Measured>, usize) {
    let Tested { members, follow } = Tested::of(table, BIAS);
    let measured = |summary: &&Summary| Measured {
        name: table.place(&summary.key),
        value: summary.value(BIAS),
        expected: 0.0,
        standard_error: summary.error(BIAS),
        freedom: summary.freedom(BIAS),
        probability: summary.number(BIAS_P).map(|number| number.value),
    };
    (members.iter().map(measured).collect(), follow)
}

/// Returns the mean squared differences from the exact blend, each of which should equal the predicted variance. Also returns the number of choices
/// whose results follow from them.
pub(super) fn variances(table: &Table) -> (Vec<Measured>, usize) {
    let Tested { members, follow } = Tested::of(table, EXACT_MSE);
    let measured = |summary: &&Summary| Measured {
        name: table.place(&summary.key),
        value: summary.value(EXACT_MSE),
        expected: summary.value(THEORY),
        standard_error: summary.error(EXACT_MSE),
        freedom: summary.freedom(EXACT_MSE),
        probability: None,
    };
    (members.iter().map(measured).collect(), follow)
}

/// Describes the largest bias of each estimator that is biased by design, with its 95 % interval, if it is known, and the reason. `None` if there is
/// no such estimator.
pub(super) fn by_design(table: &Table) -> Option<String> {
    let mut largest: Vec<(Estimator, &'static str, &Summary)> = Vec::new();
    for summary in table.summaries.iter().filter(|summary| summary.value(BIAS).is_finite()) {
        let Some((estimator, reason)) = estimator(summary).and_then(|estimator| Some((estimator, estimator.bias()?))) else { continue };
        match largest.iter_mut().find(|(other, ..)| *other == estimator) {
            Some((.., known)) if summary.value(BIAS).abs() > known.value(BIAS).abs() => *known = summary,
            Some(_) => {}
            None => largest.push((estimator, reason, summary)),
        }
    }
    let item = |(estimator, reason, summary): &(Estimator, &str, &Summary)| {
        let interval = summary.error(BIAS).zip(summary.freedom(BIAS)).map(|(error, freedom)| limit(0.05, freedom) * error);
        let interval = interval.filter(|half| half.is_finite()).map_or_else(String::new, |half| format!(" \u{b1} {}", number(half)));
        format!("{estimator} by at most {}{interval} ({}; {reason})", number(summary.value(BIAS)), table.place(&summary.key))
    };
    let items: Vec<String> = largest.iter().map(item).collect();
    (!items.is_empty()).then(|| format!("biased by design against the exact blend (95 % intervals): {}", items.join(", ")))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::report::fake::{self, Rows, base, definition};
    use crate::row::Row;

    /// Returns the table of a run with a bias and a variance for each of the given rows. The variances are above 0, so the choices count as random.
    fn table(rows: &[Row]) -> Table {
        let mut all = Rows::new();
        for row in rows {
            all.put(row, "bias", "linear albedo", 1e-5, Some(2e-5));
            all.put(row, "variance", "linear albedo^2", 1e-3, None);
        }
        Table::of(&fake::run(definition("frames = 1\nseeds = 4\nvariants = [\"auto\"]"), all, Path::new(".")))
    }

    fn row(variant: &str, noise: &str) -> Row {
        Row { variant: variant.to_owned(), noise: noise.to_owned(), ..base("cliff") }
    }

    fn selected(rows: &[Row]) -> (Vec<String>, usize) {
        let (measured, follow) = biases(&table(rows));
        (measured.into_iter().map(|measured| measured.name).collect(), follow)
    }

    #[test]
    fn compositions_follow_only_from_their_own_flavours() {
        let all =
            ["near-cliff", "far-cliff", "vt+near-cliff", "near-cliff+far-cliff", "auto", "generic", "generic-near-cliff", "vt", "splat"];
        let rows: Vec<Row> = all.iter().map(|variant| row(variant, "hashed")).collect();
        // `vt` and `splat` draw no random numbers, so they are neither tested nor counted.
        assert_eq!(selected(&rows), (["near-cliff", "far-cliff"].map(str::to_owned).to_vec(), 5));
        // If `far-cliff` is not tested alone, only two choices follow: those whose only random flavour is `near-cliff`.
        let without: Vec<Row> = rows.iter().filter(|row| row.variant != "far-cliff").cloned().collect();
        let (names, follow) = selected(&without);
        assert_eq!((names.len(), follow), (4, 2), "{names:?}");
        assert!(["near-cliff", "near-cliff+far-cliff", "auto", "generic"].iter().all(|name| names.iter().any(|n| n == name)), "{names:?}");
        // A flavour with another noise, view, setting or estimator is another measurement, so it says nothing about a composition
        // with that flavour.
        for other in [
            row("near-cliff", "white"),
            Row { view: "ground".to_owned(), ..row("near-cliff", "hashed") },
            Row { setting: "2".to_owned(), ..row("near-cliff", "hashed") },
            Row { estimator: "hex".to_owned(), ..row("near-cliff", "hashed") },
        ] {
            let (names, follow) = selected(&[other.clone(), row("vt+near-cliff", "hashed")]);
            assert!(follow == 0 && names.iter().any(|name| name.contains("vt+near-cliff")), "{other:?}: {names:?}, {follow}");
        }
        // Automatic choice is left out if nothing shows that it has random pixels.
        let mut still = table(&[row("auto", "hashed")]);
        assert_eq!(biases(&still).0.len(), 1);
        let run = |value: f64| {
            let mut all = Rows::new();
            all.put(&row("auto", "hashed"), "bias", "linear albedo", value, Some(0.0));
            Table::of(&fake::run(definition("frames = 1\nseeds = 4\nvariants = [\"auto\"]"), all, Path::new(".")))
        };
        still = run(0.0);
        assert_eq!(biases(&still).0.len(), 0);
        // A value of NaN is not left out.
        still = run(f64::NAN);
        assert_eq!(biases(&still).0.len(), 1);
    }

    #[test]
    fn biases_by_design_are_told_and_not_tested() {
        let of = |estimator: &str, variant: &str| Row { estimator: estimator.to_owned(), ..row(variant, "hashed") };
        let mut all = Rows::new();
        all.put(&of("hex", "near-cliff"), "bias", "linear albedo", -0.0123, Some(1e-4));
        all.put(&of("hex", "far-cliff"), "bias", "linear albedo", 0.004, Some(1e-4));
        all.put(&of("luna8", "splat"), "bias", "linear albedo", 0.02, None);
        all.put(&of("fc5", "near-cliff"), "bias", "linear albedo", 0.5, Some(1e-4));
        all.put(&of("unknown", "near-cliff"), "bias", "linear albedo", 0.7, Some(1e-4));
        all.rows.iter_mut().filter(|row| row.standard_error.is_some()).for_each(|row| row.freedom = Some(60.0));
        let table = Table::of(&fake::run(definition("frames = 1\nseeds = 4\nvariants = [\"auto\"]"), all, Path::new(".")));
        let text = by_design(&table).expect("two estimators");
        // With 60 degrees of freedom, the 95 % interval is 2.0003 standard errors.
        assert!(text.contains("hex by at most -0.0123 \u{b1} 0.0002 (near-cliff"), "{text}");
        assert!(text.contains("luna8 by at most 0.02 (splat") && text.contains("projects from above"), "{text}");
        assert!(!text.contains("fc5") && !text.contains("unknown"), "{text}");
        let tested: Vec<f64> = biases(&table).0.iter().map(|measured| measured.value).collect();
        assert_eq!(tested, [0.5]);
        assert_eq!(by_design(&self::table(&[row("near-cliff", "hashed")])), None);
    }
}

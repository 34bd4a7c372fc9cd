//! Answers the question of a run. The first line is one sentence that answers it, with the numbers that decide it and their intervals. Lines with
//! details follow for at most three views, one for each. All lines are built from the numbers of the run; their form depends on which column varies.

use std::cmp::Ordering;

use super::numbers::{Estimate, Front, level_of_each, level_of_ranking, number, speed, with_interval};
use super::summary::{ADDED, CLUMPING, FETCHES, FLIPS, LOST, Metric, PERCEIVED, REJECTIONS, Summary, TILE_FETCHES, Table};

/// Limits of the number of items in a list. The smaller one applies, for example, to the fronts in the details of runs with several views.
const LISTED: usize = 5;
const LISTED_OF_VIEWS: usize = 3;
/// Relative differences that are smaller than this count as no difference.
const SMALL: f64 = 0.02;
/// Limit of the number of views that the answer describes.
const VIEWS: usize = 3;
/// Limit of the number of disadvantages that the sentence about a parameter names.
const DRAWBACKS: usize = 2;

/// The form of the answer. Each form is named after the column whose values the answer compares. `One`: nothing is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shape {
    Parameter,
    Temporal,
    Estimators,
    Variants,
    Noises,
    One,
}

impl Shape {
    /// Selects the form of the answer. If several columns vary, a varied parameter has priority, because its effect is the question of the run.
    /// Temporal resolves, estimators, variants and noises follow in this order, but noises may come before variants (see below).
    fn of(table: &Table) -> Shape {
        let costs = table.noises.len() <= 1 || table.summaries.iter().any(|s| s.value(table.cost).is_finite());
        match table {
            t if t.settings.len() > 1 => Shape::Parameter,
            t if t.temporal.len() > 1 => Shape::Temporal,
            t if t.estimators.len() > 1 => Shape::Estimators,
            // Variants are compared by their cost. If noises vary as well, and there are more noises than variants or no cost was measured,
            // the noises are compared instead.
            t if t.variants.len() > 1 && t.variants.len() >= t.noises.len() && costs => Shape::Variants,
            t if t.noises.len() > 1 => Shape::Noises,
            _ => Shape::One,
        }
    }
}

/// The answer for one view. The first line of the verdict has the sentence for one view, the *leading* view, and short forms for others.
struct Told {
    /// The answer in a few words, such as the name of a noise. Views with the same words have the same answer.
    answer: String,
    /// Whether the data of the view decide the question.
    sure: bool,
    /// The answer as a sentence, without the name of the view.
    sentence: String,
    /// The deciding numbers. The first line gives them for another view that has the same answer as the leading view.
    numbers: String,
    /// The answer as a short clause. The first line gives it for another view that has a different answer.
    otherwise: String,
}

/// Returns the answer. Its first line is one sentence, and the other lines have the details of at most [`VIEWS`] views.
pub(super) fn verdict(table: &Table) -> String {
    let shape = Shape::of(table);
    let told: Vec<(&String, Told)> =
        table.views.iter().filter_map(|view| Some((view, told_of_view(table, shape, &table.of_view(view))?))).collect();
    if told.is_empty() {
        return "No row of this run holds a cost, an error or a change in motion, so there is nothing to compare.".to_owned();
    }
    let mut lines = vec![sentence(table, &first_line(table, &told))];
    let several = table.views.len() > 1;
    let details = table.views.iter().filter_map(|view| {
        let text = details_of_view(table, shape, &table.of_view(view))?;
        Some(if several { format!("in view {view}, {text}") } else { text })
    });
    lines.extend(details.take(VIEWS).map(|text| sentence(table, &text)));
    lines.join("\n")
}

/// Ends a sentence with a full stop and begins it with a capital letter. If it begins with the name of a variant, resolve or estimator, the first
/// letter stays in lower case, because users type these names in lower case.
fn sentence(table: &Table, text: &str) -> String {
    let first_word = text.split([' ', ',', '\n']).next().unwrap_or_default();
    let mut names = table.variants.iter().chain(&table.temporal).chain(&table.estimators);
    let is_name = names.any(|name| name == first_word);
    let mut letters = text.chars();
    match letters.next() {
        Some(first) if !is_name => format!("{}{}.", first.to_uppercase(), letters.as_str()),
        _ => format!("{text}."),
    }
}

/// Returns the sentence that answers the question. It gives the answer for the first view whose data decide the question; if there is none, for the
/// first view. For up to two other views, it says whether their answer is the same. The rest are only counted.
fn first_line(table: &Table, told: &[(&String, Told)]) -> String {
    let lead = told.iter().position(|(_, told)| told.sure).unwrap_or(0);
    let (view, first) = &told[lead];
    if table.views.len() == 1 {
        return first.sentence.clone();
    }
    let mut text = format!("in view {view}, {}", first.sentence);
    let others: Vec<&(&String, Told)> = told.iter().enumerate().filter(|(i, _)| *i != lead).map(|(_, of_view)| of_view).collect();
    let named = &others[..others.len().min(VIEWS - 1)];
    let (same, unlike): (Vec<&(&String, Told)>, Vec<_>) =
        named.iter().partition(|(_, of)| of.sure == first.sure && of.answer == first.answer);
    if !same.is_empty() {
        let views: Vec<String> = same.iter().map(|(view, of)| format!("view {view} ({})", of.numbers)).collect();
        text += &format!("; the same holds in {}", list(&views, views.len().max(2)));
    }
    for (view, of) in unlike {
        text += &format!("; in view {view}, {}", of.otherwise);
    }
    match others.len() - named.len() {
        0 => {}
        1 => text += "; one more view is in the table",
        more => text += &format!("; {more} more views are in the table"),
    }
    text
}

fn told_of_view(table: &Table, shape: Shape, rows: &[usize]) -> Option<Told> {
    match shape {
        Shape::Parameter => parameter_told(table, rows),
        Shape::Temporal => temporal_told(table, rows),
        Shape::Estimators => estimators_told(table, rows),
        Shape::Variants => variants_told(table, rows),
        Shape::Noises => noises_told(table, rows),
        Shape::One => one_told(table, rows),
    }
}

fn details_of_view(table: &Table, shape: Shape, rows: &[usize]) -> Option<String> {
    let text = match shape {
        Shape::Parameter => parameter(table, rows),
        Shape::Temporal => temporal(table, rows),
        Shape::Estimators => estimators(table, rows),
        Shape::Variants => variants(table, rows),
        Shape::Noises => noises(table, rows),
        // The first line already contains all numbers.
        Shape::One => None,
    };
    let (unstable, timed) = table.unstable(rows);
    let left_out = (unstable > 0)
        .then(|| format!("{unstable} of {timed} shading times are unstable (95 % interval wider than \u{b1} 5 %), so they are left out"));
    let parts: Vec<String> = text.into_iter().chain(left_out).collect();
    (!parts.is_empty()).then(|| parts.join("; "))
}

// ---- Numbers in words. ----

fn is_fetches(metric: Metric) -> bool {
    metric == FETCHES || metric == TILE_FETCHES
}

/// Formats the value of a metric with its confidence interval, if that is known.
fn value(summary: &Summary, metric: Metric) -> String {
    if is_fetches(metric) { format!("{:.1}", summary.value(metric)) } else { with_interval(summary.value(metric), summary.half(metric)) }
}

/// Formats the value of a metric with its interval and the name of the metric.
fn say(summary: &Summary, metric: Metric) -> String {
    if is_fetches(metric) {
        format!("{} {}", value(summary, metric), metric.words)
    } else {
        format!("{} {}", metric.words, value(summary, metric))
    }
}

/// Formats the value of a metric for the place after the predicate of [`claim`].
fn amount(summary: &Summary, metric: Metric) -> String {
    if metric == ADDED { format!("{} a frame", value(summary, metric)) } else { say(summary, metric) }
}

/// Returns the predicate of a sentence for the choice with the smallest value of `metric`, such as `flips the fewest choices`. `many`: whether the
/// subject of the sentence is plural.
fn claim(table: &Table, metric: Metric, many: bool) -> String {
    let verb = |one: &str, several: &str| if many { several.to_owned() } else { one.to_owned() };
    match metric {
        ADDED => verb("adds", "add") + " the least change in motion",
        PERCEIVED => format!("{} least noisy to the eye{}", verb("looks", "look"), at_rate(table)),
        FLIPS => verb("flips", "flip") + " the fewest choices",
        CLUMPING => verb("clumps", "clump") + " least",
        FETCHES | TILE_FETCHES => verb("is", "are") + " cheapest",
        _ => verb("is", "are") + " closest to the reference",
    }
}

/// Returns the frame rate for which perceived noise is computed, as text.
fn at_rate(table: &Table) -> String {
    let frames = if table.frames_per_second == 1.0 { "frame" } else { "frames" };
    format!(" at {} {frames} a second", number(table.frames_per_second))
}

/// Returns the variant of a choice as an adverbial, such as "with automatic choice" or "on near-cliff".
fn on(summary: &Summary) -> String {
    match summary.key.variant.as_str() {
        "auto" => " with automatic choice".to_owned(),
        "generic" => " with the generic kernel".to_owned(),
        variant => format!(" on {variant}"),
    }
}

/// Returns cost, error, added and lost change of choices as text. Values that are not known are omitted. Cost and error are those of the first
/// choice. Changes that differ between the choices by [`SMALL`] or more are given as a range.
fn price(table: &Table, choices: &[&Summary]) -> String {
    let Some(first) = choices.first() else { return String::new() };
    let mut parts: Vec<String> = Vec::new();
    for metric in [table.cost, table.error].into_iter().filter(|m| !first.value(*m).is_nan()) {
        parts.push(if is_fetches(metric) { format!("{} fetches", value(first, metric)) } else { say(first, metric) });
    }
    for metric in [ADDED, LOST] {
        let by_value = |a: &&&Summary, b: &&&Summary| a.value(metric).total_cmp(&b.value(metric));
        let known = || choices.iter().filter(move |s| !s.value(metric).is_nan());
        let (Some(low), Some(high)) = (known().min_by(by_value), known().max_by(by_value)) else { continue };
        let more =
            if relative(low.value(metric), high.value(metric)) >= SMALL { format!(" to {}", value(high, metric)) } else { String::new() };
        parts.push(say(low, metric) + &more);
    }
    parts.join(", ")
}

/// Returns the flip rate and the clumping of a choice as text. Fewer flips often come with more clumping, so the two numbers are given together.
fn flips_and_clumping(summary: &Summary) -> String {
    let said = |metric: Metric| {
        if summary.value(metric).is_nan() { format!("{} not measured", metric.words) } else { say(summary, metric) }
    };
    format!("{}, {}", said(FLIPS), said(CLUMPING))
}

/// Returns the limit of the number of items in a list, which depends on the number of views.
fn listed(table: &Table) -> usize {
    if table.views.len() > 1 { LISTED_OF_VIEWS } else { LISTED }
}

/// Joins the items to a list. If there are more than `most` items, only `most` items are written, which always include the first and the last one.
/// `most` must be at least 2.
fn list(items: &[String], most: usize) -> String {
    let count = items.len();
    if count <= most {
        return match items {
            [] => String::new(),
            [one] => one.clone(),
            [first @ .., last] => format!("{} and {last}", first.join(", ")),
        };
    }
    let kept: Vec<&str> = (0..most).map(|k| items[k * (count - 1) / (most - 1)].as_str()).collect();
    format!("{} ({} more between them)", kept.join(", "), count - most)
}

// ---- Comparing. ----

/// The result of comparing two values of a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Difference {
    /// The values differ by at least [`SMALL`], and chance does not explain the difference.
    Apart,
    /// The values differ by less than [`SMALL`], and so do all values in their confidence intervals.
    Close,
    /// The data do not show whether the values differ.
    Unclear,
}

/// Returns the difference between two values, divided by the larger of their absolute values; 0 if both values are 0.
fn relative(a: f64, b: f64) -> f64 {
    if a == b { 0.0 } else { (a - b).abs() / a.abs().max(b.abs()) }
}

/// Returns the sum of the half-widths of the confidence intervals of two choices. A half-width that is not known counts as 0.
fn halves(a: &Summary, b: &Summary, metric: Metric) -> f64 {
    [a, b].iter().filter_map(|summary| summary.half(metric)).sum()
}

/// Whether the values of a metric of two choices differ by less than [`SMALL`] for all true values in their confidence intervals. If a standard error
/// should exist but is not known ([`Summary::is_doubtful`]), only equal values are close.
fn is_close(a: &Summary, b: &Summary, metric: Metric) -> bool {
    let [one, other] = [a, b].map(|summary| summary.value(metric));
    let is_known = one == other || ![a, b].iter().any(|summary| summary.is_doubtful(metric));
    is_known && relative(one, other) < SMALL && (one - other).abs() + halves(a, b, metric) <= SMALL * one.abs().max(other.abs())
}

/// Compares the values of a metric of two choices. They differ if they are at least [`SMALL`] apart, their confidence intervals do not overlap, and
/// chance alone would cause such a difference with a probability of less than `level`. Errors of single pictures have no intervals and are compared
/// as they are. If one of two changes over frames lacks its standard error ([`Summary::is_doubtful`]), the result is unclear, unless the changes are
/// equal.
fn compare(a: &Summary, b: &Summary, metric: Metric, level: f64) -> Difference {
    let (low, high) = if a.value(metric) <= b.value(metric) { (a, b) } else { (b, a) };
    let (from, to) = (low.value(metric), high.value(metric));
    if !(from.is_finite() && to.is_finite()) {
        return Difference::Unclear;
    }
    if relative(from, to) < SMALL {
        return if is_close(low, high, metric) { Difference::Close } else { Difference::Unclear };
    }
    if to - from > halves(low, high, metric) && high.estimate(metric).is_above(low.estimate(metric), level) {
        Difference::Apart
    } else {
        Difference::Unclear
    }
}

/// Returns a relative clause that says why two values do not count as different.
fn because(difference: Difference) -> String {
    match difference {
        Difference::Close => format!("which differ by less than {:.0} %", 100.0 * SMALL),
        _ => "which the run cannot tell apart".to_owned(),
    }
}

/// Names the rows that do not count as different from the best row, with their values; empty if there are none.
fn alike_words(table: &Table, ranked: &Ranking, name: impl Fn(usize) -> String) -> String {
    let of = |i: usize| &table.summaries[i];
    let (close, unclear): (Vec<usize>, Vec<usize>) = ranked.alike.iter().partition(|&&i| is_close(of(ranked.best), of(i), ranked.metric));
    let words = |rows: &[usize], before: &str| {
        let items: Vec<String> = rows.iter().map(|&i| format!("{} ({})", name(i), value(of(i), ranked.metric))).collect();
        if items.is_empty() { String::new() } else { format!(", {before} {}", list(&items, LISTED)) }
    };
    words(&unclear, "which the run cannot tell from") + &words(&close, &format!("within {:.0} % of", 100.0 * SMALL))
}

/// Selects the row that an answer is about, the *subject*. Returns all rows for which `same` holds in comparison with the subject, including the
/// subject. The subject is the first row of the variant `auto`. If there is none, it is the first stochastic choice. If there is no stochastic
/// choice either, it is the first row.
fn subject(table: &Table, rows: &[usize], same: fn(&Summary, &Summary) -> bool) -> Vec<usize> {
    let of = |i: usize| &table.summaries[i];
    let chosen = rows.iter().copied().find(|&i| of(i).key.variant == "auto");
    let by_chance = || rows.iter().copied().find(|&i| of(i).is_stochastic());
    let Some(first) = chosen.or_else(by_chance).or(rows.first().copied()) else { return Vec::new() };
    rows.iter().copied().filter(|&i| same(of(first), of(i))).collect()
}

/// Whether answers may use a metric. They do not use perceived noise of a sequence that is too short for it.
fn is_usable(table: &Table, metric: Metric) -> bool {
    metric != PERCEIVED || table.is_memory_filled
}

/// Returns the rows that have a finite value of a metric; empty if answers may not use the metric ([`is_usable`]).
fn known(table: &Table, rows: &[usize], metric: Metric) -> Vec<usize> {
    if !is_usable(table, metric) {
        return Vec::new();
    }
    rows.iter().copied().filter(|&i| table.summaries[i].value(metric).is_finite()).collect()
}

/// Returns the rows with the smallest and the largest value of a metric; `None` if no row has a finite value.
fn extremes(table: &Table, rows: &[usize], metric: Metric) -> Option<(usize, usize)> {
    let mut known = known(table, rows, metric);
    // If several rows have equal values, the row that comes first in the definition is returned, because the sort is stable.
    known.sort_by(|&a, &b| table.summaries[a].value(metric).total_cmp(&table.summaries[b].value(metric)));
    let low = *known.first()?;
    let top = table.summaries[*known.last()?].value(metric);
    let high = known.iter().copied().find(|&i| table.summaries[i].value(metric) >= top)?;
    Some((low, high))
}

/// The result of ranking rows by a metric.
struct Ranking {
    metric: Metric,
    /// The level of each comparison with the best row ([`level_of_ranking`]).
    level: f64,
    /// The row with the smallest value.
    best: usize,
    /// The row with the largest value.
    worst: usize,
    /// How the largest value differs from the smallest one.
    difference: Difference,
    /// The other rows that do not count as different from the best row, in the order of the definition.
    alike: Vec<usize>,
}

/// Ranks the rows by a metric; `None` if fewer than two rows have a finite value. `tried`: the number of metrics from which the caller selects the
/// first that shows a difference.
fn ranking(table: &Table, rows: &[usize], metric: Metric, tried: usize) -> Option<Ranking> {
    let known = known(table, rows, metric);
    let (best, worst) = extremes(table, &known, metric).filter(|_| known.len() > 1)?;
    let level = level_of_ranking(known.len(), tried);
    let difference = |i: usize| compare(&table.summaries[best], &table.summaries[i], metric, level);
    let alike = known.iter().copied().filter(|&i| i != best && difference(i) != Difference::Apart).collect();
    Some(Ranking { metric, level, best, worst, difference: difference(worst), alike })
}

// ---- Noises. ----

/// Returns the subject ([`subject`]) and the rows that differ from it only in their noise.
fn rows_of_noises(table: &Table, rows: &[usize]) -> Vec<usize> {
    subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.estimator, &a.key.temporal, &a.key.setting)
            == (&b.key.variant, &b.key.estimator, &b.key.temporal, &b.key.setting)
    })
}

fn noises_told(table: &Table, rows: &[usize]) -> Option<Told> {
    let own = rows_of_noises(table, rows);
    let metrics = [ADDED, PERCEIVED, FLIPS, table.error];
    let Some(ranked) = metrics.into_iter().find_map(|metric| ranking(table, &own, metric, 1)) else { return one_told(table, &own) };
    let of = |i: usize| &table.summaries[i];
    let name = |i: usize| of(i).key.noise.as_str();
    let Ranking { metric, best, worst, difference, .. } = ranked;
    let on = on(of(best));
    let numbers = format!("{} against {}", value(of(best), metric), value(of(worst), metric));
    if difference != Difference::Apart {
        let range = if best == worst {
            format!("{} with all noises", say(of(best), metric))
        } else {
            format!("{} with {} noise and {} with {} noise", say(of(best), metric), name(best), value(of(worst), metric), name(worst))
        };
        let sentence = if difference == Difference::Close {
            let why = if best == worst { String::new() } else { format!(", {}", because(difference)) };
            format!("the noises hardly differ in {}{on}: {range}{why}", metric.words)
        } else {
            format!("the run cannot tell which noise {}{on}: {range}", claim(table, metric, false))
        };
        let otherwise = match difference {
            Difference::Close => format!("the noises hardly differ ({range})"),
            _ => format!("the run cannot tell which noise {} ({range})", claim(table, metric, false)),
        };
        return Some(Told { answer: "none".to_owned(), sure: false, sentence, numbers: range, otherwise });
    }
    let names: Vec<String> = std::iter::once(&best).chain(&ranked.alike).map(|&i| name(i).to_owned()).collect();
    let many = names.len() > 1;
    let names = list(&names, LISTED);
    let claim = claim(table, metric, many);
    let mut sentence = format!("{names} noise {claim}: {}{on}", amount(of(best), metric));
    if many {
        let with = if on.starts_with(" with") { "and" } else { "with" };
        sentence += &format!(" {with} {} noise{}", name(best), alike_words(table, &ranked, |i| name(i).to_owned()));
    }
    sentence += &format!(", against {} with {} noise", value(of(worst), metric), name(worst));
    if metric == ADDED {
        let subject = if many { format!("{} noise", name(best)) } else { "it".to_owned() };
        sentence += &eye(table, &own, best, &subject).unwrap_or_default();
    }
    let otherwise = format!("{names} noise {claim} ({numbers})");
    Some(Told { answer: format!("{names} by {}", metric.words), sure: true, sentence, numbers, otherwise })
}

/// Says how the noise that adds the least change looks to the eye; `None` if perceived noise was not measured, or if the sequence is too short for
/// it. `best`: the row of this noise. `subject`: the words that stand for this noise in the sentence.
fn eye(table: &Table, rows: &[usize], best: usize, subject: &str) -> Option<String> {
    let Ranking { best: quiet, worst: noisy, level, .. } = ranking(table, rows, PERCEIVED, 1)?;
    let of = |i: usize| &table.summaries[i];
    let name = |i: usize| of(i).key.noise.as_str();
    if !of(best).value(PERCEIVED).is_finite() {
        return None;
    }
    let against = |i: usize| format!("{} {} against {}", PERCEIVED.words, value(of(best), PERCEIVED), value(of(i), PERCEIVED));
    let rate = at_rate(table);
    Some(if compare(of(quiet), of(best), PERCEIVED, level) == Difference::Apart {
        format!("; {subject} looks noisier to the eye{rate} than {} noise ({})", name(quiet), against(quiet))
    } else if compare(of(best), of(noisy), PERCEIVED, level) == Difference::Apart {
        format!("; no other noise looks less noisy to the eye{rate} ({} with {} noise)", against(noisy), name(noisy))
    } else {
        let range = format!("{} to {}", value(of(quiet), PERCEIVED), value(of(noisy), PERCEIVED));
        format!("; the run cannot tell how the noises differ to the eye{rate} ({} {range})", PERCEIVED.words)
    })
}

fn noises(table: &Table, rows: &[usize]) -> Option<String> {
    let rows = rows_of_noises(table, rows);
    let name = |i: usize| &table.summaries[i].key.noise;
    let variant = &table.summaries[*rows.first()?].key.variant;
    let start = format!("with {variant} and {} noises, ", rows.len());
    let mut text = String::new();
    // A superlative is used only if the metric tells its best noise from all others.
    let best = |metric: Metric| {
        let ranked = ranking(table, &rows, metric, 1).filter(|ranked| ranked.alike.is_empty());
        ranked.map(|ranked| (ranked.best, ranked.worst))
    };
    let unclear = [FLIPS, CLUMPING].into_iter().filter(|&metric| best(metric).is_none());
    let unclear: Vec<Metric> = unclear.filter(|&metric| extremes(table, &rows, metric).is_some()).collect();
    match (best(FLIPS), best(CLUMPING)) {
        (Some((steady, restless)), Some((even, _))) if steady != even => {
            let of = |i: usize| format!("{} ({})", name(i), flips_and_clumping(&table.summaries[i]));
            text += &format!("the fewest choices flip under {}, the noise that clumps least is {}", of(steady), of(even));
            if restless != even {
                text += &format!(", against {}", of(restless));
            }
        }
        (Some((steady, _)), Some(_)) => {
            text += &format!("{} both flips and clumps least ({})", name(steady), flips_and_clumping(&table.summaries[steady]));
        }
        (Some((steady, _)), None) => {
            text += &format!("the fewest choices flip under {} ({})", name(steady), flips_and_clumping(&table.summaries[steady]));
        }
        (None, Some((even, _))) => {
            text += &format!("the noise that clumps least is {} ({})", name(even), flips_and_clumping(&table.summaries[even]));
        }
        (None, None) => {}
    }
    let ranges = unclear.into_iter().chain([ADDED, LOST, PERCEIVED, table.error]).filter_map(|metric| {
        let (low, high) = extremes(table, &rows, metric)?;
        let of = |i: usize| value(&table.summaries[i], metric);
        Some(if low == high || is_close(&table.summaries[low], &table.summaries[high], metric) {
            format!("{} is {} with all noises", metric.words, of(low))
        } else {
            format!("{} ranges from {} ({}) to {} ({})", metric.words, of(low), name(low), of(high), name(high))
        })
    });
    let parts: Vec<String> = (!text.is_empty()).then_some(text).into_iter().chain(ranges).collect();
    (!parts.is_empty()).then(|| format!("{start}{}", parts.join("; ")))
}

// ---- A parameter. ----

/// Returns the subject ([`subject`]) and the rows that differ from it only in the value of the parameter.
fn rows_of_parameter(table: &Table, rows: &[usize]) -> Vec<usize> {
    subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.estimator, &a.key.temporal, &a.key.noise)
            == (&b.key.variant, &b.key.estimator, &b.key.temporal, &b.key.noise)
    })
}

/// Returns the number of compared values and the name of the parameter as text. If variants or noises vary, too, the text also names the variant and
/// the noise of the rows.
fn values_of(table: &Table, rows: &[usize]) -> String {
    let first = rows.first().map(|&i| &table.summaries[i].key);
    let several = table.variants.len() > 1 || table.noises.len() > 1;
    let with = first.filter(|_| several).map_or_else(String::new, |key| format!(" (with {}, {})", key.variant, key.noise));
    format!("{} values of {}{with}", rows.len(), table.parameter)
}

fn parameter_told(table: &Table, rows: &[usize]) -> Option<Told> {
    let rows = rows_of_parameter(table, rows);
    let of = |i: usize| &table.summaries[i];
    let name = |i: usize| of(i).key.setting.as_str();
    // The first metric that shows a difference decides. Visible errors come first, then the cost. Flips and clumping come last, because they are only
    // causes of visible errors.
    let metrics = [ADDED, PERCEIVED, table.error, table.cost, FLIPS, CLUMPING];
    let tried = metrics.iter().filter(|&&metric| known(table, &rows, metric).len() > 1).count();
    let ranked: Vec<Ranking> = metrics.into_iter().filter_map(|metric| ranking(table, &rows, metric, tried)).collect();
    let Some(lead) = ranked.iter().find(|ranked| ranked.difference == Difference::Apart) else {
        let range = |r: &Ranking| format!("{} {} to {}", r.metric.words, value(of(r.best), r.metric), value(of(r.worst), r.metric));
        let ranges: Vec<String> = ranked.iter().take(LISTED_OF_VIEWS).map(range).collect();
        if ranges.is_empty() {
            return None;
        }
        let ranges = list(&ranges, LISTED);
        let limit = format!("differences below {:.0} % do not count", 100.0 * SMALL);
        return Some(Told {
            answer: "none".to_owned(),
            sure: false,
            sentence: format!(
                "the run finds no difference between {} that chance does not explain ({limit}): {ranges}",
                values_of(table, &rows)
            ),
            otherwise: format!("the run finds no difference ({ranges})"),
            numbers: ranges,
        });
    };
    let Ranking { metric, best, worst, .. } = *lead;
    let numbers = format!("{} against {} at {}", value(of(best), metric), value(of(worst), metric), name(worst));
    let claim = claim(table, metric, false);
    let mut sentence = format!("of {}, {} {claim}: {}", values_of(table, &rows), name(best), amount(of(best), metric));
    sentence += &alike_words(table, lead, |i| name(i).to_owned());
    sentence += &format!(", against {} at {}", value(of(worst), metric), name(worst));
    let drawbacks = ranked.iter().filter(|r| [PERCEIVED, table.error, table.cost, CLUMPING].contains(&r.metric) && r.metric != metric);
    let drawbacks: Vec<String> = drawbacks
        .filter(|r| compare(of(r.best), of(best), r.metric, r.level) == Difference::Apart)
        .take(DRAWBACKS)
        .map(|r| {
            let [here, least] = [best, r.best].map(|i| value(of(i), r.metric));
            match is_fetches(r.metric) {
                true => format!("it takes {here} {} there and fewest at {} ({least})", r.metric.words, name(r.best)),
                false => format!("{} is {here} there and smallest at {} ({least})", r.metric.words, name(r.best)),
            }
        })
        .collect();
    if !drawbacks.is_empty() {
        sentence += &format!("; in return, {}", drawbacks.join(", and "));
    }
    let otherwise = format!("{} {claim} ({numbers})", name(best));
    Some(Told { answer: format!("{} by {}", name(best), metric.words), sure: true, sentence, otherwise, numbers })
}

/// Describes how each metric depends on the parameter.
fn parameter(table: &Table, rows: &[usize]) -> Option<String> {
    let rows = rows_of_parameter(table, rows);
    let name = |i: usize| &table.summaries[i].key.setting;
    let of = |m: Metric, i: usize| value(&table.summaries[i], m);
    let metrics = [ADDED, LOST, PERCEIVED, table.error, table.cost, FLIPS, CLUMPING];
    let known: Vec<(Metric, (usize, usize))> = metrics.into_iter().filter_map(|m| Some((m, extremes(table, &rows, m)?))).collect();
    let is_still = |(m, (low, high)): &(Metric, (usize, usize))| is_close(&table.summaries[*low], &table.summaries[*high], *m);
    let (still, moved): (Vec<_>, Vec<_>) = known.into_iter().partition(is_still);
    let mut parts: Vec<String> = moved
        .iter()
        .map(|&(m, (low, high))| format!("{} ranges from {} at {} to {} at {}", m.words, of(m, low), name(low), of(m, high), name(high)))
        .collect();
    if !still.is_empty() {
        let words: Vec<&str> = still.iter().map(|(m, _)| m.words).collect();
        parts.push(format!("the parameter changes {} by less than {:.0} %", words.join(", "), 100.0 * SMALL));
    }
    if moved.iter().any(|(m, _)| *m == FLIPS) && extremes(table, &rows, CLUMPING).is_none() {
        parts.push("clumping was not measured".to_owned());
    }
    (!parts.is_empty()).then(|| format!("over {}, {}", values_of(table, &rows), parts.join("; ")))
}

// ---- Temporal resolves. ----

/// A row with the base resolve ([`base_of`]), and the row that differs from it only in the resolve.
type Pair = (usize, usize);

/// Returns the pairs of rows that differ only in the resolve: the first row has `base`, and the second has `resolve`. If there are stochastic
/// choices, deterministic choices are omitted: a resolve has no noise to remove from them.
fn pairs_of(table: &Table, rows: &[usize], base: &str, resolve: &str) -> Vec<Pair> {
    let key = |i: usize| {
        let k = &table.summaries[i].key;
        (k.variant.as_str(), k.estimator.as_str(), k.noise.as_str(), k.setting.as_str())
    };
    let temporal = |i: usize| table.summaries[i].key.temporal.as_str();
    let before = |after: usize| rows.iter().copied().find(|&i| temporal(i) == base && key(i) == key(after));
    let pairs: Vec<Pair> =
        rows.iter().copied().filter(|&i| temporal(i) == resolve).filter_map(|after| Some((before(after)?, after))).collect();
    let by_chance: Vec<Pair> = pairs.iter().copied().filter(|(before, _)| table.summaries[*before].is_stochastic()).collect();
    if by_chance.is_empty() { pairs } else { by_chance }
}

/// Returns the resolve with which the others are compared: `off`, or the first one if `off` is not measured.
fn base_of(table: &Table) -> Option<&String> {
    table.temporal.iter().find(|t| *t == "off").or(table.temporal.first())
}

/// Smallest value that can be the base of a factor, as a share of the largest value in the view.
const NEGLIGIBLE: f64 = 0.01;

/// Whether the value of a metric in this row can be the base of a [`Factor`]. The value must be larger than the half-width of its confidence interval
/// (0 if unknown), and at least the share [`NEGLIGIBLE`] of the largest value in its view.
fn is_base(table: &Table, row: usize, metric: Metric) -> bool {
    let summary = &table.summaries[row];
    let of_view = table.summaries.iter().filter(|other| other.key.view == summary.key.view).map(|other| other.value(metric));
    let largest = of_view.filter(|value| value.is_finite()).fold(0.0, f64::max);
    summary.value(metric) > summary.half(metric).unwrap_or(0.0) && summary.value(metric) >= NEGLIGIBLE * largest
}

/// The factor by which a resolve multiplies a metric of a choice.
struct Factor {
    pair: Pair,
    estimate: Estimate,
}

impl Factor {
    fn of(table: &Table, pair: Pair, metric: Metric) -> Option<Factor> {
        let [before, after] = [pair.0, pair.1].map(|i| table.summaries[i].estimate(metric));
        let estimate = after.ratio(before);
        let is_known = is_usable(table, metric) && estimate.value.is_finite() && estimate.value > 0.0;
        (is_known && is_base(table, pair.0, metric)).then_some(Factor { pair, estimate })
    }

    fn ratio(&self) -> f64 {
        self.estimate.value
    }

    fn words(&self) -> String {
        with_interval(self.ratio(), self.estimate.half())
    }

    /// Whether the factor is larger than another one, by the same rules as those of [`compare`].
    fn is_above(&self, other: &Factor, level: f64) -> bool {
        let halves: f64 = [self, other].iter().filter_map(|factor| factor.estimate.half()).sum();
        relative(self.ratio(), other.ratio()) >= SMALL
            && self.ratio() - other.ratio() > halves
            && self.estimate.is_above(other.estimate, level)
    }
}

fn temporal_told(table: &Table, rows: &[usize]) -> Option<Told> {
    let base = base_of(table)?;
    let own = subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.estimator, &a.key.setting) == (&b.key.variant, &b.key.estimator, &b.key.setting)
    });
    let resolves: Vec<&String> = table.temporal.iter().filter(|t| *t != base).collect();
    let factors = |resolve: &str, metric: Metric| -> Vec<Factor> {
        pairs_of(table, &own, base, resolve).into_iter().filter_map(|pair| Factor::of(table, pair, metric)).collect()
    };
    let metric = [ADDED, PERCEIVED, table.error].into_iter().find(|&m| resolves.iter().any(|r| !factors(r, m).is_empty()))?;
    let all: Vec<(&String, Vec<Factor>)> =
        resolves.iter().map(|&resolve| (resolve, factors(resolve, metric))).filter(|(_, factors)| !factors.is_empty()).collect();
    // Resolves are compared by the geometric mean of their factors.
    let mean = |factors: &[Factor]| factors.iter().map(|f| f.ratio().ln()).sum::<f64>() / factors.len() as f64;
    let (resolve, factors) = all.iter().min_by(|a, b| mean(&a.1).total_cmp(&mean(&b.1)))?;
    let by_ratio = |a: &&Factor, b: &&Factor| -> Ordering { a.ratio().total_cmp(&b.ratio()) };
    let (least, most) = (factors.iter().min_by(by_ratio)?, factors.iter().max_by(by_ratio)?);
    let of = |i: usize| &table.summaries[i];
    let noise = |factor: &Factor| of(factor.pair.0).key.noise.as_str();
    let several = factors.len() > 1;
    let with = |factor: &Factor| if several { format!(" with {} noise", noise(factor)) } else { String::new() };
    let unit = if metric == ADDED { " a frame" } else { "" };
    let (before, after) = least.pair;
    let change = format!("{}{} ({} to {}{unit})", least.words(), with(least), value(of(before), metric), value(of(after), metric));
    let (what, on) = (metric.words, on(of(before)));
    let among = if all.len() > 1 { format!("of {} resolves, ", all.len()) } else { String::new() };
    let numbers = if several { format!("factors {} to {}", least.words(), most.words()) } else { format!("factor {}", least.words()) };
    // The tested factor is selected from all factors because it is small, so each of them counts as one test.
    let level = level_of_each(all.iter().map(|(_, factors)| factors.len()).sum());
    let is_told = compare(of(before), of(after), metric, level) == Difference::Apart;
    if !(least.ratio() < 1.0 && is_told) {
        let sure = least.ratio() > 1.0 && is_told;
        let start = if sure {
            format!("no resolve removes {what}{on}")
        } else {
            format!("the run cannot tell whether a resolve removes {what}{on}")
        };
        return Some(Told {
            answer: "none".to_owned(),
            sure,
            sentence: format!("{start}: {resolve} multiplies it by {change}"),
            otherwise: format!("{start} ({resolve}, {numbers})"),
            numbers,
        });
    }
    let mut sentence = format!("{among}{resolve} removes the most {what}{on}: it multiplies it by {change}");
    if several {
        sentence += &if most.is_above(least, level_of_ranking(factors.len(), 1)) {
            format!(" and by {} with {} noise, whose change it reduces least", most.words(), noise(most))
        } else {
            format!("; the run cannot tell for which noise the factor is largest (up to {} with {} noise)", most.words(), noise(most))
        };
    }
    let mut more: Vec<String> = Vec::new();
    if [of(before), of(after)].iter().all(|s| s.value(LOST).is_finite()) && metric == ADDED {
        more.push(format!("{} goes from {} to {}", LOST.words, value(of(before), LOST), value(of(after), LOST)));
    }
    if let Some(factor) = Factor::of(table, least.pair, PERCEIVED).filter(|_| metric == ADDED) {
        more.push(format!("{}{} is multiplied by {}", PERCEIVED.words, at_rate(table), factor.words()));
    }
    if !more.is_empty() {
        sentence += &format!(";{} {}", if several { format!(" with {} noise,", noise(least)) } else { String::new() }, more.join(", and "));
    }
    Some(Told {
        answer: (*resolve).clone(),
        sure: true,
        sentence,
        otherwise: format!("{resolve} removes the most {what} ({numbers})"),
        numbers,
    })
}

/// Describes how each resolve changes each metric.
fn temporal(table: &Table, rows: &[usize]) -> Option<String> {
    let base = base_of(table)?;
    let mut parts = Vec::new();
    for resolve in table.temporal.iter().filter(|t| *t != base) {
        let pairs = pairs_of(table, rows, base, resolve);
        let (mut moved, mut still) = (Vec::new(), Vec::new());
        for metric in [ADDED, LOST, PERCEIVED, table.error, table.cost, FLIPS] {
            match change(table, &pairs, metric) {
                Some(Change::Moved(text)) => moved.push(text),
                Some(Change::Still) => still.push(metric.words),
                None => {}
            }
        }
        let takes = (!moved.is_empty()).then(|| format!("changes {}", moved.join(", ")));
        let leaves = (!still.is_empty()).then(|| format!("changes {} by less than {:.0} %", still.join(", "), 100.0 * SMALL));
        let changes: Vec<String> = takes.into_iter().chain(leaves).collect();
        if changes.is_empty() {
            continue;
        }
        let rejected = extremes(table, &pairs.iter().flat_map(|p| [p.0, p.1]).collect::<Vec<_>>(), REJECTIONS).map(|(low, high)| {
            let share = |i: usize| format!("{:.1} %", 100.0 * table.summaries[i].value(REJECTIONS));
            let range = if low == high { share(low) } else { format!("{} to {}", share(low), share(high)) };
            format!(" (its colour box would reject {range} of the history samples)")
        });
        parts.push(format!("{resolve} {}{}", changes.join(" and "), rejected.unwrap_or_default()));
    }
    (!parts.is_empty()).then(|| format!("compared with {base}, {}", parts.join("; ")))
}

/// The result of comparing a metric before and after a temporal resolve.
enum Change {
    /// The metric changes; the text gives the values or their ratios.
    Moved(String),
    /// In all pairs, the metric changes by less than [`SMALL`] ([`is_close`]).
    Still,
}

/// Describes how a metric changes from the first to the second row of each pair. Pairs without a factor ([`Factor::of`]) are left out. The text then
/// says how many pairs it describes. For a single pair the text gives both values. For several pairs it gives the range of factors, or one factor if
/// they hardly differ. `None` if no pair has a factor.
fn change(table: &Table, pairs: &[Pair], metric: Metric) -> Option<Change> {
    let mut known: Vec<Factor> = pairs.iter().filter_map(|&pair| Factor::of(table, pair, metric)).collect();
    known.sort_by(|a, b| a.ratio().total_cmp(&b.ratio()));
    let (least, most) = (known.first()?, known.last()?);
    if known.iter().all(|f| is_close(&table.summaries[f.pair.0], &table.summaries[f.pair.1], metric)) {
        return Some(Change::Still);
    }
    let of = |i: usize| value(&table.summaries[i], metric);
    let but = if known.len() < pairs.len() { format!(" for {} of {} choices", known.len(), pairs.len()) } else { String::new() };
    if pairs.len() == 1 {
        let (before, after) = least.pair;
        return Some(Change::Moved(format!("{} from {} to {} (factor {})", metric.words, of(before), of(after), least.words())));
    }
    let said = |f: &Factor| {
        let key = &table.summaries[f.pair.1].key;
        let words = [(&table.variants, &key.variant), (&table.noises, &key.noise), (&table.estimators, &key.estimator)];
        let words: Vec<&str> = words.iter().filter(|(all, _)| all.len() > 1).map(|(_, v)| v.as_str()).collect();
        format!("{} ({}: {} to {})", f.words(), words.join(", "), of(f.pair.0), of(f.pair.1))
    };
    if most.ratio() - least.ratio() < SMALL * most.ratio() {
        return Some(Change::Moved(format!("{} by a factor of {}{but}", metric.words, least.words())));
    }
    Some(Change::Moved(format!("{} by a factor of {} to {}{but}", metric.words, said(least), said(most))))
}

// ---- Estimators. ----

/// Returns the subject ([`subject`]) and the rows that differ from it only in their estimator.
fn rows_of_estimators(table: &Table, rows: &[usize]) -> Vec<usize> {
    subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.noise, &a.key.temporal, &a.key.setting) == (&b.key.variant, &b.key.noise, &b.key.temporal, &b.key.setting)
    })
}

fn estimators_told(table: &Table, rows: &[usize]) -> Option<Told> {
    let own = rows_of_estimators(table, rows);
    let (cost, error) = (table.cost, table.error);
    let base = &table.summaries[*own.first()?];
    if base.value(error).is_nan() || base.value(cost).is_nan() {
        return without_cost(table, &own);
    }
    let others: Vec<&Summary> = own[1..].iter().map(|&i| &table.summaries[i]).filter(|s| s.value(error).is_finite()).collect();
    let level = level_of_each(others.len());
    let cheaper: Vec<&Summary> = others.iter().copied().filter(|s| s.value(cost) < base.value(cost)).collect();
    let by_error = |a: &&&Summary, b: &&&Summary| a.value(error).total_cmp(&b.value(error));
    let is_closer = |s: &Summary| s.value(error) < base.value(error) && compare(s, base, error, level) == Difference::Apart;
    let both: Vec<&Summary> = cheaper.iter().copied().filter(|s| is_closer(s)).collect();
    let alike: Vec<&Summary> = cheaper.iter().copied().filter(|s| compare(s, base, error, level) != Difference::Apart).collect();
    let name = |s: &Summary| s.key.estimator.clone();
    let fewer = |s: &Summary| format!("{} against {} {}", value(s, cost), value(base, cost), cost.words);
    let errors = |s: &Summary| format!("{} {} against {}", error.words, value(s, error), value(base, error));
    let adds = |s: &Summary| match compare(s, base, ADDED, level) {
        Difference::Apart => format!("; it adds {} of change a frame against {}", value(s, ADDED), value(base, ADDED)),
        _ if s.value(ADDED).is_nan() || base.value(ADDED).is_nan() => String::new(),
        difference => format!("; {} {} and {}, {}", ADDED.words, value(s, ADDED), value(base, ADDED), because(difference)),
    };
    let on = on(base);
    if let Some(best) = both.iter().min_by(by_error) {
        let rest: Vec<String> = both.iter().map(|s| name(s)).filter(|other| *other != best.key.estimator).collect();
        let too = if rest.is_empty() {
            String::new()
        } else {
            format!("; so {} {}", if rest.len() > 1 { "are" } else { "is" }, list(&rest, LISTED))
        };
        let numbers = format!("{}, {}", fewer(best), errors(best));
        return Some(Told {
            answer: name(best),
            sure: true,
            sentence: format!(
                "{} is both cheaper than {} and closer to the reference{on} ({numbers}){}{too}",
                name(best),
                name(base),
                adds(best)
            ),
            otherwise: format!("{} is both cheaper than {} and closer ({numbers})", name(best), name(base)),
            numbers,
        });
    }
    if let Some(best) = alike.iter().min_by(by_error) {
        let numbers = format!("{}, {}", fewer(best), errors(best));
        let why = because(compare(best, base, error, level));
        return Some(Told {
            answer: name(best),
            sure: true,
            sentence: format!("{} is cheaper than {}{on} at errors {why} ({numbers}){}", name(best), name(base), adds(best)),
            otherwise: format!("{} is cheaper at errors {why} ({numbers})", name(best)),
            numbers,
        });
    }
    let own_price = format!("{}, {}", say(base, cost), say(base, error));
    let mut sentence = format!(
        "none of {} other estimators is both cheaper than {} and as close to the reference{on} ({own_price})",
        others.len(),
        name(base)
    );
    if let Some(nearest) = cheaper.iter().min_by(by_error) {
        sentence += &format!("; the nearest cheaper one is {} ({}, {})", name(nearest), say(nearest, cost), say(nearest, error));
    }
    if let Some(closest) = others.iter().filter(|s| is_closer(s)).min_by(by_error) {
        sentence += &format!("; the closest one is {} ({}, {})", name(closest), say(closest, cost), say(closest, error));
    }
    Some(Told {
        answer: "none".to_owned(),
        sure: true,
        sentence,
        otherwise: format!("none is both cheaper than {} and as close ({own_price})", name(base)),
        numbers: own_price,
    })
}

fn estimators(table: &Table, rows: &[usize]) -> Option<String> {
    let rows = rows_of_estimators(table, rows);
    let front = table.front(&rows, table.cost, table.error);
    let base = &table.summaries[*rows.first()?];
    if front.points.is_empty() {
        return None;
    }
    let items = front_items(table, &front, |s| s.key.estimator.clone());
    let verb = if items.len() == 1 { "is" } else { "are" };
    let mut text = format!(
        "with {}, {} of {} estimators {verb} Pareto-optimal in {} and {}: {}",
        base.key.variant,
        items.len(),
        rows.len(),
        table.cost.words,
        table.error.words,
        list(&items, listed(table))
    );
    if let Some(ranked) = ranking(table, &rows, ADDED, 1).filter(|ranked| ranked.alike.is_empty()) {
        let steady = &table.summaries[ranked.best];
        text += &format!("; {} adds the least change ({}, {})", steady.key.estimator, say(steady, ADDED), flips_and_clumping(steady));
    }
    Some(text)
}

// ---- Variants. ----

/// Returns a text for each choice on a front: its name with cost, error and changes. Choices that are as good within chance are named with
/// the choice on the front.
fn front_items(table: &Table, front: &Front, name: impl Fn(&Summary) -> String) -> Vec<String> {
    let of = |i: usize| &table.summaries[i];
    let item = |(&point, alike): (&usize, &Vec<usize>)| {
        // Choices that differ from the choice on the front only in their noise are combined with it.
        let same = |a: &Summary, b: &Summary| {
            (&a.key.variant, &a.key.estimator, &a.key.temporal, &a.key.setting)
                == (&b.key.variant, &b.key.estimator, &b.key.temporal, &b.key.setting)
        };
        let (noises, others): (Vec<usize>, Vec<usize>) = alike.iter().copied().partition(|&i| same(of(i), of(point)));
        let group: Vec<&Summary> = std::iter::once(point).chain(noises).map(of).collect();
        let own = match group.len() {
            1 => name(group[0]),
            all if all == table.noises.len() => group[0].key.variant.clone(),
            some => format!("{} under {some} noises", group[0].key.variant),
        };
        let mut names: Vec<String> = others.iter().map(|&i| name(of(i))).collect();
        names.dedup();
        let within = if names.is_empty() { String::new() } else { format!("; within chance: {}", list(&names, 2)) };
        format!("{own} ({}{within})", price(table, &group))
    };
    front.points.iter().zip(&front.alike).map(item).collect()
}

/// Returns the row of the first automatic choice of a view.
fn automatic(table: &Table, rows: &[usize]) -> Option<usize> {
    rows.iter().copied().find(|&i| table.summaries[i].key.variant == "auto")
}

/// Returns the row that has the variant `variant` and otherwise the same columns as `like`.
fn with_variant(table: &Table, rows: &[usize], like: &Summary, variant: &str) -> Option<usize> {
    let same = |s: &Summary| {
        s.key.variant == variant
            && (&s.key.estimator, &s.key.noise, &s.key.temporal, &s.key.setting)
                == (&like.key.estimator, &like.key.noise, &like.key.temporal, &like.key.setting)
    };
    rows.iter().copied().find(|&i| same(&table.summaries[i]))
}

/// Compares the shading times of two rows as a statement about the first; `None` if one of them is missing or not stable.
fn speed_against(table: &Table, row: usize, other: usize) -> Option<String> {
    let time = |row: usize| table.shading(row)?.estimate();
    speed(time(row)?, time(other)?)
}

fn variants_told(table: &Table, rows: &[usize]) -> Option<Told> {
    let (cost, error) = (table.cost, table.error);
    let fronts = [error, ADDED].map(|metric| table.front(rows, cost, metric));
    let front = &fronts[0];
    let (Some(&first), Some(&last)) = (front.points.first(), front.points.last()) else { return without_cost(table, rows) };
    let of = |i: usize| &table.summaries[i];
    let label = |s: &Summary| table.label(&s.key);
    let noises = || {
        let told = noises_told(table, rows).filter(|_| table.noises.len() > 1)?;
        let among = if told.sure { format!("of {} noises, ", table.noises.len()) } else { String::new() };
        Some(format!("; {among}{}", told.sentence))
    };
    let Some(automatic) = automatic(table, rows) else {
        let both = |s: &Summary| format!("{} ({}, {})", label(s), say(s, cost), say(s, error));
        let ends = if first == last { both(of(first)) } else { format!("from {} to {}", both(of(first)), both(of(last))) };
        let count = front.points.len();
        let verb = if count == 1 { "is" } else { "are" };
        let own = if table.noises.len() > 1 { "choices" } else { "variants" };
        return Some(Told {
            answer: ends.clone(),
            sure: true,
            sentence: format!("{count} of {} {own} {verb} worth their fetches: {ends}{}", rows.len(), noises().unwrap_or_default()),
            otherwise: format!("{count} {verb} worth their fetches: {ends}"),
            numbers: ends,
        });
    };
    let auto = of(automatic);
    // The automatic choice is worth its fetches if, with at least one of the noises, it is on a front or as good within chance. One noise is enough,
    // because the question is not about the noise.
    let is_worth = |&i: &usize| fronts.iter().any(|front| front.contains(i) || front.is_alike(i));
    let worth = auto.value(error).is_nan() || rows.iter().filter(|&&i| of(i).key.variant == "auto").any(is_worth);
    // The most expensive choice on the front that costs at most as much as the automatic choice. If the automatic choice is not worth its fetches,
    // the answer names this choice as the better one.
    let better = front.points.iter().rev().map(|&i| of(i)).find(|s| s.value(cost) <= auto.value(cost));
    let splat = with_variant(table, rows, auto, "splat");
    let level = level_of_each(2);
    let mut saves = format!("it takes {}", say(auto, cost));
    let mut pays: Vec<String> = Vec::new();
    let mut numbers = say(auto, cost);
    if let Some(splat) = splat {
        let full = of(splat);
        let share = 1.0 - auto.value(cost) / full.value(cost);
        let part = if share >= 0.0 { format!("{:.0} % fewer", 100.0 * share) } else { format!("{:.0} % more", -100.0 * share) };
        saves = format!("it takes {} {} instead of full splat's {} ({part})", value(auto, cost), cost.words, value(full, cost));
        numbers = format!("{} instead of {} {}", value(auto, cost), value(full, cost), cost.words);
        if let Some(speed) = speed_against(table, automatic, splat) {
            saves += &format!(", and its shading is {speed} full splat's");
        }
        for metric in [error, ADDED].into_iter().filter(|m| auto.value(*m).is_finite() && full.value(*m).is_finite()) {
            let values = [value(auto, metric), value(full, metric)];
            pays.push(match compare(auto, full, metric, level) {
                Difference::Apart => format!("its {} is {} instead of {}", metric.words, values[0], values[1]),
                difference => format!("its {} is {} and full splat's {}, {}", metric.words, values[0], values[1], because(difference)),
            });
        }
        numbers += &pays.first().map_or_else(String::new, |pays| format!(", {pays}"));
    } else {
        let known = [error, ADDED].into_iter().filter(|m| auto.value(*m).is_finite());
        pays.extend(known.map(|m| format!("its {} is {}", m.words, value(auto, m))));
    }
    let pays = if pays.is_empty() { String::new() } else { format!("; {}", pays.join(", and ")) };
    let more = noises().unwrap_or_default();
    let Some(better) = better.filter(|_| !worth) else {
        return Some(Told {
            answer: "worth it".to_owned(),
            sure: true,
            sentence: format!("ship automatic choice: {saves}{pays}{more}"),
            otherwise: format!("automatic choice is worth its fetches ({numbers})"),
            numbers,
        });
    };
    let beaten = format!("{} takes {} at {}", label(better), say(better, cost), say(better, error));
    let beaten = format!("{beaten}, against {} at {}", value(auto, cost), value(auto, error));
    Some(Told {
        answer: "not worth it".to_owned(),
        sure: true,
        sentence: format!("automatic choice is not worth its fetches: {beaten}; {saves}{pays}{more}"),
        otherwise: format!("automatic choice is not worth its fetches ({beaten})"),
        numbers: beaten,
    })
}

fn variants(table: &Table, rows: &[usize]) -> Option<String> {
    let front = table.front(rows, table.cost, table.error);
    if front.points.is_empty() {
        return None;
    }
    let items = front_items(table, &front, |s| table.label(&s.key));
    let among = if table.noises.len() > 1 {
        format!("{} variants under {} noises", table.variants.len(), table.noises.len())
    } else {
        format!("{} variants", table.variants.len())
    };
    let verb = if items.len() == 1 { "is" } else { "are" };
    let mut text = format!(
        "of {among}, {} {verb} Pareto-optimal in {} and {}: {}",
        items.len(),
        table.cost.words,
        table.error.words,
        list(&items, listed(table))
    );
    if let Some(automatic) = automatic(table, rows) {
        let auto = &table.summaries[automatic];
        let against = |name: &str, words: &str| {
            let other = with_variant(table, rows, auto, name)?;
            Some(format!("{} {words}", speed_against(table, automatic, other)?))
        };
        let speeds: Vec<String> =
            [against("splat", "full splat everywhere"), against("generic", "the generic kernel")].into_iter().flatten().collect();
        text += &format!("; automatic choice ({}) has {}", table.label(&auto.key), price(table, &[auto]));
        if !speeds.is_empty() {
            text += &format!(", and its shading is {}", speeds.join(" and "));
        }
    }
    if table.noises.len() > 1
        && table.views.len() == 1
        && let Some(part) = noises(table, rows)
    {
        text += &format!("; {part}");
    }
    Some(text)
}

/// Names the choices with the smallest and the largest error. If no error was measured, added change is used instead. This is the answer if cost or
/// error is missing, for example because it was not measured in this view.
fn without_cost(table: &Table, rows: &[usize]) -> Option<Told> {
    let (metric, (low, high)) = [table.error, ADDED].into_iter().find_map(|m| Some((m, extremes(table, rows, m)?)))?;
    let of = |i: usize| &table.summaries[i];
    let item = |i: usize| format!("{} ({})", table.label(&of(i).key), price(table, &[of(i)]));
    let is_known = |metric| !known(table, rows, metric).is_empty();
    let missing = match (is_known(table.cost), is_known(table.error)) {
        (false, true) => "no cost was measured",
        (true, false) => "no error was measured",
        (false, false) => "neither cost nor error was measured",
        (true, true) => "cost and error were not measured for the same choices",
    };
    let what = format!("{missing}; by {},", metric.words);
    let level = level_of_ranking(known(table, rows, metric).len(), 1);
    let difference = if low == high { Difference::Apart } else { compare(of(low), of(high), metric, level) };
    let sentence = match difference {
        _ if low == high => format!("{what} the only choice is {}", item(low)),
        Difference::Apart => format!("{what} the best choice is {}, and the worst is {}", item(low), item(high)),
        unclear => format!("{what} the best choice is {} and the worst is {}, {}", item(low), item(high), because(unclear)),
    };
    Some(Told {
        answer: table.label(&of(low).key),
        sure: difference == Difference::Apart,
        otherwise: format!("it is {}", item(low)),
        numbers: say(of(low), metric),
        sentence,
    })
}

// ---- One choice. ----

fn one_told(table: &Table, rows: &[usize]) -> Option<Told> {
    let summary = &table.summaries[*rows.first()?];
    let metrics = [table.cost, table.error, ADDED, LOST, PERCEIVED];
    let parts: Vec<String> =
        metrics.into_iter().filter(|&m| is_usable(table, m) && !summary.value(m).is_nan()).map(|m| say(summary, m)).collect();
    if parts.is_empty() {
        return None;
    }
    let mut text = format!("{} has {}", summary.key.variant, list(&parts, LISTED));
    if !summary.value(FLIPS).is_nan() || !summary.value(CLUMPING).is_nan() {
        text += &format!(" ({})", flips_and_clumping(summary));
    }
    // Views are not compared with one another, so each has its own answer.
    Some(Told { answer: summary.key.view.clone(), sure: true, otherwise: text.clone(), numbers: String::new(), sentence: text })
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::metrics::{self, Axis};
    use crate::report::RunData;
    use crate::report::fake::{self, Rows, TABLES, base, definition, measured};
    use crate::row::Row;

    /// A number of a choice: its metric, its value and its standard error.
    type Figure = (&'static str, f64, Option<f64>);

    /// Returns the answer of a run that measures albedo in 16 frames, with the given choices and their numbers. Standard errors of changes have 14
    /// degrees of freedom, so the half-width of a 95 % interval is 2.145 standard errors. Perceived noise is measured in four frames, so the
    /// half-width is 3.182 standard errors.
    fn said(choices: &[(Row, Vec<Figure>)]) -> String {
        said_in(16, choices)
    }

    /// Like [`said`], for a given number of frames.
    fn said_in(frames: u32, choices: &[(Row, Vec<Figure>)]) -> String {
        verdict(&table_of(frames, choices))
    }

    fn table_of(frames: u32, choices: &[(Row, Vec<Figure>)]) -> Table {
        let mut rows = Rows::new();
        for (row, numbers) in choices {
            for &(metric, value, error) in numbers {
                let lag = metrics::find(metric).filter(|known| known.axis == Axis::Lag).map(|_| 1);
                rows.put(&Row { lag, signal: "albedo".to_owned(), ..row.clone() }, metric, "", value, error);
            }
        }
        let definition = definition(&format!("frames = {frames}\nseeds = 8\nvariants = [\"all\"]"));
        Table::of(&fake::run(definition, rows, Path::new(".")))
    }

    /// Returns the first line of the answer.
    fn first(choices: &[(Row, Vec<Figure>)]) -> String {
        said(choices).lines().next().expect("an answer").to_owned()
    }

    /// Numbers with the standard error 0: fetches, RMSE, added change, flip rate and clumping. NaN = the number has no row.
    fn five(values: [f64; 5]) -> Vec<Figure> {
        let metrics = ["fetches_per_px", "rmse", "added", "flip_rate", "clumping"];
        metrics.into_iter().zip(values).filter(|(_, value)| !value.is_nan()).map(|(metric, value)| (metric, value, Some(0.0))).collect()
    }

    fn variant(name: &str) -> Row {
        Row { variant: name.to_owned(), ..base("cliff") }
    }

    /// A row of near cliff with a noise.
    fn noise(name: &str) -> Row {
        Row { noise: name.to_owned(), ..variant("near-cliff") }
    }

    /// Added change with its standard error.
    fn adds(value: f64, error: f64) -> Figure {
        ("added", value, Some(error))
    }

    /// Perceived noise with its standard error.
    fn seen(value: f64, error: f64) -> Figure {
        ("perceived_noise", value, Some(error))
    }

    const NONE: f64 = f64::NAN;

    #[test]
    fn variants_are_those_on_the_front() {
        let mut all = vec![
            (variant("vt"), five([4.0, 0.05, 0.001, NONE, NONE])),
            (variant("splat"), five([48.0, 0.01, 0.0, NONE, NONE])),
            (variant("near-cliff"), five([50.0, 0.02, 0.01, NONE, NONE])),
        ];
        assert_eq!(
            said(&all),
            "2 of 3 variants are worth their fetches: from vt (4.0 fetches per pixel, RMSE 0.05) to splat (48.0 fetches per pixel, RMSE 0.01).\n\
             Of 3 variants, 2 are Pareto-optimal in fetches per pixel and RMSE: vt (4.0 fetches, RMSE 0.05, added change 0.001) and splat (48.0 fetches, \
             RMSE 0.01, added change 0)."
        );
        // With fewer fetches, the third choice is no longer dominated, so it joins the front.
        all[2].1 = five([12.0, 0.02, 0.01, NONE, NONE]);
        assert!(said(&all).starts_with("3 of 3 variants are worth their fetches"), "{}", said(&all));
        assert!(said(&all).contains("near-cliff (12.0 fetches, RMSE 0.02, added change 0.01)"));
    }

    #[test]
    fn equal_noises_are_not_told_apart() {
        let equal = |name: &str| (noise(name), five([NONE, 0.05, 0.003, NONE, NONE]));
        let text = said(&[equal("hashed"), equal("white")]);
        assert_eq!(
            text,
            "The noises hardly differ in added change on near-cliff: added change 0.003 with all noises.\n\
             With near-cliff and 2 noises, added change is 0.003 with all noises; RMSE is 0.05 with all noises."
        );
    }

    #[test]
    fn a_change_without_a_standard_error_decides_nothing() {
        let of = |error: Option<f64>| {
            let row = |name: &str, value: f64| (noise(name), vec![("added", value, error), ("rmse", 0.05, Some(0.0))]);
            first(&[row("hashed", 0.001), row("white", 0.009)])
        };
        assert!(of(Some(1e-5)).starts_with("Hashed noise adds the least change in motion"), "{}", of(Some(1e-5)));
        assert!(of(None).starts_with("The run cannot tell which noise adds the least change in motion"), "{}", of(None));
    }

    #[test]
    fn noises_that_clump_alike_within_chance_have_no_superlative() {
        let of = |error: f64| {
            let row = |name: &str, flips: f64, clumping: f64| {
                (noise(name), vec![("added", 0.001, Some(0.0)), ("flip_rate", flips, Some(1e-4)), ("clumping", clumping, Some(error))])
            };
            said(&[row("hashed", 0.1, 1.35), row("white", 0.5, 1.30)])
        };
        assert!(of(0.001).contains("the noise that clumps least is white"), "{}", of(0.001));
        let unclear = of(0.3);
        assert!(unclear.contains("the fewest choices flip under hashed") && unclear.contains("clumping ranges from 1.3"), "{unclear}");
        assert!(!unclear.contains("clumps least"), "{unclear}");
    }

    #[test]
    fn variants_without_a_cost_are_told_by_error_or_added_change() {
        let mut all =
            vec![(variant("vt"), five([NONE, 0.05, 0.001, NONE, NONE])), (variant("splat"), five([NONE, 0.01, 0.002, NONE, NONE]))];
        assert_eq!(
            said(&all),
            "No cost was measured; by RMSE, the best choice is splat (RMSE 0.01, added change 0.002), and the worst is vt (RMSE 0.05, added change 0.001)."
        );
        all.iter_mut().for_each(|(_, numbers)| numbers.retain(|(metric, ..)| *metric != "rmse"));
        assert_eq!(
            said(&all),
            "Neither cost nor error was measured; by added change, the best choice is vt (added change 0.001), and the worst is splat (added change 0.002)."
        );
    }

    #[test]
    fn automatic_choice_is_shipped_if_nothing_beats_it() {
        let numbers =
            |fetches: f64, rmse: f64, added: f64| vec![("fetches_per_px", fetches, None), ("rmse", rmse, None), adds(added, 0.00002)];
        let mut all = vec![
            (variant("auto"), numbers(8.0, 0.015, 0.001)),
            (variant("splat"), numbers(48.0, 0.014, 0.0001)),
            (variant("far-atlas"), numbers(2.0, 0.03, 0.0002)),
        ];
        assert_eq!(
            first(&all),
            "Ship automatic choice: it takes 8.0 fetches per pixel instead of full splat's 48.0 (83 % fewer); its RMSE is 0.015 instead of 0.014, and its \
             added change is 0.001000 \u{b1} 0.000043 instead of 0.000100 \u{b1} 0.000043."
        );
        // A cheaper variant with a smaller error is added.
        all.push((variant("vt"), numbers(4.0, 0.0145, 0.0002)));
        assert!(
            first(&all).starts_with(
                "Automatic choice is not worth its fetches: vt takes 4.0 fetches per pixel at RMSE 0.0145, against 8.0 at 0.015; it takes 8.0 fetches"
            ),
            "{}",
            first(&all)
        );
        // If chance explains a difference, the answer says so.
        let unclear =
            [(variant("auto"), vec![("fetches_per_px", 8.0, None), adds(0.0012, 0.0002)]), (variant("splat"), numbers(48.0, 0.014, 0.001))];
        let unclear = unclear.map(|(row, mut numbers)| {
            numbers.push(("flip", 0.02, None));
            numbers.retain(|(metric, ..)| *metric != "rmse");
            (row, numbers)
        });
        assert!(
            first(&unclear).contains(
                "its added change is 0.00120 \u{b1} 0.00043 and full splat's 0.001000 \u{b1} 0.000043, which the run cannot tell apart"
            ),
            "{}",
            first(&unclear)
        );
    }

    #[test]
    fn automatic_choice_is_held_against_splat_and_generic() {
        let folder = Path::new(".");
        let text = verdict(&Table::of(&fake::variants(folder, &["cliff"], &["hashed"])));
        // The shading times are 3 + 1.1 x 17.3 ms for auto, 3 + 1.1 x 48 ms for splat, and 3 + 1.2 x 1.1 x 17.3 ms for generic. The ratios of splat
        // and generic to auto have a standard error of 1 %.
        assert!(
            text.contains(
                "its shading is 2.533 \u{b1} 0.050 times as fast as full splat everywhere and 1.173 \u{b1} 0.023 times as fast as the generic kernel"
            ),
            "{text}"
        );
        assert!(
            text.starts_with("Automatic choice is not worth its fetches: vt+far-atlas takes 6.0 fetches per pixel at RMSE 0.0652"),
            "{text}"
        );
        assert!(text.contains("(64 % fewer), and its shading is 2.533 \u{b1} 0.050 times as fast as full splat's"), "{text}");
        // If the Pareto front has too many choices, the verdict omits some and gives their number.
        let text = verdict(&Table::of(&fake::variants(folder, &["cliff", "ground"], &["hashed"])));
        assert!(text.contains("more between them"), "{text}");
        // A variant whose choices have equal numbers with all noises is named once.
        let text = verdict(&Table::of(&fake::variants(folder, &["cliff"], &fake::NOISES)));
        assert!(text.contains(": far-atlas (2.0 fetches, RMSE 0.1273 \u{b1} 0.0027, added change 0.000823"), "{text}");
        assert!(
            text.contains(
                "; of 6 noises, hashed noise adds the least change in motion: 0.01436 \u{b1} 0.00092 a frame with automatic choice, against 0.0380 \u{b1} \
                 0.0024 with white noise; it looks noisier to the eye at 60 frames a second than white noise (perceived noise 0.01277 \u{b1} 0.00041 \
                 against 0.00656 \u{b1} 0.00021)."
            ),
            "{text}"
        );
        assert!(text.contains("with auto and 6 noises"), "{text}");
    }

    #[test]
    fn unstable_times_take_no_part_and_are_counted() {
        let mut run = fake::variants(Path::new("."), &["cliff"], &["hashed"]);
        assert!(!verdict(&Table::of(&run)).contains("unstable"));
        // The limit of the interval is 5 %: 1.96 standard errors of 2.5 % are 4.9 %, and those of 2.6 % are 5.1 %.
        let spread = |run: &mut RunData, share: f64| {
            for row in run.times.iter_mut().filter(|row| row.metric == metrics::SHADING_RATIO && row.variant == "splat") {
                row.standard_error = Some(share * row.value);
            }
            verdict(&Table::of(run))
        };
        let text = spread(&mut run, 0.025);
        assert!(text.contains("times as fast as full splat everywhere and") && !text.contains("unstable"), "{text}");
        assert!(text.contains("times as fast as full splat's"), "{text}");
        let text = spread(&mut run, 0.026);
        assert!(
            text.contains("its shading is 1.173 \u{b1} 0.023 times as fast as the generic kernel; 1 of 33 shading times are unstable"),
            "{text}"
        );
        assert!(!text.contains("times as fast as full splat"), "{text}");
        // A ratio without a standard error counts as unstable.
        run.times.iter_mut().filter(|row| row.variant == "generic").for_each(|row| row.standard_error = None);
        let text = verdict(&Table::of(&run));
        assert!(!text.contains("its shading") && text.contains("2 of 33 shading times are unstable"), "{text}");
    }

    #[test]
    fn noises_are_told_by_the_change_that_they_add_and_by_how_they_look() {
        let all = [
            (noise("hashed"), vec![adds(0.0012, 0.00005), seen(0.0021, 0.00001)]),
            (noise("white"), vec![adds(0.0048, 0.00005), seen(0.0012, 0.00001)]),
            (noise("blue"), vec![adds(0.0040, 0.00005), seen(0.0014, 0.00001)]),
        ];
        assert_eq!(
            first(&all),
            "Hashed noise adds the least change in motion: 0.00120 \u{b1} 0.00011 a frame on near-cliff, against 0.00480 \u{b1} 0.00011 with white noise; \
             it looks noisier to the eye at 60 frames a second than white noise (perceived noise 0.002100 \u{b1} 0.000032 against 0.001200 \u{b1} 0.000032)."
        );
        let of_two = |error: f64| {
            first(&[
                (noise("hashed"), vec![adds(0.0012, 0.00005), seen(0.0010, error)]),
                (noise("white"), vec![adds(0.0048, 0.00005), seen(0.0018, error)]),
            ])
        };
        assert!(
            of_two(0.00001).contains(
                "; no other noise looks less noisy to the eye at 60 frames a second (perceived noise 0.001000 \u{b1} 0.000032 against 0.001800 \u{b1} 0.000032 with \
                 white noise)"
            ),
            "{}",
            of_two(0.00001)
        );
        assert!(
            of_two(0.0002).contains("; the run cannot tell how the noises differ to the eye at 60 frames a second"),
            "{}",
            of_two(0.0002)
        );
    }

    #[test]
    fn perceived_noise_of_short_sequences_is_in_no_answer() {
        let noises = [
            (noise("hashed"), vec![adds(0.0012, 0.00001), seen(0.0021, 0.00001)]),
            (noise("white"), vec![adds(0.0048, 0.00001), seen(0.0012, 0.00001)]),
        ];
        let looks =
            [0.0021, 0.0012].map(|value| (setting("p", &value.to_string()), vec![seen(value, 0.00001), ("rmse", 10.0 * value, None)]));
        let resolves = ["off", "exponential"].map(|temporal| {
            let row = Row { temporal: temporal.to_owned(), ..noise("hashed") };
            (row, vec![adds(if temporal == "off" { 0.004 } else { 0.001 }, 0.00001), seen(0.002, 0.00001)])
        });
        let one = [(noise("hashed"), vec![adds(0.0012, 0.00001), seen(0.0021, 0.00001)])];
        for choices in [&noises[..], &looks[..], &resolves[..], &one[..]] {
            let [long, short] = [16, 15].map(|frames| said_in(frames, choices));
            assert!(long.contains("perceived noise"), "{long}");
            assert!(!short.contains("perceived noise") && !short.contains("the eye"), "{short}");
            assert!(!short.starts_with("No row"), "{short}");
        }
        assert!(said_in(15, &looks).starts_with("Of 2 values of p, 0.0012 is closest to the reference"), "{}", said_in(15, &looks));
    }

    #[test]
    fn noises_whose_intervals_overlap_are_not_ranked() {
        let two = |a: f64, b: f64, error: f64| first(&[(noise("hashed"), vec![adds(a, error)]), (noise("white"), vec![adds(b, error)])]);
        assert_eq!(
            two(0.0012, 0.0014, 0.0001),
            "The run cannot tell which noise adds the least change in motion on near-cliff: added change 0.00120 \u{b1} 0.00021 with hashed noise and \
             0.00140 \u{b1} 0.00021 with white noise."
        );
        assert!(two(0.0012, 0.00121, 0.000001).contains("which differ by less than 2 %"), "{}", two(0.0012, 0.00121, 0.000001));
        assert!(two(0.0012, 0.0014, 0.00001).starts_with("Hashed noise adds"), "{}", two(0.0012, 0.0014, 0.00001));
        // Chance explains the difference between two of the three noises.
        let three = [("hashed", 0.0012), ("world", 0.0013), ("white", 0.0048)];
        assert_eq!(
            first(&three.map(|(name, value)| (noise(name), vec![adds(value, 0.00005)]))),
            "Hashed and world noise add the least change in motion: 0.00120 \u{b1} 0.00011 a frame on near-cliff with hashed noise, which the run cannot tell \
             from world (0.00130 \u{b1} 0.00011), against 0.00480 \u{b1} 0.00011 with white noise."
        );
    }

    #[test]
    fn details_of_noises_give_flips_and_clumping_together() {
        let noise = |name: &str| Row { noise: name.to_owned(), ..base("cliff") };
        let all = [
            (noise("hashed"), five([10.0, 0.0500, 0.002, 0.1, 3.0])),
            (noise("blue"), five([10.0, 0.0501, 0.004, 0.4, 0.5])),
            (noise("white"), five([10.0, 0.0502, 0.005, 0.5, 1.0])),
        ];
        assert_eq!(
            said(&all),
            "Hashed noise adds the least change in motion: 0.002 a frame with automatic choice, against 0.005 with white noise.\n\
             With auto and 3 noises, the fewest choices flip under hashed (flip rate 0.1, clumping 3), the noise that clumps least is blue (flip rate 0.4, \
             clumping 0.5), against white (flip rate 0.5, clumping 1); added change ranges from 0.002 (hashed) to 0.005 (white); \
             RMSE is 0.05 with all noises."
        );
        // If one noise has both the fewest flips and the least clumping, it is named once.
        let mut both = all.clone();
        both[0].1 = five([10.0, 0.05, 0.002, 0.1, 0.4]);
        assert!(said(&both).contains("hashed both flips and clumps least (flip rate 0.1, clumping 0.4)"), "{}", said(&both));
        // There are as many variants as noises. The noises are compared, because no cost was measured.
        let of_variants = ["splat", "near-cliff"].map(|v| (Row { variant: v.to_owned(), ..noise("hashed") }, all[0].1.clone()));
        let mut more: Vec<_> = all.iter().cloned().chain(of_variants).collect();
        more.iter_mut().for_each(|(_, numbers)| numbers.retain(|(metric, ..)| *metric != "fetches_per_px"));
        assert!(
            first(&more).starts_with("Hashed noise adds the least change in motion: 0.002 a frame with automatic choice"),
            "{}",
            said(&more)
        );
        // The details of noises mention flips together with clumping, even if clumping was not measured.
        let mut lost = all.clone();
        lost.iter_mut().for_each(|(_, numbers)| numbers.retain(|(metric, ..)| *metric != "clumping"));
        assert!(said(&lost).contains("hashed (flip rate 0.1, clumping not measured)"), "{}", said(&lost));
    }

    /// A row with a value of a parameter.
    fn setting(parameter: &str, value: &str) -> Row {
        Row { parameter: parameter.to_owned(), setting: value.to_owned(), ..base("cliff") }
    }

    #[test]
    fn a_parameter_has_a_best_value_and_its_price() {
        let scale = |value: &str| setting("blend.hash_scale", value);
        let mut all = vec![
            (scale("0.5"), five([10.0, 0.05, 0.004, 0.6, 1.0])),
            (scale("1.0"), five([10.0, 0.05, 0.003, 0.3, 2.0])),
            (scale("4.0"), five([10.0, 0.0501, 0.001, 0.06, 8.0])),
        ];
        assert_eq!(
            said(&all),
            "Of 3 values of blend.hash_scale, 4.0 adds the least change in motion: 0.001 a frame, against 0.004 at 0.5; in return, clumping is 8 there and \
             smallest at 0.5 (1).\n\
             Over 3 values of blend.hash_scale, added change ranges from 0.001 at 4.0 to 0.004 at 0.5; flip rate ranges from 0.06 at 4.0 to 0.6 at 0.5; \
             clumping ranges from 1 at 0.5 to 8 at 4.0; the parameter changes RMSE, fetches per pixel by less than 2 %."
        );
        // A higher cost is a disadvantage that the sentence names, too.
        (all[0].1, all[2].1) = (five([1000.0, 0.05, 0.004, 0.6, 1.0]), five([12.0, 0.0501, 0.001, 0.06, 8.0]));
        assert!(
            first(&all).contains("; in return, it takes 12.0 fetches per pixel there and fewest at 1.0 (10.0), and clumping is 8 there"),
            "{}",
            first(&all)
        );
        // No metric changes.
        let still: Vec<_> = all.iter().map(|(row, _)| (row.clone(), five([10.0, 0.05, NONE, NONE, NONE]))).collect();
        assert_eq!(
            first(&still),
            "The run finds no difference between 3 values of blend.hash_scale that chance does not explain (differences below 2 % do not count): RMSE 0.05 \
             to 0.05 and fetches per pixel 10.0 to 10.0."
        );
    }

    #[test]
    fn values_within_chance_of_the_best_are_named() {
        let flips = |value: &str, flips: f64| (setting("p", value), vec![("flip_rate", flips, Some(0.01))]);
        assert_eq!(
            said(&[flips("1", 0.3), flips("2", 0.31), flips("3", 0.5)]),
            "Of 3 values of p, 1 flips the fewest choices: flip rate 0.300 \u{b1} 0.021, which the run cannot tell from 2 (0.310 \u{b1} 0.021), against \
             0.500 \u{b1} 0.021 at 3.\n\
             Over 3 values of p, flip rate ranges from 0.300 \u{b1} 0.021 at 1 to 0.500 \u{b1} 0.021 at 3; clumping was not measured."
        );
        let added = |value: &str, added: f64| (setting("p", value), vec![adds(added, 0.0001)]);
        assert_eq!(
            first(&[added("1", 0.001), added("2", 0.0012)]),
            "The run finds no difference between 2 values of p that chance does not explain (differences below 2 % do not count): added change 0.00100 \
             \u{b1} 0.00021 to 0.00120 \u{b1} 0.00021."
        );
    }

    #[test]
    fn a_resolve_is_held_against_none() {
        let row = |noise: &str, temporal: &str| Row { noise: noise.to_owned(), temporal: temporal.to_owned(), ..variant("far-cliff") };
        // A row has four metrics: added change, lost change, perceived noise, and flip rate. The first and the third have a standard error of 1 %.
        let numbers = |added: f64, lost: f64, perceived: f64| {
            vec![adds(added, 0.01 * added), ("lost", lost, None), seen(perceived, 0.01 * perceived), ("flip_rate", 0.3, None)]
        };
        let one = [(row("hashed", "off"), numbers(0.004, 0.001, 0.002)), (row("hashed", "exponential"), numbers(0.001, 0.0015, 0.001))];
        assert_eq!(
            said(&one),
            "exponential removes the most added change on far-cliff: it multiplies it by 0.2500 \u{b1} 0.0072 (0.004000 \u{b1} 0.000086 to 0.001000 \u{b1} \
             0.000021 a frame); lost change goes from 0.001 to 0.0015, and perceived noise at 60 frames a second is multiplied by 0.500 \u{b1} 0.017.\n\
             Compared with off, exponential changes added change from 0.004000 \u{b1} 0.000086 to 0.001000 \u{b1} 0.000021 (factor 0.2500 \u{b1} 0.0072), \
             lost change from 0.001 to 0.0015 (factor 1.5), perceived noise from 0.002000 \u{b1} 0.000064 to 0.001000 \u{b1} 0.000032 (factor 0.500 \u{b1} \
             0.017) and changes flip rate by less than 2 %."
        );
        let more = [(row("white", "off"), numbers(0.004, 0.001, 0.002)), (row("white", "exponential"), numbers(0.002, 0.0015, 0.001))];
        let text = said(&[&one[..], &more[..]].concat());
        assert!(
            text.contains(
                "a frame) and by 0.500 \u{b1} 0.014 with white noise, whose change it reduces least; with hashed noise, lost change goes"
            ),
            "{text}"
        );
        assert!(
            text.contains(
                "changes added change by a factor of 0.2500 \u{b1} 0.0072 (hashed: 0.004000 \u{b1} 0.000086 to 0.001000 \u{b1} 0.000021) to 0.500 \u{b1} \
                 0.014 (white: 0.004000 \u{b1} 0.000086 to 0.002000 \u{b1} 0.000043), lost change by a factor of 1.5, perceived noise by a factor of 0.500"
            ),
            "{text}"
        );
        // A resolve whose effect chance explains, and one that adds change.
        let noisy = |added: f64| vec![adds(added, 0.0004), ("flip_rate", 0.3, None)];
        let unclear = [(row("hashed", "off"), noisy(0.004)), (row("hashed", "exponential"), noisy(0.0038))];
        assert_eq!(
            first(&unclear),
            "The run cannot tell whether a resolve removes added change on far-cliff: exponential multiplies it by 0.95 \u{b1} 0.28 (0.00400 \u{b1} 0.00086 \
             to 0.00380 \u{b1} 0.00086 a frame)."
        );
        let worse = [(row("hashed", "off"), numbers(0.001, 0.001, 0.002)), (row("hashed", "exponential"), numbers(0.002, 0.001, 0.002))];
        assert!(
            first(&worse).starts_with("No resolve removes added change on far-cliff: exponential multiplies it by 2.000"),
            "{}",
            first(&worse)
        );
        // If no choice was measured both with and without the resolve, nothing can be compared.
        assert!(said(&[one[0].clone(), more[1].clone()]).starts_with("No row"), "no pair");
    }

    #[test]
    fn resolves_are_ranked_and_noises_that_survive_are_named() {
        let text = verdict(&Table::of(&fake::temporal(Path::new("."), &fake::NOISES)));
        assert!(
            text.starts_with(
                "Of 2 resolves, exponential removes the most added change with automatic choice: it multiplies it by 0.265 \u{b1} 0.023 with white noise \
                 (0.0372 \u{b1} 0.0024 to 0.00985 \u{b1} 0.00063 a frame); the run cannot tell for which noise the factor is largest (up to 0.289 \u{b1} 0.025 with \
                 hashed noise)"
            ),
            "{text}"
        );
    }

    #[test]
    fn estimators_are_held_against_the_first() {
        let text = verdict(&Table::of(&fake::estimators(Path::new("."))));
        assert!(
            text.starts_with(
                "luna8 is both cheaper than fc5 and closer to the reference on near-cliff (10.0 against 12.0 fetches per pixel, RMSE 0.0550 \u{b1} 0.0012 \
                 against 0.0587 \u{b1} 0.0013); it adds 0.01250 \u{b1} 0.00054 of change a frame against 0.01500 \u{b1} 0.00064.\n\
                 With near-cliff, 5 of 8 estimators are Pareto-optimal in fetches per pixel and RMSE: one-tap (3.0 fetches, RMSE 0.1000 \u{b1} 0.0021, \
                 added change 0.0387 \u{b1} 0.0017)"
            ),
            "{text}"
        );
        assert!(
            text.contains("exact adds the least change (added change 0.000750 \u{b1} 0.000032, flip rate 0.00540 \u{b1} 0.00013"),
            "{text}"
        );
        let measured = |rmse: f64, error: f64| {
            let of = |estimator: &str, fetches: f64, rmse: f64, added: f64| {
                let row = Row { estimator: estimator.to_owned(), ..variant("near-cliff") };
                (row, vec![("fetches_per_px", fetches, None), ("rmse", rmse, Some(error)), adds(added, 0.0002)])
            };
            first(&[of("fc5", 12.0, 0.047, 0.012), of("biplanar", 8.0, rmse, 0.013), of("exact", 48.0, 0.009, 0.0006)])
        };
        let others = |rmse: f64| measured(rmse, 0.0005);
        // In real runs, the RMSE of a single frame has no known standard error. This test gives it one.
        assert!(
            measured(0.0475, 0.0001).starts_with(
                "biplanar is cheaper than fc5 on near-cliff at errors which differ by less than 2 % (8.0 against 12.0 fetches"
            ),
            "{}",
            measured(0.0475, 0.0001)
        );
        // The values differ by 1 %, but their intervals are wider than 2 %.
        assert!(others(0.0475).contains("at errors which the run cannot tell apart (8.0 against 12.0 fetches"), "{}", others(0.0475));
        assert!(
            others(0.0485).contains("at errors which the run cannot tell apart (8.0 against 12.0 fetches per pixel, RMSE 0.0485"),
            "{}",
            others(0.0485)
        );
        assert_eq!(
            others(0.06),
            "None of 2 other estimators is both cheaper than fc5 and as close to the reference on near-cliff (12.0 fetches per pixel, RMSE 0.0470 \u{b1} \
             0.0011); the nearest cheaper one is biplanar (8.0 fetches per pixel, RMSE 0.0600 \u{b1} 0.0011); the closest one is exact (48.0 fetches per \
             pixel, RMSE 0.0090 \u{b1} 0.0011)."
        );
    }

    #[test]
    fn values_are_only_close_if_their_intervals_are_narrow() {
        let of = |from: f64, to: f64, error: Option<f64>| {
            let figures = [from, to].map(|value| (noise("hashed"), vec![("added", value, error)]));
            let [a, b] = figures.map(|figure| table_of(16, &[figure]).summaries.remove(0));
            (compare(&a, &b, ADDED, 0.05), is_close(&a, &b, ADDED))
        };
        // Half-widths are 2.145 standard errors each, and 2 % of the larger value are 0.000202.
        assert_eq!(of(0.0100, 0.0101, Some(0.005 / 2.145)), (Difference::Unclear, false));
        assert_eq!(of(0.0100, 0.0101, Some(0.00005 / 2.145)), (Difference::Close, true));
        assert_eq!(of(0.0100, 0.0101, Some(0.00006 / 2.145)), (Difference::Unclear, false));
        // Without a standard error, nobody knows how much a change scatters. Only equal values are close.
        assert_eq!([of(0.0100, 0.0101, None), of(0.0100, 0.0200, None)], [(Difference::Unclear, false); 2]);
        assert_eq!([of(0.0, 0.0, None), of(0.01, 0.0101, Some(0.0))], [(Difference::Close, true); 2]);
        assert_eq!(of(0.0100, 0.0103, Some(0.00001)), (Difference::Apart, false));
        // The lines with details also treat values as equal only if their intervals are narrow.
        let scale = |value: &str, error: f64| (setting("p", value), vec![("rmse", if value == "1" { 0.05 } else { 0.0501 }, Some(error))]);
        assert!(said(&[scale("1", 1e-5), scale("2", 1e-5)]).contains("the parameter changes RMSE by less than 2 %"));
        let text = said(&[scale("1", 0.01), scale("2", 0.01)]);
        assert!(text.contains("RMSE ranges from") && !text.contains("by less than"), "{text}");
        let resolve = |temporal: &str, error: f64| {
            let row = Row { temporal: temporal.to_owned(), ..noise("hashed") };
            (row, vec![adds(if temporal == "off" { 0.004 } else { 0.001 }, 1e-5), ("flip_rate", 0.3, Some(error))])
        };
        assert!(said(&[resolve("off", 1e-5), resolve("flipquad", 1e-5)]).contains("changes flip rate by less than 2 %"));
        let text = said(&[resolve("off", 0.01), resolve("flipquad", 0.01)]);
        assert!(text.contains("flip rate from 0.300") && !text.contains("by less than"), "{text}");
    }

    /// Counts the random tables, out of [`TABLES`], for which `holds` is true. Each metric has the same true value in all `rows`. `metrics`: each
    /// metric with the number of random values whose mean is its measured value.
    fn count(rows: &[Row], metrics: &[(&'static str, u32)], salt: u32, holds: impl Fn(&Table) -> bool) -> u32 {
        let table = |seed: u32| {
            let figures = |(point, row): (u32, &Row)| {
                let figure = |(k, &(metric, samples)): (u32, &(&'static str, u32))| {
                    let Estimate { value, error, .. } = measured(1.0, 0.1, samples, [seed, point, salt + k]);
                    (metric, value, Some(error))
                };
                (row.clone(), (0..).zip(metrics).map(figure).collect::<Vec<Figure>>())
            };
            table_of(16, &(0..).zip(rows).map(figures).collect::<Vec<_>>())
        };
        (0..TABLES).map(|seed| u32::from(holds(&table(seed)))).sum()
    }

    /// Added change is measured in 15 groups of frames.
    const CHANGE: (&str, u32) = ("added", 15);

    #[test]
    fn noise_alone_seldom_ranks_equal_values() {
        for values in [6, 12, 20] {
            let rows: Vec<Row> = (0..values).map(|value| noise(&format!("noise-{value}"))).collect();
            let is_told = |table: &Table| {
                let ranked = ranking(table, &table.of_view("cliff"), ADDED, 1).expect("values");
                ranked.difference == Difference::Apart
            };
            let wrong = count(&rows, &[CHANGE], 6, is_told);
            assert!(wrong <= TABLES / 20, "{wrong} of {TABLES} tables of {values} equal values have a best one");
        }
        // Negative control: a single test at the level 5 %, as if the best and the worst noise were chosen before the measurement, and without the
        // rule that intervals must not overlap.
        let rows: Vec<Row> = (0..12).map(|value| noise(&format!("noise-{value}"))).collect();
        let blind = |table: &Table| {
            let Some((low, high)) = extremes(table, &table.of_view("cliff"), ADDED) else { return false };
            table.summaries[high].estimate(ADDED).is_above(table.summaries[low].estimate(ADDED), 0.05)
        };
        assert!(count(&rows, &[CHANGE], 6, blind) > 700, "the simulation has no noise");
    }

    #[test]
    fn noise_alone_seldom_makes_a_parameter_matter() {
        // The sentence uses the first of four metrics that shows a difference between eight values. Of 16 frames, 15 have a flip rate, and 4 have
        // perceived noise.
        let rows: Vec<Row> = (0..8).map(|value| setting("p", &value.to_string())).collect();
        let metrics = [CHANGE, ("perceived_noise", 4), ("rmse", 16), ("flip_rate", 15)];
        let is_told = |table: &Table| parameter_told(table, &table.of_view("cliff")).expect("values").sure;
        let wrong = count(&rows, &metrics, 8, is_told);
        assert!(wrong <= TABLES / 20, "{wrong} of {TABLES} tables have a best value of a parameter that changes nothing");
    }

    #[test]
    fn noise_alone_seldom_makes_a_resolve_remove_change() {
        // Three resolves with four noises are 12 factors, all of which are 1.
        let mut rows = Vec::new();
        for temporal in ["off", "exponential", "flipquad", "smaa"] {
            rows.extend(["hashed", "white", "blue", "world"].map(|name| Row { temporal: temporal.to_owned(), ..noise(name) }));
        }
        let told = |table: &Table| temporal_told(table, &table.of_view("cliff")).expect("factors");
        let wrong = count(&rows, &[CHANGE], 7, |table| told(table).sure);
        assert!(wrong <= TABLES / 20, "{wrong} of {TABLES} tables have a resolve that removes or adds change by chance");
        let text = told(&table_of(16, &rows.iter().map(|row| (row.clone(), vec![adds(1.0, 0.1)])).collect::<Vec<_>>())).sentence;
        assert!(text.starts_with("the run cannot tell whether a resolve removes added change on near-cliff"), "{text}");
    }

    #[test]
    fn one_choice_and_many_views() {
        assert_eq!(
            said(&[(variant("vt"), five([4.0, 0.05, 0.001, 0.0, NONE]))]),
            "vt has 4.0 fetches per pixel, RMSE 0.05 and added change 0.001 (flip rate 0, clumping not measured)."
        );
        let view = |name: &str, fetches: f64| (base(name), five([fetches, 0.05, NONE, NONE, NONE]));
        assert_eq!(
            said(&[view("a", 4.0), view("b", 5.0)]),
            "In view a, auto has 4.0 fetches per pixel and RMSE 0.05; in view b, auto has 5.0 fetches per pixel and RMSE 0.05."
        );
        let many = |names: &[&str]| said(&names.iter().map(|&name| view(name, 4.0)).collect::<Vec<_>>());
        assert!(many(&["a", "b", "c", "d", "e"]).ends_with("; 2 more views are in the table."), "{}", many(&["a", "b", "c", "d", "e"]));
        assert!(many(&["a", "b", "c", "d"]).ends_with("; one more view is in the table."));
        // No number of the run can be used.
        assert!(said(&[(base("a"), vec![("terrain", 1.0, None)])]).starts_with("No row of this run"));
    }

    #[test]
    fn views_agree_or_differ() {
        let of = |view: &str, hashed: f64, white: f64| {
            [("hashed", hashed), ("white", white)]
                .map(|(name, value)| (Row { noise: name.to_owned(), ..base(view) }, vec![adds(value, 0.00005)]))
        };
        let all = [of("a", 0.0012, 0.0048), of("b", 0.0010, 0.0030), of("c", 0.0040, 0.0010)].concat();
        assert_eq!(
            first(&all),
            "In view a, hashed noise adds the least change in motion: 0.00120 \u{b1} 0.00011 a frame with automatic choice, against 0.00480 \u{b1} 0.00011 \
             with white noise; the same holds in view b (0.00100 \u{b1} 0.00011 against 0.00300 \u{b1} 0.00011); in view c, white noise adds the least \
             change in motion (0.00100 \u{b1} 0.00011 against 0.00400 \u{b1} 0.00011)."
        );
        // The view that decides the question comes first.
        let unclear = [of("a", 0.0012, 0.0013), of("b", 0.0010, 0.0030)].concat();
        assert!(first(&unclear).starts_with("In view b, hashed noise adds the least change"), "{}", first(&unclear));
        assert!(
            first(&unclear).contains("; in view a, the run cannot tell which noise adds the least change in motion (added change"),
            "{}",
            first(&unclear)
        );
    }
}

//! Answers the question of a run in one sentence, which is built from the numbers of the run. The form of the sentence depends on which column
//! varies.

use super::numbers::{CONFIDENCE_95, number, speed, with_interval};
use super::summary::{CLUMPING, FETCHES, FLICKER, FLIPS, Metric, REJECTIONS, SHADING, Summary, TILE_FETCHES, Table};

/// Limits of the number of items in a list: for a run with one view, and for a run with several views.
const LISTED: usize = 5;
const LISTED_OF_VIEWS: usize = 3;
/// Relative changes that are smaller than this count as no change.
const SMALL: f64 = 0.02;
/// Limit of the number of views that the sentence describes.
const VIEWS: usize = 3;

/// The form of the sentence. It is named after the column whose values the sentence compares.
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
    /// Selects the form of the sentence. If several columns vary, a varied parameter has priority, because its effect is the question of the run.
    /// Temporal resolves, estimators, variants and noises follow in this order.
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

/// Returns the answer as one sentence. If there are several views, the sentence has a part for each view.
pub(super) fn verdict(table: &Table) -> String {
    let shape = Shape::of(table);
    let said: Vec<(&String, String)> = table.views.iter().filter_map(|view| Some((view, of_view(table, shape, view)?))).collect();
    if said.is_empty() {
        return "No row of this run holds a cost, an error or a flicker, so there is nothing to compare.".to_owned();
    }
    let mut parts: Vec<String> = said
        .iter()
        .take(VIEWS)
        .map(|(view, text)| if table.views.len() > 1 { format!("in view {view}, {text}") } else { text.clone() })
        .collect();
    if said.len() > VIEWS {
        parts.push(format!("{} more views are in the table", said.len() - VIEWS));
    }
    // Each view has its own line.
    let sentence = parts.join(";\n");
    let mut letters = sentence.chars();
    // If the sentence begins with the name of a variant or resolve, the first letter stays in lower case, because users type these names in lower
    // case.
    let first_word = sentence.split([' ', ',', '\n']).next().unwrap_or_default();
    let named = table.variants.iter().chain(&table.temporal).any(|v| v == first_word);
    match letters.next() {
        Some(first) if !named => format!("{}{}.", first.to_uppercase(), letters.as_str()),
        _ => format!("{sentence}."),
    }
}

fn of_view(table: &Table, shape: Shape, view: &str) -> Option<String> {
    let rows = table.of_view(view);
    match shape {
        Shape::Parameter => parameter(table, &rows),
        Shape::Temporal => temporal(table, &rows),
        Shape::Estimators => estimators(table, &rows),
        Shape::Variants => variants(table, &rows),
        Shape::Noises => noises(table, &rows),
        Shape::One => rows.first().and_then(|&i| one(table, &table.summaries[i])),
    }
}

/// Formats a value with the name of its metric.
fn say(metric: Metric, value: f64) -> String {
    if metric == FETCHES || metric == TILE_FETCHES {
        format!("{value:.1} {}", metric.words)
    } else {
        format!("{} {}", metric.words, number(value))
    }
}

/// Returns the cost, error and flicker of a choice as text. Values that are not known are omitted.
fn price(table: &Table, summary: &Summary) -> String {
    let parts = [table.cost, table.error, FLICKER].into_iter().filter(|m| !summary.value(*m).is_nan());
    parts
        .map(|m| if m == FETCHES || m == TILE_FETCHES { format!("{:.1} fetches", summary.value(m)) } else { say(m, summary.value(m)) })
        .collect::<Vec<_>>()
        .join(", ")
}

/// Returns the flip rate and the clumping of a choice as text. Fewer flips often cause more clumping, so a sentence always gives both.
fn flips_and_clumping(summary: &Summary) -> String {
    let said = |metric: Metric| {
        let value = summary.value(metric);
        if value.is_nan() { format!("{} not measured", metric.words) } else { say(metric, value) }
    };
    format!("{}, {}", said(FLIPS), said(CLUMPING))
}

/// Returns the limit of the number of items in a list, which depends on the number of views.
fn listed(table: &Table) -> usize {
    if table.views.len() > 1 { LISTED_OF_VIEWS } else { LISTED }
}

/// Selects a subject, and returns all rows for which `same` holds in comparison with the subject, including the subject. The subject is the first row
/// of the variant `auto`. If there is none, it is the first stochastic choice. If there is no stochastic choice either, it is the first row.
fn subject(table: &Table, rows: &[usize], same: fn(&Summary, &Summary) -> bool) -> Vec<usize> {
    let of = |i: usize| &table.summaries[i];
    let chosen = rows.iter().copied().find(|&i| of(i).key.variant == "auto");
    let by_chance = || rows.iter().copied().find(|&i| of(i).is_stochastic());
    let Some(first) = chosen.or_else(by_chance).or(rows.first().copied()) else { return Vec::new() };
    rows.iter().copied().filter(|&i| same(of(first), of(i))).collect()
}

/// Joins the items to a list. If there are more than `most` items, only `most` items are written, which always include the first and the
/// last one. `most` must be at least 2.
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

/// Returns the rows with the smallest and the largest value of a metric; `None` if no row has a finite value.
fn extremes(table: &Table, rows: &[usize], metric: Metric) -> Option<(usize, usize)> {
    let mut known: Vec<usize> = rows.iter().copied().filter(|&i| table.summaries[i].value(metric).is_finite()).collect();
    // If several rows have equal values, the row that comes first in the definition is returned, because the sort is stable.
    known.sort_by(|&a, &b| table.summaries[a].value(metric).total_cmp(&table.summaries[b].value(metric)));
    let low = *known.first()?;
    let top = table.summaries[*known.last()?].value(metric);
    let high = known.iter().copied().find(|&i| table.summaries[i].value(metric) >= top)?;
    Some((low, high))
}

/// Returns the difference between the values of two rows, divided by the larger of their absolute values; 0 if both values are 0.
fn spread(table: &Table, (low, high): (usize, usize), metric: Metric) -> f64 {
    let (low, high) = (table.summaries[low].value(metric), table.summaries[high].value(metric));
    if high.abs().max(low.abs()) > 0.0 { (high - low) / high.abs().max(low.abs()) } else { 0.0 }
}

/// Returns a text for each choice on a front: its name with cost, error and flicker. Choices with equal variant, cost and error, which can differ in
/// noise for example, are combined into one text.
fn front_items(table: &Table, front: &[usize], name: impl Fn(&Summary) -> String) -> Vec<String> {
    let mut items: Vec<Vec<&Summary>> = Vec::new();
    for summary in front.iter().map(|&i| &table.summaries[i]) {
        let alike = |item: &&mut Vec<&Summary>| {
            let near = |m: Metric| (summary.value(m) - item[0].value(m)).abs() <= 1e-9 * summary.value(m).abs();
            summary.key.variant == item[0].key.variant && near(table.cost) && near(table.error)
        };
        match items.iter_mut().find(alike) {
            Some(item) => item.push(summary),
            None => items.push(vec![summary]),
        }
    }
    let words = |item: Vec<&Summary>| {
        let name = match item.len() {
            1 => name(item[0]),
            all if all == table.noises.len() => item[0].key.variant.clone(),
            some => format!("{} under {some} noises", item[0].key.variant),
        };
        let flicker = |pick: fn(f64, f64) -> f64| item.iter().map(|s| s.value(FLICKER)).reduce(pick).unwrap_or(f64::NAN);
        let (low, high) = (flicker(f64::min), flicker(f64::max));
        let more = if high - low > SMALL * high.abs().max(low.abs()) { format!(" to {}", number(high)) } else { String::new() };
        // The text of `price` ends with the flicker. `price` is called for the choice with the smallest flicker. Appending the largest
        // flicker then turns this number into a range.
        let least = item.iter().copied().find(|s| s.value(FLICKER) <= low).unwrap_or(item[0]);
        format!("{name} ({}{more})", price(table, least))
    };
    items.into_iter().map(words).collect()
}

fn variants(table: &Table, rows: &[usize]) -> Option<String> {
    let front = table.front(rows, table.cost, table.error);
    if front.is_empty() {
        return without_cost(table, rows);
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
    if let Some(auto) = rows.iter().map(|&i| &table.summaries[i]).find(|s| s.key.variant == "auto") {
        let against = |name: &str, words: &str| {
            let other =
                rows.iter().map(|&i| &table.summaries[i]).find(|s| s.key.variant == name && s.key.estimator == auto.key.estimator)?;
            Some(format!("{} {words}", speed(auto.value(SHADING), other.value(SHADING))?))
        };
        let speeds: Vec<String> =
            [against("splat", "full splat everywhere"), against("generic", "the generic kernel")].into_iter().flatten().collect();
        text += &format!("; automatic choice ({}) has {}", table.label(&auto.key), price(table, auto));
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

fn noises(table: &Table, rows: &[usize]) -> Option<String> {
    let rows = subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.estimator, &a.key.temporal, &a.key.setting)
            == (&b.key.variant, &b.key.estimator, &b.key.temporal, &b.key.setting)
    });
    let name = |i: usize| &table.summaries[i].key.noise;
    let variant = &table.summaries[*rows.first()?].key.variant;
    let mut text = format!("with {variant} and {} noises, ", rows.len());
    match (extremes(table, &rows, FLIPS), extremes(table, &rows, CLUMPING)) {
        (Some((steady, restless)), Some((even, _))) if steady != even => {
            let of = |i: usize| format!("{} ({})", name(i), flips_and_clumping(&table.summaries[i]));
            text += &format!("the fewest choices flip under {}, the noise that clumps least is {}", of(steady), of(even));
            if restless != even {
                text += &format!(", and the most choices flip under {}", of(restless));
            }
        }
        (Some((steady, _)), Some(_)) => {
            text += &format!("{} both flips and clumps least ({})", name(steady), flips_and_clumping(&table.summaries[steady]));
        }
        (Some((steady, _)), None) => {
            text += &format!("the fewest choices flip under {} ({})", name(steady), flips_and_clumping(&table.summaries[steady]))
        }
        (None, Some((even, _))) => {
            text += &format!("the noise that clumps least is {} ({})", name(even), flips_and_clumping(&table.summaries[even]))
        }
        (None, None) => {
            let (low, high) = extremes(table, &rows, table.error)?;
            let of = |i: usize| format!("{} ({})", name(i), say(table.error, table.summaries[i].value(table.error)));
            return Some(text + &format!("{} has the smallest error, and {} has the largest", of(low), of(high)));
        }
    }
    for metric in [FLICKER, table.error] {
        if let Some((low, high)) = extremes(table, &rows, metric) {
            let of = |i: usize| format!("{} ({})", number(table.summaries[i].value(metric)), name(i));
            text += &if spread(table, (low, high), metric) < SMALL {
                format!("; {} is {} with all noises", metric.words, number(table.summaries[low].value(metric)))
            } else {
                format!("; {} ranges from {} to {}", metric.words, of(low), of(high))
            };
        }
    }
    Some(text)
}

fn parameter(table: &Table, rows: &[usize]) -> Option<String> {
    let rows = subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.estimator, &a.key.temporal, &a.key.noise)
            == (&b.key.variant, &b.key.estimator, &b.key.temporal, &b.key.noise)
    });
    let name = |i: usize| &table.summaries[i].key.setting;
    let known: Vec<(Metric, (usize, usize))> =
        [FLIPS, CLUMPING, FLICKER, table.error, table.cost].into_iter().filter_map(|m| Some((m, extremes(table, &rows, m)?))).collect();
    let (moved, still): (Vec<_>, Vec<_>) = known.iter().copied().partition(|(m, ends)| spread(table, *ends, *m) >= SMALL);
    let key = &table.summaries[*rows.first()?].key;
    let with =
        if table.variants.len() > 1 || table.noises.len() > 1 { format!(" (with {}, {})", key.variant, key.noise) } else { String::new() };
    let head = format!("of {} values of {}{with}", rows.len(), table.parameter);
    let still_words = || still.iter().map(|(m, _)| m.words).collect::<Vec<_>>().join(", ");
    // The values of the parameter are ranked by the metric that changes the most. Clumping is used only if no other metric changes, because more
    // clumping is a side effect of fewer flips.
    let lead =
        moved.iter().copied().filter(|(m, _)| *m != CLUMPING).max_by(|a, b| spread(table, a.1, a.0).total_cmp(&spread(table, b.1, b.0)));
    let Some((metric, (best, worst))) = lead.or_else(|| moved.first().copied()) else {
        return (!known.is_empty()).then(|| format!("{head}, none changes {} by more than {:.0} %", still_words(), 100.0 * SMALL));
    };
    let of = |m: Metric, i: usize| with_interval(table.summaries[i].value(m), table.summaries[i].error(m));
    let mut text = format!(
        "{head}, {} has the smallest {} ({}, against {} at {})",
        name(best),
        metric.words,
        of(metric, best),
        of(metric, worst),
        name(worst)
    );
    let alike: Vec<&str> =
        rows.iter().copied().filter(|&i| i != best && are_alike(table, best, i, metric)).map(|i| name(i).as_str()).collect();
    if !alike.is_empty() {
        text += &format!(", whose 95 % interval overlaps with that at {}", alike.join(", "));
    }
    let others: Vec<String> = moved
        .iter()
        .filter(|(m, _)| *m != metric)
        .map(|&(m, (low, _))| {
            let here = table.summaries[best].value(m);
            if low == best {
                format!("{} is smallest there, too ({})", m.words, of(m, best))
            } else if here.is_nan() {
                format!("{} was not measured there", m.words)
            } else {
                format!("{} is {} there and smallest at {} ({})", m.words, of(m, best), name(low), of(m, low))
            }
        })
        .collect();
    if !others.is_empty() {
        text += &format!("; {}", others.join(", "));
    }
    if [FLIPS, FLICKER].contains(&metric) && extremes(table, &rows, CLUMPING).is_none() {
        text += "; clumping was not measured";
    }
    if !still.is_empty() {
        text += &format!("; the parameter changes {} by less than {:.0} %", still_words(), 100.0 * SMALL);
    }
    Some(text)
}

/// Whether the 95 % intervals of two values overlap.
fn are_alike(table: &Table, a: usize, b: usize, metric: Metric) -> bool {
    let (a, b) = (&table.summaries[a], &table.summaries[b]);
    match (a.error(metric), b.error(metric)) {
        (Some(x), Some(y)) => (a.value(metric) - b.value(metric)).abs() <= CONFIDENCE_95 * (x + y),
        _ => false,
    }
}

fn temporal(table: &Table, rows: &[usize]) -> Option<String> {
    let base = table.temporal.iter().find(|t| *t == "off").or(table.temporal.first())?;
    let key = |i: usize| {
        let k = &table.summaries[i].key;
        (k.variant.as_str(), k.estimator.as_str(), k.noise.as_str(), k.setting.as_str())
    };
    let mut parts = Vec::new();
    for resolve in table.temporal.iter().filter(|t| *t != base) {
        // If there are stochastic choices, deterministic choices are omitted. A resolve has no noise to remove from them, so they would
        // only widen the range of ratios.
        let pairs: Vec<(usize, usize)> = rows
            .iter()
            .copied()
            .filter(|&i| &table.summaries[i].key.temporal == resolve)
            .filter_map(|after| {
                Some((rows.iter().copied().find(|&i| &table.summaries[i].key.temporal == base && key(i) == key(after))?, after))
            })
            .collect();
        let by_chance: Vec<_> = pairs.iter().copied().filter(|(before, _)| table.summaries[*before].is_stochastic()).collect();
        let pairs = if by_chance.is_empty() { pairs } else { by_chance };
        let (mut moved, mut still) = (Vec::new(), Vec::new());
        for metric in [FLICKER, table.error, table.cost, FLIPS] {
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
    /// The metric changes by less than [`SMALL`].
    Still,
}

/// Describes how a metric changes from the first to the second row of each pair. For a single pair the text gives both values, for several pairs it
/// gives the range of ratios.
fn change(table: &Table, pairs: &[(usize, usize)], metric: Metric) -> Option<Change> {
    let ratio = |&(a, b): &(usize, usize)| table.summaries[b].value(metric) / table.summaries[a].value(metric);
    let mut known: Vec<&(usize, usize)> = pairs.iter().filter(|p| ratio(p).is_finite() && ratio(p) > 0.0).collect();
    known.sort_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    let (least, most) = (*known.first()?, *known.last()?);
    if [least, most].iter().all(|p| (ratio(p) - 1.0).abs() < SMALL) {
        return Some(Change::Still);
    }
    if pairs.len() == 1 {
        let of = |i: usize| with_interval(table.summaries[i].value(metric), table.summaries[i].error(metric));
        let times = number(ratio(least));
        return Some(Change::Moved(format!("{} from {} to {} (factor {times})", metric.words, of(least.0), of(least.1))));
    }
    let of = |p: &(usize, usize)| {
        let key = &table.summaries[p.1].key;
        let words = [(&table.variants, &key.variant), (&table.noises, &key.noise), (&table.estimators, &key.estimator)];
        let words: Vec<&str> = words.iter().filter(|(all, _)| all.len() > 1).map(|(_, v)| v.as_str()).collect();
        let [before, after] = [p.0, p.1].map(|i| number(table.summaries[i].value(metric)));
        format!("{} ({}: {before} to {after})", number(ratio(p)), words.join(", "))
    };
    if ratio(most) - ratio(least) < SMALL * ratio(most) {
        return Some(Change::Moved(format!("{} by a factor of {}", metric.words, number(ratio(least)))));
    }
    Some(Change::Moved(format!("{} by a factor of {} to {}", metric.words, of(least), of(most))))
}

fn estimators(table: &Table, rows: &[usize]) -> Option<String> {
    let rows = subject(table, rows, |a, b| {
        (&a.key.variant, &a.key.noise, &a.key.temporal, &a.key.setting) == (&b.key.variant, &b.key.noise, &b.key.temporal, &b.key.setting)
    });
    let front = table.front(&rows, table.cost, table.error);
    let base = &table.summaries[*rows.first()?];
    if front.is_empty() {
        return None;
    }
    let items: Vec<String> =
        front.iter().map(|&i| format!("{} ({})", table.summaries[i].key.estimator, price(table, &table.summaries[i]))).collect();
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
    let better: Vec<&str> = rows
        .iter()
        .map(|&i| &table.summaries[i])
        .filter(|s| s.value(table.cost) < base.value(table.cost) && s.value(table.error) < base.value(table.error))
        .map(|s| s.key.estimator.as_str())
        .collect();
    let own = format!("{} ({})", base.key.estimator, price(table, base));
    text += &if better.is_empty() {
        format!("; none is both cheaper and closer to the reference than {own}")
    } else {
        format!("; both cheaper and closer to the reference than {own}: {}", better.join(", "))
    };
    if let Some((low, _)) = extremes(table, &rows, FLICKER) {
        let steady = &table.summaries[low];
        text +=
            &format!("; {} flickers least ({}, {})", steady.key.estimator, say(FLICKER, steady.value(FLICKER)), flips_and_clumping(steady));
    }
    Some(text)
}

/// Names the choices with the smallest and the largest error. This is the sentence for views in which no cost was measured. If no error was measured
/// either, flicker is used instead.
fn without_cost(table: &Table, rows: &[usize]) -> Option<String> {
    let (metric, (low, high)) = [table.error, FLICKER].into_iter().find_map(|m| Some((m, extremes(table, rows, m)?)))?;
    let item = |i: usize| format!("{} ({})", table.label(&table.summaries[i].key), price(table, &table.summaries[i]));
    let what = format!("no cost was measured; by {},", metric.words);
    Some(if low == high {
        format!("{what} the only choice is {}", item(low))
    } else {
        format!("{what} the best choice is {}, and the worst is {}", item(low), item(high))
    })
}

fn one(table: &Table, summary: &Summary) -> Option<String> {
    let parts: Vec<String> = [table.cost, table.error, FLICKER]
        .into_iter()
        .filter(|m| !summary.value(*m).is_nan())
        .map(|m| match summary.error(m) {
            Some(_) => format!("{} {}", m.words, with_interval(summary.value(m), summary.error(m))),
            None => say(m, summary.value(m)),
        })
        .collect();
    if parts.is_empty() {
        return None;
    }
    let mut text = format!("{} has {}", summary.key.variant, list(&parts, LISTED));
    if !summary.value(FLIPS).is_nan() || !summary.value(CLUMPING).is_nan() {
        text += &format!(" ({})", flips_and_clumping(summary));
    }
    Some(text)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::report::fake::{self, Rows, base, definition};
    use crate::row::Row;

    /// Returns the verdict on a run with the given choices. Each choice consists of a row with its columns, and of five numbers: fetches, RMSE,
    /// flicker, flip rate and clumping (NaN = the number has no row).
    fn said(choices: &[(Row, [f64; 5])]) -> String {
        let mut rows = Rows::new();
        for (row, values) in choices {
            for (metric, value) in [("fetches_per_px", values[0]), ("rmse", values[1]), ("clumping", values[4])] {
                if !value.is_nan() {
                    rows.put(row, metric, "", value, None);
                }
            }
            for (metric, value) in [("flicker", values[2]), ("flip_rate", values[3])] {
                if !value.is_nan() {
                    rows.put(&Row { lag: Some(1), ..row.clone() }, metric, "", value, None);
                }
            }
        }
        verdict(&Table::of(&fake::run(definition("frames = 2\nvariants = [\"all\"]"), rows, Path::new("."))))
    }

    fn variant(name: &str) -> Row {
        Row { variant: name.to_owned(), ..base("cliff") }
    }

    const NONE: f64 = f64::NAN;

    #[test]
    fn variants_are_those_on_the_front() {
        let mut all = vec![
            (variant("vt"), [4.0, 0.05, 0.001, NONE, NONE]),
            (variant("splat"), [48.0, 0.01, 0.0, NONE, NONE]),
            (variant("near-cliff"), [50.0, 0.02, 0.01, NONE, NONE]),
        ];
        assert_eq!(
            said(&all),
            "Of 3 variants, 2 are Pareto-optimal in fetches per pixel and RMSE: vt (4.0 fetches, RMSE 0.05, flicker 0.001) and splat (48.0 fetches, \
             RMSE 0.01, flicker 0)."
        );
        // With fewer fetches, the third choice is no longer dominated, so it joins the front.
        all[2].1[0] = 12.0;
        assert!(said(&all).starts_with("Of 3 variants, 3 are Pareto-optimal"), "{}", said(&all));
        assert!(said(&all).contains("near-cliff (12.0 fetches, RMSE 0.02, flicker 0.01)"));
    }

    #[test]
    fn variants_without_a_cost_are_told_by_error_or_flicker() {
        let mut all = vec![(variant("vt"), [NONE, 0.05, 0.001, NONE, NONE]), (variant("splat"), [NONE, 0.01, 0.002, NONE, NONE])];
        assert_eq!(
            said(&all),
            "No cost was measured; by RMSE, the best choice is splat (RMSE 0.01, flicker 0.002), and the worst is vt (RMSE 0.05, flicker 0.001)."
        );
        all.iter_mut().for_each(|(_, values)| values[1] = NONE);
        assert_eq!(
            said(&all),
            "No cost was measured; by flicker, the best choice is vt (flicker 0.001), and the worst is splat (flicker 0.002)."
        );
    }

    #[test]
    fn automatic_choice_is_held_against_splat_and_generic() {
        let folder = Path::new(".");
        let text = verdict(&Table::of(&fake::variants(folder, &["cliff"], &["hashed"])));
        // The shading times are 3 + 1.1 x 17.3 ms for auto, 3 + 1.1 x 48 ms for splat, and 3 + 1.2 x 1.1 x 17.3 ms for generic.
        assert!(
            text.contains("its shading is 2.53 times as fast as full splat everywhere and 1.17 times as fast as the generic kernel"),
            "{text}"
        );
        // A list is shortened if the front has more choices than its limit. The number of omitted choices is given.
        assert!(text.contains("more between them"), "{text}");
        // A variant whose choices have equal numbers with all noises is named once.
        let text = verdict(&Table::of(&fake::variants(folder, &["cliff"], &fake::NOISES)));
        assert!(text.contains(": far-atlas (2.0 fetches, RMSE 0.102, flicker 0.000659), vt (4.0 fetches"), "{text}");
        // If the noise changes only the flicker, the range of the flicker is shown.
        assert!(text.contains("far-atlas+near-cliff+far-cliff (22.0 fetches, RMSE 0.0518, flicker 0.0118 to 0.0312)"), "{text}");
        assert!(text.contains("with auto and 6 noises"), "{text}");
    }

    #[test]
    fn noises_are_told_by_flips_and_clumping_together() {
        let noise = |name: &str| Row { noise: name.to_owned(), ..base("cliff") };
        let all = [
            (noise("hashed"), [10.0, 0.0500, 0.002, 0.1, 3.0]),
            (noise("blue"), [10.0, 0.0501, 0.004, 0.4, 0.5]),
            (noise("white"), [10.0, 0.0502, 0.005, 0.5, 1.0]),
        ];
        assert_eq!(
            said(&all),
            "With auto and 3 noises, the fewest choices flip under hashed (flip rate 0.1, clumping 3), the noise that clumps least is blue (flip rate 0.4, \
             clumping 0.5), and the most choices flip under white (flip rate 0.5, clumping 1); flicker ranges from 0.002 (hashed) to 0.005 (white); \
             RMSE is 0.05 with all noises."
        );
        // If one noise has both the fewest flips and the least clumping, it is named once.
        let mut both = all.clone();
        both[0].1[4] = 0.4;
        assert!(said(&both).contains("hashed both flips and clumps least (flip rate 0.1, clumping 0.4)"), "{}", said(&both));
        // There are as many variants as noises. The noises are compared, because no cost was measured.
        let mut more: Vec<_> = all
            .iter()
            .cloned()
            .chain(["splat", "near-cliff"].map(|v| (Row { variant: v.to_owned(), ..noise("hashed") }, all[0].1)))
            .collect();
        more.iter_mut().for_each(|l| l.1[0] = NONE);
        assert!(said(&more).starts_with("With auto and 3 noises"), "{}", said(&more));
        // Flips are always mentioned together with clumping, even if clumping was not measured.
        let mut lost = all.clone();
        lost.iter_mut().for_each(|l| l.1[4] = NONE);
        assert!(said(&lost).contains("hashed (flip rate 0.1, clumping not measured)"), "{}", said(&lost));
    }

    #[test]
    fn a_parameter_has_a_best_value_and_its_price() {
        let setting = |value: &str| Row {
            parameter: "blend.hash_scale".to_owned(),
            setting: value.to_owned(),
            noise: "hashed".to_owned(),
            ..base("cliff")
        };
        let mut all = vec![
            (setting("0.5"), [10.0, 0.05, 0.004, 0.6, 1.0]),
            (setting("1.0"), [10.0, 0.05, 0.003, 0.3, 2.0]),
            (setting("4.0"), [10.0, 0.0501, 0.001, 0.06, 8.0]),
        ];
        assert_eq!(
            said(&all),
            "Of 3 values of blend.hash_scale, 4.0 has the smallest flip rate (0.06, against 0.6 at 0.5); clumping is 8 there and smallest at 0.5 (1), \
             flicker is smallest there, too (0.001); the parameter changes RMSE, fetches per pixel by less than 2 %."
        );
        // The sentence begins with the metric that changes the most.
        all[0].1[0] = 1000.0;
        assert!(said(&all).contains("1.0 has the smallest fetches per pixel (10, against 1000 at 0.5)"), "{}", said(&all));
        // No metric changes.
        let still: Vec<_> = all.iter().map(|(row, _)| (row.clone(), [10.0, 0.05, NONE, NONE, NONE])).collect();
        assert_eq!(said(&still), "Of 3 values of blend.hash_scale, none changes RMSE, fetches per pixel by more than 2 %.");
    }

    #[test]
    fn values_within_chance_of_the_best_are_named() {
        let mut rows = Rows::new();
        for (setting, flips, error) in [("1", 0.30, 0.01), ("2", 0.31, 0.01), ("3", 0.5, 0.01)] {
            let row = Row { parameter: "p".to_owned(), setting: setting.to_owned(), lag: Some(1), ..base("cliff") };
            rows.put(&row, "flip_rate", "share", flips, Some(error));
        }
        let text = verdict(&Table::of(&fake::run(definition("frames = 2\nvariants = [\"auto\"]"), rows, Path::new("."))));
        assert!(
            text.contains("1 has the smallest flip rate (0.3 \u{b1} 0.0196, against 0.5 \u{b1} 0.0196 at 3), whose 95 % interval overlaps with that at 2"),
            "{text}"
        );
        assert!(text.ends_with("clumping was not measured."), "{text}");
    }

    #[test]
    fn a_resolve_is_held_against_none() {
        let row = |noise: &str, temporal: &str| Row { noise: noise.to_owned(), temporal: temporal.to_owned(), ..base("cliff") };
        let one = [(row("hashed", "off"), [10.0, 0.05, 0.004, 0.3, 1.0]), (row("hashed", "exponential"), [10.0, 0.03, 0.001, 0.3, 1.0])];
        assert_eq!(
            said(&one),
            "Compared with off, exponential changes flicker from 0.004 to 0.001 (factor 0.25), RMSE from 0.05 to 0.03 (factor 0.6) and changes fetches per \
             pixel, flip rate by less than 2 %."
        );
        let more = [(row("white", "off"), [10.0, 0.05, 0.004, 0.3, 1.0]), (row("white", "exponential"), [10.0, 0.05, 0.002, 0.3, 1.0])];
        let text = said(&[&one[..], &more[..]].concat());
        assert!(text.contains("changes flicker by a factor of 0.25 (hashed: 0.004 to 0.001) to 0.5 (white: 0.004 to 0.002), RMSE by a factor of 0.6 (hashed: 0.05 to 0.03) to 1 (white: 0.05 to 0.05)"), "{text}");
        // Ratios that are nearly equal are given as one number.
        let text = said(
            &[&one[..], &more.clone().map(|(row, [a, b, c, d, e])| (row, [a, b * if c < 0.003 { 0.6 } else { 1.0 }, c / 2.0, d, e]))]
                .concat(),
        );
        assert!(text.contains("RMSE by a factor of 0.6 and"), "{text}");
        // If no choice was measured both with and without the resolve, nothing can be compared.
        assert!(said(&[one[0].clone(), more[1].clone()]).starts_with("No row"), "no pair");
    }

    #[test]
    fn estimators_are_held_against_the_first() {
        let text = verdict(&Table::of(&fake::estimators(Path::new("."))));
        assert!(text.starts_with("With near-cliff, 5 of 8 estimators are Pareto-optimal in fetches per pixel and RMSE: one-tap (3.0 fetches, RMSE 0.08, flicker 0.031)"), "{text}");
        assert!(
            text.contains("both cheaper and closer to the reference than fc5 (12.0 fetches, RMSE 0.047, flicker 0.012): luna8;"),
            "{text}"
        );
        assert!(text.contains("exact flickers least (flicker 0.0006, flip rate 0.0054, clumping 1.3)"), "{text}");
    }

    #[test]
    fn one_choice_and_many_views() {
        assert_eq!(
            said(&[(variant("vt"), [4.0, 0.05, 0.001, 0.0, NONE])]),
            "vt has 4.0 fetches per pixel, RMSE 0.05 and flicker 0.001 (flip rate 0, clumping not measured)."
        );
        let view = |name: &str, fetches: f64| (base(name), [fetches, 0.05, NONE, NONE, NONE]);
        assert_eq!(
            said(&[view("a", 4.0), view("b", 5.0)]),
            "In view a, auto has 4.0 fetches per pixel and RMSE 0.05;\nin view b, auto has 5.0 fetches per pixel and RMSE 0.05."
        );
        let many: Vec<_> = ["a", "b", "c", "d", "e"].map(|v| view(v, 4.0)).into();
        assert!(said(&many).ends_with(";\n2 more views are in the table."), "{}", said(&many));
        // No number of the run can be used.
        assert!(said(&[(base("a"), [NONE; 5])]).starts_with("No row of this run"));
    }
}

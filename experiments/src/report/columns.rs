//! The content of a report: columns and cells of its table of choices (combinations of view, variant and settings), Pareto fronts, checks, and facts
//! about the set-up. If a number is missing, its cell gives the reason.

use std::collections::BTreeSet;

use kernels::frame::VariantChoice;
use kernels::shading::Estimator;
use kernels::shared::signal::Signal;
use kernels::temporal::{Resolve, SHARE};
use kernels::variant::{Flavour, Variant};

use super::RunData;
use super::checks::{self, Check, GoldenRow, Mark};
use super::numbers::{number, significant};
use super::summary::{
    ADDED, BIAS, BIAS_P, CLUMPING, DISOCCLUDED, EXACT_MSE, EXCESS, FETCHES, FLIP, FLIPS, Frames, INVALID, Key, KeyOf, LOST, Metric, NAMED,
    Of, PERCEIVED, PSNR, REJECTIONS, RESIDUAL, RESIDUAL_P95, RMSE, ReferenceFacts, SHADING, SSIM, Summary, THEORY, TILE_FETCHES, Table,
    VARIANCE,
};
use super::tested;
use crate::definition::{Definition, Times, Vary, setting_text, variant_choice};
use crate::metrics::{self, SHADING_TIME};
use crate::report::Verdict;
use crate::row::Row;

/// Where the numbers of a column come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    /// The value of a metric.
    Row(Metric),
    /// The value of a metric, shown with its standard error.
    WithError(Metric),
    /// The promised fetches of a forced variant: the sum over its flavours.
    Promised,
    /// The shading time, divided by that of the first timed choice of the view ([`Table::shading_base`]), with its interval. There is no interval if the
    /// two choices were not timed in the same rounds, or if the error of the ratio is not known.
    ShadingRatio,
}

/// A column of the table of choices.
#[derive(Clone, Copy, Debug)]
pub(super) struct Column {
    pub(super) heading: &'static str,
    unit: &'static str,
    pub(super) source: Source,
}

impl Column {
    /// Returns the text below the heading: the signal, if the metric depends on which signal the report shows, and the unit.
    pub(super) fn unit(&self, table: &Table) -> String {
        let signal = match self.source {
            Source::Row(metric) | Source::WithError(metric) if metric.of == Of::Shown => table.shown.name(),
            _ => "",
        };
        [signal, self.unit].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
    }
}

const COLUMNS: [Column; 22] = [
    Column { heading: "Fetches", unit: "per pixel", source: Source::Row(FETCHES) },
    Column { heading: "By tile", unit: "fetches", source: Source::Row(TILE_FETCHES) },
    Column { heading: "Promised", unit: "fetches", source: Source::Promised },
    Column { heading: "Shading", unit: "to first row", source: Source::ShadingRatio },
    Column { heading: "RMSE", unit: "", source: Source::Row(RMSE) },
    Column { heading: "FLIP", unit: "0 to 1", source: Source::Row(FLIP) },
    Column { heading: "PSNR", unit: "dB", source: Source::Row(PSNR) },
    Column { heading: "SSIM", unit: "same = 1", source: Source::Row(SSIM) },
    Column { heading: "Bias \u{b1} s.e.", unit: "albedo", source: Source::WithError(BIAS) },
    Column { heading: "Cancelling", unit: "probability", source: Source::Row(BIAS_P) },
    Column { heading: "Variance", unit: "albedo\u{b2}", source: Source::Row(VARIANCE) },
    Column { heading: "Exact MSE", unit: "albedo\u{b2}", source: Source::Row(EXACT_MSE) },
    Column { heading: "Theory", unit: "albedo\u{b2}", source: Source::Row(THEORY) },
    Column { heading: "Added", unit: "k = 1", source: Source::Row(ADDED) },
    Column { heading: "Lost", unit: "k = 1", source: Source::Row(LOST) },
    Column { heading: "Residual", unit: "k = 1", source: Source::Row(RESIDUAL) },
    Column { heading: "Residual p95", unit: "k = 1", source: Source::Row(RESIDUAL_P95) },
    Column { heading: "Perceived noise", unit: "", source: Source::Row(PERCEIVED) },
    Column { heading: "Flip rate", unit: "k = 1", source: Source::Row(FLIPS) },
    Column { heading: "Clumping", unit: "white = 1", source: Source::Row(CLUMPING) },
    Column { heading: "Rejected", unit: "of history", source: Source::Row(REJECTIONS) },
    Column { heading: "Excess difference", unit: "k = 1", source: Source::Row(EXCESS) },
];

/// The content of a table cell.
pub(super) enum Cell {
    /// The unrounded value, the text that the cell shows, and additional text for its tooltip.
    Value { value: f64, shown: String, hint: String },
    /// There is no number. The text gives the reason.
    Missing(String),
}

/// Returns the columns for which at least one row has a number, and the headings of the omitted columns.
pub(super) fn columns(run: &RunData, table: &Table) -> (Vec<Column>, Vec<&'static str>) {
    let (kept, dropped): (Vec<Column>, Vec<Column>) = COLUMNS
        .into_iter()
        .partition(|column| (0..table.summaries.len()).any(|index| matches!(cell(run, table, index, column.source), Cell::Value { .. })));
    // The column of promised fetches is only useful next to the column of counted fetches. If it is left out, the list of omitted columns does not
    // contain it.
    let measured = kept.iter().any(|c| c.source == Source::Row(FETCHES));
    let kept = kept.into_iter().filter(|c| c.source != Source::Promised || measured).collect();
    (kept, dropped.into_iter().filter(|c| c.source != Source::Promised).map(|c| c.heading).collect())
}

/// Returns the number of a row for a column, or the reason why it is missing.
pub(super) fn cell(run: &RunData, table: &Table, index: usize, source: Source) -> Cell {
    let summary = &table.summaries[index];
    let plain = |value: f64| Cell::Value { value, shown: significant(value), hint: String::new() };
    match source {
        Source::Row(metric) | Source::WithError(metric) => {
            let Some(found) = summary.number(metric).filter(|n| !n.value.is_nan()) else {
                return Cell::Missing(absent(run, summary, metric));
            };
            let error = summary.error(metric);
            let mut hint = format!("{} = {}{}", metric.name, found.value, unit(&found.unit));
            if let Some(error) = error {
                hint += &format!(", standard error {error}");
            }
            hint += &match found.frames {
                Frames::All => String::new(),
                Frames::One(frame) => format!(", frame {frame}"),
                Frames::Mean { finite, rows } => format!(", mean over {finite} of {rows} frames"),
            };
            if metric == PERCEIVED && !table.is_memory_filled {
                hint += ", too high for noise that changes in every frame, because the sequence is too short";
            }
            let shown = match (source, error) {
                (Source::WithError(_), Some(error)) => {
                    format!("{}{} \u{b1} {}", if found.value > 0.0 { "+" } else { "" }, significant(found.value), number(error))
                }
                _ => significant(found.value),
            };
            Cell::Value { value: found.value, shown, hint }
        }
        Source::Promised => match variant_choice(&summary.key.variant) {
            Ok(VariantChoice::Forced(_) | VariantChoice::GenericForced(_)) if !is_fc5(summary) => {
                Cell::Missing("promised fetches are compared for fc5 only".to_owned())
            }
            Ok(VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant)) => {
                plain(f64::from(variant.flavours().map(|flavour| promise(run, summary, flavour)).sum::<u32>()))
            }
            _ => Cell::Missing("tiles have different variants, so nothing is promised".to_owned()),
        },
        Source::ShadingRatio => match table.shading(index) {
            Some(shading) => {
                let mut hint = format!("{SHADING_TIME} = {} ms", table.shading_ms(index));
                if !shading.is_interleaved {
                    hint += ", measured in other rounds than the row by which it is divided, so its error is not known";
                } else if let Some(error) = shading.error {
                    hint = format!("{} = {}, standard error {error}; {hint}", SHADING.name, shading.ratio);
                }
                Cell::Value { value: shading.ratio, shown: shading.shown(), hint }
            }
            None => Cell::Missing(absent(run, summary, SHADING)),
        },
    }
}

fn unit(unit: &str) -> String {
    // The unit of dimensionless metrics is 1.
    if unit.is_empty() || unit == "1" { String::new() } else { format!(" {unit}") }
}

/// Returns the number of fetches that the flavour promises for the settings of this row, with the estimator fc5. If the settings enable two tilings,
/// splat takes twice as many.
fn promise(run: &RunData, summary: &Summary, flavour: Flavour) -> u32 {
    let definition = &run.definition;
    let value = |vary: &Vary| vary.values.iter().find(|value| setting_text(value) == summary.key.setting).cloned();
    let choices = definition.frame_settings(&definition.vary.as_ref().and_then(value));
    let twice = flavour == Flavour::Splat && choices.is_ok_and(|choices| choices.two_tilings);
    Estimator::Fc5.promised_fetches(flavour) * if twice { 2 } else { 1 }
}

/// Whether this row has the estimator fc5, with whose promises the report compares counted fetches. An empty estimator counts as fc5.
fn is_fc5(summary: &Summary) -> bool {
    summary.key.estimator.is_empty() || summary.key.estimator == "fc5"
}

/// Returns the reason why a row has no number of this metric.
fn absent(run: &RunData, summary: &Summary, metric: Metric) -> String {
    let definition = &run.definition;
    if let Some(found) = summary.number(metric) {
        return match found.frames {
            Frames::Mean { rows, .. } => format!("none of its {rows} frames has a finite value"),
            _ => "the value in its row is NaN".to_owned(),
        };
    }
    let first_noise = definition.noises.first().is_none_or(|n| *n == summary.key.noise);
    match metric {
        SHADING if definition.times == Times::None => "not timed: times = \"none\"".to_owned(),
        SHADING if definition.times == Times::FirstNoise && !first_noise => "timed with the first noise only".to_owned(),
        SHADING if summary.times().next().is_some() => "its ratio to other times was not measured".to_owned(),
        SHADING => "not timed".to_owned(),
        BIAS | BIAS_P | VARIANCE | EXACT_MSE | THEORY | CLUMPING if definition.seeds == 0 => "not measured: seeds = 0".to_owned(),
        REJECTIONS if !matches!(summary.key.temporal.as_str(), "" | "off") => "measured only without a resolve".to_owned(),
        BIAS_P if !is_fc5(summary) => "tested only where the mean should be the exact blend".to_owned(),
        BIAS_P if !summary.is_stochastic() => "no random choices".to_owned(),
        _ if needs_frames(metric) && definition.frames < 2 => "not measured: one frame".to_owned(),
        _ if !definition.metrics.is_empty() && !definition.metrics.iter().any(|m| m == metric.name) => {
            "not among the definition's metrics".to_owned()
        }
        _ => "no row of this metric".to_owned(),
    }
}

fn needs_frames(metric: Metric) -> bool {
    metrics::find(metric.name).is_some_and(|metric| metric.needs == metrics::Needs::Frames)
}

/// Returns the columns that distinguish choices: the heading, and a function that reads the value.
pub(super) fn key_columns(table: &Table) -> Vec<(&'static str, KeyOf)> {
    let all: [(&'static str, bool, KeyOf); 6] = [
        ("View", table.views.len() > 1, |s| &s.key.view),
        ("Variant", true, |s| &s.key.variant),
        ("Estimator", table.estimators.len() > 1, |s| &s.key.estimator),
        ("Noise", table.noises.len() > 1, |s| &s.key.noise),
        ("Temporal", table.temporal.len() > 1, |s| &s.key.temporal),
        ("Setting", table.settings.len() > 1 || !table.parameter.is_empty(), |s| &s.key.setting),
    ];
    all.into_iter().filter(|(_, shown, _)| *shown).map(|(name, _, of)| (name, of)).collect()
}

/// The position of a row relative to a Pareto front.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Standing {
    /// The row is neither on the front nor as good as a row on the front, or its cost or its error is not known.
    #[default]
    Beaten,
    /// The row is not on the front, but it is as good as a row on the front within chance.
    Alike,
    /// The row is on the front.
    On,
}

/// The position of a row relative to the two Pareto fronts of its view: cost against error, and cost against added change.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fronts {
    pub(super) error: Standing,
    pub(super) added: Standing,
}

impl Fronts {
    /// Whether the row is on at least one of the fronts.
    pub(super) fn is_on(self) -> bool {
        self.error == Standing::On || self.added == Standing::On
    }

    /// Returns the names of the fronts of the row. A name in brackets means that the row is not on this front, but as good within chance. Empty =
    /// none.
    pub(super) fn name(self) -> String {
        let word = |standing: Standing, name: &str| match standing {
            Standing::Beaten => None,
            Standing::Alike => Some(format!("({name})")),
            Standing::On => Some(name.to_owned()),
        };
        [word(self.error, "error"), word(self.added, "added")].into_iter().flatten().collect::<Vec<_>>().join(", ")
    }
}

/// Computes the Pareto fronts of each view, and returns the result for each row of the table.
pub(super) fn fronts(table: &Table) -> Vec<Fronts> {
    let mut fronts = vec![Fronts::default(); table.summaries.len()];
    for view in &table.views {
        let rows = table.of_view(view);
        let [error, added] = [table.error, ADDED].map(|metric| table.front(&rows, table.cost, metric));
        for &row in &rows {
            let standing = |on: bool, alike: bool| match (on, alike) {
                (true, _) => Standing::On,
                (false, true) => Standing::Alike,
                (false, false) => Standing::Beaten,
            };
            fronts[row].error = standing(error.contains(row), error.is_alike(row));
            fronts[row].added = standing(added.contains(row), added.is_alike(row));
        }
    }
    fronts
}

/// Compares the counted fetches of single flavours with their promises, for choices with the estimator fc5. Returns one row for each pair of view and
/// flavour. If several choices have this pair, a choice whose count disagrees with the promise takes precedence, and then the choice with the largest
/// deviation. A count of NaN disagrees. Choices without a count are left out.
pub(super) fn golden(run: &RunData, table: &Table) -> Vec<GoldenRow> {
    let counted = |s: &Summary| s.value(FETCHES);
    let flavours: Vec<(&Summary, Flavour, u32)> = table
        .summaries
        .iter()
        .filter(|s| s.key.is_flavour() && is_fc5(s) && s.number(FETCHES).is_some())
        .filter_map(|s| Some((s, s.key.variant.parse::<Variant>().ok()?.flavours().next()?)))
        .map(|(s, flavour)| (s, flavour, promise(run, s, flavour)))
        .collect();
    // If a flavour other than the virtual texture takes one fetch more than promised, the scene is assumed to have colour modulation
    // ([`GoldenRow::of`]).
    let is_one_more = |(s, flavour, promise): &&(&Summary, Flavour, u32)| {
        !matches!(flavour, Flavour::VirtualTexture | Flavour::FarAtlas) && (counted(s) - f64::from(*promise) - 1.0).abs() < 0.01
    };
    let modulated = flavours.iter().any(|f| is_one_more(&f));
    let mut rows: Vec<GoldenRow> = Vec::new();
    for (summary, flavour, promise) in flavours {
        let name = if table.views.len() > 1 { format!("{}, {}", flavour.name(), summary.key.view) } else { flavour.name().to_owned() };
        let row = GoldenRow::of(name, flavour, promise, counted(summary), modulated);
        let distance = |r: &GoldenRow| (!r.agrees, (r.counted - f64::from(promise)).abs());
        match rows.iter_mut().find(|r| r.flavour == row.flavour) {
            Some(known) if distance(&row) > distance(known) => *known = row,
            Some(_) => {}
            None => rows.push(row),
        }
    }
    rows
}

/// A check with its name. `None` = the run has nothing that could be checked.
type NamedCheck = (&'static str, Option<Check>);

/// Returns the checks of a run.
pub(super) fn checks(run: &RunData, table: &Table, verdicts: &[Verdict]) -> Vec<Check> {
    named_checks(run, table, verdicts).into_iter().filter_map(|(_, check)| check).collect()
}

/// Returns the remarks that the report shows beside the checks. Remarks neither pass nor fail.
pub(super) fn remarks(run: &RunData, table: &Table) -> Vec<String> {
    [tested::by_design(table), short_history(&run.definition), short_memory(run, table)].into_iter().flatten().collect()
}

/// Largest share of a history that may come from the first frame when measuring begins.
const OLDEST: f64 = 0.1;

/// Says that the histories of the run (the accumulated pictures of its temporal resolves) are not filled when measuring begins; `None` if they are,
/// or if there is no history. A history begins with the first frame, and each later frame multiplies the weight of earlier frames by 1 - [`SHARE`].
fn short_history(definition: &Definition) -> Option<String> {
    let resolves = definition.temporal.iter().filter(|name| name.parse::<Resolve>().is_ok_and(Resolve::has_history));
    let resolves: Vec<&str> = resolves.map(String::as_str).collect();
    // Without frames to warm up, the first measured change is that of frame 1.
    let first = definition.warm_up.max(1);
    let kept = 1.0 - f64::from(SHARE);
    let share = kept.powf(f64::from(first));
    let enough = (OLDEST.ln() / kept.ln()).ceil() as u32;
    (!resolves.is_empty() && definition.frames > 1 && share > OLDEST).then(|| {
        format!(
            "the history of {} begins empty: in frame {first}, the first whose changes are measured, {:.0} % of it comes from frame 0, so this start \
             is part of all numbers over frames; to leave it out, set `warm_up = {enough}` and `frames = {}`",
            resolves.join(" and "),
            100.0 * share,
            definition.sequence().measured() + enough
        )
    })
}

/// Says that the sequence is too short for perceived noise; `None` if it is long enough, or if perceived noise was not measured.
fn short_memory(run: &RunData, table: &Table) -> Option<String> {
    let is_measured = table.summaries.iter().any(|summary| summary.value(PERCEIVED).is_finite());
    let adaptation = run.definition.viewing.of_meter().adaptation();
    (is_measured && !table.is_memory_filled).then(|| {
        format!(
            "perceived noise is too high for noise that changes in every frame, and no sentence uses it: it needs {} frames at {} per second, and this run has \
             {}",
            run.definition.sequence().frames_to_fill(adaptation),
            number(table.frames_per_second),
            run.definition.frames
        )
    })
}

/// Largest mean share of disoccluded terrain pixels, whose surface point was not visible in the previous frame, for which the check [`followed`]
/// passes. If the share is larger, the check is unclear.
const MOST_HIDDEN: f64 = 0.5;

/// Checks that, in every view, at least half of the terrain pixels show a point that was visible in the previous frame; `None` if no frames were
/// compared.
fn followed(table: &Table) -> Option<Check> {
    let share = |view: &str| {
        let hidden = table.of_view(view).into_iter().map(|i| table.summaries[i].value(DISOCCLUDED)).filter(|hidden| hidden.is_finite());
        Some(1.0 - hidden.max_by(f64::total_cmp)?)
    };
    let shares: Vec<(&String, f64)> = table.views.iter().filter_map(|view| Some((view, share(view)?))).collect();
    let least = shares.iter().map(|(_, share)| *share).min_by(f64::total_cmp)?;
    let few: Vec<String> = shares
        .iter()
        .filter(|(_, share)| *share < 1.0 - MOST_HIDDEN)
        .map(|(view, share)| format!("{view}: {:.1} %", 100.0 * share))
        .collect();
    Some(if few.is_empty() {
        (
            Mark::Passes,
            format!("in every view, at least {:.0} % of the terrain pixels are followed from frame to frame", (100.0 * least).floor()),
        )
    } else {
        (
            Mark::Unclear,
            format!(
                "few terrain pixels can be followed from frame to frame ({}), so changes, flips and perceived noise say little: reduce the step of the \
                 motion",
                some_of(&few, few.len())
            ),
        )
    })
}

/// Returns all checks with their names.
pub(super) fn named_checks(run: &RunData, table: &Table, verdicts: &[Verdict]) -> [NamedCheck; 9] {
    let (biases, unbiased) = tested::biases(table);
    let (variances, adding) = tested::variances(table);
    let seeds = run.definition.seeds;
    let expected = expectations(run, verdicts);
    let met = expected.iter().filter(|v| v.met).count();
    let expected =
        (!expected.is_empty()).then(|| (Mark::of(met == expected.len()), format!("{met} of {} expectations are met", expected.len())));
    let judged: Vec<_> = table.references.iter().filter(|r| r.smallest_rmse.is_finite()).collect();
    let good = judged.iter().filter(|r| r.suffices()).count();
    let references = (!judged.is_empty()).then(|| {
        let words = "references have a standard error of at most a tenth of the smallest RMSE measured against them";
        let signals = if table.signals.len() > 1 { " (one for each signal)" } else { "" };
        let named = |r: &&&ReferenceFacts| {
            let error = if r.standard_error.is_finite() { number(r.standard_error) } else { "unknown".to_owned() };
            format!("{}: {error} against {}", place_of_reference(table, r), number(r.smallest_rmse))
        };
        let bad: Vec<String> = judged.iter().filter(|r| !r.suffices()).map(|r| named(&r)).collect();
        let cure = if bad.is_empty() {
            String::new()
        } else {
            format!(
                "; this does not hold for {}: raise `spp` and `max_spp` of `reference`, or leave errors out of `metrics`",
                some_of(&bad, bad.len())
            )
        };
        (Mark::of(good == judged.len()), format!("{good} of {} {words}{signals}{cure}", judged.len()))
    });
    let doubles = (table.doubles > 0)
        .then(|| (Mark::Fails, format!("rows that repeat a number of an earlier row, and are ignored: {}", table.doubles)));
    [
        ("expectations", expected),
        ("references", references),
        ("promises", checks::promises(&golden(run, table))),
        ("bias", checks::bias(&biases, unbiased, seeds)),
        ("variance", checks::variance(&variances, adding, seeds)),
        ("invalid", invalid(table)),
        ("followed", followed(table)),
        ("numbers", without_number(table)),
        ("doubles", doubles),
    ]
}

/// Names a reference by its view, the value of the varied parameter, and its signal.
fn place_of_reference(table: &Table, reference: &ReferenceFacts) -> String {
    let setting = if reference.setting.is_empty() { String::new() } else { format!(", {} = {}", table.parameter, reference.setting) };
    format!("{}{setting}, {}", reference.view, reference.signal.name())
}

/// Checks that the colours of all terrain pixels are finite; `None` if no choice and no reference has a count of pixels without a finite colour.
/// Metrics of colours leave such pixels out. If a choice has some, its metrics do not describe its whole picture.
fn invalid(table: &Table) -> Option<Check> {
    let mut counts: Vec<(String, f64)> = Vec::new();
    for reference in &table.references {
        counts.push((format!("reference, {}", place_of_reference(table, reference)), reference.invalid));
    }
    for summary in &table.summaries {
        let of = |&signal: &Signal| (format!("{}, {}", table.place(&summary.key), signal.name()), summary.value(INVALID.of(signal)));
        counts.extend(table.signals.iter().map(of));
    }
    counts.retain(|(_, count)| !count.is_nan());
    if counts.is_empty() {
        return None;
    }
    let named = |(place, count): &(String, f64)| format!("{place}: {}", number(*count));
    let found: Vec<String> = counts.iter().filter(|(_, count)| *count > 0.0).map(named).collect();
    if found.is_empty() {
        // Runs of earlier versions do not count such pixels in references.
        let counted = if table.references.iter().any(|reference| reference.invalid.is_finite()) { " and reference" } else { "" };
        return Some((Mark::Passes, format!("every pixel of every choice{counted} has a finite colour")));
    }
    let pictures = if found.len() == 1 { "sequence has" } else { "sequences have" };
    Some((
        Mark::Fails,
        format!(
            "{} {pictures} terrain pixels whose colour is not finite, which are left out of all metrics of colours: {}",
            found.len(),
            some_of(&found, found.len())
        ),
    ))
}

/// Checks that no row lacks its number; `None` if all have one.
fn without_number(table: &Table) -> Option<Check> {
    let (count, first) = &table.without_number;
    let words = |row: &Row| {
        let signal = if row.signal.is_empty() { String::new() } else { format!(" ({})", row.signal) };
        let lag = row.lag.map_or_else(String::new, |k| format!(", k = {k}"));
        let frame = row.frame.map_or_else(String::new, |frame| format!(", frame {frame}"));
        format!("{}{signal} of {}{lag}{frame}", row.metric, table.place(&Key::of(row)))
    };
    let found: Vec<String> = first.iter().map(words).collect();
    let (rows, are) = if *count == 1 { ("row holds", "is") } else { ("rows hold", "are") };
    (*count > 0).then(|| (Mark::Fails, format!("{count} {rows} no number (NaN) and {are} left out: {}", some_of(&found, *count))))
}

/// Joins the first [`NAMED`] items of a list that has `count` items in total.
fn some_of(items: &[String], count: usize) -> String {
    let shown = items.len().min(NAMED);
    let rest = if count > shown { format!("; and {} more", count - shown) } else { String::new() };
    items[..shown].join("; ") + &rest
}

/// Returns the names and values of facts about the set-up. If the manifest lacks one, its value is a dash and a note that says so, or the fact is
/// left out.
pub(super) fn facts(run: &RunData, table: &Table) -> Vec<(&'static str, String)> {
    let definition = &run.definition;
    let recorded = |key: &str| run.recorded(key).unwrap_or_else(|| "\u{2013} (not recorded in manifest.json)".to_owned());
    let software = if run.is_software() { " (software)" } else { "" };
    let scene = definition.scene.clone().or_else(|| definition.import.as_ref().map(|i| i.heightmap.clone()));
    let named: BTreeSet<&str> = table.summaries.iter().map(|s| s.key.scene.as_str()).filter(|s| !s.is_empty()).collect();
    let scene = scene.unwrap_or_else(|| "default".to_owned());
    let other_name = named.iter().any(|n| *n != scene);
    let scene = if other_name { format!("{scene} ({})", named.into_iter().collect::<Vec<_>>().join(", ")) } else { scene };
    let [width, height] = definition.size;
    let list = |values: &[String]| if values.len() > 12 { format!("{} in total", values.len()) } else { values.join(", ") };
    let mut facts = vec![
        ("Adapter", recorded("adapter") + software),
        ("Driver", recorded("driver")),
        ("Scene", scene),
        ("Views", list(&table.views)),
        ("Picture", format!("{width} \u{d7} {height} pixels")),
        (
            "Frames",
            match definition.warm_up {
                0 => definition.frames.to_string(),
                warm_up => format!("{}, of which the first {warm_up} are not measured", definition.frames),
            },
        ),
        (
            "Seeds",
            if definition.seeds == 0 { "none: neither bias nor variance is measured".to_owned() } else { definition.seeds.to_string() },
        ),
        ("Variants", list(&table.variants)),
        ("Estimators", list(&table.estimators)),
        ("Noises", list(&table.noises)),
        ("Temporal", list(&table.temporal)),
        ("Signals", signals(run, table)),
    ];
    if let Some(why) = run.recorded("without_anisotropy") {
        facts.push(("Filtering", why));
    }
    if !table.parameter.is_empty() {
        facts.push(("Varied", format!("{}: {}", table.parameter, table.settings.join(", "))));
    }
    if !definition.settings.is_empty() {
        facts.push(("Set", definition.settings.iter().map(|(key, value)| format!("{key} = {value}")).collect::<Vec<_>>().join(", ")));
    }
    facts.extend([
        ("Rows", format!("{} of metrics, {} of times", run.rows.len(), run.times.len())),
        ("Version", format!("{}, commit {}", recorded("version"), recorded("commit"))),
        ("Definition", format!("{}, hash {}", definition.name, recorded("definition_hash"))),
        (
            "Shards",
            match run.folders.len() {
                0 | 1 => run.recorded("shard").map(|shard| format!("{shard} alone")).unwrap_or_default(),
                joined => format!("{joined}, read together"),
            },
        ),
        ("Command", recorded("command")),
    ]);
    facts.retain(|(_, value)| !value.is_empty());
    facts
}

/// Describes the measured signals: their names and, where they matter, the signal that the report shows, the display settings of the lit picture, and
/// the viewing conditions of the perceived noise.
fn signals(run: &RunData, table: &Table) -> String {
    let names: Vec<&str> = table.signals.iter().map(|signal| signal.name()).collect();
    let mut text = names.join(", ");
    if names.len() > 1 {
        text += &format!("; shown: {}", table.shown.name());
    }
    if let (Signal::Lit, Ok(frame)) = (table.shown, run.definition.frame_settings(&None)) {
        let display = frame.stages.display;
        let parts = [
            ("frame.exposure", format!("exposure {} stops", display.exposure)),
            ("frame.tone_curve", format!("tone curve {}", display.tone_curve.name())),
        ];
        // A varied parameter has no single value. The line about the varied parameter lists its values.
        let fixed: Vec<String> = parts.into_iter().filter(|(key, _)| *key != table.parameter).map(|(_, words)| words).collect();
        text += &format!("; lit with {}", fixed.join(" and "));
    }
    if table.has(PERCEIVED) {
        let viewing = run.definition.viewing;
        text += &format!(
            "; perceived noise at {} frames per second and {} pixels per degree",
            viewing.frames_per_second, viewing.pixels_per_degree
        );
    }
    text
}

/// Returns the expectations with their verdicts. Expectations without a verdict are treated as not met.
pub(super) fn expectations(run: &RunData, verdicts: &[Verdict]) -> Vec<Verdict> {
    let judged = |claim: &str, metric: &str| verdicts.iter().any(|v| v.claim == claim && v.metric == metric);
    let open = run.definition.expectations.iter().filter(|e| !judged(&e.claim, &e.metric)).map(|e| Verdict {
        claim: e.claim.clone(),
        metric: e.metric.clone(),
        value: f64::NAN,
        range: e.range,
        met: false,
        why: "not judged".to_owned(),
    });
    verdicts.iter().cloned().chain(open).collect()
}

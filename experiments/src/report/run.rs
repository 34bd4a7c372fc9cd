//! Builds the HTML page of a run from its rows: answer, facts, plots, tables, pictures, and a section that says in which file each number is.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::Result;

use super::columns::{self, Cell, Column, Source};
use super::html::{self, BIAS_TERM, CHOICE_TERM, FETCHES_TERM, SOFTWARE_NOTE, VARIANCE_TERM, escape, mark};
use super::numbers::{LEVEL, number};
use super::plots::{self, COLOURS, Curve, CurvePoint, Hint, Lines, Marker, Point, Rgb, colour};
use super::summary::{ADDED, CLUMPING, FLIP, FLIPS, Key, KeyOf, LOST, Metric, Number, PERCEIVED, RMSE, SHADING, Summary, Table};
use super::{RunData, Verdict, pictures};
use crate::metrics::SHARED_PASSES;

/// Approximate limit of the size of a page, bytes. It determines how much space is left for pictures after the other sections. A page should be small
/// enough to be mailed: many mail servers refuse attachments that are a few times larger than this limit.
const PAGE_BYTES: usize = 8 << 20;
/// Limit of the number of curves in one plot. A reader could not distinguish more curves.
const CURVES: usize = COLOURS.len();

/// Returns the complete page.
///
/// # Errors
/// A plot cannot be drawn.
pub(super) fn page(run: &RunData, table: &Table, verdicts: &[Verdict], answer: &str) -> Result<String> {
    let name = &run.definition.name;
    let question = if run.definition.question.trim().is_empty() { name } else { &run.definition.question };
    let mut sections = vec![
        facts(run, table),
        pareto(run, table)?,
        parameter(run, table)?,
        lags(table)?,
        spectra(table)?,
        passes(run, table)?,
        promises(run, table),
        choices(run, table),
        references(table),
        provenance(table),
    ];
    let room = PAGE_BYTES.saturating_sub(sections.iter().map(String::len).sum());
    sections.insert(sections.len() - 1, pictures::sheets(&run.folders, room));
    let mut body = html::header(&format!("Scree \u{b7} experiment {name}"), question);
    body += &html::verdict(answer, &columns::checks(run, table, verdicts), &columns::remarks(run, table));
    body += &missing(run);
    body += &analysis(run);
    body += &expectations(run, verdicts);
    body += &contents(&sections);
    body += &sections.concat();
    Ok(html::page(&format!("Scree: {name}"), &body))
}

/// Returns a note that lists what the run still lacks; empty if the run is finished.
fn missing(run: &RunData) -> String {
    if run.missing.is_empty() {
        return String::new();
    }
    let lines: String = run.missing.iter().map(|line| format!("<li>{}</li>", escape(line))).collect();
    format!("<div class=\"note\"><b>This run is not complete.</b> Missing:<ul>{lines}</ul></div>\n")
}

/// Returns links to all sections that are not empty.
fn contents(sections: &[String]) -> String {
    let between = |text: &'_ str, from: &str, to: &str| -> Option<String> {
        let start = text.find(from)? + from.len();
        Some(text[start..start + text[start..].find(to)?].to_owned())
    };
    let link = |section: &String| {
        Some(format!("<a href=\"#{}\">{}</a>", between(section, "<section id=\"", "\"")?, between(section, "<h2>", "</h2>")?))
    };
    format!("<nav>{}</nav>\n", sections.iter().filter_map(link).collect::<Vec<_>>().join(" "))
}

fn analysis(run: &RunData) -> String {
    let prose = html::prose(&run.definition.analysis);
    let prose = if prose.is_empty() { "<p class=\"missing\">The definition has no analysis yet.</p>\n".to_owned() } else { prose };
    format!("<section id=\"analysis\"><h2>Analysis</h2>\n{prose}</section>\n")
}

fn expectations(run: &RunData, verdicts: &[Verdict]) -> String {
    let mut html = "<section id=\"expectations\"><h2>Expectations</h2>\n".to_owned();
    let expected = columns::expectations(run, verdicts);
    if expected.is_empty() {
        return html + "<p class=\"missing\">The definition states no expectation.</p></section>\n";
    }
    html += "<table class=\"expected\"><thead><tr><th></th><th>Claim</th><th>Metric</th><th class=\"n\">Value</th><th class=\"n\">Expected</th><th>How</th></tr></thead><tbody>\n";
    for verdict in expected {
        let word = if verdict.met { "met" } else { "not met" };
        html += &format!(
            "<tr><td class=\"{} nowrap\">{word}</td><td>{}</td><td>{}</td>{}<td class=\"n\">{} to {}</td><td>{}</td></tr>\n",
            mark(verdict.met),
            escape(&verdict.claim),
            escape(&verdict.metric),
            html::cell(verdict.value, &number(verdict.value), &verdict.why),
            number(verdict.range[0]),
            number(verdict.range[1]),
            escape(&verdict.why)
        );
    }
    html + "</tbody></table></section>\n"
}

fn facts(run: &RunData, table: &Table) -> String {
    let terms = [
        FETCHES_TERM,
        ("RMSE, FLIP, PSNR, SSIM", "errors of the last frame, seed 0, against the converged 96-fetch reference, over terrain pixels."),
        (
            "Albedo, lit",
            "the signal of a number: linear albedo before lighting, or the lit picture as a screen shows it. Errors and changes are those of the lit \
             picture if the run measures it. Bias, variance and clumping are always those of albedo, because their theory exists only there.",
        ),
        BIAS_TERM,
        VARIANCE_TERM,
        (
            "Flip rate",
            "share of surface points, followed by exact reprojection, whose random choice differs from their choice k frames earlier.",
        ),
        (
            "Added",
            "the part of a surface point's change in luminance since k frames earlier that the reference sequence does not have, such as noise; root \
             mean square.",
        ),
        (
            "Lost",
            "the part of the reference sequence's change that is missing, such as after a blur; root mean square; below 0, changes are exaggerated.",
        ),
        (
            "Residual",
            "mean absolute change of a surface point's error against the reference sequence; 0 only if the error moves with the surface. p95: the 95th \
             percentile.",
        ),
        (
            "Perceived noise",
            "the error against the reference sequence after the eye's filters in time, along the motion, and in space; root mean square.",
        ),
        (
            "Excess difference",
            "mean absolute change minus that of the reference sequence. Blur lowers it and noise raises it, so the two can cancel.",
        ),
        ("Clumping", "variance of block means, divided by that of white noise: 1 = white noise, above 1 = blotches, below 1 = blue noise."),
        (
            "Shading",
            "device time of the shading pass, divided by that of the first row, which was drawn in the same rounds; median over the rounds. Unstable: the \
             95 % interval is wider than \u{b1} 5 %, so the number takes part in no front and no sentence. Not interleaved: the two times were measured one \
             after the other, so the interval is not known, and the number takes part in no front and no sentence, either.",
        ),
        (
            "\u{b1}, bars and bands",
            "95 % confidence intervals, except in the column Bias; the interval of a shading time follows from the sorted ratios of the rounds; all other intervals follow from Student's t distribution; without an interval, the error is unknown.",
        ),
        CHOICE_TERM,
    ];
    format!(
        "<section id=\"facts\"><h2>What was measured, and how</h2>\n{}<div class=\"two\">{}{}</div></section>\n",
        if run.is_software() { SOFTWARE_NOTE } else { "" },
        html::facts(&columns::facts(run, table)),
        html::terms(&terms)
    )
}

/// Returns a section with one part for each view. The first part is open, and the others are collapsed. A view for which `part` returns `None` is
/// omitted. If all views are omitted, there is no section, and the result is empty.
fn per_view(table: &Table, id: &str, heading: &str, after: &str, part: impl Fn(&str) -> Result<Option<String>>) -> Result<String> {
    let mut parts = Vec::new();
    for view in &table.views {
        parts.extend(part(view)?.map(|html| (view, html)));
    }
    if parts.is_empty() {
        return Ok(String::new());
    }
    let mut html = format!("<section id=\"{id}\"><h2>{heading}</h2>\n");
    for (index, (view, part)) in parts.into_iter().enumerate() {
        let open = if index == 0 { " open" } else { "" };
        html += &if table.views.len() > 1 {
            format!("<details class=\"view\"{open}><summary>View {}</summary>\n{part}</details>\n", escape(view))
        } else {
            part
        };
    }
    Ok(html + after + "</section>\n")
}

/// Returns Python code that reads the numbers of a section from the files of the run. In this code, the variable `whole` is a table with the numbers
/// that the report uses, apart from times: one row for each choice, signal, metric, lag and frequency.
fn query(lines: &[&str]) -> String {
    const WHOLE: [&str; 7] = [
        "import pandas as pd",
        "m = pd.read_parquet(\"metrics.parquet\").fillna({\"lag\": 0, \"frequency\": 0})",
        "key = [\"scene\", \"view\", \"variant\", \"estimator\", \"noise\", \"temporal\", \"setting\"]",
        "at = key + [\"signal\", \"metric\", \"lag\", \"frequency\"]",
        "# use the row over all frames; if there is none, use the mean over the frames",
        "frames = m[m.frame.notna()].groupby(at, as_index=False)[[\"value\", \"standard_error\"]].mean()",
        "whole = pd.concat([m[m.frame.isna()], frames]).drop_duplicates(at)",
    ];
    let code = WHOLE.iter().chain(lines).copied().collect::<Vec<_>>().join("\n");
    format!("<details class=\"query\"><summary>These numbers in the files</summary><pre><code>{}</code></pre></details>\n", escape(&code))
}

/// Assigns colours to points and curves. The colour stands for the value of one column of the choice. Among setting, estimator, noise and
/// temporal resolve, this is the column with the largest number of different values.
struct Palette<'a> {
    values: &'a [String],
    of: KeyOf,
    ordered: bool,
}

impl<'a> Palette<'a> {
    fn of(table: &'a Table) -> Option<Palette<'a>> {
        let all: [(&[String], KeyOf); 4] = [
            (&table.settings, |s| &s.key.setting),
            (&table.estimators, |s| &s.key.estimator),
            (&table.noises, |s| &s.key.noise),
            (&table.temporal, |s| &s.key.temporal),
        ];
        let (values, of) = all.into_iter().rev().max_by_key(|(values, _)| values.len())?;
        let ordered = std::ptr::eq(values, table.settings.as_slice()) && numbers_of(values).is_some();
        (values.len() > 1).then_some(Palette { values, of, ordered })
    }

    fn colour(&self, summary: &Summary) -> Rgb {
        let index = self.values.iter().position(|v| v == (self.of)(summary)).unwrap_or(0);
        colour(index, self.values.len(), self.ordered)
    }

    /// Returns the legend of the values that occur in the given summaries.
    fn legend<'s>(&self, shown: impl Iterator<Item = &'s Summary>) -> String {
        let shown: Vec<&str> = shown.map(self.of).collect();
        self.values
            .iter()
            .enumerate()
            .filter(|(_, value)| shown.contains(&value.as_str()))
            .map(|(index, value)| html::key(colour(index, self.values.len(), self.ordered), value))
            .collect()
    }
}

/// Returns the values as numbers; `None` if a value is not a number.
fn numbers_of(values: &[String]) -> Option<Vec<f64>> {
    values.iter().map(|v| v.parse::<f64>().ok().filter(|v| v.is_finite())).collect()
}

/// Returns the half-width of the 95 % confidence interval of a choice's value of `metric`; 0 = unknown, or the value is exact.
fn half(summary: &Summary, metric: Metric) -> f64 {
    summary.half(metric).unwrap_or(0.0)
}

/// Returns the half-width of the 95 % confidence interval of a number; 0 = unknown.
fn half_of(found: &Number) -> f64 {
    found.half().unwrap_or(0.0)
}

/// Returns Python code that selects the rows without a signal and those of the signal that the report shows.
fn shown(table: &Table) -> String {
    format!("whole.signal.isin([\"\", \"{}\"])", table.shown.name())
}

/// Returns the value of a metric as it is drawn, and the half-width of its 95 % interval (0 = unknown, or the value is exact). The shading time is
/// drawn as its ratio to that of the base of the view ([`Table::shading_base`]).
fn value_and_half(table: &Table, index: usize, metric: Metric) -> (f64, f64) {
    match metric {
        SHADING => table.shading(index).map_or((f64::NAN, 0.0), |shading| (shading.ratio, shading.half_width())),
        _ => (table.summaries[index].value(metric), half(&table.summaries[index], metric)),
    }
}

/// Returns the tooltip of a point in a plot: the columns of the choice, and `words`, which gives the plotted values with the names of their metrics.
fn hint(table: &Table, index: usize, values: [f64; 2], words: &str) -> Option<Hint> {
    Some(Hint { words: format!("{}: {words}", table.summaries[index].key.words()), anchor: anchor(index), values })
}

/// Returns the HTML anchor of a choice's row in the table of all choices.
fn anchor(index: usize) -> String {
    format!("r{index}")
}

/// Formats a value as `metric = value`. If the metric has a lag, the lag is included.
fn named(metric: &str, lag: Option<u32>, value: f64) -> String {
    lag.map_or_else(|| format!("{metric} = {value}"), |k| format!("{metric} (k = {k}) = {value}"))
}

fn pareto(run: &RunData, table: &Table) -> Result<String> {
    let after = query(&[
        &format!(
            "whole[{} & whole.metric.isin([\"{}\", \"{}\", \"{}\"]) & (whole.lag <= 1)].pivot_table(\"value\", key, \"metric\")",
            shown(table),
            table.cost.name,
            table.error.name,
            ADDED.name
        ),
        "# for times, do the same with pd.read_csv(\"times.csv\", keep_default_na=False) and the metric \"gpu_ratio:shading\"",
    ]);
    per_view(table, "pareto", "Cost against error and added change", &after, |view| {
        let rows = table.of_view(view);
        let mut html = String::new();
        for cost in [table.cost, SHADING] {
            for error in [table.error, ADDED] {
                html += &pareto_plot(run, table, &rows, cost, error)?.unwrap_or_default();
            }
        }
        Ok((!html.is_empty()).then_some(html))
    })
}

fn pareto_plot(run: &RunData, table: &Table, rows: &[usize], cost: Metric, error: Metric) -> Result<Option<String>> {
    let palette = Palette::of(table);
    let front = table.front(rows, cost, error);
    let base = rows.first().and_then(|&i| table.shading_base(&table.summaries[i].key.view));
    let points: Vec<Point> = rows
        .iter()
        .map(|&index| {
            let summary = &table.summaries[index];
            let (x, half_x) = value_and_half(table, index, cost);
            let y = summary.value(error);
            let words = format!("{}, {}", named(cost.name, None, x), named(error.name, error.lag, y));
            Point {
                label: table.label(&summary.key),
                group: if table.variants.len() > 1 { summary.key.variant.clone() } else { table.label(&summary.key) },
                x,
                y,
                half: [half_x, half(summary, error)],
                marker: match summary.key.variant.as_str() {
                    "auto" if table.variants.len() > 1 => Marker::Auto,
                    "generic" if table.variants.len() > 1 => Marker::Generic,
                    _ if table.variants.len() == 1 || summary.key.is_flavour() => Marker::Flavour,
                    _ => Marker::Combination,
                },
                colour: palette.as_ref().map(|p| p.colour(summary)),
                front: front.contains(index),
                hint: hint(table, index, [x, y], &words),
            }
        })
        .collect();
    let x_title = match (cost, base) {
        (SHADING, _) => format!(
            "shading time, ratio to {}{} (logarithmic scale)",
            base.map_or_else(|| "a choice that is missing".to_owned(), |base| table.label(&table.summaries[base].key)),
            if run.is_software() { ", software adapter" } else { "" }
        ),
        _ => format!("{} (logarithmic scale)", cost.words),
    };
    let signal = table.shown.name();
    let y_title = match error {
        RMSE => format!("RMSE against the reference ({signal}, linear)"),
        FLIP => format!("FLIP against the reference ({signal}, 0 to 1)"),
        _ => format!("added change ({signal}, luminance, k = 1)"),
    };
    let title = format!("{} over {}, one point for each choice", error.words, cost.words);
    let legend = match &palette {
        None if table.variants.len() > 1 => plots::PARETO_LEGEND.to_owned(),
        None => String::new(),
        Some(palette) => format!(
            "{}<span class=\"entry\"><span class=\"key front\"></span>Pareto front</span> {}\
             A label with a number in brackets stands for that number of points close together. A grey or black point covers a point of another colour.",
            palette.legend(rows.iter().map(|&i| &table.summaries[i]).filter(|s| s.value(cost) > 0.0 && s.value(error).is_finite())),
            if table.variants.len() > 1 { "Large dots: one flavour; small: several; largest: auto; ring: generic. " } else { "" }
        ),
    };
    let rule = front_rule(table, rows, error);
    let left_out = if cost == SHADING { left_out_of_front(table, rows) } else { String::new() };
    Ok(plots::pareto(&points, &title, &x_title, &y_title)?.map(|svg| {
        html::figure(Some(svg), &format!("{legend} {rule}{left_out} Point at a mark to see its row; click it to go to the row."))
    }))
}

/// Says when a choice is on the front.
fn front_rule(table: &Table, rows: &[usize], error: Metric) -> String {
    if rows.iter().any(|&i| table.summaries[i].error(error).is_some()) {
        format!(
            "A choice is on the line if its {} is smaller than that of every cheaper choice on the line by more than chance explains ({:.0} % for all \
             choices together). In the table, brackets mark choices that are as good as one on the line, within chance.",
            error.words,
            100.0 * LEVEL
        )
    } else {
        format!(
            "No other choice is both cheaper and better than a choice on the line. The standard errors of {} are not known, so the values are compared \
             as they are.",
            error.words
        )
    }
}

/// Returns a note about the choices whose shading time is drawn, but takes no part in the front; empty if there are none.
fn left_out_of_front(table: &Table, rows: &[usize]) -> String {
    let (unstable, timed) = table.unstable(rows);
    let apart = rows.iter().filter_map(|&i| table.shading(i)).filter(|shading| !shading.is_interleaved).count();
    let mut note = String::new();
    if unstable > 0 {
        note += &format!(" {unstable} of {timed} times are unstable (95 % interval wider than \u{b1} 5 %) and take no part in the front.");
    }
    if apart > 0 {
        note += &format!(
            " {apart} times of other values of {} were not interleaved with the rest, and take no part in the front.",
            escape(&table.parameter)
        );
    }
    note
}

/// Groups summaries that differ only in the quantity on the horizontal axis, as decided by `same`. Each group becomes one curve. Summaries keep the
/// order of the table.
fn curves_of(table: &Table, rows: &[usize], same: fn(&Summary, &Summary) -> bool) -> Vec<Vec<usize>> {
    let mut curves: Vec<Vec<usize>> = Vec::new();
    for &index in rows {
        match curves.iter_mut().find(|c| same(&table.summaries[c[0]], &table.summaries[index])) {
            Some(curve) => curve.push(index),
            None => curves.push(vec![index]),
        }
    }
    curves
}

/// Reduces the curves to at most [`CURVES`], and also returns their original number. Curves of stochastic choices are preferred to curves of
/// deterministic choices. Within both kinds, automatic choices and choices of the generic kernel are preferred to single flavours, and single
/// flavours to combinations of flavours.
fn kept(table: &Table, mut curves: Vec<Vec<usize>>) -> (Vec<Vec<usize>>, usize) {
    let all = curves.len();
    if all > CURVES {
        let rank = |curve: &Vec<usize>| {
            let summary = &table.summaries[curve[0]];
            (!summary.is_stochastic(), summary.key.flavours().unwrap_or(0))
        };
        curves.sort_by_key(rank);
        curves.truncate(CURVES);
        curves.sort();
    }
    (curves, all)
}

/// Returns a note that says how many curves are shown; empty if all are shown.
fn left_out(kept: usize, all: usize) -> String {
    if all > kept { format!("{kept} of {all} choices are shown; the others are in the table. ") } else { String::new() }
}

fn parameter(run: &RunData, table: &Table) -> Result<String> {
    if table.settings.len() < 2 {
        return Ok(String::new());
    }
    let values = numbers_of(&table.settings);
    let ends = |v: &Vec<f64>| (v.iter().copied().fold(f64::MAX, f64::min), v.iter().copied().fold(f64::MIN, f64::max));
    let logarithmic = values.as_ref().map(ends).is_some_and(|(low, high)| low > 0.0 && high / low >= 30.0);
    let at = |setting: &str| match &values {
        Some(_) => setting.parse().unwrap_or(f64::NAN),
        None => table.settings.iter().position(|s| s == setting).map_or(f64::NAN, |i| i as f64),
    };
    let metrics: Vec<Metric> =
        [ADDED, LOST, PERCEIVED, FLIPS, CLUMPING, table.error, table.cost, SHADING].into_iter().filter(|m| table.has(*m)).collect();
    let after = query(&[
        "whole[whole.frequency == 0].pivot_table([\"value\", \"standard_error\"], [k for k in key if k != \"setting\"] + [\"metric\", \"signal\", \"lag\"], \"setting\")",
    ]);
    let heading = format!("Over the values of {}", escape(&table.parameter));
    per_view(table, "parameter", &heading, &after, |view| {
        let same = |a: &Summary, b: &Summary| {
            (&a.key.variant, &a.key.estimator, &a.key.noise, &a.key.temporal)
                == (&b.key.variant, &b.key.estimator, &b.key.noise, &b.key.temporal)
        };
        let (curves, all) = kept(table, curves_of(table, &table.of_view(view), same));
        let mut html = String::new();
        for metric in &metrics {
            let drawn: Vec<Curve> = curves
                .iter()
                .enumerate()
                .map(|(index, rows)| {
                    let mut points: Vec<CurvePoint> = rows
                        .iter()
                        .map(|&row| {
                            let summary = &table.summaries[row];
                            let x = at(&summary.key.setting);
                            let (y, half) = value_and_half(table, row, *metric);
                            let words = named(metric.name, metric.lag, y);
                            CurvePoint { x, y, half, hint: hint(table, row, [x, y], &words) }
                        })
                        .collect();
                    points.sort_by(|a, b| a.x.total_cmp(&b.x));
                    Curve { colour: colour(index, curves.len(), false), points }
                })
                .collect();
            let y_title = match *metric {
                SHADING => {
                    format!("shading time, ratio to {}", table.label(&table.summaries[table.shading_base(view).unwrap_or(0)].key))
                }
                m if m.lag.is_some() => format!("{} (k = 1)", m.words),
                CLUMPING => "clumping (white = 1)".to_owned(),
                m => m.words.to_owned(),
            };
            let plot = Lines {
                title: &format!("{} over {}", metric.words, table.parameter),
                x_title: &format!("{}{}", table.parameter, if logarithmic { " (logarithmic scale)" } else { "" }),
                y_title: &y_title,
                x_logarithmic: logarithmic,
                x_names: if values.is_none() { table.settings.clone() } else { Vec::new() },
                baseline: (*metric == CLUMPING).then_some((1.0, "white noise")),
                ..Lines::default()
            };
            html += &plots::lines(&drawn, &plot)?.map(|svg| html::figure(Some(svg), "")).unwrap_or_default();
        }
        if html.is_empty() {
            return Ok(None);
        }
        // The name of a curve contains the values of the columns that vary, except the varied parameter, which is on the horizontal axis.
        let name = |curve: &Vec<usize>| curve_name(table, curve[0], |key| key.setting.clear());
        let keys: String = curves.iter().enumerate().map(|(i, c)| html::key(colour(i, curves.len(), false), &name(c))).collect();
        let times = if table.has(SHADING) {
            " Times of different values are measured one after the other, so their differences contain a drift of the machine."
        } else {
            ""
        };
        let software = if run.is_software() && table.has(SHADING) { " Software adapter: only ratios of times are meaningful." } else { "" };
        Ok(Some(format!(
            "<div class=\"pair\">{html}</div><p class=\"legend\">{keys}{}Fewer flips often come with more clumping: read both numbers together.{times}{software}</p>\n",
            left_out(curves.len(), all)
        )))
    })
}

/// Returns the name of a curve: the values of those columns that vary within the run. `known` clears the columns that are already visible in the
/// plot.
fn curve_name(table: &Table, index: usize, known: impl Fn(&mut Key)) -> String {
    let mut key = table.summaries[index].key.clone();
    known(&mut key);
    let name = table.label(&key);
    if name.is_empty() { table.summaries[index].key.variant.clone() } else { name }
}

/// A variant whose noise is plotted in detail, and the choices that these plots show.
struct CloseUp {
    /// Heading of the plots.
    name: String,
    /// Row numbers of the choices that are shown (at most [`CURVES`]), each with its colour.
    choices: Vec<(usize, Rgb)>,
    /// Number of choices before the limit [`CURVES`] was applied.
    all: usize,
    /// Whether the variant has a close-up for each temporal resolve. The heading then contains the name of the resolve.
    resolved: bool,
}

impl CloseUp {
    /// Returns the name of a choice, without the columns that the heading already names.
    fn name_of(&self, table: &Table, row: usize) -> String {
        curve_name(table, row, |key| {
            key.variant.clear();
            if self.resolved {
                key.temporal.clear();
            }
        })
    }
}

/// Returns at most four close-ups of variants that use random numbers: automatic choices, variants that are forced with the generic kernel, and
/// single flavours. If the view has none of these, the variants with the fewest flavours are taken. If a variant has more choices than one plot can
/// show, and the run has several temporal resolves, the variant gets one close-up for each resolve.
fn close_ups(table: &Table, view: &str) -> Vec<CloseUp> {
    let mut variants: Vec<(usize, &str)> = Vec::new();
    let rows = table.of_view(view);
    for summary in rows.iter().map(|&i| &table.summaries[i]) {
        if summary.is_stochastic() && !variants.iter().any(|(_, v)| *v == summary.key.variant) {
            let rank = summary.key.flavours().unwrap_or_default();
            // `generic` gives the same picture as `auto`, so it is shown only if no other variant uses random numbers.
            variants.push((if summary.key.variant == "generic" { 9 } else { rank }, &summary.key.variant));
        }
    }
    variants.sort_by_key(|(rank, _)| *rank);
    let least = variants.first().map_or(0, |(rank, _)| *rank);
    variants.retain(|(rank, _)| *rank <= least.max(1));
    let mut all = Vec::new();
    for (_, variant) in variants {
        let of_variant: Vec<usize> = rows.iter().copied().filter(|&i| table.summaries[i].key.variant == variant).collect();
        if of_variant.len() <= CURVES || table.temporal.len() < 2 {
            all.push(close_up(table, variant.to_owned(), of_variant, false));
            continue;
        }
        for temporal in &table.temporal {
            let resolved = of_variant.iter().copied().filter(|&i| table.summaries[i].key.temporal == *temporal).collect();
            all.push(close_up(table, format!("{variant} \u{b7} {temporal}"), resolved, true));
        }
    }
    all.truncate(4);
    all
}

/// Returns a close-up that shows at most [`CURVES`] of the rows, each in its own colour. `resolved`: see [`CloseUp::resolved`].
fn close_up(table: &Table, name: String, rows: Vec<usize>, resolved: bool) -> CloseUp {
    let all = rows.len();
    let palette = Palette::of(table);
    // If there are too many rows, only one row is kept for each value of the palette's column.
    let rows: Vec<usize> = match &palette {
        Some(palette) if all > CURVES => {
            let mut seen: Vec<&str> = Vec::new();
            rows.into_iter()
                .filter(|&i| {
                    let value = (palette.of)(&table.summaries[i]);
                    let fresh = !seen.contains(&value);
                    seen.push(value);
                    fresh
                })
                .take(CURVES)
                .collect()
        }
        _ => rows.into_iter().take(CURVES).collect(),
    };
    // The colours of the palette are used only if each row has a different one.
    let alone =
        |p: &Palette<'_>, i: usize| rows.iter().filter(|&&j| (p.of)(&table.summaries[i]) == (p.of)(&table.summaries[j])).count() == 1;
    let named = palette.as_ref().filter(|p| rows.iter().all(|&i| alone(p, i)));
    let count = rows.len();
    let coloured = rows.iter().enumerate().map(|(k, &i)| {
        let own = named.map(|p| p.colour(&table.summaries[i]));
        (i, own.unwrap_or_else(|| colour(k, count, false)))
    });
    CloseUp { name, choices: coloured.collect(), all, resolved }
}

fn lags(table: &Table) -> Result<String> {
    let after = query(&[
        &format!("lags = whole[{} & whole.metric.isin([\"{}\", \"{}\", \"{}\"])]", shown(table), FLIPS.name, ADDED.name, LOST.name),
        "lags.pivot_table([\"value\", \"standard_error\"], [\"metric\"] + key, \"lag\")",
    ]);
    per_view(table, "lags", "Flips, added and lost change over k frames", &after, |view| {
        let mut html = String::new();
        for close_up in close_ups(table, view) {
            let CloseUp { name: variant, choices, all, .. } = &close_up;
            let mut plots_of_variant = String::new();
            for metric in [FLIPS, ADDED, LOST] {
                let curves: Vec<Curve> = choices
                    .iter()
                    .map(|&(row, colour)| {
                        let points = table.summaries[row].over_lags(metric).map(|(lag, found)| {
                            let (x, y) = (f64::from(lag), found.value);
                            CurvePoint { x, y, half: half_of(found), hint: hint(table, row, [x, y], &named(metric.name, Some(lag), y)) }
                        });
                        Curve { colour, points: points.collect() }
                    })
                    .collect();
                let plot = Lines {
                    title: &format!("{} over k, {variant}", metric.words),
                    x_title: "k, number of frames between the two compared frames",
                    y_title: metric.words,
                    x_whole: true,
                    ..Lines::default()
                };
                plots_of_variant += &plots::lines(&curves, &plot)?.map(|svg| html::figure(Some(svg), "")).unwrap_or_default();
            }
            if plots_of_variant.is_empty() {
                continue;
            }
            let keys: String = choices
                .iter()
                .map(|&(row, colour)| {
                    let clumping = table.summaries[row].value(CLUMPING);
                    let clumping =
                        if clumping.is_nan() { "clumping not measured".to_owned() } else { format!("clumping {}", number(clumping)) };
                    html::key(colour, &format!("{} ({clumping})", close_up.name_of(table, row)))
                })
                .collect();
            html += &format!(
                "<h3>{}</h3><div class=\"pair\">{plots_of_variant}</div><p class=\"legend\">{keys}{}</p>\n",
                escape(variant),
                left_out(choices.len(), *all)
            );
        }
        Ok((!html.is_empty()).then_some(html))
    })
}

fn spectra(table: &Table) -> Result<String> {
    let after = query(&["whole[whole.metric == \"power\"].pivot_table(\"value\", \"frequency\", key)"]);
    per_view(table, "spectra", "Spectra of the noise", &after, |view| {
        let mut html = String::new();
        for close_up in close_ups(table, view) {
            let CloseUp { name: variant, choices, all, .. } = &close_up;
            let curves: Vec<Curve> = choices
                .iter()
                .map(|&(row, colour)| {
                    let points = table.summaries[row].spectrum.iter().map(|(frequency, found)| {
                        let (x, y) = (*frequency, found.value);
                        let words = format!("power at {x} cycles per pixel = {y}");
                        CurvePoint { x, y, half: half_of(found), hint: hint(table, row, [x, y], &words) }
                    });
                    Curve { colour, points: points.collect() }
                })
                .collect();
            let plot = Lines {
                title: &format!("radial power, {variant}"),
                x_title: "frequency, cycles per pixel",
                y_title: "power (white = 1, logarithmic)",
                y_logarithmic: true,
                baseline: Some((1.0, "white noise")),
                ..Lines::default()
            };
            let Some(svg) = plots::lines(&curves, &plot)? else { continue };
            let keys: String = choices.iter().map(|&(row, colour)| html::key(colour, &close_up.name_of(table, row))).collect();
            let white = "<span class=\"entry\"><span class=\"key dashed\"></span>white noise</span>";
            let figure = html::figure(Some(svg), &format!("{keys}{white} {}", left_out(choices.len(), *all)));
            html += &format!("<div><h3>{}</h3>{figure}</div>", escape(variant));
        }
        Ok((!html.is_empty()).then(|| format!("<div class=\"pair\">{html}</div>\n")))
    })
}

fn passes(run: &RunData, table: &Table) -> Result<String> {
    const BARS: usize = 10;
    let after = "<details class=\"query\"><summary>These numbers in the files</summary><pre><code>import pandas as pd\n\
         t = pd.read_csv(\"times.csv\", keep_default_na=False)\nt[t.metric.str.startswith(\"gpu_ms:\")]</code></pre></details>\n";
    per_view(table, "passes", "Time per pass", after, |view| {
        let timed: Vec<usize> = table.of_view(view).into_iter().filter(|&i| table.summaries[i].times().next().is_some()).collect();
        let leading: Vec<usize> = timed.iter().copied().filter(|&i| table.summaries[i].key.flavours().is_none_or(|n| n == 1)).collect();
        let shown = if leading.is_empty() || timed.len() <= BARS { &timed } else { &leading };
        // All variants that are timed in the same rounds share geometry and occlusion culling, whose times are stored with only one of them. Choices
        // with the same setting, estimator and noise were timed in the same rounds, so the times of the shared passes are taken from one of these.
        let shared = |pass: &str, key: &Key| {
            let rounds = |key: &Key| (key.setting.clone(), key.estimator.clone(), key.noise.clone());
            let of_rounds = timed.iter().map(|&i| &table.summaries[i]).filter(|summary| rounds(&summary.key) == rounds(key));
            of_rounds.flat_map(Summary::times).find(|(other, _)| *other == pass).map(|(_, n)| (pass.to_owned(), n.value))
        };
        let rows: Vec<(String, BTreeMap<String, f64>)> = shown
            .iter()
            .take(BARS)
            .map(|&i| {
                let word = if table.shading(i).is_some_and(|shading| shading.is_unstable()) { " (unstable)" } else { "" };
                let label = table.label(&table.summaries[i].key) + word;
                let of_geometry = SHARED_PASSES.into_iter().filter_map(|pass| shared(pass, &table.summaries[i].key));
                let own = table.summaries[i].times().map(|(pass, n)| (pass.to_owned(), n.value));
                (label, of_geometry.chain(own).collect())
            })
            .collect();
        if rows.is_empty() {
            return Ok(None);
        }
        let rest = timed.len() - rows.len();
        let more = if rest > 0 { format!("<p class=\"legend\">{rest} more timed choices are in the files.</p>\n") } else { String::new() };
        Ok(Some(plots::passes(&rows, run.is_software())? + &more))
    })
}

fn promises(run: &RunData, table: &Table) -> String {
    let golden = columns::golden(run, table);
    if golden.is_empty() { String::new() } else { html::promises(&golden) }
}

/// Returns the section with the table of all choices.
fn choices(run: &RunData, table: &Table) -> String {
    let keys = columns::key_columns(table);
    let (shown, dropped) = columns::columns(run, table);
    let fronts = columns::fronts(table);
    let units: Vec<String> = shown.iter().map(|column| column.unit(table)).collect();
    let attributes = |column: &Column| match column.source {
        Source::Row(m) | Source::WithError(m) => {
            let signal = table.summaries.first().map_or("", |summary| summary.signal(m));
            let lag = m.lag.map_or_else(String::new, |k| format!(" data-lag=\"{k}\""));
            let words = [signal.to_owned(), m.lag.map_or_else(String::new, |k| format!("lag {k}"))];
            let words: String = words.iter().filter(|word| !word.is_empty()).map(|word| format!(", {word}")).collect();
            format!(" data-metric=\"{}\" data-signal=\"{signal}\"{lag} title=\"{}{words}\"", m.name, m.name)
        }
        Source::Promised => " title=\"sum over the variant's flavours\"".to_owned(),
        Source::ShadingRatio => {
            format!(" data-metric=\"{}\" title=\"gpu_ms:shading, divided by that of the view's first timed row\"", SHADING.name)
        }
    };
    let mut html =
        "<section id=\"choices\"><h2>All choices</h2>\n<p>Click a heading to sort. The column Front shows on which \
         Pareto fronts of its view a row lies: cost against error, cost against added change. Such a row also has a mark on the left. A name in brackets \
         means that the row is not on that front, but as good as a row that is, within chance.</p>\n"
            .to_owned();
    if table.summaries.len() > 12 {
        html += "<p><label>Show rows with <input class=\"filter\" type=\"search\" placeholder=\"near-cliff hashed\"></label> <span class=\"count\"></span></p>\n";
    }
    html += "<div class=\"scroll\"><table class=\"all\">";
    html += &html::head(
        keys.iter()
            .map(|(name, _)| (*name, "", false, String::new()))
            .chain([("Front", "", false, String::new())])
            .chain(shown.iter().zip(&units).map(|(c, unit)| (c.heading, unit.as_str(), true, attributes(c)))),
    );
    html += "<tbody>\n";
    let forced = table.summaries.iter().any(|s| s.key.flavours().is_some());
    let mut reasons: Vec<(&str, String)> = Vec::new();
    for (index, summary) in table.summaries.iter().enumerate() {
        let class = match (forced && summary.key.flavours().is_none(), fronts[index].is_on()) {
            (false, false) => "",
            (false, true) => " class=\"front\"",
            (true, false) => " class=\"chosen\"",
            (true, true) => " class=\"chosen front\"",
        };
        let data: String = summary.key.columns().iter().map(|(name, value)| format!(" data-{name}=\"{}\"", escape(value))).collect();
        html += &format!("<tr id=\"{}\"{class}{data} title=\"{}\">", anchor(index), escape(&summary.key.words()));
        for (_, of) in &keys {
            html += &format!("<td>{}</td>", escape(of(summary)));
        }
        html += &format!("<td>{}</td>", fronts[index].name());
        for column in &shown {
            html += &match columns::cell(run, table, index, column.source) {
                Cell::Value { value, shown, hint } => html::cell(value, &shown, &hint),
                Cell::Missing(reason) => {
                    let cell = html::cell(f64::NAN, "", &reason);
                    if !reasons.iter().any(|(heading, known)| *heading == column.heading && *known == reason) {
                        reasons.push((column.heading, reason));
                    }
                    cell
                }
            };
        }
        html += "</tr>\n";
    }
    html += "</tbody></table></div>\n";
    if !reasons.is_empty() {
        let words: Vec<String> = reasons.iter().map(|(heading, reason)| escape(&format!("{heading}: {reason}"))).collect();
        html += &format!("<p class=\"legend\">A dash means that there is no number. {}.</p>\n", words.join("; "));
    }
    if !dropped.is_empty() {
        html += &format!("<p class=\"legend\">Columns without any number: {}.</p>\n", dropped.join(", "));
    }
    html += &query(&["whole[whole.frequency == 0].pivot_table(\"value\", key, [\"metric\", \"signal\", \"lag\"])"]);
    html + "</section>\n"
}

fn references(table: &Table) -> String {
    if table.references.is_empty() {
        return String::new();
    }
    let with_setting = table.references.iter().any(|r| !r.setting.is_empty());
    let setting = if with_setting { "<th>Setting</th>" } else { "" };
    let resolves: BTreeSet<&String> = table.references.iter().flat_map(|r| r.differences.keys()).collect();
    let differences: String = resolves
        .iter()
        .map(|resolve| {
            let of = if resolve.is_empty() { String::new() } else { format!(", {resolve}") };
            format!("<th class=\"n\">Difference, k = 1{}</th>", escape(&of))
        })
        .collect();
    let mut html = format!(
        "<section id=\"references\"><h2>References</h2>\n<p>Errors are measured against the supersampled 96-fetch blend. Its standard error must be \
         at most a tenth of the smallest RMSE measured against it. The differences are those of the reference sequence: luminance of surface points, \
         between consecutive frames. With a temporal resolve, the reference sequence passes through the same resolve.</p>\n\
         <table class=\"narrow\"><thead><tr><th>View</th>{setting}<th>Signal</th><th class=\"n\">Samples per pixel</th>\
         <th class=\"n\">Standard error</th><th class=\"n\">Smallest RMSE</th><th class=\"n\">Share</th><th></th>{differences}</tr></thead><tbody>\n"
    );
    for facts in &table.references {
        let (class, word) = match facts.suffices() {
            _ if facts.standard_error.is_nan() => ("bad", "its standard error is not known"),
            _ if facts.smallest_rmse.is_nan() => ("", "no RMSE is measured against it"),
            true => ("good", "suffices"),
            false => ("bad", "not accurate enough"),
        };
        let setting = if with_setting { format!("<td>{}</td>", escape(&facts.setting)) } else { String::new() };
        let value = |value: f64, why: &str| html::cell(value, &number(value), if value.is_nan() { why } else { "" });
        let difference = |resolve: &&String| facts.differences.get(*resolve).copied().unwrap_or(f64::NAN);
        let differences: String = resolves.iter().map(|resolve| value(difference(resolve), "no row reference_difference")).collect();
        html += &format!(
            "<tr><td>{}</td>{setting}<td>{}</td>{}{}{}{}<td class=\"{class}\">{word}</td>{differences}</tr>\n",
            escape(&facts.view),
            facts.signal.name(),
            value(facts.spp, "no row reference_spp"),
            value(facts.standard_error, "no row reference_se"),
            value(facts.smallest_rmse, "no row rmse"),
            value(facts.standard_error / facts.smallest_rmse, "one of the two is missing"),
        );
    }
    html += "</tbody></table>\n";
    html += &query(&["m[m.metric.str.startswith(\"reference_\")]"]);
    html + "</section>\n"
}

fn provenance(table: &Table) -> String {
    let example = table.summaries.first().map_or_else(String::new, |s| {
        let error = if s.number(table.error).is_some() { table.error } else { table.cost };
        let conditions = s.key.columns().into_iter().filter(|(name, value)| !value.is_empty() && *name != "experiment");
        let conditions: String =
            conditions.map(|(name, value)| format!("(m[\"{name}\"] == \"{}\") & ", value.replace('"', "\\\""))).collect();
        format!("m[{conditions}(m.signal == \"{}\") & (m.metric == \"{}\")]", s.signal(error), error.name)
    });
    let code = format!(
        "import pandas as pd\nm = pd.read_parquet(\"metrics.parquet\")   # or pd.read_csv(\"metrics.csv\", keep_default_na=False, na_values={{\"frame\": \"\", \"lag\": \"\", \"frequency\": \"\", \"standard_error\": \"\", \"freedom\": \"\"}})\n{example}"
    );
    let averaged = if table.averaged > 0 {
        format!(" {} numbers have no row over all frames; their values are means over the frames, computed by this report.", table.averaged)
    } else {
        String::new()
    };
    let metrics = table.metric_names().iter().map(|name| format!("<code>{}</code>", escape(name))).collect::<Vec<_>>().join(", ");
    format!(
        "<section id=\"numbers\"><h2>Where each number is</h2>\n<p>Every number on this page is the value of a row of <code>metrics.parquet</code> \
         (<code>metrics.csv</code> has the same rows) or of <code>times.csv</code>, or a ratio of two values. A row of the table above contains the \
         columns of these rows as attributes (<code>data-view</code>, <code>data-variant</code>, ...) and in its tooltip. A heading contains the \
         name, the signal and the lag of its metric, and a cell contains the unrounded value (<code>data-v</code>). The tooltip of a mark in a plot names its row, \
         and a click on the mark leads to the row.{averaged} Metrics of this run: {metrics}.</p>\n\
         <p>This code selects all rows of one number, including those of single frames:</p><pre><code>{}</code></pre></section>\n",
        escape(&code)
    )
}

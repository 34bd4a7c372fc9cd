//! Writes the short version of the report as Markdown without pictures, for a pull request.

use super::checks::Mark;
use super::columns::{self, Cell};
use super::numbers::number;
use super::summary::Table;
use super::{RunData, Verdict};
use crate::store::{REPORT_PAGE, REPORT_TEXT};

/// Tables with at most this many rows are not shortened.
const WHOLE: usize = 16;

/// Returns the short report.
pub(super) fn text(run: &RunData, table: &Table, verdicts: &[Verdict], answer: &str) -> String {
    let definition = &run.definition;
    let question = if definition.question.trim().is_empty() { &definition.name } else { &definition.question };
    // The first line of the answer answers the question; the other lines have the details.
    let mut lines = answer.lines().map(escape);
    let mut text = format!("# {}\n\n**{}**\n\n", escape(question), lines.next().unwrap_or_default());
    lines.for_each(|line| text += &format!("{line}\n\n"));
    for (result, words) in columns::checks(run, table, verdicts) {
        text += &format!("- {} {}\n", mark(result), escape(&words));
    }
    for remark in columns::remarks(run, table) {
        text += &format!("- {}\n", escape(&remark));
    }
    text += &expectations(run, verdicts);
    let (choices, cut) = choices(run, table);
    text += &choices;
    text += "\n## Set-up\n\n";
    if run.is_software() {
        text += "This is a software adapter: only ratios of its times are meaningful.\n\n";
    }
    for (name, value) in columns::facts(run, table) {
        text += &if name == "Command" { format!("- {name}: {}\n", code(&value)) } else { format!("- {name}: {}\n", escape(&value)) };
    }
    let all = table.summaries.len();
    let cut = if cut < all {
        format!(
            " The table shows {cut} of {all} choices: those on a Pareto front, single flavours, automatic choices, and choices of the generic kernel."
        )
    } else {
        String::new()
    };
    text += &format!(
        "\n---\n{REPORT_TEXT} omits plots, spectra, reference facts and pictures, which are in {REPORT_PAGE} next to it. All numbers are in metrics.parquet and times.csv.{cut}\n"
    );
    text
}

fn mark(result: Mark) -> &'static str {
    match result {
        Mark::Passes => "\u{2705}",
        Mark::Fails => "\u{274c}",
        Mark::Unclear => "\u{2754}",
    }
}

fn expectations(run: &RunData, verdicts: &[Verdict]) -> String {
    let expected = columns::expectations(run, verdicts);
    if expected.is_empty() {
        return "\nThe definition states no expectation.\n".to_owned();
    }
    let mut text =
        "\n## Expectations\n\n| | claim | metric | value | expected | how |\n| --- | --- | --- | ---: | ---: | --- |\n".to_owned();
    for verdict in expected {
        let value = if verdict.value.is_nan() { "\u{2013}".to_owned() } else { number(verdict.value) };
        text += &format!(
            "| {} | {} | {} | {value} | {} to {} | {} |\n",
            mark(Mark::of(verdict.met)),
            escape(&verdict.claim),
            escape(&verdict.metric),
            number(verdict.range[0]),
            number(verdict.range[1]),
            escape(&verdict.why)
        );
    }
    text
}

/// Returns the table of choices as text, and the number of its rows. A long table is reduced to four kinds of choices: those on a Pareto front,
/// forced variants of a single flavour, automatic choices, and all choices that use the generic kernel.
fn choices(run: &RunData, table: &Table) -> (String, usize) {
    let keys = columns::key_columns(table);
    let (shown, dropped) = columns::columns(run, table);
    let fronts = columns::fronts(table);
    let rows: Vec<usize> = (0..table.summaries.len())
        .filter(|&i| {
            let single = table.summaries[i].key.flavours().is_none_or(|n| n == 1);
            table.summaries.len() <= WHOLE || single || fronts[i].is_on()
        })
        .collect();
    let mut head: Vec<String> = keys.iter().map(|(name, _)| (*name).to_owned()).chain(["Front".to_owned()]).collect();
    head.extend(shown.iter().map(|c| match c.unit(table) {
        unit if unit.is_empty() => c.heading.to_owned(),
        unit => format!("{} ({unit})", c.heading),
    }));
    let lines = keys.iter().map(|_| "---").chain(["---"]).chain(shown.iter().map(|_| "---:"));
    let mut text = format!("\n## Choices\n\n| {} |\n| {} |\n", head.join(" | "), lines.collect::<Vec<_>>().join(" | "));
    let mut reasons: Vec<String> = Vec::new();
    for &index in &rows {
        let mut cells: Vec<String> = keys.iter().map(|(_, of)| escape(of(&table.summaries[index]))).collect();
        cells.push(fronts[index].name());
        for column in &shown {
            cells.push(match columns::cell(run, table, index, column.source) {
                Cell::Value { shown, .. } => shown,
                Cell::Missing(reason) => {
                    let reason = format!("{}: {reason}", column.heading);
                    if !reasons.contains(&reason) {
                        reasons.push(reason);
                    }
                    "\u{2013}".to_owned()
                }
            });
        }
        text += &format!("| {} |\n", cells.join(" | "));
    }
    if rows.iter().any(|&i| fronts[i].name().contains('(')) {
        text += "\nA front in brackets: the choice is not on that front, but as good as one that is, within chance.\n";
    }
    if !reasons.is_empty() {
        text += &format!("\nA dash means that there is no number. {}.\n", escape(&reasons.join("; ")));
    }
    if !dropped.is_empty() {
        text += &format!("\nColumns without any number: {}.\n", dropped.join(", "));
    }
    (text, rows.len())
}

/// Escapes characters that have a meaning in Markdown or HTML, and separates words by single spaces, so that the text is one line.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.split_whitespace().collect::<Vec<_>>().join(" ").chars() {
        if matches!(c, '\\' | '`' | '*' | '_' | '|' | '<' | '>' | '[' | ']' | '#' | '&' | '~') {
            escaped.push('\\');
        }
        escaped.push(c);
    }
    escaped
}

/// Formats text as inline code. The delimiters have one backquote more than the longest series of backquotes in the text.
fn code(text: &str) -> String {
    let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let longest = text.split(|c| c != '`').map(str::len).max().unwrap_or(0);
    let fence = "`".repeat(longest + 1);
    if longest > 0 { format!("{fence} {text} {fence}") } else { format!("{fence}{text}{fence}") }
}

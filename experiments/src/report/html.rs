//! Functions that write the HTML of reports. An argument that "is text" is escaped by the function, and an argument that "is HTML" is inserted
//! unchanged.

use std::fmt::Write as _;

use super::checks::{Check, GoldenRow, Mark};

/// Escapes the five characters that have a meaning in HTML.
pub(crate) fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            other => escaped.push(other),
        }
    }
    escaped
}

/// Returns a complete page, which contains its style and script and needs no other file. `body` is HTML, `title` is text.
pub(super) fn page(title: &str, body: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{}</title>\n<style>{}</style>\n</head>\n<body>\n<main>\n{body}</main>\n<script>{}</script>\n</body>\n</html>\n",
        escape(title),
        include_str!("report.css"),
        include_str!("report.js")
    )
}

/// Returns the top of the page. `kicker` is the small line above the heading. Both arguments are text.
pub(super) fn header(kicker: &str, heading: &str) -> String {
    format!("<header><p class=\"kicker\">{}</p>\n<h1>{}</h1></header>\n", escape(kicker), escape(heading))
}

/// Returns the section with the answer to the run's question, the checks of the run, and remarks. The first line of the answer is emphasised, because
/// it answers the question; the other lines have the details. The answer, the descriptions of the checks and the remarks are plain
/// text, which is escaped here.
pub(super) fn verdict(answer: &str, checks: &[Check], remarks: &[String]) -> String {
    let (first, rest) = answer.split_once('\n').unwrap_or((answer, ""));
    let mut html = format!("<section class=\"verdict\"><p class=\"answer\">{}</p>\n", escape(first));
    if !rest.is_empty() {
        html += &format!("<p>{}</p>\n", escape(rest));
    }
    html += "<ul>";
    for (result, text) in checks {
        let class = match result {
            Mark::Passes => mark(true),
            Mark::Fails => mark(false),
            Mark::Unclear => "unclear",
        };
        html += &format!("<li class=\"{class}\">{}</li>\n", escape(text));
    }
    for remark in remarks {
        html += &format!("<li class=\"remark\">{}</li>\n", escape(remark));
    }
    html + "</ul></section>\n"
}

/// Returns the CSS class of a passed or failed check.
pub(super) fn mark(good: bool) -> &'static str {
    if good { "good" } else { "bad" }
}

/// Returns a list of facts with their names. Values are text; the value named `Command` is shown as code. Names are inserted unchanged.
pub(super) fn facts(facts: &[(&str, String)]) -> String {
    let mut html = "<dl class=\"facts\">".to_owned();
    for (name, value) in facts {
        let value = if *name == "Command" { format!("<code>{}</code>", escape(value)) } else { escape(value) };
        html += &format!("<dt>{name}</dt><dd>{value}</dd>\n");
    }
    html + "</dl>"
}

/// Returns a list of terms with their meanings. Both are text.
pub(super) fn terms(terms: &[(&str, &str)]) -> String {
    let mut html = "<dl class=\"terms\">".to_owned();
    for (term, meaning) in terms {
        html += &format!("<dt>{}</dt><dd>{}</dd>\n", escape(term), escape(meaning));
    }
    html + "</dl>"
}

/// Name and explanation of the fetches per pixel.
pub(super) const FETCHES_TERM: (&str, &str) =
    ("Fetches per pixel", "texture accesses of the shader, counted while it ran; mean over terrain pixels.");
/// Name and explanation of the bias.
pub(super) const BIAS_TERM: (&str, &str) = (
    "Bias",
    "mean of linear albedo over seeds, pixels and channels, minus the mean of the exact blend of the same flavours; \u{b1} = standard error. Cancelling: p-value of a test for biases that cancel over the picture: the probability that areas of 16 x 16 pixels deviate as much as measured if there is no bias.",
);
/// Name and explanation of the variance.
pub(super) const VARIANCE_TERM: (&str, &str) = (
    "Variance",
    "variance of a pixel's linear albedo over seeds, averaged over pixels and channels; Theory: what the theory of random selection predicts for it; Exact \
     MSE: mean squared difference from the exact blend, which is compared with the theory.",
);
/// Names and explanation of the ways in which a variant is chosen.
pub(super) const CHOICE_TERM: (&str, &str) = (
    "Forced, auto, generic",
    "forced: one variant on every tile; auto: each tile runs the variant that its classification gives; generic: one kernel that reads the mask at run time.",
);

/// The note about times of a software adapter.
pub(super) const SOFTWARE_NOTE: &str = "<p class=\"note\"><b>This is a software adapter.</b> Its times are not those of a GPU: \
     only ratios between them are meaningful.</p>\n";

/// Returns a plot (SVG) with its caption, which is HTML. If there is no plot, a note is shown instead.
pub(super) fn figure(svg: Option<String>, caption: &str) -> String {
    let svg = svg.unwrap_or_else(|| "<p class=\"note\">Nothing to plot: these numbers are missing.</p>".to_owned());
    format!("<figure class=\"plot\">{svg}<figcaption>{caption}</figcaption></figure>\n")
}

/// Returns an entry of a legend: a dot in the given colour, and `words`, which is text.
pub(super) fn key((r, g, b): (u8, u8, u8), words: &str) -> String {
    format!("<span class=\"entry\"><span class=\"key\" style=\"background:rgb({r},{g},{b})\"></span>{}</span> ", escape(words))
}

/// Returns the head of a sortable table. Each column has a heading (text), a unit (text), a flag that says whether its cells are numbers, and
/// additional attributes (HTML).
pub(super) fn head<'a>(columns: impl IntoIterator<Item = (&'a str, &'a str, bool, String)>) -> String {
    let mut html = "<thead><tr>".to_owned();
    for (heading, unit, is_number, attributes) in columns {
        let class = if is_number { " class=\"n\"" } else { "" };
        html += &format!("<th{class}{attributes}>{}<small>{}</small></th>", escape(heading), escape(unit));
    }
    html + "</tr></thead>\n"
}

/// Returns a table cell. It contains the displayed number `shown`, which is HTML, the unrounded value for the sorting script, and the tooltip `hint`,
/// which is text. If the value is NaN, the cell shows a dash, and `hint` should give the reason.
pub(super) fn cell(value: f64, shown: &str, hint: &str) -> String {
    let hint = if hint.is_empty() { String::new() } else { format!(" title=\"{}\"", escape(hint)) };
    match value {
        v if v.is_nan() => format!("<td class=\"n\"{hint}>\u{2013}</td>"),
        // The sorting script can only read infinity in this form.
        v if v.is_infinite() => format!("<td class=\"n\" data-v=\"{}Infinity\"{hint}>{shown}</td>", if v < 0.0 { "-" } else { "" }),
        v => format!("<td class=\"n\" data-v=\"{v:e}\"{hint}>{shown}</td>"),
    }
}

/// Returns the section with the table of promised and counted fetches.
pub(super) fn promises<'a>(rows: impl IntoIterator<Item = &'a GoldenRow>) -> String {
    let mut html = "<section id=\"promises\"><h2>Fetches promised and counted</h2>\n<table class=\"narrow\"><thead><tr><th>Flavour</th>\
         <th class=\"n\">Promised</th><th class=\"n\">Counted</th><th></th></tr></thead><tbody>\n"
        .to_owned();
    for row in rows {
        let word = if row.agrees { "agrees" } else { "differs" };
        html += &format!(
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{:.2}</td><td class=\"{}\">{word}</td></tr>\n",
            escape(&row.flavour),
            escape(&row.promised.replace('-', "\u{2013}")),
            row.counted,
            mark(row.agrees)
        );
    }
    html + "</tbody></table></section>\n"
}

/// Returns a picture that is embedded in the page. `title`, `caption` and `hint` (a tooltip) are text. `source` is a data URL.
pub(super) fn picture(title: &str, caption: &str, hint: &str, [width, height]: [u32; 2], source: &str) -> String {
    let title = escape(title);
    let hint = if hint.is_empty() { String::new() } else { format!(" title=\"{}\"", escape(hint)) };
    format!(
        "<figure{hint}><img alt=\"{title}\" width=\"{width}\" height=\"{height}\" src=\"{source}\">\
         <figcaption><b>{title}</b> {}</figcaption></figure>\n",
        escape(caption)
    )
}

/// Converts prose to HTML. Empty lines separate paragraphs, lines that begin with `- ` are items of a list, and a paragraph of one line that begins
/// with `#` is a heading. Text between backquotes is code, and text between double asterisks is strong. Everything else is escaped.
pub(super) fn prose(text: &str) -> String {
    let mut html = String::new();
    for block in text.replace('\r', "").split("\n\n").map(str::trim).filter(|b| !b.is_empty()) {
        if let Some(heading) = block.strip_prefix('#').filter(|rest| !rest.contains('\n')) {
            html += &format!("<h3>{}</h3>\n", inline(heading.trim_start_matches('#').trim()));
            continue;
        }
        let (before, items): (Vec<&str>, Vec<&str>) = match block.lines().position(|l| l.starts_with("- ")) {
            Some(first) => (block.lines().take(first).collect(), block.lines().skip(first).collect()),
            None => (block.lines().collect(), Vec::new()),
        };
        if !before.is_empty() {
            html += &format!("<p>{}</p>\n", inline(&before.join("\n")));
        }
        if !items.is_empty() {
            let list = items.join("\n");
            let entries = list.strip_prefix("- ").unwrap_or(&list).split("\n- ").map(|i| format!("<li>{}</li>", inline(i)));
            let _ = writeln!(html, "<ul>{}</ul>", entries.collect::<String>());
        }
    }
    html
}

/// Converts code and strong text within a paragraph to HTML. A delimiter without its partner is kept as text.
fn inline(text: &str) -> String {
    let mut html = String::new();
    for (index, part) in paired(text, "`").into_iter().enumerate() {
        if index % 2 == 1 {
            html += &format!("<code>{}</code>", escape(part));
            continue;
        }
        for (index, part) in paired(part, "**").into_iter().enumerate() {
            let words = escape(part);
            html += &if index % 2 == 1 { format!("<b>{words}</b>") } else { words };
        }
    }
    html
}

/// Splits a text at the delimiter `mark`. Every second part lies between two delimiters. A last delimiter without a partner does not split the text.
fn paired<'a>(text: &'a str, mark: &str) -> Vec<&'a str> {
    let mut parts = Vec::new();
    let mut rest = text;
    while let Some(open) = rest.find(mark) {
        let after = &rest[open + mark.len()..];
        let Some(close) = after.find(mark) else { break };
        parts.extend([&rest[..open], &after[..close]]);
        rest = &after[close + mark.len()..];
    }
    parts.push(rest);
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_of_an_answer_is_emphasised() {
        let checks = [(Mark::Fails, "1 < 2".to_owned()), (Mark::Unclear, "so".to_owned())];
        assert_eq!(
            verdict("It is a.\nIn view b, c & d.\nIn view e, f.", &checks, &["g > h".to_owned()]),
            "<section class=\"verdict\"><p class=\"answer\">It is a.</p>\n<p>In view b, c &amp; d.\nIn view e, f.</p>\n<ul><li class=\"bad\">1 &lt; \
             2</li>\n<li class=\"unclear\">so</li>\n<li class=\"remark\">g &gt; h</li>\n</ul></section>\n"
        );
        assert_eq!(verdict("It is a.", &[], &[]), "<section class=\"verdict\"><p class=\"answer\">It is a.</p>\n<ul></ul></section>\n");
    }

    #[test]
    fn markup_in_names_stays_text() {
        assert_eq!(escape("<a href=\"x\">'&'</a>"), "&lt;a href=&quot;x&quot;&gt;&#39;&amp;&#39;&lt;/a&gt;");
        assert_eq!(escape("far-atlas \u{b1} 1"), "far-atlas \u{b1} 1");
    }

    #[test]
    fn missing_numbers_are_dashes() {
        assert_eq!(cell(0.5, "0.500", ""), "<td class=\"n\" data-v=\"5e-1\">0.500</td>");
        assert_eq!(cell(f64::NAN, "NaN", "one < two"), "<td class=\"n\" title=\"one &lt; two\">\u{2013}</td>");
        assert_eq!(cell(f64::INFINITY, "\u{221e}", ""), "<td class=\"n\" data-v=\"Infinity\">\u{221e}</td>");
    }

    #[test]
    fn prose_is_paragraphs_and_never_markup() {
        assert_eq!(
            prose("One `a<b`\nand **two**.\n\n\n<script>x</script>"),
            "<p>One <code>a&lt;b</code>\nand <b>two</b>.</p>\n<p>&lt;script&gt;x&lt;/script&gt;</p>\n"
        );
        assert_eq!(prose("See:\n- one\n  more\n- **two**"), "<p>See:</p>\n<ul><li>one\n  more</li><li><b>two</b></li></ul>\n");
        assert_eq!(prose("## Why\n\nso"), "<h3>Why</h3>\n<p>so</p>\n");
        // Delimiters inside code are kept as text, and so is a single backquote.
        assert_eq!(prose("`**` 2 ** 3 ` 4"), "<p><code>**</code> 2 ** 3 ` 4</p>\n");
        assert_eq!(prose(" \n\n"), "");
    }
}

//! The report of the stability lab. It gives the largest errors of each kernel, and lists the arguments for which kernels deviate from their
//! formulas, with the resulting errors. It also lists the measured errors of stored directions, and the measured properties of noise.

use std::fmt::Write as _;

use anyhow::Result;

use super::checks::{Check, Mark};
use super::html;
use super::numbers::number;
use super::plots::{COLOURS, Curve, CurvePoint, Lines, lines};
use crate::metrics;
use crate::stability::Row;
use crate::stability::extremes::Bend;
use crate::stability::kernels::Finding;

/// The results of the lab.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lab<'a> {
    /// Results of kernels at extreme values of their arguments.
    pub(crate) findings: &'a [Finding],
    /// The arguments for which kernels deviate from their formulas.
    pub(crate) bends: &'a [Bend],
    /// Errors of the encodings that store directions, and errors of derivatives that are computed from stored planes.
    pub(crate) directions: &'a [Row],
    /// Tests of hashes and noise, and other numbers about them. The tests of all p-values together have one significance level.
    pub(crate) noise: &'a [Row],
    /// Properties of noise while the camera moves.
    pub(crate) motion: &'a [Row],
}

/// The implementation that computed a result: `gpu` and the name of the device, or, for the f32 reference, `f32` and an empty text.
type Side<'a> = (&'a str, &'a str);

/// Returns the implementations that occur in the findings. Devices come first.
fn sides<'a>(findings: &[&'a Finding]) -> Vec<Side<'a>> {
    let mut sides: Vec<Side<'a>> = Vec::new();
    for finding in findings {
        let side = (finding.on.as_str(), finding.adapter.as_str());
        if !sides.contains(&side) {
            sides.push(side);
        }
    }
    sides.sort_by_key(|(on, _)| *on != "gpu");
    sides
}

fn side_name((on, adapter): Side<'_>) -> &str {
    if on == "gpu" { adapter } else { "reference in f32" }
}

/// The findings of one kernel, parameter and measure. They are drawn in one plot.
struct Group<'a> {
    first: &'a Finding,
    findings: Vec<&'a Finding>,
}

/// Collects the findings into groups. Groups are in the order in which they first occur.
fn groups(findings: &[Finding]) -> Vec<Group<'_>> {
    let mut groups: Vec<Group<'_>> = Vec::new();
    for finding in findings {
        let key = |f: &Finding| (f.kernel.clone(), f.parameter.clone(), f.measure.clone());
        match groups.iter_mut().find(|group| key(group.first) == key(finding)) {
            Some(group) => group.findings.push(finding),
            None => groups.push(Group { first: finding, findings: vec![finding] }),
        }
    }
    groups
}

impl<'a> Group<'a> {
    fn of(&self, side: Side<'_>) -> impl Iterator<Item = &'a Finding> {
        self.findings.iter().copied().filter(move |finding| (finding.on.as_str(), finding.adapter.as_str()) == side)
    }

    fn on_gpu(&self) -> impl Iterator<Item = &'a Finding> {
        self.findings.iter().copied().filter(|finding| finding.on == "gpu")
    }

    /// Returns the finding with the largest error among the findings of devices; the first finding if there is no device.
    fn worst(&self) -> &'a Finding {
        self.on_gpu().max_by(|a, b| a.worst.total_cmp(&b.worst)).unwrap_or(self.first)
    }

    fn passes(&self) -> bool {
        self.findings.iter().all(|finding| finding.pass)
    }

    /// Describes the results of devices. The text says that there is no device, that some results are not finite, that results only had to be finite,
    /// or that they are exact. Otherwise, it gives the largest error and the value of the parameter at which this error occurs.
    fn words(&self) -> String {
        let worst = self.worst();
        if self.on_gpu().next().is_none() {
            return "no device".to_owned();
        }
        let broken: usize = self.on_gpu().map(|finding| finding.not_finite).sum();
        if broken > 0 {
            return format!("{broken} results are not finite");
        }
        if self.on_gpu().all(|finding| finding.compared == 0) {
            return "finite, as required".to_owned();
        }
        if worst.worst == 0.0 {
            return "exact".to_owned();
        }
        format!("{} {} at {}", number(worst.worst), worst.unit, place(worst.value))
    }

    /// Returns the largest error on a device relative to its derived tolerance, percent.
    fn of_tolerance(&self) -> f64 {
        100.0 * self.on_gpu().map(|finding| finding.of_tolerance).fold(0.0, f64::max)
    }

    fn plot(&self, sides: &[Side<'_>]) -> Result<Option<String>> {
        let curves: Vec<Curve> = sides
            .iter()
            .zip(COLOURS)
            .flat_map(|(&side, colour)| {
                // Each implementation has two curves: the largest error, and in a paler colour the median error.
                let pale = (colour.0 / 2 + 127, colour.1 / 2 + 127, colour.2 / 2 + 127);
                [(true, pale), (false, colour)].map(|(is_typical, colour)| {
                    let point =
                        |f: &Finding| CurvePoint { x: f.value, y: if is_typical { f.typical } else { f.worst }, half: 0.0, hint: None };
                    let mut points: Vec<CurvePoint> = self.of(side).map(point).collect();
                    points.sort_by(|a, b| a.x.total_cmp(&b.x));
                    Curve { colour, points }
                })
            })
            .collect();
        let values = || self.findings.iter().map(|f| f.value).filter(|v| v.is_finite() && *v > 0.0);
        let (low, high) = (values().fold(f64::MAX, f64::min), values().fold(0.0, f64::max));
        let title = format!("Error of {} over {}", self.first.kernel, self.first.parameter);
        let y_title = format!("{}, {}", self.first.measure, self.first.unit);
        let plot = Lines {
            title: &title,
            x_title: &self.first.parameter,
            y_title: &y_title,
            // The horizontal axis is logarithmic if the positive values span more than two decades. A logarithmic axis cannot show values of 0 or
            // less, so they are omitted.
            x_logarithmic: high > 100.0 * low,
            y_logarithmic: true,
            ..Lines::default()
        };
        let shown: Vec<Curve> = curves
            .into_iter()
            .map(|curve| {
                let points = curve.points.into_iter().filter(|p| !plot.x_logarithmic || p.x > 0.0).collect();
                Curve { points, ..curve }
            })
            .collect();
        lines(&shown, &plot)
    }
}

/// A table of the report, for HTML and Markdown.
struct Table {
    title: &'static str,
    /// A note above the table; may be empty.
    note: String,
    columns: Vec<String>,
    rows: Vec<Vec<String>>,
}

impl Table {
    fn markdown(&self) -> String {
        let mut text = format!("\n## {}\n\n", self.title);
        if !self.note.is_empty() {
            let _ = writeln!(text, "{}\n", self.note);
        }
        let line = |cells: &[String]| {
            format!("| {} |\n", cells.iter().map(|cell| cell.replace('|', "\\|").replace('\n', " ")).collect::<Vec<_>>().join(" | "))
        };
        text += &line(&self.columns);
        text += &line(&vec!["---".to_owned(); self.columns.len()]);
        for row in &self.rows {
            text += &line(row);
        }
        text
    }

    fn html(&self) -> String {
        let cells = |row: &[String], tag: &str| row.iter().map(|cell| format!("<{tag}>{}</{tag}>", html::escape(cell))).collect::<String>();
        let mut text = format!("<h2>{}</h2>\n<p>{}</p>\n", html::escape(self.title), html::escape(&self.note));
        let _ = writeln!(text, "<div class=\"scroll\"><table><thead><tr>{}</tr></thead>\n<tbody>", cells(&self.columns, "th"));
        for row in &self.rows {
            let _ = writeln!(text, "<tr>{}</tr>", cells(row, "td"));
        }
        text + "</tbody></table></div>\n"
    }
}

fn columns(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn holds(good: bool) -> String {
    if good { "holds" } else { "FAILS" }.to_owned()
}

fn of_kernels(groups: &[Group<'_>]) -> Table {
    let row = |group: &Group<'_>| {
        let Finding { kernel, parameter, measure, .. } = group.first;
        let ulp = group.on_gpu().map(|finding| finding.worst_ulp).fold(0.0, f64::max);
        // The columns `ulp` and `of the tolerance` combine all measures of a kernel and parameter. To avoid repetition, they are filled
        // only in the row of the first measure. They are empty if no results were compared with the reference.
        let is_first = groups
            .iter()
            .find(|of| of.first.kernel == *kernel && of.first.parameter == *parameter)
            .is_some_and(|of| of.first.measure == *measure);
        let [ulp, share] = match group.on_gpu().all(|finding| finding.compared == 0) {
            false if is_first => [number(ulp), format!("{:.1} %", group.of_tolerance())],
            _ => [String::new(), String::new()],
        };
        vec![format!("{kernel}: {measure}"), parameter.clone(), group.words(), ulp, share, holds(group.passes())]
    };
    Table {
        title: "Kernels at their extremes",
        note: "The column `largest error` gives the maximum over all tested inputs and devices, and the parameter's value at which it occurs. The \
               next two columns combine all measures of a kernel and parameter: the largest error in units in the last place (of the largest result \
               for the same input), and the largest error as a percentage of its tolerance. The tolerance is derived in the code of the kernel and \
               is larger for ill-conditioned inputs. `finite, as required` means that these arguments lie outside the kernel's intended range, \
               where results must only be finite."
            .to_owned(),
        columns: columns(&["kernel: measure", "parameter", "largest error", "ulp", "of the tolerance", ""]),
        rows: groups.iter().map(row).collect(),
    }
}

fn of_bends(bends: &[Bend], breaks: bool) -> Table {
    let row = |bend: &Bend| vec![bend.kernel.clone(), bend.when.clone(), bend.then.clone(), bend.price.clone()];
    Table {
        title: "Deviations of kernels from their formulas",
        note: format!(
            "For all other arguments, a kernel agrees with its formula within the tolerance above. {}",
            if breaks {
                "Some kernels fail: they return results that are not finite."
            } else {
                "No kernel fails: every tested argument, including NaN, gave a finite result."
            }
        ),
        columns: columns(&["kernel", "when", "then", "price"]),
        rows: bends.iter().map(row).collect(),
    }
}

/// Returns the table of the measures whose results differ between devices. They may differ in the largest error, or in the number of rows for which
/// the device takes another branch than the reference.
fn across(groups: &[Group<'_>], devices: &[Side<'_>]) -> Table {
    let mut rows = Vec::new();
    let mut alike = 0;
    for group in groups {
        let of = |side: Side<'_>, what: fn(&Finding) -> f64| group.of(side).map(what).fold(0.0, f64::max);
        let worst: Vec<f64> = devices.iter().map(|&side| of(side, |f| f.worst)).collect();
        let sides: Vec<usize> = devices.iter().map(|&side| group.of(side).map(|f| f.other_side).sum()).collect();
        if worst.iter().all(|x| *x == worst[0]) && sides.iter().all(|n| *n == sides[0]) {
            alike += 1;
            continue;
        }
        let mut row =
            vec![format!("{}: {}", group.first.kernel, group.first.measure), group.first.parameter.clone(), group.first.unit.clone()];
        row.extend(worst.iter().zip(&sides).map(|(worst, sides)| match sides {
            0 => number(*worst),
            sides => format!("{} ({sides} rows on the other side of a threshold)", number(*worst)),
        }));
        row.push(holds(group.passes()));
        rows.push(row);
    }
    let mut names = columns(&["kernel: measure", "parameter", "unit"]);
    names.extend(devices.iter().map(|&side| side_name(side).to_owned()));
    names.push(String::new());
    let note = format!("Largest error on each adapter. {alike} of {} measures are equal on all adapters and are omitted.", groups.len());
    Table { title: "Across adapters", note, columns: names, rows }
}

fn of_rows(title: &'static str, note: String, rows: &[Row]) -> Table {
    let row = |row: &Row| {
        let range = format!("{} to {}", number(row.low), number(row.high));
        let what = [row.kind.as_str(), row.view.as_str(), row.motion.as_str()].into_iter().filter(|part| !part.is_empty());
        vec![what.collect::<Vec<_>>().join(", "), row.statistic.clone(), number(row.value), range, holds(row.holds())]
    };
    Table { title, note, columns: columns(&["what", "statistic", "value", "allowed range", ""]), rows: rows.iter().map(row).collect() }
}

/// Returns the table of tests of hashes and noise. It contains all failures. If there are few, it also contains the tests with the smallest p-values.
fn of_noise(rows: &[Row]) -> Table {
    let tests = rows.iter().filter(|row| row.is_test()).count();
    let level = rows.iter().find(|row| row.is_test()).map_or(0.0, |row| row.low);
    let mut shown: Vec<Row> = rows.iter().filter(|row| row.is_test() || !row.holds()).cloned().collect();
    shown.sort_by(|a, b| a.holds().cmp(&b.holds()).then(a.value.total_cmp(&b.value)));
    let failing = shown.iter().filter(|row| !row.holds()).count();
    shown.truncate(failing.max(8));
    let note = format!(
        "The {tests} tests together have a level of 0.1 %, so each test has the level {}. Another {} numbers must lie in their ranges. In total, \
         {failing} fail. The table lists all failures. If there are fewer than 8, it also lists the tests with the smallest p, up to 8 rows.",
        number(level),
        rows.len() - tests
    );
    of_rows("Hashes and noise", note, &shown)
}

/// Returns the table of flip rates and clumping on level ground, with one line for each kind of noise. Clumping is that of the first motion.
fn of_motion(rows: &[Row]) -> Table {
    let mut kinds: Vec<&str> = Vec::new();
    let mut motions: Vec<&str> = Vec::new();
    let flat: Vec<&Row> = rows.iter().filter(|row| row.view == "flat").collect();
    for row in &flat {
        for (list, name) in [(&mut kinds, row.kind.as_str()), (&mut motions, row.motion.as_str())] {
            if !list.contains(&name) {
                list.push(name);
            }
        }
    }
    let value = |kind: &str, motion: &str, statistic: &str| {
        flat.iter()
            .find(|row| row.kind == kind && row.motion == motion && row.statistic == statistic)
            .map_or_else(String::new, |row| number(row.value))
    };
    let mut names = vec!["noise".to_owned()];
    names.extend(motions.iter().map(|motion| format!("flips, {motion}")));
    names.push(metrics::CLUMPING.to_owned());
    let row = |&kind: &&str| {
        let mut cells = vec![kind.to_owned()];
        cells.extend(motions.iter().map(|motion| value(kind, motion, metrics::FLIP_RATE)));
        cells.push(motions.first().map_or_else(String::new, |motion| value(kind, motion, metrics::CLUMPING)));
        cells
    };
    Table {
        title: "Noise while a camera moves",
        note: format!(
            "Flip rate from frame to frame on level ground, for random choices among four texels of equal weight. All {} numbers are in noise.csv.",
            rows.len()
        ),
        columns: names,
        rows: kinds.iter().map(row).collect(),
    }
}

impl Lab<'_> {
    /// Returns a list of what was measured, each entry with the number of results and the number of results that pass.
    fn summary(&self) -> Vec<(&'static str, usize, usize)> {
        let groups = groups(self.findings);
        let of = |rows: &[Row]| (rows.len(), rows.iter().filter(|row| row.holds()).count());
        let (directions, noise, motion) = (of(self.directions), of(self.noise), of(self.motion));
        [
            ("measures of kernels", groups.len(), groups.iter().filter(|group| group.passes()).count()),
            ("numbers of directions and derivatives", directions.0, directions.1),
            ("numbers of hashes and noise", noise.0, noise.1),
            ("numbers of noise in motion", motion.0, motion.1),
        ]
        .into_iter()
        .filter(|(_, count, _)| *count > 0)
        .collect()
    }

    fn tables(&self) -> Vec<Table> {
        let groups = groups(self.findings);
        let all: Vec<&Finding> = self.findings.iter().collect();
        let devices: Vec<Side<'_>> = sides(&all).into_iter().filter(|(on, _)| *on == "gpu").collect();
        let mut tables = Vec::new();
        if !groups.is_empty() {
            tables.push(of_kernels(&groups));
        }
        if !self.bends.is_empty() {
            tables.push(of_bends(self.bends, self.findings.iter().any(|finding| finding.not_finite > 0)));
        }
        if devices.len() > 1 {
            tables.push(across(&groups, &devices));
        }
        if !self.directions.is_empty() {
            let note =
                "Errors of octahedral encodings, compared with a published survey, and errors of derivatives from stored planes for random cameras."
                    .to_owned();
            tables.push(of_rows("Directions and derivatives", note, self.directions));
        }
        if !self.noise.is_empty() {
            tables.push(of_noise(self.noise));
        }
        if !self.motion.is_empty() {
            tables.push(of_motion(self.motion));
        }
        tables
    }
}

/// Returns the report as Markdown.
pub(crate) fn text(lab: &Lab<'_>, facts: &[(&str, String)]) -> String {
    let mut text = "# Stability lab\n\n".to_owned();
    for (what, count, passed) in lab.summary() {
        let _ = writeln!(text, "- {passed} of {count} {what} hold");
    }
    for (name, value) in facts {
        let _ = writeln!(text, "- {name}: {value}");
    }
    lab.tables().iter().fold(text, |text, table| text + &table.markdown())
}

/// Returns the report as an HTML page, with a plot for each measure that is not exact.
///
/// # Errors
/// A plot cannot be drawn.
pub(crate) fn page(lab: &Lab<'_>, facts: &[(&str, String)]) -> Result<String> {
    let answer = "How accurate the arithmetic is: kernels against references in f64; stored directions, derivatives and noise against derived values";
    let check = |(what, count, passed): (&str, usize, usize)| (Mark::of(passed == count), format!("{passed} of {count} {what} hold"));
    let checks: Vec<Check> = lab.summary().into_iter().map(check).collect();
    let mut body = html::header("stability lab", answer) + &html::verdict("", &checks, &[]) + &html::facts(facts);
    for table in lab.tables() {
        body += &table.html();
    }
    let groups = groups(lab.findings);
    let all: Vec<&Finding> = lab.findings.iter().collect();
    let sides = sides(&all);
    if !sides.is_empty() {
        body += "<h2>Errors over their parameters</h2>\n<p>";
        for (&side, colour) in sides.iter().zip(COLOURS) {
            body += &html::key(colour, &format!("{}: largest error, and in a paler colour the median error", side_name(side)));
        }
        body += "</p>\n<div class=\"pair\">";
        for group in groups.iter().filter(|group| group.worst().worst > 0.0) {
            let caption =
                html::escape(&format!("{}, {} over {}: {}", group.first.kernel, group.first.measure, group.first.parameter, group.words()));
            body += &html::figure(group.plot(&sides)?, &caption);
        }
        body += "</div>\n";
    }
    Ok(html::page("Stability lab", &body))
}

/// Formats the value of the parameter at which the largest error occurs. Whole numbers below 1e10 are written with all digits, because some tested
/// values differ only in their last digits: 32-bit words, and the neighbours of powers of two.
fn place(value: f64) -> String {
    let short = number(value);
    let is_cut = value.fract() == 0.0 && value.abs() < 1e10 && short.parse() != Ok(value);
    if is_cut { format!("{value}") } else { short }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(value: f64, worst: f64, [on, adapter]: [&str; 2], pass: bool) -> Finding {
        Finding {
            kernel: "derivatives".to_owned(),
            parameter: "incidence_deg".to_owned(),
            value,
            on: on.to_owned(),
            adapter: adapter.to_owned(),
            rows: 8,
            not_finite: 0,
            differ: usize::from(!pass),
            compared: 8,
            other_side: 0,
            of_tolerance: 0.25,
            worst_ulp: 3.0,
            typical_ulp: 1.0,
            measure: "mip".to_owned(),
            worst,
            typical: worst / 2.0,
            unit: "levels".to_owned(),
            pass,
        }
    }

    const ONE: [&str; 2] = ["gpu", "one"];
    const OTHER: [&str; 2] = ["gpu", "other"];
    const SINGLE: [&str; 2] = ["f32", ""];

    #[test]
    fn places_that_are_whole_are_named_in_full() {
        assert_eq!([4_294_967_295.0, 1_048_576.0, -4096.0].map(place), ["4294967295", "1048576", "-4096"]);
        let as_others = [89.0, 0.0, 1e6, 1e30, 1234.5, f64::NAN];
        assert_eq!(as_others.map(place), as_others.map(number));
    }

    #[test]
    fn results_that_are_not_finite_are_named() {
        let broken = [Finding { not_finite: 3, compared: 0, ..finding(10.0, 0.0, ONE, false) }];
        let text = super::text(&Lab { findings: &broken, ..Lab::default() }, &[]);
        assert!(text.contains("3 results are not finite") && !text.contains("| finite, as required |"), "{text}");
    }

    #[test]
    fn the_worst_is_named_with_its_place_and_failures_are_seen() {
        let findings = [finding(10.0, 0.01, ONE, true), finding(89.0, 0.5, ONE, true), finding(89.0, 0.7, SINGLE, true)];
        let facts = [("Rows", "24".to_owned())];
        let lab = Lab { findings: &findings, ..Lab::default() };
        let text = text(&lab, &facts);
        assert!(text.contains("1 of 1 measures of kernels hold") && text.contains("0.5 levels at 89") && text.contains("25.0 %"), "{text}");
        assert!(!text.contains("Across adapters"), "there is only one adapter: {text}");
        let page = page(&lab, &facts).expect("a page");
        assert!(page.contains("<svg") && page.contains("0.5 levels at 89") && page.contains("class=\"good\""));
        let failing = [finding(10.0, 0.0, ONE, false)];
        let lab = Lab { findings: &failing, ..Lab::default() };
        let text = super::text(&lab, &facts);
        assert!(text.contains("0 of 1 measures of kernels hold") && text.contains("exact") && text.contains("FAILS"), "{text}");
        assert!(super::page(&lab, &facts).expect("a page").contains("class=\"bad\""));
    }

    #[test]
    fn what_differs_between_adapters_is_told_and_what_does_not_is_left_out() {
        let differing = [finding(10.0, 0.01, ONE, true), finding(10.0, 0.03, OTHER, true), finding(10.0, 0.5, SINGLE, true)];
        let text = text(&Lab { findings: &differing, ..Lab::default() }, &[]);
        assert!(text.contains("| derivatives: mip | incidence_deg | levels | 0.01 | 0.03 | holds |"), "{text}");
        let alike = [finding(10.0, 0.01, ONE, true), finding(10.0, 0.01, OTHER, true)];
        let text = super::text(&Lab { findings: &alike, ..Lab::default() }, &[]);
        assert!(text.contains("1 of 1 measures are equal") && !text.contains("| levels |"), "{text}");
    }

    #[test]
    fn rows_are_held_to_their_ranges_and_the_smallest_p_comes_first() {
        let row = |statistic: &str, value: f64, motion: &str| Row {
            kind: "hashed".to_owned(),
            view: "flat".to_owned(),
            motion: motion.to_owned(),
            statistic: statistic.to_owned(),
            value,
            low: 0.01,
            high: 1.0,
        };
        let noise: Vec<Row> = (1..=20).map(|i| row("KS p", 0.05 * f64::from(i), "")).collect();
        let motion = [row("flip_rate", 0.25, "sideways"), row("clumping", 0.9, "sideways")];
        let directions = [row("mean", 2.0, "")];
        let text = text(&Lab { noise: &noise, motion: &motion, directions: &directions, ..Lab::default() }, &[]);
        assert!(text.contains("0 of 1 numbers of directions") && text.contains("20 of 20 numbers of hashes"), "{text}");
        assert!(text.contains("| hashed, flat | KS p | 0.05 | 0.01 to 1 | holds |") && !text.contains("| 0.45 |"), "{text}");
        assert!(text.contains("| hashed | 0.25 | 0.9 |") && text.contains("| hashed, flat | mean | 2 | 0.01 to 1 | FAILS |"), "{text}");
    }
}

//! Report of the stability lab: where each kernel is exact, where it bends, and what it costs.

use std::fmt::Write as _;

use anyhow::Result;

use super::html;
use super::numbers::number;
use super::plots::{COLOURS, Curve, CurvePoint, Lines, lines};
use crate::stability::kernels::Finding;

/// Who computed, in the order of their colours, and what they are called.
const SIDES: [(&str, &str); 2] = [("gpu", "GPU"), ("f32", "reference in f32")];

/// What was varied, by one measure: the findings that make a plot.
struct Group<'a> {
    first: &'a Finding,
    findings: Vec<&'a Finding>,
}

/// Groups in the order of the findings.
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

impl Group<'_> {
    fn of<'b>(&'b self, side: &'b str) -> impl Iterator<Item = &'b Finding> {
        self.findings.iter().copied().filter(move |finding| finding.on == side)
    }

    /// The finding of the GPU whose error is largest.
    fn worst(&self) -> &Finding {
        self.of("gpu").max_by(|a, b| a.worst.total_cmp(&b.worst)).unwrap_or(self.first)
    }

    fn passes(&self) -> bool {
        self.findings.iter().all(|finding| finding.pass)
    }

    /// What there is to say: exact, or the largest error and where.
    fn words(&self) -> String {
        let worst = self.worst();
        if worst.worst == 0.0 {
            return "exact".to_owned();
        }
        format!("{} {} at {}", number(worst.worst), worst.unit, number(worst.value))
    }

    /// Largest share of the derived tolerance, percent.
    fn of_tolerance(&self) -> f64 {
        100.0 * self.of("gpu").map(|finding| finding.of_tolerance).fold(0.0, f64::max)
    }

    fn plot(&self) -> Result<Option<String>> {
        let curves: Vec<Curve> = SIDES
            .iter()
            .zip(COLOURS)
            .flat_map(|((side, _), colour)| {
                // The typical error is drawn, too, paler.
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
            // Whatever spans decades; what is not above 0 is left out then.
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

/// Every kernel in a line, as Markdown.
pub(crate) fn text(findings: &[Finding], facts: &[(&str, String)]) -> String {
    let groups = groups(findings);
    let passed = groups.iter().filter(|group| group.passes()).count();
    let mut text = format!("# Stability of kernels\n\n{passed} of {} hold.\n\n", groups.len());
    for (name, value) in facts {
        let _ = writeln!(text, "- {name}: {value}");
    }
    text.push_str(
        "\n| kernel | over | largest error of the GPU | ulp | of the derived tolerance | |\n| --- | --- | --- | --- | --- | --- |\n",
    );
    for group in &groups {
        let Finding { kernel, parameter, measure, .. } = group.first;
        let ulp = group.of("gpu").map(|finding| finding.worst_ulp).fold(0.0, f64::max);
        let holds = if group.passes() { "holds" } else { "**fails**" };
        let (words, share) = (group.words(), group.of_tolerance());
        let _ = writeln!(text, "| {kernel}: {measure} | {parameter} | {words} | {} | {share:.1} % | {holds} |", number(ulp));
    }
    text
}

/// The same with a plot for each that is not exact, as a page.
///
/// # Errors
/// When a plot cannot be drawn.
pub(crate) fn page(findings: &[Finding], facts: &[(&str, String)]) -> Result<String> {
    let groups = groups(findings);
    let failing = groups.iter().filter(|group| !group.passes()).count();
    let answer = "How far the GPU is from the references in f64, at the extremes of every kernel";
    let check = (failing == 0, format!("{} of {} hold", groups.len() - failing, groups.len()));
    let mut body = html::header("stability lab", answer) + &html::verdict("", &[check]) + &html::facts(facts);
    body += "<p>";
    for ((_, name), colour) in SIDES.iter().zip(COLOURS) {
        body += &html::key(colour, &format!("{name}: worst, and paler typical"));
    }
    body += "</p>\n<div class=\"pair\">";
    for group in groups.iter().filter(|group| group.worst().worst > 0.0) {
        let caption =
            html::escape(&format!("{}, {} over {}: {}", group.first.kernel, group.first.measure, group.first.parameter, group.words()));
        body += &html::figure(group.plot()?, &caption);
    }
    Ok(html::page("Stability of kernels", &(body + "</div>\n")))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn finding(value: f64, worst: f64, on: &str, pass: bool) -> Finding {
        Finding {
            kernel: "derivatives".to_owned(),
            parameter: "incidence_deg".to_owned(),
            value,
            on: on.to_owned(),
            adapter: "some".to_owned(),
            rows: 8,
            not_finite: 0,
            differ: usize::from(!pass),
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

    #[test]
    fn the_worst_is_named_with_its_place_and_failures_are_seen() {
        let findings = [finding(10.0, 0.01, "gpu", true), finding(89.0, 0.5, "gpu", true), finding(89.0, 0.7, "f32", true)];
        let facts = [("Adapter", "some".to_owned())];
        let text = text(&findings, &facts);
        assert!(text.contains("1 of 1 hold") && text.contains("0.5 levels at 89") && text.contains("25.0 %"), "{text}");
        let page = page(&findings, &facts).expect("a page");
        assert!(page.contains("<svg") && page.contains("0.5 levels at 89") && page.contains("class=\"good\""));
        let failing = [finding(10.0, 0.0, "gpu", false)];
        let text = super::text(&failing, &facts);
        assert!(text.contains("0 of 1 hold") && text.contains("exact") && text.contains("**fails**"), "{text}");
        assert!(super::page(&failing, &facts).expect("a page").contains("class=\"bad\""));
    }
}

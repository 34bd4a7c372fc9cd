//! What a demo run leaves behind: `metrics.csv`, `manifest.json` and `report.html`, each written whole.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use kernels::error::Error;
use kernels::picture::write_whole;
use serde::Serialize;

use crate::plots::{self, BAR_COLOURS, Marker, Point};

/// How a row's variant was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Mode {
    /// One variant for every tile.
    Forced,
    /// Each tile runs the variant that its classification names.
    Auto,
    /// One kernel that reads the mask at run time.
    Generic,
}

impl Mode {
    /// The name used in files.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Mode::Forced => "forced",
            Mode::Auto => "auto",
            Mode::Generic => "generic",
        }
    }
}

/// Everything that one demo run measured.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct DemoResults {
    /// The adapter's name.
    pub(crate) adapter: String,
    /// Its driver and version.
    pub(crate) driver: String,
    /// Whether it is a software rasteriser: its times are only good for ratios.
    pub(crate) software: bool,
    /// The exact command line.
    pub(crate) command: String,
    /// Version of this program.
    pub(crate) version: String,
    /// The scene's name.
    pub(crate) scene: String,
    /// The camera's name.
    pub(crate) camera: String,
    /// Pixels, width and height.
    pub(crate) size: [u32; 2],
    /// Seeds per stochastic variant.
    pub(crate) seeds: u32,
    /// Wall-clock time of the whole run, seconds.
    pub(crate) seconds: f64,
    /// A row per variant.
    pub(crate) rows: Vec<VariantRow>,
    /// The fetches promised for each flavour against those counted.
    pub(crate) golden: Vec<GoldenRow>,
    /// Pictures beside the report.
    pub(crate) pictures: Vec<PictureEntry>,
}

/// What one variant costs and how far it is from the reference.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct VariantRow {
    /// `vt+near-cliff` and the like; `auto`; `generic`.
    pub(crate) name: String,
    /// How the variant was chosen.
    pub(crate) mode: Mode,
    /// The flavours forced, one bit each; 0 for automatic choice and the generic kernel.
    pub(crate) mask: u8,
    /// Texture samples per pixel that the design promises for the mask.
    pub(crate) promised_fetches: Option<u32>,
    /// Texture samples counted in the shader, mean over terrain pixels.
    pub(crate) fetches_per_px: f64,
    /// Median device time of each pass, milliseconds.
    pub(crate) gpu_ms: BTreeMap<String, f64>,
    /// Mean over seeds, pixels and channels of linear albedo, less that of the exact blend of the same flavours.
    pub(crate) bias: f64,
    /// Standard error of `bias`.
    pub(crate) bias_standard_error: f64,
    /// Variance over seeds of linear albedo, mean over pixels and channels.
    pub(crate) variance: f64,
    /// The variance that the theory of selection predicts.
    pub(crate) variance_theory: f64,
    /// Root mean squared error in linear albedo of a single frame against the 96-fetch blend.
    pub(crate) rmse_reference: f64,
}

/// A flavour's fetches, promised and counted.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct GoldenRow {
    /// The flavour's name.
    pub(crate) flavour: String,
    /// The promise, a number or a range.
    pub(crate) promised: String,
    /// Mean over terrain pixels as counted in the shader.
    pub(crate) counted: f64,
    /// Whether the count keeps the promise.
    pub(crate) agrees: bool,
}

/// A picture in the folder of the report.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct PictureEntry {
    /// Name of a PNG file in the folder.
    pub(crate) file: String,
    /// A few words.
    pub(crate) title: String,
    /// A sentence.
    pub(crate) caption: String,
}

/// Writes `metrics.csv`, `manifest.json` and `report.html` into `out_dir`, where the pictures already are.
///
/// # Errors
/// When a picture cannot be read or a file cannot be written.
pub(crate) fn write(out_dir: &Path, results: &DemoResults) -> Result<()> {
    write_bytes(out_dir, "metrics.csv", &metrics_csv(results)?)?;
    let mut manifest = serde_json::to_vec_pretty(results).context("the results cannot be put into JSON")?;
    manifest.push(b'\n');
    write_bytes(out_dir, "manifest.json", &manifest)?;
    write_bytes(out_dir, "report.html", html(out_dir, results)?.as_bytes())
}

fn write_bytes(out_dir: &Path, name: &str, bytes: &[u8]) -> Result<()> {
    let file = out_dir.join(name);
    write_whole(&file, |temporary| std::fs::write(temporary, bytes).map_err(|source| Error::File { file: file.clone(), source }))
        .with_context(|| format!("cannot write {name}"))
}

/// A row per number: `scene,camera,variant,mode,metric,unit,value`.
fn metrics_csv(results: &DemoResults) -> Result<Vec<u8>> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record(["scene", "camera", "variant", "mode", "metric", "unit", "value"])?;
    for row in &results.rows {
        let mut put = |metric: &str, unit: &str, value: f64| {
            let mode = row.mode.name();
            table.write_record([&results.scene, &results.camera, &row.name, mode, metric, unit, &value.to_string()])
        };
        if let Some(promised) = row.promised_fetches {
            put("promised_fetches_per_px", "samples", f64::from(promised))?;
        }
        put("fetches_per_px", "samples", row.fetches_per_px)?;
        for (pass, ms) in &row.gpu_ms {
            put(&format!("gpu_ms {pass}"), "ms", *ms)?;
        }
        put("bias", "linear albedo", row.bias)?;
        put("bias_standard_error", "linear albedo", row.bias_standard_error)?;
        put("variance", "linear albedo squared", row.variance)?;
        put("variance_theory", "linear albedo squared", row.variance_theory)?;
        put("rmse_reference", "linear albedo", row.rmse_reference)?;
    }
    Ok(table.into_inner()?)
}

/// How many times the error of automatic choice a forced variant may have to count as equally good.
const ERROR_FACTOR: f64 = 1.1;

/// The frame's passes in their order; what else was timed follows.
const PASSES: [&str; 5] = ["geometry", "classification", "page requests", "shading", "lighting"];

impl VariantRow {
    fn shading_ms(&self) -> f64 {
        self.gpu_ms.get("shading").copied().unwrap_or(f64::NAN)
    }

    fn is_flavour(&self) -> bool {
        self.mode == Mode::Forced && self.mask.count_ones() == 1
    }

    /// Whether chance had a part: deterministic variants have no bias and no variance to tell of.
    fn is_stochastic(&self) -> bool {
        self.variance > 0.0 || self.variance_theory > 0.0
    }
}

impl DemoResults {
    fn of_mode(&self, mode: Mode) -> Option<&VariantRow> {
        self.rows.iter().find(|r| r.mode == mode)
    }

    fn flavour(&self, name: &str) -> Option<&VariantRow> {
        self.rows.iter().find(|r| r.is_flavour() && r.name == name)
    }
}

/// The five characters with a meaning in HTML, as entities.
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

/// Indices of the points that no other dominates (is at most as large in both and smaller in one), by rising x.
/// What is not finite is never among them.
fn pareto_front(points: &[(f64, f64)]) -> Vec<usize> {
    let finite = |p: &(f64, f64)| p.0.is_finite() && p.1.is_finite();
    let dominates = |a: &(f64, f64), b: &(f64, f64)| a.0 <= b.0 && a.1 <= b.1 && (a.0 < b.0 || a.1 < b.1);
    let mut front: Vec<usize> =
        (0..points.len()).filter(|&i| finite(&points[i]) && !points.iter().any(|p| finite(p) && dominates(p, &points[i]))).collect();
    front.sort_by(|&a, &b| points[a].0.total_cmp(&points[b].0).then(a.cmp(&b)));
    front
}

/// How the speed of what takes `ms` compares with what takes `other_ms`: "4.2 times as fast as"; `None` where a time is missing.
fn speed(ms: f64, other_ms: f64) -> Option<String> {
    let ratio = other_ms / ms;
    if !(ms > 0.0 && other_ms > 0.0 && ratio.is_finite()) {
        return None;
    }
    Some(match ratio {
        r if (0.98..=1.02).contains(&r) => "as fast as".to_owned(),
        r if r > 1.0 => format!("{r:.2} times as fast as"),
        r => format!("{:.2} times as slow as", 1.0 / r),
    })
}

/// The forced variant with the fewest fetches whose error is at most [`ERROR_FACTOR`] times `error`.
fn cheapest_as_good(rows: &[VariantRow], error: f64) -> Option<&VariantRow> {
    rows.iter()
        .filter(|r| r.mode == Mode::Forced && r.rmse_reference <= ERROR_FACTOR * error)
        .min_by(|a, b| a.fetches_per_px.total_cmp(&b.fetches_per_px))
}

/// One or two sentences, from the numbers alone.
fn verdict(results: &DemoResults) -> String {
    let Some(auto) = results.of_mode(Mode::Auto) else {
        return "Automatic choice was not measured, so there is nothing to compare the variants with.".to_owned();
    };
    let against =
        |row: Option<&VariantRow>, name: &str| row.and_then(|r| speed(auto.shading_ms(), r.shading_ms())).map(|s| format!("{s} {name}"));
    let speeds: Vec<String> =
        [against(results.flavour("splat"), "full splat everywhere"), against(results.of_mode(Mode::Generic), "the generic kernel")]
            .into_iter()
            .flatten()
            .collect();
    let speeds = if speeds.is_empty() { String::new() } else { format!("; its shading is {}", speeds.join(" and ")) };
    let mut text = format!(
        "Automatic choice takes {:.1} fetches per pixel for an RMSE of {:.4} against the 96-fetch blend{speeds}.",
        auto.fetches_per_px, auto.rmse_reference
    );
    text += &match cheapest_as_good(&results.rows, auto.rmse_reference) {
        Some(row) => {
            let time = speed(row.shading_ms(), auto.shading_ms()).map_or_else(String::new, |s| format!(", {s} automatic choice"));
            format!(
                " Of the variants forced on every tile, the cheapest with an RMSE at most {ERROR_FACTOR} times that is {}: {:.1} fetches, RMSE {:.4}{time}.",
                row.name, row.fetches_per_px, row.rmse_reference
            )
        }
        None => format!(" No variant forced on every tile comes within {ERROR_FACTOR} times that error."),
    };
    text
}

/// What the run says about itself: promises kept, bias and variance as predicted.
fn checks(results: &DemoResults) -> Vec<(bool, String)> {
    let mut checks = Vec::new();
    if !results.golden.is_empty() {
        let kept = results.golden.iter().filter(|g| g.agrees).count();
        let all = results.golden.len();
        checks.push((kept == all, format!("{kept} of {all} flavours take the fetches they promise")));
    }
    let stochastic: Vec<&VariantRow> = results.rows.iter().filter(|r| r.is_stochastic()).collect();
    let largest = stochastic
        .iter()
        .map(|r| (r.bias.abs() / r.bias_standard_error, r.name.as_str()))
        .filter(|(z, _)| z.is_finite())
        .max_by(|a, b| a.0.total_cmp(&b.0));
    if let Some((z, name)) = largest {
        // 4.2 standard errors: level 0.1 % over 33 rows after Sidak, whose inequality also holds for rows that share flavours.
        checks.push((
            z < 4.2,
            format!("largest bias of {} stochastic rows: {z:.1} standard errors ({name}); at most 4.2 expected", stochastic.len()),
        ));
    }
    let ratios: Vec<f64> = stochastic.iter().map(|r| r.variance / r.variance_theory).filter(|r| r.is_finite()).collect();
    if let (Some(low), Some(high)) = (ratios.iter().copied().min_by(f64::total_cmp), ratios.iter().copied().max_by(f64::total_cmp)) {
        let range = if high - low < 0.005 { format!("{high:.2}") } else { format!("{low:.2} to {high:.2}") };
        checks.push((low > 0.8 && high < 1.25, format!("variance measured is {range} times the variance predicted; 0.8 to 1.25 expected")));
    }
    checks
}

fn html(out_dir: &Path, results: &DemoResults) -> Result<String> {
    let mut page = String::new();
    let title = format!("Scree: {}, {}", results.scene, results.camera);
    write!(
        page,
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<meta name=\"viewport\" content=\"width=device-width\">\n\
         <title>{}</title>\n<style>{}</style>\n</head>\n<body>\n<main>\n",
        escape(&title),
        include_str!("report.css")
    )?;
    header(&mut page, results)?;
    setup(&mut page, results)?;
    cost_and_error(&mut page, results)?;
    passes(&mut page, results)?;
    golden_table(&mut page, results)?;
    variants_table(&mut page, results)?;
    gallery(&mut page, out_dir, results)?;
    write!(page, "</main>\n<script>{}</script>\n</body>\n</html>\n", include_str!("report.js"))?;
    Ok(page)
}

fn header(page: &mut String, results: &DemoResults) -> Result<()> {
    writeln!(page, "<header><p class=\"kicker\">Scree &middot; terrain material blends, cost and error</p>")?;
    writeln!(page, "<h1>Scene {}, camera {}</h1></header>", escape(&results.scene), escape(&results.camera))?;
    writeln!(page, "<section class=\"verdict\"><p>{}</p>\n<ul>", escape(&verdict(results)))?;
    for (good, text) in checks(results) {
        writeln!(page, "<li class=\"{}\">{}</li>", if good { "good" } else { "bad" }, escape(&text))?;
    }
    writeln!(page, "</ul></section>")?;
    Ok(())
}

fn setup(page: &mut String, results: &DemoResults) -> Result<()> {
    let [width, height] = results.size;
    let adapter = format!("{}{}", results.adapter, if results.software { " (software)" } else { "" });
    let facts = [
        ("Adapter", adapter),
        ("Driver", results.driver.clone()),
        ("Picture", format!("{width} \u{d7} {height} pixels")),
        ("Seeds", format!("{} for each stochastic variant, at most 3 for the others", results.seeds)),
        ("Version", results.version.clone()),
        ("Run time", format!("{:.0} s", results.seconds)),
        ("Command", results.command.clone()),
    ];
    writeln!(page, "<section><h2>What was measured, and how</h2>")?;
    if results.software {
        writeln!(
            page,
            "<p class=\"note\"><b>This is a software adapter.</b> Its times say nothing about a GPU: compare them with one another, as ratios.</p>"
        )?;
    }
    writeln!(page, "<div class=\"two\"><dl class=\"facts\">")?;
    for (name, value) in facts {
        let value = if name == "Command" { format!("<code>{}</code>", escape(&value)) } else { escape(&value) };
        writeln!(page, "<dt>{name}</dt><dd>{value}</dd>")?;
    }
    writeln!(page, "</dl><dl class=\"terms\">")?;
    let terms = [
        ("Fetches per pixel", "texture samples that the shader really took, counted while it ran; mean over terrain pixels."),
        (
            "RMSE",
            "root mean squared difference in linear albedo between a single frame and the 96-fetch blend \
             (three projections, four materials, two tilings, nothing left to chance), over terrain pixels and channels.",
        ),
        (
            "Bias",
            "mean over seeds, pixels and channels of linear albedo, less that of the exact blend of the same flavours; \u{b1} its standard error.",
        ),
        (
            "Variance",
            "of a pixel's linear albedo over seeds, mean over pixels and channels, beside what the theory of random selection predicts.",
        ),
        (
            "GPU time",
            "of each pass, by timestamp queries; the fastest over the row's pictures, since other work on the machine only ever adds.",
        ),
        (
            "Forced, auto, generic",
            "one variant on every tile; for each tile the variant its classification names; one kernel that reads the mask at run time.",
        ),
    ];
    for (name, value) in terms {
        writeln!(page, "<dt>{name}</dt><dd>{}</dd>", escape(value))?;
    }
    writeln!(page, "</dl></div></section>")?;
    Ok(())
}

fn points(rows: &[VariantRow], cost: fn(&VariantRow) -> f64) -> Vec<Point> {
    // A cost of 0 means that nothing was measured (no timestamps, say): it must not win.
    let places: Vec<(f64, f64)> = rows.iter().map(|r| (if cost(r) > 0.0 { cost(r) } else { f64::NAN }, r.rmse_reference)).collect();
    let front = pareto_front(&places);
    let point = |(index, row): (usize, &VariantRow)| Point {
        label: row.name.clone(),
        x: places[index].0,
        y: places[index].1,
        marker: match row.mode {
            Mode::Auto => Marker::Auto,
            Mode::Generic => Marker::Generic,
            Mode::Forced if row.is_flavour() => Marker::Flavour,
            Mode::Forced => Marker::Combination,
        },
        front: front.contains(&index),
    };
    rows.iter().enumerate().map(point).collect()
}

fn figure(page: &mut String, svg: Option<String>, caption: &str) -> Result<()> {
    let svg = svg.unwrap_or_else(|| "<p class=\"note\">Nothing to plot: the adapter gave no such numbers.</p>".to_owned());
    writeln!(page, "<figure class=\"plot\">{svg}<figcaption>{caption}</figcaption></figure>")?;
    Ok(())
}

fn cost_and_error(page: &mut String, results: &DemoResults) -> Result<()> {
    const ERROR: &str = "RMSE against the 96-fetch blend (linear albedo)";
    const LEGEND: &str = "<span class=\"key auto\"></span>auto <span class=\"key generic\"></span>generic \
        <span class=\"key flavour\"></span>one flavour <span class=\"key combination\"></span>several flavours \
        <span class=\"key front\"></span>Pareto front: nothing is both cheaper and closer (more names in the table)";
    writeln!(page, "<section><h2>Cost against error</h2>")?;
    let svg = plots::pareto(
        &points(&results.rows, |r| r.fetches_per_px),
        "RMSE over fetches per pixel, a point per variant",
        "fetches per pixel (counted, logarithmic scale)",
        ERROR,
    )?;
    figure(page, svg, LEGEND)?;
    let unit = if results.software { "ms on a software adapter: only ratios count" } else { "ms" };
    let svg = plots::pareto(
        &points(&results.rows, VariantRow::shading_ms),
        "RMSE over shading time, a point per variant",
        &format!("shading time per frame ({unit}, logarithmic scale)"),
        ERROR,
    )?;
    figure(page, svg, LEGEND)?;
    writeln!(page, "</section>")?;
    Ok(())
}

fn passes(page: &mut String, results: &DemoResults) -> Result<()> {
    let shown: Vec<&VariantRow> =
        [results.of_mode(Mode::Auto), results.of_mode(Mode::Generic), results.flavour("splat")].into_iter().flatten().collect();
    let mut names: Vec<&str> = PASSES.into_iter().filter(|p| shown.iter().any(|r| r.gpu_ms.contains_key(*p))).collect();
    for pass in shown.iter().flat_map(|r| r.gpu_ms.keys()) {
        if !names.contains(&pass.as_str()) {
            names.push(pass);
        }
    }
    let bars: Vec<(String, Vec<f64>)> =
        shown.iter().map(|r| (r.name.clone(), names.iter().map(|p| r.gpu_ms.get(*p).copied().unwrap_or(0.0)).collect())).collect();
    writeln!(page, "<section><h2>Time per pass</h2>")?;
    let unit = if results.software { "ms, software adapter: only ratios count" } else { "ms" };
    let svg = plots::bars(&bars, "GPU time of each pass", &format!("GPU time per frame ({unit})"))?;
    let mut legend = String::new();
    for (index, name) in names.iter().enumerate() {
        let (r, g, b) = BAR_COLOURS[index % BAR_COLOURS.len()];
        write!(legend, "<span class=\"key\" style=\"background:rgb({r},{g},{b})\"></span>{} ", escape(name))?;
    }
    figure(page, svg, &legend)?;
    writeln!(page, "</section>")?;
    Ok(())
}

fn golden_table(page: &mut String, results: &DemoResults) -> Result<()> {
    writeln!(
        page,
        "<section><h2>Fetches promised and counted</h2>\n<table class=\"narrow\"><thead><tr><th>Flavour</th><th class=\"n\">Promised</th>\
         <th class=\"n\">Counted</th><th></th></tr></thead><tbody>"
    )?;
    for row in &results.golden {
        let (class, word) = if row.agrees { ("good", "agrees") } else { ("bad", "differs") };
        writeln!(
            page,
            "<tr><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{:.2}</td><td class=\"{class}\">{word}</td></tr>",
            escape(&row.flavour),
            escape(&row.promised.replace('-', "\u{2013}")),
            row.counted
        )?;
    }
    writeln!(page, "</tbody></table></section>")?;
    Ok(())
}

/// A number for people and its value for the sorting script; a dash where there is none.
fn cell(value: f64, shown: &str) -> String {
    if value.is_finite() {
        format!("<td class=\"n\" data-v=\"{value:e}\">{shown}</td>")
    } else {
        "<td class=\"n\">\u{2013}</td>".to_owned()
    }
}

fn variants_table(page: &mut String, results: &DemoResults) -> Result<()> {
    let splat_ms = results.flavour("splat").map_or(f64::NAN, VariantRow::shading_ms);
    let by_fetches = pareto_front(&results.rows.iter().map(|r| (r.fetches_per_px, r.rmse_reference)).collect::<Vec<_>>());
    writeln!(
        page,
        "<section><h2>All variants</h2>\n<p>Click a heading to sort. Marked rows lie on the Pareto front of fetches and RMSE.</p>"
    )?;
    writeln!(page, "<table class=\"all\"><thead><tr>")?;
    let columns = [
        ("Variant", ""),
        ("Fetches", "per pixel"),
        ("Promised", "sum of flavours"),
        ("Shading", "ms"),
        ("Ratio", "to splat"),
        ("Bias \u{b1} s.e.", "10\u{207b}\u{b3} albedo"),
        ("Variance", "10\u{207b}\u{b3} albedo\u{b2}"),
        ("Theory", "10\u{207b}\u{b3} albedo\u{b2}"),
        ("RMSE", "albedo"),
    ];
    for (name, unit) in columns {
        let class = if name == "Variant" { "" } else { " class=\"n\"" };
        writeln!(page, "<th{class}>{name}<small>{unit}</small></th>")?;
    }
    writeln!(page, "</tr></thead><tbody>")?;
    for (index, row) in results.rows.iter().enumerate() {
        let chance = |value: f64| if row.is_stochastic() { value } else { f64::NAN };
        let front = by_fetches.contains(&index);
        let class = match (row.mode, front) {
            (Mode::Forced, false) => "",
            (Mode::Forced, true) => " class=\"front\"",
            (_, false) => " class=\"chosen\"",
            (_, true) => " class=\"chosen front\"",
        };
        write!(page, "<tr{class}><td>{}</td>", escape(&row.name))?;
        let promised = row.promised_fetches.map_or(f64::NAN, f64::from);
        let ms = row.shading_ms();
        for (value, shown) in [
            (row.fetches_per_px, format!("{:.2}", row.fetches_per_px)),
            (promised, format!("{promised:.0}")),
            (ms, format!("{ms:.3}")),
            (ms / splat_ms, format!("{:.3}", ms / splat_ms)),
            (chance(row.bias), format!("{:+.3} \u{b1} {:.3}", 1e3 * row.bias, 1e3 * row.bias_standard_error)),
            (chance(row.variance), format!("{:.4}", 1e3 * row.variance)),
            (chance(row.variance_theory), format!("{:.4}", 1e3 * row.variance_theory)),
            (row.rmse_reference, format!("{:.4}", row.rmse_reference)),
        ] {
            page.push_str(&cell(value, &shown));
        }
        writeln!(page, "</tr>")?;
    }
    writeln!(page, "</tbody></table></section>")?;
    Ok(())
}

fn gallery(page: &mut String, out_dir: &Path, results: &DemoResults) -> Result<()> {
    if results.pictures.is_empty() {
        return Ok(());
    }
    writeln!(page, "<section><h2>Pictures</h2>\n<p>Tone-mapped, one frame each. Click one to enlarge it.</p>\n<div class=\"sheet\">")?;
    let [width, height] = results.size;
    for picture in &results.pictures {
        let file = out_dir.join(&picture.file);
        let bytes =
            std::fs::read(&file).with_context(|| format!("cannot read the picture {} for the report: was it moved?", file.display()))?;
        let (title, caption) = (escape(&picture.title), escape(&picture.caption));
        writeln!(
            page,
            "<figure><img alt=\"{title}\" width=\"{width}\" height=\"{height}\" src=\"data:image/png;base64,{}\">\
             <figcaption><b>{title}</b> {caption}</figcaption></figure>",
            STANDARD.encode(bytes)
        )?;
    }
    writeln!(page, "</div></section>")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(name: &str, mode: Mode, mask: u8, fetches: f64, rmse: f64, ms: f64) -> VariantRow {
        VariantRow {
            name: name.to_owned(),
            mode,
            mask,
            promised_fetches: (mask > 0).then_some(4),
            fetches_per_px: fetches,
            gpu_ms: [("shading".to_owned(), ms)].into(),
            bias: 0.0,
            bias_standard_error: 0.0,
            variance: 0.0,
            variance_theory: 0.0,
            rmse_reference: rmse,
        }
    }

    fn results(rows: Vec<VariantRow>) -> DemoResults {
        DemoResults {
            adapter: "<adapter> & \"co\"".to_owned(),
            driver: String::new(),
            software: true,
            command: "demo --out 'a<b'".to_owned(),
            version: "0".to_owned(),
            scene: "one, two".to_owned(),
            camera: "c".to_owned(),
            size: [8, 4],
            seeds: 2,
            seconds: 1.0,
            rows,
            golden: Vec::new(),
            pictures: Vec::new(),
        }
    }

    fn three() -> DemoResults {
        results(vec![
            row("auto", Mode::Auto, 0, 10.0, 0.02, 5.0),
            row("generic", Mode::Generic, 0, 10.0, 0.02, 10.0),
            row("vt", Mode::Forced, 1, 4.0, 0.05, 2.0),
            row("splat", Mode::Forced, 16, 48.0, 0.01, 20.0),
        ])
    }

    #[test]
    fn front_keeps_what_nothing_dominates() {
        let points = [(8.0, 1.0), (2.0, 5.0), (4.0, 3.0), (f64::NAN, 0.0), (4.0, 3.0)];
        assert_eq!(pareto_front(&points), [1, 2, 4, 0]);
        // Negative controls: dominated in both, and in one with the other equal.
        for dominated in [(5.0, 4.0), (4.0, 3.5), (4.5, 3.0)] {
            let with = [&points[..], &[dominated]].concat();
            assert_eq!(pareto_front(&with), [1, 2, 4, 0], "{dominated:?}");
        }
        assert!(pareto_front(&[&points[..], &[(3.0, 4.0)]].concat()).contains(&5));
    }

    #[test]
    fn markup_in_names_stays_text() {
        assert_eq!(escape("<a href=\"x\">'&'</a>"), "&lt;a href=&quot;x&quot;&gt;&#39;&amp;&#39;&lt;/a&gt;");
        assert_eq!(escape("far-atlas \u{b1} 1"), "far-atlas \u{b1} 1");
        let page = html(Path::new("."), &three()).expect("no files needed");
        assert!(page.contains("&lt;adapter&gt; &amp; &quot;co&quot;") && page.contains("a&lt;b"));
        assert!(!page.contains("<adapter>") && !page.contains("a<b"));
    }

    #[test]
    fn metrics_are_tidy_rows() {
        let csv = String::from_utf8(metrics_csv(&three()).expect("written")).expect("text");
        let mut lines = csv.lines();
        assert_eq!(lines.next(), Some("scene,camera,variant,mode,metric,unit,value"));
        // A scene with a comma is quoted; auto has no promise, forced variants have one.
        assert_eq!(lines.next(), Some("\"one, two\",c,auto,auto,fetches_per_px,samples,10"));
        assert!(csv.contains("\"one, two\",c,vt,forced,gpu_ms shading,ms,2\n"));
        assert_eq!(csv.lines().filter(|l| l.contains("promised")).count(), 2);
        assert_eq!(csv.lines().count(), 1 + 4 * 7 + 2);
        let mut reader = csv::Reader::from_reader(csv.as_bytes());
        assert!(reader.records().all(|r| r.is_ok_and(|r| r.len() == 7 && r[6].parse::<f64>().is_ok())));
    }

    #[test]
    fn verdict_follows_the_numbers() {
        let text = verdict(&three());
        assert!(text.contains("4.00 times as fast as full splat everywhere and 2.00 times as fast as the generic kernel"), "{text}");
        assert!(text.contains("is splat: 48.0 fetches") && text.contains("4.00 times as slow as automatic choice"), "{text}");
        // A cheaper variant within the factor takes its place; one just outside does not.
        let mut other = three();
        other.rows[2].rmse_reference = 0.0219;
        assert!(verdict(&other).contains("is vt: 4.0 fetches"));
        other.rows[2].rmse_reference = 0.0221;
        assert!(verdict(&other).contains("is splat"));
        other.rows.retain(|r| r.name != "splat");
        assert!(verdict(&other).contains("No variant forced"));
        assert_eq!(speed(0.0, 1.0), None);
        assert_eq!(speed(f64::NAN, 1.0), None);
    }

    #[test]
    fn checks_see_a_broken_promise_and_a_bias() {
        let mut broken = three();
        broken.golden.push(GoldenRow { flavour: "vt".to_owned(), promised: "4".to_owned(), counted: 5.0, agrees: false });
        (broken.rows[0].variance, broken.rows[0].variance_theory) = (2e-4, 2e-4);
        (broken.rows[0].bias, broken.rows[0].bias_standard_error) = (1e-3, 1e-4);
        let good = |r: &DemoResults| checks(r).iter().map(|c| c.0).collect::<Vec<_>>();
        assert_eq!(good(&broken), [false, false, true]);
        broken.golden[0].agrees = true;
        broken.rows[0].bias = 1e-5;
        assert_eq!(good(&broken), [true, true, true]);
        broken.rows[0].variance = 4e-4;
        assert_eq!(good(&broken), [true, true, false]);
    }
}

//! What a demo run leaves behind: `metrics.csv`, `manifest.json` and `report.html`, each written whole.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;

use super::checks::{self, GoldenRow};
use super::html::{self, BIAS_TERM, CHOICE_TERM, FETCHES_TERM, VARIANCE_TERM, escape};
use super::numbers::{pareto_front, speed};
use super::plots::{self, Marker, Point};
use super::write_bytes;

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
    let stochastic = || results.rows.iter().filter(|r| r.is_stochastic());
    [
        checks::promises(&results.golden),
        checks::bias(stochastic().map(|r| (r.bias, r.bias_standard_error, r.name.as_str())), None),
        checks::variance(stochastic().map(|r| (r.variance, r.variance_theory, None)), None),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn html(out_dir: &Path, results: &DemoResults) -> Result<String> {
    let mut body = html::header(
        "Scree \u{b7} terrain material blends, cost and error",
        &format!("Scene {}, camera {}", results.scene, results.camera),
    );
    body += &html::verdict(&verdict(results), &checks(results));
    body += &setup(results);
    cost_and_error(&mut body, results)?;
    passes(&mut body, results)?;
    body += &html::promises(&results.golden);
    variants_table(&mut body, results)?;
    gallery(&mut body, out_dir, results)?;
    Ok(html::page(&format!("Scree: {}, {}", results.scene, results.camera), &body))
}

fn setup(results: &DemoResults) -> String {
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
    let terms = [
        FETCHES_TERM,
        (
            "RMSE",
            "root mean squared difference in linear albedo between a single frame and the 96-fetch blend \
             (three projections, four materials, two tilings, nothing left to chance), over terrain pixels and channels.",
        ),
        BIAS_TERM,
        VARIANCE_TERM,
        (
            "GPU time",
            "of each pass, by timestamp queries; the fastest over the row's pictures, since other work on the machine only ever adds.",
        ),
        CHOICE_TERM,
    ];
    format!(
        "<section><h2>What was measured, and how</h2>\n{}<div class=\"two\">{}{}</div></section>\n",
        if results.software { html::SOFTWARE_NOTE } else { "" },
        html::facts(&facts),
        html::terms(&terms)
    )
}

fn points(rows: &[VariantRow], cost: fn(&VariantRow) -> f64) -> Vec<Point> {
    // A cost of 0 means that nothing was measured (no timestamps, say): it must not win.
    let places: Vec<(f64, f64)> = rows.iter().map(|r| (if cost(r) > 0.0 { cost(r) } else { f64::NAN }, r.rmse_reference)).collect();
    let front = pareto_front(&places);
    let point = |(index, row): (usize, &VariantRow)| Point {
        label: row.name.clone(),
        group: row.name.clone(),
        half: [0.0; 2],
        colour: None,
        hint: None,
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

fn cost_and_error(page: &mut String, results: &DemoResults) -> Result<()> {
    const ERROR: &str = "RMSE against the 96-fetch blend (linear albedo)";
    writeln!(page, "<section><h2>Cost against error</h2>")?;
    let svg = plots::pareto(
        &points(&results.rows, |r| r.fetches_per_px),
        "RMSE over fetches per pixel, a point per variant",
        "fetches per pixel (counted, logarithmic scale)",
        ERROR,
    )?;
    page.push_str(&html::figure(svg, plots::PARETO_LEGEND));
    let unit = if results.software { "ms on a software adapter: only ratios count" } else { "ms" };
    let svg = plots::pareto(
        &points(&results.rows, VariantRow::shading_ms),
        "RMSE over shading time, a point per variant",
        &format!("shading time per frame ({unit}, logarithmic scale)"),
        ERROR,
    )?;
    page.push_str(&html::figure(svg, plots::PARETO_LEGEND));
    writeln!(page, "</section>")?;
    Ok(())
}

fn passes(page: &mut String, results: &DemoResults) -> Result<()> {
    let shown = [results.of_mode(Mode::Auto), results.of_mode(Mode::Generic), results.flavour("splat")].into_iter().flatten();
    let times: Vec<(String, BTreeMap<String, f64>)> = shown.map(|r| (r.name.clone(), r.gpu_ms.clone())).collect();
    writeln!(page, "<section><h2>Time per pass</h2>\n{}</section>", plots::passes(&times, results.software)?)?;
    Ok(())
}

fn variants_table(page: &mut String, results: &DemoResults) -> Result<()> {
    let splat_ms = results.flavour("splat").map_or(f64::NAN, VariantRow::shading_ms);
    let by_fetches = pareto_front(&results.rows.iter().map(|r| (r.fetches_per_px, r.rmse_reference)).collect::<Vec<_>>());
    writeln!(
        page,
        "<section><h2>All variants</h2>\n<p>Click a heading to sort. Marked rows lie on the Pareto front of fetches and RMSE.</p>"
    )?;
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
    let head = html::head(columns.map(|(name, unit)| (name, unit, name != "Variant", String::new())));
    writeln!(page, "<table class=\"all\">{head}<tbody>")?;
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
            page.push_str(&html::cell(value, &shown, ""));
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
    for picture in &results.pictures {
        let file = out_dir.join(&picture.file);
        let bytes =
            std::fs::read(&file).with_context(|| format!("cannot read the picture {} for the report: was it moved?", file.display()))?;
        let source = format!("data:image/png;base64,{}", STANDARD.encode(bytes));
        page.push_str(&html::picture(&picture.title, &picture.caption, "", results.size, &source));
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
    fn markup_in_names_stays_text() {
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

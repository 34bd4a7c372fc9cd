//! What a demo run leaves behind: `metrics.csv`, `manifest.json` and `report.html`, each written whole.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use kernels::error::Error;
use kernels::picture::write_whole;
use serde::Serialize;

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
    write_bytes(out_dir, "report.html", b"<!doctype html><title>Scree</title>")
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

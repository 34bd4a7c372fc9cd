//! Invented runs for tests of reports in their different forms. Their numbers come from formulas, so the right answers are known.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use kernels::shading::Estimator;
use kernels::shared::hash::{pcg4d, unit2};
use kernels::shared::moments::Moments;
use kernels::variant::{Flavour, Variant};

use super::numbers::Estimate;
use super::{RunData, Verdict};
use crate::definition::{Definition, Expectation};
use crate::metrics::{self, Signals};
use crate::row::Row;
use crate::store::RunPicture;

/// Number of tables of a simulation. Each table has its own seed.
pub(super) const TABLES: u32 = 1000;

/// A normal deviate of mean 0 and variance 1 (Box and Muller).
fn normal(table: u32, point: u32, sample: u32, salt: u32) -> f64 {
    let h = pcg4d([table, point, sample, salt]).map(|h| (f64::from(h) + 0.5) / 4_294_967_296.0);
    (-2.0 * h[0].ln()).sqrt() * (std::f64::consts::TAU * h[1]).cos()
}

/// Returns the mean of `samples` normal random numbers and its standard error from their scatter. The numbers have the given mean and standard
/// deviation. `at`: table, point and salt of the random numbers.
pub(super) fn measured(mean: f64, deviation: f64, samples: u32, at: [u32; 3]) -> Estimate {
    let mut moments = Moments::<f64>::new();
    (0..samples).for_each(|sample| moments.add([mean + deviation * normal(at[0], at[1], sample, at[2]), 0.0]));
    Estimate { value: moments.mean(), error: moments.standard_error().expect("several samples"), freedom: f64::from(samples - 1) }
}

/// A unique folder. It is removed when this value is dropped, unless the variable `SCREE_REPORTS` names a folder in which to keep it.
pub(super) struct Folder {
    path: PathBuf,
    keep: bool,
}

impl Folder {
    pub(super) fn new(name: &str) -> Folder {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        let kept = std::env::var_os("SCREE_REPORTS");
        let unique = format!("scree-report-{}-{}-{name}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let path = kept.as_ref().map_or_else(|| std::env::temp_dir().join(unique), |folder| Path::new(folder).join(name));
        // The folder may contain files of an earlier test run.
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).expect("a temporary folder can be made");
        Folder { path, keep: kept.is_some() }
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.keep {
            // An error is ignored, because the operating system removes temporary folders later.
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}

/// Returns a definition with the required keys and the keys in `text`.
pub(super) fn definition(text: &str) -> Definition {
    toml::from_str(&format!("name = \"fake\"\nquestion = \"Which <blend> is cheapest & good?\"\nsize = [480, 270]\n{text}"))
        .expect("a definition")
}

pub(super) const NOISES: [&str; 6] = ["hashed", "hashed-anisotropic", "white", "interleaved-gradient", "blue", "spatio-temporal-blue"];

/// The numbers of the lit picture are those of albedo times this factor. Numbers without a unit, in decibels or in pixels are the same for both
/// signals.
pub(super) const LIT: f64 = 1.25;

/// Returns the cell size of a noise, in pixels. The formulas of flips, clumping, spectra, added change and perceived noise depend on it.
fn cell(noise: &str) -> f64 {
    [1.6, 1.3, 0.2, 0.35, 0.3, 0.5][NOISES.iter().position(|n| *n == noise).unwrap_or(0)]
}

/// Degrees of freedom of the standard errors of bias and of the mean squared difference from the exact blend. Rows of other metrics do not give
/// degrees of freedom.
pub(super) const FREEDOM: f64 = 90.0;

/// Collects the invented rows of a run.
pub(super) struct Rows {
    pub(super) rows: Vec<Row>,
    pub(super) times: Vec<Row>,
}

impl Rows {
    pub(super) fn new() -> Rows {
        Rows { rows: Vec::new(), times: Vec::new() }
    }

    /// Adds a number. If the metric exists for each signal, rows for albedo and for the lit picture are added, unless `base` specifies one of the
    /// two.
    pub(super) fn put(&mut self, base: &Row, metric: &str, unit: &str, value: f64, error: Option<f64>) {
        let known = metrics::find(metric).unwrap_or_else(|| panic!("`{metric}` is not a metric"));
        let factor = if matches!(known.unit, "1" | "dB" | "px") { 1.0 } else { LIT };
        let signals: Vec<(&str, f64)> = match known.signals {
            Signals::None => vec![("", 1.0)],
            Signals::Albedo => vec![("albedo", 1.0)],
            Signals::Each if base.signal.is_empty() => vec![("albedo", 1.0), ("lit", factor)],
            Signals::Each => vec![(base.signal.as_str(), 1.0)],
        };
        let freedom = error.filter(|_| [metrics::BIAS, metrics::EXACT_MSE].contains(&metric)).map(|_| FREEDOM);
        for (signal, factor) in signals {
            let row = Row {
                metric: metric.to_owned(),
                unit: unit.to_owned(),
                signal: signal.to_owned(),
                value: value * factor,
                standard_error: error.map(|error| error * factor),
                freedom,
                ..base.clone()
            };
            if metrics::is_time(metric) { self.times.push(row) } else { self.rows.push(row) }
        }
    }

    /// Adds the metrics of a choice, except its times. `scale` is the cell size of its noise. The random part of the added change and of the squared
    /// error is multiplied by `resolve` (1 = no temporal resolve). A smaller `resolve` also means more lost change.
    pub(super) fn choice(&mut self, base: &Row, scale: f64, resolve: f64) {
        let variant: Option<Variant> = base.variant.parse().ok();
        let chance = variant.is_none_or(|v| v.has(Flavour::NearCliff) || v.has(Flavour::FarCliff));
        let jitter = |salt: u32| {
            let text = format!("{}{}{}{}", base.view, base.variant, base.estimator, base.setting);
            let seed = text.bytes().fold(7u32, |h, b| h.wrapping_mul(31).wrapping_add(u32::from(b)));
            unit2(i32::from(variant.map_or(40, Variant::mask)), 3, seed, salt) - 0.5
        };
        let fetches = variant.map_or(17.3, |v| v.flavours().map(|f| f64::from(Estimator::Fc5.promised_fetches(f))).sum());
        let base_error = 0.11 * (1.0 + 0.5 * jitter(1)) / (1.0 + fetches / 9.0);
        let noise_variance = if chance { 0.0021 * (1.0 + 0.3 * jitter(2)) } else { 0.0 };
        let rmse = (base_error * base_error + noise_variance * resolve).sqrt();
        let put = |rows: &mut Rows, metric: &str, unit: &str, value: f64, error: Option<f64>| rows.put(base, metric, unit, value, error);
        put(self, "fetches_per_px", "samples", fetches, None);
        put(self, "tile_fetches_per_px", "samples", fetches * 1.1, None);
        put(self, "rmse", "linear albedo", rmse, Some(rmse * 0.01));
        put(self, "mse", "linear albedo squared", rmse * rmse, None);
        put(self, "mrse", "1", rmse * rmse * 3.0, None);
        put(self, "psnr", "dB", -20.0 * rmse.log10(), None);
        put(self, "ssim", "1", 1.0 - 3.0 * rmse, None);
        put(self, "flip", "1", 0.9 * rmse, Some(rmse * 0.01));
        put(self, "bias", "linear albedo", if chance { 2e-5 * jitter(3) } else { 0.0 }, Some(if chance { 1.5e-5 } else { 0.0 }));
        if chance {
            put(self, "bias_squared", "linear albedo squared", 1e-10 * jitter(7), Some(1e-10));
            put(self, "bias_squared_p", "1", 0.5 + 0.9 * jitter(8), None);
        }
        put(self, "variance", "linear albedo squared", noise_variance * (1.0 + 0.05 * jitter(4)), None);
        put(self, "exact_mse", "linear albedo squared", noise_variance * (1.0 + 0.004 * jitter(9)), Some(noise_variance * 0.01));
        put(self, "variance_theory", "linear albedo squared", noise_variance, None);
        for lag in 1..=4u32 {
            let k = f64::from(lag);
            let flips = if chance { 0.62 * (1.0 - (-k * 0.7 / scale).exp()) } else { 0.0 };
            let at = Row { lag: Some(lag), ..base.clone() };
            self.put(&at, "flip_rate", "share", flips, Some(flips * 0.02));
            let added = (0.05 * flips * resolve + 0.0006 * k) * (1.0 + 0.2 * jitter(5));
            let lost = k * (0.02 * base_error + 0.001 * (1.0 - resolve));
            self.put(&at, "added", "luminance", added, Some(added * 0.03));
            self.put(&at, "lost", "luminance", lost, Some(lost * 0.03));
            self.put(&at, "residual_rms", "luminance", added.hypot(lost), Some(added * 0.03));
            self.put(&at, "residual", "luminance", 0.8 * added.hypot(lost), Some(added * 0.03));
            self.put(&at, "residual_p95", "luminance", 2.5 * added.hypot(lost), None);
            self.put(&at, "difference", "luminance", added + 0.002, None);
            self.put(&at, "excess_difference", "luminance", added - lost, Some(added * 0.03));
        }
        // Larger cells change less from frame to frame, so the eye's mean over time removes less of their noise.
        let perceived = noise_variance.sqrt() * resolve.sqrt() * scale / (1.0 + 4.0 * scale);
        put(self, "perceived_noise", "luminance", perceived, Some(perceived * 0.01));
        put(self, "invalid_px", "px", 0.0, None);
        if chance {
            // In a real run, these metrics have a row for the last frame only.
            self.put(&Row { frame: Some(15), ..base.clone() }, "clumping", "white = 1", 0.4 + 1.9 * scale, Some(0.05));
            for band in 1..=16 {
                let frequency = f64::from(band) / 32.0;
                let white = base.noise == "white";
                let low = 2.0 * scale / (1.0 + (frequency * 9.0 * scale).powi(2));
                let power = if white { 1.0 } else { low + 0.4 + frequency };
                let at = Row { frequency: Some(frequency), frame: Some(15), ..base.clone() };
                self.put(&at, "power", "white = 1", power, Some(0.02 * power));
            }
        }
        if resolve == 1.0 {
            put(self, "taa_rejections", "share", 0.11 + 0.02 * jitter(6), None);
            self.put(&Row { lag: Some(1), ..base.clone() }, "disoccluded", "share", 0.013, Some(0.001));
        }
        // The mean of these rows of single frames differs from the row over all frames. A report that uses the wrong rows shows a wrong number.
        for frame in 0..3 {
            let at = Row { frame: Some(frame), ..base.clone() };
            self.put(&at, "rmse", "linear albedo", rmse * 3.0, None);
        }
    }

    /// Adds the device times of a choice, and the ratio of its shading time to that of the view's first choice. `shading` and `first` are these two
    /// shading times, milliseconds.
    pub(super) fn times(&mut self, base: &Row, shading: f64, first: f64) {
        for (pass, ms) in [("geometry", 2.1), ("classification", 0.4), ("shading", shading), ("lighting", 1.2)] {
            self.put(base, &metrics::time_of(pass), "ms", ms, Some(ms * 0.01));
        }
        let ratio = shading / first;
        let is_first = shading.to_bits() == first.to_bits();
        self.put(base, metrics::SHADING_RATIO, "1", ratio, Some(if is_first { 0.0 } else { ratio * 0.01 }));
    }

    /// Adds the rows that describe the reference of a view.
    pub(super) fn reference(&mut self, base: &Row, standard_error: f64) {
        let base = Row {
            variant: "reference".to_owned(),
            estimator: String::new(),
            noise: String::new(),
            temporal: String::new(),
            ..base.clone()
        };
        self.put(&base, "reference_spp", "samples", 64.0, None);
        self.put(&base, "reference_se", "linear albedo", standard_error, None);
        self.put(&base, "invalid_px", "px", 0.0, None);
        self.put(&Row { lag: Some(1), ..base.clone() }, "reference_difference", "luminance", 0.0011, None);
    }

    /// Adds the row that describes the reference sequence of a temporal resolve.
    fn resolved_reference(&mut self, base: &Row, temporal: &str) {
        let of_resolve = Row {
            variant: "reference".to_owned(),
            estimator: String::new(),
            noise: String::new(),
            temporal: temporal.to_owned(),
            lag: Some(1),
            ..base.clone()
        };
        self.put(&of_resolve, "reference_difference", "luminance", 0.0007, None);
    }
}

/// Returns a row with the view `view` and default values in the other columns of a choice. Callers replace the columns that differ.
pub(super) fn base(view: &str) -> Row {
    Row {
        experiment: "fake".to_owned(),
        scene: "default".to_owned(),
        view: view.to_owned(),
        variant: "auto".to_owned(),
        estimator: "fc5".to_owned(),
        noise: "hashed".to_owned(),
        temporal: "off".to_owned(),
        ..Row::default()
    }
}

/// Returns a run with these rows.
pub(super) fn run(definition: Definition, rows: Rows, folder: &Path) -> RunData {
    let manifest = serde_json::json!({
        "command": "experiments run 'a<b>.toml' --out out/fake",
        "version": "0.1.0",
        "commit": "60febb4",
        "adapter": "llvmpipe (LLVM 15.0.6, 256 bits)",
        "driver": "llvmpipe Mesa 22.3.6",
        "software": true,
        "definition_hash": "8c1f9a20",
        "shard": null,
    });
    RunData {
        definition,
        manifest,
        rows: rows.rows,
        times: rows.times,
        folder: folder.to_owned(),
        missing: Vec::new(),
        folders: vec![folder.to_owned()],
    }
}

fn all_variants() -> Vec<String> {
    ["auto", "generic"].map(str::to_owned).into_iter().chain(Variant::all().map(|v| v.to_string())).collect()
}

fn shading_ms(variant: &str) -> f64 {
    let fetches = variant.parse::<Variant>().map_or(17.3, |v| f64::from(Estimator::Fc5.promised_fetches_of(v)));
    3.0 + 1.1 * fetches * if variant == "generic" { 1.2 } else { 1.0 }
}

/// Returns a run that combines all variants with several noises in some views. Times exist for the first noise only.
pub(super) fn variants(folder: &Path, views: &[&str], noises: &[&str]) -> RunData {
    let mut rows = Rows::new();
    for (index, view) in views.iter().enumerate() {
        rows.reference(&base(view), if index == 0 { 0.0004 } else { 0.02 });
        for variant in all_variants() {
            for (k, noise) in noises.iter().enumerate() {
                let row = Row { variant: variant.clone(), noise: (*noise).to_owned(), ..base(view) };
                rows.choice(&row, cell(noise), 1.0);
                if k == 0 {
                    rows.times(&row, shading_ms(&variant), shading_ms("auto"));
                }
            }
        }
    }
    let quoted = |all: &[&str]| format!("{all:?}");
    let definition = definition(&format!(
        "frames = 16\nseeds = 8\nvariants = [\"auto\", \"generic\", \"all\"]\nviews = {}\nnoises = {}\nanalysis = \"\"\"\nFirst `a<b` and **strong** words.\n\n- one\n- two\n\"\"\"",
        quoted(views),
        quoted(noises)
    ));
    run(definition, rows, folder)
}

pub(super) const SCALES: [&str; 8] = ["0.05", "0.1", "0.25", "0.5", "1.0", "1.5", "2.0", "4.0"];

/// Returns a run that varies the hash scale.
pub(super) fn hash_scale(folder: &Path) -> RunData {
    let mut rows = Rows::new();
    rows.reference(&base("cliff"), 0.0004);
    for (variant, noise) in [("auto", "hashed"), ("near-cliff", "hashed"), ("auto", "hashed-anisotropic")] {
        for setting in SCALES {
            let row = Row {
                variant: variant.to_owned(),
                noise: noise.to_owned(),
                parameter: "blend.hash_scale".to_owned(),
                setting: setting.to_owned(),
                ..base("cliff")
            };
            let scale: f64 = setting.parse().expect("a number");
            rows.choice(&row, scale * if noise == "hashed" { 1.0 } else { 0.8 }, 1.0);
        }
    }
    let mut definition = definition(
        "frames = 16\nseeds = 8\nvariants = [\"auto\", \"near-cliff\"]\nviews = [\"cliff\"]\nnoises = [\"hashed\", \"hashed-anisotropic\"]\n\
         [vary]\nparameter = \"blend.hash_scale\"\nvalues = [0.05, 0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 4.0]",
    );
    definition.expectations = vec![expectation("Cells of 4 pixels clump"), expectation("Nobody judged <this>")];
    run(definition, rows, folder)
}

fn expectation(claim: &str) -> Expectation {
    Expectation { claim: claim.to_owned(), metric: "clumping".to_owned(), selection: [].into(), over: None, range: [2.0, 9.0] }
}

/// Returns verdicts of three expectations: one is met, one is not met, and one has no value.
pub(super) fn verdicts() -> Vec<Verdict> {
    let verdict = |claim: &str, value: f64, met: bool, why: &str| Verdict {
        claim: claim.to_owned(),
        metric: "clumping".to_owned(),
        value,
        range: [2.0, 9.0],
        met,
        why: why.to_owned(),
    };
    vec![
        verdict("Cells of 4 pixels clump", 8.0, true, "mean of 3 rows"),
        verdict("Cells of 0.05 pixels clump | too", 0.495, false, "mean of 3 rows"),
        verdict("Cells of 9 pixels clump", f64::NAN, false, "no row has setting = 9"),
    ]
}

/// Returns a run that compares temporal resolves with no resolve, for several noises.
pub(super) fn temporal(folder: &Path, noises: &[&str]) -> RunData {
    let mut rows = Rows::new();
    rows.reference(&base("sideways"), 0.0004);
    rows.resolved_reference(&base("sideways"), "exponential");
    rows.resolved_reference(&base("sideways"), "flipquad");
    for noise in noises {
        for (temporal, resolve) in [("off", 1.0), ("exponential", 0.25), ("flipquad", 0.6)] {
            let row = Row { noise: (*noise).to_owned(), temporal: temporal.to_owned(), ..base("sideways") };
            rows.choice(&row, cell(noise), resolve);
        }
    }
    let definition = definition(&format!(
        "frames = 16\nviews = [\"sideways\"]\nvariants = [\"auto\"]\nnoises = {noises:?}\ntemporal = [\"off\", \"exponential\", \"flipquad\"]\ntimes = \"none\""
    ));
    run(definition, rows, folder)
}

/// Returns a run that compares estimators, which differ in fetches and in the size of their noise.
pub(super) fn estimators(folder: &Path) -> RunData {
    let mut rows = Rows::new();
    let row = Row { variant: "near-cliff".to_owned(), ..base("cliff") };
    rows.reference(&row, 0.0004);
    let all = [
        ("fc5", 12.0, 0.047, 0.012),
        ("exact", 48.0, 0.009, 0.0006),
        ("biplanar", 8.0, 0.06, 0.013),
        ("hex", 24.0, 0.05, 0.002),
        ("one-tap", 3.0, 0.08, 0.031),
        ("laplacian", 36.0, 0.02, 0.001),
        ("luna8", 10.0, 0.044, 0.01),
        ("terrain3d", 16.0, 0.09, 0.0009),
    ];
    for (estimator, fetches, rmse, added) in all {
        let row = Row { estimator: estimator.to_owned(), ..row.clone() };
        rows.put(&row, "fetches_per_px", "samples", fetches, None);
        rows.put(&row, "rmse", "linear albedo", rmse, Some(rmse * 0.01));
        rows.put(&Row { lag: Some(1), ..row.clone() }, "added", "luminance", added, Some(added * 0.02));
        rows.put(&Row { lag: Some(1), ..row.clone() }, "flip_rate", "share", added * 9.0, Some(added * 0.1));
        rows.put(&row, "clumping", "white = 1", 1.3, Some(0.05));
        rows.times(&row, 2.0 + fetches, 2.0 + all[0].1);
    }
    let names: Vec<&str> = all.iter().map(|e| e.0).collect();
    let definition = definition(&format!("frames = 16\nviews = [\"cliff\"]\nvariants = [\"near-cliff\"]\nestimators = {names:?}"));
    run(definition, rows, folder)
}

/// Returns a run with a single choice, of which only albedo is measured.
pub(super) fn one(folder: &Path) -> RunData {
    let mut rows = Rows::new();
    let row = Row { signal: "albedo".to_owned(), ..base("cliff") };
    rows.put(&row, "fetches_per_px", "samples", 10.25, None);
    rows.put(&row, "rmse", "linear albedo", 0.02, Some(0.001));
    run(definition("frames = 1\nvariants = [\"auto\"]\nviews = [\"cliff\"]"), rows, folder)
}

/// Writes the pictures of a run, which are ramps of colour with noise.
pub(super) fn pictures(folder: &Path, size: [u32; 2], kinds: &[(&str, u32)]) {
    let into = folder.join("pictures");
    fs::create_dir_all(&into).expect("writable");
    let mut list = Vec::new();
    for (kind, count) in kinds {
        for index in 0..*count {
            let file = format!("{kind}-{index}.png");
            let texel = |x: u32, y: u32| {
                let noise = kernels::shared::hash::pcg(x + y * size[0] + index) >> 26;
                let level = (x * 180 / size[0] + noise).min(255) as u8;
                image::Rgb(if *kind == "frame" { [level, level / 2 + 60, 70] } else { [level, 30, 255 - level] })
            };
            image::RgbImage::from_fn(size[0], size[1], texel).save(into.join(&file)).expect("writable");
            list.push(RunPicture {
                file,
                title: format!("auto, {}", NOISES[index as usize % 6]),
                caption: "17.3 fetches per pixel".to_owned(),
                kind: (*kind).to_owned(),
                view: "cliff".to_owned(),
                variant: "auto".to_owned(),
                noise: NOISES[index as usize % 6].to_owned(),
                ..RunPicture::default()
            });
        }
    }
    fs::write(into.join("index.json"), serde_json::to_string(&list).expect("plain data")).expect("writable");
}

//! Everything that is measured, in one table: names, units, what is needed. METHODOLOGY has the formulas.

use kernels::base::names::suggestion;

/// What a metric cannot be measured without.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// A picture.
    Picture,
    /// At least two seeds.
    Seeds,
    /// At least two frames.
    Frames,
    /// A clock: the number is another each time.
    Clock,
}

/// What further column tells the metric's rows apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// None.
    None,
    /// `lag`, 1 to [`LAGS`].
    Lag,
    /// `frequency`.
    Frequency,
}

/// Smallest side of the square that spectra are taken of, pixels.
pub const SMALLEST_SIDE: u32 = 64;
/// Frames between two that are compared: 1 to this many.
pub const LAGS: u32 = 4;

/// What is taken against the converged reference.
pub const ERRORS: [&str; 6] = ["mse", "rmse", "mrse", "psnr", "ssim", "flip"];

/// A metric.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name in tables and definitions. Of device times it is what stands before the colon: `gpu_ms:shading`.
    pub name: &'static str,
    /// Unit of its value; `1` = a pure number.
    pub unit: &'static str,
    /// What it needs.
    pub needs: Needs,
    /// What tells its rows apart.
    pub axis: Axis,
    /// What it says, one sentence.
    pub meaning: &'static str,
}

impl Metric {
    /// Whether it is the same whenever it is measured again on the same adapter.
    pub fn is_deterministic(&self) -> bool {
        self.needs != Needs::Clock
    }
}

/// Name of device times: `gpu_ms:PASS`.
pub const TIME: &str = "gpu_ms";

const fn metric(name: &'static str, unit: &'static str, needs: Needs, axis: Axis, meaning: &'static str) -> Metric {
    Metric { name, unit, needs, axis, meaning }
}

/// All of them.
pub const METRICS: [Metric; 25] = [
    metric("fetches_per_px", "fetches/px", Needs::Picture, Axis::None, "Texture fetches counted in the shader, mean over terrain pixels."),
    metric(
        "tile_fetches_per_px",
        "fetches/px",
        Needs::Picture,
        Axis::None,
        "Promised fetches of the variant that a pixel's tile runs, mean over terrain pixels: what lanes that march together pay.",
    ),
    metric(
        "bias",
        "linear albedo",
        Needs::Seeds,
        Axis::None,
        "Mean over seeds less the exact blend of the same flavours, mean over pixels.",
    ),
    metric("variance", "linear albedo^2", Needs::Seeds, Axis::None, "Unbiased variance over seeds, mean over pixels and channels."),
    metric(
        "variance_theory",
        "linear albedo^2",
        Needs::Seeds,
        Axis::None,
        "The variance that the theory of selection predicts for the same pixels.",
    ),
    metric("mse", "linear albedo^2", Needs::Picture, Axis::None, "Mean squared error against the converged reference."),
    metric("mrse", "1", Needs::Picture, Axis::None, "Mean relative squared error against the converged reference."),
    metric("rmse", "linear albedo", Needs::Picture, Axis::None, "Root of the mean squared error against the converged reference."),
    metric("psnr", "dB", Needs::Picture, Axis::None, "Peak signal-to-noise ratio against the converged reference, of display values."),
    metric("ssim", "1", Needs::Picture, Axis::None, "Structural similarity to the converged reference, of display values; 1 = the same."),
    metric("flip", "1", Needs::Picture, Axis::None, "Mean FLIP difference from the converged reference, of display values; 0 = the same."),
    metric(
        "flip_rate",
        "1",
        Needs::Frames,
        Axis::Lag,
        "Share of surface points whose stochastic choice differs from that some frames before, by exact reprojection.",
    ),
    metric(
        "difference",
        "linear luminance",
        Needs::Frames,
        Axis::Lag,
        "Mean absolute luminance difference from some frames before, by exact reprojection.",
    ),
    metric("flicker", "linear luminance", Needs::Frames, Axis::Lag, "That difference less the difference of the reference sequence."),
    metric("flicker_p95", "linear luminance", Needs::Frames, Axis::Lag, "As flicker, the 95th percentile in place of the mean."),
    metric(
        "clumping",
        "1",
        Needs::Picture,
        Axis::None,
        "Variance of block means of the noise relative to that of white noise of the same variance; 1 = white, more = blotches.",
    ),
    metric(
        "power",
        "1",
        Needs::Picture,
        Axis::Frequency,
        "Radial power spectrum of the noise relative to white noise of the same variance.",
    ),
    metric("taa_rejections", "1", Needs::Frames, Axis::None, "Share of history samples that a 3 x 3 colour box clips."),
    metric("disoccluded", "1", Needs::Frames, Axis::Lag, "Share of the terrain pixels followed that have no history some frames before."),
    metric("reference_se", "linear albedo", Needs::Picture, Axis::None, "Standard error of the reference, root mean square over pixels."),
    metric("reference_spp", "samples/px", Needs::Picture, Axis::None, "Samples per pixel that the reference took."),
    metric("reference_difference", "linear luminance", Needs::Frames, Axis::Lag, "The difference of the reference sequence."),
    metric("reference_difference_p95", "linear luminance", Needs::Frames, Axis::Lag, "As reference_difference, the 95th percentile."),
    metric("terrain", "1", Needs::Picture, Axis::None, "Share of pixels that show terrain: those that everything else is taken over."),
    metric(TIME, "ms", Needs::Clock, Axis::None, "Device time of a pass; a software adapter's is good for ratios only."),
];

/// The metric of this name; `gpu_ms:PASS` is one whatever the pass.
pub fn find(name: &str) -> Option<&'static Metric> {
    let stem = match name.split_once(':') {
        Some((TIME, pass)) if !pass.is_empty() => TIME,
        _ if name == TIME => return None,
        _ => name,
    };
    METRICS.iter().find(|metric| metric.name == stem)
}

/// The metric of this name, or what to say where there is none.
///
/// # Errors
/// One line that names the nearest known metric.
pub fn known(name: &str) -> Result<&'static Metric, String> {
    find(name).ok_or_else(|| {
        if name == TIME {
            return format!("`{TIME}` is of a pass: write `{TIME}:shading`");
        }
        let names = METRICS.map(|metric| metric.name);
        format!("`{name}` is no metric: {}", suggestion(name, &names))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_times_are_named_by_pass() {
        for (i, metric) in METRICS.iter().enumerate() {
            assert!(METRICS.iter().skip(i + 1).all(|other| other.name != metric.name), "{}", metric.name);
            assert!(metric.meaning.ends_with('.') && !metric.unit.is_empty(), "{}", metric.name);
            assert_eq!(find(metric.name).is_some(), metric.name != TIME, "{}", metric.name);
        }
        let time = find("gpu_ms:page requests").expect("a time");
        assert!(time.name == TIME && !time.is_deterministic());
        assert!(find("gpu_ms:").is_none() && find("bias:shading").is_none());
        assert!(known("gpu_ms").is_err_and(|text| text.contains("gpu_ms:shading")));
        assert!(known("flip-rat").is_err_and(|text| text.contains("`flip_rate`")));
    }
}

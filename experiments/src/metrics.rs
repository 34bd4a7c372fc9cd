//! The table of all metrics: their names, their units, and what a run needs to measure them. METHODOLOGY has the formulas.

use kernels::base::names::suggestion;

/// What a definition must contain, so that a metric can be measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Needs {
    /// At least one picture, which every run has.
    Picture,
    /// At least two seeds.
    Seeds,
    /// At least two frames.
    Frames,
    /// Device times. They are different each time they are measured.
    Clock,
}

/// The column that distinguishes the rows of a metric that agree in view, variant, estimator, noise, temporal resolve, setting and frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// No additional column.
    None,
    /// The column `lag`, with values from 1 to [`LAGS`].
    Lag,
    /// The column `frequency`.
    Frequency,
}

/// Smallest side of the square from which spectra are computed, pixels.
pub const SMALLEST_SIDE: u32 = 64;
/// Largest lag. A lag is the number of frames between the two compared frames, and it is at least 1.
pub const LAGS: u32 = 4;

/// A metric.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name in tables and definitions. For device times such as `gpu_ms:shading`, it is the part before the colon.
    pub name: &'static str,
    /// Unit of the value; `1` = the value is a pure number.
    pub unit: &'static str,
    /// What a definition must contain, so that the metric can be measured.
    pub needs: Needs,
    /// The additional column that distinguishes the rows of the metric.
    pub axis: Axis,
    /// Meaning of the metric, as one sentence.
    pub meaning: &'static str,
}

impl Metric {
    /// Whether repeated measurements on the same adapter give the same value.
    pub fn is_deterministic(&self) -> bool {
        self.needs != Needs::Clock
    }
}

/// Defines the metrics. For each metric, it defines a constant that contains the metric's name, and an entry of [`METRICS`].
macro_rules! metrics {
    ($($constant:ident = $name:literal, $unit:literal, $needs:ident, $axis:ident, $meaning:literal;)*) => {
        $(
            #[doc = $meaning]
            pub const $constant: &str = $name;
        )*

        /// All metrics.
        pub const METRICS: [Metric; [$($name),*].len()] = [
            $(Metric { name: $constant, unit: $unit, needs: Needs::$needs, axis: Axis::$axis, meaning: $meaning },)*
        ];
    };
}

metrics! {
    FETCHES_PER_PX = "fetches_per_px", "fetches/px", Picture, None,
        "Texture fetches counted in the shader, mean over terrain pixels.";
    TILE_FETCHES_PER_PX = "tile_fetches_per_px", "fetches/px", Picture, None,
        "Promised fetches of the variant that shades a pixel's tile, mean over terrain pixels: the cost if a tile is shaded in lockstep.";
    BIAS = "bias", "linear albedo", Seeds, None,
        "Mean over seeds minus the exact blend of the same flavours, averaged over pixels.";
    VARIANCE = "variance", "linear albedo^2", Seeds, None,
        "Unbiased variance over seeds, mean over pixels and channels.";
    VARIANCE_THEORY = "variance_theory", "linear albedo^2", Seeds, None,
        "Variance that the probabilities of the random choices predict for the same pixels.";
    MSE = "mse", "linear albedo^2", Picture, None,
        "Mean squared error against the converged reference.";
    MRSE = "mrse", "1", Picture, None,
        "Mean relative squared error against the converged reference.";
    RMSE = "rmse", "linear albedo", Picture, None,
        "Root of the mean squared error against the converged reference.";
    PSNR = "psnr", "dB", Picture, None,
        "Peak signal-to-noise ratio of the display values against those of the converged reference.";
    SSIM = "ssim", "1", Picture, None,
        "Structural similarity between the display values and those of the converged reference; 1 = identical.";
    FLIP = "flip", "1", Picture, None,
        "Mean FLIP difference between the display values and those of the converged reference; 0 = identical.";
    FLIP_RATE = "flip_rate", "1", Frames, Lag,
        "Share of surface points, followed by exact reprojection, whose random choice differs from their choice in an earlier frame.";
    DIFFERENCE = "difference", "linear luminance", Frames, Lag,
        "Mean absolute luminance difference of surface points, followed by exact reprojection, from an earlier frame.";
    FLICKER = "flicker", "linear luminance", Frames, Lag,
        "Metric `difference` minus that of the reference sequence.";
    FLICKER_P95 = "flicker_p95", "linear luminance", Frames, Lag,
        "Like `flicker`, but with the 95th percentile instead of the mean.";
    CLUMPING = "clumping", "1", Seeds, None,
        "Variance of block means of the noise, divided by that of white noise with the same variance; 1 = white noise, above 1 = blotches.";
    POWER = "power", "1", Seeds, Frequency,
        "Radial power spectrum of the noise relative to white noise of the same variance.";
    TAA_REJECTIONS = "taa_rejections", "1", Frames, None,
        "Share of history samples that a 3 x 3 colour box clips.";
    DISOCCLUDED = "disoccluded", "1", Frames, Lag,
        "Share of the followed terrain pixels that have no history in an earlier frame.";
    REFERENCE_SE = "reference_se", "linear albedo", Picture, None,
        "Standard error of the reference, root mean square over pixels.";
    REFERENCE_SPP = "reference_spp", "samples/px", Picture, None,
        "Samples per pixel that the reference took.";
    REFERENCE_DIFFERENCE = "reference_difference", "linear luminance", Frames, Lag,
        "Metric `difference` of the reference sequence.";
    REFERENCE_DIFFERENCE_P95 = "reference_difference_p95", "linear luminance", Frames, Lag,
        "Like `reference_difference`, but with the 95th percentile instead of the mean.";
    TERRAIN = "terrain", "1", Picture, None,
        "Share of pixels that show terrain; all other metrics are computed over these pixels.";
    TIME = "gpu_ms", "ms", Clock, None,
        "Device time of a pass; on a software adapter only ratios are meaningful.";
}

/// The metrics that compare a picture with the converged reference.
pub const ERRORS: [&str; 6] = [MSE, RMSE, MRSE, PSNR, SSIM, FLIP];

/// Name of the metric that is the device time of the shading pass.
pub const SHADING_TIME: &str = "gpu_ms:shading";

/// Returns the name of the metric that is the device time of a pass: `gpu_ms:PASS`.
pub fn time_of(pass: &str) -> String {
    format!("{TIME}:{pass}")
}

/// Returns the name of the pass if the metric `name` is a device time, and `None` otherwise.
pub fn timed_pass(name: &str) -> Option<&str> {
    match name.split_once(':') {
        Some((TIME, pass)) if !pass.is_empty() => Some(pass),
        _ => None,
    }
}

/// Returns the metric with this name. The name `gpu_ms:PASS` is accepted for every pass.
pub fn find(name: &str) -> Option<&'static Metric> {
    let stem = match timed_pass(name) {
        Some(_) => TIME,
        None if name == TIME => return None,
        None => name,
    };
    METRICS.iter().find(|metric| metric.name == stem)
}

/// Returns the metric with this name, or a message if there is none.
///
/// # Errors
/// The message is one line and names the most similar known metric.
pub fn known(name: &str) -> Result<&'static Metric, String> {
    find(name).ok_or_else(|| {
        if name == TIME {
            return format!("`{TIME}` needs the name of a pass: write `{SHADING_TIME}`, for example");
        }
        let names = METRICS.map(|metric| metric.name);
        format!("`{name}` is not a known metric: {}", suggestion(name, &names))
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
        assert_eq!((time_of("shading").as_str(), timed_pass(SHADING_TIME), timed_pass(RMSE)), (SHADING_TIME, Some("shading"), None));
        let time = find("gpu_ms:page requests").expect("a time");
        assert!(time.name == TIME && !time.is_deterministic());
        assert!(find("gpu_ms:").is_none() && find("bias:shading").is_none());
        assert!(known("gpu_ms").is_err_and(|text| text.contains("gpu_ms:shading")));
        assert!(known("flip-rat").is_err_and(|text| text.contains("`flip_rate`")));
    }
}

//! The table of all metrics: their names, their units, and what a run needs to measure them. METHODOLOGY has the formulas.

use kernels::base::names::suggestion;
use kernels::shared::signal::Signal;

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

/// An additional column that identifies a row. It is needed to distinguish rows of a metric that are equal in view, variant, estimator, noise,
/// temporal resolve, signal, setting and frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// No additional column.
    None,
    /// The column `lag`, with values from 1 to [`LAGS`].
    Lag,
    /// The column `frequency`.
    Frequency,
}

/// The signals (albedo or the lit picture) for which a metric has rows. The column `signal` distinguishes them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Signals {
    /// The metric does not depend on a signal; the column is empty.
    None,
    /// Only albedo, because the metric is computed over seeds, and seeds are drawn only as albedo.
    Albedo,
    /// Each signal that the definition lists.
    Each,
}

/// Smallest side of the square from which spectra are computed, pixels.
pub const SMALLEST_SIDE: u32 = 64;
/// Largest lag. A lag is the number of frames from the earlier to the later of the two compared frames, and it is at least 1.
pub const LAGS: u32 = 4;
/// Limit of the number of groups of consecutive frames into which the measured frames of a sequence are divided. The scatter of these groups gives
/// the standard errors of [`RESIDUAL`], [`RESIDUAL_RMS`], [`ADDED`] and [`LOST`] over all frames. Neighbouring frames are correlated, so a standard
/// error that is computed from single frames would be too small.
pub const GROUPS: u32 = 20;

/// Limit of the number of frames whose perceived noise is measured. The limit is low, because filtering a frame in space takes long.
const SEEN: u32 = 4;

/// The memory of the eye ([`Sequence::is_seen`]) is considered filled after `FILLED / adaptation` frames. For `adaptation`, see
/// [`Sequence::is_memory_filled`].
const FILLED: f64 = 1.5;

/// Which frames of a sequence are measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sequence {
    /// Number of frames that are drawn.
    pub frames: u32,
    /// Number of frames at the start that are drawn but not measured; less than `frames`.
    pub warm_up: u32,
}

impl Sequence {
    /// Number of measured frames.
    pub const fn measured(self) -> u32 {
        self.frames.saturating_sub(self.warm_up)
    }

    /// Number of measured frames that have a frame `lag` frames before them.
    pub fn compared(self, lag: u32) -> u32 {
        self.frames.saturating_sub(self.warm_up.max(lag))
    }

    /// Whether the perceived noise of a frame is measured. It is measured for the last frame, and for up to three frames before it at equal
    /// distances. All of them are measured frames in the second half of the sequence. In the first half, the memory of the eye, which is an
    /// exponential mean of the error over time, may not be filled yet. A sequence of fewer than two frames has no such frame.
    pub fn is_seen(self, frame: u32) -> bool {
        let (last, step) = (self.frames.saturating_sub(1), self.seen_step());
        frame >= self.seen_from() && frame <= last && (last - frame).is_multiple_of(step) && (last - frame) / step < self.seen_frames()
    }

    /// Number of frames whose perceived noise is measured: at most 4; 0 if the sequence has fewer than two frames.
    pub fn seen_frames(self) -> u32 {
        if self.frames > 1 { ((self.frames - 1 - self.seen_from()) / self.seen_step() + 1).min(SEEN) } else { 0 }
    }

    /// The first frame whose perceived noise is measured; `None` if there is none.
    pub fn first_seen(self) -> Option<u32> {
        self.seen_frames().checked_sub(1).map(|before| self.frames - 1 - before * self.seen_step())
    }

    /// Whether the memory of the eye is filled in the first frame whose perceived noise is measured. In shorter sequences, the measured value is too
    /// high for noise that changes in every frame. `adaptation`: the weight of a new frame in the exponential mean, above 0.
    pub fn is_memory_filled(self, adaptation: f64) -> bool {
        self.first_seen().is_some_and(|first| f64::from(first) + 1.0 >= FILLED / adaptation)
    }

    /// Returns the smallest number of frames such that a sequence of this length, and every longer one, fills the memory of the eye
    /// ([`Sequence::is_memory_filled`]). The number of frames to warm up stays the same.
    pub fn frames_to_fill(self, adaptation: f64) -> u32 {
        // Perceived noise is first measured in the second half. So twice the frames that fill the memory are always enough.
        let certain = (2.0 * FILLED / adaptation).ceil() as u32;
        let short = (1..=certain).rev().find(|&frames| !Sequence { frames, ..self }.is_memory_filled(adaptation));
        short.map_or(1, |frames| frames + 1)
    }

    /// First frame whose perceived noise may be measured.
    fn seen_from(self) -> u32 {
        (self.frames / 2).max(self.warm_up).min(self.frames.saturating_sub(1))
    }

    /// Number of frames from one frame whose perceived noise is measured to the next.
    fn seen_step(self) -> u32 {
        ((self.frames - self.seen_from()) / SEEN).max(1)
    }
}

/// The accepted range of the number of pixels per degree of the viewer's field of view. Below this range, the feature filters of FLIP are narrower
/// than a pixel. Above it, the filters are more than 100 pixels wide, and displays at a usual distance have fewer pixels per degree.
pub const PIXELS_PER_DEGREE_RANGE: [f32; 2] = [4.0, 400.0];

/// A metric.
#[derive(Clone, Copy, Debug)]
pub struct Metric {
    /// Name in tables and definitions. For device times and their ratios, such as `gpu_ms:shading`, it is the part before the colon.
    pub name: &'static str,
    /// Unit of the value; `1` = the value is a pure number.
    pub unit: &'static str,
    /// What a definition must contain, so that the metric can be measured.
    pub needs: Needs,
    /// The additional column that distinguishes the rows of the metric.
    pub axis: Axis,
    /// The signals for which the metric has rows.
    pub signals: Signals,
    /// Meaning of the metric, as one sentence.
    pub meaning: &'static str,
}

impl Metric {
    /// Whether repeated measurements on the same adapter give the same value.
    pub fn is_deterministic(&self) -> bool {
        self.needs != Needs::Clock
    }

    /// The unit of the metric for a signal. For the lit picture, linear albedo is replaced by display values. Errors of colours are computed from
    /// display values that are decoded to linear. Changes of luminance are computed from display values as they are, which are sRGB-encoded.
    pub fn unit_of(&self, signal: Signal) -> String {
        match signal {
            Signal::Albedo => self.unit.to_owned(),
            Signal::Lit => self.unit.replace("linear albedo", "linear display value").replace("linear luminance", "display value"),
        }
    }

    /// The content of the column `signal` for a measurement of `signal`.
    pub fn signal_column(&self, signal: Signal) -> &'static str {
        match self.signals {
            Signals::None => "",
            Signals::Albedo => Signal::Albedo.name(),
            Signals::Each => signal.name(),
        }
    }
}

/// Defines the metrics. For each metric, it defines a constant that contains the metric's name, and an entry of [`METRICS`].
macro_rules! metrics {
    ($($constant:ident = $name:literal, $unit:literal, $needs:ident, $axis:ident, $signals:ident, $meaning:literal;)*) => {
        $(
            #[doc = $meaning]
            pub const $constant: &str = $name;
        )*

        /// All metrics.
        pub const METRICS: [Metric; [$($name),*].len()] = [
            $(Metric { name: $constant, unit: $unit, needs: Needs::$needs, axis: Axis::$axis, signals: Signals::$signals, meaning: $meaning },)*
        ];
    };
}

metrics! {
    FETCHES_PER_PX = "fetches_per_px", "fetches/px", Picture, None, None,
        "Texture fetches counted in the shader, mean over terrain pixels.";
    TILE_FETCHES_PER_PX = "tile_fetches_per_px", "fetches/px", Picture, None, None,
        "Promised fetches of the variant of a pixel's tile or patch, mean over terrain pixels: the cost if a tile or patch is shaded in lockstep.";
    BIAS = "bias", "linear albedo", Seeds, None, Albedo,
        "Mean over seeds minus the exact blend of the same flavours, averaged over pixels.";
    BIAS_SQUARED = "bias_squared", "linear albedo^2", Seeds, None, Albedo,
        "Unbiased estimate of the mean square, over areas of 16 x 16 pixels, of an area's bias; it may be negative.";
    BIAS_SQUARED_P = "bias_squared_p", "1", Seeds, None, Albedo,
        "Probability of a `bias_squared` at least as large as the measured one, if there is no bias; computed with random signs.";
    VARIANCE = "variance", "linear albedo^2", Seeds, None, Albedo,
        "Unbiased variance over seeds, mean over pixels and channels.";
    VARIANCE_THEORY = "variance_theory", "linear albedo^2", Seeds, None, Albedo,
        "Variance that the probabilities of the random choices predict for the same pixels.";
    EXACT_MSE = "exact_mse", "linear albedo^2", Seeds, None, Albedo,
        "Mean squared difference from the exact blend of the same flavours, over seeds, pixels and channels; without a bias, its expectation is the variance.";
    MSE = "mse", "linear albedo^2", Picture, None, Each,
        "Mean squared error against the converged reference.";
    MRSE = "mrse", "1", Picture, None, Each,
        "Mean relative squared error against the converged reference.";
    RMSE = "rmse", "linear albedo", Picture, None, Each,
        "Root of the mean squared error against the converged reference.";
    PSNR = "psnr", "dB", Picture, None, Each,
        "Peak signal-to-noise ratio of the display values against those of the converged reference.";
    SSIM = "ssim", "1", Picture, None, Each,
        "Structural similarity between the display values and those of the converged reference; 1 = identical.";
    FLIP = "flip", "1", Picture, None, Each,
        "Mean FLIP difference between the display values and those of the converged reference; 0 = identical.";
    FLIP_RATE = "flip_rate", "1", Frames, Lag, None,
        "Share of surface points, followed by exact reprojection, whose random choice differs from their choice in an earlier frame.";
    DIFFERENCE = "difference", "linear luminance", Frames, Lag, Each,
        "Mean absolute luminance difference of surface points, followed by exact reprojection, from an earlier frame.";
    EXCESS_DIFFERENCE = "excess_difference", "linear luminance", Frames, Lag, Each,
        "Metric `difference` minus that of the reference sequence; blur lowers it and noise raises it, so the two can cancel.";
    EXCESS_DIFFERENCE_P95 = "excess_difference_p95", "linear luminance", Frames, Lag, Each,
        "Like `excess_difference`, but with the 95th percentile instead of the mean.";
    RESIDUAL = "residual", "linear luminance", Frames, Lag, Each,
        "Residual flicker: mean absolute change of a surface point's error against the reference sequence; 0 only if the error moves with the surface.";
    RESIDUAL_P95 = "residual_p95", "linear luminance", Frames, Lag, Each,
        "Like `residual`, but with the 95th percentile instead of the mean.";
    RESIDUAL_RMS = "residual_rms", "linear luminance", Frames, Lag, Each,
        "Like `residual`, but with the root mean square instead of the mean.";
    ADDED = "added", "linear luminance", Frames, Lag, Each,
        "The part of the changes that the reference sequence does not have, such as noise; root mean square.";
    LOST = "lost", "linear luminance", Frames, Lag, Each,
        "The part of the reference sequence's changes that is missing, such as after a blur; root mean square, below 0 if changes are exaggerated.";
    PERCEIVED_NOISE = "perceived_noise", "linear luminance", Frames, None, Each,
        "Error against the reference sequence after the eye's filters in time, along exact motion, and in space; root mean square.";
    INVALID_PX = "invalid_px", "px", Picture, None, Each,
        "Number of terrain pixels, over all measured frames, whose colour is not finite; metrics of colours leave them out.";
    CLUMPING = "clumping", "1", Seeds, None, Albedo,
        "Variance of block means of the noise, divided by that of white noise with the same variance; 1 = white noise, above 1 = blotches.";
    POWER = "power", "1", Seeds, Frequency, Albedo,
        "Radial power spectrum of the noise relative to white noise of the same variance.";
    TAA_REJECTIONS = "taa_rejections", "1", Frames, None, Each,
        "Share of history samples that a 3 x 3 colour box clips.";
    DISOCCLUDED = "disoccluded", "1", Frames, Lag, None,
        "Share of terrain pixels whose surface point was hidden or outside the picture in an earlier frame.";
    REFERENCE_SE = "reference_se", "linear albedo", Picture, None, Each,
        "Standard error of the reference, root mean square over pixels.";
    REFERENCE_SPP = "reference_spp", "samples/px", Picture, None, None,
        "Samples per pixel that the reference took.";
    REFERENCE_DIFFERENCE = "reference_difference", "linear luminance", Frames, Lag, Each,
        "Metric `difference` of the reference sequence.";
    REFERENCE_DIFFERENCE_P95 = "reference_difference_p95", "linear luminance", Frames, Lag, Each,
        "Like `reference_difference`, but with the 95th percentile instead of the mean.";
    TERRAIN = "terrain", "1", Picture, None, None,
        "Share of pixels that show terrain in all samples of the reference; errors are measured at these pixels.";
    TIME = "gpu_ms", "ms", Clock, None, None,
        "Device time of a pass; on a software adapter only ratios are meaningful.";
    TIME_RATIO = "gpu_ratio", "1", Clock, None, None,
        "Device time of a pass, divided by that of the first variant with the first estimator and noise, which is drawn in the same rounds.";
}

/// The metrics that compare each frame with the same frame of the reference sequence, point by point.
pub const RESIDUALS: [&str; 6] = [RESIDUAL, RESIDUAL_P95, RESIDUAL_RMS, ADDED, LOST, PERCEIVED_NOISE];

/// The metrics that compare a picture with the converged reference.
pub const ERRORS: [&str; 6] = [MSE, RMSE, MRSE, PSNR, SSIM, FLIP];

/// Returns another metric, such as `bias` for `bias_squared`. A run that measures the returned metric also measures the metric `name`, even if the
/// definition does not request it, because the report needs both numbers. `None` if there is no such metric.
pub fn companion_of(name: &str) -> Option<&'static str> {
    match name {
        BIAS_SQUARED | BIAS_SQUARED_P => Some(BIAS),
        EXACT_MSE => Some(VARIANCE_THEORY),
        _ => None,
    }
}

/// Name of the pass that shades. Its times decide how long a run measures times.
pub const SHADING_PASS: &str = "shading";
/// The passes that do not depend on how pixels are shaded. They are drawn once in each round of timing, and their times are stored with one variant.
pub const SHARED_PASSES: [&str; 2] = ["geometry", "occlusion"];
/// Name of the metric that is the device time of the shading pass.
pub const SHADING_TIME: &str = "gpu_ms:shading";
/// Name of the metric that is the ratio of device times of the shading pass.
pub const SHADING_RATIO: &str = "gpu_ratio:shading";

/// Returns the name of the metric that is the device time of a pass: `gpu_ms:PASS`.
pub fn time_of(pass: &str) -> String {
    format!("{TIME}:{pass}")
}

/// Returns the name of the metric that is the ratio of device times of a pass: `gpu_ratio:PASS`.
pub fn ratio_of(pass: &str) -> String {
    format!("{TIME_RATIO}:{pass}")
}

/// Whether the metric `name` is a device time or a ratio of device times.
pub fn is_time(name: &str) -> bool {
    find(name).is_some_and(|metric| metric.needs == Needs::Clock)
}

/// Returns the name of the pass if the metric `name` is a device time, and `None` otherwise. A ratio of device times is not a device time.
pub fn timed_pass(name: &str) -> Option<&str> {
    match name.split_once(':') {
        Some((TIME, pass)) if !pass.is_empty() => Some(pass),
        _ => None,
    }
}

/// Returns the metric with this name. The names `gpu_ms:PASS` and `gpu_ratio:PASS` are accepted with any non-empty PASS.
pub fn find(name: &str) -> Option<&'static Metric> {
    let stem = match name.split_once(':') {
        Some((stem @ (TIME | TIME_RATIO), pass)) if !pass.is_empty() => stem,
        _ if [TIME, TIME_RATIO].contains(&name) => return None,
        _ => name,
    };
    METRICS.iter().find(|metric| metric.name == stem)
}

/// Returns the metric with this name, or a message if there is none.
///
/// # Errors
/// The message is one line and suggests a remedy, such as the most similar known metric.
pub fn known(name: &str) -> Result<&'static Metric, String> {
    find(name).ok_or_else(|| {
        if let "flicker" | "flicker_p95" = name {
            let new = name.replace("flicker", EXCESS_DIFFERENCE);
            return format!("`{name}` was renamed: write `{new}`, or `{ADDED}`, in which blur and noise cannot cancel");
        }
        if [TIME, TIME_RATIO].contains(&name) {
            return format!("`{name}` needs the name of a pass: write `{name}:{SHADING_PASS}`, for example");
        }
        let names = METRICS.map(|metric| metric.name);
        format!("`{name}` is not a known metric: {}", suggestion(name, &names))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_say_of_which_signal_a_number_is() {
        let unit = |name: &str, signal| find(name).expect("a metric").unit_of(signal);
        assert_eq!(
            [MSE, RMSE, ADDED, FLIP].map(|m| unit(m, Signal::Albedo)),
            ["linear albedo^2", "linear albedo", "linear luminance", "1"]
        );
        assert_eq!(
            [MSE, RMSE, ADDED, FLIP].map(|m| unit(m, Signal::Lit)),
            ["linear display value^2", "linear display value", "display value", "1"]
        );
        let column = |name: &str| find(name).expect("a metric").signal_column(Signal::Lit);
        assert_eq!([FLIP_RATE, BIAS, ADDED].map(column), ["", "albedo", "lit"]);
    }

    /// A sequence all of whose frames are measured.
    fn whole(frames: u32) -> Sequence {
        Sequence { frames, warm_up: 0 }
    }

    #[test]
    fn seen_frames_are_counted() {
        let seen = |sequence: Sequence| (0..sequence.frames + 9).filter(|&frame| sequence.is_seen(frame)).collect::<Vec<u32>>();
        for frames in 0..99 {
            for warm_up in (0..frames).step_by(3) {
                let sequence = Sequence { frames, warm_up };
                let frames = seen(sequence);
                assert_eq!(frames.len(), sequence.seen_frames() as usize, "{sequence:?}");
                assert_eq!(frames.first().copied(), sequence.first_seen(), "{sequence:?}");
                assert!(frames.iter().all(|&frame| frame >= warm_up), "{sequence:?}");
            }
        }
        assert_eq!([1, 2, 5, 16, 100_000].map(|frames| whole(frames).seen_frames()), [0, 1, 3, 4, 4]);
        assert_eq!(seen(whole(16)), [9, 11, 13, 15]);
        assert_eq!(seen(Sequence { frames: 40, warm_up: 32 }), [33, 35, 37, 39]);
        assert_eq!(Sequence { frames: 40, warm_up: 2 }.compared(1), 38);
        assert_eq!(Sequence { frames: 40, warm_up: 2 }.compared(4), 36);
    }

    #[test]
    fn noise_of_sequences_that_are_too_short_scores_too_high() {
        let adaptation =
            |frames_per_second: f64| kernels::metrics::Viewing { frames_per_second, ..kernels::metrics::Viewing::default() }.adaptation();
        // At 60 frames per second, the memory is filled after 10 frames. In a sequence of 15 frames, perceived noise is first measured in frame 8,
        // which is the 9th frame. In a sequence of 16 frames, it is first measured in the 10th frame.
        assert_eq!(
            [0, 1, 5, 15, 16, 400].map(|frames| whole(frames).is_memory_filled(adaptation(60.0))),
            [false, false, false, false, true, true]
        );
        assert!(whole(9).is_memory_filled(adaptation(30.0)) && !whole(9).is_memory_filled(adaptation(60.0)));
        assert!(Sequence { frames: 15, warm_up: 10 }.is_memory_filled(adaptation(60.0)), "all measured frames come after the 10th");
        for fps in [1.0, 24.0, 30.0, 60.0, 120.0, 1000.0].map(adaptation) {
            let enough = whole(5).frames_to_fill(fps);
            assert!(
                (enough..1000).all(|frames| whole(frames).is_memory_filled(fps)) && !whole(enough - 1).is_memory_filled(fps),
                "{enough}"
            );
        }
        assert_eq!([30.0, 60.0].map(|fps| whole(5).frames_to_fill(adaptation(fps))), [9, 16]);
        // Returns the root mean square of the memory after `n` frames of noise that is independent in each frame and has a variance of 1.
        let root = |a: f64, n: u32| {
            let step = |variance: f64, n: u32| {
                let share = a.max(1.0 / f64::from(n));
                (1.0 - share).powi(2) * variance + share * share
            };
            (1..=n).fold(0.0_f64, step).sqrt()
        };
        let last = |a: f64| (a / (2.0 - a)).sqrt();
        // After many frames, the root mean square of the memory approaches the value that `last` returns. If the memory is filled, the root mean
        // square exceeds this value by less than a fifth. In a sequence of 5 frames, the mean of the root mean square over the frames whose perceived
        // noise is measured exceeds the value by 76 %.
        for a in [24.0, 30.0, 60.0, 120.0].map(adaptation) {
            let filled = (FILLED / a).ceil() as u32;
            assert!(root(a, filled) < 1.2 * last(a) && root(a, filled / 3) > 1.2 * last(a), "{a}");
            assert!((root(a, 1000) / last(a) - 1.0).abs() < 1e-9, "{a}");
        }
        let a = adaptation(60.0);
        let seen: Vec<f64> = (0..5).filter(|&frame| whole(5).is_seen(frame)).map(|frame| root(a, frame + 1)).collect();
        let mean = seen.iter().sum::<f64>() / seen.len() as f64;
        assert!((mean / last(a) - 1.76).abs() < 0.01, "{mean}");
    }

    #[test]
    fn names_are_unique_and_times_are_named_by_pass() {
        for (i, metric) in METRICS.iter().enumerate() {
            assert!(METRICS.iter().skip(i + 1).all(|other| other.name != metric.name), "{}", metric.name);
            assert!(metric.meaning.ends_with('.') && !metric.unit.is_empty(), "{}", metric.name);
            assert_eq!(find(metric.name).is_some(), ![TIME, TIME_RATIO].contains(&metric.name), "{}", metric.name);
        }
        assert_eq!((time_of("shading").as_str(), timed_pass(SHADING_TIME), timed_pass(RMSE)), (SHADING_TIME, Some("shading"), None));
        let time = find("gpu_ms:page requests").expect("a time");
        assert!(time.name == TIME && !time.is_deterministic());
        assert!(find("gpu_ms:").is_none() && find("gpu_ratio:").is_none() && find("bias:shading").is_none());
        assert!(known("gpu_ms").is_err_and(|text| text.contains("gpu_ms:shading")));
        // A ratio of times also needs the clock, but it has no unit and is not a time of a pass.
        assert_eq!((time_of(SHADING_PASS).as_str(), ratio_of(SHADING_PASS).as_str()), (SHADING_TIME, SHADING_RATIO));
        let ratio = find(SHADING_RATIO).expect("a ratio");
        assert_eq!((ratio.name, ratio.unit, ratio.is_deterministic(), timed_pass(SHADING_RATIO)), (TIME_RATIO, "1", false, None));
        assert!(known("gpu_ratio").is_err_and(|text| text.contains("gpu_ratio:shading")));
        assert_eq!([SHADING_TIME, SHADING_RATIO, RMSE, "gpu_ms", "x"].map(is_time), [true, true, false, false, false]);
        assert!(known("flip-rat").is_err_and(|text| text.contains("`flip_rate`")));
    }
}

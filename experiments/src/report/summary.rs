//! Converts the rows of a run to one summary for each choice. A *choice* is one combination of view, variant, estimator, noise, temporal resolve and
//! value of the varied parameter. A summary contains the data of one row of a table and of one point of a plot.

use std::collections::{BTreeMap, BTreeSet};

use kernels::shared::signal::Signal;
use kernels::variant::Variant;

use super::RunData;
use super::numbers::{Estimate, Front, Place, half_width, number, pareto_front, significant, with_interval};
use crate::definition::Definition;
use crate::metrics::{self, Needs, timed_pass};
use crate::rounds;
use crate::row::Row;

/// Limit of the number of items that a check of `columns.rs` names.
pub(super) const NAMED: usize = 3;

/// The columns that identify a choice.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key {
    pub(super) experiment: String,
    pub(super) scene: String,
    pub(super) view: String,
    pub(super) variant: String,
    pub(super) estimator: String,
    pub(super) noise: String,
    pub(super) temporal: String,
    pub(super) parameter: String,
    pub(super) setting: String,
}

impl Key {
    /// Returns the key of a row.
    pub(super) fn of(row: &Row) -> Key {
        Key {
            experiment: row.experiment.clone(),
            scene: row.scene.clone(),
            view: row.view.clone(),
            variant: row.variant.clone(),
            estimator: row.estimator.clone(),
            noise: row.noise.clone(),
            temporal: row.temporal.clone(),
            parameter: row.parameter.clone(),
            setting: row.setting.clone(),
        }
    }

    /// Returns the names and values of the columns, in the order of `metrics.csv`.
    pub(super) fn columns(&self) -> [(&'static str, &str); 9] {
        [
            ("experiment", &self.experiment),
            ("scene", &self.scene),
            ("view", &self.view),
            ("variant", &self.variant),
            ("estimator", &self.estimator),
            ("noise", &self.noise),
            ("temporal", &self.temporal),
            ("parameter", &self.parameter),
            ("setting", &self.setting),
        ]
    }

    /// Returns the text of tooltips: the columns that are not empty.
    pub(super) fn words(&self) -> String {
        let parts: Vec<String> =
            self.columns().iter().filter(|(_, v)| !v.is_empty()).map(|(name, value)| format!("{name} = {value}")).collect();
        parts.join(", ")
    }

    /// Whether the choice forces a variant that consists of a single flavour.
    pub(super) fn is_flavour(&self) -> bool {
        self.flavours() == Some(1)
    }

    /// Returns the number of flavours if the choice forces a variant and uses its specialised pipeline; `None` for `auto`, and for all choices that
    /// use the generic kernel.
    pub(super) fn flavours(&self) -> Option<usize> {
        self.variant.parse::<Variant>().ok().map(|v| v.flavours().count())
    }
}

/// The signal of a metric (albedo or the lit picture). It selects the rows that the report uses, by their column `signal`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Of {
    /// The metric has no signal; the column is empty.
    Nothing,
    /// Always the same signal.
    Given(Signal),
    /// The signal that the report ranks and shows: the lit picture if the run measures it, else albedo.
    Shown,
}

/// A metric that a summary can contain. If a metric has a value for each lag, the lag is part of its identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Metric {
    /// The value of the column `metric`.
    pub(super) name: &'static str,
    /// The value of the column `lag`.
    pub(super) lag: Option<u32>,
    pub(super) of: Of,
    /// The name of the metric in sentences.
    pub(super) words: &'static str,
}

/// Returns a metric that has no lag.
const fn still(name: &'static str, of: Of, words: &'static str) -> Metric {
    Metric { name, lag: None, of, words }
}

/// Returns a metric that compares each frame with the previous one.
const fn moving(name: &'static str, of: Of, words: &'static str) -> Metric {
    Metric { name, lag: Some(1), of, words }
}

const ALBEDO: Of = Of::Given(Signal::Albedo);

pub(super) const FETCHES: Metric = still(metrics::FETCHES_PER_PX, Of::Nothing, "fetches per pixel");
pub(super) const TILE_FETCHES: Metric =
    still(metrics::TILE_FETCHES_PER_PX, Of::Nothing, "promised fetches per pixel of the tiles' variants");
pub(super) const SHADING: Metric = still(metrics::SHADING_RATIO, Of::Nothing, "shading time");
const SHADING_MS: Metric = still(metrics::SHADING_TIME, Of::Nothing, "shading time");
pub(super) const BIAS: Metric = still(metrics::BIAS, ALBEDO, metrics::BIAS);
pub(super) const BIAS_P: Metric = still(metrics::BIAS_SQUARED_P, ALBEDO, "probability of biases that cancel");
pub(super) const VARIANCE: Metric = still(metrics::VARIANCE, ALBEDO, metrics::VARIANCE);
pub(super) const EXACT_MSE: Metric = still(metrics::EXACT_MSE, ALBEDO, "mean squared difference from the exact blend");
pub(super) const THEORY: Metric = still(metrics::VARIANCE_THEORY, ALBEDO, "variance predicted");
pub(super) const RMSE: Metric = still(metrics::RMSE, Of::Shown, "RMSE");
pub(super) const FLIP: Metric = still(metrics::FLIP, Of::Shown, "FLIP");
pub(super) const PSNR: Metric = still(metrics::PSNR, Of::Shown, "PSNR");
pub(super) const SSIM: Metric = still(metrics::SSIM, Of::Shown, "SSIM");
pub(super) const FLIPS: Metric = moving(metrics::FLIP_RATE, Of::Nothing, "flip rate");
pub(super) const ADDED: Metric = moving(metrics::ADDED, Of::Shown, "added change");
pub(super) const LOST: Metric = moving(metrics::LOST, Of::Shown, "lost change");
pub(super) const RESIDUAL: Metric = moving(metrics::RESIDUAL, Of::Shown, "residual flicker");
pub(super) const RESIDUAL_P95: Metric = moving(metrics::RESIDUAL_P95, Of::Shown, "residual flicker p95");
pub(super) const PERCEIVED: Metric = still(metrics::PERCEIVED_NOISE, Of::Shown, "perceived noise");
pub(super) const EXCESS: Metric = moving(metrics::EXCESS_DIFFERENCE, Of::Shown, "excess difference");
pub(super) const DISOCCLUDED: Metric = moving(metrics::DISOCCLUDED, Of::Nothing, "disoccluded");
pub(super) const INVALID: Metric = still(metrics::INVALID_PX, Of::Shown, "invalid pixels");
pub(super) const CLUMPING: Metric = still(metrics::CLUMPING, ALBEDO, metrics::CLUMPING);
pub(super) const REJECTIONS: Metric = still(metrics::TAA_REJECTIONS, Of::Shown, "history rejected");

impl Metric {
    /// Returns this metric for a fixed signal. Without it, a metric is that of the signal that the report shows.
    pub(super) fn of(self, signal: Signal) -> Metric {
        Metric { of: Of::Given(signal), ..self }
    }

    /// Whether the metric is a number of fetches. Such a number counts as exact, although it may differ from frame to frame.
    fn is_exact(self) -> bool {
        self == FETCHES || self == TILE_FETCHES
    }
}

/// The frames to which a number applies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frames {
    /// All frames. The run contains a row over all frames.
    All,
    /// This single frame. It is the only frame for which the run contains a row.
    One(u32),
    /// All frames that have a row. The report computed the mean of their finite values.
    Mean {
        /// Number of frames whose value is finite.
        finite: usize,
        /// Number of frames that have a row.
        rows: usize,
    },
}

/// A number of a choice, with the frames to which it applies.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Number {
    pub(super) value: f64,
    pub(super) standard_error: Option<f64>,
    /// Degrees of freedom of the standard error, as its row gives them.
    freedom: Option<f64>,
    /// Degrees of freedom that the standard error should have by the definition of the run. They are used if the row does not give any.
    implied_freedom: f64,
    pub(super) unit: String,
    pub(super) frames: Frames,
}

impl Number {
    /// Returns the standard error, if it is known.
    fn error(&self) -> Option<f64> {
        self.standard_error.filter(|e| e.is_finite() && *e >= 0.0)
    }

    /// Returns the degrees of freedom of the standard error that its row gives.
    fn recorded_freedom(&self) -> Option<f64> {
        self.freedom.filter(|freedom| freedom.is_finite() && *freedom > 0.0)
    }

    /// Returns the degrees of freedom of the standard error, for intervals and comparisons.
    fn any_freedom(&self) -> f64 {
        self.recorded_freedom().unwrap_or(self.implied_freedom)
    }

    /// Returns the half-width of the 95 % confidence interval, if the standard error is known.
    pub(super) fn half(&self) -> Option<f64> {
        self.error().map(|error| half_width(error, self.any_freedom())).filter(|half| half.is_finite())
    }
}

/// The columns that identify a number of a choice.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Name {
    metric: String,
    lag: Option<u32>,
    signal: String,
}

/// The measurements of one choice.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Summary {
    pub(super) key: Key,
    numbers: BTreeMap<Name, Number>,
    /// The power spectrum: frequencies (cycles per pixel), each with its power.
    pub(super) spectrum: Vec<(f64, Number)>,
    /// The signal that the report shows.
    shown: Signal,
}

impl Summary {
    /// Returns the value of the column `signal` in the rows of a metric.
    pub(super) fn signal(&self, metric: Metric) -> &'static str {
        match metric.of {
            Of::Nothing => "",
            Of::Given(signal) => signal.name(),
            Of::Shown => self.shown.name(),
        }
    }

    /// Returns the number of a metric; `None` if it has no row. The value may be NaN.
    pub(super) fn number(&self, metric: Metric) -> Option<&Number> {
        let name = Name { metric: metric.name.to_owned(), lag: metric.lag, signal: self.signal(metric).to_owned() };
        self.numbers.get(&name)
    }

    /// Returns the value of a metric; NaN if it has no row.
    pub(super) fn value(&self, metric: Metric) -> f64 {
        self.number(metric).map_or(f64::NAN, |n| n.value)
    }

    /// Returns the standard error of a metric's value; `None` if it is not known, or if the value is exact.
    pub(super) fn error(&self, metric: Metric) -> Option<f64> {
        if metric.is_exact() { None } else { self.number(metric).and_then(Number::error) }
    }

    /// Returns the half-width of the 95 % confidence interval of a metric's value; `None` if it is not known, or if the value is exact.
    pub(super) fn half(&self, metric: Metric) -> Option<f64> {
        if metric.is_exact() { None } else { self.number(metric).and_then(Number::half) }
    }

    /// Returns the value of a metric with its standard error, for comparisons; NaN if it has no row. If the standard error should exist but is not
    /// known ([`Summary::is_doubtful`]), it is set to infinity, so that the value does not count as different from any other.
    pub(super) fn estimate(&self, metric: Metric) -> Estimate {
        let freedom = self.number(metric).map_or(f64::INFINITY, Number::any_freedom);
        let unknown = if self.is_doubtful(metric) { f64::INFINITY } else { 0.0 };
        Estimate { error: self.error(metric).unwrap_or(unknown), freedom, ..Estimate::exact(self.value(metric)) }
    }

    /// Whether a metric needs several frames, and its value over all frames has no known standard error. This is so for percentiles, for example, and
    /// if only one frame, or one pair of frames, was measured. It is then unknown how much the value scatters.
    pub(super) fn is_doubtful(&self, metric: Metric) -> bool {
        let of_frames = metrics::find(metric.name).is_some_and(|m| m.needs == Needs::Frames);
        let number = self.number(metric).filter(|number| of_frames && number.frames == Frames::All);
        number.is_some_and(|number| number.error().is_none())
    }

    /// Returns the degrees of freedom of a metric's standard error, if its row gives them.
    pub(super) fn freedom(&self, metric: Metric) -> Option<f64> {
        self.number(metric).and_then(Number::recorded_freedom)
    }

    /// Whether the measured variance, the predicted variance or the flip rate shows that the choice makes random decisions.
    pub(super) fn is_stochastic(&self) -> bool {
        [VARIANCE, THEORY, FLIPS].iter().any(|m| self.value(*m) > 0.0)
    }

    /// Returns the lags for which a metric has numbers, in ascending order, each with its number.
    pub(super) fn over_lags(&self, metric: Metric) -> impl Iterator<Item = (u32, &Number)> {
        let signal = self.signal(metric);
        let is_of_metric = move |name: &Name| name.metric == metric.name && name.signal == signal;
        self.numbers.iter().filter(move |(name, _)| is_of_metric(name)).filter_map(|(name, n)| Some((name.lag?, n)))
    }

    /// Returns the names of timed passes, each with its device time.
    pub(super) fn times(&self) -> impl Iterator<Item = (&str, &Number)> {
        self.numbers.iter().filter_map(|(name, n)| Some((timed_pass(&name.metric)?, n)))
    }

    /// Returns the names of all metrics.
    fn names(&self) -> impl Iterator<Item = &str> {
        self.numbers.keys().map(|name| name.metric.as_str())
    }
}

/// A function that reads one column of a summary's key.
pub(super) type KeyOf = fn(&Summary) -> &str;

/// Facts about the reference with which the pictures of a view are compared, for one signal.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ReferenceFacts {
    pub(super) view: String,
    /// Value of the varied parameter; empty = the reference applies to all values.
    pub(super) setting: String,
    pub(super) signal: Signal,
    /// Samples per pixel.
    pub(super) spp: f64,
    /// Standard error of the reference, in the unit of the RMSE.
    pub(super) standard_error: f64,
    /// The smallest RMSE of the choices that are compared with the reference; NaN = none was measured.
    pub(super) smallest_rmse: f64,
    /// Mean difference in luminance between consecutive frames of the reference sequence, for each temporal resolve by name (empty = none). The
    /// reference sequence passes through the same resolve.
    pub(super) differences: BTreeMap<String, f64>,
    /// Number of terrain pixels without a finite colour in the reference sequence, over all measured frames; NaN = they were not counted. If there
    /// are several sequences, it is the largest of their numbers.
    pub(super) invalid: f64,
}

impl ReferenceFacts {
    /// Whether the reference is accurate enough. Its standard error must be at most a tenth of the smallest RMSE of the choices that are compared
    /// with it. If no such RMSE was measured, it is enough that the standard error is known.
    pub(super) fn suffices(&self) -> bool {
        self.standard_error <= 0.1 * self.smallest_rmse || (self.smallest_rmse.is_nan() && self.standard_error.is_finite())
    }
}

/// The shading time of a choice, divided by that of the base of its view ([`Table::shading_base`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shading {
    pub(super) ratio: f64,
    /// Standard error of the ratio; `None` = unknown.
    pub(super) error: Option<f64>,
    /// Whether the choice and the base were timed in the same rounds. Choices with different values of the varied parameter were not.
    pub(super) is_interleaved: bool,
}

impl Shading {
    /// Whether the ratio may take part in fronts and sentences.
    pub(super) fn is_stable(&self) -> bool {
        rounds::is_stable(self.ratio, self.error)
    }

    /// Whether the choice and the base were timed in the same rounds, but the ratio is not known well enough for fronts and sentences.
    pub(super) fn is_unstable(&self) -> bool {
        self.is_interleaved && !self.is_stable()
    }

    /// Returns the ratio for fronts and sentences; `None` if it is not stable, so that it takes no part in them.
    pub(super) fn estimate(&self) -> Option<Estimate> {
        let error = self.error.filter(|_| self.is_stable())?;
        Some(Estimate { error, ..Estimate::exact(self.ratio) })
    }

    /// Returns the half-width of the 95 % interval; 0 = unknown, or the ratio is that of the base, which is exact.
    pub(super) fn half_width(&self) -> f64 {
        self.error.map_or(0.0, |error| rounds::NORMAL_95 * error)
    }

    /// Returns the text of a table cell: the ratio with its interval, or why it takes no part in fronts and sentences.
    pub(super) fn shown(&self) -> String {
        let (ratio, half) = (significant(self.ratio), self.half_width());
        match self.error {
            _ if !self.is_interleaved => format!("{ratio}, not interleaved"),
            None => format!("{ratio}, unstable (no interval)"),
            Some(_) if !self.is_stable() => format!("{ratio}, unstable (\u{b1} {} %)", number(100.0 * half / self.ratio)),
            Some(_) if half > 0.0 => with_interval(self.ratio, Some(half)),
            Some(_) => ratio,
        }
    }
}

/// All numbers of a run, in the order of the definition.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub(super) summaries: Vec<Summary>,
    pub(super) references: Vec<ReferenceFacts>,
    /// The values that occur in the column `view`. Each of the next five fields has the values of another column.
    pub(super) views: Vec<String>,
    pub(super) variants: Vec<String>,
    pub(super) estimators: Vec<String>,
    pub(super) noises: Vec<String>,
    pub(super) temporal: Vec<String>,
    pub(super) settings: Vec<String>,
    /// The varied parameter; empty = none.
    pub(super) parameter: String,
    /// Number of rows that have the same choice, metric, signal, lag, frequency and frame as an earlier row. They are ignored.
    pub(super) doubles: usize,
    /// Number of values that are means over frames, computed by the report.
    pub(super) averaged: usize,
    /// Number of rows whose value is NaN, and copies of the first few. They are left out of means and plots, and they are not ranked.
    pub(super) without_number: (usize, Vec<Row>),
    /// The signals that the run measures.
    pub(super) signals: Vec<Signal>,
    /// The signal that the report ranks and shows.
    pub(super) shown: Signal,
    /// Number of frames that are shown per second. The metric `perceived_noise` depends on it.
    pub(super) frames_per_second: f64,
    /// Whether the sequence is long enough for the metric `perceived_noise` ([`metrics::Sequence::is_memory_filled`]). If not, no ranking and no
    /// sentence uses this metric.
    pub(super) is_memory_filled: bool,
    /// The metric that is used as the cost of a choice.
    pub(super) cost: Metric,
    /// The metric that is used as the error of a choice.
    pub(super) error: Metric,
}

/// The rows of one metric, signal, lag and frequency, accumulated for their mean.
#[derive(Default)]
struct Slot {
    whole: Option<Number>,
    sum: f64,
    finite: usize,
    /// The frames for which there is a row.
    frames: BTreeSet<u32>,
    /// The first row of a single frame.
    single: Option<Number>,
}

impl Slot {
    /// Returns the number that represents all frames. This is the row over all frames, if there is one. Otherwise, it is the row of the only frame or
    /// the mean of the finite values of several frames. Infinite values are omitted from the mean: a frame that equals its reference has an infinite
    /// PSNR, which would make the mean infinite.
    fn number(self) -> Option<Number> {
        let Slot { whole, sum, finite, frames, single } = self;
        if whole.is_some() {
            return whole;
        }
        let single = single?;
        if frames.len() == 1 {
            return Some(single);
        }
        let value = if finite > 0 { sum / finite as f64 } else { f64::NAN };
        // Consecutive frames are correlated, so the standard error of the mean cannot be computed from the scatter of their values.
        Some(Number { value, standard_error: None, freedom: None, frames: Frames::Mean { finite, rows: frames.len() }, ..single })
    }
}

/// The rows of one choice, by name and by the bits of the frequency. Frequencies are not negative, so their bits have the same order as their values.
type Slots = BTreeMap<(Name, Option<u64>), Slot>;

/// Whether a row describes the reference and not a choice.
fn is_of_reference(row: &Row) -> bool {
    row.metric.starts_with("reference_") || row.variant.is_empty() || row.variant == "reference"
}

/// Returns the degrees of freedom of a metric's standard error for rows that do not give them. Examples are rows of `clumping`, of spectra and of
/// times, and in tables of earlier versions rows of metrics over frames. If a standard error is computed from the scatter of n values, it has n - 1
/// degrees of freedom. Here n follows from the definition, as if each frame or seed had a value. If a standard error is derived from theory or from
/// an interval, the result is infinite.
fn implied_freedom(definition: &Definition, metric: &str, lag: Option<u32>) -> f64 {
    let sequence = definition.sequence();
    let values = match metrics::find(metric).map(|metric| metric.needs) {
        // The standard error of a band of a spectrum is derived from theory.
        _ if metric == metrics::POWER => return f64::INFINITY,
        _ if metric == metrics::PERCEIVED_NOISE => sequence.seen_frames(),
        Some(Needs::Seeds) => definition.seeds,
        // The standard error of a time is derived from the interval of its median, and it is treated as known exactly.
        Some(Needs::Clock) => return f64::INFINITY,
        _ => {
            let compared = sequence.compared(lag.unwrap_or(0));
            if metrics::RESIDUALS.contains(&metric) { compared.min(metrics::GROUPS) } else { compared }
        }
    };
    // A standard error needs at least two values.
    f64::from(values.max(2) - 1)
}

impl Table {
    /// Summarises all rows of a run.
    pub(super) fn of(run: &RunData) -> Table {
        let mut slots: BTreeMap<Key, Slots> = BTreeMap::new();
        // Rows about a reference, by view, setting and temporal resolve.
        let mut about_reference: BTreeMap<(String, String), BTreeMap<String, Slots>> = BTreeMap::new();
        let mut doubles = 0;
        let mut without_number = (0, Vec::new());
        for row in run.rows.iter().chain(&run.times) {
            if row.value.is_nan() {
                without_number.0 += 1;
                without_number.1.extend((without_number.0 <= NAMED).then(|| row.clone()));
            }
            let slots = if is_of_reference(row) {
                let resolves = about_reference.entry((row.view.clone(), row.setting.clone())).or_default();
                resolves.entry(row.temporal.clone()).or_default()
            } else {
                slots.entry(Key::of(row)).or_default()
            };
            let name = Name { metric: row.metric.clone(), lag: row.lag, signal: row.signal.clone() };
            let slot = slots.entry((name, row.frequency.map(f64::to_bits))).or_default();
            let number = |frames| Number {
                value: row.value,
                standard_error: row.standard_error,
                freedom: row.freedom,
                implied_freedom: implied_freedom(&run.definition, &row.metric, row.lag),
                unit: row.unit.clone(),
                frames,
            };
            match row.frame {
                Some(frame) => {
                    if !slot.frames.insert(frame) {
                        doubles += 1;
                        continue;
                    }
                    slot.single.get_or_insert_with(|| number(Frames::One(frame)));
                    if row.value.is_finite() {
                        (slot.sum, slot.finite) = (slot.sum + row.value, slot.finite + 1);
                    }
                }
                None if slot.whole.is_some() => doubles += 1,
                None => slot.whole = Some(number(Frames::All)),
            }
        }
        let has = |signal: &Signal| run.rows.iter().any(|row| row.signal == signal.name());
        let signals: Vec<Signal> = Signal::ALL.into_iter().filter(has).collect();
        let shown = if signals.contains(&Signal::Lit) { Signal::Lit } else { Signal::Albedo };
        let mut averaged = 0;
        let mut summaries: Vec<Summary> = slots
            .into_iter()
            .map(|(key, slots)| {
                let mut summary = Summary { key, numbers: BTreeMap::new(), spectrum: Vec::new(), shown };
                for ((name, frequency), slot) in slots {
                    let Some(number) = slot.number() else { continue };
                    averaged += usize::from(matches!(number.frames, Frames::Mean { .. }));
                    match frequency {
                        Some(bits) if name.metric == metrics::POWER => summary.spectrum.push((f64::from_bits(bits), number)),
                        Some(_) => {}
                        None => {
                            summary.numbers.insert(name, number);
                        }
                    }
                }
                summary
            })
            .collect();
        sort(&mut summaries, run);
        let distinct = |of: fn(&Key) -> &String| {
            let mut values: Vec<String> = Vec::new();
            for summary in &summaries {
                if !values.contains(of(&summary.key)) {
                    values.push(of(&summary.key).clone());
                }
            }
            values
        };
        let parameter = summaries.iter().map(|s| &s.key.parameter).find(|p| !p.is_empty()).cloned().unwrap_or_default();
        let measured = |metric: Metric| summaries.iter().any(|s| s.value(metric).is_finite());
        // The cost of a choice is its counted fetches. They do not depend on the tiles, because each pixel counts only the fetches that it takes
        // itself. Two kinds of runs use the promised fetches of the tiles' variants instead, if these were measured: runs that vary the tiles, and
        // runs in which fetches were not counted.
        let by_tile = parameter == "frame.tile" || parameter == "frame.classification" || !measured(FETCHES);
        let mut table = Table {
            references: Vec::new(),
            views: distinct(|k| &k.view),
            variants: distinct(|k| &k.variant),
            estimators: distinct(|k| &k.estimator),
            noises: distinct(|k| &k.noise),
            temporal: distinct(|k| &k.temporal),
            settings: distinct(|k| &k.setting),
            parameter,
            doubles,
            averaged,
            without_number,
            signals,
            shown,
            frames_per_second: run.definition.viewing.frames_per_second,
            is_memory_filled: run.definition.sequence().is_memory_filled(run.definition.viewing.of_meter().adaptation()),
            cost: if by_tile && measured(TILE_FETCHES) { TILE_FETCHES } else { FETCHES },
            error: if measured(RMSE) || !measured(FLIP) { RMSE } else { FLIP },
            summaries,
        };
        let mut references: Vec<ReferenceFacts> =
            about_reference.into_iter().flat_map(|(place, resolves)| table.facts(&place, resolves)).collect();
        // A view without rows about its reference is listed, too, if a choice has an RMSE in this view.
        for view in &table.views {
            if !references.iter().any(|r| r.view == *view) {
                let facts = table.facts(&(view.clone(), String::new()), BTreeMap::new());
                references.extend(facts.into_iter().filter(|facts| facts.smallest_rmse.is_finite()));
            }
        }
        let order = |view: &String| table.views.iter().position(|v| v == view);
        let settings = |setting: &String| table.settings.iter().position(|s| s == setting);
        references.sort_by_key(|r| (order(&r.view), settings(&r.setting), r.signal as u8));
        table.references = references;
        table
    }

    /// Returns the facts about a reference, for each signal of the run. `resolves`: the rows about the reference, by temporal resolve.
    fn facts(&self, (view, setting): &(String, String), resolves: BTreeMap<String, Slots>) -> Vec<ReferenceFacts> {
        let numbers: BTreeMap<String, BTreeMap<Name, f64>> = resolves
            .into_iter()
            .map(|(resolve, slots)| {
                let values = slots.into_iter().filter(|((_, frequency), _)| frequency.is_none());
                (resolve, values.filter_map(|((name, _), slot)| Some((name, slot.number()?.value))).collect())
            })
            .collect();
        let of_signal = |signal: Signal| {
            let value = |resolve: &str, metric: &str, lag: Option<u32>, signal: &str| {
                let name = Name { metric: metric.to_owned(), lag, signal: signal.to_owned() };
                numbers.get(resolve).and_then(|values| values.get(&name)).copied()
            };
            let own = |metric: &str, signal: &str| value("", metric, None, signal).unwrap_or(f64::NAN);
            let difference =
                |resolve: &String| Some((resolve.clone(), value(resolve, metrics::REFERENCE_DIFFERENCE, Some(1), signal.name())?));
            let judged = self.summaries.iter().filter(|s| s.key.view == *view && (setting.is_empty() || s.key.setting == *setting));
            let errors = judged.map(|s| s.value(RMSE.of(signal))).filter(|v| v.is_finite());
            ReferenceFacts {
                spp: own(metrics::REFERENCE_SPP, ""),
                standard_error: own(metrics::REFERENCE_SE, signal.name()),
                differences: numbers.keys().filter_map(difference).collect(),
                invalid: own(metrics::INVALID_PX, signal.name()),
                smallest_rmse: errors.min_by(f64::total_cmp).unwrap_or(f64::NAN),
                view: view.clone(),
                setting: setting.clone(),
                signal,
            }
        };
        self.signals.iter().map(|&signal| of_signal(signal)).collect()
    }

    /// Returns the label of a choice: the values of those columns that vary. They distinguish the choices of a view.
    pub(super) fn label(&self, key: &Key) -> String {
        let parts = [
            (&self.variants, &key.variant),
            (&self.estimators, &key.estimator),
            (&self.noises, &key.noise),
            (&self.temporal, &key.temporal),
            (&self.settings, &key.setting),
        ];
        let varying: Vec<&str> =
            parts.iter().filter(|(all, _)| all.len() > 1).map(|(_, value)| value.as_str()).filter(|v| !v.is_empty()).collect();
        if varying.is_empty() { key.variant.clone() } else { varying.join(" \u{b7} ") }
    }

    /// Returns the label of a choice, with its view if there are several.
    pub(super) fn place(&self, key: &Key) -> String {
        let view = if self.views.len() > 1 { format!(", {}", key.view) } else { String::new() };
        self.label(key) + &view
    }

    /// Returns the indices of the summaries of a view.
    pub(super) fn of_view(&self, view: &str) -> Vec<usize> {
        (0..self.summaries.len()).filter(|&i| self.summaries[i].key.view == view).collect()
    }

    /// Returns the index of the base of a view: the first timed choice. The shading times of the view are divided by its time, so its ratio is
    /// exactly 1 and has the standard error 0. `None` if the files do not contain the base.
    pub(super) fn shading_base(&self, view: &str) -> Option<usize> {
        self.of_view(view).into_iter().find(|&i| self.summaries[i].value(SHADING) > 0.0 && self.summaries[i].error(SHADING) == Some(0.0))
    }

    /// Returns the shading time of a choice, divided by that of the base of its view; `None` if there is no ratio. In the rows, ratios refer to the
    /// first choice with the same value of the varied parameter. If the base has another value of the parameter, the times themselves are divided.
    /// Such a ratio has no interval, because the speed of the machine may have changed between the two measurements.
    pub(super) fn shading(&self, index: usize) -> Option<Shading> {
        let summary = &self.summaries[index];
        let own = Shading { ratio: summary.value(SHADING), error: summary.error(SHADING), is_interleaved: true };
        let base = self.shading_base(&summary.key.view).map(|i| &self.summaries[i]);
        let shading = match base {
            Some(base) if base.key.setting != summary.key.setting => {
                let ratio = summary.value(SHADING_MS) / base.value(SHADING_MS);
                Shading { ratio, error: None, is_interleaved: false }
            }
            _ => own,
        };
        (own.ratio > 0.0 && shading.ratio > 0.0 && shading.ratio.is_finite()).then_some(shading)
    }

    /// Returns the Pareto front among `rows` ([`pareto_front`]), as indices of summaries. A cost of 0 is treated as not measured, and so is a shading
    /// time that is not stable.
    pub(super) fn front(&self, rows: &[usize], cost: Metric, error: Metric) -> Front {
        let place = |&i: &usize| {
            let summary = &self.summaries[i];
            let cost = match cost {
                SHADING => self.shading(i).and_then(|shading| shading.estimate()),
                _ => Some(summary.estimate(cost)).filter(|cost| cost.value > 0.0),
            };
            Place { cost: cost.unwrap_or(Estimate::exact(f64::NAN)), error: summary.estimate(error) }
        };
        let places: Vec<Place> = rows.iter().map(place).collect();
        let named = |points: Vec<usize>| points.into_iter().map(|i| rows[i]).collect::<Vec<usize>>();
        let Front { points, alike } = pareto_front(&places);
        Front { points: named(points), alike: alike.into_iter().map(named).collect() }
    }

    /// Whether any summary has a value of the metric.
    pub(super) fn has(&self, metric: Metric) -> bool {
        self.summaries.iter().any(|s| !s.value(metric).is_nan())
    }

    /// Returns the number of choices among `rows` whose shading time is unstable, and the number of timed choices. Neither number includes times that
    /// were measured in other rounds than the time of the base ([`Shading::is_interleaved`]).
    pub(super) fn unstable(&self, rows: &[usize]) -> (usize, usize) {
        let timed: Vec<Shading> = rows.iter().filter_map(|&i| self.shading(i)).filter(|shading| shading.is_interleaved).collect();
        (timed.iter().filter(|shading| shading.is_unstable()).count(), timed.len())
    }

    /// Returns the device time of the shading pass of a choice, ms; NaN if it was not measured.
    pub(super) fn shading_ms(&self, index: usize) -> f64 {
        self.summaries[index].value(SHADING_MS)
    }

    /// Returns the names of the metrics of choices, except device times and their ratios, and except spectra.
    pub(super) fn metric_names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.summaries.iter().flat_map(Summary::names).filter(|n| !metrics::is_time(n)).map(str::to_owned).collect();
        names.sort();
        names.dedup();
        names
    }
}

/// Returns a value of the varied parameter as text without quotes. A whole float may have another form than in rows (1.0 instead of 1).
fn setting_text(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Sorts the summaries by experiment, view, variant, estimator, noise, temporal resolve and setting. The values of all columns but the first have the
/// order of the definition. Values that the definition does not contain come last.
fn sort(summaries: &mut [Summary], run: &RunData) {
    let definition = &run.definition;
    let views: Vec<&String> = definition.views.iter().chain(definition.moving_views.iter().map(|v| &v.name)).collect();
    let settings: Vec<String> = definition.vary.iter().flat_map(|v| v.values.iter().map(setting_text)).collect();
    let listed = |all: &[String], value: &str| all.iter().position(|v| v == value).unwrap_or(all.len());
    let variant = |name: &str| {
        // The entry `all` stands for the 31 variants, sorted by their numbers. An entry can also be the number of a variant instead of its name.
        let mask = name.parse::<Variant>().ok();
        let named = |entry: &String| entry == name || (mask.is_some() && (entry == "all" || entry.parse::<Variant>().ok() == mask));
        let place = definition.variants.iter().position(named).unwrap_or(definition.variants.len());
        (place, mask.map(Variant::mask))
    };
    let number = |text: &str| text.parse::<f64>().unwrap_or(f64::INFINITY);
    summaries.sort_by_cached_key(|s| {
        let key = &s.key;
        // The same float can be written in different ways (1 or 1.0), so numbers are compared by value.
        let setting = settings
            .iter()
            .position(|v| *v == key.setting || (number(v).is_finite() && number(v).to_bits() == number(&key.setting).to_bits()));
        (
            (key.experiment.clone(), views.iter().position(|v| **v == key.view).unwrap_or(views.len()), key.view.clone()),
            variant(&key.variant),
            listed(&definition.estimators, &key.estimator),
            listed(&definition.noises, &key.noise),
            listed(&definition.temporal, &key.temporal),
            setting.unwrap_or(settings.len()),
            key.clone(),
        )
    });
}

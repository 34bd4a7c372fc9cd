//! Converts rows to one summary for each choice. A summary contains the data of one row of a table and of one point of a plot.

use std::collections::{BTreeMap, BTreeSet};

use kernels::variant::Variant;

use super::RunData;
use super::numbers::pareto_front;
use crate::metrics::{self, timed_pass};
use crate::row::Row;

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

    /// Returns the names and values of the columns, in the order of the file.
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

    /// Returns the number of flavours of a variant that is forced in its own pipeline; `None` for `auto`, and for all choices that use the
    /// generic kernel.
    pub(super) fn flavours(&self) -> Option<usize> {
        self.variant.parse::<Variant>().ok().map(|v| v.flavours().count())
    }
}

/// A metric whose value a summary contains. If the metric compares frames, its lag is part of its identity.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Metric {
    /// The value of the column `metric`.
    pub(super) name: &'static str,
    /// The value of the column `lag`.
    pub(super) lag: Option<u32>,
    /// The name of the metric in sentences.
    pub(super) words: &'static str,
}

/// Returns a metric that has no lag.
const fn still(name: &'static str, words: &'static str) -> Metric {
    Metric { name, lag: None, words }
}

/// Returns a metric that compares each frame with the previous one.
const fn moving(name: &'static str, words: &'static str) -> Metric {
    Metric { name, lag: Some(1), words }
}

pub(super) const FETCHES: Metric = still(metrics::FETCHES_PER_PX, "fetches per pixel");
pub(super) const TILE_FETCHES: Metric = still(metrics::TILE_FETCHES_PER_PX, "promised fetches per pixel of the tiles' variants");
pub(super) const SHADING: Metric = still(metrics::SHADING_TIME, "shading time");
pub(super) const BIAS: Metric = still(metrics::BIAS, metrics::BIAS);
pub(super) const VARIANCE: Metric = still(metrics::VARIANCE, metrics::VARIANCE);
pub(super) const THEORY: Metric = still(metrics::VARIANCE_THEORY, "variance predicted");
pub(super) const RMSE: Metric = still(metrics::RMSE, "RMSE");
pub(super) const FLIP: Metric = still(metrics::FLIP, "FLIP");
pub(super) const PSNR: Metric = still(metrics::PSNR, "PSNR");
pub(super) const SSIM: Metric = still(metrics::SSIM, "SSIM");
pub(super) const FLIPS: Metric = moving(metrics::FLIP_RATE, "flip rate");
pub(super) const FLICKER: Metric = moving(metrics::FLICKER, metrics::FLICKER);
pub(super) const FLICKER_P95: Metric = moving(metrics::FLICKER_P95, "flicker p95");
pub(super) const CLUMPING: Metric = still(metrics::CLUMPING, metrics::CLUMPING);
pub(super) const REJECTIONS: Metric = still(metrics::TAA_REJECTIONS, "history rejected");

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
    pub(super) unit: String,
    /// The frames to which the number applies.
    pub(super) frames: Frames,
}

/// The measurements of one choice.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Summary {
    pub(super) key: Key,
    numbers: BTreeMap<(String, Option<u32>), Number>,
    /// The power spectrum: frequencies (cycles per pixel), each with its power.
    pub(super) spectrum: Vec<(f64, Number)>,
}

impl Summary {
    /// Returns the number of a metric; `None` if it has no row. The value may be NaN.
    pub(super) fn number(&self, metric: Metric) -> Option<&Number> {
        self.named(metric.name, metric.lag)
    }

    /// Returns the number with these values in the columns `metric` and `lag`.
    pub(super) fn named(&self, metric: &str, lag: Option<u32>) -> Option<&Number> {
        self.numbers.get(&(metric.to_owned(), lag))
    }

    /// Returns the value of a metric; NaN if it has no row.
    pub(super) fn value(&self, metric: Metric) -> f64 {
        self.number(metric).map_or(f64::NAN, |n| n.value)
    }

    /// Returns the standard error of a metric's value, if it is known.
    pub(super) fn error(&self, metric: Metric) -> Option<f64> {
        self.number(metric).and_then(|n| n.standard_error).filter(|e| e.is_finite() && *e >= 0.0)
    }

    /// Whether the choice is stochastic. Deterministic choices have neither bias nor variance to report.
    pub(super) fn is_stochastic(&self) -> bool {
        [VARIANCE, THEORY, FLIPS].iter().any(|m| self.value(*m) > 0.0)
    }

    /// Returns the lags for which a metric has numbers, in ascending order, each with its number.
    pub(super) fn over_lags<'a>(&'a self, metric: &'a str) -> impl Iterator<Item = (u32, &'a Number)> {
        self.numbers.iter().filter(move |((name, _), _)| name == metric).filter_map(|((_, lag), n)| Some(((*lag)?, n)))
    }

    /// Returns the names of timed passes, each with its device time.
    pub(super) fn times(&self) -> impl Iterator<Item = (&str, &Number)> {
        self.numbers.iter().filter_map(|((name, _), n)| Some((timed_pass(name)?, n)))
    }

    /// Returns the names of all metrics.
    fn names(&self) -> impl Iterator<Item = &str> {
        self.numbers.keys().map(|(name, _)| name.as_str())
    }
}

/// A function that reads one column of a summary's key.
pub(super) type KeyOf = fn(&Summary) -> &str;

/// Facts about the reference with which the pictures of a view are compared.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ReferenceFacts {
    pub(super) view: String,
    /// Value of the varied parameter; empty = the reference applies to all values.
    pub(super) setting: String,
    /// Samples per pixel.
    pub(super) spp: f64,
    /// Standard error of the reference, in linear albedo.
    pub(super) standard_error: f64,
    /// The smallest RMSE of the choices that are compared with the reference; NaN = none was measured.
    pub(super) smallest_rmse: f64,
    /// Mean difference in luminance between consecutive frames of the reference sequence. The flicker of a choice is the same difference in its own
    /// sequence, minus this value. NaN = not measured.
    pub(super) difference: f64,
}

impl ReferenceFacts {
    /// Whether the reference is accurate enough. Its standard error must be at most a tenth of the smallest RMSE of the choices that are compared
    /// with it. If no such RMSE was measured, it is enough that the standard error is known.
    pub(super) fn suffices(&self) -> bool {
        self.standard_error <= 0.1 * self.smallest_rmse || (self.smallest_rmse.is_nan() && self.standard_error.is_finite())
    }
}

/// All numbers of a run, in the order of the definition.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub(super) summaries: Vec<Summary>,
    pub(super) references: Vec<ReferenceFacts>,
    /// The values that occur in each column.
    pub(super) views: Vec<String>,
    pub(super) variants: Vec<String>,
    pub(super) estimators: Vec<String>,
    pub(super) noises: Vec<String>,
    pub(super) temporal: Vec<String>,
    pub(super) settings: Vec<String>,
    /// The varied parameter; empty = none.
    pub(super) parameter: String,
    /// Number of rows that repeat the number of an earlier row. They are ignored.
    pub(super) doubles: usize,
    /// Number of values that are means over frames, computed by the report.
    pub(super) averaged: usize,
    /// The metric that is used as the cost of a choice.
    pub(super) cost: Metric,
    /// The metric that is used as the error of a choice.
    pub(super) error: Metric,
}

/// The rows of one metric, lag and frequency, accumulated for their mean.
#[derive(Default)]
struct Slot {
    whole: Option<Number>,
    sum: f64,
    finite: usize,
    /// The frames that have a row of their own.
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
        Some(Number { value, standard_error: None, frames: Frames::Mean { finite, rows: frames.len() }, ..single })
    }
}

type Slots = BTreeMap<(String, Option<u32>, Option<u64>), Slot>;

/// Whether a row describes the reference and not a choice.
fn is_of_reference(row: &Row) -> bool {
    row.metric.starts_with("reference_") || row.variant.is_empty() || row.variant == "reference"
}

impl Table {
    /// Summarises all rows of a run.
    pub(super) fn of(run: &RunData) -> Table {
        let mut slots: BTreeMap<Key, Slots> = BTreeMap::new();
        let mut about_reference: BTreeMap<(String, String), Slots> = BTreeMap::new();
        let mut doubles = 0;
        for row in run.rows.iter().chain(&run.times) {
            let slots = if is_of_reference(row) {
                about_reference.entry((row.view.clone(), row.setting.clone())).or_default()
            } else {
                slots.entry(Key::of(row)).or_default()
            };
            // Frequencies are not negative, so their bits have the same order as their values.
            let slot = slots.entry((row.metric.clone(), row.lag, row.frequency.map(f64::to_bits))).or_default();
            let number = |frames| Number { value: row.value, standard_error: row.standard_error, unit: row.unit.clone(), frames };
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
        let mut averaged = 0;
        let mut summaries: Vec<Summary> = slots
            .into_iter()
            .map(|(key, slots)| {
                let mut summary = Summary { key, numbers: BTreeMap::new(), spectrum: Vec::new() };
                for ((metric, lag, frequency), slot) in slots {
                    let Some(number) = slot.number() else { continue };
                    averaged += usize::from(matches!(number.frames, Frames::Mean { .. }));
                    match frequency {
                        Some(bits) if metric == metrics::POWER => summary.spectrum.push((f64::from_bits(bits), number)),
                        Some(_) => {}
                        None => {
                            summary.numbers.insert((metric, lag), number);
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
        // The cost of a choice is its counted fetches. They do not depend on the tiles, because each pixel counts only the fetches that it
        // takes itself. If the run varies the tiles, the cost is therefore the promised fetches of the tiles' variants. These are also the
        // cost if fetches were not counted.
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
            cost: if by_tile && measured(TILE_FETCHES) { TILE_FETCHES } else { FETCHES },
            error: if measured(RMSE) || !measured(FLIP) { RMSE } else { FLIP },
            summaries,
        };
        table.references = about_reference.into_iter().map(|(place, slots)| table.facts(place, slots)).collect();
        // A view without rows about its reference is listed, too, if a choice has an RMSE in this view.
        for view in table.views.clone() {
            if !table.references.iter().any(|r| r.view == view) {
                let facts = table.facts((view, String::new()), Slots::new());
                table.references.extend(facts.smallest_rmse.is_finite().then_some(facts));
            }
        }
        let order = |view: &String| table.views.iter().position(|v| v == view);
        let settings = |setting: &String| table.settings.iter().position(|s| s == setting);
        let mut references = std::mem::take(&mut table.references);
        references.sort_by_key(|r| (order(&r.view), settings(&r.setting)));
        table.references = references;
        table
    }

    fn facts(&self, (view, setting): (String, String), mut slots: Slots) -> ReferenceFacts {
        let mut value = |name: &str, lag| slots.remove(&(name.to_owned(), lag, None)).and_then(Slot::number).map_or(f64::NAN, |n| n.value);
        let judged = self.summaries.iter().filter(|s| s.key.view == view && (setting.is_empty() || s.key.setting == setting));
        let smallest_rmse = judged.map(|s| s.value(RMSE)).filter(|v| v.is_finite()).min_by(f64::total_cmp).unwrap_or(f64::NAN);
        ReferenceFacts {
            spp: value(metrics::REFERENCE_SPP, None),
            standard_error: value(metrics::REFERENCE_SE, None),
            difference: value(metrics::REFERENCE_DIFFERENCE, Some(1)),
            smallest_rmse,
            view,
            setting,
        }
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

    /// Returns the indices of the summaries of a view.
    pub(super) fn of_view(&self, view: &str) -> Vec<usize> {
        (0..self.summaries.len()).filter(|&i| self.summaries[i].key.view == view).collect()
    }

    /// Returns the indices of the Pareto front among `rows`, by increasing cost. A summary is on the front if no other summary of `rows` dominates
    /// it. A cost of 0 is treated as not measured.
    pub(super) fn front(&self, rows: &[usize], cost: Metric, error: Metric) -> Vec<usize> {
        let place = |&i: &usize| {
            let cost = self.summaries[i].value(cost);
            (if cost > 0.0 { cost } else { f64::NAN }, self.summaries[i].value(error))
        };
        let places: Vec<(f64, f64)> = rows.iter().map(place).collect();
        pareto_front(&places).into_iter().map(|i| rows[i]).collect()
    }

    /// Whether any summary has a value of the metric.
    pub(super) fn has(&self, metric: Metric) -> bool {
        self.summaries.iter().any(|s| !s.value(metric).is_nan())
    }

    /// Returns the names of all metrics of the run, except device times.
    pub(super) fn metric_names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.summaries.iter().flat_map(Summary::names).filter(|n| timed_pass(n).is_none()).map(str::to_owned).collect();
        names.sort();
        names.dedup();
        names
    }
}

/// Returns a value of the varied parameter as text in the form that rows contain, which has no quotes.
fn setting_text(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Sorts the summaries by view, variant, estimator, noise, temporal resolve and setting. Each column has the order of the definition. Values that the
/// definition does not contain come last.
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

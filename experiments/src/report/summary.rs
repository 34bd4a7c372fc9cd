//! From tidy rows to one summary per choice: what a table's row and a plot's point are made of.

use std::collections::BTreeMap;

use kernels::variant::Variant;

use super::RunData;
use super::numbers::pareto_front;
use crate::metrics::{self, timed_pass};
use crate::row::Row;

/// The columns that say which choice a number belongs to.
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
    /// The key of a row.
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

    /// Names and values of the columns, in their order in the files.
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

    /// In words, for tooltips: the columns that are not empty.
    pub(super) fn words(&self) -> String {
        let parts: Vec<String> =
            self.columns().iter().filter(|(_, v)| !v.is_empty()).map(|(name, value)| format!("{name} = {value}")).collect();
        parts.join(", ")
    }

    /// Whether one flavour alone was forced.
    pub(super) fn is_flavour(&self) -> bool {
        self.flavours() == Some(1)
    }

    /// How many flavours were forced; `None` of a variant that each tile chooses.
    pub(super) fn flavours(&self) -> Option<usize> {
        self.variant.parse::<Variant>().ok().map(|v| v.flavours().count())
    }
}

/// A metric of a summary: name, and lag where it compares frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Metric {
    /// As in the column `metric`.
    pub(super) name: &'static str,
    /// As in the column `lag`.
    pub(super) lag: Option<u32>,
    /// What a sentence calls it.
    pub(super) words: &'static str,
}

/// Of one frame.
const fn still(name: &'static str, words: &'static str) -> Metric {
    Metric { name, lag: None, words }
}

/// Between a frame and the one before.
const fn moving(name: &'static str, words: &'static str) -> Metric {
    Metric { name, lag: Some(1), words }
}

pub(super) const FETCHES: Metric = still(metrics::FETCHES_PER_PX, "fetches per pixel");
pub(super) const TILE_FETCHES: Metric = still(metrics::TILE_FETCHES_PER_PX, "fetches per pixel as tiles pay them");
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

/// Which frames a number is of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Frames {
    /// All: a row says so.
    All,
    /// This one, of which there is a row, and none of another.
    One(u32),
    /// All that there are rows of: the report took the mean over those with a finite value.
    Mean {
        /// How many those are.
        finite: usize,
        /// How many rows there are.
        rows: usize,
    },
}

/// A number of a choice.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Number {
    pub(super) value: f64,
    pub(super) standard_error: Option<f64>,
    pub(super) unit: String,
    /// Where the number is from.
    pub(super) frames: Frames,
}

/// What is measured of one choice.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Summary {
    pub(super) key: Key,
    numbers: BTreeMap<(String, Option<u32>), Number>,
    /// Frequencies (cycles per pixel) and power there.
    pub(super) spectrum: Vec<(f64, Number)>,
}

impl Summary {
    /// A number, if there is a row of it; it may be NaN.
    pub(super) fn number(&self, metric: Metric) -> Option<&Number> {
        self.named(metric.name, metric.lag)
    }

    /// A number by the names of the columns.
    pub(super) fn named(&self, metric: &str, lag: Option<u32>) -> Option<&Number> {
        self.numbers.get(&(metric.to_owned(), lag))
    }

    /// A value; NaN where there is none.
    pub(super) fn value(&self, metric: Metric) -> f64 {
        self.number(metric).map_or(f64::NAN, |n| n.value)
    }

    /// The standard error of a value.
    pub(super) fn error(&self, metric: Metric) -> Option<f64> {
        self.number(metric).and_then(|n| n.standard_error).filter(|e| e.is_finite() && *e >= 0.0)
    }

    /// Whether chance had a part: deterministic choices have no bias and no variance to tell of.
    pub(super) fn is_stochastic(&self) -> bool {
        [VARIANCE, THEORY, FLIPS].iter().any(|m| self.value(*m) > 0.0)
    }

    /// Lags at which a metric was taken, rising, with its numbers.
    pub(super) fn over_lags<'a>(&'a self, metric: &'a str) -> impl Iterator<Item = (u32, &'a Number)> {
        self.numbers.iter().filter(move |((name, _), _)| name == metric).filter_map(|((_, lag), n)| Some(((*lag)?, n)))
    }

    /// Device times of passes, by name.
    pub(super) fn times(&self) -> impl Iterator<Item = (&str, &Number)> {
        self.numbers.iter().filter_map(|((name, _), n)| Some((timed_pass(name)?, n)))
    }

    /// Names of all metrics.
    fn names(&self) -> impl Iterator<Item = &str> {
        self.numbers.keys().map(|(name, _)| name.as_str())
    }
}

/// Reads a column of a summary's key.
pub(super) type KeyOf = fn(&Summary) -> &str;

/// What is known of the reference that a view's errors are taken against.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ReferenceFacts {
    pub(super) view: String,
    /// Value of the varied parameter; empty = of all of them.
    pub(super) setting: String,
    /// Samples per pixel.
    pub(super) spp: f64,
    /// Its standard error, in linear albedo.
    pub(super) standard_error: f64,
    /// The smallest RMSE that is judged by it; NaN = none is.
    pub(super) smallest_rmse: f64,
    /// How the reference sequence itself changes, at a lag of 1: what is taken off flicker; NaN = not measured.
    pub(super) difference: f64,
}

impl ReferenceFacts {
    /// Whether the reference is known at least ten times as well as what it judges.
    pub(super) fn suffices(&self) -> bool {
        self.standard_error <= 0.1 * self.smallest_rmse || (self.smallest_rmse.is_nan() && self.standard_error.is_finite())
    }
}

/// A run's numbers, in the order of its definition.
#[derive(Clone, Debug)]
pub(super) struct Table {
    pub(super) summaries: Vec<Summary>,
    pub(super) references: Vec<ReferenceFacts>,
    /// Values of each column that occur.
    pub(super) views: Vec<String>,
    pub(super) variants: Vec<String>,
    pub(super) estimators: Vec<String>,
    pub(super) noises: Vec<String>,
    pub(super) temporal: Vec<String>,
    pub(super) settings: Vec<String>,
    /// The parameter that is varied; empty = none.
    pub(super) parameter: String,
    /// Rows that say a number again which another row said; the first counts.
    pub(super) doubles: usize,
    /// Numbers that the report averaged over frames.
    pub(super) averaged: usize,
    /// What a choice costs.
    pub(super) cost: Metric,
    /// How far it is from the reference.
    pub(super) error: Metric,
}

/// What rows of one metric add up to.
#[derive(Default)]
struct Slot {
    whole: Option<Number>,
    sum: f64,
    finite: usize,
    frames: usize,
    /// A row of a single frame.
    single: Option<(u32, Number)>,
}

impl Slot {
    /// The number over all frames: its own row, or that of the only frame, or the mean of the frames that have a value. Infinite values are none
    /// in a mean: one frame that equals its reference would make an infinite mean of all others.
    fn number(self) -> Option<Number> {
        let Slot { whole, sum, finite, frames, single } = self;
        if whole.is_some() {
            return whole;
        }
        let (_, single) = single?;
        if frames == 1 {
            return Some(single);
        }
        let value = if finite > 0 { sum / finite as f64 } else { f64::NAN };
        // Frames of a sequence are not independent: their scatter says nothing about the mean.
        Some(Number { value, standard_error: None, frames: Frames::Mean { finite, rows: frames }, ..single })
    }
}

type Slots = BTreeMap<(String, Option<u32>, Option<u64>), Slot>;

/// Whether a row tells of the reference itself.
fn is_of_reference(row: &Row) -> bool {
    row.metric.starts_with("reference_") || row.variant.is_empty() || row.variant == "reference"
}

impl Table {
    /// Sums up all rows of a run.
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
            // Frequencies are not negative, so their bits are in their order.
            let slot = slots.entry((row.metric.clone(), row.lag, row.frequency.map(f64::to_bits))).or_default();
            let number = |frames| Number { value: row.value, standard_error: row.standard_error, unit: row.unit.clone(), frames };
            match row.frame {
                Some(frame) => {
                    // A second row of the same frame is a double, whichever way; of frames that are told once there may be many.
                    if slot.single.as_ref().is_some_and(|(known, _)| *known == frame) {
                        doubles += 1;
                        continue;
                    }
                    slot.single.get_or_insert_with(|| (frame, number(Frames::One(frame))));
                    slot.frames += 1;
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
        // What a whole tile pays is what changes with the tile; elsewhere what a pixel takes says more.
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
        // A view whose errors nothing vouches for is told of, too.
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

    /// Which columns have more than one value: they are what tells choices of a view apart.
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

    /// Indices of a view's summaries.
    pub(super) fn of_view(&self, view: &str) -> Vec<usize> {
        (0..self.summaries.len()).filter(|&i| self.summaries[i].key.view == view).collect()
    }

    /// Indices of the summaries among `rows` that none of them beats in both, by rising first metric. A cost of 0 was not measured.
    pub(super) fn front(&self, rows: &[usize], cost: Metric, error: Metric) -> Vec<usize> {
        let place = |&i: &usize| {
            let cost = self.summaries[i].value(cost);
            (if cost > 0.0 { cost } else { f64::NAN }, self.summaries[i].value(error))
        };
        let places: Vec<(f64, f64)> = rows.iter().map(place).collect();
        pareto_front(&places).into_iter().map(|i| rows[i]).collect()
    }

    /// Whether a metric has a value anywhere.
    pub(super) fn has(&self, metric: Metric) -> bool {
        self.summaries.iter().any(|s| !s.value(metric).is_nan())
    }

    /// Names of all metrics of the run, times apart.
    pub(super) fn metric_names(&self) -> Vec<String> {
        let mut names: Vec<String> =
            self.summaries.iter().flat_map(Summary::names).filter(|n| timed_pass(n).is_none()).map(str::to_owned).collect();
        names.sort();
        names.dedup();
        names
    }
}

/// Text of a value of the varied parameter: as rows have it, whichever way quotes were kept.
fn setting_text(value: &toml::Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}

/// Sorts by view, variant, estimator, noise, temporal resolve and setting, each in the order of the definition; what it does not name comes last.
fn sort(summaries: &mut [Summary], run: &RunData) {
    let definition = &run.definition;
    let views: Vec<&String> = definition.views.iter().chain(definition.moving_views.iter().map(|v| &v.name)).collect();
    let settings: Vec<String> = definition.vary.iter().flat_map(|v| v.values.iter().map(setting_text)).collect();
    let listed = |all: &[String], value: &str| all.iter().position(|v| v == value).unwrap_or(all.len());
    let variant = |name: &str| {
        // `all` stands for the 31 in their order, and a number for a name.
        let mask = name.parse::<Variant>().ok();
        let named = |entry: &String| entry == name || (mask.is_some() && (entry == "all" || entry.parse::<Variant>().ok() == mask));
        let place = definition.variants.iter().position(named).unwrap_or(definition.variants.len());
        (place, mask.map(Variant::mask))
    };
    let number = |text: &str| text.parse::<f64>().unwrap_or(f64::INFINITY);
    summaries.sort_by_cached_key(|s| {
        let key = &s.key;
        // Texts of a float differ by who wrote them (1 or 1.0): numbers of a list are found by value.
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

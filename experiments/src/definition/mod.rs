//! The definition of an experiment as data: the question, what is rendered and measured, the expected results, and the analysis of the results.
//!
//! The types below are the schema of a definition file (TOML). An unknown key is an error.

use std::collections::BTreeMap;
use std::path::PathBuf;

use kernels::frame::VariantChoice;
use kernels::shared::signal::Signal;
use kernels::variant::{NotAVariant, Variant};
use serde::{Deserialize, Serialize};

use crate::metrics::{self, Needs};

mod parameters;
mod parse;
mod validate;

pub(crate) use parameters::{add_bytes, digits, hash};
pub use parse::{load, parse, stored};

/// The contents of a definition file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Short name, used for the run's folder and in the column `experiment`. It consists of ASCII letters, digits, `-` and `_`.
    pub name: String,
    /// The question that the run answers, as one sentence.
    pub question: String,
    /// Markdown paragraphs that say what the results show and what they do not show. They are written after a run, when the results are known.
    #[serde(default)]
    pub analysis: String,
    /// The scene: `default`, a scene file, or a folder that contains a scene.toml. A relative name refers to the folder of the definition file. A
    /// leading `$SCREE_DATA` is replaced by the value of the environment variable. `scene` and `import` exclude each other. If neither is given, the
    /// scene is `default`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// A heightmap from which the scene is made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub import: Option<Import>,
    /// The views: names of the scene's cameras, which do not move, and of the scene's paths.
    #[serde(default)]
    pub views: Vec<String>,
    /// Additional views: cameras that move.
    #[serde(default, rename = "view", skip_serializing_if = "Vec::is_empty")]
    pub moving_views: Vec<MovingView>,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Number of frames of each sequence, at least 1. The time within a sequence is the frame number, not that of a clock.
    pub frames: u32,
    /// Number of frames at the start of each sequence that are drawn, but not measured; less than `frames`. Temporal resolves need them, because a
    /// sequence begins without history. Videos contain these frames.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub warm_up: u32,
    /// Number of seeds for the metrics that need several seeds, such as bias, variance and clumping; 0 = none of these is measured, otherwise at
    /// least 2.
    #[serde(default)]
    pub seeds: u32,
    /// The variants: names or numbers (as text), `generic-` and a name or number, `auto`, `generic`, or `all` for all 31 variants. A
    /// variant is a set of flavours, which are the ways of shading terrain.
    pub variants: Vec<String>,
    /// Estimators of the stochastic flavours. An estimator is a method that computes or approximates the blend of materials.
    #[serde(default = "default_estimators")]
    pub estimators: Vec<String>,
    /// Kinds of noise that drive the random choices of stochastic flavours.
    #[serde(default = "default_noises")]
    pub noises: Vec<String>,
    /// Temporal resolves: `off`, `exponential`, `flipquad`, `flipquad+exponential`.
    #[serde(default = "default_temporal")]
    pub temporal: Vec<String>,
    /// A parameter that is varied, and its values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vary: Option<Vary>,
    /// Settings of the scene and of the frame that apply to the whole run, such as `"flavours.cliff_near_m" = 20.0`.
    #[serde(default, rename = "set", skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, toml::Value>,
    /// Names of the metrics that are measured; empty = all metrics for which `seeds` and `frames` suffice. Device times are requested by `times`
    /// instead.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// The signals that are measured: `albedo`, and `lit` for the lit picture as a screen shows it, with the exposure and the tone curve of the
    /// settings `frame.exposure` and `frame.tone_curve`.
    #[serde(default = "default_signals")]
    pub signals: Vec<String>,
    /// The conditions under which the pictures are viewed. The metric `perceived_noise` and the command lines of `video` depend on them.
    #[serde(default)]
    pub viewing: Viewing,
    /// Whether to store the frames as PNG sequences, with command lines for tools that measure video quality. Of the variants, only single flavours,
    /// `auto` and `generic` are stored. The reference sequences are stored, too.
    #[serde(default)]
    pub video: bool,
    /// Limits of the number of samples per pixel of the reference.
    #[serde(default)]
    pub reference: Reference,
    /// Which combinations of variant, estimator and noise are timed.
    #[serde(default)]
    pub times: Times,
    /// Seconds after which a part of the run begins no further round of timing, above 0 and at most 86400. A part stops earlier if the 95 % interval
    /// of each ratio of shading times is at most 5 % wide on each side. If the part times only one picture, the interval of its shading time decides.
    /// On an adapter that can measure times, a part measures at least six rounds. The seconds do not include the first round, which is a warm-up.
    #[serde(default = "default_times_budget_s")]
    pub times_budget_s: f64,
    /// Changes of the definition that make `check` quick.
    #[serde(default)]
    pub small: Small,
    /// The expected results.
    #[serde(default, rename = "expect", skip_serializing_if = "Vec::is_empty")]
    pub expectations: Vec<Expectation>,
    /// The folder that contains the definition file. Relative file names refer to it. It is not a key of the file.
    #[serde(skip)]
    pub folder: PathBuf,
}

fn default_estimators() -> Vec<String> {
    vec!["fc5".to_owned()]
}

fn default_noises() -> Vec<String> {
    vec!["hashed".to_owned()]
}

fn default_temporal() -> Vec<String> {
    vec!["off".to_owned()]
}

fn default_signals() -> Vec<String> {
    Signal::ALL.map(|signal| signal.name().to_owned()).to_vec()
}

/// Value of the key `times_budget_s` if a definition does not give it, seconds.
pub const TIMES_BUDGET_S: f64 = 60.0;
/// Largest time budget that `check` uses, seconds. A larger `times_budget_s` of a definition is reduced to this value.
const SMALL_TIMES_BUDGET_S: f64 = 5.0;

/// Upper limit of `times_budget_s`, and of the option `--budget` of `bench`: a day, in seconds. A larger value is considered a typing error.
pub(crate) const MAX_TIMES_BUDGET_S: f64 = 86_400.0;

fn default_times_budget_s() -> f64 {
    TIMES_BUDGET_S
}

/// The conditions under which the pictures are viewed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Viewing {
    /// Frames per second, 1 to 1000.
    pub frames_per_second: f64,
    /// Pixels per degree of visual angle, 4 to 400.
    pub pixels_per_degree: f64,
}

impl Default for Viewing {
    fn default() -> Self {
        let usual = kernels::metrics::Viewing::default();
        Viewing { frames_per_second: usual.frames_per_second, pixels_per_degree: usual.pixels_per_degree }
    }
}

impl Viewing {
    /// Converts the settings to the type that the meter of the renderer takes.
    pub(crate) fn of_meter(self) -> kernels::metrics::Viewing {
        kernels::metrics::Viewing { frames_per_second: self.frames_per_second, pixels_per_degree: self.pixels_per_degree }
    }
}

/// A heightmap to import before the run. Its keys correspond to options of `experiments import`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// The heightmap file; a leading `$SCREE_DATA` is replaced by the value of the environment variable.
    pub heightmap: String,
    /// Sample spacing, metres. It is not needed if the file states it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metres_per_texel: Option<f64>,
    /// Elevations of the smallest and the largest possible integer sample, or of the float samples 0 and 1, metres. They are not needed for
    /// floats that are metres, or if the file states the unit or the scale of its samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_range_m: Option<[f64; 2]>,
    /// Folder with images of materials. The images may lie in the folder itself or in sub-folders, at most 16 levels deep. A leading `$SCREE_DATA` is
    /// replaced as in `heightmap`. If the key is absent, the materials are procedural.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub materials: Option<String>,
    /// Largest offset of the procedural relief, metres. The relief adds details that are smaller than the sample spacing of the heightmap.
    #[serde(default)]
    pub detail_m: f64,
}

/// A camera that moves at a constant rate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovingView {
    /// Unique name, used in the column `view`.
    pub name: String,
    /// Name of a camera of the scene. Frame 0 has the pose of this camera.
    pub camera: String,
    /// How the camera moves.
    pub motion: Motion,
    /// Change per frame. For `sideways` (to the right) and `forwards` (along the horizontal view direction) it is a distance in metres. For `turn`
    /// (to the right) it is an angle in degrees. For `zoom` it is the decrease of the field of view in degrees. A negative step reverses the motion.
    pub step: f64,
}

/// How a camera moves. A camera whose height is relative to the ground keeps this height.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// Moves horizontally to the right.
    Sideways,
    /// Moves horizontally in the view direction.
    Forwards,
    /// Turns to the right without moving.
    Turn,
    /// Decreases the field of view.
    Zoom,
}

/// A parameter that is varied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    /// A setting of the scene file, such as `blend.hash_scale`, or a setting of the frame: `frame.normals` (`octahedral`, `plane-first`, `exact`),
    /// `frame.tile` (4, 8, 16), `frame.classification` (`tile`, `patch`), `frame.lod_bias` (-2 to 4), `frame.vertex_stride` (1, 2, 4),
    /// `frame.geometry_error` (pixels, 0 to 16), `frame.residency` (`settled`, `scheduled`), `frame.nodes_per_frame` (1 to 512), `frame.latency`
    /// (frames, 1 to 600), `frame.seed`, `frame.reseeds`, `frame.two_tilings`, `frame.exposure` (stops, -16 to 16),
    /// `frame.tone_curve` (`reinhard`, `clip`).
    pub parameter: String,
    /// The values of the parameter, in the order in which they are measured.
    pub values: Vec<toml::Value>,
}

/// Settings of the reference, which is the 96-fetch blend, averaged over many samples per pixel. Errors are measured against it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reference {
    /// Initial number of samples per pixel. It must be a multiple of 8, the size of a batch, and at least 32, which is 4 batches.
    pub spp: u32,
    /// Limit of the number of samples per pixel. The number is doubled until the standard error of the reference is at most a tenth of the error of a
    /// 96-fetch blend with one sample per pixel, or until this limit is reached.
    pub max_spp: u32,
}

impl Default for Reference {
    fn default() -> Self {
        Reference { spp: 32, max_spp: 256 }
    }
}

/// Which combinations of variant, estimator and noise are timed. Times are stored separately from other metrics, because a repeated run
/// gives different times.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Times {
    /// Nothing is timed.
    None,
    /// Every variant is timed with every estimator and the first noise of the list.
    #[default]
    FirstNoise,
    /// Every variant is timed with every estimator and noise.
    All,
}

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn is_zero(number: &u32) -> bool {
    *number == 0
}

/// Changes of the definition that make `check` quick. If a key is absent, the value of the definition is kept.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Small {
    /// Width and height of the pictures, pixels.
    pub size: Option<[u32; 2]>,
    /// Number of frames of each sequence.
    pub frames: Option<u32>,
    /// Number of frames at the start of each sequence that are not measured.
    pub warm_up: Option<u32>,
    /// Number of seeds.
    pub seeds: Option<u32>,
    /// Names of the views to keep, from `views` and `[[view]]`.
    pub views: Option<Vec<String>>,
    /// The variants, which replace the definition's list.
    pub variants: Option<Vec<String>>,
    /// The values of the varied parameter, which replace the definition's list.
    pub values: Option<Vec<toml::Value>>,
}

/// An expected result: the range in which the mean of the selected rows, or its ratio to the mean of other rows, must lie.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// The claim, as one sentence.
    pub claim: String,
    /// Name of the metric.
    pub metric: String,
    /// The rows that are averaged: the rows of the metric that have these values in these columns, such as `lag = 1` or `noise = "hashed"`. If
    /// `frame` or `signal` is not given, some of these rows are left out: see `evaluate` in `expectations.rs`.
    #[serde(default, rename = "where")]
    pub selection: BTreeMap<String, toml::Value>,
    /// Selects the rows whose mean is the divisor of a ratio; absent = no ratio is computed. Columns that are not given here have the values of
    /// `where`. The key `metric` names a metric other than that of the expectation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over: Option<BTreeMap<String, toml::Value>>,
    /// The smallest and the largest expected value.
    pub range: [f64; 2],
}

/// The name that stands for all 31 variants in a definition's list of variants.
pub const ALL_VARIANTS: &str = "all";

/// Prefix of the name of a variant that is shaded by the generic kernel. This kernel can shade all variants.
const GENERIC: &str = "generic-";

/// Parses how the variant is chosen: `auto`, `generic`, a variant's name or number, or `generic-` followed by a variant's name or number.
///
/// # Errors
/// The text has none of these forms.
pub fn variant_choice(text: &str) -> Result<VariantChoice, NotAVariant> {
    match text {
        "auto" => Ok(VariantChoice::Auto),
        "generic" => Ok(VariantChoice::GenericAuto),
        _ => match text.strip_prefix(GENERIC) {
            Some(variant) => variant.parse().map(VariantChoice::GenericForced),
            None => text.parse().map(VariantChoice::Forced),
        },
    }
}

/// Returns the name of a choice of variants as it appears in tables. [`variant_choice`] parses this name.
pub fn variant_name(choice: VariantChoice) -> String {
    match choice {
        VariantChoice::Auto => "auto".to_owned(),
        VariantChoice::GenericAuto => "generic".to_owned(),
        VariantChoice::Forced(variant) => variant.to_string(),
        VariantChoice::GenericForced(variant) => format!("{GENERIC}{variant}"),
    }
}

/// A value of the varied parameter; `None` if the definition varies no parameter.
pub type Setting = Option<toml::Value>;

/// Returns a value in the form of the column `setting`. A text is unchanged, a float is written in decimal notation with the fewest significant
/// digits that identify it, and other values are written as TOML.
pub fn setting_text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(number) => number.to_string(),
        other => other.to_string(),
    }
}

impl Definition {
    /// Returns the names of all views: first the entries of `views`, then the moving views.
    pub fn view_names(&self) -> impl Iterator<Item = &str> {
        self.views.iter().chain(self.moving_views.iter().map(|view| &view.name)).map(String::as_str)
    }

    /// Returns the requested variants, each with its name in tables. `all` is replaced by the 31 variants.
    ///
    /// # Errors
    /// An entry of `variants` does not name a variant.
    pub fn variant_choices(&self) -> Result<Vec<(String, VariantChoice)>, NotAVariant> {
        let mut choices = Vec::new();
        for text in &self.variants {
            if text == ALL_VARIANTS {
                choices.extend(Variant::all().map(VariantChoice::Forced));
            } else {
                choices.push(variant_choice(text)?);
            }
        }
        Ok(choices.into_iter().map(|choice| (variant_name(choice), choice)).collect())
    }

    /// Returns the signals that are measured, in the order of [`Signal::ALL`].
    pub fn measured_signals(&self) -> Vec<Signal> {
        Signal::ALL.into_iter().filter(|signal| self.signals.iter().any(|name| name == signal.name())).collect()
    }

    /// Whether a run measures this metric. Usually, the metric must be requested, and the definition must have the seeds, frames or times that the
    /// metric needs. Some metrics are also measured if a related metric is. The number of invalid pixels is measured in every run, because metrics of
    /// colours leave these pixels out.
    pub fn measures(&self, metric: &str) -> bool {
        // The accuracy of the reference is reported if any error metric is measured.
        let of_an_error =
            || [metrics::REFERENCE_SE, metrics::REFERENCE_SPP].contains(&metric) && metrics::ERRORS.iter().any(|m| self.why_not(m).is_ok());
        let with_another = || metrics::companion_of(metric).is_some_and(|other| self.why_not(other).is_ok());
        // The share of disoccluded pixels is measured with any metric that compares frames, because most of those metrics leave out disoccluded
        // pixels, and a report says how many pixels remain.
        let of_frames =
            || metric == metrics::DISOCCLUDED && metrics::METRICS.iter().any(|m| m.needs == Needs::Frames && self.why_not(m.name).is_ok());
        metric == metrics::INVALID_PX || self.why_not(metric).is_ok() || of_an_error() || of_frames() || with_another()
    }

    /// Checks that the definition requests this metric, and has the seeds, frames or times that the metric needs. Unlike [`Definition::measures`], it
    /// does not accept a metric that is measured only because another metric is requested.
    ///
    /// # Errors
    /// The metric is not requested, or something that it needs is missing. The message gives the reason and the remedy.
    fn why_not(&self, metric: &str) -> Result<(), String> {
        let needs = metrics::known(metric)?.needs;
        match needs {
            Needs::Seeds if self.seeds < 2 => return Err(format!("`{metric}` is computed over seeds: set `seeds` to 2 or more")),
            Needs::Frames if self.frames < 2 => return Err(format!("`{metric}` compares frames: set `frames` to 2 or more")),
            Needs::Clock if self.times == Times::None => {
                return Err(format!("`{metric}` is a time: set `times` to \"first-noise\" or \"all\""));
            }
            _ => {}
        }
        // `metrics` does not list device times, because they are requested by the key `times`.
        if needs == Needs::Clock || self.metrics.is_empty() || self.metrics.iter().any(|name| name == metric) {
            return Ok(());
        }
        Err(format!("`{metric}` is not among `metrics`: add it to this list"))
    }

    /// Which frames of a sequence are measured.
    pub fn sequence(&self) -> metrics::Sequence {
        metrics::Sequence { frames: self.frames, warm_up: self.warm_up }
    }

    /// Returns the definition with the changes of [`Small`] applied, and with a `times_budget_s` of at most 5 seconds.
    #[must_use]
    pub fn small(&self) -> Definition {
        let mut small = self.clone();
        let Small { size, frames, warm_up, seeds, views, variants, values } = std::mem::take(&mut small.small);
        small.size = size.unwrap_or(small.size);
        small.frames = frames.unwrap_or(small.frames);
        small.warm_up = warm_up.unwrap_or(small.warm_up);
        small.seeds = seeds.unwrap_or(small.seeds);
        small.times_budget_s = small.times_budget_s.min(SMALL_TIMES_BUDGET_S);
        small.variants = variants.unwrap_or(small.variants);
        if let Some(views) = views {
            small.views.retain(|name| views.contains(name));
            small.moving_views.retain(|view| views.contains(&view.name));
        }
        if let (Some(vary), Some(values)) = (&mut small.vary, values) {
            vary.values = values;
        }
        small
    }

    /// Returns a copy without the question, the analysis, the expectations, `small` and the folder of the definition, which do not affect the
    /// measured numbers.
    pub(crate) fn measured(&self) -> Definition {
        Definition {
            question: String::new(),
            analysis: String::new(),
            expectations: Vec::new(),
            small: Small::default(),
            folder: PathBuf::new(),
            ..self.clone()
        }
    }

    /// Returns the definition as TOML text, which [`stored`] can read.
    ///
    /// # Errors
    /// The definition contains a value that TOML cannot represent. This is impossible if the definition was read from a file.
    pub fn to_toml(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }
}

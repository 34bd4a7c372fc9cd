//! An experiment as data: its question, what is rendered, what is measured, what is expected, and what the result means.
//!
//! The types below are the schema of a definition file (TOML). Unknown keys are refused; the message names the nearest known key.

use std::collections::BTreeMap;
use std::path::PathBuf;

use kernels::frame::VariantChoice;
use kernels::variant::{NotAVariant, Variant};
use serde::{Deserialize, Serialize};

use crate::metrics::{self, Needs};

mod parameters;
mod parse;
mod validate;

pub(crate) use parameters::hash;
pub use parse::{load, parse, stored};

/// The contents of a definition file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Short name, used for the run's folder and the column `experiment`. Letters, digits, `-` and `_`.
    pub name: String,
    /// The question that the run answers, one sentence.
    pub question: String,
    /// What the result shows and what it does not show, in prose (Markdown paragraphs); written after looking at the results of a run.
    #[serde(default)]
    pub analysis: String,
    /// `default`, a scene file, or a folder with scene.toml, relative to the definition; a leading `$SCREE_DATA` is replaced by the value of that
    /// variable. At most one of `scene` and `import` is given; without both, the scene is `default`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// A heightmap to make the scene from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub import: Option<Import>,
    /// The views: names of cameras (which stand still) and of paths of the scene.
    #[serde(default)]
    pub views: Vec<String>,
    /// Additional views: cameras that move.
    #[serde(default, rename = "view", skip_serializing_if = "Vec::is_empty")]
    pub moving_views: Vec<MovingView>,
    /// Pixels, width and height.
    pub size: [u32; 2],
    /// Number of frames of each sequence, at least 1. Time is the frame index.
    pub frames: u32,
    /// Number of seeds for bias and variance; 0 = neither is measured, otherwise at least 2.
    #[serde(default)]
    pub seeds: u32,
    /// Names of variants or their numbers as text, `auto`, `generic`, or `all` for the 31.
    pub variants: Vec<String>,
    /// Estimators of the stochastic flavours.
    #[serde(default = "default_estimators")]
    pub estimators: Vec<String>,
    /// Noise kinds.
    #[serde(default = "default_noises")]
    pub noises: Vec<String>,
    /// Temporal resolves: `off`, `exponential`, `flipquad`, `flipquad+exponential`.
    #[serde(default = "default_temporal")]
    pub temporal: Vec<String>,
    /// A parameter that is varied, and its values.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vary: Option<Vary>,
    /// Settings of the scene for the whole run, such as `"flavours.cliff_near_m" = 20.0`.
    #[serde(default, rename = "set", skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, toml::Value>,
    /// Names of metrics; empty = all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Whether to keep PNG sequences of the frames of single flavours, of `auto` and `generic`, and of the reference sequence, with command lines for
    /// tools that judge video.
    #[serde(default)]
    pub video: bool,
    /// How accurately the reference must be known.
    #[serde(default)]
    pub reference: Reference,
    /// Which rows are timed.
    #[serde(default)]
    pub times: Times,
    /// Changes that `check` makes so that it is quick.
    #[serde(default)]
    pub small: Small,
    /// The results that are expected.
    #[serde(default, rename = "expect", skip_serializing_if = "Vec::is_empty")]
    pub expectations: Vec<Expectation>,
    /// Folder to which relative file names refer: that of the definition file. It is not part of the file.
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

/// A heightmap to import before the run; the keys are those of `experiments import`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Import {
    /// The file; a leading `$SCREE_DATA` is replaced by the value of that variable.
    pub heightmap: String,
    /// Sample spacing, metres.
    pub metres_per_texel: f64,
    /// Elevations of the smallest and largest sample value, metres; not needed for formats with float samples.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_range_m: Option<[f64; 2]>,
    /// Folder of material folders, with `$SCREE_DATA` as above; if absent, the materials are procedural.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub materials: Option<String>,
    /// Procedural relief added below the data's resolution, metres.
    #[serde(default)]
    pub detail_m: f64,
}

/// A camera that moves at a constant rate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovingView {
    /// Unique name, used in the column `view`.
    pub name: String,
    /// The camera of the scene at which frame 0 is.
    pub camera: String,
    /// How it moves.
    pub motion: Motion,
    /// Step per frame: metres for `sideways` (to the right) and `forwards` (along the view, level), degrees for `turn` (to the right), and the
    /// decrease of the field of view in degrees for `zoom`.
    pub step: f64,
}

/// How a camera moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Motion {
    /// To the right, level.
    Sideways,
    /// Along the view direction, level.
    Forwards,
    /// To the right, without moving.
    Turn,
    /// The field of view becomes narrower.
    Zoom,
}

/// A parameter that is varied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    /// A number of the scene file, such as `blend.hash_scale`, or a choice of the frame: `frame.normals` (`octahedral`,
    /// `plane-first`, `exact`), `frame.tile` (4, 8, 16), `frame.classification` (`tile`, `patch`), `frame.lod_bias` (-2 to 4), `frame.vertex_stride`
    /// (1, 2, 4), `frame.seed`, `frame.reseeds`, `frame.two_tilings`.
    pub parameter: String,
    /// Its values, in order.
    pub values: Vec<toml::Value>,
}

/// The converged 96-fetch reference for errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reference {
    /// Initial number of samples per pixel: batches of 8, at least 4 of them.
    pub spp: u32,
    /// Largest number of samples. The samples are doubled until the reference's own standard error is below a tenth of the error of the 96-fetch
    /// blend with one sample, or until this number is reached.
    pub max_spp: u32,
}

impl Default for Reference {
    fn default() -> Self {
        Reference { spp: 32, max_spp: 256 }
    }
}

/// The rows that are timed. Times are stored separately from metrics, because they never repeat exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Times {
    /// None.
    None,
    /// Every variant and estimator, with the first noise of the list.
    #[default]
    FirstNoise,
    /// Every variant, estimator and noise.
    All,
}

/// Changes that `check` makes so that it is quick; absent keys stay unchanged.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Small {
    /// Pixels.
    pub size: Option<[u32; 2]>,
    /// Frames.
    pub frames: Option<u32>,
    /// Seeds.
    pub seeds: Option<u32>,
    /// Names of views (from `views` and `[[view]]`).
    pub views: Option<Vec<String>>,
    /// Variants.
    pub variants: Option<Vec<String>>,
    /// Values of the varied parameter.
    pub values: Option<Vec<toml::Value>>,
}

/// An expected result: the mean of the selected rows, or its ratio to the mean of other rows, lies in a range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// The claim, one sentence.
    pub claim: String,
    /// Name of the metric.
    pub metric: String,
    /// Selection of rows: column = value (`lag = 1`, `noise = "hashed"`); all matching rows of the metric are averaged.
    #[serde(default, rename = "where")]
    pub selection: BTreeMap<String, toml::Value>,
    /// If given, the mean is divided by the mean of these rows (columns not named here are as in `where`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over: Option<BTreeMap<String, toml::Value>>,
    /// Smallest and largest value expected.
    pub range: [f64; 2],
}

/// The name that stands for all 31 variants in a definition's list.
pub const ALL_VARIANTS: &str = "all";

/// Prefix of the name of a variant that the generic kernel shades.
const GENERIC: &str = "generic-";

/// Parses a choice of variants: `auto`, `generic`, a variant's name or number, or `generic-` followed by one of these.
///
/// # Errors
/// The text is none of these.
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

/// The name of a choice in tables; [`variant_choice`] reads it.
pub fn variant_name(choice: VariantChoice) -> String {
    match choice {
        VariantChoice::Auto => "auto".to_owned(),
        VariantChoice::GenericAuto => "generic".to_owned(),
        VariantChoice::Forced(variant) => variant.to_string(),
        VariantChoice::GenericForced(variant) => format!("{GENERIC}{variant}"),
    }
}

/// A value of the varied parameter; `None` if the definition varies none.
pub type Setting = Option<toml::Value>;

/// A value as written in the column `setting`: a text unchanged, a number in the fewest digits, anything else as TOML.
pub fn setting_text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(number) => number.to_string(),
        other => other.to_string(),
    }
}

impl Definition {
    /// Names of all views, still and moving, in order.
    pub fn view_names(&self) -> impl Iterator<Item = &str> {
        self.views.iter().chain(self.moving_views.iter().map(|view| &view.name)).map(String::as_str)
    }

    /// The requested variants with the names that tables use; `all` is expanded.
    ///
    /// # Errors
    /// A text that does not name a variant.
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

    /// Whether a run measures this metric: it is requested, and the definition has what it needs.
    pub fn measures(&self, metric: &str) -> bool {
        // The accuracy of the reference is reported with every error metric.
        let of_an_error =
            || [metrics::REFERENCE_SE, metrics::REFERENCE_SPP].contains(&metric) && metrics::ERRORS.iter().any(|m| self.why_not(m).is_ok());
        self.why_not(metric).is_ok() || of_an_error()
    }

    /// # Errors
    /// Why a run does not measure this metric, and how to change that.
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
        // Device times are requested by `times`.
        if needs == Needs::Clock || self.metrics.is_empty() || self.metrics.iter().any(|name| name == metric) {
            return Ok(());
        }
        Err(format!("`{metric}` is not among `metrics`: add it there"))
    }

    /// The definition with what [`Small`] changes.
    #[must_use]
    pub fn small(&self) -> Definition {
        let mut small = self.clone();
        let Small { size, frames, seeds, views, variants, values } = std::mem::take(&mut small.small);
        small.size = size.unwrap_or(small.size);
        small.frames = frames.unwrap_or(small.frames);
        small.seeds = seeds.unwrap_or(small.seeds);
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

    /// The part of the definition that decides the numbers: without prose and expectations.
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

    /// The definition as TOML; [`stored`] reads it again.
    ///
    /// # Errors
    /// A value that TOML cannot express. A definition that was read from a file has none.
    pub fn to_toml(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }
}

//! An experiment as data: the question, what is rendered and measured, the expected results, and the analysis of the results.
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
    /// The question that the run answers, as one sentence.
    pub question: String,
    /// What the result shows and what it does not show, as Markdown paragraphs. It is written after a run, when the results are known.
    #[serde(default)]
    pub analysis: String,
    /// `default`, a scene file, or a folder with scene.toml, relative to the definition; a leading `$SCREE_DATA` is replaced by the value of that
    /// variable. At most one of `scene` and `import` is given; without both, the scene is `default`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// A heightmap from which the scene is made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub import: Option<Import>,
    /// The views: names of cameras (which stand still) and of paths of the scene.
    #[serde(default)]
    pub views: Vec<String>,
    /// Additional views: cameras that move.
    #[serde(default, rename = "view", skip_serializing_if = "Vec::is_empty")]
    pub moving_views: Vec<MovingView>,
    /// Width and height of the pictures, pixels.
    pub size: [u32; 2],
    /// Number of frames of each sequence, at least 1. Time is measured in frames, not by a clock.
    pub frames: u32,
    /// Number of seeds for bias and variance; 0 = neither is measured, otherwise at least 2.
    #[serde(default)]
    pub seeds: u32,
    /// Names of variants or their numbers as text, `auto`, `generic`, or `all` for all 31 variants.
    pub variants: Vec<String>,
    /// Estimators of the stochastic flavours.
    #[serde(default = "default_estimators")]
    pub estimators: Vec<String>,
    /// Kinds of noise by which stochastic flavours choose.
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
    /// Folder to which relative file names refer: the folder that contains the definition file. It is not a key of the file.
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
    /// Folder that holds a folder of images per material; a leading `$SCREE_DATA` is replaced as in `heightmap`. Absent = the materials are
    /// procedural.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub materials: Option<String>,
    /// Largest offset of the procedural relief that is added below the data's resolution, metres.
    #[serde(default)]
    pub detail_m: f64,
}

/// A camera that moves at a constant rate.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovingView {
    /// Unique name, used in the column `view`.
    pub name: String,
    /// Name of the scene's camera whose pose frame 0 has.
    pub camera: String,
    /// How the camera moves.
    pub motion: Motion,
    /// Step per frame: metres for `sideways` (to the right) and `forwards` (along the horizontal view direction), degrees for `turn` (to the right),
    /// and for `zoom` the degrees by which the field of view decreases.
    pub step: f64,
}

/// How a camera moves.
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
    /// A number of the scene file, such as `blend.hash_scale`, or a choice of the frame: `frame.normals` (`octahedral`,
    /// `plane-first`, `exact`), `frame.tile` (4, 8, 16), `frame.classification` (`tile`, `patch`), `frame.lod_bias` (-2 to 4), `frame.vertex_stride`
    /// (1, 2, 4), `frame.seed`, `frame.reseeds`, `frame.two_tilings`.
    pub parameter: String,
    /// The values of the parameter, in the order in which they are measured.
    pub values: Vec<toml::Value>,
}

/// The converged 96-fetch reference for errors.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reference {
    /// Initial number of samples per pixel: a multiple of 8, which is the size of a batch, and at least 4 batches.
    pub spp: u32,
    /// Largest number of samples per pixel. The number of samples is doubled until the reference's own standard error is at most a tenth of the error
    /// of the 96-fetch blend with one sample, or until this limit is reached.
    pub max_spp: u32,
}

impl Default for Reference {
    fn default() -> Self {
        Reference { spp: 32, max_spp: 256 }
    }
}

/// The combinations that are timed. Times are stored separately from metrics, because a repeated run never gives exactly the same times.
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

/// Changes that `check` makes so that it is quick; absent keys stay unchanged.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Small {
    /// Width and height of the pictures, pixels.
    pub size: Option<[u32; 2]>,
    /// Number of frames of each sequence.
    pub frames: Option<u32>,
    /// Number of seeds.
    pub seeds: Option<u32>,
    /// Names of the views that are kept, out of `views` and `[[view]]`.
    pub views: Option<Vec<String>>,
    /// The list of variants.
    pub variants: Option<Vec<String>>,
    /// Values of the varied parameter.
    pub values: Option<Vec<toml::Value>>,
}

/// An expected result: the mean of the selected rows, or its ratio to the mean of other rows, lies in a range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// The claim, as one sentence.
    pub claim: String,
    /// Name of the metric.
    pub metric: String,
    /// Selection of rows: column = value (`lag = 1`, `noise = "hashed"`); all matching rows of the metric are averaged.
    #[serde(default, rename = "where")]
    pub selection: BTreeMap<String, toml::Value>,
    /// If given, the mean is divided by the mean of the rows that this selects. Columns that are not named here have the values of `where`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over: Option<BTreeMap<String, toml::Value>>,
    /// Smallest and largest value expected.
    pub range: [f64; 2],
}

/// The name that stands for all 31 variants in a definition's list of variants.
pub const ALL_VARIANTS: &str = "all";

/// Prefix of the name of a variant if the generic kernel shades it.
const GENERIC: &str = "generic-";

/// Parses a choice of variants: `auto`, `generic`, a variant's name or number, or `generic-` followed by a variant's name or number.
///
/// # Errors
/// The text is not such a choice.
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

/// Returns the name of a choice in tables; [`variant_choice`] parses it.
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

/// Returns a value as it is written in the column `setting`: a text unchanged, a float with as few digits as possible, and other values as TOML.
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

    /// Returns the requested variants with the names that tables use; `all` is expanded.
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

    /// Whether a run measures this metric. It does if the metric is requested and the definition has the seeds, frames or times that it needs.
    pub fn measures(&self, metric: &str) -> bool {
        // The accuracy of the reference is reported with every error metric.
        let of_an_error =
            || [metrics::REFERENCE_SE, metrics::REFERENCE_SPP].contains(&metric) && metrics::ERRORS.iter().any(|m| self.why_not(m).is_ok());
        self.why_not(metric).is_ok() || of_an_error()
    }

    /// Checks that a run measures this metric.
    ///
    /// # Errors
    /// The run does not measure it. The message gives the reason and the remedy.
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
        // The key `times` requests device times, so `metrics` does not list them.
        if needs == Needs::Clock || self.metrics.is_empty() || self.metrics.iter().any(|name| name == metric) {
            return Ok(());
        }
        Err(format!("`{metric}` is not among `metrics`: add it there"))
    }

    /// Returns the definition with the changes of [`Small`] applied.
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

    /// Returns the definition without the parts that do not affect the measured numbers, such as prose and expectations.
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

    /// Returns the definition as TOML; [`stored`] reads it again.
    ///
    /// # Errors
    /// The definition contains a value that TOML cannot express. This does not occur if the definition was read from a file.
    pub fn to_toml(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }
}

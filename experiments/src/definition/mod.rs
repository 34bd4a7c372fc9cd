//! An experiment as data: a question, what is rendered, what is measured, what is expected, and what the result says.
//!
//! The types below are the schema of a definition file (TOML, unknown keys refused with the nearest known one).

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

/// Everything a definition file says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Definition {
    /// Short name: that of the run's folder and of the column `experiment`. Letters, digits, `-` and `_`.
    pub name: String,
    /// The question that the run answers, one sentence.
    pub question: String,
    /// What the result says and what it does not, in prose (Markdown paragraphs); written after a run was looked at.
    #[serde(default)]
    pub analysis: String,
    /// `default`, a scene file, or a folder with scene.toml, relative to the definition; `$SCREE_DATA` at its start is replaced by that variable.
    /// Exactly one of `scene` and `import` is given; neither = `default`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scene: Option<String>,
    /// A heightmap to make the scene from.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub import: Option<Import>,
    /// What is looked at: names of cameras (standing still) and of paths of the scene.
    #[serde(default)]
    pub views: Vec<String>,
    /// More of it: cameras that are moved.
    #[serde(default, rename = "view", skip_serializing_if = "Vec::is_empty")]
    pub moving_views: Vec<MovingView>,
    /// Pixels, width and height.
    pub size: [u32; 2],
    /// Frames of each sequence, at least 1. Time is the frame index.
    pub frames: u32,
    /// Seeds over which bias and variance are taken; 0 = neither is measured, else at least 2.
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
    /// A parameter and the values it takes, one after the other.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub vary: Option<Vary>,
    /// Keys of the scene set for the whole run, as `"flavours.cliff_near_m" = 20.0`.
    #[serde(default, rename = "set", skip_serializing_if = "BTreeMap::is_empty")]
    pub settings: BTreeMap<String, toml::Value>,
    /// Names of metrics; none = all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub metrics: Vec<String>,
    /// Whether the frames of single flavours, of `auto` and `generic`, and of the reference sequence are kept as PNG sequences, with the command lines of tools
    /// that judge video.
    #[serde(default)]
    pub video: bool,
    /// How well the reference must be known.
    #[serde(default)]
    pub reference: Reference,
    /// Which rows are timed.
    #[serde(default)]
    pub times: Times,
    /// What `check` changes so that it is quick.
    #[serde(default)]
    pub small: Small,
    /// Results that are expected.
    #[serde(default, rename = "expect", skip_serializing_if = "Vec::is_empty")]
    pub expectations: Vec<Expectation>,
    /// Folder that relative file names refer to: the definition file's own. Not part of the file.
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
    /// The file; `$SCREE_DATA` at its start is replaced by that variable.
    pub heightmap: String,
    /// Sample spacing, metres.
    pub metres_per_texel: f64,
    /// Elevations of the smallest and largest sample value, metres; formats of float samples need none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_range_m: Option<[f64; 2]>,
    /// Folder of material folders; `$SCREE_DATA` as above; without it, procedural materials.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub materials: Option<String>,
    /// Procedural relief added below the data's resolution, metres.
    #[serde(default)]
    pub detail_m: f64,
}

/// A camera that moves evenly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MovingView {
    /// Unique name, that of the column `view`.
    pub name: String,
    /// A camera of the scene, where frame 0 stands.
    pub camera: String,
    /// How it moves.
    pub motion: Motion,
    /// How far each frame: metres for `sideways` (to the right) and `forwards` (along the view, level), degrees for `turn` (to the right), and for
    /// `zoom` degrees off the field of view.
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
    /// To the right, on the spot.
    Turn,
    /// Narrower field of view.
    Zoom,
}

/// A parameter that is varied.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    /// A number of the scene file, as `blend.hash_scale`, or a choice of the frame: `frame.normals` (`octahedral`,
    /// `plane-first`, `exact`), `frame.tile` (4, 8, 16), `frame.classification` (`tile`, `patch`), `frame.lod_bias` (-2 to 4), `frame.vertex_stride`
    /// (1, 2, 4), `frame.seed`, `frame.reseeds`, `frame.two_tilings`.
    pub parameter: String,
    /// Its values, in order.
    pub values: Vec<toml::Value>,
}

/// The converged 96-fetch truth that errors are taken against.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Reference {
    /// Samples per pixel to begin with: batches of 8, at least 4 of them.
    pub spp: u32,
    /// Doubled until the reference's own standard error is under a tenth of the error that the 96-fetch blend at one sample has, or this is reached.
    pub max_spp: u32,
}

impl Default for Reference {
    fn default() -> Self {
        Reference { spp: 32, max_spp: 256 }
    }
}

/// Which rows are timed. Times are kept apart from metrics: they never repeat exactly.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Times {
    /// None.
    None,
    /// Every variant and estimator with the first noise of the list.
    #[default]
    FirstNoise,
    /// Every variant, estimator and noise.
    All,
}

/// What `check` changes so that it is quick; what is absent stays.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Small {
    /// Pixels.
    pub size: Option<[u32; 2]>,
    /// Frames.
    pub frames: Option<u32>,
    /// Seeds.
    pub seeds: Option<u32>,
    /// Views, by name (of `views` and `[[view]]` alike).
    pub views: Option<Vec<String>>,
    /// Variants.
    pub variants: Option<Vec<String>>,
    /// Values of the varied parameter.
    pub values: Option<Vec<toml::Value>>,
}

/// A result that is expected: the mean of the rows selected, or its ratio to that of other rows, lies in a range.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Expectation {
    /// What is claimed, one sentence.
    pub claim: String,
    /// Name of the metric.
    pub metric: String,
    /// Which rows: column = value (`lag = 1`, `noise = "hashed"`); all rows of the metric that agree are averaged.
    #[serde(default, rename = "where")]
    pub selection: BTreeMap<String, toml::Value>,
    /// If given, the mean is divided by that of these rows (columns not named here are as in `where`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub over: Option<BTreeMap<String, toml::Value>>,
    /// Smallest and largest value expected.
    pub range: [f64; 2],
}

/// Every one of the 31 variants in a definition's list.
pub const ALL_VARIANTS: &str = "all";

/// What the name of a variant that the generic kernel runs begins with.
const GENERIC: &str = "generic-";

/// A way to choose variants by its name: `auto`, `generic`, a variant's name or its number, and that after `generic-`.
///
/// # Errors
/// What is none of these.
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

/// The name of a choice in tables: what [`variant_choice`] reads.
pub fn variant_name(choice: VariantChoice) -> String {
    match choice {
        VariantChoice::Auto => "auto".to_owned(),
        VariantChoice::GenericAuto => "generic".to_owned(),
        VariantChoice::Forced(variant) => variant.to_string(),
        VariantChoice::GenericForced(variant) => format!("{GENERIC}{variant}"),
    }
}

/// A value of the varied parameter; `None` where the definition varies none.
pub type Setting = Option<toml::Value>;

/// A value as it stands in the column `setting`: a text as it is, a number in the fewest digits, anything else as TOML.
pub fn setting_text(value: &toml::Value) -> String {
    match value {
        toml::Value::String(text) => text.clone(),
        toml::Value::Float(number) => number.to_string(),
        other => other.to_string(),
    }
}

impl Definition {
    /// Names of all views, still or moving, in their order.
    pub fn view_names(&self) -> impl Iterator<Item = &str> {
        self.views.iter().chain(self.moving_views.iter().map(|view| &view.name)).map(String::as_str)
    }

    /// The variants asked for, `all` written out, by the names that tables have.
    ///
    /// # Errors
    /// A text that names none.
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

    /// Whether a run measures this metric: it is asked for, and there is what it needs.
    pub fn measures(&self, metric: &str) -> bool {
        // What an error is worth goes with every error.
        let of_an_error =
            || [metrics::REFERENCE_SE, metrics::REFERENCE_SPP].contains(&metric) && metrics::ERRORS.iter().any(|m| self.why_not(m).is_ok());
        self.why_not(metric).is_ok() || of_an_error()
    }

    /// # Errors
    /// Why a run does not measure this metric, and how to mend it.
    fn why_not(&self, metric: &str) -> Result<(), String> {
        let needs = metrics::known(metric)?.needs;
        match needs {
            Needs::Seeds if self.seeds < 2 => return Err(format!("`{metric}` is taken over seeds: set `seeds` to 2 or more")),
            Needs::Frames if self.frames < 2 => return Err(format!("`{metric}` compares frames: set `frames` to 2 or more")),
            Needs::Clock if self.times == Times::None => {
                return Err(format!("`{metric}` is a time: set `times` to \"first-noise\" or \"all\""));
            }
            _ => {}
        }
        // Device times are asked for by `times`.
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

    /// What decides the numbers: without the prose and what is expected of them.
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

    /// The definition as TOML; [`stored`] reads it back.
    ///
    /// # Errors
    /// A value that TOML cannot hold, which no definition that was read has.
    pub fn to_toml(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }
}

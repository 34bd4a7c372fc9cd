//! One measured number and all it takes to know what it is: the row of `metrics.parquet` and `metrics.csv`.

use serde::{Deserialize, Serialize};

/// A number of a run. Tidy: one value a row; a column that does not apply is empty (text) or absent (number).
///
/// The order of the fields is the order of the columns, and rows are kept sorted by them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the definition.
    pub experiment: String,
    /// Name of the scene.
    pub scene: String,
    /// Name of the view: a camera, a path, or a camera with a motion.
    pub view: String,
    /// `auto`, `generic`, or the variant forced on every tile, as `vt+near-cliff`.
    pub variant: String,
    /// Estimator of the stochastic flavours, as `fc5`.
    pub estimator: String,
    /// Noise of the stochastic flavours, as `hashed`.
    pub noise: String,
    /// Temporal resolve, as `off`.
    pub temporal: String,
    /// The parameter that the definition varies, as `blend.hash_scale`; empty = none.
    pub parameter: String,
    /// Its value, as text; empty = none.
    pub setting: String,
    /// Frame index; absent = over all frames.
    pub frame: Option<u32>,
    /// Frames between the two that are compared, k = 1..4; absent = the metric compares none.
    pub lag: Option<u32>,
    /// Centre of a band of a spectrum, cycles per pixel; absent = the metric is no spectrum.
    pub frequency: Option<f64>,
    /// Name of the metric, as METHODOLOGY defines it.
    pub metric: String,
    /// Unit of the value.
    pub unit: String,
    /// The number.
    pub value: f64,
    /// Standard error of the value, in its unit; absent = not known or none.
    pub standard_error: Option<f64>,
}

//! The parts that a run is cut into: each is done whole or not at all, so that a run can be stopped anywhere, resumed, and split over machines.

use std::path::Path;

use anyhow::Result;

use crate::row::Row;

/// A value of the varied parameter; `None` where the definition varies none.
pub type Setting = Option<toml::Value>;

/// What a part of a run does.
#[derive(Clone, Debug, PartialEq)]
pub enum Work {
    /// The converged reference of a view, and how the reference sequence flickers. Written to the run's folder for the parts that need it.
    Reference,
    /// All variants of the definition over all frames and seeds.
    Sweep {
        /// Estimator of the stochastic flavours.
        estimator: String,
        /// Their noise.
        noise: String,
        /// Temporal resolve.
        temporal: String,
    },
    /// Device times of all variants.
    Timing {
        /// Estimator of the stochastic flavours.
        estimator: String,
        /// Their noise.
        noise: String,
    },
}

/// A part of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Its place in the run, from 0: the order in which rows are kept.
    pub index: usize,
    /// Name for files and progress: letters, digits, `-`, `_`, `+` and `.`.
    pub id: String,
    /// Name of the view.
    pub view: String,
    /// Value of the varied parameter.
    pub setting: Setting,
    /// What is done.
    pub work: Work,
}

/// What a part yields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Metrics: the same whenever the part is done again on the same adapter.
    pub rows: Vec<Row>,
    /// Times: different each time.
    pub times: Vec<Row>,
}

/// Who does the parts.
pub trait Measure {
    /// Does one part. Files (pictures) go into `folder`, each written whole. `step(done, total)` reports progress within the part; an interrupt is to
    /// be looked for between steps.
    ///
    /// # Errors
    /// What cannot be rendered or written; the part then counts as not done.
    fn measure(&mut self, unit: &Unit, folder: &Path, step: &dyn Fn(u64, u64)) -> Result<Outcome>;
}

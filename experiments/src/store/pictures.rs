//! The list of a run's pictures: the runner writes it, the report reads it.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// A picture of a run, as the list tells of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RunPicture {
    /// Name of a file beside the list.
    pub(crate) file: String,
    /// A few words.
    pub(crate) title: String,
    /// A sentence.
    pub(crate) caption: String,
    /// `reference`, `frame`, `tile-map`, `flicker-map` or `error-map`.
    pub(crate) kind: String,
    /// Which choice it shows, as in the columns of a row.
    pub(crate) view: String,
    /// See [`crate::row::Row`].
    pub(crate) variant: String,
    /// See [`crate::row::Row`].
    pub(crate) estimator: String,
    /// See [`crate::row::Row`].
    pub(crate) noise: String,
    /// See [`crate::row::Row`].
    pub(crate) temporal: String,
    /// See [`crate::row::Row`].
    pub(crate) setting: String,
    /// Where its file lies; not part of the list.
    #[serde(skip)]
    pub(crate) folder: PathBuf,
}

//! The list of a run's pictures, which the runner writes and the report reads.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// An entry of the list.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RunPicture {
    /// Name of the file, which lies next to the list.
    pub(crate) file: String,
    /// Title, a few words.
    pub(crate) title: String,
    /// Caption, one sentence.
    pub(crate) caption: String,
    /// `reference`, `frame`, `tile-map`, `flicker-map` or `error-map`.
    pub(crate) kind: String,
    /// View of the picture, as in [`crate::row::Row`].
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
    /// Folder of the file; not part of the list.
    #[serde(skip)]
    pub(crate) folder: PathBuf,
}

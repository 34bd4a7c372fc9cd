//! Lists of a run's pictures. Each part of the run that stores pictures writes a list, and the report reads all lists.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

/// An entry of a list: one picture.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct RunPicture {
    /// Name of the picture's file, which is in the same folder as the list.
    pub(crate) file: String,
    /// Title: a few words.
    pub(crate) title: String,
    /// Text below the picture.
    pub(crate) caption: String,
    /// Kind of the picture: `reference`, `frame`, `tile-map` or `residual-map`. Older versions also wrote `error-map`.
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
    /// Folder of the file. It is not stored in the list.
    #[serde(skip)]
    pub(crate) folder: PathBuf,
}

//! Replaces embedded WGSL files by files from a folder, so that shaders can be edited while the program runs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, PoisonError};

use crate::base::error::{Error, Result};
use crate::base::wgsl::{Piece, Wgsl};
use crate::gpu::Gpu;

/// Shader texts that replace the embedded texts, by the [path](Wgsl::path) of their file. Empty by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sources {
    texts: BTreeMap<String, String>,
}

impl Sources {
    /// Reads `files` from `folder`, which is laid out like `kernels/src`. A text that equals the embedded one is not stored.
    ///
    /// # Errors
    /// When a file is missing, cannot be read, or is not UTF-8.
    pub fn read(folder: &Path, files: &[&Wgsl]) -> Result<Sources> {
        let mut texts = BTreeMap::new();
        for wgsl in files {
            let file = folder.join(wgsl.path);
            let text = std::fs::read_to_string(&file).map_err(|source| Error::File { file, source })?;
            if text != wgsl.text {
                texts.insert(wgsl.path.to_owned(), text);
            }
        }
        Ok(Sources { texts })
    }

    /// Whether no embedded text is replaced.
    pub fn is_empty(&self) -> bool {
        self.texts.is_empty()
    }

    /// The files whose text differs between these sources and `other`, in alphabetical order.
    pub fn differences(&self, other: &Sources) -> Vec<String> {
        let paths: BTreeSet<&String> = self.texts.keys().chain(other.texts.keys()).collect();
        paths.into_iter().filter(|path| self.texts.get(*path) != other.texts.get(*path)).cloned().collect()
    }

    /// Replaces the text of a piece, if these sources have a text for its file.
    pub(crate) fn replace(&self, piece: &mut Piece) {
        if let Some(text) = self.texts.get(&piece.path) {
            piece.text.clone_from(text);
        }
    }
}

impl Gpu {
    /// The texts that currently replace embedded texts.
    pub fn sources(&self) -> Arc<Sources> {
        self.sources.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Sets the sources of all shaders that are compiled on this device from now on, and returns the previous ones. Compiled shaders do not change.
    pub fn override_shaders(&self, sources: Arc<Sources>) -> Arc<Sources> {
        std::mem::replace(&mut *self.sources.write().unwrap_or_else(PoisonError::into_inner), sources)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sources(texts: &[(&str, &str)]) -> Sources {
        Sources { texts: texts.iter().map(|&(path, text)| (path.to_owned(), text.to_owned())).collect() }
    }

    #[test]
    fn what_differs_is_found_on_both_sides() {
        let (before, after) = (sources(&[("a", "1"), ("b", "1"), ("c", "1")]), sources(&[("b", "2"), ("c", "1"), ("d", "1")]));
        assert_eq!(before.differences(&after), ["a", "b", "d"]);
        assert_eq!(after.differences(&before), ["a", "b", "d"]);
        assert!(before.differences(&before).is_empty());
        let replaced = |path: &str| {
            let mut piece = Piece::new(path, "embedded");
            before.replace(&mut piece);
            piece.text
        };
        assert_eq!((replaced("b").as_str(), replaced("d").as_str()), ("1", "embedded"));
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = Sources::read(Path::new("/nowhere"), &[&Wgsl::new("hash.wgsl", "", &[])]).expect_err("no such folder").to_string();
        assert!(error.contains("hash.wgsl: "), "{error}");
        assert!(Sources::read(Path::new("/nowhere"), &[]).expect("nothing is asked for").is_empty());
    }
}

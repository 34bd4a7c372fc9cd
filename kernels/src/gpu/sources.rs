//! WGSL from a folder in place of what was compiled in: for shaders that are edited while the program runs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::{Arc, PoisonError};

use crate::base::error::{Error, Result};
use crate::gpu::Gpu;
use crate::shared;

/// Where a shader file lies in `kernels/src`. Shared files are called by their topic, others by their path; texts made by the program have no file,
/// and keep their names.
pub fn shader_path(name: &str) -> String {
    if shared::WGSL.iter().chain([&shared::SIGNAL_WGSL]).any(|(topic, _)| *topic == name) {
        format!("shared/{name}.wgsl")
    } else {
        name.to_owned()
    }
}

/// Texts that take the place of embedded ones, by [`shader_path`]. None by default.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Sources {
    texts: BTreeMap<String, String>,
}

impl Sources {
    /// What `folder`, laid out as `kernels/src`, has for `files` (name, embedded text). A text that equals the embedded one takes no place.
    ///
    /// # Errors
    /// When a file is not there, cannot be read, or is not UTF-8.
    pub fn read(folder: &Path, files: &[(&str, &str)]) -> Result<Sources> {
        let mut texts = BTreeMap::new();
        for &(name, embedded) in files {
            let path = shader_path(name);
            let file = folder.join(&path);
            let text = std::fs::read_to_string(&file).map_err(|source| Error::File { file, source })?;
            if text != embedded {
                texts.insert(path, text);
            }
        }
        Ok(Sources { texts })
    }

    /// Whether every shader is as it was compiled in.
    pub fn is_empty(&self) -> bool {
        self.texts.is_empty()
    }

    /// The files whose text differs between these sources and `other`, in alphabetical order.
    pub fn differences(&self, other: &Sources) -> Vec<String> {
        let paths: BTreeSet<&String> = self.texts.keys().chain(other.texts.keys()).collect();
        paths.into_iter().filter(|path| self.texts.get(*path) != other.texts.get(*path)).cloned().collect()
    }

    /// Path and text of a file, given its name and its embedded text.
    pub(crate) fn file<'a>(&'a self, name: &str, embedded: &'a str) -> (String, &'a str) {
        let path = shader_path(name);
        let text = self.texts.get(&path).map_or(embedded, String::as_str);
        (path, text)
    }
}

impl Gpu {
    /// What shaders are made of now.
    pub fn sources(&self) -> Arc<Sources> {
        self.sources.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Makes shaders of other sources from now on, by whomever they are compiled on this device, and returns the former. What was compiled stays.
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
    fn shared_files_have_a_folder_and_made_up_texts_none() {
        assert_eq!(shader_path("hash"), "shared/hash.wgsl");
        assert_eq!(shader_path("signal"), "shared/signal.wgsl");
        assert_eq!(shader_path("shading/shading.wgsl"), "shading/shading.wgsl");
        assert_eq!(shader_path("probe body"), "probe body");
    }

    #[test]
    fn what_differs_is_found_on_both_sides() {
        let (before, after) = (sources(&[("a", "1"), ("b", "1"), ("c", "1")]), sources(&[("b", "2"), ("c", "1"), ("d", "1")]));
        assert_eq!(before.differences(&after), ["a", "b", "d"]);
        assert_eq!(after.differences(&before), ["a", "b", "d"]);
        assert!(before.differences(&before).is_empty());
        assert_eq!(before.file("b", "embedded"), ("b".to_owned(), "1"));
        assert_eq!(before.file("d", "embedded"), ("d".to_owned(), "embedded"));
    }

    #[test]
    fn a_file_that_is_not_there_is_named() {
        let error = Sources::read(Path::new("/nowhere"), &[("hash", "")]).expect_err("no such folder").to_string();
        assert!(error.contains("hash.wgsl: "), "{error}");
        assert!(Sources::read(Path::new("/nowhere"), &[]).expect("nothing is asked for").is_empty());
    }
}

//! A temporary folder for a test.

use std::fs;
use std::path::PathBuf;

/// A temporary folder. It is removed from the disk when this value is dropped.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    /// Creates an empty folder. `test` is a part of its name, and must be different for each test.
    pub(crate) fn new(test: &str) -> Folder {
        let folder = std::env::temp_dir().join(format!("scree-workbench-{test}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("can be made");
        Folder(folder)
    }

    /// Returns the names of the entries in the folder, in alphabetical order.
    pub(crate) fn names(&self) -> Vec<String> {
        let names = fs::read_dir(&self.0).expect("is there").map(|entry| entry.expect("an entry").file_name());
        let mut names: Vec<String> = names.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // If this fails, files remain in the system's folder for temporary files, where they do no harm.
        let _ = fs::remove_dir_all(&self.0);
    }
}

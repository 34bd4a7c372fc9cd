//! A folder for a test.

use std::fs;
use std::path::PathBuf;

/// A folder among the temporary ones that is removed in the end.
pub(crate) struct Folder(pub(crate) PathBuf);

impl Folder {
    /// An empty folder for the test of this name, which no other has.
    pub(crate) fn new(test: &str) -> Folder {
        let folder = std::env::temp_dir().join(format!("scree-workbench-{test}-{}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        fs::create_dir_all(&folder).expect("can be made");
        Folder(folder)
    }

    /// Names of what lies in it, in alphabetical order.
    pub(crate) fn names(&self) -> Vec<String> {
        let names = fs::read_dir(&self.0).expect("is there").map(|entry| entry.expect("an entry").file_name());
        let mut names: Vec<String> = names.map(|name| name.to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What is left lies in the folder of temporary files.
        let _ = fs::remove_dir_all(&self.0);
    }
}

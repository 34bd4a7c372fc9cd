//! Shaders that are edited while they draw: which files of a folder changed, and what becomes of it.
//!
//! A change that compiles is drawn with; one that does not leaves everything as it was, and is told as one line with file, line and message. No file
//! system tells of its changes alike, so the files are looked at, four times a second: some thirty, whose modification times take microseconds.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use kernels::frame::{ReloadReport, Renderer, shader_files};
use kernels::gpu::{Gpu, Sources};

/// Pause between two looks at the files.
pub const INTERVAL: Duration = Duration::from_millis(250);

/// What tells one version of a file from another: when it was written, and its length in bytes.
type Stamp = (SystemTime, u64);

/// A file, as it was when it was looked at last.
struct Watched {
    /// Path in the folder.
    name: String,
    /// Absent where there is no such file.
    stamp: Option<Stamp>,
    /// Whether it is named once more.
    again: bool,
}

/// Looks for changes of some files of a folder.
pub struct Watcher {
    folder: PathBuf,
    files: Vec<Watched>,
    looked: Option<Instant>,
}

impl Watcher {
    /// Watches `names`, paths in `folder`.
    pub fn new(folder: PathBuf, names: impl IntoIterator<Item = String>) -> Watcher {
        let files = names.into_iter().map(|name| Watched { name, stamp: None, again: true }).collect();
        Watcher { folder, files, looked: None }
    }

    /// The files that changed, came or went since they were looked at last; the first time all. Absent if none did, or the last look is less than
    /// [`INTERVAL`] ago.
    ///
    /// A changed file is named at the next look, too: an editor may have been in the middle of writing it, and have ended within the same tick of the
    /// file system's clock. So whoever reads a file when it is named has read its last version in the end.
    pub fn changed(&mut self) -> Option<Vec<String>> {
        if self.looked.is_some_and(|at| at.elapsed() < INTERVAL) {
            return None;
        }
        self.looked = Some(Instant::now());
        let names = self.look();
        (!names.is_empty()).then_some(names)
    }

    fn look(&mut self) -> Vec<String> {
        let mut names = Vec::new();
        for file in &mut self.files {
            let stamp = stamp(&self.folder.join(&file.name));
            let differs = stamp != file.stamp;
            if differs || file.again {
                names.push(file.name.clone());
            }
            (file.stamp, file.again) = (stamp, differs);
        }
        names
    }

    /// Names nothing until something changes.
    fn rest(&mut self) {
        self.look();
        for file in &mut self.files {
            file.again = false;
        }
    }
}

fn stamp(file: &Path) -> Option<Stamp> {
    let data = std::fs::metadata(file).ok()?;
    Some((data.modified().ok()?, data.len()))
}

/// Keeps a renderer's shaders as they are in a folder.
pub struct Reload {
    folder: PathBuf,
    watcher: Watcher,
    /// What was last given to a renderer, whether it compiled or not; absent if the folder could not be read.
    tried: Option<Sources>,
}

impl Reload {
    /// Follows the WGSL files of `folder`, which is laid out as `kernels/src`.
    pub fn new(folder: PathBuf) -> Reload {
        let watcher = Watcher::new(folder.clone(), shader_files().iter().map(|file| file.path.to_owned()));
        Reload { folder, watcher, tried: None }
    }

    /// Takes changes over, if there are any: `None` if not, else what was built anew (nothing, if a change was taken back).
    ///
    /// # Errors
    /// In one line: a file that cannot be read, or the compiler's complaint with file and line. The renderer then draws as before.
    pub fn step(&mut self, renderer: &mut Renderer<'_>) -> Option<Result<ReloadReport, String>> {
        self.watcher.changed()?;
        match Sources::read(&self.folder, &shader_files()) {
            Ok(sources) if self.tried.as_ref() == Some(&sources) => None,
            Ok(sources) => {
                self.tried = Some(sources.clone());
                Some(renderer.reload_shaders(sources).map_err(|error| error.to_string()))
            }
            Err(error) => {
                self.tried = None;
                Some(Err(error.to_string()))
            }
        }
    }

    /// To be called when a device failed and another is about to take its place, which draws with the shaders of the program. Those of the folder may
    /// be what it failed at, so they are left alone until a file is saved. Returns what is to be told, if the device drew with any.
    pub fn device_failed(&mut self, gpu: &Gpu) -> Option<String> {
        self.tried = None;
        self.watcher.rest();
        let folder = self.folder.display();
        (!gpu.sources().is_empty()).then(|| {
            format!("the graphics device failed with the shaders of {folder}: those of the program draw until a file there is saved")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_folder::Folder;

    /// A folder with two files to be watched.
    fn watched(test: &str) -> Folder {
        let folder = Folder::new(test);
        std::fs::create_dir(folder.0.join("b")).expect("a folder");
        write(&folder, "a.wgsl", "1");
        write(&folder, "b/c.wgsl", "1");
        folder
    }

    fn write(folder: &Folder, name: &str, text: &str) {
        std::fs::write(folder.0.join(name), text).expect("written");
    }

    fn watcher(folder: &Folder) -> Watcher {
        Watcher::new(folder.0.clone(), ["a.wgsl", "b/c.wgsl"].map(str::to_owned))
    }

    #[test]
    fn changes_are_named_twice_and_then_no_more() {
        let folder = watched("changes");
        let mut watcher = watcher(&folder);
        assert_eq!(watcher.look(), ["a.wgsl", "b/c.wgsl"]);
        assert_eq!(watcher.look(), ["a.wgsl", "b/c.wgsl"]);
        assert!(watcher.look().is_empty());
        write(&folder, "b/c.wgsl", "22");
        assert_eq!(watcher.look(), ["b/c.wgsl"]);
        assert_eq!(watcher.look(), ["b/c.wgsl"]);
        assert!(watcher.look().is_empty());
        // Files that nobody asked for are nobody's business.
        write(&folder, "d.wgsl", "1");
        assert!(watcher.look().is_empty());
    }

    #[test]
    fn files_replaced_truncated_and_removed_are_changes() {
        let folder = watched("replaced");
        let mut watcher = watcher(&folder);
        watcher.rest();
        assert!(watcher.look().is_empty());
        // As editors save: into a new file that takes the place of the old.
        write(&folder, "a.wgsl~", "333");
        std::fs::rename(folder.0.join("a.wgsl~"), folder.0.join("a.wgsl")).expect("renamed");
        assert_eq!(watcher.look(), ["a.wgsl"]);
        // Or emptied first; the text that follows is a change of its own.
        write(&folder, "a.wgsl", "");
        assert_eq!(watcher.look(), ["a.wgsl"]);
        write(&folder, "a.wgsl", "4444");
        assert_eq!(watcher.look(), ["a.wgsl"]);
        std::fs::remove_file(folder.0.join("a.wgsl")).expect("removed");
        assert_eq!(watcher.look(), ["a.wgsl"]);
        assert_eq!(watcher.look(), ["a.wgsl"]);
        assert!(watcher.look().is_empty());
        write(&folder, "a.wgsl", "4444");
        assert_eq!(watcher.look(), ["a.wgsl"]);
    }

    #[test]
    fn a_folder_that_is_not_there_is_named_at_first() {
        let mut watcher = Watcher::new(PathBuf::from("/nowhere"), ["a.wgsl".to_owned()]);
        assert_eq!(watcher.changed(), Some(vec!["a.wgsl".to_owned()]));
        assert!(watcher.look().is_empty());
    }

    #[test]
    fn looks_are_a_pause_apart() {
        let folder = watched("pause");
        let mut watcher = watcher(&folder);
        assert!(watcher.changed().is_some());
        write(&folder, "a.wgsl", "22");
        assert_eq!(watcher.changed(), None);
        watcher.looked = Instant::now().checked_sub(INTERVAL);
        assert_eq!(watcher.changed().expect("the pause is over").first().map(String::as_str), Some("a.wgsl"));
    }
}

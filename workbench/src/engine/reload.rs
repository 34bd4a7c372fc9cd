//! Reloading of shaders that are edited while the workbench runs: finds changed files in a folder, and rebuilds the stages that use them.
//!
//! A change that compiles takes effect. If a change does not compile, the old shaders stay in use, and the error is reported as one line with file,
//! line and message. Notifications of changes differ between file systems, so the files are polled four times a second. There are fewer than 100
//! files, and reading a modification time takes microseconds.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use kernels::frame::{ReloadReport, Renderer, shader_files};
use kernels::gpu::{Gpu, Sources};

/// Time between two checks of the files.
pub const INTERVAL: Duration = Duration::from_millis(250);

/// Identifies the version of a file: modification time, and length in bytes.
type Stamp = (SystemTime, u64);

/// A file, as it was at the last check.
struct Watched {
    /// Path relative to the watched folder.
    name: String,
    /// `None` = the file does not exist.
    stamp: Option<Stamp>,
    /// Whether the next check reports the file again.
    again: bool,
}

/// Finds changes of given files in a folder.
pub struct Watcher {
    folder: PathBuf,
    files: Vec<Watched>,
    looked: Option<Instant>,
}

impl Watcher {
    /// Watches the files `names`, which are paths relative to `folder`.
    pub fn new(folder: PathBuf, names: impl IntoIterator<Item = String>) -> Watcher {
        let files = names.into_iter().map(|name| Watched { name, stamp: None, again: true }).collect();
        Watcher { folder, files, looked: None }
    }

    /// Returns the files that were changed, created or removed since the last check; at the first check, all files. `None` = there are no such files,
    /// or the last check is less than [`INTERVAL`] ago.
    ///
    /// A changed file is reported again at the next check, for this reason: at the first report, an editor may still be writing the file. If the
    /// editor finishes within the same tick of the file system's clock, the modification time does not change again. A caller that reads the file at
    /// both reports gets the last version, if the editor has finished by the second one.
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

    /// Regards the current files as unchanged, so that nothing is reported until a file changes.
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

/// Keeps the shaders of a renderer up to date with a folder.
pub struct Reload {
    folder: PathBuf,
    watcher: Watcher,
    /// The sources that were last given to a renderer, whether they compiled or not. `None` = no sources were given yet, the last attempt to read the
    /// folder failed, or a device failed since.
    tried: Option<Sources>,
}

impl Reload {
    /// Watches the WGSL files in `folder`, which has the layout of `kernels/src`.
    pub fn new(folder: PathBuf) -> Reload {
        let watcher = Watcher::new(folder.clone(), shader_files().iter().map(|file| file.path.to_owned()));
        Reload { folder, watcher, tried: None }
    }

    /// Applies changes of the files to the renderer. `None` = there are no changes. Otherwise, returns a report of the stages that were rebuilt. The
    /// report lists no stage if none had to be rebuilt, for example because the user has reverted a change that did not compile.
    ///
    /// # Errors
    /// One line: a file cannot be read, or a compiler error with file and line. The renderer then continues with its old shaders.
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

    /// Call this when a device failed, before it is replaced. The new device draws with the shaders of the program. The shaders in the folder may be
    /// the cause of the failure, so they are not used until one of their files is saved again. Returns a message if the failed device used shaders
    /// from the folder.
    pub fn device_failed(&mut self, gpu: &Gpu) -> Option<String> {
        self.tried = None;
        self.watcher.rest();
        let folder = self.folder.display();
        (!gpu.sources().is_empty()).then(|| {
            format!(
                "the graphics device failed with the shaders of {folder}: the program's own shaders are used until a file there is saved"
            )
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
        // Files that are not watched are not reported.
        write(&folder, "d.wgsl", "1");
        assert!(watcher.look().is_empty());
    }

    #[test]
    fn files_replaced_truncated_and_removed_are_changes() {
        let folder = watched("replaced");
        let mut watcher = watcher(&folder);
        watcher.rest();
        assert!(watcher.look().is_empty());
        // Some editors save into a new file, which then replaces the old one.
        write(&folder, "a.wgsl~", "333");
        std::fs::rename(folder.0.join("a.wgsl~"), folder.0.join("a.wgsl")).expect("renamed");
        assert_eq!(watcher.look(), ["a.wgsl"]);
        // Other editors empty the file first. Writing the text afterwards is a second change.
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

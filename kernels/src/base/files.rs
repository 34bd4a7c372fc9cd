//! Writes files and folders under temporary names and renames them when they are complete. So a process that fails or is killed leaves nothing
//! incomplete under the final name.

use std::ffi::OsString;
use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Result};

/// Converts an error of the system into one that names the file.
pub(crate) fn failed(file: &Path) -> impl FnOnce(std::io::Error) -> Error {
    move |source| Error::File { file: file.to_owned(), source }
}

/// End of the names of temporary files.
pub(crate) const TEMPORARY: &str = ".tmp";

/// Files of one kind that a program keeps for a user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FolderKind {
    /// Files that can be made again.
    Cache,
    /// What the user has set up, such as the arrangement of a window.
    State,
}

/// The folder `scree` in which the files of one kind lie on this system; `None` = no environment variable gives an absolute path. The parent folder
/// is, for caches and for the state: `$XDG_CACHE_HOME` or else `~/.cache`, and `$XDG_STATE_HOME` or else `~/.local/state`, on Linux; `%LOCALAPPDATA%`
/// and `%APPDATA%` on Windows; `~/Library/Caches` and `~/Library/Application Support` on macOS. `variable` returns an environment variable.
pub fn folder_of_user(kind: FolderKind, variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    // A relative path would be a different folder in each working directory.
    let folder = |name: &str| variable(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
    let of = |cache: &'static str, state: &'static str| if kind == FolderKind::Cache { cache } else { state };
    let parent = if cfg!(windows) {
        folder(of("LOCALAPPDATA", "APPDATA"))
    } else if cfg!(target_os = "macos") {
        folder("HOME").map(|home| home.join("Library").join(of("Caches", "Application Support")))
    } else {
        folder(of("XDG_CACHE_HOME", "XDG_STATE_HOME")).or_else(|| folder("HOME").map(|home| home.join(of(".cache", ".local/state"))))
    };
    Some(parent?.join("scree"))
}

/// Runs `write` on a temporary file in the folder of `file`, then renames the temporary file to `file`. If `write` fails or the process is killed,
/// `file` stays as it was.
///
/// # Errors
/// `file` is a device, a pipe, or a link that leads nowhere. Or writing or renaming fails; the temporary file is then removed.
pub fn write_whole<E: From<Error>>(file: &Path, write: impl FnOnce(&Path) -> std::result::Result<(), E>) -> std::result::Result<(), E> {
    write_whole_by(file, &std::process::id().to_string(), write)
}

/// Does the same as [`write_whole`]. `writer` becomes part of the name of the temporary file. It must be unique among all that may write `file` at
/// the same time.
pub(crate) fn write_whole_by<E: From<Error>>(
    file: &Path,
    writer: &str,
    write: impl FnOnce(&Path) -> std::result::Result<(), E>,
) -> std::result::Result<(), E> {
    let file = &target(file)?;
    let temporary = with(file, &format!(".{writer}{TEMPORARY}"));
    let done = write(&temporary).and_then(|()| Ok(fs::rename(&temporary, file).map_err(failed(file))?));
    if done.is_err() {
        // An error of this removal is ignored: the caller gets the error of writing or renaming, and the temporary file may not exist.
        let _ = fs::remove_file(&temporary);
    }
    done
}

/// The file that `write_whole` replaces for the path `file`: `file` itself or, if `file` is a link, the file to which the link leads.
///
/// # Errors
/// `file` is a link that leads nowhere. Or `file` is a device or a pipe: renaming would replace the device or pipe by a file.
fn target(file: &Path) -> Result<PathBuf> {
    match fs::symlink_metadata(file) {
        Ok(data) if data.is_symlink() => target(&fs::canonicalize(file).map_err(failed(file))?),
        Ok(data) if !data.is_file() && !data.is_dir() => {
            Err(Error::Request(format!("{} is a device or a pipe: give the name of a file", file.display())))
        }
        _ => Ok(file.to_owned()),
    }
}

/// A folder that is filled under a temporary name, next to its final path. If this value is dropped without [`WholeFolder::finish`], the folder is
/// removed.
///
/// A process that is killed leaves the temporary folder behind. [`remove_unfinished`] removes such folders. To tell them from a folder that is being
/// filled, a file beside the folder is locked while a process fills it.
pub struct WholeFolder {
    temporary: PathBuf,
    place: PathBuf,
    /// The locked file beside the folder. `None` only while this value is dropped.
    lock: Option<File>,
}

/// Returns two paths for the final path `place` of a folder. The first is `place` with a symbolic link resolved. The second is the common prefix of
/// the paths of its temporary folders.
///
/// # Errors
/// `place` does not end in a name, or is a link that leads nowhere.
fn temporary_beside(place: &Path) -> Result<(PathBuf, PathBuf)> {
    // If `place` is a link to an empty folder, the new folder replaces that folder, and the link stays.
    let place = if place.is_symlink() { fs::canonicalize(place).map_err(failed(place))? } else { place.to_owned() };
    let Some(name) = place.file_name() else {
        return Err(Error::Request(format!("`{}` does not end in a name: give the name of a folder", place.display())));
    };
    let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let begin = parent.join(format!(".{}.part-", name.to_string_lossy()));
    Ok((place, begin))
}

/// The path with `end` appended to its last name.
fn with(path: &Path, end: &str) -> PathBuf {
    let mut path = path.as_os_str().to_owned();
    path.push(end);
    PathBuf::from(path)
}

/// Removes the temporary folders that killed processes left behind. `place`: the final path of the [`WholeFolder`]. Temporary folders that a process
/// is still filling are kept. Returns the removed folders.
///
/// # Errors
/// `place` does not end in a name, or is a link that leads nowhere, or an abandoned folder cannot be removed.
pub fn remove_unfinished(place: &Path) -> Result<Vec<PathBuf>> {
    let (_, begin) = temporary_beside(place)?;
    let (Some(parent), Some(begin)) = (begin.parent(), begin.file_name()) else { return Ok(Vec::new()) };
    let begin = begin.to_string_lossy();
    let mut removed = Vec::new();
    for entry in fs::read_dir(parent).into_iter().flatten().filter_map(std::result::Result::ok) {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        if !name.strip_prefix(&*begin).is_some_and(is_number) || path.is_symlink() || !path.is_dir() {
            continue;
        }
        let lock = with(&path, LOCK_END);
        let is_in_use = match File::open(&lock) {
            Ok(file) => file.try_lock().is_err(),
            Err(error) => error.kind() != ErrorKind::NotFound,
        };
        if !is_in_use {
            fs::remove_dir_all(&path).map_err(failed(&path))?;
            // A lock file without its folder has no effect, so an error of its removal is ignored.
            let _ = fs::remove_file(&lock);
            removed.push(path);
        }
    }
    removed.sort();
    Ok(removed)
}

/// End of the name of the file that is locked while a temporary folder is filled.
const LOCK_END: &str = ".lock";

impl WholeFolder {
    /// Creates a temporary folder next to `place`; [`WholeFolder::finish`] renames it to `place`.
    ///
    /// # Errors
    /// `place` does not end in a name, or is a link that leads nowhere. Or the temporary folder or its lock file cannot be created, or this lock file
    /// is locked already.
    pub fn beside(place: &Path) -> Result<WholeFolder> {
        let (place, begin) = temporary_beside(place)?;
        let temporary = with(&begin, &std::process::id().to_string());
        let lock_file = with(&temporary, LOCK_END);
        let lock = OpenOptions::new().write(true).create(true).truncate(false).open(&lock_file).map_err(failed(&lock_file))?;
        if matches!(lock.try_lock(), Err(TryLockError::WouldBlock)) {
            return Err(Error::Request(format!("{} is being written already: choose another folder", place.display())));
        }
        let made = WholeFolder { temporary, place, lock: Some(lock) };
        // An earlier process with the same process id may have been killed and have left files. They must not become part of the folder.
        if made.temporary.exists() {
            fs::remove_dir_all(&made.temporary).map_err(failed(&made.temporary))?;
        }
        fs::create_dir_all(&made.temporary).map_err(failed(&made.temporary))?;
        Ok(made)
    }

    /// The temporary folder, to write into.
    pub fn folder(&self) -> &Path {
        &self.temporary
    }

    /// Gives the folder its final name. An empty folder of that name is replaced.
    ///
    /// # Errors
    /// The final path is a file or a folder that is not empty, or the temporary folder cannot be renamed. The temporary folder is then removed.
    pub fn finish(self) -> Result<()> {
        // Some systems cannot rename a folder to the name of an existing empty folder, so an existing folder is removed first.
        if self.place.exists() {
            fs::remove_dir(&self.place).map_err(failed(&self.place))?;
        }
        fs::rename(&self.temporary, &self.place).map_err(failed(&self.place))
    }
}

impl Drop for WholeFolder {
    fn drop(&mut self) {
        // Errors are ignored, because the temporary folder does not exist after `finish`. A folder that cannot be removed is left behind.
        drop(fs::remove_dir_all(&self.temporary));
        // The lock file is closed before it is removed, because some systems cannot remove an open file.
        drop(self.lock.take());
        drop(fs::remove_file(with(&self.temporary, LOCK_END)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_of_the_user_follow_from_the_environment() {
        let home = &*std::env::temp_dir();
        let of = |kind, set: &[(&str, &Path)]| {
            folder_of_user(kind, |name| set.iter().find(|(known, _)| *known == name).map(|(_, path)| path.as_os_str().to_owned()))
        };
        let all = |path| ["HOME", "APPDATA", "LOCALAPPDATA", "XDG_STATE_HOME", "XDG_CACHE_HOME"].map(|name| (name, path));
        for kind in [FolderKind::Cache, FolderKind::State] {
            assert!(of(kind, &all(home)).is_some_and(|folder| folder.starts_with(home) && folder.ends_with("scree")));
            assert_eq!(of(kind, &all(Path::new("relative"))), None);
            assert_eq!(of(kind, &[]), None);
        }
        if cfg!(target_os = "linux") {
            let home = Path::new("/home/ada");
            assert_eq!(of(FolderKind::Cache, &[("HOME", home)]), Some(home.join(".cache/scree")));
            assert_eq!(of(FolderKind::State, &[("HOME", home)]), Some(home.join(".local/state/scree")));
            let set = [("HOME", home), ("XDG_CACHE_HOME", Path::new("/c")), ("XDG_STATE_HOME", Path::new("/s"))];
            assert_eq!(of(FolderKind::Cache, &set), Some(PathBuf::from("/c/scree")));
            assert_eq!(of(FolderKind::State, &set), Some(PathBuf::from("/s/scree")));
            // A relative path is ignored.
            assert_eq!(of(FolderKind::Cache, &[set[0], ("XDG_CACHE_HOME", Path::new("c"))]), Some(home.join(".cache/scree")));
        }
    }
}

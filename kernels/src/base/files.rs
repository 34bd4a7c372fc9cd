//! Writes files and folders under temporary names and renames them when they are complete. So a process that fails or is killed leaves nothing
//! incomplete under the final name.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Result};

fn failed(file: &Path) -> impl FnOnce(std::io::Error) -> Error {
    move |source| Error::File { file: file.to_owned(), source }
}

/// Runs `write` on a temporary file in the folder of `file`, then renames the temporary file to `file`. If `write` fails or the process is killed,
/// `file` stays as it was.
///
/// # Errors
/// `file` is a device, a pipe, or a link that leads nowhere. Or writing or renaming fails; the temporary file is then removed.
pub fn write_whole<E: From<Error>>(file: &Path, write: impl FnOnce(&Path) -> std::result::Result<(), E>) -> std::result::Result<(), E> {
    let file = &target(file)?;
    let mut name = file.file_name().unwrap_or_default().to_os_string();
    name.push(format!(".{}.tmp", std::process::id()));
    let temporary = file.with_file_name(name);
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
/// A process that is killed leaves the temporary folder behind. While a process fills the folder, a file beside it is locked. So
/// [`remove_unfinished`] can tell an abandoned folder from a folder that is being filled.
pub struct WholeFolder {
    temporary: PathBuf,
    place: PathBuf,
    /// The locked file beside the folder. `None` only while this value is dropped.
    lock: Option<File>,
}

/// Returns two paths for the final path `place` of a folder: `place` with a symbolic link resolved, and the common prefix of the paths of its
/// temporary folders.
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

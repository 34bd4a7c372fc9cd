//! Writes files and folders atomically: each appears complete or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Result};

fn failed(file: &Path) -> impl FnOnce(std::io::Error) -> Error {
    move |source| Error::File { file: file.to_owned(), source }
}

/// Runs `write` on a temporary file in the folder of `file`, then renames the temporary file to `file`. So `file` is never incomplete.
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

/// A folder that is filled under a temporary name, next to its final path. It is removed if [`WholeFolder::finish`] is not called.
pub struct WholeFolder {
    temporary: PathBuf,
    place: PathBuf,
}

impl WholeFolder {
    /// Creates a temporary folder next to `place`; [`WholeFolder::finish`] renames it to `place`.
    ///
    /// # Errors
    /// `place` does not end in a name, or the temporary folder cannot be created.
    pub fn beside(place: &Path) -> Result<WholeFolder> {
        // If `place` is a link, the folder to which it leads is replaced, and the link stays.
        let place = &if place.is_symlink() { fs::canonicalize(place).map_err(failed(place))? } else { place.to_owned() };
        let Some(name) = place.file_name() else {
            return Err(Error::Request(format!("`{}` does not end in a name: give the name of a folder", place.display())));
        };
        let parent = place.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let temporary = parent.join(format!(".{}.part-{}", name.to_string_lossy(), std::process::id()));
        fs::create_dir_all(&temporary).map_err(failed(&temporary))?;
        Ok(WholeFolder { temporary, place: place.to_owned() })
    }

    /// The temporary folder, to write into.
    pub fn folder(&self) -> &Path {
        &self.temporary
    }

    /// Gives the folder its final name. An empty folder of that name is replaced.
    ///
    /// # Errors
    /// A folder of that name exists and is not empty, or the temporary folder cannot be renamed. The temporary folder is then removed.
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
    }
}

//! Writing files completely or not at all.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use kernels::base::error::Error;
use kernels::base::files::write_whole;

/// Writes a file under a temporary name, flushes it to the disk, and renames it. If writing fails, a file that was at the path before stays there,
/// unchanged.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let done = write_whole(path, |temporary| {
        let written = || -> std::io::Result<()> {
            let mut file = File::create(temporary)?;
            file.write_all(bytes)?;
            file.sync_all()
        };
        written().map_err(|source| Error::File { file: path.to_owned(), source })
    });
    done.map_err(|error| match error {
        Error::File { source, .. } => {
            format!("cannot write {}: {source}: make room if the disk is full, or choose a folder in which you may write", path.display())
        }
        other => format!("cannot write {}: {other}", path.display()),
    })
}

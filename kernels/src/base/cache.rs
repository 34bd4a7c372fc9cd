//! A cache on disk of what takes long to make: baked nodes and procedural textures. So the second start with a scene is faster than the first.
//!
//! An entry is a file. It lies in a folder whose name is the hash of everything on which the entry depends, such as the heightmap, the rules, and the
//! code and the compiler that make it (`build.rs`). If a scene changes, its entries have another folder. So no entry has to be declared invalid.
//!
//! An entry ends with a checksum. An entry that is damaged or cannot be read counts as absent, and the new entry replaces it. Entries are written
//! under temporary names and renamed, so several processes can share a folder. If an entry cannot be written, for example because the disk is full,
//! the cache writes no more entries, and [`Cache::problem`] says why.
//!
//! Limits: the byte order and the compiler are part of the hash, but the mathematical library of the system is not. A process looks for old entries
//! when it has written 1/16 of the limit, so the cache may exceed its limit by that much for each process.

use std::ffi::OsString;
use std::fmt::{Debug, Display};
use std::fs::{self, File};
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime};

use twox_hash::XxHash64;

use crate::base::error::{Error, Result};
use crate::base::files::{self, FolderKind, TEMPORARY, failed};

/// The limit of the cache of the user, bytes. A picture needs up to 500 nodes with 330 KB each, and a scene with the default size of textures 2.2 MB
/// for each procedural texture. So this is enough for about ten scenes.
pub const USER_LIMIT: u64 = 2_000_000_000;

/// The first bytes of every entry.
const MAGIC: [u8; 8] = *b"scree 01";
/// Bytes of the first bytes, the key and the hash of the name, which precede the content of an entry.
const HEADER: usize = 24;
/// Bytes of the checksum, which follows the content.
const CHECKSUM: usize = 8;
/// An entry that is read gets the current time as time of modification, if its time is older than this. A temporary file that is older was left
/// behind by a process that was killed.
const HOUR: Duration = Duration::from_secs(3600);

/// Hash of everything on which an entry depends, except its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Key(u64);

impl Key {
    /// Returns the key of entries of one kind that depend on these values. The types of the values must derive `Debug`: then the text shows every
    /// field, and every bit of a finite number.
    pub(crate) fn of(kind: &str, values: impl Debug) -> Key {
        let text = format!("{kind} {} {} {values:?}", env!("SCREE_CODE"), if cfg!(target_endian = "big") { "big" } else { "little" });
        Key(XxHash64::oneshot(0, text.as_bytes()))
    }
}

/// Hash of many numbers, which a key can contain in their place.
pub(crate) fn hash_of(numbers: &[f32]) -> u64 {
    XxHash64::oneshot(0, bytemuck::cast_slice(numbers))
}

/// How many entries a process has read and written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CacheCounts {
    /// Entries that were read and were whole.
    pub read: usize,
    /// Entries that were written.
    pub written: usize,
}

/// A folder of entries. Threads can share it.
#[derive(Debug)]
pub struct Cache {
    folder: PathBuf,
    /// The size above which old entries are removed, bytes.
    limit: u64,
    /// Bytes that were written since old entries were last looked for; `None` = they were not looked for yet. It is locked while entries are removed.
    written: Mutex<Option<u64>>,
    counts: [AtomicUsize; 2],
    problem: OnceLock<String>,
}

impl Cache {
    /// A cache in `folder`, which is created when the first entry is written. `limit`: the size, in bytes, above which the entries are removed that
    /// were not used for the longest time. Other files in the folder are never removed.
    pub fn new(folder: PathBuf, limit: u64) -> Cache {
        Cache { folder, limit, written: Mutex::new(None), counts: [AtomicUsize::new(0), AtomicUsize::new(0)], problem: OnceLock::new() }
    }

    /// The cache of the user, which all renderers of this process share; `None` = there is none. `SCREE_CACHE` is its folder, relative to the working
    /// directory; `off` = no cache. If the variable is not set or empty, the folder is the one that [`files::folder_of_user`] gives for caches. The
    /// limit is [`USER_LIMIT`].
    pub fn of_user() -> Option<Arc<Cache>> {
        static CACHE: LazyLock<Option<Arc<Cache>>> = LazyLock::new(|| Cache::by(|name| std::env::var_os(name)).map(Arc::new));
        CACHE.clone()
    }

    fn by(variable: impl Fn(&str) -> Option<OsString>) -> Option<Cache> {
        let folder = match variable("SCREE_CACHE").filter(|given| !given.is_empty()) {
            Some(given) if given == "off" => return None,
            Some(given) => std::path::absolute(given).ok()?,
            None => files::folder_of_user(FolderKind::Cache, variable)?,
        };
        Some(Cache::new(folder.join("entries"), USER_LIMIT))
    }

    /// The folder of the entries.
    pub fn folder(&self) -> &Path {
        &self.folder
    }

    /// Why the cache writes no more entries; `None` = it works.
    pub fn problem(&self) -> Option<&str> {
        self.problem.get().map(String::as_str)
    }

    /// How many entries were read from this cache and written to it.
    pub fn counts(&self) -> CacheCounts {
        let [read, written] = self.counts.each_ref().map(|count| count.load(Ordering::Relaxed));
        CacheCounts { read, written }
    }

    fn path(&self, Key(key): Key, name: &str) -> PathBuf {
        self.folder.join(format!("{key:016x}")).join(name)
    }

    /// Returns the content of an entry; `None` if it is absent or damaged. `name` consists of digits and hyphens.
    pub(crate) fn read(&self, key: Key, name: &str) -> Option<Vec<u8>> {
        let path = self.path(key, name);
        let mut file = File::open(&path).ok()?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).ok()?;
        let content = bytes.len().checked_sub(HEADER + CHECKSUM)?;
        let (checked, checksum) = bytes.split_at(HEADER + content);
        if checked[..HEADER] != header(key, name) || checksum != checksum_of(checked) {
            return None;
        }
        if file.metadata().is_ok_and(|data| is_old(&data)) {
            // An error is ignored: it only makes the entry look older than it is.
            drop(File::options().write(true).open(path).and_then(|file| file.set_modified(SystemTime::now())));
        }
        self.counts[0].fetch_add(1, Ordering::Relaxed);
        bytes.truncate(HEADER + content);
        bytes.drain(..HEADER);
        Some(bytes)
    }

    /// Writes an entry, unless an earlier entry could not be written. `name` consists of digits and hyphens.
    pub(crate) fn write(&self, key: Key, name: &str, content: &[u8]) {
        if self.problem.get().is_some() {
            return;
        }
        let mut bytes = header(key, name).to_vec();
        bytes.extend_from_slice(content);
        bytes.extend_from_slice(&checksum_of(&bytes));
        match write_file(&self.path(key, name), &bytes) {
            Ok(()) => {}
            // Another process removed the folder while it was empty. The entry is left out; later entries have their folder again.
            Err(Error::File { source, .. }) if source.kind() == ErrorKind::NotFound => return,
            Err(error) => return self.stop(&error),
        }
        self.counts[1].fetch_add(1, Ordering::Relaxed);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        *written = written.map(|written| written + bytes.len() as u64).filter(|written| *written <= self.limit / 16);
        if written.is_none() {
            self.trim();
            *written = Some(0);
        }
    }

    /// Writes no more entries. If several threads call this, the first message is kept.
    fn stop(&self, why: &dyn Display) {
        let mend = "to mend it, give the folder space and write access, or set SCREE_CACHE to another folder or to `off`";
        drop(self.problem.set(format!("nodes and textures are not kept for the next start: {why}; {mend}")));
    }

    /// If the entries exceed the limit, removes those that were not used for the longest time, until the others take at most three quarters of the
    /// limit. Also removes temporary files that a killed process left behind, and empty folders. Files and folders with names that this cache does
    /// not give are ignored.
    fn trim(&self) {
        let mut entries: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        let folders: Vec<PathBuf> = inside(&self.folder, fs::Metadata::is_dir, is_key).map(|(path, _)| path).collect();
        for (path, data) in folders.iter().flat_map(|folder| inside(folder, fs::Metadata::is_file, is_entry)) {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if !name.ends_with(TEMPORARY) {
                entries.push((data.modified().unwrap_or(SystemTime::UNIX_EPOCH), data.len(), path));
            } else if is_old(&data) {
                // The file is not counted, so it does not matter if it cannot be removed.
                drop(fs::remove_file(path));
            }
        }
        let mut size: u64 = entries.iter().map(|(_, bytes, _)| bytes).sum();
        if size <= self.limit {
            return;
        }
        entries.sort();
        for (_, bytes, path) in entries {
            if size <= self.limit / 4 * 3 {
                break;
            }
            // Another process may have removed the entry already.
            if fs::remove_file(&path).is_ok() || !path.exists() {
                size -= bytes;
            }
        }
        for folder in folders {
            // Folders that are not empty stay.
            drop(fs::remove_dir(folder));
        }
        if size > self.limit {
            self.stop(&format!("{} is full, and old entries cannot be removed", self.folder.display()));
        }
    }
}

/// The files or folders in a folder whose names are accepted. Links are left out.
fn inside(folder: &Path, is_kind: fn(&fs::Metadata) -> bool, accepts: fn(&str) -> bool) -> impl Iterator<Item = (PathBuf, fs::Metadata)> {
    let entries = fs::read_dir(folder).into_iter().flatten().filter_map(std::result::Result::ok);
    entries.filter_map(move |entry| {
        // The metadata of an entry are those of the link, if it is a link.
        let data = entry.metadata().ok().filter(is_kind)?;
        accepts(entry.file_name().to_str()?).then(|| (entry.path(), data))
    })
}

/// Whether a folder has the name of a key.
fn is_key(name: &str) -> bool {
    name.len() == 16 && name.bytes().all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte))
}

/// Whether a file has the name of an entry or of its temporary file.
fn is_entry(name: &str) -> bool {
    let name = match name.strip_suffix(TEMPORARY) {
        Some(name) => name.split_once('.').map_or("", |(name, _)| name),
        None => name,
    };
    !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_digit() || byte == b'-')
}

/// Whether a file was written or refreshed more than an hour ago.
fn is_old(data: &fs::Metadata) -> bool {
    data.modified().is_ok_and(|modified| modified.elapsed().is_ok_and(|age| age > HOUR))
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(failed(folder))?;
    // Several threads may write the same entry at the same time.
    static COUNT: AtomicUsize = AtomicUsize::new(0);
    let writer = format!("{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
    files::write_whole_by(path, &writer, |temporary| fs::write(temporary, bytes).map_err(failed(temporary)))
}

fn header(Key(key): Key, name: &str) -> [u8; HEADER] {
    let name = XxHash64::oneshot(2, name.as_bytes());
    let mut header = [0; HEADER];
    for (bytes, part) in header.chunks_exact_mut(8).zip([MAGIC, key.to_le_bytes(), name.to_le_bytes()]) {
        bytes.copy_from_slice(&part);
    }
    header
}

fn checksum_of(bytes: &[u8]) -> [u8; CHECKSUM] {
    XxHash64::oneshot(1, bytes).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_folder_of_the_user_follows_from_the_environment() {
        let of = |variables: &[(&str, &str)]| {
            let value = |name: &str| variables.iter().find(|(known, _)| *known == name).map(|(_, value)| OsString::from(value));
            Cache::by(value).map(|cache| cache.folder().to_owned())
        };
        let home = std::env::temp_dir().join("home");
        let home = (if cfg!(windows) { "LOCALAPPDATA" } else { "HOME" }, home.to_str().expect("the temporary folder has a plain name"));
        assert_eq!(of(&[home, ("SCREE_CACHE", "off")]), None);
        assert_eq!(of(&[]), None);
        let usual = of(&[home]).expect("a folder");
        assert!(usual.starts_with(home.1) && usual.ends_with("scree/entries"), "{}", usual.display());
        assert_eq!(of(&[home, ("SCREE_CACHE", "")]), Some(usual));
        let here = std::env::current_dir().expect("a working directory");
        assert_eq!(of(&[home, ("SCREE_CACHE", "kept")]), Some(here.join("kept/entries")));
    }

    #[test]
    fn only_names_that_the_cache_gives_are_its_own() {
        for (name, is_folder, is_file) in [
            ("0123456789abcdef", true, false),
            ("0123456789ABCDEF", false, false),
            ("0123456789abcde", false, false),
            ("photos-of-summer", false, false),
            ("3-9-10", false, true),
            ("3-9-10.4711-2.tmp", false, true),
            ("3-9-10.txt", false, false),
            ("1024", false, true),
            ("", false, false),
            (".tmp", false, false),
            ("letter.tmp", false, false),
        ] {
            assert_eq!((is_key(name), is_entry(name)), (is_folder, is_file), "{name}");
        }
    }
}

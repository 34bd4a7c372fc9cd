//! A cache of baked nodes on disk, so that the second start with a scene is faster than the first.
//!
//! An entry is a file: the ground of a node, or its payload and cover. The file lies in a folder whose name is the hash of everything on which the
//! entry depends, such as the heightmap, the rules, and the code that makes nodes (`build.rs`). So an entry never becomes wrong. If a scene changes,
//! its entries have another folder.
//!
//! An entry ends with a checksum. An entry that is damaged or cannot be read counts as absent, and the new entry replaces it. Entries are written
//! under temporary names and renamed, so several processes can share a folder. If an entry cannot be written, for example because the disk is full,
//! the cache writes no more entries, and [`NodeCache::problem`] says why.
//!
//! Limits: entries have the byte order of the machine, which is therefore part of the hash. The cache may exceed its limit by 1/16 before it removes
//! entries, and by more if several processes write at the same time.

use std::ffi::OsString;
use std::fmt::Debug;
use std::fs::{self, File};
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock, Mutex, OnceLock, PoisonError};
use std::time::{Duration, SystemTime};

use twox_hash::XxHash64;

use super::NodeId;
use crate::base::error::{Error, Result};
use crate::base::files;

/// The limit of the cache of the user, bytes. A picture needs about 500 nodes with 330 KB each, so this is enough for a dozen scenes.
pub const USER_LIMIT: u64 = 2_000_000_000;

/// The first bytes of every entry.
const MAGIC: [u8; 8] = *b"screenod";
/// Bytes of the first bytes, the key and the node, which precede the content of an entry.
const HEADER: usize = 24;
/// Bytes of the checksum, which follows the content.
const CHECKSUM: usize = 8;
/// An entry that is read gets the current time as time of modification, if its time is older than this.
const REFRESH: Duration = Duration::from_secs(3600);

/// Hash of everything on which an entry depends, except the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Key(u64);

impl Key {
    /// Returns the key of entries of one kind that depend on these values. The text of `Debug` shows every field and every bit of a finite number.
    pub(super) fn of(kind: &str, values: impl Debug) -> Key {
        let text = format!("{kind} {} {} {values:?}", env!("SCREE_NODE_CODE"), if cfg!(target_endian = "big") { "big" } else { "little" });
        Key(XxHash64::oneshot(0, text.as_bytes()))
    }
}

/// Hash of many numbers, which a key can contain in their place.
pub(super) fn hash_of(numbers: &[f32]) -> u64 {
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

/// A folder of baked nodes. Threads can share it.
#[derive(Debug)]
pub struct NodeCache {
    folder: PathBuf,
    /// The size above which old entries are removed, bytes.
    limit: u64,
    /// Bytes that this process has written since it last looked for old entries; `None` = it has not looked yet. One thread writes at a time, because
    /// two threads may make the same node.
    written: Mutex<Option<u64>>,
    counts: [AtomicUsize; 2],
    problem: OnceLock<String>,
}

impl NodeCache {
    /// A cache in `folder`, which is created when the first entry is written. `limit`: the size above which the entries that were not used for the
    /// longest time are removed, bytes.
    pub fn new(folder: PathBuf, limit: u64) -> NodeCache {
        NodeCache { folder, limit, written: Mutex::new(None), counts: [AtomicUsize::new(0), AtomicUsize::new(0)], problem: OnceLock::new() }
    }

    /// The cache of the user, which all renderers of this process share. `SCREE_CACHE` is its folder; `off` = no cache. If the variable is not set, it
    /// is `scree` in a folder that depends on the system: `$XDG_CACHE_HOME` or else `~/.cache` on Linux, `%LOCALAPPDATA%` on Windows, and
    /// `~/Library/Caches` on macOS. Its limit is [`USER_LIMIT`]. `None` = no cache, or no variable gives an absolute path.
    pub fn of_user() -> Option<Arc<NodeCache>> {
        static CACHE: LazyLock<Option<Arc<NodeCache>>> = LazyLock::new(|| NodeCache::by(|name| std::env::var_os(name)).map(Arc::new));
        CACHE.clone()
    }

    fn by(variable: impl Fn(&str) -> Option<OsString>) -> Option<NodeCache> {
        let given = variable("SCREE_CACHE").filter(|given| !given.is_empty());
        if given.as_ref().is_some_and(|given| given == "off") {
            return None;
        }
        // A relative path would be a different folder in each working directory.
        let folder = |name: &str| variable(name).map(PathBuf::from).filter(|folder| folder.is_absolute());
        let of_system = || {
            let caches = if cfg!(windows) {
                folder("LOCALAPPDATA")
            } else if cfg!(target_os = "macos") {
                folder("HOME").map(|home| home.join("Library/Caches"))
            } else {
                folder("XDG_CACHE_HOME").or_else(|| folder("HOME").map(|home| home.join(".cache")))
            };
            Some(caches?.join("scree"))
        };
        let folder = match given {
            Some(given) => std::path::absolute(given).ok()?,
            None => of_system()?,
        };
        Some(NodeCache::new(folder.join("nodes"), USER_LIMIT))
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

    fn path(&self, Key(key): Key, node: NodeId) -> PathBuf {
        self.folder.join(format!("{key:016x}")).join(format!("{}-{}-{}", node.lod, node.x, node.y))
    }

    /// Returns the content of an entry; `None` if it is absent or damaged.
    pub(super) fn read(&self, key: Key, node: NodeId) -> Option<Vec<u8>> {
        let mut file = File::open(self.path(key, node)).ok()?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).ok()?;
        let content = bytes.len().checked_sub(HEADER + CHECKSUM)?;
        let (checked, checksum) = bytes.split_at(HEADER + content);
        if checked[..HEADER] != header(key, node) || checksum != checksum_of(checked) {
            return None;
        }
        // Errors are ignored: they only make the entry look older than it is.
        let modified = file.metadata().and_then(|data| data.modified());
        if modified.is_ok_and(|modified| modified.elapsed().is_ok_and(|age| age > REFRESH)) {
            drop(file.set_modified(SystemTime::now()));
        }
        self.counts[0].fetch_add(1, Ordering::Relaxed);
        bytes.truncate(HEADER + content);
        bytes.drain(..HEADER);
        Some(bytes)
    }

    /// Writes an entry, unless an earlier entry could not be written.
    pub(super) fn write(&self, key: Key, node: NodeId, content: &[u8]) {
        if self.problem.get().is_some() {
            return;
        }
        let mut bytes = header(key, node).to_vec();
        bytes.extend_from_slice(content);
        bytes.extend_from_slice(&checksum_of(&bytes));
        let path = self.path(key, node);
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        // The first attempt also fails if another process removes the folder of the entry because it is still empty.
        if let Err(error) = write_file(&path, &bytes).or_else(|_| write_file(&path, &bytes)) {
            let why = format!(
                "baked nodes are not kept for the next start: {error}; free some space, or set SCREE_CACHE to another folder or to `off`"
            );
            // If two threads fail one after the other, the first message is kept.
            drop(self.problem.set(why));
            return;
        }
        self.counts[1].fetch_add(1, Ordering::Relaxed);
        *written = written.map(|written| written + bytes.len() as u64).filter(|written| *written <= self.limit / 16);
        if written.is_none() {
            self.trim();
            *written = Some(0);
        }
    }

    /// If the entries exceed the limit, removes those that were not used for the longest time, until three quarters of the limit are left. Entries that
    /// another process removes at the same time are skipped.
    fn trim(&self) {
        let inside = |folder: &Path| fs::read_dir(folder).into_iter().flatten().filter_map(std::result::Result::ok);
        let folders: Vec<PathBuf> = inside(&self.folder).map(|entry| entry.path()).collect();
        let mut entries: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
        for entry in folders.iter().flat_map(|folder| inside(folder)) {
            if let Some(data) = entry.metadata().ok().filter(fs::Metadata::is_file) {
                entries.push((data.modified().unwrap_or(SystemTime::UNIX_EPOCH), data.len(), entry.path()));
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
            if fs::remove_file(path).is_ok() {
                size -= bytes;
            }
        }
        for folder in folders {
            // A folder that is not empty is not removed.
            drop(fs::remove_dir(folder));
        }
    }
}

fn write_file(path: &Path, bytes: &[u8]) -> Result<()> {
    let failed = |file: &Path| {
        let file = file.to_owned();
        move |source| Error::File { file, source }
    };
    let folder = path.parent().unwrap_or(Path::new("."));
    fs::create_dir_all(folder).map_err(failed(folder))?;
    files::write_whole(path, |temporary| fs::write(temporary, bytes).map_err(failed(temporary)))
}

fn header(Key(key): Key, node: NodeId) -> [u8; HEADER] {
    let node = u64::from(node.lod) << 32 | u64::from(node.x) << 16 | u64::from(node.y);
    let mut header = [0; HEADER];
    for (bytes, part) in header.chunks_exact_mut(8).zip([MAGIC, key.to_le_bytes(), node.to_le_bytes()]) {
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
            let variables: Vec<_> = variables.iter().map(|(name, value)| (*name, OsString::from(value))).collect();
            let cache = NodeCache::by(|name| variables.iter().find(|(known, _)| *known == name).map(|(_, value)| value.clone()));
            cache.map(|cache| cache.folder().to_owned())
        };
        let home = if cfg!(windows) { ("LOCALAPPDATA", r"C:\home") } else { ("HOME", "/home/ada") };
        let given = std::env::temp_dir().join("nodes of ada");
        let given = given.to_str().expect("the temporary folder has a plain name");
        assert_eq!(of(&[home, ("SCREE_CACHE", given)]), Some(Path::new(given).join("nodes")));
        assert_eq!(of(&[home, ("SCREE_CACHE", "off")]), None);
        assert_eq!(of(&[]), None);
        let of_system = of(&[home]).expect("a folder");
        assert!(of_system.starts_with(home.1) && of_system.ends_with("scree/nodes"), "{}", of_system.display());
        assert_eq!(of(&[home, ("SCREE_CACHE", "")]), Some(of_system.clone()));
        // A path that is relative to the working directory would be a different folder for each start.
        assert_eq!(of(&[home, ("XDG_CACHE_HOME", "caches")]), Some(of_system));
        if cfg!(target_os = "linux") {
            assert_eq!(of(&[home, ("XDG_CACHE_HOME", "/caches")]), Some(PathBuf::from("/caches/scree/nodes")));
        }
    }
}

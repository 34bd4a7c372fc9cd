//! Computes a number that changes whenever the code that makes node payloads changes. Entries of the cache of baked nodes (`src/world/cache.rs`) contain
//! it, so nodes that other code has made are never read.

use std::hash::{DefaultHasher, Hasher as _};
use std::path::{Path, PathBuf};
use std::{env, fs, io};

/// The modules that take part in making payloads, and all modules that they may import.
const MODULES: [&str; 6] = ["base", "blocks", "decode", "scene", "shared", "world"];

fn main() -> io::Result<()> {
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut hasher = DefaultHasher::new();
    // The lock file has the versions of the libraries. It is absent if `kernels` is used outside its workspace.
    let lock = root.join("../Cargo.lock");
    if lock.is_file() {
        add(&lock, &mut hasher)?;
    }
    for module in MODULES {
        add(&root.join("src").join(module), &mut hasher)?;
    }
    println!("cargo::rustc-env=SCREE_NODE_CODE={:016x}", hasher.finish());
    Ok(())
}

/// Adds a file, or all Rust files of a folder in the order of their names, with their names.
fn add(path: &Path, hasher: &mut DefaultHasher) -> io::Result<()> {
    println!("cargo::rerun-if-changed={}", path.display());
    if !path.is_dir() {
        hasher.write(path.file_name().unwrap_or_default().as_encoded_bytes());
        hasher.write(&fs::read(path)?);
        return Ok(());
    }
    let mut entries = fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
    entries.retain(|entry| entry.is_dir() || entry.extension().is_some_and(|extension| extension == "rs"));
    entries.sort();
    entries.iter().try_for_each(|entry| add(entry, hasher))
}

//! Computes a number that changes whenever the code of this crate changes. The keys of the cache on disk (`src/base/cache.rs`) contain it, so entries
//! that other code has made are never read. The code is all Rust of this crate, its libraries, and the compiler with its settings.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs, io};

fn main() -> io::Result<()> {
    let mut hasher = DefaultHasher::new();
    let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    // The two files of the workspace are absent if this crate is used outside it.
    for file in ["../Cargo.lock", "../Cargo.toml", "Cargo.toml", "src"] {
        add(&root.join(file), &mut hasher)?;
    }
    for setting in ["TARGET", "OPT_LEVEL", "CARGO_ENCODED_RUSTFLAGS"] {
        println!("cargo::rerun-if-env-changed={setting}");
        env::var_os(setting).hash(&mut hasher);
    }
    Command::new(env::var_os("RUSTC").unwrap_or_else(|| "rustc".into())).arg("-vV").output()?.stdout.hash(&mut hasher);
    println!("cargo::rustc-env=SCREE_CODE={:016x}", hasher.finish());
    Ok(())
}

/// Adds a file, or all Rust files in a folder in the order of their names. A file that does not exist is left out.
fn add(path: &Path, hasher: &mut DefaultHasher) -> io::Result<()> {
    if path.is_dir() {
        println!("cargo::rerun-if-changed={}", path.display());
        let mut entries = fs::read_dir(path)?.map(|entry| Ok(entry?.path())).collect::<io::Result<Vec<_>>>()?;
        entries.retain(|entry| entry.is_dir() || entry.extension().is_some_and(|extension| extension == "rs"));
        entries.sort();
        // The number of entries marks the end of the folder, and `hash` that of each name and text.
        hasher.write_usize(entries.len());
        return entries.iter().try_for_each(|entry| add(entry, hasher));
    }
    if path.is_file() {
        println!("cargo::rerun-if-changed={}", path.display());
        path.file_name().hash(hasher);
        fs::read(path)?.hash(hasher);
    }
    Ok(())
}

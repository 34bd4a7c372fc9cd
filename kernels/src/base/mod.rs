//! Helpers that every other module may use and that do not depend on terrain: errors, names, TOML documents, files, progress, colour, lists
//! of numbers, and WGSL files with their dependencies.

pub mod cache;
pub mod colour;
pub mod document;
pub mod error;
pub mod files;
pub mod names;
pub mod progress;
pub mod section;
pub mod wgsl;

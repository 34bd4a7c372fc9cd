//! The library's error type: what went wrong and, where possible, where and how to fix it.

use std::path::PathBuf;

/// The errors of this crate. The text of an error says what is wrong and, where possible, where and how to fix it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A scene file is wrong.
    #[error("scene {where_}: {what}")]
    Scene {
        /// The file or folder with, if known, the line; or the name of the scene, if the error was not found while a file was read.
        where_: String,
        /// What is wrong and how to fix it.
        what: String,
    },
    /// A heightmap is wrong.
    #[error("heightmap {}: {what}", file.display())]
    Heightmap {
        /// The file.
        file: PathBuf,
        /// What is wrong and how to fix it.
        what: String,
    },
    /// A material's textures are wrong.
    #[error("material `{name}`: {what}")]
    Material {
        /// The material's name.
        name: String,
        /// What is wrong and how to fix it.
        what: String,
    },
    /// The machine has no suitable adapter, or no device can be opened on it.
    #[error("adapter: {0}")]
    Adapter(String),
    /// The caller requested something that is not possible.
    #[error("{0}")]
    Request(String),
    /// The GPU reported an error.
    #[error("gpu: {0}")]
    Gpu(String),
    /// Reading or writing a file failed.
    #[error("{}: {source}", file.display())]
    File {
        /// The file or folder.
        file: PathBuf,
        /// The error of the operating system.
        source: std::io::Error,
    },
    /// Reading or writing an image failed.
    #[error("image {}: {what}", file.display())]
    Image {
        /// The file.
        file: PathBuf,
        /// What is wrong.
        what: String,
    },
}

/// Returns the text on one line: each run of white space and control characters, such as line breaks and the escape character, becomes one space.
/// Runs at the start and at the end are removed. The function is meant for texts from files that become part of an error.
pub fn one_line(text: &str) -> String {
    text.split(|c: char| c.is_whitespace() || c.is_control()).filter(|word| !word.is_empty()).collect::<Vec<_>>().join(" ")
}

/// Result with the library's error.
pub type Result<T> = std::result::Result<T, Error>;

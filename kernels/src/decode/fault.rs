//! Reasons why a file cannot be read. They are divided into kinds, because the remedies differ.

use std::fmt;
use std::io;

/// The reason why a file cannot be read. `Display` writes the reason without the name of the file. If the reason is not an I/O error, the remedy
/// follows. The text may contain control characters, because it can quote the file or a decoder.
#[derive(Debug)]
pub enum Fault {
    /// The operating system cannot read the file.
    Io(io::Error),
    /// The file ends too early, or violates its format. The string says what is wrong; `Display` adds the remedy.
    Damaged(String),
    /// Two statements of the file exclude each other. The string gives the statements; `Display` adds the remedy.
    Contradictory(String),
    /// The file is of a kind that cannot be used, or it does not fit the options. The string says what is wrong, and gives the remedy.
    Unsupported(String),
    /// The file exceeds a limit. The string says what is too large, and gives the remedy.
    TooLarge(String),
}

impl Fault {
    /// Converts an I/O error of a decoder. Decoders may report truncated and corrupt data as I/O errors, too, but without an error number of
    /// the operating system.
    pub fn of_io(error: io::Error) -> Fault {
        if error.raw_os_error().is_some() {
            Fault::Io(error)
        } else if error.kind() == io::ErrorKind::UnexpectedEof {
            Fault::Damaged("it ends too early".to_owned())
        } else {
            Fault::Damaged(error.to_string())
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Fault::Io(source) => write!(f, "cannot be read: {source}"),
            Fault::Damaged(what) => write!(f, "cannot be decoded ({what}); the file is truncated or damaged: copy or export it again"),
            Fault::Contradictory(what) => {
                write!(f, "contradicts itself: {what}; correct the tags with gdal_edit.py, or write the file anew with gdal_translate")
            }
            Fault::Unsupported(what) | Fault::TooLarge(what) => f.write_str(what),
        }
    }
}

impl std::error::Error for Fault {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Fault::Io(source) => Some(source),
            Fault::Damaged(_) | Fault::Contradictory(_) | Fault::Unsupported(_) | Fault::TooLarge(_) => None,
        }
    }
}

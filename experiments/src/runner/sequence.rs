//! The file with the pictures of reference sequences. A part that renders a reference writes it, and the sweeps of the same view and setting read it.
//!
//! The file consists of sections, each compressed with Zstandard. A section contains the sequences of all temporal resolves that have the same sample
//! points: for each frame, the pictures of these resolves, for all measured signals. A picture has two 32-bit words per pixel
//! (`kernels::shared::signal`), little-endian. If the lit picture is measured, the last section contains the lit picture of the converged reference,
//! as two pictures whose words are f32 numbers. The byte offsets of the sections are stored with the facts about the reference, not in the file. The
//! store removes the file when no unfinished sweep needs it.

use std::fs::{self, File};
use std::io::{BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use zstd::stream::{read::Decoder, write::Encoder};

/// Level of compression: the fastest of the standard levels 1 to 22. Higher levels save little, because colours are noisy.
const LEVEL: i32 = 1;

/// A section of the file that is being written.
type Section<'a> = Encoder<'a, BufWriter<File>>;

/// Writes the file under a temporary name. The file gets its final name when it is finished.
pub(super) struct Writer {
    file: PathBuf,
    temporary: PathBuf,
    output: Option<BufWriter<File>>,
}

impl Writer {
    /// Creates the file.
    ///
    /// # Errors
    /// The disk fails.
    pub(super) fn create(file: &Path) -> Result<Writer> {
        let mut name = file.file_name().unwrap_or_default().to_os_string();
        name.push(format!(".{}.tmp", std::process::id()));
        let temporary = file.with_file_name(name);
        let output = File::create(&temporary).with_context(|| failed(file))?;
        Ok(Writer { file: file.to_owned(), temporary, output: Some(BufWriter::new(output)) })
    }

    /// Writes a section. `write` gets a function that adds a picture to the section. Returns the place of the section: the offset of its first byte.
    ///
    /// # Errors
    /// `write` fails, or the disk fails.
    pub(super) fn section(&mut self, write: impl FnOnce(&mut dyn FnMut(&[[u32; 2]]) -> Result<()>) -> Result<()>) -> Result<u64> {
        let mut output = self.output.take().with_context(|| failed(&self.file))?;
        let place = output.stream_position().with_context(|| failed(&self.file))?;
        let mut encoder: Section<'_> = Encoder::new(output, LEVEL).with_context(|| failed(&self.file))?;
        write(&mut |picture| {
            for pixel in picture {
                for word in pixel {
                    encoder.write_all(&word.to_le_bytes()).with_context(|| failed(&self.file))?;
                }
            }
            Ok(())
        })?;
        self.output = Some(encoder.finish().with_context(|| failed(&self.file))?);
        Ok(place)
    }

    /// Flushes the file to the disk and renames it to its final name.
    ///
    /// # Errors
    /// The disk fails.
    pub(super) fn finish(mut self) -> Result<()> {
        let output = self.output.take().with_context(|| failed(&self.file))?;
        let whole = || -> std::io::Result<()> {
            output.into_inner().map_err(std::io::IntoInnerError::into_error)?.sync_all()?;
            fs::rename(&self.temporary, &self.file)
        };
        whole().with_context(|| failed(&self.file))
    }
}

impl Drop for Writer {
    fn drop(&mut self) {
        // After `finish` has succeeded, no file has the temporary name. An error is ignored, because the store removes temporary files when a run is
        // continued.
        let _ = fs::remove_file(&self.temporary);
    }
}

fn failed(file: &Path) -> String {
    format!("cannot write {}: make room if the disk is full", file.display())
}

/// The remedy if a file of a reference cannot be used.
pub(super) const AGAIN: &str = "repeat the command with --resume, so that the reference is rendered again";

fn unreadable(file: &Path) -> String {
    format!("cannot read {}: {AGAIN}", file.display())
}

/// Reads the pictures of a section one after the other.
pub(super) struct Pictures {
    file: PathBuf,
    pixels: usize,
    input: Decoder<'static, BufReader<File>>,
}

impl Pictures {
    /// Opens the section that begins at `place`.
    ///
    /// # Errors
    /// The file cannot be read.
    pub(super) fn open(file: &Path, place: u64, pixels: usize) -> Result<Pictures> {
        let open = || -> std::io::Result<Decoder<'static, BufReader<File>>> {
            let mut input = File::open(file)?;
            input.seek(SeekFrom::Start(place))?;
            // Only one section is decompressed. The bytes after it belong to the next section.
            Ok(Decoder::new(input)?.single_frame())
        };
        let input = open().with_context(|| unreadable(file))?;
        Ok(Pictures { file: file.to_owned(), pixels, input })
    }

    /// Reads the next picture.
    ///
    /// # Errors
    /// The file ends before the picture does, or is damaged.
    pub(super) fn next(&mut self) -> Result<Vec<[u32; 2]>> {
        let mut bytes = vec![0; self.pixels * 8];
        self.input.read_exact(&mut bytes).with_context(|| unreadable(&self.file))?;
        let word = |bytes: &[u8]| u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
        Ok(bytes.chunks_exact(8).map(|pixel| [word(&pixel[..4]), word(&pixel[4..])]).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A new folder for a test.
    fn folder(test: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("scree-sequence-{test}-{}", std::process::id()));
        // An earlier process with the same process id may have left the folder.
        let _ = fs::remove_dir_all(&path);
        fs::create_dir_all(&path).expect("a temporary folder can be made");
        path
    }

    fn picture(seed: u32) -> Vec<[u32; 2]> {
        (0..300).map(|i| [seed.wrapping_mul(2_654_435_761).wrapping_add(i * i), u32::MAX - i]).collect()
    }

    #[test]
    fn sections_are_read_back_and_damage_is_noticed() {
        let folder = folder("sections");
        let file = folder.join("reference.frames");
        let mut writer = Writer::create(&file).expect("creates");
        let mut places = Vec::new();
        for section in 0..3 {
            let place = writer.section(|add| (0..4).try_for_each(|frame| add(&picture(section * 10 + frame)))).expect("writes");
            places.push(place);
        }
        assert!(!file.exists(), "an unfinished file has no name");
        writer.finish().expect("finishes");
        for (section, place) in (0..).zip(&places) {
            let mut pictures = Pictures::open(&file, *place, 300).expect("opens");
            for frame in 0..4 {
                assert_eq!(pictures.next().expect("a picture"), picture(section * 10 + frame));
            }
            let error = pictures.next().expect_err("the section has four pictures").to_string();
            assert!(error.contains("reference.frames") && error.contains("--resume"), "{error}");
        }
        let whole = fs::read(&file).expect("reads");
        fs::write(&file, &whole[..whole.len() / 2]).expect("writes");
        let mut torn = Pictures::open(&file, places[1], 300).expect("opens");
        assert!((0..4).any(|_| torn.next().is_err()), "half of the file is missing");
        fs::remove_dir_all(&folder).expect("removes");
    }

    #[test]
    fn a_file_that_is_not_finished_is_removed() {
        let folder = folder("stopped");
        let file = folder.join("reference.frames");
        let mut writer = Writer::create(&file).expect("creates");
        let stopped = writer.section(|_| anyhow::bail!("stopped"));
        assert!(stopped.is_err());
        drop(writer);
        assert_eq!(fs::read_dir(&folder).expect("a folder").count(), 0);
        fs::remove_dir_all(&folder).expect("removes");
    }
}

//! Opens PNG and JPEG files: reads the header and the metadata. The caller then decodes the pixels.

use std::io::{BufRead, Cursor, Seek};

use image::codecs::jpeg::JpegDecoder;
use image::codecs::png::PngDecoder;
use image::{ImageDecoder, ImageError, ImageFormat, Limits};

use super::colours::Colours;
use super::fault::Fault;
use super::jpeg;
use crate::base::error::one_line;

/// A file whose header has been read.
pub struct Opened<'a> {
    /// Gives the size and the metadata, and decodes the pixels. For PNG, its memory is limited to 512 MiB, apart from the buffer of the caller. For
    /// JPEG, its memory is not limited.
    pub decoder: Box<dyn ImageDecoder + 'a>,
    /// What a PNG says about its colours; nothing for JPEG.
    pub colours: Colours,
}

/// Opens a file of this format.
///
/// # Errors
/// [`Fault::Io`]: the operating system cannot read the file. [`Fault::Damaged`]: the header is damaged, or a JPEG is truncated.
/// [`Fault::Unsupported`]: the format is neither PNG nor JPEG, or the file uses a feature that the decoder does not support. [`Fault::TooLarge`]: the
/// metadata or a row of pixels of a PNG exceed 64 MiB, or the file exceeds another limit of the decoder.
pub fn open<'a>(mut input: impl BufRead + Seek + 'a, format: ImageFormat) -> Result<Opened<'a>, Fault> {
    let mut opened = match format {
        ImageFormat::Png => {
            let colours = Colours::of_png(&mut input).map_err(unreadable)?;
            input.rewind().map_err(Fault::of_io)?;
            let decoder = PngDecoder::with_limits(input, Limits::default()).map_err(undecodable)?;
            Opened { decoder: Box::new(decoder), colours }
        }
        ImageFormat::Jpeg => {
            let mut bytes = Vec::new();
            input.read_to_end(&mut bytes).map_err(Fault::of_io)?;
            jpeg::check_end(&bytes)?;
            let decoder = JpegDecoder::new(Cursor::new(bytes)).map_err(undecodable)?;
            Opened { decoder: Box::new(decoder), colours: Colours::default() }
        }
        other => return Err(Fault::Unsupported(format!("{other:?} files cannot be read: save it as 8- or 16-bit PNG"))),
    };
    opened.decoder.set_limits(Limits::default()).map_err(undecodable)?;
    Ok(opened)
}

/// Converts an error of the decoder of PNG headers.
fn unreadable(error: png::DecodingError) -> Fault {
    match error {
        png::DecodingError::IoError(source) => Fault::of_io(source),
        png::DecodingError::LimitsExceeded => {
            Fault::TooLarge("a row of pixels, or the metadata, takes more than 64 MiB: resize it, or save it without metadata".to_owned())
        }
        other => Fault::Damaged(one_line(&other.to_string())),
    }
}

/// Converts an error of a decoder of pictures. The remedies in the text suit pictures, but not heightmaps.
pub fn undecodable(error: ImageError) -> Fault {
    undecodable_with(error, "save it as 8- or 16-bit PNG", "resize it")
}

/// The same as [`undecodable`], but with other remedies. `unsupported`: the remedy for a feature that is not supported. `too_large`: the
/// remedy for a file that is too large.
pub fn undecodable_with(error: ImageError, unsupported: &str, too_large: &str) -> Fault {
    match error {
        ImageError::IoError(source) => Fault::of_io(source),
        ImageError::Unsupported(what) => Fault::Unsupported(format!("it uses a feature that is not supported ({what}): {unsupported}")),
        ImageError::Limits(what) => Fault::TooLarge(format!("it is too large ({what}): {too_large}")),
        other => Fault::Damaged(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn png_and_jpeg_files_are_opened_and_others_are_not() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg] {
            let mut file = Cursor::new(Vec::new());
            image::RgbImage::from_pixel(3, 2, image::Rgb([10, 20, 30])).write_to(&mut file, format).expect("memory");
            let bytes = file.into_inner();
            let opened = open(Cursor::new(&bytes), format).unwrap_or_else(|fault| panic!("{fault}"));
            assert_eq!((opened.decoder.dimensions(), opened.colours), ((3, 2), Colours::default()), "{format:?}");
            // A file that ends inside its header must be refused. All lengths are below 33 bytes, the length of signature and header of a PNG. A PNG
            // that ends inside its pixels can be opened, because the pixels are decoded later.
            for length in [0, 10, 30] {
                assert!(matches!(open(Cursor::new(&bytes[..length]), format), Err(Fault::Damaged(_))), "{length} bytes of {format:?}");
            }
        }
        // The only row of this PNG has 120 MB. The decoder applies its limit where the pixels begin, so the file needs a chunk of pixels.
        let mut wide = Vec::new();
        let mut encoder = png::Encoder::new(&mut wide, 30_000_000, 1);
        encoder.set_color(png::ColorType::Rgba);
        let mut writer = encoder.write_header().expect("memory");
        writer.write_chunk(png::chunk::IDAT, &[]).expect("memory");
        drop(writer);
        assert!(matches!(open(Cursor::new(&wide), ImageFormat::Png), Err(Fault::TooLarge(_))));
        assert!(matches!(open(Cursor::new(b"GIF89a"), ImageFormat::Gif), Err(Fault::Unsupported(_))));
    }
}

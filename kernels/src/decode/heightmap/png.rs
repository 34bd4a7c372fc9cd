//! Reads heightmaps from 16-bit PNG files (PNG specification, third edition).

use std::io::{BufRead, Seek, SeekFrom};

use image::codecs::png::PngDecoder;
use image::{ColorType, ImageDecoder, ImageError, Limits};

use super::depth::Depth;
use super::options::ReadOptions;
use super::raster::{Absent, Raster, Stored, crop};
use super::scaling::Statement;
use super::spacing::Spacing;
use crate::decode::coded::undecodable_with;
use crate::decode::colours::MAX_INFO_BYTES;
use crate::decode::fault::Fault;

/// Length of the start of the file, bytes: the signature, and the header up to and including the colour type.
const START: usize = 26;
/// Largest factor by which Deflate can compress (RFC 1951: 258 bytes from 2 bits, a factor of 1032), rounded up.
const MOST_COMPRESSED: u64 = 1100;

/// Reads a file with 16 bits per channel. It may be grey, or coloured if red, green and blue are equal in each pixel. Transparent pixels are marked:
/// those whose alpha is 0, and those whose value is the one that the chunk tRNS declares as transparent. GDAL stores its no-data value in tRNS.
pub(super) fn read(mut input: impl BufRead + Seek, options: &ReadOptions) -> Result<Raster, Fault> {
    let mut start = [0; START];
    input.read_exact(&mut start).and_then(|()| input.rewind()).map_err(Fault::of_io)?;
    let (bits, colour) = (start[24], start[25]);
    let length = input.seek(SeekFrom::End(0)).and_then(|length| input.rewind().map(|()| length)).map_err(Fault::of_io)?;
    let mut limits = Limits::no_limits();
    limits.max_alloc = Some(MAX_INFO_BYTES as u64);
    let decoder = PngDecoder::with_limits(input, limits).map_err(fault)?;
    let (width, height) = decoder.dimensions();
    let window = options.window_of([width, height], false)?;
    // A damaged header can claim any size, so a size that the file cannot hold is refused before memory is allocated.
    if decoder.total_bytes() / MOST_COMPRESSED > length {
        return Err(Fault::Damaged(format!("it states {width} x {height} pixels, but has only {length} bytes")));
    }
    let kind = kind(bits, colour);
    if bits != 16 {
        return Err(not_16_bits(decoder, &kind));
    }
    let channels = usize::from(decoder.color_type().channel_count());
    let mut bytes = vec![0; width as usize * height as usize * channels * 2];
    decoder.read_image(&mut bytes).map_err(fault)?;
    let (values, _) = bytes.as_chunks::<2>();
    let Heights { samples, absent } = heights(values, channels, width as usize, &kind)?;
    let absent = if absent.is_empty() { absent } else { crop(absent, width, window) };
    Ok(Raster {
        format: format!("PNG, {kind}"),
        file_size: [width, height],
        window,
        depth: Depth::Unsigned16,
        holds_codes: true,
        stored: Stored::Single(crop(samples, width, window)),
        absent,
        no_data: None,
        statement: Statement::default(),
        spacing: Spacing::Unknown,
        orientation: "row 0 is taken as north",
        notes: Vec::new(),
    })
}

/// The error for a file that does not have 16 bits per channel: the reason and the remedy.
fn not_16_bits(decoder: PngDecoder<impl BufRead + Seek>, kind: &str) -> Fault {
    let looks = if decoder.color_type() == ColorType::Rgb8 { packed(decoder) } else { Ok(None) };
    match looks {
        Err(fault) => fault,
        Ok(Some((name, formula))) => Fault::Unsupported(format!(
            "its pixels are {kind}, which look like {name}; decode them with \
             gdal_calc.py -R IN --R_band=1 -G IN --G_band=2 -B IN --B_band=3 --type=Float32 --calc=\"{formula}\" --outfile=OUT.tif"
        )),
        Ok(None) => Fault::Unsupported(format!(
            "its samples are {kind}, but must have 16 bits: 8 bits are 256 levels, which show as terraces; export the heightmap as 16-bit greyscale"
        )),
    }
}

/// The samples of all pixels, row by row.
struct Heights {
    samples: Vec<f32>,
    /// For each pixel, the reason why it has no data; `None` if it has data. Empty if all pixels have data.
    absent: Vec<Option<Absent>>,
}

/// Takes one sample from each pixel. `values`: the channels of all pixels, in the byte order of the machine. `kind`: the kind of the pixels, for
/// messages. The result is an error if red, green and blue differ in a pixel, or if a pixel is partly transparent.
fn heights(values: &[[u8; 2]], channels: usize, width: usize, kind: &str) -> Result<Heights, Fault> {
    let count = values.len() / channels;
    let mut found = Heights { samples: Vec::with_capacity(count), absent: Vec::new() };
    for (index, pixel) in values.chunks_exact(channels).enumerate() {
        let value = |channel: usize| u16::from_ne_bytes(pixel[channel]);
        let place = || format!("column {}, row {}", index % width, index / width);
        if channels >= 3 && (value(0) != value(1) || value(1) != value(2)) {
            return Err(Fault::Unsupported(format!(
                "its pixels are {kind}, and red, green and blue differ (first at {}: {}, {}, {}), so none of them is a height; export 16-bit greyscale",
                place(),
                value(0),
                value(1),
                value(2)
            )));
        }
        found.samples.push(f32::from(value(0)));
        if channels.is_multiple_of(2) {
            match value(channels - 1) {
                u16::MAX => found.absent.push(None),
                0 => found.absent.push(Some(Absent::Transparent)),
                alpha => {
                    return Err(Fault::Unsupported(format!(
                        "its pixels are partly transparent (first at {}: alpha {alpha} of 65535), but a sample either has a height or has none; \
                         export 16-bit greyscale without alpha",
                        place()
                    )));
                }
            }
        }
    }
    if !found.absent.contains(&Some(Absent::Transparent)) {
        found.absent.clear();
    }
    Ok(found)
}

/// Bit depth and colour type of the header (section 11.2.1), in words.
fn kind(bits: u8, colour: u8) -> String {
    let colour = match colour {
        0 => "grey",
        2 => "colour",
        3 => "palette",
        4 => "grey with alpha",
        6 => "colour with alpha",
        _ => "unknown",
    };
    format!("{bits}-bit {colour}")
}

/// Name and formula of an encoding of elevations in 8-bit colours; `None` if the picture does not look like such an encoding.
///
/// In such an encoding, the low byte usually jumps from pixel to pixel, while the decoded elevations are smooth. In a photograph, all channels are
/// usually about equally smooth.
fn packed(decoder: PngDecoder<impl BufRead + Seek>) -> Result<Option<(&'static str, &'static str)>, Fault> {
    let width = decoder.dimensions().0 as usize;
    let mut bytes = vec![0; width * decoder.dimensions().1 as usize * 3];
    decoder.read_image(&mut bytes).map_err(fault)?;
    let (pixels, _) = bytes.as_chunks::<3>();
    let low_byte = roughness(pixels, width, |[_, green, _]| f64::from(green)).max(roughness(pixels, width, |[_, _, blue]| f64::from(blue)));
    let number = |[red, green, blue]: [u8; 3], weights: [f64; 3]| {
        f64::from(red) * weights[0] + f64::from(green) * weights[1] + f64::from(blue) * weights[2]
    };
    let elevations = -11_500.0..=9000.0;
    let encodings = [
        ("Terrarium tiles, elevations in metres", "R*256.0+G+B/256.0-32768", [256.0, 1.0, 1.0 / 256.0], -32_768.0, Some(&elevations)),
        (
            "Mapbox Terrain-RGB tiles, elevations in metres",
            "(R*65536.0+G*256.0+B)*0.1-10000",
            [6553.6, 25.6, 0.1],
            -10_000.0,
            Some(&elevations),
        ),
        ("16-bit numbers whose high byte is red and whose low byte is green", "R*256.0+G", [256.0, 1.0, 0.0], 0.0, None),
    ];
    let mut fitting = encodings.into_iter().filter(|&(_, _, weights, offset, limits)| {
        limits.is_none_or(|limits| pixels.iter().all(|&pixel| limits.contains(&(number(pixel, weights) + offset))))
            && roughness(pixels, width, |pixel| number(pixel, weights)) < 0.25 * low_byte
    });
    Ok(fitting.next().map(|(name, formula, ..)| (name, formula)))
}

/// Mean absolute difference of a value between neighbours in a row, divided by the range of the value; 0 if all values are equal.
fn roughness(pixels: &[[u8; 3]], width: usize, value: impl Fn([u8; 3]) -> f64) -> f64 {
    let (mut low, mut high, mut sum, mut count) = (f64::INFINITY, f64::NEG_INFINITY, 0.0, 0.0);
    for row in pixels.chunks(width) {
        for pair in row.windows(2) {
            let (a, b) = (value(pair[0]), value(pair[1]));
            (low, high) = (low.min(a).min(b), high.max(a).max(b));
            sum += (a - b).abs();
            count += 1.0;
        }
    }
    if high > low { sum / count / (high - low) } else { 0.0 }
}

/// Converts an error of the decoder.
fn fault(error: ImageError) -> Fault {
    undecodable_with(error, "export the heightmap as 16-bit greyscale", "convert it to .tif or .raw and give a window")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_exceed_the_limit_of_memory_are_refused() {
        let mut bytes = Vec::new();
        // 2^25 pixels of 8 bytes are 256 MiB, and the limit is 64 MiB.
        let mut encoder = png::Encoder::new(&mut bytes, 1 << 25, 1);
        encoder.set_color(png::ColorType::Rgba);
        encoder.set_depth(png::BitDepth::Sixteen);
        let mut writer = encoder.write_header().expect("memory");
        writer.write_chunk(png::chunk::IDAT, &[0; 8]).expect("memory");
        drop(writer);
        let Err(fault) = read(std::io::Cursor::new(bytes), &ReadOptions::default()) else { panic!("accepted") };
        assert!(fault.to_string().starts_with("it is too large"), "{fault}");
    }
}

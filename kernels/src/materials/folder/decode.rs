//! Decodes image files to texels: PNG, JPEG, TGA and OpenEXR.

use std::io::{BufRead, Read, Seek, SeekFrom};
use std::path::Path;

use glam::DVec3;
use image::codecs::tga::TgaDecoder;
use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, Limits};
use rayon::prelude::*;

use crate::base::error::one_line;
use crate::decode::coded::{Opened, open, undecodable};
use crate::decode::colours::Colours;
use crate::decode::fault::Fault;
use crate::decode::openexr::{self, Channel, Part};

/// Largest edge of an image, texels: four times the edge of the largest detail textures. A PNG of this size takes up to about 1.75 GiB of memory
/// until it is resampled. For 16-bit RGBA, this is 0.5 GiB as stored, 1 GiB as floats and 0.75 GiB for the texels, of which at most two exist at the
/// same time.
pub(super) const MAX_EDGE: u32 = 8192;

/// Bytes of the header of a TGA file.
const TGA_HEADER: usize = 18;

/// The channels that a map needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Want {
    /// Red, green and blue, or grey.
    Colour,
    /// x, y and, if it is there, z.
    Vector,
    /// One number, or red, green and blue.
    Number,
}

/// How samples are encoded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Encoding {
    /// Integers, scaled to 0..1. For colours, they are sRGB-encoded.
    Codes,
    /// Like [`Encoding::Codes`], but colours are linear values to the power of this number.
    Gamma(f64),
    /// Floats: linear, of any magnitude.
    Floats,
}

/// A decoded image. It is square. Row 0 is the bottom row, at v = 0.
#[derive(Clone, Debug)]
pub(super) struct Stored {
    /// Texels along an edge, at least 1.
    pub(super) edge: usize,
    /// Number of channels that are used: 1 (repeated in all three), 2 (the third is 0) or 3. Alpha is used only as the second component of
    /// a vector.
    pub(super) channels: usize,
    /// Finite values, row by row.
    pub(super) texels: Vec<[f32; 3]>,
    pub(super) encoding: Encoding,
    /// Notes for the user, one line each.
    pub(super) remarks: Vec<String>,
}

/// Decodes a file. The first bytes determine its format; TGA files, which have no signature, are recognised by the extension of `path`.
pub(super) fn decode(mut input: impl BufRead + Seek, path: &Path, want: Want) -> Result<Stored, Fault> {
    let mut start = Vec::new();
    input.by_ref().take(TGA_HEADER as u64).read_to_end(&mut start).map_err(Fault::Io)?;
    input.rewind().map_err(Fault::Io)?;
    let pixels = |Opened { decoder, colours }: Opened<'_>| coded(decoder, want, &colours);
    match image::guess_format(&start) {
        Ok(ImageFormat::OpenExr) => exr(openexr::read(input, MAX_EDGE)?, want),
        Ok(format @ (ImageFormat::Png | ImageFormat::Jpeg)) => pixels(open(input, format)?),
        _ if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("tga")) => {
            let length = input.seek(SeekFrom::End(0)).map_err(Fault::Io)?;
            input.rewind().map_err(Fault::Io)?;
            check_tga(&start, length)?;
            let mut decoder = TgaDecoder::new(input).map_err(undecodable)?;
            decoder.set_limits(Limits::default()).map_err(undecodable)?;
            coded(decoder, want, &Colours::default())
        }
        // `open` refuses all other formats, with an error that names the format.
        Ok(other) => pixels(open(input, other)?),
        Err(_) => Err(Fault::Unsupported("not a readable PNG, JPEG, TGA or OpenEXR image: save it again as 8- or 16-bit PNG".to_owned())),
    }
}

/// Checks the header of a TGA file before memory for the texels is allocated. Refuses a size that is not allowed, and a size with more texels than a
/// file of this length can contain (Truevision TGA File Format Specification 2.0: image type, image specification, run-length packets).
fn check_tga(start: &[u8], length: u64) -> Result<(), Fault> {
    let Some(header) = start.first_chunk::<TGA_HEADER>() else {
        return Err(Fault::Damaged("TGA: the file ends inside its header".to_owned()));
    };
    let [width, height] = [12, 14].map(|at| u16::from_le_bytes([header[at], header[at + 1]]));
    edge_of(u32::from(width), u32::from(height))?;
    let texels = u64::from(width) * u64::from(height);
    let bytes = u64::from(header[16].div_ceil(8));
    // Types 9 to 11 are compressed: a packet represents at most 128 texels, and takes at least one byte and the bytes of one texel.
    let data = if header[2] & 8 == 0 { texels * bytes } else { texels.div_ceil(128) * (1 + bytes) };
    if length < TGA_HEADER as u64 + data {
        return Err(Fault::Damaged(format!("TGA: {length} bytes cannot hold {width}x{height} texels")));
    }
    Ok(())
}

/// The edge of a square image of an allowed size.
fn edge_of(width: u32, height: u32) -> Result<usize, Fault> {
    if width != height || width == 0 {
        return Err(Fault::Unsupported(format!(
            "the image has {width}x{height} texels, but material maps must be square: crop or resize it"
        )));
    }
    if width > MAX_EDGE {
        return Err(Fault::TooLarge(format!(
            "the image has {width}x{width} texels, but at most {MAX_EDGE} per side are allowed: resize it"
        )));
    }
    Ok(width as usize)
}

/// Decodes a PNG, JPEG or TGA file. `colours`: the statements of a PNG file about its colours.
fn coded(mut decoder: impl ImageDecoder, want: Want, colours: &Colours) -> Result<Stored, Fault> {
    let (width, height) = decoder.dimensions();
    let edge = edge_of(width, height)?;
    // If the metadata cannot be read, the image counts as upright.
    if decoder.orientation().is_ok_and(|orientation| orientation != Orientation::NoTransforms) {
        return Err(Fault::Unsupported("its metadata require a rotation or a reflection: save it upright".to_owned()));
    }
    let mut remarks = Vec::new();
    let mut encoding = Encoding::Codes;
    if want == Want::Colour {
        let profile = decoder.icc_profile().ok().flatten();
        remarks
            .extend(colours.unapplied(profile.as_deref()).map(|what| format!("it has {what}, which is not applied: convert it to sRGB")));
        if colours.primaries.is_some() {
            remarks.push("its primaries (cHRM) are not those of sRGB and are not applied: convert it to sRGB".to_owned());
        }
        if let Some(gamma) = colours.gamma {
            if !(0.1..=10.0).contains(&gamma) {
                return Err(Fault::Unsupported(format!("it states a gamma of {gamma}, which no picture has: save it as sRGB")));
            }
            remarks.push(format!("it states the gamma {gamma:.3} instead of sRGB; this gamma is applied"));
            encoding = Encoding::Gamma(gamma);
        }
    }
    let decoded = DynamicImage::from_decoder(decoder).map_err(undecodable)?;
    let has_colour = decoded.color().has_color();
    let mut channels = if has_colour { 3 } else { 1 };
    let mut texels: Vec<[f32; 3]> = if decoded.color().has_alpha() {
        let whole = decoded.into_rgba32f();
        let is_opaque = whole.pixels().all(|p| p.0[3] >= 1.0);
        if want == Want::Vector && !has_colour && !is_opaque {
            channels = 2;
            whole.pixels().map(|p| [p.0[0], p.0[3], 0.0]).collect()
        } else {
            if !is_opaque {
                remarks.push("its alpha channel is not used".to_owned());
            }
            whole.pixels().map(|p| [p.0[0], p.0[1], p.0[2]]).collect()
        }
    } else {
        decoded.into_rgb32f().pixels().map(|p| p.0).collect()
    };
    turn_over(&mut texels, edge);
    Ok(Stored { edge, channels, texels, encoding, remarks })
}

/// Converts an OpenEXR file. Exactly one of its parts must have the channels that `want` needs.
fn exr(parts: Vec<Part>, want: Want) -> Result<Stored, Fault> {
    let refuse = |what: String| Err(Fault::Unsupported(what));
    let fitting: Vec<(&Part, Vec<&Channel>)> = parts.iter().filter_map(|part| Some((part, channels_of(part, want)?))).collect();
    let [(part, channels)] = fitting.as_slice() else {
        let names = parts.iter().flat_map(|part| &part.channels).map(|channel| channel.name.as_str());
        let names = one_line(&names.take(16).collect::<Vec<_>>().join(", "));
        let needed = match want {
            Want::Colour => "R, G, B",
            Want::Vector => "R, G, B or X, Y, Z",
            Want::Number => "a single channel or R, G, B",
        };
        let parts = parts.len();
        return refuse(format!("it must have one part with {needed} (parts: {parts}; channels: {names}): export it again"));
    };
    let (data, display) = (part.data_window, part.display_window);
    if data != display {
        return refuse(format!("its data window, {data}, is not its display window, {display}: export the whole picture"));
    }
    if (part.pixel_aspect - 1.0).abs() > 1e-3 {
        return refuse(format!("its pixels are not square (aspect {}): export it with square pixels", part.pixel_aspect));
    }
    let edge = edge_of(data.size[0], data.size[1])?;
    let count = edge * edge;
    if let Some(short) = channels.iter().find(|channel| channel.samples.len() != count) {
        return refuse(format!("channel {} has {} samples instead of {count}: export it again", short.name, short.samples.len()));
    }
    let bad = channels.iter().flat_map(|channel| &channel.samples).filter(|sample| !sample.is_finite()).count();
    if bad > 0 {
        return refuse(format!("{bad} of its values are NaN or infinite: repair or export it again"));
    }
    let value = |i: usize, c: usize| {
        let channel = if channels.len() == 1 { channels.first() } else { channels.get(c) };
        channel.map_or(0.0, |channel| channel.samples[i])
    };
    let mut texels: Vec<[f32; 3]> = (0..count).into_par_iter().map(|i| std::array::from_fn(|c| value(i, c))).collect();
    let mut remarks = Vec::new();
    if want == Want::Colour
        && let Some(stated) = part.chromaticities.filter(|stated| !stated.is_rec_709())
    {
        let Some(matrix) = stated.to_rec_709() else {
            return refuse(format!("it states primaries that are no colour space ({stated}): export it as linear sRGB"));
        };
        texels.par_iter_mut().for_each(|texel| *texel = (matrix * DVec3::from(texel.map(f64::from))).as_vec3().to_array());
        remarks.push(format!("its colours are converted to the primaries of Rec. 709 from {stated}"));
    }
    turn_over(&mut texels, edge);
    Ok(Stored { edge, channels: channels.len(), texels, encoding: Encoding::Floats, remarks })
}

/// Returns the one to three channels of a part that the map needs; `None`: the part does not have them.
fn channels_of(part: &Part, want: Want) -> Option<Vec<&Channel>> {
    let all = part.all();
    let named = |names: &[&str]| names.iter().map(|name| all.named(name)).collect::<Option<Vec<_>>>();
    let rgb = named(&["R", "G", "B"]);
    match want {
        Want::Vector => rgb.or_else(|| named(&["X", "Y", "Z"])).or_else(|| named(&["R", "G"])).or_else(|| named(&["X", "Y"])),
        Want::Colour | Want::Number => rgb.or_else(|| Some(vec![all.single()?])),
    }
}

/// Reverses the order of the rows: files begin with the top row, but [`Stored`] begins with the bottom row.
fn turn_over(texels: &mut [[f32; 3]], edge: usize) {
    for row in 0..edge / 2 {
        let (lower, upper) = texels.split_at_mut((edge - 1 - row) * edge);
        lower[row * edge..][..edge].swap_with_slice(&mut upper[..edge]);
    }
}

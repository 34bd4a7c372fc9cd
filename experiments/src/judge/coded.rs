//! Reads pictures from PNG and JPEG files. The exponent and the primaries that a PNG states (gAMA, cHRM) are applied to its colours. Other facts that
//! can affect a comparison are recorded.

use std::io::{BufRead, Seek};

use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder as _, ImageError, ImageFormat, ImageReader};
use kernels::base::colour::linear_from_srgb;
use kernels::decode::coded::{self, Opened};
use kernels::frame::MAX_PIXELS;

use super::layers::convert;
use super::picture::{Content, Image, Origin};

/// Reads a picture.
///
/// # Errors
/// The message is one clause that does not contain the name of the file.
pub(super) fn read(mut input: impl BufRead + Seek, layer: Option<&str>) -> Result<Image, String> {
    let unreadable = |error: std::io::Error| format!("cannot be read: {error}");
    let Some(format) = ImageReader::new(&mut input).with_guessed_format().map_err(unreadable)?.format() else {
        return Err("is not a picture: give an OpenEXR, PNG or JPEG file".to_owned());
    };
    if let Some(layer) = layer {
        return Err(format!("has no layer `{layer}`: only OpenEXR files have layers"));
    }
    let Opened { mut decoder, colours } = coded::open(input, format).map_err(|fault| fault.to_string())?;
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    let orientation = decoder.orientation().map_err(undecodable)?;
    let profile = decoder.icc_profile().map_err(undecodable)?;
    let mut decoded = DynamicImage::from_decoder(decoder).map_err(undecodable)?;
    decoded.apply_orientation(orientation);
    let colour_type = decoded.color();
    let encoded = decoded.into_rgba32f();
    let linear = |sample: f32| match colours.gamma {
        Some(gamma) => f64::from(sample).powf(1.0 / gamma) as f32,
        None => linear_from_srgb(sample),
    };
    let mut texels: Vec<[f32; 3]> = encoded.pixels().map(|p| [p[0], p[1], p[2]].map(linear)).collect();
    let converted_from = colours.primaries.map(|stated| convert(&mut texels, stated)).transpose()?;
    Ok(Image {
        size: [encoded.width(), encoded.height()],
        texels,
        alpha: colour_type.has_alpha().then(|| encoded.pixels().map(|p| p[3]).collect()),
        content: Content::Colour,
        origin: Origin {
            converted_from,
            gamma: colours.gamma,
            ignored: colours.unapplied(profile.as_deref()),
            turned: words(orientation),
            bits: Some(if matches!(colour_type, ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16) { 16 } else { 8 }),
            lossy: (format == ImageFormat::Jpeg).then_some("JPEG"),
            ..Origin::default()
        },
    })
}

fn undecodable(error: ImageError) -> String {
    coded::undecodable(error).to_string()
}

/// Refuses a size that is not supported. It is called before memory for the pixels is allocated.
fn check_size(width: u32, height: u32) -> Result<(), String> {
    if (1..=MAX_PIXELS).contains(&(u64::from(width) * u64::from(height))) {
        Ok(())
    } else {
        Err(format!("has {width}x{height} pixels: 1 to {MAX_PIXELS} (2^26) can be compared"))
    }
}

/// Describes how the orientation in the file turns the picture; `None` = not at all.
fn words(orientation: Orientation) -> Option<&'static str> {
    match orientation {
        Orientation::NoTransforms => None,
        Orientation::Rotate90 => Some("turned by 90 degrees clockwise"),
        Orientation::Rotate180 => Some("turned by 180 degrees"),
        Orientation::Rotate270 => Some("turned by 90 degrees anticlockwise"),
        Orientation::FlipHorizontal => Some("mirrored left to right"),
        Orientation::FlipVertical => Some("mirrored top to bottom"),
        Orientation::Rotate90FlipH => Some("turned by 90 degrees clockwise and mirrored left to right"),
        Orientation::Rotate270FlipH => Some("turned by 90 degrees anticlockwise and mirrored left to right"),
    }
}

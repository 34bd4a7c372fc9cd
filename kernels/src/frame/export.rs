//! Writes a picture to a file: tone-mapped PNG, or linear OpenEXR with its layers.

use std::path::{Path, PathBuf};

use exr::prelude as e;

use crate::base::error::{Error, Result};
use crate::base::files::write_whole;
use crate::display::Exposure;
use crate::frame::picture::{Layer, Picture};

/// Writes 8-bit RGB texels as PNG.
///
/// # Errors
/// When the file cannot be written.
pub fn write_png_texels(file: &Path, size: [u32; 2], texels: &[[u8; 3]]) -> Result<()> {
    write_whole(file, |temporary| {
        image::save_buffer_with_format(
            temporary,
            bytemuck::cast_slice(texels),
            size[0],
            size[1],
            image::ExtendedColorType::Rgb8,
            image::ImageFormat::Png,
        )
        .map_err(|error| image_error(file, &error))
    })
}

/// Writes the displayed picture as PNG. A picture that was not tone-mapped on the device (for example, one that was averaged on the CPU) is
/// tone-mapped with `exposure` on the CPU ([`crate::display::reference`]).
///
/// # Errors
/// When the file cannot be written.
pub fn write_png(file: &Path, picture: &Picture, exposure: Exposure) -> Result<()> {
    write_png_texels(file, picture.size, &picture.displayed(exposure))
}

fn image_error(file: &Path, error: &dyn std::fmt::Display) -> Error {
    Error::Image { file: PathBuf::from(file), what: error.to_string() }
}

/// Encoding of OpenEXR files: lossless compression in tiles, which are stored row by row. If the order were unspecified, tiles would be stored in
/// the order in which threads finish them, and the same picture could have different bytes in each run.
const ENCODING: e::Encoding = e::Encoding { line_order: e::LineOrder::Increasing, ..e::Encoding::FAST_LOSSLESS };

/// Writes the linear picture and its layers as OpenEXR, in f32. The channels of the picture are R, G, B and A. The channels of a layer are named
/// `layer.channel`, as OpenEXR requires for layers within one part (Technical Introduction to OpenEXR, "Channel names"). The picture must be lit. The
/// same picture gives the same bytes in each run.
///
/// # Errors
/// When the file cannot be written.
pub fn write_exr(file: &Path, picture: &Picture) -> Result<()> {
    let size = (picture.size[0] as usize, picture.size[1] as usize);
    let channel = |name: &str, values: Vec<f32>| e::AnyChannel::new(name, e::FlatSamples::F32(values));
    let mut channels: Vec<_> =
        ["R", "G", "B", "A"].iter().enumerate().map(|(k, name)| channel(name, picture.hdr.iter().map(|t| t[k]).collect())).collect();
    for (name, content) in &picture.layers {
        let mut split = |names: [&str; 3], texels: &[[f32; 3]]| {
            channels.extend((0..3).map(|k| channel(&format!("{name}.{}", names[k]), texels.iter().map(|t| t[k]).collect())));
        };
        match content {
            Layer::Rgb(texels) => split(["R", "G", "B"], texels),
            Layer::Xyz(texels) => split(["X", "Y", "Z"], texels),
            Layer::Value(values) => channels.push(channel(&format!("{name}.V"), values.clone())),
        }
    }
    let layer = e::Layer::new(size, e::LayerAttributes::default(), ENCODING, e::AnyChannels::sort(channels.into()));
    let image = e::Image::from_layer(layer);
    write_whole(file, |temporary| {
        use e::WritableImage as _;
        image.write().to_file(temporary).map_err(|error| image_error(file, &error))
    })
}

//! Reads pictures that are compared: OpenEXR with layers, PNG and JPEG.

use std::fs::File;
use std::io::{BufRead, BufReader, Read as _, Seek};
use std::path::Path;

use exr::prelude as e;
use image::{DynamicImage, ImageDecoder, ImageReader};
use kernels::base::colour::linear_from_srgb;
use kernels::base::error::{Error, Result, one_line};
use kernels::base::names::nearest;
use kernels::frame::MAX_PIXELS;

use super::{area, not_finite};

/// The meaning of a texel's three numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// Linear red, green and blue with the primaries of sRGB.
    Colour,
    /// A vector: X, Y, Z.
    Vector,
    /// One number, repeated three times.
    Value,
}

/// A picture, or one layer of it. Its values are linear, and its rows are ordered from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The texels. All their values are finite.
    pub texels: Vec<[f32; 3]>,
    /// Alpha of the whole picture (channel A). It is read even if `texels` contains a layer.
    pub alpha: Option<Vec<f32>>,
    /// The meaning of a texel's three numbers.
    pub content: Content,
}

/// A channel of an OpenEXR file, with the layer to which it belongs.
struct Channel<'a> {
    /// Name of the layer; empty if the channel belongs to no layer.
    layer: String,
    /// Name of the channel: R, G, B, A, X, Y, Z, V, ...
    name: String,
    part: usize,
    size: [u32; 2],
    samples: &'a e::FlatSamples,
}

impl Image {
    /// Reads a picture. The first bytes of the file determine its format. PNG and JPEG are decoded from sRGB. `layer` selects the layer of an OpenEXR
    /// file: the layer `albedo` has the channels `albedo.R`, `albedo.G`, `albedo.B`. If `layer` is `None`, the channels R, G, B that belong to no
    /// layer are read. If there are none, those of the first part are read. A layer must have the channels R G B, the channels X Y Z, or a single
    /// channel.
    ///
    /// # Errors
    /// The file does not exist or is not a picture, has no such layer (the message names the layers that exist), has more than 2^26 pixels, or
    /// contains values that are NaN or infinite (the message says how many, and where the first one is).
    pub fn read(path: &Path, layer: Option<&str>) -> Result<Image> {
        let wrong = |what: &str| Error::Image { file: path.to_owned(), what: what.to_owned() };
        if path.is_dir() {
            return Err(wrong("is a folder: give a picture"));
        }
        let open = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::NotFound => wrong("there is no such file: correct the path"),
            _ => Error::File { file: path.to_owned(), source: error },
        };
        Image::decode(BufReader::new(File::open(path).map_err(open)?), path, layer)
    }

    /// Like [`Image::read`], but reads the contents of a file from `input`. `path` is the name of the file in error messages.
    ///
    /// # Errors
    /// See [`Image::read`].
    pub fn decode(mut input: impl BufRead + Seek, path: &Path, layer: Option<&str>) -> Result<Image> {
        let wrong = |what: String| Error::Image { file: path.to_owned(), what: one_line(&what) };
        let mut magic = Vec::new();
        let begun = input.by_ref().take(4).read_to_end(&mut magic).and_then(|_| input.rewind());
        begun.map_err(|source| Error::File { file: path.to_owned(), source })?;
        // OpenEXR file layout, "Magic number": 20000630, little-endian.
        let read = if magic == 20_000_630_u32.to_le_bytes() { exr(input, layer) } else { coded(input, layer) };
        let image = read.map_err(wrong)?;
        match not_finite(image.size, &image.texels) {
            Some(what) => Err(wrong(format!("holds {what}: pictures to compare must have finite values"))),
            None => Ok(image),
        }
    }

    /// Returns for each pixel whether it shows only terrain, which means that its alpha is 1 (the sky has alpha 0). `None` if the picture has no
    /// alpha.
    pub fn terrain(&self) -> Option<Vec<bool>> {
        self.alpha.as_ref().map(|alpha| alpha.iter().map(|a| *a >= 1.0).collect())
    }
}

/// Refuses a size that is not supported. It is called before memory for the pixels is allocated.
fn check_size(width: u64, height: u64) -> std::result::Result<[u32; 2], String> {
    let pixels = width.checked_mul(height).filter(|n| (1..=MAX_PIXELS).contains(n));
    match (pixels, u32::try_from(width), u32::try_from(height)) {
        (Some(_), Ok(width), Ok(height)) => Ok([width, height]),
        _ => Err(format!("has {width}x{height} pixels: 1 to {MAX_PIXELS} (2^26) can be compared")),
    }
}

fn coded(input: impl BufRead + Seek, layer: Option<&str>) -> std::result::Result<Image, String> {
    let reader = ImageReader::new(input).with_guessed_format().map_err(|error| format!("cannot be read: {error}"))?;
    if reader.format().is_none() {
        return Err("is not a picture: give an OpenEXR, PNG or JPEG file".to_owned());
    }
    if let Some(layer) = layer {
        return Err(format!("has no layer `{layer}`: only OpenEXR files have layers"));
    }
    let undecodable = |error: image::ImageError| format!("cannot be decoded: {error}; give an OpenEXR, PNG or JPEG file");
    let decoder = reader.into_decoder().map_err(undecodable)?;
    let (width, height) = decoder.dimensions();
    let size = check_size(width.into(), height.into())?;
    let decoded = DynamicImage::from_decoder(decoder).map_err(undecodable)?;
    let has_alpha = decoded.color().has_alpha();
    let texels = decoded.into_rgba32f();
    Ok(Image {
        size,
        texels: texels.pixels().map(|p| [p[0], p[1], p[2]].map(linear_from_srgb)).collect(),
        alpha: has_alpha.then(|| texels.pixels().map(|p| p[3]).collect()),
        content: Content::Colour,
    })
}

fn exr(mut input: impl BufRead + Seek, layer: Option<&str>) -> std::result::Result<Image, String> {
    use e::{ReadChannels as _, ReadLayers as _};
    let undecodable = |error: e::Error| format!("cannot be decoded as OpenEXR: {error}; export it again");
    let meta = exr::meta::MetaData::read_from_buffered(&mut input, false).map_err(undecodable)?;
    for header in &meta.headers {
        check_size(header.layer_size.0 as u64, header.layer_size.1 as u64)?;
    }
    input.rewind().map_err(|error| format!("cannot be read: {error}"))?;
    let reading = e::read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let file = reading.non_parallel().from_buffered(input).map_err(undecodable)?;
    let mut channels = Vec::new();
    for (part, content) in file.layer_data.iter().enumerate() {
        let of_part = content.attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
        let size = check_size(content.size.0 as u64, content.size.1 as u64)?;
        for channel in &content.channel_data.list {
            let full = channel.name.to_string();
            let (prefix, name) = full.rsplit_once('.').unwrap_or(("", &full));
            // The name of the part is added before the name of the layer, unless the name of the layer already begins with it.
            let layer = match (of_part.as_str(), prefix) {
                (part, "") => part.to_owned(),
                ("", prefix) => prefix.to_owned(),
                (part, prefix) if prefix.starts_with(part) => prefix.to_owned(),
                (part, prefix) => format!("{part}.{prefix}"),
            };
            channels.push(Channel { layer, name: name.to_owned(), part, size, samples: &channel.sample_data });
        }
    }
    let unnamed = if channels.iter().any(|c| c.layer.is_empty()) { "" } else { channels.first().map_or("", |c| c.layer.as_str()) };
    let wanted = layer.unwrap_or(unnamed);
    let of_layer = |wanted: &str| channels.iter().filter(|c| c.layer == wanted).collect::<Vec<_>>();
    let chosen = of_layer(wanted);
    if chosen.is_empty() {
        let mut known: Vec<&str> = channels.iter().map(|c| c.layer.as_str()).filter(|name| !name.is_empty()).collect();
        known.dedup();
        let hint = nearest(wanted, &known).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
        let known = if known.is_empty() { "only the picture itself".to_owned() } else { known.join(", ") };
        return Err(format!("has no layer `{wanted}`: there are {known}{hint}"));
    }
    let named = |names: [&str; 3]| names.map(|name| chosen.iter().find(|c| c.name == name).copied());
    let one: Vec<&&Channel<'_>> = chosen.iter().filter(|c| c.name != "A").collect();
    let (content, found) = match (named(["R", "G", "B"]), named(["X", "Y", "Z"]), one.as_slice()) {
        ([Some(r), Some(g), Some(b)], _, _) => (Content::Colour, [r, g, b]),
        (_, [Some(x), Some(y), Some(z)], _) => (Content::Vector, [x, y, z]),
        (_, _, [value]) => (Content::Value, [**value; 3]),
        _ => {
            let names = chosen.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
            let which = if wanted.is_empty() { "the picture itself".to_owned() } else { format!("layer `{wanted}`") };
            return Err(format!("{which} has channels {names}: choose a layer with the channels R G B or X Y Z, or with a single channel"));
        }
    };
    let size = found[0].size;
    let [x, y, z] = found.map(values);
    let (x, y, z) = (x?, y?, z?);
    let alpha = channels.iter().find(|c| c.part == found[0].part && c.name == "A" && c.layer == unnamed).or_else(|| {
        // The layer may have its own part, while the alpha of the picture is in the first part.
        channels.iter().find(|c| c.name == "A" && c.layer == unnamed && c.size == size)
    });
    let texels = x.iter().zip(&y).zip(&z).map(|((x, y), z)| [*x, *y, *z]).collect();
    Ok(Image { size, texels, alpha: alpha.map(values).transpose()?, content })
}

/// Returns the samples of a channel as f32, one for each pixel.
fn values(channel: &Channel<'_>) -> std::result::Result<Vec<f32>, String> {
    let values: Vec<f32> = channel.samples.values_as_f32().collect();
    if values.len() == area(channel.size) {
        Ok(values)
    } else {
        Err(format!("channel {} is subsampled: export it at full resolution", channel.name))
    }
}

#[cfg(test)]
mod tests {
    use e::WritableImage as _;

    use super::*;

    /// A unique file, which is removed when this value is dropped.
    struct Temp(std::path::PathBuf);

    impl Temp {
        fn new(name: &str) -> Temp {
            Temp(std::env::temp_dir().join(format!("scree-judge-{}-{name}", std::process::id())))
        }
    }

    impl Drop for Temp {
        fn drop(&mut self) {
            let _ = std::fs::remove_file(&self.0);
        }
    }

    fn part(name: Option<&str>, channels: &[(&str, [f32; 6])]) -> e::Layer<e::AnyChannels<e::FlatSamples>> {
        let channels = channels.iter().map(|(name, values)| e::AnyChannel::new(*name, e::FlatSamples::F32(values.to_vec())));
        let attributes = e::LayerAttributes { layer_name: name.map(e::Text::from), ..Default::default() };
        e::Layer::new((3, 2), attributes, e::Encoding::UNCOMPRESSED, e::AnyChannels::sort(channels.collect()))
    }

    fn ramp(offset: f32) -> [f32; 6] {
        std::array::from_fn(|i| offset + i as f32)
    }

    #[test]
    fn layers_of_one_part() {
        let file = Temp::new("one.exr");
        let channels = [
            ("R", ramp(0.0)),
            ("G", ramp(10.0)),
            ("B", ramp(20.0)),
            ("A", [0.0, 0.5, 1.0, 1.0, 1.0, 1.0]),
            ("albedo.R", ramp(30.0)),
            ("albedo.G", ramp(40.0)),
            ("albedo.B", ramp(50.0)),
            ("normal.X", ramp(60.0)),
            ("normal.Y", ramp(70.0)),
            ("normal.Z", ramp(80.0)),
            ("depth.V", ramp(90.0)),
            ("odd.R", ramp(0.0)),
            ("odd.Q", ramp(0.0)),
        ];
        e::Image::from_layer(part(None, &channels)).write().to_file(&file.0).unwrap();
        let read = |layer: Option<&str>| Image::read(&file.0, layer);
        let whole = read(None).unwrap();
        assert_eq!((whole.size, whole.content, whole.texels[4]), ([3, 2], Content::Colour, [4.0, 14.0, 24.0]));
        assert_eq!(whole.terrain(), Some(vec![false, false, true, true, true, true]));
        let albedo = read(Some("albedo")).unwrap();
        assert_eq!((albedo.content, albedo.texels[1], albedo.alpha), (Content::Colour, [31.0, 41.0, 51.0], whole.alpha));
        let normal = read(Some("normal")).unwrap();
        assert_eq!((normal.content, normal.texels[5]), (Content::Vector, [65.0, 75.0, 85.0]));
        let depth = read(Some("depth")).unwrap();
        assert_eq!((depth.content, depth.texels[2]), (Content::Value, [92.0; 3]));
        let refused = read(Some("albdo")).unwrap_err().to_string();
        assert!(refused.contains("albedo, depth, normal, odd") && refused.contains("did you mean `albedo`?"), "{refused}");
        let refused = read(Some("odd")).unwrap_err().to_string();
        assert!(refused.contains("has channels Q, R"), "{refused}");
    }

    #[test]
    fn layers_in_parts() {
        let file = Temp::new("parts.exr");
        let colour = |name: Option<&str>, offset: f32| part(name, &[("R", ramp(offset)), ("G", ramp(offset)), ("B", ramp(offset))]);
        let attributes = e::ImageAttributes::new(e::IntegerBounds::new((0, 0), (3, 2)));
        let parts = vec![colour(Some("beauty"), 1.0), colour(Some("albedo"), 2.0)];
        e::Image::from_layers(attributes, parts).write().to_file(&file.0).unwrap();
        let first = |layer: Option<&str>| Image::read(&file.0, layer).unwrap().texels[0];
        assert_eq!((first(None), first(Some("beauty")), first(Some("albedo"))), ([1.0; 3], [1.0; 3], [2.0; 3]));
        assert_eq!(Image::read(&file.0, None).unwrap().terrain(), None);
    }

    #[test]
    fn codes_are_decoded_from_srgb() {
        let file = Temp::new("codes.png");
        let codes = [0, 10, 55, 188, 255, 128].map(|v| image::Rgba([v, v, v, if v == 10 { 0 } else { 255 }]));
        image::RgbaImage::from_fn(3, 2, |x, y| codes[(y * 3 + x) as usize]).save(&file.0).unwrap();
        let read = Image::read(&file.0, None).unwrap();
        // The expected values were computed by hand from IEC 61966-2-1. The encoding is linear up to about 10, so 10 is decoded to 10 / 255 / 12.92.
        // The value 188 is decoded to about half of the largest linear value.
        for (index, expected) in [(0, 0.0), (1, 0.003_035_27), (3, 0.502_886), (4, 1.0)] {
            assert!((read.texels[index][1] - expected).abs() < 1e-6, "{index}: {:?}", read.texels[index]);
        }
        assert_eq!(read.terrain(), Some(vec![true, false, true, true, true, true]));
        assert!(Image::read(&file.0, Some("albedo")).unwrap_err().to_string().contains("only OpenEXR"));
    }

    #[test]
    fn what_is_no_picture_is_refused() {
        let file = Temp::new("broken");
        let refused = |bytes: &[u8], says: &str| {
            std::fs::write(&file.0, bytes).unwrap();
            let text = Image::read(&file.0, None).unwrap_err().to_string();
            assert!(text.contains(says) && text.contains("broken"), "{text}");
        };
        refused(b"", "is not a picture");
        refused(b"P6 words", "cannot be decoded");
        refused(b"plain words", "is not a picture");
        refused(&20_000_630_u32.to_le_bytes(), "cannot be decoded as OpenEXR");
        refused(b"\x89PNG\r\n\x1a\nrest", "cannot be decoded");
        let mut values = ramp(0.0);
        values[4] = f32::NAN;
        let image = e::Image::from_layer(part(None, &[("R", values), ("G", ramp(0.0)), ("B", ramp(0.0))]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        let bytes = bytes.into_inner();
        refused(&bytes, "holds 1 NaN value, first in column 1, row 1");
        for length in [5, 40, bytes.len() / 2, bytes.len() - 1] {
            refused(&bytes[..length], "cannot be decoded as OpenEXR");
        }
        let missing = Image::read(Path::new("nowhere/at-all.exr"), None).unwrap_err().to_string();
        assert!(missing.contains("nowhere/at-all.exr") && missing.contains("no such file"), "{missing}");
    }
}

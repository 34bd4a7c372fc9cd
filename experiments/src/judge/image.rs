//! Reads the pictures to be compared: OpenEXR with layers, PNG and JPEG.

use std::fs::File;
use std::io::{BufRead, BufReader, Read as _, Seek};
use std::path::Path;

use kernels::base::error::{Error, Result, one_line};

use super::picture::Image;
use super::{coded, layers, not_finite};

impl Image {
    /// Reads a picture. The first bytes of the file determine its format.
    ///
    /// PNG and JPEG are decoded from sRGB, or with the exponent and primaries that a PNG states (gAMA, cHRM). They are turned as their EXIF
    /// orientation says.
    ///
    /// The pixels of OpenEXR are placed in the display window. `layer` is the name of a layer. For example, the layer `albedo` has the channels
    /// `albedo.R`, `albedo.G` and `albedo.B`, or the channels R, G and B of the part `albedo`. A layer must have the channels R G B, the channels X Y
    /// Z, or a single channel besides alpha. Colours are converted to the primaries of Rec. 709, which are those of sRGB.
    ///
    /// If `layer` is `None`, the channels R, G and B that belong to no layer are read. If there are none, the only layer that has these channels is
    /// read. If no layer has colours, a vector or a single value is selected by the same two steps.
    ///
    /// # Errors
    /// The file cannot be read, is not a picture, is damaged or of an unsupported kind, has more than 2^26 pixels, stores no pixel of its
    /// display window, states chromaticities that are no colour space, or contains values that are NaN or infinite. It is also an error if
    /// no layer or several layers fit `layer`, or if `layer` is `None` and several layers can be meant.
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
        let read = if magic == 20_000_630_u32.to_le_bytes() { layers::read(input, layer) } else { coded::read(input, layer) };
        let image = read.map_err(wrong)?;
        match not_finite(image.size, &image.texels) {
            Some(what) => Err(wrong(format!("holds {what}: pictures to compare must have finite values"))),
            None => Ok(image),
        }
    }
}

#[cfg(test)]
mod tests {
    use e::WritableImage as _;
    use exr::prelude as e;

    use super::*;
    use crate::judge::picture::Content;

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
        let first = |layer: &str| Image::read(&file.0, Some(layer)).unwrap().texels[0];
        assert_eq!((first("beauty"), first("albedo"), first("ALBEDO")), ([1.0; 3], [2.0; 3], [2.0; 3]));
        // Both parts have names, so neither is the picture itself.
        let refused = Image::read(&file.0, None).unwrap_err().to_string();
        assert!(refused.contains("2 layers that could be compared, beauty, albedo") && refused.contains("--layer"), "{refused}");
        assert_eq!(Image::read(&file.0, Some("albedo")).unwrap().terrain(), None);
    }

    #[test]
    fn the_only_layer_that_can_be_meant_is_read_without_its_name() {
        let file = Temp::new("only.exr");
        let read = |channels: &[(&str, [f32; 6])], layer: Option<&str>| {
            e::Image::from_layer(part(None, channels)).write().to_file(&file.0).unwrap();
            Image::read(&file.0, layer)
        };
        let first = |channels: &[(&str, [f32; 6])]| {
            let image = read(channels, None).unwrap();
            (image.content, image.texels[0], image.origin.layer)
        };
        let colour = |names: [&'static str; 3]| [(names[0], ramp(1.0)), (names[1], ramp(2.0)), (names[2], ramp(3.0))];
        assert_eq!(first(&colour(["r", "g", "b"])), (Content::Colour, [1.0, 2.0, 3.0], None));
        // Colours are preferred, even if a depth channel is the only one that belongs to no layer.
        let beauty = [&colour(["beauty.R", "beauty.G", "beauty.B"])[..], &[("Z", ramp(9.0))]].concat();
        assert_eq!(first(&beauty), (Content::Colour, [1.0, 2.0, 3.0], Some("beauty".to_owned())));
        assert_eq!(first(&[("Y", ramp(4.0)), ("a", ramp(0.0))]), (Content::Value, [4.0; 3], None));
        // If names differ only in case, the exact names are read. A name in a different case is read only if there is no exact one.
        let both = [&colour(["R", "G", "B"])[..], &[("r", ramp(8.0)), ("g", ramp(8.0)), ("b", ramp(8.0))]].concat();
        assert_eq!(first(&both).1, [1.0, 2.0, 3.0]);
        let mixed = [&colour(["x.R", "x.g", "x.b"])[..], &[("x.B", ramp(7.0))]].concat();
        assert_eq!(first(&mixed), (Content::Colour, [1.0, 2.0, 7.0], None));
        let two = [&colour(["a.R", "a.G", "a.B"])[..], &colour(["b.R", "b.G", "b.B"])[..]].concat();
        let refused = read(&two, None).unwrap_err().to_string();
        assert!(refused.contains("2 layers that could be compared, a, b"), "{refused}");
        assert_eq!(read(&two, Some("b")).unwrap().origin.layer, None);
    }

    #[test]
    fn samples_are_laid_into_the_display_window_and_converted() {
        let file = Temp::new("windows.exr");
        let write = |at: (i32, i32), display: e::IntegerBounds, chromaticities: Option<e::attribute::Chromaticities>| {
            let channels = [("A", [1.0; 6]), ("R", ramp(1.0)), ("G", ramp(11.0)), ("B", ramp(21.0))];
            let mut layer = part(None, &channels);
            layer.attributes.layer_position = e::Vec2(at.0, at.1);
            let attributes = e::ImageAttributes { chromaticities, ..e::ImageAttributes::new(display) };
            e::Image::new(attributes, layer).write().to_file(&file.0).unwrap();
            Image::read(&file.0, None)
        };
        let display = e::IntegerBounds::new((-1, 0), (3, 2));
        let moved = write((0, -1), display, None).unwrap();
        // Only the lower row of samples overlaps the display window. It begins in the window's second column, and its last sample is outside.
        let black = [0.0; 3];
        assert_eq!(moved.texels, [black, [4.0, 14.0, 24.0], [5.0, 15.0, 25.0], black, black, black]);
        assert_eq!(moved.terrain(), Some(vec![false, true, true, false, false, false]));
        assert_eq!((moved.size, [0, 1, 3].map(|index| moved.stores(index))), ([3, 2], [false, true, false]));
        let refused = write((3, 0), display, None).unwrap_err().to_string();
        assert!(refused.contains("stores 3 x 2 at (3, 0)") && refused.contains("picture of 3 x 2 at (-1, 0)"), "{refused}");
        // The chromaticities are the primaries of XYZ with the white of Rec. 709. The channel G then contains Y, which is the luminance of
        // Rec. 709.
        let point = |x: f32, y: f32| e::Vec2(x, y);
        let xyz = |white: e::Vec2<f32>| e::attribute::Chromaticities {
            red: point(1.0, 0.0),
            green: point(0.0, 1.0),
            blue: point(0.0, 0.0),
            white,
        };
        let converted = write((-1, 0), display, Some(xyz(point(0.3127, 0.329)))).unwrap();
        let stated = converted.origin.converted_from.unwrap();
        assert_eq!((stated.red, stated.white), ([1.0, 0.0], [0.3127, 0.329]));
        for (texel, green) in converted.texels.iter().zip(ramp(11.0)) {
            let luminance = kernels::base::colour::luminance(texel.map(f64::from));
            // The weights in `luminance` have only four digits, so the tolerance is 1e-3.
            assert!((luminance - f64::from(green)).abs() < 1e-3 * f64::from(green), "{texel:?}: {luminance} is not {green}");
        }
        let refused = write((-1, 0), display, Some(xyz(point(0.3127, 0.0)))).unwrap_err().to_string();
        assert!(refused.contains("chromaticities that are no colour space"), "{refused}");
    }

    #[test]
    fn codes_are_decoded_from_srgb() {
        let file = Temp::new("codes.png");
        let codes = [0, 10, 55, 188, 255, 128].map(|v| image::Rgba([v, v, v, if v == 10 { 0 } else { 255 }]));
        image::RgbaImage::from_fn(3, 2, |x, y| codes[(y * 3 + x) as usize]).save(&file.0).unwrap();
        let read = Image::read(&file.0, None).unwrap();
        // The expected values were computed by hand from IEC 61966-2-1. The encoding is linear for codes up to about 10, so 10 is decoded to
        // 10 / 255 / 12.92.
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
        refused(b"P6 words", "Pnm files cannot be read");
        refused(b"plain words", "is not a picture");
        refused(&20_000_630_u32.to_le_bytes(), "OpenEXR");
        refused(b"\x89PNG\r\n\x1a\nrest", "cannot be decoded");
        let mut values = ramp(0.0);
        values[4] = f32::NAN;
        let image = e::Image::from_layer(part(None, &[("R", values), ("G", ramp(0.0)), ("B", ramp(0.0))]));
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write().to_buffered(&mut bytes).unwrap();
        let bytes = bytes.into_inner();
        refused(&bytes, "holds 1 NaN value, first in column 1, row 1");
        for length in [5, 40, bytes.len() / 2, bytes.len() - 1] {
            refused(&bytes[..length], "OpenEXR");
        }
        let missing = Image::read(Path::new("nowhere/at-all.exr"), None).unwrap_err().to_string();
        assert!(missing.contains("nowhere/at-all.exr") && missing.contains("no such file"), "{missing}");
    }
}

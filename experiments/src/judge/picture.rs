//! A picture that is compared, and what its file says about it.

use kernels::decode::openexr::Chromaticities;

use super::windows::Windows;

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
    /// Width and height, pixels: those of the display window of an OpenEXR file.
    pub size: [u32; 2],
    /// The texels. All their values are finite. Pixels that an OpenEXR file does not store are 0.
    pub texels: Vec<[f32; 3]>,
    /// Alpha of the whole picture (channel A). It is read even if `texels` contains a layer. Not checked: it may be NaN.
    pub alpha: Option<Vec<f32>>,
    /// The meaning of a texel's three numbers.
    pub content: Content,
    /// What the file says about the texels.
    pub origin: Origin,
}

impl Image {
    /// Returns for each pixel whether it shows only terrain, which means that its alpha is 1 (the sky has alpha 0). `None` if the picture has no
    /// alpha.
    pub fn terrain(&self) -> Option<Vec<bool>> {
        self.alpha.as_ref().map(|alpha| alpha.iter().map(|a| *a >= 1.0).collect())
    }

    /// Whether the file stores the pixel with this index, row by row. OpenEXR files may store a part of the picture.
    pub fn stores(&self, index: usize) -> bool {
        self.origin.windows.is_none_or(|windows| windows.stores(index))
    }
}

/// What a file says about a picture, as far as a comparison may depend on it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Origin {
    /// Name of the layer that was read although no layer was asked for.
    pub layer: Option<String>,
    /// The windows of an OpenEXR file.
    pub windows: Option<Windows>,
    /// The primaries and the white from which the colours were converted to Rec. 709.
    pub converted_from: Option<Chromaticities>,
    /// The exponent of the encoding, by which the colours were decoded instead of sRGB (PNG gAMA): sample = light^gamma.
    pub gamma: Option<f64>,
    /// What else the file says about its colours, and what was not applied: an ICC profile, code points (PNG cICP).
    pub ignored: Option<String>,
    /// How the picture was turned because of its EXIF orientation.
    pub turned: Option<&'static str>,
    /// Bits of the integers that the file stores; `None` = floats.
    pub bits: Option<u8>,
    /// The compression, if it changes samples.
    pub lossy: Option<&'static str>,
    /// Whether colours are multiplied by alpha, as OpenEXR requires and PNG forbids.
    pub multiplied_by_alpha: bool,
    /// Width of a pixel divided by its height, if it is not 1.
    pub pixel_aspect: Option<f32>,
}

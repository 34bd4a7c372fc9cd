//! A picture to be compared, and the facts about it that its file states.

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

/// A picture, or one layer of it. Colours are linear, and rows are ordered from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    /// Width and height, pixels. For an OpenEXR file, this is the size of the display window.
    pub size: [u32; 2],
    /// The texels. All their values are finite. Pixels that an OpenEXR file does not store are 0.
    pub texels: Vec<[f32; 3]>,
    /// Alpha (channel A) of the picture itself or, if it has none for the same pixels, of the layer in `texels`. It is not checked, so it may be NaN.
    pub alpha: Option<Vec<f32>>,
    /// The meaning of a texel's three numbers.
    pub content: Content,
    /// Facts about the texels that the file states.
    pub origin: Origin,
}

impl Image {
    /// Returns for each pixel whether it shows only terrain: its alpha is at least 1 (the sky has alpha 0). `None` if the picture has no alpha.
    pub fn terrain(&self) -> Option<Vec<bool>> {
        self.alpha.as_ref().map(|alpha| alpha.iter().map(|a| *a >= 1.0).collect())
    }

    /// Whether the file stores the pixel with this index. Indices count pixels row by row. An OpenEXR file may store only a part of its picture.
    pub fn stores(&self, index: usize) -> bool {
        self.origin.windows.is_none_or(|windows| windows.stores(index))
    }
}

/// Facts about a picture that its file states, and that can affect a comparison.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Origin {
    /// Name of the layer that was read, if the caller named none and the file has several layers. `None` also if the layer has no name.
    pub layer: Option<String>,
    /// The windows of an OpenEXR file.
    pub windows: Option<Windows>,
    /// The primaries and the white from which the colours were converted to Rec. 709.
    pub converted_from: Option<Chromaticities>,
    /// The exponent of the encoding that a PNG states (gAMA): sample = light^gamma. The colours were decoded with it. `None` = they
    /// were decoded from sRGB, or the file stores linear values.
    pub gamma: Option<f64>,
    /// Name of the colour information in the file that was not applied: an ICC profile, or code points (PNG cICP).
    pub ignored: Option<String>,
    /// How the picture was turned because of its EXIF orientation.
    pub turned: Option<&'static str>,
    /// Bits of the decoded integers (8 also stands for fewer bits in the file); `None` = floats, or OpenEXR channels of several types.
    pub bits: Option<u8>,
    /// The compression, if it changes samples.
    pub lossy: Option<&'static str>,
    /// Whether colours are multiplied by alpha, as OpenEXR requires and PNG forbids.
    pub multiplied_by_alpha: bool,
    /// Width of a pixel divided by its height; `None` = about 1, or not stated.
    pub pixel_aspect: Option<f32>,
}

//! Options for reading a heightmap: what the user states about the file, and how it is treated.

use std::path::Path;

use crate::decode::fault::Fault;

/// Largest number of samples that are read along each edge. From a larger TIFF or RAW file, the caller must choose a window. A larger PNG or OpenEXR
/// file is refused, because these readers decode the whole file.
pub const MAX_SIDE: u32 = 16_385;

/// Largest distance between samples, metres. Scene files have the same limit.
pub(super) const MAX_SPACING_M: f64 = 1.0e5;

/// How to read a heightmap. Most messages call the options by their names in `experiments import`, such as `--raw-size`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ReadOptions {
    /// Distance between neighbouring samples, metres, above 0 and at most 100 000. Not needed if the file states a distance with a unit. A value
    /// that contradicts such a distance is an error.
    pub metres_per_texel: Option<f64>,
    /// Elevations, in metres, of the smallest and the largest possible integer sample (with 16 bits: 0 and 65535, or -32768 and 32767 if the samples
    /// are signed), or of the float samples 0 and 1.
    ///
    /// If the file states what its samples mean, a range that contradicts the file is an error. If the file states nothing, 16-bit integers need a
    /// range, and 32-bit integers are refused. Floats are then metres unless a range is given; a range is an error if a float lies outside 0..=1.
    pub height_range_m: Option<[f64; 2]>,
    /// Width and height of a RAW file, in samples. `None`: the image must be a square.
    pub raw_size: Option<[u32; 2]>,
    /// Whether the samples of a RAW file begin with their highest byte.
    pub raw_big_endian: bool,
    /// The part to read: x, y (from the north-west corner), width, height in samples. `None`: the whole file.
    pub window: Option<[u32; 4]>,
    /// Name of the channel of an OpenEXR file that holds the heights, with or without part and layer: `part.layer.channel`.
    pub channel: Option<String>,
    /// The values that mark missing data.
    pub no_data: NoData,
    /// The treatment of samples without data.
    pub voids: Voids,
}

/// The values that mark missing data. Values are compared with samples as they are stored, before the samples are converted to metres.
///
/// With each variant, these samples have no data: NaN, infinity, absolute values from 1e10 on, and samples that a mask hides. If a TIFF file names a
/// no-data value, the samples of strips or tiles that are not in the file have no data either.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum NoData {
    /// The value that the file names, and transparency. Other values that usually mark missing data, such as -9999, are refused if they lie far from
    /// all other samples; the user must then name or allow them. PNG and RAW files of integers are not searched for such values.
    #[default]
    Stated,
    /// The same as with `Stated`, and these values.
    Named(Vec<f64>),
    /// No further values. The value that the file names and transparency are ignored.
    Nothing,
}

/// The treatment of samples without data.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Voids {
    /// The file is refused.
    #[default]
    Refuse,
    /// Samples without data get the heights of a smooth membrane that is stretched over the gap. Apart from small errors, the membrane stays between
    /// the lowest and the highest sample of the rim of the gap.
    Fill,
    /// Samples without data are filled as with `Fill`, and become circular holes in the ground of the scene.
    Holes,
}

/// A format of heightmap files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Png,
    /// 16-bit integers without a header.
    Raw,
    /// 32-bit floats without a header.
    RawFloat,
    OpenExr,
    Tiff,
}

impl Format {
    /// The format that belongs to the extension of a file.
    pub(super) fn of(path: &Path) -> Result<Format, Fault> {
        match path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default().as_str() {
            "png" => Ok(Format::Png),
            "raw" | "r16" | "bin" => Ok(Format::Raw),
            "r32" => Ok(Format::RawFloat),
            "exr" => Ok(Format::OpenExr),
            "tif" | "tiff" => Ok(Format::Tiff),
            _ => Err(Fault::Unsupported("the extension is unknown; use .png, .raw, .r16, .bin, .r32, .exr, .tif or .tiff".to_owned())),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Format::Png => "PNG",
            Format::Raw | Format::RawFloat => "RAW",
            Format::OpenExr => "OpenEXR",
            Format::Tiff => "TIFF",
        }
    }
}

impl ReadOptions {
    /// Checks the options that can be checked without samples.
    pub(super) fn check(&self, format: Format) -> Result<(), Fault> {
        let refuse = |what: String| Err(Fault::Unsupported(what));
        if let Some(spacing) = self.metres_per_texel
            && !(spacing > 0.0 && spacing <= MAX_SPACING_M)
        {
            return refuse(format!("metres per texel is {spacing}; it must be a number above 0 and at most {MAX_SPACING_M}"));
        }
        if let Some([low, high]) = self.height_range_m
            && !(low.is_finite() && high.is_finite() && low < high)
        {
            return refuse(format!("the height range {low}..{high} m is empty; give the lower elevation first"));
        }
        let name = format.name();
        let is_raw = matches!(format, Format::Raw | Format::RawFloat);
        if self.raw_size.is_some() && !is_raw {
            return refuse(format!("--raw-size does not apply: a {name} file states its size; leave the option out"));
        }
        if self.raw_big_endian && !is_raw {
            return refuse(format!("--raw-big-endian does not apply: a {name} file states its byte order; leave the option out"));
        }
        if self.channel.is_some() && format != Format::OpenExr {
            return refuse(format!("--channel does not apply: a {name} file has no named channels; leave the option out"));
        }
        Ok(())
    }

    /// The window to read from an image of this size, as x, y, width, height. `can_read_part`: whether the reader of the format can read a part of a
    /// file.
    pub(super) fn window_of(&self, [width, height]: [u32; 2], can_read_part: bool) -> Result<[u32; 4], Fault> {
        let too_large = width > MAX_SIDE || height > MAX_SIDE;
        if too_large && !can_read_part {
            return Err(Fault::TooLarge(format!(
                "{width} x {height} samples are too many: files of this format are read completely (limit: {MAX_SIDE} per side); \
                 convert the file to .tif or .raw and give a window"
            )));
        }
        let window = match self.window {
            None if too_large => {
                return Err(Fault::TooLarge(format!(
                    "{width} x {height} samples do not fit in a world (limit: {MAX_SIDE} per side); give a window (x, y, width, height)"
                )));
            }
            None => [0, 0, width, height],
            Some([x, y, w, h]) => {
                let fits = |start: u32, length: u32, all: u32| start.checked_add(length).is_some_and(|end| end <= all);
                if !fits(x, w, width) || !fits(y, h, height) {
                    return Err(Fault::Unsupported(format!(
                        "the window {w} x {h} at {x}, {y} is not inside the file's {width} x {height} samples; move or shrink it"
                    )));
                }
                if w > MAX_SIDE || h > MAX_SIDE {
                    return Err(Fault::TooLarge(format!("a window of {w} x {h} samples exceeds {MAX_SIDE} per side; shrink it")));
                }
                [x, y, w, h]
            }
        };
        let [_, _, w, h] = window;
        if w < 2 || h < 2 {
            return Err(Fault::Unsupported(format!("{w} x {h} samples are too few; at least 2 x 2 are needed")));
        }
        Ok(window)
    }
}

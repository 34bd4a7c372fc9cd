//! The result of the reader of a format: samples as they are stored, and what the file says about them.

use tiff::decoder::DecodingResult;

use super::depth::Depth;
use super::scaling::Statement;
use super::spacing::Spacing;

/// The part of a file that is read, and the statements of the file.
pub(super) struct Raster {
    /// Format, kind of samples and layout, in words.
    pub(super) format: String,
    /// Width and height of the file, in samples.
    pub(super) file_size: [u32; 2],
    /// The part that is read: x, y (from the north-west corner), width, height.
    pub(super) window: [u32; 4],
    /// How a sample is stored.
    pub(super) depth: Depth,
    /// Whether integers are codes that cover the range from the lowest to the highest elevation, as in PNG and RAW, rather than numbers in
    /// some unit, as in TIFF. Codes are not searched for values that usually mark missing data.
    pub(super) holds_codes: bool,
    /// The samples, row by row, row 0 = north.
    pub(super) stored: Stored,
    /// For each sample, the reason why it has no data; `None` if it has data or only its value marks missing data. An empty list
    /// means that all entries are `None`.
    pub(super) absent: Vec<Option<Absent>>,
    /// The value that the file states for samples without data.
    pub(super) no_data: Option<f64>,
    /// The statement of the file about its heights.
    pub(super) statement: Statement,
    /// The statement of the file about the distance between samples.
    pub(super) spacing: Spacing,
    /// Where north is in the file, in words.
    pub(super) orientation: &'static str,
    /// Notes for the user, one line each.
    pub(super) notes: Vec<String>,
}

impl Raster {
    /// Column and row of a sample of the window, in words. They are counted in the whole file from the north-west corner.
    pub(super) fn place(&self, index: usize) -> String {
        let [x, y, width, _] = self.window.map(|n| n as usize);
        format!("column {}, row {}", x + index % width, y + index / width)
    }
}

/// The reason why a sample has no data, apart from its value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Absent {
    /// The strip or tile of the sample is not in the file.
    Missing,
    /// The mask of the file hides the sample.
    Masked,
    /// The pixel of the sample is transparent.
    Transparent,
}

/// Samples as they are stored: as f32 if it holds the type of the samples exactly, otherwise as f64.
pub(super) enum Stored {
    Single(Vec<f32>),
    Double(Vec<f64>),
}

impl Stored {
    /// `count` zeros, in the type for this depth.
    pub(super) fn zeros(depth: Depth, count: usize) -> Stored {
        if depth.fits_single() { Stored::Single(vec![0.0; count]) } else { Stored::Double(vec![0.0; count]) }
    }

    pub(super) fn len(&self) -> usize {
        match self {
            Stored::Single(samples) => samples.len(),
            Stored::Double(samples) => samples.len(),
        }
    }

    /// The sample at an index below [`Stored::len`].
    pub(super) fn at(&self, index: usize) -> f64 {
        match self {
            Stored::Single(samples) => f64::from(samples[index]),
            Stored::Double(samples) => samples[index],
        }
    }

    /// The value of a sample as text, with the digits that the type of the samples needs.
    pub(super) fn shown(&self, value: f64) -> String {
        // Large numbers are written with an exponent, which is easier to read than many digits.
        match self {
            Stored::Single(_) if value.abs() >= 1e12 => format!("{:e}", value as f32),
            Stored::Single(_) => (value as f32).to_string(),
            Stored::Double(_) if value.abs() >= 1e12 => format!("{value:e}"),
            Stored::Double(_) => value.to_string(),
        }
    }

    /// Whether a sample equals a value that was written as text. The two are compared in the type of the sample. Texts of huge numbers are
    /// often shortened, for example to -3.40282e+38, so absolute values from 1e30 on may differ by a relative 1e-5.
    pub(super) fn is(&self, sample: f64, value: f64) -> bool {
        let is_equal = match self {
            Stored::Single(_) => sample as f32 == value as f32,
            Stored::Double(_) => sample == value,
        };
        is_equal || (value.is_finite() && value.abs() >= 1e30 && (sample - value).abs() <= 1e-5 * value.abs())
    }

    /// Copies `count` decoded samples, from index `from`, to index `to`. Returns false, and copies nothing, if the types do not fit, or if one of the
    /// two lists has fewer than `count` samples from its index on.
    pub(super) fn put(&mut self, to: usize, decoded: &DecodingResult, from: usize, count: usize) -> bool {
        use DecodingResult as D;
        match (self, decoded) {
            (Stored::Single(samples), D::U16(values)) => copy(samples, to, values, from, count, f32::from),
            (Stored::Single(samples), D::I16(values)) => copy(samples, to, values, from, count, f32::from),
            (Stored::Single(samples), D::F16(values)) => copy(samples, to, values, from, count, |value| value.to_f32()),
            (Stored::Single(samples), D::F32(values)) => copy(samples, to, values, from, count, |value| value),
            (Stored::Double(samples), D::U32(values)) => copy(samples, to, values, from, count, f64::from),
            (Stored::Double(samples), D::I32(values)) => copy(samples, to, values, from, count, f64::from),
            (Stored::Double(samples), D::F64(values)) => copy(samples, to, values, from, count, |value| value),
            _ => false,
        }
    }

    /// Each sample times `scale`, plus `offset`.
    pub(super) fn scaled(self, scale: f64, offset: f64) -> Vec<f32> {
        match self {
            Stored::Single(mut samples) => {
                for sample in &mut samples {
                    *sample = (scale * f64::from(*sample) + offset) as f32;
                }
                samples
            }
            Stored::Double(samples) => samples.into_iter().map(|sample| (scale * sample + offset) as f32).collect(),
        }
    }
}

fn copy<T: Copy, S>(samples: &mut [S], to: usize, values: &[T], from: usize, count: usize, convert: impl Fn(T) -> S) -> bool {
    let (Some(target), Some(source)) = (samples.get_mut(to..to + count), values.get(from..from + count)) else { return false };
    for (sample, &value) in target.iter_mut().zip(source) {
        *sample = convert(value);
    }
    true
}

/// Reverses the order of the rows of an image if `rows` is true, and the order of the samples in each row if `columns` is true.
pub(super) fn turn<T>(samples: &mut [T], width: usize, rows: bool, columns: bool) {
    if columns {
        samples.chunks_exact_mut(width).for_each(<[T]>::reverse);
    }
    if rows {
        let height = samples.len() / width;
        for row in 0..height / 2 {
            let (above, below) = samples.split_at_mut((height - 1 - row) * width);
            above[row * width..(row + 1) * width].swap_with_slice(&mut below[..width]);
        }
    }
}

/// Cuts a window (x, y, width, height) out of an image. `width` is the number of columns of the image.
pub(super) fn crop<T: Copy>(samples: Vec<T>, width: u32, [x, y, w, h]: [u32; 4]) -> Vec<T> {
    let (width, x, y, w, h) = (width as usize, x as usize, y as usize, w as usize, h as usize);
    if w == width && y == 0 && samples.len() == w * h {
        return samples;
    }
    (y..y + h).flat_map(|row| samples[row * width + x..][..w].iter().copied()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_and_columns_are_reversed() {
        let turned = |rows, columns| {
            let mut samples = [1, 2, 3, 4, 5, 6, 7, 8, 9];
            turn(&mut samples, 3, rows, columns);
            samples
        };
        assert_eq!(turned(false, false), [1, 2, 3, 4, 5, 6, 7, 8, 9]);
        assert_eq!(turned(true, false), [7, 8, 9, 4, 5, 6, 1, 2, 3]);
        assert_eq!(turned(false, true), [3, 2, 1, 6, 5, 4, 9, 8, 7]);
        assert_eq!(turned(true, true), [9, 8, 7, 6, 5, 4, 3, 2, 1]);
    }

    #[test]
    fn values_of_texts_are_compared_in_the_type_of_the_sample() {
        let (single, double) = (Stored::zeros(Depth::Single, 1), Stored::zeros(Depth::Double, 1));
        let lowest = f64::from(f32::MIN);
        assert!(single.is(lowest, -3.402_823_466_385_29e38) && single.is(lowest, -3.402_82e38) && !single.is(lowest, 3.402_82e38));
        assert!(single.is(f64::from(-9999.9f32), -9999.9) && !double.is(f64::from(-9999.9f32), -9999.9));
        assert!(!single.is(-9998.0, -9999.0) && !single.is(f64::NAN, f64::NAN), "NaN is found otherwise");
        assert_eq!([single.shown(lowest), single.shown(-9999.0), double.shown(1e20)], ["-3.4028235e38", "-9999", "1e20"]);
    }
}

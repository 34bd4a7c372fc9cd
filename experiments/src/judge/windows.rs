//! The two windows of an OpenEXR file. They determine which pixels of the picture the file stores.
//!
//! Technical Introduction to OpenEXR, "Display window, data window": the display window is the picture that a viewer shows, and the data
//! window is the rectangle for which there are pixels. Each window may lie anywhere relative to the other. A viewer shows black where the
//! file stores no pixel of the picture.

use kernels::decode::openexr::Window;

/// The windows of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Windows {
    /// Pixels that are stored.
    pub data: Window,
    /// Pixels that a viewer shows. They are the picture.
    pub display: Window,
}

/// A range of columns or rows of the picture, counted from 0: the first one, and the one after the last.
type Range = [u32; 2];

impl Windows {
    /// Returns the columns and rows of the picture that are stored; `None` if no pixel of the picture is stored.
    fn stored(&self) -> Option<[Range; 2]> {
        let along = |axis: usize| {
            let [data, display] = [&self.data, &self.display];
            let begin = i64::from(data.position[axis]) - i64::from(display.position[axis]);
            let inside = |at: i64| at.clamp(0, i64::from(display.size[axis]));
            let [first, last] = [inside(begin), inside(begin + i64::from(data.size[axis]))];
            // After the clamp, both numbers lie in 0..=u32::MAX, so the conversion cannot fail.
            (first < last).then(|| [first, last].map(|at| u32::try_from(at).unwrap_or(u32::MAX)))
        };
        Some([along(0)?, along(1)?])
    }

    /// Returns the number of pixels of the picture that are stored.
    fn stored_pixels(&self) -> u64 {
        self.stored().map_or(0, |ranges| ranges.iter().map(|[first, last]| u64::from(last - first)).product())
    }

    /// Returns the number of pixels of the picture that are not stored.
    pub fn missing(&self) -> u64 {
        area(self.display) - self.stored_pixels()
    }

    /// Returns the number of stored pixels that lie outside the picture.
    pub fn left_out(&self) -> u64 {
        area(self.data) - self.stored_pixels()
    }

    /// Whether the pixel of the picture with this index is stored. Indices count pixels row by row.
    pub fn stores(&self, index: usize) -> bool {
        let width = self.display.size[0].max(1) as usize;
        let inside = |[first, last]: Range, at: usize| (first as usize..last as usize).contains(&at);
        self.stored().is_some_and(|[columns, rows]| inside(columns, index % width) && inside(rows, index / width))
    }

    /// Copies the samples of the data window to their places in the picture, and returns the picture row by row. All other pixels are 0.
    /// `None` if no pixel of the picture is stored, or if the number of samples is not that of the data window.
    pub(super) fn lay(&self, samples: &[f32]) -> Option<Vec<f32>> {
        let [columns, rows] = self.stored()?;
        if samples.len() as u64 != area(self.data) {
            return None;
        }
        if self.data == self.display {
            return Some(samples.to_vec());
        }
        let [width, height] = self.display.size.map(|n| n as usize);
        let mut picture = vec![0.0; width.checked_mul(height)?];
        // Returns the index of the picture's first column or row, counted from the first column or row of the data window. It may be
        // negative.
        let offset = |axis: usize| i64::from(self.display.position[axis]) - i64::from(self.data.position[axis]);
        let from_column = usize::try_from(i64::from(columns[0]) + offset(0)).ok()?;
        let length = (columns[1] - columns[0]) as usize;
        for row in rows[0]..rows[1] {
            let from_row = usize::try_from(i64::from(row) + offset(1)).ok()?;
            let from = from_row * self.data.size[0] as usize + from_column;
            let to = row as usize * width + columns[0] as usize;
            picture.get_mut(to..to + length)?.copy_from_slice(samples.get(from..from + length)?);
        }
        Some(picture)
    }
}

fn area(window: Window) -> u64 {
    u64::from(window.size[0]) * u64::from(window.size[1])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn windows(data: ([i32; 2], [u32; 2]), display: ([i32; 2], [u32; 2])) -> Windows {
        let window = |(position, size)| Window { position, size };
        Windows { data: window(data), display: window(display) }
    }

    #[test]
    fn samples_are_laid_where_they_belong() {
        let samples: Vec<f32> = (1..=6).map(|n| n as f32).collect();
        for (data, display, picture, stored) in [
            // The data window is the picture.
            (([5, -7], [3, 2]), ([5, -7], [3, 2]), vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0], 6),
            // The data window lies inside the picture, one column from the left and one row from the top.
            (([1, 1], [3, 2]), ([0, 0], [4, 3]), vec![0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0, 0.0, 4.0, 5.0, 6.0], 6),
            // The data window extends beyond the left and the lower edge of the picture.
            (([-1, 0], [3, 2]), ([0, -1], [3, 2]), vec![0.0, 0.0, 0.0, 2.0, 3.0, 0.0], 2),
            // The picture is a part of the data window.
            (([-1, -1], [3, 2]), ([0, 0], [1, 1]), vec![5.0], 1),
        ] {
            let windows = windows(data, display);
            assert_eq!(windows.lay(&samples).as_ref(), Some(&picture), "{windows:?}");
            assert_eq!([windows.missing(), windows.left_out()], [picture.len() as u64 - stored, 6 - stored], "{windows:?}");
            // No sample is 0, so the pixels that are 0 are those that are not stored.
            let stores: Vec<bool> = (0..picture.len()).map(|index| windows.stores(index)).collect();
            assert_eq!(stores, picture.iter().map(|v| *v > 0.0).collect::<Vec<_>>(), "{windows:?}");
        }
    }

    #[test]
    fn windows_far_apart_have_nothing_in_common() {
        for (data, display) in [
            (([3, 0], [3, 2]), ([0, 0], [3, 2])),
            (([0, -2], [3, 2]), ([0, 0], [3, 2])),
            (([i32::MIN, i32::MIN], [3, 2]), ([i32::MAX, i32::MAX], [3, 2])),
            (([i32::MAX, i32::MAX], [3, 2]), ([i32::MIN, i32::MIN], [3, 2])),
        ] {
            let windows = windows(data, display);
            assert_eq!(windows.lay(&[1.0; 6]), None);
            assert!(windows.missing() == 6 && windows.left_out() == 6 && (0..6).all(|index| !windows.stores(index)), "{windows:?}");
        }
        let whole = windows(([0, 0], [3, 2]), ([0, 0], [3, 2]));
        assert_eq!(whole.lay(&[1.0; 5]), None, "samples are missing");
    }
}

//! The CPU reference of occlusion culling: the depth pyramid, and the test whether it hides a box.

use crate::shared::culling::{Cover, hidden, level, level_size};

/// Difference between two levels of the pyramid: the level at which a box lies in at most 2 x 2 texels, and the finer level that the test reads. The
/// test never reads a level below 1. In WGSL: `OCCLUSION_FINER`.
const FINER: u32 = 2;

/// The levels of a depth pyramid from level 1 up, each row by row.
pub struct Levels {
    size: [u32; 2],
    levels: Vec<Vec<f32>>,
}

impl Levels {
    /// Makes `count` levels. `depth`: the reversed depths of the pixels, row by row. `size`: size of the picture, pixels.
    pub fn of(depth: &[f32], size: [u32; 2], count: u32) -> Levels {
        let mut levels: Vec<Vec<f32>> = Vec::new();
        for made in 1..=count {
            let below = levels.last().map_or(depth, Vec::as_slice);
            let ([columns, rows], [width, height]) = (level_size(size, made - 1), level_size(size, made));
            // Texels outside the level below are left out.
            let least = |x: u32, y: u32| {
                let along = |at: u32, end: u32| 2 * at..(2 * at + 2).min(end);
                let texels = along(y, rows).flat_map(|row| along(x, columns).map(move |column| row * columns + column));
                texels.map(|at| below[at as usize]).fold(1.0, f32::min)
            };
            levels.push((0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| least(x, y)).collect());
        }
        Levels { size, levels }
    }

    /// All levels in one list, as the shader stores them.
    pub fn concat(&self) -> Vec<f32> {
        self.levels.concat()
    }

    /// Whether a box is hidden: everything that was drawn in the tested texels, which contain the pixels of the box, must be nearer than the box.
    /// `cover`: the pixels that the box covers, and the depth of its nearest point; `None` = not known, then the result is false.
    ///
    /// # Panics
    /// If the pyramid has too few levels for the box.
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "the pixels of a cover are whole numbers within the picture"
    )]
    pub fn hides(&self, cover: Option<Cover<f64>>) -> bool {
        let Some(Cover { first, last, depth }) = cover else { return false };
        let [first, last] = [first, last].map(|pixel| pixel.map(|x| x as u32));
        let tested = level(first, last).saturating_sub(FINER).max(1);
        let width = level_size(self.size, tested)[0];
        let texels = &self.levels[tested as usize - 1];
        (first[1] >> tested..=last[1] >> tested)
            .all(|y| (first[0] >> tested..=last[0] >> tested).all(|x| hidden(depth, [f64::from(texels[(y * width + x) as usize]); 4])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::hash::pcg4d;

    #[test]
    fn texels_hold_the_least_depth_below_them() {
        let depth: Vec<f32> = [0.5, 0.25, 0.75, 0.875, 0.125, 0.5, 0.5, 0.0, 1.0, 0.625, 0.375, 0.875, 0.5, 0.75, 0.5].to_vec();
        let levels = Levels::of(&depth, [5, 3], 3);
        assert_eq!(levels.levels, [vec![0.25, 0.0, 0.125, 0.375, 0.5, 0.5], vec![0.0, 0.125], vec![0.0]]);
        assert_eq!(levels.concat().len(), 9);
        assert_eq!(Levels::of(&[0.5], [1, 1], 2).concat(), [0.5, 0.5]);
    }

    #[test]
    fn a_box_is_hidden_if_all_texels_around_its_pixels_are_nearer() {
        let size = [61, 43];
        let (mut hidden, mut shown) = (0, 0);
        for case in 0..3000u32 {
            let random = |what: u32, end: u32| pcg4d([case, what, 5, 1])[0] % end;
            // Everything is near, except one pixel.
            let far = random(0, size[0] * size[1]);
            let mut depth = vec![0.5f32; (size[0] * size[1]) as usize];
            depth[far as usize] = 0.125;
            let levels = Levels::of(&depth, size, 6);
            let corner = [random(1, size[0]), random(2, size[1])];
            let extent = [random(3, 1 << (case % 7)), random(4, 1 << (case % 7))];
            let last = [0, 1].map(|k| (corner[k] + extent[k]).min(size[k] - 1));
            let cover = Cover { first: corner.map(f64::from), last: last.map(f64::from), depth: 0.25 };
            // A far pixel outside the box must not keep the box visible if it lies farther away than one texel of the tested level. Such a texel has
            // at most half the size of the box, or 2 x 2 pixels, so it extends at most `margin` pixels beyond the box.
            let (x, y) = (far % size[0], far / size[0]);
            let margin = (extent[0].max(extent[1]) / 2).max(1);
            let is_inside = |margin: u32| {
                (corner[0]..=last[0]).any(|column| column.abs_diff(x) <= margin)
                    && (corner[1]..=last[1]).any(|row| row.abs_diff(y) <= margin)
            };
            let is_hidden = levels.hides(Some(cover));
            assert!(!is_hidden || !is_inside(0), "case {case}: the far pixel is in the box");
            assert!(is_hidden || is_inside(margin), "case {case}: the far pixel is more than {margin} pixels outside the box");
            (hidden, shown) = (hidden + usize::from(is_hidden), shown + usize::from(!is_hidden));
            assert!(!levels.hides(Some(Cover { depth: 0.5, ..cover })), "case {case}: a box at the depth of what was drawn is not hidden");
        }
        assert!(hidden > 300 && shown > 100, "{hidden} {shown}");
        assert!(!Levels::of(&[0.5], [1, 1], 1).hides(None));
    }
}

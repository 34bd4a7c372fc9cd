//! Perceived noise: a model of how visible an error is to an eye that follows the surface.
//!
//! In time, the eye is modelled by an exponential mean of the error along the motion of the surface (smooth pursuit), with a time constant of
//! [`TIME_CONSTANT_S`]. `measure.wgsl` computes this mean m in each frame: `m = (1 - a) m_before + a e`, where e is the error in the frame and a is
//! [`Viewing::adaptation`] (larger in the first frames of a surface point, see `measure_remember`). In space, the eye is modelled by the difference
//! of two Gaussians, so that an error that is the same everywhere does not count. Perceived noise is the root mean square of the result.
//!
//! Tests check these closed forms:
//!
//! - An error that is fixed to the surface is only filtered in space, because its mean over time is the error itself.
//! - If errors are independent from frame to frame, the temporal mean multiplies their root mean square by sqrt(a / (2 - a)), after many frames.
//! - If errors are independent from pixel to pixel, the spatial filter multiplies their root mean square by its [`norm`], far from borders.
//!
//! Sources: the form of the temporal part follows the first-order response of Kelly 1961 (*Visual Responses to Time-Dependent Stimuli*). Korac et al.
//! 2023 (*Perceptual error optimization for Monte Carlo animation rendering*) also filter an error jointly over space and time.

use rayon::prelude::*;

/// Time constant of the exponential mean, seconds. This constant and the widths of the two Gaussians were fitted to verdicts of ColorVideoVDP, a
/// published model of visible differences; METHODOLOGY.md says how. `make judges` compares perceived noise with such verdicts.
pub const TIME_CONSTANT_S: f64 = 0.1;
/// Standard deviation of the narrow Gaussian, degrees of visual angle. With [`SURROUND_DEG`], the filter passes 3.1 cycles per degree best, which is
/// about where the eye's sensitivity to contrast has its maximum (Barten 1999, *Contrast Sensitivity of the Human Eye*).
pub const CENTRE_DEG: f64 = 0.04;
/// Standard deviation of the wide Gaussian, degrees of visual angle.
pub const SURROUND_DEG: f64 = 0.113;
/// The Gaussians are cut off at this number of standard deviations.
const REACH: f64 = 3.0;

/// The viewing conditions of a sequence of pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Viewing {
    /// Frames per second, above 0.
    pub frames_per_second: f64,
    /// Pixels per degree of visual angle, above 0.
    pub pixels_per_degree: f64,
}

impl Default for Viewing {
    /// 60 frames per second; 67 pixels per degree, as in FLIP (0.7 m in front of a monitor that is 0.7 m wide and has 3840 pixels in a row).
    fn default() -> Self {
        Viewing { frames_per_second: 60.0, pixels_per_degree: 67.0 }
    }
}

impl Viewing {
    /// The share of a new frame in the exponential mean: 1 - exp(-1 / (frames per second x time constant)).
    pub fn adaptation(&self) -> f64 {
        -(-1.0 / (self.frames_per_second * TIME_CONSTANT_S)).exp_m1()
    }
}

/// The weights of a one-dimensional Gaussian filter, from the middle outwards. The middle weight, plus twice the other weights, is 1.
fn gaussian(deviation_px: f64) -> Vec<f64> {
    // The deviation is raised to at least 0.1 pixels, which avoids a division by 0. This hardly changes results: at 0.1 pixels, the weight of a
    // neighbouring pixel is only exp(-50).
    let deviation = deviation_px.max(0.1);
    let reach = (REACH * deviation).ceil() as usize;
    let mut weights: Vec<f64> = (0..=reach).map(|i| (-0.5 * (i as f64 / deviation).powi(2)).exp()).collect();
    let sum = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    weights.iter_mut().for_each(|w| *w /= sum);
    weights
}

/// Number of neighbouring pixels that are computed together, so that their sums can stay in registers.
const BLOCK: usize = 16;

/// Computes one row of a filtered picture. The result for a pixel is `weights[0]` times the pixel in `row(0)`, plus, for each k above 0, `weights[k]`
/// times the sum of the pixels in `row(k)` and `row(-k)`. Each of these rows must have at least as many pixels as `to`, rounded up to a multiple of
/// [`BLOCK`].
fn weighted<'a>(to: &mut [f32], weights: &[f32], row: impl Fn(isize) -> &'a [f32]) {
    let blocks = |k: isize| row(k).as_chunks::<BLOCK>().0;
    for (block, to) in to.chunks_mut(BLOCK).enumerate() {
        let mut sums = blocks(0)[block].map(|pixel| weights[0] * pixel);
        for (k, &weight) in (1..).zip(&weights[1..]) {
            let (before, after) = (&blocks(-k)[block], &blocks(k)[block]);
            for i in 0..BLOCK {
                sums[i] += weight * (before[i] + after[i]);
            }
        }
        to.copy_from_slice(&sums[..to.len()]);
    }
}

/// Filters a picture with a Gaussian along rows and columns. Pixels outside the picture count as 0. `weights`: see [`gaussian`].
fn blurred([width, height]: [usize; 2], picture: &[f32], weights: &[f32]) -> Vec<f32> {
    let reach = weights.len() - 1;
    let stride = width.next_multiple_of(BLOCK);
    // Above and below the picture are `reach` rows of zeros.
    let mut rows = vec![0.0; stride * (height + 2 * reach)];
    rows[stride * reach..].par_chunks_mut(stride).zip(picture.par_chunks(width)).for_each(|(to, from)| {
        let mut padded = vec![0.0; stride + 2 * reach];
        padded[reach..reach + width].copy_from_slice(from);
        weighted(&mut to[..width], weights, |k| &padded[reach.saturating_add_signed(k)..]);
    });
    let mut out = vec![0.0; picture.len()];
    out.par_chunks_mut(width).enumerate().for_each(|(y, to)| {
        weighted(to, weights, |k| &rows[stride * (reach + y).saturating_add_signed(k)..]);
    });
    out
}

/// The spatial filter for pictures of one size: the difference of two Gaussians, each normalised over the terrain that it covers. It computes in f32.
/// In a test with 67 pixels per degree, the rounding error of a pixel is below 6e-6 times the largest possible input.
pub struct Filter {
    size: [usize; 2],
    gaussians: [Vec<f32>; 2],
    /// Which pixels of the last filtered picture show terrain: 1 = terrain, 0 = none.
    terrain: Vec<f32>,
    /// For each Gaussian and pixel: the share of its weights that lies on terrain. It is computed again only if `terrain` changes; the pictures of
    /// all streams of a frame usually show the same terrain.
    covered: [Vec<f32>; 2],
}

impl Filter {
    /// Prepares the filter. `size`: width and height of the pictures, pixels.
    #[allow(clippy::cast_possible_truncation, reason = "the filter computes in f32")]
    pub fn new(size: [u32; 2], pixels_per_degree: f64) -> Filter {
        let weights = |degrees| gaussian(degrees * pixels_per_degree).into_iter().map(|weight| weight as f32).collect();
        let gaussians = [CENTRE_DEG, SURROUND_DEG].map(weights);
        Filter { size: size.map(|n| n as usize), gaussians, terrain: Vec::new(), covered: Default::default() }
    }

    /// Filters an error. `remembered`: for each pixel, row by row, the remembered error and the number of frames in it (`Meter::memory`); 0 frames =
    /// there is no terrain. The result has the same order; its value is 0 where there is no terrain.
    ///
    /// # Panics
    /// When the number of errors is not the number of pixels.
    pub fn apply(&mut self, remembered: &[[f32; 2]]) -> Vec<f32> {
        assert_eq!(remembered.len(), self.size[0] * self.size[1], "one error per pixel");
        if remembered.is_empty() {
            return Vec::new();
        }
        let terrain: Vec<f32> = remembered.iter().map(|&[_, frames]| if frames > 0.0 { 1.0 } else { 0.0 }).collect();
        if terrain != self.terrain {
            self.covered = self.gaussians.each_ref().map(|weights| blurred(self.size, &terrain, weights));
            self.terrain = terrain;
        }
        let values: Vec<f32> = remembered.iter().map(|&[error, frames]| if frames > 0.0 { error } else { 0.0 }).collect();
        let [mut centre, surround] = self.gaussians.each_ref().map(|weights| blurred(self.size, &values, weights));
        let [near, far] = &self.covered;
        for (at, value) in centre.iter_mut().enumerate() {
            *value = if self.terrain[at] > 0.0 { *value / near[at] - surround[at] / far[at] } else { 0.0 };
        }
        centre
    }

    /// Perceived noise: the root mean square of the filtered error over the pixels with terrain. `remembered`: as in [`Filter::apply`]. `None` if no
    /// pixel has terrain.
    ///
    /// # Panics
    /// When the number of errors is not the number of pixels.
    pub fn perceived_noise(&mut self, remembered: &[[f32; 2]]) -> Option<f64> {
        let sum: f64 = self.apply(remembered).into_iter().map(|error| f64::from(error).powi(2)).sum();
        let count = remembered.iter().filter(|[_, frames]| *frames > 0.0).count();
        (count > 0).then(|| f64::sqrt(sum / count as f64))
    }
}

/// The norm of the spatial filter far from every border: the factor by which it reduces the root mean square of errors that are independent from
/// pixel to pixel.
pub fn norm(pixels_per_degree: f64) -> f64 {
    let [centre, surround] = [CENTRE_DEG, SURROUND_DEG].map(|degrees| gaussian(degrees * pixels_per_degree));
    let dot = |a: &[f64], b: &[f64]| {
        let one = a.iter().zip(b).enumerate().map(|(i, (a, b))| if i == 0 { a * b } else { 2.0 * a * b }).sum::<f64>();
        one * one
    };
    (dot(&centre, &centre) - 2.0 * dot(&centre, &surround) + dot(&surround, &surround)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::hash;

    fn white(i: usize, frame: u32) -> f64 {
        let h = hash::pcg4d([u32::try_from(i).unwrap_or(0), frame, 3, 8]);
        // The sum of four uniform numbers in 0..1, minus its mean 2, scaled to a variance of 1. The variance of one number is 1/12, so that of the
        // sum is 1/3.
        (h.iter().map(|&h| f64::from(h) / 4_294_967_296.0).sum::<f64>() - 2.0) * 3f64.sqrt()
    }

    #[test]
    fn an_offset_is_not_noise_even_beside_the_sky() {
        let size = [50, 40];
        let error: Vec<[f32; 2]> = (0..2000).map(|i| [0.25, if i % 50 > 7 + i / 50 { 1.0 } else { 0.0 }]).collect();
        let mut filter = Filter::new(size, 67.0);
        assert!(filter.apply(&error).iter().all(|e| e.abs() < 1e-6));
        assert_eq!(filter.perceived_noise(&[[0.5, 0.0]; 2000]), None, "no terrain");
        assert_eq!(Filter::new([1, 1], 67.0).perceived_noise(&[[0.5, 1.0]]), Some(0.0), "one pixel");
        assert_eq!(Filter::new([0, 3], 67.0).perceived_noise(&[]), None, "no pixel");
    }

    #[test]
    fn the_filter_is_the_difference_of_two_means_over_terrain() {
        // The width is no multiple of the block, and the height is less than the reach of the wide Gaussian (23 pixels).
        let size = [37, 19];
        let mut filter = Filter::new(size.map(|n| n as u32), 67.0);
        // The second picture has the terrain of the first one, the third has other terrain.
        for (field, shift) in [(0, 0), (1, 0), (2, 5)] {
            let error: Vec<[f32; 2]> = (0..size[0] * size[1])
                .map(|i| if (i + shift) % 11 > 2 { [white(i, field) as f32, 1.0] } else { [f32::NAN, 0.0] })
                .collect();
            let mean = |at: usize, degrees: f64| {
                let weights = gaussian(degrees * 67.0);
                let weight = |a: usize, b: usize| weights.get(a.abs_diff(b)).copied().unwrap_or(0.0);
                let (mut sum, mut all) = (0.0, 0.0);
                for (i, &[e, _]) in error.iter().enumerate().filter(|(_, [_, frames])| *frames > 0.0) {
                    let w = weight(i % size[0], at % size[0]) * weight(i / size[0], at / size[0]);
                    (sum, all) = (sum + w * f64::from(e), all + w);
                }
                sum / all
            };
            for (at, found) in filter.apply(&error).into_iter().enumerate() {
                let expected = if error[at][1] > 0.0 { mean(at, CENTRE_DEG) - mean(at, SURROUND_DEG) } else { 0.0 };
                // A Gaussian has up to 2 x 47 terms. Each term rounds a number of at most 3.5, the largest possible error, times its weight.
                let off = (f64::from(found) - expected).abs();
                assert!(off < 94.0 * 3.5 * 2f64.powi(-24), "field {field}, pixel {at}: {found} and not {expected}");
            }
        }
    }

    #[test]
    fn independent_errors_are_reduced_by_the_norm_of_the_filter() {
        let size = [400, 300];
        for pixels_per_degree in [20.0, 67.0] {
            let inside = |i: &usize| (60..340).contains(&(i % 400)) && (60..240).contains(&(i / 400));
            let (mut sum, mut count) = (0.0, 0.0);
            let mut filter = Filter::new(size, pixels_per_degree);
            for field in 0..8 {
                let error: Vec<[f32; 2]> = (0..120_000).map(|i| [white(i, field) as f32, 1.0]).collect();
                let out = filter.apply(&error);
                for i in (0..120_000).filter(inside) {
                    (sum, count) = (sum + f64::from(out[i]).powi(2), count + 1.0);
                }
            }
            let ratio = f64::sqrt(sum / count) / norm(pixels_per_degree);
            // The sum has 8 x 50 400 squares. At 67 pixels per degree, the filter correlates about 4 pi c² = 90 neighbouring pixels, where c is the
            // standard deviation of the narrow Gaussian in pixels. So there are about 4500 independent squares, and the relative standard deviation
            // of the root is 1 / sqrt(2 x 4500) = 1.1 %. The tolerance is five standard deviations.
            assert!((ratio - 1.0).abs() < 0.055, "{ratio} at {pixels_per_degree} pixels per degree");
        }
        assert!(norm(20.0) > norm(67.0), "finer pixels are averaged more");
    }

    #[test]
    fn the_filter_passes_the_frequencies_of_the_eye_best() {
        // For infinite Gaussians, the response to a grating of f cycles per degree is exp(-2 (pi f c)²) - exp(-2 (pi f s)²), where c and s are
        // CENTRE_DEG and SURROUND_DEG.
        let ppd = 67.0;
        let size = [800, 1];
        let response = |f: f64| {
            let error: Vec<[f32; 2]> = (0..800).map(|i| [(std::f64::consts::TAU * f / ppd * f64::from(i)).sin() as f32, 1.0]).collect();
            let out = Filter::new(size, ppd).apply(&error);
            let (sum, n) = (200..600).fold((0.0, 0.0), |(s, n), i| (s + f64::from(out[i]).powi(2), n + 1.0));
            (2.0 * sum / n).sqrt()
        };
        for f in [1.0, 3.1, 8.0] {
            let passes = |deviation: f64| (-2.0 * (std::f64::consts::PI * f * deviation).powi(2)).exp();
            let expected = passes(CENTRE_DEG) - passes(SURROUND_DEG);
            // The Gaussians are cut off at 3 standard deviations and sampled in pixels, so the response differs slightly from the formula. The
            // tolerance is 0.03; the largest response is 0.65.
            assert!((response(f) - expected).abs() < 0.03, "{f} cycles per degree: {} and not {expected}", response(f));
        }
        assert!(response(3.1) > response(1.5) && response(3.1) > response(6.0));
    }

    #[test]
    fn a_new_frame_has_the_share_of_its_duration() {
        let of = |frames_per_second| Viewing { frames_per_second, ..Viewing::default() }.adaptation();
        assert!((of(1.0 / TIME_CONSTANT_S) - (1.0 - (-1.0f64).exp())).abs() < 1e-12);
        assert!((of(1e6) * 1e6 * TIME_CONSTANT_S - 1.0).abs() < 1e-4 && of(30.0) > of(60.0));
    }
}

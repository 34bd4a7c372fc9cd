//! Structural similarity (SSIM): Wang, Bovik, Sheikh and Simoncelli 2004, *Image Quality Assessment: From Error Visibility to Structural Similarity*,
//! equation 13, with the parameters of the paper.
//!
//! > SSIM(x, y) = (2 mx my + C1) (2 sxy + C2) / ((mx² + my² + C1) (sx² + sy² + C2)), C1 = (K1 L)², C2 = (K2 L)²
//!
//! mx and my are means, sx² and sy² variances, and sxy is the covariance. They are weighted by a Gaussian window of 11 x 11 pixels with sigma 1.5,
//! whose weights have a sum of 1. K1 = 0.01, K2 = 0.03, and L = 1, because the encoded values lie in 0..=1. Windows that extend beyond the picture
//! are excluded. The paper compares grey pictures. Here each colour channel is compared separately, and the results are averaged, as in scikit-image.

use super::area;

/// Side of the window, pixels.
pub const WINDOW: usize = 11;
/// Standard deviation of the window, pixels.
pub const SIGMA: f64 = 1.5;
/// Constant of the luminance term, relative to the peak.
pub const K1: f64 = 0.01;
/// Constant of the contrast and structure term, relative to the peak.
pub const K2: f64 = 0.03;

/// Returns the mean SSIM of two pictures of `size` (width, height) with display values in 0..=1. The mean is over the three channels and over
/// windows. A window counts if it fits into the picture and the mask selects its central pixel (no mask = every pixel). `None` if no window counts,
/// or if the lengths do not match the size.
pub fn ssim(size: [u32; 2], test: &[[f32; 3]], reference: &[[f32; 3]], mask: Option<&[bool]>) -> Option<f64> {
    let [width, height] = size.map(|side| side as usize);
    let (inner_width, inner_height) = (width.checked_sub(WINDOW - 1)?, height.checked_sub(WINDOW - 1)?);
    if [test.len(), reference.len(), mask.map_or(area(size), <[bool]>::len)] != [area(size); 3] {
        return None;
    }
    let counts = |x: usize, y: usize| mask.is_none_or(|mask| mask[(y + WINDOW / 2) * width + x + WINDOW / 2]);
    let centres: Vec<usize> = (0..inner_width * inner_height).filter(|i| counts(i % inner_width, i / inner_width)).collect();
    if centres.is_empty() {
        return None;
    }
    let weights = window();
    let (c1, c2) = (K1 * K1, K2 * K2);
    let mut sum = 0.0;
    for channel in 0..3 {
        let plane = |texels: &[[f32; 3]]| texels.iter().map(|t| f64::from(t[channel])).collect::<Vec<f64>>();
        let (x, y) = (plane(test), plane(reference));
        let smooth = |a: &[f64], b: Option<&[f64]>| match b {
            None => filter(a, [width, height], &weights),
            Some(b) => filter(&a.iter().zip(b).map(|(a, b)| a * b).collect::<Vec<_>>(), [width, height], &weights),
        };
        let (mx, my) = (smooth(&x, None), smooth(&y, None));
        let (xx, yy, xy) = (smooth(&x, Some(&x)), smooth(&y, Some(&y)), smooth(&x, Some(&y)));
        for &i in &centres {
            let (product, squares) = (mx[i] * my[i], mx[i] * mx[i] + my[i] * my[i]);
            let (covariance, variances) = (xy[i] - product, xx[i] + yy[i] - squares);
            sum += (2.0 * product + c1) * (2.0 * covariance + c2) / ((squares + c1) * (variances + c2));
        }
    }
    Some(sum / (3.0 * centres.len() as f64))
}

/// Returns the weights of the window along one axis. Their sum is 1.
fn window() -> [f64; WINDOW] {
    let weight = |i: usize| (-(i as f64 - (WINDOW / 2) as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
    let weights: [f64; WINDOW] = std::array::from_fn(weight);
    let sum: f64 = weights.iter().sum();
    weights.map(|w| w / sum)
}

/// Returns the weighted mean of each window that fits into the picture: (width - 10) x (height - 10) values, row by row.
fn filter(values: &[f64], [width, height]: [usize; 2], weights: &[f64; WINDOW]) -> Vec<f64> {
    let (inner_width, inner_height) = (width - (WINDOW - 1), height - (WINDOW - 1));
    let mut result = vec![0.0; inner_width * inner_height];
    let mut column_sums = vec![0.0; width];
    for (y, line) in result.chunks_exact_mut(inner_width).enumerate() {
        column_sums.fill(0.0);
        for (k, weight) in weights.iter().enumerate() {
            let row = &values[(y + k) * width..][..width];
            column_sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * value);
        }
        for (k, weight) in weights.iter().enumerate() {
            line.iter_mut().zip(&column_sums[k..]).for_each(|(sum, value)| *sum += weight * value);
        }
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [43, 30];

    /// Returns the test and the reference that the script below creates. Their values have 8 bits.
    fn pictures() -> [Vec<[f32; 3]>; 2] {
        let code = |v: i32| v as f32 / 255.0;
        let (mut test, mut reference) = (Vec::new(), Vec::new());
        for y in 0..SIZE[1] as i32 {
            for x in 0..SIZE[0] as i32 {
                let r = [0, 1, 2].map(|c| (7 * x + 5 * y + 31 * c + (x * y) % 17 * 3) % 256);
                test.push([0, 1, 2].map(|c| code((r[c] + (x * x + 3 * y + 5 * c as i32) % 23 - 11).clamp(0, 255))));
                reference.push(r.map(code));
            }
        }
        [test, reference]
    }

    /// The expected values were computed with this script and scikit-image 0.26.0:
    /// ```python
    /// import numpy as np
    /// from skimage.metrics import structural_similarity
    /// y, x, c = np.mgrid[:30, :43, :3]
    /// r = (7 * x + 5 * y + 31 * c + (x * y) % 17 * 3) % 256
    /// t = np.clip(r + (x * x + 3 * y + 5 * c) % 23 - 11, 0, 255)
    /// f = lambda a: (a.astype(np.float32) / np.float32(255)).astype(np.float64)
    /// mean, full = structural_similarity(f(t), f(r), gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
    ///                                    data_range=1, channel_axis=2, full=True)
    /// print(mean, full[5:-5, 5:-5][x[5:-5, 5:-5, 0] < 20].mean())
    /// ```
    #[test]
    fn agrees_with_scikit_image() {
        let [test, reference] = pictures();
        let found = ssim(SIZE, &test, &reference, None).unwrap();
        // Both implementations compute in f64. The variances are differences of larger numbers, so their error is about 1e-16. The formula divides
        // the variances by at least C2 = 9e-4, so the error of SSIM is about 1e-13.
        assert!((found - 0.967_286_106_029_085_7).abs() < 1e-12, "{found}");
        let left: Vec<bool> = (0..test.len()).map(|i| i % SIZE[0] as usize <= 19).collect();
        let found = ssim(SIZE, &test, &reference, Some(&left)).unwrap();
        assert!((found - 0.970_495_333_332_878_2).abs() < 1e-12, "{found}");
    }

    #[test]
    fn without_a_window_there_is_no_value() {
        let [test, reference] = pictures();
        assert_eq!(ssim([10, 129], &test, &reference, None), None);
        assert_eq!(ssim([129, 10], &test, &reference, None), None);
        let edge: Vec<bool> = (0..test.len()).map(|i| i % SIZE[0] as usize <= 4).collect();
        assert_eq!(ssim(SIZE, &test, &reference, Some(&edge)), None);
        assert_eq!(ssim(SIZE, &test[1..], &reference, None), None);
        assert!(ssim([11, 11], &test[..121], &reference[..121], None).is_some());
    }

    #[test]
    fn a_negative_is_dissimilar() {
        let [test, _] = pictures();
        let negative: Vec<_> = test.iter().map(|t| t.map(|v| 1.0 - v)).collect();
        assert!(ssim(SIZE, &negative, &test, None).unwrap() < -0.3);
    }
}

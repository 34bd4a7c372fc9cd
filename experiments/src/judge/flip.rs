//! FLIP predicts the difference that a viewer sees when two pictures are shown alternately. Andersson, Nilsson, Akenine-Möller, Oskarsson, Åström and
//! Fairchild 2020, *FLIP: A Difference Evaluator for Alternating Images*. This is the version for low dynamic range. The authors' code is called
//! through the crate `nv-flip`. It takes sRGB values of 8 bits.

use kernels::base::error::{Error, Result};
use nv_flip::FlipImageRgb8;

use super::area;
use crate::metrics;

/// Default number of pixels per degree of the viewer's field of view. It applies to a display that is 3840 pixels and 0.7 m wide and seen from a
/// distance of 0.7 m.
pub const PIXELS_PER_DEGREE: f32 = nv_flip::DEFAULT_PIXELS_PER_DEGREE;

/// The errors of all pixels, summarised in a few numbers. Each number lies in 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flip {
    /// The mean error. The authors recommend it if a single number is needed.
    pub mean: f64,
    /// The weighted quartiles. The pixels are sorted by their errors, and the errors are summed in this order. The quartiles are the errors at which
    /// this sum first exceeds a quarter, a half and three quarters of the sum of all errors.
    pub weighted_quartiles: [f64; 3],
    /// The largest error.
    pub max: f64,
}

/// The error of each pixel, row by row.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The error of each pixel, in 0..=1.
    pub errors: Vec<f32>,
}

/// Computes the FLIP errors of two pictures of `size` (width, height). The values of the pictures are sRGB-encoded. They are clamped to 0..=1 and
/// rounded to 8 bits.
///
/// # Errors
/// The lengths do not match the size, there is no pixel, `pixels_per_degree` lies outside [`metrics::PIXELS_PER_DEGREE_RANGE`], or `nv-flip` returns
/// an error outside 0..=1.
pub fn map(size: [u32; 2], test: &[[f32; 3]], reference: &[[f32; 3]], pixels_per_degree: f32) -> Result<Map> {
    let [low, high] = metrics::PIXELS_PER_DEGREE_RANGE;
    if !(low..=high).contains(&pixels_per_degree) {
        return Err(Error::Request(format!("{pixels_per_degree} pixels per degree are outside the range of FLIP, {low} to {high}")));
    }
    if test.len() != area(size) || reference.len() != area(size) || test.is_empty() {
        return Err(Error::Request(format!("FLIP needs {}x{} pixels (at least 1) in both the test and the reference", size[0], size[1])));
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 0..=255 just before; NaN becomes 0")]
    let code = |v: &f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let codes = |texels: &[[f32; 3]]| texels.as_flattened().iter().map(code).collect::<Vec<u8>>();
    let picture = |texels: &[[f32; 3]]| FlipImageRgb8::with_data(size[0], size[1], &codes(texels));
    let errors = nv_flip::flip(picture(reference), picture(test), pixels_per_degree).to_vec();
    if let Some(wrong) = errors.iter().find(|e| !(0.0..=1.0).contains(*e)) {
        return Err(Error::Request(format!("FLIP gave {wrong}, which is not in 0..=1: please report this with both pictures")));
    }
    Ok(Map { size, errors })
}

impl Map {
    /// Summarises the pixels that the mask selects, or all pixels without a mask. If there is no pixel, all numbers are 0.
    ///
    /// The pooling function of the crate `nv-flip` is not used, because it sums in f32, and because it does not initialise the maximum with 0.
    pub fn pool(&self, mask: Option<&[bool]>) -> Flip {
        let counts = |index: usize| mask.is_none_or(|mask| mask.get(index).copied().unwrap_or(false));
        let mut errors: Vec<f32> = self.errors.iter().enumerate().filter(|(i, _)| counts(*i)).map(|(_, e)| *e).collect();
        errors.sort_by(f32::total_cmp);
        let sum: f64 = errors.iter().map(|e| f64::from(*e)).sum();
        let quartile = |share: f64| {
            let mut below = 0.0;
            let holds = |e: &&f32| {
                below += f64::from(**e);
                below > share * sum
            };
            errors.iter().find(holds).map_or(0.0, |e| f64::from(*e))
        };
        Flip {
            mean: sum / errors.len().max(1) as f64,
            weighted_quartiles: [0.25, 0.5, 0.75].map(quartile),
            max: errors.last().map_or(0.0, |e| f64::from(*e)),
        }
    }

    /// Returns the map in the colours of [`magma`]: 0 is black, 1 is pale yellow.
    pub fn coloured(&self) -> Vec<[u8; 3]> {
        let colours = magma();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "errors lie in 0..=1")]
        let index = |error: f32| (error.clamp(0.0, 1.0) * 255.0 + 0.5) as usize;
        self.errors.iter().map(|e| colours[index(*e)]).collect()
    }
}

/// Returns the 256 colours of matplotlib's perceptually uniform `magma` (van der Walt and Smith 2015) as sRGB values of 8 bits. The colour for 0
/// comes first.
pub fn magma() -> Vec<[u8; 3]> {
    nv_flip::magma_lut().to_vec().as_chunks().0.to_vec()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [32, 24];

    fn uniform(colour: [f32; 3]) -> Vec<[f32; 3]> {
        vec![colour; area(SIZE)]
    }

    /// Converts linear sRGB to CIELAB. To model the Hunt effect, a and b are multiplied by 0.01 L, as in the paper.
    fn hunt_lab([r, g, b]: [f64; 3]) -> [f64; 3] {
        let xyz = |r: f64, g: f64, b: f64| {
            // The matrix that follows from the primaries and the white of IEC 61966-2-1, as in the code of the paper's authors.
            let x = 10_135_552.0 / 24_577_794.0 * r + 8_788_810.0 / 24_577_794.0 * g + 4_435_075.0 / 24_577_794.0 * b;
            let y = 2_613_072.0 / 12_288_897.0 * r + 8_788_810.0 / 12_288_897.0 * g + 887_015.0 / 12_288_897.0 * b;
            let z = 1_425_312.0 / 73_733_382.0 * r + 8_788_810.0 / 73_733_382.0 * g + 70_074_185.0 / 73_733_382.0 * b;
            [x, y, z]
        };
        let (c, white) = (xyz(r, g, b), xyz(1.0, 1.0, 1.0));
        let f = |t: f64| if t > (6.0f64 / 29.0).powi(3) { t.cbrt() } else { t / (3.0 * (6.0f64 / 29.0).powi(2)) + 4.0 / 29.0 };
        let [x, y, z] = [0, 1, 2].map(|k| f(c[k] / white[k]));
        let lightness = 116.0 * y - 16.0;
        [lightness, 500.0 * (x - y) * 0.01 * lightness, 200.0 * (y - z) * 0.01 * lightness]
    }

    /// Returns the error of two uniform pictures by the formula of the paper. Uniform pictures have no features, so only the difference in colour
    /// counts. Let d be the HyAB distance of the two colours to the power 0.7, and m the largest d, which is that of green and blue. Values of d up
    /// to 0.4 m are mapped to 0..=0.95, and larger values to 0.95..=1.
    fn uniform_error(a: [f64; 3], b: [f64; 3]) -> f64 {
        let distance = |a: [f64; 3], b: [f64; 3]| {
            let (a, b) = (hunt_lab(a), hunt_lab(b));
            ((a[0] - b[0]).abs() + (a[1] - b[1]).hypot(a[2] - b[2])).powf(0.7)
        };
        let largest = distance([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
        let (d, knee) = (distance(a, b), 0.4 * largest);
        if d < knee { 0.95 * d / knee } else { 0.95 + 0.05 * (d - knee) / (largest - knee) }
    }

    #[test]
    fn uniform_pictures_have_the_papers_closed_form() {
        let linear = |encoded: [f32; 3]| encoded.map(|c| f64::from(kernels::base::colour::linear_from_srgb(c)));
        let code = |c: [u8; 3]| c.map(|v| f32::from(v) / 255.0);
        let pairs = [
            ([0, 255, 0], [0, 0, 255]),
            ([0, 0, 0], [255, 255, 255]),
            ([120, 120, 120], [128, 128, 128]),
            ([200, 180, 90], [190, 180, 100]),
            ([10, 60, 30], [40, 40, 40]),
        ];
        for (a, b) in pairs {
            let (a, b) = (code(a), code(b));
            let pooled = map(SIZE, &uniform(a), &uniform(b), PIXELS_PER_DEGREE).unwrap().pool(None);
            let expected = uniform_error(linear(a), linear(b));
            // The tested code computes in f32. Lab values are at most about 100, and their relative error is about 1e-5, so their absolute error is
            // about 1e-3. The power and the division by the largest distance reduce the error, so the error of the result is below 1e-3.
            for found in [pooled.mean, pooled.max, pooled.weighted_quartiles[1]] {
                assert!((found - expected).abs() < 1e-3, "{a:?} {b:?}: {found} is not {expected}");
            }
            // Negative control: if the formula is applied to the encoded values without decoding them, it gives a different error. Pairs whose first
            // colour has only channels of 0 or 1 are excepted, because decoding does not change that colour.
            let wrong = uniform_error(a.map(f64::from), b.map(f64::from));
            assert!(a.map(f64::from) == linear(a) || (wrong - expected).abs() > 0.01);
        }
    }

    #[test]
    fn pooling_follows_its_definition() {
        let map = Map { size: [6, 1], errors: vec![0.5, 0.0, 0.125, 0.25, 0.375, 1.0] };
        // The running sums of the sorted errors are 0, 0.125, 0.375, 0.75, 1.25 and 2.25. A quarter, a half and three quarters of the total are
        // 0.5625, 1.125 and 1.6875.
        assert_eq!(map.pool(None), Flip { mean: 0.375, weighted_quartiles: [0.375, 0.5, 1.0], max: 1.0 });
        let masked = map.pool(Some(&[true, true, false, true, true, false]));
        assert_eq!(masked, Flip { mean: 1.125 / 4.0, weighted_quartiles: [0.375, 0.375, 0.5], max: 0.5 });
        assert_eq!(map.pool(Some(&[false; 6])), Flip { mean: 0.0, weighted_quartiles: [0.0; 3], max: 0.0 });
    }

    #[test]
    fn a_dot_is_seen_where_it_is_and_more_from_near() {
        let reference = uniform([0.5; 3]);
        let mut test = reference.clone();
        test[12 * 32 + 20] = [1.0; 3];
        let far = map(SIZE, &test, &reference, PIXELS_PER_DEGREE).unwrap();
        let peak = far.errors.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1)).map(|(i, _)| i);
        assert_eq!(peak, Some(12 * 32 + 20));
        let near = map(SIZE, &test, &reference, 20.0).unwrap();
        assert!(near.pool(None).max > far.pool(None).max + 0.05);
        let colours = far.coloured();
        assert_eq!((colours[0], colours.len()), (magma()[0], area(SIZE)));
        assert_eq!((magma().len(), magma()[0], magma()[255]), (256, [0, 0, 4], [252, 253, 191]));
    }

    #[test]
    fn wrong_arguments_are_refused() {
        let picture = uniform([0.5; 3]);
        for wrong in [0.0, 3.9, 401.0, f32::NAN, f32::INFINITY, -67.0] {
            assert!(map(SIZE, &picture, &picture, wrong).is_err(), "{wrong}");
        }
        for right in metrics::PIXELS_PER_DEGREE_RANGE {
            let mut test = picture.clone();
            test[7] = [0.0; 3];
            assert!(map(SIZE, &test, &picture, right).is_ok(), "{right}");
        }
        assert!(map(SIZE, &picture[1..], &picture, PIXELS_PER_DEGREE).is_err());
        assert!(map([0, 0], &[], &[], PIXELS_PER_DEGREE).is_err());
    }
}

//! Compares a picture with a reference: MSE, MRSE, PSNR, SSIM, FLIP. Also computes power spectra, and writes command lines of video metrics.
//!
//! Notation: t is the test picture and r the reference, both in linear colour. P is the set of compared pixels, k the channel (red, green, blue), and
//! s(x) is the sRGB encoding of x after clamping to 0..=1.
//!
//! - MSE = mean over P and k of (t - r)²; as in tev and in pbrt's imgtool.
//! - MRSE = mean over P and k of (t - r)² / (r² + 0.01), as in tev. This is the relative error of Rousselle, Knaus and Zwicker 2011, *Adaptive
//!   Sampling and Reconstruction using Greedy Error Minimization*, with their epsilon. imgtool divides by (r + 0.01)² instead. This denominator is
//!   100 times smaller for r = 0, so a single black pixel can dominate the mean, and it is 0 for r = -0.01.
//! - PSNR = 10 log10(1 / mean of (s(t) - s(r))²) dB. It is infinite if no encoded value differs. tev and imgtool do not have this metric. Encoded
//!   values are used, because only bounded values have a peak, which is 1. If both pictures have 8-bit codes, the result equals that of tools that
//!   compare the codes and average over the three channels. PSNR of linear values with peak 1 would contain the same information as the MSE: see
//!   [`psnr_db`].
//! - SSIM of s(t) and s(r): [`ssim`].
//! - FLIP of s(t) and s(r) in 8 bits: [`flip`].
//!
//! [`Pair`] refuses pictures with NaN or infinite values, because such values are defects. Sums are computed in f64.

mod coded;
mod facts;
pub mod flip;
mod image;
mod layers;
mod picture;
pub mod spectrum;
pub mod ssim;
pub mod video;
mod windows;

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use kernels::base::colour::srgb_from_linear;
use kernels::base::error::{Error, Result};
use kernels::base::names::nearest;

use crate::metrics;

pub use facts::{Note, Side, check_windows, notes};
pub use picture::{Content, Image, Origin};
pub use windows::Windows;

/// The number that is added to the denominator of MRSE, linear colour squared (tev; Rousselle et al. 2011). It limits relative errors of pixels at
/// which the reference is dark.
pub const MRSE_EPSILON: f64 = 0.01;

/// The metrics that compare two pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// Visible difference, 0..=1.
    Flip,
    /// Mean squared error.
    Mse,
    /// Mean relative squared error.
    Mrse,
    /// Peak signal-to-noise ratio, dB.
    Psnr,
    /// Structural similarity, -1..=1.
    Ssim,
}

impl Metric {
    /// All metrics, in the order in which they are printed.
    pub const ALL: [Metric; 5] = [Metric::Flip, Metric::Mse, Metric::Mrse, Metric::Psnr, Metric::Ssim];

    /// Returns the name of the metric on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Metric::Flip => metrics::FLIP,
            Metric::Mse => metrics::MSE,
            Metric::Mrse => metrics::MRSE,
            Metric::Psnr => metrics::PSNR,
            Metric::Ssim => metrics::SSIM,
        }
    }

    /// Returns the range or unit of the metric and its definition, in one line.
    pub fn definition(self) -> &'static str {
        match self {
            Metric::Flip => "0..1, 0 = equal; mean of LDR-FLIP over pixels, sRGB-encoded, 8 bits",
            Metric::Mse => "linear colour²; mean of (t - r)² over pixels and channels",
            Metric::Mrse => "1; mean of (t - r)² / (r² + 0.01) over pixels and channels, linear",
            Metric::Psnr => "dB; 10 log10(1 / MSE), sRGB-encoded, peak 1",
            Metric::Ssim => "-1..1, 1 = equal; Gaussian window of 11x11, sRGB-encoded, mean over pixels and channels",
        }
    }

    /// Whether the metric is only meaningful for colours. Such metrics use the values that a display shows.
    pub fn needs_colour(self) -> bool {
        matches!(self, Metric::Flip | Metric::Psnr | Metric::Ssim)
    }
}

impl fmt::Display for Metric {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Metric {
    type Err = Error;

    /// # Errors
    /// The name is unknown. The message names the most similar known metric.
    fn from_str(text: &str) -> Result<Metric> {
        let names = Metric::ALL.map(Metric::name);
        Metric::ALL.into_iter().find(|metric| metric.name() == text).ok_or_else(|| {
            let hint = nearest(text, &names).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            Error::Request(format!("`{text}` is not a known metric: the metrics are {}{hint}", names.join(", ")))
        })
    }
}

/// The values of all metrics for two pictures. [`Pair`] computes each metric separately.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Errors {
    /// Number of compared pixels.
    pub pixels: usize,
    /// Mean squared error, linear colour squared.
    pub mse: f64,
    /// Mean relative squared error, a ratio.
    pub mrse: f64,
    /// Peak signal-to-noise ratio, dB; infinite if the encodings of all compared pixels are equal.
    pub psnr: f64,
    /// Structural similarity, -1..=1; `None` if there is no compared pixel around which a window fits into the picture.
    pub ssim: Option<f64>,
    /// FLIP error, 0..=1, for the number of pixels per degree [`flip::PIXELS_PER_DEGREE`].
    pub flip: flip::Flip,
}

/// Compares a test picture with a reference by all metrics. Both are in linear colour, row by row.
///
/// Each metric is computed from a mean over the pixels for which `mask` is true. FLIP and SSIM also use the neighbourhood of a pixel. For them, the
/// test's pixels outside the mask are replaced by those of the reference, so the original values of these pixels have no influence. Next to the
/// border of the mask, a part of the neighbourhood therefore equals the reference, and differences may count less than elsewhere.
///
/// FLIP takes most of the time. Callers that do not need FLIP should use [`Pair`].
///
/// # Errors
/// See [`Pair::new`] and [`flip::map`].
pub fn errors(size: [u32; 2], test: &[[f32; 3]], reference: &[[f32; 3]], mask: &[bool]) -> Result<Errors> {
    let pair = Pair::new(size, test, reference, Some(mask))?;
    let flip = pair.flip(flip::PIXELS_PER_DEGREE)?.pool(Some(mask));
    Ok(Errors { pixels: pair.pixels(), mse: pair.mse(), mrse: pair.mrse(), psnr: pair.psnr(), ssim: pair.ssim(), flip })
}

/// Returns the PSNR in dB for the mean squared error of values whose peak is 1; infinite for an error of 0.
pub fn psnr_db(mean_squared_error: f64) -> f64 {
    // The logarithm of the reciprocal is used instead of a negated logarithm, which would give -0 for an error of 1.
    10.0 * mean_squared_error.recip().log10()
}

/// A test picture and its reference, with valid sizes and values.
#[derive(Debug)]
pub struct Pair<'a> {
    size: [u32; 2],
    test: &'a [[f32; 3]],
    reference: &'a [[f32; 3]],
    mask: Option<&'a [bool]>,
    pixels: usize,
    encoded: OnceLock<[Vec<[f32; 3]>; 2]>,
}

impl<'a> Pair<'a> {
    /// Returns a pair of two pictures of `size` (width, height) in linear colour, row by row. If `mask` is `None`, every pixel is compared.
    ///
    /// # Errors
    /// The lengths do not match the size, no pixel is compared, or a value is NaN or infinite (even if it is outside the mask).
    pub fn new(size: [u32; 2], test: &'a [[f32; 3]], reference: &'a [[f32; 3]], mask: Option<&'a [bool]>) -> Result<Pair<'a>> {
        let area = area(size);
        let lengths = [test.len(), reference.len(), mask.map_or(area, <[bool]>::len)];
        if lengths != [area; 3] {
            let [width, height] = size;
            let [test, reference, mask] = lengths;
            return Err(Error::Request(format!(
                "a pair of {width}x{height} pixels needs {area} values each: the test has {test}, the reference {reference}, the mask {mask}"
            )));
        }
        for (name, texels) in [("test", test), ("reference", reference)] {
            if let Some(what) = not_finite(size, texels) {
                return Err(Error::Request(format!("the {name} holds {what}: pictures to compare must have finite values")));
            }
        }
        let pixels = mask.map_or(area, |mask| mask.iter().filter(|m| **m).count());
        if pixels == 0 {
            return Err(Error::Request("no pixel is left to compare: the mask excludes all pixels, or the picture is empty".to_owned()));
        }
        Ok(Pair { size, test, reference, mask, pixels, encoded: OnceLock::new() })
    }

    /// Returns width and height.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns the number of compared pixels.
    pub fn pixels(&self) -> usize {
        self.pixels
    }

    /// Whether the two pictures are equal in all compared pixels.
    pub fn identical(&self) -> bool {
        self.counted(self.test, self.reference).all(|(t, r)| t == r)
    }

    /// Returns the mean squared error, linear colour squared.
    pub fn mse(&self) -> f64 {
        self.mean(self.test, self.reference, |t, r| (t - r) * (t - r))
    }

    /// Returns the mean relative squared error.
    pub fn mrse(&self) -> f64 {
        self.mean(self.test, self.reference, |t, r| (t - r) * (t - r) / (r * r + MRSE_EPSILON))
    }

    /// Returns the PSNR of the sRGB encodings, dB; infinite if they are equal in all compared pixels.
    pub fn psnr(&self) -> f64 {
        let [test, reference] = self.encoded();
        psnr_db(self.mean(test, reference, |t, r| (t - r) * (t - r)))
    }

    /// Returns the mean SSIM of the sRGB encodings, -1..=1; `None` if there is no compared pixel around which a window fits into the picture.
    pub fn ssim(&self) -> Option<f64> {
        let [test, reference] = self.encoded();
        ssim::ssim(self.size, test, reference, self.mask)
    }

    /// Returns the map of FLIP errors of the sRGB encodings.
    ///
    /// # Errors
    /// See [`flip::map`].
    pub fn flip(&self, pixels_per_degree: f32) -> Result<flip::Map> {
        let [test, reference] = self.encoded();
        flip::map(self.size, test, reference, pixels_per_degree)
    }

    /// Returns the sRGB encodings of test and reference. Pixels of the test outside the mask are replaced by those of the reference.
    fn encoded(&self) -> &[Vec<[f32; 3]>; 2] {
        self.encoded.get_or_init(|| {
            let encode = |texels: &[[f32; 3]]| texels.iter().map(|t| t.map(srgb_from_linear)).collect::<Vec<_>>();
            let (mut test, reference) = (encode(self.test), encode(self.reference));
            if let Some(mask) = self.mask {
                for ((test, reference), _) in test.iter_mut().zip(&reference).zip(mask).filter(|(_, counts)| !**counts) {
                    *test = *reference;
                }
            }
            [test, reference]
        })
    }

    fn counted<'b>(&'b self, test: &'b [[f32; 3]], reference: &'b [[f32; 3]]) -> impl Iterator<Item = (&'b [f32; 3], &'b [f32; 3])> {
        let counts = move |index: usize| self.mask.is_none_or(|mask| mask[index]);
        test.iter().zip(reference).enumerate().filter(move |(index, _)| counts(*index)).map(|(_, pair)| pair)
    }

    fn mean(&self, test: &[[f32; 3]], reference: &[[f32; 3]], error: impl Fn(f64, f64) -> f64) -> f64 {
        let of_pixel = |(t, r): (&[f32; 3], &[f32; 3])| (0..3).map(|k| error(f64::from(t[k]), f64::from(r[k]))).sum::<f64>();
        self.counted(test, reference).map(of_pixel).sum::<f64>() / (3.0 * self.pixels as f64)
    }
}

/// Returns the number of pixels of a picture.
fn area(size: [u32; 2]) -> usize {
    size[0] as usize * size[1] as usize
}

/// Describes how many values are NaN or infinite, and where the first of them is; `None` if all values are finite.
fn not_finite(size: [u32; 2], texels: &[[f32; 3]]) -> Option<String> {
    let first = texels.iter().position(|t| t.iter().any(|v| !v.is_finite()))?;
    let all = || texels.as_flattened().iter();
    let (nan, infinite) = (all().filter(|v| v.is_nan()).count(), all().filter(|v| v.is_infinite()).count());
    let width = size[0].max(1) as usize;
    let (x, y) = (first % width, first / width);
    let counted = [(nan, "NaN"), (infinite, "infinite")].into_iter().filter(|(count, _)| *count > 0);
    let counted: Vec<String> = counted.map(|(count, name)| format!("{count} {name}")).collect();
    let values = if nan + infinite == 1 { "value" } else { "values" };
    Some(format!("{} {values}, first in column {x}, row {y} (from 0, 0 at the upper left)", counted.join(" and ")))
}

#[cfg(test)]
mod tests {
    use kernels::base::colour::linear_from_srgb;
    use kernels::shared::hash::unit2;

    use super::*;

    const SIZE: [u32; 2] = [24, 20];

    fn constant(value: f32) -> Vec<[f32; 3]> {
        vec![[value; 3]; area(SIZE)]
    }

    fn close(a: f64, b: f64, relative: f64) {
        assert!((a - b).abs() <= relative * b.abs(), "{a} is not {b}");
    }

    #[test]
    fn a_constant_offset_has_closed_forms() {
        // Both values are exact in f32, so the errors of MSE and MRSE are only those of f64.
        let (t, r) = (0.75, 0.5);
        let (test, reference) = (constant(t), constant(r));
        let found = errors(SIZE, &test, &reference, &vec![true; area(SIZE)]).unwrap();
        assert_eq!(found.pixels, area(SIZE));
        close(found.mse, 0.0625, 1e-12);
        close(found.mrse, 0.0625 / 0.26, 1e-12);
        // If test and reference are exchanged, MRSE changes, because it divides by the reference.
        close(Pair::new(SIZE, &reference, &test, None).unwrap().mrse(), 0.0625 / 0.5725, 1e-12);
        // For a black reference, MRSE is the MSE divided by the epsilon. The formula of imgtool would give a value that is 100 times larger.
        close(Pair::new(SIZE, &test, &constant(0.0), None).unwrap().mrse(), 0.5625 / 0.01, 1e-12);
        let [et, er] = [t, r].map(|v| f64::from(srgb_from_linear(v)));
        close(found.psnr, -20.0 * (et - er).log10(), 1e-9);
        // Uniform pictures have no variance, so SSIM equals its luminance term.
        let c1 = 1e-4;
        close(found.ssim.unwrap(), (2.0 * et * er + c1) / (et * et + er * er + c1), 1e-9);
    }

    #[test]
    fn noise_of_known_variance_gives_it() {
        // A hash determines whether d is added or subtracted. The mean squared error is d² for any hash.
        let d = 0.125;
        let reference: Vec<[f32; 3]> = (0..area(SIZE)).map(|i| [0.5 + (i % 7) as f32 / 64.0; 3]).collect();
        let sign = |i: usize, k: usize| if unit2(i as i32, k as i32, 7, 0) < 0.5 { -d } else { d };
        let test: Vec<_> = reference.iter().enumerate().map(|(i, r)| [0, 1, 2].map(|k| r[k] + sign(i, k))).collect();
        let pair = Pair::new(SIZE, &test, &reference, None).unwrap();
        close(pair.mse(), f64::from(d) * f64::from(d), 1e-12);
        let relative = (0..area(SIZE)).map(|i| 1.0 / ((0.5 + (i % 7) as f64 / 64.0).powi(2) + 0.01)).sum::<f64>() / area(SIZE) as f64;
        close(pair.mrse(), pair.mse() * relative, 1e-12);
        assert!(!pair.identical());
        assert!(pair.ssim().is_some_and(|s| s < 0.5), "SSIM rates noise as similar to the reference");
    }

    #[test]
    fn identical_pictures_have_no_error_and_infinite_psnr() {
        let picture: Vec<[f32; 3]> = (0..area(SIZE)).map(|i| [0, 1, 2].map(|k| unit2(i as i32, k, 3, 0) as f32 * 1.5 - 0.2)).collect();
        let found = errors(SIZE, &picture, &picture, &vec![true; area(SIZE)]).unwrap();
        assert_eq!((found.mse, found.mrse, found.psnr), (0.0, 0.0, f64::INFINITY));
        assert_eq!(found.ssim, Some(1.0));
        assert_eq!(found.flip, flip::Flip { mean: 0.0, weighted_quartiles: [0.0; 3], max: 0.0 });
        assert!(Pair::new(SIZE, &picture, &picture, None).unwrap().identical());
        assert_eq!(psnr_db(1.0), 0.0);
    }

    #[test]
    fn encoded_metrics_clamp_and_linear_ones_do_not() {
        let (test, reference) = (constant(2.0), constant(1.0));
        let pair = Pair::new(SIZE, &test, &reference, None).unwrap();
        assert_eq!((pair.mse(), pair.psnr(), pair.identical()), (1.0, f64::INFINITY, false));
        // If both pictures were decoded from 8-bit values, their PSNR is that of the 8-bit values. For a difference of 5, it is 20 log10(255 / 5) =
        // 34.15 dB.
        let (test, reference) = (constant(linear_from_srgb(105.0 / 255.0)), constant(linear_from_srgb(100.0 / 255.0)));
        close(Pair::new(SIZE, &test, &reference, None).unwrap().psnr(), 20.0 * 51f64.log10(), 1e-6);
    }

    #[test]
    fn what_is_behind_the_mask_does_not_count() {
        let reference: Vec<[f32; 3]> = (0..area(SIZE)).map(|i| [unit2(i as i32, 1, 5, 0) as f32; 3]).collect();
        let mask: Vec<bool> = (0..area(SIZE)).map(|i| i % SIZE[0] as usize >= 8).collect();
        let offset = |hidden: f32, seen: f32| -> Vec<[f32; 3]> {
            reference.iter().zip(&mask).map(|(r, m)| r.map(|v| v + if *m { seen } else { hidden })).collect()
        };
        let (mild, wild, clean) = (offset(0.0, 0.25), offset(-9.0, 0.25), offset(0.5, 0.0));
        let found = errors(SIZE, &wild, &reference, &mask).unwrap();
        assert_eq!(found, errors(SIZE, &mild, &reference, &mask).unwrap());
        assert_eq!(found.pixels, 16 * 20);
        close(found.mse, 0.0625, 1e-6);
        let none = errors(SIZE, &clean, &reference, &mask).unwrap();
        assert_eq!((none.mse, none.psnr, none.ssim, none.flip.max), (0.0, f64::INFINITY, Some(1.0), 0.0));
        // Negative control: without the mask, the pixels outside it have an influence.
        let all = errors(SIZE, &wild, &reference, &vec![true; area(SIZE)]).unwrap();
        assert!(all.mse > 2.0 * found.mse && all.flip.mean > found.flip.mean);
    }

    #[test]
    fn wrong_pairs_are_refused_with_their_place() {
        let picture = constant(0.5);
        let refused = |test: &[[f32; 3]], mask: Option<&[bool]>, says: &str| {
            let text = Pair::new(SIZE, test, &picture, mask).map(|_| ()).unwrap_err().to_string();
            assert!(text.contains(says), "{text}");
        };
        refused(&picture[1..], None, "needs 480 values");
        refused(&picture, Some(&[true]), "the mask 1");
        refused(&picture, Some(&vec![false; area(SIZE)]), "no pixel is left");
        let mut broken = picture.clone();
        broken[3 * 24 + 5][2] = f32::NAN;
        refused(&broken, None, "the test holds 1 NaN value, first in column 5, row 3");
        broken[3 * 24 + 7] = [f32::NEG_INFINITY; 3];
        refused(&broken, None, "1 NaN and 3 infinite values, first in column 5, row 3");
        assert!(Pair::new([0, 0], &[], &[], None).is_err());
    }

    #[test]
    fn metrics_are_found_by_name() {
        for metric in Metric::ALL {
            assert_eq!(metric.name().parse::<Metric>().ok(), Some(metric));
        }
        let refused = "flop".parse::<Metric>().unwrap_err().to_string();
        assert!(refused.contains("did you mean `flip`?") && refused.contains("mse, mrse"), "{refused}");
    }
}

//! Computes the power spectrum of a field. The spectrum describes how much the values of the field vary at each frequency. White noise has an
//! expected power of 1 at every frequency.
//!
//! Noise that forms blotches has a high power at low frequencies. Blue noise has little power there and hardly forms blotches (Ulichney 1987,
//! *Digital Halftoning*, chapter 3: the radially averaged power spectrum).

use kernels::base::error::{Error, Result};
use rustfft::FftPlanner;
use rustfft::num_complex::Complex;

use super::area;

/// The power of a band of frequencies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Band {
    /// Mean frequency of the band, cycles per pixel, 0..0.5.
    pub frequency_cycles_per_px: f64,
    /// Power relative to white noise that has the same variance as the field.
    pub power: f64,
    /// Standard error of the power, if the field is a sample of random fields with equal statistics, see [`radial_power`].
    pub standard_error: f64,
    /// Number of frequencies over which the power is averaged. A frequency and its negative have equal power, and both are counted.
    pub frequencies: usize,
}

/// Computes the radially averaged power spectrum of a field of `size` (width, height), given row by row. The frequencies from 0 to 0.5 cycles per
/// pixel are divided into `bands` bands of equal width. Let f be the field, m its mean, w the product of the periodic Hann windows of both axes, and
/// F the discrete Fourier transform of w (f - m). The power at frequency k is:
///
/// > P(k) = |F(k)|² / Σ w² (f - m)²
///
/// The power of a band is the mean of P over its frequencies. By Parseval's theorem, the mean of P over all frequencies is 1 for every field that is
/// not constant, so white noise has an expected power of 1 in every band. A constant field has a power of 0, up to rounding.
///
/// Frequencies of 0.5 and above are excluded. The nine frequencies that are at most one step of the transform from 0 on both axes are excluded, too,
/// because subtracting the mean removes power from them. (The window spreads this effect to all nine, but not to other frequencies.)
///
/// The standard error assumes a Gaussian field or many pixels. P(k) is then approximately exponentially distributed, so its standard deviation equals
/// its mean. A frequency and its negative have equal P, so only half of the frequencies count. Neighbouring frequencies are correlated by the window:
/// along an axis, the correlation of P(k) and P(k + d) is (2/3)² for d = 1 and (1/6)² for d = 2. For both axes together, this multiplies the variance
/// of the mean by (1 + 2 · 4/9 + 2 · 1/36)² = (35/18)².
///
/// # Errors
/// The lengths do not match, a value is NaN or infinite, `bands` is 0, or a band would be less than 4 frequencies wide. There can be at most (smaller
/// side / 8) bands.
pub fn radial_power(field: &[f32], size: [u32; 2], bands: usize) -> Result<Vec<Band>> {
    check(field, size)?;
    let [width, height] = size.map(|side| side as usize);
    let most = width.min(height) / 8;
    if !(1..=most).contains(&bands) {
        return Err(Error::Request(format!(
            "a spectrum of {width}x{height} values cannot have {bands} bands: choose at least 1, and at most 1 for every 8 pixels of the shorter side"
        )));
    }
    let mean = field.iter().map(|v| f64::from(*v)).sum::<f64>() / field.len() as f64;
    let hann = |n: usize| (0..n).map(|i| (std::f64::consts::PI * i as f64 / n as f64).sin().powi(2)).collect::<Vec<f64>>();
    let (across, down) = (hann(width), hann(height));
    let value = |(i, v): (usize, &f32)| Complex::new((f64::from(*v) - mean) * across[i % width] * down[i / width], 0.0);
    let mut rows: Vec<Complex<f64>> = field.iter().enumerate().map(value).collect();
    let energy: f64 = rows.iter().map(Complex::norm_sqr).sum();
    let mut planner = FftPlanner::new();
    planner.plan_fft_forward(width).process(&mut rows);
    let mut columns: Vec<Complex<f64>> = (0..rows.len()).map(|i| rows[i % height * width + i / height]).collect();
    planner.plan_fft_forward(height).process(&mut columns);

    /// The sums of a band: number of frequencies, sum of frequencies, sum of powers, sum of squared powers.
    type Sums = (usize, f64, f64, f64);
    let mut sums: Vec<Sums> = vec![(0, 0.0, 0.0, 0.0); bands];
    let steps = |k: usize, n: usize| k.min(n - k);
    for (i, amplitude) in columns.iter().enumerate() {
        let (kx, ky) = (steps(i / height, width), steps(i % height, height));
        let frequency = (kx as f64 / width as f64).hypot(ky as f64 / height as f64);
        if (kx <= 1 && ky <= 1) || frequency >= 0.5 {
            continue;
        }
        let power = if energy > 0.0 { amplitude.norm_sqr() / energy } else { 0.0 };
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 <= frequency < 0.5")]
        let band = &mut sums[((frequency * 2.0 * bands as f64) as usize).min(bands - 1)];
        *band = (band.0 + 1, band.1 + frequency, band.2 + power, band.3 + power * power);
    }
    let band = |(frequencies, frequency, power, squared): Sums| {
        // The divisor is not 0. Even the first band, which has the fewest frequencies, contains those that are between 1 and 4 steps of the transform
        // from 0.
        let n = frequencies as f64;
        Band {
            frequency_cycles_per_px: frequency / n,
            power: power / n,
            standard_error: 35.0 / 18.0 * (squared / n / n).sqrt(),
            frequencies,
        }
    };
    Ok(sums.into_iter().map(band).collect())
}

fn check(field: &[f32], size: [u32; 2]) -> Result<()> {
    if field.len() != area(size) {
        return Err(Error::Request(format!("a field of {}x{} was given {} values", size[0], size[1], field.len())));
    }
    match field.iter().position(|v| !v.is_finite()) {
        Some(index) => Err(Error::Request(format!("the field's value {index} (from 0, row by row) is {}", field[index]))),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use kernels::shared::hash::unit2;

    use super::*;

    const SIDE: usize = 256;
    const SIZE: [u32; 2] = [SIDE as u32; 2];
    const BANDS: usize = 16;
    /// Limit of the deviation from the expected value, in standard errors. 16 two-sided tests together have a level of 0.1 %, so each has a level of
    /// 1 - 0.999^(1/16) = 6.25e-5 (Šidák).
    const Z: f64 = 4.003;

    /// Returns uniform white noise.
    fn white(seed: u32) -> Vec<f32> {
        (0..SIDE * SIDE).map(|i| unit2((i % SIDE) as i32, (i / SIDE) as i32, seed, 9) as f32).collect()
    }

    /// Returns white noise whose cells have 4 x 4 pixels.
    fn blocks(seed: u32) -> Vec<f32> {
        (0..SIDE * SIDE).map(|i| unit2((i % SIDE / 4) as i32, (i / SIDE / 4) as i32, seed, 9) as f32).collect()
    }

    fn spectrum(field: &[f32]) -> Vec<Band> {
        radial_power(field, SIZE, BANDS).unwrap()
    }

    /// Tests the null hypothesis that the power is 1 in every band. For [`BANDS`] bands, the level of all tests together is 0.1 %.
    fn is_white(bands: &[Band]) -> bool {
        bands.iter().all(|b| (b.power - 1.0).abs() <= Z * b.standard_error)
    }

    #[test]
    fn white_noise_is_flat_and_nothing_else_is() {
        for seed in 0..4 {
            assert!(is_white(&spectrum(&white(seed))), "seed {seed}");
        }
        // An offset and a factor have no influence on the spectrum.
        let moved: Vec<f32> = white(1).iter().map(|v| 1000.0 + 64.0 * v).collect();
        for (a, b) in spectrum(&white(1)).iter().zip(spectrum(&moved)) {
            assert!((a.power - b.power).abs() < 1e-3);
        }
        assert!(!is_white(&spectrum(&blocks(1))));
        // Noise in cells of 2 x 1 pixels differs less from white noise than noise in cells of 4 x 4 pixels, but the test must find the difference.
        let weak: Vec<f32> = (0..SIDE * SIDE).map(|i| unit2((i % SIDE / 2) as i32, (i / SIDE) as i32, 1, 9) as f32).collect();
        assert!(!is_white(&spectrum(&weak)));
    }

    #[test]
    fn the_standard_error_is_what_chance_does() {
        const SEEDS: usize = 64;
        let all: Vec<Vec<Band>> = (0..SEEDS as u32).map(|seed| spectrum(&white(100 + seed))).collect();
        for band in 0..BANDS {
            let powers: Vec<f64> = all.iter().map(|bands| bands[band].power).collect();
            let mean = powers.iter().sum::<f64>() / SEEDS as f64;
            let spread = (powers.iter().map(|p| (p - mean).powi(2)).sum::<f64>() / (SEEDS - 1) as f64).sqrt();
            let stated = all.iter().map(|bands| bands[band].standard_error).sum::<f64>() / SEEDS as f64;
            // The standard deviation of 64 normal values has a relative standard error of 1 / sqrt(2 · 63) = 9 %. The 16 bands together have a level
            // of 0.1 %, so a deviation of 4.0 times this value is accepted. If the correlation that the window causes were ignored, the computed
            // standard error would be only about half of the real one.
            assert!((spread / stated - 1.0).abs() < Z / (2.0 * (SEEDS - 1) as f64).sqrt(), "band {band}: {spread} against {stated}");
            // The mean over 64 seeds has a standard error that is 8 times smaller than that of a single field, so smaller biases are found.
            assert!((mean - 1.0).abs() < Z * stated / (SEEDS as f64).sqrt(), "band {band}: {mean}");
        }
    }

    #[test]
    fn a_cosine_is_in_its_band_alone() {
        // The cosine has 100 cycles across the 256 pixels of a row and 36 across those of a column. Its frequency is 0.4152 cycles per pixel, which
        // lies in band 13. The window spreads the power by one step, which is still inside the band.
        let phase = |i: usize| std::f64::consts::TAU * (100 * (i % SIDE) + 36 * (i / SIDE)) as f64 / SIDE as f64;
        let field: Vec<f32> = (0..SIDE * SIDE).map(|i| phase(i).cos() as f32 + 3.0).collect();
        let bands = spectrum(&field);
        let expected = (SIDE * SIDE) as f64 / bands[13].frequencies as f64;
        assert!((bands[13].power / expected - 1.0).abs() < 1e-6, "{:?}", bands[13]);
        for (index, band) in bands.iter().enumerate() {
            assert!((band.frequency_cycles_per_px - (index as f64 + 0.5) / 32.0).abs() < 1e-2);
            // f32 rounds each value with a relative error of at most 6e-8. The power of these rounding errors is far below 1e-10 of the power of the
            // cosine.
            assert!(index == 13 || band.power < 1e-10, "band {index}: {}", band.power);
        }
        // The first band contains the frequencies that are less than 8 of 256 steps from 0. There are 193, and the nine around 0 are excluded.
        assert_eq!(bands[0].frequencies, 193 - 9);
        // The field need not be square. 44 cycles in 128 pixels are 0.34375 cycles per pixel, which lies in band 5.
        let field: Vec<f32> = (0..128 * 64).map(|i| (std::f64::consts::TAU * (44 * (i % 128)) as f64 / 128.0).cos() as f32).collect();
        let flat = radial_power(&field, [128, 64], 8).unwrap();
        assert!((flat[5].power * flat[5].frequencies as f64 / (128.0 * 64.0) - 1.0).abs() < 1e-6, "{flat:?}");
        // If the number of cycles is not an integer, power leaks into other bands. The window keeps this power below a thousandth of the total.
        let phase = |i: usize| std::f64::consts::TAU * (100.5 * (i % SIDE) as f64 + 36.5 * (i / SIDE) as f64) / SIDE as f64;
        let bands = spectrum(&(0..SIDE * SIDE).map(|i| phase(i).cos() as f32).collect::<Vec<_>>());
        let elsewhere: f64 = bands.iter().enumerate().filter(|(i, _)| *i != 13).map(|(_, b)| b.power * b.frequencies as f64).sum();
        assert!(elsewhere < 1e-3 * (SIDE * SIDE) as f64, "{elsewhere}");
    }

    #[test]
    fn block_noise_has_the_spectrum_of_its_cell() {
        // Along each axis, noise in cells of b pixels has the power sin²(pi b f) / (b sin²(pi f)). This is the squared transform of a box of b
        // pixels, divided by b.
        let axis = |k: usize| {
            let f = std::f64::consts::PI * k as f64 / SIDE as f64;
            if k == 0 { 4.0 } else { (4.0 * f).sin().powi(2) / (4.0 * f.sin().powi(2)) }
        };
        let mut expected = [(0.0, 0.0); BANDS];
        for i in 0..SIDE * SIDE {
            let k = [i % SIDE, i / SIDE].map(|k| k.min(SIDE - k));
            let frequency = (k[0] as f64).hypot(k[1] as f64) / SIDE as f64;
            if frequency < 0.5 && k.iter().any(|k| *k > 1) {
                let band = &mut expected[(frequency * 32.0) as usize];
                *band = (band.0 + axis(k[0]) * axis(k[1]), band.1 + 1.0);
            }
        }
        const SEEDS: u32 = 16;
        let all: Vec<Vec<Band>> = (0..SEEDS).map(|seed| spectrum(&blocks(seed))).collect();
        for (index, (sum, count)) in expected.iter().enumerate() {
            let expected = sum / count;
            let mean = all.iter().map(|bands| bands[index].power).sum::<f64>() / f64::from(SEEDS);
            // The computed standard error assumes that the powers of distant frequencies are independent. Here only 64 x 64 values of the field are
            // independent, so groups of up to 16 frequencies have nearly proportional powers. The true standard error is therefore up to sqrt(16) = 4
            // times larger.
            let error = 4.0 * all.iter().map(|bands| bands[index].standard_error).sum::<f64>() / f64::from(SEEDS).powf(1.5);
            assert!((mean - expected).abs() < Z * error, "band {index}: {mean} is not {expected} +- {error}");
        }
        let one = &all[0];
        assert!(one[0].power > 8.0 && one[BANDS - 1].power < 1.0, "the spectrum of block noise is not low-pass: {one:?}");
    }

    #[test]
    fn high_passed_noise_lacks_low_bands() {
        // The filter subtracts from each value the mean of the 3 x 3 values around it, with wrap-around at the borders. Its frequency response is 1 -
        // D(kx) D(ky), where D(k) = (1 + 2 cos k) / 3.
        let noise = white(5);
        let at = |x: usize, y: usize| noise[y % SIDE * SIDE + x % SIDE];
        let around = |x: usize, y: usize| (0..9).map(|n| at(x + SIDE - 1 + n % 3, y + SIDE - 1 + n / 3)).sum::<f32>() / 9.0;
        let high: Vec<f32> = (0..SIDE * SIDE).map(|i| at(i % SIDE, i / SIDE) - around(i % SIDE, i / SIDE)).collect();
        let bands = spectrum(&high);
        assert!(bands[0].power < 1e-3 && bands[1].power < 0.02, "{bands:?}");
        assert!(bands[BANDS - 1].power > 1.2);
        assert!(spectrum(&noise)[0].power > 0.5, "the unfiltered noise has no power in the lowest band");
    }

    #[test]
    fn spectra_of_odd_sizes_and_of_nothing() {
        let size = [135u32, 96];
        let field: Vec<f32> = (0..area(size)).map(|i| unit2((i % 135) as i32, (i / 135) as i32, 2, 9) as f32).collect();
        let bands = radial_power(&field, size, 12).unwrap();
        assert!(is_white(&bands), "{bands:?}");
        assert!(bands.iter().all(|b| b.frequencies > 0));
        for band in radial_power(&vec![7.0; area(size)], size, 12).unwrap() {
            assert_eq!((band.power, band.standard_error), (0.0, 0.0));
        }
        assert!(radial_power(&field, size, 13).is_err());
        assert!(radial_power(&field, size, 0).is_err());
        assert!(radial_power(&field[1..], size, 4).is_err());
        assert!(radial_power(&[], [0, 0], 1).is_err());
        let mut broken = field;
        broken[17] = f32::NAN;
        let refused = radial_power(&broken, size, 4).unwrap_err().to_string();
        assert!(refused.contains("value 17") && refused.contains("NaN"), "{refused}");
        // The smallest possible input: a field of 8 x 8 values and one band.
        let least: Vec<f32> = (0..64).map(|i| unit2(i, 0, 1, 9) as f32).collect();
        assert!(radial_power(&least, [8, 8], 1).unwrap()[0].power.is_finite());
    }
}

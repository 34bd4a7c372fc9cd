//! Statistical tests of a null hypothesis (H0), and a random number generator that is independent of the noise under test.

use statrs::distribution::{Binomial, ChiSquared, ContinuousCDF, DiscreteCDF, Normal};

pub use crate::significance::sidak;

/// The random number generator SplitMix64 (Steele et al. 2014). Any state is valid.
#[derive(Clone, Debug)]
pub struct Random(pub u64);

impl Random {
    /// Returns a number of 64 random bits.
    pub fn word(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Returns a number that is uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.word() >> 11) as f64 / 9_007_199_254_740_992.0
    }

    /// Returns a number that is uniform between `low` and `high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Returns a number that is almost uniform in 0..`n`; `n` must be above 0.
    #[allow(clippy::cast_possible_truncation, reason = "the result is less than `n`, which is a usize")]
    pub fn below(&mut self, n: usize) -> usize {
        (self.word() % n as u64) as usize
    }

    /// Returns a direction that is uniform on the unit sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        let z = self.between(-1.0, 1.0);
        let phi = self.between(0.0, std::f64::consts::TAU);
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    }
}

fn chi_square_p(statistic: f64, freedom: usize) -> f64 {
    ChiSquared::new(freedom as f64).expect("freedom > 0").sf(statistic)
}

/// Returns the two-sided p-value of a normal deviate.
pub fn normal_p(z: f64) -> f64 {
    2.0 * Normal::standard().cdf(-z.abs())
}

/// Returns the positive normal deviate whose two-sided p-value is `p`, which lies in 0..1.
pub fn normal_bound(p: f64) -> f64 {
    -Normal::standard().inverse_cdf(p / 2.0)
}

/// Returns the p-value of the chi-square test. H0: the counts have the expected means. The degrees of freedom are reduced by `fixed`, the number of
/// linear constraints on the counts.
pub fn goodness_p(counts: &[f64], expected: &[f64], fixed: usize) -> f64 {
    let statistic = counts.iter().zip(expected).map(|(c, e)| (c - e) * (c - e) / e).sum();
    chi_square_p(statistic, counts.len() - fixed)
}

/// Returns the index of the bin that contains `x`. The range [0, 1) is divided into `bins` equal bins.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 <= x < 1")]
fn bin(x: f64, bins: usize) -> usize {
    ((x * bins as f64) as usize).min(bins - 1)
}

/// Returns the p-value of a chi-square test with 256 bins. H0: the samples are uniform in [0, 1).
pub fn uniform_bins_p(samples: &[f64]) -> f64 {
    let mut counts = [0.0; 256];
    for &x in samples {
        counts[bin(x, 256)] += 1.0;
    }
    goodness_p(&counts, &[samples.len() as f64 / 256.0; 256], 1)
}

/// Returns the asymptotic p-value of the Kolmogorov-Smirnov test with Stephens' correction. H0: the samples are uniform in [0, 1).
pub fn uniform_ks_p(samples: &[f64]) -> f64 {
    let mut sorted = samples.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    let n = sorted.len() as f64;
    let distance = sorted.iter().enumerate().map(|(i, x)| (x - i as f64 / n).max((i + 1) as f64 / n - x)).fold(0.0, f64::max);
    let lambda = (n.sqrt() + 0.12 + 0.11 / n.sqrt()) * distance;
    let term = |j: i32| f64::from(1 - 2 * ((j + 1) % 2)) * (-2.0 * f64::from(j * j) * lambda * lambda).exp();
    if lambda < 0.2 { 1.0 } else { (2.0 * (1..=100).map(term).sum::<f64>()).clamp(0.0, 1.0) }
}

/// Returns the p-value of a chi-square test with 16 x 16 equal cells. H0: the two numbers of a pair are independent, and each is uniform in [0, 1).
pub fn independent_p(pairs: &[(f64, f64)]) -> f64 {
    let mut counts = [0.0; 256];
    for &(a, b) in pairs {
        counts[bin(a, 16) * 16 + bin(b, 16)] += 1.0;
    }
    // H0 includes that each number of a pair is uniform, so the total is the only constraint.
    goodness_p(&counts, &[pairs.len() as f64 / 256.0; 256], 1)
}

/// Returns the p-value of a two-sided normal test. H0: the two numbers of a pair, each uniform in [0, 1), are not correlated.
pub fn uncorrelated_p(pairs: &[(f64, f64)]) -> f64 {
    let sum: f64 = pairs.iter().map(|(a, b)| (a - 0.5) * (b - 0.5)).sum();
    normal_p(sum * 12.0 / (pairs.len() as f64).sqrt())
}

/// Returns the p-value of a two-sided exact binomial test. H0: each of `of` events has the probability `alpha`, in 0..=1. `covered` is the number of
/// events that occurred.
pub fn coverage_p(covered: u64, of: u64, alpha: f64) -> f64 {
    let binomial = Binomial::new(alpha, of).expect("a probability");
    let above = if covered == 0 { 1.0 } else { binomial.sf(covered - 1) };
    (2.0 * binomial.cdf(covered).min(above)).min(1.0)
}

/// Returns the number of distinct thresholds after rounding to 24 bits. Most thresholds have 24 bits before rounding. Hashed noise can blend the
/// random numbers of two cells of different size; such thresholds may have more bits.
pub fn distinct(thresholds: &[f64]) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 <= threshold < 1")]
    let mut words: Vec<u32> = thresholds.iter().map(|u| (u * 16_777_216.0).round() as u32).collect();
    words.sort_unstable();
    words.dedup();
    words.len()
}

/// Returns the p-value of the number of distinct values. H0: the values are `n` independent random numbers of 24 bits. The normal approximation uses
/// the exact mean and variance.
pub fn distinct_p(distinct: usize, n: usize) -> f64 {
    const WORDS: f64 = 16_777_216.0;
    // `one` is the probability that a given value does not occur. `two` is the probability that neither of two given values occurs.
    let [one, two] = [1.0, 2.0].map(|k: f64| (n as f64 * (-k / WORDS).ln_1p()).exp());
    let variance = WORDS * (one - two) + WORDS * WORDS * (two - one * one);
    normal_p((distinct as f64 - WORDS * (1.0 - one)) / variance.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn collisions_are_as_many_as_draws_have() {
        // Simulates 32 samples of a million numbers each. Under H0 the deviates are standard normal. The mean of their 32 squares then has the
        // expected value 1 and a standard deviation of sqrt(2 / 32) = 0.25.
        let deviates: Vec<f64> = (0..32)
            .map(|seed| {
                let mut random = Random(seed << 32);
                let units: Vec<f64> = (0..1_000_000).map(|_| (random.word() >> 40) as f64 / 16_777_216.0).collect();
                normal_bound(distinct_p(distinct(&units), units.len()))
            })
            .collect();
        let square = deviates.iter().map(|z| z * z).sum::<f64>() / 32.0;
        assert!((0.3..2.0).contains(&square), "{square}: {deviates:?}");
        // If numbers have 23 random bits instead of 24, fewer values are distinct, and the test must reject H0.
        let mut random = Random(1);
        let coarse: Vec<f64> = (0..1_000_000).map(|_| (random.word() >> 41) as f64 / 8_388_608.0).collect();
        assert!(distinct_p(distinct(&coarse), coarse.len()) < 1e-12);
    }

    #[test]
    fn each_test_rejects_what_it_is_for() {
        const N: usize = 20_000;
        let mut random = Random(3);
        let uniform: Vec<f64> = (0..N).map(|_| random.unit()).collect();
        // The samples in `short` do not cover the last thirtieth of the range.
        let short: Vec<f64> = uniform.iter().map(|u| u * (29.0 / 30.0)).collect();
        assert!(uniform_bins_p(&uniform) > 1e-3 && uniform_bins_p(&short) < 1e-6);
        assert!(uniform_ks_p(&uniform) > 1e-3 && uniform_ks_p(&short) < 1e-6);
        // The pairs in `same`, `leaning` and `folded` are dependent. In `same`, the second number equals the first. In `leaning`, it is a sum that
        // contains a tenth of the first. In `folded`, it is a function of the first, but not correlated with it.
        let pairs = |of: &dyn Fn(f64, f64) -> f64| uniform.windows(2).map(|w| (w[0], of(w[0], w[1]))).collect::<Vec<_>>();
        let [other, same, leaning] = [pairs(&|_, b| b), pairs(&|a, _| a), pairs(&|a, b| 0.9 * b + 0.1 * a)];
        let folded = pairs(&|a, _| (2.0 * a - 1.0).abs());
        assert!(independent_p(&other) > 1e-3 && independent_p(&same) < 1e-6 && independent_p(&folded) < 1e-6);
        assert!(uncorrelated_p(&other) > 1e-3 && uncorrelated_p(&leaning) < 1e-6 && uncorrelated_p(&folded) > 1e-3);
        // Negative control: if the share of covered samples is 0.12 instead of 0.1, the test must reject H0.
        let covered = |alpha: f64| uniform.iter().filter(|u| **u < alpha).count() as u64;
        assert!(coverage_p(covered(0.1), N as u64, 0.1) > 1e-3 && coverage_p(covered(0.12), N as u64, 0.1) < 1e-6);
        assert!(coverage_p(0, 10, 0.0) == 1.0 && coverage_p(10, 10, 0.5) < 0.01);
    }

    #[test]
    fn families_share_their_level() {
        assert!((sidak(1) - 1e-3).abs() < 1e-15);
        assert!((1.0 - (1.0 - sidak(1000)).powi(1000) - 1e-3).abs() < 1e-12);
    }
}

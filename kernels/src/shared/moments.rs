//! Mean and variance of a stream of numbers, updated with one number at a time.
//!
//! Welford's recurrence (*Technometrics* 4(3), 1962) with compensated sums (Knuth, *The Art of Computer Programming* 2, section 4.2.2, theorem B).
//! With both, f32 is precise enough for a stream of 1e6 numbers that has a mean of 1e6 and a variance of 1e-6. A sample is given as the sum of two
//! parts, because neighbouring f32 values near 1e6 are 0.06 apart, which is much more than the standard deviation of 1e-3.

use super::real::Real;

/// The mean and variance of a stream so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments<T> {
    /// Mean, in two parts.
    pub mean: [T; 2],
    /// Sum of squared differences from the mean, in two parts.
    pub squares: [T; 2],
    /// Number of samples.
    pub count: u32,
}

impl<T: Real> Moments<T> {
    /// The moments before the first sample.
    pub fn new() -> Moments<T> {
        Moments { mean: [T::zero(); 2], squares: [T::zero(); 2], count: 0 }
    }

    /// Adds a sample in two parts (high, low). In WGSL: `moments_add`. A sample that is not finite, or farther than 1e15 from the mean so
    /// far, counts as the mean. With this limit, the sum of a million squares fits f32.
    pub fn add(&mut self, sample: [T; 2]) {
        self.count = self.count.saturating_add(1);
        let n = T::of(f64::from(self.count));
        let difference = (sample[0] - self.mean[0]) + (sample[1] - self.mean[1]);
        if self.count == 1 {
            // Both parts are kept: their rounded sum would lose the lower part.
            self.mean = if difference.abs() <= T::of(1e15) { sample } else { [T::zero(); 2] };
            return;
        }
        let delta = if difference.abs() <= T::of(1e15) { difference } else { T::zero() };
        self.mean = sum(self.mean, delta / n);
        self.squares = sum(self.squares, delta * (delta * ((n - T::one()) / n)));
    }

    /// The mean.
    pub fn mean(&self) -> f64 {
        self.mean[0].to_f64() + self.mean[1].to_f64()
    }

    /// Unbiased variance; 0 for fewer than two samples. In WGSL: `moments_variance`.
    pub fn variance(&self) -> f64 {
        if self.count < 2 { 0.0 } else { (self.squares[0].to_f64() + self.squares[1].to_f64()).max(0.0) / f64::from(self.count - 1) }
    }

    /// Standard error of the mean of independent samples; `None` for fewer than two.
    pub fn standard_error(&self) -> Option<f64> {
        (self.count >= 2).then(|| (self.variance() / f64::from(self.count)).sqrt())
    }
}

/// Sum of a two-part number and a plain number. In WGSL: `moments_sum`.
fn sum<T: Real>(a: [T; 2], b: T) -> [T; 2] {
    let total = a[0] + b;
    let part = total - a[0];
    let lost = (a[0] - (total - part)) + (b - part);
    let low = a[1] + lost;
    let high = total + low;
    [high, low - (high - total)]
}

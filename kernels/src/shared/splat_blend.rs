//! Weights of the four splat texels around a point: bilinear weights, modified by the heights of the materials.
//!
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018. The form used here is w'_i = w_i 2^(k h_i), normalised, where w are the bilinear
//! weights, h the heights of the materials and k the sharpness. Because of the factor w_i, w'_i goes to 0 where w_i does: as the point moves, texels
//! come and go without a jump. Texels are in the order 00, 10, 01, 11 (x first).

use super::real::Real;
use super::{bounded, usable};

/// Heights are clamped to ± this value.
pub const MAX_HEIGHT: f64 = 1024.0;
/// Sharpness is clamped to 0..=this value.
pub const MAX_SHARPNESS: f64 = 1e4;
/// A bilinear weight of at most this value counts as zero, so that quotients of weights stay in the range of f32.
pub const MIN_WEIGHT: f64 = 1e-30;

/// Bilinear weights of a point at `fraction`, [0, 1]², between the texels.
pub fn bilinear<T: Real>(fraction: [T; 2]) -> [T; 4] {
    let [x, y] = fraction.map(|f| bounded(f, 0.0, 1.0));
    let one = T::one();
    [(one - x) * (one - y), x * (one - y), (one - x) * y, x * y]
}

/// Weights modified by heights, summing to 1. `sharpness` is k >= 0, where 0 gives plain bilinear weights. `heights` may have any unit; the unit of k
/// is its inverse.
pub fn weights<T: Real>(fraction: [T; 2], heights: [T; 4], sharpness: T) -> [T; 4] {
    let w = bilinear(fraction);
    let k = bounded(sharpness, 0.0, MAX_SHARPNESS);
    let h = heights.map(|h| bounded(usable(h), -MAX_HEIGHT, MAX_HEIGHT));
    let used = |i: &usize| w[*i] > T::of(MIN_WEIGHT);
    // The terms are divided by the largest term, which is then 1: nothing overflows, and the sum cannot underflow.
    let score = |i: usize| w[i].log2() + k * h[i];
    let top = (0..4)
        .filter(used)
        .reduce(|best, i| if score(i) > score(best) { i } else { best })
        .expect("four weights that sum to 1 are not all tiny");
    let bent: [T; 4] = std::array::from_fn(|i| if used(&i) { (w[i] / w[top]) * (k * (h[i] - h[top])).exp2() } else { T::zero() });
    let sum = bent.iter().fold(T::zero(), |s, &x| s + x);
    bent.map(|x| x / sum)
}

/// Computes a mean of four values with the weights of [`weights`], one value at a time, for callers that cannot store all four values. After each
/// call of [`Run::add`], first multiply the sum so far by `keep`, then add the value times `share`. Accumulate the sum of the shares in the same way;
/// it is at least 1. At the end, divide the sum of the values by the sum of the shares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Run<T> {
    score: T,
    weight: T,
    height: T,
    /// Factor on the sum so far.
    pub keep: T,
    /// Factor on the value whose weight was just given to [`Run::add`].
    pub share: T,
}

impl<T: Real> Run<T> {
    /// The state before the first value.
    pub fn start() -> Run<T> {
        Run { score: T::of(-1e30), weight: T::zero(), height: T::zero(), keep: T::one(), share: T::zero() }
    }

    /// Adds the weight of one value: its bilinear `weight`, 0..=1, modified by `height`. `height` and `sharpness` are as in [`weights`].
    #[must_use]
    pub fn add(self, weight: T, height: T, sharpness: T) -> Run<T> {
        let w = bounded(weight, 0.0, 1.0);
        if w <= T::of(MIN_WEIGHT) {
            return Run { keep: T::one(), share: T::zero(), ..self };
        }
        let h = bounded(usable(height), -MAX_HEIGHT, MAX_HEIGHT);
        let k = bounded(sharpness, 0.0, MAX_SHARPNESS);
        let score = w.log2() + k * h;
        // The term w 2^(k h), divided by the largest term so far, whose w and h are `winner`.
        let ratio = |w: T, h: T, winner: (T, T)| (w / winner.0) * (k * (h - winner.1)).exp2();
        if score > self.score {
            let keep = if self.weight > T::zero() { ratio(self.weight, self.height, (w, h)) } else { T::zero() };
            Run { score, weight: w, height: h, keep, share: T::one() }
        } else {
            Run { keep: T::one(), share: ratio(w, h, (self.weight, self.height)), ..self }
        }
    }
}

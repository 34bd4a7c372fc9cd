//! Choice of an index with probability proportional to its weight, by inverting the cumulative sum.
//!
//! Weights need not sum to 1; negative weights and NaN count as 0. An index of weight 0 is never chosen, except index 0 if all weights are 0. Each
//! random decision of a pixel needs a number `u` of its own, because decisions that share one `u` would not be independent.

use super::bounded;
use super::real::Real;

/// Chooses one of N indices by weight; `u` is uniform in [0, 1).
pub fn select<T: Real, const N: usize>(weights: [T; N], u: T) -> usize {
    let weights = weights.map(|w| bounded(w, 0.0, 1e30));
    let total = weights.iter().fold(T::zero(), |sum, &w| sum + w);
    let target = bounded(u, 0.0, 1.0) * total;
    let mut below = T::zero();
    let mut chosen = 0;
    for (index, &weight) in weights.iter().enumerate() {
        if weight > T::zero() {
            chosen = index;
            below = below + weight;
            if target < below {
                break;
            }
        }
    }
    chosen
}

/// Chooses one of four indices by weight. In WGSL: `select_of_4`.
pub fn of_4<T: Real>(weights: [T; 4], u: T) -> usize {
    select(weights, u)
}

/// Chooses one of three indices by weight. In WGSL: `select_of_3`.
pub fn of_3<T: Real>(weights: [T; 3], u: T) -> usize {
    select(weights, u)
}

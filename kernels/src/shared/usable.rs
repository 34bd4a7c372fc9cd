//! Numbers that can be computed with.

use super::real::Real;

/// `x` within `low..=high`; `low` where it is not a number. What is denormal in f32 counts as 0, since a device may take it for that.
pub(super) fn bounded<T: Real>(x: T, low: f64, high: f64) -> T {
    let (low, high) = (T::of(low), T::of(high));
    let x = if x.abs() < T::of(f64::from(f32::MIN_POSITIVE)) { T::zero() } else { x };
    if x >= high {
        high
    } else if x > low {
        x
    } else {
        low
    }
}

/// `x` where its magnitude is at most 1e30, zero elsewhere: what squares and sums of a few still hold in f32.
pub(super) fn usable<T: Real>(x: T) -> T {
    if x.abs() <= T::of(1e30) { x } else { T::zero() }
}

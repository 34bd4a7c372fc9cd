//! Guards that keep NaN, infinity and very large numbers out of computations.

use super::real::Real;

/// `x` clamped to `low..=high`; NaN gives `low`. Numbers that are denormal in f32 count as 0, because a device may flush them to zero.
#[inline]
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

/// `x` if its magnitude is at most 1e30, and zero otherwise (also if `x` is NaN). Sums of a few such numbers still fit f32.
#[inline]
pub(super) fn usable<T: Real>(x: T) -> T {
    if x.abs() <= T::of(1e30) { x } else { T::zero() }
}

//! The two projections that a surface faces most, with weights that drop the third projection without a seam.
//!
//! Source: Quilez, *Biplanar mapping*, 2020. An axis has weight 0 if the normal's component along it is at most 1/√3 in size; above that size, the
//! weight grows. Where the middle and the smallest component are equal in size, the dropped projection changes. Both components are then at most
//! 1/√3 and have weight 0, so the weights do not jump. They jump only on the eight diagonals, where all three components are equal in size. With
//! sharpness 0, they also jump where a component passes 1/√3, because the weight of a larger component does not depend on its size.

use super::bounded;
use super::octahedral::unit;
use super::real::Real;

/// Sharpness is clamped to 0..=this value.
pub const MAX_SHARPNESS: f64 = 1e4;

/// The two axes along which the normal has its largest components, the axis with the lower index first, and the weights of these axes. The weights
/// sum to 1. In WGSL: `biplanar_projections`.
///
/// `n` may have any length; a vector without usable direction counts as the z axis. For a unit vector, the weight of axis i is proportional to
/// ((|n_i| - 1/√3) / (1 - 1/√3))^(k/8), where k >= 0 is `sharpness`. A component of at most 1/√3 has weight 0. If this is so for both axes, the first
/// one has all the weight.
pub fn projections<T: Real>(n: [T; 3], sharpness: T) -> ([u32; 2], [T; 2]) {
    let a = unit(n).map(T::abs);
    let dropped = if a[0] <= a[1] && a[0] <= a[2] {
        0
    } else if a[1] <= a[2] {
        1
    } else {
        2
    };
    let axes = [[1, 2], [0, 2], [0, 1]][dropped];
    let diagonal = T::of(1.0 / 3.0_f64.sqrt());
    let above = axes.map(|axis| (a[axis] - diagonal).max(T::zero()));
    let top = above[0].max(above[1]);
    let numbers = axes.map(|axis| u32::try_from(axis).expect("at most 2"));
    if top <= T::zero() {
        return (numbers, [T::one(), T::zero()]);
    }
    let k = bounded(sharpness, 0.0, MAX_SHARPNESS) / T::of(8.0);
    // Here, 0^0 counts as 0; `powf` would return 1.
    let w = above.map(|x| if x > T::zero() { (x / top).powf(k) } else { T::zero() });
    (numbers, w.map(|x| x / (w[0] + w[1])))
}

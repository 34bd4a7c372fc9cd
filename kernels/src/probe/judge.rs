//! Compares results with the truth, and draws random rows for the comparison.
//!
//! The truth is the reference in f64. Input values are f32, so that all implementations see the same input. The tolerances of most probes follow from
//! the accuracy that WGSL demands (W3C, *WebGPU Shading Language*, "Floating Point Accuracy"): sums, differences and products are rounded once. The
//! error of `x / y` is at most 2.5 ULP, that of `inverseSqrt` 2 ULP, and `sqrt` is computed as 1 / `inverseSqrt`. The error of `log2` is at most
//! 2^-21 in [0.5, 2] and 3 ULP elsewhere, that of `exp2(x)` 3 + 2 |x| ULP, and `pow` is computed from these two. A product and a sum may be fused,
//! and denormals may be flushed to zero. Where a function amplifies rounding errors, the tolerance of a row grows with the condition number of the
//! function at this row, which is computed in f64.
//!
//! Some results are discontinuous, such as an index, a code or a cell: they change at a threshold of the input. If a row is closer to a threshold
//! than the tolerance, the results on both sides of the threshold are accepted.

use std::collections::BTreeSet;

use crate::shared::hash;
use crate::shared::octahedral;
use crate::shared::real::{add, dot, length, scale, sub};

/// One ULP (unit in the last place) of the number 1. The relative error of one correctly rounded operation is at most half of it.
pub const EPS: f64 = f32::EPSILON as f64;

/// Tolerance of the components of a unit vector, which are at most 1, and of its point on the octahedron's square: 16 ULP. The unit vector has an
/// error of 11 ULP: the division by the largest component (2.5 ULP), the dot product (three roundings, 1.5 ULP), the square root (4.5 ULP) and the
/// division by the length (2.5 ULP). The division and the sums that map the vector to the square add 5 ULP.
pub const UNIT_TOLERANCE: f64 = 16.0 * EPS;

/// Tolerance of a result of a few operations, none of which cancels leading digits: 16 ULP.
pub const FEW: f64 = 16.0 * EPS;

/// The outcome of comparing one row.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Verdict {
    /// Within the tolerance. The number is the largest error as a share of the tolerance.
    Agrees(f64),
    /// The result belongs to the other side of a threshold, and the distance of the row from this threshold is within the tolerance.
    OtherSide,
    /// Outside the tolerance, and no threshold explains the difference.
    Differs,
}

/// Draws the random numbers of a row. They depend on the index of the row, not on the order of rows.
#[derive(Clone, Debug)]
pub struct Draw {
    /// Index of the row.
    pub row: u32,
    /// Number of words drawn so far.
    pub column: u32,
    /// Number of the table. Each table has its own sequence of random numbers.
    pub table: u32,
}

impl Draw {
    /// A word of 32 random bits.
    pub fn word(&mut self) -> u32 {
        self.column += 1;
        hash::pcg4d([self.row, self.column, self.table, 2018])[0]
    }

    /// A number in 0..1.
    pub fn unit(&mut self) -> f64 {
        f64::from(self.word()) / 4_294_967_296.0
    }

    /// A number in `low`..`high`.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A unit vector, uniform on the sphere.
    pub fn direction(&mut self) -> [f64; 3] {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    }

    /// A random unit vector. The angle between it and the unit vector `n` is `angle` radians.
    pub fn leaning(&mut self, n: [f64; 3], angle: f64) -> [f64; 3] {
        let other = self.direction();
        let across = octahedral::unit(sub(other, scale(n, dot(other, n))));
        add(scale(n, angle.cos()), scale(across, angle.sin()))
    }

    /// A vector of random direction whose length is 2^`low`..2^`high`.
    pub fn vector(&mut self, low: f64, high: f64) -> [f64; 3] {
        let length = self.between(low, high).exp2();
        self.direction().map(|x| x * length)
    }

    /// A whole number in 0..`below`.
    pub fn whole(&mut self, below: u32) -> f64 {
        f64::from(self.word() % below)
    }
}

/// Compares exactly, for results that are integers or exact conversions of integers.
pub fn equal(_: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    if got == want { Verdict::Agrees(0.0) } else { Verdict::Differs }
}

/// Largest |a - b| of two numbers at the same index.
pub(super) fn farthest(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Length of the difference of two vectors, as a share of the length of `want`.
pub(super) fn relative(got: &[f64], want: &[f64]) -> f64 {
    let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|x| x * x).sum::<f64>().sqrt();
    norm(&mut got.iter().zip(want).map(|(g, w)| g - w)) / norm(&mut want.iter().copied()).max(f64::from(f32::MIN_POSITIVE))
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Angle between two vectors, degrees. It is computed with the cross product, which is accurate at small angles.
pub(super) fn angle_deg(a: [f64; 3], b: [f64; 3]) -> f64 {
    length(cross(a, b)).atan2(dot(a, b)).to_degrees()
}

/// Scales the vector in the three columns that begin at `at`, so that its length is `wanted`.
pub(super) fn set_length(row: &mut [f64], at: usize, wanted: f64) {
    let unit = octahedral::unit(three(row, at));
    set_direction_and_length(row, at, unit, wanted);
}

/// Writes the unit vector `direction` to the three columns that begin at `at`.
pub(super) fn set_direction(row: &mut [f64], at: usize, direction: [f64; 3]) {
    row[at..at + 3].copy_from_slice(&direction);
}

/// Writes the unit vector `direction`, scaled to the length `wanted`, to the three columns that begin at `at`.
pub(super) fn set_direction_and_length(row: &mut [f64], at: usize, direction: [f64; 3], wanted: f64) {
    row[at..at + 3].copy_from_slice(&direction.map(|x| x * wanted));
}

/// A random unit vector. The angle between it and one of the axes ±x, ±y, ±z is `degrees`.
pub(super) fn from_axis(degrees: f64, d: &mut Draw) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (s, c) = d.between(0.0, std::f64::consts::TAU).sin_cos();
    let axis = d.word() as usize % 3;
    let sign = if d.whole(2) < 0.5 { 1.0 } else { -1.0 };
    let mut v = [0.0; 3];
    (v[axis], v[(axis + 1) % 3], v[(axis + 2) % 3]) = (sign * cos, sin * c, sin * s);
    v
}

/// A random unit vector whose z is at most 0. The angle between it and the plane x = 0 is `degrees`. Where z is below 0, the octahedral map is
/// discontinuous at this plane.
pub(super) fn from_seam(degrees: f64, d: &mut Draw) -> [f64; 3] {
    let (sin, cos) = degrees.to_radians().sin_cos();
    let (s, c) = d.between(0.0, std::f64::consts::PI).sin_cos();
    let side = if d.whole(2) < 0.5 { 1.0 } else { -1.0 };
    [side * sin, cos * c, -cos * s]
}

/// Compares numbers with an absolute tolerance. All numbers must be finite: NaN would count as agreeing.
pub fn close(got: &[f64], want: &[f64], tolerance: f64) -> Verdict {
    let share = got.iter().zip(want).map(|(g, w)| (g - w).abs() / tolerance).fold(0.0, f64::max);
    if share <= 1.0 { Verdict::Agrees(share) } else { Verdict::Differs }
}

/// Combines two verdicts into the worse one.
pub fn both(a: Verdict, b: Verdict) -> Verdict {
    use Verdict::{Agrees, Differs, OtherSide};
    match (a, b) {
        (Differs, _) | (_, Differs) => Differs,
        (OtherSide, _) | (_, OtherSide) => OtherSide,
        (Agrees(a), Agrees(b)) => Agrees(a.max(b)),
    }
}

/// Compares two lists of weights with keys. Weights with equal keys are added up and compared; a key that one list lacks has weight 0 there. If the
/// sets of keys differ but the weights agree, the verdict is [`Verdict::OtherSide`].
pub(super) fn keyed(got: &[(u64, f64)], want: &[(u64, f64)], tolerance: f64) -> Verdict {
    let weight = |of: &[(u64, f64)], key: u64| of.iter().filter(|(k, _)| *k == key).map(|(_, w)| w).sum::<f64>();
    let keys: BTreeSet<u64> = got.iter().chain(want).map(|(key, _)| *key).collect();
    let side = |of: &[(u64, f64)]| keys.iter().map(|&key| weight(of, key)).collect::<Vec<_>>();
    let verdict = close(&side(got), &side(want), tolerance);
    let same = |of: &[(u64, f64)]| of.iter().map(|(key, _)| *key).collect::<BTreeSet<_>>();
    if verdict != Verdict::Differs && same(got) != same(want) { Verdict::OtherSide } else { verdict }
}

/// Error bound of a level, which is the log2 of a number with a relative error of `ulps` ULP. It is the sum of two errors: the error of the function
/// `log2`, and the relative error of the number divided by ln 2.
pub(super) fn level_error(level: f64, ulps: f64) -> f64 {
    2.0_f64.powi(-21) + EPS * (3.0 * level.abs() + 1.443 * ulps)
}

pub(super) fn three(row: &[f64], at: usize) -> [f64; 3] {
    [row[at], row[at + 1], row[at + 2]]
}

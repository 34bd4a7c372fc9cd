//! Unit vectors as points on the octahedron, which is unfolded to the square [-1, 1]². A point has two coordinates.
//!
//! Source: Cigolle et al., *A Survey of Efficient Representations for Independent Unit Vectors*, JCGT 3(2), 2014. A *code* stores a point of the
//! octahedron's square as two integers of b bits, one per coordinate. The integers are `0..=2 half` with half = 2^(b-1) - 1. Their number is odd, so
//! a code can store the coordinate 0 exactly, and therefore the six axes.

use super::real::{Real, dot, sub};
use super::{bounded, usable};

/// Unit vector along `v`; the z axis if `v` has no usable direction (if all components are at most 1e-30 in magnitude, or if one component is above
/// 1e30 in magnitude or NaN).
pub fn unit<T: Real>(v: [T; 3]) -> [T; 3] {
    let size = v.iter().fold(T::zero(), |m, x| m.max(x.abs()));
    if !(v.iter().all(|x| x.abs() <= T::of(1e30)) && size > T::of(1e-30)) {
        return [T::zero(), T::zero(), T::one()];
    }
    // The vector is scaled first, because squares of large or small components would leave f32's range.
    let scaled = v.map(|x| x / size);
    let length = dot(scaled, scaled).sqrt();
    scaled.map(|x| x / length)
}

/// Maps a direction to the square [-1, 1]². The vector may have any length. A vector without usable direction counts as the z axis.
pub fn encode<T: Real>(n: [T; 3]) -> [T; 2] {
    let [x, y, z] = unit(n);
    let sum = x.abs() + y.abs() + z.abs();
    let (x, y) = (x / sum, y / sum);
    if z < T::zero() { fold([x, y]) } else { [x, y] }
}

/// Maps a point of the square to a unit vector. Coordinates beyond ±1 are clamped; NaN and coordinates beyond 1e30 count as 0.
pub fn decode<T: Real>(e: [T; 2]) -> [T; 3] {
    let e = e.map(|x| bounded(usable(x), -1.0, 1.0));
    let z = T::one() - e[0].abs() - e[1].abs();
    let [x, y] = if z < T::zero() { fold(e) } else { e };
    let v = [x, y, z];
    let length = dot(v, v).sqrt();
    v.map(|x| x / length)
}

/// Mirrors a point at the line |x| + |y| = 1 of its quadrant. Points beyond this line, in the corners of the square, represent the lower half of the
/// octahedron. The function is its own inverse.
fn fold<T: Real>(e: [T; 2]) -> [T; 2] {
    let sign = |x: T| if x >= T::zero() { T::one() } else { -T::one() };
    [(T::one() - e[1].abs()) * sign(e[0]), (T::one() - e[0].abs()) * sign(e[1])]
}

/// The integer that stands for the coordinate 0; the largest integer of a code is twice this value. `bits` is clamped to 2..=24.
pub fn half(bits: u32) -> u32 {
    (1 << (bits.clamp(2, 24) - 1)) - 1
}

/// Clamps each coordinate to ±1 and rounds it to the nearest integer of a code with `bits` bits, `0..=2 half` ("oct" in the survey).
pub fn quantise<T: Real>(e: [T; 2], bits: u32) -> [u32; 2] {
    let half = f64::from(half(bits));
    e.map(|x| code((bounded(usable(x), -1.0, 1.0) * T::of(half)).round() + T::of(half)))
}

/// The coordinates that a code stands for. Integers above `2 half` count as `2 half`.
pub fn dequantise<T: Real>(code: [u32; 2], bits: u32) -> [T; 2] {
    let half = half(bits);
    code.map(|q| T::of(f64::from(q.min(2 * half)) - f64::from(half)) / T::of(f64::from(half)))
}

/// Returns the code whose decoded direction is nearest to `n`, among the four codes around `n` ("oct-P" in the survey).
pub fn encode_precise<T: Real>(n: [T; 3], bits: u32) -> [u32; 2] {
    let n = unit(n);
    let half = half(bits);
    let low = encode(n).map(|x| code((x * T::of(f64::from(half))).floor() + T::of(f64::from(half))));
    let mut best = low;
    let mut best_error = T::infinity();
    for step in [[0, 0], [1, 0], [0, 1], [1, 1]] {
        let candidate = [(low[0] + step[0]).min(2 * half), (low[1] + step[1]).min(2 * half)];
        // The squared distance gives the same order as the dot product, but it is precise at small angles.
        let off = sub(decode(dequantise(candidate, bits)), n);
        let error = dot(off, off);
        if error < best_error {
            (best, best_error) = (candidate, error);
        }
    }
    best
}

/// The values that two unorm8 channels store for a point of the square. In WGSL: `octahedral_quantise8`.
pub fn quantise8<T: Real>(e: [T; 2]) -> [T; 2] {
    quantise(e, 8).map(stored8)
}

/// The point of the square that two unorm8 channels stand for. In WGSL: `octahedral_dequantise8`.
pub fn dequantise8<T: Real>(stored: [T; 2]) -> [T; 2] {
    dequantise(stored.map(|s| code((bounded(s, 0.0, 1.0) * T::of(255.0)).round())), 8)
}

/// The values that two unorm8 channels store for a direction, with the code that [`encode_precise`] finds. In WGSL:
/// `octahedral_encode8_precise`.
pub fn encode8_precise<T: Real>(n: [T; 3]) -> [T; 2] {
    encode_precise(n, 8).map(stored8)
}

fn stored8<T: Real>(q: u32) -> T {
    T::of(f64::from(q)) / T::of(255.0)
}

fn code<T: Real>(x: T) -> u32 {
    x.max(T::zero()).to_u32().expect("codes are bounded")
}

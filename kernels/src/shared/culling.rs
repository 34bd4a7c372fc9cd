//! Whether a part of the terrain can be left out: it lies beyond a plane of the frustum, or all of it faces away.
//!
//! Both err to one side only: what is seen is never left out, in f32 as in f64, whether denormals are kept or taken for zero. The price is a margin of
//! [`SLACK`] of the terms that are summed, within which something that could be left out is drawn.

use super::octahedral::unit;
use super::real::{Real, dot, length};

/// Rounding of three products and three sums in f32 is at most 4 of the sum of the terms' magnitudes times 2^-24; here twice that, 2^-21.
pub const SLACK: f64 = 8.0 / 16_777_216.0;

/// Largest number that is reckoned with: of squares and products f32 then holds the sums.
const MOST: f64 = 1e15;
/// Three products whose factors are at most [`MOST`] and of which one, denormal, was taken for zero come to less.
const FLUSHED: f64 = 1e-22;

/// Whether a box lies wholly beyond a plane, where n . p + w < 0 (`plane`: n, w). Never where a number is none, infinite or beyond 1e15.
pub fn beyond<T: Real>(plane: [T; 4], low: [T; 3], high: [T; 3]) -> bool {
    let (mut distance, mut size) = (plane[3], plane[3].abs());
    for i in 0..3 {
        let term = plane[i] * if plane[i] >= T::zero() { high[i] } else { low[i] };
        distance = distance + term;
        size = size + term.abs();
    }
    let known = plane.iter().chain(&low).chain(&high).all(|x| x.abs() <= T::of(MOST));
    known && distance < -(T::of(SLACK) * size + T::of(FLUSHED))
}

/// Whether all of a patch within `radius` m of a point faces away: `to_patch` goes from the eye to that point, m; normals lie in a cone of unit `axis`
/// (any length will do) and half angle of that sine, 0..=1; 1 = in any direction. Angles of cone and sphere add up: with half angle a and sphere
/// of angular radius s, sin s = radius / distance, all normals face away where axis . direction > sin(a + s).
pub fn faces_away<T: Real>(axis: [T; 3], sin_half_angle: T, to_patch: [T; 3], radius: T) -> bool {
    let known = [axis, to_patch].iter().all(|v| v.iter().all(|x| x.abs() <= T::of(MOST))) && radius >= T::zero() && radius <= T::of(MOST);
    let has_axis = axis.iter().any(|x| x.abs() > T::of(1e-15));
    let distance = length(to_patch);
    // Too near, or too short to have a direction in f32.
    if !(known && has_axis && sin_half_angle >= T::zero() && sin_half_angle < T::one() && distance > radius && distance > T::of(1e-15)) {
        return false;
    }
    let sine = radius / distance;
    let [cosine_half, cosine] = [sin_half_angle, sine].map(|s| ((T::one() - s) * (T::one() + s)).max(T::zero()).sqrt());
    // From a right angle on some normal faces the eye.
    if cosine_half * cosine - sin_half_angle * sine <= T::of(ROUNDING) {
        return false;
    }
    dot(unit(axis), unit(to_patch)) > sin_half_angle * cosine + cosine_half * sine + T::of(ROUNDING)
}

/// Rounding of two unit vectors (16 ULP each), their product, two sines and cosines, and their products in f32:
/// less than 96 ULP.
pub const ROUNDING: f64 = 96.0 / 8_388_608.0;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_beyond_a_plane_only_with_all_its_corners() {
        let plane = [0.6, 0.0, 0.8, -5.0];
        assert!(beyond(plane, [-9.0, -1.0, 0.0], [1.0, 1.0, 4.9]));
        assert!(!beyond(plane, [-9.0, -1.0, 0.0], [1.0, 1.0, 5.6]));
        // Products that are denormal, and whose sum is not.
        assert!(!beyond([1e-19_f32, 1e-19, 1e-19, -1.2e-38], [0.0; 3], [1.1e-19; 3]));
        assert!(!beyond(plane, [f64::NAN; 3], [f64::NAN; 3]) && !beyond(plane, [-f64::INFINITY; 3], [0.0; 3]));
    }

    #[test]
    fn a_patch_faces_away_only_with_all_its_normals() {
        let (up, below) = ([0.0, 0.0, 1.0], [0.0, 0.0, 10.0]);
        assert!(faces_away(up, 0.5, below, 1.0));
        // 60 degrees of normals and 30 of the sphere are a right angle.
        assert!(faces_away(up, 0.866, below, 4.8) && !faces_away(up, 0.867, below, 5.01));
        assert!(!faces_away(up, 0.0, [10.0, 0.0, 0.0], 0.1) && !faces_away(up, 1.0, below, 1.0) && !faces_away(up, 0.5, below, 11.0));
        assert!(!faces_away([0.0; 3], 0.0, below, 1.0) && !faces_away([1e-31, 0.0, 0.0], 0.0, below, 1.0), "an axis without direction");
        assert!(
            !faces_away([f64::NAN; 3], 0.5, below, 1.0) && !faces_away(up, f64::NAN, below, 1.0) && !faces_away(up, 0.5, below, f64::NAN)
        );
    }
}

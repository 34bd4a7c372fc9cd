//! Culling tests: whether a part of the terrain lies outside a plane of the frustum, is hidden by nearer surfaces, or faces away from the eye.
//!
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, "GPU Culling", "Occlusion Buffer Culling", "Back Face Culling"; Haar and Aaltonen,
//! *GPU-Driven Rendering Pipelines*, SIGGRAPH 2015.
//! The tests are conservative: each test has a margin for rounding errors, such as [`SLACK`], so that visible terrain is not culled. The margins
//! suffice in f32 and in f64, whether a device keeps denormals or flushes them to zero. The cost is that invisible terrain within a margin is
//! still drawn.

use super::octahedral::unit;
use super::real::{Real, dot, length};
use crate::base::wgsl::Constant;

/// Constants that the host passes to `culling.wgsl`.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("CULLING_SLACK", Constant::real(SLACK)),
    ("CULLING_ROUNDING", Constant::real(ROUNDING)),
    ("CULLING_MOST", Constant::real(MOST)),
    ("CULLING_LEAST", Constant::real(LEAST)),
    ("CULLING_FLUSHED", Constant::real(FLUSHED)),
    ("CULLING_KNOWN", Constant::real(KNOWN)),
    ("CULLING_NEAREST", Constant::real(NEAREST)),
    ("CULLING_OUTSIDE", Constant::real(OUTSIDE)),
    ("CULLING_FEW", Constant::real(FEW)),
];

/// Error bound of the sum of three products and a constant in f32, as a share of the sum of the magnitudes of the four terms. With rounding to
/// nearest, the error is at most 4 x 2^-24 of that sum. The bound is twice as large, 8 x 2^-24, so that it also holds for rounding towards zero.
pub const SLACK: f64 = 8.0 / 16_777_216.0;

/// Largest accepted magnitude of a number. Sums of squares and products of numbers up to this limit fit f32.
pub(crate) const MOST: f64 = 1e15;
/// Vectors of at most this size count as vectors without direction in [`faces_away`]. The size of a cone's axis is its largest component; the size of
/// the vector to a patch is its length, metres. The limit is well above 1e-19, below which the squares of numbers are denormal in f32.
pub(crate) const LEAST: f64 = 1e-15;
/// Bound on the error of a sum of three products if denormal factors are flushed to zero. The other factor of each product is at most [`MOST`].
pub(crate) const FLUSHED: f64 = 1e-22;

/// Whether a box lies completely outside a plane. `plane` is (n, w); a point p is outside if n . p + w < 0. False if a number is NaN, infinite or
/// beyond 1e15.
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

/// Whether a patch certainly faces away from the eye. The patch lies in a sphere of `radius` m, and `to_patch` goes from the eye to the centre of
/// this sphere, m. The normals of the patch lie in a cone around `axis`, which may have any length; `sin_half_angle` is the sine of the cone's half
/// angle, 0..=1, where 1 means any direction.
///
/// Let a be the half angle of the cone, and s the angular radius of the sphere: sin s = radius / distance. If a + s is less than a right angle, all
/// normals face away if axis . `to_patch` > sin(a + s), with both vectors normalised.
pub fn faces_away<T: Real>(axis: [T; 3], sin_half_angle: T, to_patch: [T; 3], radius: T) -> bool {
    let known = [axis, to_patch].iter().all(|v| v.iter().all(|x| x.abs() <= T::of(MOST))) && radius >= T::zero() && radius <= T::of(MOST);
    let has_axis = axis.iter().any(|x| x.abs() > T::of(LEAST));
    let distance = length(to_patch);
    // The patch is not culled if the eye is inside the sphere, if the cone includes all directions, if a vector is too short, or if a number is not
    // valid.
    if !(known && has_axis && sin_half_angle >= T::zero() && sin_half_angle < T::one() && distance > radius && distance > T::of(LEAST)) {
        return false;
    }
    let sine = radius / distance;
    let [cosine_half, cosine] = [sin_half_angle, sine].map(|s| ((T::one() - s) * (T::one() + s)).max(T::zero()).sqrt());
    // If the two angles, a and s, add up to a right angle or more, some normal in the cone may face the eye.
    if cosine_half * cosine - sin_half_angle * sine <= T::of(ROUNDING) {
        return false;
    }
    dot(unit(axis), unit(to_patch)) > sin_half_angle * cosine + cosine_half * sine + T::of(ROUNDING)
}

/// Bound on the rounding error in f32 of the comparison in [`faces_away`]. The error comes from two unit vectors (16 ULP each), their dot product,
/// two sines and two cosines, and the products of sines and cosines. It is less than 96 ULP in total.
pub const ROUNDING: f64 = 96.0 / 8_388_608.0;

/// Largest accepted relative error of a box's distance along the view. If the error is larger, or a part of the box is nearer than the near plane, it
/// is unknown which pixels the box covers.
pub(crate) const KNOWN: f64 = 1.0 / 128.0;
/// Lower limit of the accepted distances of the near plane, m.
pub(crate) const NEAREST: f64 = 1e-6;
/// Normalised device coordinates are clamped to ± this value. Farther outside the picture, the exact position makes no difference.
const OUTSIDE: f64 = 4.0;
/// Bound on the rounding error of a screen position, relative to 1 + |q|, where q is x / w or y / w of the clip coordinates. The quotient has an
/// error of 2.5 ULP; two sums and a product are rounded once each. The bound, 8 ULP, is about twice the total. Errors of the clip coordinates
/// themselves are added separately. The same bound is used for the rounding error of [`Cover::depth`].
const FEW: f64 = 8.0 / 8_388_608.0;

/// The pixels that a box covers on the screen, rounded outwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cover<T> {
    /// First column and row of pixels, from the upper left corner.
    pub first: [T; 2],
    /// Last column and row.
    pub last: [T; 2],
    /// Reversed depth of the nearest point: distance of the near plane / distance along the view, 0..=1.
    pub depth: T,
}

/// The pixels that the box from `low` to `high`, m, covers in a picture of `size` pixels (1..=16384 each). `rows` are the rows for x, y and w of a
/// matrix from the box's coordinates to clip space; w is the distance along the view, m. `near` is the smallest distance that is drawn, m.
///
/// The pixels lie within the picture, and there is at least one: a box outside the picture counts as covering the nearest pixels of the picture. The
/// frustum test must cull such a box.
///
/// `None` if it is unknown which pixels the box covers. This has three possible reasons: the box reaches the near plane; the rounding error of its
/// distance is too large (the summed terms are more than about 2^14 times as large as the distance); or an input is out of range (`near` is below
/// 1e-6 m, or a number is NaN, infinite or beyond 1e15).
pub fn cover<T: Real>(rows: [[T; 4]; 3], near: T, low: [T; 3], high: [T; 3], size: [T; 2]) -> Option<Cover<T>> {
    let known = rows.iter().flatten().chain(&low).chain(&high).all(|x| x.abs() <= T::of(MOST));
    if !(known && near >= T::of(NEAREST) && near <= T::of(MOST)) {
        return None;
    }
    let half = T::of(0.5);
    let (mut nearest, mut least, mut most) = (T::infinity(), size, [T::zero(); 2]);
    for corner in 0..8 {
        let place = [0, 1, 2].map(|i| if corner >> i & 1 == 1 { high[i] } else { low[i] });
        // The sum of a row's terms, and a bound on its error.
        let summed = rows.map(|row| {
            let terms = [row[0] * place[0], row[1] * place[1], row[2] * place[2], row[3]];
            let of = |f: fn(T) -> T| f(terms[0]) + f(terms[1]) + f(terms[2]) + f(terms[3]);
            (of(|x| x), T::of(SLACK) * of(T::abs) + T::of(FLUSHED))
        });
        let (w, off) = summed[2];
        let sure = w - off;
        if !(sure >= near && off <= T::of(KNOWN) * sure) {
            return None;
        }
        nearest = nearest.min(sure);
        for axis in 0..2 {
            let up = if axis == 0 { T::one() } else { -T::one() };
            let (x, x_off) = summed[axis];
            let q = (up * x / w).max(-T::of(OUTSIDE)).min(T::of(OUTSIDE));
            let margin = (x_off + q.abs() * off) / sure + T::of(FEW) * (T::one() + q.abs());
            least[axis] = least[axis].min((half + half * (q - margin)) * size[axis]);
            most[axis] = most[axis].max((half + half * (q + margin)) * size[axis]);
        }
    }
    let within = |axis: usize, x: T| x.floor().max(T::zero()).min(size[axis] - T::one());
    Some(Cover {
        first: [within(0, least[0]), within(1, least[1])],
        last: [within(0, most[0]), within(1, most[1])],
        depth: (near / nearest * (T::one() + T::of(FEW))).min(T::one()),
    })
}

/// The finest level of a depth pyramid at which the pixels from `first` to `last` lie in at most 2 x 2 texels. A texel of a level stores the least
/// reversed depth of 2 x 2 texels of the next finer level; the texels of level 0 are pixels. So the texel of pixel (x, y) at level l is
/// (x >> l, y >> l). The size of a level must be [`level_size`].
pub fn level(first: [u32; 2], last: [u32; 2]) -> u32 {
    let along = |axis: usize| {
        let start = (last[axis] - first[axis]).max(1).ilog2();
        start + u32::from((last[axis] >> start) - (first[axis] >> start) > 1)
    };
    along(0).max(along(1))
}

/// Size, in texels, of a level of the depth pyramid: `size` / 2^`level`, **rounded up**, where `size` is the size of the picture, 1..=16384 pixels
/// each. In WGSL: `culling_level_size`.
///
/// If a level has an odd number of columns, the last column is alone in a texel of the next level. If sizes were rounded down, this column would be
/// in no texel. The texel to the left would be read in its place, and a box that is visible only in this column would be culled. The sizes of the mip
/// levels of a texture are rounded down (WebGPU, "logical miplevel-specific texture extent"). A pyramid in the mip levels of a texture therefore
/// needs a texture whose sides are powers of two. Texels outside the picture must have depth 1 (the nearest), so that they do not change a minimum.
pub fn level_size(size: [u32; 2], level: u32) -> [u32; 2] {
    size.map(|side| (side.saturating_sub(1) >> level) + 1)
}

/// Whether a box is certainly hidden: all surfaces that were drawn at the pixels of the box are nearer than the nearest point of the box. `depth` is
/// the reversed depth of this nearest point. `farthest` are the least reversed depths in the texels of the depth pyramid that the box covers; 0 means
/// that nothing was drawn in a part of the texel. False if a depth is NaN.
pub fn hidden<T: Real>(depth: T, farthest: [T; 4]) -> bool {
    farthest.iter().all(|&stored| depth < stored)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::hash::pcg4d;

    /// A camera at the origin that looks along y, 90 degrees wide and high.
    const ALONG_Y: [[f64; 4]; 3] = [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]];

    #[test]
    fn a_box_covers_what_its_corners_span() {
        let size = [200.0, 100.0];
        // In normalised device coordinates, the nearest face spans x = -0.5 to 0.25 and y = 0 to 0.5.
        let seen = cover(ALONG_Y, 0.1, [-5.0, 10.0, 0.0], [2.5, 40.0, 5.0], size).expect("before the camera");
        assert_eq!((seen.first, seen.last), ([49.0, 24.0], [125.0, 50.0]));
        assert!((0.01..0.01 + 1e-7).contains(&seen.depth), "{}", seen.depth);
        assert_eq!(level([49, 24], [125, 50]), 6);
        // A box beside the picture, and a box larger than the picture.
        let beside = cover(ALONG_Y, 0.1, [90.0, 10.0, 0.0], [95.0, 11.0, 1.0], size).expect("before the camera");
        assert_eq!((beside.first[0], beside.last[0]), (199.0, 199.0));
        let all = cover(ALONG_Y, 0.1, [-1e6, 10.0, -1e6], [1e6, 11.0, 1e6], size).expect("before the camera");
        assert_eq!((all.first, all.last), ([0.0; 2], [199.0, 99.0]));
        // The cover is unknown if the box reaches the near plane, if a number is NaN, or if `near` is 0.
        let unknown = |low: [f64; 3], near: f64| cover(ALONG_Y, near, low, [20.0; 3], size).is_none();
        assert!(
            unknown([0.0, 0.09, 0.0], 0.1) && unknown([0.0, f64::NAN, 0.0], 0.1) && unknown([0.0; 3], f64::NAN) && unknown([9.0; 3], 0.0)
        );
        // The distance is a difference of two numbers of about 1e6, so its error bound is about 1 m. This is too much for a distance of 10 m, but
        // not for a distance of 200 m.
        let far_off = [ALONG_Y[0], ALONG_Y[1], [0.0, 1.0, 0.0, -1e6]];
        assert!(cover(far_off, 0.1, [0.0, 1e6 + 10.0, 0.0], [1.0, 1e6 + 20.0, 1.0], size).is_none());
        assert!(cover(far_off, 0.1, [0.0, 1e6 + 200.0, 0.0], [1.0, 1e6 + 220.0, 1.0], size).is_some());
    }

    #[test]
    fn a_level_has_all_pixels_in_two_texels_and_the_one_below_has_not() {
        for first in 0..70 {
            for last in first..140 {
                let level = level([first, 3], [last, 3]);
                assert!((last >> level) - (first >> level) <= 1, "{first}..={last} at {level}");
                assert!(level == 0 || (last >> (level - 1)) - (first >> (level - 1)) > 1, "{first}..={last} at {level}");
            }
        }
        assert_eq!(level([5, 0], [5, 16383]), 13);
    }

    /// A function that computes the size of a level of the pyramid, as [`level_size`] does.
    type Sizes = fn([u32; 2], u32) -> [u32; 2];

    /// Texels of a level of the pyramid, row by row. Beyond the last column and row, the nearest texel is read, as by a shader that clamps its
    /// coordinates.
    struct Texels {
        size: [u32; 2],
        depths: Vec<f64>,
    }

    impl Texels {
        fn at(&self, [x, y]: [u32; 2]) -> f64 {
            self.depths[(y.min(self.size[1] - 1) * self.size[0] + x.min(self.size[0] - 1)) as usize]
        }

        /// The next level of the pyramid: the least depths of 2 x 2 texels.
        fn coarser(&self, size: [u32; 2]) -> Texels {
            let least = |i: u32| {
                let [x, y] = [2 * (i % size[0]), 2 * (i / size[0])];
                [[x, y], [x + 1, y], [x, y + 1], [x + 1, y + 1]].into_iter().map(|texel| self.at(texel)).fold(f64::INFINITY, f64::min)
            };
            Texels { size, depths: (0..size[0] * size[1]).map(least).collect() }
        }
    }

    /// Tests random boxes in random pictures. Returns the number of visible boxes that are culled (wrongly), and the number of hidden boxes that are
    /// culled (rightly).
    fn culled(sizes: Sizes) -> [u32; 2] {
        let mut counts = [0; 2];
        for case in 0..2000 {
            let drawn = |column: u32, below: u32| pcg4d([case, column, 7, 2015])[0] % below;
            let size = [3 + drawn(0, 30), 3 + drawn(1, 30)];
            // A near surface with a few holes, through which a far one is seen.
            let depth = |i: u32| if pcg4d([case, i, 8, 2015])[0].is_multiple_of(40) { 0.1 } else { 0.5 };
            let mut levels = vec![Texels { size, depths: (0..size[0] * size[1]).map(depth).collect() }];
            for level in 1..=5 {
                let next = levels[levels.len() - 1].coarser(sizes(size, level));
                levels.push(next);
            }
            let first = [drawn(2, size[0]), drawn(3, size[1])];
            let last = [first[0] + drawn(4, size[0] - first[0]), first[1] + drawn(5, size[1] - first[1])];
            let level = level(first, last);
            let texel = |pixel: [u32; 2]| levels[level as usize].at(pixel.map(|x| x >> level));
            // The box lies between the two surfaces.
            let is_culled = hidden(0.3, [texel(first), texel([last[0], first[1]]), texel([first[0], last[1]]), texel(last)]);
            let is_hidden = (first[1]..=last[1]).all(|y| (first[0]..=last[0]).all(|x| levels[0].at([x, y]) > 0.3));
            counts[usize::from(is_hidden)] += u32::from(is_culled);
        }
        counts
    }

    #[test]
    fn a_pyramid_culls_nothing_visible_if_its_sizes_are_rounded_up() {
        assert_eq!([0, 1, 2, 3, 4, 5].map(|level| level_size([17, 30], level)), [[17, 30], [9, 15], [5, 8], [3, 4], [2, 2], [1, 1]]);
        assert_eq!((level_size([16_384, 1], 14), level_size([16_383, 4097], 1)), ([1, 1], [8192, 2049]));
        let [wrong, right] = culled(level_size);
        assert_eq!(wrong, 0);
        assert!(right > 500, "only {right} hidden boxes are culled");
        // Negative control: the test must find wrongly culled boxes if sizes are rounded down, as for mip levels.
        let [wrong, _] = culled(|size, level| size.map(|side| (side >> level).max(1)));
        assert!(wrong > 10, "{wrong} visible boxes are culled if sizes are rounded down");
    }

    #[test]
    fn only_what_is_behind_all_of_it_is_hidden() {
        assert!(hidden(0.1, [0.2, 0.11, 0.5, 1.0]));
        assert!(!hidden(0.1, [0.2, 0.1, 0.5, 1.0]) && !hidden(0.1, [0.2, 0.0, 0.5, 1.0]) && !hidden(0.0, [0.0; 4]));
        assert!(!hidden(0.1, [0.2, f64::NAN, 0.5, 1.0]) && !hidden(f64::NAN, [1.0; 4]));
    }

    #[test]
    fn a_box_is_beyond_a_plane_only_with_all_its_corners() {
        let plane = [0.6, 0.0, 0.8, -5.0];
        assert!(beyond(plane, [-9.0, -1.0, 0.0], [1.0, 1.0, 4.9]));
        assert!(!beyond(plane, [-9.0, -1.0, 0.0], [1.0, 1.0, 5.6]));
        // Each product is denormal in f32, but the sum is not. Flushed products must not cull the box.
        assert!(!beyond([1e-19_f32, 1e-19, 1e-19, -1.2e-38], [0.0; 3], [1.1e-19; 3]));
        assert!(!beyond(plane, [f64::NAN; 3], [f64::NAN; 3]) && !beyond(plane, [-f64::INFINITY; 3], [0.0; 3]));
    }

    #[test]
    fn a_patch_faces_away_only_with_all_its_normals() {
        let (up, below) = ([0.0, 0.0, 1.0], [0.0, 0.0, 10.0]);
        assert!(faces_away(up, 0.5, below, 1.0));
        // 60 degrees of the cone and 30 degrees of the sphere add up to a right angle.
        assert!(faces_away(up, 0.866, below, 4.8) && !faces_away(up, 0.867, below, 5.01));
        assert!(!faces_away(up, 0.0, [10.0, 0.0, 0.0], 0.1) && !faces_away(up, 1.0, below, 1.0) && !faces_away(up, 0.5, below, 11.0));
        assert!(!faces_away([0.0; 3], 0.0, below, 1.0) && !faces_away([1e-31, 0.0, 0.0], 0.0, below, 1.0), "an axis without direction");
        assert!(
            !faces_away([f64::NAN; 3], 0.5, below, 1.0) && !faces_away(up, f64::NAN, below, 1.0) && !faces_away(up, 0.5, below, f64::NAN)
        );
    }
}

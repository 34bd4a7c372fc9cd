//! Two normals in 32 bits: the normal of the triangle's plane, from which screen derivatives are computed, and the shading normal.
//!
//! Two octahedral codes of 8 + 8 bits would give both normals the same number of bits. But the plane needs more precision: an error of its normal
//! enters the derivatives divided by the cosine of the angle of incidence. The shading normal comes from a texture, whose filter blurs it anyway. Two
//! facts save bits for the plane:
//!
//! - A plane has no front side, so half of the octahedron can represent all planes.
//! - The shading normal is usually near the plane's normal, so its code can be predicted from the plane, and only the low bits of the code are
//!   stored.
//!
//! A plane's normal is rounded to a point of a lattice on the octahedron. With the saved bits, this lattice is 8 times finer than that of an
//! octahedral code of 8 + 8 bits: this is the *fine* form. If the two normals are too far apart, the lattice is that of such a code: this is the
//! *plain* form. Both forms keep the 8 + 8 bits of the shading normal exactly:
//!
//! | form | bit 31 | bits of the plane | bits of the shading normal |
//! | --- | --- | --- | --- |
//! | fine | 0 | 30..=10: point of the lattice with [`FINE`] steps | 9..=5 and 4..=0: the low bits of its code |
//! | plain | 1 | 30..=16: point of the lattice with [`PLAIN`] steps | 15..=8 and 7..=0: its code |
//!
//! Sources: the octahedral codes are from Cigolle et al., *A Survey of Efficient Representations for Independent Unit Vectors*, JCGT 3(2), 2014. The
//! packing is new; `docs/stability-lab.md` derives it in section 3. If the angle between the true and the decoded plane is ε, the relative error of a
//! derivative is at most sin ε / |c|, where c is the cosine of the angle between the decoded plane's normal and the neighbour's ray (section 2 of
//! that document).

use super::octahedral;
use super::real::{Real, dot, sub};

/// Fine form: number of steps of the plane's lattice from the middle of the octahedron's square to its rim. The lattice has 8 steps for each step
/// of the shading normal's code.
pub const FINE: i32 = 1016;
/// Plain form: number of steps of the plane's lattice from the middle of the octahedron's square to its rim. The lattice has as many steps as the
/// shading normal's code.
pub const PLAIN: i32 = 127;
/// Fine form: upper limit of the angle between a plane and the decoded plane, radians (0.0798 degrees). It is √2 times a step, as for octahedral
/// codes. The largest angles occur near the centres of the octahedron's faces.
///
/// There is one exception. If the angle between the ray and the plane is smaller than this limit, the plane of the nearest lattice point may be seen
/// from behind. A different point is then chosen, and the error is at most three times this limit.
pub const FINE_SUPREMUM: f64 = std::f64::consts::SQRT_2 / 1016.0;
/// Plain form: upper limit of the angle between a plane and the decoded plane, radians (0.638 degrees). The exception of [`FINE_SUPREMUM`] applies.
pub const PLAIN_SUPREMUM: f64 = std::f64::consts::SQRT_2 / 127.0;

/// The two normals that a word stores.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair<T> {
    /// Unit vector, z at least 0: the normal of the plane or its opposite.
    pub plane: [T; 3],
    /// Code of the shading normal, 0..=254 each, for [`super::octahedral::dequantise`] with 8 bits.
    pub shading: [u32; 2],
}

/// Index of a point of the diamond |x| + |y| <= `half`, which is the upper half of the octahedron. Indices are 0..=2 half² + 2 half, counted along
/// one diagonal after the other.
pub fn pack_diamond([x, y]: [i32; 2], half: i32) -> u32 {
    // x + y and x - y have the same parity, and 2 half + 1 is odd. So the total is even, and the shift loses no bit.
    ((x + y + half) * (2 * half + 1) + (x - y + half)).cast_unsigned() >> 1
}

/// The point with this index. Indices beyond the last one count as the last one.
pub fn unpack_diamond(index: u32, half: i32) -> [i32; 2] {
    let twice = 2 * index.min((2 * half * half + 2 * half).cast_unsigned()).cast_signed();
    let width = 2 * half + 1;
    let (sum, difference) = (twice / width - half, twice % width - half);
    [(sum + difference) / 2, (sum - difference) / 2]
}

/// The unit vector of a point of the diamond, z at least 0.
fn direction<T: Real>([x, y]: [i32; 2], half: i32) -> [T; 3] {
    let v = [x, y, half - x.abs() - y.abs()].map(|c| T::of(f64::from(c)));
    let length = dot(v, v).sqrt();
    v.map(|c| c / length)
}

/// Returns the lattice point nearest to the unit vector `n` (z at least 0). A lattice point stands for the plane with this normal, and `ray` is the
/// unit vector along which the plane is seen. The candidates are those of the four points around `n` whose planes are seen from the same side as the
/// plane with normal `n`. Because `n` lies between the four points, at least one of them is a candidate, apart from rounding.
fn nearest<T: Real>(n: [T; 3], ray: [T; 3], half: i32) -> [i32; 2] {
    let flat = octahedral::encode(n).map(|x| x * T::of(f64::from(half)));
    let whole = |x: T| x.to_i32().expect("within the square");
    let low = flat.map(|x| whole(x.floor()));
    let along = dot(n, ray);
    let mut best = flat.map(|x| whole(x.trunc()));
    let mut best_error = T::infinity();
    for step in [[0, 0], [1, 0], [0, 1], [1, 1]] {
        let p = [low[0] + step[0], low[1] + step[1]];
        if p[0].abs() + p[1].abs() > half {
            continue;
        }
        let decoded = direction(p, half);
        // Skips points whose decoded plane would be seen from the other side, because the derivatives on that plane would be reversed.
        if along != T::zero() && dot(decoded, ray) * along <= T::zero() {
            continue;
        }
        let off = sub(decoded, n);
        let error = dot(off, off);
        if error < best_error {
            (best, best_error) = (p, error);
        }
    }
    best
}

/// The predicted code of the shading normal, 0..=254 each: the code that the plane's own normal would have. `p` is the lattice point of the plane in
/// the fine form, which has 8 steps for each step of the code. Adding 4 before the division by 8 rounds to the nearest code.
fn predict(p: [i32; 2]) -> [i32; 2] {
    p.map(|x| (x + FINE + 4) >> 3)
}

/// Encodes a plane, given by a normal of any length and either sign, and the code of a shading normal, 0..=254 each; larger codes count as 254. `ray`
/// leads from the eye to the plane and may have any length. The decoded plane is chosen so that along this ray, it is seen from the same side as the
/// given plane. A vector without usable direction counts as the z axis.
pub fn encode<T: Real>(plane: [T; 3], ray: [T; 3], shading: [u32; 2]) -> u32 {
    let n = octahedral::unit(plane);
    let upper = if n[2] < T::zero() { n.map(|x| -x) } else { n };
    let ray = octahedral::unit(ray);
    let [x, y] = shading.map(|q| q.min(254));
    let fine = nearest(upper, ray, FINE);
    let off = |q: u32, predicted: i32| q.cast_signed() - predicted;
    let predicted = predict(fine);
    if (-16..16).contains(&off(x, predicted[0])) && (-16..16).contains(&off(y, predicted[1])) {
        return (pack_diamond(fine, FINE) << 10) | ((x & 31) << 5) | (y & 31);
    }
    (1 << 31) | (pack_diamond(nearest(upper, ray, PLAIN), PLAIN) << 16) | (x << 8) | y
}

/// Decodes a word. Every word is valid.
pub fn decode<T: Real>(word: u32) -> Pair<T> {
    if word >> 31 == 0 {
        let p = unpack_diamond(word >> 10, FINE);
        let predicted = predict(p);
        // The code whose five low bits are those of `low` and which differs from the prediction by -16..=15.
        let code = |low: u32, predicted: i32| {
            let code = predicted + (((low & 31).cast_signed() - predicted + 16) & 31) - 16;
            code.clamp(0, 254).cast_unsigned()
        };
        return Pair { plane: direction(p, FINE), shading: [code(word >> 5, predicted[0]), code(word, predicted[1])] };
    }
    let p = unpack_diamond((word >> 16) & 0x7fff, PLAIN);
    Pair { plane: direction(p, PLAIN), shading: [word >> 8, word].map(|q| (q & 255).min(254)) }
}

#[cfg(test)]
mod tests {
    use super::super::derivatives;
    use super::super::real::{add, length, scale};
    use super::*;
    use crate::probe::Draw;

    fn draw(test: u32) -> Draw {
        Draw { row: test, column: 0, table: 8 }
    }

    /// Draws a random code of a shading normal that is typical of terrain. The angle between the shading normal and the plane's normal has a
    /// lognormal distribution with median 2 degrees and sigma 1.1, cut off at 90 degrees.
    fn shading(draw: &mut Draw, n: [f64; 3]) -> [u32; 2] {
        let [radius, turn] = [draw.between(1e-9, 1.0), draw.between(0.0, std::f64::consts::TAU)];
        let normal = (-2.0 * radius.ln()).sqrt() * turn.cos();
        let angle = (2.0 * (1.1 * normal).exp()).min(90.0).to_radians();
        octahedral::encode_precise(draw.leaning(n, angle), 8)
    }

    fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
        // Computed from the chord, because an arc cosine has no precision at small angles.
        2.0 * (0.5 * length(sub(a, b))).min(1.0).asin()
    }

    /// The angle between a plane and a decoded plane, whichever signs their normals have.
    fn plane_error(n: [f64; 3], decoded: [f64; 3]) -> f64 {
        angle(n, decoded).min(angle(n.map(|x| -x), decoded))
    }

    #[test]
    fn points_of_the_diamond_are_numbered_without_a_gap() {
        for (half, points) in [(PLAIN, 32_513_u32), (FINE, 2_066_545), (1, 5)] {
            let mut seen = vec![false; points as usize];
            for y in -half..=half {
                let reach = half - y.abs();
                for x in -reach..=reach {
                    let index = pack_diamond([x, y], half);
                    assert_eq!(unpack_diamond(index, half), [x, y], "half {half}");
                    assert!(!std::mem::replace(&mut seen[index as usize], true), "two points have number {index}");
                }
            }
            assert!(seen.iter().all(|&s| s), "half {half}: a number belongs to no point");
            assert_eq!(unpack_diamond(u32::MAX >> 10, half), unpack_diamond(points - 1, half));
        }
        assert!(pack_diamond([FINE, 0], FINE) < 1 << 21 && pack_diamond([PLAIN, 0], PLAIN) < 1 << 15);
    }

    #[test]
    fn the_code_predicted_is_the_nearest() {
        // A word stores codes up to 16 steps from the prediction. With a different prediction, words would also decode correctly, but the stored
        // range would not be centred on the plane's normal.
        for x in -FINE..=FINE {
            let [code, _] = predict([x, 0]);
            assert!((0..=254).contains(&code) && (8 * (code - PLAIN) - x).abs() <= 4, "{x} as {code}");
        }
    }

    #[test]
    fn any_word_decodes_to_a_unit_vector_that_points_up_and_a_code() {
        let mut draw = draw(0);
        let ends = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7fc0_0000, 0xff00_ff00, 0x8000_ffff];
        for word in ends.into_iter().chain((0..100_000).map(|_| draw.word())) {
            let (double, single) = (decode::<f64>(word), decode::<f32>(word));
            assert!((length(double.plane) - 1.0).abs() < 1e-15 && double.plane[2] >= 0.0, "{word:#x}: {double:?}");
            assert!((length(single.plane) - 1.0).abs() < 3e-7 && single.plane[2] >= 0.0, "{word:#x}: {single:?}");
            assert!(double.shading == single.shading && double.shading.iter().all(|&q| q <= 254), "{word:#x}: {double:?}");
        }
    }

    #[test]
    fn the_shading_code_comes_back_whatever_the_plane() {
        let mut draw = draw(1);
        let odd = [0.0, 1.0, -1.0, 1e-40, -1e-40, 1e-6, f64::NAN, f64::INFINITY, 3e38];
        let odd: Vec<[f64; 3]> =
            (0..odd.len().pow(3)).map(|i| [odd[i % odd.len()], odd[i / odd.len() % odd.len()], odd[i / odd.len().pow(2)]]).collect();
        let random = (0..100_000).map(|i| {
            let n = draw.direction();
            let code = if i % 2 == 0 { shading(&mut draw, n) } else { [draw.word() % 255, draw.word() % 255] };
            (n, draw.direction(), code)
        });
        let mut rows: Vec<_> = random.collect();
        for (i, &n) in odd.iter().enumerate() {
            let shading = octahedral::encode_precise(n, 8);
            rows.extend([(n, odd[odd.len() - 1 - i], shading), (n, [0.0, 1.0, 0.0], [0, 254]), ([0.3, 0.5, 0.8], n, shading)]);
        }
        for (n, ray, shading) in rows {
            let single = |v: [f64; 3]| v.map(<f32 as Real>::of);
            assert_eq!(decode::<f64>(encode(n, ray, shading)).shading, shading, "{n:?}");
            assert_eq!(decode::<f64>(encode(single(n), single(ray), shading)).shading, shading, "{n:?} in f32");
            let usable = n.iter().all(|x| x.abs() <= 1e30) && n.iter().any(|x| x.abs() > 1e-30);
            // The z axis decodes exactly, and the normal of a vertical plane keeps z = 0 exactly. A vector without direction counts as the z axis.
            if !usable || n[0] == 0.0 && n[1] == 0.0 {
                assert_eq!(decode::<f64>(encode(n, ray, shading)).plane, [0.0, 0.0, 1.0], "{n:?}");
            } else if n[2] == 0.0 {
                assert_eq!(decode::<f64>(encode(n, [0.0; 3], shading)).plane[2], 0.0, "{n:?}");
            }
        }
        // Codes above 254 count as 254.
        assert_eq!(decode::<f64>(encode([0.0, 0.0, 1.0], [0.0; 3], [255, u32::MAX])).shading, [254, 254]);
    }

    #[test]
    fn planes_are_as_near_as_the_lattice_promises() {
        let mut draw = draw(2);
        let mut worst = [0.0_f64; 2];
        for _ in 0..400_000 {
            let (n, ray) = (draw.direction(), draw.direction());
            let own = octahedral::encode_precise(if n[2] < 0.0 { n.map(|x| -x) } else { n }, 8);
            // The second code is about 127 steps from the predicted code. This is too far for the fine form, so it tests the plain form.
            for (mode, shading) in [own, own.map(|q| (q + 127) % 255)].into_iter().enumerate() {
                let word = encode(n, ray, shading);
                assert_eq!(word >> 31, u32::try_from(mode).expect("0 or 1"));
                let error = plane_error(n, decode(word).plane);
                let supremum = [FINE_SUPREMUM, PLAIN_SUPREMUM][mode];
                // If the plane is nearly edge-on, a lattice point whose plane would be seen from behind is skipped, and the error may be up to three
                // times as large.
                let most = if dot(n, ray).abs() > supremum.sin() { supremum } else { 3.0 * supremum };
                assert!(error <= most * (1.0 + 1e-9), "{n:?} seen along {ray:?}: {error} rad");
                if most == supremum {
                    worst[mode] = worst[mode].max(error / supremum);
                }
            }
        }
        // The largest errors are above 97 % of the upper limits, so limits that are 3 % smaller would not hold.
        assert!(worst.iter().all(|&share| share > 0.97), "{worst:?}");
    }

    /// Returns a ray, its steps to the neighbouring pixels, and the normal of a plane, whose z is at least 0. They belong to a random pixel of a
    /// random camera that sees the plane from above, at an angle of incidence of `incidence` degrees. The vertical field of view is uniform in
    /// 20..100 degrees; the orientation and the pixel of 1920 x 1080 are arbitrary.
    fn sight(draw: &mut Draw, incidence: f64) -> ([f64; 3], [[f64; 3]; 2], [f64; 3]) {
        let forward = draw.direction();
        let right = draw.leaning(forward, std::f64::consts::FRAC_PI_2);
        let [f, r] = [forward, right];
        let down = [f[1] * r[2] - f[2] * r[1], f[2] * r[0] - f[0] * r[2], f[0] * r[1] - f[1] * r[0]];
        let pixel = (0.5 * draw.between(20.0, 100.0).to_radians()).tan() / 540.0;
        let steps = [scale(right, pixel), scale(down, pixel)];
        let ray = add(forward, add(scale(steps[0], draw.between(-960.0, 960.0)), scale(steps[1], draw.between(-540.0, 540.0))));
        let n = draw.leaning(octahedral::unit(ray.map(|x| -x)), incidence.to_radians());
        // For an overhang, everything is mirrored through the origin, so that z is at least 0.
        let up = if n[2] < 0.0 { -1.0 } else { 1.0 };
        (scale(ray, up), steps.map(|s| scale(s, up)), scale(n, up))
    }

    /// Relative errors of both derivatives, and whether a derivative is reversed.
    fn derivative_errors(ray: [f64; 3], steps: [[f64; 3]; 2], n: [f64; 3], decoded: [f64; 3]) -> ([f64; 2], bool) {
        let mut reversed = false;
        let errors = steps.map(|step| {
            let [exact, got] = [n, decoded].map(|n| derivatives::on_plane(ray, step, 1.0, n));
            reversed |= dot(exact, got) < 0.0;
            length(sub(got, exact)) / length(exact)
        });
        (errors, reversed)
    }

    fn share(sorted: &[f64], part: f64) -> f64 {
        sorted[(part * (sorted.len() - 1) as f64) as usize]
    }

    #[test]
    fn derivatives_are_three_times_better_than_of_two_codes() {
        let mut draw = draw(3);
        for band in [[0.0, 15.0], [15.0, 30.0], [30.0, 45.0], [45.0, 60.0], [60.0, 70.0], [70.0, 75.0], [75.0, 80.0], [80.0, 85.0]] {
            let (mut pair, mut codes, mut fine) = (Vec::new(), Vec::new(), 0);
            const SIGHTS: usize = 10_000;
            for _ in 0..SIGHTS {
                let incidence = draw.between(band[0], band[1]);
                let (ray, steps, n) = sight(&mut draw, incidence);
                let word = encode(n, ray, shading(&mut draw, n));
                fine += usize::from(word >> 31 == 0);
                pair.extend(derivative_errors(ray, steps, n, decode(word).plane).0);
                let octahedral = octahedral::decode(octahedral::dequantise(octahedral::encode_precise(n, 8), 8));
                codes.extend(derivative_errors(ray, steps, n, octahedral).0);
            }
            for errors in [&mut pair, &mut codes] {
                errors.sort_by(f64::total_cmp);
            }
            let [median, most] = [0.5, 0.95].map(|part| [share(&codes, part), share(&pair, part)]);
            println!(
                "{band:?} degrees, {:.1} % fine: median error {:.3} % (two codes), {:.3} % (pair), ratio {:.1}; p95 {:.3} %, {:.3} %, ratio {:.1}",
                100.0 * fine as f64 / SIGHTS as f64,
                100.0 * median[0],
                100.0 * median[1],
                median[0] / median[1],
                100.0 * most[0],
                100.0 * most[1],
                most[0] / most[1],
            );
            for [two, one] in [median, most] {
                assert!(two >= 3.0 * one, "{band:?} degrees: relative error {two} with two codes, {one} with the pair");
            }
        }
    }

    #[test]
    fn no_derivative_is_reversed_next_to_edge_on() {
        let mut draw = draw(4);
        // Number of random pixels with a reversed derivative: with fine words, with plain words, and with plain words encoded without a ray (negative
        // control).
        let mut reversed = [0; 3];
        const SIGHTS: usize = 20_000;
        for _ in 0..SIGHTS {
            let incidence = draw.between(85.0, 89.9);
            let (ray, steps, n) = sight(&mut draw, incidence);
            let own = octahedral::encode_precise(n, 8);
            let far = own.map(|q| (q + 127) % 255);
            for (count, word) in reversed.iter_mut().zip([encode(n, ray, own), encode(n, ray, far), encode(n, [0.0; 3], far)]) {
                *count += usize::from(derivative_errors(ray, steps, n, decode(word).plane).1);
            }
        }
        println!(
            "sights of {SIGHTS} with a reversed derivative: fine {}, plain {}, plain without a ray {}",
            reversed[0], reversed[1], reversed[2]
        );
        assert!(reversed[0] == 0 && reversed[1] == 0 && reversed[2] * 200 > SIGHTS, "{reversed:?} of {SIGHTS}");
    }
}

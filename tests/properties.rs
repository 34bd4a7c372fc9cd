//! Tests properties of the CPU reference functions for arbitrary arguments: symmetries, monotonicity, round trips, and changes of the arguments that
//! must not change the result. `shared.rs` and `noise.rs` compare reference functions with formulas and with probability distributions.
//!
//! The last part of this file calls the functions with arguments of arbitrary bit patterns, including NaN and infinities. Results that are documented
//! as finite must be finite. All random arguments are drawn with fixed seeds. The library proptest simplifies a case that fails, and prints it.

use std::collections::{BTreeSet, HashMap};

use glam::{DVec2, DVec3, DVec4};
use kernels::base::names::nearest;
use kernels::blocks;
use kernels::blocks::{BlockFormat, Effort};
use kernels::culling::{self, Conditions, Culls, DrawnNode, Levels};
use kernels::decode::heightmap::Heightmap;
use kernels::geometry::reference as geometry;
use kernels::quadtree::{self, NodeBounds, PatchBounds};
use kernels::scene::{CameraPath, CameraPose, FlavourRules};
use kernels::shading::Estimator;
use kernels::shared::culling as seen;
use kernels::shared::flavour_weights::{self, FlavourParams};
use kernels::shared::hex_tiling::{self, HexTiling};
use kernels::shared::moments::Moments;
use kernels::shared::motion::{self, Past};
use kernels::shared::noise::{self, HashedPoint, NoiseKind};
use kernels::shared::real::{self, Real, add, dot, length, scale, sub};
use kernels::shared::{
    biplanar, blue_noise, brdf, derivatives, hash, layers, octahedral, select, signal, snapped_projection, splat_blend, texel_choice,
    tiling, triplanar,
};
use kernels::variant::Variant;
use kernels::view::camera::{NEAR_M, Pose, View, along};
use kernels::world::cones::{self, Cone};
use kernels::world::{Layout, NodeId, SECTORS};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngSeed};

// ---------------------------------------------------------------- arguments

/// A configuration of proptest that draws the same random cases in every run, and that writes no files about failed cases.
fn cases(cases: u32) -> Config {
    Config { cases, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..Config::default() }
}

const ULP: f64 = f32::EPSILON as f64;

fn unit() -> impl Strategy<Value = f64> {
    0.0..1.0
}

fn direction() -> impl Strategy<Value = [f64; 3]> {
    (-1.0..1.0, 0.0..std::f64::consts::TAU).prop_map(|(z, phi): (f64, f64)| {
        let r = (1.0 - z * z).sqrt();
        [r * phi.cos(), r * phi.sin(), z]
    })
}

fn vector(size: f64) -> impl Strategy<Value = [f64; 3]> {
    [-size..size, -size..size, -size..size]
}

/// A random power of two. A multiplication by it causes no rounding.
fn power_of_two() -> impl Strategy<Value = f64> {
    (-20..20).prop_map(|k: i32| f64::from(k).exp2())
}

fn close<const N: usize>(a: [f64; N], b: [f64; N], tolerance: f64) -> bool {
    (0..N).all(|i| (a[i] - b[i]).abs() <= tolerance)
}

fn sum<const N: usize>(w: [f64; N]) -> f64 {
    w.iter().sum()
}

/// Rounds numbers to f32. Returns the rounded numbers in f32 and in f64, so that a function can be called with equal arguments in both precisions.
fn single<const N: usize>(a: [f64; N]) -> ([f32; N], [f64; N]) {
    let narrow = a.map(|x| x as f32);
    (narrow, narrow.map(f64::from))
}

fn is_partition<const N: usize>(w: [f64; N]) -> bool {
    (sum(w) - 1.0).abs() < 1e-14 && w.iter().all(|x| (0.0..=1.0).contains(x))
}

// ---------------------------------------------------------------- small vectors

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn products_and_lengths_follow_their_laws(a in vector(1e6), b in vector(1e6), s in power_of_two()) {
        prop_assert_eq!(dot(a, b), dot(b, a));
        prop_assert_eq!(dot(scale(a, s), b), s * dot(a, b));
        prop_assert!(close(sub(add(a, b), b), a, 1e-9));
        prop_assert!(dot(a, b).abs() <= length(a) * length(b) * (1.0 + 1e-14));
        prop_assert!(length(add(a, b)) <= (length(a) + length(b)) * (1.0 + 1e-14));
        let n = real::normalize(a);
        prop_assert!((length(n) - 1.0).abs() < 1e-14 && close(scale(n, length(a)), a, 1e-8));
    }
}

// ---------------------------------------------------------------- hash

proptest! {
    #![proptest_config(cases(512))]

    #[test]
    fn hashes_lose_nothing(a: [u32; 4], b: [u32; 4], bit in 0..128u32) {
        // Every step of the hash is invertible, so different inputs have different hashes. `near` differs from `a` in one bit; `b` is unrelated.
        let mut near = a;
        near[bit as usize / 32] ^= 1 << (bit % 32);
        prop_assert_ne!(hash::pcg4d(a), hash::pcg4d(near));
        prop_assert_eq!(hash::pcg4d(a) == hash::pcg4d(b), a == b);
        let mut words: Vec<u32> = (0..4096).map(|i| hash::pcg(a[0].wrapping_add(i))).collect();
        words.sort_unstable();
        words.dedup();
        prop_assert_eq!(words.len(), 4096);
        let [seed, salt, level, other] = a;
        prop_assert_eq!(hash::mix(seed, salt, level) == hash::mix(seed, salt, other), level == other);
        prop_assert_eq!(hash::mix(seed, salt, level) == hash::mix(seed, other, level), salt == other);
        prop_assert_eq!(hash::mix(seed, salt, level) == hash::mix(other, salt, level), seed == other);
    }

    #[test]
    fn units_keep_the_order_of_words(a: u32, b: u32, x: i32, y: i32) {
        let (u, v): (f64, f64) = (hash::to_unit(a), hash::to_unit(b));
        prop_assert!((0.0..1.0).contains(&u) && (a <= b) == (a >> 8 == b >> 8 && a <= b || u < v));
        prop_assert_eq!(f64::from(hash::to_unit::<f32>(a)), u);
        let cell = hash::unit2(x, y, a, b);
        prop_assert!((0.0..1.0).contains(&cell) && cell != hash::unit2(x.wrapping_add(1), y, a, b));
    }
}

// ---------------------------------------------------------------- noise

fn hashed_point() -> impl Strategy<Value = HashedPoint<f64>> {
    // Positions are multiples of 2^-16 m, so adding the lengths of whole sectors to a position causes no rounding.
    let position = [0..4_194_304, 0..4_194_304, -196_608_000..196_608_000].prop_map(|p: [i32; 3]| p.map(|x| f64::from(x) / 65_536.0));
    ([-2_000_000..2_000_000, -2_000_000..2_000_000], position, 5..15, direction(), direction(), -17.0..6.0, unit(), 0.25..4.0).prop_map(
        |(sector, position, log2_sector, a, b, level, share, hash_scale): (_, _, i32, _, _, f64, _, _)| HashedPoint {
            sector,
            position,
            sector_m: f64::from(log2_sector).exp2(),
            ddx: scale(a, level.exp2()),
            ddy: scale(b, level.exp2() * share),
            hash_scale,
        },
    )
}

fn noise_kind() -> impl Strategy<Value = NoiseKind> {
    (0..NoiseKind::ALL.len()).prop_map(|i| NoiseKind::ALL[i])
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn ground_noise_does_not_see_where_sectors_begin(
        point in hashed_point(),
        east in -50..50i32,
        north in -50..50i32,
        level in -5..=16i32,
        seed: u32,
        salt: u32,
    ) {
        let mut moved = point;
        moved.sector = [point.sector[0] + east, point.sector[1] + north];
        moved.position[0] -= f64::from(east) * point.sector_m;
        moved.position[1] -= f64::from(north) * point.sector_m;
        for kind in [NoiseKind::HashedIsotropic, NoiseKind::HashedAnisotropic, NoiseKind::WhiteWorld] {
            let of = |point: &HashedPoint<f64>| noise::thresholds(kind, point, level, [0; 2], 0, seed, salt);
            // `moved` is the same point, described relative to a different sector. Its cells are the same only under two conditions. At the coarsest
            // level (-5), a sector must contain at least one whole cell. At the finest level (16), the number of cells along 50 sectors must fit into
            // 31 bits.
            let cells = |k: f64| point.sector_m * k.exp2();
            if cells(-5.0) >= 1.0 && cells(16.0) * 50.0 < 2_147_483_520.0 {
                prop_assert_eq!(of(&point), of(&moved), "{}", kind);
            }
        }
    }

    #[test]
    fn screen_noise_does_not_see_the_ground(
        kind in noise_kind(),
        a in hashed_point(),
        b in hashed_point(),
        x: u32,
        y: u32,
        frame: u32,
        seed: u32,
        salt: u32,
    ) {
        let of = |point, pixel, frame| noise::thresholds::<f64>(kind, point, 4, pixel, frame, seed, salt);
        let (on_ground, over_time) = (of(&a, [x, y], frame), kind.is_per_frame());
        if matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic | NoiseKind::WhiteWorld) {
            prop_assert_eq!(on_ground, of(&a, [y, x ^ 1], !frame));
        } else {
            prop_assert_eq!(on_ground, of(&b, [x, y], frame));
            prop_assert_eq!(over_time, on_ground != of(&a, [x, y], frame ^ 1));
        }
        let single = HashedPoint {
            sector: a.sector,
            position: a.position.map(|p| p as f32),
            sector_m: a.sector_m as f32,
            ddx: a.ddx.map(|p| p as f32),
            ddy: a.ddy.map(|p| p as f32),
            hash_scale: a.hash_scale as f32,
        };
        for x in noise::thresholds(kind, &single, 4, [x, y], frame, seed, salt) {
            prop_assert!((0.0..1.0).contains(&x));
        }
        prop_assert_eq!(kind.name().parse(), Ok(kind));
    }

    #[test]
    fn masks_repeat_and_keep_their_ranks(
        kind in noise_kind(),
        pixel in [0..1u32 << 31, 0..1u32 << 31], frame in 0..1u32 << 31, seed: u32, salt: u32, decision in 0..4u32,
    ) {
        let at = |pixel, frame| noise::rank_index(kind, pixel, frame, seed, salt, decision);
        let index = at(pixel, frame);
        prop_assert_eq!(index, at([pixel[0] + blue_noise::EDGE, pixel[1] + 5 * blue_noise::EDGE], frame + blue_noise::SLICES));
        prop_assert!((index as usize) < blue_noise::ranks().len() && (kind.needs_mask() || index == 0));
        let rank = blue_noise::ranks()[index as usize];
        let [threshold, ..] = noise::mask::<f64>(kind, pixel, frame, seed, salt, [rank; 4]);
        let low = f64::from(rank) / f64::from(blue_noise::RANKS);
        prop_assert!((low..low + 1.0 / f64::from(blue_noise::RANKS)).contains(&threshold));
        // If a kind of noise has a mask, the pixel on the right reads a different entry of the mask. For a kind without a mask, the index is always
        // 0.
        let next = at([pixel[0] + 1, pixel[1]], frame);
        prop_assert_eq!(kind.needs_mask(), next != index);
    }

    #[test]
    fn correction_grows_and_is_symmetric(x in unit(), y in unit(), l in unit()) {
        let f = |x: f64| noise::correct(x, l);
        prop_assert!(f(x.min(y)) <= f(x.max(y)) + 1e-15);
        prop_assert!((f(1.0 - x) - (1.0 - f(x))).abs() < 1e-7, "f(1 - x) must equal 1 - f(x), except that f is clamped to 1 - 2^-24");
        prop_assert!((f(x) - noise::correct(x, 1.0 - l)).abs() < 1e-12);
        prop_assert!((f(0.5) - 0.5).abs() < 1e-12);
    }
}

// ---------------------------------------------------------------- octahedral

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn octahedral_codes_go_there_and_back(n in direction(), size in power_of_two(), bits in 4..=16u32, code: [u32; 2]) {
        let e = octahedral::encode(n);
        prop_assert!(length(sub(octahedral::decode(e), n)) < 1e-14);
        prop_assert_eq!(octahedral::encode(scale(n, size)), e, "the length must not matter");
        let h = octahedral::half(bits);
        let code = code.map(|c| c % (2 * h + 1));
        let square = octahedral::dequantise::<f64>(code, bits);
        prop_assert_eq!(octahedral::quantise(square, bits), code);
        // A decoded direction that is encoded again to its nearest code must decode to the same direction. The code itself may change: on the border
        // of the square, a code and its mirror image on the same side represent the same direction.
        let decoded = octahedral::decode(square);
        let again = octahedral::decode(octahedral::dequantise::<f64>(octahedral::encode_precise(decoded, bits), bits));
        prop_assert!(length(sub(decoded, again)) < 1e-12);
    }

    #[test]
    fn octahedral_errors_have_their_bounds(n in direction(), bits in 4..=16u32) {
        let error = |code| {
            let off = length(sub(octahedral::decode(octahedral::dequantise::<f64>(code, bits)), n));
            2.0 * (off / 2.0).asin()
        };
        let (fast, precise) = (error(octahedral::quantise(octahedral::encode(n), bits)), error(octahedral::encode_precise(n, bits)));
        let h = f64::from(octahedral::half(bits));
        // The bounds are the largest possible angles between a direction and its code (docs/stability-lab.md, section 1). On a face of the
        // octahedron, the codes form a lattice of equilateral triangles, and four neighbouring codes form a rhombus of two triangles. If each
        // coordinate is rounded (`fast`), the distance on the face is at most half the longer diagonal of a rhombus. If the nearest direction is
        // chosen (`precise`), it is at most the circumradius of a triangle. A bound is the angle of this distance, seen from the centre of the
        // octahedron.
        prop_assert!(precise <= fast + 1e-14);
        prop_assert!(fast <= 3.0 / (std::f64::consts::SQRT_2 * h) + 1e-12, "{}", fast);
        prop_assert!(precise <= std::f64::consts::SQRT_2 / h + 1e-12, "{}", precise);
        if bits == 8 {
            let stored = octahedral::encode8_precise(n).map(|s| (s * 255.0).round() as u32);
            prop_assert_eq!(stored, octahedral::encode_precise(n, 8));
            let decoded = octahedral::dequantise8(octahedral::quantise8(octahedral::encode(n)));
            prop_assert_eq!(decoded, octahedral::dequantise::<f64>(octahedral::quantise(octahedral::encode(n), 8), 8));
        }
    }

    #[test]
    fn mirrored_directions_have_mirrored_codes(n in direction()) {
        let [x, y, z] = n;
        prop_assume!(x != 0.0 && y != 0.0 && z != 0.0);
        let e = octahedral::encode(n);
        prop_assert_eq!(octahedral::encode([-x, y, z]), [-e[0], e[1]]);
        prop_assert_eq!(octahedral::encode([x, -y, z]), [e[0], -e[1]]);
        prop_assert!(close(octahedral::encode([y, x, z]), [e[1], e[0]], 1e-15));
        prop_assert_eq!(z > 0.0, e[0].abs() + e[1].abs() < 1.0);
    }
}

// ---------------------------------------------------------------- derivatives

fn ray_and_step() -> impl Strategy<Value = ([f64; 3], [f64; 3])> {
    (direction(), direction(), 1e-4..1e-2).prop_map(|(ray, across, px): (_, [f64; 3], f64)| {
        let step = sub(across, scale(ray, dot(across, ray)));
        (ray, scale(step, px))
    })
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn derivatives_lead_to_the_neighbours_ray_within_the_plane((ray, step) in ray_and_step(), n in direction(), t in 0.1..1e5f64) {
        let cosine = dot(n, ray).abs();
        prop_assume!(cosine > 0.05);
        let d = derivatives::on_plane(ray, step, t, n);
        prop_assert!(dot(d, n).abs() <= 1e-13 * length(d) / cosine);
        // The point plus its derivative lies on the neighbour's ray, so the component of the sum perpendicular to that ray is zero.
        let (hit, next) = (add(scale(ray, t), d), add(ray, step));
        let across = sub(hit, scale(next, dot(hit, next) / dot(next, next)));
        prop_assert!(length(across) <= 1e-12 * t, "{:?}", across);
    }

    #[test]
    fn derivatives_scale_with_distance_and_see_no_side(
        (ray, step) in ray_and_step(),
        n in direction(),
        t in 0.1..1e5f64,
        s in power_of_two(),
    ) {
        let d = derivatives::on_plane(ray, step, t, n);
        prop_assert_eq!(derivatives::on_plane(ray, step, t * s, n), scale(d, s));
        prop_assert_eq!(derivatives::on_plane(ray, step, t, scale(n, s)), d);
        prop_assert_eq!(derivatives::on_plane(scale(ray, s), scale(step, s), t / s, n), d);
        prop_assume!(dot(n, ray) != 0.0);
        prop_assert_eq!(derivatives::on_plane(ray, step, t, scale(n, -1.0)), d, "a plane has no front");
        prop_assert!(length(d) <= t * length(step) * (1.0 + 1.1 / derivatives::MIN_COSINE));
    }

    #[test]
    fn derivatives_of_turned_views_are_turned((ray, step) in ray_and_step(), n in direction(), t in 0.1..1e3f64) {
        let turned = |[x, y, z]: [f64; 3]| [y, z, x];
        let (d, other) = (derivatives::on_plane(ray, step, t, n), derivatives::on_plane(turned(ray), turned(step), t, turned(n)));
        prop_assert!(close(turned(d), other, 1e-10 * (t + length(d))));
    }
}

// ---------------------------------------------------------------- splat blend

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn texels_change_places_with_their_weights(f in [unit(), unit()], h in [unit(), unit(), unit(), unit()], k in 0.0..40.0f64) {
        let w = splat_blend::weights(f, h, k);
        prop_assert!(is_partition(w));
        // If the cell is mirrored in x, or if x and y are exchanged, the weights change places in the same way.
        let mirrored = splat_blend::weights([1.0 - f[0], f[1]], [h[1], h[0], h[3], h[2]], k);
        prop_assert!(close([w[1], w[0], w[3], w[2]], mirrored, 1e-12));
        let transposed = splat_blend::weights([f[1], f[0]], [h[0], h[2], h[1], h[3]], k);
        prop_assert!(close([w[0], w[2], w[1], w[3]], transposed, 1e-12));
        // Doubled heights with half the sharpness give the same weights, because only the product of height and sharpness matters.
        prop_assert_eq!(splat_blend::weights(f, h.map(|h| 2.0 * h), k / 2.0), w);
    }

    #[test]
    fn a_higher_texel_takes_more(
        f in [unit(), unit()],
        h in [unit(), unit(), unit(), unit()],
        k in 0.0..40.0f64,
        i in 0..4usize,
        more in unit(),
    ) {
        let mut higher = h;
        higher[i] += more;
        let (w, v) = (splat_blend::weights(f, h, k), splat_blend::weights(f, higher, k));
        for j in 0..4 {
            prop_assert!(if i == j { v[j] >= w[j] - 1e-14 } else { v[j] <= w[j] + 1e-14 }, "{:?} {:?}", w, v);
        }
    }

    #[test]
    fn a_run_of_terms_comes_to_the_same_weights(
        f in [unit(), unit()],
        h in [unit(), unit(), unit(), unit()],
        k in 0.0..40.0f64,
        first in 0..4usize,
    ) {
        let (mut run, mut shares, mut total) = (splat_blend::Run::start(), [0.0; 4], 0.0);
        let bilinear = splat_blend::bilinear(f);
        prop_assert!(is_partition(bilinear));
        for i in (0..4).map(|i| (first + i) % 4) {
            run = run.add(bilinear[i], h[i], k);
            shares = shares.map(|s| s * run.keep);
            total = total * run.keep + run.share;
            shares[i] += run.share;
        }
        prop_assert!(total >= 1.0 && close(shares.map(|s| s / total), splat_blend::weights(f, h, k), 1e-12));
    }
}

// ---------------------------------------------------------------- projections

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn tri_planar_weights_follow_the_axes(n in direction(), k in 0.0..64.0f64, s in power_of_two(), g in vector(3.0)) {
        let w = triplanar::weights(n, k);
        prop_assert!(is_partition(w));
        prop_assert_eq!(triplanar::weights(scale(n, -s), k), w);
        let [x, y, z] = n;
        prop_assert!(close(triplanar::weights([y, z, x], k), [w[1], w[2], w[0]], 1e-12));
        // Of two axes, the one with the larger component of the normal never has the smaller weight.
        for (i, j) in [(0, 1), (1, 2), (2, 0)] {
            prop_assert!(n[i].abs() < n[j].abs() || w[i] >= w[j]);
        }
        // A higher sharpness never lowers the largest weight.
        let sharper = triplanar::weights(n, k + 1.0);
        prop_assert!(w.iter().copied().fold(0.0, f64::max) <= sharper.iter().copied().fold(0.0, f64::max) + 1e-14);
        // A gradient of zero does not change the normal. The component of a gradient along the normal has no effect.
        prop_assert!(close(triplanar::perturb(n, [0.0; 3]), n, 1e-14));
        prop_assert!(close(triplanar::perturb(n, add(g, scale(n, 2.0))), triplanar::perturb(n, g), 1e-12));
        prop_assert!((length(triplanar::perturb(n, g)) - 1.0).abs() < 1e-14 && dot(triplanar::perturb(n, g), n) > 0.0);
    }

    #[test]
    fn biplanar_leaves_out_the_least(n in direction(), k in 0.0..64.0f64, s in power_of_two()) {
        let (axes, w) = biplanar::projections(n, k);
        prop_assert!(is_partition(w) && axes[0] < axes[1] && axes[1] < 3);
        prop_assert_eq!(biplanar::projections(scale(n, -s), k), (axes, w));
        let [a, b] = axes.map(|axis| n[axis as usize].abs());
        let dropped = n[3 - axes[0] as usize - axes[1] as usize].abs();
        prop_assert!(dropped <= a && dropped <= b && (w[0] >= w[1] || a <= b) && (w[1] >= w[0] || b <= a));
        let [x, y, z] = n;
        let (turned, v) = biplanar::projections([y, z, x], k);
        for (axis, w) in axes.into_iter().zip(w) {
            let there = turned.iter().position(|&t| (t + 1) % 3 == axis);
            prop_assert!(there.is_some_and(|i| (v[i] - w).abs() < 1e-12), "{:?} {:?} {:?}", axes, turned, v);
        }
    }

    #[test]
    fn snapped_planes_are_the_steep_ones(
        n in direction(),
        s in power_of_two(),
        cosine in 0.01..0.99f64,
        g in [-2.0..2.0f64, -2.0..2.0f64],
        p in vector(1e3),
    ) {
        let plane = snapped_projection::plane(n, cosine);
        prop_assert_eq!(plane == 2, n[2].abs() >= cosine);
        prop_assert_eq!(snapped_projection::plane(scale(n, s), cosine), plane);
        prop_assert_eq!(snapped_projection::plane([n[0], n[1], -n[2]], cosine), plane);
        prop_assert_eq!(snapped_projection::plane([-n[0], -n[1], n[2]], cosine), plane, "both sides of a wall must have the same plane");
        // On steep ground, the azimuth of the normal differs by at most 22.5 degrees from the horizontal direction along which the texture is
        // projected (`facing`), or from the opposite direction.
        let facing = [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0], [1.0, 1.0], [1.0, -1.0]][plane as usize];
        let azimuth = (facing[0] * n[0] + facing[1] * n[1]).abs() / (facing[0].hypot(facing[1]) * n[0].hypot(n[1]));
        prop_assert!(plane == 2 || azimuth >= (std::f64::consts::PI / 8.0).cos() - 1e-12, "{}", azimuth);
        // A height has the gradient `g` in the coordinates (u, v) of a plane, so it is g[0] u + g[1] v. `from_gradient` converts `g` to a gradient in
        // x, y and z, whose dot product with the position must be the same height. The tolerance covers the error of u on a diagonal plane:
        // `coordinates` uses 181/256 instead of 1/√2, which is 0.011 % too small.
        for plane in 0..5 {
            let [u, v] = snapped_projection::coordinates(p, plane);
            let lifted = dot(snapped_projection::from_gradient(g, plane), p);
            prop_assert!((lifted - (g[0] * u + g[1] * v)).abs() <= 1.4e-4 * g[0].abs() * (u.abs() + 1.0) + 1e-9, "plane {}", plane);
        }
    }

    #[test]
    fn snapped_coordinates_are_those_of_whole_sectors(
        place in [-100_000..100_000i32, -100_000..100_000i32, -100..100i32],
        more in [-9..9i32, -9..9i32, -9..9i32],
        rate in -1_000_000_000..1_000_000_000i32,
        plane in 0..5u32,
    ) {
        let whole = |place| snapped_projection::sectors(place, plane);
        let moved = whole(std::array::from_fn(|i| place[i] + more[i]));
        let (here, by) = (whole(place), whole(more));
        prop_assert_eq!(moved, [here[0] + by[0], here[1] + by[1]]);
        // `fixed` returns repeats per sector in units of 2^-24. On diagonal planes its error is less than one unit; on the other planes it is exact.
        let exact = f64::from(rate) * if plane > 2 { 181.0 / 256.0 } else { 1.0 };
        prop_assert!((f64::from(snapped_projection::fixed(rate, plane)) - exact).abs() < 1.0);
    }
}

// ---------------------------------------------------------------- choices

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn choices_keep_the_order_of_their_numbers(
        w in [unit(), unit(), unit(), unit()],
        holes in 0..16u32,
        u in unit(),
        v in unit(),
        s in power_of_two(),
    ) {
        let w: [f64; 4] = std::array::from_fn(|i| if holes >> i & 1 == 1 { 0.0 } else { w[i] });
        let chosen = select::of_4(w, u);
        prop_assert!(w[chosen] > 0.0 || sum(w) <= 0.0 && chosen == 0);
        prop_assert!((u <= v) || chosen >= select::of_4(w, v));
        prop_assert_eq!(select::of_4(w.map(|w| w * s), u), chosen, "weights need not sum to 1");
        // Removing an index of weight 0 does not change which of the other indices is chosen.
        prop_assert_eq!(select::of_4([w[0], w[1], w[2], 0.0], u), select::of_3([w[0], w[1], w[2]], u));
        prop_assert_eq!(select::of_4([0.0, w[0], w[1], w[2]], u).saturating_sub(1), select::of_3([w[0], w[1], w[2]], u));
        // An index is chosen if the random number lies in the interval of the index. The length of the interval is the weight of the index divided by
        // the sum of all weights.
        let below: f64 = w[..chosen].iter().sum();
        prop_assert!(u * sum(w) >= below - 1e-15 && u * sum(w) <= below + w[chosen] + 1e-15);
    }

    #[test]
    fn levels_and_texels_are_neighbours(
        lod in -3.0..20.0f64,
        levels in 1..16u32,
        u in unit(),
        c in -1e5..1e5f64,
        log2_size in 0..13u32,
        repeats in -1000..1000i32,
    ) {
        let (level, held) = (texel_choice::level(lod, levels, u), lod.clamp(0.0, f64::from(levels - 1)));
        prop_assert!(level < levels && (f64::from(level) - held).abs() < 1.0);
        let size = 1 << log2_size;
        let texel = texel_choice::texel(c, size, u);
        let off = (c * f64::from(size) - (f64::from(texel) + 0.5)).rem_euclid(f64::from(size));
        prop_assert!(texel < size && (off <= 1.0 || f64::from(size) - off <= 1.0), "{}", off);
        // Adding whole repeats to the coordinate does not change the texel.
        let place = (c * 1024.0).round() / 1024.0;
        prop_assume!((place + f64::from(repeats)).abs() <= 1e5);
        prop_assert_eq!(texel_choice::texel(place, size, u), texel_choice::texel(place + f64::from(repeats), size, u));
        // A random number close to 1 selects the level floor(lod). The random number 0 selects the next level, if lod is not a whole number.
        let (low, high) = (texel_choice::level(lod, levels, 0.999_999_999), texel_choice::level(lod, levels, 0.0));
        prop_assert!(low <= level && level <= high && high - low <= 1);
    }
}

// ---------------------------------------------------------------- layers

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn layers_blend_to_their_shares(f in [unit(), unit()], of in [0..8u32, 0..8u32, 0..8u32, 0..8u32]) {
        let texels = splat_blend::bilinear(f);
        let shares: [f64; layers::LAYERS] = std::array::from_fn(|layer| layers::share(texels, of, layer as u32));
        prop_assert!(is_partition(shares));
        let mut below = 0.0;
        let opacities = std::array::from_fn(|layer| {
            let opacity = layers::opacity(layer as u32, shares[layer], below);
            below += shares[layer];
            opacity
        });
        prop_assert!(opacities.iter().all(|p| (0.0..=1.0).contains(p)));
        prop_assert!(close(layers::weights(opacities), shares, 1e-14));
    }
}

// ---------------------------------------------------------------- tiling

fn same_hexagons(a: &HexTiling<f64>, b: &HexTiling<f64>, step: [u32; 2], tolerance: f64) -> bool {
    // Compares the weights of hexagons that correspond: their ids differ by `step`. The order of the hexagons does not matter. A point on the border
    // of two triangles of the lattice may be assigned to either triangle. A hexagon that belongs to only one of them then has the weight 0.
    a.ids.iter().zip(a.weights).all(|(id, w)| {
        let id = [0, 1].map(|i| (id[i] + step[i]) & 0xffff);
        let there: f64 = b.ids.iter().zip(b.weights).filter(|(other, _)| **other == id).map(|(_, v)| v).sum();
        (w - there).abs() <= tolerance
    })
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn hexagons_follow_whole_sectors(
        sector in [-1_000_000..1_000_000i32, -1_000_000..1_000_000i32],
        p in [0.0..64.0f64, 0.0..64.0f64],
        level in -10..=15i32,
        east in -5..5i32,
        north in -5..5i32,
    ) {
        let here = hex_tiling::at(sector, p, 64.0, level);
        prop_assert!(is_partition(here.weights));
        // A shift by 1024 sectors to the east or by 65 536 sectors to the north is a whole number of lattice spacings, even of the coarsest lattice.
        // So all bits of the weights stay the same.
        let moved = hex_tiling::at([sector[0] + 1024 * east, sector[1] + 65_536 * north], p, 64.0, level);
        prop_assert_eq!(here.weights, moved.weights);
        let steps = |sectors: i64, factor: i64| ((sectors * factor) << (10 + level) >> 16 & 0xffff) as u32;
        let (x, y) = (i64::from(1024 * east), i64::from(65_536 * north));
        let step = [steps(x * 64 - y * 37, 1), steps(y, 74)];
        prop_assert_eq!(here.ids.map(|id| [0, 1].map(|i| (id[i] + step[i]) & 0xffff)), moved.ids);
        // There is no seam at the edge of a sector. A point beyond the edge can be given by a position outside 0 to 64 m, or relative to the
        // neighbouring sector. Both must give the same hexagons.
        let over = hex_tiling::at(sector, [p[0] + 64.0, p[1] - 64.0], 64.0, level);
        let own = hex_tiling::at([sector[0] + 1, sector[1] - 1], p, 64.0, level);
        prop_assert!(same_hexagons(&over, &own, [0; 2], 1e-6), "{:?} {:?}", over, own);
        // If the length of a sector and the positions are multiplied by the same factor, the result does not change.
        let double = hex_tiling::at(sector, p.map(|p| p * 2.0), 128.0, level);
        prop_assert_eq!(here, double);
    }

    #[test]
    fn hexagon_weights_have_no_seam(p in [0.0..64.0f64, 0.0..64.0f64], step in [-1e-6..1e-6f64, -1e-6..1e-6f64], level in -10..=8i32) {
        let at = |p| hex_tiling::at([3, -5], p, 64.0, level);
        let (here, there) = (at(p), at([p[0] + step[0], p[1] + step[1]]));
        // Largest slope of a weight, per metre. Before normalisation, a weight is (b / b_max)^7, where b is a barycentric coordinate and b_max >= 1/3
        // is the largest of the three. With a constant b_max, the slope of a weight is at most 7 x 3 times the slope of b, which is at most 2 per
        // lattice spacing. The lattice spacing is 64 m / 2^level. The tolerance is four times the slope times the step of 1e-6 m, because b_max and
        // the sum of the weights change, too.
        let slope = 7.0 * 3.0 * 2.0 * f64::from(level).exp2() / 64.0;
        prop_assert!(same_hexagons(&here, &there, [0; 2], 4.0 * slope * 1e-6 + 1e-12));
        for id in here.ids {
            prop_assert!(hex_tiling::offset::<f64>(id, 3).iter().all(|x| (0.0..1.0).contains(x)));
        }
    }

    #[test]
    fn scales_follow_distance_and_its_unit(
        d in 0.0..1e5f64,
        e in 0.0..1e5f64,
        near in 0.1..100.0f64,
        cliff in unit(),
        s in power_of_two(),
        r in 1e-3..1e5f64,
    ) {
        let level = |d: f64| {
            let (scale, part) = tiling::scales(d, near, cliff);
            f64::from(scale) + part
        };
        prop_assert!(level(d.min(e)) <= level(d.max(e)) && level(d) <= tiling::MAX_LEVEL);
        let (scale, part) = tiling::scales(d, near, cliff);
        prop_assert!((0.0..1.0).contains(&part) || part == 0.0);
        prop_assume!(near * s > 1e-6 && d * s < 1e9);
        prop_assert_eq!(tiling::scales(d * s, near * s, cliff), (scale, part));
        // Hexagons become smaller if the texture repeats more often: doubling the repeats increases the level by one, except at the ends of the
        // range.
        let hex = hex_tiling::level(r);
        let [lowest, highest] = hex_tiling::LEVELS;
        let doubled = hex_tiling::level(r * 2.0);
        prop_assert!(hex <= hex_tiling::level(r * 1.5) && (doubled == hex + 1 || hex == highest || doubled == lowest), "{} {}", hex, doubled);
    }

    #[test]
    fn fixed_point_places_add_up(a in -1_000_000..1_000_000i32, b in -1_000_000..1_000_000i32, rate: i32, scale in 0..=8u32) {
        let at = |sector| tiling::fixed::<f64>(sector, rate, scale);
        let off = at(a) + at(b) - at(a + b);
        // Texture coordinates add up modulo 1. Each coordinate is rounded down to a multiple of 2^-24, so the sum may be off by 2^-24.
        prop_assert!((off - off.round()).abs() <= 1.0 / 16_777_216.0, "{}", off);
        prop_assert_eq!(at(0), 0.0);
    }
}

// ---------------------------------------------------------------- flavours

fn flavour_rules() -> impl Strategy<Value = FlavourRules> {
    (1.0..400.0f64, 10.0..89.0f64, 0.001..0.9f64, 0.001..20.0f64, 0.0..9.0f64, 1.0..100.0f64, 0.0..2000.0f64).prop_map(
        |(far_atlas_m, cliff_slope_deg, distance_blend, slope_blend_deg, splat_band_deg, cliff_near_m, more)| FlavourRules {
            far_atlas_m,
            cliff_slope_deg,
            distance_blend,
            slope_blend_deg,
            splat_band_deg,
            cliff_near_m,
            cliff_far_atlas_m: cliff_near_m.max(far_atlas_m) + more,
        },
    )
}

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn flavours_recede_in_their_order(
        rules in flavour_rules(),
        d in 0.0..4000.0f64,
        e in 0.0..4000.0f64,
        z in -1.0..1.0f64,
        y in -1.0..1.0f64,
    ) {
        let params = FlavourParams::new(&rules);
        let at = |d, z| flavour_weights::weights(d, z, &params);
        let (near, far) = (at(d.min(e), z), at(d.max(e), z));
        prop_assert!(is_partition(near));
        // With increasing distance, the weights of near cliff and splat never increase, and the weight of far atlas never decreases. The indices 0 to
        // 4 are virtual texture, far atlas, near cliff, far cliff and splat.
        prop_assert!(far[2] <= near[2] + 1e-15 && far[4] <= near[4] + 1e-15 && far[1] >= near[1] - 1e-15, "{:?} {:?}", near, far);
        // With increasing slope, the weight of the cliffs never decreases, and the weight of the virtual texture never increases.
        let (flat, steep) = (at(d, z.max(y)), at(d, z.min(y)));
        prop_assert!(steep[2] + steep[3] >= flat[2] + flat[3] - 1e-15 && steep[0] <= flat[0] + 1e-15, "{:?} {:?}", flat, steep);
        prop_assert!(flavour_weights::steep(z.min(y), params.cliff_cos) >= flavour_weights::steep(z.max(y), params.cliff_cos));
        let single: [f32; 5] = flavour_weights::weights(d as f32, z as f32, &params);
        prop_assert!((single.iter().sum::<f32>() - 1.0).abs() < 4.0 * f32::EPSILON);
    }

    #[test]
    fn weights_within_a_mask_stay_when_taken_again(w in [unit(), unit(), unit(), unit(), unit()], mask in 1..32u32, s in 0.0..1.0f64) {
        let total = sum(w).max(1e-9);
        let w = w.map(|x| x / total);
        let own = flavour_weights::weights_for(w, mask, false);
        prop_assert!(is_partition(own));
        prop_assert!((0..5).all(|i| mask >> i & 1 == 1 || own[i] == 0.0));
        prop_assert!(close(flavour_weights::weights_for(own, mask, false), own, 1e-14));
        let set = flavour_weights::mask(w);
        prop_assert!((1..32).contains(&set));
        // If all weights are multiplied by a factor below 1, no flavour is added to the mask, except far atlas (bit 1), which replaces an empty mask.
        prop_assert_eq!(flavour_weights::mask(w.map(|x| x * s)) & !set & !2, 0);
    }

    #[test]
    fn variants_and_estimators_have_one_name_each(mask in 0..=255u8) {
        match Variant::new(mask) {
            Some(variant) => prop_assert_eq!((variant.to_string().parse(), mask.to_string().parse()), (Ok(variant), Ok(variant))),
            None => prop_assert!(!(1..=31).contains(&mask) && mask.to_string().parse::<Variant>().is_err()),
        }
        let estimator = Estimator::ALL[usize::from(mask) % Estimator::ALL.len()];
        prop_assert_eq!(estimator.name().parse::<Estimator>().ok(), Some(estimator));
    }
}

// ---------------------------------------------------------------- brdf

proptest! {
    #![proptest_config(cases(1000))]

    #[test]
    fn highlights_peak_at_the_half_vector(a in unit(), b in unit(), alpha in 0.002..1.0f64) {
        let (low, high) = (a.min(b), a.max(b));
        prop_assert!(brdf::d_ggx(low, alpha) >= 0.0 && brdf::d_ggx(low, alpha) <= brdf::d_ggx(high, alpha) * (1.0 + 1e-14));
        prop_assert!((brdf::d_ggx(a, 1.0) * std::f64::consts::PI - 1.0).abs() < 1e-14, "alpha 1 must have no highlight");
        // A rougher surface has a lower peak.
        prop_assert!(brdf::d_ggx(1.0, alpha) >= brdf::d_ggx(1.0, (alpha + b).min(1.0)));
        let (narrow, wide) = single([a, alpha]);
        let (got, want) = (f64::from(brdf::d_ggx(narrow[0], narrow[1])), brdf::d_ggx(wide[0], wide[1]));
        prop_assert!((got / want - 1.0).abs() < 32.0 * ULP, "{} {}", got, want);
    }

    #[test]
    fn visibility_is_alike_both_ways(v in 0.001..1.0f64, l in 0.001..1.0f64, more in unit(), alpha in 0.002..1.0f64) {
        let g = brdf::v_smith_ggx_correlated(v, l, alpha);
        prop_assert!((brdf::v_smith_ggx_correlated(l, v, alpha) / g - 1.0).abs() < 1e-14);
        // Masking must be stronger at grazing angles. The masking term is G = 4 v l V. Here v = n.v and l = n.l are the cosines between the normal
        // and the directions to the eye and to the light, and V is the visibility. G must not decrease when v increases, and must be at most 1.
        let masked = |v: f64| 4.0 * v * l * brdf::v_smith_ggx_correlated(v, l, alpha);
        prop_assert!(masked(v) <= masked((v + more).min(1.0)) * (1.0 + 1e-13) && masked(v) <= 1.0 + 1e-13);
        prop_assert!(masked(v) >= 4.0 * v * l * brdf::v_smith_ggx_correlated(v, l, 1.0) * (1.0 - 1e-13), "masking must be strongest for alpha 1");
    }

    #[test]
    fn reflectance_grows_towards_grazing(
        f0 in [unit(), unit(), unit()],
        more in unit(),
        u in unit(),
        v in unit(),
        r in unit(),
        s in unit(),
    ) {
        let (low, high) = (brdf::f_schlick(f0, u.max(v)), brdf::f_schlick(f0, u.min(v)));
        for k in 0..3 {
            prop_assert!(f0[k] <= low[k] && low[k] <= high[k] && high[k] <= 1.0);
        }
        prop_assert!(brdf::alpha(r.min(s)) <= brdf::alpha(r.max(s)));
        let (some, brighter) = (brdf::env_approx(f0, r, u), brdf::env_approx(f0.map(|f| f + more * (1.0 - f)), r, u));
        prop_assert!((0..3).all(|k| brighter[k] >= some[k] - 1e-15 && some[k] >= 0.0 && brighter[k] <= 1.0), "{:?} {:?}", some, brighter);
    }
}

// ---------------------------------------------------------------- moments

fn moments_of(samples: impl IntoIterator<Item = f64>) -> Moments<f64> {
    let mut moments = Moments::new();
    samples.into_iter().for_each(|s| moments.add([s, 0.0]));
    moments
}

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn moments_do_not_see_origin_order_or_unit(
        samples in vec(-1e3..1e3f64, 2..60),
        offset in -1e6..1e6f64,
        s in power_of_two(),
        turn in 0..60usize,
    ) {
        let moments = moments_of(samples.iter().copied());
        let n = samples.len() as f64;
        let mean = samples.iter().sum::<f64>() / n;
        let variance = samples.iter().map(|s| (s - mean).powi(2)).sum::<f64>() / (n - 1.0);
        let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + b.abs());
        prop_assert!(near(moments.mean(), mean) && near(moments.variance(), variance));
        let moved = moments_of(samples.iter().map(|s| s + offset));
        prop_assert!(near(moved.mean(), mean + offset) && (moved.variance() - variance).abs() <= 1e-6 * (1.0 + variance));
        let scaled = moments_of(samples.iter().map(|x| x * s));
        prop_assert_eq!((scaled.mean(), scaled.variance()), (moments.mean() * s, moments.variance() * s * s));
        let turned = moments_of(samples.iter().cycle().skip(turn).take(samples.len()).copied());
        prop_assert!(near(turned.mean(), mean) && near(turned.variance(), variance));
        let error = moments.standard_error().expect("two samples at least");
        prop_assert!(near(error * error * n, variance));
        prop_assert_eq!(moments_of(samples[..1].iter().copied()).standard_error(), None);
    }

    #[test]
    fn moments_in_f32_keep_their_digits(samples in vec(-1.0..1.0f64, 2..200), around in -1e6..1e6f64) {
        // As in the shader, a sample is given as the sum of two numbers.
        let mut narrow = Moments::<f32>::new();
        let parts: Vec<[f32; 2]> = samples.iter().map(|s| [around as f32, *s as f32]).collect();
        parts.iter().for_each(|p| narrow.add(*p));
        let mut wide = Moments::<f64>::new();
        parts.iter().for_each(|p| wide.add(p.map(f64::from)));
        let (mean, variance) = (wide.mean(), wide.variance());
        prop_assert!((narrow.mean() - mean).abs() <= 8.0 * ULP * ULP * around.abs() + 4.0 * ULP, "{} {}", narrow.mean(), mean);
        prop_assert!((narrow.variance() - variance).abs() <= 64.0 * ULP * (variance + 1e-3), "{} {}", narrow.variance(), variance);
    }
}

// ---------------------------------------------------------------- signal

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn signals_go_there_and_back(colour in [0.0..65_000.0f32, 1e-4..1.0f32, -1.0..1.0f32], fetches: u16, choice in 0..64u32) {
        let packed = signal::pack(colour, fetches.into(), choice);
        prop_assert!(signal::is_terrain(packed) && !signal::is_terrain([packed[0], packed[1] & !signal::TERRAIN]));
        prop_assert_eq!((signal::fetches(packed), signal::choice(packed)), (u32::from(fetches).min(1023), choice.min(31)));
        let again = signal::colour(packed);
        // The tolerance is the rounding error of f16: at most 2^-11 of the value, or, near zero, half of the smallest step of 2^-24.
        prop_assert!((0..3).all(|k| (again[k] - colour[k]).abs() <= (colour[k].abs() / 2048.0).max(3e-8)), "{:?}", again);
        prop_assert_eq!(signal::pack(again, fetches.into(), choice), packed, "a colour that was packed must be packed to the same words again");
        prop_assert!((signal::luminance([colour[0]; 3]) - f64::from(colour[0])).abs() <= 1e-12 * f64::from(colour[0]));
    }
}

// ---------------------------------------------------------------- camera and motion

fn pose() -> impl Strategy<Value = Pose> {
    (vector(5000.0), -7.0..7.0, -1.57..1.57, 0.05..2.9).prop_map(|(p, yaw, pitch, fov)| Pose {
        position: DVec3::from_array(p),
        yaw,
        pitch,
        fov,
    })
}

fn view() -> impl Strategy<Value = View> {
    (pose(), 1..2000u32, 1..2000u32, [-0.5..0.5, -0.5..0.5])
        .prop_map(|(pose, w, h, jitter)| View::new(pose, [w, h], jitter, 64.0, 10_240.0))
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn a_camera_has_right_angles(pose in pose()) {
        let [right, up, forward] = pose.axes();
        for (a, b) in [(right, up), (up, forward), (forward, right)] {
            prop_assert!(a.dot(b).abs() < 1e-14 && (a.length() - 1.0).abs() < 1e-14);
        }
        prop_assert!(right.cross(up).dot(forward) < -1.0 + 1e-12, "x right, y up, looking along +z: left-handed");
        prop_assert!(up.z >= 0.0 && right.z == 0.0);
    }

    #[test]
    fn a_camera_moved_by_sectors_sees_the_same(view in view(), east in -30..30i32, north in -30..30i32) {
        let rounded = |p: DVec3| (p * 1024.0).round() / 1024.0;
        let at = |offset: DVec3| {
            let position = rounded(view.pose.position) + offset;
            View::new(Pose { position, ..view.pose }, view.size, [0.0; 2], 64.0, 10_240.0)
        };
        let (here, there) = (at(DVec3::ZERO), at(DVec3::new(f64::from(east) * 64.0, f64::from(north) * 64.0, 0.0)));
        prop_assert_eq!((there.sector.x - here.sector.x, there.sector.y - here.sector.y), (east, north));
        prop_assert_eq!((here.camera, here.clip_from_local), (there.camera, there.clip_from_local));
        prop_assert!(here.camera.truncate().cmpge(DVec2::ZERO).all() && here.camera.truncate().cmplt(DVec2::splat(64.0)).all());
    }

    #[test]
    fn what_is_in_the_picture_is_not_culled(
        view in view(),
        x in unit(),
        y in unit(),
        log2_depth in -2.0..14.0f64,
        size in vector(50.0),
        share in [unit(), unit(), unit()],
    ) {
        // A box around a point that some pixel shows must count as visible.
        let pixel = DVec2::new(x * f64::from(view.size[0]) - 0.5, y * f64::from(view.size[1]) - 0.5);
        let place = view.camera + view.ray(pixel.x, pixel.y) * log2_depth.exp2();
        let (size, share) = (DVec3::from_array(size).abs() + 1e-6, DVec3::from_array(share));
        prop_assert!(view.sees(place - size * share, place + size * (1.0 - share)));
        // If a box is visible, any larger box that contains it must be visible, too.
        let elsewhere = view.camera + size * 40.0 * (share - 0.5);
        prop_assert!(!view.sees(elsewhere - size * share, elsewhere + size) || view.sees(elsewhere - size, elsewhere + size * 1.5));
        // A box behind the camera must not count as visible.
        let behind = view.camera - view.pose.axes()[2] * (size.length() * 2.0 + 1.0);
        prop_assert!(!view.sees(behind - size, behind + size));
    }

    #[test]
    fn rays_and_clip_space_agree(view in view(), x in unit(), y in unit(), log2_depth in -2.0..14.0f64) {
        let (pixel, depth) = (DVec2::new(x, y) * DVec2::new(f64::from(view.size[0]), f64::from(view.size[1])), log2_depth.exp2());
        let clip = view.clip_from_local * (view.camera + view.ray(pixel.x, pixel.y) * depth).extend(1.0);
        let seen = DVec4::new(clip.x / clip.w * 0.5 + 0.5, 0.5 - clip.y / clip.w * 0.5, clip.z, clip.w);
        let expected = (pixel + 0.5) / DVec2::new(f64::from(view.size[0]), f64::from(view.size[1]));
        prop_assert!((seen.truncate().truncate() - expected).length() < 1e-9, "{} {}", seen, expected);
        prop_assert!((seen.w / depth - 1.0).abs() < 1e-9);
    }

    #[test]
    fn paths_pass_their_keys_and_end_at_the_last(
        keys in vec((vector(1e3), -400.0..400.0f64, -80.0..80.0f64, 20.0..100.0f64), 2..6),
        per_key in 1..9u32,
        key in 0..5usize,
        beyond: u16,
    ) {
        let keys: Vec<CameraPose> = keys
            .into_iter()
            .map(|(position, yaw_deg, pitch_deg, fov_deg)| {
                let name = String::new();
                CameraPose { name, position, above_ground: false, yaw_deg, pitch_deg, fov_deg }
            })
            .collect();
        let path = CameraPath { name: String::new(), frames_per_key: per_key, keys };
        let key = key.min(path.keys.len() - 1);
        let (pose, wanted) = (along(&path, key as u32 * per_key, |_, _| 0.0), Pose::of(&path.keys[key], |_, _| 0.0));
        prop_assert_eq!((pose.position, pose.pitch, pose.fov), (wanted.position, wanted.pitch, wanted.fov));
        let turns = (pose.yaw - wanted.yaw) / std::f64::consts::TAU;
        prop_assert!((turns - turns.round()).abs() < 1e-12, "whole turns only");
        let last = along(&path, path.frames() as u32 - 1, |_, _| 0.0);
        prop_assert_eq!(along(&path, path.frames() as u32 + u32::from(beyond), |_, _| 0.0), last);
    }

    #[test]
    fn motion_goes_there_and_back(
        now in view(),
        past in view(),
        pixel in [unit(), unit()],
        t in 0.5..3000.0f64,
        n in direction(),
        s in 0.5..2.0f64,
    ) {
        let to_past = Past::between(&now, &past);
        let pixel = [pixel[0] * f64::from(past.size[0]), pixel[1] * f64::from(past.size[1])];
        // The point that a pixel of the earlier picture shows, relative to the eye of the later view.
        let ray = past.ray(pixel[0], pixel[1]);
        let point = (ray * t - (now.pose.position - past.pose.position)).to_array();
        let [x, y, distance] = motion::reproject(point, &to_past);
        let scale_px = 1.0 / past.ray_dx.length().min(past.ray_dy.length());
        // The tolerance covers the rounding error of `point`, which is computed from the difference of two eye positions (up to 17 km long) and from
        // the distance `t`. The error is about 2^-52 times the larger of these lengths. It shifts the pixel by about the error, divided by `t` and
        // multiplied by `scale_px`, the number of pixels per unit of the ray.
        let tolerance = 1e-11 * (1.0 + scale_px) * (1.0 + 1e4 / t) * (1.0 + ray.length());
        prop_assert!((x - pixel[0]).abs() < tolerance && (y - pixel[1]).abs() < tolerance, "{} {} {:?}", x, y, pixel);
        prop_assert!((distance / t - 1.0).abs() < 1e-9);
        let again = motion::past_ray(&to_past, [x, y]);
        prop_assert!(length(sub(again, ray.to_array())) < 1e-9 * (1.0 + ray.length()), "{:?} {}", again, ray);
        prop_assert!((dot(again, to_past.forward) - 1.0).abs() < 1e-9 * (1.0 + ray.length()));
        // The ray must meet a plane through the point at the point itself, whatever the sign and the length of the plane's normal.
        let along = dot(n, again).abs() / length(again);
        prop_assume!(along > 1e-3);
        let met = motion::expected_distance(point, &to_past, again, n);
        prop_assert!((met / t - 1.0).abs() < 1e-7, "{} {}", met, t);
        prop_assert!((motion::expected_distance(point, &to_past, again, scale(n, -s)) / met - 1.0).abs() < 1e-12);
        prop_assert!(motion::same_surface(met, t, 1e-6) && motion::same_surface(met * s, t * s, 1e-6));
        prop_assert_eq!(motion::same_surface(t * s, t, 0.1), (s - 1.0).abs() <= 0.1);
    }

    #[test]
    fn a_view_seen_from_itself_stands_still(view in view(), x in unit(), y in unit(), log2_depth in -2.0..12.0f64) {
        let still = Past::between(&view, &view);
        let pixel = [x * f64::from(view.size[0]), y * f64::from(view.size[1])];
        let point = (view.ray(pixel[0], pixel[1]) * log2_depth.exp2()).to_array();
        let [px, py, _] = motion::reproject(point, &still);
        prop_assert!((px - pixel[0]).abs() < 1e-7 && (py - pixel[1]).abs() < 1e-7);
        let uniform = still.uniform();
        prop_assert_eq!((still.cast::<f32>().forward, uniform.offset), (uniform.forward, [0.0; 3]));
        for quarter in 0..4 {
            let count = (0..16u32).filter(|&row| motion::in_quarter(row, quarter)).count();
            prop_assert_eq!(count, 4);
        }
    }
}

// ---------------------------------------------------------------- geometry, quadtree, culling

fn node() -> impl Strategy<Value = NodeId> {
    (0..6u8, unit(), unit()).prop_map(|(lod, x, y)| {
        let side = f64::from(NodeId::per_side(lod));
        NodeId { lod, x: (x * side) as u16, y: (y * side) as u16 }
    })
}

/// What the patches on one of the two sides of a line have on this line. `vertices`: the drawn vertices, each given by its coordinates along and
/// across the line, in quads of LOD 0. `covered`: the sections of the line, each 16 quads of LOD 0 long, along which a patch lies.
#[derive(Default)]
struct Border {
    vertices: BTreeSet<[u64; 2]>,
    covered: BTreeSet<u64>,
}

proptest! {
    #![proptest_config(cases(500))]

    #[test]
    fn welding_twice_is_welding_once(x in 0..=128u32, y in 0..=128u32, other in 0..=128u32, delta in 0..6u32, deltas in 0..0x1_0000u32) {
        let deltas = deltas & 0x5555 | delta;
        let kept = geometry::weld(x, delta);
        prop_assert_eq!(geometry::weld(kept, delta), kept);
        prop_assert!(geometry::weld(x.min(other), delta) <= geometry::weld(x.max(other), delta), "welding keeps the order");
        // Stitching a stitched vertex changes nothing.
        let stitched = geometry::stitch([x, y], [0, 0], 128, deltas);
        prop_assert_eq!(geometry::stitch(stitched, [0, 0], 128, deltas), stitched);
        if (1..128).contains(&x) && (1..128).contains(&y) {
            prop_assert_eq!(stitched, [x, y], "vertices inside a node must not move");
        }
        // Two neighbouring nodes of the same level must weld the vertices of their common edge in the same way.
        let (east, west) = (geometry::stitch([128, y], [0, 0], 128, delta << 8), geometry::stitch([0, y], [0, 0], 128, delta));
        prop_assert_eq!(east[1], west[1]);
    }

    #[test]
    fn patches_on_both_sides_of_a_line_have_the_same_vertices(splits in vec(any::<bool>(), 60), strides in vec(0..5u8, 64), most in 0..5u8, least in 0..3u8) {
        // Two nodes of LOD 5, which are divided into nodes of random LODs.
        let mut open = vec![NodeId { lod: 5, x: 1, y: 1 }, NodeId { lod: 5, x: 2, y: 1 }];
        let mut splits = splits.into_iter();
        let mut nodes = Vec::new();
        while let Some(node) = open.pop() {
            if node.lod > 0 && splits.next() == Some(true) {
                open.extend(node.children());
            } else {
                nodes.push(node);
            }
        }
        let levels = Levels::new(&nodes, least, |node, [column, row]| {
            let node = nodes[node];
            let index = 7 * usize::from(node.x) + 13 * usize::from(node.y) + 3 * column as usize + 5 * row as usize;
            strides[index % 64].min(most)
        });
        // For each line that contains sides of patches: first the border of the patches east or north of it, then that of the patches west or south
        // of it. The key is the axis across the line (0 = x, 1 = y), and the coordinate of the line on this axis, in quads of LOD 0.
        let mut lines: HashMap<(usize, u64), [Border; 2]> = HashMap::new();
        for (&node, patch) in nodes.iter().flat_map(|node| (0..64u32).map(move |i| (node, [i % 8, i / 8]))) {
            let (stride, deltas) = (1 << levels.log2_stride(node, patch), levels.deltas(node, patch));
            let first = patch.map(|n| n * 16);
            let place = |index: [u32; 2]| [(index[0], node.x), (index[1], node.y)].map(|(i, n)| (u64::from(n) * 128 + u64::from(i)) << node.lod);
            for (axis, far) in [(0, false), (0, true), (1, false), (1, true)] {
                let Border { vertices, covered } = &mut lines.entry((axis, place(first.map(|at| at + if far { 16 } else { 0 }))[axis])).or_default()[usize::from(far)];
                for k in (0..=16).step_by(stride) {
                    let mut index = first;
                    index[axis] += if far { 16 } else { 0 };
                    index[1 - axis] += k;
                    let kept = geometry::stitch(index, first, 16, deltas);
                    let at = place(kept);
                    vertices.insert([at[1 - axis], at[axis]]);
                }
                let parts = [0, 16].map(|k| place(first.map(|at| at + k))[1 - axis] / 16);
                covered.extend(parts[0]..parts[1]);
            }
        }
        let mut compared = 0;
        for (line, [before, after]) in &lines {
            let is_covered = |part: u64| before.covered.contains(&part) && after.covered.contains(&part);
            for place in before.vertices.union(&after.vertices).filter(|[along, _]| is_covered(along / 16) && is_covered((along - 1) / 16)) {
                prop_assert!(before.vertices.contains(place) && after.vertices.contains(place), "line {:?}, {:?}: {:?}", line, place, nodes);
                compared += 1;
            }
        }
        prop_assert!(compared > 100, "{}", compared);
    }

    #[test]
    fn no_patch_that_a_pixel_shows_is_culled(
        view in view(),
        frozen in view(),
        lod in 0..6u8,
        x in unit(),
        y in unit(),
        log2_depth in 0.0..10.0f64,
    ) {
        let layout = Layout::of(10_240.0, None);
        // Finds the node and the patch at the point that a pixel of the culling view (`frozen`) shows.
        let pixel = [x * f64::from(frozen.size[0]) - 0.5, y * f64::from(frozen.size[1]) - 0.5];
        let offset = frozen.ray(pixel[0], pixel[1]) * log2_depth.exp2();
        let place = frozen.pose.position + offset;
        let Some(node) = layout.node_at(lod, place.x, place.y) else { return Ok(()) };
        let bounds = NodeBounds { height_m: [place.z - 1.0, place.z + 1.0] };
        let (low, high) = quadtree::local_box(node, bounds, &layout, &frozen);
        let local = frozen.camera + offset;
        prop_assert!((low - 1e-6).cmple(local).all() && local.cmple(high + 1e-6).all());
        let levels = Levels::new(&[node], 0, |_, _| 0);
        let cone = Cone { axis: [0.0, 0.0, 1.0], sin_half_angle: 1.0 };
        let own = [PatchBounds { height_m: bounds.height_m, errors_m: [f64::INFINITY; 4], cone }; 64];
        let drawn = DrawnNode { node, slot: 3, bounds, patches: &own };
        let conditions = Conditions { layout: &layout, levels: &levels, rounding_m: 0.0, culls: Culls::ALL };
        let patches = culling::cull(&[drawn], [&view, &frozen], conditions).patches;
        let within = (place.truncate() - node.origin_m(&layout)) / layout.node_m(lod) * f64::from(culling::PATCHES);
        let wanted = [within.x, within.y].map(|v| (v as u32).min(culling::PATCHES - 1));
        // If the point lies on the border of two patches, rounding decides which of them contains it.
        let near_border = [within.x, within.y].iter().any(|v| (v - v.round()).abs() < 1e-6);
        prop_assert!(near_border || patches.iter().any(|p| p.patch == wanted), "{:?} of {} patches", wanted, patches.len());
        for patch in &patches {
            prop_assert_eq!((patch.slot, patch.lod), (3, u32::from(lod)));
            prop_assert!((f64::from(patch.spacing) - layout.spacing_m(lod)).abs() < 1e-9);
        }
        // The origin of a node must be relative to the view that draws it (`view`), not to the culling view.
        let origin = node.origin_m(&layout) - (view.pose.position - view.camera).truncate();
        prop_assert!(patches.iter().all(|p| (DVec2::new(p.node_origin[0].into(), p.node_origin[1].into()) - origin).length() < 1e-3));
    }

    #[test]
    fn nothing_is_left_out_that_a_pixel_shows(
        view in view(),
        x in unit(),
        y in unit(),
        log2_depth in -3.0..12.0f64,
        share in [unit(), unit(), unit()],
        log2_size in -8.0..8.0f64,
    ) {
        // The box lies around a point that a pixel shows. Box and matrix are rounded to f32. The loop below projects 27 points of the box to pixels.
        // Each pixel must lie in the rectangle that `cover` returns for the box; otherwise, a visible box could be culled.
        let size = view.size.map(f64::from);
        let middle = view.camera + view.ray(x * size[0] - 0.5, y * size[1] - 0.5) * log2_depth.exp2();
        let held = |x: f64| f64::from(x as f32);
        let corner = |side: f64| [0, 1, 2].map(|i| held(middle[i] + (side - share[i]) * log2_size.exp2()));
        let (low, high) = (corner(0.0), corner(1.0));
        let rows = [0, 1, 3].map(|k| view.clip_from_local.row(k).to_array().map(held));
        let near = held(NEAR_M);
        let narrow = |v: [f64; 3]| v.map(|x| x as f32);
        let double = seen::cover(rows, near, low, high, size);
        let single = seen::cover(rows.map(|row| row.map(|x| x as f32)), near as f32, narrow(low), narrow(high), size.map(|x| x as f32));
        let single = single.map(|c| seen::Cover { first: c.first.map(f64::from), last: c.last.map(f64::from), depth: f64::from(c.depth) });
        for k in 0..27 {
            let at = |axis: usize| f64::from(k / [1, 3, 9][axis] % 3) / 2.0;
            let place = [0, 1, 2].map(|i| low[i] + at(i) * (high[i] - low[i]));
            let [cx, cy, w] = rows.map(|r| r[0] * place[0] + r[1] * place[1] + r[2] * place[2] + r[3]);
            let pixel = [(0.5 + 0.5 * cx / w) * size[0], (0.5 - 0.5 * cy / w) * size[1]].map(f64::floor);
            if w < near || !(0..2).all(|i| (0.0..size[i]).contains(&pixel[i])) {
                continue;
            }
            prop_assert!(view.sees(DVec3::from_array(low), DVec3::from_array(high)));
            for cover in [double, single].into_iter().flatten() {
                prop_assert!((0..2).all(|i| cover.first[i] <= pixel[i] && pixel[i] <= cover.last[i]), "{:?} of {:?}", pixel, cover);
                prop_assert!(cover.depth >= near / w && !seen::hidden(cover.depth, [1.0, 1.0, near / w, 1.0]));
            }
        }
    }

    #[test]
    fn no_patch_faces_away_of_which_some_normal_faces_the_eye(
        axis in direction(),
        lean in direction(),
        log2_share in -20.0..0.0f64,
        half_deg in 0.0..85.0f64,
        to_patch in vector(1000.0),
        aside in direction(),
        radius_share in 0.0..1.2f64,
        inside in unit(),
    ) {
        let sine = half_deg.to_radians().sin();
        // A normal inside the cone: its angle to the axis is at most the half angle of the cone.
        let angle = half_deg.to_radians() * log2_share.exp2();
        let across = octahedral::unit(sub(lean, scale(axis, dot(lean, axis))));
        let normal = add(scale(axis, angle.cos()), scale(across, angle.sin()));
        let radius = radius_share * length(to_patch);
        let place = add(to_patch, scale(aside, radius * inside));
        prop_assume!(dot(normal, place) <= -1e-9 * length(place));
        prop_assert!(!seen::faces_away(axis, sine, to_patch, radius));
        let narrow = |v: [f64; 3]| v.map(|x| x as f32);
        prop_assert!(!seen::faces_away(narrow(axis), sine as f32, narrow(to_patch), radius as f32));
    }

    #[test]
    fn nodes_are_where_they_say(node in node(), x in unit(), y in unit()) {
        let layout = Layout::of(10_240.0, None);
        let place = node.origin_m(&layout) + DVec2::new(x, y) * layout.node_m(node.lod);
        prop_assert_eq!(layout.node_at(node.lod, place.x, place.y), Some(node));
        if let Some(parent) = node.parent() {
            prop_assert!(parent.children().contains(&node));
            prop_assert_eq!(layout.node_at(parent.lod, place.x, place.y), Some(parent));
        }
        let map = quadtree::lod_map(&[node]);
        let sectors = [place.x, place.y].map(|v| (v + layout.world_m() / 2.0) / layout.sector_m);
        prop_assert_eq!(quadtree::lod_at(&map, sectors), Some(node.lod));
        prop_assert_eq!(quadtree::lod_at(&map, [-1e-9, sectors[1]]), None);
        let slot = 1 + u32::from(node.x) % 1000;
        let data = quadtree::sector_data([(node, slot)].into_iter());
        let [low, high] = data[sectors[1] as usize * usize::from(SECTORS) + sectors[0] as usize];
        let bits = u64::from(high) << 32 | u64::from(low);
        prop_assert_eq!(bits, u64::from(slot) << (u32::from(node.lod) * quadtree::SLOT_BITS));
        let covered = data.iter().filter(|d| **d != [0, 0]).count();
        prop_assert_eq!(covered, 1usize << (2 * node.lod));
    }
}

// ---------------------------------------------------------------- blocks and cones

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn cones_hold_what_they_were_made_of(axis in direction(), tilts in vec(vec((direction(), unit()), 1..8), 64), spread in 0.0..2.0f64) {
        // For each patch, draws unit normals in the upper half space, scattered around `axis`.
        let normals: Vec<Vec<[f64; 3]>> = tilts
            .iter()
            .map(|patch| {
                let tilted = |(d, s): &([f64; 3], f64)| real::normalize(add([axis[0], axis[1], axis[2].abs()], scale(*d, s * spread)));
                patch.iter().map(tilted).map(|[x, y, z]| [x, y, z.abs()]).collect()
            })
            .collect();
        for (cone, normals) in cones::decode(&cones::encode(&normals)).iter().zip(&normals) {
            prop_assert!((length(cone.axis) - 1.0).abs() < 1e-12 && cone.axis[2] >= 0.0);
            prop_assert!(normals.iter().all(|&n| cone.contains(n)), "{:?} {:?}", cone, normals);
        }
    }

    #[test]
    fn alpha_never_decodes_below_what_is_needed(needed in vec(any::<u8>(), 16), narrow in any::<u8>(), width in 0..16u8) {
        let wide: [u8; 16] = std::array::from_fn(|i| needed[i]);
        let close = wide.map(|v| narrow.saturating_add(v % (width + 1)));
        for needed in [wide, close, [narrow; 16]] {
            let mut block = [0; 16];
            block[..8].copy_from_slice(&blocks::alpha_block_at_least(needed));
            let decoded = blocks::decode(BlockFormat::Bc3, &block, 4, 4);
            prop_assert!(decoded.chunks_exact(4).zip(needed).all(|(texel, n)| texel[3] >= n), "{:?}", needed);
        }
        let mut block = [0; 16];
        block[..8].copy_from_slice(&blocks::alpha_block_at_least([narrow; 16]));
        prop_assert!(blocks::decode(BlockFormat::Bc3, &block, 4, 4).chunks_exact(4).all(|texel| texel[3] == narrow), "one value must be exact");
    }

    #[test]
    fn blocks_of_any_bits_are_pictures(bits in vec(any::<u8>(), 16), colour: [u8; 3], width in 1..9usize, height in 1..9usize) {
        prop_assert_eq!(blocks::decode(BlockFormat::Bc3, &bits, 4, 4).len(), 64);
        prop_assert_eq!(blocks::decode(BlockFormat::Bc1, &bits[..8], 4, 4).len(), 64);
        // The end points of a block have 5 or 6 bits per channel. So a channel of a block of one colour has an error of at most about half a step of
        // 5 bits, which is 4.1 of 255.
        let texels = [colour[0], colour[1], colour[2], 255].repeat(width * height);
        for format in [BlockFormat::Bc1, BlockFormat::Bc3] {
            let encoded = blocks::encode(format, &texels, width, height, [1.0; 3], Effort::Fast);
            prop_assert_eq!(encoded.len(), format.image_bytes(width, height));
            for texel in blocks::decode(format, &encoded, width, height).chunks_exact(4) {
                prop_assert!((0..3).all(|k| texel[k].abs_diff(colour[k]) <= 5) && texel[3] == 255, "{:?} {:?}", texel, colour);
            }
        }
    }
}

// ---------------------------------------------------------------- heights and words

proptest! {
    #![proptest_config(cases(256))]

    #[test]
    fn heights_between_samples_follow_a_plane(
        slope in [-3.0..3.0f64, -3.0..3.0f64],
        spacing in 0.5..50.0f64,
        width in 4..12u32,
        height in 4..12u32,
        u in unit(),
        v in unit(),
    ) {
        let extent = [width, height].map(|n| f64::from(n - 1) * spacing);
        let plane = |x: f64, y: f64| 100.0 + slope[0] * x + slope[1] * y;
        let at = |i: u32| (f64::from(i % width) * spacing - extent[0] / 2.0, extent[1] / 2.0 - f64::from(i / width) * spacing);
        let samples = (0..width * height).map(|i| plane(at(i).0, at(i).1) as f32).collect();
        let map = Heightmap { width, height, metres_per_texel: spacing, samples };
        // The point is at least one spacing away from the edge of the map, so that all 4 x 4 samples of the bicubic interpolation are inside the map.
        let inside = |share: f64, extent: f64| (share - 0.5) * (extent - 2.0 * spacing);
        let (x, y) = (inside(u, extent[0]), inside(v, extent[1]));
        let (h, dx, dy) = map.sample(x, y);
        let rounding = 4.0 * ULP * (100.0 + extent[0] * 3.0 + extent[1] * 3.0);
        prop_assert!((h - plane(x, y)).abs() <= rounding);
        prop_assert!(close([dx, dy], slope, rounding / spacing * 8.0), "{} {}", dx, dy);
        prop_assert!((map.max_slope() - slope[0].hypot(slope[1])).abs() <= rounding / spacing * 8.0);
        // The surface passes through the samples. Beyond the edge, it has the height at the edge.
        let i = (u * f64::from(width * height)) as u32;
        let (h, ..) = map.sample(at(i).0, at(i).1);
        prop_assert!((h - f64::from(map.samples[i as usize])).abs() <= rounding);
        prop_assert!((map.sample(extent[0], y).0 - map.sample(extent[0] / 2.0, y).0).abs() <= rounding);
    }

    #[test]
    fn the_nearest_word_is_a_known_one(word in vec(any::<char>(), 0..12), at in 0..4usize, slip in 0..8usize) {
        let known = ["height_m", "slope_deg", "far_atlas_m", "noise_cover"];
        let word: String = word.into_iter().collect();
        prop_assert!(nearest(&word, &known).is_none_or(|near| known.contains(&near)));
        prop_assert_eq!(nearest(known[at], &known), Some(known[at]));
        let mut slipped: Vec<char> = known[at].chars().collect();
        slipped.remove(slip);
        let slipped: String = slipped.into_iter().collect();
        prop_assert_eq!(nearest(&slipped.to_uppercase().replace('_', "-"), &known), Some(known[at]));
    }
}

// ---------------------------------------------------------------- any bits

/// Generates ordinary numbers, extreme numbers (including infinities and NaN), and numbers with random bit patterns.
fn any_number<T: Real>() -> impl Strategy<Value = T> {
    const EXTREMES: [f64; 22] = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        1e-45,
        -1e-45,
        1e-38,
        1e-20,
        1e-310,
        65_504.0,
        65_520.0,
        1e9,
        4.9e17,
        -4.9e17,
        1.9e19,
        1e30,
        3e38,
        -3e38,
        1e308,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    prop_oneof![
        3 => (-2.0..2.0f64).prop_map(T::of),
        2 => (0..EXTREMES.len()).prop_map(|i| T::of(EXTREMES[i])),
        1 => any::<u32>().prop_map(|bits| T::of(f64::from(f32::from_bits(bits)))),
        1 => any::<u64>().prop_map(|bits| T::of(f64::from_bits(bits))),
    ]
}

fn any_numbers<T: Real, const N: usize>() -> impl Strategy<Value = [T; N]> {
    vec(any_number::<T>(), N).prop_map(|v| std::array::from_fn(|i| v[i]))
}

fn are_finite<T: Real, const N: usize>(x: [T; N]) -> bool {
    x.iter().all(|x| x.is_finite())
}

/// Whether the numbers, rounded to f32, have a finite sum of squares. Callers compute lengths in f32.
fn have_length<T: Real, const N: usize>(x: [T; N]) -> bool {
    let narrow = x.map(|x| x.to_f64() as f32);
    dot(narrow, narrow).is_finite()
}

fn any_past<T: Real>() -> impl Strategy<Value = Past<T>> {
    (any_numbers(), any_numbers(), any_numbers(), any_numbers(), any_number(), any_number())
        .prop_map(|(offset, forward, x_row, y_row, x_shift, y_shift)| Past { offset, forward, x_row, y_row, x_shift, y_shift })
}

/// Defines each test twice, with the number type T = f32 and with T = f64. The name of a test states the property that the results must have.
macro_rules! of_any_bits {
    ($($name:ident($($argument:pat in $strategy:expr),+ $(,)?) $body:block)+) => {
        of_any_bits!(@in f32, in_f32, $($name($($argument in $strategy),+) $body)+);
        of_any_bits!(@in f64, in_f64, $($name($($argument in $strategy),+) $body)+);
    };
    (@in $real:ty, $module:ident, $($name:ident($($argument:pat in $strategy:expr),+) $body:block)+) => {
        mod $module {
            use super::*;

            #[allow(dead_code, reason = "not every body names its precision")]
            type T = $real;

            proptest! {
                #![proptest_config(cases(4000))]
                $(#[test] fn $name($($argument in $strategy),+) $body)+
            }
        }
    };
}

of_any_bits! {
    noise_of_any_bits_is_below_one(
        kind in noise_kind(),
        sector in any::<[i32; 2]>(),
        [position, ddx, ddy] in [any_numbers::<T, 3>(), any_numbers(), any_numbers()],
        [sector_m, hash_scale, x, l] in any_numbers::<T, 4>(),
        words in any::<[u32; 6]>(),
    ) {
        let point = HashedPoint { sector, position, sector_m, ddx, ddy, hash_scale };
        let [px, py, frame, seed, salt, level] = words;
        for threshold in noise::thresholds(kind, &point, level.cast_signed(), [px, py], frame, seed, salt) {
            prop_assert!((0.0..1.0).contains(&threshold));
        }
        let corrected = noise::correct(x, l);
        prop_assert!((0.0..1.0).contains(&corrected));
    }

    octahedral_of_any_bits_is_a_unit_vector(
        v in any_numbers::<T, 3>(),
        e in any_numbers::<T, 2>(),
        bits in any::<u32>(),
        code in any::<[u32; 2]>(),
    ) {
        prop_assert!(octahedral::encode(v).iter().chain(&octahedral::dequantise8(e)).all(|x| x.abs() <= 1.0));
        let (coded, stored) = (octahedral::dequantise::<T>(code, bits), octahedral::dequantise8(e));
        for n in [octahedral::unit(v), octahedral::decode(e), octahedral::decode(coded), octahedral::decode(stored)] {
            prop_assert!((length(n).to_f64() - 1.0).abs() < 1e-6, "{:?}", n);
        }
        let most = 2 * octahedral::half(bits);
        prop_assert!(octahedral::quantise(e, bits).iter().chain(&octahedral::encode_precise(v, bits)).all(|&code| code <= most));
        prop_assert!(octahedral::quantise8(e).iter().chain(&octahedral::encode8_precise(v)).all(|s| (0.0..=1.0).contains(s)));
    }
    derivatives_of_any_bits_have_a_length([ray, step, n] in [any_numbers::<T, 3>(), any_numbers(), any_numbers()], t in any_number::<T>()) {
        let d = derivatives::on_plane(ray, step, t, n);
        prop_assert!(have_length(d), "{:?}", d);
    }

    covers_of_any_bits_lie_in_the_picture(
        rows in [any_numbers::<T, 4>(), any_numbers(), any_numbers()],
        near in any_number::<T>(),
        [low, high] in [any_numbers::<T, 3>(), any_numbers()],
        sides in [1..=16_384u16, 1..=16_384u16],
    ) {
        let size = sides.map(|side| T::of(f64::from(side)));
        // For arbitrary rows of the matrix, `cover` usually returns `None`. It returns `None` less often for `plain`, the matrix of a camera that
        // looks along y.
        let [zero, one] = [T::of(0.0), T::of(1.0)];
        let plain = [[one, zero, zero, rows[0][3]], [zero, zero, one, rows[1][3]], [zero, one, zero, T::of(8.0)]];
        for cover in [rows, plain].into_iter().filter_map(|rows| seen::cover(rows, near, low, high, size)) {
            for ((first, last), side) in cover.first.into_iter().zip(cover.last).zip(size) {
                prop_assert!(first >= zero && first <= last && last < side && first.fract() == zero && last.fract() == zero, "{:?}", cover);
            }
            prop_assert!(cover.depth > zero && cover.depth <= one, "{:?}", cover);
        }
    }

    splat_weights_of_any_bits_sum_to_one(
        f in any_numbers::<T, 2>(),
        h in any_numbers::<T, 4>(),
        k in any_number::<T>(),
        w in any_numbers::<T, 4>(),
    ) {
        for weights in [splat_blend::bilinear(f), splat_blend::weights(f, h, k)] {
            prop_assert!((weights.iter().sum::<T>() - 1.0).abs() < 1e-6 && weights.iter().all(|w| (0.0..=1.0).contains(w)), "{:?}", weights);
        }
        let mut run = splat_blend::Run::start();
        for i in 0..4 {
            run = run.add(w[i], h[i], k);
            prop_assert!(run.keep >= 0.0 && run.keep <= 1.0 && run.share >= 0.0 && are_finite([run.keep, run.share]), "{:?}", run);
        }
    }

    projections_of_any_bits_sum_to_one([n, g] in [any_numbers::<T, 3>(), any_numbers()], k in any_number::<T>()) {
        let w = triplanar::weights(n, k);
        prop_assert!((w.iter().sum::<T>() - 1.0).abs() < 1e-6 && w.iter().all(|w| (0.0..=1.0).contains(w)), "{:?}", w);
        let (axes, w) = biplanar::projections(n, k);
        prop_assert!((w[0] + w[1] - 1.0).abs() < 1e-6 && w[0] >= 0.0 && w[1] >= 0.0 && axes[0] < axes[1] && axes[1] < 3, "{:?}", w);
        prop_assert!((length(triplanar::perturb(n, g)).to_f64() - 1.0).abs() < 1e-6);
        prop_assert!((0..5).contains(&snapped_projection::plane(n, k)));
    }
    snapped_coordinates_of_any_bits_are_finite(p in any_numbers::<T, 3>(), plane in any::<u32>()) {
        let c = snapped_projection::coordinates(p, plane % 6);
        prop_assert!(are_finite(c), "{:?}", c);
    }
    snapped_gradients_of_any_bits_are_finite(g in any_numbers::<T, 2>(), plane in any::<u32>()) {
        let c = snapped_projection::from_gradient(g, plane % 6);
        prop_assert!(are_finite(c), "{:?}", c);
    }

    choices_of_any_bits_exist(w in any_numbers::<T, 4>(), u in any_number::<T>(), levels in any::<u32>(), size in any::<u32>()) {
        let chosen = select::of_4(w, u);
        // A weight that is denormal in f32 counts as zero.
        let counts = |w: T| w.to_f64() >= f64::from(f32::MIN_POSITIVE);
        prop_assert!(counts(w[chosen]) || chosen == 0 && !w.iter().any(|&w| counts(w)), "{}", chosen);
        prop_assert!(select::of_3([w[0], w[1], w[2]], u) < 3);
        prop_assert!(texel_choice::level(w[0], levels, u) < levels.max(1));
        prop_assert!(texel_choice::texel(w[0], size, u) < size.max(1));
    }

    tilings_of_any_bits_are_held(
        [d, near, cliff] in any_numbers::<T, 3>(),
        sector in any::<[i32; 2]>(),
        p in any_numbers::<T, 2>(),
        sector_m in any_number::<T>(),
        level in any::<i32>(),
        scale in any::<u32>(),
    ) {
        let (s, part) = tiling::scales(d, near, cliff);
        prop_assert!(s <= 7 && (0.0..1.0).contains(&part));
        let place: T = tiling::fixed(sector[0], sector[1], scale);
        prop_assert!((0.0..1.0).contains(&place));
        prop_assert!(are_finite([tiling::repeats(d.to_f64(), near.to_f64())]));
        tiling::per_sector_fixed(d.to_f64(), near.to_f64());
        prop_assert!((hex_tiling::LEVELS[0]..=hex_tiling::LEVELS[1]).contains(&hex_tiling::level(d)));
        let hex = hex_tiling::at(sector, p, sector_m, level);
        prop_assert!((hex.weights.iter().sum::<T>() - 1.0).abs() < 1e-6 && hex.weights.iter().all(|w| (0.0..=1.0).contains(w)), "{:?}", hex);
        prop_assert!(hex.ids.iter().flatten().all(|&id| id < 1 << 16));
    }

    flavours_of_any_bits_sum_to_one(
        [d, z] in any_numbers::<T, 2>(),
        params in any_numbers::<f32, 8>(),
        flags in any::<[u32; 3]>(),
        w in any_numbers::<T, 5>(),
    ) {
        let params = FlavourParams {
            far_atlas_m: params[0],
            cliff_far_atlas_m: params[1],
            cliff_near_m: params[2],
            distance_blend: params[3],
            cliff_cos: [params[4], params[5]],
            splat_cos: [params[6], params[7]],
            splat_enabled: flags[0] & 1,
            vt_enabled: flags[1] & 1,
            padding: [0; 2],
        };
        for w in [flavour_weights::weights(d, z, &params), flavour_weights::weights_for(w, flags[2], flags[0] & 2 == 2)] {
            prop_assert!((w.iter().sum::<T>() - 1.0).abs() < 1e-6 && w.iter().all(|w| (0.0..=1.0).contains(w)), "{:?}", w);
        }
        prop_assert!((1..32).contains(&flavour_weights::mask(w)));
    }

    reflections_of_any_bits_are_finite([a, b, c] in any_numbers::<T, 3>(), f0 in any_numbers::<T, 3>()) {
        let (d, v) = (brdf::d_ggx(a, b), brdf::v_smith_ggx_correlated(a, b, c));
        prop_assert!(d >= 0.0 && v >= 0.0 && are_finite([d, v, d * v]));
        let alpha = brdf::alpha(a).to_f64();
        prop_assert!((0.999 * brdf::MIN_ALPHA..=1.0).contains(&alpha));
        for reflected in [brdf::f_schlick(f0, a), brdf::env_approx(f0, a, b)] {
            prop_assert!(reflected.iter().all(|f| (0.0..=1.0).contains(f)), "{:?}", reflected);
        }
    }
    opacities_of_any_bits_are_shares(m in any_numbers::<T, 8>(), layer in any::<u32>()) {
        let opacity = layers::opacity(layer % 8, m[0], m[1]);
        prop_assert!((0.0..=1.0).contains(&opacity), "{}", opacity);
    }
    layers_of_any_bits_are_shares(m in any_numbers::<T, 8>(), layer in any::<u32>()) {
        let share = layers::share([m[0], m[1], m[2], m[3]], [0, 1, 0, 1], layer % 2);
        prop_assert!((0.0..=2.0).contains(&share), "{}", share);
        let weights = layers::weights(m);
        prop_assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{:?}", weights);
    }
    moments_of_any_bits_are_finite(samples in vec(any_numbers::<T, 2>(), 1..40)) {
        let mut moments = Moments::<T>::new();
        // The samples are repeated, so that large sums of squares occur.
        samples.iter().cycle().take(3000).for_each(|&s| moments.add(s));
        prop_assert!(are_finite(moments.mean) && are_finite(moments.squares), "{:?}", moments);
        prop_assert!(moments.variance() >= 0.0 && moments.variance().is_finite());
    }

    reprojections_of_any_bits_are_finite(
        past in any_past::<T>(),
        [point, ray, n] in [any_numbers::<T, 3>(), any_numbers(), any_numbers()],
    ) {
        let [x, y, distance] = motion::reproject(point, &past);
        prop_assert!(are_finite([x, y, distance]) && (0.0..1e9).contains(&distance));
        let expected = motion::expected_distance(point, &past, ray, n);
        prop_assert!((0.0..1e9).contains(&expected), "{}", expected);
        prop_assert!(!motion::same_surface(x, expected, distance) || expected > 0.0);
    }
    past_rays_of_any_bits_are_finite(past in any_past::<T>(), pixel in any_numbers::<T, 2>()) {
        let ray = motion::past_ray(&past, pixel);
        prop_assert!(are_finite(ray), "{:?}", ray);
    }

    directions_of_any_bits_are_finite(v in any_numbers::<T, 3>()) {
        let n = real::normalize(v);
        prop_assert!(are_finite(n), "{:?}", n);
    }
}

proptest! {
    #![proptest_config(cases(4000))]

    #[test]
    fn signals_of_any_bits_are_finite_or_invalid(colour in any_numbers::<f32, 3>(), fetches: u32, choice: u32) {
        let packed = signal::pack(colour, fetches, choice);
        let finite = are_finite(colour);
        prop_assert_eq!((signal::is_terrain(packed), signal::is_invalid(packed)), (finite, !finite));
        if finite {
            prop_assert!(are_finite(signal::colour(packed)), "{:?}", signal::colour(packed));
            prop_assert!(signal::luminance(signal::colour(packed)).is_finite());
        }
    }

    #[test]
    fn boxes_with_nan_are_seen(view in view(), sides in any_numbers::<f64, 6>(), broken in 0..6usize) {
        // A box with NaN may be in the picture, so it must count as visible.
        let mut sides = sides;
        sides[broken] = f64::NAN;
        let [low, high] = [0, 3].map(|at| DVec3::new(sides[at], sides[at + 1], sides[at + 2]));
        prop_assert!(view.sees(low, high));
    }

    #[test]
    fn infinite_boxes_are_seen(view in view(), is_level: bool, sides in vec(any::<bool>(), 6)) {
        // In a level view to the north, some frustum planes are parallel to a coordinate axis, so their normals have the component 0 along that axis.
        // The product of 0 and an infinite coordinate of the box is NaN, which must not hide the box.
        let pose = if is_level { Pose { yaw: 0.0, pitch: 0.0, ..view.pose } } else { view.pose };
        let view = View::new(pose, view.size, [0.0; 2], 64.0, 10_240.0);
        let side = |i: usize, end: f64, other: f64| if sides[i] { end } else { other };
        let (eye, far) = (view.camera, f64::INFINITY);
        // Each side of the box is either 1 m from the eye or infinitely far away.
        let low = DVec3::from_array([0, 1, 2].map(|i| side(i, -far, eye[i] - 1.0)));
        let high = DVec3::from_array([0, 1, 2].map(|i| side(i + 3, far, eye[i] + 1.0)));
        prop_assert!(view.sees(low, high));
    }
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn cones_of_any_bits_are_never_culled(axis in direction(), patch in 0..64usize, broken in any_numbers::<f64, 3>()) {
        let up = [axis[0], axis[1], axis[2].abs()];
        let mut normals = vec![vec![up]; 64];
        normals[patch].push(broken);
        let cones = cones::decode(&cones::encode(&normals));
        prop_assert!(cones.iter().all(|c| are_finite(c.axis) && c.contains(up)));
        // An invalid normal may face in any direction, so the cone of its patch must contain all directions.
        prop_assert!(are_finite(broken) || cones[patch].sin_half_angle >= 1.0, "{:?}", cones[patch]);
    }
}

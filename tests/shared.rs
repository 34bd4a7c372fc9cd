//! Tests `kernels::shared` without a GPU. Its functions exist twice: as a Rust reference and in WGSL. The references are compared with their
//! formulas. `properties.rs` tests symmetries, monotonicity and arguments of arbitrary bit patterns; `noise.rs` and `noise_stability.rs` test the
//! statistics of noise, `agreement.rs` and `shaders.rs` the WGSL.
//!
//! Statistical tests have fixed seeds. The N tests of a family share a significance level of 0.1 %, so each test has the level 1 - 0.999^(1/N)
//! (Sidak). Most tests that compare a function with a formula also try a wrong version of the function (a mutant), which they must reject.

use kernels::scene::FlavourRules;
use kernels::shared::flavour_weights::FlavourParams;
use kernels::shared::noise::{HashedPoint, NoiseKind, TwoScales};
use kernels::shared::real::{Real, add, dot, length, normalize, scale, sub};
use kernels::shared::{brdf, derivatives, flavour_weights, hash, noise, octahedral, select, splat_blend, tiling, triplanar};

use crate::statistics::{Random, goodness_p, independent_p, sidak, uniform_bins_p, uniform_ks_p};

// ---------------------------------------------------------------- tools

fn sum<const N: usize>(w: [f64; N]) -> f64 {
    w.iter().sum()
}

fn largest_difference<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
}

// ---------------------------------------------------------------- hash

#[test]
fn hashes_have_their_published_values() {
    // The function pcg4d of Jarzynski & Olano 2020. It is written from the published code, independently of `hash::pcg4d`.
    fn pcg4d(v: [u32; 4]) -> [u32; 4] {
        let [mut x, mut y, mut z, mut w] = v.map(|a| (u64::from(a) * 1_664_525 + 1_013_904_223) as u32);
        let mad = |a: u32, b: u32, c: u32| ((u64::from(b) * u64::from(c) + u64::from(a)) & 0xffff_ffff) as u32;
        for last in [false, true] {
            x = mad(x, y, w);
            y = mad(y, z, x);
            z = mad(z, x, y);
            w = mad(w, y, z);
            if !last {
                (x, y, z, w) = (x ^ (x >> 16), y ^ (y >> 16), z ^ (z >> 16), w ^ (w >> 16));
            }
        }
        [x, y, z, w]
    }
    let mut random = Random(1);
    for _ in 0..1000 {
        let v = [0; 4].map(|_: u32| random.word() as u32);
        assert_eq!(hash::pcg4d(v), pcg4d(v), "input {v:?}");
    }
    // The output function of PCG (O'Neill 2014, 32-bit RXS-M-XS) is a permutation: 2^16 successive words have different hashes.
    let mut seen: Vec<u32> = (0..65_536).map(hash::pcg).collect();
    seen.sort_unstable();
    seen.dedup();
    assert_eq!(seen.len(), 65_536);
    assert_eq!(hash::to_unit::<f32>(u32::MAX).to_bits(), 0x3f7f_ffff);
    assert_eq!(hash::to_unit::<f32>(255).to_bits(), 0);
}

#[test]
fn parameters_mix_without_cancelling() {
    let mut seen: Vec<u32> = Vec::new();
    for seed in 0..40 {
        for salt in 0..40 {
            for level in 0..40 {
                seen.push(hash::mix(seed, salt, level));
            }
        }
    }
    let distinct = |mut words: Vec<u32>| {
        words.sort_unstable();
        words.dedup();
        words.len()
    };
    // Among 64 000 random words of 32 bits, the expected number of equal pairs is about 0.5.
    assert!(distinct(seen) >= 63_990);
    // Negative control: the hash of a plain sum of the parameters has many equal values.
    let sums = (0..64_000).map(|i: u32| hash::pcg(i % 40 + i / 40 % 40 + i / 1600)).collect();
    assert!(distinct(sums) < 63_990);
}

#[test]
fn lattice_values_are_uniform_and_uncorrelated() {
    let values: Vec<f64> = (-100..100).flat_map(|y| (-100..100).map(move |x| hash::unit2(x, y, 7, 3))).collect();
    let along_x: Vec<_> = values.windows(2).map(|w| (w[0], w[1])).collect();
    let along_y: Vec<_> = values.iter().zip(&values[200..]).map(|(&a, &b)| (a, b)).collect();
    for p in [uniform_bins_p(&values), uniform_ks_p(&values), independent_p(&along_x), independent_p(&along_y)] {
        assert!(p > sidak(4), "p = {p}");
    }
}

// ---------------------------------------------------------------- noise

fn as_f32(p: &HashedPoint<f64>) -> HashedPoint<f32> {
    HashedPoint {
        sector: p.sector,
        position: p.position.map(|x| x as f32),
        sector_m: p.sector_m as f32,
        ddx: p.ddx.map(|x| x as f32),
        ddy: p.ddy.map(|x| x as f32),
        hash_scale: p.hash_scale as f32,
    }
}

/// Side of a sector, metres.
const SECTOR_M: f64 = 64.0;

/// Returns a random place that is 700 to 1300 km east and 700 to 1300 km south of the origin. The footprint of the place is between 2^-17 and 2^6 m
/// wide, so that hashed noise uses cells of every scale.
fn far_place(i: u32) -> HashedPoint<f64> {
    let mut random = Random(u64::from(i) << 20);
    let mut sector = |around: i32| around + random.below(8192) as i32 - 4096;
    let sector = [sector(15_625), sector(-15_625)];
    let footprint = random.between(-17.0, 6.0).exp2();
    HashedPoint {
        sector,
        position: [random.between(0.0, SECTOR_M), random.between(0.0, SECTOR_M), random.between(0.0, 3000.0)],
        sector_m: SECTOR_M,
        ddx: scale(random.direction(), footprint),
        ddy: scale(random.direction(), footprint * random.unit()),
        hash_scale: 1.0,
    }
}

type Scales = fn(&HashedPoint<f64>, u32, u32) -> TwoScales<f64>;
const HASHED: [(&str, Scales); 2] = [("isotropic", noise::isotropic_scales::<f64>), ("anisotropic", noise::anisotropic_scales::<f64>)];

#[test]
fn hashed_thresholds_are_uniform_in_f32() {
    let threshold = |i: u32| noise::hashed_isotropic(&as_f32(&far_place(i)), 1, 2).map(f64::from);
    let samples: Vec<[f64; 4]> = (0..20_000).map(threshold).collect();
    for i in 0..4 {
        let x: Vec<f64> = samples.iter().map(|s| s[i]).collect();
        assert!(uniform_bins_p(&x) > sidak(8) && uniform_ks_p(&x) > sidak(8), "threshold {i}");
    }
}

#[test]
fn cells_are_the_same_near_and_far() {
    let point = |sector: i32, x: f64, footprint: f64| HashedPoint {
        sector: [sector, 3],
        position: [x, 12.3, 456.7],
        sector_m: SECTOR_M,
        ddx: [footprint, 0.0, 0.0],
        ddy: [0.0, footprint, 0.0],
        hash_scale: 1.0,
    };
    for footprint in [0.003, 0.1, 1.7, 40.0] {
        for scales in HASHED.map(|(_, scales)| scales) {
            // Returns the positions along 64 m at which a new cell begins. They must be equal at three distances from the origin.
            let borders = |sector: i32| -> Vec<u32> {
                (1..4096u32)
                    .filter(|&i| {
                        let at = |i: u32| scales(&point(sector, f64::from(i) / 64.0, footprint), 1, 1).thresholds();
                        at(i) != at(i - 1)
                    })
                    .collect()
            };
            assert_eq!(borders(0), borders(156));
            assert_eq!(borders(0), borders(15_625));
            // There is no seam between sectors. A point beyond the edge of a sector can be given relative to that sector or relative to the
            // neighbouring sector. Both must lie in the same cell.
            for i in 0..200 {
                let x = f64::from(i) * 0.07;
                let (over, own) = (point(15_625, SECTOR_M + x, footprint), point(15_626, x, footprint));
                assert_eq!(scales(&over, 1, 1).coarse, scales(&own, 1, 1).coarse, "{x} m");
                let north = |sector: i32, y: f64| HashedPoint { sector: [7, sector], position: [1.0, y, 456.7], ..over };
                assert_eq!(scales(&north(-156, SECTOR_M + x), 1, 1).coarse, scales(&north(-155, x), 1, 1).coarse, "{x} m north");
                assert_ne!(scales(&north(-156, x), 1, 1).coarse, scales(&north(-155, x), 1, 1).coarse);
            }
        }
    }
    // f32 finds the same cells as f64, also 1000 km from the origin, because positions are relative to a sector.
    for i in 0..5000 {
        let small = as_f32(&far_place(i));
        let exact = HashedPoint {
            sector: small.sector,
            position: small.position.map(f64::from),
            sector_m: 64.0,
            ddx: small.ddx.map(f64::from),
            ddy: small.ddy.map(f64::from),
            hash_scale: 1.0,
        };
        let (a, b) = (noise::hashed_isotropic(&small, 1, 1), noise::hashed_isotropic(&exact, 1, 1));
        // Bound of the error of a threshold in f32. The blend factor l contains log2 of the footprint, whose error is at most 16 * 2^-24 = 8 EPSILON.
        // This error has two effects. It changes the blend x by at most 8 EPSILON, and the correction multiplies this by its slope in x, at most
        // 1/max(l, 1-l) <= 2. It also changes the correction itself, whose slope in l is at most 2. Together, these are 32 EPSILON. The tolerance is
        // four times this sum.
        assert!(largest_difference(a.map(f64::from), b) < 8.0 * 16.0 * f64::from(f32::EPSILON), "{a:?} {b:?}");
    }
}

#[test]
fn thresholds_follow_the_scale_without_a_pop() {
    let largest_step = |thresholds: &dyn Fn(f64) -> [f64; 4]| {
        let mut before = thresholds(-4.0);
        let mut step: f64 = 0.0;
        for i in 1..40_000 {
            let now = thresholds(-4.0 + f64::from(i) * 5e-4);
            step = step.max(largest_difference(before, now));
            before = now;
        }
        step
    };
    let at = |level: f64| {
        let point = HashedPoint {
            sector: [3, 4],
            position: [10.1, 20.2, 30.3],
            sector_m: SECTOR_M,
            ddx: [(-level).exp2(), 0.0, 0.0],
            ddy: [0.0; 3],
            hash_scale: 1.0,
        };
        noise::isotropic_scales(&point, 1, 1)
    };
    // A step changes the level, and so the blend factor l, by 5e-4. The threshold changes by at most 4 times that: 2 times through the blend x, and 2
    // times because the correction also depends on l. So a step changes the threshold by at most 2e-3.
    assert!(largest_step(&|level| at(level).thresholds()) < 2.5e-3);
    // Negative control: the value of the larger cell alone, without the blend, jumps whenever the footprint passes a power of two.
    assert!(largest_step(&|level| at(level).coarse) > 0.1);
}

#[test]
fn correction_is_the_distribution_function_of_the_blend() {
    // Computes the distribution function of the blend, P((1-l) U1 + l U2 < x) for independent uniform U1 and U2. For a given U1, the probability is
    // that of U2 < (x - (1-l) U1) / l. Its mean over U1 is integrated by the midpoint rule.
    let integral = |x: f64, l: f64| {
        let n = 4000;
        (0..n).map(|i| ((x - (1.0 - l) * (f64::from(i) + 0.5) / f64::from(n)) / l).clamp(0.0, 1.0)).sum::<f64>() / f64::from(n)
    };
    let worst = |candidate: &dyn Fn(f64, f64) -> f64| {
        let mut worst: f64 = 0.0;
        for l in [0.01, 0.1, 0.3, 0.5, 0.7, 0.95, 0.99] {
            for i in 1..40 {
                let x = f64::from(i) / 40.0;
                worst = worst.max((candidate(x, l) - integral(x, l)).abs());
            }
        }
        worst
    };
    // The integrand is linear except at two kinks, and its slope is at most 1/l. So the error of the midpoint rule with n points is at most 1/(l n²),
    // which is 6.3e-6 for the smallest l of 0.01.
    assert!(worst(&noise::correct) < 1e-5);
    assert!(worst(&|x, _| x) > 0.01, "the mutant without correction passed");
    assert!(worst(&|x, l| noise::correct(x, (1.0 - l) * 0.9)) > 0.01, "the mutant with a wrong factor passed");
    for x in [0.0, 0.25, 0.75, 0.999] {
        for l in [0.0, 1.0, 1e-30, f64::MIN_POSITIVE] {
            assert!((noise::correct(x, l) - x).abs() < 1e-12);
            assert!((noise::correct(x as f32, l as f32) - x as f32).abs() < 1e-6);
        }
        // The correction has the same value for l and for 1 - l.
        assert!((noise::correct(x, 0.2) - noise::correct(x, 0.8)).abs() < 1e-12);
    }
    assert!(noise::correct(1.0_f32, 0.5) < 1.0);
}

#[test]
fn noise_kinds_have_names_and_codes() {
    for (i, kind) in NoiseKind::ALL.into_iter().enumerate() {
        assert_eq!(kind.code() as usize, i);
        assert_eq!(kind.to_string().parse(), Ok(kind));
    }
    let error = "pink".parse::<NoiseKind>().expect_err("not a kind").to_string();
    assert!(error.contains("pink") && NoiseKind::ALL.iter().all(|k| error.contains(k.name())), "{error}");
    let point = far_place(3);
    assert_eq!(noise::thresholds(NoiseKind::HashedIsotropic, &point, 4, [1, 2], 3, 4, 5), noise::hashed_isotropic(&point, 4, 5));
    assert_eq!(noise::thresholds(NoiseKind::HashedAnisotropic, &point, 4, [1, 2], 3, 4, 5), noise::hashed_anisotropic(&point, 4, 5));
    assert_eq!(noise::thresholds::<f64>(NoiseKind::WhiteScreen, &point, 4, [1, 2], 3, 4, 5), noise::white_screen::<f64>([1, 2], 3, 4, 5));
}

#[test]
fn cells_are_about_a_pixel_wide() {
    // The larger of the two blended cells is between 1 and 2 times `hash_scale` footprints wide.
    for hash_scale in [1.0, 2.0] {
        for footprint in [0.011, 0.3, 1.3] {
            let at = |x: f64| HashedPoint {
                sector: [0; 2],
                position: [x, 0.5, 0.5],
                sector_m: SECTOR_M,
                ddx: [0.0, footprint, 0.0],
                ddy: [0.0; 3],
                hash_scale,
            };
            let coarse = |x: f64| noise::isotropic_scales(&at(x), 1, 1).coarse;
            let cells = (1..6400).filter(|&i| coarse(f64::from(i) * 0.01 - 0.005) != coarse(f64::from(i - 1) * 0.01 - 0.005)).count();
            let width = SECTOR_M / (cells + 1) as f64 / footprint / hash_scale;
            assert!((0.9..2.2).contains(&width), "{width} pixels at {footprint} m");
        }
    }
}

// ---------------------------------------------------------------- octahedral

fn axes_survive<T: Real>(bits: u32) {
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut n = [T::zero(); 3];
            n[axis] = T::of(sign);
            let plain = octahedral::quantise(octahedral::encode(n), bits);
            for code in [plain, octahedral::encode_precise(n, bits)] {
                assert_eq!(octahedral::decode(octahedral::dequantise::<T>(code, bits)), n, "{bits} bits");
            }
            if bits == 8 {
                for stored in [octahedral::quantise8(octahedral::encode(n)), octahedral::encode8_precise(n)] {
                    assert_eq!(octahedral::decode(octahedral::dequantise8(stored)), n);
                    // A texture stores the code in a byte.
                    let bytes = stored.map(|s| T::of(f64::from((s.to_f64() * 255.0).round() as u8)) / T::of(255.0));
                    assert_eq!(octahedral::decode(octahedral::dequantise8(bytes)), n);
                }
            }
        }
    }
}

#[test]
fn axes_survive_exactly() {
    for bits in [8, 12, 16] {
        axes_survive::<f32>(bits);
        axes_survive::<f64>(bits);
    }
    // Negative control: if all 256 codes of a byte are used, zero lies between two codes.
    let all_codes = |x: f64| ((x * 0.5 + 0.5) * 255.0).round() / 255.0 * 2.0 - 1.0;
    assert_ne!(octahedral::decode(octahedral::encode([0.0, 0.0, 1.0]).map(all_codes)), [0.0, 0.0, 1.0]);
}

#[test]
fn octahedral_errors_are_the_published_ones() {
    let errors = |code: &dyn Fn([f64; 3]) -> [f64; 2]| {
        let mut random = Random(17);
        let (mut mean, mut max): (f64, f64) = (0.0, 0.0);
        for _ in 0..200_000 {
            let n = random.direction();
            let off = length(sub(octahedral::decode(code(n)), n));
            let degrees = (2.0 * (off / 2.0).asin()).to_degrees();
            mean += degrees / 200_000.0;
            max = max.max(degrees);
        }
        (mean, max)
    };
    // Cigolle et al. 2014, table of mean and maximum errors, for 16 bits per direction: oct-P has a mean of 0.314° and a maximum of 0.636°.
    let published = |(mean, max): (f64, f64)| (0.310..0.319).contains(&mean) && (0.60..0.64).contains(&max);
    let precise = errors(&|n| octahedral::dequantise(octahedral::encode_precise(n, 8), 8));
    assert!(published(precise), "{precise:?}");
    // Negative control: rounding each coordinate to its nearest code is the plain "oct" of the survey, with a mean of 0.337° and a maximum of 0.944°.
    let plain = errors(&|n| octahedral::dequantise(octahedral::quantise(octahedral::encode(n), 8), 8));
    assert!(!published(plain) && (0.33..0.345).contains(&plain.0) && (0.88..0.95).contains(&plain.1), "{plain:?}");
    // Each additional bit per coordinate halves the error.
    for (bits, factor) in [(12, 16.0), (16, 256.0)] {
        let (mean, max) = errors(&|n| octahedral::dequantise(octahedral::encode_precise(n, bits), bits));
        assert!((mean * factor / precise.0 - 1.0).abs() < 0.03 && max * factor < 0.65, "{bits} bits: {mean} {max}");
    }
    // The encoding without quantisation is exact, apart from rounding.
    let exact = errors(&|n| octahedral::encode(n));
    assert!(exact.1 < 1e-10, "{exact:?}");
}

// ---------------------------------------------------------------- derivatives

/// The derivative by its definition: the intersection of the neighbouring pixel's ray with the plane, minus the visible point `ray * t`.
fn hit_minus_point(ray: [f64; 3], ray_step: [f64; 3], t: f64, n: [f64; 3]) -> [f64; 3] {
    let point = scale(ray, t);
    let neighbour = add(ray, ray_step);
    sub(scale(neighbour, dot(n, point) / dot(n, neighbour)), point)
}

#[test]
fn derivatives_are_ray_plane_intersections() {
    type OnPlane = fn([f64; 3], [f64; 3], f64, [f64; 3]) -> [f64; 3];
    let worst = |candidate: OnPlane, swap: bool| {
        let mut random = Random(23);
        let mut worst: f64 = 0.0;
        let mut tested = 0;
        while tested < 5000 {
            // The steps to the two neighbouring rays are perpendicular to each other, as in a camera.
            let (right, up) = (normalize([0.8, 0.6, 0.0]), normalize([-0.3, 0.4, 0.9]));
            let ray = add(random.direction(), add(scale(right, 0.3), scale(up, 0.2)));
            let n = random.direction();
            let steps = [scale(right, 1.0 / 960.0), scale(up, -1.0 / 960.0)];
            if dot(n, ray).abs() < 0.05 * length(ray) {
                continue;
            }
            tested += 1;
            let t = random.between(-1.0, 13.0).exp2();
            for (i, &step) in steps.iter().enumerate() {
                let truth = hit_minus_point(ray, step, t, n);
                // The mutant uses the derivative along x for both axes.
                let given = candidate(ray, if swap { steps[0] } else { steps[i] }, t, scale(n, 3.0));
                worst = worst.max(length(sub(given, truth)) / length(truth));
                // The derivative lies in the plane.
                if !swap {
                    assert!(dot(given, n).abs() <= 1e-12 * length(given) * length(ray) / dot(n, ray).abs());
                }
            }
        }
        worst
    };
    // The bound allows for the error of `hit_minus_point`: it subtracts two vectors that nearly cancel, and so loses about 13 of its 53 bits here.
    assert!(worst(derivatives::on_plane, false) < 1e-9);
    assert!(worst(derivatives::on_plane, true) > 0.1, "the mutant passed");
}

#[test]
fn derivatives_keep_their_digits_in_f32() {
    let (ray, step, n) = ([0.31_f32, 0.92, -0.11], [1.0e-3_f32, -3.4e-4, 2.0e-5], [0.05_f32, -0.21, 0.97]);
    let t = 9000.0_f32;
    let truth = hit_minus_point(ray.map(f64::from), step.map(f64::from), f64::from(t), normalize(n.map(f64::from)));
    let error = |d: [f32; 3]| length(sub(d.map(f64::from), truth)) / length(truth);
    // The relative error of `on_plane` depends on the angle between ray and plane, but not on the distance.
    assert!(error(derivatives::on_plane(ray, step, t, n)) < 2e-6);
    // Negative control: the difference of two positions is less precise, because the positions are about 800 times longer than their difference.
    let unit = normalize(n);
    let next = add(ray, step);
    let plain = sub(scale(next, dot(unit, scale(ray, t)) / dot(unit, next)), scale(ray, t));
    assert!(error(plain) > 2e-6);
}

#[test]
fn grazing_derivatives_are_bounded() {
    let step = [1e-3, 0.0, 0.0];
    for tilt in [0.2, 0.02, 0.009, 1e-3, 1e-6, 0.0, -1e-6, -1e-3] {
        for direction in [1.0, -1.0] {
            let ray = [0.0, 1.0, -tilt];
            let d = derivatives::on_plane(ray, scale([0.0, 0.0, 1e-3], direction), 100.0, [0.0, 0.0, 1.0]);
            assert!(length(d) <= 100.0 * 1e-3 * (1.0 + 1.001 / derivatives::MIN_COSINE), "{d:?}");
            let across = derivatives::on_plane(ray, step, 100.0, [0.0, 0.0, 1.0]);
            assert!(largest_difference(across, [0.1, 0.0, 0.0]) < 1e-12, "{across:?}");
        }
    }
}

// ---------------------------------------------------------------- splat blend

#[test]
fn splat_weights_are_the_formula() {
    let mut random = Random(31);
    for _ in 0..5000 {
        let fraction = [random.unit(), random.unit()];
        let heights = [0.0; 4].map(|_| random.unit());
        let k = random.between(0.0, 16.0);
        let [x, y] = fraction;
        let bent: Vec<f64> =
            [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y].iter().zip(heights).map(|(w, h)| w * (k * h).exp2()).collect();
        let total: f64 = bent.iter().sum();
        let given = splat_blend::weights(fraction, heights, k);
        assert!(largest_difference(given, [0, 1, 2, 3].map(|i| bent[i] / total)) < 1e-13);
        assert!((sum(given) - 1.0).abs() < 1e-15 * 4.0);
        assert!(largest_difference(splat_blend::weights(fraction, heights, 0.0), splat_blend::bilinear(fraction)) < 1e-15);
        // Adding the same number to all heights does not change the weights.
        assert!(largest_difference(given, splat_blend::weights(fraction, heights.map(|h| h + 3.0), k)) < 1e-12);
    }
}

#[test]
fn splat_weights_are_stable_at_any_sharpness() {
    let mut random = Random(37);
    for _ in 0..20_000 {
        // This includes cases in which the highest texel has almost no bilinear weight.
        let fraction = [random.between(-150.0, 0.0).exp2() as f32, random.unit() as f32];
        let heights = [0.0_f32; 4].map(|_| random.unit() as f32);
        for k in [0.0_f32, 8.0, 1e3, 1e4, f32::MAX] {
            let w = splat_blend::weights(fraction, heights, k);
            assert!(w.iter().all(|w| (0.0..=1.0).contains(w)), "{fraction:?} {heights:?} {k}: {w:?}");
            assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-6);
        }
    }
    // At a high sharpness, only the highest texel has a weight.
    let sharp = splat_blend::weights([0.4, 0.4], [0.1, 0.9, 0.3, 0.2], 1e4);
    assert!(largest_difference(sharp, [0.0, 1.0, 0.0, 0.0]) < 1e-12);
}

/// Returns the largest change of a texel's weight from one sample to the next, along a line through two adjacent cells, which have six texels in all.
/// `weights` computes the weights in one cell.
fn largest_jump(weights: &dyn Fn([f64; 2], [f64; 4]) -> [f64; 4], heights: [f64; 6]) -> f64 {
    let along = |x: f64| {
        // Texels (0,0) (1,0) (2,0) (0,1) (1,1) (2,1).
        let cell = usize::from(x >= 1.0);
        let at = [cell, cell + 1, cell + 3, cell + 4];
        let w = weights([x - cell as f64, 0.3], at.map(|i| heights[i]));
        let mut all = [0.0; 6];
        for (i, w) in at.into_iter().zip(w) {
            all[i] = w;
        }
        all
    };
    let steps = 20_000;
    (1..=steps)
        .map(|i| largest_difference(along(2.0 * f64::from(i) / f64::from(steps)), along(2.0 * f64::from(i - 1) / f64::from(steps))))
        .fold(0.0, f64::max)
}

#[test]
fn splat_weights_are_continuous_across_cells() {
    let heights = [0.1, 0.8, 0.95, 0.4, 0.2, 0.7];
    for k in [0.0, 1.0, 8.0] {
        let jump = largest_jump(&|f, h| splat_blend::weights(f, h, k), heights);
        // Samples are 1e-4 of a cell apart. The slope of a weight is at most 2^(k dh) <= 2^(0.85 k), where dh is the largest difference of heights.
        // The tolerance is twice the product of this slope and 1e-4.
        assert!(jump < 1e-4 * (0.85 * k).exp2() * 2.0, "k = {k}: {jump}");
    }
    // Negative control: if the weights depend on the heights alone, without the bilinear factor, they jump at the border of two cells.
    let popping = |f: [f64; 2], h: [f64; 4]| {
        let w = splat_blend::bilinear(f);
        let bent: [f64; 4] = std::array::from_fn(|i| if w[i] > 0.0 { (8.0 * h[i]).exp2() } else { 0.0 });
        bent.map(|b| b / sum(bent))
    };
    assert!(largest_jump(&popping, heights) > 1e-4 * (0.85_f64 * 8.0).exp2() * 2.0);
}

// ---------------------------------------------------------------- triplanar

#[test]
fn triplanar_weights_are_powers() {
    let mut random = Random(41);
    for _ in 0..2000 {
        let n = random.direction();
        let k = random.between(0.0, 12.0);
        let powers = n.map(|x| x.abs().powf(k));
        let w = triplanar::weights(scale(n, 7.0), k);
        assert!(largest_difference(w, powers.map(|p| p / sum(powers))) < 1e-13);
        assert!((sum(w) - 1.0).abs() < 1e-15 * 3.0);
        let single = triplanar::weights(n.map(|x| x as f32), 1e4);
        assert!((single.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    }
    assert_eq!(triplanar::weights([0.0, 0.0, -2.0], 4.0), [0.0, 0.0, 1.0]);
    assert!(largest_difference(triplanar::weights([0.0, 0.0, -2.0], 0.0), [1.0 / 3.0; 3]) < 1e-15);
    assert!(largest_difference(triplanar::weights([1.0, -1.0, 1.0], 1e4), [1.0 / 3.0; 3]) < 1e-12);
    // The weights are continuous along a great circle that involves all three axes.
    let at = |i: u32| {
        let phi = f64::from(i) * 1e-4;
        triplanar::weights([phi.cos(), phi.sin() * 0.6, phi.sin() * 0.8], 8.0)
    };
    let jump = (1..63_000).map(|i| largest_difference(at(i), at(i - 1))).fold(0.0, f64::max);
    assert!(jump < 1e-3, "{jump}");
}

#[test]
fn perturbed_normals_are_those_of_the_displaced_plane() {
    let worst = |perturb: fn([f64; 3], [f64; 3]) -> [f64; 3]| {
        let mut random = Random(43);
        (0..2000)
            .map(|_| {
                let n = random.direction();
                let g = scale(random.direction(), random.between(0.0, 3.0));
                // Displaces two tangents s and t of the plane along n, each by the change of height along the tangent. The true normal is the cross
                // product of the displaced tangents.
                let other = if n[0].abs() < 0.7 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
                let cross = |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
                let s = normalize(cross(n, other));
                let t = cross(n, s);
                let lifted = |v: [f64; 3]| add(v, scale(n, dot(g, v)));
                let truth = normalize(cross(lifted(s), lifted(t)));
                largest_difference(perturb(n, g), truth)
            })
            .fold(0.0, f64::max)
    };
    assert!(worst(triplanar::perturb) < 1e-12);
    assert!(worst(|n, g| triplanar::perturb(n, scale(g, -1.0))) > 0.1, "the mutant with the opposite sign of the gradient passed");
    assert!(worst(|n, g| normalize(sub(n, g))) > 0.1, "the mutant that keeps the component of the gradient along the normal passed");
}

// ---------------------------------------------------------------- select

/// Returns the p-value of the null hypothesis that the probability of an index is proportional to its weight. Returns 0 if an index of weight 0
/// occurs.
fn frequencies_p<const N: usize>(weights: [f64; N], choose: &dyn Fn([f64; N], f64) -> usize) -> f64 {
    let mut random = Random(47);
    let mut counts = [0.0; N];
    for _ in 0..20_000 {
        counts[choose(weights, random.unit())] += 1.0;
    }
    let total: f64 = sum(weights);
    let kept: Vec<(f64, f64)> =
        counts.into_iter().zip(weights).filter(|&(c, w)| w > 0.0 || c > 0.0).map(|(c, w)| (c, 20_000.0 * w / total)).collect();
    if kept.iter().any(|&(_, e)| e <= 0.0) {
        return 0.0;
    }
    let (counts, expected): (Vec<f64>, Vec<f64>) = kept.into_iter().unzip();
    if counts.len() == 1 { 1.0 } else { goodness_p(&counts, &expected, 1) }
}

#[test]
fn choices_occur_as_often_as_their_weights_say() {
    let of_4 = [
        [0.25, 0.25, 0.25, 0.25],
        [0.7, 0.1, 0.15, 0.05],
        [0.0, 0.5, 0.0, 0.5],
        [3.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 0.0, 2.0],
        [0.01, 0.01, 0.01, 10.0],
    ];
    let of_3 = [[1.0, 1.0, 1.0], [0.6, 0.3, 0.1], [0.0, 0.2, 0.8]];
    let level = sidak(of_4.len() + of_3.len());
    for weights in of_4 {
        assert!(frequencies_p(weights, &|w, u| select::of_4(w, u)) > level, "{weights:?}");
    }
    for weights in of_3 {
        assert!(frequencies_p(weights, &|w, u| select::of_3(w, u)) > level, "{weights:?}");
    }
    // Negative controls: two indices are swapped; every index except the last is one too large.
    assert!(frequencies_p(of_4[1], &|w, u| [1, 0, 2, 3][select::of_4(w, u)]) < level);
    assert!(frequencies_p(of_4[1], &|w, u| (select::of_4(w, u) + 1).min(3)) < level);
}

#[test]
fn nothing_of_weight_zero_is_chosen() {
    let below_one = 1.0_f32 - f32::EPSILON / 2.0;
    for mask in 0..16_u32 {
        for size in [f32::MIN_POSITIVE, 1e-20, 0.3, 1.0, 1e29] {
            let weights: [f32; 4] = std::array::from_fn(|i| if mask >> i & 1 == 1 { size * (i + 1) as f32 } else { 0.0 });
            for u in [0.0, 1e-30, 0.25, 0.5, below_one, 1.0, 2.0, f32::NAN, f32::INFINITY, -1.0] {
                let chosen = select::of_4(weights, u);
                assert!(weights[chosen] > 0.0 || (mask == 0 && chosen == 0), "{weights:?} {u}: {chosen}");
            }
        }
    }
    assert_eq!(select::of_4([-1.0, f64::NAN, 1.0, 0.0], 0.0), 2);
    assert_eq!(select::of_3([0.2, 0.3, 0.5], 0.2), 1);
}

// ---------------------------------------------------------------- tiling

#[test]
fn fixed_point_coordinates_are_exact() {
    let mut random = Random(53);
    let exact = |sector: i32, fixed: i32, scale: u32| {
        let modulus = 1_i128 << (24 + scale);
        let rest = (i128::from(sector) * i128::from(fixed)).rem_euclid(modulus);
        (rest >> scale) as f64 / 16_777_216.0
    };
    for i in 0..50_000_u32 {
        let (sector, fixed) = (random.word() as i32, random.word() as i32);
        let scale = i % 9;
        let value: f64 = tiling::fixed(sector, fixed, scale);
        assert_eq!(value.to_bits(), exact(sector, fixed, scale).to_bits(), "{sector} {fixed} {scale}");
        assert!((0.0..1.0).contains(&value));
        assert_eq!(f64::from(tiling::fixed::<f32>(sector, fixed, scale)).to_bits(), value.to_bits());
    }
    for sector in [i32::MIN, -1, 0, 1, i32::MAX] {
        for fixed in [i32::MIN, -1, 0, 1, i32::MAX] {
            assert_eq!(tiling::fixed::<f64>(sector, fixed, 8).to_bits(), exact(sector, fixed, 8).to_bits());
        }
    }
}

#[test]
fn texture_coordinates_fit_across_sector_borders() {
    let gap = |sector_m: f64, tile_m: f64, sector: i32, scale: u32, repeats: f64| {
        let fixed = tiling::per_sector_fixed(sector_m, tile_m);
        let at = |sector: i32, share: f64| tiling::fixed::<f64>(sector, fixed, scale) + share * repeats / f64::from(1 << scale);
        let difference = at(sector, 1.0) - at(sector + 1, 0.0);
        (difference - difference.round()).abs()
    };
    for tile_m in [0.3, 0.7, 1.7, 2.0, 3.1, 24.0] {
        for sector in [-15_626, -1, 0, 77, 15_625, 1_000_000] {
            for scale in 0..=8 {
                let fit = gap(64.0, tile_m, sector, scale, tiling::repeats(64.0, tile_m));
                // Both coordinates are rounded down to a multiple of 2^-24, so they may differ by 2^-24.
                assert!(fit <= 1.0 / 16_777_216.0, "tile {tile_m} m, sector {sector}, scale {scale}: {fit}");
            }
        }
    }
    // Negative control: a slightly different number of repeats per sector leaves a gap at the border.
    assert!(gap(64.0, 1.7, 15_625, 0, 64.0_f64 / 1.7 + 1e-4) > 1.0 / 16_777_216.0);
    assert!((tiling::repeats(64.0, 1.7) - 64.0 / 1.7).abs() < 1e-7);
}

#[test]
fn tiling_follows_distance() {
    for (distance, cliff, scale, part) in [
        (10.0, 1.0, 0, 0.0),
        (30.0, 1.0, 0, 0.0),
        (30.0 * 2.0_f64.sqrt(), 1.0, 0, 0.5),
        (60.0, 1.0, 1, 0.0),
        (240.0, 1.0, 3, 0.0),
        (240.0, 0.5, 1, 0.5),
        (240.0, 0.0, 0, 0.0),
        (1e6, 1.0, 7, 0.0),
    ] {
        let (s, f) = tiling::scales(distance, 30.0, cliff);
        assert!(s == scale && (f - part).abs() < 1e-12, "{distance} m, cliff {cliff}: {s} {f}");
    }
    // The weight of every scale is a continuous function of distance.
    let weights = |i: u32| {
        let (s, f) = tiling::scales(10.0 * (f64::from(i) * 1e-3).exp2(), 30.0, 0.9);
        let mut w = [0.0; 9];
        w[s as usize] += 1.0 - f;
        w[s as usize + 1] += f;
        w
    };
    let jump = (1..16_000).map(|i| largest_difference(weights(i), weights(i - 1))).fold(0.0, f64::max);
    assert!(jump < 1.1e-3, "{jump}");
}

// ---------------------------------------------------------------- flavour weights

const VT: usize = 0;
const FAR_ATLAS: usize = 1;
const NEAR_CLIFF: usize = 2;
const FAR_CLIFF: usize = 3;
const SPLAT: usize = 4;

fn z_of(slope_deg: f64) -> f64 {
    slope_deg.to_radians().cos()
}

#[test]
fn flavours_lie_where_the_rules_put_them() {
    let rules = FlavourRules::default();
    let params = FlavourParams::new(&rules);
    let only = |distance: f64, slope: f64, params: &FlavourParams, flavour: usize| {
        let w = flavour_weights::weights(distance, z_of(slope), params);
        assert!(w[flavour] > 0.999_999, "{distance} m, {slope} degrees: {w:?}");
        assert_eq!(flavour_weights::mask(w), 1 << flavour);
    };
    only(5.0, 0.0, &params, VT);
    only(200.0, 30.0, &params, VT);
    only(400.0, 0.0, &params, FAR_ATLAS);
    only(5.0, 60.0, &params, NEAR_CLIFF);
    only(5.0, 120.0, &params, NEAR_CLIFF);
    only(100.0, 60.0, &params, FAR_CLIFF);
    only(2000.0, 60.0, &params, FAR_ATLAS);
    only(5.0, 41.0, &params, SPLAT);
    // Beyond the distance at which near cliff ends, the splat band is shaded as ground.
    only(100.0, 41.0, &params, VT);
    only(400.0, 41.0, &params, FAR_ATLAS);
    // In the middle of a transition between two flavours, both have a weight of one half.
    let w = flavour_weights::weights(f64::from(params.far_atlas_m), 1.0, &params);
    assert!((w[VT] - 0.5).abs() < 1e-6 && (w[FAR_ATLAS] - 0.5).abs() < 1e-6, "{w:?}");
    let w = flavour_weights::weights(30.0_f64, 0.0, &params);
    assert!((w[NEAR_CLIFF] - 0.5).abs() < 1e-6 && (w[FAR_CLIFF] - 0.5).abs() < 1e-6, "{w:?}");

    let no_vt = FlavourParams::new(&FlavourRules { far_atlas_m: 0.0, ..rules.clone() });
    only(1.0, 0.0, &no_vt, FAR_ATLAS);
    let no_cliff = FlavourParams::new(&FlavourRules { cliff_slope_deg: 90.0, splat_band_deg: 0.0, ..rules.clone() });
    only(1.0, 89.0, &no_cliff, VT);
    only(1.0, 170.0, &no_cliff, VT);
    let no_band = FlavourParams::new(&FlavourRules { splat_band_deg: 0.0, ..rules });
    only(5.0, 41.0, &no_band, VT);
}

#[test]
fn flavour_weights_sum_to_one() {
    let mut random = Random(59);
    for _ in 0..20_000 {
        let rules = FlavourRules {
            far_atlas_m: random.between(0.0, 500.0),
            cliff_far_atlas_m: random.between(0.0, 2000.0),
            cliff_near_m: random.between(0.0, 100.0),
            distance_blend: random.unit(),
            cliff_slope_deg: random.between(0.0, 95.0),
            slope_blend_deg: random.between(0.0, 20.0),
            splat_band_deg: random.between(-5.0, 30.0),
        };
        let params = FlavourParams::new(&rules);
        let (distance, z) = (random.between(-4.0, 13.0).exp2(), random.between(-1.0, 1.0));
        let w = flavour_weights::weights(distance, z, &params);
        assert!((sum(w) - 1.0).abs() < 1e-14 && w.iter().all(|&x| (0.0..=1.0).contains(&x)), "{w:?}");
        let mask = flavour_weights::mask(w);
        for (i, &x) in w.iter().enumerate() {
            assert_eq!(mask >> i & 1 == 1, x > 1.0 / 512.0, "{w:?}");
        }
        for variant in [mask, 31, mask | (random.below(32) as u32)] {
            // A pixel has the same weights in every variant (set of flavours) that contains the flavours of the pixel's mask.
            let own = flavour_weights::weights_for(w, variant, false);
            assert!((sum(own) - 1.0).abs() < 1e-14);
            assert!(largest_difference(own, flavour_weights::weights_for(w, mask, false)) < 1e-15);
            // Bound of the change of a weight. Up to four other flavours are left out, each with a weight of at most 1/512, and the remaining weights
            // are scaled to a sum of 1.
            assert!(largest_difference(own, w) < 4.0 / 512.0 * 1.01);
        }
        let forced = 1 + random.below(31) as u32;
        let all = flavour_weights::weights_for(w, forced, true);
        assert!((sum(all) - 1.0).abs() < 1e-14);
        for (i, &x) in all.iter().enumerate() {
            assert_eq!(x > 9e-4, forced >> i & 1 == 1, "variant {forced}: {all:?}");
        }
        let f32_w: [f32; 5] = flavour_weights::weights(distance as f32, z as f32, &params);
        assert!((f32_w.iter().sum::<f32>() - 1.0).abs() < 1e-6);
    }
    assert_eq!(flavour_weights::weights_for([1.0, 0.0, 0.0, 0.0, 0.0], 0b11000, false), [0.0, 0.0, 0.0, 0.5, 0.5]);
    assert_eq!(flavour_weights::weights_for([1.0, 0.0, 0.0, 0.0, 0.0], 0, false), [0.0, 1.0, 0.0, 0.0, 0.0]);
}

#[test]
fn flavour_weights_are_continuous() {
    let jump_with_distance = |params: &FlavourParams, slope: f64| {
        let at = |i: u32| flavour_weights::weights((f64::from(i) * 1e-4).exp(), z_of(slope), params);
        (1..85_000).map(|i| largest_difference(at(i), at(i - 1))).fold(0.0, f64::max)
    };
    let jump_with_slope = |params: &FlavourParams, distance: f64| {
        let at = |i: u32| flavour_weights::weights(distance, z_of(f64::from(i) * 0.005), params);
        (1..25_000).map(|i| largest_difference(at(i), at(i - 1))).fold(0.0, f64::max)
    };
    let params = FlavourParams::new(&FlavourRules::default());
    // Bound of the change of a weight between two samples. A transition is a smoothstep, whose derivative is at most 1.5 / width. The width is 0.3
    // times the distance of the transition, or 4 degrees. Between samples, the distance changes by at most 1.2e-4 times the distance of the
    // transition, or the slope by 0.005 degrees. A transition by slope is a smoothstep of the cosine, which is slightly steeper; 0.0052 in place of
    // 0.005 allows for this. At most two transitions change a weight at the same point.
    for slope in [0.0, 38.0, 41.0, 44.0, 46.0, 60.0] {
        assert!(jump_with_distance(&params, slope) < 2.0 * 1.5 * 1.2e-4 / 0.3, "{slope} degrees");
    }
    for distance in [1.0, 28.0, 31.0, 100.0, 300.0, 1500.0] {
        assert!(jump_with_slope(&params, distance) < 2.0 * 1.5 * 0.0052 / 4.0, "{distance} m");
    }
    // Negative controls: a transition with a width of zero has a jump.
    let hard = FlavourRules { distance_blend: 0.0, slope_blend_deg: 0.0, ..FlavourRules::default() };
    assert!(jump_with_distance(&FlavourParams::new(&hard), 60.0) > 0.1);
    assert!(jump_with_slope(&FlavourParams::new(&hard), 10.0) > 0.1);
}

// ---------------------------------------------------------------- brdf

/// Returns the integral over the hemisphere of `f`, a function of cos theta alone. It is computed by the trapezoidal rule in ln tan theta: as a
/// function of this variable, even a narrow lobe is smooth.
fn over_hemisphere(f: &dyn Fn(f64) -> f64) -> f64 {
    let step = 0.01;
    (-1600..1600)
        .map(|i| {
            let theta = (f64::from(i) * step).exp().atan();
            f(theta.cos()) * std::f64::consts::TAU * theta.sin() * theta.sin() * theta.cos() * step
        })
        .sum()
}

#[test]
fn ggx_is_normalised() {
    let normalised = |d: &dyn Fn(f64, f64) -> f64, alpha: f64| (over_hemisphere(&|c| d(c, alpha) * c) - 1.0).abs() < 1e-6;
    for alpha in [0.002, 0.01, 0.1, 0.3, 0.7, 1.0] {
        assert!(normalised(&brdf::d_ggx, alpha), "alpha {alpha}");
        // Negative controls: in the first one, the cosine of the projected area is applied twice; the second one has an additional factor alpha.
        assert!(!normalised(&|c, a| brdf::d_ggx(c, a) * c, alpha.max(0.1)));
        assert!(!normalised(&|c, a| brdf::d_ggx(c, a) * a, alpha.min(0.7)));
    }
    // Near the peak of a narrow highlight, `d_ggx` is precise in f32. The textbook form is not, because two nearly equal numbers cancel.
    let c = 1.0_f32 - 5e-7;
    let truth = brdf::d_ggx(f64::from(c), f64::from(0.002_f32));
    let error = |d: f32| (f64::from(d) / truth - 1.0).abs();
    assert!(error(brdf::d_ggx(c, 0.002)) < 1e-6);
    let a2 = 0.002_f32 * 0.002;
    let textbook = c * c * (a2 - 1.0) + 1.0;
    assert!(error(a2 / (std::f32::consts::PI * textbook * textbook)) > 1e-6);
}

#[test]
fn visibility_is_smiths_correlated_form() {
    // The function Lambda of Heitz 2014, written with the squared tangent as in the paper.
    let lambda = |c: f64, a: f64| 0.5 * ((1.0 + a * a * (1.0 - c * c) / (c * c)).sqrt() - 1.0);
    let worst = |g: &dyn Fn(f64, f64) -> f64| {
        let mut random = Random(61);
        (0..2000)
            .map(|_| {
                let (v, l, a) = (random.between(0.01, 1.0), random.between(0.01, 1.0), random.between(0.002, 1.0));
                let truth = g(lambda(v, a), lambda(l, a)) / (4.0 * v * l);
                (brdf::v_smith_ggx_correlated(v, l, a) / truth - 1.0).abs()
            })
            .fold(0.0, f64::max)
    };
    assert!(worst(&|v, l| 1.0 / (1.0 + v + l)) < 1e-12);
    assert!(worst(&|v, l| 1.0 / ((1.0 + v) * (1.0 + l))) > 0.01, "the uncorrelated mutant passed");
}

#[test]
fn fresnel_and_environment_are_in_bounds() {
    assert!(largest_difference(brdf::f_schlick([0.04, 0.5, 1.0], 1.0), [0.04, 0.5, 1.0]) < 1e-15);
    assert!(largest_difference(brdf::f_schlick([0.04, 0.5, 1.0], 0.0), [1.0; 3]) < 1e-15);
    assert!((brdf::f_schlick([0.0_f64; 3], 0.5)[0] - 1.0 / 32.0).abs() < 1e-15);
    assert!((brdf::alpha(0.5_f64) - 0.25).abs() < 1e-15 && (brdf::alpha(0.0_f64) - brdf::MIN_ALPHA).abs() < 1e-15);

    // Computes the integral that `env_approx` fits, by stratified sampling of half vectors.
    let integral = |f0: f64, roughness: f64, n_dot_v: f64| {
        let alpha = brdf::alpha(roughness);
        let view = [(1.0 - n_dot_v * n_dot_v).sqrt(), 0.0, n_dot_v];
        let n = 64;
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let (u, phi) = ((f64::from(i) + 0.5) / f64::from(n), std::f64::consts::TAU * (f64::from(j) + 0.5) / f64::from(n));
                let cosine = ((1.0 - u) / (1.0 + (alpha * alpha - 1.0) * u)).sqrt();
                let sine = (1.0 - cosine * cosine).sqrt();
                let half = [sine * phi.cos(), sine * phi.sin(), cosine];
                let v_dot_h = dot(view, half);
                let l_z = 2.0 * v_dot_h * half[2] - view[2];
                if v_dot_h > 0.0 && l_z > 0.0 {
                    let visible = brdf::v_smith_ggx_correlated(n_dot_v, l_z, alpha) * l_z * 4.0 * v_dot_h / cosine;
                    sum += brdf::f_schlick([f0; 3], v_dot_h)[0] * visible / f64::from(n * n);
                }
            }
        }
        sum
    };
    let worst = |f0: f64, fit: &dyn Fn(f64, f64) -> f64| {
        let mut worst: f64 = 0.0;
        for roughness in [0.1, 0.3, 0.5, 0.7, 0.9] {
            for n_dot_v in [0.1, 0.3, 0.5, 0.8, 1.0] {
                let truth = integral(f0, roughness, n_dot_v);
                assert!(truth <= 1.0 + 1e-3, "more light is reflected than arrives: {truth}");
                worst = worst.max((fit(roughness, n_dot_v) - truth).abs());
            }
        }
        worst
    };
    // The bounds are slightly above the largest measured differences between the fit and this integral. The fit was made for a different visibility
    // term, so a fit to this integral could be better.
    for (f0, bound) in [(0.04, 0.1), (1.0, 0.31)] {
        let off = worst(f0, &|r, v| brdf::env_approx([f0; 3], r, v)[0]);
        assert!(off < bound, "f0 {f0}: {off}");
        assert!(
            worst(f0, &|r, v| brdf::env_approx([f0; 3], 1.0 - r, v)[0]) > bound,
            "the mutant that uses smoothness instead of roughness passed"
        );
        assert!(worst(f0, &|r, v| brdf::env_approx([f0; 3], r, 1.0 - v)[0]) > bound || f0 > 0.5, "the mutant with 1 - n.v passed");
    }
}

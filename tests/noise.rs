//! The seven kinds of noise: each must be arranged as its name says, and the renderer must choose by the requested kind.
//!
//! Statistical tests have fixed seeds. Each family of N tests has a level of 0.1 % in all (1 - 0.999^(1/N) for each test, Sidak), and a mutant that
//! it must reject. `noise_stability` tests that the numbers are uniform and independent, `shared` how hashed cells depend on scale and place, and
//! `agreement` that the shader computes the same bits.

use experiments::stability::statistics::{Random, coverage_p, independent_p, sidak, uncorrelated_p};
use kernels::base::wgsl;
use kernels::frame::VariantChoice;
use kernels::frame::picture::AovSet;
use kernels::shared::blue_noise::{self, EDGE, RANKS, SLICES};
use kernels::shared::noise::{self, HashedPoint, NoiseKind, WORLD_LEVEL};
use kernels::shared::{hash, select};
use kernels::variant::{Flavour, Variant};

use crate::layouts::constants;

use crate::fixtures::{renderer, request};

/// Number of samples of a statistic: the pixels in the areas of five masks.
const SAMPLES: u32 = 5 * RANKS;

/// The ground that a pixel shows. The ground points of neighbouring pixels are 20 cm apart, but the footprint of a pixel is only 5 cm wide, so that
/// cells of every kind hold one pixel at most.
fn ground([x, y]: [u32; 2]) -> HashedPoint<f64> {
    HashedPoint {
        sector: [15_625, -3],
        position: [f64::from(x) * 0.2 + 0.01, f64::from(y) * 0.2 + 0.01, 1234.5],
        sector_m: 1024.0,
        ddx: [0.05, 0.0, 0.0],
        ddy: [0.0, 0.05, 0.0],
        hash_scale: 1.0,
    }
}

fn thresholds(kind: NoiseKind, pixel: [u32; 2], frame: u32, seed: u32, salt: u32) -> [f64; 4] {
    noise::thresholds(kind, &ground(pixel), WORLD_LEVEL, pixel, frame, seed, salt)
}

/// The pixel and the frame of random sample `i`.
fn somewhere(i: u32) -> ([u32; 2], u32) {
    let mut random = Random(u64::from(i) << 20);
    let mut below = |n: f64| random.between(0.0, n) as u32;
    ([below(1920.0), below(1080.0)], below(1000.0))
}

/// The thresholds of all pixels in an area of the size of a mask.
fn picture(kind: NoiseKind, frame: u32, seed: u32) -> Vec<[f64; 4]> {
    (0..RANKS).map(|i| thresholds(kind, [i % EDGE, i / EDGE], frame, seed, 3)).collect()
}

fn column(samples: &[[f64; 4]], i: usize) -> Vec<f64> {
    samples.iter().map(|s| s[i]).collect()
}

fn pairs(samples: &[[f64; 4]], i: usize, j: usize) -> Vec<(f64, f64)> {
    samples.iter().map(|s| (s[i], s[j])).collect()
}

/// The kinds whose pixels are not independent random numbers.
const ARRANGED: [NoiseKind; 3] = [NoiseKind::InterleavedGradient, NoiseKind::Blue, NoiseKind::SpatioTemporalBlue];

#[test]
fn a_picture_covers_alpha_as_evenly_as_its_kind_promises() {
    let covered = |samples: &[[f64; 4]], alpha: f64| samples.iter().filter(|s| s[2] < alpha).count() as u64;
    for kind in NoiseKind::ALL {
        // The coverage of independent pixels has a standard deviation of sqrt(alpha (1 - alpha) / pixels). 64 pictures measure it with a relative
        // error of about 1/11. A mask holds each rank once, so only the jitter of one rank is random. A gradient lattice is nearly as even.
        let pictures: Vec<_> = (0..64).map(|i| picture(kind, i, i)).collect();
        for alpha in [0.1, 0.5, 0.9] {
            let errors: Vec<f64> = pictures.iter().map(|p| covered(p, alpha) as f64 / f64::from(RANKS) - alpha).collect();
            let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let share = deviation / (alpha * (1.0 - alpha) / f64::from(RANKS)).sqrt();
            println!("{kind}, alpha {alpha}: {share:.3} of chance");
            if kind.needs_mask() {
                assert!(errors.iter().all(|e| e.abs() <= 1.0 / f64::from(RANKS)), "{kind} at alpha {alpha}");
            } else if kind == NoiseKind::InterleavedGradient {
                assert!(share < 0.5, "{kind} at alpha {alpha}: {share} times the deviation of independent pixels");
            } else {
                assert!((0.6..1.4).contains(&share), "{kind} at alpha {alpha}: {share} times the deviation of independent pixels");
            }
        }
    }
}

#[test]
fn decisions_are_independent_within_pictures_that_are_arranged() {
    // 3 kinds x 6 pairs x 2 tests. `noise_stability` tests the kinds whose pixels are independent.
    let level = sidak(36);
    for kind in ARRANGED {
        let samples: Vec<[f64; 4]> = (0..SAMPLES / RANKS).flat_map(|i| picture(kind, 7 * i, 100 + i)).collect();
        for i in 0..4 {
            for j in 0..i {
                let (table, line) = (independent_p(&pairs(&samples, i, j)), uncorrelated_p(&pairs(&samples, i, j)));
                assert!(table > level && line > level, "{kind}, {i} and {j}: p = {table:e}, {line:e}");
            }
        }
    }
    // Negative controls: all decisions use the rank of the first decision. Two decisions use the same gradient lattice at different shifts, without
    // the reflections and the exchange of x and y that distinguish decisions in the kernel.
    let shared = |i: u32| -> [f64; 4] {
        let ([x, y], frame) = somewhere(i);
        let rank = blue_noise::ranks()[noise::rank_index(NoiseKind::SpatioTemporalBlue, [x, y], frame, i, 3, 0) as usize];
        noise::mask(NoiseKind::SpatioTemporalBlue, [x, y], frame, i, 3, [rank; 4])
    };
    let shared: Vec<_> = (0..SAMPLES).map(shared).collect();
    assert!(independent_p(&pairs(&shared, 0, 3)) < level && uncorrelated_p(&pairs(&shared, 0, 3)) < level);
    let unit = |x, y| hash::to_unit::<f64>(noise::interleaved_gradient_value([x, y], 0));
    let lattice: Vec<_> = (0..RANKS).map(|i| (unit(i % EDGE, i / EDGE), unit(i % EDGE + 9172, i / EDGE + 12_003))).collect();
    assert!(independent_p(&lattice) < level);
}

#[test]
fn neighbours_differ_on_purpose_where_noise_is_arranged() {
    // (3 kinds and a control) x 2 directions.
    let level = sidak(8);
    for kind in ARRANGED.into_iter().chain([NoiseKind::WhiteScreen]) {
        for [dx, dy] in [[1, 0], [0, 1]] {
            let pair = |i: u32| {
                let [x, y] = [i % 160, i / 160];
                (thresholds(kind, [x, y], 5, 8, 3)[0], thresholds(kind, [x + dx, y + dy], 5, 8, 3)[0])
            };
            let pairs: Vec<_> = (0..SAMPLES).map(pair).collect();
            let independent = independent_p(&pairs) > level;
            assert_eq!(independent, kind == NoiseKind::WhiteScreen, "{kind}, neighbours at {dx}, {dy}");
        }
    }
}

// ---------------------------------------------------------------- time

#[test]
fn only_kinds_per_frame_change_with_the_frame() {
    for kind in NoiseKind::ALL {
        let changed = |frame: u32| {
            let differs = |i: u32| {
                let (pixel, _) = somewhere(i);
                thresholds(kind, pixel, frame, 8, 3) != thresholds(kind, pixel, 0, 8, 3)
            };
            (0..1000).filter(|&i| differs(i)).count()
        };
        // The slices repeat after 16 frames. Then only the jitter within a rank differs.
        for frame in [1, 15, 16, 1_000_000, u32::MAX] {
            assert_eq!(changed(frame), if kind.is_per_frame() { 1000 } else { 0 }, "{kind}, frame {frame}");
        }
        // Kinds that are bound to the ground do not depend on the pixel, and kinds of the screen do not depend on the ground.
        let at = |pixel, point: [u32; 2]| noise::thresholds(kind, &ground(point), WORLD_LEVEL, pixel, 2, 8, 3);
        let bound = matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic | NoiseKind::WhiteWorld);
        assert_eq!(at([5, 6], [9, 9]) == at([6, 6], [9, 9]), bound, "{kind}");
        assert_eq!(at([5, 6], [9, 9]) == at([5, 6], [10, 9]), !bound, "{kind}");
    }
}

/// A picture for each of as many frames as the mask has slices: the value of `of` at all pixels in the area of a mask.
fn sequence(of: &dyn Fn([u32; 2], u32) -> f64) -> Vec<Vec<f64>> {
    (0..SLICES).map(|frame| (0..RANKS).map(|i| of([i % EDGE, i / EDGE], frame)).collect()).collect()
}

/// Correlation of the value of a pixel with its value one frame later, over all pixels and frames. The last frame is followed by the first.
fn lag_one(frames: &[Vec<f64>]) -> f64 {
    let next = frames.iter().cycle().skip(1);
    let products = frames.iter().zip(next).flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - 0.5) * (b - 0.5)));
    12.0 * products.sum::<f64>() / f64::from(SLICES * RANKS)
}

/// Variance of the mean of a pixel over `window` successive frames, relative to that of white noise.
fn windowed_variance(frames: &[Vec<f64>], window: usize) -> f64 {
    let n = frames.len();
    let mean = |pixel: usize, first: usize| (0..window).map(|i| frames[(first + i) % n][pixel]).sum::<f64>() / window as f64;
    let squares = (0..n).flat_map(|first| (0..RANKS as usize).map(move |pixel| (first, pixel)));
    let sum: f64 = squares.map(|(first, pixel)| (mean(pixel, first) - 0.5).powi(2)).sum();
    sum / f64::from(SLICES * RANKS) * 12.0 * window as f64
}

#[test]
fn frames_follow_each_other_as_each_kind_promises() {
    let of = |kind: NoiseKind| sequence(&move |pixel, frame| thresholds(kind, pixel, frame, 8, 3)[0]);
    let chance = 4.9 / f64::from(SLICES * RANKS).sqrt();
    // White noise has no correlation. H0: frames are independent. Then the correlation at lag 1 is normal with a standard deviation of 1/sqrt(n), and
    // a bound of 4.9 standard deviations is a level of 1e-6.
    let white = of(NoiseKind::WhiteScreen);
    assert!(lag_one(&white).abs() < chance, "white: {}", lag_one(&white));
    assert!((windowed_variance(&white, 4) - 1.0).abs() < 0.1);
    // Spatio-temporal blue noise: a pixel avoids the values of the frames just before, so the mean of a few frames is nearer to one half than that of
    // independent frames.
    let blue = of(NoiseKind::SpatioTemporalBlue);
    println!("stbn: lag one {}, windows {:?}", lag_one(&blue), [2, 4, 8].map(|w| windowed_variance(&blue, w)));
    assert!(lag_one(&blue) < -0.2, "stbn: {}", lag_one(&blue));
    assert!(windowed_variance(&blue, 4) < 0.4 && windowed_variance(&blue, 8) < 0.15);
    // Interleaved gradient noise: a value advances by about 0.6 per frame. So frames are not independent, and the mean converges faster.
    let gradient = of(NoiseKind::InterleavedGradient);
    println!("ign: lag one {}, windows {:?}", lag_one(&gradient), [2, 4, 8].map(|w| windowed_variance(&gradient, w)));
    assert!(lag_one(&gradient) < -0.2 && windowed_variance(&gradient, 8) < 0.5);
    // Negative controls: the same blue mask in every frame; a blue mask with a different shift in every frame; slices in a different order.
    let repeated = of(NoiseKind::Blue);
    assert!(lag_one(&repeated) > 0.99 && windowed_variance(&repeated, 4) > 3.9);
    let reseeded = sequence(&|pixel, frame| thresholds(NoiseKind::Blue, pixel, 0, frame, 3)[0]);
    assert!(lag_one(&reseeded) > -0.05 && windowed_variance(&reseeded, 4) > 0.8, "reseeded: {}", lag_one(&reseeded));
    let disordered = sequence(&|pixel, frame| thresholds(NoiseKind::SpatioTemporalBlue, pixel, frame * 7, 8, 3)[0]);
    assert!(lag_one(&disordered) > -0.2, "disordered: {}", lag_one(&disordered));
}

// ---------------------------------------------------------------- space

/// Mean power of a picture of the size of a mask, by distance from frequency zero; the first entry is for 1 cycle per edge. White noise of the same
/// variance has a power of 1.
fn radial_power(values: &[f64]) -> Vec<f64> {
    let n = EDGE as usize;
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
    let turns: Vec<(f64, f64)> = (0..n).map(|k| (std::f64::consts::TAU * k as f64 / n as f64).sin_cos()).collect();
    // Transforms the rows, then the columns. Each value is a sum of 64 terms.
    let transform = |at: &dyn Fn(usize) -> (f64, f64), frequency: usize| {
        (0..n).fold((0.0, 0.0), |(re, im), i| {
            let ((a, b), (sin, cos)) = (at(i), turns[i * frequency % n]);
            (re + a * cos + b * sin, im + b * cos - a * sin)
        })
    };
    let rows: Vec<(f64, f64)> = (0..n * n).map(|i| transform(&|x| (values[i / n * n + x] - mean, 0.0), i % n)).collect();
    let (mut power, mut count) = (vec![0.0; n / 2], vec![0.0; n / 2]);
    for i in 0..n * n {
        let (u, v) = (i % n, i / n);
        let (re, im) = transform(&|y| rows[y * n + u], v);
        let distance = (u.min(n - u) as f64).hypot(v.min(n - v) as f64).round() as usize;
        if (1..n / 2).contains(&distance) {
            power[distance] += (re * re + im * im) / (values.len() as f64 * variance);
            count[distance] += 1.0;
        }
    }
    power.iter().zip(&count).skip(1).map(|(p, c)| p / c).collect()
}

/// Mean of the power up to an eighth of a cycle per pixel.
fn low_power(values: &[f64]) -> f64 {
    radial_power(values)[..8].iter().sum::<f64>() / 8.0
}

#[test]
fn blue_noise_has_no_low_frequencies() {
    let first = |kind, frame, seed| column(&picture(kind, frame, seed), 0);
    let white = low_power(&first(NoiseKind::WhiteScreen, 0, 8));
    assert!((0.8..1.25).contains(&white), "white: {white}");
    // Checks the thresholds, and the pixels that are chosen at an alpha. Seeds shift a mask, which does not change its spectrum.
    let chosen = |u: &[f64], alpha: f64| low_power(&u.iter().map(|&u| f64::from(u8::from(u < alpha))).collect::<Vec<_>>());
    let pictures = [(NoiseKind::Blue, 0, 8), (NoiseKind::Blue, 3, 77)].into_iter();
    let slices = (0..SLICES).map(|frame| (NoiseKind::SpatioTemporalBlue, frame, 8 + frame));
    for (kind, frame, seed) in pictures.chain(slices) {
        let u = first(kind, frame, seed);
        let power = low_power(&u);
        let at = [0.1, 0.5, 0.9].map(|alpha| chosen(&u, alpha));
        println!("{kind} {frame}: {power:.4} {at:.4?}; {:.3?}", radial_power(&u));
        // The bounds are about four times the measured power. A slice is less blue in space than a mask, because it is also blue in time. A picture
        // of chosen pixels has only two values, so its power is higher than that of the thresholds.
        let bound = if kind == NoiseKind::Blue { 0.001 } else { 0.005 };
        assert!(power < bound, "{kind}, frame {frame}: {power}");
        assert!(at.iter().all(|&p| p < 0.1), "{kind}, frame {frame}: {at:?}");
    }
    // Negative controls: the same ranks in a different order; a different seed for each pixel.
    let mut shuffled: Vec<(u32, f64)> = (0..).zip(first(NoiseKind::Blue, 0, 8)).map(|(i, u)| (hash::pcg(i), u)).collect();
    shuffled.sort_unstable_by_key(|s| s.0);
    let shuffled: Vec<f64> = shuffled.into_iter().map(|s| s.1).collect();
    assert!(low_power(&shuffled) > 0.5 && chosen(&shuffled, 0.5) > 0.5, "shuffled: {}", low_power(&shuffled));
    let scattered: Vec<f64> = (0..RANKS).map(|i| thresholds(NoiseKind::Blue, [i % EDGE, i / EDGE], 0, 8 + i, 3)[0]).collect();
    assert!(low_power(&scattered) > 0.5, "a seed a pixel: {}", low_power(&scattered));
}

#[test]
fn masks_hold_every_rank_once() {
    let ranks = blue_noise::ranks();
    assert_eq!(ranks.len(), (RANKS * (1 + SLICES)) as usize);
    let whole = |slice: &[u32]| {
        let mut sorted = slice.to_vec();
        sorted.sort_unstable();
        sorted.into_iter().eq(0..RANKS)
    };
    assert!(ranks.chunks(RANKS as usize).all(whole));
    // No two masks or slices are equal.
    for (i, slice) in ranks.chunks(RANKS as usize).enumerate() {
        assert!(ranks.chunks(RANKS as usize).take(i).all(|other| other != slice));
    }
    // Negative control: a window that starts one row too late covers parts of two masks.
    assert!(!whole(&ranks[EDGE as usize..][..RANKS as usize]));
    // The masks are the same on every machine and in every run. The checksum is the FNV-1a of the ranks.
    let checksum = ranks.iter().fold(0x811c_9dc5_u32, |sum, &rank| (sum ^ rank).wrapping_mul(0x0100_0193));
    assert_eq!(checksum, 978_342_109, "the masks have changed");
}

#[test]
fn masks_lie_in_the_buffer_where_the_shader_looks() {
    let wgsl = constants(&wgsl::pieces(kernels::shared::WGSL));
    let [x, y] = noise::IGN_SLOPES;
    let expected = [
        ("NOISE_MASK_EDGE", EDGE),
        ("NOISE_MASK_RANKS", RANKS),
        ("NOISE_MASK_SLICES", SLICES),
        ("NOISE_IGN_SLOPE_X", x),
        ("NOISE_IGN_SLOPE_Y", y),
        ("NOISE_IGN_FRAME", noise::IGN_FRAME),
        ("NOISE_IGN_WHOLE", noise::IGN_WHOLE),
        ("NOISE_IGN_REST", noise::IGN_REST),
        ("NOISE_HASHED_ISOTROPIC", NoiseKind::HashedIsotropic.code()),
        ("NOISE_HASHED_ANISOTROPIC", NoiseKind::HashedAnisotropic.code()),
        ("NOISE_WHITE_SCREEN", NoiseKind::WhiteScreen.code()),
        ("NOISE_WHITE_WORLD", NoiseKind::WhiteWorld.code()),
        ("NOISE_INTERLEAVED_GRADIENT", NoiseKind::InterleavedGradient.code()),
        ("NOISE_BLUE", NoiseKind::Blue.code()),
        ("NOISE_SPATIO_TEMPORAL_BLUE", NoiseKind::SpatioTemporalBlue.code()),
    ];
    for (name, host) in expected {
        assert_eq!(wgsl.get(name), Some(&f64::from(host)), "{name}");
    }
    assert_eq!(wgsl.get("NOISE_LEVEL_MIN"), Some(&f64::from(noise::LEVEL_MIN)));
    assert_eq!(wgsl.get("NOISE_LEVEL_MAX"), Some(&f64::from(noise::LEVEL_MAX)));
    // Over the pixels of an area of the size of a mask, a decision reads each place of its slice exactly once, for every shift.
    for kind in NoiseKind::ALL {
        for (frame, decision) in [(0, 0), (5, 1), (16, 2), (u32::MAX, 3)] {
            let place = |i: u32| noise::rank_index(kind, [i % EDGE + 1900, i / EDGE + 1000], frame, 8, 3, decision);
            let mut places: Vec<u32> = (0..RANKS).map(place).collect();
            places.sort_unstable();
            let first = match kind {
                NoiseKind::Blue => 0,
                NoiseKind::SpatioTemporalBlue => RANKS * (1 + frame % SLICES),
                _ => {
                    assert!(places.iter().all(|&place| place == 0), "{kind} needs no rank");
                    continue;
                }
            };
            assert!(places.into_iter().eq(first..first + RANKS), "{kind}, frame {frame}, decision {decision}");
        }
    }
}

#[test]
fn interleaved_gradient_noise_is_the_published_one() {
    // Jimenez' formula in f64. In the integer version, each coefficient is rounded to within half of 2^-32. So the inner fraction has an error of at
    // most (x + y + frame) / 2 times 2^-32, where the sum is below 4000. The outer factor multiplies the error by 53.
    let published = |x: f64, y: f64| (52.982_918_9 * (0.067_110_56 * x + 0.005_837_15 * y).fract()).fract();
    let around = |a: f64, b: f64| (a - b).abs().min(1.0 - (a - b).abs());
    let errors = |of: &dyn Fn([u32; 2], u32) -> f64| {
        let error = |i: u32| {
            let ([x, y], frame) = somewhere(i);
            let time = 5.588_238 * f64::from(frame);
            around(of([x, y], frame), published(f64::from(x) + time, f64::from(y) + time))
        };
        (0..10_000).map(error).collect::<Vec<_>>()
    };
    let far = |list: &[f64]| list.iter().filter(|&&e| e > 53.0 * 4000.0 * 0.5 / 4_294_967_296.0).count();
    let unit = |word: u32| f64::from(word) / 4_294_967_296.0;
    // If the inner value is close to a whole number, rounding may put the two versions on different sides of the step of 0.98.
    assert!(far(&errors(&|pixel, frame| unit(noise::interleaved_gradient_value(pixel, frame)))) <= 2);
    assert!(far(&errors(&|[x, y], frame| unit(noise::interleaved_gradient_value([y, x], frame)))) > 9000, "the mutant passed");
    assert!(far(&errors(&|pixel, frame| unit(noise::interleaved_gradient_value(pixel, frame + 1)))) > 9000, "the mutant passed");
    // The purpose of this noise: the nine values of a 3 x 3 neighbourhood are spread evenly. If the nine values are sorted, the mean gap between
    // neighbours is 1/9. In white noise, the smallest of the nine gaps is about 1/81.
    let least_gap = |of: &dyn Fn(u32, u32) -> f64| {
        let gap = |i: u32| {
            let mut nine: Vec<f64> = (0..9).map(|k| of(i % 100 + k % 3, i / 100 + k / 3)).collect();
            nine.sort_by(f64::total_cmp);
            (0..9).map(|k| if k == 8 { nine[0] + 1.0 - nine[8] } else { nine[k + 1] - nine[k] }).fold(1.0, f64::min)
        };
        (0..10_000).map(gap).sum::<f64>() / 10_000.0
    };
    let of = |kind: NoiseKind, decision: usize| least_gap(&|x, y| thresholds(kind, [x, y], 3, 8, 3)[decision]);
    for decision in 0..4 {
        let gap = of(NoiseKind::InterleavedGradient, decision);
        assert!(gap > 0.05, "decision {decision}: {gap}");
    }
    assert!(of(NoiseKind::WhiteScreen, 0) < 0.02);
    // The published function is not uniform, but it is uniform after rotation by a hash. H0: the share of values above 0.983 is 0.017. One test, at
    // 0.1 %.
    const DRAWS: u32 = 4_000_000;
    let above = |of: &dyn Fn(u32) -> f64| (0..DRAWS).filter(|&i| of(i) >= 0.983).count() as u64;
    let p = |n: u64| coverage_p(n, u64::from(DRAWS), 0.017);
    let hashed = |i: u32| hash::pcg4d([i, 1, 2, 3]);
    let rotated = p(above(&|i| noise::interleaved_gradient::<f64>([9, 9], 3, i, 3)[0]));
    assert!(rotated > sidak(1), "p = {rotated:e}");
    let plain = p(above(&|i| unit(noise::interleaved_gradient_value([hashed(i)[0], hashed(i)[1]], 0))));
    assert!(plain < sidak(1), "the published function passed as uniform: p = {plain:e}");
}

#[test]
fn world_cells_have_the_size_asked_for() {
    for level in [0, WORLD_LEVEL, 7] {
        let at = |x: f64| {
            let point = HashedPoint { position: [x, 0.5, 0.5], ..ground([0, 0]) };
            noise::white_world(&point, level, 8, 3)
        };
        let cells = 1 + (1..64 * 256).filter(|&i| at(f64::from(i) / 256.0) != at(f64::from(i - 1) / 256.0)).count();
        assert_eq!(cells, 64 << level, "level {level}");
    }
    // The level is clamped to the levels that the shader has, and the footprint does not change cells.
    assert_eq!(noise::white_world(&ground([3, 4]), i32::MAX, 8, 3), noise::white_world(&ground([3, 4]), noise::LEVEL_MAX, 8, 3));
    assert_eq!(noise::white_world(&ground([3, 4]), i32::MIN, 8, 3), noise::white_world(&ground([3, 4]), noise::LEVEL_MIN, 8, 3));
    let closer = HashedPoint { ddx: [1e-3; 3], hash_scale: 4.0, ..ground([3, 4]) };
    assert_eq!(noise::white_world(&closer, 4, 8, 3), noise::white_world(&ground([3, 4]), 4, 8, 3));
    // Negative control: hashed noise does depend on the footprint.
    assert_ne!(noise::hashed_isotropic(&closer, 8, 3), noise::hashed_isotropic(&ground([3, 4]), 8, 3));
}

// ---------------------------------------------------------------- the frame

#[test]
fn the_frame_chooses_by_the_noise_asked_for() {
    let mut renderer = renderer();
    let base = request(&renderer, "ground").with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarCliff));
        r.outputs.aovs = AovSet::from_names(&["choice"]).expect("known layers");
    });
    for kind in NoiseKind::ALL {
        let mut pictures = Vec::new();
        // Kinds with a mask come after kinds without one: their ranks must be on the device when they are first requested.
        for (frame, seed) in [(0, 5), (17, 5), (17, 6)] {
            let request = base.with(|r| {
                r.shading.noise = kind;
                r.shading.frame = frame;
                r.shading.seed = seed;
            });
            let picture = renderer.render(&request).expect("renders");
            let choice: Vec<u32> = picture.values("choice").expect("asked for").iter().map(|&c| c as u32).collect();
            if !matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic | NoiseKind::WhiteWorld) {
                // The expected texel of the first tiling, from the weights of the pixel and the second threshold of the reference. The salt of far
                // cliff is 2.
                let inspected = renderer.drawn_as(&request).and_then(|frame| frame.inspect()).expect("inspects");
                let differing = |frame: u32, decision: usize| {
                    let (mut wrong, mut seen) = (0, 0);
                    for (i, (pixel, &choice)) in (0..).zip(inspected.iter().zip(&choice)).filter(|(_, (_, c))| **c > 0) {
                        let u = thresholds(kind, [i % request.view.size[0], i / request.view.size[0]], frame, seed, 2)[decision];
                        wrong += usize::from(select::of_4(pixel.bilinear.map(f64::from), u) != (choice as usize - 1) % 4);
                        seen += 1;
                    }
                    assert!(seen > 1000, "{seen} pixels chose");
                    f64::from(u32::try_from(wrong).expect("few")) / f64::from(seen)
                };
                // Rarely, rounding puts a sum of f32 weights on the other side of a threshold of 24 bits.
                let wrong = differing(frame, 1);
                assert!(wrong < 1e-3, "{kind}, frame {frame}, seed {seed}: {wrong} of the choices differ");
                // Negative controls: the threshold of a different decision, and that of the next frame.
                assert!(differing(frame, 0) > 0.1, "{kind}: the threshold of a different decision passed");
                assert_eq!(differing(frame + 1, 1) > 0.1, kind.is_per_frame(), "{kind}: the threshold of the next frame");
            }
            pictures.push(choice);
        }
        assert_eq!(pictures[0] != pictures[1], kind.is_per_frame(), "{kind}: frames 0 and 17");
        assert_ne!(pictures[1], pictures[2], "{kind}: two seeds");
    }
}

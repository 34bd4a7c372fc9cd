//! Tests the seven kinds of noise. Noise gives each pixel four thresholds in [0, 1), one for each of the four random choices (decisions) of the
//! shader. The thresholds of each kind must be distributed over pixels and frames as the name of the kind says.
//!
//! Statistical tests have fixed seeds. The N tests of a family share a significance level of 0.1 %, so each test has the level 1 - 0.999^(1/N)
//! (Sidak). A test of a single hypothesis states its own level; other statistics are compared with fixed
//! bounds. Each family also has a control: a mutant that it must reject, or noise that it must accept.
//! `noise_stability` tests that the numbers are uniform and independent, `shared` tests how hashed cells depend on scale and position, `agreement`
//! compares the shader with the reference, and `noise_frame` tests that the renderer uses the requested kind.

use kernels::shared::blue_noise::{self, EDGE, RANKS, SLICES};
use kernels::shared::noise::{self, HashedPoint, NoiseKind, WORLD_LEVEL};
use kernels::shared::{derivatives, hash, select, view};

use crate::statistics::{Random, coverage_p, independent_p, sidak, uncorrelated_p};

/// Number of samples of a statistic: the number of pixels of five blue-noise masks.
const SAMPLES: u32 = 5 * RANKS;

/// Returns the ground point that a pixel shows. The ground points of neighbouring pixels are 20 cm apart, but the footprint of a pixel is only 5 cm
/// wide. So a cell of noise contains the ground point of at most one pixel.
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

/// Returns a random pixel and a random frame for sample number `i`.
fn somewhere(i: u32) -> ([u32; 2], u32) {
    let mut random = Random(u64::from(i) << 20);
    let mut below = |n: f64| random.between(0.0, n) as u32;
    ([below(1920.0), below(1080.0)], below(1000.0))
}

/// Returns the thresholds of all pixels in an area that is as large as a blue-noise mask.
fn picture(kind: NoiseKind, frame: u32, seed: u32) -> Vec<[f64; 4]> {
    (0..RANKS).map(|i| thresholds(kind, [i % EDGE, i / EDGE], frame, seed, 3)).collect()
}

fn column(samples: &[[f64; 4]], i: usize) -> Vec<f64> {
    samples.iter().map(|s| s[i]).collect()
}

fn pairs(samples: &[[f64; 4]], i: usize, j: usize) -> Vec<(f64, f64)> {
    samples.iter().map(|s| (s[i], s[j])).collect()
}

/// The kinds of noise whose thresholds depend on each other from pixel to pixel.
const ARRANGED: [NoiseKind; 3] = [NoiseKind::InterleavedGradient, NoiseKind::Blue, NoiseKind::SpatioTemporalBlue];

#[test]
fn a_picture_covers_alpha_as_evenly_as_its_kind_promises() {
    let covered = |samples: &[[f64; 4]], alpha: f64| samples.iter().filter(|s| s[2] < alpha).count() as u64;
    for kind in NoiseKind::ALL {
        // Coverage is the share of pixels with a threshold below alpha. If pixels are independent, its standard deviation is sqrt(alpha (1 - alpha) /
        // pixels), and 64 pictures measure it with a relative error of about 1/11. A blue-noise mask contains each rank once, and the random jitter
        // moves a threshold only within the range of its rank. So the coverage may be off by one pixel: that of the rank whose range includes alpha.
        // Interleaved gradient noise is nearly as even.
        let pictures: Vec<_> = (0..64).map(|i| picture(kind, i, i)).collect();
        for alpha in [0.1, 0.5, 0.9] {
            let errors: Vec<f64> = pictures.iter().map(|p| covered(p, alpha) as f64 / f64::from(RANKS) - alpha).collect();
            let deviation = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
            let share = deviation / (alpha * (1.0 - alpha) / f64::from(RANKS)).sqrt();
            println!("{kind}, alpha {alpha}: {share:.3} times the deviation of independent pixels");
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
    // The family has 3 kinds x 6 pairs of decisions x 2 tests. `noise_stability` tests the kinds whose pixels are independent.
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
    // There are two negative controls. In the first, all decisions use the rank of the first decision. In the second, two decisions use interleaved
    // gradient noise at different shifts. They lack the reflections and exchanges of x and y that make the decisions of `noise::interleaved_gradient`
    // independent.
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
    // The family has (3 kinds and a control) x 2 directions = 8 tests.
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
        // The slices of the spatio-temporal mask repeat after 16 frames. From frame 0 to frame 16, only the jitter within a rank changes.
        for frame in [1, 15, 16, 1_000_000, u32::MAX] {
            assert_eq!(changed(frame), if kind.is_per_frame() { 1000 } else { 0 }, "{kind}, frame {frame}");
        }
        // Kinds of noise that are bound to the ground do not depend on the pixel. The other kinds do not depend on the ground.
        let at = |pixel, point: [u32; 2]| noise::thresholds(kind, &ground(point), WORLD_LEVEL, pixel, 2, 8, 3);
        let bound = matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic | NoiseKind::WhiteWorld);
        assert_eq!(at([5, 6], [9, 9]) == at([6, 6], [9, 9]), bound, "{kind}");
        assert_eq!(at([5, 6], [9, 9]) == at([5, 6], [10, 9]), !bound, "{kind}");
    }
}

/// Evaluates `of` at all pixels of a square of the size of a blue-noise mask, in [`SLICES`] frames. Returns one list of values for each frame.
fn sequence(of: &dyn Fn([u32; 2], u32) -> f64) -> Vec<Vec<f64>> {
    (0..SLICES).map(|frame| (0..RANKS).map(|i| of([i % EDGE, i / EDGE], frame)).collect()).collect()
}

/// Correlation of the value of a pixel with its value one frame later, computed from all pixels and frames. The first frame counts as the successor
/// of the last one.
fn lag_one(frames: &[Vec<f64>]) -> f64 {
    let next = frames.iter().cycle().skip(1);
    let products = frames.iter().zip(next).flat_map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - 0.5) * (b - 0.5)));
    12.0 * products.sum::<f64>() / f64::from(SLICES * RANKS)
}

/// Variance of the mean of a pixel over `window` successive frames, divided by the variance that this mean has in white noise.
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
    // White noise has no correlation. Null hypothesis: frames are independent. Under this hypothesis, the correlation of n pairs of values one frame
    // apart is normally distributed with a standard deviation of 1/sqrt(n). A bound of 4.9 standard deviations is a level of 1e-6.
    let white = of(NoiseKind::WhiteScreen);
    assert!(lag_one(&white).abs() < chance, "white: {}", lag_one(&white));
    assert!((windowed_variance(&white, 4) - 1.0).abs() < 0.1);
    // In spatio-temporal blue noise, a pixel avoids the values that it had in the frames just before. So the mean of a few frames is nearer to one
    // half than the mean of independent frames.
    let blue = of(NoiseKind::SpatioTemporalBlue);
    println!("stbn: lag one {}, windows {:?}", lag_one(&blue), [2, 4, 8].map(|w| windowed_variance(&blue, w)));
    assert!(lag_one(&blue) < -0.2, "stbn: {}", lag_one(&blue));
    assert!(windowed_variance(&blue, 4) < 0.4 && windowed_variance(&blue, 8) < 0.15);
    // In interleaved gradient noise, a value increases by about 0.6 (modulo 1) per frame. So frames are not independent, and the mean over frames
    // converges faster than for independent frames.
    let gradient = of(NoiseKind::InterleavedGradient);
    println!("ign: lag one {}, windows {:?}", lag_one(&gradient), [2, 4, 8].map(|w| windowed_variance(&gradient, w)));
    assert!(lag_one(&gradient) < -0.2 && windowed_variance(&gradient, 8) < 0.5);
    // Three negative controls: the same blue mask in every frame; a blue mask with a different shift in every frame; the slices of the
    // spatio-temporal mask in a different order.
    let repeated = of(NoiseKind::Blue);
    assert!(lag_one(&repeated) > 0.99 && windowed_variance(&repeated, 4) > 3.9);
    let reseeded = sequence(&|pixel, frame| thresholds(NoiseKind::Blue, pixel, 0, frame, 3)[0]);
    assert!(lag_one(&reseeded) > -0.05 && windowed_variance(&reseeded, 4) > 0.8, "reseeded: {}", lag_one(&reseeded));
    let disordered = sequence(&|pixel, frame| thresholds(NoiseKind::SpatioTemporalBlue, pixel, frame * 7, 8, 3)[0]);
    assert!(lag_one(&disordered) > -0.2, "disordered: {}", lag_one(&disordered));
}

// ---------------------------------------------------------------- space

/// Power spectrum of a picture as large as a mask, averaged over directions. Entry i is the mean power at i + 1 cycles per side of the picture. The
/// power is divided by the variance of the picture, so white noise has a power of 1.
fn radial_power(values: &[f64]) -> Vec<f64> {
    let n = EDGE as usize;
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
    let turns: Vec<(f64, f64)> = (0..n).map(|k| (std::f64::consts::TAU * k as f64 / n as f64).sin_cos()).collect();
    // Computes the Fourier transform of the rows, then of the columns. Each value is a sum of 64 terms.
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

/// Mean power at frequencies up to an eighth of a cycle per pixel.
fn low_power(values: &[f64]) -> f64 {
    radial_power(values)[..8].iter().sum::<f64>() / 8.0
}

#[test]
fn blue_noise_has_no_low_frequencies() {
    let first = |kind, frame, seed| column(&picture(kind, frame, seed), 0);
    let white = low_power(&first(NoiseKind::WhiteScreen, 0, 8));
    assert!((0.8..1.25).contains(&white), "white: {white}");
    // Checks the spectrum of the thresholds, and the spectrum of pictures that are 1 where the threshold is below alpha, and 0 elsewhere. A seed only
    // shifts a mask, which does not change its spectrum.
    let chosen = |u: &[f64], alpha: f64| low_power(&u.iter().map(|&u| f64::from(u8::from(u < alpha))).collect::<Vec<_>>());
    let pictures = [(NoiseKind::Blue, 0, 8), (NoiseKind::Blue, 3, 77)].into_iter();
    let slices = (0..SLICES).map(|frame| (NoiseKind::SpatioTemporalBlue, frame, 8 + frame));
    for (kind, frame, seed) in pictures.chain(slices) {
        let u = first(kind, frame, seed);
        let power = low_power(&u);
        let at = [0.1, 0.5, 0.9].map(|alpha| chosen(&u, alpha));
        println!("{kind} {frame}: {power:.4} {at:.4?}; {:.3?}", radial_power(&u));
        // The bounds are about four times the measured power. A slice of the spatio-temporal mask has a higher power at low frequencies than the blue
        // mask, because it is also optimised over time. A picture of zeros and ones has a higher power than the thresholds, because it has only two
        // values.
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
    assert!(low_power(&scattered) > 0.5, "a different seed for each pixel: {}", low_power(&scattered));
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
    // Negative control: a window that starts one row too late covers parts of two masks, so it does not contain each rank once.
    assert!(!whole(&ranks[EDGE as usize..][..RANKS as usize]));
    // The masks must be the same on every machine and in every run. The checksum is computed as in FNV-1a, but from whole ranks instead of bytes.
    let checksum = ranks.iter().fold(0x811c_9dc5_u32, |sum, &rank| (sum ^ rank).wrapping_mul(0x0100_0193));
    assert_eq!(checksum, 978_342_109, "the masks have changed");
}

#[test]
fn each_decision_reads_each_entry_of_its_mask_once() {
    // Each decision shifts the mask or slice by a hashed offset. Whatever the offset, the pixels of an area as large as a mask must together read
    // each entry of the mask or slice exactly once.
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
    // `published` is the formula of Jimenez in f64. The tested function uses integers: it rounds the coefficients of x, y and the frame to multiples
    // of 2^-32, so each is off by at most half of 2^-32. The argument of the inner `fract` is then off by at most (x + y + frame) / 2 times 2^-32,
    // where x + y + frame is below 4000. The outer factor multiplies this error by 53.
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
    // The function has a step of 0.98 wherever the inner value passes a whole number. Rounding may put the two versions on different sides of this
    // step, so two samples may differ.
    assert!(far(&errors(&|pixel, frame| unit(noise::interleaved_gradient_value(pixel, frame)))) <= 2);
    assert!(far(&errors(&|[x, y], frame| unit(noise::interleaved_gradient_value([y, x], frame)))) > 9000, "the mutant passed");
    assert!(far(&errors(&|pixel, frame| unit(noise::interleaved_gradient_value(pixel, frame + 1)))) > 9000, "the mutant passed");
    // The purpose of this noise is that the nine values of a 3 x 3 neighbourhood are spread evenly over [0, 1). The nine gaps between the sorted
    // values have a mean of 1/9. The test measures the smallest gap, which is about 1/81 on average in white noise.
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
    // The published function is not uniform, so `rotated` adds a hashed offset modulo 1. Null hypothesis: `rotated` is uniform, that is, the share of
    // values from 0.983 on is 0.017. The level of this single test is 0.1 %.
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
    // The level is clamped to the range from `LEVEL_MIN` to the finest scale at the point, and cells do not depend on the footprint.
    assert_eq!(noise::white_world(&ground([3, 4]), i32::MAX, 8, 3), noise::white_world(&ground([3, 4]), noise::LEVEL_MAX, 8, 3));
    assert_eq!(noise::white_world(&ground([3, 4]), i32::MIN, 8, 3), noise::white_world(&ground([3, 4]), noise::LEVEL_MIN, 8, 3));
    let closer = HashedPoint { ddx: [1e-3; 3], hash_scale: 4.0, ..ground([3, 4]) };
    assert_eq!(noise::white_world(&closer, 4, 8, 3), noise::white_world(&ground([3, 4]), 4, 8, 3));
    // Negative control: hashed noise does depend on the footprint.
    assert_ne!(noise::hashed_isotropic(&closer, 8, 3), noise::hashed_isotropic(&ground([3, 4]), 8, 3));
}

// ---------------------------------------------------------------- rounding

/// The kinds of noise that are bound to the ground.
const GROUND: [NoiseKind; 3] = [NoiseKind::HashedIsotropic, NoiseKind::HashedAnisotropic, NoiseKind::WhiteWorld];
/// Sizes of a pixel on the ground, metres.
const FOOTPRINTS_M: [f32; 4] = [1e-4, 3e-3, 0.05, 2.0];

/// Returns `x`, moved by a number of steps of f32: each step leads to the next larger number, or to the next smaller one if `steps` is negative.
fn stepped(x: f32, steps: i32) -> f32 {
    (0..steps.unsigned_abs()).fold(x, |x, _| if steps < 0 { x.next_down() } else { x.next_up() })
}

/// Returns a point, in f32, of a surface that is perpendicular to an axis: the position does not change along this axis from pixel to pixel.
fn across(axis: usize, position: [f32; 3], sector_m: f32, footprint: f32) -> HashedPoint<f32> {
    let (mut ddx, mut ddy) = ([0.0; 3], [0.0; 3]);
    ddx[(axis + 1) % 3] = footprint;
    ddy[(axis + 2) % 3] = 2.0 * footprint;
    HashedPoint { sector: [7, -9], position, sector_m, ddx, ddy, hash_scale: 1.0 }
}

#[test]
fn a_step_of_a_coordinate_redraws_few_thresholds() {
    const POINTS: u32 = 4000;
    // Returns the share of points whose first threshold changes if a coordinate in `range` is moved by `steps` steps of f32: up for half of the
    // points, down for the other half.
    let redrawn = |kind: NoiseKind, level: i32, axis: usize, range: [f64; 2], sector_m: f32, footprint: f32, steps: i32| {
        let mut random = Random(range[0].to_bits() ^ u64::from(footprint.to_bits()) << 7);
        let moves = |i: u32| {
            let mut position = [0, 1, 2].map(|_: i32| random.between(0.0, f64::from(sector_m)) as f32);
            position[axis] = random.between(range[0], range[1]) as f32;
            let at = |position| noise::thresholds(kind, &across(axis, position, sector_m, footprint), level, [0; 2], 0, 8, 3)[0];
            let here = at(position);
            position[axis] = stepped(position[axis], if i.is_multiple_of(2) { steps } else { -steps });
            at(position) != here
        };
        f64::from((0..POINTS).map(moves).map(u32::from).sum::<u32>()) / f64::from(POINTS)
    };
    // Largest expected share. A cell is at least 16 steps of f32 wide, so one step crosses a border of the finer of the two blended scales with a
    // probability of at most 1/16, and a border of the coarser one with at most 1/32. The standard error of the share is at most 0.5 %, and 0.025 is
    // five times as much.
    let most = 3.0 / 32.0 + 0.025;
    let mut checked = 0;
    for kind in GROUND {
        let levels: &[i32] = if kind == NoiseKind::WhiteWorld { &[WORLD_LEVEL, noise::LEVEL_MAX] } else { &[WORLD_LEVEL] };
        for &level in levels {
            for footprint in FOOTPRINTS_M {
                // Elevations from 0.3 m, where a step of f32 is 2^-25 m long, to 8848 m, where it is 2^-10 m long.
                for z in [0.3, 3.7, 61.3, 700.0, 1234.5, 2999.0, 8848.0] {
                    let share = redrawn(kind, level, 2, [z, z + 1.0], 64.0, footprint, 1);
                    assert!(
                        share <= most,
                        "{kind}, level {level}: {share} redrawn by one step of the elevation {z} m, pixels of {footprint} m"
                    );
                    checked += 1;
                }
                // Horizontal positions. In the largest sectors, the steps of f32 are the longest.
                for (axis, sector_m) in [(0, 64.0_f32), (0, 16_384.0), (1, 16_384.0)] {
                    let range = [f64::from(sector_m) / 2.0, f64::from(sector_m)];
                    let share = redrawn(kind, level, axis, range, sector_m, footprint, 1);
                    assert!(share <= most, "{kind}, level {level}: {share} redrawn by one step of axis {axis} in a sector of {sector_m} m");
                    checked += 1;
                }
            }
        }
    }
    assert_eq!(checked, 4 * FOOTPRINTS_M.len() * 10);
    // Negative control: at this elevation, 64 steps are four times as long as a cell of the finest scale.
    assert!(redrawn(NoiseKind::HashedAnisotropic, WORLD_LEVEL, 2, [700.0, 701.0], 64.0, 1e-4, 64) > 0.9);
}

#[test]
fn level_ground_at_a_whole_elevation_lies_on_no_border() {
    for z in [0.25_f32, 1.0, 3.0, 64.0, 512.0, 512.5, 700.0, 1024.0, 1234.5, 2000.75, 4096.0, 8848.0, -400.0] {
        for kind in GROUND {
            for (i, footprint) in (0_u16..).zip(FOOTPRINTS_M.iter().cycle().take(200)) {
                let place = f32::from(i) * 0.317;
                let at =
                    |z: f32| noise::thresholds(kind, &across(2, [place, 64.0 - place, z], 64.0, *footprint), WORLD_LEVEL, [0; 2], 0, 8, 3);
                for steps in [-4, -1, 1, 4] {
                    assert_eq!(at(stepped(z, steps)), at(z), "{kind}, {steps} steps from {z} m, pixels of {footprint} m");
                }
            }
        }
    }
    // Negative control: an elevation at a third of a metre is a border of the cells that are 1 m high.
    let at = |z: f32| noise::white_world(&across(2, [1.0, 2.0, z], 64.0, 1.0), 0, 8, 3);
    assert_ne!(at(noise::BORDER as f32), at(stepped(noise::BORDER as f32, -1)));
}

/// Returns a point of level ground as a shader sees it: the position is computed in f32 from the eye, the pixel's ray and the depth. `to` is the
/// horizontal vector, metres, from the eye to the point; the eye is `height_m` above the point, whose elevation is `ground_m`.
fn seen(ground_m: f64, height_m: f64, to: [f64; 2]) -> HashedPoint<f32> {
    const NEAR_M: f32 = 0.1;
    // Angle between neighbouring pixels, as a tangent.
    const PITCH: f64 = 1e-3;
    const SECTOR_M: f32 = 64.0;
    // The camera looks horizontally in the direction of the point, so the distance along the view is the horizontal distance.
    let distance = to[0].hypot(to[1]);
    let ahead = to.map(|x| x / distance);
    let single = |v: [f64; 3]| v.map(|x| x as f32);
    let ray = single([ahead[0], ahead[1], -height_m / distance]);
    let t = view::distance(NEAR_M, (f64::from(NEAR_M) / distance) as f32);
    let eye = single([30.0, 30.0, ground_m + height_m]);
    let local: [f32; 3] = std::array::from_fn(|i| eye[i] + ray[i] * t);
    let sector = [local[0], local[1]].map(|x| (x / SECTOR_M).floor());
    let step = |by: [f64; 3]| derivatives::on_plane(ray, single(by), t, [0.0, 0.0, 1.0]);
    HashedPoint {
        sector: sector.map(|s| 100 + s as i32),
        position: [local[0] - sector[0] * SECTOR_M, local[1] - sector[1] * SECTOR_M, local[2]],
        sector_m: SECTOR_M,
        ddx: step([ahead[1] * PITCH, -ahead[0] * PITCH, 0.0]),
        ddy: step([0.0, 0.0, -PITCH]),
        hash_scale: 1.0,
    }
}

#[test]
fn an_eye_that_is_raised_by_a_centimetre_keeps_its_choices_on_level_ground() {
    const POINTS: u32 = 10_000;
    // Returns the share of ground points whose choice among four equally weighted texels differs between two frames.
    let flips = |kind: NoiseKind, ground_m: f64, height_m: f64, raised_m: f64, seeds: [u32; 2]| {
        let mut random = Random(ground_m.to_bits() ^ height_m.to_bits());
        let flipped = |_: u32| {
            let height_m = height_m * random.between(1.0, 1.1);
            let (distance, (sin, cos)) = (height_m * random.between(0.5, 4.5), random.between(0.0, std::f64::consts::TAU).sin_cos());
            let choice = |height_m: f64, seed: u32| {
                let point = seen(ground_m, height_m, [distance * sin, distance * cos]);
                select::of_4([0.25; 4], noise::thresholds(kind, &point, WORLD_LEVEL, [0; 2], 0, seed, 3)[0])
            };
            u32::from(choice(height_m, seeds[0]) != choice(height_m + raised_m, seeds[1]))
        };
        f64::from((0..POINTS).map(flipped).sum::<u32>()) / f64::from(POINTS)
    };
    for kind in GROUND {
        for ground_m in [0.0, 0.3, 61.3, 700.0, 700.123, 2000.0, 8848.1] {
            // The position of a point is computed from that of the eye. So from 500 m above, the elevation of a point has the rounding error of the
            // eye's elevation, even if the ground is near elevation 0.
            for height_m in [1.7, 30.0, 500.0] {
                let share = flips(kind, ground_m, height_m, 0.01, [8; 2]);
                // At a height of 1.7 m, 1 cm changes the size of footprints by 0.6 %. Its log2, which determines the cells of the hashed kinds, then
                // changes by less than 0.01. Most thresholds change by even less, so few choices flip.
                assert!(share < 0.03, "{kind}: {share} flips on ground at {ground_m} m, seen from {height_m} m above");
            }
        }
        // Negative controls: another seed, and an eye so much higher that all cells are larger.
        assert!(flips(kind, 700.0, 30.0, 0.01, [8, 9]) > 0.7, "{kind}");
        assert_eq!(flips(kind, 700.0, 30.0, 100.0, [8; 2]) > 0.5, kind != NoiseKind::WhiteWorld, "{kind}");
    }
}

//! Tests of the metrics: sequences whose metrics are known in closed form, comparisons of the GPU with the f64 reference, and extreme inputs.

use std::f64::consts::PI;

use kernels::gpu::Gpu;
use kernels::metrics::perceived;
use kernels::metrics::{BINS, BLOCK, FrameSums, LagSums, Meter, Residual, Seeds, Track, Viewing, areas, quantile, reference};
use kernels::motion::{LAGS, NO_LINK};
use kernels::probe::table::run;
use kernels::shared::hash;
use kernels::shared::moments::Moments;
use kernels::shared::motion;
use kernels::shared::signal::{self, Signal};
use kernels::temporal::{self, Resolve, SamplePattern};
use statrs::distribution::{ContinuousCDF, Normal};

use crate::fixtures::gpu;

const SIZE: [u32; 2] = [96, 64];
const PIXELS: usize = (SIZE[0] * SIZE[1]) as usize;

/// Returns a random number, uniform in (0, 1). `stream` selects one of many independent sets of numbers for the same pixels and frames.
fn uniform(pixel: usize, frame: u32, stream: u32) -> f64 {
    let h = hash::pcg4d([u32::try_from(pixel).expect("small"), frame, stream, 77])[0];
    (f64::from(h) + 0.5) / 4_294_967_296.0
}

fn gaussian(pixel: usize, frame: u32) -> f64 {
    Normal::new(0.0, 1.0).expect("a distribution").inverse_cdf(uniform(pixel, frame, 1))
}

fn grey(value: f64, choice: u32) -> [u32; 2] {
    signal::pack([value as f32; 3], 12, choice)
}

/// Returns the links and positions of a sequence without motion. The link of a pixel at a lag of n frames is the index of the pixel that showed the
/// same surface point n frames earlier. The position of a pixel is where its surface point was in the picture one frame earlier. Here, every pixel is
/// linked to itself.
fn still() -> (Vec<u32>, Vec<[f32; 2]>) {
    let width = SIZE[0] as usize;
    let links: Vec<u32> = (0..PIXELS as u32).collect();
    let positions = (0..PIXELS).map(|i| [(i % width) as f32, (i / width) as f32]).collect();
    (links.repeat(LAGS), positions)
}

fn meter(gpu: &Gpu, size: [u32; 2], resolves: &[Resolve]) -> Meter {
    let tracks: Vec<Track> = resolves.iter().map(|&resolve| Track { signal: Signal::Albedo, resolve }).collect();
    let layout = gpu.layout("frame", wgpu::ShaderStages::COMPUTE, &[kernels::gpu::bindings::Binding::Uniform]);
    Meter::new(gpu, &layout, size, &tracks, Some(VIEWING)).expect("the passes compile")
}

const VIEWING: Viewing = Viewing { frames_per_second: 60.0, pixels_per_degree: 67.0 };

/// Sizes that are not multiples of the size of a tile, a block or a workgroup. The first is wider than high, the second is higher than wide.
const RAGGED: [[u32; 2]; 2] = [[93, 61], [61, 93]];
const RAGGED_PIXELS: usize = 93 * 61;

/// Returns a random picture of a ragged size: colours of different brightness, some sky, and choices of which some are missing.
fn ragged(frame: u32) -> Vec<[u32; 2]> {
    (0..RAGGED_PIXELS)
        .map(|i| {
            if uniform(i, 0, 20) < 0.05 {
                return [0, 0];
            }
            // The brightness covers 12 octaves, so that differences fill many bins of the histogram, among them the lowest.
            let bright = (-12.0 * uniform(i / 3, 0, 21)).exp2();
            let colour = [22, 23, 24].map(|stream| (bright * (0.8 + 0.4 * uniform(i, frame, stream))) as f32);
            let choice = if uniform(i, frame, 25) < 0.2 { 0 } else { 1 + (uniform(i, frame, 26) * 12.0) as u32 };
            signal::pack(colour, (uniform(i, frame, 27) * 100.0) as u32, choice)
        })
        .collect()
}

/// Returns the picture of [`ragged`], but with some colours that are not finite.
fn ragged_and_invalid(frame: u32) -> Vec<[u32; 2]> {
    let broken = |i: usize| uniform(i, frame, 28) < 0.02;
    let pixel = |(i, s): (usize, [u32; 2])| {
        if broken(i) && signal::is_terrain(s) { signal::pack([0.5, f32::NAN, f32::INFINITY], 4, 1) } else { s }
    };
    ragged(frame).into_iter().enumerate().map(pixel).collect()
}

/// Returns random links for each lag: to a pixel at most two columns and rows away, or to none.
fn ragged_links(size: [u32; 2]) -> Vec<u32> {
    let [width, height] = size.map(i64::from);
    let link = |lag: u32, i: usize| {
        let off = |stream| (uniform(i, lag, stream) * 5.0) as i64 - 2;
        let (x, y) = (i as i64 % width + off(30), i as i64 / width + off(31));
        let outside = x < 0 || y < 0 || x >= width || y >= height;
        if outside || uniform(i, lag, 32) < 0.1 { NO_LINK } else { (y * width + x) as u32 }
    };
    (0..LAGS as u32).flat_map(|lag| (0..RAGGED_PIXELS).map(move |i| link(lag, i))).collect()
}

/// Measures one frame. `reference` is the picture of the reference sequence, if there is one.
fn take(gpu: &Gpu, meter: &mut Meter, picture: &[[u32; 2]], reference: Option<&[[u32; 2]]>) -> FrameSums {
    meter.write(gpu, 0, picture);
    if let Some(reference) = reference {
        meter.write_reference(gpu, Signal::Albedo, reference);
    }
    let mut encoder = gpu.encoder("metrics");
    meter.encode(gpu, &mut encoder, &mut kernels::gpu::Timer::new(gpu));
    gpu.submit_and_wait(encoder).expect("the device works");
    meter.read(gpu).expect("the device works").remove(0)
}

/// Returns the sums of each frame of a sequence without motion.
fn follow(frames: u32, picture: impl Fn(u32) -> Vec<[u32; 2]>) -> Vec<FrameSums> {
    let gpu = gpu();
    let mut meter = meter(gpu, SIZE, &[Resolve::Off]);
    let (links, positions) = still();
    meter.write_links(gpu, &links, &positions);
    (0..frames).map(|frame| take(gpu, &mut meter, &picture(frame), None)).collect()
}

#[test]
fn a_still_picture_with_fixed_noise_neither_flickers_nor_flips() {
    let picture = |_| (0..PIXELS).map(|i| grey(0.2 + 0.5 * uniform(i, 0, 2), 1 + (i % 12) as u32)).collect();
    for (frame, sums) in follow(7, picture).into_iter().enumerate() {
        assert_eq!((sums.terrain, sums.fetches), (PIXELS as u64, PIXELS as u64 * 12));
        for (lag, sums) in sums.lags.iter().enumerate() {
            let followed = if lag == 0 { PIXELS } else { PIXELS / 4 } as u64;
            assert_eq!(sums.terrain, followed);
            let expected = if lag < frame { followed } else { 0 };
            assert_eq!((sums.linked, sums.chosen, sums.flipped), (expected, expected, 0), "frame {frame}, lag {}", lag + 1);
            assert_eq!(sums.difference, 0.0);
        }
        assert_eq!(sums.rejected, 0);
        assert_eq!(sums.tested, if frame > 0 { PIXELS as u64 / 4 } else { 0 });
        assert_eq!(sums.histogram.iter().map(|&n| u64::from(n)).sum::<u64>(), sums.tested);
    }
}

#[test]
fn fresh_white_noise_differs_by_two_sigma_over_root_pi() {
    // Null hypothesis: the metrics have the following values in white noise of standard deviation s. For two independent normal numbers X and Y, |X -
    // Y| has mean 2 s / sqrt(pi) and variance 2 s² - 4 s² / pi. Its 95 % quantile is sqrt(2) s times the 97.5 % quantile of the standard normal
    // distribution. A pixel is rejected if its value in the previous frame lies outside the range of the nine current values in the 3 x 3 box around
    // it. So the previous value is the smallest or the largest of ten independent values, which has the probability 2/10. Two random choices among
    // four differ with probability 3/4. There are 4 lags x 2 + 2 = 10 tests, which share a significance level of 0.001 (Sidak).
    const S: f64 = 0.05;
    const FRAMES: u32 = 12;
    let level = 1.0 - (1.0 - 0.001f64).powf(1.0 / 10.0);
    let bound = Normal::new(0.0, 1.0).expect("a distribution").inverse_cdf(1.0 - level / 2.0);
    let choice = |i: usize, frame: u32| 1 + (uniform(i, frame, 3) * 4.0) as u32;
    let sums = follow(FRAMES, |f| (0..PIXELS).map(|i| grey(0.5 + S * gaussian(i, f), choice(i, f))).collect());
    for lag in 0..LAGS {
        // Differences of disjoint pairs of frames are independent. Differences of overlapping pairs are correlated, which at most doubles the
        // variance of the mean.
        let used: Vec<_> = sums.iter().skip(lag + 1).map(|s| s.lags[lag]).collect();
        let n: f64 = used.iter().map(|s| s.linked as f64).sum();
        let mean = used.iter().map(|s| s.difference).sum::<f64>() / n;
        let expected = 2.0 * S / PI.sqrt();
        let error = (2.0 * (2.0 * S * S - 4.0 * S * S / PI) / n).sqrt();
        assert!(((mean - expected) / error).abs() < bound, "lag {}: {mean}, expected {expected} +- {error}", lag + 1);
        // Negative control: the test rejects the mean difference of noise that is 10 % stronger.
        assert!(((mean - 1.1 * expected) / error).abs() > bound);
        let flips = used.iter().map(|s| s.flipped as f64).sum::<f64>() / n;
        let error = (2.0 * 0.75 * 0.25 / n).sqrt();
        assert!(((flips - 0.75) / error).abs() < bound, "lag {}: {flips} flip", lag + 1);
    }
    let mut histogram = [0u64; BINS];
    let (mut tested, mut rejected) = (0.0, 0.0);
    for sums in &sums {
        histogram.iter_mut().zip(&sums.histogram).for_each(|(to, &n)| *to += u64::from(n));
        tested += sums.tested as f64;
        rejected += sums.rejected as f64;
    }
    // At an edge of the picture, the box has six values, and in a corner four. There, the probabilities of rejection are 2/7 and 2/5 instead of 2/10.
    let [w, h] = SIZE.map(f64::from);
    let (edges, corners) = (2.0 * (w + h - 4.0), 4.0);
    let expected = (0.2 * (w * h - edges - corners) + 2.0 / 7.0 * edges + 0.4 * corners) / (w * h);
    let share = rejected / tested;
    // The boxes of neighbouring pixels overlap, so rejections are correlated. The test assumes nine times the variance of independent rejections.
    let error = (9.0 * 0.2 * 0.8 / tested).sqrt();
    assert!(((share - expected) / error).abs() < bound, "{share} rejected, expected {expected} +- {error}");
    let expected = S * 2f64.sqrt() * Normal::new(0.0, 1.0).expect("a distribution").inverse_cdf(0.975);
    let p95 = quantile(&histogram, 0.95).expect("not empty");
    // The tolerance of 1/16 octave is the width of a bin of the histogram. It also covers the random error.
    assert!((p95 / expected).log2().abs() < 1.0 / 16.0, "95 % point {p95}, expected {expected}");
    assert!(quantile(&[0; BINS], 0.95).is_none());
}

#[test]
fn differences_follow_the_links_and_stop_where_there_is_none() {
    // The picture moves by 3 pixels to the right in each frame. If the links follow the motion, nothing differs. If they link each pixel to itself,
    // the pictures differ.
    let gpu = gpu();
    let width = SIZE[0] as usize;
    let picture = |frame: usize| -> Vec<[u32; 2]> {
        (0..PIXELS).map(|i| grey(uniform((i / width) * 4096 + 2048 + i % width - 3 * frame, 0, 4), 1)).collect()
    };
    for (moved, differs) in [(true, false), (false, true)] {
        let mut meter = meter(gpu, SIZE, &[Resolve::Off]);
        let (links, positions) = still();
        let shifted = |(at, &own): (usize, &u32)| {
            let lag = at / PIXELS + 1;
            let x = own as usize % width;
            if x >= 3 * lag { own - 3 * lag as u32 } else { NO_LINK }
        };
        let links = if moved { links.iter().enumerate().map(shifted).collect() } else { links };
        meter.write_links(gpu, &links, &positions);
        let mut last = FrameSums::default();
        let pictures: Vec<_> = (0..6).map(picture).collect();
        for picture in &pictures {
            last = take(gpu, &mut meter, picture, None);
        }
        let of_lag = |lag: usize| reference::Earlier {
            picture: &pictures[4 - lag],
            reference: None,
            links: &links[lag * PIXELS..(lag + 1) * PIXELS],
        };
        let past: Vec<_> = (0..LAGS).map(of_lag).collect();
        let expected = reference::measure(SIZE, &pictures[5], None, &past, 5 % 4);
        for (lag, (found, expected)) in last.lags.iter().zip(&expected.lags).enumerate() {
            let missing = |x: usize| moved && x < 3 * (lag + 1);
            let followed = |at: &usize| lag == 0 || motion::in_quarter((at / width) as u32, 5 % 4);
            assert_eq!(found.terrain, (0..PIXELS).filter(followed).count() as u64);
            assert_eq!(found.linked, (0..PIXELS).filter(|at| followed(at) && !missing(at % width)).count() as u64);
            assert_eq!(found.terrain, expected.terrain);
            assert_eq!((found.linked, found.chosen, found.flipped), (expected.linked, expected.chosen, expected.flipped));
            // Each pixel adds a number of at most 1 to a sum in f32 that stays below 64, so the addition rounds by at most 2^-19. The number is the
            // difference of two luminances of at most 1. A luminance has four roundings (weight, product, two sums), the difference one more: 9
            // roundings of at most 2^-24. So a pixel contributes an error of at most 41 x 2^-24.
            let tolerance = PIXELS as f64 * 41.0 * 2f64.powi(-24);
            assert!((found.difference - expected.difference).abs() <= tolerance, "{found:?} {expected:?}");
            assert_eq!(found.difference > 0.0, differs, "lag {}", lag + 1);
        }
        assert_eq!((last.tested, last.rejected), (expected.tested, expected.rejected));
        assert_eq!(last.rejected > 0, differs);
    }
}

#[test]
fn sums_of_ragged_pictures_equal_their_reference() {
    let gpu = gpu();
    for size in RAGGED {
        let mut meter = meter(gpu, size, &[Resolve::Off]);
        let links = ragged_links(size);
        meter.write_links(gpu, &links, &vec![[0.0; 2]; RAGGED_PIXELS]);
        // The second sequence starts while the buffers contain the pictures of the first sequence, and must not use them. The third sequence has no
        // reference in its second frame, so residuals at lag 1 are measured again from its fourth frame on.
        for (frames, gap) in [(0..7u32, None), (7..10, None), (10..17, Some(1))] {
            let pictures: Vec<_> = frames.clone().map(ragged_and_invalid).collect();
            let references: Vec<_> = frames.map(|frame| ragged_and_invalid(frame + 1000)).collect();
            meter.restart();
            let mut remembered: Option<Vec<[f64; 2]>> = None;
            for index in 0..pictures.len() {
                let known = (gap != Some(index)).then_some(references[index].as_slice());
                let found = take(gpu, &mut meter, &pictures[index], known);
                let since = gap.filter(|gap| index >= *gap).map_or(0, |gap| gap + 1);
                compare(size, &found, &pictures[..=index], &references[..=index], since, &links);
                // In a frame without a reference, no error is known, so no remembered errors are returned.
                if known.is_none() {
                    assert!(meter.memory(gpu, 0).expect("the device works").is_empty(), "frame {index}");
                }
                remembered = known.map(|known| {
                    let expected =
                        reference::remember(&pictures[index], known, remembered.as_deref(), &links[..RAGGED_PIXELS], VIEWING.adaptation());
                    let memory = meter.memory(gpu, 0).expect("the device works");
                    for (at, (found, expected)) in memory.iter().zip(&expected).enumerate() {
                        assert_eq!(f64::from(found[1]), expected[1], "frame {index}, pixel {at}");
                        // A step of the exponential mean rounds a number below 2 about four times. The effect of earlier roundings decays.
                        let off = (f64::from(found[0]) - expected[0]).abs();
                        assert!(off <= 16.0 * 2f64.powi(-24), "frame {index}, pixel {at}: {found:?} and not {expected:?}");
                    }
                    // Negative control: a mean that does not follow the links of the surface differs.
                    if index > 2 {
                        let own: Vec<u32> = (0..RAGGED_PIXELS as u32).collect();
                        let still = reference::remember(&pictures[index], known, remembered.as_deref(), &own, VIEWING.adaptation());
                        assert!(still.iter().zip(&expected).filter(|(a, b)| (a[0] - b[0]).abs() > 1e-3).count() > RAGGED_PIXELS / 4);
                    }
                    expected
                });
            }
        }
    }
}

/// Compares `found`, the sums of the last of several pictures, with the sums that `reference::measure` computes for this picture. `references` are
/// the pictures of the reference sequence, which are known from frame `since` on.
fn compare(size: [u32; 2], found: &FrameSums, pictures: &[Vec<[u32; 2]>], references: &[Vec<[u32; 2]>], since: usize, links: &[u32]) {
    let index = pictures.len() - 1;
    let known = |frame: usize| (frame >= since).then_some(references[frame].as_slice());
    let of_lag = |lag: usize| reference::Earlier {
        picture: &pictures[index - lag - 1],
        reference: known(index - lag - 1),
        links: &links[lag * RAGGED_PIXELS..(lag + 1) * RAGGED_PIXELS],
    };
    let past: Vec<_> = (0..LAGS.min(index)).map(of_lag).collect();
    let expected = reference::measure(size, &pictures[index], known(index), &past, index as u32 % 4);
    assert_eq!((found.terrain, found.fetches, found.invalid), (expected.terrain, expected.fetches, expected.invalid), "frame {index}");
    assert!(expected.invalid > 50, "{expected:?}");
    assert_eq!((found.tested, found.rejected), (expected.tested, expected.rejected), "frame {index}");
    for (lag, (found, expected)) in found.lags.iter().zip(&expected.lags).enumerate() {
        let counts = |sums: &LagSums| [sums.linked, sums.chosen, sums.flipped, sums.residual.compared];
        assert_eq!(counts(found), counts(expected), "frame {index}, lag {}", lag + 1);
        assert!(found.terrain == expected.terrain || lag >= index, "frame {index}, lag {}: {found:?} {expected:?}", lag + 1);
        assert!(expected.chosen > 100 || lag >= index, "frame {index}, lag {}: {expected:?}", lag + 1);
        assert!((expected.residual.compared > 100) == (index > since + lag), "frame {index}, lag {}: {expected:?}", lag + 1);
        // Bound of the error of a sum. Each partial sum adds at most 64 numbers in f32, so it has a relative error of at most 64 roundings of 2^-24.
        // The 1e-6 covers the numbers themselves. They are below 2, and are differences of luminances with a few roundings.
        let tolerance = |sum: f64| 64.0 * 2f64.powi(-24) * sum + 1e-6;
        let sums = |sums: &LagSums| {
            let Residual { sum, square, change_square, reference_square, .. } = sums.residual;
            [sums.difference, sum, square, change_square, reference_square]
        };
        for (found, expected) in sums(found).into_iter().zip(sums(expected)) {
            assert!((found - expected).abs() <= tolerance(expected), "frame {index}, lag {}: {found} and not {expected}", lag + 1);
        }
        // `product` is the sum of the products of two changes, that of the picture and that of the reference. The products have both signs, so the
        // sum may be small. Its rounding error is relative to the sums of the squares of the changes.
        let (found, expected) = (found.residual, expected.residual);
        let scale = expected.change_square + expected.reference_square;
        assert!((found.product - expected.product).abs() <= tolerance(scale), "frame {index}, lag {}: {found:?} {expected:?}", lag + 1);
    }
    for (found, expected) in [(&found.histogram, &expected.histogram), (&found.residual_histogram, &expected.residual_histogram)] {
        // A difference that is close to a border between two bins may be counted in either.
        let (mut off, mut sum) = (0i64, 0);
        for (found, expected) in found.iter().zip(expected) {
            sum += i64::from(*found) - i64::from(*expected);
            off = off.max(sum.abs());
        }
        assert!(off <= 2 && sum == 0, "frame {index}: {found:?} {expected:?}");
    }
    let filled = |histogram: &[u32; BINS]| histogram.iter().filter(|n| **n > 0).count();
    assert!(
        index == 0 || filled(&expected.histogram) > 60 && expected.histogram[0] > 0 && expected.rejected * 10 > expected.tested,
        "frame {index}: {} bins",
        filled(&expected.histogram)
    );
    assert!(index <= since || filled(&expected.residual_histogram) > 60, "frame {index}");
}

/// Measures a tested sequence without motion against a reference sequence, at lag 1 (from each frame to the next). `test`, `truth`: luminances of the
/// two sequences, by pixel and frame. Returns the sums of the residual over all frames, and the excess difference: the mean difference between frames
/// of the tested sequence, minus that of the reference.
fn residuals(frames: u32, test: impl Fn(usize, u32) -> f64, truth: impl Fn(usize, u32) -> f64) -> (Residual, f64) {
    let gpu = gpu();
    let mut meter = meter(gpu, SIZE, &[Resolve::Off]);
    let (links, positions) = still();
    meter.write_links(gpu, &links, &positions);
    let picture = |of: &dyn Fn(usize, u32) -> f64, frame: u32| -> Vec<[u32; 2]> { (0..PIXELS).map(|i| grey(of(i, frame), 1)).collect() };
    let (mut all, mut difference) = (Residual::default(), 0.0);
    for frame in 0..frames {
        let sums = take(gpu, &mut meter, &picture(&test, frame), Some(&picture(&truth, frame)));
        all.add(&sums.lags[0].residual);
        difference += sums.lags[0].difference;
    }
    (
        all,
        difference / all.compared as f64
            - follow(frames, |f| picture(&truth, f)).iter().map(|s| s.lags[0].difference).sum::<f64>() / all.compared as f64,
    )
}

#[test]
fn residual_flicker_has_its_closed_forms_and_does_not_cancel() {
    // Q: standard deviation of fine detail in the reference. The detail is new white noise in each frame, like detail that is aliased. S: standard
    // deviation of white noise in the tested picture. A: height of a step.
    const Q: f64 = 0.05;
    const S: f64 = 0.03;
    const A: f64 = 0.125;
    const FRAMES: u32 = 9;
    let root = PI.sqrt();
    let noise = |i: usize, f: u32, stream: u32| Normal::new(0.0, 1.0).expect("a distribution").inverse_cdf(uniform(i, f, stream));
    let detail = |i: usize, f: u32| 0.5 + Q * noise(i, f, 50);
    let own = |i: usize, f: u32| noise(i, f, 51);
    let flat = |_: usize, _: u32| 0.5;
    type Luminance<'a> = &'a dyn Fn(usize, u32) -> f64;
    // Columns: name, luminance of the tested stream, luminance of the reference, and the expected excess difference, residual, added and lost change.
    let both = (Q * Q + S * S).sqrt();
    let cases: [(&str, Luminance<'_>, Luminance<'_>, [f64; 4]); 8] = [
        ("fresh white noise", &|i, f| 0.5 + S * own(i, f), &flat, [2.0 * S / root, 2.0 * S / root, 2f64.sqrt() * S, 0.0]),
        ("a constant offset", &|i, f| detail(i, f) + 0.125, &detail, [0.0, 0.0, 0.0, 0.0]),
        ("fixed noise", &|i, _| 0.5 + S * own(i, 0), &flat, [0.0; 4]),
        (
            "a step on half of the pixels, in every second frame",
            &|i, f| 0.5 + if i % 2 == 0 && f % 2 == 0 { A } else { 0.0 },
            &flat,
            [A / 2.0, A / 2.0, A / 2f64.sqrt(), 0.0],
        ),
        ("pure blur", &flat, &detail, [-2.0 * Q / root, 2.0 * Q / root, 0.0, 2f64.sqrt() * Q]),
        ("added noise", &|i, f| detail(i, f) + S * own(i, f), &detail, [2.0 * (both - Q) / root, 2.0 * S / root, 2f64.sqrt() * S, 0.0]),
        (
            "blur plus own noise",
            &|i, f| 0.5 + Q * own(i, f),
            &detail,
            [0.0, 2.0 * 2f64.sqrt() * Q / root, 2f64.sqrt() * Q, 2f64.sqrt() * Q],
        ),
        (
            "half blurred, half noisy",
            &|i, f| if i % 2 == 0 { 0.5 } else { detail(i, f) + 3f64.sqrt() * Q * own(i, f) },
            &detail,
            [
                0.0,
                (1.0 + 3f64.sqrt()) * Q / root,
                // Notation: dY and dR are the changes of the stream and of the reference, and g is `Residual::gain`. On one half of the pixels, dY is
                // 0. On the other half, dY is dR + n, where n has the variance 6 Q². So g = 1/2. The variance of dY - g dR is Q² / 2 on the first
                // half and Q² / 2 + 6 Q² on the second half: 3.5 Q² on average.
                3.5f64.sqrt() * Q,
                0.5 * 2f64.sqrt() * Q,
            ],
        ),
    ];
    // The tolerance is 5 standard errors of a mean of 2 Q, plus 2^-12, the largest rounding error of a luminance between 1/2 and 1 in f16. The
    // results are means over 8 x 6144 pixels. Consecutive differences share a frame, which at most doubles the variance of a mean. A difference or
    // square has a standard deviation of at most twice its mean. So a mean has a relative standard error of at most 2 sqrt(2 / 49 152) = 1.3 %.
    let tolerance = 5.0 * 0.013 * 2.0 * Q + 2f64.powi(-12);
    for (name, test, truth, [excess, mean, added, lost]) in cases {
        let (sums, old) = residuals(FRAMES, test, truth);
        let found = [old, sums.mean().expect("pixels"), sums.added().expect("pixels"), sums.lost().expect("pixels")];
        for (what, (found, expected)) in
            ["excess difference", "residual", "added", "lost"].iter().zip(found.into_iter().zip([excess, mean, added, lost]))
        {
            assert!((found - expected).abs() <= tolerance, "{name}, {what}: {found} and not {expected}");
        }
        assert!(sums.rms().expect("pixels") >= sums.mean().expect("pixels") - 1e-9, "{name}");
    }
    // The reference against itself has exactly no residual, nothing added and nothing lost.
    let (itself, _) = residuals(4, detail, detail);
    assert_eq!((itself.mean(), itself.added(), itself.lost()), (Some(0.0), Some(0.0), Some(0.0)));
    assert!(itself.reference_square > 0.0);
}

#[test]
fn an_error_that_moves_with_the_surface_has_no_residual() {
    // The picture moves by 3 pixels to the right in each frame. The error is fixed to the surface: it moves, too.
    let gpu = gpu();
    let width = SIZE[0] as usize;
    let surface = |i: usize, frame: usize| (i / width) * 4096 + 2048 + i % width - 3 * frame;
    let (links, positions) = still();
    let moved = |(at, &own): (usize, &u32)| {
        let lag = at / PIXELS + 1;
        if own as usize % width >= 3 * lag { own - 3 * lag as u32 } else { NO_LINK }
    };
    let moved: Vec<u32> = links.iter().enumerate().map(moved).collect();
    for (links, follows) in [(&moved, true), (&links, false)] {
        let mut meter = meter(gpu, SIZE, &[Resolve::Off]);
        meter.write_links(gpu, links, &positions);
        for frame in 0..6 {
            // Multiples of 2^-7 below 1 and their sums are exact in f16.
            let steps = |point: usize, stream: u32, count: f64| (uniform(point, 0, stream) * count).floor() / 128.0;
            let truth: Vec<_> = (0..PIXELS).map(|i| grey(steps(surface(i, frame), 60, 64.0), 1)).collect();
            let error = |i: usize| steps(surface(i, frame), 61, 32.0);
            let test: Vec<_> = (0..PIXELS).map(|i| grey(steps(surface(i, frame), 60, 64.0) + error(i), 1)).collect();
            let sums = take(gpu, &mut meter, &test, Some(&truth));
            for lag in 0..LAGS.min(frame) {
                let residual = sums.lags[lag].residual;
                // Luminance sums three products, each with a rounding of 2^-25.
                let still = residual.mean().expect("pixels") < 1e-6;
                assert_eq!(still, follows, "frame {frame}, lag {}: {residual:?}", lag + 1);
            }
        }
    }
}

#[test]
fn what_an_eye_remembers_has_its_closed_forms() {
    // The error that the eye remembers is an exponential mean, in which a new frame has the weight a (`adaptation`). The first frames count equally:
    // while 1/n > a, the mean of n frames is remembered. White noise that changes in each frame has the standard deviation S, which the mean reduces
    // by the factor sqrt(a / (2 - a)). Noise that is fixed to the surface is not reduced.
    const S: f64 = 0.05;
    const FRAMES: u32 = 40;
    let gpu = gpu();
    let (links, positions) = still();
    let truth: Vec<_> = (0..PIXELS).map(|_| grey(0.5, 1)).collect();
    let a = VIEWING.adaptation();
    for fresh in [true, false] {
        let mut meter = meter(gpu, SIZE, &[Resolve::Off]);
        meter.write_links(gpu, &links, &positions);
        for frame in 0..FRAMES {
            let picture: Vec<_> = (0..PIXELS).map(|i| grey(0.5 + S * gaussian(i, if fresh { frame } else { 0 }), 1)).collect();
            take(gpu, &mut meter, &picture, Some(&truth));
            let memory = meter.memory(gpu, 0).expect("the device works");
            let rms = (memory.iter().map(|[m, _]| f64::from(*m).powi(2)).sum::<f64>() / PIXELS as f64).sqrt();
            // Weight of each frame so far, the earliest first.
            let mut weights = vec![1.0];
            for n in 2..=frame + 1 {
                let share = a.max(1.0 / f64::from(n));
                weights.iter_mut().for_each(|w| *w *= 1.0 - share);
                weights.push(share);
            }
            let norm = if fresh { weights.iter().map(|w| w * w).sum::<f64>().sqrt() } else { 1.0 };
            // The root mean square of 6144 samples has a relative standard deviation of 1 / sqrt(2 x 6144) = 0.9 %. The tolerance is 5 times this
            // deviation.
            assert!((rms / (S * norm) - 1.0).abs() < 0.045, "frame {frame}: {rms} and not {}", S * norm);
            if frame + 1 == FRAMES && fresh {
                assert!((norm / (a / (2.0 - a)).sqrt() - 1.0).abs() < 0.01, "{norm}");
                // With 20 pixels per degree, the filter correlates 8 neighbours, so the root mean square has a relative standard deviation of 2.5 %.
                // Near a border, the filter averages fewer pixels.
                let noise = perceived::Filter::new(SIZE, 20.0).perceived_noise(&memory).expect("pixels");
                let expected = S * norm * perceived::norm(20.0);
                assert!((noise / expected - 1.0).abs() < 0.15, "{noise} and not {expected}");
            }
        }
    }
}

#[test]
fn the_box_test_accepts_a_difference_of_one_rounding() {
    // All current values of the box are 1, and the history is near 1. In f16, 1 + 2^-10 is the next number above 1, and 1 - 2^-10 is the second
    // number below 1. Both are exactly at the limit of the tolerance and must be accepted.
    let step = 2f64.powi(-10);
    for (history, is_rejected) in [(1.0 + step, false), (1.0 - step, false), (1.0 + 2.0 * step, true), (1.0 - 1.5 * step, true)] {
        let sums = follow(2, |frame| vec![grey(if frame == 0 { history } else { 1.0 }, 1); PIXELS]);
        assert_eq!((sums[1].tested, sums[1].rejected > 0), (PIXELS as u64 / 4, is_rejected), "{history}");
    }
}

#[test]
fn seeds_of_ragged_pictures_equal_their_reference() {
    let gpu = gpu();
    for size in RAGGED {
        let seeds = Seeds::new(gpu, size).expect("the passes compile");
        let streams = [seeds.stream(gpu)];
        let exact = ragged_and_invalid(0);
        gpu.queue.write_buffer(&streams[0].exact, 0, bytemuck::cast_slice(&exact));
        // The second sequence finds the moments of the first one in its buffers, and must not use them.
        for frames in [1..=2u32, 3..=7] {
            // A pixel that is invalid in one of the pictures has no moments.
            let pictures: Vec<_> = frames.map(ragged_and_invalid).collect();
            for (count, picture) in (1..).zip(&pictures) {
                gpu.queue.write_buffer(&streams[0].signal, 0, bytemuck::cast_slice(picture));
                let mut encoder = gpu.encoder("seeds");
                seeds.encode_add(gpu, &mut encoder, &streams, count);
                gpu.submit_and_wait(encoder).expect("the device works");
                let found = seeds.read(gpu, &streams).expect("the device works").remove(0);
                let expected = reference::seed(size, BLOCK, picture, &exact);
                assert_eq!((found.terrain, found.blocks), (expected.terrain, expected.blocks));
                assert!(expected.blocks > 10.0 && expected.terrain < RAGGED_PIXELS as f64, "{expected:?}");
                // `close` has the tolerances that `block_noise_is_caught_by_clumping` explains. Its last argument bounds the partial sums. For sums
                // of errors, the bound is 0.1 per channel of a pixel.
                let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 200.0 * 2f64.powi(-24) * scale;
                assert!(close(found.squared_error, expected.squared_error, expected.squared_error), "{found:?} {expected:?}");
                assert!(close(found.error, expected.error, 3.0 * RAGGED_PIXELS as f64 * 0.1), "{found:?} {expected:?}");
                assert!(close(found.block_squares, expected.block_squares, expected.pixel_squares), "{found:?} {expected:?}");
                assert!(close(found.pixel_squares, expected.pixel_squares, expected.pixel_squares), "{found:?} {expected:?}");
                // Each area adds up at most 256 pixels of three channels.
                assert_eq!(found.areas.len(), areas(size).iter().product::<u32>() as usize);
                for (area, expected) in found.areas.iter().zip(&expected.areas) {
                    assert_eq!(area.terrain, expected.terrain);
                    assert!(close(area.squared_error, expected.squared_error, expected.squared_error), "{area:?} {expected:?}");
                    assert!(close(area.error, expected.error, 3.0 * 256.0 * 0.1), "{area:?} {expected:?}");
                }
                assert_eq!(found.areas.iter().map(|area| area.terrain).sum::<f64>(), found.terrain);
            }
            let mut encoder = gpu.encoder("seeds");
            seeds.encode_finish(gpu, &mut encoder, &streams, pictures.len() as u32);
            gpu.submit_and_wait(encoder).expect("the device works");
            let found = seeds.read_finished(gpu, &streams).expect("the device works").remove(0);
            let expected = reference::finish(&pictures, &exact);
            assert_eq!(found.terrain, expected.terrain);
            let terrain = exact.iter().filter(|signal| signal::is_terrain(**signal)).count() as f64;
            assert!(found.terrain < 0.97 * terrain && found.terrain > 0.8 * terrain, "{found:?} of {terrain}");
            assert!((found.bias - expected.bias).abs() <= 1e-5 * RAGGED_PIXELS as f64 * 0.1, "{found:?} {expected:?}");
            assert!((found.variance / expected.variance - 1.0).abs() <= 1e-5, "{found:?} {expected:?}");
        }
    }
}

#[test]
fn block_noise_is_caught_by_clumping() {
    // Clumping is the mean square of the mean errors of blocks of 5 x 5 pixels, divided by its value for white noise. Null hypothesis: clumping is 1
    // for white noise, and 25 for noise that has one value per block. For n blocks of normal noise, the relative standard deviation of clumping is at
    // most sqrt(2 / n). The bound is 3.5 standard deviations, which is a level of 0.0005 per test.
    let gpu = gpu();
    let seeds = Seeds::new(gpu, SIZE).expect("the passes compile");
    let streams = [seeds.stream(gpu), seeds.stream(gpu)];
    let width = SIZE[0] as usize;
    let block = BLOCK as usize;
    let exact: Vec<[u32; 2]> = (0..PIXELS).map(|_| grey(0.5, 0)).collect();
    let cell = |i: usize| (i / width / block) * 1000 + i % width / block;
    let (mut clumping, mut squares, mut count) = ([0.0; 2], [0.0; 2], 0.0);
    const SEEDS: u32 = 16;
    for seed in 0..SEEDS {
        let pictures: [Vec<[u32; 2]>; 2] = [
            (0..PIXELS).map(|i| grey(0.5 + 0.05 * gaussian(i, seed), 1)).collect(),
            (0..PIXELS).map(|i| grey(0.5 + 0.05 * gaussian(cell(i), seed), 1)).collect(),
        ];
        for (stream, picture) in streams.iter().zip(&pictures) {
            gpu.queue.write_buffer(&stream.signal, 0, bytemuck::cast_slice(picture));
            gpu.queue.write_buffer(&stream.exact, 0, bytemuck::cast_slice(&exact));
        }
        let mut encoder = gpu.encoder("seeds");
        seeds.encode_add(gpu, &mut encoder, &streams, seed + 1);
        gpu.submit_and_wait(encoder).expect("the device works");
        for (k, (sums, picture)) in seeds.read(gpu, &streams).expect("the device works").iter().zip(&pictures).enumerate() {
            let expected = reference::seed(SIZE, BLOCK, picture, &exact);
            assert_eq!((sums.terrain, sums.blocks), (expected.terrain, expected.blocks));
            // Each tile adds about 200 numbers in f32. Each addition has a rounding error of at most 2^-24 of the largest partial sum, so the
            // tolerance is 200 x 2^-24 times `scale`, a bound of the partial sums.
            let close = |a: f64, b: f64, scale: f64| (a - b).abs() <= 200.0 * 2f64.powi(-24) * scale;
            assert!(close(sums.squared_error, expected.squared_error, expected.squared_error), "{sums:?} {expected:?}");
            assert!(close(sums.error, expected.error, 0.2 * 3.0 * PIXELS as f64), "{sums:?} {expected:?}");
            assert!(close(sums.block_squares, expected.block_squares, expected.pixel_squares), "{sums:?} {expected:?}");
            clumping[k] += sums.block_squares;
            squares[k] += sums.pixel_squares;
            count += expected.blocks / 2.0;
        }
    }
    let value: Vec<f64> = (0..2).map(|k| f64::from(BLOCK * BLOCK) * clumping[k] / squares[k]).collect();
    assert!((value[0] - 1.0).abs() < 3.5 * (2.0 / count).sqrt(), "white noise: {}", value[0]);
    // All pixels of a block are equal, so the value is exactly 25, except for rounding.
    assert!((value[1] - 25.0).abs() < 0.01, "block noise: {}", value[1]);

    let mut encoder = gpu.encoder("seeds");
    seeds.encode_finish(gpu, &mut encoder, &streams, SEEDS);
    gpu.submit_and_wait(encoder).expect("the device works");
    let finished = seeds.read_finished(gpu, &streams).expect("the device works");
    for sums in &finished {
        let n = sums.terrain * 3.0;
        assert_eq!(sums.terrain, PIXELS as f64);
        // The tolerances below count PIXELS / 25 independent numbers per seed. This is the number for block noise; white noise has PIXELS of them,
        // because only its three channels are equal.
        let variance = sums.variance / n;
        let error = 0.0025 * (2.0 / (f64::from(SEEDS - 1) * PIXELS as f64 / 25.0)).sqrt();
        assert!((variance - 0.0025).abs() < 3.5 * error, "variance {variance}");
        let error = 0.05 / (f64::from(SEEDS) * PIXELS as f64 / 25.0).sqrt();
        assert!((sums.bias / n).abs() < 3.5 * error, "bias {}", sums.bias / n);
    }
}

/// A shader function that adds samples to the moments of a sequence. The columns of a row are: the moments so far (4 numbers), mean, step, `start`,
/// `n` and a zero. `n` samples are added, from sample number `start` on. Each sample is mean + step * (h - 7.5), given as the sum of two numbers.
/// Here h, from 0 to 15, consists of the 4 highest bits of a hash of the sample number, which is the same on CPU and GPU.
const MOMENTS_BODY: &str = "fn probe(row: array<f32, 9>) -> array<f32, 4> {
    var state = vec4<f32>(row[0], row[1], row[2], row[3]);
    let start = u32(row[6]);
    for (var i = start; i < start + u32(row[7]); i++) {
        let sample = vec2<f32>(row[4], (f32(hash_pcg(i) >> 28u) - 7.5) * row[5]);
        // The last column is 0. The compiler does not know its value, so it cannot simplify the sums.
        state = moments_add(state, sample, f32(i + 1u), u32(row[8]));
    }
    return array<f32, 4>(state.x, state.y, state.z, state.w);
}";

/// Computes the moments of several sequences on the GPU. A row contains the mean and the step of a sequence, as in [`MOMENTS_BODY`], and the number
/// of its samples. Software Vulkan ends a loop in a shader after 65 535 iterations, so each call adds at most 50 000 samples.
fn moments_on_gpu(rows: &[[f32; 3]]) -> Vec<[f32; 4]> {
    let mut states = vec![[0.0f32; 4]; rows.len()];
    let mut start = 0.0f32;
    while rows.iter().any(|row| row[2] > start) {
        let flat: Vec<f32> = rows
            .iter()
            .zip(&states)
            .flat_map(|(&[mean, step, count], s)| {
                let n = (count - start).clamp(0.0, 50_000.0);
                [s[0], s[1], s[2], s[3], mean, step, start, n, 0.0]
            })
            .collect();
        let out = run(gpu(), MOMENTS_BODY, &flat, 9, 4).expect("the probe runs");
        states = out.chunks_exact(4).map(|s| std::array::from_fn(|k| s[k])).collect();
        start += 50_000.0;
    }
    states
}

#[test]
fn moments_hold_at_the_extremes() {
    // The most difficult sequence has a mean of 1e6, a variance of about 1e-6, and 1e6 numbers. The moments of each sequence are computed on the GPU,
    // and on the CPU in f32 and in f64.
    let rows = [
        [1e6f32, 2f32.powi(-12), 1e6],
        [0.0, 1.0, 1000.0],
        [1e6, 2f32.powi(-12), 2.0],
        [-3e4, 64.0, 1e5],
        [0.25, 0.0, 1e5],
        [7.0, 1.0, 1.0],
    ];
    for (row, state) in rows.iter().zip(moments_on_gpu(&rows)) {
        let [mean, step, count] = row.map(f64::from);
        let samples = || (0..count as u32).map(|i| f64::from(hash::pcg(i) >> 28) - 7.5);
        let exact_mean = mean + step * samples().sum::<f64>() / count;
        let squares: f64 = samples().map(|s| (mean + s * step - exact_mean).powi(2)).sum();
        let exact = if count > 1.0 { squares / (count - 1.0) } else { 0.0 };
        let mut single = Moments::<f32>::new();
        let mut double = Moments::<f64>::new();
        for s in samples() {
            single.add([row[0], (s * step) as f32]);
            double.add([mean, s * step]);
        }
        let found_mean = f64::from(state[0]) + f64::from(state[1]);
        let found = (f64::from(state[2]) + f64::from(state[3])) / (count - 1.0).max(1.0);
        for (what, m, v) in
            [("gpu", found_mean, found), ("f32", single.mean(), single.variance()), ("f64", double.mean(), double.variance())]
        {
            // The sums are compensated, so an error comes only from the rounding of delta / n and delta² in each step. The tolerance of the variance
            // is 4 * 2^-24 of the variance. The tolerance of the mean is 4 * 2^-24 of 7.5 steps, the largest deviation of a sample from the mean. The
            // two terms that contain the mean cover its rounding in f64.
            assert!(
                (m - exact_mean).abs() <= 4.0 * 2f64.powi(-24) * (7.5 * step + f64::EPSILON * mean.abs() * 16.0) + mean.abs() * 1e-14,
                "{what}: mean {m}, not {exact_mean}"
            );
            assert!((v - exact).abs() <= 4.0 * 2f64.powi(-24) * exact + 1e-300, "{what}: variance {v}, not {exact} ({row:?})");
        }
        // Negative control: in f32, plain sums of squares have no correct digit left.
        if mean == 1e6 && count > 2.0 {
            let (sum, square) = samples().fold((0f32, 0f32), |(a, b), s| {
                let x = row[0] + (s * step) as f32;
                (a + x, b + x * x)
            });
            let naive = f64::from(square / count as f32 - (sum / count as f32).powi(2));
            assert!((naive - exact).abs() > 100.0 * exact, "plain sums give {naive}");
        }
    }
}

#[test]
fn resolves_agree_with_their_reference() {
    // Links lead to a pixel nearby, or to none. Positions are up to 1.5 pixels away from the pixel along each axis, also outside the picture.
    let size = RAGGED[0];
    let width = size[0] as usize;
    let position = |i: usize| {
        let off = |stream| uniform(i, 0, stream) * 3.0 - 1.5;
        [(i % width) as f64 + off(40), (i / width) as f64 + off(41)].map(|v| v as f32)
    };
    let picture = |f: u32| -> Vec<[u32; 2]> {
        // The upper left corner of the picture is sky in all frames, and single pixels are sky in different frames. A fifth of the pixels has colours
        // without blue.
        let sky = |i: usize| (i % width) < 5 && (i / width) < 9 || uniform(i, f, 7) < 0.03;
        let blue = |i: usize| if uniform(i, 0, 8) < 0.2 { 0.0 } else { 0.5 };
        let colour = |i: usize| [0.1 + uniform(i, f, 5), uniform(i, f, 6), blue(i)].map(|v| v as f32);
        let invalid = |i: usize| uniform(i, f, 9) < 0.01;
        let pixel = |i: usize| if invalid(i) { signal::INVALID } else { signal::pack(colour(i), 3, 2) };
        (0..RAGGED_PIXELS).map(|i| if sky(i) { [0, 0] } else { pixel(i) }).collect()
    };
    let pictures: Vec<_> = (0..5).map(picture).collect();
    let positions: Vec<_> = (0..RAGGED_PIXELS).map(position).collect();
    let histories = resolved(size, &ragged_links(size), &positions, &pictures);
    // The purpose of a resolve is to reduce noise. So each resolve except `off` must reduce the variation of white noise.
    let spread = |h: &[[f64; 4]]| h.iter().filter(|p| p[3] > 0.0).map(|p| (p[1] - 0.5).powi(2)).sum::<f64>();
    let spreads: Vec<f64> = histories.iter().map(|h| spread(h)).collect();
    assert!(spreads[1..].iter().all(|&s| s < 0.75 * spreads[0]), "{spreads:?}");
}

#[test]
fn a_history_needs_a_thousandth_of_a_pixel() {
    // In the first frame, only every fourth pixel shows terrain. In the second frame, all pixels do. Each position lies between a sky pixel and a
    // terrain pixel of the first frame. The weight of the history is then the distance from the sky pixel, in pixels.
    let size = [64, 4];
    let pixels: usize = 64 * 4;
    let shares = [0.0, 3e-4, 7e-4, 9e-4, 1.1e-3, 1.2e-3, 1.4e-3, 0.5];
    let positions: Vec<_> = (0..pixels).map(|i| [(i % 64 / 4 * 4) as f32 + 3.0 + shares[i % 8], (i / 64) as f32]).collect();
    let links: Vec<u32> = (0..pixels as u32).collect();
    let picture = |frame: usize| -> Vec<[u32; 2]> {
        (0..pixels).map(|i| if frame == 0 && i % 4 != 0 { [0, 0] } else { grey(0.2 + 0.6 * uniform(i, frame as u32, 9), 2) }).collect()
    };
    resolved(size, &links.repeat(LAGS), &positions, &[picture(0), picture(1)]);
}

/// Resolves a sequence of pictures with each resolve, and compares the results with their reference. Returns the history of each resolve.
fn resolved(size: [u32; 2], links: &[u32], positions: &[[f32; 2]], pictures: &[Vec<[u32; 2]>]) -> Vec<Vec<[f64; 4]>> {
    let gpu = gpu();
    let resolves = Resolve::ALL;
    let pixels = positions.len();
    let mut meter = meter(gpu, size, &resolves);
    meter.write_links(gpu, links, positions);
    let mut histories = vec![vec![[0.0; 4]; pixels]; resolves.len()];
    let sky = vec![[0, 0]; pixels];
    let mut before = &sky;
    for (frame, now) in (0..).zip(pictures) {
        (0..resolves.len()).for_each(|stream| meter.write(gpu, stream, now));
        let mut encoder = gpu.encoder("metrics");
        meter.encode(gpu, &mut encoder, &mut kernels::gpu::Timer::new(gpu));
        gpu.submit_and_wait(encoder).expect("the device works");
        meter.read(gpu).expect("the device works");
        for (stream, resolve) in resolves.into_iter().enumerate() {
            let inputs = temporal::reference::Frame { now, before, links: &links[..pixels], positions, history: &histories[stream] };
            let expected = temporal::reference::resolve(resolve, size, frame, &inputs);
            let found = meter.picture(gpu, stream, 0).expect("the device works");
            for (i, (found, expected)) in found.iter().zip(&expected).enumerate() {
                assert_eq!(signal::is_terrain(*found), expected[3] > 0.0);
                if !signal::is_terrain(*found) {
                    // Sky and invalid pixels stay what they are.
                    assert_eq!(*found, now[i]);
                    continue;
                }
                let kept = (signal::choice(*found), signal::fetches(*found));
                assert_eq!(kept, (signal::choice(now[i]), signal::fetches(now[i])), "choice and fetches must be kept");
                for (k, c) in signal::colour(*found).into_iter().enumerate() {
                    // The tolerance covers one rounding to f16, and the rounding of about a dozen operations in f32.
                    let tolerance = expected[k].abs() * (2f64.powi(-11) + 16.0 * 2f64.powi(-24)) + 1e-7;
                    assert!(
                        (f64::from(c) - expected[k]).abs() <= tolerance,
                        "{resolve}, frame {frame}, pixel {i}: {c}, not {}",
                        expected[k]
                    );
                }
            }
            histories[stream] = expected;
        }
        before = now;
    }
    histories
}

#[test]
fn flipquad_has_four_rows_and_four_columns_shared_with_the_neighbours() {
    // FlipQuad averages four samples for each pixel, from two frames: the sample on the left edge of the pixel, that on the left edge of the right
    // neighbour, that on the top edge of the pixel, and that on the top edge of the lower neighbour.
    let at = |pattern: SamplePattern, pixel: [u32; 2], origin: [u32; 2]| -> [f64; 2] {
        let offset = pattern.offset(pixel);
        std::array::from_fn(|k| f64::from(pixel[k]) - f64::from(origin[k]) + offset[k])
    };
    for pixel in [[4u32, 6u32], [5, 6], [4, 7], [5, 7]] {
        let [x, y] = pixel;
        let samples = [
            at(SamplePattern::LeftEdges, pixel, pixel),
            at(SamplePattern::LeftEdges, [x + 1, y], pixel),
            at(SamplePattern::TopEdges, pixel, pixel),
            at(SamplePattern::TopEdges, [x, y + 1], pixel),
        ];
        for k in 0..2 {
            let mut coordinates: Vec<f64> = samples.iter().map(|s| s[k]).collect();
            coordinates.sort_by(f64::total_cmp);
            for (found, expected) in coordinates.iter().zip([-0.5, -1.0 / 6.0, 1.0 / 6.0, 0.5]) {
                assert!((found - expected).abs() < 1e-12, "pixel {pixel:?}: {samples:?}");
            }
        }
    }
}

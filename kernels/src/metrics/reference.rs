//! The sums of one frame in f64: the reference for `measure.wgsl` and `seeds.wgsl`.

use super::{BINS, BINS_PER_OCTAVE, FrameSums, LOWEST_OCTAVE, SeedSums, VarianceSums};
use crate::motion::{LAGS, NO_LINK};
use crate::shared::{motion, signal};

/// Returns the sums of a frame, for pictures of `size` pixels. `past` has one entry per lag, from lag 1 on: the earlier picture, and the links from
/// `now` to it. Lags 2 to 4, the box tests and the histogram include only the pixels of `quarter`.
pub fn measure(size: [u32; 2], now: &[[u32; 2]], past: &[(&[[u32; 2]], &[u32])], quarter: u32) -> FrameSums {
    let mut sums = FrameSums::default();
    let [width, height] = size.map(|n| n as usize);
    for (at, &signal_now) in now.iter().enumerate().filter(|(_, s)| signal::is_terrain(**s)) {
        sums.terrain += 1;
        sums.fetches += u64::from(signal::fetches(signal_now));
        let (x, y) = (at % width, at / width);
        let in_quarter = motion::in_quarter([x as u32, y as u32], quarter);
        for (lag, (picture, links)) in past.iter().enumerate().take(LAGS) {
            if lag > 0 && !in_quarter {
                continue;
            }
            sums.lags[lag].terrain += 1;
            let link = links[at];
            if link == NO_LINK || !signal::is_terrain(picture[link as usize]) {
                continue;
            }
            let before = picture[link as usize];
            let (colour_now, colour_before) = (signal::colour(signal_now), signal::colour(before));
            let lag_sums = &mut sums.lags[lag];
            lag_sums.linked += 1;
            lag_sums.difference += (signal::luminance(colour_now) - signal::luminance(colour_before)).abs();
            let (choice_now, choice_before) = (signal::choice(signal_now), signal::choice(before));
            if choice_now != 0 && choice_before != 0 {
                lag_sums.chosen += 1;
                lag_sums.flipped += u64::from(choice_now != choice_before);
            }
            if lag == 0 && in_quarter {
                sums.tested += 1;
                let difference = (signal::luminance(colour_now) - signal::luminance(colour_before)).abs();
                let bin = ((difference.log2() - LOWEST_OCTAVE) * BINS_PER_OCTAVE).floor().clamp(0.0, BINS as f64 - 1.0);
                sums.histogram[bin as usize] += 1;
                let mut low = [f32::MAX; 3];
                let mut high = [f32::MIN; 3];
                for ny in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                    for nx in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                        let neighbour = now[ny * width + nx];
                        if signal::is_terrain(neighbour) {
                            let c = signal::colour(neighbour);
                            low = std::array::from_fn(|k| low[k].min(c[k]));
                            high = std::array::from_fn(|k| high[k].max(c[k]));
                        }
                    }
                }
                let slack = 1.0 / 1024.0;
                let outside = (0..3).any(|k| colour_before[k] < low[k] * (1.0 - slack) || colour_before[k] > high[k] * (1.0 + slack));
                sums.rejected += u64::from(outside);
            }
        }
    }
    sums
}

/// Compares the picture of one seed with the exact blend. Returns the sums that `seeds_add` and `seeds_blocks` compute.
pub fn seed(size: [u32; 2], block: u32, picture: &[[u32; 2]], exact: &[[u32; 2]]) -> SeedSums {
    let mut sums = SeedSums::default();
    let [width, height] = size.map(|n| n as usize);
    let block = block as usize;
    for (&now, &exact) in picture.iter().zip(exact).filter(|(now, _)| signal::is_terrain(**now)) {
        let (a, b) = (signal::colour(now), signal::colour(exact));
        for k in 0..3 {
            let d = f64::from(a[k]) - f64::from(b[k]);
            sums.error += d;
            sums.squared_error += d * d;
        }
        sums.terrain += 1.0;
    }
    for by in 0..height / block {
        for bx in 0..width / block {
            let inside = (0..block * block).map(|i| (by * block + i / block) * width + bx * block + i % block);
            let pixels: Vec<usize> = inside.collect();
            if !pixels.iter().all(|&at| signal::is_terrain(picture[at])) {
                continue;
            }
            let error = |at: usize| signal::luminance(signal::colour(picture[at])) - signal::luminance(signal::colour(exact[at]));
            let n = pixels.len() as f64;
            let mean = pixels.iter().map(|&at| error(at)).sum::<f64>() / n;
            sums.blocks += 1.0;
            sums.block_squares += mean * mean;
            sums.pixel_squares += pixels.iter().map(|&at| error(at).powi(2)).sum::<f64>() / n;
        }
    }
    sums
}

/// Returns the sums that `seeds_finish` computes from the pictures of several seeds: the bias of their mean, and their variance over the seeds.
pub fn finish(pictures: &[Vec<[u32; 2]>], exact: &[[u32; 2]]) -> VarianceSums {
    let mut sums = VarianceSums::default();
    let n = pictures.len() as f64;
    for (at, &exact) in exact.iter().enumerate().filter(|(_, exact)| signal::is_terrain(**exact)) {
        sums.terrain += 1.0;
        for k in 0..3 {
            let values = || pictures.iter().map(|picture| f64::from(signal::colour(picture[at])[k]));
            let mean = values().sum::<f64>() / n;
            sums.bias += mean - f64::from(signal::colour(exact)[k]);
            sums.variance += values().map(|value| (value - mean).powi(2)).sum::<f64>() / (n - 1.0);
        }
    }
    sums
}

//! The sums of a frame, the remembered errors, and the sums over seeds, in f64: the reference for `measure.wgsl` and `seeds.wgsl`.

use super::{AREA, AreaSums, BINS, BINS_PER_OCTAVE, FrameSums, LOWEST_OCTAVE, Residual, SeedSums, VarianceSums, areas};
use crate::motion::{LAGS, NO_LINK};
use crate::shared::{motion, signal};

fn luminance(signal: [u32; 2]) -> f64 {
    signal::luminance(signal::colour(signal))
}

/// The bin of a histogram that counts this difference.
fn bin(difference: f64) -> usize {
    ((difference.log2() - LOWEST_OCTAVE) * BINS_PER_OCTAVE).floor().clamp(0.0, BINS as f64 - 1.0) as usize
}

/// An earlier frame, with which a picture is compared.
#[derive(Clone, Copy)]
pub struct Earlier<'a> {
    /// The earlier picture of the stream.
    pub picture: &'a [[u32; 2]],
    /// The picture of the reference sequence in that frame; `None` = not known.
    pub reference: Option<&'a [[u32; 2]]>,
    /// For each pixel, the index of the linked pixel of the earlier picture, or [`NO_LINK`].
    pub links: &'a [u32],
}

/// Returns the sums of a frame, for pictures of `size` pixels. `reference` is the picture of the reference sequence, if it is known. `past` has one
/// entry per lag, from lag 1 on. `quarter`: the index, 0 to 3, of the quarter of the pixels that is used for lags 2 to 4, for the test of the history
/// ([`FrameSums::tested`]), and for the histograms.
pub fn measure(size: [u32; 2], now: &[[u32; 2]], reference: Option<&[[u32; 2]]>, past: &[Earlier<'_>], quarter: u32) -> FrameSums {
    let mut sums = FrameSums { invalid: now.iter().filter(|s| signal::is_invalid(**s)).count() as u64, ..FrameSums::default() };
    let [width, height] = size.map(|n| n as usize);
    let known = |picture: Option<&[[u32; 2]]>, at: usize| picture.map(|p| p[at]).filter(|s| signal::is_terrain(*s)).map(luminance);
    for (at, &signal_now) in now.iter().enumerate().filter(|(_, s)| signal::is_terrain(**s)) {
        sums.terrain += 1;
        sums.fetches += u64::from(signal::fetches(signal_now));
        let (x, y) = (at % width, at / width);
        let in_quarter = motion::in_quarter(y as u32, quarter);
        for (lag, past) in past.iter().enumerate().take(LAGS) {
            if lag > 0 && !in_quarter {
                continue;
            }
            sums.lags[lag].terrain += 1;
            let link = past.links[at];
            if link == NO_LINK || !signal::is_terrain(past.picture[link as usize]) {
                continue;
            }
            let before = past.picture[link as usize];
            let colour_before = signal::colour(before);
            let change = luminance(signal_now) - luminance(before);
            let lag_sums = &mut sums.lags[lag];
            lag_sums.linked += 1;
            lag_sums.difference += change.abs();
            let (choice_now, choice_before) = (signal::choice(signal_now), signal::choice(before));
            if choice_now != 0 && choice_before != 0 {
                lag_sums.chosen += 1;
                lag_sums.flipped += u64::from(choice_now != choice_before);
            }
            let of_reference = known(reference, at).zip(known(past.reference, link as usize)).map(|(now, before)| now - before);
            if let Some(of_reference) = of_reference {
                lag_sums.residual.add(&Residual {
                    compared: 1,
                    sum: (change - of_reference).abs(),
                    square: (change - of_reference).powi(2),
                    change_square: change * change,
                    reference_square: of_reference * of_reference,
                    product: change * of_reference,
                });
            }
            if lag == 0 && in_quarter {
                sums.tested += 1;
                sums.histogram[bin(change.abs())] += 1;
                if let Some(of_reference) = of_reference {
                    sums.residual_histogram[bin((change - of_reference).abs())] += 1;
                }
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

/// Returns, for each pixel, the remembered error (an exponential mean over time, see `measure_remember` in `measure.wgsl`) and the number of frames
/// in this mean. `before`: the result for the previous frame; `None` = it is not known. `links` lead to the previous frame. `adaptation`: see
/// `Viewing::adaptation`.
pub fn remember(now: &[[u32; 2]], reference: &[[u32; 2]], before: Option<&[[f64; 2]]>, links: &[u32], adaptation: f64) -> Vec<[f64; 2]> {
    let pixel = |at: usize| {
        if !signal::is_terrain(now[at]) || !signal::is_terrain(reference[at]) {
            return [0.0; 2];
        }
        let error = luminance(now[at]) - luminance(reference[at]);
        match before.filter(|_| links[at] != NO_LINK).map(|before| before[links[at] as usize]) {
            Some([mean, frames]) => [mean + (error - mean) * adaptation.max(1.0 / (frames + 1.0)), frames + 1.0],
            None => [error, 1.0],
        }
    };
    (0..now.len()).map(pixel).collect()
}

/// Compares the picture of one seed with the exact blend. `block`: edge length of the blocks, pixels. Returns the sums that `seeds_add` and
/// `seeds_blocks` compute.
pub fn seed(size: [u32; 2], block: u32, picture: &[[u32; 2]], exact: &[[u32; 2]]) -> SeedSums {
    let [across, down] = areas(size).map(|n| n as usize);
    let mut sums = SeedSums { areas: vec![AreaSums::default(); across * down], ..SeedSums::default() };
    let [width, height] = size.map(|n| n as usize);
    let (block, edge) = (block as usize, AREA as usize);
    let known = |at: usize| signal::is_terrain(picture[at]) && signal::is_terrain(exact[at]);
    for (at, (&now, &exact)) in picture.iter().zip(exact).enumerate().filter(|(at, _)| known(*at)) {
        let (a, b) = (signal::colour(now), signal::colour(exact));
        let area = &mut sums.areas[at / width / edge * across + at % width / edge];
        for k in 0..3 {
            let d = f64::from(a[k]) - f64::from(b[k]);
            area.error += d;
            area.squared_error += d * d;
            sums.error += d;
            sums.squared_error += d * d;
        }
        area.terrain += 1.0;
        sums.terrain += 1.0;
    }
    for by in 0..height / block {
        for bx in 0..width / block {
            let inside = (0..block * block).map(|i| (by * block + i / block) * width + bx * block + i % block);
            let pixels: Vec<usize> = inside.collect();
            if !pixels.iter().all(|&at| known(at)) {
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

/// Returns the sums that `seeds_finish` computes from the pictures of several seeds: the bias of their mean, and their variance over the seeds. A
/// pixel is left out if it is not terrain, or invalid, in one of the pictures or in `exact`.
pub fn finish(pictures: &[Vec<[u32; 2]>], exact: &[[u32; 2]]) -> VarianceSums {
    let mut sums = VarianceSums::default();
    let n = pictures.len() as f64;
    let everywhere = |at: usize| pictures.iter().map(Vec::as_slice).chain([exact]).all(|picture| signal::is_terrain(picture[at]));
    for (at, &exact) in exact.iter().enumerate().filter(|(at, _)| everywhere(*at)) {
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

//! Changes the size of a map.

use rayon::prelude::*;

/// Resamples an image of `edge` x `edge` texels to `size` x `size`: first along rows, then along columns. If the image is larger
/// than `size`, it is averaged over the area of each new texel. If it is smaller, it is interpolated bilinearly, wrapping around at the
/// edges.
pub(super) fn resample(texels: Vec<[f32; 3]>, edge: usize, size: usize) -> Vec<[f32; 3]> {
    if edge == size {
        return texels;
    }
    let taps = taps(edge, size);
    let gather = |tap: &[(usize, f32)], texel: &dyn Fn(usize) -> [f32; 3]| {
        let mut sum = [0.0_f32; 3];
        for &(i, w) in tap {
            let t = texel(i);
            for c in 0..3 {
                sum[c] += w * t[c];
            }
        }
        sum
    };
    let texels = &texels;
    let rows: Vec<[f32; 3]> = (0..edge * size).into_par_iter().map(|i| gather(&taps[i % size], &|x| texels[i / size * edge + x])).collect();
    (0..size * size).into_par_iter().map(|i| gather(&taps[i / size], &|y| rows[y * size + i % size])).collect()
}

/// Returns, for each target texel along one axis, the source texels from which it is computed, with their weights (sum 1).
fn taps(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let ratio = from as f64 / to as f64;
    (0..to)
        .map(|target| {
            if from > to {
                let (start, end) = (target as f64 * ratio, (target + 1) as f64 * ratio);
                let covered = |i: usize| ((end.min((i + 1) as f64) - start.max(i as f64)) / ratio) as f32;
                (start as usize..from.min(end.ceil() as usize)).map(|i| (i, covered(i))).filter(|&(_, w)| w > 0.0).collect()
            } else {
                let at = (target as f64 + 0.5) * ratio - 0.5 + from as f64;
                let (first, fraction) = (at as usize, at.fract() as f32);
                vec![(first % from, 1.0 - fraction), ((first + 1) % from, fraction)]
            }
        })
        .collect()
}

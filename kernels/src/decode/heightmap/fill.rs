//! Fills gaps in a heightmap with a membrane: a smooth surface that meets the samples at the rim of each gap.
//!
//! Method: the discrete Laplace equation (each filled sample is the mean of its four neighbours), solved by multigrid on a pyramid of grids, each
//! with half the resolution of the next finer one (Briggs, Henson and McCormick, *A Multigrid Tutorial*, 2000). The first guess is interpolated from
//! grid to grid, beginning with the coarsest. V-cycles of Gauss-Seidel sweeps then reduce its error.
//!
//! The V-cycles are necessary, because the first guess also depends on samples behind the rim: a coarse cell at the rim is a mean that includes them.
//! Sweeps on the finest grid alone would reduce the effect of these samples only near the rim. At the edge of the map, missing neighbours are left
//! out, so the slope of the membrane perpendicular to the edge is 0. The result does not depend on threads.
//!
//! Limit: a membrane has no peaks, pits or roughness. It stays between the lowest and the highest height of the rim, apart from the error of the
//! solution. In the tests, this error is below a thousandth of the range of the known heights.

/// Largest number of sweeps over the gaps of each grid, for the first guess.
const SWEEPS: usize = 16;
/// Number of sweeps of a cycle on each grid, before the correction by the coarser grid and again after it.
const SWEEPS_OF_CYCLE: usize = 2;
/// Largest number of cycles. Most maps need 5 to 20.
const CYCLES: usize = 64;
/// The sweeps of the first guess, and the cycles, end early if the last sweep changes no filled sample by more than this share of the range of the
/// known heights.
const STILL: f32 = 1e-6;

/// Replaces the samples whose `void` is true, in an image that is `width` wide. At least one sample must have data.
pub(super) fn fill(samples: &mut [f32], void: &[bool], width: usize) {
    let known = samples.iter().zip(void).filter(|&(_, &is_void)| !is_void).map(|(&sample, _)| sample);
    let (low, high) = known.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), sample| (low.min(sample), high.max(sample)));
    let still = (high - low).max(0.0) * STILL;
    descend(samples, void, width, still);
    for _ in 0..CYCLES {
        if cycle(samples, void, width, None) <= still {
            break;
        }
    }
}

/// The indices of the samples to fill.
fn gaps_of(void: &[bool]) -> Vec<usize> {
    (0..void.len()).filter(|&index| void[index]).collect()
}

/// The sum of the up to four neighbours of a sample in its row and its column, and their number.
fn neighbours(samples: &[f32], index: usize, width: usize) -> (f64, f64) {
    let (x, y) = (index % width, index / width);
    let four = [
        (x > 0).then(|| samples[index - 1]),
        (x + 1 < width).then(|| samples[index + 1]),
        (y > 0).then(|| samples[index - width]),
        (index + width < samples.len()).then(|| samples[index + width]),
    ];
    (four.iter().flatten().map(|&sample| f64::from(sample)).sum(), four.iter().flatten().count() as f64)
}

/// Sets each sample of the gaps to the sum of its neighbours and of its entry in `sources` (0 if `None`), divided by the number of neighbours.
/// Returns the largest change of a sample.
fn sweep(samples: &mut [f32], gaps: &[usize], width: usize, sources: Option<&[f32]>) -> f32 {
    let mut moved = 0.0f32;
    for &index in gaps {
        let (sum, count) = neighbours(samples, index, width);
        let mean = ((sum + sources.map_or(0.0, |sources| f64::from(sources[index]))) / count) as f32;
        moved = moved.max((mean - samples[index]).abs());
        samples[index] = mean;
    }
    moved
}

/// The value of a coarse grid at a sample of the next finer grid, which is `width` wide. It is interpolated bilinearly between the centres of the
/// four nearest coarse cells, with the weights 3/4 and 1/4 along each axis. Beyond the edge of the grid, the outermost cells are repeated.
fn interpolated(coarse: &[f32], index: usize, width: usize) -> f32 {
    let coarse_width = width.div_ceil(2);
    let pair = |at: usize, count: usize| {
        let near = at / 2;
        let far = if at.is_multiple_of(2) { near.saturating_sub(1) } else { (near + 1).min(count - 1) };
        [(near, 0.75f32), (far, 0.25)]
    };
    let mut sum = 0.0;
    for (y, along_y) in pair(index / width, coarse.len() / coarse_width) {
        for (x, along_x) in pair(index % width, coarse_width) {
            sum += along_x * along_y * coarse[y * coarse_width + x];
        }
    }
    sum
}

/// Makes the first guess for the gaps of a grid: makes the guess of the next coarser grid, interpolates it, and improves it by at most [`SWEEPS`]
/// sweeps. The sweeps end early if one changes no sample by more than `still`.
fn descend(samples: &mut [f32], void: &[bool], width: usize, still: f32) {
    let height = samples.len() / width;
    if !void.contains(&true) || samples.len() <= 1 {
        return;
    }
    let (coarse_width, coarse_height) = (width.div_ceil(2), height.div_ceil(2));
    let mut coarse = vec![0.0f32; coarse_width * coarse_height];
    let mut coarse_void = vec![true; coarse.len()];
    for (cell, (mean, is_void)) in coarse.iter_mut().zip(&mut coarse_void).enumerate() {
        let (x, y) = (cell % coarse_width * 2, cell / coarse_width * 2);
        let (mut sum, mut count) = (0.0f64, 0u32);
        for (x, y) in [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)] {
            if x < width && y < height && !void[y * width + x] {
                sum += f64::from(samples[y * width + x]);
                count += 1;
            }
        }
        if count > 0 {
            (*mean, *is_void) = ((sum / f64::from(count)) as f32, false);
        }
    }
    descend(&mut coarse, &coarse_void, coarse_width, still);
    let gaps = gaps_of(void);
    for &index in &gaps {
        samples[index] = interpolated(&coarse, index, width);
    }
    for _ in 0..SWEEPS {
        if sweep(samples, &gaps, width, None) <= still {
            break;
        }
    }
}

/// Improves the gaps of a grid by a V-cycle: sweeps, a correction that is computed in the same way on the next coarser grid, and sweeps. Returns the
/// largest change of a sample by the last sweep. `sources`: see [`sweep`].
fn cycle(samples: &mut [f32], void: &[bool], width: usize, sources: Option<&[f32]>) -> f32 {
    let gaps = gaps_of(void);
    for _ in 0..SWEEPS_OF_CYCLE {
        sweep(samples, &gaps, width, sources);
    }
    let coarse_width = width.div_ceil(2);
    let cell = |index: usize| index / width / 2 * coarse_width + index % width / 2;
    let mut coarse_void = vec![true; coarse_width * (samples.len() / width).div_ceil(2)];
    for index in (0..void.len()).filter(|&index| !void[index]) {
        coarse_void[cell(index)] = false;
    }
    if samples.len() > 1 && coarse_void.contains(&true) {
        let mut residuals = vec![0.0f32; coarse_void.len()];
        for &index in &gaps {
            let (sum, count) = neighbours(samples, index, width);
            let source = sources.map_or(0.0, |sources| f64::from(sources[index]));
            residuals[cell(index)] += (source + sum - count * f64::from(samples[index])) as f32;
        }
        let mut correction = vec![0.0f32; coarse_void.len()];
        cycle(&mut correction, &coarse_void, coarse_width, Some(&residuals));
        for &index in &gaps {
            samples[index] += interpolated(&correction, index, width);
        }
    }
    (0..SWEEPS_OF_CYCLE).map(|_| sweep(samples, &gaps, width, sources)).last().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(size: [usize; 2], height: impl Fn(usize, usize) -> f32, is_void: impl Fn(usize, usize) -> bool) -> Vec<f32> {
        let places = (0..size[0] * size[1]).map(|index| (index % size[0], index / size[0]));
        let void: Vec<bool> = places.clone().map(|(x, y)| is_void(x, y)).collect();
        let mut samples: Vec<f32> = places.zip(&void).map(|((x, y), &is_void)| if is_void { f32::NAN } else { height(x, y) }).collect();
        fill(&mut samples, &void, size[0]);
        samples
    }

    #[test]
    fn a_gap_in_a_plane_is_that_plane() {
        let plane = |x: usize, y: usize| 100.0 + 3.0 * x as f32 - 2.0 * y as f32;
        let gaps: [fn(usize, usize) -> bool; 3] = [
            |x, y| (20..44).contains(&x) && (10..35).contains(&y),
            |x, y| (x, y) == (31, 17),
            |x, y| {
                (x as i32 - 32).pow(2) + (y as i32 - 24).pow(2) < 400
                    || (x + y).is_multiple_of(5) && (1..64).contains(&x) && (1..48).contains(&y)
            },
        ];
        for (number, gap) in gaps.into_iter().enumerate() {
            for (index, sample) in filled([65, 49], plane, gap).into_iter().enumerate() {
                let truth = plane(index % 65, index / 65);
                assert!((sample - truth).abs() < 0.05, "gap {number}, sample {index}: {sample} instead of {truth}");
            }
        }
    }

    #[test]
    fn a_membrane_stays_between_the_heights_of_its_rim() {
        let bumpy = |x: usize, y: usize| 50.0 + 40.0 * (x as f32 * 0.7).sin() * (y as f32 * 0.4).cos();
        let samples = filled([40, 30], bumpy, |x, y| x >= 20 || (x, y) == (3, 3));
        assert!(samples.iter().all(|sample| (10.0..=90.0).contains(sample)));
        let steps = samples.chunks(40).flat_map(|row| row[25..].windows(2).map(|pair| (pair[1] - pair[0]).abs()));
        assert!(steps.fold(0.0, f32::max) < 3.0, "it is smooth away from the rim");
        let single = filled([5, 4], |_, _| 7.0, |x, y| (x, y) != (4, 3));
        assert!(single.iter().all(|&sample| (sample - 7.0).abs() < 1e-6));
    }

    #[test]
    fn a_membrane_does_not_know_what_is_behind_its_rim() {
        // The rim is one sample wide and flat. All other samples are 100 m higher, so a membrane that depends on samples behind the rim is not flat.
        for (side, gap) in [(128, 60), (200, 140)] {
            let first = (side - gap) / 2;
            let within = |reach: usize| {
                let range = first - reach..first + gap + reach;
                move |x: usize, y: usize| range.contains(&x) && range.contains(&y)
            };
            let (is_void, is_near) = (within(0), within(1));
            let samples = filled([side, side], |x, y| if is_near(x, y) { 0.0 } else { 100.0 }, &is_void);
            for (index, sample) in samples.into_iter().enumerate().filter(|(index, _)| is_void(index % side, index / side)) {
                assert!(sample.abs() < 0.1, "gap of {gap}, sample {index}: {sample} m");
            }
        }
    }
}

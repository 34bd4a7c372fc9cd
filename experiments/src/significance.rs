//! Tests whether a mean over a picture and over seeds differs from its expected value, and says how large a difference the test can find.
//!
//! The numbers come as one sum per seed and per area of the picture. Seeds are independent, but they are few, so a standard error that is computed
//! from one number per seed is itself very uncertain. Most noise is correlated over a few pixels only. Areas that are much larger are then almost
//! independent, too, and there are many of them. [`Areas`] uses both. METHODOLOGY has the formulas in the sections *Bias* and *Variance*.
//!
//! Limits: noise whose cells are wider than 16 pixels correlates areas. [`Areas::mean`] uses larger areas then, but the standard error may still be
//! too small.

use kernels::shared::hash;
use statrs::distribution::{ContinuousCDF, Normal, StudentsT};

/// The level of all tests of a family together: the probability that at least one of them reports a difference although there is none.
pub const LEVEL: f64 = 0.001;
/// The probability with which a test finds a deviation that is as large as the result of [`detectable`].
pub const POWER: f64 = 0.99;
/// The smallest probability that [`Areas::probability`] returns.
pub const SMALLEST_PROBABILITY: f64 = 1.0 / (DRAWS as f64 + 1.0);

/// Number of grids of areas. The areas of each grid are twice as wide and twice as high as those of the grid before it.
const GRIDS: usize = 3;
/// A grid of larger areas is used only if the sums of at least this many of its areas vary over seeds. With fewer areas, its standard error is too
/// uncertain.
const LEAST_AREAS: usize = 30;
/// Number of sums into which the seeds of an area are grouped. The sign of each sum is drawn at random. If there are more seeds than this, several
/// seeds share a sum.
const GROUPS: usize = 8;
/// Largest number of draws of random signs.
const DRAWS: u32 = 1 << 18;
/// Drawing ends early when this many draws have given a mean square that is at least as large as the measured one.
const ENOUGH: u32 = 10;
/// Number of areas whose random signs come from one hash of four words. The signs of the sums of an area come from one byte, and each word gives
/// three bytes. Its lowest byte is not used, because the lowest bits of this hash are not random enough.
const LANES: usize = 12;
/// Salt of the hash that gives the random signs. It makes the signs independent of other uses of the hash.
const SIGNS: u32 = 0x5167_0005;
/// A larger number of degrees of freedom is replaced by this one. With so many degrees of freedom, Student's t distribution differs from the normal
/// distribution by less than 1e-5.
const MOST_FREEDOM: f64 = 1e6;

/// Returns the level that each of `tests` tests must have so that all tests together have the level [`LEVEL`] (Šidák). The result is exact for
/// independent tests. For two-sided tests of correlated normal numbers, the level of all tests together is at most [`LEVEL`].
pub fn sidak(tests: usize) -> f64 {
    sidak_at(LEVEL, tests)
}

/// The same as [`sidak`] for another level of all tests together, above 0 and below 1.
pub fn sidak_at(level: f64, tests: usize) -> f64 {
    // This is 1 - (1 - level)^(1/n). The expression below loses no digits if n is large.
    -((-level).ln_1p() / tests.max(1) as f64).exp_m1()
}

/// Returns the limit of a two-sided test at `level`: the number of standard errors by which a mean may differ from its expected value. `freedom` is
/// the number of degrees of freedom of the standard error. The result is infinite if `freedom` is NaN or less than 1.
pub fn limit(level: f64, freedom: f64) -> f64 {
    if !(1.0..=f64::INFINITY).contains(&freedom) {
        return f64::INFINITY;
    }
    StudentsT::new(0.0, 1.0, freedom.min(MOST_FREEDOM)).map_or(f64::INFINITY, |t| -t.inverse_cdf(level / 2.0))
}

/// Returns the smallest deviation, in standard errors, that the test of [`limit`] finds with the probability [`POWER`]. This is the approximation of
/// Johnson and Welch (1940) to the noncentral t distribution. In tests, the result is at most 1.3 % too small for 12 or more degrees of freedom, and
/// at most 4.1 % too small for 3.
pub fn detectable(level: f64, freedom: f64) -> f64 {
    let limit = limit(level, freedom);
    let freedom = freedom.max(1.0);
    limit * (1.0 - 0.25 / freedom) + Normal::standard().inverse_cdf(POWER) * (1.0 + limit * limit / (2.0 * freedom)).sqrt()
}

/// A mean, and what is known about its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// Standard error of the mean; `None` if it is unknown, for example because there is only one seed or frame.
    pub standard_error: Option<f64>,
    /// Degrees of freedom of the standard error; `None` if they are unknown, or if the standard error is 0.
    pub freedom: Option<f64>,
}

/// Statistics of one area over the seeds so far.
#[derive(Clone, Copy, Debug, Default)]
struct Area {
    /// Number of values in the sum of one seed. It is the same for all seeds.
    numbers: f64,
    /// Mean of the sums of the seeds.
    mean: f64,
    /// Sum over seeds of the square of the difference from the mean.
    squares: f64,
}

impl Area {
    /// Adds the sum of one seed. `seeds`: the number of seeds so far, including this one. This is Welford's recurrence.
    fn add(&mut self, [sum, numbers]: [f64; 2], seeds: f64) {
        let difference = sum - self.mean;
        self.mean += difference / seeds;
        self.squares += difference * (sum - self.mean);
        self.numbers = numbers;
    }

    /// Unbiased estimate of the variance, over seeds, of the area's sum. `seeds`: at least 2.
    fn variance(&self, seeds: f64) -> f64 {
        self.squares / (seeds - 1.0)
    }
}

/// Statistics of the areas of a picture over seeds. The required memory depends on the number of areas and not on the number of seeds.
#[derive(Clone, Debug)]
pub struct Areas {
    /// Number of areas in a row of the finest grid.
    columns: usize,
    /// The areas of each grid, row by row; the finest grid is the first.
    grids: [Vec<Area>; GRIDS],
    /// For each area of the finest grid: [`GROUPS`] sums. The sum of each seed is added to one of them, in turn.
    groups: Vec<[f64; GROUPS]>,
    seeds: u32,
}

impl Areas {
    /// Returns statistics without seeds. `columns` and `rows`: the number of areas across and down, at least 1.
    pub fn new([columns, rows]: [u32; 2]) -> Areas {
        let of = |grid: usize| [columns, rows].map(|n| (n as usize).div_ceil(1 << grid)).iter().product::<usize>();
        Areas {
            columns: columns as usize,
            grids: std::array::from_fn(|grid| vec![Area::default(); of(grid)]),
            groups: vec![[0.0; GROUPS]; of(0)],
            seeds: 0,
        }
    }

    /// Adds one seed. `sums` has a pair for each area, row by row: the sum of the area's numbers, and their count.
    pub fn add(&mut self, sums: impl Iterator<Item = [f64; 2]>) {
        let group = self.seeds as usize % GROUPS;
        self.seeds += 1;
        let mut sums: Vec<[f64; 2]> = sums.take(self.groups.len()).collect();
        for (groups, [sum, _]) in self.groups.iter_mut().zip(&sums) {
            groups[group] += sum;
        }
        let mut columns = self.columns;
        for (level, grid) in self.grids.iter_mut().enumerate() {
            if level > 0 {
                sums = merged(&sums, columns, grid.len());
                columns = columns.div_ceil(2);
            }
            for (area, &sum) in grid.iter_mut().zip(&sums) {
                area.add(sum, f64::from(self.seeds));
            }
        }
    }

    /// Returns the mean over all numbers and seeds. If areas are independent, the variance of their sum is the sum of their variances. If noise
    /// correlates neighbouring areas, this sum of variances is larger for larger areas. The standard error is therefore computed from areas of the
    /// given size, of twice its width and of four times its width, and the largest result is returned. A grid of larger areas is not used if too few
    /// of them vary (`LEAST_AREAS`).
    pub fn mean(&self) -> Mean {
        let [finest, larger @ ..] = &self.grids;
        let numbers = finest.iter().map(|area| area.numbers).sum::<f64>().max(1.0);
        let value = finest.iter().map(|area| area.mean).sum::<f64>() / numbers;
        if self.seeds < 2 {
            return Mean { value, standard_error: None, freedom: None };
        }
        let mut spread = self.spread(finest);
        for areas in larger.iter().filter(|areas| areas.iter().filter(|area| area.squares > 0.0).count() >= LEAST_AREAS) {
            let other = self.spread(areas);
            if other[0] > spread[0] {
                spread = other;
            }
        }
        let [variance, freedom] = spread;
        Mean { value, standard_error: Some(variance.sqrt() / numbers), freedom: Some(freedom).filter(|freedom| freedom.is_finite()) }
    }

    /// Returns the variance of the sum of all areas' means, and its degrees of freedom (NaN if the variance is 0).
    fn spread(&self, areas: &[Area]) -> [f64; 2] {
        let seeds = f64::from(self.seeds);
        let (mut sum, mut squares) = (0.0, 0.0);
        for variance in areas.iter().map(|area| area.variance(seeds)) {
            sum += variance;
            squares += variance * variance;
        }
        [sum / seeds, sum * sum * (seeds - 1.0) / squares]
    }

    /// Returns an unbiased estimate of the mean square of the areas' expected means. Each area is weighted by the square of its number of values.
    /// Biases of opposite signs cancel in the mean, but not in this estimate. The estimate may be negative. Its standard error is valid if the
    /// expected mean of each area is 0. `None` for fewer than two seeds, or if there are no numbers.
    pub fn mean_square(&self) -> Option<Mean> {
        let seeds = f64::from(self.seeds);
        let [finest, ..] = &self.grids;
        let weight: f64 = finest.iter().map(|area| area.numbers * area.numbers).sum();
        if self.seeds < 2 || weight <= 0.0 {
            return None;
        }
        let (mut sum, mut squares) = (0.0, 0.0);
        for area in finest {
            let variance = area.variance(seeds);
            sum += area.mean * area.mean - variance / seeds;
            squares += 2.0 * variance * variance / (seeds * (seeds - 1.0));
        }
        Some(Mean { value: sum / weight, standard_error: Some(squares.sqrt() / weight), freedom: None })
    }

    /// Returns the p-value of the measured mean square: the probability of a mean square that is at least as large, if the expected mean of every
    /// area is 0. `None` for fewer than two seeds, or if a number is not finite.
    ///
    /// The null distribution is simulated with random signs. For each area and each seed, the sign of the area's sum is drawn at random (for more
    /// than 8 seeds, for each of 8 sums of seeds). The distribution is exact if the sums are independent and symmetric about 0. If they are not
    /// symmetric, its mean and variance are still right, because a mean square is a sum of products of different seeds. The draws have a fixed seed.
    /// They end when enough of them are as large as the measured number (Besag and Clifford 1991), so a large probability costs few draws.
    /// Probabilities below [`SMALLEST_PROBABILITY`] cannot be distinguished from it.
    pub fn probability(&self) -> Option<f64> {
        let groups = GROUPS.min(self.seeds as usize);
        if groups < 2 {
            return None;
        }
        // The sign of the first group is fixed, because the square does not depend on the sign of the whole sum. A pattern therefore has `groups - 1`
        // bits. They are taken from the highest bits of a byte, so the byte is shifted to the right by 8 - (groups - 1).
        let patterns = 1 << (groups - 1);
        let shift = 9 - groups;
        let squares: Vec<f64> = self
            .groups
            .iter()
            .filter(|sums| sums.iter().any(|sum| *sum != 0.0))
            .flat_map(|sums| (0..patterns).map(move |pattern| signed_sum(&sums[..groups], pattern).powi(2)))
            .collect();
        let measured: f64 = squares.iter().step_by(patterns).sum();
        if !measured.is_finite() {
            return None;
        }
        let mut reached = 0;
        for draw in 1..=DRAWS {
            let mut sum = 0.0;
            for (areas, block) in squares.chunks(LANES * patterns).zip(0..) {
                let bytes = hash::pcg4d([draw, block, SIGNS, 0]).map(|word| {
                    let [_, high @ ..] = word.to_le_bytes();
                    high
                });
                for (area, byte) in areas.chunks_exact(patterns).zip(bytes.as_flattened()) {
                    sum += area[usize::from(*byte) >> shift];
                }
            }
            if sum >= measured {
                reached += 1;
                if reached == ENOUGH {
                    return Some(f64::from(ENOUGH) / f64::from(draw));
                }
            }
        }
        Some((f64::from(reached) + 1.0) * SMALLEST_PROBABILITY)
    }
}

/// Returns the sums of areas of twice the width and height. `columns` is the number of areas in a row of `sums`, `areas` the number of larger areas.
fn merged(sums: &[[f64; 2]], columns: usize, areas: usize) -> Vec<[f64; 2]> {
    let across = columns.div_ceil(2);
    let mut merged = vec![[0.0; 2]; areas];
    for (at, [sum, numbers]) in sums.iter().enumerate() {
        let [to_sum, to_numbers] = &mut merged[at / columns / 2 * across + at % columns / 2];
        *to_sum += sum;
        *to_numbers += numbers;
    }
    merged
}

/// Returns the sum of numbers whose signs are reversed where `pattern` has a bit. The first number keeps its sign, so the lowest bit belongs to the
/// second number.
fn signed_sum(sums: &[f64], pattern: usize) -> f64 {
    sums.iter().enumerate().map(|(i, sum)| if ((pattern << 1) >> i) & 1 == 1 { -sum } else { *sum }).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the statistics of areas that have one number each. `seeds` holds the numbers of each seed.
    fn areas(size: [u32; 2], seeds: &[Vec<f64>]) -> Areas {
        let mut areas = Areas::new(size);
        seeds.iter().for_each(|sums| areas.add(sums.iter().map(|sum| [*sum, 1.0])));
        areas
    }

    fn near(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b.abs()
    }

    #[test]
    fn limits_are_those_of_published_tables() {
        // Tables of Student's t distribution give these limits for a two-sided level of 0.1 %: 12.924 with 3 degrees of freedom, 4.073 with 15, and
        // 3.291 for the normal distribution.
        for (freedom, expected) in [(3.0, 12.924), (15.0, 4.073), (f64::INFINITY, 3.291), (1e12, 3.291)] {
            assert!((limit(0.001, freedom) - expected).abs() < 1e-3, "{freedom}: {}", limit(0.001, freedom));
        }
        // The number of degrees of freedom need not be whole. With more degrees of freedom the limit is smaller, with more tests it is larger.
        assert!(limit(0.001, 15.0) < limit(0.001, 14.5) && limit(0.001, 14.5) < limit(0.001, 14.0));
        assert!(limit(sidak(72), 56.0) > 4.76 && limit(sidak(72), 56.0) < 4.77 && limit(sidak(450), 56.0) > 5.27);
        assert_eq!([f64::NAN, 0.0, 0.5, -1.0].map(|freedom| limit(0.001, freedom)), [f64::INFINITY; 4]);
        assert!((sidak(1) - LEVEL).abs() < 1e-15 && sidak(0) == sidak(1));
    }

    #[test]
    fn what_is_detectable_follows_the_noncentral_t_distribution() {
        // The expected values are integrals of the noncentral t distribution, computed with SciPy 1.17.
        for (level, freedom, exact) in [
            (1e-3, 3.0, 25.317),
            (1e-3, 12.0, 7.373),
            (1e-3, 200.0, 5.694),
            (1e-6, 12.0, 13.967),
            (1e-6, 80.0, 7.809),
            (1e-6, 1000.0, 7.261),
        ] {
            let error = detectable(level, freedom) / exact - 1.0;
            let bound = if freedom < 12.0 { 0.041 } else { 0.013 };
            assert!(error < 3e-4 && error > -bound, "{level}, {freedom}: {error}");
        }
        assert_eq!([f64::NAN, 0.0].map(|freedom| detectable(0.001, freedom)), [f64::INFINITY; 2]);
    }

    #[test]
    fn means_and_their_errors_are_those_of_the_formulas() {
        // Two areas and three seeds. The means are 2 and 5, the variances 1 and 9.
        let two = areas([2, 1], &[vec![1.0, 2.0], vec![2.0, 5.0], vec![3.0, 8.0]]);
        let Mean { value, standard_error, freedom } = two.mean();
        assert!(near(value, 7.0 / 2.0) && near(standard_error.expect("three seeds"), (10.0f64 / 3.0).sqrt() / 2.0));
        // Degrees of freedom: (1 + 9)² / ((1 + 81) / 2).
        assert!(near(freedom.expect("numbers that vary"), 100.0 / 41.0), "{freedom:?}");
        // Mean square: (2² - 1/3 + 5² - 9/3) / (1 + 1). The variance of its numerator is 2 (1 + 81) / (3 x 2).
        let square = two.mean_square().expect("three seeds");
        assert!(near(square.value, (4.0 - 1.0 / 3.0 + 25.0 - 3.0) / 2.0), "{square:?}");
        assert!(near(square.standard_error.expect("three seeds"), (82.0f64 / 3.0).sqrt() / 2.0), "{square:?}");
        // An area with three times as many numbers has three times the weight in the mean, and nine times the weight in the mean square.
        let mut weighted = Areas::new([2, 1]);
        [[1.0, 6.0], [3.0, 6.0]].into_iter().for_each(|[a, b]| weighted.add([[a, 1.0], [b, 3.0]].into_iter()));
        assert!(near(weighted.mean().value, (2.0 + 6.0) / 4.0));
        assert!(near(weighted.mean_square().expect("two seeds").value, (4.0 - 1.0 + 36.0) / (1.0 + 9.0)));
    }

    #[test]
    fn too_little_data_has_no_error() {
        let one = areas([3, 2], &[vec![1.0; 6]]);
        assert_eq!(one.mean(), Mean { value: 1.0, standard_error: None, freedom: None });
        assert_eq!((one.mean_square(), one.probability()), (None, None));
        // If all seeds give equal numbers, there is no scatter, so the standard error is 0 and has no degrees of freedom.
        let equal = areas([3, 2], &[vec![1.0; 6], vec![1.0; 6]]);
        assert_eq!(equal.mean(), Mean { value: 1.0, standard_error: Some(0.0), freedom: None });
        // Only sky: there are no numbers, and all sums are 0.
        let mut sky = Areas::new([3, 2]);
        (0..4).for_each(|_| sky.add([[0.0; 2]; 6].into_iter()));
        assert_eq!(sky.mean(), Mean { value: 0.0, standard_error: Some(0.0), freedom: None });
        assert_eq!((sky.mean_square(), sky.probability()), (None, Some(1.0)));
        // NaN is not hidden.
        let broken = areas([3, 2], &[vec![1.0; 6], vec![1.0, f64::NAN, 1.0, 1.0, 1.0, 1.0], vec![1.0; 6]]);
        assert!(broken.mean().value.is_nan() && broken.mean().freedom.is_none() && broken.probability().is_none());
        // No seed at all, and more sums than areas.
        assert_eq!(Areas::new([3, 2]).mean(), Mean { value: 0.0, standard_error: None, freedom: None });
        assert_eq!(areas([1, 1], &[vec![1.0, 7.0]]).mean().value, 1.0);
    }

    #[test]
    fn larger_areas_count_where_they_vary_more() {
        // The finest grid has 16 x 8 areas, the next 8 x 4, and the last 4 x 2, which are too few to be used. Each block of 2 x 2 areas has equal
        // numbers. The sum of a block has 16 times the variance of one of its areas, and there are a quarter as many blocks as areas. With blocks,
        // the variance of the mean is therefore 4 times larger, and its standard error 2 times.
        let seeds = |cell: usize| -> Vec<Vec<f64>> {
            let number = |at: usize, seed: usize| f64::from(hash::pcg((at % 16 / cell + at / 16 / cell * 16 + 1000 * seed) as u32) % 1000);
            (0..4).map(|seed| (0..128).map(|at| number(at, seed)).collect()).collect()
        };
        let of_single = |seeds: &[Vec<f64>]| -> f64 {
            let variance = |at: usize| {
                let mean = seeds.iter().map(|sums| sums[at]).sum::<f64>() / 4.0;
                seeds.iter().map(|sums| (sums[at] - mean).powi(2)).sum::<f64>() / 3.0
            };
            ((0..128).map(variance).sum::<f64>() / 4.0).sqrt() / 128.0
        };
        let correlated = seeds(2);
        let found = areas([16, 8], &correlated).mean().standard_error.expect("four seeds");
        assert!(near(found, 2.0 * of_single(&correlated)), "{found}, {}", of_single(&correlated));
        // With two rows fewer, there are only 8 x 3 larger areas, which is not enough.
        let fewer: Vec<Vec<f64>> = correlated.iter().map(|sums| sums[..96].to_vec()).collect();
        let found = areas([16, 6], &fewer).mean().standard_error.expect("four seeds");
        assert!(found < 1.2 * of_single(&correlated) * 128.0 / 96.0, "{found}");
        // If the numbers are independent, the standard error from larger areas is greater only by chance, and only a little.
        let independent = seeds(1);
        let ratio = areas([16, 8], &independent).mean().standard_error.expect("four seeds") / of_single(&independent);
        assert!((0.999..1.3).contains(&ratio), "{ratio}");
    }

    #[test]
    fn probabilities_are_shares_of_sign_patterns() {
        // Three areas and three seeds have 4³ distinct sign patterns, because the sign of the first seed is fixed in each area. `exact` is the share
        // of the patterns whose sum of squares is at least the measured one.
        let seeds = [vec![1.0, -2.0, 0.5], vec![2.0, 1.0, -0.25], vec![0.5, -3.0, 1.0]];
        let squares = |at: usize, pattern: usize| signed_sum(&[seeds[0][at], seeds[1][at], seeds[2][at]], pattern).powi(2);
        let total = |patterns: usize| (0..3).map(|at| squares(at, patterns >> (2 * at) & 3)).sum::<f64>();
        let exact = (0..64).filter(|patterns| total(*patterns) >= total(0)).count() as f64 / 64.0;
        // The drawing ends after 10 hits, so the result has a relative standard deviation of about 1 / sqrt(10).
        let found = areas([3, 1], &seeds).probability().expect("three seeds");
        assert!(exact > 0.05 && exact < 0.95 && (0.3..3.0).contains(&(found / exact)), "{found}, {exact}");
        // If all numbers have the same sign, every other sign pattern gives a smaller sum of squares. With 40 areas, the draws practically never
        // repeat the measured pattern.
        for count in [2, 3, 8, 20] {
            let same = areas([40, 1], &vec![vec![1.0; 40]; count]);
            assert_eq!(same.probability(), Some(SMALLEST_PROBABILITY), "{count} seeds");
            // Biases of opposite signs cancel in the mean, but not in the mean square.
            let opposite = vec![(0..40).map(|at| if at % 2 == 0 { 1.0 } else { -1.0 }).collect::<Vec<f64>>(); count];
            let opposite = areas([40, 1], &opposite);
            assert_eq!((opposite.mean().value, opposite.probability()), (0.0, Some(SMALLEST_PROBABILITY)), "{count} seeds");
            assert!(opposite.mean_square().is_some_and(|square| near(square.value, 1.0)), "{count} seeds");
        }
        // Two seeds with opposite numbers have the smallest possible sum of squares, which is 0. The sum of every other pattern is at least as large.
        let zero = areas([40, 1], &[vec![1.0; 40], vec![-1.0; 40]]);
        assert_eq!(zero.probability(), Some(1.0));
        // If the random signs are independent, the probabilities of 2000 sets of random numbers are uniform.
        let random = |set: u32| -> Vec<Vec<f64>> {
            let number = |seed: u32, at: u32| f64::from(hash::pcg(set * 4096 + seed * 64 + at) >> 8) - 8_388_607.5;
            (0..4).map(|seed| (0..40).map(|at| number(seed, at)).collect()).collect()
        };
        let all: Vec<f64> = (0..2000).map(|set| areas([40, 1], &random(set)).probability().expect("four seeds")).collect();
        for level in [0.05, 0.2, 0.5] {
            let share = all.iter().filter(|p| **p <= level).count() as f64 / 2000.0;
            // The tolerance is four standard deviations of a share of 2000 samples.
            assert!((share - level).abs() < 4.0 * (level * (1.0 - level) / 2000.0).sqrt(), "{share} of probabilities are at most {level}");
        }
    }
}

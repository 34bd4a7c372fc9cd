//! Tests the statistics of bias (`experiments::significance`) on simulated runs: how often they report a bias where there is none, and which biases
//! they find.
//!
//! A row is one measured bias. A simulated row contains simulated differences from the exact blend. They are summed over each area of 16 x 16 pixels
//! of a picture of 480 x 270 pixels, for each seed. The size of the picture, the number of seeds (four) and the number of rows are those of the
//! recorded sweep. The largest standard deviation of an area's sum is 14 times the smallest one. In a third of the rows, the sums have a skewed
//! distribution. Neighbouring areas are correlated as in pictures with six of the seven kinds of noise (`NEIGHBOURS`).

use experiments::significance::{Areas, Mean, POWER, detectable, limit, sidak};
use experiments::stability::statistics::Random;
use rayon::prelude::*;

/// Number of areas across and down.
const GRID: [usize; 2] = [30, 17];
const SEEDS: usize = 4;
/// Number of rows of a run: six noises x three views x two flavours (near cliff and far cliff).
const ROWS: u64 = 36;
/// For each noise, the share of the sums of the areas to the left and above that is added to the sum of an area, so that neighbouring areas are
/// correlated. The noises are, in this order: `hashed`, `hashed-anisotropic`, `white`, `world`, `ign`, `blue`. The shares give correlations like
/// those in simulated pictures of ground and cliffs. In these pictures, the ratio of the variance of the picture's sum to the sum of the areas'
/// variances was 0.5 to 0.75 for `ign` and `blue`, and 0.95 to 1.24 for the other noises. It was largest for `world` on ground near the camera.
const NEIGHBOURS: [f64; 6] = [1.0 / 64.0, 1.0 / 128.0, 0.0, 1.0 / 16.0, -1.0 / 12.0, -1.0 / 16.0];

/// The sums of a row: for each seed, one sum per area.
type Sums = [Vec<f64>; SEEDS];

/// Number of values in an area: three channels of each pixel. The areas at the bottom of the picture are only 14 pixels high.
fn numbers(at: usize) -> f64 {
    if at / GRID[0] + 1 == GRID[1] { 48.0 * 14.0 } else { 48.0 * 16.0 }
}

/// Standard deviation of the sum of each area, from 2.4 / 4 to 2.4 x 4. Areas in the same square of 3 x 3 areas have the same one. 2.4 is the
/// standard deviation of a sum over 256 independent pixels with three equal channels, each with a standard deviation of 0.05.
fn deviations() -> Vec<f64> {
    let mut random = Random(7);
    let squares: Vec<f64> = (0..60).map(|_| 2.4 * (4.0 * random.unit() - 2.0).exp2()).collect();
    (0..GRID[0] * GRID[1]).map(|at| squares[at / GRID[0] / 3 * 10 + at % GRID[0] / 3]).collect()
}

/// Returns the sums of a row without a bias.
fn sound(run: u64, row: u64, deviations: &[f64]) -> Sums {
    let mut random = Random((run * ROWS + row) << 32);
    let mut own: Sums = std::array::from_fn(|_| Vec::with_capacity(deviations.len()));
    for deviation in deviations {
        for sums in &mut own {
            // The number of bits that are set in a random word has an almost normal distribution. In the bitwise AND of three random words, its
            // distribution is skewed.
            let number = if row % 3 == 2 {
                (f64::from((random.word() & random.word() & random.word()).count_ones()) - 8.0) / 7f64.sqrt()
            } else {
                (f64::from(random.word().count_ones()) - 32.0) / 4.0
            };
            sums.push(deviation * number);
        }
    }
    let share = NEIGHBOURS[(row % 6) as usize];
    own.map(|own| {
        let left = |at: usize| if !at.is_multiple_of(GRID[0]) { own[at - 1] } else { 0.0 };
        let above = |at: usize| if at >= GRID[0] { own[at - GRID[0]] } else { 0.0 };
        (0..own.len()).map(|at| own[at] + share * left(at) + share * above(at)).collect()
    })
}

/// Adds a bias to the sums of several seeds and returns their statistics. The bias may depend on the area.
fn planted(sums: &[Vec<f64>], bias: impl Fn(usize) -> f64) -> Areas {
    let mut areas = Areas::new(GRID.map(|n| n as u32));
    for sums in sums {
        areas.add(sums.iter().enumerate().map(|(at, sum)| [sum + bias(at) * numbers(at), numbers(at)]));
    }
    areas
}

/// Whether a mean differs significantly from 0 after a shift. `shift`: returns the shift, in standard errors, for a number of degrees of freedom.
fn is_off(mean: &Mean, shift: impl Fn(f64) -> f64, level: f64) -> bool {
    let (error, freedom) = (mean.standard_error.expect("four seeds"), mean.freedom.expect("numbers that vary"));
    (mean.value + shift(freedom) * error).abs() > limit(level, freedom) * error
}

#[test]
fn a_thousand_sound_runs_raise_one_false_alarm_at_most() {
    // Null hypothesis: no row has a bias. Each run has 36 rows with two tests each, which share a level of 0.001 (Sidak correction). So about one of
    // 1000 runs may report a bias.
    let level = sidak(2 * ROWS as usize);
    let deviations = deviations();
    /// Results of the tests of a run, or sums over several runs. `any`: 1 if a test fails at the corrected level. `uncorrected`: 1 if a test fails at
    /// the level 0.1 %. `means`: number of rows whose test of the mean fails at 5 %. `probabilities`: number of rows whose test of the pattern of
    /// biases fails at 5 %.
    #[derive(Clone, Copy, Default)]
    struct Found {
        any: u32,
        uncorrected: u32,
        means: u32,
        probabilities: u32,
    }
    let of_run = |run: u64| {
        let mut found = Found::default();
        for row in 0..ROWS {
            let areas = planted(&sound(run, row, &deviations), |_| 0.0);
            let (mean, probability) = (areas.mean(), areas.probability().expect("four seeds"));
            let fails = |level: f64| is_off(&mean, |_| 0.0, level) || probability < level;
            found.any |= u32::from(fails(level));
            found.uncorrected |= u32::from(fails(0.001));
            found.means += u32::from(is_off(&mean, |_| 0.0, 0.05));
            found.probabilities += u32::from(probability <= 0.05);
        }
        found
    };
    let sum = |a: Found, b: Found| Found {
        any: a.any + b.any,
        uncorrected: a.uncorrected + b.uncorrected,
        means: a.means + b.means,
        probabilities: a.probabilities + b.probabilities,
    };
    let all = (0..1000).into_par_iter().map(of_run).reduce(Found::default, sum);
    assert!(all.any <= 1, "{} of 1000 runs raise a false alarm", all.any);
    // Negative control: without the correction, about 50 of 1000 runs report a bias.
    assert!(all.uncorrected > 20, "{} of 1000 runs", all.uncorrected);
    // At a level of 5 %, each test alone must fail in nearly 5 % of the rows. The test of means uses the largest of three standard errors, so it
    // fails in fewer rows.
    let share = |count: u32| f64::from(count) / (1000.0 * ROWS as f64);
    assert!((0.03..0.045).contains(&share(all.means)), "{}", share(all.means));
    assert!((0.035..0.055).contains(&share(all.probabilities)), "{}", share(all.probabilities));
}

#[test]
fn a_bias_of_one_percent_is_found_with_the_seeds_of_the_recorded_sweep() {
    let level = sidak(2 * ROWS as usize);
    let deviations = deviations();
    let rows: Vec<Sums> =
        (0..28).flat_map(|run| (0..ROWS).map(move |row| (run, row))).map(|(run, row)| sound(run, row, &deviations)).collect();
    let count = rows.len() as f64;
    let share = |bias: f64| rows.iter().filter(|sums| is_off(&planted(&sums[..], |_| bias).mean(), |_| 0.0, level)).count() as f64 / count;
    assert!(share(0.01) >= 0.99 && share(-0.01) >= 0.99, "{} and {}", share(0.01), share(-0.01));
    // A bias of a tenth of one percent is found in almost all rows, too. A bias of a hundredth of one percent is about as large as a standard error
    // (1.2e-4), so it is much smaller than the limit of the test, and is found in hardly any row.
    assert!(share(0.001) >= 0.98 && share(1e-4) < 0.05, "{} and {}", share(0.001), share(1e-4));
    // A bias as large as the one that a report calls detectable is found with at least the stated probability (`POWER`). A bias as large as the limit
    // of the test is found in about half of the rows.
    let shifted = |shift: fn(f64, f64) -> f64| {
        let found = |sums: &&Sums| is_off(&planted(&sums[..], |_| 0.0).mean(), |freedom| shift(level, freedom), level);
        rows.iter().filter(found).count() as f64 / count
    };
    let (all, half) = (shifted(detectable), shifted(limit));
    assert!(all >= POWER && (0.45..0.55).contains(&half), "{all} and {half}");
}

#[test]
fn biases_that_cancel_over_the_picture_are_found_with_two_seeds() {
    let level = sidak(2 * ROWS as usize);
    let deviations = deviations();
    // A bias of one percent whose sign alternates like the colours of a chessboard. Each square of the chessboard is 2 x 2 areas.
    let chessboard = |at: usize| if (at % GRID[0] / 2 + at / GRID[0] / 2).is_multiple_of(2) { 0.01 } else { -0.01 };
    for row in 0..6 {
        let sums = sound(0, row, &deviations);
        for seeds in [2, SEEDS] {
            let probability = |bias: &dyn Fn(usize) -> f64| planted(&sums[..seeds], bias).probability().expect("two seeds");
            assert!(probability(&chessboard) < level, "row {row}, {seeds} seeds");
            assert!(probability(&|_| 0.0) > 0.1, "row {row}, {seeds} seeds: {}", probability(&|_| 0.0));
        }
    }
}

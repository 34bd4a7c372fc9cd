//! Tests noise with the measurements of the stability lab (`experiments::stability`). Every kind of noise must pass the statistical tests, which form
//! one family. While a camera moves, statistics such as the flip rate must stay within their budgets: ranges around recorded values. The tests and
//! budgets must reject mutants of the noise.
//!
//! `notebooks-data/stability/noise.csv` contains the budgets. `experiments stability --out notebooks-data/stability` measures them again and rewrites
//! the file. Commit the new file only if a change of the noise is intended.

use std::collections::BTreeSet;
use std::time::Instant;

use experiments::stability::motion::{GROUNDS, Measured, Motion, measure};
use experiments::stability::noise::{Ask, Noise, ORIGINS, of_kind, of_noise, scattered, scattered_rows};
use experiments::stability::{Row, hold_as_family, motion, noise};
use kernels::shared::hash;
use kernels::shared::noise::{BELOW_ONE, HashedPoint, LEVEL_MIN, NoiseKind, TwoScales, cell, finest, hashed_isotropic, isotropic_scales};
use kernels::shared::real::length;

const TABLE: &str = include_str!("../notebooks-data/stability/noise.csv");

fn recorded() -> Vec<Row> {
    csv::Reader::from_reader(TABLE.as_bytes()).deserialize().collect::<Result<_, _>>().expect("the table's columns are a row's fields")
}

#[test]
fn every_kind_passes_the_tests_of_one_family() {
    let start = Instant::now();
    let rows = noise::rows();
    println!("{} rows, {} of them tests, in {:.1?}", rows.len(), rows.iter().filter(|row| row.is_test()).count(), start.elapsed());
    let wrong: Vec<&Row> = rows.iter().filter(|row| !row.holds()).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    // The avalanche effect of `hash::pcg4d` is known to be incomplete: a change of some input bits changes a bit in the highest byte of the output
    // with a probability other than one half. These are the input bits from index MIXED_BITS (in `stability/hashes.rs`) on. For some bit, the test
    // must measure a probability that differs from one half by more than 0.1.
    assert!(rows.iter().any(|row| row.statistic == "avalanche of the high byte" && row.value > 0.1));
}

#[test]
fn numbers_in_motion_are_within_their_budgets() {
    let start = Instant::now();
    let rows = motion::rows();
    println!("{} rows in {:.1?}", rows.len(), start.elapsed());
    let budgets = recorded();
    assert_eq!(budgets.len(), rows.len(), "the rows differ from the table: rewrite it with `experiments stability`");
    for (row, budget) in rows.iter().zip(&budgets) {
        let same = [&row.kind, &row.view, &row.motion, &row.statistic] == [&budget.kind, &budget.view, &budget.motion, &budget.statistic];
        let now = Row { value: row.value, ..budget.clone() };
        assert!(
            same && now.holds(),
            "{now:?}: measured {}; if the change is intended, rewrite the table with `experiments stability`",
            row.value
        );
        // The range of a budget must be the one that `motion::budget` computes from the recorded value, so that no budget is widened by hand.
        let ruled = motion::budget(budget.kind.parse().expect("a kind"), &budget.statistic, budget.value);
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-3 * b;
        assert!(close(budget.low, ruled[0]) && close(budget.high, ruled[1]), "{budget:?} is not as wide as {ruled:?}");
    }
}

// ---------------------------------------------------------------- mutants

/// A copy of hashed noise with a mistake in one line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mutant {
    /// Uses the derivative along x also as the derivative along y.
    DpdxTwice,
    /// Uses the usual one-line hash of shaders, fract(sin(dot(cell, ...)) 43758.5453) in f32, instead of an integer hash.
    FractSin,
    /// Does not clamp the level that follows from the footprint.
    NotClamped,
    /// Leaves out a part or all of a correction. Hashed noise blends the random numbers of two cell sizes, and applies the distribution function of
    /// this blend, so that the result is uniform again.
    Correction(Forgotten),
    /// Uses a different seed in each frame.
    Reseeded,
}

/// The part of the correction that a mutant leaves out. The correction is the distribution function of the blend (1 - l) U1 + l U2 of two uniform
/// numbers, where l is the blend factor. With a = min(l, 1 - l), the function has three cases for its argument x: a middle case (a <= x <= 1 - a) and
/// two outer cases.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Forgotten {
    All,
    /// Uses x instead of (x - a / 2) / (1 - a) in the middle case.
    Middle,
    /// Leaves out the factor of one half in the outer cases.
    Half,
    /// Uses a = l instead of a = min(l, 1 - l).
    Min,
}

impl Mutant {
    fn thresholds(self, ask: &Ask) -> [f64; 4] {
        let Ask { point, frame, seed, salt, .. } = ask;
        match self {
            Mutant::DpdxTwice => hashed_isotropic(&HashedPoint { ddy: point.ddx, ..*point }, *seed, *salt),
            Mutant::FractSin => {
                let level = level(point).clamp(f64::from(LEVEL_MIN), f64::from(finest_scale(point)));
                blend(point, level, |cell, k| fract_sin(cell, k, *seed, *salt))
            }
            Mutant::NotClamped => blend(point, level(point), |cell, k| pcg4d(cell, k, *seed, *salt)),
            Mutant::Correction(forgotten) => {
                let scales = isotropic_scales(point, *seed, *salt);
                scales.blended().map(|x| forgotten.correct(x, scales.lerp_factor))
            }
            Mutant::Reseeded => hashed_isotropic(point, seed.wrapping_add(*frame), *salt),
        }
    }
}

impl Forgotten {
    fn correct(self, x: f64, l: f64) -> f64 {
        let a = if self == Forgotten::Min { l } else { l.min(1.0 - l) };
        let half = if self == Forgotten::Half { 1.0 } else { 0.5 };
        let p = if self == Forgotten::All || a <= 0.0 {
            x
        } else if x < a {
            half * x * x / (a * (1.0 - a))
        } else if x <= 1.0 - a {
            if self == Forgotten::Middle { x } else { (x - 0.5 * a) / (1.0 - a) }
        } else {
            1.0 - half * (1.0 - x) * (1.0 - x) / (a * (1.0 - a))
        };
        p.clamp(0.0, BELOW_ONE)
    }
}

fn level(point: &HashedPoint<f64>) -> f64 {
    -(point.hash_scale * length(point.ddx).max(length(point.ddy))).log2()
}

/// The finest scale of cells that are equally wide along all axes.
fn finest_scale(point: &HashedPoint<f64>) -> i32 {
    finest(point).into_iter().min().expect("three axes")
}

/// Blends two scales as the kernel does, but hashes cells with `hash`.
fn blend(point: &HashedPoint<f64>, level: f64, hash: impl Fn([u32; 3], i32) -> [f64; 4]) -> [f64; 4] {
    // As in the kernel: at the finest level, there is no finer scale. So the two scales are the finest level and the next coarser one.
    let finest = finest_scale(point);
    let k = if level == f64::from(finest) { finest - 1 } else { level.floor() as i32 };
    let units = |k: i32| hash(cell(point, [k; 3]), k);
    TwoScales { coarse: units(k), fine: units(k + 1), lerp_factor: level - f64::from(k) }.thresholds()
}

fn pcg4d([x, y, z]: [u32; 3], k: i32, seed: u32, salt: u32) -> [f64; 4] {
    hash::pcg4d([x, y, z, hash::mix(seed, salt, (k + 128) as u32 * 0x01_01_01)]).map(hash::to_unit)
}

fn fract_sin(cell: [u32; 3], k: i32, seed: u32, salt: u32) -> [f64; 4] {
    let [x, y, z] = cell.map(|c| c as i32 as f32);
    std::array::from_fn(|decision| {
        let which = (seed % 1024) as f32 * 1.37 + salt as f32 * 5.71 + k as f32 * 2.93 + decision as f32 * 9.17;
        let word = (x * 12.9898 + y * 78.233 + z * 37.719 + which).sin() * 43_758.547;
        f64::from(word - word.floor()).min(BELOW_ONE)
    })
}

#[test]
fn mutants_differ_by_their_line_only() {
    // The mutants contain copies of parts of the kernel: the choice of scales, the blend and the hash. If the mistake has no effect, they must agree
    // with the kernel.
    for i in 0..10_000 {
        let ask = scattered(ORIGINS[2].1, i);
        let kernel = hashed_isotropic(&ask.point, ask.seed, ask.salt);
        let range = [LEVEL_MIN, finest_scale(&ask.point)].map(f64::from);
        let inside = (range[0]..range[1]).contains(&level(&ask.point));
        assert!(!inside || Mutant::NotClamped.thresholds(&ask) == kernel, "{ask:?}");
        let clamped = level(&ask.point).clamp(range[0], range[1]);
        assert_eq!(blend(&ask.point, clamped, |cell, k| pcg4d(cell, k, ask.seed, ask.salt)), kernel, "{ask:?}");
        assert_eq!(Mutant::Reseeded.thresholds(&Ask { frame: 0, ..ask }), kernel);
        // At these points, the derivative along x is longer than the one along y, and the kernel uses only the longer one. So this mistake makes no
        // difference.
        assert_eq!(Mutant::DpdxTwice.thresholds(&ask), kernel, "{ask:?}");
    }
}

/// Returns the names of the statistics whose values are outside their accepted range.
fn rejecting(rows: &[Row]) -> BTreeSet<String> {
    rows.iter().filter(|row| !row.holds()).map(|row| row.statistic.clone()).collect()
}

/// Returns the statistics in `measured` that are outside the budgets of hashed noise for this ground and motion.
fn out_of_budget(budgets: &[Row], ground: &str, motion: Motion, measured: Measured) -> Vec<Row> {
    let of = |(statistic, value): (&str, f64)| {
        let budget = budgets
            .iter()
            .find(|row| [&*row.kind, &*row.view, &*row.motion, &*row.statistic] == ["hashed", ground, motion.name(), statistic]);
        Row { value, statistic: format!("{statistic}, {ground}"), ..budget.expect("the table has it").clone() }
    };
    measured.statistics().map(of).into_iter().filter(|row| !row.holds()).collect()
}

const FLIPS: &str = "flip_rate, flat";
const CLUMPING: &str = "clumping, flat";
const POWER: &str = "power 0.0625-0.125 cycles/px, flat";

/// A mutant, the statistics that must reject it, and the statistics that must not reject it. All other statistics may reject it or not.
type Verdict = (Mutant, &'static [&'static str], &'static [&'static str]);

/// The statistics that are measured without a camera, except those for footprints beyond the coarsest and the finest scale.
const DRAWS: [&str; 7] =
    ["uniform, chi-square p", "uniform, ks p", "independent p", "uncorrelated p", "coverage p", "coverage by footprint p", "collisions p"];

const VERDICTS: [Verdict; 5] = [
    // Only statistics with a camera detect this mutant, and only on level ground: on a steep wall it makes little difference.
    (Mutant::DpdxTwice, &[FLIPS, CLUMPING, POWER], &["equal thresholds", "distinct thresholds", "flip_rate, 60 deg"]),
    // The flip rate is measured 10 km from the origin, where it does not detect this mutant.
    (Mutant::FractSin, &["collisions p", "independent p", "uncorrelated p", "distinct thresholds"], &[FLIPS, "equal thresholds"]),
    (Mutant::NotClamped, &["equal thresholds", "distinct thresholds"], &[FLIPS, CLUMPING, POWER]),
    (
        Mutant::Correction(Forgotten::All),
        &["uniform, chi-square p", "uniform, ks p", "coverage p", "coverage by footprint p"],
        &["uncorrelated p", "collisions p", "equal thresholds", "distinct thresholds", FLIPS, CLUMPING, POWER],
    ),
    (Mutant::Reseeded, &[FLIPS, "flip_rate, 60 deg"], &["equal thresholds", "distinct thresholds", CLUMPING]),
];

#[test]
fn no_mutant_passes() {
    let start = Instant::now();
    let budgets = recorded();
    let of = VERDICTS.map(|(mutant, ..)| move |ask: &Ask| mutant.thresholds(ask));
    let kernel = of_kind(NoiseKind::HashedIsotropic);
    let noises: Vec<Noise<'_>> = std::iter::once(&kernel as Noise<'_>).chain(of.iter().map(|noise| noise as Noise<'_>)).collect();
    let mut moving: Vec<Vec<Row>> = vec![Vec::new(); noises.len()];
    let stages = Motion::ALL.map(|motion| (GROUNDS[0], motion)).into_iter().chain([(GROUNDS[2], Motion::Sideways)]);
    for (ground, motion) in stages {
        for (rows, measured) in moving.iter_mut().zip(measure(ground, motion, ORIGINS[1].1, &noises)) {
            rows.extend(out_of_budget(&budgets, ground.name, motion, measured));
        }
    }
    assert_eq!(moving.remove(0), [], "the kernel is out of its budgets");

    let mut all: Vec<BTreeSet<String>> = Vec::new();
    for (((mutant, must, must_not), noise), moving) in VERDICTS.iter().zip(&of).zip(&moving) {
        // Only the hash in f32 depends on the distance from the origin, so only that mutant is tested at two distances.
        let origins = if *mutant == Mutant::FractSin { &[ORIGINS[0], ORIGINS[2]] } else { &ORIGINS[2..] };
        let mut rows = of_noise(NoiseKind::HashedIsotropic, noise, origins);
        hold_as_family(&mut rows);
        if *mutant == Mutant::FractSin {
            for (name, _) in origins {
                let p = |row: &&Row| row.view == *name && row.motion == "threshold 0";
                println!("{mutant:?}: {:?}", rows.iter().filter(p).map(|row| (&row.view, &row.statistic, row.value)).collect::<Vec<_>>());
                // The tests must reject the mutant at each distance.
                let rejected = |statistic: &str| rows.iter().any(|row| row.view == *name && row.statistic == statistic && !row.holds());
                assert!(rejected("collisions p") && rejected("independent p"), "{name}");
            }
        }
        rows.extend_from_slice(moving);
        let rejected = rejecting(&rows);
        println!("{mutant:?}: {rejected:?}");
        assert!(must.iter().all(|name| rejected.contains(*name)), "{mutant:?} passed one of {must:?}: {rejected:?}");
        assert!(must_not.iter().all(|name| !rejected.contains(*name)), "{mutant:?} failed one of {must_not:?}: {rejected:?}");
        if matches!(mutant, Mutant::DpdxTwice | Mutant::NotClamped | Mutant::Reseeded) {
            assert!(DRAWS.iter().all(|name| !rejected.contains(*name)), "{mutant:?} must pass the tests without a camera: {rejected:?}");
        }
        all.push(rejected);
    }
    // No statistic rejects all mutants, which is why several are necessary.
    let shared = all.iter().skip(1).fold(all[0].clone(), |shared, rejected| &shared & rejected);
    assert!(shared.is_empty(), "{shared:?} alone rejects all mutants");
    // The flip rate must reject the mutant with a different seed per frame in every case, and the mutant with the wrong derivative in every case in
    // which the camera moves.
    for (k, motions) in [(0, &Motion::ALL[1..]), (4, &Motion::ALL[..])] {
        let told = |motion: &Motion| moving[k].iter().any(|row| row.statistic == FLIPS && row.motion == motion.name());
        assert!(motions.iter().all(told), "{:?}: {:?}", VERDICTS[k].0, moving[k]);
    }

    // At 1000 km from the origin, the argument of the sine is so large that f32 cannot distinguish neighbouring cells. Many cells get the same value,
    // so choices flip too rarely, and neighbouring pixels often make the same choice (clumping).
    let far = measure(GROUNDS[0], Motion::Sideways, ORIGINS[2].1, &[&kernel, &of[1]]);
    println!("1000 km: {far:.4?}");
    let [kernel, sine] = [far[0], far[1]].map(|measured| rejecting(&out_of_budget(&budgets, "flat", Motion::Sideways, measured)));
    assert!(!kernel.contains(FLIPS) && !kernel.contains(CLUMPING), "{kernel:?}");
    assert!([FLIPS, CLUMPING, POWER].iter().all(|name| sine.contains(*name)), "{sine:?}");
    println!("in {:.1?}", start.elapsed());
}

#[test]
fn every_part_of_the_correction_is_needed() {
    for forgotten in [Forgotten::Middle, Forgotten::Half, Forgotten::Min] {
        let mut rows = scattered_rows(NoiseKind::HashedIsotropic, &|ask| Mutant::Correction(forgotten).thresholds(ask), &ORIGINS[2..]);
        hold_as_family(&mut rows);
        let rejected = rejecting(&rows);
        let must = ["uniform, chi-square p", "uniform, ks p", "coverage p"];
        assert!(must.iter().all(|name| rejected.contains(*name)), "{forgotten:?} passed: {rejected:?}");
    }
}

//! Tests whether the thresholds of each kind of noise behave as random numbers, as far as this is intended. A threshold is a number in [0, 1) that
//! decides a random choice. Random thresholds are uniform and independent of neighbouring thresholds. For each tested probability alpha, the share of
//! thresholds below alpha should be alpha (coverage).
//!
//! All kinds are tested with samples over seeds: thresholds must be uniform, and the four thresholds of a call must be independent. For all kinds,
//! thresholds of two seeds, and thresholds of two salts, must also be independent.
//!
//! Kinds bound to the ground ([`is_of_ground`]) are also tested with samples over places, at three distances from the origin. White noise of the
//! screen is also tested with samples over pixels and frames. Interleaved gradient noise and the masks (the two kinds of blue noise) are not, apart
//! from collisions (see below). They arrange the thresholds of neighbouring pixels and frames on purpose, so these thresholds are dependent and far
//! more evenly distributed than random numbers.
//!
//! The number of collisions (equal thresholds) shows whether all 24 bits of a threshold are random. Collisions are tested for kinds that draw a new
//! number at each place, and for the masks, which add a random jitter at each pixel. They are not tested for interleaved gradient noise, whose
//! lattice contains each value once.

use kernels::shared::noise::{self, HashedPoint, NoiseKind, WORLD_LEVEL};
use kernels::shared::real::scale;
use rayon::prelude::*;

use super::statistics::{Random, coverage_p, distinct, distinct_p, independent_p, uncorrelated_p, uniform_bins_p, uniform_ks_p};
use super::{Row, hashes, hold_as_family};

/// Number of samples of each test.
pub const SAMPLES: u32 = 1_000_000;
/// Side of a sector (a square with its own local coordinates), metres.
pub const SECTOR_M: f64 = 64.0;
/// A distance from the origin along x and y, as text, and the index of a sector at this distance. For noise of the screen, the text is `screen` and
/// the index has no effect.
pub type Origin = (&'static str, i32);
/// The distances from the origin at which kinds bound to the ground are tested.
pub const ORIGINS: [Origin; 3] = [("0 km", 0), ("10 km", 156), ("1000 km", 15_625)];
/// The values of alpha for which coverage is tested.
pub const ALPHAS: [f64; 9] = [0.01, 0.05, 0.1, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99];
/// Slopes of the ground on which coverage is tested, degrees.
pub const SLOPES_DEG: [f64; 4] = [0.0, 30.0, 60.0, 85.0];
/// The footprints for which coverage is tested: whole octaves, log2 of metres. They extend beyond the smallest and the largest scale of the noise.
pub const OCTAVES: std::ops::Range<i32> = -17..6;
/// Number of samples for each pair of an octave and a slope. The standard error of the coverage is at most 0.1 % for a single pair, and at most about
/// 0.01 % for the mean over all 92 pairs.
pub const PER_CELL: u32 = 250_000;
/// Side of the cells in tests of neighbouring places, metres. White noise of the world has cells of this size.
const CELL_M: f64 = 1.0 / 16.0;
const SEED: u32 = 11;
const SALT: u32 = 5;

/// The arguments for which a noise returns its thresholds: a point of the ground, a pixel, a frame, a seed and a salt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ask {
    /// The point of the ground.
    pub point: HashedPoint<f64>,
    /// The pixel that shows the point.
    pub pixel: [u32; 2],
    /// The frame.
    pub frame: u32,
    /// Seed.
    pub seed: u32,
    /// Salt.
    pub salt: u32,
}

/// The noise under test: a function that returns four thresholds in [0, 1).
pub type Noise<'a> = &'a (dyn Fn(&Ask) -> [f64; 4] + Sync);

/// Returns the noise of the renderer for a kind.
pub fn of_kind(kind: NoiseKind) -> impl Fn(&Ask) -> [f64; 4] + Sync {
    move |ask| noise::thresholds(kind, &ask.point, WORLD_LEVEL, ask.pixel, ask.frame, ask.seed, ask.salt)
}

/// Whether a kind of noise is bound to the ground. Its thresholds then do not depend on the frame and the pixel.
pub fn is_of_ground(kind: NoiseKind) -> bool {
    matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic | NoiseKind::WhiteWorld)
}

/// Whether a kind of noise hashes cells whose size follows the footprint.
pub fn is_hashed(kind: NoiseKind) -> bool {
    matches!(kind, NoiseKind::HashedIsotropic | NoiseKind::HashedAnisotropic)
}

fn row(kind: NoiseKind, view: &str, motion: &str, statistic: &str, value: f64) -> Row {
    let [view, motion, statistic] = [view, motion, statistic].map(str::to_owned);
    Row { kind: kind.name().to_owned(), view, motion, statistic, value, low: 0.0, high: 1.0 }
}

/// Returns a random place at most some 260 km from a sector along each axis, with a random footprint, pixel and frame. The places are so far apart
/// that a cell rarely contains two of them, even if it has the largest size.
pub fn scattered(sector: i32, i: u32) -> Ask {
    let mut random = Random(u64::from(i) << 20 ^ u64::from(sector.cast_unsigned()) << 40);
    let footprint = random.between(f64::from(OCTAVES.start), f64::from(OCTAVES.end)).exp2();
    somewhere(&mut random, sector, footprint, 0.0)
}

/// Returns a random place within 4096 sectors of a sector along each axis, on ground with the given slope. The longer derivative has a length of
/// `footprint` metres.
fn somewhere(random: &mut Random, sector: i32, footprint: f64, slope_deg: f64) -> Ask {
    #[allow(clippy::cast_possible_truncation, clippy::cast_possible_wrap, reason = "small")]
    let mut place = |around: i32| around + random.below(8192) as i32 - 4096;
    let sector = [place(sector), place(-sector)];
    // The two derivatives have random directions in the plane of the ground. The plane rises in a random compass direction.
    let (sin, cos) = slope_deg.to_radians().sin_cos();
    let (to_sin, to_cos) = random.between(0.0, std::f64::consts::TAU).sin_cos();
    let mut along = |length: f64| {
        let (s, c) = random.between(0.0, std::f64::consts::TAU).sin_cos();
        scale([c * to_sin + s * cos * to_cos, s * cos * to_sin - c * to_cos, s * sin], length)
    };
    let ddx = along(footprint);
    let ddy = along(footprint);
    let shorter = random.unit();
    #[allow(clippy::cast_possible_truncation, reason = "small")]
    let mut whole = |n: usize| random.below(n) as u32;
    let (pixel, frame) = ([whole(7680), whole(4320)], whole(1 << 20));
    let position = [random.between(0.0, SECTOR_M), random.between(0.0, SECTOR_M), random.between(0.0, 3000.0)];
    let point = HashedPoint { sector, position, sector_m: SECTOR_M, ddx, ddy: scale(ddy, shorter), hash_scale: 1.0 };
    Ask { point, pixel, frame, seed: SEED, salt: SALT }
}

/// Returns the place of cell `i` in a lattice with `sides` cells along x and y. The footprint is chosen so that noise which follows the footprint has
/// exactly these cells. The pixel has the column and row of the cell, and the frame follows from the layer of the cell.
fn corner(kind: NoiseKind, sector: i32, sides: [u32; 2], i: u32) -> Ask {
    let [x, y, z] = [i % sides[0], i / sides[0] % sides[1], i / sides[0] / sides[1]];
    // Along each axis, the place is a twentieth of a cell above a multiple of the cell's size, so that rounding does not move it into a neighbouring
    // cell.
    let at = |n: u32| (f64::from(n) + 0.05) * CELL_M;
    let point = HashedPoint {
        sector: [sector, -sector],
        position: [at(x), at(y), 100.0 + at(z)],
        sector_m: SECTOR_M,
        ddx: [CELL_M; 3],
        ddy: [0.0; 3],
        // This value makes the level, which is log2 of the number of cells per metre, a whole number for the two kinds that follow the
        // footprint. The isotropic kind uses the length of `ddx`, which is sqrt(3) cells. The anisotropic kind multiplies the extent along
        // each axis by sqrt(2).
        hash_scale: if kind == NoiseKind::HashedAnisotropic { 0.5_f64.sqrt() } else { 3_f64.sqrt().recip() },
    };
    Ask { point, pixel: [x, y], frame: 5 + z, seed: SEED, salt: SALT }
}

/// Returns the place of cell `i` on a plane of 1000 x 1000 cells. Each cell has a different pixel.
fn on_plane(kind: NoiseKind, sector: i32, i: u32) -> Ask {
    corner(kind, sector, [1000, 1000], i)
}

/// Returns a place whose cell at the next finer scale has the same integer coordinates as the cell of `ask` at its own scale. A test uses this place
/// to check that scales are independent, so equal coordinates must be hashed differently at different scales.
fn next_scale(ask: &Ask) -> Ask {
    let mut finer = *ask;
    for axis in 0..2 {
        let sector = ask.point.sector[axis];
        finer.point.sector[axis] = sector.div_euclid(2);
        finer.point.position[axis] += SECTOR_M * f64::from(sector.rem_euclid(2));
    }
    finer.point.position = finer.point.position.map(|x| x / 2.0);
    finer.point.ddx = finer.point.ddx.map(|x| x / 2.0);
    finer
}

fn sample(noise: Noise<'_>, asks: impl Fn(u32) -> Ask + Sync) -> Vec<[f64; 4]> {
    (0..SAMPLES).into_par_iter().map(|i| noise(&asks(i))).collect()
}

/// Tests samples that must be independent random numbers. The four thresholds must be uniform and independent of each other, and for each alpha, the
/// share of samples whose first threshold is below alpha must be alpha.
fn of_samples(kind: NoiseKind, view: &str, samples: &[[f64; 4]]) -> Vec<Row> {
    let column = |k: usize| samples.iter().map(|s| s[k]).collect::<Vec<f64>>();
    let uniform = (0..4_usize).into_par_iter().flat_map_iter(|k| {
        let (u, name) = (column(k), format!("threshold {k}"));
        [("uniform, chi-square p", uniform_bins_p(&u)), ("uniform, ks p", uniform_ks_p(&u))]
            .map(|(statistic, p)| row(kind, view, &name, statistic, p))
    });
    let two: Vec<(usize, usize)> = (0..4).flat_map(|j| (0..j).map(move |i| (i, j))).collect();
    let independent = two.into_par_iter().flat_map_iter(|(i, j)| {
        let pairs: Vec<(f64, f64)> = samples.iter().map(|s| (s[i], s[j])).collect();
        of_pairs(kind, view, &format!("thresholds {i} and {j}"), &pairs)
    });
    let covered = ALPHAS.par_iter().map(|&alpha| {
        let covered = samples.iter().filter(|s| s[0] < alpha).count() as u64;
        row(kind, view, &format!("alpha {alpha}"), "coverage p", coverage_p(covered, samples.len() as u64, alpha))
    });
    uniform.chain(independent).chain(covered).collect()
}

fn of_pairs(kind: NoiseKind, view: &str, motion: &str, pairs: &[(f64, f64)]) -> [Row; 2] {
    [("independent p", independent_p(pairs)), ("uncorrelated p", uncorrelated_p(pairs))]
        .map(|(statistic, p)| row(kind, view, motion, statistic, p))
}

/// Returns the distances from the origin at which places are sampled. They are sampled only if the thresholds of different places are independent
/// random numbers. Kinds bound to the ground are sampled at the given distances. White noise of the screen does not depend on the distance, so there
/// is one entry. Interleaved gradient noise and masks have none.
fn places(kind: NoiseKind, origins: &[Origin]) -> &[Origin] {
    match kind {
        _ if is_of_ground(kind) => origins,
        NoiseKind::WhiteScreen => &[("screen", 0)],
        _ => &[],
    }
}

/// Tests uniformity, the independence of the four thresholds, and coverage. The samples are taken over seeds. If the thresholds of different places
/// are independent random numbers, samples are also taken over places.
pub fn scattered_rows(kind: NoiseKind, noise: Noise<'_>, origins: &[Origin]) -> Vec<Row> {
    let mut rows = Vec::new();
    for &(name, sector) in places(kind, origins) {
        rows.extend(of_samples(kind, name, &sample(noise, |i| scattered(sector, i))));
    }
    rows.extend(of_samples(kind, "seeds", &sample(noise, |i| Ask { seed: i, ..scattered(ORIGINS[2].1, i) })));
    rows
}

/// A change of the noise's input: its name, and the function that makes it.
type Change = (&'static str, fn(&Ask) -> Ask);

const OF_SEEDS: [Change; 3] = [
    ("seed + 1", |ask| Ask { seed: ask.seed.wrapping_add(1), ..*ask }),
    ("salt + 1", |ask| Ask { salt: ask.salt.wrapping_add(1), ..*ask }),
    ("seed and salt swapped", |ask| Ask { seed: ask.salt, salt: ask.seed, ..*ask }),
];
const OF_PLACES: [Change; 3] = [("x", |ask| beside(ask, 0)), ("y", |ask| beside(ask, 1)), ("z", |ask| beside(ask, 2))];
const OF_SCALES: [Change; 1] = [("scale", next_scale)];

/// Moves to the next cell along an axis. Also moves to the next pixel (axes 0 and 1) or frame (axis 2), which affects noise of the screen.
fn beside(ask: &Ask, axis: usize) -> Ask {
    let mut next = *ask;
    next.point.position[axis] += CELL_M;
    match axis {
        2 => next.frame += 1,
        _ => next.pixel[axis] += 1,
    }
    next
}

/// Tests whether thresholds change independently if an input changes. The inputs are the place, the scale (hashed kinds only), the seed and the salt;
/// in another test, seed and salt are swapped. For noise of the screen, steps along x and y lead to the next pixel, and a step along z leads to the
/// next frame. The samples are taken over a lattice of cells or pixels. For interleaved gradient noise and masks, they are taken over seeds, and only
/// changes of seed and salt are tested.
pub fn neighbour_rows(kind: NoiseKind, noise: Noise<'_>, origins: &[Origin]) -> Vec<Row> {
    let mut rows = Vec::new();
    let mut pair = |view: &str, changes: &[Change], asks: &(dyn Fn(u32) -> Ask + Sync)| {
        let here: Vec<f64> = (0..SAMPLES).into_par_iter().map(|i| noise(&asks(i))[0]).collect();
        for (name, change) in changes {
            let there = (0..SAMPLES).into_par_iter().map(|i| noise(&change(&asks(i)))[0]);
            let pairs: Vec<(f64, f64)> = here.par_iter().copied().zip(there).collect();
            rows.extend(of_pairs(kind, view, name, &pairs));
        }
    };
    let scales: &[Change] = if is_hashed(kind) { &OF_SCALES } else { &[] };
    let changes = [&OF_PLACES[..], &OF_SEEDS, scales].concat();
    let places = places(kind, origins);
    for &(name, sector) in places {
        pair(name, &changes, &|i| corner(kind, sector, [100, 100], i));
    }
    if places.is_empty() {
        pair("seeds", &OF_SEEDS, &|i| Ask { seed: i, ..scattered(0, i) });
    }
    rows
}

/// Counts the distinct first thresholds in a plane of a million cells or pixels, and compares the count with that of independent random numbers of 24
/// bits.
pub fn collision_rows(kind: NoiseKind, noise: Noise<'_>, origins: &[Origin]) -> Vec<Row> {
    let places = if kind.needs_mask() { &[("screen", 0)] } else { places(kind, origins) };
    let of_place = |&(name, sector): &Origin| {
        let first: Vec<f64> = sample(noise, |i| on_plane(kind, sector, i)).iter().map(|s| s[0]).collect();
        row(kind, name, "plane of 1e6", "collisions p", distinct_p(distinct(&first), first.len()))
    };
    places.iter().map(of_place).collect()
}

/// Tests the size of cells at both ends of the range of scales. Only kinds that follow the footprint are tested.
///
/// If the footprint is longer than a sector, two places that are 37 sectors apart must lie in different cells. If the footprint is very small, cells
/// must be as small as the precision of the coordinates allows, and no smaller. At an elevation of 2000 m, this is a height of 2^-8 m, which is 32
/// times the spacing of f32 numbers there. At sea level, the cells of anisotropic noise are 2^-16 m high, the smallest of all sizes. The cells of
/// isotropic noise have the same size along all axes. They are 2^-13 m high, because the coordinates in a sector reach 64 m.
pub fn range_rows(kind: NoiseKind, noise: Noise<'_>, origins: &[Origin]) -> Vec<Row> {
    if !is_hashed(kind) {
        return Vec::new();
    }
    let mut rows = Vec::new();
    for &(name, sector) in origins {
        let equal = |i: &u32| {
            let mut random = Random(u64::from(*i) << 20);
            let footprint = random.between(6.0, 10.0).exp2();
            let mut ask = somewhere(&mut random, sector, footprint, 0.0);
            let here = noise(&ask);
            ask.point.sector[0] += 37;
            here == noise(&ask)
        };
        let share = (0..SAMPLES / 10).into_par_iter().filter(equal).count() as f64 / f64::from(SAMPLES / 10);
        // The four thresholds of a cell have 96 random bits together. The thresholds of two different cells are therefore practically never all
        // equal.
        rows.push(Row { high: 0.0, ..row(kind, name, "37 sectors", "equal thresholds", share) });
    }
    // A metre of elevation should have `cells` + 1 distinct thresholds. Borders between cells lie a third of a cell above multiples of the cell's
    // height, so a metre that begins at a whole number intersects one cell more than the number of cells per metre. A few thresholds may be equal by
    // chance. Among n random numbers of 24 bits, n² / 2^25 on average repeat an earlier number: 128 of 65 536, with a standard deviation of 11, and
    // 0.002 of 257. The test accepts up to 200 repetitions at sea level, and up to 2 at 2000 m.
    let at_sea: u32 = if kind == NoiseKind::HashedAnisotropic { 1 << 16 } else { 1 << 13 };
    for (view, from_m, cells, repeated) in [("2000 m", 2000.0, 1 << 8, 2), ("0 m", 0.0, at_sea, 200)] {
        let close = |i: u32| {
            let mut ask = scattered(ORIGINS[1].1, 1);
            ask.point.position[2] = from_m + f64::from(i) / f64::from(SAMPLES);
            (ask.point.ddx, ask.point.ddy) = ([(-24.0_f64).exp2(); 3], [0.0; 3]);
            ask
        };
        let first: Vec<f64> = sample(noise, close).iter().map(|s| s[0]).collect();
        let range = Row {
            low: f64::from(cells + 1 - repeated),
            high: f64::from(cells + 1),
            ..row(kind, view, "1 m up", "distinct thresholds", 0.0)
        };
        rows.push(Row { value: distinct(&first) as f64, ..range });
    }
    rows
}

/// Tests coverage for each alpha, each slope of the ground and each octave of the footprint, 1000 km from the origin. Each test uses [`PER_CELL`]
/// thresholds, four per call of the noise. Only kinds that follow the footprint are tested.
pub fn coverage_rows(kind: NoiseKind, noise: Noise<'_>) -> Vec<Row> {
    if !is_hashed(kind) {
        return Vec::new();
    }
    let cells: Vec<(i32, f64)> = OCTAVES.flat_map(|octave| SLOPES_DEG.map(|slope| (octave, slope))).collect();
    let of_cell = |(octave, slope): (i32, f64)| {
        let mut random = Random(u64::from(octave.cast_unsigned()) << 32 ^ slope.to_bits());
        let mut covered = [0_u64; ALPHAS.len()];
        for _ in 0..PER_CELL / 4 {
            let footprint = (f64::from(octave) + random.unit()).exp2();
            let thresholds = noise(&somewhere(&mut random, ORIGINS[2].1, footprint, slope));
            for (covered, alpha) in covered.iter_mut().zip(ALPHAS) {
                *covered += thresholds.iter().filter(|u| **u < alpha).count() as u64;
            }
        }
        let view = format!("2^{octave} m, {slope} deg");
        std::array::from_fn::<Row, { ALPHAS.len() }, _>(|i| {
            let p = coverage_p(covered[i], u64::from(PER_CELL), ALPHAS[i]);
            row(kind, &view, &format!("alpha {}", ALPHAS[i]), "coverage by footprint p", p)
        })
    };
    cells.into_par_iter().flat_map_iter(of_cell).collect()
}

/// Runs the tests of this module on one noise. `noise` is the function under test. `kind` selects the tests, and its name is stored in the rows.
/// `origins` are the distances from the origin at which kinds bound to the ground are tested over places.
pub fn of_noise(kind: NoiseKind, noise: Noise<'_>, origins: &[Origin]) -> Vec<Row> {
    let mut rows = coverage_rows(kind, noise);
    for judge in [scattered_rows, neighbour_rows, collision_rows, range_rows] {
        rows.extend(judge(kind, noise, origins));
    }
    rows
}

/// Tests the bits of the hashes, and every kind of noise at all distances from the origin. All p-values together have one significance level.
pub fn rows() -> Vec<Row> {
    let mut rows = hashes::rows();
    for kind in NoiseKind::ALL {
        rows.extend(of_noise(kind, &of_kind(kind), &ORIGINS));
    }
    hold_as_family(&mut rows);
    rows
}

//! How accurately codes store directions, and the effect on derivatives: means and suprema of the errors of octahedral codes, and the error of a
//! derivative from a stored plane, against its bound.

use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2};

use glam::DVec3;
use kernels::probe::Draw;
use kernels::shared::real::{dot, length, sub};
use kernels::shared::{derivatives, normal_pair, octahedral};
use kernels::view::camera::{Pose, View};
use rayon::prelude::*;

use super::Row;

/// Number of directions for means.
const DIRECTIONS: u32 = 1_000_000;
/// Numbers of bits of each of a code's two coordinates.
const BITS: [u32; 4] = [8, 10, 12, 16];
/// Mean errors that Cigolle et al. published (JCGT 3(2), 2014), degrees, for the nearest code of each coordinate. Only the values that available
/// quotations give.
const SURVEY: [(u32, f64); 3] = [(8, 0.337_09), (10, 0.083_80), (12, 0.020_91)];
/// Limits of the mean errors for fine codes, degrees times half the number of codes: for the nearest code of each coordinate, and for the nearest
/// direction (docs/stability-lab.md, section 1).
const MEAN: [f64; 2] = [42.79, 39.98];
/// Largest relative deviation of a mean from the published one.
const OF_MEAN: f64 = 0.005;
/// The supremum lies between the error attained at a code and the bound; this is their largest relative distance.
const OF_SUPREMUM: f64 = 1e-4;
/// Number of pixels at which derivatives are taken.
const PIXELS: u32 = 200_000;

fn row(kind: &str, view: String, motion: &str, statistic: &str, value: f64, [low, high]: [f64; 2]) -> Row {
    Row { kind: kind.to_owned(), view, motion: motion.to_owned(), statistic: statistic.to_owned(), value, low, high }
}

/// Angle between unit vectors, radians, from their distance, which keeps its digits where the angle is small.
fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    2.0 * (0.5 * length(sub(a, b))).min(1.0).asin()
}

/// How a code is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rounding {
    /// The nearest code of each coordinate.
    Fast,
    /// The nearest direction among the four surrounding codes.
    Exact,
}

impl Rounding {
    const ALL: [Rounding; 2] = [Rounding::Fast, Rounding::Exact];

    fn name(self) -> &'static str {
        match self {
            Rounding::Fast => "fast",
            Rounding::Exact => "exact",
        }
    }

    fn code(self, n: [f64; 3], bits: u32) -> [u32; 2] {
        match self {
            Rounding::Fast => octahedral::quantise(octahedral::encode(n), bits),
            Rounding::Exact => octahedral::encode_precise(n, bits),
        }
    }

    /// Error of a direction, radians.
    fn error(self, n: [f64; 3], bits: u32) -> f64 {
        angle(octahedral::decode(octahedral::dequantise(self.code(n, bits), bits)), n)
    }

    /// Upper bound of the error, radians: a square of codes has half a diagonal of sqrt(6) / 2h in its face of the octahedron, and one of its two
    /// equilateral triangles has a covering radius of sqrt(2/3) / h; a face is at a distance of 1 / sqrt(3) from the centre (docs/stability-lab.md,
    /// section 1).
    fn supremum(self, bits: u32) -> f64 {
        let h = f64::from(octahedral::half(bits));
        match self {
            Rounding::Fast => 3.0 * FRAC_1_SQRT_2 / h,
            Rounding::Exact => SQRT_2 / h,
        }
    }
}

/// Point `i` of an almost even lattice of `n` points on the sphere (González, "Measurement of Areas on a Sphere Using Fibonacci and
/// Latitude-Longitude Lattices", Mathematical Geosciences 42, 2010).
fn fibonacci(i: u32, n: u32) -> [f64; 3] {
    let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
    let turn = 2.0 * PI * (f64::from(i) * 0.618_033_988_749_894_9).fract();
    let r = (1.0 - z * z).sqrt();
    [r * turn.cos(), r * turn.sin(), z]
}

/// Largest error attained at the codes next to the middle of a face, radians: at the corners of their squares, or at the centres of both triangles.
fn attained(rounding: Rounding, bits: u32) -> f64 {
    let h = f64::from(octahedral::half(bits));
    let middle = (h / 3.0).floor() as i32;
    let offsets = match rounding {
        // Slightly inside the square, so that its own code is the nearest.
        Rounding::Fast => vec![[0.499_999, 0.499_999], [0.499_999, -0.499_999], [-0.499_999, -0.499_999], [-0.499_999, 0.499_999]],
        Rounding::Exact => vec![[1.0 / 3.0, 1.0 / 3.0], [2.0 / 3.0, 2.0 / 3.0]],
    };
    let codes = (-4..=4).flat_map(|x| (-4..=4).map(move |y| [middle + x, middle + y]));
    codes
        .flat_map(|code| offsets.iter().map(move |offset| [0, 1].map(|i| (f64::from(code[i]) + offset[i]) / h)))
        .map(|e| rounding.error(octahedral::decode(e), bits))
        .fold(0.0, f64::max)
}

/// Mean errors over evenly spread directions against the survey, and suprema: the attained error against the upper bound.
pub fn octahedral_rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for bits in BITS {
        for rounding in Rounding::ALL {
            let view = format!("{bits} + {bits} bits");
            // The pieces have a fixed size, so that the sum does not depend on the number of threads.
            let pieces: Vec<[f64; 2]> = (0..DIRECTIONS.div_ceil(1000))
                .into_par_iter()
                .map(|piece| {
                    let errors = (1000 * piece..1000 * (piece + 1)).map(|i| rounding.error(fibonacci(i, DIRECTIONS), bits));
                    errors.fold([0.0, 0.0], |[sum, most], error| [sum + error, f64::max(most, error)])
                })
                .collect();
            let mean = pieces.iter().map(|piece| piece[0]).sum::<f64>() / f64::from(DIRECTIONS);
            let farthest = pieces.iter().map(|piece| piece[1]).fold(0.0, f64::max);
            let survey = SURVEY.iter().find(|(of, _)| *of == bits && rounding == Rounding::Fast).map(|(_, mean)| *mean);
            let law = MEAN[usize::from(rounding == Rounding::Exact)] / f64::from(octahedral::half(bits));
            let (name, around) = match survey {
                Some(mean) => ("mean against the survey, deg", mean),
                None => ("mean against the law, deg", law),
            };
            rows.push(row(
                "octahedral",
                view.clone(),
                rounding.name(),
                name,
                mean.to_degrees(),
                [1.0 - OF_MEAN, 1.0 + OF_MEAN].map(|x| x * around),
            ));
            let most = rounding.supremum(bits);
            let range = [(1.0 - OF_SUPREMUM) * most, most].map(f64::to_degrees);
            rows.push(row("octahedral", view.clone(), rounding.name(), "supremum, deg", attained(rounding, bits).to_degrees(), range));
            rows.push(row(
                "octahedral",
                view,
                rounding.name(),
                "farthest of a million, deg",
                farthest.to_degrees(),
                [0.0, most.to_degrees()],
            ));
        }
    }
    rows
}

/// How the plane of a pixel is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    /// 8 + 8 bits, the nearest direction; the shading normal has the same number of bits.
    Octahedral,
    /// The finer plane of the 32 bits that hold plane and shading normal.
    PlaneFirst,
}

/// A pixel that sees a plane.
struct Pixel {
    ray: [f64; 3],
    steps: [[f64; 3]; 2],
    normal: [f64; 3],
    shading: [f64; 3],
    incidence_deg: f64,
}

/// A pixel of a random camera: a field of view of 20 to 100 degrees, anywhere in the world, in any direction. The angle between ray and normal is
/// uniform within a range. The shading normal is a quarter of a degree to 8 degrees off, uniformly by octave. This matches rendered frames, except
/// that 4 in 100 pixels lie beyond (docs/stability-lab.md, section 3).
fn pixel(index: u32, [low, high]: [f64; 2]) -> Pixel {
    let mut draw = Draw { row: index, column: 0, table: 77 };
    let size = [1920, 1080];
    let pose = Pose {
        position: DVec3::new(draw.between(-5e3, 5e3), draw.between(-5e3, 5e3), draw.between(0.0, 3e3)),
        yaw: draw.between(0.0, 2.0 * PI),
        pitch: draw.between(-0.49 * PI, 0.49 * PI),
        fov: draw.between(20.0, 100.0).to_radians(),
    };
    let view = View::new(pose, size, [0.0, 0.0], 64.0, 10_240.0);
    let ray = view.ray(draw.whole(size[0]), draw.whole(size[1])).to_array();
    let incidence_deg = draw.between(low, high);
    let normal = draw.leaning(octahedral::unit(ray).map(|x| -x), incidence_deg.to_radians());
    // Terrain has no overhangs: if the normal points down, the world is mirrored.
    let upright = |v: [f64; 3]| if normal[2] < 0.0 { [v[0], v[1], -v[2]] } else { v };
    let (ray, normal) = (upright(ray), upright(normal));
    let steps = [view.ray_dx, view.ray_dy].map(|step| upright(step.to_array()));
    let deviation_deg = draw.between(-2.0, 3.0).exp2();
    let shading = draw.leaning(normal, deviation_deg.to_radians());
    Pixel { ray, steps, normal, shading, incidence_deg }
}

/// The errors at a pixel.
struct Error {
    incidence_deg: f64,
    /// Relative error of each of the two derivatives.
    relative: [f64; 2],
    /// Error of the mip level from the longer derivative, levels.
    mip: f64,
    /// The larger error as a share of its bound: |d' - d| / |d| <= sin(off) / |cos'|, where `off` is the angle between the planes and cos' the cosine
    /// between the stored normal and the neighbour's ray. Absent where a cosine was clamped.
    of_law: Option<f64>,
}

fn error(pixel: &Pixel, stored: Stored) -> Error {
    let Pixel { ray, normal, .. } = *pixel;
    let found = match stored {
        Stored::Octahedral => octahedral::decode(octahedral::dequantise(octahedral::encode_precise(normal, 8), 8)),
        Stored::PlaneFirst => {
            let word = normal_pair::encode(normal, ray, octahedral::encode_precise(pixel.shading, 8));
            normal_pair::decode::<f64>(word).plane
        }
    };
    let step = |i: usize, n: [f64; 3]| derivatives::on_plane(ray, pixel.steps[i], 1.0, n);
    let pairs = [0, 1].map(|i| [step(i, found), step(i, normal)]);
    let relative = pairs.map(|[got, want]| length(sub(got, want)) / length(want));
    let longest = |which: usize| length(pairs[0][which]).max(length(pairs[1][which]));
    let cosines = [0, 1].map(|i| {
        let neighbour = [0, 1, 2].map(|k| ray[k] + pixel.steps[i][k]);
        [found, normal].map(|n| (dot(n, neighbour) / length(neighbour)).abs())
    });
    let held = cosines.iter().flatten().any(|cosine| *cosine <= derivatives::MIN_COSINE);
    let side = if dot(found, normal) < 0.0 { found.map(|x| -x) } else { found };
    let sine = angle(side, normal).sin();
    let share = |i: usize| if sine > 0.0 { relative[i] * cosines[i][0] / sine } else { 0.0 };
    Error {
        incidence_deg: pixel.incidence_deg,
        relative,
        mip: (longest(0) / longest(1)).log2().abs(),
        of_law: (!held).then(|| share(0).max(share(1))),
    }
}

fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values[((values.len() - 1) as f64 * share).round() as usize]
}

/// Derivatives from stored planes of both kinds over random cameras; the angle between ray and normal is uniform in 0..85 degrees.
pub fn derivative_rows() -> Vec<Row> {
    let pixels: Vec<Pixel> = (0..PIXELS).into_par_iter().map(|i| pixel(i, [0.0, 85.0])).collect();
    let of = |stored| pixels.par_iter().map(|pixel| error(pixel, stored)).collect::<Vec<Error>>();
    let (octahedral, plane_first) = (of(Stored::Octahedral), of(Stored::PlaneFirst));
    let mut rows = Vec::new();
    let relative = |errors: &[Error], below: f64, share: f64| {
        let of_both = errors.iter().filter(|error| error.incidence_deg < below).flat_map(|error| error.relative);
        quantile(of_both.collect(), share)
    };
    let mip = |errors: &[Error], low: f64| {
        quantile(errors.iter().filter(|error| error.incidence_deg >= low).map(|error| error.mip).collect(), 0.99)
    };
    let law = |errors: &[Error]| errors.iter().filter_map(|error| error.of_law).fold(0.0, f64::max);
    for (name, errors) in [("octahedral 8 + 8", &octahedral), ("plane-first", &plane_first)] {
        let mut push =
            |view: &str, statistic: &str, value: f64, high: f64| rows.push(row(name, view.to_owned(), "", statistic, value, [0.0, high]));
        push("below 60 deg", "median error of a derivative, %", 100.0 * relative(errors, 60.0, 0.5), 1.0);
        push("below 85 deg", "median error of a derivative, %", 100.0 * relative(errors, 85.0, 0.5), 4.0);
        push("below 85 deg", "p95 error of a derivative, %", 100.0 * relative(errors, 85.0, 0.95), 20.0);
        push("below 85 deg", "p99 error of the mip, levels", mip(errors, 0.0), 0.15);
        push("82.5 to 85 deg", "p99 error of the mip, levels", mip(errors, 82.5), 0.15);
        // The margin covers rounding in f64, in differences of nearly equal vectors.
        push("below 85 deg", "largest share of the law's bound", law(errors), 1.0 + 1e-6);
    }
    for (statistic, share, least) in [("gain in the median", 0.5, 3.0), ("gain in p95", 0.95, 3.0)] {
        let gain = relative(&octahedral, 85.0, share) / relative(&plane_first, 85.0, share);
        rows.push(row("plane-first", "below 85 deg".to_owned(), "over octahedral 8 + 8", statistic, gain, [least, 1e3]));
    }
    rows
}

/// Steepness, degrees, at which the price of the bound on anisotropy is reported.
const STEEP_DEG: [f64; 6] = [88.0, 89.0, 89.43, 89.5, 89.9, 89.99];

/// The price of [`derivatives::MIN_COSINE`]: the number of levels by which a mip is finer than the plane requires, log2(bound / cosine).
pub fn bound_rows() -> Vec<Row> {
    let price = |degrees: f64| {
        // The camera looks straight ahead: a step up the plane, whose cosine equals that of the neighbour's ray.
        let cosine = degrees.to_radians().cos();
        let (ray, normal) = ([0.0, 1.0, 0.0], [0.0, -cosine, (1.0 - cosine * cosine).sqrt()]);
        let got = length(derivatives::on_plane(ray, [0.0, 0.0, 1e-9], 1.0, normal));
        let step = sub([0.0, 0.0, 1e-9], ray.map(|x| x * dot(normal, [0.0, 0.0, 1e-9]) / dot(normal, ray)));
        (length(step) / got).log2()
    };
    STEEP_DEG
        .map(|degrees| {
            let expected = (derivatives::MIN_COSINE / degrees.to_radians().cos()).log2().max(0.0);
            row(
                "derivatives",
                format!("{degrees} deg"),
                "",
                "finer than the plane asks, levels",
                price(degrees),
                [expected - 0.01, expected + 0.01],
            )
        })
        .into()
}

/// All rows; this takes some seconds on two cores.
pub fn rows() -> Vec<Row> {
    [octahedral_rows(), derivative_rows(), bound_rows()].concat()
}

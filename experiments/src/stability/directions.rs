//! Measures how accurately directions are stored, and how the errors affect derivatives. An octahedral encoding projects a direction to an octahedron
//! and stores two coordinates as integers. The two integers are the *code* of the direction. The results are rows with the mean and the largest
//! errors of stored directions. Other rows contain the errors of derivatives that are computed from a stored plane, and compare these errors with an
//! upper bound.

use std::f64::consts::{FRAC_1_SQRT_2, PI, SQRT_2};

use glam::DVec3;
use kernels::probe::Draw;
use kernels::shared::real::{dot, length, sub};
use kernels::shared::{derivatives, normal_pair, octahedral};
use kernels::view::camera::{Pose, View};
use rayon::prelude::*;

use super::Row;

/// Number of directions over which errors are averaged.
const DIRECTIONS: u32 = 1_000_000;
/// The tested numbers of bits for each of the two coordinates.
const BITS: [u32; 4] = [8, 10, 12, 16];
/// Mean errors that Cigolle et al. published (JCGT 3(2), 2014) for codes whose coordinates are rounded separately. An entry contains the number of
/// bits of each coordinate, and the error in degrees. The list contains only the published values that were available as quotations.
const SURVEY: [(u32, f64); 3] = [(8, 0.337_09), (10, 0.083_80), (12, 0.020_91)];
/// Constants from which the mean error for many bits follows, degrees: the mean error approaches the constant divided by `octahedral::half(bits)`.
/// The first constant applies to [`Rounding::Fast`], the second to [`Rounding::Exact`] (docs/stability-lab.md, section 1).
const MEAN: [f64; 2] = [42.79, 39.98];
/// Largest accepted relative deviation of a mean error from the published value. If no value was published, the deviation is measured from the value
/// that [`MEAN`] gives.
const OF_MEAN: f64 = 0.005;
/// Largest accepted relative difference between the largest error at tested directions and the upper bound of the error. The supremum of the error
/// lies between these two numbers.
const OF_SUPREMUM: f64 = 1e-4;
/// Number of pixels at which derivatives are computed.
const PIXELS: u32 = 200_000;

fn row(kind: &str, view: String, motion: &str, statistic: &str, value: f64, [low, high]: [f64; 2]) -> Row {
    Row { kind: kind.to_owned(), view, motion: motion.to_owned(), statistic: statistic.to_owned(), value, low, high }
}

/// Returns the angle between two unit vectors, radians. It is computed from the length of their difference. The arc cosine of their scalar product
/// would be inaccurate for small angles.
fn angle(a: [f64; 3], b: [f64; 3]) -> f64 {
    2.0 * (0.5 * length(sub(a, b))).min(1.0).asin()
}

/// The method by which the code of a direction is chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Rounding {
    /// Each coordinate is rounded to its nearest value.
    Fast,
    /// The nearest direction among the four codes around the exact coordinates is chosen.
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

    /// Returns the angle between a direction and its stored version, radians.
    fn error(self, n: [f64; 3], bits: u32) -> f64 {
        angle(octahedral::decode(octahedral::dequantise(self.code(n, bits), bits)), n)
    }

    /// Returns the upper bound of the error, radians. Let h be `octahedral::half(bits)`. Neighbouring codes are 1 / h apart along each coordinate. On
    /// a face of the octahedron, the square between four codes is a rhombus of two equilateral triangles, whose longer diagonal is sqrt(6) / h. Fast
    /// rounding moves a point by at most half this diagonal. Exact rounding moves it by at most the circumradius of a triangle, which is sqrt(2/3) /
    /// h. The middle of a face is 1 / sqrt(3) from the centre of the octahedron, so there a small angle is the distance on the face times sqrt(3)
    /// (docs/stability-lab.md, section 1).
    fn supremum(self, bits: u32) -> f64 {
        let h = f64::from(octahedral::half(bits));
        match self {
            Rounding::Fast => 3.0 * FRAC_1_SQRT_2 / h,
            Rounding::Exact => SQRT_2 / h,
        }
    }
}

/// Returns point `i` of a lattice of `n` points that covers the sphere almost evenly (González, "Measurement of Areas on a Sphere Using Fibonacci and
/// Latitude-Longitude Lattices", Mathematical Geosciences 42, 2010).
fn fibonacci(i: u32, n: u32) -> [f64; 3] {
    let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
    let turn = 2.0 * PI * (f64::from(i) * 0.618_033_988_749_894_9).fract();
    let r = (1.0 - z * z).sqrt();
    [r * turn.cos(), r * turn.sin(), z]
}

/// Returns the largest error at tested directions near the middle of a face, radians. For fast rounding, the corners of the squares around codes are
/// tested. For exact rounding, the centres of the two triangles in the square between four codes are tested.
fn attained(rounding: Rounding, bits: u32) -> f64 {
    let h = f64::from(octahedral::half(bits));
    let middle = (h / 3.0).floor() as i32;
    let offsets = match rounding {
        // The points lie slightly inside the square, so that rounding gives the code at the centre of the square.
        Rounding::Fast => vec![[0.499_999, 0.499_999], [0.499_999, -0.499_999], [-0.499_999, -0.499_999], [-0.499_999, 0.499_999]],
        Rounding::Exact => vec![[1.0 / 3.0, 1.0 / 3.0], [2.0 / 3.0, 2.0 / 3.0]],
    };
    let codes = (-4..=4).flat_map(|x| (-4..=4).map(move |y| [middle + x, middle + y]));
    codes
        .flat_map(|code| offsets.iter().map(move |offset| [0, 1].map(|i| (f64::from(code[i]) + offset[i]) / h)))
        .map(|e| rounding.error(octahedral::decode(e), bits))
        .fold(0.0, f64::max)
}

/// Compares the mean errors over evenly spread directions with published values, and the largest errors with the upper bound.
pub fn octahedral_rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for bits in BITS {
        for rounding in Rounding::ALL {
            let view = format!("{bits} + {bits} bits");
            // The sum is computed in pieces of fixed size, so that rounding errors do not depend on the number of threads.
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

/// The encoding that stores the plane of a pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stored {
    /// An octahedral encoding with 8 + 8 bits and exact rounding. The shading normal has the same number of bits.
    Octahedral,
    /// The encoding of [`normal_pair`], which stores the normal of the plane and the shading normal in 32 bits. One bit selects one of two forms. If
    /// the shading normal is near the normal of the plane, the plane has 21 bits and the shading normal 10. Otherwise, they have 15 and 16 bits.
    PlaneFirst,
}

/// A pixel that shows a plane.
struct Pixel {
    ray: [f64; 3],
    steps: [[f64; 3]; 2],
    normal: [f64; 3],
    shading: [f64; 3],
    incidence_deg: f64,
}

/// Returns a pixel of a random camera. The field of view is 20 to 100 degrees, and position and direction are random. The angle between the reversed
/// ray and the normal of the plane is uniform within the given range, degrees. The angle between the normal of the plane and the shading normal is a
/// quarter of a degree to 8 degrees, and its logarithm is uniform. In rendered frames, the angle between the two normals has a similar median and
/// 90th percentile, but its 99th percentile is 4 to 39 degrees (docs/stability-lab.md, section 3).
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
    // Terrain has no overhangs. If the normal points downwards, ray, steps and normal are therefore mirrored vertically.
    let upright = |v: [f64; 3]| if normal[2] < 0.0 { [v[0], v[1], -v[2]] } else { v };
    let (ray, normal) = (upright(ray), upright(normal));
    let steps = [view.ray_dx, view.ray_dy].map(|step| upright(step.to_array()));
    let deviation_deg = draw.between(-2.0, 3.0).exp2();
    let shading = draw.leaning(normal, deviation_deg.to_radians());
    Pixel { ray, steps, normal, shading, incidence_deg }
}

/// The errors at one pixel.
struct Error {
    incidence_deg: f64,
    /// Relative error of each of the two derivatives.
    relative: [f64; 2],
    /// Error of the mip level that is computed from the longer derivative, levels.
    mip: f64,
    /// The ratio of a derivative's relative error to its upper bound; the larger ratio of the two derivatives. The bound is |d' - d| / |d| <= sin(e)
    /// / |cos'|. Here d is the true derivative, d' the derivative from the stored plane, e the angle between the true and the stored plane, and cos'
    /// the cosine of the angle between the stored normal and the ray of the neighbouring pixel. `None` if a cosine was clamped, because the bound
    /// does not apply then.
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

/// Measures the derivatives of random pixels for both encodings of the plane. The angle between ray and normal is uniform in 0..85 degrees.
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
        // The limit is the bound itself, which is 1, plus a margin of 1e-6. The margin covers rounding errors, because this f64 computation subtracts
        // nearly equal vectors.
        push("below 85 deg", "largest share of the law's bound", law(errors), 1.0 + 1e-6);
    }
    for (statistic, share, least) in [("gain in the median", 0.5, 3.0), ("gain in p95", 0.95, 3.0)] {
        let gain = relative(&octahedral, 85.0, share) / relative(&plane_first, 85.0, share);
        rows.push(row("plane-first", "below 85 deg".to_owned(), "over octahedral 8 + 8", statistic, gain, [least, 1e3]));
    }
    rows
}

/// Angles between ray and normal at which the effect of clamping the cosine is reported, degrees.
const STEEP_DEG: [f64; 6] = [88.0, 89.0, 89.43, 89.5, 89.9, 89.99];

/// Measures the effect of clamping cosines at [`derivatives::MIN_COSINE`], which limits the anisotropy. The clamp makes the mip level finer than the
/// plane requires, by log2(`MIN_COSINE` / c) levels, where c is the cosine of the angle between ray and normal.
pub fn bound_rows() -> Vec<Row> {
    let price = |degrees: f64| {
        // The step to the neighbouring pixel is very short, so the rays of both pixels have practically the same angle to the normal.
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

/// Returns all rows.
pub fn rows() -> Vec<Row> {
    [octahedral_rows(), derivative_rows(), bound_rows()].concat()
}

//! Probes of computations over frames: moments of a stream, and reprojection of a point.

use super::judge::{EPS, Verdict, both, close, farthest, three};
use super::{EXACT, Measure, Parameter, Probe, real, take, whole};
use crate::shared::moments::Moments;
use crate::shared::motion::{self, Past};
use crate::shared::real::{Real, add, dot, length};

/// Largest number of samples in a stream of the probe `moments`.
const LONGEST: i32 = 4096;

pub(super) const MOMENTS: Probe = Probe {
    name: "moments",
    about: "Mean and variance of a stream whose samples alternate between mean + spread and mean - spread",
    inputs: &[
        real("mean", "mean of the stream"),
        real("spread", "distance of samples from the mean"),
        whole("count", "number of samples", 1, LONGEST),
    ],
    outputs: &[
        real("mean_high", "mean"),
        real("mean_low", "low part of the mean: mean = mean_high + mean_low"),
        real("variance", "unbiased"),
    ],
    blocks: None,
    // `zero` is always 0, but the compiler must not know this, because it could then remove the compensation of the sums in moments.wgsl. The shader
    // reads the count from memory, so the compiler must assume that the highest bit of the count may be set.
    wgsl: "\
fn probe(row: array<f32, 3>) -> array<f32, 3> {
    let count = u32(row[2]);
    let zero = count & 0x80000000u;
    var state = vec4<f32>(0.0);
    for (var i = 0u; i < count; i++) {
        let spread = select(row[1], -row[1], (i & 1u) == 1u);
        state = moments_add(state, vec2<f32>(row[0], spread), f32(i + 1u), zero);
    }
    return array<f32, 3>(state.x, state.y, moments_variance(state, f32(count)));
}",
    single: moments_row,
    double: moments_row,
    random: |d| {
        let mean = d.between(-10.0, 20.0).exp2();
        vec![mean, mean * d.between(-24.0, 0.0).exp2(), 2.0 + d.whole(500)]
    },
    judge: moments_judge,
    measures: &[Measure {
        name: "variance",
        unit: "%",
        error: |_, got, want| 100.0 * (got[2] - want[2]).abs() / want[2].max(f64::from(f32::MIN_POSITIVE)),
    }],
    parameters: &[Parameter { name: "mean_over_spread", unit: "1", set: |row, value, _| row[0] = row[1] * value }],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps this column whole and in range")]
fn moments_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let mut moments = Moments::new();
    for i in 0..row[2].to_f64() as u32 {
        moments.add([row[0], if i % 2 == 1 { -row[1] } else { row[1] }]);
    }
    out.extend(moments.mean);
    out.push(T::of(moments.variance()));
}

fn moments_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    // Sample number i changes the mean by the sample's difference from the mean, divided by i. The difference, which is about as large as the spread,
    // is rounded (half an ULP) and the division adds 2.5 ULP, so this change has an error of about 3 ULP of spread / i. If the errors of all samples
    // have the same sign, their sum is 3 ULP of the sum of spread / i. This sum is at most spread (1 + ln count). The tolerance allows 4 ULP. The
    // last term is the rounding of the mean itself, whose two parts have twice the digits of f32.
    let of_mean = 4.0 * EPS * row[1].abs() * (1.0 + row[2].ln()) + EPS * EPS * row[0].abs();
    let mean = close(&[got[0] + got[1]], &[want[0] + want[1]], of_mean + f64::from(f32::MIN_POSITIVE));
    // Each term of the sum of squares has 6 roundings. The sum is compensated and adds hardly any error. The tolerance allows 8 ULP.
    both(mean, close(&got[2..], &want[2..], 8.0 * EPS * want[2] + f64::from(f32::MIN_POSITIVE)))
}

pub(super) const REPROJECTION: Probe = Probe {
    name: "reprojection",
    about: "Where an earlier camera saw a point, and the distance at which the ray of the nearest pixel meets the plane through the point",
    inputs: &[
        real("x", "m, point relative to this frame's eye"),
        real("y", "m"),
        real("z", "m"),
        real("offset_x", "m, this frame's eye minus the earlier eye"),
        real("offset_y", "m"),
        real("offset_z", "m"),
        real("half_width", "tangent of half the earlier field of view"),
        whole("width", "pixels of the earlier picture; its height is half of the width", 1, EXACT),
        real("normal_x", "normal of the plane"),
        real("normal_y", "normal of the plane"),
        real("normal_z", "normal of the plane"),
    ],
    outputs: &[
        real("pixel_x", "whole numbers are pixel centres"),
        real("pixel_y", "whole numbers are pixel centres"),
        real("distance", "m along the earlier view direction, which is y"),
        real("expected", "m, distance at which the ray through the centre of the nearest pixel meets the plane"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 11>) -> array<f32, 4> {
    let width = row[7];
    let shift = 0.5 * (vec2<f32>(width, 0.5 * width) - vec2<f32>(1.0));
    let pitch = 2.0 * row[6] / width;
    let past = MotionPast(
        vec3<f32>(row[3], row[4], row[5]), -shift.x, vec3<f32>(0.0, 1.0, 0.0), -shift.y,
        vec3<f32>(1.0 / pitch, 0.0, 0.0), 0.0, vec3<f32>(0.0, 0.0, -1.0 / pitch), 0.0,
    );
    let point = vec3<f32>(row[0], row[1], row[2]);
    let seen = motion_reproject(point, past);
    let ray = motion_past_ray(past, floor(seen.xy + vec2<f32>(0.5)));
    let expected = motion_expected_distance(point, past, ray, vec3<f32>(row[8], row[9], row[10]));
    return array<f32, 4>(seen.x, seen.y, seen.z, expected);
}",
    single: reprojection_row,
    double: reprojection_row,
    random: |d| {
        let far = d.between(0.0, 14.0).exp2();
        let point = [d.between(-0.5, 0.5) * far, far, d.between(-0.3, 0.3) * far];
        [&point[..], &d.vector(-8.0, 2.0), &[d.between(-3.0, 1.0).exp2(), 64.0 + d.whole(4000)], &d.direction()].concat()
    },
    judge: reprojection_judge,
    measures: &[Measure { name: "pixel", unit: "px", error: |_, got, want| farthest(&got[..2], &want[..2]) }],
    parameters: &[
        Parameter {
            name: "distance_m",
            unit: "m ahead of the eye",
            set: |row, value, d| {
                let at = [d.between(-0.5, 0.5) * value, value, d.between(-0.3, 0.3) * value];
                row[..3].copy_from_slice(&at);
            },
        },
        Parameter {
            name: "offset_m",
            unit: "m",
            set: |row, value, d| {
                let offset = d.direction().map(|x| x * value);
                row[3..6].copy_from_slice(&offset);
            },
        },
        Parameter { name: "fov_deg", unit: "deg", set: |row, value, _| row[6] = (value / 2.0).to_radians().tan() },
    ],
};

/// The earlier camera of a row. It looks along y, and x points to the right.
fn past<T: Real>(row: &[T]) -> Past<T> {
    let half = T::of(0.5);
    let [x_shift, y_shift] = [row[7], half * row[7]].map(|side| -(half * (side - T::one())));
    let pitch = T::of(2.0) * row[6] / row[7];
    let zero = T::zero();
    Past {
        offset: take(row, 3),
        forward: [zero, T::one(), zero],
        x_row: [T::one() / pitch, zero, zero],
        y_row: [zero, zero, -T::one() / pitch],
        x_shift,
        y_shift,
    }
}

fn reprojection_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (past, point) = (past(row), take(row, 0));
    let seen = motion::reproject(point, &past);
    // The ray through the centre of the nearest pixel is used. The ray through the exact position would meet every plane through the point
    // at the point itself, so the result would not depend on the plane.
    let nearest = [seen[0], seen[1]].map(|p| (p + T::of(0.5)).floor());
    out.extend(seen);
    out.push(motion::expected_distance(point, &past, motion::past_ray(&past, nearest), take(row, 8)));
}

fn reprojection_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let past = past(row);
    let (point, offset) = (three(row, 0), three(row, 3));
    let q = add(point, offset);
    // Error bounds, step by step:
    // - `rounded`: error of q. Each coordinate of q is a sum that is rounded once.
    // - `relative`: error of a quotient dot(row, q) / distance, as a share of |row| |q| / distance. It contains the error of q, and 8 ULP for the dot
    //   products, the division (2.5 ULP), and the row of the matrix, which is computed from `pitch`.
    // - `of_pixel`: error of the pixel. It contains the error of the quotient, and 8 ULP of the shift that is subtracted.
    let rounded = EPS * (length(point) + length(offset) + length(q));
    let distance = dot(q, past.forward);
    let rows = length(past.x_row).max(length(past.y_row));
    let relative = 8.0 * EPS + rounded / distance.abs().max(1e-30);
    let shift = past.x_shift.abs().max(past.y_shift.abs());
    let of_pixel = relative * rows * length(q) / distance.abs().max(1e-30) + 8.0 * EPS * shift;
    // If the distance is close to the smallest or largest distance that reprojection accepts, rounding may decide whether the point is accepted. Both
    // answers are then valid.
    let at_threshold = [motion::MIN_DISTANCE, motion::FAR].iter().any(|&t| (distance - t).abs() <= rounded + 8.0 * EPS * t);
    let seen = both(close(&got[..2], &want[..2], of_pixel), close(&got[2..3], &want[2..3], rounded + 4.0 * EPS * distance.abs()));
    if seen == Verdict::Differs {
        return if at_threshold { Verdict::OtherSide } else { Verdict::Differs };
    }
    // `at` judges the distance that is expected at the centre of a pixel, which is dot(n, q) / dot(n, ray). `of_ray` is the error of dot(n, ray): the
    // row of the matrix has an error of 5 ULP, the ray 6 ULP more, the dot product 2 ULP; the tolerance allows 20 ULP. `of_plane` is the error of
    // dot(n, q), which follows from the error of q.
    let n = three(row, 8);
    let of_plane = length(n) * (rounded + 4.0 * EPS * length(q));
    let at = |pixel: [f64; 2]| {
        let ray = motion::past_ray(&past, pixel);
        let along = dot(n, ray).abs();
        let of_ray = length(n) * 20.0 * EPS * length(ray);
        let wanted = motion::expected_distance(point, &past, ray, n);
        if along <= of_ray + 1e-6 * length(ray) * (1.0 + 16.0 * EPS) {
            // The plane is edge-on, or so close to edge-on that rounding may decide whether the ray hits it. Any distance is accepted.
            return if (got[3] - wanted).abs() <= EPS * wanted.abs() { Verdict::Agrees(0.0) } else { Verdict::OtherSide };
        }
        let meets = dot(n, q) / dot(n, ray);
        let tolerance = (of_plane + meets.abs() * of_ray) / (along - of_ray) + 4.0 * EPS * meets.abs();
        // If the distance is close to `MIN_DISTANCE` or `FAR`, rounding may decide whether the hit is accepted. If it is not accepted, the result is
        // 0.
        let at_limit = [motion::MIN_DISTANCE, motion::FAR].iter().any(|&t| (meets - t).abs() <= tolerance + 8.0 * EPS * t);
        match close(&got[3..], &[wanted], tolerance) {
            Verdict::Differs if at_limit && (got[3] == 0.0 || (got[3] - meets).abs() <= tolerance) => Verdict::OtherSide,
            verdict => verdict,
        }
    };
    // Where a position is about halfway between two pixels, rounding may decide which pixel is the nearest, so the distances at both pixels are
    // accepted.
    let nearest = |p: f64| [-1.0, 0.0, 1.0].map(|side| (p + side * EPS * (1.0 + p.abs()) + 0.5).floor());
    let wanted = [want[0], want[1]].map(|p| (p + 0.5).floor());
    let mut expected = Verdict::Differs;
    for pixel in nearest(got[0]).into_iter().flat_map(|x| nearest(got[1]).map(|y| [x, y])) {
        let verdict = if pixel == wanted { at(pixel) } else { both(at(pixel), Verdict::OtherSide) };
        if expected == Verdict::Differs || matches!(verdict, Verdict::Agrees(_)) {
            expected = verdict;
        }
    }
    both(seen, expected)
}

//! Probes of the random thresholds of each kind of noise.

use super::judge::{EPS, Verdict, close, equal, farthest, level_error, three};
use super::{Cell, EXACT, MASK_PLACES, Measure, Parameter, Probe, real, take, whole, word};
use crate::shared::noise::{self, HashedPoint, NoiseKind, hashed_anisotropic, hashed_isotropic};
use crate::shared::real::length;

pub(super) const HASHED_ALPHA: Probe = Probe {
    name: "hashed-alpha",
    about: "Hashed-alpha thresholds of a point: four independent numbers that are stable under motion",
    inputs: &[
        whole("kind", "0 = isotropic, 1 = anisotropic", 0, 1),
        whole("sector_x", "sectors east of the south-west corner", -EXACT, EXACT),
        whole("sector_y", "sectors north of the south-west corner", -EXACT, EXACT),
        real("x", "m east in the sector"),
        real("y", "m north in the sector"),
        real("z", "m, elevation"),
        real("sector_m", "m, a power of two in 32..=16384"),
        real("ddx_x", "m, step to the pixel on the right"),
        real("ddx_y", "m"),
        real("ddx_z", "m"),
        real("ddy_x", "m, step to the pixel below"),
        real("ddy_y", "m"),
        real("ddy_z", "m"),
        real("hash_scale", "cell size in pixels"),
        word("seed", "seed"),
        word("salt", "number that is hashed with the seed"),
    ],
    outputs: &[real("u_0", "0..1"), real("u_1", "0..1"), real("u_2", "0..1"), real("u_3", "0..1")],
    blocks: None,
    wgsl: "\
fn probe(row: array<u32, 16>) -> array<u32, 4> {
var real: array<f32, 14>;
for (var i = 0u; i < 14u; i++) { real[i] = bitcast<f32>(row[i]); }
let u = noise_thresholds(
    u32(real[0]),
    vec2<i32>(i32(real[1]), i32(real[2])),
    vec3<f32>(real[3], real[4], real[5]),
    real[6],
    vec3<f32>(real[7], real[8], real[9]),
    vec3<f32>(real[10], real[11], real[12]),
    real[13],
    0,
    vec2<u32>(0u, 0u),
    0u,
    row[14],
    row[15],
    vec4<u32>(0u),
);
let bits = bitcast<vec4<u32>>(u);
return array<u32, 4>(bits.x, bits.y, bits.z, bits.w);
}",
    single: hashed_alpha_row,
    double: hashed_alpha_row,
    random: |d| {
        let sector_m = d.between(5.0, 15.0).floor().exp2();
        let kind = d.whole(2);
        let reach = if d.whole(2) < 0.5 { 160 } else { 1 << 24 };
        let sector = [0; 2].map(|_: i32| d.whole(2 * reach) - f64::from(reach));
        let position = [d.unit() * sector_m * 0.999_999, d.unit() * sector_m * 0.999_999, d.between(-500.0, 3000.0)];
        let size = d.between(-18.0, 7.0);
        let (ddx, ddy) = (d.vector(size - 3.0, size), d.vector(size - 3.0, size));
        let scale = d.between(-2.0, 2.0).exp2();
        let seeds = [0; 2].map(|_: i32| f64::from(d.word()));
        [&[kind][..], &sector, &position, &[sector_m], &ddx, &ddy, &[scale], &seeds].concat()
    },
    judge: hashed_alpha_judge,
    measures: &[Measure { name: "threshold", unit: "of 1", error: |_, got, want| farthest(got, want) }],
    parameters: &[
        Parameter {
            name: "footprint_m",
            unit: "m, both derivatives",
            set: |row, value, d| {
                let (ddx, ddy) = (d.direction(), d.direction());
                (0..3).for_each(|i| (row[7 + i], row[10 + i]) = (ddx[i] * value, ddy[i] * value));
            },
        },
        Parameter { name: "sector", unit: "sectors, both", set: |row, value, _| row[1..3].fill(value) },
        Parameter { name: "in_sector_m", unit: "m, x and y", set: |row, value, _| row[3..5].fill(value) },
    ],
};

pub(super) const NOISE: Probe = Probe {
    name: "noise",
    about: "Thresholds of the kinds of noise other than hashed alpha, and the indices of the mask ranks that they use",
    inputs: &[
        whole("kind", "2 = white, 3 = world, 4 = ign, 5 = blue, 6 = stbn", 2, 6),
        whole("sector_x", "sectors east of the south-west corner", -EXACT, EXACT),
        whole("sector_y", "sectors north of the south-west corner", -EXACT, EXACT),
        real("x", "m east in the sector"),
        real("y", "m north in the sector"),
        real("z", "m, elevation"),
        real("sector_m", "m, a power of two in 32..=16384"),
        whole("world_level", "log2 of cells per metre", -EXACT, EXACT),
        whole("pixel_x", "column", 0, EXACT),
        whole("pixel_y", "row", 0, EXACT),
        word("frame", "index of the frame"),
        word("seed", "seed"),
        word("salt", "number that is hashed with the seed"),
        whole("rank_0", "rank at index_0, used by blue and stbn", 0, EXACT),
        whole("rank_1", "rank at index_1", 0, EXACT),
        whole("rank_2", "rank at index_2", 0, EXACT),
        whole("rank_3", "rank at index_3", 0, EXACT),
    ],
    outputs: &[
        whole("index_0", "index of the rank in the masks", 0, MASK_PLACES),
        whole("index_1", "index of the rank", 0, MASK_PLACES),
        whole("index_2", "index of the rank", 0, MASK_PLACES),
        whole("index_3", "index of the rank", 0, MASK_PLACES),
        real("u_0", "0..1"),
        real("u_1", "0..1"),
        real("u_2", "0..1"),
        real("u_3", "0..1"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<u32, 17>) -> array<u32, 8> {
var real: array<f32, 17>;
for (var i = 0u; i < 17u; i++) { real[i] = bitcast<f32>(row[i]); }
let kind = u32(real[0]);
let pixel = vec2<u32>(u32(real[8]), u32(real[9]));
let frame = row[10];
let seed = row[11];
let salt = row[12];
let u = noise_thresholds(
    kind,
    vec2<i32>(i32(real[1]), i32(real[2])),
    vec3<f32>(real[3], real[4], real[5]),
    real[6],
    vec3<f32>(0.0),
    vec3<f32>(0.0),
    1.0,
    i32(real[7]),
    pixel,
    frame,
    seed,
    salt,
    vec4<u32>(u32(real[13]), u32(real[14]), u32(real[15]), u32(real[16])),
);
var out: array<u32, 8>;
for (var i = 0u; i < 4u; i++) {
    out[i] = bitcast<u32>(f32(noise_rank_index(kind, pixel, frame, seed, salt, i)));
    out[4u + i] = bitcast<u32>(u[i]);
}
return out;
}",
    single: noise_row,
    double: noise_row,
    random: |d| {
        let sector_m = d.between(5.0, 15.0).floor().exp2();
        let reach = if d.whole(2) < 0.5 { 160 } else { 1 << 24 };
        let kind = 2.0 + d.whole(5);
        let sector = [0; 2].map(|_: i32| d.whole(2 * reach) - f64::from(reach));
        let position = [d.unit() * sector_m * 0.999_999, d.unit() * sector_m * 0.999_999, d.between(-500.0, 3000.0)];
        let level = d.whole(24) - 6.0;
        let pixel = [d.whole(4096), d.whole(4096)];
        let times = [d.whole(2000), f64::from(d.word()), f64::from(d.word())];
        let ranks = [0; 4].map(|_: i32| d.whole(4096));
        [&[kind][..], &sector, &position, &[sector_m, level], &pixel, &times, &ranks].concat()
    },
    judge: equal,
    measures: &[Measure { name: "threshold", unit: "of 1", error: |_, got, want| farthest(&got[4..], &want[4..]) }],
    parameters: &[
        Parameter { name: "sector", unit: "sectors, both", set: |row, value, _| row[1..3].fill(value) },
        Parameter { name: "in_sector_m", unit: "m, x and y", set: |row, value, _| row[3..5].fill(value) },
    ],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn hashed_alpha_row<T: Cell>(row: &[T], out: &mut Vec<T>) {
    let point = HashedPoint {
        sector: take::<T, 2>(row, 1).map(|v| v.to_f64() as i32),
        position: take(row, 3),
        sector_m: row[6],
        ddx: take(row, 7),
        ddy: take(row, 10),
        hash_scale: row[13],
    };
    let [seed, salt] = take::<T, 2>(row, 14).map(T::word);
    out.extend(if row[0] < T::one() { hashed_isotropic(&point, seed, salt) } else { hashed_anisotropic(&point, seed, salt) });
}

fn hashed_alpha_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (ddx, ddy) = (three(row, 7), three(row, 10));
    let finest = [row[6], row[6], row[5]].map(finest_level);
    // Pairs of a level and the finest level of its axis, and the relative error of the footprint in ULP.
    let (levels, ulps): (Vec<(f64, f64)>, f64) = if row[0] < 1.0 {
        // The footprint is the cell size times a length. Its relative error comes from a dot product (3 roundings), a square root (4.5 ULP) and the
        // product. The tolerance allows 8 ULP.
        let finest = finest[0].min(finest[2]);
        (vec![(noise_level(row[13] * length(ddx).max(length(ddy)), finest), finest)], 8.0)
    } else {
        // The tested function raises every width to at least 1/16 of the largest width. Dividing by 16 is exact.
        let widths = [0, 1, 2].map(|i: usize| (std::f64::consts::SQRT_2 * row[13] * ddx[i].abs().max(ddy[i].abs())).clamp(0.0, 1e6));
        let least = widths.into_iter().fold(0.0, f64::max) / 16.0;
        ((0..3).map(|i| (noise_level(widths[i].max(least), finest[i]), finest[i])).collect(), 3.0)
    };
    let error = levels.iter().map(|&(level, _)| level_error(level, ulps)).fold(0.0, f64::max);
    // A threshold is computed in two steps: the random numbers of a larger and a smaller cell are blended, and `noise::correct` makes the blend
    // uniform. The random numbers are exact, because the indices of the cells are products with powers of two, rounded down. So only the blend factor
    // has an error. This error is taken to be `error`, the error of the level. After `noise::correct`, the result is wrong by at most 2.5 `error`;
    // the tolerance allows 3 `error`. The operations of both steps add 12 ULP.
    let verdict = close(got, want, 3.0 * error + 12.0 * EPS);
    // The anisotropic kind jumps to different cells where the level of one axis passes a whole number and the levels of the other axes do not. Near
    // such a threshold, the results on both sides are accepted. (The isotropic kind is continuous there. At the ends of the range, levels are
    // clamped, so the scale does not change.)
    let at_threshold = |&(l, finest): &(f64, f64)| (l - l.round()).abs() <= error && l.round() > -5.0 && l.round() < finest;
    if verdict == Verdict::Differs && row[0] >= 1.0 && levels.iter().any(at_threshold) { Verdict::OtherSide } else { verdict }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn noise_row<T: Cell>(row: &[T], out: &mut Vec<T>) {
    let zero = T::zero();
    let point = HashedPoint {
        sector: take::<T, 2>(row, 1).map(|v| v.to_f64() as i32),
        position: take(row, 3),
        sector_m: row[6],
        ddx: [zero; 3],
        ddy: [zero; 3],
        hash_scale: T::one(),
    };
    let kind = NoiseKind::ALL[row[0].to_f64() as usize];
    let level = row[7].to_f64() as i32;
    let [x, y] = take::<T, 2>(row, 8).map(|v| v.to_f64() as u32);
    let [frame, seed, salt] = take::<T, 3>(row, 10).map(T::word);
    let ranks = take::<T, 4>(row, 13).map(|v| v.to_f64() as u32);
    out.extend([0, 1, 2, 3].map(|decision| T::of(f64::from(noise::rank_index(kind, [x, y], frame, seed, salt, decision)))));
    out.extend(if kind.needs_mask() {
        noise::mask(kind, [x, y], frame, seed, salt, ranks)
    } else {
        noise::thresholds(kind, &point, level, [x, y], frame, seed, salt)
    });
}

/// Level of a footprint, log2 of cells per metre, clamped to the range of the noise.
fn noise_level(footprint: f64, finest: f64) -> f64 {
    (-footprint.clamp(1e-6, 1e6).log2()).clamp(-5.0, finest)
}

/// The finest level along an axis whose largest coordinate is `largest` m. A cell of this level is 16 or 32 times as wide as the step
/// between neighbouring f32 numbers at that coordinate, unless the level is clamped.
fn finest_level(largest: f64) -> f64 {
    (19.0 - largest.abs().log2().round()).clamp(-4.0, 16.0)
}

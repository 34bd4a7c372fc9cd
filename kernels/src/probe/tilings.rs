//! Probes of texture coordinates and tilings.

use super::judge::{EPS, Verdict, both, close, farthest, keyed, level_error};
use super::{EXACT, Measure, Parameter, Probe, real, take, whole};
use crate::shared::real::Real;
use crate::shared::{hex_tiling, texel_choice, tiling};

pub(super) const HEX_TILING: Probe = Probe {
    name: "hex-tiling",
    about: "The three hexagons around a point, their weights, and the texture's offset in the first hexagon",
    inputs: &[
        whole("sector_0", "whole sectors along the first coordinate", -EXACT, EXACT),
        whole("sector_1", "whole sectors along the second coordinate", -EXACT, EXACT),
        real("x_0", "m beyond the whole sectors"),
        real("x_1", "m beyond the whole sectors"),
        real("sector_m", "m"),
        real("repeats", "repeats of the texture along a sector"),
        whole("salt", "number of the lattice", 0, EXACT),
    ],
    outputs: &[
        whole("level", "log2 of hexagons along a sector", -10, 15),
        whole("id_0_0", "column of the first hexagon", 0, 65_535),
        whole("id_0_1", "row of the first hexagon", 0, 65_535),
        whole("id_1_0", "column of the second hexagon", 0, 65_535),
        whole("id_1_1", "row of the second hexagon", 0, 65_535),
        whole("id_2_0", "column of the third hexagon", 0, 65_535),
        whole("id_2_1", "row of the third hexagon", 0, 65_535),
        real("w_0", "weight of the first hexagon, 0..1"),
        real("w_1", "weight of the second hexagon, 0..1"),
        real("w_2", "weight of the third hexagon, 0..1"),
        real("offset_0", "0..1, in the first hexagon"),
        real("offset_1", "0..1"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 7>) -> array<f32, 12> {
let level = hex_tiling_level(row[5]);
let t = hex_tiling_at(vec2<i32>(i32(row[0]), i32(row[1])), vec2<f32>(row[2], row[3]), row[4], level);
let offset = hex_tiling_offset(t.first, u32(row[6]));
let ids = array<vec2<f32>, 3>(vec2<f32>(hex_tiling_id(t, 0u)), vec2<f32>(hex_tiling_id(t, 1u)), vec2<f32>(hex_tiling_id(t, 2u)));
return array<f32, 12>(
    f32(level), ids[0].x, ids[0].y, ids[1].x, ids[1].y, ids[2].x, ids[2].y, t.weights.x, t.weights.y, t.weights.z, offset.x, offset.y,
);
}",
    single: hex_tiling_row,
    double: hex_tiling_row,
    random: |d| {
        let sector_m = d.between(5.0, 15.0).floor().exp2();
        let reach = if d.whole(2) < 0.5 { 160 } else { 1 << 24 };
        let sector = [0; 2].map(|_: i32| d.whole(2 * reach) - f64::from(reach));
        let position = [0; 2].map(|_: i32| d.between(-1.0, 1.0) * sector_m);
        [&sector[..], &position, &[sector_m, d.between(-10.0, 7.0).exp2(), d.whole(1 << 24)]].concat()
    },
    judge: hex_tiling_judge,
    measures: &[Measure {
        name: "weight",
        unit: "% of weight",
        error: |_, got, want| {
            let of = |v: &[f64], id: (f64, f64)| (0..3).filter(|i| (v[1 + 2 * i], v[2 + 2 * i]) == id).map(|i| v[7 + i]).sum::<f64>();
            let ids = (0..3).flat_map(|i| [(got[1 + 2 * i], got[2 + 2 * i]), (want[1 + 2 * i], want[2 + 2 * i])]);
            // If the levels differ, the whole patterns differ, and weights cannot be compared.
            if got[0] == want[0] { 100.0 * ids.map(|id| (of(got, id) - of(want, id)).abs()).fold(0.0, f64::max) } else { 0.0 }
        },
    }],
    parameters: &[
        Parameter { name: "sector", unit: "sectors, along both coordinates", set: |row, value, _| row[..2].fill(value) },
        Parameter { name: "in_sector_m", unit: "m, along both coordinates", set: |row, value, _| row[2..4].fill(value) },
    ],
};

pub(super) const TEXEL_CHOICE: Probe = Probe {
    name: "texel-choice",
    about: "A random mip level and texel; the expected value of the texel is the trilinearly filtered value",
    inputs: &[
        real("lod", "level of detail"),
        whole("levels", "mip levels of the texture", 1, 15),
        real("u_level", "uniform number, 0..1"),
        real("coordinate", "texture coordinate, repeats"),
        whole("size", "texels of the level", 1, 16_384),
        real("u_texel", "uniform number, 0..1"),
    ],
    outputs: &[whole("level", "mip level", 0, 14), whole("texel", "column or row", 0, 16_383)],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 6>) -> array<f32, 2> {
let level = texel_choice_level(row[0], u32(row[1]), row[2]);
return array<f32, 2>(f32(level), f32(texel_choice_texel(row[3], u32(row[4]), row[5])));
}",
    single: texel_choice_row,
    double: texel_choice_row,
    random: |d| {
        let levels = 1.0 + d.whole(12);
        let size = d.whole(13).exp2();
        vec![d.between(-2.0, 14.0), levels, d.unit(), d.between(-200.0, 200.0), size, d.unit()]
    },
    judge: texel_choice_judge,
    measures: &[Measure { name: "choice", unit: "texels or levels", error: |_, got, want| farthest(got, want) }],
    parameters: &[],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn hex_tiling_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let level = hex_tiling::level(row[5]);
    let tiling = hex_tiling::at(take::<T, 2>(row, 0).map(|v| v.to_f64() as i32), take(row, 2), row[4], level);
    out.push(T::of(f64::from(level)));
    out.extend(tiling.ids.as_flattened().iter().map(|&id| T::of(f64::from(id))));
    out.extend(tiling.weights);
    out.extend(hex_tiling::offset::<T>(tiling.ids[0], row[6].to_f64() as u32));
}

fn hex_tiling_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    if (got[0] - want[0]).abs() > 0.5 {
        // If log2 of the wanted number of hexagons is close to halfway between two levels, rounding may decide which level is chosen.
        let spacings = (row[5] * 12.0_f64.sqrt()).log2();
        let near = (spacings - spacings.floor() - 0.5).abs() <= level_error(spacings, 2.0);
        return if near && (got[0] - want[0]).abs() < 1.5 { Verdict::OtherSide } else { Verdict::Differs };
    }
    let id = |v: &[f64], i: usize| v[1 + 2 * i] as u64 * 65_536 + v[2 + 2 * i] as u64;
    let first = [got[1] as u32, got[2] as u32];
    if close(&got[10..], &hex_tiling::offset::<f64>(first, row[6] as u32), 0.5 * f64::from(f32::MIN_POSITIVE)) == Verdict::Differs {
        return Verdict::Differs;
    }
    // The error bound of a weight is derived step by step. `reach` is the larger coordinate of the position, in units of the hexagons' spacing.
    // 1. `coordinate` is the error of a coordinate in the skewed lattice: three roundings, half an ULP each, of numbers of about 1.2 times `reach`
    //    plus 1. Products with powers of two are exact.
    // 2. A barycentric coordinate is a sum of up to two skewed coordinates: factor 2.
    // 3. It is divided by the largest barycentric coordinate, which is at least 1/3: factor 3.
    // 4. The 7th power: factor 7.
    // 5. Normalising the weights: factor 2.
    // The remaining 24 ULP are for the roundings of steps 3 to 5.
    let reach = row[2].abs().max(row[3].abs()) / row[4] * got[0].exp2();
    let coordinate = 1.5 * EPS * (1.2 * reach + 1.0);
    let pairs = |v: &[f64]| [0, 1, 2].map(|i| (id(v, i), v[7 + i]));
    keyed(&pairs(got), &pairs(want), 2.0 * 7.0 * 6.0 * coordinate + 24.0 * EPS)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn texel_choice_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let whole = |at: usize| row[at].to_f64() as u32;
    out.push(T::of(f64::from(texel_choice::level(row[0], whole(1), row[2]))));
    out.push(T::of(f64::from(texel_choice::texel(row[3], whole(4), row[5]))));
}

fn texel_choice_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    if got.iter().zip(want).all(|(g, w)| (g - w).abs() < 0.5) {
        return Verdict::Agrees(0.0);
    }
    // The choice compares u with the fractional part of the level of detail, or of the coordinate in texels. The level of detail and the coordinate
    // may each have an error of one ULP of its magnitude. If the fractional part is that close to u, to 0 or to 1, both choices are accepted.
    let lod = row[0].clamp(0.0, row[1] - 1.0);
    let texels = (row[3] - row[3].floor()) * row[4] - 0.5;
    let may = |x: f64, u: f64, error: f64| {
        let part = x - x.floor();
        (u - part).abs() <= error || part <= error || part >= 1.0 - error
    };
    let level = (got[0] - want[0]).abs() < 0.5 || ((got[0] - want[0]).abs() < 1.5 && may(lod, row[2], EPS * (lod + 1.0)));
    let steps = (got[1] - want[1]).abs().min(row[4] - (got[1] - want[1]).abs());
    let texel = steps < 0.5 || (steps < 1.5 && may(texels, row[5], EPS * (row[4] + 1.0)));
    if level && texel { Verdict::OtherSide } else { Verdict::Differs }
}

pub(super) const TILING: Probe = Probe {
    name: "tiling",
    about: "The two tiling scales that are blended at a distance, and the texture coordinate of a sector at one scale, exact in fixed point",
    inputs: &[
        real("distance", "m"),
        real("near", "m, distance up to which the finest scale is used"),
        real("cliff", "weight of cliff, 0..1"),
        whole("sector", "sectors along an axis", -EXACT, EXACT),
        whole("fixed_high", "upper 16 bits of the repeats per sector, in units of 2^-24", 0, 0xffff),
        whole("fixed_low", "lower 16 bits of the repeats per sector", 0, 0xffff),
        whole("scale", "tiling scale: a repeat of the texture is 2^scale times as wide as at scale 0", 0, 8),
    ],
    outputs: &[real("scales", "the finer scale plus the weight of the coarser one, octaves"), real("coordinate", "0..1")],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 7>) -> array<f32, 2> {
    let scales = tiling_scales(row[0], row[1], row[2]);
    let per_sector = bitcast<i32>((u32(row[4]) << 16u) | u32(row[5]));
    return array<f32, 2>(scales.x + scales.y, tiling_fixed(i32(row[3]), per_sector, u32(row[6])));
}",
    single: tiling_row,
    double: tiling_row,
    random: |d| {
        let far = d.between(-3.0, 14.0).exp2();
        vec![far, 30.0, d.between(-0.1, 1.1), d.whole(320) - 160.0, d.whole(1 << 16), d.whole(1 << 16), d.whole(9)]
    },
    judge: |_, got, want| {
        // The first result is the finer scale plus the weight of the coarser scale. This sum is continuous where the finer scale changes by 1. The
        // second result, a coordinate in fixed point, is exact.
        both(close(&got[..1], &want[..1], level_error(7.0, 4.0)), close(&got[1..], &want[1..], 1e-9))
    },
    measures: &[
        Measure { name: "scale", unit: "octaves", error: |_, got, want| farthest(&got[..1], &want[..1]) },
        Measure { name: "coordinate", unit: "repeats", error: |_, got, want| farthest(&got[1..], &want[1..]) },
    ],
    parameters: &[],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn tiling_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (scale, part) = tiling::scales(row[0], row[1], row[2]);
    out.push(T::of(f64::from(scale)) + part);
    let [high, low, scale] = take::<T, 3>(row, 4).map(|v| v.to_f64() as u32);
    out.push(tiling::fixed(row[3].to_f64() as i32, (high << 16 | low).cast_signed(), scale));
}

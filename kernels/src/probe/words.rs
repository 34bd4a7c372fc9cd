//! Integer hashes.

use super::judge::{Verdict, equal};
use super::{Measure, Probe, real, take, whole};
use crate::shared::hash;
use crate::shared::real::Real;

/// Last value of half a word.
const HALF: i32 = 0xffff;

pub(super) const HASH: Probe = Probe {
    name: "hash",
    about: "The integer hashes, PCG and PCG4D, and their mixture; words in halves of 16 bits, which f32 holds exactly",
    inputs: &[
        whole("x_low", "low half of a word", 0, HALF),
        whole("x_high", "its high half", 0, HALF),
        whole("y_low", "low half", 0, HALF),
        whole("y_high", "high half", 0, HALF),
        whole("z_low", "low half", 0, HALF),
        whole("z_high", "high half", 0, HALF),
        whole("w_low", "low half", 0, HALF),
        whole("w_high", "high half", 0, HALF),
    ],
    outputs: &[
        whole("pcg_low", "of x", 0, HALF),
        whole("pcg_high", "of x", 0, HALF),
        whole("pcg4d_x_low", "of all four", 0, HALF),
        whole("pcg4d_x_high", "of all four", 0, HALF),
        whole("pcg4d_y_low", "of all four", 0, HALF),
        whole("pcg4d_y_high", "of all four", 0, HALF),
        whole("pcg4d_z_low", "of all four", 0, HALF),
        whole("pcg4d_z_high", "of all four", 0, HALF),
        whole("pcg4d_w_low", "of all four", 0, HALF),
        whole("pcg4d_w_high", "of all four", 0, HALF),
        whole("mix_low", "of x, y and z", 0, HALF),
        whole("mix_high", "of x, y and z", 0, HALF),
        real("unit", "w as a number of 0..1"),
    ],
    // As bits of f32 words would be NaN or denormal at times, and need not survive.
    wgsl: "\
fn word(low: f32, high: f32) -> u32 { return u32(low) | (u32(high) << 16u); }
fn probe(row: array<f32, 8>) -> array<f32, 13> {
    let v = vec4<u32>(word(row[0], row[1]), word(row[2], row[3]), word(row[4], row[5]), word(row[6], row[7]));
    let four = hash_pcg4d(v);
    var words = array<u32, 6>(hash_pcg(v.x), four.x, four.y, four.z, four.w, hash_mix(v.x, v.y, v.z));
    var out: array<f32, 13>;
    for (var i = 0u; i < 6u; i++) {
        out[2u * i] = f32(words[i] & 0xffffu);
        out[2u * i + 1u] = f32(words[i] >> 16u);
    }
    out[12] = hash_to_unit(v.w);
    return out;
}",
    single: hash_row,
    double: hash_row,
    random: |d| (0..8).map(|_| d.whole(1 << 16)).collect(),
    judge: hash_judge,
    measures: &[Measure { name: "words", unit: "that differ", error: |_, got, want| differing(got, want) }],
    parameters: &[],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn hash_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let [a, b, c, d] = [0, 2, 4, 6].map(|at| {
        let [low, high] = take::<T, 2>(row, at).map(|half| half.to_f64() as u32);
        low | high << 16
    });
    let four = hash::pcg4d([a, b, c, d]);
    let words = [hash::pcg(a), four[0], four[1], four[2], four[3], hash::mix(a, b, c)];
    out.extend(words.into_iter().flat_map(|word| [word & 0xffff, word >> 16]).map(|half| T::of(f64::from(half))));
    out.push(hash::to_unit(d));
}

fn hash_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    equal(row, got, want)
}

fn differing(got: &[f64], want: &[f64]) -> f64 {
    let words = got.chunks(2).zip(want.chunks(2)).filter(|(got, want)| got != want).count();
    f64::from(u32::try_from(words).unwrap_or(u32::MAX))
}

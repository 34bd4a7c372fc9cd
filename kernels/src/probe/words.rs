//! Probe of the integer hashes.

use super::judge::{Verdict, equal};
use super::{Cell, Measure, Probe, real, take, word};
use crate::shared::hash;

pub(super) const HASH: Probe = Probe {
    name: "hash",
    about: "The integer hashes PCG and PCG4D, and the hash that mixes three words into one",
    inputs: &[word("x", "a word"), word("y", "a word"), word("z", "a word"), word("w", "a word")],
    outputs: &[
        word("pcg", "PCG hash of x"),
        word("pcg4d_x", "first word of the PCG4D hash of x, y, z, w"),
        word("pcg4d_y", "second word"),
        word("pcg4d_z", "third word"),
        word("pcg4d_w", "fourth word"),
        word("mix", "mixture of x, y and z"),
        real("unit", "w converted to a number in 0..1"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<u32, 4>) -> array<u32, 7> {
    let v = vec4<u32>(row[0], row[1], row[2], row[3]);
    let four = hash_pcg4d(v);
    return array<u32, 7>(hash_pcg(v.x), four.x, four.y, four.z, four.w, hash_mix(v.x, v.y, v.z), bitcast<u32>(hash_to_unit(v.w)));
}",
    single: hash_row,
    double: hash_row,
    random: |d| (0..4).map(|_| f64::from(d.word())).collect(),
    judge: hash_judge,
    measures: &[Measure { name: "words", unit: "that differ", error: |_, got, want| differing(got, want) }],
    parameters: &[],
};

fn hash_row<T: Cell>(row: &[T], out: &mut Vec<T>) {
    let [a, b, c, d] = take::<T, 4>(row, 0).map(T::word);
    let four = hash::pcg4d([a, b, c, d]);
    out.extend([hash::pcg(a), four[0], four[1], four[2], four[3], hash::mix(a, b, c)].map(T::of_word));
    out.push(hash::to_unit(d));
}

fn hash_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    equal(row, got, want)
}

fn differing(got: &[f64], want: &[f64]) -> f64 {
    let words = got.iter().zip(want).filter(|(got, want)| got != want).count();
    f64::from(u32::try_from(words).unwrap_or(u32::MAX))
}

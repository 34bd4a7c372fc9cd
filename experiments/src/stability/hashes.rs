//! Tests the output bits of the hashes: how often each bit is 1 (balance), and how often it changes if one bit of the input changes (avalanche).

use kernels::shared::hash;
use rayon::prelude::*;

use super::Row;
use super::statistics::{Random, coverage_p, normal_bound, sidak};

/// Number of samples of each test.
pub const SAMPLES: u32 = 1_000_000;
/// Index of the lowest bit of a hash that affects a threshold, a number in [0, 1) that is computed from the hash (`hash::to_unit`).
pub const FIRST_BIT: usize = 8;
/// Number of low bits in an input word of [`hash::pcg4d`] for which the avalanche is complete: flipping one of these bits changes every bit of a
/// threshold with a probability of one half. Flipping a higher bit changes the lowest output bits less often, because products carry only to higher
/// bits. For example, input bit b, from 25 on, never changes the output bits from [`FIRST_BIT`] to b - 17. Each of these output bits changes a
/// threshold by at most 2^-18.
pub const MIXED_BITS: usize = 21;
/// Limit for the higher input bits of a word of [`hash::pcg4d`], from index [`MIXED_BITS`] on. If such a bit is flipped, each bit in the highest byte
/// of a threshold changes with a probability p, and |p - 1/2| is at most this value.
pub const COARSE_DEVIATION: f64 = 0.2;
/// Limit for a single [`hash::pcg`]. If an input bit is flipped, each output bit changes with a probability p, and |p - 1/2| is at most this value.
/// Input bit 21 causes the largest deviation. The limit also applies to the third word of [`hash::mix`], the size of the noise's cells, because this
/// word passes through only one `pcg`. The result of `mix` is then hashed again, by [`hash::pcg4d`].
pub const SINGLE_DEVIATION: f64 = 0.1;

/// A hash as a function from four words to four words. A hash with fewer input words ignores the other words. A hash with fewer output words returns
/// 0 for the other words.
type Hash = fn([u32; 4]) -> [u32; 4];

/// For each hash: name, number of input words, number of output words, and function.
const HASHES: [(&str, usize, usize, Hash); 3] = [
    ("pcg", 1, 1, |[a, ..]| [hash::pcg(a), 0, 0, 0]),
    ("mix", 3, 1, |[a, b, c, _]| [hash::mix(a, b, c), 0, 0, 0]),
    ("pcg4d", 4, 4, hash::pcg4d),
];

/// Counts for each bit of four words how often it is 1.
struct Counts {
    /// Each number contains sixteen counters of 8 bits. Byte l of number s counts the bit with the index 8 l + s.
    narrow: [u128; 8],
    /// Number of additions that are possible before a counter in `narrow` could overflow. At 0, the counters are added to `wide` and reset.
    left: u32,
    /// Counters of all 128 bits. They do not include the counts in `narrow`.
    wide: [u32; 128],
}

impl Counts {
    const EVERY_BYTE: u128 = u128::MAX / 255;

    fn new() -> Counts {
        Counts { narrow: [0; 8], left: 255, wide: [0; 128] }
    }

    fn add(&mut self, [a, b, c, d]: [u32; 4]) {
        let all = u128::from(a) | u128::from(b) << 32 | u128::from(c) << 64 | u128::from(d) << 96;
        for (shift, counter) in self.narrow.iter_mut().enumerate() {
            *counter += all >> shift & Self::EVERY_BYTE;
        }
        self.left -= 1;
        if self.left == 0 {
            self.spill();
        }
    }

    fn spill(&mut self) {
        for (shift, counter) in self.narrow.iter_mut().enumerate() {
            for (lane, byte) in counter.to_le_bytes().into_iter().enumerate() {
                self.wide[lane * 8 + shift] += u32::from(byte);
            }
            *counter = 0;
        }
        self.left = 255;
    }

    fn finish(mut self) -> [u32; 128] {
        self.spill();
        self.wide
    }
}

/// Returns the input words for cell `i` of a lattice, similar to the words that the renderer hashes.
fn lattice(i: u32) -> [u32; 4] {
    [i % 100, i / 100 % 100, i / 10_000, 0x5eed]
}

/// Measures two properties of each hash.
///
/// *Balance* of an output bit: the bit should be 1 in half of the hashes. The value is the p-value of this hypothesis, over consecutive numbers or
/// the cells of a lattice.
///
/// *Avalanche* of an input bit: flipping it should change each output bit that affects a threshold for half of the inputs. The shares are counted
/// over random inputs, and the value is the largest deviation of a share from one half. For some input bits, the avalanche should be complete, so the
/// limit follows from one family of tests with a level of 0.1 %. For the other input bits, the limits are constants of this module; for
/// [`hash::pcg4d`], only the highest byte is then tested.
pub fn rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for (name, _, words, hash) in HASHES {
        let mut counts = Counts::new();
        // Hashes of a single word are tested with consecutive numbers.
        (0..SAMPLES).for_each(|i| counts.add(hash(if name == "pcg" { [i, 0, 0, 0] } else { lattice(i) })));
        let set = counts.finish();
        let of_bit = |bit: usize| row(name, bit, "balance p", coverage_p(u64::from(set[bit]), u64::from(SAMPLES), 0.5), 1.0);
        rows.extend((0..32 * words).map(of_bit));
    }
    let inputs: Vec<_> = HASHES.iter().flat_map(|hash| (0..32 * hash.1).map(move |bit| (hash, bit))).collect();
    let turned: Vec<[u32; 128]> = inputs.par_iter().map(|&(&(_, _, _, hash), bit)| turned_over(hash, bit)).collect();
    let complete = |name: &str, bit: usize| match name {
        "pcg4d" => bit % 32 < MIXED_BITS,
        // Words 0 and 1 are the seed and the salt, which pass through `pcg` more than once.
        "mix" => bit < 64,
        _ => false,
    };
    let counted: usize = inputs.iter().filter(|(hash, bit)| complete(hash.0, *bit)).map(|(hash, _)| (32 - FIRST_BIT) * hash.2).sum();
    let chance = normal_bound(sidak(counted)) * 0.5 / f64::from(SAMPLES).sqrt();
    for ((&(name, _, words, _), bit), counts) in inputs.into_iter().zip(turned) {
        let worst = |from: usize| {
            let deviation = |out: usize| (f64::from(counts[out]) / f64::from(SAMPLES) - 0.5).abs();
            (0..32 * words).filter(|out| out % 32 >= from).map(deviation).fold(0.0, f64::max)
        };
        if complete(name, bit) {
            rows.push(row(name, bit, "avalanche", worst(FIRST_BIT), chance));
        } else if name == "pcg4d" {
            rows.push(row(name, bit, "avalanche of the high byte", worst(24), COARSE_DEVIATION));
        } else {
            rows.push(row(name, bit, "avalanche", worst(FIRST_BIT), SINGLE_DEVIATION));
        }
    }
    rows
}

fn row(hash: &str, bit: usize, statistic: &str, value: f64, high: f64) -> Row {
    let (view, motion) = (format!("word {}", bit / 32), format!("bit {}", bit % 32));
    Row { kind: hash.to_owned(), view, motion, statistic: statistic.to_owned(), value, low: 0.0, high }
}

/// Returns for each output bit how often it changes when bit `bit` of the input is flipped, over [`SAMPLES`] random inputs.
fn turned_over(hash: Hash, bit: usize) -> [u32; 128] {
    let mut counts = Counts::new();
    let mut random = Random(bit as u64 + 1);
    for _ in 0..SAMPLES {
        let [low, high] = [random.word(), random.word()];
        #[allow(clippy::cast_possible_truncation, reason = "splits 64-bit numbers into words")]
        let words = [low as u32, (low >> 32) as u32, high as u32, (high >> 32) as u32];
        let mut other = words;
        other[bit / 32] ^= 1 << (bit % 32);
        let (a, b) = (hash(words), hash(other));
        counts.add(std::array::from_fn(|k| a[k] ^ b[k]));
    }
    counts.finish()
}

//! Integer hashes, bit-equal on every machine.
//!
//! Source: Jarzynski & Olano, *Hash Functions for GPU Rendering*, JCGT 9(3), 2020.

use super::real::Real;

/// Hashes one word to one word: PCG-RXS-M-XS with a 32-bit state.
#[inline]
pub const fn pcg(v: u32) -> u32 {
    let state = v.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
    let word = ((state >> ((state >> 28) + 4)) ^ state).wrapping_mul(277_803_737);
    (word >> 22) ^ word
}

/// Hashes four words to four words. Each result depends on all four inputs.
#[inline]
pub fn pcg4d(v: [u32; 4]) -> [u32; 4] {
    // Each word is increased by the product of two others: (target, factor, factor).
    const ROUND: [(usize, usize, usize); 4] = [(0, 1, 3), (1, 2, 0), (2, 0, 1), (3, 1, 2)];
    let round = |h: &mut [u32; 4]| {
        for (to, a, b) in ROUND {
            h[to] = h[to].wrapping_add(h[a].wrapping_mul(h[b]));
        }
    };
    let mut h = v.map(|x| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    round(&mut h);
    h = h.map(|x| x ^ (x >> 16));
    round(&mut h);
    h
}

/// Converts a hash to a uniform number in [0, 1): its 24 high bits, which f32 holds exactly.
#[inline]
pub fn to_unit<T: Real>(h: u32) -> T {
    T::of(f64::from(h >> 8) / 16_777_216.0)
}

/// Mixes three parameters into one word, so that a hash of four words has three words left for the coordinates of a cell.
#[inline]
pub const fn mix(seed: u32, salt: u32, level: u32) -> u32 {
    // The hashes are chained, not added or xored, so that neighbouring seeds, salts and levels do not cancel each other.
    pcg(level.wrapping_add(pcg(salt.wrapping_add(pcg(seed)))))
}

/// A uniform number in [0, 1), with 32 bits, for a cell of an integer grid. Tests use it as a source of random numbers.
#[inline]
pub fn unit2(ix: i32, iy: i32, seed: u32, salt: u32) -> f64 {
    f64::from(pcg4d([ix.cast_unsigned(), iy.cast_unsigned(), seed, salt])[0]) / 4_294_967_296.0
}

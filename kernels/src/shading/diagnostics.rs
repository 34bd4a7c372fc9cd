//! Diagnostics that shading records for each pixel on request: counted fetches, first random choice and tile mask, packed into 32 bits.

use crate::base::wgsl::{Constant, Wgsl};

/// Number of bits for the counted fetches. The choice has [`CHOICE_BITS`] bits, and the mask has the remaining bits.
const FETCH_BITS: u32 = 16;
const CHOICE_BITS: u32 = 8;

/// `diagnostics.wgsl`: `diagnostics_pack`, and the functions that extract the fetches and the choice from its result.
pub static WGSL: Wgsl = Wgsl::new("shading/diagnostics.wgsl", include_str!("diagnostics.wgsl"), &[])
    .with(&[("DIAGNOSTICS_FETCH_BITS", Constant::U32(FETCH_BITS)), ("DIAGNOSTICS_CHOICE_BITS", Constant::U32(CHOICE_BITS))]);

/// Returns the number of counted fetches.
pub fn fetches(word: u32) -> u32 {
    word & ((1 << FETCH_BITS) - 1)
}

/// Returns the first random choice: 1 + splat texel + 4 x projection; 0 = none.
pub fn choice(word: u32) -> u32 {
    word >> FETCH_BITS & ((1 << CHOICE_BITS) - 1)
}

/// Returns the mask of the tile's flavours; 0 = sky.
pub fn mask(word: u32) -> u32 {
    word >> (FETCH_BITS + CHOICE_BITS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_share_no_bit_and_leave_none_out() {
        let word = |parts: [u32; 3]| parts[0] | parts[1] << FETCH_BITS | parts[2] << (FETCH_BITS + CHOICE_BITS);
        for parts in [[0, 0, 0], [0xffff, 0, 0], [0, 0xff, 0], [0, 0, 0xff], [96, 12, 31]] {
            let packed = word(parts);
            assert_eq!([fetches(packed), choice(packed), mask(packed)], parts);
        }
        assert_eq!([fetches(u32::MAX), choice(u32::MAX), mask(u32::MAX)], [0xffff, 0xff, 0xff]);
    }
}

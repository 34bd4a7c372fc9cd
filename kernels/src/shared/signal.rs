//! A pixel of a measured sequence, packed into two words: the linear colour as f16, and the number of texture fetches and the first random choice
//! that the shading pass recorded.

use half::f16;

use crate::base::colour;
use crate::base::wgsl::Constant;

/// Largest colour value that f16 can hold.
pub const LARGEST: f32 = 65_504.0;
/// Number of bits for the number of fetches. From the lowest bit up, the second word holds 16 bits of blue, the number of fetches, the first random
/// choice (`CHOICE_BITS` bits), and the bit [`TERRAIN`].
const FETCH_BITS: u32 = 10;
const CHOICE_BITS: u32 = 5;
const CHOICE_FROM: u32 = 16 + FETCH_BITS;
/// Bit of the second word that marks terrain.
pub const TERRAIN: u32 = 0x8000_0000;

/// Constants that the host passes to `signal.wgsl`.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("SIGNAL_TERRAIN", Constant::U32(TERRAIN)),
    ("SIGNAL_LARGEST", Constant::F32(LARGEST)),
    ("SIGNAL_FETCH_BITS", Constant::U32(FETCH_BITS)),
    ("SIGNAL_CHOICE_BITS", Constant::U32(CHOICE_BITS)),
    ("SIGNAL_RED", Constant::real(colour::LUMINANCE[0])),
    ("SIGNAL_GREEN", Constant::real(colour::LUMINANCE[1])),
    ("SIGNAL_BLUE", Constant::real(colour::LUMINANCE[2])),
];

/// Packs a terrain pixel: colour (clamped to the range of f16; numbers that are not finite count as zero), fetches (at most 1023) and first random
/// choice (at most 31, 0 = none). In WGSL: `signal_pack`.
pub fn pack(colour: [f32; 3], fetches: u32, choice: u32) -> [u32; 2] {
    let bits = colour.map(|c| u32::from(f16::from_f32(if c.is_finite() { c.clamp(-LARGEST, LARGEST) } else { 0.0 }).to_bits()));
    let known = fetches.min((1 << FETCH_BITS) - 1) << 16 | choice.min((1 << CHOICE_BITS) - 1) << CHOICE_FROM;
    [bits[0] | bits[1] << 16, bits[2] | known | TERRAIN]
}

/// Whether the pixel shows terrain.
pub fn is_terrain(signal: [u32; 2]) -> bool {
    signal[1] >= TERRAIN
}

/// Linear colour.
#[allow(clippy::cast_possible_truncation, reason = "extracts 16-bit parts of a word")]
pub fn colour(signal: [u32; 2]) -> [f32; 3] {
    [signal[0] as u16, (signal[0] >> 16) as u16, signal[1] as u16].map(|bits| f16::from_bits(bits).to_f32())
}

/// Counted fetches.
pub fn fetches(signal: [u32; 2]) -> u32 {
    signal[1] >> 16 & ((1 << FETCH_BITS) - 1)
}

/// First random choice, 0 = none.
pub fn choice(signal: [u32; 2]) -> u32 {
    signal[1] >> CHOICE_FROM & ((1 << CHOICE_BITS) - 1)
}

/// Relative luminance of linear colour.
pub fn luminance(colour: [f32; 3]) -> f64 {
    colour::luminance(colour.map(f64::from))
}

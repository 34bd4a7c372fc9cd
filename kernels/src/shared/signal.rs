//! A pixel of a measured sequence in two words: linear colour as f16, and what the shading pass knew of it.

use half::f16;

use crate::base::colour;

/// Largest colour that f16 has.
pub const LARGEST: f32 = 65_504.0;
/// Bit of the second word that says terrain.
pub const TERRAIN: u32 = 0x8000_0000;

/// Colour (held within what f16 has; what is not finite counts as zero), fetches (at most 1023) and first random choice (at most 31, 0 = none) of a terrain pixel: `signal_pack`.
pub fn pack(colour: [f32; 3], fetches: u32, choice: u32) -> [u32; 2] {
    let bits = colour.map(|c| u32::from(f16::from_f32(if c.is_finite() { c.clamp(-LARGEST, LARGEST) } else { 0.0 }).to_bits()));
    let known = fetches.min(1023) | choice.min(31) << 10;
    [bits[0] | bits[1] << 16, bits[2] | known << 16 | TERRAIN]
}

/// Whether it is terrain.
pub fn is_terrain(signal: [u32; 2]) -> bool {
    signal[1] >= TERRAIN
}

/// Linear colour.
#[allow(clippy::cast_possible_truncation, reason = "takes a word apart")]
pub fn colour(signal: [u32; 2]) -> [f32; 3] {
    [signal[0] as u16, (signal[0] >> 16) as u16, signal[1] as u16].map(|bits| f16::from_bits(bits).to_f32())
}

/// Fetches that were counted.
pub fn fetches(signal: [u32; 2]) -> u32 {
    signal[1] >> 16 & 1023
}

/// First random choice, 0 = none.
pub fn choice(signal: [u32; 2]) -> u32 {
    signal[1] >> 26 & 31
}

/// Relative luminance of linear colour.
pub fn luminance(colour: [f32; 3]) -> f64 {
    colour::luminance(colour.map(f64::from))
}

//! A pixel of a measured sequence, packed into two words: a colour as f16, and the number of texture fetches and the first random choice that the
//! shading pass recorded. What the colour is depends on the [`Signal`].

use half::f16;

use crate::base::colour;
use crate::base::wgsl::Constant;

/// The quantity that the colour of a pixel stands for. Most metrics exist for both signals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Signal {
    /// Linear albedo, before lighting. Bias and variance can be predicted by theory for this signal only.
    #[default]
    Albedo,
    /// The lit picture as a screen shows it: sRGB-encoded values, after exposure and tone curve.
    Lit,
}

impl Signal {
    /// Both signals.
    pub const ALL: [Signal; 2] = [Signal::Albedo, Signal::Lit];

    /// Name in the column `signal` of tables.
    pub const fn name(self) -> &'static str {
        match self {
            Signal::Albedo => "albedo",
            Signal::Lit => "lit",
        }
    }
}

/// Largest finite number of f16. Colours are clamped to ± this value.
pub const LARGEST: f32 = 65_504.0;
/// Number of bits for the number of fetches. From the lowest bit up, the second word stores 16 bits of blue, the number of fetches, the first random
/// choice (`CHOICE_BITS` bits), and the bit [`TERRAIN`].
const FETCH_BITS: u32 = 10;
const CHOICE_BITS: u32 = 5;
const CHOICE_FROM: u32 = 16 + FETCH_BITS;
/// Bit of the second word that marks terrain.
pub const TERRAIN: u32 = 0x8000_0000;

/// The two words of a pixel of terrain whose colour is not finite. Such a pixel does not count as terrain, so metrics of colours leave it out;
/// `invalid_px` counts such pixels. No other pixel has these words: a terrain pixel with a finite colour has the bit [`TERRAIN`], and the words of
/// sky are 0.
pub const INVALID: [u32; 2] = [u32::MAX, 0xffff];

/// Constants that the host passes to `signal.wgsl`.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("SIGNAL_TERRAIN", Constant::U32(TERRAIN)),
    ("SIGNAL_INVALID_0", Constant::U32(INVALID[0])),
    ("SIGNAL_INVALID_1", Constant::U32(INVALID[1])),
    ("SIGNAL_LARGEST", Constant::F32(LARGEST)),
    ("SIGNAL_FETCH_BITS", Constant::U32(FETCH_BITS)),
    ("SIGNAL_CHOICE_BITS", Constant::U32(CHOICE_BITS)),
    ("SIGNAL_RED", Constant::real(colour::LUMINANCE[0])),
    ("SIGNAL_GREEN", Constant::real(colour::LUMINANCE[1])),
    ("SIGNAL_BLUE", Constant::real(colour::LUMINANCE[2])),
];

/// Packs a terrain pixel: colour (clamped to the range of f16), fetches (at most 1023) and first random choice (at most 31, 0 = none). A colour that
/// is not finite gives [`INVALID`]. In WGSL: `signal_pack`.
pub fn pack(colour: [f32; 3], fetches: u32, choice: u32) -> [u32; 2] {
    if colour.iter().any(|c| !c.is_finite()) {
        return INVALID;
    }
    let bits = colour.map(|c| u32::from(f16::from_f32(c.clamp(-LARGEST, LARGEST)).to_bits()));
    let known = fetches.min((1 << FETCH_BITS) - 1) << 16 | choice.min((1 << CHOICE_BITS) - 1) << CHOICE_FROM;
    [bits[0] | bits[1] << 16, bits[2] | known | TERRAIN]
}

/// Whether a packed pixel is a terrain pixel whose colour is not finite. In WGSL: `signal_is_invalid`.
pub fn is_invalid(signal: [u32; 2]) -> bool {
    signal == INVALID
}

/// Whether a packed pixel is a terrain pixel whose colour is finite.
pub fn is_terrain(signal: [u32; 2]) -> bool {
    signal[1] >= TERRAIN
}

/// The colour of a packed pixel.
#[allow(clippy::cast_possible_truncation, reason = "extracts 16-bit parts of a word")]
pub fn colour(signal: [u32; 2]) -> [f32; 3] {
    [signal[0] as u16, (signal[0] >> 16) as u16, signal[1] as u16].map(|bits| f16::from_bits(bits).to_f32())
}

/// The number of counted fetches of a packed pixel.
pub fn fetches(signal: [u32; 2]) -> u32 {
    signal[1] >> 16 & ((1 << FETCH_BITS) - 1)
}

/// The first random choice of a packed pixel; 0 = none.
pub fn choice(signal: [u32; 2]) -> u32 {
    signal[1] >> CHOICE_FROM & ((1 << CHOICE_BITS) - 1)
}

/// Luminance: the relative luminance of linear colour, or the luma of sRGB-encoded colour (Rec. ITU-R BT.709).
pub fn luminance(colour: [f32; 3]) -> f64 {
    colour::luminance(colour.map(f64::from))
}

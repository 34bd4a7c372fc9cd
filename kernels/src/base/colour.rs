//! Colour: sRGB encoding (IEC 61966-2-1) and relative luminance (Rec. ITU-R BT.709).

use num_traits::Float;

/// Weights of linear red, green and blue in relative luminance, Rec. ITU-R BT.709.
pub const LUMINANCE: [f64; 3] = [0.2126, 0.7152, 0.0722];

fn of<T: Float>(value: f64) -> T {
    T::from(value).expect("a float type holds any f64, rounded")
}

/// Relative luminance of linear colour, summed in the order red, green, blue.
pub fn luminance<T: Float>(colour: [T; 3]) -> T {
    let [r, g, b] = LUMINANCE.map(of::<T>);
    r * colour[0] + g * colour[1] + b * colour[2]
}

/// Encodes a linear value as sRGB, 0..=1. The value is clamped to 0..=1; NaN gives 0.
pub fn srgb_from_linear<T: Float>(linear: T) -> T {
    let linear = if linear > T::zero() { linear.min(T::one()) } else { T::zero() };
    if linear <= of(0.003_130_8) { of::<T>(12.92) * linear } else { of::<T>(1.055) * linear.powf(T::one() / of(2.4)) - of(0.055) }
}

/// Decodes an sRGB value in 0..=1 to a linear value.
pub fn linear_from_srgb<T: Float>(encoded: T) -> T {
    if encoded <= of(0.040_45) { encoded / of(12.92) } else { ((encoded + of(0.055)) / of(1.055)).powf(of(2.4)) }
}

/// Quantises a number in 0..=1 to the nearest 8-bit code. Numbers outside this range are clamped; NaN gives 0.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a cast of a float saturates and turns NaN into 0")]
pub fn unorm8(value: f32) -> u8 {
    (value * 255.0 + 0.5) as u8
}

/// The 8-bit sRGB code of a linear value; 0 for NaN.
pub fn srgb_code(linear: f32) -> u8 {
    unorm8(srgb_from_linear(linear))
}

//! Tone mapping in f64 and f32: the reference for `encode.wgsl`. Pictures that the device did not tone-map are mapped by this reference, too.

use super::{Exposure, ToneCurve, WHITE};
use crate::base::colour::{luminance, srgb_from_linear};
use crate::shared::real::Real;

/// Maps linear radiance to sRGB-encoded values, 0..=1. With `ToneCurve::Clip`, a channel that is NaN becomes 0. With `ToneCurve::Reinhard`, all
/// channels become 0 if one is NaN or infinite, or if the luminance is not above 0.
pub fn tone_map<T: Real>(radiance: [T; 3], exposure: Exposure) -> [T; 3] {
    let radiance = radiance.map(|c| c * T::of(exposure.factor()));
    let mapped = match exposure.tone_curve {
        ToneCurve::Reinhard => {
            let luminance = luminance(radiance);
            let white = T::of(WHITE);
            let factor = (T::one() + luminance / (white * white)) / (T::one() + luminance);
            if luminance > T::zero() { radiance.map(|c| c * factor) } else { [T::zero(); 3] }
        }
        ToneCurve::Clip => radiance,
    };
    mapped.map(srgb_from_linear)
}

/// Maps linear radiance to 8-bit sRGB codes.
pub fn codes(radiance: [f32; 3], exposure: Exposure) -> [u8; 3] {
    tone_map(radiance, exposure).map(crate::base::colour::unorm8)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Exposure = Exposure { exposure: 0.0, tone_curve: ToneCurve::Reinhard };

    #[test]
    fn white_is_mapped_to_white_and_black_to_black() {
        assert_eq!(codes([0.0; 3], PLAIN), [0; 3]);
        assert_eq!(codes([WHITE as f32; 3], PLAIN), [255; 3]);
        assert_eq!(codes([1.0; 3], Exposure { tone_curve: ToneCurve::Clip, ..PLAIN }), [255; 3]);
        assert_eq!(codes([f32::NAN, 1.0, -1.0], PLAIN), [0; 3]);
    }

    #[test]
    fn a_stop_doubles_radiance() {
        let brighter = Exposure { exposure: 1.0, ..PLAIN };
        assert_eq!(tone_map([0.1, 0.2, 0.3], brighter), tone_map([0.2, 0.4, 0.6], PLAIN));
        let darker = Exposure { exposure: -3.0, ..PLAIN };
        assert_eq!(tone_map([0.8, 1.6, 2.4], darker), tone_map([0.1, 0.2, 0.3], PLAIN));
    }

    #[test]
    fn the_curve_keeps_the_ratios_of_channels() {
        use crate::base::colour::linear_from_srgb;
        let [r, g, b] = tone_map([0.2f64, 0.4, 0.1], PLAIN).map(linear_from_srgb);
        assert!((g / r - 2.0).abs() < 1e-3 && (r / b - 2.0).abs() < 1e-3, "{r} {g} {b}");
    }
}

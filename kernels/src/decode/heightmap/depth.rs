//! Types of the stored samples of a heightmap.

/// The type in which a sample is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Depth {
    Unsigned16,
    Signed16,
    Unsigned32,
    Signed32,
    Half,
    Single,
    Double,
}

impl Depth {
    pub(super) fn words(self) -> &'static str {
        match self {
            Depth::Unsigned16 => "16-bit unsigned integers",
            Depth::Signed16 => "16-bit signed integers",
            Depth::Unsigned32 => "32-bit unsigned integers",
            Depth::Signed32 => "32-bit signed integers",
            Depth::Half => "16-bit floats",
            Depth::Single => "32-bit floats",
            Depth::Double => "64-bit floats",
        }
    }

    /// Smallest and largest possible sample; `None` for floats.
    pub(super) fn limits(self) -> Option<[f64; 2]> {
        match self {
            Depth::Unsigned16 => Some([0.0, 65_535.0]),
            Depth::Signed16 => Some([-32_768.0, 32_767.0]),
            Depth::Unsigned32 => Some([0.0, f64::from(u32::MAX)]),
            Depth::Signed32 => Some([f64::from(i32::MIN), f64::from(i32::MAX)]),
            Depth::Half | Depth::Single | Depth::Double => None,
        }
    }

    pub(super) fn is_float(self) -> bool {
        self.limits().is_none()
    }

    /// Bits of a sample.
    pub(super) fn bits(self) -> u32 {
        match self {
            Depth::Unsigned16 | Depth::Signed16 | Depth::Half => 16,
            Depth::Unsigned32 | Depth::Signed32 | Depth::Single => 32,
            Depth::Double => 64,
        }
    }

    /// Whether an f32 can hold each possible sample of this type exactly.
    pub(super) fn fits_single(self) -> bool {
        matches!(self, Depth::Unsigned16 | Depth::Signed16 | Depth::Half | Depth::Single)
    }
}

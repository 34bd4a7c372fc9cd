//! How the shading normal of a pixel and the normal of its triangle's plane are stored between the geometry pass and the passes that read them.

use std::fmt;
use std::str::FromStr;

use crate::base::wgsl::Constant;
use crate::shared::{normal_pair, octahedral};

/// Constants that the host passes to `frame.wgsl`.
pub(super) const CONSTANTS: &[(&str, Constant)] = &[
    ("NORMALS_OCTAHEDRAL", Constant::U32(NormalEncoding::Octahedral.code())),
    ("NORMALS_PLANE_FIRST", Constant::U32(NormalEncoding::PlaneFirst.code())),
    ("NORMALS_EXACT", Constant::U32(NormalEncoding::Exact.code())),
];

/// How the two normals of a pixel are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NormalEncoding {
    /// Two octahedral encodings of 8 + 8 bits, as in Far Cry 5.
    #[default]
    Octahedral,
    /// 32 bits, as `Octahedral`. If the two normals are near each other, the normal of the triangle's plane is stored with 8 times finer
    /// steps, and the shading normal is stored relative to the plane. The shading normal always decodes to the same 8 + 8 bits as with
    /// `Octahedral`. See [`normal_pair`].
    PlaneFirst,
    /// Two octahedral encodings in f32, without rounding to integers: 128 bits. The errors of the other encodings are measured against this
    /// encoding.
    Exact,
}

/// The error for a text that is not an encoding of normals.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{given}` is not an encoding of normals: give one of {}", NormalEncoding::ALL.map(NormalEncoding::name).join(", "))]
pub struct NotAnEncoding {
    given: String,
}

impl NormalEncoding {
    /// All encodings, in the order of their codes.
    pub const ALL: [NormalEncoding; 3] = [NormalEncoding::Octahedral, NormalEncoding::PlaneFirst, NormalEncoding::Exact];

    /// The encoding's number in shaders.
    pub const fn code(self) -> u32 {
        match self {
            NormalEncoding::Octahedral => 0,
            NormalEncoding::PlaneFirst => 1,
            NormalEncoding::Exact => 2,
        }
    }

    /// The name used in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            NormalEncoding::Octahedral => "octahedral",
            NormalEncoding::PlaneFirst => "plane-first",
            NormalEncoding::Exact => "exact",
        }
    }

    /// Format of the render target that stores the normals.
    pub const fn format(self) -> wgpu::TextureFormat {
        match self {
            NormalEncoding::Octahedral | NormalEncoding::PlaneFirst => wgpu::TextureFormat::Rgba8Unorm,
            NormalEncoding::Exact => wgpu::TextureFormat::Rgba32Float,
        }
    }

    /// Bytes of a texel.
    pub const fn bytes(self) -> u32 {
        match self {
            NormalEncoding::Octahedral | NormalEncoding::PlaneFirst => 4,
            NormalEncoding::Exact => 16,
        }
    }

    /// Decodes a texel of [`Self::bytes`] bytes to two unit vectors: the shading normal and the normal of the triangle's plane. In WGSL:
    /// `frame_shading_normal` and `frame_plane`. With `PlaneFirst`, the plane's normal may be the opposite of the triangle's normal.
    ///
    /// # Panics
    /// If the texel does not have [`Self::bytes`] bytes.
    pub fn decode(self, texel: &[u8]) -> [[f64; 3]; 2] {
        let of_code = |code: [u32; 2]| octahedral::decode(octahedral::dequantise(code, 8));
        match self {
            NormalEncoding::Octahedral => {
                let [x, y, z, w]: [u8; 4] = texel.try_into().expect("4 bytes");
                [[x, y], [z, w]].map(|code| of_code(code.map(u32::from)))
            }
            NormalEncoding::PlaneFirst => {
                let pair = normal_pair::decode(u32::from_le_bytes(texel.try_into().expect("4 bytes")));
                [of_code(pair.shading), pair.plane]
            }
            NormalEncoding::Exact => {
                let [x, y, z, w]: [f32; 4] = bytemuck::pod_read_unaligned(texel);
                [[x, y], [z, w]].map(|e| octahedral::decode(e.map(f64::from)))
            }
        }
    }
}

impl fmt::Display for NormalEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for NormalEncoding {
    type Err = NotAnEncoding;

    fn from_str(text: &str) -> std::result::Result<Self, NotAnEncoding> {
        NormalEncoding::ALL.into_iter().find(|encoding| encoding.name() == text).ok_or_else(|| NotAnEncoding { given: text.to_owned() })
    }
}

//! Normal cones, for back-face culling of whole patches. A patch has 16 x 16 quads. Its cone contains the normals of all its triangles.
//!
//! A cone is an axis a and a half angle. For every triangle normal n of the patch, the angle between n and a is at most the half angle.
//!
//! The cone of a patch is stored in one texel of a BC3 image (SYSTEMS A: Moore, GDC 2018, the part on terrain data). Red and green store x and y of
//! the axis (a coordinate v as 0.5 v + 0.5), alpha stores sin(half angle). The z of the axis is >= 0 and follows from x and y. Alpha 255 means that
//! the cone never culls the patch. It is used for half angles near 90 degrees and above.
//!
//! Block compression can turn the axis by several degrees. The half angle is therefore measured from the *decoded* axis. The alpha block is written
//! so that no decoded sine is smaller than the sine that its cone needs (ruling 5 in `ARCHITECTURE.md`).

use crate::blocks::{self, BlockFormat, Effort};

/// Patches along a node's edge.
pub const PATCHES: usize = 8;

/// The cone of a patch, as a shader decodes it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    /// Unit axis, z >= 0.
    pub axis: [f64; 3],
    /// Sine of the half angle, 0..=1; 1 means that the cone never culls the patch.
    pub sin_half_angle: f64,
}

impl Cone {
    /// Whether the cone contains this unit normal.
    pub fn contains(&self, normal: [f64; 3]) -> bool {
        let cosine = (1.0 - self.sin_half_angle * self.sin_half_angle).max(0.0).sqrt();
        self.sin_half_angle >= 1.0 || dot(self.axis, normal) >= cosine - 1e-12
    }
}

/// Encodes the cones of 64 patches from the unit triangle normals of each patch (row 0 = south). Returns 64 bytes: a BC3 image of 8 x 8
/// texels.
///
/// # Panics
/// If there are not 64 patches.
pub fn encode(patch_normals: &[Vec<[f64; 3]>]) -> Vec<u8> {
    assert_eq!(patch_normals.len(), PATCHES * PATCHES, "there must be one list of normals for each of the 8 x 8 patches");
    let mut rgba = vec![0u8; PATCHES * PATCHES * 4];
    for (normals, texel) in patch_normals.iter().zip(rgba.chunks_exact_mut(4)) {
        let axis = enclosing_axis(normals);
        texel.copy_from_slice(&[to_code(axis[0]), to_code(axis[1]), 128, 255]);
    }
    let mut encoded = blocks::encode(BlockFormat::Bc3, &rgba, PATCHES, PATCHES, [1.0, 1.0, 0.0], Effort::Best);
    let decoded = blocks::decode(BlockFormat::Bc3, &encoded, PATCHES, PATCHES);
    let needed: Vec<u8> = patch_normals.iter().zip(decoded.chunks_exact(4)).map(|(n, t)| needed_code(n, t[0], t[1])).collect();
    for (index, block) in encoded.chunks_exact_mut(16).enumerate() {
        let (block_x, block_y) = (index % 2, index / 2);
        let values = std::array::from_fn(|i| needed[(block_y * 4 + i / 4) * PATCHES + block_x * 4 + i % 4]);
        block[..8].copy_from_slice(&blocks::alpha_block_at_least(values));
    }
    encoded
}

/// Decodes 64 cones (row 0 = south, x fastest), as a shader does.
///
/// # Panics
/// If `bytes` is not a BC3 image of 8 x 8 texels.
pub fn decode(bytes: &[u8]) -> Vec<Cone> {
    let rgba = blocks::decode(BlockFormat::Bc3, bytes, PATCHES, PATCHES);
    rgba.chunks_exact(4)
        .map(|t| Cone { axis: axis_of(f64::from(t[0]), f64::from(t[1])), sin_half_angle: f64::from(t[3]) / 255.0 })
        .collect()
}

fn to_code(v: f64) -> u8 {
    (v * 127.5 + 127.5).round().clamp(0.0, 255.0) as u8
}

/// The unit axis that two stored values (0..=255) encode. Values outside the unit circle are moved to the nearest point on it.
fn axis_of(red: f64, green: f64) -> [f64; 3] {
    let (x, y) = (red / 127.5 - 1.0, green / 127.5 - 1.0);
    let xy = x * x + y * y;
    if xy >= 1.0 {
        let scale = 1.0 / xy.sqrt();
        [x * scale, y * scale, 0.0]
    } else {
        [x, y, (1.0 - xy).sqrt()]
    }
}

/// Returns the smallest 8-bit alpha with which the cone contains all normals, plus a margin; at most 255. `red` and `green` are the decoded values of
/// the axis. The margin is for decoders that round differently.
///
/// An interpolated colour may differ by 1/255 between decoders, so the cone must also contain all normals if red, green or both change by 1/255. An
/// interpolated alpha may also differ by 1/255, so 1/255 is added to alpha.
fn needed_code(normals: &[[f64; 3]], red: u8, green: u8) -> u8 {
    // Only the cone that contains all directions is safe for a normal that is NaN or infinite.
    if normals.iter().flatten().any(|x| !x.is_finite()) {
        return 255;
    }
    let (red, green) = (f64::from(red), f64::from(green));
    let mut least_cosine = 1.0f64;
    for dr in [-1.0, 0.0, 1.0] {
        for dg in [-1.0, 0.0, 1.0] {
            let axis = axis_of((red + dr).clamp(0.0, 255.0), (green + dg).clamp(0.0, 255.0));
            for &normal in normals {
                least_cosine = least_cosine.min(dot(axis, normal));
            }
        }
    }
    if least_cosine <= 0.0 {
        return 255;
    }
    let sine = (1.0 - least_cosine * least_cosine).max(0.0).sqrt();
    ((sine * 255.0).ceil() + 1.0).min(255.0) as u8
}

/// An axis near the centre of the smallest cone around the normals. The axis starts at the mean of the normals, and moves 16 times towards the
/// normal that is farthest from it (Badoiu & Clarkson 2003, "Smaller core-sets for balls", applied to points on the sphere).
fn enclosing_axis(normals: &[[f64; 3]]) -> [f64; 3] {
    let sum = normals.iter().fold([0.0; 3], |s, n| [s[0] + n[0], s[1] + n[1], s[2] + n[2]]);
    let mut axis = normalize(sum);
    for step in 2..18u32 {
        let cosines = normals.iter().map(|&normal| (dot(axis, normal), normal));
        let Some((_, farthest)) = cosines.min_by(|(a, _), (b, _)| a.total_cmp(b)) else { break };
        let share = 1.0 / f64::from(step + 1);
        axis = normalize([0, 1, 2].map(|i| axis[i] + (farthest[i] - axis[i]) * share));
    }
    axis
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn normalize(a: [f64; 3]) -> [f64; 3] {
    crate::shared::real::normalize(a)
}

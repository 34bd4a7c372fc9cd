//! The virtual texture in f64: the reference for its pages, its levels and its filtering.
//!
//! A page of level l stores the splat blend as seen from above. The texel centres of mip 0 are 2^l / 256 m apart; those of mip 1 are twice as far
//! apart. Texels of neighbouring pages form one grid that begins at the south-west corner of the world, so the reference needs no pages: it evaluates
//! the blend at the texels around a position, and filters them.

use glam::{DVec2, DVec3};

use super::{LEVELS, TEXELS_PER_M};
use crate::terrain::reference::{Ground, Projection, Surface};

/// Size of a footprint, in texels of level 0: max(a, b / `anisotropy`) * 2^`mip_bias`. Here a is the horizontal length of the shorter of the two
/// `steps`, and b that of the longer. The `steps` lead to the two neighbouring pixels, metres. `anisotropy`: the largest anisotropy of page
/// filtering.
pub fn texels(steps: [DVec3; 2], mip_bias: f64, anisotropy: f64) -> f64 {
    let [a, b] = steps.map(|step| step.truncate().length());
    a.min(b).max(a.max(b) / anisotropy) * TEXELS_PER_M * mip_bias.exp2()
}

/// The level of the pages that a footprint samples.
pub fn level(steps: [DVec3; 2], mip_bias: f64, anisotropy: f64) -> u32 {
    let level = texels(steps, mip_bias, anisotropy).max(1.0).log2().floor();
    (level as u32).min(LEVELS - 1)
}

/// The surface of the pages at a position (metres from the south-west corner of the world), filtered isotropically. `None` if a texel around the
/// position is not covered by a loaded node.
pub fn sample(ground: &Ground<'_>, position: DVec3, steps: [DVec3; 2], mip_bias: f64) -> Option<Surface> {
    let level = level(steps, mip_bias, 1.0);
    // Mip level within the page, from the number of page texels that the horizontal part of the longer step covers.
    let longest = steps.map(|step| step.truncate().length()).into_iter().fold(0.0, f64::max) * TEXELS_PER_M * mip_bias.exp2();
    let mip = (longest.log2() - f64::from(level)).clamp(0.0, 1.0);
    let [fine, coarse] = [0, 1].map(|mip| bilinear(ground, position.truncate(), f64::from(1u32 << (level + mip)) / TEXELS_PER_M));
    Some(Surface::default().plus(1.0 - mip, fine?).plus(mip, coarse?))
}

/// Bilinearly filters the four texels around a position. Neighbouring texels are `texel_m` metres apart. A texel stores the gradient as a normal.
fn bilinear(ground: &Ground<'_>, at: DVec2, texel_m: f64) -> Option<Surface> {
    let texels = at / texel_m - 0.5;
    let corner = texels.floor();
    let f = texels - corner;
    let mut sum = Surface::default();
    let mut normal = DVec3::ZERO;
    for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
        let weight = (if dx > 0.0 { f.x } else { 1.0 - f.x }) * (if dy > 0.0 { f.y } else { 1.0 - f.y });
        let texel = texel(ground, (corner + DVec2::new(dx, dy) + 0.5) * texel_m, texel_m)?;
        sum = sum.plus(weight, texel);
        normal += weight * DVec3::new(-texel.gradient.x, -texel.gradient.y, 1.0).normalize();
    }
    let z = (1.0 - normal.truncate().length_squared()).max(0.01).sqrt();
    Some(Surface { gradient: DVec3::new(-normal.x / z, -normal.y / z, 0.0), ..sum })
}

/// One texel: the blend of the splat map as seen from above.
fn texel(ground: &Ground<'_>, centre: DVec2, texel_m: f64) -> Option<Surface> {
    let spot = ground.spot(centre)?;
    let steps = [DVec3::new(texel_m, 0.0, 0.0), DVec3::new(0.0, texel_m, 0.0)];
    // The mip bias is applied where pages are sampled.
    Some(ground.blend(&ground.cell(&spot), &Projection::of(2, centre.extend(0.0), steps, 0.0), 0))
}

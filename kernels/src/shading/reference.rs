//! Shading in f64: the reference for the exact blends of the five flavours and for their sum.
//!
//! It covers Far Cry 5's flavours with random choices replaced by their means ([`Estimator::Exact`](super::Estimator)), at the centres of pixels.
//! Other tests check the random choices: their mean is compared with `Estimator::Exact`, and the noise and the selection by weights are compared with
//! references of their own.
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, "Cliff Shading", "Terrain Shader Variations".

use glam::DVec3;

use crate::scene::{Blend, FlavourRules};
use crate::shared::flavour_weights::{self, FlavourParams};
use crate::shared::{tiling, triplanar};
use crate::terrain::reference::{Ground, Projection, Surface};
use crate::variant::{Flavour, Variant};
use crate::virtual_texture;

/// A pixel to shade.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Metres from the south-west corner of the world, and elevation.
    pub position: DVec3,
    /// Change of the position to the next pixel on the right and to the next one below, metres.
    pub steps: [DVec3; 2],
    /// Shading normal, of unit length.
    pub normal: DVec3,
    /// Distance from the eye along the ray, metres.
    pub distance_m: f64,
}

/// A shaded pixel, as in the G-buffer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shaded {
    /// Linear albedo.
    pub albedo: DVec3,
    /// Unit normal.
    pub normal: DVec3,
    /// 1 - perceptual roughness.
    pub smoothness: f64,
    /// Specular occlusion.
    pub occlusion: f64,
}

/// The parts of a scene that shading needs.
#[derive(Clone, Copy)]
pub struct Rules<'s> {
    /// The distances and slopes at which each flavour applies.
    pub flavours: &'s FlavourRules,
    /// Parameters of the blend.
    pub blend: &'s Blend,
    /// Whether full splat blends two tiling scales.
    pub two_tilings: bool,
}

/// Shades a pixel with a forced variant. `None` if a flavour needs a node that is not loaded.
pub fn shade(ground: &Ground<'_>, rules: Rules<'_>, pixel: &Pixel, variant: Variant) -> Option<Shaded> {
    let params = FlavourParams::new(rules.flavours);
    let all = flavour_weights::weights(pixel.distance_m, pixel.normal.z, &params);
    let weights = flavour_weights::weights_for(all, u32::from(variant.mask()), true);
    let mut sum = Surface::default();
    let mut normal = DVec3::ZERO;
    for flavour in variant.flavours().filter(|flavour| weights[flavour.index()] > 0.0) {
        let weight = weights[flavour.index()];
        let (surface, leans) = one(ground, rules, &params, pixel, flavour)?;
        sum = sum.plus(weight, surface);
        normal +=
            weight * leans.unwrap_or_else(|| DVec3::from_array(triplanar::perturb(pixel.normal.to_array(), surface.gradient.to_array())));
    }
    Some(Shaded { albedo: sum.albedo, normal: normal.normalize(), smoothness: sum.smoothness, occlusion: sum.occlusion })
}

/// Returns the surface of one flavour, and the normal if the flavour computes it without a gradient, as the far atlas does. `None` if the flavour
/// needs a node that is not loaded.
fn one(ground: &Ground<'_>, rules: Rules<'_>, params: &FlavourParams, pixel: &Pixel, flavour: Flavour) -> Option<(Surface, Option<DVec3>)> {
    let bias = rules.blend.mip_bias;
    let spot = ground.spot(pixel.position.truncate())?;
    let cell = ground.cell(&spot);
    let weights = triplanar::weights(pixel.normal.to_array(), rules.blend.triplanar_sharpness);
    let cliff = flavour_weights::steep(pixel.normal.z, params.cliff_cos);
    let (scale, share) = tiling::scales(pixel.distance_m, f64::from(params.cliff_near_m), cliff);
    let over_projections = |surface: &dyn Fn(&Projection) -> Surface| {
        (0..3).zip(weights).fold(Surface::default(), |sum, (plane, weight)| {
            sum.plus(weight, surface(&Projection::of(plane, pixel.position, pixel.steps, bias)))
        })
    };
    let two_scales = |surface: &dyn Fn(&Projection, u32) -> Surface| {
        let [lower, upper] = [scale, scale + 1].map(|scale| over_projections(&|projection| surface(projection, scale)));
        Surface::default().plus(1.0 - share, lower).plus(share, upper)
    };
    Some(match flavour {
        Flavour::VirtualTexture => (virtual_texture::reference::sample(ground, pixel.position, pixel.steps, bias)?, None),
        Flavour::FarAtlas => {
            let (surface, normal) = ground.baked(&spot);
            (surface, Some(normal))
        }
        Flavour::NearCliff => (over_projections(&|projection| ground.mean(&cell, projection, 0)), None),
        Flavour::FarCliff => (two_scales(&|projection, scale| ground.mean(&cell, projection, scale)), None),
        Flavour::Splat if rules.two_tilings => (two_scales(&|projection, scale| ground.blend(&cell, projection, scale)), None),
        Flavour::Splat => (over_projections(&|projection| ground.blend(&cell, projection, 0)), None),
    })
}

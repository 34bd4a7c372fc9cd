//! What a scene demands of the stages: the shading flavours that it can need, whether the ground has holes or an edge, whether there is colour
//! modulation, and the size of the textures. The demands follow from the scene file alone, before any world data is read.

use std::collections::BTreeSet;

use super::{Scene, World};
use crate::variant::{Flavour, Variant};

/// A flavour, whether a scene can need it, and the reason.
#[derive(Clone, Debug, PartialEq)]
pub struct FlavourDemand {
    /// The flavour.
    pub flavour: Flavour,
    /// Whether the scene can have a pixel that is shaded by this flavour.
    pub required: bool,
    /// Why it is, or is not, required.
    pub reason: String,
}

/// What a scene demands.
#[derive(Clone, Debug, PartialEq)]
pub struct Demands {
    /// All five flavours, in the order of their bits.
    pub flavours: Vec<FlavourDemand>,
    /// Whether the terrain has holes. If so, the vertex stage reads the alpha of the baked albedo.
    pub holes: bool,
    /// Whether the ground may end inside the world, as the ground of a heightmap does. If so, the vertex stage moves vertices beyond the data to the
    /// edge of the data.
    pub edge: bool,
    /// Whether the colour modulation map is made and sampled.
    pub colour_modulation: bool,
    /// Anisotropy of detail textures, 1 = none.
    pub anisotropy: u16,
    /// Edge length of detail textures, texels.
    pub detail_size: u32,
    /// Number of layers in each array of detail textures. Materials with the same source share a layer.
    pub detail_layers: u32,
}

impl Demands {
    /// The demands of a valid scene.
    pub fn of(scene: &Scene) -> Demands {
        let (holes, edge, colour_modulation) = match &scene.world {
            World::Procedural { holes, colour_modulation, .. } => (holes, false, colour_modulation),
            // The data of a heightmap seldom end exactly at the border of a sector, so the ground may end inside the world.
            World::Heightmap { holes, colour_modulation, .. } => (holes, true, colour_modulation),
        };
        let sources: BTreeSet<_> = scene.materials.iter().map(|m| (&m.procedural, &m.folder)).collect();
        Demands {
            flavours: flavours_of(scene),
            holes: !holes.is_empty(),
            edge,
            colour_modulation: *colour_modulation > 0.0,
            anisotropy: scene.blend.anisotropy,
            detail_size: scene.detail_size,
            detail_layers: u32::try_from(sources.len()).expect("a valid scene has at most 256 materials"),
        }
    }

    /// Whether the scene can need this flavour.
    pub fn has(&self, flavour: Flavour) -> bool {
        self.flavours.iter().any(|demand| demand.required && demand.flavour == flavour)
    }

    /// The variants that classification can produce: the non-empty sets of required flavours, in the order of their numbers.
    pub fn variants(&self) -> Vec<Variant> {
        let mask = self.flavours.iter().filter(|demand| demand.required).fold(0, |mask, demand| mask | demand.flavour.bit());
        Variant::all().filter(|variant| variant.mask() & !mask == 0).collect()
    }
}

fn flavours_of(scene: &Scene) -> Vec<FlavourDemand> {
    let rules = &scene.flavours;
    let cliffs = rules.has_cliffs();
    let no_cliffs = || format!("flavours.cliff_slope_deg = {}: there are no cliffs", rules.cliff_slope_deg);
    let decide = |flavour: Flavour| match flavour {
        Flavour::VirtualTexture if rules.far_atlas_m > 0.0 => (true, format!("ground nearer than {} m", rules.far_atlas_m)),
        Flavour::VirtualTexture => (false, "flavours.far_atlas_m = 0: all ground is shaded from the far atlas".to_owned()),
        Flavour::FarAtlas if rules.far_atlas_m <= 0.0 => (true, "all ground that is not a cliff".to_owned()),
        Flavour::FarAtlas => {
            (true, format!("ground beyond {} m, and ground without a cached page of the virtual texture", rules.far_atlas_m))
        }
        Flavour::NearCliff if cliffs => {
            (true, format!("slopes above {} degrees nearer than {} m", rules.cliff_slope_deg, rules.cliff_near_m))
        }
        Flavour::FarCliff if cliffs => {
            (true, format!("slopes above {} degrees from {} m to {} m", rules.cliff_slope_deg, rules.cliff_near_m, rules.cliff_far_atlas_m))
        }
        Flavour::Splat if cliffs && rules.splat_band_deg > 0.0 => (
            true,
            format!(
                "slopes in the band of {} degrees below {} degrees, nearer than {} m",
                rules.splat_band_deg, rules.cliff_slope_deg, rules.cliff_near_m
            ),
        ),
        Flavour::Splat if cliffs => (false, "flavours.splat_band_deg = 0".to_owned()),
        Flavour::NearCliff | Flavour::FarCliff | Flavour::Splat => (false, no_cliffs()),
    };
    Flavour::ALL
        .into_iter()
        .map(|flavour| {
            let (required, reason) = decide(flavour);
            FlavourDemand { flavour, required, reason }
        })
        .collect()
}

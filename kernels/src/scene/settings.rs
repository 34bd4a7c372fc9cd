//! The settings of a scene, each declared once: all numbers outside the lists of materials, rules, strokes, holes, cameras and paths.

use serde::{Deserialize, Serialize};
use toml::Value;

use super::{Scene, World};
use crate::settings::{Field, Home, Kind, Listing, Range, Setting, table};

/// Largest accepted absolute value of an elevation, a coordinate or a distance, metres. Larger values are probably mistakes.
pub(super) const FAR_M: f64 = 1.0e7;

/// The places where a setting of a scene can be set. Settings that the workbench shows can also be set there.
const HOMES: &[Home] = &[Home::SceneFile, Home::Definition, Home::Set];

const FLAVOURS: Listing = Listing::new("Where flavours apply", HOMES);
const BLEND: Listing = Listing::new("Blend", HOMES);
const LIGHT: Listing = Listing::new("Light", HOMES);
const WORLD: Listing = Listing::new("World", HOMES);

/// Numbers from `least` to `most`.
const fn number(least: f64, most: f64) -> Kind {
    Kind::Number(Range::new(least, most))
}

/// Numbers above 0, up to `most`.
const fn positive(most: f64) -> Kind {
    Kind::Number(Range::above(0.0, most))
}

table! {
    /// Where each shading flavour applies (SYSTEMS C and F: Moore, GDC 2018, the parts on material shading and on shader variants). Distances are
    /// measured along the view ray. Slopes are those of the shading normal.
    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    FlavourRules of Scene as "flavours" at |scene| scene.flavours, {
        /// Distance at which ground that is neither cliff nor splat band changes from the virtual texture to the far atlas. 0: there is no virtual
        /// texture, and this ground is shaded from the far atlas at any distance.
        far_atlas_m: f64 = 300.0, "m", number(0.0, FAR_M), FLAVOURS.logarithmic("Far atlas from", 1.0, 5000.0);
        /// Distance at which cliffs change from the flavour `near-cliff` to the flavour `far-cliff`, and at which the splat band ends. Far Cry 5: 30
        /// m.
        cliff_near_m: f64 = 30.0, "m", positive(FAR_M), FLAVOURS.logarithmic("Far cliff from", 1.0, 1000.0);
        /// Distance at which cliffs change from the flavour `far-cliff` to the far atlas.
        cliff_far_atlas_m: f64 = 1500.0, "m", positive(FAR_M), FLAVOURS.logarithmic("Cliff far atlas from", 10.0, 10_000.0);
        /// Where flavours change at a distance: half the width of the transition, as a share of the distance. Example: with 0.15, a change at 300 m
        /// blends from 255 m to 345 m.
        // Smaller widths are not needed: a width of a thousandth already looks like a hard edge.
        distance_blend: f64 = 0.15, "x", number(0.001, 0.9), FLAVOURS.slider("Distance blend", 0.001, 0.9);
        /// Slope at which cliffs begin. It is the middle of a transition, whose width is `slope_blend_deg`. 90 or more: there are no cliffs.
        cliff_slope_deg: f64 = 45.0, "deg", number(1.0, 180.0), FLAVOURS.slider("Cliffs above", 5.0, 90.0);
        /// Width of each of the two transitions between flavours that depend on the slope. One is centred on the slope at which cliffs begin
        /// (`cliff_slope_deg`), the other on the lower end of the splat band.
        slope_blend_deg: f64 = 4.0, "deg", number(0.001, 45.0), FLAVOURS.slider("Slope blend", 0.001, 20.0);
        /// Width of the splat band, a range of slopes just below those of cliffs (`cliff_slope_deg`). Up to the distance `cliff_near_m`, these slopes
        /// are shaded by the flavour `splat`, because they are too steep for one projection. 0: there is no splat band. Without cliffs, there is none
        /// either.
        splat_band_deg: f64 = 8.0, "deg", number(0.0, 89.0), FLAVOURS.slider("Splat band", 0.0, 30.0);
    }
}

impl FlavourRules {
    /// Whether any slope is shaded as a cliff.
    pub fn has_cliffs(&self) -> bool {
        self.cliff_slope_deg < 90.0
    }
}

table! {
    /// Parameters of the material blend.
    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    Blend of Scene as "blend" at |scene| scene.blend, {
        /// Approximate width on the screen of the cells of hashed noise (g_HashScale of Wyman and McGuire). With larger cells, random choices change
        /// less often in motion, but form larger blotches.
        hash_scale: f64 = 1.0, "px", number(0.01, 100.0), BLEND.logarithmic("Noise cell", 0.05, 8.0);
        /// Sharpness of the height blend: k in w' = w 2^(k h), where w is the bilinear weight of a material and h its height. The larger k, the more
        /// the highest material dominates. 0: plain bilinear weights.
        height_sharpness: f64 = 8.0, "", number(0.0, 1.0e4), BLEND.slider("Height blend", 0.0, 64.0);
        /// Sharpness of the tri-planar blend: k in the weights of the three projections, w = abs(n)^k, where n is the component of the unit normal
        /// along the axis of the projection. The larger k, the sharper the borders between projections.
        triplanar_sharpness: f64 = 4.0, "", number(0.0, 1.0e3), BLEND.logarithmic("Tri-planar blend", 0.5, 32.0);
        /// Bias of the mip levels of detail textures and of the virtual texture: texture gradients are multiplied by 2^bias. Below 0, the picture is
        /// usually sharper and flickers more; above 0, it is blurrier. The far atlas is not affected.
        mip_bias: f64 = 0.0, "mip", number(-16.0, 16.0), BLEND.slider("Mip bias", -4.0, 4.0);
        /// Anisotropy of the filtering of detail textures. 1: trilinear filtering, which blurs ground near the camera at grazing angles. With Mesa's
        /// software driver before version 23, the anisotropy is always 1.
        anisotropy: u16 = 8, "", Kind::Whole(1, 16), BLEND;
        /// Contrast between materials: factor on the difference between the mean colour of a material and 18 % grey. 0: the mean colours are about 18
        /// % grey. 1: the colours are not changed. Very dark and very bright results are clamped.
        material_contrast: f64 = 1.0, "x", number(0.0, 2.0), BLEND;
    }
}

table! {
    /// The sun: a directional light.
    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    Sun of Scene as "sun" at |scene| scene.sun, {
        /// Compass bearing from which the light comes, clockwise from north.
        azimuth_deg: f64 = 190.0, "deg", number(-360.0, 360.0), LIGHT.slider("Sun from", 0.0, 360.0);
        /// Angle of the sun above the horizon.
        elevation_deg: f64 = 34.0, "deg", number(-90.0, 90.0), LIGHT.slider("Sun above", 0.5, 90.0);
        /// Irradiance on a surface that faces the sun, linear RGB.
        irradiance: [f64; 3] = [4.8, 4.4, 3.8], "", Kind::Numbers(3, Range::new(0.0, 1.0e4)), LIGHT;
    }
}

table! {
    /// The sky. Its radiance is a linear function of the sine of the elevation angle. The function is also used below the horizon, where negative
    /// values are clamped to 0. If no value is clamped, the irradiance has a simple exact formula.
    #[derive(Serialize, Deserialize)]
    #[serde(deny_unknown_fields, default)]
    Sky of Scene as "sky" at |scene| scene.sky, {
        /// Radiance of the sky at the zenith, linear RGB.
        zenith: [f64; 3] = [0.10, 0.20, 0.42], "", Kind::Numbers(3, Range::new(0.0, 1.0e4)), LIGHT;
        /// Radiance of the sky at the horizon, linear RGB.
        horizon: [f64; 3] = [0.28, 0.34, 0.42], "", Kind::Numbers(3, Range::new(0.0, 1.0e4)), LIGHT;
    }
}

/// Default edge length of detail textures, texels.
pub(super) const DETAIL_SIZE: u32 = 1024;

/// The settings of the table `world`, and those outside all tables of the scene file. The kind of the world decides which settings of
/// `world` a scene has.
const OTHERS: &[Setting<Scene>] = &[
    Setting {
        key: "world.seed",
        unit: "",
        kind: Kind::Whole(0, u32::MAX),
        default: || None,
        about: "Seed of the world. A procedural world needs this key. In a heightmap world, the added relief, the noise masks of rules and the \
                colour modulation map use the seed, and its default is 0.",
        listing: WORLD,
        field: |scene| match &scene.world {
            World::Procedural { seed, .. } | World::Heightmap { seed, .. } => Some(seed),
        },
        field_mut: |scene| match &mut scene.world {
            World::Procedural { seed, .. } | World::Heightmap { seed, .. } => Some(seed),
        },
    },
    Setting {
        key: "world.colour_modulation",
        unit: "",
        kind: number(0.0, 1.0),
        default: || Some(Value::Float(0.0)),
        about: "Strength s of the colour modulation map. The map multiplies the colour of the ground by factors from about 1 - s to about 1 + s. 0: \
                there is no map, and nothing is sampled.",
        listing: WORLD,
        field: |scene| match &scene.world {
            World::Procedural { colour_modulation, .. } | World::Heightmap { colour_modulation, .. } => Some(colour_modulation),
        },
        field_mut: |scene| match &mut scene.world {
            World::Procedural { colour_modulation, .. } | World::Heightmap { colour_modulation, .. } => Some(colour_modulation),
        },
    },
    Setting {
        key: "world.metres_per_texel",
        unit: "m",
        kind: positive(1.0e5),
        default: || None,
        about: "Distance between neighbouring samples of a heightmap. Every heightmap world needs this key.",
        listing: WORLD,
        field: |scene| match &scene.world {
            World::Procedural { .. } => None,
            World::Heightmap { metres_per_texel, .. } => Some(metres_per_texel),
        },
        field_mut: |scene| match &mut scene.world {
            World::Procedural { .. } => None,
            World::Heightmap { metres_per_texel, .. } => Some(metres_per_texel),
        },
    },
    Setting {
        key: "world.height_range_m",
        unit: "m",
        kind: Kind::Numbers(2, Range::new(-FAR_M, FAR_M)),
        default: || None,
        about: "Elevations of the smallest and of the largest possible sample of a heightmap, the lower elevation first. These samples are 0 and \
                65535 for unsigned 16-bit integers, -32768 and 32767 for signed ones, and 0 and 1 for floats. If the file states a scale, an \
                offset or a unit, the elevations must agree with it. Every heightmap world needs this key.",
        listing: WORLD,
        field: |scene| match &scene.world {
            World::Procedural { .. } => None,
            World::Heightmap { height_range_m, .. } => Some(height_range_m),
        },
        field_mut: |scene| match &mut scene.world {
            World::Procedural { .. } => None,
            World::Heightmap { height_range_m, .. } => Some(height_range_m),
        },
    },
    Setting {
        key: "world.detail_m",
        unit: "m",
        kind: number(0.0, 1000.0),
        default: || Some(Value::Float(0.0)),
        about: "Largest change of elevation by the procedural relief that is added to a heightmap. The relief is finer than the resolution of the \
                heightmap. 0: no relief is added, and the resolution of the heightmap decides which LOD is the finest.",
        listing: WORLD,
        field: |scene| match &scene.world {
            World::Procedural { .. } => None,
            World::Heightmap { detail_m, .. } => Some(detail_m),
        },
        field_mut: |scene| match &mut scene.world {
            World::Procedural { .. } => None,
            World::Heightmap { detail_m, .. } => Some(detail_m),
        },
    },
    Setting {
        key: "detail_size",
        unit: "texels",
        kind: Kind::OneOf(&[64, 128, 256, 512, 1024, 2048]),
        default: || Some(Field::value(&DETAIL_SIZE)),
        about: "Edge length of the albedo and normal textures of materials. Their textures of heights and colour masks have half this edge length.",
        listing: Listing::new("Textures", HOMES),
        field: |scene| Some(&scene.detail_size),
        field_mut: |scene| Some(&mut scene.detail_size),
    },
];

/// Every setting of a scene.
pub fn settings() -> impl Iterator<Item = &'static Setting<Scene>> {
    [Blend::SETTINGS, FlavourRules::SETTINGS, Sun::SETTINGS, Sky::SETTINGS, OTHERS].into_iter().flatten()
}

/// The setting of this key.
pub fn setting(key: &str) -> Option<&'static Setting<Scene>> {
    settings().find(|setting| setting.key == key)
}

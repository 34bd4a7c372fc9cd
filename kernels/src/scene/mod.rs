//! A scene file: what a scene contains, and how its materials are blended. The choices of a frame, such as the noise, are not part of it.
//!
//! The types below are the schema of the file (TOML; unknown keys are refused). Unless stated otherwise, lengths are in metres, angles in degrees,
//! colours in linear RGB. The origin is at the centre of the world; x points east, y north, z up.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

pub mod demands;
mod parse;
mod settings;
mod validate;

pub use parse::{DEFAULT, DEFAULT_TEXT, FILE, SceneText, load, parse, text};
pub use settings::{Blend, FlavourRules, Sky, Sun, setting, settings};
pub use validate::{validate, validate_against_world};

/// The contents of a scene file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Scene {
    /// Short name, used in output tables.
    pub name: String,
    /// A description in one sentence.
    #[serde(default)]
    pub description: String,
    /// The source of the heights.
    pub world: World,
    /// Palette: a texel of the splat map is an index into this list. At most 256 materials.
    #[serde(rename = "material")]
    pub materials: Vec<Material>,
    /// Splat rules. At a splat texel without a painted material, the rule with the largest weight decides the material. If several rules have the
    /// largest weight, the last of these rules decides. If all weights are 0, the first rule decides.
    #[serde(rename = "rule")]
    pub rules: Vec<Rule>,
    /// Brush strokes, in the order of painting. They change the result of the rules. Where strokes of kind `splat` overlap, the last one
    /// decides.
    #[serde(default, rename = "stroke", skip_serializing_if = "Vec::is_empty")]
    pub strokes: Vec<Stroke>,
    /// Edge length of detail textures, texels, a power of two in 64..=2048. The texture of heights and colour masks has half this edge length.
    #[serde(default = "default_detail_size")]
    pub detail_size: u32,
    /// Where each shading flavour applies.
    #[serde(default)]
    pub flavours: FlavourRules,
    /// Parameters of the material blend.
    #[serde(default)]
    pub blend: Blend,
    /// The sun.
    #[serde(default)]
    pub sun: Sun,
    /// The sky.
    #[serde(default)]
    pub sky: Sky,
    /// Named cameras.
    #[serde(default, rename = "camera")]
    pub cameras: Vec<CameraPose>,
    /// Named camera paths.
    #[serde(default, rename = "path")]
    pub paths: Vec<CameraPath>,
    /// The folder of the scene file, to which relative file names refer. Not part of the file.
    #[serde(skip)]
    pub folder: PathBuf,
}

fn default_detail_size() -> u32 {
    settings::DETAIL_SIZE
}

impl Scene {
    /// Returns the paths that a renderer of the scene reads: the heightmap file and the folders of materials.
    pub fn sources(&self) -> Vec<PathBuf> {
        let heightmap = match &self.world {
            World::Heightmap { file, .. } => Some(file),
            World::Procedural { .. } => None,
        };
        let folders = self.materials.iter().filter_map(|material| material.folder.as_ref());
        heightmap.into_iter().chain(folders).map(|path| self.folder.join(path)).collect()
    }
}

/// The source of the heights.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case", deny_unknown_fields)]
pub enum World {
    /// Mountains that are generated from a seed, node by node: 10 240 m wide, with samples 0.5 m apart at the finest LOD.
    Procedural {
        /// Seed of the generator, of the noise masks of the splat rules, and of the colour modulation map.
        seed: u32,
        /// Circular holes; most scenes have none.
        #[serde(default)]
        holes: Vec<Hole>,
        /// Strength s of the colour modulation map, 0 to 1: its factor on the colour of the ground varies from about 1 - s to 1 + s. 0 = there is no
        /// map, and nothing is sampled.
        #[serde(default)]
        colour_modulation: f64,
    },
    /// An imported heightmap, row 0 = north. Samples are points, so n samples in a row span n - 1 times their distance.
    Heightmap {
        /// The heightmap, usually the 16-bit grey PNG that `import` writes. The path is relative to the folder of the scene file.
        file: PathBuf,
        /// Distance between neighbouring samples, metres.
        metres_per_texel: f64,
        /// Elevations of the smallest and the largest possible sample, metres. Unsigned 16-bit samples: 0 and 65535. Signed TIFF: -32768 and 32767.
        /// Floats: 0 and 1. If the file states its own scale, the two must agree.
        height_range_m: [f64; 2],
        /// Largest offset of the added procedural relief, metres. This relief is finer than the resolution of the data. 0 = no relief is added; the
        /// finest LOD then follows from the resolution of the data.
        #[serde(default)]
        detail_m: f64,
        /// Seed of the added relief, of the noise masks of the splat rules, and of the colour modulation map.
        #[serde(default)]
        seed: u32,
        /// Circular holes.
        #[serde(default)]
        holes: Vec<Hole>,
        /// Strength s of the colour modulation map, 0 to 1: its factor on the colour of the ground varies from about 1 - s to 1 + s. 0 = there is no
        /// map, and nothing is sampled.
        #[serde(default)]
        colour_modulation: f64,
    },
}

/// A circular opening in the ground.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hole {
    /// Centre, world metres.
    pub centre: [f64; 2],
    /// Radius in metres.
    pub radius_m: f64,
}

/// A terrain material: detail textures, and how they are mapped to the ground.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Material {
    /// Unique name.
    pub name: String,
    /// Name of a built-in procedural material. Exactly one of `procedural` and `folder` is given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub procedural: Option<String>,
    /// Folder with images named `albedo`, `normal`, `height`, `roughness` and, optionally, `ao`, or as Poly Haven, ambientCG and Quixel name them.
    /// The path is relative to the folder of the scene file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub folder: Option<PathBuf>,
    /// Edge length of one repeat of the texture, metres.
    pub tile_m: f64,
    /// Rotation of the texture, degrees, -360 to 360. In the projection from above, positive angles turn it anticlockwise.
    #[serde(default)]
    pub orientation_deg: f64,
    /// Factor on the colour, linear RGB, where the colour mask is 1.
    #[serde(default = "white")]
    pub tint: [f64; 3],
    /// Strength of the normal map: 1 = as authored, 0 = flat.
    #[serde(default = "one")]
    pub normal_strength: f64,
}

fn white() -> [f64; 3] {
    [1.0; 3]
}

fn one() -> f64 {
    1.0
}

/// One splat rule. Its weight at a position is the number `weight` times the product of all masks that the rule gives. The mask of a band
/// `[from, to]` is 1 inside the band and falls linearly to 0 outside it, over the width of the fade.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rule {
    /// Name of the material that the rule places.
    pub material: String,
    /// Factor on the product of the masks, > 0.
    #[serde(default = "one")]
    pub weight: f64,
    /// Elevation band, metres.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub height_m: Option<[f64; 2]>,
    /// Width of the fade outside the elevation band, metres.
    #[serde(default)]
    pub height_fade_m: f64,
    /// Slope band, degrees from horizontal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub slope_deg: Option<[f64; 2]>,
    /// Width of the fade outside the slope band, degrees.
    #[serde(default)]
    pub slope_fade_deg: f64,
    /// Mean-curvature band, 1/m, positive = convex (ridge), negative = concave (gully).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub curvature: Option<[f64; 2]>,
    /// Width of the fade outside the curvature band, 1/m.
    #[serde(default)]
    pub curvature_fade: f64,
    /// Wavelength of the noise mask, metres; 0 = no noise mask. The mask is 1 where value noise is above a threshold and 0 where it is
    /// below, with a smooth transition. The threshold follows from `noise_cover`.
    #[serde(default)]
    pub noise_m: f64,
    /// Approximate share of the ground, 0 to 1, where the noise is above the threshold.
    #[serde(default = "half")]
    pub noise_cover: f64,
}

/// A stroke of the brush: a line as wide as the brush. Strokes are stored as lines, not as texels, so that they do not depend on the LOD.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stroke {
    /// What the stroke changes.
    pub kind: StrokeKind,
    /// Name of a material. A stroke of kind `splat` paints this material. A stroke of kind `mask` changes the weights of the rules that place it.
    pub material: String,
    /// The points of the line, world metres (x, y), at least one. Straight segments connect them.
    pub points: Vec<[f64; 2]>,
    /// Half the width of the line, metres, > 0.
    pub radius_m: f64,
    /// Width of the soft edge of a stroke of kind `mask`, metres, 0 to `radius_m`. The soft edge lies inside the line. A stroke of kind `splat` has
    /// no soft edge, because a splat map holds one material per texel.
    #[serde(default)]
    pub fade_m: f64,
    /// Factor of a stroke of kind `mask` on the weights of the material's rules. 0 makes these weights 0, 1 changes nothing. In the soft edge, the
    /// factor changes gradually from `amount` to 1. A stroke of kind `splat` does not use this value.
    #[serde(default)]
    pub amount: f64,
}

/// What a stroke changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StrokeKind {
    /// The splat map: splat texels that the brush passed over get the material, regardless of the rules. Later strokes of this kind can replace it.
    Splat,
    /// The weights of the rules that place the material.
    Mask,
}

fn half() -> f64 {
    0.5
}

/// A camera: its position, direction and field of view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPose {
    /// Name. The names of the cameras of a scene differ. Key poses of a path may have equal names.
    pub name: String,
    /// World metres; z is elevation, or metres above the ground if `above_ground`.
    pub position: [f64; 3],
    /// Whether z is measured from the ground below.
    #[serde(default)]
    pub above_ground: bool,
    /// Compass bearing of the view direction, degrees: 0 = north (+y), 90 = east (+x).
    pub yaw_deg: f64,
    /// Angle of the view direction above the horizon, degrees, -90 to 90.
    pub pitch_deg: f64,
    /// Vertical field of view, degrees, 1 to 175.
    #[serde(default = "default_fov")]
    pub fov_deg: f64,
}

fn default_fov() -> f64 {
    55.0
}

/// A camera path: key poses at equal intervals of frames, interpolated by Catmull-Rom splines.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPath {
    /// Name. The names of the paths of a scene differ.
    pub name: String,
    /// Number of frames from one key pose to the next, >= 1.
    pub frames_per_key: u32,
    /// The key poses, at least two.
    #[serde(rename = "key")]
    pub keys: Vec<CameraPose>,
}

impl CameraPath {
    /// Number of frames from the first key pose to the last, both included.
    pub fn frames(&self) -> u64 {
        self.keys.len().saturating_sub(1) as u64 * u64::from(self.frames_per_key) + 1
    }
}

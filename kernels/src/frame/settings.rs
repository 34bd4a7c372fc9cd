//! The settings of a frame that are not part of a scene.

use toml::Value;

use super::stages::{StageSettings, stage_settings};
use super::{GeometryRequest, Outputs, RenderRequest, ShadingRequest, VariantChoice, ViewRequest};
use crate::base::document::Checked;
use crate::classification;
use crate::culling::Culls;
use crate::frame::picture::AovSet;
use crate::geometry;
use crate::quadtree::LOD_BIASES;
use crate::residency::{CAPACITY, Loading, Residency, Schedule};
use crate::settings::{self, Field, Home, Kind, Listing, Range, Setting, named, table};
use crate::shading::Estimator;
use crate::shared::noise::NoiseKind;
use crate::temporal::SamplePattern;
use crate::variant::Variant;
use crate::view::camera::Pose;
use crate::view::normals::NormalEncoding;

/// Prefix of the keys of the settings of a frame.
pub const FRAME: &str = "frame.";

/// The value of `frame.variant` that forces no variant. Each tile then has the variant that its pixels need.
const AUTOMATIC: &str = "auto";

const SHADING: Listing = Listing::new("Shading", &[Home::Definition, Home::Option, Home::Workbench]);
const GEOMETRY: Listing = Listing::new("Geometry", &[Home::Definition, Home::Option, Home::Workbench]);
/// Settings of streaming. They matter for sequences of pictures.
const STREAMED: Listing = Listing::new("Streaming", &[Home::Definition, Home::Option]);
/// Listings of the settings for which an experiment definition gives a list of values: `variants`, `estimators` and `noises`.
const VARIANTS: Listing = Listing::new("Shading", &[Home::DefinitionList("variants"), Home::Option, Home::Workbench]);
const ESTIMATORS: Listing = Listing::new("Shading", &[Home::DefinitionList("estimators"), Home::Option, Home::Workbench]);
const NOISES: Listing = Listing::new("Shading", &[Home::DefinitionList("noises"), Home::Option, Home::Workbench]);

table! {
    /// Settings of a frame that are not part of a scene.
    #[derive(Copy)]
    FrameSettings of FrameSettings as "frame" at |frame| frame,
    parts
        /// The settings that stages declare.
        stages: StageSettings,
    {
        /// The variant that shades all tiles of the terrain. `auto`: each tile is shaded by the variant that its pixels need. In a
        /// definition, `variants` must be given; it also accepts `all` (the 31 variants), `generic` (the generic kernel), and `generic-` followed by
        /// a variant.
        variant: Option<Variant> = None, "", Kind::Text(VARIANT), VARIANTS.shown("Automatic");
        /// Shade with one generic pipeline, which reads the flavours of each tile at run time, instead of one pipeline per variant.
        generic: bool = false, "", Kind::Flag, VARIANTS.shown("Generic kernel");
        /// Method by which near cliff, far cliff and splat blend materials. `fc5` is the method of Far Cry 5, with random choices on cliffs. `exact`
        /// is the mean of these choices. The other methods are alternatives.
        estimator: Estimator = Estimator::Fc5, "", Kind::Name(|| Estimator::ALL.map(Estimator::name).to_vec()), ESTIMATORS.shown("Estimator");
        /// Pattern of the random numbers that decide, for example, which material a pixel takes.
        noise: NoiseKind = NoiseKind::HashedIsotropic, "", Kind::Name(|| NoiseKind::ALL.map(NoiseKind::name).to_vec()), NOISES.shown("Noise");
        /// How the geometry pass stores the shading normal of a pixel and the plane of its triangle. Screen-space derivatives are computed on this
        /// plane.
        normals: NormalEncoding = NormalEncoding::Octahedral, "", Kind::Name(|| NormalEncoding::ALL.map(NormalEncoding::name).to_vec()),
            GEOMETRY.shown("Stored normals");
        /// Seed of the random numbers.
        seed: u32 = 0, "", Kind::Whole(0, u32::MAX), SHADING.shown("Seed");
        /// Give each frame a different seed: `seed` plus the number of the frame.
        reseeds: bool = false, "", Kind::Flag, SHADING.shown("A seed per frame");
        /// Blend full splat from two tiling scales. This doubles its fetches of materials, with `fc5` from 48 to 96. Estimators other than `fc5`,
        /// `exact` and `biplanar` ignore this setting.
        two_tilings: bool = false, "", Kind::Flag, SHADING.shown("Two tilings");
        /// Draw terrain nodes this many levels coarser. This affects geometry, splat map and baked colours. Values below 0 draw finer nodes, up to a
        /// limit that keeps the number of nodes small. In pictures with 1080 rows or more, 0 usually reaches this limit, so lower values change
        /// nothing.
        lod_bias: f64 = 0.0, "levels", Kind::Number(Range::new(LOD_BIASES[0], LOD_BIASES[1])),
            GEOMETRY.slider("Node LOD bias", LOD_BIASES[0], LOD_BIASES[1]);
        /// Smallest vertex stride of a patch. With a stride of n, every n-th vertex along the side of a patch is drawn. Textures keep their
        /// resolution, but ridges lose detail. On a software adapter, the default of the workbench is 4.
        vertex_stride: u32 = 1, "", Kind::OneOf(&geometry::STRIDES), GEOMETRY.shown("Vertex stride");
        /// Draw fewer vertices of a patch if this moves its ground by at most this distance on the screen. Where a patch
        /// meets a patch with wider spacing of vertices, its ground may move farther. 0: this setting has no effect.
        geometry_error: f64 = 0.0, "px", Kind::Number(Range::new(0.0, 16.0)), GEOMETRY.slider("Geometry error", 0.0, 2.0);
        /// Which terrain nodes can be drawn. `settled`: all nodes, so each picture waits for its nodes. `scheduled`: the nodes that have arrived, so
        /// pictures of a moving camera show coarser ground where nodes are late. All nodes that the first picture of a sequence
        /// needs have already arrived.
        residency: Loading = Loading::Settled, "", Kind::Name(|| Loading::ALL.map(Loading::name).to_vec()), STREAMED;
        /// Largest number of nodes that are requested per frame if residency is scheduled.
        nodes_per_frame: u32 = Schedule::default().nodes_per_frame, "", Kind::Whole(1, CAPACITY), STREAMED;
        /// Number of frames from the request of a node to the first frame that can draw it, if residency is scheduled.
        latency: u32 = Schedule::default().latency_frames, "frames", Kind::Whole(1, 600), STREAMED;
        /// Edge length of the tiles into which the picture is divided. Each tile is shaded by one variant.
        tile: u32 = classification::TILE, "px", Kind::OneOf(&classification::TILES),
            Listing::new("Classification", &[Home::Definition, Home::Option]);
        /// The area whose pixels share a variant when the metric `tile_fetches_per_px` is computed: a tile of the picture, or a patch of the terrain.
        /// The shading passes use tiles in both cases.
        classification: ClassifyBy = ClassifyBy::Tile, "", Kind::Name(|| ClassifyBy::ALL.map(ClassifyBy::name).to_vec()),
            Listing::new("Classification", &[Home::Definition]);
    }
}

/// The areas to which classification assigns variants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClassifyBy {
    /// Each tile of the screen.
    #[default]
    Tile,
    /// Each patch of the terrain.
    Patch,
}

impl ClassifyBy {
    /// Both values.
    pub const ALL: [ClassifyBy; 2] = [ClassifyBy::Tile, ClassifyBy::Patch];

    /// The name used in files.
    pub const fn name(self) -> &'static str {
        match self {
            ClassifyBy::Tile => "tile",
            ClassifyBy::Patch => "patch",
        }
    }
}

const VARIANT: &str = "auto, a number from 1 to 31, or one or more of vt, far-atlas, near-cliff, far-cliff, splat, joined by `+`";

impl Field for Option<Variant> {
    fn value(&self) -> Value {
        Value::String(self.map_or_else(|| AUTOMATIC.to_owned(), |variant| variant.to_string()))
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        *self = match value.as_str().unwrap_or_default() {
            AUTOMATIC => None,
            text => Some(text.parse().map_err(|error: crate::variant::NotAVariant| error.hint)?),
        };
        Ok(())
    }
}

named!(Estimator, NoiseKind, NormalEncoding, Loading, ClassifyBy);

/// Returns every setting of a frame: first the settings of the frame itself, then the settings of its stages.
pub fn settings() -> impl Iterator<Item = &'static Setting<FrameSettings>> {
    FrameSettings::SETTINGS.iter().chain(stage_settings())
}

/// Finds a setting of frames by its key.
pub fn setting(key: &str) -> Option<&'static Setting<FrameSettings>> {
    settings().find(|setting| setting.key == key)
}

impl FrameSettings {
    /// Checks all settings.
    ///
    /// # Errors
    /// When a setting does not accept its value. The error names the first such setting.
    pub fn check(&self) -> Checked {
        settings::check(settings(), self)
    }

    /// Returns these settings with the exposure and the tone curve of `other`. Exposure and tone curve change how a picture is displayed, not what is
    /// rendered.
    #[must_use]
    pub fn looked_at_as(mut self, other: &FrameSettings) -> FrameSettings {
        self.stages.display = other.stages.display;
        self
    }

    /// The choice of the shader for each tile.
    pub fn choice(&self) -> VariantChoice {
        match (self.variant, self.generic) {
            (None, false) => VariantChoice::Auto,
            (None, true) => VariantChoice::GenericAuto,
            (Some(variant), false) => VariantChoice::Forced(variant),
            (Some(variant), true) => VariantChoice::GenericForced(variant),
        }
    }

    /// The schedule of streaming; `None` if residency is settled.
    pub fn schedule(&self) -> Option<Schedule> {
        let schedule = Schedule { nodes_per_frame: self.nodes_per_frame, latency_frames: self.latency };
        (self.residency == Loading::Scheduled).then_some(schedule)
    }

    /// The request of a frame with these settings. Its residency is settled; for scheduled residency, [`Renderer::arrive`](super::Renderer::arrive)
    /// gives the residency of a frame. The request does not contain `tile`, which is an option of the renderer ([`super::RendererOptions`]).
    pub fn request(&self, pose: Pose, size: [u32; 2], frame: u32) -> RenderRequest {
        RenderRequest {
            view: ViewRequest { pose, size, jitter: [0.0; 2] },
            geometry: GeometryRequest {
                lod_bias: self.lod_bias,
                vertex_stride: self.vertex_stride,
                error_px: self.geometry_error,
                culled_from: None,
                residency: Residency::Settled,
                normals: self.normals,
                culls: Culls::ALL,
            },
            shading: ShadingRequest {
                variant: self.choice(),
                estimator: self.estimator,
                noise: self.noise,
                seed: if self.reseeds { self.seed.wrapping_add(frame) } else { self.seed },
                frame,
                two_tilings: self.two_tilings,
                sample_pattern: SamplePattern::Centre,
            },
            outputs: Outputs {
                aovs: AovSet::default(),
                count_fetches: false,
                lit: true,
                displayed: false,
                time_variants: false,
                keep_geometry: false,
            },
            stages: self.stages,
        }
    }
}

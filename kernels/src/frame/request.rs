//! The request for a picture: the view, how its geometry is made, how it is shaded, and the outputs.

use super::{FrameSettings, StageSettings};
use crate::base::error::{Error, Result};
use crate::classification;
use crate::culling::Culls;
use crate::frame::picture::AovSet;
use crate::residency::Residency;
use crate::shading::Estimator;
use crate::shared::noise::NoiseKind;
use crate::temporal::SamplePattern;
use crate::variant::{Flavour, Variant};
use crate::view::camera::Pose;
use crate::view::normals::NormalEncoding;

/// The choice of the shader for each tile.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum VariantChoice {
    /// Each tile is shaded by the variant that its pixels need.
    Auto,
    /// All tiles with terrain are shaded by this variant. Each of its flavours is evaluated on all terrain pixels.
    Forced(Variant),
    /// The generic kernel shades all tiles with terrain, each with the flavours of the variant that `Auto` selects for the tile.
    GenericAuto,
    /// The generic kernel shades all tiles with terrain, with the flavours of this variant.
    GenericForced(Variant),
}

impl VariantChoice {
    /// Whether some pixel may be shaded by this flavour.
    pub fn may_use(self, flavour: Flavour) -> bool {
        match self {
            VariantChoice::Auto | VariantChoice::GenericAuto => true,
            VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant) => variant.has(flavour),
        }
    }
}

/// The camera and the size of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewRequest {
    /// Position, direction and field of view of the camera.
    pub pose: Pose,
    /// Size in pixels.
    pub size: [u32; 2],
    /// Shift of the sample points in pixels, for supersampling.
    pub jitter: [f64; 2],
}

/// How the terrain's geometry is made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometryRequest {
    /// Bias of the terrain's LOD. Adding 1 halves the distance at which nodes are split, unless the upper bound of
    /// [`SPLIT_RATIO`](crate::quadtree::SPLIT_RATIO) limits this distance.
    pub lod_bias: f64,
    /// Least vertex stride of all patches: with a stride of n, every n-th vertex along the side of a patch is drawn, see
    /// [`STRIDES`](crate::geometry::STRIDES). The textures of the ground keep their resolution.
    pub vertex_stride: u32,
    /// Geometric error: a patch may have a vertex stride above `vertex_stride` if this moves its surface by at most this distance on the screen,
    /// pixels. Along sides where patches with different vertices meet, the surface may move farther. 0 = all patches have the stride `vertex_stride`.
    /// See [`Levels::of`](crate::culling::Levels::of).
    pub error_px: f64,
    /// The pose from which nodes and patches are selected, to show what culling removes; `None` = they are selected from the camera. With a pose,
    /// occlusion culling is off, because the depth buffer belongs to the camera and not to this pose.
    pub culled_from: Option<Pose>,
    /// Which nodes are available for drawing.
    pub residency: Residency,
    /// How the geometry pass stores its two normals.
    pub normals: NormalEncoding,
    /// The tests that remove patches, and the order of drawing. They should not change the picture; [`crate::culling`] names two rare exceptions.
    pub culls: Culls,
}

/// The parts of a request that decide the results of the geometry pass. As long as the scene of a renderer does not change, requests with equal keys
/// give the same depth, mask and normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GeometryKey {
    /// The view.
    pub view: ViewRequest,
    /// The geometry.
    pub geometry: GeometryRequest,
}

/// How pixels are shaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShadingRequest {
    /// The choice of the shader for each tile.
    pub variant: VariantChoice,
    /// How the flavours near cliff, far cliff and splat compute their values.
    pub estimator: Estimator,
    /// Noise that drives the random choices of near cliff, far cliff and splat.
    pub noise: NoiseKind,
    /// Seed of the random choices of near cliff, far cliff and splat.
    pub seed: u32,
    /// Frame index, on which animated noise depends. Pictures do not depend on a clock.
    pub frame: u32,
    /// Whether full splat blends two tiling scales, which doubles its fetches. Estimators without this option
    /// ([`Estimator::has_two_tilings`]) ignore it.
    pub two_tilings: bool,
    /// Where the shaded sample lies in its pixel, for temporal supersampling.
    pub sample_pattern: SamplePattern,
}

/// The outputs of a request.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Outputs {
    /// Layers that are requested in addition to the picture.
    pub aovs: AovSet,
    /// Whether fetches are counted. The shader that counts them is slower, so experiments never time it.
    pub count_fetches: bool,
    /// Whether the picture is lit. If not, only the G-buffer is made.
    pub lit: bool,
    /// Whether the lit picture is also tone-mapped for people to look at, with the settings of the stage `display`.
    pub displayed: bool,
    /// Whether each variant is shaded and timed in a pass of its own. If not, one pass shades all variants, and only its total time is measured.
    pub time_variants: bool,
    /// Whether the geometry pass is skipped if the last frame has the same [`GeometryKey`]. This saves time if one view is drawn with many seeds or
    /// variants.
    pub keep_geometry: bool,
}

/// One picture to make.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderRequest {
    /// The view.
    pub view: ViewRequest,
    /// How the geometry of the picture is made.
    pub geometry: GeometryRequest,
    /// How the picture is shaded.
    pub shading: ShadingRequest,
    /// The outputs.
    pub outputs: Outputs,
    /// Settings of the stages.
    pub stages: StageSettings,
}

impl RenderRequest {
    /// Returns a request in which every setting has its default: automatic variants, Far Cry 5's estimator, isotropic hashed noise, seed 0.
    pub fn new(pose: Pose, size: [u32; 2]) -> RenderRequest {
        FrameSettings::default().request(pose, size, 0)
    }

    /// Returns the request with a change applied.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut RenderRequest)) -> RenderRequest {
        change(&mut self);
        self
    }

    /// The key of the geometry of this request.
    pub fn geometry_key(&self) -> GeometryKey {
        GeometryKey { view: self.view, geometry: self.geometry }
    }

    /// Whether the picture is tone-mapped for people to look at.
    pub fn is_displayed(&self) -> bool {
        self.outputs.lit && self.outputs.displayed
    }

    /// Whether the shading pass has to count fetches and record choices.
    pub fn wants_diagnostics(&self) -> bool {
        self.outputs.count_fetches || self.outputs.aovs.needs_diagnostics()
    }

    /// Refuses a request that cannot be drawn with these limits.
    ///
    /// # Errors
    /// When the size, the LOD bias, the vertex stride, the geometry error or a setting of a stage is out of range.
    pub fn check(&self, limits: &wgpu::Limits, tile: u32) -> Result<()> {
        check_size(self.view.size, limits, tile)?;
        let GeometryRequest { lod_bias, vertex_stride, error_px, .. } = self.geometry;
        let settings = FrameSettings { lod_bias, vertex_stride, geometry_error: error_px, stages: self.stages, ..FrameSettings::default() };
        settings.check().map_err(|wrong| Error::Request(wrong.to_string()))
    }
}

/// Largest width and largest height of a picture, pixels. Many devices support no larger textures. Tile lists store the column and the row of a
/// tile in 12 bits each, which is enough for this size even if tiles have 4 x 4 pixels.
pub const MAX_SIDE: u32 = 16_384;
/// Largest number of pixels of a picture.
pub const MAX_PIXELS: u64 = 1 << 26;

/// Refuses sizes that no picture can have on a device with these limits.
///
/// # Errors
/// When a side is 0 or above [`MAX_SIDE`], there are more than [`MAX_PIXELS`] pixels, or a side or the tile lists exceed the limits of the device.
pub fn check_size(size: [u32; 2], limits: &wgpu::Limits, tile: u32) -> Result<()> {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let side = MAX_SIDE.min(limits.max_texture_dimension_2d);
    let [columns, rows] = classification::tiles_of(size, tile).map(u64::from);
    let lists = columns * rows * u64::from(classification::LISTS) * 4;
    if size.contains(&0) || size.iter().any(|&n| n > side) || pixels > MAX_PIXELS || lists > limits.max_storage_buffer_binding_size {
        return Err(Error::Request(format!(
            "a picture of {}x{} pixels cannot be made on this device: give 1 to {side} pixels for each side, and at most {MAX_PIXELS} pixels in all",
            size[0], size[1]
        )));
    }
    Ok(())
}

//! A finished picture with its layers.

use glam::DVec2;
use half::f16;
use half::slice::HalfFloatSliceExt as _;

use crate::base::error::{Error, Result};
use crate::base::names::nearest;
use crate::culling::{Levels, PATCHES};
use crate::display::{Exposure, reference};
use crate::frame::{Frame, FrameReport};
use crate::gpu::TextureReading;
use crate::quadtree::{lod_at, lod_map};
use crate::shading::diagnostics;
use crate::view::camera::View;
use crate::world::NodeId;

/// Names of all layers, in their order in [`Picture::layers`].
pub const AOV_NAMES: [&str; 12] =
    ["albedo", "normal", "depth", "mask", "variant", "fetches", "choice", "position", "ddx", "ddy", "lod", "stride"];

/// The layers that are requested in addition to the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AovSet(u16);

impl AovSet {
    /// All layers.
    pub const ALL: AovSet = AovSet((1 << AOV_NAMES.len()) - 1);

    /// Returns the set of the layers with these names.
    ///
    /// # Errors
    /// When a name is unknown. The error lists the known names, and suggests the nearest one if it is similar.
    pub fn from_names<S: AsRef<str>>(names: &[S]) -> Result<AovSet> {
        let mut set = AovSet::default();
        for name in names {
            let name = name.as_ref();
            let Some(index) = AOV_NAMES.iter().position(|n| *n == name) else {
                let hint = nearest(name, &AOV_NAMES).map_or_else(String::new, |n| format!("; did you mean `{n}`?"));
                return Err(Error::Request(format!("`{name}` is not a layer: the layers are {}{hint}", AOV_NAMES.join(", "))));
            };
            set.0 |= 1 << index;
        }
        Ok(set)
    }

    /// Whether a layer of this name is in the set.
    pub fn has(self, name: &str) -> bool {
        AOV_NAMES.iter().position(|n| *n == name).is_some_and(|i| self.0 & 1 << i != 0)
    }

    /// Whether the shading pass must record diagnostics for these layers.
    pub fn needs_diagnostics(self) -> bool {
        self.has("fetches") || self.has("choice") || self.has("variant")
    }

    fn needs_inspection(self) -> bool {
        ["position", "ddx", "ddy", "lod", "stride"].into_iter().any(|name| self.has(name))
    }
}

/// One layer, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub enum Layer {
    /// Linear colour.
    Rgb(Vec<[f32; 3]>),
    /// A vector in world axes.
    Xyz(Vec<[f32; 3]>),
    /// One number per pixel.
    Value(Vec<f32>),
}

/// A picture, row by row from the top.
#[derive(Clone, Debug)]
pub struct Picture {
    /// Size in pixels.
    pub size: [u32; 2],
    /// Linear radiance; alpha 1 = terrain, 0 = sky. Empty if no lit picture was requested.
    pub hdr: Vec<[f32; 4]>,
    /// The displayed picture: tone-mapped and sRGB-encoded, with the alpha of `hdr`; `None` if it was not requested.
    pub displayed: Option<Vec<[u8; 4]>>,
    /// The requested layers, by name.
    pub layers: Vec<(String, Layer)>,
    /// Device time of each timed pass, milliseconds; empty if the device has no timestamps.
    pub passes: Vec<(String, f64)>,
    /// Mean fetches per terrain pixel, if they were counted.
    pub fetches_per_px: Option<f64>,
    /// The report of the frame.
    pub report: FrameReport,
}

/// Converts texels of four f16 channels to their first three channels in f32.
fn rgb(bytes: &[u8]) -> Vec<[f32; 3]> {
    let halves: Vec<f16> = bytemuck::pod_collect_to_vec(bytes);
    halves.to_f32_vec().chunks_exact(4).map(|texel| [texel[0], texel[1], texel[2]]).collect()
}

/// Finds the node and the patch that were drawn at a position.
struct DrawnLevels<'f> {
    /// For each sector, the LOD of the drawn node.
    lods: Vec<u8>,
    levels: &'f Levels,
    view: &'f View,
    sector_m: f64,
}

impl DrawnLevels<'_> {
    fn of<'f>(frame: &'f Frame<'_, '_>) -> DrawnLevels<'f> {
        let report = frame.report();
        DrawnLevels {
            lods: lod_map(&report.drawn),
            levels: &report.levels,
            view: frame.view(),
            sector_m: frame.renderer().world().layout().sector_m,
        }
    }

    /// Returns the LOD of the node and the vertex stride of the patch at a position in the local coordinates of the view; `None` = outside the world.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "`lod_at` has checked that the position is in the world")]
    fn at(&self, position: [f32; 3]) -> Option<(u8, u32)> {
        let place = self.view.sector.as_dvec2() + DVec2::new(f64::from(position[0]), f64::from(position[1])) / self.sector_m;
        let lod = lod_at(&self.lods, place.to_array())?;
        let in_nodes = place / f64::from(1u32 << lod);
        let node = NodeId { lod, x: in_nodes.x as u16, y: in_nodes.y as u16 };
        let patch = ((in_nodes - in_nodes.floor()) * f64::from(PATCHES)).to_array().map(|n| n as u32);
        Some((lod, 1 << self.levels.log2_stride(node, patch)))
    }
}

impl Picture {
    /// Reads a frame back. All textures are read together.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub(super) fn read(frame: Frame<'_, '_>) -> Result<Picture> {
        let (gpu, targets, request) = (frame.renderer().gpu(), frame.targets(), frame.request());
        let wanted = request.outputs.aovs;
        let counted = wanted.needs_diagnostics() || request.outputs.count_fetches;
        let mut reading = TextureReading::default();
        let mut read = |wanted: bool, texture, aspect, bytes| wanted.then(|| reading.add(texture, aspect, bytes));
        let all = wgpu::TextureAspect::All;
        let hdr = read(request.outputs.lit, &targets.lighting, all, 16);
        let displayed = read(request.is_displayed(), &targets.display, all, 4);
        let albedo = read(wanted.has("albedo"), &targets.shading.albedo, all, 8);
        let normal = read(wanted.has("normal"), &targets.shading.normal, all, 8);
        let depth = read(wanted.has("depth"), &targets.geometry.depth_stencil, wgpu::TextureAspect::DepthOnly, 4);
        let mask = read(wanted.has("mask"), &targets.geometry.mask, all, 1);
        let counts = read(counted, &targets.shading.diagnostics, all, 4);
        let texels = reading.run(gpu)?;
        let texels = |place: Option<usize>| place.map(|place| texels[place].as_slice());

        let mut layers = Vec::new();
        let mut add = |name: &str, layer: Layer| layers.push((name.to_owned(), layer));
        if let Some(bytes) = texels(albedo) {
            add("albedo", Layer::Rgb(rgb(bytes)));
        }
        if let Some(bytes) = texels(normal) {
            add("normal", Layer::Xyz(rgb(bytes)));
        }
        if let Some(bytes) = texels(depth) {
            let depth: Vec<f32> = bytemuck::pod_collect_to_vec(bytes);
            // The layer holds the distance along the view direction, metres; 0 = no terrain.
            let metres = |d: f32| if d > 0.0 { crate::view::camera::NEAR_M as f32 / d } else { 0.0 };
            add("depth", Layer::Value(depth.into_iter().map(metres).collect()));
        }
        if let Some(bytes) = texels(mask) {
            add("mask", Layer::Value(bytes.iter().copied().map(f32::from).collect()));
        }
        let mut fetches_per_px = None;
        if let Some(bytes) = texels(counts) {
            let words: Vec<u32> = bytemuck::pod_collect_to_vec(bytes);
            let layer = |part: fn(u32) -> u32| Layer::Value(words.iter().map(|&word| part(word) as f32).collect());
            if wanted.has("variant") {
                add("variant", layer(diagnostics::mask));
            }
            if wanted.has("fetches") {
                add("fetches", layer(diagnostics::fetches));
            }
            if wanted.has("choice") {
                add("choice", layer(diagnostics::choice));
            }
            let shaded: Vec<u32> =
                words.iter().filter(|&&word| diagnostics::mask(word) != 0).map(|&word| diagnostics::fetches(word)).collect();
            fetches_per_px = Some(shaded.iter().map(|&n| f64::from(n)).sum::<f64>() / (shaded.len().max(1) as f64));
        }
        if wanted.needs_inspection() {
            let corner = frame.view().pose.position - frame.view().camera;
            let inspected = frame.inspect()?;
            let terrain = |i: &crate::inspect::Inspected| i.slot != 0;
            if wanted.has("position") {
                let world = |p: [f32; 3]| std::array::from_fn(|k| (f64::from(p[k]) + corner[k]) as f32);
                add("position", Layer::Xyz(inspected.iter().map(|i| if terrain(i) { world(i.position) } else { [0.0; 3] }).collect()));
            }
            if wanted.has("ddx") {
                add("ddx", Layer::Xyz(inspected.iter().map(|i| i.ddx).collect()));
            }
            if wanted.has("ddy") {
                add("ddy", Layer::Xyz(inspected.iter().map(|i| i.ddy).collect()));
            }
            if wanted.has("lod") || wanted.has("stride") {
                let drawn = DrawnLevels::of(&frame);
                let found: Vec<Option<(u8, u32)>> =
                    inspected.iter().map(|i| if terrain(i) { drawn.at(i.position) } else { None }).collect();
                // Layer `lod`: the LOD of the drawn node; -1 = no terrain. Layer `stride`: the vertex stride of the drawn patch; 0 = no terrain.
                if wanted.has("lod") {
                    add("lod", Layer::Value(found.iter().map(|found| found.map_or(-1.0, |(lod, _)| f32::from(lod))).collect()));
                }
                if wanted.has("stride") {
                    add("stride", Layer::Value(found.iter().map(|found| found.map_or(0.0, |(_, stride)| stride as f32)).collect()));
                }
            }
        }
        let size = request.view.size;
        let hdr = texels(hdr).map(bytemuck::pod_collect_to_vec).unwrap_or_default();
        let displayed = texels(displayed).map(bytemuck::pod_collect_to_vec);
        let report = frame.into_report();
        let passes = report.passes.iter().map(|p| (p.name.clone(), p.time_ms)).collect();
        Ok(Picture { size, hdr, displayed, layers, passes, fetches_per_px, report })
    }

    /// Returns the displayed picture. If the device did not tone-map it, [`crate::display::reference`] tone-maps `hdr` with `exposure`.
    pub fn displayed(&self, exposure: Exposure) -> Vec<[u8; 3]> {
        match &self.displayed {
            Some(codes) => codes.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            None => self.hdr.iter().map(|&[r, g, b, _]| reference::codes([r, g, b], exposure)).collect(),
        }
    }

    /// Returns the layer with this name, if it was requested.
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|(n, _)| n == name).map(|(_, layer)| layer)
    }

    /// Returns the colours or vectors of the layer with this name, if it was requested and holds such values.
    pub fn vectors(&self, name: &str) -> Option<&[[f32; 3]]> {
        match self.layer(name)? {
            Layer::Rgb(texels) | Layer::Xyz(texels) => Some(texels),
            Layer::Value(_) => None,
        }
    }

    /// Returns the numbers of the layer with this name, if it was requested and holds one number per pixel.
    pub fn values(&self, name: &str) -> Option<&[f32]> {
        match self.layer(name)? {
            Layer::Value(values) => Some(values),
            Layer::Rgb(_) | Layer::Xyz(_) => None,
        }
    }
}

//! A finished picture with its layers.

use half::f16;

use crate::base::error::{Error, Result};
use crate::base::names::nearest;
use crate::display::{Exposure, reference};
use crate::frame::{Frame, FrameReport};
use crate::gpu::read_texture;

/// Names of all layers, in the order in which they are written.
pub const AOV_NAMES: [&str; 10] = ["albedo", "normal", "depth", "mask", "variant", "fetches", "choice", "position", "ddx", "ddy"];

/// The layers that are requested in addition to the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct AovSet(u16);

impl AovSet {
    /// All layers.
    pub const ALL: AovSet = AovSet((1 << AOV_NAMES.len()) - 1);

    /// The set of these names.
    ///
    /// # Errors
    /// For an unknown name, with the nearest known one.
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

    /// Whether the shading pass has to record diagnostics.
    pub fn needs_diagnostics(self) -> bool {
        self.has("fetches") || self.has("choice") || self.has("variant")
    }

    fn needs_inspection(self) -> bool {
        self.has("position") || self.has("ddx") || self.has("ddy")
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
    /// Linear radiance; alpha 1 = terrain, 0 = sky.
    pub hdr: Vec<[f32; 4]>,
    /// Tone-mapped sRGB codes for people, alpha as in `hdr`; `None` if the request did not ask for them.
    pub displayed: Option<Vec<[u8; 4]>>,
    /// The requested layers, by name.
    pub layers: Vec<(String, Layer)>,
    /// Device time of each pass, milliseconds.
    pub passes: Vec<(String, f64)>,
    /// Mean fetches per terrain pixel, if they were counted.
    pub fetches_per_px: Option<f64>,
    /// The report of the frame.
    pub report: FrameReport,
}

fn rgba16(bytes: &[u8]) -> Vec<[f32; 4]> {
    let words: Vec<[f16; 4]> = bytemuck::pod_collect_to_vec(bytes);
    words.into_iter().map(|t| t.map(f16::to_f32)).collect()
}

impl Picture {
    /// Reads a frame back.
    ///
    /// # Errors
    /// When the device is lost.
    pub(super) fn read(frame: Frame<'_, '_>) -> Result<Picture> {
        let (gpu, targets, request) = (frame.renderer().gpu(), frame.targets(), frame.request());
        let hdr = bytemuck::pod_collect_to_vec(&read_texture(gpu, &targets.image, wgpu::TextureAspect::All, 16)?);
        let displayed = match request.outputs.display {
            Some(_) if request.outputs.lit => {
                Some(bytemuck::pod_collect_to_vec(&read_texture(gpu, &targets.displayed, wgpu::TextureAspect::All, 4)?))
            }
            _ => None,
        };
        let wanted = request.outputs.aovs;
        let mut layers = Vec::new();
        let mut add = |name: &str, layer: Layer| layers.push((name.to_owned(), layer));
        let rgb = |t: &[f32; 4]| [t[0], t[1], t[2]];
        if wanted.has("albedo") {
            let texels = rgba16(&read_texture(gpu, &targets.shading.albedo, wgpu::TextureAspect::All, 8)?);
            add("albedo", Layer::Rgb(texels.iter().map(rgb).collect()));
        }
        if wanted.has("normal") {
            let texels = rgba16(&read_texture(gpu, &targets.shading.normal, wgpu::TextureAspect::All, 8)?);
            add("normal", Layer::Xyz(texels.iter().map(rgb).collect()));
        }
        if wanted.has("depth") {
            let depth: Vec<f32> =
                bytemuck::pod_collect_to_vec(&read_texture(gpu, &targets.geometry.depth_stencil, wgpu::TextureAspect::DepthOnly, 4)?);
            // Metres along the view direction; 0 = no terrain.
            let metres = |d: f32| if d > 0.0 { crate::view::camera::NEAR_M as f32 / d } else { 0.0 };
            add("depth", Layer::Value(depth.into_iter().map(metres).collect()));
        }
        if wanted.has("mask") {
            let mask = read_texture(gpu, &targets.geometry.mask, wgpu::TextureAspect::All, 1)?;
            add("mask", Layer::Value(mask.into_iter().map(f32::from).collect()));
        }
        let mut fetches_per_px = None;
        if wanted.needs_diagnostics() || request.outputs.count_fetches {
            let words: Vec<u32> =
                bytemuck::pod_collect_to_vec(&read_texture(gpu, &targets.shading.diagnostics, wgpu::TextureAspect::All, 4)?);
            let layer = |shift: u32, bits: u32| Layer::Value(words.iter().map(|w| (w >> shift & ((1 << bits) - 1)) as f32).collect());
            if wanted.has("variant") {
                add("variant", layer(24, 8));
            }
            if wanted.has("fetches") {
                add("fetches", layer(0, 16));
            }
            if wanted.has("choice") {
                add("choice", layer(16, 8));
            }
            let shaded: Vec<u32> = words.iter().filter(|w| **w >> 24 != 0).map(|w| w & 0xffff).collect();
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
        }
        let size = request.view.size;
        let report = frame.into_report();
        let passes = report.passes.iter().map(|p| (p.name.clone(), p.time_ms)).collect();
        Ok(Picture { size, hdr, displayed, layers, passes, fetches_per_px, report })
    }

    /// The picture that people see: as the device tone-mapped it or, if the request did not ask for that, tone-mapped by the reference with
    /// `exposure`.
    pub fn displayed(&self, exposure: Exposure) -> Vec<[u8; 3]> {
        match &self.displayed {
            Some(codes) => codes.iter().map(|&[r, g, b, _]| [r, g, b]).collect(),
            None => self.hdr.iter().map(|&[r, g, b, _]| reference::codes([r, g, b], exposure)).collect(),
        }
    }

    /// A layer that was requested.
    pub fn layer(&self, name: &str) -> Option<&Layer> {
        self.layers.iter().find(|(n, _)| n == name).map(|(_, layer)| layer)
    }

    /// Colours or vectors of a layer that was requested.
    pub fn vectors(&self, name: &str) -> Option<&[[f32; 3]]> {
        match self.layer(name)? {
            Layer::Rgb(texels) | Layer::Xyz(texels) => Some(texels),
            Layer::Value(_) => None,
        }
    }

    /// Numbers of a layer that was requested.
    pub fn values(&self, name: &str) -> Option<&[f32]> {
        match self.layer(name)? {
            Layer::Value(values) => Some(values),
            Layer::Rgb(_) | Layer::Xyz(_) => None,
        }
    }
}

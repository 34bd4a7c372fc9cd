//! Shading: computes the G-buffer from depth, normals and terrain data, with one indirect draw of tiles per pipeline.
//!
//! Reads depth, normals, tile lists, terrain and virtual-texture pages. Writes albedo + specular occlusion and normal + smoothness (RGBA16Float), and
//! on request a diagnostics target (fetches, choice, tile mask). Override constants specialise one WGSL module into 31 variants and the generic
//! kernel. Source: Moore, GDC 2018, "Cliff Shading", "Terrain Shader Variations", "Terrain G-Buffer Pass"; rulings 1, 7 and 15 in `ARCHITECTURE.md`.

use std::borrow::Cow;
use std::collections::HashMap;

use crate::base::error::{Error, Result};
use crate::classification;
use crate::classification::{ARGUMENT_BYTES, Lists};
use crate::geometry::{self, DEPTH_FORMAT};
use crate::gpu::bindings::{ARRAY, Binding, FLAT, aspect, view};
use crate::gpu::uses::{PassUse, TargetUse};
use crate::gpu::{CLEAR, Gpu, Recording, ShaderModule, Template};
use crate::shared::blue_noise;
use crate::shared::noise::NoiseKind;
use crate::stage::{Build, Canvas, Declaration, Exchange, Stage};
use crate::variant::{Flavour, Variant};
use crate::virtual_texture::VirtualTexture;

pub mod diagnostics;
mod estimator;
mod modules;
pub mod reference;

pub use estimator::{Estimator, VARIANCE_SCALE};
pub use modules::SNAPPED_COSINE;

/// Salts: numbers that are hashed together with the seed, so that each stochastic flavour has independent random numbers (ruling 15 in
/// `ARCHITECTURE.md`).
pub mod salt {
    /// Salt of near cliff.
    pub const NEAR_CLIFF: u32 = 1;
    /// Salt of far cliff.
    pub const FAR_CLIFF: u32 = 2;
    /// Salt of full splat, for estimators that shade splat with random choices.
    pub const SPLAT: u32 = 3;
    /// The estimator `stf` adds this number to the salt of a flavour, for the random choice of mip level and texel in the albedo and normal textures.
    pub const TEXEL: u32 = 4;
    /// The estimator `stf` adds this number to the salt of a flavour, for the random choice of mip level and texel in the height texture.
    pub const HEIGHT_TEXEL: u32 = 8;
}

/// A shading kernel, that is, the shader of a pipeline: either the kernel of one variant, or the generic kernel, which reads the flavour mask of each
/// tile at run time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Kernel {
    /// Specialised for one variant; draws that variant's tile list.
    Variant(Variant),
    /// The über-shader; draws every terrain tile.
    Generic,
}

/// The parameters that specialise a pipeline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct PipelineKey {
    /// The kernel.
    pub kernel: Kernel,
    /// Estimator of near cliff, far cliff and splat.
    pub estimator: Estimator,
    /// Noise that drives the random choices of the estimator.
    pub noise: NoiseKind,
    /// Whether full splat blends two tiling scales, which doubles its fetches. This has no effect on estimators that blend only one scale
    /// ([`Estimator::has_two_tilings`]).
    pub two_tilings: bool,
    /// Whether fetches are counted and choices recorded.
    pub diagnostics: bool,
}

/// How the pass is executed.
#[derive(Clone, Copy, Debug)]
pub struct ShadingPass<'a> {
    /// The pipelines to draw with.
    pub keys: &'a [PipelineKey],
    /// Whether the pass writes the diagnostics target. All keys must agree with this value. The target is cleared even if the picture has no terrain
    /// tile.
    pub diagnostics: bool,
    /// Whether each key has a pass of its own, named after its kernel, such as `shading: vt`. If not, all keys share one pass, named
    /// `shading`.
    pub timed: bool,
}

/// Settings that all pipelines of a renderer share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Whether the scene has a colour modulation map.
    pub colour_modulation: bool,
    /// Whether detail textures are filtered anisotropically.
    pub anisotropic: bool,
    /// Whether a tile is drawn as one triangle, see [`tile_vertices`](crate::classification::tile_vertices).
    pub one_triangle: bool,
    /// Edge length of a tile, pixels.
    pub tile: u32,
}

impl PipelineKey {
    /// Returns the canonical key of this pipeline: parameters that no flavour of the variant uses are set to default values. So keys that differ only
    /// in unused parameters share one pipeline. The key of the generic kernel stays as it is.
    #[must_use]
    pub fn canonical(self) -> PipelineKey {
        let Kernel::Variant(variant) = self.kernel else { return self };
        let estimated = variant.has(Flavour::NearCliff) || variant.has(Flavour::FarCliff) || variant.has(Flavour::Splat);
        let estimator = if estimated || self.estimator == Estimator::Variance { self.estimator } else { Estimator::Fc5 };
        let noise = if estimator.is_stochastic(variant) { self.noise } else { NoiseKind::HashedIsotropic };
        PipelineKey {
            estimator,
            noise,
            two_tilings: self.two_tilings && variant.has(Flavour::Splat) && estimator.has_two_tilings(),
            ..self
        }
    }

    /// The override constants of `shading.wgsl`.
    pub fn overrides(self, settings: Settings) -> [(&'static str, f64); 10] {
        let flag = |on: bool| f64::from(u8::from(on));
        let mask = match self.kernel {
            Kernel::Variant(variant) => variant.mask(),
            Kernel::Generic => 0,
        };
        [
            ("VARIANT", f64::from(mask)),
            ("ESTIMATOR", f64::from(self.estimator as u8)),
            ("NOISE", f64::from(self.noise.code())),
            ("TWO_TILINGS", flag(self.two_tilings && self.estimator.has_two_tilings())),
            ("HEX_TILING", flag(self.estimator.is_hex_tiled())),
            ("COUNT_FETCHES", flag(self.diagnostics)),
            ("COLOUR_MODULATION", flag(settings.colour_modulation)),
            ("ANISOTROPIC", flag(settings.anisotropic)),
            ("ONE_TRIANGLE", flag(settings.one_triangle)),
            ("TILE", f64::from(settings.tile)),
        ]
    }
}

/// The G-buffer.
pub struct Targets {
    /// Linear albedo, specular occlusion in alpha.
    pub albedo: wgpu::Texture,
    /// World normal, smoothness in alpha.
    pub normal: wgpu::Texture,
    /// One word per pixel, see [`diagnostics`].
    pub diagnostics: wgpu::Texture,
}

const DIAGNOSTICS_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R32Uint;
/// Format of the G-buffer's colour targets.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

impl Targets {
    /// Allocates targets for a picture of `size` pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Targets {
        Targets {
            albedo: gpu.target("albedo", size, FORMAT),
            normal: gpu.target("normal", size, FORMAT),
            diagnostics: gpu.target("diagnostics", size, DIAGNOSTICS_FORMAT),
        }
    }
}

/// The pass and its pipelines. A pipeline is built when it is first needed, and is then cached.
pub struct Shading {
    template: Template,
    layout: wgpu::BindGroupLayout,
    pipeline_layout: wgpu::PipelineLayout,
    pipelines: HashMap<PipelineKey, wgpu::RenderPipeline>,
    settings: Settings,
    /// Buffer with [`blue_noise::ranks`]. Until a pipeline needs the ranks, the buffer holds only a few zeros.
    noise_ranks: wgpu::Buffer,
    /// Pipelines of the displayed view. A reload of the shaders builds them immediately.
    displayed: Vec<PipelineKey>,
}

/// The stage's shader module, which is specialised into every variant.
pub static MODULE: ShaderModule = ShaderModule::new("shading", modules::ROOTS);

impl Stage for Shading {
    const DECLARATION: Declaration = Declaration {
        passes: |demands| {
            let variants = u32::try_from(demands.variants().len()).expect("there are at most 31 variants");
            vec![PassUse::new("shading", variants + 1, "a pipeline per variant that tiles may need, and one for the generic kernel")]
        },
        targets: |_| {
            vec![
                TargetUse::new("G-buffer albedo, occlusion", FORMAT),
                TargetUse::new("G-buffer normal, smoothness", FORMAT),
                TargetUse::new("diagnostics", DIAGNOSTICS_FORMAT),
            ]
        },
        name: "shading",
        about: "Reads tile lists, depth, normals, terrain and pages; writes the G-buffer, with one variant per tile",
        modules: &[&MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = Targets;

    fn targets(canvas: Canvas<'_>) -> Targets {
        Targets::new(canvas.gpu, canvas.size)
    }

    fn build(build: Build<'_>) -> Result<Shading> {
        let Build { gpu, frame: frame_layout, terrain, demands, tile } = build;
        let settings = Settings {
            colour_modulation: demands.colour_modulation,
            anisotropic: demands.anisotropy > 1,
            one_triangle: classification::tile_vertices(gpu) == 3,
            tile,
        };
        let layout = gpu.layout(
            "shading",
            wgpu::ShaderStages::VERTEX_FRAGMENT,
            &[
                Binding::Depth,
                Binding::TextureLoaded(FLAT),
                Binding::Storage,
                Binding::TextureUint(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Sampler,
                Binding::Storage,
            ],
        );
        Ok(Shading {
            template: MODULE.compile(gpu)?.template()?,
            pipeline_layout: gpu.pipeline_layout("shading", &[frame_layout, &terrain.layout, &layout]),
            layout,
            pipelines: HashMap::new(),
            settings,
            noise_ranks: gpu.buffer_with("noise ranks, unused", wgpu::BufferUsages::STORAGE, &[0; 16]),
            displayed: Vec::new(),
        })
    }

    /// Builds the stage again. It also builds the pipelines of the displayed view or, if there is no such view, the generic pipeline, so that an
    /// error is reported immediately and not with the first picture.
    fn rebuilt(&self, build: Build<'_>) -> Result<Exchange<Shading>> {
        let mut shading = Shading::build(build)?;
        let generic = PipelineKey {
            kernel: Kernel::Generic,
            estimator: Estimator::Fc5,
            noise: NoiseKind::HashedIsotropic,
            two_tilings: false,
            diagnostics: false,
        };
        let keys = if self.displayed.is_empty() { vec![generic] } else { self.displayed.clone() };
        for key in keys {
            shading.warm(build.gpu, key)?;
        }
        shading.displayed.clone_from(&self.displayed);
        Ok(Box::new(move |stage| *stage = shading))
    }
}

impl Shading {
    /// Records which pipelines the displayed view uses, so that a reload of the shaders can build them immediately. If `fresh`, a new view begins,
    /// and `keys` replace the earlier keys; otherwise `keys` are added to the earlier keys.
    pub fn display(&mut self, keys: &[PipelineKey], fresh: bool) {
        if fresh {
            self.displayed.clear();
        }
        let added: Vec<PipelineKey> = keys.iter().filter(|key| !self.displayed.contains(key)).copied().collect();
        self.displayed.extend(added);
    }

    /// Builds a pipeline if it does not exist. Returns whether this call built it.
    ///
    /// # Errors
    /// When the shader cannot be specialised, or when the device refuses the specialised shader or the pipeline. The error is [`Error::Request`] and
    /// not [`Error::Gpu`], because other pipelines can still be used.
    pub fn warm(&mut self, gpu: &Gpu, key: PipelineKey) -> Result<bool> {
        if self.pipelines.contains_key(&key) {
            return Ok(false);
        }
        if key.noise.needs_mask() && !self.pipelines.keys().any(|k| k.noise.needs_mask()) {
            self.noise_ranks = gpu.buffer_with("noise ranks", wgpu::BufferUsages::STORAGE, bytemuck::cast_slice(blue_noise::ranks()));
        }
        let fragment = if key.diagnostics { "shading_fragment_counted" } else { "shading_fragment" };
        let refused = |what: String| Error::Request(format!("shader shading: shading/shading.wgsl: {what}"));
        let own = self.template.cut(&["shading_vertex", fragment], &key.overrides(self.settings)).map_err(refused)?;
        let (module, complaint) = gpu.caught(|| {
            let source = wgpu::ShaderSource::Naga(Cow::Owned(own));
            gpu.device.create_shader_module(wgpu::ShaderModuleDescriptor { label: Some("shading"), source })
        });
        if let Some(what) = complaint {
            return Err(refused(what));
        }
        let mut targets = vec![Some(FORMAT.into()), Some(FORMAT.into())];
        if key.diagnostics {
            targets.push(Some(DIAGNOSTICS_FORMAT.into()));
        }
        let terrain_only = wgpu::StencilFaceState { compare: wgpu::CompareFunction::Equal, ..Default::default() };
        let descriptor = wgpu::RenderPipelineDescriptor {
            label: Some("shading"),
            layout: Some(&self.pipeline_layout),
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("shading_vertex"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState { unclipped_depth: self.settings.one_triangle, ..Default::default() },
            depth_stencil: Some(wgpu::DepthStencilState {
                format: DEPTH_FORMAT,
                depth_write_enabled: Some(false),
                depth_compare: Some(if self.settings.one_triangle { wgpu::CompareFunction::Less } else { wgpu::CompareFunction::Always }),
                stencil: wgpu::StencilState { front: terrain_only, back: terrain_only, read_mask: 0xff, write_mask: 0 },
                bias: wgpu::DepthBiasState::default(),
            }),
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(fragment),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: None,
        };
        let (pipeline, complaint) = gpu.caught(|| gpu.device.create_render_pipeline(&descriptor));
        if let Some(what) = complaint {
            return Err(refused(what));
        }
        self.pipelines.insert(key, pipeline);
        Ok(true)
    }

    /// Records the pass: one indirect draw per key of `how`. The pipeline of each key must have been built by [`Shading::warm`].
    pub fn encode(
        &self,
        rec: &mut Recording<'_>,
        geometry: &geometry::Targets,
        lists: &Lists,
        pages: &VirtualTexture,
        how: ShadingPass<'_>,
        targets: &Targets,
    ) {
        let page_views = pages.views();
        let texture = wgpu::BindingResource::TextureView;
        let group = rec.gpu.group(
            "shading",
            &self.layout,
            &[
                texture(&aspect(&geometry.depth_stencil, wgpu::TextureAspect::DepthOnly)),
                texture(&view(&geometry.normals)),
                lists.tiles.as_entire_binding(),
                texture(&page_views[0]),
                texture(&page_views[1]),
                texture(&page_views[2]),
                texture(&page_views[3]),
                wgpu::BindingResource::Sampler(&pages.sampler),
                self.noise_ranks.as_entire_binding(),
            ],
        );
        let views = [&view(&targets.albedo), &view(&targets.normal), &view(&targets.diagnostics)];
        let colours = &views[..if how.diagnostics { 3 } else { 2 }];
        let depth_stencil = view(&geometry.depth_stencil);
        let mut draw = |name: &str, keys: &[PipelineKey], load: wgpu::LoadOp<wgpu::Color>| {
            let tested = wgpu::RenderPassDepthStencilAttachment { view: &depth_stencil, depth_ops: None, stencil_ops: None };
            let mut pass = rec.render(name, colours, load, Some(tested), 2, &[&group]);
            pass.set_stencil_reference(1);
            for key in keys {
                let list = match key.kernel {
                    Kernel::Variant(variant) => u64::from(variant.mask()),
                    Kernel::Generic => 0,
                };
                pass.set_pipeline(&self.pipelines[key]);
                pass.draw_indirect(&lists.arguments, list * ARGUMENT_BYTES);
            }
        };
        if !how.timed || how.keys.is_empty() {
            return draw("shading", how.keys, CLEAR);
        }
        for (index, key) in how.keys.iter().enumerate() {
            let name = match key.kernel {
                Kernel::Variant(variant) => format!("shading: {variant}"),
                Kernel::Generic => "shading: generic".to_owned(),
            };
            draw(&name, std::slice::from_ref(key), if index == 0 { CLEAR } else { wgpu::LoadOp::Load });
        }
    }
}

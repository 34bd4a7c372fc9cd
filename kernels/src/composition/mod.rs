//! Composition: computes the picture of any variant from the pictures of single flavours.
//!
//! The G-buffer of a variant is a weighted sum over its flavours; only the normal must be normalised after the sum. The weights of a pixel follow
//! from its distance, its normal, the variant and the rules of the scene. So five shading passes and 31 weighted sums replace 31 shading passes. A
//! composed picture is either the albedo ([`Signal::Albedo`]) or the lit picture as a screen shows it ([`Signal::Lit`]). Lit pictures are computed by
//! the functions of the stages `lighting` and `display`. Composed albedo equals the albedo of the variant's own shader, except that the albedo of
//! each flavour is also rounded to f16. Tests compare both signals for all 31 variants. The number of fetches and the first random choice of a pixel
//! are composed, too. Times cannot be composed; they are measured with the pipelines of the variants.
//!
//! Reads depth, normals, and the G-buffer + diagnostics of each flavour. Writes two words per pixel (`shared::signal`). Dispatch: one workgroup per
//! 8 x 8 pixels.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};

use crate::base::error::Result;
use crate::base::wgsl::Wgsl;
use crate::display::{self, DisplayUniforms, Exposure};
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, aspect, view};
use crate::gpu::{Gpu, Recording, ShaderModule};
use crate::lighting;
use crate::shading;
use crate::shared;
use crate::shared::signal::Signal;
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::variant::{Flavour, Variant};
use crate::view;

/// How one picture is composed; the layout matches `CompositionStream` in `composition.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
pub struct CompositionStream {
    /// The variant forced on every pixel; 0 = each pixel has the flavours that it needs.
    pub mask: u32,
    /// 1 = the scene has colour modulation. Every flavour except `vt` then counts one fetch of the modulation map. The composed count includes only
    /// one such fetch.
    pub modulated: u32,
    /// 1 = weights are squared, because variances of independent flavours add with squared weights.
    pub squared: u32,
    /// 1 = the picture is lit and mapped to the display; 0 = it is linear albedo.
    pub lit: u32,
}

impl CompositionStream {
    /// Returns this description for the kind of picture `signal`, albedo or lit.
    #[must_use]
    pub fn of(self, signal: Signal) -> CompositionStream {
        CompositionStream { lit: u32::from(signal == Signal::Lit), ..self }
    }
}

/// How one picture is composed, and where it is written.
#[derive(Clone, Copy)]
pub struct Destination<'a> {
    /// How the picture is composed.
    pub stream: CompositionStream,
    /// The buffer that receives the picture.
    pub signal: &'a wgpu::Buffer,
    /// Offset of the picture in the buffer, pixels.
    pub offset: u32,
}

/// G-buffer and diagnostics of each flavour, in the order of the flavours' bits in a mask. A clone shares the textures.
#[derive(Clone)]
pub struct Layers {
    albedo: [wgpu::Texture; 5],
    normal: [wgpu::Texture; 5],
    diagnostics: [wgpu::Texture; 5],
}

impl Layers {
    /// Allocates the layers for a picture of `size` pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Layers {
        let layer = |label: &str, format| {
            gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size: wgpu::Extent3d { width: size[0], height: size[1], depth_or_array_layers: 1 },
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::TEXTURE_BINDING,
                view_formats: &[],
            })
        };
        Layers {
            albedo: std::array::from_fn(|_| layer("flavour albedo", shading::FORMAT)),
            normal: std::array::from_fn(|_| layer("flavour normal", shading::FORMAT)),
            diagnostics: std::array::from_fn(|_| layer("flavour diagnostics", wgpu::TextureFormat::R32Uint)),
        }
    }

    /// Returns these layers, with the layers of `flavours` replaced by those of `other`. The textures are shared, not copied.
    #[must_use]
    pub fn with(&self, other: &Layers, flavours: Variant) -> Layers {
        let pick = |own: &[wgpu::Texture; 5], other: &[wgpu::Texture; 5]| {
            std::array::from_fn(|i| if flavours.has(Flavour::ALL[i]) { other[i].clone() } else { own[i].clone() })
        };
        Layers {
            albedo: pick(&self.albedo, &other.albedo),
            normal: pick(&self.normal, &other.normal),
            diagnostics: pick(&self.diagnostics, &other.diagnostics),
        }
    }

    /// Number of bytes that the layers for a picture of `size` pixels occupy.
    pub fn bytes(size: [u32; 2]) -> u64 {
        u64::from(size[0]) * u64::from(size[1]) * 5 * (8 + 8 + 4)
    }

    /// Records the copy of the shading pass's results into the layer of `flavour`.
    pub fn capture(&self, encoder: &mut wgpu::CommandEncoder, flavour: Flavour, targets: &shading::Targets) {
        let index = flavour.index();
        let targets = [&targets.albedo, &targets.normal, &targets.diagnostics];
        for (from, to) in targets.into_iter().zip([&self.albedo[index], &self.normal[index], &self.diagnostics[index]]) {
            encoder.copy_texture_to_texture(from.as_image_copy(), to.as_image_copy(), from.size());
        }
    }
}

/// The composition pass.
pub struct Composition {
    pipeline: wgpu::ComputePipeline,
    layers_layout: wgpu::BindGroupLayout,
    stream_layout: wgpu::BindGroupLayout,
    modulated: bool,
}

static WGSL: Wgsl = Wgsl::new(
    "composition/composition.wgsl",
    include_str!("composition.wgsl"),
    &[
        &view::WGSL,
        &shading::diagnostics::WGSL,
        &lighting::LIGHT,
        &display::ENCODE,
        &shared::FLAVOUR_WEIGHTS,
        &shared::OCTAHEDRAL,
        &shared::SIGNAL,
        &shared::USABLE,
        &shared::VIEW,
    ],
);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("composition", &[&WGSL]);

impl Stage for Composition {
    const DECLARATION: Declaration = Declaration {
        name: "composition",
        about: "Reads each flavour's G-buffer; writes the albedo or the lit picture of each requested set of flavours, two words per pixel",
        modules: &[&MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = ();

    fn targets(_: Canvas<'_>) {}

    fn build(build: Build<'_>) -> Result<Composition> {
        let Build { gpu, frame: frame_layout, demands, .. } = build;
        let modulated = demands.colour_modulation;
        let stage = wgpu::ShaderStages::COMPUTE;
        let mut layers = vec![Binding::Depth, Binding::TextureLoaded(FLAT)];
        layers.extend([Binding::TextureLoaded(FLAT); 5]);
        layers.extend([Binding::TextureUint(FLAT); 5]);
        layers.extend([Binding::TextureLoaded(FLAT); 5]);
        let layers_layout = gpu.layout("flavour layers", stage, &layers);
        let stream_layout = gpu.layout("composed stream", stage, &[Binding::Storage, Binding::StorageWritten, Binding::Uniform]);
        let shader = MODULE.compile(gpu)?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("composition"),
            layout: Some(&gpu.pipeline_layout("composition", &[frame_layout, &layers_layout, &stream_layout])),
            module: &shader.module,
            entry_point: Some("composition_main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Composition { pipeline, layers_layout, stream_layout, modulated })
    }
}

impl Composition {
    /// Returns the description of the albedo picture of `variant`; `None` = each pixel has the flavours that it needs.
    pub fn stream(&self, variant: Option<Variant>) -> CompositionStream {
        CompositionStream { mask: variant.map_or(0, |v| u32::from(v.mask())), modulated: u32::from(self.modulated), squared: 0, lit: 0 }
    }

    /// Records the pass, which writes the picture of each stream to its destination. `exposure` says how lit pictures are mapped to the display. One
    /// dispatch composes all streams and reads each layer once; if the pictures do not fit in one buffer binding, there are several dispatches.
    pub fn encode(
        &self,
        rec: &mut Recording<'_>,
        geometry: &geometry::Targets,
        layers: &Layers,
        exposure: Exposure,
        destinations: &[Destination<'_>],
    ) {
        let (gpu, frame, encoder) = (rec.gpu, rec.frame(), &mut rec.encoder);
        let depth = aspect(&geometry.depth_stencil, wgpu::TextureAspect::DepthOnly);
        let mut views = vec![depth, view(&geometry.normals)];
        views.extend(layers.albedo.iter().chain(&layers.diagnostics).chain(&layers.normal).map(view));
        let resources: Vec<_> = views.iter().map(wgpu::BindingResource::TextureView).collect();
        let layers_group = gpu.group("flavour layers", &self.layers_layout, &resources);
        let (width, height) = (geometry.mask.width(), geometry.mask.height());
        let picture = u64::from(width) * u64::from(height) * 8;
        let at_once = usize::try_from(gpu.device.limits().max_storage_buffer_binding_size / picture).unwrap_or(1).max(1);
        let shown = gpu.buffer_with("composed display", wgpu::BufferUsages::UNIFORM, bytes_of(&DisplayUniforms::of(exposure)));
        for part in destinations.chunks(at_once) {
            let streams: Vec<CompositionStream> = part.iter().map(|d| d.stream).collect();
            let list = gpu.buffer_with("composed streams", wgpu::BufferUsages::STORAGE, cast_slice(&streams));
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC;
            let signal = gpu.buffer("composed", usage, picture * part.len() as u64);
            let group = gpu.group("composed streams", &self.stream_layout, &[&list, &signal, &shown].map(|b| b.as_entire_binding()));
            {
                let mut pass =
                    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("composition"), timestamp_writes: None });
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, frame, &[]);
                pass.set_bind_group(1, &layers_group, &[]);
                pass.set_bind_group(2, &group, &[]);
                pass.dispatch_workgroups(width.div_ceil(8), height.div_ceil(8), 1);
            }
            for (i, to) in (0..).zip(part) {
                encoder.copy_buffer_to_buffer(&signal, i * picture, to.signal, u64::from(to.offset) * 8, picture);
            }
        }
    }
}

//! Geometry pass: draws all visible patches with one draw call, into depth, stencil, classification mask and two normals.
//!
//! Reads the patch list, the edge of the data, and the atlases of height, normal and albedo (holes). Writes depth (reversed f32, `near / distance`),
//! stencil (1 = terrain), mask (R8, one bit per flavour) and normals ([`NormalEncoding`]: shading normal and triangle's plane). One indexed draw, one
//! instance per patch. Source: Moore, GDC 2018, "Vertex Shading", "LOD Mesh Stitching", "Terrain Geometry Pass"; rulings 7, 8 and 11 in
//! `ARCHITECTURE.md`.

use std::sync::OnceLock;

use bytemuck::cast_slice;

use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::culling::{PATCH_QUADS, Patch};
use crate::gpu::bindings::{Binding, view};
use crate::gpu::uses::{PassUse, TargetUse};
use crate::gpu::{CLEAR, Gpu, Recording, Shader, ShaderModule, constants};
use crate::shared;
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::terrain;
use crate::view;
use crate::view::normals::NormalEncoding;
use crate::world::NODE_QUADS;
use crate::world::payload::diagonal_rises;

pub mod reference;

/// Render targets of the geometry pass. All have the size of the picture.
pub struct Targets {
    /// Depth and stencil.
    pub depth_stencil: wgpu::Texture,
    /// Classification mask, R8Uint.
    pub mask: wgpu::Texture,
    /// Shading normal and triangle's plane, in [`NormalEncoding::format`].
    pub normals: wgpu::Texture,
}

const MASK_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::R8Uint;
/// Format of depth and stencil.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32FloatStencil8;

impl Targets {
    /// Allocates the targets for a picture of `size` pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2], normals: NormalEncoding) -> Targets {
        Targets {
            depth_stencil: gpu.target("depth and stencil", size, DEPTH_FORMAT),
            mask: gpu.target("classification mask", size, MASK_FORMAT),
            normals: gpu.target("normals", size, normals.format()),
        }
    }
}

/// The geometry pass.
pub struct Geometry {
    shader: Shader,
    pipeline_layout: wgpu::PipelineLayout,
    ground: Ground,
    /// Pipeline for normals of 32 bits.
    pipeline: wgpu::RenderPipeline,
    /// Pipeline for normals of 128 bits. It is created when a picture first needs it.
    exact: OnceLock<wgpu::RenderPipeline>,
    layout: wgpu::BindGroupLayout,
    /// Index buffer of a patch and its number of indices, by log2 of the vertex stride.
    indices: [(wgpu::Buffer, u32); STRIDES.len()],
}

/// Features of the ground of a scene for which the pipeline needs additional code.
#[derive(Clone, Copy)]
struct Ground {
    has_holes: bool,
    has_edge: bool,
}

/// Possible vertex strides. A stride of n draws every n-th vertex along the side of a patch.
pub const STRIDES: [u32; 3] = [1, 2, 4];

/// WGSL functions for stitching, which need no bindings.
pub static STITCH_WGSL: Wgsl =
    Wgsl::new("geometry/stitch.wgsl", include_str!("stitch.wgsl"), &[]).with(&[("GEOMETRY_NODE_QUADS", Constant::U32(NODE_QUADS as u32))]);

static WGSL: Wgsl = Wgsl::new(
    "geometry/geometry.wgsl",
    include_str!("geometry.wgsl"),
    &[&terrain::WGSL, &view::WGSL, &STITCH_WGSL, &shared::FLAVOUR_WEIGHTS],
);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("geometry", &[&WGSL]);

/// Returns the indices of a patch: 16 x 16 quads over its 17 x 17 vertices, or fewer and larger quads over every `stride`-th vertex. Triangles are
/// counter-clockwise if seen from above. The diagonals of neighbouring quads alternate.
fn patch_indices(stride: u32) -> Vec<u16> {
    let [side, stride] = [PATCH_QUADS, stride].map(|n| u16::try_from(n).unwrap_or(1));
    let vertex = |x: u16, y: u16| stride * (y * (side + 1) + x);
    let mut indices = Vec::new();
    for y in 0..side / stride {
        for x in 0..side / stride {
            let [a, b, c, d] = [vertex(x, y), vertex(x + 1, y), vertex(x, y + 1), vertex(x + 1, y + 1)];
            if diagonal_rises(usize::from(x), usize::from(y)) {
                indices.extend([a, b, d, a, d, c]);
            } else {
                indices.extend([a, b, c, b, d, c]);
            }
        }
    }
    indices
}

fn pipeline(
    gpu: &Gpu,
    shader: &Shader,
    layout: &wgpu::PipelineLayout,
    ground: Ground,
    normals: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let overrides = [("HAS_HOLES", ground.has_holes), ("HAS_EDGE", ground.has_edge)].map(|(name, has)| (name, f64::from(u8::from(has))));
    let stencil = wgpu::StencilFaceState { pass_op: wgpu::StencilOperation::Replace, ..Default::default() };
    gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
        label: Some("geometry"),
        layout: Some(layout),
        vertex: wgpu::VertexState {
            module: &shader.module,
            entry_point: Some("geometry_vertex"),
            compilation_options: constants(&overrides),
            buffers: &[],
        },
        primitive: wgpu::PrimitiveState { cull_mode: Some(wgpu::Face::Back), ..Default::default() },
        depth_stencil: Some(wgpu::DepthStencilState {
            format: DEPTH_FORMAT,
            depth_write_enabled: Some(true),
            depth_compare: Some(wgpu::CompareFunction::Greater),
            stencil: wgpu::StencilState { front: stencil, back: stencil, read_mask: 0xff, write_mask: 0xff },
            bias: wgpu::DepthBiasState::default(),
        }),
        multisample: wgpu::MultisampleState::default(),
        fragment: Some(wgpu::FragmentState {
            module: &shader.module,
            entry_point: Some("geometry_fragment"),
            compilation_options: constants(&overrides),
            targets: &[Some(MASK_FORMAT.into()), Some(normals.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

impl Stage for Geometry {
    const DECLARATION: Declaration = Declaration {
        passes: |_| vec![PassUse::new("geometry", 1, "depth, stencil, mask, normals")],
        targets: |normals| {
            vec![
                TargetUse::new("depth and stencil", DEPTH_FORMAT),
                TargetUse::new("classification mask", MASK_FORMAT),
                TargetUse::new("shading, triangle normal", normals.format()),
            ]
        },
        name: "geometry",
        about: "Reads patches, heights, normals and holes; writes depth, stencil, classification mask and two normals",
        modules: &[&MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = Targets;

    fn targets(canvas: Canvas<'_>) -> Targets {
        Targets::new(canvas.gpu, canvas.size, canvas.normals)
    }

    fn build(build: Build<'_>) -> Result<Geometry> {
        let Build { gpu, frame: frame_layout, terrain, demands, .. } = build;
        let ground = Ground { has_holes: demands.holes, has_edge: demands.edge };
        let shader = MODULE.compile(gpu)?;
        let layout = gpu.layout("patches", wgpu::ShaderStages::VERTEX, &[Binding::Storage]);
        let pipeline_layout = gpu.pipeline_layout("geometry", &[frame_layout, &terrain.layout, &layout]);
        let pipeline = pipeline(gpu, &shader, &pipeline_layout, ground, NormalEncoding::default().format());
        let indices = STRIDES.map(|stride| {
            let indices = patch_indices(stride);
            let count = u32::try_from(indices.len()).unwrap_or(0);
            (gpu.buffer_with("patch indices", wgpu::BufferUsages::INDEX, cast_slice(&indices)), count)
        });
        Ok(Geometry { shader, pipeline_layout, ground, pipeline, exact: OnceLock::new(), layout, indices })
    }
}

impl Geometry {
    /// The pipeline that writes normals in this format.
    fn pipeline(&self, gpu: &Gpu, normals: wgpu::TextureFormat) -> &wgpu::RenderPipeline {
        if normals == NormalEncoding::default().format() {
            return &self.pipeline;
        }
        self.exact.get_or_init(|| pipeline(gpu, &self.shader, &self.pipeline_layout, self.ground, normals))
    }

    /// Records the pass. `stride`: one of [`STRIDES`].
    pub fn encode(&self, rec: &mut Recording<'_>, patches: &[Patch], stride: u32, targets: &Targets) {
        let gpu = rec.gpu;
        let list = gpu.buffer_with("patches", wgpu::BufferUsages::STORAGE, if patches.is_empty() { &[0; 32] } else { cast_slice(patches) });
        let group = gpu.group("patches", &self.layout, &[list.as_entire_binding()]);
        let depth_stencil = view(&targets.depth_stencil);
        let depth_stencil = wgpu::RenderPassDepthStencilAttachment {
            view: &depth_stencil,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
            stencil_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0), store: wgpu::StoreOp::Store }),
        };
        let colours = [&view(&targets.mask), &view(&targets.normals)];
        let mut pass = rec.render("geometry", &colours, CLEAR, Some(depth_stencil), 2, &[&group]);
        pass.set_pipeline(self.pipeline(gpu, targets.normals.format()));
        let (indices, count) = &self.indices[stride.ilog2() as usize];
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.set_stencil_reference(1);
        pass.draw_indexed(0..*count, 0, 0..u32::try_from(patches.len()).unwrap_or(0));
    }
}

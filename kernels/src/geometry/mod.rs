//! Geometry pass: every visible patch in one draw; depth, stencil, classification mask and two normals out.
//!
//! Reads the patch list, height, normal and albedo (holes) atlases. Writes depth (reversed f32, `near / distance`), stencil (1 = terrain),
//! mask (R8, one bit a flavour) and normals ([`NormalEncoding`]: shading normal and triangle's plane). One indexed draw, an instance a patch.
//! Source: Moore, GDC 2018, "Vertex Shading", "LOD Mesh Stitching", "Terrain Geometry Pass"; rulings 7, 8, 11.

use std::fmt;
use std::str::FromStr;
use std::sync::OnceLock;

use bytemuck::cast_slice;

use crate::base::error::Result;
use crate::culling::{PATCH_QUADS, Patch};
use crate::gpu::bindings::{Binding, view};
use crate::gpu::{Gpu, Shader, Timer, constants};
use crate::shared::{self, normal_pair, octahedral};
use crate::terrain::{self, Terrain};
use crate::view::FRAME_WGSL;
use crate::world::payload::diagonal_rises;

pub mod reference;

/// What the pass makes; all of the picture's size.
pub struct Targets {
    /// Depth and stencil.
    pub depth_stencil: wgpu::Texture,
    /// Classification mask, R8Uint.
    pub mask: wgpu::Texture,
    /// Shading normal and triangle's plane, in [`NormalEncoding::format`].
    pub normals: wgpu::Texture,
}

/// Format of depth and stencil.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32FloatStencil8;

impl Targets {
    /// Targets of a size in pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2], normals: NormalEncoding) -> Targets {
        Targets {
            depth_stencil: gpu.target("depth and stencil", size, DEPTH_FORMAT),
            mask: gpu.target("classification mask", size, wgpu::TextureFormat::R8Uint),
            normals: gpu.target("normals", size, normals.format()),
        }
    }
}

/// How the two normals of a pixel are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum NormalEncoding {
    /// Two octahedral codes of 8 + 8 bits, as in Far Cry 5.
    #[default]
    Octahedral,
    /// In the same 32 bits the triangle's plane 8 times finer, and the same code of the shading normal as what it adds to that: [`normal_pair`].
    PlaneFirst,
    /// Two points of the octahedron's square in f32: 128 bits, to tell what the others cost.
    Exact,
}

/// Why a text is not an encoding of normals.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{given}` is not an encoding of normals: give one of {}", NormalEncoding::ALL.map(NormalEncoding::name).join(", "))]
pub struct NotAnEncoding {
    given: String,
}

impl NormalEncoding {
    /// Every encoding, in the order of its code.
    pub const ALL: [NormalEncoding; 3] = [NormalEncoding::Octahedral, NormalEncoding::PlaneFirst, NormalEncoding::Exact];

    /// The encoding's number in shaders.
    pub const fn code(self) -> u32 {
        match self {
            NormalEncoding::Octahedral => 0,
            NormalEncoding::PlaneFirst => 1,
            NormalEncoding::Exact => 2,
        }
    }

    /// The name used in files and tables.
    pub const fn name(self) -> &'static str {
        match self {
            NormalEncoding::Octahedral => "octahedral",
            NormalEncoding::PlaneFirst => "plane-first",
            NormalEncoding::Exact => "exact",
        }
    }

    /// Format of the target.
    pub const fn format(self) -> wgpu::TextureFormat {
        match self {
            NormalEncoding::Octahedral | NormalEncoding::PlaneFirst => wgpu::TextureFormat::Rgba8Unorm,
            NormalEncoding::Exact => wgpu::TextureFormat::Rgba32Float,
        }
    }

    /// Bytes of a texel.
    pub const fn bytes(self) -> u32 {
        match self {
            NormalEncoding::Octahedral | NormalEncoding::PlaneFirst => 4,
            NormalEncoding::Exact => 16,
        }
    }

    /// Shading normal and normal of the triangle's plane in a texel of [`Self::bytes`] bytes, unit vectors: `frame_shading_normal`, `frame_plane`. The
    /// plane's may be the opposite of the triangle's.
    ///
    /// # Panics
    /// When the texel has another size.
    pub fn decode(self, texel: &[u8]) -> [[f64; 3]; 2] {
        let of_code = |code: [u32; 2]| octahedral::decode(octahedral::dequantise(code, 8));
        match self {
            NormalEncoding::Octahedral => {
                let [x, y, z, w]: [u8; 4] = texel.try_into().expect("4 bytes");
                [[x, y], [z, w]].map(|code| of_code(code.map(u32::from)))
            }
            NormalEncoding::PlaneFirst => {
                let pair = normal_pair::decode(u32::from_le_bytes(texel.try_into().expect("4 bytes")));
                [of_code(pair.shading), pair.plane]
            }
            NormalEncoding::Exact => {
                let [x, y, z, w]: [f32; 4] = bytemuck::pod_read_unaligned(texel);
                [[x, y], [z, w]].map(|e| octahedral::decode(e.map(f64::from)))
            }
        }
    }
}

impl fmt::Display for NormalEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for NormalEncoding {
    type Err = NotAnEncoding;

    fn from_str(text: &str) -> std::result::Result<Self, NotAnEncoding> {
        NormalEncoding::ALL.into_iter().find(|encoding| encoding.name() == text).ok_or_else(|| NotAnEncoding { given: text.to_owned() })
    }
}

/// The pass.
pub struct Geometry {
    shader: Shader,
    pipeline_layout: wgpu::PipelineLayout,
    has_holes: bool,
    /// Into normals of 32 bits.
    pipeline: wgpu::RenderPipeline,
    /// Into those of 128, made when a picture first wants them.
    exact: OnceLock<wgpu::RenderPipeline>,
    layout: wgpu::BindGroupLayout,
    /// By the logarithm of the stride: indices of a patch, and how many.
    indices: [(wgpu::Buffer, u32); STRIDES.len()],
}

/// Strides of a patch's vertices: of 17 along a side, 17, 9 or 5 are drawn.
pub const STRIDES: [u32; 3] = [1, 2, 4];

/// Stitching, without bindings.
pub const STITCH_WGSL: (&str, &str) = ("geometry/stitch.wgsl", include_str!("stitch.wgsl"));

/// The files of the stage's shader module.
pub fn files() -> Vec<(&'static str, &'static str)> {
    let mut files = shared::WGSL.to_vec();
    files.extend([FRAME_WGSL, terrain::WGSL, STITCH_WGSL, ("geometry/geometry.wgsl", include_str!("geometry.wgsl"))]);
    files
}

/// Indices of a patch's 16 x 16 quads over its 17 x 17 vertices, or of fewer and larger ones over every `stride`-th of those, counter-clockwise from
/// above, diagonals alternating.
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
    has_holes: bool,
    normals: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let overrides = [("HAS_HOLES", f64::from(u8::from(has_holes)))];
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
            targets: &[Some(wgpu::TextureFormat::R8Uint.into()), Some(normals.into())],
        }),
        multiview_mask: None,
        cache: None,
    })
}

impl Geometry {
    /// Compiles the pass.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout, terrain: &Terrain, has_holes: bool) -> Result<Geometry> {
        let shader = Shader::new(gpu, "geometry", &files())?;
        let layout = gpu.layout("patches", wgpu::ShaderStages::VERTEX, &[Binding::Storage]);
        let pipeline_layout = gpu.pipeline_layout("geometry", &[frame_layout, &terrain.layout, &layout]);
        let pipeline = pipeline(gpu, &shader, &pipeline_layout, has_holes, NormalEncoding::default().format());
        let indices = STRIDES.map(|stride| {
            let indices = patch_indices(stride);
            let count = u32::try_from(indices.len()).unwrap_or(0);
            (gpu.buffer_with("patch indices", wgpu::BufferUsages::INDEX, cast_slice(&indices)), count)
        });
        Ok(Geometry { shader, pipeline_layout, has_holes, pipeline, exact: OnceLock::new(), layout, indices })
    }

    /// The pipeline for normals of a format.
    fn pipeline(&self, gpu: &Gpu, normals: wgpu::TextureFormat) -> &wgpu::RenderPipeline {
        if normals == NormalEncoding::default().format() {
            return &self.pipeline;
        }
        self.exact.get_or_init(|| pipeline(gpu, &self.shader, &self.pipeline_layout, self.has_holes, normals))
    }

    /// Records the pass. `stride`: one of [`STRIDES`].
    #[allow(clippy::too_many_arguments, reason = "a stage names all it reads and writes")]
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        groups: [&wgpu::BindGroup; 2],
        patches: &[Patch],
        stride: u32,
        targets: &Targets,
    ) {
        let list = gpu.buffer_with("patches", wgpu::BufferUsages::STORAGE, if patches.is_empty() { &[0; 32] } else { cast_slice(patches) });
        let group = gpu.group("patches", &self.layout, &[list.as_entire_binding()]);
        let clear = wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store };
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("geometry"),
            color_attachments: &[
                Some(wgpu::RenderPassColorAttachment { view: &view(&targets.mask), depth_slice: None, resolve_target: None, ops: clear }),
                Some(wgpu::RenderPassColorAttachment {
                    view: &view(&targets.normals),
                    depth_slice: None,
                    resolve_target: None,
                    ops: clear,
                }),
            ],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: &view(&targets.depth_stencil),
                depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0.0), store: wgpu::StoreOp::Store }),
                stencil_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(0), store: wgpu::StoreOp::Store }),
            }),
            timestamp_writes: timer.render("geometry"),
            ..Default::default()
        });
        pass.set_pipeline(self.pipeline(gpu, targets.normals.format()));
        pass.set_bind_group(0, groups[0], &[]);
        pass.set_bind_group(1, groups[1], &[]);
        pass.set_bind_group(2, &group, &[]);
        let (indices, count) = &self.indices[stride.ilog2() as usize];
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.set_stencil_reference(1);
        pass.draw_indexed(0..*count, 0, 0..u32::try_from(patches.len()).unwrap_or(0));
    }
}

//! Geometry pass: every visible patch in one draw; depth, stencil, classification mask and two octahedral normals out.
//!
//! Reads the patch list, height, normal and albedo (holes) atlases. Writes depth (reversed f32, `near / distance`), stencil (1 = terrain),
//! mask (R8, one bit a flavour) and normals (RGBA8: shading normal, triangle normal, 2 x 8 bits each). One indexed draw, an instance a patch.
//! Source: Moore, GDC 2018, "Vertex Shading", "LOD Mesh Stitching", "Terrain Geometry Pass"; rulings 7, 8, 11.

use bytemuck::cast_slice;

use crate::culling::{PATCH_QUADS, Patch};
use crate::error::Result;
use crate::frame::FRAME_WGSL;
use crate::gpu::bindings::{Binding, view};
use crate::gpu::{Gpu, Shader, Timer, constants};
use crate::shared;
use crate::terrain::{self, Terrain};
use crate::world::payload::diagonal_rises;

pub mod reference;

/// What the pass makes; all of the picture's size.
pub struct Targets {
    /// Depth and stencil.
    pub depth_stencil: wgpu::Texture,
    /// Classification mask, R8Uint.
    pub mask: wgpu::Texture,
    /// Shading and triangle normal, see [`normal_format`].
    pub normals: wgpu::Texture,
}

/// Format of depth and stencil.
pub const DEPTH_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Depth32FloatStencil8;

impl Targets {
    /// Targets of a size in pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2], exact_normals: bool) -> Targets {
        Targets {
            depth_stencil: gpu.target("depth and stencil", size, DEPTH_FORMAT),
            mask: gpu.target("classification mask", size, wgpu::TextureFormat::R8Uint),
            normals: gpu.target("normals", size, normal_format(exact_normals)),
        }
    }
}

/// Format of the two normals: octahedral, 2 x 8 bits each, or in f32 where a measurement wants them exact.
pub const fn normal_format(exact: bool) -> wgpu::TextureFormat {
    if exact { wgpu::TextureFormat::Rgba32Float } else { wgpu::TextureFormat::Rgba8Unorm }
}

/// The pass.
pub struct Geometry {
    pipeline: wgpu::RenderPipeline,
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

impl Geometry {
    /// Compiles the pass.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(
        gpu: &Gpu,
        frame_layout: &wgpu::BindGroupLayout,
        terrain: &Terrain,
        has_holes: bool,
        exact_normals: bool,
    ) -> Result<Geometry> {
        let shader = Shader::new(gpu, "geometry", &files())?;
        let layout = gpu.layout("patches", wgpu::ShaderStages::VERTEX, &[Binding::Storage]);
        let overrides = [("HAS_HOLES", f64::from(u8::from(has_holes)))];
        let stencil = wgpu::StencilFaceState { pass_op: wgpu::StencilOperation::Replace, ..Default::default() };
        let pipeline = gpu.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("geometry"),
            layout: Some(&gpu.pipeline_layout("geometry", &[frame_layout, &terrain.layout, &layout])),
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
                targets: &[Some(wgpu::TextureFormat::R8Uint.into()), Some(normal_format(exact_normals).into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let indices = STRIDES.map(|stride| {
            let indices = patch_indices(stride);
            let count = u32::try_from(indices.len()).unwrap_or(0);
            (gpu.buffer_with("patch indices", wgpu::BufferUsages::INDEX, cast_slice(&indices)), count)
        });
        Ok(Geometry { pipeline, layout, indices })
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
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, groups[0], &[]);
        pass.set_bind_group(1, groups[1], &[]);
        pass.set_bind_group(2, &group, &[]);
        let (indices, count) = &self.indices[stride.ilog2() as usize];
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.set_stencil_reference(1);
        pass.draw_indexed(0..*count, 0, 0..u32::try_from(patches.len()).unwrap_or(0));
    }
}

//! Geometry pass: draws the visible patches in phases, each with one indirect draw, into depth, stencil, classification mask and two normals.
//!
//! Reads the patch list and its order, the edge of the data, and the atlases of height, normal and albedo (holes). Writes depth (reversed f32,
//! `near / distance`), stencil (1 = terrain), mask (R8, one bit per flavour) and normals ([`NormalEncoding`]: shading normal and triangle's plane).
//! Each patch is one instance. Source: Moore, GDC 2018, "Vertex Shading", "LOD Mesh Stitching", "Terrain Geometry Pass"; rulings 7, 8 and 11 in
//! `ARCHITECTURE.md`.

use std::ops::Range;
use std::sync::OnceLock;

use bytemuck::cast_slice;

use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::culling::{Culled, PATCH_QUADS};
use crate::gpu::bindings::{Binding, view};
use crate::gpu::uses::{PassUse, TargetUse};
use crate::gpu::{CLEAR, Gpu, Recording, Shader, ShaderModule, constants, read_buffer};
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
        let layout = gpu.layout("patches", wgpu::ShaderStages::VERTEX, &[Binding::Storage; 2]);
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

    /// Uploads the patches to draw. `culled`: the patches and their boxes. `occlusion`: whether they are drawn in phases, between which hidden patches
    /// are removed. `stride`: one of [`STRIDES`].
    pub fn list(&self, gpu: &Gpu, culled: &Culled, occlusion: bool, stride: u32) -> PatchList {
        let count = u32::try_from(culled.patches.len()).unwrap_or(0);
        let phases = phases(count, if occlusion { &PHASE_ENDS } else { &[] });
        let (_, indices) = self.indices[stride.ilog2() as usize];
        // Occlusion culling writes the numbers of instances of all phases but the first.
        let arguments: Vec<[u32; ARGUMENT_WORDS as usize]> =
            phases.iter().map(|phase| [indices, if phase.start == 0 { phase.end } else { 0 }, 0, 0, 0]).collect();
        let order: Vec<u32> = (0..count).collect();
        let storage = wgpu::BufferUsages::STORAGE;
        PatchList {
            // A binding cannot be smaller than one element.
            patches: gpu.buffer_with("patches", storage, if count == 0 { &[0; 32] } else { cast_slice(&culled.patches) }),
            boxes: gpu.buffer_with("boxes of patches", storage, cast_slice(&culled.boxes)),
            shown: gpu.buffer("shown patches", storage, u64::from(count.max(1)) * 4),
            order: gpu.buffer_with("order of patches", storage, cast_slice(&order)),
            arguments: gpu.buffer_with(
                "patch draws",
                storage | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_SRC,
                cast_slice(&arguments),
            ),
            phases,
            stride,
        }
    }

    /// Records the draw of a phase. The first phase clears the targets.
    pub fn encode(&self, rec: &mut Recording<'_>, list: &PatchList, phase: usize, targets: &Targets) {
        let gpu = rec.gpu;
        let range = &list.phases[phase];
        let order = wgpu::BufferBinding { buffer: &list.order, offset: u64::from(range.start) * 4, size: None };
        let group = gpu.group("patches", &self.layout, &[list.patches.as_entire_binding(), wgpu::BindingResource::Buffer(order)]);
        let depth_stencil = view(&targets.depth_stencil);
        let is_first = phase == 0;
        let depth_stencil = wgpu::RenderPassDepthStencilAttachment {
            view: &depth_stencil,
            depth_ops: Some(wgpu::Operations {
                load: if is_first { wgpu::LoadOp::Clear(0.0) } else { wgpu::LoadOp::Load },
                store: wgpu::StoreOp::Store,
            }),
            stencil_ops: Some(wgpu::Operations {
                load: if is_first { wgpu::LoadOp::Clear(0) } else { wgpu::LoadOp::Load },
                store: wgpu::StoreOp::Store,
            }),
        };
        let colours = [&view(&targets.mask), &view(&targets.normals)];
        let load = if is_first { CLEAR } else { wgpu::LoadOp::Load };
        let mut pass = rec.render("geometry", &colours, load, Some(depth_stencil), 2, &[&group]);
        pass.set_pipeline(self.pipeline(gpu, targets.normals.format()));
        let (indices, _) = &self.indices[list.stride.ilog2() as usize];
        pass.set_index_buffer(indices.slice(..), wgpu::IndexFormat::Uint16);
        pass.set_stencil_reference(1);
        pass.draw_indexed_indirect(&list.arguments, phase as u64 * u64::from(ARGUMENT_WORDS) * 4);
    }
}

/// Number of words of the arguments of an indirect draw with indices.
pub const ARGUMENT_WORDS: u32 = 5;

/// The phases begin at multiples of this number of patches, because a binding must begin at a multiple of 256 bytes.
const PHASE_STEP: u32 = 64;

/// The ends of the phases but the last, as shares of the patches. With four phases (0.1, 0.25, 0.5), more patches are culled, but software Vulkan then
/// takes longer with the camera `ground`, because each phase costs a pyramid and loads the targets again.
const PHASE_ENDS: [f64; 1] = [0.25];

/// Divides patches into phases. `ends`: the ends of the phases but the last, as shares of the patches. There is always a first phase, which may have
/// no patch; each other phase has at least [`PHASE_STEP`] patches.
fn phases(count: u32, ends: &[f64]) -> Vec<Range<u32>> {
    let mut phases = Vec::new();
    let mut start = 0;
    for share in ends {
        let end = ((f64::from(count) * share) as u32).next_multiple_of(PHASE_STEP).min(count);
        if end > start && end + PHASE_STEP <= count {
            phases.push(start..end);
            start = end;
        }
    }
    phases.push(start..count);
    phases
}

/// The patches of a frame on the device.
pub struct PatchList {
    patches: wgpu::Buffer,
    /// The boxes of the patches ([`PatchBox`](crate::culling::PatchBox)).
    pub boxes: wgpu::Buffer,
    /// For each patch, whether occlusion culling lets it be drawn.
    pub shown: wgpu::Buffer,
    /// The indices of the patches in the order of drawing. The entries of a phase begin at the start of its range.
    pub order: wgpu::Buffer,
    /// The indirect draw of each phase, [`ARGUMENT_WORDS`] words each.
    pub arguments: wgpu::Buffer,
    /// The patches of each phase, as ranges of indices.
    pub phases: Vec<Range<u32>>,
    stride: u32,
}

impl PatchList {
    /// Returns the number of patches that were drawn. The commands of the last phase must have been submitted before.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read_drawn(&self, gpu: &Gpu) -> Result<u32> {
        if let [only] = self.phases.as_slice() {
            return Ok(only.end);
        }
        let words: Vec<u32> =
            bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.arguments, self.phases.len() as u64 * u64::from(ARGUMENT_WORDS) * 4)?);
        Ok(words.chunks_exact(ARGUMENT_WORDS as usize).map(|arguments| arguments[1]).sum())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_hold_every_patch_once_and_begin_at_whole_steps() {
        for count in [0, 1, 63, 64, 65, 127, 128, 640, 1000, 10_000, 32_768] {
            let phases = phases(count, &PHASE_ENDS);
            assert_eq!((phases[0].start, phases[phases.len() - 1].end), (0, count));
            assert!(phases.windows(2).all(|pair| pair[0].end == pair[1].start && pair[1].start % PHASE_STEP == 0), "{phases:?}");
            assert!(phases.len() == 1 || phases.iter().all(|phase| phase.len() >= PHASE_STEP as usize), "{phases:?}");
        }
        assert_eq!(phases(1000, &PHASE_ENDS), [0..256, 256..1000]);
        assert_eq!(phases(1000, &[0.1, 0.5]), [0..128, 128..512, 512..1000]);
        assert_eq!(phases(1000, &[]).len(), 1);
    }
}

//! Geometry pass: draws the visible patches in phases, between which occlusion culling drops hidden patches. Each phase has one indirect draw per
//! vertex stride. Writes depth, stencil, classification mask and two normals.
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
use crate::culling::{Culled, LOG2_LARGEST_STRIDE, PATCH_QUADS, Patch, PatchBox};
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
pub mod surface;

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
    indices: Vec<(wgpu::Buffer, u32)>,
}

/// Features of the ground of a scene for which the pipeline needs additional code.
#[derive(Clone, Copy)]
struct Ground {
    has_holes: bool,
    has_edge: bool,
}

/// Accepted values of the setting `frame.vertex_stride`, the least vertex stride of all patches. With a stride of n, every n-th vertex along the side
/// of a patch is drawn.
pub const STRIDES: [u32; 3] = [1, 2, 4];

/// WGSL functions for stitching, which need no bindings.
pub static STITCH_WGSL: Wgsl = Wgsl::new("geometry/stitch.wgsl", include_str!("stitch.wgsl"), &[]);

static WGSL: Wgsl = Wgsl::new(
    "geometry/geometry.wgsl",
    include_str!("geometry.wgsl"),
    &[&terrain::WGSL, &view::WGSL, &STITCH_WGSL, &shared::FLAVOUR_WEIGHTS],
)
.with(&[("GEOMETRY_NODE_QUADS", Constant::U32(NODE_QUADS as u32)), ("GEOMETRY_PATCH_QUADS", Constant::U32(PATCH_QUADS))]);

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
        let indices = (0..=LOG2_LARGEST_STRIDE).map(|log2_stride| {
            let indices = patch_indices(1 << log2_stride);
            let count = u32::try_from(indices.len()).unwrap_or(0);
            (gpu.buffer_with("patch indices", wgpu::BufferUsages::INDEX, cast_slice(&indices)), count)
        });
        let indices = indices.collect();
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

    /// Uploads the patches to draw. `culled`: the patches and their boxes. `occlusion`: whether the patches are drawn in phases, between which hidden
    /// patches are removed.
    pub fn list(&self, gpu: &Gpu, culled: &Culled, occlusion: bool) -> PatchList {
        let Batches { batches, patches, phases } = Batches::of(&culled.log2_strides, if occlusion { &PHASE_ENDS } else { &[] });
        // Occlusion culling writes the numbers of instances of all phases but the first.
        let arguments: Vec<[u32; ARGUMENT_WORDS as usize]> =
            batches.iter().map(|batch| [self.indices_of(batch).1, if batch.phase == 0 { batch.count } else { 0 }, 0, 0, 0]).collect();
        // A binding cannot be smaller than one element.
        let mut order = vec![0; batches.last().map_or(1, |batch| batch.order + batch.count) as usize];
        for batch in &batches {
            let range = batch.first..batch.first + batch.count;
            order[batch.order as usize..][..batch.count as usize].copy_from_slice(&range.collect::<Vec<u32>>());
        }
        let in_order = |index: &usize| (culled.patches[*index], culled.boxes[*index]);
        let (uploaded, boxes): (Vec<Patch>, Vec<PatchBox>) = patches.iter().map(in_order).unzip();
        let storage = wgpu::BufferUsages::STORAGE;
        let with = |label, usage, bytes: &[u8]| gpu.buffer_with(label, usage, if bytes.is_empty() { &[0; 32] } else { bytes });
        PatchList {
            patches: with("patches", storage, cast_slice(&uploaded)),
            boxes: with("boxes of patches", storage, cast_slice(&boxes)),
            shown: gpu.buffer("shown patches", storage, patches.len().max(1) as u64 * 4),
            order: with("order of patches", storage, cast_slice(&order)),
            arguments: with("patch draws", storage | wgpu::BufferUsages::INDIRECT | wgpu::BufferUsages::COPY_SRC, cast_slice(&arguments)),
            batches,
            phases,
        }
    }

    /// The index buffer of the patches of a batch, and its number of indices.
    fn indices_of(&self, batch: &Batch) -> &(wgpu::Buffer, u32) {
        &self.indices[batch.log2_stride as usize]
    }

    /// Records the draws of a phase, one for each batch. The first phase clears the targets.
    pub fn encode(&self, rec: &mut Recording<'_>, list: &PatchList, phase: u32, targets: &Targets) {
        let gpu = rec.gpu;
        let group = |batch: &Batch| {
            let order = wgpu::BufferBinding { buffer: &list.order, offset: u64::from(batch.order) * 4, size: None };
            gpu.group("patches", &self.layout, &[list.patches.as_entire_binding(), wgpu::BindingResource::Buffer(order)])
        };
        let batches: Vec<_> = list.of_phase(phase).map(|(index, batch)| (index, batch, group(batch))).collect();
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
        let mut pass = rec.render("geometry", &colours, load, Some(depth_stencil), 2, &[]);
        pass.set_pipeline(self.pipeline(gpu, targets.normals.format()));
        pass.set_stencil_reference(1);
        for (index, batch, group) in &batches {
            pass.set_bind_group(2, group, &[]);
            pass.set_index_buffer(self.indices_of(batch).0.slice(..), wgpu::IndexFormat::Uint16);
            pass.draw_indexed_indirect(&list.arguments, *index as u64 * u64::from(ARGUMENT_WORDS) * 4);
        }
    }
}

/// Number of words of the arguments of an indirect draw with indices.
pub const ARGUMENT_WORDS: u32 = 5;

/// The least number of patches of the last phase, if there are several phases.
const LEAST_OF_PHASE: u32 = 64;

/// In [`PatchList::order`], each batch begins at a multiple of this number of elements, because devices may require that a binding begins at a
/// multiple of 256 bytes.
const ORDER_STEP: u32 = 64;

/// The ends of all phases except the last, as shares of the patches. With four phases (0.1, 0.25, 0.5), more patches are culled, but software Vulkan
/// then takes longer with the camera `ground`, because each further phase builds a depth pyramid and loads the targets again.
const PHASE_ENDS: [f64; 1] = [0.25];

/// Divides `count` patches into phases, given as ranges of patch indices. `ends`: the wanted ends of all phases except the last, as shares of
/// `count`. An end is skipped if fewer than [`LEAST_OF_PHASE`] patches would follow it. There is always at least one phase; without patches, it is
/// empty.
fn phases(count: u32, ends: &[f64]) -> Vec<Range<u32>> {
    let mut phases = Vec::new();
    let mut start = 0;
    for share in ends {
        let end = (f64::from(count) * share).ceil() as u32;
        if end > start && end + LEAST_OF_PHASE <= count {
            phases.push(start..end);
            start = end;
        }
    }
    phases.push(start..count);
    phases
}

/// Patches of one phase with the same vertex stride, which one indirect draw draws.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Index of the phase.
    pub phase: u32,
    /// Log2 of the vertex stride.
    pub log2_stride: u32,
    /// Index of the first patch in the uploaded list, in which the patches of a batch follow each other.
    pub first: u32,
    /// Number of patches.
    pub count: u32,
    /// Index in [`PatchList::order`] at which the patches of the batch begin.
    pub order: u32,
}

/// The batches of a frame.
struct Batches {
    batches: Vec<Batch>,
    /// For each patch in the order of the batches, its index in the list from which the batches were made.
    patches: Vec<usize>,
    /// Number of phases, at least 1.
    phases: u32,
}

impl Batches {
    /// Divides patches into phases and batches. `log2_strides`: log2 of the vertex strides of the patches, in the order in which the patches are
    /// given. In a batch, this order is kept. `ends`: as in [`phases`].
    fn of(log2_strides: &[u32], ends: &[f64]) -> Batches {
        let mut out = Batches { batches: Vec::new(), patches: Vec::new(), phases: 0 };
        let mut order = 0u32;
        for range in phases(u32::try_from(log2_strides.len()).unwrap_or(u32::MAX), ends) {
            for log2_stride in 0..=LOG2_LARGEST_STRIDE {
                let first = u32::try_from(out.patches.len()).unwrap_or(u32::MAX);
                out.patches.extend((range.start as usize..range.end as usize).filter(|&patch| log2_strides[patch] == log2_stride));
                let count = u32::try_from(out.patches.len()).unwrap_or(u32::MAX) - first;
                if count > 0 {
                    order = order.next_multiple_of(ORDER_STEP);
                    out.batches.push(Batch { phase: out.phases, log2_stride, first, count, order });
                    order += count;
                }
            }
            out.phases += 1;
        }
        out
    }
}

/// The patches of a frame on the device.
pub struct PatchList {
    patches: wgpu::Buffer,
    /// The boxes of the patches ([`PatchBox`]).
    pub boxes: wgpu::Buffer,
    /// For each patch, whether occlusion culling found it visible. The entries of the first phase are not used, because all its patches are drawn.
    pub shown: wgpu::Buffer,
    /// The indices of the patches in the order of drawing, see [`Batch::order`].
    pub order: wgpu::Buffer,
    /// The indirect draw of each batch, [`ARGUMENT_WORDS`] words each.
    pub arguments: wgpu::Buffer,
    batches: Vec<Batch>,
    /// Number of phases, at least 1.
    pub phases: u32,
}

impl PatchList {
    /// The batches of a phase, with their indices.
    pub fn of_phase(&self, phase: u32) -> impl Iterator<Item = (usize, &Batch)> {
        self.batches.iter().enumerate().filter(move |(_, batch)| batch.phase == phase)
    }

    /// Returns the numbers of patches and of triangles that were drawn. The commands of the last phase must have been submitted before.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read_drawn(&self, gpu: &Gpu) -> Result<[u32; 2]> {
        let words: Vec<u32> =
            bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.arguments, self.batches.len() as u64 * u64::from(ARGUMENT_WORDS) * 4)?);
        let drawn = words.chunks_exact(ARGUMENT_WORDS as usize).map(|arguments| [arguments[1], arguments[0] / 3 * arguments[1]]);
        Ok(drawn.fold([0, 0], |sum, of| [sum[0] + of[0], sum[1] + of[1]]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phases_hold_every_patch_once() {
        for count in [0, 1, 63, 64, 65, 127, 128, 640, 1000, 10_000, 32_768] {
            let phases = phases(count, &PHASE_ENDS);
            assert_eq!((phases[0].start, phases[phases.len() - 1].end), (0, count));
            assert!(phases.windows(2).all(|pair| pair[0].end == pair[1].start), "{phases:?}");
            assert!(phases[1..].iter().all(|phase| phase.len() >= LEAST_OF_PHASE as usize), "{phases:?}");
        }
        assert_eq!(phases(1000, &PHASE_ENDS), [0..250, 250..1000]);
        assert_eq!(phases(1000, &[0.1, 0.5]), [0..100, 100..500, 500..1000]);
        assert_eq!(phases(1000, &[]).len(), 1);
    }

    #[test]
    fn batches_hold_every_patch_once_and_keep_its_order() {
        for count in [0u32, 1, 100, 1000] {
            let log2_strides: Vec<u32> = (0..count).map(|patch| patch * patch % 7 % (LOG2_LARGEST_STRIDE + 1)).collect();
            let Batches { batches, patches, phases } = Batches::of(&log2_strides, &PHASE_ENDS);
            assert_eq!(phases, if count < 100 { 1 } else { 2 });
            let mut seen = patches.clone();
            seen.sort_unstable();
            assert_eq!(seen, (0..count as usize).collect::<Vec<_>>());
            assert_eq!(batches.iter().map(|batch| batch.count).sum::<u32>(), count);
            assert!(batches.windows(2).all(|pair| pair[0].first + pair[0].count == pair[1].first));
            assert!(
                batches.windows(2).all(|pair| pair[0].order + pair[0].count <= pair[1].order && pair[1].order.is_multiple_of(ORDER_STEP))
            );
            for batch in &batches {
                let own = &patches[batch.first as usize..][..batch.count as usize];
                assert!(own.is_sorted() && own.iter().all(|&patch| log2_strides[patch] == batch.log2_stride));
                assert!(own.iter().all(|&patch| (patch < 250) == (batch.phase == 0)) || count < 1000);
            }
        }
    }
}

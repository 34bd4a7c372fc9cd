//! Occlusion culling: drops the patches that are hidden by what earlier phases of the frame drew.
//!
//! The geometry pass draws the patches in phases, the nearest patches first ([`crate::geometry::PatchList`]). Before each phase but the first, this
//! stage makes a depth pyramid from what was drawn, and tests the boxes of the phase's patches against it. So the result does not depend on earlier
//! frames.
//! Reads depth, the boxes of the patches, and the camera. Writes the order of drawing and the indirect draws of a phase.
//! Dispatch: one invocation per 8 x 8 pixels (and per 8 x 8 texels of every third level), then one workgroup for each batch of the phase.
//! Limits: the test of a batch runs in one workgroup, so it uses a small part of a large GPU.
//! Source: Moore, GDC 2018, "GPU Culling", "Occlusion Buffer Culling"; Haar and Aaltonen, SIGGRAPH 2015, who test in two phases.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};

use crate::base::error::Result;
use crate::base::wgsl::Wgsl;
use crate::geometry::{self, ARGUMENT_WORDS, Batch, PatchList};
use crate::gpu::bindings::{Binding, aspect};
use crate::gpu::uses::PassUse;
use crate::gpu::{Recording, ShaderModule};
use crate::shared;
use crate::shared::culling::level_size;
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::view;

pub mod reference;

/// The number of levels that one dispatch makes.
const LEVELS_PER_DISPATCH: u32 = 3;

/// The parameters of a batch; the layout matches `OcclusionBatch` in `cull.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct OcclusionBatch {
    pub first: u32,
    pub count: u32,
    pub order: u32,
    pub instances: u32,
}

static PYRAMID_WGSL: Wgsl = Wgsl::new("occlusion/pyramid.wgsl", include_str!("pyramid.wgsl"), &[&shared::CULLING]);
static REDUCE_WGSL: Wgsl = Wgsl::new("occlusion/reduce.wgsl", include_str!("reduce.wgsl"), &[&view::WGSL, &shared::CULLING, &PYRAMID_WGSL]);
static CULL_WGSL: Wgsl = Wgsl::new("occlusion/cull.wgsl", include_str!("cull.wgsl"), &[&view::WGSL, &shared::CULLING, &PYRAMID_WGSL]);

/// The shader module that makes the depth pyramid.
pub static REDUCE_MODULE: ShaderModule = ShaderModule::new("depth pyramid", &[&REDUCE_WGSL]);
/// The shader module that tests patches.
pub static CULL_MODULE: ShaderModule = ShaderModule::new("occlusion culling", &[&CULL_WGSL]);

/// The depth pyramid of a picture.
pub struct Pyramid {
    /// Reversed depths, level by level from level 1, row by row.
    texels: wgpu::Buffer,
    /// For each dispatch that makes levels, the level that it reads.
    from: Vec<wgpu::Buffer>,
    size: [u32; 2],
}

/// Number of levels of the pyramid of a picture, from level 1 to a level with one texel. It is rounded up to a multiple of the levels that one
/// dispatch makes.
fn levels(size: [u32; 2]) -> u32 {
    let last = (1..).find(|&level| level_size(size, level) == [1, 1]).unwrap_or(1);
    last.next_multiple_of(LEVELS_PER_DISPATCH)
}

/// The pipelines of the stage, and the layouts of their bind groups.
pub struct Occlusion {
    reduce: wgpu::ComputePipeline,
    reduce_layout: wgpu::BindGroupLayout,
    cull: wgpu::ComputePipeline,
    cull_layout: wgpu::BindGroupLayout,
}

impl Stage for Occlusion {
    const DECLARATION: Declaration = Declaration {
        passes: |_| vec![PassUse::new("occlusion", 2, "drops patches hidden by nearer ones")],
        name: "occlusion",
        about: "Reads depth and the boxes of patches; writes the patches to draw in the next phase of the geometry pass",
        modules: &[&REDUCE_MODULE, &CULL_MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = Pyramid;

    fn targets(canvas: Canvas<'_>) -> Pyramid {
        let Canvas { gpu, size, .. } = canvas;
        let count = |level| level_size(size, level).iter().map(|&n| u64::from(n)).product::<u64>();
        let texels: u64 = (1..=levels(size)).map(count).sum();
        let from = (0..levels(size)).step_by(LEVELS_PER_DISPATCH as usize);
        Pyramid {
            texels: gpu.buffer("depth pyramid", wgpu::BufferUsages::STORAGE, texels * 4),
            from: from.map(|level| gpu.buffer_with("level of the pyramid", wgpu::BufferUsages::STORAGE, bytes_of(&level))).collect(),
            size,
        }
    }

    fn build(build: Build<'_>) -> Result<Occlusion> {
        let Build { gpu, frame, .. } = build;
        let stage = wgpu::ShaderStages::COMPUTE;
        let (read, written) = (Binding::Storage, Binding::StorageWritten);
        let reduce_layout = gpu.layout("depth pyramid", stage, &[Binding::Depth, read, written]);
        let cull_layout = gpu.layout("occlusion", stage, &[read, read, read, written, written, written]);
        let pipeline = |label, module: &ShaderModule, layout, entry_point| -> Result<wgpu::ComputePipeline> {
            let shader = module.compile(gpu)?;
            Ok(gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(label),
                layout: Some(&gpu.pipeline_layout(label, &[frame, layout])),
                module: &shader.module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            }))
        };
        let reduce = pipeline("depth pyramid", &REDUCE_MODULE, &reduce_layout, "occlusion_reduce")?;
        let cull = pipeline("occlusion", &CULL_MODULE, &cull_layout, "occlusion_cull")?;
        Ok(Occlusion { reduce, reduce_layout, cull, cull_layout })
    }
}

impl Occlusion {
    /// Records the passes that make the depth pyramid of what was drawn so far, and that test the patches of a phase against it.
    pub fn encode(&self, rec: &mut Recording<'_>, targets: &geometry::Targets, pyramid: &Pyramid, list: &PatchList, phase: u32) {
        let gpu = rec.gpu;
        let depth = aspect(&targets.depth_stencil, wgpu::TextureAspect::DepthOnly);
        let batch = |(index, &Batch { first, count, order, .. }): (usize, &Batch)| OcclusionBatch {
            first,
            count,
            order,
            instances: u32::try_from(index).unwrap_or(0) * ARGUMENT_WORDS + 1,
        };
        let batches: Vec<OcclusionBatch> = list.of_phase(phase).map(batch).collect();
        let parameters = gpu.buffer_with("batches", wgpu::BufferUsages::STORAGE, cast_slice(&batches));
        let buffers = [&parameters, &list.boxes, &pyramid.texels, &list.shown, &list.order, &list.arguments];
        let tested = gpu.group("occlusion", &self.cull_layout, &buffers.map(wgpu::Buffer::as_entire_binding));
        let made: Vec<_> = pyramid
            .from
            .iter()
            .map(|from| {
                let resources = [wgpu::BindingResource::TextureView(&depth), from.as_entire_binding(), pyramid.texels.as_entire_binding()];
                gpu.group("depth pyramid", &self.reduce_layout, &resources)
            })
            .collect();
        let mut pass = rec.compute("occlusion", &self.reduce, 1, &[]);
        for (level, group) in (1..).map(|dispatch| dispatch * LEVELS_PER_DISPATCH).zip(&made) {
            pass.set_bind_group(1, group, &[]);
            let [x, y] = level_size(pyramid.size, level).map(|n| n.div_ceil(8));
            pass.dispatch_workgroups(x, y, 1);
        }
        pass.set_pipeline(&self.cull);
        pass.set_bind_group(1, &tested, &[]);
        pass.dispatch_workgroups(u32::try_from(batches.len()).unwrap_or(0), 1, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_level_of_a_pyramid_has_one_texel() {
        assert_eq!([[1, 1], [2, 2], [9, 3], [480, 270], [16_384, 1]].map(levels), [3, 3, 6, 9, 15]);
        assert!([[1, 1], [9, 3], [480, 270]].into_iter().all(|size| level_size(size, levels(size)) == [1, 1]));
    }
}

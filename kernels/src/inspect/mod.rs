//! Inspection: writes the numbers that shading derives from a pixel, namely position, derivatives, splat texels and their weights.
//!
//! Reads depth, normals, splat map and detail textures. Writes one [`Inspected`] per pixel. Dispatched only if one of these numbers is
//! requested.

use bytemuck::{Pod, Zeroable};

use crate::base::error::Result;
use crate::base::wgsl::Wgsl;
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, aspect, view};
use crate::gpu::{Gpu, ShaderModule, read_buffer};
use crate::shared;
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::terrain;
use crate::view;

/// The values of one pixel; the layout matches `Inspected` in `inspect.wgsl`. All fields are 0 if the pixel has no terrain.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Inspected {
    /// Position, metres: x and y from the south-west corner of the camera's sector, z is the elevation.
    pub position: [f32; 3],
    /// Atlas slot of the finest loaded node at the position.
    pub slot: u32,
    /// Change of the position from this pixel to the next pixel on the right, on the plane of this pixel's triangle, metres.
    pub ddx: [f32; 3],
    /// Column x and row y, in the splat map of the node, of the south-western of the four splat texels around the pixel: x | y << 16.
    pub corner: u32,
    /// Change of the position from this pixel to the next pixel below, on the plane of this pixel's triangle, metres.
    pub ddy: [f32; 3],
    /// Axis (x, y, z: 0, 1, 2) of the projection with the largest weight.
    pub plane: u32,
    /// Palette indices of the four splat texels: south-west, south-east, north-west, north-east.
    pub splat: [u32; 4],
    /// Bilinear weights of the four splat texels.
    pub bilinear: [f32; 4],
    /// Weights of the four splat texels after the height blend, which uses the heights of their materials in the projection `plane`.
    pub blended: [f32; 4],
}

/// Largest number of picture rows that one dispatch covers.
const BAND: u32 = 64;

/// The inspection pass.
pub struct Inspect {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

static WGSL: Wgsl = Wgsl::new(
    "inspect/inspect.wgsl",
    include_str!("inspect.wgsl"),
    &[&view::WGSL, &terrain::WGSL, &terrain::FOOTPRINT_WGSL, &shared::SPLAT_BLEND],
);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("inspect", &[&WGSL]);

impl Stage for Inspect {
    const DECLARATION: Declaration = Declaration {
        name: "inspect",
        about: "Reads depth, normals and terrain; writes position, derivatives and splat texels of each pixel, on request",
        modules: &[&MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = ();

    fn targets(_: Canvas<'_>) {}

    fn build(build: Build<'_>) -> Result<Inspect> {
        let Build { gpu, frame: frame_layout, terrain, .. } = build;
        let shader = MODULE.compile(gpu)?;
        let layout = gpu.layout(
            "inspect",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::Depth, Binding::TextureLoaded(FLAT), Binding::StorageWritten, Binding::Uniform],
        );
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("inspect"),
            layout: Some(&gpu.pipeline_layout("inspect", &[frame_layout, &terrain.layout, &layout])),
            module: &shader.module,
            entry_point: Some("inspect_main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Inspect { pipeline, layout })
    }
}

impl Inspect {
    /// Runs the pass and reads its results back, row by row from the top. `groups`: the uniforms of the frame, and the terrain.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn run(&self, gpu: &Gpu, groups: [&wgpu::BindGroup; 2], targets: &geometry::Targets) -> Result<Vec<Inspected>> {
        let (width, height) = (targets.mask.width(), targets.mask.height());
        let row_bytes = u64::from(width) * size_of::<Inspected>() as u64;
        // The picture is processed in bands of rows, so that the buffer is small and does not exceed the device's limit for a storage buffer binding.
        let rows = u32::try_from(gpu.device.limits().max_storage_buffer_binding_size / row_bytes).unwrap_or(BAND).clamp(1, BAND);
        let out = gpu.buffer("inspected", wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC, u64::from(rows) * row_bytes);
        let views = [aspect(&targets.depth_stencil, wgpu::TextureAspect::DepthOnly), view(&targets.normals)];
        let mut pixels = Vec::new();
        for first in (0..height).step_by(rows as usize) {
            let end = (first + rows).min(height);
            let band = gpu.buffer_with("band", wgpu::BufferUsages::UNIFORM, bytemuck::bytes_of(&[first, end, 0, 0]));
            let group = gpu.group(
                "inspect",
                &self.layout,
                &[
                    wgpu::BindingResource::TextureView(&views[0]),
                    wgpu::BindingResource::TextureView(&views[1]),
                    out.as_entire_binding(),
                    band.as_entire_binding(),
                ],
            );
            let mut encoder = gpu.encoder("inspect");
            {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("inspect"), timestamp_writes: None });
                pass.set_pipeline(&self.pipeline);
                pass.set_bind_group(0, groups[0], &[]);
                pass.set_bind_group(1, groups[1], &[]);
                pass.set_bind_group(2, &group, &[]);
                pass.dispatch_workgroups(width.div_ceil(8), (end - first).div_ceil(8), 1);
            }
            gpu.queue.submit([encoder.finish()]);
            let band: Vec<Inspected> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &out, u64::from(end - first) * row_bytes)?);
            pixels.extend(band);
        }
        Ok(pixels)
    }
}

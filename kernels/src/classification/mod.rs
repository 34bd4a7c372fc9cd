//! Classification: a tile's (8 x 8 pixels, by choice 4 x 4 or 16 x 16) variant is the OR of its pixels' masks (ruling 4); tile lists and indirect arguments per variant.
//!
//! Reads mask and stencil. Writes 32 tile lists (0 = every terrain tile, 1..=31 = the variants) and 32 indirect draws, see [`tile_vertices`].
//! One workgroup a tile. Source: Moore, GDC 2018, "Terrain Classification Pass".

use bytemuck::cast_slice;

use crate::base::error::Result;
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, aspect, view};
use crate::gpu::{Gpu, Shader, Timer, constants, read_buffer};
use crate::shared;
use crate::view::FRAME_WGSL;

pub mod reference;

/// Edge of a tile in pixels: Far Cry 5's.
pub const TILE: u32 = 8;
/// Edges of tiles that can be had, to tell what they cost.
pub const TILES: [u32; 3] = [4, 8, 16];
/// Lists: every terrain tile, and one a variant.
pub const LISTS: u32 = 32;
/// Bytes of one list's indirect draw arguments.
pub const ARGUMENT_BYTES: u64 = 16;

/// Tiles that cover a picture.
pub fn tiles(size: [u32; 2]) -> [u32; 2] {
    tiles_of(size, TILE)
}

/// Tiles of another edge that cover a picture.
pub fn tiles_of(size: [u32; 2], tile: u32) -> [u32; 2] {
    size.map(|n| n.div_ceil(tile))
}

/// Vertices that shading draws per tile: 3 where depth can be clamped instead of clipped, else 6.
///
/// Two triangles share the tile's diagonal, and along it pixels that a device shades together are shaded for both. One triangle that
/// holds a square reaches over it; what it must not shade is beyond depth, which is tested before shading.
pub fn tile_vertices(gpu: &Gpu) -> u32 {
    if gpu.features.contains(wgpu::Features::DEPTH_CLIP_CONTROL) { 3 } else { 6 }
}

/// What the pass makes.
pub struct Lists {
    /// 32 lists of packed tiles (x | y << 12 | mask << 24), each with room for every tile.
    pub tiles: wgpu::Buffer,
    /// 32 indirect draws.
    pub arguments: wgpu::Buffer,
    count: u32,
    tiles_xy: [u32; 2],
}

impl Lists {
    /// Room for a picture of a size in pixels, cut into tiles of an edge in pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2], tile: u32) -> Lists {
        let tiles_xy = tiles_of(size, tile);
        let [x, y] = tiles_xy;
        let count = x * y;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        Lists {
            tiles: gpu.buffer("tile lists", usage, u64::from(count * LISTS) * 4),
            arguments: gpu.buffer("tile draws", usage | wgpu::BufferUsages::INDIRECT, u64::from(LISTS) * ARGUMENT_BYTES),
            count,
            tiles_xy,
        }
    }

    /// Tiles in each list; call after the submission is done.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read_counts(&self, gpu: &Gpu) -> Result<[u32; LISTS as usize]> {
        let words: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.arguments, u64::from(LISTS) * ARGUMENT_BYTES)?);
        Ok(std::array::from_fn(|i| words[i][1]))
    }

    /// The packed tiles of every list, in the order they were appended (which no result may depend on).
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Vec<u32>>> {
        let counts = self.read_counts(gpu)?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.tiles, u64::from(self.count * LISTS) * 4)?);
        Ok(words.chunks_exact(self.count as usize).zip(counts).map(|(list, n)| list[..n as usize].to_vec()).collect())
    }
}

/// The pass.
pub struct Classification {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

/// The files of the stage's shader module, by subgroup operations or plain.
pub fn files(subgroups: bool) -> Vec<(&'static str, &'static str)> {
    let mut files = shared::WGSL.to_vec();
    files.extend([FRAME_WGSL, ("classification/classification.wgsl", include_str!("classification.wgsl"))]);
    files.push(if subgroups {
        ("classification/subgroup.wgsl", include_str!("subgroup.wgsl"))
    } else {
        ("classification/plain.wgsl", include_str!("plain.wgsl"))
    });
    files
}

impl Classification {
    /// Compiles the pass, with subgroup operations where the device has them.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout, tile: u32) -> Result<Classification> {
        let subgroups = gpu.features.contains(wgpu::Features::SUBGROUP);
        let shader = Shader::new(gpu, "classification", &files(subgroups))?;
        let layout = gpu.layout(
            "classification",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::TextureUint(FLAT), Binding::TextureUint(FLAT), Binding::StorageWritten, Binding::StorageWritten],
        );
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("classification"),
            layout: Some(&gpu.pipeline_layout("classification", &[frame_layout, &layout])),
            module: &shader.module,
            entry_point: Some("classification_main"),
            compilation_options: constants(&[("TILE", f64::from(tile))]),
            cache: None,
        });
        Ok(Classification { pipeline, layout })
    }

    /// Records the pass.
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        frame: &wgpu::BindGroup,
        targets: &geometry::Targets,
        lists: &Lists,
    ) {
        let empty: Vec<[u32; 4]> = vec![[tile_vertices(gpu), 0, 0, 0]; LISTS as usize];
        gpu.queue.write_buffer(&lists.arguments, 0, cast_slice(&empty));
        let group = gpu.group(
            "classification",
            &self.layout,
            &[
                wgpu::BindingResource::TextureView(&view(&targets.mask)),
                wgpu::BindingResource::TextureView(&aspect(&targets.depth_stencil, wgpu::TextureAspect::StencilOnly)),
                lists.tiles.as_entire_binding(),
                lists.arguments.as_entire_binding(),
            ],
        );
        let [x, y] = lists.tiles_xy;
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("classification"),
            timestamp_writes: timer.compute("classification"),
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, frame, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups(x, y, 1);
    }
}

//! Statistics over the pictures of one view with many seeds: bias, variance and clumping of each stream (way to shade), summed on the device.

use bytemuck::{Pod, Zeroable, bytes_of};

use crate::base::error::Result;
use crate::base::wgsl::Wgsl;
use crate::classification;
use crate::gpu::bindings::Binding;
use crate::gpu::{Gpu, ShaderModule, read_buffer};
use crate::shared;

/// Edge length of the blocks from which clumping is computed, pixels.
pub const BLOCK: u32 = 5;
/// Edge length of the areas over which the differences between each seed and the exact blend are summed, pixels. The device computes sums per tile;
/// an area consists of 2 x 2 tiles.
pub const AREA: u32 = 2 * classification::TILE;

/// The uniforms of the passes; the layout matches `SeedFrame` in `seeds.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct SeedFrame {
    pub size: [u32; 2],
    pub tiles: [u32; 2],
    pub blocks: [u32; 2],
    pub block: u32,
    pub count: u32,
    pub offset: u32,
    pub zero: u32,
    pub pad_1: u32,
    pub pad_2: u32,
}

/// Returns the number of columns and rows of areas that cover a picture. Areas at the right and lower edge may be smaller than the others.
pub fn areas(size: [u32; 2]) -> [u32; 2] {
    size.map(|n| n.div_ceil(AREA))
}

/// Sums of one seed over one area, in one stream.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AreaSums {
    /// Number of terrain pixels.
    pub terrain: f64,
    /// Sum over pixels and channels of the difference from the exact blend.
    pub error: f64,
    /// Sum over pixels and channels of the square of this difference.
    pub squared_error: f64,
}

/// Sums of one seed, in one stream.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SeedSums {
    /// Number of terrain pixels.
    pub terrain: f64,
    /// Sum over pixels and channels of the difference from the exact blend.
    pub error: f64,
    /// Sum over pixels and channels of the square of this difference.
    pub squared_error: f64,
    /// Number of blocks in which every pixel is terrain.
    pub blocks: f64,
    /// Sum over these blocks of the square of the mean error in luminance.
    pub block_squares: f64,
    /// Sum over these blocks of the mean square of the error in luminance.
    pub pixel_squares: f64,
    /// Sums over the areas of the picture, row by row; see [`areas`].
    pub areas: Vec<AreaSums>,
}

impl SeedSums {
    /// Returns the clumping of the errors: the variance of their means over blocks, relative to white noise of the same variance. White noise has
    /// about 1. `None` if no block is all terrain, or all errors in such blocks are 0.
    pub fn clumping(&self) -> Option<f64> {
        (self.pixel_squares > 0.0).then(|| f64::from(BLOCK * BLOCK) * self.block_squares / self.pixel_squares)
    }
}

/// Sums over all seeds, in one stream.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct VarianceSums {
    /// Number of terrain pixels.
    pub terrain: f64,
    /// Sum over pixels and channels of a difference: the mean over seeds, minus the exact blend.
    pub bias: f64,
    /// Sum over pixels and channels of the unbiased variance over seeds.
    pub variance: f64,
}

/// Buffers of one stream.
pub struct SeedStream {
    /// The picture of the current seed.
    pub signal: wgpu::Buffer,
    /// The picture of the exact blend, which makes no random choices.
    pub exact: wgpu::Buffer,
    moments: wgpu::Buffer,
    tiles: wgpu::Buffer,
    blocks: wgpu::Buffer,
}

/// The passes that compute `SeedSums` and `VarianceSums`.
pub struct Seeds {
    size: [u32; 2],
    add: wgpu::ComputePipeline,
    finish: wgpu::ComputePipeline,
    arrange: wgpu::ComputePipeline,
    frame_layout: wgpu::BindGroupLayout,
    layout: wgpu::BindGroupLayout,
}

static WGSL: Wgsl = Wgsl::new("metrics/seeds.wgsl", include_str!("seeds.wgsl"), &[&shared::MOMENTS, &shared::SIGNAL]);

/// The shader module of these passes.
pub static MODULE: ShaderModule = ShaderModule::new("seeds", &[&WGSL]);

impl Seeds {
    /// Compiles the passes.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu, size: [u32; 2]) -> Result<Seeds> {
        let stage = wgpu::ShaderStages::COMPUTE;
        let frame_layout = gpu.layout("seed frame", stage, &[Binding::Uniform]);
        let (read, written) = (Binding::Storage, Binding::StorageWritten);
        let layout = gpu.layout("seed stream", stage, &[read, read, written, written, written]);
        let shader = MODULE.compile(gpu)?;
        let pipeline_layout = gpu.pipeline_layout("seeds", &[&frame_layout, &layout]);
        let pipeline = |entry_point: &str| {
            gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: Some(&pipeline_layout),
                module: &shader.module,
                entry_point: Some(entry_point),
                compilation_options: Default::default(),
                cache: None,
            })
        };
        let (add, finish, arrange) = (pipeline("seeds_add"), pipeline("seeds_finish"), pipeline("seeds_blocks"));
        Ok(Seeds { size, add, finish, arrange, frame_layout, layout })
    }

    fn blocks(&self) -> [u32; 2] {
        self.size.map(|n| n / BLOCK)
    }

    /// Allocates the buffers of a stream.
    pub fn stream(&self, gpu: &Gpu) -> SeedStream {
        let pixels = u64::from(self.size[0]) * u64::from(self.size[1]);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let [columns, rows] = classification::tiles(self.size);
        let [across, down] = self.blocks();
        SeedStream {
            signal: gpu.buffer("signal", usage, pixels * 8),
            exact: gpu.buffer("exact", usage, pixels * 8),
            moments: gpu.buffer("moments", usage, pixels * 3 * 16),
            tiles: gpu.buffer("seed tiles", usage, u64::from(columns * rows) * 16),
            blocks: gpu.buffer("seed blocks", usage, u64::from(across * down).max(1) * 16),
        }
    }

    fn encode(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, streams: &[SeedStream], count: u32, passes: &[&wgpu::ComputePipeline]) {
        let tiles = classification::tiles(self.size);
        let blocks = self.blocks();
        let uniform = SeedFrame { size: self.size, tiles, blocks, block: BLOCK, count, ..SeedFrame::default() };
        let buffer = gpu.buffer_with("seed frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniform));
        let frame = gpu.group("seed frame", &self.frame_layout, &[buffer.as_entire_binding()]);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("seeds"), timestamp_writes: None });
        pass.set_bind_group(0, &frame, &[]);
        for stream in streams {
            let buffers = [&stream.signal, &stream.exact, &stream.moments, &stream.tiles, &stream.blocks];
            pass.set_bind_group(1, &gpu.group("seed stream", &self.layout, &buffers.map(|b| b.as_entire_binding())), &[]);
            for pipeline in passes {
                pass.set_pipeline(pipeline);
                // A pass has one invocation per tile or per block. All passes get the larger of the two numbers; surplus invocations return at once.
                let invocations = (tiles[0] * tiles[1]).max(blocks[0] * blocks[1]);
                pass.dispatch_workgroups(invocations.div_ceil(64), 1, 1);
            }
        }
    }

    /// Records the passes that add the pictures of one seed. `count`: the number of seeds so far, including this one.
    pub fn encode_add(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, streams: &[SeedStream], count: u32) {
        self.encode(gpu, encoder, streams, count, &[&self.add, &self.arrange]);
    }

    /// Records the pass that computes [`VarianceSums`] from the moments, after `count` seeds.
    pub fn encode_finish(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, streams: &[SeedStream], count: u32) {
        self.encode(gpu, encoder, streams, count, &[&self.finish]);
    }

    /// Reads the sums of the seed that was added last, one per stream.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read(&self, gpu: &Gpu, streams: &[SeedStream]) -> Result<Vec<SeedSums>> {
        let quads = |buffer: &wgpu::Buffer| -> Result<Vec<[f32; 4]>> {
            Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, buffer, buffer.size())?))
        };
        let [across, down] = self.blocks();
        let columns = classification::tiles(self.size)[0] as usize;
        let [areas_across, areas_down] = areas(self.size).map(|n| n as usize);
        streams
            .iter()
            .map(|stream| {
                let mut sums = SeedSums { areas: vec![AreaSums::default(); areas_across * areas_down], ..SeedSums::default() };
                for (tile, [error, squared, pixels, _]) in quads(&stream.tiles)?.into_iter().enumerate() {
                    let [error, squared, pixels] = [error, squared, pixels].map(f64::from);
                    sums.error += error;
                    sums.squared_error += squared;
                    sums.terrain += pixels;
                    let area = &mut sums.areas[tile / columns / 2 * areas_across + tile % columns / 2];
                    area.error += error;
                    area.squared_error += squared;
                    area.terrain += pixels;
                }
                for [mean_squared, squared, whole, _] in quads(&stream.blocks)?.into_iter().take((across * down) as usize) {
                    sums.block_squares += f64::from(mean_squared);
                    sums.pixel_squares += f64::from(squared);
                    sums.blocks += f64::from(whole);
                }
                Ok(sums)
            })
            .collect()
    }

    /// Reads the sums over all seeds, one per stream. Must be called after [`Seeds::encode_finish`].
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read_finished(&self, gpu: &Gpu, streams: &[SeedStream]) -> Result<Vec<VarianceSums>> {
        streams
            .iter()
            .map(|stream| {
                let tiles: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &stream.tiles, stream.tiles.size())?);
                let mut sums = VarianceSums::default();
                for [bias, variance, pixels, _] in tiles {
                    sums.bias += f64::from(bias);
                    sums.variance += f64::from(variance);
                    sums.terrain += f64::from(pixels);
                }
                Ok(sums)
            })
            .collect()
    }
}

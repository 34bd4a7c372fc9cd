//! Metrics: how a sequence of pictures changes over frames and over seeds, summed on the device.
//!
//! A *stream* is one way to shade (variant, estimator, noise, resolve), followed over time. A ring buffer holds its last five pictures, two words per
//! pixel (`shared::signal`). In each frame, [`Motion`] links every pixel to the pixel that showed the same surface point one frame earlier. It also
//! links a quarter of the pixels to the pixels that showed their points 2 to 4 frames earlier. Then the current picture of each stream is compared
//! with the earlier pictures of the stream, and only sums per tile are read back. Memory does not grow with the number of frames.
//!
//! The formulas are in METHODOLOGY.md; `reference` computes them in f64.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};

use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::classification;
use crate::gpu::bindings::Binding;
use crate::gpu::{Gpu, ShaderModule, Timer, read_buffer};
use crate::motion::NO_LINK;
use crate::motion::{LAGS, Motion, SLOTS, Slots};
use crate::shared;
use crate::temporal::{Resolve, Temporal};

mod follow;
pub mod reference;
mod seeds;

pub use follow::{Followed, Point, Sample, Summary};
pub use seeds::{BLOCK, MODULE as SEEDS_MODULE, SeedFrame, SeedStream, SeedSums, Seeds, VarianceSums};

/// Number of bins in the histogram of differences at lag 1: 16 per octave, from 2^-14 to 2^2.
pub const BINS: usize = 256;
const LOWEST_OCTAVE: f64 = -14.0;
const BINS_PER_OCTAVE: f64 = 16.0;

/// The parameters of the measurement of one frame; the layout matches `MeasureFrame` in `measure.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MeasureFrame {
    pub size: [u32; 2],
    pub tiles: [u32; 2],
    pub slot: u32,
    pub lags: u32,
    pub quarter: u32,
    pub pad_0: u32,
    pub past_slots: [u32; LAGS],
}

/// The sums of one tile; the layout matches `MeasureTile` in `measure.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MeasureTile {
    pub links: [u32; LAGS],
    pub differences: [f32; LAGS],
    pub terrain: u32,
    pub fetches: u32,
    pub rejections: u32,
    pub quarter_terrain: u32,
}

/// Sums of one lag in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LagSums {
    /// Number of terrain pixels whose point was looked up in the earlier frame. At lag 1, these are all terrain pixels; at lags 2 to 4, they are the
    /// terrain pixels of a quarter, which is a different quarter in each frame.
    pub terrain: u64,
    /// Number of these pixels whose point was visible in the earlier frame.
    pub linked: u64,
    /// Number of linked pixels with a random choice in both frames.
    pub chosen: u64,
    /// Number of pixels counted in `chosen` whose two choices differ.
    pub flipped: u64,
    /// Sum over linked pixels of the absolute difference in luminance.
    pub difference: f64,
}

/// Sums of one frame of one stream.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSums {
    /// Number of terrain pixels.
    pub terrain: u64,
    /// Number of fetches of all terrain pixels.
    pub fetches: u64,
    /// Sums of the comparisons with the pictures 1 to 4 frames earlier.
    pub lags: [LagSums; LAGS],
    /// Number of pixels whose history was tested. The history of a pixel is the colour of its surface point one frame earlier; the test
    /// rejects it if it lies outside the box of the current colours of the 3 x 3 pixels around the pixel. Only those pixels of one quarter
    /// are tested that are linked at lag 1. Each frame uses a different quarter.
    pub tested: u64,
    /// Number of tested pixels whose history was rejected.
    pub rejected: u64,
    /// Histogram, over the tested pixels, of the absolute difference in luminance at lag 1.
    pub histogram: [u32; BINS],
}

impl Default for FrameSums {
    fn default() -> Self {
        FrameSums { terrain: 0, fetches: 0, lags: [LagSums::default(); LAGS], tested: 0, rejected: 0, histogram: [0; BINS] }
    }
}

impl FrameSums {
    fn of(tiles: &[MeasureTile], histogram: [u32; BINS]) -> FrameSums {
        let mut sums = FrameSums { histogram, ..FrameSums::default() };
        for tile in tiles {
            sums.terrain += u64::from(tile.terrain);
            sums.fetches += u64::from(tile.fetches);
            sums.tested += u64::from(tile.rejections & 255);
            sums.rejected += u64::from(tile.rejections >> 8);
            for (i, lag) in sums.lags.iter_mut().enumerate() {
                lag.terrain += u64::from(if i == 0 { tile.terrain } else { tile.quarter_terrain });
            }
            for ((lag, &word), &difference) in sums.lags.iter_mut().zip(&tile.links).zip(&tile.differences) {
                lag.linked += u64::from(word & 255);
                lag.chosen += u64::from(word >> 8 & 255);
                lag.flipped += u64::from(word >> 16);
                lag.difference += f64::from(difference);
            }
        }
        sums
    }
}

/// Returns the value below which the given share of a histogram's counts lies; `None` if the histogram is empty. The value is interpolated within its
/// bin on a logarithmic scale and is accurate to 1/16 of an octave (4.4 %). If it lies in the lowest bin, which also holds all values below 2^-14,
/// the result is 0.
pub fn quantile(histogram: &[u64; BINS], share: f64) -> Option<f64> {
    let total: u64 = histogram.iter().sum();
    if total == 0 {
        return None;
    }
    let wanted = share * total as f64;
    let mut below = 0.0;
    for (bin, &count) in histogram.iter().enumerate() {
        let count = count as f64;
        if below + count >= wanted && count > 0.0 {
            let octave = LOWEST_OCTAVE + (bin as f64 + (wanted - below) / count) / BINS_PER_OCTAVE;
            return Some(if bin == 0 { 0.0 } else { octave.exp2() });
        }
        below += count;
    }
    None
}

/// A way to shade, followed over time.
pub struct Stream {
    /// The ring of shaded pictures, before any resolve.
    pub signal: wgpu::Buffer,
    /// The resolve that is applied to the shaded pictures before they are measured.
    pub resolve: Resolve,
    /// The ring of resolved pictures, and a buffer with two histories of the resolve; `None` without a resolve.
    resolved: Option<[wgpu::Buffer; 2]>,
    tiles: wgpu::Buffer,
    histogram: wgpu::Buffer,
}

impl Stream {
    /// The ring that is measured: the resolved pictures or, without a resolve, the shaded pictures.
    pub fn measured(&self) -> &wgpu::Buffer {
        self.resolved.as_ref().map_or(&self.signal, |[ring, _]| ring)
    }
}

/// Measures how the pictures of each stream change over frames.
pub struct Meter {
    size: [u32; 2],
    pipeline: wgpu::ComputePipeline,
    frame_layout: wgpu::BindGroupLayout,
    stream_layout: wgpu::BindGroupLayout,
    /// Links between frames.
    pub motion: Motion,
    temporal: Option<Temporal>,
    /// The streams, in the order of the resolves that were given to `Meter::new`.
    pub streams: Vec<Stream>,
    index: u32,
}

static WGSL: Wgsl = Wgsl::new("metrics/measure.wgsl", include_str!("measure.wgsl"), &[&shared::MOTION, &shared::SIGNAL]).with(&[
    ("MEASURE_NO_LINK", Constant::U32(NO_LINK)),
    ("MEASURE_BINS", Constant::real(BINS as f64)),
    ("MEASURE_LOWEST_OCTAVE", Constant::real(LOWEST_OCTAVE)),
    ("MEASURE_BINS_PER_OCTAVE", Constant::real(BINS_PER_OCTAVE)),
]);

/// The shader module of the measurement.
pub static MODULE: ShaderModule = ShaderModule::new("measure", &[&WGSL]);

impl Meter {
    /// Compiles the passes and allocates one stream for each entry of `resolves`.
    ///
    /// # Errors
    /// When a shader does not compile or the device is out of memory.
    pub fn new(gpu: &Gpu, frame_uniforms: &wgpu::BindGroupLayout, size: [u32; 2], resolves: &[Resolve]) -> Result<Meter> {
        let stage = wgpu::ShaderStages::COMPUTE;
        let frame_layout = gpu.layout("measured frame", stage, &[Binding::Storage, Binding::Storage]);
        let stream_layout = gpu.layout("measured stream", stage, &[Binding::Storage, Binding::StorageWritten, Binding::StorageWritten]);
        let shader = MODULE.compile(gpu)?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("measure"),
            layout: Some(&gpu.pipeline_layout("measure", &[&frame_layout, &stream_layout])),
            module: &shader.module,
            entry_point: Some("measure_main"),
            compilation_options: Default::default(),
            cache: None,
        });
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let [columns, rows] = classification::tiles(size);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let ring = |label| gpu.buffer(label, usage, pixels * u64::from(SLOTS) * 8);
        let streams = resolves
            .iter()
            .map(|&resolve| Stream {
                signal: ring("signal"),
                resolve,
                resolved: (resolve != Resolve::Off).then(|| [ring("resolved"), gpu.buffer("history", usage, pixels * 2 * 16)]),
                tiles: gpu.buffer("measured tiles", usage, u64::from(columns * rows) * size_of::<MeasureTile>() as u64),
                histogram: gpu.buffer("differences", usage, BINS as u64 * 4),
            })
            .collect();
        let temporal = if resolves.iter().any(|&r| r != Resolve::Off) { Some(Temporal::new(gpu)?) } else { None };
        let motion = Motion::new(gpu, frame_uniforms, size)?;
        gpu.check()?;
        Ok(Meter { size, pipeline, frame_layout, stream_layout, motion, temporal, streams, index: 0 })
    }

    /// Offsets in the rings: of the pictures of this frame, and of the pictures of the earlier frames.
    pub fn slots(&self) -> Slots {
        Slots::of(self.index, self.size[0] * self.size[1])
    }

    /// Index of the frame in the sequence, from 0.
    pub fn index(&self) -> u32 {
        self.index
    }

    /// Records the resolves and the measurement of this frame. Before this call, the signals and links of the frame must be recorded or written.
    pub fn encode(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, timer: &mut Timer) {
        let slots = self.slots();
        let lags = self.index.min(LAGS as u32);
        if let Some(temporal) = &self.temporal {
            for stream in &self.streams {
                if let Some(buffers) = &stream.resolved {
                    temporal.encode(gpu, encoder, stream.resolve, self.size, self.index, &slots, &self.motion, &stream.signal, buffers);
                }
            }
        }
        let [columns, rows] = classification::tiles(self.size);
        let uniform = MeasureFrame {
            size: self.size,
            tiles: [columns, rows],
            slot: slots.now,
            lags,
            quarter: slots.quarter,
            pad_0: 0,
            past_slots: slots.past,
        };
        let buffer = gpu.buffer_with("measured frame", wgpu::BufferUsages::STORAGE, bytes_of(&uniform));
        let frame = gpu.group("measured frame", &self.frame_layout, &[&buffer, &self.motion.links].map(|b| b.as_entire_binding()));
        for stream in &self.streams {
            encoder.clear_buffer(&stream.histogram, 0, None);
        }
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("measure"), timestamp_writes: timer.compute("measure") });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &frame, &[]);
        for stream in &self.streams {
            let buffers = [stream.measured(), &stream.tiles, &stream.histogram];
            pass.set_bind_group(1, &gpu.group("measured stream", &self.stream_layout, &buffers.map(|b| b.as_entire_binding())), &[]);
            pass.dispatch_workgroups((columns * rows).div_ceil(64), 1, 1);
        }
    }

    /// Reads the sums of the frame, one per stream, and advances to the next frame. The commands of the frame must have been submitted
    /// before.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn read(&mut self, gpu: &Gpu) -> Result<Vec<FrameSums>> {
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let size = |stream: &Stream| stream.tiles.size() + stream.histogram.size();
        let all = gpu.buffer("sums", usage, self.streams.iter().map(size).sum::<u64>().max(4));
        let mut encoder = gpu.encoder("sums");
        let mut at = 0;
        for stream in &self.streams {
            for buffer in [&stream.tiles, &stream.histogram] {
                encoder.copy_buffer_to_buffer(buffer, 0, &all, at, buffer.size());
                at += buffer.size();
            }
        }
        gpu.queue.submit([encoder.finish()]);
        let bytes = read_buffer(gpu, &all, at)?;
        let mut left = bytes.as_slice();
        let mut sums = Vec::with_capacity(self.streams.len());
        for stream in &self.streams {
            let (tiles, rest) = left.split_at(usize::try_from(stream.tiles.size()).unwrap_or(0));
            let (bins, rest) = rest.split_at(BINS * 4);
            left = rest;
            let tiles: Vec<MeasureTile> = bytemuck::pod_collect_to_vec(tiles);
            let bins: Vec<u32> = bytemuck::pod_collect_to_vec(bins);
            sums.push(FrameSums::of(&tiles, std::array::from_fn(|i| bins[i])));
        }
        self.index += 1;
        Ok(sums)
    }

    /// Returns a measured picture of a stream, as signals. `back`: the number of frames, 0 to 4, by which the picture precedes the last measured one.
    ///
    /// # Errors
    /// When the device is lost.
    pub fn picture(&self, gpu: &Gpu, stream: usize, back: u32) -> Result<Vec<[u32; 2]>> {
        let pixels = self.size[0] * self.size[1];
        let slot = Slots::of(self.index + SLOTS - 1 - back, pixels).now;
        read_signal(gpu, self.streams[stream].measured(), slot, pixels)
    }

    /// Writes a picture into this frame's slot of a stream. Tests use this method in place of a renderer.
    pub fn write(&self, gpu: &Gpu, stream: usize, signal: &[[u32; 2]]) {
        gpu.queue.write_buffer(&self.streams[stream].signal, u64::from(self.slots().now) * 8, cast_slice(signal));
    }

    /// Writes the links of this frame (for each lag, one link per pixel) and the positions of the surface points one frame earlier. Tests
    /// use this method in place of the motion that a renderer computes.
    pub fn write_links(&self, gpu: &Gpu, links: &[u32], positions: &[[f32; 2]]) {
        gpu.queue.write_buffer(&self.motion.links, 0, cast_slice(links));
        gpu.queue.write_buffer(&self.motion.positions, 0, cast_slice(positions));
    }

    /// Begins a new sequence.
    pub fn restart(&mut self) {
        self.index = 0;
        self.motion.restart();
    }
}

/// Reads `pixels` signals from a buffer, starting at pixel `offset`.
///
/// # Errors
/// When the device is lost.
pub fn read_signal(gpu: &Gpu, buffer: &wgpu::Buffer, offset: u32, pixels: u32) -> Result<Vec<[u32; 2]>> {
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let part = gpu.buffer("signal", usage, u64::from(pixels) * 8);
    let mut encoder = gpu.encoder("signal");
    encoder.copy_buffer_to_buffer(buffer, u64::from(offset) * 8, &part, 0, u64::from(pixels) * 8);
    gpu.queue.submit([encoder.finish()]);
    Ok(bytemuck::pod_collect_to_vec(&read_buffer(gpu, &part, u64::from(pixels) * 8)?))
}

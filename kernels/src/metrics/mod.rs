//! Metrics: how a sequence of pictures changes over frames and over seeds, summed on the device.
//!
//! A *stream* is the sequence of pictures of one way to shade (variant, estimator, noise, resolve), as albedo or lit ([`Track`]). A ring buffer holds
//! its last five pictures, two words per pixel (`shared::signal`).
//!
//! In each frame, [`Motion`] links each pixel to the pixel that showed the same surface point one frame earlier, if there is one. A quarter of the
//! pixels are also linked to pixels 2 to 4 frames earlier. The meter then compares the current picture of each stream with its earlier pictures,
//! along the links. Sums and histograms are read back in each frame, pictures and remembered errors only on request. The size of the buffers does not
//! depend on the number of frames.
//!
//! The meter can also get the pictures of a reference sequence ([`Meter::write_reference`]). It then compares how the stream and the reference
//! change, and keeps the *remembered error* of each surface point: the exponential mean of its error over time, which models the eye
//! ([`Meter::memory`], [`perceived`]).
//!
//! The formulas are in METHODOLOGY.md; `reference` computes the sums in f64.

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};

use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::gpu::bindings::Binding;
use crate::gpu::{Gpu, ShaderModule, Timer, read_ranges};
use crate::motion::NO_LINK;
use crate::motion::{LAGS, Motion, SLOTS, Slots};
use crate::shared;
use crate::shared::signal::Signal;
use crate::temporal::{Resolve, Temporal};

mod follow;
pub mod perceived;
pub mod reference;
mod seeds;

pub use follow::{Followed, Point, Sample, Summary};
pub use perceived::{Filter as PerceivedFilter, Viewing};
pub use seeds::{AREA, AreaSums, BLOCK, MODULE as SEEDS_MODULE, SeedFrame, SeedStream, SeedSums, Seeds, VarianceSums, areas};

/// Number of bins in a histogram of differences at lag 1: 16 per octave, from 2^-14 to 2^2.
pub const BINS: usize = 256;
const LOWEST_OCTAVE: f64 = -14.0;
const BINS_PER_OCTAVE: f64 = 16.0;

/// The parameters of the measurement of one frame; the layout matches `MeasureFrame` in `measure.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MeasureFrame {
    pub size: [u32; 2],
    pub blocks: [u32; 2],
    pub slot: u32,
    pub lags: u32,
    pub quarter: u32,
    pub referenced: u32,
    pub past_slots: [u32; LAGS],
    pub memory_slot: u32,
    pub memory_before: u32,
    pub adaptation: f32,
    pub pad_0: u32,
}

/// Number of blocks of 64 x 8 pixels in each direction that cover a picture of `size` pixels.
fn blocks(size: [u32; 2]) -> [u32; 2] {
    [size[0].div_ceil(64), size[1].div_ceil(8)]
}

/// Number of parts of a picture, 8 per block. A part is the set of pixels that one invocation sums.
fn parts(size: [u32; 2]) -> u32 {
    let [across, down] = blocks(size);
    8 * across * down
}

/// The sums of one part; the layout matches `MeasurePart` in `measure.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MeasurePart {
    pub links: [u32; LAGS],
    pub differences: [f32; LAGS],
    pub residuals: [f32; LAGS],
    pub residual_squares: [f32; LAGS],
    pub change_squares: [f32; LAGS],
    pub reference_squares: [f32; LAGS],
    pub products: [f32; LAGS],
    pub terrain: u32,
    pub fetches: u32,
    pub rejections: u32,
    pub quarter_terrain: u32,
    pub invalid: u32,
    pub pad_0: u32,
    pub pad_1: u32,
    pub pad_2: u32,
}

/// Sums of one lag in one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LagSums {
    /// Number of terrain pixels that are followed at this lag. At lag 1, these are all terrain pixels; at lags 2 to 4, they are the terrain pixels of
    /// a quarter. The quarter changes from frame to frame. The pixels are counted even in the first frames, which have no earlier frame at this lag.
    pub terrain: u64,
    /// Number of these pixels whose point was visible in the earlier frame, with a finite colour.
    pub linked: u64,
    /// Number of linked pixels with a random choice in both frames.
    pub chosen: u64,
    /// Number of pixels counted in `chosen` whose two choices differ.
    pub flipped: u64,
    /// Sum over linked pixels of the absolute difference in luminance.
    pub difference: f64,
    /// Comparison with the changes of the reference sequence.
    pub residual: Residual,
}

/// Comparison of the changes of a stream with the changes of the reference sequence, as sums over pixels. A change is the luminance of a pixel minus
/// that of the linked pixel: dY in the stream, dR in the reference. dY - dR is then the change of the stream's error. Luminance is the relative
/// luminance of linear albedo or, for lit pictures, the luma of display values, 0 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Residual {
    /// Number of linked pixels whose reference is known in both frames.
    pub compared: u64,
    /// Sum of |dY - dR|.
    pub sum: f64,
    /// Sum of (dY - dR)².
    pub square: f64,
    /// Sum of dY².
    pub change_square: f64,
    /// Sum of dR².
    pub reference_square: f64,
    /// Sum of dY dR.
    pub product: f64,
}

impl Residual {
    /// Adds the sums of other pixels.
    pub fn add(&mut self, other: &Residual) {
        self.compared += other.compared;
        self.sum += other.sum;
        self.square += other.square;
        self.change_square += other.change_square;
        self.reference_square += other.reference_square;
        self.product += other.product;
    }

    /// Subtracts `other`, the sums of some of the pixels.
    #[must_use]
    pub fn without(&self, other: &Residual) -> Residual {
        Residual {
            compared: self.compared - other.compared,
            sum: self.sum - other.sum,
            square: self.square - other.square,
            change_square: self.change_square - other.change_square,
            reference_square: self.reference_square - other.reference_square,
            product: self.product - other.product,
        }
    }

    /// Mean of |dY - dR|; `None` without compared pixels. It is 0 if the error moves with the surface.
    pub fn mean(&self) -> Option<f64> {
        self.per_pixel(self.sum)
    }

    /// Root mean square of dY - dR; `None` without compared pixels.
    pub fn rms(&self) -> Option<f64> {
        self.per_pixel(self.square).map(f64::sqrt)
    }

    /// The share of the reference's changes that the stream has: the g that minimises the sum of (dY - g dR)². It is 1 if the reference does not
    /// change, because then the stream can lose nothing.
    pub fn gain(&self) -> f64 {
        if self.reference_square > 0.0 { self.product / self.reference_square } else { 1.0 }
    }

    /// Change that the reference does not have, such as noise: the root mean square of dY - g dR, with g = [`Residual::gain`]. `None` without
    /// compared pixels.
    pub fn added(&self) -> Option<f64> {
        let explained = if self.reference_square > 0.0 { self.product * self.product / self.reference_square } else { 0.0 };
        self.per_pixel((self.change_square - explained).max(0.0)).map(f64::sqrt)
    }

    /// Change that the reference has but the stream does not have, such as that of blurred detail: (1 - g) times the root mean square of dR, with
    /// g = [`Residual::gain`]. Below 0 if the stream exaggerates the changes of the reference. `None` without compared pixels.
    pub fn lost(&self) -> Option<f64> {
        self.per_pixel(self.reference_square).map(|square| (1.0 - self.gain()) * square.sqrt())
    }

    fn per_pixel(&self, sum: f64) -> Option<f64> {
        (self.compared > 0).then(|| sum / self.compared as f64)
    }
}

/// Sums of one frame of one stream.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameSums {
    /// Number of terrain pixels whose colour is finite. All other sums except `invalid` are over these pixels.
    pub terrain: u64,
    /// Number of terrain pixels whose colour is not finite.
    pub invalid: u64,
    /// Number of texture fetches in the pixels that `terrain` counts.
    pub fetches: u64,
    /// Sums of the comparisons with the pictures 1 to 4 frames earlier.
    pub lags: [LagSums; LAGS],
    /// Number of pixels whose history was tested. The history of a pixel is the colour of its surface point one frame earlier. The test rejects a
    /// history outside the box of the current colours of the 3 x 3 pixels around the pixel. Only pixels of one quarter that are linked at lag 1 are
    /// tested. The quarter changes from frame to frame.
    pub tested: u64,
    /// Number of tested pixels whose history was rejected.
    pub rejected: u64,
    /// Histogram, over the tested pixels, of the absolute difference in luminance at lag 1.
    pub histogram: [u32; BINS],
    /// Histogram of |dY - dR| at lag 1 (see [`Residual`]), over the tested pixels whose reference is known in both frames.
    pub residual_histogram: [u32; BINS],
}

impl Default for FrameSums {
    fn default() -> Self {
        FrameSums {
            terrain: 0,
            invalid: 0,
            fetches: 0,
            lags: [LagSums::default(); LAGS],
            tested: 0,
            rejected: 0,
            histogram: [0; BINS],
            residual_histogram: [0; BINS],
        }
    }
}

impl FrameSums {
    fn of(parts: &[MeasurePart], histograms: &[u32]) -> FrameSums {
        let bins = |from: usize| std::array::from_fn(|i| histograms.get(from + i).copied().unwrap_or(0));
        let mut sums = FrameSums { histogram: bins(0), residual_histogram: bins(BINS), ..FrameSums::default() };
        for part in parts {
            sums.terrain += u64::from(part.terrain);
            sums.invalid += u64::from(part.invalid);
            sums.fetches += u64::from(part.fetches);
            sums.tested += u64::from(part.rejections & 255);
            sums.rejected += u64::from(part.rejections >> 8);
            for (i, lag) in sums.lags.iter_mut().enumerate() {
                let word = part.links[i];
                lag.terrain += u64::from(if i == 0 { part.terrain } else { part.quarter_terrain });
                lag.linked += u64::from(word & 255);
                lag.chosen += u64::from(word >> 8 & 255);
                lag.flipped += u64::from(word >> 16 & 255);
                lag.difference += f64::from(part.differences[i]);
                lag.residual.add(&Residual {
                    compared: u64::from(word >> 24),
                    sum: part.residuals[i].into(),
                    square: part.residual_squares[i].into(),
                    change_square: part.change_squares[i].into(),
                    reference_square: part.reference_squares[i].into(),
                    product: part.products[i].into(),
                });
            }
        }
        sums
    }
}

/// Returns the value below which the given share of a histogram's counts lies; `None` if the histogram is empty. The value is interpolated within its
/// bin on a logarithmic scale. Below 4, where the bins end, it is accurate to 1/16 of an octave (4.4 %). If it lies in the lowest bin, which also
/// holds all values below 2^-14, the result is 0.
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

/// The kind of pictures that a stream consists of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Track {
    /// The quantity that the pictures show: albedo, or the lit picture.
    pub signal: Signal,
    /// The resolve that is applied to the shaded pictures before they are measured.
    pub resolve: Resolve,
}

/// The buffers of one stream: the pictures of one way to shade, and what is measured on them.
pub struct Stream {
    /// The ring of shaded pictures, before any resolve.
    pub signal: wgpu::Buffer,
    /// The signal of the pictures and the resolve that is applied to them.
    pub track: Track,
    /// The ring of resolved pictures, and a buffer with the previous and the new history of the resolve; `None` without a resolve.
    resolved: Option<[wgpu::Buffer; 2]>,
    parts: wgpu::Buffer,
    histogram: wgpu::Buffer,
    /// The remembered error of each surface point (see [`Meter::memory`]), in two slots: this frame and the previous frame. Without a reference, the
    /// buffer has one unused element.
    memory: wgpu::Buffer,
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
    /// The streams, in the order of the tracks that were given to `Meter::new`.
    pub streams: Vec<Stream>,
    /// For each signal, the ring of the pictures of the reference sequence.
    references: [wgpu::Buffer; 2],
    /// For each signal, the number of consecutive frames directly before this one whose reference pictures were written.
    referenced: [u32; 2],
    /// For each signal, whether the reference picture of this frame was written.
    written: [bool; 2],
    adaptation: f32,
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
    /// Compiles the passes and allocates one stream for each entry of `tracks`. `viewing`: the viewing conditions, if errors are to be measured
    /// against a reference sequence. The caller then writes the pictures of that sequence in each frame ([`Meter::write_reference`]).
    ///
    /// # Errors
    /// When a shader does not compile or the device is out of memory.
    #[allow(clippy::cast_possible_truncation, reason = "shaders compute in f32")]
    pub fn new(
        gpu: &Gpu,
        frame_uniforms: &wgpu::BindGroupLayout,
        size: [u32; 2],
        tracks: &[Track],
        viewing: Option<Viewing>,
    ) -> Result<Meter> {
        let stage = wgpu::ShaderStages::COMPUTE;
        let frame_layout = gpu.layout("measured frame", stage, &[Binding::Storage, Binding::Storage]);
        let (read, written) = (Binding::Storage, Binding::StorageWritten);
        let stream_layout = gpu.layout("measured stream", stage, &[read, written, written, read, written]);
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
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        let ring = |label| gpu.buffer(label, usage, pixels * u64::from(SLOTS) * 8);
        // A binding cannot be empty. So without a reference sequence, the buffers for remembered errors and for reference pictures have one element,
        // which the shader does not access.
        let of_error = |bytes: u64| if viewing.is_some() { bytes } else { 8 };
        let streams = tracks
            .iter()
            .map(|&track| Stream {
                signal: ring("signal"),
                track,
                resolved: (track.resolve != Resolve::Off).then(|| [ring("resolved"), gpu.buffer("history", usage, pixels * 2 * 16)]),
                parts: gpu.buffer("measured parts", usage, u64::from(parts(size)) * size_of::<MeasurePart>() as u64),
                histogram: gpu.buffer("differences", usage, 2 * BINS as u64 * 4),
                memory: gpu.buffer("remembered errors", usage, of_error(pixels * 2 * 8)),
            })
            .collect();
        let needs_reference = |signal| tracks.iter().any(|track| track.signal == signal);
        let references = Signal::ALL.map(|signal| {
            let bytes = if needs_reference(signal) { of_error(pixels * u64::from(SLOTS) * 8) } else { 8 };
            gpu.buffer("reference pictures", usage, bytes)
        });
        let temporal = if tracks.iter().any(|track| track.resolve != Resolve::Off) { Some(Temporal::new(gpu)?) } else { None };
        let motion = Motion::new(gpu, frame_uniforms, size, temporal.is_some())?;
        let adaptation = viewing.map_or(1.0, |viewing| viewing.adaptation()) as f32;
        gpu.check()?;
        Ok(Meter {
            size,
            pipeline,
            frame_layout,
            stream_layout,
            motion,
            temporal,
            streams,
            references,
            referenced: [0; 2],
            written: [false; 2],
            adaptation,
            index: 0,
        })
    }

    /// Where the pictures of this frame and of the earlier frames begin in the ring buffers, and which quarter of the rows this frame uses.
    pub fn slots(&self) -> Slots {
        Slots::of(self.index, self.size[0] * self.size[1])
    }

    /// Index of the frame in the sequence, from 0.
    pub fn index(&self) -> u32 {
        self.index
    }

    /// Records the resolves and the measurement of this frame. Before this call, the caller records or writes the signals and links of the frame.
    pub fn encode(&self, gpu: &Gpu, encoder: &mut wgpu::CommandEncoder, timer: &mut Timer) {
        let slots = self.slots();
        let lags = self.index.min(LAGS as u32);
        if let Some(temporal) = &self.temporal {
            for stream in &self.streams {
                if let Some(buffers) = &stream.resolved {
                    temporal.encode(
                        gpu,
                        encoder,
                        stream.track.resolve,
                        self.size,
                        self.index,
                        &slots,
                        &self.motion,
                        &stream.signal,
                        buffers,
                    );
                }
            }
        }
        let [memory_slot, memory_before] = self.memory_slots();
        let frames = Signal::ALL.map(|signal| {
            let uniform = MeasureFrame {
                size: self.size,
                blocks: blocks(self.size),
                slot: slots.now,
                lags,
                quarter: slots.quarter,
                referenced: if self.written[signal as usize] { (self.referenced[signal as usize] + 1).min(SLOTS) } else { 0 },
                past_slots: slots.past,
                memory_slot,
                memory_before,
                adaptation: self.adaptation,
                pad_0: 0,
            };
            let buffer = gpu.buffer_with("measured frame", wgpu::BufferUsages::STORAGE, bytes_of(&uniform));
            gpu.group("measured frame", &self.frame_layout, &[&buffer, &self.motion.links].map(|b| b.as_entire_binding()))
        });
        for stream in &self.streams {
            encoder.clear_buffer(&stream.histogram, 0, None);
        }
        let mut pass =
            encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("measure"), timestamp_writes: timer.compute("measure") });
        pass.set_pipeline(&self.pipeline);
        for stream in &self.streams {
            let signal = stream.track.signal as usize;
            pass.set_bind_group(0, &frames[signal], &[]);
            let buffers = [stream.measured(), &stream.parts, &stream.histogram, &self.references[signal], &stream.memory];
            pass.set_bind_group(1, &gpu.group("measured stream", &self.stream_layout, &buffers.map(|b| b.as_entire_binding())), &[]);
            pass.dispatch_workgroups(parts(self.size).div_ceil(64), 1, 1);
        }
    }

    /// Reads the sums of the frame, one per stream, and advances to the next frame. The commands of the frame must have been submitted
    /// before.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read(&mut self, gpu: &Gpu) -> Result<Vec<FrameSums>> {
        let buffers = self.streams.iter().flat_map(|stream| [&stream.parts, &stream.histogram]);
        let bytes = read_ranges(gpu, &buffers.map(|buffer| (buffer, 0..buffer.size())).collect::<Vec<_>>())?;
        let mut left = bytes.as_slice();
        let mut sums = Vec::with_capacity(self.streams.len());
        for stream in &self.streams {
            let (parts, rest) = left.split_at(usize::try_from(stream.parts.size()).unwrap_or(0));
            let (bins, rest) = rest.split_at(2 * BINS * 4);
            left = rest;
            let parts: Vec<MeasurePart> = bytemuck::pod_collect_to_vec(parts);
            let bins: Vec<u32> = bytemuck::pod_collect_to_vec(bins);
            sums.push(FrameSums::of(&parts, &bins));
        }
        self.index += 1;
        for (referenced, written) in self.referenced.iter_mut().zip(&mut self.written) {
            *referenced = if std::mem::take(written) { *referenced + 1 } else { 0 };
        }
        Ok(sums)
    }

    /// Offsets of this frame and of the previous frame in the buffers of remembered errors, pixels.
    fn memory_slots(&self) -> [u32; 2] {
        [self.index, self.index + 1].map(|index| index % 2 * self.size[0] * self.size[1])
    }

    /// Writes the picture of the reference sequence for this frame and a signal. Without this call, the frame has no residuals for the signal, and
    /// later frames have no residuals relative to this frame or to frames before it.
    pub fn write_reference(&mut self, gpu: &Gpu, signal: Signal, picture: &[[u32; 2]]) {
        gpu.queue.write_buffer(&self.references[signal as usize], u64::from(self.slots().now) * 8, cast_slice(picture));
        self.written[signal as usize] = true;
    }

    /// Returns a picture of the reference sequence. `back`: the number of frames, 0 to 4, by which it precedes the last measured frame. Must only be
    /// called for frames whose reference picture was written.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn reference(&self, gpu: &Gpu, signal: Signal, back: u32) -> Result<Vec<[u32; 2]>> {
        let pixels = self.size[0] * self.size[1];
        let slot = Slots::of(self.index + SLOTS - 1 - back, pixels).now;
        read_signal(gpu, &self.references[signal as usize], slot, pixels)
    }

    /// Returns the remembered errors of a stream after the last measured frame, row by row from the top. The remembered error of a pixel is the
    /// exponential mean, over time, of the error of its surface point ([`perceived`]). Each entry is this mean and the number of frames in it; 0
    /// frames = the pixel has no terrain in the stream or in the reference. Empty if the last measured frame has no picture of the reference
    /// sequence, or if the meter has no [`Viewing`].
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn memory(&self, gpu: &Gpu, stream: usize) -> Result<Vec<[f32; 2]>> {
        let pixels = self.size[0] * self.size[1];
        let Stream { memory, track, .. } = &self.streams[stream];
        if self.referenced[track.signal as usize] == 0 || memory.size() < u64::from(pixels) * 2 * 8 {
            return Ok(Vec::new());
        }
        // The index has already advanced to the next frame, so the last measured frame is now the previous frame.
        let [_, last] = self.memory_slots();
        let words = read_signal(gpu, &self.streams[stream].memory, last, pixels)?;
        Ok(words.into_iter().map(|words| words.map(f32::from_bits)).collect())
    }

    /// Returns a measured picture of a stream, two words per pixel (`shared::signal`). `back`: the number of frames, 0 to 4, by which the picture
    /// precedes the last measured frame.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
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
        self.referenced = [0; 2];
        self.written = [false; 2];
        self.motion.restart();
    }
}

/// Reads `pixels` pixels, two words each (`shared::signal`), from a buffer, starting at pixel `offset`.
///
/// # Errors
/// When the device is lost or reported an error.
pub fn read_signal(gpu: &Gpu, buffer: &wgpu::Buffer, offset: u32, pixels: u32) -> Result<Vec<[u32; 2]>> {
    let [first, end] = [offset, offset + pixels].map(|pixel| u64::from(pixel) * 8);
    Ok(bytemuck::pod_collect_to_vec(&read_ranges(gpu, &[(buffer, first..end)])?))
}

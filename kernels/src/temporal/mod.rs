//! Temporal resolve: combines frames over time, as games do to hide noise. It is off by default, because it hides the noise that Scree measures.
//!
//! *Exponential*: the history is the result of the previous frame. For each pixel, the history is sampled bilinearly at the position that the surface
//! point had one frame before. The sampled colour is clamped to the 3 x 3 colour box of the current frame. The result is nine tenths of the clamped
//! colour and one tenth of the current colour (Karis, *High Quality Temporal Supersampling*, SIGGRAPH 2014).
//! *FlipQuad*: a pixel has four samples, one on each edge, and shares each with the neighbour at this edge. The current frame provides two of the
//! samples, the previous frame the other two (Akenine-Moller, *An Extremely Inexpensive Multisampling Scheme*, 2003; McAuley, *Rendering the World of
//! Far Cry 4*, GDC 2015).
//! A pixel shades one sample per frame. The derivatives for texture filtering are steps of a whole pixel on the plane of the triangle, not
//! differences between samples of neighbouring pixels. So the derivatives of both frames match. Far Cry 4 had to reorder the samples to achieve this.
//!
//! Reads the ring of shaded pictures, the links, the positions that the surface points had one frame before, and the previous history. Writes the
//! ring of resolved pictures and the new history. Dispatch: one workgroup per 8 x 8 pixels.

use std::fmt;
use std::str::FromStr;

use bytemuck::{Pod, Zeroable, bytes_of};

use crate::base::error::{Error, Result};
use crate::base::names::nearest;
use crate::base::wgsl::{Constant, Wgsl};
use crate::gpu::bindings::Binding;
use crate::gpu::{Gpu, ShaderModule};
use crate::motion::{Motion, NO_LINK, Slots};
use crate::shared;

pub mod reference;

/// Share of the current frame in the exponential history.
pub const SHARE: f32 = 0.1;
/// Distance of a FlipQuad sample from the middle of its edge, pixels. With a distance of 1/6 pixel, the four samples of a pixel have four different x
/// coordinates, which are 1/3 pixel apart, and likewise four different y coordinates.
pub const FLIPQUAD_SHIFT: f64 = 1.0 / 6.0;

/// How frames are resolved over time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Resolve {
    /// No resolve: each frame stays as it was shaded.
    #[default]
    Off,
    /// Exponential history, clamped to the 3 x 3 colour box of the current frame.
    Exponential,
    /// FlipQuad: averages four samples on the edges of each pixel. Two of them come from the current frame, two from the previous frame.
    FlipQuad,
    /// FlipQuad, then the exponential history.
    FlipQuadExponential,
}

impl Resolve {
    /// All kinds of resolve.
    pub const ALL: [Resolve; 4] = [Resolve::Off, Resolve::Exponential, Resolve::FlipQuad, Resolve::FlipQuadExponential];

    /// Whether this resolve averages FlipQuad's samples.
    pub const fn has_flipquad(self) -> bool {
        matches!(self, Resolve::FlipQuad | Resolve::FlipQuadExponential)
    }

    /// Whether this resolve keeps an exponential history.
    pub const fn has_history(self) -> bool {
        matches!(self, Resolve::Exponential | Resolve::FlipQuadExponential)
    }

    /// Returns where the samples of a frame lie in their pixels. `frame`: index of the frame.
    pub const fn sample_pattern(self, frame: u32) -> SamplePattern {
        match (self.has_flipquad(), frame.is_multiple_of(2)) {
            (false, _) => SamplePattern::Centre,
            (true, true) => SamplePattern::LeftEdges,
            (true, false) => SamplePattern::TopEdges,
        }
    }

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Resolve::Off => "off",
            Resolve::Exponential => "exponential",
            Resolve::FlipQuad => "flipquad",
            Resolve::FlipQuadExponential => "flipquad+exponential",
        }
    }
}

impl fmt::Display for Resolve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Resolve {
    type Err = Error;

    fn from_str(text: &str) -> Result<Resolve> {
        Resolve::ALL.into_iter().find(|r| r.name() == text).ok_or_else(|| {
            let names = Resolve::ALL.map(Resolve::name);
            let hint = nearest(text, &names).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            Error::Request(format!("`{text}` is not a known temporal resolve: give one of {}{hint}", names.join(", ")))
        })
    }
}

/// Where the sample of a frame lies in its pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum SamplePattern {
    /// At the centre.
    #[default]
    Centre,
    /// In even frames of FlipQuad: on the left edge of the pixel. In even columns, below the middle of the edge; in odd columns, above it.
    LeftEdges,
    /// In odd frames of FlipQuad: on the top edge of the pixel. In even rows, left of the middle of the edge; in odd rows, right of it.
    TopEdges,
}

impl SamplePattern {
    /// The pattern's number in shaders.
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// Returns the position of the sample relative to the centre of a pixel, in pixels. `surface_sample_offset` in `footprint.wgsl` computes the
    /// same.
    pub fn offset(self, pixel: [u32; 2]) -> [f64; 2] {
        let turn = |i: u32| if i.is_multiple_of(2) { FLIPQUAD_SHIFT } else { -FLIPQUAD_SHIFT };
        match self {
            SamplePattern::Centre => [0.0; 2],
            SamplePattern::LeftEdges => [-0.5, turn(pixel[0])],
            SamplePattern::TopEdges => [-turn(pixel[1]), -0.5],
        }
    }

    /// Returns the step from a pixel to the neighbour that provides the second sample of the pixel. FlipQuad shades each pixel at a sample on one of
    /// its edges. The sample on the opposite edge is shaded by the neighbour at that edge. With samples at the centre of pixels, the step is 0.
    const fn neighbour(self) -> [u32; 2] {
        match self {
            SamplePattern::Centre => [0, 0],
            SamplePattern::LeftEdges => [1, 0],
            SamplePattern::TopEdges => [0, 1],
        }
    }
}

/// Uniforms of the resolve pass; the layout matches `TemporalFrame` in `temporal.wgsl`, where the fields are explained.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct TemporalFrame {
    pub size: [u32; 2],
    pub slot: u32,
    pub past_slot: u32,
    pub has_past: u32,
    pub flipquad: u32,
    pub exponential: u32,
    pub share: f32,
    pub neighbour: [u32; 2],
    pub past_neighbour: [u32; 2],
    pub history_in: u32,
    pub history_out: u32,
    pub pad_0: u32,
    pub pad_1: u32,
}

impl TemporalFrame {
    /// Returns the uniforms of frame `index` of a sequence.
    pub fn new(resolve: Resolve, size: [u32; 2], index: u32, slots: &Slots) -> TemporalFrame {
        let pixels = size[0] * size[1];
        TemporalFrame {
            size,
            slot: slots.now,
            past_slot: slots.past[0],
            has_past: u32::from(index > 0),
            flipquad: u32::from(resolve.has_flipquad()),
            exponential: u32::from(resolve.has_history()),
            share: SHARE,
            neighbour: resolve.sample_pattern(index).neighbour(),
            past_neighbour: resolve.sample_pattern(index + 1).neighbour(),
            history_in: (index + 1) % 2 * pixels,
            history_out: index % 2 * pixels,
            pad_0: 0,
            pad_1: 0,
        }
    }
}

static WGSL: Wgsl = Wgsl::new("temporal/temporal.wgsl", include_str!("temporal.wgsl"), &[&shared::SIGNAL])
    .with(&[("TEMPORAL_NO_LINK", Constant::U32(NO_LINK))]);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("temporal", &[&WGSL]);

/// The resolve pass.
pub struct Temporal {
    pipeline: wgpu::ComputePipeline,
    frame_layout: wgpu::BindGroupLayout,
    layout: wgpu::BindGroupLayout,
}

impl Temporal {
    /// Compiles the pass.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu) -> Result<Temporal> {
        let stage = wgpu::ShaderStages::COMPUTE;
        let frame_layout = gpu.layout("resolved frame", stage, &[Binding::Uniform, Binding::Storage, Binding::Storage]);
        let layout = gpu.layout("resolved stream", stage, &[Binding::Storage, Binding::StorageWritten, Binding::StorageWritten]);
        let shader = MODULE.compile(gpu)?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("temporal"),
            layout: Some(&gpu.pipeline_layout("temporal", &[&frame_layout, &layout])),
            module: &shader.module,
            entry_point: Some("temporal_main"),
            compilation_options: Default::default(),
            cache: None,
        });
        Ok(Temporal { pipeline, frame_layout, layout })
    }

    /// Records the resolve of frame `index` of one stream, which is the sequence of pictures of one way to shade. `signal`: the ring buffer of shaded
    /// pictures, which is read. `resolved`: the ring buffer of resolved pictures, and a buffer with the previous history, which is read, and the new
    /// history, which is written.
    #[allow(clippy::too_many_arguments, reason = "everything that a stage reads and writes is an argument")]
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        resolve: Resolve,
        size: [u32; 2],
        index: u32,
        slots: &Slots,
        motion: &Motion,
        signal: &wgpu::Buffer,
        resolved: &[wgpu::Buffer; 2],
    ) {
        let uniform = TemporalFrame::new(resolve, size, index, slots);
        let buffer = gpu.buffer_with("resolved frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniform));
        let buffers = [&buffer, &motion.links, &motion.positions];
        let frame = gpu.group("resolved frame", &self.frame_layout, &buffers.map(|b| b.as_entire_binding()));
        let buffers = [signal, &resolved[0], &resolved[1]];
        let stream = gpu.group("resolved stream", &self.layout, &buffers.map(|b| b.as_entire_binding()));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some("temporal"), timestamp_writes: None });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &frame, &[]);
        pass.set_bind_group(1, &stream, &[]);
        pass.dispatch_workgroups(size[0].div_ceil(8), size[1].div_ceil(8), 1);
    }
}

//! Motion: links from each pixel to the pixels that showed the same surface point 1 to 4 frames earlier.
//!
//! A link holds, for one pixel and one lag (number of frames), the index of the linked pixel. It is [`NO_LINK`] if the pixel shows sky, or if the
//! point was hidden, outside the picture or behind the camera. At lags 2 to 4, only a quarter of the rows is linked; the quarter changes from frame
//! to frame.
//!
//! Reads depth, triangle normals, and the distances of the surface points in earlier frames. Writes the distances in this frame, the links, and, if a
//! temporal resolve needs it, the exact position of each point one frame earlier. Dispatch: one workgroup per 32 x 8 pixels.

use bytemuck::{Pod, Zeroable, bytes_of};

use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, aspect, view};
use crate::gpu::{Gpu, Recording, ShaderModule};
use crate::shared;
use crate::shared::motion::{MotionPast, Past};
use crate::view;
use crate::view::camera::View;

mod links;
pub mod reference;

pub use links::Links;

/// Number of earlier frames with which a frame is compared.
pub const LAGS: usize = 4;
/// Number of pictures in a ring buffer: a frame and the earlier frames with which it is compared.
pub const SLOTS: u32 = 5;
/// The value of a link if no pixel showed the point.
pub const NO_LINK: u32 = u32::MAX;
/// Tolerance of the visibility test: the largest relative difference between the found and the expected depth of a point. Both belong to the pixel of
/// the earlier picture that is nearest to the earlier position of the point. The found depth is the depth that this pixel has. The expected depth is
/// that of the plane of the point's triangle at this pixel.
///
/// Even for visible points, the two depths differ slightly: the stored normal is quantised (an error of at most 0.64 degrees, or 1.9 degrees near
/// edge-on incidence), the ground is curved within half a pixel, and the earlier frame may have drawn the ground with another LOD.
pub const TOLERANCE: f32 = 0.02;

/// Positions in the ring buffers, and the quarter of the rows that this frame uses. A ring buffer holds [`SLOTS`] pictures. An offset is the pixel at
/// which a picture begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slots {
    /// Offset of this frame's picture.
    pub now: u32,
    /// Offsets of the pictures 1 to 4 frames earlier.
    pub past: [u32; LAGS],
    /// Index, 0 to 3, of the quarter of the rows that this frame uses for lags 2 to 4, and for the box test and the histograms of the metrics.
    pub quarter: u32,
}

impl Slots {
    /// Returns the slots of frame `index` of a sequence, for pictures of `pixels` pixels.
    pub fn of(index: u32, pixels: u32) -> Slots {
        let slot = |back: u32| (index % SLOTS + SLOTS - back) % SLOTS * pixels;
        Slots { now: slot(0), past: [slot(1), slot(2), slot(3), slot(4)], quarter: index % 4 }
    }
}

/// The uniforms of the pass; the layout matches `MotionFrame` in `motion.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MotionFrame {
    pub past: [MotionPast; LAGS],
    pub lags: u32,
    pub slot: u32,
    pub tolerance: f32,
    pub quarter: u32,
    pub past_slots: [u32; LAGS],
}

static WGSL: Wgsl = Wgsl::new("motion/motion.wgsl", include_str!("motion.wgsl"), &[&view::WGSL, &shared::MOTION, &shared::VIEW])
    .with(&[("MOTION_NO_LINK", Constant::U32(NO_LINK))]);

/// The shader module of the pass.
pub static MODULE: ShaderModule = ShaderModule::new("motion", &[&WGSL]);

/// The motion pass, and the buffers and views that it keeps from frame to frame.
pub struct Motion {
    pipeline: wgpu::ComputePipeline,
    targets_layout: wgpu::BindGroupLayout,
    layout: wgpu::BindGroupLayout,
    distances: wgpu::Buffer,
    /// Index of the linked pixel, for each lag and pixel; [`NO_LINK`] = there is no linked pixel.
    pub links: wgpu::Buffer,
    /// Position of each pixel's surface point one frame earlier, pixels. Zero if the pass does not write positions.
    pub positions: wgpu::Buffer,
    /// Views of the earlier frames, the latest first.
    views: Vec<View>,
}

impl Motion {
    /// Compiles the pass and allocates its buffers for pictures of `size` pixels. `has_positions`: whether the pass writes the exact positions of the
    /// surface points ([`Motion::positions`]), which only resolves need.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout, size: [u32; 2], has_positions: bool) -> Result<Motion> {
        let stage = wgpu::ShaderStages::COMPUTE;
        let targets_layout = gpu.layout("motion targets", stage, &[Binding::Depth, Binding::TextureLoaded(FLAT)]);
        let written = Binding::StorageWritten;
        let layout = gpu.layout("motion", stage, &[Binding::Uniform, written, written, written]);
        let shader = MODULE.compile(gpu)?;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("motion"),
            layout: Some(&gpu.pipeline_layout("motion", &[frame_layout, &targets_layout, &layout])),
            module: &shader.module,
            entry_point: Some("motion_main"),
            compilation_options: wgpu::PipelineCompilationOptions {
                constants: &[("MOTION_POSITIONS", f64::from(u8::from(has_positions)))],
                ..Default::default()
            },
            cache: None,
        });
        let pixels = u64::from(size[0]) * u64::from(size[1]);
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        Ok(Motion {
            pipeline,
            targets_layout,
            layout,
            distances: gpu.buffer("distances", usage, pixels * u64::from(SLOTS) * 4),
            links: gpu.buffer("links", usage, pixels * LAGS as u64 * 4),
            positions: gpu.buffer("positions", usage, pixels * 8),
            views: Vec::new(),
        })
    }

    /// Number of earlier frames that are available, at most 4.
    pub fn lags(&self) -> u32 {
        u32::try_from(self.views.len()).unwrap_or(0)
    }

    /// Discards the earlier frames, so that no pixel of the next frame is linked to them.
    pub fn restart(&mut self) {
        self.views.clear();
    }

    /// Records the pass for the frame with the view `now`. `slots`: the offsets of this frame and of the earlier frames in the ring
    /// buffers.
    pub fn encode(&self, rec: &mut Recording<'_>, geometry: &geometry::Targets, now: &View, slots: &Slots) {
        let mut uniform = MotionFrame {
            lags: self.lags(),
            slot: slots.now,
            tolerance: TOLERANCE,
            quarter: slots.quarter,
            past_slots: slots.past,
            ..MotionFrame::default()
        };
        for (to, past) in uniform.past.iter_mut().zip(&self.views) {
            *to = Past::between(now, past).uniform();
        }
        let gpu = rec.gpu;
        let buffer = gpu.buffer_with("motion", wgpu::BufferUsages::UNIFORM, bytes_of(&uniform));
        let views = [aspect(&geometry.depth_stencil, wgpu::TextureAspect::DepthOnly), view(&geometry.normals)];
        let targets = gpu.group("motion targets", &self.targets_layout, &views.each_ref().map(wgpu::BindingResource::TextureView));
        let buffers = [&buffer, &self.distances, &self.links, &self.positions];
        let group = gpu.group("motion", &self.layout, &buffers.map(wgpu::Buffer::as_entire_binding));
        let mut pass = rec.compute("motion", &self.pipeline, 1, &[&targets, &group]);
        pass.dispatch_workgroups(now.size[0].div_ceil(32), now.size[1].div_ceil(4 * 2), 1);
    }

    /// Adds the view of a finished frame to the views of the earlier frames.
    pub fn advance(&mut self, done: View) {
        self.views.insert(0, done);
        self.views.truncate(LAGS);
    }
}

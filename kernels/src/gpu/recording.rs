//! Records the passes of a frame. One object holds what the passes share, so a stage receives only its own inputs and outputs as further arguments.

use crate::base::error::Result;
use crate::gpu::bindings::view;
use crate::gpu::{Gpu, PassTime, Timer};

/// The commands of a frame while they are recorded, with the device, the timer, and the bind groups that all stages share.
pub struct Recording<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// The commands since the last [`Recording::submit`].
    pub encoder: wgpu::CommandEncoder,
    /// Times of all passes of the frame.
    pub timer: Timer,
    /// The bind groups that stages share, from index 0: the uniforms of the frame, then the terrain, if it is given.
    groups: &'a [&'a wgpu::BindGroup],
}

impl<'a> Recording<'a> {
    /// Begins a frame. `groups` are the bind groups that stages share. A pass binds the first few of them, from index 0; its argument `shared` is
    /// their number.
    pub fn new(gpu: &'a Gpu, groups: &'a [&'a wgpu::BindGroup]) -> Recording<'a> {
        Recording { gpu, encoder: gpu.encoder("frame"), timer: Timer::new(gpu), groups }
    }

    /// Bind group 0: the uniforms of the frame.
    pub fn frame(&self) -> &'a wgpu::BindGroup {
        self.groups[0]
    }

    /// Begins a timed compute pass with this pipeline. Binds the first `shared` of the groups that stages share, and then the groups `own`.
    pub fn compute(
        &mut self,
        name: &str,
        pipeline: &wgpu::ComputePipeline,
        shared: usize,
        own: &[&wgpu::BindGroup],
    ) -> wgpu::ComputePass<'_> {
        let mut pass =
            self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(name), timestamp_writes: self.timer.compute(name) });
        pass.set_pipeline(pipeline);
        bound(self.groups, shared, own).for_each(|(index, group)| pass.set_bind_group(index, group, &[]));
        pass
    }

    /// Begins a timed render pass into `colours`. Binds groups as [`Recording::compute`] does.
    pub fn render(
        &mut self,
        name: &str,
        colours: &[&wgpu::TextureView],
        load: wgpu::LoadOp<wgpu::Color>,
        depth_stencil: Option<wgpu::RenderPassDepthStencilAttachment<'_>>,
        shared: usize,
        own: &[&wgpu::BindGroup],
    ) -> wgpu::RenderPass<'_> {
        let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
        let attachments: Vec<_> = colours
            .iter()
            .map(|view| Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops }))
            .collect();
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(name),
            color_attachments: &attachments,
            depth_stencil_attachment: depth_stencil,
            timestamp_writes: self.timer.render(name),
            ..Default::default()
        });
        bound(self.groups, shared, own).for_each(|(index, group)| pass.set_bind_group(index, group, &[]));
        pass
    }

    /// Records a timed full-screen triangle into `target`, which is cleared first.
    pub fn full_screen(
        &mut self,
        name: &str,
        pipeline: &wgpu::RenderPipeline,
        target: &wgpu::Texture,
        shared: usize,
        own: &[&wgpu::BindGroup],
    ) {
        let mut pass = self.render(name, &[&view(target)], CLEAR, None, shared, own);
        pass.set_pipeline(pipeline);
        pass.draw(0..3, 0..1);
    }

    /// Submits the commands recorded so far, and waits for the device. Recording continues with an empty encoder.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn submit(&mut self) -> Result<()> {
        let recorded = std::mem::replace(&mut self.encoder, self.gpu.encoder("frame"));
        self.gpu.submit_and_wait(recorded)
    }

    /// Submits the rest of the frame, and waits for the device. Returns the times of all passes.
    ///
    /// # Errors
    /// When the device is lost or reported an error, or when there were more passes than a timer holds.
    pub fn finish(mut self) -> Result<Vec<PassTime>> {
        self.timer.resolve(&mut self.encoder);
        self.gpu.submit_and_wait(self.encoder)?;
        self.timer.read(self.gpu)
    }
}

/// Returns the bind groups of a pass with their indices: the first `shared` of `groups`, and then `own`.
fn bound<'g>(
    groups: &'g [&'g wgpu::BindGroup],
    shared: usize,
    own: &'g [&'g wgpu::BindGroup],
) -> impl Iterator<Item = (u32, &'g wgpu::BindGroup)> {
    (0..).zip(groups[..shared].iter().chain(own).copied())
}

/// Clears a colour target to 0.
pub const CLEAR: wgpu::LoadOp<wgpu::Color> = wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT);

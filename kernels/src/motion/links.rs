//! Links each pixel to the pixel that showed the same surface point one frame earlier, and reads the links back.

use super::{Motion, Slots};
use crate::base::error::Result;
use crate::geometry;
use crate::gpu::{Gpu, Recording, read_buffer};
use crate::view::camera::View;

/// Links each pixel to the pixel that showed the same surface point one frame earlier.
pub struct Links {
    motion: Motion,
    size: [u32; 2],
    index: u32,
}

impl Links {
    /// Compiles the motion pass and allocates its buffers for pictures of `size` pixels.
    ///
    /// # Errors
    /// When the shader does not compile or the device is out of memory.
    pub fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout, size: [u32; 2]) -> Result<Links> {
        let motion = Motion::new(gpu, frame_layout, size, false)?;
        gpu.check()?;
        Ok(Links { motion, size, index: 0 })
    }

    /// Size of the pictures, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Returns, for each pixel, the index of the pixel that showed the same surface point in the picture of the previous call;
    /// [`NO_LINK`](super::NO_LINK) = the point was not visible there. `frame`: the bind group of the uniforms of the frame. `geometry`: the results
    /// of the geometry pass. `now`: the view of the picture. Waits for the device.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn find(&mut self, gpu: &Gpu, frame: &wgpu::BindGroup, geometry: &geometry::Targets, now: View) -> Result<Vec<u32>> {
        let pixels = self.size[0] * self.size[1];
        let groups = [frame];
        let mut rec = Recording::new(gpu, &groups);
        self.motion.encode(&mut rec, geometry, &now, &Slots::of(self.index, pixels));
        rec.submit()?;
        let bytes = read_buffer(gpu, &self.motion.links, u64::from(pixels) * 4)?;
        self.motion.advance(now);
        self.index = self.index.wrapping_add(1);
        Ok(bytemuck::pod_collect_to_vec(&bytes))
    }
}

//! Reads GPU memory back to the host.

use std::ops::Range;

use crate::base::error::{Error, Result};
use crate::gpu::Gpu;

/// Reads the first `size` bytes of a buffer with usage `COPY_SRC`. `size` is rounded up to a multiple of 4. Waits for the device.
///
/// # Errors
/// When the device is lost or reported an error.
pub fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>> {
    read_ranges(gpu, &[(buffer, 0..size.next_multiple_of(4))])
}

/// Reads ranges of buffers with usage `COPY_SRC`, and returns their bytes one after another. The bounds of a range are bytes and multiples of 4.
/// Waits for the device once, because each wait costs time.
///
/// # Errors
/// When the device is lost or reported an error.
pub fn read_ranges(gpu: &Gpu, ranges: &[(&wgpu::Buffer, Range<u64>)]) -> Result<Vec<u8>> {
    let bytes: u64 = ranges.iter().map(|(_, range)| range.end - range.start).sum();
    if bytes == 0 {
        return Ok(Vec::new());
    }
    let staging = staging(gpu, bytes);
    let mut encoder = gpu.encoder("read-back");
    let mut at = 0;
    for (buffer, range) in ranges {
        let size = range.end - range.start;
        encoder.copy_buffer_to_buffer(buffer, range.start, &staging, at, size);
        at += size;
    }
    wait(gpu, encoder, std::slice::from_ref(&staging))?;
    mapped(&staging, |bytes| bytes.to_vec())
}

/// Reads all texels of mip level 0, layer 0, in tightly packed rows. `bytes_per_texel` is the texel size of the format. Waits for
/// the device.
///
/// # Errors
/// When the device is lost or reported an error.
pub fn read_texture(gpu: &Gpu, texture: &wgpu::Texture, aspect: wgpu::TextureAspect, bytes_per_texel: u32) -> Result<Vec<u8>> {
    let mut reading = TextureReading::default();
    reading.add(texture, aspect, bytes_per_texel);
    Ok(reading.run(gpu)?.remove(0))
}

/// Textures that are read back together, because each wait for the device costs time.
#[derive(Default)]
pub struct TextureReading<'t> {
    textures: Vec<(&'t wgpu::Texture, wgpu::TextureAspect, u32)>,
}

impl<'t> TextureReading<'t> {
    /// Adds mip level 0, layer 0 of a texture. Returns the index of its texels in the result of [`TextureReading::run`].
    pub fn add(&mut self, texture: &'t wgpu::Texture, aspect: wgpu::TextureAspect, bytes_per_texel: u32) -> usize {
        self.textures.push((texture, aspect, bytes_per_texel));
        self.textures.len() - 1
    }

    /// Reads all added textures. Returns the texels of each texture, in tightly packed rows. Waits for the device once.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn run(self, gpu: &Gpu) -> Result<Vec<Vec<u8>>> {
        let mut encoder = gpu.encoder("read-back");
        let padded = |width: u32, bytes: u32| (width * bytes).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffers: Vec<wgpu::Buffer> = self
            .textures
            .iter()
            .map(|&(texture, aspect, bytes)| {
                let (width, height) = (texture.width(), texture.height());
                let row = padded(width, bytes);
                let staging = staging(gpu, u64::from(row) * u64::from(height));
                encoder.copy_texture_to_buffer(
                    wgpu::TexelCopyTextureInfo { texture, mip_level: 0, origin: wgpu::Origin3d::ZERO, aspect },
                    wgpu::TexelCopyBufferInfo {
                        buffer: &staging,
                        layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
                    },
                    wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
                );
                staging
            })
            .collect();
        wait(gpu, encoder, &buffers)?;
        let read = self.textures.iter().zip(&buffers).map(|(&(texture, _, bytes), staging)| {
            let row = (texture.width() * bytes) as usize;
            mapped(staging, |texels| {
                let mut packed = Vec::with_capacity(row * texture.height() as usize);
                texels.chunks(padded(texture.width(), bytes) as usize).for_each(|line| packed.extend_from_slice(&line[..row]));
                packed
            })
        });
        read.collect()
    }
}

fn staging(gpu: &Gpu, size: u64) -> wgpu::Buffer {
    gpu.buffer("read-back", wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ, size)
}

/// Submits the copies into staging buffers, and waits until the buffers are mapped.
fn wait(gpu: &Gpu, encoder: wgpu::CommandEncoder, buffers: &[wgpu::Buffer]) -> Result<()> {
    gpu.queue.submit([encoder.finish()]);
    for buffer in buffers {
        buffer.map_async(wgpu::MapMode::Read, .., |_| {});
    }
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| Error::Gpu(e.to_string()))?;
    gpu.check()
}

fn mapped<T>(staging: &wgpu::Buffer, read: impl FnOnce(&[u8]) -> T) -> Result<T> {
    let view = staging.get_mapped_range(..).map_err(|e| Error::Gpu(format!("read-back failed: {e}")))?;
    Ok(read(&view))
}

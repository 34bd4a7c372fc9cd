//! Reads GPU memory back to the host.

use crate::base::error::{Error, Result};
use crate::gpu::Gpu;

/// Reads the first `size` bytes of a buffer with usage `COPY_SRC`. Waits for the device.
///
/// # Errors
/// When the device is lost.
pub fn read_buffer(gpu: &Gpu, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>> {
    let size = size.next_multiple_of(4);
    let staging = gpu.buffer("read-back", wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ, size);
    let mut encoder = gpu.encoder("read-back");
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
    map(gpu, encoder, &staging)
}

/// Reads all texels of mip level 0, layer 0, in tightly packed rows. `bytes_per_texel` is that of the format. Waits for the device.
///
/// # Errors
/// When the device is lost.
pub fn read_texture(gpu: &Gpu, texture: &wgpu::Texture, aspect: wgpu::TextureAspect, bytes_per_texel: u32) -> Result<Vec<u8>> {
    let (width, height) = (texture.width(), texture.height());
    let row = width * bytes_per_texel;
    let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let staging =
        gpu.buffer("read-back", wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ, u64::from(padded) * u64::from(height));
    let mut encoder = gpu.encoder("read-back");
    encoder.copy_texture_to_buffer(
        wgpu::TexelCopyTextureInfo { texture, mip_level: 0, origin: wgpu::Origin3d::ZERO, aspect },
        wgpu::TexelCopyBufferInfo {
            buffer: &staging,
            layout: wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(padded), rows_per_image: None },
        },
        wgpu::Extent3d { width, height, depth_or_array_layers: 1 },
    );
    let bytes = map(gpu, encoder, &staging)?;
    Ok(bytes.chunks(padded as usize).flat_map(|line| &line[..row as usize]).copied().collect())
}

fn map(gpu: &Gpu, encoder: wgpu::CommandEncoder, staging: &wgpu::Buffer) -> Result<Vec<u8>> {
    gpu.queue.submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., |_| {});
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| Error::Gpu(e.to_string()))?;
    gpu.check()?;
    let view = staging.get_mapped_range(..).map_err(|e| Error::Gpu(format!("read-back failed: {e}")))?;
    Ok(view.to_vec())
}

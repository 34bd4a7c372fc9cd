//! Uploads texels to the device.

use crate::gpu::Gpu;

/// Writes one mip level of one layer of a square texture. `bytes`: the texels, tightly packed.
pub fn upload(gpu: &Gpu, texture: &wgpu::Texture, layer: u32, mip_level: u32, bytes: &[u8]) {
    let format = texture.format();
    let (block, _) = format.block_dimensions();
    let block_bytes = format.block_copy_size(None).unwrap_or(1);
    let texels = (texture.width() >> mip_level).max(1).next_multiple_of(block);
    let blocks = texels / block;
    gpu.queue.write_texture(
        wgpu::TexelCopyTextureInfo {
            texture,
            mip_level,
            origin: wgpu::Origin3d { x: 0, y: 0, z: layer },
            aspect: wgpu::TextureAspect::All,
        },
        bytes,
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(blocks * block_bytes), rows_per_image: Some(blocks) },
        wgpu::Extent3d { width: texels, height: texels, depth_or_array_layers: 1 },
    );
}

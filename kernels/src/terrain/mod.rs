//! Terrain data as shaders see it: atlases, sector data, palette, detail arrays, in one bind group that the geometry,
//! virtual-texture and shading stages share.
//!
//! Source: Moore, GDC 2018, "Terrain Sector Data", "Terrain Foreground Rendering".

use bytemuck::{Zeroable, cast_slice};

use crate::gpu::Gpu;
use crate::gpu::bindings::{ARRAY, Binding, array};
use crate::materials::{CompressedChain, MAX_MATERIALS, Palette, PaletteEntry};
use crate::quadtree;
use crate::streaming::{Streaming, upload};
use crate::world::{NodeId, PaletteMeans, SECTORS};

/// The WGSL of this module.
pub const WGSL: (&str, &str) = ("terrain/terrain.wgsl", include_str!("terrain.wgsl"));
/// World position and derivatives of a pixel of the geometry pass.
pub const FOOTPRINT_WGSL: (&str, &str) = ("terrain/footprint.wgsl", include_str!("footprint.wgsl"));

/// The bind group and what it holds besides the atlases.
pub struct Terrain {
    /// Layout of group 1 of the stages that read terrain.
    pub layout: wgpu::BindGroupLayout,
    /// Group 1.
    pub group: wgpu::BindGroup,
    sector_data: wgpu::Buffer,
}

fn detail_array(gpu: &Gpu, label: &str, chains: &[CompressedChain], format: wgpu::TextureFormat) -> wgpu::Texture {
    let (size, levels) = chains.first().map_or((4, 1), |c| (c.size, c.levels.len()));
    // A level smaller than a block cannot be addressed by every driver as part of a chain whose base is larger; wgpu pads it.
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: size, height: size, depth_or_array_layers: u32::try_from(chains.len().max(1)).unwrap_or(1) },
        mip_level_count: u32::try_from(levels).unwrap_or(1),
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    for (layer, chain) in (0..).zip(chains) {
        for (level, blocks) in (0..).zip(&chain.levels) {
            upload(gpu, &texture, layer, level, blocks);
        }
    }
    texture
}

/// The palette's means in the form that baking wants.
pub fn palette_means(palette: &Palette) -> PaletteMeans {
    PaletteMeans {
        albedo: palette.means.iter().map(|m| m.albedo).collect(),
        smoothness: palette.means.iter().map(|m| m.smoothness).collect(),
        specular_occlusion: palette.means.iter().map(|m| m.specular_occlusion).collect(),
    }
}

impl Terrain {
    /// Uploads palette and detail arrays and binds them with the atlases.
    pub fn new(gpu: &Gpu, streaming: &Streaming, palette: &Palette, anisotropy: u16) -> Terrain {
        use wgpu::TextureFormat as Format;
        let layout = gpu.layout(
            "terrain",
            wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE,
            &[
                Binding::TextureLoaded(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Texture(ARRAY),
                Binding::TextureUint(ARRAY),
                Binding::Storage,
                Binding::Uniform,
                Binding::Texture(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Texture(ARRAY),
                Binding::Sampler,
                Binding::Sampler,
            ],
        );
        let sectors = u64::from(SECTORS) * u64::from(SECTORS);
        let sector_data = gpu.buffer("sector data", wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST, sectors * 8);
        let mut all = palette.entries.clone();
        all.resize(MAX_MATERIALS, PaletteEntry::zeroed());
        let entries = gpu.buffer_with("palette", wgpu::BufferUsages::UNIFORM, cast_slice(&all));
        let details = [
            detail_array(gpu, "detail albedo", &palette.arrays.albedo, Format::Bc1RgbaUnormSrgb),
            detail_array(gpu, "detail normal", &palette.arrays.normal, Format::Bc3RgbaUnorm),
            detail_array(gpu, "detail height", &palette.arrays.height, Format::Bc1RgbaUnorm),
        ];
        let detail_sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("detail"),
            address_mode_u: wgpu::AddressMode::Repeat,
            address_mode_v: wgpu::AddressMode::Repeat,
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            mipmap_filter: wgpu::MipmapFilterMode::Linear,
            anisotropy_clamp: anisotropy,
            ..Default::default()
        });
        let atlas_sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
            label: Some("atlas"),
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        let atlases = [&streaming.height, &streaming.normal, &streaming.albedo, &streaming.colour_modulation, &streaming.splat].map(array);
        let detail_views = details.each_ref().map(array);
        let texture = wgpu::BindingResource::TextureView;
        let group = gpu.group(
            "terrain",
            &layout,
            &[
                texture(&atlases[0]),
                texture(&atlases[1]),
                texture(&atlases[2]),
                texture(&atlases[3]),
                texture(&atlases[4]),
                sector_data.as_entire_binding(),
                entries.as_entire_binding(),
                texture(&detail_views[0]),
                texture(&detail_views[1]),
                texture(&detail_views[2]),
                wgpu::BindingResource::Sampler(&detail_sampler),
                wgpu::BindingResource::Sampler(&atlas_sampler),
            ],
        );
        Terrain { layout, group, sector_data }
    }

    /// Tells shaders which nodes this frame may read. Only the frame's own nodes, never what else is still resident: a picture
    /// must not depend on what was looked at before.
    pub fn update(&self, gpu: &Gpu, nodes: impl Iterator<Item = (NodeId, u32)>) {
        gpu.queue.write_buffer(&self.sector_data, 0, cast_slice(&quadtree::sector_data(nodes)));
    }
}

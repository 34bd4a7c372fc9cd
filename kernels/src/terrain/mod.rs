//! Terrain data for shaders: atlases, sector data, palette and detail arrays, in one bind group. The stages geometry, virtual texture, shading and
//! inspection share this group.
//!
//! Source: Moore, GDC 2018, "Terrain Sector Data", "Terrain Foreground Rendering".

use bytemuck::{Zeroable, cast_slice};

use crate::base::wgsl::{Constant, Wgsl};
use crate::gpu::bindings::{ARRAY, Binding, array};
use crate::gpu::uses::TextureUse;
use crate::gpu::{Gpu, upload};
use crate::materials::{CompressedChain, MAX_MATERIALS, Palette, PaletteEntry};
use crate::quadtree;
use crate::residency::Streaming;
use crate::scene::demands::Demands;
use crate::shared;
use crate::view;
use crate::world::{LODS, NodeId, PaletteMeans, SECTORS};

pub mod reference;

/// WGSL functions that find the node, the splat texels and the texels of materials at a position, and that blend materials.
pub static WGSL: Wgsl = Wgsl::new(
    "terrain/terrain.wgsl",
    include_str!("terrain.wgsl"),
    &[
        &view::WGSL,
        &shared::HEX_TILING,
        &shared::LAYERS,
        &shared::SNAPPED_PROJECTION,
        &shared::SPLAT_BLEND,
        &shared::TEXEL_CHOICE,
        &shared::TILING,
    ],
)
.with(&[
    ("TERRAIN_SECTORS", Constant::I32(SECTORS as i32)),
    ("TERRAIN_LODS", Constant::U32(LODS as u32)),
    ("TERRAIN_SLOT_BITS", Constant::U32(quadtree::SLOT_BITS)),
]);
/// WGSL functions that compute the world position and its derivatives from the results of the geometry pass.
pub static FOOTPRINT_WGSL: Wgsl =
    Wgsl::new("terrain/footprint.wgsl", include_str!("footprint.wgsl"), &[&WGSL, &view::WGSL, &shared::DERIVATIVES, &shared::VIEW]);

/// The bind group of the terrain data, and its resources except the atlases.
pub struct Terrain {
    /// Layout of group 1 of the stages that read terrain.
    pub layout: wgpu::BindGroupLayout,
    /// Bind group 1.
    pub group: wgpu::BindGroup,
    resources: Resources,
}

/// The resources of the bind group of the terrain data, except the atlases.
struct Resources {
    sector_data: wgpu::Buffer,
    entries: wgpu::Buffer,
    /// Detail textures: albedo, normal, height.
    details: [wgpu::Texture; 3],
    /// The sampler of detail textures, and the sampler of atlases.
    samplers: [wgpu::Sampler; 2],
}

fn detail_array(gpu: &Gpu, label: &str, chains: &[CompressedChain], format: wgpu::TextureFormat) -> wgpu::Texture {
    let (size, levels) = chains.first().map_or((4, 1), |c| (c.size, c.levels.len()));
    // The smallest mip levels have fewer texels than a compressed block of 4 x 4. They are allocated and uploaded as whole blocks, as WebGPU
    // specifies ("physical miplevel-specific texture extent").
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
        upload_chain(gpu, &texture, layer, chain);
    }
    texture
}

fn upload_chain(gpu: &Gpu, texture: &wgpu::Texture, layer: u32, chain: &CompressedChain) {
    for (level, blocks) in (0..).zip(&chain.levels) {
        upload(gpu, texture, layer, level, blocks);
    }
}

/// Formats of the detail textures: albedo, normal, height.
const DETAIL_FORMATS: [wgpu::TextureFormat; 3] =
    [wgpu::TextureFormat::Bc1RgbaUnormSrgb, wgpu::TextureFormat::Bc3RgbaUnorm, wgpu::TextureFormat::Bc1RgbaUnorm];

fn detail_arrays(gpu: &Gpu, palette: &Palette) -> [wgpu::Texture; 3] {
    let [albedo, normal, height] = DETAIL_FORMATS;
    [
        detail_array(gpu, "detail albedo", &palette.arrays.albedo, albedo),
        detail_array(gpu, "detail normal", &palette.arrays.normal, normal),
        detail_array(gpu, "detail height", &palette.arrays.height, height),
    ]
}

/// Returns the palette as a table with an entry for every possible value of a splat texel. Entries without a material are zeros.
fn table(palette: &Palette) -> Vec<PaletteEntry> {
    let mut all = palette.entries.clone();
    all.resize(MAX_MATERIALS, PaletteEntry::zeroed());
    all
}

/// Returns the mean albedo, smoothness and specular occlusion of each material of a palette, in the form that baking needs.
pub fn palette_means(palette: &Palette) -> PaletteMeans {
    PaletteMeans {
        albedo: palette.means.iter().map(|m| m.albedo).collect(),
        smoothness: palette.means.iter().map(|m| m.smoothness).collect(),
        specular_occlusion: palette.means.iter().map(|m| m.specular_occlusion).collect(),
    }
}

/// Returns the detail textures that a scene needs. They exist even if no flavour of the scene samples them, because errors are measured against the
/// reference blend, which samples them.
pub fn textures(demands: &Demands) -> Vec<TextureUse> {
    let textured = "cliffs, splat, pages, and the reference blend, against which errors are measured";
    let [full, half] = [demands.detail_size, demands.detail_size / 2];
    let array = |name, format, edge: u32| TextureUse::new(name, format, edge, edge.max(1).ilog2() + 1, demands.detail_layers, textured);
    let [albedo, normal, height] = DETAIL_FORMATS;
    vec![array("detail albedo", albedo, full), array("detail normal", normal, full), array("detail height", height, half)]
}

impl Terrain {
    /// Uploads palette and detail arrays and binds them with the atlases. `anisotropy`: largest anisotropy of the sampler of detail textures, 1..=16.
    pub fn new(gpu: &Gpu, streaming: &Streaming, palette: &Palette, anisotropy: u16) -> Terrain {
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
        let entries = gpu.buffer_with("palette", wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST, cast_slice(&table(palette)));
        let details = detail_arrays(gpu, palette);
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
        let resources = Resources { sector_data, entries, details, samplers: [detail_sampler, atlas_sampler] };
        Terrain { group: resources.bound(gpu, &layout, streaming), layout, resources }
    }

    /// Replaces the palette from the next frame on. `fresh`: indices of the layers to upload ([`Palette::fresh_layers`]); `None` = the number or
    /// the size of the layers has changed, so all arrays are allocated and uploaded again.
    pub fn replace_palette(&mut self, gpu: &Gpu, streaming: &Streaming, palette: &Palette, fresh: Option<&[usize]>) {
        gpu.queue.write_buffer(&self.resources.entries, 0, cast_slice(&table(palette)));
        let Some(fresh) = fresh else {
            self.resources.details = detail_arrays(gpu, palette);
            self.group = self.resources.bound(gpu, &self.layout, streaming);
            return;
        };
        let arrays = [&palette.arrays.albedo, &palette.arrays.normal, &palette.arrays.height];
        for (texture, chains) in self.resources.details.iter().zip(arrays) {
            for &layer in fresh {
                upload_chain(gpu, texture, u32::try_from(layer).unwrap_or(0), &chains[layer]);
            }
        }
    }

    /// Writes the sector data, through which shaders find nodes. `nodes` are the nodes of this frame, each with its atlas slot. Other resident nodes
    /// are left out, because a picture must not depend on what was viewed before.
    pub fn update(&self, gpu: &Gpu, nodes: impl Iterator<Item = (NodeId, u32)>) {
        gpu.queue.write_buffer(&self.resources.sector_data, 0, cast_slice(&quadtree::sector_data(nodes)));
    }
}

impl Resources {
    fn bound(&self, gpu: &Gpu, layout: &wgpu::BindGroupLayout, streaming: &Streaming) -> wgpu::BindGroup {
        let atlases = [&streaming.height, &streaming.normal, &streaming.albedo, &streaming.colour_modulation, &streaming.splat].map(array);
        let detail_views = self.details.each_ref().map(array);
        let texture = wgpu::BindingResource::TextureView;
        gpu.group(
            "terrain",
            layout,
            &[
                texture(&atlases[0]),
                texture(&atlases[1]),
                texture(&atlases[2]),
                texture(&atlases[3]),
                texture(&atlases[4]),
                self.sector_data.as_entire_binding(),
                self.entries.as_entire_binding(),
                texture(&detail_views[0]),
                texture(&detail_views[1]),
                texture(&detail_views[2]),
                wgpu::BindingResource::Sampler(&self.samplers[0]),
                wgpu::BindingResource::Sampler(&self.samplers[1]),
            ],
        )
    }
}

//! Classification: finds the shader variant of each tile (8 x 8 pixels; optionally 4 x 4 or 16 x 16). The mask of a pixel has one bit for each
//! flavour (way to shade) that the pixel needs. The variant of a tile is the OR of the masks of its pixels (ruling 4 in `ARCHITECTURE.md`). The
//! results are a tile list and indirect arguments for each variant, and for all tiles with terrain.
//!
//! Reads mask and stencil. Writes 32 tile lists (0 = every terrain tile, 1..=31 = the variants) and 32 indirect draws, see [`tile_vertices`]. One
//! workgroup per tile. Source: Moore, GDC 2018, "Terrain Classification Pass".

use bytemuck::cast_slice;

use crate::base::error::Result;
use crate::base::section::{Section, row};
use crate::base::wgsl::{Constant, Wgsl};
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, aspect, view};
use crate::gpu::uses::PassUse;
use crate::gpu::{Gpu, Recording, ShaderModule, constants, read_buffer};
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::variant::Variant;
use crate::view;

pub mod reference;

/// Edge length of a tile, pixels: the default, as in Far Cry 5.
pub const TILE: u32 = 8;
/// Possible edge lengths of a tile, pixels. Experiments vary this length to measure how the cost depends on it.
pub const TILES: [u32; 3] = [4, 8, 16];
/// Number of bits that hold the tile's column in an entry of a tile list. The tile's row has the same number of bits.
pub const TILE_COORDINATE_BITS: u32 = 12;
/// Number of tile lists: one with every terrain tile, and one per variant.
pub const LISTS: u32 = 32;
/// Bytes of one list's indirect draw arguments.
pub const ARGUMENT_BYTES: u64 = 16;

/// Columns and rows of the tiles that cover a picture, for tiles with the default edge length [`TILE`].
pub fn tiles(size: [u32; 2]) -> [u32; 2] {
    tiles_of(size, TILE)
}

/// Columns and rows of the tiles that cover a picture. `tile`: edge length of a tile, pixels.
pub fn tiles_of(size: [u32; 2], tile: u32) -> [u32; 2] {
    size.map(|n| n.div_ceil(tile))
}

/// Number of vertices that shading draws per tile: 3 if the device can clamp depth instead of clipping it, else 6.
///
/// With 6 vertices, a tile is two triangles that share a diagonal. Devices shade pixels in quads (2 x 2 pixels), so each quad on the
/// diagonal is shaded twice. With 3 vertices, one triangle contains the tile. The triangle also covers pixels outside the tile, but its
/// depth at those pixels fails the depth test, which runs before shading.
pub fn tile_vertices(gpu: &Gpu) -> u32 {
    if gpu.features.contains(wgpu::Features::DEPTH_CLIP_CONTROL) { 3 } else { 6 }
}

/// Results of the classification pass.
pub struct Lists {
    /// 32 lists of packed tiles (x | y << 12 | mask << 24), each with room for every tile.
    pub tiles: wgpu::Buffer,
    /// 32 indirect draws.
    pub arguments: wgpu::Buffer,
    count: u32,
    tiles_xy: [u32; 2],
}

impl Lists {
    /// Allocates the lists for a picture of `size` pixels. `tile`: edge length of a tile, pixels.
    pub fn new(gpu: &Gpu, size: [u32; 2], tile: u32) -> Lists {
        let tiles_xy = tiles_of(size, tile);
        let [x, y] = tiles_xy;
        let count = x * y;
        let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        Lists {
            tiles: gpu.buffer("tile lists", usage, u64::from(count * LISTS) * 4),
            arguments: gpu.buffer("tile draws", usage | wgpu::BufferUsages::INDIRECT, u64::from(LISTS) * ARGUMENT_BYTES),
            count,
            tiles_xy,
        }
    }

    /// Returns the number of tiles in each list. The commands of the pass must have been submitted before.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read_counts(&self, gpu: &Gpu) -> Result<[u32; LISTS as usize]> {
        let words: Vec<[u32; 4]> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.arguments, u64::from(LISTS) * ARGUMENT_BYTES)?);
        Ok(std::array::from_fn(|i| words[i][1]))
    }

    /// Returns the packed tiles of every list, in the order in which they were appended (no result may depend on this order).
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read(&self, gpu: &Gpu) -> Result<Vec<Vec<u32>>> {
        let counts = self.read_counts(gpu)?;
        let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &self.tiles, u64::from(self.count * LISTS) * 4)?);
        Ok(words.chunks_exact(self.count as usize).zip(counts).map(|(list, n)| list[..n as usize].to_vec()).collect())
    }
}

/// The classification pass.
pub struct Classification {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
    /// Number of tiles in each list, as last read by `read_counts`.
    counts: [u32; LISTS as usize],
}

/// WGSL functions that pack and unpack the entries of tile lists.
pub static TILE_WGSL: Wgsl = Wgsl::new("classification/tile.wgsl", include_str!("tile.wgsl"), &[])
    .with(&[("TILE_ROW_SHIFT", Constant::U32(TILE_COORDINATE_BITS)), ("TILE_MASK_SHIFT", Constant::U32(2 * TILE_COORDINATE_BITS))]);

static WGSL: Wgsl = Wgsl::new("classification/classification.wgsl", include_str!("classification.wgsl"), &[&view::WGSL, &TILE_WGSL]);
static PLAIN: Wgsl = Wgsl::new("classification/plain.wgsl", include_str!("plain.wgsl"), &[&WGSL]);
static SUBGROUP: Wgsl = Wgsl::new("classification/subgroup.wgsl", include_str!("subgroup.wgsl"), &[&WGSL]);

/// The stage's shader module, with workgroup atomics.
pub static PLAIN_MODULE: ShaderModule = ShaderModule::new("classification, plain", &[&PLAIN]);
/// The stage's shader module, with subgroup operations.
pub static SUBGROUP_MODULE: ShaderModule = ShaderModule::new("classification, subgroups", &[&SUBGROUP]);

/// The module with subgroup operations if the device has them, else the one with atomics.
fn module(gpu: &Gpu) -> &'static ShaderModule {
    if gpu.features.contains(wgpu::Features::SUBGROUP) { &SUBGROUP_MODULE } else { &PLAIN_MODULE }
}

/// The section that reports the tiles of a frame. `counts`: the number of tiles with terrain, then the number of tiles of each variant.
fn tiles_section(counts: &[u32; LISTS as usize]) -> Section {
    let all = counts[0];
    let mut rows = vec![row("Tiles with terrain", all)];
    for variant in Variant::all() {
        let tiles = counts[usize::from(variant.mask())];
        if tiles > 0 {
            let share = 100.0 * f64::from(tiles) / f64::from(all.max(1));
            rows.push(row(&format!("    {variant}"), format!("{tiles} ({share:.1} %)")));
        }
    }
    Section {
        name: "Tiles",
        about: "Classification: a tile runs the variant that has exactly the flavours its pixels need, or the forced variant",
        rows,
    }
}

impl Stage for Classification {
    const DECLARATION: Declaration = Declaration {
        passes: |_| vec![PassUse::new("classification", 1, "tile list per variant")],
        name: "classification",
        about: "Reads mask and stencil; writes a tile list and indirect arguments for each variant",
        modules: &[&SUBGROUP_MODULE, &PLAIN_MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = Lists;

    fn targets(canvas: Canvas<'_>) -> Lists {
        Lists::new(canvas.gpu, canvas.size, canvas.tile)
    }

    fn build(build: Build<'_>) -> Result<Classification> {
        Classification::new(build.gpu, build.frame, build.tile)
    }

    fn modules(build: Build<'_>) -> Vec<&'static ShaderModule> {
        vec![module(build.gpu)]
    }

    fn section(&self) -> Option<Section> {
        Some(tiles_section(&self.counts))
    }
}

impl Classification {
    /// Compiles the pass. `tile`: edge length of a tile, pixels.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout, tile: u32) -> Result<Classification> {
        let shader = module(gpu).compile(gpu)?;
        let layout = gpu.layout(
            "classification",
            wgpu::ShaderStages::COMPUTE,
            &[Binding::TextureUint(FLAT), Binding::TextureUint(FLAT), Binding::StorageWritten, Binding::StorageWritten],
        );
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("classification"),
            layout: Some(&gpu.pipeline_layout("classification", &[frame_layout, &layout])),
            module: &shader.module,
            entry_point: Some("classification_main"),
            compilation_options: constants(&[("TILE", f64::from(tile))]),
            cache: None,
        });
        Ok(Classification { pipeline, layout, counts: [0; LISTS as usize] })
    }

    /// Number of tiles in each tile list of the last submitted frame.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn read_counts(&mut self, gpu: &Gpu, lists: &Lists) -> Result<[u32; LISTS as usize]> {
        self.counts = lists.read_counts(gpu)?;
        Ok(self.counts)
    }

    /// Records the pass.
    pub fn encode(&self, rec: &mut Recording<'_>, targets: &geometry::Targets, lists: &Lists) {
        let empty: Vec<[u32; 4]> = vec![[tile_vertices(rec.gpu), 0, 0, 0]; LISTS as usize];
        rec.gpu.queue.write_buffer(&lists.arguments, 0, cast_slice(&empty));
        let group = rec.gpu.group(
            "classification",
            &self.layout,
            &[
                wgpu::BindingResource::TextureView(&view(&targets.mask)),
                wgpu::BindingResource::TextureView(&aspect(&targets.depth_stencil, wgpu::TextureAspect::StencilOnly)),
                lists.tiles.as_entire_binding(),
                lists.arguments.as_entire_binding(),
            ],
        );
        let [x, y] = lists.tiles_xy;
        rec.compute("classification", &self.pipeline, 1, &[&group]).dispatch_workgroups(x, y, 1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_reported_by_variant_with_their_share() {
        let mut counts = [0; LISTS as usize];
        (counts[0], counts[1], counts[17]) = (8, 6, 2);
        let rows = tiles_section(&counts).rows;
        let rows: Vec<(&str, &str)> = rows.iter().map(|(name, value)| (name.trim(), value.as_str())).collect();
        assert_eq!(rows, [("Tiles with terrain", "8"), ("vt", "6 (75.0 %)"), ("vt+splat", "2 (25.0 %)")]);
    }
}

//! Node payloads in GPU memory: one atlas each for height, normal, albedo, colour modulation and splat. A node has the same slot in all atlases.
//!
//! Makes the nodes that a frame visits resident. The least recently used slots are replaced first.
//! Source: Moore, GDC 2018, "Stream Quad Tree" and the part of the talk on terrain data. An atlas is an array texture in which each slot is a layer,
//! so filtering never reads a neighbouring node. Slots count from 1 (ruling 9 in `ARCHITECTURE.md`), because 0 means "not loaded". A frame waits for
//! the nodes that it visits, so that a picture does not depend on what was loaded before. [`Arrivals`] simulates that nodes arrive late.
//!
//! Limits: at most 512 nodes are resident at once. If a view needs more nodes in one frame, it is refused with an error that says what to change.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::base::error::{Error, Result};
use crate::gpu::uses::TextureUse;
use crate::gpu::{Gpu, texture_bytes, upload};
use crate::quadtree::{NodeBounds, PatchBounds};
use crate::scene::demands::Demands;
use crate::world::payload::{HEIGHT_SIDE, SPLAT_SIDE, TEXTURE_SIDE};
use crate::world::{Baked, Cover, Ground, NodeId, NodePayload, PaletteMeans, World};

mod schedule;

pub use schedule::{Arrivals, Loading, NodeSet, Residency, Schedule};

/// Largest number of resident nodes. The talk says about 500.
pub const CAPACITY: u32 = 512;

/// How many nodes the atlases hold, and how large the atlases are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AtlasCounts {
    /// Number of resident nodes.
    pub resident: usize,
    /// Largest possible number of resident nodes.
    pub capacity: usize,
    /// Bytes allocated for all atlases, unused slots included.
    pub bytes: u64,
}

/// The atlases and the nodes in them.
pub struct Streaming {
    /// R16_UNORM heights.
    pub height: wgpu::Texture,
    /// BC3 world normals with smoothness and specular occlusion.
    pub normal: wgpu::Texture,
    /// BC1 baked albedo, alpha 0 = hole.
    pub albedo: wgpu::Texture,
    /// BC1 colour modulation.
    pub colour_modulation: wgpu::Texture,
    /// R8 palette indices.
    pub splat: wgpu::Texture,
    resident: HashMap<NodeId, Resident>,
    free: Vec<u32>,
    frame: u64,
    /// Number of nodes baked since the last call of [`Streaming::take_loaded`].
    loaded: usize,
    layers: u32,
    /// Whether the [`Ground`] and the [`Cover`] of each node are kept, so that materials can be placed again.
    keeps_ground: bool,
    /// How many times `lay_anew` has been called.
    revision: u64,
}

/// Which properties of the materials have changed. A palette index beyond the end of a list counts as changed.
pub struct Changes {
    /// Whether the rules, the strokes or the list of materials changed, so that materials must be placed again.
    pub relaid: bool,
    /// For each palette index, whether the mean albedo, smoothness or specular occlusion changed.
    pub means: Vec<bool>,
    /// For each palette index, whether the palette entry (such as the size of a repeat) or a texture of the material changed.
    pub looks: Vec<bool>,
}

struct Resident {
    slot: u32,
    bounds: NodeBounds,
    patches: Vec<PatchBounds>,
    used: u64,
    /// Identifies the state of the materials on the node. It gets a new value when the splat map of the node changes, or when the palette entry, the
    /// mean values (see [`Changes::means`]) or a texture of one of its materials change.
    revision: u64,
    /// The ground and the cover from which the payload was made, if they are kept.
    source: Option<(Ground, Cover)>,
}

fn atlas(gpu: &Gpu, label: &str, texels: usize, layers: u32, format: wgpu::TextureFormat) -> wgpu::Texture {
    let texels = u32::try_from(texels).unwrap_or(u32::MAX);
    gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: Some(label),
        size: wgpu::Extent3d { width: texels, height: texels, depth_or_array_layers: layers },
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    })
}

/// Returns the textures of all atlases, including those that the scene does not require. They have one layer more than [`CAPACITY`]: slot 0 is
/// unused, because 0 means that nothing is loaded.
pub fn textures(demands: &Demands) -> Vec<TextureUse> {
    use wgpu::TextureFormat as Format;
    let node = |name, format, texels: usize, reason| {
        let edge = u32::try_from(texels).expect("the edge of a node has a few hundred texels");
        TextureUse::new(name, format, edge, 1, CAPACITY + 1, reason)
    };
    vec![
        node("node height", Format::R16Unorm, HEIGHT_SIDE, "the terrain's shape"),
        node("node normal", Format::Bc3RgbaUnorm, TEXTURE_SIDE, "the shading normal of every pixel"),
        node("node albedo", Format::Bc1RgbaUnormSrgb, TEXTURE_SIDE, "holes, far atlas, and pixels whose page is missing"),
        node("node colour modulation", Format::Bc1RgbaUnorm, TEXTURE_SIDE, "colour modulation")
            .unless(demands.colour_modulation, "world.colour_modulation = 0"),
        // The splat map is needed even if no flavour of the scene samples it, because the reference blend samples it. Errors are measured against
        // this blend.
        node(
            "node splat map",
            Format::R8Uint,
            SPLAT_SIDE,
            "cliffs, splat, pages, and the reference blend, against which errors are measured",
        ),
    ]
}

impl Streaming {
    /// Makes empty atlases. The atlas of colour modulation has a single layer if the scene has no colour modulation, because a binding
    /// cannot be empty. `keeps_ground`: whether to keep the [`Ground`] and the [`Cover`] of each node. [`Streaming::lay_anew`] needs them. They take
    /// about 250 KB of memory per node.
    pub fn new(gpu: &Gpu, colour_modulation: bool, keeps_ground: bool) -> Streaming {
        use wgpu::TextureFormat as Format;
        let layers = (CAPACITY + 1).min(gpu.device.limits().max_texture_array_layers);
        Streaming {
            height: atlas(gpu, "height atlas", HEIGHT_SIDE, layers, Format::R16Unorm),
            normal: atlas(gpu, "normal atlas", TEXTURE_SIDE, layers, Format::Bc3RgbaUnorm),
            albedo: atlas(gpu, "albedo atlas", TEXTURE_SIDE, layers, Format::Bc1RgbaUnormSrgb),
            colour_modulation: atlas(
                gpu,
                "colour modulation atlas",
                TEXTURE_SIDE,
                if colour_modulation { layers } else { 1 },
                Format::Bc1RgbaUnorm,
            ),
            splat: atlas(gpu, "splat atlas", SPLAT_SIDE, layers, Format::R8Uint),
            resident: HashMap::new(),
            free: (1..layers).rev().collect(),
            frame: 0,
            loaded: 0,
            layers,
            keeps_ground,
            revision: 0,
        }
    }

    /// Begins a frame. Nodes that the frame uses stay resident until the next frame begins.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
    }

    /// Makes `nodes` resident and returns their bounds in the same order. Nodes that are not resident yet are baked on worker threads, which call
    /// `on_baked` once per baked node.
    ///
    /// # Errors
    /// When one frame needs more nodes than there are slots.
    pub fn load(
        &mut self,
        gpu: &Gpu,
        world: &World,
        palette: &PaletteMeans,
        nodes: &[NodeId],
        on_baked: &(dyn Fn() + Sync),
    ) -> Result<Vec<NodeBounds>> {
        let absent: Vec<NodeId> = nodes.iter().copied().filter(|n| !self.resident.contains_key(n)).collect();
        for node in nodes {
            if let Some(resident) = self.resident.get_mut(node) {
                resident.used = self.frame;
            }
        }
        for Baked { payload, ground, cover } in world.bake_many(&absent, palette, self.keeps_ground, on_baked) {
            let slot = self.take_slot()?;
            self.write(gpu, slot, &payload);
            let bounds = NodeBounds { height_m: [world.elevation_m(payload.min_height), world.elevation_m(payload.max_height)] };
            let source = ground.map(|ground| (ground, cover));
            let patches = PatchBounds::of(world, &payload);
            // If the node was evicted earlier, pages of the virtual texture may have been rendered from it with older materials. The node gets
            // the current revision, which marks such pages as stale.
            let resident = Resident { slot, bounds, patches, used: self.frame, revision: self.revision, source };
            self.resident.insert(payload.id, resident);
            self.loaded += 1;
        }
        Ok(nodes.iter().map(|n| self.resident[n].bounds).collect())
    }

    /// Returns slot and bounds of a node; `None` = the node is not resident.
    pub fn get(&self, node: NodeId) -> Option<(u32, NodeBounds)> {
        self.resident.get(&node).map(|r| (r.slot, r.bounds))
    }

    /// Returns the bounds of the patches of a node, row by row from the south-west corner; empty if the node is not resident.
    pub fn patches(&self, node: NodeId) -> &[PatchBounds] {
        self.resident.get(&node).map_or(&[], |r| &r.patches)
    }

    /// Returns a number that [`Streaming::lay_anew`] changes if it changes the materials of a node. 0 for a node that is not resident, and for all
    /// nodes until the first call of `lay_anew`.
    pub fn revision(&self, node: NodeId) -> u64 {
        self.resident.get(&node).map_or(0, |r| r.revision)
    }

    /// Places materials again, with the current `world` and `palette`, on the resident nodes whose ground is kept. The payload of a node is baked
    /// again if its splat map changed, or if the mean albedo, smoothness or specular occlusion of one of its materials changed. If only the palette
    /// entry or a texture of a material changed, the node gets a new revision, but its payload stays. Returns the number of payloads that were baked
    /// again.
    pub fn lay_anew(&mut self, gpu: &Gpu, world: &World, palette: &PaletteMeans, changes: &Changes) -> usize {
        let holds = |cover: &Cover, changed: &[bool]| cover.iter().any(|&id| changed.get(usize::from(id)).copied().unwrap_or(true));
        let anew: Vec<(NodeId, Option<(Cover, NodePayload)>)> = self
            .resident
            .par_iter()
            .filter_map(|(&node, resident)| {
                let (ground, before) = resident.source.as_ref()?;
                let cover = if changes.relaid { world.cover(ground) } else { before.clone() };
                if cover != *before || holds(&cover, &changes.means) {
                    let payload = world.dress(ground, &cover, palette);
                    return Some((node, Some((cover, payload))));
                }
                holds(&cover, &changes.looks).then_some((node, None))
            })
            .collect();
        self.revision += 1;
        let mut count = 0;
        for (node, made) in anew {
            let Some(resident) = self.resident.get_mut(&node) else { continue };
            resident.revision = self.revision;
            if let (Some((cover, payload)), Some(source)) = (made, resident.source.as_mut()) {
                source.1 = cover;
                let slot = resident.slot;
                self.write(gpu, slot, &payload);
                count += 1;
            }
        }
        count
    }

    /// Number of resident nodes.
    pub fn len(&self) -> usize {
        self.resident.len()
    }

    /// Whether no node is resident.
    pub fn is_empty(&self) -> bool {
        self.resident.is_empty()
    }

    /// Number of nodes baked and uploaded since the last call of this method.
    pub fn take_loaded(&mut self) -> usize {
        std::mem::take(&mut self.loaded)
    }

    /// How many nodes the atlases hold now, and how large the atlases are.
    pub fn counts(&self) -> AtlasCounts {
        let atlases = [&self.height, &self.normal, &self.albedo, &self.colour_modulation, &self.splat];
        AtlasCounts {
            resident: self.resident.len(),
            // One layer is unused: slot 0, which means "not loaded".
            capacity: (self.layers - 1) as usize,
            bytes: atlases.into_iter().map(texture_bytes).sum(),
        }
    }

    fn take_slot(&mut self) -> Result<u32> {
        if let Some(slot) = self.free.pop() {
            return Ok(slot);
        }
        let oldest =
            self.resident.iter().filter(|(_, r)| r.used < self.frame).min_by_key(|(node, r)| (r.used, **node)).map(|(&node, _)| node);
        let Some(oldest) = oldest else {
            return Err(Error::Request(format!(
                "this view needs more than {} terrain nodes at once: raise frame.lod_bias, or reduce the height of the image",
                self.layers - 1
            )));
        };
        Ok(self.resident.remove(&oldest).map_or(0, |r| r.slot))
    }

    fn write(&self, gpu: &Gpu, slot: u32, payload: &NodePayload) {
        upload(gpu, &self.height, slot, 0, bytemuck::cast_slice(&payload.height));
        upload(gpu, &self.normal, slot, 0, &payload.normal);
        upload(gpu, &self.albedo, slot, 0, &payload.albedo);
        if self.colour_modulation.depth_or_array_layers() > 1 {
            upload(gpu, &self.colour_modulation, slot, 0, &payload.colour_modulation);
        }
        upload(gpu, &self.splat, slot, 0, &payload.splat);
    }
}

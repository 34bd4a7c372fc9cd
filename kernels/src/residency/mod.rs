//! Node payloads in GPU memory: synchronised atlases, one slot a node.
//!
//! Reads the nodes a frame visits; makes them resident, least recently used slots first.
//! Source: Moore, GDC 2018, "Stream Quad Tree"; SYSTEMS A. An atlas is an array texture whose layer is the slot, so
//! filtering never reaches a neighbour; slots count from 1 (ruling 9), since 0 means "not loaded".
//! Offline rendering waits for every node it visits, so that a picture never depends on what was there before it.

use std::collections::HashMap;

use rayon::prelude::*;

use crate::base::error::{Error, Result};
use crate::gpu::uses::TextureUse;
use crate::gpu::{Gpu, texture_bytes, upload};
use crate::quadtree::NodeBounds;
use crate::scene::demands::Demands;
use crate::world::payload::{HEIGHT_SIDE, SPLAT_SIDE, TEXTURE_SIDE};
use crate::world::{Baked, Cover, Ground, NodeId, NodePayload, PaletteMeans, World};

/// Nodes that can be resident at once (SYSTEMS A: about 500).
pub const CAPACITY: u32 = 512;

/// Who sits in the atlases, and what they take.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AtlasCounts {
    /// Nodes resident.
    pub resident: usize,
    /// The most that can be.
    pub capacity: usize,
    /// Bytes of all atlases as allocated, used or not.
    pub bytes: u64,
}

/// The atlases and who sits in them.
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
    /// Nodes baked since this frame began.
    loaded: usize,
    layers: u32,
    /// Whether what nodes were made from is kept, to lay other materials on them.
    keeps_ground: bool,
    /// Times that materials were laid anew.
    revision: u64,
}

/// What is new about materials.
pub struct Changes {
    /// Whether they are laid by other rules.
    pub relaid: bool,
    /// By palette index, whether the mean look is another.
    pub means: Vec<bool>,
    /// By palette index, whether the texture, or how it lies on the ground, is another.
    pub looks: Vec<bool>,
}

struct Resident {
    slot: u32,
    bounds: NodeBounds,
    used: u64,
    /// Changes with what its materials are and look like.
    revision: u64,
    /// What it was made from, if that is kept.
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

/// What the atlases of a scene take. Slots count from 1, since 0 means that nothing is loaded.
pub fn textures(demands: &Demands) -> Vec<TextureUse> {
    use wgpu::TextureFormat as Format;
    let node = |name, format, texels: usize, reason| {
        let edge = u32::try_from(texels).expect("some hundred texels");
        TextureUse::new(name, format, edge, 1, CAPACITY + 1, reason)
    };
    let baked = "far atlas, and whatever is not resident yet";
    vec![
        node("node height", Format::R16Unorm, HEIGHT_SIDE, "the terrain's shape"),
        node("node normal", Format::Bc3RgbaUnorm, TEXTURE_SIDE, baked),
        node("node albedo", Format::Bc1RgbaUnormSrgb, TEXTURE_SIDE, baked),
        node("node colour modulation", Format::Bc1RgbaUnorm, TEXTURE_SIDE, "colour modulation")
            .unless(demands.colour_modulation, "world.colour_modulation = 0"),
        // Also where no flavour samples it: every error is measured against the full blend.
        node("node splat map", Format::R8Uint, SPLAT_SIDE, "cliffs, splat, pages, and the reference that errors are measured against"),
    ]
}

impl Streaming {
    /// Empty atlases; that of colour modulation only if the scene has one (else a single layer, since something must be bound).
    /// `keeps_ground`: whether [`Streaming::lay_anew`] will be asked for, which takes some 210 KB of memory a node.
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

    /// Begins a frame: what it touches is not evicted in it.
    pub fn begin_frame(&mut self) {
        self.frame += 1;
        self.loaded = 0;
    }

    /// Makes `nodes` resident, baking those that are not on worker threads; returns their bounds in the same order.
    ///
    /// # Errors
    /// When one frame wants more nodes than there are slots.
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
        for Baked { payload, ground, cover } in world.bake_many(&absent, palette, on_baked) {
            let slot = self.take_slot()?;
            self.write(gpu, slot, &payload);
            let bounds = NodeBounds { height_m: [world.elevation_m(payload.min_height), world.elevation_m(payload.max_height)] };
            let source = self.keeps_ground.then_some((ground, cover));
            // Pages of a node that left and came back may be older than its materials.
            let resident = Resident { slot, bounds, used: self.frame, revision: self.revision, source };
            self.resident.insert(payload.id, resident);
            self.loaded += 1;
        }
        Ok(nodes.iter().map(|n| self.resident[n].bounds).collect())
    }

    /// Slot and bounds of a resident node.
    pub fn get(&self, node: NodeId) -> Option<(u32, NodeBounds)> {
        self.resident.get(&node).map(|r| (r.slot, r.bounds))
    }

    /// What tells two states of a node's materials apart; 0 for one that is not resident.
    pub fn revision(&self, node: NodeId) -> u64 {
        self.resident.get(&node).map_or(0, |r| r.revision)
    }

    /// Lays materials on the resident nodes by what `world` and `palette` are now. A node is made anew if other materials lie on it, or one whose mean
    /// look changed; its revision changes, too, if only the look of one did. Returns how many were made anew.
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

    /// How many nodes are resident.
    pub fn len(&self) -> usize {
        self.resident.len()
    }

    /// Whether nothing is resident.
    pub fn is_empty(&self) -> bool {
        self.resident.is_empty()
    }

    /// Nodes baked and uploaded since the frame began.
    pub fn loaded(&self) -> usize {
        self.loaded
    }

    /// Who sits in the atlases now.
    pub fn counts(&self) -> AtlasCounts {
        let atlases = [&self.height, &self.normal, &self.albedo, &self.colour_modulation, &self.splat];
        AtlasCounts {
            resident: self.resident.len(),
            // Slot 0 stands for "not loaded".
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
                "this view needs more than {} terrain nodes at once; narrow the field of view or lower the image's height",
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

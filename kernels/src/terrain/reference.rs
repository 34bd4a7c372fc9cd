//! Terrain access in f64: the reference for `terrain.wgsl`.
//!
//! It decodes the compressed payloads of nodes and the compressed textures of the palette, and filters them without the GPU. Positions are metres
//! from the south-west corner of the world, and are not split into sectors. Anisotropic filtering is not covered, so `blend.anisotropy` must be 1.
//! Hex tiling, texels chosen at random, and the blends in bands and layers are not covered either. Source: Moore, *Terrain Rendering in Far Cry 5*,
//! GDC 2018 (splat map, detail textures); WebGPU, "Texel filtering".

use std::collections::BTreeMap;

use glam::{DVec2, DVec3};

use crate::base::colour::linear_from_srgb;
use crate::blocks::{self, BlockFormat};
use crate::materials::{CompressedChain, Palette, PaletteEntry};
use crate::shared::{snapped_projection, splat_blend};
use crate::terrain::palette_means;
use crate::world::payload::{BORDER, NodePayload, SPLAT_SIDE, TEXTURE_SIDE};
use crate::world::{NodeId, World};

/// The quantities that a blend sums, as in the struct `Surface` of `terrain.wgsl`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surface {
    /// Linear albedo.
    pub albedo: DVec3,
    /// Height within the relief of the material, 0..=1.
    pub height: f64,
    /// Volume gradient of the bump height, metres per metre.
    pub gradient: DVec3,
    /// 1 - perceptual roughness, 0..=1.
    pub smoothness: f64,
    /// Share of specular light that reaches the surface, 0..=1.
    pub occlusion: f64,
}

impl Surface {
    /// Returns the sum of this surface and `weight` times `other`.
    #[must_use]
    pub fn plus(self, weight: f64, other: Surface) -> Surface {
        Surface {
            albedo: self.albedo + weight * other.albedo,
            height: self.height + weight * other.height,
            gradient: self.gradient + weight * other.gradient,
            smoothness: self.smoothness + weight * other.smoothness,
            occlusion: self.occlusion + weight * other.occlusion,
        }
    }
}

/// A decoded mip chain with four numbers per texel.
struct Chain {
    levels: Vec<(usize, Vec<[f64; 4]>)>,
}

impl Chain {
    fn of(chain: &CompressedChain, is_srgb: bool) -> Chain {
        let texel = |t: [u8; 4]| {
            let [r, g, b, a] = t.map(|code| f64::from(code) / 255.0);
            if is_srgb { [linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b), a] } else { [r, g, b, a] }
        };
        let level = |level: usize| (chain.level_size(level) as usize, chain.decode(level).into_iter().map(texel).collect());
        Chain { levels: (0..chain.levels.len()).map(level).collect() }
    }

    /// Samples the chain with trilinear filtering. Texture coordinates repeat.
    fn sample(&self, uv: DVec2, lod: f64) -> [f64; 4] {
        let lod = lod.clamp(0.0, (self.levels.len() - 1) as f64);
        let fine = lod.floor();
        let coarse = (fine as usize + 1).min(self.levels.len() - 1);
        mix4(self.bilinear(uv, fine as usize), self.bilinear(uv, coarse), lod - fine)
    }

    fn bilinear(&self, uv: DVec2, level: usize) -> [f64; 4] {
        let (size, texels) = &self.levels[level];
        let at = uv * *size as f64 - 0.5;
        let corner = at.floor();
        let wrap = |x: f64| (x as i64).rem_euclid(*size as i64) as usize;
        let texel = |dx: f64, dy: f64| texels[wrap(corner.y + dy) * size + wrap(corner.x + dx)];
        let f = at - corner;
        mix4(mix4(texel(0.0, 0.0), texel(1.0, 0.0), f.x), mix4(texel(0.0, 1.0), texel(1.0, 1.0), f.x), f.y)
    }
}

fn mix4(a: [f64; 4], b: [f64; 4], share: f64) -> [f64; 4] {
    std::array::from_fn(|k| a[k] * (1.0 - share) + b[k] * share)
}

/// A place on the terrain: the finest loaded node there, and the position in it, 0..=1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spot {
    /// The node.
    pub node: NodeId,
    /// Position in the node.
    pub uv: DVec2,
}

/// The four splat texels around a place, in the order 00, 10, 01, 11, and the position between them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cell {
    /// Palette indices.
    pub ids: [u8; 4],
    /// Position between the four texels, 0..=1.
    pub fraction: [f64; 2],
}

/// A footprint in the coordinates of one projection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Number of the projection's plane, see [`snapped_projection`].
    pub plane: u32,
    /// Coordinates of the position in the projection, metres.
    pub at: DVec2,
    /// Steps of the coordinates from the pixel to its neighbours on the right and below, metres, times 2^(mip bias).
    pub steps: [DVec2; 2],
}

impl Projection {
    /// The projection of a position (metres from the south-west corner of the world, and elevation) with its steps to the neighbouring pixels.
    pub fn of(plane: u32, position: DVec3, steps: [DVec3; 2], mip_bias: f64) -> Projection {
        let in_plane = |v: DVec3| DVec2::from_array(snapped_projection::coordinates(v.to_array(), plane));
        Projection { plane, at: in_plane(position), steps: steps.map(|step| in_plane(step) * mip_bias.exp2()) }
    }
}

/// The decoded maps of a node.
struct Node {
    /// Palette indices, row by row.
    splat: Vec<u8>,
    /// RGBA texels of the albedo and normal maps.
    albedo: Vec<u8>,
    normal: Vec<u8>,
}

impl Node {
    fn of(payload: NodePayload) -> Node {
        let image = |format, bytes: &[u8]| blocks::decode(format, bytes, TEXTURE_SIDE, TEXTURE_SIDE);
        Node { albedo: image(BlockFormat::Bc1, &payload.albedo), normal: image(BlockFormat::Bc3, &payload.normal), splat: payload.splat }
    }
}

/// The loaded nodes of a world, and the textures of its materials.
pub struct Ground<'w> {
    world: &'w World,
    entries: &'w [PaletteEntry],
    /// Albedo, normal and height of each layer.
    details: Vec<[Chain; 3]>,
    nodes: BTreeMap<NodeId, Node>,
    sharpness: f64,
}

impl<'w> Ground<'w> {
    /// Bakes `nodes`, and decodes the textures. `sharpness`: [`Blend::height_sharpness`](crate::scene::Blend).
    pub fn new(world: &'w World, palette: &'w Palette, nodes: &[NodeId], sharpness: f64) -> Ground<'w> {
        let means = palette_means(palette);
        let arrays = &palette.arrays;
        let details = (0..arrays.albedo.len()).map(|layer| {
            [Chain::of(&arrays.albedo[layer], true), Chain::of(&arrays.normal[layer], false), Chain::of(&arrays.height[layer], false)]
        });
        let nodes = nodes
            .iter()
            .copied()
            .zip(world.bake_many(nodes, &means, false, || ()).into_iter().map(|baked| Node::of(baked.payload)))
            .collect();
        Ground { world, entries: &palette.entries, details: details.collect(), nodes, sharpness }
    }

    /// The finest loaded node at a place, and the position in it; `None` if no loaded node covers the place.
    pub fn spot(&self, place: DVec2) -> Option<Spot> {
        let layout = self.world.layout();
        let containing = self.nodes.keys().filter_map(|&node| {
            let edge = layout.node_m(node.lod);
            let uv = place / edge - DVec2::new(f64::from(node.x), f64::from(node.y));
            (uv.min_element() >= 0.0 && uv.max_element() <= 1.0).then_some(Spot { node, uv })
        });
        containing.min_by_key(|spot| spot.node.lod)
    }

    /// The splat texels around a place.
    pub fn cell(&self, spot: &Spot) -> Cell {
        let splat = &self.nodes[&spot.node].splat;
        let at = spot.uv * 64.0;
        let corner = at.floor().min(DVec2::splat(63.0));
        let (i, j) = (corner.x as usize, corner.y as usize);
        let ids = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(di, dj)| splat[(j + dj) * SPLAT_SIDE + i + di]);
        Cell { ids, fraction: (at - corner).to_array() }
    }

    /// The baked albedo, smoothness, occlusion and normal of the far atlas at a place. Height and gradient of the surface are 0.
    pub fn baked(&self, spot: &Spot) -> (Surface, DVec3) {
        let node = &self.nodes[&spot.node];
        // The map has 128 x 128 texels and a border of 2 texels. So the centre of texel i is at the node coordinate (i - 2 + 0.5) / 128, and `at` is
        // measured from the centre of texel 0.
        let at = spot.uv * 128.0 + (BORDER as f64 - 0.5);
        let corner = at.floor().clamp(DVec2::ZERO, DVec2::splat(TEXTURE_SIDE as f64 - 2.0));
        let f = at - corner;
        let filtered = |bytes: &[u8], is_srgb: bool| {
            let texel = |di: usize, dj: usize| {
                let at = 4 * ((corner.y as usize + dj) * TEXTURE_SIDE + corner.x as usize + di);
                std::array::from_fn(|k| {
                    let value = f64::from(bytes[at + k]) / 255.0;
                    if is_srgb && k < 3 { linear_from_srgb(value) } else { value }
                })
            };
            mix4(mix4(texel(0, 0), texel(1, 0), f.x), mix4(texel(0, 1), texel(1, 1), f.x), f.y)
        };
        let ([r, g, b, a], [smoothness, y, occlusion, x]) = (filtered(&node.albedo, true), filtered(&node.normal, false));
        let xy = DVec2::new(x, y) * 2.0 - 1.0;
        let normal = xy.extend((1.0 - xy.length_squared()).max(1e-4).sqrt()).normalize();
        (Surface { albedo: DVec3::new(r, g, b) / a.max(0.25), smoothness, occlusion, ..Surface::default() }, normal)
    }

    /// One material in one projection. A repeat of the texture is 2^`scale` times as wide as at scale 0.
    pub fn material(&self, id: u8, projection: &Projection, scale: u32) -> Surface {
        let entry = &self.entries[usize::from(id)];
        // Repeats per metre, times cos and sin of the orientation. The palette stores repeats per sector with 24 fractional bits: 16 777 216 is 2^24.
        let sector_m = self.world.layout().sector_m;
        let rate =
            DVec2::from_array(entry.per_sector_fixed.map(|fixed| f64::from(fixed) / 16_777_216.0 / sector_m)) / f64::from(1u32 << scale);
        let turn = |v: DVec2| DVec2::new(v.x * rate.x + v.y * rate.y, v.y * rate.x - v.x * rate.y);
        let uv = turn(projection.at);
        let [albedo, normal, height] = &self.details[entry.albedo_layer as usize];
        let longest = projection.steps.map(|step| turn(step).length()).into_iter().fold(0.0, f64::max).max(1e-15);
        let texels = |chain: &Chain| (longest * chain.levels[0].0 as f64).log2();
        let ([r, g, b, _], [smoothness, y, occlusion, x]) = (albedo.sample(uv, texels(albedo)), normal.sample(uv, texels(normal)));
        let [height, mask, ..] = height.sample(uv, texels(height));
        let xy = DVec2::new(x, y) * 2.0 - 1.0;
        // The height falls in the direction in which the normal leans. The z of the normal is limited to at least 0.05.
        let slope = -f64::from(entry.normal_strength) * xy / (1.0 - xy.length_squared()).max(0.0025).sqrt();
        let orientation = rate.normalize_or_zero();
        let turned = DVec2::new(slope.x * orientation.x - slope.y * orientation.y, slope.x * orientation.y + slope.y * orientation.x);
        let tint = DVec3::ONE.lerp(DVec3::from_array(entry.tint.map(f64::from)), mask);
        Surface {
            albedo: DVec3::new(r, g, b) * tint,
            height,
            gradient: DVec3::from_array(snapped_projection::from_gradient(turned.to_array(), projection.plane)),
            smoothness,
            occlusion,
        }
    }

    /// The four materials of a cell, blended by bilinear weights that are modified by height.
    pub fn blend(&self, cell: &Cell, projection: &Projection, scale: u32) -> Surface {
        let taps = cell.ids.map(|id| self.material(id, projection, scale));
        let weights = splat_blend::weights(cell.fraction, taps.map(|tap| tap.height), self.sharpness);
        taps.iter().zip(weights).fold(Surface::default(), |sum, (&tap, weight)| sum.plus(weight, tap))
    }

    /// The four materials of a cell, blended by bilinear weights.
    pub fn mean(&self, cell: &Cell, projection: &Projection, scale: u32) -> Surface {
        let weights = splat_blend::bilinear(cell.fraction);
        cell.ids.iter().zip(weights).fold(Surface::default(), |sum, (&id, weight)| sum.plus(weight, self.material(id, projection, scale)))
    }
}

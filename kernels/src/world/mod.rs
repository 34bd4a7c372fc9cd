//! The `world` stage: makes node payloads from a scene, on demand and on worker threads.
//!
//! Reads the scene (generator or heightmap, splat rules, strokes, holes, colour modulation) and the mean values of the palette's materials. Makes
//! [`NodePayload`]s for the nodes that are needed: 34 125 nodes can exist, but only about 500 are needed at a time (ruling 12 in `ARCHITECTURE.md`).
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, "Terrain Data".
//!
//! The ground of a heightmap ends where its data end, even between two vertices: [`World::drawn_at`] moves vertices beyond the data to the edge of
//! the data.
//!
//! Limits: a world has holes only where its scene lists them. The quadtree covers whole sectors, so nodes at the edge of a heightmap have vertices
//! and texels beyond the data, which repeat the edge of the data.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

use glam::DVec2;
use rayon::prelude::*;

use crate::base::cache::{self, Cache, Key};
use crate::base::error::{Error, Result};
use crate::scene::{self, Hole, Scene};
use crate::shared::hash;

pub mod cones;
pub mod generator;
pub mod payload;
pub mod rules;

pub use payload::{Cover, Ground, NodePayload, PaletteMeans};

use crate::decode::heightmap::{self, Heightmap};
use generator::Generator;
use rules::Rules;

/// Sectors along the world's edge.
pub const SECTORS: u16 = 160;
/// Number of LODs of the quadtree: 0 (the finest, one node per sector) to 5.
pub const LODS: u8 = 6;
/// Edge of a sector, metres. In an imported world that is wider or deeper than 10 240 m, the edge is larger, see [`Layout::sector_m`].
pub const SECTOR_M: f64 = 64.0;
/// Quads along a node's edge, at every LOD.
pub const NODE_QUADS: u16 = 128;

/// A quadtree node.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct NodeId {
    /// The LOD of the node; 0 = finest.
    pub lod: u8,
    /// Column of the node, in nodes of this LOD from the western edge of the world.
    pub x: u16,
    /// Row of the node, in nodes of this LOD from the southern edge of the world.
    pub y: u16,
}

impl NodeId {
    /// Number of nodes of a LOD along the edge of the world.
    pub const fn per_side(lod: u8) -> u16 {
        SECTORS >> lod
    }

    /// The 5 x 5 coarsest nodes, row by row from the south-west.
    pub fn roots() -> impl Iterator<Item = NodeId> {
        let lod = LODS - 1;
        let side = NodeId::per_side(lod);
        (0..side * side).map(move |i| NodeId { lod, x: i % side, y: i / side })
    }

    /// The four children in the order south-west, south-east, north-west, north-east.
    ///
    /// # Panics
    /// If the LOD is 0: such a node has no children.
    pub fn children(self) -> [NodeId; 4] {
        assert!(self.lod > 0, "a node of LOD 0 has no children");
        [0, 1, 2, 3].map(|i| NodeId { lod: self.lod - 1, x: self.x * 2 + i % 2, y: self.y * 2 + i / 2 })
    }

    /// The node that contains this one; `None` for a root.
    pub fn parent(self) -> Option<NodeId> {
        (self.lod + 1 < LODS).then_some(NodeId { lod: self.lod + 1, x: self.x / 2, y: self.y / 2 })
    }

    /// South-west corner, world metres (origin at the world's centre).
    pub fn origin_m(self, layout: &Layout) -> DVec2 {
        DVec2::new(f64::from(self.x), f64::from(self.y)) * layout.node_m(self.lod) - layout.world_m() / 2.0
    }
}

/// How the quadtree covers the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layout {
    /// Edge of a node of LOD 0, metres: 64 m times the smallest power of two such that 160 sectors per side cover the world.
    pub sector_m: f64,
    /// Finest LOD that exists. It follows from the spacing of the data; it is 0 if the world has detail at every scale.
    pub finest_lod: u8,
}

impl Layout {
    /// Returns the layout of a world whose longer side is `extent_m`. `data_spacing_m`: distance between the samples of the data; `None` = the world
    /// has detail at every scale.
    pub fn of(extent_m: f64, data_spacing_m: Option<f64>) -> Layout {
        let mut sector_m = SECTOR_M;
        while sector_m * f64::from(SECTORS) < extent_m {
            sector_m *= 2.0;
        }
        let mut layout = Layout { sector_m, finest_lod: 0 };
        if let Some(spacing) = data_spacing_m {
            layout.finest_lod = (0..LODS).find(|&lod| layout.spacing_m(lod) >= spacing / 2.0).unwrap_or(LODS - 1);
        }
        layout
    }

    /// Returns the layout of the world of a heightmap. `detail_m`: largest offset of the added relief; 0 = none.
    pub fn of_heightmap(map: &Heightmap, detail_m: f64) -> Layout {
        let [width, depth] = map.extent_m();
        Layout::of(width.max(depth), (detail_m <= 0.0).then_some(map.metres_per_texel))
    }

    /// Edge of a node, metres.
    pub fn node_m(&self, lod: u8) -> f64 {
        self.sector_m * f64::from(1u32 << lod)
    }

    /// Distance between neighbouring heights of a node, metres.
    pub fn spacing_m(&self, lod: u8) -> f64 {
        self.node_m(lod) / f64::from(NODE_QUADS)
    }

    /// Edge of the square that the quadtree covers, metres.
    pub fn world_m(&self) -> f64 {
        self.sector_m * f64::from(SECTORS)
    }

    /// The node of a LOD that contains a point; `None` outside the world.
    pub fn node_at(&self, lod: u8, x: f64, y: f64) -> Option<NodeId> {
        let edge = self.node_m(lod);
        let index = |v: f64| {
            let i = ((v + self.world_m() / 2.0) / edge).floor();
            (i >= 0.0 && i < f64::from(NodeId::per_side(lod))).then_some(i as u16)
        };
        Some(NodeId { lod, x: index(x)?, y: index(y)? })
    }
}

#[derive(Clone)]
enum Source {
    Generated(Box<Generator>),
    Data { map: Arc<Heightmap>, detail_m: f64, relief: generator::Relief },
}

/// The payload of a node, and the data from which it was made.
pub struct Baked {
    /// The data that is loaded to the GPU.
    pub payload: NodePayload,
    /// The ground, which does not depend on materials; `None` unless it was asked for.
    pub ground: Option<Ground>,
    /// The materials on the ground.
    pub cover: Cover,
}

/// A world: heights, holes and materials as functions of position. Threads can share it.
pub struct World {
    layout: Layout,
    source: Source,
    height_range_m: (f64, f64),
    /// Half the width (x) and depth (y) of the data, metres.
    half_extent_m: [f64; 2],
    footprint_m: f64,
    holes: Vec<Hole>,
    colour_modulation: f64,
    seed: u32,
    rules: Rules,
    material_count: usize,
    max_slope_deg: OnceLock<f64>,
    /// The largest angle for which [`World::is_as_steep_as`] has returned true, degrees, stored as the bits of an `f64`. The bits of non-negative
    /// numbers have the same order as the numbers, so an atomic maximum of the bits is the maximum of the angles.
    reached_deg: AtomicU64,
    /// Where baked nodes are kept; `None` = they are not kept.
    cache: Option<Arc<Cache>>,
    /// The key of this world's grounds in the cache. It is computed when it is first needed, because all samples of a heightmap are hashed.
    ground_key: OnceLock<Key>,
    /// The key of the parts of a payload that do not depend on the palette. Worlds that [`World::laid_by`] returned have none: an edited scene has a new
    /// state for every move of a slider, so payloads of these states would fill the cache.
    cover_key: Option<OnceLock<Key>>,
}

/// The keys of a world's entries in the cache.
#[derive(Clone, Copy)]
struct Keys {
    ground: Key,
    /// `None` = payloads are not kept.
    payload: Option<Key>,
}

impl World {
    /// Makes the world of a validated scene. Reads the heightmap, if the scene has one.
    ///
    /// # Errors
    /// [`Error::Heightmap`] if the heightmap cannot be used (see [`heightmap::read`]), or if `detail_m` is negative or not finite; [`Error::File`] if
    /// the heightmap cannot be read.
    pub fn new(scene: &Scene) -> Result<World> {
        let rules = Rules::new(scene);
        let material_count = scene.materials.len();
        match &scene.world {
            scene::World::Procedural { seed, holes, colour_modulation } => {
                let generator = Generator::new(*seed);
                let half = generator::EXTENT_M / 2.0;
                Ok(World {
                    layout: Layout::of(generator::EXTENT_M, None),
                    height_range_m: generator::HEIGHT_RANGE_M,
                    half_extent_m: [half; 2],
                    footprint_m: MIN_FOOTPRINT_M,
                    source: Source::Generated(Box::new(generator)),
                    holes: holes.clone(),
                    colour_modulation: *colour_modulation,
                    seed: *seed,
                    rules,
                    material_count,
                    max_slope_deg: OnceLock::new(),
                    reached_deg: AtomicU64::new(0),
                    cache: None,
                    ground_key: OnceLock::new(),
                    cover_key: Some(OnceLock::new()),
                })
            }
            scene::World::Heightmap { file, metres_per_texel, height_range_m, detail_m, seed, holes, colour_modulation } => {
                let options = heightmap::ReadOptions {
                    metres_per_texel: Some(*metres_per_texel),
                    height_range_m: Some(*height_range_m),
                    ..Default::default()
                };
                let path = scene.folder.join(file);
                let map = heightmap::read(&path, &options)?.map;
                if !(detail_m.is_finite() && *detail_m >= 0.0) {
                    let what = format!("`detail_m = {detail_m}` must be 0 or more metres; 0 adds no relief");
                    return Err(Error::Heightmap { file: path, what });
                }
                Ok(World::from_heightmap(map, *detail_m, *seed, holes.clone(), *colour_modulation, rules, material_count))
            }
        }
    }

    /// Makes the world of a heightmap that is in memory. `import` calls this function to measure slopes, before the new scene has rules.
    pub(crate) fn from_heightmap(
        map: Heightmap,
        detail_m: f64,
        seed: u32,
        holes: Vec<Hole>,
        colour_modulation: f64,
        rules: Rules,
        material_count: usize,
    ) -> World {
        let layout = Layout::of_heightmap(&map, detail_m);
        let vertices_m = layout.spacing_m(layout.finest_lod);
        let spacing = map.metres_per_texel;
        let (low, high) = map.elevation_range_m();
        let mut footprint_m = MIN_FOOTPRINT_M;
        while footprint_m < spacing {
            footprint_m *= 2.0;
        }
        World {
            layout,
            height_range_m: (low - detail_m, high + detail_m),
            half_extent_m: map.extent_m().map(|length| on_vertex(length / 2.0, vertices_m)),
            footprint_m,
            source: Source::Data { relief: generator::Relief::new(seed, spacing), map: Arc::new(map), detail_m },
            holes,
            colour_modulation,
            seed,
            rules,
            material_count,
            max_slope_deg: OnceLock::new(),
            reached_deg: AtomicU64::new(0),
            cache: None,
            ground_key: OnceLock::new(),
            cover_key: Some(OnceLock::new()),
        }
    }

    /// Returns this world with a cache of nodes: [`World::bake_many`] reads nodes from it, and adds those that it lacks.
    #[must_use]
    pub fn with_cache(self, cache: Option<Arc<Cache>>) -> World {
        World { cache, ..self }
    }

    /// How the quadtree covers this world.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Elevations, in metres, that the heights 0 and 65535 of every payload stand for. All nodes use one range, so heights on shared edges
    /// have equal bits.
    pub fn height_range_m(&self) -> (f64, f64) {
        self.height_range_m
    }

    /// Width and depth of the data, metres. The data are centred on the origin.
    pub fn extent_m(&self) -> [f64; 2] {
        self.half_extent_m.map(|h| 2.0 * h)
    }

    /// Whether the ground may end inside the world: true for every heightmap. A procedural world fills all sectors.
    pub fn has_edge(&self) -> bool {
        matches!(self.source, Source::Data { .. })
    }

    /// Where a vertex at this position (metres) is drawn. If the world [has an edge](World::has_edge), a vertex beyond the data is drawn at the
    /// nearest point of the data, with the elevation at that point. So the last triangles end at the edge of the data, and triangles beyond it have
    /// no area. The rule depends on the position alone: nodes that share a vertex draw it at the same place, whatever their LODs.
    pub fn drawn_at(&self, at: [f64; 2]) -> [f64; 2] {
        std::array::from_fn(|axis| self.clipped(axis, at[axis]))
    }

    /// One coordinate of [`World::drawn_at`]. `axis`: 0 = x, 1 = y.
    fn clipped(&self, axis: usize, coordinate: f64) -> f64 {
        let half = self.half_extent_m[axis];
        if self.has_edge() { coordinate.clamp(-half, half) } else { coordinate }
    }

    /// Elevation at a position, metres, within [`World::height_range_m`]: that of the generator, or that of the interpolated heightmap with its added
    /// relief. Outside a heightmap, it is the elevation at the nearest point on the edge of the heightmap.
    pub fn height_m(&self, x: f64, y: f64) -> f64 {
        let height = match &self.source {
            Source::Generated(generator) => generator.height_m(x, y),
            Source::Data { map, detail_m, relief } => {
                let [x, y] = self.drawn_at([x, y]);
                if *detail_m > 0.0 {
                    let (h, dx, dy) = map.sample(x, y);
                    h + relief.offset_m(x, y, h, (dx * dx + dy * dy).sqrt(), *detail_m)
                } else {
                    map.sample(x, y).0
                }
            }
        };
        height.clamp(self.height_range_m.0, self.height_range_m.1)
    }

    /// Returns [`World::height_m`] and `broad_height_m`. This takes no longer than a call of [`World::height_m`] alone.
    fn heights_m(&self, x: f64, y: f64) -> [f64; 2] {
        match &self.source {
            Source::Generated(generator) => {
                let [height, broad] = generator.heights_m(x, y);
                [height.clamp(self.height_range_m.0, self.height_range_m.1), broad]
            }
            Source::Data { .. } => [self.height_m(x, y); 2],
        }
    }

    /// The elevation from which slope and curvature are measured, metres. In a procedural world, it is [`Generator::broad_height_m`]; with a
    /// heightmap, it equals [`World::height_m`].
    fn broad_height_m(&self, x: f64, y: f64) -> f64 {
        match &self.source {
            Source::Generated(generator) => generator.broad_height_m(x, y),
            Source::Data { .. } => self.height_m(x, y),
        }
    }

    /// Elevation of vertex (i, j), 0..=128, of a node, metres, as the payload stores it: quantised. In a node coarser than the finest LOD, it is also
    /// filtered. Vertices on the edges of the node are not filtered, nor are vertices with a neighbour beyond the data.
    pub fn vertex_elevation_m(&self, node: NodeId, vertex: [u32; 2]) -> f64 {
        self.elevation_m(self.quantise(payload::vertex_height_m(self, node, vertex)))
    }

    /// The 16-bit height that is nearest to an elevation in metres.
    pub fn quantise(&self, height_m: f64) -> u16 {
        let (low, high) = self.height_range_m;
        ((height_m - low) / (high - low) * 65535.0).round().clamp(0.0, 65535.0) as u16
    }

    /// The elevation, in metres, that a 16-bit height stands for.
    pub fn elevation_m(&self, height: u16) -> f64 {
        let (low, high) = self.height_range_m;
        low + (high - low) * (f64::from(height) / 65535.0)
    }

    /// Bound on the rounding error, metres, of an elevation that a shader computes in f32 as low + height * span. Here, height is the stored 16-bit
    /// height as 0..=1, and low and low + span are the ends of [`World::height_range_m`]. With S = |low| + span, the bound is 8 x 2^-24 of S.
    ///
    /// It covers these errors, whatever the direction of rounding:
    /// - The height and the product are each off by at most 2^-23 of span, and the sum by at most 2^-23 of S.
    /// - The host rounds low, span and the elevations of a culling box to f32, each with an error of at most 2^-24 of the number.
    pub fn elevation_rounding_m(&self) -> f64 {
        let (low, high) = self.height_range_m;
        8.0 / 16_777_216.0 * (low.abs() + (high - low))
    }

    /// Height of the surface as drawn at the finest LOD and vertex stride 1, metres: quantised vertices, and triangles with alternating diagonals
    /// (ruling 11 in `ARCHITECTURE.md`). Holes are ignored. Outside the data, the result is the height at the nearest point on the edge of the data.
    pub fn surface_height_m(&self, x: f64, y: f64) -> f64 {
        let spacing = self.layout.spacing_m(self.layout.finest_lod);
        let half = self.layout.world_m() / 2.0;
        // Locates a coordinate along one axis. Returns the index of its quad, counted from the south-western corner of the world, and its position
        // (0..=1) inside the part of the quad that has data. If no edge of the data crosses the quad, this part is the whole quad. Then `end - start`
        // is 1, so the division does not change the position.
        let locate = |v: f64, half_extent: f64| {
            let [low, high] = [half - half_extent, half + half_extent].map(|edge| edge / spacing);
            let at = ((v + half) / spacing).max(low).min(high);
            let cell = at.floor().max(low.floor()).min(high.ceil() - 1.0);
            let (start, end) = (cell.max(low), (cell + 1.0).min(high));
            (cell, if end > start { ((at - start) / (end - start)).clamp(0.0, 1.0) } else { 0.0 })
        };
        let ((i, u), (j, v)) = (locate(x, self.half_extent_m[0]), locate(y, self.half_extent_m[1]));
        let vertex = |di: f64, dj: f64| {
            let height = self.height_m((i + di) * spacing - half, (j + dj) * spacing - half);
            self.elevation_m(self.quantise(height))
        };
        let corners = [vertex(0.0, 0.0), vertex(1.0, 0.0), vertex(0.0, 1.0), vertex(1.0, 1.0)];
        // A node has an even number of quads, so diagonals alternate in the same way whether quads are counted in the world or in the node.
        payload::height_in_quad(corners, payload::diagonal_rises(i as usize, j as usize), u, v)
    }

    /// Whether a node exists: its LOD is not finer than [`Layout::finest_lod`], and it overlaps the area of the data.
    pub fn exists(&self, node: NodeId) -> bool {
        let side = if node.lod < LODS { NodeId::per_side(node.lod) } else { 0 };
        if node.lod < self.layout.finest_lod || node.x >= side || node.y >= side {
            return false;
        }
        let low = node.origin_m(&self.layout).to_array();
        let edge = self.layout.node_m(node.lod);
        (0..2).all(|k| low[k] < self.half_extent_m[k] && low[k] + edge > -self.half_extent_m[k])
    }

    /// Whether there is no ground at a position, because the position is inside one of the scene's holes or outside the data. The rim of a hole
    /// belongs to the ground.
    pub fn is_hole(&self, x: f64, y: f64) -> bool {
        let outside = x.abs() > self.half_extent_m[0] || y.abs() > self.half_extent_m[1];
        outside
            || self.holes.iter().any(|hole| {
                let (dx, dy) = (x - hole.centre[0], y - hole.centre[1]);
                dx * dx + dy * dy < hole.radius_m * hole.radius_m
            })
    }

    /// Whether a vertex at this position is drawn where there is no ground, see [`World::is_hole`]. The vertex may be drawn at a different position,
    /// see [`World::drawn_at`].
    fn opens_at(&self, vertex: [f64; 2]) -> bool {
        let [x, y] = self.drawn_at(vertex);
        self.is_hole(x, y)
    }

    /// Whether it is certain that [`World::opens_at`] is false at all positions in a rectangle. `low` and `high`: south-west and north-east corner of
    /// the rectangle. The result may be false for a rectangle without a hole.
    fn is_whole(&self, low: [f64; 2], high: [f64; 2]) -> bool {
        let [low, high] = [low, high].map(|corner| self.drawn_at(corner));
        let inside = (0..2).all(|k| low[k] >= -self.half_extent_m[k] && high[k] <= self.half_extent_m[k]);
        let touched = |hole: &Hole| (0..2).all(|k| hole.centre[k] + hole.radius_m > low[k] && hole.centre[k] - hole.radius_m < high[k]);
        inside && !self.holes.iter().any(touched)
    }

    /// The splat rules.
    pub fn rules(&self) -> &Rules {
        &self.rules
    }

    /// Width over which rules measure slope and curvature, metres: the smallest power of two that is at least 4 and at least the spacing of the data.
    pub fn footprint_m(&self) -> f64 {
        self.footprint_m
    }

    /// Returns the slope in degrees and the mean curvature in 1/m (positive where convex) at a position. Splat maps of fine nodes interpolate the
    /// curvature and the derivatives of the height between the points of a lattice (`RuleRelief` in `payload.rs`), so the values there may differ
    /// slightly.
    pub fn relief_at(&self, x: f64, y: f64) -> [f64; 2] {
        let reach = self.footprint_m / 2.0;
        let h = |dx: f64, dy: f64| self.broad_height_m(x + dx, y + dy);
        payload::slope_and_curvature(payload::differences(h(0.0, 0.0), h(-reach, 0.0), h(reach, 0.0), h(0.0, -reach), h(0.0, reach), reach))
    }

    /// Palette index of the material at a position.
    pub fn material_at(&self, x: f64, y: f64) -> u8 {
        let [slope_deg, curvature] = self.relief_at(x, y);
        self.rules.material_at(self.height_m(x, y), slope_deg, curvature, x, y)
    }

    fn material_count(&self) -> usize {
        self.material_count
    }

    fn colour_modulation(&self) -> f64 {
        self.colour_modulation
    }

    /// Colour modulation at a position; 0.5 leaves a colour unchanged. It has broad light and dark patches with slight shifts of hue.
    fn modulation_at(&self, x: f64, y: f64) -> [f64; 3] {
        let seed = hash::pcg4d([self.seed, 0xc0, 0x10, 0x5e])[0];
        let light = rules::value_noise(x / 90.0, y / 90.0, seed) - 0.5;
        let hue = rules::value_noise(x / 210.0, y / 210.0, seed ^ 0x5bd1_e995) - 0.5;
        [0.35, 0.0, -0.35].map(|shift| (0.5 + self.colour_modulation * (light + shift * hue)).clamp(0.0, 1.0))
    }

    /// Makes the payload of a node. Does not use the cache.
    ///
    /// # Panics
    /// If the palette lacks a material of the scene.
    pub fn bake(&self, node: NodeId, palette: &PaletteMeans) -> NodePayload {
        let ground = Ground::of(self, node);
        self.dress(&ground, &self.cover(&ground), palette)
    }

    /// Makes a node, or reads it from the cache.
    fn make(&self, node: NodeId, palette: &PaletteMeans, cached: Option<(&Cache, Keys)>, keeps_ground: bool) -> Baked {
        let read = |(cache, keys): (&Cache, Keys)| payload::from_bytes(node, &cache.read(keys.payload?, &name_of(node))?);
        if let Some((payload, cover)) = cached.and_then(read) {
            return Baked { payload, ground: keeps_ground.then(|| self.ground(node, cached)), cover };
        }
        let ground = self.ground(node, cached);
        let cover = self.cover(&ground);
        let payload = self.dress(&ground, &cover, palette);
        if let Some((cache, Keys { payload: Some(key), .. })) = cached {
            cache.write(key, &name_of(node), &payload::to_bytes(&payload, &cover));
        }
        Baked { payload, ground: keeps_ground.then_some(ground), cover }
    }

    /// Makes the ground of a node, or reads it from the cache.
    fn ground(&self, node: NodeId, cached: Option<(&Cache, Keys)>) -> Ground {
        let Some((cache, keys)) = cached else { return Ground::of(self, node) };
        let read = || Ground::from_bytes(self, node, &cache.read(keys.ground, &name_of(node))?);
        read().unwrap_or_else(|| {
            let ground = Ground::of(self, node);
            cache.write(keys.ground, &name_of(node), &ground.to_bytes());
            ground
        })
    }

    /// The keys of entries in the cache: hashes of all fields of this world that have an effect on the entries.
    fn keys(&self, palette: &PaletteMeans) -> Keys {
        let ground = *self.ground_key.get_or_init(|| {
            let shape = (&self.layout, self.height_range_m, self.half_extent_m, self.footprint_m);
            match &self.source {
                Source::Generated(generator) => Key::of("ground", (shape, generator)),
                Source::Data { map, detail_m, relief } => {
                    let data = (map.width, map.height, map.metres_per_texel, cache::hash_of(&map.samples));
                    Key::of("ground", (shape, data, detail_m, relief))
                }
            }
        });
        let cover = self.cover_key.as_ref().map(|key| {
            let materials = || (&self.holes, self.colour_modulation, self.seed, &self.rules, self.material_count);
            *key.get_or_init(|| Key::of("cover", (ground, materials())))
        });
        Keys { ground, payload: cover.map(|cover| Key::of("payload", (cover, palette))) }
    }

    /// Returns the materials that the splat rules and strokes place on the ground of a node.
    pub fn cover(&self, ground: &Ground) -> Cover {
        payload::cover(self, ground)
    }

    /// Makes the payload of a node from its ground and from the materials on it.
    ///
    /// # Panics
    /// If the palette lacks a material of the scene.
    pub fn dress(&self, ground: &Ground, cover: &Cover, palette: &PaletteMeans) -> NodePayload {
        payload::bake(self, ground, cover, palette)
    }

    /// Returns a copy of this world in which the rules and strokes of `scene` place the materials. The copy shares the heightmap with this world.
    #[must_use]
    pub fn laid_by(&self, scene: &Scene) -> World {
        World {
            layout: self.layout,
            source: self.source.clone(),
            height_range_m: self.height_range_m,
            half_extent_m: self.half_extent_m,
            footprint_m: self.footprint_m,
            holes: self.holes.clone(),
            colour_modulation: self.colour_modulation,
            seed: self.seed,
            rules: Rules::new(scene),
            material_count: scene.materials.len(),
            max_slope_deg: self.max_slope_deg.clone(),
            reached_deg: AtomicU64::new(self.reached_deg.load(Ordering::Relaxed)),
            cache: self.cache.clone(),
            ground_key: self.ground_key.clone(),
            cover_key: None,
        }
    }

    /// Makes many nodes on rayon's worker threads, or reads them from the cache. Returns them in the order of `nodes`. The result does not
    /// depend on the number of threads or on the cache. `keeps_ground`: whether the results include the ground. `on_done` is called once per finished
    /// node, in any order.
    ///
    /// # Panics
    /// If the palette lacks a material of the scene.
    pub fn bake_many(&self, nodes: &[NodeId], palette: &PaletteMeans, keeps_ground: bool, on_done: impl Fn() + Sync) -> Vec<Baked> {
        // Without nodes, a heightmap need not be hashed.
        let cached = self.cache.as_deref().filter(|_| !nodes.is_empty()).map(|cache| (cache, self.keys(palette)));
        let bake = |&node: &NodeId| {
            let baked = self.make(node, palette, cached, keeps_ground);
            on_done();
            baked
        };
        nodes.par_iter().map(bake).collect()
    }

    /// The steepest slope, degrees. For a heightmap without added relief, it is the maximum over the triangles of neighbouring samples. For other
    /// worlds, slopes are measured at the points of a coarse grid, each over one vertex spacing of the finest LOD, and the result is their maximum.
    /// With a heightmap, the maximum also includes the slopes of the heightmap. The result is computed once and then cached.
    pub fn max_slope_deg(&self) -> f64 {
        *self.max_slope_deg.get_or_init(|| {
            let of_data = match &self.source {
                Source::Data { map, .. } => map.max_slope(),
                Source::Generated(_) => 0.0,
            };
            let scanned = if self.adds_relief() { self.scan_slope() } else { 0.0 };
            of_data.max(scanned).atan().to_degrees()
        })
    }

    /// Whether [`World::max_slope_deg`] is at least this many degrees. Where slopes are measured on a grid, this is usually faster than computing the
    /// maximum, because the first point that is steep enough ends the search.
    pub fn is_as_steep_as(&self, degrees: f64) -> bool {
        if degrees <= f64::from_bits(self.reached_deg.load(Ordering::Relaxed)) {
            return true;
        }
        let reaches = |i: u32, j: u32| self.scanned_slope(i, j).atan().to_degrees() >= degrees;
        let is_found = || (0..SCAN_SIDE).into_par_iter().any(|j| (0..SCAN_SIDE).any(|i| reaches(i, j)));
        let is = self.max_slope_deg.get().is_none() && self.adds_relief() && is_found() || self.max_slope_deg() >= degrees;
        if is {
            self.reached_deg.fetch_max(degrees.to_bits(), Ordering::Relaxed);
        }
        is
    }

    fn adds_relief(&self) -> bool {
        match &self.source {
            Source::Data { detail_m, .. } => *detail_m > 0.0,
            Source::Generated(_) => true,
        }
    }

    fn scan_slope(&self) -> f64 {
        let row = |j: u32| (0..SCAN_SIDE).map(|i| self.scanned_slope(i, j)).fold(0.0, f64::max);
        (0..SCAN_SIDE).into_par_iter().map(row).reduce(|| 0.0, f64::max)
    }

    /// Slope (tangent) at a point of the scan, measured over one vertex spacing of the finest LOD.
    fn scanned_slope(&self, i: u32, j: u32) -> f64 {
        let step = self.layout.spacing_m(self.layout.finest_lod);
        let at = |k: u32, axis: usize| ((f64::from(k) + 0.5) / f64::from(SCAN_SIDE) * 2.0 - 1.0) * (self.half_extent_m[axis] - step);
        let (x, y) = (at(i, 0), at(j, 1));
        let h = self.height_m(x, y);
        let (dx, dy) = (self.height_m(x + step, y) - h, self.height_m(x, y + step) - h);
        (dx * dx + dy * dy).sqrt() / step
    }
}

/// Name of the entries of a node in the cache.
fn name_of(node: NodeId) -> String {
    format!("{}-{}-{}", node.lod, node.x, node.y)
}

/// Rounds `length_m` to a multiple of the vertex spacing `vertices_m` if the two differ only by a rounding error; otherwise returns `length_m`.
/// Without the rounding, an edge of the data that should lie on a line of vertices could miss this line by a rounding error. The mesh would then have
/// a row of triangles with almost no width.
fn on_vertex(length_m: f64, vertices_m: f64) -> f64 {
    let nearest = (length_m / vertices_m).round() * vertices_m;
    if nearest > 0.0 && (nearest - length_m).abs() < 1e-6 * vertices_m { nearest } else { length_m }
}

/// Number of points along an edge of the grid that is scanned for the steepest slope.
const SCAN_SIDE: u32 = 192;

/// Lower limit of the width over which rules measure slope and curvature, metres, so that boulders do not count as cliffs.
const MIN_FOOTPRINT_M: f64 = 4.0;

/// Runs `work`, including its parallel parts, on this many threads; 0 = the default of rayon, usually one per core.
///
/// # Errors
/// [`Error::Request`] if the system refuses that many threads.
pub fn on_threads<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.map_err(|e| Error::Request(format!("cannot start {threads} worker threads: {e}; use fewer")))?.install(work))
}

//! The payload of a node: all data that streaming loads for one node of the quadtree (SYSTEMS A, the part of the talk on terrain data).
//!
//! Heights, normals and cones are computed from one grid of heights, so that they agree. The grid is wider than the node by a border. In nodes
//! coarser than the finest LOD, the grid is low-pass filtered, because relief that is finer than the spacing of the samples could otherwise be drawn
//! as rows of spikes.
//!
//! Heights on the edges of nodes are never filtered. Where nodes of different LODs meet, `geometry/stitch.wgsl` moves vertices of the finer node to
//! vertices of the coarser node, so both nodes must have equal heights on the common edge.
//!
//! Vertices beyond the edge of a heightmap are drawn at this edge ([`World::drawn_at`]), with the height of the ground there. This height is not
//! filtered either, because vertices that are drawn at the same place must have equal heights. Normals and cones use the distances between the drawn
//! positions of vertices.
//!
//! Slope and curvature for the splat rules are measured over a fixed footprint in metres, whatever the LOD of the node, and the height for
//! the rules is not filtered. So a coarse node has the same material as a fine one where both have a splat texel.

use std::sync::LazyLock;

use super::{NodeId, World, cones};
use crate::base::colour::srgb_from_linear;
use crate::blocks::{self, BlockFormat, Effort};

/// Heights along a node's edge.
pub const HEIGHT_SIDE: usize = 129;
/// Texels along the edge of the normal, albedo and colour modulation maps: 128, and 2 of border on each side.
pub const TEXTURE_SIDE: usize = 132;
/// Splat texels along a node's edge.
pub const SPLAT_SIDE: usize = 65;
/// Border texels on each side of the normal, albedo and colour modulation maps.
pub const BORDER: usize = 2;
/// Bytes of a payload.
pub const PAYLOAD_BYTES: usize = 72_419;

/// Heights along the edge of the working grid: vertices -2..=130, so that each of the 132 texels has heights at its 4 corners.
const GRID_SIDE: usize = TEXTURE_SIDE + 1;
/// Splat texels along the edge of the working grid: -1..=65, so that border texels of the albedo also lie between four splat texels.
const SPLAT_GRID_SIDE: usize = SPLAT_SIDE + 2;

/// Mean values of each material of the palette, one entry per material. The baked albedo, smoothness and specular occlusion of nodes are computed
/// from these values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PaletteMeans {
    /// Mean albedo, linear RGB, tint included, 0..=1.
    pub albedo: Vec<[f32; 3]>,
    /// Mean smoothness (1 - perceptual roughness), 0..=1.
    pub smoothness: Vec<f32>,
    /// Mean specular occlusion, 0..=1; 1 = not occluded.
    pub specular_occlusion: Vec<f32>,
}

/// The data that is loaded for one node; 72 419 bytes in GPU formats.
///
/// Positions are shares of the node's edge, measured from its south-west corner; row 0 is south. Vertex (i, j) is at (i/128, j/128), and splat texel
/// (i, j) is at (i/64, j/64). A 132 x 132 image begins 2 texels outside the node, and the centre of a texel is half a texel from its edges. So the
/// centre of texel (i, j) is at ((i - 1.5)/128, (j - 1.5)/128).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NodePayload {
    /// The node to which the data belong.
    pub id: NodeId,
    /// Smallest value of `height`.
    pub min_height: u16,
    /// Largest value of `height`.
    pub max_height: u16,
    /// R16_UNORM 129 x 129: elevation, relative to [`World::height_range_m`].
    pub height: Vec<u16>,
    /// BC3 132 x 132: alpha and green hold x and y of the world-space normal, each coordinate v as 0.5 v + 0.5. The z of the normal is above 0 and
    /// follows from them. Red = smoothness, blue = specular occlusion.
    pub normal: Vec<u8>,
    /// BC1 132 x 132, sRGB. Alpha of a texel is 0 if the vertex at its south-west corner is drawn where there is no ground ([`World::is_hole`]). For
    /// texel (i, j), this is vertex (i - 2, j - 2) of the node, because the border has 2 texels.
    pub albedo: Vec<u8>,
    /// BC1 132 x 132, linear. A value c multiplies the colour by 2 c, so 0.5 changes nothing.
    pub colour_modulation: Vec<u8>,
    /// R8 65 x 65: palette index.
    pub splat: Vec<u8>,
    /// BC3 8 x 8: one cone per patch, see [`cones`].
    pub cones: Vec<u8>,
}

impl NodePayload {
    /// Size of all textures together, in bytes: [`PAYLOAD_BYTES`].
    pub fn bytes(&self) -> usize {
        self.height.len() * 2 + self.normal.len() + self.albedo.len() + self.colour_modulation.len() + self.splat.len() + self.cones.len()
    }
}

/// Byte counts of the parts of a stored payload: the maps in the order of [`NodePayload`], then the [`Cover`].
const PARTS: [usize; 7] = [
    HEIGHT_SIDE * HEIGHT_SIDE * 2,
    TEXTURE_SIDE * TEXTURE_SIDE,
    TEXTURE_SIDE * TEXTURE_SIDE / 2,
    TEXTURE_SIDE * TEXTURE_SIDE / 2,
    SPLAT_SIDE * SPLAT_SIDE,
    cones::PATCHES * cones::PATCHES,
    SPLAT_GRID_SIDE * SPLAT_GRID_SIDE,
];

/// The bytes of a payload and its cover, for the cache.
pub(super) fn to_bytes(payload: &NodePayload, cover: &Cover) -> Vec<u8> {
    let NodePayload { id: _, min_height: _, max_height: _, height, normal, albedo, colour_modulation, splat, cones } = payload;
    [bytemuck::cast_slice(height), normal, albedo, colour_modulation, splat, cones, cover].concat()
}

/// Reads a payload and its cover from the bytes that [`to_bytes`] returns; `None` if the number of bytes is wrong.
pub(super) fn from_bytes(id: NodeId, bytes: &[u8]) -> Option<(NodePayload, Cover)> {
    if bytes.len() != PARTS.iter().sum::<usize>() {
        return None;
    }
    let mut rest = bytes;
    let [height, normal, albedo, colour_modulation, splat, cones, cover] = PARTS.map(|length| {
        let (part, after) = rest.split_at(length);
        rest = after;
        part.to_vec()
    });
    let height: Vec<u16> = bytemuck::pod_collect_to_vec(&height);
    let (min_height, max_height) = extremes(&height);
    Some((NodePayload { id, min_height, max_height, height, normal, albedo, colour_modulation, splat, cones }, cover))
}

/// The smallest and the largest of the heights.
fn extremes(height: &[u16]) -> (u16, u16) {
    (height.iter().copied().min().unwrap_or(0), height.iter().copied().max().unwrap_or(0))
}

/// The shape of the ground of a node (heights, slope and curvature), without materials: the input of the splat rules. It stays valid when the rules
/// change. It takes about 250 KB of memory.
pub struct Ground {
    id: NodeId,
    grid: Grid,
    /// Unfiltered elevations at splat texels -1..=65, metres.
    source: Vec<f64>,
    relief: RuleRelief,
}

impl Ground {
    pub(super) fn of(world: &World, id: NodeId) -> Ground {
        let (mut grid, broad) = Grid::of(world, id);
        let relief = RuleRelief::of(world, grid.origin, 2.0 * grid.spacing, &broad);
        // Splat texels are two vertices apart. The grid of vertices and the grid of splat texels both start one splat texel outside the node.
        let texels = (0..SPLAT_GRID_SIDE).flat_map(|j| (0..SPLAT_GRID_SIDE).map(move |i| (2 * i, 2 * j)));
        let source = texels.map(|(i, j)| grid.height(i, j)).collect();
        if id.lod > world.layout().finest_lod {
            grid.filter(world);
        }
        Ground { id, grid, source, relief }
    }

    /// The node to which this ground belongs.
    pub fn id(&self) -> NodeId {
        self.id
    }

    /// The bytes of the ground, for the cache.
    pub(super) fn to_bytes(&self) -> Vec<u8> {
        [&self.grid.heights, &self.source, self.relief.values.as_flattened()].map(bytemuck::cast_slice::<f64, u8>).concat()
    }

    /// Reads the ground of a node from the bytes that [`Ground::to_bytes`] returns; `None` if the number of bytes is wrong.
    pub(super) fn from_bytes(world: &World, id: NodeId, bytes: &[u8]) -> Option<Ground> {
        let (vertices, texels) = (GRID_SIDE * GRID_SIDE, SPLAT_GRID_SIDE * SPLAT_GRID_SIDE);
        if bytes.len() != (vertices + 3 * texels) * size_of::<f64>() {
            return None;
        }
        let mut heights: Vec<f64> = bytemuck::pod_collect_to_vec(bytes);
        let mut source = heights.split_off(vertices);
        let values = source.split_off(texels).chunks_exact(2).map(|pair| [pair[0], pair[1]]).collect();
        let layout = world.layout();
        let grid = Grid { origin: id.origin_m(layout).to_array(), spacing: layout.spacing_m(id.lod), heights };
        Some(Ground { id, grid, source, relief: RuleRelief { values } })
    }
}

/// Palette indices at the splat texels of a node and at one ring of splat texels around it, row by row: 67 x 67.
pub type Cover = Vec<u8>;

/// Makes the payload of a node from its ground and its materials.
pub(super) fn bake(world: &World, ground: &Ground, splat_grid: &Cover, palette: &PaletteMeans) -> NodePayload {
    let materials = world.material_count();
    assert!(
        palette.albedo.len() >= materials && palette.smoothness.len() >= materials && palette.specular_occlusion.len() >= materials,
        "the palette must have means for all {materials} materials of the scene"
    );
    let Ground { id, grid, .. } = ground;
    let height = grid.quantised(world);
    let mut splat = Vec::with_capacity(SPLAT_SIDE * SPLAT_SIDE);
    for j in 0..SPLAT_SIDE {
        splat.extend_from_slice(&splat_grid[(j + 1) * SPLAT_GRID_SIDE + 1..][..SPLAT_SIDE]);
    }
    let looks = Looks::of(splat_grid, palette);
    let (min_height, max_height) = extremes(&height);
    NodePayload {
        id: *id,
        min_height,
        max_height,
        normal: normals(world, grid, &looks),
        albedo: albedo(world, grid, &looks),
        colour_modulation: colour_modulation(world, grid),
        splat,
        cones: cones::encode(&patch_normals(world, &height, grid)),
        height,
    }
}

/// Heights of a node and its border, metres, before quantisation.
struct Grid {
    /// South-west corner of the node, world metres.
    origin: [f64; 2],
    /// Distance between neighbouring vertices, metres.
    spacing: f64,
    heights: Vec<f64>,
}

impl Grid {
    /// Returns the grid of a node, and the elevations from which slope and curvature are measured, at the splat texels -1..=65.
    fn of(world: &World, id: NodeId) -> (Grid, Vec<f64>) {
        let layout = world.layout();
        let origin = id.origin_m(layout).to_array();
        let spacing = layout.spacing_m(id.lod);
        let mut grid = Grid { origin, spacing, heights: Vec::with_capacity(GRID_SIDE * GRID_SIDE) };
        let mut broad = Vec::with_capacity(SPLAT_GRID_SIDE * SPLAT_GRID_SIDE);
        for j in 0..GRID_SIDE {
            for i in 0..GRID_SIDE {
                let [x, y] = grid.vertex(i, j);
                // Splat texels are two vertices apart. The grid of vertices and the grid of splat texels both start one splat texel outside the node.
                if i % 2 == 0 && j % 2 == 0 {
                    let [height, measured] = world.heights_m(x, y);
                    grid.heights.push(height);
                    broad.push(measured);
                } else {
                    grid.heights.push(world.height_m(x, y));
                }
            }
        }
        (grid, broad)
    }

    /// World position of vertex (i, j) of the working grid, which is vertex (i - 2, j - 2) of the node. Spacing and origin are whole
    /// numbers divided by powers of two, for which f64 is exact. So neighbouring nodes compute exactly the same position.
    fn vertex(&self, i: usize, j: usize) -> [f64; 2] {
        let at = |origin: f64, k: usize| origin + (k as f64 - BORDER as f64) * self.spacing;
        [at(self.origin[0], i), at(self.origin[1], j)]
    }

    fn height(&self, i: usize, j: usize) -> f64 {
        self.heights[j * GRID_SIDE + i]
    }

    /// Distances, metres, between the drawn positions of neighbouring vertices along an axis (0 = x, 1 = y). Entry k is the distance between vertices
    /// k and k + 1 of the working grid. Beyond the edge of a heightmap, distances are 0.
    fn steps(&self, world: &World, axis: usize) -> Vec<f64> {
        let at = |k: usize| world.clipped(axis, self.vertex(k, k)[axis]);
        (0..TEXTURE_SIDE).map(|k| at(k + 1) - at(k)).collect()
    }

    /// Whether a vertex and its eight neighbours all lie within the data, so that the vertex may be filtered.
    fn is_inner(&self, world: &World, i: usize, j: usize) -> bool {
        [self.vertex(i - 1, j - 1), self.vertex(i + 1, j + 1)].into_iter().all(|corner| world.drawn_at(corner) == corner)
    }

    /// Applies [`filtered`] to every vertex that has neighbours on all sides and is inner ([`Grid::is_inner`]).
    fn filter(&mut self, world: &World) {
        let last = GRID_SIDE - 1;
        let mut heights = self.heights.clone();
        for j in 1..last {
            for i in (1..last).filter(|&i| self.is_inner(world, i, j)) {
                heights[j * GRID_SIDE + i] = filtered(|i, j| self.height(i, j), i, j);
            }
        }
        self.heights = heights;
    }

    fn quantised(&self, world: &World) -> Vec<u16> {
        let mut height = Vec::with_capacity(HEIGHT_SIDE * HEIGHT_SIDE);
        for j in 0..HEIGHT_SIDE {
            for i in 0..HEIGHT_SIDE {
                height.push(world.quantise(self.height(i + BORDER, j + BORDER)));
            }
        }
        height
    }

    /// Unit normal at the centre of a texel, from the heights at its four corners. The argument is the column and the row of the texel, each with the
    /// distance between the corners of the texel along its axis, metres.
    fn normal(&self, [(i, width), (j, depth)]: [(usize, f64); 2]) -> [f64; 3] {
        let [sw, se, nw, ne] = [self.height(i, j), self.height(i + 1, j), self.height(i, j + 1), self.height(i + 1, j + 1)];
        let dx = (se - sw + ne - nw) / (2.0 * width);
        let dy = (nw - sw + ne - se) / (2.0 * depth);
        crate::shared::real::normalize([-dx, -dy, 1.0])
    }
}

/// Returns the filtered height of vertex (i, j) of a working grid. The filter is the mean of the vertex and its neighbours, with the weights 1 2 1
/// along each axis. It removes relief that alternates from vertex to vertex. The filter is weaker near the edges of the node. A height on the line
/// through an edge is not changed. A height one vertex away from such a line moves half of the way to the mean. The rule is the same on both sides of
/// an edge, so neighbouring nodes of one LOD compute the same heights in their borders.
fn filtered(height: impl Fn(usize, usize) -> f64, i: usize, j: usize) -> f64 {
    // Share of the way to the mean: 0 on a line through an edge of the node, 1/2 one vertex away from it, and 1 farther away.
    let share = |i: usize| (i.abs_diff(BORDER).min(i.abs_diff(GRID_SIDE - 1 - BORDER)).min(2)) as f64 / 2.0;
    let along_x = |j: usize| 0.25 * (height(i - 1, j) + height(i + 1, j)) + 0.5 * height(i, j);
    let mean = 0.25 * (along_x(j - 1) + along_x(j + 1)) + 0.5 * along_x(j);
    height(i, j) + share(i).min(share(j)) * (mean - height(i, j))
}

/// Height of vertex (i, j), 0..=128, of a node, metres: the value that is quantised for the payload.
pub(super) fn vertex_height_m(world: &World, id: NodeId, [i, j]: [u32; 2]) -> f64 {
    let layout = world.layout();
    let grid = Grid { origin: id.origin_m(layout).to_array(), spacing: layout.spacing_m(id.lod), heights: Vec::new() };
    let height = |i: usize, j: usize| {
        let [x, y] = grid.vertex(i, j);
        world.height_m(x, y)
    };
    let (i, j) = (i as usize + BORDER, j as usize + BORDER);
    if id.lod > layout.finest_lod && grid.is_inner(world, i, j) { filtered(height, i, j) } else { height(i, j) }
}

/// Returns the palette index of the material at each splat texel (i, j), for i and j from -1 to 65: the node, and one ring of splat texels around it.
pub(super) fn cover(world: &World, ground: &Ground) -> Cover {
    let Ground { grid, source, relief, .. } = ground;
    let mut splat = Vec::with_capacity(SPLAT_GRID_SIDE * SPLAT_GRID_SIDE);
    for j in 0..SPLAT_GRID_SIDE {
        for i in 0..SPLAT_GRID_SIDE {
            // Splat texels are two vertices apart. The grid of vertices and the grid of splat texels both start one splat texel outside the node.
            let [x, y] = grid.vertex(2 * i, 2 * j);
            let [slope_deg, curvature] = relief.at(i, j);
            splat.push(world.rules().material_at(source[j * SPLAT_GRID_SIDE + i], slope_deg, curvature, x, y));
        }
    }
    splat
}

/// Slope and curvature at splat texels, from differences over a fixed footprint.
///
/// The curvature and the derivatives of the height are computed at the points of a lattice that is fixed in the world. The spacing of the lattice is
/// half the footprint. If texels are closer together than lattice points, the values are interpolated bilinearly; otherwise each texel lies on a
/// lattice point. The slope of a texel follows from its derivatives. So slope and curvature are the same functions of position at all LODs.
struct RuleRelief {
    /// For each texel, the slope in degrees and the curvature.
    values: Vec<[f64; 2]>,
}

impl RuleRelief {
    /// `broad`: `World::broad_height_m` at each texel. It is used only for the curvature, and only if the texels lie on lattice points.
    fn of(world: &World, origin: [f64; 2], step: f64, broad: &[f64]) -> RuleRelief {
        let reach = world.footprint_m() / 2.0;
        let count = SPLAT_GRID_SIDE;
        let start = [origin[0] - step, origin[1] - step];
        let mut values = Vec::with_capacity(count * count);
        if step < reach {
            // Lattice points around the texels, and one more on each side for the central differences.
            let first = start.map(|s| (s / reach).floor() - 1.0);
            let side = ((count - 1) as f64 * step / reach).ceil() as usize + 4;
            let mut lattice = Vec::with_capacity(side * side);
            for j in 0..side {
                for i in 0..side {
                    lattice.push(world.broad_height_m((first[0] + i as f64) * reach, (first[1] + j as f64) * reach));
                }
            }
            let at = |i: usize, j: usize| lattice[j * side + i];
            let mut measured = vec![[0.0; 3]; side * side];
            for j in 1..side - 1 {
                for i in 1..side - 1 {
                    measured[j * side + i] = differences(at(i, j), at(i - 1, j), at(i + 1, j), at(i, j - 1), at(i, j + 1), reach);
                }
            }
            for j in 0..count {
                for i in 0..count {
                    let u = (start[0] + i as f64 * step) / reach - first[0];
                    let v = (start[1] + j as f64 * step) / reach - first[1];
                    let (a, b) = (u.floor(), v.floor());
                    let corner = |k: usize| measured[(b as usize + k / 2) * side + a as usize + k % 2];
                    let (fu, fv) = (u - a, v - b);
                    let weights = [(1.0 - fu) * (1.0 - fv), fu * (1.0 - fv), (1.0 - fu) * fv, fu * fv];
                    let mean = |c: usize| (0..4).map(|k| weights[k] * corner(k)[c]).sum::<f64>();
                    values.push(slope_and_curvature([mean(0), mean(1), mean(2)]));
                }
            }
        } else {
            for j in 0..count {
                for i in 0..count {
                    let (x, y) = (start[0] + i as f64 * step, start[1] + j as f64 * step);
                    let h = |dx: f64, dy: f64| world.broad_height_m(x + dx, y + dy);
                    let d = differences(broad[j * count + i], h(-reach, 0.0), h(reach, 0.0), h(0.0, -reach), h(0.0, reach), reach);
                    values.push(slope_and_curvature(d));
                }
            }
        }
        RuleRelief { values }
    }

    fn at(&self, i: usize, j: usize) -> [f64; 2] {
        self.values[j * SPLAT_GRID_SIDE + i]
    }
}

/// Returns the derivatives of the height along x and y, and minus half its Laplacian, by central differences.
pub(super) fn differences(centre: f64, west: f64, east: f64, south: f64, north: f64, reach: f64) -> [f64; 3] {
    [(east - west) / (2.0 * reach), (north - south) / (2.0 * reach), (4.0 * centre - west - east - south - north) / (2.0 * reach * reach)]
}

/// Returns the slope in degrees and the curvature from the values of [`differences`].
pub(super) fn slope_and_curvature([dx, dy, curvature]: [f64; 3]) -> [f64; 2] {
    [(dx * dx + dy * dy).sqrt().atan().to_degrees(), curvature]
}

/// Mean values of the materials at the 132 x 132 texel centres, interpolated between the four splat texels around each centre.
struct Looks {
    /// Linear RGB, smoothness, specular occlusion.
    texels: Vec<[f32; 5]>,
}

impl Looks {
    fn of(splat_grid: &[u8], palette: &PaletteMeans) -> Looks {
        let look = |index: u8| {
            let i = usize::from(index);
            let [r, g, b] = palette.albedo[i];
            [r, g, b, palette.smoothness[i], palette.specular_occlusion[i]]
        };
        let mut texels = Vec::with_capacity(TEXTURE_SIDE * TEXTURE_SIDE);
        // Texel i lies at (i - 1.5)/128 of the edge, which is (i - 1.5)/2 in splat texels. The working grid begins at splat texel -1, so 1 is added.
        let place = |i: usize| {
            let at = (i as f32 - 1.5) / 2.0 + 1.0;
            let cell = at.floor();
            (cell as usize, at - cell)
        };
        for j in 0..TEXTURE_SIDE {
            let (b, v) = place(j);
            for i in 0..TEXTURE_SIDE {
                let (a, u) = place(i);
                let at = |i: usize, j: usize| splat_grid[j * SPLAT_GRID_SIDE + i];
                let ids = [at(a, b), at(a + 1, b), at(a, b + 1), at(a + 1, b + 1)];
                if ids.iter().all(|&id| id == ids[0]) {
                    texels.push(look(ids[0]));
                    continue;
                }
                let weights = [(1.0 - u) * (1.0 - v), u * (1.0 - v), (1.0 - u) * v, u * v];
                let mut sum = [0.0; 5];
                for (id, weight) in ids.into_iter().zip(weights) {
                    for (s, c) in sum.iter_mut().zip(look(id)) {
                        *s += weight * c;
                    }
                }
                texels.push(sum);
            }
        }
        Looks { texels }
    }
}

fn unorm8(v: f64) -> u8 {
    (v * 255.0).round().clamp(0.0, 255.0) as u8
}

/// Returns, for each column (or row) of texels, the column from which its normals are computed, and the width of this column, metres. Usually, this
/// is the column itself. A column beyond the edge of a heightmap has no width, so its normals are those of the nearest column that has one. They are
/// needed, because texture filtering at the edge reads them. `steps`: the widths of all columns ([`Grid::steps`]).
fn columns_with_ground(steps: &[f64]) -> Vec<(usize, f64)> {
    let has_width = |k: &usize| steps[*k] > 0.0;
    let first = (0..steps.len()).find(has_width).unwrap_or(0);
    let last = (0..steps.len()).rfind(has_width).unwrap_or(steps.len() - 1);
    (0..steps.len()).map(|k| k.clamp(first, last)).map(|k| (k, steps[k])).collect()
}

fn normals(world: &World, grid: &Grid, looks: &Looks) -> Vec<u8> {
    let [columns, rows] = [0, 1].map(|axis| columns_with_ground(&grid.steps(world, axis)));
    let mut rgba = Vec::with_capacity(TEXTURE_SIDE * TEXTURE_SIDE * 4);
    for (looks, &row) in looks.texels.chunks_exact(TEXTURE_SIDE).zip(&rows) {
        for (look, &column) in looks.iter().zip(&columns) {
            let n = grid.normal([column, row]);
            let stored = |v: f64| unorm8(v * 0.5 + 0.5);
            rgba.extend_from_slice(&[unorm8(f64::from(look[3])), stored(n[1]), unorm8(f64::from(look[4])), stored(n[0])]);
        }
    }
    // The normal is more important than smoothness and occlusion. Its x is in alpha, which BC3 encodes separately. Its y is in green, so
    // green has the largest weight. Smoothness and occlusion become less accurate.
    blocks::encode(BlockFormat::Bc3, &rgba, TEXTURE_SIDE, TEXTURE_SIDE, [0.15, 1.0, 0.1], Effort::Fast)
}

/// sRGB bytes (IEC 61966-2-1) of 4097 linear values, indexed by the square root of the value. Evenly spaced linear values would be too coarse
/// for dark colours; evenly spaced square roots are accurate enough for 8 bits.
static SRGB: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let encode = |root: f64| unorm8(srgb_from_linear(root * root));
    (0..=4096).map(|i| encode(f64::from(i) / 4096.0)).collect()
});

fn srgb8(linear: f32) -> u8 {
    SRGB[(linear.clamp(0.0, 1.0).sqrt() * 4096.0).round() as usize]
}

fn albedo(world: &World, grid: &Grid, looks: &Looks) -> Vec<u8> {
    let mut rgba = Vec::with_capacity(TEXTURE_SIDE * TEXTURE_SIDE * 4);
    let far = TEXTURE_SIDE - 1;
    let whole = world.is_whole(grid.vertex(0, 0), grid.vertex(far, far));
    for j in 0..TEXTURE_SIDE {
        for i in 0..TEXTURE_SIDE {
            let look = looks.texels[j * TEXTURE_SIDE + i];
            let alpha = if whole || !world.opens_at(grid.vertex(i, j)) { 255 } else { 0 };
            rgba.extend_from_slice(&[srgb8(look[0]), srgb8(look[1]), srgb8(look[2]), alpha]);
        }
    }
    blocks::encode(BlockFormat::Bc1, &rgba, TEXTURE_SIDE, TEXTURE_SIDE, [0.3, 0.6, 0.1], Effort::Fast)
}

/// The colour modulation map of a world without colour modulation. All texels are about 0.5, the neutral value, and shading does not sample them.
static NEUTRAL: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let rgba = [128, 128, 128, 255].repeat(TEXTURE_SIDE * TEXTURE_SIDE);
    blocks::encode(BlockFormat::Bc1, &rgba, TEXTURE_SIDE, TEXTURE_SIDE, [1.0; 3], Effort::Fast)
});

fn colour_modulation(world: &World, grid: &Grid) -> Vec<u8> {
    if world.colour_modulation() <= 0.0 {
        return NEUTRAL.clone();
    }
    let mut rgba = Vec::with_capacity(TEXTURE_SIDE * TEXTURE_SIDE * 4);
    for j in 0..TEXTURE_SIDE {
        for i in 0..TEXTURE_SIDE {
            let [x, y] = grid.vertex(i, j);
            let half = grid.spacing / 2.0;
            let [r, g, b] = world.modulation_at(x + half, y + half);
            rgba.extend_from_slice(&[unorm8(r), unorm8(g), unorm8(b), 255]);
        }
    }
    blocks::encode(BlockFormat::Bc1, &rgba, TEXTURE_SIDE, TEXTURE_SIDE, [1.0; 3], Effort::Fast)
}

/// Whether the quad (i, j) is split from its south-west to its north-east corner. The other quads are split from south-east to north-west.
///
/// The diagonals alternate, so that every second vertex belongs to 8 triangles (ruling 11 in `ARCHITECTURE.md`).
pub const fn diagonal_rises(i: usize, j: usize) -> bool {
    (i + j).is_multiple_of(2)
}

/// Unit normals of the two triangles of each quad, grouped by patch. They are computed from the quantised heights that are drawn. Quads beyond the
/// edge of a heightmap have no area and no normals.
fn patch_normals(world: &World, height: &[u16], grid: &Grid) -> Vec<Vec<[f64; 3]>> {
    let quads = HEIGHT_SIDE - 1;
    let per_patch = quads / cones::PATCHES;
    let mut patches = vec![Vec::new(); cones::PATCHES * cones::PATCHES];
    let at = |i: usize, j: usize| world.elevation_m(height[j * HEIGHT_SIDE + i]);
    let steps = [0, 1].map(|axis| grid.steps(world, axis));
    for j in 0..quads {
        for i in 0..quads {
            let [width, depth] = [steps[0][i + BORDER], steps[1][j + BORDER]];
            if width <= 0.0 || depth <= 0.0 {
                continue;
            }
            let patch = &mut patches[j / per_patch * cones::PATCHES + i / per_patch];
            let corners = [at(i, j), at(i + 1, j), at(i, j + 1), at(i + 1, j + 1)];
            for [dx, dy] in triangle_gradients(corners, diagonal_rises(i, j)) {
                patch.push(crate::shared::real::normalize([-dx / width, -dy / depth, 1.0]));
            }
        }
    }
    patches
}

/// Returns the gradients of the two triangles of a quad: the change in height, metres, over one edge length of the quad along x and along y. The
/// first triangle has the southern edge, the second the northern edge. The corner heights are in the order south-west, south-east, north-west,
/// north-east. `rises`: see [`diagonal_rises`].
pub(super) fn triangle_gradients([sw, se, nw, ne]: [f64; 4], rises: bool) -> [[f64; 2]; 2] {
    if rises { [[se - sw, ne - se], [ne - nw, nw - sw]] } else { [[se - sw, nw - sw], [ne - nw, ne - se]] }
}

/// Height inside a quad at (u, v) in 0..=1 from its south-west corner. The corner heights are in the order of [`triangle_gradients`].
pub(crate) fn height_in_quad(corners: [f64; 4], rises: bool, u: f64, v: f64) -> f64 {
    let [sw, _, _, ne] = corners;
    let [southern, northern] = triangle_gradients(corners, rises);
    if rises {
        // The southern triangle contains the points with u >= v. Both triangles contain the south-west corner.
        let [dx, dy] = if u >= v { southern } else { northern };
        sw + dx * u + dy * v
    } else if u + v <= 1.0 {
        sw + southern[0] * u + southern[1] * v
    } else {
        ne - northern[0] * (1.0 - u) - northern[1] * (1.0 - v)
    }
}

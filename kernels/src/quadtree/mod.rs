//! Selects the nodes to draw. The quadtree is traversed from the roots down, level by level, and a node is split if it is close to the camera. All
//! nodes of a level are loaded before any of them is split.
//!
//! Which nodes are visited and drawn does not depend on the direction of the camera. So if each frame waits for its nodes (settled residency),
//! turning the camera loads no nodes, and no cached page of the virtual texture has to be rendered again. The stage `culling` drops what is outside
//! the frustum.
//!
//! Source: Moore, GDC 2018, "Traverse Quad Tree", "Terrain LOD Map", "Terrain Sector Data".
//! Reads the camera and the loaded nodes. Writes the node list, the LOD map and the sector data.
//! Runs on the CPU.

use glam::{DVec2, DVec3};

use crate::view::camera::View;
use crate::world::cones::{self, Cone};
use crate::world::payload::HEIGHT_SIDE;
use crate::world::{LODS, Layout, NODE_QUADS, NodeId, NodePayload, SECTORS, World};

mod detail;

pub use detail::{COARSE_STRIDES, stride_errors};

/// The data of a loaded node that the traversal and culling use.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeBounds {
    /// Lowest and highest elevation, metres.
    pub height_m: [f64; 2],
}

/// The data of a patch of a loaded node that culling uses. A node has 8 x 8 patches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PatchBounds {
    /// Lowest and highest elevation of the patch's vertices, metres, before any stitching.
    pub height_m: [f64; 2],
    /// For each of [`COARSE_STRIDES`], the largest error of the patch's surface with this vertex stride, metres ([`stride_errors`]). Infinite if a
    /// vertex of the patch is in a hole or beyond the data, because drawing fewer vertices could change the outline of the hole or of the data.
    pub errors_m: [f64; COARSE_STRIDES.len()],
    /// Contains the normals of the patch's triangles, before any stitching and at vertex stride 1.
    pub cone: Cone,
}

impl PatchBounds {
    /// Returns the bounds of the patches of a node, row by row from the south-west corner.
    pub fn of(world: &World, payload: &NodePayload) -> Vec<PatchBounds> {
        let quads = NODE_QUADS as usize / cones::PATCHES;
        let (origin, spacing) = (payload.id.origin_m(world.layout()), world.layout().spacing_m(payload.id.lod));
        let cones = cones::decode(&payload.cones);
        let bounds = cones.into_iter().enumerate().map(|(patch, cone)| {
            let first = (patch / cones::PATCHES * HEIGHT_SIDE + patch % cones::PATCHES) * quads;
            let corner = [patch % cones::PATCHES, patch / cones::PATCHES].map(|n| n * quads);
            let at = |x: usize, y: usize| origin + DVec2::new((corner[0] + x) as f64, (corner[1] + y) as f64) * spacing;
            let is_ground = |at: DVec2| world.drawn_at(at.to_array()) == at.to_array() && !world.is_hole(at.x, at.y);
            let errors_m = if (0..=quads).all(|y| (0..=quads).all(|x| is_ground(at(x, y)))) {
                stride_errors(|x, y| world.elevation_m(payload.height[first + y * HEIGHT_SIDE + x]))
            } else {
                [f64::INFINITY; COARSE_STRIDES.len()]
            };
            let rows = (0..=quads).flat_map(|row| &payload.height[first + row * HEIGHT_SIDE..][..=quads]);
            let (low, high) = rows.fold((u16::MAX, 0), |(low, high), &height| (low.min(height), high.max(height)));
            PatchBounds { height_m: [low, high].map(|height| world.elevation_m(height)), errors_m, cone }
        });
        bounds.collect()
    }
}

/// A node that is not visited, but would be if all nodes were available.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// The node.
    pub node: NodeId,
    /// Whether the node is available. Even then, it is not visited if one of its ancestors is not split.
    pub is_available: bool,
    /// Distance of the parent from the camera, divided by the edge length of the parent.
    pub distance: f64,
    /// Whether the parent may be in the frustum.
    pub is_in_view: bool,
}

/// The nodes of one frame.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// All visited nodes, coarse before fine. They must all be resident.
    pub visited: Vec<NodeId>,
    /// The nodes to draw. They cover the whole ground and do not overlap.
    pub drawn: Vec<NodeId>,
    /// The nodes that are not visited, but would be if all nodes were available. Empty if and only if the drawn nodes are those that would be drawn
    /// if all nodes were available.
    ///
    /// Their elevations may be unknown, so the range of elevations of the nearest visited ancestor is used instead. The two ranges may differ, so too
    /// many or too few nodes may be listed until the ancestors have arrived.
    pub wanted: Vec<Wanted>,
}

/// Largest height of a quad on the screen, pixels, without a LOD bias. A node is split if, at its point nearest to the camera, a quad that faces the
/// camera would be taller than this. The bounds of [`SPLIT_RATIO`] take precedence over this limit.
pub const QUAD_PX: f64 = 2.5;
/// Bounds of the split ratio: a node is split if its distance from the camera, divided by its edge length, is less than the split ratio.
/// The lower bound applies before the LOD bias. Without it, small pictures would have coarse nodes near the camera, and the splat texels of
/// these nodes would be coarse, too. The upper bound limits the number of nodes in large pictures, because the resident nodes must fit in
/// the atlases.
pub const SPLIT_RATIO: [f64; 2] = [0.6, 2.0];

/// Returns the split ratio, see `SPLIT_RATIO`. Adding 1 to the LOD bias halves the ratio, unless the upper bound limits it.
fn split_ratio(view: &View, lod_bias: f64) -> f64 {
    let focal_px = f64::from(view.size[1]) / (2.0 * (view.pose.fov / 2.0).tan());
    let ratio = (focal_px / (f64::from(NODE_QUADS) * QUAD_PX)).clamp(SPLIT_RATIO[0], SPLIT_RATIO[1]);
    (ratio * (-lod_bias).exp2()).min(SPLIT_RATIO[1])
}

/// Minimum and maximum corner of the bounding box of a node, in the local coordinates of the view: x and y in metres from the south-west corner of
/// the camera's sector, z is the elevation in metres.
pub fn local_box(node: NodeId, bounds: NodeBounds, layout: &Layout, view: &View) -> (DVec3, DVec3) {
    let edge = layout.node_m(node.lod);
    let first_sector = DVec2::new(f64::from(node.x), f64::from(node.y)) * f64::from(1u32 << node.lod);
    let corner = (first_sector - view.sector.as_dvec2()) * layout.sector_m;
    (corner.extend(bounds.height_m[0]), (corner + edge).extend(bounds.height_m[1]))
}

/// Minimum and maximum corner of the bounding box of a patch, as in [`local_box`]. `patch`: its column and row. `height_m`: lowest and highest
/// elevation, metres.
pub fn patch_box(node: NodeId, patch: [u32; 2], height_m: [f64; 2], layout: &Layout, view: &View) -> (DVec3, DVec3) {
    let (low, _) = local_box(node, NodeBounds { height_m }, layout, view);
    let edge = layout.node_m(node.lod) / cones::PATCHES as f64;
    let corner = low.truncate() + DVec2::from_array(patch.map(f64::from)) * edge;
    (corner.extend(height_m[0]), (corner + edge).extend(height_m[1]))
}

/// Limits of the LOD bias, see [`select`].
pub const LOD_BIASES: [f64; 2] = [-2.0, 4.0];

/// The conditions under which nodes are split.
struct Rule<'a> {
    world: &'a World,
    view: &'a View,
    ratio: f64,
}

impl Rule<'_> {
    /// Returns the children of a node into which it should be split, and the distance of the node divided by its edge length. There are no children
    /// if the camera is too far away or the node has the finest LOD. Children outside the world are left out.
    fn children(&self, node: NodeId, bounds: NodeBounds) -> (Vec<NodeId>, f64) {
        let layout = self.world.layout();
        let (low, high) = local_box(node, bounds, layout, self.view);
        let distance = self.view.camera.clamp(low, high).distance(self.view.camera);
        let is_split = distance < self.ratio * layout.node_m(node.lod) && node.lod > layout.finest_lod;
        let existing = |children: [NodeId; 4]| children.into_iter().filter(|&child| self.world.exists(child)).collect();
        (if is_split { existing(node.children()) } else { Vec::new() }, distance / layout.node_m(node.lod))
    }

    /// Adds the nodes below `node` that would be visited if all nodes were available. `bounds`: bounds of `node` if it is visited, otherwise of its
    /// nearest visited ancestor.
    fn want(&self, node: NodeId, bounds: NodeBounds, is_available: &impl Fn(NodeId) -> bool, wanted: &mut Vec<Wanted>) {
        let (children, distance) = self.children(node, bounds);
        let (low, high) = local_box(node, bounds, self.world.layout(), self.view);
        let is_in_view = self.view.sees(low, high);
        for child in children {
            wanted.push(Wanted { node: child, is_available: is_available(child), distance, is_in_view });
            self.want(child, bounds, is_available, wanted);
        }
    }
}

/// Traverses the tree. A node is split if the camera is near and all its children are available. So the drawn nodes cover the ground, whatever is
/// available. The roots count as available.
///
/// `lod_bias`: about how many levels coarser than usual the nodes are. Negative values make them finer. The upper bound of [`SPLIT_RATIO`] limits
/// this, because the nodes must fit in the atlases. `load` receives the nodes that are needed next, all of one level, and returns their bounds in the
/// same order.
///
/// # Errors
/// The errors of `load`.
pub fn select<E>(
    world: &World,
    view: &View,
    lod_bias: f64,
    is_available: impl Fn(NodeId) -> bool,
    mut load: impl FnMut(&[NodeId]) -> std::result::Result<Vec<NodeBounds>, E>,
) -> std::result::Result<Selection, E> {
    let rule = Rule { world, view, ratio: split_ratio(view, lod_bias) };
    let mut selection = Selection::default();
    let mut level: Vec<NodeId> = NodeId::roots().filter(|&node| world.exists(node)).collect();
    while !level.is_empty() {
        let bounds = load(&level)?;
        selection.visited.extend_from_slice(&level);
        let mut next = Vec::new();
        for (&node, &bounds) in level.iter().zip(&bounds) {
            let (children, _) = rule.children(node, bounds);
            if !children.is_empty() && children.iter().all(|&child| is_available(child)) {
                next.extend(children);
            } else {
                selection.drawn.push(node);
                rule.want(node, bounds, &is_available, &mut selection.wanted);
            }
        }
        level = next;
    }
    Ok(selection)
}

/// How much coarser the drawn nodes are than those that would be drawn if all nodes were available.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Lag {
    /// Share of the drawn sectors in which a coarser node is drawn, 0..=1.
    pub share: f64,
    /// Mean number of levels by which the drawn nodes are coarser, over the sectors that `share` counts; 0 if there are none.
    pub levels: f64,
    /// Largest number of levels in any sector.
    pub largest: u8,
}

/// Compares the drawn nodes with the wanted ones.
pub fn lag(selection: &Selection) -> Lag {
    let mut wanted = lod_map(&selection.drawn);
    let drawn = wanted.clone();
    // The finest of the wanted nodes of a sector is the one that would be drawn there.
    for Wanted { node, .. } in &selection.wanted {
        for_sectors(*node, |row| row.iter_mut().for_each(|lod| *lod = (*lod).min(node.lod)), &mut wanted);
    }
    let differences: Vec<u8> = drawn.iter().zip(&wanted).map(|(drawn, wanted)| drawn - wanted).filter(|&n| n > 0).collect();
    let covered: usize = selection.drawn.iter().map(|node| 1usize << (2 * node.lod)).sum();
    let sum: f64 = differences.iter().copied().map(f64::from).sum();
    Lag {
        share: differences.len() as f64 / covered.max(1) as f64,
        levels: sum / differences.len().max(1) as f64,
        largest: differences.into_iter().max().unwrap_or(0),
    }
}

/// Calls `change` with each row of the sectors that a node covers. `map` has an entry for each sector, row by row from the south.
fn for_sectors<T>(node: NodeId, mut change: impl FnMut(&mut [T]), map: &mut [T]) {
    let edge = 1usize << node.lod;
    let (x, y) = (usize::from(node.x) * edge, usize::from(node.y) * edge);
    for row in y..y + edge {
        change(&mut map[row * usize::from(SECTORS) + x..][..edge]);
    }
}

/// Returns the LOD drawn in each sector, row by row from the south. Sectors in which no node is drawn have the value 0, the finest LOD, so that
/// no patch is stitched to them.
pub fn lod_map(drawn: &[NodeId]) -> Vec<u8> {
    let mut map = vec![0; usize::from(SECTORS) * usize::from(SECTORS)];
    for &node in drawn {
        for_sectors(node, |row| row.fill(node.lod), &mut map);
    }
    map
}

/// Returns the LOD drawn at a position, which is given in sectors from the south-west corner of the world; `None` outside the world.
pub fn lod_at(map: &[u8], place: [f64; 2]) -> Option<u8> {
    let [x, y] = place.map(f64::floor);
    let edge = f64::from(SECTORS);
    if !(0.0..edge).contains(&x) || !(0.0..edge).contains(&y) {
        return None;
    }
    map.get(y as usize * usize::from(SECTORS) + x as usize).copied()
}

/// Number of bits of the sector data that hold the atlas slot of one LOD.
pub const SLOT_BITS: u32 = 10;

/// Packs the sector data: for each sector and LOD, 10 bits hold the atlas slot of the loaded node that covers the sector. Slots count from
/// 1; 0 = no node is loaded.
pub fn sector_data(nodes: impl Iterator<Item = (NodeId, u32)>) -> Vec<[u32; 2]> {
    let mut packed = vec![0u64; usize::from(SECTORS) * usize::from(SECTORS)];
    for (node, slot) in nodes {
        debug_assert!((1..1 << SLOT_BITS).contains(&slot) && node.lod < LODS);
        let bits = u64::from(slot) << (u32::from(node.lod) * SLOT_BITS);
        for_sectors(node, |row| row.iter_mut().for_each(|entry| *entry |= bits), &mut packed);
    }
    packed.into_iter().map(|bits| [bits as u32, (bits >> 32) as u32]).collect()
}

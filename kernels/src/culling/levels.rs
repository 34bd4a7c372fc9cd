//! Levels: the vertex stride of each patch, and the distance between the vertices on each side of a patch.
//!
//! The level of a patch is the LOD of its node plus log2 of its vertex stride, so patches of equal level have equally large quads. Where patches of
//! different levels meet, cracks are avoided by welding: all patches move their vertices on the common side to the vertices of the coarsest level.
//! Source: Moore, GDC 2018, "LOD Transitions", where only nodes differ in level; ruling 8 in `ARCHITECTURE.md`.

use super::{DrawnNode, PATCH_QUADS, PATCHES};
use crate::quadtree::{COARSE_STRIDES, PatchBounds, patch_box};
use crate::view::camera::View;
use crate::world::{Layout, NodeId, SECTORS};

/// Log2 of the largest vertex stride of a patch. With this stride, a patch consists of two triangles.
pub const LOG2_LARGEST_STRIDE: u32 = PATCH_QUADS.ilog2();
const _: () = assert!(COARSE_STRIDES[COARSE_STRIDES.len() - 1] == PATCH_QUADS);

/// The levels of the patches of drawn nodes. The vertex stride of each patch, and the level of each side of a patch, follow from them.
#[derive(Clone, Debug, Default)]
pub struct Levels {
    /// For each node, the levels of its 8 x 8 patches, row by row from the south-west corner.
    nodes: Vec<(NodeId, Vec<u8>)>,
    /// For each sector, row by row from the south, the index of its node plus 1; 0 = no node is drawn there.
    sectors: Vec<u32>,
}

/// A side of a patch. Side k has its delta in bits 4 k to 4 k + 3 of the packed deltas ([`Levels::deltas`]).
#[derive(Clone, Copy)]
enum Side {
    West,
    South,
    East,
    North,
}

impl Side {
    const ALL: [Side; 4] = [Side::West, Side::South, Side::East, Side::North];

    fn opposite(self) -> Side {
        match self {
            Side::West => Side::East,
            Side::South => Side::North,
            Side::East => Side::West,
            Side::North => Side::South,
        }
    }
}

impl Levels {
    /// The levels of the patches of `nodes`. `log2_stride` returns log2 of the vertex stride that a patch should have, 0 to 4; its arguments are the
    /// index of the node, and the column and row of the patch. `log2_least`: log2 of the least stride, 0 to 2.
    ///
    /// The quads of a patch should be at most as wide as the patches of a finer node nearby; otherwise, the finer node's vertices would be welded
    /// over more than one of its patches. So a stride is lowered to meet this limit, but not below the least stride. If a coarse neighbour exceeds
    /// the limit even with the least stride, all patches of the finer node have the least stride.
    pub fn new(nodes: &[NodeId], log2_least: u8, log2_stride: impl Fn(usize, [u32; 2]) -> u8) -> Levels {
        let side = usize::from(SECTORS);
        let mut levels = Levels { nodes: nodes.iter().map(|&node| (node, Vec::new())).collect(), sectors: vec![0; side * side] };
        for (index, node) in (1..).zip(nodes) {
            let edge = 1usize << node.lod;
            let (x, y) = (usize::from(node.x) * edge, usize::from(node.y) * edge);
            (y..y + edge).for_each(|row| levels.sectors[row * side + x..][..edge].fill(index));
        }
        let log2_quads = LOG2_LARGEST_STRIDE as u8;
        // The finest and the coarsest LOD among a node and its neighbours.
        let finest_and_coarsest = |node: NodeId| {
            levels.around(node).fold([node.lod; 2], |[finest, coarsest], next| {
                let lod = levels.nodes[next].0.lod;
                [finest.min(lod), coarsest.max(lod)]
            })
        };
        let ends: Vec<[u8; 2]> = nodes.iter().map(|&node| finest_and_coarsest(node)).collect();
        let coarsest_level = |index: usize, node: NodeId| {
            let least = node.lod + log2_least;
            if ends[index][1] + log2_least > node.lod + log2_quads {
                // A neighbour is so coarse that its quads are wider than a patch of this node, even with the least stride. Welding then moves
                // vertices of this node over more than one patch. There are no cracks if all patches of this node have the same stride.
                return least;
            }
            // The finest LOD is taken over this node, its neighbours and their neighbours. Neighbours of neighbours count, because all patches along
            // one side of a coarser patch weld their vertices to the same level, and these patches may belong to several nodes.
            let finest = levels.around(node).map(|next| ends[next][0]).fold(ends[index][0], u8::min);
            least.max(finest + log2_quads)
        };
        let patches = || (0..PATCHES).flat_map(|row| (0..PATCHES).map(move |column| [column, row]));
        let of = |(index, &node): (usize, &NodeId)| {
            let most = coarsest_level(index, node);
            (node, patches().map(|patch| (node.lod + log2_stride(index, patch).max(log2_least)).min(most)).collect())
        };
        levels.nodes = nodes.iter().enumerate().map(of).collect();
        levels
    }

    /// The levels for a view. Each patch should have the largest of the strides 1, 2, 4, 8 and 16 for which this stride and all smaller ones move the
    /// surface by at most `error_px` pixels on the screen; [`Levels::new`] adjusts this stride. If `error_px` is 0, all patches have the least
    /// stride, 2^`log2_least`. The bound on the shift of the surface is the error of the stride in metres ([`PatchBounds::errors_m`]) times
    /// [`View::shift_px_per_m`].
    ///
    /// [`PatchBounds::errors_m`]: crate::quadtree::PatchBounds::errors_m
    pub fn of(nodes: &[DrawnNode<'_>], layout: &Layout, eye: &View, log2_least: u8, error_px: f64) -> Levels {
        let ids: Vec<NodeId> = nodes.iter().map(|drawn| drawn.node).collect();
        let allowed: Vec<Vec<u8>> = nodes
            .iter()
            .map(|drawn| {
                let patches = (0..PATCHES).flat_map(|row| (0..PATCHES).map(move |column| [column, row]));
                let log2_stride = |(patch, bounds): ([u32; 2], &PatchBounds)| {
                    if error_px <= 0.0 {
                        return 0;
                    }
                    let (low, high) = patch_box(drawn.node, patch, bounds.height_m, layout, eye);
                    let allowed_m = error_px / eye.shift_px_per_m(low, high);
                    bounds.errors_m.iter().take_while(|&&error_m| error_m <= allowed_m).count() as u8
                };
                patches.zip(drawn.patches).map(log2_stride).collect()
            })
            .collect();
        Levels::new(&ids, log2_least, |node, [column, row]| allowed[node].get((row * PATCHES + column) as usize).copied().unwrap_or(0))
    }

    /// Log2 of the vertex stride of a patch; 0 for a node that is not drawn.
    pub fn log2_stride(&self, node: NodeId, patch: [u32; 2]) -> u32 {
        u32::from(self.level(node, patch).map_or(0, |level| level - node.lod))
    }

    /// The packed deltas of a patch: 4 bits for each side, north << 12 | east << 8 | south << 4 | west. If a side is coarser than the patch, its
    /// delta is the level of the side minus the LOD of the node. Otherwise, it is 0. All deltas of a node that is not drawn are 0.
    pub fn deltas(&self, node: NodeId, patch: [u32; 2]) -> u32 {
        let Some(own) = self.level(node, patch) else { return 0 };
        let delta = |side| match self.side_level(node, patch, side) {
            Some(level) if level > own => u32::from(level - node.lod),
            _ => 0,
        };
        Side::ALL.into_iter().map(|side| delta(side) << (4 * side as u32)).sum()
    }

    /// Whether stitching may move vertices out of a patch, because the vertices on one of its sides are farther apart than the patch is wide.
    /// `deltas`: the packed deltas of the patch.
    pub fn reaches_out(deltas: u32) -> bool {
        (0..4).any(|side| (deltas >> (4 * side)) & 15 > LOG2_LARGEST_STRIDE)
    }

    fn level(&self, node: NodeId, [column, row]: [u32; 2]) -> Option<u8> {
        let [x, y] = [node.x, node.y].map(|at| i64::from(at) << node.lod);
        let (found, levels) = &self.nodes[self.node_at(x, y)?];
        (*found == node).then(|| levels[(row * PATCHES + column) as usize])
    }

    /// The level of a side: the coarsest level of all patches that touch this side. If the neighbour is a coarser node, these are the coarser patch
    /// and all patches along its side, so that all of them get the same result. `None` = the node is not drawn.
    fn side_level(&self, node: NodeId, patch: [u32; 2], side: Side) -> Option<u8> {
        // Positions are measured in patches of LOD 0.
        let edge = 1i64 << node.lod;
        let along = |node: u16, patch: u32| (i64::from(node) * i64::from(PATCHES) + i64::from(patch)) * edge;
        let (x, y) = (along(node.x, patch[0]), along(node.y, patch[1]));
        let beyond = |k: i64| match side {
            Side::West => self.patch_at(x - 1, y + k),
            Side::South => self.patch_at(x + k, y - 1),
            Side::East => self.patch_at(x + edge, y + k),
            Side::North => self.patch_at(x + k, y + edge),
        };
        if let Some((coarser, patch)) = beyond(0).filter(|(next, _)| next.lod > node.lod) {
            return self.side_level(coarser, patch, side.opposite());
        }
        let mut level = self.level(node, patch)?;
        let mut k = 0;
        while k < edge {
            let next = beyond(k);
            level = next.and_then(|(next, patch)| self.level(next, patch)).map_or(level, |next| level.max(next));
            k += next.map_or(1, |(next, _)| 1 << next.lod);
        }
        Some(level)
    }

    /// The indices of the drawn nodes that touch a node at a side or at a corner. A node may occur several times.
    fn around(&self, node: NodeId) -> impl Iterator<Item = usize> {
        let edge = 1i64 << node.lod;
        let [west, south] = [node.x, node.y].map(|at| i64::from(at) * edge);
        let ring = (-1..=edge).flat_map(move |k| [[k, -1], [k, edge], [-1, k], [edge, k]]);
        ring.filter_map(move |[x, y]| self.node_at(west + x, south + y))
    }

    /// The index of the drawn node in a sector.
    fn node_at(&self, x: i64, y: i64) -> Option<usize> {
        let [x, y] = [x, y].map(|at| usize::try_from(at).ok().filter(|&sector| sector < usize::from(SECTORS)));
        let index = *self.sectors.get(y? * usize::from(SECTORS) + x?)?;
        (index as usize).checked_sub(1)
    }

    /// The drawn node and its patch at a position, which is measured in patches of LOD 0 from the south-west corner of the world.
    fn patch_at(&self, x: i64, y: i64) -> Option<(NodeId, [u32; 2])> {
        let patches = i64::from(PATCHES);
        let node = self.nodes[self.node_at(x.div_euclid(patches), y.div_euclid(patches))?].0;
        let within = |at: i64, of_node: u16| u32::try_from((at >> node.lod) - i64::from(of_node) * patches).ok();
        Some((node, [within(x, node.x)?, within(y, node.y)?]))
    }
}

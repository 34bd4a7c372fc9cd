//! The drawn ground on the CPU: its triangles, and its elevation at any position.
//!
//! The triangles follow from the drawn nodes and from the levels of their patches. Their vertices are those of the shader ([`super::reference`]): on
//! the sides of patches, they are moved to the vertices that all patches at the side have.

use glam::{DVec2, DVec3};

use super::reference::{place, stitch, vertex};
use crate::culling::{Levels, PATCH_QUADS, PATCHES};
use crate::world::payload::diagonal_rises;
use crate::world::{LODS, Layout, NodeId, World};

/// The drawn ground of a frame.
#[derive(Clone, Copy)]
pub struct Surface<'a> {
    /// The world.
    pub world: &'a World,
    /// The nodes that are drawn; they do not overlap.
    pub drawn: &'a [NodeId],
    /// The levels of the patches of the drawn nodes.
    pub levels: &'a Levels,
}

/// A triangle of a node.
#[derive(Clone, Copy, Debug)]
pub struct NodeTriangle {
    /// Indices of its vertices in the node, already stitched, in counter-clockwise order if seen from above.
    pub corners: [[u32; 2]; 3],
    /// The vertex stride of its patch.
    pub stride: u32,
}

impl Surface<'_> {
    /// The drawn node at a position, world metres; `None` = no node is drawn there.
    pub fn node_at(&self, at: DVec2) -> Option<NodeId> {
        let layout = self.world.layout();
        (0..LODS).filter_map(|lod| layout.node_at(lod, at.x, at.y)).find(|node| self.drawn.contains(node))
    }

    /// The vertices of the triangle that is drawn at a position, world metres, in counter-clockwise order if seen from above. `None` = no ground is
    /// drawn there: the position is outside the data or the drawn nodes, or a vertex of the triangle is in a hole.
    pub fn triangle_at(&self, at: DVec2) -> Option<[DVec3; 3]> {
        let [east, north] = self.world.extent_m().map(|extent| extent / 2.0);
        let node = self.node_at(at).filter(|_| at.x.abs() <= east && at.y.abs() <= north)?;
        // The position lies in exactly one triangle, or on a common edge. With rounding, it may seem to lie slightly outside all triangles. So the
        // triangle in which the position lies farthest inside is taken (`inside_m`).
        let places = |triangle: &NodeTriangle| triangle.corners.map(|corner| place(self.world, node, corner));
        let triangles = triangles_near(node, self.world.layout(), self.levels, at);
        let inside = triangles.into_iter().map(|triangle| (inside_m(places(&triangle), at), triangle));
        let (_, found) = inside.max_by(|(a, _), (b, _)| a.total_cmp(b))?;
        // The geometry pass drops a triangle if one of its vertices is in a hole (ruling 11 in `ARCHITECTURE.md`).
        let is_dropped = places(&found).into_iter().any(|place| self.world.is_hole(place.x, place.y));
        (!is_dropped).then(|| found.corners.map(|corner| vertex(self.world, node, corner)))
    }

    /// Elevation of the drawn ground at the world position (`x`, `y`), metres: that of the triangle that is drawn there. `None` as for
    /// [`Surface::triangle_at`].
    pub fn height_m(&self, x: f64, y: f64) -> Option<f64> {
        let at = DVec2::new(x, y);
        let [a, b, c] = self.triangle_at(at)?;
        let normal = (b - a).cross(c - a);
        let height = a.z - normal.truncate().dot(at - a.truncate()) / normal.z;
        height.is_finite().then_some(height)
    }
}

/// Returns the triangles of a node that may contain a position; some of them are farther away. They are the triangles of the quads next to the
/// position. Stitching moves vertices along the sides of patches, so for a position next to a side, the triangles of all quads along that side are
/// included. If stitching moves vertices out of a patch, all triangles of the patch are included.
pub fn triangles_near(node: NodeId, layout: &Layout, levels: &Levels, at: DVec2) -> Vec<NodeTriangle> {
    let at = (at - node.origin_m(layout)) / layout.spacing_m(node.lod);
    let mut triangles = Vec::new();
    for patch in (0..PATCHES).flat_map(|row| (0..PATCHES).map(move |column| [column, row])) {
        let (first, deltas, stride) = (patch.map(|n| n * PATCH_QUADS), levels.deltas(node, patch), 1 << levels.log2_stride(node, patch));
        let reaches_out = Levels::reaches_out(deltas);
        let edge = f64::from(stride);
        let is_near = |quad: u32, at: f64| (f64::from(quad) + 0.5 * edge - at).abs() <= 1.5 * edge;
        let is_outermost = |quad: u32, first: u32| quad == first || quad == first + PATCH_QUADS - stride;
        let is_beside = |k: usize, at: f64| (f64::from(first[k]) - edge..=f64::from(first[k] + PATCH_QUADS) + edge).contains(&at);
        if !(reaches_out || is_beside(0, at.x) && is_beside(1, at.y)) {
            continue;
        }
        for j in (first[1]..first[1] + PATCH_QUADS).step_by(stride as usize) {
            for i in (first[0]..first[0] + PATCH_QUADS).step_by(stride as usize) {
                let along = [is_near(i, at.x) || is_outermost(j, first[1]), is_near(j, at.y) || is_outermost(i, first[0])];
                if !(reaches_out || along[0] && along[1]) {
                    continue;
                }
                let corner = |x: u32, y: u32| stitch([i + x * stride, j + y * stride], first, PATCH_QUADS, deltas);
                let [sw, se, nw, ne] = [corner(0, 0), corner(1, 0), corner(0, 1), corner(1, 1)];
                let rises = diagonal_rises(((i - first[0]) / stride) as usize, ((j - first[1]) / stride) as usize);
                let two = if rises { [[sw, se, ne], [sw, ne, nw]] } else { [[sw, se, nw], [se, ne, nw]] };
                triangles.extend(two.map(|corners| NodeTriangle { corners, stride }));
            }
        }
    }
    triangles
}

/// Returns the smallest of the signed distances, in metres, of a point from the lines through the sides of a counter-clockwise triangle. A distance
/// is positive on the inner side of the line, so the result is negative if the point is outside the triangle. It is negative infinity if the triangle
/// has no area.
pub fn inside_m(triangle: [DVec2; 3], point: DVec2) -> f64 {
    let [a, b, c] = triangle;
    if (b - a).perp_dot(c - a) <= 0.0 {
        return f64::NEG_INFINITY;
    }
    let beyond = |from: DVec2, to: DVec2| (to - from).perp_dot(point - from) / (to - from).length();
    beyond(a, b).min(beyond(b, c)).min(beyond(c, a))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene;
    use crate::shared::hash;

    /// A number in [0, 1).
    fn unit(i: u32, k: u32) -> f64 {
        f64::from(hash::pcg4d([i, k, 0, 0])[0]) / 4_294_967_296.0
    }

    #[test]
    fn triangles_cover_a_node_once_also_where_borders_are_welded() {
        let layout = Layout::of(10_240.0, None);
        let south_west = NodeId { lod: 2, x: 7, y: 7 };
        // Each tested node has two coarser neighbours. One is two levels coarser. The other is one level or five levels coarser. At five levels, its
        // vertices are farther apart than the edge of a patch. The neighbours lie to the east and south of the first node, and to the north and west
        // of the second.
        let of_node = |node: NodeId| [1, 5].map(|lod| [node, south_west, NodeId { lod, x: 32 >> lod, y: 32 >> lod }]);
        for nodes in [NodeId { lod: 0, x: 31, y: 32 }, NodeId { lod: 0, x: 32, y: 31 }].into_iter().flat_map(of_node) {
            for i in 0..800 {
                let node = nodes[0];
                let log2_least = (i % 3) as u8;
                let of_patch = |node: usize, [column, row]: [u32; 2]| (unit(i, 40 + 8 * row + column + node as u32) * 5.0) as u8;
                let levels = Levels::new(&nodes, log2_least, of_patch);
                let stride = 1 << (log2_least + [0, 2][i as usize / 3 % 2]);
                // Half of the coordinates lie in the outermost quads.
                let along = |k: u32| {
                    let u = unit(i, k);
                    let share = if (i + k).is_multiple_of(2) {
                        u
                    } else {
                        (2.0 * u).floor() * (1.0 - f64::from(stride) / 128.0) + f64::from(stride) * u / 128.0
                    };
                    share * layout.node_m(0)
                };
                let at = node.origin_m(&layout) + DVec2::new(along(0), along(1));
                let position =
                    |[x, y]: [u32; 2]| node.origin_m(&layout) + DVec2::new(f64::from(x), f64::from(y)) * layout.spacing_m(node.lod);
                let triangles = triangles_near(node, &layout, &levels, at);
                let inside: Vec<f64> = triangles.into_iter().map(|triangle| inside_m(triangle.corners.map(position), at)).collect();
                let on_a_side = inside.iter().any(|m| m.abs() < 1e-6);
                let holding = inside.iter().filter(|m| **m > 0.0).count();
                assert!(holding == 1 || on_a_side, "{holding} triangles at {at}");
            }
        }
    }

    #[test]
    fn the_height_is_that_of_the_drawn_triangles() {
        let scene = scene::load(scene::DEFAULT).expect("built in");
        let world = World::new(&scene).expect("a world");
        let layout = *world.layout();
        // A node of LOD 0, a neighbour of LOD 1 to the east, and a neighbour of LOD 2 to the south.
        let nodes = [NodeId { lod: 0, x: 31, y: 32 }, NodeId { lod: 1, x: 16, y: 16 }, NodeId { lod: 2, x: 7, y: 7 }];
        let every_vertex = Levels::new(&nodes, 0, |_, _| 0);
        let coarse = Levels::new(&nodes, 0, |node, [column, row]| (unit(9, 40 + 8 * row + column + node as u32) * 5.0) as u8);
        let surface = |levels| Surface { world: &world, drawn: &nodes, levels };
        let corner = nodes[0].origin_m(&layout);
        let edge = layout.node_m(0);
        let mut differs = 0.0f64;
        for i in 0..300 {
            // With `every_vertex`, nothing is stitched in the middle of the node, so the height is that of the mesh with all vertices.
            let at = corner + DVec2::new(0.25 + 0.5 * unit(i, 1), 0.25 + 0.5 * unit(i, 2)) * edge;
            let found = surface(&every_vertex).height_m(at.x, at.y).expect("ground");
            assert!((found - world.surface_height_m(at.x, at.y)).abs() < 1e-9, "{found} at {at}");
            differs = differs.max((surface(&coarse).height_m(at.x, at.y).expect("ground") - found).abs());
            // The ground has no steps where nodes meet.
            let along = corner + DVec2::splat(unit(i, 3) * edge);
            for levels in [&every_vertex, &coarse] {
                let height = |x: f64, y: f64| surface(levels).height_m(x, y).expect("ground");
                let beside = 1e-7;
                let east = [-beside, beside].map(|dx| height(corner.x + edge + dx, along.y));
                let south = [-beside, beside].map(|dy| height(along.x, corner.y + dy));
                for [a, b] in [east, south] {
                    assert!((a - b).abs() < 1e-4, "{a} and {b} m at {along}");
                }
            }
        }
        assert!(differs > 0.01, "larger strides move the ground: {differs} m");
        assert_eq!(surface(&every_vertex).height_m(corner.x - 10.0, corner.y + edge + 10.0), None, "no node is drawn there");
        assert_eq!(surface(&every_vertex).height_m(f64::NAN, 0.0), None);
    }

    #[test]
    fn triangles_with_a_vertex_in_a_hole_are_not_drawn() {
        // The hole has a radius of 3 m. Its centre lies in the middle of a quad of LOD 5, whose vertices are 16 m apart.
        let mut scene = scene::load(scene::DEFAULT).expect("built in");
        let scene::World::Procedural { holes, .. } = &mut scene.world else { panic!("the built-in world is procedural") };
        holes.push(scene::Hole { centre: [1032.0, 1032.0], radius_m: 3.0 });
        let world = World::new(&scene).expect("a world");
        let height = |lod: u8, dx: f64| {
            let node = world.layout().node_at(lod, 1032.0, 1032.0).expect("in the world");
            let levels = Levels::new(&[node], 0, |_, _| 0);
            Surface { world: &world, drawn: &[node], levels: &levels }.height_m(1032.0 + dx, 1032.3)
        };
        // At LOD 0, vertices are 0.5 m apart, so dropped triangles reach up to 0.71 m beyond the edge of the hole.
        assert_eq!([0.0, 2.7, 4.2].map(|dx| height(0, dx).is_some()), [false, false, true]);
        // No vertex of LOD 5 is in the hole.
        assert_eq!([0.0, 2.7, 4.2].map(|dx| height(5, dx).is_some()), [true; 3]);
    }
}

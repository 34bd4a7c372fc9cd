//! Tests host code that determines what is drawn for a camera, without a device: the selection of nodes, the culling of patches, settings in the form
//! in which shaders read them, stored normals, and compressed blocks.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DVec2, DVec3};
use kernels::blocks::{self, BlockFormat, Effort};
use kernels::culling::{self, Conditions, Culled, Culls, DrawnNode, Levels, PATCHES};
use kernels::quadtree::{self, NodeBounds, PatchBounds};
use kernels::residency::CAPACITY;
use kernels::scene::{self, FlavourRules};
use kernels::shared::flavour_weights::FlavourParams;
use kernels::shared::normal_pair;
use kernels::shared::octahedral;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::{Pose, View};
use kernels::view::normals::NormalEncoding;
use kernels::world::cones::{self, Cone};
use kernels::world::{Layout, NodeId, PaletteMeans, World};

use crate::statistics::Random;

fn built_in_world() -> World {
    let scene = scene::parse(scene::DEFAULT_TEXT, "default", Path::new(".")).expect("the built-in scene is valid");
    World::new(&scene).expect("a procedural world needs no files")
}

fn view_of(position: [f64; 3], yaw: f64, pitch: f64, fov: f64, size: [u32; 2]) -> View {
    View::new(Pose { position: DVec3::from_array(position), yaw, pitch, fov }, size, [0.0; 2], 64.0, 10_240.0)
}

/// Whether a view sees a box that is given in world metres.
fn sees(view: &View, low: DVec3, high: DVec3) -> bool {
    // Local coordinates are relative to the corner of the camera's sector.
    let to_local = view.camera - view.pose.position;
    view.sees(low + to_local, high + to_local)
}

// ---------------------------------------------------------------- selection

/// Selects the nodes that [`quadtree::select`] should select, by recursion. A node is split if its distance is less than `ratio` times its edge. Adds
/// `node` and all visited nodes below it to `found[0]`, and the drawn nodes to `found[1]`.
fn descend(world: &World, view: &View, ratio: f64, node: NodeId, found: &mut [BTreeSet<NodeId>; 2]) {
    let layout = world.layout();
    let edge = layout.node_m(node.lod);
    let (low_m, high_m) = world.height_range_m();
    let low = node.origin_m(layout).extend(low_m);
    let high = (node.origin_m(layout) + edge).extend(high_m);
    found[0].insert(node);
    let eye = view.pose.position;
    let distance = (eye.clamp(low, high) - eye).length();
    if node.lod > 0 && distance < ratio * edge {
        node.children().into_iter().for_each(|child| descend(world, view, ratio, child, found));
    } else {
        found[1].insert(node);
    }
}

#[test]
fn nodes_are_split_while_their_quads_look_larger_than_the_limit() {
    let world = built_in_world();
    let (low_m, high_m) = world.height_range_m();
    let fov = 0.9_f64;
    for (height_px, lod_bias, position, yaw, pitch) in [
        (64, 0.0_f64, [100.0, -300.0, 900.0], 0.4, -0.3),
        (400, 0.0, [100.0, -300.0, 900.0], 2.0, -0.6),
        (400, 1.5, [-2000.0, 1500.0, 400.0], 2.0, 0.1),
        (400, -1.0, [-2000.0, 1500.0, 400.0], 4.0, -0.2),
        (2000, 0.0, [4900.0, 4900.0, 600.0], 3.9, -0.2),
    ] {
        let view = view_of(position, yaw, pitch, fov, [height_px * 3 / 2, height_px]);
        // A node has 128 quads per side, and is split until a quad is at most 2.5 pixels high. `of_picture` is the distance at which a quad is 2.5
        // pixels high, divided by the edge of the node. The ratio is clamped to 0.6..=2; then an LOD bias of 1 halves it.
        let of_picture = f64::from(height_px) / (2.0 * (fov / 2.0).tan()) / (128.0 * 2.5);
        let ratio = (of_picture.clamp(0.6, 2.0) / lod_bias.exp2()).min(2.0);
        let mut calls = Vec::new();
        let selection = quadtree::select(
            &world,
            &view,
            lod_bias,
            |_| true,
            |nodes| {
                calls.push(nodes.to_vec());
                Ok::<_, String>(vec![NodeBounds { height_m: [low_m, high_m] }; nodes.len()])
            },
        )
        .expect("loads");
        let mut expected = [BTreeSet::new(), BTreeSet::new()];
        NodeId::roots().for_each(|root| descend(&world, &view, ratio, root, &mut expected));
        let [visited, drawn] = expected;
        assert_eq!(selection.visited.iter().copied().collect::<BTreeSet<_>>(), visited, "{height_px} {lod_bias}");
        assert_eq!(selection.drawn.iter().copied().collect::<BTreeSet<_>>(), drawn, "{height_px} {lod_bias}");
        assert!(drawn.len() > 15 && drawn.iter().any(|node| node.lod < 3), "{} nodes", drawn.len());
        assert_eq!((selection.visited.len(), selection.drawn.len()), (visited.len(), drawn.len()), "each node once");
        // Each call loads one level, the coarsest first.
        assert_eq!(calls.concat(), selection.visited);
        for (call, lod) in calls.iter().zip((0..6).rev()) {
            assert!(!call.is_empty() && call.iter().all(|node| node.lod == lod), "{call:?}");
        }
    }
    let view = view_of([100.0, -300.0, 900.0], 0.4, -0.3, fov, [96, 64]);
    let error = quadtree::select(&world, &view, 0.0, |_| true, |_| Err("the disk is full")).map(|selection| selection.drawn);
    assert_eq!(error, Err("the disk is full"));
}

/// The number of visited nodes at the largest split ratio, for each of 4000 random camera positions. The positions lie in the middle of the world, in
/// a square as large as a node of LOD 5. All heights are 0.
fn numbers_of_nodes() -> Vec<usize> {
    let world = built_in_world();
    let mut random = Random(7);
    let mut number = |_| {
        let [x, y] = [0, 1].map(|_| random.between(-1024.0, 1024.0));
        let view = view_of([x, y, 0.0], 0.0, 0.0, 0.3, [300, 2000]);
        let flat = |nodes: &[NodeId]| Ok::<_, String>(vec![NodeBounds { height_m: [0.0; 2] }; nodes.len()]);
        quadtree::select(&world, &view, 0.0, |_| true, flat).expect("loads").visited.len()
    };
    (0..4000).map(&mut number).collect()
}

#[test]
fn every_camera_finds_room_in_the_atlases() {
    // The expected mean and maximum were computed independently of the tested code, for the rings of nodes in the talk (FC5). These rings have a
    // split ratio of 2, which is also the largest ratio here.
    let numbers = numbers_of_nodes();
    let mean = numbers.iter().sum::<usize>() as f64 / numbers.len() as f64;
    let most = numbers.into_iter().max().expect("some cameras");
    assert!((mean - 456.0).abs() < 1.0 && most <= 477, "{mean} nodes on average, at most {most}");
    assert!(most <= CAPACITY as usize);
}

#[test]
fn turning_the_camera_selects_the_same_nodes() {
    let world = built_in_world();
    let mut random = Random(3);
    for _ in 0..50 {
        let position = [random.between(-5000.0, 5000.0), random.between(-5000.0, 5000.0), random.between(0.0, 1500.0)];
        let mut select = || {
            let view = view_of(position, random.between(0.0, 6.0), random.between(-1.5, 1.5), 1.0, [320, 180]);
            let flat = |nodes: &[NodeId]| Ok::<_, String>(vec![NodeBounds { height_m: [0.0, 800.0] }; nodes.len()]);
            let selection = quadtree::select(&world, &view, 0.0, |_| true, flat).expect("loads");
            (selection.visited, selection.drawn)
        };
        assert_eq!(select(), select());
    }
}

#[test]
fn the_box_of_a_node_holds_it() {
    let layout = Layout::of(10_240.0, None);
    let view = view_of([100.0, -300.0, 900.0], 0.4, -0.3, 0.9, [96, 64]);
    let node = NodeId { lod: 2, x: 21, y: 17 };
    let (low, high) = quadtree::local_box(node, NodeBounds { height_m: [5.0, 9.0] }, &layout, &view);
    // Nodes of LOD 2 are 256 m wide, counted from the corner of the world at -5120 m. The camera's sector begins at (64, -320).
    let corner = DVec2::new(21.0 * 256.0 - 5120.0 - 64.0, 17.0 * 256.0 - 5120.0 + 320.0);
    assert_eq!((low, high), (corner.extend(5.0), (corner + 256.0).extend(9.0)));
}

// ---------------------------------------------------------------- culling

#[test]
fn exactly_the_patches_in_view_are_drawn() {
    let layout = Layout::of(10_240.0, None);
    let mut random = Random(101);
    let (mut drawn, mut dropped) = (0, 0);
    for _ in 0..200 {
        let node = NodeId { lod: random.below(4) as u8, x: 9, y: 10 };
        let edge = layout.node_m(node.lod);
        let corner = node.origin_m(&layout);
        let eye = corner + DVec2::new(random.between(-0.5, 1.5), random.between(-0.5, 1.5)) * edge;
        let view = view_of([eye.x, eye.y, 120.0], random.between(0.0, 6.3), random.between(-1.2, 0.2), 0.7, [96, 64]);
        let bounds = NodeBounds { height_m: [10.0, 60.0] };
        let patches: Vec<PatchBounds> = (0..64)
            .map(|_| {
                let low = random.between(10.0, 50.0);
                PatchBounds { height_m: [low, random.between(low, 60.0)], ..flat() }
            })
            .collect();
        for patch_heights in [false, true] {
            let culls = Culls { patch_heights, back_faces: false, nearest_first: true, occlusion: true };
            let culled = cull(&layout, &[node], bounds, &patches, &view, 1, culls);
            let found: BTreeSet<[u32; 2]> = culled.patches.iter().map(|patch| patch.patch).collect();
            assert_eq!((found.len() + culled.counts.outside, culled.counts.facing_away), (64, 0));
            let node_is_seen = sees(&view, corner.extend(10.0), (corner + edge).extend(60.0));
            let mut distances = BTreeMap::new();
            for column in 0..PATCHES {
                for row in 0..PATCHES {
                    let low = corner + DVec2::new(f64::from(column), f64::from(row)) * (edge / 8.0);
                    let heights = if patch_heights { patches[(row * 8 + column) as usize].height_m } else { [10.0, 60.0] };
                    let [low, high] = [low.extend(heights[0]), (low + edge / 8.0).extend(heights[1])];
                    let is_seen = node_is_seen && sees(&view, low, high);
                    assert_eq!(found.contains(&[column, row]), is_seen, "{node:?}, patch {column} {row}");
                    distances.insert([column, row], view.pose.position.distance(view.pose.position.clamp(low, high)));
                    if patch_heights {
                        drawn += usize::from(is_seen);
                        dropped += usize::from(!is_seen);
                    }
                }
            }
            // The nearest patches are drawn first.
            assert!(culled.patches.iter().map(|patch| distances[&patch.patch]).is_sorted_by(|a, b| *a <= b + 1e-9));
        }
    }
    assert!(drawn > 200 && dropped > 300, "{drawn} {dropped}");
}

/// The bounds of a horizontal patch.
fn flat() -> PatchBounds {
    PatchBounds { height_m: [10.0, 60.0], errors_m: [50.0; 4], cone: Cone { axis: [0.0, 0.0, 1.0], sin_half_angle: 0.0 } }
}

/// Culls the patches of the first node. All nodes count as drawn, so the others may determine the levels of that node's sides.
fn cull(layout: &Layout, nodes: &[NodeId], bounds: NodeBounds, patches: &[PatchBounds], view: &View, stride: u32, culls: Culls) -> Culled {
    let drawn = DrawnNode { node: nodes[0], slot: 7, bounds, patches };
    let levels = Levels::new(nodes, stride.ilog2() as u8, |_, _| 0);
    let conditions = Conditions { layout, levels: &levels, rounding_m: 0.0, culls };
    culling::cull(&[drawn], [view, view], conditions)
}

#[test]
fn patches_that_face_away_are_dropped_unless_other_triangles_are_drawn() {
    let layout = Layout::of(10_240.0, None);
    let node = NodeId { lod: 1, x: 20, y: 19 };
    let corner = node.origin_m(&layout);
    // The camera is south of the node and looks north. The ground rises by about 45 degrees to the north, then falls steeply.
    let view = view_of([corner.x + 64.0, corner.y - 40.0, 30.0], 0.0, 0.0, 1.2, [96, 64]);
    let cone = |slope: f64, sin_half_angle: f64| Cone { axis: [0.0, slope.sin(), slope.cos()], sin_half_angle };
    let [to_camera, away] = [cone(-0.8, 0.1), cone(1.3, 0.1)];
    let patches: Vec<PatchBounds> =
        (0..64).map(|i| PatchBounds { height_m: [20.0, 40.0], cone: if i < 32 { to_camera } else { away }, ..flat() }).collect();
    let bounds = NodeBounds { height_m: [20.0, 40.0] };
    let count = |nodes: &[NodeId], patches: &[PatchBounds], stride, back_faces| {
        let culled = cull(&layout, nodes, bounds, patches, &view, stride, Culls { back_faces, ..Culls::ALL });
        (culled.counts.facing_away, culled.patches.iter().filter(|patch| patch.patch[1] >= 4).count())
    };
    let (facing_away, left) = count(&[node], &patches, 1, true);
    assert!(facing_away > 20 && left == 0, "{facing_away} {left}");
    assert_eq!(count(&[node], &patches, 1, false), (0, facing_away));
    // With a vertex stride of 2, the drawn triangles are not those from which the cones were computed, so no patch is dropped.
    assert_eq!(count(&[node], &patches, 2, true), (0, facing_away));
    // Four rows of patches face away. The northernmost of these rows is stitched to a coarser neighbour, so its drawn triangles are not those from
    // which its cones were computed. So it must not be dropped.
    let neighbour = NodeId { lod: 3, x: 5, y: 5 };
    assert_eq!(neighbour.origin_m(&layout).y, corner.y + layout.node_m(1), "the neighbour begins where the node ends");
    let (stitched, left) = count(&[node, neighbour], &patches, 1, true);
    assert!(left > 4 && stitched + left == facing_away, "{stitched} {left}");
    // A cone of all directions is never culled.
    let any: Vec<_> = patches.iter().map(|patch| PatchBounds { cone: Cone { sin_half_angle: 1.0, ..patch.cone }, ..*patch }).collect();
    assert_eq!(count(&[node], &any, 1, true), (0, facing_away));
}

#[test]
fn the_bounds_of_a_patch_hold_its_vertices() {
    let mut scene = scene::parse(scene::DEFAULT_TEXT, "default", Path::new(".")).expect("the built-in scene is valid");
    let centre = NodeId { lod: 0, x: 80, y: 80 }.origin_m(World::new(&scene).expect("a world").layout()) + 20.0;
    if let scene::World::Procedural { holes, .. } = &mut scene.world {
        holes.push(scene::Hole { centre: centre.to_array(), radius_m: 10.0 });
    }
    let world = World::new(&scene).expect("a procedural world needs no files");
    let means = PaletteMeans {
        albedo: vec![[0.5; 3]; scene.materials.len()],
        smoothness: vec![0.5; scene.materials.len()],
        specular_occlusion: vec![1.0; scene.materials.len()],
    };
    let (mut whole, mut open) = (0, 0);
    let nodes = [NodeId { lod: 0, x: 80, y: 80 }, NodeId { lod: 3, x: 9, y: 11 }];
    for baked in world.bake_many(&nodes, &means, false, || ()) {
        let payload = baked.payload;
        let bounds = PatchBounds::of(&world, &payload);
        assert_eq!(bounds.len(), 64);
        for (index, patch) in bounds.iter().enumerate() {
            let (column, row) = (index % 8, index / 8);
            let heights: Vec<f64> =
                (0..17 * 17).map(|i| world.elevation_m(payload.height[(16 * row + i / 17) * 129 + 16 * column + i % 17])).collect();
            let ends = [f64::min as fn(f64, f64) -> f64, f64::max].map(|of| heights.iter().copied().reduce(of).expect("vertices"));
            assert_eq!(patch.height_m, ends, "{:?}, patch {index}", payload.id);
            // With fewer vertices, a hole would have a different outline, so a patch with a hole must be drawn with all of its vertices.
            let spacing = world.layout().spacing_m(payload.id.lod);
            let place = |i: usize| {
                payload.id.origin_m(world.layout()) + DVec2::new((16 * column + i % 17) as f64, (16 * row + i / 17) as f64) * spacing
            };
            let has_hole = (0..17 * 17).any(|i| world.is_hole(place(i).x, place(i).y));
            assert_eq!(patch.errors_m.map(f64::is_infinite), [has_hole; 4], "{:?}, patch {index}", payload.id);
            (whole, open) = (whole + usize::from(!has_hole), open + usize::from(has_hole));
        }
        // The patches differ, so the order of the cones and of the heights matters.
        assert!(bounds.iter().any(|patch| patch.height_m != bounds[0].height_m));
        assert_eq!(bounds.iter().map(|patch| patch.cone).collect::<Vec<_>>(), cones::decode(&payload.cones));
    }
    assert!(whole > 100 && open > 1, "{whole} {open}");
}

#[test]
fn a_patch_whose_stitches_reach_out_is_drawn_with_its_node() {
    let layout = Layout::of(10_240.0, None);
    // The neighbour in the east is five levels coarser: its vertices are 32 quads apart, and a patch is only 16 quads wide.
    let (node, neighbour) = (NodeId { lod: 0, x: 31, y: 40 }, NodeId { lod: 5, x: 1, y: 1 });
    let corner = node.origin_m(&layout);
    // The camera looks west from the middle of the node, away from its eastern border.
    let view = view_of([corner.x + 32.0, corner.y + 32.0, 30.0], -std::f64::consts::FRAC_PI_2, 0.0, 0.7, [96, 64]);
    let of = |nodes: &[NodeId], log2_stride| {
        let drawn = DrawnNode { node, slot: 7, bounds: NodeBounds { height_m: [10.0, 60.0] }, patches: &[flat(); 64] };
        let levels = Levels::new(nodes, log2_stride, |_, _| 0);
        let conditions = Conditions { layout: &layout, levels: &levels, rounding_m: 0.0, culls: Culls::ALL };
        let mut patches = culling::cull(&[drawn], [&view, &view], conditions).patches;
        patches.sort_by_key(|patch| patch.patch[1]);
        patches.iter().filter(|patch| patch.patch[0] == 7).map(|patch| (patch.patch[1], patch.deltas)).collect::<Vec<_>>()
    };
    assert_eq!(of(&[node, neighbour], 0), (0..8).map(|row| (row, 5 << 8)).collect::<Vec<_>>());
    // If only every second vertex is drawn, the vertices of the neighbour are twice as far apart, so the delta is one larger.
    assert_eq!(of(&[node, neighbour], 1), (0..8).map(|row| (row, 6 << 8)).collect::<Vec<_>>());
    assert!(of(&[node], 0).is_empty(), "without a coarser neighbour, patches behind the camera are dropped");
    // If the vertices of the neighbour are at most one patch width apart, stitching moves no vertex out of its patch.
    let near = NodeId { lod: 4, x: 2, y: 2 };
    assert!(of(&[node, near], 0).is_empty());
    // A side with nothing beyond it is not welded.
    let alone = Levels::new(&[node], 0, |_, _| 2);
    assert!((0..64).all(|i| alone.deltas(node, [i % 8, i / 8]) == 0));
}

// ---------------------------------------------------------------- settings as shaders read them

#[test]
fn flavour_rules_become_cosines_around_their_slopes() {
    let rules = FlavourRules { cliff_slope_deg: 50.0, slope_blend_deg: 6.0, splat_band_deg: 10.0, ..FlavourRules::default() };
    let params = FlavourParams::new(&rules);
    let cosines = |degrees: [f64; 2]| degrees.map(|degrees| degrees.to_radians().cos() as f32);
    assert_eq!((params.cliff_cos, params.splat_cos), (cosines([53.0, 47.0]), cosines([43.0, 37.0])));
    assert_eq!((params.splat_enabled, params.vt_enabled), (1, 1));
    let none = FlavourParams::new(&FlavourRules { cliff_slope_deg: 90.0, far_atlas_m: 0.0, ..rules.clone() });
    assert_eq!((none.cliff_cos, none.splat_enabled, none.vt_enabled), ([-2.0, -1.0], 0, 0));
    assert_eq!(FlavourParams::new(&FlavourRules { splat_band_deg: 0.0, ..rules }).splat_enabled, 0);
}

#[test]
fn stored_normals_have_their_size_name_and_meaning() {
    for (code, encoding) in (0..).zip(NormalEncoding::ALL) {
        assert_eq!(
            (encoding.code(), encoding.name().parse().ok(), encoding.to_string()),
            (code, Some(encoding), encoding.name().to_owned())
        );
    }
    assert!("other".parse::<NormalEncoding>().is_err());
    assert_eq!(NormalEncoding::ALL.map(NormalEncoding::bytes), [4, 4, 16]);
    // Octahedral: two codes of two bytes each. The byte 127 stands for the coordinate 0, and the byte 0 for -1.
    let [up, south] = NormalEncoding::Octahedral.decode(&[127, 127, 127, 0]);
    assert_eq!((up, south), ([0.0, 0.0, 1.0], [0.0, -1.0, 0.0]));
    let (plane, shading) = ([0.3, -0.5, 0.8], [140, 90]);
    let word = normal_pair::encode(plane, [0.0, 0.0, -1.0], shading);
    let [found_shading, found_plane] = NormalEncoding::PlaneFirst.decode(&word.to_le_bytes());
    assert_eq!(found_shading, octahedral::decode(octahedral::dequantise::<f64>(shading, 8)));
    assert_eq!(found_plane, normal_pair::decode::<f64>(word).plane);
    let exact: Vec<u8> = [0.5_f32, 0.0, 0.0, -1.0].iter().flat_map(|x| x.to_le_bytes()).collect();
    let [slanted, south] = NormalEncoding::Exact.decode(&exact);
    assert_eq!((slanted, south), (octahedral::decode([0.5, 0.0]), [0.0, -1.0, 0.0]));
}

#[test]
fn the_colour_of_a_variant_is_the_mean_of_its_flavours() {
    assert_eq!(Variant::all().count(), Variant::COUNT);
    for variant in Variant::all() {
        let flavours: Vec<Flavour> = Flavour::ALL.into_iter().filter(|flavour| variant.mask() & flavour.bit() != 0).collect();
        assert_eq!(variant.flavours().collect::<Vec<_>>(), flavours);
        let mean = |k: usize| flavours.iter().map(|flavour| usize::from(flavour.colour()[k])).sum::<usize>() / flavours.len();
        assert_eq!(variant.colour().map(usize::from), [mean(0), mean(1), mean(2)], "{variant}");
        assert!(Flavour::ALL.iter().all(|&flavour| variant.has(flavour) == flavours.contains(&flavour)));
    }
    for (i, flavour) in Flavour::ALL.into_iter().enumerate() {
        assert_eq!((flavour.index(), flavour.bit(), Variant::only(flavour).mask()), (i, 1 << i, 1 << i));
        assert!(Flavour::ALL.iter().all(|other| (other.colour() == flavour.colour()) == (*other == flavour)));
    }
}

// ---------------------------------------------------------------- blocks

const WEIGHTS: [f32; 3] = [1.0, 2.0, 0.5];

/// The four colours of a BC1 block in the four-colour mode, as exact fractions; `None` if the block is in the three-colour mode.
fn palette(block: &[u8]) -> Option<[[f64; 3]; 4]> {
    let [a, b] = [0, 2].map(|at| u16::from_le_bytes([block[at], block[at + 1]]));
    let ends = [a, b].map(expanded);
    let between = |share: f64| std::array::from_fn(|c| share * ends[0][c] + (1.0 - share) * ends[1][c]);
    (a > b).then(|| [between(1.0), between(0.0), between(2.0 / 3.0), between(1.0 / 3.0)])
}

/// A 5:6:5 colour in 0..255. The high bits are repeated in the low bits, so that 0 and 255 are exact.
fn expanded(code: u16) -> [f64; 3] {
    [(code >> 11, 5_u32), (code >> 5 & 63, 6), (code & 31, 5)].map(|(level, bits)| {
        let high = u32::from(level) << (8 - bits);
        f64::from(high + high / (1 << bits))
    })
}

fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|c| f64::from(WEIGHTS[c]) * (a[c] - b[c]).powi(2)).sum()
}

/// The indices of a block, 0..=3.
fn indices(block: &[u8]) -> [usize; 16] {
    std::array::from_fn(|i| usize::from(block[4 + i / 4] >> (2 * (i % 4)) & 3))
}

/// The sum over the texels of the distance to the nearest colour of a palette.
fn least_error(colours: [[f64; 3]; 4], texels: &[[f64; 3]; 16]) -> f64 {
    texels.iter().map(|&texel| colours.iter().map(|&colour| distance(colour, texel)).fold(f64::MAX, f64::min)).sum()
}

/// Solves for the end points that give the least squared error with the indices of `block`, and rounds them to 5:6:5. Returns the error of a block
/// with these end points. Returns `None` if the indices do not determine both end points, or if the rounded end points are equal.
fn solved_error(block: &[u8], texels: &[[f64; 3]; 16]) -> Option<f64> {
    let shares = indices(block).map(|index| [1.0, 0.0, 2.0 / 3.0, 1.0 / 3.0][index]);
    let of = |f: &dyn Fn(f64, usize) -> f64| shares.iter().enumerate().map(|(i, &share)| f(share, i)).sum::<f64>();
    let (aa, ab, bb) = (of(&|a, _| a * a), of(&|a, _| a * (1.0 - a)), of(&|a, _| (1.0 - a) * (1.0 - a)));
    let determinant = aa * bb - ab * ab;
    if determinant < 0.01 {
        return None;
    }
    let steps = [31.0, 63.0, 31.0];
    let mut ends = [[0.0; 3]; 2];
    for c in 0..3 {
        let (ax, bx) = (of(&|a, i| a * texels[i][c]), of(&|a, i| (1.0 - a) * texels[i][c]));
        let solution = [(ax * bb - bx * ab) / determinant, (bx * aa - ax * ab) / determinant];
        for (end, value) in ends.iter_mut().zip(solution) {
            end[c] = (value / 255.0 * steps[c]).round().clamp(0.0, steps[c]);
        }
    }
    let codes = ends.map(|end| (end[0] as u16) << 11 | (end[1] as u16) << 5 | end[2] as u16);
    let [high, low] = [codes[0].max(codes[1]), codes[0].min(codes[1])].map(u16::to_le_bytes);
    Some(least_error(palette(&[high, low].concat())?, texels))
}

#[test]
fn refined_blocks_are_nearer_to_their_texels() {
    let mut random = Random(103);
    let (mut improved, mut solved, mut four) = (0, 0, 0);
    for _ in 0..300 {
        // Texels scattered around a line between two colours.
        let [from, to] = [0; 2].map(|_: i32| [0.0; 3].map(|_: f64| random.between(10.0, 245.0)));
        let texels: [[u8; 4]; 16] = std::array::from_fn(|_| {
            let share = random.unit();
            let texel: [u8; 3] = std::array::from_fn(|c| (from[c] + share * (to[c] - from[c]) + random.between(-10.0, 10.0)).round() as u8);
            [texel[0], texel[1], texel[2], 255]
        });
        let colours = texels.map(|[r, g, b, _]| [r, g, b].map(f64::from));
        let [fast, refined] =
            [Effort::Fast, Effort::Refined].map(|effort| blocks::encode(BlockFormat::Bc1, &texels.concat(), 4, 4, WEIGHTS, effort));
        let Some(before) = palette(&fast) else {
            assert_eq!(fast, refined, "a block in the three-colour mode is kept");
            continue;
        };
        four += 1;
        let after = palette(&refined).expect("the four-colour mode is kept");
        let error = |block: &[u8], palette: [[f64; 3]; 4]| -> f64 {
            indices(block).iter().zip(&colours).map(|(&index, &texel)| distance(palette[index], texel)).sum()
        };
        let (old, new) = (error(&fast, before), error(&refined, after));
        assert!(new <= old * (1.0 + 1e-4), "{old} became {new}");
        if fast != refined {
            improved += 1;
            assert!(new <= least_error(after, &colours) * (1.0 + 1e-4), "each texel has its nearest colour");
            // The encoder solves for the end points at most twice, and accepts a solution only if it reduces the error. So the error after the first
            // solution is an upper bound.
            if let Some(bound) = solved_error(&fast, &colours) {
                solved += usize::from(new <= bound * (1.0 + 1e-4));
            }
        } else {
            solved += usize::from(solved_error(&fast, &colours).is_none_or(|bound| bound >= old * (1.0 - 1e-4)));
        }
    }
    // A solution that is nearly halfway between two codes may be rounded differently in f32 and f64. So a fiftieth of the blocks may be exceptions.
    assert!(
        four > 100 && improved * 4 > four && solved + four / 50 >= four,
        "{four} blocks, {improved} improved, {solved} as good as solved"
    );
}

#[test]
fn blocks_at_the_border_of_a_picture_are_not_refined() {
    let mut random = Random(107);
    for _ in 0..50 {
        let texels: Vec<u8> =
            (0..6 * 5).flat_map(|_| [random.below(256) as u8, random.below(256) as u8, random.below(256) as u8, 255]).collect();
        let [fast, refined] =
            [Effort::Fast, Effort::Refined].map(|effort| blocks::encode(BlockFormat::Bc1, &texels, 6, 5, WEIGHTS, effort));
        // Only the first of the four blocks has all its 16 texels inside the picture. Only this block may be refined.
        assert_eq!((fast.len(), &fast[8..]), (32, &refined[8..]));
    }
    assert_eq!([BlockFormat::Bc1, BlockFormat::Bc3].map(|format| format.image_bytes(6, 5)), [32, 64]);
    assert_eq!([BlockFormat::Bc1, BlockFormat::Bc3].map(|format| format.image_bytes(8, 4)), [16, 32]);
}

/// The 8 values of an alpha block of BC3 (Direct3D 11.3 functional specification, section 19.5), rounded down.
fn alpha_values(first: u8, second: u8) -> [u8; 8] {
    let parts = if first > second { 7 } else { 5 };
    std::array::from_fn(|k| match k {
        0 => first,
        1 => second,
        6 if parts == 5 => 0,
        7 if parts == 5 => 255,
        _ => ((f64::from(first) * (parts + 1 - k) as f64 + f64::from(second) * (k - 1) as f64) / parts as f64 + 1e-9).floor() as u8,
    })
}

#[test]
fn alpha_blocks_exceed_by_as_little_as_one_of_the_two_modes_can() {
    let mut random = Random(109);
    for round in 0..3000 {
        let (middle, width) = (random.below(256), [2, 10, 60, 255][round % 4]);
        let needed: [u8; 16] = std::array::from_fn(|_| match random.below(12) {
            0 if round % 3 == 0 => 255,
            1 if round % 3 == 0 => 0,
            _ => (middle + random.below(width)).saturating_sub(width / 2).min(255) as u8,
        });
        let excess = |values: [u8; 8]| -> Option<u32> {
            let least = |&value: &u8| values.iter().filter(|&&v| v >= value).min().map(|&v| u32::from(v - value));
            needed.iter().map(least).sum()
        };
        let block = blocks::alpha_block_at_least(needed);
        let values = alpha_values(block[0], block[1]);
        let bits = block[2..].iter().rev().fold(0_u64, |all, &byte| all << 8 | u64::from(byte));
        let chosen = |i: usize| values[(bits >> (3 * i) & 7) as usize];
        assert!((0..16).all(|i| chosen(i) >= needed[i]), "{needed:?}: {block:?}");
        let found: u32 = (0..16).map(|i| u32::from(chosen(i) - needed[i])).sum();
        // An alpha block has one of two modes. In the first, it has eight values from the lowest to the highest needed value. In the second, it has
        // six values from the lowest needed value to the highest one below 255, and in addition 0 and 255. The encoder must use the better mode.
        let (low, high) = (needed.into_iter().min().expect("16"), needed.into_iter().max().expect("16"));
        let below = needed.into_iter().filter(|&v| v < 255).max().unwrap_or(254);
        let best = [alpha_values(high, low), alpha_values(low.min(below), below)].into_iter().filter_map(excess).min();
        assert_eq!(Some(found), best, "{needed:?}: {block:?}");
    }
}

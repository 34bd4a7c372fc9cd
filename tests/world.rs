//! Tests of the `world` stage, which computes the terrain data (payloads) of quadtree nodes. They cover the layout, payload formats, shared edges of
//! nodes, slopes, holes, the edge of a heightmap, normal cones, normals, the drawn surface, the shape of the generated ground, the rules that assign
//! materials, and the colour modulation.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use kernels::blocks;
use kernels::blocks::{BlockFormat, Effort};
use kernels::geometry::reference;
use kernels::scene::{self, Scene};
use kernels::world::payload::{HEIGHT_SIDE, SPLAT_SIDE, TEXTURE_SIDE, diagonal_rises};
use kernels::world::{LODS, Layout, NodeId, NodePayload, PaletteMeans, SECTORS, World, cones, on_threads};

use crate::fixtures::{Folder, island};

const MATERIALS: &str = r#"
[[material]]
name = "grass"
procedural = "grass"
tile_m = 3.0
[[material]]
name = "scree"
procedural = "scree"
tile_m = 3.0
[[material]]
name = "granite"
procedural = "granite"
tile_m = 4.0
[[rule]]
material = "grass"
[[rule]]
material = "scree"
weight = 2.0
slope_deg = [28.0, 41.0]
slope_fade_deg = 4.0
noise_m = 17.0
noise_cover = 0.7
[[rule]]
material = "granite"
weight = 3.0
slope_deg = [42.0, 90.0]
slope_fade_deg = 4.0
"#;

fn scene_with(world: &str) -> Scene {
    let text = format!("name = \"test\"\n[world]\nkind = \"procedural\"\n{world}\n{MATERIALS}");
    scene::parse(&text, "test scene", Path::new(".")).expect("the test scene is valid")
}

fn alps() -> World {
    World::new(&scene_with("seed = 7")).expect("a procedural world needs no files")
}

fn palette() -> PaletteMeans {
    PaletteMeans {
        albedo: vec![[0.08, 0.13, 0.04], [0.27, 0.25, 0.22], [0.19, 0.18, 0.18]],
        smoothness: vec![0.1, 0.25, 0.45],
        specular_occlusion: vec![0.8, 0.9, 1.0],
    }
}

fn bake(world: &World, lod: u8, x: u16, y: u16) -> NodePayload {
    world.bake(NodeId { lod, x, y }, &palette())
}

/// Returns the node of a LOD that contains the steepest of 1600 points. In the world of seed 7, this point is on a cliff.
fn steep_node(world: &World, lod: u8) -> NodeId {
    let half = 5120.0;
    let steepest = (0..40 * 40)
        .map(|k| (f64::from(k % 40) * 250.0 - half + 100.0, f64::from(k / 40) * 250.0 - half + 100.0))
        .max_by(|a, b| world.relief_at(a.0, a.1)[0].total_cmp(&world.relief_at(b.0, b.1)[0]))
        .expect("1600 places");
    world.layout().node_at(lod, steepest.0, steepest.1).expect("inside the world")
}

#[test]
fn quadtree_has_34125_nodes_and_parents_hold_children() {
    let world = alps();
    let mut count = 0;
    for lod in 0..LODS {
        let side = NodeId::per_side(lod);
        for i in 0..side * side {
            let node = NodeId { lod, x: i % side, y: i / side };
            assert!(world.exists(node), "{node:?}");
            count += 1;
            if let Some(parent) = node.parent() {
                assert!(parent.children().contains(&node));
                let (inner, outer) = (node.origin_m(world.layout()), parent.origin_m(world.layout()));
                assert!((inner - outer).min_element() >= 0.0 && (inner - outer).max_element() < world.layout().node_m(parent.lod));
            }
        }
    }
    assert_eq!(count, 34_125);
    assert_eq!(NodeId::roots().count(), 25);
    assert!(!world.exists(NodeId { lod: 0, x: SECTORS, y: 0 }) && !world.exists(NodeId { lod: LODS, x: 0, y: 0 }));
    assert_eq!(NodeId { lod: 0, x: 0, y: 0 }.origin_m(world.layout()).to_array(), [-5120.0, -5120.0]);
}

#[test]
fn sectors_scale_by_powers_of_two_and_lods_are_as_deep_as_the_data() {
    let layout = |extent, spacing| Layout::of(extent, spacing);
    assert_eq!(layout(10_240.0, None), Layout { sector_m: 64.0, finest_lod: 0 });
    assert_eq!(layout(10_240.1, None).sector_m, 128.0);
    assert_eq!(layout(25_036.8, Some(24.45)), Layout { sector_m: 256.0, finest_lod: 3 });
    // The spacing of the finest LOD must be at least half the spacing of the data, which is 10 m here. LOD 3, with 4 m, would be too fine, so LOD 4,
    // with 8 m, is the finest.
    assert_eq!(layout(3200.0, Some(10.0)), Layout { sector_m: 64.0, finest_lod: 4 });
    assert_eq!(layout(3200.0, Some(0.5)).finest_lod, 0);
    assert_eq!(layout(9000.0, Some(90.0)).finest_lod, LODS - 1);
}

#[test]
fn payload_textures_have_the_promised_sizes() {
    let world = alps();
    for lod in [0, 3, 5] {
        let payload = bake(&world, lod, 2, 1);
        assert_eq!(payload.height.len() * 2, 129 * 129 * 2);
        assert_eq!(payload.normal.len(), 33 * 33 * 16);
        assert_eq!(payload.albedo.len(), 33 * 33 * 8);
        assert_eq!(payload.colour_modulation.len(), 33 * 33 * 8);
        assert_eq!(payload.splat.len(), 65 * 65);
        assert_eq!(payload.cones.len(), 2 * 2 * 16);
        assert_eq!(payload.bytes(), 72_419);
        assert_eq!(Some(&payload.min_height), payload.height.iter().min());
        assert_eq!(Some(&payload.max_height), payload.height.iter().max());
        assert!(payload.splat.iter().all(|&m| m < 3));
    }
}

#[test]
fn neighbours_share_the_bits_of_their_edges() {
    let world = alps();
    let last = HEIGHT_SIDE - 1;
    let at = |p: &NodePayload, i: usize, j: usize| p.height[j * HEIGHT_SIDE + i];
    for lod in [0, 2, 4] {
        let NodeId { x, y, .. } = steep_node(&world, lod);
        let node = bake(&world, lod, x, y);
        let east = bake(&world, lod, x + 1, y);
        let north = bake(&world, lod, x, y + 1);
        let mut control = 0;
        for k in 0..HEIGHT_SIDE {
            assert_eq!(at(&node, last, k), at(&east, 0, k), "LOD {lod}, row {k}");
            assert_eq!(at(&node, k, last), at(&north, k, 0), "LOD {lod}, column {k}");
            control += usize::from(at(&node, last - 1, k) != at(&east, 0, k));
        }
        assert!(control > 60, "negative control: the column before the edge has different heights");
    }
}

#[test]
fn parents_share_their_edges_and_splat_texels_with_their_children() {
    let world = alps();
    for (lod, x, y) in [(1, 30, 41), (3, 9, 12), (5, 2, 3)] {
        let parent = bake(&world, lod, x, y);
        let mut inner = 0;
        for (q, child) in parent.id.children().into_iter().enumerate() {
            let child = world.bake(child, &palette());
            let half = |side: usize, i: usize, q: usize| i + q * (side - 1) / 2;
            for j in 0..=64 {
                for i in 0..=64 {
                    let (column, row) = (half(HEIGHT_SIDE, i, q % 2), half(HEIGHT_SIDE, j, q / 2));
                    let (of_child, of_parent) = (child.height[2 * j * HEIGHT_SIDE + 2 * i], parent.height[row * HEIGHT_SIDE + column]);
                    if column.is_multiple_of(128) || row.is_multiple_of(128) {
                        assert_eq!(of_child, of_parent, "child {q}, {i}, {j}");
                    } else {
                        inner += usize::from(of_child != of_parent);
                    }
                }
            }
            for j in 0..=32 {
                for i in 0..=32 {
                    let at = half(SPLAT_SIDE, j, q / 2) * SPLAT_SIDE + half(SPLAT_SIDE, i, q % 2);
                    assert_eq!(child.splat[2 * j * SPLAT_SIDE + 2 * i], parent.splat[at], "materials of child {q}, {i}, {j}");
                }
            }
        }
        assert!(inner > 1000, "negative control: inside a node of LOD {lod}, only {inner} heights differ from those of the children");
    }
}

#[test]
fn coarse_nodes_are_smoother_than_samples_of_their_ground() {
    let world = alps();
    for lod in 0..LODS {
        let payload = world.bake(steep_node(&world, lod), &palette());
        let (origin, spacing) = (payload.id.origin_m(world.layout()), world.layout().spacing_m(lod));
        let bend = |row: &[f64]| row.windows(3).map(|h| (h[0] - 2.0 * h[1] + h[2]).abs()).sum::<f64>();
        let (mut drawn, mut sampled) = (0.0, 0.0);
        for j in 3..HEIGHT_SIDE - 3 {
            let row = 3..HEIGHT_SIDE - 3;
            let heights: Vec<f64> = row.clone().map(|i| world.elevation_m(payload.height[j * HEIGHT_SIDE + i])).collect();
            // `vertex_elevation_m` must return the height that the payload of the node contains.
            for (i, height) in row.clone().zip(&heights).step_by(17) {
                assert_eq!(world.vertex_elevation_m(payload.id, [i, j].map(|n| u32::try_from(n).expect("small"))), *height);
            }
            drawn += bend(&heights);
            let sample = |i: usize| world.height_m(origin.x + i as f64 * spacing, origin.y + j as f64 * spacing);
            sampled += bend(&row.map(sample).collect::<Vec<_>>());
        }
        if lod == 0 {
            assert!(
                (drawn / sampled - 1.0).abs() < 0.02,
                "LOD 0 must be as rough as the ground: second differences add up to {drawn} m in drawn heights, to {sampled} m in sampled ones"
            );
        } else {
            assert!(
                drawn < 0.7 * sampled,
                "LOD {lod}: second differences add up to {drawn} m in drawn heights, to {sampled} m in sampled ones"
            );
        }
    }
}

#[test]
fn coarse_nodes_lay_what_lies_at_each_place() {
    // The rules of [`MATERIALS`] depend on slope and noise; the added rule depends on curvature.
    let text = format!(
        "name = \"test\"\n[world]\nkind = \"procedural\"\nseed = 8\n{MATERIALS}[[rule]]\nmaterial = \"grass\"\nweight = 9.0\ncurvature = [0.02, 9.0]\n"
    );
    let bent = scene::parse(&text, "test scene", Path::new(".")).expect("valid");
    for world in [alps(), World::new(&bent).expect("valid")] {
        for (lod, x, y) in [(2, 5, 6), (3, 1, 2)] {
            let payload = bake(&world, lod, x, y);
            let origin = payload.id.origin_m(world.layout());
            let step = world.layout().node_m(lod) / (SPLAT_SIDE - 1) as f64;
            for (k, &material) in payload.splat.iter().enumerate() {
                let (i, j) = (k % SPLAT_SIDE, k / SPLAT_SIDE);
                let place = [origin.x + i as f64 * step, origin.y + j as f64 * step];
                assert_eq!(material, world.material_at(place[0], place[1]), "texel {i}, {j} of LOD {lod} at {place:?}");
            }
        }
    }
}

#[test]
fn a_slope_is_reached_exactly_up_to_the_steepest() {
    let known = alps();
    let steepest = known.max_slope_deg();
    let more = steepest + 1e-9;
    assert!(known.is_as_steep_as(steepest) && !known.is_as_steep_as(more) && !known.is_as_steep_as(f64::NAN));
    // The answers must be the same if the steepest slope has not been computed before.
    let asked = alps();
    assert!(asked.is_as_steep_as(-1.0) && asked.is_as_steep_as(0.0) && asked.is_as_steep_as(steepest) && !asked.is_as_steep_as(more));
    assert!(asked.is_as_steep_as(steepest) && asked.is_as_steep_as(10.0) && !asked.is_as_steep_as(more));
}

#[test]
fn payloads_do_not_depend_on_the_number_of_threads() {
    let world = alps();
    let nodes: Vec<NodeId> = (0..6).map(|i| NodeId { lod: i, x: u16::from(5 - i), y: 2 }).collect();
    let with = |threads: usize| {
        let done = AtomicUsize::new(0);
        let count = || {
            done.fetch_add(1, Ordering::Relaxed);
        };
        let baked = on_threads(threads, || world.bake_many(&nodes, &palette(), false, count)).expect("threads to work on");
        assert_eq!(done.into_inner(), nodes.len());
        baked.into_iter().map(|node| node.payload).collect::<Vec<_>>()
    };
    let (one, four) = (with(1), with(4));
    assert!(one == four, "1 and 4 threads must give the same bits");
    assert!(one.iter().map(|p| p.id).eq(nodes.iter().copied()), "the payloads must be in the order of the nodes");
}

#[test]
fn albedo_alpha_is_zero_exactly_at_vertices_in_holes() {
    let world = World::new(&scene_with("seed = 7\nholes = [{ centre = [70.0, 20.0], radius_m = 6.3 }]")).expect("valid");
    let layout = *world.layout();
    for lod in [0, 1] {
        let id = layout.node_at(lod, 70.0, 20.0).expect("inside");
        let payload = world.bake(id, &palette());
        let rgba = blocks::decode(BlockFormat::Bc1, &payload.albedo, TEXTURE_SIDE, TEXTURE_SIDE);
        let (origin, spacing) = (id.origin_m(&layout), layout.spacing_m(lod));
        let (mut open, mut shifted) = (0, 0);
        for j in 0..TEXTURE_SIDE {
            for i in 0..TEXTURE_SIDE {
                let vertex = |k: usize, o: f64| o + (k as f64 - 2.0) * spacing;
                let hole = world.is_hole(vertex(i, origin.x), vertex(j, origin.y));
                let alpha = rgba[(j * TEXTURE_SIDE + i) * 4 + 3];
                assert_eq!(alpha == 0, hole, "LOD {lod}, texel {i}, {j}");
                open += usize::from(hole);
                shifted += usize::from((alpha == 0) != world.is_hole(vertex(i + 1, origin.x), vertex(j, origin.y)));
            }
        }
        assert!(open > 20, "LOD {lod} has a hole of {open} vertices");
        assert!(shifted > 4, "negative control: a texel read one vertex off is noticed");
    }
    let whole = bake(&world, 0, 3, 3);
    let rgba = blocks::decode(BlockFormat::Bc1, &whole.albedo, TEXTURE_SIDE, TEXTURE_SIDE);
    assert!(rgba.chunks_exact(4).all(|t| t[3] == 255));
    assert!(world.is_hole(5121.0, 0.0) && !world.is_hole(5120.0, 0.0), "there is ground on the rim of the world, but not outside");
}

#[test]
fn vertices_beyond_a_heightmap_repeat_its_edge_and_the_surface_ends_there() {
    let temp = Folder::new("world-edge");
    let scene = island(&temp);
    let world = World::new(&scene).expect("valid");
    let layout = *world.layout();
    let means = PaletteMeans {
        albedo: vec![[0.2; 3]; scene.materials.len()],
        smoothness: vec![0.2; scene.materials.len()],
        specular_occlusion: vec![1.0; scene.materials.len()],
    };
    let [east, north] = world.extent_m().map(|length| length / 2.0);
    assert!((east - 430.0).abs() < 1e-9 && (north - 320.35).abs() < 1e-9 && layout.finest_lod == 3);
    for lod in layout.finest_lod..LODS {
        let id = layout.node_at(lod, east - 1.0, 1.0 - north).expect("inside the world");
        let payload = world.bake(id, &means);
        let (origin, spacing) = (id.origin_m(&layout), layout.spacing_m(lod));
        let mut beyond = 0;
        for (k, &height) in payload.height.iter().enumerate() {
            let at = [k % HEIGHT_SIDE, k / HEIGHT_SIDE].map(|n| n as f64 * spacing);
            let at = [origin.x + at[0], origin.y + at[1]];
            let drawn = world.drawn_at(at);
            assert!(drawn[0].abs() <= east && drawn[1].abs() <= north);
            if drawn == at {
                continue;
            }
            // Vertices beyond the edge of the data are moved to the edge, so several vertices may be drawn at the same place. They must have the same
            // height; otherwise, the terrain would have a vertical wall there. So their heights are not filtered, unlike other heights of coarse
            // nodes.
            assert_eq!(height, world.quantise(world.height_m(drawn[0], drawn[1])), "LOD {lod}, {at:?}");
            beyond += 1;
        }
        assert!(beyond > 1000, "LOD {lod}: {beyond} vertices");
        let rgba = blocks::decode(BlockFormat::Bc1, &payload.albedo, TEXTURE_SIDE, TEXTURE_SIDE);
        assert!(rgba.chunks_exact(4).all(|texel| texel[3] == 255), "LOD {lod}: the end of the data is no hole");
        // Triangles without an area have no normal. All other drawn triangles of a patch must have their normals in the cone of the patch.
        let cones = cones::decode(&payload.cones);
        let mut flat = 0;
        for (i, j) in (0..128).flat_map(|j| (0..128).map(move |i| (i, j))) {
            for [a, b, c] in drawn_triangles(&world, id, [i, j]) {
                let normal = (b - a).cross(c - a);
                if normal.length() == 0.0 {
                    flat += 1;
                    continue;
                }
                let patch = (j / 16 * 8 + i / 16) as usize;
                assert!(cones[patch].contains(normal.normalize().to_array()), "LOD {lod}, quad {i}, {j}");
            }
        }
        assert!(flat > 1000, "LOD {lod}: {flat} triangles without area");
    }
    // A procedural world fills its sectors, and moves no vertex.
    assert!(world.has_edge() && !alps().has_edge());
    assert_eq!(alps().drawn_at([6000.0, -5121.0]), [6000.0, -5121.0]);

    // The surface of the finest LOD consists of the triangles that the reference of the geometry pass draws. This also holds in the easternmost
    // column of quads, which the edge of the data cuts from a width of 4 m to 2 m.
    let mut flatter = 0.0f64;
    for k in 0..600u32 {
        let (a, b) = ((f64::from(k) * 0.754_877_666_246_69).fract(), (f64::from(k) * 0.569_840_290_998_05).fract());
        let at = glam::DVec2::new(428.0 + 2.0 * a, (2.0 * b - 1.0) * north);
        let id = layout.node_at(3, at.x, at.y).expect("inside the world");
        let quad = ((at - id.origin_m(&layout)) / layout.spacing_m(3)).floor().as_uvec2().to_array();
        let [drawn, lattice] = [true, false].map(|is_drawn| {
            let triangles = drawn_triangles(&world, id, quad).map(|triangle| {
                let moved = |v: glam::DVec3| if v.x == east && !is_drawn { glam::DVec3::new(432.0, v.y, v.z) } else { v };
                triangle.map(moved)
            });
            triangles.iter().find_map(|triangle| height_on(*triangle, at)).expect("the triangles cover the quad")
        });
        let found = world.surface_height_m(at.x, at.y);
        assert!((found - drawn).abs() < 1e-6, "{at}: {found}, not {drawn}");
        flatter = flatter.max((found - lattice).abs());
    }
    assert!(flatter > 0.2, "negative control: a strip of full width is {flatter} m off");
    // Beyond the data, the height is that of the nearest point of the data.
    assert_eq!(world.surface_height_m(900.0, 12.0), world.surface_height_m(east, 12.0));
    assert_eq!(world.height_m(-900.0, -900.0), world.height_m(-east, -north));
}

/// The two triangles of a quad of a node, as the reference of the geometry pass draws them. `[i, j]` is the south-western vertex of the quad.
fn drawn_triangles(world: &World, id: NodeId, [i, j]: [u32; 2]) -> [[glam::DVec3; 3]; 2] {
    let [sw, se, nw, ne] = [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]].map(|index| reference::vertex(world, id, index));
    if diagonal_rises(i as usize, j as usize) { [[sw, se, ne], [sw, ne, nw]] } else { [[sw, se, nw], [se, ne, nw]] }
}

/// Height of a triangle at a horizontal position; `None` = the position is outside of the triangle, or the triangle has no area.
fn height_on([a, b, c]: [glam::DVec3; 3], at: glam::DVec2) -> Option<f64> {
    let [ab, ac, ap] = [(b - a).truncate(), (c - a).truncate(), at - a.truncate()];
    let area = ab.perp_dot(ac);
    let (of_b, of_c) = (ap.perp_dot(ac) / area, ab.perp_dot(ap) / area);
    (area > 0.0 && of_b >= -1e-9 && of_c >= -1e-9 && of_b + of_c <= 1.0 + 1e-9).then_some(a.z + of_b * (b.z - a.z) + of_c * (c.z - a.z))
}

/// Returns the unit normals of the drawn triangles of each patch, computed as cross products of edges.
fn triangle_normals(world: &World, payload: &NodePayload) -> Vec<Vec<[f64; 3]>> {
    let spacing = world.layout().spacing_m(payload.id.lod);
    let mut patches = vec![Vec::new(); 64];
    let point = |i: usize, j: usize| {
        let z = world.elevation_m(payload.height[j * HEIGHT_SIDE + i]);
        glam::DVec3::new(i as f64 * spacing, j as f64 * spacing, z)
    };
    for j in 0..128 {
        for i in 0..128 {
            let [sw, se, nw, ne] = [point(i, j), point(i + 1, j), point(i, j + 1), point(i + 1, j + 1)];
            let triangles = if (i + j) % 2 == 0 { [[sw, se, ne], [sw, ne, nw]] } else { [[sw, se, nw], [se, ne, nw]] };
            for [a, b, c] in triangles {
                patches[j / 16 * 8 + i / 16].push((b - a).cross(c - a).normalize().to_array());
            }
        }
    }
    patches
}

#[test]
fn cones_hold_every_triangle_after_decoding() {
    let world = alps();
    let (mut escaped_from_mutant, mut widest, mut narrow) = (0, 0.0f64, 0);
    for lod in [0, 1, 3, 5] {
        let payload = world.bake(steep_node(&world, lod), &palette());
        let decoded = cones::decode(&payload.cones);
        for (cone, normals) in decoded.iter().zip(triangle_normals(&world, &payload)) {
            assert!(normals.iter().all(|&n| cone.contains(n)), "LOD {lod}: {cone:?}");
            widest = widest.max(cone.sin_half_angle);
            narrow += usize::from(cone.sin_half_angle < 0.8);
            // The mutant computes the half angle for the axis before block compression, which differs from the decoded axis.
            let mean = normals.iter().fold(glam::DVec3::ZERO, |s, &n| s + glam::DVec3::from_array(n)).normalize();
            let cosine = normals.iter().map(|&n| mean.dot(glam::DVec3::from_array(n))).fold(1.0, f64::min);
            let mutant = cones::Cone { axis: cone.axis, sin_half_angle: if cosine > 0.0 { (1.0 - cosine * cosine).sqrt() } else { 1.0 } };
            escaped_from_mutant += normals.iter().filter(|&&n| !mutant.contains(n)).count();
        }
    }
    assert!(escaped_from_mutant > 0, "negative control: cones that ignore the decoded axis lose triangles");
    assert!(widest > 0.5 && narrow > 60, "cones must be neither all wide nor all narrow: widest {widest}, {narrow} below 53 degrees");
}

#[test]
fn alpha_blocks_never_decode_below_what_is_needed() {
    let mut state = 1u32;
    let mut random = || {
        state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
        (state >> 24) as u8
    };
    for round in 0..2000 {
        let (base, span) = (random(), random());
        let needed: [u8; 16] = std::array::from_fn(|i| match (round % 4, i % 5) {
            (0, _) => base,
            (1, 0) => 255,
            (2, _) => base.saturating_add(random() % 16),
            _ => base.saturating_add((u16::from(random()) * u16::from(span) / 255) as u8),
        });
        let mut block = [0; 16];
        block[..8].copy_from_slice(&blocks::alpha_block_at_least(needed));
        let decoded = blocks::decode(BlockFormat::Bc3, &block, 4, 4);
        let values: Vec<u8> = decoded.chunks_exact(4).map(|t| t[3]).collect();
        assert!(values.iter().zip(needed).all(|(&v, n)| v >= n), "{needed:?} became {values:?}");
        let spread = needed.iter().max().zip(needed.iter().min()).map_or(0, |(a, b)| a - b);
        let excess = values.iter().zip(needed).map(|(&v, n)| v - n).max();
        assert!(
            excess <= Some(spread / 5 + 2),
            "no value may exceed what is needed by more than a step of the block: {needed:?} became {values:?}"
        );
    }
}

#[test]
fn surface_height_follows_the_drawn_triangles() {
    let world = alps();
    let id = steep_node(&world, 0);
    let payload = world.bake(id, &palette());
    let (origin, spacing) = (id.origin_m(world.layout()), world.layout().spacing_m(0));
    let mut other_diagonal = 0.0f64;
    for k in 0..4000u32 {
        // A low-discrepancy sequence of points (Roberts 2018), which covers the node evenly.
        let (a, b) = ((f64::from(k) * 0.754_877_666_246_69).fract(), (f64::from(k) * 0.569_840_290_998_05).fract());
        let (s, t) = (a * 128.0, b * 128.0);
        let (i, j) = (s as usize, t as usize);
        let corner = |di: usize, dj: usize| world.elevation_m(payload.height[(j + dj) * HEIGHT_SIDE + i + di]);
        // Interpolates the height with barycentric coordinates in the triangle that contains the point. `rises` selects the diagonal that splits the
        // quad.
        let inside = |rises: bool| {
            let (u, v) = (s - i as f64, t - j as f64);
            let split = if rises {
                [[(0, 0), (1, 0), (1, 1)], [(0, 0), (1, 1), (0, 1)]]
            } else {
                [[(0, 0), (1, 0), (0, 1)], [(1, 0), (1, 1), (0, 1)]]
            };
            let mut heights = split.iter().filter_map(|&[p, q, r]: &[(usize, usize); 3]| {
                let f = |p: (usize, usize)| (p.0 as f64, p.1 as f64);
                let ((px, py), (qx, qy), (rx, ry)) = (f(p), f(q), f(r));
                let area = (qx - px) * (ry - py) - (rx - px) * (qy - py);
                let wq = ((u - px) * (ry - py) - (rx - px) * (v - py)) / area;
                let wr = ((qx - px) * (v - py) - (u - px) * (qy - py)) / area;
                let wp = 1.0 - wq - wr;
                (wp >= -1e-9 && wq >= -1e-9 && wr >= -1e-9).then(|| wp * corner(p.0, p.1) + wq * corner(q.0, q.1) + wr * corner(r.0, r.1))
            });
            heights.next().expect("the triangles cover the quad")
        };
        let drawn = world.surface_height_m(origin.x + s * spacing, origin.y + t * spacing);
        assert!((drawn - inside(diagonal_rises(i, j))).abs() < 1e-7, "at {i}, {j}");
        other_diagonal = other_diagonal.max((drawn - inside(!diagonal_rises(i, j))).abs());
    }
    assert!(other_diagonal > 0.05, "negative control: the other diagonal must give a different surface ({other_diagonal} m)");
    for (x, y) in [(5120.0, 5120.0), (-5120.0, 5119.9), (9000.0, 0.0)] {
        assert!(world.surface_height_m(x, y).is_finite(), "heights on the rim and beyond must be finite");
    }
}

#[test]
fn normals_decode_near_the_surface_and_flat_ground_near_zero() {
    let world = alps();
    let id = steep_node(&world, 2);
    let payload = world.bake(id, &palette());
    let rgba = blocks::decode(BlockFormat::Bc3, &payload.normal, TEXTURE_SIDE, TEXTURE_SIDE);
    let spacing = world.layout().spacing_m(2);
    let (mut sum, mut swapped) = (0.0, 0.0);
    for k in 0..400 {
        let (i, j) = (2 + k * 37 % 128, 2 + k * 91 % 128);
        // Along x, texel (i, j) lies between vertices i - 2 and i - 1; along y, it lies between vertices j - 2 and j - 1.
        let h = |di: usize, dj: usize| world.elevation_m(payload.height[(j + dj - 2) * HEIGHT_SIDE + i + di - 2]);
        let [sw, se, nw, ne] = [h(0, 0), h(1, 0), h(0, 1), h(1, 1)];
        let normal = glam::DVec3::new(-(se - sw + ne - nw), -(nw - sw + ne - se), 2.0 * spacing).normalize();
        let texel = &rgba[(j * TEXTURE_SIDE + i) * 4..][..4];
        let (x, y) = (f64::from(texel[3]) / 127.5 - 1.0, f64::from(texel[1]) / 127.5 - 1.0);
        let of = |x: f64, y: f64| glam::DVec3::new(x, y, (1.0 - x * x - y * y).max(0.0).sqrt()).normalize();
        sum += of(x, y).angle_between(normal).to_degrees() / 400.0;
        swapped += of(y, x).angle_between(normal).to_degrees() / 400.0;
    }
    assert!(sum < 4.0, "mean error of decoded normals: {sum} degrees");
    assert!(swapped > 2.0 * sum, "negative control: swapped channels are {swapped} degrees off");
    let flat = blocks::encode(BlockFormat::Bc3, &[64, 128, 255, 128].repeat(16), 4, 4, [0.15, 1.0, 0.1], Effort::Fast);
    let flat = blocks::decode(BlockFormat::Bc3, &flat, 4, 4);
    assert!(flat.chunks_exact(4).all(|t| t[1].abs_diff(128) <= 3 && t[3].abs_diff(128) <= 1), "{:?}", &flat[..4]);
}

#[test]
fn the_generator_makes_mountains_with_cliffs_and_valley_floors() {
    let world = alps();
    let (low, high) = world.height_range_m();
    let (mut heights, mut steep, mut flat) = (Vec::new(), 0, 0);
    const SIDE: usize = 170;
    for k in 0..SIDE * SIDE {
        let at = |i: usize| ((i as f64 + 0.5) / SIDE as f64 - 0.5) * 10_240.0;
        let (x, y) = (at(k % SIDE), at(k / SIDE));
        let h = world.height_m(x, y);
        let slope = ((world.height_m(x + 0.5, y) - h) / 0.5).hypot((world.height_m(x, y + 0.5) - h) / 0.5).atan().to_degrees();
        // The slope for cliffs is measured over 12 m, so that the side of a boulder does not count as a cliff. A slope (tangent) above 2 over 12 m
        // means a face with a height of about 25 m or more.
        let broad = ((world.height_m(x + 6.0, y) - world.height_m(x - 6.0, y)) / 12.0)
            .hypot((world.height_m(x, y + 6.0) - world.height_m(x, y - 6.0)) / 12.0);
        steep += usize::from(broad > 2.0);
        flat += usize::from(slope < 10.0);
        heights.push(h);
    }
    heights.sort_by(f64::total_cmp);
    let share = |n: usize| n as f64 / (SIDE * SIDE) as f64;
    assert!(heights[0] > low && heights[SIDE * SIDE - 1] < high, "all heights must be strictly inside the bounds");
    assert!(heights[0] < 350.0 && heights[SIDE * SIDE - 1] > 1700.0, "{} to {}", heights[0], heights[SIDE * SIDE - 1]);
    assert!((0.02..0.2).contains(&share(steep)), "cliffs: {}", share(steep));
    assert!((0.05..0.5).contains(&share(flat)), "valley floors: {}", share(flat));
    assert!(world.max_slope_deg() > 75.0);
    let other = World::new(&scene_with("seed = 8")).expect("valid");
    assert!((other.height_m(100.0, 200.0) - world.height_m(100.0, 200.0)).abs() > 1e-3, "a different seed must give a different world");
}

/// Returns the number of teeth in a row of heights. A tooth is three successive vertices at which the slope changes visibly, each time in the
/// opposite direction. A row of teeth (a comb) is an artefact: a grid of vertices draws it if a crest or an edge is thinner than the spacing of the
/// grid.
fn teeth_in(heights: &[f64], spacing_m: f64) -> usize {
    // Smallest visible change of slope, as a difference of tangents.
    const VISIBLE: f64 = 0.6;
    let bends: Vec<f64> = heights.windows(3).map(|h| (h[0] - 2.0 * h[1] + h[2]) / spacing_m).collect();
    let opposed = |a: f64, b: f64| a * b < 0.0 && a.abs().min(b.abs()) > VISIBLE;
    bends.windows(3).filter(|b| b.windows(2).all(|pair| opposed(pair[0], pair[1]))).count()
}

/// Returns the number of teeth per 10 000 vertices. The teeth are counted along the rows and columns of 144 grids of 65 x 65 vertices, which are
/// distributed over the world and have the vertex spacing of `lod`. Each vertex counts twice, in its row and in its column, but the ends of rows and
/// columns do not count. The heights are samples of `height_m`, which are rougher than the heights that a coarse LOD draws.
fn teeth(height_m: impl Fn(f64, f64) -> f64, lod: u8) -> f64 {
    const PLACES: u32 = 12;
    const SIDE: usize = 65;
    let spacing_m = Layout::of(10_240.0, None).spacing_m(lod);
    let reach = 10_240.0 - SIDE as f64 * spacing_m;
    let mut found = 0;
    for place in 0..PLACES * PLACES {
        let corner = |i: u32| ((f64::from(i) + 0.5) / f64::from(PLACES) * reach / spacing_m).floor() * spacing_m - 5120.0;
        let (x, y) = (corner(place % PLACES), corner(place / PLACES));
        let at = |i: usize| height_m(x + (i % SIDE) as f64 * spacing_m, y + (i / SIDE) as f64 * spacing_m);
        let grid: Vec<f64> = (0..SIDE * SIDE).map(at).collect();
        for k in 0..SIDE {
            let column: Vec<f64> = grid.iter().skip(k).step_by(SIDE).copied().collect();
            found += teeth_in(&grid[k * SIDE..][..SIDE], spacing_m) + teeth_in(&column, spacing_m);
        }
    }
    found as f64 * 1e4 / (f64::from(PLACES * PLACES) * 2.0 * (SIDE * (SIDE - 2)) as f64)
}

#[test]
fn no_lod_draws_crests_and_edges_as_combs() {
    let world = alps();
    // The bounds are about 1.5 times the measured numbers: 7.4, 8.5, 6.3 and 21.8. LOD 5 may have more teeth than the finer LODs, because large
    // pictures use it only beyond a distance of 4 km, where a tooth is only one or two pixels high.
    for (lod, most) in [(2, 11.0), (3, 13.0), (4, 9.5), (5, 33.0)] {
        let found = teeth(|x, y| world.height_m(x, y), lod);
        assert!(found < most, "LOD {lod}: {found} teeth in 10 000 vertices");
    }
    // Negative control: fins that are oblique to the grid and 30 m tall. Along x, they are 6 m wide and 80 m apart.
    let fins = |x: f64, y: f64| {
        let across = (x + 0.7 * y + 1e5).rem_euclid(80.0) - 40.0;
        world.height_m(x, y) + 30.0 * (1.0 - across.abs() / 3.0).max(0.0)
    };
    for lod in [2, 3] {
        let found = teeth(fins, lod);
        assert!(found > 40.0, "LOD {lod} has a comb, but only {found} teeth are found");
    }
}

#[test]
fn rules_pick_the_heaviest_and_noise_covers_its_share() {
    let text = format!(
        "name = \"test\"\n[world]\nkind = \"procedural\"\nseed = 3\n{}",
        MATERIALS.split("[[rule]]").next().expect("a first part").to_owned()
            + "[[rule]]\nmaterial = \"grass\"\nweight = 0.5\n[[rule]]\nmaterial = \"scree\"\nweight = 1.0\nnoise_m = 10.0\nnoise_cover = 0.3\n\
               [[rule]]\nmaterial = \"granite\"\nweight = 9.0\nslope_deg = [40.0, 90.0]\nslope_fade_deg = 10.0\n\
               [[rule]]\nmaterial = \"grass\"\nweight = 9.0\ncurvature = [0.1, 1.0]\n[[rule]]\nmaterial = \"scree\"\nweight = 9.0\ncurvature = [0.2, 1.0]\n"
    );
    let scene = scene::parse(&text, "test scene", Path::new(".")).expect("valid");
    let rules = kernels::world::rules::Rules::new(&scene);
    assert_eq!(rules.material_at(0.0, 60.0, 0.0, 1.0, 1.0), 2);
    // Below 40 degrees, the weight 9 of granite falls linearly over the fade of 10 degrees. It is 4.5 at 35 degrees, and 0 at 29.9 degrees.
    assert!((rules.weights_at(0.0, 35.0, 0.0, 1.0, 1.0)[2] - 4.5).abs() < 1e-12);
    assert_ne!(rules.material_at(0.0, 29.9, 0.0, 1.0, 1.0), 2);
    assert_eq!(rules.material_at(0.0, 0.0, 0.15, 1.0, 1.0), 0, "convex");
    assert_eq!(rules.material_at(0.0, 0.0, 0.25, 1.0, 1.0), 1, "if two rules have the same weight, the later rule must apply");
    let places = 40_000;
    let covered = (0..places).filter(|k| rules.material_at(0.0, 5.0, 0.0, f64::from(k % 200) * 7.3, f64::from(k / 200) * 7.3) == 1).count();
    let share = covered as f64 / f64::from(places);
    assert!((share - 0.3).abs() < 0.03, "{share}");
}

#[test]
fn colour_modulation_is_neutral_without_strength_and_varies_with_it() {
    let decode = |p: &NodePayload| blocks::decode(BlockFormat::Bc1, &p.colour_modulation, TEXTURE_SIDE, TEXTURE_SIDE);
    let neutral = decode(&bake(&alps(), 2, 5, 5));
    assert!(neutral.chunks_exact(4).all(|t| t[..3].iter().all(|c| c.abs_diff(128) <= 4)), "{:?}", &neutral[..4]);
    let world = World::new(&scene_with("seed = 7\ncolour_modulation = 0.5")).expect("valid");
    let varied = decode(&bake(&world, 2, 5, 5));
    let greens = varied.chunks_exact(4).map(|t| t[1]);
    assert!(greens.clone().max() > greens.min().map(|m| m + 30));
}

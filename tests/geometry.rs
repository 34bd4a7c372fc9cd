//! Tests of the geometry pass: stitching, mask and normals, culling, larger vertex strides, the height query, and the edge of the ground.
//!
//! On a side where the neighbouring node or patch is coarser, stitching moves (welds) the border vertices to vertices that the neighbour also has.
//! The tests compare the functions of the vertex stage on the GPU with their reference, and check that the neighbour has the vertices that the
//! reference returns. The ground of a heightmap must end where its data end, without cracks at borders of nodes.

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

use glam::{DVec2, DVec3};
use kernels::culling::{Culls, Levels};
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::geometry::surface::Surface;
use kernels::geometry::{STITCH_WGSL, reference};
use kernels::gpu::read_texture;
use kernels::materials::Palette;
use kernels::oracle;
use kernels::probe::table;
use kernels::quadtree::Lag;
use kernels::residency::Schedule;
use kernels::scene::Scene;
use kernels::shading::Estimator;
use kernels::shared::flavour_weights::{self, FlavourParams};
use kernels::shared::hash;
use kernels::terrain::reference::{Ground, Spot};
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::{NEAR_M, Pose};
use kernels::view::normals::NormalEncoding;
use kernels::world::payload::diagonal_rises;
use kernels::world::{LODS, NodeId, World};

use crate::fixtures::{Folder, SIZE, gpu, island, pose, request, second_renderer, terrain};
use crate::shading::{self, Seen};

/// A vertex of a node or of a patch, both of which are squares: the index of the vertex in the node, the index of the square's south-west corner, the
/// number of quads along a side of the square, and the packed deltas of its four sides (see [`rows`]).
type Row = ([u32; 2], [u32; 2], u32, u32);

/// Returns rows for the test. A delta is the number of levels by which a side is coarser than the vertices of the square; the deltas of the four
/// sides are packed with 4 bits each. The rows contain every border vertex and some inner vertices of the node, vertices of some of its patches, and
/// every delta from 0 to 5 on every side.
fn rows() -> Vec<Row> {
    let mut rows = Vec::new();
    for deltas in (0..6u32).flat_map(|d| [d, d << 4, d << 8, d << 12, d | d << 4 | d << 8 | d << 12, d | (5 - d) << 4]) {
        for i in 0..=128 {
            rows.extend([[i, 0], [i, 128], [0, i], [128, i], [i, 64], [i, 127 - i / 2]].map(|index| (index, [0, 0], 128, deltas)));
            // The sides of a patch that lies in the node.
            let first = [16 * (i % 7), 16 * (i / 20)];
            let [k, deltas] = [i % 17, deltas & 0x7777];
            rows.extend([[k, 0], [k, 16], [0, k], [16, k], [k, 8]].map(|[x, y]| ([first[0] + x, first[1] + y], first, 16, deltas)));
        }
    }
    rows
}

/// Stitches all rows on the GPU, with the functions whose names begin with `prefix`. `wgsl` is added to the shader.
fn on_gpu(wgsl: &str, prefix: &str) -> Vec<[u32; 2]> {
    let body = format!(
        "{wgsl}\nfn probe(row: array<f32, 5>) -> array<f32, 2> {{
    let at = vec2<u32>(u32(row[0]), u32(row[1]));
    let first = vec2<u32>(u32(row[3]) % 128u, u32(row[3]) / 128u);
    let kept = {prefix}_stitch(at, first, u32(row[4]), u32(row[2]));
    return array<f32, 2>(f32(kept.x), f32(kept.y));
}}"
    );
    let inputs: Vec<f32> =
        rows().iter().flat_map(|(i, first, quads, d)| [i[0], i[1], *d, first[0] + 128 * first[1], *quads].map(|n| n as f32)).collect();
    let out = table::run(gpu(), &body, &inputs, 5, 2).expect("the probe runs");
    out.chunks_exact(2).map(|c| [c[0] as u32, c[1] as u32]).collect()
}

fn differences(found: &[[u32; 2]]) -> usize {
    found
        .iter()
        .zip(rows())
        .filter(|(kept, (index, first, quads, deltas))| **kept != reference::stitch(*index, *first, *quads, *deltas))
        .count()
}

#[test]
fn stitching_equals_its_reference() {
    // The shader of a probe already contains the text of the stage, so no WGSL is added.
    assert_eq!(differences(&on_gpu("", "geometry")), 0);
    // Negative controls: a vertex halfway between two vertices of the neighbour moves to the one with the higher index instead of the lower; the
    // northern border uses the delta of the southern neighbour.
    for (from, to) in [("(step - 1u) / 2u", "step / 2u"), ("(deltas >> 12u) & 15u", "(deltas >> 4u) & 15u")] {
        assert!(STITCH_WGSL.text.contains(from), "the mutant must change something");
        // The functions of the mutant are renamed, because the shader already contains the original ones.
        let mutant = STITCH_WGSL.text.replace(from, to).replace("geometry_", "stitching_");
        assert!(differences(&on_gpu(&mutant, "stitching")) > 0, "{to} passes");
    }
}

#[test]
fn welded_vertices_are_the_neighbours_and_the_nearest() {
    for delta in 0..=5u32 {
        let step = 1 << delta;
        for index in 0..=128u32 {
            let kept = reference::weld(index, delta);
            assert_eq!(kept % step, 0, "the neighbour has no vertex {kept} at delta {delta}");
            assert!(kept <= 128 && kept.abs_diff(index) <= step / 2, "{index} moves to {kept} at delta {delta}");
        }
        assert_eq!((reference::weld(0, delta), reference::weld(128, delta)), (0, 128), "corners must not move");
    }
}

#[test]
fn mask_and_shading_normal_equal_their_references() {
    let mut renderer = second_renderer();
    let (scene, world) = (renderer.scene().clone(), renderer.world().clone());
    let params = FlavourParams::new(&scene.flavours);
    let palette = Palette::build(&scene, world.layout().sector_m, |_| Ok(())).expect("procedural textures");
    let mut ground: Option<Ground<'_>> = None;
    for (normals, limit) in NormalEncoding::ALL.into_iter().zip(NORMAL_LIMITS) {
        // A size that is not a multiple of the size of a tile.
        let request = request(&renderer, "cliff").with(|r| {
            r.view.size = [93, 61];
            r.geometry.normals = normals;
            r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
        });
        let (seen, nodes) = shading::seen(&mut renderer, &request);
        let ground = ground.get_or_insert_with(|| Ground::new(&world, &palette, &nodes, scene.blend.height_sharpness));
        let frame = renderer.draw(&request).expect("draws");
        let masks = read_texture(gpu(), &frame.targets().geometry.mask, wgpu::TextureAspect::All, 1).expect("the device works");
        let (mut of_mask, mut angles, mut shifted) = (BTreeMap::new(), Vec::new(), Vec::new());
        let mut sky = masks.clone();
        for Seen { index, pixel, .. } in &seen {
            sky[*index] = 0;
            // If the distance from the eye is within 0.001 % of a distance at which the flavours change, rounding decides the mask. So the masks of
            // slightly smaller and of slightly larger distances are accepted.
            let mask = |factor: f64| flavour_weights::mask(flavour_weights::weights(pixel.distance_m * factor, pixel.normal.z, &params));
            let [low, high] = [mask(0.99999), mask(1.00001)];
            let found = u32::from(masks[*index]);
            assert!(found == low || found == high, "{normals}, pixel {index}: mask {found:05b}, not {low:05b}");
            *of_mask.entry(found).or_insert(0) += 1;
            let Some(spot) = ground.spot(pixel.position.truncate()) else { continue };
            let angle = |spot: &Spot| {
                let (_, normal) = ground.baked(spot);
                normal.cross(pixel.normal).length().atan2(normal.dot(pixel.normal))
            };
            angles.push(angle(&spot));
            shifted.push(angle(&Spot { uv: (spot.uv + 1.0 / 128.0).min(DVec2::ONE), ..spot }));
        }
        assert!(sky.iter().all(|mask| *mask == 0), "the mask of sky is not 0");
        assert!(of_mask.len() > 4 && seen.len() < masks.len(), "{of_mask:?}");
        let quantile = |angles: &mut Vec<f64>, percent: usize| {
            angles.sort_by(f64::total_cmp);
            angles[(angles.len() - 1) * percent / 100]
        };
        let (median, most) = (quantile(&mut angles, 50), quantile(&mut angles, 90));
        println!("{normals}: {of_mask:?}, shading normal: median {median:.5}, 90 % {most:.5}, shifted {:.5}", quantile(&mut shifted, 50));
        assert!(median < limit && most < 3.0 * limit, "{normals}: median {median} rad, 90 % {most} rad");
        // Negative control: the normal of the neighbouring texel.
        assert!(quantile(&mut shifted, 50) > 1.5 * limit, "{normals}: {:?}", quantile(&mut shifted, 50));
    }
}

/// Limits of the median difference between the stored shading normal and its reference, radians, for each encoding. A software adapter filters
/// textures with 8 bits. The first two encodings round the shading normal to 8 + 8 bits, which are steps of 0.008 to 0.019 radians.
const NORMAL_LIMITS: [f64; 3] = [0.01, 0.01, 0.005];

/// The bytes of depth, mask and normals of a frame, and the number of patches drawn.
fn geometry_of(renderer: &mut Renderer<'_>, request: &RenderRequest, culls: Culls) -> ([Vec<u8>; 3], usize) {
    let frame = renderer.draw(&request.with(|r| r.geometry.culls = culls)).expect("draws");
    let targets = &frame.targets().geometry;
    let read = |texture, aspect, bytes| read_texture(gpu(), texture, aspect, bytes).expect("the device works");
    let all = wgpu::TextureAspect::All;
    let depth = read(&targets.depth_stencil, wgpu::TextureAspect::DepthOnly, 4);
    ([depth, read(&targets.mask, all, 1), read(&targets.normals, all, 4)], frame.report().patches)
}

#[test]
fn culling_changes_no_pixel() {
    let mut renderer = second_renderer();
    let random = |case: u32, number: u32, low: f64, high: f64| {
        let word = hash::pcg4d([case, number, 2018, 7])[0];
        low + (high - low) * f64::from(word) / 4_294_967_296.0
    };
    let cameras: Vec<String> = renderer.scene().cameras.iter().map(|camera| camera.name.clone()).collect();
    let mut poses: Vec<Pose> = cameras.iter().map(|camera| pose(&renderer, camera)).collect();
    for case in 0..40 {
        let [x, y] = [0, 1].map(|axis| random(case, axis, -800.0, 800.0));
        // From 0.1 m to 300 m above the ground: hills hide more from low cameras.
        let position = DVec3::new(x, y, renderer.ground_m(x, y) + 0.1 * random(case, 2, 0.0, 8.0).exp());
        let [yaw, pitch, fov] = [(3, 0.0, 6.3), (4, -0.7, 0.4), (5, 0.3, 1.6)].map(|(number, low, high)| random(case, number, low, high));
        poses.push(Pose { position, yaw, pitch, fov });
    }
    let (mut drawn, mut hidden, mut facing_away) = ([0; 2], 0, 0);
    for (case, pose) in poses.into_iter().enumerate() {
        let request = RenderRequest::new(pose, [[93, 61], [64, 128], [1, 1], [257, 3]][case % 4]).with(|r| {
            r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
            r.outputs.lit = false;
            r.geometry.vertex_stride = [1, 1, 1, 4, 2][case % 5];
            r.geometry.error_px = [0.0, 0.0, 0.0, 0.5, 4.0, 0.0, 16.0][case % 7];
            r.view.jitter = [0.25 * (case % 3) as f64, 0.0];
        });
        let (expected, all) = geometry_of(&mut renderer, &request, Culls::FRUSTUM);
        let (found, left) = geometry_of(&mut renderer, &request, Culls::ALL);
        let counts = renderer.draw(&request).expect("draws").report().culled;
        (hidden, facing_away) = (hidden + counts.hidden, facing_away + counts.facing_away);
        for ((found, expected), name) in found.iter().zip(&expected).zip(["depth", "mask", "normals"]) {
            let wrong = found.iter().zip(expected).filter(|(a, b)| a != b).count();
            assert_eq!(wrong, 0, "case {case}, {pose:?}: {wrong} of {} bytes of {name} differ", expected.len());
        }
        drawn = [drawn[0] + all, drawn[1] + left];
    }
    println!("{} of {} patches are drawn, {hidden} hidden, {facing_away} facing away", drawn[1], drawn[0]);
    assert!(drawn[1] < drawn[0] && hidden > 1000 && facing_away > 50, "{drawn:?} {hidden} {facing_away}");
}

#[test]
fn the_whole_ground_is_drawn_whatever_has_arrived() {
    let mut renderer = second_renderer();
    let schedule = Schedule { nodes_per_frame: 40, latency_frames: 1 };
    let view = |renderer: &Renderer<'_>, x: f64, y: f64, pitch: f64| {
        let pose = Pose { position: DVec3::new(x, y, renderer.ground_m(x, y) + 60.0), yaw: 0.4, pitch, fov: 1.0 };
        RenderRequest::new(pose, [120, 80]).with(|r| {
            r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
            r.outputs.lit = false;
            // The picture is small, so its nodes would be coarse without a bias.
            r.geometry.lod_bias = -1.5;
        })
    };
    let start = view(&renderer, 0.0, 0.0, -1.2);
    let mut arrivals = renderer.arrivals(schedule, &start).expect("starts");
    let mut lods = BTreeMap::new();
    let mut stale = None;
    // The camera teleports in frames 0 and 12. Some nodes are then drawn 4 or 5 levels coarser than wanted, next to finer nodes that have arrived.
    for number in 0..24u32 {
        let jump = |axis: u32| 6000.0 * (f64::from(hash::pcg4d([number / 12, axis, 21, 4])[0]) / 4_294_967_296.0 - 0.5);
        let request = view(&renderer, jump(0), jump(1), -1.2);
        let (residency, _) = renderer.arrive(&mut arrivals, &request).expect("a frame");
        let request = request.with(|r| r.geometry.residency = residency);
        let ([depth, ..], _) = geometry_of(&mut renderer, &request, Culls::ALL);
        let gaps = bytemuck::pod_collect_to_vec::<u8, f32>(&depth).into_iter().filter(|depth| *depth <= 0.0).count();
        assert_eq!(gaps, 0, "frame {number}: {gaps} pixels of sky in a view of the ground alone");
        let report = renderer.draw(&request).expect("draws").into_report();
        *lods.entry(report.lag.largest).or_insert(0) += 1;
        stale = stale.or(Some(request));
    }
    assert!(lods.len() >= 4 && lods.keys().any(|lag| *lag >= 4), "{lods:?}");
    let error = renderer.draw(&stale.expect("the first frame")).map(|_| ()).expect_err("an earlier frame").to_string();
    assert!(error.contains("make this frame again"), "{error}");
    // When all nodes have arrived, the picture must equal that of settled residency, bit for bit.
    let last = view(&renderer, 300.0, -500.0, -0.3);
    let settled = geometry_of(&mut renderer, &last, Culls::ALL);
    let mut frames = 0;
    let residency = loop {
        let (residency, selection) = renderer.arrive(&mut arrivals, &last).expect("a frame");
        let streamed = last.with(|r| r.geometry.residency = residency);
        if selection.wanted.is_empty() {
            break residency;
        }
        if frames == 0 {
            assert!(geometry_of(&mut renderer, &streamed, Culls::ALL).0[0] != settled.0[0], "the first frame after a teleport is coarse");
        }
        frames += 1;
    };
    let streamed = last.with(|r| r.geometry.residency = residency);
    assert!(geometry_of(&mut renderer, &streamed, Culls::ALL) == settled, "after {frames} frames");
    assert_eq!(renderer.draw(&streamed).expect("draws").report().lag, Lag::default());
}

#[test]
fn the_layers_of_lods_and_strides_show_the_drawn_nodes_and_patches() {
    let mut renderer = second_renderer();
    let (mut seen_lods, mut seen_strides) = (BTreeSet::new(), BTreeSet::new());
    for camera in ["cliff", "vista"] {
        let request = request(&renderer, camera).with(|r| {
            r.geometry.error_px = 1.0;
            r.outputs.aovs = AovSet::from_names(&["lod", "stride", "position"]).expect("known layers");
        });
        let picture = renderer.render(&request).expect("renders");
        let on = terrain(&picture);
        let (lods, strides) = (picture.values("lod").expect("requested"), picture.values("stride").expect("requested"));
        let position = picture.vectors("position").expect("requested");
        let layout = *renderer.world().layout();
        for (i, is_terrain) in on.iter().enumerate() {
            if !is_terrain {
                assert_eq!((lods[i], strides[i]), (-1.0, 0.0), "{camera}, pixel {i}");
                continue;
            }
            // The drawn node that contains the position, found by its corners. Positions within 1 cm of a border of patches are left out, because the
            // layer rounds them to f32.
            let [x, y] = [0, 1].map(|k| f64::from(position[i][k]));
            let node = picture.report.drawn.iter().find(|node| {
                let (low, edge) = (node.origin_m(&layout), layout.node_m(node.lod));
                (low.x..low.x + edge).contains(&x) && (low.y..low.y + edge).contains(&y)
            });
            let node = *node.unwrap_or_else(|| panic!("{camera}, pixel {i}: no node is drawn at ({x}, {y})"));
            let in_patches = (DVec2::new(x, y) - node.origin_m(&layout)) / (layout.node_m(node.lod) / 8.0);
            if (in_patches - in_patches.round()).abs().min_element() * layout.node_m(node.lod) / 8.0 < 0.01 {
                continue;
            }
            let patch = [in_patches.x as u32, in_patches.y as u32];
            let stride = 1u32 << picture.report.levels.log2_stride(node, patch);
            assert_eq!((lods[i], strides[i]), (f32::from(node.lod), stride as f32), "{camera}, pixel {i}");
            seen_lods.insert(node.lod);
            seen_strides.insert(stride);
        }
    }
    assert!(seen_lods.len() >= 4 && seen_strides.len() >= 3, "{seen_lods:?} {seen_strides:?}");
}

/// Elevation of the surface of a node at a position, metres, if all of its vertices are drawn.
fn surface_m(world: &World, node: NodeId, at: DVec2) -> f64 {
    let at = (at - node.origin_m(world.layout())) / world.layout().spacing_m(node.lod);
    let corner = at.floor().clamp(DVec2::ZERO, DVec2::splat(127.0));
    let (i, j) = (corner.x as u32, corner.y as u32);
    let DVec2 { x: u, y: v } = at - corner;
    let [sw, se, nw, ne] = [[i, j], [i + 1, j], [i, j + 1], [i + 1, j + 1]].map(|vertex| world.vertex_elevation_m(node, vertex));
    match (diagonal_rises(i as usize, j as usize), v > u, u + v > 1.0) {
        (true, false, _) => sw + u * (se - sw) + v * (ne - se),
        (true, true, _) => sw + v * (nw - sw) + u * (ne - nw),
        (false, _, false) => sw + u * (se - sw) + v * (nw - sw),
        (false, _, true) => ne + (1.0 - u) * (nw - ne) + (1.0 - v) * (se - ne),
    }
}

#[test]
fn the_ground_moves_by_at_most_the_geometry_error() {
    let mut renderer = second_renderer();
    const SIZE: [u32; 2] = [240, 135];
    let layout = *renderer.world().layout();
    for camera in ["cliff", "ground", "vista"] {
        let mut triangles_of_all = 0;
        let mut sky_of_all = Vec::new();
        for error_px in [0.0, 0.5, 2.0] {
            let request = RenderRequest::new(pose(&renderer, camera), SIZE).with(|r| {
                r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
                r.outputs.lit = false;
                r.geometry.error_px = error_px;
            });
            let frame = renderer.draw(&request).expect("draws");
            let depth =
                read_texture(gpu(), &frame.targets().geometry.depth_stencil, wgpu::TextureAspect::DepthOnly, 4).expect("the device works");
            let depth: Vec<f32> = bytemuck::pod_collect_to_vec(&depth);
            let (triangles, drawn) = (frame.report().triangles, frame.report().drawn.clone());
            let (view, world) = (renderer.view(&request), renderer.world());
            let on_screen = |place: DVec3| {
                let clip = view.clip_from_local * (place - view.pose.position + view.camera).extend(1.0);
                DVec2::new(0.5 * f64::from(SIZE[0]) * clip.x, 0.5 * f64::from(SIZE[1]) * clip.y) / clip.w
            };
            // For each pixel of terrain, the distance on the screen, in pixels, from the drawn surface to the surface with all vertices.
            let mut moved: Vec<f64> = (0..SIZE[0] * SIZE[1])
                .filter(|&pixel| depth[pixel as usize] > 0.0)
                .filter_map(|pixel| {
                    let place = oracle::place_at(&view, [pixel % SIZE[0], pixel / SIZE[0]], NEAR_M / f64::from(depth[pixel as usize]));
                    let node = (0..LODS).filter_map(|lod| layout.node_at(lod, place.x, place.y)).find(|node| drawn.contains(node))?;
                    let all_vertices = place.truncate().extend(surface_m(world, node, place.truncate()));
                    Some(on_screen(place).distance(on_screen(all_vertices)))
                })
                .collect();
            moved.sort_by(f64::total_cmp);
            let beyond = |limit: f64| moved.iter().filter(|px| **px > limit).count() as f64 / moved.len() as f64;
            let share = |percent: usize| moved[(moved.len() - 1) * percent / 100];
            let sky: Vec<bool> = depth.iter().map(|depth| *depth == 0.0).collect();
            if error_px == 0.0 {
                (triangles_of_all, sky_of_all) = (triangles, sky.clone());
            }
            let outline = sky.iter().zip(&sky_of_all).filter(|(a, b)| a != b).count() as f64 / sky.len() as f64;
            println!(
                "{camera}, {error_px} px: {triangles} triangles, moved by {:.3} (median), {:.3} (99 %), {:.3} (most), outline {outline:.5}",
                share(50),
                share(99),
                share(100)
            );
            // Where nodes of different LODs meet, a part of a patch is welded to the vertices of a coarser node, whose surface differs. So up to 1 %
            // of the pixels may exceed the limit. Positions are computed from pixels and from depths in f32, so they are off by up to 0.01 pixels.
            assert!(beyond(error_px + 0.01) < 0.01, "{camera}, {error_px} px: {}", beyond(error_px + 0.01));
            assert!(outline < 0.005, "{camera}, {error_px} px: {outline}");
            if error_px > 0.0 {
                assert!(triangles < triangles_of_all * 9 / 10, "{camera}, {error_px} px: {triangles} of {triangles_of_all}");
                // Negative control: the ground does move. At 1 % of the pixels, it moves by more than a tenth of the allowed error.
                assert!(share(99) > error_px / 10.0, "{camera}, {error_px} px: {}", share(99));
            }
        }
    }
}

#[test]
fn the_height_query_agrees_with_the_drawn_triangles() {
    const SIZE: [u32; 2] = [160, 90];
    let mut renderer = second_renderer();
    let (mut seen, mut wrong_without_levels) = (0, 0);
    for camera in ["cliff", "ground", "vista"] {
        for (vertex_stride, error_px, lod_bias) in [(1, 0.0, 0.0), (4, 0.0, 0.0), (1, 2.0, 0.0), (2, 1.0, 1.5)] {
            let request = RenderRequest::new(pose(&renderer, camera), SIZE).with(|r| {
                r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
                r.outputs.lit = false;
                (r.geometry.vertex_stride, r.geometry.error_px, r.geometry.lod_bias) = (vertex_stride, error_px, lod_bias);
            });
            let frame = renderer.draw(&request).expect("draws");
            let depth =
                read_texture(gpu(), &frame.targets().geometry.depth_stencil, wgpu::TextureAspect::DepthOnly, 4).expect("the device works");
            let depth: Vec<f32> = bytemuck::pod_collect_to_vec(&depth);
            let (drawn, levels) = (frame.report().drawn.clone(), Arc::clone(&frame.report().levels));
            let every_vertex = Levels::new(&drawn, 0, |_, _| 0);
            let (view, world) = (renderer.view(&request), Arc::clone(renderer.world()));
            let below = Surface { world: &world, drawn: &drawn, levels: &levels };
            let other = Surface { levels: &every_vertex, ..below };
            for pixel in (0..SIZE[0] * SIZE[1]).step_by(3).filter(|&pixel| depth[pixel as usize] > 0.0) {
                let [x, y] = [pixel % SIZE[0], pixel / SIZE[0]];
                let depth_m = NEAR_M / f64::from(depth[pixel as usize]);
                let place = oracle::place_at(&view, [x, y], depth_m);
                // Because of rounding, a visible point may lie off the plane of its triangle, and slightly outside the triangle. The tolerances are
                // those of the inspector. Distance from the plane: 2 mm plus 1/20 of a pixel. Horizontal distance from the triangle: 1 mm plus 1/50
                // of the step to the next pixel. The second tolerance is doubled, because distances along a slope are longer than horizontal ones.
                let [a, b, c] = below.triangle_at(place.truncate()).expect("ground is seen, so ground is drawn");
                let normal = (b - a).cross(c - a).normalize_or_zero();
                let (ray, pixel_m) = (view.ray(f64::from(x), f64::from(y)), depth_m * view.ray_dy.length());
                let step_m = pixel_m / (normal.dot(ray) / ray.length()).abs().max(1e-3);
                let tolerance_m = 2e-3 + 0.05 * pixel_m + 2.0 * (1e-3 + 0.02 * step_m);
                let off_m = normal.dot(place - a).abs();
                assert!(off_m <= tolerance_m, "{camera}, {vertex_stride}, {error_px} px, pixel {x} {y}: {off_m} of {tolerance_m} m");
                let height_m = below.height_m(place.x, place.y).expect("ground");
                assert!(((place.z - height_m) * normal.z).abs() <= tolerance_m, "{camera}: {height_m} m and not {} m", place.z);
                let other_m = other.height_m(place.x, place.y).expect("ground");
                seen += 1;
                wrong_without_levels += u32::from(((place.z - other_m) * normal.z).abs() > tolerance_m);
            }
            // The renderer answers for the nodes and levels that it would draw.
            let DVec3 { x, y, .. } = request.view.pose.position;
            let answer = renderer.drawn_ground_m(&request, x, y).expect("the request is valid");
            assert!(answer.is_some() && answer == below.height_m(x, y), "{camera}: {answer:?}");
        }
    }
    // Negative control: at more than a tenth of the points, the surface that has all vertices has a different height.
    assert!(seen > 30_000 && wrong_without_levels > seen / 10, "{wrong_without_levels} of {seen}");
}

/// A request for a picture straight down from 6 m above the ground at a position: about 10 m x 7 m of ground. North is at the top of the picture.
fn from_above(world: &World, x: f64, y: f64) -> RenderRequest {
    let position = DVec3::new(x, y, world.surface_height_m(x, y) + 6.0);
    let aovs = AovSet::from_names(&["position", "normal"]).expect("known layers");
    RenderRequest::new(Pose { position, yaw: 0.0, pitch: -FRAC_PI_2, fov: 60f64.to_radians() }, SIZE).with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
        // With the variance estimator, the layer `normal` shows the normal that the geometry pass stored.
        r.shading.estimator = Estimator::Variance;
        r.outputs.aovs = aovs;
    })
}

/// For each pixel of a picture from above: how far outside a rectangle around the origin its ray meets the ground, in pixels; negative = inside.
fn outside_px(renderer: &Renderer<'_>, request: &RenderRequest, half_extent: DVec2) -> Vec<f64> {
    let (view, eye) = (renderer.view(request), request.view.pose.position);
    let [width, height] = request.view.size;
    let pixel = |k: u32| {
        let ray = view.ray(f64::from(k % width), f64::from(k / width));
        // The ray descends 1 m per unit of t. The t at which it meets the ground is found by fixed-point iteration. Each step leaves at most 5/6 of
        // the error: the slope of the ground is below 0.8, and no ray moves sideways by more than 1.04 m per metre down.
        let step = |t: f64| (eye.z - renderer.ground_m(eye.x + ray.x * t, eye.y + ray.y * t)) / -ray.z;
        let t = (0..80).fold(6.0, |t, _| step(t));
        ((eye + ray * t).truncate().abs() - half_extent).max_element() / (view.ray_dx.length() * t)
    };
    (0..width * height).map(pixel).collect()
}

/// Number of pixels that show sky at least a pixel inside the rectangle, or ground at least a pixel outside.
fn wrong_side(picture: &Picture, outside_px: &[f64]) -> usize {
    terrain(picture).iter().zip(outside_px).filter(|(on, outside)| **on == (**outside > 0.0) && outside.abs() >= 1.0).count()
}

#[test]
fn the_ground_of_a_heightmap_is_drawn_to_the_edge_of_its_data() {
    let temp = Folder::new("edge");
    let scene = Scene { detail_size: 64, ..island(&temp) };
    let mut renderer = Renderer::new(gpu(), &scene, &|_| {}).expect("renders");
    let world = renderer.world().clone();
    let data = DVec2::from_array(world.extent_m()) / 2.0;
    assert!((data - DVec2::new(430.0, 320.35)).abs().max_element() < 1e-9 && world.layout().finest_lod == 3);
    // Where the ground would end if all its triangles had three vertices within the data.
    let last_vertices = (data / 4.0).floor() * 4.0;
    // A place on one edge, the corners, and the places where an edge meets the border of two nodes.
    let places = [[1.0, 0.3], [1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
    for place in places {
        let at = data * DVec2::from_array(place);
        let request = from_above(&world, at.x, at.y);
        let picture = renderer.render(&request).expect("renders");
        assert!(picture.report.drawn.iter().any(|node| node.lod == 3), "{place:?}");
        let on = terrain(&picture);
        assert!(on.iter().filter(|on| **on).count() > on.len() / 6 && on.iter().any(|on| !on), "{place:?}");
        assert_eq!(wrong_side(&picture, &outside_px(&renderer, &request, data)), 0, "{place:?}");
        // Negative control: the ground does not end at the last vertices.
        assert!(wrong_side(&picture, &outside_px(&renderer, &request, last_vertices)) > 20, "{place:?}");
        // The drawn ground is the ground of the reference. Positions are f32 and the slope is below 1, so the heights agree within 1 cm.
        let position = picture.vectors("position").expect("requested");
        for (p, _) in position.iter().zip(&on).filter(|(_, on)| **on) {
            let [x, y, z] = p.map(f64::from);
            assert!((z - world.surface_height_m(x, y)).abs() < 0.01, "{place:?}: {p:?}");
        }
    }

    // Checks the normals and triangles in the strip between the last vertices and the edge of the data. The strip is 2 m wide.
    let request = from_above(&world, data.x, 0.3 * data.y);
    let picture = renderer.render(&request).expect("renders");
    let (position, normal) = (picture.vectors("position").expect("requested"), picture.vectors("normal").expect("requested"));
    let mut angles = Vec::new();
    for ((p, n), _) in position.iter().zip(normal).zip(terrain(&picture)).filter(|((p, _), on)| *on && f64::from(p[0]) > last_vertices.x) {
        let (x, y) = (f64::from(p[0]).min(data.x - 0.01), f64::from(p[1]));
        let slope = |dx: f64, dy: f64| (world.surface_height_m(x + dx, y + dy) - world.surface_height_m(x - dx, y - dy)) / 0.002;
        let plane = DVec3::new(-slope(0.001, 0.0), -slope(0.0, 0.001), 1.0).normalize();
        angles.push(plane.angle_between(DVec3::from_array(n.map(f64::from))).to_degrees());
    }
    angles.sort_by(f64::total_cmp);
    // The slope there is about 30 degrees. Stored normals have an error of 1 or 2 degrees, and the slope changes by 6 degrees at the last vertices.
    // If the distance from the last vertices to the edge were taken as 4 m instead of 2 m, normals in the middle of the strip would be 8 degrees too
    // flat.
    assert!(angles.len() > 500 && angles[angles.len() / 2] < 5.0, "median of {}: {} degrees", angles.len(), angles[angles.len() / 2]);
    let request = request.with(|r| r.shading.estimator = Estimator::Fc5);
    let inside = [SIZE[0] / 2 - 4, SIZE[1] / 2];
    let pixel = oracle::inspect(&mut renderer, &request, inside).expect("inspects").expect("ground");
    assert!(pixel.position[0] > last_vertices.x && pixel.position[0] < data.x, "{:?}", pixel.position);
    let off = pixel.normal_error().expect("the reference has the triangle that was drawn");
    assert!(off < 2f64.to_radians(), "{off} radians");
}

#[test]
fn the_edge_of_the_data_has_no_cracks_where_lods_meet() {
    let temp = Folder::new("edge-lods");
    let scene = Scene { detail_size: 64, ..island(&temp) };
    let mut renderer = Renderer::new(gpu(), &scene, &|_| {}).expect("renders");
    let world = renderer.world().clone();
    let (layout, data) = (*world.layout(), DVec2::from_array(world.extent_m()) / 2.0);
    // Nodes are selected for a camera at a different position (frozen culling). In the first two cases, a border between two LODs crosses the edge of
    // the data in the middle of the picture. In the third case, the coarsest node is drawn alone.
    let eye = |x: f64, y: f64, yaw: f64| Pose {
        position: DVec3::new(x, y, world.surface_height_m(x, y) + 50.0),
        yaw,
        pitch: -0.1,
        fov: FRAC_PI_2,
    };
    let cases = [
        ([data.x, 0.0], eye(250.0, -230.0, 180f64.atan2(230.0)), 1.5, [3, 4]),
        ([0.0, -data.y], eye(-230.0, -250.0, 230f64.atan2(-70.0)), 1.5, [3, 4]),
        ([data.x, 0.0], eye(1200.0, 0.0, -FRAC_PI_2), 4.0, [5, 5]),
    ];
    for ([x, y], culled_from, lod_bias, lods) in cases {
        let request = from_above(&world, x, y).with(|r| {
            r.geometry.culled_from = Some(culled_from);
            r.geometry.lod_bias = lod_bias;
            // Ground that faces away from the other position is not culled, because it is seen from above.
            r.geometry.culls = Culls { back_faces: false, ..Culls::ALL };
        });
        let picture = renderer.render(&request).expect("renders");
        // The nodes on both sides of the border, within the data.
        let inwards = DVec2::new(x, y) * 0.99;
        let along = DVec2::new(y, x).abs().normalize() * 3.0;
        let node_at = |at: DVec2| picture.report.drawn.iter().copied().find(|node| layout.node_at(node.lod, at.x, at.y) == Some(*node));
        let found = [inwards - along, inwards + along].map(|at| node_at(at).map(|node| node.lod));
        let mut found = found.map(|lod| lod.expect("a node is drawn on each side"));
        found.sort_unstable();
        assert_eq!(found, lods, "at {x}, {y}");
        assert_eq!(wrong_side(&picture, &outside_px(&renderer, &request, data)), 0, "at {x}, {y}");
        // Negative control: the ground does not end at the last vertices inside the data.
        let spacing = layout.spacing_m(lods[1]);
        assert!(wrong_side(&picture, &outside_px(&renderer, &request, (data / spacing).floor() * spacing)) > 20, "at {x}, {y}");
    }
}

//! Tests of stitching. On a side where the neighbouring node is coarser, stitching moves (welds) the border vertices of a node to vertices that the
//! neighbour also has. The tests compare the functions of the vertex stage on the GPU with their reference, and check that the neighbour has the
//! vertices that the reference returns.

use std::collections::BTreeMap;

use glam::DVec2;
use kernels::frame::VariantChoice;
use kernels::geometry::{STITCH_WGSL, reference};
use kernels::gpu::read_texture;
use kernels::materials::Palette;
use kernels::probe::table;
use kernels::shared::flavour_weights::{self, FlavourParams};
use kernels::terrain::reference::{Ground, Spot};
use kernels::variant::{Flavour, Variant};
use kernels::view::normals::NormalEncoding;

use crate::fixtures::{gpu, request, second_renderer};
use crate::shading::{self, Seen};

/// Returns rows for the test. Each row contains the index of a vertex and the deltas of its node. A delta is the number of levels by which the
/// neighbour on one side is coarser; the deltas of the four sides are packed with 4 bits each. The rows contain every border vertex and some inner
/// vertices, and every delta from 0 to 5 on every side.
fn rows() -> Vec<([u32; 2], u32)> {
    let mut rows = Vec::new();
    for deltas in (0..6u32).flat_map(|d| [d, d << 4, d << 8, d << 12, d | d << 4 | d << 8 | d << 12, d | (5 - d) << 4]) {
        for i in 0..=128 {
            rows.extend([[i, 0], [i, 128], [0, i], [128, i], [i, 64], [i, 127 - i / 2]].map(|index| (index, deltas)));
        }
    }
    rows
}

/// Stitches all rows on the GPU, with the functions whose names begin with `prefix`, after `wgsl` was added to the shader.
fn on_gpu(wgsl: &str, prefix: &str) -> Vec<[u32; 2]> {
    let body = format!(
        "{wgsl}\nfn probe(row: array<f32, 3>) -> array<f32, 2> {{
    let kept = {prefix}_stitch(vec2<u32>(u32(row[0]), u32(row[1])), u32(row[2]));
    return array<f32, 2>(f32(kept.x), f32(kept.y));
}}"
    );
    let inputs: Vec<f32> = rows().iter().flat_map(|(i, d)| [i[0] as f32, i[1] as f32, *d as f32]).collect();
    let out = table::run(gpu(), &body, &inputs, 3, 2).expect("the probe runs");
    out.chunks_exact(2).map(|c| [c[0] as u32, c[1] as u32]).collect()
}

fn differences(found: &[[u32; 2]]) -> usize {
    found.iter().zip(rows()).filter(|(kept, (index, deltas))| **kept != reference::stitch(*index, *deltas)).count()
}

#[test]
fn stitching_equals_its_reference() {
    // The shader of a probe contains the text of the stage.
    assert_eq!(differences(&on_gpu("", "geometry")), 0);
    // Negative controls: a vertex halfway between two vertices of the neighbour moves to the upper one; the northern border uses the delta of the
    // southern neighbour.
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
            // If the relative distance to a border between flavours is below 1e-5, rounding decides the mask, so the masks of both sides are
            // accepted.
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
/// textures with 8 bits. The first two encodings round the shading normal to 8 + 8 bits, which are steps of about 0.012 radians.
const NORMAL_LIMITS: [f64; 3] = [0.01, 0.01, 0.005];

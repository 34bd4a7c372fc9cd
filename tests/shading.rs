//! Shading, terrain access and the virtual texture, compared with their references in f64: each flavour alone, and several together.
//!
//! The references get the depth and the two normals of the geometry pass. Everything after that they compute themselves: position, footprint, node, splat
//! texels, texture coordinates, filtering, blends and weights.

use std::collections::BTreeSet;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use glam::{DVec2, DVec3};
use half::f16;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::gpu::read_texture;
use kernels::materials::Palette;
use kernels::scene::Scene;
use kernels::shading::Estimator;
use kernels::shading::reference::{Pixel, Rules, Shaded, shade};
use kernels::shared::derivatives;
use kernels::terrain::reference::Ground;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::NEAR_M;
use kernels::virtual_texture;
use rayon::prelude::*;

use crate::fixtures::{gpu, request, small_scene};

/// A pixel of the G-buffer, and what the reference needs to shade it.
pub(crate) struct Seen {
    /// Index of the pixel, row by row from the top.
    pub(crate) index: usize,
    pub(crate) pixel: Pixel,
    shaded: Shaded,
}

/// Draws a frame, and reads what the stages wrote.
pub(crate) fn seen(renderer: &mut Renderer<'_>, request: &RenderRequest) -> (Vec<Seen>, Vec<kernels::world::NodeId>) {
    let half_world = DVec2::splat(renderer.world().layout().world_m() / 2.0);
    let frame = renderer.draw(request).expect("draws");
    let (gpu, view, targets) = (frame.renderer().gpu(), *frame.view(), frame.targets());
    let read = |texture, aspect, bytes| read_texture(gpu, texture, aspect, bytes).expect("the device works");
    let all = wgpu::TextureAspect::All;
    let halves = |texture| -> Vec<[f16; 4]> { bytemuck::pod_collect_to_vec(&read(texture, all, 8)) };
    let (albedo, normal) = (halves(&targets.shading.albedo), halves(&targets.shading.normal));
    let depth: Vec<f32> = bytemuck::pod_collect_to_vec(&read(&targets.geometry.depth_stencil, wgpu::TextureAspect::DepthOnly, 4));
    let (encoding, width) = (request.geometry.normals, request.view.size[0] as usize);
    let stored = read(&targets.geometry.normals, all, encoding.bytes());
    let drawn = frame.report().drawn.clone();
    let mut seen = Vec::new();
    for (index, &depth) in depth.iter().enumerate().filter(|(_, depth)| **depth > 0.0) {
        let (x, y) = ((index % width) as f64, (index / width) as f64);
        let [shading_normal, plane] = encoding.decode(&stored[index * encoding.bytes() as usize..][..encoding.bytes() as usize]);
        let ray = view.ray(x, y);
        let t = NEAR_M / f64::from(depth);
        let step = |ray_step: DVec3| DVec3::from_array(derivatives::on_plane(ray.to_array(), ray_step.to_array(), t, plane));
        let pixel = Pixel {
            position: view.pose.position + ray * t + half_world.extend(0.0),
            steps: [step(view.ray_dx), step(view.ray_dy)],
            normal: DVec3::from_array(shading_normal),
            distance_m: ray.length() * t,
        };
        let ([r, g, b, occlusion], [nx, ny, nz, smoothness]) = (albedo[index].map(f16::to_f64), normal[index].map(f16::to_f64));
        let shaded = Shaded { albedo: DVec3::new(r, g, b), normal: DVec3::new(nx, ny, nz), smoothness, occlusion };
        seen.push(Seen { index, pixel, shaded });
    }
    (seen, drawn)
}

/// Differences of albedo, normal (radians), smoothness and occlusion of one pixel.
fn differences(a: &Shaded, b: &Shaded) -> [f64; 4] {
    let angle = a.normal.cross(b.normal).length().atan2(a.normal.dot(b.normal));
    [(a.albedo - b.albedo).abs().max_element(), angle, (a.smoothness - b.smoothness).abs(), (a.occlusion - b.occlusion).abs()]
}

/// A quantile of each difference.
fn quantile(of: &[[f64; 4]], share: f64) -> [f64; 4] {
    std::array::from_fn(|k| {
        let mut values: Vec<f64> = of.iter().map(|differences| differences[k]).collect();
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share) as usize]
    })
}

/// How far the median and 95 % of the pixels may be off: albedo, normal (radians), smoothness, occlusion.
struct Limits {
    median: [f64; 4],
    most: [f64; 4],
}

/// A wrong input of the reference, by which a comparison is shown to notice a difference.
type Change = (&'static str, fn(&mut Pixel));

/// A variant to compare, with its negative controls.
struct Case {
    flavours: &'static [Flavour],
    two_tilings: bool,
    changes: &'static [Change],
}

impl Case {
    const fn of(flavours: &'static [Flavour], changes: &'static [Change]) -> Case {
        Case { flavours, two_tilings: false, changes }
    }
}

/// A renderer of the small scene with textures whose texels are as fine as those of pages: coarser textures would hide a shift by half a texel.
fn fine_renderer() -> MutexGuard<'static, Renderer<'static>> {
    static RENDERER: OnceLock<Mutex<Renderer<'static>>> = OnceLock::new();
    let make = || {
        let scene = Scene { detail_size: 256, ..small_scene() };
        Mutex::new(Renderer::new(gpu(), &scene, &|_| {}).expect("the scene renders"))
    };
    RENDERER.get_or_init(make).lock().unwrap_or_else(PoisonError::into_inner)
}

/// Compares variants with their references in one view of a camera, with this field of view.
fn compare(camera: &str, fov_deg: f64, limits: &Limits, cases: &[Case]) {
    let mut renderer = fine_renderer();
    let scene = renderer.scene().clone();
    let world = renderer.world().clone();
    let palette = Palette::build(&scene, world.layout().sector_m, |_| Ok(())).expect("procedural textures");
    let mut ground: Option<Ground<'_>> = None;
    for Case { flavours, two_tilings, changes } in cases {
        let variant = Variant::new(flavours.iter().fold(0, |mask, flavour| mask | flavour.bit())).expect("a set");
        let request = request(&renderer, camera).with(|r| {
            r.shading.variant = VariantChoice::Forced(variant);
            r.shading.estimator = Estimator::Exact;
            r.shading.two_tilings = *two_tilings;
            r.view.pose.fov = fov_deg.to_radians();
        });
        let (seen, nodes) = seen(&mut renderer, &request);
        let ground = ground.get_or_insert_with(|| Ground::new(&world, &palette, &nodes, scene.blend.height_sharpness));
        let rules = Rules { flavours: &scene.flavours, blend: &scene.blend, two_tilings: *two_tilings };
        // A negative control needs only some of the pixels.
        let off = |change: Option<fn(&mut Pixel)>| -> Vec<[f64; 4]> {
            let one = |seen: &Seen| {
                let mut pixel = seen.pixel;
                change.inspect(|change| change(&mut pixel));
                Some(differences(&shade(ground, rules, &pixel, variant)?, &seen.shaded))
            };
            seen.par_iter().step_by(if change.is_some() { 7 } else { 1 }).filter_map(one).collect()
        };
        let all = off(None);
        assert!(all.len() > 1000 && all.len() * 100 > seen.len() * 95, "{variant} at {camera}: {} of {} pixels", all.len(), seen.len());
        let (median, most) = (quantile(&all, 0.5), quantile(&all, 0.95));
        println!("{variant} at {camera}: {} pixels, median {median:.5?}, 95 % {most:.5?}, worst {:.3?}", all.len(), quantile(&all, 1.0));
        let within = |found: [f64; 4], limit: [f64; 4]| found.iter().zip(limit).all(|(found, limit)| *found <= limit);
        let agrees = |median: [f64; 4], most: [f64; 4]| within(median, limits.median) && within(most, limits.most);
        assert!(agrees(median, most), "{variant} at {camera}: median {median:?}, 95 % {most:?}");
        for (name, change) in *changes {
            let wrong = off(Some(*change));
            let (median, most) = (quantile(&wrong, 0.5), quantile(&wrong, 0.95));
            println!("    {name}: median {median:.5?}, 95 % {most:.5?}");
            assert!(!agrees(median, most), "{variant} at {camera}: {name} was not noticed");
        }
    }
}

/// Textures have 8 bits, and a software adapter rounds each of the three steps of trilinear filtering to 8 bits. So a filtered value is off by about one step
/// of 1/255, and by two or three in few pixels. A normal is the quotient of two filtered numbers.
const LIMITS: Limits = Limits { median: [0.004, 0.006, 0.003, 0.003], most: [0.008, 0.016, 0.006, 0.006] };

/// Moves a pixel by half a texel of the pages that it samples.
fn half_a_texel(pixel: &mut Pixel) {
    let level = virtual_texture::reference::level(pixel.steps, 0.0, 1.0);
    pixel.position.x += 0.5 / 256.0 * f64::from(1u32 << level);
}

/// Moves a pixel by half a pixel.
fn half_a_pixel(pixel: &mut Pixel) {
    pixel.position += 0.5 * pixel.steps[0];
}

#[test]
fn flavours_agree_with_their_references() {
    compare("ground", 55.0, &LIMITS, &[Case::of(&[Flavour::FarAtlas], &[("half a texel of the finest atlas", |p| p.position.x += 0.25)])]);
    let splat: &[Change] = &[("half a pixel", half_a_pixel), ("twice the footprint", |p| p.steps = p.steps.map(|step| step * 2.0))];
    let cases = [
        Case::of(&[Flavour::Splat], splat),
        Case { two_tilings: true, ..Case::of(&[Flavour::Splat], &[("twice as far", |p| p.distance_m *= 2.0)]) },
        Case::of(&[Flavour::NearCliff], &[("a less steep normal", |p| p.normal = p.normal.with_z(p.normal.z + 0.2).normalize())]),
        Case::of(&[Flavour::FarCliff], &[("1.2 times as far", |p| p.distance_m *= 1.2)]),
        Case::of(&[Flavour::FarAtlas, Flavour::NearCliff, Flavour::FarCliff, Flavour::Splat], &[("twice as far", |p| p.distance_m *= 2.0)]),
    ];
    compare("cliff", 30.0, &LIMITS, &cases);
}

#[test]
fn pages_agree_with_their_reference() {
    for fov_deg in [5.0, 55.0] {
        compare(
            "ground",
            fov_deg,
            &LIMITS,
            &[Case::of(&[Flavour::VirtualTexture], &[("half a texel", half_a_texel), ("half a pixel", half_a_pixel)])],
        );
    }
}

#[test]
fn pages_are_requested_where_pixels_sample_them() {
    for anisotropy in [1, 4] {
        let mut scene = small_scene();
        scene.blend.anisotropy = anisotropy;
        scene.blend.mip_bias = 0.5;
        let mut renderer = Renderer::new(gpu(), &scene, &|_| {}).expect("the scene renders");
        let mut all = 0;
        for fov_deg in [2.0f64, 15.0, 55.0] {
            // A size that is no multiple of a workgroup.
            let request = request(&renderer, "ground").with(|r| {
                r.view.size = [93, 61];
                r.view.pose.fov = fov_deg.to_radians();
                r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::VirtualTexture));
            });
            let (seen, _) = seen(&mut renderer, &request);
            let found = renderer.render(&request).expect("renders").report.pages;
            let mut expected: BTreeSet<(u32, [i64; 2])> = BTreeSet::new();
            for Seen { pixel, .. } in &seen {
                let texels = virtual_texture::reference::texels(pixel.steps, scene.blend.mip_bias, f64::from(anisotropy)).max(1.0).log2();
                // Both levels are requested where rounding might decide.
                for level in [texels - 0.001, texels + 0.001].map(|level| (level.max(0.0) as u32).min(virtual_texture::LEVELS - 1)) {
                    let page = (pixel.position.truncate() / f64::from(1u32 << level)).floor();
                    expected.insert((level, [page.x as i64, page.y as i64]));
                }
            }
            println!("anisotropy {anisotropy}, {fov_deg} degrees: {} pages expected, {} requested", expected.len(), found.wanted);
            for level in 0..virtual_texture::LEVELS {
                let expected = expected.iter().filter(|page| page.0 == level).count();
                // A pixel on the border of two pages may ask for either.
                let off = found.wanted_by_level[level as usize].abs_diff(expected);
                assert!(
                    off <= 1 + expected / 50,
                    "anisotropy {anisotropy}, level {level}: {} pages instead of {expected}",
                    found.wanted_by_level[level as usize]
                );
            }
            all += expected.len();
        }
        assert!(all > 30, "{all} pages tell little");
    }
}

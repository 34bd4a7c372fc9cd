//! Compares shading, terrain access and the virtual texture with their references in f64: each flavour alone, and several together.
//!
//! The references get the depth and the two normals of the geometry pass. They compute everything else themselves: position, footprint, node, splat
//! texels, texture coordinates, filtering, blends and weights.

use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use glam::{DVec2, DVec3};
use half::f16;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::gpu::read_texture;
use kernels::materials::Palette;
use kernels::scene::{Blend, Scene};
use kernels::shading::Estimator;
use kernels::shading::reference::{Pixel, Rules, Shaded, shade};
use kernels::shared::derivatives;
use kernels::shared::flavour_weights::{self, FlavourParams};
use kernels::terrain::reference::Ground;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::NEAR_M;
use kernels::virtual_texture;
use rayon::prelude::*;

use crate::fixtures::{gpu, request, second_renderer, small_scene};

/// A pixel of the G-buffer, and what the reference needs to shade it.
pub(crate) struct Seen {
    /// Index of the pixel, row by row from the top.
    pub(crate) index: usize,
    pub(crate) pixel: Pixel,
    shaded: Shaded,
}

/// Draws a frame and reads its G-buffer and its shaded pixels. Returns the terrain pixels and the drawn nodes.
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

/// Returns a quantile of each of the four differences. `share` = share of the pixels below the quantile.
fn quantile(of: &[[f64; 4]], share: f64) -> [f64; 4] {
    std::array::from_fn(|k| {
        let mut values: Vec<f64> = of.iter().map(|differences| differences[k]).collect();
        values.sort_by(f64::total_cmp);
        values[((values.len() - 1) as f64 * share) as usize]
    })
}

/// Limits of the differences in albedo, normal (radians), smoothness and occlusion: of their medians, and of their 95 % quantiles (`most`).
struct Limits {
    median: [f64; 4],
    most: [f64; 4],
}

/// A negative control: its name, and a change of the reference's input that the comparison must notice.
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

/// A renderer of the small scene, but with detail textures of 256 texels per side. Coarser textures would hide a shift by half a texel of a
/// virtual-texture page.
fn fine_renderer() -> MutexGuard<'static, Renderer<'static>> {
    static RENDERER: OnceLock<Mutex<Renderer<'static>>> = OnceLock::new();
    let make = || {
        let mut scene = Scene { detail_size: 256, ..small_scene() };
        // Steep bumps reveal errors in the conversion of a gradient to a normal. A small gradient is nearly equal to the x and y of its normal, so
        // such errors would have almost no effect.
        scene.materials.iter_mut().for_each(|material| material.normal_strength *= 4.0);
        Mutex::new(Renderer::new(gpu(), &scene, &|_| {}).expect("the scene renders"))
    };
    RENDERER.get_or_init(make).lock().unwrap_or_else(PoisonError::into_inner)
}

/// Compares variants with their references, in the view of a camera whose field of view is replaced by `fov_deg`.
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

/// Textures have 8 bits, and a software adapter rounds each of the three steps of trilinear filtering to 8 bits. So the error of a filtered value is
/// about one step of 1/255, and in a few pixels two or three steps. A normal is the quotient of two filtered numbers and is computed with four times
/// the usual strength, so its limit is larger.
const LIMITS: Limits = Limits { median: [0.004, 0.016, 0.003, 0.003], most: [0.008, 0.04, 0.006, 0.006] };

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

/// A page: its level, and its place among the pages of this level, counted from the south-west corner of the world.
type Page = (u32, [i64; 2]);

/// The pages that a frame requests according to the reference.
#[derive(Default)]
struct Wanted {
    certain: BTreeSet<Page>,
    /// The certain pages, and pages that the rounding of f32 may add.
    possible: BTreeSet<Page>,
}

impl Wanted {
    /// Adds the pages of a pixel. The reference and the frame may differ by `ROUNDING` levels, and by `ROUNDING_M` metres in position.
    fn add(&mut self, pixel: &Pixel, blend: &Blend, anisotropy: f64) {
        const ROUNDING: f64 = 2e-5;
        const ROUNDING_M: f64 = 1e-3;
        let texels = virtual_texture::reference::texels(pixel.steps, blend.mip_bias, anisotropy).max(1.0).log2();
        // If the level of a pixel, before it is rounded down, is within 0.001 of the border between two levels, a frame requests the pages of both.
        let levels = |off: f64| [off - 0.001, off + 0.001].map(|off| ((texels + off).max(0.0) as u32).min(virtual_texture::LEVELS - 1));
        let pages = |off: f64, off_m: [f64; 2]| {
            levels(off).map(|level| {
                let page = ((pixel.position.truncate() + DVec2::from_array(off_m)) / f64::from(1u32 << level)).floor();
                (level, [page.x as i64, page.y as i64])
            })
        };
        let corners = [-ROUNDING_M, ROUNDING_M].into_iter().flat_map(|x| [-ROUNDING_M, ROUNDING_M].map(|y| [x, y]));
        let all: Vec<_> = corners.flat_map(|corner| [-ROUNDING, ROUNDING].map(|off| pages(off, corner))).collect();
        self.certain.extend(all[0].iter().filter(|page| all.iter().all(|pages| pages.contains(page))));
        self.possible.extend(all.iter().flatten());
    }

    /// Checks for each level the number of pages that a frame requested. `found` = these numbers, the finest level first.
    fn check(&self, found: &[usize], what: &str) {
        for (level, found) in (0..).zip(found) {
            let [least, most] = [&self.certain, &self.possible].map(|pages| pages.iter().filter(|page| page.0 == level).count());
            assert!((least..=most).contains(found), "{what}, level {level}: {found} pages instead of {least} to {most}");
        }
        let [certain, possible] = [self.certain.len(), self.possible.len()];
        assert!(possible <= certain + 4 + certain / 10, "{what}: only {certain} of {possible} pages are certain");
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
        for (camera, fov_deg, variant) in [
            ("ground", 2.0f64, VariantChoice::Forced(Variant::only(Flavour::VirtualTexture))),
            ("ground", 15.0, VariantChoice::Forced(Variant::only(Flavour::VirtualTexture))),
            ("ground", 55.0, VariantChoice::Forced(Variant::only(Flavour::VirtualTexture))),
            ("ground", 90.0, VariantChoice::Auto),
        ] {
            // A size that is not a multiple of the workgroup size.
            let request = request(&renderer, camera).with(|r| {
                r.view.size = [93, 61];
                r.view.pose.fov = fov_deg.to_radians();
                r.shading.variant = variant;
            });
            let (seen, _) = seen(&mut renderer, &request);
            let found = renderer.render(&request).expect("renders").report.pages;
            let params = FlavourParams::new(&scene.flavours);
            let mut expected = Wanted::default();
            let mut without = 0;
            for Seen { pixel, .. } in &seen {
                let weights = |distance_m| flavour_weights::weights(distance_m, pixel.normal.z, &params)[Flavour::VirtualTexture.index()];
                // With the automatic choice, a pixel samples pages only if the virtual texture has a weight.
                let sure = [0.9999, 1.0001].map(|factor| weights(pixel.distance_m * factor) > 0.0);
                if variant == VariantChoice::Auto && sure != [true; 2] {
                    without += 1;
                    if sure != [false; 2] {
                        let mut maybe = Wanted::default();
                        maybe.add(pixel, &scene.blend, f64::from(anisotropy));
                        expected.possible.extend(maybe.possible);
                    }
                    continue;
                }
                expected.add(pixel, &scene.blend, f64::from(anisotropy));
            }
            let what = format!("anisotropy {anisotropy}, {fov_deg} degrees");
            println!(
                "{what}: {} to {} pages, {} requested, {without} pixels without",
                expected.certain.len(),
                expected.possible.len(),
                found.wanted
            );
            expected.check(&found.wanted_by_level, &what);
            assert_eq!(without > seen.len() / 10, variant == VariantChoice::Auto, "{what}: {without} of {}", seen.len());
            all += expected.certain.len();
        }
        assert!(all > 30, "only {all} pages are certain");
    }
}

#[test]
fn both_levels_are_requested_within_a_thousandth_of_their_border() {
    // The picture has one pixel, and the camera looks straight down. So the height of the camera determines the level, and this pixel alone
    // determines the requested pages.
    let mut renderer = second_renderer();
    let blend = renderer.scene().blend.clone();
    let down = request(&renderer, "ground").with(|r| {
        r.view.size = [1, 1];
        r.view.pose.fov = 0.02f64.to_radians();
        r.view.pose.pitch = -FRAC_PI_2;
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::VirtualTexture));
    });
    let ground = renderer.ground_m(down.view.pose.position.x, down.view.pose.position.y);
    for (border, off, levels) in [
        (1.0, -0.003, [true, false, false]),
        (1.0, -0.0005, [true, true, false]),
        (1.0, 0.0005, [true, true, false]),
        (1.0, 0.003, [false, true, false]),
        (2.0, -0.0005, [false, true, true]),
        (0.0, 0.0005, [true, false, false]),
        (0.0, -0.0005, [true, false, false]),
    ] {
        let mut above_m = 20.0;
        let texels = loop {
            let request = down.with(|r| r.view.pose.position.z = ground + above_m);
            let (seen, _) = seen(&mut renderer, &request);
            let [Seen { pixel, .. }] = &seen[..] else { panic!("one pixel of terrain") };
            let texels = virtual_texture::reference::texels(pixel.steps, blend.mip_bias, 1.0).log2();
            if (texels - border - off).abs() < 5e-5 {
                let pages = renderer.render(&request).expect("renders").report.pages;
                let found: [bool; 3] = std::array::from_fn(|level| pages.wanted_by_level[level] == 1);
                assert_eq!((found, pages.wanted), (levels, levels.iter().filter(|level| **level).count()), "{texels} at {above_m} m");
                break texels;
            }
            above_m *= (border + off - texels).exp2();
            assert!(above_m.is_finite() && above_m > 1e-3, "{above_m} m");
        };
        println!("{texels}: {levels:?}");
    }
}

//! Tests of composition: pictures that are composed from pictures of single flavours (shading methods) are compared with the pictures of the
//! variants' own shaders. Tests of motion links: the link of a pixel must lead to the pixel of an earlier frame that shows the same point of the
//! surface. Also tests the sample positions of FlipQuad, and that pictures do not depend on the size of tiles and depend little on the encoding of
//! normals.

use kernels::composition::{CompositionStream, Destination, Layers};
use kernels::display::reference::tone_map;
use kernels::display::{Exposure, ToneCurve};
use kernels::frame::picture::AovSet;
use kernels::frame::{Renderer, RendererOptions, VariantChoice};
use kernels::metrics::{Track, read_signal};
use kernels::motion::{LAGS, NO_LINK};
use kernels::shared::flavour_weights::{self, FlavourParams};
use kernels::shared::motion::{Past, expected_distance, in_quarter, past_ray, reproject};
use kernels::shared::noise::NoiseKind;
use kernels::shared::signal::{self, Signal};
use kernels::temporal::SamplePattern;
use kernels::variant::{Flavour, Variant};
use kernels::view::normals::NormalEncoding;

use crate::fixtures::{SIZE, gpu, pose, renderer, request, second_renderer, small_scene, terrain};
use crate::shading;

const PIXELS: u32 = SIZE[0] * SIZE[1];
/// Largest accepted difference, in display values, between a lit picture that is composed from layers and the lit picture of the variant's own
/// shader: a quarter of the step of an 8-bit code. Measured: 0.0006.
const LIT: f64 = 0.25 / 255.0;

fn all_flavours() -> Variant {
    Variant::new(31).expect("a variant")
}

#[test]
fn every_variant_composed_equals_its_own_shader() {
    let mut renderer = renderer();
    let mut base = request(&renderer, "cliff");
    base.outputs.aovs = AovSet::from_names(&["albedo", "fetches", "choice"]).expect("known layers");
    let layers = Layers::new(gpu(), SIZE);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu().buffer("composed", usage, u64::from(PIXELS) * 8);
    renderer.draw_flavours(&base, all_flavours(), &layers).expect("draws");
    let mut previous: Option<Vec<[u32; 2]>> = None;
    let mut previous_lit: Option<Vec<[u32; 2]>> = None;
    for variant in Variant::all().map(Some).chain([None]) {
        let stream = renderer.composition().stream(variant);
        renderer.drawn_as(&base).expect("drawn").compose(&layers, &[Destination { stream, signal: &buffer, offset: 0 }]).expect("composes");
        let composed = read_signal(gpu(), &buffer, 0, PIXELS).expect("the device works");
        let choice = variant.map_or(VariantChoice::Auto, VariantChoice::Forced);
        let own = renderer.render(&base.with(|r| r.shading.variant = choice)).expect("renders");
        let name = variant.map_or_else(|| "auto".to_owned(), |v| v.to_string());
        let (albedo, fetches) = (own.vectors("albedo").expect("requested"), own.values("fetches").expect("requested"));
        let choices = own.values("choice").expect("requested");
        let differs = |composed: &[[u32; 2]]| {
            let mut worst = 0.0f64;
            for ((found, own), on) in composed.iter().zip(albedo).zip(terrain(&own)) {
                assert_eq!(signal::is_terrain(*found), on, "{name}");
                for (c, o) in signal::colour(*found).into_iter().zip(own) {
                    // The difference in ulp of f16. The tolerance is 4 ulp: 2 because the composed value is rounded to f16 twice (in the layer and in
                    // the sum) instead of once, and 2 because different shaders may round differently.
                    worst = worst.max(f64::from((c - o).abs()) / (f64::from(o.abs()).max(1.0 / 1024.0) / 2048.0));
                }
            }
            worst
        };
        let worst = differs(&composed);
        assert!(worst <= 4.0, "the composed picture of {name} differs from that of its own shader by {worst} ulp");
        for (i, found) in composed.iter().enumerate() {
            assert_eq!(signal::fetches(*found), fetches[i] as u32, "{name}: fetches of pixel {i}");
            assert_eq!(signal::choice(*found), choices[i] as u32, "{name}: choice of pixel {i}");
        }
        let lit = [Destination { stream: stream.of(Signal::Lit), signal: &buffer, offset: 0 }];
        renderer.drawn_as(&base).expect("drawn").compose(&layers, &lit).expect("composes");
        let lit = read_signal(gpu(), &buffer, 0, PIXELS).expect("the device works");
        let exposure = base.stages.display;
        let differs_lit = |lit: &[[u32; 2]]| {
            let pixels = lit.iter().zip(&own.hdr).filter(|(found, _)| signal::is_terrain(**found));
            let of_pixel = |(found, hdr): (&[u32; 2], &[f32; 4])| {
                let expected = tone_map([hdr[0], hdr[1], hdr[2]].map(f64::from), exposure);
                signal::colour(*found).into_iter().zip(expected).map(|(c, e)| (f64::from(c) - e).abs()).fold(0.0, f64::max)
            };
            pixels.map(of_pixel).fold(0.0, f64::max)
        };
        let worst = differs_lit(&lit);
        // Composition rounds each component of the G-buffer to f16 once more than the variant's own shader. A variant of a single flavour is an
        // exception: its G-buffers are equal, and only the display values are rounded to f16. Below 1, this rounding error is at most 2^-12. The
        // tolerance is twice as large, because the shaders compute in f32.
        let tolerance = if variant.is_some_and(|v| v.flavours().count() == 1) { 2.0 * 2f64.powi(-12) } else { LIT };
        assert!(worst <= tolerance, "the lit picture of {name} differs from that of its own shader by {worst}");
        if let Some(previous) = previous_lit.replace(lit) {
            assert!(differs_lit(&previous) > LIT, "{name} looks like its predecessor when lit");
        }
        // Negative control: the picture of the previous variant must differ.
        if let Some(previous) = previous.replace(composed) {
            assert!(differs(&previous) > 4.0, "{name} looks like its predecessor");
        }
    }
}

#[test]
fn lit_pictures_are_clipped_at_white_and_follow_the_exposure() {
    let mut renderer = renderer();
    let dark = request(&renderer, "cliff");
    let bright = dark.with(|r| r.stages.display = Exposure { exposure: 6.0, tone_curve: ToneCurve::Clip });
    let layers = Layers::new(gpu(), SIZE);
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu().buffer("composed", usage, u64::from(PIXELS) * 8);
    let flavour = Variant::only(Flavour::FarAtlas);
    let mut largest = [dark, bright].map(|request| {
        renderer.draw_flavours(&request, flavour, &layers).expect("draws");
        let stream = renderer.composition().stream(Some(flavour)).of(Signal::Lit);
        let to = [Destination { stream, signal: &buffer, offset: 0 }];
        renderer.drawn_as(&request).expect("drawn").compose(&layers, &to).expect("composes");
        let lit = read_signal(gpu(), &buffer, 0, PIXELS).expect("the device works");
        let on = lit.into_iter().filter(|s| signal::is_terrain(*s)).flat_map(signal::colour);
        let mut values: Vec<f32> = on.collect();
        values.sort_by(f32::total_cmp);
        (values[values.len() / 2], values[values.len() - 1])
    });
    // White is encoded as 1.055 - 0.055, which may exceed 1 by a rounding error of f32. The conversion to f16 may round this up to the next number,
    // 1 + 2^-10. So 2^-10 is subtracted from the largest values before they are compared with 1.
    largest.iter_mut().for_each(|(_, most)| *most -= 2f32.powi(-10));
    assert!(largest[1].1 <= 1.0 && largest[1].1 > 0.99, "six stops brighter, some pixels are white and none is brighter: {largest:?}");
    assert!(largest[1].0 > 1.3 * largest[0].0, "{largest:?}");
}

#[test]
fn links_lead_to_the_same_surface_point() {
    let mut renderer = second_renderer();
    let base = request(&renderer, "ground")
        .with(|r| r.outputs.aovs = AovSet::from_names(&["position", "depth", "ddx", "ddy"]).expect("known layers"));
    let layers = Layers::new(gpu(), SIZE);
    let mut meter = renderer.meter(SIZE, &[Track::default()], None).expect("the passes compile");
    let right = pose(&renderer, "ground").axes()[0];
    let mut positions = Vec::new();
    let mut footprints = Vec::new();
    let mut views = Vec::new();
    // The camera stands still for two frames, then moves 7 cm to the right in each frame, which is a few pixels on the ground close to the camera.
    let steps = [0.0, 0.0, 0.07, 0.14, 0.21, 0.28];
    let flavour = Variant::new(2).expect("a variant");
    for (index, step) in steps.into_iter().enumerate() {
        let mut request = base;
        request.view.pose.position += right * step;
        request.shading.variant = VariantChoice::Forced(flavour);
        let picture = renderer.render(&request).expect("renders");
        renderer.draw_flavours(&request, flavour, &layers).expect("draws");
        let (sums, _) = renderer.drawn_as(&request).expect("drawn").measure(&layers, &mut meter, &[Some(flavour)]).expect("measures");
        positions.push(picture.vectors("position").expect("requested").to_vec());
        let (ddx, ddy) = (picture.vectors("ddx").expect("requested"), picture.vectors("ddy").expect("requested"));
        let length = |v: &[f32; 3]| v.iter().map(|x| x * x).sum::<f32>().sqrt();
        footprints.push(ddx.iter().zip(ddy).map(|(x, y)| length(x) + length(y)).collect::<Vec<_>>());
        views.push(renderer.view(&request));
        let bytes = kernels::gpu::read_buffer(gpu(), &meter.motion.links, u64::from(PIXELS) * LAGS as u64 * 4).expect("the device works");
        let links: Vec<u32> = bytemuck::pod_collect_to_vec(&bytes);
        let depth = picture.values("depth").expect("requested");
        for lag in 1..=index.min(LAGS) {
            let (mut on, mut linked, mut moved) = (0, 0, 0);
            let past = Past::between(&views[index], &views[index - lag]);
            for at in 0..PIXELS as usize {
                let pixel = [at as u32 % SIZE[0], at as u32 / SIZE[0]];
                if depth[at] <= 0.0 || (lag > 1 && !in_quarter(pixel[1], index as u32 % 4)) {
                    continue;
                }
                on += 1;
                let link = links[(lag - 1) * PIXELS as usize + at];
                if link == NO_LINK {
                    continue;
                }
                linked += 1;
                moved += usize::from(link as usize != at);
                let (here, there) = (positions[index][at], positions[index - lag][link as usize]);
                let apart = (0..3).map(|k| (here[k] - there[k]).powi(2)).sum::<f32>().sqrt();
                // A link leads to the pixel whose centre is nearest to the point. On a flat triangle, the distance to this centre is at most half of
                // ddx plus half of ddy, the steps to the neighbouring pixels. The tolerance is 0.75 of the sum of their lengths, because the ground
                // is not flat. A further 1 cm allows for world positions of 10^3 m in f32.
                let reach = 0.75 * footprints[index - lag][link as usize].max(footprints[index][at]) + 0.01;
                assert!(apart <= reach, "frame {index}, lag {lag}, pixel {at}: {apart} m apart, reach {reach}");
                // The reference in f64 must give the same pixel, except for points within a thousandth of a pixel of a border.
                let [x, y] = [at as f64 % f64::from(SIZE[0]), (at as f64 / f64::from(SIZE[0])).floor()];
                let point = (views[index].ray(x, y) * f64::from(depth[at])).to_array();
                let [px, py, _] = reproject(point, &past);
                let border = [px, py].iter().any(|p| ((p - 0.5).rem_euclid(1.0) - 0.5).abs() > 0.499);
                let nearest = (py + 0.5).floor() * f64::from(SIZE[0]) + (px + 0.5).floor();
                assert!(border || nearest == f64::from(link), "frame {index}, lag {lag}, pixel {at}: {px} {py}, linked to {link}");
            }
            assert_eq!((sums[0].lags[lag - 1].terrain, sums[0].lags[lag - 1].linked), (on as u64, linked as u64));
            let all = depth.iter().filter(|d| **d > 0.0).count();
            assert!(on > all / 5, "frame {index}, lag {lag}: {on} of {all} followed");
            assert!(linked * 10 > on * 8, "frame {index}, lag {lag}: {linked} of {on} linked");
            if steps[index] == steps[index - lag] {
                assert_eq!((linked, moved, sums[0].lags[lag - 1].difference), (on, 0, 0.0), "standing still");
            } else {
                assert!(moved * 4 > linked, "frame {index}, lag {lag}: only {moved} of {linked} moved");
            }
        }
    }
}

#[test]
fn reprojection_inverts_rays_also_a_thousand_kilometres_out() {
    use glam::DVec3;
    use kernels::view::camera::{Pose, View};
    for origin in [DVec3::ZERO, DVec3::new(1.0e6, -9.0e5, 2000.0)] {
        let pose = |p: DVec3, yaw: f64| Pose { position: origin + p, yaw, pitch: -0.3, fov: 0.9 };
        let view = |p, yaw| View::new(pose(p, yaw), [320, 180], [0.2, -0.3], 64.0, 10_240.0);
        let (now, before) = (view(DVec3::new(1.0, 2.0, 3.0), 0.7), view(DVec3::new(1.5, 1.8, 3.1), 0.72));
        let past = Past::between(&now, &before);
        let single = past.cast::<f32>();
        for (x, y, distance) in [(0.0, 0.0, 5.0), (200.0, 17.0, 900.0), (319.0, 179.0, 0.9)] {
            // A point on the ray of a pixel of the earlier frame must be reprojected to this pixel.
            let point = before.ray(x, y) * distance + (before.pose.position - now.pose.position);
            let [px, py, d] = reproject(point.to_array(), &past);
            assert!((px - x).abs() + (py - y).abs() + (d - distance).abs() < 1e-8, "{px} {py} {d}");
            let ray = past_ray(&past, [x, y]);
            assert!((DVec3::from_array(ray) - before.ray(x, y)).length() < 1e-12);
            let normal = [0.3, -0.2, 0.9];
            let expected = expected_distance(point.to_array(), &past, ray, normal);
            assert!((expected - distance).abs() < 1e-9 * distance);
            // Positions in f32 are relative to the eye, so they are as precise 1000 km from the origin as at the origin. About 8 operations, each
            // with a relative error of 2^-24, change a pixel coordinate of up to 320 by 1.5e-4. The tolerance of 1e-3 leaves a margin.
            let [sx, sy, _] = reproject(point.as_vec3().to_array(), &single);
            assert!((f64::from(sx) - x).abs() + (f64::from(sy) - y).abs() < 1e-3, "{sx} {sy}");
        }
        // A point behind the camera and a point that is not a number have no pixel.
        assert_eq!(reproject((-before.ray(5.0, 5.0)).to_array(), &past)[2], 0.0);
        assert_eq!(reproject([f64::NAN, 0.0, 0.0], &past), [-1e9, -1e9, 0.0]);
    }
}

#[test]
fn flipquad_shades_points_on_the_edges_with_the_derivatives_of_the_centre() {
    let mut renderer = second_renderer();
    let base =
        request(&renderer, "ground").with(|r| r.outputs.aovs = AovSet::from_names(&["position", "ddx", "ddy"]).expect("known layers"));
    let flavour = VariantChoice::Forced(Variant::new(2).expect("a variant"));
    let [centre, left, top] = [SamplePattern::Centre, SamplePattern::LeftEdges, SamplePattern::TopEdges].map(|sample_pattern| {
        renderer
            .render(&base.with(|r| {
                r.shading.sample_pattern = sample_pattern;
                r.shading.variant = flavour;
            }))
            .expect("renders")
    });
    let vectors = |p: &kernels::frame::picture::Picture, n: &str| p.vectors(n).expect("requested").to_vec();
    let (mut checked, mut wrong) = (0, 0);
    for (picture, pattern) in [(&left, SamplePattern::LeftEdges), (&top, SamplePattern::TopEdges)] {
        let (at, ddx, ddy) = (vectors(&centre, "position"), vectors(&centre, "ddx"), vectors(&centre, "ddy"));
        let (moved, moved_x) = (vectors(picture, "position"), vectors(picture, "ddx"));
        for i in (0..PIXELS as usize).filter(|&i| centre.hdr[i][3] > 0.0 && at[i][1] < -162.0) {
            let pixel = [i as u32 % SIZE[0], i as u32 / SIZE[0]];
            let offset = pattern.offset(pixel).map(|o| o as f32);
            let size: f32 = ddx[i].iter().chain(&ddy[i]).map(|v| v * v).sum::<f32>().sqrt();
            // Only pixels with small derivatives are checked. On ground seen at grazing angles, the step from pixel to pixel changes by more than the
            // tolerance.
            if size > 0.6 {
                continue;
            }
            let off = (0..3).map(|k| (moved[i][k] - at[i][k] - ddx[i][k] * offset[0] - ddy[i][k] * offset[1]).powi(2)).sum::<f32>().sqrt();
            let turned =
                (0..3).map(|k| (moved[i][k] - at[i][k] + ddx[i][k] * offset[0] + ddy[i][k] * offset[1]).powi(2)).sum::<f32>().sqrt();
            // The tolerance has two parts. Because of perspective, a step of half a pixel differs from the derivative by a share of the step, for
            // which 0.1 is accepted. World positions in f32 have an error of 1e-4 m, for which 1e-3 m is accepted.
            let close = 0.1 * size + 1e-3;
            checked += usize::from(off <= close);
            wrong += usize::from(turned <= close);
            let change = (0..3).map(|k| (moved_x[i][k] - ddx[i][k]).powi(2)).sum::<f32>().sqrt();
            assert!(change <= 0.1 * size, "pixel {i}: derivative changes by {change} of {size}");
        }
    }
    assert!(checked > 500, "only {checked} samples lie on the expected edge");
    // Negative control: fewer than a tenth as many samples may lie on the opposite edge of their pixel.
    assert!(wrong * 10 < checked, "{wrong} of {checked} also fit the opposite edge");
}

#[test]
fn pictures_do_not_depend_on_the_tiles_and_hardly_on_the_normals_codes() {
    let scene = small_scene();
    let with = |options: RendererOptions| Renderer::with(gpu(), &scene, options, &|_| {}).expect("the small scene renders");
    let albedo = |renderer: &mut Renderer<'_>, variant: VariantChoice, noise: NoiseKind, normals: NormalEncoding| {
        // This test does not use the fetches. It requests them so that it uses the same shaders as the test of all variants. Both tests share a
        // renderer, so these shaders are compiled only once.
        let aovs = AovSet::from_names(&["albedo", "fetches"]).expect("known layers");
        let request = request(renderer, "cliff").with(|r| {
            r.outputs.aovs = aovs;
            r.shading.variant = variant;
            r.shading.noise = noise;
            r.geometry.normals = normals;
        });
        let picture = renderer.render(&request).expect("renders");
        let tiles = picture.report.tiles.clone();
        (picture.vectors("albedo").expect("requested").to_vec(), tiles, terrain(&picture))
    };
    let automatic =
        |renderer: &mut Renderer<'_>| albedo(renderer, VariantChoice::Auto, NoiseKind::HashedIsotropic, NormalEncoding::Octahedral);
    // The encoding of normals also changes the derivatives. White noise in screen space does not depend on derivatives, so the random numbers are
    // equal for all encodings. The generic kernel is used, because then only one shader has to be compiled.
    let generic = |renderer: &mut Renderer<'_>, normals| albedo(renderer, VariantChoice::GenericAuto, NoiseKind::WhiteScreen, normals);
    let tiled = |tile: u32| automatic(&mut with(RendererOptions { tile, ..RendererOptions::default() }));
    let others = [4, 16].map(|tile| (tile, tiled(tile)));
    // The renderer that is shared with other tests is locked last, because it may be in use.
    let mut usual = renderer();
    let (eight, tiles, _) = automatic(&mut usual);
    let (codes, _, on) = generic(&mut usual, NormalEncoding::Octahedral);
    let exact = generic(&mut usual, NormalEncoding::Exact);
    drop(usual);
    for (tile, (other, counts, _)) in others {
        // With a different size of tiles, a pixel may be shaded by the pipeline of a different variant. That pipeline does the same arithmetic, but
        // may round differently. The tolerance is 2 ulp of f16.
        let close =
            |(a, b): (&[f32; 3], &[f32; 3])| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 2.0 * a.abs().max(b.abs()) / 2048.0 + 1e-6);
        let wrong = eight.iter().zip(&other).filter(|pair| !close((pair.0, pair.1))).count();
        assert_eq!(wrong, 0, "tiles of {tile} pixels shade {wrong} pixels differently");
        // A picture has more tiles of 4 x 4 pixels and fewer tiles of 16 x 16 pixels than tiles of 8 x 8 pixels.
        assert_eq!(counts[0] > tiles[0], tile < 8, "{} tiles of {tile}, {} of 8", counts[0], tiles[0]);
    }
    assert!(Renderer::with(gpu(), &scene, RendererOptions { tile: 5, ..RendererOptions::default() }, &|_| {}).is_err());
    let rms = |a: &[[f32; 3]]| {
        let all: Vec<f64> = codes.iter().zip(a).zip(&on).filter(|(_, on)| **on).map(|((a, b), _)| f64::from(a[1] - b[1]).powi(2)).collect();
        (all.iter().sum::<f64>() / all.len() as f64).sqrt()
    };
    let change = rms(&exact.0);
    // The encoding with 8 bits per coordinate changes normals by up to 0.64 degrees. The picture must change, but only a little: `rms` is the root
    // mean square of the change of green over the terrain.
    assert!(change > 0.0 && change < 0.02, "exact normals change albedo by {change}");
}

#[test]
fn streams_are_composed_together_from_weights_of_their_own() {
    // A size that is not a multiple of the workgroup size.
    let size = [93, 61];
    let pixels = size[0] * size[1];
    let mut renderer = renderer();
    let base = request(&renderer, "cliff").with(|r| {
        r.view.size = size;
        r.outputs.aovs = AovSet::from_names(&["albedo", "fetches"]).expect("known layers");
    });
    // For each flavour, the picture that the shader of this flavour alone draws.
    let own: Vec<_> = Flavour::ALL
        .into_iter()
        .map(|flavour| renderer.render(&base.with(|r| r.shading.variant = VariantChoice::Forced(Variant::only(flavour)))).expect("renders"))
        .collect();
    let (seen, _) = shading::seen(&mut renderer, &base);
    let layers = Layers::new(gpu(), size);
    renderer.draw_flavours(&base, all_flavours(), &layers).expect("draws");

    let stream = |mask: u32, modulated: u32, squared: u32| CompositionStream { mask, modulated, squared, lit: 0 };
    let streams = [stream(31, 0, 0), stream(0, 1, 0), stream(30, 1, 0), stream(12, 0, 1), stream(2, 1, 0), stream(17, 0, 0)];
    let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
    let buffer = gpu().buffer_with("composed", usage, &vec![0xffu8; (pixels * 8) as usize * streams.len()]);
    let destinations: Vec<_> = (0..).zip(streams).map(|(i, stream)| Destination { stream, signal: &buffer, offset: i * pixels }).collect();
    renderer.drawn_as(&base).expect("drawn").compose(&layers, &destinations).expect("composes");

    let params = FlavourParams::new(&renderer.scene().flavours);
    for (i, stream) in (0..).zip(streams) {
        let composed = read_signal(gpu(), &buffer, i * pixels, pixels).expect("the device works");
        let mut on = vec![false; pixels as usize];
        for one in &seen {
            let all = flavour_weights::weights(one.pixel.distance_m, one.pixel.normal.z, &params);
            let mask = if stream.mask == 0 { flavour_weights::mask(all) } else { stream.mask };
            let weights = flavour_weights::weights_for(all, mask, stream.mask != 0);
            let (mut albedo, mut fetches, mut modulated) = ([0.0; 3], 0, 0);
            for flavour in Flavour::ALL.into_iter().filter(|flavour| mask & u32::from(flavour.bit()) != 0 && weights[flavour.index()] > 0.0)
            {
                let picture = &own[flavour.index()];
                let weight = weights[flavour.index()].powi(if stream.squared == 1 { 2 } else { 1 });
                (0..3).for_each(|k| albedo[k] += weight * f64::from(picture.vectors("albedo").expect("requested")[one.index][k]));
                fetches += picture.values("fetches").expect("requested")[one.index] as u32;
                modulated += u32::from(flavour != Flavour::VirtualTexture) * stream.modulated;
            }
            // If the colour of the stream is modulated, each flavour except the virtual texture has counted the texture fetch of colour modulation
            // (`modulated` counts). The composed signal counts this fetch once.
            let fetches = fetches - modulated.saturating_sub(1);
            let found = composed[one.index];
            let colour = signal::colour(found);
            for k in 0..3 {
                // The tolerance covers two errors. The composed sum is rounded to f16. The distance is rounded to f32, which changes the weights near
                // a distance at which flavours change.
                let tolerance = albedo[k] / 512.0 + 1e-4;
                assert!(
                    (f64::from(colour[k]) - albedo[k]).abs() < tolerance,
                    "{stream:?}: {colour:?} instead of {albedo:?} at {}",
                    one.index
                );
            }
            assert_eq!(signal::fetches(found), fetches, "{stream:?}: fetches at {}", one.index);
            on[one.index] = true;
        }
        assert!(composed.iter().zip(&on).all(|(found, on)| *on || *found == [0; 2]), "{stream:?}: sky is not empty");
        assert!(on.iter().any(|on| !on) && on.iter().any(|on| *on), "both sky and terrain");
    }
}

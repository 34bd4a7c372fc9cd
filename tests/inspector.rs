//! Compares the results of the pixel inspector with the layers of the same picture, and those of the inspection pass with references in f64. Also
//! compares the random choices and the pages that the inspector computes on the CPU with those of the shaders.

use std::collections::{BTreeMap, BTreeSet};

use bytemuck::Zeroable as _;
use glam::{DVec2, DVec3};
use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, VariantChoice};
use kernels::inspect::Inspected;
use kernels::materials::Palette;
use kernels::oracle::{Pixel, inspect, pixel_at, probe_of};
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;
use kernels::shared::splat_blend;
use kernels::terrain::reference::{Ground, Projection};
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use kernels::view::normals::NormalEncoding;

use crate::fixtures::{pose, renderer, request, second_renderer, terrain};
use crate::shading::{self, Seen};

fn place(index: usize, size: [u32; 2]) -> [u32; 2] {
    let index = u32::try_from(index).expect("a small picture");
    [index % size[0], index / size[0]]
}

#[test]
fn a_pixel_says_what_the_layers_say() {
    let mut renderer = renderer();
    let request = request(&renderer, "cliff");
    let aovs = AovSet::from_names(&["depth", "mask", "variant", "choice", "position", "ddx", "ddy"]).expect("known layers");
    let picture = renderer.render(&request.with(|r| r.outputs.aovs = aovs)).expect("renders");
    let (on, value) = (terrain(&picture), |name: &str, i: usize| picture.values(name).expect("requested")[i]);
    let vector = |name: &str, i: usize| picture.vectors(name).expect("requested")[i].map(f64::from);
    let names: Vec<String> = renderer.scene().materials.iter().map(|m| m.name.clone()).collect();
    let (mut errors, mut found, mut seen, mut bent) = (Vec::new(), 0, 0, 0);
    for i in (0..on.len()).step_by(61) {
        let at = place(i, request.view.size);
        let pixel = inspect(&mut renderer, &request, at).expect("inspects");
        let Some(pixel) = pixel.filter(|_| on[i]) else {
            assert!(!on[i], "{at:?} is terrain");
            continue;
        };
        seen += 1;
        assert_eq!(pixel.pixel, at);
        assert_eq!(pixel.depth_m, f64::from(value("depth", i)), "{at:?}");
        assert_eq!(f64::from(pixel.mask), f64::from(value("mask", i)), "{at:?}");
        assert_eq!(f64::from(pixel.variant), f64::from(value("variant", i)), "{at:?}");
        assert_eq!(f64::from(pixel.choice), f64::from(value("choice", i)), "{at:?}");
        assert_eq!(pixel.steps.map(|step| step.shader), [vector("ddx", i), vector("ddy", i)], "{at:?}");
        // The tolerance allows for the rounding of the layer, which stores world coordinates in f32.
        let off = (DVec3::from_array(pixel.position) - DVec3::from_array(vector("position", i))).length();
        assert!(off < 1e-3 + 1e-6 * pixel.distance_m, "{at:?}: {off} m");
        let sums =
            [pixel.flavours.iter().sum::<f64>(), pixel.splat.iter().map(|t| t.weight).sum(), pixel.splat.iter().map(|t| t.blended).sum()];
        for sum in sums {
            assert!((sum - 1.0).abs() < 1e-6, "{at:?}: {sum}");
        }
        bent += usize::from(pixel.splat.iter().any(|texel| (texel.weight - texel.blended).abs() > 0.05));
        assert!(pixel.mask & !pixel.variant == 0);
        for texel in &pixel.splat {
            assert_eq!(texel.material, names[texel.index as usize]);
        }
        let Some(triangle) = pixel.triangle else { continue };
        found += 1;
        let towards = (DVec3::from_array(pixel.position) - request.view.pose.position) / pixel.distance_m;
        if towards.dot(DVec3::from_array(triangle.normal)).abs() > 0.3 {
            // The encoding with 8 + 8 bits changes a normal by at most 0.64 degrees; the test accepts 2 degrees. An error of the normal also changes
            // the derivatives, more so if the plane is seen obliquely. Here, the cosine between view direction and normal is above 0.3. So the
            // relative error of a derivative is at most about 3 times the error of the normal in radians.
            assert!(pixel.normal_error().expect("a triangle") < 2f64.to_radians(), "{pixel:?}");
            errors.extend(pixel.steps.iter().map(|step| step.error().expect("not grazing")));
        }
    }
    // On most pixels, all four splat texels have the same material and so the same height. The height blend then does not change their weights.
    assert!(bent > 0 && bent < seen, "heights changed the weights of {bent} of {seen} pixels");
    assert!(seen > 25 && found * 50 >= seen * 49, "{found} triangles for {seen} pixels");
    errors.sort_by(f64::total_cmp);
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    assert!(errors.len() > 20 && median < 0.03 && worst < 0.15, "median {median}, worst {worst} of {}", errors.len());
    // The encoding of normals is not exact, so derivatives must have an error.
    assert!(median > 1e-5, "{median}");
}

#[test]
fn all_numbers_equal_their_references() {
    let mut renderer = second_renderer();
    let (scene, world) = (renderer.scene().clone(), renderer.world().clone());
    let layout = *world.layout();
    let variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
    // The inspection pass works in bands of rows. This picture has several bands, and its size is not a multiple of the workgroup size.
    let request = request(&renderer, "cliff").with(|r| {
        r.view.size = [61, 149];
        r.shading.variant = variant;
    });
    let (seen, nodes) = shading::seen(&mut renderer, &request);
    let found = renderer.draw(&request).expect("draws").inspect().expect("inspects");
    assert_eq!(found.len(), 61 * 149);
    let palette = Palette::build(&scene, layout.sector_m, |_| Ok(())).expect("procedural textures");
    let ground = Ground::new(&world, &palette, &nodes, scene.blend.height_sharpness);
    let half_world = DVec2::splat(layout.world_m() / 2.0);
    let corner_of_sector = ((request.view.pose.position.truncate() + half_world) / layout.sector_m).floor() * layout.sector_m;
    let (mut slots, mut blends, mut others, mut wrong_plane) = (BTreeMap::new(), Vec::new(), 0, 0);
    let mut is_terrain = vec![false; found.len()];
    for Seen { index, pixel, .. } in &seen {
        is_terrain[*index] = true;
        let Inspected { position, slot, ddx, corner, ddy, plane, splat, bilinear, blended } = found[*index];
        let place = pixel.position - corner_of_sector.extend(0.0);
        let off = (DVec3::from_array(position.map(f64::from)) - place).length();
        // Positions are stored in f32, relative to the sector of the camera, and have coordinates of up to 10 km.
        assert!(off < 2e-3, "pixel {index}: {position:?}, {place}");
        for (found, expected) in [ddx, ddy].into_iter().zip(pixel.steps) {
            let off = (DVec3::from_array(found.map(f64::from)) - expected).length();
            assert!(off < 1e-4 * expected.length(), "pixel {index}: {found:?}, {expected}");
        }
        let size = pixel.normal.abs();
        // Two coordinates of a decoded normal may be equal except for rounding, so the axis of either is accepted.
        assert!(size[plane as usize] > size.max_element() - 1e-6, "pixel {index}: plane {plane}, {size}");
        let spot = ground.spot(pixel.position.truncate()).expect("a loaded node");
        let (cell, at) = (ground.cell(&spot), spot.uv * 64.0);
        // Rounding may move a point on the border of a cell into the next cell, or out of a node. So points near a border are left out.
        if (at - at.round()).abs().min_element() < 0.01 {
            others += 1;
            continue;
        }
        assert_eq!(*slots.entry(slot).or_insert(spot.node), spot.node, "pixel {index}: slot {slot} belongs to two nodes");
        let expected = at.floor().as_uvec2();
        assert_eq!([corner & 0xffff, corner >> 16], [expected.x, expected.y], "pixel {index}");
        assert_eq!(splat, cell.ids.map(u32::from), "pixel {index}");
        let weights = splat_blend::bilinear(cell.fraction);
        assert!((0..4).all(|k| (f64::from(bilinear[k]) - weights[k]).abs() < 5e-3), "pixel {index}: {bilinear:?}, {weights:?}");
        let height_blend = |plane| {
            let projection = Projection::of(plane, pixel.position, pixel.steps, scene.blend.mip_bias);
            let heights = cell.ids.map(|id| ground.material(id, &projection, 0).height);
            splat_blend::weights(cell.fraction, heights, scene.blend.height_sharpness)
        };
        let apart = |expected: [f64; 4]| (0..4).map(|k| (f64::from(blended[k]) - expected[k]).abs()).fold(0.0, f64::max);
        if cell.ids.iter().any(|id| *id != cell.ids[0]) {
            blends.push(apart(height_blend(plane)));
            wrong_plane += usize::from(apart(height_blend((plane + 1) % 3)) > 0.05);
        }
    }
    assert!(found.iter().zip(&is_terrain).all(|(found, on)| *on || *found == Inspected::zeroed()), "sky is not empty");
    assert!(is_terrain.iter().any(|on| !on) && slots.len() > 3 && slots.keys().all(|slot| *slot > 0), "{slots:?}");
    assert!(others * 10 < seen.len(), "{others} of {} lie on borders", seen.len());
    // The limit of the difference of two weights follows from the error of a filtered height, which is up to three steps of 1/255 (see `LIMITS` in
    // `shading.rs`). A difference of two heights is off by up to twice that. In a weight, this error is multiplied by ln 2 times the sharpness, and
    // by at most 1/4, the largest slope of the blend.
    blends.sort_by(f64::total_cmp);
    let limit = 3.0 / 255.0 * 2.0 * std::f64::consts::LN_2 * scene.blend.height_sharpness / 4.0;
    let (count, most) = (blends.len(), blends[blends.len() * 95 / 100]);
    assert!(count > 100 && most < limit, "95 % of {count} weights differ by up to {most}, limit {limit}");
    // Negative control: heights of another projection give other weights.
    assert!(wrong_plane * 10 > count, "{wrong_plane} of {count}");
}

#[test]
fn normals_are_decoded_however_they_are_stored() {
    let mut renderer = renderer();
    let variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
    let base = request(&renderer, "cliff").with(|r| r.shading.variant = variant);
    let pixels = NormalEncoding::ALL.map(|normals| -> Vec<Pixel> {
        let request = base.with(|r| r.geometry.normals = normals);
        let places = (0..(base.view.size[0] * base.view.size[1]) as usize).step_by(149).map(|i| place(i, base.view.size));
        places.filter_map(|at| inspect(&mut renderer, &request, at).expect("inspects")).collect()
    });
    let [codes, pair, exact] = &pixels;
    assert!(codes.len() > 10 && codes.len() == pair.len() && codes.len() == exact.len());
    assert!(codes.iter().zip(pair).all(|(codes, pair)| codes.shading_normal == pair.shading_normal));
    assert!(codes.iter().zip(exact).any(|(codes, exact)| codes.shading_normal != exact.shading_normal));
    // Median error of the triangle's normal: about a third of a degree with 8 + 8 bits (`codes`), an eighth of that with the finer lattice of the
    // plane-first encoding (`pair`), and thousandths of a degree with f32 (`exact`).
    let medians = [codes, pair, exact].map(|pixels| {
        let mut errors: Vec<f64> = pixels.iter().filter_map(Pixel::normal_error).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    });
    assert!(medians[0] > 3.0 * medians[1] && medians[1] > 3.0 * medians[2], "{medians:?} rad");
}

#[test]
fn derivatives_before_the_eye_are_as_exact_high_up_as_at_the_sea() {
    let mut renderer = renderer();
    let places = (0..80).flat_map(|j| (0..80).map(move |i| [f64::from(i) * 100.0 - 4000.0, f64::from(j) * 100.0 - 4000.0]));
    let heights = places.map(|[x, y]| (renderer.ground_m(x, y), x, y));
    let (z, x, y) = heights.max_by(|a, b| a.0.total_cmp(&b.0)).expect("ground");
    assert!(z > 1200.0, "{z} m");
    let pose = Pose { position: DVec3::new(x, y, z + 2.0), yaw: 1.0, pitch: -1.2, fov: 1.0 };
    let request = request(&renderer, "cliff").with(|r| r.view.pose = pose);
    let picture = renderer.render(&request).expect("renders");
    let on = terrain(&picture);
    let mut errors = Vec::new();
    for i in (0..on.len()).step_by(29).filter(|&i| on[i]) {
        let pixel = inspect(&mut renderer, &request, place(i, request.view.size)).expect("inspects").expect("terrain");
        let Some(triangle) = pixel.triangle else { continue };
        let towards = (DVec3::from_array(pixel.position) - pose.position) / pixel.distance_m;
        // An error of a plane's normal changes the derivatives more if the plane is seen more obliquely. If the view direction is within 60 degrees
        // of the normal, obliqueness increases the change by a factor of at most 2.
        if pixel.distance_m < 8.0 && towards.dot(DVec3::from_array(triangle.normal)).abs() > 0.5 {
            errors.extend(pixel.steps.iter().map(|step| step.error().expect("not grazing")));
        }
    }
    errors.sort_by(f64::total_cmp);
    // The encoding of normals with 8 + 8 bits gives derivatives an error of half a percent. If elevations above sea level were stored in f32, which
    // has steps of 0.1 mm at 1400 m, the error would be 2 percent.
    let median = errors[errors.len() / 2];
    assert!(errors.len() > 30 && median < 0.008, "median {median} of {}", errors.len());
}

#[test]
fn sky_is_nothing_and_beside_the_picture_is_an_error() {
    let mut renderer = renderer();
    let mut request = request(&renderer, "cliff");
    request.view.pose.pitch = 80f64.to_radians();
    request.view.pose.position.z += 2000.0;
    renderer.render(&request).expect("renders");
    assert_eq!(inspect(&mut renderer, &request, [3, 4]).expect("inspects"), None);
    let error = inspect(&mut renderer, &request, [request.view.size[0], 0]).expect_err("one too far").to_string();
    assert!(error.contains("no pixel 96, 0"), "{error}");
}

/// Inspects every 89th pixel of a picture that is drawn with one flavour. Pixels of sky are left out.
fn grid(flavour: Flavour, estimator: Estimator, noise: NoiseKind, seed: u32) -> Vec<Pixel> {
    let mut renderer = second_renderer();
    let variant = VariantChoice::Forced(Variant::only(flavour));
    let request = request(&renderer, "cliff").with(|r| {
        r.shading.variant = variant;
        r.shading.estimator = estimator;
        r.shading.noise = noise;
        r.shading.seed = seed;
        r.shading.frame = 5;
    });
    let [width, height] = request.view.size;
    let places = (0..width * height).step_by(89).map(|i| [i % width, i / width]);
    places.filter_map(|at| inspect(&mut renderer, &request, at).expect("inspects")).collect()
}

#[test]
fn the_references_choose_what_the_shader_chose() {
    for (flavour, estimator, noise) in [
        (Flavour::NearCliff, Estimator::Fc5, NoiseKind::HashedIsotropic),
        (Flavour::FarCliff, Estimator::Fc5, NoiseKind::HashedAnisotropic),
        (Flavour::FarCliff, Estimator::Biplanar, NoiseKind::WhiteWorld),
        (Flavour::FarCliff, Estimator::Hex, NoiseKind::InterleavedGradient),
        (Flavour::NearCliff, Estimator::Stf, NoiseKind::SpatioTemporalBlue),
        (Flavour::Splat, Estimator::Stf, NoiseKind::WhiteScreen),
        (Flavour::FarCliff, Estimator::Stf, NoiseKind::Blue),
    ] {
        let pixels = grid(flavour, estimator, noise, 3);
        let draws = pixels.iter().filter(|pixel| pixel.draw.is_some_and(|draw| draw.flavour == flavour)).count();
        let agreeing = pixels.iter().filter(|pixel| pixel.agrees()).count();
        assert!(pixels.len() > 30 && draws == pixels.len(), "{estimator} {noise}: {draws} of {} draw", pixels.len());
        // The shader and the reference may disagree at one pixel, because its threshold may lie on the border between two choices, or its position
        // may lie on the border between two cells of the noise.
        assert!(agreeing + 1 >= pixels.len(), "{estimator} {noise}: {agreeing} of {} agree", pixels.len());
    }
    // Negative control: with a different seed, the references give different choices.
    let [ours, others] = [3, 4].map(|seed| grid(Flavour::FarCliff, Estimator::Fc5, NoiseKind::HashedIsotropic, seed));
    let expected = |pixel: &Pixel| pixel.draw.expect("draws").expected;
    let alike = ours.iter().zip(&others).filter(|(a, b)| expected(a) == b.choice).count();
    assert!(alike * 4 < ours.len() * 3, "{alike} of {}", ours.len());
    // The exact estimator makes no random choices.
    let exact = grid(Flavour::FarCliff, Estimator::Exact, NoiseKind::HashedIsotropic, 3);
    assert!(exact.iter().all(|pixel| pixel.draw.is_none() && pixel.choice == 0 && pixel.agrees()));
}

#[test]
fn the_pages_of_all_pixels_are_those_that_the_frame_asked_for() {
    let mut renderer = renderer();
    let variant = VariantChoice::Forced(Variant::only(Flavour::VirtualTexture));
    let request = RenderRequest::new(pose(&renderer, "ground"), [24, 16]).with(|r| {
        r.shading.variant = variant;
        r.outputs.keep_geometry = true;
    });
    let wanted = renderer.render(&request).expect("renders").report.pages.wanted;
    let mut pages = BTreeSet::new();
    for y in 0..request.view.size[1] {
        for x in 0..request.view.size[0] {
            let Some(pixel) = inspect(&mut renderer, &request, [x, y]).expect("inspects") else { continue };
            let page = pixel.page.expect("all is virtual texture");
            assert!(page.covered >= page.footprint[0] && page.covered <= page.footprint[1], "{page:?}");
            assert_eq!(page.served, Some(page.id));
            pages.insert(page.id);
        }
    }
    // The frame may request more pages than the pixels name. If the level of a pixel is within 0.001 of the border between two levels of the virtual
    // texture, the frame requests the pages of both levels.
    let said = pages.len();
    assert!(said > 3 && said <= wanted && wanted <= said + 2 + said / 10, "the pixels name {said} pages, the frame requested {wanted}");
    // Without the flavour of the virtual texture, a pixel has no page.
    let far = request.with(|r| r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas)));
    renderer.render(&far).expect("renders");
    let pixel = inspect(&mut renderer, &far, [12, 12]).expect("inspects").expect("ground");
    assert_eq!((pixel.page, pixel.flavours), (None, [0.0, 1.0, 0.0, 0.0, 0.0]));
}

#[test]
fn a_probe_keeps_its_place_when_the_picture_changes_its_size() {
    let probe = probe_of([40, 20], [96, 64]);
    assert_eq!(pixel_at(probe, [96, 64]), [40, 20]);
    assert_eq!(pixel_at(probe, [192, 128]), [81, 41]);
}

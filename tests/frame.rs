//! Tests of the whole frame on the GPU: variants compared with the generic kernel, counted texture fetches, the statistics of random choices, cracks
//! and holes in the terrain, positions and derivatives, independence from earlier frames, and requests that are refused.

use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::gpu::bindings::view;
use kernels::gpu::{CLEAR, Recording, Timer};
use kernels::oracle;
use kernels::scene;
use kernels::shading::{Estimator, VARIANCE_SCALE};
use kernels::shared::noise::NoiseKind;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use kernels::view::normals::NormalEncoding;

use crate::fixtures::{SIZE, gpu, largest_difference, p_of_zero_mean, p_of_zero_means, pose, renderer, request, small_scene, terrain};

#[test]
fn every_variant_equals_the_generic_kernel_and_takes_the_fetches_promised() {
    let mut renderer = renderer();
    let mut base = request(&renderer, "cliff");
    base.outputs.aovs = AovSet::from_names(&["albedo", "fetches"]).expect("known layers");
    // A specialised shader does the same arithmetic, but the compiler may contract its operations differently. This changes a filtered value by at
    // most 2 ulp of f16.
    const TOLERANCE: f64 = 2.0;
    let mut previous: Option<Picture> = None;
    for variant in Variant::all() {
        let special = renderer.render(&base.with(|r| r.shading.variant = VariantChoice::Forced(variant))).expect("renders");
        let generic = renderer.render(&base.with(|r| r.shading.variant = VariantChoice::GenericForced(variant))).expect("renders");
        let difference = largest_difference(&special, &generic);
        assert!(difference <= TOLERANCE, "{variant} differs from the generic kernel by {difference} ulp");
        let fetches = special.values("fetches").expect("requested");
        assert_eq!(special.values("fetches"), generic.values("fetches"), "{variant}: the generic kernel counts differently");
        let promised = Estimator::Fc5.promised_fetches_of(variant) as f32;
        for (&counted, on) in fetches.iter().zip(terrain(&special)) {
            assert_eq!(counted, if on { promised } else { 0.0 }, "{variant}: a pixel took {counted} fetches");
        }
        assert_eq!(special.report.tiles[usize::from(variant.mask())], special.report.tiles[0], "{variant} must run on every tile");
        // Negative control: the picture of the previous variant must differ.
        if let Some(previous) = previous.replace(special) {
            assert!(largest_difference(&previous, &generic) > TOLERANCE, "{variant} looks like its predecessor");
        }
    }
}

#[test]
fn golden_table_of_fetches() {
    let promised = Flavour::ALL.map(|f| Estimator::Fc5.promised_fetches(f));
    assert_eq!(promised, [4, 2, 12, 8, 48]);
    let mut renderer = renderer();
    let base = request(&renderer, "cliff").with(|r| r.outputs.count_fetches = true);
    for (flavour, promised) in Flavour::ALL.into_iter().zip(promised) {
        let request = base.with(|r| r.shading.variant = VariantChoice::Forced(Variant::only(flavour)));
        assert_eq!(renderer.render(&request).expect("renders").fetches_per_px, Some(f64::from(promised)), "{}", flavour.name());
    }
    let reference = base.with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::Splat));
        r.shading.two_tilings = true;
    });
    assert_eq!(renderer.render(&reference).expect("renders").fetches_per_px, Some(96.0));
}

#[test]
fn automatic_tiles_hold_what_their_pixels_need() {
    let mut renderer = renderer();
    let mut base = request(&renderer, "cliff");
    base.outputs.aovs = AovSet::from_names(&["albedo", "mask", "variant"]).expect("known layers");
    let auto = renderer.render(&base).expect("renders");
    let generic = renderer.render(&base.with(|r| r.shading.variant = VariantChoice::GenericAuto)).expect("renders");
    assert!(largest_difference(&auto, &generic) <= 2.0);
    // Counting does not change the picture: the shader that counts neither fetches nor choices gives the same albedo.
    let uncounted = request(&renderer, "cliff").with(|r| r.shading.variant = VariantChoice::GenericAuto);
    assert!(!uncounted.wants_diagnostics());
    let uncounted = renderer.render(&uncounted).expect("renders");
    assert!(largest_difference(&uncounted, &generic) <= 2.0);
    let (mask, variant) = (auto.values("mask").expect("requested"), auto.values("variant").expect("requested"));
    let mut used = std::collections::BTreeSet::new();
    for ((&mask, &variant), on) in mask.iter().zip(variant).zip(terrain(&auto)) {
        let (mask, variant) = (mask as u32, variant as u32);
        if on {
            assert!(mask != 0 && mask & !variant == 0, "a pixel needs {mask:05b}, its tile runs {variant:05b}");
            used.insert(variant);
        } else {
            assert_eq!(variant, 0, "a sky pixel was shaded");
        }
    }
    assert!(used.len() >= 4, "the view should need several variants, got {used:?}");
    // The automatic choice of variants must be cheap: far below the 48 fetches per pixel of splat.
    let counting = request(&renderer, "cliff").with(|r| r.outputs.count_fetches = true);
    let counted = renderer.render(&counting).expect("renders");
    assert!(counted.fetches_per_px.expect("counted") < 16.0);
}

#[test]
fn random_choice_has_the_mean_and_variance_of_theory() {
    // Null hypothesis: over all seeds, the mean of the pictures is the exact blend, and their variance is the one that theory predicts, at each value
    // of the picture. Each seed gives one vector per test: the differences from the exact blend, or the squared differences minus the predicted
    // variances. The vectors of different seeds are independent, even if the noise correlates pixels. The sum of the squared differences over the
    // picture is tested, too: it notices a small error of all variances better. There are 2 flavours x 2 noises x 3 = 12 tests, with a family-wise
    // level of 0.001 (Sidak correction).
    const SEEDS: u32 = 48;
    // A value is stored in f16 with an error of at most 2^-12 of itself, and the values are below 1.
    const ROUNDING: f64 = 1.0 / 4096.0;
    let level = 1.0 - (1.0 - 0.001f64).powf(1.0 / 12.0);
    let mut renderer = renderer();
    // On walls, the projections differ. On horizontal ground, the projection from above would hide errors in the two others. Far cliff is tested at a
    // distance at which both tiling scales have weight.
    for (flavour, camera) in [(Flavour::NearCliff, "cliff"), (Flavour::FarCliff, "vista")] {
        for noise in [NoiseKind::HashedIsotropic, NoiseKind::HashedAnisotropic] {
            let forced = |f: Flavour, estimator| {
                request(&renderer, camera).with(|r| {
                    r.shading.variant = VariantChoice::GenericForced(Variant::only(f));
                    r.shading.estimator = estimator;
                    r.shading.noise = noise;
                })
            };
            let requests = [
                forced(flavour, Estimator::Exact),
                forced(flavour, Estimator::Variance),
                forced(Flavour::Splat, Estimator::Exact),
                forced(flavour, Estimator::Fc5),
            ];
            let mut albedo = |request: &RenderRequest| -> Vec<f64> {
                let picture = renderer.render(request).expect("renders");
                picture.vectors("albedo").expect("requested").iter().flatten().map(|&v| f64::from(v)).collect()
            };
            let exact = albedo(&requests[0]);
            let variance: Vec<f64> = albedo(&requests[1]).into_iter().map(|v| v / VARIANCE_SCALE).collect();
            let wrong = albedo(&requests[2]);
            assert!(variance.iter().sum::<f64>() > 0.0, "the view must have something to choose from");
            let samples: Vec<Vec<f64>> = (0..SEEDS).map(|seed| albedo(&(requests[3]).with(|r| r.shading.seed = seed))).collect();
            let p_of_mean = |expected: &[f64]| {
                let differences = |s: &Vec<f64>| s.iter().zip(expected).map(|(a, b)| a - b).collect();
                p_of_zero_means(&samples.iter().map(differences).collect::<Vec<_>>(), ROUNDING)
            };
            // Two p-values: of the variance of each value, and of the sum of all variances.
            let p_of_variance = |variance: &[f64]| -> [f64; 2] {
                let excess = |s: &Vec<f64>| s.iter().zip(&exact).zip(variance).map(|((a, e), v)| (a - e).powi(2) - v).collect::<Vec<f64>>();
                let excess: Vec<Vec<f64>> = samples.iter().map(excess).collect();
                let sums: Vec<f64> = excess.iter().map(|values| values.iter().sum()).collect();
                [p_of_zero_means(&excess, ROUNDING * ROUNDING), p_of_zero_mean(&sums)]
            };
            let what = format!("{} by {noise}", flavour.name());
            let (mean, [each, sum]) = (p_of_mean(&exact), p_of_variance(&variance));
            println!("{what}: p of the mean {mean:.3}, of the variances {each:.3}, of their sum {sum:.3}");
            assert!(mean > level, "{what}: mean differs from the exact blend, p = {mean:e}");
            assert!(each > level && sum > level, "{what}: variance differs from theory, p = {each:e}, of the sum {sum:e}");
            // Negative controls: the mean of a different flavour, the variances of neighbouring values, and variances that are off by a third.
            assert!(p_of_mean(&wrong) < level, "{what}: a wrong mean passes");
            let mut moved = variance.clone();
            moved.rotate_left(3);
            assert!(p_of_variance(&moved)[0] < level, "{what}: variances of neighbouring values pass");
            let scaled: Vec<f64> = variance.iter().map(|v| v * 4.0 / 3.0).collect();
            assert!(p_of_variance(&scaled)[1] < level, "{what}: variances that are off by a third pass");
        }
    }
}

/// Counts the pixels that show sky although the pixel above them shows terrain. Such pixels lie in cracks: if an upright camera sees a heightfield
/// without cracks, all pixels below a terrain pixel show terrain.
fn cracks(on: &[bool], size: [u32; 2]) -> usize {
    let (width, height) = (size[0] as usize, size[1] as usize);
    (0..width).map(|x| (1..height).filter(|y| on[(y - 1) * width + x] && !on[y * width + x]).count()).sum()
}

#[test]
fn pictures_have_no_cracks_no_black_and_no_nan() {
    let mut renderer = renderer();
    for camera in ["cliff", "ground", "vista", "grazing"] {
        let size = [320, 200];
        let request = request(&renderer, camera).with(|r| {
            r.view.size = size;
            r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
        });
        let picture = renderer.render(&request).expect("renders");
        let mut on = terrain(&picture);
        assert!(on.iter().filter(|t| **t).count() > on.len() / 4, "{camera}: hardly any terrain");
        assert_eq!(cracks(&on, size), 0, "{camera}: sky below terrain");
        for (texel, albedo) in picture.hdr.iter().zip(picture.vectors("albedo").expect("requested")) {
            assert!(texel.iter().all(|v| v.is_finite() && *v >= 0.0), "{camera}: radiance {texel:?}");
            if texel[3] > 0.0 {
                assert!(albedo.iter().sum::<f32>() > 0.01 && texel[1] > 0.0, "{camera}: a black pixel");
            }
        }
        // Negative control: one missing pixel is found.
        let hole = on.len() - size[0] as usize / 2;
        on[hole] = false;
        assert!(cracks(&on, size) > 0);
    }
}

#[test]
fn positions_lie_on_the_drawn_ground_and_derivatives_follow_them() {
    let mut renderer = renderer();
    let mut request = request(&renderer, "ground");
    request.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
    request.outputs.aovs = AovSet::from_names(&["position", "ddx", "ddy", "depth"]).expect("known layers");
    let picture = renderer.render(&request).expect("renders");
    let (position, ddx, ddy) = ["position", "ddx", "ddy"].map(|n| picture.vectors(n).expect("requested")).into();
    let eye = request.view.pose.position;
    let width = SIZE[0] as usize;
    let (mut checked, mut right, mut below, mut wrong) = (0, Vec::new(), Vec::new(), Vec::new());
    for (i, p) in position.iter().enumerate() {
        let p = p.map(f64::from);
        let distance = ((p[0] - eye.x).powi(2) + (p[1] - eye.y).powi(2) + (p[2] - eye.z).powi(2)).sqrt();
        // Within 30 m, all terrain has LOD 0, and `ground_m` follows the same triangles with the same 16-bit heights. The tolerance of 1 cm covers
        // the layer, which stores world coordinates of about 10^3 m in f32. On ground that rises by up to 10 m per metre, an error of x or y causes a
        // 10 times larger error of the height.
        if picture.hdr[i][3] > 0.0 && distance < 30.0 {
            let off = (p[2] - renderer.ground_m(p[0], p[1])).abs();
            assert!(off < 0.01, "pixel {i} lies {off} m off the ground at {distance} m");
            checked += 1;
            if i % width + 1 < width && i + width < position.len() {
                let relative = |d: [f32; 3], neighbour: usize| {
                    let step: [f64; 3] = std::array::from_fn(|k| f64::from(position[neighbour][k]) - p[k]);
                    let length = step.iter().map(|s| s * s).sum::<f64>().sqrt();
                    (0..3).map(|k| (f64::from(d[k]) - step[k]).powi(2)).sum::<f64>().sqrt() / length
                };
                right.push(relative(ddx[i], i + 1));
                below.push(relative(ddy[i], i + width));
                wrong.push(relative(ddy[i], i + 1));
            }
        }
    }
    assert!(checked > 500, "only {checked} pixels are near");
    // Normals with 8 bits per coordinate have errors of up to 0.64 degrees. If the normal is 70 degrees from the view direction, such an error
    // changes a derivative by a few percent. Pixels on triangle edges are outliers, so medians are compared. Negative control: the step to the right
    // is compared with ddy instead of ddx.
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (good, down, bad) = (median(&mut right), median(&mut below), median(&mut wrong));
    assert!(good < 0.06, "median relative error of ddx is {good}");
    assert!(down < 0.1, "median relative error of ddy is {down}");
    assert!(bad > 0.5, "ddy passes for ddx: {bad}");
}

#[test]
fn the_finer_plane_bends_derivatives_a_third_as_much_and_no_shading_normal() {
    let mut renderer = renderer();
    for camera in ["cliff", "ground", "vista", "grazing"] {
        // With the variance estimator, the layer `normal` shows the normal that the geometry pass stored.
        let base = request(&renderer, camera).with(|r| {
            r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
            r.shading.estimator = Estimator::Variance;
            r.outputs.aovs = AovSet::from_names(&["ddx", "ddy", "normal", "mask"]).expect("known layers");
        });
        let [octahedral, plane_first, exact] =
            NormalEncoding::ALL.map(|normals| renderer.render(&base.with(|r| r.geometry.normals = normals)).expect("renders"));
        for layer in ["normal", "mask"] {
            let [codes, pair] = [&octahedral, &plane_first].map(|picture| picture.layer(layer).expect("requested"));
            assert!(codes == pair, "{camera}: {layer}");
        }
        // Negative control: the layer `normal` shows the rounding of the octahedral encoding.
        assert!(octahedral.layer("normal") != exact.layer("normal"), "{camera}: the encoding with 8 + 8 bits does not change the normals");
        let on = terrain(&exact);
        // Relative errors of both derivatives of all terrain pixels, sorted.
        let errors = |picture: &Picture| -> Vec<f64> {
            let mut errors = Vec::new();
            for layer in ["ddx", "ddy"] {
                let (got, want) = (picture.vectors(layer).expect("requested"), exact.vectors(layer).expect("requested"));
                for ((got, want), _) in got.iter().zip(want).zip(&on).filter(|(_, on)| **on) {
                    let squares = |v: [f32; 3]| v.iter().map(|&x| f64::from(x).powi(2)).sum::<f64>();
                    errors.push((squares([0, 1, 2].map(|k| got[k] - want[k])) / squares(*want)).sqrt());
                }
            }
            errors.sort_by(f64::total_cmp);
            errors
        };
        let (two, one) = (errors(&octahedral), errors(&plane_first));
        for part in [0.5, 0.95] {
            let at = (part * (two.len() - 1) as f64) as usize;
            println!(
                "{camera}: quantile {} of the errors of derivatives: octahedral {:.3} %, plane-first {:.3} %",
                part,
                100.0 * two[at],
                100.0 * one[at]
            );
            assert!(one[at] > 0.0 && two[at] >= 3.0 * one[at], "{camera}, {part}: octahedral {}, plane-first {}", two[at], one[at]);
        }
    }
}

#[test]
fn a_picture_does_not_depend_on_what_was_looked_at_before() {
    let mut renderer = renderer();
    let mut request = request(&renderer, "cliff");
    request.outputs.keep_geometry = false;
    let first = renderer.render(&request).expect("renders");
    let mut elsewhere = request;
    elsewhere.view.pose = pose(&renderer, "vista");
    let other = renderer.render(&elsewhere).expect("renders");
    let again = renderer.render(&request).expect("renders");
    assert_eq!(first.hdr, again.hdr);
    assert_ne!(first.hdr, other.hdr);
    // If the geometry of the last frame is reused, the picture is the same as if the geometry is drawn again.
    let kept = renderer.render(&request.with(|r| r.outputs.keep_geometry = true)).expect("renders");
    assert_eq!(first.hdr, kept.hdr);
}

#[test]
fn the_kernel_refuses_what_it_cannot_draw() {
    let mut scene = small_scene();
    scene.flavours.far_atlas_m = 0.0;
    let mut without = Renderer::new(gpu(), &scene, &|_| {}).expect("renders without virtual texture");
    let mut renderer = renderer();
    for size in [[0, 0], [0, 5], [1_000_000, 1], [16_000, 16_000]] {
        let request = request(&renderer, "cliff").with(|r| r.view.size = size);
        let message = renderer.render(&request).expect_err("no such picture").to_string();
        assert!(message.contains("1 to 16384"), "{message}");
    }
    let vt = request(&renderer, "cliff").with(|r| r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::VirtualTexture)));
    let message = without.render(&vt).expect_err("there is no virtual texture").to_string();
    assert!(message.contains("far_atlas_m"), "{message}");
    // Flavours that do not need the virtual texture are drawn.
    let far = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
    assert!(without.render(&vt.with(|r| r.shading.variant = far)).is_ok());
}

#[test]
fn holes_open_the_ground_and_colour_modulation_costs_one_fetch() {
    let mut scene = small_scene();
    let (x, y) = (31.0, -160.0);
    let hole = scene::Hole { centre: [x, y], radius_m: 6.0 };
    let scene::World::Procedural { holes, colour_modulation, .. } = &mut scene.world else { panic!("the built-in world is procedural") };
    holes.push(hole);
    *colour_modulation = 0.4;
    let mut renderer = Renderer::new(gpu(), &scene, &|_| {}).expect("renders");
    // The camera looks straight down from 40 m. The hole appears as a disc in the middle of the picture. The radius of the disc is about an eighth of
    // the picture's height.
    let above = Pose {
        position: glam::DVec3::new(x, y, renderer.ground_m(x + 20.0, y) + 40.0),
        yaw: 0.0,
        pitch: -std::f64::consts::FRAC_PI_2,
        fov: 60f64.to_radians(),
    };
    let counted = |flavour: Flavour| {
        RenderRequest::new(above, SIZE).with(|r| {
            r.shading.variant = VariantChoice::Forced(Variant::only(flavour));
            r.outputs.count_fetches = true;
            r.outputs.aovs = AovSet::from_names(&["albedo", "position"]).expect("known layers");
        })
    };
    for (flavour, fetches) in [(Flavour::FarAtlas, 3.0), (Flavour::NearCliff, 13.0), (Flavour::VirtualTexture, 4.0)] {
        let picture = renderer.render(&counted(flavour)).expect("renders");
        assert_eq!(picture.fetches_per_px, Some(fetches), "{}", flavour.name());
        let on = terrain(&picture);
        assert!(!on[SIZE[0] as usize * SIZE[1] as usize / 2 + SIZE[0] as usize / 2], "the middle of the hole is covered");
        assert!(on[0] && on[on.len() - 1], "the corners must be ground");
        // There is no ground inside the hole, with a tolerance of 1 m, which is twice the distance between vertices. Texels inside the hole are
        // transparent black, which must not darken the ground at the hole's rim.
        let (position, albedo) = (picture.vectors("position").expect("requested"), picture.vectors("albedo").expect("requested"));
        for (p, a) in position.iter().zip(albedo).zip(&on).filter(|(_, on)| **on).map(|(pair, _)| pair) {
            let from_centre = (f64::from(p[0]) - x).hypot(f64::from(p[1]) - y);
            assert!(from_centre > hole.radius_m - 1.0, "ground {from_centre} m from the hole's centre");
            assert!(a.iter().sum::<f32>() > 0.02, "{}: dark ground {from_centre} m from the hole's centre", flavour.name());
        }
    }
}

#[test]
fn a_picture_of_the_sky_holds_nothing_of_the_one_before() {
    let mut renderer = renderer();
    let mut request = request(&renderer, "cliff");
    request.outputs.aovs = AovSet::from_names(&["variant", "fetches", "depth"]).expect("known layers");
    request.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
    let ground = renderer.render(&request).expect("renders");
    assert!(ground.values("variant").expect("requested").iter().any(|v| *v > 0.0));
    request.view.pose.pitch = 80f64.to_radians();
    request.view.pose.position.z += 2000.0;
    let sky = renderer.render(&request).expect("renders");
    for layer in ["variant", "fetches", "depth"] {
        assert!(sky.values(layer).expect("requested").iter().all(|v| *v == 0.0), "{layer} of an empty sky");
    }
    // Odd sizes, a camera outside the world, and the extremes of the field of view give valid pictures, too.
    request.outputs.aovs = AovSet::from_names(&["position", "albedo"]).expect("known layers");
    for (size, fov, x) in [([1, 1], 55.0, 0.0), ([13, 7], 1.0, 0.0), ([31, 17], 175.0, 0.0), ([9, 9], 55.0, 9000.0)] {
        let mut odd = request.with(|r| r.view.size = size);
        odd.view.pose =
            Pose { position: glam::DVec3::new(x, 0.0, 2600.0), yaw: -std::f64::consts::FRAC_PI_2, pitch: -0.3, fov: f64::to_radians(fov) };
        let picture = renderer.render(&odd).expect("renders");
        assert_eq!(picture.hdr.len(), (size[0] * size[1]) as usize);
        assert!(picture.hdr.iter().flatten().all(|v| v.is_finite()), "{size:?} {fov}");
    }
}

#[test]
fn only_a_lit_picture_is_read_and_only_the_geometry_drawn_last_is_used_again() {
    let mut renderer = renderer();
    let request = request(&renderer, "cliff").with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
        r.outputs.displayed = true;
    });
    let lit = renderer.render(&request).expect("renders");
    assert!(lit.hdr.len() == (SIZE[0] * SIZE[1]) as usize && lit.displayed.is_some());
    // A frame that is not lit leaves the lit picture of the previous frame in the target. That picture must not be read.
    let unlit = renderer.render(&request.with(|r| r.outputs.lit = false)).expect("renders");
    assert!(unlit.hdr.is_empty() && unlit.displayed.is_none());
    assert_eq!(unlit.vectors("albedo"), lit.vectors("albedo"));

    // A request with different shading on the same geometry is accepted. A request with a different view or different geometry is not.
    let other_shading = request.with(|r| r.shading.seed = 5);
    assert_eq!(renderer.drawn_as(&other_shading).expect("the same geometry").request(), &other_shading);
    for elsewhere in [request.with(|r| r.view.pose.yaw += 0.1), request.with(|r| r.geometry.vertex_stride = 2)] {
        let Err(error) = renderer.drawn_as(&elsewhere) else { panic!("this geometry was not drawn") };
        assert!(error.to_string().contains("not the one that was drawn last"), "{error}");
    }
}

#[test]
fn a_frame_without_pages_uses_no_page_of_the_frame_before() {
    let mut renderer = renderer();
    let ground = request(&renderer, "ground");
    let forced = |flavour| ground.with(|r| r.shading.variant = VariantChoice::Forced(Variant::only(flavour)));
    let below = [SIZE[0] / 2, SIZE[1] - 2];
    let pixel = oracle::inspect(&mut renderer, &forced(Flavour::VirtualTexture), below).expect("inspects").expect("terrain");
    let page = pixel.page.expect("shaded from a page");
    assert!(page.served.is_some() && renderer.page_serving(page.id) == page.served);
    // With the automatic choice, only pixels that need the virtual texture request pages.
    let automatic = renderer.render(&ground).expect("renders").report;
    assert!(automatic.pages.wanted > 0 && automatic.pages.wanted < 1000, "{:?}", automatic.pages);
    let baked = renderer.render(&forced(Flavour::FarAtlas)).expect("renders").report;
    assert_eq!((baked.pages.wanted, baked.pages.rendered), (0, 0));
    assert_eq!(renderer.page_serving(page.id), None, "a page of the previous frame is still in use");
}

#[test]
fn more_passes_than_a_timer_holds_are_an_error_and_not_a_shorter_list() {
    let target = gpu().target("nothing", [1, 1], wgpu::TextureFormat::R8Unorm);
    let times = |passes: u32| {
        let mut rec = Recording::new(gpu(), &[]);
        for pass in 0..passes {
            rec.render(&format!("pass {pass}"), &[&view(&target)], CLEAR, None, 0, &[]);
        }
        rec.finish()
    };
    let full = times(Timer::CAPACITY).expect("as many as fit");
    if gpu().features.contains(wgpu::Features::TIMESTAMP_QUERY) {
        let names: Vec<&str> = full.iter().map(|pass| pass.name.as_str()).collect();
        assert_eq!((names.len(), names[0], names[63]), (64, "pass 0", "pass 63"));
        let error = times(Timer::CAPACITY + 2).expect_err("two too many").to_string();
        assert!(error.contains("2 of 66 passes were not timed"), "{error}");
    } else {
        assert!(full.is_empty() && times(Timer::CAPACITY + 2).expect("nothing is timed").is_empty());
    }
}

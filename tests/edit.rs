//! Tests of a scene that is edited while it is drawn. Bit for bit, the picture must equal the picture that is drawn after the edited scene is loaded
//! from the start. Only the nodes, pages and textures that an edit affects may be built again. Also tests settings of the frame that the workbench
//! changes: LOD bias, vertex stride, frozen culling, and times by variant.

use std::sync::atomic::{AtomicUsize, Ordering};

use kernels::base::progress::Progress;
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer, RendererOptions, VariantChoice};
use kernels::materials::Palette;
use kernels::scene::{Scene, Stroke, StrokeKind};
use kernels::variant::{Flavour, Variant};

use crate::fixtures::{SIZE, gpu, pose, small_scene};

fn editable(scene: &Scene, sketch: Option<u32>) -> Renderer<'static> {
    let options = RendererOptions { editable: true, sketch, ..RendererOptions::default() };
    Renderer::with(gpu(), scene, options, &|_| {}).expect("the small scene renders")
}

/// Returns a request for a picture of the ground. Near ground is shaded mainly from pages of the virtual texture; ground that is farther away is
/// shaded mainly from the far atlas.
fn ground(renderer: &Renderer<'_>) -> RenderRequest {
    let both = Flavour::VirtualTexture.bit() | Flavour::FarAtlas.bit();
    RenderRequest::new(pose(renderer, "ground"), SIZE).with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::new(both).expect("a set"));
        r.outputs.aovs = AovSet::from_names(&["albedo", "normal"]).expect("known layers");
    })
}

fn draw(renderer: &mut Renderer<'_>) -> Picture {
    let request = ground(renderer);
    renderer.render(&request).expect("renders")
}

fn differing(a: &Picture, b: &Picture) -> usize {
    a.hdr.iter().zip(&b.hdr).filter(|(a, b)| a.map(f32::to_bits) != b.map(f32::to_bits)).count()
}

/// Returns the map coordinates (x, y) of the point 12 m in front of the camera.
fn before_the_camera(renderer: &Renderer<'_>) -> [f64; 2] {
    let pose = pose(renderer, "ground");
    let ahead = pose.position + pose.axes()[2] * 12.0;
    [ahead.x, ahead.y]
}

fn material<'s>(scene: &'s mut Scene, name: &str) -> &'s mut kernels::scene::Material {
    scene.materials.iter_mut().find(|m| m.name == name).expect("a material of the built-in scene")
}

#[test]
fn an_edited_scene_is_drawn_as_if_it_had_been_loaded_and_only_what_is_touched_is_made_anew() {
    let original = small_scene();
    let mut renderer = editable(&original, None);
    let first = draw(&mut renderer);
    let (resident, wanted) = (first.report.atlas.resident, first.report.pages.wanted);
    assert!(resident > 20 && wanted > 10, "{:?}", first.report);
    let at = before_the_camera(&renderer);
    let [slope, curvature] = renderer.world().relief_at(at[0], at[1]);
    let lies = renderer.world().rules().material_at(renderer.world().height_m(at[0], at[1]), slope, curvature, at[0], at[1]);
    let lies = original.materials[usize::from(lies)].name.clone();
    let other = original.materials.iter().find(|m| m.name != lies).expect("two materials").name.clone();

    let mut scene = original.clone();
    let mut before = first.clone();
    // A change of the light does not affect nodes, textures or pages.
    scene.sun.elevation_deg = 50.0;
    assert!(renderer.retune(&scene).expect("valid"));
    let picture = draw(&mut renderer);
    assert_eq!((picture.report.edited.nodes, picture.report.edited.textures, picture.report.pages.rendered), (0, 0, 0));
    assert!(differing(&picture, &before) > 0);
    before = picture;

    // A different tint of the material in front of the camera affects the nodes and pages that show this material, but no texture.
    material(&mut scene, &lies).tint = [1.0, 0.4, 0.4];
    assert!(renderer.retune(&scene).expect("valid"));
    let picture = draw(&mut renderer);
    let edited = picture.report.edited;
    assert!(edited.nodes > 0 && edited.textures == 0 && picture.report.pages.rendered > 0, "{edited:?}");
    assert!(differing(&picture, &before) > 0);
    before = picture;

    // If the texture of this material repeats at a different size, only pages are affected.
    material(&mut scene, &lies).tile_m *= 1.5;
    assert!(renderer.retune(&scene).expect("valid"));
    let picture = draw(&mut renderer);
    assert_eq!((picture.report.edited.nodes, picture.report.edited.textures), (0, 0));
    assert!(picture.report.pages.rendered > 0 && differing(&picture, &before) > 0);
    before = picture;

    // A stroke of the brush affects the nodes and pages under it.
    let stroke = Stroke {
        kind: StrokeKind::Splat,
        material: other.clone(),
        points: vec![at, [at[0] + 4.0, at[1] + 1.0]],
        radius_m: 3.0,
        fade_m: 0.0,
        amount: 0.0,
    };
    scene.strokes.push(stroke.clone());
    assert!(renderer.retune(&scene).expect("valid"));
    let picture = draw(&mut renderer);
    let edited = picture.report.edited;
    assert!((1..=8).contains(&edited.nodes) && edited.textures == 0, "{edited:?}: expected a node per LOD, or two at a border");
    assert!((1..wanted).contains(&picture.report.pages.rendered), "{:?} of {wanted}", picture.report.pages);
    assert!(differing(&picture, &before) > 0);
    before = picture;

    // A painted mask sets the weight of the original material (`lies`) to 0 around the first stroke.
    scene.strokes.push(Stroke { kind: StrokeKind::Mask, material: lies.clone(), radius_m: 20.0, fade_m: 5.0, ..stroke });
    assert!(renderer.retune(&scene).expect("valid"));
    let picture = draw(&mut renderer);
    assert!(picture.report.edited.nodes > 0 && differing(&picture, &before) > 0);
    before = picture;

    // If a material gets a different texture, at least one texture is built.
    material(&mut scene, &other).procedural = Some("moss".to_owned());
    assert!(renderer.retune(&scene).expect("valid"));
    let picture = draw(&mut renderer);
    assert!(picture.report.edited.textures >= 1 && differing(&picture, &before) > 0, "{:?}", picture.report.edited);

    // The weight of a rule changes, and a material with its own rule is added.
    scene.rules[0].weight = 3.0;
    let mut more = scene.materials[0].clone();
    (more.name, more.procedural, more.tint) = ("more".to_owned(), Some("sand".to_owned()), [0.5, 0.5, 1.0]);
    scene.materials.push(more);
    scene.rules.push(kernels::scene::Rule { material: "more".to_owned(), noise_m: 9.0, ..scene.rules[0].clone() });
    assert!(renderer.retune(&scene).expect("valid"));
    let edited = draw(&mut renderer);

    let loaded = draw(&mut Renderer::new(gpu(), &scene, &|_| {}).expect("renders"));
    assert_eq!(differing(&edited, &loaded), 0, "pixels differ from those of the edited scene when it is loaded");

    // An edit that cannot be applied is refused and changes nothing.
    let mut wrong = scene.clone();
    material(&mut wrong, &other).procedural = None;
    material(&mut wrong, &other).folder = Some("/nowhere/at/all".into());
    assert!(renderer.retune(&wrong).is_err());
    assert!(*renderer.scene() == scene && differing(&draw(&mut renderer), &edited) == 0);

    // Back to the original scene.
    assert!(renderer.retune(&original).expect("valid"));
    assert_eq!(differing(&draw(&mut renderer), &first), 0, "pixels differ from those before the edits");
}

#[test]
fn two_scenes_that_take_turns_make_their_textures_once() {
    let made = AtomicUsize::new(0);
    let count = |progress: Progress| {
        made.fetch_add(usize::from(progress.stage.starts_with("texture")), Ordering::Relaxed);
    };
    let scene = small_scene();
    let options = RendererOptions { editable: true, ..RendererOptions::default() };
    let mut renderer = Renderer::with(gpu(), &scene, options, &count).expect("the small scene renders");
    let before = made.swap(0, Ordering::Relaxed);
    let mut other = scene.clone();
    other.blend.material_contrast = 0.5;
    assert!(renderer.retune(&other).expect("valid"));
    assert_eq!(made.swap(0, Ordering::Relaxed), before, "every texture must be built once with the lower contrast");
    for _ in 0..3 {
        assert!(renderer.retune(&scene).expect("valid") && renderer.retune(&other).expect("valid"));
    }
    assert_eq!(made.load(Ordering::Relaxed), 0, "textures were built again, although they exist for both scenes");
}

#[test]
fn a_sketch_becomes_the_scene_when_its_textures_come() {
    let mut scene = small_scene();
    scene.detail_size = 128;
    let mut renderer = editable(&scene, Some(64));
    assert!(renderer.is_sketch());
    let sketch = draw(&mut renderer);
    let palette = Palette::build(&scene, renderer.world().layout().sector_m, |_| Ok(())).expect("procedural textures");
    renderer.take_palette(palette);
    assert!(!renderer.is_sketch());
    let full = draw(&mut renderer);
    assert!(differing(&full, &sketch) > 0, "larger textures must change the picture");
    let loaded = draw(&mut Renderer::new(gpu(), &scene, &|_| {}).expect("renders"));
    assert_eq!(differing(&full, &loaded), 0);
}

#[test]
fn a_renderer_that_is_not_editable_says_so() {
    let mut renderer = crate::fixtures::renderer();
    let mut scene = small_scene();
    scene.materials[0].tint = [0.5; 3];
    assert!(!renderer.retune(&scene).expect("valid"));
    assert!(*renderer.scene() == small_scene());
}

#[test]
fn bias_of_the_lod_frozen_culling_and_times_by_variant() {
    let mut renderer = crate::fixtures::renderer();
    let far = Variant::only(Flavour::FarAtlas);
    let base = RenderRequest::new(pose(&renderer, "ground"), SIZE).with(|r| r.shading.variant = VariantChoice::Forced(far));
    let plain = renderer.render(&base).expect("renders");
    // With an LOD bias of one level, fewer nodes and patches are drawn.
    let coarse = renderer.render(&base.with(|r| r.geometry.lod_bias = 1.0)).expect("renders");
    assert!(coarse.report.nodes < plain.report.nodes && coarse.report.patches < plain.report.patches, "{:?}", coarse.report);
    // If only every second vertex is used, the nodes and the patches in the frustum are the same, but the surface is different.
    let sparse = renderer.render(&base.with(|r| r.geometry.vertex_stride = 2)).expect("renders");
    assert_eq!((&sparse.report.drawn, sparse.report.culled.outside), (&plain.report.drawn, plain.report.culled.outside));
    assert!(differing(&sparse, &plain) > 0);
    let sky_below_ground = |picture: &Picture| {
        let on: Vec<bool> = picture.hdr.iter().map(|t| t[3] > 0.0).collect();
        let width = SIZE[0] as usize;
        (width..on.len()).filter(|&i| on[i - width] && !on[i]).count()
    };
    // With a high LOD bias, the neighbour of a fine node may be a root of the quadtree that is not split. Stitching then moves vertices of the fine
    // node over the length of several patches. The camera is turned in steps, so that such patches extend beyond the edge of some pictures.
    let cases = [
        (1, 0.0, 0.0),
        (2, 0.0, 0.0),
        (4, 0.0, 0.0),
        (1, 4.0, 0.0),
        (2, 3.0, 0.0),
        (4, 4.0, 0.0),
        (1, 0.0, 0.5),
        (2, 0.0, 4.0),
        (1, 3.0, 16.0),
    ];
    for (vertex_stride, lod_bias, error_px) in cases {
        for camera in ["ground", "vista", "cliff"] {
            for turn in (0..12).step_by(if lod_bias > 0.0 { 1 } else { 4 }) {
                let mut pose = pose(&renderer, camera);
                pose.yaw += f64::from(turn) * std::f64::consts::TAU / 12.0;
                let request = base.with(|r| {
                    r.view.pose = pose;
                    r.geometry.vertex_stride = vertex_stride;
                    r.geometry.lod_bias = lod_bias;
                    r.geometry.error_px = error_px;
                });
                let picture = renderer.render(&request).expect("renders");
                let holes = sky_below_ground(&picture);
                assert_eq!(
                    holes, 0,
                    "{camera}, {turn} twelfths: sky through the ground, stride {vertex_stride}, bias {lod_bias}, error {error_px} px"
                );
            }
        }
    }
    let error = renderer.render(&base.with(|r| r.geometry.vertex_stride = 3)).expect_err("no such stride").to_string();
    assert!(error.contains("1, 2 or 4"), "{error}");
    let fine = renderer.render(&base.with(|r| r.geometry.lod_bias = -0.5)).expect("renders");
    assert!(fine.report.nodes > plain.report.nodes, "{} of {}", fine.report.nodes, plain.report.nodes);
    for bias in [f64::NAN, 5.0, -3.0] {
        let error = renderer.render(&base.with(|r| r.geometry.lod_bias = bias)).expect_err("out of range").to_string();
        assert!(error.contains("`frame.lod_bias`") && error.contains("-2 to 4"), "{error}");
    }

    // Frozen culling: when the camera turns away and moves, the nodes and patches of the earlier view are still drawn.
    let mut away = base.view.pose;
    away.yaw += std::f64::consts::PI;
    away.position.x += 200.0;
    let turned = renderer.render(&base.with(|r| r.view.pose = away)).expect("renders");
    assert_ne!(turned.report.drawn, plain.report.drawn);
    let frozen = renderer
        .render(&base.with(|r| {
            r.view.pose = away;
            r.geometry.culled_from = Some(base.view.pose);
        }))
        .expect("renders");
    // Patches that were hidden from the earlier view are drawn, too.
    let in_frustum = plain.report.patches + plain.report.culled.hidden;
    assert_eq!((&frozen.report.drawn, frozen.report.patches), (&plain.report.drawn, in_frustum));
    // The patches that frozen culling keeps must still lie on the ground if they are seen from 400 m above.
    let mut above = base.view.pose;
    (above.position.z, above.pitch) = (above.position.z + 400.0, -0.6);
    let request = base.with(|r| {
        r.view.pose = above;
        r.outputs.aovs = AovSet::from_names(&["position"]).expect("known");
    });
    let frozen = renderer.render(&request.with(|r| r.geometry.culled_from = Some(base.view.pose))).expect("renders");
    let positions = frozen.vectors("position").expect("requested");
    let on = frozen.hdr.iter().map(|t| t[3] > 0.0);
    let off =
        positions.iter().zip(on).filter(|(_, on)| *on).map(|(p, _)| (f64::from(p[2]) - renderer.ground_m(p[0].into(), p[1].into())).abs());
    let mut off: Vec<f64> = off.collect();
    off.sort_by(f64::total_cmp);
    assert!(off.len() > 100 && off[off.len() / 2] < 1.0, "{} pixels, median {:?} m off the ground", off.len(), off.get(off.len() / 2));

    // The picture does not change if each variant is drawn in a separate pass.
    let auto = base.with(|r| r.shading.variant = VariantChoice::Auto);
    let whole = renderer.render(&auto).expect("renders");
    let timed = renderer.render(&auto.with(|r| r.outputs.time_variants = true)).expect("renders");
    assert_eq!(differing(&whole, &timed), 0);
    let names: Vec<String> = timed.report.passes.iter().map(|pass| pass.name.clone()).collect();
    // Passes are timed only if the device has timestamps.
    assert_eq!(names.is_empty(), !gpu().features.contains(wgpu::Features::TIMESTAMP_QUERY));
    if !names.is_empty() {
        let ran = Variant::all().filter(|v| timed.report.tiles[usize::from(v.mask())] > 0);
        assert!(ran.count() > 1 && !names.iter().any(|name| name == "shading"), "{names:?}");
        for variant in Variant::all() {
            let is_timed = names.contains(&format!("shading: {variant}"));
            assert_eq!(is_timed, timed.report.tiles[usize::from(variant.mask())] > 0, "{variant}: {names:?}");
        }
        assert!(whole.report.passes.iter().any(|pass| pass.name == "shading"));
    }
}

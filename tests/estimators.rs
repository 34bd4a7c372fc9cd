//! Tests of the estimators (`kernels::shading::Estimator`, ways to compute the value of a flavour): their numbers of texture fetches, their means,
//! and properties of the functions that they use. Also tests how tiles are drawn, and how textures are filtered.
//!
//! Most pictures come from the shared renderers of `fixtures`. Statistical tests have fixed seeds and state their null hypothesis and level.

use std::sync::MutexGuard;

use kernels::base::wgsl::{self, Piece};
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::gpu::GpuOptions;
use kernels::materials::{LAYER_SHIFT, Palette};
use kernels::shading::Estimator;
use kernels::shared::real::dot;
use kernels::shared::{biplanar, hash, hex_tiling, layers, octahedral, snapped_projection, splat_blend, texel_choice, tiling, triplanar};
use kernels::variant::{Flavour, Variant};
use kernels::view::FrameUniforms;

use crate::layouts::constants;

use crate::fixtures::{gpu, largest_difference, open, p_of_zero_means, renderer, request, second_renderer, small_scene, terrain};

/// The flavours for which estimators differ.
const FLAVOURS: [Flavour; 3] = [Flavour::NearCliff, Flavour::FarCliff, Flavour::Splat];

/// Pseudo-random number for an index and a column, uniform in [0, 1).
fn unit(index: u32, column: u32) -> f64 {
    hash::to_unit(hash::pcg4d([index, column, 24, 2022])[0])
}

/// Pseudo-random unit vector for an index, uniform on the sphere.
fn direction(index: u32) -> [f64; 3] {
    let z = 2.0 * unit(index, 90) - 1.0;
    let (sin, cos) = (unit(index, 91) * std::f64::consts::TAU).sin_cos();
    let r = (1.0 - z * z).sqrt();
    [r * cos, r * sin, z]
}

#[test]
fn shaders_know_estimators_by_the_hosts_numbers() {
    let constants = constants(&kernels::shading::MODULE.pieces());
    let all: Vec<Estimator> = Estimator::ALL.into_iter().chain(Estimator::YARDSTICKS).collect();
    for &estimator in &all {
        let name = format!("ESTIMATOR_{}", estimator.name().to_uppercase().replace('-', "_"));
        assert_eq!(constants.get(&name), Some(&f64::from(estimator as u8)), "{name}");
    }
    // The shaders define no other estimators.
    assert_eq!(constants.keys().filter(|name| name.starts_with("ESTIMATOR_")).count(), all.len());
    assert_eq!(constants.get("TERRAIN_LAYER_BITS"), Some(&f64::from(LAYER_SHIFT)));
    assert_eq!(constants.get("LAYERS"), Some(&(layers::LAYERS as f64)));
}

#[test]
fn estimators_have_names() {
    for estimator in Estimator::ALL {
        assert_eq!(estimator.name().parse::<Estimator>().ok(), Some(estimator));
        assert!(!estimator.mean().is_stochastic(Variant::new(28).expect("a mask")), "{estimator}: its mean draws random numbers");
    }
    for (wrong, hint) in [
        ("biplaner", "did you mean `biplanar`?"),
        ("fc6", "did you mean `fc5`?"),
        ("zzzzzzzz", "the estimators are fc5, exact"),
        ("", "the estimators are"),
    ] {
        let message = wrong.parse::<Estimator>().expect_err("no such estimator").to_string();
        assert!(message.contains(hint) && message.contains("snapped") && !message.contains('\n'), "{message}");
    }
}

// ---------------------------------------------------------------- fetches

/// Checks that each terrain pixel of a picture took the promised number of fetches, and that sky pixels took none.
fn check_fetches(what: &str, picture: &Picture, promised: u32) {
    for (&counted, on) in picture.values("fetches").expect("requested").iter().zip(terrain(picture)) {
        assert_eq!(counted, if on { promised as f32 } else { 0.0 }, "{what}: a pixel took {counted} fetches, not {promised}");
    }
}

fn check_colours(what: &str, picture: &Picture) {
    for ((texel, albedo), on) in picture.hdr.iter().zip(picture.vectors("albedo").expect("requested")).zip(terrain(picture)) {
        assert!(texel.iter().chain(albedo).all(|v| v.is_finite() && *v >= 0.0), "{what}: radiance {texel:?}, albedo {albedo:?}");
        assert!(!on || albedo.iter().sum::<f32>() > 0.01, "{what}: a black pixel");
    }
}

#[test]
fn every_estimator_takes_the_fetches_promised_and_depends_on_the_seed_where_it_says_so() {
    let mut renderer = second_renderer();
    let mut base = request(&renderer, "cliff");
    base.outputs.aovs = AovSet::from_names(&["albedo", "fetches"]).expect("known layers");
    let mut pictures: Vec<(String, Picture)> = Vec::new();
    // The first estimator (`fc5`) is left out, because the tests of `frame` check it on all 31 variants.
    for estimator in Estimator::ALL.into_iter().chain(Estimator::YARDSTICKS).skip(1) {
        let base = base.with(|r| r.shading.estimator = estimator);
        let is_yardstick = Estimator::YARDSTICKS.contains(&estimator);
        for flavour in FLAVOURS {
            let variant = Variant::only(flavour);
            let what = format!("{estimator} on {variant}");
            let promised = estimator.promised_fetches(flavour);
            let of = base.with(|r| r.shading.variant = VariantChoice::GenericForced(variant));
            let generic = renderer.render(&of).expect("renders");
            check_fetches(&format!("{what}, generic"), &generic, promised);
            if estimator == Estimator::Variance {
                continue;
            }
            check_colours(&what, &generic);
            // Yardsticks, which are estimators that only serve to measure others, are rendered only by the generic kernel.
            if !is_yardstick {
                let special = renderer.render(&base.with(|r| r.shading.variant = VariantChoice::Forced(variant))).expect("renders");
                check_fetches(&what, &special, promised);
                let difference = largest_difference(&special, &generic);
                // A specialised shader does the same arithmetic, but the compiler may contract its operations differently. This changes a value by at
                // most 2 ulp of f16.
                assert!(difference <= 2.0, "{what} differs from the generic kernel by {difference} ulp");
            }
            let other = renderer.render(&of.with(|r| r.shading.seed = 1)).expect("renders");
            let differs = largest_difference(&other, &generic) > 2.0;
            assert_eq!(differs, estimator.is_stochastic(variant), "{what}: a different seed changes the picture: {differs}");
            // Negative control: no two combinations of estimator and flavour give the same picture, except for combinations that are equal by
            // definition.
            let alike = |a: &str| {
                let same = |names: [&str; 2]| names.iter().any(|n| what.starts_with(n)) && names.iter().any(|n| a.starts_with(n));
                // On splat, `biplanar` and `hex` draw no random numbers. So the picture of each equals the picture of its mean estimator.
                let own_mean = |name: &str| same([&format!("{name} on splat"), &format!("{name}-mean on splat")]);
                same(["luna8", "luna8"])
                    || same(["snapped", "snapped"])
                    || same(["laplacian on near", "laplacian on splat"])
                    || own_mean("biplanar")
                    || own_mean("hex")
            };
            for (name, picture) in &pictures {
                assert!(alike(name) || largest_difference(picture, &generic) > 2.0, "{what} looks like {name}");
            }
            pictures.push((what, generic));
        }
        // A variant with several flavours takes the sum of their fetches.
        for mask in [12, 28, 29, 30] {
            let variant = Variant::new(mask).expect("a mask");
            let promised = estimator.promised_fetches_of(variant);
            let picture = renderer.render(&base.with(|r| r.shading.variant = VariantChoice::GenericForced(variant))).expect("renders");
            check_fetches(&format!("{estimator} on {variant}, generic"), &picture, promised);
        }
    }
    // A second tiling of splat doubles the fetches of the estimators for which it is defined. Of the estimators tested here, that is only biplanar.
    // The second tiling does not change the fetches of the other estimators.
    for (estimator, promised) in [(Estimator::Biplanar, 64), (Estimator::Stf, 4), (Estimator::Hex, 120), (Estimator::Snapped, 16)] {
        let variant = VariantChoice::GenericForced(Variant::only(Flavour::Splat));
        let picture = renderer
            .render(&base.with(|r| {
                r.shading.estimator = estimator;
                r.shading.variant = variant;
                r.shading.two_tilings = true;
            }))
            .expect("renders");
        check_fetches(&format!("{estimator} in two tilings"), &picture, promised);
    }
}

// ---------------------------------------------------------------- means

#[test]
fn random_estimators_have_their_means() {
    // Null hypothesis: the mean of an estimator's pictures over all seeds is the picture of `Estimator::mean`, at each value. Each seed gives the
    // differences from that picture, and different seeds are independent. There are 7 rows in the table below, with a family-wise level of 0.001
    // (Sidak correction).
    const SEEDS: u32 = 48;
    // A value is stored in f16 with an error of at most 2^-12 of itself, and the values are below 1.
    const ROUNDING: f64 = 1.0 / 4096.0;
    let level = 1.0 - (1.0 - 0.001f64).powf(1.0 / 7.0);
    let mut renderer = renderer();
    let albedo = |renderer: &mut MutexGuard<'_, Renderer<'_>>, camera, estimator, flavour, seed| -> Vec<f64> {
        let variant = VariantChoice::GenericForced(Variant::only(flavour));
        let request = request(renderer, camera).with(|r| {
            r.shading.estimator = estimator;
            r.shading.variant = variant;
            r.shading.seed = seed;
        });
        let picture = renderer.render(&request).expect("renders");
        picture.vectors("albedo").expect("requested").iter().flatten().map(|&v| f64::from(v)).collect()
    };
    use Estimator::{Biplanar, Exact, Hex, Stf};
    use Flavour::{FarCliff, NearCliff, Splat};
    // Columns: estimator; flavour; camera; flavour of the mean; negative control. The negative control is an estimator and a flavour whose picture
    // must be rejected as the mean. Most rows use the camera `cliff`, because on horizontal ground a blend of three projections hardly differs from a
    // single projection.
    for (estimator, flavour, camera, of, wrong) in [
        (Biplanar, NearCliff, "cliff", NearCliff, (Exact, Splat)),
        (Biplanar, FarCliff, "cliff", FarCliff, (Exact, NearCliff)),
        (Hex, NearCliff, "ground", NearCliff, (Exact, Splat)),
        (Hex, FarCliff, "cliff", FarCliff, (Exact, NearCliff)),
        (Stf, NearCliff, "ground", NearCliff, (Exact, Splat)),
        (Stf, FarCliff, "cliff", FarCliff, (Exact, NearCliff)),
        // `Stf` reads only one texel and not the heights of the other texels, so its weights are bilinear, like the weights of near cliff.
        (Stf, Splat, "ground", NearCliff, (Exact, Splat)),
    ] {
        let expected = albedo(&mut renderer, camera, estimator.mean(), of, 0);
        let mutant = albedo(&mut renderer, camera, wrong.0, wrong.1, 0);
        let samples: Vec<Vec<f64>> = (0..SEEDS).map(|seed| albedo(&mut renderer, camera, estimator, flavour, seed)).collect();
        let p = |mean: &[f64]| {
            let differences = |s: &Vec<f64>| s.iter().zip(mean).map(|(a, b)| a - b).collect();
            p_of_zero_means(&samples.iter().map(differences).collect::<Vec<_>>(), ROUNDING)
        };
        let (right, wrong) = (p(&expected), p(&mutant));
        let what = format!("{estimator} on {}", flavour.name());
        println!("{what}: p = {right:.3}, negative control {wrong:.1e}");
        assert!(right > level, "{what}: mean differs from {}, p = {right:e}", estimator.mean());
        assert!(wrong < level, "{what}: the picture of the negative control passes for its mean");
    }
}

// ---------------------------------------------------------------- blends that are defined alike

#[test]
fn estimators_agree_where_they_are_defined_alike() {
    let mut renderer = second_renderer();
    // A narrow view of the ground. In a wide view, most flat pixels are so far away that the textures of all projections look alike.
    let mut base = request(&renderer, "ground").with(|r| r.view.pose.fov = 12.0f64.to_radians());
    base.outputs.aovs = AovSet::from_names(&["albedo", "fetches"]).expect("known layers");
    let wall = request(&renderer, "cliff");
    let mut of = |base: &RenderRequest, estimator, flavour| {
        let variant = VariantChoice::GenericForced(Variant::only(flavour));
        renderer
            .render(&base.with(|r| {
                r.shading.estimator = estimator;
                r.shading.variant = variant;
            }))
            .expect("renders")
    };
    let on_wall = [Estimator::Snapped, Estimator::Exact].map(|estimator| of(&wall, estimator, Flavour::Splat));
    let layered = of(&base, Estimator::Luna8, Flavour::Splat);
    let bands = of(&base, Estimator::Laplacian, Flavour::Splat);
    let snapped = of(&base, Estimator::Snapped, Flavour::Splat);
    let two = of(&base, Estimator::Biplanar, Flavour::Splat);
    let mean = of(&base, Estimator::BiplanarMean, Flavour::NearCliff);
    let exact = of(&base, Estimator::Exact, Flavour::Splat);
    let pixels = renderer.drawn_as(&base).and_then(|frame| frame.inspect()).expect("inspects");
    let difference = |a: &Picture, b: &Picture, i: usize| {
        let texel = |p: &Picture| p.vectors("albedo").expect("requested")[i];
        let pairs = texel(a).into_iter().zip(texel(b));
        pairs.map(|(l, r)| f64::from((l - r).abs()) / (f64::from(l.max(r)).max(1.0 / 1024.0) / 2048.0)).fold(0.0, f64::max)
    };
    // On ground that faces up, biplanar mapping uses only the projection from above. So two pairs of pictures on splat must be equal there: the eight
    // layers (`Luna8`) and four materials with bilinear weights (`BiplanarMean` of near cliff); and the snapped projection and `Biplanar`. Biplanar
    // mapping uses one projection up to a slope of 35 degrees of the shading normal. This test computes the slope of the triangle from the
    // derivatives, which may differ, so it uses only triangles of up to 18 degrees.
    let (mut flat, mut uniform) = (Vec::new(), Vec::new());
    for (i, pixel) in pixels.iter().enumerate().filter(|(_, p)| p.slot != 0) {
        let [a, b] = [pixel.ddx, pixel.ddy].map(|v| v.map(f64::from));
        let n = octahedral::unit([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]);
        if n[2].abs() > 0.95 && pixel.splat.iter().all(|&id| id < 8) {
            flat.push(i);
        }
        if pixel.splat.iter().all(|&id| id == pixel.splat[0]) {
            uniform.push(i);
        }
    }
    assert!(flat.len() > 250 && uniform.len() > 500, "{} flat and {} uniform pixels", flat.len(), uniform.len());
    let within =
        |a: &Picture, b: &Picture, at: &[usize]| at.iter().filter(|&&i| difference(a, b, i) <= 2.0).count() as f64 / at.len() as f64;
    // Where the shading normal differs much from the triangle's normal, an estimator may use a horizontal projection although the ground is flat. The
    // test accepts this on a hundredth of the pixels.
    assert!(within(&layered, &mean, &flat) > 0.99, "layers: {}", within(&layered, &mean, &flat));
    assert!(within(&snapped, &two, &flat) > 0.99, "snapped: {}", within(&snapped, &two, &flat));
    // If all four texels have the same material, blending in bands (`Laplacian`) must give this material.
    assert!(within(&bands, &exact, &uniform) > 0.99, "bands: {}", within(&bands, &exact, &uniform));
    // Negative controls: layers differ from splat with weights that are modified by height, bands differ from the exact blend where materials differ,
    // and on a wall, the snapped projection differs from three projections.
    let all: Vec<usize> = (0..pixels.len()).filter(|i| pixels[*i].slot != 0 && !uniform.contains(i)).collect();
    let wall: Vec<usize> = terrain(&on_wall[0]).iter().enumerate().filter(|(_, on)| **on).map(|(i, _)| i).collect();
    let controls = [within(&layered, &two, &flat), within(&bands, &exact, &all), within(&on_wall[0], &on_wall[1], &wall)];
    assert!(wall.len() > 1000 && controls.iter().all(|share| *share < 0.95), "{controls:?} of {} pixels", wall.len());
}

// ---------------------------------------------------------------- tiles and filters

#[test]
fn a_tile_is_shaded_alike_by_one_triangle_and_by_two() {
    let plain = open(GpuOptions { plain: true });
    assert!(!plain.features.contains(wgpu::Features::DEPTH_CLIP_CONTROL));
    if !gpu().features.contains(wgpu::Features::DEPTH_CLIP_CONTROL) {
        println!("left out: this adapter cannot clamp depth, so all tiles are two triangles");
        return;
    }
    let mut by_two = Renderer::new(&plain, &small_scene(), &|_| {}).expect("renders");
    let mut renderer = second_renderer();
    // One of the sizes is not a multiple of the size of a tile. The pictures show sky at the top, and terrain both near and far.
    for (camera, size) in [("cliff", [101, 67]), ("vista", [64, 48])] {
        // The first request draws all tiles from one list, each pixel with the flavours that it needs. The second request draws all tiles from the
        // list of one variant. A tile that wrote beyond its borders would give the pixels there the wrong flavours. More lists are not tested,
        // because each of them needs a further shader.
        let [auto, forced] = [VariantChoice::GenericAuto, VariantChoice::Forced(Variant::only(Flavour::FarAtlas))].map(|variant| {
            request(&renderer, camera).with(|r| {
                r.view.size = size;
                r.shading.variant = variant;
                r.outputs.keep_geometry = false;
            })
        });
        for wanted in [&auto, &forced] {
            let (one, two) = (renderer.render(wanted).expect("renders"), by_two.render(wanted).expect("renders"));
            assert_eq!(one.hdr, two.hdr, "{camera}");
        }
        // Negative control: a jittered view gives a different picture.
        let other = auto.with(|r| r.view.jitter = [0.5, 0.0]);
        assert_ne!(by_two.render(&other).expect("renders").hdr, renderer.render(&auto).expect("renders").hdr);
    }
}

/// Returns three levels of detail for each row of (ddx, ddy, rate): first, the level that the shader computes; second, the level that the device uses
/// if the texture is sampled at that level; third, the level that the device uses if the texture is sampled with gradients. Each level of the texture
/// contains its own number, so a sample shows which level was used. `change`: a text of the shader, and its replacement; if both are empty, the
/// shader is not changed.
fn levels_of_detail(rows: &[[f32; 8]], change: (&str, &str)) -> Vec<[f32; 3]> {
    let gpu = gpu();
    let body = "
@group(2) @binding(0) var<storage, read> rows: array<array<f32, 8>>;
@group(2) @binding(1) var<storage, read_write> found: array<array<f32, 3>>;
@compute @workgroup_size(64)
fn lod_main(@builtin(global_invocation_id) id: vec3<u32>) {
    if id.x >= arrayLength(&rows) { return; }
    let row = rows[id.x];
    let footprint = Footprint(Place(vec2<i32>(0), vec3<f32>(0.0)), vec3<f32>(row[0], row[1], row[2]), vec3<f32>(row[3], row[4], row[5]));
    let projection = terrain_projection(0u, footprint);
    let rate = vec2<f32>(row[6], row[7]);
    let lod = terrain_lod(projection, rate);
    let level = textureSampleLevel(detail_albedo, detail_sampler, vec2<f32>(0.3), 0u, lod).r;
    let dx = terrain_turn(projection.ddx, rate);
    let dy = terrain_turn(projection.ddy, rate);
    found[id.x] = array<f32, 3>(lod, level, textureSampleGrad(detail_albedo, detail_sampler, vec2<f32>(0.3), 0u, dx, dy).r);
}";
    let mut pieces = wgsl::pieces(&[&kernels::terrain::WGSL]);
    pieces.push(Piece::new("lod", body));
    if !change.0.is_empty() {
        pieces.iter_mut().for_each(|piece| piece.text = piece.text.replace(change.0, change.1));
    }
    let shader = kernels::gpu::Shader::new(gpu, "lod", pieces).unwrap_or_else(|e| panic!("{e}"));
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: None,
        layout: None,
        module: &shader.module,
        entry_point: Some("lod_main"),
        compilation_options: wgpu::PipelineCompilationOptions::default(),
        cache: None,
    });
    const LEVELS: u32 = 9;
    let edge = 1 << (LEVELS - 1);
    let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
        label: None,
        size: wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: 1 },
        mip_level_count: LEVELS,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format: wgpu::TextureFormat::R16Float,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    // The whole numbers from 0 to 8 as f16.
    const F16: [u16; 9] = [0, 0x3c00, 0x4000, 0x4200, 0x4400, 0x4500, 0x4600, 0x4700, 0x4800];
    for (level, code) in (0..LEVELS).zip(F16) {
        let edge = edge >> level;
        let texels = vec![code; (edge * edge) as usize];
        gpu.queue.write_texture(
            wgpu::TexelCopyTextureInfo { mip_level: level, ..texture.as_image_copy() },
            bytemuck::cast_slice(&texels),
            wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(edge * 2), rows_per_image: None },
            wgpu::Extent3d { width: edge, height: edge, depth_or_array_layers: 1 },
        );
    }
    let linear = wgpu::FilterMode::Linear;
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        mag_filter: linear,
        min_filter: linear,
        mipmap_filter: wgpu::MipmapFilterMode::Linear,
        ..Default::default()
    });
    let mut uniforms: FrameUniforms = bytemuck::Zeroable::zeroed();
    (uniforms.sector_m, uniforms.gradient_scale) = (64.0, 1.0);
    let frame = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytemuck::bytes_of(&uniforms));
    let input = gpu.buffer_with("rows", wgpu::BufferUsages::STORAGE, bytemuck::cast_slice(rows));
    let bytes = 12 * rows.len() as u64;
    let output = gpu.buffer("found", wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC, bytes);
    let view = kernels::gpu::bindings::array(&texture);
    let bind = |group: u32, entries: &[(u32, wgpu::BindingResource<'_>)]| {
        let entries: Vec<_> =
            entries.iter().map(|(binding, resource)| wgpu::BindGroupEntry { binding: *binding, resource: resource.clone() }).collect();
        gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(group),
            entries: &entries,
        })
    };
    let groups = [
        bind(0, &[(0, frame.as_entire_binding())]),
        bind(1, &[(7, wgpu::BindingResource::TextureView(&view)), (10, wgpu::BindingResource::Sampler(&sampler))]),
        bind(2, &[(0, input.as_entire_binding()), (1, output.as_entire_binding())]),
    ];
    let mut encoder = gpu.encoder("lod");
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        for (index, group) in (0..).zip(&groups) {
            pass.set_bind_group(index, group, &[]);
        }
        pass.dispatch_workgroups(u32::try_from(rows.len().div_ceil(64)).expect("few"), 1, 1);
    }
    gpu.submit_and_wait(encoder).unwrap_or_else(|e| panic!("{e}"));
    bytemuck::pod_collect_to_vec(&kernels::gpu::read_buffer(gpu, &output, bytes).unwrap_or_else(|e| panic!("{e}")))
}

#[test]
fn filtering_by_lod_is_filtering_by_gradients() {
    let rows: Vec<[f32; 8]> = (0..2000)
        .map(|index| {
            let (dx, dy) = (direction(2 * index), direction(2 * index + 1));
            let (length, ratio) = ((9.0 * unit(index, 0) - 9.0).exp2(), unit(index, 1));
            let (sin, cos) = (unit(index, 2) * 6.3).sin_cos();
            let row = [dx[0], dx[1], dx[2], dy[0] * ratio, dy[1] * ratio, dy[2] * ratio].map(|v| (v * length) as f32);
            [row[0], row[1], row[2], row[3], row[4], row[5], cos as f32, sin as f32]
        })
        .collect();
    // Smallest number of steps that a device distinguishes between two levels: 16. The limit for gradients adds half a level, because a device may
    // approximate the length of a gradient. It may use any number from the larger component to the sum of both components, which differs from the
    // length by a factor of at most √2 (Vulkan, "Scale Factor Operation, Level-of-Detail Operation").
    const STEP: f32 = 1.0 / 16.0;
    let worst = |found: &[[f32; 3]]| {
        found.iter().fold([0.0_f32; 2], |most, [lod, level, by_gradients]| {
            let lod = lod.clamp(0.0, 8.0);
            [most[0].max((level - lod).abs()), most[1].max((by_gradients - lod).abs())]
        })
    };
    let [level, by_gradients] = worst(&levels_of_detail(&rows, ("", "")));
    println!("sampling at the computed level is off by {level} levels, sampling with gradients by {by_gradients}");
    assert!(level <= STEP && by_gradients <= 0.5 + STEP, "{level} {by_gradients}");
    // Negative controls: the shorter of the two gradients is used; a level stands for a factor of 4 instead of 2; the size of the texture is ignored.
    for change in [
        ("max(dot(ddx, ddx), dot(ddy, ddy))", "min(dot(ddx, ddx), dot(ddy, ddy))"),
        ("return 0.5 * log2(max(projection", "return 0.25 * log2(max(projection"),
        ("return f32(firstLeadingBit(texels));", "return 7.0;"),
    ] {
        assert!(kernels::terrain::WGSL.text.contains(change.0), "{} is not there", change.0);
        assert!(worst(&levels_of_detail(&rows, change))[1] > 0.5 + STEP, "the levels are accepted with the mutant `{}`", change.1);
    }
}

// ---------------------------------------------------------------- biplanar

#[test]
fn biplanar_weights_let_the_third_axis_go() {
    // Weights of the three axes; the weight of an axis without a projection is 0.
    type Weights = dyn Fn([f64; 3]) -> [f64; 3];
    fn spread(axes: [u32; 2], w: [f64; 2]) -> [f64; 3] {
        std::array::from_fn(|i| (0..2).filter(|&k| axes[k] as usize == i).map(|k| w[k]).sum())
    }
    let ours = |n: [f64; 3]| {
        let (axes, w) = biplanar::projections(n, 8.0);
        spread(axes, w)
    };
    // Mutant: tri-planar weights of the two largest components, normalised.
    let largest_two = |n: [f64; 3]| {
        let (axes, _) = biplanar::projections(n, 8.0);
        let w = triplanar::weights(n, 8.0);
        let [a, b] = axes.map(|axis| w[axis as usize]);
        spread(axes, [a / (a + b), b / (a + b)])
    };
    // Returns the largest change of the weights at normals whose two smallest components exchange their order. Normals near the diagonals are left
    // out, because the blend jumps there.
    let largest_jump = |weights: &Weights| {
        let mut most = 0.0_f64;
        for index in 0..2000 {
            // The two smallest components of each normal differ by 2e-7. In the two normals that are compared, they have the opposite order.
            let (t, s) = (0.9 * unit(index, 0), if index % 2 == 0 { 1.0 } else { -1.0 });
            let axis = (index % 3) as usize;
            let at = |e: f64| {
                let mut n = [0.0; 3];
                n[axis] = s;
                n[(axis + 1) % 3] = t + e;
                n[(axis + 2) % 3] = t - e;
                weights(octahedral::unit(n))
            };
            let (a, b) = (at(1e-7), at(-1e-7));
            most = most.max((0..3).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max));
        }
        most
    };
    assert!(largest_jump(&ours) < 1e-5, "{}", largest_jump(&ours));
    assert!(largest_jump(&largest_two) > 0.01, "the mutant has no seam");
    for index in 0..5000 {
        let n = direction(index);
        let (axes, w) = biplanar::projections(n, 16.0 * unit(index, 3));
        assert!(axes[0] < axes[1] && axes[1] < 3 && (w[0] + w[1] - 1.0).abs() < 1e-12 && w[0].min(w[1]) >= 0.0);
        // The axis that is left out has the smallest component.
        let left = 3 - axes[0] - axes[1];
        assert!(axes.iter().all(|&axis| n[axis as usize].abs() >= n[left as usize].abs()));
    }
    // Quilez' remapping: at 45 degrees both weights are equal, and at 30 degrees one axis has all the weight.
    assert_eq!(biplanar::projections([1.0, 0.0, 1.0], 8.0), ([0, 2], [0.5, 0.5]));
    assert_eq!(biplanar::projections([0.5, 0.0, 0.75_f64.sqrt()], 8.0).1, [0.0, 1.0]);
}

// ---------------------------------------------------------------- hex tiling

const SECTOR_M: f64 = 64.0;

/// Returns the ids of the hexagons around a point, and their weights.
fn hexagons(sector: [i32; 2], position: [f64; 2]) -> Vec<([u32; 2], f64)> {
    let t = hex_tiling::at(sector, position, SECTOR_M, 6);
    t.ids.into_iter().zip(t.weights).collect()
}

/// Returns the largest difference between the weights of a hexagon in both lists. A hexagon that is absent from a list has weight 0 there.
fn weight_difference(a: &[([u32; 2], f64)], b: &[([u32; 2], f64)]) -> f64 {
    let weight = |of: &[([u32; 2], f64)], id| of.iter().filter(|(other, _)| *other == id).map(|(_, w)| w).sum::<f64>();
    a.iter().chain(b).map(|&(id, _)| (weight(a, id) - weight(b, id)).abs()).fold(0.0, f64::max)
}

#[test]
fn hexagons_fit_together() {
    type Tiling = dyn Fn([i32; 2], [f64; 2]) -> Vec<([u32; 2], f64)>;
    // Mutant: a lattice that starts again in each sector.
    let per_sector = |_: [i32; 2], position: [f64; 2]| hexagons([0; 2], position);
    // Returns the largest change of a weight between two neighbouring points of lines that cross a sector's border. If there is no seam, the change
    // is at most the slope of the weight times the distance of the points. This must hold at any distance from the origin.
    let largest_jump = |tiling: &Tiling, sector: i32| {
        let mut most = 0.0_f64;
        for line in 0..20 {
            let slope = unit(line, 1) - 0.5;
            let at = |i: i32| {
                let x = 60.0 + 8.0 * f64::from(i) / 20_000.0;
                let y = 30.0 + slope * x;
                let over = f64::from(x >= SECTOR_M);
                tiling([sector + i32::from(x >= SECTOR_M), -sector], [x - over * SECTOR_M, y])
            };
            most = (1..20_000).map(|i| weight_difference(&at(i), &at(i - 1))).fold(most, f64::max);
        }
        most
    };
    // Hexagon centres are 1 m apart here, and neighbouring points less than 0.0005 m. The largest slope of a weight, found numerically, is about 9
    // per metre, so a weight changes by less than 0.005 if there is no seam. The limit is four times this change.
    for sector in [0, 156, 15_625, -1_000_000] {
        assert!(largest_jump(&hexagons, sector) < 0.02, "sector {sector}: {}", largest_jump(&hexagons, sector));
    }
    assert!(largest_jump(&per_sector, 0) > 0.5, "the mutant has no seam");
    let (mut contrast, mut lone) = (0.0, 0.0_f64);
    for index in 0..20_000 {
        let t = hex_tiling::at([3, -5], [unit(index, 0) * SECTOR_M, unit(index, 1) * SECTOR_M], SECTOR_M, 6);
        assert!((t.weights.iter().sum::<f64>() - 1.0).abs() < 1e-12 && t.weights.iter().all(|w| *w >= 0.0));
        assert!(t.ids[0] != t.ids[1] && t.ids[1] != t.ids[2] && t.ids[0] != t.ids[2]);
        contrast += t.weights.iter().map(|w| w * w).sum::<f64>() / 20_000.0;
        lone = lone.max(t.weights.iter().fold(0.0, |m, &w| m.max(w)));
    }
    // The mean of w1^2 + w2^2 + w3^2 is the share of a texture's variance that remains after blending. By numerical integration, it is 0.8835 (with
    // barycentric weights, it would be 0.5). The mean computed here has a standard error of 0.0014, and the tolerance is five standard errors.
    assert!((contrast - 0.8835).abs() < 0.007 && lone > 0.9999, "{contrast} {lone}");
    // At its centre, a hexagon has all the weight. In six directions, the next centre is 1 m away. The rows of hexagons are 0.13 % closer together
    // than in a regular lattice, so four of the six distances are 0.1 % too short.
    let rows = SECTOR_M / 64.0 / (2.0 * 37.0 / 64.0);
    for step in [[1.0, 0.0], [0.5, rows], [-0.5, rows]] {
        let at = hexagons([0; 2], [10.0 + step[0], 20.0 * rows + step[1]]);
        assert!(at.iter().any(|(_, w)| *w > 0.999_999), "{step:?}: {at:?}");
        assert!((dot::<f64, 2>(step, step).sqrt() - 1.0).abs() < 0.0013);
    }
    // The level gives about 2 sqrt 3 hexagons per repeat of the texture. The number is not exact, because the number of hexagons along a sector is
    // rounded to a power of two.
    for repeats in [1.0, 16.0, 21.3, 32.0, 1000.0] {
        let ratio = f64::from(hex_tiling::level(repeats)).exp2() / (repeats * 12.0_f64.sqrt());
        assert!((0.7..1.42).contains(&ratio), "{repeats}: {ratio}");
    }
}

// ---------------------------------------------------------------- stochastic texel choice

#[test]
fn chosen_texels_are_the_filter_in_the_mean() {
    // An evenly spaced grid replaces the random numbers. The share of the grid that chooses a mip level or a texel must equal the weight of this
    // level or texel in the filter, to within the grid's step.
    const STEPS: u32 = 4096;
    let share = |chosen: &dyn Fn(f64) -> u32, of: u32| {
        (0..STEPS).filter(|&i| chosen((f64::from(i) + 0.5) / f64::from(STEPS)) == of).count() as f64 / f64::from(STEPS)
    };
    let tolerance = 1.0 / f64::from(STEPS);
    for index in 0..50 {
        let lod = 12.0 * unit(index, 0) - 2.0;
        let held = lod.clamp(0.0, 7.0);
        for level in 0..8_u32 {
            let weight = (1.0 - (held - f64::from(level)).abs()).max(0.0);
            assert!((share(&|u| texel_choice::level(lod, 8, u), level) - weight).abs() <= tolerance, "lod {lod}, level {level}");
        }
        let coordinate = 40.0 * unit(index, 1) - 20.0;
        for texel in 0..8_u32 {
            // Distance from the texel's centre, modulo the repeat.
            let x = (coordinate * 8.0 - 0.5 - f64::from(texel)).rem_euclid(8.0);
            let weight = (1.0 - x.min(8.0 - x)).max(0.0);
            assert!((share(&|u| texel_choice::texel(coordinate, 8, u), texel) - weight).abs() <= tolerance, "{coordinate}, texel {texel}");
            // Negative control: if the texel that contains the coordinate is always chosen, the shares are not the weights of the filter.
            let nearest = |_: f64| (coordinate * 8.0).floor().rem_euclid(8.0) as u32;
            assert!(weight <= tolerance || weight >= 1.0 - tolerance || (share(&nearest, texel) - weight).abs() > tolerance);
        }
    }
}

// ---------------------------------------------------------------- layers

#[test]
fn layers_weigh_what_their_texels_weigh() {
    for index in 0..2000 {
        let texels = splat_blend::bilinear([unit(index, 0), unit(index, 1)]);
        let of: [u32; 4] = std::array::from_fn(|i| hash::pcg4d([index, i as u32, 5, 5])[0] % 8);
        let shares: [f64; 8] = std::array::from_fn(|layer| layers::share(texels, of, layer as u32));
        let mut below = 0.0;
        let mut opacities = [0.0; 8];
        for layer in 0..8 {
            opacities[layer] = layers::opacity(layer as u32, shares[layer], below);
            below += shares[layer];
        }
        let weights = layers::weights(opacities);
        assert!((weights.iter().sum::<f64>() - 1.0).abs() < 1e-12, "the weights must have a sum of 1, because layer 0 is opaque");
        assert!(weights.iter().zip(shares).all(|(w, m)| (w - m).abs() < 1e-12), "{weights:?}, {shares:?}");
        // Blending layer by layer, as the shader does, gives the same weights.
        let mut blended = [0.0; 8];
        for layer in 0..8 {
            blended = blended.map(|b| b * (1.0 - opacities[layer]));
            blended[layer] += opacities[layer];
        }
        assert!(blended.iter().zip(weights).all(|(b, w)| (b - w).abs() < 1e-12));
        // Negative control: shares used as opacities give wrong weights.
        let mut wrong = shares;
        wrong[0] = 1.0;
        let several = shares.iter().filter(|m| **m > 0.1).count() > 2;
        assert!(!several || layers::weights(wrong).iter().zip(shares).any(|(w, m)| (w - m).abs() > 0.001));
    }
}

#[test]
fn materials_beyond_the_eighth_are_shown_by_the_nearest_layer() {
    let scene = small_scene();
    assert!(scene.materials.len() > layers::LAYERS, "the test needs materials without a layer");
    let palette = Palette::build(&scene, SECTOR_M, |_| Ok(())).expect("the palette builds");
    let layer = |m: usize| (palette.entries[m].flags >> LAYER_SHIFT & 7) as usize;
    for m in 0..palette.entries.len() {
        let distance = |l: usize| (0..3).map(|c| (palette.means[l].albedo[c] - palette.means[m].albedo[c]).powi(2)).sum::<f32>();
        assert!((0..layers::LAYERS).all(|l| distance(layer(m)) <= distance(l)), "material {m} is shown by {}", layer(m));
        assert!(m >= layers::LAYERS || layer(m) == m);
    }
    // Negative control: not all materials beyond the eighth are shown by layer 0, the default.
    assert!((layers::LAYERS..palette.entries.len()).any(|m| layer(m) != 0));
}

// ---------------------------------------------------------------- one projection

#[test]
fn the_snapped_plane_is_the_nearest_and_keeps_lengths() {
    // Azimuth of the direction along which the texture is projected onto a plane, degrees, modulo 180.
    let azimuth = |plane: u32| [0.0, 90.0, f64::NAN, 45.0, 135.0][plane as usize];
    let mut seen = [0; 5];
    for index in 0..5000 {
        let n = direction(index);
        let plane = snapped_projection::plane(n, kernels::shading::SNAPPED_COSINE);
        seen[plane as usize] += 1;
        assert_eq!(plane == 2, n[2].abs() >= 0.8);
        if plane == 2 {
            continue;
        }
        let off = (n[1].atan2(n[0]).to_degrees() - azimuth(plane)).rem_euclid(180.0);
        assert!(off.min(180.0 - off) <= 22.5 + 1e-9, "{n:?} is {off} degrees off plane {plane}");
        // A horizontal step of 1 m along the plane changes the first coordinate by 1 m (on a diagonal plane by 0.011 % less), and a step across the
        // plane does not change it.
        let (sin, cos) = azimuth(plane).to_radians().sin_cos();
        let [along, up] = snapped_projection::coordinates([-sin, cos, 0.0], plane);
        assert!((along.abs() - 1.0).abs() < 2e-4 && up.abs() < 1e-12, "plane {plane}: {along}");
        assert!(snapped_projection::coordinates([cos, sin, 0.0], plane)[0].abs() < 1e-12);
        // Coordinates and gradients are consistent: a height that equals the first coordinate has a gradient in the direction in which this
        // coordinate grows.
        let g = snapped_projection::from_gradient([along.signum(), 0.0], plane);
        assert!((dot(g, [-sin, cos, 0.0]) - 1.0).abs() < 1e-9, "plane {plane}: {g:?}");
    }
    assert!(seen.iter().all(|&count| count > 200), "{seen:?}");
    // Texture coordinates must be continuous across sector borders, near the origin and far from it. The only error is in the number of repeats per
    // sector. It is rounded to units of 2^-24, on diagonal planes twice. The tolerance is 4 units.
    let per_sector = tiling::per_sector_fixed(SECTOR_M, 3.7);
    let repeats = tiling::repeats(SECTOR_M, 3.7);
    let coordinate = |place: [i32; 3], inside: [f64; 3], plane: u32| {
        let sectors = snapped_projection::sectors(place, plane);
        let whole: f64 = tiling::fixed(sectors[0], snapped_projection::fixed(per_sector, plane), 0);
        whole + snapped_projection::coordinates(inside, plane)[0] / SECTOR_M * repeats
    };
    for plane in [0, 1, 2, 3, 4] {
        for (place, step) in [([0, 0, 0], 0), ([155, -40, 20], 1), ([-1_000_000, 1_000_000, 3], 0)] {
            let mut beyond = place;
            beyond[step] += 1;
            let mut edge = [12.0, 34.0, 5.0];
            edge[step] = SECTOR_M;
            let mut start = edge;
            start[step] = 0.0;
            let gap = coordinate(place, edge, plane) - coordinate(beyond, start, plane);
            assert!((gap - gap.round()).abs() < 4.0 / 16_777_216.0, "plane {plane}, sector {place:?}: {gap}");
        }
    }
}

// ---------------------------------------------------------------- the blend that is accumulated term by term

#[test]
fn weights_term_by_term_are_the_weights() {
    for index in 0..5000 {
        let fraction = [unit(index, 0), unit(index, 1)];
        let heights: [f64; 4] = std::array::from_fn(|i| unit(index, 2 + i as u32));
        let sharpness = (12.0 * unit(index, 6) - 2.0).exp2();
        let mut run = splat_blend::Run::start();
        let mut sum = [0.0; 4];
        let mut kept = Vec::new();
        for (i, w) in splat_blend::bilinear(fraction).into_iter().enumerate() {
            run = run.add(w, heights[i], sharpness);
            sum = sum.map(|s| s * run.keep);
            sum[i] = run.share;
            kept.push(run.keep);
            assert!(run.keep >= 0.0 && run.share >= 0.0 && run.keep.max(run.share) == 1.0);
        }
        let total: f64 = sum.iter().sum();
        let weights = splat_blend::weights(fraction, heights, sharpness);
        let differs = |sum: [f64; 4], total: f64| sum.iter().zip(weights).any(|(s, w)| (s / total - w).abs() > 1e-9);
        assert!(total >= 1.0 && !differs(sum, total), "{sum:?} {weights:?}");
        // Negative control: the sum so far is not multiplied by `keep`.
        let shares: [f64; 4] = {
            let mut run = splat_blend::Run::start();
            let bilinear = splat_blend::bilinear(fraction);
            std::array::from_fn(|i| {
                run = run.add(bilinear[i], heights[i], sharpness);
                run.share
            })
        };
        let moved = kept[1..].iter().any(|k| *k < 0.9 && *k > 0.1);
        assert!(!moved || differs(shares, shares.iter().sum()));
    }
}

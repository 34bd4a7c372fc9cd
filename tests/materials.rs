//! Tests detail textures: procedural maps, folders of images, block compression, and the palette of a scene's materials.
//!
//! The tests are quick, because their textures have at most 256 texels per side. No test needs a GPU. Scanned materials are read only if the
//! environment variable `SCREE_DATA` names a data folder.

use std::path::{Path, PathBuf};

use kernels::base::error::Error;
use kernels::materials::arrays::{self, CompressedChain};
use kernels::materials::{FLAG_TINTED, MAX_LAYERS, MaterialMaps, MaterialMeans, Palette, PaletteEntry, folder, procedural};
use kernels::scene::Scene;

const SECTOR_M: f64 = 64.0;

/// A scene with `[[material]]` tables; each string holds the lines of one table.
fn scene(detail_size: u32, materials: &[String]) -> Scene {
    let mut text = format!("name = \"test\"\ndetail_size = {detail_size}\nrule = []\n[world]\nkind = \"procedural\"\nseed = 1\n");
    for material in materials {
        text.push_str("[[material]]\n");
        text.push_str(material);
        text.push('\n');
    }
    toml::from_str(&text).expect("the text above follows the schema")
}

fn procedural_material(name: &str, kind: &str, more: &str) -> String {
    format!("name = \"{name}\"\nprocedural = \"{kind}\"\ntile_m = 3.0\n{more}")
}

fn build(scene: &Scene) -> Result<Palette, String> {
    Palette::build(scene, SECTOR_M, |_| Ok(())).map_err(|error| {
        let text = error.to_string();
        assert!(!text.contains('\n'), "an error is one line: {text}");
        text
    })
}

fn make(name: &str, size: u32) -> MaterialMaps {
    procedural::make(name, size, 5).expect("a built-in name")
}

fn srgb_from_linear(x: f64) -> f64 {
    255.0 * if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 }
}

fn mean(values: impl ExactSizeIterator<Item = f64>) -> f64 {
    let count = values.len() as f64;
    values.sum::<f64>() / count
}

fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let (ma, mb) = (mean(a.iter().copied()), mean(b.iter().copied()));
    let (mut ab, mut aa, mut bb) = (0.0, 0.0, 0.0);
    for (x, y) in a.iter().zip(b) {
        ab += (x - ma) * (y - mb);
        aa += (x - ma).powi(2);
        bb += (y - mb).powi(2);
    }
    ab / (aa * bb).sqrt()
}

#[test]
fn nobody_waits_for_textures_that_are_given_up() {
    use std::sync::atomic::{AtomicUsize, Ordering};
    let materials: Vec<String> = procedural::NAMES.iter().map(|kind| procedural_material(kind, kind, "")).collect();
    let scene = scene(64, &materials);
    let begun = AtomicUsize::new(0);
    let give_up = |_: &str| {
        begun.fetch_add(1, Ordering::Relaxed);
        Err(Error::Request("enough".to_owned()))
    };
    let error = Palette::build(&scene, SECTOR_M, give_up).err().map(|error| error.to_string());
    assert!(error.is_some_and(|text| text == "enough") && begun.load(Ordering::Relaxed) < materials.len());
}

// ------------------------------------------------------------------------------------------------------------------ procedural maps

#[test]
fn every_procedural_material_fills_its_maps_within_range() {
    for name in procedural::NAMES {
        let maps = make(name, 64);
        let count = 64 * 64;
        assert_eq!(maps.size, 64, "{name}");
        for (map, values) in [
            ("smoothness", &maps.smoothness),
            ("specular occlusion", &maps.specular_occlusion),
            ("height", &maps.height),
            ("colour mask", &maps.colour_mask),
        ] {
            assert_eq!(values.len(), count, "{name}: {map}");
            assert!(values.iter().all(|v| (0.0..=1.0).contains(v)), "{name}: {map} leaves 0..1");
        }
        assert_eq!(maps.albedo.len(), count, "{name}");
        assert!(maps.albedo.iter().flatten().all(|v| (0.0..1.0).contains(v)), "{name}: albedo leaves 0..1");
        assert_eq!(maps.normal.len(), count, "{name}");
        assert!(maps.normal.iter().all(|n| n[0].hypot(n[1]) < 1.0), "{name}: a normal points below the surface");
        let (low, high) = maps.height.iter().fold((1.0_f32, 0.0_f32), |(l, h), &v| (l.min(v), h.max(v)));
        assert!(low < 1e-6 && high > 1.0 - 1e-6, "{name}: height spans {low}..{high}, not all of 0..1");
    }
}

#[test]
fn procedural_albedos_are_those_of_the_real_ground() {
    // (name, lowest and highest allowed mean luminance, index of the brightest channel)
    let expected: [(&str, f64, f64, usize); 6] = [
        ("snow", 0.75, 0.85, 2),
        ("granite", 0.20, 0.30, 0),
        ("grass", 0.05, 0.12, 1),
        ("sand", 0.30, 0.45, 0),
        ("moss", 0.05, 0.12, 1),
        ("mud", 0.03, 0.10, 0),
    ];
    for (name, low, high, greatest) in expected {
        let rgb = MaterialMeans::of(&make(name, 64), [1.0; 3]).albedo.map(f64::from);
        let y = 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2];
        assert!((low..=high).contains(&y), "{name}: luminance {y:.3} is not in {low}..{high}");
        assert!(rgb.iter().all(|&c| c <= rgb[greatest] + 0.002), "{name}: {rgb:.3?}, channel {greatest} must be the brightest");
    }
}

#[test]
fn a_procedural_material_depends_on_name_size_and_seed_alone() {
    for name in procedural::NAMES {
        assert_eq!(make(name, 64), make(name, 64), "{name}");
        let other = procedural::make(name, 64, 6).expect("a built-in name");
        assert!(make(name, 64).height != other.height, "{name}: the seed changes nothing");
    }
    // The appearance must not depend on the size of the maps, so their mean albedos must agree. They would not agree if the size of patterns were
    // fixed in texels.
    for name in ["scree", "moss", "sand", "limestone"] {
        let [small, large] = [128, 256].map(|size| MaterialMeans::of(&make(name, size), [1.0; 3]));
        for c in 0..3 {
            assert!((small.albedo[c] / large.albedo[c] - 1.0).abs() < 0.05, "{name}: {small:?} {large:?}");
        }
    }
}

/// Compares the step of a map's values across its wrapped edge with the steps inside the map. Returns the mean absolute difference between the last
/// and the first column, divided by the largest mean absolute difference between neighbouring columns, or the same ratio for rows, if it is larger.
/// Uses the first `n` rows and columns of a map with `stride` texels per row.
fn seam(height: &[f32], stride: usize, n: usize) -> f64 {
    let step = |a: usize, b: usize, rows: bool| {
        let at = |i: usize, k: usize| f64::from(if rows { height[i * stride + k] } else { height[k * stride + i] });
        mean((0..n).map(|k| (at(a, k) - at(b, k)).abs()))
    };
    [false, true]
        .map(|rows| {
            let inside = (1..n).map(|i| step(i - 1, i, rows)).fold(0.0, f64::max);
            step(n - 1, 0, rows) / inside
        })
        .into_iter()
        .fold(0.0, f64::max)
}

#[test]
fn procedural_materials_tile_without_a_seam() {
    const LIMIT: f64 = 1.2; // without a seam, the step across the edge is hardly larger than the largest of the 127 steps inside
    for name in procedural::NAMES {
        let maps = make(name, 128);
        let ratio = seam(&maps.height, 128, 128);
        assert!(ratio < LIMIT, "{name}: the step across the edge is {ratio:.2} times the greatest inside");
        let green: Vec<f32> = maps.albedo.iter().map(|c| c[1]).collect();
        let ratio = seam(&green, 128, 128);
        assert!(ratio < LIMIT, "{name}: albedo's step across the edge is {ratio:.2} times the greatest inside");
    }
    // Negative control: the first 128 rows and columns of a map of 256 x 256 texels do not continue at their own edge, so this part has seams.
    for name in ["granite", "mud", "sand", "snow", "limestone"] {
        let ratio = seam(&make(name, 256).height, 256, 128);
        assert!(ratio > LIMIT, "{name}: this test finds no seam in a cropped tile ({ratio:.2})");
    }
}

#[test]
fn normals_are_the_gradient_of_height() {
    let n = 128;
    for name in procedural::NAMES {
        let maps = make(name, n as u32);
        let relief = f64::from(procedural::relief(name).expect("a built-in name"));
        let at = |x: usize, y: usize| f64::from(maps.height[(y % n) * n + x % n]);
        let (mut slope, mut normal) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        for y in 0..n {
            for x in 0..n {
                slope[0].push(-(at(x + 1, y) - at(x + n - 1, y)) * n as f64 / 2.0);
                slope[1].push(-(at(x, y + 1) - at(x, y + n - 1)) * n as f64 / 2.0);
                let t = maps.normal[y * n + x].map(f64::from);
                let z = (1.0 - t[0] * t[0] - t[1] * t[1]).sqrt();
                normal[0].push(t[0] / z);
                normal[1].push(t[1] / z);
            }
        }
        for axis in 0..2 {
            let r = correlation(&normal[axis], &slope[axis]);
            assert!(r > 0.9, "{name}: normal and height disagree along axis {axis} (r = {r:.3})");
            let scale =
                normal[axis].iter().zip(&slope[axis]).map(|(n, s)| n * s).sum::<f64>() / slope[axis].iter().map(|s| s * s).sum::<f64>();
            assert!((scale / relief - 1.0).abs() < 0.01, "{name}: slope is {scale:.4} times the height's, expected {relief:.4}");
            // Negative controls: the slope along the other axis must correlate less with the normal, and a normal with the opposite sign must
            // correlate negatively.
            assert!(correlation(&normal[axis], &slope[1 - axis]).abs() < 0.6, "{name}: this test cannot tell u from v");
            let flipped: Vec<f64> = normal[axis].iter().map(|x| -x).collect();
            assert!(correlation(&flipped, &slope[axis]) < 0.0, "{name}: this test cannot tell the sign");
        }
    }
}

#[test]
fn an_unknown_procedural_name_is_told_with_the_nearest() {
    let text = procedural::make("granit", 64, 0).expect_err("not a built-in name").to_string();
    assert!(text.contains("`granit`") && text.contains("did you mean `granite`"), "{text}");
    let text = build(&scene(64, &[procedural_material("cliff", "lime-stone", "")])).expect_err("not a built-in name");
    assert!(text.contains("`cliff`") && text.contains("`limestone`"), "{text}");
}

// ---------------------------------------------------------------------------------------------------------------------- compression

#[test]
fn chains_have_every_mip_down_to_one_block() {
    let layers = arrays::compress(&make("dirt", 64));
    let check = |chain: &CompressedChain, size: u32, block_bytes: usize| {
        assert_eq!(chain.size, size);
        assert_eq!(chain.levels.len(), size.ilog2() as usize + 1);
        for (level, blocks) in chain.levels.iter().enumerate() {
            let edge = (size as usize >> level).max(1);
            assert_eq!(chain.level_size(level) as usize, edge);
            assert_eq!(blocks.len(), edge.div_ceil(4).pow(2) * block_bytes, "level {level}");
            assert_eq!(chain.decode(level).len(), edge * edge);
        }
    };
    check(&layers.albedo, 64, 8);
    check(&layers.normal, 64, 16);
    check(&layers.height, 32, 8);
}

#[test]
fn channels_lie_where_shaders_expect_them() {
    let flat = |v: f32| vec![v; 64 * 64];
    let maps = MaterialMaps {
        size: 64,
        albedo: vec![[0.8, 0.2, 0.05]; 64 * 64],
        normal: vec![[-0.6, 0.4]; 64 * 64],
        smoothness: flat(0.2),
        specular_occlusion: flat(0.9),
        height: flat(0.6),
        colour_mask: flat(0.25),
    };
    let layers = arrays::compress(&maps);
    let near = |what: &str, chain: &CompressedChain, expected: [f64; 4]| {
        for level in 0..chain.levels.len() {
            for texel in chain.decode(level) {
                for c in 0..4 {
                    // The tolerance covers the rounding of the end points of a block. They have at least 5 bits per channel, so they are off by at
                    // most half a step, which is 255 / 31 / 2 = 4.1.
                    assert!((f64::from(texel[c]) - expected[c]).abs() <= 4.2, "{what} level {level}: {texel:?}, expected {expected:.1?}");
                }
            }
        }
    };
    near("albedo", &layers.albedo, [srgb_from_linear(0.8), srgb_from_linear(0.2), srgb_from_linear(0.05), 255.0]);
    near("normal", &layers.normal, [0.2 * 255.0, 0.7 * 255.0, 0.9 * 255.0, 0.2 * 255.0]);
    near("height", &layers.height, [0.6 * 255.0, 0.25 * 255.0, 0.0, 255.0]);
}

#[test]
fn mips_average_linear_light() {
    // The texture is a checkerboard of black and white texels. In linear light its mean is 0.5, which is the sRGB code 188, not 128.
    let check = |i: usize| if (i % 64 + i / 64).is_multiple_of(2) { 1.0_f32 } else { 0.0 };
    let values: Vec<f32> = (0..64 * 64).map(check).collect();
    let maps = MaterialMaps {
        size: 64,
        albedo: values.iter().map(|&v| [v; 3]).collect(),
        normal: values.iter().map(|&v| [0.8 * v, 0.0]).collect(),
        smoothness: values.clone(),
        specular_occlusion: values.clone(),
        height: values.clone(),
        colour_mask: values,
    };
    let layers = arrays::compress(&maps);
    for level in 1..7 {
        let texel = layers.albedo.decode(level)[0];
        assert!((i32::from(texel[0]) - 188).abs() <= 4, "level {level}: {texel:?}");
        let normal = layers.normal.decode(level)[0];
        assert!((i32::from(normal[3]) - 179).abs() <= 2, "n.x of level {level} is not the plain mean 0.4: {normal:?}");
    }
}

/// Peak signal-to-noise ratio of the red, green and blue bytes of two images, dB.
fn psnr(a: &[[u8; 4]], b: &[[u8; 4]]) -> f64 {
    let square = |x: u8, y: u8| (f64::from(x) - f64::from(y)).powi(2);
    let error = mean(a.iter().zip(b).map(|(a, b)| (0..3).map(|c| square(a[c], b[c])).sum::<f64>() / 3.0));
    20.0 * 255.0_f64.log10() - 10.0 * error.log10()
}

#[test]
fn compressed_albedo_and_normals_stay_close_to_the_maps() {
    for name in procedural::NAMES {
        let maps = make(name, 256);
        let layers = arrays::compress(&maps);
        let original: Vec<[u8; 4]> = maps
            .albedo
            .iter()
            .map(|c| {
                let [r, g, b] = c.map(|x| srgb_from_linear(f64::from(x)).round() as u8);
                [r, g, b, 255]
            })
            .collect();
        let decoded = layers.albedo.decode(0);
        let db = psnr(&original, &decoded);
        println!("{name}: albedo {db:.1} dB");
        assert!(db > 30.0, "{name}: {db:.1} dB");
        // Negative control: the same texture, displaced by half a tile, must have a much lower ratio.
        let mut shifted = decoded;
        shifted.rotate_left(128 * 256 + 128);
        assert!(psnr(&original, &shifted) < db - 6.0, "{name}: this test does not detect a shifted image");
        // In a BC3 block, the x of normals is the alpha channel, which can take eight values. The y of normals is the green channel. It can take the
        // values of only four colours, which also contain smoothness (red) and occlusion (blue).
        let decoded = layers.normal.decode(0);
        let rms = |axis: usize, channel: usize| {
            mean(maps.normal.iter().zip(&decoded).map(|(n, t)| (f64::from(n[axis]) - (f64::from(t[channel]) / 127.5 - 1.0)).powi(2))).sqrt()
        };
        println!("{name}: normals off by {:.3} in x and {:.3} in y", rms(0, 3), rms(1, 1));
        assert!(rms(0, 3) < 0.08 && rms(1, 1) < 0.14, "{name}: normals off by {:.3}, {:.3}", rms(0, 3), rms(1, 1));
        assert!(rms(0, 1) > 0.14 && rms(1, 3) > 0.14, "{name}: this test cannot tell x from y");
    }
}

#[test]
fn the_last_mip_is_the_mean() {
    for name in procedural::NAMES {
        let maps = make(name, 64);
        let means = MaterialMeans::of(&maps, [1.0; 3]);
        let layers = arrays::compress(&maps);
        let close = |codes: [u8; 3], factor: f64| {
            // The end points of a block have at least 5 bits per channel, and the other two values divide the interval between them into thirds. So
            // the error of a block of one colour is at most 4 of 255.
            (0..3).all(|c| (f64::from(codes[c]) - srgb_from_linear(factor * f64::from(means.albedo[c]))).abs() <= 4.0)
        };
        let [r, g, b, _] = layers.albedo.decode(6)[0];
        assert!(close([r, g, b], 1.0), "{name}: {:?} against {means:?}", [r, g, b]);
        assert!(!close([r, g, b], 1.2), "{name}: this test does not detect a factor of 1.2");
        let [smoothness, _, occlusion, _] = layers.normal.decode(6)[0].map(|code| f64::from(code) / 255.0);
        assert!((smoothness - f64::from(means.smoothness)).abs() < 0.017, "{name}: {smoothness} {means:?}");
        assert!((occlusion - f64::from(means.specular_occlusion)).abs() < 0.017, "{name}: {occlusion} {means:?}");
    }
}

// -------------------------------------------------------------------------------------------------------------------------- palette

#[test]
fn materials_of_one_source_share_its_layers() {
    let palette = build(&scene(
        64,
        &[
            procedural_material("a", "sand", ""),
            procedural_material("b", "mud", ""),
            procedural_material("c", "sand", "tint = [0.5, 1.0, 1.0]\norientation_deg = 30.0\nnormal_strength = 0.5"),
        ],
    ))
    .expect("a good scene");
    assert_eq!(palette.entries.len(), 3);
    assert_eq!(palette.means.len(), 3);
    for array in [&palette.arrays.albedo, &palette.arrays.normal, &palette.arrays.height] {
        assert_eq!(array.len(), 2, "two distinct sources");
    }
    let [a, b, c] = [0, 1, 2].map(|i| palette.entries[i]);
    assert_eq!((a.albedo_layer, a.normal_layer, a.height_layer), (c.albedo_layer, c.normal_layer, c.height_layer));
    assert_ne!(a.albedo_layer, b.albedo_layer);
    assert_eq!((a.flags & FLAG_TINTED, c.flags & FLAG_TINTED), (0, FLAG_TINTED));
    assert!((c.normal_strength - 0.5).abs() < 1e-6);
    // The colour mask of sand is 1 everywhere, so the tint is a plain factor. Entries must be in the order of the scene, and each layer must contain
    // the texture of its source.
    assert!((palette.means[2].albedo[0] / palette.means[0].albedo[0] - 0.5).abs() < 1e-5);
    assert!((palette.means[2].albedo[1] / palette.means[0].albedo[1] - 1.0).abs() < 1e-5);
    let mud = arrays::compress(&make("mud", 64));
    assert_eq!(palette.arrays.albedo[b.albedo_layer as usize], mud.albedo);
    assert_eq!(palette.arrays.height[b.height_layer as usize], mud.height);
    assert_eq!(b.mean_albedo, palette.means[1].albedo);
}

#[test]
fn means_apply_the_tint_through_the_mask() {
    let maps = MaterialMaps {
        size: 2,
        albedo: vec![[0.2, 0.4, 0.6], [0.4, 0.4, 0.4], [0.0; 3], [0.8; 3]],
        normal: vec![[0.0; 2]; 4],
        smoothness: vec![0.0, 0.5, 0.5, 1.0],
        specular_occlusion: vec![1.0, 1.0, 0.5, 0.5],
        height: vec![0.5; 4],
        colour_mask: vec![1.0, 0.5, 1.0, 0.0],
    };
    let means = MaterialMeans::of(&maps, [0.5, 1.0, 0.0]);
    let expected = [(0.1 + 0.4 * 0.75 + 0.0 + 0.8) / 4.0, 0.4, (0.0 + 0.2 + 0.0 + 0.8) / 4.0];
    for c in 0..3 {
        assert!((f64::from(means.albedo[c]) - expected[c]).abs() < 1e-6, "{means:?}, expected {expected:?}");
    }
    assert!((means.smoothness - 0.5).abs() < 1e-6 && (means.specular_occlusion - 0.75).abs() < 1e-6, "{means:?}");
}

#[test]
fn a_palette_entry_is_64_bytes_of_wgsl_rows() {
    let entry = PaletteEntry {
        albedo_layer: 1,
        normal_layer: 2,
        height_layer: 3,
        flags: 4,
        per_sector_fixed: [5, 6],
        per_metre: [7.0, 8.0],
        tint: [9.0, 10.0, 11.0],
        normal_strength: 12.0,
        mean_albedo: [13.0, 14.0, 15.0],
        mean_smoothness: 16.0,
    };
    let words: [u32; 16] = bytemuck::cast(entry);
    for (i, word) in words.into_iter().enumerate() {
        let value = if i < 6 { word } else { f32::from_bits(word) as u32 };
        assert_eq!(value, i as u32 + 1);
    }
}

#[test]
fn repeats_per_sector_are_exact_in_fixed_point() {
    let palette =
        build(&scene(64, &["name = \"a\"\nprocedural = \"sand\"\ntile_m = 4.0\norientation_deg = 30.0".to_owned()])).expect("a good scene");
    let entry = palette.entries[0];
    let one = f64::from(1 << 24);
    // There are 16 repeats per sector. cos 30° = sqrt 3 / 2 = sqrt 0.75, and sin 30° = 1/2.
    assert_eq!(entry.per_sector_fixed, [(16.0 * 0.75_f64.sqrt() * one).round() as i32, 8 << 24]);
    assert!((f64::from(entry.per_metre[0]) - 0.75_f64.sqrt() / 4.0).abs() < 1e-7);
    assert!((f64::from(entry.per_metre[1]) - 0.125).abs() < 1e-7);

    let with_tile = |tile: &str| build(&scene(64, &[format!("name = \"a\"\nprocedural = \"sand\"\ntile_m = {tile}")]));
    assert!(with_tile("0.001").is_ok(), "64 000 repeats fit");
    let text = with_tile("0.0009").expect_err("71 111 repeats do not fit");
    assert!(text.contains("enlarge tile_m") && text.contains("`a`"), "{text}");
    for nonsense in ["0.0", "-1.0", "nan"] {
        assert!(with_tile(nonsense).is_err(), "tile_m = {nonsense}");
    }
}

#[test]
fn palettes_too_large_are_refused_before_any_texture_is_read() {
    let many: Vec<String> = (0..257).map(|i| procedural_material(&format!("m{i}"), "sand", "")).collect();
    let text = build(&scene(64, &many)).expect_err("257 materials");
    assert!(text.contains("257") && text.contains("256"), "{text}");
    assert!(build(&scene(64, &many[..256])).is_ok(), "256 materials of one texture fit");
    // The folders do not exist. If they were opened before the number of textures is checked, the error would be about a missing folder.
    let folders: Vec<String> = (0..=MAX_LAYERS).map(|i| format!("name = \"m{i}\"\nfolder = \"missing{i}\"\ntile_m = 3.0")).collect();
    let text = build(&scene(64, &folders)).expect_err("33 textures");
    assert!(text.contains("33 distinct") && text.contains("in several materials"), "{text}");
    assert!(build(&scene(96, &many[..1])).expect_err("not a power of two").contains("power of two"));
    assert!(build(&scene(64, &["name = \"m\"\ntile_m = 3.0".to_owned()])).expect_err("no source").contains("exactly one"));
}

// -------------------------------------------------------------------------------------------------------------------------- folders

/// Creates an empty folder for one test.
fn folder_for(test: &str) -> PathBuf {
    let dir = std::env::temp_dir().join(format!("scree-materials-{test}-{}", std::process::id()));
    let _ = std::fs::remove_dir_all(&dir);
    std::fs::create_dir_all(&dir).expect("the temporary folder can be written");
    dir
}

fn write(dir: &Path, file: &str, edge: u32, texel: impl Fn(u32, u32) -> [u8; 3]) {
    image::RgbImage::from_fn(edge, edge, |x, y| image::Rgb(texel(x, y))).save(dir.join(file)).expect("an image file can be written");
}

/// Writes a small complete material: black albedo with a white top row, normals that lean to +u, and heights that increase from the top row to the
/// bottom row.
fn write_material(dir: &Path) {
    write(dir, "albedo.png", 64, |_, y| if y == 0 { [255; 3] } else { [0; 3] });
    write(dir, "normal.png", 64, |_, _| [204, 128, 230]);
    write(dir, "height.png", 64, |_, y| [4 * y as u8; 3]);
    write(dir, "roughness.png", 64, |_, _| [51; 3]);
}

#[test]
fn a_folder_is_read_with_its_top_row_at_v_1() {
    let dir = folder_for("orientation");
    write_material(&dir);
    let maps = folder::load("m", &dir, 64).expect("a whole folder");
    assert!(maps.albedo[63 * 64][0] > 0.99, "the top row of the image must be the last row of the map");
    assert!(maps.albedo[0][0] < 0.01);
    assert!((maps.height[0] - 252.0 / 255.0).abs() < 1e-5 && maps.height[63 * 64] < 1e-5);
    assert!((maps.smoothness[0] - 0.8).abs() < 1e-5);
    assert!(
        maps.specular_occlusion.iter().chain(&maps.colour_mask).all(|&v| (v - 1.0).abs() < 1e-6),
        "without their files, ao and colour mask must be 1"
    );
    // The normal is (0.6, 0.0, 0.8), rounded to 8 bits.
    assert!((maps.normal[9][0] - 0.6).abs() < 0.01 && maps.normal[9][1].abs() < 0.01, "{:?}", maps.normal[9]);

    write(&dir, "ao.png", 64, |_, _| [102; 3]);
    let maps = folder::load("m", &dir, 64).expect("a whole folder");
    assert!((maps.specular_occlusion[0] - 0.4).abs() < 1e-5);
    // At a quarter of the size, the white row is one of four rows that are averaged in linear light.
    let small = folder::load("m", &dir, 16).expect("a whole folder");
    assert!((small.albedo[15 * 16 + 3][0] - 0.25).abs() < 1e-4, "{:?}", small.albedo[15 * 16 + 3]);
    // The first height is the mean of the four rows at the bottom of the image, whose height codes are 240, 244, 248 and 252.
    assert!((small.height[0] - 246.0 / 255.0).abs() < 1e-4, "{}", small.height[0]);
    // The mean must not change if the new size does not divide the size of the image, or is larger.
    let odd = folder::load("m", &dir, 24).expect("a whole folder");
    assert!((mean(odd.height.iter().map(|&h| f64::from(h))) - 126.0 / 255.0).abs() < 1e-4);
    let large = folder::load("m", &dir, 128).expect("a whole folder");
    assert!((mean(large.height.iter().map(|&h| f64::from(h))) - 126.0 / 255.0).abs() < 1e-4);
    std::fs::remove_dir_all(&dir).expect("the test's own folder");
}

#[test]
fn albedo_may_have_16_bits_and_any_file_may_lie_about_its_extension() {
    let dir = folder_for("formats");
    write_material(&dir);
    let deep = image::ImageBuffer::<image::Rgb<u16>, Vec<u16>>::from_pixel(64, 64, image::Rgb([0x8000, 0x0101, 0xffff]));
    deep.save(dir.join("albedo.png")).expect("an image file can be written");
    std::fs::rename(dir.join("height.png"), dir.join("height.jpg")).expect("the test's own file");
    let maps = folder::load("m", &dir, 64).expect("a whole folder");
    assert!((maps.albedo[0][0] - 0.214_05).abs() < 1e-4 && maps.albedo[0][2] > 0.999, "{:?}", maps.albedo[0]);
    std::fs::remove_dir_all(&dir).expect("the test's own folder");
}

#[test]
fn a_bad_folder_is_refused_with_its_reason() {
    let dir = folder_for("bad");
    let refuse = |words: &[&str]| {
        let text = folder::load("cliff", &dir, 64).expect_err("a bad folder").to_string();
        assert!(!text.contains('\n'), "an error is one line: {text}");
        for word in words {
            assert!(text.contains(word), "`{text}` does not say `{word}`");
        }
    };
    write_material(&dir);
    folder::load("cliff", &dir, 64).expect("the folder is good before it is spoilt");

    std::fs::remove_file(dir.join("normal.png")).expect("the test's own file");
    refuse(&["`cliff`", "no normal map", "the folder contains: albedo.png, height.png, roughness.png"]);
    image::RgbImage::new(64, 32).save(dir.join("normal.png")).expect("an image file can be written");
    refuse(&["normal.png", "64x32", "square"]);
    std::fs::write(dir.join("normal.png"), b"not an image").expect("the test's own file");
    refuse(&["normal.png", "not a readable PNG, JPEG, TGA or OpenEXR image"]);
    std::fs::remove_dir_all(&dir).expect("the test's own folder");
    refuse(&["`cliff`", "cannot read the folder"]);
    let absent = scene(64, &["name = \"cliff\"\nfolder = \"nowhere/at/all\"\ntile_m = 3.0".to_owned()]);
    assert!(build(&absent).expect_err("an absent folder").contains("nowhere/at/all"));
}

#[test]
fn scanned_materials_load_where_there_are_any() {
    let Some(data) = std::env::var_os("SCREE_DATA") else {
        println!("left out: scanned materials (set SCREE_DATA to a data folder with materials/)");
        return;
    };
    let folders: Vec<PathBuf> = std::fs::read_dir(Path::new(&data).join("materials"))
        .expect("SCREE_DATA has materials/")
        .map(|entry| entry.expect("a folder that can be listed").path())
        .filter(|path| path.is_dir())
        .collect();
    assert!(!folders.is_empty(), "SCREE_DATA/materials is empty");
    for dir in folders {
        let maps = folder::load("scanned", &dir, 64).unwrap_or_else(|error| panic!("{error}"));
        let upright = mean(maps.normal.iter().map(|n| f64::from(1.0 - n[0] * n[0] - n[1] * n[1]).max(0.0).sqrt()));
        assert!(upright > 0.5, "{}: the mean z of the normals is only {upright:.2}", dir.display());
        // If the green channel followed the convention of DirectX, the y of the normals would have the opposite sign, and the correlation with the
        // slopes of the height along v would be negative.
        let at = |x: usize, y: usize| f64::from(maps.height[(y % 64) * 64 + x % 64]);
        let (mut slopes, mut normals) = (Vec::new(), Vec::new());
        for (i, n) in maps.normal.iter().enumerate() {
            slopes.push(at(i % 64, i / 64 + 63) - at(i % 64, i / 64 + 1));
            normals.push(f64::from(n[1]));
        }
        let r = correlation(&slopes, &normals);
        println!("{}: mean albedo {:.3?}, v slopes r = {r:.2}", dir.display(), MaterialMeans::of(&maps, [1.0; 3]).albedo);
        assert!(r > 0.0, "{}: normals oppose the height along v (r = {r:.2})", dir.display());
    }
}

#[test]
fn contrast_moves_mean_colours_from_or_to_middle_grey() {
    let of = |contrast: f64| {
        let mut scene = scene(64, &[procedural_material("a", "grass", ""), procedural_material("b", "limestone", "")]);
        scene.blend.material_contrast = contrast;
        build(&scene).expect("builds").means.into_iter().map(|m| m.albedo.map(f64::from)).collect::<Vec<_>>()
    };
    let (none, made, more) = (of(0.0), of(1.0), of(1.4));
    for m in 0..2 {
        for c in 0..3 {
            // Texels above 1 would be clamped, but no texel of these materials becomes that bright. The tolerances cover the rounding errors of sums
            // of 4096 numbers in f32.
            assert!((none[m][c] - 0.18).abs() < 1e-4, "{:?}", none[m]);
            let wanted = (0.18 + 1.4 * (made[m][c] - 0.18)).clamp(0.005, 0.95);
            assert!((more[m][c] - wanted).abs() < 2e-3, "{:?} from {:?}", more[m], made[m]);
        }
    }
    // Negative control: with a contrast of 1, the two materials differ.
    assert!((made[0][1] - made[1][1]).abs() > 0.05);
}

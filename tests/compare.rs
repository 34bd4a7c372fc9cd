//! Tests of `experiments compare`: wrong calls, wrong pictures, the printed results, and agreement with published values of the metric FLIP.
//!
//! The metrics themselves are tested in `experiments/src/judge/`. The tests run the program `experiments`, which must have been built first.

use std::path::Path;

use exr::prelude as e;
use serde_json::Value;

use crate::fixtures::{Folder, failure, success, usage_error};

const SIZE: [u32; 2] = [16, 12];

/// Lossless compression. The tiles of the OpenEXR file have a fixed order, so its bytes do not depend on the timing of threads.
const ENCODING: e::Encoding = e::Encoding { line_order: e::LineOrder::Increasing, ..e::Encoding::FAST_LOSSLESS };

/// Name of a channel, and a function that returns the channel's value from the index of a texel.
type Channel = (&'static str, fn(usize) -> f32);

/// Writes an 8-bit grey picture whose texels are a function of column and row. Returns its path.
fn png(folder: &Folder, name: &str, size: [u32; 2], code: impl Fn(u32, u32) -> u8) -> String {
    let path = folder.path(name);
    image::RgbImage::from_fn(size[0], size[1], |x, y| image::Rgb([code(x, y); 3])).save(&path).expect("a PNG can be written");
    path
}

/// Writes an OpenEXR file with these channels. Returns its path.
fn exr(folder: &Folder, name: &str, channels: &[Channel]) -> String {
    let path = folder.path(name);
    let area = (SIZE[0] * SIZE[1]) as usize;
    let channel = |(name, value): &Channel| e::AnyChannel::new(*name, e::FlatSamples::F32((0..area).map(value).collect()));
    let channels = e::AnyChannels::sort(channels.iter().map(channel).collect());
    let layer = e::Layer::new((SIZE[0] as usize, SIZE[1] as usize), e::LayerAttributes::default(), ENCODING, channels);
    e::WritableImage::write(&e::Image::from_layer(layer)).to_file(&path).expect("an OpenEXR file can be written");
    path
}

fn json(arguments: &[&str]) -> Value {
    let mut all = vec!["compare", "--json"];
    all.extend_from_slice(arguments);
    serde_json::from_str(&success(&all)).expect("JSON")
}

fn close(value: &Value, expected: f64, tolerance: f64) {
    let value = value.as_f64().unwrap_or(f64::NAN);
    assert!((value - expected).abs() <= tolerance, "{value} is not {expected} +- {tolerance}");
}

#[test]
fn wrong_calls_are_usage_errors() {
    let compare = |more: &[&'static str]| {
        let mut all = vec!["compare", "a.png", "b.png"];
        all.extend_from_slice(more);
        all
    };
    usage_error(&["compare"], &["<A>", "<B>"]);
    usage_error(&["compare", "a.png"], &["<B>"]);
    usage_error(&compare(&["c.png"]), &["c.png"]);
    usage_error(&compare(&["--metric", "flop"]), &["flop", "flip, mse, mrse, psnr, ssim", "did you mean `flip`?"]);
    usage_error(&compare(&["--metric", "mse,sim"]), &["did you mean `ssim`?"]);
    usage_error(&compare(&["--metric", "lpips"]), &["`lpips` is not a known metric"]);
    usage_error(&compare(&["--metric="]), &["is not a known metric"]);
    usage_error(&compare(&["--map", "error.jpg"]), &["must end in .png"]);
    for wrong in ["3", "401", "nan", "-67", "x"] {
        usage_error(&["compare", "a.png", "b.png", "--pixels-per-degree", wrong], &["4..=400"]);
    }
    usage_error(&compare(&["--jsn"]), &["--json"]);
}

#[test]
fn help_says_which_is_the_reference_and_shows_a_call() {
    let help = success(&["compare", "--help"]);
    for part in ["The test: the picture to judge", "The reference: ", "r^2 + 0.01", "Examples:", "--layer albedo", "--map error.png"] {
        assert!(help.contains(part), "`{part}` is not in: {help}");
    }
    assert!(success(&["--help"]).contains("compare"));
}

#[test]
fn wrong_pictures_fail_with_their_place() {
    let folder = Folder::new("compare-wrong");
    let good = png(&folder, "good.png", SIZE, |x, _| x as u8);
    let compare = |a: &str, b: &str, says: &[&str]| failure(&["compare", a, b], says);
    compare(&folder.path("no.png"), &good, &["no.png", "no such file"]);
    compare(&good, &folder.path("no.exr"), &["no.exr", "no such file"]);
    compare(&folder.path(""), &good, &["is a folder", "give a picture"]);
    compare(&folder.write("words.png", "plain words"), &good, &["words.png", "is not a picture", "OpenEXR, PNG or JPEG"]);
    compare(&folder.write("half.png", "\u{89}PNG"), &good, &["half.png"]);
    let other = png(&folder, "other.png", [16, 13], |_, _| 0);
    compare(&good, &other, &["sizes differ", "good.png is 16x12", "other.png is 16x13"]);
    let broken = exr(&folder, "broken.exr", &[("R", |i| if i % 50 == 37 { f32::NAN } else { 0.0 }), ("G", |_| 0.0), ("B", |_| 0.0)]);
    compare(&broken, &good, &["broken.exr", "4 NaN values", "first in column 5, row 2"]);
    let endless = exr(&folder, "endless.exr", &[("R", |_| 0.0), ("G", |i| if i == 3 { f32::INFINITY } else { 0.0 }), ("B", |_| 0.0)]);
    compare(&good, &endless, &["1 infinite value", "column 3, row 0"]);
}

#[test]
fn wrong_layers_and_masks_fail_with_what_there_is() {
    let folder = Folder::new("compare-layers");
    let good = png(&folder, "good.png", SIZE, |x, _| x as u8);
    let grey: [Channel; 4] = [("R", |_| 0.5), ("G", |_| 0.5), ("B", |_| 0.5), ("A", |_| 0.0)];
    let layers: [Channel; 4] = [("albedo.R", |_| 0.5), ("albedo.G", |_| 0.5), ("albedo.B", |_| 0.5), ("depth.V", |_| 9.0)];
    let all = exr(&folder, "all.exr", &[grey, layers].concat());
    failure(&["compare", &all, &all, "--layer", "albdo"], &["no layer `albdo`", "albedo, depth", "did you mean `albedo`?"]);
    failure(&["compare", &all, &good, "--layer", "albedo"], &["good.png", "only OpenEXR files have layers"]);
    failure(&["compare", &all, &all, "--layer", "depth", "--metric", "mse,ssim"], &["--metric ssim needs colour", "`depth`"]);
    let map = folder.path("map.png");
    failure(&["compare", &all, &all, "--layer", "depth", "--map", &map], &["--map needs colour"]);
    let numbers = json(&[&all, &all, "--layer", "depth"]);
    assert!(numbers["mse"] == 0.0 && numbers["mrse"] == 0.0 && numbers.get("flip").is_none(), "{numbers}");
    failure(&["compare", &good, &good, "--terrain"], &["--terrain needs alpha", "good.png"]);
    failure(&["compare", &good, &all, "--terrain"], &["shows no terrain", "all.exr"]);
    failure(&["compare", &good, &all, "--map", &good], &["would be lost"]);
    failure(&["compare", &good, &all, "--map", &folder.path("no/map.png")], &["no folder"]);
    assert!(!Path::new(&map).exists(), "a failed comparison left its map");
}

#[test]
fn a_difference_is_measured_printed_and_drawn() {
    let folder = Folder::new("compare-works");
    let test = png(&folder, "test.png", SIZE, |x, _| if x < 8 { 255 } else { 100 });
    let reference = png(&folder, "reference.png", SIZE, |_, _| 100);
    let map = folder.path("map.png");
    let printed = success(&["compare", &test, &reference, "--map", &map]);
    for part in ["192 of 16x12", "flip ", "mse ", "mrse ", "psnr ", "dB", "ssim ", "67 pixels per degree", "#000004 black", "pale yellow"] {
        assert!(printed.contains(part), "`{part}` is not in: {printed}");
    }
    // The expected values are closed forms. Half of the pixels differ by 1 - r, where r is the linear value of the sRGB value 100/255 (IEC
    // 61966-2-1).
    let r = ((100.0 / 255.0 + 0.055) / 1.055f64).powf(2.4);
    let found = json(&[&test, &reference, "--metric", "mse,mrse,psnr"]);
    // The tolerances allow for f32 texels, whose rounding error is about 1e-7 of the value.
    close(&found["mse"], (1.0 - r).powi(2) / 2.0, 1e-6);
    close(&found["mrse"], (1.0 - r).powi(2) / (r * r + 0.01) / 2.0, 1e-4);
    close(&found["psnr_db"], -10.0 * ((155.0 / 255.0f64).powi(2) / 2.0).log10(), 1e-5);
    assert!(found.get("flip").is_none() && found["pixels"] == 192 && found["identical"] == false, "{found}");
    // MRSE is relative to the reference, which is the second picture, so the result changes if the two pictures are exchanged.
    close(&json(&[&reference, &test, "--metric", "mrse"])["mrse"], (1.0 - r).powi(2) / 1.01 / 2.0, 1e-6);
    let map = image::open(&map).expect("the map is there").into_rgb8();
    assert_eq!(map.dimensions(), (16, 12));
    let light = |x: u32| map.get_pixel(x, 6).0.map(u32::from).iter().sum::<u32>();
    assert!(light(2) > light(14) + 100, "the map must be brighter where the pictures differ");
}

#[test]
fn identical_and_tiny_pictures_have_answers() {
    let folder = Folder::new("compare-same");
    let picture = png(&folder, "picture.png", SIZE, |x, y| (x * y) as u8);
    let printed = success(&["compare", &picture, &picture]);
    assert!(printed.contains("identical") && printed.contains("infinite"), "{printed}");
    let found = json(&[&picture, &picture]);
    assert!(found["psnr_db"].is_null() && found.get("psnr_db").is_some() && found["identical"] == true, "{found}");
    assert!(found["flip"]["mean"] == 0.0 && found["mse"] == 0.0 && found["ssim"] == 1.0, "{found}");
    let (one, other) = (png(&folder, "one.png", [1, 1], |_, _| 9), png(&folder, "other.png", [1, 1], |_, _| 200));
    let found = json(&[&one, &other]);
    assert!(found["ssim"].is_null() && found.get("ssim").is_some() && found["flip"]["max"].as_f64() > Some(0.1), "{found}");
    assert!(success(&["compare", &one, &other, "--metric", "ssim"]).contains("none"));
}

#[test]
fn layers_and_terrain_are_told_apart() {
    let folder = Folder::new("compare-terrain");
    // The upper half of the reference is sky. The test picture has a different sky.
    let reference = exr(
        &folder,
        "reference.exr",
        &[
            ("R", |_| 0.5),
            ("G", |_| 0.5),
            ("B", |_| 0.5),
            ("A", |i| if i < 96 { 0.0 } else { 1.0 }),
            ("albedo.R", |_| 0.25),
            ("albedo.G", |_| 0.25),
            ("albedo.B", |_| 0.25),
        ],
    );
    let value: fn(usize) -> f32 = |i| if i < 96 { 9.0 } else { 0.75 };
    let test = exr(
        &folder,
        "test.exr",
        &[("R", value), ("G", value), ("B", value), ("albedo.R", |_| 0.5), ("albedo.G", |_| 0.25), ("albedo.B", |_| 0.25)],
    );
    close(&json(&[&test, &reference])["mse"], (72.25 + 0.0625) / 2.0, 1e-9);
    let terrain = json(&[&test, &reference, "--terrain"]);
    close(&terrain["mse"], 0.0625, 1e-9);
    assert!(terrain["pixels"] == 96 && terrain["terrain_only"] == true, "{terrain}");
    close(&json(&[&test, &reference, "--layer", "albedo", "--metric", "mse"])["mse"], 0.0625 / 3.0, 1e-9);
}

/// Compares a published test picture with its published reference. The expected values were published together with the pictures. The file
/// `compare.json`, in the same folder, names the source.
#[test]
fn flip_agrees_with_published_values() {
    let Some(data) = std::env::var_os("SCREE_DATA") else {
        eprintln!("left out: published values of FLIP, since SCREE_DATA is not set");
        return;
    };
    let folder = Path::new(&data).join("compare");
    let table = std::fs::read_to_string(folder.join("compare.json")).expect("SCREE_DATA has compare/compare.json");
    let table: Value = serde_json::from_str(&table).expect("JSON");
    let published = &table["nv_flip_tree"]["published_values"];
    let path = |name: &str| folder.join(name).display().to_string();
    let map = Folder::new("compare-published");
    let drawn = map.path("map.png");
    let found = json(&[&path("tree-test.png"), &path("tree-ref.png"), "--map", &drawn]);
    // The published values have 6 digits. They were computed in f32, and a different compiler changes them by about 1e-6. So 5e-6 is accepted. (The
    // publisher allows 1e-4. The authors' later code, at 67.02 pixels per degree, gives values that are 1e-5 lower.)
    let tolerance = 5e-6;
    let flip = &found["flip"];
    close(&flip["mean"], published["mean"].as_f64().expect("a number"), tolerance);
    close(&flip["max"], published["max"].as_f64().expect("a number"), tolerance);
    for (index, name) in ["weighted_quartile_1", "weighted_median", "weighted_quartile_3"].into_iter().enumerate() {
        // A quartile is the error of one pixel. Rounding in f32 may select a different pixel, so the tolerance is larger.
        close(&flip["weighted_quartiles"][index], published[name].as_f64().expect("a number"), 1e-5);
    }
    // Negative control: a different viewing distance gives a different value.
    let near = json(&[&path("tree-test.png"), &path("tree-ref.png"), "--metric", "flip", "--pixels-per-degree", "60"]);
    assert!((near["flip"]["mean"].as_f64().unwrap_or(0.0) - flip["mean"].as_f64().unwrap_or(0.0)).abs() > 100.0 * tolerance);
    // PSNR of the 8-bit values. The expected value was computed with a different program and rounded to three decimal places, so it is off by up to
    // 5e-4.
    close(&found["psnr_db"], table["nv_flip_tree"]["recomputed_here"]["psnr_db"].as_f64().expect("a number"), 5.1e-4);
    // The error map must equal the published error map, except that rounding may select a neighbouring colour among the 256 colours of the map.
    let open = |path: &Path| image::open(path).expect("a picture").into_rgb8();
    let (ours, theirs) = (open(Path::new(&drawn)), open(&folder.join("tree-comparison-cli.png")));
    assert_eq!(ours.dimensions(), theirs.dimensions());
    let largest = ours.as_raw().iter().zip(theirs.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(8), "the error maps differ by up to {largest:?} of 255");
}

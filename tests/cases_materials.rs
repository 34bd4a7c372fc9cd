//! Tests the materials of an import with folders that have the file names and formats of texture libraries and other programs. A survey finds the
//! materials in a folder. The materials that it accepts are copied, read again from the copies, and made into a palette, as for drawing. Their values
//! are compared with those that the tests themselves read from the image files.

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;

use kernels::decode::heightmap::ReadOptions;
use kernels::import::materials::{MaterialSurvey, Tile, chosen, survey};
use kernels::import::scene_folder::{self, ImportOptions};
use kernels::materials::folder::{self, Convention, Reading};
use kernels::materials::{MaterialMaps, Palette};
use kernels::scene;

use crate::fixtures::{Folder, case, failure, has, one_line, small_scene, success};

const OPENGL: Reading = Reading::Normal(Convention::OpenGl);
const UNSTATED: Reading = Reading::Normal(Convention::Unstated);
const DIRECTX: Reading = Reading::Normal(Convention::DirectX);
const GREY: Reading = Reading::Share { channel: None, inverted: false };

fn surveyed(folder: &Path) -> MaterialSurvey {
    let survey = survey(folder, &|| false).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let text = survey.to_string();
    assert!(text.lines().all(|line| !line.chars().any(char::is_control)) && !text.ends_with('\n'), "{text:?}");
    survey
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Names of the materials that can be drawn.
fn names(survey: &MaterialSurvey) -> Vec<&str> {
    survey.found.iter().map(|found| found.name.as_str()).collect()
}

/// For each map of a material: its name, its file, and how the file is read.
fn maps(survey: &MaterialSurvey, name: &str) -> Vec<(&'static str, String, Reading)> {
    let found = survey.found.iter().find(|found| found.name == name).unwrap_or_else(|| panic!("no `{name}`:\n{survey}"));
    found.recognised.maps().map(|(map, source)| (map, name_of(&source.file), source.reading)).collect()
}

/// The reason why a file or folder is not used.
fn unused<'a>(survey: &'a MaterialSurvey, name: &str) -> &'a str {
    let found = survey.unused.iter().find(|unused| name_of(&unused.path) == name);
    found.map_or_else(|| panic!("{name} is not among the unused files:\n{survey}"), |unused| unused.reason.as_str())
}

fn refusal(survey: &MaterialSurvey) -> String {
    one_line(survey.check())
}

/// Copies the materials as an import does, makes a palette of the copies, and checks that the copies are read like the originals. Returns the maps of
/// each material, with an edge of `size` texels.
fn drawn(test: &str, survey: &MaterialSurvey, size: u32) -> Vec<MaterialMaps> {
    let temp = Folder::new(&format!("drawn-{test}"));
    let materials = chosen(survey, &temp.0).unwrap_or_else(|error| panic!("{error}\n{survey}"));
    assert_eq!(materials.len(), survey.found.len());
    let scene = scene::Scene { materials, folder: temp.0.clone(), ..small_scene() };
    let palette = Palette::build(&scene, 64.0, |_| Ok(())).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(palette.entries.len(), survey.found.len());
    let pairs = survey.found.iter().zip(&scene.materials);
    pairs
        .map(|(found, material)| {
            assert_eq!((&material.name, material.procedural.as_ref()), (&found.name, None));
            assert!((material.tile_m - found.tile.metres()).abs() < 1e-12);
            let copy = material.folder.as_ref().expect("materials of images have a folder");
            let maps = folder::load(&found.name, &temp.0.join(copy), size).unwrap_or_else(|error| panic!("{error}"));
            let original = folder::load_maps(&found.recognised, size).expect("it was read before");
            assert!(maps == original.maps, "{}: the copy is read in another way", found.name);
            maps
        })
        .collect()
}

/// Like [`drawn`], for the only material of a survey.
fn drawn_alone(test: &str, survey: &MaterialSurvey, size: u32) -> MaterialMaps {
    let mut maps = drawn(test, survey, size);
    assert_eq!(maps.len(), 1, "{survey}");
    maps.remove(0)
}

/// The texels of a PNG or JPEG file as numbers in 0..1, with the bottom row first.
fn texels(path: &Path) -> Vec<[f64; 3]> {
    let image = image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb32f();
    let rows: Vec<Vec<[f64; 3]>> = image.rows().map(|row| row.map(|p| p.0.map(f64::from)).collect()).collect();
    rows.into_iter().rev().flatten().collect()
}

fn linear(code: f64) -> f64 {
    if code <= 0.040_45 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

/// Unit vector of a normal that is stored as n / 2 + 1/2.
fn unit(code: [f64; 3]) -> [f64; 3] {
    let n = code.map(|c| 2.0 * c - 1.0);
    let length = n.iter().map(|c| c * c).sum::<f64>().sqrt();
    n.map(|c| c / length)
}

fn same(what: &str, got: impl ExactSizeIterator<Item = f64>, expected: impl ExactSizeIterator<Item = f64>) {
    assert!(got.len() == expected.len() && got.len() > 1000, "{what}: {} and {} values", got.len(), expected.len());
    for (i, (got, expected)) in got.zip(expected).enumerate() {
        assert!((got - expected).abs() < 2e-5, "{what}: value {i} is {got}, not {expected}");
    }
}

fn same_albedo(maps: &MaterialMaps, file: &Path) {
    let got: Vec<f64> = maps.albedo.iter().flatten().map(|&v| f64::from(v)).collect();
    let expected: Vec<f64> = texels(file).into_iter().flatten().map(linear).collect();
    same("albedo", got.into_iter(), expected.into_iter());
}

/// `green`: 1, or -1 if the green channel points down.
fn same_normal(maps: &MaterialMaps, file: &Path, green: f64) {
    let expected: Vec<[f64; 3]> = texels(file).into_iter().map(unit).collect();
    same("x", maps.normal.iter().map(|n| f64::from(n[0])), expected.iter().map(|n| n[0]));
    same("y", maps.normal.iter().map(|n| f64::from(n[1])), expected.iter().map(|n| green * n[1]));
}

fn same_values(what: &str, got: &[f32], file: &Path, of: impl Fn([f64; 3]) -> f64) {
    let expected = texels(file);
    same(what, got.iter().map(|&v| f64::from(v)), expected.iter().map(|&code| of(code)));
}

/// Writes images of `edge` x `edge` texels into a folder. Each has a file name and one colour (red, green, blue).
fn write(folder: &Path, edge: u32, images: &[(&str, [u8; 3])]) {
    fs::create_dir_all(folder).expect("a temporary folder can be made");
    for (name, colour) in images {
        image::RgbImage::from_pixel(edge, edge, image::Rgb(*colour)).save(folder.join(name)).expect("an image can be written");
    }
}

const PLAIN: [(&str, [u8; 3]); 4] =
    [("albedo.png", [120, 110, 100]), ("normal.png", [128, 128, 255]), ("height.png", [90, 90, 90]), ("roughness.png", [200, 200, 200])];

// -------------------------------------------------------------------------------------------------------------------- names

#[test]
fn poly_haven_names_31() {
    let set = case("31-polyhaven-names/set");
    let survey = surveyed(&set);
    let file = |what: &str| format!("rock_wall_10_{what}");
    assert_eq!(
        maps(&survey, "rock_wall_10"),
        [
            ("albedo", file("diff_2k.jpg"), Reading::Colour),
            ("normal", file("nor_gl_2k.png"), OPENGL),
            ("height", file("disp_2k.png"), Reading::Height(None)),
            ("roughness", file("rough_2k.jpg"), GREY),
            ("ao", file("ao_2k.jpg"), GREY),
        ]
    );
    has(unused(&survey, &file("nor_dx_2k.png")), &["order of preference: OpenGL"]);
    has(unused(&survey, &file("arm_2k.jpg")), &["each of its maps also has a separate file"]);
    assert_eq!(survey.unused.len(), 2, "{survey}");
    let maps = drawn_alone("31", &survey, 128);
    let at = |what: &str| set.join("rock_wall_10").join(file(what));
    same_albedo(&maps, &at("diff_2k.jpg"));
    same_normal(&maps, &at("nor_gl_2k.png"), 1.0);
    same_values("height", &maps.height, &at("disp_2k.png"), |t| t[0]);
    same_values("smoothness", &maps.smoothness, &at("rough_2k.jpg"), |t| 1.0 - t[0]);
    same_values("occlusion", &maps.specular_occlusion, &at("ao_2k.jpg"), |t| t[0]);
}

#[test]
fn without_a_map_for_opengl_the_one_for_directx_is_inverted() {
    let temp = Folder::new("directx");
    let to = temp.0.join("set").join("rock_wall_10");
    fs::create_dir_all(&to).expect("created");
    for entry in fs::read_dir(case("31-polyhaven-names/set/rock_wall_10")).expect("readable") {
        let entry = entry.expect("readable").path();
        let name = name_of(&entry);
        if !name.contains("nor_gl") && !name.contains("rough") && !name.contains("_ao_") {
            fs::copy(&entry, to.join(name)).expect("copied");
        }
    }
    let survey = surveyed(&temp.0.join("set"));
    assert_eq!(maps(&survey, "rock_wall_10")[1], ("normal", "rock_wall_10_nor_dx_2k.png".to_owned(), DIRECTX));
    // Roughness and occlusion now come from the packed map.
    let packed = "rock_wall_10_arm_2k.jpg".to_owned();
    assert_eq!(maps(&survey, "rock_wall_10")[3].1, packed);
    assert_eq!(maps(&survey, "rock_wall_10")[4], ("ao", packed.clone(), Reading::Share { channel: Some(0), inverted: false }));
    has(&survey.to_string(), &["DirectX: green inverted", "rock_wall_10_arm_2k.jpg, 128 x 128, green channel"]);
    let maps = drawn_alone("directx", &survey, 128);
    same_normal(&maps, &to.join("rock_wall_10_nor_dx_2k.png"), -1.0);
    same_values("smoothness", &maps.smoothness, &to.join(&packed), |t| 1.0 - t[1]);
    same_values("occlusion", &maps.specular_occlusion, &to.join(&packed), |t| t[0]);
}

#[test]
fn ambient_cg_names_32() {
    let set = case("32-ambientcg-names/set");
    let survey = surveyed(&set);
    let name = "Rock030_1K-JPG";
    let file = |what: &str| format!("{name}_{what}.jpg");
    let read: Vec<(&str, String)> = maps(&survey, name).into_iter().map(|(map, file, _)| (map, file)).collect();
    assert_eq!(
        read,
        [
            ("albedo", file("Color")),
            ("normal", file("NormalGL")),
            ("height", file("Displacement")),
            ("roughness", file("Roughness")),
            ("ao", file("AmbientOcclusion")),
        ]
    );
    has(unused(&survey, &file("NormalDX")), &["order of preference: OpenGL"]);
    let maps = drawn_alone("32", &survey, 128);
    let at = |what: &str| set.join(name).join(file(what));
    same_albedo(&maps, &at("Color"));
    same_normal(&maps, &at("NormalGL"), 1.0);
    same_values("height", &maps.height, &at("Displacement"), |t| t[0]);
}

#[test]
fn upper_case_names_33() {
    let survey = surveyed(&case("33-upper-case/set"));
    let files: Vec<String> = maps(&survey, "granite").into_iter().map(|(_, file, _)| file).collect();
    assert_eq!(files, ["Albedo.PNG", "Normal.PNG", "Height.PNG", "Roughness.PNG"]);
    assert!(survey.unused.is_empty() && survey.refused.is_empty(), "{survey}");
    let maps = drawn_alone("33", &survey, 128);
    same_albedo(&maps, &case("33-upper-case/set/granite/Albedo.PNG"));
    assert!(maps.specular_occlusion.iter().all(|&v| v >= 1.0), "without a map, nothing is occluded");
}

#[test]
fn flat_and_nested_folders_41_44() {
    let survey = surveyed(&case("41-flat-folder/set"));
    assert_eq!(names(&survey), ["set"]);
    let maps = drawn_alone("41", &survey, 128);
    same_albedo(&maps, &case("41-flat-folder/set/albedo.png"));
    let survey = surveyed(&case("44-nested/set"));
    assert_eq!(names(&survey), ["grass", "granite"]);
    let both = drawn("44", &survey, 128);
    same_albedo(&both[0], &case("44-nested/set/plants/grass/albedo.png"));
    same_albedo(&both[1], &case("44-nested/set/rocks/granite/albedo.png"));
}

#[test]
fn a_folder_with_other_names_is_no_longer_dropped_47() {
    let survey = surveyed(&case("47-one-unnamed/set"));
    assert_eq!(names(&survey), ["granite", "rock_wall_10"]);
    let both = drawn("47", &survey, 128);
    same_values("occlusion", &both[0].specular_occlusion, &case("47-one-unnamed/set/granite/ao.png"), |t| t[0]);
    same_albedo(&both[1], &case("47-one-unnamed/set/rock_wall_10/rock_wall_10_diff_2k.jpg"));
}

#[test]
fn several_materials_in_one_folder_are_told_apart() {
    let temp = Folder::new("side-by-side");
    let set = temp.0.join("set");
    write(
        &set,
        8,
        &[
            ("Moss01_Color.png", [20, 200, 20]),
            ("Moss01_NormalDX.png", [128, 191, 238]),
            ("Moss01_Displacement.png", [9, 9, 9]),
            ("Moss01_Gloss.png", [51, 51, 51]),
            ("rough_rock_diff_1k.png", [60, 60, 60]),
            ("rough_rock_diff_2k.png", [80, 80, 80]),
            ("rough_rock_nor_1k.png", [128, 128, 255]),
            ("rough_rock_disp_1k.png", [9, 9, 9]),
            ("rough_rock_arm_1k.png", [100, 150, 0]),
            ("sand_color.png", [200, 190, 150]),
            ("ao.png", [9, 9, 9]),
            ("preview.png", [9, 9, 9]),
        ],
    );
    fs::write(set.join("LICENSE.txt"), "free").expect("written");
    fs::write(set.join("moss.blend"), "?").expect("written");
    let survey = surveyed(&set);
    assert_eq!(names(&survey), ["Moss01", "rough_rock"]);
    assert_eq!(maps(&survey, "Moss01")[1], ("normal", "Moss01_NormalDX.png".to_owned(), DIRECTX));
    assert_eq!(maps(&survey, "Moss01")[3].2, Reading::Share { channel: None, inverted: true });
    assert_eq!(maps(&survey, "rough_rock")[0].1, "rough_rock_diff_2k.png");
    assert_eq!(maps(&survey, "rough_rock")[1].2, UNSTATED);
    has(unused(&survey, "rough_rock_diff_1k.png"), &["highest resolution"]);
    has(unused(&survey, "sand_color.png"), &["several materials"]);
    has(unused(&survey, "ao.png"), &["several materials"]);
    has(unused(&survey, "preview.png"), &["a preview"]);
    has(unused(&survey, "moss.blend"), &["not an image"]);
    let both = drawn("side-by-side", &survey, 8);
    let (moss, rock) = (&both[0], &both[1]);
    assert!((moss.smoothness[0] - 0.2).abs() < 1e-5 && moss.normal[0][1] < -0.45, "{:?}", moss.normal[0]);
    assert!((rock.smoothness[0] - (1.0 - 150.0 / 255.0)).abs() < 1e-5 && (rock.specular_occlusion[0] - 100.0 / 255.0).abs() < 1e-5);
    // The file with the licence is copied to every material. Apart from it, only the maps that are used are copied.
    let to = temp.0.join("scene");
    chosen(&survey, &to).expect("copied");
    let copied: BTreeSet<String> =
        fs::read_dir(to.join("materials/rough_rock")).expect("a folder").map(|entry| name_of(&entry.expect("an entry").path())).collect();
    let expected = ["LICENSE.txt", "rough_rock_arm_1k.png", "rough_rock_diff_2k.png", "rough_rock_disp_1k.png", "rough_rock_nor_1k.png"];
    assert!(copied.iter().eq(expected), "{copied:?}");
    // A folder that a scene file names must contain only one material, so this folder is refused.
    has(&one_line(folder::load("m", &set, 8)), &["`m`", "maps of 2 materials", "Moss01, rough_rock", "folder of its own"]);
}

#[test]
fn names_in_a_scene_are_unique() {
    let temp = Folder::new("unique");
    for place in ["a/rock", "b/Rock", "b/textures", "c"] {
        write(&temp.0.join(place), 8, &PLAIN);
    }
    write(&temp.0.join("granite/textures"), 8, &PLAIN);
    let survey = surveyed(&temp.0);
    assert_eq!(names(&survey), ["a_rock", "b_Rock", "b", "c", "granite"]);
    drawn("unique", &survey, 8);
}

// ------------------------------------------------------------------------------------------------------------- kinds of maps

#[test]
fn a_missing_normal_map_is_refused_34() {
    let survey = surveyed(&case("34-maps-missing/set"));
    assert_eq!(names(&survey), ["grass"]);
    has(&refusal(&survey), &["`granite`", "no normal map", "albedo.png, height.png, roughness.png", "add it", "normal.png"]);
    has(&survey.to_string(), &["refused: granite: no normal map"]);
    let temp = Folder::new("case-34");
    has(&one_line(chosen(&survey, &temp.0)), &["no normal map"]);
    assert_eq!(fs::read_dir(&temp.0).expect("readable").count(), 0, "nothing is copied");
}

#[test]
fn an_albedo_in_tga_is_read_35() {
    let survey = surveyed(&case("35-albedo-tga/set"));
    assert_eq!(names(&survey), ["granite", "grass"]);
    let granite = drawn("35", &survey, 128).remove(0);
    // The file has a header of 18 bytes. Then it has blue, green and red of each texel, beginning with the bottom row. The maps also begin with the
    // bottom row.
    let bytes = fs::read(case("35-albedo-tga/set/granite/albedo.tga")).expect("readable");
    assert_eq!((bytes[2], &bytes[12..18]), (2, [128, 0, 128, 0, 24, 0].as_slice()), "uncompressed, 24 bits, bottom row first");
    let expected: Vec<f64> =
        bytes[18..][..3 * 128 * 128].chunks(3).flat_map(|p| [p[2], p[1], p[0]]).map(|c| linear(f64::from(c) / 255.0)).collect();
    let got: Vec<f64> = granite.albedo.iter().flatten().map(|&v| f64::from(v)).collect();
    same("albedo", got.into_iter(), expected.into_iter());
}

#[test]
fn a_tga_that_is_too_short_for_its_size_is_refused_before_it_is_decoded() {
    let temp = Folder::new("short-tga");
    let folder = temp.0.join("m");
    write(&folder, 8, &PLAIN[1..]);
    let header = |kind: u8, edge: u16| {
        let [low, high] = edge.to_le_bytes();
        vec![0, 0, kind, 0, 0, 0, 0, 0, 0, 0, 0, 0, low, high, low, high, 24, 0]
    };
    // The first file is uncompressed. The second is run-length encoded: each packet of 4 bytes repeats a colour 128 times.
    for (kind, body) in [(2, vec![90; 3 * 128 * 128]), (10, [0xff, 90, 90, 90].repeat(128))] {
        let file = [header(kind, 128), body].concat();
        fs::write(folder.join("albedo.tga"), &file).expect("written");
        let survey = surveyed(&temp.0);
        assert!(survey.refused.is_empty(), "{survey}");
        fs::write(folder.join("albedo.tga"), &file[..file.len() - 1]).expect("written");
        has(&refusal(&surveyed(&temp.0)), &["albedo.tga", "bytes cannot hold 128x128 texels", "truncated or damaged"]);
        fs::write(folder.join("albedo.tga"), header(kind, 8192)).expect("written");
        has(&refusal(&surveyed(&temp.0)), &["albedo.tga", "18 bytes cannot hold 8192x8192 texels"]);
        fs::write(folder.join("albedo.tga"), &file[..17]).expect("written");
        has(&refusal(&surveyed(&temp.0)), &["albedo.tga", "ends inside its header"]);
    }
}

#[test]
fn each_map_may_have_its_own_size_36() {
    let survey = surveyed(&case("36-sizes/set"));
    assert_eq!(names(&survey), ["granite", "grass"]);
    assert_eq!(survey.found[0].edges, [128, 128, 128, 64]);
    let small = case("36-sizes/set/granite/roughness.png");
    let granite = drawn("36", &survey, 64).remove(0);
    same_values("smoothness", &granite.smoothness, &small, |t| 1.0 - t[0]);
    // At the size of the other maps, the roughness is interpolated. Along each axis, the centre of a texel lies at a quarter or at three quarters of
    // the distance between two texel centres of the file.
    let granite = drawn("36-large", &survey, 128).remove(0);
    same_albedo(&granite, &case("36-sizes/set/granite/albedo.png"));
    let rough: Vec<f64> = texels(&small).iter().map(|t| t[0]).collect();
    let at = |x: usize, y: usize| rough[y % 64 * 64 + x % 64];
    for (x, y) in [(0, 0), (1, 1), (2, 5), (63, 64), (127, 127), (40, 99)] {
        let (left, low) = ((x + 127) / 2, (y + 127) / 2);
        let (u, v) = (if x % 2 == 0 { 0.75 } else { 0.25 }, if y % 2 == 0 { 0.75 } else { 0.25 });
        let line = |y: usize| at(left, y) * (1.0 - u) + at(left + 1, y) * u;
        let expected = 1.0 - (line(low) * (1.0 - v) + line(low + 1) * v);
        assert!((f64::from(granite.smoothness[y * 128 + x]) - expected).abs() < 1e-5, "{x}, {y}");
    }
}

#[test]
fn images_that_are_not_square_are_refused_37() {
    let survey = surveyed(&case("37-not-square/set"));
    assert!(survey.found.is_empty());
    has(&refusal(&survey), &["`granite`", "granite/albedo.png", "128x64 texels", "square", "crop or resize"]);
}

#[test]
fn gloss_is_inverted_roughness_38() {
    let survey = surveyed(&case("38-gloss/set"));
    let maps = drawn_alone("38", &survey, 128);
    same_values("smoothness", &maps.smoothness, &case("38-gloss/set/granite/gloss.png"), |t| t[0]);
    has(&survey.to_string(), &["roughness: granite/gloss.png, 128 x 128, inverted"]);
}

#[test]
fn a_packed_map_is_taken_apart_39() {
    let file = case("39-packed-arm/set/granite/arm.png");
    let survey = surveyed(&case("39-packed-arm/set"));
    let maps = drawn_alone("39", &survey, 128);
    same_values("occlusion", &maps.specular_occlusion, &file, |t| t[0]);
    same_values("smoothness", &maps.smoothness, &file, |t| 1.0 - t[1]);
    has(&survey.to_string(), &["roughness: granite/arm.png, 128 x 128, green channel", "ao: granite/arm.png, 128 x 128, red channel"]);
}

#[test]
fn every_packed_order_is_that_of_its_letters() {
    for (name, roughness, occlusion) in [("ORM", 1, 0), ("AORM", 1, 0), ("MRA", 1, 2), ("RMA", 0, 2), ("occlusionRoughnessMetallic", 1, 0)]
    {
        let temp = Folder::new(&format!("packed-{name}"));
        let colours = [30, 60, 90];
        write(&temp.0.join("m"), 8, &PLAIN[..3]);
        write(&temp.0.join("m"), 8, &[(format!("m_{name}.png").as_str(), colours)]);
        let survey = surveyed(&temp.0);
        let maps = drawn_alone(&format!("packed-{name}"), &survey, 8);
        assert!((1.0 - maps.smoothness[0] - f32::from(colours[roughness]) / 255.0).abs() < 1e-5, "{name}");
        assert!((maps.specular_occlusion[0] - f32::from(colours[occlusion]) / 255.0).abs() < 1e-5, "{name}");
    }
}

#[test]
fn normals_in_openexr_are_read_40() {
    let file = case("40-exr-maps/set/granite/normal.exr");
    let survey = surveyed(&case("40-exr-maps/set"));
    let maps = drawn_alone("40", &survey, 128);
    let image = exr::prelude::read_first_rgba_layer_from_file(
        &file,
        |size, _| vec![vec![[0.0_f32; 3]; size.width()]; size.height()],
        |rows: &mut Vec<Vec<[f32; 3]>>, at, (r, g, b, _): (f32, f32, f32, f32)| rows[at.y()][at.x()] = [r, g, b],
    )
    .expect("readable");
    let rows = image.layer_data.channel_data.pixels;
    let expected: Vec<[f64; 3]> = rows.iter().rev().flatten().map(|t| unit(t.map(f64::from))).collect();
    same("x", maps.normal.iter().map(|n| f64::from(n[0])), expected.iter().map(|n| n[0]));
    same("y", maps.normal.iter().map(|n| f64::from(n[1])), expected.iter().map(|n| n[1]));
}

/// Writes an OpenEXR file with these float channels of 8 x 8 texels, each of one value.
fn write_exr(path: &Path, channels: &[(&str, f32)]) {
    use exr::prelude::*;
    let channels = channels.iter().map(|&(name, value)| AnyChannel::new(name, FlatSamples::F32(vec![value; 64])));
    let channels = AnyChannels::sort(channels.collect());
    let layer = Layer::new((8, 8), LayerAttributes::default(), Encoding::UNCOMPRESSED, channels);
    Image::from_layer(layer).write().non_parallel().to_file(path).expect("an image can be written");
}

#[test]
fn all_maps_may_be_openexr() {
    let temp = Folder::new("exr");
    let folder = temp.0.join("m");
    fs::create_dir_all(&folder).expect("created");
    write_exr(&folder.join("albedo.exr"), &[("R", 0.5), ("G", 0.25), ("B", 0.125)]);
    write_exr(&folder.join("normal.exr"), &[("X", -0.6), ("Y", 0.0), ("Z", 0.8)]);
    write_exr(&folder.join("height.exr"), &[("Y", 0.25)]);
    write_exr(&folder.join("roughness.exr"), &[("R", 0.75), ("G", 0.75), ("B", 0.75)]);
    let maps = drawn_alone("exr", &surveyed(&temp.0), 8);
    assert_eq!(maps.albedo[0], [0.5, 0.25, 0.125], "floats are linear");
    assert!((maps.normal[0][0] + 0.6).abs() < 1e-6 && maps.normal[0][1].abs() < 1e-6, "signed normals: {:?}", maps.normal[0]);
    assert!((maps.height[0] - 0.25).abs() < 1e-6 && (maps.smoothness[0] - 0.25).abs() < 1e-6);

    // A normal map has two channels, and a height map has heights in metres.
    write_exr(&folder.join("normal.exr"), &[("R", 0.8), ("G", 0.5)]);
    write_exr(&folder.join("height.exr"), &[("Y", 3.0)]);
    let survey = surveyed(&temp.0);
    has(&survey.to_string(), &["normal.exr: z is computed", "height.exr: its heights from 3 to 3 are scaled"]);
    let maps = drawn_alone("exr-two", &survey, 8);
    assert!((maps.normal[0][0] - 0.6).abs() < 1e-6 && maps.normal[0][1].abs() < 1e-6, "{:?}", maps.normal[0]);

    for (channels, words) in [
        ([("R", 4.0), ("G", 0.2), ("B", 0.2)], ["albedo.exr", "from 0.2 to 4"]),
        ([("R", f32::NAN), ("G", 0.2), ("B", 0.2)], ["albedo.exr", "64 of its values are NaN"]),
        ([("R", 0.2), ("G", 0.2), ("depth", 0.2)], ["albedo.exr", "G, R, depth"]),
    ] {
        write_exr(&folder.join("albedo.exr"), &channels);
        has(&refusal(&surveyed(&temp.0)), &words);
    }
}

#[test]
fn normal_maps_with_two_channels_stay_flat_or_lean_alike_45() {
    let of = |name: &str| {
        let survey = surveyed(&case("45-normal-conventions").join(name));
        let maps = drawn_alone(&format!("45-{name}"), &survey, 64);
        let first = maps.normal[0];
        assert!(maps.normal.iter().all(|n| n == &first), "{name} has one normal");
        (first.map(f64::from), survey.to_string())
    };
    let close = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).abs() < 0.01 && (a[1] - b[1]).abs() < 0.01;
    let (flat, said) = of("flat");
    assert!(close(flat, [0.0, 0.0]) && !said.contains("note: "), "{flat:?}: {said}");
    let (up, said) = of("gl_up");
    assert!(close(up, [0.0, 0.5]) && !said.contains("note: "), "{up:?}: {said}");
    let (right, said) = of("gl_right");
    assert!(close(right, [0.5, 0.0]) && !said.contains("note: "), "{right:?}: {said}");
    for (name, expected) in [("two_channel_blue0", up), ("two_channel_blue255", up), ("two_channel_blue128_flat", flat)] {
        let (normal, said) = of(name);
        assert!(close(normal, expected), "{name}: {normal:?}, expected {expected:?}");
        has(&said, &["z is computed from x and y"]);
    }
}

#[test]
fn what_is_no_normal_map_is_refused() {
    let temp = Folder::new("no-normals");
    let folder = temp.0.join("m");
    write(&folder, 8, &PLAIN);
    let refused = |words: &[&str]| has(&refusal(&surveyed(&temp.0)), words);
    let normal = folder.join("normal.png");
    image::GrayImage::from_pixel(8, 8, image::Luma([128])).save(&normal).expect("written");
    refused(&["normal.png", "is grey", "height or bump map"]);
    image::RgbImage::from_fn(8, 8, |x, _| image::Rgb([20 * x as u8; 3])).save(&normal).expect("written");
    refused(&["normal.png", "red, green and blue are equal"]);
    for (colour, words) in
        [([0, 0, 0], "not a normal map"), ([255, 255, 255], "not a normal map"), ([128, 128, 40], "point into the surface")]
    {
        write(&folder, 8, &[("normal.png", colour)]);
        refused(&["normal.png", words]);
    }
    // If a normal map has grey and alpha, these are x and y.
    image::ImageBuffer::<image::LumaA<u8>, Vec<u8>>::from_pixel(8, 8, image::LumaA([191, 128])).save(&normal).expect("written");
    let survey = surveyed(&temp.0);
    has(&survey.to_string(), &["z is computed"]);
    let maps = drawn_alone("grey-alpha", &survey, 8);
    assert!((maps.normal[0][0] - 0.498).abs() < 1e-3 && maps.normal[0][1].abs() < 0.01, "{:?}", maps.normal[0]);
    // Normals whose lengths are far from 1 are reported and not refused, because the normals of scanned maps are often averaged.
    write(&folder, 8, &[("normal.png", [128, 128, 200])]);
    has(&surveyed(&temp.0).to_string(), &["normal.png: the lengths of 100 % of its vectors differ from 1"]);
    // A quarter of the vectors points into the surface.
    let pixel = |x: u32, _: u32| image::Rgb(if x < 2 { [128, 128, 40] } else { [128, 128, 255] });
    image::RgbImage::from_fn(8, 8, pixel).save(&normal).expect("written");
    let survey = surveyed(&temp.0);
    has(&survey.to_string(), &["normal.png: 25.0 % of its vectors point into the surface; they are mirrored"]);
}

#[test]
fn what_files_say_about_their_texels_is_applied_or_refused() {
    let temp = Folder::new("said");
    let folder = temp.0.join("m");
    write(&folder, 8, &PLAIN);
    // A roughness map whose channels differ is refused.
    write(&folder, 8, &[("roughness.png", [200, 100, 50])]);
    has(&refusal(&surveyed(&temp.0)), &["roughness.png", "differ in 64 of 64 texels", "arm"]);
    write(&folder, 8, &PLAIN);
    // Returns the PNG with an added chunk gAMA after the chunk IHDR. The value 45455 stands for sRGB, and 100000 for linear codes.
    let with_gamma = |gamma: u32| {
        let png = fs::read(folder.join("albedo.png")).expect("readable");
        let body = [b"gAMA".as_slice(), &gamma.to_be_bytes()].concat();
        let crc = !body.iter().fold(u32::MAX, |crc, &byte| {
            (0..8).fold(crc ^ u32::from(byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
        });
        let (head, rest) = png.split_at(33);
        [head, &4_u32.to_be_bytes(), &body, &crc.to_be_bytes(), rest].concat()
    };
    let [plain, linear] = [45_455, 100_000].map(with_gamma);
    fs::write(folder.join("albedo.png"), plain).expect("written");
    let survey = surveyed(&temp.0);
    let maps = drawn_alone("gamma-srgb", &survey, 8);
    assert!(
        (f64::from(maps.albedo[0][0]) - self::linear(120.0 / 255.0)).abs() < 1e-5 && !survey.to_string().contains("note: "),
        "{survey}"
    );
    fs::write(folder.join("albedo.png"), linear).expect("written");
    let survey = surveyed(&temp.0);
    let maps = drawn_alone("gamma-linear", &survey, 8);
    assert!((maps.albedo[0][0] - 120.0 / 255.0).abs() < 1e-5, "{:?}", maps.albedo[0]);
    has(&survey.to_string(), &["albedo.png: it states the gamma 1.000"]);
    // An alpha channel is reported if it is not opaque.
    image::RgbaImage::from_pixel(8, 8, image::Rgba([120, 110, 100, 9])).save(folder.join("albedo.png")).expect("written");
    has(&surveyed(&temp.0).to_string(), &["albedo.png: its alpha channel is not used"]);
    // A truncated JPEG is refused, because a decoder would fill its missing part with grey.
    fs::remove_file(folder.join("albedo.png")).expect("removed");
    image::RgbImage::from_fn(8, 8, |x, y| image::Rgb([x as u8 * 9, y as u8 * 9, 7])).save(folder.join("albedo.jpg")).expect("written");
    assert!(surveyed(&temp.0).refused.is_empty());
    let jpeg = fs::read(folder.join("albedo.jpg")).expect("readable");
    fs::write(folder.join("albedo.jpg"), &jpeg[..jpeg.len() - 20]).expect("written");
    has(&refusal(&surveyed(&temp.0)), &["albedo.jpg", "truncated"]);
    // Cameras store a preview in an application segment. The preview has an end marker, which must not be taken for that of the picture.
    let length = u16::try_from(jpeg.len() + 2).expect("a small preview").to_be_bytes();
    let (start, rest) = jpeg.split_at(2);
    let with_preview = [start, b"\xff\xe1", &length, &jpeg, rest].concat();
    fs::write(folder.join("albedo.jpg"), &with_preview).expect("written");
    assert!(surveyed(&temp.0).refused.is_empty());
    fs::write(folder.join("albedo.jpg"), &with_preview[..with_preview.len() - 20]).expect("written");
    has(&refusal(&surveyed(&temp.0)), &["albedo.jpg", "truncated"]);
    // Formats that are not supported are named in the error.
    fs::write(folder.join("albedo.jpg"), b"RIFF\x10\0\0\0WEBPVP8 1234").expect("written");
    has(&refusal(&surveyed(&temp.0)), &["albedo.jpg", "WebP files cannot be read", "PNG"]);
    fs::rename(folder.join("albedo.jpg"), folder.join("albedo.dds")).expect("renamed");
    has(&refusal(&surveyed(&temp.0)), &["albedo.dds", ".dds files cannot be read", "PNG"]);
}

#[test]
fn normals_for_directx_without_the_name_are_noticed() {
    let temp = Folder::new("noticed");
    let folder = temp.0.join("m");
    write(&folder, 64, &PLAIN);
    let wave = |i: u32| (f64::from(i) * std::f64::consts::TAU / 64.0).sin_cos();
    let code = |v: f64| (127.5 * v + 127.5).round() as u8;
    image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([code(0.3 * wave(x).0 + 0.3 * wave(y).0); 3]))
        .save(folder.join("height.png"))
        .expect("written");
    // The rows of an image are counted downwards, and v points upwards. So the slope along v has the opposite sign.
    let normals = |green: f64| {
        image::RgbImage::from_fn(64, 64, |x, y| {
            let (dx, dv) = (0.3 * wave(x).1, -0.3 * wave(y).1);
            image::Rgb([code(-dx), code(-dv * green), code((1.0 - dx * dx - dv * dv).sqrt())])
        })
    };
    normals(1.0).save(folder.join("normal.png")).expect("written");
    assert!(!surveyed(&temp.0).to_string().contains("note: "), "negative control");
    normals(-1.0).save(folder.join("normal.png")).expect("written");
    has(&surveyed(&temp.0).to_string(), &["green of the normal map contradicts", "name it normal_dx"]);
    fs::rename(folder.join("normal.png"), folder.join("normal_dx.png")).expect("renamed");
    assert!(!surveyed(&temp.0).to_string().contains("note: "), "the name makes it right");
}

// ------------------------------------------------------------------------------------------------------------ size of a tile

#[test]
fn the_size_of_a_tile_is_given_named_or_assumed() {
    let temp = Folder::new("tiles");
    write(&temp.0.join("granite_2m"), 8, &PLAIN);
    write(&temp.0.join("grass"), 8, &PLAIN);
    write(&temp.0.join("snow"), 8, &PLAIN);
    fs::rename(temp.0.join("snow/albedo.png"), temp.0.join("snow/albedo_1.5m.png")).expect("renamed");
    let survey = surveyed(&temp.0);
    let tiles: Vec<Tile> = survey.found.iter().map(|found| found.tile).collect();
    assert_eq!(tiles, [Tile::Named(2.0), Tile::Assumed(2.5), Tile::Named(1.5)]);
    has(&survey.to_string(), &["granite_2m: one repeat is 2 m (from its name)", "grass: one repeat is 2.5 m (assumed; --tile-size"]);
    drawn("tiles", &survey, 8);
    let given = survey.clone().with_tile_m(Some(4.0)).expect("allowed");
    assert!(given.found.iter().all(|found| found.tile == Tile::Given(4.0)));
    drawn("tiles-given", &given, 8);
    for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 2e5] {
        has(&one_line(survey.clone().with_tile_m(Some(wrong))), &["tile size", "above 0"]);
    }
    fs::rename(temp.0.join("granite_2m/height.png"), temp.0.join("granite_2m/height_3m.png")).expect("renamed");
    has(&refusal(&surveyed(&temp.0)), &["granite_2m", "different sizes", "2 m and 3 m"]);
    // A material in a folder called textures has the name of the folder above, and the size that this name states.
    let temp = Folder::new("tiles-above");
    write(&temp.0.join("rock_2m/textures"), 8, &PLAIN);
    let survey = surveyed(&temp.0);
    assert_eq!((survey.found[0].name.as_str(), survey.found[0].tile), ("rock_2m", Tile::Named(2.0)));
}

#[test]
fn notes_repeat_what_is_assumed_and_not_used() {
    let temp = Folder::new("notes");
    write(&temp.0.join("grass"), 8, &PLAIN);
    write(&temp.0.join("granite_2m"), 8, &PLAIN);
    assert_eq!(surveyed(&temp.0).notes(), ["assumed size of a repeat: grass 2.5 m; a name such as rock_2m states it"]);
    write(&temp.0.join("grass"), 8, &[("normal.png", [128, 128, 200]), ("photo.png", [1; 3])]);
    let notes = surveyed(&temp.0).notes();
    assert_eq!(notes.len(), 3, "{notes:?}");
    has(&notes[0], &["grass: normal.png: the lengths"]);
    has(&notes[2], &["not used from", "photo.png"]);
}

#[test]
fn a_survey_stops_between_materials() {
    let temp = Folder::new("survey-stopped");
    for i in 0..5 {
        write(&temp.0.join(format!("m{i}")), 8, &PLAIN);
    }
    let asked = std::cell::Cell::new(0);
    let stops_at = |limit: usize| {
        asked.set(0);
        survey(&temp.0, &|| {
            asked.set(asked.get() + 1);
            asked.get() >= limit
        })
    };
    has(&one_line(stops_at(1)), &["stopped"]);
    has(&one_line(stops_at(2)), &["stopped"]);
    assert_eq!(stops_at(100).expect("not stopped").found.len(), 5);
    // An import can also be stopped. It reads the heightmap first, and then the materials.
    let read = ReadOptions { metres_per_texel: Some(10.0), height_range_m: Some([300.0, 900.0]), ..ReadOptions::default() };
    let options = ImportOptions { read, materials: Some(temp.0.clone()), ..ImportOptions::default() };
    for limit in 1..=3 {
        asked.set(0);
        let stopped = || {
            asked.set(asked.get() + 1);
            asked.get() >= limit
        };
        has(&one_line(scene_folder::examine(&case("valley.png"), &options, &stopped)), &["stopped", "nothing was written"]);
    }
    assert!(scene_folder::examine(&case("valley.png"), &options, &|| false).is_ok(), "negative control: not stopped");
}

// ----------------------------------------------------------------------------------------------------------------- bad input

#[test]
fn two_files_for_one_map_are_refused() {
    for (other, map) in [
        ("diffuse.png", "albedo"),
        ("albedo.jpg", "albedo"),
        ("albedo_old.png", "albedo"),
        ("m_albedo.png", "albedo"),
        ("displacement.png", "height"),
    ] {
        let temp = Folder::new(&format!("two-{other}"));
        let folder = temp.0.join("m");
        write(&folder, 8, &PLAIN);
        assert!(surveyed(&temp.0).refused.is_empty());
        write(&folder, 8, &[(other, [90, 90, 90])]);
        let text = refusal(&surveyed(&temp.0));
        has(&text, &["`m`", &format!("2 files in {}", folder.display()), &format!("could be the {map} map"), other, "keep one"]);
        has(&one_line(folder::load("m", &folder, 8)), &["`m`", other, "keep one"]);
    }
}

#[test]
fn a_folder_without_materials_is_refused_with_what_was_seen() {
    let temp = Folder::new("nothing");
    has(&one_line(survey(&temp.0.join("nowhere"), &|| false)), &["nowhere"]);
    has(&refusal(&surveyed(&temp.0)), &["no folder holds", "albedo, normal, height and roughness"]);
    write(&temp.0.join("photos"), 8, &[("IMG_1.png", [1; 3]), ("IMG_2.png", [1; 3])]);
    write(&temp.0.join("half"), 8, &PLAIN[..1]);
    fs::create_dir_all(temp.0.join("empty")).expect("created");
    let survey = surveyed(&temp.0);
    has(&refusal(&survey), &["seen: ", "half/albedo.png", "photos/IMG_1.png"]);
    has(unused(&survey, "empty"), &["an empty folder"]);
    has(unused(&survey, "albedo.png"), &["the only map here"]);
    has(&survey.to_string(), &["not used in photos: IMG_1.png, IMG_2.png: its name does not say which map it is"]);
}

#[test]
fn ten_thousand_files_are_listed_in_few_lines() {
    let temp = Folder::new("many");
    let folder = temp.0.join("set");
    write(&folder.join("m"), 8, &PLAIN);
    for i in 0..10_000 {
        let name = match i % 4 {
            0 => format!("IMG_{i}.png"),
            1 => format!("scan{i}.pdf"),
            2 => format!("mat{i}_albedo.png"),
            _ => format!("mat{i}_normal.dds"),
        };
        fs::write(folder.join("m").join(name), b"").expect("written");
    }
    // The folder has thousands of candidates for an albedo.
    let text = refusal(&surveyed(&folder));
    has(&text, &["2501 files in", "could be the albedo map", "and 2493 more"]);
    assert!(text.len() < 1000, "{text}");
    // Without these candidates, the folder has one material, and all other files are listed in few lines.
    for i in (2..10_000).step_by(4) {
        fs::remove_file(folder.join("m").join(format!("mat{i}_albedo.png"))).expect("removed");
    }
    let survey = surveyed(&folder);
    assert_eq!(names(&survey), ["m"]);
    assert_eq!(survey.unused.len(), 7500);
    let text = survey.to_string();
    assert!(text.lines().count() < 20 && text.len() < 4000, "{text}");
    has(&text, &["and 2492 more"]);
}

#[test]
fn more_materials_than_textures_are_refused_before_they_are_read() {
    let temp = Folder::new("too-many");
    for i in 0..33 {
        let folder = temp.0.join(format!("m{i}"));
        fs::create_dir_all(&folder).expect("created");
        for (name, _) in PLAIN {
            fs::write(folder.join(name), b"no image").expect("written");
        }
    }
    has(&one_line(survey(&temp.0, &|| false)), &["33 materials", "at most 32", "take some out"]);
    fs::remove_dir_all(temp.0.join("m7")).expect("removed");
    let survey = surveyed(&temp.0);
    assert_eq!(survey.refused.len(), 32);
    has(&refusal(&survey), &["`m0`", "not a readable PNG", "31 more"]);
}

#[cfg(unix)]
#[test]
fn loops_devices_and_odd_names_are_one_line_each() {
    use std::os::unix::fs::{PermissionsExt as _, symlink};
    let temp = Folder::new("odd");
    let set = temp.0.join("set");
    write(&set.join("rock"), 8, &PLAIN);
    symlink(&set, set.join("loop")).expect("linked");
    symlink(set.join("rock"), set.join("another")).expect("linked");
    symlink("self", set.join("self")).expect("linked");
    symlink("nowhere", set.join("rock/dangling.png")).expect("linked");
    write(&set.join("odd\u{1b}[2J\nname"), 8, &PLAIN);
    fs::write(set.join("rock/\u{202e}gnp.txt\u{7}.bin"), b"").expect("written");
    fs::write(set.join("rock/._albedo.png"), b"").expect("written");
    let pipe = set.join("rock/ao.png");
    let has_pipe = std::process::Command::new("mkfifo").arg(&pipe).status().is_ok_and(|status| status.success());
    let locked = set.join("locked");
    fs::create_dir_all(&locked).expect("created");
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o000)).expect("set");

    let survey = surveyed(&set);
    fs::set_permissions(&locked, fs::Permissions::from_mode(0o700)).expect("set");
    assert_eq!(names(&survey), ["odd__2J_name", "rock"]);
    has(unused(&survey, "loop"), &["already read"]);
    has(unused(&survey, "another"), &["already read"]);
    has(unused(&survey, "self"), &["cannot be followed"]);
    has(unused(&survey, "dangling.png"), &["cannot be followed"]);
    has(unused(&survey, "._albedo.png"), &["hidden"]);
    // If the tests run as the user root, the locked folder can be read, and it is empty.
    assert!(["cannot be read", "an empty folder"].iter().any(|reason| unused(&survey, "locked").contains(reason)), "{survey}");
    if has_pipe {
        has(unused(&survey, "ao.png"), &["not a plain file"]);
    }
    let text = survey.to_string();
    has(&text, &["odd\\u{1b}[2J\\nname/albedo.png", "\\u{202e}gnp.txt\\u{7}.bin"]);
    drawn("odd", &survey, 8);
}

// -------------------------------------------------------------------------------------------------------------- the program

#[test]
fn import_refuses_what_render_would_refuse_and_takes_the_rest() {
    let temp = Folder::new("import-cases");
    let valley = case("valley.png").display().to_string();
    let arguments = |set: &str, out: &str| {
        let options = ["import", &valley, "--metres-per-texel", "10", "--height-range", "300,900", "--materials", set, "--out", out];
        options.map(str::to_owned)
    };
    for (set, words) in [
        ("34-maps-missing/set", ["granite", "no normal map", "albedo.png, height.png, roughness.png"]),
        ("37-not-square/set", ["granite", "albedo.png", "128x64"]),
    ] {
        let out = temp.path("refused");
        let call = arguments(&case(set).display().to_string(), &out);
        failure(&call.each_ref().map(String::as_str), &words);
        assert!(!Path::new(&out).exists(), "{set}: nothing is left behind");
    }
    let sets = [
        "31-polyhaven-names/set",
        "32-ambientcg-names/set",
        "33-upper-case/set",
        "35-albedo-tga/set",
        "36-sizes/set",
        "38-gloss/set",
        "39-packed-arm/set",
        "40-exr-maps/set",
        "41-flat-folder/set",
        "44-nested/set",
        "47-one-unnamed/set",
    ];
    for set in sets {
        let out = temp.path(&set.replace('/', "-"));
        let call = arguments(&case(set).display().to_string(), &out);
        success(&call.each_ref().map(String::as_str));
        let mut scene = scene::load(&out).unwrap_or_else(|error| panic!("{set}: {error}"));
        scene.detail_size = 64;
        let palette = Palette::build(&scene, 64.0, |_| Ok(())).unwrap_or_else(|error| panic!("{set}: {error}"));
        assert_eq!(palette.entries.len(), surveyed(&case(set)).found.len(), "{set}");
    }
    assert_eq!(fs::read_dir(&temp.0).expect("readable").count(), sets.len());
}

#[test]
fn a_flat_map_with_normals_of_two_channels_is_imported_45() {
    let temp = Folder::new("import-45");
    let flat = case("45-normal-conventions/flat.png").display().to_string();
    for (name, expected) in [
        ("flat", [0.0, 0.0]),
        ("gl_up", [0.0, 0.5]),
        ("gl_right", [0.5, 0.0]),
        ("two_channel_blue0", [0.0, 0.5]),
        ("two_channel_blue255", [0.0, 0.5]),
        ("two_channel_blue128_flat", [0.0, 0.0]),
    ] {
        let (set, out) = (case("45-normal-conventions").join(name).display().to_string(), temp.path(name));
        success(&["import", &flat, "--metres-per-texel", "4", "--height-range", "0,0.01", "--materials", &set, "--out", &out]);
        let scene = scene::load(&out).unwrap_or_else(|error| panic!("{name}: {error}"));
        assert_eq!(scene.materials.len(), 1, "{name}");
        let copy = scene.materials[0].folder.as_ref().expect("materials of images have a folder");
        let maps = folder::load(name, &Path::new(&out).join(copy), 64).unwrap_or_else(|error| panic!("{name}: {error}"));
        for normal in maps.normal {
            let distance = (0..2).map(|axis| (f64::from(normal[axis]) - expected[axis]).abs()).fold(0.0, f64::max);
            assert!(distance < 0.01, "{name}: {normal:?}, expected {expected:?}");
        }
    }
}

//! Tests scene files (reading, validation, and the textures and variants that a scene requires), and the names of the 31 variants, the non-empty sets
//! of the five shading flavours.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use kernels::base::names::nearest;
use kernels::frame::requirements::Requirements;
use kernels::residency;
use kernels::scene;
use kernels::scene::{DEFAULT_TEXT, Scene};
use kernels::shading::Estimator;
use kernels::variant::{Flavour, Variant};

/// A small scene file. Tests check the line numbers in errors, so no line may be inserted or removed.
const SMALL: &str = "\
name = \"small\"
[world]
kind = \"procedural\"
seed = 1
[[material]]
name = \"grass\"
procedural = \"grass\"
tile_m = 2.0
[[material]]
name = \"rock\"
procedural = \"granite\"
tile_m = 4.0
[[rule]]
material = \"grass\"
[[rule]]
material = \"rock\"
slope_deg = [40, 90]
[[camera]]
name = \"one\"
position = [0, 0, 2]
yaw_deg = 0
pitch_deg = 0
[[camera]]
name = \"two\"
position = [0, 0, 2]
yaw_deg = 0
pitch_deg = 0
[[path]]
name = \"walk\"
frames_per_key = 4
[[path.key]]
name = \"a\"
position = [0, 0, 2]
yaw_deg = 0
pitch_deg = 0
[[path.key]]
name = \"b\"
position = [0, 9, 2]
yaw_deg = 0
pitch_deg = 0
";

fn parse(text: &str) -> Result<Scene, String> {
    scene::parse(text, "test.toml", Path::new("")).map_err(|e| e.to_string())
}

fn small() -> Scene {
    parse(SMALL).expect("the small scene is valid")
}

/// `SMALL` with one change. Fails if `from` is not found, because the test would then check nothing.
fn edited(from: &str, to: &str) -> String {
    let text = SMALL.replacen(from, to, 1);
    assert_ne!(text, SMALL, "`{from}` is not in the small scene");
    text
}

/// A temporary folder that is removed at the end of a test.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Folder {
        let path = std::env::temp_dir().join(format!("scree-scene-{name}-{}", std::process::id()));
        fs::create_dir_all(&path).expect("the temporary folder can be made");
        Folder(path)
    }

    fn write(&self, name: &str, contents: impl AsRef<[u8]>) -> String {
        let path = self.0.join(name);
        fs::write(&path, contents).expect("a temporary file can be written");
        path.display().to_string()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.0);
    }
}

#[test]
fn built_in_scene_loads_and_has_what_the_documents_promise() {
    let scene = scene::load("default").expect("the built-in scene is valid");
    for name in ["cliff", "ground", "vista", "grazing"] {
        assert!(scene.cameras.iter().any(|c| c.name == name), "camera {name}");
    }
    for name in ["sideways", "forwards"] {
        assert!(scene.paths.iter().any(|p| p.name == name), "path {name}");
    }
    let laid: BTreeSet<&str> = scene.rules.iter().map(|r| r.material.as_str()).collect();
    for material in &scene.materials {
        assert!(laid.contains(material.name.as_str()), "no rule assigns {}", material.name);
    }
    // The tables `flavours` and `blend` of the built-in scene must equal the defaults, as the documentation says.
    let short: String = DEFAULT_TEXT.split("[flavours]").next().map(str::to_owned).unwrap_or_default();
    let rest = parse(&short).expect("the scene without its optional tables is valid");
    assert_eq!((rest.flavours, rest.blend), (scene.flavours, scene.blend));
}

#[test]
fn scenes_survive_a_round_trip_through_toml() {
    let mut full = small();
    full.world =
        scene::World::Procedural { seed: 9, holes: vec![scene::Hole { centre: [1.5, -2.0], radius_m: 3.0 }], colour_modulation: 0.25 };
    full.rules[0].curvature = Some([-1.0, 0.1]);
    full.materials[0].tint = [0.1, 0.2, 0.3];
    for scene in [scene::load("default").expect("valid"), small(), full] {
        let text = toml::to_string(&scene).expect("a scene can be written");
        assert_eq!(parse(&text).as_ref(), Ok(&scene));
    }
}

#[test]
fn unknown_keys_name_the_nearest_known_one_and_their_line() {
    let cases = [
        ("seed = 1", "sead = 1", 4, "unknown key `sead`: did you mean `seed`?"),
        ("tile_m = 4.0", "tile_m = 4.0\ntin = [1,1,1]", 13, "unknown key `tin`: did you mean `tint`?"),
        ("slope_deg =", "slop_deg =", 17, "unknown key `slop_deg`: did you mean `slope_deg`?"),
        ("frames_per_key = 4", "frames_per_keys = 4", 30, "unknown key `frames_per_keys`: did you mean `frames_per_key`?"),
        ("seed = 1", "seed = 1\nholes = [{ centre = [0, 0], radius = 3 }]", 5, "unknown key `radius`: did you mean `radius_m`?"),
        ("name = \"small\"", "name = \"small\"\n[blends]", 2, "unknown key `blends`: did you mean `blend`?"),
        // If no known key is similar, the error lists all known keys.
        ("seed = 1", "seed = 1\nxyzzy = 2", 5, "unknown key `xyzzy`: known here: colour_modulation, holes, seed"),
        ("[[rule]]", "[sun]\nwarmth = 2\n[[rule]]", 14, "unknown key `warmth`: known here: azimuth_deg, elevation_deg, irradiance"),
    ];
    for (from, to, line, what) in cases {
        assert_eq!(parse(&edited(from, to)), Err(format!("scene test.toml:{line}: {what}")));
    }
}

#[test]
fn nearest_word() {
    let known = ["vt", "far-atlas", "near-cliff", "far-cliff", "splat"];
    let cases = [
        ("vt2", Some("vt")),
        ("far_atlas", Some("far-atlas")),
        ("Near-Clif", Some("near-cliff")),
        ("splatt", Some("splat")),
        ("far-clif", Some("far-cliff")),
        ("tessellation", None),
        ("x", None),
        ("", None),
    ];
    for (word, expected) in cases {
        assert_eq!(nearest(word, &known), expected, "{word}");
    }
    assert_eq!(nearest("a", &[]), None);
}

#[test]
fn wrong_scenes_are_refused_with_place_and_remedy() {
    // (replaced text, replacement, line that the error must name, texts that the error must contain)
    let cases: &[(&str, &str, usize, &[&str])] = &[
        ("seed = 1", "seed = -1", 4, &["seed", "-1"]),
        ("seed = 1", "seed = \"x\"", 4, &["`world.seed` is \"x\", must be a whole number from 0 to 4294967295"]),
        ("[[rule]]", "[blend]\nhash_scale = true\n[[rule]]", 14, &["`blend.hash_scale` is true, must be 0.01 to 100"]),
        ("[[rule]]", "[blend]\nanisotropy = 70000\n[[rule]]", 14, &["`blend.anisotropy` is 70000, must be a whole number from 1 to 16"]),
        ("tile_m = 4.0", "tile_m = \"wide\"", 12, &["tile_m", "wide"]),
        ("position = [0, 0, 2]", "position = [0, \"up\", 2]", 20, &["up"]),
        ("name = \"small\"", "name = \" \"", 1, &["name", "empty"]),
        ("kind = \"procedural\"\n", "", 2, &["`kind` is missing", "procedural", "heightmap"]),
        ("kind = \"procedural\"", "kind = \"planet\"", 3, &["planet"]),
        ("seed = 1", "seed = 1\ncolour_modulation = 1.5", 5, &["`world.colour_modulation` is 1.5, must be 0 to 1"]),
        ("seed = 1", "seed = 1\nholes = [{ centre = [0, 0], radius_m = 0 }]", 5, &["holes 1, radius_m", "above 0"]),
        ("procedural = \"grass\"\n", "", 5, &["material 1", "procedural", "folder"]),
        ("procedural = \"granite\"", "procedural = \"granite\"\nfolder = \"x\"", 9, &["material 2", "both", "remove one"]),
        ("procedural = \"grass\"", "folder = \"nowhere\"", 7, &["material 1, folder", "nowhere"]),
        ("name = \"rock\"", "name = \"grass\"", 10, &["material 2, name", "already"]),
        ("tile_m = 2.0", "tile_m = 0.0", 8, &["material 1, tile_m", "above 0"]),
        ("tile_m = 2.0", "tile_m = nan", 8, &["tile_m", "NaN"]),
        ("tile_m = 2.0", "tile_m = inf", 8, &["tile_m", "inf"]),
        ("tile_m = 4.0", "tile_m = 4.0\ntint = [1, 1, 1, 1]", 13, &["material 2, tint", "has 4 entries, must have 3"]),
        ("tile_m = 4.0", "tile_m = 4.0\ntint = [1, -1, 1]", 13, &["material 2, tint"]),
        ("tile_m = 4.0", "tile_m = 4.0\nnormal_strength = -0.1", 13, &["normal_strength"]),
        ("material = \"rock\"", "material = \"rok\"", 16, &["rule 2, material", "did you mean `rock`?"]),
        ("material = \"rock\"", "material = \"quicksilver\"", 16, &["quicksilver", "grass, rock"]),
        ("slope_deg = [40, 90]", "slope_deg = [90, 40]", 17, &["rule 2, slope_deg", "reversed", "[40, 90]"]),
        ("slope_deg = [40, 90]", "slope_deg = [40, 91]", 17, &["slope_deg", "0..=90"]),
        ("slope_deg = [40, 90]", "height_m = [9, 8]", 17, &["height_m", "reversed"]),
        ("slope_deg = [40, 90]", "curvature = [1, 0]", 17, &["curvature", "reversed"]),
        ("slope_deg = [40, 90]", "weight = 0", 17, &["weight", "above 0"]),
        ("slope_deg = [40, 90]", "noise_cover = 1.1", 17, &["noise_cover"]),
        ("slope_deg = [40, 90]", "noise_m = -1", 17, &["noise_m"]),
        ("name = \"small\"", "name = \"small\"\ndetail_size = 96", 2, &["detail_size", "128"]),
        ("name = \"small\"", "name = \"small\"\ndetail_size = 32", 2, &["detail_size"]),
        ("name = \"small\"", "name = \"small\"\ndetail_size = 4096", 2, &["detail_size"]),
        ("[[rule]]", "[flavours]\ncliff_near_m = 2000\n[[rule]]", 14, &["cliff_near_m", "cliff_far_atlas_m = 1500"]),
        ("[[rule]]", "[flavours]\nfar_atlas_m = 2000\n[[rule]]", 14, &["far_atlas_m", "cliff_far_atlas_m = 1500"]),
        ("[[rule]]", "[flavours]\nsplat_band_deg = 45\n[[rule]]", 14, &["splat_band_deg", "cliff_slope_deg = 45"]),
        ("[[rule]]", "[flavours]\ndistance_blend = 0\n[[rule]]", 14, &["distance_blend"]),
        ("[[rule]]", "[flavours]\ncliff_slope_deg = 0\n[[rule]]", 14, &["cliff_slope_deg"]),
        ("[[rule]]", "[blend]\nanisotropy = 0\n[[rule]]", 14, &["anisotropy", "1 to 16"]),
        ("[[rule]]", "[blend]\nanisotropy = 17\n[[rule]]", 14, &["anisotropy", "1 to 16"]),
        ("[[rule]]", "[blend]\nhash_scale = 0\n[[rule]]", 14, &["hash_scale"]),
        ("[[rule]]", "[blend]\nheight_sharpness = 1e9\n[[rule]]", 14, &["height_sharpness"]),
        ("[[rule]]", "[sun]\nelevation_deg = 91\n[[rule]]", 14, &["elevation_deg"]),
        ("[[rule]]", "[sky]\nzenith = [0, 0, -1]\n[[rule]]", 14, &["zenith"]),
        ("name = \"two\"", "name = \"one\"", 24, &["camera 2, name", "already"]),
        ("name = \"two\"", "name = \"../two\"", 24, &["camera 2, name", "letters"]),
        ("pitch_deg = 0", "pitch_deg = 0\nfov_deg = 176", 23, &["camera 1, fov_deg", "1..=175"]),
        ("pitch_deg = 0", "pitch_deg = 91", 22, &["camera 1, pitch_deg"]),
        ("position = [0, 0, 2]", "position = [0, nan, 2]", 20, &["camera 1, position"]),
        ("frames_per_key = 4", "frames_per_key = 0", 30, &["path 1, frames_per_key"]),
        ("tile_m = 2.0", "tile_m = 2.0\ntile_m = 3.0", 9, &["duplicate key"]),
        ("[world]", "[world", 2, &["expected `]`"]),
    ];
    for (from, to, line, says) in cases {
        let error = parse(&edited(from, to)).expect_err(&format!("{to} must be refused"));
        assert!(error.starts_with(&format!("scene test.toml:{line}: ")), "line {line} expected: {error}");
        assert!(!error.contains('\n'), "{error:?} has more than one line");
        for part in *says {
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
    }
}

#[test]
fn lists_have_bounds() {
    let cut = |from: &str, to: &str| {
        let start = SMALL.find(from).expect("the start is in the small scene");
        let end = SMALL[start..].find(to).map_or(SMALL.len(), |at| start + at);
        format!("{}{}", &SMALL[..start], &SMALL[end..])
    };
    let error = |text: &str| parse(text).expect_err("must be refused");
    assert!(error(&cut("[[path.key]]\nname = \"b\"", "[[nothing]]")).contains("at least two [[path.key]]"));
    assert!(error(&cut("[[rule]]", "[[camera]]")).contains("at least one [[rule]]"));
    assert!(error(&cut("[[material]]", "[[rule]]")).contains("at least one [[material]]"));

    let many = |count: usize| {
        let mut scene = small();
        let first = scene.materials[0].clone();
        scene.materials.extend((scene.materials.len()..count).map(|i| scene::Material { name: format!("m{i}"), ..first.clone() }));
        scene::validate(&scene)
    };
    assert!(many(256).is_ok());
    let error = many(257).expect_err("257 materials do not fit an 8-bit index").to_string();
    assert!(error.contains("257") && error.contains("256") && error.contains("remove 1"), "{error}");
}

#[test]
fn files_are_looked_for_beside_the_scene_file() {
    let folder = Folder::new("files");
    let heightmap = "kind = \"heightmap\"\nfile = \"heights.png\"\nmetres_per_texel = 10\nheight_range_m = [0, 100]\n";
    let text = edited("kind = \"procedural\"\nseed = 1\n", heightmap).replace("procedural = \"grass\"", "folder = \"turf\"");
    let file = folder.write("scene.toml", &text);
    let load = |path: &str| scene::load(path).map_err(|e| e.to_string());

    let error = load(&file).expect_err("there is no heightmap yet");
    assert!(error.contains("scene.toml:4: world, file") && error.contains("heights.png"), "{error}");
    folder.write("heights.png", "");
    let error = load(&file).expect_err("there is no material folder yet");
    assert!(error.contains("material 1, folder") && error.contains("turf"), "{error}");
    fs::create_dir(folder.0.join("turf")).expect("a folder can be made");
    let by_file = load(&file).expect("all is there now");
    assert_eq!(by_file.folder, folder.0);
    assert_eq!(load(&folder.0.display().to_string()), Ok(by_file));

    folder.write("scene.toml", text.replace("[0, 100]", "[100, 100]"));
    let error = load(&file).expect_err("a range from 100 to 100 is empty");
    assert!(error.contains("height_range_m") && error.contains("low to high"), "{error}");
}

#[test]
fn what_is_no_scene_file_is_refused() {
    let folder = Folder::new("none");
    let refused = |path: &str| scene::load(path).expect_err("must be refused").to_string();
    assert!(refused(&folder.0.display().to_string()).contains("no scene.toml"));
    assert!(refused("/nowhere/scene.toml").contains("no such file"));
    assert!(refused("defualt").contains("did you mean `default`?"));
    assert!(refused(&folder.write("a.toml", [0xff, 0xfe, 0x00])).contains("not UTF-8"));
    assert!(refused(&folder.write("b.toml", vec![b' '; 5 << 20])).contains("too large"));
    assert!(refused(&folder.write("c.toml", "")).contains("`name` is missing"));
    #[cfg(unix)]
    assert!(refused("/dev/zero").contains("not a plain file"));
}

#[test]
fn cliffs_are_refused_where_the_world_has_none() {
    let mut scene = small();
    let error = scene::validate_against_world(&scene, 31.26).expect_err("cliffs start at 45 degrees").to_string();
    for part in ["45", "31.3", "cliff_slope_deg", "90"] {
        assert!(error.contains(part), "`{part}` is not in: {error}");
    }
    assert!(scene::validate_against_world(&scene, f64::NAN).is_err());
    assert!(scene::validate_against_world(&scene, 45.0).is_ok());
    scene.flavours.cliff_slope_deg = 90.0;
    assert!(scene::validate_against_world(&scene, 31.26).is_ok(), "the scene has no cliffs");
}

#[test]
fn requirements_follow_from_the_scene() {
    let variants = |scene: &Scene| Requirements::of(scene).variants.iter().map(|v| v.mask()).collect::<Vec<_>>();
    let mut scene = small();
    assert_eq!(variants(&scene), (1..=31).collect::<Vec<u8>>());

    scene.flavours.splat_band_deg = 0.0;
    assert_eq!(variants(&scene), (1..=15).collect::<Vec<u8>>());
    assert!(!Requirements::of(&scene).has(Flavour::Splat));

    scene.flavours.cliff_slope_deg = 90.0;
    scene.flavours.splat_band_deg = 8.0;
    assert_eq!(variants(&scene), [1, 2, 3]);

    scene.flavours.far_atlas_m = 0.0;
    assert_eq!(variants(&scene), [2]);
    let least = Requirements::of(&scene);
    let required = |r: &Requirements| r.textures.iter().filter(|t| t.required).map(|t| t.name).collect::<Vec<_>>();
    assert!(!required(&least).iter().any(|name| name.starts_with("page")), "{:?}", required(&least));
    assert!(required(&least).contains(&"detail albedo"), "the reference, with which errors are measured, samples these textures");
    assert!(least.bytes() < Requirements::of(&small()).bytes());

    scene.flavours.cliff_slope_deg = 45.0;
    assert_eq!(variants(&scene), (1..=31).filter(|mask| mask & 1 == 0).collect::<Vec<u8>>());
}

#[test]
fn required_textures_have_the_sizes_of_the_formats() {
    let mut scene = small();
    scene.world =
        scene::World::Procedural { seed: 1, holes: vec![scene::Hole { centre: [0.0; 2], radius_m: 2.0 }], colour_modulation: 0.5 };
    let requirements = Requirements::of(&scene);
    assert!(requirements.holes && requirements.colour_modulation);
    // The payload of a node has 72 419 bytes, including the 64 bytes of the normal cones of patches, which are not uploaded. The + 1 is for slot 0,
    // which stands for nodes that are not loaded.
    let nodes: u64 = requirements.textures.iter().filter(|t| t.name.starts_with("node ") && t.required).map(|t| t.bytes).sum();
    assert_eq!(nodes, (72_419 - 64) * u64::from(residency::CAPACITY + 1));

    let of = |r: &Requirements, name: &str| r.textures.iter().find(|t| t.name == name).cloned().expect("it is in the list");
    // BC1 with mips from 1024² to 1² texels: 256², 128², ..., 2² blocks, and 1 block for each of 4², 2² and 1² texels.
    let blocks: u64 = (1..=8).map(|i| 1u64 << (2 * i)).sum::<u64>() + 3;
    let albedo = of(&requirements, "detail albedo");
    assert_eq!((albedo.layers, albedo.mips, albedo.bytes), (2, 11, 2 * blocks * 8));
    assert_eq!(of(&requirements, "detail normal").bytes, 2 * blocks * 16);
    assert_eq!(of(&requirements, "detail height").size, [512, 512]);
    assert_eq!(of(&requirements, "page normal").bytes, 2 * 256 * (264 * 264 + 132 * 132));

    // Two materials with the same source share its layers.
    scene.materials[1].procedural = scene.materials[0].procedural.clone();
    assert_eq!(of(&Requirements::of(&scene), "detail albedo").layers, 1);

    let without = Requirements::of(&small());
    assert!(!without.holes && !without.colour_modulation);
    assert!(!of(&without, "node colour modulation").required);
}

#[test]
fn requirements_print_both_lists() {
    let mut scene = small();
    scene.flavours.cliff_slope_deg = 90.0;
    let requirements = Requirements::of(&scene);
    let text = requirements.to_string();
    let (required, not) = text.split_once("\nnot required").expect("there are two lists");
    assert!(required.contains("vt+far-atlas") && !required.contains("near-cliff"), "{required}");
    assert!(not.contains("not allocated") && not.contains("near-cliff+far-cliff+splat") && not.contains("variants: 28 of 31"), "{not}");

    let json = serde_json::to_value(&requirements).expect("requirements can be written as JSON");
    assert_eq!(json["variants"], serde_json::json!(["vt", "far-atlas", "vt+far-atlas"]));
    assert_eq!(json["flavours"][4]["required"], false);
}

#[test]
fn variants_are_the_31_non_empty_sets() {
    let all: Vec<Variant> = Variant::all().collect();
    assert_eq!(all.len(), Variant::COUNT);
    let names: BTreeSet<String> = all.iter().map(ToString::to_string).collect();
    assert_eq!(names.len(), 31);
    for variant in all {
        assert_eq!(variant.to_string().parse(), Ok(variant));
        assert_eq!(variant.mask().to_string().parse(), Ok(variant));
        let backwards: Vec<&str> = variant.flavours().map(Flavour::name).collect::<Vec<_>>().into_iter().rev().collect();
        assert_eq!(backwards.join("+").parse(), Ok(variant));
        assert_eq!(variant.flavours().fold(0, |mask, f| mask | f.bit()), variant.mask());
        assert_eq!(
            Estimator::Fc5.promised_fetches_of(variant),
            variant.flavours().map(|f| Estimator::Fc5.promised_fetches(f)).sum::<u32>()
        );
    }
    assert_eq!(Variant::new(31).map(|v| v.to_string()), Some("vt+far-atlas+near-cliff+far-cliff+splat".to_owned()));
}

#[test]
fn what_is_no_variant_is_refused() {
    for wrong in ["0", "32", "-1", "256", "257", "", "+", "vt+", "VT", "all", "vt,splat"] {
        assert!(wrong.parse::<Variant>().is_err(), "{wrong}");
    }
    for mask in [0, 32, 33, 255] {
        assert_eq!(Variant::new(mask), None);
    }
    let error = "vt+vt2".parse::<Variant>().expect_err("vt2 is no flavour").to_string();
    assert!(error.contains("did you mean `vt`?") && error.contains("1 to 31"), "{error}");
    let error = "near-clif".parse::<Variant>().expect_err("a letter is missing").to_string();
    assert!(error.contains("did you mean `near-cliff`?"), "{error}");
}

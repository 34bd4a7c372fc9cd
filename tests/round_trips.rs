//! Tests that what the programs write is read as the same values: scenes, definitions, tables of rows, manifests, the state of the
//! workbench, recorded paths, tables of probes, and settings. The values are arbitrary. They include ends of ranges, extreme numbers,
//! NaN, and texts with quotes, line breaks and Unicode. Also tests that a picture is written with the same bytes in every run.
//!
//! The values are built field by field. If a field is added to a type, this file does not compile until it also builds arbitrary values for
//! that field. All values are drawn with fixed seeds.

use std::cell::Cell;
use std::collections::BTreeMap;
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Debug;
use std::fs;
use std::path::{Path, PathBuf};

use ::experiments::definition::{self, Definition, Expectation, Import, Motion, MovingView, Reference, Small, Times, Vary, Viewing};
use ::experiments::row::Row;
use ::experiments::store::table::{read_parquet, write_csv, write_parquet};
use ::experiments::store::{Manifest, Provenance};
use eframe::egui;
use glam::DVec3;
use kernels::frame::export::write_exr;
use kernels::frame::picture::{Layer, Picture};
use kernels::frame::{self, FrameSettings};
use kernels::probe::{Draw, PROBES};
use kernels::scene::{self, Blend, CameraPath, CameraPose, FlavourRules, Hole, Material, Rule, Scene, Sky, Stroke, StrokeKind, Sun, World};
use kernels::settings::{Kind, Setting, shown};
use kernels::shared::hash::unit2;
use kernels::variant::Variant;
use kernels::view::camera::Pose;
use proptest::collection::{btree_map, vec};
use proptest::option;
use proptest::prelude::*;
use proptest::sample::select;
use proptest::test_runner::{Config, RngSeed, TestRunner};
use toml::Value;
use workbench::model::kept::Kept;
use workbench::model::panes::{Layout, Pane};
use workbench::model::places::{Place, Places, Recorded};
use workbench::model::settings::{OWN, Settings, frame_settings, numbers};

use crate::fixtures::{Folder, success};
use crate::settings::heightmap_scene;

// ---- Checks with many values. ----

/// Calls `check` with `count` values of the strategy, which are the same in every run. Panics if a check fails, and shows the simplest
/// value for which it fails.
fn for_all<S: Strategy>(count: u32, strategy: &S, check: impl Fn(S::Value) -> Result<(), TestCaseError>) {
    let config = Config { cases: count, rng_seed: RngSeed::Fixed(7), failure_persistence: None, ..Config::default() };
    TestRunner::new(config).run(strategy, check).unwrap_or_else(|error| panic!("{error}"));
}

/// Returns a function that converts an error of a reader or writer into a test failure, which also shows the written text.
fn failed(text: &str) -> impl Fn(String) -> TestCaseError {
    move |error| TestCaseError::fail(format!("{error}\n{text}"))
}

/// A value as text, for comparisons. In this form, NaN equals NaN, and 0 differs from -0.
fn shape<T: Debug>(value: &T) -> String {
    format!("{value:?}")
}

// ---- Arbitrary numbers and texts. ----

/// Numbers that are hard to write as text: they have many decimal places or none, large exponents, or a sign.
const SPECIAL: &[f64] =
    &[0.0, -0.0, 1.0, -1.0, 0.1 + 0.2, 1.0 / 3.0, -2.0 / 3.0, 5e-324, f64::MIN_POSITIVE, 1e-7, 123_456.789, 1e15, 1e16, 1e21, f64::MAX];

/// Numbers from `low` to `high`.
fn number(low: f64, high: f64) -> BoxedStrategy<f64> {
    prop_oneof![
        1 => Just(low),
        1 => Just(high),
        2 => select(SPECIAL).prop_map(move |x: f64| x.clamp(low, high)),
        4 => (0.0..1.0f64).prop_map(move |share| (low + share * (high - low)).clamp(low, high)),
    ]
    .boxed()
}

/// Numbers above 0, up to `high`.
fn positive(high: f64) -> BoxedStrategy<f64> {
    number(5e-324, high)
}

/// Lists of `N` numbers.
fn several<const N: usize>(low: f64, high: f64) -> BoxedStrategy<[f64; N]> {
    proptest::array::uniform::<_, N>(number(low, high)).boxed()
}

/// Any number, including infinities, and NaN with any payload.
fn any_number() -> BoxedStrategy<f64> {
    const NOT_FINITE: &[f64] = &[
        f64::NAN,
        f64::from_bits(0x7ff8_0000_0000_0001),
        f64::from_bits(0xfff8_0000_0000_0000),
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MIN,
    ];
    prop_oneof![select(SPECIAL), select(NOT_FINITE), any::<u64>().prop_map(f64::from_bits)].boxed()
}

/// Fragments from which one-line texts are composed. They include characters with a special meaning in TOML, CSV or JSON.
const PIECES: &[&str] = &[
    "a", "Z", "0", "-", "_", "é", "日本", "🏔", "\"", "'", "\"\"\"", "'''", "\\", "\\n", "#", " ", "=", "[", "]", "{", "}", ",", ";", ".",
    "$", "%", "\u{202e}", "\u{a0}", "\u{feff}", "\u{301}",
];
/// Line breaks and control characters.
const CONTROLS: &[&str] = &["\n", "\r\n", "\r", "\t", "\0", "\u{7f}", "\u{85}", "\u{1b}[2J", "\u{2028}"];

fn line() -> BoxedStrategy<String> {
    vec(select(PIECES), 0..8).prop_map(|pieces: Vec<&str>| pieces.concat()).boxed()
}

/// Any text, including the empty text and texts with line breaks.
fn text() -> BoxedStrategy<String> {
    vec(prop_oneof![4 => select(PIECES), 1 => select(CONTROLS)], 0..12).prop_map(|pieces: Vec<&str>| pieces.concat()).boxed()
}

fn texts() -> BoxedStrategy<Vec<String>> {
    vec(text(), 0..4).boxed()
}

/// Names that are shown: one line, not empty.
fn name() -> BoxedStrategy<String> {
    line().prop_map(|line| format!("n{line}")).boxed()
}

/// Names that become part of a file name.
fn stem() -> BoxedStrategy<String> {
    const STEMS: &[&str] = &["a", "B", "7", "-", "_", "é", "ß", "日"];
    vec(select(STEMS), 1..6).prop_map(|pieces: Vec<&str>| pieces.concat()).boxed()
}

// ---- Scenes. ----

/// Limit of coordinates and elevations, metres.
const FAR: f64 = 1.0e7;
/// Folders with textures, within the folder of the scene.
const FOLDERS: &[&str] = &["m", "ü ß/n"];
/// A heightmap within the folder of the scene.
const HEIGHTMAP: &str = "höhen.png";

fn ordered([a, b]: [f64; 2]) -> [f64; 2] {
    if a <= b { [a, b] } else { [b, a] }
}

fn band(low: f64, high: f64) -> BoxedStrategy<Option<[f64; 2]>> {
    option::of(several::<2>(low, high).prop_map(ordered)).boxed()
}

fn hole() -> BoxedStrategy<Hole> {
    (several::<2>(-FAR, FAR), positive(FAR)).prop_map(|(centre, radius_m)| Hole { centre, radius_m }).boxed()
}

fn world() -> BoxedStrategy<World> {
    let procedural = (any::<u32>(), vec(hole(), 0..3), number(0.0, 1.0)).prop_map(|(seed, holes, colour_modulation)| World::Procedural {
        seed,
        holes,
        colour_modulation,
    });
    let range = several::<2>(-FAR, FAR).prop_map(ordered).prop_map(|[low, high]| if low < high { [low, high] } else { [-1.0, 1.0] });
    let heightmap = (positive(1.0e5), range, number(0.0, 1000.0), any::<u32>(), vec(hole(), 0..3), number(0.0, 1.0)).prop_map(
        |(metres_per_texel, height_range_m, detail_m, seed, holes, colour_modulation)| World::Heightmap {
            file: PathBuf::from(HEIGHTMAP),
            metres_per_texel,
            height_range_m,
            detail_m,
            seed,
            holes,
            colour_modulation,
        },
    );
    prop_oneof![procedural, heightmap].boxed()
}

fn material() -> BoxedStrategy<Material> {
    let source = prop_oneof![
        line().prop_map(|name| (Some(name), None::<PathBuf>)),
        select(FOLDERS).prop_map(|folder: &str| (None::<String>, Some(PathBuf::from(folder)))),
    ];
    (name(), source, positive(1.0e5), number(-360.0, 360.0), several::<3>(0.0, 16.0), number(0.0, 16.0))
        .prop_map(|(name, (procedural, folder), tile_m, orientation_deg, tint, normal_strength)| Material {
            name,
            procedural,
            folder,
            tile_m,
            orientation_deg,
            tint,
            normal_strength,
        })
        .boxed()
}

/// Rules without their materials.
fn rule() -> BoxedStrategy<Rule> {
    let of_height = (band(-FAR, FAR), number(0.0, FAR));
    let of_slope = (band(0.0, 90.0), number(0.0, 90.0));
    let of_curvature = (band(-1.0e3, 1.0e3), number(0.0, 1.0e3));
    (positive(1.0e6), of_height, of_slope, of_curvature, number(0.0, 1.0e5), number(0.0, 1.0))
        .prop_map(|(weight, (height_m, height_fade_m), (slope_deg, slope_fade_deg), (curvature, curvature_fade), noise_m, noise_cover)| {
            Rule {
                material: String::new(),
                weight,
                height_m,
                height_fade_m,
                slope_deg,
                slope_fade_deg,
                curvature,
                curvature_fade,
                noise_m,
                noise_cover,
            }
        })
        .boxed()
}

/// Strokes without their materials.
fn stroke() -> BoxedStrategy<Stroke> {
    let kinds = vec![StrokeKind::Splat, StrokeKind::Mask];
    // If a kind is added to the enum, this does not compile. Then also add the kind to the list above.
    kinds.iter().for_each(|kind| match kind {
        StrokeKind::Splat | StrokeKind::Mask => {}
    });
    (select(kinds), vec(several::<2>(-FAR, FAR), 1..4), positive(FAR), 0.0..=1.0f64, number(0.0, 1.0e6))
        .prop_map(|(kind, points, radius_m, share, amount)| Stroke {
            kind,
            material: String::new(),
            points,
            radius_m,
            fade_m: (radius_m * share).min(radius_m),
            amount,
        })
        .boxed()
}

fn camera() -> BoxedStrategy<CameraPose> {
    (stem(), several::<3>(-FAR, FAR), any::<bool>(), number(-3600.0, 3600.0), number(-90.0, 90.0), number(1.0, 175.0))
        .prop_map(|(name, position, above_ground, yaw_deg, pitch_deg, fov_deg)| CameraPose {
            name,
            position,
            above_ground,
            yaw_deg,
            pitch_deg,
            fov_deg,
        })
        .boxed()
}

fn path() -> BoxedStrategy<CameraPath> {
    (stem(), 1..=1_000_000u32, vec(camera(), 2..4))
        .prop_map(|(name, frames_per_key, keys)| CameraPath { name, frames_per_key, keys })
        .boxed()
}

fn flavours() -> BoxedStrategy<FlavourRules> {
    let distances = (number(0.0, FAR), positive(FAR), positive(FAR));
    let others = (number(0.001, 0.9), number(1.0, 180.0), number(0.001, 45.0), number(0.0, 89.0));
    (distances, others)
        .prop_map(|((far_atlas_m, cliff_near_m, cliff_far_atlas_m), (distance_blend, cliff_slope_deg, slope_blend_deg, splat_band_deg))| {
            // Some numbers are changed, so that they satisfy the conditions of a valid scene.
            let cliff_far_atlas_m = cliff_far_atlas_m.max(1.0);
            FlavourRules {
                far_atlas_m: far_atlas_m.min(cliff_far_atlas_m),
                cliff_near_m: cliff_near_m.min(0.5 * cliff_far_atlas_m),
                cliff_far_atlas_m,
                distance_blend,
                cliff_slope_deg,
                slope_blend_deg,
                splat_band_deg: splat_band_deg.min(0.5 * cliff_slope_deg),
            }
        })
        .boxed()
}

fn blend() -> BoxedStrategy<Blend> {
    (number(0.01, 100.0), number(0.0, 1.0e4), number(0.0, 1.0e3), number(-16.0, 16.0), 1..=16u16, number(0.0, 2.0))
        .prop_map(|(hash_scale, height_sharpness, triplanar_sharpness, mip_bias, anisotropy, material_contrast)| Blend {
            hash_scale,
            height_sharpness,
            triplanar_sharpness,
            mip_bias,
            anisotropy,
            material_contrast,
        })
        .boxed()
}

fn sun() -> BoxedStrategy<Sun> {
    (number(-360.0, 360.0), number(-90.0, 90.0), several::<3>(0.0, 1.0e4))
        .prop_map(|(azimuth_deg, elevation_deg, irradiance)| Sun { azimuth_deg, elevation_deg, irradiance })
        .boxed()
}

fn sky() -> BoxedStrategy<Sky> {
    (several::<3>(0.0, 1.0e4), several::<3>(0.0, 1.0e4)).prop_map(|(zenith, horizon)| Sky { zenith, horizon }).boxed()
}

/// Makes names unique by a prefix: the index of the name.
fn numbered<'a>(names: impl Iterator<Item = &'a mut String>) {
    names.enumerate().for_each(|(number, name)| *name = format!("{number}-{name}"));
}

/// Scenes that are valid in a folder that [`scene_folder`] has made.
fn scenes(folder: &Path) -> BoxedStrategy<Scene> {
    let folder = folder.to_owned();
    let head = (name(), text(), world(), select(vec![64u32, 128, 256, 512, 1024, 2048]));
    let lists = (
        vec(material(), 1..4),
        vec((rule(), any::<usize>()), 1..4),
        vec((stroke(), any::<usize>()), 0..3),
        vec(camera(), 0..3),
        vec(path(), 0..3),
    );
    (head, lists, flavours(), blend(), sun(), sky())
        .prop_map(
            move |(
                (name, description, world, detail_size),
                (mut materials, rules, strokes, mut cameras, mut paths),
                flavours,
                blend,
                sun,
                sky,
            )| {
                numbered(materials.iter_mut().map(|material| &mut material.name));
                numbered(cameras.iter_mut().map(|camera| &mut camera.name));
                numbered(paths.iter_mut().map(|path| &mut path.name));
                let chosen = |place: usize| materials[place % materials.len()].name.clone();
                let rules = rules.into_iter().map(|(rule, place)| Rule { material: chosen(place), ..rule }).collect();
                let strokes = strokes.into_iter().map(|(stroke, place)| Stroke { material: chosen(place), ..stroke }).collect();
                Scene {
                    name,
                    description,
                    world,
                    materials,
                    rules,
                    strokes,
                    detail_size,
                    flavours,
                    blend,
                    sun,
                    sky,
                    cameras,
                    paths,
                    folder: folder.clone(),
                }
            },
        )
        .boxed()
}

/// Makes a folder with the files that arbitrary scenes name.
fn scene_folder(name: &str) -> Folder {
    let folder = Folder::new(name);
    folder.write(HEIGHTMAP, "");
    for textures in FOLDERS {
        fs::create_dir_all(folder.0.join(textures)).expect("a folder can be made");
    }
    folder
}

#[test]
fn scenes_are_read_as_they_were_written() {
    let folder = scene_folder("round-trip-scenes");
    // The number of scenes with a procedural world, with a heightmap, and with strokes.
    let seen = [const { Cell::new(0) }; 3];
    let count = |place: usize| seen[place].set(seen[place].get() + 1);
    for_all(300, &scenes(&folder.0), |scene| {
        count(match scene.world {
            World::Procedural { .. } => 0,
            World::Heightmap { .. } => 1,
        });
        if !scene.strokes.is_empty() {
            count(2);
        }
        let text = toml::to_string(&scene).map_err(|error| TestCaseError::fail(error.to_string()))?;
        let again = scene::parse(&text, "written.toml", &folder.0).map_err(|error| failed(&text)(error.to_string()))?;
        prop_assert_eq!(shape(&again), shape(&scene), "{}", text);
        prop_assert!(again == scene);
        Ok(())
    });
    assert!(seen.iter().all(|count| count.get() > 50), "{seen:?}");
}

/// Returns copies of a text, each with one letter or digit replaced: a copy for every `step`-th letter or digit.
fn changed(text: &str, step: usize) -> impl Iterator<Item = String> {
    let places: Vec<usize> = (0..text.len()).filter(|&at| text.as_bytes()[at].is_ascii_alphanumeric()).step_by(step).collect();
    places.into_iter().map(move |at| {
        let other = match text.as_bytes()[at] {
            b'9' => '1',
            digit @ b'0'..=b'8' => char::from(digit + 1),
            b'x' => 'y',
            _ => 'x',
        };
        format!("{}{other}{}", &text[..at], &text[at + 1..])
    })
}

/// Changes single letters and digits of a scene and of a definition: each one of the definition, and every third one of the scene. The reader
/// must refuse a changed text or read it as a different value.
#[test]
fn no_letter_of_a_scene_or_definition_is_ignored() {
    let built_in = scene::load(scene::DEFAULT).expect("built in");
    let text = toml::to_string(&built_in).expect("a scene can be written");
    let mut tried = 0;
    for changed in changed(&text, 3) {
        assert!(scene::parse(&changed, "t.toml", Path::new("")).ok().is_none_or(|scene| scene != built_in), "{changed}");
        tried += 1;
    }
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/definition/small.toml");
    let definition = definition::stored(&fs::read_to_string(file).expect("in the corpus")).expect("a definition");
    let text = definition.to_toml().expect("a definition can be written");
    for changed in changed(&text, 1) {
        assert!(definition::stored(&changed).ok().is_none_or(|other| other != definition), "{changed}");
        tried += 1;
    }
    assert!(tried > 1000, "{tried} changes");
}

// ---- Definitions. ----

fn scalar() -> BoxedStrategy<Value> {
    prop_oneof![
        text().prop_map(Value::String),
        any::<i64>().prop_map(Value::Integer),
        any_number().prop_map(Value::Float),
        any::<bool>().prop_map(Value::Boolean),
    ]
    .boxed()
}

/// Values of TOML, except dates, which no setting takes.
fn value() -> BoxedStrategy<Value> {
    let list = vec(scalar(), 0..3).prop_map(Value::Array);
    let lists = vec(vec(scalar(), 0..3).prop_map(Value::Array), 0..3).prop_map(Value::Array);
    let table = btree_map(text(), scalar(), 0..3).prop_map(|table| Value::Table(table.into_iter().collect()));
    prop_oneof![4 => scalar(), 1 => list, 1 => lists, 1 => table].boxed()
}

fn values() -> BoxedStrategy<BTreeMap<String, Value>> {
    btree_map(text(), value(), 0..4).boxed()
}

fn import() -> BoxedStrategy<Import> {
    (text(), option::of(any_number()), option::of([any_number(), any_number()]), option::of(text()), any_number())
        .prop_map(|(heightmap, metres_per_texel, height_range_m, materials, detail_m)| Import {
            heightmap,
            metres_per_texel,
            height_range_m,
            materials,
            detail_m,
        })
        .boxed()
}

fn moving_view() -> BoxedStrategy<MovingView> {
    let motions = vec![Motion::Sideways, Motion::Forwards, Motion::Turn, Motion::Zoom];
    // If a motion is added to the enum, this does not compile. Then also add the motion to the list above.
    motions.iter().for_each(|motion| match motion {
        Motion::Sideways | Motion::Forwards | Motion::Turn | Motion::Zoom => {}
    });
    (text(), text(), select(motions), any_number())
        .prop_map(|(name, camera, motion, step)| MovingView { name, camera, motion, step })
        .boxed()
}

fn times() -> BoxedStrategy<Times> {
    let all = vec![Times::None, Times::FirstNoise, Times::All];
    // If a choice is added to the enum, this does not compile. Then also add the choice to the list above.
    all.iter().for_each(|times| match times {
        Times::None | Times::FirstNoise | Times::All => {}
    });
    select(all).boxed()
}

fn small() -> BoxedStrategy<Small> {
    let count = || option::of(any::<u32>());
    let counts = (option::of(any::<[u32; 2]>()), count(), count(), count());
    (counts, option::of(texts()), option::of(texts()), option::of(vec(value(), 0..3)))
        .prop_map(|((size, frames, warm_up, seeds), views, variants, values)| Small {
            size,
            frames,
            warm_up,
            seeds,
            views,
            variants,
            values,
        })
        .boxed()
}

fn expectation() -> BoxedStrategy<Expectation> {
    (text(), text(), values(), option::of(values()), [any_number(), any_number()])
        .prop_map(|(claim, metric, selection, over, range)| Expectation { claim, metric, selection, over, range })
        .boxed()
}

fn definitions() -> BoxedStrategy<Definition> {
    let head = (text(), text(), text(), option::of(text()), option::of(import()), texts(), vec(moving_view(), 0..3));
    let middle = (any::<[u32; 2]>(), any::<u32>(), any::<u32>(), any::<u32>(), texts(), texts(), texts(), texts());
    let vary = option::of((text(), vec(value(), 0..3)).prop_map(|(parameter, values)| Vary { parameter, values }));
    let reference = (any::<u32>(), any::<u32>()).prop_map(|(spp, max_spp)| Reference { spp, max_spp });
    let viewing =
        (any_number(), any_number()).prop_map(|(frames_per_second, pixels_per_degree)| Viewing { frames_per_second, pixels_per_degree });
    let tail = (vary, values(), texts(), any::<bool>(), reference, (times(), any_number()), small(), vec(expectation(), 0..3));
    (head, middle, tail, (texts(), viewing))
        .prop_map(|(head, middle, tail, (signals, viewing))| {
            let (name, question, analysis, scene, import, views, moving_views) = head;
            let (size, frames, warm_up, seeds, variants, estimators, noises, temporal) = middle;
            let (vary, settings, metrics, video, reference, (times, times_budget_s), small, expectations) = tail;
            Definition {
                name,
                question,
                analysis,
                scene,
                import,
                views,
                moving_views,
                size,
                frames,
                warm_up,
                seeds,
                variants,
                estimators,
                noises,
                temporal,
                vary,
                settings,
                metrics,
                signals,
                viewing,
                video,
                reference,
                times,
                times_budget_s,
                small,
                expectations,
                folder: PathBuf::new(),
            }
        })
        .boxed()
}

#[test]
fn definitions_are_read_as_they_were_written() {
    for_all(300, &definitions(), |definition| {
        let text = definition.to_toml().map_err(|error| TestCaseError::fail(format!("{error:#}")))?;
        let again = definition::stored(&text).map_err(|error| failed(&text)(format!("{error:#}")))?;
        prop_assert_eq!(shape(&again), shape(&definition), "{}", text);
        Ok(())
    });
}

/// Definitions in `experiments/definitions` do not change when they are written and read again by the reader that also validates them.
#[test]
fn definitions_of_the_repository_are_read_as_they_were_written() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../experiments/definitions");
    let mut read = 0;
    for entry in fs::read_dir(&folder).expect("a folder") {
        let file = entry.expect("an entry").path();
        // Skip definitions that need real terrain data. They have the same keys as the others.
        if file.extension().is_none_or(|e| e != "toml") || fs::read_to_string(&file).expect("readable").contains("$SCREE_DATA") {
            continue;
        }
        let definition = definition::load(&file).unwrap_or_else(|error| panic!("{error:#}"));
        let text = definition.to_toml().expect("a definition can be written");
        let again = definition::parse(&text, "written.toml", &definition.folder).unwrap_or_else(|error| panic!("{error:#}\n{text}"));
        assert_eq!(again, definition, "{text}");
        read += 1;
    }
    assert!(read >= 2, "{read} definitions");
}

// ---- Rows and manifests. ----

fn rows() -> BoxedStrategy<Vec<Row>> {
    let choice = (text(), text(), text(), text(), text(), text(), text(), text(), text(), text());
    let place = (option::of(any::<u32>()), option::of(any::<u32>()), option::of(any_number()));
    let row = (choice, place, text(), text(), any_number(), option::of(any_number()), option::of(any_number())).prop_map(
        |(choice, (frame, lag, frequency), metric, unit, value, standard_error, freedom)| {
            let (experiment, scene, view, variant, estimator, noise, temporal, signal, parameter, setting) = choice;
            Row {
                experiment,
                scene,
                view,
                variant,
                estimator,
                noise,
                temporal,
                signal,
                parameter,
                setting,
                frame,
                lag,
                frequency,
                metric,
                unit,
                value,
                standard_error,
                freedom,
            }
        },
    );
    vec(row, 0..12).boxed()
}

/// Whether both lists have the same rows. Numbers are compared bit by bit, so NaN equals only a NaN with the same payload.
fn same(a: &[Row], b: &[Row]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.order(b).is_eq())
}

/// The rows as they are after a round trip through CSV, which does not keep the payload of NaN.
fn without_payloads(rows: &[Row]) -> Vec<Row> {
    let plain = |x: f64| if x.is_nan() { f64::NAN } else { x };
    let row = |row: &Row| Row {
        value: plain(row.value),
        frequency: row.frequency.map(plain),
        standard_error: row.standard_error.map(plain),
        freedom: row.freedom.map(plain),
        ..row.clone()
    };
    rows.iter().map(row).collect()
}

#[test]
fn tables_are_read_as_they_were_written() {
    let folder = Folder::new("round-trip-tables");
    let (parquet, csv) = (folder.0.join("t.parquet"), folder.0.join("t.csv"));
    let payloads = Cell::new(0);
    for_all(100, &(rows(), btree_map(text(), text(), 0..4), 1..5usize), |(rows, notes, group)| {
        let fail = |error: anyhow::Error| TestCaseError::fail(format!("{error:#}"));
        let listed: Vec<(String, String)> = notes.iter().map(|(name, value)| (name.clone(), value.clone())).collect();
        write_parquet(&parquet, &mut rows.chunks(group).map(|rows| Ok(rows.to_vec())), &listed).map_err(fail)?;
        let table = read_parquet(&parquet).map_err(fail)?;
        prop_assert!(same(&table.rows, &rows), "{:?}", table.rows);
        prop_assert_eq!(table.notes, notes);
        write_csv(&csv, &mut rows.chunks(group).map(|rows| Ok(rows.to_vec()))).map_err(fail)?;
        let mut reader = csv::Reader::from_path(&csv).map_err(|error| TestCaseError::fail(error.to_string()))?;
        let read = reader.deserialize::<Row>().collect::<Result<Vec<Row>, _>>().map_err(|error| TestCaseError::fail(error.to_string()))?;
        let plain = without_payloads(&rows);
        prop_assert!(same(&read, &plain), "{:?}", read);
        payloads.set(payloads.get() + u32::from(!same(&rows, &plain)));
        Ok(())
    });
    // Negative control: NaN with a payload occurred, and the comparison notices a payload.
    assert!(payloads.get() > 10, "{} tables with a NaN other than the usual one", payloads.get());
}

fn manifests() -> BoxedStrategy<Manifest> {
    let provenance =
        (text(), text(), any::<bool>(), option::of(text()), text()).prop_map(|(adapter, driver, software, without_anisotropy, command)| {
            Provenance { adapter, driver, software, without_anisotropy, command }
        });
    let head = (text(), text(), text(), text(), text(), any::<bool>(), option::of(text()));
    (head, text(), text(), option::of(text()), provenance, any::<bool>(), text(), btree_map(text(), text(), 0..4))
        .prop_map(|(head, seed, version, commit, provenance, complete, identity, files)| {
            let (schema, experiment, definition, definition_hash, source_hash, small, shard) = head;
            Manifest {
                format: 1,
                schema,
                experiment,
                definition,
                definition_hash,
                source_hash,
                small,
                shard,
                seed,
                version,
                commit,
                provenance,
                complete,
                identity,
                files,
            }
        })
        .boxed()
}

#[test]
fn manifests_are_read_as_they_were_written() {
    for_all(300, &manifests(), |manifest| {
        let text = serde_json::to_string_pretty(&manifest).map_err(|error| TestCaseError::fail(error.to_string()))?;
        let again = Manifest::parse(&text, Path::new("manifest.json")).map_err(|error| failed(&text)(format!("{error:#}")))?;
        prop_assert_eq!(again, manifest);
        Ok(())
    });
}

// ---- Settings. ----

/// Values that a setting of this kind accepts.
fn accepted(kind: Kind) -> BoxedStrategy<Value> {
    match kind {
        Kind::Number(range) => {
            number(range.least, range.most).prop_filter("in the range", move |x| range.contains(*x)).prop_map(Value::Float).boxed()
        }
        Kind::Numbers(count, range) => {
            let inside = number(range.least, range.most).prop_filter("in the range", move |x| range.contains(*x));
            vec(inside.prop_map(Value::Float), count).prop_map(Value::Array).boxed()
        }
        Kind::Whole(least, most) => {
            prop_oneof![Just(least), Just(most), least..=most].prop_map(|whole| Value::Integer(i64::from(whole))).boxed()
        }
        Kind::OneOf(numbers) => select(numbers).prop_map(|whole: u32| Value::Integer(i64::from(whole))).boxed(),
        Kind::Flag => any::<bool>().prop_map(Value::Boolean).boxed(),
        Kind::Name(names) => select(names()).prop_map(|name: &str| Value::String(name.to_owned())).boxed(),
        // The only setting of this kind is the variant.
        Kind::Text(_) => {
            let names: Vec<String> = Variant::all().map(|variant| variant.to_string()).chain(["auto".to_owned()]).collect();
            select(names).prop_map(Value::String).boxed()
        }
    }
}

/// Checks that arbitrary values of a setting do not change when they are written and read again, as TOML and as a command-line argument.
fn there_and_back<T: Clone + Debug + 'static>(setting: &'static Setting<T>, usual: &T) {
    for_all(60, &accepted(setting.kind), |value| {
        let mut owner = usual.clone();
        setting.set(&mut owner, &value).map_err(TestCaseError::fail)?;
        let stored = setting.get(&owner).ok_or_else(|| TestCaseError::fail("the value is gone"))?;
        let document = format!("x = {stored}\n");
        let table: toml::Table = document.parse().map_err(|error: toml::de::Error| failed(&document)(error.to_string()))?;
        let argument = stored.as_str().map_or_else(|| shown(&stored), str::to_owned);
        for read in [table["x"].clone(), setting.kind.read(&argument)] {
            prop_assert_eq!(shape(&read), shape(&stored), "{}: `{}`, `{}`", setting.key, document, argument);
            let mut again = usual.clone();
            setting.set(&mut again, &read).map_err(TestCaseError::fail)?;
            prop_assert_eq!(shape(&again), shape(&owner));
        }
        Ok(())
    });
}

#[test]
fn settings_are_read_as_they_were_written() {
    let procedural = scene::load(scene::DEFAULT).expect("built in");
    let heightmap = heightmap_scene();
    let mut count = 0;
    for scene in [procedural, heightmap] {
        for setting in scene::settings().filter(|setting| setting.get(&scene).is_some()) {
            there_and_back(setting, &scene);
            count += 1;
        }
    }
    for setting in frame::settings() {
        there_and_back(setting, &FrameSettings::default());
        count += 1;
    }
    assert!(count > 50, "{count} settings");
}

// ---- The workbench. ----

fn pose() -> BoxedStrategy<Pose> {
    (several::<3>(-1e300, 1e300), number(-1e6, 1e6), number(-FRAC_PI_2, FRAC_PI_2), number(1e-6, PI.next_down()))
        .prop_map(|(position, yaw, pitch, fov)| Pose { position: DVec3::from_array(position), yaw, pitch, fov })
        .boxed()
}

fn bits(pose: &Pose) -> [u64; 6] {
    let Pose { position, yaw, pitch, fov } = *pose;
    [position.x, position.y, position.z, yaw, pitch, fov].map(f64::to_bits)
}

/// Whether two poses are equal, except for the rounding of angles that are converted to degrees and back.
fn close(a: &Pose, b: &Pose) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 2.0 * f64::EPSILON * b.abs();
    a.position == b.position && near(a.yaw, b.yaw) && near(a.pitch, b.pitch) && near(a.fov, b.fov)
}

#[test]
fn recorded_paths_are_read_as_they_were_written() {
    for_all(200, &(text(), vec(pose(), 1..6)), |(name, poses)| {
        let path = Recorded::new(&name, poses.clone()).map_err(TestCaseError::fail)?;
        let table = path.to_csv();
        let again = Recorded::from_csv(&name, table.as_bytes(), "t.csv").map_err(failed(&table))?;
        prop_assert_eq!((again.frames(), &again.name), (poses.len(), &name));
        for (frame, pose) in (0..).zip(&poses) {
            prop_assert_eq!(bits(&again.pose(frame)), bits(pose), "frame {} of {}", frame, table);
        }
        Ok(())
    });
}

fn layout() -> BoxedStrategy<Layout> {
    // No pane is called `Gone`. Such a name is left out when the layout becomes a tree.
    let names: Vec<String> = Pane::ALL.iter().map(|pane| pane.name().to_owned()).chain(["Gone".to_owned()]).collect();
    let shares = || vec(0.01..4.0f32, 0..4);
    select(names)
        .prop_map(|name| Layout::Pane { name })
        .prop_recursive(3, 16, 4, move |inner| {
            let children = || vec(inner.clone(), 0..4);
            prop_oneof![
                (0..4usize, children()).prop_map(|(open, children)| Layout::Tabs { open, children }),
                (shares(), children()).prop_map(|(shares, children)| Layout::Row { shares, children }),
                (shares(), children()).prop_map(|(shares, children)| Layout::Column { shares, children }),
                (0..4usize, shares(), shares(), children()).prop_map(|(columns, column_shares, row_shares, children)| Layout::Grid {
                    columns,
                    column_shares,
                    row_shares,
                    children,
                }),
            ]
        })
        .boxed()
}

/// Arbitrary settings. Only what the workbench saves is arbitrary: the numbers of the scene that the workbench shows, the settings of the
/// frame, and the settings that only the workbench has.
fn settings() -> BoxedStrategy<Settings> {
    let of_frame: Vec<BoxedStrategy<Value>> = frame_settings().map(|setting| accepted(setting.kind)).collect();
    let own: Vec<BoxedStrategy<Value>> = OWN.iter().map(|setting| accepted(setting.kind)).collect();
    let plain = scene::load(scene::DEFAULT).expect("built in");
    (of_frame, own, flavours(), blend(), sun())
        .prop_map(move |(of_frame, own, flavours, blend, sun)| {
            let mut settings = Settings::new(plain.clone());
            let changed = Scene { flavours, blend, sun, ..plain.clone() };
            for (setting, _) in numbers() {
                if let Some(value) = setting.get(&changed) {
                    setting.set(&mut settings.scene, &value).expect("an accepted number");
                }
            }
            for (setting, value) in frame_settings().zip(&of_frame) {
                setting.set(&mut settings.frame, value).expect("an accepted value");
            }
            for (setting, value) in OWN.into_iter().zip(&own) {
                setting.set(&mut settings, value).expect("an accepted value");
            }
            settings
        })
        .boxed()
}

#[test]
fn the_state_of_the_workbench_is_read_as_it_was_written() {
    let plain = scene::load(scene::DEFAULT).expect("built in");
    let id = egui::Id::unique("round trips");
    let trees = Cell::new(0);
    let places = (vec((text(), pose()), 0..3), vec((text(), vec(pose(), 1..4)), 0..3));
    for_all(200, &(settings(), places, layout()), |(settings, (places, paths), layout)| {
        let Some(tree) = layout.tree(id) else { return Ok(()) };
        trees.set(trees.get() + 1);
        let mut all = Places::default();
        for (name, pose) in &places {
            all.keep(name, *pose);
        }
        for (name, poses) in &paths {
            all.add(Recorded::new(name, poses.clone()).map_err(TestCaseError::fail)?);
        }
        let kept = Kept::of(&Kept::default(), scene::DEFAULT, &settings, &plain, &all, &tree);
        let write = |kept: &Kept| toml::to_string(kept).map_err(|error| TestCaseError::fail(error.to_string()));
        let read = |text: &str| Kept::parse(text.as_bytes().to_vec(), "state").map_err(|refused| failed(text)(shape(&refused)));
        let text = write(&kept)?;
        let once = read(&text)?;
        let mut again = Settings::new(plain.clone());
        let said = [once.apply_look(&mut again), once.apply_numbers(scene::DEFAULT, &mut again.scene)].concat();
        prop_assert_eq!(said, Vec::<String>::new());
        prop_assert_eq!(shape(&again), shape(&settings), "{}", text);
        prop_assert_eq!(once.tree(id).as_ref().and_then(Layout::of), Layout::of(&tree));
        prop_assert_eq!(once.recent(), kept.recent());
        // Recorded paths must not change. Places (saved poses) are written in degrees, so the first round trip may round their angles. The second
        // must not change them.
        let of = |kept: &Kept| kept.places(scene::DEFAULT);
        let poses = |path: &Recorded| (0..).take(path.frames()).map(|frame| bits(&path.pose(frame))).collect::<Vec<_>>();
        let flown = |places: &Places| places.paths().iter().map(|path| (path.name.clone(), poses(path))).collect::<Vec<_>>();
        prop_assert_eq!(flown(&of(&once)), flown(&all));
        let near = |a: &Place, b: &Place| a.name == b.name && close(&a.pose, &b.pose);
        let (found, given) = (of(&once), all.places());
        prop_assert!(found.places().len() == given.len() && found.places().iter().zip(given).all(|(a, b)| near(a, b)), "{}", text);
        let twice = read(&write(&once)?)?;
        let exact = |places: &Places| places.places().iter().map(|place| (place.name.clone(), bits(&place.pose))).collect::<Vec<_>>();
        prop_assert_eq!(exact(&of(&twice)), exact(&found));
        Ok(())
    });
    assert!(trees.get() > 100, "{} layouts", trees.get());
}

// ---- Tables of probes. ----

#[test]
fn tables_of_probes_keep_their_columns_and_every_digit() {
    let folder = Folder::new("round-trip-probes");
    let (input, output) = (folder.path("in.csv"), folder.path("out.csv"));
    for probe in PROBES {
        let columns = probe.inputs.len();
        let mut values: Vec<f64> = (0..12).flat_map(|row| (probe.random)(&mut Draw { row, column: 0, table: 77 })).collect();
        // Write the columns in reverse order, and add two columns of texts, which are not inputs of the probe.
        let write = |values: &[f64]| {
            let mut writer = csv::Writer::from_path(&input).expect("writable");
            let names = probe.inputs.iter().rev().map(|column| column.name).chain(["größe, \"m\"", "note"]);
            writer.write_record(names).expect("writable");
            for (row, cells) in values.chunks_exact(columns).enumerate() {
                let cells = cells.iter().rev().map(ToString::to_string);
                // A table must not contain NUL, because the reader takes it as a sign of UTF-16.
                let control = Some(CONTROLS[row % CONTROLS.len()]).filter(|control| *control != "\0").unwrap_or_default();
                let others = [PIECES[row % PIECES.len()], control].map(|piece| format!("x{piece}x"));
                writer.write_record(cells.chain(others)).expect("writable");
            }
            writer.flush().expect("writable");
        };
        for (on, expected) in [("f64", probe.on_f64(&values)), ("f32", probe.on_f32(&values))] {
            write(&values);
            success(&["probe", probe.name, "--on", on, "--input", &input, "--output", &output]);
            let given: Vec<csv::StringRecord> = records(&input);
            let written: Vec<csv::StringRecord> = records(&output);
            assert_eq!(written.len(), 13, "{}", probe.name);
            let header: Vec<&str> = given[0].iter().chain(probe.outputs.iter().map(|column| column.name)).collect();
            assert_eq!(written[0].iter().collect::<Vec<_>>(), header, "{}", probe.name);
            for (row, (written, given)) in written.iter().zip(&given).enumerate().skip(1) {
                assert!(written.iter().zip(given).all(|(a, b)| a == b), "{}, row {row}: {written:?}", probe.name);
                let outputs = probe.outputs.len();
                let results = written.iter().skip(given.len()).zip(&expected[(row - 1) * outputs..]);
                for ((cell, expected), column) in results.zip(probe.outputs) {
                    let is_single = on == "f32" && !column.is_word();
                    let read = if is_single { cell.parse::<f32>().map(f64::from) } else { cell.parse::<f64>() };
                    let read = read.unwrap_or_else(|error| panic!("{}: `{cell}`: {error}", probe.name));
                    let is_same = read.to_bits() == expected.to_bits() || read.is_nan() && expected.is_nan();
                    assert!(is_same, "{} on {on}, row {row}, {}: {cell} and {expected:?}", probe.name, column.name);
                }
                assert_eq!(written.len(), given.len() + outputs);
            }
        }
        // Negative control: if one number is different, the table is different.
        let before = fs::read(&input).expect("written");
        let real = probe.inputs.iter().position(|column| column.whole.is_none()).unwrap_or(0);
        values[real] = if probe.inputs[real].whole.is_none() { values[real].next_up() } else { 1.0 - values[real].min(1.0) };
        write(&values);
        assert!(fs::read(&input).expect("written") != before, "{}", probe.name);
    }
}

/// The records of a CSV file, the header first.
fn records(file: &str) -> Vec<csv::StringRecord> {
    let reader = csv::ReaderBuilder::new().has_headers(false).from_path(file).expect("a table");
    reader.into_records().map(|record| record.expect("a record")).collect()
}

// ---- Pictures. ----

#[test]
fn a_picture_has_the_same_bytes_whichever_threads_compress_its_tiles() {
    // 10 x 6 tiles of 64 x 64 pixels. A third of the tiles is uniform and the others are noise, so threads need different times for them.
    let size = [640, 384];
    let value = |i: u32, channel: i32| {
        let (x, y) = (i % size[0], i / size[0]);
        if (x / 64 + y / 64) % 3 == 0 { 0.5 } else { unit2(i.cast_signed(), channel, 1, 2) as f32 }
    };
    let area = size[0] * size[1];
    let layers = vec![
        ("albedo".to_owned(), Layer::Rgb((0..area).map(|i| [4, 5, 6].map(|channel| value(i, channel))).collect())),
        ("depth".to_owned(), Layer::Value((0..area).map(|i| value(i, 7)).collect())),
    ];
    let hdr = (0..area).map(|i| [0, 1, 2, 3].map(|channel| value(i, channel))).collect();
    let picture = Picture { size, hdr, displayed: None, layers, passes: Vec::new(), fetches_per_px: None, report: Default::default() };
    let folder = Folder::new("exr-bytes");
    // Eight writers at the same time, each with compressing threads of its own, so that threads finish in different orders.
    let write = |i: usize| {
        let file = folder.0.join(format!("{i}.exr"));
        write_exr(&file, &picture).expect("writable");
        fs::read(&file).expect("readable")
    };
    let files: Vec<Vec<u8>> = std::thread::scope(|scope| {
        let writers: Vec<_> = (0..8).map(|i| scope.spawn(move || write(i))).collect();
        writers.into_iter().map(|writer| writer.join().expect("a written file")).collect()
    });
    for (i, file) in files.iter().enumerate() {
        assert!(*file == files[0], "file {i} has other bytes than file 0");
    }
    // The header must state that the tiles are in increasing order. The file must have all 60 tiles, so that the order matters.
    let meta = exr::prelude::MetaData::read_from_file(folder.0.join("0.exr"), true).expect("readable");
    assert_eq!((meta.headers[0].line_order, meta.headers[0].chunk_count), (exr::prelude::LineOrder::Increasing, 60));
    // Negative control: another picture has other bytes.
    let other = Picture { hdr: vec![[0.25; 4]; area as usize], ..picture.clone() };
    write_exr(&folder.0.join("other.exr"), &other).expect("writable");
    assert!(fs::read(folder.0.join("other.exr")).expect("readable") != files[0]);
}

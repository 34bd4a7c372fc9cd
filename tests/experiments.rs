//! Tests of experiments without rendering: definitions, the parts of a run, shards (runs that carry out a share of the parts), runs that are stopped
//! and resumed, tables, and wrong calls of the program. A stand-in for the renderer invents the measurements.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::time::Duration;

use ::experiments::definition::{self, Definition};
use ::experiments::expectations;
use ::experiments::row::{COLUMNS, Row};
use ::experiments::store::table::{SCHEMA, read_parquet, write_csv, write_parquet};
use ::experiments::store::{Existing, Place, Provenance, Run, RunData, read_run};
use ::experiments::unit::{Measure, Outcome, Shard, Unit, Work, plan, share};
use kernels::frame::FrameSettings;
use kernels::view::camera::Pose;
use kernels::view::normals::NormalEncoding;
use parquet::data_type::{ByteArray, ByteArrayType, DoubleType};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::parser::parse_message_type;

use crate::fixtures::{Folder, failure, usage_error};
use crate::measurer::{Fake, machine, number};

/// A valid definition. Most tests use it or a changed copy of it.
const TEXT: &str = r#"name = "trial"
question = "Does it hold?"
views = ["cliff", "sideways"]
size = [64, 36]
frames = 4
seeds = 2
variants = ["auto", "near-cliff"]
estimators = ["fc5", "exact"]
noises = ["hashed", "white"]
temporal = ["off", "exponential"]
metrics = ["rmse", "psnr", "flip_rate", "reference_se"]
times = "all"

[set]
"flavours.cliff_near_m" = 20.0

[vary]
parameter = "blend.hash_scale"
values = [0.05, 1.0]

[[view]]
name = "turn"
camera = "ground"
motion = "turn"
step = 0.5

[small]
frames = 2
views = ["cliff", "turn"]
values = [1.0]

[[expect]]
claim = "Errors are small"
metric = "rmse"
where = { variant = "auto", setting = 1.0 }
range = [0.0, 1.0]

[[expect]]
claim = "Shading is quick"
metric = "gpu_ms:shading"
where = { variant = "near-cliff" }
over = { variant = "auto" }
range = [0.0, inf]
"#;

fn parse(text: &str) -> Result<Definition, String> {
    definition::parse(text, "trial.toml", Path::new(".")).map_err(|error| format!("{error:#}"))
}

fn trial() -> Definition {
    parse(TEXT).expect("the trial definition is right")
}

/// Returns `TEXT` with one replacement. Panics if `from` does not occur, because the change would then test nothing.
fn edited(from: &str, to: &str) -> String {
    let text = TEXT.replacen(from, to, 1);
    assert_ne!(text, TEXT, "`{from}` is not in the trial definition");
    text
}

#[test]
fn the_trial_definition_says_what_it_says() {
    let trial = trial();
    assert_eq!(trial.view_names().collect::<Vec<_>>(), ["cliff", "sideways", "turn"]);
    assert!(trial.measures("rmse") && trial.measures("gpu_ms:shading") && !trial.measures("flip") && !trial.measures("nonsense"));
    assert!(trial.measures("gpu_ratio:shading"));
    assert_eq!(trial.times_budget_s, definition::TIMES_BUDGET_S);
    let longer = parse(&edited("times = \"all\"", "times = \"all\"\ntimes_budget_s = 90")).expect("a whole number is a number of seconds");
    assert_eq!(longer.times_budget_s, 90.0);
    // A ratio already relates two times, so it needs no `over`.
    let ratio =
        parse(&edited("metric = \"gpu_ms:shading\"", "metric = \"gpu_ratio:shading\"").replace("over = { variant = \"auto\" }\n", ""));
    assert_eq!(ratio.map(|ratio| ratio.expectations[1].over.clone()), Ok(None));
    // The number of invalid pixels is measured even if the definition does not name it, because metrics of colours leave these pixels out.
    assert!(trial.measures("invalid_px"));
    let setting = Some(toml::Value::Float(0.05));
    let scene = trial.scene(&setting, None).expect("the built-in scene");
    assert_eq!((scene.blend.hash_scale, scene.flavours.cliff_near_m, scene.flavours.far_atlas_m), (0.05, 20.0, 300.0));
    let small = trial.small();
    assert_eq!((small.frames, small.size, small.view_names().collect::<Vec<_>>()), (2, [64, 36], vec!["cliff", "turn"]));
    let again = definition::stored(&trial.to_toml().unwrap()).expect("the stored text can be parsed");
    assert_eq!(Definition { folder: trial.folder.clone(), ..again }, trial);
    assert_eq!(
        parse(&edited("variants = [\"auto\", \"near-cliff\"]", "variants = [\"all\", \"auto\"]").replace("near-cliff", "vt"))
            .unwrap()
            .variant_choices()
            .unwrap()
            .len(),
        32
    );
}

#[test]
fn choices_of_the_frame_are_set_and_varied() {
    let text = edited("\"flavours.cliff_near_m\" = 20.0", "frame.normals = \"exact\"").replace("blend.hash_scale", "frame.tile");
    let text =
        text.replace("[0.05, 1.0]", "[4, 16]").replace("values = [1.0]", "values = [8]").replace("setting = 1.0", "variant = \"auto\"");
    let text = text.replace("variant = \"auto\", variant = \"auto\"", "variant = \"auto\"");
    let definition = parse(&text).unwrap();
    let choices = definition.frame_settings(&Some(toml::Value::Integer(16))).unwrap();
    assert_eq!((choices.tile, choices.normals), (16, NormalEncoding::Exact));
    let wrong = text.replace("[4, 16]", "[4, 5]");
    assert!(parse(&wrong).unwrap_err().contains("4, 8 or 16"));
    assert!(parse(&text.replace("frame.tile", "frame.tiles")).unwrap_err().contains("did you mean `frame.tile`"));
    let of_normals = |name: &str| parse(&text.replace("\"exact\"\n", &format!("{name}\n")));
    let choices = of_normals("\"plane-first\"").unwrap().frame_settings(&None).unwrap();
    assert_eq!((choices.normals, FrameSettings::default().normals), (NormalEncoding::PlaneFirst, NormalEncoding::Octahedral));
    let pose = Pose { position: glam::DVec3::ZERO, yaw: 0.0, pitch: 0.0, fov: 1.0 };
    assert_eq!(choices.request(pose, [8, 8], 0).geometry.normals, NormalEncoding::PlaneFirst);
    assert!(of_normals("\"planefirst\"").unwrap_err().contains("did you mean `plane-first`?"));
    assert!(of_normals("true").unwrap_err().contains("`frame.normals` is true, must be octahedral, plane-first or exact"));
}

/// Wrong definitions: a text of `TEXT` to replace, the replacement, and texts that the error must contain.
const WRONG: &[(&str, &str, &[&str])] = &[
    ("noises = ", "noise = ", &["unknown key `noise`", "did you mean `noises`"]),
    ("frames = 4", "frames = \"many\"", &["frames", "invalid type"]),
    ("name = \"trial\"", "name = \"a/b\"", &["name", "letters"]),
    ("name = \"trial\"", "name = \"..\"", &["name", "letters"]),
    ("name = \"trial\"", "name = \"größe\"", &["name", "names a folder"]),
    ("question = \"Does it hold?\"", "question = \" \"", &["question", "is empty"]),
    ("views = [\"cliff\", \"sideways\"]", "views = [\"clif\"]", &["views 1", "did you mean `cliff`"]),
    ("views = [\"cliff\", \"sideways\"]", "views = [\"cliff\", \"cliff\"]", &["views 2", "entry 1"]),
    ("size = [64, 36]", "size = [0, 36]", &["size", "16384"]),
    ("size = [64, 36]", "size = [16384, 16384]", &["size", "67108864"]),
    ("frames = 4", "frames = 0", &["frames", "at least 1"]),
    ("frames = 4", "frames = 90000", &["frames", "more than path `sideways` has: give at most"]),
    ("frames = 4", "frames = 4\nwarm_up = 4", &["warm_up", "is 4, but there are 4 frames, so none would be measured"]),
    ("metrics = [\"rmse\"", "metrics = [\"power\", \"rmse\"", &["metrics 1", "at least 64 pixels"]),
    ("frames = 4", "frames = 1000000", &["frames", "100000"]),
    ("seeds = 2", "seeds = 1", &["seeds", "no variance"]),
    ("variants = [\"auto\", \"near-cliff\"]", "variants = []", &["variants", "at least one"]),
    ("variants = [\"auto\", \"near-cliff\"]", "variants = [\"near-clif\"]", &["variants 1", "did you mean `near-cliff`"]),
    ("variants = [\"auto\", \"near-cliff\"]", "variants = [\"vt+splat\", \"splat+vt\"]", &["variants 2", "entry 1"]),
    ("variants = [\"auto\", \"near-cliff\"]", "variants = [\"4\", \"near-cliff\"]", &["variants 2", "entry 1"]),
    ("variants = [\"auto\", \"near-cliff\"]", "variants = [\"all\", \"splat\"]", &["variants 2", "included in `all`"]),
    ("estimators = [\"fc5\", \"exact\"]", "estimators = [\"exakt\"]", &["estimators 1", "did you mean `exact`"]),
    ("noises = [\"hashed\", \"white\"]", "noises = [\"hashd\"]", &["noises 1", "did you mean `hashed`"]),
    ("temporal = [\"off\", \"exponential\"]", "temporal = [\"on\"]", &["temporal 1", "is not a known temporal resolve"]),
    ("metrics = [\"rmse\", ", "metrics = [\"rms\", ", &["metrics 1", "did you mean `rmse`"]),
    ("metrics = [\"rmse\", ", "metrics = [\"rmse\", \"gpu_ms:shading\", ", &["metrics 2", "the key `times` requests"]),
    ("[set]\n\"flavours.cliff_near_m\" = 20.0", "[set]\n\"flavours.cliff_near_m\" = 1e9", &["set", "cliff_near_m", "10000000"]),
    ("[set]\n\"flavours.cliff_near_m\" = 20.0", "[set]\n\"flavours.clif_near_m\" = 20.0", &["set", "did you mean `cliff_near_m`"]),
    ("parameter = \"blend.hash_scale\"", "parameter = \"blend.hash_scal\"", &["vary, parameter", "did you mean `hash_scale`"]),
    ("parameter = \"blend.hash_scale\"", "parameter = \"blendd.hash_scale\"", &["vary, parameter", "did you mean `blend`"]),
    ("parameter = \"blend.hash_scale\"", "parameter = \"flavours.cliff_near_m\"", &["vary, parameter", "set in [set], too"]),
    ("values = [0.05, 1.0]", "values = [0.05, 1.0, 1000.0]", &["vary, values 3", "`blend.hash_scale` is 1000, must be 0.01 to 100"]),
    ("values = [0.05, 1.0]", "values = [0.05, 1.0, nan]", &["vary, values 3", "finite"]),
    ("values = [0.05, 1.0]", "values = [\"a\", 1.0]", &["vary, values 1", "`blend.hash_scale` is \"a\", must be 0.01 to 100"]),
    ("values = [0.05, 1.0]", "values = [1, 1.0]", &["vary, values 2", "entry 1"]),
    ("values = [0.05, 1.0]", "values = []", &["vary, values", "at least one"]),
    ("camera = \"ground\"", "camera = \"groud\"", &["view 1, camera", "did you mean `ground`"]),
    ("step = 0.5", "step = 0.0", &["view 1, step", "nothing moves"]),
    ("step = 0.5", "step = nan", &["view 1, step"]),
    ("motion = \"turn\"\nstep = 0.5", "motion = \"zoom\"\nstep = 30.0", &["view 1, step", "-35 degrees", "1..=175"]),
    ("motion = \"turn\"", "motion = \"trun\"", &["trun"]),
    ("name = \"turn\"", "name = \"sideways\"", &["view 1, name", "too"]),
    ("name = \"turn\"", "name = \"vista\"", &["view 1, name", "camera or path of the scene"]),
    ("frames = 2\nviews", "frames = 0\nviews", &["small, frames", "is 0"]),
    ("views = [\"cliff\", \"turn\"]", "views = [\"cliff\", \"turm\"]", &["small, views 2", "did you mean `turn`"]),
    ("values = [1.0]\n", "values = [1000.0]\n", &["small, values 1", "100"]),
    ("values = [1.0]\n", "values = [0.05]\n", &["expect 1, where, setting", "with the changes of [small]", "0.05"]),
    ("claim = \"Errors are small\"", "claim = \"\"", &["expect 1, claim", "empty"]),
    ("metric = \"rmse\"", "metric = \"rmsd\"", &["expect 1, metric", "did you mean `rmse`"]),
    ("metric = \"rmse\"", "metric = \"flip\"", &["expect 1, metric", "not among `metrics`"]),
    ("setting = 1.0 }", "settings = 1.0 }", &["expect 1, where, settings", "did you mean `setting`"]),
    ("setting = 1.0 }", "setting = 2.0 }", &["expect 1, where, setting", "no row has setting `2`"]),
    ("setting = 1.0 }", "noise = \"hash\" }", &["expect 1, where, noise", "no row has noise `hash`"]),
    ("setting = 1.0 }", "frame = 4 }", &["expect 1, where, frame", "0 to 3"]),
    ("setting = 1.0 }", "lag = 1 }", &["expect 1, where, lag", "is not measured for each lag"]),
    ("setting = 1.0 }", "frequency = 0.1 }", &["expect 1, where, frequency", "not a spectrum"]),
    ("range = [0.0, 1.0]", "range = [1.0, 0.0]", &["expect 1, range", "reversed", "[0, 1]"]),
    ("range = [0.0, 1.0]", "range = [nan, 0.0]", &["expect 1, range", "not a number"]),
    ("range = [0.0, 1.0]", "range = [0.0]", &["range"]),
    ("metric = \"gpu_ms:shading\"", "metric = \"gpu_ms:shadng\"", &["expect 2, metric", "did you mean `shading`"]),
    ("metric = \"gpu_ms:shading\"", "metric = \"gpu_ms\"", &["expect 2, metric", "gpu_ms:shading"]),
    ("over = { variant = \"auto\" }\n", "", &["expect 2, metric", "`gpu_ratio:shading`", "give `over`"]),
    ("metric = \"gpu_ms:shading\"", "metric = \"gpu_ratio:shadng\"", &["expect 2, metric", "did you mean `shading`"]),
    ("metric = \"gpu_ms:shading\"", "metric = \"gpu_ratio\"", &["expect 2, metric", "gpu_ratio:shading"]),
    ("metrics = [\"rmse\", ", "metrics = [\"rmse\", \"gpu_ratio:shading\", ", &["metrics 2", "the key `times` requests"]),
    ("times = \"all\"", "times = \"all\"\ntimes_budget_s = 0", &["times_budget_s", "is 0, must be above 0 and at most 86400"]),
    ("times = \"all\"", "times = \"all\"\ntimes_budget_s = -1.5", &["times_budget_s", "is -1.5"]),
    ("times = \"all\"", "times = \"all\"\ntimes_budget_s = nan", &["times_budget_s", "is NaN"]),
    ("times = \"all\"", "times = \"all\"\ntimes_budget_s = inf", &["times_budget_s", "is inf"]),
    ("times = \"all\"", "times = \"all\"\ntimes_budget_s = \"long\"", &["times_budget_s", "invalid type"]),
    ("times = \"all\"", "times = \"all\"\nviewing = { frames_per_second = 0 }", &["viewing, frames_per_second", "is 0", "1..=1000"]),
    ("times = \"all\"", "times = \"all\"\nviewing = { frames_per_second = nan }", &["viewing, frames_per_second", "is NaN"]),
    ("times = \"all\"", "times = \"all\"\nviewing = { pixels_per_degree = 0 }", &["viewing, pixels_per_degree", "is 0"]),
    ("times = \"all\"", "times = \"all\"\nviewing = { frames_per_secnd = 30 }", &["frames_per_secnd", "did you mean `frames_per_second`"]),
    ("times = \"all\"", "times = \"all\"\nsignals = []", &["signals", "is empty"]),
    ("times = \"all\"", "times = \"all\"\nsignals = [\"lit\", \"lit\"]", &["signals 2", "entry 1"]),
    ("times = \"all\"", "times = \"all\"\nsignals = [\"lite\"]", &["signals 1", "did you mean `lit`"]),
    ("times = \"all\"", "times = \"all\"\nsignals = [\"lit\"]", &["expect 1, where", "only the lit picture"]),
    ("setting = 1.0 }", "signal = \"light\" }", &["expect 1, where, signal", "no row has signal `light`"]),
    ("metrics = [\"rmse\", ", "metrics = [\"flicker\", ", &["metrics 1", "`flicker` was renamed", "`excess_difference`", "`added`"]),
    ("times = \"all\"", "time_budget_s = 5", &["unknown key `time_budget_s`", "did you mean `times_budget_s`"]),
    ("over = { variant = \"auto\" }", "over = { variant = \"near-cliff\" }", &["expect 2, over", "always 1"]),
    ("over = { variant = \"auto\" }", "over = { metric = \"gpu\" }", &["expect 2, over, metric", "is not a known metric"]),
    ("size = [64, 36]", "size = [64, 36, 2]", &["size", "has 3 entries, must have 2"]),
    ("range = [0.0, 1.0]", "range = [0.0, 1.0, 5.0]", &["expect 1, range", "has 3 entries, must have 2"]),
];

#[test]
fn wrong_definitions_are_refused_with_line_key_and_remedy() {
    for (from, to, says) in WRONG {
        let text = edited(from, to);
        let refused = parse(&text).expect_err(&format!("`{to}` in place of `{from}` was accepted"));
        for part in *says {
            assert!(refused.contains(part), "`{to}`: `{part}` is not in: {refused}");
        }
        assert!(refused.starts_with("experiment trial.toml:") && refused.lines().count() == 1, "{refused}");
        // The error must name a line at the change, a line that contains the last word of the expected text, or the line of `[set]`.
        let named: usize = refused["experiment trial.toml:".len()..].split(':').next().unwrap().parse().expect("a line number");
        let key = says[0].split([',', ' ']).next_back().unwrap_or_default();
        let start = TEXT[..TEXT.find(from).unwrap()].lines().count().max(1);
        let changed = start..=start + from.lines().count().max(to.lines().count());
        assert!(
            changed.contains(&named) || text.lines().nth(named - 1).is_some_and(|l| l.contains(key) || l.contains("[set]")),
            "`{to}`: line {named}: {refused}"
        );
    }
}

#[test]
fn what_is_missing_or_too_much_is_refused() {
    let refused = |text: &str| parse(text).expect_err("it was accepted");
    for (key, says) in
        [("name", "short name"), ("question", "question that the run answers"), ("size", "[480, 270]"), ("variants", "[\"all\"]")]
    {
        let text: String = TEXT.lines().filter(|line| !line.starts_with(&format!("{key} = "))).map(|line| format!("{line}\n")).collect();
        let refused = refused(&text);
        assert!(refused.contains(&format!("`{key}` is missing")) && refused.contains(says), "{refused}");
    }
    let both = format!("scene = \"default\"\n{TEXT}[import]\nheightmap = \"x.png\"\nmetres_per_texel = 1.0\n");
    assert!(refused(&both).contains("both given"));
    let no_file = format!("{TEXT}[import]\nheightmap = \"no-such.png\"\nmetres_per_texel = 1.0\n");
    assert!(refused(&no_file).contains("no-such.png"));
    let reversed = format!("{TEXT}[import]\nheightmap = \"x\"\nmetres_per_texel = 1.0\nheight_range_m = [5.0, 1.0]\n");
    assert!(refused(&reversed).contains("from low to high"));
    assert!(refused(&format!("scene = \"no-such.toml\"\n{TEXT}")).contains("no-such.toml"));
    // With one frame, there are no frames to compare. Metrics that compare frames are then refused, in the definition and in `small`.
    assert!(refused(&edited("frames = 4", "frames = 1")).contains("set `frames` to 2"));
    assert!(refused(&edited("frames = 2\n", "frames = 1\n")).contains("small"));
    for metric in ["bias", "clumping"] {
        let without = edited("seeds = 2", "seeds = 0").replace("metrics = [", &format!("metrics = [\"{metric}\", "));
        assert!(refused(&without).contains("set `seeds` to 2"), "{metric}");
    }
    assert!(refused(&edited("times = \"all\"", "times = \"none\"")).contains("`times`"));
    let ratio = edited("times = \"all\"", "times = \"none\"").replace("gpu_ms:shading", "gpu_ratio:shading");
    assert!(refused(&ratio).contains("`gpu_ratio:shading` is a time: set `times`"));
    // A scene without a virtual texture cannot be shaded with the flavour of the virtual texture.
    let no_vt = edited("\"flavours.cliff_near_m\" = 20.0", "\"flavours.far_atlas_m\" = 0.0").replace("near-cliff", "vt");
    assert!(refused(&no_vt).contains("no virtual texture"), "{}", refused(&no_vt));
    let generic = no_vt.replace("\"vt\"", "\"generic-vt\"");
    assert!(generic != no_vt && refused(&generic).contains("`generic-vt` needs `vt`"), "{}", refused(&generic));
    assert!(parse(&no_vt.replace("\"vt\"", "\"near-cliff\"")).is_ok());
    let many: Vec<String> = (0..1001).map(|i| format!("{}.0", i + 1)).collect();
    assert!(refused(&edited("values = [0.05, 1.0]", &format!("values = [{}]", many.join(", ")))).contains("1000"));
}

#[test]
fn definitions_of_the_repository_are_right() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../experiments/definitions");
    let files: Vec<PathBuf> =
        fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).filter(|p| p.extension().is_some_and(|e| e == "toml")).collect();
    assert!(files.len() >= 2, "there are {}", files.len());
    let has_data = std::env::var_os("SCREE_DATA").is_some_and(|data| !data.is_empty());
    let mut names = BTreeSet::new();
    for file in files {
        if !has_data && fs::read_to_string(&file).unwrap().contains("$SCREE_DATA") {
            eprintln!("left out, since SCREE_DATA is not set: {}", file.display());
            continue;
        }
        let definition = definition::load(&file).unwrap_or_else(|error| panic!("{error:#}"));
        assert_eq!(file.file_stem().unwrap().to_string_lossy(), definition.name, "the file must have the name of the experiment");
        assert!(!definition.expectations.is_empty() && names.insert(definition.name.clone()), "{}", definition.name);
    }
}

#[test]
fn definitions_of_scripts_are_right() {
    let load = |name: &str| {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../scripts").join(name);
        definition::load(&file).unwrap_or_else(|error| panic!("{error:#}"))
    };
    assert!(load("identical.toml").measures("rmse"));
    // `make judges` needs videos of the lit picture, and at least 24 clips, each with at least 8 seeds. The same frames at two frame rates are two
    // clips.
    let clips = load("judges/clips.toml");
    assert!(clips.video && clips.signals.iter().any(|signal| signal == "lit") && clips.measures("perceived_noise"));
    let count = 2 * clips.view_names().count() * clips.variants.len() * clips.noises.len() * clips.temporal.len();
    let vary = clips.vary.expect("it varies the seed");
    assert!(count >= 24 && vary.parameter == "frame.seed" && vary.values.len() >= 8, "{count} clips, {} seeds", vary.values.len());
}

#[test]
fn real_terrain_is_imported_once_and_kept() {
    let Some(data) = std::env::var_os("SCREE_DATA").filter(|data| !data.is_empty()) else {
        eprintln!("left out, since SCREE_DATA is not set: importing real terrain");
        return;
    };
    assert!(Path::new(&data).is_dir());
    let folder = Folder::new("import");
    let import = "[import]\nheightmap = \"$SCREE_DATA/dem/stubai_alps_lidar_321.png\"\nmetres_per_texel = 10.0\nheight_range_m = [1399.15, 2716.06]\n";
    let text = format!("{}{import}", edited("views = [\"cliff\", \"sideways\"]", "views = [\"cliff\"]"));
    let definition = parse(&text).unwrap();
    let place = place(&folder.0);
    let run = Run::open(&definition, &place, &machine()).unwrap();
    let imported = run.imported().expect("there is a scene");
    let written = fs::metadata(imported.join("scene.toml")).unwrap().modified().unwrap();
    let scene = definition.scene(&Some(toml::Value::Float(0.05)), Some(&imported)).unwrap();
    assert_eq!((scene.blend.hash_scale, scene.cameras.len()), (0.05, 4));
    drop(run);
    let run = Run::open(&definition, &Place { existing: Existing::Resume, ..place }, &machine()).unwrap();
    assert_eq!(fs::metadata(imported.join("scene.toml")).unwrap().modified().unwrap(), written, "the terrain was imported again");
    drop(run);
    // An error that only the imported scene can reveal is reported before anything is measured.
    let text = text.replace("blend.hash_scale", "material.granit.normal_strength").replace("name = \"trial\"", "name = \"other\"");
    let wrong = parse(&text).expect("materials are not known before the import");
    assert!(format!("{:#}", Run::open(&wrong, &place, &machine()).unwrap_err()).contains("did you mean `granite`"));
}

// ---- Parts and shards. ----

#[test]
fn the_plan_is_ordered_and_complete() {
    let units = plan(&trial());
    // Number of parts: 2 settings x 3 views x (1 reference + 2 estimators x 2 noises x 2 resolves for metrics + 2 estimators x 2 noises for times).
    assert_eq!(units.len(), 2 * 3 * (1 + 8 + 4));
    assert_eq!(units, plan(&trial()));
    assert!(units.iter().enumerate().all(|(i, unit)| unit.index == i));
    assert_eq!(units[0].id, "reference-cliff-0.05");
    assert_eq!(units[1].id, "sweep-cliff-fc5-hashed-off-0.05");
    assert_eq!(units[9].id, "timing-cliff-fc5-hashed-0.05");
    assert_eq!(units.iter().map(|unit| unit.id.as_str()).collect::<BTreeSet<_>>().len(), units.len());
    let first_noise = plan(&parse(&edited("times = \"all\"", "times = \"first-noise\"")).unwrap());
    assert_eq!(first_noise.len(), 2 * 3 * (1 + 8 + 2));
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_+.".contains(c);
    assert!(units.iter().all(|unit| unit.id.chars().all(plain) && unit.id.len() < 200));
}

/// Returns the indices of the parts (steps of a run) whose rows a shard keeps. Checks that each sweep of the shard comes after the reference against
/// which it measures. Also checks that the shard keeps the rows of all its parts, except for some references.
fn kept(units: &[Unit], shard: Shard) -> Vec<usize> {
    let shares = share(units, Some(shard));
    for (i, part) in shares.iter().enumerate().filter(|(_, part)| matches!(part.unit.work, Work::Sweep { .. })) {
        let reference = |other: &Unit| other.work == Work::Reference && other.view == part.unit.view && other.setting == part.unit.setting;
        assert!(shares[..i].iter().any(|other| reference(&other.unit)), "{shard}: {} has no reference", part.unit.id);
    }
    assert!(shares.iter().all(|part| part.kept || part.unit.work == Work::Reference), "{shard}: only references may lack rows");
    shares.iter().filter(|part| part.kept).map(|part| part.unit.index).collect()
}

#[test]
fn shards_are_disjoint_and_whole() {
    for definition in [trial(), trial().small()] {
        let units = plan(&definition);
        for count in (1..=40).chain([units.len() as u32, 100, 1000]) {
            let mut all: Vec<usize> = (1..=count).flat_map(|number| kept(&units, Shard { number, count })).collect();
            all.sort_unstable();
            assert_eq!(all, (0..units.len()).collect::<Vec<_>>(), "{count} shards");
        }
    }
    // Negative control: shard 1/2 and shard 2/3 come from different splits of the run, so together they do not keep each part exactly once.
    let units = plan(&trial());
    let (one, two) = (kept(&units, Shard { number: 1, count: 2 }), kept(&units, Shard { number: 2, count: 3 }));
    let mut mixed: Vec<usize> = one.into_iter().chain(two).collect();
    mixed.sort_unstable();
    assert_ne!(mixed, (0..units.len()).collect::<Vec<_>>());
}

// ---- Runs. ----

fn place(out: &Path) -> Place<'_> {
    Place { out, own: false, existing: Existing::Refuse, shard: None, small: false }
}

fn uninterrupted() -> anyhow::Result<()> {
    Ok(())
}

/// Carries out all missing parts and finishes the run.
fn complete(definition: &Definition, place: &Place<'_>) -> RunData {
    let mut run = Run::open(definition, place, &machine()).expect("the run can be opened");
    run.carry_out(&mut Fake::of(definition), &|_, _| {}, &uninterrupted).expect("the parts can be done");
    run.finish().expect("the run can be finished")
}

fn refused(definition: &Definition, place: &Place<'_>, machine: &Provenance) -> String {
    let error = format!("{:#}", Run::open(definition, place, machine).expect_err("the run was opened"));
    assert_eq!(error.lines().count(), 1, "{error}");
    error
}

const RESULTS: [&str; 2] = ["metrics.parquet", "metrics.csv"];

fn results(out: &Path) -> Vec<Vec<u8>> {
    RESULTS.iter().map(|name| fs::read(out.join("trial").join(name)).expect("the result is there")).collect()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

/// Whether both lists have the same rows. Numbers are compared bit by bit (NaN equals itself).
fn same(a: &[Row], b: &[Row]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.order(b).is_eq())
}

#[test]
fn a_run_yields_what_was_measured_and_judges_it() {
    let folder = Folder::new("whole");
    let trial = trial();
    let steps = Cell::new((0, 0));
    let mut run = Run::open(&trial, &place(&folder.0), &machine()).unwrap();
    let show = |done: u64, total: u64| {
        assert!(done >= steps.get().0 && done <= total, "progress went from {:?} to {done}/{total}", steps.get());
        steps.set((done, total));
    };
    run.carry_out(&mut Fake::of(&trial), &show, &uninterrupted).unwrap();
    assert!(steps.get().0 == steps.get().1 && steps.get().1 > 0);
    let data = run.finish().unwrap();
    assert!(data.complete && data.missing.is_empty() && data.manifest.complete);
    assert_eq!(
        names(&folder.0.join("trial")),
        ["lock", "manifest.json", "metrics.csv", "metrics.parquet", "reference", "times.csv", "times.parquet"]
    );
    // Expected numbers of rows. Metrics: 1 row for each of 6 references; for each of 48 sweeps and 2 variants, 2 metrics in each of 4 frames, and 1
    // row for each of 3 lags. Times: 1 row for each of 24 timings and 2 variants.
    assert_eq!((data.rows.len(), data.times.len()), (6 + 48 * 2 * (4 * 2 + 3), 24 * 2));
    assert!(data.rows.iter().all(|row| row.experiment == "trial" && row.parameter == "blend.hash_scale" && row.metric != "ssim"));
    assert!(data.rows.iter().any(|row| row.value.is_nan()) && data.times.iter().all(|row| row.unit == "ms"));
    let one =
        data.rows.iter().find(|row| row.metric == "rmse" && row.noise == "white" && row.setting == "1" && row.frame == Some(2)).unwrap();
    let id = format!("sweep-{}-{}-white-{}-1", one.view, one.estimator, one.temporal);
    let unit = plan(&trial).into_iter().find(|unit| unit.id == id).expect("the part of this row");
    let measured = Fake::of(&trial).measure(&unit, &data.folder, &|_, _| {}).unwrap();
    let is_one = |row: &&Row| (&row.variant, row.metric.as_str(), row.frame) == (&one.variant, "rmse", Some(2));
    assert_eq!(measured.rows.iter().find(is_one).map(|row| row.value), Some(one.value));
    let verdicts = expectations::evaluate(&trial, &data.rows, &data.times);
    assert!(verdicts.len() == 2 && verdicts.iter().all(|verdict| verdict.met), "{verdicts:?}");
    // The CSV file has the same numbers.
    let mut csv = csv::Reader::from_path(folder.0.join("trial/metrics.csv")).unwrap();
    let mut rows: Vec<Row> = csv.deserialize().map(|row| row.unwrap()).collect();
    rows.sort_by(Row::order);
    assert!(same(&rows, &data.rows), "CSV and Parquet differ");
    // A run with a different analysis text is still the same run. When the run is read again, it has the new text.
    let told = Definition { analysis: "Nothing follows.".to_owned(), ..trial };
    let data = complete(&told, &Place { existing: Existing::Resume, ..place(&folder.0) });
    assert_eq!(read_run(&data.folder).unwrap().definition.analysis, "Nothing follows.");
}

#[test]
fn stopped_after_any_part_and_resumed_a_run_gives_equal_bytes() {
    let (whole, stopped, other) = (Folder::new("one-go"), Folder::new("stopped"), Folder::new("other"));
    let trial = trial().small();
    complete(&trial, &place(&whole.0));
    let count = plan(&trial).len();
    for stop in 0..count {
        let mut run = Run::open(
            &trial,
            &Place { existing: if stop > 0 { Existing::Resume } else { Existing::Refuse }, ..place(&stopped.0) },
            &machine(),
        )
        .unwrap();
        assert_eq!(run.progress(), (stop, count));
        let left = Cell::new(1);
        let go_on = || if left.replace(left.get() - 1) > 0 { Ok(()) } else { anyhow::bail!("stopped") };
        let outcome = run.carry_out(&mut Fake::of(&trial), &|_, _| {}, &go_on);
        assert_eq!(outcome.is_ok(), stop + 1 == count);
        // Creates files such as those that a process leaves behind if it is killed while it writes.
        fs::write(stopped.0.join("trial/parts/00001-x.parquet.7.tmp"), b"half").unwrap();
        fs::write(stopped.0.join("trial/metrics.csv.7.tmp"), b"half").unwrap();
        if stop + 1 < count {
            let data = read_run(&stopped.0.join("trial")).unwrap();
            assert!(!data.complete && data.missing[0].contains(&format!("{} of {count} parts", count - stop - 1)), "{:?}", data.missing);
            let error = format!("{:#}", run.finish().unwrap_err());
            assert!(error.contains("--resume"), "{error}");
        }
    }
    complete(&trial, &Place { existing: Existing::Resume, ..place(&stopped.0) });
    assert!(results(&whole.0) == results(&stopped.0), "bytes differ after {count} stops");
    assert!(names(&stopped.0.join("trial")).iter().all(|name| !name.ends_with(".tmp") && name != "parts"));
    // Negative control: different numbers give different bytes.
    let mut run = Run::open(&trial, &place(&other.0), &machine()).unwrap();
    run.carry_out(&mut Fake { salt: 1, ..Fake::of(&trial) }, &|_, _| {}, &uninterrupted).unwrap();
    run.finish().unwrap();
    assert!(results(&whole.0) != results(&other.0));
}

/// Environment variable that names a folder. The test below starts its own binary with this variable. The started process carries out a run in that
/// folder, and the test kills it.
const CHILD: &str = "SCREE_TEST_RUN";

#[test]
fn killed_at_any_moment_and_resumed_a_run_gives_equal_bytes() {
    let small = trial().small();
    if let Some(out) = std::env::var_os(CHILD) {
        let out = PathBuf::from(out);
        let mut run = Run::open(&small, &Place { existing: Existing::Resume, ..place(&out) }, &machine()).unwrap();
        let mut fake = Fake { pause: Duration::from_millis(1), ..Fake::of(&small) };
        run.carry_out(&mut fake, &|_, _| {}, &uninterrupted).unwrap();
        run.finish().unwrap();
        return;
    }
    let (whole, killed) = (Folder::new("alive"), Folder::new("killed"));
    complete(&small, &place(&whole.0));
    let test = "experiments::killed_at_any_moment_and_resumed_a_run_gives_equal_bytes";
    let (mut kills, mut finished) = (0, false);
    for attempt in 0..200 {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args([test, "--exact", "--nocapture", "--test-threads=1"])
            .env(CHILD, &killed.0)
            .stdout(std::process::Stdio::null())
            .spawn()
            .unwrap();
        // The process is killed at different moments, from before the run begins until some parts are finished. The golden ratio spreads these
        // moments evenly.
        std::thread::sleep(Duration::from_secs_f64(0.004 + 0.06 * (f64::from(attempt) * 0.618_034).fract()));
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success(), "the run failed by itself: {status}");
            finished = true;
            break;
        }
        child.kill().unwrap();
        child.wait().unwrap();
        kills += 1;
    }
    eprintln!("killed {kills} times");
    assert!(kills >= 3, "the run finished before it was killed three times");
    if !finished {
        // The machine is so slow that no process finished the run before it was killed. A run must still be able to resume from the files that are
        // left.
        complete(&small, &Place { existing: Existing::Resume, ..place(&killed.0) });
    }
    assert!(results(&whole.0) == results(&killed.0), "bytes differ after {kills} kills");
}

#[test]
fn a_folder_is_used_by_one_run_at_a_time() {
    let folder = Folder::new("lock");
    let trial = trial();
    let run = Run::open(&trial, &place(&folder.0), &machine()).unwrap();
    for existing in [Existing::Refuse, Existing::Resume, Existing::Replace] {
        let error = refused(&trial, &Place { existing, ..place(&folder.0) }, &machine());
        let holder = format!("process {}", std::process::id());
        assert!(error.contains("is in use by") && error.contains("--out"), "{error}");
        assert!(cfg!(windows) || error.contains(&holder) && error.contains("experiments run trial.toml"), "{error}");
    }
    // When the run is dropped, its lock is released.
    drop(run);
    Run::open(&trial, &Place { existing: Existing::Resume, ..place(&folder.0) }, &machine()).unwrap();
}

#[test]
fn a_run_that_is_replaced_makes_way_only_for_its_own_kind() {
    let folder = Folder::new("replace");
    let trial = trial();
    let own = Place { own: true, existing: Existing::Replace, ..place(&folder.0) };
    complete(&trial, &own);
    for name in ["reference", "pictures", "video"] {
        fs::create_dir_all(folder.0.join(name)).unwrap();
        folder.write(&format!("{name}/old.png"), "old");
    }
    folder.write("report.html", "old");
    folder.write("mine.txt", "kept");
    // A run with a different number of seeds replaces the old run. All files that the old run wrote are deleted, and no other file.
    let more = Definition { seeds: trial.seeds + 2, ..trial.clone() };
    let run = Run::open(&more, &own, &machine()).unwrap();
    assert_eq!(run.progress().0, 0);
    assert_eq!(names(&folder.0), ["lock", "manifest.json", "mine.txt", "parts"]);
    drop(run);
    // With `Existing::Replace`, a run of the same definition is continued if it was stopped, and started again if it was finished.
    let mut run = Run::open(&more, &own, &machine()).unwrap();
    run.carry_out(&mut Fake::of(&more), &|_, _| {}, &uninterrupted).unwrap();
    drop(run);
    let run = Run::open(&more, &own, &machine()).unwrap();
    assert_eq!(run.progress().0, run.progress().1);
    run.finish().unwrap();
    assert_eq!(Run::open(&more, &own, &machine()).unwrap().progress().0, 0);
    // A run with a different name is not replaced.
    let other = Definition { name: "other".to_owned(), ..trial };
    let error = refused(&other, &own, &machine());
    assert!(error.contains("holds another run") && error.contains("--out"), "{error}");
    assert!(folder.0.join("manifest.json").exists());
}

#[test]
fn another_run_is_not_resumed_and_what_differs_is_named() {
    let folder = Folder::new("another");
    let trial = trial();
    let scene = folder.write("scene.toml", kernels::scene::DEFAULT_TEXT);
    let of_file = Definition { scene: Some(scene.clone()), ..trial.clone() };
    complete(&of_file, &place(&folder.0));
    let again = Place { existing: Existing::Resume, ..place(&folder.0) };
    let unlike = |definition: &Definition, place: &Place<'_>, machine: &Provenance, says: &[&str]| {
        let error = refused(definition, place, machine);
        for part in says.iter().chain(&["--out"]) {
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
    };
    unlike(&of_file, &place(&folder.0), &machine(), &["finished run", "--resume"]);
    unlike(&Definition { frames: 5, ..of_file.clone() }, &again, &machine(), &["`frames` is 4 there and 5 here"]);
    unlike(&Definition { views: vec!["cliff".to_owned()], ..of_file.clone() }, &again, &machine(), &["`views`"]);
    unlike(&trial, &again, &machine(), &["`scene`", "absent here"]);
    unlike(&of_file.small(), &Place { small: true, ..again }, &machine(), &["small"]);
    unlike(&of_file, &again, &Provenance { adapter: "another".to_owned(), ..machine() }, &["the adapter is none there and another here"]);
    unlike(&of_file, &again, &Provenance { driver: "1".to_owned(), ..machine() }, &["the driver"]);
    unlike(&of_file, &Place { shard: "1/2".parse().ok(), ..again }, &machine(), &["holds the whole run"]);
    // The command does not belong to the identity of a run, but the content of the scene does.
    drop(Run::open(&of_file, &again, &Provenance { command: "experiments run --resume".to_owned(), ..machine() }).unwrap());
    folder.write("scene.toml", &kernels::scene::DEFAULT_TEXT.replace("seed = 7", "seed = 8"));
    unlike(&of_file, &again, &machine(), &["the scene's content"]);
}

#[test]
fn files_that_a_scene_reads_belong_to_the_identity_of_a_run() {
    let folder = Folder::new("sources");
    let world = "[world]\nkind = \"heightmap\"\nfile = \"height.png\"\nmetres_per_texel = 2.0\nheight_range_m = [0.0, 100.0]";
    let text = kernels::scene::DEFAULT_TEXT.replace("[world]\nkind = \"procedural\"\nseed = 7", world).replacen(
        "procedural = ",
        "folder = \"rock\" # ",
        1,
    );
    let definition = Definition { scene: Some(folder.write("scene.toml", &text)), ..trial() };
    fs::create_dir_all(folder.0.join("rock/other")).expect("a temporary folder");
    let files = ["height.png", "rock/albedo.png", "rock/normal.PNG"];
    files.iter().for_each(|file| drop(folder.write(file, "before")));
    let unread = ["rock/readme.txt", "rock/.hidden.png", "rock/other/albedo.png"];
    unread.iter().for_each(|file| drop(folder.write(file, "before")));
    #[cfg(unix)]
    std::os::unix::fs::symlink("nowhere.png", folder.0.join("rock/dangling.png")).expect("a link");
    // Opening a run only hashes the files; it does not decode them.
    drop(Run::open(&definition, &place(&folder.0), &machine()).expect("a new run"));
    let again = Place { existing: Existing::Resume, ..place(&folder.0) };
    for file in files {
        folder.write(file, "after");
        let error = refused(&definition, &again, &machine());
        assert!(error.contains("the scene's content"), "{file}: {error}");
        folder.write(file, "before");
        drop(Run::open(&definition, &again, &machine()).expect("the same files"));
    }
    // The scene does not read these files.
    unread.iter().for_each(|file| drop(folder.write(file, "after")));
    drop(Run::open(&definition, &again, &machine()).expect("the same images"));
    fs::rename(folder.0.join("rock/albedo.png"), folder.0.join("rock/colour.png")).expect("renamed");
    assert!(refused(&definition, &again, &machine()).contains("the scene's content"), "a file with another name");
}

#[test]
fn foreign_folders_and_broken_manifests_are_left_alone() {
    let folder = Folder::new("foreign");
    let trial = trial();
    fs::create_dir_all(folder.0.join("trial")).unwrap();
    folder.write("trial/thesis.txt", "years of work");
    for existing in [Existing::Refuse, Existing::Resume, Existing::Replace] {
        let error = refused(&trial, &Place { existing, ..place(&folder.0) }, &machine());
        assert!(error.contains("thesis.txt") && error.contains("--out"), "{error}");
    }
    assert_eq!(names(&folder.0.join("trial")), ["thesis.txt"]);
    fs::remove_file(folder.0.join("trial/thesis.txt")).unwrap();
    // A process was killed after it made the folder and before it wrote the manifest: the run starts from the beginning.
    folder.write("trial/lock", "");
    folder.write("trial/manifest.json.9.tmp", "{");
    drop(Run::open(&trial, &place(&folder.0), &machine()).unwrap());
    for broken in ["", "{", "{}", "[1]", "{\"format\": 1}", "{\"format\": 99}"] {
        folder.write("trial/manifest.json", broken);
        let error = refused(&trial, &Place { existing: Existing::Resume, ..place(&folder.0) }, &machine());
        assert!(error.contains("manifest.json") && error.contains("--out"), "{broken}: {error}");
        assert!(read_run(&folder.0.join("trial")).is_err());
    }
    let file = folder.write("file", "");
    assert!(refused(&trial, &place(Path::new(&file)), &machine()).contains("cannot make the folder"));
}

#[test]
fn damaged_parts_and_results_are_done_again() {
    let (whole, damaged) = (Folder::new("sound"), Folder::new("damaged"));
    let trial = trial().small();
    complete(&trial, &place(&whole.0));
    let mut run = Run::open(&trial, &place(&damaged.0), &machine()).unwrap();
    run.carry_out(&mut Fake::of(&trial), &|_, _| {}, &uninterrupted).unwrap();
    drop(run);
    let parts = damaged.0.join("trial/parts");
    let list = names(&parts);
    let bytes = fs::read(parts.join(&list[1])).unwrap();
    fs::write(parts.join(&list[1]), &bytes[..bytes.len() / 2]).unwrap();
    fs::write(parts.join(&list[2]), b"").unwrap();
    // A valid file under the name of a different part.
    fs::copy(parts.join(&list[4]), parts.join(&list[3])).unwrap();
    let mut flipped = fs::read(parts.join(&list[5])).unwrap();
    flipped[200] ^= 4;
    fs::write(parts.join(&list[5]), flipped).unwrap();
    let again = Place { existing: Existing::Resume, ..place(&damaged.0) };
    let mut run = Run::open(&trial, &again, &machine()).unwrap();
    assert_eq!(run.progress(), (list.len() - 4, list.len()), "{:?}", run.notes());
    assert!(
        run.notes().len() == 4 && run.notes().iter().all(|note| note.contains("measured again") && note.lines().count() == 1),
        "{:?}",
        run.notes()
    );
    let mut fake = Fake::of(&trial);
    run.carry_out(&mut fake, &|_, _| {}, &uninterrupted).unwrap();
    assert_eq!(fake.calls.get(), 4);
    run.finish().unwrap();
    assert!(results(&whole.0) == results(&damaged.0));
    // If a table of a finished run is damaged, reading the run fails with an error that names the file. Opening the run with `Existing::Resume`
    // starts it again.
    let file = damaged.0.join("trial/metrics.parquet");
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() - 9]).unwrap();
    let error = format!("{:#}", read_run(&damaged.0.join("trial")).unwrap_err());
    assert!(error.contains("metrics.parquet") && error.contains("damaged") && error.lines().count() == 1, "{error}");
    let run = Run::open(&trial, &again, &machine()).unwrap();
    assert!(run.progress().0 == 0 && run.notes()[0].contains("metrics.parquet"));
    drop(run);
    complete(&trial, &again);
    assert!(results(&whole.0) == results(&damaged.0));
}

/// Measures like `fake`, but calls `block` before the third part, so that the file of this part cannot be written.
struct Full<'a> {
    fake: Fake,
    parts: PathBuf,
    block: &'a dyn Fn(&Path),
}

impl Measure for Full<'_> {
    fn measure(&mut self, unit: &Unit, folder: &Path, step: &dyn Fn(u64, u64)) -> anyhow::Result<Outcome> {
        if unit.index == 2 {
            (self.block)(&self.parts.join(format!("{:05}-{}.parquet", unit.index, unit.id)));
        }
        self.fake.measure(unit, folder, step)
    }
}

#[test]
fn a_full_disk_is_said_and_the_run_goes_on_once_there_is_room() {
    let (whole, full) = (Folder::new("room"), Folder::new("full"));
    let trial = trial().small();
    complete(&trial, &place(&whole.0));
    let stop = |block: &dyn Fn(&Path), says: &str, existing: Existing| {
        let mut run = Run::open(&trial, &Place { existing, ..place(&full.0) }, &machine()).unwrap();
        let mut measure = Full { fake: Fake::of(&trial), parts: full.0.join("trial/parts"), block };
        let error = format!("{:#}", run.carry_out(&mut measure, &|_, _| {}, &uninterrupted).unwrap_err());
        for part in [says, "00002-", "--resume", "make room"] {
            assert!(error.contains(part), "`{part}` is not in: {error}");
        }
        assert_eq!(error.lines().count(), 1, "{error}");
        assert_eq!(run.progress().0, 2);
    };
    // A folder that has the name of the part's file makes the last step of writing, the renaming, fail.
    stop(&|file| fs::create_dir_all(file.join("in the way")).unwrap(), "cannot write", Existing::Refuse);
    let blocked = full.0.join("trial/parts").join(names(&full.0.join("trial/parts")).into_iter().find(|n| n.starts_with("00002")).unwrap());
    fs::remove_dir_all(blocked).unwrap();
    assert_eq!(names(&full.0.join("trial/parts")).len(), 2, "an incomplete file is left");
    // The temporary file is a link to a device on which every write fails, because it is full.
    #[cfg(target_os = "linux")]
    {
        let link = |file: &Path| {
            let mut name = file.file_name().unwrap().to_os_string();
            name.push(format!(".{}.tmp", std::process::id()));
            std::os::unix::fs::symlink("/dev/full", file.with_file_name(name)).unwrap();
        };
        stop(&link, "No space left on device", Existing::Resume);
        assert_eq!(names(&full.0.join("trial/parts")).len(), 2, "an incomplete file is left");
    }
    complete(&trial, &Place { existing: Existing::Resume, ..place(&full.0) });
    assert!(results(&whole.0) == results(&full.0));
}

#[test]
fn measurers_that_break_their_promise_are_stopped() {
    struct Broken(&'static str, bool);
    impl Measure for Broken {
        fn measure(&mut self, _: &Unit, _: &Path, _: &dyn Fn(u64, u64)) -> anyhow::Result<Outcome> {
            let row = vec![Row { metric: self.0.to_owned(), ..Row::default() }];
            Ok(if self.1 { Outcome { times: row, rows: Vec::new() } } else { Outcome { rows: row, times: Vec::new() } })
        }
    }
    for (metric, as_time, says) in
        [("nonsense", false, "is not a known metric"), ("gpu_ms:shading", false, "wrong table"), ("rmse", true, "wrong table")]
    {
        let folder = Folder::new("broken");
        let mut run = Run::open(&trial(), &place(&folder.0), &machine()).unwrap();
        let error = format!("{:#}", run.carry_out(&mut Broken(metric, as_time), &|_, _| {}, &uninterrupted).unwrap_err());
        assert!(error.contains(says), "{error}");
        // The error of a shard numbers the parts of this shard, not those of the whole run. Part 1 of this shard is a reference whose rows another
        // shard stores, so its wrong rows are not noticed. The error occurs in part 2.
        let folder = Folder::new("broken shard");
        let shard = Place { shard: Some(Shard { number: 2, count: 4 }), ..place(&folder.0) };
        let mut run = Run::open(&trial(), &shard, &machine()).unwrap();
        let parts = run.progress().1;
        let error = format!("{:#}", run.carry_out(&mut Broken(metric, as_time), &|_, _| {}, &uninterrupted).unwrap_err());
        assert!(error.contains(&format!("part 2 of {parts} (")), "{error}");
    }
}

#[test]
fn the_store_sets_the_columns_that_follow_from_the_metric() {
    /// Measures rows with wrong units, and with signals that are missing or that the metric does not have.
    struct Careless;
    impl Measure for Careless {
        fn measure(&mut self, _: &Unit, _: &Path, _: &dyn Fn(u64, u64)) -> anyhow::Result<Outcome> {
            let row = |metric: &str, signal: &str| Row {
                metric: metric.to_owned(),
                signal: signal.to_owned(),
                unit: "wrong".to_owned(),
                ..Row::default()
            };
            Ok(Outcome { rows: vec![row("rmse", ""), row("rmse", "lit"), row("flip_rate", "lit")], times: Vec::new() })
        }
    }
    let folder = Folder::new("careless");
    let mut run = Run::open(&trial(), &place(&folder.0), &machine()).unwrap();
    run.carry_out(&mut Careless, &|_, _| {}, &uninterrupted).unwrap();
    let data = run.finish().unwrap();
    let found: BTreeSet<(&str, &str, &str)> =
        data.rows.iter().map(|row| (row.metric.as_str(), row.signal.as_str(), row.unit.as_str())).collect();
    let expected = [("flip_rate", "", "1"), ("rmse", "albedo", "linear albedo"), ("rmse", "lit", "linear display value")];
    assert_eq!(found, BTreeSet::from(expected));
}

#[test]
fn shards_together_are_the_whole() {
    let (whole, split) = (Folder::new("unsplit"), Folder::new("split"));
    let trial = trial();
    let one = complete(&trial, &place(&whole.0));
    let shard = |number: u32, count: u32| Place { shard: Some(Shard { number, count }), ..place(&split.0) };
    for number in [1, 3] {
        let data = complete(&trial, &shard(number, 4));
        assert!(data.complete && data.rows.len() < one.rows.len());
    }
    let run = split.0.join("trial");
    let data = read_run(&run).unwrap();
    assert!(
        !data.complete && data.missing.len() == 2 && data.missing[0].contains("shard 2/4") && data.missing[1].contains("shard 4/4"),
        "{:?}",
        data.missing
    );
    // A whole run cannot use a folder that contains shards.
    assert!(refused(&trial, &place(&split.0), &machine()).contains("shard-1-of-4"));
    complete(&trial, &shard(2, 4));
    let data = complete(&trial, &shard(4, 4));
    assert!(data.missing.is_empty());
    let data = read_run(&run).unwrap();
    assert!(data.complete && data.folders.len() == 4, "{:?}", data.missing);
    assert!(same(&data.rows, &one.rows), "{} rows of shards and {} of the whole", data.rows.len(), one.rows.len());
    assert!(!same(&data.rows[1..], &one.rows), "the comparison does not notice a missing row");
    assert_eq!(data.times.len(), one.times.len());
    // Shards that do not belong to the run are refused. They come from a split into a different number of shards, from a different adapter, or from a
    // different definition.
    complete(&trial, &shard(1, 3));
    let error = format!("{:#}", read_run(&run).unwrap_err());
    assert!(error.contains("does not belong") && error.contains("shards"), "{error}");
    fs::remove_dir_all(run.join("shard-1-of-3")).unwrap();
    let manifest = run.join("shard-2-of-4/manifest.json");
    let text = fs::read_to_string(&manifest).unwrap();
    for (from, to, says) in [
        ("\"none\"", "\"another\"", "the adapter"),
        ("frames = 4", "frames = 5", "`frames`"),
        ("\"small\": false", "\"small\": true", "small"),
    ] {
        assert!(text.contains(from), "{from}: {text}");
        fs::write(&manifest, text.replacen(from, to, 1)).unwrap();
        let error = format!("{:#}", read_run(&run).unwrap_err());
        assert!(error.contains("does not belong") && error.contains(says) && error.contains("shard-2-of-4"), "{error}");
    }
    fs::write(&manifest, text).unwrap();
    let metrics = run.join("shard-2-of-4/metrics.parquet");
    fs::write(&metrics, b"PAR1 nothing PAR1").unwrap();
    let error = format!("{:#}", read_run(&run).unwrap_err());
    assert!(error.contains("shard-2-of-4") && error.contains("damaged"), "{error}");
}

#[test]
fn what_is_no_run_is_refused() {
    let folder = Folder::new("none");
    let error = |path: &Path| format!("{:#}", read_run(path).unwrap_err());
    assert!(error(&folder.0).contains("holds no run"));
    assert!(error(&folder.0.join("nowhere")).contains("nowhere"));
    complete(&trial().small(), &place(&folder.0));
    let text = error(&folder.0);
    assert!(text.contains("holds runs") && text.contains("trial"), "{text}");
}

// ---- Tables. ----

fn sample_rows() -> Vec<Row> {
    let extremes = [0.0, -0.0, 0.1 + 0.2, f64::MIN_POSITIVE / 2.0, f64::MAX, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1.0e-300];
    (0..50u32)
        .map(|i| Row {
            experiment: "trial".to_owned(),
            view: ["cliff", "größe, \"quoted\"\nline", ""][i as usize % 3].to_owned(),
            frame: (i % 4 > 0).then_some(i * 90_000_000),
            lag: (i % 2 > 0).then_some(i),
            frequency: (i % 5 > 0).then_some(f64::from(i) / 7.0),
            metric: "rmse".to_owned(),
            value: extremes[i as usize % extremes.len()],
            standard_error: (i % 3 > 0).then_some(extremes[(i as usize + 4) % extremes.len()]),
            ..Row::default()
        })
        .collect()
}

fn write(file: &Path, rows: &[Row], chunk: usize) {
    write_parquet(file, &mut rows.chunks(chunk).map(|rows| Ok(rows.to_vec())), &[("a".to_owned(), "b".to_owned())]).unwrap();
}

#[test]
fn tables_hold_every_number_exactly_and_the_same_bytes() {
    let folder = Folder::new("tables");
    let rows = sample_rows();
    let (one, two) = (folder.0.join("one.parquet"), folder.0.join("two.parquet"));
    write(&one, &rows, 7);
    write(&two, &rows, 7);
    assert!(fs::read(&one).unwrap() == fs::read(&two).unwrap(), "the same rows give different bytes");
    let table = read_parquet(&one).unwrap();
    assert!(same(&table.rows, &rows), "rows changed");
    assert_eq!(table.rows[1].value.to_bits(), (-0.0f64).to_bits());
    assert_eq!(table.notes.into_iter().collect::<Vec<_>>(), [("a".to_owned(), "b".to_owned())]);
    // A table with many rows in one Parquet row group, and a table without rows.
    let many: Vec<Row> = rows.iter().cycle().take(150_000).cloned().collect();
    write(&two, &many, 150_000);
    assert!(same(&read_parquet(&two).unwrap().rows, &many));
    write(&two, &[], 1);
    assert!(read_parquet(&two).unwrap().rows.is_empty());
    let csv = folder.0.join("t.csv");
    write_csv(&csv, &mut rows.chunks(7).map(|rows| Ok(rows.to_vec()))).unwrap();
    let read: Vec<Row> = csv::Reader::from_path(&csv).unwrap().deserialize().map(|row| row.unwrap()).collect();
    assert!(same(&read, &rows), "CSV changed a row");
    write_csv(&csv, &mut std::iter::empty()).unwrap();
    assert_eq!(fs::read_to_string(&csv).unwrap().trim_end(), COLUMNS.map(|column| column.name).join(","));
    // If the source of the rows fails, the existing file is not changed.
    let before = fs::read(&one).unwrap();
    let broken = || [Ok(rows.clone()), Err(anyhow::anyhow!("the source failed"))].into_iter();
    let error = format!("{:#}", write_parquet(&one, &mut broken(), &[]).unwrap_err());
    assert!(error.contains("the source failed") && fs::read(&one).unwrap() == before && names(&folder.0).len() == 3, "{error}");
}

#[test]
fn damaged_tables_are_refused_in_one_line_and_never_believed() {
    let folder = Folder::new("corrupt");
    let file = folder.0.join("t.parquet");
    let rows = sample_rows();
    write(&file, &rows, 25);
    let sound = fs::read(&file).unwrap();
    let mut refusals = 0;
    let mut check = |bytes: &[u8], what: &str| {
        fs::write(&file, bytes).unwrap();
        match read_parquet(&file) {
            // Bytes that the reader does not use (names of encodings, sizes of pages) may change; the rows may not.
            Ok(table) => assert!(same(&table.rows, &rows), "{what}: changed rows were accepted"),
            Err(error) => {
                let error = format!("{error:#}");
                assert!(error.contains("t.parquet") && error.contains("damaged"), "{what}: {error}");
                refusals += 1;
            }
        }
    };
    for length in 0..sound.len() {
        check(&sound[..length], &format!("first {length} bytes"));
    }
    for at in 0..sound.len() {
        for mask in [0x01, 0x80, 0xff] {
            let mut bytes = sound.clone();
            bytes[at] ^= mask;
            check(&bytes, &format!("byte {at} ^ {mask:#x}"));
        }
    }
    for seed in 0..200 {
        let noise: Vec<u8> = (0..500).map(|i| (number(&format!("{seed}/{i}")) * 256.0) as u8).collect();
        check(&noise, "noise");
        let mut framed = b"PAR1".to_vec();
        framed.extend(&noise);
        framed.extend(400u32.to_le_bytes());
        framed.extend(b"PAR1");
        check(&framed, "framed noise");
    }
    assert!(refusals > sound.len() + 400, "only {refusals} refusals");
}

/// Writes a valid Parquet file that is not a table of this project. `notes` = whether it has the metadata that the tables of this project have.
fn foreign_table(file: &Path, schema: &str, notes: bool) {
    let schema = Arc::new(parse_message_type(schema).unwrap());
    let mut writer = SerializedFileWriter::new(File::create(file).unwrap(), schema, Arc::new(WriterProperties::new())).unwrap();
    let mut group = writer.next_row_group().unwrap();
    while let Some(mut column) = group.next_column().unwrap() {
        match column.untyped() {
            parquet::column::writer::ColumnWriter::ByteArrayColumnWriter(_) => {
                column.typed::<ByteArrayType>().write_batch(&[ByteArray::from("x")], None, None).unwrap();
            }
            _ => {
                column.typed::<DoubleType>().write_batch(&[1.0], None, None).unwrap();
            }
        }
        column.close().unwrap();
    }
    group.close().unwrap();
    if notes {
        for (name, value) in [("scree.schema", SCHEMA), ("scree.rows", "1"), ("scree.xxhash64", "0")] {
            writer.append_key_value_metadata(parquet::file::metadata::KeyValue::new(name.to_owned(), value.to_owned()));
        }
    }
    writer.close().unwrap();
}

/// Returns the error for a table that has the columns of this version, but the schema number 1 of an earlier version.
fn other_version(file: &Path) -> String {
    write(file, &sample_rows(), 25);
    let sound = fs::read(file).unwrap();
    let note = b"scree.schema";
    let start = sound.windows(note.len()).position(|bytes| bytes == note).expect("the notes") + note.len();
    let at = start + sound[start..].iter().position(|byte| SCHEMA.as_bytes() == [*byte]).expect("the schema has one digit");
    let mut bytes = sound;
    bytes[at] = b'1';
    fs::write(file, bytes).unwrap();
    format!("{:#}", read_parquet(file).unwrap_err())
}

#[test]
fn tables_of_others_are_refused_by_what_they_lack() {
    let folder = Folder::new("others");
    let file = folder.0.join("t.parquet");
    let error = |schema: &str, notes: bool| {
        foreign_table(&file, schema, notes);
        let error = format!("{:#}", read_parquet(&file).unwrap_err());
        assert_eq!(error.lines().count(), 1);
        error
    };
    assert!(error("message m { REQUIRED DOUBLE value; }", false).contains("`scree.schema` is missing"));
    assert!(error("message m { REQUIRED DOUBLE value; }", true).contains("column `experiment` is missing"));
    assert!(error("message m { REQUIRED DOUBLE experiment; }", true).contains("column `experiment` has the wrong type"));
    // A table of another version is refused because of its version, and not because of a column that it lacks.
    assert!(other_version(&file).contains("its schema is 1, but this version reads schema 2"));
    let all_texts: String = COLUMNS.iter().map(|column| format!("REQUIRED BYTE_ARRAY {} (STRING); ", column.name)).collect();
    assert!(error(&format!("message m {{ {all_texts} }}"), true).contains("column `frame` has the wrong type"));
    let mut text = File::create(&file).unwrap();
    text.write_all(b"experiment,value\ntrial,1\n").unwrap();
    assert!(format!("{:#}", read_parquet(&file).unwrap_err()).contains("not a Parquet file"));
    assert!(format!("{:#}", read_parquet(&folder.0.join("nowhere.parquet")).unwrap_err()).contains("cannot read"));
}

// ---- The program. ----

#[test]
fn wrong_calls_of_run_and_check() {
    usage_error(&["run"], &["DEFINITION.toml"]);
    usage_error(&["check"], &["DEFINITION.toml"]);
    usage_error(&["run", "x.toml", "--shard", "3/2"], &["--shard", "K/N"]);
    usage_error(&["run", "x.toml", "--shard", "two"], &["--shard", "K/N"]);
    usage_error(&["run", "x.toml", "--jobs", "0"], &["--jobs", "1 to 1024"]);
    usage_error(&["check", "x.toml", "--resume"], &["--resume"]);
    let folder = Folder::new("calls");
    failure(&["run", "nowhere.toml"], &["nowhere.toml", "no such file"]);
    failure(&["run", &folder.path("")], &["is a folder"]);
    let binary = folder.write("binary.toml", "\u{0}");
    failure(&["check", &binary], &["binary.toml:1"]);
    let wrong = folder.write("wrong.toml", &edited("frames = 4", "frames = 0"));
    failure(&["run", &wrong], &["wrong.toml:5", "frames"]);
    let (one, two) = (folder.write("one.toml", TEXT), folder.write("two.toml", TEXT));
    failure(&["run", &one, &two], &["one.toml", "two.toml", "both called `trial`"]);
    let nothing = &TEXT[..TEXT.find("[[expect]]").unwrap()];
    let nothing = folder.write("nothing.toml", nothing);
    failure(&["check", &nothing], &["has no expectations"]);
    let data = folder.write("data.toml", &format!("scene = \"$SCREE_DATA/x.toml\"\n{TEXT}"));
    let output = Command::new(crate::fixtures::program()).args(["run", &data]).env_remove("SCREE_DATA").output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(1) && stderr.contains("data.toml:1") && stderr.contains("SCREE_DATA, which is not set"),
        "{stderr}"
    );
    // If several experiments fail, each failure is reported, and a last line counts them.
    let output = Command::new(crate::fixtures::program()).args(["run", &wrong, "nowhere.toml"]).output().unwrap();
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && stderr.lines().count() == 3 && stderr.contains("2 of 2 experiments failed"), "{stderr}");
}

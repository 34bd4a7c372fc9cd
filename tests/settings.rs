//! Tests the tables of settings. They must be complete, and agree with scene files and with the documentation. A wrong value must cause the same
//! error wherever a user can write it.

use std::fs;
use std::path::{Path, PathBuf};

use ::experiments::definition;
use kernels::frame::{self, FrameSettings};
use kernels::scene::{self, DEFAULT_TEXT, Scene, World};
use kernels::settings::{Home, Kind, Setting, shown};
use toml::Value;
use workbench::model::kept::Kept;
use workbench::model::settings::{Settings, numbers};

use crate::fixtures::{Folder, run, text};

fn default_scene() -> Scene {
    scene::load(scene::DEFAULT).expect("built in")
}

/// The default scene, but with a heightmap as its world. A heightmap has settings that a procedural world does not have. The file of the heightmap
/// does not have to exist.
pub(crate) fn heightmap_scene() -> Scene {
    let world = World::Heightmap {
        file: PathBuf::from("none.png"),
        metres_per_texel: 2.0,
        height_range_m: [-5.0, 10.0],
        detail_m: 0.5,
        seed: 3,
        holes: Vec::new(),
        colour_modulation: 0.25,
    };
    Scene { world, ..default_scene() }
}

/// Returns the value that a scene file has under a key, such as `sun.elevation_deg`.
fn held(scene: &Scene, key: &str) -> Option<Value> {
    let document = Value::try_from(scene).expect("a scene is a document");
    key.split('.').try_fold(document, |at, step| at.get(step).cloned())
}

/// Returns the keys of the values in a table that are not tables or lists of tables: numbers, flags, texts, and lists of numbers.
fn leaves(table: &Value, prefix: &str) -> Vec<String> {
    let is_leaf = |value: &Value| match value {
        Value::Table(_) => false,
        Value::Array(items) => !items.is_empty() && items.iter().all(|item| item.is_float() || item.is_integer()),
        _ => true,
    };
    let table = table.as_table().expect("a table");
    table.iter().filter(|(_, value)| is_leaf(value)).map(|(key, _)| format!("{prefix}{key}")).collect()
}

#[test]
fn every_single_value_of_a_scene_is_a_setting() {
    // These keys are not settings: one decides which settings exist, one is a file, and two are texts for people.
    let others = ["world.kind", "world.file", "name", "description"];
    let mut found = 0;
    for scene in [default_scene(), heightmap_scene()] {
        let document = Value::try_from(&scene).expect("a scene is a document");
        let mut keys = leaves(&document, "");
        for table in ["blend", "flavours", "sun", "sky", "world"] {
            keys.extend(leaves(&document[table], &format!("{table}.")));
        }
        for key in keys.iter().filter(|key| !others.contains(&key.as_str())) {
            assert!(scene::setting(key).is_some(), "`{key}` is in a scene file, but not a setting");
            found += 1;
        }
    }
    assert!(found > 40, "{found} values");
}

/// Returns a value that a setting of this kind accepts and that differs from `value`.
fn another(kind: Kind, value: &Value) -> Value {
    match (kind, value) {
        (Kind::Number(range), _) => Value::Float(range.most),
        (Kind::Numbers(count, range), _) => Value::Array(vec![Value::Float(range.most); count]),
        (Kind::Whole(_, most), _) => Value::Integer(most.into()),
        (Kind::OneOf(numbers), Value::Integer(now)) => {
            Value::Integer(numbers.iter().map(|&n| i64::from(n)).find(|n| n != now).expect("two at least"))
        }
        (Kind::Flag, Value::Boolean(on)) => Value::Boolean(!on),
        (Kind::Name(names), Value::String(now)) => {
            Value::String(names().into_iter().find(|name| name != now).expect("two at least").to_owned())
        }
        (Kind::Text(_), _) => Value::String("splat".to_owned()),
        (kind, value) => panic!("{value} is no value of {kind}"),
    }
}

/// Returns a value that a setting of this kind does not accept.
fn wrong(kind: Kind) -> Value {
    match kind {
        Kind::Number(range) => Value::Float(range.most + 1.0),
        Kind::Numbers(count, range) => Value::Array(vec![Value::Float(range.least - 1.0); count]),
        Kind::Whole(..) => Value::Integer(-1),
        Kind::OneOf(_) => Value::Integer(3),
        Kind::Flag => Value::String("yes".to_owned()),
        Kind::Name(_) => Value::String("nonsense".to_owned()),
        Kind::Text(_) => Value::String("splatt".to_owned()),
    }
}

#[test]
fn settings_read_and_write_what_the_file_holds() {
    for scene in [default_scene(), heightmap_scene()] {
        let mut count = 0;
        for setting in scene::settings() {
            let value = setting.get(&scene);
            assert_eq!(value, held(&scene, setting.key), "{}", setting.key);
            let Some(value) = value else { continue };
            let mut changed = scene.clone();
            let other = another(setting.kind, &value);
            setting.set(&mut changed, &other).unwrap_or_else(|what| panic!("{what}"));
            assert_eq!((setting.get(&changed), held(&changed, setting.key)), (Some(other.clone()), Some(other)), "{}", setting.key);
            assert!(changed != scene, "{}", setting.key);
            // A value that is not accepted changes nothing.
            let mut unchanged = scene.clone();
            let what = setting.set(&mut unchanged, &wrong(setting.kind)).expect_err("not accepted");
            assert!(what.starts_with(&format!("`{}` is ", setting.key)) && unchanged == scene, "{what}");
            count += 1;
        }
        assert!(count >= 20, "{count} settings");
    }
    let usual = FrameSettings::default();
    for setting in frame::settings() {
        let value = setting.get(&usual).expect("a frame has them all");
        let mut changed = usual;
        setting.set(&mut changed, &another(setting.kind, &value)).unwrap_or_else(|what| panic!("{what}"));
        let others = frame::settings().filter(|other| other.get(&changed) != other.get(&usual));
        assert_eq!(others.map(|other| other.key).collect::<Vec<_>>(), [setting.key]);
        setting.set(&mut changed, &wrong(setting.kind)).expect_err("not accepted");
    }
}

#[test]
fn defaults_are_what_an_empty_table_gives() {
    let lists = "[[material]]\nname = \"grass\"\nprocedural = \"grass\"\ntile_m = 2.0\n[[rule]]\nmaterial = \"grass\"\n";
    let procedural = "[world]\nkind = \"procedural\"\nseed = 1\n";
    let heightmap = "[world]\nkind = \"heightmap\"\nfile = \"none.png\"\nmetres_per_texel = 1.0\nheight_range_m = [0.0, 1.0]\n";
    for world in [procedural, heightmap] {
        let empty: Scene = toml::from_str(&format!("name = \"empty\"\n{world}{lists}")).expect("a scene");
        for setting in scene::settings() {
            let Some(value) = setting.get(&empty) else { continue };
            match (setting.default)() {
                Some(default) => assert_eq!(value, default, "{}", setting.key),
                None => assert!(setting.key.starts_with("world."), "{} has no default", setting.key),
            }
        }
    }
    for setting in frame::settings() {
        assert_eq!(setting.get(&FrameSettings::default()), (setting.default)(), "{}", setting.key);
    }
}

/// Returns the error for an experiment definition that sets `key` to `value`.
fn of_definition(folder: &Folder, key: &str, value: &Value) -> String {
    let text = format!(
        "name = \"wrong\"\nquestion = \"What is said?\"\nviews = [\"cliff\"]\nsize = [16, 16]\nframes = 1\nvariants = [\"auto\"]\n[set]\n\"{key}\" = {value}\n"
    );
    definition::parse(&text, "wrong.toml", &folder.0).expect_err("refused").to_string()
}

/// Returns the error that the program prints for wrong arguments.
fn of_call(arguments: &[String]) -> String {
    let mut all = vec!["render", "--camera", "cliff", "--out", "x.png"];
    all.extend(arguments.iter().map(String::as_str));
    let output = run(&all);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}");
    text(&output.stderr)
}

/// Returns the warnings of the workbench about a state file with a wrong value. Checks that this file changes no setting.
fn of_state(folder: &Folder, text: &str) -> Vec<String> {
    let file = folder.write("workbench.toml", &format!("version = 2\n{text}"));
    let (kept, line) = Kept::load(Path::new(&file));
    assert_eq!(line, None, "{text}");
    let usual = Settings::new(default_scene());
    let mut settings = usual.clone();
    let mut said = kept.apply_look(&mut settings);
    said.extend(kept.apply_numbers(scene::DEFAULT, &mut settings.scene));
    assert!(settings == usual, "{text}");
    assert!(Path::new(&file).is_file(), "the file is still there");
    said
}

/// Returns the error of the setting itself for a wrong value.
fn sentence<T>(setting: &Setting<T>, owner: &mut T) -> String {
    setting.set(owner, &wrong(setting.kind)).expect_err("not accepted")
}

/// A value as it is written on the command line.
fn typed(value: &Value) -> String {
    value.as_str().map_or_else(|| shown(value).replace(['[', ']'], ""), str::to_owned)
}

#[test]
fn a_wrong_value_of_a_frame_is_said_in_one_sentence_everywhere() {
    let folder = Folder::new("frame-settings");
    let bias = frame::setting("frame.lod_bias").expect("a setting");
    let nine = bias.set(&mut FrameSettings::default(), &Value::Integer(9)).expect_err("too coarse");
    assert_eq!(nine, "`frame.lod_bias` is 9, must be -2 to 4");
    assert_eq!(bias.set(&mut FrameSettings::default(), &Value::Float(9.0)), Err(nine.clone()));
    let mut homes = 0;
    for setting in frame::settings() {
        let said = sentence(setting, &mut FrameSettings::default());
        let value = wrong(setting.kind);
        if setting.has_home(Home::Definition) {
            let found = of_definition(&folder, setting.key, &value);
            assert!(found.ends_with(&said), "{said}: {found}");
            homes += 1;
        }
        if setting.has_home(Home::Option) && !matches!(setting.kind, Kind::Flag) {
            let found = of_call(&[format!("--{}", setting.option()), typed(&value)]);
            assert!(found.contains(&format!(": {said} (")), "{said}: {found}");
            homes += 1;
        }
        if setting.has_home(Home::Workbench) {
            let found = of_state(&folder, &format!("[look]\n{} = {value}\n", setting.name()));
            assert!(matches!(&found[..], [line] if line.ends_with(&said)), "{said}: {found:?}");
            homes += 1;
        }
    }
    assert!(homes > 20, "only {homes} errors were checked");
}

#[test]
fn a_wrong_value_of_a_scene_is_said_in_one_sentence_everywhere() {
    let folder = Folder::new("scene-settings");
    let mut homes = 0;
    for setting in scene::settings() {
        let mut scene = default_scene();
        let Some(usual) = setting.get(&scene) else { continue };
        let (said, value) = (sentence(setting, &mut scene), wrong(setting.kind));
        let found = of_call(&["--set".to_owned(), format!("{}={}", setting.key, typed(&value))]);
        assert!(found.contains(&format!(": {said} (")), "{said}: {found}");
        let found = of_definition(&folder, setting.key, &value);
        assert!(found.ends_with(&said), "{said}: {found}");
        // Makes the same mistake in a scene file that contains all settings.
        let (from, to) = (format!("\n{} = {usual}\n", setting.name()), format!("\n{} = {value}\n", setting.name()));
        let written = toml::to_string(&scene).expect("a scene can be written");
        let changed = written.replacen(&from, &to, 1);
        assert_ne!(changed, written, "`{from}` is not in the scene's text");
        let line = 1 + changed[..changed.find(&to).expect("just put there") + 1].matches('\n').count();
        let found = scene::parse(&changed, "test.toml", Path::new("")).expect_err("refused").to_string();
        assert_eq!(found, format!("scene test.toml:{line}: {said}"));
        homes += 3;
    }
    for (setting, _) in numbers() {
        let said = sentence(setting, &mut default_scene());
        let found = of_state(&folder, &format!("[scene.default.numbers]\n\"{}\" = {}\n", setting.key, wrong(setting.kind)));
        assert!(matches!(&found[..], [line] if line.ends_with(&said)), "{said}: {found:?}");
        homes += 1;
    }
    assert!(homes > 60, "only {homes} errors were checked");
}

#[test]
fn settings_that_a_definition_lists_are_not_set() {
    let folder = Folder::new("listed");
    for (key, list) in
        [("frame.noise", "noises"), ("frame.estimator", "estimators"), ("frame.variant", "variants"), ("frame.generic", "variants")]
    {
        let found = of_definition(&folder, key, &Value::String("white".to_owned()));
        assert!(found.contains(&format!("a definition gives it in `{list}`")), "{found}");
    }
}

#[test]
fn settings_reference_is_current() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/settings.md");
    let now = workbench::model::settings::reference();
    for setting in scene::settings() {
        assert!(now.contains(&format!("| `{}` |", setting.key)), "{} is left out", setting.key);
    }
    if std::env::var_os("SCREE_RECORD").is_some_and(|value| value == "1") {
        fs::write(&file, &now).expect("the reference can be written");
    }
    let kept = fs::read_to_string(&file).unwrap_or_default();
    let line =
        kept.lines().zip(now.lines()).position(|(kept, now)| kept != now).unwrap_or(kept.lines().count().min(now.lines().count())) + 1;
    assert!(
        kept == now,
        "docs/settings.md differs from the tables of settings in line {line}: \
         `SCREE_RECORD=1 cargo test --release --test scree settings_reference` rewrites it"
    );
}

#[test]
fn the_built_in_scene_is_not_changed_by_its_settings() {
    // The built-in scene file gives its settings their default values, so the test fails if a default differs from the file. The settings of sun and
    // sky are left out, because the file gives them values that differ from the defaults.
    let written = scene::parse(DEFAULT_TEXT, scene::DEFAULT, Path::new("")).expect("built in");
    let has_default = |key: &str| !key.starts_with("sun.") && !key.starts_with("sky.");
    for setting in scene::settings().filter(|setting| has_default(setting.key)) {
        if let (Some(value), Some(default)) = (setting.get(&written), (setting.default)()) {
            assert_eq!(value, default, "{}", setting.key);
        }
    }
}

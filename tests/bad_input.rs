//! Tests wrong calls and wrong files on the command line: the exit status must be right, and one line must say what is wrong, where it is wrong and
//! how to fix it.
//!
//! The tests run the program `experiments`, which must have been built in the same profile (`cargo build -p experiments`). `make test` builds it
//! first.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use kernels::probe::PROBES;

use crate::fixtures::{Folder, failure, program, success, text, usage_error};

#[test]
fn wrong_calls_are_usage_errors() {
    let render = |more: &[&'static str]| {
        let mut all = vec!["render", "--camera", "cliff", "--out", "x.png"];
        all.extend_from_slice(more);
        all
    };
    usage_error(&[], &["Usage"]);
    usage_error(&["rendr"], &["rendr", "render"]);
    usage_error(&render(&["--seed", "-1"]), &["--seed", "-1"]);
    usage_error(&render(&["--variant", "-1"]), &["1 to 31"]);
    usage_error(&["render", "--out", "x.png"], &["--camera", "--pose"]);
    usage_error(&["render", "--camera", "cliff"], &["--out"]);
    usage_error(&["render", "--camera", "cliff", "--out", "x.jpg"], &[".exr", ".png"]);
    usage_error(&["render", "--camera", "cliff", "--out", "x"], &[".exr", ".png"]);
    usage_error(&["render", "--camera", "cliff", "--pose", "0,0,0,0,0", "--out", "x.png"], &["cannot be used with"]);
    usage_error(&["render", "--pose", "0,0,0,0", "--out", "x.png"], &["X,Y,Z,YAW,PITCH"]);
    usage_error(&["render", "--pose", "0,0,nan,0,0", "--out", "x.png"], &["finite"]);
    usage_error(&["render", "--pose", "-5,0,9,0,95", "--out", "x.png"], &["PITCH"]);
    for wrong in ["0", "32", "-1", "4294967297"] {
        usage_error(&["render", "--camera", "cliff", "--out", "x.png", &format!("--variant={wrong}")], &["1 to 31", wrong]);
    }
    usage_error(&render(&["--variant", "vt+vt2"]), &["did you mean `vt`?"]);
    for wrong in ["0x0", "1000000x1", "16385x1", "16384x16384"] {
        usage_error(&["render", "--camera", "cliff", "--out", "x.png", "--size", wrong], &["16384", "2^26"]);
    }
    usage_error(&render(&["--size", "960"]), &["WIDTHxHEIGHT"]);
    usage_error(&render(&["--size", "-4x4"]), &["-4"]);
    usage_error(&render(&["--size=-4x4"]), &["WIDTHxHEIGHT"]);
    usage_error(&render(&["--fov", "176"]), &["1..=175"]);
    usage_error(&render(&["--fov", "-5"]), &["1..=175"]);
    usage_error(&render(&["--noise", "pink"]), &["hashed-anisotropic", "white", "stbn"]);
    usage_error(&render(&["--estimator", "best"]), &["fc5", "exact"]);
    usage_error(&render(&["--reference", "0"]), &["1..=65536"]);
    usage_error(&render(&["--reference", "4", "--variant", "splat"]), &["cannot be used with"]);
    usage_error(&render(&["--seed=-1"]), &["--seed"]);
    usage_error(&render(&["--frames", "0"]), &["--frames"]);
    usage_error(&render(&["--aov", "albedo"]), &["--aov", ".exr"]);
    usage_error(&["render", "--camera", "cliff", "--out", "x.exr", "--aov", "albedo,albdo"], &["albdo", "albedo"]);
    usage_error(&["demo", "--seeds", "1"], &["--seeds"]);
    for wrong in ["0", "-5", "nan", "1e9", "soon"] {
        usage_error(&["bench", "--budget", wrong], &["--budget", "SECONDS"]);
    }
    usage_error(&["demo", "--size", "0x0"], &["16384"]);
    usage_error(&["explain"], &["SCENE"]);
    usage_error(&["import", "x.png", "--metres-per-texel", "0", "--out", "y"], &["above 0"]);
    usage_error(&["import", "x.png", "--metres-per-texel", "nan", "--out", "y"], &["finite"]);
    usage_error(&["import", "x.png", "--metres-per-texel", "1", "--height-range", "5,5", "--out", "y"], &["LO must be below HI"]);
    usage_error(&["import", "x.png", "--metres-per-texel", "1", "--window", "0,0,1,1", "--out", "y"], &["X,Y,W,H"]);
    usage_error(&["import", "x.raw", "--metres-per-texel", "1", "--raw-size", "0x9", "--out", "y"], &["at least 2"]);
    usage_error(&["probe"], &["KERNEL"]);
    usage_error(&["stability", "--only", "noise", "--every-adapter"], &["--only", "kernels"]);
    usage_error(&["stability", "--only", "sound"], &["kernels", "directions", "noise"]);
    usage_error(&["probe", "select", "--on", "f16", "--input", "a", "--output", "b"], &["gpu", "f32", "f64"]);
    usage_error(&["probe", "select", "--input", "a.csv"], &["--output"]);
}

#[test]
fn help_and_version_are_no_errors() {
    for arguments in [&["--help"][..], &["help", "render"], &["render", "--help"], &["probe", "--help"], &["--version"]] {
        assert!(!success(arguments).is_empty());
    }
    assert!(success(&["--help"]).contains("Exit status"));
}

#[test]
fn output_that_cannot_be_written_is_refused_before_the_work() {
    let folder = Folder::new("output");
    let render = |out: &str, says: &[&str]| failure(&["render", "--camera", "cliff", "--out", out], says);
    render(&folder.path("missing/x.png"), &["no folder", "missing", "create it"]);
    let file = folder.write("file", "");
    render(&format!("{file}/x.png"), &["is not a folder"]);
    fs::create_dir(folder.path("taken.png")).expect("a folder can be made");
    render(&folder.path("taken.png"), &["is a folder"]);
    // The check whether a file can be written leaves no file behind.
    failure(&["render", "--camera", "clif", "--out", &folder.path("x.png")], &["did you mean `cliff`?"]);
    let mut left: Vec<_> = fs::read_dir(&folder.0).expect("readable").filter_map(|e| e.ok()?.file_name().into_string().ok()).collect();
    left.sort();
    assert_eq!(left, ["file", "taken.png"]);
}

#[cfg(unix)]
#[test]
fn links_are_followed_and_pipes_are_not_replaced() {
    let folder = Folder::new("links");
    let input = folder.write("in.csv", "x,y,z,w\n1,2,3,0\n");
    let probe = |output: &str| {
        vec!["probe".to_owned(), "hash".to_owned(), "--on=f64".to_owned(), format!("--input={input}"), format!("--output={output}")]
    };
    let (real, link) = (folder.write("real.csv", ""), folder.path("link.csv"));
    std::os::unix::fs::symlink(&real, &link).expect("a link can be made");
    success(&probe(&link).iter().map(String::as_str).collect::<Vec<_>>());
    assert!(fs::symlink_metadata(&link).expect("it exists").is_symlink(), "the link was replaced");
    assert!(fs::read_to_string(&real).expect("readable").starts_with("x,y,z,w,"), "the file behind the link was not written");
    let pipe = folder.path("pipe");
    assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
    failure(&probe(&pipe).iter().map(String::as_str).collect::<Vec<_>>(), &["pipe", "is a device or a pipe", "give the name of a file"]);
    assert!(!fs::symlink_metadata(&pipe).expect("it exists").is_file(), "the pipe was replaced");
}

#[test]
fn wrong_scenes_fail_with_their_place() {
    let folder = Folder::new("scene");
    failure(&["explain", "defualt"], &["did you mean `default`?"]);
    failure(&["explain", &folder.path("no.toml")], &["no such file"]);
    failure(&["explain", &folder.path("")], &["no scene.toml"]);
    let bad = folder.write("bad.toml", &kernels::scene::DEFAULT_TEXT.replacen("anisotropy", "anisotropie", 1));
    failure(&["explain", &bad], &["bad.toml:", "did you mean `anisotropy`?"]);
    let out = folder.path("x.png");
    failure(&["render", "--scene", &bad, "--camera", "cliff", "--out", &out], &["did you mean `anisotropy`?"]);
    failure(&["render", "--camera", "clif", "--out", &out], &["no camera `clif`", "did you mean `cliff`?"]);
    failure(&["render", "--camera", "spaceship", "--out", &out], &["no camera `spaceship`", "cliff", "vista"]);
    failure(&["render", "--path", "sidewards", "--out", &out], &["no path `sidewards`", "did you mean `sideways`?"]);
}

#[test]
fn explain_prints_both_lists_and_json() {
    let printed = success(&["explain", "default"]);
    assert!(printed.contains("required") && printed.contains("not required"), "{printed}");
    let json: serde_json::Value = serde_json::from_str(&success(&["explain", "default", "--json"])).expect("JSON");
    assert_eq!(json["variants"].as_array().map(Vec::len), Some(31));
    assert!(json["texture_bytes"].as_u64().is_some_and(|bytes| bytes > 0));
    // Each setting is printed with its value, default, range and unit.
    let line = printed.lines().find(|line| line.trim_start().starts_with("blend.hash_scale ")).expect("a setting");
    assert!(line.contains(" 1 px ") && line.contains("default 1") && line.contains("0.01 to 100"), "{line}");
    let setting = json["settings"].as_array().and_then(|all| all.iter().find(|row| row["key"] == "blend.hash_scale")).expect("a setting");
    let expected = serde_json::json!({
        "key": "blend.hash_scale", "group": "Blend", "value": 1.0, "default": 1.0, "accepts": "0.01 to 100", "range": [0.01, 100.0], "unit": "px",
        "about": setting["about"]
    });
    assert_eq!(*setting, expected);
}

#[test]
fn wrong_imports_fail_before_the_file_is_read() {
    let folder = Folder::new("import");
    let import = |heightmap: &str, out: &str, says: &[&str]| failure(&["import", heightmap, "--metres-per-texel", "1", "--out", out], says);
    import(&folder.path("no.png"), &folder.path("new"), &["there is no file"]);
    let file = folder.write("heights.png", "not an image");
    import(&file, &folder.path(""), &["is not empty"]);
    import(&file, &file, &["is a file"]);
    import(&file, &folder.path("missing/new"), &["there is no folder"]);
}

#[test]
fn a_missing_spacing_hides_no_truer_fault() {
    let folder = Folder::new("import-spacing");
    let out = folder.path("new");
    let import = |heightmap: &str, says: &[&str]| failure(&["import", heightmap, "--height-range", "0,100", "--out", &out], says);
    import(&folder.path("no.png"), &["there is no file"]);
    fs::create_dir(folder.path("a.png")).expect("created");
    import(&folder.path("a.png"), &["a.png is a folder"]);
    import(&folder.write("photo.jpg", "not an image"), &["photo.jpg", "the extension is unknown", ".bin"]);
    import(&folder.write("text.png", "not an image, although its name says so"), &["text.png", "cannot be decoded"]);
    #[cfg(unix)]
    {
        let pipe = folder.path("pipe.exr");
        assert!(Command::new("mkfifo").arg(&pipe).status().expect("mkfifo runs").success());
        import(&pipe, &["pipe.exr is a device or a pipe"]);
    }
    // Negative control: for a valid file, the error says that the spacing is missing.
    let samples: Vec<u8> = (0..16u16).flat_map(|sample| (sample * 999).to_le_bytes()).collect();
    fs::write(folder.path("right.raw"), samples).expect("written");
    import(&folder.path("right.raw"), &["right.raw", "does not say how far apart its samples are", "give --metres-per-texel"]);
    assert!(!PathBuf::from(&out).exists());
}

#[test]
fn probe_tables_are_checked() {
    let folder = Folder::new("probe");
    let out = folder.path("out.csv");
    let probe = |contents: &str, says: &[&str]| {
        let input = folder.write("in.csv", contents);
        failure(&["probe", "select", "--on", "f64", "--input", &input, "--output", &out], says);
    };
    probe("", &["is empty", "w_0,w_1,w_2,w_3,u"]);
    probe("w_0,w_1,w_2,w_3,u\n", &["no rows"]);
    probe("w_0,w_1,w_2,u\n1,1,1,0\n", &["no column `w_3`", "w_0,w_1,w_2,w_3,u"]);
    probe("w_0,w_1,w_2,w_3,u\n1,1,1,1,0\n1,1,x,1,0\n", &["line 3", "`w_2`", "`x` is not a number"]);
    probe("w_0,w_1,w_2,w_3,u\n1,1,1,1\n", &["line 2", "4 cells", "5"]);
    probe("w_0,w_1,w_2,w_3,u,note\n1,1,1,1,0,\"5 m\n1,1,1,1,0,a\n", &["in.csv, line 2", "quote", "not closed", "close it or remove it"]);
    probe("w_0,w_0,w_1,w_2,w_3,u\n1,1,1,1,1,1\n", &["more than one column `w_0`"]);
    probe("w_0,w_1,w_2,w_3,u,of_4\n1,1,1,1,1,1\n", &["already has a column `of_4`"]);
    let input = folder.write("seed.csv", &format!("{}\n{}\n", header("hashed-alpha"), "0,0.5,0,1,1,1,64,1,0,0,0,1,0,1,0,0"));
    failure(&["probe", "hashed-alpha", "--on", "f32", "--input", &input, "--output", &out], &["line 2", "`sector_x`", "whole numbers"]);
    failure(&["probe", "octahedron", "--input", &input, "--output", &out], &["no kernel", "octahedral"]);
    failure(&["probe", "select", "--on", "f64", "--input", &folder.path("no.csv"), "--output", &out], &["cannot open", "no.csv"]);
    failure(&["probe", "select", "--on", "f64", "--input", &input, "--output", &folder.path("no/out.csv")], &["no folder"]);
    assert!(!PathBuf::from(&out).exists(), "a failed probe must not leave an output file");
}

fn header(kernel: &str) -> String {
    let probe = PROBES.iter().find(|p| p.name == kernel).expect("there is such a probe");
    probe.inputs.iter().map(|c| c.name).collect::<Vec<_>>().join(",")
}

#[test]
fn probe_keeps_the_table_and_adds_its_results() {
    let folder = Folder::new("table");
    let input = folder.write("in.csv", "note,u,w_3,w_2,w_1,w_0\nfirst,0.1,1,1,1,1\nlast,0.9,1,1,1,1\nnone,0.5,0,0,2,0\n");
    let out = folder.path("out.csv");
    for on in ["f64", "f32"] {
        assert_eq!(success(&["probe", "select", "--on", on, "--input", &input, "--output", &out]), "");
        let made = fs::read_to_string(&out).expect("the output is there");
        let expected = "note,u,w_3,w_2,w_1,w_0,of_4,of_3\nfirst,0.1,1,1,1,1,0,0\nlast,0.9,1,1,1,1,3,2\nnone,0.5,0,0,2,0,1,1\n";
        assert_eq!(made, expected);
    }
}

#[test]
fn every_probe_is_listed_and_runs_on_both_references() {
    let folder = Folder::new("every");
    let listed = success(&["probe", "--list"]);
    let json: serde_json::Value = serde_json::from_str(&success(&["probe", "--list", "--json"])).expect("JSON");
    assert_eq!(json.as_array().map(Vec::len), Some(PROBES.len()));
    for probe in PROBES {
        assert!(listed.contains(probe.name), "{} is not listed", probe.name);
        // Returns 1. If the column accepts only whole numbers of a range, returns the number of this range that is nearest to 1.
        let one = |column: &kernels::probe::Column| column.whole.map_or(1, |[low, high]| 1.clamp(low, high)).to_string();
        let ones = probe.inputs.iter().map(one).collect::<Vec<_>>().join(",");
        let input = folder.write("in.csv", &format!("{}\n{ones}\n", header(probe.name)));
        for on in ["f64", "f32"] {
            let out = folder.path("out.csv");
            success(&["probe", probe.name, "--on", on, "--input", &input, "--output", &out]);
            let made = fs::read_to_string(&out).expect("the output is there");
            let cells = made.lines().nth(1).map_or(0, |row| row.split(',').count());
            assert_eq!(cells, probe.inputs.len() + probe.outputs.len(), "{made}");
            for (column, cell) in probe.outputs.iter().zip(made.lines().nth(1).unwrap_or_default().split(',').skip(probe.inputs.len())) {
                let value: f64 = cell.parse().expect("a number");
                assert!(value.is_finite(), "{} {}", probe.name, column.name);
                assert_eq!(column.accepts(value), Ok(()), "{} {}", probe.name, column.name);
            }
        }
    }
}

#[test]
fn the_checks_above_can_fail() {
    // The check functions must notice each of these faults: exit status 1 instead of 2, 2 instead of 1, a missing text, and a failure of a call that
    // should succeed.
    let caught = |check: fn()| std::panic::catch_unwind(check).is_err();
    assert!(caught(|| usage_error(&["explain", "nowhere"], &[])), "exit 1 passed for exit 2");
    assert!(caught(|| failure(&["render"], &[])), "exit 2 passed for exit 1");
    assert!(caught(|| failure(&["explain", "nowhere"], &["sunshine"])), "a text that is not there was found");
    assert!(caught(|| {
        success(&["explain", "nowhere"]);
    }));
}

#[test]
fn no_adapter_is_said_in_one_line_with_the_remedy() {
    let folder = Folder::new("adapter");
    let out = folder.path("x.png");
    let arguments = ["render", "--camera", "cliff", "--size", "8x8", "--out", &out];
    // Each case has an environment variable, its value, and a text that the error must contain. In the first case, no adapter has the requested name.
    // In the second case, no driver is found, as on a machine without drivers. This case is tested only on Linux, where Vulkan is the only graphics
    // interface that the program uses.
    let mut cases = vec![("WGPU_ADAPTER_NAME", "no such adapter", "experiments adapters")];
    if cfg!(target_os = "linux") {
        cases.push(("VK_DRIVER_FILES", "/nowhere/driver.json", "mesa-vulkan-drivers"));
    }
    for (variable, value, says) in cases {
        let mut command = Command::new(program());
        command.args(arguments).env(variable, value);
        if variable == "VK_DRIVER_FILES" {
            // VK_ICD_FILENAMES is an older name of VK_DRIVER_FILES. If it were set, it could name a driver.
            command.env_remove("VK_ICD_FILENAMES");
        }
        let output = command.output().expect("the program can be started");
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(1), "{variable}: {stderr}");
        // The Vulkan loader may print lines before the error. The error is a single line after them.
        let error = stderr.lines().last().unwrap_or_default();
        assert!(error.starts_with("error: adapter: ") && error.contains(says), "{variable}: {stderr}");
        assert!(!Path::new(&out).exists(), "{variable}: a picture was written");
    }
}

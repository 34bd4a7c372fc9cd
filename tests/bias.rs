//! Tests that a run finds a bias that is planted into a shader, and that its report states the bias. The runs are carried out in this process,
//! because the command line has no option that replaces shaders.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use experiments::definition;
use experiments::row::Row;
use experiments::runner::Runner;
use experiments::store::{Existing, Place, Provenance, Run};
use kernels::frame::shader_files;
use kernels::gpu::{GpuOptions, Sources};

use crate::fixtures::{Folder, open, success};

/// The definition of the runs. It has as many seeds as the recorded sweep. A picture has about an eighth of the pixels of a picture of the sweep.
const TEXT: &str = r#"name = "planted"
question = "Is a planted bias found?"
size = [160, 96]
frames = 1
seeds = 4
scene = "scene.toml"
views = ["cliff"]
variants = ["near-cliff", "far-cliff", "near-cliff+far-cliff"]
metrics = ["bias", "variance", "variance_theory"]
reference = { spp = 32, max_spp = 32 }
times = "none"

[set]
"blend.anisotropy" = 1
"#;

/// The shader file of the estimator `fc5`. The exact blend does not use this file, so a change of the file causes a bias.
const SHADER: &str = "shading/estimators/fc5.wgsl";
/// The last line of both functions of the shader file (near cliff and far cliff).
const LAST: &str = "    return sum;\n";
/// Replaces `LAST`: adds one percent of the range of albedo to every pixel.
const EVERYWHERE: &str = "    sum.albedo += vec3<f32>(0.01);\n    return sum;\n";
/// Replaces `LAST`: adds one percent in every second square of a chessboard, and subtracts one percent in the others. Each square is 16 pixels wide.
const CHESSBOARD: &str =
    "    sum.albedo += vec3<f32>(select(-0.01, 0.01, ((pixel.index.x / 16u + pixel.index.y / 16u) & 1u) == 0u));\n    return sum;\n";

/// Carries out a run with the shader [`SHADER`], in which `last` replaces [`LAST`]. Returns the rows of its table, and the two lines of its report
/// that state the checks of bias and variance. These lines call a variant that makes random choices a random row.
fn run(name: &str, last: &str) -> (Vec<Row>, Vec<String>) {
    let folder = Folder::new(name);
    let gpu = open(GpuOptions::default());
    let shader = shader_files().into_iter().find(|file| file.path == SHADER).expect("the estimator has a file");
    assert_eq!(shader.text.matches(LAST).count(), 2, "near and far cliff");
    if last != LAST {
        fs::create_dir_all(folder.0.join(SHADER).parent().expect("a folder")).expect("writable");
        folder.write(SHADER, &shader.text.replace(LAST, last));
        gpu.override_shaders(Arc::new(Sources::read(&folder.0, &[shader]).expect("just written")));
    }
    let small = kernels::scene::DEFAULT_TEXT.replace("detail_size = 1024", "detail_size = 64");
    assert_ne!(small, kernels::scene::DEFAULT_TEXT);
    folder.write("scene.toml", &small);
    let definition = definition::load(Path::new(&folder.write("planted.toml", TEXT))).expect("a definition");
    let place = Place { out: &folder.0.join("out"), own: false, existing: Existing::Refuse, shard: None, small: false };
    let machine = Provenance {
        adapter: gpu.info.name.clone(),
        driver: gpu.info.driver.clone(),
        software: gpu.is_software(),
        without_anisotropy: None,
        command: "none".to_owned(),
    };
    let mut run = Run::open(&definition, &place, &machine).expect("a new run");
    let mut runner = Runner::new(&gpu, &definition, None).expect("the variants exist");
    run.carry_out(&mut runner, &|_, _| {}, &|| Ok(())).expect("it is measured");
    let data = run.finish().expect("all parts are there");
    success(&["report", &data.folder.display().to_string()]);
    let report = fs::read_to_string(data.folder.join("report.md")).expect("just written");
    let checks = report.lines().filter(|line| line.starts_with("- ") && line.contains("random rows")).map(str::to_owned).collect();
    (data.rows, checks)
}

fn row<'a>(rows: &'a [Row], metric: &str, variant: &str) -> &'a Row {
    rows.iter().find(|row| row.metric == metric && row.variant == variant).unwrap_or_else(|| panic!("no {metric} of {variant}"))
}

#[test]
fn without_a_planted_bias_none_is_found_and_the_report_says_what_it_would_have_found() {
    let (rows, checks) = run("bias-none", LAST);
    let [bias, variance] = &checks[..] else { panic!("two checks: {checks:?}") };
    assert!(bias.starts_with("- \u{2705} none of 2 random rows is found to be biased; the largest is "), "{bias}");
    for words in
        ["expected by chance (level 0.1 % for all 4 tests together, 4 seeds)", "1 other random rows are compositions of these flavours"]
    {
        assert!(bias.contains(words), "`{words}` is missing in: {bias}");
    }
    // The report states which bias the check would find, in percent of the range of albedo. This must be less than the one percent that the other
    // tests plant.
    let stated = bias.split_once("a bias of ").and_then(|(_, rest)| rest.split_once(" % of the albedo range everywhere would be found"));
    let percent: f64 = stated.and_then(|(number, _)| number.parse().ok()).unwrap_or_else(|| panic!("no power is stated: {bias}"));
    assert!(percent > 0.05 && percent < 1.0, "{bias}");
    assert!(!variance.contains('\u{274c}') && variance.contains("predicted variance"), "{variance}");
    for variant in ["near-cliff", "far-cliff"] {
        for metric in ["bias", "exact_mse"] {
            let row = row(&rows, metric, variant);
            assert!(row.standard_error > Some(0.0) && row.freedom >= Some(3.0), "{row:?}");
        }
        // `exact_mse` and `variance` estimate the same quantity, so they must agree within the random error of four seeds. Only `exact_mse` has a
        // standard error.
        let [error, variance] = ["exact_mse", "variance"].map(|metric| row(&rows, metric, variant));
        assert!((variance.value / error.value - 1.0).abs() < 0.25 && variance.standard_error.is_none(), "{error:?} {variance:?}");
        assert!(row(&rows, "bias_squared", variant).standard_error > Some(0.0));
    }
}

#[test]
fn a_planted_bias_of_one_percent_is_found() {
    let (rows, checks) = run("bias-everywhere", EVERYWHERE);
    assert!(checks[0].starts_with("- \u{274c} 2 of 2 random rows are biased; the largest is "), "{checks:?}");
    for variant in ["near-cliff", "far-cliff"] {
        let bias = row(&rows, "bias", variant);
        let error = bias.standard_error.expect("four seeds");
        // The limit is five standard errors. With the few degrees of freedom of a small picture, this corresponds to a significance level of about
        // 0.0001.
        assert!((bias.value - 0.01).abs() < 5.0 * error && bias.value > 10.0 * error, "{bias:?}");
        // All areas have the same bias of 0.01, so the mean square of their biases is 0.01² = 1e-4.
        let square = row(&rows, "bias_squared", variant);
        assert!((square.value - 1e-4).abs() < 0.5e-4, "{square:?}");
        assert!(row(&rows, "bias_squared_p", variant).value < 1e-4);
    }
}

#[test]
fn planted_biases_that_cancel_over_the_picture_are_found() {
    let (rows, checks) = run("bias-chessboard", CHESSBOARD);
    assert!(checks[0].starts_with("- \u{274c} 2 of 2 random rows are biased; "), "{checks:?}");
    for variant in ["near-cliff", "far-cliff"] {
        let [bias, square] = ["bias", "bias_squared"].map(|metric| row(&rows, metric, variant));
        assert!(bias.value.abs() < 0.004 && (square.value - 1e-4).abs() < 0.5e-4, "{bias:?} {square:?}");
        assert!(row(&rows, "bias_squared_p", variant).value < 1e-4);
    }
}

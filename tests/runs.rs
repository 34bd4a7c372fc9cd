//! Tests complete runs of the program `experiments`, including pictures and reports: uninterrupted runs, runs that are killed and resumed, and runs
//! in shards.
//!
//! Most tests use the same small definition and a small scene. They do not check whether the measured values are right; the tests of metrics do that.

use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use experiments::row::Row;
use experiments::store::read_run;

use crate::fixtures::{Folder, failure, program, success};

const TEXT: &str = r#"name = "tiny"
question = "Do interrupted runs and shards give the same results?"
size = [80, 72]
frames = 3
seeds = 2
variants = ["near-cliff", "splat", "auto"]
noises = ["hashed", "white"]
temporal = ["off", "exponential"]
reference = { spp = 32, max_spp = 32 }
times = "none"
video = true
scene = "scene.toml"

[[view]]
name = "cliff-sideways"
camera = "cliff"
motion = "sideways"
step = 0.1

[[expect]]
claim = "White noise flips"
metric = "flip_rate"
where = { noise = "white", variant = "near-cliff", lag = 1 }
range = [0.1, 1.0]
"#;

/// Writes the definition and a scene with small textures. Returns the path of the definition and the folder for results.
fn prepare(folder: &Folder) -> [String; 2] {
    let small = kernels::scene::DEFAULT_TEXT.replace("detail_size = 1024", "detail_size = 64");
    assert_ne!(small, kernels::scene::DEFAULT_TEXT);
    folder.write("scene.toml", &small);
    [folder.write("tiny.toml", TEXT), folder.path("out")]
}

fn bytes(out: &str) -> [Vec<u8>; 2] {
    ["metrics.parquet", "metrics.csv"].map(|name| fs::read(Path::new(out).join("tiny").join(name)).expect("the run wrote its tables"))
}

/// Number of finished parts of an unfinished run.
fn parts(out: &str) -> usize {
    let files = fs::read_dir(Path::new(out).join("tiny").join("parts")).into_iter().flatten().filter_map(Result::ok);
    files.filter(|file| file.path().extension().is_some_and(|e| e == "parquet")).count()
}

/// Starts or resumes a run, and kills it as soon as `is_time` returns true. The argument of `is_time` is the time since the start.
fn kill(definition: &str, out: &str, is_time: impl Fn(Duration) -> bool) {
    let mut child = Command::new(program())
        .args(["run", definition, "--out", out, "--resume"])
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the program can be started");
    let began = Instant::now();
    while !is_time(began.elapsed()) {
        assert!(child.try_wait().expect("a child").is_none(), "the run ended before it could be killed");
        assert!(began.elapsed() < Duration::from_secs(300), "the run makes no progress");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().expect("a child");
    child.wait().expect("a child");
}

/// The result of an uninterrupted run, with which other runs are compared.
struct Whole {
    tables: [Vec<u8>; 2],
    rows: Vec<Row>,
    took: Duration,
}

/// Returns the result of an uninterrupted run. The run is made and checked on the first call.
fn whole() -> &'static Whole {
    static WHOLE: OnceLock<Whole> = OnceLock::new();
    WHOLE.get_or_init(|| run_whole(&Folder::new("whole")))
}

fn run_whole(folder: &Folder) -> Whole {
    let [definition, whole] = prepare(folder);
    let began = Instant::now();
    let said = success(&["run", &definition, "--out", &whole]);
    let took = began.elapsed();
    assert!(said.contains("holds: White noise flips") && said.contains("report.html"), "{said}");
    let tables = bytes(&whole);
    let run = read_run(&Path::new(&whole).join("tiny")).expect("the run is read back");
    assert!(run.complete && run.rows.iter().any(|r| r.metric == "added") && run.rows.iter().all(|r| r.value.is_finite()));
    for name in ["report.html", "report.md", "manifest.json", "reference"] {
        assert!(Path::new(&whole).join("tiny").join(name).exists(), "{name}");
    }
    check_videos(&Path::new(&whole).join("tiny").join("video"));
    // A folder that holds a run is not overwritten, and a run cannot be resumed with a different definition.
    failure(&["run", &definition, "--out", &whole], &["--resume"]);
    fs::write(&definition, TEXT.replace("frames = 3", "frames = 2")).expect("writable");
    failure(&["run", &definition, "--out", &whole, "--resume"], &["frames"]);
    // The same definition cannot be given twice.
    failure(&["run", &definition, &definition, "--out", &folder.path("twice")], &["is given twice"]);
    Whole { tables, rows: run.rows, took }
}

/// The first two of three frames are warm-up, so only the third frame is measured. Its rows must equal the rows of the third frame in a run that
/// measures all frames. With warm-up, the values over all measured frames must equal the values of the third frame.
#[test]
fn frames_that_warm_up_are_drawn_but_not_measured() {
    let folder = Folder::new("warm-up");
    let [definition, out] = prepare(&folder);
    fs::write(&definition, TEXT.replace("frames = 3", "frames = 3\nwarm_up = 2").replace("video = true", "")).expect("writable");
    success(&["run", &definition, "--out", &out]);
    let report = fs::read_to_string(Path::new(&out).join("tiny").join("report.html")).expect("written");
    assert!(report.contains("3, of which the first 2 are not measured"));
    let warmed = read_run(&Path::new(&out).join("tiny")).expect("the run is read back").rows;
    let of_frames = |rows: &[Row]| rows.iter().filter(|row| row.frame == Some(2)).cloned().collect::<Vec<Row>>();
    assert!(warmed.iter().all(|row| row.frame.is_none_or(|frame| frame == 2)), "only the third frame is measured");
    assert_eq!(of_frames(&warmed), of_frames(&whole().rows), "the third frame has seen the same frames before it");
    let mut compared = 0;
    for row in warmed.iter().filter(|row| row.frame.is_none() && row.lag.is_some()) {
        let is_same = |last: &&Row| {
            let Row { frame, value, standard_error, freedom, .. } = (*last).clone();
            frame.is_some() && Row { frame, value, standard_error, freedom, ..row.clone() } == **last
        };
        // Percentiles come from histograms over all frames. There are no rows of single frames with which they could be compared.
        let Some(last) = warmed.iter().find(is_same) else { continue };
        let scale = last.value.abs().max(1e-6);
        assert!((row.value - last.value).abs() < 1e-9 * scale, "{row:?} {last:?}");
        assert_eq!(row.standard_error, None, "one frame has no scatter: {row:?}");
        compared += 1;
    }
    assert!(compared > 100, "{compared}");
}

/// The virtual texture draws no random numbers, so its rows are the same for every noise and are measured once.
#[test]
fn variants_without_random_numbers_have_rows_for_every_noise() {
    let folder = Folder::new("no-noise");
    let [definition, out] = prepare(&folder);
    let text = TEXT.replace("\"near-cliff\", \"splat\", \"auto\"", "\"vt\"").replace("video = true", "");
    let text = &text[..text.find("[[expect]]").expect("the definition has an expectation")];
    fs::write(&definition, text).expect("writable");
    success(&["run", &definition, "--out", &out]);
    let rows = read_run(&Path::new(&out).join("tiny")).expect("the run is read back").rows;
    let of = |noise: &str| -> Vec<Row> {
        rows.iter().filter(|row| row.noise == noise).map(|row| Row { noise: String::new(), ..row.clone() }).collect()
    };
    assert!(of("hashed").len() > 100, "{}", of("hashed").len());
    assert_eq!(of("hashed"), of("white"));
}

/// Checks the PNG sequences and the links that the run wrote. The `judge.txt` of a sequence must contain command lines that compare it with the
/// reference sequence of the same resolve; they are not run here.
fn check_videos(video: &Path) {
    let frame = |sequence: &str, frame: u32, of: &str| fs::read(video.join(sequence).join(format!("{frame:04}.{of}")));
    for resolve in ["off", "exponential"] {
        let (sequence, reference) =
            (format!("sweep-cliff-sideways-fc5-hashed-{resolve}-near-cliff"), format!("reference-cliff-sideways-{resolve}"));
        for name in [&sequence, &reference] {
            assert!((0..3).all(|i| frame(name, i, "png").is_ok()) && frame(name, 3, "png").is_err(), "{name}");
        }
        let judges = fs::read_to_string(video.join(&sequence).join("judge.txt")).expect("written");
        assert!(judges.contains("cvvdp") && judges.contains(&format!("../{reference}/%04d.png")), "{judges}");
    }
    // The resolve `exponential` has no history in the first frame, so it does not change this frame. It must change later frames.
    let resolved =
        |i: u32| ["off", "exponential"].map(|resolve| frame(&format!("reference-cliff-sideways-{resolve}"), i, "png").expect("written"));
    let ([first, first_resolved], [last, last_resolved]) = (resolved(0), resolved(2));
    assert!(first == first_resolved && last != last_resolved);

    // The links of the first frame lead nowhere. Later, most pixels are linked. The camera steps to the right, so links lead to the right
    // or to the same column.
    let (pixels, no_link, no_terrain) = (80 * 72, u32::MAX, u32::MAX - 1);
    let links = |i: u32| -> Vec<u32> {
        let bytes = frame("reference-cliff-sideways-off", i, "links").expect("written");
        bytes.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    };
    assert!(links(0).len() == pixels && links(0).iter().all(|&link| link == no_link || link == no_terrain) && links(0).contains(&no_link));
    let later = links(2);
    let linked: Vec<(usize, usize)> =
        later.iter().enumerate().filter(|(_, link)| **link < no_terrain).map(|(at, link)| (at, *link as usize)).collect();
    let terrain = later.iter().filter(|&&link| link != no_terrain).count();
    assert!(later.len() == pixels && terrain > pixels / 2 && linked.len() * 10 > terrain * 9, "{} of {terrain}", linked.len());
    let moved = |(at, link): &(usize, usize)| (*link % 80).cmp(&(at % 80));
    let [right, left] =
        [std::cmp::Ordering::Greater, std::cmp::Ordering::Less].map(|way| linked.iter().filter(|pair| moved(pair) == way).count());
    // Rock within 13.8 m of the camera moves by more than half a pixel. It covers 7.6 % of the terrain pixels.
    assert!(right > linked.len() / 50 && left == 0, "{right} to the right, {left} to the left, of {}", linked.len());
}

#[test]
fn a_run_is_the_same_killed_and_resumed() {
    let folder = Folder::new("killed");
    let [definition, _] = prepare(&folder);
    let Whole { tables: expected, took, .. } = whole();
    let took = *took;
    // The run is killed four times and resumed each time: while it starts, during its first part, just after that part, and during a later part. The
    // final tables must have the same bytes as those of the uninterrupted run.
    let killed = folder.path("killed");
    let done = || parts(&killed);
    kill(&definition, &killed, |after| after > took / 60);
    kill(&definition, &killed, |after| after > took / 6);
    kill(&definition, &killed, |_| done() >= 1);
    kill(&definition, &killed, |after| after > took / 5);
    success(&["run", &definition, "--out", &killed, "--resume"]);
    assert!(bytes(&killed) == *expected, "the tables differ after kills");

    // If the table of a finished run is damaged, the run is done again. This second run is killed, and its reference picture is damaged. When it is
    // resumed, it must also make the reference again, and the tables must be the same as before.
    let table = Path::new(&killed).join("tiny").join("metrics.parquet");
    fs::write(&table, &expected[0][..expected[0].len() / 2]).expect("writable");
    assert_eq!(done(), 0, "a finished run keeps no parts");
    kill(&definition, &killed, |_| done() >= 1);
    let reference = Path::new(&killed).join("tiny").join("reference").join("reference-cliff-sideways.exr");
    assert!(reference.is_file());
    fs::write(&reference, b"no picture").expect("writable");
    success(&["run", &definition, "--out", &killed, "--resume"]);
    assert!(bytes(&killed) == *expected, "the tables differ after the run was done again");
    assert!(fs::read(&reference).expect("made again").len() > 100, "the reference was not made again");
}

/// A view of the sky cannot be measured. The definition must change, so the error does not offer to continue the run.
#[test]
fn a_view_without_terrain_is_refused() {
    let folder = Folder::new("sky");
    let [definition, out] = prepare(&folder);
    let scene = fs::read_to_string(folder.path("scene.toml")).expect("readable");
    let up = scene.replacen("pitch_deg = 5.0", "pitch_deg = 80.0", 1);
    assert_ne!(up, scene);
    folder.write("scene.toml", &up);
    let output = Command::new(program()).args(["run", &definition, "--out", &out]).output().expect("the program can be started");
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    let last = said.lines().last().unwrap_or_default();
    assert!(last.starts_with("error: ") && last.contains("view `cliff-sideways` shows no terrain in its last frame"), "{said}");
    assert!(last.contains("use another --out") && !last.contains("--resume"), "{said}");
}

#[test]
fn a_run_is_the_same_in_shards() {
    let folder = Folder::new("shards");
    let [definition, _] = prepare(&folder);
    // The shards must be disjoint, and together have the same rows as the whole run.
    let shards = folder.path("shards");
    for shard in ["1/2", "2/2"] {
        success(&["run", &definition, "--out", &shards, "--shard", shard]);
    }
    let together = read_run(&Path::new(&shards).join("tiny")).expect("the shards are read together");
    let mut rows = whole().rows.clone();
    rows.sort_by(Row::order);
    assert!(together.complete && together.rows == rows, "{} rows in shards, {} in one", together.rows.len(), rows.len());

    // A damaged shard is reported.
    let parquet = Path::new(&shards).join("tiny").join("shard-1-of-2").join("metrics.parquet");
    let text = fs::read(&parquet).expect("written");
    fs::write(&parquet, &text[..text.len() / 2]).expect("writable");
    let both = Path::new(&shards).join("tiny").display().to_string();
    failure(&["report", &both], &["metrics.parquet"]);
    // A shard without a manifest is reported.
    fs::remove_file(parquet.with_file_name("manifest.json")).expect("written");
    failure(&["report", &both], &["shard-1-of-2 has no manifest.json"]);
    // A missing shard is reported, and the report of the other shard is still written.
    fs::remove_dir_all(parquet.parent().expect("a folder")).expect("written");
    let report = Command::new(program()).args(["report", &both]).output().expect("the program can be started");
    assert!(report.status.success() && String::from_utf8_lossy(&report.stderr).contains("missing: shard 1/2"), "{report:?}");
}

/// The definition of a run in which terrain nodes arrive late. The camera moves by 150 m per frame.
const LATE: &str = r#"name = "late"
question = "Does a frame of simulated streaming depend on the shard that draws it?"
size = [96, 64]
frames = 4
variants = ["far-atlas"]
noises = ["hashed"]
metrics = ["rmse"]
reference = { spp = 32, max_spp = 32 }
times = "none"
scene = "scene.toml"

[set]
"frame.nodes_per_frame" = 2
"frame.latency" = 1

[vary]
parameter = "frame.residency"
values = ["settled", "scheduled"]

[[view]]
name = "ground-forwards"
camera = "ground"
motion = "forwards"
step = 150.0
"#;

#[test]
fn late_nodes_are_the_same_in_shards_and_count_as_error() {
    let folder = Folder::new("late");
    let [definition, whole] = prepare(&folder);
    fs::write(&definition, LATE).expect("writable");
    success(&["run", &definition, "--out", &whole]);
    let rows = read_run(&Path::new(&whole).join("late")).expect("the run is read back").rows;
    let rmse = |setting: &str| {
        let found: Vec<f64> = rows.iter().filter(|row| row.metric == "rmse" && row.setting == setting).map(|row| row.value).collect();
        assert!(!found.is_empty(), "no rmse of {setting}");
        found
    };
    // The reference has all nodes, so coarse ground is an error of the picture.
    let (settled, scheduled) = (rmse("settled"), rmse("scheduled"));
    assert!(settled.iter().zip(&scheduled).all(|(settled, scheduled)| *scheduled > 1.1 * settled), "{settled:?} {scheduled:?}");
    let shards = folder.path("shards");
    for shard in ["1/2", "2/2"] {
        success(&["run", &definition, "--out", &shards, "--shard", shard]);
    }
    let together = read_run(&Path::new(&shards).join("late")).expect("the shards are read together");
    assert!(together.complete && together.rows == rows, "{} rows in shards, {} in one", together.rows.len(), rows.len());
}

/// Measures pictures that consist of two pixels in one row. The metrics compare every row with the previous frame (lag 1). With earlier frames (lags
/// above 1), they compare only one row in four, a different one in each frame. So the row of these pictures is compared in one of four frames. The
/// other frames have no values for lags above 1.
#[test]
fn what_was_not_followed_is_not_disoccluded_and_errors_come_with_what_they_are_worth() {
    let folder = Folder::new("two-pixels");
    prepare(&folder);
    // The camera looks down from 400 m above the ground, so that both pixels show terrain.
    let scene = kernels::scene::DEFAULT_TEXT.replace("detail_size = 1024", "detail_size = 64")
        + "\n[[camera]]\nname = \"above\"\nposition = [0.0, 0.0, 400.0]\nabove_ground = true\nyaw_deg = 0.0\npitch_deg = -60.0\nfov_deg = 40.0\n";
    folder.write("scene.toml", &scene);
    let text = "name = \"two\"\nquestion = \"Is anything lost standing still?\"\nsize = [2, 1]\nframes = 6\nscene = \"scene.toml\"\n\
        views = [\"above\"]\nvariants = [\"far-cliff\"]\ntimes = \"none\"\nreference = { spp = 32, max_spp = 32 }\n\
        metrics = [\"disoccluded\", \"flip_rate\", \"rmse\"]\n";
    let (definition, out) = (folder.write("two.toml", text), folder.path("out"));
    success(&["run", &definition, "--out", &out]);
    let run = read_run(&Path::new(&out).join("two")).expect("it was just written");
    let of = |metric: &str| run.rows.iter().filter(|r| r.metric == metric).collect::<Vec<_>>();
    let frames = |lag| of("disoccluded").iter().filter(|r| r.lag == Some(lag) && r.frame.is_some()).count();
    assert!(of("disoccluded").iter().all(|r| r.value.abs() < 1e-12), "{:?}", of("disoccluded"));
    assert!(frames(1) == 5 && frames(2) < 4 && frames(2) > 0, "{} and {} frames", frames(1), frames(2));
    assert!(!of("rmse").is_empty() && !of("reference_se").is_empty() && !of("reference_spp").is_empty());
    assert!(of("bias").is_empty() && of("terrain").is_empty());
}

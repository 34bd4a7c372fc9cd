//! `make mutants`: plants faults in shaders, one at a time, and counts those that the tests notice.
//!
//! A mutant is a shader text with one fault ([`mutation`]). The test binary `scree` uses it instead of the embedded text (environment variable
//! `SCREE_MUTANT`), so only the shader is compiled again. First the tests of its stage run, in the order of `strength.toml`. With `--all`, a mutant
//! that passes them is then tested by all tests. A mutant is killed by the first test that fails, by a crash, or by the time limit.
//!
//! `make mutants-rust` does the same for Rust ([`rust_mutants`]).
//!
//! Without arguments, as `cargo test` calls it, this program checks the negative controls of the test suite: a fixed list of mutants that must be
//! killed, and the three shaders of [`SPOILT`].

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitCode, Stdio};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, mpsc};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use clap::Parser;
use indicatif::ProgressBar;
use kernels::base::wgsl::{self, Piece, Wgsl};
use kernels::shared::hash;
use mutation::results::{Outcome, Row, Table, record, summary};
use mutation::{Mutant, mutants};
use naga::valid::{Capabilities, ValidationFlags, Validator};
use serde::Deserialize;

mod mutation;
mod rust_mutants;

#[derive(Clone, Parser)]
#[command(name = "mutants", about = "Plants faults in shaders or in Rust, and counts those that the tests notice")]
struct Args {
    /// Stages whose shaders are changed: folders of kernels/src that contain WGSL
    #[arg(long = "stage", required_unless_present = "rust", conflicts_with = "rust", value_delimiter = ',')]
    stages: Vec<String>,
    /// Rust that is changed: files or folders of kernels/src, such as `shared/noise.rs`, or `references` for all files that strength.toml lists
    #[arg(long, value_delimiter = ',')]
    rust: Vec<String>,
    /// Number of mutants per stage or path; mutants that do not compile are not counted
    #[arg(long, default_value_t = 100)]
    sample: usize,
    /// Seed of the sample
    #[arg(long, default_value_t = 1)]
    seed: u32,
    /// Number of mutants of a stage that are tested at the same time; 0 = one per core
    #[arg(long, default_value_t = 0, conflicts_with = "rust")]
    jobs: usize,
    /// Run all tests on mutants that survive the tests of their stage
    #[arg(long, conflicts_with = "rust")]
    all: bool,
    /// Test mutants again that survived in earlier calls, for example after a test was added
    #[arg(long)]
    again: bool,
    /// Folder of the results; mutants that already have a row there are not tested again
    #[arg(long, default_value = "out/mutants")]
    out: PathBuf,
    /// Folder that receives the table of each stage or path, and the file `strength.csv` with a row for each
    #[arg(long)]
    record: Option<PathBuf>,
    /// Date to write into the rows of `strength.csv`
    #[arg(long, default_value = "")]
    date: String,
}

/// The contents of `strength.toml`.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Strength {
    stage: BTreeMap<String, StageTests>,
    references: References,
    #[serde(default)]
    equivalent: Vec<Equivalent>,
    control: Vec<Control>,
}

/// The tests of a stage: groups of name filters for the test binary, in order of cost, the cheapest group first.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StageTests {
    tests: Vec<Vec<String>>,
    /// For some shader files, by path: name filters of the tests that check the file most directly. These tests run before the groups.
    #[serde(default)]
    first: BTreeMap<String, Vec<String>>,
}

/// The Rust files that `make mutants-rust` changes if its variable `FILE` is not set.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct References {
    /// Files and folders of kernels/src.
    files: Vec<String>,
}

/// Mutants of one line that compute the same results as the original for every input that can occur.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Equivalent {
    /// A shader by its path in kernels/src, or a Rust file by its path from the root.
    file: String,
    /// The line of the original text, without leading and trailing spaces.
    line: String,
    /// The changes of this line that are equivalent, written as in the column `change` of the results. A change without the
    /// number of an occurrence stands for all its occurrences in the line; `*` stands for every change of the line.
    changes: Vec<String>,
    /// Why no test can notice the change.
    reason: String,
}

impl Strength {
    /// Returns the reason why a mutant is equivalent; `None` if it is not listed as equivalent. `line`: the text of the changed line, without leading
    /// and trailing spaces. `changes`: the description of the change, with and without the number of the occurrence.
    fn reason(&self, file: &str, line: &str, changes: [&str; 2]) -> Option<&str> {
        let is_it = |known: &&Equivalent| {
            let is_known = |change: &String| change == "*" || changes.contains(&change.as_str());
            known.file == file && known.line == line && known.changes.iter().any(is_known)
        };
        self.equivalent.iter().find(is_it).map(|known| known.reason.as_str())
    }
}

/// A mutant that the named test must notice.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Control {
    file: String,
    line: String,
    change: String,
    test: String,
}

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let is_run = |argument: &String| ["--stage", "--rust", "--help"].iter().any(|name| argument.starts_with(name));
    let result = if arguments.iter().any(is_run) {
        run(&Args::parse())
    } else if arguments.is_empty() || arguments.iter().all(|argument| argument == "mutants" || argument.starts_with("--test-threads")) {
        controls()
    } else {
        // An argument of `cargo test` selects tests by name. These tests are in other test binaries, so there is nothing to run here.
        Ok(())
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("mutants: {error:#}");
            ExitCode::FAILURE
        }
    }
}

fn strength() -> Result<Strength> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("strength.toml");
    let text = fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
    toml::from_str(&text).with_context(|| file.display().to_string())
}

/// Returns every WGSL file once, sorted by path.
fn files() -> Vec<&'static Wgsl> {
    let mut files = kernels::frame::shader_files();
    for module in [&kernels::temporal::MODULE, &kernels::metrics::MODULE, &kernels::metrics::SEEDS_MODULE] {
        files.extend(module.files());
    }
    files.extend(kernels::shared::WGSL);
    files.sort_by_key(|file| file.path);
    files.dedup_by_key(|file| file.path);
    files
}

fn stage_of(file: &Wgsl) -> &'static str {
    file.path.split('/').next().unwrap_or(file.path)
}

/// Whether a shader module that consists of a changed file and the files that it needs is valid. `text` is the changed text of `file`. Whether the
/// module fits the pipelines of its stage is not checked here, but when a test builds these pipelines.
fn compiles(file: &'static Wgsl, text: &str) -> bool {
    let mut pieces = wgsl::pieces(&[file]);
    for piece in pieces.iter_mut().filter(|piece| piece.path == file.path) {
        *piece = Piece::new(file.path, text);
    }
    let capabilities = Capabilities::SHADER_FLOAT16_IN_FLOAT32 | Capabilities::SUBGROUP;
    naga::front::wgsl::parse_str(&wgsl::joined(&pieces))
        .is_ok_and(|module| Validator::new(ValidationFlags::all(), capabilities).validate(&module).is_ok())
}

/// Returns the path of the test binary `scree`, the newest one in the folder of this program.
fn test_binary() -> Result<PathBuf> {
    let folder = std::env::current_exe()?.parent().context("the program lies in a folder")?.to_owned();
    let newest = fs::read_dir(&folder)?
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("scree-")))
        .filter(|path| path.extension().is_none_or(|extension| extension == "exe"))
        .filter_map(|path| Some((fs::metadata(&path).and_then(|data| data.modified()).ok()?, path)))
        .max();
    let (_, path) = newest.with_context(|| format!("{} holds no test binary scree: run `make mutants`", folder.display()))?;
    Ok(path)
}

/// Runs tests, with or without a mutant.
struct Runner {
    binary: PathBuf,
    /// Temporary folder for the shader texts of mutants.
    scratch: PathBuf,
}

/// Whether Ctrl-C was pressed. Ctrl-C also ends the test process that is running, and this must not count as a failed test.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);

fn check_interrupted() -> Result<()> {
    ensure!(
        !INTERRUPTED.load(Ordering::SeqCst),
        "stopped by Ctrl-C: mutants that were finished are kept; run the same command to continue"
    );
    Ok(())
}

/// How a run of tests ended.
#[derive(Debug)]
enum End {
    Passed,
    Failed(String),
    Hung,
}

impl Runner {
    fn new() -> Result<Runner> {
        let scratch = std::env::temp_dir().join(format!("scree-mutants-{}", std::process::id()));
        fs::create_dir_all(&scratch)?;
        Ok(Runner { binary: test_binary()?, scratch })
    }

    /// Runs the tests that match the filters until one fails. Returns how the run ended, and the number of tests that passed. `mutant`: a folder that
    /// contains the changed text under the path of its file; `None` = no mutant.
    fn tests(&self, mutant: Option<&Path>, filters: &[String], threads: usize, limit: Duration) -> Result<(End, usize)> {
        let mut command = Command::new(&self.binary);
        command.args(filters).arg(format!("--test-threads={threads}")).current_dir(env!("CARGO_MANIFEST_DIR"));
        command.env("LP_NUM_THREADS", threads.to_string()).env("RUST_BACKTRACE", "0");
        match mutant {
            Some(folder) => command.env("SCREE_MUTANT", folder),
            None => command.env_remove("SCREE_MUTANT"),
        };
        watch(command, limit)
    }

    /// Writes the text of a mutant to a folder, calls `then` with this folder, and removes the folder.
    fn planted<T>(&self, worker: usize, file: &Wgsl, text: &str, then: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
        let folder = self.scratch.join(worker.to_string());
        let place = folder.join(file.path);
        fs::create_dir_all(place.parent().context("a file lies in a folder")?)?;
        fs::write(&place, text)?;
        let result = then(&folder);
        fs::remove_dir_all(&folder)?;
        result
    }
}

impl Drop for Runner {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.scratch);
    }
}

/// Starts a test binary, and waits until a test fails, the binary ends, or the time limit is reached. Returns how the run ended, and the number of
/// tests that passed.
fn watch(mut command: Command, limit: Duration) -> Result<(End, usize)> {
    let mut child = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().context("the test binary cannot be started")?;
    let lines = lines_of(&mut child);
    let began = Instant::now();
    let mut passed = 0;
    let end = loop {
        match lines.recv_timeout(limit.saturating_sub(began.elapsed())) {
            Ok(line) if line.ends_with(" ... ok") => passed += 1,
            Ok(line) if line.ends_with(" ... FAILED") => {
                break Some(End::Failed(line.trim_start_matches("test ").trim_end_matches(" ... FAILED").to_owned()));
            }
            Ok(_) => {}
            Err(mpsc::RecvTimeoutError::Timeout) => break Some(End::Hung),
            Err(mpsc::RecvTimeoutError::Disconnected) => break None,
        }
    };
    if let Some(end) = end {
        // The process is killed, because it may be stuck in the GPU driver. This also releases its device.
        let _ = child.kill();
        child.wait()?;
        check_interrupted()?;
        return Ok((end, passed));
    }
    let status = child.wait()?;
    check_interrupted()?;
    Ok(if status.success() { (End::Passed, passed) } else { (End::Failed(format!("the tests ended with {status}")), passed) })
}

/// Returns a channel that delivers the lines that a process writes to its standard output.
fn lines_of(child: &mut Child) -> mpsc::Receiver<String> {
    let (to, lines) = mpsc::channel();
    if let Some(output) = child.stdout.take() {
        std::thread::spawn(move || BufReader::new(output).lines().map_while(Result::ok).try_for_each(|line| to.send(line)));
    }
    lines
}

/// Tests the fixed mutants of `strength.toml`: each must be noticed by its test. Then runs a test on each shader of [`SPOILT`].
fn controls() -> Result<()> {
    let controls = strength()?.control;
    ensure!(!controls.is_empty(), "strength.toml has no [[control]]");
    let runner = Runner::new()?;
    let mut missed = Vec::new();
    println!("\nrunning {} negative controls: mutants that a test must notice", controls.len());
    for control in &controls {
        let file = *files().iter().find(|file| file.path == control.file).with_context(|| format!("there is no {}", control.file))?;
        let found = mutants(file.text)
            .into_iter()
            .find(|mutant| line_text(file, mutant) == control.line && mutant.change(file.text) == control.change);
        let mutant = found.with_context(|| format!("{}: `{}` has no mutant {}", control.file, control.line, control.change))?;
        let filter = [control.test.clone()];
        let (end, _) =
            runner.planted(0, file, &mutant.apply(file.text), |folder| runner.tests(Some(folder), &filter, 2, Duration::from_secs(120)))?;
        let noticed = matches!(end, End::Failed(_));
        println!("control {}:{} {} ... {}", control.file, mutant.line, control.change, if noticed { "noticed" } else { "MISSED" });
        if !noticed {
            missed.push(format!("{}:{} {} by {}", control.file, mutant.line, control.change, control.test));
        }
    }
    ensure!(missed.is_empty(), "mutants that no test noticed: {}", missed.join("; "));
    for Spoilt { what, lines, is_expected } in &SPOILT {
        let file = *files().iter().find(|file| file.path == SPOILT_FILE).with_context(|| format!("there is no {SPOILT_FILE}"))?;
        ensure!(file.text.contains(SPOILT_LINE), "{SPOILT_FILE} does not contain `{SPOILT_LINE}`");
        let text = file.text.replace(SPOILT_LINE, &format!("{lines}\n    {SPOILT_LINE}"));
        ensure!(compiles(file, &text), "the shader that {what} does not compile");
        let (end, _) = runner.planted(0, file, &text, |folder| runner.tests(Some(folder), &[SPOILT_TEST.to_owned()], 2, SPOILT_LIMIT))?;
        println!("a shader that {what} ... {end:?}");
        ensure!(is_expected(&end), "a shader that {what}: the run of tests must not end with {end:?}");
    }
    Ok(())
}

/// A fault of a shader that is worse than a wrong number, such as an endless loop.
struct Spoilt {
    what: &'static str,
    /// The WGSL that causes the fault. It is inserted before [`SPOILT_LINE`].
    lines: &'static str,
    /// Whether the argument is the end that the run of tests must have.
    is_expected: fn(&End) -> bool,
}

const SPOILT: [Spoilt; 3] = [
    Spoilt {
        what: "does not end",
        // Software Vulkan ends a loop after 65 535 iterations, so two loops are nested.
        lines: "var spin = 0u;
    for (var i = 0u; i < 0xffffffffu; i++) {
        for (var j = 0u; j < 0xffffffffu; j++) { spin = spin * 1664525u + j; }
        if spin == 1u { break; }
    }
    if spin == 7u { return; }",
        is_expected: |end| matches!(end, End::Hung),
    },
    Spoilt {
        what: "computes NaN",
        lines: "distances[motion.slot + first * frame.size.x + x] = sqrt(f32(first) - 1000000.0);",
        is_expected: |end| matches!(end, End::Failed(_)),
    },
    Spoilt {
        what: "writes outside a buffer",
        lines: "links[id.x * 1000003u + 40000000u] = 1u;",
        // The device must discard the write, so that it affects no other test.
        is_expected: |end| matches!(end, End::Passed),
    },
];
const SPOILT_FILE: &str = "motion/motion.wgsl";
const SPOILT_LINE: &str = "let row = motion_row_of_quarter(first, motion.quarter);";
const SPOILT_TEST: &str = "motion::links";
const SPOILT_LIMIT: Duration = Duration::from_secs(20);

fn line_text<'t>(file: &'t Wgsl, mutant: &Mutant) -> &'t str {
    file.text.lines().nth(mutant.line - 1).unwrap_or_default().trim()
}

fn run(args: &Args) -> Result<()> {
    let strength = strength()?;
    // Relative paths are relative to the root of the project, although cargo starts tests in the folder of their crate.
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let args = &Args { out: root.join(&args.out), record: args.record.as_ref().map(|folder| root.join(folder)), ..args.clone() };
    fs::create_dir_all(&args.out).with_context(|| format!("cannot make the folder {}", args.out.display()))?;
    ensure!(args.sample > 0, "--sample is 0: give at least 1");
    ctrlc::set_handler(|| INTERRUPTED.store(true, Ordering::SeqCst)).context("cannot install a handler for Ctrl-C")?;
    if !args.rust.is_empty() {
        return rust_mutants::run(args, &strength, &root);
    }
    let known: Vec<&str> = strength.stage.keys().map(String::as_str).collect();
    let all = files();
    for stage in &args.stages {
        ensure!(all.iter().any(|file| stage_of(file) == stage), "`{stage}` contains no WGSL files; the stages are {}", known.join(", "));
        ensure!(
            strength.stage.get(stage).is_some_and(|tests| tests.tests.iter().any(|group| !group.is_empty())),
            "stage `{stage}` has no tests: add [stage.{stage}] to tests/strength.toml"
        );
    }
    let runner = Runner::new()?;
    for stage in &args.stages {
        let began = Instant::now();
        let rows = one_stage(args, &strength, &runner, stage)?;
        let seconds = began.elapsed().as_secs_f64();
        print!("{}", summary(stage, &rows, seconds));
        if let Some(folder) = &args.record {
            record(folder, stage, &args.date, args.seed, &rows)?;
        }
    }
    Ok(())
}

/// Returns the sort key of a mutant. These keys bring the mutants of a stage or path into a random order.
fn order(seed: u32, index: usize) -> u32 {
    hash::pcg4d([seed, u32::try_from(index).unwrap_or(u32::MAX), 17, 29])[0]
}

/// Opens the table of a stage or path. Returns the table, and the rows of the mutants that need not be tested again, by the hash of their text.
fn earlier(args: &Args, name: &str) -> Result<(Table, BTreeMap<String, Row>)> {
    let (table, rows) = Table::open(&args.out.join(format!("{name}-{}.csv", args.seed)))?;
    let is_kept = |row: &Row| !(args.again && row.outcome == Outcome::Survived);
    Ok((table, rows.into_iter().filter(is_kept).map(|row| (row.text.clone(), row)).collect()))
}

fn hash_of(text: &str) -> String {
    format!("{:016x}", twox_hash::XxHash64::oneshot(0, text.as_bytes()))
}

fn one_stage(args: &Args, strength: &Strength, runner: &Runner, stage: &str) -> Result<Vec<Row>> {
    let groups = &strength.stage[stage].tests;
    let jobs = if args.jobs == 0 { std::thread::available_parallelism()?.get() } else { args.jobs };
    let (table, known) = earlier(args, stage)?;

    let first = &strength.stage[stage].first;
    let limits = Limits { runner, stage, jobs, known: Mutex::default() };

    let mut candidates: Vec<(&'static Wgsl, Mutant)> = files()
        .into_iter()
        .filter(|file| stage_of(file) == stage)
        .flat_map(|file| mutants(file.text).into_iter().map(move |mutant| (file, mutant)))
        .collect();
    let total = candidates.len();
    let mut keyed: Vec<_> = candidates.drain(..).enumerate().map(|(index, candidate)| (order(args.seed, index), candidate)).collect();
    keyed.sort_by_key(|(key, (file, mutant))| (*key, file.path, mutant.range.start));
    let mut rows = Vec::new();
    let mut jobs_left = Vec::new();
    let mut compiled = 0;
    for (_, (file, mutant)) in keyed {
        if compiled == args.sample {
            break;
        }
        let text = mutant.apply(file.text);
        let row = |outcome, by: &str| Row {
            file: file.path.to_owned(),
            line: mutant.line,
            operator: mutant.operator.to_owned(),
            change: mutant.change(file.text),
            outcome,
            by: by.to_owned(),
            seconds: 0.0,
            text: hash_of(&text),
        };
        if !compiles(file, &text) {
            rows.push(row(Outcome::NotCompiled, ""));
            continue;
        }
        compiled += 1;
        let change = mutant.change(file.text);
        let line = line_text(file, &mutant);
        let fresh = row(Outcome::Survived, "");
        match (strength.reason(file.path, line, [&change, &mutant.any_occurrence(file.text)]), known.get(&fresh.text)) {
            (Some(reason), _) => rows.push(row(Outcome::Equivalent, reason)),
            (None, Some(done)) => rows.push(Row { line: mutant.line, ..done.clone() }),
            (None, None) => jobs_left.push((file, text, fresh)),
        }
    }
    eprintln!("{stage}: {total} mutants, {compiled} sampled, {} to run", jobs_left.len());

    let bar = ProgressBar::new(jobs_left.len() as u64);
    let next = AtomicUsize::new(0);
    let done = Mutex::new(rows);
    let table = Mutex::new(table);
    let work = |worker: usize| -> Result<()> {
        while let Some((file, text, fresh)) = jobs_left.get(next.fetch_add(1, Ordering::Relaxed)) {
            let began = Instant::now();
            let groups: Vec<&[String]> = first.get(file.path).into_iter().chain(groups).map(Vec::as_slice).collect();
            let (outcome, by) = runner.planted(worker, file, text, |folder| verdict(folder, &groups, &limits, args.all))?;
            let row = Row { outcome, by, seconds: began.elapsed().as_secs_f64(), ..fresh.clone() };
            if outcome == Outcome::Survived {
                bar.suspend(|| println!("survived: {}:{} {} ({})", row.file, row.line, row.change, row.operator));
            }
            table.lock().unwrap_or_else(PoisonError::into_inner).add(&row)?;
            done.lock().unwrap_or_else(PoisonError::into_inner).push(row);
            bar.inc(1);
        }
        Ok(())
    };
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..jobs).map(|worker| scope.spawn(move || work(worker))).collect();
        workers.into_iter().try_for_each(|worker| worker.join().expect("no panic"))
    })?;
    bar.finish_and_clear();
    let mut rows = done.into_inner().unwrap_or_else(PoisonError::into_inner);
    rows.sort_by(|a, b| (&a.file, a.line, &a.change).cmp(&(&b.file, b.line, &b.change)));
    Ok(rows)
}

/// The time limits of the groups of a stage. A group has an entry once its tests have passed without a mutant. Groups that no mutant reaches take no
/// time.
struct Limits<'s> {
    runner: &'s Runner,
    stage: &'s str,
    /// Number of tests that run at the same time without a mutant.
    jobs: usize,
    known: Mutex<BTreeMap<Vec<String>, Duration>>,
}

impl Limits<'_> {
    /// The time limit of a group.
    ///
    /// # Errors
    /// Without a mutant, no test matches the group, or a test of the group fails.
    fn of(&self, group: &[String]) -> Result<Duration> {
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(&limit) = known.get(group) {
            return Ok(limit);
        }
        let (stage, began) = (self.stage, Instant::now());
        let (end, passed) = self.runner.tests(None, group, self.jobs, Duration::from_secs(1200))?;
        match end {
            End::Passed if passed > 0 => {}
            End::Passed => bail!("stage `{stage}`: no test matches {}", group.join(" ")),
            End::Failed(test) => bail!("stage `{stage}` fails without a mutant: {test}"),
            End::Hung => bail!("stage `{stage}`: more than 20 minutes for the tests {}", group.join(" ")),
        }
        let limit = Duration::from_secs(60) + began.elapsed() * 8;
        known.insert(group.to_vec(), limit);
        Ok(limit)
    }
}

/// Tests a mutant with the groups in their order, and then with all tests if `all` is true. Stops at the first group that does not pass.
fn verdict(folder: &Path, groups: &[&[String]], limits: &Limits<'_>, all: bool) -> Result<(Outcome, String)> {
    let everything: Option<&[String]> = all.then_some(&[]);
    for group in groups.iter().copied().chain(everything) {
        let limit = if group.is_empty() { Duration::from_secs(3600) } else { limits.of(group)? };
        match limits.runner.tests(Some(folder), group, 1, limit)?.0 {
            End::Passed => {}
            End::Failed(test) => return Ok((Outcome::Killed, test)),
            End::Hung => return Ok((Outcome::Hung, format!("time limit of {} s", limit.as_secs()))),
        }
    }
    Ok((Outcome::Survived, String::new()))
}

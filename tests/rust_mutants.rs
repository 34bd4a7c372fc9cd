//! `make mutants-rust`: plants faults in the Rust of `kernels`, one at a time, and counts those that the tests of the references notice.
//!
//! cargo-mutants lists the mutants ([`listed`]). It could also run them, but each of its calls copies the sources to a new folder and compiles every
//! dependency there, which takes minutes. Here the copy and its compiled dependencies are kept in `target/mutants`, so a mutant costs one incremental
//! build. The sources of the project are never changed, so an interrupted call leaves no fault in them.
//!
//! A mutant is judged by the test binary `references`. If all its tests pass, and the folder of the mutated file has unit tests, these unit tests
//! also run. None of these tests needs a graphics adapter.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ffi::OsString;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail, ensure};
use indicatif::ProgressBar;
use serde_json::Value;

use crate::mutation::listed::{Listed, listed};
use crate::mutation::results::{Outcome, Row, record, summary};
use crate::{Args, End, Strength, check_interrupted, earlier, hash_of, order, watch};

/// The folder of the sources that are changed, as a path from the root of the project.
const SOURCES: &str = "kernels/src";
/// What the copy of the project contains: the workspace and its members.
const COPIED: [&str; 6] = ["Cargo.toml", "Cargo.lock", "kernels", "experiments", "workbench", "tests"];
/// The name that stands for all files of the table `references` in `strength.toml`.
const ALL: &str = "references";

/// Plants faults in each path of `args.rust`.
pub(crate) fn run(args: &Args, strength: &Strength, root: &Path) -> Result<()> {
    let root = &root.canonicalize().with_context(|| format!("cannot find {}", root.display()))?;
    let tree = Tree::new(root)?;
    let mut judges = Judges::default();
    for path in &args.rust {
        let began = Instant::now();
        let files = if path == ALL { strength.references.files.clone() } else { vec![path.clone()] };
        let globs = files.iter().map(|file| glob(root, file)).collect::<Result<Vec<_>>>()?;
        let name = format!("rust-{}", inside(path).trim_end_matches(".rs").replace('/', "-"));
        let rows = one_path(args, strength, &tree, &mut judges, &name, &list(root, &globs)?)?;
        print!("{}", summary(&name, &rows, began.elapsed().as_secs_f64()));
        if let Some(folder) = &args.record {
            record(folder, &name, &args.date, args.seed, &rows)?;
        }
    }
    Ok(())
}

/// Returns a path relative to [`SOURCES`], without a slash at the end. A path that does not begin with [`SOURCES`] is taken as relative to it.
fn inside(path: &str) -> &str {
    path.strip_prefix(SOURCES).map_or(path, |path| path.trim_start_matches('/')).trim_end_matches('/')
}

/// Returns the glob pattern that selects a file, or all files in a folder.
fn glob(root: &Path, path: &str) -> Result<String> {
    let path = inside(path);
    let place = root.join(SOURCES).join(path);
    ensure!(
        place.exists() && !path.is_empty(),
        "`{path}` is neither a file nor a folder of {SOURCES}: give one, such as `shared/noise.rs`"
    );
    Ok(if place.is_dir() { format!("{SOURCES}/{path}/**/*.rs") } else { format!("{SOURCES}/{path}") })
}

/// Returns the mutants of the files that match the patterns.
fn list(root: &Path, globs: &[String]) -> Result<Vec<Listed>> {
    let program = root.join("target/tools/bin").join(format!("cargo-mutants{}", std::env::consts::EXE_SUFFIX));
    ensure!(program.is_file(), "{} is missing: run `make mutants-rust`, which installs it", program.display());
    let mut command = Command::new(&program);
    command.args(["mutants", "--list", "--json", "--no-config", "--package", "kernels", "--dir"]).arg(root);
    for glob in globs {
        command.args(["--file", glob.as_str()]);
    }
    let output = command.stderr(Stdio::inherit()).output().with_context(|| format!("cannot start {}", program.display()))?;
    check_interrupted()?;
    ensure!(output.status.success(), "cargo-mutants ended with {}", output.status);
    let all = listed(&String::from_utf8(output.stdout)?)?;
    ensure!(!all.is_empty(), "cargo-mutants finds nothing to change in {}", globs.join(", "));
    Ok(all)
}

fn one_path(args: &Args, strength: &Strength, tree: &Tree, judges: &mut Judges, name: &str, all: &[Listed]) -> Result<Vec<Row>> {
    let (mut table, known) = earlier(args, name)?;
    let mut keyed: Vec<(u32, usize)> = (0..all.len()).map(|index| (order(args.seed, index), index)).collect();
    keyed.sort_unstable();
    let wanted = args.sample.min(all.len());
    eprintln!("{name}: {} mutants, {wanted} sampled", all.len());
    let bar = ProgressBar::new(wanted as u64);
    let mut originals: BTreeMap<&str, String> = BTreeMap::new();
    let mut rows: Vec<Row> = Vec::new();
    let mut compiled = 0;
    for (_, index) in keyed {
        if compiled == wanted {
            break;
        }
        let mutant = &all[index];
        let original: &str = match originals.entry(&mutant.file) {
            Entry::Occupied(known) => known.into_mut(),
            Entry::Vacant(place) => place.insert(tree.original(&mutant.file)?),
        };
        let text = mutant.apply(original)?;
        let fresh = Row {
            file: mutant.file.clone(),
            line: mutant.line(),
            operator: mutant.genre.clone(),
            change: mutant.change(),
            outcome: Outcome::Survived,
            by: String::new(),
            seconds: 0.0,
            text: hash_of(&text),
        };
        let line = original.lines().nth(mutant.line() - 1).unwrap_or_default().trim();
        let reason = strength.reason(&mutant.file, line, [&mutant.change(), &mutant.any_occurrence()]);
        let row = match (reason, known.get(&fresh.text)) {
            (Some(reason), _) => Row { outcome: Outcome::Equivalent, by: reason.to_owned(), ..fresh },
            (None, Some(done)) => Row { line: fresh.line, ..done.clone() },
            (None, None) => {
                let began = Instant::now();
                let (outcome, by) = judges.judge(tree, &mutant.file, original, &text)?;
                let row = Row { outcome, by, seconds: began.elapsed().as_secs_f64(), ..fresh };
                if outcome == Outcome::Survived {
                    bar.suspend(|| println!("survived: {}:{} {} ({})", row.file, row.line, row.change, row.operator));
                }
                table.add(&row)?;
                row
            }
        };
        // Mutants that do not compile do not count towards the sample. Whether a mutant compiles is known only after its build.
        if row.outcome != Outcome::NotCompiled {
            compiled += 1;
            bar.inc(1);
        }
        rows.push(row);
    }
    bar.finish_and_clear();
    rows.sort_by(|a, b| (&a.file, a.line, &a.change).cmp(&(&b.file, b.line, &b.change)));
    Ok(rows)
}

/// A group of tests that judges mutants.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord)]
enum Judge {
    /// The test binary `references`.
    References,
    /// The unit tests in a folder of `kernels/src`.
    Units(String),
}

impl fmt::Display for Judge {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Judge::References => f.write_str("the test binary `references`"),
            Judge::Units(folder) => write!(f, "the unit tests of `{folder}`"),
        }
    }
}

/// The time limits of the judges. A judge has an entry once its tests have passed without a mutant.
#[derive(Default)]
struct Judges(BTreeMap<Judge, Duration>);

impl Judges {
    /// Judges a mutant of a file. Returns the outcome, and the test or the time limit that decided it. Restores the original file in the copy.
    fn judge(&mut self, tree: &Tree, file: &str, original: &str, text: &str) -> Result<(Outcome, String)> {
        let mut judges = vec![Judge::References];
        let folder = file.trim_start_matches(SOURCES).trim_start_matches('/').split(['/', '.']).next().unwrap_or_default();
        if tree.has_unit_tests(folder)? {
            judges.push(Judge::Units(folder.to_owned()));
        }
        for judge in &judges {
            self.limit(tree, judge)?;
        }
        tree.write(file, text)?;
        let verdict = self.verdict(tree, &judges);
        tree.write(file, original)?;
        verdict
    }

    fn verdict(&self, tree: &Tree, judges: &[Judge]) -> Result<(Outcome, String)> {
        for judge in judges {
            let Some(binary) = tree.build(judge, false)? else { return Ok((Outcome::NotCompiled, String::new())) };
            let limit = self.0.get(judge).copied().context("a judge has a time limit")?;
            match tree.tests(&binary, judge, limit)?.0 {
                End::Passed => {}
                End::Failed(test) => return Ok((Outcome::Killed, test)),
                End::Hung => return Ok((Outcome::Hung, format!("time limit of {} s", limit.as_secs()))),
            }
        }
        Ok((Outcome::Survived, String::new()))
    }

    /// Checks that the tests of a judge pass without a mutant, and derives their time limit from the time that they take. Each judge is checked once.
    fn limit(&mut self, tree: &Tree, judge: &Judge) -> Result<()> {
        if self.0.contains_key(judge) {
            return Ok(());
        }
        eprintln!("compiling {judge} without a mutant; the first compilation takes minutes");
        let binary = tree.build(judge, true)?.with_context(|| format!("{judge}: the sources do not compile without a mutant"))?;
        let began = Instant::now();
        match tree.tests(&binary, judge, Duration::from_secs(1200))? {
            (End::Passed, passed) if passed > 0 => {}
            (End::Passed, _) => bail!("{judge}: no test ran"),
            (End::Failed(test), _) => bail!("{judge}: a test fails without a mutant: {test}"),
            (End::Hung, _) => bail!("{judge}: more than 20 minutes without a mutant"),
        }
        self.0.insert(judge.clone(), Duration::from_secs(60) + began.elapsed() * 8);
        Ok(())
    }
}

/// A copy of the project, and the folder into which it is compiled.
struct Tree {
    sources: PathBuf,
    target: PathBuf,
    cargo: OsString,
}

impl Tree {
    /// Copies what cargo needs of the project, or brings an earlier copy up to date.
    fn new(root: &Path) -> Result<Tree> {
        let folder = root.join("target/mutants");
        let tree = Tree {
            sources: folder.join("tree"),
            target: folder.join("build"),
            cargo: std::env::var_os("CARGO").unwrap_or_else(|| OsString::from("cargo")),
        };
        fs::create_dir_all(&tree.sources).with_context(|| format!("cannot make the folder {}", tree.sources.display()))?;
        for name in COPIED {
            mirror(&root.join(name), &tree.sources.join(name))
                .with_context(|| format!("cannot copy {name} to {}", tree.sources.display()))?;
        }
        Ok(tree)
    }

    fn original(&self, file: &str) -> Result<String> {
        let place = self.sources.join(file);
        fs::read_to_string(&place).with_context(|| format!("cannot read {}", place.display()))
    }

    fn write(&self, file: &str, text: &str) -> Result<()> {
        let place = self.sources.join(file);
        fs::write(&place, text).with_context(|| format!("cannot write {}", place.display()))
    }

    /// Whether a folder of `kernels/src`, or the file of this name, has unit tests.
    fn has_unit_tests(&self, folder: &str) -> Result<bool> {
        let place = self.sources.join(SOURCES).join(folder);
        if !place.is_dir() {
            return has_unit_tests(&place.with_extension("rs"));
        }
        has_unit_tests(&place)
    }

    /// Compiles the tests of a judge. Returns the path of the test binary; `None` if the sources of the project do not compile.
    ///
    /// # Errors
    /// If cargo fails for another reason, such as a full disk.
    fn build(&self, judge: &Judge, shows_progress: bool) -> Result<Option<PathBuf>> {
        let mut command = Command::new(&self.cargo);
        // Both packages are always selected, so that their dependencies have the same features and are compiled once.
        command.args(["test", "--no-run", "--locked", "--profile", "references", "--package", "references", "--package", "kernels"]);
        match judge {
            Judge::References => command.args(["--test", "references"]),
            Judge::Units(_) => command.arg("--lib"),
        };
        // The Makefile sets RUSTC_WORKSPACE_WRAPPER to a script that turns lints into errors. The variable is removed here, because a mutant may
        // cause a lint, such as an unused argument, and must compile nevertheless.
        command.args(["--message-format", "json"]).current_dir(&self.sources).env("CARGO_TARGET_DIR", &self.target);
        command.env_remove("RUSTC_WORKSPACE_WRAPPER").stderr(if shows_progress { Stdio::inherit() } else { Stdio::piped() });
        let output = command.output().context("cannot start cargo")?;
        check_interrupted()?;
        let messages: Vec<Value> = String::from_utf8_lossy(&output.stdout).lines().filter_map(|l| serde_json::from_str(l).ok()).collect();
        if output.status.success() {
            let binary = messages.iter().rev().find_map(|message| message["executable"].as_str());
            return Ok(Some(PathBuf::from(binary.with_context(|| format!("{judge}: cargo names no executable file"))?)));
        }
        let is_of_code = |message: &Value| {
            let message = &message["message"];
            message["level"] == "error" && message["spans"].as_array().is_some_and(|spans| !spans.is_empty())
        };
        let errors = String::from_utf8_lossy(&output.stderr);
        let last = errors.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or("its messages are above");
        ensure!(messages.iter().any(is_of_code), "cargo fails, although it finds no error in the code: {last}");
        Ok(None)
    }

    /// Runs the tests of a judge. Returns how the run ended, and the number of tests that passed.
    fn tests(&self, binary: &Path, judge: &Judge, limit: Duration) -> Result<(End, usize)> {
        let mut command = Command::new(binary);
        match judge {
            // The module `statistics` is a part of `experiments`. Its tests are skipped, because they test nothing in `kernels`.
            Judge::References => command.args(["--skip", "statistics::"]).current_dir(self.sources.join("tests/references")),
            Judge::Units(folder) => command.arg(format!("{folder}::")).current_dir(self.sources.join("kernels")),
        };
        command.env("RUST_BACKTRACE", "0");
        watch(command, limit)
    }
}

/// Whether a file, or a file in a folder, has unit tests.
fn has_unit_tests(place: &Path) -> Result<bool> {
    if place.is_dir() {
        for entry in fs::read_dir(place)? {
            if has_unit_tests(&entry?.path())? {
                return Ok(true);
            }
        }
        return Ok(false);
    }
    Ok(place.extension().is_some_and(|extension| extension == "rs") && fs::read_to_string(place)?.contains("#[cfg(test)]"))
}

/// Makes `to` a copy of the file or folder `from`. A file that is already equal keeps its modification time, so that cargo does not compile it again.
fn mirror(from: &Path, to: &Path) -> Result<()> {
    if !from.is_dir() {
        let bytes = fs::read(from)?;
        if fs::read(to).ok().as_ref() != Some(&bytes) {
            fs::write(to, bytes)?;
        }
        return Ok(());
    }
    fs::create_dir_all(to)?;
    for entry in fs::read_dir(to)? {
        let entry = entry?;
        if !from.join(entry.file_name()).exists() {
            let place = entry.path();
            if place.is_dir() { fs::remove_dir_all(place)? } else { fs::remove_file(place)? }
        }
    }
    for entry in fs::read_dir(from)? {
        let name = entry?.file_name();
        mirror(&from.join(&name), &to.join(&name))?;
    }
    Ok(())
}

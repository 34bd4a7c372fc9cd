//! `check`: runs the small version of experiments and compares the results with the expectations of their definitions. It is meant for continuous
//! integration.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use super::print;
use super::run::each;
use crate::cli::CheckArgs;
use crate::definition::Definition;
use crate::expectations::{self, Verdict};
use crate::store::{Existing, Place};

/// A folder for results that are deleted at the end.
struct Temporary(PathBuf);

impl Temporary {
    fn new() -> Result<Temporary> {
        let path = std::env::temp_dir().join(format!("scree-check-{}", std::process::id()));
        fs::create_dir_all(&path)
            .with_context(|| format!("cannot make the folder {}: choose another folder with --out", path.display()))?;
        Ok(Temporary(path))
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // If a temporary folder cannot be removed, nothing else can be done, so the error is ignored.
        drop(fs::remove_dir_all(&self.0));
    }
}

/// Runs the small version of each definition. Fails if an expectation is not met.
pub(crate) fn run(args: &CheckArgs) -> Result<()> {
    let temporary = args.out.is_none().then(Temporary::new).transpose()?;
    let out = args.out.as_deref().or(temporary.as_ref().map(|folder| folder.0.as_path())).unwrap_or(Path::new("."));
    let place = Place { out, own: false, existing: Existing::Refuse, shard: None, small: true };
    each(&args.definitions, |definition, session| {
        let small = definition.small();
        has_expectations(&small)?;
        let data = session.carry_out(&small, &place)?;
        let verdicts = expectations::evaluate(&small, &data.rows, &data.times);
        let lines: String = verdicts.iter().map(|verdict| format!("  {verdict}\n")).collect();
        print(&format!("{}, on {}:\n{lines}", small.name, data.manifest.provenance.adapter))?;
        judge(&small.name, &verdicts)
    })
}

/// Refuses a definition without expectations, because there is nothing to check.
///
/// # Errors
/// The definition has no expectations.
fn has_expectations(definition: &Definition) -> Result<()> {
    if definition.expectations.is_empty() {
        bail!("`{}` has no expectations, so there is nothing to check: add an [[expect]], or omit the definition", definition.name);
    }
    Ok(())
}

/// Fails if an expectation is not met.
///
/// # Errors
/// A value is outside its range or does not exist. The message names all expectations that are not met.
fn judge(name: &str, verdicts: &[Verdict]) -> Result<()> {
    let failed: Vec<&str> = verdicts.iter().filter(|verdict| !verdict.met).map(|verdict| verdict.claim.trim()).collect();
    if failed.is_empty() {
        return Ok(());
    }
    bail!("`{name}`: {} of {} expectations do not hold: {}", failed.len(), verdicts.len(), failed.join("; "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_left_its_range_is_named() {
        let verdict = |claim: &str, met| Verdict {
            claim: claim.to_owned(),
            metric: "bias".to_owned(),
            value: 1.0,
            range: [0.0, 2.0],
            met,
            why: String::new(),
        };
        assert!(judge("x", &[verdict("a", true)]).is_ok());
        let text = judge("x", &[verdict("a", true), verdict("b", false)]).unwrap_err().to_string();
        assert!(text.contains("1 of 2") && text.ends_with(": b"), "{text}");
    }
}

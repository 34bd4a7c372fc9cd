//! The parts of a run. Each part is carried out completely or not at all. A run can therefore be stopped at any time, resumed, and split over
//! machines.

use std::fmt;
use std::path::Path;
use std::str::FromStr;

use anyhow::Result;

use crate::definition::{Definition, Setting, Times, hash, setting_text};
use crate::row::Row;

/// The work that a part of a run consists of.
#[derive(Clone, Debug, PartialEq)]
pub enum Work {
    /// Renders the converged reference and the reference sequences of a view, and measures how the sequences change from frame to frame. The pictures
    /// are written to the run's folder, where the sweeps read them.
    Reference,
    /// Measures all variants of the definition over the frames. Without a temporal resolve, also measures several seeds of the last frame.
    Sweep {
        /// Estimator of the stochastic flavours.
        estimator: String,
        /// Noise of the stochastic flavours.
        noise: String,
        /// Temporal resolve.
        temporal: String,
    },
    /// Measures the device times of all variants.
    Timing {
        /// Estimator of the stochastic flavours.
        estimator: String,
        /// Noise of the stochastic flavours.
        noise: String,
    },
}

/// A part of a run.
#[derive(Clone, Debug, PartialEq)]
pub struct Unit {
    /// Index of the part in the run, from 0. Rows are stored in the order of the parts.
    pub index: usize,
    /// Name of the part in file names and progress messages. It consists of letters, digits, `-`, `_`, `+` and `.`.
    pub id: String,
    /// Name of the view.
    pub view: String,
    /// Value of the varied parameter; `None` if no parameter is varied.
    pub setting: Setting,
    /// The work of the part.
    pub work: Work,
}

/// The result of a part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// Rows of metrics. They should be identical if the part is carried out again on the same adapter with the same driver.
    pub rows: Vec<Row>,
    /// Rows of device times. They usually differ each time the part is carried out.
    pub times: Vec<Row>,
}

/// An object that carries out parts.
pub trait Measure {
    /// Carries out one part. Pictures and other files are written to `folder`, each completely or not at all. `step(done, total)` is called to report
    /// the progress within the part. Implementations should check for an interrupt between steps.
    ///
    /// # Errors
    /// The part cannot be rendered, its files cannot be written, or the user interrupts the run. The part is then not finished.
    fn measure(&mut self, unit: &Unit, folder: &Path, step: &dyn Fn(u64, u64)) -> Result<Outcome>;
}

/// Returns the parts of a valid definition, in the order in which they are carried out. For each value of the varied parameter and each view, the
/// reference comes first, then the sweeps that use it, then the times. If several combinations of estimator, noise and resolve give the same result,
/// each of them has a part: a table without gaps is easier to read than a table whose gaps need an explanation.
pub fn plan(definition: &Definition) -> Vec<Unit> {
    let settings: Vec<Setting> = match &definition.vary {
        None => vec![None],
        Some(vary) => vary.values.iter().cloned().map(Some).collect(),
    };
    let timed: &[String] = match definition.times {
        Times::None => &[],
        Times::FirstNoise => definition.noises.get(..1).unwrap_or(&[]),
        Times::All => &definition.noises,
    };
    let mut units: Vec<Unit> = Vec::new();
    for setting in &settings {
        for view in definition.view_names() {
            let mut add = |work: Work| {
                let mut words: Vec<&str> = match &work {
                    Work::Reference => vec!["reference", view],
                    Work::Sweep { estimator, noise, temporal } => vec!["sweep", view, estimator, noise, temporal],
                    Work::Timing { estimator, noise } => vec!["timing", view, estimator, noise],
                };
                let value = setting.as_ref().map(setting_text);
                words.extend(value.as_deref());
                let id = id_of(&words, &units);
                units.push(Unit { index: units.len(), id, view: view.to_owned(), setting: setting.clone(), work });
            };
            add(Work::Reference);
            for estimator in &definition.estimators {
                for noise in &definition.noises {
                    for temporal in &definition.temporal {
                        add(Work::Sweep { estimator: estimator.clone(), noise: noise.clone(), temporal: temporal.clone() });
                    }
                }
            }
            for estimator in &definition.estimators {
                for noise in timed {
                    add(Work::Timing { estimator: estimator.clone(), noise: noise.clone() });
                }
            }
        }
    }
    units
}

/// Returns the name of a part: the words, converted to components of a file name and joined by `-`. If the conversion changes a word, or if a part in
/// `taken` already has this name, a hash of the words is appended. Different parts therefore practically always have different names, even if upper
/// and lower case are treated as equal.
fn id_of(words: &[&str], taken: &[Unit]) -> String {
    let id = words.iter().map(|word| file_word(word)).collect::<Vec<_>>().join("-");
    let is_plain = words.iter().all(|word| file_word(word) == *word);
    if is_plain && !taken.iter().any(|unit| unit.id.eq_ignore_ascii_case(&id)) {
        return id;
    }
    let hash = hash(words.join("\0").as_bytes());
    format!("{id}-{}", hash.get(..8).unwrap_or(&hash))
}

/// Converts a text to a component of a file name. Characters other than ASCII letters, digits, `-`, `_`, `+` and `.` are replaced by `_`. The text is
/// cut after 30 characters, so that six components and a hash fit into a file name.
fn file_word(text: &str) -> String {
    text.chars().take(30).map(|c| if c.is_ascii_alphanumeric() || "-_+.".contains(c) { c } else { '_' }).collect()
}

/// One of several pieces into which a run is split. Each piece can run on a different machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Shard {
    /// Number of this piece, from 1 to `count`.
    pub number: u32,
    /// Number of pieces of the run, from 1 to [`Shard::MAX`].
    pub count: u32,
}

impl Shard {
    /// Limit of the number of pieces.
    pub const MAX: u32 = 1000;
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Shard, String> {
        let wrong = || format!("`{text}` is not a shard: give K/N, such as 2/4, with 1 <= K <= N <= {}", Shard::MAX);
        let (number, count) = text.split_once('/').ok_or_else(wrong)?;
        let parse = |digits: &str| digits.parse::<u32>().map_err(|_| wrong());
        let shard = Shard { number: parse(number)?, count: parse(count)? };
        if shard.number >= 1 && shard.number <= shard.count && shard.count <= Shard::MAX { Ok(shard) } else { Err(wrong()) }
    }
}

/// A part that belongs to a run or shard.
#[derive(Clone, Debug, PartialEq)]
pub struct Share {
    /// The part.
    pub unit: Unit,
    /// Whether this run or shard stores the rows of the part. Several shards may render the same reference, but only one of them stores its rows.
    pub kept: bool,
}

/// Returns the parts that a shard carries out, or all parts if `shard` is `None`. Sweeps and timings are assigned to the shards in turn. The rows of
/// references are assigned in turn as well, independently of sweeps and timings. A shard also renders each reference that its sweeps need, even if
/// another shard stores the rows of this reference. All shards together store the rows of each part exactly once.
pub fn share(units: &[Unit], shard: Option<Shard>) -> Vec<Share> {
    let Some(shard) = shard else { return units.iter().cloned().map(|unit| Share { unit, kept: true }).collect() };
    let (count, own) = (shard.count as usize, shard.number as usize - 1);
    let (mut references, mut others) = (0, 0);
    let shares: Vec<Share> = units
        .iter()
        .map(|unit| {
            let dealt = if unit.work == Work::Reference { &mut references } else { &mut others };
            *dealt += 1;
            Share { unit: unit.clone(), kept: (*dealt - 1) % count == own }
        })
        .collect();
    let needed = |reference: &Unit| {
        let judged = |share: &&Share| share.kept && matches!(share.unit.work, Work::Sweep { .. });
        shares.iter().filter(judged).any(|share| share.unit.view == reference.view && share.unit.setting == reference.setting)
    };
    shares.iter().filter(|share| share.kept || share.unit.work == Work::Reference && needed(&share.unit)).cloned().collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn shards_are_read_and_refused() {
        assert_eq!("2/4".parse(), Ok(Shard { number: 2, count: 4 }));
        for wrong in ["", "2", "0/4", "5/4", "-1/4", "1/0", "1/1001", "a/b", "1/2/3"] {
            assert!(wrong.parse::<Shard>().is_err_and(|text| text.contains("K/N")), "{wrong}");
        }
    }

    #[test]
    fn words_become_file_names() {
        assert_eq!(file_word("0.05"), "0.05");
        assert_eq!(file_word("[1.0, 2]/..\\é"), "_1.0__2__..__");
        assert_eq!(file_word(&"x".repeat(300)).len(), 30);
    }

    #[test]
    fn different_parts_have_different_names() {
        let named = |id: String| Unit { index: 0, id, view: String::new(), setting: None, work: Work::Reference };
        let long = |end: &str| format!("{}{end}", "0.1234567890".repeat(4));
        let (one, other) = (long("1"), long("2"));
        let all: [&[&str]; 9] = [
            &["reference", "cliff", "0.05"],
            // Words that are cut after 30 characters, and words with characters that are replaced.
            &["reference", "cliff", one.as_str()],
            &["reference", "cliff", other.as_str()],
            &["reference", "cliff", "[1, 2]"],
            &["reference", "cliff", "(1, 2)"],
            // Different words that give the same name when they are joined, and names that differ only in upper and lower case.
            &["reference", "a", "b-c"],
            &["reference", "a-b", "c"],
            &["reference", "Cliff"],
            &["reference", "cliff"],
        ];
        let mut taken: Vec<Unit> = Vec::new();
        for words in all {
            taken.push(named(id_of(words, &taken)));
        }
        let ids: BTreeSet<String> = taken.iter().map(|unit| unit.id.to_lowercase()).collect();
        assert_eq!(ids.len(), all.len(), "{ids:?}");
        assert!(ids.iter().all(|id| id.len() < 200 && id.chars().all(|c| c.is_ascii_alphanumeric() || "-_+.".contains(c))), "{ids:?}");
        assert_eq!(
            (taken[0].id.as_str(), taken[7].id.as_str()),
            ("reference-cliff-0.05", "reference-Cliff"),
            "plain names stay as they are"
        );
        assert_eq!(id_of(all[1], &[]), id_of(all[1], &taken), "the hash depends on the words alone");
    }
}

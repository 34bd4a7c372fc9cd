//! The stability lab: every kernel at its extremes against f64 ([`kernels`], asked by [`extremes`]), and what hashes and noise can be held to, measured
//! without a device. `docs/stability-lab.md` says why these.

pub mod extremes;
pub mod hashes;
pub mod kernels;
pub mod motion;
pub mod noise;
pub mod statistics;

use serde::{Deserialize, Serialize};

/// One number and the range that it has to lie in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was measured: a kind of noise, by its name, or a hash.
    pub kind: String,
    /// Where: a view, a distance from the origin, a footprint and slope.
    pub view: String,
    /// What moved between what is compared: a motion of the camera, an axis, a seed; empty = nothing.
    pub motion: String,
    /// Name of the statistic. Those that end in `p` are p-values, held to [`statistics::sidak`] of their family.
    pub statistic: String,
    /// The number.
    pub value: f64,
    /// The smallest that passes.
    pub low: f64,
    /// The largest that passes.
    pub high: f64,
}

impl Row {
    /// Whether the value lies in its range; a value that is not a number lies in none.
    pub fn holds(&self) -> bool {
        (self.low..=self.high).contains(&self.value)
    }

    /// Whether it is one of the tests that share a family's level.
    pub fn is_test(&self) -> bool {
        self.statistic.ends_with(" p")
    }
}

/// Holds the p-values among the rows to the level at which all of them together are at 0.1 %.
pub fn hold_as_family(rows: &mut [Row]) {
    let level = statistics::sidak(rows.iter().filter(|row| row.is_test()).count());
    rows.iter_mut().filter(|row| row.is_test()).for_each(|row| (row.low, row.high) = (level, 1.0));
}

//! The stability lab: every kernel at its extremes against f64 ([`kernels`], asked by [`extremes`]), and what codes, derivatives, hashes and noise can be held
//! to, measured without a device. `docs/stability-lab.md` says why these.

pub mod directions;
pub mod extremes;
pub mod hashes;
pub mod kernels;
pub mod motion;
pub mod noise;
pub mod statistics;

use std::fmt;

use serde::{Deserialize, Serialize};

/// One number and the range that it has to lie in.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was measured: a kind of noise, by its name, a hash, a code.
    pub kind: String,
    /// Where: a view, a distance from the origin, a footprint and slope, a count of bits.
    pub view: String,
    /// What differs between what is compared: a motion of the camera, an axis, a seed, a rounding, another code; empty = nothing.
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

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parts = [&self.kind, &self.view, &self.motion].into_iter().filter(|part| !part.is_empty());
        for part in parts {
            write!(f, "{part}, ")?;
        }
        write!(f, "{} is {} and not {} to {}", self.statistic, self.value, self.low, self.high)
    }
}

impl Row {
    /// Four significant digits, so that a difference between two tables is not one of rounding.
    pub fn shortened(&self) -> Row {
        let short = |x: f64| format!("{x:.3e}").parse().unwrap_or(x);
        Row { value: short(self.value), low: short(self.low), high: short(self.high), ..self.clone() }
    }

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

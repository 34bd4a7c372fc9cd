//! The stability lab: compares every kernel with its reference in f64 at extreme values ([`kernels`], with the values of [`extremes`]), and tests
//! codes, derivatives, hashes and noise without a device. `docs/stability-lab.md` gives the reasons.

pub mod directions;
pub mod extremes;
pub mod hashes;
pub mod kernels;
pub mod motion;
pub mod noise;
pub mod statistics;

use std::fmt;

use serde::{Deserialize, Serialize};

/// A measured number and the range in which it must lie.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// What was measured: the name of a kind of noise, a hash, or a code.
    pub kind: String,
    /// Under which conditions it was measured: a view, a distance from the origin, a footprint and slope, or a number of bits.
    pub view: String,
    /// What differs between the two compared samples: the camera (a motion), the place (an axis), the seed, the rounding or the code; empty if no
    /// samples are compared.
    pub motion: String,
    /// Name of the statistic. Names that end in ` p` are p-values, which are tested at the level [`statistics::sidak`] of their family.
    pub statistic: String,
    /// The number.
    pub value: f64,
    /// The smallest value that passes.
    pub low: f64,
    /// The largest value that passes.
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
    /// Returns the row with numbers of four significant digits, so that differences between two recorded tables do not come from rounding.
    pub fn shortened(&self) -> Row {
        let short = |x: f64| format!("{x:.3e}").parse().unwrap_or(x);
        Row { value: short(self.value), low: short(self.low), high: short(self.high), ..self.clone() }
    }

    /// Whether the value lies in its range; NaN lies in no range.
    pub fn holds(&self) -> bool {
        (self.low..=self.high).contains(&self.value)
    }

    /// Whether the row is a p-value, and so one of the tests that share the level of a family.
    pub fn is_test(&self) -> bool {
        self.statistic.ends_with(" p")
    }
}

/// Sets the accepted range of the p-values among the rows, so that all tests together have a level of 0.1 %.
pub fn hold_as_family(rows: &mut [Row]) {
    let level = statistics::sidak(rows.iter().filter(|row| row.is_test()).count());
    rows.iter_mut().filter(|row| row.is_test()).for_each(|row| (row.low, row.high) = (level, 1.0));
}

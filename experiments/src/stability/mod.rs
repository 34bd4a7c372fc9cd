//! The stability lab. A *kernel* is a function that shaders share. The lab compares kernels with their references in f64 at extreme values
//! ([`kernels`], with the values of [`extremes`]). It also tests stored directions, derivatives, hashes and noise; these tests run on the CPU.
//! `docs/stability-lab.md` gives the reasons for the tests.

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
    /// What was measured: the name of a kind of noise, of a hash, or of an encoding; `derivatives` for the effect of clamped cosines.
    pub kind: String,
    /// The conditions of the measurement: a kind of ground, a distance from the origin, an elevation, `screen` or `seeds` for samples over pixels or
    /// seeds, a footprint and slope, an angle or a range of angles, a number of bits, or the index of a word.
    pub view: String,
    /// What is varied or compared under these conditions, such as a motion of the camera, an input of the noise that changes (a coordinate, the
    /// scale, the seed or the salt), the index of a threshold, a tested probability, the index of a bit, a rounding or an encoding. Empty if nothing
    /// is varied.
    pub motion: String,
    /// Name of the statistic. A name that ends with ` p` belongs to a p-value. All p-values of a family are tested at the level that
    /// [`statistics::sidak`] returns for their number.
    pub statistic: String,
    /// The measured value.
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
        write!(f, "{} is {}, outside the range {} to {}", self.statistic, self.value, self.low, self.high)
    }
}

impl Row {
    /// Returns the row with its numbers rounded to four significant digits. With so few digits, rounding errors rarely make two recorded tables
    /// differ.
    pub fn shortened(&self) -> Row {
        let short = |x: f64| format!("{x:.3e}").parse().unwrap_or(x);
        Row { value: short(self.value), low: short(self.low), high: short(self.high), ..self.clone() }
    }

    /// Whether the value lies in the accepted range. NaN does not lie in any range.
    pub fn holds(&self) -> bool {
        (self.low..=self.high).contains(&self.value)
    }

    /// Whether the value is a p-value. All p-values of a family share one significance level.
    pub fn is_test(&self) -> bool {
        self.statistic.ends_with(" p")
    }
}

/// Sets the accepted range of all p-values in `rows`, so that all tests together have a significance level of 0.1 %.
pub fn hold_as_family(rows: &mut [Row]) {
    let level = statistics::sidak(rows.iter().filter(|row| row.is_test()).count());
    rows.iter_mut().filter(|row| row.is_test()).for_each(|row| (row.low, row.high) = (level, 1.0));
}

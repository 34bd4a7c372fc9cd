//! Temporal resolve: what a game does to noise before anybody sees it. Off by default, since it hides what is measured.

use std::fmt;
use std::str::FromStr;

use crate::error::Error;
use crate::scene::nearest;

/// How frames are resolved over time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Resolve {
    /// Each frame as it is.
    #[default]
    Off,
    /// Exponential history, clipped to the 3 x 3 colour box of the current frame.
    Exponential,
    /// FlipQuad: two samples a pixel and frame on pixel edges, alternate frames taking the other two of four.
    FlipQuad,
    /// FlipQuad, then the exponential history.
    FlipQuadExponential,
}

impl Resolve {
    /// All of them.
    pub const ALL: [Resolve; 4] = [Resolve::Off, Resolve::Exponential, Resolve::FlipQuad, Resolve::FlipQuadExponential];

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Resolve::Off => "off",
            Resolve::Exponential => "exponential",
            Resolve::FlipQuad => "flipquad",
            Resolve::FlipQuadExponential => "flipquad+exponential",
        }
    }
}

impl fmt::Display for Resolve {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Resolve {
    type Err = Error;

    fn from_str(text: &str) -> Result<Resolve, Error> {
        Resolve::ALL.into_iter().find(|r| r.name() == text).ok_or_else(|| {
            let names = Resolve::ALL.map(Resolve::name);
            let hint = nearest(text, &names).map_or_else(String::new, |near| format!("; did you mean `{near}`?"));
            Error::Request(format!("`{text}` is no temporal resolve: give one of {}{hint}", names.join(", ")))
        })
    }
}

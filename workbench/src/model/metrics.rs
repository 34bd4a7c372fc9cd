//! What is measured of the pictures as they are drawn, and the numbers that come of it.

use kernels::metrics::Summary;

/// Layers of a picture that metrics are taken from.
pub const LAYERS: [&str; 2] = ["albedo", "choice"];
/// Windows on offer, frames.
pub const WINDOWS: [u32; 2] = [2, 1024];

/// What is measured of the pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct Metrics {
    /// Whether anything is.
    pub on: bool,
    /// Frames that a number goes back, exponentially.
    pub window: u32,
    /// Whether the numbers stay as they are.
    pub frozen: bool,
    /// How often they were begun anew.
    pub resets: u32,
    /// Left, top, right and bottom of what is summed, as shares of the picture; `None` = all.
    pub region: Option<[f32; 4]>,
}

impl Default for Metrics {
    fn default() -> Self {
        Metrics { on: false, window: 32, frozen: false, resets: 0, region: None }
    }
}

/// One frame's numbers, of A and of B.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// The frame.
    pub frame: u32,
    /// A, and B if it was drawn.
    pub sides: [Option<Summary>; 2],
}

//! Settings of the live metrics, and their results.

use kernels::metrics::Summary;

/// Layers of a picture from which the metrics are computed.
pub const LAYERS: [&str; 2] = ["albedo", "choice"];
/// Limits of [`Metrics::window`]: smallest and largest, frames.
pub const WINDOWS: [u32; 2] = [2, 1024];

/// Settings of the live metrics.
#[derive(Clone, Debug, PartialEq)]
pub struct Metrics {
    /// Whether metrics are computed.
    pub on: bool,
    /// Length of the exponential window over which values are averaged, frames.
    pub window: u32,
    /// Whether the metrics are frozen at their current values.
    pub frozen: bool,
    /// Number of restarts that the user has requested. When it changes, the metrics restart.
    pub resets: u32,
    /// The measured region as left, top, right and bottom, in shares of the picture; `None` = the whole picture.
    pub region: Option<[f32; 4]>,
}

impl Default for Metrics {
    fn default() -> Self {
        Metrics { on: false, window: 32, frozen: false, resets: 0, region: None }
    }
}

/// The metrics of one frame, for A and B (see [`super::compare`]).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reading {
    /// The frame number.
    pub frame: u32,
    /// The metrics of A and of B; `None` = B was not drawn, or the measured region shows no terrain.
    pub sides: [Option<Summary>; 2],
}

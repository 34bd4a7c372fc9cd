//! Progress of long work.

/// The progress of one stage of long work.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What is being done.
    pub stage: String,
    /// Number of steps that are done.
    pub done: u64,
    /// Total number of steps; 0 = not known.
    pub total: u64,
}

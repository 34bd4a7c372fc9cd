//! Progress of long tasks.

/// The progress of one stage of a long task.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What is being done.
    pub stage: String,
    /// Number of steps that are done.
    pub done: u64,
    /// Total number of steps; 0 = not known.
    pub total: u64,
}

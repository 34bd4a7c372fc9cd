//! Progress of long work.

/// The progress of one stage of long work.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What is being done.
    pub stage: String,
    /// Steps done.
    pub done: u64,
    /// Steps in all; 0 = not known.
    pub total: u64,
}

//! How far long work has come.

/// A step of long work, and how far it is.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What is being done.
    pub stage: String,
    /// Steps done.
    pub done: u64,
    /// Steps in all; 0 = not known.
    pub total: u64,
}

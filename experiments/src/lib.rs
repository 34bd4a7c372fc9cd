//! What scripts and tests use of the experiments without the command line: pictures judged.

pub mod judge;

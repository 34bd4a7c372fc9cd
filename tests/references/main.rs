//! The test binary `references`: tests that judge the Rust references, and other pure host code of `kernels`, without a device. They compare with
//! formulas, closed forms, published values and probability distributions, and check properties. Tests that compare a shader with its reference are
//! in the test binary `scree`.
//!
//! `make mutants-rust` compiles this binary again for each mutant of a reference. So a test of a reference belongs here if it needs only `kernels`.

#[cfg(test)]
mod formulas;
#[cfg(test)]
mod nodes;
#[cfg(test)]
#[path = "../noise.rs"]
mod noise;
#[cfg(test)]
#[path = "../properties.rs"]
mod properties;
#[cfg(test)]
#[path = "../shared.rs"]
mod shared;
#[cfg(test)]
#[path = "../../experiments/src/significance.rs"]
#[allow(dead_code, unreachable_pub, reason = "a file of `experiments`, which would take long to compile; these tests use a part of it")]
mod significance;
#[cfg(test)]
mod stages;
#[cfg(test)]
#[path = "../../experiments/src/stability/statistics.rs"]
#[allow(dead_code, unreachable_pub, reason = "a file of `experiments`, which would take long to compile; these tests use a part of it")]
mod statistics;
#[cfg(test)]
mod streaming;
#[cfg(test)]
mod surfaces;

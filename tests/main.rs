//! The test binary `scree`; the list of modules below shows its contents. `memory.rs` and `mutants.rs` (with `rust_mutants.rs`) are separate
//! binaries. `noise.rs`, `properties.rs` and `shared.rs` belong to the binary `references` (`references/main.rs`).

#[cfg(test)]
mod agreement;
#[cfg(test)]
mod bad_input;
#[cfg(test)]
mod bias;
#[cfg(test)]
mod cache;
#[cfg(test)]
mod cases_compare;
#[cfg(test)]
mod cases_heightmaps;
#[cfg(test)]
mod cases_materials;
#[cfg(test)]
mod cases_openexr;
#[cfg(test)]
mod compare;
#[cfg(test)]
mod composition;
#[cfg(test)]
mod display;
#[cfg(test)]
mod edit;
#[cfg(test)]
mod editing;
#[cfg(test)]
mod estimators;
#[cfg(test)]
mod examples;
#[cfg(test)]
mod experiments;
#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod floors;
#[cfg(test)]
mod frame;
#[cfg(test)]
mod geometry;
#[cfg(test)]
mod import;
#[cfg(test)]
mod inspector;
#[cfg(test)]
mod layouts;
#[cfg(test)]
mod lighting;
#[cfg(test)]
mod looking;
#[cfg(test)]
mod materials;
#[cfg(test)]
mod measurer;
#[cfg(test)]
mod metrics;
#[cfg(test)]
mod motion;
#[cfg(test)]
mod mutation;
#[cfg(test)]
mod mutation_listed;
#[cfg(test)]
mod mutation_results;
#[cfg(test)]
mod mutation_text;
#[cfg(test)]
mod noise_frame;
#[cfg(test)]
mod noise_stability;
#[cfg(test)]
mod occlusion;
#[cfg(test)]
mod parsers;
#[cfg(test)]
mod reload;
#[cfg(test)]
mod round_trips;
#[cfg(test)]
mod runs;
#[cfg(test)]
mod scene;
#[cfg(test)]
mod settings;
#[cfg(test)]
mod shaders;
#[cfg(test)]
mod shading;
#[cfg(test)]
mod significance;
#[cfg(test)]
mod snapshots;
#[cfg(test)]
mod stability;
#[cfg(test)]
mod store;
#[cfg(test)]
mod view;
#[cfg(test)]
mod workbench;
#[cfg(test)]
mod world;

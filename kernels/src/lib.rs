//! The terrain stack of *Far Cry 5* as a measuring instrument: every stage of the frame, its shaders, and their f64 references.
//!
//! Read [`frame`] first: it calls the stages in their order. A stage is a folder: host module, WGSL, and where it has mathematics of its own a
//! `reference`. [`shared`] holds the functions that several stages use, each as WGSL and as Rust. Only [`gpu`] knows devices.
//!
//! Modules stand in floors: a module imports only from lower ones. The list `KERNELS` in `tests/floors.rs` gives the order and holds them to it.

pub mod base;
pub mod blocks;
pub mod classification;
pub mod composition;
pub mod culling;
pub mod decode;
pub mod display;
pub mod frame;
pub mod geometry;
pub mod gpu;
pub mod import;
pub mod inspect;
pub mod lighting;
pub mod materials;
pub mod metrics;
pub mod motion;
pub mod oracle;
pub mod probe;
pub mod quadtree;
pub mod residency;
pub mod scene;
pub mod settings;
pub mod shading;
pub mod shared;
pub mod stage;
pub mod temporal;
pub mod terrain;
pub mod variant;
pub mod view;
pub mod virtual_texture;
pub mod world;

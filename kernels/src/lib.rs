//! The terrain stack of *Far Cry 5* as a measuring instrument: every stage of the frame, its shaders, and their f64 references.
//!
//! Read [`frame`] first: it calls the stages in their order. A stage is a folder: host module, WGSL, and where it has mathematics of its own a
//! `reference`. [`shared`] holds the functions that several stages use, each as WGSL and as Rust. Only [`gpu`] knows devices.

pub mod camera;
pub mod classification;
pub mod composition;
pub mod culling;
pub mod document;
pub mod error;
pub mod frame;
pub mod geometry;
pub mod gpu;
pub mod inspect;
pub mod lighting;
pub mod materials;
pub mod metrics;
pub mod picture;
pub mod probe;
pub mod quadtree;
pub mod scene;
pub mod shading;
pub mod shared;
pub mod streaming;
pub mod temporal;
pub mod terrain;
pub mod variant;
pub mod virtual_texture;
pub mod world;

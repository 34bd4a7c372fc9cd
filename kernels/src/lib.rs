//! The terrain rendering of *Far Cry 5*, built for measurements: the stages of the frame, their shaders, and f64 references.
//!
//! A [`scene`] describes the terrain, its materials and the light. A [`Renderer`] prepares a scene for a [`Gpu`], and a [`RenderRequest`] describes
//! one picture of the scene. [`Renderer::draw`] returns a [`Frame`], which can be read back, measured, composed or inspected.
//! `examples/render_png.rs` draws a picture in under 40 lines; `examples/probe_table.rs` evaluates one shared function for a table of inputs, on the
//! device and in f64.
//!
//! Where to start reading:
//!
//! - [`frame`] calls the stages in order, so its function `draw_into` gives an overview of a frame.
//! - A stage is a folder with a host module, WGSL and, if the stage has mathematics of its own, a `reference` in Rust. [`stage`] defines what every
//!   stage declares about itself.
//! - [`shared`] holds functions that several stages use. Most are written twice, in WGSL and in Rust; the Rust version is usually generic over f32
//!   and f64. [`probe`] evaluates such functions for tables of inputs.
//! - [`gpu`] handles adapters, devices, shaders, timers and read-back.
//!
//! Modules are arranged in layers, called floors: outside tests, a module imports only from itself and from lower floors. The list `KERNELS` in
//! `tests/floors.rs` gives the order, and a test enforces it.

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
pub mod occlusion;
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

pub use base::error::{Error, Result};
pub use frame::{Frame, RenderRequest, Renderer};
pub use gpu::Gpu;
pub use scene::Scene;

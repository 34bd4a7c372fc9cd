//! The terrain stack of *Far Cry 5* as a measuring instrument: every stage of the frame, its shaders, and their f64 references.
//!
//! A [`scene`] says what there is. A [`Renderer`] makes it ready on a [`Gpu`]; a [`RenderRequest`] asks for one picture of it; [`Renderer::draw`] returns a
//! [`Frame`], which can be read back, measured, composed or inspected. `examples/render_png.rs` does that in under 40 lines;
//! `examples/probe_table.rs` runs one shared function over a table, on the device and in f64.
//!
//! Where to read:
//!
//! - [`frame`] calls the stages in their order: the frame on one page.
//! - A stage is a folder: host module, WGSL, and a `reference` where it has mathematics of its own. [`stage`] says what a stage declares of itself.
//! - [`shared`] holds the functions that several stages use, each as WGSL and as Rust, generic over f32 and f64. [`probe`] lays them open as tables.
//! - [`gpu`] alone knows adapters, pipelines, timers and read-back.
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

pub use base::error::{Error, Result};
pub use frame::{Frame, RenderRequest, Renderer};
pub use gpu::Gpu;
pub use scene::Scene;

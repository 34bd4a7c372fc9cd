//! What a stage of the frame declares of itself, once: its name, its shader modules, its passes, what it allocates, how it is built, what it reports.
//!
//! Building, hot reload, `explain`, the tests of shaders and the workbench's machine panel follow from the declarations in the table of stages
//! (`frame/stages.rs`). The order in which stages draw is written by hand, in `draw_into` (`frame/mod.rs`).

use crate::base::error::Result;
use crate::base::section::Section;
use crate::gpu::uses::{PassUse, TargetUse, TextureUse};
use crate::gpu::{Gpu, ShaderModule};
use crate::scene::demands::Demands;
use crate::terrain::Terrain;
use crate::view::normals::NormalEncoding;

/// What a stage is.
pub struct Declaration {
    /// Its name, as in messages and timings.
    pub name: &'static str,
    /// What it reads and makes, one sentence.
    pub about: &'static str,
    /// Shader modules it may compile, by scene and device.
    pub modules: &'static [&'static ShaderModule],
    /// Its passes, required or not.
    pub passes: fn(&Demands) -> Vec<PassUse>,
    /// Textures whose size follows from the scene, required or not.
    pub textures: fn(&Demands) -> Vec<TextureUse>,
    /// Textures of the picture's size.
    pub targets: fn(NormalEncoding) -> Vec<TargetUse>,
}

impl Declaration {
    /// A stage without passes that allocates nothing: what a declaration leaves out.
    pub const EMPTY: Declaration =
        Declaration { name: "", about: "", modules: &[], passes: |_| Vec::new(), textures: |_| Vec::new(), targets: |_| Vec::new() };
}

/// What stages are built from.
#[derive(Clone, Copy)]
pub struct Build<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Layout of group 0: the uniforms of a frame.
    pub frame: &'a wgpu::BindGroupLayout,
    /// Group 1.
    pub terrain: &'a Terrain,
    /// What the scene demands.
    pub demands: &'a Demands,
    /// Edge of a tile, pixels.
    pub tile: u32,
}

/// Puts what was built anew into a stage.
pub type Exchange<S> = Box<dyn FnOnce(&mut S)>;

/// A stage of the frame.
pub trait Stage: Sized + 'static {
    /// What it is.
    const DECLARATION: Declaration;

    /// Compiles its shaders and allocates what does not depend on the picture.
    ///
    /// # Errors
    /// When a shader does not compile.
    fn build(build: Build<'_>) -> Result<Self>;

    /// Builds it again from the device's present shader sources. What costs much to make and does not depend on shaders stays.
    ///
    /// # Errors
    /// When a shader does not compile, or no pipeline comes of it.
    fn rebuilt(&self, build: Build<'_>) -> Result<Exchange<Self>> {
        let _ = self;
        let fresh = Self::build(build)?;
        Ok(Box::new(move |stage| *stage = fresh))
    }

    /// The declared modules that it compiles for this scene on this device.
    fn modules(build: Build<'_>) -> Vec<&'static ShaderModule> {
        let _ = build;
        Self::DECLARATION.modules.to_vec()
    }

    /// Its numbers of the last frame, if it has any.
    fn section(&self) -> Option<Section> {
        None
    }
}

//! Stages of the frame. Each stage declares its name, shader modules, passes, settings and allocations, how it is built, and what it reports.
//!
//! The table of stages (`frame/stages.rs`) lists the stages. It is used by building, hot reload, the command `explain`, settings, shader tests, and
//! the panels of the workbench. The order in which stages draw does not follow from the table; it is written out in `draw_into` (`frame/mod.rs`).

use crate::base::error::Result;
use crate::base::section::Section;
use crate::gpu::uses::{PassUse, TargetUse, TextureUse};
use crate::gpu::{Gpu, ShaderModule};
use crate::scene::demands::Demands;
use crate::settings::Part;
use crate::terrain::Terrain;
use crate::view::normals::NormalEncoding;

/// What a stage declares about itself.
pub struct Declaration {
    /// Name of the stage, as shown in messages and lists. Timings show the names of its passes.
    pub name: &'static str,
    /// What the stage reads and writes, in one sentence.
    pub about: &'static str,
    /// Shader modules that the stage may compile, depending on scene and device.
    pub modules: &'static [&'static ShaderModule],
    /// Passes of the stage, including those that the scene does not require.
    pub passes: fn(&Demands) -> Vec<PassUse>,
    /// Textures whose size does not depend on the picture, including those that the scene does not require.
    pub textures: fn(&Demands) -> Vec<TextureUse>,
    /// Textures that have the size of the picture.
    pub targets: fn(NormalEncoding) -> Vec<TargetUse>,
}

impl Declaration {
    /// A stage without passes and allocations: the defaults for fields that a declaration leaves out.
    pub const EMPTY: Declaration =
        Declaration { name: "", about: "", modules: &[], passes: |_| Vec::new(), textures: |_| Vec::new(), targets: |_| Vec::new() };
}

/// Inputs for building a stage.
#[derive(Clone, Copy)]
pub struct Build<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Layout of group 0: the uniforms of a frame.
    pub frame: &'a wgpu::BindGroupLayout,
    /// Bind group 1: the terrain data.
    pub terrain: &'a Terrain,
    /// What the scene requires.
    pub demands: &'a Demands,
    /// Edge length of a tile, pixels.
    pub tile: u32,
}

/// Inputs for allocating the targets of a picture.
#[derive(Clone, Copy)]
pub struct Canvas<'a> {
    /// The device.
    pub gpu: &'a Gpu,
    /// Size of the picture, pixels.
    pub size: [u32; 2],
    /// How normals are stored.
    pub normals: NormalEncoding,
    /// Edge length of a tile, pixels.
    pub tile: u32,
}

/// A function that puts rebuilt parts into a stage.
pub type Exchange<S> = Box<dyn FnOnce(&mut S)>;

/// A stage of the frame.
pub trait Stage: Sized + 'static {
    /// The declaration of the stage.
    const DECLARATION: Declaration;

    /// Settings of a frame that this stage declares; `()` = none. Other stages may read them, too: composition reads the exposure of display.
    type Settings: Part;

    /// The textures and buffers of the stage that depend on the picture's size; `()` = none.
    type Targets: 'static;

    /// Allocates the targets of the stage.
    fn targets(canvas: Canvas<'_>) -> Self::Targets;

    /// Compiles the shaders of the stage and allocates its resources, except those that depend on the picture's size.
    ///
    /// # Errors
    /// When a shader does not compile.
    fn build(build: Build<'_>) -> Result<Self>;

    /// Builds the stage again from the current shader sources of the device. By default, this replaces the whole stage. A stage may instead keep
    /// parts that are expensive to make and do not depend on shaders, such as the textures of the page cache.
    ///
    /// # Errors
    /// When a shader does not compile or a pipeline cannot be created.
    fn rebuilt(&self, build: Build<'_>) -> Result<Exchange<Self>> {
        let _ = self;
        let fresh = Self::build(build)?;
        Ok(Box::new(move |stage| *stage = fresh))
    }

    /// The declared modules that the stage compiles for this scene on this device.
    fn modules(build: Build<'_>) -> Vec<&'static ShaderModule> {
        let _ = build;
        Self::DECLARATION.modules.to_vec()
    }

    /// The numbers that the stage reports about the last frame; `None` = it reports no numbers.
    fn section(&self) -> Option<Section> {
        None
    }
}

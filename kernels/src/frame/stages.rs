//! The table of the stages that a renderer builds from shaders, in the order of the frame.

use super::FrameSettings;
use crate::base::error::{Error, Result};
use crate::base::section::Section;
use crate::base::wgsl::Wgsl;
use crate::classification::Classification;
use crate::composition::Composition;
use crate::display::Display;
use crate::geometry::Geometry;
use crate::gpu::ShaderModule;
use crate::inspect::Inspect;
use crate::lighting::Lighting;
use crate::motion;
use crate::occlusion::Occlusion;
use crate::settings::{Holds, Part as _, Setting};
use crate::shading::Shading;
use crate::stage::{Build, Canvas, Declaration, Exchange, Stage};
use crate::view::normals::NormalEncoding;
use crate::virtual_texture::VirtualTexture;

macro_rules! stages {
    ($($(#[$doc:meta])* $field:ident: $stage:ty,)*) => {
        /// The stages of the table, built for one renderer.
        pub(super) struct Stages {
            $($(#[$doc])* pub(super) $field: $stage,)*
        }

        /// The settings of each stage of the table, by the name of the stage; `()` = the stage has no settings.
        #[derive(Clone, Copy, Debug, Default, PartialEq)]
        pub struct StageSettings {
            $(#[doc = concat!("Settings of the stage `", stringify!($field), "`.")] pub $field: <$stage as Stage>::Settings,)*
        }

        $(
            impl Holds<$stage> for FrameSettings {
                type Part = <$stage as Stage>::Settings;

                fn part(&self) -> &Self::Part {
                    &self.stages.$field
                }

                fn part_mut(&mut self) -> &mut Self::Part {
                    &mut self.stages.$field
                }
            }
        )*

        /// The settings of all stages of the table, in the order of the frame.
        pub fn stage_settings() -> impl Iterator<Item = &'static Setting<FrameSettings>> {
            [$(<$stage as Stage>::Settings::table::<$stage, FrameSettings>()),*].into_iter().flatten()
        }

        /// The targets of each stage of the table, by the name of the stage; `()` = the stage has no targets that depend on the picture's size.
        pub struct Targets {
            $(#[doc = concat!("Targets of the stage `", stringify!($field), "`.")] pub $field: <$stage as Stage>::Targets,)*
            size: [u32; 2],
            normals: wgpu::TextureFormat,
        }

        impl Targets {
            /// Allocates all targets.
            pub(super) fn new(canvas: Canvas<'_>) -> Targets {
                Targets { $($field: <$stage>::targets(canvas),)* size: canvas.size, normals: canvas.normals.format() }
            }

            /// Whether these targets fit a picture of this size and encoding of normals.
            pub(super) fn fit(&self, size: [u32; 2], normals: NormalEncoding) -> bool {
                self.size == size && self.normals == normals.format()
            }
        }

        /// The declaration of each stage of the table, in the order of the frame.
        pub const DECLARATIONS: &[&Declaration] = &[$(&<$stage>::DECLARATION),*];

        impl Stages {
            /// Builds all stages.
            ///
            /// # Errors
            /// When a shader does not compile.
            pub(super) fn build(build: Build<'_>) -> Result<Stages> {
                Ok(Stages { $($field: <$stage>::build(build)?),* })
            }

            /// Rebuilds the stages that use one of the files `changed`. `Rebuilt::take` then puts the rebuilt stages in the place of the old stages.
            ///
            /// # Errors
            /// When a shader does not compile, or no pipeline can be built from it. Then nothing has changed.
            pub(super) fn rebuilt(&self, build: Build<'_>, changed: &[String]) -> Result<Rebuilt> {
                let mut rebuilt = Rebuilt { names: Vec::new(), exchanges: Vec::new() };
                $(rebuilt.stage(build, changed, &self.$field, |stages| &mut stages.$field)?;)*
                Ok(rebuilt)
            }

            /// Numbers of the last frame, stage by stage.
            pub(super) fn sections(&self) -> Vec<Section> {
                [$(self.$field.section()),*].into_iter().flatten().collect()
            }
        }
    };
}

stages! {
    /// Writes depth, stencil, classification mask and normals.
    geometry: Geometry,
    /// Drops hidden patches between the phases of `geometry`.
    occlusion: Occlusion,
    /// Writes the tile list of each variant.
    classification: Classification,
    /// Requests and renders pages of the virtual texture, and writes the page table.
    virtual_texture: VirtualTexture,
    /// Writes the G-buffer.
    shading: Shading,
    /// Writes linear HDR radiance.
    lighting: Lighting,
    /// Writes tone-mapped sRGB, on request.
    display: Display,
    /// Writes position, derivatives and splat texels of each pixel, on request.
    inspect: Inspect,
    /// Composes the picture of each requested set of flavours.
    composition: Composition,
}

/// Modules of the reprojection pass, which finds for each pixel the pixel of the previous frame that shows the same surface point. The pass is not in
/// the table. It is compiled when [`Links`](crate::motion::Links) or a meter is made.
pub const FOLLOWING: [&ShaderModule; 1] = [&motion::MODULE];

/// The WGSL files of the stages of the table and of [`FOLLOWING`], each once, in alphabetical order of their paths.
pub fn shader_files() -> Vec<&'static Wgsl> {
    let modules = DECLARATIONS.iter().flat_map(|stage| stage.modules.iter().copied()).chain(FOLLOWING);
    let mut files: Vec<&Wgsl> = modules.flat_map(ShaderModule::files).collect();
    files.sort_by_key(|file| file.path);
    files.dedup_by_key(|file| file.path);
    files
}

/// Stages that were rebuilt.
pub(super) struct Rebuilt {
    /// Names of the rebuilt stages, in the order of the frame.
    pub(super) names: Vec<&'static str>,
    exchanges: Vec<Exchange<Stages>>,
}

impl Rebuilt {
    fn stage<S: Stage>(&mut self, build: Build<'_>, changed: &[String], stage: &S, place: fn(&mut Stages) -> &mut S) -> Result<()> {
        let touched = touched(&S::modules(build), changed);
        if touched.is_empty() {
            return Ok(());
        }
        let (made, complaint) = build.gpu.caught(|| stage.rebuilt(build));
        let exchange = made?;
        if let Some(what) = complaint {
            // The module is valid, but no pipeline can be built from it, for example because a binding is wrong. Such an error has no line number.
            return Err(Error::Gpu(format!("shader {}: {}: {what}", S::DECLARATION.name, touched.join(", "))));
        }
        self.names.push(S::DECLARATION.name);
        self.exchanges.push(Box::new(move |stages| exchange(place(stages))));
        Ok(())
    }

    /// Puts the rebuilt stages in the place of the old stages.
    pub(super) fn take(self, stages: &mut Stages) {
        for exchange in self.exchanges {
            exchange(stages);
        }
    }
}

/// Returns the changed files that at least one of the modules uses.
pub(super) fn touched<'c>(modules: &[&ShaderModule], changed: &'c [String]) -> Vec<&'c str> {
    let files: Vec<&Wgsl> = modules.iter().flat_map(|module| module.files()).collect();
    changed.iter().map(String::as_str).filter(|path| files.iter().any(|file| file.path == *path)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_is_listed_once() {
        let paths: Vec<&str> = shader_files().iter().map(|file| file.path).collect();
        assert!(paths.windows(2).all(|pair| pair[0] < pair[1]), "{paths:?}");
        for path in ["view/frame.wgsl", "shared/hash.wgsl", "shared/signal.wgsl", "classification/plain.wgsl", "motion/motion.wgsl"] {
            assert!(paths.contains(&path), "{path}");
        }
    }

    #[test]
    fn only_stages_that_use_a_file_are_touched_by_it() {
        let changed = ["lighting/lighting.wgsl".to_owned(), "nowhere.wgsl".to_owned()];
        let names: Vec<&str> = DECLARATIONS.iter().filter(|s| !touched(s.modules, &changed).is_empty()).map(|s| s.name).collect();
        assert_eq!(names, ["lighting"]);
    }
}

//! The table of stages: everything that is built from shaders and drawn with, in the order of the frame.

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
use crate::shading::Shading;
use crate::stage::{Build, Declaration, Exchange, Stage};
use crate::virtual_texture::VirtualTexture;

macro_rules! stages {
    ($($(#[$doc:meta])* $field:ident: $stage:ty,)*) => {
        /// Every stage of a renderer.
        pub(super) struct Stages {
            $($(#[$doc])* pub(super) $field: $stage,)*
        }

        /// What every stage declares of itself, in the order of the frame.
        pub const DECLARATIONS: &[&Declaration] = &[$(&<$stage>::DECLARATION),*];

        impl Stages {
            /// Builds all of them.
            ///
            /// # Errors
            /// When a shader does not compile.
            pub(super) fn build(build: Build<'_>) -> Result<Stages> {
                Ok(Stages { $($field: <$stage>::build(build)?),* })
            }

            /// Builds again the stages that use one of the files `changed`; the result puts them in their places.
            ///
            /// # Errors
            /// When one does not compile, or no pipeline comes of it. Then nothing has changed.
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
    /// Depth, stencil, classification mask, normals.
    geometry: Geometry,
    /// Tiles per variant.
    classification: Classification,
    /// Pages.
    virtual_texture: VirtualTexture,
    /// G-buffer.
    shading: Shading,
    /// Linear HDR.
    lighting: Lighting,
    /// Tone-mapped sRGB, where a picture is shown.
    display: Display,
    /// Numbers of each pixel, on request.
    inspect: Inspect,
    /// Pictures of any set of flavours, on request.
    composition: Composition,
}

/// Modules that passes outside of the table are made of: they are compiled when somebody wants to follow frames.
pub const FOLLOWING: [&ShaderModule; 1] = [&motion::MODULE];

/// Every WGSL file that a renderer is made of, each once, in alphabetical order of their paths.
pub fn shader_files() -> Vec<&'static Wgsl> {
    let modules = DECLARATIONS.iter().flat_map(|stage| stage.modules.iter().copied()).chain(FOLLOWING);
    let mut files: Vec<&Wgsl> = modules.flat_map(ShaderModule::files).collect();
    files.sort_by_key(|file| file.path);
    files.dedup_by_key(|file| file.path);
    files
}

/// Stages that were built again.
pub(super) struct Rebuilt {
    /// Their names, in the order of the frame.
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
            // The module is sound, but no pipeline comes of it: an entry point, a binding, a target. That has no line.
            return Err(Error::Gpu(format!("shader {}: {}: {what}", S::DECLARATION.name, touched.join(", "))));
        }
        self.names.push(S::DECLARATION.name);
        self.exchanges.push(Box::new(move |stages| exchange(place(stages))));
        Ok(())
    }

    /// Puts them in their places.
    pub(super) fn take(self, stages: &mut Stages) {
        for exchange in self.exchanges {
            exchange(stages);
        }
    }
}

/// The changed files that some of the modules have.
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

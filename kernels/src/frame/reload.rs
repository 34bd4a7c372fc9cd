//! Rebuilds shaders in a renderer that continues to draw. Either all stages that a change affects are rebuilt, or none.

use std::sync::Arc;

use crate::base::error::{Error, Result};
use crate::frame::Renderer;
use crate::frame::stages::{FOLLOWING, Rebuilt, touched};
use crate::gpu::Sources;
use crate::motion::Links;

/// What a reload did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReloadReport {
    /// Files whose text changed, by their path in `kernels/src`, in alphabetical order.
    pub files: Vec<String>,
    /// Stages that were rebuilt, in the order of the frame. Empty if no stage of this scene uses the files on this device.
    pub stages: Vec<&'static str>,
}

impl Renderer<'_> {
    /// Rebuilds the stages that use a file whose text differs in `sources`, and draws with them from now on. World, nodes and textures stay; pages of
    /// the virtual texture are rendered again if their shader changed. Passes that follow frames (those of [`Renderer::meter`]) are compiled from
    /// `sources` the next time that they are made.
    ///
    /// The shading pipelines of the displayed view are built at once. The others are built when a frame needs them, which may fail then.
    ///
    /// # Errors
    /// When a shader does not compile (with file, line and message), or no pipeline can be built from it (with the files and the message). In both
    /// cases, this renderer and its device are unchanged.
    pub fn reload_shaders(&mut self, sources: Sources) -> Result<ReloadReport> {
        let files = self.sources.differences(&sources);
        if files.is_empty() {
            return Ok(ReloadReport::default());
        }
        let sources = Arc::new(sources);
        let before = self.gpu.override_shaders(sources.clone());
        match self.rebuilt(&files) {
            Ok((rebuilt, mut stages)) => {
                stages.splice(0..0, rebuilt.names.iter().copied());
                rebuilt.take(&mut self.stages);
                // The targets hold results of the former stages.
                self.drawn = None;
                self.sources = sources;
                Ok(ReloadReport { files, stages })
            }
            Err(error) => {
                self.gpu.override_shaders(before);
                Err(error)
            }
        }
    }

    /// Rebuilds the stages of the table that use a file of `changed`. Also returns the names of the passes outside the table that use such a file.
    fn rebuilt(&self, changed: &[String]) -> Result<(Rebuilt, Vec<&'static str>)> {
        let rebuilt = self.stages.rebuilt(self.build(), changed)?;
        let mut others = Vec::new();
        let files = touched(&FOLLOWING, changed);
        if !files.is_empty() {
            // Compiled only to detect errors. Code that follows frames compiles the pass again.
            let (links, complaint) = self.gpu.caught(|| Links::new(&self.gpu, &self.frame_layout, [1, 1]));
            drop(links?);
            if let Some(what) = complaint {
                return Err(Error::Gpu(format!("shader links: {}: {what}", files.join(", "))));
            }
            others.push("links");
        }
        Ok((rebuilt, others))
    }
}

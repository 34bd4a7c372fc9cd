//! Shaders built again in a renderer that goes on drawing: all that a change touches, or none.

use std::sync::Arc;

use crate::base::error::Result;
use crate::frame::Renderer;
use crate::frame::stages::{FOLLOWING, Rebuilt, touched};
use crate::gpu::Sources;
use crate::motion::Links;

/// What a reload did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReloadReport {
    /// Files whose text changed, by their path in `kernels/src`, in alphabetical order.
    pub files: Vec<String>,
    /// Stages that were built anew, in the order of the frame. None if no stage of this scene uses the files on this device.
    pub stages: Vec<&'static str>,
}

impl Renderer<'_> {
    /// Builds the stages again that use a file whose text differs in `sources`, and draws with them from now on. World, nodes and textures stay; pages of
    /// the virtual texture are rendered again if their shader changed. Passes that follow a frame (those of [`Renderer::meter`]) are compiled from
    /// `sources` the next time that they are made.
    ///
    /// Of shading, the pipelines of the displayed view are built at once. The others are built when a frame wants them; that may fail then.
    ///
    /// # Errors
    /// When one does not compile: with file, line and message; or when no pipeline comes of one: with the files and message. Then nothing has changed, for
    /// this renderer and for its device.
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
                // The targets hold what the former stages made.
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

    /// The stages of the table that `changed` touches, and the names of those outside of it.
    fn rebuilt(&self, changed: &[String]) -> Result<(Rebuilt, Vec<&'static str>)> {
        let rebuilt = self.stages.rebuilt(self.build(), changed)?;
        let mut others = Vec::new();
        if !touched(&FOLLOWING, changed).is_empty() {
            // Made to see whether it compiles: whoever follows frames makes it again.
            let (links, complaint) = self.gpu.caught(|| Links::new(&self.gpu, &self.frame_layout, [1, 1]));
            drop(links?);
            if let Some(what) = complaint {
                return Err(crate::base::error::Error::Gpu(format!("shader links: {what}")));
            }
            others.push("links");
        }
        Ok((rebuilt, others))
    }
}

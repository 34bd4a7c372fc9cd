//! Rebuilds shaders in a renderer that continues to draw. Either all stages that a change affects are rebuilt, or none.

use std::sync::Arc;

use crate::base::error::{Error, Result};
use crate::frame::Renderer;
use crate::frame::stages::{FOLLOWING, Rebuilt, touched};
use crate::gpu::Sources;
use crate::motion::Links;

/// The result of a reload.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReloadReport {
    /// Files whose text changed, by their path in `kernels/src`, in alphabetical order.
    pub files: Vec<String>,
    /// Names of the stages that were rebuilt, in the order of the frame. The last name is `links` if the reprojection pass of [`Links`] uses one of
    /// the files. Empty if this renderer uses none of the files.
    pub stages: Vec<&'static str>,
}

impl Renderer<'_> {
    /// Rebuilds the stages that use a file whose text differs in `sources`. Later frames use the rebuilt stages. World, nodes and textures stay.
    /// Pages of the virtual texture are rendered again if their shader changed. Meters and [`Links`] that already exist keep their shaders; those
    /// that are made later are compiled from `sources`.
    ///
    /// If the shading stage is rebuilt, the shading pipelines of the displayed view are built at once. Other shading pipelines are built when a frame
    /// needs them. If such a later build fails, the frame fails.
    ///
    /// # Errors
    /// When a shader does not compile (the error gives file, line and message), or no pipeline can be built from it (the error gives the changed
    /// files and the message). In both cases, this renderer and its device are unchanged.
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
            // The pass is compiled only to detect errors. Each meter and each `Links` compiles it again.
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

//! Shaders built anew in a renderer that goes on: those of a change all, or none.

use std::sync::Arc;

use crate::base::error::{Error, Result};
use crate::classification::{self, Classification};
use crate::composition::{self, Composition};
use crate::frame::Renderer;
use crate::geometry::{self, Geometry};
use crate::gpu::{Gpu, Sources, shader_path};
use crate::inspect::{self, Inspect};
use crate::lighting::{self, Lighting};
use crate::motion;
use crate::motion::Links;
use crate::shading::{self, Shading};
use crate::virtual_texture;

/// What a reload did.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReloadReport {
    /// Files whose text changed, by their path in `kernels/src`, in alphabetical order.
    pub files: Vec<String>,
    /// Stages that were built anew, in the order of the frame. None if no stage of this scene uses the files on this device.
    pub stages: Vec<&'static str>,
}

/// Every file (name, embedded text) that the stages of a frame are made of, each once.
pub fn shader_files() -> Vec<(&'static str, &'static str)> {
    let stages = [
        geometry::files(),
        classification::files(false),
        classification::files(true),
        virtual_texture::request_files(),
        virtual_texture::page_files(),
        shading::files(),
        lighting::files(),
        inspect::files(),
        composition::files(),
        motion::files(),
    ];
    let mut all: Vec<(&str, &str)> = Vec::new();
    for file in stages.into_iter().flatten() {
        if !all.contains(&file) {
            all.push(file);
        }
    }
    all
}

/// Stages built anew; what is absent stays as it is.
struct Rebuilt {
    geometry: Option<Geometry>,
    virtual_texture: Option<virtual_texture::Passes>,
    classification: Option<Classification>,
    shading: Option<Shading>,
    lighting: Option<Lighting>,
    inspect: Option<Inspect>,
    composition: Option<Composition>,
}

/// Builds the stages that a change of files touches.
struct Builder<'b> {
    gpu: &'b Gpu,
    changed: &'b [String],
    built: Vec<&'static str>,
}

impl Builder<'_> {
    /// The stage, if one of its files changed.
    fn stage<T>(&mut self, name: &'static str, files: &[(&str, &str)], make: impl FnOnce() -> Result<T>) -> Result<Option<T>> {
        let uses = |path: &String| files.iter().any(|(file, _)| shader_path(file) == *path);
        let touched: Vec<&str> = self.changed.iter().filter(|path| uses(path)).map(String::as_str).collect();
        if touched.is_empty() {
            return Ok(None);
        }
        let (made, complaint) = self.gpu.caught(make);
        let made = made?;
        if let Some(what) = complaint {
            // The module is sound, but no pipeline comes of it: an entry point, a binding, a target. That has no line.
            return Err(Error::Gpu(format!("shader {name}: {}: {what}", touched.join(", "))));
        }
        self.built.push(name);
        Ok(Some(made))
    }
}

impl Renderer<'_> {
    /// Builds the stages anew that use a file whose text differs in `sources`, and draws with them from now on. What is costly stays: world, nodes,
    /// textures; virtual-texture pages are rendered again if their shader changed. Passes that follow a frame (those of
    /// [`Renderer::meter`]) are compiled from `sources` the next time that they are made.
    ///
    /// Of shading the pipelines of the last frame are built at once; others when they are wanted, which then may fail.
    ///
    /// # Errors
    /// When one does not compile: with file, line and message; or when no pipeline comes of one: with the files and message. Then nothing has changed, for this renderer and for its device.
    pub fn reload_shaders(&mut self, sources: Sources) -> Result<ReloadReport> {
        let files = self.sources.differences(&sources);
        if files.is_empty() {
            return Ok(ReloadReport::default());
        }
        let sources = Arc::new(sources);
        let before = self.gpu.override_shaders(sources.clone());
        match self.rebuilt(&files) {
            Ok((rebuilt, stages)) => {
                self.take(rebuilt);
                self.sources = sources;
                Ok(ReloadReport { files, stages })
            }
            Err(error) => {
                self.gpu.override_shaders(before);
                Err(error)
            }
        }
    }

    fn rebuilt(&self, changed: &[String]) -> Result<(Rebuilt, Vec<&'static str>)> {
        let (gpu, frame, terrain) = (self.gpu, &self.frame_layout, &self.terrain);
        let modulated = self.requirements.colour_modulation;
        let subgroups = gpu.features.contains(wgpu::Features::SUBGROUP);
        let mut page_files = virtual_texture::request_files();
        page_files.extend(virtual_texture::page_files());
        let mut builder = Builder { gpu, changed, built: Vec::new() };
        let rebuilt = Rebuilt {
            geometry: builder.stage("geometry", &geometry::files(), || Geometry::new(gpu, frame, terrain, self.requirements.holes))?,
            classification: builder
                .stage("classification", &classification::files(subgroups), || Classification::new(gpu, frame, self.options.tile))?,
            virtual_texture: if self.virtual_texture.is_required() {
                builder.stage("virtual texture", &page_files, || virtual_texture::Passes::new(gpu, frame, terrain, modulated))?
            } else {
                None
            },
            shading: builder.stage("shading", &shading::files(), || self.shading.rebuilt(gpu, frame, terrain, &self.keys))?,
            lighting: builder.stage("lighting", &lighting::files(), || Lighting::new(gpu, frame))?,
            inspect: builder.stage("inspect", &inspect::files(), || Inspect::new(gpu, frame, terrain))?,
            composition: builder.stage("composition", &composition::files(), || Composition::new(gpu, frame, modulated))?,
        };
        let links = builder.stage("links", &motion::files(), || Links::new(gpu, frame, [1, 1]))?;
        // It was made to see whether it compiles: who follows frames makes it anew.
        drop(links);
        Ok((rebuilt, builder.built))
    }

    fn take(&mut self, rebuilt: Rebuilt) {
        fn replace<T>(old: &mut T, new: Option<T>) {
            if let Some(new) = new {
                *old = new;
            }
        }
        replace(&mut self.geometry, rebuilt.geometry);
        replace(&mut self.classification, rebuilt.classification);
        if let Some(passes) = rebuilt.virtual_texture {
            self.virtual_texture.replace_passes(passes);
        }
        replace(&mut self.shading, rebuilt.shading);
        replace(&mut self.lighting, rebuilt.lighting);
        replace(&mut self.inspect, rebuilt.inspect);
        replace(&mut self.composition, rebuilt.composition);
        // What the targets hold was made by the old ones.
        self.last = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_file_is_listed_once_and_by_its_path() {
        let files = shader_files();
        let mut paths: Vec<String> = files.iter().map(|(name, _)| shader_path(name)).collect();
        paths.sort();
        let count = paths.len();
        paths.dedup();
        assert_eq!(paths.len(), count);
        for stage in ["frame.wgsl", "shared/hash.wgsl", "shared/signal.wgsl", "classification/plain.wgsl", "classification/subgroup.wgsl"] {
            assert!(paths.iter().any(|path| path == stage), "{stage}");
        }
        assert!(paths.iter().all(|path| path.ends_with(".wgsl")), "{paths:?}");
    }
}

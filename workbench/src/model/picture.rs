//! The requests for pictures that the window sends to the drawing thread, and the pictures and reports that the thread sends back.

use std::sync::Arc;
use std::time::Duration;

use kernels::base::progress::Progress;
use kernels::frame::RenderRequest;
use kernels::frame::picture::Picture;
use kernels::view::camera::Pose;

use super::compare::Compare;
use super::display::Legend;
use super::metrics::{LAYERS, Metrics, Reading};
use super::settings::Settings;
use super::viewpoint::Viewpoint;
use kernels::oracle::Pixel;

/// A request for a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Wish {
    /// The settings of A (see [`super::compare`]).
    pub settings: Settings,
    /// The way in which A and B are shown, and the settings of B.
    pub compare: Compare,
    /// Settings of the live metrics.
    pub metrics: Metrics,
    /// The viewpoint.
    pub viewpoint: Viewpoint,
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// The frame number. Noise and camera paths depend on it, and not on a clock.
    pub frame: u32,
    /// Position of the inspected pixel, as shares of the picture; `None` = no pixel is inspected.
    pub probe: Option<[f32; 2]>,
    /// Whether the depth layer is needed to find places on the ground, for the brush or for the orbited place.
    pub seeks: bool,
    /// The pose for which nodes and patches are culled while culling is frozen; `None` = the pose of the viewpoint.
    pub culled_from: Option<Pose>,
    /// Number that identifies the loading of the scene. If this number changes, the scene and the files that the scene names are loaded again, even
    /// if the scene is equal to the previous one.
    pub opened: u32,
}

impl Wish {
    /// Whether live metrics are computed from the pictures.
    pub fn is_measured(&self) -> bool {
        self.metrics.on || self.settings.layer.is_measured()
    }

    /// The layers that are needed in addition to the layer on screen.
    pub(crate) fn layers(&self) -> Vec<&'static str> {
        let measured: &[&str] = if self.is_measured() { &LAYERS } else { &[] };
        let sought: &[&str] = if self.seeks { &["depth"] } else { &[] };
        [measured, sought].concat()
    }

    /// The request for the picture of A, with these layers in addition to the layer on screen.
    pub(crate) fn request(&self, pose: Pose, layers: &[&str]) -> RenderRequest {
        self.settings.request(pose, self.size, self.frame, layers).with(|r| r.geometry.culled_from = self.culled_from)
    }
}

/// B: the second picture of a comparison.
pub struct Second {
    /// The settings that B was drawn with.
    pub settings: Settings,
    /// sRGB, row by row from the top.
    pub texels: Vec<[u8; 3]>,
    /// The meanings of the colours of the picture.
    pub legend: Legend,
    /// The absolute difference from A in luminance, as colours; `None` = it is not shown.
    pub difference: Option<Vec<[u8; 3]>>,
    /// Root mean squared difference between A and B in lit linear colour, over the pixels that show terrain.
    pub rmse: f64,
    /// Mean of A - B in the luminance of the lit linear colour, over the pixels that show terrain.
    pub mean: f64,
    /// Largest absolute difference between A and B in the luminance of the lit linear colour, over the pixels that show terrain.
    pub largest: f64,
    /// The rendered picture: linear radiance, layers, pass times and counts.
    pub picture: Picture,
}

/// A picture that was drawn.
pub struct Shown {
    /// The request for this picture.
    pub wish: Wish,
    /// The pose of the camera.
    pub pose: Pose,
    /// sRGB, row by row from the top.
    pub texels: Vec<[u8; 3]>,
    /// The meanings of the colours of the picture.
    pub legend: Legend,
    /// Whether the picture is a first look: a preview that is drawn with small textures on coarse terrain.
    pub draft: bool,
    /// The rendered picture: linear radiance, layers, pass times and counts.
    pub picture: Picture,
    /// B; `None` = it was not requested, it could not be drawn (see [`Shown::alone`]), or the picture is a first look.
    pub second: Option<Second>,
    /// The inspected pixel of A; `None` = no pixel was inspected, the inspected pixel shows sky, or the picture is a first look.
    pub pixel: Option<Pixel>,
    /// Why B could not be drawn, in one line; `None` = it was drawn or not requested, or the picture is a first look.
    pub alone: Option<String>,
    /// Elevation of the ground below the camera, metres.
    pub ground_m: f64,
    /// Elevation of the ground below the pose at which culling is frozen, metres; `None` = culling is not frozen.
    pub culled_ground_m: Option<f64>,
    /// Layout of the quadtree in the world.
    pub layout: kernels::world::Layout,
    /// Mean linear albedo of each material of the requested scene, tint included.
    pub mean_albedos: Vec<[f32; 3]>,
    /// The live metrics of the last frames, the newest last; empty if live metrics are not computed.
    pub readings: Vec<Reading>,
    /// Number of the shaders that drew the picture. Shaders get a new number when they are reloaded, when a scene is opened, and on a new device.
    pub shaders: u64,
    /// Bytes that are allocated on the device for buffers and textures; `None` = not known.
    pub device_bytes: Option<u64>,
    /// Time from the start of drawing to the finished texels of A and B. It includes the inspected pixel and the live metrics.
    pub took: Duration,
}

impl Shown {
    /// Mean linear albedo of the material with this name, tint included; `None` = the scene of the picture has no such material.
    pub fn mean_albedo(&self, material: &str) -> Option<[f32; 3]> {
        let place = self.wish.settings.scene.materials.iter().position(|known| known.name == material)?;
        self.mean_albedos.get(place).copied()
    }
}

/// The device that draws.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Adapter {
    /// Name given by the driver.
    pub name: String,
    /// Whether it is a software adapter, a driver that runs on the processor. Of its times, only ratios are meaningful.
    pub software: bool,
    /// Why scenes are drawn without anisotropic filtering; `None` = they are drawn with it.
    pub without_anisotropy: Option<&'static str>,
}

/// The state that the drawing thread reports.
#[derive(Clone, Default)]
pub struct News {
    /// The newest picture.
    pub shown: Option<Arc<Shown>>,
    /// The device.
    pub adapter: Option<Adapter>,
    /// Progress of a long task.
    pub progress: Option<Progress>,
    /// Progress of compiling shaders in advance: the number of shaders that are compiled or were skipped after an error, and the number of all
    /// shaders. Both are 0 if no shader is to be compiled in advance.
    pub warm: [usize; 2],
    /// Why the last request was not fulfilled, or why the thread cannot draw at all; one line.
    pub failure: Option<String>,
    /// [`Wish::opened`] of the last scene that was loaded completely, including all files that it names; `None` = no scene has been loaded yet.
    pub loaded: Option<u32>,
    /// [`Wish::opened`] of the last scene, if it could not be loaded, or if the devices that drew it were lost one after another. `failure` says why.
    /// `None` = the scene was loaded, or is being loaded.
    pub unloaded: Option<u32>,
    /// Why the shaders in the watched folder are not in use, in one line. If a shader does not compile, the text gives file, line number and message,
    /// and the last shaders that compiled stay in use. If the device failed with the shaders of the folder, the shaders of the program are used.
    pub shader_error: Option<String>,
    /// Whether shaders are in use that differ from those of the program.
    pub shaders_edited: bool,
}

//! Pictures as they are wanted and as they are drawn: what the window asks of the drawing thread, and what comes back.

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

/// A picture that is wanted.
#[derive(Clone, Debug, PartialEq)]
pub struct Wish {
    /// How it looks: A.
    pub settings: Settings,
    /// What it is held against.
    pub compare: Compare,
    /// What is measured of it.
    pub metrics: Metrics,
    /// From where.
    pub viewpoint: Viewpoint,
    /// Pixels.
    pub size: [u32; 2],
    /// The only time there is.
    pub frame: u32,
    /// Place of a pixel that is taken apart, in shares of the picture; `None` = none is.
    pub probe: Option<[f32; 2]>,
    /// Whether places on the ground are looked for, by the picture's depth: for a brush, and for what is orbited.
    pub seeks: bool,
    /// Where nodes and patches are selected from in place of the viewpoint; `None` = from there.
    pub culled_from: Option<Pose>,
    /// Number of the opening that the scene comes from: another one is loaded anew, with the files that it names, also if the scene is equal.
    pub opened: u32,
}

impl Wish {
    /// Whether pictures are followed from frame to frame.
    pub fn is_measured(&self) -> bool {
        self.metrics.on || self.settings.layer.is_measured()
    }

    /// Layers that are wanted besides the one on show.
    pub(crate) fn layers(&self) -> Vec<&'static str> {
        let measured: &[&str] = if self.is_measured() { &LAYERS } else { &[] };
        let sought: &[&str] = if self.seeks { &["depth"] } else { &[] };
        [measured, sought].concat()
    }

    /// The picture of A, with these layers besides the one on show.
    pub(crate) fn request(&self, pose: Pose, layers: &[&str]) -> RenderRequest {
        self.settings.request(pose, self.size, self.frame, layers).with(|r| r.geometry.culled_from = self.culled_from)
    }
}

/// The picture compared with.
pub struct Second {
    /// What it was drawn by.
    pub settings: Settings,
    /// sRGB, row by row from the top.
    pub texels: Vec<[u8; 3]>,
    /// What its colours mean.
    pub legend: Legend,
    /// How much it differs from the first, as colours, where that is shown.
    pub difference: Option<Vec<[u8; 3]>>,
    /// Root mean squared difference of lit linear colour over terrain.
    pub rmse: f64,
    /// Mean of A less B over terrain, luminance.
    pub mean: f64,
    /// Largest absolute difference over terrain, luminance.
    pub largest: f64,
    /// The picture and its numbers.
    pub picture: Picture,
}

/// A picture that was drawn.
pub struct Shown {
    /// As it was wanted.
    pub wish: Wish,
    /// Where the camera stood.
    pub pose: Pose,
    /// sRGB, row by row from the top.
    pub texels: Vec<[u8; 3]>,
    /// What its colours mean.
    pub legend: Legend,
    /// Whether it is a first look, which shows only where everything is.
    pub draft: bool,
    /// The picture and its numbers.
    pub picture: Picture,
    /// B, if it was wanted.
    pub second: Option<Second>,
    /// The pixel that was to be taken apart, of A; `None` = none was, or it is sky.
    pub pixel: Option<Pixel>,
    /// Why there is no B though it was wanted; one line.
    pub alone: Option<String>,
    /// Elevation of the ground below the camera, metres.
    pub ground_m: f64,
    /// Elevation of the ground below the pose that culling is frozen at, metres; `None` = it is not frozen.
    pub culled_ground_m: Option<f64>,
    /// How the quadtree lies over the world.
    pub layout: kernels::world::Layout,
    /// Mean linear albedo of each material of the wish's scene, tint included.
    pub mean_albedos: Vec<[f32; 3]>,
    /// What was measured since the numbers were begun, the newest last.
    pub readings: Vec<Reading>,
    /// From the wish to the texels.
    pub took: Duration,
}

impl Shown {
    /// Mean linear albedo of a material of this name, tint included; `None` = the picture's scene has none.
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
    /// Whether it is a processor that only behaves as a graphics card: its times are good for ratios only.
    pub software: bool,
    /// Why scenes are drawn without anisotropic filtering, if they are.
    pub without_anisotropy: Option<&'static str>,
}

/// What the thread has to say.
#[derive(Clone, Default)]
pub struct News {
    /// The last picture.
    pub shown: Option<Arc<Shown>>,
    /// The device.
    pub adapter: Option<Adapter>,
    /// What is being done that takes a while.
    pub progress: Option<Progress>,
    /// Shaders that are compiled, of those that a click may ask for.
    pub warm: [usize; 2],
    /// Why the last wish was not fulfilled; one line.
    pub failure: Option<String>,
    /// Number of the opening whose scene was loaded last, with all that it names.
    pub loaded: Option<u32>,
    /// Number of the opening whose scene could not be loaded, if that was the last one; the failure says why.
    pub unloaded: Option<u32>,
    /// Why the shaders of the folder are not those that draw; one line with file, line and message. The last that compiled draw.
    pub shader_error: Option<String>,
    /// Whether other shaders draw than the program's own.
    pub shaders_edited: bool,
}

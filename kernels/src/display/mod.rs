//! Display: tone-maps linear HDR radiance to sRGB, for people to look at.
//!
//! The mapping has three steps. The radiance is multiplied by 2^exposure, with the exposure in stops. A [`ToneCurve`] maps the product to the range
//! of a screen, 0..=1; values outside this range are clipped. The values are then encoded as sRGB (IEC 61966-2-1). The metrics of the lit picture use
//! the same function (`encode.wgsl`), without the rounding to 8 bits.
//! Reads the linear image. Writes RGBA8Unorm: sRGB-encoded colour, and the alpha of the linear image (1 = terrain). One full-screen triangle.
//! Source: Reinhard et al. 2002, *Photographic Tone Reproduction for Digital Images*, equation 4.

use bytemuck::{Pod, Zeroable, bytes_of};

use crate::base::colour::LUMINANCE;
use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::gpu::bindings::{Binding, FLAT, view};
use crate::gpu::uses::{PassUse, TargetUse};
use crate::gpu::{Gpu, Recording, ShaderModule};
use crate::settings::{Home, Kind, Listing, Range, named, table};
use crate::shared;
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::view;

pub mod reference;

/// Format of the displayed picture.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Luminance, after exposure, that [`ToneCurve::Reinhard`] maps to 1. Channels that exceed 1 after the curve are clipped.
pub const WHITE: f64 = 4.0;
/// Limits of the exposure: the smallest and the largest accepted value, stops.
pub const STOPS: [f64; 2] = [-16.0, 16.0];

/// How radiance is mapped to what a screen can show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ToneCurve {
    /// Reinhard's curve on luminance with a white point of [`WHITE`]. It keeps the ratios of the colour channels; channels above 1 are clipped
    /// afterwards.
    #[default]
    Reinhard,
    /// No curve: radiance above 1, after exposure, is clipped.
    Clip,
}

impl ToneCurve {
    /// All tone curves.
    pub const ALL: [ToneCurve; 2] = [ToneCurve::Reinhard, ToneCurve::Clip];

    /// The curve's number in shaders.
    pub const fn code(self) -> u32 {
        self as u32
    }

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            ToneCurve::Reinhard => "reinhard",
            ToneCurve::Clip => "clip",
        }
    }
}

named!(ToneCurve);

const DISPLAY: Listing = Listing::new("Display", &[Home::Definition, Home::Option, Home::Workbench]);

table! {
    /// How a picture is shown to people.
    #[derive(Copy)]
    Exposure as "frame", {
        /// Exposure of the picture that people see: radiance is multiplied by 2 to this power. It affects the metrics of the lit picture in
        /// experiments, but neither metrics of albedo, nor OpenEXR files, nor the differences of A and B in the workbench.
        exposure: f64 = 0.0, "stops", Kind::Number(Range::new(STOPS[0], STOPS[1])), DISPLAY.slider("Exposure", -6.0, 6.0);
        /// Curve that maps radiance, after exposure, to the screen. `reinhard`: Reinhard's curve on luminance, with white at 4. `clip`: no curve;
        /// values above 1 are clipped. It affects the metrics of the lit picture in experiments, but neither metrics of albedo, nor OpenEXR files,
        /// nor the differences of A and B in the workbench.
        tone_curve: ToneCurve = ToneCurve::Reinhard, "", Kind::Name(|| ToneCurve::ALL.map(ToneCurve::name).to_vec()), DISPLAY.shown("Tone curve");
    }
}

impl Exposure {
    /// Factor on radiance.
    pub fn factor(self) -> f64 {
        self.exposure.exp2()
    }
}

/// WGSL functions that map linear radiance to sRGB-encoded values.
pub static ENCODE: Wgsl = Wgsl::new("display/encode.wgsl", include_str!("encode.wgsl"), &[&shared::USABLE]).with(&[
    ("DISPLAY_REINHARD", Constant::U32(ToneCurve::Reinhard.code())),
    ("DISPLAY_WHITE", Constant::real(WHITE)),
    ("DISPLAY_RED", Constant::real(LUMINANCE[0])),
    ("DISPLAY_GREEN", Constant::real(LUMINANCE[1])),
    ("DISPLAY_BLUE", Constant::real(LUMINANCE[2])),
]);

static WGSL: Wgsl = Wgsl::new("display/display.wgsl", include_str!("display.wgsl"), &[&ENCODE, &view::FULL_SCREEN]);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("display", &[&WGSL]);

/// The uniforms of the pass; the layout matches `DisplayUniforms` in `encode.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct DisplayUniforms {
    pub exposure: f32,
    pub curve: u32,
    pub pad_0: u32,
    pub pad_1: u32,
}

impl DisplayUniforms {
    /// The uniforms for an exposure.
    #[allow(clippy::cast_possible_truncation, reason = "shaders compute in f32")]
    pub fn of(exposure: Exposure) -> DisplayUniforms {
        DisplayUniforms { exposure: exposure.factor() as f32, curve: exposure.tone_curve.code(), pad_0: 0, pad_1: 0 }
    }
}

/// The display pass.
pub struct Display {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl Stage for Display {
    const DECLARATION: Declaration = Declaration {
        name: "display",
        about: "Reads linear HDR radiance; writes tone-mapped sRGB",
        modules: &[&MODULE],
        passes: |_| {
            vec![PassUse {
                required: false,
                ..PassUse::new("display", 1, "only on request: a picture for people, as PNG or in the workbench")
            }]
        },
        targets: |_| vec![TargetUse::new("displayed picture", FORMAT)],
        ..Declaration::EMPTY
    };

    type Settings = Exposure;
    type Targets = wgpu::Texture;

    fn targets(canvas: Canvas<'_>) -> wgpu::Texture {
        canvas.gpu.target("displayed picture", canvas.size, FORMAT)
    }

    fn build(build: Build<'_>) -> Result<Display> {
        Display::new(build.gpu)
    }
}

impl Display {
    /// Compiles the pass.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu) -> Result<Display> {
        let shader = MODULE.compile(gpu)?;
        let layout = gpu.layout("display", wgpu::ShaderStages::FRAGMENT, &[Binding::Uniform, Binding::TextureLoaded(FLAT)]);
        let pipeline = gpu.full_screen("display", &shader, &[&layout], FORMAT);
        Ok(Display { pipeline, layout })
    }

    /// Records the pass.
    pub fn encode(&self, rec: &mut Recording<'_>, exposure: Exposure, image: &wgpu::Texture, displayed: &wgpu::Texture) {
        let uniforms = DisplayUniforms::of(exposure);
        let buffer = rec.gpu.buffer_with("display", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
        let resources = [buffer.as_entire_binding(), wgpu::BindingResource::TextureView(&view(image))];
        let group = rec.gpu.group("display", &self.layout, &resources);
        rec.full_screen("display", &self.pipeline, displayed, 0, &[&group]);
    }
}

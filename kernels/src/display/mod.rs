//! Display: tone-maps linear HDR radiance to sRGB, for people to look at.
//!
//! Exposure in stops multiplies radiance by 2^stops; a named tone curve maps it to 0..=1; sRGB encodes it (IEC 61966-2-1). Metrics never read the
//! result.
//! Reads the linear image. Writes RGBA8Unorm: sRGB codes, alpha as in the image (1 = terrain). One full-screen triangle.
//! Source: Reinhard et al. 2002, *Photographic Tone Reproduction for Digital Images*, equation 4.

use bytemuck::{Pod, Zeroable, bytes_of};

use crate::base::colour::LUMINANCE;
use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::gpu::bindings::{Binding, FLAT, view};
use crate::gpu::uses::{PassUse, TargetUse};
use crate::gpu::{Gpu, ShaderModule, Timer};
use crate::stage::{Build, Declaration, Stage};

pub mod reference;

/// Format of the displayed picture.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
/// Radiance that [`ToneCurve::Reinhard`] maps to white.
pub const WHITE: f64 = 4.0;
/// Smallest and largest exposure, stops.
pub const STOPS: [f64; 2] = [-16.0, 16.0];

/// How radiance is mapped to what a screen can show.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ToneCurve {
    /// Reinhard's curve on luminance with a white point of [`WHITE`]; colour is kept.
    #[default]
    Reinhard,
    /// Radiance above 1 is clipped.
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

/// How a picture is exposed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposure {
    /// Radiance is multiplied by 2^stops; [`STOPS`] is the range.
    pub stops: f64,
    /// The curve that maps radiance to the screen.
    pub curve: ToneCurve,
}

impl Exposure {
    /// Factor on radiance.
    pub fn factor(self) -> f64 {
        self.stops.exp2()
    }
}

static WGSL: Wgsl = Wgsl::new("display/display.wgsl", include_str!("display.wgsl"), &[]).with(&[
    ("DISPLAY_REINHARD", Constant::U32(ToneCurve::Reinhard.code())),
    ("DISPLAY_WHITE", Constant::real(WHITE)),
    ("DISPLAY_RED", Constant::real(LUMINANCE[0])),
    ("DISPLAY_GREEN", Constant::real(LUMINANCE[1])),
    ("DISPLAY_BLUE", Constant::real(LUMINANCE[2])),
]);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("display", &[&WGSL]);

/// The layout of `DisplayUniforms` in `display.wgsl`.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct DisplayUniforms {
    pub exposure: f32,
    pub curve: u32,
    pub pad_0: u32,
    pub pad_1: u32,
}

/// The pass.
pub struct Display {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

impl Stage for Display {
    const DECLARATION: Declaration = Declaration {
        name: "display",
        about: "Reads linear HDR radiance; makes tone-mapped sRGB",
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

    fn build(build: Build<'_>) -> Result<Display> {
        let gpu = build.gpu;
        let shader = MODULE.compile(gpu)?;
        let layout = gpu.layout("display", wgpu::ShaderStages::FRAGMENT, &[Binding::Uniform, Binding::TextureLoaded(FLAT)]);
        let pipeline = gpu.full_screen("display", &shader, &[&layout], FORMAT);
        Ok(Display { pipeline, layout })
    }
}

impl Display {
    /// Records the pass.
    #[allow(clippy::cast_possible_truncation, reason = "shaders compute in f32")]
    pub fn encode(
        &self,
        gpu: &Gpu,
        encoder: &mut wgpu::CommandEncoder,
        timer: &mut Timer,
        exposure: Exposure,
        image: &wgpu::Texture,
        displayed: &wgpu::Texture,
    ) {
        let uniforms = DisplayUniforms { exposure: exposure.factor() as f32, curve: exposure.curve.code(), pad_0: 0, pad_1: 0 };
        let buffer = gpu.buffer_with("display", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
        let resources = [buffer.as_entire_binding(), wgpu::BindingResource::TextureView(&view(image))];
        let group = gpu.group("display", &self.layout, &resources);
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some("display"),
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: &view(displayed),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT), store: wgpu::StoreOp::Store },
            })],
            timestamp_writes: timer.render("display"),
            ..Default::default()
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.draw(0..3, 0..1);
    }
}

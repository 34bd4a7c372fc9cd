//! Lighting: computes linear HDR radiance from the G-buffer, the sun and the sky.
//!
//! The sun is one directional light. The ground reflects it by a Lambertian diffuse term and a GGX specular term with height-correlated Smith
//! visibility. The radiance of the sky is linear in the sine of the elevation angle, so its irradiance follows from first-order spherical harmonics
//! in a closed formula. The specular reflection of the sky uses an analytic fit of the split-sum table (`shared::brdf`).
//! Reads the G-buffer and depth. Writes RGBA32Float: the radiance of terrain and sky; alpha is 1 on terrain and 0 on sky. One full-screen triangle.
//!
//! Limits: the sun casts no shadows, the terrain does not occlude the sky, and there is no indirect light.

use crate::base::error::Result;
use crate::base::wgsl::{Constant, Wgsl};
use crate::geometry;
use crate::gpu::bindings::{Binding, FLAT, aspect, view};
use crate::gpu::uses::{PassUse, TargetUse};
use crate::gpu::{Gpu, Recording, ShaderModule};
use crate::shading;
use crate::shared;
use crate::stage::{Build, Canvas, Declaration, Stage};
use crate::view;

pub mod reference;

/// Format of the linear HDR picture.
pub const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;

/// The lighting pass.
pub struct Lighting {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
}

/// WGSL functions that compute the radiance of the sky and of a point of the G-buffer.
pub static LIGHT: Wgsl = Wgsl::new("lighting/light.wgsl", include_str!("light.wgsl"), &[&view::WGSL, &shared::BRDF, &shared::OCTAHEDRAL])
    .with(&[("LIGHTING_F0", Constant::real(reference::F0))]);

static WGSL: Wgsl = Wgsl::new("lighting/lighting.wgsl", include_str!("lighting.wgsl"), &[&LIGHT, &view::WGSL, &view::FULL_SCREEN]);

/// The stage's shader module.
pub static MODULE: ShaderModule = ShaderModule::new("lighting", &[&WGSL]);

impl Stage for Lighting {
    const DECLARATION: Declaration = Declaration {
        passes: |_| vec![PassUse::new("lighting", 1, "sun and sky")],
        targets: |_| vec![TargetUse::new("linear image", FORMAT)],
        name: "lighting",
        about: "Reads the G-buffer and depth; writes linear HDR radiance",
        modules: &[&MODULE],
        ..Declaration::EMPTY
    };

    type Settings = ();
    type Targets = wgpu::Texture;

    fn targets(canvas: Canvas<'_>) -> wgpu::Texture {
        canvas.gpu.target("linear image", canvas.size, FORMAT)
    }

    fn build(build: Build<'_>) -> Result<Lighting> {
        Lighting::new(build.gpu, build.frame)
    }
}

impl Lighting {
    /// Compiles the pass.
    ///
    /// # Errors
    /// When the shader does not compile.
    pub fn new(gpu: &Gpu, frame_layout: &wgpu::BindGroupLayout) -> Result<Lighting> {
        let shader = MODULE.compile(gpu)?;
        let layout = gpu.layout(
            "lighting",
            wgpu::ShaderStages::FRAGMENT,
            &[Binding::TextureLoaded(FLAT), Binding::TextureLoaded(FLAT), Binding::Depth],
        );
        let pipeline = gpu.full_screen("lighting", &shader, &[frame_layout, &layout], FORMAT);
        Ok(Lighting { pipeline, layout })
    }

    /// Records the pass.
    pub fn encode(&self, rec: &mut Recording<'_>, geometry: &geometry::Targets, shading: &shading::Targets, image: &wgpu::Texture) {
        let views = [view(&shading.albedo), view(&shading.normal), aspect(&geometry.depth_stencil, wgpu::TextureAspect::DepthOnly)];
        let group = rec.gpu.group("lighting", &self.layout, &views.each_ref().map(wgpu::BindingResource::TextureView));
        rec.full_screen("lighting", &self.pipeline, image, 1, &[&group]);
    }
}

//! The uniforms of a request: the values of a frame that the stages share.

use bytemuck::bytes_of;
use glam::{DVec2, DVec3};

use crate::classification;
use crate::frame::{RenderRequest, Renderer, VariantChoice};
use crate::shared::flavour_weights::FlavourParams;
use crate::shared::noise;
use crate::view::FrameUniforms;
use crate::view::camera::{NEAR_M, View};
use crate::virtual_texture;

impl Renderer<'_> {
    /// The bind group of a request's uniforms.
    pub(super) fn frame_group(&self, request: &RenderRequest) -> wgpu::BindGroup {
        let uniforms = self.uniforms(request, &self.view(request));
        let buffer = self.gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
        self.gpu.group("frame", &self.frame_layout, &[buffer.as_entire_binding()])
    }

    #[allow(clippy::cast_possible_truncation, reason = "uniforms are f32 on purpose")]
    pub(super) fn uniforms(&self, request: &RenderRequest, view: &View) -> FrameUniforms {
        let (low, high) = self.world.height_range_m();
        let (sun, sky, blend) = (&self.scene.sun, &self.scene.sky, &self.scene.blend);
        let (azimuth, elevation) = (sun.azimuth_deg.to_radians(), sun.elevation_deg.to_radians());
        let sun_direction = DVec3::new(azimuth.sin() * elevation.cos(), azimuth.cos() * elevation.cos(), elevation.sin());
        let f = |v: DVec3| v.as_vec3().to_array();
        let layout = self.world.layout();
        let local_origin = view.sector.as_dvec2() * layout.sector_m - layout.world_m() / 2.0;
        let half_extent = DVec2::from_array(self.world.extent_m()) / 2.0;
        FrameUniforms {
            clip_from_local: view.clip_from_local_f32().to_cols_array_2d(),
            camera: f(view.camera),
            sector_m: layout.sector_m as f32,
            ray_00: f(view.ray_00),
            near_m: NEAR_M as f32,
            ray_dx: f(view.ray_dx),
            height_low_m: low as f32,
            ray_dy: f(view.ray_dy),
            height_span_m: (high - low) as f32,
            camera_sector: view.sector.to_array(),
            size: view.size,
            seed: request.shading.seed,
            frame: request.shading.frame,
            forced_mask: match request.shading.variant {
                VariantChoice::Forced(v) | VariantChoice::GenericForced(v) => u32::from(v.mask()),
                VariantChoice::Auto | VariantChoice::GenericAuto => 0,
            },
            page_levels: virtual_texture::LEVELS,
            tiles: classification::tiles_of(view.size, self.options.tile),
            hash_scale: blend.hash_scale as f32,
            height_sharpness: blend.height_sharpness as f32,
            triplanar_sharpness: blend.triplanar_sharpness as f32,
            gradient_scale: blend.mip_bias.exp2() as f32,
            page_texels_per_m: virtual_texture::TEXELS_PER_M as f32,
            page_anisotropy: f32::from(virtual_texture::anisotropy(self.demands.anisotropy)),
            flavours: FlavourParams::new(&self.scene.flavours),
            sun_direction: f(sun_direction),
            taps: 4,
            sun_irradiance: sun.irradiance.map(|v| v as f32),
            noise_world_level: noise::WORLD_LEVEL,
            sky_zenith: sky.zenith.map(|v| v as f32),
            sample_pattern: request.shading.sample_pattern.code(),
            sky_horizon: sky.horizon.map(|v| v as f32),
            normals: request.geometry.normals.code(),
            data_low: (-half_extent - local_origin).as_vec2().to_array(),
            data_high: (half_extent - local_origin).as_vec2().to_array(),
        }
    }
}

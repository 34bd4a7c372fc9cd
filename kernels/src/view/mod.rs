//! The camera, and the uniforms that the stages of a frame share.

use bytemuck::{Pod, Zeroable};

use crate::base::wgsl::Wgsl;
use crate::shared;
use crate::shared::flavour_weights::FlavourParams;

pub mod camera;
mod flavours;
pub mod normals;
mod reprojection;

/// WGSL with the uniforms that the stages of a frame share, and with the functions that read and write the normals of the geometry pass.
pub static WGSL: Wgsl = Wgsl::new(
    "view/frame.wgsl",
    include_str!("frame.wgsl"),
    &[&shared::FLAVOUR_WEIGHTS, &shared::NORMAL_PAIR, &shared::OCTAHEDRAL, &shared::VIEW],
)
.with(normals::CONSTANTS);

/// WGSL that computes the vertices of a full-screen pass, see [`Gpu::full_screen`](crate::gpu::Gpu::full_screen).
pub static FULL_SCREEN: Wgsl = Wgsl::new("view/full_screen.wgsl", include_str!("full_screen.wgsl"), &[]);

/// Uniforms of a frame; the layout matches `Frame` in `frame.wgsl`, where each field is explained.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub struct FrameUniforms {
    pub clip_from_local: [[f32; 4]; 4],
    pub camera: [f32; 3],
    pub sector_m: f32,
    pub ray_00: [f32; 3],
    pub near_m: f32,
    pub ray_dx: [f32; 3],
    pub height_low_m: f32,
    pub ray_dy: [f32; 3],
    pub height_span_m: f32,
    pub camera_sector: [i32; 2],
    pub size: [u32; 2],
    pub seed: u32,
    pub frame: u32,
    pub forced_mask: u32,
    pub page_levels: u32,
    pub tiles: [u32; 2],
    pub hash_scale: f32,
    pub height_sharpness: f32,
    pub triplanar_sharpness: f32,
    pub gradient_scale: f32,
    pub page_texels_per_m: f32,
    pub page_anisotropy: f32,
    pub flavours: FlavourParams,
    pub sun_direction: [f32; 3],
    pub taps: u32,
    pub sun_irradiance: [f32; 3],
    pub noise_world_level: i32,
    pub sky_zenith: [f32; 3],
    pub sample_pattern: u32,
    pub sky_horizon: [f32; 3],
    pub normals: u32,
    pub data_low: [f32; 2],
    pub data_high: [f32; 2],
}

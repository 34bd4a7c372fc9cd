//! Compares the lighting pass with its reference, on random G-buffers and under random lights.

use bytemuck::{Zeroable, bytes_of};
use half::f16;
use kernels::gpu::bindings::Binding;
use kernels::gpu::{Recording, read_texture};
use kernels::lighting::reference::{Light, Surface, radiance, sky_radiance};
use kernels::lighting::{FORMAT, Lighting};
use kernels::shared::hash;
use kernels::view::FrameUniforms;
use kernels::{geometry, shading};

use crate::fixtures::gpu;

/// Size of the pictures, pixels. Each pixel has its own surface.
const SIZE: [u32; 2] = [64, 48];

/// Pseudo-random number in 0..1 for a pixel. `table` selects a set of surfaces, and `what` a quantity; different quantities have independent numbers.
fn random(pixel: u32, table: u32, what: u32) -> f64 {
    f64::from(hash::pcg4d([pixel, table, what, 77])[0]) / f64::from(u32::MAX)
}

fn unit(v: [f64; 3]) -> [f64; 3] {
    let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
    v.map(|x| x / length)
}

/// Creates a texture with these texels, which a pass can read.
fn texture(format: wgpu::TextureFormat, aspect: wgpu::TextureAspect, bytes: &[u8]) -> wgpu::Texture {
    let size = wgpu::Extent3d { width: SIZE[0], height: SIZE[1], depth_or_array_layers: 1 };
    let usage = wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::RENDER_ATTACHMENT;
    let texture = gpu().device.create_texture(&wgpu::TextureDescriptor {
        label: Some("given"),
        size,
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage,
        view_formats: &[],
    });
    let row = u32::try_from(bytes.len()).expect("small") / SIZE[1];
    gpu().queue.write_texture(
        wgpu::TexelCopyTextureInfo { texture: &texture, mip_level: 0, origin: wgpu::Origin3d::ZERO, aspect },
        bytes,
        wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(row), rows_per_image: None },
        size,
    );
    texture
}

/// A depth texture with the same depth in all pixels.
fn depth(value: f32) -> wgpu::Texture {
    let texture = gpu().target("given depth", SIZE, geometry::DEPTH_FORMAT);
    let mut encoder = gpu().encoder("given depth");
    let view = kernels::gpu::bindings::view(&texture);
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some("given depth"),
        depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
            view: &view,
            depth_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(value), store: wgpu::StoreOp::Store }),
            stencil_ops: Some(wgpu::Operations { load: wgpu::LoadOp::Clear(1), store: wgpu::StoreOp::Store }),
        }),
        ..Default::default()
    });
    gpu().queue.submit([encoder.finish()]);
    texture
}

/// The input of the lighting pass. The shader reads f16 and f32, so all numbers are rounded to these types, and the reference gets the same numbers.
struct Given {
    surfaces: Vec<Surface<f64>>,
    light: Light<f64>,
    uniforms: FrameUniforms,
}

impl Given {
    /// Returns random surfaces under a random light. `table` selects the random numbers. It also selects one of five elevations of the sun, from 0.3
    /// radians below the horizon to 1.5 radians above it.
    fn random(table: u32) -> Given {
        let f = |x: f64| f64::from(x as f32);
        let h = |x: f64| f16::from_f64(x).to_f64();
        let colour = |what: u32, most: f64| [0, 1, 2].map(|k| f(random(9000 + k, table, what) * most));
        let elevation = [0.9, 0.2, 1.5, 0.05, -0.3][table as usize % 5];
        let azimuth = 6.0 * random(1, table, 50);
        let sun_direction = [azimuth.sin() * f64::cos(elevation), azimuth.cos() * f64::cos(elevation), f64::sin(elevation)].map(f);
        let light = Light { sun_direction, sun_irradiance: colour(51, 5.0), zenith: colour(52, 0.6), horizon: colour(53, 0.6) };
        let mut uniforms = FrameUniforms::zeroed();
        uniforms.size = SIZE;
        // The rays span about 95 by 70 degrees around a direction slightly below the horizon.
        (uniforms.ray_00, uniforms.ray_dx, uniforms.ray_dy) = ([-1.0, 0.9, 0.5], [2.0 / 64.0, 0.0, 0.0], [0.0, 0.003, -1.4 / 48.0]);
        let to_f32 = |v: [f64; 3]| v.map(|x| x as f32);
        uniforms.sun_direction = to_f32(light.sun_direction);
        uniforms.sun_irradiance = to_f32(light.sun_irradiance);
        uniforms.sky_zenith = to_f32(light.zenith);
        uniforms.sky_horizon = to_f32(light.horizon);
        let surfaces = (0..SIZE[0] * SIZE[1]).map(|pixel| {
            let n = unit([0, 1, 2].map(|k| 2.0 * random(pixel, table, k) - 1.0 + if k == 2 { 0.6 } else { 0.0 }));
            Surface {
                albedo: [3, 4, 5].map(|k| h(random(pixel, table, k))),
                normal: n.map(h),
                smoothness: h(random(pixel, table, 6).powi(2)),
                occlusion: h(random(pixel, table, 7)),
            }
        });
        Given { surfaces: surfaces.collect(), light, uniforms }
    }

    /// Unit vector from the surface of a pixel to the eye.
    fn to_eye(&self, pixel: usize) -> [f64; 3] {
        let (x, y) = ((pixel % SIZE[0] as usize) as f64, (pixel / SIZE[0] as usize) as f64);
        let ray =
            |k: usize| f64::from(self.uniforms.ray_00[k]) + x * f64::from(self.uniforms.ray_dx[k]) + y * f64::from(self.uniforms.ray_dy[k]);
        unit(std::array::from_fn(|k| -ray(k)))
    }

    /// Runs the pass on these surfaces and returns the lit picture. `at` = depth of all pixels; 0 = sky.
    fn lit(&self, at: f32) -> Vec<[f32; 4]> {
        let gpu = gpu();
        let layout = gpu.layout("frame", wgpu::ShaderStages::VERTEX_FRAGMENT | wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
        let pass = Lighting::new(gpu, &layout).expect("compiles");
        let buffer = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&self.uniforms));
        let frame = gpu.group("frame", &layout, &[buffer.as_entire_binding()]);
        let texels = |texel: &dyn Fn(&Surface<f64>) -> [f64; 4]| -> Vec<u8> {
            self.surfaces.iter().flat_map(|s| texel(s).map(f16::from_f64)).flat_map(f16::to_le_bytes).collect()
        };
        let all = wgpu::TextureAspect::All;
        let albedo = texels(&|s| [s.albedo[0], s.albedo[1], s.albedo[2], s.occlusion]);
        let normal = texels(&|s| [s.normal[0], s.normal[1], s.normal[2], s.smoothness]);
        let surfaces = shading::Targets {
            albedo: texture(shading::FORMAT, all, &albedo),
            normal: texture(shading::FORMAT, all, &normal),
            ..shading::Targets::new(gpu, SIZE)
        };
        let geometry = geometry::Targets { depth_stencil: depth(at), ..geometry::Targets::new(gpu, SIZE, Default::default()) };
        let image = gpu.target("image", SIZE, FORMAT);
        let groups = [&frame];
        let mut rec = Recording::new(gpu, &groups);
        pass.encode(&mut rec, &geometry, &surfaces, &image);
        rec.submit().expect("the device works");
        bytemuck::pod_collect_to_vec(&read_texture(gpu, &image, all, 16).expect("the device works"))
    }
}

/// Bound of the relative rounding error of the radiance without the sun's highlight: 130 ULP. The shader does some 40 operations with an error of at
/// most 2.5 ULP each (WGSL 14.6), and an exp2 of an argument of at most 9.28 with an error of 22 ULP. One ULP is counted as 2^-24 of the value, or
/// 6e-8, its smallest relative size. It can be up to 2^-23, but most operations have an error of only half an ULP.
const ROUNDING: f64 = 130.0 * 6e-8;

/// Bound of the relative error of the sun's highlight. The normal distribution D depends on rounding more than the other factors, which together have
/// at most the error [`ROUNDING`]. Let c = n.h be the cosine between the normal and the half vector, and s = (1 - c²) + alpha² c². D is proportional
/// to 1 / s². An error e of c changes s by at most 2 e, so it changes D by at most 4 e / s, as a share of D. The error of c is about 6 ULP. It comes
/// from the three products of the dot product, and from the division and the square root that normalise the half vector.
fn highlight_error(surface: &Surface<f64>, light: &Light<f64>, to_eye: [f64; 3]) -> f64 {
    let half = unit(std::array::from_fn(|k| light.sun_direction[k] + to_eye[k]));
    let sum: f64 = (0..3).map(|k| (light.sun_direction[k] + to_eye[k]).powi(2)).sum::<f64>().sqrt();
    let c: f64 = (0..3).map(|k| surface.normal[k] * half[k]).sum::<f64>().clamp(0.0, 1.0);
    let alpha = (1.0 - surface.smoothness).powi(2).max(0.002);
    let bracket = (1.0 - c) * (1.0 + c) + alpha * alpha * c * c;
    // The factor 1 + 2 / sum allows for directions to the sun and to the eye that are nearly opposite. The sum of these directions, which gives the
    // half vector, is then short, so its relative error is large.
    4.0 / bracket * 6.0 * 6e-8 * (1.0 + 2.0 / sum) + ROUNDING
}

#[test]
fn lit_surfaces_agree_with_the_reference() {
    let mut highlights = 0;
    for table in 0..5 {
        let given = Given::random(table);
        let lit = given.lit(0.01);
        let mut worst = [0f64; 2];
        for (pixel, (surface, texel)) in given.surfaces.iter().zip(&lit).enumerate() {
            let to_eye = given.to_eye(pixel);
            let (exact, highlight) = radiance(surface, &given.light, to_eye);
            let error = highlight_error(surface, &given.light, to_eye);
            for k in 0..3 {
                // n.l, the cosine between the normal and the direction to the sun, has an absolute error of 3 ULP of the number 1. Near the
                // terminator, where n.l is small, this is a large share of the sunlight, so the tolerance has a term for it.
                let terminator = 3.0 * 6e-8 * given.light.sun_irradiance[k] * (1.0 + highlight[k]);
                let tolerance = ROUNDING * exact[k] + error * highlight[k] + terminator;
                let off = (f64::from(texel[k]) - exact[k]).abs();
                assert!(
                    off <= tolerance,
                    "light {table}, pixel {pixel}: {texel:?}, exact {exact:?}, highlight {highlight:?}: {off:e} off, limit {tolerance:e}"
                );
                worst[0] = worst[0].max(off / tolerance);
                worst[1] = worst[1].max(tolerance / exact[k].max(1e-3));
            }
            assert!((texel[3] - 1.0).abs() < 1e-9, "alpha marks terrain");
            highlights += usize::from(highlight[1] > 0.2 * exact[1]);
        }
        println!("light {table}: errors of up to {:.2} of the tolerance, which is at most {:.1e} of the radiance", worst[0], worst[1]);
        assert!(worst[1] < 0.02, "a tolerance of {} could hide a wrong term", worst[1]);
    }
    assert!(highlights > 100, "only {highlights} pixels have a highlight that could reveal an error");
}

#[test]
fn the_sky_agrees_with_the_reference_and_ends_at_the_horizon() {
    for table in 0..3 {
        let given = Given::random(table);
        for (pixel, texel) in given.lit(0.0).iter().enumerate() {
            let [x, y, z] = given.to_eye(pixel).map(|x| -x);
            let exact = sky_radiance(&given.light, [x, y, z.max(0.0)]);
            let off = (0..3).map(|k| (f64::from(texel[k]) - exact[k]).abs()).fold(0.0, f64::max);
            assert!(off < 1e-6 && texel[3].abs() < 1e-9, "pixel {pixel}: {texel:?}, exact {exact:?}");
        }
    }
}

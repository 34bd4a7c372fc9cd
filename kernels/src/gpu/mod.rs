//! Access to the GPU: adapters, devices, shaders, timers and read-back.

use std::sync::{Arc, Mutex, RwLock};

use crate::base::error::{Error, Result};

pub mod bindings;
mod readback;
mod recording;
mod shader;
mod sources;
mod specialise;
mod timer;
mod upload;
pub mod uses;

pub use readback::{TextureReading, read_buffer, read_ranges, read_texture};
pub use recording::{CLEAR, Recording};
pub use shader::{Shader, ShaderModule, constants};
pub use sources::Sources;
pub(crate) use specialise::Template;
pub use timer::{PassTime, Timer};
pub use upload::upload;

/// The features that the terrain stack requires, each with its name and the reason that an error gives.
const REQUIRED: [(wgpu::Features, &str, &str); 3] = [
    (wgpu::Features::TEXTURE_COMPRESSION_BC, "BC texture compression", "node payloads and detail textures are BC1 and BC3"),
    (
        wgpu::Features::DEPTH32FLOAT_STENCIL8,
        "32-bit float depth with stencil",
        "depth is reversed 32-bit float, and a stencil bit marks terrain",
    ),
    (wgpu::Features::TEXTURE_FORMAT_16BIT_NORM, "16-bit unorm textures", "heights are R16_UNORM"),
];

/// Features that are used if the adapter has them. Pictures should be the same without them.
const OPTIONAL: [(wgpu::Features, &str); 3] = [
    (wgpu::Features::TIMESTAMP_QUERY, "timestamp queries"),
    (wgpu::Features::SUBGROUP, "subgroup operations"),
    (wgpu::Features::DEPTH_CLIP_CONTROL, "depth clip control"),
];

/// One adapter of this machine, and whether it can be used.
#[derive(Clone, Debug)]
pub struct AdapterReport {
    /// Name given by the driver.
    pub name: String,
    /// Graphics interface, such as vulkan, metal or dx12.
    pub backend: String,
    /// Type of the adapter, such as `DiscreteGpu`, `IntegratedGpu` or `software`.
    pub device_type: String,
    /// Driver name and version.
    pub driver: String,
    /// `Ok` if the adapter has all required features; otherwise a text that names the missing ones.
    pub usable: std::result::Result<(), String>,
    /// The required and optional features, and whether the adapter has them.
    pub features: Vec<(String, bool)>,
}

/// A device, its queue and its features. Clones share the device.
#[derive(Clone)]
pub struct Gpu {
    /// The device.
    pub device: wgpu::Device,
    /// The queue of the device.
    pub queue: wgpu::Queue,
    /// Name, driver and type of the adapter.
    pub info: wgpu::AdapterInfo,
    /// Features that were enabled.
    pub features: wgpu::Features,
    /// The first error that the device reported outside of error scopes since the last [`Gpu::check`], if any.
    failure: Arc<Mutex<Option<String>>>,
    /// Shader texts that replace the embedded ones.
    sources: Arc<RwLock<Arc<Sources>>>,
}

fn instance() -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor::new_without_display_handle_from_env())
}

fn missing(features: wgpu::Features) -> Option<String> {
    let lacking: Vec<_> =
        REQUIRED.iter().filter(|(f, ..)| !features.contains(*f)).map(|(_, name, why)| format!("{name} ({why})")).collect();
    if lacking.is_empty() { None } else { Some(format!("lacks {}", lacking.join(", "))) }
}

fn report(adapter: &wgpu::Adapter) -> AdapterReport {
    let info = adapter.get_info();
    let features = adapter.features();
    AdapterReport {
        name: info.name.clone(),
        backend: info.backend.to_string(),
        device_type: if info.device_type == wgpu::DeviceType::Cpu { "software".to_owned() } else { format!("{:?}", info.device_type) },
        driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
        usable: missing(features).map_or(Ok(()), Err),
        features: REQUIRED
            .iter()
            .map(|(f, name, _)| ((*name).to_owned(), features.contains(*f)))
            .chain(OPTIONAL.iter().map(|(f, name)| ((*name).to_owned(), features.contains(*f))))
            .collect(),
    }
}

/// The adapters of this machine with a driver for Vulkan, Metal or Direct3D 12, in the order in which wgpu lists them.
pub fn adapters() -> Vec<AdapterReport> {
    pollster::block_on(instance().enumerate_adapters(wgpu::Backends::PRIMARY)).iter().map(report).collect()
}

/// Returns the usable adapters, or an error if there is none. Hardware adapters come before software adapters. If the environment variable
/// `WGPU_ADAPTER_NAME` is set, only adapters whose name contains its value are returned; upper and lower case count as equal.
fn ranked() -> Result<Vec<wgpu::Adapter>> {
    let mut found = pollster::block_on(instance().enumerate_adapters(wgpu::Backends::PRIMARY));
    if found.is_empty() {
        return Err(Error::Adapter(
            "no Vulkan, Metal or DirectX 12 driver was found; on Debian or Ubuntu `apt-get install mesa-vulkan-drivers` installs a software driver"
                .to_owned(),
        ));
    }
    if let Ok(wanted) = std::env::var("WGPU_ADAPTER_NAME") {
        found.retain(|a| a.get_info().name.to_lowercase().contains(&wanted.to_lowercase()));
        if found.is_empty() {
            return Err(Error::Adapter(format!(
                "no adapter has a name that contains `{wanted}`, the value of WGPU_ADAPTER_NAME; `experiments adapters` lists the adapters"
            )));
        }
    }
    let rank = |a: &wgpu::Adapter| match a.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    };
    found.sort_by_key(rank);
    if found.iter().all(|a| missing(a.features()).is_some()) {
        let each: Vec<_> = found.iter().map(|a| format!("`{}` {}", a.get_info().name, missing(a.features()).unwrap_or_default())).collect();
        return Err(Error::Adapter(format!(
            "{}; use another adapter or driver (`experiments adapters` lists the adapters)",
            each.join("; ")
        )));
    }
    found.retain(|a| missing(a.features()).is_none());
    Ok(found)
}

/// Whether a driver is llvmpipe from Mesa before version 23, judged by the texts that Vulkan reports, such as `llvmpipe` and `Mesa 22.3.6 (LLVM
/// 15.0.6)`. With Mesa 22.3.6 an anisotropic shading pipeline did not finish compiling in 500 s; with 25.0.7 it takes seconds.
fn compiles_anisotropy_in_minutes(driver: &str, driver_info: &str) -> bool {
    let version = driver_info.split_once("Mesa ").and_then(|(_, rest)| rest.split('.').next()?.parse::<u32>().ok());
    driver == "llvmpipe" && version.is_some_and(|major| major < 23)
}

/// Options for opening a device.
#[derive(Clone, Copy, Debug, Default)]
pub struct GpuOptions {
    /// Whether optional features stay disabled even if the adapter supports them. Stages then take the code path that needs no optional feature.
    pub plain: bool,
}

impl Gpu {
    /// Opens a device on the first usable adapter; hardware comes before software. The environment variable `WGPU_ADAPTER_NAME` restricts the choice
    /// to adapters whose name contains its value.
    ///
    /// # Errors
    /// There is no adapter, no adapter with that name, or no adapter with the required features (the error then lists what each adapter lacks). Or
    /// the device cannot be opened.
    pub fn new() -> Result<Gpu> {
        Gpu::with(GpuOptions::default())
    }

    /// Does the same as [`Gpu::new`], with options.
    ///
    /// # Errors
    /// The same errors as [`Gpu::new`].
    pub fn with(options: GpuOptions) -> Result<Gpu> {
        Gpu::open(&ranked()?[0], options)
    }

    /// Opens a device on every usable adapter; hardware comes before software. `WGPU_ADAPTER_NAME` restricts the choice as in [`Gpu::new`].
    ///
    /// # Errors
    /// The same errors as [`Gpu::new`].
    pub fn every() -> Result<Vec<Gpu>> {
        ranked()?.iter().map(|adapter| Gpu::open(adapter, GpuOptions::default())).collect()
    }

    fn open(adapter: &wgpu::Adapter, options: GpuOptions) -> Result<Gpu> {
        let mut features = REQUIRED.iter().fold(wgpu::Features::empty(), |all, (f, ..)| all | *f);
        if !options.plain {
            features |= OPTIONAL.iter().fold(wgpu::Features::empty(), |all, (f, _)| all | (*f & adapter.features()));
        }
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("scree"),
            required_features: features,
            required_limits: adapter.limits(),
            ..Default::default()
        }))
        .map_err(|e| Error::Adapter(format!("cannot open a device on `{}`: {e}", adapter.get_info().name)))?;
        let failure = Arc::new(Mutex::new(None));
        let slot = failure.clone();
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            if let Ok(mut slot) = slot.lock() {
                slot.get_or_insert_with(|| error.to_string().replace('\n', " "));
            }
        }));
        Ok(Gpu { device, queue, info: adapter.get_info(), features, failure, sources: Arc::default() })
    }

    /// Bytes of memory that are allocated on the device for buffers and textures; `None` = the driver's interface does not report them.
    pub fn memory_bytes(&self) -> Option<u64> {
        self.device.generate_allocator_report().map(|report| report.total_allocated_bytes)
    }

    /// Whether the adapter runs on the CPU. On such an adapter, only ratios of times are meaningful.
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// The reason, in one sentence, why this device filters detail textures without anisotropy; `None` if it uses the anisotropy of the scene.
    pub fn without_anisotropy(&self) -> Option<&'static str> {
        compiles_anisotropy_in_minutes(&self.info.driver, &self.info.driver_info).then_some(
            "scenes are drawn with anisotropy 1: Mesa's software driver before version 23 takes minutes to compile anisotropic shaders; install a newer Mesa",
        )
    }

    /// The anisotropy that this device uses for detail textures if the scene sets it to `wanted`.
    pub fn anisotropy(&self, wanted: u16) -> u16 {
        if self.without_anisotropy().is_some() { 1 } else { wanted }
    }

    /// Fails if the device has reported an error outside of error scopes since the last call.
    ///
    /// # Errors
    /// The first error that the device has reported since the last call, with the device's own message.
    pub fn check(&self) -> Result<()> {
        match self.failure.lock().ok().and_then(|mut slot| slot.take()) {
            Some(text) => Err(Error::Gpu(text)),
            None => Ok(()),
        }
    }

    /// Submits the commands of `encoder`, and waits until the device is idle.
    ///
    /// # Errors
    /// When the device is lost or reported an error.
    pub fn submit_and_wait(&self, encoder: wgpu::CommandEncoder) -> Result<()> {
        self.queue.submit([encoder.finish()]);
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|e| Error::Gpu(e.to_string()))?;
        self.check()
    }

    /// A new command encoder.
    pub fn encoder(&self, label: &str) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(label) })
    }

    /// A buffer with `contents`. Its size is rounded up to a multiple of 16 bytes, at least 16; the rest is zeros. `COPY_DST` is added to `usage`.
    pub fn buffer_with(&self, label: &str, usage: wgpu::BufferUsages, contents: &[u8]) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: (contents.len() as u64).next_multiple_of(16).max(16),
            usage: usage | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, contents);
        buffer
    }

    /// A buffer of `size` bytes. Its initial contents are zeros.
    pub fn buffer(&self, label: &str, usage: wgpu::BufferUsages, size: u64) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
    }
}

/// Size of a texture's texels in bytes, over all mips and layers. A device may add padding.
pub fn texture_bytes(texture: &wgpu::Texture) -> u64 {
    let of_mip = |mip| texture.format().theoretical_memory_footprint(texture.size().mip_level_size(mip, texture.dimension()));
    (0..texture.mip_level_count()).map(of_mip).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_old_software_drivers_are_spared_anisotropy() {
        assert!(compiles_anisotropy_in_minutes("llvmpipe", "Mesa 22.3.6 (LLVM 15.0.6)"));
        for (driver, info) in [
            ("llvmpipe", "Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)"),
            ("llvmpipe", "Mesa 23.0.0"),
            ("llvmpipe", ""),
            ("radv", "Mesa 22.3.6"),
            ("NVIDIA", "550.1"),
        ] {
            assert!(!compiles_anisotropy_in_minutes(driver, info), "{driver} {info}");
        }
    }

    #[test]
    fn an_adapter_without_block_compression_is_refused_by_name() {
        let all = REQUIRED.iter().fold(wgpu::Features::empty(), |all, (f, ..)| all | *f);
        assert_eq!(missing(all), None);
        let text = missing(all - wgpu::Features::TEXTURE_COMPRESSION_BC).expect("something is missing");
        assert!(text.contains("BC texture compression") && !text.contains("depth"), "{text}");
        let text = missing(wgpu::Features::empty()).expect("everything is missing");
        assert!(REQUIRED.iter().all(|(_, name, _)| text.contains(name)), "{text}");
    }
}

//! Descriptions of the passes and textures of a frame, for lists that are shown to users. The lists also contain passes and textures that the scene
//! does not require.

use serde::Serialize;

/// A pass of the frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassUse {
    /// The pass's name.
    pub name: &'static str,
    /// Number of pipelines of the pass. The shading pass has one for each variant that tiles may need, and one for the generic kernel.
    pub pipelines: u32,
    /// Whether the scene requires the pass.
    pub required: bool,
    /// Why the pass is, or is not, required.
    pub reason: &'static str,
}

impl PassUse {
    /// A pass that every scene requires.
    pub const fn new(name: &'static str, pipelines: u32, reason: &'static str) -> PassUse {
        PassUse { name, pipelines, required: true, reason }
    }
}

/// A texture whose size follows from the scene alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureUse {
    /// Name: what the texture holds.
    pub name: &'static str,
    /// Format, spelled as in WebGPU.
    pub format: String,
    /// Width and height of one layer or slot, texels.
    pub size: [u32; 2],
    /// Mip levels.
    pub mips: u32,
    /// Layers or slots.
    pub layers: u32,
    /// Size of all mips of all layers, bytes.
    pub bytes: u64,
    /// Whether the scene requires the texture.
    pub required: bool,
    /// Why the texture is, or is not, required.
    pub reason: &'static str,
}

impl TextureUse {
    /// A square texture with `edge` texels along each side, which the scene requires for this `reason`.
    pub fn new(name: &'static str, format: wgpu::TextureFormat, edge: u32, mips: u32, layers: u32, reason: &'static str) -> TextureUse {
        let (block, bytes) = (u64::from(format.block_dimensions().0), u64::from(format.block_copy_size(None).unwrap_or(0)));
        let chain: u64 = (0..mips).map(|mip| u64::from((edge >> mip).max(1)).div_ceil(block).pow(2) * bytes).sum();
        TextureUse {
            name,
            format: spelled(format),
            size: [edge, edge],
            mips,
            layers,
            bytes: chain * u64::from(layers),
            required: true,
            reason,
        }
    }

    /// Marks the texture as not required, for this `reason`, if `required` is false. Otherwise returns it unchanged.
    #[must_use]
    pub fn unless(self, required: bool, reason: &'static str) -> TextureUse {
        if required { self } else { TextureUse { required, reason, ..self } }
    }
}

/// A texture with the size of the picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetUse {
    /// Name: what the texture holds.
    pub name: &'static str,
    /// Format, spelled as in WebGPU.
    pub format: String,
    /// Bytes per pixel.
    pub bytes_per_px: u32,
}

impl TargetUse {
    /// A target of this format.
    pub fn new(name: &'static str, format: wgpu::TextureFormat) -> TargetUse {
        let bytes_per_px = match format {
            wgpu::TextureFormat::Depth32FloatStencil8 => 5,
            _ => format.block_copy_size(None).unwrap_or(0),
        };
        TargetUse { name, format: spelled(format), bytes_per_px }
    }
}

/// A format as WebGPU spells it, such as `bc1-rgba-unorm-srgb`, `depth32float-stencil8` or `r16unorm`. Formats that Scree does not use may be spelled
/// differently.
fn spelled(format: wgpu::TextureFormat) -> String {
    let name = format!("{format:?}").replace("Srgb", "-srgb").replace("Stencil8", "-stencil8");
    let name = if name.starts_with("Bc") { name.replace("Rgba", "-rgba-") } else { name };
    name.to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_spelled_as_in_webgpu() {
        use wgpu::TextureFormat as F;
        let all =
            [F::Bc1RgbaUnormSrgb, F::Bc3RgbaUnorm, F::Depth32FloatStencil8, F::R16Unorm, F::Rgba8UnormSrgb, F::Rgba16Float, F::R32Uint];
        let names =
            ["bc1-rgba-unorm-srgb", "bc3-rgba-unorm", "depth32float-stencil8", "r16unorm", "rgba8unorm-srgb", "rgba16float", "r32uint"];
        assert_eq!(all.map(spelled), names);
    }
}

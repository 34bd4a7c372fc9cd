//! What a scene requires, and what it does not: flavours, variants, textures, passes, bytes.
//!
//! What is not required is neither compiled, allocated nor dispatched. Sizes and formats are those of
//! *Terrain Rendering in Far Cry 5* (Moore, GDC 2018), sections on terrain data and the virtual texture.

use std::collections::BTreeSet;
use std::fmt;

use serde::{Serialize, Serializer};

use crate::residency;
use crate::scene::{Scene, World};
use crate::shading::Estimator;
use crate::variant::{Flavour, Variant};
use crate::virtual_texture;

/// A flavour and whether the scene requires it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlavourUse {
    /// The flavour's name.
    pub name: &'static str,
    /// Whether the scene can ask for it.
    pub required: bool,
    /// Texture samples a pixel of it takes.
    pub fetches_per_px: u32,
    /// Why it is, or is not, required.
    pub reason: String,
}

/// A texture whose size follows from the scene alone.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TextureUse {
    /// What it holds.
    pub name: &'static str,
    /// Format, spelled as in WebGPU.
    pub format: &'static str,
    /// Width and height of one layer or slot, texels.
    pub size: [u32; 2],
    /// Mip levels.
    pub mips: u32,
    /// Layers or slots.
    pub layers: u32,
    /// All mips of all layers, bytes.
    pub bytes: u64,
    /// Whether the scene requires it.
    pub required: bool,
    /// Why it is, or is not, required.
    pub reason: &'static str,
}

/// A texture of the picture's size.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TargetUse {
    /// What it holds.
    pub name: &'static str,
    /// Format, spelled as in WebGPU.
    pub format: &'static str,
    /// Bytes per pixel.
    pub bytes_per_px: u32,
}

/// A pass of the frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PassUse {
    /// The pass's name, as in timings.
    pub name: &'static str,
    /// Most pipelines it can bind: the shading pass has one per variant.
    pub pipelines: u32,
    /// Whether the scene requires it.
    pub required: bool,
    /// Why it is, or is not, required.
    pub reason: &'static str,
}

/// What follows from a scene file, before any world data is read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Requirements {
    /// The scene's name.
    pub scene: String,
    /// All five flavours, in the order of their bits.
    pub flavours: Vec<FlavourUse>,
    /// The variants that classification can produce: every non-empty set of required flavours, by number.
    #[serde(serialize_with = "variant_names")]
    pub variants: Vec<Variant>,
    /// Whether the terrain has holes: the vertex stage then reads the baked albedo's alpha.
    pub holes: bool,
    /// Whether the colour modulation map is made and sampled.
    pub colour_modulation: bool,
    /// Textures whose size follows from the scene, required or not.
    pub textures: Vec<TextureUse>,
    /// Textures of the picture's size, all required.
    pub targets: Vec<TargetUse>,
    /// Passes in their order, required or not.
    pub passes: Vec<PassUse>,
}

fn variant_names<S: Serializer>(variants: &[Variant], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(variants.iter().map(ToString::to_string))
}

impl Requirements {
    /// Everything that follows from a (valid) scene.
    pub fn of(scene: &Scene) -> Requirements {
        let flavours = flavours_of(scene);
        let mask = flavours.iter().zip(Flavour::ALL).filter(|(used, _)| used.required).fold(0, |mask, (_, f)| mask | f.bit());
        let variants: Vec<Variant> = Variant::all().filter(|v| v.mask() & !mask == 0).collect();
        let (holes, colour_modulation) = match &scene.world {
            World::Procedural { holes, colour_modulation, .. } => (!holes.is_empty(), *colour_modulation > 0.0),
            // Beyond the data there is no ground, and data seldom end where a sector does.
            World::Heightmap { colour_modulation, .. } => (true, *colour_modulation > 0.0),
        };
        let has = |flavour: Flavour| mask & flavour.bit() != 0;
        let virtual_texture = has(Flavour::VirtualTexture);
        Requirements {
            scene: scene.name.clone(),
            flavours,
            textures: textures(scene, virtual_texture, colour_modulation),
            targets: targets(),
            passes: passes(variants.len(), virtual_texture),
            variants,
            holes,
            colour_modulation,
        }
    }

    /// Whether the scene can ask for this flavour.
    pub fn has(&self, flavour: Flavour) -> bool {
        self.flavours.iter().any(|used| used.required && used.name == flavour.name())
    }

    /// Bytes of all required textures; those of the picture's size come on top ([`Requirements::bytes_per_px`]).
    pub fn bytes(&self) -> u64 {
        self.textures.iter().filter(|t| t.required).map(|t| t.bytes).sum()
    }

    /// Bytes per pixel of all textures of the picture's size.
    pub fn bytes_per_px(&self) -> u32 {
        self.targets.iter().map(|t| t.bytes_per_px).sum()
    }
}

fn flavours_of(scene: &Scene) -> Vec<FlavourUse> {
    let rules = &scene.flavours;
    let cliffs = rules.has_cliffs();
    let no_cliffs = || format!("flavours.cliff_slope_deg = {}: nothing is cliff", rules.cliff_slope_deg);
    let decide = |flavour: Flavour| match flavour {
        Flavour::VirtualTexture if rules.far_atlas_m > 0.0 => (true, format!("ground nearer than {} m", rules.far_atlas_m)),
        Flavour::VirtualTexture => (false, "flavours.far_atlas_m = 0: all ground is shaded from the far atlas".to_owned()),
        Flavour::FarAtlas => (true, format!("ground beyond {} m, and whatever is not resident yet", rules.far_atlas_m)),
        Flavour::NearCliff if cliffs => {
            (true, format!("slopes above {} degrees nearer than {} m", rules.cliff_slope_deg, rules.cliff_near_m))
        }
        Flavour::FarCliff if cliffs => {
            (true, format!("slopes above {} degrees from {} m to {} m", rules.cliff_slope_deg, rules.cliff_near_m, rules.cliff_far_atlas_m))
        }
        Flavour::Splat if cliffs && rules.splat_band_deg > 0.0 => (
            true,
            format!(
                "slopes of {} to {} degrees nearer than {} m",
                rules.cliff_slope_deg - rules.splat_band_deg,
                rules.cliff_slope_deg,
                rules.cliff_near_m
            ),
        ),
        Flavour::Splat if cliffs => (false, "flavours.splat_band_deg = 0".to_owned()),
        Flavour::NearCliff | Flavour::FarCliff | Flavour::Splat => (false, no_cliffs()),
    };
    Flavour::ALL
        .into_iter()
        .map(|flavour| {
            let (required, reason) = decide(flavour);
            FlavourUse { name: flavour.name(), required, fetches_per_px: Estimator::Fc5.promised_fetches(flavour), reason }
        })
        .collect()
}

/// How a format stores texels: bytes of a block and its edge.
const fn block(format: &str) -> (u64, u32) {
    // A const fn cannot match strings; the first bytes tell our formats apart.
    match format.as_bytes() {
        [b'b', b'c', b'1', ..] => (8, 4),
        [b'b', b'c', b'3', ..] => (16, 4),
        [b'r', b'8', ..] => (1, 1),
        [b'r', b'1', b'6', ..] | [b'r', b'g', b'8', ..] => (2, 1),
        _ => (4, 1),
    }
}

fn chain_bytes(format: &str, size: [u32; 2], mips: u32) -> u64 {
    let (bytes, edge) = block(format);
    (0..mips)
        .map(|mip| {
            let blocks = |texels: u32| u64::from((texels >> mip).max(1).div_ceil(edge));
            blocks(size[0]) * blocks(size[1]) * bytes
        })
        .sum()
}

fn textures(scene: &Scene, has_pages: bool, colour_modulation: bool) -> Vec<TextureUse> {
    let texture = |name, format, edge: u32, mips, layers: u32, required, reason| TextureUse {
        name,
        format,
        size: [edge, edge],
        mips,
        layers,
        bytes: chain_bytes(format, [edge, edge], mips) * u64::from(layers),
        required,
        reason,
    };
    // Slots count from 1, since 0 means that nothing is loaded.
    let node = |name, format, edge, required, reason| texture(name, format, edge, 1, residency::CAPACITY + 1, required, reason);
    let sources: BTreeSet<_> = scene.materials.iter().map(|m| (&m.procedural, &m.folder)).collect();
    let layers = u32::try_from(sources.len()).expect("a valid scene has at most 256 materials");
    let chain = |edge: u32| edge.max(1).ilog2() + 1;
    let full = scene.detail_size;
    let half = scene.detail_size / 2;
    let drawn = "the terrain's shape";
    let baked = "far atlas, and whatever is not resident yet";
    // Also where no flavour samples them: every error is measured against the full blend.
    let textured = "cliffs, splat, pages, and the reference that errors are measured against";
    let paged = if has_pages { "virtual texture" } else { "no virtual texture" };
    let page = |name, format| texture(name, format, virtual_texture::STORED_TEXELS, 2, virtual_texture::CAPACITY, has_pages, paged);
    let modulated = if colour_modulation { "colour modulation" } else { "world.colour_modulation = 0" };
    vec![
        node("node height", "r16unorm", 129, true, drawn),
        node("node normal", "bc3-rgba-unorm", 132, true, baked),
        node("node albedo", "bc1-rgba-unorm-srgb", 132, true, baked),
        node("node colour modulation", "bc1-rgba-unorm", 132, colour_modulation, modulated),
        node("node splat map", "r8uint", 65, true, textured),
        texture("detail albedo", "bc1-rgba-unorm-srgb", full, chain(full), layers, true, textured),
        texture("detail normal", "bc3-rgba-unorm", full, chain(full), layers, true, textured),
        texture("detail height", "bc1-rgba-unorm", half, chain(half), layers, true, textured),
        page("page albedo", "rgba8unorm-srgb"),
        page("page normal", "rg8unorm"),
        page("page smoothness, occlusion", "rg8unorm"),
        texture("page table", "r32uint", virtual_texture::WINDOW, 1, virtual_texture::LEVELS, has_pages, paged),
    ]
}

fn targets() -> Vec<TargetUse> {
    let target = |name, format, bytes_per_px| TargetUse { name, format, bytes_per_px };
    vec![
        target("depth and stencil", "depth32float-stencil8", 5),
        target("classification mask", "r8uint", 1),
        target("shading, triangle normal", "rgba8unorm", 4),
        target("G-buffer albedo, occlusion", "rgba16float", 8),
        target("G-buffer normal, smoothness", "rgba16float", 8),
        target("diagnostics", "r32uint", 4),
        target("linear image", "rgba32float", 16),
    ]
}

fn passes(variants: usize, virtual_texture: bool) -> Vec<PassUse> {
    let pass = |name, pipelines, required, reason| PassUse { name, pipelines, required, reason };
    let variants = u32::try_from(variants).expect("at most 31");
    let paged = if virtual_texture { "virtual texture" } else { "no virtual texture" };
    vec![
        pass("geometry", 1, true, "depth, stencil, mask, normals"),
        pass("classification", 1, true, "tile list per variant"),
        pass("page requests", 1, virtual_texture, paged),
        pass("pages", 1, virtual_texture, paged),
        pass("shading", variants + 1, true, "a pipeline per variant that has tiles, and the generic kernel"),
        pass("lighting", 1, true, "sun and sky"),
    ]
}

fn mib(bytes: u64) -> String {
    format!("{}.{:02} MiB", bytes >> 20, ((bytes & 0xF_FFFF) * 100) >> 20)
}

/// A titled list; nothing if it is empty.
fn section<T>(
    f: &mut fmt::Formatter<'_>,
    title: &str,
    items: impl Iterator<Item = T>,
    mut line: impl FnMut(&mut fmt::Formatter<'_>, T) -> fmt::Result,
) -> fmt::Result {
    let mut items = items.peekable();
    if items.peek().is_some() {
        writeln!(f, "  {title}")?;
    }
    items.try_for_each(|item| line(f, item))
}

impl fmt::Display for Requirements {
    /// Two lists: what is required, and what is not.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "scene `{}`", self.scene)?;
        for required in [true, false] {
            let (title, note) = if required {
                ("required", format!("{} of textures, {} bytes per pixel on top", mib(self.bytes()), self.bytes_per_px()))
            } else {
                ("not required", "not compiled, not allocated, not dispatched".to_owned())
            };
            writeln!(f, "\n{title} ({note})")?;
            let variants: Vec<Variant> = Variant::all().filter(|v| self.variants.contains(v) == required).collect();
            section(f, "flavours", self.flavours.iter().filter(|used| used.required == required), |f, used| {
                writeln!(f, "    {:<12} {:>2} fetches/px  {}", used.name, used.fetches_per_px, used.reason)
            })?;
            section(f, &format!("variants: {} of {}", variants.len(), Variant::COUNT), variants.iter(), |f, variant| {
                writeln!(f, "    {:>2}  {variant}", variant.mask())
            })?;
            section(f, "passes", self.passes.iter().filter(|pass| pass.required == required), |f, pass| {
                writeln!(f, "    {:<26} {:>2} pipeline(s)  {}", pass.name, pass.pipelines, pass.reason)
            })?;
            section(f, "textures", self.textures.iter().filter(|t| t.required == required), |f, t| {
                let size = format!("{}x{}", t.size[0], t.size[1]);
                let bytes = mib(t.bytes);
                let (name, format, layers, mips) = (t.name, t.format, t.layers, t.mips);
                writeln!(f, "    {name:<30} {format:<20} {size:>9} x {layers:<3} {mips:>2} mips {bytes:>11}  {}", t.reason)
            })?;
            section(f, "textures of the picture's size", self.targets.iter().filter(|_| required), |f, t| {
                writeln!(f, "    {:<30} {:<20} {:>2} bytes/px", t.name, t.format, t.bytes_per_px)
            })?;
            if self.holes == required {
                f.write_str(if required {
                    "  holes: the vertex stage reads the baked albedo's alpha\n"
                } else {
                    "  holes: the world has none\n"
                })?;
            }
            if self.colour_modulation == required {
                f.write_str(if required { "  colour modulation: sampled\n" } else { "  colour modulation: not made\n" })?;
            }
        }
        Ok(())
    }
}

//! What a scene requires, and what it does not require: flavours, variants, textures, passes, bytes.
//!
//! Parts that are not required are not compiled, allocated or dispatched, with the exceptions below. Sizes and formats follow *Terrain Rendering in
//! Far Cry 5* (Moore, GDC 2018), sections on terrain data and the virtual texture. `ARCHITECTURE.md` lists the differences.
//!
//! Exceptions: in a scene without a virtual texture, each of the three page textures has one unused layer, because a binding of the shading pass
//! cannot be empty. The page table and the buffer of page requests (224 KiB each) are still allocated. In a scene without colour modulation, the
//! atlas of colour modulation has one layer. Detail textures and the splat map exist even if no flavour of the scene samples them, because errors are
//! measured against full splat, which samples them.

use std::fmt;

use serde::{Serialize, Serializer};

use crate::frame::stages::DECLARATIONS;
use crate::gpu::uses::{PassUse, TargetUse, TextureUse};
use crate::residency;
use crate::scene::Scene;
use crate::scene::demands::{Demands, FlavourDemand};
use crate::shading::Estimator;
use crate::terrain;
use crate::variant::{Flavour, Variant};
use crate::view::normals::NormalEncoding;

/// A flavour and whether the scene requires it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FlavourUse {
    /// The flavour's name.
    pub name: &'static str,
    /// Whether a pixel of the scene may need this flavour.
    pub required: bool,
    /// Fetches per pixel that this flavour should take with the estimator `fc5`, without the fetch for colour modulation.
    pub fetches_per_px: u32,
    /// Why the flavour is required or not.
    pub reason: String,
}

/// What a scene requires and what it does not require. The requirements follow from the scene file alone, without any world data.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Requirements {
    /// The scene's name.
    pub scene: String,
    /// All five flavours, in the order of their bits.
    pub flavours: Vec<FlavourUse>,
    /// The variants that classification can produce: the non-empty sets of required flavours, in the order of their numbers.
    #[serde(serialize_with = "variant_names")]
    pub variants: Vec<Variant>,
    /// Whether the terrain has holes. If so, the vertex shader reads the alpha of the baked albedo.
    pub holes: bool,
    /// Whether the colour modulation map is made and sampled.
    pub colour_modulation: bool,
    /// Textures whose size follows from the scene, required or not.
    pub textures: Vec<TextureUse>,
    /// Textures of the picture's size, with the default encoding of normals. All are required.
    pub targets: Vec<TargetUse>,
    /// Passes in the order of the frame, required or not.
    pub passes: Vec<PassUse>,
    /// The stages in the order of the frame: name, and what each stage reads and writes.
    pub stages: Vec<(&'static str, &'static str)>,
}

fn variant_names<S: Serializer>(variants: &[Variant], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(variants.iter().map(ToString::to_string))
}

impl Requirements {
    /// Returns the requirements of a (valid) scene: what the scene demands, and what the stages declare for these demands.
    pub fn of(scene: &Scene) -> Requirements {
        let demands = Demands::of(scene);
        let of_stages = || DECLARATIONS.iter();
        let mut textures = residency::textures(&demands);
        textures.extend(terrain::textures(&demands));
        textures.extend(of_stages().flat_map(|stage| (stage.textures)(&demands)));
        Requirements {
            scene: scene.name.clone(),
            flavours: demands.flavours.iter().map(FlavourUse::of).collect(),
            variants: demands.variants(),
            holes: demands.holes,
            colour_modulation: demands.colour_modulation,
            textures,
            targets: of_stages().flat_map(|stage| (stage.targets)(NormalEncoding::default())).collect(),
            passes: of_stages().flat_map(|stage| (stage.passes)(&demands)).collect(),
            stages: of_stages().map(|stage| (stage.name, stage.about)).collect(),
        }
    }

    /// Whether a pixel of the scene may need this flavour.
    pub fn has(&self, flavour: Flavour) -> bool {
        self.flavours.iter().any(|used| used.required && used.name == flavour.name())
    }

    /// Bytes of all required textures whose size follows from the scene. Textures of the picture's size are in [`Requirements::bytes_per_px`].
    pub fn bytes(&self) -> u64 {
        self.textures.iter().filter(|t| t.required).map(|t| t.bytes).sum()
    }

    /// Bytes per pixel of all textures of the picture's size together.
    pub fn bytes_per_px(&self) -> u32 {
        self.targets.iter().map(|t| t.bytes_per_px).sum()
    }
}

impl FlavourUse {
    fn of(demand: &FlavourDemand) -> FlavourUse {
        let &FlavourDemand { flavour, required, ref reason } = demand;
        FlavourUse { name: flavour.name(), required, fetches_per_px: Estimator::Fc5.promised_fetches(flavour), reason: reason.clone() }
    }
}

fn mib(bytes: u64) -> String {
    format!("{:.2} MiB", bytes as f64 / f64::from(1 << 20))
}

/// Writes a titled list, or nothing if the list is empty.
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
                ("required", format!("{} of textures, plus {} bytes per pixel", mib(self.bytes()), self.bytes_per_px()))
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
            section(f, "stages", self.stages.iter().filter(|_| required), |f, (name, about)| writeln!(f, "    {name:<26} {about}"))?;
            section(f, "passes", self.passes.iter().filter(|pass| pass.required == required), |f, pass| {
                writeln!(f, "    {:<26} {:>2} pipeline(s)  {}", pass.name, pass.pipelines, pass.reason)
            })?;
            section(f, "textures", self.textures.iter().filter(|t| t.required == required), |f, t| {
                let size = format!("{}x{}", t.size[0], t.size[1]);
                let bytes = mib(t.bytes);
                let (name, format, layers, mips) = (t.name, &t.format, t.layers, t.mips);
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

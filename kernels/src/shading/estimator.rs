//! Estimators: how near cliff, far cliff and splat arrive at their value. One table of what each takes.

use std::fmt;
use std::str::FromStr;

use crate::base::error::{Error, Result};
use crate::base::names::nearest;
use crate::variant::{Flavour, Variant};

/// How a flavour arrives at its value. Virtual texture and far atlas are the same in all.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// Far Cry 5's: random choices on cliffs (Moore, GDC 2018, "Cliff Shading").
    #[default]
    Fc5,
    /// The exact blend of what `Fc5` chooses from: its mean.
    Exact,
    /// The variance over seeds that theory gives `Fc5`, times [`VARIANCE_SCALE`], in place of albedo: the yardstick for measured variance.
    /// Of splat it has none.
    Variance,
    /// `Fc5` with the two projections that the surface faces most (Quilez, *Biplanar mapping*, 2020) instead of three.
    Biplanar,
    /// `Fc5` with hex-tiled textures (Mikkelsen, JCGT 11(2), 2022) in place of the second tiling scale; on far cliff the one scale is one
    /// of the two by chance, else it would step. Contrast is not preserved.
    Hex,
    /// One tap of one texel a texture: projection, material, scale, mip level and texel all by chance (Fajardo et al., *Stochastic Texture
    /// Filtering*, 2023). Its mean is that of `Fc5`'s near or far cliff; splat's, too, is near cliff's, since weights modified by height
    /// would take the heights of all four materials. Anisotropic filtering is left out.
    Stf,
    /// Two bands of a Laplacian pyramid (Burt and Adelson, 1983), coarse blended by bilinear weights, detail by weights modified by
    /// height. On far cliff at the lower of the two scales, which steps.
    Laplacian,
    /// Eight layers, always sampled, from above, one blended over the other (Luna, 2016).
    Luna8,
    /// Four materials in one projection: from above, or on steep ground a vertical plane of eight directions (after Terrain3D).
    Snapped,
    /// The mean of `Biplanar`.
    BiplanarMean,
    /// The mean of `Hex`.
    HexMean,
}

/// Factor on the variance that [`Estimator::Variance`] writes, so that f16 does not run into its denormals.
pub const VARIANCE_SCALE: f64 = 1024.0;

/// What an estimator takes on near cliff, far cliff and splat: fetches a pixel, and whether it draws random numbers.
struct Taken {
    name: &'static str,
    fetches: [u32; 3],
    draws: [bool; 3],
}

const fn taken(name: &'static str, fetches: [u32; 3], draws: [bool; 3]) -> Taken {
    Taken { name, fetches, draws }
}

const NOWHERE: [bool; 3] = [false; 3];
const ON_CLIFFS: [bool; 3] = [true, true, false];

impl Estimator {
    /// Those that make a picture.
    pub const ALL: [Estimator; 8] = [
        Estimator::Fc5,
        Estimator::Exact,
        Estimator::Biplanar,
        Estimator::Hex,
        Estimator::Stf,
        Estimator::Laplacian,
        Estimator::Luna8,
        Estimator::Snapped,
    ];

    /// Those that measure others.
    pub const YARDSTICKS: [Estimator; 3] = [Estimator::Variance, Estimator::BiplanarMean, Estimator::HexMean];

    const fn taken(self) -> Taken {
        match self {
            Estimator::Fc5 => taken("fc5", [12, 8, 48], ON_CLIFFS),
            Estimator::Exact => taken("exact", [48, 96, 48], NOWHERE),
            Estimator::Variance => taken("variance", [48, 96, 0], NOWHERE),
            Estimator::Biplanar => taken("biplanar", [8, 8, 32], ON_CLIFFS),
            Estimator::Hex => taken("hex", [30, 10, 120], ON_CLIFFS),
            Estimator::Stf => taken("stf", [4, 4, 4], [true; 3]),
            Estimator::Laplacian => taken("laplacian", [60, 60, 60], NOWHERE),
            Estimator::Luna8 => taken("luna8", [28, 28, 28], NOWHERE),
            Estimator::Snapped => taken("snapped", [16, 16, 16], NOWHERE),
            Estimator::BiplanarMean => taken("biplanar-mean", [32, 64, 32], NOWHERE),
            Estimator::HexMean => taken("hex-mean", [120, 240, 120], NOWHERE),
        }
    }

    /// Name in files and on the command line.
    pub const fn name(self) -> &'static str {
        self.taken().name
    }

    /// Place of a flavour in the tables; `None` where estimators make no difference.
    const fn place(flavour: Flavour) -> Option<usize> {
        match flavour {
            Flavour::VirtualTexture | Flavour::FarAtlas => None,
            Flavour::NearCliff => Some(0),
            Flavour::FarCliff => Some(1),
            Flavour::Splat => Some(2),
        }
    }

    /// Texture samples per pixel that a flavour takes by this estimator: what counted fetches are held against. Not in it: one for colour
    /// modulation, and splat's second tiling scale. [`Estimator::Variance`] reads nothing for what it does not measure.
    ///
    /// Those of [`Estimator::Fc5`] are Moore's (GDC 2018, "Near and Far Cliff Differences", with its two rows set right: ruling 1).
    pub const fn promised_fetches(self, flavour: Flavour) -> u32 {
        match Estimator::place(flavour) {
            Some(place) => self.taken().fetches[place],
            None => match (self, flavour) {
                (Estimator::Variance, _) => 0,
                (_, Flavour::VirtualTexture) => 4,
                _ => 2,
            },
        }
    }

    /// Sum of the promised fetches of a variant's flavours: the cost of a pixel that needs all of them.
    pub fn promised_fetches_of(self, variant: Variant) -> u32 {
        variant.flavours().map(|flavour| self.promised_fetches(flavour)).sum()
    }

    /// Whether a variant's picture depends on the seed.
    pub fn is_stochastic(self, variant: Variant) -> bool {
        variant.flavours().filter_map(Estimator::place).any(|place| self.taken().draws[place])
    }

    /// The estimator whose picture is this one's mean over seeds, on a flavour where it draws random numbers: for [`Estimator::Stf`] of splat
    /// it is that of near cliff.
    pub const fn mean(self) -> Estimator {
        match self {
            Estimator::Fc5 | Estimator::Stf => Estimator::Exact,
            Estimator::Biplanar => Estimator::BiplanarMean,
            Estimator::Hex => Estimator::HexMean,
            other => other,
        }
    }

    /// Whether splat can take two tiling scales; what others do is defined with one.
    pub const fn has_two_tilings(self) -> bool {
        matches!(self, Estimator::Fc5 | Estimator::Exact | Estimator::Biplanar | Estimator::BiplanarMean)
    }

    /// Whether detail textures are hex-tiled.
    pub(super) const fn is_hex_tiled(self) -> bool {
        matches!(self, Estimator::Hex | Estimator::HexMean)
    }
}

impl fmt::Display for Estimator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Estimator {
    type Err = Error;

    /// Accepts the names of those that make a picture.
    fn from_str(text: &str) -> Result<Estimator> {
        Estimator::ALL.into_iter().find(|e| e.name() == text).ok_or_else(|| {
            let names = Estimator::ALL.map(Estimator::name);
            let hint = nearest(text, &names).map_or_else(String::new, |near| format!("did you mean `{near}`? "));
            Error::Request(format!("`{text}` is no estimator: {hint}there are {}", names.join(", ")))
        })
    }
}

//! Estimators: how the flavours near cliff, far cliff and splat compute their values. One table lists the fetches of each estimator, and whether the
//! estimator draws random numbers.

use std::fmt;
use std::str::FromStr;

use crate::base::error::{Error, Result};
use crate::base::names::nearest;
use crate::variant::{Flavour, Variant};

/// How a flavour computes its value. Virtual texture and far atlas are the same in all estimators but [`Estimator::Variance`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Estimator {
    /// The estimator of Far Cry 5: random choices on cliffs (Moore, GDC 2018, "Cliff Shading").
    #[default]
    Fc5,
    /// The exact blend: the mean of `Fc5` over all its random choices.
    Exact,
    /// The theoretical variance of the albedo of `Fc5` over seeds, times [`VARIANCE_SCALE`]. It is written in place of albedo and is compared with
    /// the measured variance. The variance of splat is 0, because `Fc5` draws no random numbers there.
    Variance,
    /// `Fc5` with the two projections that the surface faces most (Quilez, *Biplanar mapping*, 2020) instead of three.
    Biplanar,
    /// `Fc5` with hex-tiled textures (Mikkelsen, JCGT 11(2), 2022) in place of the second tiling scale. Far cliff samples one scale, which is chosen
    /// at random from two, because a fixed choice would change the scale abruptly at some distances. Hex tiling reduces the contrast of textures.
    Hex,
    /// One tap that reads one texel of each texture. Projection, material, scale, mip level and texel are all chosen at random (Fajardo et al.,
    /// *Stochastic Texture Filtering*, 2023). There is no anisotropic filtering. If the anisotropy of the scene is 1, the mean of `Stf` on near and
    /// far cliff is the mean of `Fc5`. On splat, `Stf` has no height blend, which would need the heights of all four materials. So its mean there is
    /// the same as on near cliff.
    Stf,
    /// Two bands of a Laplacian pyramid (Burt and Adelson, 1983): the coarse band is blended with bilinear weights, the fine band with the weights of
    /// the height blend. Far cliff uses only the lower of the two tiling scales, so its scale changes abruptly at some distances.
    Laplacian,
    /// Eight layers, projected from above. All layers are sampled at every pixel, and each is blended over the layers before it (Luna, 2016).
    Luna8,
    /// Four materials in one projection: from above or, on steep ground, horizontally in one of eight directions (after Terrain3D).
    Snapped,
    /// The mean of `Biplanar` over all its random choices.
    BiplanarMean,
    /// The mean of `Hex` over all its random choices.
    HexMean,
}

/// Factor on the variance that [`Estimator::Variance`] writes, so that most f16 values stay out of the range of denormals.
pub const VARIANCE_SCALE: f64 = 1024.0;

/// Name of an estimator, its fetches per pixel on near cliff, far cliff and splat, and whether it draws random numbers on each of these
/// flavours.
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
    /// Estimators that a user can choose by name.
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

    /// Estimators that are drawn only to measure other estimators.
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

    /// Index of a flavour in the arrays of [`Taken`]; `None` for virtual texture and far atlas, which these arrays do not contain.
    const fn place(flavour: Flavour) -> Option<usize> {
        match flavour {
            Flavour::VirtualTexture | Flavour::FarAtlas => None,
            Flavour::NearCliff => Some(0),
            Flavour::FarCliff => Some(1),
            Flavour::Splat => Some(2),
        }
    }

    /// Fetches per pixel that a flavour should take with this estimator; counted fetches are compared with this number. It includes neither the fetch
    /// for colour modulation nor the fetches for the second tiling scale of splat. [`Estimator::Variance`] takes none for flavours that it does not
    /// measure.
    ///
    /// The numbers of [`Estimator::Fc5`] are from Moore (GDC 2018, "Near and Far Cliff Differences"). Ruling 1 in `ARCHITECTURE.md` corrects two rows
    /// of this slide.
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

    /// Sum of [`Estimator::promised_fetches`] over the flavours of a variant: the promised fetches of a pixel that needs all of them.
    pub fn promised_fetches_of(self, variant: Variant) -> u32 {
        variant.flavours().map(|flavour| self.promised_fetches(flavour)).sum()
    }

    /// Whether a variant's picture depends on the seed.
    pub fn is_stochastic(self, variant: Variant) -> bool {
        variant.flavours().filter_map(Estimator::place).any(|place| self.taken().draws[place])
    }

    /// Returns the estimator whose picture equals the mean of this estimator's pictures over seeds. An estimator without random choices is its own
    /// mean. For [`Estimator::Stf`], the result is only an approximation: the mean of `Stf` has no anisotropic filtering, and on splat it equals the
    /// mean of near cliff.
    pub const fn mean(self) -> Estimator {
        match self {
            Estimator::Fc5 | Estimator::Stf => Estimator::Exact,
            Estimator::Biplanar => Estimator::BiplanarMean,
            Estimator::Hex => Estimator::HexMean,
            other => other,
        }
    }

    /// Returns the reason why the mean of this estimator's pictures over seeds differs from the picture of [`Estimator::Exact`] by design. `None` if
    /// the two are equal.
    pub const fn bias(self) -> Option<&'static str> {
        match self {
            Estimator::Fc5 | Estimator::Exact => None,
            Estimator::Variance => Some("it is a variance and not a blend"),
            Estimator::Biplanar | Estimator::BiplanarMean => Some("it drops the projection that the surface faces least"),
            Estimator::Hex | Estimator::HexMean => Some("hex tiling reduces contrast and replaces the second tiling scale"),
            Estimator::Stf => Some("its mean is filtered trilinearly, and on splat its mean is the blend of near cliff"),
            Estimator::Laplacian => Some("its bands have different weights, and the coarse band is filtered trilinearly"),
            Estimator::Luna8 => Some("it projects from above and has eight materials"),
            Estimator::Snapped => Some("it has one projection"),
        }
    }

    /// Whether splat can blend two tiling scales with this estimator. If not, splat uses one scale.
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

    /// Accepts the names of [`Estimator::ALL`].
    fn from_str(text: &str) -> Result<Estimator> {
        Estimator::ALL.into_iter().find(|e| e.name() == text).ok_or_else(|| {
            let names = Estimator::ALL.map(Estimator::name);
            let hint = nearest(text, &names).map_or_else(String::new, |near| format!("did you mean `{near}`? "));
            Error::Request(format!("`{text}` is not an estimator: {hint}the estimators are {}", names.join(", ")))
        })
    }
}

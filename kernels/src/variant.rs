//! The five shading flavours and their 31 non-empty combinations.
//!
//! Pipelines, indirect arguments, the command line, scene files, metrics and tests use the definitions of this module.
//! Source: Moore, *Terrain Rendering in Far Cry 5*, GDC 2018, "Terrain Shader Variations".

use std::fmt;
use std::str::FromStr;

use crate::base::names::nearest;

/// One of the five ways in which a terrain pixel can be shaded. The discriminant is the flavour's bit in a mask. The descriptions of near cliff, far
/// cliff and splat are those of Far Cry 5; other estimators compute these flavours differently.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[repr(u8)]
pub enum Flavour {
    /// The blend of materials seen from above, sampled from cached pages of the virtual texture.
    VirtualTexture = 1,
    /// Albedo and normal that were baked into the data of a quadtree node.
    FarAtlas = 2,
    /// Three blended projections, each with one random splat material.
    NearCliff = 4,
    /// Two blended tilings, each with one random projection and one random material.
    FarCliff = 8,
    /// Three projections of four splat materials, all blended.
    Splat = 16,
}

impl Flavour {
    /// Every flavour, in the order of the bits.
    pub const ALL: [Flavour; 5] = [Flavour::VirtualTexture, Flavour::FarAtlas, Flavour::NearCliff, Flavour::FarCliff, Flavour::Splat];

    /// The flavour's bit in an 8-bit classification mask.
    pub const fn bit(self) -> u8 {
        self as u8
    }

    /// The flavour's index in arrays with one entry per flavour, 0..=4.
    pub const fn index(self) -> usize {
        self.bit().trailing_zeros() as usize
    }

    /// The name used in files, tables and on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Flavour::VirtualTexture => "vt",
            Flavour::FarAtlas => "far-atlas",
            Flavour::NearCliff => "near-cliff",
            Flavour::FarCliff => "far-cliff",
            Flavour::Splat => "splat",
        }
    }

    /// The flavour's colour in maps, sRGB. The hues resemble those that Okabe and Ito (2008) recommend, because colour-blind people can tell them
    /// apart.
    pub const fn colour(self) -> [u8; 3] {
        match self {
            Flavour::VirtualTexture => [86, 180, 90],
            Flavour::FarAtlas => [70, 110, 200],
            Flavour::NearCliff => [213, 94, 60],
            Flavour::FarCliff => [230, 170, 60],
            Flavour::Splat => [150, 90, 190],
        }
    }
}

/// A non-empty set of flavours: one shader variant, numbered 1 to 31.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Variant(u8);

/// The error for a text or number that is not a variant.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{given}` is not a variant: give a number from 1 to 31, or one or more of vt, far-atlas, near-cliff, far-cliff, splat, joined by `+` (as in `vt+near-cliff`){}{hint}",
    if hint.is_empty() { "" } else { "; " }
)]
pub struct NotAVariant {
    given: String,
    /// A suggestion, such as ``did you mean `vt`?``; may be empty.
    pub hint: String,
}

impl Variant {
    /// Number of variants.
    pub const COUNT: usize = 31;

    /// The variant with this mask; `None` if the mask is not in 1..=31.
    pub const fn new(mask: u8) -> Option<Variant> {
        if mask >= 1 && mask <= 31 { Some(Variant(mask)) } else { None }
    }

    /// The variant of a single flavour.
    pub const fn only(flavour: Flavour) -> Variant {
        Variant(flavour.bit())
    }

    /// All 31 variants, in the order of their numbers.
    pub fn all() -> impl Iterator<Item = Variant> {
        (1..=31).map(Variant)
    }

    /// The set as a bitmask, 1 to 31.
    pub const fn mask(self) -> u8 {
        self.0
    }

    /// Whether a flavour belongs to the set.
    pub const fn has(self, flavour: Flavour) -> bool {
        self.0 & flavour.bit() != 0
    }

    /// The flavours of the set, in the order of their bits.
    pub fn flavours(self) -> impl Iterator<Item = Flavour> {
        Flavour::ALL.into_iter().filter(move |&f| self.has(f))
    }

    /// The mean of the colours of the set's flavours, sRGB.
    pub fn colour(self) -> [u8; 3] {
        let count = self.0.count_ones();
        let mean = |k: usize| self.flavours().map(|f| u32::from(f.colour()[k])).sum::<u32>() / count;
        std::array::from_fn(|k| u8::try_from(mean(k)).unwrap_or(u8::MAX))
    }
}

impl fmt::Display for Variant {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = self.flavours().map(Flavour::name).collect();
        f.write_str(&names.join("+"))
    }
}

impl FromStr for Variant {
    type Err = NotAVariant;

    /// Accepts a number 1..=31, or names of flavours joined by `+`, in any order.
    fn from_str(text: &str) -> Result<Self, NotAVariant> {
        let wrong = |hint: String| NotAVariant { given: text.to_owned(), hint };
        if let Ok(number) = text.parse::<i64>() {
            return u8::try_from(number).ok().and_then(Variant::new).ok_or_else(|| wrong(String::new()));
        }
        let mut mask = 0;
        for part in text.split('+') {
            let part = part.trim();
            let Some(flavour) = Flavour::ALL.into_iter().find(|f| f.name() == part) else {
                let names = Flavour::ALL.map(Flavour::name);
                let hint = nearest(part, &names).map_or_else(String::new, |near| format!("did you mean `{near}`?"));
                return Err(wrong(hint));
            };
            mask |= flavour.bit();
        }
        Variant::new(mask).ok_or_else(|| wrong(String::new()))
    }
}

//! Functions that several stages share. Each WGSL file has a Rust reference with the same file name.
//!
//! A WGSL file contains free functions whose names begin with the topic of the file. It has no bindings, overrides or directives, so that any shader
//! can use it. The Rust function `hash::pcg4d` is named `hash_pcg4d` in WGSL; most names correspond in this way. Some descriptions of Rust functions
//! give the WGSL name explicitly.
//!
//! Most Rust functions are generic over [`real::Real`]. Their results in f64 count as exact. The error of their results in f32 shows which error to
//! expect of the shader.
//!
//! As a rule, NaN and infinity in an input do not reach the result of a function. There are three exceptions:
//!
//! - functions that only copy numbers, as their documentation says,
//! - conversions between types,
//! - the plain arithmetic of [`real`], [`signal`] and [`view`], which requires finite input.

pub mod biplanar;
pub mod blue_noise;
pub mod brdf;
pub mod culling;
pub mod derivatives;
pub mod flavour_weights;
pub mod hash;
pub mod hex_tiling;
pub mod layers;
pub mod moments;
pub mod motion;
pub mod noise;
pub mod normal_pair;
pub mod octahedral;
pub mod real;
pub mod select;
pub mod signal;
pub mod snapped_projection;
pub mod splat_blend;
pub mod texel_choice;
pub mod tiling;
pub mod triplanar;
mod usable;
pub mod view;

use crate::base::wgsl::{Constant, Wgsl};

macro_rules! shared_files {
    ($($name:ident = $topic:literal needs [$($need:ident),*] $(with $constants:expr)?,)*) => {
        $(
            #[doc = concat!("`", $topic, ".wgsl`.")]
            pub static $name: Wgsl =
                Wgsl::new(concat!("shared/", $topic, ".wgsl"), include_str!(concat!($topic, ".wgsl")), &[$(&$need),*])$(.with($constants))?;
        )*
        /// Every shared WGSL file except `signal.wgsl`, see [`SIGNAL`].
        pub static WGSL: &[&Wgsl] = &[$(&$name),*];
    };
}

shared_files! {
    USABLE = "usable" needs [],
    HASH = "hash" needs [],
    NOISE = "noise" needs [HASH, USABLE] with noise::CONSTANTS,
    OCTAHEDRAL = "octahedral" needs [USABLE],
    NORMAL_PAIR = "normal_pair" needs [OCTAHEDRAL],
    MOMENTS = "moments" needs [USABLE],
    MOTION = "motion" needs [USABLE] with &[
        ("MOTION_MIN_DISTANCE", Constant::real(motion::MIN_DISTANCE)),
        ("MOTION_FAR", Constant::real(motion::FAR)),
    ],
    VIEW = "view" needs [USABLE],
    DERIVATIVES = "derivatives" needs [OCTAHEDRAL, USABLE],
    SPLAT_BLEND = "splat_blend" needs [USABLE],
    TRIPLANAR = "triplanar" needs [OCTAHEDRAL, USABLE],
    BIPLANAR = "biplanar" needs [OCTAHEDRAL, USABLE],
    SNAPPED_PROJECTION = "snapped_projection" needs [OCTAHEDRAL, TRIPLANAR, USABLE],
    SELECT = "select" needs [USABLE],
    TILING = "tiling" needs [USABLE],
    HEX_TILING = "hex_tiling" needs [HASH, NOISE, USABLE],
    TEXEL_CHOICE = "texel_choice" needs [USABLE],
    LAYERS = "layers" needs [USABLE] with &[("LAYERS", Constant::U32(layers::LAYERS as u32))],
    FLAVOUR_WEIGHTS = "flavour_weights" needs [USABLE] with flavour_weights::CONSTANTS,
    BRDF = "brdf" needs [USABLE],
    CULLING = "culling" needs [OCTAHEDRAL, USABLE] with culling::CONSTANTS,
}

/// `signal.wgsl`: the packing of measured pixels. It is not part of [`WGSL`], because it converts to f16, for which a WGSL validator needs a separate
/// capability.
pub static SIGNAL: Wgsl = Wgsl::new("shared/signal.wgsl", include_str!("signal.wgsl"), &[&USABLE]).with(signal::CONSTANTS);

use usable::{bounded, usable};

//! What several stages share: pairs of a WGSL file and its reference of the same name.
//!
//! A WGSL file holds free functions, prefixed by its topic, without bindings, overrides or directives, so that any
//! shader can be made by joining [`WGSL`] with its own text. The Rust functions are generic over [`real::Real`]: f64 is the
//! truth, f32 the yardstick for the shader's error. `hash::pcg4d` here is `hash_pcg4d` there, and so on.
//! Nothing in either returns NaN or infinity, whatever it is given, unless its documentation says that it only moves numbers.

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

/// The shared shader sources as (name, text), in the order in which they are joined.
pub const WGSL: &[(&str, &str)] = &[
    ("usable", include_str!("usable.wgsl")),
    ("hash", include_str!("hash.wgsl")),
    ("noise", include_str!("noise.wgsl")),
    ("octahedral", include_str!("octahedral.wgsl")),
    ("normal_pair", include_str!("normal_pair.wgsl")),
    ("moments", include_str!("moments.wgsl")),
    ("motion", include_str!("motion.wgsl")),
    ("view", include_str!("view.wgsl")),
    ("derivatives", include_str!("derivatives.wgsl")),
    ("splat_blend", include_str!("splat_blend.wgsl")),
    ("triplanar", include_str!("triplanar.wgsl")),
    ("biplanar", include_str!("biplanar.wgsl")),
    ("snapped_projection", include_str!("snapped_projection.wgsl")),
    ("select", include_str!("select.wgsl")),
    ("tiling", include_str!("tiling.wgsl")),
    ("hex_tiling", include_str!("hex_tiling.wgsl")),
    ("texel_choice", include_str!("texel_choice.wgsl")),
    ("layers", include_str!("layers.wgsl")),
    ("flavour_weights", include_str!("flavour_weights.wgsl")),
    ("brdf", include_str!("brdf.wgsl")),
    ("culling", include_str!("culling.wgsl")),
];

/// The packing of measured pixels. Not part of [`WGSL`]: it converts to f16, which a validator counts as a capability of its own.
pub const SIGNAL_WGSL: (&str, &str) = ("signal", include_str!("signal.wgsl"));

use usable::{bounded, usable};

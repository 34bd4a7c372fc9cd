//! Eight layers blended one over the other. Layer 0 is opaque; each other layer has an opacity at each point.
//!
//! Source: Luna, *Introduction to 3D Game Programming with DirectX 12*, 2016, terrain rendering. If p are the opacities, the final weight of a layer
//! is w_i = p_i Π_{j>i} (1 - p_j). A blend map is normally painted. Here, the opacities follow from the splat map: p_j = m_j / Σ_{i≤j} m_i, where m_j
//! is the [`share`] of layer j. Shares sum to 1, so these opacities give w_i = m_i.

use super::bounded;
use super::real::Real;

/// Number of layers of the blend.
pub const LAYERS: usize = 8;

/// Share of `layer` at a point: the sum of the weights of the surrounding texels that show this layer. `layers` are the layers of the four texels,
/// `weights` their weights, each clamped to 0..=1. In WGSL: `layers_share`.
pub fn share<T: Real>(weights: [T; 4], layers: [u32; 4], layer: u32) -> T {
    let of_layer = weights.into_iter().zip(layers).filter(|&(_, l)| l == layer);
    of_layer.fold(T::zero(), |sum, (w, _)| sum + bounded(w, 0.0, 1.0))
}

/// Opacity of a layer, from its share and the sum of the shares of the layers below it. Layer 0 is opaque. Both numbers are clamped to 0..=1e30. In
/// WGSL: `layers_opacity`.
pub fn opacity<T: Real>(layer: u32, share: T, below: T) -> T {
    let [share, below] = [share, below].map(|x| bounded(x, 0.0, 1e30));
    if layer == 0 { T::one() } else { share / (share + below).max(T::of(1e-30)) }
}

/// Weights of the layers in the result, if each layer is blended over the layers below it. `opacities` are clamped to 0..=1.
pub fn weights<T: Real>(opacities: [T; LAYERS]) -> [T; LAYERS] {
    let opacities = opacities.map(|p| bounded(p, 0.0, 1.0));
    std::array::from_fn(|i| opacities[i + 1..].iter().fold(opacities[i], |w, &p| w * (T::one() - p)))
}

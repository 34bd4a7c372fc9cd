// Eight layers blended one over the other. Layer 0 is opaque; each other layer has an opacity at each point.
// Source: Luna, "Introduction to 3D Game Programming with DirectX 12", 2016, terrain rendering. If p are the opacities, the final weight of a layer
// is w_i = p_i prod_{j > i} (1 - p_j).

// Share of a layer at a point: the sum of the weights of the surrounding texels that show this layer. Opacities are computed from the shares; they
// are not read from a painted blend map.
fn layers_share(weights: vec4<f32>, layers: vec4<u32>, layer: u32) -> f32 {
    let w = usable_positive_4(weights, 1.0);
    return dot(select(vec4<f32>(0.0), w, layers == vec4<u32>(layer)), vec4<f32>(1.0));
}

// Opacity p_j = m_j / sum_{i <= j} m_i of a layer, where m are the shares of the layers. If the shares sum to 1, the final weights w_i then equal the
// shares m_i. `below` is the sum of the shares of the layers below. `share` and `below` are clamped to 0..=1e30.
fn layers_opacity(layer: u32, share: f32, below: f32) -> f32 {
    let m = usable_positive_2(vec2<f32>(share, below), 1e30);
    return select(m.x / max(m.x + m.y, 1e-30), 1.0, layer == 0u);
}

// Trilinear filtering by chance: one mip level and one texel, chosen so that the texel's expectation is the filtered value.
// Source: Fajardo, Wronski, Salvi, Pharr, "Stochastic Texture Filtering", 2023; Pharr et al., "Filtering After Shading with Stochastic
// Texture Filtering", I3D 2024. u are independent uniform numbers in [0, 1).

// Level of a texture of so many.
fn texel_choice_level(lod: f32, levels: u32, u: f32) -> u32 {
    let last = f32(max(levels, 1u) - 1u);
    let l = usable_positive_1(lod, last);
    let below = floor(l);
    return u32(min(below + select(0.0, 1.0, u < l - below), last));
}

// Texel along one axis of a level of `size` texels, repeated: one of the two whose centres are next to the coordinate.
fn texel_choice_texel(coordinate: f32, size: u32, u: f32) -> u32 {
    let texels = f32(max(size, 1u));
    let usable = select(0.0, coordinate, usable_within_1(coordinate, 1e5));
    // Whole repeats off first: they are not the texels' business, and cost digits.
    let x = (usable - floor(usable)) * texels - 0.5;
    let below = floor(x);
    let texel = below + select(0.0, 1.0, u < x - below);
    return u32(select(select(texel, 0.0, texel >= texels), texels - 1.0, texel < 0.0));
}

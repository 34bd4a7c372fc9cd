// Stochastic trilinear filtering: one mip level and one texel are chosen at random, so that the expected value of the texel is the filtered value.
// Source: Fajardo, Wronski, Salvi, Pharr, "Stochastic Texture Filtering", 2023; Pharr et al., "Filtering After Shading with Stochastic
// Texture Filtering", I3D 2024. The numbers u are independent and uniform in [0, 1).

// Mip level of a texture with `levels` levels: floor or ceiling of `lod`.
fn texel_choice_level(lod: f32, levels: u32, u: f32) -> u32 {
    let last = f32(max(levels, 1u) - 1u);
    let l = usable_positive_1(lod, last);
    let below = floor(l);
    return u32(min(below + select(0.0, 1.0, u < l - below), last));
}

// Texel along one axis of a repeated level with `size` texels: one of the two whose centres are next to the coordinate, which is in repeats of the
// texture.
fn texel_choice_texel(coordinate: f32, size: u32, u: f32) -> u32 {
    let texels = f32(max(size, 1u));
    let usable = select(0.0, coordinate, usable_within_1(coordinate, 1e5));
    // Whole repeats are removed first: they do not change the texel, and they cost digits.
    let x = (usable - floor(usable)) * texels - 0.5;
    let below = floor(x);
    let texel = below + select(0.0, 1.0, u < x - below);
    return u32(select(select(texel, 0.0, texel >= texels), texels - 1.0, texel < 0.0));
}

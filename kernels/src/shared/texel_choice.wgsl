// Stochastic trilinear filtering: one mip level and one texel are chosen at random, so that the expected value of the texel is the filtered value.
// Source: Fajardo, Wronski, Salvi, Pharr, "Stochastic Texture Filtering", 2023; Pharr et al., "Filtering After Shading with Stochastic Texture
// Filtering", I3D 2024. Each function takes a random number u, uniform in [0, 1). The level and each axis of the texel need independent numbers.

// Chooses a mip level of a texture with `levels` levels: the floor or the ceiling of `lod`.
fn texel_choice_level(lod: f32, levels: u32, u: f32) -> u32 {
    let last = f32(max(levels, 1u) - 1u);
    let l = usable_positive_1(lod, last);
    let below = floor(l);
    return u32(min(below + select(0.0, 1.0, u < l - below), last));
}

// Chooses a texel along one axis of a mip level of a repeating texture; the level has `size` texels along this axis. The result is one of the two
// texels whose centres are nearest to the coordinate. The unit of the coordinate is one repeat of the texture.
fn texel_choice_texel(coordinate: f32, size: u32, u: f32) -> u32 {
    let texels = f32(max(size, 1u));
    let usable = select(0.0, coordinate, usable_within_1(coordinate, 1e5));
    // Whole repeats do not change the texel. They are removed first; otherwise, the product with the number of texels would lose digits of the
    // fraction. The centre of texel i is at i + 0.5 texels, so 0.5 is subtracted.
    let x = (usable - floor(usable)) * texels - 0.5;
    let below = floor(x);
    let texel = below + select(0.0, 1.0, u < x - below);
    return u32(select(select(texel, 0.0, texel >= texels), texels - 1.0, texel < 0.0));
}

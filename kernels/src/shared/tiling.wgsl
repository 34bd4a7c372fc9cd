// Texture tiling: scales that follow distance, and coordinates that stay exact far from the origin.
// Source: Moore, "Terrain Rendering in Far Cry 5", GDC 2018 (cliff tiling).

// A pixel blends two neighbouring scales, s and s + 1. This is the largest s. At this scale, a repeat of a texture is 2^7 times as wide as at
// scale 0; at the upper scale, it is 2^8 times as wide.
const TILING_MAX_LEVEL: f32 = 7.0;

// Returns (s, f): blend scale s with weight 1 - f and scale s + 1 with weight f. At scale s, a repeat of a texture is 2^s times as wide as
// at scale 0. There is one scale per octave of `distance` beyond `near` (both in metres). `cliff`, 0..=1, is the weight of cliff; flat
// ground keeps scale 0.
fn tiling_scales(distance: f32, near: f32, cliff: f32) -> vec2<f32> {
    let reference = max(usable_positive_1(near, 1e9), 1e-6);
    let ratio = max(usable_positive_1(distance, 1e9) / reference, 1.0);
    let weight = usable_positive_1(cliff, 1.0);
    let level = clamp(log2(ratio), 0.0, TILING_MAX_LEVEL) * weight;
    let scale = min(floor(level), TILING_MAX_LEVEL);
    return vec2<f32>(scale, clamp(level - scale, 0.0, 1.0));
}

// Texture coordinate of a sector's origin, [0, 1), rounded down to 24 bits: fract(sector * c / 2^scale), where c, the repeats
// per sector, is given as `per_sector_fixed` = c * 2^24 and may wrap. `scale` is at most 8, so products modulo 2^32 suffice.
// The caller adds (position in sector / sector size) * c / 2^scale, with the same rounded c, so that textures are continuous across sector
// borders.
fn tiling_fixed(sector: i32, per_sector_fixed: i32, scale: u32) -> f32 {
    let s = min(scale, 8u);
    // A mask of 24 + s bits. It is made by a right shift by 8 - s, because a left shift by 24 + s would be a shift by 32 bits if s is 8.
    let repeat = (bitcast<u32>(sector) * bitcast<u32>(per_sector_fixed)) & (0xffffffffu >> (8u - s));
    return f32(repeat >> s) * 5.9604644775390625e-8;
}

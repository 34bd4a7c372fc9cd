// Hex tiling: the plane is divided into hexagons, each of which shows the texture at a random offset; around a point, three hexagons are blended.
// Source: Mikkelsen, "Practical Real-Time Hex-Tiling", JCGT 11(2), 2022, after Heitz & Neyret, "High-Performance By-Example Noise using a
// Histogram-Preserving Blending Operator", HPG 2018. This file uses Mikkelsen's exponent 7 on barycentric weights, but neither his
// weighting by luminance nor his rotations. Contrast is not preserved: blending three independent offsets with the weights w1, w2 and w3 multiplies
// the variance of a texture by w1^2 + w2^2 + w3^2. Hexagons lie in the plane of the projection. The number of hexagons along a sector is a power of
// two, so that the ids of hexagons are exact integers everywhere.

// Smallest and largest level: a sector has 2^level hexagons along its edge.
const HEX_TILING_LEVEL_MIN: i32 = -10;
const HEX_TILING_LEVEL_MAX: i32 = 15;
// 1 / sqrt 3 = 0.5774 as the fraction 37 / 64, so that the edge of a sector is a whole number of fixed-point steps, which are 2^-16 of the lattice
// spacing. The fraction distorts the hexagons by 0.13 %.
const HEX_TILING_SKEW: u32 = 37u;
const HEX_TILING_SKEW_BITS: u32 = 6u;

struct HexTiling {
    // Ids, modulo 2^16, of the hexagons around the point.
    first: vec2<u32>,
    second: vec2<u32>,
    third: vec2<u32>,
    weights: vec3<f32>,         // sum to 1
}

// The level (2^level hexagons along a sector) for a texture that repeats `repeats` times along a sector: nearest to Mikkelsen's 2 sqrt 3 hexagons per
// repeat. The constant is log2(2 sqrt 3) + 1/2; the half makes `floor` round to the nearest level.
fn hex_tiling_level(repeats: f32) -> i32 {
    let usable = max(usable_positive_1(repeats, 1e6), 1e-6);
    return clamp(i32(floor(log2(usable) + 2.2924813)), HEX_TILING_LEVEL_MIN, HEX_TILING_LEVEL_MAX);
}

fn hex_tiling_power(w: f32) -> f32 {
    let square = w * w;
    return square * square * square * w;
}

// The hexagons around a point. Both coordinates are given as `sector` whole sectors plus `position` metres, |position| at most a few sectors.
fn hex_tiling_at(sector: vec2<i32>, position: vec2<f32>, sector_m: f32, level: i32) -> HexTiling {
    let k = clamp(level, HEX_TILING_LEVEL_MIN, HEX_TILING_LEVEL_MAX);
    // Skewed coordinates a = x - y / sqrt 3, b = 2 y / sqrt 3 in units of the lattice spacing. Whole sectors are in fixed point, with 16 bits before
    // and 16 bits after the binary point.
    let s = bitcast<vec2<u32>>(sector);
    let step = u32(k - HEX_TILING_LEVEL_MIN);
    let skewed_y = s.y * (HEX_TILING_SKEW << step);
    // In fixed point, the edge of a sector is 2^(16 + k) = 2^(6 + step).
    let whole = vec2<u32>((s.x << (HEX_TILING_SKEW_BITS + step)) - skewed_y, skewed_y << 1u);
    let spacings = noise_power_of_two(k) / max(usable_positive_1(sector_m, 1e30), 1e-6);
    let limit = vec2<f32>(1e9);
    let p = clamp(usable_2(position) * spacings, -limit, limit);
    let skew = f32(HEX_TILING_SKEW) / 64.0;
    let at = vec2<f32>(whole & vec2<u32>(0xffffu)) * 0.0000152587890625 + vec2<f32>(p.x - skew * p.y, 2.0 * skew * p.y);
    let corner = floor(at);
    let f = clamp(at - corner, vec2<f32>(0.0), vec2<f32>(1.0));
    let id = (whole >> vec2<u32>(16u)) + bitcast<vec2<u32>>(vec2<i32>(corner));
    // A cell of the skewed lattice consists of two triangles. The corners of a triangle are the centres of three hexagons, and the weights
    // of the hexagons are the barycentric coordinates in this triangle, sharpened.
    let upper = f.x + f.y >= 1.0;
    var w = vec3<f32>(1.0 - f.x - f.y, f.x, f.y);
    if upper {
        w = vec3<f32>(f.x + f.y - 1.0, 1.0 - f.y, 1.0 - f.x);
    }
    let r = max(w, vec3<f32>(0.0)) / max(max(w.x, w.y), w.z);
    let sharp = vec3<f32>(hex_tiling_power(r.x), hex_tiling_power(r.y), hex_tiling_power(r.z));
    let mask = vec2<u32>(0xffffu);
    let first = id + vec2<u32>(select(0u, 1u, upper));
    return HexTiling(
        first & mask, (id + vec2<u32>(1u, 0u)) & mask, (id + vec2<u32>(0u, 1u)) & mask, sharp / (sharp.x + sharp.y + sharp.z)
    );
}

// Id of one of the three hexagons, i = 0..=2.
fn hex_tiling_id(tiling: HexTiling, i: u32) -> vec2<u32> {
    if i == 0u {
        return tiling.first;
    }
    return select(tiling.third, tiling.second, i == 1u);
}

// Offset of the texture in a hexagon, [0, 1)^2; `salt` distinguishes lattices.
fn hex_tiling_offset(id: vec2<u32>, salt: u32) -> vec2<f32> {
    let h = hash_pcg4d(vec4<u32>(id, salt, 0u));
    return vec2<f32>(hash_to_unit(h.x), hash_to_unit(h.y));
}

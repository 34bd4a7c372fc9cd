// Random thresholds in [0, 1) for stochastic choices. Each call returns four independent thresholds, one for each random decision of a pixel.
// Source of the two hashed kinds: Wyman & McGuire, "Hashed Alpha Testing", I3D 2017. The wanted width of a cell follows from screen derivatives (one
// width for all axes, or one per axis), but the widths of cells are powers of two. The random numbers of the two widths next to the wanted one are
// blended, and the distribution function of the blend converts the result to a uniform number.
// Cells are exact integers (sector index times cells per sector, plus cell in sector), so the noise works equally well at the origin and 1000 km from
// it. noise.rs describes the other kinds of noise, and the constants NOISE_... that the host passes to this file.

// A scale is a number k from NOISE_LEVEL_MIN to NOISE_LEVEL_MAX and means 2^k cells per metre. The width of a sector is a power of two and at least
// 32 m, so its edge is a whole number of cells long for every k. noise_finest returns the largest k for a place.
// The buffer of ranks stores the blue-noise mask, then the slices of the spatio-temporal mask, each with NOISE_MASK_EDGE x NOISE_MASK_EDGE ranks, row
// by row.

// The largest f32 below 1.
const NOISE_BELOW_ONE: f32 = 0.99999994;
// Smallest position that does not count as 0: 2^-100 m. Its product with any number of cells per metre is not denormal.
const NOISE_LEAST_M: f32 = 7.8886091e-31;

// The finest scale along an axis whose coordinates have magnitudes up to |largest|, m. A cell is then at least 16 times as wide as the distance
// between neighbouring f32 values, so that rounding seldom moves a position to another cell.
fn noise_finest_along(largest: f32) -> i32 {
    // log2, rounded to the nearest whole number. It is read from the bits, because the function log2 is not exact, and its rounded result could be
    // wrong by 1.
    let bits = bitcast<u32>(largest);
    let octave = i32((bits >> 23u) & 0xffu) - 127 + select(0, 1, (bits & 0x7fffffu) >= NOISE_OCTAVE_BORDER);
    return clamp(i32(NOISE_FINEST_AT_1_M) - octave, i32(NOISE_LEVEL_MIN) + 1, i32(NOISE_LEVEL_MAX));
}

// The finest scale along each axis. The scales along east and north follow from the width of a sector and not from the position. So they are the same
// in all sectors, and there is no seam between sectors.
fn noise_finest(sector_m: f32, elevation: f32) -> vec3<i32> {
    let across = noise_finest_along(usable_positive_1(sector_m, 1e12));
    return vec3<i32>(across, across, noise_finest_along(usable_1(elevation)));
}

// The finest scale of cells that are equally wide along all axes.
fn noise_finest_of_all(sector_m: f32, elevation: f32) -> i32 {
    let finest = noise_finest(sector_m, elevation);
    return min(finest.x, finest.z);
}

// The scale, log2(cells per metre), at which a cell is `footprint` metres wide. The finest scale if the footprint is zero or NaN.
fn noise_level(footprint: f32, finest: i32) -> f32 {
    return clamp(-log2(max(usable_positive_1(footprint, 1e6), 1e-6)), NOISE_LEVEL_MIN, f32(finest));
}

// The lower of the two scales around a level. The upper scale is always the next integer, so that the cells of the two scales differ even
// if the level is a whole number.
fn noise_lower(level: f32, finest: i32) -> f32 {
    return clamp(floor(level), NOISE_LEVEL_MIN, f32(finest - 1));
}

// 2^k, exactly: exp2 may be off by some ulp, which would move cell borders.
fn noise_power_of_two(k: i32) -> f32 {
    return bitcast<f32>(u32(clamp(k, -126, 127) + 127) << 23u);
}

// The coordinate from which a cell is computed. Tiny positions count as 0. There is a border between two cells at 0. Some devices flush tiny negative
// numbers to zero and other devices do not, so without this rule, devices would compute different cells.
fn noise_place(position: f32) -> f32 {
    return usable_1(select(0.0, position, abs(position) >= NOISE_LEAST_M));
}

// Cell along one axis whose coordinate is split into sector and position in the sector.
fn noise_cell(sector: i32, position: f32, sector_m: f32, k: i32) -> u32 {
    let cells_per_metre = noise_power_of_two(k);
    let cells_per_sector = u32(usable_positive_1(sector_m * cells_per_metre, 2147483520.0));
    let cell = i32(clamp(floor(noise_place(position) * cells_per_metre), -2147483520.0, 2147483520.0));
    return bitcast<u32>(sector) * cells_per_sector + bitcast<u32>(cell);
}

// Cell along the elevation. Borders are a third of a cell above the multiples of the cell width. Level ground is often at an elevation of whole
// metres; on a border, rounding would move it from one cell to another.
fn noise_cell_up(elevation: f32, k: i32) -> u32 {
    let scaled = noise_place(elevation) * noise_power_of_two(k);
    return noise_cell(0, elevation, 0.0, k) + select(0u, 1u, scaled - floor(scaled) >= NOISE_BORDER);
}

// Four uniform numbers of the cell that contains the point, at 2^k cells per metre on each axis.
fn noise_cell_units(sector: vec2<i32>, position: vec3<f32>, sector_m: f32, k: vec3<i32>, seed: u32, salt: u32) -> vec4<f32> {
    let biased = vec3<u32>(k + vec3<i32>(128));
    let level = biased.x | (biased.y << 8u) | (biased.z << 16u);
    let h = hash_pcg4d(vec4<u32>(
        noise_cell(sector.x, position.x, sector_m, k.x),
        noise_cell(sector.y, position.y, sector_m, k.y),
        noise_cell_up(position.z, k.z),
        hash_mix(seed, salt, level),
    ));
    return vec4<f32>(hash_to_unit(h.x), hash_to_unit(h.y), hash_to_unit(h.z), hash_to_unit(h.w));
}

// The probability that (1-l) U1 + l U2 < x, where U1 and U2 are independent and uniform, and l is `lerp_factor`. It converts the blend to a uniform
// number. The result is in [0, 1); it is x itself if l is 0 or 1.
fn noise_correct(x: f32, lerp_factor: f32) -> f32 {
    let l = usable_positive_1(lerp_factor, 1.0);
    let y = usable_positive_1(x, 1.0);
    let a = min(l, 1.0 - l);
    var p = (y - 0.5 * a) / (1.0 - a);
    // Both conditions imply that a is above 0, so the divisions are safe. Dividing before squaring avoids underflow for small a.
    if y < a {
        p = 0.5 * y * (y / a) / (1.0 - a);
    } else if 1.0 - y < a {
        p = 1.0 - 0.5 * (1.0 - y) * ((1.0 - y) / a) / (1.0 - a);
    }
    return clamp(p, 0.0, NOISE_BELOW_ONE);
}

fn noise_blend(coarse: vec4<f32>, fine: vec4<f32>, lerp_factor: f32) -> vec4<f32> {
    let x = (1.0 - lerp_factor) * coarse + lerp_factor * fine;
    return vec4<f32>(
        noise_correct(x.x, lerp_factor),
        noise_correct(x.y, lerp_factor),
        noise_correct(x.z, lerp_factor),
        noise_correct(x.w, lerp_factor),
    );
}

// Hashed alpha with one scale for all axes. `position`: x, y metres in the sector, z metres of elevation; `ddx`, `ddy`: position's screen
// derivatives, metres per pixel; `hash_scale`: cell size in pixels; `sector_m`: a power of two, 32..=16384.
fn noise_hashed_isotropic(sector: vec2<i32>, position: vec3<f32>, sector_m: f32, ddx: vec3<f32>, ddy: vec3<f32>, hash_scale: f32, seed: u32, salt: u32) -> vec4<f32> {
    let finest = noise_finest_of_all(sector_m, position.z);
    let level = noise_level(hash_scale * max(length(ddx), length(ddy)), finest);
    let lower = noise_lower(level, finest);
    let k = vec3<i32>(i32(lower));
    let coarse = noise_cell_units(sector, position, sector_m, k, seed, salt);
    let fine = noise_cell_units(sector, position, sector_m, k + vec3<i32>(1), seed, salt);
    return noise_blend(coarse, fine, level - lower);
}

// Hashed alpha with one scale per axis. The parameters are those of noise_hashed_isotropic.
fn noise_hashed_anisotropic(sector: vec2<i32>, position: vec3<f32>, sector_m: f32, ddx: vec3<f32>, ddy: vec3<f32>, hash_scale: f32, seed: u32, salt: u32) -> vec4<f32> {
    // A component of a derivative is at most as long as the derivative, so cells would be smaller on average than those of the isotropic kind. The
    // factor sqrt 2 compensates for this.
    let across = 1.41421356 * hash_scale * max(abs(ddx), abs(ddy));
    let width = vec3<f32>(usable_positive_1(across.x, 1e6), usable_positive_1(across.y, 1e6), usable_positive_1(across.z, 1e6));
    // On level ground, the elevation does not change between pixels. Without a limit, cells would be so low that rounding errors of the elevation
    // change the cell.
    let footprint = max(width, vec3<f32>(NOISE_LEAST_SHARE * max(width.x, max(width.y, width.z))));
    let finest = noise_finest(sector_m, position.z);
    let level = vec3<f32>(noise_level(footprint.x, finest.x), noise_level(footprint.y, finest.y), noise_level(footprint.z, finest.z));
    let lower = vec3<f32>(noise_lower(level.x, finest.x), noise_lower(level.y, finest.y), noise_lower(level.z, finest.z));
    let k = vec3<i32>(lower);
    let coarse = noise_cell_units(sector, position, sector_m, k, seed, salt);
    let fine = noise_cell_units(sector, position, sector_m, k + vec3<i32>(1), seed, salt);
    // `part` is a point of the unit cube. The coarse scales are the corner (0, 0, 0), the fine scales the corner (1, 1, 1). The weight of the fine
    // scales follows from the distances to these two corners, which are never both zero.
    let part = level - lower;
    let to_coarse = length(part);
    let to_fine = length(vec3<f32>(1.0) - part);
    return noise_blend(coarse, fine, to_coarse / (to_coarse + to_fine));
}

// White noise per pixel and frame: the screen-space noise with which hashed alpha is compared.
fn noise_white_screen(pixel: vec2<u32>, frame: u32, seed: u32, salt: u32) -> vec4<f32> {
    let h = hash_pcg4d(vec4<u32>(pixel, frame, hash_mix(seed, salt, 0u)));
    return vec4<f32>(hash_to_unit(h.x), hash_to_unit(h.y), hash_to_unit(h.z), hash_to_unit(h.w));
}

// White noise per cell of a fixed grid in the world. Cells are 2^-level m wide. `level` is clamped to the range from NOISE_LEVEL_MIN to the finest
// scale of the place.
fn noise_white_world(sector: vec2<i32>, position: vec3<f32>, sector_m: f32, level: i32, seed: u32, salt: u32) -> vec4<f32> {
    let k = clamp(level, i32(NOISE_LEVEL_MIN), noise_finest_of_all(sector_m, position.z));
    return noise_cell_units(sector, position, sector_m, vec3<i32>(k), seed, salt);
}

// The high word of the 64-bit product of two words.
fn noise_high_product(a: u32, b: u32) -> u32 {
    let low = (a & 0xffffu) * (b & 0xffffu);
    let middle = (a >> 16u) * (b & 0xffffu) + (low >> 16u);
    let other = (a & 0xffffu) * (b >> 16u) + (middle & 0xffffu);
    return (a >> 16u) * (b >> 16u) + (middle >> 16u) + (other >> 16u);
}

// Interleaved gradient noise as published, in units of 2^-32.
fn noise_interleaved_gradient_value(pixel: vec2<u32>, frame: u32) -> u32 {
    let inner = pixel.x * NOISE_IGN_SLOPE_X + pixel.y * NOISE_IGN_SLOPE_Y + frame * NOISE_IGN_FRAME;
    return inner * NOISE_IGN_WHOLE + noise_high_product(inner, NOISE_IGN_REST);
}

// Interleaved gradient noise for four decisions. For each decision, the pixel is shifted by whole pixels, and the value gets an offset modulo 1. A
// shift changes all values by almost the same amount, so it does not make the decisions independent. They therefore also use the pixel coordinates in
// four different ways: as they are, mirrored, transposed, and both.
fn noise_interleaved_gradient(pixel: vec2<u32>, frame: u32, seed: u32, salt: u32) -> vec4<f32> {
    var units: vec4<f32>;
    for (var decision = 0u; decision < 4u; decision++) {
        let h = hash_pcg4d(vec4<u32>(seed, salt, decision, NOISE_IGN_FRAME));
        let shifted = pixel + h.xy;
        var turned = select(shifted, shifted.yx, decision >= 2u);
        turned.y = select(turned.y, ~turned.y, (decision & 1u) != 0u);
        units[decision] = hash_to_unit(noise_interleaved_gradient_value(turned, frame) + h.z);
    }
    return units;
}

// Whether a kind of noise uses ranks, which the caller then has to load.
fn noise_needs_mask(kind: u32) -> bool {
    return kind == NOISE_BLUE || kind == NOISE_SPATIO_TEMPORAL_BLUE;
}

// Returns the index in the buffer of ranks at which the rank of a pixel is stored. A pixel makes up to four random decisions, each with a
// rank of its own; `decision` is 0..=3. The mask is repeated over the screen, and shifted by an offset that depends on seed, salt and
// decision; the shift does not change its spectrum. The index is 0 for kinds of noise without a mask.
fn noise_rank_index(kind: u32, pixel: vec2<u32>, frame: u32, seed: u32, salt: u32, decision: u32) -> u32 {
    if !noise_needs_mask(kind) {
        return 0u;
    }
    let slice = select(0u, 1u + frame % NOISE_MASK_SLICES, kind == NOISE_SPATIO_TEMPORAL_BLUE);
    let shifted = (pixel + hash_pcg4d(vec4<u32>(seed, salt, decision, NOISE_MASK_EDGE)).xy) % vec2<u32>(NOISE_MASK_EDGE);
    return slice * NOISE_MASK_RANKS + shifted.y * NOISE_MASK_EDGE + shifted.x;
}

// Converts four ranks of a mask to thresholds: (rank + jitter) / number of ranks. A threshold has 12 bits of the rank, then 12 bits of the jitter,
// which is a hash. The jitter changes with the frame only if the ranks change with it.
fn noise_mask(kind: u32, pixel: vec2<u32>, frame: u32, seed: u32, salt: u32, ranks: vec4<u32>) -> vec4<f32> {
    let fresh = select(0u, frame, kind == NOISE_SPATIO_TEMPORAL_BLUE);
    let jitter = hash_pcg4d(vec4<u32>(pixel, fresh, hash_mix(seed, salt, 1u)));
    let u = (min(ranks, vec4<u32>(NOISE_MASK_RANKS - 1u)) << vec4<u32>(20u)) | (jitter >> vec4<u32>(12u));
    return vec4<f32>(hash_to_unit(u.x), hash_to_unit(u.y), hash_to_unit(u.z), hash_to_unit(u.w));
}

// Thresholds of the given kind of noise; an unknown kind gives white noise. `world_level` is the log2 of the number of fixed cells per metre. `ranks`
// are the ranks at noise_rank_index for decisions 0 to 3; kinds without a mask do not use them.
fn noise_thresholds(
    kind: u32,
    sector: vec2<i32>,
    position: vec3<f32>,
    sector_m: f32,
    ddx: vec3<f32>,
    ddy: vec3<f32>,
    hash_scale: f32,
    world_level: i32,
    pixel: vec2<u32>,
    frame: u32,
    seed: u32,
    salt: u32,
    ranks: vec4<u32>,
) -> vec4<f32> {
    if kind == NOISE_HASHED_ISOTROPIC {
        return noise_hashed_isotropic(sector, position, sector_m, ddx, ddy, hash_scale, seed, salt);
    }
    if kind == NOISE_HASHED_ANISOTROPIC {
        return noise_hashed_anisotropic(sector, position, sector_m, ddx, ddy, hash_scale, seed, salt);
    }
    if kind == NOISE_WHITE_WORLD {
        return noise_white_world(sector, position, sector_m, world_level, seed, salt);
    }
    if kind == NOISE_INTERLEAVED_GRADIENT {
        return noise_interleaved_gradient(pixel, frame, seed, salt);
    }
    if noise_needs_mask(kind) {
        return noise_mask(kind, pixel, frame, seed, salt, ranks);
    }
    return noise_white_screen(pixel, frame, seed, salt);
}

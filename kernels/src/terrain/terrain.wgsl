// Terrain data for any world position. The sector data give the node at a position and its layer in the atlases. The splat texels of the node give
// the materials and their detail textures. Shading calls `count_fetch` before each texture access that reads terrain data.

override COUNT_FETCHES: bool = false;
// Whether detail textures are filtered anisotropically, with the gradients of the texture coordinates along both axes of the screen. If not,
// filtering is isotropic, and the longer of the two gradients gives the mip level of each texture.
override ANISOTROPIC: bool = false;
// Whether detail textures are hex-tiled: each is sampled three times, at random offsets.
override HEX_TILING: bool = false;

struct PaletteEntry {
    albedo_layer: u32,
    normal_layer: u32,
    height_layer: u32,
    flags: u32,
    per_sector_fixed: vec2<i32>,    // repeats per sector, times cos and sin of the orientation; 24 fractional bits
    per_metre: vec2<f32>,           // cos and sin of the orientation, divided by the width of one repeat in metres
    tint: vec3<f32>,
    normal_strength: f32,
    mean_albedo: vec3<f32>,
    mean_smoothness: f32,
}

@group(1) @binding(0) var height_atlas: texture_2d_array<f32>;
@group(1) @binding(1) var normal_atlas: texture_2d_array<f32>;
@group(1) @binding(2) var albedo_atlas: texture_2d_array<f32>;
@group(1) @binding(3) var colour_modulation_atlas: texture_2d_array<f32>;
@group(1) @binding(4) var splat_atlas: texture_2d_array<u32>;
@group(1) @binding(5) var<storage, read> sector_data: array<vec2<u32>>;
// This is a uniform buffer and not a storage buffer, because a software Vulkan driver reads a uniform buffer with gather instructions, but a storage
// buffer in a loop over the SIMD lanes.
@group(1) @binding(6) var<uniform> palette: array<PaletteEntry, 256>;
@group(1) @binding(7) var detail_albedo: texture_2d_array<f32>;
@group(1) @binding(8) var detail_normal: texture_2d_array<f32>;
@group(1) @binding(9) var detail_height: texture_2d_array<f32>;
@group(1) @binding(10) var detail_sampler: sampler;
@group(1) @binding(11) var atlas_sampler: sampler;

var<private> fetch_count: u32;

fn count_fetch() {
    if COUNT_FETCHES {
        fetch_count += 1u;
    }
}

// A position on the terrain: the sector, and metres inside the sector.
struct Place {
    sector: vec2<i32>,
    position: vec3<f32>,        // x, y in the sector, z = elevation
}

fn terrain_place(sector: vec2<i32>, local: vec3<f32>) -> Place {
    let steps = floor(local.xy / frame.sector_m);
    return Place(sector + vec2<i32>(steps), vec3<f32>(local.xy - steps * frame.sector_m, local.z));
}

// The finest loaded node at a position: its atlas slot (0 = no node is loaded there), and the position in the node, 0..1.
struct NodePlace {
    slot: u32,
    uv: vec2<f32>,
}

fn terrain_node(place: Place) -> NodePlace {
    let sector = clamp(place.sector, vec2<i32>(0), vec2<i32>(TERRAIN_SECTORS - 1));
    let packed = sector_data[sector.y * TERRAIN_SECTORS + sector.x];
    for (var lod = 0u; lod < TERRAIN_LODS; lod++) {
        let bit = lod * TERRAIN_SLOT_BITS;
        var slot = 0u;
        if bit < 30u {
            slot = (packed.x >> bit) & ((1u << TERRAIN_SLOT_BITS) - 1u);
        } else if bit == 30u {
            slot = (packed.x >> 30u) | ((packed.y & 255u) << 2u);
        } else {
            slot = (packed.y >> (bit - 32u)) & ((1u << TERRAIN_SLOT_BITS) - 1u);
        }
        if slot != 0u {
            let edge = 1 << lod;
            let in_node = vec2<f32>(sector & vec2<i32>(edge - 1)) + clamp(place.position.xy / frame.sector_m + vec2<f32>(place.sector - sector), vec2<f32>(0.0), vec2<f32>(1.0));
            return NodePlace(slot, in_node / f32(edge));
        }
    }
    return NodePlace(0u, vec2<f32>(0.0));
}

// Converts a position in a node, 0..1, to the texture coordinate in an atlas. A layer has 128 x 128 texels and a border of 2 texels on each side.
fn terrain_atlas_uv(node_uv: vec2<f32>) -> vec2<f32> {
    return (node_uv * 128.0 + 2.0) / 132.0;
}

struct TerrainNormal {
    normal: vec3<f32>,
    smoothness: f32,
    specular_occlusion: f32,
}

fn terrain_unpack_normal(texel: vec4<f32>) -> vec3<f32> {
    let xy = vec2<f32>(texel.a, texel.g) * 2.0 - 1.0;
    return normalize(vec3<f32>(xy, sqrt(max(1.0 - dot(xy, xy), 1e-4))));
}

fn terrain_normal(slot: u32, node_uv: vec2<f32>) -> TerrainNormal {
    let texel = textureSampleLevel(normal_atlas, atlas_sampler, terrain_atlas_uv(node_uv), slot, 0.0);
    return TerrainNormal(terrain_unpack_normal(texel), texel.r, texel.b);
}

// The four splat texels around a position, and the position between them as fractions 0..1.
struct SplatCell {
    slot: u32,
    corner: vec2<i32>,
    fraction: vec2<f32>,
}

fn terrain_splat_cell(node: NodePlace) -> SplatCell {
    let at = node.uv * 64.0;
    let corner = clamp(floor(at), vec2<f32>(0.0), vec2<f32>(63.0));
    return SplatCell(node.slot, vec2<i32>(corner), clamp(at - corner, vec2<f32>(0.0), vec2<f32>(1.0)));
}

// Returns the palette index of texel 0..3 of the cell. Their offsets (x, y) from the corner are (0, 0), (1, 0), (0, 1), (1, 1).
fn terrain_splat_id(cell: SplatCell, texel: u32) -> u32 {
    count_fetch();
    return textureLoad(splat_atlas, cell.corner + vec2<i32>(vec2<u32>(texel & 1u, texel >> 1u)), cell.slot, 0).r;
}

// The quantities that a blend sums. The gradient is the volume gradient of the bump height (Mikkelsen 2020), because gradients can be
// summed linearly and normals cannot.
struct Surface {
    albedo: vec3<f32>,
    height: f32,
    gradient: vec3<f32>,
    smoothness: f32,
    specular_occlusion: f32,
}

fn surface_zero() -> Surface {
    return Surface(vec3<f32>(0.0), 0.0, vec3<f32>(0.0), 0.0, 0.0);
}

fn surface_scale(factor: f32, s: Surface) -> Surface {
    return Surface(factor * s.albedo, factor * s.height, factor * s.gradient, factor * s.smoothness, factor * s.specular_occlusion);
}

fn surface_add(sum: Surface, weight: f32, s: Surface) -> Surface {
    return Surface(
        sum.albedo + weight * s.albedo,
        sum.height + weight * s.height,
        sum.gradient + weight * s.gradient,
        sum.smoothness + weight * s.smoothness,
        sum.specular_occlusion + weight * s.specular_occlusion,
    );
}

// A pixel's footprint on the terrain.
struct Footprint {
    place: Place,
    ddx: vec3<f32>,
    ddy: vec3<f32>,
}

// A footprint in the coordinates of one projection. All taps of the projection share it.
struct Projection {
    plane: u32,                 // 0..2 = projection along x, y, z; 3, 4 = along a diagonal, see snapped_projection.wgsl
    sectors: vec2<i32>,         // whole sectors along both coordinates
    position: vec2<f32>,        // metres inside the sector
    ddx: vec2<f32>,             // derivatives of the coordinates, mip bias included
    ddy: vec2<f32>,
    longest_2: f32,             // squared length of the longer derivative
}

fn terrain_projection(plane: u32, footprint: Footprint) -> Projection {
    let place = footprint.place;
    // Like the horizontal coordinates, elevation is split into a whole number of sector widths and a remainder. So texture coordinates on walls are
    // as accurate on a high mountain as at sea level.
    let storey = floor(place.position.z / frame.sector_m);
    let folded = vec3<f32>(place.position.xy, place.position.z - storey * frame.sector_m);
    let ddx = snapped_coordinates(footprint.ddx, plane) * frame.gradient_scale;
    let ddy = snapped_coordinates(footprint.ddy, plane) * frame.gradient_scale;
    return Projection(
        plane,
        snapped_sectors(vec3<i32>(place.sector, i32(storey)), plane),
        snapped_coordinates(folded, plane),
        ddx,
        ddy,
        max(dot(ddx, ddx), dot(ddy, ddy)),
    );
}

// Converts a vector in the plane of the projection to texture coordinates: rotates it by the orientation of the material and scales it.
// `rate`: cos and sin of the orientation, divided by the width of one repeat in metres.
fn terrain_turn(v: vec2<f32>, rate: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(v.x * rate.x + v.y * rate.y, v.y * rate.x - v.x * rate.y);
}

fn terrain_rate(entry: PaletteEntry, scale: u32) -> vec2<f32> {
    return entry.per_metre * exp2(-f32(scale));
}

// Returns the texture coordinate of a position. The part for whole sectors is computed exactly in fixed point.
fn terrain_texture_coordinate(entry: PaletteEntry, projection: Projection, scale: u32) -> vec2<f32> {
    let fixed = entry.per_sector_fixed;
    let sectors = projection.sectors;
    let base = vec2<f32>(
        tiling_fixed(sectors.x, snapped_fixed(fixed.x, projection.plane), scale) + tiling_fixed(sectors.y, fixed.y, scale),
        tiling_fixed(sectors.y, fixed.x, scale) - tiling_fixed(sectors.x, snapped_fixed(fixed.y, projection.plane), scale),
    );
    return base + terrain_turn(projection.position, terrain_rate(entry, scale));
}

// LOD (level of detail, a mip level with a fraction) of the albedo and normal textures. As WebGPU specifies, it is the log2 of the longer
// of the two gradients, in texels.
fn terrain_lod(projection: Projection, rate: vec2<f32>) -> f32 {
    return 0.5 * log2(max(projection.longest_2 * dot(rate, rate), 1e-30)) + terrain_texels_log2(textureDimensions(detail_albedo).x);
}

// Difference between the LOD of the height texture and the LOD of the albedo texture.
fn terrain_height_lod() -> f32 {
    return terrain_texels_log2(textureDimensions(detail_height).x) - terrain_texels_log2(textureDimensions(detail_albedo).x);
}

fn terrain_texels_log2(texels: u32) -> f32 {
    return f32(firstLeadingBit(texels));
}

// Values of a material's three detail textures at a point.
struct Texels {
    albedo: vec3<f32>,
    normal: vec4<f32>,          // smoothness, y of the normal, specular occlusion, x of the normal
    height: vec2<f32>,          // height, colour mask
}

// Samples the three detail textures of a material with filtering: three fetches.
fn terrain_texels(entry: PaletteEntry, projection: Projection, rate: vec2<f32>, uv: vec2<f32>) -> Texels {
    count_fetch();
    count_fetch();
    count_fetch();
    if ANISOTROPIC {
        let uv_dx = terrain_turn(projection.ddx, rate);
        let uv_dy = terrain_turn(projection.ddy, rate);
        return Texels(
            textureSampleGrad(detail_albedo, detail_sampler, uv, entry.albedo_layer, uv_dx, uv_dy).rgb,
            textureSampleGrad(detail_normal, detail_sampler, uv, entry.normal_layer, uv_dx, uv_dy),
            textureSampleGrad(detail_height, detail_sampler, uv, entry.height_layer, uv_dx, uv_dy).rg,
        );
    }
    let lod = terrain_lod(projection, rate);
    return Texels(
        textureSampleLevel(detail_albedo, detail_sampler, uv, entry.albedo_layer, lod).rgb,
        textureSampleLevel(detail_normal, detail_sampler, uv, entry.normal_layer, lod),
        textureSampleLevel(detail_height, detail_sampler, uv, entry.height_layer, lod + terrain_height_lod()).rg,
    );
}

// Reads one texel of each of a material's three detail textures: three fetches. Mip level and texel are chosen at random, so that the expected value
// equals the result of trilinear filtering. The albedo is later multiplied by a tint that depends on the colour mask in the height texture. The
// expected value of this product is right only if the texel of the albedo and the texel of the colour mask are chosen independently. So
// there are two sets of thresholds: `u` chooses level, column and row for the albedo and normal textures, `v` for the height texture.
fn terrain_texels_chosen(entry: PaletteEntry, projection: Projection, rate: vec2<f32>, uv: vec2<f32>, u: vec4<f32>, v: vec4<f32>) -> Texels {
    let lod = terrain_lod(projection, rate);
    let level = texel_choice_level(lod, textureNumLevels(detail_albedo), u.x);
    let size = max(textureDimensions(detail_albedo).x >> level, 1u);
    let at = vec2<u32>(texel_choice_texel(uv.x, size, u.y), texel_choice_texel(uv.y, size, u.z));
    let height_level = texel_choice_level(lod + terrain_height_lod(), textureNumLevels(detail_height), v.x);
    let height_size = max(textureDimensions(detail_height).x >> height_level, 1u);
    let height_at = vec2<u32>(texel_choice_texel(uv.x, height_size, v.y), texel_choice_texel(uv.y, height_size, v.z));
    count_fetch();
    count_fetch();
    count_fetch();
    return Texels(
        textureLoad(detail_albedo, at, entry.albedo_layer, level).rgb,
        textureLoad(detail_normal, at, entry.normal_layer, level),
        textureLoad(detail_height, height_at, entry.height_layer, height_level).rg,
    );
}

fn terrain_tint(entry: PaletteEntry, texels: Texels) -> vec3<f32> {
    return mix(vec3<f32>(1.0), entry.tint, texels.height.g);
}

fn terrain_surface(entry: PaletteEntry, projection: Projection, rate: vec2<f32>, texels: Texels) -> Surface {
    // The slope of the height is -xy / z of the unit normal, times the strength of the normal map. The z is limited to at least 0.05.
    let xy = texels.normal.ag * 2.0 - 1.0;
    let slope = xy * (-entry.normal_strength * inverseSqrt(max(1.0 - dot(xy, xy), 0.0025)));
    let turned = vec2<f32>(slope.x * rate.x - slope.y * rate.y, slope.x * rate.y + slope.y * rate.x) * inverseSqrt(max(dot(rate, rate), 1e-30));
    let gradient = snapped_from_gradient(turned, projection.plane);
    return Surface(texels.albedo * terrain_tint(entry, texels), texels.height.r, gradient, texels.normal.r, texels.normal.b);
}

// Returns the surface of one material in one projection: three fetches from detail textures, or nine with hex tiling. A repeat of the textures is
// 2^scale times as wide as at scale 0.
// Texture coordinates are a linear function of the position, so their derivatives are computed from the derivatives of the position (ruling 7 in
// ARCHITECTURE.md).
fn terrain_material(id: u32, projection: Projection, scale: u32) -> Surface {
    let entry = palette[id];
    let rate = terrain_rate(entry, scale);
    let uv = terrain_texture_coordinate(entry, projection, scale);
    if !HEX_TILING {
        return terrain_surface(entry, projection, rate, terrain_texels(entry, projection, rate, uv));
    }
    let level = hex_tiling_level(length(rate) * frame.sector_m);
    let tiling = hex_tiling_at(projection.sectors, projection.position, frame.sector_m, level);
    var sum = surface_zero();
    for (var i = 0u; i < frame.taps - 1u; i++) {
        let offset = hex_tiling_offset(hex_tiling_id(tiling, i), projection.plane + 8u * scale);
        let texels = terrain_texels(entry, projection, rate, uv + offset);
        sum = surface_add(sum, tiling.weights[i], terrain_surface(entry, projection, rate, texels));
    }
    return sum;
}

// Returns the surface of one tap: four fetches (ten with hex tiling), for the splat id and for the three textures of its material.
fn terrain_tap(cell: SplatCell, texel: u32, projection: Projection, scale: u32) -> Surface {
    return terrain_material(terrain_splat_id(cell, texel), projection, scale);
}

// Returns the surface of one tap with texels chosen at random: four fetches, for the splat id and for one texel of each texture.
fn terrain_tap_chosen(cell: SplatCell, texel: u32, projection: Projection, scale: u32, u: vec4<f32>, v: vec4<f32>) -> Surface {
    let entry = palette[terrain_splat_id(cell, texel)];
    let rate = terrain_rate(entry, scale);
    let uv = terrain_texture_coordinate(entry, projection, scale);
    return terrain_surface(entry, projection, rate, terrain_texels_chosen(entry, projection, rate, uv, u, v));
}

// Loops that sample detail textures run to an expression of `frame.taps` (always 4) instead of a constant, so that they are not unrolled:
// `frame.taps` for 4 taps, `frame.taps - 1u` for 3 projections or hexagons, `frame.taps - 2u` for 2 tilings, `2u * frame.taps` for 8 layers. An
// unrolled splat flavour has 36 texture samples, and a software Vulkan driver takes seconds to compile it, although it runs in milliseconds.

// Blends four taps with bilinear weights modified by height: sixteen fetches (forty with hex tiling). Each tap is added to the sum as soon as it is
// fetched. An array of taps would be stored in memory and not in registers, because a loop that is not unrolled would index it.
fn terrain_splat_blend(cell: SplatCell, projection: Projection, scale: u32) -> Surface {
    let weights = splat_blend_bilinear(cell.fraction);
    var run = splat_blend_start();
    var sum = surface_zero();
    var total = 0.0;
    for (var i = 0u; i < frame.taps; i++) {
        let tap = terrain_tap(cell, i, projection, scale);
        run = splat_blend_add(run, weights[i], tap.height, frame.height_sharpness);
        sum = surface_add(surface_scale(run.keep, sum), run.share, tap);
        total = total * run.keep + run.share;
    }
    return surface_scale(1.0 / total, sum);
}

// Number of mip levels between the two bands of a texture: the fine band contains detail finer than 2^3 pixels.
const TERRAIN_BAND_MIPS: f32 = 3.0;

// Blends four taps with the albedo split into two bands of frequencies: twenty fetches, five per tap. The transition between materials should be
// about as wide as the wavelength of the band. So the coarse band is blended with bilinear weights, whose transition is as wide as the splat cell.
// The fine band is blended with the weights of the height blend, whose transition follows the relief. Gradient, smoothness and specular occlusion are
// blended like the fine band.
// Source: Burt & Adelson, "A Multiresolution Spline With Application to Image Mosaics", ACM ToG 2(4), 1983.
fn terrain_splat_bands(cell: SplatCell, projection: Projection, scale: u32) -> Surface {
    let weights = splat_blend_bilinear(cell.fraction);
    var run = splat_blend_start();
    var coarse = vec3<f32>(0.0);
    var fine = surface_zero();
    var total = 0.0;
    for (var i = 0u; i < frame.taps; i++) {
        let entry = palette[terrain_splat_id(cell, i)];
        let rate = terrain_rate(entry, scale);
        let uv = terrain_texture_coordinate(entry, projection, scale);
        let texels = terrain_texels(entry, projection, rate, uv);
        let lod = max(terrain_lod(projection, rate), 0.0) + TERRAIN_BAND_MIPS;
        count_fetch();
        let low = textureSampleLevel(detail_albedo, detail_sampler, uv, entry.albedo_layer, lod).rgb * terrain_tint(entry, texels);
        var tap = terrain_surface(entry, projection, rate, texels);
        tap.albedo -= low;
        coarse += weights[i] * low;
        run = splat_blend_add(run, weights[i], tap.height, frame.height_sharpness);
        fine = surface_add(surface_scale(run.keep, fine), run.share, tap);
        total = total * run.keep + run.share;
    }
    var sum = surface_scale(1.0 / total, fine);
    // The sum may be negative where the fine band of one material is added to the coarse band of another.
    sum.albedo = max(coarse + sum.albedo, vec3<f32>(0.0));
    return sum;
}

// Position of the lowest bit of the layer number in `PaletteEntry.flags`, for the estimator `luna8`, which has eight layers. The first eight
// materials of the palette have layers of their own. Any other material is drawn as the layer whose number is in its flags.
const TERRAIN_LAYER_BITS: u32 = 8u;

// Blends eight layers with twenty-eight fetches: four for the splat ids, which form the blend map, and three for the textures of each layer. All
// layers are always sampled, as in Luna's shader (see layers.wgsl).
fn terrain_layers(cell: SplatCell, projection: Projection, scale: u32) -> Surface {
    let weights = splat_blend_bilinear(cell.fraction);
    var layers: vec4<u32>;
    for (var i = 0u; i < 4u; i++) {
        layers[i] = (palette[terrain_splat_id(cell, i)].flags >> TERRAIN_LAYER_BITS) & (LAYERS - 1u);
    }
    var sum = surface_zero();
    var below = 0.0;
    for (var layer = 0u; layer < 2u * frame.taps; layer++) {
        let share = layers_share(weights, layers, layer);
        let opacity = layers_opacity(layer, share, below);
        below += share;
        sum = surface_add(surface_scale(1.0 - opacity, sum), opacity, terrain_material(layer, projection, scale));
    }
    return sum;
}

// Blends four taps with plain bilinear weights: sixteen fetches (forty with hex tiling). This blend is the mean of an estimator that chooses one tap
// at random with these weights as probabilities.
fn terrain_splat_mean(cell: SplatCell, projection: Projection, scale: u32) -> Surface {
    let weights = splat_blend_bilinear(cell.fraction);
    var sum = surface_zero();
    for (var i = 0u; i < frame.taps; i++) {
        sum = surface_add(sum, weights[i], terrain_tap(cell, i, projection, scale));
    }
    return sum;
}

// First and second moment of the albedo if one tap is chosen at random with bilinear weights as probabilities.
struct Moments {
    mean: vec3<f32>,
    square: vec3<f32>,
}

fn terrain_splat_moments(cell: SplatCell, projection: Projection, scale: u32) -> Moments {
    let weights = splat_blend_bilinear(cell.fraction);
    var moments = Moments(vec3<f32>(0.0), vec3<f32>(0.0));
    for (var i = 0u; i < frame.taps; i++) {
        let albedo = terrain_tap(cell, i, projection, scale).albedo;
        moments.mean += weights[i] * albedo;
        moments.square += weights[i] * albedo * albedo;
    }
    return moments;
}

// Whether the scene has a colour modulation map. If not, the map is not sampled, and its factor is 1.
override COLOUR_MODULATION: bool = false;

fn terrain_colour_modulation(node: NodePlace) -> vec3<f32> {
    if !COLOUR_MODULATION {
        return vec3<f32>(1.0);
    }
    count_fetch();
    let texel = textureSampleLevel(colour_modulation_atlas, atlas_sampler, terrain_atlas_uv(node.uv), node.slot, 0.0).rgb;
    return texel * 2.0;
}

// Terrain data for any world position: sector data -> node -> atlases; splat texels -> materials -> detail textures.
// Every texture sample that shading takes is counted here, where it happens.

override COUNT_FETCHES: bool = false;
// Detail textures are filtered anisotropically, by gradients. Where they are not, one LOD serves a tap's three textures.
override ANISOTROPIC: bool = false;

struct PaletteEntry {
    albedo_layer: u32,
    normal_layer: u32,
    height_layer: u32,
    flags: u32,
    per_sector_fixed: vec2<i32>,    // repeats per sector times cos, sin of the orientation, 24 fractional bits
    per_metre: vec2<f32>,           // cos, sin over the edge of one repeat
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
// Uniform, not storage: software Vulkan gathers from uniforms, and loops over lanes for storage.
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

const TERRAIN_SECTORS: i32 = 160;
const TERRAIN_LODS: u32 = 6u;

// A place on the terrain: exact sector, and metres inside it.
struct Place {
    sector: vec2<i32>,
    position: vec3<f32>,        // x, y in the sector, z = elevation
}

fn terrain_place(sector: vec2<i32>, local: vec3<f32>) -> Place {
    let steps = floor(local.xy / frame.sector_m);
    return Place(sector + vec2<i32>(steps), vec3<f32>(local.xy - steps * frame.sector_m, local.z));
}

// The finest loaded node of a place: its atlas slot (0 = none) and the place in it, 0..1.
struct NodePlace {
    slot: u32,
    uv: vec2<f32>,
}

fn terrain_node(place: Place) -> NodePlace {
    let sector = clamp(place.sector, vec2<i32>(0), vec2<i32>(TERRAIN_SECTORS - 1));
    let packed = sector_data[sector.y * TERRAIN_SECTORS + sector.x];
    for (var lod = 0u; lod < TERRAIN_LODS; lod++) {
        let bit = lod * 10u;
        var slot = 0u;
        if bit < 30u {
            slot = (packed.x >> bit) & 1023u;
        } else if bit == 30u {
            slot = (packed.x >> 30u) | ((packed.y & 255u) << 2u);
        } else {
            slot = (packed.y >> (bit - 32u)) & 1023u;
        }
        if slot != 0u {
            let edge = 1 << lod;
            let in_node = vec2<f32>(sector & vec2<i32>(edge - 1)) + clamp(place.position.xy / frame.sector_m + vec2<f32>(place.sector - sector), vec2<f32>(0.0), vec2<f32>(1.0));
            return NodePlace(slot, in_node / f32(edge));
        }
    }
    return NodePlace(0u, vec2<f32>(0.0));
}

// Texture coordinate of a node payload with 128 texels and 2 texels of border.
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

// The four splat texels around a place and the place between them.
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

// Palette index of texel 0..3 in the order 00, 10, 01, 11.
fn terrain_splat_id(cell: SplatCell, texel: u32) -> u32 {
    count_fetch();
    return textureLoad(splat_atlas, cell.corner + vec2<i32>(vec2<u32>(texel & 1u, texel >> 1u)), cell.slot, 0).r;
}

// What a blend sums up. The gradient is the volume gradient of bump height (Mikkelsen 2020), linear where normals are not.
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

// A footprint as one projection sees it: what its taps share.
struct Projection {
    axis: u32,
    sectors: vec2<i32>,         // whole sectors along both coordinates
    position: vec2<f32>,        // metres beyond them
    ddx: vec2<f32>,             // derivatives of the coordinates, mip bias included
    ddy: vec2<f32>,
    longest_2: f32,             // square of the longer derivative
}

fn terrain_projection(axis: u32, footprint: Footprint) -> Projection {
    let place = footprint.place;
    // Elevation is folded by sectors like the horizontal axes, so that a wall on a high mountain is as exact as one at sea level.
    let storey = floor(place.position.z / frame.sector_m);
    let folded = vec3<f32>(place.position.xy, place.position.z - storey * frame.sector_m);
    let first = select(place.sector.x, place.sector.y, axis == 0u);
    let second = select(i32(storey), place.sector.y, axis == 2u);
    let ddx = triplanar_coordinates(footprint.ddx, axis) * frame.gradient_scale;
    let ddy = triplanar_coordinates(footprint.ddy, axis) * frame.gradient_scale;
    return Projection(axis, vec2<i32>(first, second), triplanar_coordinates(folded, axis), ddx, ddy, max(dot(ddx, ddx), dot(ddy, ddy)));
}

// A vector of the projection's plane in texture coordinates: turned by the material's orientation, `rate` = cos, sin over the tile's edge.
fn terrain_turn(v: vec2<f32>, rate: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(v.x * rate.x + v.y * rate.y, v.y * rate.x - v.x * rate.y);
}

// Texture coordinate of a place. Whole sectors contribute in exact fixed point.
fn terrain_texture_coordinate(entry: PaletteEntry, projection: Projection, scale: u32, rate: vec2<f32>) -> vec2<f32> {
    let fixed = entry.per_sector_fixed;
    let sectors = projection.sectors;
    let base = vec2<f32>(
        tiling_fixed(sectors.x, fixed.x, scale) + tiling_fixed(sectors.y, fixed.y, scale),
        tiling_fixed(sectors.y, fixed.x, scale) - tiling_fixed(sectors.x, fixed.y, scale),
    );
    return base + terrain_turn(projection.position, rate);
}

// LOD of a texture of 1 x 1 texels, by WebGPU's rule: the longer of the two gradients. A texture of 2^k has k more.
fn terrain_lod(projection: Projection, rate: vec2<f32>) -> f32 {
    return 0.5 * log2(max(projection.longest_2 * dot(rate, rate), 1e-30));
}

fn terrain_texels_log2(texels: u32) -> f32 {
    return f32(firstLeadingBit(texels));
}

// What three detail texels of a material make.
fn terrain_surface(entry: PaletteEntry, projection: Projection, rate: vec2<f32>, albedo: vec3<f32>, normal: vec4<f32>, height: vec2<f32>) -> Surface {
    // Slope = xy / z of the unit normal; z is held above 0.05.
    let xy = normal.ag * 2.0 - 1.0;
    let slope = xy * (-entry.normal_strength * inverseSqrt(max(1.0 - dot(xy, xy), 0.0025)));
    let turned = vec2<f32>(slope.x * rate.x - slope.y * rate.y, slope.x * rate.y + slope.y * rate.x) * inverseSqrt(dot(rate, rate));
    let tinted = albedo * mix(vec3<f32>(1.0), entry.tint, height.g);
    return Surface(tinted, height.r, triplanar_from_gradient(turned, projection.axis), normal.r, normal.b);
}

// One material seen in one projection at one tiling scale 2^scale: three detail textures.
// Texture coordinates are a linear map of the position, and so are their gradients (ruling 7).
fn terrain_material(id: u32, projection: Projection, scale: u32) -> Surface {
    let entry = palette[id];
    let rate = entry.per_metre * exp2(-f32(scale));
    let uv = terrain_texture_coordinate(entry, projection, scale, rate);
    // Three, by either path.
    count_fetch();
    count_fetch();
    count_fetch();
    if ANISOTROPIC {
        let uv_dx = terrain_turn(projection.ddx, rate);
        let uv_dy = terrain_turn(projection.ddy, rate);
        let albedo = textureSampleGrad(detail_albedo, detail_sampler, uv, entry.albedo_layer, uv_dx, uv_dy).rgb;
        let normal = textureSampleGrad(detail_normal, detail_sampler, uv, entry.normal_layer, uv_dx, uv_dy);
        let height = textureSampleGrad(detail_height, detail_sampler, uv, entry.height_layer, uv_dx, uv_dy).rg;
        return terrain_surface(entry, projection, rate, albedo, normal, height);
    }
    let lod = terrain_lod(projection, rate);
    let texels = terrain_texels_log2(textureDimensions(detail_albedo).x);
    let height_texels = terrain_texels_log2(textureDimensions(detail_height).x);
    let albedo = textureSampleLevel(detail_albedo, detail_sampler, uv, entry.albedo_layer, lod + texels).rgb;
    let normal = textureSampleLevel(detail_normal, detail_sampler, uv, entry.normal_layer, lod + texels);
    let height = textureSampleLevel(detail_height, detail_sampler, uv, entry.height_layer, lod + height_texels).rg;
    return terrain_surface(entry, projection, rate, albedo, normal, height);
}

// Four fetches: the splat id and its three textures.
fn terrain_tap(cell: SplatCell, texel: u32, projection: Projection, scale: u32) -> Surface {
    return terrain_material(terrain_splat_id(cell, texel), projection, scale);
}

// Loops over taps run to `frame.taps` (always 4) and `frame.taps - 1u` (3 projections), `frame.taps - 2u` (2 tilings) rather than to a constant: an unrolled splat flavour
// is 36 texture samples long, and software Vulkan then compiles for seconds what it runs in milliseconds.

// Sixteen fetches: four taps, bilinear weights modified by height. Summed as they come: an array of taps, indexed by a loop that is not
// unrolled, would live in memory.
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

// Sixteen fetches: four taps, plain bilinear weights: the mean of choosing one of them by those weights.
fn terrain_splat_mean(cell: SplatCell, projection: Projection, scale: u32) -> Surface {
    let weights = splat_blend_bilinear(cell.fraction);
    var sum = surface_zero();
    for (var i = 0u; i < frame.taps; i++) {
        sum = surface_add(sum, weights[i], terrain_tap(cell, i, projection, scale));
    }
    return sum;
}

// First and second moment of the albedo of a random choice by bilinear weights.
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

// Factor of the colour modulation map, 1 = neutral. Sampled only in scenes that have one.
override COLOUR_MODULATION: bool = false;

fn terrain_colour_modulation(node: NodePlace) -> vec3<f32> {
    if !COLOUR_MODULATION {
        return vec3<f32>(1.0);
    }
    count_fetch();
    let texel = textureSampleLevel(colour_modulation_atlas, atlas_sampler, terrain_atlas_uv(node.uv), node.slot, 0.0).rgb;
    return texel * 2.0;
}

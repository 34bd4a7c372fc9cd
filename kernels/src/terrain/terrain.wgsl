// Terrain data for any world position: sector data -> node -> atlases; splat texels -> materials -> detail textures.
// Every texture sample that shading takes is counted here, where it happens.

override COUNT_FETCHES: bool = false;

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
@group(1) @binding(6) var<storage, read> palette: array<PaletteEntry>;
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

// One material seen along one axis at one tiling scale 2^scale: three detail textures.
// Texture coordinates are a linear map of the position, and so are their gradients (ruling 7).
fn terrain_material(id: u32, axis: u32, scale: u32, footprint: Footprint) -> Surface {
    let entry = palette[id];
    let shrink = exp2(-f32(scale));
    let c = entry.per_metre.x * shrink;
    let s = entry.per_metre.y * shrink;
    // Elevation is folded by sectors like the horizontal axes, so that a wall on a high mountain is as exact as one at sea level.
    let storey = floor(footprint.place.position.z / frame.sector_m);
    let folded = vec3<f32>(footprint.place.position.xy, footprint.place.position.z - storey * frame.sector_m);
    let q = triplanar_coordinates(folded, axis);
    let qx = triplanar_coordinates(footprint.ddx, axis) * frame.gradient_scale;
    let qy = triplanar_coordinates(footprint.ddy, axis) * frame.gradient_scale;
    // Whole sectors contribute in exact fixed point.
    let first = select(footprint.place.sector.x, footprint.place.sector.y, axis == 0u);
    let second = select(i32(storey), footprint.place.sector.y, axis == 2u);
    let base = vec2<f32>(
        tiling_fixed(first, entry.per_sector_fixed.x, scale) + tiling_fixed(second, entry.per_sector_fixed.y, scale),
        tiling_fixed(second, entry.per_sector_fixed.x, scale) - tiling_fixed(first, entry.per_sector_fixed.y, scale),
    );
    let uv = base + vec2<f32>(q.x * c + q.y * s, q.y * c - q.x * s);
    let uv_dx = vec2<f32>(qx.x * c + qx.y * s, qx.y * c - qx.x * s);
    let uv_dy = vec2<f32>(qy.x * c + qy.y * s, qy.y * c - qy.x * s);
    count_fetch();
    let albedo = textureSampleGrad(detail_albedo, detail_sampler, uv, entry.albedo_layer, uv_dx, uv_dy).rgb;
    count_fetch();
    let normal = textureSampleGrad(detail_normal, detail_sampler, uv, entry.normal_layer, uv_dx, uv_dy);
    count_fetch();
    let height = textureSampleGrad(detail_height, detail_sampler, uv, entry.height_layer, uv_dx, uv_dy);
    let n = terrain_unpack_normal(normal);
    let slope = -n.xy / max(n.z, 0.05) * entry.normal_strength;
    let cosine = c * inverseSqrt(c * c + s * s);
    let sine = s * inverseSqrt(c * c + s * s);
    let turned = vec2<f32>(slope.x * cosine - slope.y * sine, slope.x * sine + slope.y * cosine);
    return Surface(albedo * mix(vec3<f32>(1.0), entry.tint, height.g), height.r, triplanar_from_gradient(turned, axis), normal.r, normal.b);
}

// Four fetches: the splat id and its three textures.
fn terrain_tap(cell: SplatCell, texel: u32, axis: u32, scale: u32, footprint: Footprint) -> Surface {
    return terrain_material(terrain_splat_id(cell, texel), axis, scale, footprint);
}

// Loops over taps run to `frame.taps` (always 4) and `frame.taps - 1u` (3 projections), `frame.taps - 2u` (2 tilings) rather than to a constant: an unrolled splat flavour
// is 36 texture samples long, and software Vulkan then compiles for seconds what it runs in milliseconds.

// Sixteen fetches: four taps, bilinear weights modified by height.
fn terrain_splat_blend(cell: SplatCell, axis: u32, scale: u32, footprint: Footprint) -> Surface {
    var taps: array<Surface, 4>;
    for (var i = 0u; i < frame.taps; i++) {
        taps[i] = terrain_tap(cell, i, axis, scale, footprint);
    }
    let heights = vec4<f32>(taps[0].height, taps[1].height, taps[2].height, taps[3].height);
    let weights = splat_blend_weights(cell.fraction, heights, frame.height_sharpness);
    var sum = surface_zero();
    for (var i = 0u; i < 4u; i++) {
        sum = surface_add(sum, weights[i], taps[i]);
    }
    return sum;
}

// Sixteen fetches: four taps, plain bilinear weights: the mean of choosing one of them by those weights.
fn terrain_splat_mean(cell: SplatCell, axis: u32, scale: u32, footprint: Footprint) -> Surface {
    let weights = splat_blend_bilinear(cell.fraction);
    var sum = surface_zero();
    for (var i = 0u; i < frame.taps; i++) {
        sum = surface_add(sum, weights[i], terrain_tap(cell, i, axis, scale, footprint));
    }
    return sum;
}

// First and second moment of the albedo of a random choice by bilinear weights.
struct Moments {
    mean: vec3<f32>,
    square: vec3<f32>,
}

fn terrain_splat_moments(cell: SplatCell, axis: u32, scale: u32, footprint: Footprint) -> Moments {
    let weights = splat_blend_bilinear(cell.fraction);
    var moments = Moments(vec3<f32>(0.0), vec3<f32>(0.0));
    for (var i = 0u; i < frame.taps; i++) {
        let albedo = terrain_tap(cell, i, axis, scale, footprint).albedo;
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

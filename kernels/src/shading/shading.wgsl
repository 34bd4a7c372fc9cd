// Shading: the tiles of one variant in, G-buffer out. One module, specialised by overrides into 31 variants and the generic kernel.

// Mask of the flavours compiled in, 1..31; 0 = the generic kernel, which takes each tile's mask at run time.
override VARIANT: u32 = 0u;
// How near cliff, far cliff and splat arrive at their value; `Estimator` in estimator.rs explains each.
override ESTIMATOR: u32 = 0u;
// Noise kind of the stochastic choices, see noise.wgsl.
override NOISE: u32 = 0u;
// Whether a tile is one triangle, cut off below the tile by the depth test: then two must not share the diagonal, where 2 x 2 pixels
// (and whatever else a device shades together) would be shaded for either.
override ONE_TRIANGLE: bool = false;
// Edge of a tile, pixels.
override TILE: u32 = 8u;
// Splat with two tiling scales: 96 fetches, the reference look.
override TWO_TILINGS: bool = false;

@group(2) @binding(0) var depth_target: texture_depth_2d;
@group(2) @binding(1) var normal_target: texture_2d<f32>;
@group(2) @binding(2) var<storage, read> tile_lists: array<u32>;
@group(2) @binding(3) var page_table: texture_2d_array<u32>;
@group(2) @binding(4) var page_albedo: texture_2d_array<f32>;
@group(2) @binding(5) var page_properties: texture_2d_array<f32>;
@group(2) @binding(6) var page_normal: texture_2d_array<f32>;
@group(2) @binding(7) var page_sampler: sampler;
@group(2) @binding(8) var<storage, read> noise_ranks: array<u32>;

// Cosine of the slope from which on the snapped projection is a vertical one: Terrain3D's default.
const SHADING_SNAPPED_COSINE: f32 = 0.8;

// What the constants above decide, as conditions that are theirs alone: code behind a false one is cut out before a driver sees it.
override RUNS_VT: bool = (VARIANT == 0u) | ((VARIANT & 1u) != 0u);
override RUNS_FAR_ATLAS: bool = (VARIANT == 0u) | ((VARIANT & 2u) != 0u);
override RUNS_NEAR_CLIFF: bool = (VARIANT == 0u) | ((VARIANT & 4u) != 0u);
override RUNS_FAR_CLIFF: bool = (VARIANT == 0u) | ((VARIANT & 8u) != 0u);
override RUNS_SPLAT: bool = (VARIANT == 0u) | ((VARIANT & 16u) != 0u);
override PROJECTS: bool = (VARIANT == 0u) | ((VARIANT & 28u) != 0u);
override IS_BIPLANAR: bool = (ESTIMATOR == ESTIMATOR_BIPLANAR) | (ESTIMATOR == ESTIMATOR_BIPLANAR_MEAN);
override HAS_ONE_PROJECTION: bool = (ESTIMATOR == ESTIMATOR_SNAPPED) | (ESTIMATOR == ESTIMATOR_LUNA8);
// Whether random choices are replaced by their mean.
override TAKES_MEANS: bool = (ESTIMATOR == ESTIMATOR_EXACT) | (ESTIMATOR == ESTIMATOR_BIPLANAR_MEAN) | (ESTIMATOR == ESTIMATOR_HEX_MEAN);
// Whether all of an estimator's flavours are one blend of four (or eight) materials in each of its projections.
override IS_ONE_BLEND: bool = (ESTIMATOR == ESTIMATOR_LAPLACIAN) | (ESTIMATOR == ESTIMATOR_LUNA8) | (ESTIMATOR == ESTIMATOR_SNAPPED);

// Independent random numbers for each stochastic flavour (ruling 15).
const SALT_NEAR_CLIFF: u32 = 1u;
const SALT_FAR_CLIFF: u32 = 2u;
const SALT_SPLAT: u32 = 3u;
// Added to a flavour's, for the two choices of texels.
const SALT_TEXEL: u32 = 4u;
const SALT_HEIGHT_TEXEL: u32 = 8u;

struct Pixel {
    index: vec2<u32>,
    footprint: Footprint,
    node: NodePlace,
    cell: SplatCell,
    normal: vec3<f32>,          // shading normal
    planes: vec3<u32>,          // of the projections
    projections: vec3<f32>,     // their weights
    tiling: vec2<f32>,          // lower scale exponent, blend towards the next
}

// First stochastic choice of the pixel + 1, for inspection: splat texel, and 4 times the projection.
var<private> choice: u32;

fn shade_virtual_texture(pixel: Pixel) -> Surface {
    let place = pixel.footprint.place;
    for (var level = virtual_texture_level(pixel.footprint.ddx, pixel.footprint.ddy, 0.0); level < frame.page_levels; level++) {
        let address = virtual_texture_address(place, level);
        count_fetch();
        let entry = textureLoad(page_table, address.page & vec2<i32>(VIRTUAL_WINDOW - 1), level, 0).r;
        if (entry & VIRTUAL_LAYER_MASK) == 0u || (entry & ~VIRTUAL_LAYER_MASK) != virtual_texture_tag(address.page) {
            continue;
        }
        let layer = (entry & VIRTUAL_LAYER_MASK) - 1u;
        let uv = (address.uv * VIRTUAL_PAGE_TEXELS + VIRTUAL_BORDER_TEXELS) / VIRTUAL_STORED_TEXELS;
        let per_m = frame.page_texels_per_m * frame.gradient_scale * exp2(-f32(level)) / VIRTUAL_STORED_TEXELS;
        let uv_dx = pixel.footprint.ddx.xy * per_m;
        let uv_dy = pixel.footprint.ddy.xy * per_m;
        count_fetch();
        let albedo = textureSampleGrad(page_albedo, page_sampler, uv, layer, uv_dx, uv_dy).rgb;
        count_fetch();
        let properties = textureSampleGrad(page_properties, page_sampler, uv, layer, uv_dx, uv_dy).rg;
        count_fetch();
        let normal_xy = textureSampleGrad(page_normal, page_sampler, uv, layer, uv_dx, uv_dy).rg * 2.0 - 1.0;
        let normal_z = sqrt(max(1.0 - dot(normal_xy, normal_xy), 0.01));
        return Surface(albedo, 0.0, vec3<f32>(-normal_xy / normal_z, 0.0), properties.x, properties.y);
    }
    // No page of any level is there: the baked terrain always is.
    var baked = shade_far_atlas(pixel).surface;
    baked.albedo *= terrain_colour_modulation(pixel.node);
    return baked;
}

struct FarAtlas {
    surface: Surface,
    normal: vec3<f32>,
}

fn shade_far_atlas(pixel: Pixel) -> FarAtlas {
    count_fetch();
    // Texels of holes are black and transparent: dividing by the filtered alpha keeps them out of the colour around a hole.
    let texel = textureSampleLevel(albedo_atlas, atlas_sampler, terrain_atlas_uv(pixel.node.uv), pixel.node.slot, 0.0);
    let albedo = texel.rgb / max(texel.a, 0.25);
    count_fetch();
    let baked = terrain_normal(pixel.node.slot, pixel.node.uv);
    return FarAtlas(Surface(albedo, 0.0, vec3<f32>(0.0), baked.smoothness, baked.specular_occlusion), baked.normal);
}

fn shade_noise(pixel: Pixel, salt: u32) -> vec4<f32> {
    let f = pixel.footprint;
    var ranks = vec4<u32>(0u);
    if noise_needs_mask(NOISE) {
        for (var i = 0u; i < 4u; i++) {
            ranks[i] = noise_ranks[noise_rank_index(NOISE, pixel.index, frame.frame, frame.seed, salt, i)];
        }
    }
    return noise_thresholds(
        NOISE, f.place.sector, f.place.position, frame.sector_m, f.ddx, f.ddy, frame.hash_scale, frame.noise_world_level,
        pixel.index, frame.frame, frame.seed, salt, ranks,
    );
}

// Projections that the estimator has.
fn shade_projections() -> u32 {
    if IS_BIPLANAR {
        return frame.taps - 2u;
    }
    if HAS_ONE_PROJECTION {
        return frame.taps - 3u;
    }
    return frame.taps - 1u;
}

// Which they are, and their weights.
fn shade_project(pixel: ptr<function, Pixel>) {
    (*pixel).planes = vec3<u32>(0u, 1u, 2u);
    if IS_BIPLANAR {
        let b = biplanar_projections((*pixel).normal, frame.triplanar_sharpness);
        (*pixel).planes = vec3<u32>(b.axes, 0u);
        (*pixel).projections = vec3<f32>(b.weights, 0.0);
    } else if ESTIMATOR == ESTIMATOR_SNAPPED {
        (*pixel).planes.x = snapped_plane((*pixel).normal, SHADING_SNAPPED_COSINE);
        (*pixel).projections = vec3<f32>(1.0, 0.0, 0.0);
    } else if ESTIMATOR == ESTIMATOR_LUNA8 {
        (*pixel).planes.x = 2u;
        (*pixel).projections = vec3<f32>(1.0, 0.0, 0.0);
    } else {
        (*pixel).projections = triplanar_weights((*pixel).normal, frame.triplanar_sharpness);
    }
}

// All materials of a splat cell, blended the estimator's way: 16 fetches, hex-tiled 40, in bands 20, in layers 28.
fn shade_blend(pixel: Pixel, projection: Projection, scale: u32) -> Surface {
    if ESTIMATOR == ESTIMATOR_LAPLACIAN {
        return terrain_splat_bands(pixel.cell, projection, scale);
    }
    if ESTIMATOR == ESTIMATOR_LUNA8 {
        return terrain_layers(pixel.cell, projection, scale);
    }
    return terrain_splat_blend(pixel.cell, projection, scale);
}

fn shade_choose(texel: u32, plane: u32) {
    if choice == 0u {
        choice = 1u + texel + 4u * plane;
    }
}

// One projection, one material, and at one of two scales if `share` of the upper one is above 0, all by chance; and one texel of each of its
// textures: 4 fetches.
fn shade_one_tap(pixel: Pixel, salt: u32, scale: u32, share: f32) -> Surface {
    let u = shade_noise(pixel, salt);
    let plane = pixel.planes[select_of_3(pixel.projections, u.x)];
    let texel = select_of_4(splat_blend_bilinear(pixel.cell.fraction), u.y);
    shade_choose(texel, plane);
    let chosen = scale + select(0u, 1u, u.z < share);
    return terrain_tap_chosen(
        pixel.cell,
        texel,
        terrain_projection(plane, pixel.footprint),
        chosen,
        shade_noise(pixel, salt + SALT_TEXEL),
        shade_noise(pixel, salt + SALT_HEIGHT_TEXEL),
    );
}

// Alpha-blended projections, one random splat material each: 12 fetches, with two projections 8, hex-tiled 30.
fn shade_near_cliff(pixel: Pixel) -> Surface {
    var sum = surface_zero();
    if ESTIMATOR == ESTIMATOR_STF {
        return shade_one_tap(pixel, SALT_NEAR_CLIFF, 0u, 0.0);
    }
    if IS_ONE_BLEND {
        return shade_splat(pixel);
    }
    if TAKES_MEANS {
        for (var i = 0u; i < shade_projections(); i++) {
            let mean = terrain_splat_mean(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), 0u);
            sum = surface_add(sum, pixel.projections[i], mean);
        }
        return sum;
    }
    if ESTIMATOR == ESTIMATOR_VARIANCE {
        // Independent choices per projection: variances add with squared weights.
        for (var i = 0u; i < shade_projections(); i++) {
            let moments = terrain_splat_moments(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), 0u);
            let w = pixel.projections[i];
            sum.albedo += w * w * max(moments.square - moments.mean * moments.mean, vec3<f32>(0.0));
        }
        return sum;
    }
    let thresholds = shade_noise(pixel, SALT_NEAR_CLIFF);
    let weights = splat_blend_bilinear(pixel.cell.fraction);
    for (var i = 0u; i < shade_projections(); i++) {
        let texel = select_of_4(weights, thresholds[i]);
        if i == 0u {
            // The material alone: all projections are seen.
            shade_choose(texel, 0u);
        }
        let tap = terrain_tap(pixel.cell, texel, terrain_projection(pixel.planes[i], pixel.footprint), 0u);
        sum = surface_add(sum, pixel.projections[i], tap);
    }
    return sum;
}

// Two alpha-blended tiling scales, each one random projection and material: 8 fetches; hex-tiled one scale, by chance: 10.
fn shade_far_cliff(pixel: Pixel) -> Surface {
    let lower = u32(pixel.tiling.x);
    let shares = vec2<f32>(1.0 - pixel.tiling.y, pixel.tiling.y);
    var sum = surface_zero();
    if ESTIMATOR == ESTIMATOR_STF {
        return shade_one_tap(pixel, SALT_FAR_CLIFF, lower, pixel.tiling.y);
    }
    if ESTIMATOR == ESTIMATOR_LAPLACIAN {
        // Blending both scales would double the price; the lower one alone jumps where the scale steps.
        for (var i = 0u; i < shade_projections(); i++) {
            let blend = shade_blend(pixel, terrain_projection(pixel.planes[i], pixel.footprint), lower);
            sum = surface_add(sum, pixel.projections[i], blend);
        }
        return sum;
    }
    if IS_ONE_BLEND {
        return shade_splat(pixel);
    }
    if TAKES_MEANS {
        for (var t = 0u; t < frame.taps - 2u; t++) {
            for (var i = 0u; i < shade_projections(); i++) {
                let mean = terrain_splat_mean(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), lower + t);
                sum = surface_add(sum, shares[t] * pixel.projections[i], mean);
            }
        }
        return sum;
    }
    if ESTIMATOR == ESTIMATOR_VARIANCE {
        // One choice among 3 x 4 per tiling, independent between tilings.
        for (var t = 0u; t < frame.taps - 2u; t++) {
            var mean = vec3<f32>(0.0);
            var square = vec3<f32>(0.0);
            for (var i = 0u; i < shade_projections(); i++) {
                let moments = terrain_splat_moments(pixel.cell, terrain_projection(pixel.planes[i], pixel.footprint), lower + t);
                mean += pixel.projections[i] * moments.mean;
                square += pixel.projections[i] * moments.square;
            }
            sum.albedo += shares[t] * shares[t] * max(square - mean * mean, vec3<f32>(0.0));
        }
        return sum;
    }
    let thresholds = shade_noise(pixel, SALT_FAR_CLIFF);
    let weights = splat_blend_bilinear(pixel.cell.fraction);
    if ESTIMATOR == ESTIMATOR_HEX {
        // Random offsets hide the repetition that the second scale is there to hide; chance keeps the scale from stepping.
        let plane = pixel.planes[select_of_3(pixel.projections, thresholds.x)];
        let texel = select_of_4(weights, thresholds.y);
        shade_choose(texel, plane);
        let scale = lower + select(0u, 1u, thresholds.z < pixel.tiling.y);
        return terrain_tap(pixel.cell, texel, terrain_projection(plane, pixel.footprint), scale);
    }
    for (var t = 0u; t < frame.taps - 2u; t++) {
        let plane = pixel.planes[select_of_3(pixel.projections, thresholds[2u * t])];
        let texel = select_of_4(weights, thresholds[2u * t + 1u]);
        shade_choose(texel, plane);
        let tap = terrain_tap(pixel.cell, texel, terrain_projection(plane, pixel.footprint), lower + t);
        sum = surface_add(sum, shares[t], tap);
    }
    return sum;
}

// Three projections of four materials, all blended: 48 fetches, or 96 with two tiling scales.
fn shade_splat(pixel: Pixel) -> Surface {
    var sum = surface_zero();
    if ESTIMATOR == ESTIMATOR_STF {
        return shade_one_tap(pixel, SALT_SPLAT, 0u, 0.0);
    }
    for (var i = 0u; i < shade_projections(); i++) {
        let projection = terrain_projection(pixel.planes[i], pixel.footprint);
        if TWO_TILINGS {
            for (var t = 0u; t < frame.taps - 2u; t++) {
                let share = select(1.0 - pixel.tiling.y, pixel.tiling.y, t == 1u);
                let blend = shade_blend(pixel, projection, u32(pixel.tiling.x) + t);
                sum = surface_add(sum, pixel.projections[i] * share, blend);
            }
        } else {
            sum = surface_add(sum, pixel.projections[i], shade_blend(pixel, projection, 0u));
        }
    }
    return sum;
}

struct ShadingVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) mask: u32,
}

fn shading_ndc(pixel: vec2<f32>) -> vec2<f32> {
    return (pixel / vec2<f32>(frame.size) * 2.0 - 1.0) * vec2<f32>(1.0, -1.0);
}

@vertex
fn shading_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> ShadingVarying {
    let entry = tile_lists[VARIANT * frame.tiles.x * frame.tiles.y + instance];
    let tile = tile_place(entry);
    let tile_pixel = vec2<f32>(tile * TILE);
    if ONE_TRIANGLE {
        // Its sides pass 3/8 of a pixel outside the tile at the centres of its first row and 3/8 inside at those of its last, and meet far below.
        let edge = f32(TILE);
        let outside = 0.375 * edge / (edge - 1.0);
        let apex = vec2<f32>(0.5 * edge, 0.5 * edge * ((edge - 1.0) * 4.0 / 3.0 + 1.0));
        var triangle = array<vec2<f32>, 3>(vec2<f32>(-outside, 0.0), vec2<f32>(edge + outside, 0.0), apex);
        let at = triangle[vertex];
        // Depth is clamped, not clipped: 0, behind all terrain, up to the centres of the last row, and 1 from those of the row below on.
        return ShadingVarying(vec4<f32>(shading_ndc(tile_pixel + at), (at.y - edge + 0.25) * 4.0, 1.0), tile_variant(entry));
    }
    var corners = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u);
    let corner = corners[vertex];
    let at = vec2<f32>(vec2<u32>(corner & 1u, corner >> 1u) * TILE);
    return ShadingVarying(vec4<f32>(shading_ndc(tile_pixel + at), 0.0, 1.0), tile_variant(entry));
}

struct GBuffer {
    @location(0) albedo: vec4<f32>,         // linear rgb, specular occlusion
    @location(1) normal: vec4<f32>,         // world normal, smoothness
}

// The theoretical variance of a pixel's albedo over seeds: only the stochastic flavours have one, and they draw independently.
fn shade_variance(pixel: Pixel, mask: u32, weights: array<f32, 5>) -> GBuffer {
    var variance = vec3<f32>(0.0);
    if RUNS_NEAR_CLIFF {
        if (mask & 4u) != 0u && weights[FLAVOUR_NEAR_CLIFF] > 0.0 {
            variance += weights[FLAVOUR_NEAR_CLIFF] * weights[FLAVOUR_NEAR_CLIFF] * shade_near_cliff(pixel).albedo;
        }
    }
    if RUNS_FAR_CLIFF {
        if (mask & 8u) != 0u && weights[FLAVOUR_FAR_CLIFF] > 0.0 {
            variance += weights[FLAVOUR_FAR_CLIFF] * weights[FLAVOUR_FAR_CLIFF] * shade_far_cliff(pixel).albedo;
        }
    }
    let modulation = terrain_colour_modulation(pixel.node);
    // Scaled, so that f16 does not run into its denormals.
    return GBuffer(vec4<f32>(variance * modulation * modulation * SHADING_VARIANCE_SCALE, 0.0), vec4<f32>(pixel.normal, 0.0));
}

fn shade(index: vec2<u32>, tile_mask: u32) -> GBuffer {
    var mask = VARIANT;
    if VARIANT == 0u {
        mask = tile_mask;
    }
    let depth = textureLoad(depth_target, index, 0);
    let normals = textureLoad(normal_target, index, 0);
    var pixel: Pixel;
    pixel.index = index;
    pixel.footprint = surface_footprint(index, depth, normals);
    pixel.node = terrain_node(pixel.footprint.place);
    pixel.cell = terrain_splat_cell(pixel.node);
    pixel.normal = frame_shading_normal(normals);
    if PROJECTS {
        shade_project(&pixel);
    }

    let distance = length(frame_ray(vec2<f32>(index))) * view_distance(frame.near_m, depth);
    let all = flavour_weights(distance, pixel.normal.z, frame.flavours);
    let weights = flavour_weights_for(all, mask, select(0u, 1u, frame.forced_mask != 0u));
    pixel.tiling = tiling_scales(distance, frame.flavours.cliff_near_m, flavour_steep(pixel.normal.z, frame.flavours.cliff_cos));

    if ESTIMATOR == ESTIMATOR_VARIANCE {
        return shade_variance(pixel, mask, weights);
    }

    var albedo = vec3<f32>(0.0);
    var normal = vec3<f32>(0.0);
    var smoothness = 0.0;
    var occlusion = 0.0;
    if RUNS_VT {
        if (mask & 1u) != 0u && weights[FLAVOUR_VT] > 0.0 {
            let s = shade_virtual_texture(pixel);
            let w = weights[FLAVOUR_VT];
            albedo += w * s.albedo;
            normal += w * triplanar_perturb(pixel.normal, s.gradient);
            smoothness += w * s.smoothness;
            occlusion += w * s.specular_occlusion;
        }
    }
    if (mask & 30u) != 0u {
        // All but the virtual texture, whose pages already hold it, share one colour modulation.
        var sum = surface_zero();
        var share = 0.0;
        if RUNS_FAR_ATLAS {
            if (mask & 2u) != 0u && weights[FLAVOUR_FAR_ATLAS] > 0.0 {
                let far = shade_far_atlas(pixel);
                let w = weights[FLAVOUR_FAR_ATLAS];
                sum = surface_add(sum, w, far.surface);
                normal += w * far.normal;
                share += w;
            }
        }
        if RUNS_NEAR_CLIFF {
            if (mask & 4u) != 0u && weights[FLAVOUR_NEAR_CLIFF] > 0.0 {
                let s = shade_near_cliff(pixel);
                let w = weights[FLAVOUR_NEAR_CLIFF];
                sum = surface_add(sum, w, s);
                normal += w * triplanar_perturb(pixel.normal, s.gradient);
                share += w;
            }
        }
        if RUNS_FAR_CLIFF {
            if (mask & 8u) != 0u && weights[FLAVOUR_FAR_CLIFF] > 0.0 {
                let s = shade_far_cliff(pixel);
                let w = weights[FLAVOUR_FAR_CLIFF];
                sum = surface_add(sum, w, s);
                normal += w * triplanar_perturb(pixel.normal, s.gradient);
                share += w;
            }
        }
        if RUNS_SPLAT {
            if (mask & 16u) != 0u && weights[FLAVOUR_SPLAT] > 0.0 {
                let s = shade_splat(pixel);
                let w = weights[FLAVOUR_SPLAT];
                sum = surface_add(sum, w, s);
                normal += w * triplanar_perturb(pixel.normal, s.gradient);
                share += w;
            }
        }
        if share > 0.0 {
            albedo += sum.albedo * terrain_colour_modulation(pixel.node);
            smoothness += sum.smoothness;
            occlusion += sum.specular_occlusion;
        }
    }
    return GBuffer(vec4<f32>(albedo, occlusion), vec4<f32>(octahedral_unit(normal), smoothness));
}

@fragment
fn shading_fragment(in: ShadingVarying) -> GBuffer {
    return shade(vec2<u32>(in.clip.xy), in.mask);
}

struct GBufferCounted {
    @location(0) albedo: vec4<f32>,
    @location(1) normal: vec4<f32>,
    @location(2) diagnostics: u32,          // fetches, choice << 16, tile mask << 24
}

@fragment
fn shading_fragment_counted(in: ShadingVarying) -> GBufferCounted {
    fetch_count = 0u;
    choice = 0u;
    let g = shade(vec2<u32>(in.clip.xy), in.mask);
    return GBufferCounted(g.albedo, g.normal, fetch_count | (choice << 16u) | (in.mask << 24u));
}

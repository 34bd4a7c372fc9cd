// The struct `Pixel`, which is the input of every flavour and estimator, and the override constants that specialise shading.

// Mask of the flavours that are compiled in, 1..31; 0 = the generic kernel, which reads the mask of each tile at run time.
override VARIANT: u32 = 0u;
// How the flavours near cliff, far cliff and splat compute their values; `Estimator` in estimator.rs explains each estimator.
override ESTIMATOR: u32 = 0u;
// Noise that drives the random choices, see noise.wgsl.
override NOISE: u32 = 0u;
// Whether a tile is drawn as one triangle instead of two. Devices usually shade pixels in groups of 2 x 2 or more, and shade each group on the
// diagonal between two triangles twice. One triangle has no diagonal. Its part below the tile is discarded by the depth test.
override ONE_TRIANGLE: bool = false;
// Edge length of a tile, pixels.
override TILE: u32 = 8u;
// Whether splat blends two tiling scales, which doubles its fetches. With the estimators `fc5` and `exact`, splat then takes 96 fetches and gives the
// reference blend.
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

// Conditions that depend only on VARIANT and ESTIMATOR. The host removes code that a false condition disables, before a driver compiles the shader
// (see gpu/specialise.rs).
override RUNS_VT: bool = (VARIANT == 0u) | ((VARIANT & FLAVOUR_VT_BIT) != 0u);
override RUNS_FAR_ATLAS: bool = (VARIANT == 0u) | ((VARIANT & FLAVOUR_FAR_ATLAS_BIT) != 0u);
override RUNS_NEAR_CLIFF: bool = (VARIANT == 0u) | ((VARIANT & FLAVOUR_NEAR_CLIFF_BIT) != 0u);
override RUNS_FAR_CLIFF: bool = (VARIANT == 0u) | ((VARIANT & FLAVOUR_FAR_CLIFF_BIT) != 0u);
override RUNS_SPLAT: bool = (VARIANT == 0u) | ((VARIANT & FLAVOUR_SPLAT_BIT) != 0u);
override PROJECTS: bool = (VARIANT == 0u) | ((VARIANT & (FLAVOUR_NEAR_CLIFF_BIT | FLAVOUR_FAR_CLIFF_BIT | FLAVOUR_SPLAT_BIT)) != 0u);
override IS_BIPLANAR: bool = (ESTIMATOR == ESTIMATOR_BIPLANAR) | (ESTIMATOR == ESTIMATOR_BIPLANAR_MEAN);
override HAS_ONE_PROJECTION: bool = (ESTIMATOR == ESTIMATOR_SNAPPED) | (ESTIMATOR == ESTIMATOR_LUNA8);
// Whether random choices are replaced by their mean.
override TAKES_MEANS: bool = (ESTIMATOR == ESTIMATOR_EXACT) | (ESTIMATOR == ESTIMATOR_BIPLANAR_MEAN) | (ESTIMATOR == ESTIMATOR_HEX_MEAN);
// Whether near cliff, far cliff and splat are shaded alike, by the function of splat. It blends all four materials (eight for `luna8`) in each
// projection at tiling scale 0. Exception: on far cliff, `laplacian` uses a tiling scale that depends on the distance.
override IS_ONE_BLEND: bool = (ESTIMATOR == ESTIMATOR_LAPLACIAN) | (ESTIMATOR == ESTIMATOR_LUNA8) | (ESTIMATOR == ESTIMATOR_SNAPPED);

// The host defines salts, numbers that are hashed together with the seed. SALT_NEAR_CLIFF, SALT_FAR_CLIFF and SALT_SPLAT give each stochastic flavour
// independent random numbers. The estimator `stf` adds one of two more salts to that of the flavour when it chooses mip level and texel: SALT_TEXEL
// in the albedo and normal textures, SALT_HEIGHT_TEXEL in the height texture.

struct Pixel {
    index: vec2<u32>,
    footprint: Footprint,
    node: NodePlace,
    cell: SplatCell,
    normal: vec3<f32>,          // shading normal
    planes: vec3<u32>,          // the projections: 0..2 = along x, y, z; 3, 4 = along a horizontal diagonal, see snapped_projection.wgsl
    projections: vec3<f32>,     // weights of the projections
    tiling: vec2<f32>,          // x: exponent of the lower of two tiling scales; y: weight of the upper scale
}

// First random choice of the pixel, for diagnostics: 1 + splat texel + 4 x projection; 0 = no choice so far.
var<private> choice: u32;

// Returns the random thresholds of a pixel, in [0, 1). They decide the random choices of a flavour; `salt` is the salt of the flavour.
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

// Records a random choice, if it is the first of the pixel.
fn shade_choose(texel: u32, plane: u32) {
    if choice == 0u {
        choice = 1u + texel + 4u * plane;
    }
}

// Number of projections of the estimator: 2, 1 or 3. It is computed from frame.taps, a uniform that is always 4, so that compilers do not unroll
// loops over the projections (see terrain.wgsl).
fn shade_projections() -> u32 {
    if IS_BIPLANAR {
        return frame.taps - 2u;
    }
    if HAS_ONE_PROJECTION {
        return frame.taps - 3u;
    }
    return frame.taps - 1u;
}

// Which shading flavours a point needs, and their weights.
// Source: Moore, "Terrain Rendering in Far Cry 5", GDC 2018 ("Terrain Shader Variations").
// The host passes the constants FLAVOUR_... to this file. FLAVOUR_VT, FLAVOUR_FAR_ATLAS, FLAVOUR_NEAR_CLIFF, FLAVOUR_FAR_CLIFF and FLAVOUR_SPLAT are
// the indices of the flavours in arrays of five. The same names with the suffix _BIT are the bits of the flavours in a mask. FLAVOUR_BITS has all
// five bits.

struct FlavourParams {
    // Distance, metres, at which ground changes from virtual texture to far atlas.
    far_atlas_m: f32,
    // Distance, metres, at which cliffs change to the far atlas.
    cliff_far_atlas_m: f32,
    // Distance, metres, at which near cliff changes to far cliff, and splat to ground.
    cliff_near_m: f32,
    // Half the width of the transition between two flavours, as a share of the distance at which they change, 0..=1.
    distance_blend: f32,
    // Two values of the unit normal's z, first <= second. Surfaces with z below the first are shaded as cliff, surfaces with z above the second are
    // not. Between the two values, the weight of cliff falls to 0. If the second value is -1 or less, there are no cliffs.
    cliff_cos: vec2<f32>,
    // The splat band: two values of the unit normal's z, first <= second. Surfaces nearer than `cliff_near_m` that are not cliff are shaded as splat
    // if z is below the first, and as ground if z is above the second. Between the two values, the weight of splat falls to 0.
    splat_cos: vec2<f32>,
    // Not 0 if there is a splat band.
    splat_enabled: u32,
    // Not 0 if there is a virtual texture; otherwise all ground is shaded from the far atlas.
    vt_enabled: u32,
    // Padding to a multiple of 16 bytes, which uniform buffers require.
    padding: vec2<u32>,
}

// FLAVOUR_MIN_WEIGHT: a weight of at most this value counts as zero. FLAVOUR_FORCED_WEIGHT: the smallest weight, before normalisation, of each
// flavour of a forced variant. flavour_weights.rs explains both values.

// Whether a mask has a flavour's bit.
fn flavour_is_in(mask: u32, bit: u32) -> bool {
    return (mask & bit) != 0u;
}

// 0 below `low`, 1 above `high`, Hermite interpolation in between; if `low` equals `high`, a step that is 1e-6 wide.
fn flavour_ramp(x: f32, low: f32, high: f32) -> f32 {
    let t = clamp((x - low) / max(high - low, 1e-6), 0.0, 1.0);
    return t * t * (3.0 - 2.0 * t);
}

// 0 if `distance` is nearer than `border`, 1 if it is farther, with a smooth step around the border. `blend` is half the width of the step,
// as a share of `border`. Every distance is farther than a border of 0.
fn flavour_behind(distance: f32, border: f32, blend: f32) -> f32 {
    let at = usable_positive_1(border, 1e9);
    let share = usable_positive_1(blend, 1.0);
    return select(flavour_ramp(distance, at * (1.0 - share), at * (1.0 + share)), 1.0, at <= 0.0);
}

// Weight of steep surfaces: 1 if `normal_z` is below the band (steeper), 0 if it is above, and a smooth step inside. Always 0 if the band ends at -1
// or below.
fn flavour_steep(normal_z: f32, band: vec2<f32>) -> f32 {
    let low = select(-1.0, clamp(band.x, -1.0, 1.0), usable_number(band.x));
    let high = select(-1.0, clamp(band.y, -1.0, 1.0), usable_number(band.y));
    return select(1.0 - flavour_ramp(normal_z, low, high), 0.0, high <= -1.0);
}

// Blend weights of the five flavours, >= 0, summing to 1. `distance` is in metres along the view ray; `normal_z` is the z component of the unit
// normal.
fn flavour_weights(distance: f32, normal_z: f32, params: FlavourParams) -> array<f32, 5> {
    // NaN counts as far and flat, which gives the cheapest flavour.
    let d = select(1e9, clamp(distance, 0.0, 1e9), usable_number(distance));
    let z = select(1.0, clamp(normal_z, -1.0, 1.0), usable_number(normal_z));

    let behind_near = flavour_behind(d, params.cliff_near_m, params.distance_blend);
    let behind_cliff = flavour_behind(d, params.cliff_far_atlas_m, params.distance_blend);
    let behind_ground = select(1.0, flavour_behind(d, params.far_atlas_m, params.distance_blend), params.vt_enabled != 0u);

    let cliff = flavour_steep(z, params.cliff_cos);
    // The share of the splat band fades out with distance; ground takes its place.
    let band = select(0.0, flavour_steep(z, params.splat_cos) * (1.0 - behind_near), params.splat_enabled != 0u);
    let ground = (1.0 - cliff) * (1.0 - band);

    return array<f32, 5>(
        ground * (1.0 - behind_ground),
        ground * behind_ground + cliff * behind_cliff,
        cliff * (1.0 - behind_cliff) * (1.0 - behind_near),
        cliff * (1.0 - behind_cliff) * behind_near,
        (1.0 - cliff) * band,
    );
}

// The set of flavours whose weight is above FLAVOUR_MIN_WEIGHT. It is never empty: if no weight is large enough, the set contains only the far atlas.
fn flavour_mask(weights: array<f32, 5>) -> u32 {
    var mask = 0u;
    mask |= select(0u, 1u, weights[0] > FLAVOUR_MIN_WEIGHT);
    mask |= select(0u, 2u, weights[1] > FLAVOUR_MIN_WEIGHT);
    mask |= select(0u, 4u, weights[2] > FLAVOUR_MIN_WEIGHT);
    mask |= select(0u, 8u, weights[3] > FLAVOUR_MIN_WEIGHT);
    mask |= select(0u, 16u, weights[4] > FLAVOUR_MIN_WEIGHT);
    return select(mask, FLAVOUR_FAR_ATLAS_BIT, mask == 0u);
}

fn flavour_restricted(weight: f32, present: bool, forced: bool) -> f32 {
    let given = usable_positive_1(weight, 1.0);
    let w = select(0.0, given, given > FLAVOUR_MIN_WEIGHT);
    return select(0.0, select(w, max(w, FLAVOUR_FORCED_WEIGHT), forced), present);
}

// The weights of the flavours in the mask of a variant (a shader that contains these flavours), summing to 1. An empty mask counts as far atlas. If
// no weight of the mask is above FLAVOUR_MIN_WEIGHT, all flavours of the mask get equal weights.
// If `forced` is 0, weights of at most FLAVOUR_MIN_WEIGHT become 0, as in flavour_mask, so that a pixel looks the same in every variant that contains
// all flavours of the pixel. If `forced` is not 0, every flavour of the mask gets at least FLAVOUR_FORCED_WEIGHT before normalisation, so that the
// shader evaluates it.
fn flavour_weights_for(weights: array<f32, 5>, mask: u32, forced: u32) -> array<f32, 5> {
    let usable = mask & FLAVOUR_BITS;
    let m = select(usable, FLAVOUR_FAR_ATLAS_BIT, usable == 0u);
    let force = forced != 0u;
    var w = array<f32, 5>(
        flavour_restricted(weights[FLAVOUR_VT], flavour_is_in(m, FLAVOUR_VT_BIT), force),
        flavour_restricted(weights[FLAVOUR_FAR_ATLAS], flavour_is_in(m, FLAVOUR_FAR_ATLAS_BIT), force),
        flavour_restricted(weights[FLAVOUR_NEAR_CLIFF], flavour_is_in(m, FLAVOUR_NEAR_CLIFF_BIT), force),
        flavour_restricted(weights[FLAVOUR_FAR_CLIFF], flavour_is_in(m, FLAVOUR_FAR_CLIFF_BIT), force),
        flavour_restricted(weights[FLAVOUR_SPLAT], flavour_is_in(m, FLAVOUR_SPLAT_BIT), force),
    );
    var sum = w[0] + w[1] + w[2] + w[3] + w[4];
    if sum <= 0.0 {
        for (var i = 0u; i < 5u; i++) {
            w[i] = f32((m >> i) & 1u);
        }
        sum = f32(countOneBits(m));
    }
    for (var i = 0u; i < 5u; i++) {
        w[i] /= sum;
    }
    return w;
}

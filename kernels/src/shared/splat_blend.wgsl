// Weights of the four splat texels around a point: bilinear weights, modified by the heights of the materials.
// Source: Moore, "Terrain Rendering in Far Cry 5", GDC 2018 (height-modified bilinear weights).
// Order: 00, 10, 01, 11 (x first).

// Heights and sharpness beyond these limits are clamped.
const SPLAT_BLEND_MAX_HEIGHT: f32 = 1024.0;
const SPLAT_BLEND_MAX_SHARPNESS: f32 = 1e4;
// A bilinear weight of at most this value counts as zero, so that quotients of weights stay in the range of f32.
const SPLAT_BLEND_MIN_WEIGHT: f32 = 1e-30;

// Bilinear weights of a point at `fraction`, [0, 1]², between the texels.
fn splat_blend_bilinear(fraction: vec2<f32>) -> vec4<f32> {
    let f = usable_positive_2(fraction, 1.0);
    let g = vec2<f32>(1.0) - f;
    return vec4<f32>(g.x * g.y, f.x * g.y, g.x * f.y, f.x * f.y);
}

// Weights w_i 2^(k h_i), normalised. w are the bilinear weights, h is `heights`, and k is `sharpness` >= 0, where 0 gives plain bilinear weights.
fn splat_blend_weights(fraction: vec2<f32>, heights: vec4<f32>, sharpness: f32) -> vec4<f32> {
    let w = splat_blend_bilinear(fraction);
    let limit = vec4<f32>(SPLAT_BLEND_MAX_HEIGHT);
    let h = clamp(usable_4(heights), -limit, limit);
    let k = usable_positive_1(sharpness, SPLAT_BLEND_MAX_SHARPNESS);
    let used = w > vec4<f32>(SPLAT_BLEND_MIN_WEIGHT);

    // All terms are divided by the largest term. The largest term is then exactly 1, no term exceeds 1 by more than rounding, and the sum cannot
    // underflow. A division by 2^(k h_max), with the largest height h_max, would not be enough: the weight of the highest texel may be tiny.
    let score = select(vec4<f32>(-1e30), log2(max(w, vec4<f32>(SPLAT_BLEND_MIN_WEIGHT))) + k * h, used);
    var best_score = score.x;
    var best_weight = w.x;
    var best_height = h.x;
    if score.y > best_score {
        best_score = score.y;
        best_weight = w.y;
        best_height = h.y;
    }
    if score.z > best_score {
        best_score = score.z;
        best_weight = w.z;
        best_height = h.z;
    }
    if score.w > best_score {
        best_weight = w.w;
        best_height = h.w;
    }
    // Only unused texels can reach this limit. It keeps their terms finite, although the following `select` does not use them.
    let exponent = min(k * (h - vec4<f32>(best_height)), vec4<f32>(120.0));
    let bent = select(vec4<f32>(0.0), (w / best_weight) * exp2(exponent), used);
    return bent / (bent.x + bent.y + bent.z + bent.w);
}

// Computes a mean of four values with the weights of splat_blend_weights, one value at a time, for callers that cannot store all four values. After
// each call of splat_blend_add, first multiply the sum so far by `keep`, then add the value times `share`. Accumulate the sum of the shares in the
// same way; it is at least 1. At the end, divide the sum of the values by the sum of the shares. A term is w 2^(k h), the unnormalised weight of a
// value.
struct SplatBlendRun {
    score: f32,                 // log2 w + k h of the largest term so far
    weight: f32,                // w of the largest term so far
    height: f32,                // h of the largest term so far
    keep: f32,
    share: f32,
}

fn splat_blend_start() -> SplatBlendRun {
    return SplatBlendRun(-1e30, 0.0, 0.0, 1.0, 0.0);
}

fn splat_blend_add(run: SplatBlendRun, weight: f32, height: f32, sharpness: f32) -> SplatBlendRun {
    let w = usable_positive_1(weight, 1.0);
    if !(w > SPLAT_BLEND_MIN_WEIGHT) {
        return SplatBlendRun(run.score, run.weight, run.height, 1.0, 0.0);
    }
    let h = clamp(usable_1(height), -SPLAT_BLEND_MAX_HEIGHT, SPLAT_BLEND_MAX_HEIGHT);
    let k = usable_positive_1(sharpness, SPLAT_BLEND_MAX_SHARPNESS);
    let score = log2(w) + k * h;
    // The terms are divided by the largest term so far, which is then exactly 1. For the first term, run.weight is 0, so `keep` is 0.
    if score > run.score {
        return SplatBlendRun(score, w, h, (run.weight / w) * exp2(min(k * (run.height - h), 120.0)), 1.0);
    }
    return SplatBlendRun(run.score, run.weight, run.height, 1.0, (w / max(run.weight, SPLAT_BLEND_MIN_WEIGHT)) * exp2(min(k * (h - run.height), 120.0)));
}

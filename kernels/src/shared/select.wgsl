// Choice of an index with probability proportional to its weight, by inverting the cumulative sum.
// Weights need not sum to 1; negative weights and NaN count as 0. If all weights are 0, index 0 is chosen; otherwise, no index of weight 0 is.

const SELECT_MAX_WEIGHT: f32 = 1e30;

fn select_of_4(weights: vec4<f32>, u: f32) -> u32 {
    let w = usable_positive_4(weights, SELECT_MAX_WEIGHT);
    let below_1 = w.x;
    let below_2 = below_1 + w.y;
    let below_3 = below_2 + w.z;
    let total = below_3 + w.w;
    let target_sum = usable_positive_1(u, 1.0) * total;
    if target_sum < below_1 {
        return 0u;
    }
    if target_sum < below_2 {
        return 1u;
    }
    if target_sum < below_3 {
        return 2u;
    }
    // This point is reached if index 3 is chosen, if u is 1, if the product was rounded up to the total, or if all weights are 0.
    if w.w > 0.0 {
        return 3u;
    }
    if w.z > 0.0 {
        return 2u;
    }
    if w.y > 0.0 {
        return 1u;
    }
    return 0u;
}

fn select_of_3(weights: vec3<f32>, u: f32) -> u32 {
    return select_of_4(vec4<f32>(weights, 0.0), u);
}

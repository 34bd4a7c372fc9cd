// Mean and variance of a stream of numbers, updated with one number at a time: Welford's recurrence with compensated sums. With both, f32 is precise
// enough for a stream of 1e6 numbers that has a mean of 1e6 and a variance of 1e-6.
// Source: Welford, "Note on a Method for Calculating Corrected Sums of Squares and Products", Technometrics 4(3), 1962;
// two-sum: Knuth, The Art of Computer Programming, volume 2, section 4.2.2, theorem B.

// Returns x. The function prevents the compiler from simplifying the expression that computes x: WGSL lets a compiler replace (a + b) - a by b. Mesa
// does so, and this removes the compensation. `zero` is a word that is always 0, but it is read from memory, so the compiler cannot assume its value
// and cannot remove the exclusive or.
fn moments_rounded(x: f32, zero: u32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ zero);
}

// Sum of a two-part number and a plain number. The result is (high, low) with |low| at most half an ulp of high.
fn moments_sum(a: vec2<f32>, b: f32, zero: u32) -> vec2<f32> {
    let sum = moments_rounded(a.x + b, zero);
    let part = moments_rounded(sum - a.x, zero);
    let rest = moments_rounded(sum - part, zero);
    let low = moments_rounded(a.y + ((a.x - rest) + (b - part)), zero);
    let high = moments_rounded(sum + low, zero);
    return vec2<f32>(high, low - moments_rounded(high - sum, zero));
}

// State: the mean as (high, low), then the sum of squared differences from the mean as (high, low). `sample` is (high, low), too; low is 0 for a
// plain f32. `count` includes the sample, so it is 1 for the first. A sample that is not finite, or farther than 1e15 from the mean so far, counts
// as the mean. With this limit, the sum of a million squares fits f32. `zero` is 0, read from memory; see moments_rounded.
fn moments_add(state: vec4<f32>, sample: vec2<f32>, count: f32, zero: u32) -> vec4<f32> {
    let n = max(count, 1.0);
    let difference = moments_rounded(sample.x - state.x, zero) + moments_rounded(sample.y - state.y, zero);
    if n < 1.5 {
        // Both parts are kept: their rounded sum would lose the lower part.
        return select(vec4<f32>(0.0), vec4<f32>(sample, 0.0, 0.0), usable_within_1(difference, 1e15));
    }
    let delta = select(0.0, difference, usable_within_1(difference, 1e15));
    let mean = moments_sum(state.xy, delta / n, zero);
    let squares = moments_sum(state.zw, delta * (delta * ((n - 1.0) / n)), zero);
    return vec4<f32>(mean, squares);
}

// Unbiased variance of `count` samples, 0 for fewer than two.
fn moments_variance(state: vec4<f32>, count: f32) -> f32 {
    return select(0.0, max(state.z + state.w, 0.0) / max(count - 1.0, 1.0), count > 1.5);
}

// The two projections that a surface faces most, with weights that drop the third projection without a seam.
// Source: Quilez, "Biplanar mapping", 2020.

// 1 / sqrt 3: the size of each component of a unit vector that faces all three axes equally. Components of at most this size have weight 0. Where the
// middle and the smallest component are equal in size, the dropped projection changes. Neither component is then larger than 1 / sqrt 3, so both
// projections have weight 0 there.
const BIPLANAR_DIAGONAL: f32 = 0.57735027;
const BIPLANAR_MAX_SHARPNESS: f32 = 1e4;

struct Biplanar {
    axes: vec2<u32>,            // the two axes with the largest |n_i|; the axis with the lower index first
    weights: vec2<f32>,         // sum to 1
}

// Scales n to length 1, then weights its two largest components: ((|n_i| - 1/sqrt 3) / (1 - 1/sqrt 3))^(k/8), normalised. `sharpness` is k, the
// exponent of tri-planar weights; the exponent here is an eighth of k. On the eight diagonals, where all three components are equal in size, the
// first axis gets all the weight.
fn biplanar_projections(n: vec3<f32>, sharpness: f32) -> Biplanar {
    let a = abs(octahedral_unit(n));
    var axes = vec2<u32>(0u, 1u);
    var kept = a.xy;
    if a.x <= a.y && a.x <= a.z {
        axes = vec2<u32>(1u, 2u);
        kept = a.yz;
    } else if a.y <= a.z {
        axes = vec2<u32>(0u, 2u);
        kept = a.xz;
    }
    let above = max(kept - BIPLANAR_DIAGONAL, vec2<f32>(0.0));
    let top = max(above.x, above.y);
    if !(top > 0.0) {
        return Biplanar(axes, vec2<f32>(1.0, 0.0));
    }
    let k = 0.125 * usable_positive_1(sharpness, BIPLANAR_MAX_SHARPNESS);
    // The values are divided by the larger one, whose term is then 1. A value of 0 has weight 0 for any exponent, even
    // for 0, so the weight of an axis is 0 where the axis is dropped.
    let r = above / top;
    let w = select(vec2<f32>(0.0), exp2(k * log2(max(r, vec2<f32>(1e-30)))), r > vec2<f32>(1e-30));
    return Biplanar(axes, w / (w.x + w.y));
}

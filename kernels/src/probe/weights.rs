//! Probes of the weights of materials, layers and flavours, and of random choices by weight.

use super::judge::{EPS, FEW, Verdict, both, close, equal, farthest};
use super::{Measure, Parameter, Probe, real, take, whole};
use crate::shared::flavour_weights::{self, FlavourParams};
use crate::shared::real::{Real, scale};
use crate::shared::{layers, select, splat_blend};

pub(super) const SPLAT_BLEND: Probe = Probe {
    name: "splat-blend",
    about: "Weights of four splat texels: bilinear, modified by the heights of the materials; computed in one step, and again term by term",
    inputs: &[
        real("fraction_x", "0..1 between the texels, east"),
        real("fraction_y", "0..1 between the texels, north"),
        real("h_00", "height, 0..1"),
        real("h_10", "height, 0..1"),
        real("h_01", "height, 0..1"),
        real("h_11", "height, 0..1"),
        real("sharpness", "k in w' = w 2^(k h)"),
    ],
    outputs: &[
        real("w_00", "computed in one step, 0..1"),
        real("w_10", "0..1"),
        real("w_01", "0..1"),
        real("w_11", "0..1"),
        real("run_00", "computed term by term, 0..1"),
        real("run_10", "0..1"),
        real("run_01", "0..1"),
        real("run_11", "0..1"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 7>) -> array<f32, 8> {
let fraction = vec2<f32>(row[0], row[1]);
let heights = vec4<f32>(row[2], row[3], row[4], row[5]);
let w = splat_blend_weights(fraction, heights, row[6]);
let bilinear = splat_blend_bilinear(fraction);
var terms = mat4x4<f32>(vec4<f32>(1.0, 0.0, 0.0, 0.0), vec4<f32>(0.0, 1.0, 0.0, 0.0), vec4<f32>(0.0, 0.0, 1.0, 0.0), vec4<f32>(0.0, 0.0, 0.0, 1.0));
var run = splat_blend_start();
var sum = vec4<f32>(0.0);
for (var i = 0u; i < 4u; i++) {
    run = splat_blend_add(run, bilinear[i], heights[i], row[6]);
    sum = run.keep * sum + run.share * terms[i];
}
sum /= dot(sum, vec4<f32>(1.0));
return array<f32, 8>(w.x, w.y, w.z, w.w, sum.x, sum.y, sum.z, sum.w);
}",
    single: splat_blend_row,
    double: splat_blend_row,
    random: |d| {
        let sharpness = if d.whole(8) < 0.5 { 0.0 } else { d.between(-2.0, 7.0).exp2() };
        vec![d.unit(), d.unit(), d.unit(), d.unit(), d.unit(), d.unit(), sharpness]
    },
    judge: splat_blend_judge,
    measures: &[Measure { name: "weight", unit: "% of weight", error: |_, got, want| 100.0 * farthest(got, want) }],
    parameters: &[
        Parameter { name: "fraction", unit: "0..1, both", set: |row, value, _| row[..2].fill(value) },
        Parameter { name: "height", unit: "all four", set: |row, value, _| row[2..6].fill(value) },
        Parameter { name: "height_apart", unit: "difference of one height from three equal heights", set: |row, value, _| {
            row[2..6].fill(0.5);
            row[3] += value;
        } },
    ],
};

pub(super) const SELECT: Probe = Probe {
    name: "select",
    about: "Random choice of an index by weight: among all four weights, and among the first three weights",
    inputs: &[
        real("w_0", "weight, >= 0"),
        real("w_1", "weight, >= 0"),
        real("w_2", "weight, >= 0"),
        real("w_3", "weight, >= 0"),
        real("u", "uniform number, 0..1"),
    ],
    outputs: &[whole("of_4", "index chosen among four", 0, 3), whole("of_3", "index chosen among three", 0, 2)],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 5>) -> array<f32, 2> {
let of_4 = select_of_4(vec4<f32>(row[0], row[1], row[2], row[3]), row[4]);
let of_3 = select_of_3(vec3<f32>(row[0], row[1], row[2]), row[4]);
return array<f32, 2>(f32(of_4), f32(of_3));
}",
    single: select_row,
    double: select_row,
    random: |d| {
        let mut row: Vec<f64> = (0..4).map(|_| if d.whole(5) < 0.5 { 0.0 } else { d.between(-10.0, 3.0).exp2() }).collect();
        row.push(d.unit());
        row
    },
    judge: select_judge,
    measures: &[Measure { name: "index", unit: "choices", error: |_, got, want| if got == want { 0.0 } else { 1.0 } }],
    parameters: &[
        Parameter { name: "weight", unit: "all four", set: |row, value, _| row[..4].fill(value) },
        Parameter {
            name: "weight_apart",
            unit: "relative difference of one weight from three equal weights",
            set: |row, value, _| {
                row[..4].fill(1.0);
                row[1] += value;
            },
        },
    ],
};

pub(super) const LAYERS: Probe = Probe {
    name: "layers",
    about: "Weights of eight layers blended over one another, from four splat texels that show one layer each",
    inputs: &[
        real("w_00", "weight of a texel, 0..1"),
        real("w_10", "weight"),
        real("w_01", "weight"),
        real("w_11", "weight"),
        whole("l_00", "layer of the texel", 0, 7),
        whole("l_10", "layer", 0, 7),
        whole("l_01", "layer", 0, 7),
        whole("l_11", "layer", 0, 7),
    ],
    outputs: &[
        real("layer_0", "weight of the layer, 0..1"),
        real("layer_1", "0..1"),
        real("layer_2", "0..1"),
        real("layer_3", "0..1"),
        real("layer_4", "0..1"),
        real("layer_5", "0..1"),
        real("layer_6", "0..1"),
        real("layer_7", "0..1"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 8>) -> array<f32, 8> {
let weights = vec4<f32>(row[0], row[1], row[2], row[3]);
let layers = vec4<u32>(u32(row[4]), u32(row[5]), u32(row[6]), u32(row[7]));
var blended: array<f32, 8>;
var below = 0.0;
for (var layer = 0u; layer < LAYERS; layer++) {
    let share = layers_share(weights, layers, layer);
    let opacity = layers_opacity(layer, share, below);
    below += share;
    for (var i = 0u; i < LAYERS; i++) {
        blended[i] = mix(blended[i], select(0.0, 1.0, i == layer), opacity);
    }
}
return blended;
}",
    single: layers_row,
    double: layers_row,
    random: |d| {
        let weights = splat_blend::bilinear([d.unit(), d.unit()]);
        [&weights[..], &[0; 4].map(|_| d.whole(8))].concat()
    },
    judge: layers_judge,
    measures: &[Measure { name: "weight", unit: "% of weight", error: |_, got, want| 100.0 * farthest(got, want) }],
    parameters: &[Parameter { name: "weight", unit: "all four", set: |row, value, _| row[..4].fill(value) }],
};

fn splat_blend_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (fraction, heights) = (take(row, 0), take(row, 2));
    out.extend(splat_blend::weights(fraction, heights, row[6]));
    let mut run = splat_blend::Run::start();
    let mut sum = [T::zero(); 4];
    for (i, (w, h)) in splat_blend::bilinear(fraction).into_iter().zip(heights).enumerate() {
        run = run.add(w, h, row[6]);
        sum = scale(sum, run.keep);
        sum[i] = run.share;
    }
    out.extend(scale(sum, T::one() / sum.into_iter().fold(T::zero(), |s, x| s + x)));
}

fn splat_blend_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let used: Vec<f64> =
        splat_blend::bilinear([row[0], row[1]]).into_iter().filter(|&w| w > splat_blend::MIN_WEIGHT).map(f64::log2).collect();
    let spread = used.iter().fold(f64::MIN, |m, &x| m.max(x)) - used.iter().fold(f64::MAX, |m, &x| m.min(x));
    // A term is (w_i / w_best) 2^x with x = k (h_i - h_best), where w is a bilinear weight, h is a height, k is the sharpness, and `best` is the
    // texel with the largest term. The relative error of 2^x is 3 + 2 |x| ULP from exp2, and 0.7 |x| ULP from the rounding of x.
    // - Positive x: a term is at most 1, so x is at most `spread`, the largest difference between the log2 w. The part of the error that grows with x
    //   is then less than 4 ULP times the spread.
    // - Negative x: |x| 2^x is at most 0.54, so this part is less than 2 ULP.
    // The 16 ULP include these 2 ULP, two divisions, the products and the sum.
    close(got, want, EPS * (16.0 + 4.0 * spread))
}

fn select_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let index = |i: usize| T::of(f64::from(u8::try_from(i).expect("at most 3")));
    out.push(index(select::of_4(take(row, 0), row[4])));
    out.push(index(select::of_3(take(row, 0), row[4])));
}

fn select_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let mut verdict = Verdict::Agrees(0.0);
    for (count, index, best) in [(4, got[0], want[0]), (3, got[1], want[1])] {
        if (index - best).abs() < 0.5 && index.fract().abs() < EPS {
            continue;
        }
        if index.fract() != 0.0 || !(0.0..count as f64).contains(&index) {
            return Verdict::Differs;
        }
        // Up to three sums and a product are rounded once each, so the error is at most four times half an ULP of the total.
        let (weights, chosen) = (row[..count].iter().map(|w| w.max(0.0)).collect::<Vec<_>>(), index as usize);
        let total: f64 = weights.iter().sum();
        let below: f64 = weights[..chosen].iter().sum();
        let (target, slack) = (row[4].clamp(0.0, 1.0) * total, 2.0 * EPS * total);
        if weights[chosen] <= 0.0 || target < below - slack || target > below + weights[chosen] + slack {
            return Verdict::Differs;
        }
        verdict = Verdict::OtherSide;
    }
    verdict
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn layers_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let of = take::<T, 4>(row, 4).map(|v| v.to_f64() as u32);
    let mut below = T::zero();
    let mut opacities = [T::zero(); layers::LAYERS];
    for (layer, opacity) in (0..).zip(&mut opacities) {
        let share = layers::share(take(row, 0), of, layer);
        *opacity = layers::opacity(layer, share, below);
        below = below + share;
    }
    out.extend(layers::weights(opacities));
}

fn layers_judge(_: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    // For each of the 8 layers, the opacity takes a sum and a quotient (2.5 ULP), and the mixture is rounded 4 times. If the weights sum to 1, all
    // numbers are at most 1. The tolerance allows 8 ULP per layer.
    close(got, want, 8.0 * 8.0 * EPS)
}

/// Distances and slopes at which the flavours change, approximately as in the built-in scene.
const RULES: FlavourParams = FlavourParams {
    far_atlas_m: 300.0,
    cliff_far_atlas_m: 1500.0,
    cliff_near_m: 30.0,
    distance_blend: 0.15,
    cliff_cos: [0.682, 0.731],
    splat_cos: [0.777, 0.819],
    splat_enabled: 1,
    vt_enabled: 1,
    padding: [0; 2],
};

pub(super) const FLAVOUR_WEIGHTS: Probe = Probe {
    name: "flavour-weights",
    about: "Weights of the five flavours at a distance and slope, by rules like those of the built-in scene; and given weights, limited to a mask",
    inputs: &[
        real("distance", "m"),
        real("normal_z", "cosine of the slope"),
        real("given_0", "given weight of virtual texture, 0..1"),
        real("given_1", "given weight of far atlas"),
        real("given_2", "given weight of near cliff"),
        real("given_3", "given weight of far cliff"),
        real("given_4", "given weight of splat"),
        whole("mask", "flavours that a tile may shade", 0, 31),
        whole("forced", "1 = the tile shades all flavours of the mask", 0, 1),
    ],
    outputs: &[
        real("w_0", "weight of virtual texture, 0..1"),
        real("w_1", "far atlas"),
        real("w_2", "near cliff"),
        real("w_3", "far cliff"),
        real("w_4", "splat"),
        whole("given_mask", "mask of the flavours whose given weight is above 1/512", 0, 31),
        real("held_0", "limited weight of virtual texture, 0..1"),
        real("held_1", "limited weight of far atlas"),
        real("held_2", "limited weight of near cliff"),
        real("held_3", "limited weight of far cliff"),
        real("held_4", "limited weight of splat"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 9>) -> array<f32, 11> {
    let rules = FlavourParams(300.0, 1500.0, 30.0, 0.15, vec2<f32>(0.682, 0.731), vec2<f32>(0.777, 0.819), 1u, 1u, vec2<u32>(0u));
    let w = flavour_weights(row[0], row[1], rules);
    let given = array<f32, 5>(row[2], row[3], row[4], row[5], row[6]);
    let held = flavour_weights_for(given, u32(row[7]), u32(row[8]));
    return array<f32, 11>(w[0], w[1], w[2], w[3], w[4], f32(flavour_mask(given)), held[0], held[1], held[2], held[3], held[4]);
}",
    single: flavour_weights_row,
    double: flavour_weights_row,
    random: |d| {
        let weights = [0; 5].map(|_| if d.whole(3) < 0.5 { 0.0 } else { d.between(-12.0, 0.0).exp2() });
        [&[d.between(-1.0, 12.0).exp2(), d.between(0.4, 1.0)][..], &weights, &[d.whole(32), d.whole(2)]].concat()
    },
    judge: flavour_weights_judge,
    measures: &[Measure {
        name: "weight",
        unit: "% of weight",
        error: |_, got, want| 100.0 * farthest(&got[..5], &want[..5]).max(farthest(&got[6..], &want[6..])),
    }],
    parameters: &[Parameter { name: "given", unit: "all five weights", set: |row, value, _| row[2..7].fill(value) }],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn flavour_weights_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let given = take(row, 2);
    out.extend(flavour_weights::weights(row[0], row[1], &RULES));
    out.push(T::of(f64::from(flavour_weights::mask(given))));
    out.extend(flavour_weights::weights_for(given, row[7].to_f64() as u32, row[8] >= T::one()));
}

fn flavour_weights_judge(_: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    // A weight is a product of ramps over distance and over the cosine of the slope, or a sum of such products. The width of a ramp is at least 1/20
    // of the distance or cosine at which it lies, and its slope is at most 1.5 divided by its width. A ramp therefore multiplies the relative error
    // of its argument by at most 30, and the error of eight roundings (4 ULP) becomes at most 120 ULP. The tolerance is about twice as large, because
    // a weight is a product of more than one ramp.
    let weights = close(&got[..5], &want[..5], 256.0 * EPS);
    both(both(weights, equal(&[], &got[5..6], &want[5..6])), close(&got[6..], &want[6..], FEW))
}

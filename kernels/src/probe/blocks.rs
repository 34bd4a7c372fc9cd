//! Probes of the device's decoder of block-compressed textures.

use super::judge::{Draw, Verdict, farthest};
use super::{Cell, Measure, Probe, real, whole, word};

/// The part of a channel's tolerance that is proportional to the difference between the two end points of the block in this channel: 3 % of the
/// difference. The Direct3D 11.3 functional specification, section 19.5, allows it, because devices may first expand end points to 8 bits, with
/// rounding.
const OF_LINE: f64 = 0.03;
/// The constant part of the tolerance: two steps of an 8-bit channel. The specification allows one. This test allows two, because a decoder in 8-bit
/// fixed point (Mesa's llvmpipe) rounds end points (half a step) and weights (half a step), and truncates the result (one step).
const CODES: f64 = 2.0 / 255.0;

pub(super) const BC1: Probe = Probe {
    name: "bc1",
    about: "The decoded texel of a BC1 block: a colour on the line between two end points of 5 + 6 + 5 bits, or transparent black",
    inputs: &[
        word("colours", "end points, 16 bits each, the first in the low half; if the first is not the larger one, the line has 3 colours"),
        word("indices", "2 bits per texel, the first texel in the lowest bits"),
        whole("texel", "index of the texel, row by row", 0, 15),
    ],
    outputs: &[real("red", "0..1"), real("green", "0..1"), real("blue", "0..1"), real("alpha", "0 or 1")],
    blocks: Some(wgpu::TextureFormat::Bc1RgbaUnorm),
    wgsl: "\
fn probe(row: array<u32, 3>, texel: vec4<f32>) -> array<u32, 4> {
let bits = bitcast<vec4<u32>>(texel);
return array<u32, 4>(bits.x, bits.y, bits.z, bits.w);
}",
    single: bc1_row,
    double: bc1_row,
    random: |d| vec![colours(d), f64::from(d.word()), d.whole(16)],
    judge: |row, got, want| within(got, want, line(row[0])),
    measures: &[Measure { name: "colour", unit: "codes of 8 bits", error: |_, got, want| 255.0 * farthest(got, want) }],
    parameters: &[],
};

pub(super) const BC3: Probe = Probe {
    name: "bc3",
    about: "The decoded texel of a BC3 block: a colour as in BC1, always with 4 colours, and an alpha between two end points of 8 bits",
    inputs: &[
        word(
            "alphas",
            "from the lowest bit up: two 8-bit end points, 16 bits of indices; if the first end point is not the larger one, indices 6 and 7 mean 0 and 1",
        ),
        word("alpha_indices", "the upper 32 bits of the indices of alpha, 3 bits per texel"),
        word("colours", "end points, 16 bits each, the first in the low half"),
        word("indices", "2 bits per texel, the first texel in the lowest bits"),
        whole("texel", "index of the texel, row by row", 0, 15),
    ],
    outputs: &[real("red", "0..1"), real("green", "0..1"), real("blue", "0..1"), real("alpha", "0..1")],
    blocks: Some(wgpu::TextureFormat::Bc3RgbaUnorm),
    wgsl: "\
fn probe(row: array<u32, 5>, texel: vec4<f32>) -> array<u32, 4> {
let bits = bitcast<vec4<u32>>(texel);
return array<u32, 4>(bits.x, bits.y, bits.z, bits.w);
}",
    single: bc3_row,
    double: bc3_row,
    random: |d| vec![f64::from(d.word()), f64::from(d.word()), colours(d), f64::from(d.word()), d.whole(16)],
    judge: |row, got, want| {
        let [red, green, blue] = line(row[2]);
        let [first, second] = alphas(row[0] as u32);
        within(got, want, [red, green, blue, (first - second).abs()])
    },
    measures: &[
        Measure { name: "colour", unit: "codes of 8 bits", error: |_, got, want| 255.0 * farthest(&got[..3], &want[..3]) },
        Measure { name: "alpha", unit: "codes of 8 bits", error: |_, got, want| 255.0 * (got[3] - want[3]).abs() },
    ],
    parameters: &[],
};

/// Draws two random end points, packed into a word. In about an eighth of the rows, they are equal.
fn colours(d: &mut Draw) -> f64 {
    let colours = d.word();
    f64::from(if d.whole(8) < 0.5 { colours & 0xffff | colours << 16 } else { colours })
}

/// Decodes red, green and blue from 5 + 6 + 5 bits, each 0..=1.
fn colour(code: u32) -> [f64; 3] {
    [f64::from(code >> 11 & 31) / 31.0, f64::from(code >> 5 & 63) / 63.0, f64::from(code & 31) / 31.0]
}

/// Decodes the two end points of alpha, 0..=1.
fn alphas(word: u32) -> [f64; 2] {
    [word & 255, word >> 8 & 255].map(|code| f64::from(code) / 255.0)
}

/// Absolute difference of the two end points in each channel.
fn line(colours: f64) -> [f64; 3] {
    let (first, second) = (colour(colours as u32 & 0xffff), colour(colours as u32 >> 16));
    std::array::from_fn(|i| (first[i] - second[i]).abs())
}

fn within<const N: usize>(got: &[f64], want: &[f64], line: [f64; N]) -> Verdict {
    let share = |i: usize| (got[i] - want[i]).abs() / (CODES + OF_LINE * line.get(i).copied().unwrap_or(0.0));
    let worst = (0..4).map(share).fold(0.0, f64::max);
    if worst <= 1.0 { Verdict::Agrees(worst) } else { Verdict::Differs }
}

/// The colour of a texel. If `four`, it is one of four colours on the line between the end points. If not, it is one of three colours on this line,
/// or transparent black.
fn on_line(colours: u32, indices: u32, texel: u32, four: bool) -> [f64; 4] {
    let (first, second) = (colour(colours & 0xffff), colour(colours >> 16));
    let mix = |a: f64, b: f64| {
        let [red, green, blue] = std::array::from_fn(|i| (a * first[i] + b * second[i]) / (a + b));
        [red, green, blue, 1.0]
    };
    match (indices >> (2 * texel) & 3, four) {
        (0, _) => mix(1.0, 0.0),
        (1, _) => mix(0.0, 1.0),
        (2, true) => mix(2.0, 1.0),
        (_, true) => mix(1.0, 2.0),
        (2, false) => mix(1.0, 1.0),
        (_, false) => [0.0; 4],
    }
}

fn bc1_row<T: Cell>(row: &[T], out: &mut Vec<T>) {
    let colours = row[0].word();
    let four = colours & 0xffff > colours >> 16;
    out.extend(on_line(colours, row[1].word(), row[2].to_f64() as u32, four).map(T::of));
}

fn bc3_row<T: Cell>(row: &[T], out: &mut Vec<T>) {
    let texel = row[4].to_f64() as u32;
    let [red, green, blue, _] = on_line(row[2].word(), row[3].word(), texel, true);
    let [first, second] = alphas(row[0].word());
    let indices = u64::from(row[0].word() >> 16) | u64::from(row[1].word()) << 16;
    let index = (indices >> (3 * texel) & 7) as u32;
    // An index selects an end point or one of six values between the end points. If the first end point is not the larger one, there are
    // only four values between them, and the last two indices select 0 and 1.
    let steps = if first > second { 7.0 } else { 5.0 };
    let alpha = match index {
        0 => first,
        1 => second,
        6 if first <= second => 0.0,
        7 if first <= second => 1.0,
        _ => {
            let share = f64::from(index - 1) / steps;
            first + (second - first) * share
        }
    };
    out.extend([red, green, blue, alpha].map(T::of));
}

// Guards that keep NaN, infinity and very large numbers out of computations. They test bit patterns, because comparisons of numbers are not reliable
// here: a WGSL compiler may assume that NaN and infinity never occur (WGSL specification, section "Floating Point Evaluation"), and a device may
// flush denormals to zero.

// Mask that removes the sign bit. If the remaining bits are read as an integer, a larger magnitude gives a larger integer. 0x7f800000 is infinity,
// and every larger integer is NaN.
const USABLE_MAGNITUDE: u32 = 0x7fffffffu;
// Bits of 1e30 and of 2^-126, the smallest positive number that is not denormal.
const USABLE_MOST: u32 = 0x7149f2cau;
const USABLE_LEAST: u32 = 0x00800000u;

// x, or 0 if it is NaN or beyond 1e30.
fn usable_1(x: f32) -> f32 {
    return select(0.0, x, (bitcast<u32>(x) & USABLE_MAGNITUDE) <= USABLE_MOST);
}

fn usable_2(x: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(0.0), x, (bitcast<vec2<u32>>(x) & vec2<u32>(USABLE_MAGNITUDE)) <= vec2<u32>(USABLE_MOST));
}

fn usable_3(x: vec3<f32>) -> vec3<f32> {
    return select(vec3<f32>(0.0), x, (bitcast<vec3<u32>>(x) & vec3<u32>(USABLE_MAGNITUDE)) <= vec3<u32>(USABLE_MOST));
}

fn usable_4(x: vec4<f32>) -> vec4<f32> {
    return select(vec4<f32>(0.0), x, (bitcast<vec4<u32>>(x) & vec4<u32>(USABLE_MAGNITUDE)) <= vec4<u32>(USABLE_MOST));
}

// Whether the magnitude of each component is at most `most`; false if a component is NaN.
fn usable_within_3(x: vec3<f32>, most: f32) -> bool {
    return all((bitcast<vec3<u32>>(x) & vec3<u32>(USABLE_MAGNITUDE)) <= vec3<u32>(bitcast<u32>(most)));
}

// x clamped to 0..=`most`; 0 if it is denormal or NaN.
fn usable_positive_1(x: f32, most: f32) -> f32 {
    let bits = bitcast<u32>(x);
    return select(0.0, min(x, most), bits >= USABLE_LEAST && bits <= 0x7f800000u);
}

fn usable_positive_2(x: vec2<f32>, most: f32) -> vec2<f32> {
    return vec2<f32>(usable_positive_1(x.x, most), usable_positive_1(x.y, most));
}

fn usable_positive_4(x: vec4<f32>, most: f32) -> vec4<f32> {
    return vec4<f32>(usable_positive_2(x.xy, most), usable_positive_2(x.zw, most));
}

// Whether x is not NaN; infinity counts as a number.
fn usable_number(x: f32) -> bool {
    return (bitcast<u32>(x) & USABLE_MAGNITUDE) <= 0x7f800000u;
}

// Whether |x| <= `most`; false if x is NaN.
fn usable_within_1(x: f32, most: f32) -> bool {
    return (bitcast<u32>(x) & USABLE_MAGNITUDE) <= bitcast<u32>(most);
}

// Unit vectors as points on the octahedron, which is unfolded to the square [-1, 1]². A point has two coordinates.
// Source: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), 2014.
// A code stores a point of the octahedron's square as two integers, one per coordinate. 8-bit codes use the 255 integers 0..=254, so that zero and
// the six axes are exact.

// Largest value of an 8-bit code before it is stored: codes are computed as -127..=127 and stored as 0..=254.
const OCTAHEDRAL_HALF: f32 = 127.0;
// The step of the codes, 1 / 127. Codes are multiplied by this f32, because 127 times this f32, rounded to f32, is exactly 1. A division by 127 need
// not be exact on a GPU.
const OCTAHEDRAL_STEP: f32 = 0.007874016;

// Unit vector along v; the z axis if v has no usable direction (if all components are at most 1e-30 in magnitude, or if one component is above 1e30
// in magnitude or NaN).
fn octahedral_unit(v: vec3<f32>) -> vec3<f32> {
    let size = max(max(abs(v.x), abs(v.y)), abs(v.z));
    if !(usable_within_3(v, 1e30) && size > 1e-30) {
        return vec3<f32>(0.0, 0.0, 1.0);
    }
    // The vector is scaled first, because squares of large or small components would leave the range of f32.
    let scaled = v / size;
    return scaled / sqrt(dot(scaled, scaled));
}

fn octahedral_sign(v: vec2<f32>) -> vec2<f32> {
    return select(vec2<f32>(-1.0), vec2<f32>(1.0), v >= vec2<f32>(0.0));
}

// Maps a direction to the square [-1, 1]². The vector may have any length. A vector without usable direction counts as the z axis.
fn octahedral_encode(n: vec3<f32>) -> vec2<f32> {
    let v = octahedral_unit(n);
    let flat = v.xy / (abs(v.x) + abs(v.y) + abs(v.z));
    if v.z < 0.0 {
        return (vec2<f32>(1.0) - abs(flat.yx)) * octahedral_sign(flat);
    }
    return flat;
}

// Maps a point of the square to a unit vector.
fn octahedral_decode(e: vec2<f32>) -> vec3<f32> {
    let inside = clamp(usable_2(e), vec2<f32>(-1.0), vec2<f32>(1.0));
    let z = 1.0 - abs(inside.x) - abs(inside.y);
    var flat = inside;
    if z < 0.0 {
        flat = (vec2<f32>(1.0) - abs(inside.yx)) * octahedral_sign(inside);
    }
    let v = vec3<f32>(flat, z);
    return v / sqrt(dot(v, v));
}

// In the next two functions, codes may have any number of bits: they are -half..=half with half = 2^(bits - 1) - 1. `step` is 1 / half, chosen so
// that half times `step`, rounded to f32, is exactly 1.

// The nearest code to each coordinate ("oct" in the survey).
fn octahedral_quantise(e: vec2<f32>, half: f32) -> vec2<f32> {
    return clamp(round(usable_2(e) * half), vec2<f32>(-half), vec2<f32>(half));
}

// Returns the code whose decoded direction is nearest to n, among the four codes around n ("oct-P" in the survey).
fn octahedral_encode_precise(n: vec3<f32>, half: f32, step: f32) -> vec2<f32> {
    let unit = octahedral_unit(n);
    let low = floor(octahedral_encode(unit) * half);
    var best = vec2<f32>(0.0);
    var best_error = 1e30;
    for (var i = 0u; i < 4u; i++) {
        let code = clamp(low + vec2<f32>(f32(i & 1u), f32(i >> 1u)), vec2<f32>(-half), vec2<f32>(half));
        // The squared distance gives the same order as the dot product, but it is precise at small angles.
        let difference = octahedral_decode(code * step) - unit;
        let error = dot(difference, difference);
        if error < best_error {
            best = code;
            best_error = error;
        }
    }
    return best;
}

fn octahedral_store8(code: vec2<f32>) -> vec2<f32> {
    return (code + OCTAHEDRAL_HALF) / 255.0;
}

// The values that two unorm8 channels store for a point of the square. For each coordinate e, the value is q / 255 with q = round(127 e) + 127.
fn octahedral_quantise8(e: vec2<f32>) -> vec2<f32> {
    return octahedral_store8(octahedral_quantise(e, OCTAHEDRAL_HALF));
}

// The point of the square [-1, 1]² that two unorm8 channels stand for.
fn octahedral_dequantise8(stored: vec2<f32>) -> vec2<f32> {
    let code = clamp(round(usable_2(stored) * 255.0) - OCTAHEDRAL_HALF, vec2<f32>(-OCTAHEDRAL_HALF), vec2<f32>(OCTAHEDRAL_HALF));
    return code * OCTAHEDRAL_STEP;
}

// The values that two unorm8 channels store for a direction, with the code that octahedral_encode_precise finds.
fn octahedral_encode8_precise(n: vec3<f32>) -> vec2<f32> {
    return octahedral_store8(octahedral_encode_precise(n, OCTAHEDRAL_HALF, OCTAHEDRAL_STEP));
}

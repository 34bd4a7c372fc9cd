// Two normals in 32 bits: the normal of a triangle's plane without its sign, and the 8 + 8 bit code of the shading normal, which is predicted from
// that plane. normal_pair.rs explains the encoding.
// fine  (bit 31 = 0): bits 30..10 = plane, lattice of 1016 steps | bits 9..5 and 4..0 = low bits of the two numbers of the code
// plain (bit 31 = 1): bits 30..16 = plane, lattice of 127 steps  | bits 15..8 and 7..0 = the two numbers of the code
// Octahedron: Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 3(2), 2014.

// Steps of the plane's lattice from the middle to the rim. The fine lattice has 8 times as many steps as a code of the shading normal; the plain
// lattice has equally many.
const NORMAL_PAIR_FINE: i32 = 1016;
const NORMAL_PAIR_PLAIN: i32 = 127;

struct NormalPair {
    plane: vec3<f32>,       // unit vector, z >= 0: the plane's normal or its opposite
    shading: vec2<i32>,     // code of the shading normal, 0..=254 each
}

// The upper half of the octahedron is the diamond |x| + |y| <= half. Its points are numbered without gaps, along one diagonal after the other.
fn normal_pair_pack_diamond(p: vec2<i32>, half: i32) -> u32 {
    // x + y and x - y have the same parity, and 2 half + 1 is odd. So the total is even, and the shift loses no bit.
    return u32((p.x + p.y + half) * (2 * half + 1) + (p.x - p.y + half)) >> 1u;
}

// The point with this index. Indices beyond the last one count as the last one.
fn normal_pair_unpack_diamond(index: u32, half: i32) -> vec2<i32> {
    let last = u32(2 * half * half + 2 * half);
    let twice = 2 * i32(min(index, last));
    let width = 2 * half + 1;
    let sum = twice / width - half;
    let difference = twice % width - half;
    return vec2<i32>((sum + difference) / 2, (sum - difference) / 2);
}

// The unit vector of a point of the diamond. All numbers are whole before the root is taken, so that z on the rim is exactly 0.
fn normal_pair_direction(p: vec2<i32>, half: i32) -> vec3<f32> {
    let v = vec3<f32>(vec3<i32>(p, half - abs(p.x) - abs(p.y)));
    return v / sqrt(dot(v, v));
}

// Returns the lattice point nearest to the unit vector n (z >= 0). The candidates are those of the four points around n whose planes are seen along
// the ray from the same side as the plane with normal n.
fn normal_pair_nearest(n: vec3<f32>, ray: vec3<f32>, half: i32) -> vec2<i32> {
    let flat = octahedral_encode(n) * f32(half);
    let low = vec2<i32>(floor(flat));
    let along = dot(n, ray);
    var best = vec2<i32>(trunc(flat));
    var best_error = 1e30;
    for (var i = 0; i < 4; i++) {
        let p = low + vec2<i32>(i & 1, i >> 1u);
        if abs(p.x) + abs(p.y) > half {
            continue;
        }
        let decoded = normal_pair_direction(p, half);
        // Skips points whose decoded plane would be seen from the other side, because the derivatives would be reversed.
        if along != 0.0 && dot(decoded, ray) * along <= 0.0 {
            continue;
        }
        let difference = decoded - n;
        let error = dot(difference, difference);
        if error < best_error {
            best = p;
            best_error = error;
        }
    }
    return best;
}

// The predicted code of the shading normal: the code that the plane's own normal would have. p is the plane's point of the fine lattice, which has 8
// steps for each step of the code. Adding 4 before the division by 8 (a shift by 3 bits) rounds to the nearest code.
fn normal_pair_predict(p: vec2<i32>) -> vec2<i32> {
    return (p + NORMAL_PAIR_FINE + 4) >> vec2<u32>(3u);
}

// Encodes a plane and the code of a shading normal in a word. `plane` is a normal of the plane, of any length and either sign. `ray` leads from the
// eye to the plane. `shading` is a code as in NormalPair; larger codes count as 254.
fn normal_pair_encode(plane: vec3<f32>, ray: vec3<f32>, shading: vec2<i32>) -> u32 {
    let n = octahedral_unit(plane);
    let upper = select(n, -n, n.z < 0.0);
    let seen = octahedral_unit(ray);
    let fine = normal_pair_nearest(upper, seen, NORMAL_PAIR_FINE);
    let code = clamp(shading, vec2<i32>(0), vec2<i32>(254));
    let off = code - normal_pair_predict(fine);
    if all(off >= vec2<i32>(-16)) && all(off < vec2<i32>(16)) {
        return (normal_pair_pack_diamond(fine, NORMAL_PAIR_FINE) << 10u) | (u32(code.x & 31) << 5u) | u32(code.y & 31);
    }
    let plain = normal_pair_nearest(upper, seen, NORMAL_PAIR_PLAIN);
    return 0x80000000u | (normal_pair_pack_diamond(plain, NORMAL_PAIR_PLAIN) << 16u) | (u32(code.x) << 8u) | u32(code.y);
}

// Decodes a word. Every word gives a unit vector and a code.
fn normal_pair_decode(word: u32) -> NormalPair {
    if (word >> 31u) == 0u {
        let p = normal_pair_unpack_diamond(word >> 10u, NORMAL_PAIR_FINE);
        let predicted = normal_pair_predict(p);
        let low = vec2<i32>(vec2<u32>(word >> 5u, word) & vec2<u32>(31u));
        // The code whose five low bits are `low` and which differs from the prediction by -16..=15.
        let shading = predicted + ((low - predicted + 16) & vec2<i32>(31)) - 16;
        return NormalPair(normal_pair_direction(p, NORMAL_PAIR_FINE), clamp(shading, vec2<i32>(0), vec2<i32>(254)));
    }
    let p = normal_pair_unpack_diamond((word >> 16u) & 0x7fffu, NORMAL_PAIR_PLAIN);
    let shading = vec2<i32>(vec2<u32>(word >> 8u, word) & vec2<u32>(255u));
    return NormalPair(normal_pair_direction(p, NORMAL_PAIR_PLAIN), min(shading, vec2<i32>(254)));
}

// Integer hashes, bit-equal on every machine.
// Source: Jarzynski & Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.

// Hashes one word to one word: PCG-RXS-M-XS.
fn hash_pcg(v: u32) -> u32 {
    let state = v * 747796405u + 2891336453u;
    let word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Hashes four words to four words. Each result depends on all four inputs.
fn hash_pcg4d(v: vec4<u32>) -> vec4<u32> {
    var h = v * 1664525u + 1013904223u;
    h.x += h.y * h.w;
    h.y += h.z * h.x;
    h.z += h.x * h.y;
    h.w += h.y * h.z;
    h ^= h >> vec4<u32>(16u);
    h.x += h.y * h.w;
    h.y += h.z * h.x;
    h.z += h.x * h.y;
    h.w += h.y * h.z;
    return h;
}

// Converts a hash to a uniform number in [0, 1): its 24 high bits, which f32 holds exactly.
fn hash_to_unit(h: u32) -> f32 {
    return f32(h >> 8u) * 5.9604644775390625e-8;
}

// Mixes three parameters into one word, so that a hash of four words has three words left for the coordinates of a cell.
// The hashes are chained, not added or xored, so that neighbouring seeds, salts and levels do not cancel each other.
fn hash_mix(seed: u32, salt: u32, level: u32) -> u32 {
    return hash_pcg(level + hash_pcg(salt + hash_pcg(seed)));
}

// A pixel of a measured sequence, packed into two words: a colour as f16, and the number of texture fetches and the first random choice that the
// shading pass recorded. Word 0 stores red and green. From the lowest bit up, word 1 stores 16 bits of blue, the number of fetches, the first random
// choice (zero if there was none), and a bit that marks terrain.

// SIGNAL_FETCH_BITS, SIGNAL_CHOICE_BITS: numbers of bits for the number of fetches and for the choice. SIGNAL_TERRAIN: the bit of the second word
// that marks terrain. SIGNAL_INVALID_0, SIGNAL_INVALID_1: the words of a pixel whose colour is not finite. SIGNAL_LARGEST: the largest colour value
// that f16 can hold. SIGNAL_RED, SIGNAL_GREEN, SIGNAL_BLUE: weights of luminance.
const SIGNAL_CHOICE_FROM: u32 = 16u + SIGNAL_FETCH_BITS;

// Packs a terrain pixel. If the colour is not finite, returns the words of an invalid pixel, in which the terrain bit is not set.
fn signal_pack(colour: vec3<f32>, fetches: u32, choice: u32) -> vec2<u32> {
    let held = clamp(colour, vec3<f32>(-SIGNAL_LARGEST), vec3<f32>(SIGNAL_LARGEST));
    var second = pack2x16float(vec2<f32>(held.b, 0.0)) & 0xffffu;
    second |= min(fetches, (1u << SIGNAL_FETCH_BITS) - 1u) << 16u;
    second |= min(choice, (1u << SIGNAL_CHOICE_BITS) - 1u) << SIGNAL_CHOICE_FROM;
    let finite = all((bitcast<vec3<u32>>(colour) & vec3<u32>(USABLE_MAGNITUDE)) < vec3<u32>(0x7f800000u));
    return select(vec2<u32>(SIGNAL_INVALID_0, SIGNAL_INVALID_1), vec2<u32>(pack2x16float(held.rg), second | SIGNAL_TERRAIN), finite);
}

fn signal_is_invalid(signal: vec2<u32>) -> bool {
    return signal.x == SIGNAL_INVALID_0 && signal.y == SIGNAL_INVALID_1;
}

fn signal_is_terrain(signal: vec2<u32>) -> bool {
    return signal.y >= SIGNAL_TERRAIN;
}

fn signal_colour(signal: vec2<u32>) -> vec3<f32> {
    return vec3<f32>(unpack2x16float(signal.x), unpack2x16float(signal.y & 0xffffu).x);
}

fn signal_fetches(signal: vec2<u32>) -> u32 {
    return extractBits(signal.y, 16u, SIGNAL_FETCH_BITS);
}

fn signal_choice(signal: vec2<u32>) -> u32 {
    return extractBits(signal.y, SIGNAL_CHOICE_FROM, SIGNAL_CHOICE_BITS);
}

// Returns a packed terrain pixel with a different colour.
fn signal_recolour(signal: vec2<u32>, colour: vec3<f32>) -> vec2<u32> {
    return signal_pack(colour, signal_fetches(signal), signal_choice(signal));
}

// Relative luminance of linear colour, or luma of sRGB-encoded colour: the weights of Rec. ITU-R BT.709.
fn signal_luminance(colour: vec3<f32>) -> f32 {
    return dot(colour, vec3<f32>(SIGNAL_RED, SIGNAL_GREEN, SIGNAL_BLUE));
}

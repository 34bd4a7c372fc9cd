// Diagnostics that shading records for a pixel: counted fetches, first random choice and tile mask, packed into 32 bits.

fn diagnostics_pack(fetches: u32, choice: u32, mask: u32) -> u32 {
    return fetches | (choice << DIAGNOSTICS_FETCH_BITS) | (mask << (DIAGNOSTICS_FETCH_BITS + DIAGNOSTICS_CHOICE_BITS));
}

fn diagnostics_fetches(word: u32) -> u32 {
    return extractBits(word, 0u, DIAGNOSTICS_FETCH_BITS);
}

fn diagnostics_choice(word: u32) -> u32 {
    return extractBits(word, DIAGNOSTICS_FETCH_BITS, DIAGNOSTICS_CHOICE_BITS);
}

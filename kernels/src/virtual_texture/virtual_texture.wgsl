// Virtual-texture addresses: the page of a position, and the level that a footprint requires.

// The page table of each level has VIRTUAL_WINDOW x VIRTUAL_WINDOW cells. A page uses the cell at its column and row modulo VIRTUAL_WINDOW,
// which is 64.

struct VirtualAddress {
    page: vec2<i32>,            // column and row of the page at its level, from the world's south-west corner
    uv: vec2<f32>,              // position inside the page without its border, 0..1
}

// Returns the level that a footprint requires. `offset`, in levels, is added before the level is rounded down.
fn virtual_texture_level(ddx: vec3<f32>, ddy: vec3<f32>, offset: f32) -> u32 {
    let across = length(ddx.xy);
    let down = length(ddy.xy);
    let texels = max(min(across, down), max(across, down) / frame.page_anisotropy) * frame.page_texels_per_m * frame.gradient_scale;
    let level = floor(max(log2(max(texels, 1.0)) + offset, 0.0));
    return min(u32(level), frame.page_levels - 1u);
}

fn virtual_texture_address(place: Place, level: u32) -> VirtualAddress {
    let pages_per_m = frame.page_texels_per_m / VIRTUAL_PAGE_TEXELS;
    let pages_per_sector = i32(round(frame.sector_m * pages_per_m));
    let in_sector = place.position.xy * pages_per_m;
    let whole = floor(in_sector);
    // Page numbers below 0 are raised to 0, because rounding may move a position on the southern or western border of the world slightly out of the
    // world.
    let finest = max(place.sector * pages_per_sector + vec2<i32>(whole), vec2<i32>(0));
    let span = 1 << level;
    let uv = (vec2<f32>(finest & vec2<i32>(span - 1)) + (in_sector - whole)) / f32(span);
    return VirtualAddress(finest >> vec2<u32>(level), uv);
}

// Tag of a page in its cell of the page table. Pages whose columns and rows differ by multiples of 64 share a cell; the tag distinguishes them.
fn virtual_texture_tag(page: vec2<i32>) -> u32 {
    let wrap = vec2<u32>(page >> vec2<u32>(VIRTUAL_WINDOW_BITS)) & vec2<u32>(VIRTUAL_TAG_MASK);
    return (wrap.y << (VIRTUAL_LAYER_BITS + VIRTUAL_TAG_BITS)) | (wrap.x << VIRTUAL_LAYER_BITS);
}

// An entry of a tile list: column and row of the tile, with TILE_ROW_SHIFT bits each, and its mask.

fn tile_entry(tile: vec2<u32>, mask: u32) -> u32 {
    return tile.x | (tile.y << TILE_ROW_SHIFT) | (mask << TILE_MASK_SHIFT);
}

fn tile_place(entry: u32) -> vec2<u32> {
    let coordinate = (1u << TILE_ROW_SHIFT) - 1u;
    return vec2<u32>(entry & coordinate, (entry >> TILE_ROW_SHIFT) & coordinate);
}

fn tile_variant(entry: u32) -> u32 {
    return entry >> TILE_MASK_SHIFT;
}

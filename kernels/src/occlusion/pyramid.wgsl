// The depth pyramid: each texel of a level holds the least of the reversed depths in 2 x 2 texels of the level below. The least reversed depth is
// that of the farthest surface. The texels of level 0 are the pixels of the depth target. The buffer holds the levels from 1 up, each row by row.

// Index of a texel in the buffer. `size`: size of the picture, pixels. `level`: from 1.
fn occlusion_index(size: vec2<u32>, level: u32, texel: vec2<u32>) -> u32 {
    var start = 0u;
    for (var below = 1u; below < level; below++) {
        let extent = culling_level_size(size, below);
        start += extent.x * extent.y;
    }
    return start + texel.y * culling_level_size(size, level).x + texel.x;
}

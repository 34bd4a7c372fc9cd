// Classification: the variant of a tile is the OR of the masks of its pixels, which have one bit for each flavour (way to shade). Each tile with
// terrain is appended to the list of its variant and to list 0. Lists 1 to 31 belong to the variants. List 0 is for the generic shader, which handles
// all variants. The entry point, which computes the OR, is in plain.wgsl (workgroup atomics) or in subgroup.wgsl (subgroup operations). The two files
// compute the same masks.

// Edge length of a tile, pixels. One workgroup per tile, one invocation per pixel.
override TILE: u32 = 8u;

struct DrawArguments {
    vertex_count: u32,
    instance_count: atomic<u32>,
    first_vertex: u32,
    first_instance: u32,
}

@group(1) @binding(0) var mask_target: texture_2d<u32>;
@group(1) @binding(1) var stencil_target: texture_2d<u32>;
@group(1) @binding(2) var<storage, read_write> tile_lists: array<u32>;
@group(1) @binding(3) var<storage, read_write> arguments: array<DrawArguments, 32>;

fn classification_pixel_mask(pixel: vec2<u32>) -> u32 {
    if any(pixel >= frame.size) || textureLoad(stencil_target, pixel, 0).r == 0u {
        return 0u;
    }
    if frame.forced_mask != 0u {
        return frame.forced_mask;
    }
    return textureLoad(mask_target, pixel, 0).r;
}

fn classification_append(tile: vec2<u32>, mask: u32) {
    if mask == 0u {
        return;
    }
    let entry = tile_entry(tile, mask);
    let capacity = frame.tiles.x * frame.tiles.y;
    tile_lists[mask * capacity + atomicAdd(&arguments[mask].instance_count, 1u)] = entry;
    tile_lists[atomicAdd(&arguments[0].instance_count, 1u)] = entry;
}

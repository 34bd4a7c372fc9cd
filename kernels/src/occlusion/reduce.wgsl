// Makes three levels of the depth pyramid from the level below them. One invocation makes one texel of the third level, and the texels of the other
// two levels that lie in it. So no barrier is needed.

@group(1) @binding(0) var depth_target: texture_depth_2d;
// The level that is read; 0 = the depth target.
@group(1) @binding(1) var<storage, read> occlusion_from: u32;
@group(1) @binding(2) var<storage, read_write> pyramid: array<f32>;

// The depth in a texel of the level that is read. Texels outside the level have depth 1, the nearest depth, which changes no minimum.
fn occlusion_depth(texel: vec2<u32>) -> f32 {
    if any(texel >= culling_level_size(frame.size, occlusion_from)) {
        return 1.0;
    }
    if occlusion_from == 0u {
        return textureLoad(depth_target, texel, 0);
    }
    return pyramid[occlusion_index(frame.size, occlusion_from, texel)];
}

fn occlusion_store(level: u32, texel: vec2<u32>, depth: f32) {
    if all(texel < culling_level_size(frame.size, level)) {
        pyramid[occlusion_index(frame.size, level, texel)] = depth;
    }
}

// One of the 2 x 2 texels of the level below that `texel` covers. `number`: 0..=3, row by row.
fn occlusion_child(texel: vec2<u32>, number: u32) -> vec2<u32> {
    return 2u * texel + vec2<u32>(number & 1u, number >> 1u);
}

@compute @workgroup_size(8, 8)
fn occlusion_reduce(@builtin(global_invocation_id) id: vec3<u32>) {
    let third = id.xy;
    if any(third >= culling_level_size(frame.size, occlusion_from + 3u)) {
        return;
    }
    var least_3 = 1.0;
    for (var i = 0u; i < 4u; i++) {
        let second = occlusion_child(third, i);
        var least_2 = 1.0;
        for (var j = 0u; j < 4u; j++) {
            let first = occlusion_child(second, j);
            var least_1 = 1.0;
            for (var k = 0u; k < 4u; k++) {
                least_1 = min(least_1, occlusion_depth(occlusion_child(first, k)));
            }
            occlusion_store(occlusion_from + 1u, first, least_1);
            least_2 = min(least_2, least_1);
        }
        occlusion_store(occlusion_from + 2u, second, least_2);
        least_3 = min(least_3, least_2);
    }
    occlusion_store(occlusion_from + 3u, third, least_3);
}

// Shading: draws the tiles of one variant into the G-buffer. Override constants specialise one module into 31 variants and the generic kernel.

struct ShadingVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) mask: u32,
}

fn shading_ndc(pixel: vec2<f32>) -> vec2<f32> {
    return (pixel / vec2<f32>(frame.size) * 2.0 - 1.0) * vec2<f32>(1.0, -1.0);
}

@vertex
fn shading_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> ShadingVarying {
    let entry = tile_lists[VARIANT * frame.tiles.x * frame.tiles.y + instance];
    let tile = tile_place(entry);
    let tile_pixel = vec2<f32>(tile * TILE);
    if ONE_TRIANGLE {
        // The left and right sides of the triangle converge and meet far below the tile. In the first row of pixels, at the height of the pixel
        // centres, the sides are 3/8 of a pixel outside the tile. In the last row, they are 3/8 of a pixel inside the tile. The outermost pixel
        // centres of the tile are half a pixel inside it, and those of the neighbouring tiles half a pixel outside it. So in the rows of the tile,
        // the triangle includes exactly the pixel centres of the tile.
        let edge = f32(TILE);
        let outside = 0.375 * edge / (edge - 1.0);
        let apex = vec2<f32>(0.5 * edge, 0.5 * edge * ((edge - 1.0) * 4.0 / 3.0 + 1.0));
        var triangle = array<vec2<f32>, 3>(vec2<f32>(-outside, 0.0), vec2<f32>(edge + outside, 0.0), apex);
        let at = triangle[vertex];
        // Depth is clamped and not clipped. At the pixel centres of the tile, it is 0, which is behind all terrain, so the depth test (less) passes.
        // At all pixel centres below the tile, it is 1, so the test fails.
        return ShadingVarying(vec4<f32>(shading_ndc(tile_pixel + at), (at.y - edge + 0.25) * 4.0, 1.0), tile_variant(entry));
    }
    var corners = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u);
    let corner = corners[vertex];
    let at = vec2<f32>(vec2<u32>(corner & 1u, corner >> 1u) * TILE);
    return ShadingVarying(vec4<f32>(shading_ndc(tile_pixel + at), 0.0, 1.0), tile_variant(entry));
}

struct GBuffer {
    @location(0) albedo: vec4<f32>,         // linear rgb, specular occlusion
    @location(1) normal: vec4<f32>,         // world normal, smoothness
}

fn shade(index: vec2<u32>, tile_mask: u32) -> GBuffer {
    var mask = VARIANT;
    if VARIANT == 0u {
        mask = tile_mask;
    }
    let depth = textureLoad(depth_target, index, 0);
    let normals = textureLoad(normal_target, index, 0);
    var pixel: Pixel;
    pixel.index = index;
    pixel.footprint = surface_footprint(index, depth, normals);
    pixel.node = terrain_node(pixel.footprint.place);
    pixel.cell = terrain_splat_cell(pixel.node);
    pixel.normal = frame_shading_normal(normals);
    if PROJECTS {
        shade_project(&pixel);
    }

    let distance = length(frame_ray(vec2<f32>(index))) * view_distance(frame.near_m, depth);
    let all = flavour_weights(distance, pixel.normal.z, frame.flavours);
    let weights = flavour_weights_for(all, mask, select(0u, 1u, frame.forced_mask != 0u));
    pixel.tiling = tiling_scales(distance, frame.flavours.cliff_near_m, flavour_steep(pixel.normal.z, frame.flavours.cliff_cos));

    if ESTIMATOR == ESTIMATOR_VARIANCE {
        let variance = shade_variance(pixel, mask, weights);
        return GBuffer(vec4<f32>(variance.albedo, 0.0), vec4<f32>(variance.normal, 0.0));
    }
    let s = shade_surface(pixel, mask, weights);
    return GBuffer(vec4<f32>(s.albedo, s.occlusion), vec4<f32>(octahedral_unit(s.normal), s.smoothness));
}

@fragment
fn shading_fragment(in: ShadingVarying) -> GBuffer {
    return shade(vec2<u32>(in.clip.xy), in.mask);
}

struct GBufferCounted {
    @location(0) albedo: vec4<f32>,
    @location(1) normal: vec4<f32>,
    @location(2) diagnostics: u32,          // packed by diagnostics_pack
}

@fragment
fn shading_fragment_counted(in: ShadingVarying) -> GBufferCounted {
    fetch_count = 0u;
    choice = 0u;
    let g = shade(vec2<u32>(in.clip.xy), in.mask);
    return GBufferCounted(g.albedo, g.normal, diagnostics_pack(fetch_count, choice, in.mask));
}

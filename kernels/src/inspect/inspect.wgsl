// Writes the values that the shading pass derives from each pixel of the geometry pass. The layers `position`, `ddx` and `ddy` are made from these
// values, the workbench's inspector shows them, and tests check them.

@group(2) @binding(0) var depth_target: texture_depth_2d;
@group(2) @binding(1) var normal_target: texture_2d<f32>;
@group(2) @binding(2) var<storage, read_write> inspected: array<Inspected>;
// A dispatch covers a band of rows. x: the first row of the band; y: the row after the last row of the band.
@group(2) @binding(3) var<uniform> band: vec4<u32>;

struct Inspected {
    position: vec3<f32>,        // x, y: metres from the south-west corner of the camera's sector; z: elevation
    slot: u32,                  // atlas slot of the finest loaded node at the position
    ddx: vec3<f32>,
    corner: u32,                // south-western of the four splat texels around the pixel: x | y << 16
    ddy: vec3<f32>,
    plane: u32,                 // axis of the projection with the largest weight
    splat: vec4<u32>,           // palette indices of the four texels
    bilinear: vec4<f32>,        // bilinear weights of the four texels
    blended: vec4<f32>,         // weights of the four texels after the height blend, which uses material heights in the projection `plane`
}

@compute @workgroup_size(8, 8)
fn inspect_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = vec2<u32>(id.x, id.y + band.x);
    if pixel.x >= frame.size.x || pixel.y >= band.y {
        return;
    }
    var out: Inspected;
    let depth = textureLoad(depth_target, pixel, 0);
    if depth > 0.0 {
        let normals = textureLoad(normal_target, pixel, 0);
        let footprint = surface_footprint(pixel, depth, normals);
        let node = terrain_node(footprint.place);
        let cell = terrain_splat_cell(node);
        let place = footprint.place;
        out.position = vec3<f32>(vec2<f32>(place.sector - frame.camera_sector) * frame.sector_m + place.position.xy, place.position.z);
        out.slot = node.slot;
        out.ddx = footprint.ddx;
        out.corner = u32(cell.corner.x) | (u32(cell.corner.y) << 16u);
        out.ddy = footprint.ddy;
        out.splat = vec4<u32>(terrain_splat_id(cell, 0u), terrain_splat_id(cell, 1u), terrain_splat_id(cell, 2u), terrain_splat_id(cell, 3u));
        out.bilinear = splat_blend_bilinear(cell.fraction);
        let size = abs(frame_shading_normal(normals));
        out.plane = select(select(0u, 1u, size.y > size.x), 2u, size.z >= max(size.x, size.y));
        let projection = terrain_projection(out.plane, footprint);
        var heights: vec4<f32>;
        for (var i = 0u; i < frame.taps; i++) {
            heights[i] = terrain_tap(cell, i, projection, 0u).height;
        }
        out.blended = splat_blend_weights(cell.fraction, heights, frame.height_sharpness);
    }
    inspected[(pixel.y - band.x) * frame.size.x + pixel.x] = out;
}

// Marks the pages that the visible pixels of this frame would sample if all pages were cached.

@group(2) @binding(0) var depth_target: texture_depth_2d;
@group(2) @binding(1) var normal_target: texture_2d<f32>;
@group(2) @binding(2) var mask_target: texture_2d<u32>;
@group(2) @binding(3) var<storage, read_write> requests: array<atomic<u32>>;

@compute @workgroup_size(8, 8)
fn virtual_texture_request(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= frame.size) {
        return;
    }
    let depth = textureLoad(depth_target, id.xy, 0);
    if depth <= 0.0 {
        return;
    }
    var mask = textureLoad(mask_target, id.xy, 0).r;
    if frame.forced_mask != 0u {
        mask = frame.forced_mask;
    }
    if !flavour_is_in(mask, FLAVOUR_VT_BIT) {
        return;
    }
    let footprint = surface_footprint(id.xy, depth, textureLoad(normal_target, id.xy, 0));
    // The shading pass computes the level again, in another pipeline, and may round differently at the border between two levels. So near such
    // a border, both levels are requested.
    let low = virtual_texture_level(footprint.ddx, footprint.ddy, -0.001);
    let high = virtual_texture_level(footprint.ddx, footprint.ddy, 0.001);
    virtual_texture_mark(footprint.place, low);
    if high != low {
        virtual_texture_mark(footprint.place, high);
    }
}

fn virtual_texture_mark(place: Place, level: u32) {
    let page = virtual_texture_address(place, level).page;
    let cell = page & vec2<i32>(VIRTUAL_WINDOW - 1);
    let index = (level * u32(VIRTUAL_WINDOW) + u32(cell.y)) * u32(VIRTUAL_WINDOW) + u32(cell.x);
    // Requested pages whose columns and rows differ by multiples of 64 share a cell. The page with the larger tag is kept, so the result
    // does not depend on the order of threads. Bit 0 is set, so that a request is not 0 even if the tag is 0.
    atomicMax(&requests[index], virtual_texture_tag(page) | 1u);
}

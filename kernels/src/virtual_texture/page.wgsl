// Renders one mip level of one page of the virtual texture from the splat map, seen from above, at tiling scale 0.

struct PageJob {
    sector: vec2<i32>,          // sector of the page's south-west corner
    origin: vec2<f32>,          // position of that corner in the sector, metres
    texel_m: f32,               // edge of a texel of this mip level, metres
    border: f32,                // texels of border on each side, at this mip level
}

@group(2) @binding(0) var<storage, read> jobs: array<PageJob>;

struct PageVarying {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) job: u32,
}

@vertex
fn page_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) job: u32) -> PageVarying {
    return PageVarying(full_screen_position(vertex), job);
}

struct PageTargets {
    @location(0) albedo: vec4<f32>,
    @location(1) properties: vec2<f32>,
    @location(2) normal: vec2<f32>,
}

@fragment
fn page_fragment(in: PageVarying) -> PageTargets {
    let job = jobs[in.job];
    // Row 0 of a page is its southern edge.
    let local = job.origin + (in.clip.xy - job.border) * job.texel_m;
    let place = terrain_place(job.sector, vec3<f32>(local, 0.0));
    // The factor of the mip bias is applied when pages are sampled. Dividing by it here cancels the factor that terrain_projection applies,
    // so that it is not applied twice.
    let step = job.texel_m / frame.gradient_scale;
    let footprint = Footprint(place, vec3<f32>(step, 0.0, 0.0), vec3<f32>(0.0, step, 0.0));
    let node = terrain_node(place);
    let surface = terrain_splat_blend(terrain_splat_cell(node), terrain_projection(2u, footprint), 0u);
    let normal = normalize(vec3<f32>(-surface.gradient.xy, 1.0));
    return PageTargets(
        vec4<f32>(surface.albedo * terrain_colour_modulation(node), 1.0),
        vec2<f32>(surface.smoothness, surface.specular_occlusion),
        normal.xy * 0.5 + 0.5,
    );
}

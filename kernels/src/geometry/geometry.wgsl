// Geometry pass: draws patches into depth, stencil, classification mask and two normals.

// Whether the scene has holes. If not, the fetch and the discard for holes are compiled out.
override HAS_HOLES: bool = false;
// Whether the ground may end inside the world, at the edge of a heightmap. If not, the move of vertices to this edge is compiled out.
override HAS_EDGE: bool = false;

struct Patch {
    node_origin: vec2<f32>,     // south-west corner of the node in local coordinates, metres
    spacing: f32,               // metres between neighbouring vertices of the node at vertex stride 1
    slot: u32,
    patch_xy: vec2<u32>,        // column, row in the node's 8 x 8 patches
    deltas: u32,                // LOD deltas of the sides, 4 bits each: north << 12 | east << 8 | south << 4 | west
    lod: u32,
}

@group(2) @binding(0) var<storage, read> patches: array<Patch>;
// For each instance of a draw, the index of its patch in `patches`.
@group(2) @binding(1) var<storage, read> order: array<u32>;

struct GeometryVarying {
    @builtin(position) clip: vec4<f32>,
    // Position relative to the camera, metres. The fragment shader computes the derivatives of this position, which are small differences. Elevations
    // above sea level would be too coarse for that: in f32, an elevation of some kilometres is precise only to tenths of a millimetre.
    @location(0) relative: vec3<f32>,
    @location(1) node_uv: vec2<f32>,
    @location(2) @interpolate(flat) slot: u32,
    @location(3) hole: f32,
}

@vertex
fn geometry_vertex(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> GeometryVarying {
    let p = patches[order[instance]];
    let in_patch = vec2<u32>(vertex % (GEOMETRY_PATCH_QUADS + 1u), vertex / (GEOMETRY_PATCH_QUADS + 1u));
    let first = p.patch_xy * GEOMETRY_PATCH_QUADS;
    let index = geometry_stitch(first + in_patch, first, GEOMETRY_PATCH_QUADS, p.deltas);
    let height = textureLoad(height_atlas, index, p.slot, 0).r;
    let at = p.node_origin + vec2<f32>(index) * p.spacing;
    var drawn = at;
    var in_node = vec2<f32>(index);
    if HAS_EDGE {
        // A vertex beyond the data is drawn at the nearest point of the data; the atlas stores the height of that point for the vertex. Nodes on both
        // sides of a border move their common vertices to the same place, because the move comes after stitching and depends only on the position.
        // Triangles beyond the data usually collapse to zero area. Stitching can pull vertices of such a triangle into the data; the triangle then
        // closes the gap to a coarser node.
        drawn = clamp(at, frame.data_low, frame.data_high);
        in_node += (drawn - at) / p.spacing;
    }
    let local = vec3<f32>(drawn, frame.height_low_m + height * frame.height_span_m);
    var out: GeometryVarying;
    out.clip = frame.clip_from_local * vec4<f32>(local, 1.0);
    out.relative = local - frame.camera;
    out.node_uv = in_node / f32(GEOMETRY_NODE_QUADS);
    out.slot = p.slot;
    out.hole = 0.0;
    if HAS_HOLES && textureLoad(albedo_atlas, index + 2u, p.slot, 0).a < 0.5 {
        out.hole = 1.0;
    }
    return out;
}

struct GeometryTargets {
    @location(0) mask: u32,
    @location(1) normals: vec4<f32>,
}

@fragment
fn geometry_fragment(in: GeometryVarying) -> GeometryTargets {
    // A triangle has the same slope at all of its pixels, so derivatives of the position give its plane.
    let across = dpdx(in.relative);
    let down = dpdy(in.relative);
    // `hole` is interpolated, so a triangle that has a vertex in a hole has hole > 0 everywhere inside.
    if HAS_HOLES && in.hole > 0.0 {
        discard;
    }
    let shading_normal = terrain_normal(in.slot, in.node_uv).normal;
    let crossed = cross(down, across);
    let area = length(crossed);
    var triangle_normal = shading_normal;
    if area > 0.0 {
        triangle_normal = crossed / area;
        if dot(triangle_normal, in.relative) > 0.0 {
            triangle_normal = -triangle_normal;
        }
    }
    var out: GeometryTargets;
    out.normals = frame_normals(shading_normal, triangle_normal, in.relative);
    // Weights are computed from the stored normal, which the shading pass reads back, so that mask and shading agree.
    let seen_normal = frame_shading_normal(out.normals);
    let weights = flavour_weights(length(in.relative), seen_normal.z, frame.flavours);
    out.mask = flavour_mask(weights);
    return out;
}

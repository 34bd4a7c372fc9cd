// Uniforms that the stages of a frame share: the camera, the flavour rules, the blend, the light. Local coordinates: x, y in metres from the
// south-west corner of the camera's sector, z = elevation in metres.

struct Frame {
    clip_from_local: mat4x4<f32>,
    camera: vec3<f32>,          // position of the camera in local coordinates
    sector_m: f32,              // edge of a sector, metres
    ray_00: vec3<f32>,          // ray through the sample point (usually the centre) of pixel (0, 0); its component along the view direction is 1
    near_m: f32,                // distance of the near plane; the stored depth is near_m / distance along the view direction
    ray_dx: vec3<f32>,          // step of the ray per pixel to the right
    height_low_m: f32,          // elevation of the stored height 0, metres
    ray_dy: vec3<f32>,          // step of the ray per pixel down
    height_span_m: f32,         // elevation of the stored height 1 minus that of 0, metres
    camera_sector: vec2<i32>,   // sector of the camera, counted from the world's south-west corner
    size: vec2<u32>,            // size of the image, pixels
    seed: u32,
    frame: u32,                 // frame index
    forced_mask: u32,           // 0 = automatic choice, otherwise the variant that is forced on every tile
    page_levels: u32,           // number of levels of the virtual texture
    tiles: vec2<u32>,           // size of the image in tiles, rounded up
    hash_scale: f32,            // cell size of hashed noise, pixels
    height_sharpness: f32,      // k in the height blend w 2^(k h), see splat_blend.wgsl
    triplanar_sharpness: f32,   // k in the weights |n|^k, see triplanar.wgsl
    gradient_scale: f32,        // factor on texture gradients, 2^(mip bias)
    page_texels_per_m: f32,     // texel density of virtual-texture level 0
    page_anisotropy: f32,       // largest ratio of the two axes of a footprint that page filtering covers, 1..4
    flavours: FlavourParams,
    sun_direction: vec3<f32>,   // towards the sun
    taps: u32,                  // always 4, the number of splat texels around a point; see terrain.wgsl
    sun_irradiance: vec3<f32>,  // irradiance on a surface that faces the sun
    noise_world_level: i32,     // log2 of cells per metre of world-space white noise
    sky_zenith: vec3<f32>,      // radiance
    sample_pattern: u32,        // where each pixel is sampled: 0 = centre, 1 = left edge, 2 = top edge; see footprint.wgsl
    sky_horizon: vec3<f32>,     // radiance
    normals: u32,               // how the geometry pass stores its two normals: NORMALS_...
    data_low: vec2<f32>,        // south-west corner of the data (of the world, if it is procedural) in local coordinates
    data_high: vec2<f32>,       // north-east corner of the data (of the world, if it is procedural) in local coordinates
}

// Encodings of the two normals that the geometry pass stores for a pixel: the shading normal and the normal of the triangle's plane.
// NORMALS_OCTAHEDRAL: two octahedral encodings of 8 + 8 bits. NORMALS_PLANE_FIRST: the normal of the plane, and the shading normal relative to it,
// see normal_pair.wgsl. NORMALS_EXACT: two octahedral encodings in f32, without rounding to integers.

@group(0) @binding(0) var<uniform> frame: Frame;

// The texel in which the geometry pass stores its two normals. `ray` leads from the eye to the plane.
fn frame_normals(shading: vec3<f32>, plane: vec3<f32>, ray: vec3<f32>) -> vec4<f32> {
    if frame.normals == NORMALS_EXACT {
        return vec4<f32>(octahedral_encode(shading), octahedral_encode(plane));
    }
    let code = octahedral_encode8_precise(shading);
    if frame.normals == NORMALS_PLANE_FIRST {
        return unpack4x8unorm(normal_pair_encode(plane, ray, vec2<i32>(round(code * 255.0))));
    }
    return vec4<f32>(code, octahedral_encode8_precise(plane));
}

// Decodes the shading normal in a texel. NORMALS_OCTAHEDRAL and NORMALS_PLANE_FIRST give the same result, bit for bit.
fn frame_shading_normal(texel: vec4<f32>) -> vec3<f32> {
    if frame.normals == NORMALS_EXACT {
        return octahedral_decode(texel.xy);
    }
    var code = texel.xy;
    if frame.normals == NORMALS_PLANE_FIRST {
        code = vec2<f32>(normal_pair_decode(pack4x8unorm(texel)).shading) / 255.0;
    }
    return octahedral_decode(octahedral_dequantise8(code));
}

// Decodes the normal of the triangle's plane in a texel. With NORMALS_PLANE_FIRST, the result may be the opposite normal, because this encoding does
// not store the side of a plane.
fn frame_plane(texel: vec4<f32>) -> vec3<f32> {
    if frame.normals == NORMALS_EXACT {
        return octahedral_decode(texel.zw);
    }
    if frame.normals == NORMALS_PLANE_FIRST {
        return normal_pair_decode(pack4x8unorm(texel)).plane;
    }
    return octahedral_decode(octahedral_dequantise8(texel.zw));
}

fn frame_ray(pixel: vec2<f32>) -> vec3<f32> {
    return view_ray(frame.ray_00, frame.ray_dx, frame.ray_dy, pixel);
}

// Composition: computes the picture of any set of flavours from the G-buffers of single flavours. The G-buffer of a set is a weighted sum of the
// G-buffers of its flavours; only the normal must be normalised after the sum. The weights of a pixel follow from its distance, its normal and the
// set. So 31 variants cost five shading passes and 31 weighted sums instead of 31 shading passes.

struct CompositionStream {
    mask: u32,              // the variant forced on every tile; 0 = each pixel has the flavours that it needs
    modulated: u32,         // 1 = the scene has a colour modulation map. Each flavour but vt counts a fetch of it; the composed count includes one
    squared: u32,           // 1 = weights are squared, because variances of independent flavours add with squared weights
    lit: u32,               // 1 = the picture is lit and mapped to the display; 0 = it is linear albedo
}

@group(1) @binding(0) var depth_target: texture_depth_2d;
@group(1) @binding(1) var normal_target: texture_2d<f32>;
@group(1) @binding(2) var albedo_0: texture_2d<f32>;
@group(1) @binding(3) var albedo_1: texture_2d<f32>;
@group(1) @binding(4) var albedo_2: texture_2d<f32>;
@group(1) @binding(5) var albedo_3: texture_2d<f32>;
@group(1) @binding(6) var albedo_4: texture_2d<f32>;
@group(1) @binding(7) var diagnostics_0: texture_2d<u32>;
@group(1) @binding(8) var diagnostics_1: texture_2d<u32>;
@group(1) @binding(9) var diagnostics_2: texture_2d<u32>;
@group(1) @binding(10) var diagnostics_3: texture_2d<u32>;
@group(1) @binding(11) var diagnostics_4: texture_2d<u32>;
@group(1) @binding(12) var normal_0: texture_2d<f32>;
@group(1) @binding(13) var normal_1: texture_2d<f32>;
@group(1) @binding(14) var normal_2: texture_2d<f32>;
@group(1) @binding(15) var normal_3: texture_2d<f32>;
@group(1) @binding(16) var normal_4: texture_2d<f32>;
@group(2) @binding(0) var<storage, read> streams: array<CompositionStream>;
// One picture per stream, in the order of `streams`.
@group(2) @binding(1) var<storage, read_write> signal: array<vec2<u32>>;
// How lit pictures are mapped to the display.
@group(2) @binding(2) var<uniform> shown: DisplayUniforms;

// Linear albedo, and specular occlusion.
fn composition_albedo(flavour: u32, pixel: vec2<u32>) -> vec4<f32> {
    switch flavour {
        case 0u: { return textureLoad(albedo_0, pixel, 0); }
        case 1u: { return textureLoad(albedo_1, pixel, 0); }
        case 2u: { return textureLoad(albedo_2, pixel, 0); }
        case 3u: { return textureLoad(albedo_3, pixel, 0); }
        default: { return textureLoad(albedo_4, pixel, 0); }
    }
}

// Unit normal, and smoothness.
fn composition_normal(flavour: u32, pixel: vec2<u32>) -> vec4<f32> {
    switch flavour {
        case 0u: { return textureLoad(normal_0, pixel, 0); }
        case 1u: { return textureLoad(normal_1, pixel, 0); }
        case 2u: { return textureLoad(normal_2, pixel, 0); }
        case 3u: { return textureLoad(normal_3, pixel, 0); }
        default: { return textureLoad(normal_4, pixel, 0); }
    }
}

fn composition_diagnostics(flavour: u32, pixel: vec2<u32>) -> u32 {
    switch flavour {
        case 0u: { return textureLoad(diagnostics_0, pixel, 0).r; }
        case 1u: { return textureLoad(diagnostics_1, pixel, 0).r; }
        case 2u: { return textureLoad(diagnostics_2, pixel, 0).r; }
        case 3u: { return textureLoad(diagnostics_3, pixel, 0).r; }
        default: { return textureLoad(diagnostics_4, pixel, 0).r; }
    }
}

@compute @workgroup_size(8, 8)
fn composition_main(@builtin(global_invocation_id) id: vec3<u32>) {
    let pixel = id.xy;
    if any(pixel >= frame.size) {
        return;
    }
    let at = pixel.y * frame.size.x + pixel.x;
    let count = frame.size.x * frame.size.y;
    let depth = textureLoad(depth_target, pixel, 0);
    if depth <= 0.0 {
        // This pixel is sky. The buffer `signal` is new for each dispatch, so it holds 0 at this pixel.
        return;
    }
    // These weights equal those of the shading pass, because they are computed from the same depth and normal.
    let normal = frame_shading_normal(textureLoad(normal_target, pixel, 0));
    let ray = frame_ray(vec2<f32>(pixel));
    let distance = length(ray) * view_distance(frame.near_m, depth);
    let all = flavour_weights(distance, normal.z, frame.flavours);
    let own = flavour_mask(all);
    var albedos: array<vec4<f32>, 5>;
    var normals: array<vec4<f32>, 5>;
    var known: array<u32, 5>;
    for (var flavour = 0u; flavour < 5u; flavour++) {
        albedos[flavour] = composition_albedo(flavour, pixel);
        normals[flavour] = composition_normal(flavour, pixel);
        known[flavour] = composition_diagnostics(flavour, pixel);
    }
    for (var i = 0u; i < arrayLength(&streams); i++) {
        let stream = streams[i];
        let mask = select(stream.mask, own, stream.mask == 0u);
        let weights = flavour_weights_for(all, mask, select(0u, 1u, stream.mask != 0u));
        var albedo = vec4<f32>(0.0);
        var normal_smoothness = vec4<f32>(0.0);
        var fetches = 0u;
        var choice = 0u;
        var shared_fetches = 0u;
        for (var flavour = 0u; flavour < 5u; flavour++) {
            let w = weights[flavour];
            // The textures of a flavour outside the mask may be empty, or hold the values of another frame.
            if ((mask >> flavour) & 1u) == 0u || w <= 0.0 {
                continue;
            }
            albedo += select(w, w * w, stream.squared != 0u) * albedos[flavour];
            normal_smoothness += w * normals[flavour];
            fetches += diagnostics_fetches(known[flavour]);
            if flavour != FLAVOUR_VT {
                shared_fetches += stream.modulated;
            }
            // The picture keeps the first recorded choice, in the order in which the shading pass evaluates the flavours.
            if choice == 0u {
                choice = diagnostics_choice(known[flavour]);
            }
        }
        fetches -= max(shared_fetches, 1u) - 1u;
        var colour = albedo.rgb;
        if stream.lit != 0u {
            let surface = LightingSurface(albedo.rgb, albedo.a, octahedral_unit(normal_smoothness.xyz), normal_smoothness.w);
            let radiance = lighting_radiance(surface, normalize(ray));
            // A radiance that is not finite is stored unencoded, so that the pixel becomes invalid. The display encoding would hide it, because it
            // maps NaN to 0.
            if usable_within_3(radiance, 3e38) {
                colour = display_encode(radiance, shown);
            } else {
                colour = radiance;
            }
        }
        signal[i * count + at] = signal_pack(colour, fetches, choice);
    }
}

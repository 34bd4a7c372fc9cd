// Three axis-aligned projections. Axis 0 is the projection along x, 1 along y, 2 along z; texture coordinates are signed and never
// mirrored. The components of a height gradient in a projection are therefore components of the gradient in space, without a change of
// sign.
// Source: Mikkelsen, "Surface Gradient-Based Bump Mapping Framework", JCGT 9(3), 2020 (sections on tri-planar projection).

const TRIPLANAR_MAX_SHARPNESS: f32 = 1e4;
const TRIPLANAR_MAX_SLOPE: f32 = 1e6;

fn triplanar_power(ratio: f32, sharpness: f32) -> f32 {
    // Zero to the power of zero counts as 1, so that all axes get the same weight if the sharpness is 0.
    let at_zero = select(0.0, 1.0, sharpness <= 0.0);
    return select(at_zero, exp2(sharpness * log2(max(ratio, 1e-30))), ratio > 1e-30);
}

// |n|^k, normalised to sum 1; k is `sharpness` >= 0. If n has no usable direction, it counts as the z axis.
fn triplanar_weights(n: vec3<f32>, sharpness: f32) -> vec3<f32> {
    // Components are divided by the largest one, whose term is then exactly 1, so the sum cannot underflow.
    let a = abs(octahedral_unit(n));
    let r = a / max(max(a.x, a.y), a.z);
    let k = usable_positive_1(sharpness, TRIPLANAR_MAX_SHARPNESS);
    let w = vec3<f32>(triplanar_power(r.x, k), triplanar_power(r.y, k), triplanar_power(r.z, k));
    return w / (w.x + w.y + w.z);
}

// Coordinates in the plane perpendicular to an axis: (y, z), (x, z), (x, y). An axis above 2 counts as 2.
fn triplanar_coordinates(p: vec3<f32>, axis: u32) -> vec2<f32> {
    if axis == 0u {
        return p.yz;
    }
    if axis == 1u {
        return p.xz;
    }
    return p.xy;
}

// Converts a height gradient to a gradient in space. The height gradient lies in the plane perpendicular to `axis`.
fn triplanar_from_gradient(g: vec2<f32>, axis: u32) -> vec3<f32> {
    if axis == 0u {
        return vec3<f32>(0.0, g.x, g.y);
    }
    if axis == 1u {
        return vec3<f32>(g.x, 0.0, g.y);
    }
    return vec3<f32>(g.x, g.y, 0.0);
}

// Normal of the surface displaced by a height whose gradient in space is `gradient`: n minus the part of `gradient` that is tangent to the surface.
// If a component of `gradient` exceeds 1e6 in magnitude, `gradient` is scaled down until its largest component has the magnitude 1e6. A gradient with
// a component that is NaN or beyond 1e30 counts as 0. The result is a unit vector.
fn triplanar_perturb(n: vec3<f32>, gradient: vec3<f32>) -> vec3<f32> {
    let unit = octahedral_unit(n);
    let known = select(vec3<f32>(0.0), gradient, vec3<bool>(usable_within_3(gradient, 1e30)));
    let size = max(max(abs(known.x), abs(known.y)), abs(known.z));
    let g = select(known, known * (TRIPLANAR_MAX_SLOPE / max(size, 1.0)), vec3<bool>(size > TRIPLANAR_MAX_SLOPE));
    return octahedral_unit(unit - (g - unit * dot(unit, g)));
}

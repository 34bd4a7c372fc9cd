// Whether a part of the terrain can be left out: it lies beyond a plane of the frustum, or all of it faces away.
// Both err to one side only: what is seen is never left out. culling.rs derives the margins.

const CULLING_SLACK: f32 = 4.7683716e-7;
const CULLING_ROUNDING: f32 = 1.1444092e-5;
const CULLING_MOST: f32 = 1e15;
const CULLING_FLUSHED: f32 = 1e-22;

// Whether a box lies wholly beyond a plane, where n . p + w < 0 (`plane`: n, w). Never where a number is none, infinite or beyond 1e15.
fn culling_beyond(plane: vec4<f32>, low: vec3<f32>, high: vec3<f32>) -> bool {
    let terms = plane.xyz * select(low, high, plane.xyz >= vec3<f32>(0.0));
    let size = abs(terms.x) + abs(terms.y) + abs(terms.z) + abs(plane.w);
    let known = usable_within_3(low, CULLING_MOST) && usable_within_3(high, CULLING_MOST)
        && usable_within_3(plane.xyz, CULLING_MOST) && usable_within_1(plane.w, CULLING_MOST);
    return known && terms.x + terms.y + terms.z + plane.w < -(CULLING_SLACK * size + CULLING_FLUSHED);
}

// Whether all of a patch within `radius` of a point, `to_patch` from the eye, faces away; its normals lie in a cone.
fn culling_faces_away(axis: vec3<f32>, sin_half_angle: f32, to_patch: vec3<f32>, radius: f32) -> bool {
    let known = usable_within_3(axis, CULLING_MOST) && usable_within_3(to_patch, CULLING_MOST)
        && usable_within_3(vec3<f32>(radius, sin_half_angle, 0.0), CULLING_MOST) && radius >= 0.0 && sin_half_angle >= 0.0
        && max(max(abs(axis.x), abs(axis.y)), abs(axis.z)) > 1e-15;
    let distance = length(to_patch);
    if !(known && sin_half_angle < 1.0 && distance > radius && distance > 1e-15) {
        return false;
    }
    let sines = vec2<f32>(sin_half_angle, radius / distance);
    let cosines = sqrt(max((vec2<f32>(1.0) - sines) * (vec2<f32>(1.0) + sines), vec2<f32>(0.0)));
    // From a right angle on some normal faces the eye.
    if cosines.x * cosines.y - sines.x * sines.y <= CULLING_ROUNDING {
        return false;
    }
    let along = dot(octahedral_unit(axis), octahedral_unit(to_patch));
    return along > sines.x * cosines.y + cosines.x * sines.y + CULLING_ROUNDING;
}

// Culling tests: whether a part of the terrain lies outside a plane of the frustum, is hidden by nearer surfaces, or faces away from the eye. The
// tests are conservative: in case of doubt, a part is kept. culling.rs explains the constants CULLING_..., which the host passes to this file.

// Whether a box lies completely outside a plane. `plane` is (n, w); a point p is outside if n . p + w < 0. False if a number is NaN, infinite or
// beyond 1e15.
fn culling_beyond(plane: vec4<f32>, low: vec3<f32>, high: vec3<f32>) -> bool {
    let terms = plane.xyz * select(low, high, plane.xyz >= vec3<f32>(0.0));
    let size = abs(terms.x) + abs(terms.y) + abs(terms.z) + abs(plane.w);
    let known = usable_within_3(low, CULLING_MOST) && usable_within_3(high, CULLING_MOST)
        && usable_within_3(plane.xyz, CULLING_MOST) && usable_within_1(plane.w, CULLING_MOST);
    return known && terms.x + terms.y + terms.z + plane.w < -(CULLING_SLACK * size + CULLING_FLUSHED);
}

// Whether all of a patch faces away from the eye. The patch lies in a sphere of `radius` m, and `to_patch` goes from the eye to the centre of this
// sphere, m. The normals of the patch lie in a cone around `axis`; `sin_half_angle` is the sine of the cone's half angle.
fn culling_faces_away(axis: vec3<f32>, sin_half_angle: f32, to_patch: vec3<f32>, radius: f32) -> bool {
    let known = usable_within_3(axis, CULLING_MOST) && usable_within_3(to_patch, CULLING_MOST)
        && usable_within_3(vec3<f32>(radius, sin_half_angle, 0.0), CULLING_MOST) && radius >= 0.0 && sin_half_angle >= 0.0
        && max(max(abs(axis.x), abs(axis.y)), abs(axis.z)) > CULLING_LEAST;
    let distance = length(to_patch);
    if !(known && sin_half_angle < 1.0 && distance > radius && distance > CULLING_LEAST) {
        return false;
    }
    let sines = vec2<f32>(sin_half_angle, radius / distance);
    let cosines = sqrt(max((vec2<f32>(1.0) - sines) * (vec2<f32>(1.0) + sines), vec2<f32>(0.0)));
    // If the half angle of the cone and the angular radius of the sphere add up to a right angle or more, some normal in the cone may face the eye.
    if cosines.x * cosines.y - sines.x * sines.y <= CULLING_ROUNDING {
        return false;
    }
    let along = dot(octahedral_unit(axis), octahedral_unit(to_patch));
    return along > sines.x * cosines.y + cosines.x * sines.y + CULLING_ROUNDING;
}

// The pixels that a box covers on the screen, rounded outwards.
struct CullingCover {
    // Whether it is known which pixels the box covers. If not, the other members have no meaning.
    known: bool,
    // First and last column and row of pixels, counted from the upper left corner of the picture.
    first: vec2<u32>,
    last: vec2<u32>,
    // Upper bound on the reversed depth of the box's nearest point: distance of the near plane / distance of the point along the view direction.
    depth: f32,
}

// The dot product of a matrix row and (place, 1), and a bound on the rounding error of this sum.
fn culling_summed(row: vec4<f32>, place: vec3<f32>) -> vec2<f32> {
    let terms = row.xyz * place;
    let size = abs(terms.x) + abs(terms.y) + abs(terms.z) + abs(row.w);
    return vec2<f32>(terms.x + terms.y + terms.z + row.w, CULLING_SLACK * size + CULLING_FLUSHED);
}

// The pixels of a picture that the box from `low` to `high` covers. The parameters `row_...` are the rows for x, y and w of a matrix from the box's
// coordinates to clip space; `near` is the distance of the near plane, m; `size` is the size of the picture, pixels.
fn culling_cover(
    row_x: vec4<f32>, row_y: vec4<f32>, row_w: vec4<f32>, near: f32, low: vec3<f32>, high: vec3<f32>, size: vec2<u32>
) -> CullingCover {
    let nothing = CullingCover(false, vec2<u32>(0u), vec2<u32>(0u), 1.0);
    let known = usable_within_3(low, CULLING_MOST) && usable_within_3(high, CULLING_MOST)
        && usable_within_3(row_x.xyz, CULLING_MOST) && usable_within_3(row_y.xyz, CULLING_MOST) && usable_within_3(row_w.xyz, CULLING_MOST)
        && usable_within_3(vec3<f32>(row_x.w, row_y.w, row_w.w), CULLING_MOST) && usable_within_1(near, CULLING_MOST);
    if !(known && near >= CULLING_NEAREST) {
        return nothing;
    }
    let pixels = vec2<f32>(size);
    var nearest = 3e38;
    var least = pixels;
    var most = vec2<f32>(0.0);
    for (var corner = 0u; corner < 8u; corner++) {
        let place = select(low, high, (vec3<u32>(corner) & vec3<u32>(1u, 2u, 4u)) != vec3<u32>(0u));
        let x = culling_summed(row_x, place);
        let y = culling_summed(row_y, place);
        let w = culling_summed(row_w, place);
        let sure = w.x - w.y;
        if !(sure >= near && w.y <= CULLING_KNOWN * sure) {
            return nothing;
        }
        nearest = min(nearest, sure);
        let q = clamp(vec2<f32>(x.x, -y.x) / w.x, vec2<f32>(-CULLING_OUTSIDE), vec2<f32>(CULLING_OUTSIDE));
        let margin = (vec2<f32>(x.y, y.y) + abs(q) * w.y) / sure + CULLING_FEW * (vec2<f32>(1.0) + abs(q));
        least = min(least, (vec2<f32>(0.5) + 0.5 * (q - margin)) * pixels);
        most = max(most, (vec2<f32>(0.5) + 0.5 * (q + margin)) * pixels);
    }
    let last = pixels - vec2<f32>(1.0);
    return CullingCover(
        true,
        vec2<u32>(clamp(floor(least), vec2<f32>(0.0), last)),
        vec2<u32>(clamp(floor(most), vec2<f32>(0.0), last)),
        min(near / nearest * (1.0 + CULLING_FEW), 1.0)
    );
}

// The finest level of a depth pyramid at which the pixels from `first` to `last` lie in at most 2 x 2 texels. A texel of a level stores the least
// reversed depth of 2 x 2 texels of the next finer level; the texels of level 0 are pixels.
fn culling_level(first: vec2<u32>, last: vec2<u32>) -> u32 {
    let start = firstLeadingBit(max(last - first, vec2<u32>(1u)));
    let level = start + select(vec2<u32>(0u), vec2<u32>(1u), (last >> start) - (first >> start) > vec2<u32>(1u));
    return max(level.x, level.y);
}

// Size of a level of the depth pyramid of a picture of `size` pixels, in texels. It is rounded up. If it were rounded down, the last column of a
// level with an odd number of columns would be in no texel of the next coarser level, and a box that is visible only in this column could be culled.
fn culling_level_size(size: vec2<u32>, level: u32) -> vec2<u32> {
    return ((max(size, vec2<u32>(1u)) - vec2<u32>(1u)) >> vec2<u32>(level)) + vec2<u32>(1u);
}

// Whether a box is hidden by what was drawn. `depth` is the reversed depth of the box's nearest point. `farthest` are the least reversed depths in
// the texels of the depth pyramid that the box covers.
fn culling_hidden(depth: f32, farthest: vec4<f32>) -> bool {
    let numbers = usable_number(farthest.x) && usable_number(farthest.y) && usable_number(farthest.z) && usable_number(farthest.w);
    return numbers && usable_number(depth) && all(vec4<f32>(depth) < farthest);
}

// A single projection. Gentle slopes are projected from above. Steep slopes are projected horizontally, in the direction whose azimuth is the
// multiple of 45 degrees that is nearest to the normal's azimuth. Planes 0, 1 and 2 are those of tri-planar projection along x, y and z.
// Textures on plane 3 are projected along (1, 1), on plane 4 along (1, -1).
// After Terrain3D (TokisanGames, main.glsl, get_material): there, the splat texel's normal is rounded to a coarse grid if its vertical component is
// below a threshold, and the texture is projected onto the plane perpendicular to the rounded normal.

// 1 / sqrt 2 in units of 1 / 256. 181 / 256 is 0.011 % too small, but snapped_fixed can multiply by it in integer arithmetic.
const SNAPPED_DIAGONAL: i32 = 181;
// tan 22.5 degrees. The eight directions are 45 degrees apart, so each includes the azimuths up to 22.5 degrees to either side.
const SNAPPED_HALF_STEP: f32 = 0.41421356;

// Chooses the plane for a normal. The slope is steep if |z| of the unit normal is below `cosine`.
fn snapped_plane(n: vec3<f32>, cosine: f32) -> u32 {
    let u = octahedral_unit(n);
    let a = abs(u);
    if a.z >= cosine {
        return 2u;
    }
    if a.y <= SNAPPED_HALF_STEP * a.x {
        return 0u;
    }
    if a.x <= SNAPPED_HALF_STEP * a.y {
        return 1u;
    }
    return select(4u, 3u, (u.x > 0.0) == (u.y > 0.0));
}

// Projects a position to two coordinates in a plane: (horizontal, vertical) on a vertical plane, (x, y) on plane 2. A plane above 4 counts as 2.
// Numbers beyond 1e30 and NaN count as zero.
fn snapped_coordinates(position: vec3<f32>, plane: u32) -> vec2<f32> {
    let p = usable_3(position);
    let diagonal = f32(SNAPPED_DIAGONAL) / 256.0;
    if plane == 3u {
        return vec2<f32>((p.y - p.x) * diagonal, p.z);
    }
    if plane == 4u {
        return vec2<f32>((p.x + p.y) * diagonal, p.z);
    }
    return triplanar_coordinates(p, plane);
}

// Converts a position in whole sectors to the two coordinates of a plane. `place` counts sectors east, north and up. On a diagonal plane, the first
// coordinate lacks the factor 1 / sqrt 2, which snapped_fixed applies to the repeats per sector instead.
fn snapped_sectors(place: vec3<i32>, plane: u32) -> vec2<i32> {
    if plane == 0u {
        return place.yz;
    }
    if plane == 1u {
        return place.xz;
    }
    if plane == 3u {
        return vec2<i32>(place.y - place.x, place.z);
    }
    if plane == 4u {
        return vec2<i32>(place.x + place.y, place.z);
    }
    return place.xy;
}

// Converts the repeats per sector to the repeats per sector along the first coordinate of a plane, both in the fixed-point format of tiling_fixed: 24
// fractional bits, modulo 2^32. On a diagonal plane, the number is divided by 256, so only the 24 fractional bits of the result are valid. There,
// tiling_fixed must be called with scale 0.
fn snapped_fixed(per_sector_fixed: i32, plane: u32) -> i32 {
    let diagonal = (per_sector_fixed >> 8u) * SNAPPED_DIAGONAL + (((per_sector_fixed & 255) * SNAPPED_DIAGONAL) >> 8u);
    return select(per_sector_fixed, diagonal, plane == 3u || plane == 4u);
}

// Converts a height gradient in a plane to a gradient in space. Numbers beyond 1e30 and NaN count as zero.
fn snapped_from_gradient(gradient: vec2<f32>, plane: u32) -> vec3<f32> {
    let g = usable_2(gradient);
    let along = g.x * 0.70710678;
    if plane == 3u {
        return vec3<f32>(-along, along, g.y);
    }
    if plane == 4u {
        return vec3<f32>(along, along, g.y);
    }
    return triplanar_from_gradient(g, plane);
}

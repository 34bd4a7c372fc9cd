// One projection: from above on gentle slopes, else the vertical plane whose azimuth is nearest among multiples of 45 degrees.
// Planes 0, 1, 2 are the tri-planar ones (looking along x, y, z); 3 looks along (1, 1), 4 along (1, -1).
// After Terrain3D (TokisanGames, main.glsl, get_material): there the splat texel's normal, below a threshold of its height, is rounded
// to a coarse grid, and the projection is across it.

// 1 / sqrt 2 as a fraction of 256, 0.013 % smaller, so that whole sectors count in exact fixed point.
const SNAPPED_DIAGONAL: i32 = 181;
// tan 22.5 degrees.
const SNAPPED_HALF_STEP: f32 = 0.41421356;

// Plane of a normal; steeper than `cosine` is steep.
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

// Coordinates in a plane: horizontal, then vertical. A plane above 4 counts as 2; what is beyond 1e30 or not a number, as zero.
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

// Whole sectors along both coordinates: `place` in sectors east, north, up. On a diagonal, to be counted at the rate of snapped_fixed.
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

// Repeats per sector along the first coordinate, in the fixed point of tiling_fixed, of which only the fraction is good on a diagonal.
fn snapped_fixed(per_sector_fixed: i32, plane: u32) -> i32 {
    let diagonal = (per_sector_fixed >> 8u) * SNAPPED_DIAGONAL + (((per_sector_fixed & 255) * SNAPPED_DIAGONAL) >> 8u);
    return select(per_sector_fixed, diagonal, plane == 3u || plane == 4u);
}

// Height gradient in a plane, as gradient in the volume; what is beyond 1e30 or not a number counts as zero.
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

// Full splat: calls the functions of the estimator.

// Blends all materials of the cell in all projections. With `fc5`: 48 fetches, or 96 with two tiling scales. The estimator `stf` samples only one
// material in one projection: 4 fetches.
fn shade_splat(pixel: Pixel) -> Surface {
    var sum = surface_zero();
    if ESTIMATOR == ESTIMATOR_STF {
        return shade_stf(pixel, SALT_SPLAT, 0u, 0.0);
    }
    for (var i = 0u; i < shade_projections(); i++) {
        let projection = terrain_projection(pixel.planes[i], pixel.footprint);
        if TWO_TILINGS {
            for (var t = 0u; t < frame.taps - 2u; t++) {
                let share = select(1.0 - pixel.tiling.y, pixel.tiling.y, t == 1u);
                let blend = shade_blend(pixel, projection, u32(pixel.tiling.x) + t);
                sum = surface_add(sum, pixel.projections[i] * share, blend);
            }
        } else {
            sum = surface_add(sum, pixel.projections[i], shade_blend(pixel, projection, 0u));
        }
    }
    return sum;
}

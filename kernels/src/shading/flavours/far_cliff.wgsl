// Far cliff: calls the function of the estimator.

fn shade_far_cliff(pixel: Pixel) -> Surface {
    if ESTIMATOR == ESTIMATOR_STF {
        return shade_stf(pixel, SALT_FAR_CLIFF, u32(pixel.tiling.x), pixel.tiling.y);
    }
    if ESTIMATOR == ESTIMATOR_LAPLACIAN {
        return shade_laplacian_far_cliff(pixel);
    }
    if IS_ONE_BLEND {
        return shade_splat(pixel);
    }
    if TAKES_MEANS {
        return shade_mean_far_cliff(pixel);
    }
    if ESTIMATOR == ESTIMATOR_VARIANCE {
        return shade_variance_far_cliff(pixel);
    }
    if ESTIMATOR == ESTIMATOR_HEX {
        return shade_hex_far_cliff(pixel);
    }
    return shade_fc5_far_cliff(pixel);
}

// Near cliff: calls the function of the estimator.

fn shade_near_cliff(pixel: Pixel) -> Surface {
    if ESTIMATOR == ESTIMATOR_STF {
        return shade_stf(pixel, SALT_NEAR_CLIFF, 0u, 0.0);
    }
    if IS_ONE_BLEND {
        return shade_splat(pixel);
    }
    if TAKES_MEANS {
        return shade_mean_near_cliff(pixel);
    }
    if ESTIMATOR == ESTIMATOR_VARIANCE {
        return shade_variance_near_cliff(pixel);
    }
    return shade_fc5_near_cliff(pixel);
}

//! Properties of coordinate systems by their EPSG codes: units of projected systems, and units and directions of vertical systems. They are
//! needed because a file that names a system need not state its unit.
//!
//! Source: EPSG Geodetic Parameter Dataset, version 12.029; the projected systems in feet, version 11.022.

use super::units::Unit;

/// Codes (EPSG) of Mercator projections of the world: two of web maps, and World Mercator.
pub(super) const WORLD_MERCATOR: [u16; 3] = [3857, 3785, 3395];

/// Vertical systems in feet whose values increase upwards (EPSG dataset 12.029), with the code of their unit.
const VERTICAL_FEET: [(u16, u16); 10] = [
    (5702, 9003),
    (5754, 9095),
    (6130, 9002),
    (6131, 9002),
    (6132, 9002),
    (6360, 9003),
    (8050, 9002),
    (8052, 9003),
    (8228, 9002),
    (10_919, 9003),
];

/// Whether the unit of a projected system (EPSG) is known to be the metre. Of the systems in metres, this list has UTM on WGS 84, ETRS89 and NAD83,
/// usual systems of the European Union, France, Great Britain, Switzerland and the Netherlands, and [`WORLD_MERCATOR`].
pub(super) fn is_metric(system: u16) -> bool {
    WORLD_MERCATOR.contains(&system)
        || matches!(system, 32_601..=32_660 | 32_701..=32_760 | 25_828..=25_838 | 26_901..=26_923 | 3035 | 2154 | 27_700 | 2056 | 21_781 | 28_992)
}

/// Whether the values of a vertical system increase downwards. The codes are those of the systems of the EPSG dataset 12.029 whose axis points down.
pub(super) fn is_depth(system: u16) -> bool {
    matches!(
        system,
        5336 | 5612 | 5614 | 5706 | 5715 | 5734 | 5739 | 5789 | 5831 | 5861..=5867 | 5873 | 6357..=6359 | 7976 | 8051 | 8053 | 8358 | 8378 | 8897
            | 9287 | 9288 | 9672 | 10_150 | 10_151 | 10_349 | 10_364 | 10_370..=10_379 | 10_547..=10_552 | 10_649 | 10_650 | 10_678
    )
}

/// Whether a vertical system has heights in metres. The codes are those of the EPSG dataset 12.029.
pub(super) fn has_metric_heights(system: u16) -> bool {
    matches!(
        system,
        3855 | 3886 | 3900 | 4440 | 4458 | 5193 | 5195 | 5214 | 5237 | 5317 | 5597 | 5600..=5611 | 5613 | 5615..=5621 | 5701 | 5703..=5705
            | 5709..=5714 | 5716..=5733 | 5735..=5738 | 5740..=5753 | 5755..=5788 | 5790..=5799 | 5829 | 5843 | 5868..=5872 | 5874 | 5941
            | 6178..=6187 | 6638..=6644 | 6647 | 6693..=6695 | 6916 | 7446 | 7447 | 7651 | 7652 | 7699 | 7700 | 7707 | 7832 | 7837 | 7839 | 7841
            | 7888..=7890 | 7962 | 7968 | 7979 | 8089 | 8266 | 8267 | 8357 | 8434 | 8675 | 8690 | 8691 | 8841 | 8881 | 8904 | 8911 | 9130 | 9245
            | 9255 | 9274 | 9279 | 9303 | 9335 | 9351 | 9389 | 9390 | 9392..=9402 | 9451 | 9458 | 9471 | 9650 | 9651 | 9663 | 9666 | 9669 | 9675
            | 9681 | 9721 | 9722 | 9923 | 9927 | 10_190 | 10_352..=10_354 | 10_482..=10_485 | 10_565 | 10_588 | 10_642 | 10_740 | 10_763 | 10_900
            | 10_918 | 10_999 | 11_157 | 20_000 | 20_034..=20_036
    )
}

/// The unit of a vertical system in [`VERTICAL_FEET`]; `None` for other systems.
pub(super) fn vertical_feet(system: u16) -> Option<Unit> {
    VERTICAL_FEET.iter().find(|(feet, _)| *feet == system).and_then(|&(_, unit)| Unit::of_code(unit))
}

/// The unit of a projected system, if it is the US survey foot or the foot; otherwise `None`.
pub(super) fn projected_feet(system: u16) -> Option<Unit> {
    let code = if is_in_us_survey_feet(system) {
        9003
    } else if is_in_feet(system) {
        9002
    } else {
        return None;
    };
    Unit::of_code(code)
}

/// Whether the unit of a projected system is the US survey foot. The codes are those of the EPSG dataset 11.022.
fn is_in_us_survey_feet(system: u16) -> bool {
    matches!(
        system,
        2155 | 2194 | 2204 | 2225..=2250 | 2254..=2255 | 2257..=2264 | 2267..=2268 | 2271..=2272 | 2274..=2279 | 2283..=2289 | 2870..=2895
            | 2899..=2900 | 2902..=2908 | 2911..=2912 | 2915..=2920 | 2924..=2930 | 2964..=2968 | 3089 | 3091 | 3102 | 3363 | 3365 | 3404
            | 3417..=3438 | 3441..=3446 | 3451..=3459 | 3485 | 3487 | 3490 | 3492 | 3494 | 3496 | 3498 | 3500 | 3502 | 3504 | 3506 | 3508
            | 3510 | 3512 | 3515 | 3517 | 3519 | 3521 | 3523 | 3525 | 3527 | 3529 | 3531 | 3533 | 3535 | 3537 | 3539 | 3541 | 3543 | 3545
            | 3547 | 3549 | 3551 | 3553 | 3560..=3570 | 3582 | 3584 | 3586 | 3598 | 3600 | 3608 | 3610 | 3612 | 3614 | 3616 | 3618 | 3620
            | 3622 | 3624 | 3626 | 3628 | 3630 | 3632 | 3640 | 3642 | 3650 | 3652 | 3654 | 3658 | 3660 | 3662 | 3664 | 3668 | 3670 | 3672
            | 3674 | 3677 | 3680 | 3683 | 3686 | 3688 | 3690 | 3692 | 3696 | 3698 | 3700 | 3728..=3739 | 3753..=3760 | 3991..=3992 | 4217
            | 4399..=4413 | 4418..=4433 | 4438..=4439 | 4455..=4457 | 5623..=5625 | 5646 | 5654..=5655 | 6200..=6202 | 6411 | 6413 | 6416
            | 6418 | 6420 | 6422 | 6424 | 6426 | 6428 | 6430 | 6432 | 6434 | 6436 | 6438 | 6441 | 6443 | 6445 | 6447 | 6449 | 6451 | 6453
            | 6455 | 6457 | 6459 | 6461 | 6463 | 6465 | 6467 | 6469 | 6471 | 6473 | 6475 | 6477 | 6479 | 6484 | 6486 | 6488 | 6490 | 6492
            | 6501 | 6503 | 6505 | 6507 | 6510 | 6517 | 6519 | 6521 | 6523 | 6525 | 6527 | 6529 | 6531 | 6533 | 6535 | 6537 | 6539 | 6541
            | 6543 | 6549 | 6551 | 6553 | 6555 | 6563 | 6565 | 6568 | 6572 | 6574 | 6576 | 6578 | 6582 | 6584 | 6586 | 6588 | 6590 | 6593
            | 6595 | 6597 | 6599 | 6601 | 6603 | 6605 | 6607 | 6609 | 6612 | 6614 | 6616 | 6618 | 6625..=6627 | 6633 | 6880 | 6923 | 6925
            | 6966 | 6997 | 7057..=7070 | 7128 | 7132 | 7258 | 7260 | 7262 | 7264 | 7266 | 7268 | 7270 | 7272 | 7274 | 7276 | 7278 | 7280
            | 7282 | 7284 | 7286 | 7288 | 7290 | 7292 | 7294 | 7296 | 7298 | 7300 | 7302 | 7304 | 7306 | 7308 | 7310 | 7312 | 7314 | 7316
            | 7318 | 7320 | 7322 | 7324 | 7326 | 7328 | 7330 | 7332 | 7334 | 7336 | 7338 | 7340 | 7342 | 7344 | 7346 | 7348 | 7350 | 7352
            | 7354 | 7356 | 7358 | 7360 | 7362 | 7364 | 7366 | 7368 | 7370 | 7587..=7645 | 8035..=8036 | 8091 | 8093 | 8096 | 8098 | 8100
            | 8102 | 8104 | 8106 | 8108 | 8110 | 8112 | 8114 | 8116 | 8118 | 8120 | 8122 | 8124 | 8126 | 8128 | 8130 | 8132 | 8134 | 8136
            | 8138 | 8140 | 8142 | 8144 | 8146 | 8148 | 8150 | 8152 | 8154 | 8156 | 8158 | 8160 | 8162 | 8164 | 8166 | 8168 | 8170 | 8172
            | 8177 | 8180 | 8182 | 8185 | 8189 | 8193 | 8197 | 8200 | 8202 | 8204 | 8206 | 8208 | 8210 | 8213 | 8216 | 8220 | 8224 | 8226
            | 8380 | 8382 | 8384 | 8387 | 8518..=8540 | 9748..=9749 | 10_481 | 10_516 | 10_622 | 23_301..=23_333 | 26_729..=26_813
            | 26_847..=26_870 | 32_001..=32_058 | 32_064..=32_077 | 32_099 | 32_164..=32_167 | 32_664..=32_667
    )
}

/// Whether the unit of a projected system is the (international) foot. The codes are those of the EPSG dataset 11.022.
fn is_in_feet(system: u16) -> bool {
    matches!(
        system,
        2222..=2224 | 2251..=2253 | 2256 | 2265..=2266 | 2269..=2270 | 2273 | 2280..=2282 | 2867..=2869 | 2896..=2898 | 2901 | 2909..=2910
            | 2913..=2914 | 2921..=2923 | 2992 | 2994 | 3080 | 3359 | 3361 | 3479 | 3481 | 3483 | 3588 | 3590 | 3593 | 3605 | 3634 | 3636
            | 3644 | 3646 | 3648 | 3656 | 3676 | 3679 | 3682 | 5588 | 6128..=6129 | 6141 | 6391 | 6405 | 6407 | 6409 | 6494 | 6496 | 6499
            | 6515 | 6545 | 6547 | 6557 | 6559 | 6561 | 6570 | 6785 | 6787 | 6789 | 6791 | 6793 | 6795 | 6797 | 6799 | 6801 | 6803 | 6805
            | 6807 | 6809 | 6811 | 6813 | 6815 | 6817 | 6819 | 6821 | 6823 | 6825 | 6827 | 6829 | 6831 | 6833 | 6835 | 6837 | 6839 | 6841
            | 6843 | 6845 | 6847 | 6849 | 6851 | 6853 | 6855 | 6857 | 6859 | 6861 | 6863 | 6868 | 6885 | 6887 | 7119..=7127 | 8065..=8068
            | 8312 | 8314 | 8316 | 8318 | 8320 | 8322 | 8324 | 8326 | 8328 | 8330 | 8332 | 8334 | 8336 | 8338 | 8340 | 8342 | 8344 | 8346
            | 8348 | 20_050
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projected_systems_have_one_unit() {
        let survey_foot = Unit::of_code(9003);
        for system in [2229, 2225, 2230, 2264, 2289, 2903, 3404, 6424, 6543, 26_729, 32_058] {
            assert_eq!(projected_feet(system), survey_foot, "{system}");
        }
        for system in [2222, 2256, 2273, 2994] {
            assert_eq!(projected_feet(system), Unit::of_code(9002), "{system}");
        }
        for system in 0..=u16::MAX {
            let units = [is_metric(system), is_in_us_survey_feet(system), is_in_feet(system)];
            assert!(units.iter().filter(|is| **is).count() <= 1, "{system} has two units");
        }
        assert_eq!([2154, 6423, 32_632].map(projected_feet), [None; 3]);
    }
}

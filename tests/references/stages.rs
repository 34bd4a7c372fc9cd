//! Tests the references of stages with inputs whose result follows from the definition: vertices on borders, a few pixels counted by hand, cameras
//! above a plane.

use glam::{DVec2, DVec3};
use kernels::base::colour;
use kernels::classification::reference::tile_masks;
use kernels::display::reference::{codes, tone_map};
use kernels::display::{Exposure, ToneCurve, WHITE};
use kernels::geometry::reference::{stitch, weld};
use kernels::lighting::reference::{F0, Light, Surface, radiance, sky_irradiance, sky_radiance};
use kernels::metrics::reference::Earlier;
use kernels::metrics::{self, FrameSums, LagSums};
use kernels::motion::reference::{Seen, link};
use kernels::motion::{NO_LINK, TOLERANCE};
use kernels::shared::real::{dot, length, scale, sub};
use kernels::shared::{brdf, signal};
use kernels::temporal::reference::{Frame, resolve};
use kernels::temporal::{Resolve, SHARE};
use kernels::view::camera::{Pose, View};

use crate::statistics::Random;

fn largest_difference<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
}

// ---------------------------------------------------------------- geometry

#[test]
fn vertices_move_to_the_nearest_vertex_of_the_neighbour() {
    for delta in 0..=7 {
        for index in 0..=128_u32 {
            // If two vertices are equally near, the vertex moves to the one with the lower index.
            let nearest = (0..=128).step_by(1 << delta).min_by_key(|&vertex: &u32| (vertex.abs_diff(index), vertex));
            assert_eq!(Some(weld(index, delta)), nearest, "vertex {index}, {delta} levels");
        }
    }
    // The neighbours in the north, east, south and west are 1, 2, 3 and 4 levels coarser.
    let deltas = 0x1234;
    assert_eq!(stitch([11, 128], [0, 0], 128, deltas), [10, 128]);
    assert_eq!(stitch([128, 11], [0, 0], 128, deltas), [128, 12]);
    assert_eq!(stitch([11, 0], [0, 0], 128, deltas), [8, 0]);
    assert_eq!(stitch([0, 11], [0, 0], 128, deltas), [0, 16]);
    assert_eq!(stitch([11, 13], [0, 0], 128, deltas), [11, 13]);
    for corner in [[0, 0], [128, 0], [0, 128], [128, 128]] {
        assert_eq!(stitch(corner, [0, 0], 128, deltas), corner);
    }
}

// ---------------------------------------------------------------- classification

#[test]
fn the_mask_of_a_tile_has_the_flavours_of_its_terrain() {
    // 3 x 2 tiles of 8 x 8 pixels; the last column and row are cut.
    let size = [19, 13];
    let pixels = (size[0] * size[1]) as usize;
    let mut random = Random(91);
    let mask: Vec<u8> = (0..pixels).map(|_| 1 << random.below(5)).collect();
    let terrain: Vec<bool> = (0..pixels).map(|i| random.below(4) > 0 && (i % 19 < 16 || i / 19 < 8)).collect();
    for forced in [None, Some(9)] {
        let found = tile_masks(size, &mask, &terrain, forced);
        let of_tile = |tile: usize| {
            let inside = (0..pixels).filter(|i| i % 19 / 8 == tile % 3 && i / 19 / 8 == tile / 3 && terrain[*i]);
            inside.fold(0, |all, i| all | forced.unwrap_or(mask[i]))
        };
        assert_eq!(found, (0..6).map(of_tile).collect::<Vec<u8>>(), "{forced:?}");
        assert_eq!(found[5], 0, "a tile without terrain");
    }
}

// ---------------------------------------------------------------- display

#[test]
fn colours_are_encoded_as_the_standard_says() {
    // IEC 61966-2-1. The two results for the argument 0.5, of encoding and of decoding, were computed outside this project.
    for (linear, encoded) in
        [(0.5, 0.735_356_983_052_449_5), (0.001, 0.01292), (0.0, 0.0), (1.0, 1.0), (1.5, 1.0), (-0.5, 0.0), (f64::NAN, 0.0)]
    {
        assert!((colour::srgb_from_linear(linear) - encoded).abs() < 1e-12, "{linear}");
    }
    assert!((colour::linear_from_srgb(0.5) - 0.214_041_140_482_232_55_f64).abs() < 1e-12);
    for i in 0..=1000 {
        let linear = f64::from(i) / 1000.0;
        assert!((colour::linear_from_srgb(colour::srgb_from_linear(linear)) - linear).abs() < 1e-7, "{linear}");
    }
    assert!((colour::luminance([0.25, 0.5, 1.0]) - (0.2126 * 0.25 + 0.7152 * 0.5 + 0.0722_f64)).abs() < 1e-15);
    for code in 0..=255_u8 {
        let exact = f32::from(code) / 255.0;
        for off in [-0.49, 0.0, 0.49] {
            assert_eq!(colour::unorm8(exact + off / 255.0), code, "{code} {off}");
        }
    }
    assert_eq!([-1.0, 2.0, f32::NAN].map(colour::unorm8), [0, 255, 0]);
    assert_eq!(colour::srgb_code(0.5), 188);
}

#[test]
fn pictures_are_mapped_by_reinhards_equation() {
    let mut random = Random(93);
    for _ in 0..1000 {
        let stops = random.between(-4.0, 4.0);
        let radiance = [0.0; 3].map(|_: f64| random.between(-4.0, 3.0).exp2());
        let exposed = scale(radiance, stops.exp2());
        // Equation 4 of Reinhard et al. 2002, on luminance.
        let luminance = dot(exposed, [0.2126, 0.7152, 0.0722]);
        let mapped = scale(exposed, (1.0 + luminance / (WHITE * WHITE)) / (1.0 + luminance));
        let curve = |tone_curve| tone_map(radiance, Exposure { exposure: stops, tone_curve });
        assert!(largest_difference(curve(ToneCurve::Reinhard), mapped.map(colour::srgb_from_linear)) < 1e-12, "{radiance:?} {stops}");
        assert!(largest_difference(curve(ToneCurve::Clip), exposed.map(colour::srgb_from_linear)) < 1e-12, "{radiance:?} {stops}");
        let exposure = Exposure { exposure: stops, tone_curve: ToneCurve::Reinhard };
        let values = tone_map(radiance.map(|c| c as f32), exposure);
        assert_eq!(codes(radiance.map(|c| c as f32), exposure), values.map(|value| (value * 255.0).round() as u8));
    }
    // A colour whose luminance is not above 0 is displayed as black, even if a channel is above 0. The luminance of the first colour is exactly 0.
    let plain = Exposure { exposure: 0.0, tone_curve: ToneCurve::Reinhard };
    assert_eq!(tone_map([0.7152, -0.2126, 0.0], plain), [0.0; 3]);
    assert_eq!(tone_map([-1.0, 0.1, 0.1], plain), [0.0; 3]);
}

// ---------------------------------------------------------------- lighting

#[test]
fn each_kind_of_light_is_its_formula() {
    let pi = std::f64::consts::PI;
    let dark = Light { sun_direction: [0.0, 0.6, 0.8], sun_irradiance: [0.0; 3], zenith: [0.0; 3], horizon: [0.0; 3] };
    let even = Light { zenith: [0.3, 0.5, 0.7], horizon: [0.3, 0.5, 0.7], ..dark };
    let sunny = Light { sun_irradiance: [3.0, 2.0, 1.0], ..dark };
    let tilted = Light { zenith: [0.2, 0.4, 0.8], horizon: [1.0, 0.9, 0.7], ..dark };
    let surface = Surface { albedo: [0.2, 0.4, 0.6], normal: [0.6, 0.0, 0.8], smoothness: 0.4, occlusion: 0.0 };
    let black = Surface { albedo: [0.0; 3], occlusion: 0.5, ..surface };
    for to_eye in [[0.0, 0.0, 1.0], [0.8, 0.0, 0.6], [0.0, -0.6, 0.8]] {
        let of = |surface: &Surface<f64>, light: &Light<f64>| radiance(surface, light, to_eye);
        assert_eq!(of(&surface, &dark), ([0.0; 3], [0.0; 3]));
        // Diffuse light of an even sky: the irradiance is pi times the radiance.
        let (found, highlight) = of(&surface, &even);
        let expected: [f64; 3] = std::array::from_fn(|k| surface.albedo[k] * even.zenith[k]);
        assert!(largest_difference(found, expected) < 1e-14 && highlight == [0.0; 3], "{found:?}");
        // Sunlight: the part that the surface does not reflect (1 - Fresnel) is scattered as diffuse light.
        let sun = sunny.sun_direction;
        let sum = [sun[0] + to_eye[0], sun[1] + to_eye[1], sun[2] + to_eye[2]];
        let half = scale(sum, 1.0 / length(sum));
        let (n_dot_l, n_dot_v) = (dot(surface.normal, sun), dot(surface.normal, to_eye));
        let [fresnel, ..] = brdf::f_schlick([F0; 3], dot(sun, half));
        let (found, highlight) = of(&surface, &sunny);
        let expected: [f64; 3] = std::array::from_fn(|k| surface.albedo[k] / pi * (1.0 - fresnel) * sunny.sun_irradiance[k] * n_dot_l);
        assert!(largest_difference(found, expected) < 1e-14 && highlight == [0.0; 3], "{found:?}");
        // The highlight: D V F, times the irradiance, the cosine and the occlusion.
        let alpha = brdf::alpha(0.6);
        let lobe = brdf::d_ggx(dot(surface.normal, half), alpha) * brdf::v_smith_ggx_correlated(n_dot_v, n_dot_l, alpha) * fresnel;
        let (found, highlight) = of(&black, &sunny);
        let expected: [f64; 3] = std::array::from_fn(|k| 0.5 * lobe * sunny.sun_irradiance[k] * n_dot_l);
        assert!(largest_difference(highlight, expected) < 1e-13 && largest_difference(found, expected) < 1e-13, "{found:?}");
        // The sky as the surface reflects it, in the mirror direction of the eye.
        let mirrored = sub(scale(surface.normal, 2.0 * n_dot_v), to_eye);
        let [fit, ..] = brdf::env_approx([F0; 3], 0.6, n_dot_v);
        let (found, highlight) = of(&black, &tilted);
        let expected = scale(sky_radiance(&tilted, mirrored), 0.5 * fit);
        assert!(largest_difference(found, expected) < 1e-14 && highlight == [0.0; 3], "{found:?}");
        assert!(largest_difference(mirrored, to_eye) > 0.1, "the mirror direction is another one");
    }
    // The radiance of the sky is linear in the sine of the elevation, and never below 0. The two checks of `sky_irradiance` are for a surface that
    // faces up, and for one that faces down.
    assert!(largest_difference(sky_radiance(&tilted, [0.6, 0.0, 0.8]), [0.36, 0.5, 0.78]) < 1e-15);
    assert_eq!(sky_radiance(&tilted, [0.0, 0.0, -4.0]).map(|c| c > 0.0), [true; 3]);
    assert_eq!(sky_radiance(&tilted, [0.0, 0.0, 2.0]).map(|c| c == 0.0), [true, true, false]);
    let level = scale([1.0 - 0.8 * 2.0 / 3.0, 0.9 - 0.5 * 2.0 / 3.0, 0.7 + 0.1 * 2.0 / 3.0], pi);
    assert!(largest_difference(sky_irradiance(&tilted, [0.0, 0.0, 1.0]), level) < 1e-14);
    assert_eq!(sky_irradiance(&Light { horizon: [0.0; 3], ..tilted }, [0.0, 0.0, -1.0]), [0.0; 3]);
    // A surface that faces away from the sun gets none of its light. If the eye is behind a surface, the cosine between normal and eye is raised to
    // 0.001.
    let away = Surface { normal: [0.0, -0.8, -0.6], ..surface };
    assert_eq!(radiance(&Surface { occlusion: 1.0, ..away }, &sunny, [0.0, 0.0, -1.0]), ([0.0; 3], [0.0; 3]));
    let behind = Surface { normal: [0.0, 0.0, -1.0], ..black };
    let (found, _) = radiance(&behind, &even, [0.0, 0.0, 1.0]);
    let [fit, ..] = brdf::env_approx([F0; 3], 0.6, 1e-3);
    assert!(largest_difference(found, scale(even.zenith, 0.5 * fit)) < 1e-15, "{found:?}");
}

// ---------------------------------------------------------------- metrics

const SKY: [u32; 2] = [0, 0];

fn grey(value: f32, fetches: u32, choice: u32) -> [u32; 2] {
    signal::pack([value; 3], fetches, choice)
}

#[test]
fn the_sums_of_eight_pixels_are_those_counted_by_hand() {
    let size = [4, 2];
    let now =
        [grey(0.5, 1, 1), grey(0.5, 6, 5), grey(1.0, 3, 3), grey(0.75, 4, 0), SKY, grey(0.25, 2, 2), grey(0.125, 7, 6), grey(2.0, 8, 7)];
    let before = [
        grey(0.5, 0, 1),
        grey(0.5, 0, 0),
        grey(1.0, 0, 3),
        grey(0.25, 0, 4),
        grey(0.5, 0, 1),
        grey(0.186_523_44, 0, 3),
        SKY,
        grey(4.0625, 0, 8),
    ];
    let links = [0, 1, NO_LINK, 3, 4, 5, 6, 7];
    // Quarter 1 contains the second row, which has the pixels 4 to 7. Pixel 4 is sky. At lag 2, pixel 5 is linked to pixel 0, and the pixels 6 and 7
    // have no link.
    let earlier = [grey(0.75, 0, 2); 8];
    let far = [0, 0, 0, 0, 0, 0, NO_LINK, NO_LINK];
    let sums = without_reference(size, &now, &[(&before[..], &links[..]), (&earlier[..], &far[..])], 1);
    assert_eq!((sums.terrain, sums.fetches), (7, 31));
    // At lag 1, the pixels 0, 1, 3, 5 and 7 are linked. Their luminances differ by 0, 0, 1/2, 65/1024 and 33/16. The pixels 0, 5 and 7 made a choice
    // in both frames. The choices of 5 and 7 differ.
    let expected =
        LagSums { terrain: 7, linked: 5, chosen: 3, flipped: 2, difference: 65.0 / 1024.0 + 0.5 + 33.0 / 16.0, ..LagSums::default() };
    assert_lag(&sums, 0, expected);
    assert_lag(&sums, 1, LagSums { terrain: 3, linked: 1, chosen: 1, flipped: 0, difference: 0.5, ..LagSums::default() });
    assert_lag(&sums, 2, LagSums::default());
    // The pixels 5 and 7 are tested; pixel 6 was sky in the earlier frame. The history of pixel 5 is accepted, because pixel 6 is darker. The history
    // of pixel 7 is rejected, because it is brighter than all pixels of the 3 x 3 box around pixel 7.
    assert_eq!((sums.tested, sums.rejected), (2, 1));
    // The differences of the two tested pixels are a little above 2^-4 and 2^1. These are 10 and 15 octaves above the lowest bin, and an octave has
    // 16 bins.
    assert_eq!(filled(&sums), [(160, 1), (240, 1)]);
    // Quarter 0 contains the first row. The pixels 0 and 1 did not change, pixel 2 has no link, and pixel 3 changed by 2^-1, 13 octaves above the
    // lowest bin.
    let sums = without_reference(size, &now, &[(&before[..], &links[..])], 0);
    assert_eq!((sums.tested, sums.rejected, filled(&sums)), (3, 0, vec![(0, 2), (208, 1)]));
}

/// The sums of a frame whose reference sequence is not known. `past` has the earlier pictures, each with the links that lead to it.
fn without_reference(size: [u32; 2], now: &[[u32; 2]], past: &[(&[[u32; 2]], &[u32])], quarter: u32) -> FrameSums {
    let past: Vec<Earlier<'_>> = past.iter().map(|&(picture, links)| Earlier { picture, reference: None, links }).collect();
    metrics::reference::measure(size, now, None, &past, quarter)
}

#[test]
fn changes_are_compared_with_those_of_the_reference_sequence() {
    // dY and dR are the changes of a pixel's luminance in the stream and in the reference sequence. Pixel 0: dY = 1/4, dR = 1/8. Pixel 1: dY = -1/2,
    // dR = 1/4. The reference of pixel 2 is sky, and pixel 3 has no link.
    let now = [grey(0.5, 1, 1), grey(0.25, 1, 1), grey(0.5, 1, 1), grey(1.0, 1, 1)];
    let before = [grey(0.25, 1, 1), grey(0.75, 1, 1), grey(0.5, 1, 1), grey(0.5, 1, 1)];
    let truth = [grey(0.375, 1, 1), grey(0.5, 1, 1), SKY, grey(0.5, 1, 1)];
    let truth_before = [grey(0.25, 1, 1), grey(0.25, 1, 1), grey(0.5, 1, 1), grey(0.5, 1, 1)];
    let links = [0, 1, 2, NO_LINK];
    let past = [Earlier { picture: &before, reference: Some(&truth_before), links: &links }];
    let residual = metrics::reference::measure([4, 1], &now, Some(&truth), &past, 0).lags[0].residual;
    let sums = [residual.sum, residual.square, residual.change_square, residual.reference_square, residual.product];
    let expected = [0.125 + 0.75, 0.015_625 + 0.5625, 0.0625 + 0.25, 0.015_625 + 0.0625, 0.03125 - 0.125];
    assert_eq!(residual.compared, 2);
    for (found, expected) in sums.into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-14, "{residual:?}");
    }
    // A pixel remembers the mean of its errors and the number of frames. A new error has the weight 1 / (number of frames), but at least the argument
    // `adaptation`, 1/4. Pixel 0: new error 1/8, second frame, weight 1/2. Pixel 1: new error -1/4, tenth frame, weight 1/4. Pixel 2 has no
    // reference. Pixel 3 has no link to an earlier frame, so its mean begins again.
    let memory = [[0.5, 1.0], [0.25, 9.0], [0.125, 3.0], [0.0, 0.0]];
    let remembered = metrics::reference::remember(&now, &truth, Some(&memory), &links, 0.25);
    let expected = [[0.3125, 2.0], [0.125, 10.0], [0.0, 0.0], [0.5, 1.0]];
    for (found, expected) in remembered.iter().zip(expected) {
        assert!((found[0] - expected[0]).abs() < 1e-14 && found[1] == expected[1], "{remembered:?}");
    }
}

fn assert_lag(sums: &FrameSums, lag: usize, expected: LagSums) {
    let found = sums.lags[lag];
    assert_eq!(LagSums { difference: 0.0, ..found }, LagSums { difference: 0.0, ..expected }, "lag {}", lag + 1);
    // The tolerance covers the rounding of luminance, which is a sum of three products.
    assert!((found.difference - expected.difference).abs() < 1e-14, "lag {}: {found:?}", lag + 1);
}

/// The bins that are not empty, with their counts.
fn filled(sums: &FrameSums) -> Vec<(usize, u32)> {
    sums.histogram.iter().copied().enumerate().filter(|(_, count)| *count > 0).collect()
}

#[test]
fn a_history_is_rejected_beyond_a_rounding_of_the_box() {
    // All current values of the box are 1, and the history is near 1. In f16, 1 + 2^-10 is the next number above 1, and 1 - 2^-10 is the second
    // number below 1. Both are exactly at the limit of the tolerance and must be accepted.
    let step = 2.0_f32.powi(-10);
    let links: Vec<u32> = (0..16).collect();
    for (history, rejected) in [(1.0, 0), (1.0 + step, 0), (1.0 - step, 0), (1.0 + 2.0 * step, 4), (1.0 - 1.5 * step, 4), (100.0, 4)] {
        let sums = without_reference([4, 4], &[grey(1.0, 1, 1); 16], &[(&[grey(history, 1, 1); 16][..], &links[..])], 2);
        assert_eq!((sums.tested, sums.rejected), (4, rejected), "{history}");
        // Differences beyond the histogram are counted in its last bin.
        assert!(history < 2.0 || filled(&sums) == [(255, 4)], "{history}");
    }
    // A single channel outside the box is enough.
    for channel in 0..3 {
        let mut colour = [1.0; 3];
        colour[channel] = 1.5;
        let sums = without_reference([4, 4], &[grey(1.0, 1, 1); 16], &[(&[signal::pack(colour, 1, 1); 16][..], &links[..])], 2);
        assert_eq!(sums.rejected, 4, "channel {channel}");
    }
}

#[test]
fn the_errors_of_three_blocks_are_those_counted_by_hand() {
    // The picture has three blocks of 5 x 5 pixels in a row, and two rows of pixels below them. In the first block, all errors are 1/4. In the second
    // block, 12 errors are 1/4 and 13 are -1/4. In the third block, one pixel is sky, and the other errors are 0.
    let exact = vec![grey(0.5, 0, 0); 15 * 7];
    let value = |i: usize| {
        let (x, y) = (i % 15, i / 15);
        match (x / 5, y / 5) {
            (0, 0) => grey(0.75, 0, 0),
            (1, 0) if (y * 5 + x % 5) < 12 => grey(0.75, 0, 0),
            (1, 0) => grey(0.25, 0, 0),
            (2, 0) if x == 13 && y == 2 => SKY,
            _ => grey(0.5, 0, 0),
        }
    };
    let picture: Vec<[u32; 2]> = (0..15 * 7).map(value).collect();
    let sums = metrics::reference::seed([15, 7], 5, &picture, &exact);
    assert_eq!((sums.terrain, sums.blocks), (104.0, 2.0));
    // In each of the three channels, the errors of the first block sum to 25/4, and those of the second block to -1/4. There are 50 squares of 1/16.
    assert!((sums.error - 3.0 * 24.0 / 4.0).abs() < 1e-12 && (sums.squared_error - 3.0 * 50.0 / 16.0).abs() < 1e-12, "{sums:?}");
    // The mean error is 1/4 in the first block, and -1/4 x 1/25 = -0.01 in the second.
    let squares = 0.25 * 0.25 + 0.01 * 0.01;
    assert!((sums.block_squares - squares).abs() < 1e-14 && (sums.pixel_squares - 2.0 / 16.0).abs() < 1e-14, "{sums:?}");
    assert!((sums.clumping().expect("errors") - 25.0 * squares * 8.0).abs() < 1e-12);

    // Over three seeds, the values of a pixel are 1/4, 1/2 and 3/4: mean 1/2, unbiased variance 1/16.
    let seeds = [0.25, 0.5, 0.75].map(|value| vec![grey(value, 0, 0), SKY]);
    let sums = metrics::reference::finish(&seeds, &[grey(0.375, 0, 0), SKY]);
    assert_eq!((sums.terrain, sums.bias, sums.variance), (1.0, 0.375, 0.1875));
}

// ---------------------------------------------------------------- temporal

/// A grey picture with these values. A value below 0 stands for sky.
fn greys(values: &[f32]) -> Vec<[u32; 2]> {
    values.iter().map(|&value| if value < 0.0 { SKY } else { grey(value, 1, 1) }).collect()
}

/// The red channel of a resolved picture, and -1 for sky. The channels must be equal.
fn reds(resolved: &[[f64; 4]]) -> Vec<f64> {
    resolved
        .iter()
        .map(|&[r, g, b, a]| {
            assert!(a == 0.0 || a == 1.0 && (r - g).abs() < 1e-15 && (r - b).abs() < 1e-15, "{r} {g} {b} {a}");
            if a > 0.0 { r } else { -1.0 }
        })
        .collect()
}

fn assert_close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14), "{found:?}, not {expected:?}");
}

#[test]
fn flipquad_averages_the_samples_on_four_edges() {
    let size = [3, 2];
    let (now, before) = (greys(&[0.125, 0.25, 0.5, 1.0, -1.0, 2.0]), greys(&[0.5, 0.0, 1.0, 0.25, 0.75, 4.0]));
    let positions = vec![[0.0; 2]; 6];
    let links = [5, NO_LINK, 0, 1, 2, 4];
    let frame = Frame { now: &now, before: &before, links: &links, positions: &positions, history: &[[0.0; 4]; 6] };
    let of = |kind, index| reds(&resolve(kind, size, index, &frame));
    assert_close(&of(Resolve::Off, 1), &[0.125, 0.25, 0.5, 1.0, -1.0, 2.0]);
    // In even frames, the samples are on the left and right edges of pixels. The first frame is not averaged with an earlier frame. A pixel is not
    // averaged with a neighbour that is sky or outside the picture.
    assert_close(&of(Resolve::FlipQuad, 0), &[0.1875, 0.375, 0.5, 1.0, -1.0, 2.0]);
    // In odd frames, the samples are on the top and bottom edges. Those of the frame before are on the left and right edges.
    let own = [(0.125 + 1.0) / 2.0, 0.25, (0.5 + 2.0) / 2.0, 1.0, -1.0, 2.0];
    let past = [4.0, 0.0, (0.5 + 0.0) / 2.0, (0.0 + 1.0) / 2.0, 0.0, (0.75 + 4.0) / 2.0];
    let mean = |i: usize| if links[i] == NO_LINK || own[i] < 0.0 { own[i] } else { (own[i] + past[i]) / 2.0 };
    assert_close(&of(Resolve::FlipQuad, 1), &(0..6).map(mean).collect::<Vec<_>>());
    // In the next even frame, the earlier samples are on the top and bottom edges.
    let own = [0.1875, 0.375, 0.5, 1.0, -1.0, 2.0];
    let past = [4.0, 0.0, (0.5 + 0.25) / 2.0, (0.0 + 0.75) / 2.0, 0.0, 0.75];
    let mean = |i: usize| if links[i] == NO_LINK || own[i] < 0.0 { own[i] } else { (own[i] + past[i]) / 2.0 };
    assert_close(&of(Resolve::FlipQuad, 2), &(0..6).map(mean).collect::<Vec<_>>());
}

#[test]
fn an_exponential_history_is_sampled_clamped_and_mixed() {
    let size = [3, 3];
    let share = f64::from(SHARE);
    // The 3 x 3 box of each pixel contains the values 0 and 1, so a history between 0 and 1 is not clamped.
    let now = greys(&[0.0, 1.0, 0.0, 1.0, 0.5, 1.0, 0.0, 1.0, 0.0]);
    let values: [f64; 9] = [0.0, 1.0, 0.0, 1.0, 0.5, 1.0, 0.0, 1.0, 0.0];
    let of_position = |position: [f32; 2], history: &[[f64; 4]], index: u32, link: u32| {
        let frame = Frame { now: &now, before: &now, links: &[link; 9], positions: &[position; 9], history };
        reds(&resolve(Resolve::Exponential, size, index, &frame))
    };
    let even: Vec<[f64; 4]> = (0..9).map(|i| [f64::from(i) / 16.0; 3]).map(|[r, g, b]| [r, g, b, 1.0]).collect();
    let mixed = |past: f64| values.map(|now| past + share * (now - past));
    // History of pixel 5 at its own centre. Then the history is sampled a quarter of a pixel to the right of pixel 1 and half a pixel below it,
    // between the pixels 1, 2, 4 and 5.
    assert_close(&of_position([2.0, 1.0], &even, 1, 0), &mixed(5.0 / 16.0));
    assert_close(&of_position([1.25, 0.5], &even, 1, 0), &mixed((0.75 * 1.0 + 0.25 * 2.0 + 0.75 * 4.0 + 0.25 * 5.0) / 32.0));
    // A pixel without a history (alpha 0) has no weight in the sample. There is no history outside the picture.
    let mut holed = even.clone();
    holed[2] = [9.0, 9.0, 9.0, 0.0];
    holed[5] = [9.0, 9.0, 9.0, 0.0];
    assert_close(&of_position([1.25, 0.5], &holed, 1, 0), &mixed((1.0 + 4.0) / 32.0));
    assert_close(&of_position([-0.25, 2.5], &even, 1, 0), &mixed(6.0 / 16.0));
    assert_close(&of_position([2.5, -0.25], &even, 1, 0), &mixed(2.0 / 16.0));
    // In these cases, the history is not used: no pixel has a history; the sample is outside the picture; its weight is at most a thousandth of a
    // pixel; there is no link; there is no earlier frame.
    let empty = [[9.0, 9.0, 9.0, 0.0]; 9];
    let mut thin = empty;
    thin[4] = [0.25, 0.25, 0.25, 1.0];
    for (position, history, index, link) in [
        ([1.0, 1.0], &empty, 1, 0),
        ([9.0, 1.0], &thin, 1, 0),
        ([-2.0, 1.0], &thin, 1, 0),
        ([1.0 + 0.999_5, 1.0], &thin, 1, 0),
        ([1.0, 1.0], &thin, 1, NO_LINK),
        ([1.0, 1.0], &thin, 0, 0),
    ] {
        assert_close(&of_position(position, history, index, link), &values);
    }
    assert_close(&of_position([1.0 + 0.998, 1.0], &thin, 1, 0), &mixed(0.25));
    // The history is clamped to the values of the 3 x 3 pixels around a pixel, and not to those of the whole picture.
    let steps = greys(&[0.1, 0.2, 0.3, 0.4, -1.0, 0.6, 0.7, 0.8, 0.9]);
    let f16 = |i: usize| f64::from(signal::colour(steps[i])[0]);
    for past in [2.0, 0.0] {
        let history = [[past, past, past, 1.0]; 9];
        let frame = Frame { now: &steps, before: &steps, links: &[0; 9], positions: &[[1.0, 1.0]; 9], history: &history };
        let found = reds(&resolve(Resolve::Exponential, size, 1, &frame));
        let limit = |i: usize| {
            let near = |j: &usize| (i % 3).abs_diff(j % 3) <= 1 && (i / 3).abs_diff(j / 3) <= 1 && *j != 4;
            let inside = (0..9).filter(near).map(f16);
            if past > 1.0 { inside.fold(f64::MIN, f64::max) } else { inside.fold(f64::MAX, f64::min) }
        };
        let expected = |i: usize| if i == 4 { -1.0 } else { limit(i) + share * (f16(i) - limit(i)) };
        assert_close(&found, &(0..9).map(expected).collect::<Vec<_>>());
    }
}

// ---------------------------------------------------------------- motion

/// Returns what a camera above the plane z = 0 sees. `position`: position of the eye, metres; `yaw`: radians; `jitter`: shift of the samples, pixels.
fn above_ground(position: [f64; 3], yaw: f64, jitter: [f64; 2]) -> Seen {
    let pose = Pose { position: DVec3::from_array(position), yaw, pitch: -0.5, fov: 1.0 };
    let view = View::new(pose, [24, 16], jitter, 64.0, 10_240.0);
    let rays = (0..24 * 16).map(|i| view.ray(f64::from(i % 24), f64::from(i / 24)));
    // Rays within some degrees of the horizon see nothing.
    let distances = rays.map(|ray| if ray.z < -0.1 { -pose.position.z / ray.z } else { 0.0 }).collect();
    Seen { view, distances, planes: vec![DVec3::Z; 24 * 16] }
}

/// Returns the pixel coordinates at which a view shows a point of the world, computed with the projection matrix; `None` if the point is outside the
/// picture.
fn shown(view: &View, point: DVec3) -> Option<[f64; 2]> {
    let clip = view.clip_from_local * (view.camera + point - view.pose.position).extend(1.0);
    let size = DVec2::new(24.0, 16.0);
    let pixel = DVec2::new(clip.x / clip.w * 0.5 + 0.5, 0.5 - clip.y / clip.w * 0.5) * size - 0.5;
    let inside = clip.w > 0.0 && pixel.cmpge(DVec2::splat(-0.5)).all() && pixel.cmplt(size - 0.5).all();
    inside.then_some(pixel.to_array())
}

#[test]
fn points_of_a_plane_are_linked_to_where_they_were() {
    let now = above_ground([3.0, -2.0, 10.0], 0.2, [0.0; 2]);
    let past = above_ground([3.9, -0.4, 9.2], 0.26, [0.0; 2]);
    let (mut linked, mut outside, mut sky) = (0, 0, 0);
    for at in 0..24 * 16 {
        let found = link(&now, &past, at);
        if now.distances[at] <= 0.0 {
            assert_eq!((found.pixel, found.position, found.is_uncertain), (None, None, false), "pixel {at} shows sky");
            sky += 1;
            continue;
        }
        let ray = now.view.ray((at % 24) as f64, (at / 24) as f64);
        let Some([x, y]) = shown(&past.view, now.view.pose.position + ray * now.distances[at]) else {
            assert_eq!((found.pixel, found.position), (None, None), "pixel {at} was outside");
            outside += 1;
            continue;
        };
        let there = (y + 0.5).floor() as usize * 24 + (x + 0.5).floor() as usize;
        // A position within a thousandth of a pixel of a border between two pixels is uncertain.
        let border = [x, y].map(|p| (p - 0.5 - (p - 0.5).round()).abs());
        assert_eq!(found.is_uncertain, border.iter().any(|&off| off < 1e-3), "pixel {at}: {found:?}");
        if past.distances[there] <= 0.0 {
            assert_eq!(found.pixel, None);
            continue;
        }
        let position = found.position.expect("the point was visible");
        assert!(largest_difference(position, [x, y]) < 1e-9, "pixel {at}: {found:?}, not {x} {y}");
        assert_eq!(found.pixel, Some(there), "pixel {at}");
        linked += 1;
    }
    assert!(linked > 200 && outside > 40 && sky > 20, "{linked} {outside} {sky}");
}

#[test]
fn points_behind_other_surfaces_are_not_linked() {
    let now = above_ground([3.0, -2.0, 10.0], 0.2, [0.0; 2]);
    let at = 24 * 10 + 12;
    let still = above_ground([3.0, -2.0, 10.0], 0.2, [0.0; 2]);
    assert_eq!(link(&now, &still, at).pixel, Some(at), "a camera that stands still");
    let tolerance = f64::from(TOLERANCE);
    for (factor, is_linked, is_uncertain) in [
        (1.0 - 0.95 * tolerance, true, false),
        (1.0 + 0.95 * tolerance, true, false),
        (1.0 - 1.05 * tolerance, false, false),
        (1.0 + 1.05 * tolerance, false, false),
        (1.0 + 0.995 * tolerance, true, true),
        (1.0 + 1.005 * tolerance, false, true),
        (0.0, false, false),
    ] {
        let mut past = above_ground([3.0, -2.0, 10.0], 0.2, [0.0; 2]);
        past.distances[at] *= factor;
        let found = link(&now, &past, at);
        assert_eq!((found.pixel.is_some(), found.is_uncertain), (is_linked, is_uncertain), "{factor}: {found:?}");
        assert_eq!(found.position.is_some(), is_linked);
    }
    // The earlier camera sees the plane of the point edge-on, so the expected distance of the point is not known. The link is then uncertain, unless
    // the earlier frame shows sky there.
    let mut edge_on = above_ground([3.0, -2.0, 10.0], 0.2, [0.0; 2]);
    edge_on.planes[at] = now.view.ray(12.0, 10.0).cross(DVec3::X);
    let found = link(&edge_on, &still, at);
    assert_eq!((found.pixel, found.is_uncertain), (None, true));
    let mut nothing = above_ground([3.0, -2.0, 10.0], 0.2, [0.0; 2]);
    nothing.distances[at] = 0.0;
    let found = link(&edge_on, &nothing, at);
    assert_eq!((found.pixel, found.is_uncertain), (None, false));
    // The samples of the earlier frame are shifted by 0.5004 pixels. So each point lies within a thousandth of a pixel of a border between two
    // pixels, and its link must be uncertain. The points of the last column are outside the earlier picture.
    let shifted = above_ground([3.0, -2.0, 10.0], 0.2, [-0.5004, 0.0]);
    let visible: Vec<usize> = (0..24 * 16).filter(|&at| now.distances[at] > 0.0).collect();
    assert!(visible.len() > 100);
    for at in visible {
        let found = link(&now, &shifted, at);
        assert!(found.is_uncertain, "pixel {at}: {found:?}");
        assert_eq!(found.pixel, (at % 24 < 23).then_some(at + 1), "pixel {at}");
    }
}

//! Compares functions of `kernels::shared` with closed forms, at arguments where a small fault shows: exact words, limits of ranges, and points whose
//! result follows directly from the definition. `shared.rs` compares functions with formulas over whole ranges, and `properties.rs` tests properties
//! such as symmetries.

use kernels::base::wgsl::Constant;
use kernels::shared::blue_noise::RANKS;
use kernels::shared::hex_tiling::{self, HexTiling};
use kernels::shared::moments::Moments;
use kernels::shared::motion::{self, Past};
use kernels::shared::noise::{self, HashedPoint, NoiseKind};
use kernels::shared::real::{self, length, scale};
use kernels::shared::splat_blend::Run;
use kernels::shared::{
    biplanar, brdf, flavour_weights, hash, octahedral, select, signal, snapped_projection, texel_choice, triplanar, view,
};

use crate::statistics::Random;

fn largest_difference<const N: usize>(a: [f64; N], b: [f64; N]) -> f64 {
    (0..N).map(|i| (a[i] - b[i]).abs()).fold(0.0, f64::max)
}

// ---------------------------------------------------------------- words

#[test]
fn the_hash_of_a_word_has_its_published_values() {
    // One step of PCG's generator and its output function RXS-M-XS (O'Neill 2014), computed from the paper outside this project.
    let published = [
        (0, 129_708_002),
        (1, 2_831_084_092),
        (2, 2_055_130_248),
        (3, 2_131_687_100),
        (0xdead_beef, 1_730_779_506),
        (u32::MAX, 3_861_530_882),
    ];
    for (word, expected) in published {
        assert_eq!(hash::pcg(word), expected, "{word:#x}");
    }
    assert_eq!([hash::mix(1, 2, 3), hash::mix(0, 0, 0)], [3_404_032_338, 2_145_236_065]);
}

#[test]
fn a_packed_pixel_has_the_documented_bits() {
    // 1, 2 and -0.5 are 0x3c00, 0x4000 and 0xb800 in f16.
    assert_eq!(signal::pack([1.0, 2.0, -0.5], 3, 5), [0x4000_3c00, 0x8000_0000 | 5 << 26 | 3 << 16 | 0xb800]);
    assert_eq!(signal::colour(signal::pack([1e6, -1e6, 0.0], 0, 0)), [65_504.0, -65_504.0, 0.0]);
    assert_eq!(signal::pack([1.0, f32::INFINITY, 1.0], 3, 5), signal::INVALID);
    for (colour, luminance) in [([1.0, 0.0, 0.0], 0.2126), ([0.0, 1.0, 0.0], 0.7152), ([0.0, 0.0, 1.0], 0.0722)] {
        assert!((signal::luminance(colour) - luminance).abs() < 1e-15);
    }
}

#[test]
fn the_bits_of_all_flavours_reach_the_shader() {
    let constants = kernels::shared::FLAVOUR_WEIGHTS.constants;
    assert!(constants.contains(&("FLAVOUR_BITS", Constant::U32(31))), "{constants:?}");
}

// ---------------------------------------------------------------- limits

#[test]
fn a_vector_without_direction_counts_as_the_z_axis() {
    let z = [0.0, 0.0, 1.0];
    for none in [[0.0; 3], [f64::INFINITY, 0.0, 0.0], [f64::NAN, 1.0, 0.0], [1e-200, 0.0, 0.0]] {
        assert_eq!(real::normalize(none), z, "{none:?}");
    }
    assert_eq!(real::normalize([0.0, -4.0, 0.0]), [0.0, -1.0, 0.0]);
    for none in [[0.0; 3], [1e-30, 0.0, 0.0], [1.1e30, 0.0, 0.0], [0.0, f64::NAN, 1.0], [f64::INFINITY, 0.0, 0.0]] {
        assert_eq!(octahedral::unit(none), z, "{none:?}");
        assert_eq!(octahedral::unit(none.map(|x| x as f32)), [0.0, 0.0, 1.0], "{none:?} in f32");
    }
    for x in [1.1e-30, 1.0, 1e30] {
        assert_eq!(octahedral::unit([-x, 0.0, 0.0]), [-1.0, 0.0, 0.0], "{x}");
    }
    // Numbers beyond the last code count as the last code.
    assert_eq!(octahedral::dequantise::<f64>([u32::MAX, 300], 8), [1.0, 1.0]);
}

#[test]
fn weights_count_from_the_smallest_number_that_is_not_denormal() {
    for i in 1..4 {
        let with = |weight: f32| std::array::from_fn(|k| if k == i { weight } else { 0.0 });
        assert_eq!(select::of_4(with(f32::MIN_POSITIVE), 0.5), i);
        assert_eq!(select::of_4(with(f32::MIN_POSITIVE / 2.0), 0.5), 0, "a denormal number counts as 0");
    }
    // A flavour with a weight of exactly the limit is left out.
    let least = flavour_weights::MIN_WEIGHT;
    let masks = [least, least * 1.001].map(|weight| flavour_weights::mask([weight, 0.0, 0.0, 0.0, 0.0]));
    assert_eq!(masks, [2, 1], "an empty mask becomes far atlas");
    assert_eq!(flavour_weights::weights_for([least, 1.0, 0.0, 0.0, 0.0], 0b11, false), [0.0, 1.0, 0.0, 0.0, 0.0]);
    let [first, second, ..] = flavour_weights::weights_for([least * 2.0, 1.0, 0.0, 0.0, 0.0], 0b11, false);
    assert!((first / second - 2.0 * least).abs() < 1e-15);
}

#[test]
fn coordinates_beyond_the_range_count_as_zero() {
    let far = [1e30, 2e30, f64::NAN];
    assert_eq!(snapped_projection::coordinates(far, 2), [1e30, 0.0]);
    assert_eq!(snapped_projection::coordinates(far, 0), [0.0, 0.0]);
    assert_eq!(snapped_projection::from_gradient([2e30, 0.5], 0), [0.0, 0.0, 0.5]);
    // A plane or axis with an invalid index counts as the projection from above.
    assert_eq!(snapped_projection::coordinates([1.0, 2.0, 3.0], 5), [1.0, 2.0]);
    assert_eq!(triplanar::coordinates([1.0, 2.0, 3.0], 7), [1.0, 2.0]);
}

#[test]
fn a_steep_gradient_is_reduced_and_keeps_its_direction() {
    let up = [0.0, 0.0, 1.0];
    for direction in [[1.0_f64, 0.0, 0.0], [0.6, -0.8, 0.0]] {
        let reduced = triplanar::perturb(up, scale(direction, 1e6 / direction[0].abs().max(direction[1].abs())));
        assert!(largest_difference(triplanar::perturb(up, scale(direction, 1e9)), reduced) < 1e-15, "{direction:?}");
        // The larger component of the gradient is reduced to 1e6. So the vertical component of the normal is 1e-6 times the larger horizontal one.
        let horizontal = reduced[0].abs().max(reduced[1].abs());
        assert!((reduced[2] / horizontal - 1e-6).abs() < 1e-15, "{reduced:?}");
    }
    assert!(largest_difference(triplanar::perturb(up, [1e30, f64::NAN, 0.0]), up) == 0.0, "a gradient that is not finite changes nothing");
}

// ---------------------------------------------------------------- choices

#[test]
fn levels_and_texels_are_chosen_by_the_fraction() {
    // The upper level is chosen if the random number is below the fraction of the level.
    for (lod, u, level) in
        [(2.25, 0.0, 3), (2.25, 0.2, 3), (2.25, 0.25, 2), (2.25, 0.9, 2), (2.0, 0.0, 2), (-1.0, 0.0, 0), (4.5, 0.25, 5), (9.5, 0.0, 5)]
    {
        assert_eq!(texel_choice::level(lod, 6, u), level, "level {lod}, {u}");
        assert_eq!(texel_choice::level(lod, 0, u), 0, "a texture has at least one level");
    }
    // Texel i of 4 has its centre at (i + 1/2) / 4. Coordinates beyond 1e5 count as 0.
    for (coordinate, u, texel) in [
        (0.375, 0.0, 1),
        (0.375, 0.99, 1),
        (0.5, 0.25, 2),
        (0.5, 0.5, 1),
        (0.5, 0.75, 1),
        (0.4375, 0.2, 2),
        (0.4375, 0.3, 1),
        (0.0, 0.25, 0),
        (0.0, 0.75, 3),
        (-0.25, 0.25, 3),
        (-0.25, 0.75, 2),
        (99_999.375, 0.5, 1),
        (150_000.375, 0.25, 0),
    ] {
        assert_eq!(texel_choice::texel(coordinate, 4, u), texel, "coordinate {coordinate}, {u}");
    }
}

#[test]
fn a_term_without_weight_leaves_a_run_as_it_is() {
    let run = Run::start().add(0.25, 0.5, 8.0).add(0.5, 0.9, 8.0);
    // The second term of the blend is larger than the first. So `keep`, the factor on the first term, is the first term divided by the second.
    assert!((run.keep - 0.5 * (8.0 * (0.5 - 0.9_f64)).exp2()).abs() < 1e-15 && run.share == 1.0, "{run:?}");
    let after = run.add(0.0, 1.0, 8.0);
    assert_eq!([after.keep, after.share], [1.0, 0.0]);
    assert_eq!(after.add(0.1, 0.2, 8.0), run.add(0.1, 0.2, 8.0));
}

// ---------------------------------------------------------------- noise

/// Returns the cell of a point, computed from the coordinates relative to the origin of the world. (The tested functions compute it from the sector
/// and the position in the sector.) For the points of [`hashed_points`], each step is exact in f64.
fn cell(point: &HashedPoint<f64>, k: [i32; 3]) -> [u32; 3] {
    [0, 1, 2].map(|axis| {
        let corner = point.sector.get(axis).map_or(0.0, |&sector| f64::from(sector) * point.sector_m);
        // Along the elevation, a cell begins a third of its height above a multiple of its height. Its number is that of the next multiple above.
        let border = if axis == 2 { noise::BORDER - 1.0 } else { 0.0 };
        ((corner + point.position[axis]) * f64::from(k[axis]).exp2() - border).floor() as i64 as u32
    })
}

/// The four random numbers of a cell.
fn units(point: &HashedPoint<f64>, k: [i32; 3], seed: u32, salt: u32) -> [f64; 4] {
    let [a, b, c] = k.map(|k| u32::try_from(k + 128).expect("a scale is small"));
    let [x, y, z] = cell(point, k);
    hash::pcg4d([x, y, z, hash::mix(seed, salt, a + 256 * b + 65_536 * c)]).map(|h| f64::from(h / 256) / 16_777_216.0)
}

/// Random points up to about 1000 km east, west, north or south of the origin. Positions are multiples of 2^-16 m. Some footprints are smaller than
/// the smallest cells or larger than the largest cells.
fn hashed_points() -> impl Iterator<Item = HashedPoint<f64>> {
    let mut random = Random(71);
    (0..3000).map(move |i| {
        let sector = [0; 2].map(|_: i32| random.below(32_000) as i32 - 16_000);
        let position = [0.0; 3].map(|_: f64| random.below(4_194_304) as f64 / 65_536.0);
        let footprint = if i % 50 == 0 { 0.0 } else { random.between(-22.0, 9.0).exp2() };
        let (ddx, ddy) = (scale(random.direction(), footprint), scale(random.direction(), footprint * random.between(0.0, 2.0)));
        HashedPoint { sector, position, sector_m: 64.0, ddx, ddy, hash_scale: random.between(0.25, 4.0) }
    })
}

/// Returns the finest scale along an axis whose coordinates are at most `largest` in magnitude, metres. A scale is the log2 of cells per metre; the
/// finest one is clamped to -4..=16. Before clamping, a cell of the finest scale is 16 or 32 times as wide as the step from `largest` to the next
/// larger f32.
fn finest(largest: f64) -> i32 {
    (FINEST_AT_1_M - largest.abs().log2().round() as i32).clamp(-4, 16)
}

/// The finest scale for `largest` = 1 m, without the clamp. The next larger f32 is 2^-23 m away, and a cell is 16 times as wide, which is 2^-19 m.
const FINEST_AT_1_M: i32 = 19;

/// Returns the coarser of the two blended scales, and the weight of the finer one, for cells that are `width` metres wide. The level of such a cell
/// is -log2(`width`), the log2 of cells per metre. The coarser scale is the whole number below the level.
fn scales(width: f64, finest: i32) -> (i32, f64) {
    let level = (-width.clamp(1e-6, 1e6).log2()).clamp(-5.0, f64::from(finest));
    // The upper scale is never finer than the finest one.
    let k = (level.floor() as i32).min(finest - 1);
    (k, level - f64::from(k))
}

#[test]
fn hashed_noise_blends_the_two_cells_of_the_paper() {
    let mut ends = [0; 2];
    for point in hashed_points() {
        let extent = length(point.ddx).max(length(point.ddy));
        let along = [point.sector_m, point.sector_m, point.position[2]].map(finest);
        let finest = along[0].min(along[2]);
        let (k, share) = scales(point.hash_scale * extent, finest);
        ends[0] += usize::from(k == finest - 1);
        ends[1] += usize::from(k == -5);
        let found = noise::isotropic_scales(&point, 9, 4);
        assert_eq!((found.coarse, found.fine), (units(&point, [k; 3], 9, 4), units(&point, [k + 1; 3], 9, 4)), "{point:?}");
        assert!((found.lerp_factor - share).abs() < 1e-12, "{point:?}: {found:?}");
        let blended: [f64; 4] = std::array::from_fn(|i| found.coarse[i] + share * (found.fine[i] - found.coarse[i]));
        assert!(largest_difference(found.blended(), blended) < 1e-12);
        assert!(largest_difference(found.thresholds(), blended.map(|x| noise::correct(x, share))) < 1e-9);

        // The anisotropic kind: each axis has its own scale. The width of a cell along an axis is √2 times `hash_scale` times the larger component
        // of the two derivatives along this axis (Wyman & McGuire 2017, listing 3), but at least a sixteenth of the largest of the three widths.
        let widths: [f64; 3] = std::array::from_fn(|i| 2.0_f64.sqrt() * point.hash_scale * point.ddx[i].abs().max(point.ddy[i].abs()));
        let least = widths.iter().fold(0.0, |a: f64, b| a.max(*b)) / 16.0;
        let axes: [(i32, f64); 3] = std::array::from_fn(|i| scales(widths[i].max(least), along[i]));
        let (k, part) = (axes.map(|a| a.0), axes.map(|a| a.1));
        let found = noise::anisotropic_scales(&point, 9, 4);
        assert_eq!((found.coarse, found.fine), (units(&point, k, 9, 4), units(&point, k.map(|k| k + 1), 9, 4)), "{point:?}");
        let [to_coarse, to_fine] = [length(part), length(part.map(|p| 1.0 - p))];
        assert!((found.lerp_factor - to_coarse / (to_coarse + to_fine)).abs() < 1e-12, "{point:?}: {found:?}");

        assert_eq!(noise::white_world(&point, 5, 9, 4), units(&point, [5; 3], 9, 4));
    }
    assert!(ends.iter().all(|&count| count > 50), "{ends:?} footprints lie at the ends of the range");
}

#[test]
fn tiny_positions_and_ranks_beyond_the_last_are_held() {
    let point = hashed_points().next().expect("points");
    let at = |position| noise::cell(&HashedPoint { position, ..point }, [4, 5, 6]);
    assert_eq!(at([-1e-31, 1e-31, -1e-31]), at([0.0; 3]));
    assert_ne!(at([-1e-29, 0.0, 0.0]), at([0.0; 3]), "a border between two cells lies at 0");
    let mask = |rank| noise::mask::<f64>(NoiseKind::Blue, [5, 6], 7, 8, 9, [rank; 4]);
    assert_eq!(mask(RANKS), mask(RANKS - 1));
    assert_eq!(mask(u32::MAX), mask(RANKS - 1));
    assert_ne!(mask(RANKS - 2), mask(RANKS - 1));
}

// ---------------------------------------------------------------- projections

#[test]
fn biplanar_weights_are_the_formula() {
    let mut random = Random(73);
    let diagonal = 1.0 / 3.0_f64.sqrt();
    for _ in 0..5000 {
        let n = random.direction();
        let k = random.between(0.1, 64.0);
        let mut order = [0, 1, 2];
        order.sort_by(|&a: &usize, &b: &usize| n[b].abs().total_cmp(&n[a].abs()));
        let mut axes = [order[0], order[1]];
        axes.sort_unstable();
        let powers = axes.map(|axis| ((n[axis].abs() - diagonal) / (1.0 - diagonal)).max(0.0).powf(k / 8.0));
        // At least one power is above 0, because the largest component of a unit vector is at least 1/√3 (`diagonal`).
        let weights = powers.map(|power| power / (powers[0] + powers[1]));
        let (found_axes, found) = biplanar::projections(scale(n, 3.0), k);
        assert_eq!(found_axes.map(|axis| axis as usize), axes, "{n:?}");
        assert!(largest_difference(found, weights) < 1e-9, "{n:?}, {k}: {found:?}, not {weights:?}");
    }
    // With sharpness 0, all axes whose component exceeds 1/√3 have equal weights, and the other axes have none.
    assert_eq!(biplanar::projections([0.9, 0.3, 0.1], 0.0), ([0, 1], [1.0, 0.0]));
    assert_eq!(biplanar::projections([0.1, 0.3, 0.9], 0.0), ([1, 2], [0.0, 1.0]));
    assert_eq!(biplanar::projections([-1.0, 1.0, 0.0], 0.0), ([0, 1], [0.5, 0.5]));
}

#[test]
fn whole_sectors_have_the_coordinates_of_their_positions() {
    for place in [[5, -7, 3], [-11, 2, 40], [0, 1, 0]] {
        for plane in 0..6 {
            let [u, v] = snapped_projection::sectors(place, plane).map(f64::from);
            // On a diagonal plane, `sectors` returns the first coordinate without the factor 181/256, so that it is a whole number.
            let factor = if plane == 3 || plane == 4 { 181.0 / 256.0 } else { 1.0 };
            assert_eq!(snapped_projection::coordinates(place.map(f64::from), plane), [u * factor, v], "{place:?} on plane {plane}");
        }
    }
}

/// Twice the area of a triangle.
fn area([a, b, c]: [[f64; 2]; 3]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[test]
fn hexagons_are_blended_by_areas_to_the_seventh_power() {
    let mut random = Random(79);
    for level in -3..=10 {
        let spacing = 64.0 / f64::from(level).exp2();
        for _ in 0..300 {
            let p = [random.between(-100.0, 200.0), random.between(-100.0, 200.0)];
            let HexTiling { ids, weights } = hex_tiling::at([0; 2], p, 64.0, level);
            // Hexagon (i, j) has its centre at i (1, 0) + j (1/2, 32/37) spacings; 32/37 is nearly √3/2. Ids count modulo 2^16.
            let signed = |id: u32| if id < 32_768 { f64::from(id) } else { f64::from(id) - 65_536.0 };
            let centres = ids.map(|[i, j]| [(signed(i) + 0.5 * signed(j)) * spacing, signed(j) * spacing * 32.0 / 37.0]);
            let apart = |i: usize, j: usize| (centres[i][0] - centres[j][0]).hypot(centres[i][1] - centres[j][1]) / spacing;
            for (i, j) in [(0, 1), (1, 2), (2, 0)] {
                assert!((apart(i, j) - 1.0).abs() < 2e-3, "{ids:?} are not neighbours");
            }
            let whole = area(centres);
            let shares: [f64; 3] = std::array::from_fn(|i| {
                let mut corners = centres;
                corners[i] = p;
                area(corners) / whole
            });
            assert!(shares.iter().all(|&share| share > -1e-9), "{p:?} lies outside its triangle: {shares:?}");
            let powers = shares.map(|share| share.max(0.0).powi(7));
            let sum: f64 = powers.iter().sum();
            assert!(largest_difference(weights, powers.map(|power| power / sum)) < 1e-9, "{p:?}, level {level}: {weights:?}");
        }
    }
    let centre = hex_tiling::at([0; 2], [0.0; 2], 64.0, 3);
    assert_eq!((centre.ids[0], centre.weights), ([0, 0], [1.0, 0.0, 0.0]));
    // The level gives about 2√3 hexagons per repeat of the texture, within a factor of √2. The last line tests the lowest and the highest level.
    for _ in 0..1000 {
        let repeats = random.between(-10.0, 12.0).exp2();
        let off = f64::from(hex_tiling::level(repeats)) - (repeats * 12.0_f64.sqrt()).log2();
        assert!(off.abs() <= 0.5 + 1e-12, "{repeats} repeats: {off} octaves off");
    }
    assert_eq!([0.0, 1e9, f64::NAN].map(hex_tiling::level), [-10, 15, -10]);
}

// ---------------------------------------------------------------- light

#[test]
fn the_fit_of_the_environment_is_the_published_one() {
    // `EnvBRDFApprox` (Karis 2014), computed from the published code outside this project: reflectance, roughness, n.v, result.
    let published: [[f64; 4]; 7] = [
        [0.04, 0.1, 0.1, 0.513_469_364_594_924_9],
        [0.04, 0.5, 0.5, 0.049_885_444_001_981_32],
        [0.04, 0.9, 1.0, 0.018_690_200_248_367_18],
        [0.5, 0.3, 0.8, 0.420_729_603_831_229_76],
        [1.0, 0.2, 0.3, 0.89],
        [1.0, 0.7, 0.05, 0.615],
        [0.0, 0.25, 0.0, 0.4413],
    ];
    for [f0, roughness, n_dot_v, expected] in published {
        let [found, ..] = brdf::env_approx([f0; 3], roughness, n_dot_v);
        assert!((found - expected).abs() < 1e-12, "{f0} {roughness} {n_dot_v}: {found}, not {expected}");
    }
}

#[test]
fn reflection_terms_are_the_formulas() {
    let mut random = Random(83);
    for _ in 0..2000 {
        let (c, alpha) = (random.unit(), random.between(brdf::MIN_ALPHA, 1.0));
        let bracket = c * c * (alpha * alpha - 1.0) + 1.0;
        let textbook = alpha * alpha / (std::f64::consts::PI * bracket * bracket);
        // Near c = 1, two numbers in the bracket of the textbook form nearly cancel. This enlarges the relative rounding error of the bracket by up
        // to 1 / alpha². The formula squares the bracket, which doubles this error.
        assert!((brdf::d_ggx(c, alpha) / textbook - 1.0).abs() < 32.0 * f64::EPSILON / (alpha * alpha), "{c} {alpha}");
        let (f0, u) = (random.unit(), random.unit());
        let [schlick, ..] = brdf::f_schlick([f0; 3], u);
        assert!((schlick - (f0 + (1.0 - f0) * (1.0 - u).powf(5.0))).abs() < 1e-14, "{f0} {u}");
    }
    assert!((brdf::v_smith_ggx_correlated(0.0_f64, 0.0, 0.5) / 5e6 - 1.0).abs() < 1e-12);
}

// ---------------------------------------------------------------- moments

#[test]
fn moments_add_their_parts_and_need_two_samples() {
    let moments = Moments { mean: [2.0, 0.5], squares: [1.0, 0.25], count: 3 };
    assert_eq!([moments.mean(), moments.variance()], [2.5, 0.625]);
    for count in [0, 1] {
        let few = Moments { count, ..moments };
        assert_eq!((few.variance(), few.standard_error()), (0.0, None), "{count} samples");
    }
    let two = Moments { squares: [8.0, 0.0], count: 2, ..moments };
    assert_eq!((two.variance(), two.standard_error()), (8.0, Some(2.0)));
}

#[test]
fn moments_lose_nothing_that_two_parts_can_hold() {
    // The second sample changes the mean by half of its difference from the first, and the sum of squares by half of the squared difference. In f32,
    // each of these sums is rounded. The two parts of a result together must be exact, whichever summand is larger.
    for [mean, sample] in [[1e-3_f32, 2e4], [3e5, 0.7], [-1e-3, 5.0], [4e4, -1.3], [0.1, 0.7]] {
        let squares = 3.0 * mean.abs();
        let mut moments = Moments { mean: [mean, 0.0], squares: [squares, 0.0], count: 1 };
        moments.add([sample, 0.0]);
        let difference = sample - mean;
        assert_eq!(moments.mean(), f64::from(mean) + f64::from(difference / 2.0), "{mean} {sample}");
        let found = f64::from(moments.squares[0]) + f64::from(moments.squares[1]);
        assert_eq!(found, f64::from(squares) + f64::from(difference * (difference * 0.5)), "{mean} {sample}");
        assert_eq!(moments.count, 2);
    }
    // A sample that is too far from the mean, or not finite, counts as the mean; as the first sample, it counts as 0.
    for far in [1e16, -1e16, f64::NAN, f64::INFINITY] {
        let mut moments = Moments { mean: [1.0, 0.0], squares: [2.0, 0.0], count: 1 };
        moments.add([far, 0.0]);
        assert_eq!((moments.mean(), moments.squares, moments.count), (1.0, [2.0, 0.0], 2), "{far}");
        let mut first = Moments::<f64>::new();
        first.add([far, 0.0]);
        assert_eq!((first.mean(), first.count), (0.0, 1), "{far}");
    }
    let mut limit = Moments::<f64>::new();
    limit.add([1e15, 0.25]);
    assert_eq!(limit.mean, [0.0; 2], "the limit includes the lower part");
    limit.add([1e15, 0.0]);
    assert_eq!(limit.mean(), 5e14);
}

// ---------------------------------------------------------------- earlier cameras

/// A camera that looks along y. A direction with a slope of 1 to the right or upwards is 10 pixels from the view direction.
fn along_y() -> Past<f64> {
    Past { offset: [0.0; 3], forward: [0.0, 1.0, 0.0], x_row: [10.0, 0.0, 0.0], y_row: [0.0, 0.0, -10.0], x_shift: 0.5, y_shift: -0.25 }
}

const NOWHERE: [f64; 3] = [-1e9, -1e9, 0.0];

#[test]
fn an_earlier_camera_sees_points_where_its_rays_go() {
    let past = Past { offset: [1.0, 2.0, 3.0], ..along_y() };
    // Relative to the earlier eye, the point is at (2, 5, 4): 5 m along the view direction, and per metre of this distance 0.4 m to the right and 0.8
    // m up.
    let seen = motion::reproject([1.0, 3.0, 1.0], &past);
    assert!(largest_difference(seen, [3.5, -7.75, 5.0]) < 1e-14, "{seen:?}");
    let ray = motion::past_ray(&past, [3.5, -7.75]);
    assert!(largest_difference(ray, [0.4, 1.0, 0.8]) < 1e-15, "{ray:?}");
    // A point has no pixel if its distance is exactly at a limit, or if it is behind the camera.
    let past = along_y();
    for distance in [motion::MIN_DISTANCE, motion::FAR, -1.0, 0.0, f64::NAN] {
        assert_eq!(motion::reproject([0.0, distance, 0.0], &past), NOWHERE, "{distance}");
    }
    for distance in [motion::MIN_DISTANCE * 1.01, motion::FAR * 0.99] {
        assert_eq!(motion::reproject([0.0, distance, 0.0], &past), [-0.5, 0.25, distance]);
    }
    // A point has no pixel if a coordinate of the pixel would exceed 1e9.
    assert_eq!(motion::reproject([2e5, 1e-3, 0.0], &past), NOWHERE);
    assert_eq!(motion::past_ray(&Past { x_row: [0.0; 3], ..past }, [1.0, 1.0]), [0.0; 3]);
}

#[test]
fn rays_meet_planes_only_before_the_camera_and_not_edge_on() {
    let past = along_y();
    let met = |point: [f64; 3], ray: [f64; 3], normal: [f64; 3]| motion::expected_distance(point, &past, ray, normal);
    let facing = [0.0, 1.0, 0.0];
    assert_eq!(met([2.0, 5.0, 4.0], [0.3, 1.0, 0.0], facing), 5.0);
    assert_eq!(met([2.0, 5.0, 4.0], [0.3, -1.0, 0.0], facing), 0.0, "behind the camera");
    for distance in [motion::MIN_DISTANCE, motion::FAR] {
        assert_eq!(met([0.0, distance, 0.0], [0.0, 1.0, 0.0], facing), 0.0, "exactly at a limit");
    }
    // A plane counts as edge-on if the cosine of the angle between its normal and the ray has a magnitude of at most 1e-6. The length of the ray does
    // not matter.
    assert_eq!(met([2.0, 5.0, 4.0], [1.0, 0.0, 0.0], [1e-6, 1.0, 0.0]), 0.0);
    assert_eq!(met([2.0, 5.0, 4.0], [100.0, 0.0, 0.0], [5e-7, 1.0, 0.0]), 0.0);
    let found = met([2.0, 5.0, 4.0], [100.0, 0.0, 0.0], [2e-6, 1.0, 0.0]);
    assert!((found / ((4e-6 + 5.0) / 2e-4) - 1.0).abs() < 1e-12, "{found}");
    assert_eq!(met([2.0, 5000.0, 4.0], [1.0, 0.0, 0.0], [2e-6, 1.0, 0.0]), 0.0, "beyond the largest distance");
}

#[test]
fn surfaces_are_the_same_within_the_tolerance() {
    for (found, expected, tolerance, is_same) in [
        (1.0, 1.0, 0.0, true),
        (1.5, 1.0, 0.5, true),
        (0.5, 1.0, 0.5, true),
        (1.6, 1.0, 0.5, false),
        (0.4, 1.0, 0.5, false),
        (30.0, 20.0, 0.5, true),
        (31.0, 20.0, 0.5, false),
        (0.0, 1.0, 2.0, false),
        (-1.0, 1.0, 5.0, false),
        (1.0, -1.0, -5.0, false),
        (f64::NAN, 1.0, 1.0, false),
    ] {
        assert_eq!(motion::same_surface(found, expected, tolerance), is_same, "{found} {expected} {tolerance}");
    }
}

#[test]
fn a_quarter_has_one_of_each_four_rows_and_moves_by_one_row() {
    let rows = |quarter| (0..32).filter(|&row| motion::in_quarter(row, quarter)).collect::<Vec<_>>();
    assert_eq!(rows(0), [0, 5, 10, 15, 16, 21, 26, 31]);
    assert_eq!(rows(1), [1, 6, 11, 12, 17, 22, 27, 28]);
    assert_eq!(rows(2), [2, 7, 8, 13, 18, 23, 24, 29]);
    assert_eq!(rows(3), [3, 4, 9, 14, 19, 20, 25, 30]);
}

#[test]
fn positions_follow_from_rays_and_reversed_depth() {
    let rays = [[1.0, 2.0, 3.0], [0.5, 0.0, 0.125], [0.0, 0.25, -0.25]];
    assert_eq!(view::ray(rays, [4.0, 8.0]), [3.0, 4.0, 1.5]);
    assert_eq!(view::distance(0.5, 0.03125), 16.0);
    assert_eq!(view::distance(0.5, 1.0), 0.5);
    for nothing in [0.0, -0.5, 1e-31, f64::NAN] {
        assert_eq!(view::distance(0.5, nothing), 0.0, "{nothing}");
    }
    assert!((view::distance(0.5_f64, 2e-30) / 2.5e29 - 1.0).abs() < 1e-12);
}

//! Probes of directions, planes and projections.

use super::judge::{
    Draw, EPS, UNIT_TOLERANCE, Verdict, angle_deg, both, close, farthest, from_axis, from_seam, keyed, relative, set_direction,
    set_direction_and_length, set_length, three,
};
use super::{EXACT, Measure, Parameter, Probe, real, take, whole};
use crate::shared::real::{Real, add, dot, length, scale, sub};
use crate::shared::{biplanar, derivatives, normal_pair, octahedral, snapped_projection, triplanar};

/// Draws a random unit normal. `degrees` is the angle between it and the reversed ray. If this angle is below 90 degrees, a plane with this normal
/// faces the ray.
fn facing(ray: [f64; 3], degrees: f64, d: &mut Draw) -> [f64; 3] {
    d.leaning(octahedral::unit(ray).map(|x| -x), degrees.to_radians())
}

pub(super) const OCTAHEDRAL: Probe = Probe {
    name: "octahedral",
    about: "A direction as an octahedral code of 8 + 8 bits (the best of the four codes around it), and the decoded direction",
    inputs: &[real("n_x", "direction, any length"), real("n_y", "direction"), real("n_z", "direction")],
    outputs: &[
        real("e_x", "continuous code, -1..1"),
        real("e_y", "continuous code, -1..1"),
        whole("code_x", "8-bit code", 0, 254),
        whole("code_y", "8-bit code", 0, 254),
        real("decoded_x", "unit vector"),
        real("decoded_y", "unit vector"),
        real("decoded_z", "unit vector"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 3>) -> array<f32, 7> {
let n = vec3<f32>(row[0], row[1], row[2]);
let e = octahedral_encode(n);
let stored = octahedral_encode8_precise(n);
let code = round(stored * 255.0);
let decoded = octahedral_decode(octahedral_dequantise8(stored));
return array<f32, 7>(e.x, e.y, code.x, code.y, decoded.x, decoded.y, decoded.z);
}",
    single: octahedral_row,
    double: octahedral_row,
    random: |d| d.vector(-20.0, 20.0).to_vec(),
    judge: octahedral_judge,
    measures: &[Measure {
        name: "direction",
        unit: "deg",
        error: |row, got, want| {
            // Codes are not compared, because two codes may be equally near. The error is the difference between two angles: from the input to the
            // decoded result, and from the input to the decoded reference.
            let n = octahedral::unit(three(row, 0));
            let off = |v: &[f64]| angle_deg(three(v, 4), n);
            (off(got) - off(want)).abs()
        },
    }],
    parameters: &[
        Parameter { name: "length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter { name: "from_axis_deg", unit: "deg off an axis", set: |row, value, d| set_direction(row, 0, from_axis(value, d)) },
        Parameter {
            name: "from_seam_deg",
            unit: "deg off the fold x = 0 below the equator",
            set: |row, value, d| set_direction(row, 0, from_seam(value, d)),
        },
        Parameter { name: "component", unit: "1, all three", set: |row, value, _| row[..3].fill(value) },
    ],
};

pub(super) const OCTAHEDRAL_CODES: Probe = Probe {
    name: "octahedral-codes",
    about: "A direction as octahedral codes of 2 to 16 bits, chosen per coordinate and by the nearest direction, and both decoded directions",
    inputs: &[
        real("n_x", "direction, any length"),
        real("n_y", "direction"),
        real("n_z", "direction"),
        whole("bits", "bits of each coordinate", 2, 16),
    ],
    outputs: &[
        whole("fast_u", "code nearest to the coordinate", -32_767, 32_767),
        whole("fast_v", "code", -32_767, 32_767),
        whole("exact_u", "code of the nearest direction", -32_767, 32_767),
        whole("exact_v", "code", -32_767, 32_767),
        real("fast_x", "unit vector"),
        real("fast_y", "unit vector"),
        real("fast_z", "unit vector"),
        real("exact_x", "unit vector"),
        real("exact_y", "unit vector"),
        real("exact_z", "unit vector"),
    ],
    blocks: None,
    // octahedral_encode_precise requires that `half` times `step`, rounded to f32, is 1. If the division is correctly rounded, this holds for 2 to 16
    // bits.
    wgsl: "\
fn probe(row: array<f32, 4>) -> array<f32, 10> {
let n = vec3<f32>(row[0], row[1], row[2]);
let half = f32((1u << (u32(row[3]) - 1u)) - 1u);
let step = 1.0 / half;
let fast = octahedral_quantise(octahedral_encode(n), half);
let exact = octahedral_encode_precise(n, half, step);
let f = octahedral_decode(fast * step);
let e = octahedral_decode(exact * step);
return array<f32, 10>(fast.x, fast.y, exact.x, exact.y, f.x, f.y, f.z, e.x, e.y, e.z);
}",
    single: octahedral_codes_row,
    double: octahedral_codes_row,
    random: |d| [&d.vector(-20.0, 20.0)[..], &[[8.0, 10.0, 12.0, 16.0][d.word() as usize % 4]]].concat(),
    judge: octahedral_codes_judge,
    measures: &[
        Measure { name: "fast code", unit: "deg farther", error: |row, got, want| farther(row, got, want, 4) },
        Measure { name: "exact code", unit: "deg farther", error: |row, got, want| farther(row, got, want, 7) },
    ],
    parameters: &[
        Parameter { name: "length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter { name: "from_axis_deg", unit: "deg off an axis", set: |row, value, d| set_direction(row, 0, from_axis(value, d)) },
        Parameter {
            name: "from_seam_deg",
            unit: "deg off the fold x = 0 below the equator",
            set: |row, value, d| set_direction(row, 0, from_seam(value, d)),
        },
    ],
};

/// Absolute difference between two angles, degrees: from the input direction to the decoded vector of `got`, and to that of `want`. The decoded
/// vectors start at column `at`.
fn farther(row: &[f64], got: &[f64], want: &[f64], at: usize) -> f64 {
    let n = octahedral::unit(three(row, 0));
    (angle_deg(three(got, at), n) - angle_deg(three(want, at), n)).abs()
}

pub(super) const NORMAL_PAIR: Probe = Probe {
    name: "normal-pair",
    about: "The plane of a triangle and a shading normal, encoded together in 32 bits, and the two decoded normals",
    inputs: &[
        real("plane_x", "normal of the plane, any length, either sign"),
        real("plane_y", "normal"),
        real("plane_z", "normal"),
        real("ray_x", "from the eye to the plane, any length"),
        real("ray_y", "ray"),
        real("ray_z", "ray"),
        real("shading_x", "direction, any length"),
        real("shading_y", "direction"),
        real("shading_z", "direction"),
    ],
    outputs: &[
        whole("word_high", "upper 16 bits", 0, 65_535),
        whole("word_low", "lower 16 bits", 0, 65_535),
        real("decoded_plane_x", "unit vector, z >= 0"),
        real("decoded_plane_y", "unit vector"),
        real("decoded_plane_z", "unit vector"),
        real("decoded_shading_x", "unit vector"),
        real("decoded_shading_y", "unit vector"),
        real("decoded_shading_z", "unit vector"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 9>) -> array<f32, 8> {
let code = vec2<i32>(round(octahedral_encode8_precise(vec3<f32>(row[6], row[7], row[8])) * 255.0));
let word = normal_pair_encode(vec3<f32>(row[0], row[1], row[2]), vec3<f32>(row[3], row[4], row[5]), code);
let pair = normal_pair_decode(pack4x8unorm(unpack4x8unorm(word)));
let plane = pair.plane;
let shading = octahedral_decode((vec2<f32>(pair.shading) - OCTAHEDRAL_HALF) * OCTAHEDRAL_STEP);
return array<f32, 8>(f32(word >> 16u), f32(word & 0xffffu), plane.x, plane.y, plane.z, shading.x, shading.y, shading.z);
}",
    single: normal_pair_row,
    double: normal_pair_row,
    random: |d| {
        let n = d.direction();
        // About half of the rays are nearly edge-on to the plane, which tests a special case of the encoding. The encoding can store only certain
        // planes, the lattice points. It chooses a lattice point whose plane the ray sees from the same side as the original plane. For a ray that is
        // nearly edge-on, this condition may decide which point is chosen.
        let across = d.direction();
        let across = sub(across, n.map(|x| x * dot(n, across)));
        let tilt = d.between(-14.0, 2.0).exp2() * if d.whole(2) < 0.5 { 1.0 } else { -1.0 };
        let far = d.between(-4.0, 12.0).exp2();
        let ray: [f64; 3] = std::array::from_fn(|i| far * (across[i] + tilt * n[i]));
        // The shading normal is the plane's upper normal plus a random vector of length 1/256 to 1.4. If n points down, about a quarter of the rows
        // use the lower normal instead.
        let up = if n[2] < 0.0 && d.whole(4) > 0.5 { -1.0 } else { 1.0 };
        let (lean, other) = (d.between(-8.0, 0.5).exp2(), d.direction());
        let shading: [f64; 3] = std::array::from_fn(|i| up * n[i] + lean * other[i]);
        let long = d.between(-10.0, 10.0).exp2();
        [n.map(|x| x * long), ray, shading].concat()
    },
    judge: normal_pair_judge,
    measures: &[
        Measure {
            name: "plane",
            unit: "deg",
            error: |row, got, want| {
                // A plane has no front side, so the smaller of the angles to its two normals counts. Codes are not compared, because two codes may be
                // equally near. The error is the difference between this angle for the result and this angle for the reference.
                let n = octahedral::unit(three(row, 0));
                let off = |v: &[f64]| angle_deg(three(v, 2), n).min(angle_deg(three(v, 2), n.map(|x| -x)));
                (off(got) - off(want)).abs()
            },
        },
        Measure { name: "shading", unit: "deg", error: |_, got, want| angle_deg(three(got, 5), three(want, 5)) },
    ],
    parameters: &[
        Parameter {
            name: "incidence_deg",
            unit: "deg between ray and normal",
            set: |row, value, d| {
                let normal = facing(three(row, 3), value, d);
                set_direction(row, 0, normal);
            },
        },
        Parameter {
            name: "deviation_deg",
            unit: "deg between shading normal and plane",
            set: |row, value, d| {
                let shading = d.leaning(octahedral::unit(three(row, 0)), value.to_radians());
                set_direction(row, 6, shading);
            },
        },
        Parameter { name: "plane_length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter { name: "ray_length", unit: "1", set: |row, value, _| set_length(row, 3, value) },
    ],
};

pub(super) const DERIVATIVES: Probe = Probe {
    name: "derivatives",
    about: "Screen derivative: the step from the point that a pixel sees to the point where the neighbouring pixel's ray meets the same plane",
    inputs: &[
        real("ray_x", "ray of the pixel"),
        real("ray_y", "ray"),
        real("ray_z", "ray"),
        real("step_x", "from the pixel's ray to the neighbour's"),
        real("step_y", "step"),
        real("step_z", "step"),
        real("t", "the point is ray * t; m if rays have no unit"),
        real("normal_x", "plane's normal, any length"),
        real("normal_y", "normal"),
        real("normal_z", "normal"),
    ],
    outputs: &[real("d_x", "unit of ray * t"), real("d_y", "unit of ray * t"), real("d_z", "unit of ray * t")],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 10>) -> array<f32, 3> {
let d = derivatives_on_plane(
    vec3<f32>(row[0], row[1], row[2]), vec3<f32>(row[3], row[4], row[5]), row[6], vec3<f32>(row[7], row[8], row[9])
);
return array<f32, 3>(d.x, d.y, d.z);
}",
    single: derivatives_row,
    double: derivatives_row,
    random: |d| {
        let ray = d.vector(-1.0, 1.0);
        let step = d.vector(-14.0, -7.0);
        let t = d.between(-4.0, 14.0).exp2();
        [&ray[..], &step, &[t], &d.vector(-10.0, 10.0)].concat()
    },
    judge: derivatives_judge,
    measures: &[
        Measure { name: "derivative", unit: "%", error: |_, got, want| 100.0 * relative(got, want) },
        Measure {
            name: "mip",
            unit: "levels",
            error: |_, got, want| {
                let size = |v: &[f64]| length(three(v, 0)).max(f64::from(f32::MIN_POSITIVE));
                (size(got) / size(want)).log2().abs()
            },
        },
    ],
    parameters: &[
        Parameter {
            name: "incidence_deg",
            unit: "deg between ray and normal",
            set: |row, value, d| {
                let normal = facing(three(row, 0), value, d);
                set_direction(row, 7, normal);
            },
        },
        Parameter { name: "ray_length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter { name: "step_length", unit: "1", set: |row, value, _| set_length(row, 3, value) },
        Parameter { name: "normal_length", unit: "1", set: |row, value, _| set_length(row, 7, value) },
    ],
};

pub(super) const TRI_PLANAR: Probe = Probe {
    name: "tri-planar",
    about: "Weights of the three projections, and the normal perturbed by the height gradients of the projections",
    inputs: &[
        real("n_x", "direction, any length"),
        real("n_y", "direction"),
        real("n_z", "direction"),
        real("sharpness", "k in w = |n|^k"),
        real("g_0_y", "height gradient in the x projection, along y"),
        real("g_0_z", "along z"),
        real("g_1_x", "height gradient in the y projection, along x"),
        real("g_1_z", "along z"),
        real("g_2_x", "height gradient in the z projection, along x"),
        real("g_2_y", "along y"),
    ],
    outputs: &[
        real("w_x", "0..1"),
        real("w_y", "0..1"),
        real("w_z", "0..1"),
        real("bent_x", "unit vector"),
        real("bent_y", "unit vector"),
        real("bent_z", "unit vector"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 10>) -> array<f32, 6> {
let n = vec3<f32>(row[0], row[1], row[2]);
let w = triplanar_weights(n, row[3]);
let gradient = w.x * triplanar_from_gradient(vec2<f32>(row[4], row[5]), 0u)
    + w.y * triplanar_from_gradient(vec2<f32>(row[6], row[7]), 1u)
    + w.z * triplanar_from_gradient(vec2<f32>(row[8], row[9]), 2u);
let bent = triplanar_perturb(n, gradient);
return array<f32, 6>(w.x, w.y, w.z, bent.x, bent.y, bent.z);
}",
    single: tri_planar_row,
    double: tri_planar_row,
    random: |d| {
        let n = d.vector(-10.0, 10.0);
        let k = if d.whole(8) < 0.5 { 0.0 } else { d.between(-2.0, 5.0).exp2() };
        let slope = d.between(-6.0, 3.0).exp2();
        let gradients = [0; 6].map(|_| d.between(-slope, slope));
        [&n[..], &[k], &gradients].concat()
    },
    judge: tri_planar_judge,
    measures: &[
        Measure { name: "weight", unit: "% of weight", error: |_, got, want| 100.0 * farthest(&got[..3], &want[..3]) },
        Measure { name: "normal", unit: "deg", error: |_, got, want| angle_deg(three(got, 3), three(want, 3)) },
    ],
    parameters: &[
        Parameter { name: "length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter { name: "from_axis_deg", unit: "deg off an axis", set: |row, value, d| set_direction(row, 0, from_axis(value, d)) },
        Parameter {
            name: "from_diagonal",
            unit: "relative difference of one component",
            set: |row, value, _| row[..3].copy_from_slice(&[1.0, 1.0 + value, 1.0]),
        },
        Parameter {
            name: "slope",
            unit: "height gradient",
            set: |row, value, d| (4..10).for_each(|i| row[i] = if d.whole(2) < 0.5 { value } else { -value }),
        },
    ],
};

pub(super) const BIPLANAR: Probe = Probe {
    name: "biplanar",
    about: "The two projections with the largest weights, and their weights",
    inputs: &[
        real("n_x", "direction, any length"),
        real("n_y", "direction"),
        real("n_z", "direction"),
        real("sharpness", "k of tri-planar weights"),
    ],
    outputs: &[whole("axis_0", "0 = x, 1 = y, 2 = z", 0, 2), whole("axis_1", "axis", 0, 2), real("w_0", "0..1"), real("w_1", "0..1")],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 4>) -> array<f32, 4> {
let b = biplanar_projections(vec3<f32>(row[0], row[1], row[2]), row[3]);
return array<f32, 4>(f32(b.axes.x), f32(b.axes.y), b.weights.x, b.weights.y);
}",
    single: biplanar_row,
    double: biplanar_row,
    random: |d| {
        let k = if d.whole(8) < 0.5 { 0.0 } else { d.between(-2.0, 6.0).exp2() };
        [&d.vector(-10.0, 10.0)[..], &[k]].concat()
    },
    judge: biplanar_judge,
    measures: &[Measure {
        name: "weight",
        unit: "% of weight",
        error: |_, got, want| {
            let of = |v: &[f64], axis: f64| (0..2).filter(|&i| v[i] == axis).map(|i| v[2 + i]).sum::<f64>();
            100.0 * [0.0, 1.0, 2.0].map(|axis| (of(got, axis) - of(want, axis)).abs()).into_iter().fold(0.0, f64::max)
        },
    }],
    parameters: &[
        Parameter { name: "length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter { name: "from_axis_deg", unit: "deg off an axis", set: |row, value, d| set_direction(row, 0, from_axis(value, d)) },
    ],
};

pub(super) const SNAPPED_PROJECTION: Probe = Probe {
    name: "snapped-projection",
    about: "The plane of the snapped projection for a normal, and the projected position, sectors and gradient",
    inputs: &[
        real("n_x", "direction, any length"),
        real("n_y", "direction"),
        real("n_z", "direction"),
        real("cosine", "cosine of the slope at which steep ground begins"),
        real("p_x", "m"),
        real("p_y", "m"),
        real("p_z", "m"),
        whole("sector_x", "sectors east", -(1 << 20), 1 << 20),
        whole("sector_y", "sectors north", -(1 << 20), 1 << 20),
        whole("sector_z", "sectors up", -(1 << 20), 1 << 20),
        whole("fixed", "repeats per sector, in units of 2^-24", -EXACT, EXACT),
        real("g_0", "height gradient along the first coordinate"),
        real("g_1", "height gradient along the second"),
    ],
    outputs: &[
        whole("plane", "0, 1, 2 = projection along x, y, z; 3 = along (1, 1); 4 = along (1, -1)", 0, 4),
        whole("sectors_0", "sectors along the first coordinate", -(1 << 21), 1 << 21),
        whole("sectors_1", "sectors along the second", -(1 << 21), 1 << 21),
        whole("rate", "repeats per sector along the first, in units of 2^-24", -EXACT, EXACT),
        real("c_0", "m along the first coordinate"),
        real("c_1", "m along the second coordinate"),
        real("gradient_x", "height gradient in 3D"),
        real("gradient_y", "height gradient in 3D"),
        real("gradient_z", "height gradient in 3D"),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 13>) -> array<f32, 9> {
let plane = snapped_plane(vec3<f32>(row[0], row[1], row[2]), row[3]);
let sectors = snapped_sectors(vec3<i32>(i32(row[7]), i32(row[8]), i32(row[9])), plane);
let c = snapped_coordinates(vec3<f32>(row[4], row[5], row[6]), plane);
let g = snapped_from_gradient(vec2<f32>(row[11], row[12]), plane);
return array<f32, 9>(f32(plane), f32(sectors.x), f32(sectors.y), f32(snapped_fixed(i32(row[10]), plane)), c.x, c.y, g.x, g.y, g.z);
}",
    single: snapped_projection_row,
    double: snapped_projection_row,
    random: |d| {
        let sectors = [0; 3].map(|_| d.whole(1 << 21) - f64::from(1 << 20));
        let fixed = d.whole(1 << 25) - f64::from(1 << 24);
        let (n, p) = (d.vector(-10.0, 10.0), d.vector(-3.0, 12.0));
        [&n[..], &[0.8], &p, &sectors, &[fixed, d.between(-2.0, 2.0), d.between(-2.0, 2.0)]].concat()
    },
    judge: snapped_projection_judge,
    measures: &[Measure {
        name: "coordinate",
        unit: "m",
        error: |_, got, want| if got[0] == want[0] { farthest(&got[4..6], &want[4..6]) } else { 0.0 },
    }],
    parameters: &[
        Parameter { name: "length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter {
            name: "position_m",
            unit: "m from the sector's corner",
            set: |row, value, d| set_direction_and_length(row, 4, d.direction(), value),
        },
    ],
};

fn octahedral_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let n = take(row, 0);
    let stored = octahedral::encode8_precise(n);
    out.extend(octahedral::encode(n));
    out.extend(stored.map(|s| (s * T::of(255.0)).round()));
    out.extend(octahedral::decode(octahedral::dequantise8(stored)));
}

fn octahedral_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let n = octahedral::unit(three(row, 0));
    let mut encoded = close(&got[..2], &want[..2], UNIT_TOLERANCE);
    // Below the equator, where x or y changes sign, the encoded point is on an edge of the square, and jumps to the mirrored point of this edge.
    // Both points represent the same direction.
    if encoded == Verdict::Differs && close(&octahedral::decode([got[0], got[1]]), &n, 4.0 * UNIT_TOLERANCE) != Verdict::Differs {
        encoded = Verdict::OtherSide;
    }
    let code = |v: &[f64]| -> Option<[u32; 2]> {
        let whole = |x: f64| (x.fract().abs() < EPS && (0.0..=254.0).contains(&x)).then_some(x as u32);
        Some([whole(v[2])?, whole(v[3])?])
    };
    let (Some(code), Some(best)) = (code(got), code(want)) else { return Verdict::Differs };
    let decoded = |code: [u32; 2]| octahedral::decode::<f64>(octahedral::dequantise(code, 8));
    let error = |code| length(sub(decoded(code), n));
    // If two codes are equally near, both are accepted.
    let chosen = if code == best {
        Verdict::Agrees(0.0)
    } else if error(code) - error(best) <= UNIT_TOLERANCE {
        Verdict::OtherSide
    } else {
        Verdict::Differs
    };
    both(both(encoded, chosen), close(&got[4..], &decoded(code), UNIT_TOLERANCE))
}

fn octahedral_codes_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (n, bits) = (take(row, 0), row[3].to_f64() as u32);
    let codes = [octahedral::quantise(octahedral::encode(n), bits), octahedral::encode_precise(n, bits)];
    out.extend(codes.into_iter().flatten().map(|code| T::of(f64::from(code) - f64::from(octahedral::half(bits)))));
    for code in codes {
        out.extend(octahedral::decode(octahedral::dequantise::<T>(code, bits)));
    }
}

fn octahedral_codes_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let bits = row[3] as u32;
    let half = f64::from(octahedral::half(bits));
    let n = octahedral::unit(three(row, 0));
    let e = octahedral::encode::<f64>(n);
    let verdict = |at: usize, decoded_at: usize, near: &dyn Fn([f64; 2]) -> bool| {
        let code = [got[at], got[at + 1]];
        if !code.iter().all(|x| x.fract() == 0.0 && x.abs() <= half) {
            return Verdict::Differs;
        }
        let decoded = octahedral::decode(code.map(|x| x / half));
        let chosen = if code == [want[at], want[at + 1]] {
            Verdict::Agrees(0.0)
        } else if near(code) {
            Verdict::OtherSide
        } else {
            Verdict::Differs
        };
        // The rounding of the step and of its product with the code adds an error of up to 3 ULP to the coordinates. In the decoded direction, this
        // error is at most twice as large; the tolerance allows 8 ULP for it.
        both(chosen, close(&got[decoded_at..decoded_at + 3], &decoded, UNIT_TOLERANCE + 8.0 * EPS))
    };
    // Near the middle between two codes, both codes are accepted.
    let same_point = |code: [f64; 2]| (0..2).all(|i| (code[i] - e[i] * half).abs() <= 0.5 + UNIT_TOLERANCE * half);
    let error = |code: [f64; 2]| length(sub(octahedral::decode::<f64>(code.map(|x| x / half)), n));
    // Below the equator, where x or y changes sign, two codes that mirror each other represent the same direction. Both are accepted.
    let mirrored = |code: [f64; 2]| n[2] <= 0.0 && (error(code) - error([want[0], want[1]])).abs() <= 2.0 * UNIT_TOLERANCE;
    let fast = verdict(0, 4, &|code| same_point(code) || mirrored(code));
    let exact = verdict(2, 7, &|code| error(code) - error([want[2], want[3]]) <= 2.0 * UNIT_TOLERANCE);
    both(fast, exact)
}

fn normal_pair_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let word = normal_pair::encode(take(row, 0), take(row, 3), octahedral::encode_precise(take(row, 6), 8));
    let pair = normal_pair::decode::<T>(word);
    out.extend([word >> 16, word & 0xffff].map(|half| T::of(f64::from(half))));
    out.extend(pair.plane);
    out.extend(octahedral::decode(octahedral::dequantise::<T>(pair.shading, 8)));
}

fn normal_pair_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let half = |x: f64| (x.fract().abs() < EPS && (0.0..=65_535.0).contains(&x)).then_some(x as u32);
    let word = |v: &[f64]| -> Option<u32> { Some((half(v[0])? << 16) | half(v[1])?) };
    let (Some(word), Some(best)) = (word(got), word(want)) else { return Verdict::Differs };
    let shading = |code: [u32; 2]| octahedral::decode::<f64>(octahedral::dequantise(code, 8));
    let (pair, wanted) = (normal_pair::decode::<f64>(word), normal_pair::decode::<f64>(best));
    let decoded = both(close(&got[2..5], &pair.plane, UNIT_TOLERANCE), close(&got[5..], &shading(pair.shading), UNIT_TOLERANCE));
    if word == best {
        return decoded;
    }
    // The words may differ if two lattice points (planes that the encoding can store), or two codes of the shading normal, are equally near within
    // the rounding error. But if one word has the fine form and the other the plain form (see normal_pair.rs), this counts as a difference. Rounding
    // is a very unlikely cause of such a difference, because the code of the shading normal would also have to lie at the limit of the range that the
    // fine form can store.
    let as_near = |a: [f64; 3], b: [f64; 3], to: [f64; 3]| (length(sub(a, to)) - length(sub(b, to))).abs() <= 2.0 * UNIT_TOLERANCE;
    let [n, ray, normal] = [0, 3, 6].map(|at| octahedral::unit(three(row, at)));
    let n = if n[2] < 0.0 { n.map(|x| -x) } else { n };
    // If the ray lies nearly in the plane, or in the plane of one of the two lattice points, rounding may decide from which side it sees a lattice
    // point. A lattice point within three times `supremum` of the plane's normal is then accepted.
    let edge_on = [n, pair.plane, wanted.plane].iter().any(|&v| dot(v, ray).abs() <= 2.0 * UNIT_TOLERANCE);
    let supremum = if word >> 31 == 0 { normal_pair::FINE_SUPREMUM } else { normal_pair::PLAIN_SUPREMUM };
    let plane = as_near(pair.plane, wanted.plane, n) || (edge_on && length(sub(pair.plane, n)) <= 3.0 * supremum);
    let code = as_near(shading(pair.shading), shading(wanted.shading), normal);
    if word >> 31 == best >> 31 && plane && code { both(decoded, Verdict::OtherSide) } else { Verdict::Differs }
}

fn derivatives_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    out.extend(derivatives::on_plane(take(row, 0), take(row, 3), row[6], take(row, 7)));
}

fn derivatives_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (ray, step, t, n) = (three(row, 0), three(row, 3), row[6], octahedral::unit(three(row, 7)));
    let neighbour = [0, 1, 2].map(|i| ray[i] + step[i]);
    let (s, r) = (length(step), length(neighbour));
    // The tested function raises the magnitude of the cosine between the normal and the neighbour's ray to at least `MIN_COSINE`. The neighbour's ray
    // is assumed to meet the plane from the same side as the pixel's ray.
    let side = if dot(n, ray) >= 0.0 { 1.0 } else { -1.0 };
    let facing = (side * dot(n, neighbour)).max(derivatives::MIN_COSINE * r);
    let seen = dot(n, step).abs();
    // The result is t (step - ray' (n.step / n.ray')), where ray' is the neighbour's ray, s is the length of the step, and r is the length of ray'.
    // `facing` is |n.ray'|, at least its lower limit. The error of n is 11 ULP, so n.step has an error of about 16 ULP of s, and n.ray' of about 16
    // ULP of r. Both enter the quotient, which is multiplied by ray'. In the result, in units of 16 ULP, the first error becomes s (r / facing), and
    // the second becomes |n.step| (r / facing)². The tolerance allows 20 ULP.
    let relative = s + s * (r / facing) + seen * (r / facing) * (r / facing);
    let verdict = close(got, want, t.abs() * 20.0 * EPS * relative + f64::from(f32::MIN_POSITIVE));
    // If the ray lies nearly in the plane, rounding may decide which side of the plane it sees.
    if verdict == Verdict::Differs && dot(n, ray).abs() <= 20.0 * EPS * length(ray) { Verdict::OtherSide } else { verdict }
}

fn tri_planar_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let n = take(row, 0);
    let w = triplanar::weights(n, row[3]);
    let along = |axis: u32, at: usize, w: T| scale(triplanar::from_gradient(take(row, at), axis), w);
    let gradient = add(add(along(0, 4, w[0]), along(1, 6, w[1])), along(2, 8, w[2]));
    out.extend(w);
    out.extend(triplanar::perturb(n, gradient));
}

fn tri_planar_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (n, k) = (three(row, 0), row[3].clamp(0.0, 1e4));
    let weights = triplanar::weights(n, row[3]);
    // A weight is proportional to 2^(k log2 r), where k is the sharpness, and r is the ratio of a component of the normal to the largest component.
    // log2 has an error of 2^-21 = 4 ULP near 1, and r has an error of 12 ULP. Together they change the weight by at most (4 ln 2 + 12) k ULP, which
    // is less than 16 k ULP.
    // A normalised weight w changes in proportion to w (1 - w), so weights close to 0 or 1 hardly change. `sensitivity` is four times the largest of
    // these factors w (1 - w), so it is at most 1.
    let sensitivity = weights.iter().map(|w| 4.0 * w * (1.0 - w)).fold(0.0, f64::max);
    let of_weights = EPS * (16.0 + 16.0 * k * sensitivity);
    let gradients: [[f64; 3]; 3] = [
        triplanar::from_gradient([row[4], row[5]], 0),
        triplanar::from_gradient([row[6], row[7]], 1),
        triplanar::from_gradient([row[8], row[9]], 2),
    ];
    let gradient: [f64; 3] = std::array::from_fn(|c| (0..3).map(|i| weights[i] * gradients[i][c]).sum());
    let unit = octahedral::unit(n);
    let bent = sub(unit, sub(gradient, unit.map(|x| x * dot(unit, gradient))));
    // The gradient inherits the error of the weights. The gradient's part along the normal cancels in `bent`, so rounding errors are relative to the
    // whole gradient. Normalising divides the errors by the length of `bent`, which is at least 1.
    let of_gradient = of_weights * gradients.iter().map(|&g| length(g)).sum::<f64>() + 24.0 * EPS * (1.0 + length(gradient));
    both(close(&got[..3], &want[..3], of_weights), close(&got[3..], &want[3..], of_gradient / length(bent).max(1.0) + UNIT_TOLERANCE))
}

fn biplanar_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let (axes, weights) = biplanar::projections(take(row, 0), row[3]);
    out.extend(axes.map(|axis| T::of(f64::from(axis))));
    out.extend(weights);
}

fn biplanar_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let n = octahedral::unit(three(row, 0)).map(f64::abs);
    let k = row[3].clamp(0.0, 1e4) / 8.0;
    let above = [want[0], want[1]].map(|axis| (n[axis as usize] - 1.0 / 3.0_f64.sqrt()).max(0.0));
    let top = above[0].max(above[1]);
    if (got[2] + got[3] - 1.0).abs() > 4.0 * EPS || got[2].min(got[3]) < 0.0 {
        return Verdict::Differs;
    }
    // The blend is discontinuous on a diagonal, where all three components are equal in size. Next to a diagonal, rounding decides, so any weights
    // that sum to 1 are accepted.
    if top <= 2.0 * UNIT_TOLERANCE {
        return Verdict::OtherSide;
    }
    // The tolerance is the sum of three errors.
    // - `power`: error of r^k, where r is the ratio of the smaller value in `above` to the larger one, and e is the error of r. If k is at least 1,
    //   or if r is larger than 2 e, `power` is e times `slope`, a bound on the slope of r^k. Otherwise r + e is at most 3 e, so r^k and its error are
    //   at most (3 e)^k.
    // - 4 k ULP: error of log2 (2^-21 = 4 ULP near 1), multiplied by k.
    // - 16 ULP: error of exp2(-x). The relative error grows with x, but x 2^-x is at most 0.54, so the absolute error stays below 16 ULP.
    let (r, e) = (above[0].min(above[1]) / top, 2.0 * UNIT_TOLERANCE / top);
    let slope = if k >= 1.0 { k } else { k * (r - e).max(1e-300).powf(k - 1.0) };
    let power = if r > 2.0 * e || k >= 1.0 { slope * e } else { (3.0 * e).powf(k) };
    let pairs = |v: &[f64]| [(v[0] as u64, v[2]), (v[1] as u64, v[3])];
    keyed(&pairs(got), &pairs(want), power + EPS * (16.0 + 4.0 * k))
}

#[allow(clippy::cast_possible_truncation, reason = "Column::accepts keeps these columns whole and in range")]
fn snapped_projection_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let plane = snapped_projection::plane(take(row, 0), row[3]);
    let whole = |v: T| v.to_f64() as i32;
    out.push(T::of(f64::from(plane)));
    out.extend(snapped_projection::sectors(take::<T, 3>(row, 7).map(whole), plane).map(|s| T::of(f64::from(s))));
    out.push(T::of(f64::from(snapped_projection::fixed(whole(row[10]), plane))));
    out.extend(snapped_projection::coordinates(take(row, 4), plane));
    out.extend(snapped_projection::from_gradient(take(row, 11), plane));
}

fn snapped_projection_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let n = octahedral::unit(three(row, 0));
    let plane = got[0] as u32;
    let step = (std::f64::consts::PI / 8.0).tan();
    // Distances of the normal from the thresholds at which the plane changes: the slope whose cosine is the input `cosine`, and the azimuths at 22.5
    // degrees to either side of the axes.
    let [x, y] = [n[0].abs(), n[1].abs()];
    let margins = [n[2].abs() - row[3], y - step * x, x - step * y];
    let near = margins.iter().any(|m| m.abs() <= 2.0 * UNIT_TOLERANCE);
    let verdict = if plane == want[0] as u32 {
        Verdict::Agrees(0.0)
    } else if near {
        Verdict::OtherSide
    } else {
        return Verdict::Differs;
    };
    let sectors = snapped_projection::sectors([row[7] as i32, row[8] as i32, row[9] as i32], plane).map(f64::from);
    let rate = f64::from(snapped_projection::fixed(row[10] as i32, plane));
    let position = three(row, 4);
    let gradient = [row[11], row[12]];
    let sizes = (length(position), gradient[0].abs() + gradient[1].abs());
    let whole = close(&got[1..4], &[sectors[0], sectors[1], rate], 0.25);
    // A coordinate takes at most a sum and a product, and each is rounded once, so its error is at most 1 ULP of the length of the position. The
    // tolerance allows 2 ULP. The tolerance of the gradient is analogous.
    let coordinates = close(&got[4..6], &snapped_projection::coordinates(position, plane), 2.0 * EPS * sizes.0 + 1e-30);
    let volume = close(&got[6..], &snapped_projection::from_gradient(gradient, plane), 2.0 * EPS * sizes.1 + 1e-30);
    both(both(verdict, whole), both(coordinates, volume))
}

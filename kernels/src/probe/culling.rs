//! Tests of what can be left out.

use super::judge::{Verdict, from_axis, set_direction, set_length, three};
use super::{Measure, Parameter, Probe, real, take, whole};
use crate::shared::culling::{self, ROUNDING, SLACK};
use crate::shared::octahedral;
use crate::shared::real::{Real, dot, length};

pub(super) const FRUSTUM: Probe = Probe {
    name: "frustum",
    about: "Whether a box lies wholly beyond a plane of the frustum: what is seen is never left out",
    inputs: &[
        real("plane_x", "normal of the plane, any length, towards the seen side"),
        real("plane_y", "normal"),
        real("plane_z", "normal"),
        real("plane_w", "so that n . p + w = 0 on the plane; m if the normal has length 1"),
        real("low_x", "m, lower corner of the box"),
        real("low_y", "m"),
        real("low_z", "m"),
        real("high_x", "m, upper corner"),
        real("high_y", "m"),
        real("high_z", "m"),
    ],
    outputs: &[whole("beyond", "1 = left out", 0, 1)],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 10>) -> array<f32, 1> {
let plane = vec4<f32>(row[0], row[1], row[2], row[3]);
let beyond = culling_beyond(plane, vec3<f32>(row[4], row[5], row[6]), vec3<f32>(row[7], row[8], row[9]));
return array<f32, 1>(select(0.0, 1.0, beyond));
}",
    single: frustum_row,
    double: frustum_row,
    random: |d| {
        let n = d.direction();
        let centre = d.vector(-4.0, 14.0);
        let half = [0; 3].map(|_: i32| d.between(-6.0, 9.0).exp2());
        // The nearest corner next to the plane as often as not.
        let reach: f64 = (0..3).map(|i| n[i].abs() * half[i]).sum();
        let off =
            if d.whole(2) < 0.5 { d.between(-24.0, 0.0).exp2() * length(centre) * (2.0 * d.whole(2) - 1.0) } else { d.between(-4e3, 4e3) };
        let w = off - dot(n, centre) - reach;
        let corner = |sign: f64| [0, 1, 2].map(|i| centre[i] + sign * half[i]);
        [&n[..], &[w], &corner(-1.0), &corner(1.0)].concat()
    },
    judge: frustum_judge,
    measures: &[Measure {
        name: "drawn for nothing",
        unit: "m beyond the plane",
        error: |row, got, _| {
            let (distance, _) = frustum_distance(row);
            if got[0] == 0.0 { (-distance).max(0.0) / length(three(row, 0)).max(f64::from(f32::MIN_POSITIVE)) } else { 0.0 }
        },
    }],
    parameters: &[
        Parameter {
            name: "beyond_m",
            unit: "m beyond the plane, of the nearest corner",
            set: |row, value, _| {
                let n = octahedral::unit(three(row, 0));
                set_direction(row, 0, n);
                row[3] = 0.0;
                row[3] = -value - frustum_distance(row).0;
            },
        },
        Parameter { name: "box_m", unit: "m, every edge", set: |row, value, _| (0..3).for_each(|i| row[7 + i] = row[4 + i] + value) },
        Parameter { name: "corner_m", unit: "m, all coordinates of a box without extent", set: |row, value, _| row[4..10].fill(value) },
    ],
};

/// n . p + w of the box's farthest corner towards the seen side, and the sum of the terms' magnitudes; exact but for f64's rounding.
fn frustum_distance(row: &[f64]) -> (f64, f64) {
    let term = |i: usize| row[i] * if row[i] >= 0.0 { row[7 + i] } else { row[4 + i] };
    let terms = [term(0), term(1), term(2), row[3]];
    (terms.iter().sum(), terms.iter().map(|x| x.abs()).sum())
}

fn frustum_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let beyond = culling::beyond(take(row, 0), take(row, 4), take(row, 7));
    out.push(if beyond { T::one() } else { T::zero() });
}

/// One side is exact, the other has the margin and once more its rounding.
fn frustum_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (distance, size) = frustum_distance(row);
    let near = -distance <= 2.0 * (SLACK * size + 1e-22) || row.iter().any(|x| x.abs() > 0.999e15);
    one_sided(got, want, distance < 0.0, near)
}

/// `may`: left out rightly; `near`: within the margin.
fn one_sided(got: &[f64], want: &[f64], may: bool, near: bool) -> Verdict {
    match (got[0] == 1.0, want[0] == 1.0) {
        (true, _) if !may => Verdict::Differs,
        (got, want) if got == want => Verdict::Agrees(0.0),
        _ if near => Verdict::OtherSide,
        _ => Verdict::Differs,
    }
}

pub(super) const NORMAL_CONE: Probe = Probe {
    name: "normal-cone",
    about: "Whether all of a patch faces away, by the cone of its normals and the sphere about it: what faces the eye is never left out",
    inputs: &[
        real("axis_x", "axis of the cone, any length"),
        real("axis_y", "axis"),
        real("axis_z", "axis"),
        real("sin_half_angle", "of the cone, 0..=1; 1 = any direction"),
        real("patch_x", "m, from the eye to the patch"),
        real("patch_y", "m"),
        real("patch_z", "m"),
        real("radius", "m, of the sphere about the patch"),
    ],
    outputs: &[whole("away", "1 = left out", 0, 1)],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 8>) -> array<f32, 1> {
let away = culling_faces_away(vec3<f32>(row[0], row[1], row[2]), row[3], vec3<f32>(row[4], row[5], row[6]), row[7]);
return array<f32, 1>(select(0.0, 1.0, away));
}",
    single: cone_row,
    double: cone_row,
    random: |d| {
        let to_patch = d.vector(-4.0, 14.0);
        let distance = length(to_patch);
        let half = d.between(0.0, 80.0_f64.to_radians());
        let radius = distance * d.between(-12.0, 0.0).exp2();
        // At the angle that decides as often as not.
        let border = std::f64::consts::FRAC_PI_2 - half - (radius / distance).asin();
        let off = if d.whole(2) < 0.5 { d.between(-24.0, 0.0).exp2() * (2.0 * d.whole(2) - 1.0) } else { d.between(-3.0, 3.0) };
        let axis = d.leaning(octahedral::unit(to_patch), border + off);
        [&axis[..], &[half.sin()], &to_patch, &[radius]].concat()
    },
    judge: cone_judge,
    measures: &[Measure {
        name: "drawn for nothing",
        unit: "deg beyond the border",
        error: |row, got, _| if got[0] == 0.0 { cone_margin(row).max(0.0).to_degrees() } else { 0.0 },
    }],
    parameters: &[
        Parameter { name: "half_angle_deg", unit: "deg, of the cone", set: |row, value, _| row[3] = value.to_radians().sin() },
        Parameter {
            name: "from_border_deg",
            unit: "deg beyond the angle that decides",
            set: |row, value, d| {
                let to_patch = three(row, 4);
                let border = std::f64::consts::FRAC_PI_2 - row[3].asin() - (row[7] / length(to_patch)).min(1.0).asin();
                let axis = d.leaning(octahedral::unit(to_patch), border - value.to_radians());
                set_direction(row, 0, axis);
            },
        },
        Parameter { name: "axis_length", unit: "1", set: |row, value, _| set_length(row, 0, value) },
        Parameter {
            name: "from_axis_deg",
            unit: "deg off an axis, of the cone",
            set: |row, value, d| set_direction(row, 0, from_axis(value, d)),
        },
        Parameter {
            name: "radius_share",
            unit: "of the distance, of the sphere",
            set: |row, value, _| row[7] = value * length(three(row, 4)),
        },
    ],
};

/// By how much all normals face away, radians; negative where one may face the eye. By angles, unlike the reference.
fn cone_margin(row: &[f64]) -> f64 {
    let to_patch = three(row, 4);
    let (distance, sine) = (length(to_patch), row[3]);
    let has_axis = row[..3].iter().any(|x| x.abs() > 1e-15);
    if !(has_axis && (0.0..1.0).contains(&sine) && row[7] >= 0.0 && distance > row[7]) {
        return -1.0;
    }
    let axis = octahedral::unit(three(row, 0));
    let direction = octahedral::unit(to_patch);
    let cross = [
        axis[1] * direction[2] - axis[2] * direction[1],
        axis[2] * direction[0] - axis[0] * direction[2],
        axis[0] * direction[1] - axis[1] * direction[0],
    ];
    let between = length(cross).atan2(dot(axis, direction));
    std::f64::consts::FRAC_PI_2 - between - sine.asin() - (row[7] / distance).asin()
}

fn cone_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let away = culling::faces_away(take(row, 0), row[3], take(row, 4), row[7]);
    out.push(if away { T::one() } else { T::zero() });
}

/// One side is exact, the other has the margin: of a cosine, whose angle is as wide as its sine is small.
fn cone_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let margin = cone_margin(row);
    // cos(between) - sin(a + s) = cos(between) - cos(between + margin), between = the angle to the axis.
    let between = std::f64::consts::FRAC_PI_2 - margin - row[3].asin() - (row[7] / length(three(row, 4))).min(1.0).asin();
    let over = between.cos() - (between + margin).cos();
    let near = over <= 2.0 * ROUNDING || between + margin <= 0.0 || (between + margin).sin() <= 2.0 * ROUNDING;
    let out_of_range = |x: f64| (x.abs() > 0.999e15 || (x != 0.0 && x.abs() < 1.001e-15)) && x.is_finite();
    one_sided(got, want, margin > 0.0, near || row.iter().any(|&x| out_of_range(x)))
}

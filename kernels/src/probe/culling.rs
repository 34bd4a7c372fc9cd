//! Probes of the culling tests: frustum, normal cone and occlusion.

use super::judge::{Verdict, cross, from_axis, set_direction, set_length, three};
use super::{Measure, Parameter, Probe, real, take, whole};
use crate::shared::culling::{self, Cover, FLUSHED, KNOWN, LEAST, MOST, NEAREST, ROUNDING, SLACK};
use crate::shared::octahedral;
use crate::shared::real::{Real, dot, length};

pub(super) const FRUSTUM: Probe = Probe {
    name: "frustum",
    about: "Whether a box lies completely beyond a plane of the frustum and is culled; a visible box is never culled",
    inputs: &[
        real("plane_x", "normal of the plane, any length, pointing to the visible side"),
        real("plane_y", "normal"),
        real("plane_z", "normal"),
        real("plane_w", "w in the plane's equation n . p + w = 0; m if the normal has length 1"),
        real("low_x", "m, lower corner of the box"),
        real("low_y", "m"),
        real("low_z", "m"),
        real("high_x", "m, upper corner"),
        real("high_y", "m"),
        real("high_z", "m"),
    ],
    outputs: &[whole("beyond", "1 = culled", 0, 1)],
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
        // In about half of the rows, the corner that lies farthest towards the visible side is usually close to the plane.
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
            unit: "m by which the corner nearest to the visible side lies beyond the plane",
            set: |row, value, _| {
                let n = octahedral::unit(three(row, 0));
                set_direction(row, 0, n);
                row[3] = 0.0;
                row[3] = -value - frustum_distance(row).0;
            },
        },
        Parameter { name: "box_m", unit: "m, every edge", set: |row, value, _| (0..3).for_each(|i| row[7 + i] = row[4 + i] + value) },
        Parameter { name: "corner_m", unit: "m, every coordinate of both corners", set: |row, value, _| row[4..10].fill(value) },
    ],
};

/// n . p + w for the corner p of the box that lies farthest towards the visible side of the plane, and the sum of the magnitudes of the terms.
/// Computed in f64.
fn frustum_distance(row: &[f64]) -> (f64, f64) {
    let term = |i: usize| row[i] * if row[i] >= 0.0 { row[7 + i] } else { row[4 + i] };
    let terms = [term(0), term(1), term(2), row[3]];
    (terms.iter().sum(), terms.iter().map(|x| x.abs()).sum())
}

fn frustum_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let beyond = culling::beyond(take(row, 0), take(row, 4), take(row, 7));
    out.push(if beyond { T::one() } else { T::zero() });
}

/// Visible boxes must not be culled. A box that lies beyond the plane by at most twice the margin of [`culling::beyond`] may be drawn or culled. The
/// factor 2 covers the rounding of the margin itself.
fn frustum_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (distance, size) = frustum_distance(row);
    let near = -distance <= 2.0 * (SLACK * size + FLUSHED) || row.iter().any(|&x| is_next_to(x, MOST));
    one_sided(got, want, distance < 0.0, near)
}

/// Whether the magnitude of a number is within 0.1 % of a limit, so that rounding may put it on either side.
fn is_next_to(x: f64, limit: f64) -> bool {
    (x.abs() / limit - 1.0).abs() < 1e-3
}

/// Judges a decision to cull. `may`: whether the object may be culled; if it may not, a result that culls it is rejected. `near`: whether the row is
/// close to the threshold; only then is a result accepted that differs from the truth.
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
    about: "Whether the normal cone and bounding sphere of a patch prove that it faces away from the eye and can be culled; otherwise, it is drawn",
    inputs: &[
        real("axis_x", "axis of the cone, any length"),
        real("axis_y", "axis"),
        real("axis_z", "axis"),
        real("sin_half_angle", "sine of the cone's half angle, 0..=1; 1 or an invalid sine = normals in any direction"),
        real("patch_x", "m, from the eye to the patch"),
        real("patch_y", "m"),
        real("patch_z", "m"),
        real("radius", "m, radius of the patch's bounding sphere"),
    ],
    outputs: &[whole("away", "1 = culled", 0, 1)],
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
        // Patches face away if the angle between the axis and the direction to the patch is smaller than `border`. In about half of the rows, this
        // angle is usually close to `border`.
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
        Parameter { name: "half_angle_deg", unit: "deg, half angle of the cone", set: |row, value, _| row[3] = value.to_radians().sin() },
        Parameter {
            name: "from_border_deg",
            unit: "deg beyond the angle at which culling becomes correct",
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
            unit: "deg from a coordinate axis to the cone's axis",
            set: |row, value, d| set_direction(row, 0, from_axis(value, d)),
        },
        Parameter {
            name: "radius_share",
            unit: "radius of the sphere as a share of its distance",
            set: |row, value, _| row[7] = value * length(three(row, 4)),
        },
    ],
};

/// Returns 90 degrees minus the largest angle between a normal in the cone and a ray from the eye to the bounding sphere, in radians. If the result
/// is positive, all normals face away from the eye. If it is negative, a normal may face the eye. The result is -1 if the cone is not valid or the
/// eye is inside the bounding sphere. Unlike the reference, which compares sines and cosines, this function adds angles.
fn cone_margin(row: &[f64]) -> f64 {
    let to_patch = three(row, 4);
    let (distance, sine) = (length(to_patch), row[3]);
    let has_axis = row[..3].iter().any(|x| x.abs() > LEAST);
    if !(has_axis && (0.0..1.0).contains(&sine) && row[7] >= 0.0 && distance > row[7]) {
        return -1.0;
    }
    let axis = octahedral::unit(three(row, 0));
    let direction = octahedral::unit(to_patch);
    let between = length(cross(axis, direction)).atan2(dot(axis, direction));
    std::f64::consts::FRAC_PI_2 - between - sine.asin() - (row[7] / distance).asin()
}

fn cone_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let away = culling::faces_away(take(row, 0), row[3], take(row, 4), row[7]);
    out.push(if away { T::one() } else { T::zero() });
}

/// Patches that face the eye must not be culled. A patch that faces away by at most twice the margin [`ROUNDING`] may be drawn or culled. The margin
/// applies to a difference between cosines, not between angles. A patch that faces away may also be drawn if the half angle of the cone and the
/// angular radius of the sphere nearly add up to a right angle.
fn cone_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let margin = cone_margin(row);
    // `between` is the angle between the axis and the direction to the patch, a is the half angle of the cone, and s is the angular radius of the
    // sphere. `over` is cos(between) - sin(a + s); the reference culls if `over` exceeds `ROUNDING`. `margin` is 90 degrees - (between + a + s).
    // Therefore, a + s is 90 degrees - (between + margin), and sin(a + s) is cos(between + margin).
    let between = std::f64::consts::FRAC_PI_2 - margin - row[3].asin() - (row[7] / length(three(row, 4))).min(1.0).asin();
    let over = between.cos() - (between + margin).cos();
    let near = over <= 2.0 * ROUNDING || between + margin <= 0.0 || (between + margin).sin() <= 2.0 * ROUNDING;
    let at_an_end = row.iter().any(|&x| is_next_to(x, MOST) || is_next_to(x, LEAST)) || is_next_to(length(three(row, 4)), LEAST);
    one_sided(got, want, margin > 0.0, near || at_an_end)
}

/// Indices of the columns of [`OCCLUSION`] at which the near distance, the two corners, the size and the stored depths begin.
const NEAR: usize = 12;
const LOW: usize = 13;
const HIGH: usize = 16;
const SIZE: usize = 19;
const STORED: usize = 21;

pub(super) const OCCLUSION: Probe = Probe {
    name: "occlusion",
    about: "The pixels that a box covers, the tested level of the depth pyramid, the size of this level, and whether the box is hidden; no visible box is culled",
    inputs: &[
        real("x_x", "matrix row from box coordinates to clip-space x: coefficient of x"),
        real("x_y", "coefficient of y"),
        real("x_z", "coefficient of z"),
        real("x_w", "constant term"),
        real("y_x", "matrix row for clip-space y: coefficient of x"),
        real("y_y", "coefficient of y"),
        real("y_z", "coefficient of z"),
        real("y_w", "constant term"),
        real("w_x", "matrix row for w, the distance along the view: coefficient of x"),
        real("w_y", "coefficient of y"),
        real("w_z", "coefficient of z"),
        real("w_w", "constant term"),
        real("near_m", "m"),
        real("low_x", "m, lower corner of the box"),
        real("low_y", "m"),
        real("low_z", "m"),
        real("high_x", "m, upper corner"),
        real("high_y", "m"),
        real("high_z", "m"),
        whole("width", "pixels of the picture", 1, MOST_SIDE),
        whole("height", "pixels of the picture", 1, MOST_SIDE),
        real("stored_0", "smallest depth in the first texel of the pyramid: near plane's distance / distance along the view"),
        real("stored_1", "smallest depth in the second texel"),
        real("stored_2", "smallest depth in the third texel"),
        real("stored_3", "smallest depth in the fourth texel"),
    ],
    outputs: &[
        whole("known", "0 = undecided: the box is drawn", 0, 1),
        whole("first_x", "pixels, first column", 0, MOST_SIDE),
        whole("first_y", "first row, from above", 0, MOST_SIDE),
        whole("last_x", "last column", 0, MOST_SIDE),
        whole("last_y", "last row", 0, MOST_SIDE),
        whole("level", "level of the pyramid", 0, 14),
        real("depth", "depth of the nearest point"),
        whole("hidden", "1 = culled", 0, 1),
        whole("columns", "texels of the level, along the width", 1, MOST_SIDE),
        whole("rows", "texels of the level, along the height", 1, MOST_SIDE),
    ],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 25>) -> array<f32, 10> {
let x = vec4<f32>(row[0], row[1], row[2], row[3]);
let y = vec4<f32>(row[4], row[5], row[6], row[7]);
let w = vec4<f32>(row[8], row[9], row[10], row[11]);
let low = vec3<f32>(row[13], row[14], row[15]);
let high = vec3<f32>(row[16], row[17], row[18]);
let size = vec2<u32>(u32(row[19]), u32(row[20]));
let seen = culling_cover(x, y, w, row[12], low, high, size);
let hidden = seen.known && culling_hidden(seen.depth, vec4<f32>(row[21], row[22], row[23], row[24]));
let level = culling_level(seen.first, seen.last);
let texels = culling_level_size(size, level);
return array<f32, 10>(
    select(0.0, 1.0, seen.known), f32(seen.first.x), f32(seen.first.y), f32(seen.last.x), f32(seen.last.y), f32(level), seen.depth,
    select(0.0, 1.0, hidden), f32(texels.x), f32(texels.y)
);
}",
    single: occlusion_row,
    double: occlusion_row,
    random: |d| {
        let near = d.between(-10.0, 0.0).exp2();
        let size = [0; 2].map(|_| 1.0 + d.whole(4096));
        let eye = d.vector(-4.0, 12.0);
        let forward = d.direction();
        let right = d.leaning(forward, std::f64::consts::FRAC_PI_2);
        let half = [0; 2].map(|_| d.between(-4.0, 2.0).exp2());
        // The centre of the box lies in front of the camera, at most twice as far to the side as the edge of the field of view. The half extents are
        // 2^-12 to 1.4 times the distance of the centre, so the box may reach behind the camera.
        let distance = near * d.between(0.0, 17.0).exp2();
        let aside = [0; 2].map(|_| d.between(-2.0, 2.0) * distance);
        let extent = [0; 3].map(|_: i32| distance * d.between(-12.0, 0.5).exp2());
        let mut row = vec![0.0; STORED];
        let axes = [right, cross(right, forward), forward];
        for (k, axis) in axes.into_iter().enumerate() {
            let by = if k < 2 { 1.0 / half[k] } else { 1.0 };
            let of = axis.map(|x| x * by);
            row[4 * k..4 * k + 3].copy_from_slice(&of);
            row[4 * k + 3] = -dot(of, eye);
        }
        row[NEAR] = near;
        for i in 0..3 {
            let centre = eye[i] + forward[i] * distance + axes[0][i] * half[0] * aside[0] + axes[1][i] * half[1] * aside[1];
            (row[LOW + i], row[HIGH + i]) = (centre - extent[i], centre + extent[i]);
        }
        row[SIZE..].copy_from_slice(&size);
        // In about half of the rows, `off` is usually close to 1. On average, half of the stored depths are then close to the depth of the nearest
        // corner, and the others are up to twice as large.
        let nearest = near / exact(&row).nearest_m.max(near);
        let off =
            if d.whole(2) < 0.5 { 1.0 + d.between(-24.0, -1.0).exp2() * (2.0 * d.whole(2) - 1.0) } else { d.between(-2.0, 2.0).exp2() };
        row.extend([0; 4].map(|_| nearest * off * (1.0 + d.unit() * d.whole(2))));
        row
    },
    judge: occlusion_judge,
    measures: &[
        Measure {
            name: "drawn for nothing",
            unit: "of the distance, behind what hides it",
            error: |row, got, _| {
                let stored = row[STORED..].iter().copied().fold(f64::INFINITY, f64::min);
                let nearest = row[NEAR] / exact(row).nearest_m;
                if got[0] == 1.0 && got[7] == 0.0 && nearest > 0.0 { (stored / nearest - 1.0).max(0.0) } else { 0.0 }
            },
        },
        Measure {
            name: "covered for nothing",
            unit: "px",
            error: |row, got, _| if got[0] == 1.0 { widened(row, &exact(row), got) } else { 0.0 },
        },
    ],
    parameters: &[
        Parameter {
            name: "behind",
            unit: "distance of the box behind the drawn surface, as a share of the distance of that surface",
            set: |row, value, _| {
                let nearest = row[NEAR] / exact(row).nearest_m.max(row[NEAR]);
                row[STORED..].fill(nearest * (1.0 + value));
            },
        },
        Parameter {
            name: "distance_m",
            unit: "m along the view to the middle of a box with edges of 1 m",
            set: |row, value, _| {
                let forward = three(row, 8);
                let aside = [0, 1, 2].map(|i| (row[LOW + i] + row[HIGH + i]) / 2.0);
                let off = (value - (dot(forward, aside) + row[11])) / dot(forward, forward);
                for i in 0..3 {
                    let middle = aside[i] + forward[i] * off;
                    (row[LOW + i], row[HIGH + i]) = (middle - 0.5, middle + 0.5);
                }
            },
        },
        Parameter {
            name: "fov_deg",
            unit: "deg, horizontally and vertically",
            set: |row, value, _| {
                for k in 0..2 {
                    let by = 1.0 / (length(three(row, 4 * k)) * (value / 2.0).to_radians().tan());
                    row[4 * k..4 * k + 4].iter_mut().for_each(|x| *x *= by);
                }
            },
        },
        Parameter {
            name: "eye_m",
            unit: "m by which the eye and the box are moved in a random direction",
            set: |row, value, d| {
                let by = d.direction().map(|x| x * value);
                for k in 0..3 {
                    row[4 * k + 3] -= dot(three(row, 4 * k), by);
                }
                for i in 0..3 {
                    row[LOW + i] += by[i];
                    row[HIGH + i] += by[i];
                }
            },
        },
        Parameter { name: "side_px", unit: "px, width and height", set: |row, value, _| row[SIZE..STORED].fill(value) },
    ],
};

/// Largest width and height of a picture, pixels.
const MOST_SIDE: i32 = 16_384;

/// The rows for x, y and w of the matrix to clip space.
fn clip_rows<T: Real>(row: &[T]) -> [[T; 4]; 3] {
    [take(row, 0), take(row, 4), take(row, 8)]
}

/// The extent of a box on the screen, computed in f64 from the corners of the box: positions before rounding and clamping, and the distance of the
/// nearest corner.
struct Exact {
    first: [f64; 2],
    last: [f64; 2],
    nearest_m: f64,
    /// Error bound of screen positions in f32, pixels.
    margin: [f64; 2],
    /// Error bound of the nearest distance, m.
    nearest_off_m: f64,
    /// Largest error bound of the distance of a corner, relative to this distance.
    off: f64,
}

fn exact(row: &[f64]) -> Exact {
    let [x, y, w] = clip_rows(row);
    let mut all = Exact {
        first: [f64::INFINITY; 2],
        last: [f64::NEG_INFINITY; 2],
        nearest_m: f64::INFINITY,
        margin: [0.0; 2],
        nearest_off_m: 0.0,
        off: 0.0,
    };
    for corner in 0..8 {
        let place = [0, 1, 2].map(|i| row[if corner >> i & 1 == 1 { HIGH } else { LOW } + i]);
        let sum = |r: [f64; 4]| r[0] * place[0] + r[1] * place[1] + r[2] * place[2] + r[3];
        let size =
            |r: [f64; 4]| SLACK * ((r[0] * place[0]).abs() + (r[1] * place[1]).abs() + (r[2] * place[2]).abs() + r[3].abs()) + FLUSHED;
        let distance = sum(w);
        if distance < all.nearest_m {
            (all.nearest_m, all.nearest_off_m) = (distance, size(w));
        }
        all.off = all.off.max(size(w) / distance.abs());
        for (k, r) in [x, y.map(|v| -v)].into_iter().enumerate() {
            let q = sum(r) / distance;
            let at = (0.5 + 0.5 * q) * row[SIZE + k];
            (all.first[k], all.last[k]) = (all.first[k].min(at), all.last[k].max(at));
            let off = (size(r) + q.abs().min(4.0) * size(w)) / distance.abs() + 1e-6 * (1.0 + q.abs().min(4.0));
            all.margin[k] = all.margin[k].max(off * row[SIZE + k]);
        }
    }
    all
}

/// Largest number of columns or rows by which the reported pixels extend beyond the pixels that the box spans, over the four sides of the box; at
/// least 0.
fn widened(row: &[f64], exact: &Exact, got: &[f64]) -> f64 {
    let inside = |k: usize, x: f64| x.floor().clamp(0.0, row[SIZE + k] - 1.0);
    let before = (0..2).map(|k| inside(k, exact.first[k]) - got[1 + k]);
    let after = (0..2).map(|k| got[3 + k] - inside(k, exact.last[k]));
    before.chain(after).fold(0.0, f64::max)
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a picture")]
fn occlusion_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let flag = |on: bool| if on { T::one() } else { T::zero() };
    let seen = culling::cover(clip_rows(row), row[NEAR], take(row, LOW), take(row, HIGH), take(row, SIZE));
    let nothing = Cover { first: [T::zero(); 2], last: [T::zero(); 2], depth: T::one() };
    let Cover { first, last, depth } = seen.unwrap_or(nothing);
    let [from, to] = [first, last].map(|at| at.map(|x| x.to_f64() as u32));
    let hidden = seen.is_some() && culling::hidden(depth, take(row, STORED));
    let level = culling::level(from, to);
    let [columns, rows] = culling::level_size(take(row, SIZE).map(|side: T| side.to_f64() as u32), level);
    out.extend([
        flag(seen.is_some()),
        first[0],
        first[1],
        last[0],
        last[1],
        T::of(f64::from(level)),
        depth,
        flag(hidden),
        T::of(f64::from(columns)),
        T::of(f64::from(rows)),
    ]);
}

/// If the cover is known, the reported pixels must contain all covered pixels. They may extend beyond the covered pixels by at most twice the margin
/// for rounding errors. Only boxes that lie behind all stored depths may be hidden.
fn occlusion_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let truth = exact(row);
    let stored = row[STORED..].iter().copied().fold(f64::INFINITY, f64::min);
    let has_number = row[STORED..].iter().all(|x| !x.is_nan());
    let nearest = row[NEAR] / truth.nearest_m;
    // The answer `hidden` is correct if the box is in front of the eye and all stored depths are nearer.
    let is_right = got[7] == 0.0 || (has_number && nearest > 0.0 && nearest < stored);
    let inside = |k: usize, x: f64| x.floor().clamp(0.0, row[SIZE + k] - 1.0);
    let covers =
        (0..2).all(|k| got[1 + k] <= inside(k, truth.first[k]) && got[3 + k] >= inside(k, truth.last[k]) && got[1 + k] <= got[3 + k]);
    let is_deep = got[6] >= nearest.min(1.0);
    // If the result says that the cover is known (`known` is 1), the other results must be correct.
    if got[0] == 1.0 && !(truth.nearest_m > 0.0 && covers && is_deep && is_right) {
        return Verdict::Differs;
    }
    // Implementations may disagree on whether the cover is known in three cases: if the nearest corner is close to the near plane, if the error of
    // the distance is close to its limit, or if a number is close to an end of the supported range.
    let by_near = (truth.nearest_m - row[NEAR]).abs() <= 4.0 * truth.nearest_off_m;
    let by_loss = (0.9..1.1).contains(&(truth.off / KNOWN));
    let at_an_end = row[..SIZE].iter().any(|&x| is_next_to(x, MOST)) || is_next_to(row[NEAR], NEAREST);
    if got[0] != want[0] {
        return if by_near || by_loss || at_an_end { Verdict::OtherSide } else { Verdict::Differs };
    }
    if got[0] == 0.0 {
        return if got == want { Verdict::Agrees(0.0) } else { Verdict::Differs };
    }
    let close = (0..2).all(|k| {
        // Positions that are far outside the picture are clamped, because the tested function clamps them, too.
        let held = |x: f64| x.clamp(-1.5 * row[SIZE + k], 2.5 * row[SIZE + k]);
        let (low, high) = (held(truth.first[k]) - 2.0 * truth.margin[k], held(truth.last[k]) + 2.0 * truth.margin[k]);
        got[1 + k] >= inside(k, low) && got[3 + k] <= inside(k, high)
    });
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pixels of a picture")]
    let level = culling::level([got[1] as u32, got[2] as u32], [got[3] as u32, got[4] as u32]);
    // The expected size of the level: the side of the picture / 2^level, rounded up.
    let texels = [0, 1].map(|k| (row[SIZE + k] / f64::from(level).exp2()).ceil());
    let is_close = got[6] <= nearest * (1.0 + 2.0 * truth.off + 4e-6);
    if !(close && f64::from(level) == got[5] && texels == [got[8], got[9]] && is_close) {
        return Verdict::Differs;
    }
    if got[1..6] == want[1..6] && got[7] == want[7] {
        return Verdict::Agrees(if got[6] == want[6] { 0.0 } else { (got[6] / want[6] - 1.0).abs() / (2.0 * truth.off + 4e-6) });
    }
    let by_stored = (stored / nearest - 1.0).abs() <= 3.0 * truth.off + 6e-6;
    if got[7] == want[7] || by_stored { Verdict::OtherSide } else { Verdict::Differs }
}

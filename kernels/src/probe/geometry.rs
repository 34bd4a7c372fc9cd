//! Probes of positions computed from depth, and of the vertices that are moved at the edges of nodes.

use super::judge::{EPS, Verdict, close, equal, farthest};
use super::{Measure, Parameter, Probe, real, take, whole};
use crate::geometry::reference;
use crate::shared::real::{Real, scale};
use crate::shared::view;

/// Largest number of levels by which a neighbour may be coarser: the number is stored in four bits.
const DELTAS: i32 = 15;

pub(super) const DEPTH_POSITION: Probe = Probe {
    name: "depth-position",
    about: "Position of the ground at a pixel, relative to the eye, computed from the depth; the camera looks along y",
    inputs: &[
        real("pixel_x", "whole numbers are pixel centres"),
        real("pixel_y", "whole numbers are pixel centres"),
        real("depth", "near plane's distance / distance along the view, 0..1"),
        real("near_m", "m"),
        real("half_width", "tangent of half the field of view"),
        whole("width", "pixels of the picture; its height is half of the width", 1, 1 << 24),
    ],
    outputs: &[real("x", "m"), real("y", "m"), real("z", "m")],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 6>) -> array<f32, 3> {
    let pitch = 2.0 * row[4] / row[5];
    let first = 0.5 * (vec2<f32>(row[5], 0.5 * row[5]) - vec2<f32>(1.0)) * pitch;
    let ray = view_ray(
        vec3<f32>(-first.x, 1.0, first.y), vec3<f32>(pitch, 0.0, 0.0), vec3<f32>(0.0, 0.0, -pitch), vec2<f32>(row[0], row[1])
    );
    let p = ray * view_distance(row[3], row[2]);
    return array<f32, 3>(p.x, p.y, p.z);
}",
    single: depth_position_row,
    double: depth_position_row,
    random: |d| {
        let width = 64.0 + d.whole(4000);
        let near = d.between(-10.0, 0.0).exp2();
        let pixel = [d.whole(4096) % width, (d.whole(4096) % (0.5 * width)).floor()];
        vec![pixel[0], pixel[1], near / d.between(0.0, 20.0).exp2(), near, d.between(-3.0, 1.0).exp2(), width]
    },
    judge: depth_position_judge,
    measures: &[Measure {
        name: "place",
        unit: "px",
        error: |row, got, want| {
            let pitch = 2.0 * row[4] / row[5];
            farthest(got, want) / (want[1].abs().max(f64::from(f32::MIN_POSITIVE)) * pitch)
        },
    }],
    parameters: &[
        Parameter { name: "fov_deg", unit: "deg", set: |row, value, _| row[4] = (value / 2.0).to_radians().tan() },
        Parameter { name: "distance_m", unit: "m along the view", set: |row, value, _| row[2] = row[3] / value },
    ],
};

/// Step of the ray from pixel to pixel, and the distances of the centre of pixel (0, 0) from the middle of the picture, to the left and up. All are
/// measured at the distance 1 along the view.
fn depth_position_rays<T: Real>(row: &[T]) -> (T, [T; 2]) {
    let half = T::of(0.5);
    let pitch = T::of(2.0) * row[4] / row[5];
    (pitch, [row[5], half * row[5]].map(|side| half * (side - T::one()) * pitch))
}

fn depth_position_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let zero = T::zero();
    let (pitch, [left, up]) = depth_position_rays(row);
    let rays = [[-left, T::one(), up], [pitch, zero, zero], [zero, zero, -pitch]];
    out.extend(scale(view::ray(rays, take(row, 0)), view::distance(row[3], row[2])));
}

fn depth_position_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (pitch, [left, up]) = depth_position_rays(row);
    // `pitch` has an error of 2.5 ULP, from its division. It is multiplied by the pixel and, in `left` and `up`, by half of the size minus 1; these
    // products have an error of 3 ULP. Their difference may cancel digits, so errors are relative to `along`: the sum of the magnitudes of the
    // products, plus 1 for the component along the view. The two sums add 1 ULP, the division of `near_m` by the depth 2.5 ULP, and the last product
    // 0.5 ULP. The tolerance is 8 ULP.
    let along = 1.0 + left.abs() + up.abs() + pitch * (row[0].abs() + row[1].abs());
    close(got, want, 8.0 * EPS * along * want[1].abs() + f64::from(f32::MIN_POSITIVE))
}

pub(super) const WELD: Probe = Probe {
    name: "weld",
    about: "The vertex to which a vertex of a node is moved if neighbouring nodes are coarser",
    inputs: &[
        whole("x", "index of the vertex, counted from the west", 0, 128),
        whole("y", "index of the vertex, counted from the south", 0, 128),
        whole("west", "number of levels by which the western neighbour is coarser", 0, DELTAS),
        whole("south", "number of levels by which the southern neighbour is coarser", 0, DELTAS),
        whole("east", "number of levels by which the eastern neighbour is coarser", 0, DELTAS),
        whole("north", "number of levels by which the northern neighbour is coarser", 0, DELTAS),
    ],
    outputs: &[whole("to_x", "index from the west", 0, 128), whole("to_y", "index from the south", 0, 128)],
    blocks: None,
    wgsl: "\
fn probe(row: array<f32, 6>) -> array<f32, 2> {
    let deltas = u32(row[2]) | (u32(row[3]) << 4u) | (u32(row[4]) << 8u) | (u32(row[5]) << 12u);
    let to = geometry_stitch(vec2<u32>(u32(row[0]), u32(row[1])), vec2<u32>(0u), 128u, deltas);
    return array<f32, 2>(f32(to.x), f32(to.y));
}",
    single: weld_row,
    double: weld_row,
    random: |d| {
        let at = [0; 2].map(|_| if d.whole(3) < 0.5 { 128.0 * d.whole(2) } else { d.whole(129) });
        [&at[..], &[0; 4].map(|_| d.whole(8))].concat()
    },
    judge: equal,
    measures: &[Measure { name: "vertex", unit: "vertices", error: |_, got, want| farthest(got, want) }],
    parameters: &[],
};

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
fn weld_row<T: Real>(row: &[T], out: &mut Vec<T>) {
    let [x, y, west, south, east, north] = take::<T, 6>(row, 0).map(|v| v.to_f64() as u32);
    let to = reference::stitch([x, y], [0, 0], 128, west | south << 4 | east << 8 | north << 12);
    out.extend(to.map(|v| T::of(f64::from(v))));
}

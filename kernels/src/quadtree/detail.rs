//! Detail: by how much the surface of a patch changes if only every n-th vertex is drawn.

use crate::world::NODE_QUADS;
use crate::world::cones;
use crate::world::payload::{diagonal_rises, height_in_quad};

/// The vertex strides above 1 for which the error is known. With the last stride, a patch consists of two triangles.
pub const COARSE_STRIDES: [u32; 4] = [2, 4, 8, 16];

/// For each stride, the largest difference in height between the surface of a patch with all vertices and its surface with this stride, in the unit
/// of the heights. Both surfaces consist of quads whose diagonals alternate in direction. `height(i, j)` is the height of the vertex in column i and
/// row j of the patch, both 0..=16.
///
/// Only vertices are compared. The largest difference is at a corner of an area in which both surfaces are plane, and all these corners are vertices.
/// The reason is that the diagonals of the smaller quads alternate: the diagonal of a larger quad runs along such diagonals and crosses none.
pub fn stride_errors(height: impl Fn(usize, usize) -> f64) -> [f64; COARSE_STRIDES.len()] {
    let quads = NODE_QUADS as usize / cones::PATCHES;
    COARSE_STRIDES.map(|stride| {
        let stride = stride as usize;
        let mut largest = 0.0f64;
        for (y, x) in (0..quads).step_by(stride).flat_map(|y| (0..quads).step_by(stride).map(move |x| (y, x))) {
            let corners = [(0, 0), (stride, 0), (0, stride), (stride, stride)].map(|(dx, dy)| height(x + dx, y + dy));
            let rises = diagonal_rises(x / stride, y / stride);
            let coarse = |u, v| height_in_quad(corners, rises, u, v);
            let part = |i: usize| i as f64 / stride as f64;
            for j in 0..=stride {
                for i in 0..=stride {
                    largest = largest.max((height(x + i, y + j) - coarse(part(i), part(j))).abs());
                }
            }
        }
        largest
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shared::hash;

    #[test]
    fn the_error_of_a_stride_is_the_largest_difference_of_the_surfaces() {
        for (case, roughness) in (0..20u32).zip([0.0, 1.0, 10.0, 1000.0].into_iter().cycle()) {
            let heights: Vec<f64> = (0..17u32 * 17)
                .map(|i| {
                    let [x, y] = [i % 17, i / 17].map(f64::from);
                    let [a, b, c, d] = hash::pcg4d([case, 3, 5, 9]).map(|word| f64::from(word) / 4_294_967_296.0);
                    let rough = f64::from(hash::pcg4d([i, case, 1, 2])[0]) / 4_294_967_296.0;
                    100.0 + a * x - b * y + roughness * (c * x * x - d * x * y + rough)
                })
                .collect();
            let surface = |stride: usize, x: f64, y: f64| {
                let [i, j] = [x, y].map(|at| (at as usize / stride).min(16 / stride - 1));
                let [u, v] = [x / stride as f64 - i as f64, y / stride as f64 - j as f64];
                let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(a, b)| heights[(j + b) * stride * 17 + (i + a) * stride]);
                height_in_quad(corners, diagonal_rises(i, j), u, v)
            };
            for (error, stride) in stride_errors(|x, y| heights[17 * y + x]).into_iter().zip(COARSE_STRIDES) {
                // A grid of points half a quad apart contains all vertices and the centres of all quads. At other points, the difference is not
                // larger.
                let at = |step: f64, i: u32| [f64::from(i % 33) * step, f64::from(i / 33) * step];
                let difference = |[x, y]: [f64; 2]| (surface(1, x, y) - surface(stride as usize, x, y)).abs();
                let largest = (0..33 * 33).map(|i| difference(at(0.5, i))).fold(0.0, f64::max);
                assert!((error - largest).abs() <= 1e-9 * (1.0 + largest), "stride {stride}: {error} and not {largest}");
                let elsewhere = (0..33 * 33).map(|i| difference(at(0.49, i))).fold(0.0, f64::max);
                assert!(elsewhere <= error + 1e-9 * (1.0 + error), "stride {stride}: {elsewhere} of {error}");
            }
        }
    }
}

//! Computes at which pixel an earlier camera saw a point of this frame, from depth and the two cameras.
//!
//! The earlier camera sees pixel (x, y) along the ray r(x, y) = r00 + x dx + y dy. Here, r00 is the ray of pixel (0, 0), and dx and dy are the steps
//! of the ray to the right and down. The component of each ray along the view direction f is 1. So a point q, relative to the earlier eye, has the
//! distance t = q . f along f. Because dx is perpendicular to f and dy, its pixel has x = q . dx / (t |dx|^2) - r00 . dx / |dx|^2. The formula for y
//! is analogous. This is the pinhole projection (Hartley & Zisserman, *Multiple View Geometry*, 2003, section 6.1), without a matrix whose
//! translation would lose digits far from the origin.

use bytemuck::{Pod, Zeroable};

use super::real::{Real, add, dot, length, scale};

/// A point is reprojected only if its distance along the earlier view direction is larger than this, metres.
pub const MIN_DISTANCE: f64 = 1e-4;
/// A point is reprojected only if its distance along the earlier view direction is smaller than this, metres.
pub const FAR: f64 = 1e9;

/// The camera of an earlier frame, relative to the eye of a later frame. In the descriptions of the fields, q is a point relative to the earlier eye,
/// and the distance is dot(`forward`, q).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Past<T> {
    /// The later eye minus the earlier one, metres.
    pub offset: [T; 3],
    /// The earlier view direction.
    pub forward: [T; 3],
    /// Pixel x = dot(`x_row`, q) / distance - `x_shift`.
    pub x_row: [T; 3],
    /// Pixel y = dot(`y_row`, q) / distance - `y_shift`.
    pub y_row: [T; 3],
    /// Shift of x, pixels.
    pub x_shift: T,
    /// Shift of y, pixels.
    pub y_shift: T,
}

/// The fields of `Past` in f32; the layout matches `MotionPast` in `motion.wgsl`, where the fields are explained.
#[allow(missing_docs, reason = "the WGSL struct of the same field names explains them; a test compares the two")]
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct MotionPast {
    pub offset: [f32; 3],
    pub x_shift: f32,
    pub forward: [f32; 3],
    pub y_shift: f32,
    pub x_row: [f32; 3],
    pub pad_0: f32,
    pub y_row: [f32; 3],
    pub pad_1: f32,
}

impl<T: Real> Past<T> {
    /// The camera in a different precision.
    pub fn cast<U: Real>(&self) -> Past<U> {
        let v = |a: [T; 3]| a.map(|x| U::of(x.to_f64()));
        Past {
            offset: v(self.offset),
            forward: v(self.forward),
            x_row: v(self.x_row),
            y_row: v(self.y_row),
            x_shift: U::of(self.x_shift.to_f64()),
            y_shift: U::of(self.y_shift.to_f64()),
        }
    }

    /// The camera in the layout that the shader reads.
    pub fn uniform(&self) -> MotionPast {
        let p = self.cast::<f32>();
        MotionPast {
            offset: p.offset,
            x_shift: p.x_shift,
            forward: p.forward,
            y_shift: p.y_shift,
            x_row: p.x_row,
            pad_0: 0.0,
            y_row: p.y_row,
            pad_1: 0.0,
        }
    }
}

/// Pixel and distance at which the earlier camera sees a point, which is given relative to the later eye. The distance is along the earlier view
/// direction. The result is `[-1e9, -1e9, 0]` if the distance is not between [`MIN_DISTANCE`] and [`FAR`], if a coordinate of the pixel is beyond
/// 1e9, or if the input is not finite. In WGSL: `motion_reproject`.
pub fn reproject<T: Real>(point: [T; 3], past: &Past<T>) -> [T; 3] {
    let nowhere = [T::of(-1e9), T::of(-1e9), T::zero()];
    let q = add(point, past.offset);
    let distance = dot(q, past.forward);
    if !(distance > T::of(MIN_DISTANCE) && distance < T::of(FAR)) {
        return nowhere;
    }
    let pixel = [dot(q, past.x_row) / distance - past.x_shift, dot(q, past.y_row) / distance - past.y_shift];
    if pixel.iter().all(|p| p.abs() <= T::of(1e9)) { [pixel[0], pixel[1], distance] } else { nowhere }
}

/// The ray of a pixel of the earlier camera. Its component along the view direction is 1. Zero if a component of the ray is NaN or beyond 1e30. In
/// WGSL: `motion_past_ray`.
pub fn past_ray<T: Real>(past: &Past<T>, pixel: [T; 2]) -> [T; 3] {
    let x = (pixel[0] + past.x_shift) / dot(past.x_row, past.x_row);
    let y = (pixel[1] + past.y_shift) / dot(past.y_row, past.y_row);
    let ray = add(past.forward, add(scale(past.x_row, x), scale(past.y_row, y)));
    if ray.iter().all(|x| x.abs() <= T::of(1e30)) { ray } else { [T::zero(); 3] }
}

/// Distance along the earlier view direction at which `ray`, the ray of a pixel of the earlier camera, meets a plane. The plane goes through `point`,
/// which is relative to the later eye, and has the unit normal `normal`. The result is 0 if the plane is almost edge-on, or if the distance is not
/// between [`MIN_DISTANCE`] and [`FAR`]. In WGSL: `motion_expected_distance`.
pub fn expected_distance<T: Real>(point: [T; 3], past: &Past<T>, ray: [T; 3], normal: [T; 3]) -> T {
    let along = dot(normal, ray);
    let distance = dot(normal, add(point, past.offset)) / along;
    let hit = along.abs() > T::of(1e-6) * length(ray) && distance > T::of(MIN_DISTANCE) && distance < T::of(FAR);
    if hit { distance } else { T::zero() }
}

/// Whether a surface at the distance `found` in the earlier frame is the surface that is expected at the distance `expected`. The distances
/// may differ by at most `tolerance` times `expected`. A distance of 0 means that there is no surface. In WGSL: `motion_same_surface`.
pub fn same_surface<T: Real>(found: T, expected: T, tolerance: T) -> bool {
    found > T::zero() && expected > T::zero() && (found - expected).abs() <= tolerance * expected
}

/// Whether a row of pixels belongs to a quarter of the rows, `quarter` = 0..=3. Each quarter has one row of each group of four consecutive rows. From
/// each group to the next, the position of this row in the group moves by one. In WGSL: `motion_row_of_quarter`, which returns the row of a quarter
/// in a group.
pub fn in_quarter(row: u32, quarter: u32) -> bool {
    row % 4 == (quarter + row / 4) % 4
}

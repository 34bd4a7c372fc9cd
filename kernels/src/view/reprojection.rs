//! The camera of an earlier frame, relative to the eye of a later frame.

use glam::DVec3;

use crate::shared::motion::Past;
use crate::view::camera::View;

impl Past<f64> {
    /// The parameters that project points onto the earlier view `past`. Points are given relative to the eye of `now`. Both views belong to the same
    /// world.
    pub fn between(now: &View, past: &View) -> Past<f64> {
        let row = |d: DVec3| d / d.length_squared();
        let (x_row, y_row) = (row(past.ray_dx), row(past.ray_dy));
        Past {
            offset: (now.pose.position - past.pose.position).to_array(),
            forward: past.pose.axes()[2].to_array(),
            x_row: x_row.to_array(),
            y_row: y_row.to_array(),
            x_shift: past.ray_00.dot(x_row),
            y_shift: past.ray_00.dot(y_row),
        }
    }
}

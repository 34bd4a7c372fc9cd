//! Camera poses, and the rays through their pixels.

use std::f64::consts::PI;

use glam::{BVec3, DMat4, DVec2, DVec3, DVec4, IVec2, Mat4};

use crate::scene::{CameraPath, CameraPose};
use crate::shared::culling;

/// Distance of the near plane, metres. Depth is reversed and the far plane lies at infinity, so a small value costs little precision at large
/// distances.
pub const NEAR_M: f64 = 0.1;

/// A camera in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Position in the world, metres; z = elevation.
    pub position: DVec3,
    /// Compass bearing of the view direction, radians: 0 = north (+y), pi/2 = east (+x).
    pub yaw: f64,
    /// Elevation angle of the view direction above the horizon, radians.
    pub pitch: f64,
    /// Vertical field of view, radians.
    pub fov: f64,
}

impl Pose {
    /// The pose of a scene's camera. `ground_m` gives the elevation of the ground at a point; it is used if the pose is relative to the ground.
    pub fn of(camera: &CameraPose, ground_m: impl Fn(f64, f64) -> f64) -> Pose {
        let [x, y, z] = camera.position;
        let base = if camera.above_ground { ground_m(x, y) } else { 0.0 };
        Pose {
            position: DVec3::new(x, y, z + base),
            yaw: camera.yaw_deg.to_radians(),
            pitch: camera.pitch_deg.to_radians(),
            fov: camera.fov_deg.to_radians(),
        }
    }

    /// Unit vectors to the right, up and forward.
    pub fn axes(&self) -> [DVec3; 3] {
        let (sin_yaw, cos_yaw) = self.yaw.sin_cos();
        let (sin_pitch, cos_pitch) = self.pitch.sin_cos();
        let forward = DVec3::new(sin_yaw * cos_pitch, cos_yaw * cos_pitch, sin_pitch);
        let right = DVec3::new(cos_yaw, -sin_yaw, 0.0);
        [right, right.cross(forward), forward]
    }
}

/// The pose of frame `frame` of a path: a Catmull-Rom spline through the keys. From each key to the next, the camera turns the shorter way. Frames
/// after the last key have the pose of that key. `ground_m` gives the elevation of the ground at a point. If all keys are relative to the ground, the
/// pose of each frame is relative to the ground, too.
pub fn along(path: &CameraPath, frame: u32, ground_m: impl Fn(f64, f64) -> f64) -> Pose {
    let on_ground = path.keys.iter().all(|k| k.above_ground);
    let mut keys: Vec<Pose> = path.keys.iter().map(|k| Pose::of(k, |x, y| if on_ground { 0.0 } else { ground_m(x, y) })).collect();
    for i in 1..keys.len() {
        let turn = (keys[i].yaw - keys[i - 1].yaw + PI).rem_euclid(2.0 * PI) - PI;
        keys[i].yaw = keys[i - 1].yaw + turn;
    }
    let last = keys.len().saturating_sub(1);
    let per_key = path.frames_per_key.max(1);
    let whole = ((frame / per_key) as usize).min(last);
    let t = if whole == last { 0.0 } else { f64::from(frame % per_key) / f64::from(per_key) };
    let at = |i: usize| keys[i.min(last)];
    let [p0, p1, p2, p3] = [at(whole.saturating_sub(1)), at(whole), at(whole + 1), at(whole + 2)];
    let spline =
        |a: f64, b: f64, c: f64, d: f64| b + 0.5 * t * (c - a + t * (2.0 * a - 5.0 * b + 4.0 * c - d + t * (3.0 * (b - c) + d - a)));
    let mut position = DVec3::from_array(std::array::from_fn(|k| spline(p0.position[k], p1.position[k], p2.position[k], p3.position[k])));
    if on_ground {
        position.z += ground_m(position.x, position.y);
    }
    Pose {
        position,
        yaw: spline(p0.yaw, p1.yaw, p2.yaw, p3.yaw),
        pitch: spline(p0.pitch, p1.pitch, p2.pitch, p3.pitch),
        fov: spline(p0.fov, p1.fov, p2.fov, p3.fov),
    }
}

/// A camera pose and the size of its image, with the rays and the matrix that follow from them. The position of the pose is in world coordinates.
///
/// *Local* coordinates: x, y relative to the south-west corner of the camera's sector, z = elevation.
#[derive(Clone, Copy, Debug)]
pub struct View {
    /// The pose.
    pub pose: Pose,
    /// Image size in pixels.
    pub size: [u32; 2],
    /// Sector of the camera, counted from the world's south-west corner. It may lie outside the world.
    pub sector: IVec2,
    /// Camera position in local coordinates.
    pub camera: DVec3,
    /// Ray through the sample point of pixel (0, 0), which is the centre of the pixel if there is no jitter. Its component along the view direction
    /// is 1.
    pub ray_00: DVec3,
    /// Step of the ray from a pixel to its neighbour on the right.
    pub ray_dx: DVec3,
    /// Step of the ray from a pixel to its neighbour below.
    pub ray_dy: DVec3,
    /// The matrix from local coordinates to clip space, with reversed depth and the far plane at infinity.
    pub clip_from_local: DMat4,
}

impl View {
    /// Makes the view of a pose. `jitter` is the offset of the sample points from the pixel centres, in pixels to the right and down. `sector_m` and
    /// `world_m` are the edge lengths of a sector and of the world, metres.
    #[allow(clippy::cast_possible_truncation, reason = "a sector index fits i32 for any position a scene can state")]
    pub fn new(pose: Pose, size: [u32; 2], jitter: [f64; 2], sector_m: f64, world_m: f64) -> View {
        let corner = DVec2::splat(-world_m / 2.0);
        let sector = ((pose.position.truncate() - corner) / sector_m).floor();
        let origin = corner + sector * sector_m;
        let camera = (pose.position.truncate() - origin).extend(pose.position.z);
        let [right, up, forward] = pose.axes();
        let (width, height) = (f64::from(size[0]), f64::from(size[1]));
        let half_height = (pose.fov / 2.0).tan();
        let half_width = half_height * width / height;
        let ray_dx = right * (2.0 * half_width / width);
        let ray_dy = -up * (2.0 * half_height / height);
        let ray_00 = forward - right * half_width + up * half_height + ray_dx * (0.5 + jitter[0]) + ray_dy * (0.5 + jitter[1]);
        // x_clip = x_view / half_width, y_clip = y_view / half_height. Moving the sample points by the jitter shifts the image in the opposite
        // direction. z_clip = `NEAR_M`, w_clip = distance along the view direction.
        let shift = DVec2::new(-2.0 * jitter[0] / width, 2.0 * jitter[1] / height);
        let view_rows = [right / half_width + forward * shift.x, up / half_height + forward * shift.y, DVec3::ZERO, forward];
        let rows = view_rows.map(|r| r.extend(-r.dot(camera)));
        let rows = [rows[0], rows[1], DVec4::new(0.0, 0.0, 0.0, NEAR_M), rows[3]];
        let clip_from_local = DMat4::from_cols(rows[0], rows[1], rows[2], rows[3]).transpose();
        View { pose, size, sector: IVec2::new(sector.x as i32, sector.y as i32), camera, ray_00, ray_dx, ray_dy, clip_from_local }
    }

    /// The matrix in f32, for the vertex stage.
    pub fn clip_from_local_f32(&self) -> Mat4 {
        self.clip_from_local.as_mat4()
    }

    /// The ray through the point (`x`, `y`) of the image, pixels. Whole numbers are the sample points of pixels.
    pub fn ray(&self, x: f64, y: f64) -> DVec3 {
        self.ray_00 + self.ray_dx * x + self.ray_dy * y
    }

    /// Upper bound on the shift on the screen, pixels per metre, of a visible point that moves in any direction. The point lies in the box from `low`
    /// to `high` (local coordinates). The bound holds for moves that are small compared with the distance from the camera.
    ///
    /// Let w be the depth of the point along the view direction, and a the angle between its ray and the view direction. The point shifts most on the
    /// screen if it moves perpendicular to its ray, in the plane of ray and view direction. For a move of 1 m, it then shifts by f / (w cos a)
    /// pixels, where f is the focal length in pixels.
    pub fn shift_px_per_m(&self, low: DVec3, high: DVec3) -> f64 {
        let [_, _, forward] = self.pose.axes();
        let [right, bottom] = self.size.map(|n| f64::from(n) - 0.5);
        // The largest 1 / cos a in the picture.
        let widest = [(-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom)]
            .map(|(x, y)| self.ray(x, y).length())
            .into_iter()
            .fold(1.0, f64::max);
        let (mut depth, mut slant) = (f64::INFINITY, 1.0f64);
        for i in 0..8 {
            let corner = DVec3::select(BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), high, low) - self.camera;
            let along = corner.dot(forward);
            depth = depth.min(along);
            slant = slant.max(if along > 0.0 { corner.length() / along } else { f64::INFINITY });
        }
        let nearest = self.camera.distance(self.camera.clamp(low, high));
        slant.min(widest) / depth.max(nearest / widest).max(NEAR_M) / self.ray_dx.length()
    }

    /// Whether a box in local coordinates may be visible: false only if it lies completely outside one of the frustum's planes ([`culling::beyond`]).
    /// A box with NaN counts as visible.
    pub fn sees(&self, low: DVec3, high: DVec3) -> bool {
        let m = self.clip_from_local;
        let (rx, ry, rw) = (m.row(0), m.row(1), m.row(3));
        let near = rw - DVec4::new(0.0, 0.0, 0.0, NEAR_M);
        let planes = [rw + rx, rw - rx, rw + ry, rw - ry, near];
        !planes.into_iter().any(|plane| culling::beyond(plane.to_array(), low.to_array(), high.to_array()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> Pose {
        Pose { position: DVec3::new(100.0, -50.0, 30.0), yaw: 0.7, pitch: -0.2, fov: 0.9 }
    }

    #[test]
    fn no_visible_point_of_a_box_moves_by_more_than_the_bound() {
        let view = View::new(pose(), [320, 180], [0.0; 2], 64.0, 10_240.0);
        let on_screen = |point: DVec3| {
            let clip = view.clip_from_local * point.extend(1.0);
            DVec2::new(160.0 * clip.x, 90.0 * clip.y) / clip.w
        };
        let mut closest = 0.0f64;
        for i in 0..2000u32 {
            let unit = |k: u32| f64::from(crate::shared::hash::pcg4d([i, k, 4, 1])[0]) / 4_294_967_296.0;
            let point = view.camera + view.ray(320.0 * unit(0) - 0.5, 180.0 * unit(1) - 0.5) * (1.0 + 900.0 * unit(2) * unit(2));
            let size = DVec3::new(unit(3), unit(4), unit(5)) * 20.0 * unit(6);
            let low = point - size * DVec3::new(unit(7), unit(8), unit(9));
            let direction = DVec3::new(unit(10) - 0.5, unit(11) - 0.5, unit(12) - 0.5).normalize();
            let step = 1e-6;
            let moved = on_screen(point + direction * step).distance(on_screen(point)) / step;
            let bound = view.shift_px_per_m(low, low + size);
            assert!(moved <= bound * (1.0 + 1e-4), "moved by {moved} px per m, the bound is {bound}");
            closest = closest.max(moved / bound);
        }
        assert!(closest > 0.9, "the bound is far too large: the largest move is {closest} of its bound");
    }

    #[test]
    fn rays_and_matrix_agree_also_with_jitter() {
        for jitter in [[0.0, 0.0], [0.3, -0.45]] {
            let view = View::new(pose(), [320, 180], jitter, 64.0, 10_240.0);
            for (x, y, depth) in [(0.0, 0.0, 5.0), (200.0, 17.0, 900.0), (319.0, 179.0, 0.3)] {
                let point = view.camera + view.ray(x, y) * depth;
                let clip = view.clip_from_local * point.extend(1.0);
                let pixel = DVec2::new((clip.x / clip.w * 0.5 + 0.5) * 320.0 - 0.5, (0.5 - clip.y / clip.w * 0.5) * 180.0 - 0.5);
                assert!((pixel - DVec2::new(x, y)).length() < 1e-9, "{pixel} instead of {x} {y}");
                assert!((clip.z / clip.w - NEAR_M / depth).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn ten_kilometres_from_the_origin_a_view_is_the_same() {
        // A view is relative to the sector of the camera, so a view that is moved by whole sectors has the same numbers, apart from the sector.
        let (near, far) = (pose(), Pose { position: pose().position + DVec3::new(156.0 * 64.0, -156.0 * 64.0, 0.0), ..pose() });
        let [near, far] = [near, far].map(|pose| View::new(pose, [320, 180], [0.3, -0.45], 64.0, 32_768.0));
        assert_eq!((near.camera, near.ray_00, near.ray_dx, near.ray_dy), (far.camera, far.ray_00, far.ray_dx, far.ray_dy));
        assert_eq!(near.clip_from_local_f32(), far.clip_from_local_f32());
        assert_eq!(far.sector - near.sector, IVec2::new(156, -156));
    }

    #[test]
    fn paths_turn_the_short_way_and_stay_above_the_ground() {
        let key = |x: f64, yaw_deg: f64| CameraPose {
            name: String::new(),
            position: [x, 0.0, 2.0],
            above_ground: true,
            yaw_deg,
            pitch_deg: 0.0,
            fov_deg: 50.0,
        };
        let path = CameraPath { name: String::new(), frames_per_key: 4, keys: vec![key(0.0, 350.0), key(8.0, 10.0)] };
        // The crest of the ridge lies halfway between the two keys.
        let ridge = |x: f64, _: f64| 100.0 - (x - 4.0).abs();
        for frame in 0..=9 {
            let pose = along(&path, frame, ridge);
            assert!((pose.position.z - ridge(pose.position.x, 0.0) - 2.0).abs() < 1e-9, "frame {frame}");
            let yaw = pose.yaw.to_degrees();
            assert!((349.9..=370.1).contains(&yaw), "frame {frame} looks at {yaw}");
        }
        assert_eq!(along(&path, 0, ridge).position.x, 0.0);
        assert_eq!(along(&path, 4, ridge).position.x, 8.0);
        assert_eq!(along(&path, 9, ridge).position.x, 8.0);
    }

    #[test]
    fn camera_is_placed_in_its_sector() {
        let view = View::new(pose(), [16, 16], [0.0; 2], 64.0, 10_240.0);
        assert_eq!(view.sector, IVec2::new(81, 79));
        assert_eq!(view.camera, DVec3::new(36.0, 14.0, 30.0));
    }

    #[test]
    fn boxes_behind_are_not_seen() {
        let view = View::new(pose(), [320, 180], [0.0; 2], 64.0, 10_240.0);
        let forward = view.pose.axes()[2];
        let at = |d: f64| view.camera + forward * d;
        assert!(view.sees(at(50.0) - 1.0, at(50.0) + 1.0));
        assert!(!view.sees(at(-50.0) - 1.0, at(-50.0) + 1.0));
        assert!(view.sees(view.camera - 1.0, view.camera + 1.0));
    }
}

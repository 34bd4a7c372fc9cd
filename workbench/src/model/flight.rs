//! Moving the camera: flying, walking on the ground, or orbiting a place.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use eframe::egui::{InputState, Key, Vec2};
use glam::DVec3;
use kernels::view::camera::Pose;

/// Lowest and highest speed that the wheel can set, metres per second.
pub const SPEEDS_M_S: [f64; 2] = [0.05, 2000.0];
/// Factor by which a notch of the wheel changes the speed, or the distance from the camera to the orbited place.
const NOTCH: f64 = 1.15;
/// Limit of the pitch, up and down, radians. The view direction must not be parallel to the up axis.
const STEEPEST: f64 = FRAC_PI_2 - 1e-3;
/// Limits of the distance from the camera to the orbited place: smallest and largest, metres.
pub const ORBITS_M: [f64; 2] = [0.5, 50_000.0];
/// Largest angle, in radians, between the view direction and the direction to a place that counts as in the middle of the view. Rounding errors are
/// smaller, and an angle of this size is not visible.
const BESIDE: f64 = 1e-6;
/// Limits of the distance from the camera to the orbited place if the middle of the picture shows sky: smallest and largest, metres.
const AHEAD_M: [f64; 2] = [20.0, 2000.0];

/// The place that the camera orbits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Orbit {
    /// No place: the camera flies or walks.
    #[default]
    Off,
    /// The place at the inspected pixel or, if there is none, in the middle of the picture. The position of the place is not known until a picture
    /// has been drawn.
    Sought,
    /// The given place in world metres. It stays in the middle of the picture.
    About(DVec3),
}

/// How the camera moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// Speed, metres per second.
    pub speed_m_s: f64,
    /// Whether the camera stays at eye height over the ground.
    pub walking: bool,
    /// The place that the camera orbits, if it does not fly or walk.
    pub orbit: Orbit,
}

impl Default for Flight {
    fn default() -> Self {
        Flight { speed_m_s: 20.0, walking: false, orbit: Orbit::Off }
    }
}

impl Flight {
    /// The orbited place, if it is known.
    pub fn target(&self) -> Option<DVec3> {
        if let Orbit::About(target) = self.orbit { Some(target) } else { None }
    }

    /// Turns the view by a drag. The point under the pointer approximately follows the pointer. `drag` and `height` are in points; `height` is the
    /// height of the whole picture on the screen, magnification included. Returns false if the drag has no length or the picture has no height.
    pub fn turn(&self, pose: &mut Pose, drag: Vec2, height: f32) -> bool {
        if drag == Vec2::ZERO || height <= 0.0 {
            return false;
        }
        let angle = |points: f32| f64::from(points / height) * pose.fov;
        let (yaw, pitch) = (angle(-drag.x), angle(drag.y));
        pose.yaw = (pose.yaw + yaw).rem_euclid(TAU);
        pose.pitch = (pose.pitch + pitch).clamp(-STEEPEST, STEEPEST);
        true
    }

    /// Moves the camera for a number of seconds according to the keys that are held. When walking or orbiting, W and S move it horizontally. The
    /// orbited place moves along with the camera. Returns whether the keys call for a movement.
    pub fn advance(&mut self, pose: &mut Pose, input: &InputState, seconds: f64) -> bool {
        let held = |key: Key| f64::from(u8::from(input.key_down(key)));
        let wanted = [held(Key::D) - held(Key::A), held(Key::E) - held(Key::Q), held(Key::W) - held(Key::S)];
        if wanted == [0.0; 3] || input.modifiers.command {
            return false;
        }
        let [right, _, forward] = pose.axes();
        let level = self.walking || self.orbit != Orbit::Off;
        let forward = if level { DVec3::new(forward.x, forward.y, 0.0).normalize_or_zero() } else { forward };
        let direction = right * wanted[0] + DVec3::Z * wanted[1] + forward * wanted[2];
        let haste = if input.modifiers.shift { 4.0 } else { 1.0 };
        let step = direction.normalize_or_zero() * self.speed_m_s * haste * seconds;
        pose.position += step;
        if let Orbit::About(target) = &mut self.orbit {
            *target += step;
        }
        true
    }

    /// Changes the speed by a number of notches of the wheel.
    pub fn hasten(&mut self, notches: f64) {
        self.speed_m_s = (self.speed_m_s * NOTCH.powf(notches)).clamp(SPEEDS_M_S[0], SPEEDS_M_S[1]);
    }
}

/// Returns a pose that looks at `target` in the view direction of `pose`. Its distance from `target` is `distance_m`, clamped to [`ORBITS_M`]. Its
/// pitch is clamped to [`STEEPEST`].
fn around(pose: &Pose, target: DVec3, distance_m: f64) -> Pose {
    let [nearest, farthest] = ORBITS_M;
    let mut pose = Pose { yaw: pose.yaw.rem_euclid(TAU), pitch: pose.pitch.clamp(-STEEPEST, STEEPEST), ..*pose };
    let [_, _, forward] = pose.axes();
    pose.position = target - forward * distance_m.clamp(nearest, farthest);
    pose
}

/// Turns a pose so that `target` is in the middle of the view. The position changes only if it is almost straight above or below the target (see
/// `STEEPEST`), or if its distance from the target is not within [`ORBITS_M`].
pub fn facing(pose: &Pose, target: DVec3) -> Pose {
    let towards = target - pose.position;
    let level_m = towards.truncate().length();
    let yaw = if level_m > 0.0 { towards.x.atan2(towards.y) } else { pose.yaw };
    around(&Pose { yaw, pitch: towards.z.atan2(level_m), ..*pose }, target, towards.length())
}

/// Whether a place is in the middle of the view.
pub fn is_centred(pose: &Pose, target: DVec3) -> bool {
    let [_, _, forward] = pose.axes();
    let towards = target - pose.position;
    forward.dot(towards) > 0.0 && forward.cross(towards).length() <= BESIDE * towards.length()
}

/// A place to orbit if the middle of the picture shows sky. It is straight ahead. Its distance is four times the height of the camera over the
/// ground, clamped to `AHEAD_M`. `ground_m` is the elevation of the ground.
pub fn ahead(pose: &Pose, ground_m: f64) -> DVec3 {
    let [_, _, forward] = pose.axes();
    pose.position + forward * (4.0 * (pose.position.z - ground_m).abs()).clamp(AHEAD_M[0], AHEAD_M[1])
}

/// Moves the camera around `target` by a drag. `drag`, `height` and the result are as for [`Flight::turn`]; a drag over the whole height is half a
/// turn. Points nearer than the target move in the direction of the drag.
pub fn swing(pose: &mut Pose, target: DVec3, drag: Vec2, height: f32) -> bool {
    if drag == Vec2::ZERO || height <= 0.0 {
        return false;
    }
    let angle = |points: f32| f64::from(points / height) * PI;
    let turned = Pose { yaw: pose.yaw + angle(drag.x), pitch: pose.pitch - angle(drag.y), ..*pose };
    *pose = around(&turned, target, pose.position.distance(target));
    true
}

/// Moves the camera towards `target` by a number of notches of the wheel; negative numbers move it away. Returns whether the number differs from 0.
pub fn approach(pose: &mut Pose, target: DVec3, notches: f64) -> bool {
    *pose = around(pose, target, pose.position.distance(target) * NOTCH.powf(-notches));
    notches != 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> Pose {
        Pose { position: DVec3::ZERO, yaw: 0.1, pitch: 0.0, fov: 1.0 }
    }

    #[test]
    fn a_drag_over_the_height_turns_by_the_field_of_view() {
        let mut at = pose();
        assert!(Flight::default().turn(&mut at, Vec2::new(0.0, 100.0), 100.0));
        assert!((at.pitch - 1.0).abs() < 1e-6, "a drag from the top to the bottom turns the view up by the field of view");
        // A drag to the right moves the picture to the right, so the view turns left, past north.
        assert!(Flight::default().turn(&mut at, Vec2::new(20.0, 0.0), 100.0));
        assert!((at.yaw - (TAU - 0.1)).abs() < 1e-6);
        Flight::default().turn(&mut at, Vec2::new(0.0, 1e6), 100.0);
        assert!(at.pitch < FRAC_PI_2);
        assert!(!Flight::default().turn(&mut at, Vec2::new(1.0, 0.0), 0.0), "a viewport without height");
    }

    #[test]
    fn the_wheel_stays_within_its_speeds() {
        let mut flight = Flight::default();
        flight.hasten(1e4);
        assert!((flight.speed_m_s - SPEEDS_M_S[1]).abs() < 1e-9);
        flight.hasten(-1e4);
        assert!((flight.speed_m_s - SPEEDS_M_S[0]).abs() < 1e-9);
    }

    /// Cameras that face a place from near and far: obliquely from above and from below, from straight above, and from straight below.
    fn orbits() -> impl Iterator<Item = (Pose, DVec3)> {
        let target = DVec3::new(1234.5, -4321.0, 678.9);
        let near = [[0.0, -80.0, 30.0], [0.4, -0.3, 0.2], [-60.0, 1.0, -45.0]];
        let others = [[3000.0, 2000.0, 900.0], [0.0, 0.0, 120.0], [0.0, 0.0, -7.0]];
        near.into_iter().chain(others).map(move |offset| {
            let position = target + DVec3::from_array(offset);
            (facing(&Pose { position, yaw: 2.0, pitch: 0.3, fov: 1.0 }, target), target)
        })
    }

    /// Distance between the unit vectors of the view direction and the direction to a place. For small angles, it is the angle in radians.
    fn beside(pose: &Pose, target: DVec3) -> f64 {
        let [_, _, forward] = pose.axes();
        (target - pose.position).normalize_or_zero().distance(forward)
    }

    #[test]
    fn what_is_orbited_stays_in_the_middle_and_at_its_distance() {
        for (start, target) in orbits() {
            let (mut at, distance_m) = (start, start.position.distance(target));
            assert!(beside(&at, target) < 1e-9 && is_centred(&at, target), "{start:?}");
            for step in 0..1000_u16 {
                let drag = Vec2::new(f32::from(step % 37) - 11.0, f32::from(step % 23) - 13.0);
                assert_eq!(swing(&mut at, target, drag, 400.0), drag != Vec2::ZERO, "step {step}");
                assert!(beside(&at, target) < 1e-9, "step {step} of {start:?}: {at:?}");
                assert!((at.position.distance(target) / distance_m - 1.0).abs() < 1e-9, "step {step} of {start:?}: {at:?}");
                assert!(at.pitch.abs() <= STEEPEST && (0.0..TAU).contains(&at.yaw), "{at:?}");
            }
            assert_eq!(at.fov, start.fov);
        }
        assert!(!swing(&mut pose(), DVec3::Y, Vec2::new(1.0, 0.0), 0.0), "a viewport without height");
    }

    #[test]
    fn what_is_near_follows_the_pointer_and_half_a_turn_is_a_viewport() {
        let target = DVec3::new(0.0, 100.0, 0.0);
        let mut at = facing(&Pose { position: DVec3::new(0.0, 0.0, 10.0), ..pose() }, target);
        let near = target.lerp(at.position, 0.2);
        let seen = |pose: &Pose| {
            let [right, up, _] = pose.axes();
            let towards = near - pose.position;
            [towards.dot(right), towards.dot(up)]
        };
        swing(&mut at, target, Vec2::new(10.0, 0.0), 400.0);
        assert!(seen(&at)[0] > 0.1 && seen(&at)[1].abs() < 0.1, "{:?}", seen(&at));
        let before = at;
        swing(&mut at, target, Vec2::new(0.0, 10.0), 400.0);
        assert!(seen(&at)[1] < seen(&before)[1] - 0.1 && at.position.z > before.position.z, "after a drag down, the camera is higher");
        let opposite = at;
        swing(&mut at, target, Vec2::new(400.0, 0.0), 400.0);
        let middle = at.position.midpoint(opposite.position);
        assert!(middle.truncate().distance(target.truncate()) < 1e-6, "{middle}");
    }

    #[test]
    fn over_the_poles_nothing_turns_round() {
        for (start, target) in orbits() {
            for pull in [1e6, -1e6] {
                let mut at = start;
                swing(&mut at, target, Vec2::new(0.0, pull), 400.0);
                let [right, up, _] = at.axes();
                assert!((at.pitch.abs() - STEEPEST).abs() < 1e-12 && (at.yaw - start.yaw).abs() < 1e-12, "{at:?}");
                assert!(up.z > 0.0 && right.distance(start.axes()[0]) < 1e-9, "upside down: {up}");
                // A small drag back changes the pose only slightly, and does not turn it by half a turn.
                let there = at;
                swing(&mut at, target, Vec2::new(0.0, -pull.signum()), 400.0);
                assert!(at.position.distance(there.position) < 0.02 * start.position.distance(target), "{there:?} to {at:?}");
            }
        }
    }

    #[test]
    fn the_wheel_comes_nearer_within_bounds() {
        for (start, target) in orbits() {
            let distance_m = |pose: &Pose| pose.position.distance(target);
            let mut at = start;
            assert!(approach(&mut at, target, 1.0));
            assert!((distance_m(&at) - (distance_m(&start) / NOTCH).max(ORBITS_M[0])).abs() < 1e-9 * distance_m(&start));
            for (notches, bound_m) in [(1e3, ORBITS_M[0]), (-1e3, ORBITS_M[1])] {
                approach(&mut at, target, notches);
                assert!((distance_m(&at) - bound_m).abs() < 1e-9 * bound_m && beside(&at, target) < 1e-9, "{at:?}");
            }
            assert!(!approach(&mut at, target, 0.0));
        }
    }

    #[test]
    fn another_view_has_it_no_longer_in_the_middle_and_sky_has_a_place_ahead() {
        for (start, target) in orbits() {
            for other in [Pose { yaw: start.yaw + 1e-4, pitch: 0.0, ..start }, Pose { position: start.position.with_z(900.0), ..start }] {
                assert!(!is_centred(&other, target), "{other:?}");
            }
        }
        let behind = Pose { yaw: PI, ..pose() };
        assert!(is_centred(&Pose { yaw: 0.0, ..pose() }, DVec3::Y) && !is_centred(&behind, DVec3::Y));
        for (height_m, distance_m) in [(0.0, 20.0), (1.7, 20.0), (100.0, 400.0), (-100.0, 400.0), (9000.0, 2000.0)] {
            let at = Pose { position: DVec3::new(5.0, 6.0, 300.0 + height_m), pitch: 0.4, ..pose() };
            let place = ahead(&at, 300.0);
            assert!((place.distance(at.position) - distance_m).abs() < 1e-9 && is_centred(&at, place), "{place}");
        }
    }
}

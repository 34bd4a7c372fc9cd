//! Moving the camera: flying, or walking on the ground.

use std::f64::consts::{FRAC_PI_2, TAU};

use eframe::egui::{InputState, Key, Vec2};
use glam::DVec3;
use kernels::camera::Pose;

/// Speeds that the wheel reaches, metres a second.
pub const SPEEDS_M_S: [f64; 2] = [0.05, 2000.0];
/// How much a notch of the wheel changes the speed.
const NOTCH: f64 = 1.15;
/// Steepest look up or down, radians: never quite along the axis that says where up is.
const STEEPEST: f64 = FRAC_PI_2 - 1e-3;

/// How the camera moves.
#[derive(Clone, Debug, PartialEq)]
pub struct Flight {
    /// Metres a second.
    pub speed_m_s: f64,
    /// Whether the eye keeps its height over the ground.
    pub walking: bool,
}

impl Default for Flight {
    fn default() -> Self {
        Flight { speed_m_s: 20.0, walking: false }
    }
}

impl Flight {
    /// Turns the view by a drag of so many points in a viewport of such a height, so that what was under the pointer stays there; says whether it did.
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

    /// Moves by the keys that are held, for so many seconds; says whether it did. Walking keeps to the horizontal.
    pub fn advance(&self, pose: &mut Pose, input: &InputState, seconds: f64) -> bool {
        let held = |key: Key| f64::from(u8::from(input.key_down(key)));
        let wanted = [held(Key::D) - held(Key::A), held(Key::E) - held(Key::Q), held(Key::W) - held(Key::S)];
        if wanted == [0.0; 3] || input.modifiers.command {
            return false;
        }
        let [right, _, forward] = pose.axes();
        let forward = if self.walking { DVec3::new(forward.x, forward.y, 0.0).normalize_or_zero() } else { forward };
        let direction = right * wanted[0] + DVec3::Z * wanted[1] + forward * wanted[2];
        let haste = if input.modifiers.shift { 4.0 } else { 1.0 };
        pose.position += direction.normalize_or_zero() * self.speed_m_s * haste * seconds;
        true
    }

    /// Changes the speed by so many notches of the wheel.
    pub fn hasten(&mut self, notches: f64) {
        self.speed_m_s = (self.speed_m_s * NOTCH.powf(notches)).clamp(SPEEDS_M_S[0], SPEEDS_M_S[1]);
    }
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
        assert!((at.pitch - 1.0).abs() < 1e-6, "what was at the top is dragged to the bottom: looks up by the field of view");
        // Dragged to the right, the world moves to the right: the view turns left, past north.
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
}

//! Where a picture is taken from.

use std::sync::Arc;

use glam::DVec3;
use kernels::scene::Scene;
use kernels::view::camera::Pose;

use super::places::Recorded;

/// Height of the eye when walking, metres.
pub const EYE_M: f64 = 1.7;

/// Where a picture is taken from.
#[derive(Clone, Debug, PartialEq)]
pub enum Viewpoint {
    /// A camera of the scene.
    Camera(String),
    /// The frame's place on a path of the scene, over and over.
    Path(String),
    /// A path that was flown: the frame's place on it, over and over.
    Recorded(Arc<Recorded>),
    /// Anywhere.
    Free {
        /// Where.
        pose: Pose,
        /// Whether the eye keeps its height over the ground.
        walking: bool,
    },
}

/// From where a scene is seen first.
pub(crate) fn usual_viewpoint(scene: &Scene) -> Viewpoint {
    match (scene.paths.iter().find(|p| p.name == "forwards").or(scene.paths.first()), scene.cameras.first()) {
        (Some(path), _) => Viewpoint::Path(path.name.clone()),
        (None, Some(camera)) => Viewpoint::Camera(camera.name.clone()),
        (None, None) => {
            let pose = Pose { position: DVec3::ZERO, yaw: 0.0, pitch: -0.1, fov: 1.0 };
            Viewpoint::Free { pose, walking: true }
        }
    }
}

//! The viewpoint of a picture.

use std::sync::Arc;

use glam::DVec3;
use kernels::scene::Scene;
use kernels::view::camera::Pose;

use super::places::Recorded;

/// Height of the eye when walking, metres.
pub const EYE_M: f64 = 1.7;

/// The viewpoint of a picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Viewpoint {
    /// A camera of the scene.
    Camera(String),
    /// A path of the scene, at the current frame; it repeats after its last frame.
    Path(String),
    /// A recorded path, at the current frame; it repeats after its last frame.
    Recorded(Arc<Recorded>),
    /// A free camera.
    Free {
        /// The pose of the camera.
        pose: Pose,
        /// Whether the camera stays at eye height over the ground ([`EYE_M`]).
        walking: bool,
    },
}

/// The viewpoint that is selected when a scene is opened.
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

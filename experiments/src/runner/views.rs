//! The camera pose of a view in each frame.

use anyhow::{Context, Result};
use glam::DVec3;
use kernels::frame::Renderer;
use kernels::view::camera;
use kernels::view::camera::Pose;

use crate::definition::{Definition, Motion, MovingView};

/// Returns the camera pose in a frame of the view `name`. The view is a moving view, a camera of the scene or a path of the scene.
pub(super) fn pose(definition: &Definition, renderer: &Renderer<'_>, name: &str, frame: u32) -> Result<Pose> {
    let scene = renderer.scene();
    let ground = |x: f64, y: f64| renderer.ground_m(x, y);
    let camera = |name: &str| scene.cameras.iter().find(|camera| camera.name == name);
    if let Some(view) = definition.moving_views.iter().find(|view| view.name == name) {
        let camera = camera(&view.camera).with_context(|| format!("scene `{}` has no camera `{}`", scene.name, view.camera))?;
        return Ok(moved(Pose::of(camera, ground), view, frame, camera.above_ground.then_some(&ground)));
    }
    if let Some(camera) = camera(name) {
        return Ok(Pose::of(camera, ground));
    }
    let path = scene.paths.iter().find(|path| path.name == name);
    let path = path.with_context(|| format!("scene `{}` has neither a camera nor a path `{name}`", scene.name))?;
    Ok(camera::along(path, frame, ground))
}

/// Returns the pose after `frame` steps of a moving view. `ground` returns the elevation at a place, in metres. If `ground` is given, the camera
/// keeps its height above the ground.
fn moved(start: Pose, view: &MovingView, frame: u32, ground: Option<&dyn Fn(f64, f64) -> f64>) -> Pose {
    let way = view.step * f64::from(frame);
    let level = |direction: DVec3| direction.with_z(0.0).normalize_or_zero();
    let mut pose = start;
    match view.motion {
        Motion::Sideways => pose.position += start.axes()[0] * way,
        Motion::Forwards => pose.position += level(start.axes()[2]) * way,
        Motion::Turn => pose.yaw += way.to_radians(),
        Motion::Zoom => pose.fov = (pose.fov - way.to_radians()).clamp(1f64.to_radians(), 175f64.to_radians()),
    }
    if let Some(ground) = ground {
        let [before, after] = [start.position, pose.position].map(|p| ground(p.x, p.y));
        pose.position.z += after - before;
    }
    pose
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view(motion: Motion, step: f64) -> MovingView {
        MovingView { name: "v".to_owned(), camera: "c".to_owned(), motion, step }
    }

    #[test]
    fn cameras_move_evenly_and_stay_above_the_ground() {
        let start = Pose { position: DVec3::new(10.0, 20.0, 5.0), yaw: 0.0, pitch: -0.3, fov: 1.0 };
        let slope = |x: f64, y: f64| 0.5 * x + 0.25 * y;
        let sideways = moved(start, &view(Motion::Sideways, 0.1), 4, Some(&slope));
        // The camera looks north, so it moves east by 4 steps of 0.1 m. The ground rises eastwards with a slope of one half.
        assert!((sideways.position - DVec3::new(10.4, 20.0, 5.2)).length() < 1e-12);
        let forwards = moved(start, &view(Motion::Forwards, 0.5), 2, None);
        assert!((forwards.position - DVec3::new(10.0, 21.0, 5.0)).length() < 1e-12);
        let turned = moved(start, &view(Motion::Turn, 3.0), 10, Some(&slope));
        assert!((turned.yaw.to_degrees() - 30.0).abs() < 1e-12 && turned.position == start.position);
        let zoomed = moved(start, &view(Motion::Zoom, 1.0), 10, None);
        assert!((zoomed.fov - (1.0 - 10f64.to_radians())).abs() < 1e-12);
        assert!(moved(start, &view(Motion::Zoom, 10.0), 100, None).fov > 0.0);
        assert_eq!(moved(start, &view(Motion::Turn, 3.0), 0, Some(&slope)), start);
    }
}

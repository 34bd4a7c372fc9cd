//! Finds four viewpoints in a world: `cliff`, `ground`, `vista`, `grazing`.
//!
//! The candidates are camera poses at or near the points of a coarse grid. Each candidate is scored with rays or with samples of the ground in front
//! of the camera. For each viewpoint, the candidate with the highest score is chosen. Nothing is random, so the same scene gets the same viewpoints.

use rayon::prelude::*;

use super::role::Role;
use crate::scene::{CameraPose, Scene};
use crate::world::World;

/// Vertical field of view of the cameras, degrees. The scores assume that the picture is 16:9.
const FOV_DEG: f64 = 55.0;
/// Height of the cameras `cliff` and `ground` above the ground, metres.
const EYE_M: f64 = 2.0;

#[derive(Clone, Copy, Debug)]
struct Place {
    x: f64,
    y: f64,
    height: f64,
    /// Gradient of the height: the uphill direction times the tangent of the slope.
    gradient: [f64; 2],
    slope_deg: f64,
    curvature: f64,
}

#[derive(Clone, Copy, Debug)]
struct Pose {
    eye: [f64; 3],
    yaw: f64,
    pitch: f64,
}

struct Hit {
    distance: f64,
    slope_deg: f64,
    /// Sine of the angle between ray and ground.
    facing: f64,
}

/// Names of the cameras that [`find`] returns.
pub const NAMES: [&str; 4] = ["cliff", "ground", "vista", "grazing"];

/// Looks for the four cameras: `cliff` (steep faces at distances from 4 to 320 m), `ground` (2 m above a border between vegetation and bare rock or
/// rubble), `vista` (a far view roughly towards the centre of the world) and `grazing` (along a slope that is seen almost edge-on). If there is no
/// suitable place for a camera, it stands at the centre of the world and looks north. Positions have absolute elevations.
pub fn find(world: &World, scene: &Scene) -> Vec<CameraPose> {
    let places = survey(world);
    let steep_deg = scene.flavours.cliff_slope_deg.min(world.max_slope_deg() * 0.85);
    let poses = [cliff(world, &places, steep_deg), ground(world, &places, scene), vista(world, &places), grazing(world, &places)];
    let camera = |(name, pose): (&str, Pose)| CameraPose {
        name: name.to_owned(),
        position: pose.eye.map(|v| (v * 100.0).round() / 100.0),
        above_ground: false,
        yaw_deg: (pose.yaw.to_degrees().rem_euclid(360.0) * 10.0).round() / 10.0,
        pitch_deg: (pose.pitch.to_degrees() * 10.0).round() / 10.0,
        fov_deg: FOV_DEG,
    };
    NAMES.into_iter().zip(poses).map(camera).collect()
}

fn survey(world: &World) -> Vec<Place> {
    const SIDE: u32 = 160;
    let half = world.extent_m().map(|e| e / 2.0);
    let margin = world.footprint_m();
    let place = |k: u32| {
        let at = |i: u32, axis: usize| ((f64::from(i) + 0.5) / f64::from(SIDE) * 2.0 - 1.0) * (half[axis] - margin);
        place_at(world, at(k % SIDE, 0), at(k / SIDE, 1))
    };
    let places: Vec<Place> = (0..SIDE * SIDE).into_par_iter().map(place).collect();
    places.into_iter().filter(|p| !world.is_hole(p.x, p.y)).collect()
}

fn place_at(world: &World, x: f64, y: f64) -> Place {
    let reach = world.footprint_m() / 2.0;
    let h = |dx: f64, dy: f64| world.height_m(x + dx, y + dy);
    let gradient = [(h(reach, 0.0) - h(-reach, 0.0)) / (2.0 * reach), (h(0.0, reach) - h(0.0, -reach)) / (2.0 * reach)];
    let [slope_deg, curvature] = world.relief_at(x, y);
    Place { x, y, height: h(0.0, 0.0), gradient, slope_deg, curvature }
}

fn eye_at(world: &World, x: f64, y: f64, above: f64) -> [f64; 3] {
    // Between vertices, the drawn surface may lie above or below the exact height of the world. The camera is placed above the higher of the two.
    [x, y, world.surface_height_m(x, y).max(world.height_m(x, y)) + above]
}

/// Returns about where a ray first meets the ground; `None` if it meets no ground within `reach` metres, or if it meets a hole or leaves the data
/// first. Thin ridges may be missed, because the ray is searched in steps.
fn cast(world: &World, eye: [f64; 3], direction: [f64; 3], reach: f64) -> Option<Hit> {
    let at = |t: f64| [0, 1, 2].map(|k| eye[k] + direction[k] * t);
    let above = |t: f64| {
        let [x, y, z] = at(t);
        z - world.height_m(x, y)
    };
    let ceiling = world.height_range_m().1;
    let (mut near, mut t) = (0.0, 0.5);
    while t < reach {
        let gap = above(t);
        if gap < 0.0 {
            for _ in 0..6 {
                let middle = 0.5 * (near + t);
                if above(middle) < 0.0 { t = middle } else { near = middle }
            }
            let [x, y, z] = at(t);
            if world.is_hole(x, y) {
                return None;
            }
            let place = place_at(world, x, y);
            let length = (1.0 + place.gradient[0].powi(2) + place.gradient[1].powi(2)).sqrt();
            let facing = (direction[2] - direction[0] * place.gradient[0] - direction[1] * place.gradient[1]) / length;
            debug_assert!(z.is_finite());
            return Some(Hit { distance: t, slope_deg: place.slope_deg, facing: facing.abs() });
        }
        if direction[2] > 0.0 && at(t)[2] > ceiling {
            return None;
        }
        near = t;
        // `gap` is the vertical distance to the ground. Ground is rarely steeper than 60 degrees, so about half of `gap` is usually a safe step.
        // Far away, coarse steps are enough.
        t += (0.45 * gap).max(0.6).max(0.012 * t);
    }
    None
}

/// Casts a grid of rays through a 16:9 image, and returns where they hit the ground, row by row from the bottom. `None`: the ray hits no ground, see
/// [`cast`].
fn fan(world: &World, pose: Pose, columns: u32, rows: u32, reach: f64) -> Vec<Option<Hit>> {
    let tangent = (FOV_DEG.to_radians() / 2.0).tan();
    let (sin_yaw, cos_yaw) = pose.yaw.sin_cos();
    let (sin_pitch, cos_pitch) = pose.pitch.sin_cos();
    let mut hits = Vec::new();
    for row in 0..rows {
        for column in 0..columns {
            let part = |i: u32, n: u32| (f64::from(i) + 0.5) / f64::from(n) * 2.0 - 1.0;
            let (right, up) = (part(column, columns) * tangent * 16.0 / 9.0, part(row, rows) * tangent);
            // The direction is the sum of the camera's forward, right and up vectors, in world axes.
            let level = cos_pitch - up * sin_pitch;
            let direction = [sin_yaw * level + cos_yaw * right, cos_yaw * level - sin_yaw * right, sin_pitch + up * cos_pitch];
            hits.push(cast(world, pose.eye, crate::shared::real::normalize(direction), reach));
        }
    }
    hits
}

/// Returns the pose with the highest score, and the first of these poses if several have that score; `None` if there are no poses.
fn best(poses: Vec<Pose>, score: impl Fn(&Pose) -> f64 + Sync) -> Option<Pose> {
    let scores: Vec<f64> = poses.par_iter().map(&score).collect();
    let mut best: Option<(f64, Pose)> = None;
    for (score, pose) in scores.into_iter().zip(poses) {
        if best.is_none_or(|(highest, _)| score > highest) {
            best = Some((score, pose));
        }
    }
    best.map(|(_, pose)| pose)
}

/// The pose of a camera for which the search found no suitable place: at the centre of the world, looking north.
fn fallback(world: &World) -> Pose {
    Pose { eye: eye_at(world, 0.0, 0.0, EYE_M), yaw: 0.0, pitch: -0.05 }
}

fn thin(mut places: Vec<Place>, count: usize) -> Vec<Place> {
    let step = places.len().div_ceil(count).max(1);
    let mut index = 0;
    places.retain(|_| {
        index += 1;
        (index - 1) % step == 0
    });
    places
}

fn cliff(world: &World, places: &[Place], steep_deg: f64) -> Pose {
    let mut walls: Vec<Place> = places.iter().copied().filter(|p| p.slope_deg > steep_deg).collect();
    walls.sort_by(|a, b| b.slope_deg.total_cmp(&a.slope_deg));
    walls.truncate(300);
    let mut poses = Vec::new();
    for wall in thin(walls, 50) {
        let slope = wall.gradient[0].hypot(wall.gradient[1]);
        let uphill = wall.gradient.map(|g| g / slope);
        // Go downhill from the wall, in steps of 2 m, to the first ground whose slope is clearly below that of walls.
        let foot = (2..40).map(|i| 2.0 * f64::from(i)).find_map(|d| {
            let place = place_at(world, wall.x - uphill[0] * d, wall.y - uphill[1] * d);
            (place.slope_deg < steep_deg * 0.8).then_some(place)
        });
        let Some(foot) = foot.filter(|f| !world.is_hole(f.x, f.y)) else {
            continue;
        };
        let towards = uphill[0].atan2(uphill[1]);
        for turn in [-80.0f64, -45.0, 45.0, 80.0] {
            poses.push(Pose { eye: eye_at(world, foot.x, foot.y, EYE_M), yaw: towards + turn.to_radians(), pitch: 0.06 });
        }
    }
    let score = |pose: &Pose| {
        // The distances from 5 to 320 m form six octaves; the first also includes distances of 4 to 5 m. The score of an octave grows with the number
        // of rays that hit a wall in it. From a ninth of all rays on, it does not grow further.
        let mut bins = [0.0f64; 6];
        let hits = fan(world, *pose, 11, 6, 320.0);
        let sky = hits.iter().filter(|h| h.is_none()).count() as f64 / hits.len() as f64;
        for hit in hits.iter().flatten().filter(|h| h.slope_deg > steep_deg && h.distance >= 4.0) {
            bins[((hit.distance / 5.0).log2().max(0.0) as usize).min(5)] += 1.0;
        }
        // Surfaces nearer than 8 m lower the score if they fill more than 15 % of the picture, because they hide what is behind them.
        let pressed = hits.iter().flatten().filter(|h| h.distance < 8.0).count() as f64 / hits.len() as f64;
        let full = hits.len() as f64 / 9.0;
        bins.iter().map(|b| (b / full).min(1.0).sqrt()).sum::<f64>() - 2.0 * (sky - 0.35).max(0.0) - 4.0 * (pressed - 0.15).max(0.0)
    };
    best(poses, score).unwrap_or_else(|| fallback(world))
}

/// Returns the best pose at a border between vegetation and bare rock or rubble; [`fallback`] if there is no such border on gentle ground.
fn ground(world: &World, places: &[Place], scene: &Scene) -> Pose {
    let role = |x: f64, y: f64| {
        let index = usize::from(world.material_at(x, y));
        scene.materials.get(index).map_or(Role::Soil, |m| Role::of(&m.name))
    };
    let is_bare = |role: Role| matches!(role, Role::Rock | Role::Rubble);
    let gentle: Vec<Place> = places.iter().copied().filter(|p| p.slope_deg > 3.0 && p.slope_deg < 25.0).collect();
    let mixed = |p: &&Place| {
        let around: Vec<Role> = (0..9).map(|i| role(p.x + f64::from(i % 3 - 1) * 6.0, p.y + f64::from(i / 3 - 1) * 6.0)).collect();
        around.contains(&Role::Green) && around.into_iter().any(is_bare)
    };
    let candidates: Vec<Place> = thin(gentle, 6000).par_iter().filter(mixed).copied().collect();
    let mut poses = Vec::new();
    for place in thin(candidates, 60) {
        for turn in 0..8 {
            let yaw = f64::from(turn) * std::f64::consts::FRAC_PI_4;
            poses.push(Pose { eye: eye_at(world, place.x, place.y, EYE_M), yaw, pitch: -0.2 });
        }
    }
    let score = |pose: &Pose| {
        // Shares of vegetation and of bare ground in a fan of points on the ground in front of the camera. The points lie closer together on near
        // ground.
        let (mut green, mut bare) = (0.0f64, 0.0f64);
        let (sin, cos) = pose.yaw.sin_cos();
        for i in 0..60 {
            let distance = 2.0 + f64::from(i / 6) * 2.2;
            let side = (f64::from(i % 6) - 2.5) * 0.22 * distance;
            let (x, y) = (pose.eye[0] + sin * distance + cos * side, pose.eye[1] + cos * distance - sin * side);
            let role = role(x, y);
            green += if role == Role::Green { 1.0 / 60.0 } else { 0.0 };
            bare += if is_bare(role) { 1.0 / 60.0 } else { 0.0 };
        }
        let hidden = cast(world, pose.eye, [sin * 0.995, cos * 0.995, -0.1], 12.0).is_some_and(|h| h.distance < 8.0);
        green.min(bare) + 0.2 * green.min(0.3) - if hidden { 0.3 } else { 0.0 }
    };
    best(poses, score).unwrap_or_else(|| fallback(world))
}

fn vista(world: &World, places: &[Place]) -> Pose {
    let extent = world.extent_m();
    let reach = extent[0].hypot(extent[1]);
    // The highest position in each cell of a coarse grid.
    const CELLS: usize = 9;
    let mut tops: Vec<Option<Place>> = vec![None; CELLS * CELLS];
    for place in places {
        let cell = |v: f64, extent: f64| (((v / extent + 0.5) * CELLS as f64) as usize).min(CELLS - 1);
        let top = &mut tops[cell(place.y, extent[1]) * CELLS + cell(place.x, extent[0])];
        if top.is_none_or(|t| place.height > t.height) {
            *top = Some(*place);
        }
    }
    let mut poses = Vec::new();
    for place in tops.into_iter().flatten() {
        // Positions near the centre of the world are left out. At all other positions, the camera looks roughly
        // towards the centre, so that the view is long.
        if (place.x / extent[0]).abs().max((place.y / extent[1]).abs()) < 0.22 {
            continue;
        }
        let inwards = (-place.x).atan2(-place.y);
        for turn in [-0.4, 0.0, 0.4] {
            poses.push(Pose { eye: eye_at(world, place.x, place.y, 3.0), yaw: inwards + turn, pitch: -0.09 });
        }
    }
    let score = |pose: &Pose| {
        let hits = fan(world, *pose, 9, 8, reach);
        let count = hits.len() as f64;
        // Far and middle distances can each add at most 1 to the score. Sky lowers the score only if it fills more than about a third of the picture.
        let far = hits.iter().flatten().filter(|h| h.distance > 0.45 * reach).count() as f64 / count;
        let middle = hits.iter().flatten().filter(|h| h.distance > 0.1 * reach && h.distance <= 0.45 * reach).count() as f64 / count;
        let sky = hits.iter().filter(|h| h.is_none()).count() as f64 / count;
        (far / 0.08).min(1.0).sqrt() + (middle / 0.35).min(1.0) - 2.0 * (sky - 0.34).max(0.0)
    };
    best(poses, score).unwrap_or_else(|| fallback(world))
}

fn grazing(world: &World, places: &[Place]) -> Pose {
    let even = |p: &&Place| p.slope_deg > 12.0 && p.slope_deg < 38.0 && p.curvature.abs() < 0.01;
    let slopes: Vec<Place> = places.iter().filter(even).copied().collect();
    let mut poses = Vec::new();
    for place in thin(slopes, 110) {
        let slope = place.gradient[0].hypot(place.gradient[1]);
        let downhill = (-place.gradient[0]).atan2(-place.gradient[1]);
        // The first view looks straight down the slope, nearly parallel to the ground. The other two views are turned by 1.2 radians to either side
        // and look less steeply down.
        for (yaw, pitch) in
            [(downhill, -slope.atan() - 0.02), (downhill + 1.2, -0.05 - 0.35 * slope.atan()), (downhill - 1.2, -0.05 - 0.35 * slope.atan())]
        {
            poses.push(Pose { eye: eye_at(world, place.x, place.y, 1.2), yaw, pitch });
        }
    }
    let score = |pose: &Pose| {
        let hits = fan(world, *pose, 10, 12, 400.0);
        let count = hits.len() as f64;
        let graze = |h: &&Hit| h.facing < 0.1 && h.distance > 12.0;
        let ground = hits.iter().flatten().count() as f64 / count;
        hits.iter().flatten().filter(graze).count() as f64 / count - (0.4 - ground).max(0.0)
    };
    best(poses, score).unwrap_or_else(|| fallback(world))
}

//! The brush. It converts the path of the pointer over the picture into strokes on the ground.
//!
//! Places on the ground are computed from the depth of the picture on screen, by the function that the inspector also uses ([`place_at`]). The pixels
//! between two positions of the pointer are examined, so that a stroke follows the ground under the pointer. A stroke ends where the pointer reaches
//! sky or crosses a depth edge, such as the silhouette of a ridge. At a depth edge, one surface lies behind another.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};
use kernels::scene::{Scene, Stroke, StrokeKind};
use kernels::view::camera::{NEAR_M, View};

use super::picture::Shown;
use kernels::oracle::{pixel_at, place_at};

/// Limits of the radius of a brush: smallest and largest, metres.
pub const RADII_M: [f64; 2] = [0.5, 500.0];
/// Limit of [`Brush::amount`], the factor by which a mask multiplies the weights of rules.
pub const MOST_AMOUNT: f64 = 16.0;
/// Maximum number of points of a stroke that the brush draws; scene files may have longer strokes. The limit bounds the time of baking, because splat
/// texels near a stroke are compared with the segments of the stroke.
pub const MOST_POINTS: usize = 4096;
/// Maximum number of strokes of a scene. If it is reached, the brush adds no stroke.
pub const MOST_STROKES: usize = 1000;
/// Maximum number of points of all strokes of a scene together. If it is reached, the brush adds no point. A point takes about 40 bytes in a scene
/// file, so this many points take about 2.5 MiB of the 4 MiB that a scene file may have.
pub const MOST_IN_ALL: usize = 65_536;
/// Minimum distance from the end of a stroke to the next place, as a share of the radius of the stroke. Nearer places do not extend the stroke.
const SPACING: f64 = 0.25;
/// A straight part of a stroke is stored as its two ends; the points between them are left out. This value is the largest distance between a point
/// that is left out and the line that replaces it, as a share of the radius of the stroke.
const BESIDE: f64 = 1.0 / 16.0;
/// Maximum number of consecutive points that are left out. The limit bounds the cost, because all points that were left out are checked again for
/// every new point.
const MOST_LEFT_OUT: usize = 256;
/// First condition for a depth edge between neighbouring pixels: the ratio of their depths exceeds this value.
const EDGE: f64 = 1.5;
/// Second condition for a depth edge. The inverse depth of a pixel is predicted by linear extrapolation from the two pixels before it. The condition
/// holds if the error of the prediction exceeds this share of the change in inverse depth from the previous pixel. Both conditions are needed,
/// because the first one also holds on flat ground near the horizon. The second one does not hold there: the inverse depth of a plane is linear in
/// the picture.
const BEND: f64 = 0.5;
/// Number of points of the ring that shows on the ground where the brush paints.
const RING: u32 = 64;
/// Number of places on the ground, around the centre of the ring, from which the slope of the ring is computed.
const AROUND: u32 = 8;
/// Limit of the slope of the ring, metres of height per metre of horizontal distance.
const STEEPEST: f64 = 4.0;

/// The ground, as reconstructed from the depth of a picture. Positions in the picture are given as shares of its width and height, from the top left.
pub struct Ground<'a> {
    view: View,
    /// Depth along the view direction in metres, row by row from the top; 0 = sky.
    depths: &'a [f32],
}

impl<'a> Ground<'a> {
    /// The ground of a view, from the depths of its pixels. `None` = the number of depths does not match the size of the view, or is 0.
    pub fn new(view: View, depths: &'a [f32]) -> Option<Ground<'a>> {
        let [width, height] = view.size.map(|side| side as usize);
        (depths.len() == width * height && !depths.is_empty()).then_some(Ground { view, depths })
    }

    /// The ground of a picture. `None` = the picture has no depth layer.
    pub fn of(shown: &'a Shown) -> Option<Ground<'a>> {
        let layout = &shown.layout;
        let view = View::new(shown.pose, shown.picture.size, [0.0; 2], layout.sector_m, layout.world_m());
        Ground::new(view, shown.picture.values("depth")?)
    }

    fn depth_m(&self, at: [f32; 2]) -> f64 {
        let [x, y] = pixel_at(at, self.view.size);
        f64::from(self.depths[y as usize * self.view.size[0] as usize + x as usize])
    }

    /// The place on the ground that is visible at `at`, in world metres. `None` = `at` shows sky, or lies outside of the picture.
    pub fn at(&self, at: [f32; 2]) -> Option<DVec3> {
        let is_inside = at.iter().all(|share| (0.0..=1.0).contains(share));
        let depth_m = self.depth_m(at);
        (is_inside && depth_m > 0.0).then(|| place_at(&self.view, pixel_at(at, self.view.size), depth_m))
    }

    /// Returns the places on the ground along a line in the picture, one per pixel. The start of the line is not included. An entry is `None` if it
    /// lies in the sky or outside of the picture. A further `None` is inserted at each depth edge.
    pub fn between(&self, from: [f32; 2], to: [f32; 2]) -> Vec<Option<DVec3>> {
        let pixels = |k: usize| (to[k] - from[k]).abs() * self.view.size[k] as f32;
        let steps = pixels(0).max(pixels(1)).ceil().max(1.0);
        let along = |step: f32| -> [f32; 2] { std::array::from_fn(|k| from[k] + (to[k] - from[k]) * (step / steps)) };
        let inverse = |at: [f32; 2]| {
            let depth_m = self.depth_m(at);
            if depth_m > 0.0 { 1.0 / depth_m } else { 0.0 }
        };
        let mut behind = [inverse(along(-1.0)), inverse(from)];
        let mut places = Vec::new();
        for step in 1..=steps as u32 {
            let at = along(step as f32);
            let [before, last] = behind;
            let here = inverse(at);
            let is_edge = here.max(last) > EDGE * here.min(last) && (here - 2.0 * last + before).abs() > BEND * (here - last).abs();
            if is_edge {
                places.push(None);
            }
            places.push(self.at(at));
            behind = [last, here];
        }
        places
    }

    /// Projects a place in the world into the picture. `None` = the place is behind the camera, or nearer than the near plane. The result may lie
    /// outside of the picture or be occluded.
    pub fn seen(&self, place: DVec3) -> Option<[f32; 2]> {
        let View { pose, camera, clip_from_local, .. } = self.view;
        let clip = clip_from_local * (place - pose.position + camera).extend(1.0);
        (clip.w > NEAR_M).then(|| [(0.5 + clip.x / clip.w * 0.5) as f32, (0.5 - clip.y / clip.w * 0.5) as f32])
    }

    /// Returns the points of a closed ring on the ground, as positions in the picture. Seen from above, the ring is a circle. It lies in a plane that
    /// approximates the visible ground around its centre. `None` = the point cannot be projected into the picture, see [`Ground::seen`].
    pub fn ring(&self, centre: DVec3, radius_m: f64) -> Vec<Option<[f32; 2]>> {
        let around = |count: u32| (0..count).map(move |i| DVec2::from_angle(TAU * f64::from(i) / f64::from(count)) * radius_m);
        let seen = around(AROUND).filter_map(|offset| self.at(self.seen(centre + offset.extend(0.0))?));
        // Leave out places far from the centre. They belong to a different surface, which is in front of the ground at the centre or behind it.
        let slope = slope(seen.map(|place| place - centre).filter(|offset| offset.truncate().length() <= 2.0 * radius_m));
        let mut ring: Vec<_> = around(RING).map(|offset| self.seen(centre + offset.extend(slope.dot(offset)))).collect();
        let first = ring.first().copied();
        ring.extend(first);
        ring
    }
}

/// Returns the slope towards east and north, metres per metre, of the plane that passes through the origin and fits the offsets best (least squares).
/// The slope is limited to [`STEEPEST`]. It is zero if the offsets do not determine the plane.
fn slope(offsets: impl Iterator<Item = DVec3>) -> DVec2 {
    let ([mut xx, mut xy, mut yy], mut rises) = ([0.0_f64; 3], DVec2::ZERO);
    for offset in offsets {
        xx += offset.x * offset.x;
        xy += offset.x * offset.y;
        yy += offset.y * offset.y;
        rises += offset.truncate() * offset.z;
    }
    let determinant = xx * yy - xy * xy;
    if determinant <= 1e-3 * (xx + yy).powi(2) {
        return DVec2::ZERO;
    }
    (DVec2::new(rises.x * yy - rises.y * xy, rises.y * xx - rises.x * xy) / determinant).clamp_length_max(STEEPEST)
}

/// Distance from a point to a line segment, metres.
fn distance_m(point: DVec2, [from, to]: [DVec2; 2]) -> f64 {
    let along = to - from;
    let length_2 = along.length_squared();
    let share = if length_2 > 0.0 { ((point - from).dot(along) / length_2).clamp(0.0, 1.0) } else { 0.0 };
    point.distance(from + along * share)
}

/// Length of the line that a stroke follows, metres.
pub fn length_m(stroke: &Stroke) -> f64 {
    // Use `fold`, which starts from 0. `sum` of an empty iterator is -0, which would be shown as -0.0 m.
    stroke.points.windows(2).fold(0.0, |sum, pair| sum + DVec2::from_array(pair[0]).distance(DVec2::from_array(pair[1])))
}

/// Settings of the next stroke, and the stroke that is being painted.
#[derive(Clone, Debug, PartialEq)]
pub struct Brush {
    /// Whether a drag or click in the picture paints.
    pub paints: bool,
    /// The data that a stroke changes: materials, or the weights of rules.
    pub kind: StrokeKind,
    /// Name of the selected material. A splat stroke paints this material. A mask changes the weights of the rules for this material.
    pub material: String,
    /// Radius in metres, within [`RADII_M`].
    pub radius_m: f64,
    /// Width in metres of the soft edge of a mask, measured inwards from the border of the mask. A new stroke limits it to the radius.
    pub fade_m: f64,
    /// Factor by which a mask multiplies the weights of the material's rules, from 0 to [`MOST_AMOUNT`].
    pub amount: f64,
    drawing: Option<Drawing>,
    full: Option<String>,
}

/// A drag that is being painted.
#[derive(Clone, Debug, PartialEq)]
struct Drawing {
    /// Index of the picture in the viewport on which the drag began, from the left.
    part: usize,
    /// Last position of the pointer; `None` = outside of the picture.
    pointer: Option<[f32; 2]>,
    /// Whether the position where the drag began has been painted.
    began: bool,
    /// Index of the stroke that is extended; `None` = the next place begins a new stroke.
    stroke: Option<usize>,
    /// The places that were left out between the last two points of the stroke that is extended.
    left_out: Vec<DVec2>,
}

impl Default for Brush {
    /// A splat brush with a radius of 4 m. It does not paint yet.
    fn default() -> Brush {
        Brush {
            paints: false,
            kind: StrokeKind::Splat,
            material: String::new(),
            radius_m: 4.0,
            fade_m: 1.0,
            amount: 0.0,
            drawing: None,
            full: None,
        }
    }
}

impl Brush {
    /// Selects the first material of the scene if the scene does not have the selected material.
    pub fn fit(&mut self, scene: &Scene) {
        let known = scene.materials.iter().any(|material| material.name == self.material);
        if let (false, Some(first)) = (known, scene.materials.first()) {
            self.material.clone_from(&first.name);
        }
    }

    /// Begins a drag at a position in one of the pictures in the viewport.
    pub fn begin(&mut self, part: usize, from: [f32; 2]) {
        self.full = None;
        self.drawing = Some(Drawing { part, pointer: Some(from), began: false, stroke: None, left_out: Vec::new() });
    }

    /// Whether a drag is under way.
    pub fn is_drawing(&self) -> bool {
        self.drawing.is_some()
    }

    /// Index of the picture on which the drag began, from the left; `None` = no drag is under way.
    pub fn part(&self) -> Option<usize> {
        self.drawing.as_ref().map(|drawing| drawing.part)
    }

    /// Ends the drag.
    pub fn finish(&mut self) {
        self.drawing = None;
    }

    /// Why the last drag was not painted completely, in one line; `None` = it was painted completely.
    pub fn full(&self) -> Option<&str> {
        self.full.as_deref()
    }

    /// Paints along the path of the pointer to the position `to`; `None` = the pointer left the picture.
    pub fn drag(&mut self, scene: &mut Scene, ground: &Ground<'_>, to: Option<[f32; 2]>) {
        let Some(mut drawing) = self.drawing.take() else { return };
        self.fit(scene);
        let mut places = Vec::new();
        if let (false, Some(from)) = (std::mem::replace(&mut drawing.began, true), drawing.pointer) {
            places.push(ground.at(from));
        }
        match (drawing.pointer, to) {
            (_, None) => places.push(None),
            (None, Some(to)) => places.push(ground.at(to)),
            (Some(from), Some(to)) => places.extend(ground.between(from, to)),
        }
        drawing.pointer = to;
        for place in places {
            match place {
                Some(place) => self.pass(&mut drawing, scene, place.truncate()),
                None => drawing.stroke = None,
            }
        }
        self.drawing = Some(drawing);
    }

    /// Extends the stroke to a place, or begins a new stroke there.
    fn pass(&mut self, drawing: &mut Drawing, scene: &mut Scene, place: DVec2) {
        // If the stroke was undone in the meantime, this place begins a new stroke.
        let index = drawing.stroke.filter(|index| index + 1 == scene.strokes.len());
        let last = index.and_then(|index| scene.strokes[index].points.last().copied());
        let (Some(index), Some(last)) = (index, last.map(DVec2::from_array)) else {
            self.full = crowded(scene);
            if self.full.is_none() {
                drawing.stroke = Some(scene.strokes.len());
                drawing.left_out.clear();
                scene.strokes.push(self.stroke(place));
            }
            return;
        };
        let stroke = &mut scene.strokes[index];
        if last.distance(place) <= SPACING * stroke.radius_m {
            return;
        }
        // If the line continues straight, move its end instead of adding a point.
        drawing.left_out.push(last);
        let count = stroke.points.len();
        let corner = count.checked_sub(2).map(|before| DVec2::from_array(stroke.points[before]));
        let beside_m = BESIDE * stroke.radius_m;
        let is_close = |corner: DVec2| drawing.left_out.iter().all(|&point| distance_m(point, [corner, place]) <= beside_m);
        if drawing.left_out.len() <= MOST_LEFT_OUT && corner.is_some_and(is_close) {
            stroke.points[count - 1] = place.to_array();
            return;
        }
        drawing.left_out.clear();
        if count >= MOST_POINTS {
            self.full = Some(format!("the stroke has {MOST_POINTS} points, the maximum: let go of the button, and begin another stroke"));
            return;
        }
        if points_in_all(scene) >= MOST_IN_ALL {
            self.full = crowded(scene);
            return;
        }
        scene.strokes[index].points.push(place.to_array());
    }

    fn stroke(&self, from: DVec2) -> Stroke {
        let (fade_m, amount) = match self.kind {
            // Fade and amount have no effect on a splat stroke. They are zero, so that strokes with the same effect compare as equal.
            StrokeKind::Splat => (0.0, 0.0),
            StrokeKind::Mask => (self.fade_m.min(self.radius_m).max(0.0), self.amount),
        };
        Stroke { kind: self.kind, material: self.material.clone(), points: vec![from.to_array()], radius_m: self.radius_m, fade_m, amount }
    }
}

fn points_in_all(scene: &Scene) -> usize {
    scene.strokes.iter().map(|stroke| stroke.points.len()).sum()
}

/// Why no stroke can be added to the scene, in one line; `None` = a stroke can be added.
fn crowded(scene: &Scene) -> Option<String> {
    let (strokes, points) = (scene.strokes.len(), points_in_all(scene));
    let is_full = strokes >= MOST_STROKES || points >= MOST_IN_ALL;
    is_full.then(|| {
        format!(
            "nothing can be added: the scene has {strokes} of at most {MOST_STROKES} strokes and {points} of at most {MOST_IN_ALL} points; \
             remove some strokes to paint more"
        )
    })
}

#[cfg(test)]
mod tests {
    use kernels::scene;
    use kernels::view::camera::Pose;

    use super::*;

    const SIZE: [u32; 2] = [160, 90];

    fn view() -> View {
        let pose = Pose { position: DVec3::new(40.0, -70.0, 30.0), yaw: 0.6, pitch: -0.5, fov: 1.0 };
        View::new(pose, SIZE, [0.0; 2], 64.0, 10_240.0)
    }

    /// Depths of all pixels in metres, row by row, in a picture of the plane z = rise.x * x + rise.y * y. Above the horizon of the plane is sky, with
    /// depth 0.
    fn plane(view: &View, rise: DVec2) -> Vec<f32> {
        let normal = DVec3::new(-rise.x, -rise.y, 1.0);
        let depth = |x: u32, y: u32| {
            let t = -normal.dot(view.pose.position) / normal.dot(view.ray(f64::from(x), f64::from(y)));
            if t.is_finite() && t > 0.0 { t as f32 } else { 0.0 }
        };
        (0..view.size[1]).flat_map(|y| (0..view.size[0]).map(move |x| (x, y))).map(|(x, y)| depth(x, y)).collect()
    }

    fn plain() -> Scene {
        scene::load(scene::DEFAULT).expect("built in")
    }

    fn brush(radius_m: f64) -> Brush {
        Brush { material: "moss".to_owned(), radius_m, ..Brush::default() }
    }

    /// Distance from a place to the line that a stroke follows, metres.
    fn beside_m(stroke: &Stroke, place: DVec2) -> f64 {
        let points: Vec<DVec2> = stroke.points.iter().copied().map(DVec2::from_array).collect();
        let alone = points[0].distance(place);
        points.windows(2).map(|pair| distance_m(place, [pair[0], pair[1]])).fold(alone, f64::min)
    }

    #[test]
    fn a_place_in_the_picture_is_one_on_the_ground_and_back_again() {
        let view = view();
        for rise in [DVec2::ZERO, DVec2::new(0.3, -0.1)] {
            let depths = plane(&view, rise);
            let ground = Ground::new(view, &depths).expect("a depth for each pixel");
            for pixel in [[0, 89], [80, 45], [159, 60]] {
                let at = kernels::oracle::probe_of(pixel, SIZE);
                let place = ground.at(at).expect("ground");
                assert!((place.z - rise.dot(place.truncate())).abs() < 1e-4, "{place}");
                let back = ground.seen(place).expect("before the camera");
                assert!((0..2).all(|k| (back[k] - at[k]).abs() < 1e-6), "{back:?} instead of {at:?}");
            }
            assert!(ground.at([0.5, 1.01]).is_none() && ground.at([-0.01, 0.5]).is_none(), "outside of the picture");
        }
        assert!(Ground::new(view, &[1.0]).is_none(), "the number of depths does not match the size of the view");
        let behind = view.pose.position - view.pose.axes()[2];
        let depths = plane(&view, DVec2::ZERO);
        assert!(Ground::new(view, &depths).expect("a depth for each pixel").seen(behind).is_none());
    }

    #[test]
    fn a_drag_leaves_a_line_that_is_thin_and_close() {
        let view = view();
        let depths = plane(&view, DVec2::ZERO);
        let ground = Ground::new(view, &depths).expect("a depth for each pixel");
        let (mut scene, mut brush) = (plain(), brush(2.0));
        // A horizontal line in the picture is a straight line on level ground, so two points suffice for the stroke.
        brush.begin(0, [0.103, 0.8]);
        for share in [0.3, 0.31, 0.903] {
            brush.drag(&mut scene, &ground, Some([share, 0.8]));
        }
        brush.finish();
        assert_eq!((scene.strokes.len(), scene.strokes[0].points.len()), (1, 2), "{:?}", scene.strokes);
        let stroke = scene.strokes[0].clone();
        assert_eq!((stroke.kind, stroke.material.as_str(), stroke.radius_m, stroke.fade_m), (StrokeKind::Splat, "moss", 2.0, 0.0));
        let [from, to] = [0.103, 0.903].map(|share| ground.at([share, 0.8]).expect("ground").truncate());
        assert!((length_m(&stroke) - from.distance(to)).abs() <= SPACING * 2.0, "{} m", length_m(&stroke));
        // The path of the next drag has corners. Every place on the path is near the line of the stroke, and the stroke has far fewer points than the
        // path has places.
        let corners = [[0.2, 0.9], [0.8, 0.9], [0.8, 0.6], [0.3, 0.7], [0.31, 0.95]];
        brush.begin(0, corners[0]);
        for at in corners {
            brush.drag(&mut scene, &ground, Some(at));
        }
        brush.finish();
        let stroke = &scene.strokes[1];
        let passed: Vec<DVec3> = corners.windows(2).flat_map(|pair| ground.between(pair[0], pair[1])).flatten().collect();
        for place in &passed {
            let beside = beside_m(stroke, place.truncate());
            assert!(beside <= (SPACING + BESIDE) * 2.0 + 1e-9, "{place} is {beside} m away from the line");
        }
        assert!(passed.len() > 150 && stroke.points.len() < passed.len() / 3, "{} points of {}", stroke.points.len(), passed.len());
        // Negative control: distances to a different line are not small. Some places on the path are far from the line of the first stroke.
        assert!(passed.iter().any(|place| distance_m(place.truncate(), [from, to]) > 4.0));
    }

    #[test]
    fn a_mask_has_an_edge_no_wider_than_itself() {
        let view = view();
        let depths = plane(&view, DVec2::ZERO);
        let ground = Ground::new(view, &depths).expect("a depth for each pixel");
        let mut scene = plain();
        let mut brush = Brush { kind: StrokeKind::Mask, fade_m: 9.0, amount: 0.25, material: "nothing".to_owned(), ..brush(2.0) };
        brush.begin(0, [0.5, 0.8]);
        brush.drag(&mut scene, &ground, Some([0.5, 0.8]));
        let stroke = &scene.strokes[0];
        assert_eq!((stroke.fade_m, stroke.amount, stroke.points.len()), (2.0, 0.25, 1));
        // A material that the scene does not have is replaced by the first material of the scene.
        assert_eq!(stroke.material, scene.materials[0].name);
        assert!(scene::validate(&scene).is_ok());
    }

    #[test]
    fn nothing_is_painted_across_sky_or_behind_an_edge() {
        let view = view();
        let plain_depths = plane(&view, DVec2::ZERO);
        let width = SIZE[0] as usize;
        let columns = |from: usize, change: fn(f32) -> f32| {
            let mut depths = plain_depths.clone();
            for (_, depth) in depths.iter_mut().enumerate().filter(|(i, _)| (from..from + 10).contains(&(i % width))) {
                *depth = change(*depth);
            }
            depths
        };
        // A gap of sky splits the drag into two strokes. A pillar in front of the ground splits it into three.
        for (depths, strokes) in [(columns(70, |_| 0.0), 2), (columns(70, |depth| depth / 2.0), 3), (plain_depths.clone(), 1)] {
            let ground = Ground::new(view, &depths).expect("a depth for each pixel");
            let (mut scene, mut brush) = (plain(), brush(1.0));
            brush.begin(0, [0.1, 0.8]);
            brush.drag(&mut scene, &ground, Some([0.9, 0.8]));
            assert_eq!(scene.strokes.len(), strokes);
            if strokes == 2 {
                let across = ground.at([0.43, 0.8]).expect("ground").distance(ground.at([0.51, 0.8]).expect("ground"));
                let apart = DVec2::from_array(*scene.strokes[0].points.last().expect("some"));
                let apart = apart.distance(DVec2::from_array(scene.strokes[1].points[0]));
                assert!(apart > 0.5 * across, "{apart} m of {across} m");
            }
            // A drag that leaves the picture and returns begins a new stroke, too.
            brush.drag(&mut scene, &ground, None);
            brush.drag(&mut scene, &ground, Some([0.5, 0.95]));
            assert_eq!(scene.strokes.len(), strokes + 1);
        }
    }

    #[test]
    fn a_stroke_has_an_end_and_so_has_their_number() {
        let (mut scene, mut brush) = (plain(), brush(1.0));
        brush.begin(0, [0.5, 0.5]);
        let mut drawing = brush.drawing.take().expect("begun");
        for i in 0..3 * MOST_POINTS {
            let angle = i as f64;
            brush.pass(&mut drawing, &mut scene, DVec2::new(angle.cos(), angle.sin()) * 50.0);
        }
        assert_eq!((scene.strokes.len(), scene.strokes[0].points.len()), (1, MOST_POINTS));
        assert!(brush.full().is_some_and(|text| text.contains("let go")), "{:?}", brush.full());
        assert!(scene::validate(&scene).is_ok());
        // The number of strokes of a scene is limited, and so is the number of points of all its strokes together. The first limit applies to a new
        // stroke. The second limit also applies to a stroke that is extended.
        let long = scene.strokes[0].clone();
        let one = Stroke { points: vec![[0.0, 0.0]], ..long.clone() };
        let many = vec![long; MOST_IN_ALL / MOST_POINTS];
        let mut grown = many.clone();
        grown.pop();
        // In `grown`, all strokes together have the maximum number of points. The last stroke has one point and cannot be extended.
        grown.push(Stroke { points: many[0].points[1..].to_vec(), ..one.clone() });
        grown.push(one.clone());
        for (strokes, stroke) in [(vec![one; MOST_STROKES], None), (many, None), (grown.clone(), Some(grown.len() - 1))] {
            scene.strokes.clone_from(&strokes);
            (drawing.stroke, brush.full) = (stroke, None);
            for x in [90.0, 190.0] {
                brush.pass(&mut drawing, &mut scene, DVec2::new(x, 90.0));
            }
            assert!(scene.strokes == strokes);
            assert!(brush.full().is_some_and(|text| text.contains("remove some strokes")), "{:?}", brush.full());
        }
    }

    #[test]
    fn what_is_undone_in_the_middle_of_a_drag_stays_undone() {
        let view = view();
        let depths = plane(&view, DVec2::ZERO);
        let ground = Ground::new(view, &depths).expect("a depth for each pixel");
        let (mut scene, mut brush) = (plain(), brush(1.0));
        brush.begin(0, [0.1, 0.8]);
        brush.drag(&mut scene, &ground, Some([0.5, 0.8]));
        scene.strokes.clear();
        brush.drag(&mut scene, &ground, Some([0.9, 0.8]));
        assert_eq!(scene.strokes.len(), 1);
        let half = ground.at([0.49, 0.8]).expect("ground").truncate();
        assert!(beside_m(&scene.strokes[0], half) > 0.0 && length_m(&scene.strokes[0]) > 1.0);
    }

    #[test]
    fn the_ring_lies_on_the_slope() {
        let view = view();
        for rise in [DVec2::ZERO, DVec2::new(0.4, 0.2)] {
            let depths = plane(&view, rise);
            let ground = Ground::new(view, &depths).expect("a depth for each pixel");
            let centre = ground.at([0.5, 0.6]).expect("ground");
            let ring = ground.ring(centre, 6.0);
            assert_eq!((ring.len(), ring[0]), (RING as usize + 1, ring[RING as usize]));
            for at in ring {
                let place = ground.at(at.expect("before the camera")).expect("ground");
                // A position in the picture is rounded to a pixel, which limits the accuracy of the radius.
                let radius = place.truncate().distance(centre.truncate());
                assert!((radius - 6.0).abs() < 1.0, "{radius} m on {rise}");
            }
        }
        assert_eq!(slope(std::iter::empty()), DVec2::ZERO);
        let line = (1..5).map(|i| DVec3::new(f64::from(i), 0.0, f64::from(i)));
        assert_eq!(slope(line), DVec2::ZERO, "points on a line do not determine the slope across the line");
    }
}

//! The panel *Machine*: a map of the drawn nodes and the frustum, seen from above, and the numbers that the stages report.

use eframe::egui::{self, Color32, Pos2, Rect, Sense, Slider, Stroke, StrokeKind, Ui, pos2, vec2};
use glam::DVec2;
use kernels::view::camera::Pose;
use kernels::world::{LODS, Layout, NodeId};

use crate::model::picture::Shown;
use crate::model::state::Model;

/// Smallest span of the map (length of a side), and its span at the start, metres.
const NARROWEST_M: f64 = 200.0;
const USUAL_M: f64 = 4000.0;
/// Smallest and largest length of a side of the map on the screen, points.
const MAP_POINTS: [f32; 2] = [120.0, 480.0];
/// A turn of the wheel, or a drag, by this many points changes the span by a factor of e.
const POINTS_PER_E: f32 = 200.0;
/// Length of the arrow for the view direction, points.
const ARROW_POINTS: f32 = 22.0;
/// Width and height of a swatch in the legend, points.
const SWATCH_POINTS: f32 = 12.0;
/// Colours of levels, the finest first. They are taken from the colour map viridis. They become darker from level to level, so that people with
/// colour blindness can distinguish them.
const LEVEL_COLOURS: [[u8; 3]; LODS as usize] =
    [[253, 231, 37], [122, 209, 81], [34, 168, 132], [42, 120, 142], [65, 68, 135], [68, 1, 84]];

/// State of the panel.
pub(crate) struct MachinePanel {
    /// Length of a side of the map, metres.
    span_m: f64,
}

impl Default for MachinePanel {
    fn default() -> MachinePanel {
        MachinePanel { span_m: USUAL_M }
    }
}

/// One level of the quadtree.
#[derive(Debug, PartialEq)]
struct Level {
    /// 0 = finest.
    lod: u8,
    /// Edge of a node, metres.
    edge_m: f64,
    /// Edge of a texel of the albedo and normal atlases, metres. It is equal to the distance between two neighbouring height samples.
    texel_m: f64,
    /// Number of drawn nodes.
    nodes: usize,
}

pub(crate) fn show(panel: &mut MachinePanel, model: &Model, ui: &mut Ui) {
    let Some(shown) = model.shown().cloned() else {
        ui.label("No picture yet.");
        return;
    };
    let report = &shown.picture.report;
    map(&mut panel.span_m, &shown, ui);
    legend(&levels(&report.drawn, &shown.layout), ui);
    for section in &report.sections {
        let header = egui::CollapsingHeader::new(section.name).default_open(true).show(ui, |ui| {
            egui::Grid::new(section.name).num_columns(2).striped(true).show(ui, |ui| {
                for (name, value) in &section.rows {
                    ui.label(name);
                    ui.label(value);
                    ui.end_row();
                }
            });
        });
        header.header_response.on_hover_text(section.about);
    }
}

/// The levels of this world, the finest first, with the number of drawn nodes of each.
fn levels(drawn: &[NodeId], layout: &Layout) -> Vec<Level> {
    let nodes = |lod| drawn.iter().filter(|node| node.lod == lod).count();
    (layout.finest_lod..LODS)
        .map(|lod| Level { lod, edge_m: layout.node_m(lod), texel_m: layout.spacing_m(lod), nodes: nodes(lod) })
        .collect()
}

fn level_colour(lod: u8) -> Color32 {
    let [r, g, b] = LEVEL_COLOURS[usize::from(lod).min(LEVEL_COLOURS.len() - 1)];
    Color32::from_rgb(r, g, b)
}

/// The legend of the map. The accessible name of a swatch gives the level, the edge and the number of nodes, because not everybody can see colours.
fn legend(levels: &[Level], ui: &mut Ui) {
    egui::Grid::new("levels").num_columns(5).striped(true).show(ui, |ui| {
        for (name, about) in [
            ("", "Colour of the level on the map"),
            ("Level", "Level of the quadtree; the smaller, the finer"),
            ("Edge", "Edge length of a terrain node of this level"),
            ("Nodes", "Number of nodes of this level that are selected for the picture"),
            ("Texel", "Edge length of a texel of the albedo and normal atlases. Without its border, a node has 128 x 128 texels."),
        ] {
            ui.label(name).on_hover_text(about);
        }
        ui.end_row();
        for level in levels {
            let (swatch, painter) = ui.allocate_painter(vec2(SWATCH_POINTS, SWATCH_POINTS), Sense::hover());
            painter.rect_filled(swatch.rect, 2.0, level_colour(level.lod));
            let name = format!("Level {}: {} m, nodes: {}", level.lod, level.edge_m, level.nodes);
            swatch.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &name));
            ui.label(level.lod.to_string());
            ui.label(format!("{} m", level.edge_m));
            ui.label(level.nodes.to_string());
            ui.label(format!("{} m", level.texel_m));
            ui.end_row();
        }
    });
}

/// The map: a square part of the world on the screen, with north at the top.
struct Map {
    /// Centre of the map, world metres.
    centre: DVec2,
    /// Length of a side, metres.
    span_m: f64,
    /// The rectangle of the map on the screen.
    rect: Rect,
}

impl Map {
    fn points_per_m(&self) -> f64 {
        f64::from(self.rect.width()) / self.span_m
    }

    /// Position on the screen of a place in world metres.
    fn on_screen(&self, place: DVec2) -> Pos2 {
        let [east, north] = ((place - self.centre) * self.points_per_m()).to_array();
        self.rect.center() + vec2(east as f32, -north as f32)
    }

    /// Rectangle on the screen of a square with this south-west corner and edge, in world metres.
    fn square(&self, corner: DVec2, edge_m: f64) -> Rect {
        Rect::from_two_pos(self.on_screen(corner), self.on_screen(corner + edge_m))
    }

    fn node(&self, node: NodeId, layout: &Layout) -> Rect {
        self.square(node.origin_m(layout), layout.node_m(node.lod))
    }
}

/// The span after zooming in by `points`, with the wheel, an upward drag, or a pinch.
fn closer(span_m: f64, points: f32, widest_m: f64) -> f64 {
    (span_m * f64::from(-points / POINTS_PER_E).exp()).clamp(NARROWEST_M, widest_m.max(NARROWEST_M))
}

/// Returns the largest number of the series 1, 2, 5, 10, 20, 50 and so on that is at most `longest_m`; 1 if `longest_m` is below 1.
fn round_length_m(longest_m: f64) -> f64 {
    let decade = 10_f64.powi(longest_m.max(1.0).log10().floor() as i32);
    [5.0, 2.0].into_iter().map(|digit| digit * decade).find(|&length| length <= longest_m).unwrap_or(decade)
}

/// Returns the part of a level plane at elevation `ground_m` that is inside the frustum, as the corners of a convex polygon in world metres. The
/// polygon is cut off at a distance of more than `reach_m` from the camera. It is empty if the camera is not above the plane, or if nothing is left.
fn ground_outline(pose: &Pose, size: [u32; 2], ground_m: f64, reach_m: f64) -> Vec<DVec2> {
    let above_m = pose.position.z - ground_m;
    if above_m <= 0.0 || size.contains(&0) {
        return Vec::new();
    }
    let [right, up, forward] = pose.axes();
    let half_height = (pose.fov / 2.0).tan();
    let half_width = half_height * f64::from(size[0]) / f64::from(size[1]);
    let corners = [[-1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [1.0, -1.0]];
    let corners = corners.map(|[x, y]: [f64; 2]| forward + right * (half_width * x) + up * (half_height * y));
    // Each ray has the component 1 along the view direction, so it meets the ground at a depth of `above_m / -ray.z`. If `ray.z` is above `highest`,
    // this depth is more than 4 * `reach_m`, or the ray does not meet the ground. The polygon is cut there, which is outside the map.
    let highest = -above_m / (4.0 * reach_m.max(above_m));
    let mut rays = Vec::new();
    for (i, &ray) in corners.iter().enumerate() {
        let next = corners[(i + 1) % corners.len()];
        if ray.z <= highest {
            rays.push(ray);
        }
        if (ray.z <= highest) != (next.z <= highest) {
            rays.push(ray.lerp(next, (highest - ray.z) / (next.z - ray.z)));
        }
    }
    rays.into_iter().map(|ray| pose.position.truncate() + ray.truncate() * (above_m / -ray.z)).collect()
}

/// Draws the map with the drawn nodes and the camera, seen from above.
fn map(span_m: &mut f64, shown: &Shown, ui: &mut Ui) {
    let (layout, pose) = (&shown.layout, &shown.pose);
    let widest_m = layout.world_m().max(NARROWEST_M);
    ui.horizontal(|ui| {
        let label = ui.label("Map span");
        let slider = Slider::new(span_m, NARROWEST_M..=widest_m).logarithmic(true).clamping(egui::SliderClamping::Always);
        ui.add(slider.suffix(" m").max_decimals(0)).labelled_by(label.id).on_hover_text(
            "Length of the ground along an edge of the map. To change it, turn the wheel over the map, or drag the map up or down.",
        );
    });
    let edge = ui.available_width().clamp(MAP_POINTS[0], MAP_POINTS[1]);
    let (response, painter) = ui.allocate_painter(vec2(edge, edge), Sense::drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Map of nodes"));
    let mut points = -response.drag_delta().y;
    if response.hovered() {
        // Consume the scrolling, so that the panel does not scroll as well.
        points += ui.input_mut(|i| std::mem::take(&mut i.smooth_scroll_delta.y));
        points += ui.input(egui::InputState::zoom_delta).max(f32::MIN_POSITIVE).ln() * POINTS_PER_E;
    }
    *span_m = closer(*span_m, points, widest_m);

    let map = Map { centre: pose.position.truncate(), span_m: *span_m, rect: response.rect };
    let (paper, ink) = (ui.visuals().extreme_bg_color, ui.visuals().text_color());
    painter.rect_filled(map.rect, 2.0, paper);
    for &node in &shown.picture.report.drawn {
        let square = map.node(node, layout);
        if square.intersects(map.rect) {
            painter.rect(square, 0.0, level_colour(node.lod), Stroke::new(0.5, paper), StrokeKind::Inside);
        }
    }
    let world = map.square(DVec2::splat(-layout.world_m() / 2.0), layout.world_m());
    painter.rect_stroke(world, 0.0, Stroke::new(1.0, ink), StrokeKind::Outside);
    let frozen = shown.wish.culled_from.zip(shown.culled_ground_m);
    if let Some((from, ground_m)) = frozen {
        camera(&painter, &map, &from, shown.wish.size, ground_m, Color32::YELLOW);
    }
    camera(&painter, &map, pose, shown.wish.size, shown.ground_m, Color32::WHITE);
    scale_bar(&map, &painter);
    response.on_hover_text(
        "The selected terrain nodes, seen from above and coloured by level. North is at the top. The map also shows the camera, its view \
         direction, and the part of the ground that it would see if the ground were flat.",
    );
    if frozen.is_some() {
        ui.label("Culling is frozen: the nodes and patches are selected for the yellow camera.");
    }
}

/// Draws a camera, its view direction, and the outline of the ground that it sees, as if the ground were a plane at the elevation `ground_m`.
fn camera(painter: &egui::Painter, map: &Map, pose: &Pose, size: [u32; 2], ground_m: f64, colour: Color32) {
    let outline = ground_outline(pose, size, ground_m, map.span_m);
    let outline: Vec<Pos2> = outline.into_iter().map(|place| map.on_screen(place)).collect();
    let at = map.on_screen(pose.position.truncate());
    let look = vec2(pose.yaw.sin() as f32, -pose.yaw.cos() as f32) * ARROW_POINTS;
    // A white or yellow line with a black border is visible on every colour of the map of LODs.
    for stroke in [Stroke::new(4.0, Color32::BLACK), Stroke::new(1.5, colour)] {
        if outline.len() > 2 {
            painter.add(egui::Shape::closed_line(outline.clone(), stroke));
        }
        painter.circle_filled(at, 2.0 + stroke.width, stroke.color);
        painter.arrow(at, look, stroke);
    }
}

/// The scale bar in a corner of the map.
fn scale_bar(map: &Map, painter: &egui::Painter) {
    let length_m = round_length_m(map.span_m / 4.0);
    let bar =
        Rect::from_min_size(pos2(map.rect.left() + 10.0, map.rect.bottom() - 12.0), vec2((length_m * map.points_per_m()) as f32, 4.0));
    painter.rect(bar, 0.0, Color32::WHITE, Stroke::new(1.0, Color32::BLACK), StrokeKind::Outside);
    let font = egui::FontId::proportional(12.0);
    let text = painter.layout_no_wrap(format!("{length_m} m"), font.clone(), Color32::WHITE);
    let at = bar.left_top() - vec2(0.0, text.size().y + 3.0);
    painter.rect_filled(Rect::from_min_size(at, text.size()).expand(2.0), 2.0, Color32::from_black_alpha(160));
    painter.galley(at, text, Color32::WHITE);
    painter.text(map.rect.center_top() + vec2(0.0, 4.0), egui::Align2::CENTER_TOP, "N", font, Color32::WHITE);
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn map_of(centre: DVec2, span_m: f64) -> Map {
        Map { centre, span_m, rect: Rect::from_min_size(pos2(50.0, 20.0), vec2(200.0, 200.0)) }
    }

    fn pose(pitch_deg: f64, fov_deg: f64) -> Pose {
        // The camera looks east.
        let yaw = 90.0_f64.to_radians();
        Pose { position: DVec3::new(300.0, -40.0, 150.0), yaw, pitch: pitch_deg.to_radians(), fov: fov_deg.to_radians() }
    }

    #[test]
    fn nodes_lie_in_their_place_with_north_up() {
        let layout = Layout::of(10_240.0, None);
        let map = map_of(DVec2::ZERO, 400.0);
        // The map has half a point per metre. It shows two nodes of level 0 at the centre of the world, and the parent of one of them.
        let node = |lod, x, y| map.node(NodeId { lod, x, y }, &layout);
        assert_eq!(node(0, 80, 80), Rect::from_min_max(pos2(150.0, 88.0), pos2(182.0, 120.0)));
        assert_eq!(node(0, 80, 79), Rect::from_min_max(pos2(150.0, 120.0), pos2(182.0, 152.0)));
        assert_eq!(node(1, 40, 40), Rect::from_min_max(pos2(150.0, 56.0), pos2(214.0, 120.0)));
        // The four children of a node cover it, up to rounding, also at this position of the camera.
        let map = map_of(DVec2::new(-777.0, 1234.5), 3000.0);
        let parent = NodeId { lod: 3, x: 8, y: 11 };
        let union = parent.children().into_iter().map(|child| map.node(child, &layout)).reduce(Rect::union).expect("four");
        let whole = map.node(parent, &layout);
        assert!((union.min - whole.min).length() < 1e-3 && (union.max - whole.max).length() < 1e-3, "{union:?} {whole:?}");
    }

    #[test]
    fn straight_down_the_outline_is_the_picture_on_the_ground() {
        // At 100 m above the ground, a vertical field of view of 90 degrees and an aspect ratio of 2 show 200 m by 400 m. The camera looks east
        // before it pitches down, so the width of the picture runs from north to south.
        let corners = ground_outline(&pose(-90.0, 90.0), [640, 320], 50.0, 1000.0);
        let expected = [[200.0, -240.0], [200.0, 160.0], [400.0, -240.0], [400.0, 160.0]].map(DVec2::from_array);
        assert_eq!(corners.len(), 4);
        for corner in expected {
            assert!(corners.iter().any(|c| (*c - corner).length() < 1e-6), "{corner} is not in {corners:?}");
        }
    }

    #[test]
    fn level_the_outline_is_a_wedge_as_wide_as_the_picture_that_leaves_the_map() {
        let (fov_deg, reach_m) = (60.0_f64, 1000.0);
        let pose = pose(0.0, fov_deg);
        let corners = ground_outline(&pose, [320, 160], 100.0, reach_m);
        assert_eq!(corners.len(), 4);
        let half_height = (fov_deg / 2.0).to_radians().tan();
        let from_camera: Vec<DVec2> = corners.iter().map(|&c| c - pose.position.truncate()).collect();
        for ahead in &from_camera {
            assert!((ahead.y.abs() / ahead.x - 2.0 * half_height).abs() < 1e-9, "{ahead}");
        }
        let nearest = from_camera.iter().map(|a| a.x).fold(f64::INFINITY, f64::min);
        let farthest = from_camera.iter().map(|a| a.x).fold(0.0, f64::max);
        assert!((nearest - 50.0 / half_height).abs() < 1e-9 && farthest > reach_m, "{nearest} to {farthest}");
    }

    #[test]
    fn looking_up_from_below_or_at_nothing_there_is_no_outline() {
        assert!(ground_outline(&pose(40.0, 60.0), [320, 160], 100.0, 1000.0).is_empty());
        assert!(ground_outline(&pose(-20.0, 60.0), [320, 160], 150.0, 1000.0).is_empty());
        assert!(ground_outline(&pose(-20.0, 60.0), [320, 0], 100.0, 1000.0).is_empty());
        // Positive control: a camera far above a small map has an outline.
        assert_eq!(ground_outline(&pose(-60.0, 60.0), [320, 160], -20_000.0, 200.0).len(), 4);
    }

    #[test]
    fn levels_count_every_node_once() {
        let layout = Layout::of(10_240.0, None);
        let node = |lod, x| NodeId { lod, x, y: 0 };
        let drawn = [node(5, 0), node(0, 40), node(0, 41), node(3, 9), node(0, 42)];
        let levels = levels(&drawn, &layout);
        assert_eq!(levels.iter().map(|level| level.nodes).collect::<Vec<_>>(), [3, 0, 0, 1, 0, 1]);
        assert_eq!(levels[3], Level { lod: 3, edge_m: 512.0, texel_m: 4.0, nodes: 1 });
        // In a world with coarse data, the finest level is coarser.
        let coarse = super::levels(&drawn[..1], &Layout::of(10_240.0, Some(2.0)));
        assert_eq!(coarse.iter().map(|level| level.lod).collect::<Vec<_>>(), [1, 2, 3, 4, 5]);
    }

    #[test]
    fn level_colours_darken_from_fine_to_coarse() {
        let luminance = |lod| {
            let [r, g, b, _] = level_colour(lod).to_array().map(f64::from);
            kernels::base::colour::luminance([r, g, b])
        };
        for lod in 1..LODS {
            assert!(luminance(lod) + 15.0 < luminance(lod - 1), "{lod}");
        }
    }

    #[test]
    fn the_map_comes_closer_within_bounds_and_its_scale_is_round() {
        assert_eq!(closer(4000.0, 0.0, 10_240.0), 4000.0);
        assert!(
            (closer(4000.0, 50.0, 10_240.0) * closer(1.0e3, -50.0, 10_240.0) - 4.0e6).abs() < 1e-3,
            "zooming in and out must restore the span"
        );
        assert_eq!((closer(4000.0, 1e4, 10_240.0), closer(4000.0, -1e4, 10_240.0)), (NARROWEST_M, 10_240.0));
        for (span_m, bar_m) in [(200.0, 50.0), (799.0, 100.0), (4100.0, 1000.0), (9000.0, 2000.0), (30_000.0, 5000.0)] {
            assert!((round_length_m(span_m / 4.0) - bar_m).abs() < 1e-9, "{span_m}");
        }
    }
}

//! The panel *Viewport*: the picture, and navigation in it.

use eframe::egui::{self, Color32, Rect, RichText, Sense, Ui, pos2, vec2};
use glam::DVec3;
use kernels::view::camera::Pose;

use super::{choose, legend};
use crate::model::brush::Ground;
use crate::model::compare::{Mode, label};
use crate::model::display::{Layer, difference_legend};
use crate::model::flight::{self, Orbit};
use crate::model::settings::Settings;
use crate::model::state::{Looking, Model};
use crate::model::viewpoint::Viewpoint;

/// Largest time step of the camera movement between two drawings of the window, seconds. Without this limit, the camera would jump far after a stall.
const LONGEST_STEP_S: f32 = 0.25;
/// Points of scrolling for one notch of the wheel.
const NOTCH_POINTS: f32 = 50.0;

/// Width of the area in which the wipe line can be dragged, points.
const GRASP: f32 = 10.0;
/// Distances from the centre at which the arms of the crosshair begin and end, points.
const CROSS: [f32; 2] = [4.0, 12.0];
/// Width and height of the loupe in points, and its magnification.
const LOUPE: [f32; 2] = [150.0, 8.0];

pub(crate) fn show(model: &mut Model, ui: &mut Ui) {
    let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Picture"));
    let pixels = ui.ctx().pixels_per_point();
    model.room = [rect.width(), rect.height()].map(|side| (side * pixels).round().max(0.0) as u32);
    let painter = ui.painter_at(rect);
    // Paint no background, because the window is black anyway, and painting takes time on a software adapter. If drawing failed, paint no text
    // either, because the status line says why there is no picture.
    if model.textures[0].is_none() && model.failure().is_none() {
        let text = model.news.progress.as_ref().map_or("starting", |p| p.stage.as_str());
        painter.text(rect.center(), egui::Align2::CENTER_CENTER, text, egui::FontId::proportional(16.0), Color32::GRAY);
    }
    if response.clicked() || response.drag_started() {
        response.request_focus();
    }
    let parts = parts(model, rect);
    if let [left, right] = &parts[..] {
        // Paint the gap between the two pictures, because the background is not black in a window without a screen.
        painter.rect_filled(Rect::from_min_max(left.clip.right_top(), right.clip.left_bottom()), 0.0, Color32::BLACK);
    }
    for part in &parts {
        if let Some(texture) = &model.textures[part.texture] {
            painter.with_clip_rect(part.clip).image(texture.id(), part.place, part.uv, Color32::WHITE);
        }
        let region = model.metrics.region.filter(|_| model.shown().is_some_and(|shown| shown.wish.is_measured()));
        if let Some([left, top, right, bottom]) = region {
            let measured = Rect::from_min_max(part.on_screen(pos2(left, top)), part.on_screen(pos2(right, bottom)));
            let stroke = egui::Stroke::new(1.5, Color32::YELLOW);
            painter.with_clip_rect(part.clip).rect_stroke(measured, 0.0, stroke, egui::StrokeKind::Outside);
        }
        if let Some([x, y]) = model.probe {
            crosshair(&painter.with_clip_rect(part.clip), part.on_screen(pos2(x, y)));
        }
    }
    let paints = model.brush.paints && ui.input(|i| !i.modifiers.shift && !i.modifiers.command);
    if response.clicked()
        && !paints
        && let Some(at) = response.interact_pointer_pos()
        && let Some(part) = parts.iter().find(|part| part.clip.contains(at))
    {
        let at = part.in_picture(at);
        model.probe = Some([at.x, at.y]);
    }
    let on_line = wipe(model, ui, rect);
    captions(model, ui, rect, &parts);
    loupe(model, ui, &response, &parts);
    let measuring = measure_region(model, ui, &response, &parts);
    paint(model, ui, &response, &parts, paints && !on_line && !measuring);
    if !on_line && !measuring {
        navigate(model, ui, &response, rect);
    }
}

/// Marks the inspected pixel without covering it.
fn crosshair(painter: &egui::Painter, at: egui::Pos2) {
    for (width, colour) in [(3.0, Color32::BLACK), (1.0, Color32::WHITE)] {
        for along in [vec2(1.0, 0.0), vec2(0.0, 1.0), vec2(-1.0, 0.0), vec2(0.0, -1.0)] {
            painter.line_segment([at + along * CROSS[0], at + along * CROSS[1]], egui::Stroke::new(width, colour));
        }
    }
}

/// A picture in the viewport, and its position on the screen.
struct Part {
    texture: usize,
    place: Rect,
    clip: Rect,
    uv: Rect,
}

impl Part {
    /// Converts a position in the picture (in shares of the picture) to a position on the screen.
    fn on_screen(&self, at: egui::Pos2) -> egui::Pos2 {
        self.place.min + (at - self.uv.min) / self.uv.size() * self.place.size()
    }

    /// Converts a position on the screen to a position in the picture (in shares of the picture).
    fn in_picture(&self, at: egui::Pos2) -> egui::Pos2 {
        self.uv.min + (at - self.place.min) / self.place.size() * self.uv.size()
    }
}

/// The parts of the viewport, one per visible picture.
fn parts(model: &Model, rect: Rect) -> Vec<Part> {
    // Use the mode of the last picture, because there is no second picture yet if a mode was just chosen.
    let mode = model.shown().filter(|shown| shown.second.is_some()).map_or(Mode::Off, |shown| shown.wish.compare.mode);
    let whole = |texture, clip| Part { texture, place: rect, clip, uv: cut_out(&model.looking, 1.0) };
    match mode {
        Mode::Off => vec![whole(0, rect)],
        Mode::Flicker if model.looking.b => vec![whole(1, rect)],
        Mode::Flicker => vec![whole(0, rect)],
        Mode::Difference => vec![whole(2, rect)],
        Mode::Wipe => {
            let (left, right) = rect.split_left_right_at_fraction(model.looking.wipe.clamp(0.0, 1.0));
            vec![whole(0, left), whole(1, right)]
        }
        Mode::SideBySide => {
            let (left, right) = rect.split_left_right_at_fraction(0.5);
            let half = |texture, place: Rect| Part { texture, place, clip: place, uv: cut_out(&model.looking, 0.5) };
            vec![half(0, left), half(1, right.translate(vec2(1.0, 0.0)))]
        }
    }
}

/// Returns which part of the picture is visible, in shares of the picture. `width` is the share of the viewport's width that the picture fills.
fn cut_out(looking: &Looking, width: f32) -> Rect {
    let size = vec2(width, 1.0) / looking.zoom.max(1.0);
    let middle = |k: usize, side: f32| looking.centre[k].clamp(side / 2.0, 1.0 - side / 2.0);
    Rect::from_center_size(pos2(middle(0, size.x), middle(1, size.y)), size)
}

/// Shows the line between A and B in the mode *Wipe*. Returns whether the line is being dragged.
fn wipe(model: &mut Model, ui: &Ui, rect: Rect) -> bool {
    if model.compare.mode != Mode::Wipe || model.textures[1].is_none() {
        return false;
    }
    let x = rect.left() + rect.width() * model.looking.wipe;
    let grip = Rect::from_center_size(pos2(x, rect.center().y), vec2(GRASP, rect.height()));
    let response = ui.interact(grip, ui.scope_id().with("wipe"), Sense::drag()).on_hover_cursor(egui::CursorIcon::ResizeHorizontal);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Splitter, true, "Wipe line"));
    model.looking.wipe = (model.looking.wipe + response.drag_delta().x / rect.width().max(1.0)).clamp(0.0, 1.0);
    ui.painter_at(rect).vline(x, rect.y_range(), egui::Stroke::new(1.5, Color32::WHITE));
    response.dragged()
}

/// Shows a caption and a legend on each picture.
fn captions(model: &mut Model, ui: &mut Ui, rect: Rect, parts: &[Part]) {
    let Some(shown) = model.shown().cloned() else { return };
    let settings = &shown.wish.settings;
    let stale = if model.is_settled() { "" } else { " ..." };
    let both = |own: &Settings, other: &Settings, side: &str| format!("{side}: {}{stale}", label(own, other));
    let difference = difference_legend();
    for (i, part) in parts.iter().enumerate() {
        let text = match (&shown.second, part.texture) {
            (None, _) => {
                format!("{} | {} | {}{stale}", settings.choice_name(), settings.frame.estimator.name(), settings.frame.noise.name())
            }
            (Some(second), 0) => both(settings, &second.settings, "A"),
            (Some(second), 1) => both(&second.settings, settings, "B"),
            (Some(second), _) => format!("{}, {}", both(settings, &second.settings, "|A - B|, A"), both(&second.settings, settings, "B")),
        };
        let layer = if part.texture == 1 { settings.layer.of_second() } else { settings.layer };
        // A first look always shows the lit picture.
        let layer = if shown.draft { Layer::Lit } else { layer };
        let own = |side: &str| format!("{}{side}", layer.name());
        let (name, words, legend) = match (&shown.second, part.texture) {
            (None, _) => (own(""), layer.legend(), Some(&shown.legend)),
            (Some(_), 0) => (own(" of A"), layer.legend(), Some(&shown.legend)),
            (Some(second), 1) => (own(" of B"), layer.legend(), Some(&second.legend)),
            (Some(_), _) => (Mode::Difference.name().to_owned(), Mode::Difference.about(), Some(&difference)),
        };
        let legend = legend.filter(|_| part.texture == 2 || layer != Layer::Lit);
        let clip = part.clip.intersect(rect);
        let place = Rect::from_min_size(clip.left_top() + vec2(8.0, 8.0), (clip.size() - vec2(16.0, 16.0)).max(vec2(1.0, 1.0)));
        let over = egui::UiBuilder::new().id_salt(("caption", i)).max_rect(place).layout(egui::Layout::top_down(egui::Align::Min));
        let mut over = ui.new_child(over);
        over.set_clip_rect(clip);
        egui::Frame::new().fill(Color32::from_black_alpha(150)).inner_margin(4.0).corner_radius(3.0).show(&mut over, |ui| {
            ui.visuals_mut().override_text_color = Some(Color32::WHITE);
            ui.label(text);
            if shown.draft {
                ui.label("first look").on_hover_text(
                    "A preview with coarse terrain, small textures and the cheapest shader, until the textures of the scene are ready",
                );
            }
            if shown.wish.culled_from.is_some() {
                let frozen = ui.label(RichText::new("culling frozen").color(Color32::YELLOW));
                frozen.on_hover_text(
                    "Terrain nodes and patches are selected for the camera pose at which culling was frozen. Key C unfreezes it.",
                );
            }
            if let Some(legend) = legend {
                legend::show(ui, &name, words, legend);
            }
        });
    }
}

/// Shows the loupe: A and, if it is drawn, B under the pointer, magnified.
fn loupe(model: &Model, ui: &Ui, response: &egui::Response, parts: &[Part]) {
    let Some(pointer) = response.hover_pos().filter(|_| model.looking.loupe) else { return };
    let Some(part) = parts.iter().find(|part| part.clip.contains(pointer)) else { return };
    let [edge, magnification] = LOUPE;
    let at = part.in_picture(pointer);
    let uv = Rect::from_center_size(at, part.uv.size() / part.place.size() * (edge / magnification));
    let painter = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Foreground, ui.scope_id().with("loupe")));
    let textures = model.textures.iter().take(2).flatten();
    for (i, (texture, name)) in textures.zip(["A", "B"]).enumerate() {
        let place = Rect::from_min_size(pointer + vec2(16.0 + i as f32 * (edge + 4.0), 16.0), vec2(edge, edge));
        painter.rect_filled(place.expand(2.0), 0.0, Color32::WHITE);
        painter.image(texture.id(), place, uv, Color32::WHITE);
        painter.text(place.left_top() + vec2(4.0, 2.0), egui::Align2::LEFT_TOP, name, egui::FontId::proportional(14.0), Color32::WHITE);
    }
}

/// Handles a drag with Ctrl (on macOS, with Cmd). It selects the rectangle to measure. Returns whether a rectangle is being drawn.
fn measure_region(model: &mut Model, ui: &Ui, response: &egui::Response, parts: &[Part]) -> bool {
    if response.drag_started() {
        model.looking.measures = ui.input(|i| i.modifiers.command);
    }
    let dragged = response.dragged_by(egui::PointerButton::Primary) && model.looking.measures;
    let origin = ui.input(|i| i.pointer.press_origin());
    let (Some(from), Some(to)) = (origin, response.interact_pointer_pos()) else { return false };
    let Some(part) = parts.iter().find(|part| part.clip.contains(from)).filter(|_| dragged) else { return false };
    let corners = [from, to].map(|at| part.in_picture(at.clamp(part.clip.min, part.clip.max)));
    let region = Rect::from_two_pos(corners[0], corners[1]).intersect(Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)));
    if region.is_positive() {
        model.metrics.region = Some([region.left(), region.top(), region.right(), region.bottom()]);
        model.metrics.on = true;
    }
    true
}

/// Paints with the brush, and shows its ring on the ground. `may_begin`: whether a drag or click that begins now paints.
fn paint(model: &mut Model, ui: &Ui, response: &egui::Response, parts: &[Part], may_begin: bool) {
    let Some(shown) = model.shown_here().cloned().filter(|_| model.brush.paints) else { return };
    let primary = egui::PointerButton::Primary;
    let pointer = response.interact_pointer_pos();
    let pressed = match (response.clicked(), response.drag_started_by(primary)) {
        (true, _) => pointer,
        (false, true) => ui.input(|i| i.pointer.press_origin()),
        (false, false) => None,
    };
    if let Some(from) = pressed.filter(|_| may_begin)
        && let Some(i) = parts.iter().position(|part| part.clip.contains(from))
    {
        // Changes made before the stroke are undone separately from it.
        model.undo_point(ui.ctx());
        model.brush.begin(i, parts[i].in_picture(from).into());
    }
    let Some(ground) = Ground::of(&shown) else { return };
    if let (Some(to), Some(part)) = (pointer, model.brush.part().and_then(|i| parts.get(i))) {
        let to = part.clip.contains(to).then(|| part.in_picture(to).into());
        model.brush.drag(&mut model.settings.scene, &ground, to);
    }
    let hover = response.hover_pos().or(pointer);
    let Some((at, part)) = hover.and_then(|at| Some((at, parts.iter().find(|part| part.clip.contains(at))?))) else { return };
    let Some(centre) = ground.at(part.in_picture(at).into()) else { return };
    let ring: Vec<_> =
        ground.ring(centre, model.brush.radius_m).into_iter().map(|at| at.map(|[x, y]| part.on_screen(pos2(x, y)))).collect();
    for (width, colour) in [(3.0, Color32::BLACK), (1.5, Color32::WHITE)] {
        for pair in ring.windows(2) {
            if let [Some(from), Some(to)] = *pair {
                ui.painter_at(part.clip).line_segment([from, to], egui::Stroke::new(width, colour));
            }
        }
    }
}

fn navigate(model: &mut Model, ui: &Ui, response: &egui::Response, rect: Rect) {
    let Some(mut pose) = model.pose() else { return };
    let target = orbited(model, &pose);
    let drag = |button| if response.dragged_by(button) { response.drag_delta() } else { vec2(0.0, 0.0) };
    let turn = if model.brush.is_drawing() { vec2(0.0, 0.0) } else { drag(egui::PointerButton::Primary) };
    let height = rect.height() * model.looking.zoom;
    let mut moved = match target {
        Some(target) => flight::swing(&mut pose, target, turn, height),
        None => model.flight.turn(&mut pose, turn, height),
    };
    let pan = drag(egui::PointerButton::Middle) / rect.size() / model.looking.zoom;
    model.looking.centre = [model.looking.centre[0] - pan.x, model.looking.centre[1] - pan.y];
    if response.hovered() {
        model.looking.zoom = (model.looking.zoom * ui.input(egui::InputState::zoom_delta)).clamp(1.0, 64.0);
        let notches = f64::from(ui.input(|i| i.smooth_scroll_delta().y) / NOTCH_POINTS);
        match target {
            _ if notches == 0.0 => {}
            Some(target) => moved |= flight::approach(&mut pose, target, notches),
            None => model.flight.hasten(notches),
        }
    }
    if !ui.ctx().text_edit_focused() {
        let seconds = ui.input(|i| i.stable_dt).min(LONGEST_STEP_S);
        if ui.input(|i| model.flight.advance(&mut pose, i, f64::from(seconds))) {
            moved = true;
            ui.ctx().request_repaint();
        }
    }
    let margin = 0.5 / model.looking.zoom.max(1.0);
    model.looking.centre = model.looking.centre.map(|c| c.clamp(margin, 1.0 - margin));
    let walks = matches!(model.viewpoint, Viewpoint::Free { walking, .. } if walking != model.flight.walking);
    if moved || walks {
        model.fly(pose);
    }
}

/// Returns the orbited place, if there is one. Ends orbiting if the camera walks, or if the place is no longer in the middle of the view.
fn orbited(model: &mut Model, pose: &Pose) -> Option<DVec3> {
    let target = model.flight.target()?;
    if model.flight.walking || !flight::is_centred(pose, target) {
        model.flight.orbit = Orbit::Off;
        return None;
    }
    Some(target)
}

/// The controls for the viewpoint, the layer, the movement of the camera, and frozen culling.
pub(crate) fn viewpoints(model: &mut Model, ui: &mut Ui) {
    let name = match &model.viewpoint {
        Viewpoint::Camera(name) => format!("camera {name}"),
        Viewpoint::Path(name) => format!("path {name}"),
        Viewpoint::Recorded(path) => format!("replay of {}", path.name),
        Viewpoint::Free { walking: true, .. } => "walking".to_owned(),
        Viewpoint::Free { walking: false, .. } if model.flight.target().is_some() => "orbiting".to_owned(),
        Viewpoint::Free { walking: false, .. } => "flying".to_owned(),
    };
    let scene = &model.settings.scene;
    let cameras = scene.cameras.iter().map(|c| (Viewpoint::Camera(c.name.clone()), format!("camera {}", c.name), ""));
    let paths = scene.paths.iter().map(|p| (Viewpoint::Path(p.name.clone()), format!("path {}", p.name), ""));
    let all = cameras.chain(paths).collect();
    choose(ui, "View", &mut model.viewpoint, &name, all)
        .on_hover_text("Cameras and paths of the scene. If you move or turn the view, you change to a free camera.");
    let all = Layer::ALL.into_iter().map(|l| (l, l.name().to_owned(), l.legend())).collect();
    let shown = model.settings.layer.name();
    choose(ui, "Layer", &mut model.settings.layer, shown, all);
    ui.checkbox(&mut model.flight.walking, "Walk")
        .on_hover_text("Keeps a free camera 1.7 m above the ground. Cameras and paths of the scene keep their heights. Key: F.");
    let mut orbits = model.flight.orbit != Orbit::Off;
    let hint = "Orbits the place at the inspected pixel or, if there is none, in the middle of the picture. A drag turns the camera about this \
                place. The wheel moves the camera closer or farther away. W A S D Q E move the camera and the place together. Key: O.";
    if ui.checkbox(&mut orbits, "Orbit").on_hover_text(hint).changed() {
        model.orbit(orbits);
    }
    match model.flight.target().zip(model.pose()) {
        Some((target, pose)) => {
            let distance_m = pose.position.distance(target);
            ui.label(format!("{distance_m:.2} m away"))
                .on_hover_text("Distance from the camera to the orbited place. The wheel over the picture changes it.");
        }
        None => {
            ui.label(format!("{:.3} m/s", model.flight.speed_m_s))
                .on_hover_text("Speed at which the keys W A S D Q E move the camera without Shift. The wheel over the picture changes it.");
        }
    }
    let frozen = model.culled_from.is_some();
    let able = frozen || model.pose().is_some();
    let button = ui.add_enabled(able, egui::Button::new("Freeze culling").selected(frozen));
    button.widget_info(|| egui::WidgetInfo::selected(egui::Role::Button, able, frozen, "Freeze culling"));
    let hint = "Freezes or unfreezes culling. While it is frozen, terrain nodes and patches are selected for the camera pose at which you froze \
                it, so that you can see from elsewhere what culling removes. Key: C.";
    if button.on_hover_text(hint).on_disabled_hover_text(super::NO_CAMERA).clicked() {
        model.freeze_culling();
    }
}

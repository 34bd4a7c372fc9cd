//! The picture, and moving about in it.

use eframe::egui::{self, Color32, Rect, Sense, Ui, pos2, vec2};

use super::choose;
use crate::app::{Looking, Workbench};
use crate::compare::{Mode, label};
use crate::display::Layer;
use crate::engine::Viewpoint;
use crate::settings::Settings;

/// Longest step of the camera between two frames of the window, seconds: a stall must not throw it across the map.
const LONGEST_STEP_S: f32 = 0.25;
/// Points of the wheel that are a notch.
const NOTCH_POINTS: f32 = 50.0;

/// Points at which a line can be grasped.
const GRASP: f32 = 10.0;
/// Where the arms of a crosshair begin and end, points from its middle.
const CROSS: [f32; 2] = [4.0, 12.0];
/// Edge of the loupe, points, and how much it magnifies.
const LOUPE: [f32; 2] = [150.0, 8.0];

pub(crate) fn show(app: &mut Workbench, ui: &mut Ui) {
    let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Picture"));
    let pixels = ui.ctx().pixels_per_point();
    app.room = [rect.width(), rect.height()].map(|side| (side * pixels).round().max(0.0) as u32);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, Color32::BLACK);
    if app.textures[0].is_none() {
        let text = app.news.progress.as_ref().map_or("starting", |p| p.stage.as_str());
        painter.text(rect.center(), egui::Align2::CENTER_CENTER, text, egui::FontId::proportional(16.0), Color32::GRAY);
    }
    if response.clicked() || response.drag_started() {
        response.request_focus();
    }
    let parts = parts(app, rect);
    for part in &parts {
        if let Some(texture) = &app.textures[part.texture] {
            painter.with_clip_rect(part.clip).image(texture.id(), part.place, part.uv, Color32::WHITE);
        }
        let region = app.metrics.region.filter(|_| app.shown().is_some_and(|shown| shown.wish.is_measured()));
        if let Some([left, top, right, bottom]) = region {
            let measured = Rect::from_min_max(part.on_screen(pos2(left, top)), part.on_screen(pos2(right, bottom)));
            let stroke = egui::Stroke::new(1.5, Color32::YELLOW);
            painter.with_clip_rect(part.clip).rect_stroke(measured, 0.0, stroke, egui::StrokeKind::Outside);
        }
        if let Some([x, y]) = app.probe {
            crosshair(&painter.with_clip_rect(part.clip), part.on_screen(pos2(x, y)));
        }
    }
    if response.clicked()
        && let Some(at) = response.interact_pointer_pos()
        && let Some(part) = parts.iter().find(|part| part.clip.contains(at))
    {
        let at = part.in_picture(at);
        app.probe = Some([at.x, at.y]);
    }
    let on_line = wipe(app, ui, rect);
    captions(app, ui, rect, &parts);
    loupe(app, ui, &response, &parts);
    let measuring = measure_region(app, ui, &response, &parts);
    if !on_line && !measuring {
        navigate(app, ui, &response, rect);
    }
}

/// Marks the pixel that is taken apart, without covering it.
fn crosshair(painter: &egui::Painter, at: egui::Pos2) {
    for (width, colour) in [(3.0, Color32::BLACK), (1.0, Color32::WHITE)] {
        for along in [vec2(1.0, 0.0), vec2(0.0, 1.0), vec2(-1.0, 0.0), vec2(0.0, -1.0)] {
            painter.line_segment([at + along * CROSS[0], at + along * CROSS[1]], egui::Stroke::new(width, colour));
        }
    }
}

/// Where one of the pictures is on the screen.
struct Part {
    texture: usize,
    place: Rect,
    clip: Rect,
    uv: Rect,
}

impl Part {
    /// Where a place of the picture (shares of it) is on the screen.
    fn on_screen(&self, at: egui::Pos2) -> egui::Pos2 {
        self.place.min + (at - self.uv.min) / self.uv.size() * self.place.size()
    }

    /// What place of the picture is there on the screen.
    fn in_picture(&self, at: egui::Pos2) -> egui::Pos2 {
        self.uv.min + (at - self.place.min) / self.place.size() * self.uv.size()
    }
}

/// What the viewport is divided into.
fn parts(app: &Workbench, rect: Rect) -> Vec<Part> {
    // What is up is what was drawn: a mode that was only just chosen has no second picture yet.
    let mode = app.shown().filter(|shown| shown.second.is_some()).map_or(Mode::Off, |shown| shown.wish.compare.mode);
    let whole = |texture, clip| Part { texture, place: rect, clip, uv: cut_out(&app.looking, 1.0) };
    match mode {
        Mode::Off => vec![whole(0, rect)],
        Mode::Flicker if app.looking.b => vec![whole(1, rect)],
        Mode::Flicker => vec![whole(0, rect)],
        Mode::Difference => vec![whole(2, rect)],
        Mode::Wipe => {
            let (left, right) = rect.split_left_right_at_fraction(app.looking.wipe.clamp(0.0, 1.0));
            vec![whole(0, left), whole(1, right)]
        }
        Mode::SideBySide => {
            let (left, right) = rect.split_left_right_at_fraction(0.5);
            let half = |texture, place: Rect| Part { texture, place, clip: place, uv: cut_out(&app.looking, 0.5) };
            vec![half(0, left), half(1, right.translate(vec2(1.0, 0.0)))]
        }
    }
}

/// The part of the picture that is looked at, `width` of the viewport wide.
fn cut_out(looking: &Looking, width: f32) -> Rect {
    let size = vec2(width, 1.0) / looking.zoom.max(1.0);
    let middle = |k: usize, side: f32| looking.centre[k].clamp(side / 2.0, 1.0 - side / 2.0);
    Rect::from_center_size(pos2(middle(0, size.x), middle(1, size.y)), size)
}

/// The line between A and B; says whether it is being dragged.
fn wipe(app: &mut Workbench, ui: &Ui, rect: Rect) -> bool {
    if app.compare.mode != Mode::Wipe || app.textures[1].is_none() {
        return false;
    }
    let x = rect.left() + rect.width() * app.looking.wipe;
    let grip = Rect::from_center_size(pos2(x, rect.center().y), vec2(GRASP, rect.height()));
    let response = ui.interact(grip, ui.scope_id().with("wipe"), Sense::drag()).on_hover_cursor(egui::CursorIcon::ResizeHorizontal);
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Splitter, true, "Wipe line"));
    app.looking.wipe = (app.looking.wipe + response.drag_delta().x / rect.width().max(1.0)).clamp(0.0, 1.0);
    ui.painter_at(rect).vline(x, rect.y_range(), egui::Stroke::new(1.5, Color32::WHITE));
    response.dragged()
}

/// Says which picture is which.
fn captions(app: &mut Workbench, ui: &mut Ui, rect: Rect, parts: &[Part]) {
    let Some(shown) = app.shown().cloned() else { return };
    let settings = &shown.wish.settings;
    let stale = if app.is_settled() { "" } else { " ..." };
    let both = |own: &Settings, other: &Settings, side: &str| format!("{side}: {}{stale}", label(own, other));
    for (i, part) in parts.iter().enumerate() {
        let text = match (&shown.second, part.texture) {
            (None, _) => format!("{} | {} | {}{stale}", settings.choice_name(), settings.estimator.name(), settings.noise.name()),
            (Some(second), 0) => both(settings, &second.settings, "A"),
            (Some(second), 1) => both(&second.settings, settings, "B"),
            (Some(second), _) => format!("{}, {}", both(settings, &second.settings, "|A - B|, A"), both(&second.settings, settings, "B")),
        };
        let layer = match part.texture {
            2 => Some(Mode::Difference.about().to_owned()),
            side => Some(if side == 1 { settings.layer.of_second() } else { settings.layer })
                .filter(|layer| *layer != Layer::Lit)
                .map(|layer| format!("{}: {}", layer.name(), layer.legend())),
        };
        let clip = part.clip.intersect(rect);
        let place = Rect::from_min_size(clip.left_top() + vec2(8.0, 8.0), vec2((clip.width() - 16.0).max(1.0), 60.0));
        let over = egui::UiBuilder::new().id_salt(("caption", i)).max_rect(place).layout(egui::Layout::top_down(egui::Align::Min));
        let mut over = ui.new_child(over);
        over.set_clip_rect(clip);
        egui::Frame::new().fill(Color32::from_black_alpha(150)).inner_margin(4.0).corner_radius(3.0).show(&mut over, |ui| {
            ui.visuals_mut().override_text_color = Some(Color32::WHITE);
            ui.label(text);
            if let Some(layer) = layer {
                ui.label(layer);
            }
        });
    }
}

/// What is under the pointer, magnified, of A and of B.
fn loupe(app: &Workbench, ui: &Ui, response: &egui::Response, parts: &[Part]) {
    let Some(pointer) = response.hover_pos().filter(|_| app.looking.loupe) else { return };
    let Some(part) = parts.iter().find(|part| part.clip.contains(pointer)) else { return };
    let [edge, magnification] = LOUPE;
    let at = part.in_picture(pointer);
    let uv = Rect::from_center_size(at, part.uv.size() / part.place.size() * (edge / magnification));
    let painter = ui.ctx().layer_painter(egui::LayerId::new(egui::Order::Foreground, ui.scope_id().with("loupe")));
    let textures = app.textures.iter().take(2).flatten();
    for (i, (texture, name)) in textures.zip(["A", "B"]).enumerate() {
        let place = Rect::from_min_size(pointer + vec2(16.0 + i as f32 * (edge + 4.0), 16.0), vec2(edge, edge));
        painter.rect_filled(place.expand(2.0), 0.0, Color32::WHITE);
        painter.image(texture.id(), place, uv, Color32::WHITE);
        painter.text(place.left_top() + vec2(4.0, 2.0), egui::Align2::LEFT_TOP, name, egui::FontId::proportional(14.0), Color32::WHITE);
    }
}

/// Ctrl and a drag: the rectangle that is measured. Says whether one is being drawn.
fn measure_region(app: &mut Workbench, ui: &Ui, response: &egui::Response, parts: &[Part]) -> bool {
    if response.drag_started() {
        app.looking.measures = ui.input(|i| i.modifiers.command);
    }
    let dragged = response.dragged_by(egui::PointerButton::Primary) && app.looking.measures;
    let origin = ui.input(|i| i.pointer.press_origin());
    let (Some(from), Some(to)) = (origin, response.interact_pointer_pos()) else { return false };
    let Some(part) = parts.iter().find(|part| part.clip.contains(from)).filter(|_| dragged) else { return false };
    let corners = [from, to].map(|at| part.in_picture(at.clamp(part.clip.min, part.clip.max)));
    let region = Rect::from_two_pos(corners[0], corners[1]).intersect(Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)));
    if region.is_positive() {
        app.metrics.region = Some([region.left(), region.top(), region.right(), region.bottom()]);
        app.metrics.on = true;
    }
    true
}

fn navigate(app: &mut Workbench, ui: &Ui, response: &egui::Response, rect: Rect) {
    let Some(mut pose) = app.pose() else { return };
    let drag = |button| if response.dragged_by(button) { response.drag_delta() } else { vec2(0.0, 0.0) };
    let mut moved = app.flight.turn(&mut pose, drag(egui::PointerButton::Primary), rect.height() * app.looking.zoom);
    let pan = drag(egui::PointerButton::Middle) / rect.size() / app.looking.zoom;
    app.looking.centre = [app.looking.centre[0] - pan.x, app.looking.centre[1] - pan.y];
    if response.hovered() {
        app.looking.zoom = (app.looking.zoom * ui.input(egui::InputState::zoom_delta)).clamp(1.0, 64.0);
        let notches = ui.input(|i| i.smooth_scroll_delta().y) / NOTCH_POINTS;
        if notches != 0.0 {
            app.flight.hasten(f64::from(notches));
        }
    }
    if !ui.ctx().text_edit_focused() {
        let seconds = ui.input(|i| i.stable_dt).min(LONGEST_STEP_S);
        if ui.input(|i| app.flight.advance(&mut pose, i, f64::from(seconds))) {
            moved = true;
            ui.ctx().request_repaint();
        }
    }
    let margin = 0.5 / app.looking.zoom.max(1.0);
    app.looking.centre = app.looking.centre.map(|c| c.clamp(margin, 1.0 - margin));
    let walks = matches!(app.viewpoint, Viewpoint::Free { walking, .. } if walking != app.flight.walking);
    if moved || walks {
        app.fly(pose);
    }
}

/// Cameras and paths of the scene, the layer on show, and how fast the camera is.
pub(crate) fn viewpoints(app: &mut Workbench, ui: &mut Ui) {
    let name = match &app.viewpoint {
        Viewpoint::Camera(name) => format!("camera {name}"),
        Viewpoint::Path(name) => format!("path {name}"),
        Viewpoint::Recorded(path) => format!("replay of {}", path.name),
        Viewpoint::Free { walking: true, .. } => "walking".to_owned(),
        Viewpoint::Free { walking: false, .. } => "flying".to_owned(),
    };
    let scene = &app.original;
    let cameras = scene.cameras.iter().map(|c| (Viewpoint::Camera(c.name.clone()), format!("camera {}", c.name), ""));
    let paths = scene.paths.iter().map(|p| (Viewpoint::Path(p.name.clone()), format!("path {}", p.name), ""));
    let all = cameras.chain(paths).collect();
    choose(ui, "View", &mut app.viewpoint, &name, all).on_hover_text("Cameras and paths of the scene; drag or W A S D to leave them");
    let all = Layer::ALL.into_iter().map(|l| (l, l.name().to_owned(), l.legend())).collect();
    let shown = app.settings.layer.name();
    choose(ui, "Layer", &mut app.settings.layer, shown, all);
    ui.checkbox(&mut app.flight.walking, "Walk").on_hover_text("Keep the eye 1.7 m over the ground (F)");
    ui.label(format!("{:.3} m/s", app.flight.speed_m_s)).on_hover_text("Speed: the wheel over the picture changes it");
}

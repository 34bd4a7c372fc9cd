//! The picture, and moving about in it.

use eframe::egui::{self, Color32, Rect, Sense, Ui, pos2, vec2};

use super::choose;
use crate::app::Workbench;
use crate::display::Layer;
use crate::engine::Viewpoint;

/// Longest step of the camera between two frames of the window, seconds: a stall must not throw it across the map.
const LONGEST_STEP_S: f32 = 0.25;
/// Points of the wheel that are a notch.
const NOTCH_POINTS: f32 = 50.0;

pub(crate) fn show(app: &mut Workbench, ui: &mut Ui) {
    let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, "Picture"));
    let pixels = ui.ctx().pixels_per_point();
    app.room = [rect.width(), rect.height()].map(|side| (side * pixels).round().max(0.0) as u32);
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 0.0, Color32::BLACK);
    if let Some(texture) = &app.texture {
        painter.image(texture.id(), rect, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    } else {
        let text = app.news.progress.as_ref().map_or("starting", |p| p.stage.as_str());
        painter.text(rect.center(), egui::Align2::CENTER_CENTER, text, egui::FontId::proportional(16.0), Color32::GRAY);
    }
    if response.clicked() || response.drag_started() {
        response.request_focus();
    }
    caption(app, ui, rect);
    navigate(app, ui, &response, rect);
}

/// Says which picture this is.
fn caption(app: &mut Workbench, ui: &mut Ui, rect: Rect) {
    let Some(shown) = app.shown().cloned() else { return };
    let settings = &shown.wish.settings;
    let place = Rect::from_min_size(rect.left_top() + vec2(8.0, 8.0), vec2((rect.width() - 16.0).max(1.0), 40.0));
    let mut over = ui.new_child(egui::UiBuilder::new().max_rect(place).layout(egui::Layout::top_down(egui::Align::Min)));
    egui::Frame::new().fill(Color32::from_black_alpha(150)).inner_margin(4.0).corner_radius(3.0).show(&mut over, |ui| {
        ui.visuals_mut().override_text_color = Some(Color32::WHITE);
        let stale = if app.is_settled() { "" } else { " ..." };
        ui.label(format!("{} | {} | {}{stale}", settings.choice_name(), settings.estimator.name(), settings.noise.name()));
        if settings.layer != Layer::Lit {
            ui.label(format!("{}: {}", settings.layer.name(), settings.layer.legend()));
        }
    });
}

fn navigate(app: &mut Workbench, ui: &Ui, response: &egui::Response, rect: Rect) {
    let Some(mut pose) = app.pose() else { return };
    let mut moved = app.flight.turn(&mut pose, response.drag_delta(), rect.height());
    if response.hovered() {
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

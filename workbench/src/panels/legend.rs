//! The legend on top of a picture.

use eframe::egui::{Align2, Color32, FontId, Mesh, Rect, Role, Sense, Stroke, Ui, WidgetInfo, pos2, vec2};

use crate::model::display::{Legend, Scale, Swatch};

/// Width and height of a bar of colours, points.
const BAR: [f32; 2] = [240.0, 10.0];
/// Length of a tick below the bar, and font size of its text, points.
const TICK: f32 = 4.0;
const TEXT: f32 = 11.0;
/// Number of segments of a bar; colours are interpolated within a segment.
const PIECES: u16 = 128;
/// Width and height of a swatch, points.
const SWATCH: f32 = 12.0;

/// Draws a legend. `name` says what the picture shows, and must differ from the names of other legends on screen. `words` explains the colours.
pub(crate) fn show(ui: &mut Ui, name: &str, words: &str, legend: &Legend) {
    match legend {
        Legend::Words => {
            ui.label(format!("{name}: {words}"));
        }
        Legend::Bars(scales) => {
            for scale in *scales {
                let title = format!("{name}: {}", scale.name);
                ui.label(&title).on_hover_text(words);
                bar(ui, &title, words, scale);
            }
        }
        Legend::Swatches(swatches) => {
            ui.label(name).on_hover_text(words);
            ui.horizontal_wrapped(|ui| {
                for swatch in swatches {
                    one(ui, name, words, swatch);
                }
            });
        }
    }
}

/// Draws a bar with all colours of a scale, and ticks below it.
fn bar(ui: &mut Ui, title: &str, words: &str, scale: &Scale) {
    let [longest, height] = BAR;
    let size = vec2(ui.available_width().min(longest), height + TICK + TEXT + 2.0);
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, format!("Legend of {title}")));
    let bar = Rect::from_min_size(rect.min, vec2(size.x, height));
    let mut mesh = Mesh::default();
    for piece in 0..=PIECES {
        let place = f32::from(piece) / f32::from(PIECES);
        let [r, g, b] = scale.at(place);
        let x = bar.left() + place * bar.width();
        for y in [bar.top(), bar.bottom()] {
            mesh.colored_vertex(pos2(x, y), Color32::from_rgb(r, g, b));
        }
        if let Some(last) = u32::from(piece).checked_sub(1) {
            mesh.add_triangle(2 * last, 2 * last + 1, 2 * last + 2);
            mesh.add_triangle(2 * last + 1, 2 * last + 2, 2 * last + 3);
        }
    }
    let painter = ui.painter();
    painter.add(mesh);
    for (value, text) in scale.ticks {
        let place = scale.place(*value);
        let x = bar.left() + place * bar.width();
        painter.vline(x, bar.top()..=bar.bottom() + TICK, Stroke::new(1.0, Color32::WHITE));
        // Align the text at the ends so that it does not extend beyond the bar.
        let align = if place < 0.01 {
            Align2::LEFT_TOP
        } else if place > 0.99 {
            Align2::RIGHT_TOP
        } else {
            Align2::CENTER_TOP
        };
        painter.text(pos2(x, bar.bottom() + TICK), align, text, FontId::proportional(TEXT), Color32::WHITE);
    }
    response.on_hover_text(words);
}

/// Draws a swatch of a colour, and the text that says what the colour means.
fn one(ui: &mut Ui, name: &str, words: &str, swatch: &Swatch) {
    let Swatch { colour: [r, g, b], name: meaning } = swatch;
    let text = ui.painter().layout_no_wrap(meaning.clone(), FontId::proportional(TEXT), Color32::WHITE);
    let size = vec2(SWATCH + 4.0 + text.size().x, SWATCH.max(text.size().y));
    let (rect, response) = ui.allocate_exact_size(size, Sense::hover());
    response.widget_info(|| WidgetInfo::labeled(Role::Image, true, format!("Legend of {name}: {meaning}")));
    let square = Rect::from_min_size(pos2(rect.left(), rect.center().y - SWATCH / 2.0), vec2(SWATCH, SWATCH));
    ui.painter().rect_filled(square, 2.0, Color32::from_rgb(*r, *g, *b));
    ui.painter().galley(pos2(square.right() + 4.0, rect.center().y - text.size().y / 2.0), text, Color32::WHITE);
    response.on_hover_text(words);
}

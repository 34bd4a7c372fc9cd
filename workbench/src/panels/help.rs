//! The panel *Help*: a short introduction, and the keys.

use eframe::egui::{Label, Ui};

use super::COMMAND;

const TEXT: &str = "A terrain shaded as in Far Cry 5: each tile of 8 x 8 pixels runs one of 31 shaders, the cheapest that can shade all its pixels. \
    Far ground comes from textures baked into the quadtree, near ground from virtual-texture pages, and cliffs from a few texture samples \
    chosen at random. Force another variant, estimator or noise on every tile, and see what it costs and how it changes the picture.";

/// The keys, and what they do. [`COMMAND`] takes the place of `Ctrl`.
const KEYS: [(&str, &str); 22] = [
    ("drag", "look around"),
    ("click", "inspect a pixel: Inspector"),
    ("W A S D", "move; with Shift four times as fast"),
    ("Q E", "down, up"),
    ("wheel", "speed"),
    ("F", "walk on the ground, or fly"),
    ("O", "orbit: a drag turns the camera about the inspected pixel or the middle of the picture, the wheel moves it closer or away"),
    ("C", "freeze culling: fly away to see what is culled"),
    ("1 - 5", "force a flavour, or no longer force it"),
    ("0", "choose the variant of each tile automatically"),
    ("G", "generic kernel"),
    ("Space", "pause"),
    (".", "advance by one frame and pause"),
    ("X", "switch between A and B, one picture at a time"),
    ("L", "loupe"),
    ("B", "switch painting on or off: a drag or a click then paints with the brush"),
    ("Shift+drag", "look around while painting"),
    ("Ctrl+wheel", "zoom"),
    ("middle drag", "move the magnified part of the picture"),
    ("Ctrl+drag", "select a rectangle for the live metrics"),
    ("Ctrl+Z, Ctrl+Shift+Z", "undo, redo"),
    ("drop a file or folder", "open a scene, or use a folder of textures"),
];

/// Width of the column of keys, points.
const KEY_COLUMN: f32 = 170.0;

pub(crate) fn show(ui: &mut Ui) {
    ui.label(TEXT);
    ui.separator();
    for (key, does) in KEYS {
        ui.horizontal_top(|ui| {
            ui.scope(|ui| {
                ui.set_width(KEY_COLUMN);
                ui.monospace(key.replace("Ctrl", COMMAND));
            });
            ui.add(Label::new(does).wrap());
        });
    }
}

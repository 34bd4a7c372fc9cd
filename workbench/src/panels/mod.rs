//! What the window is made of. A panel is a function of the application and a place.

pub(crate) mod compare;
pub(crate) mod experiments;
pub(crate) mod frame;
pub(crate) mod help;
pub(crate) mod inspector;
pub(crate) mod machine;
pub(crate) mod metrics;
pub(crate) mod parameters;
pub(crate) mod places;
pub(crate) mod variants;
pub(crate) mod viewport;

use eframe::egui::{ComboBox, Response, Ui};

/// A labelled list of which one is chosen; `items` are values with their names and what is said of them.
pub(crate) fn choose<T: PartialEq>(ui: &mut Ui, label: &str, current: &mut T, shown: &str, items: Vec<(T, String, &str)>) -> Response {
    let text = ui.label(label);
    let combo = ComboBox::from_id_salt(label).selected_text(shown).show_ui(ui, |ui| {
        for (value, name, about) in items {
            let item = ui.selectable_value(current, value, name);
            if !about.is_empty() {
                item.on_hover_text(about);
            }
        }
    });
    combo.response.labelled_by(text.id)
}

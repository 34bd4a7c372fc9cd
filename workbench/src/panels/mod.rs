//! The panels of the window. A panel is a function that draws into a `Ui`. Most panels also take the model, and some take a state of their own.

pub(crate) mod brush;
pub(crate) mod compare;
pub(crate) mod control;
pub(crate) mod experiments;
pub(crate) mod frame;
pub(crate) mod help;
pub(crate) mod inspector;
pub(crate) mod legend;
pub(crate) mod machine;
pub(crate) mod materials;
pub(crate) mod metrics;
pub(crate) mod parameters;
pub(crate) mod places;
pub(crate) mod rules;
pub(crate) mod scenes;
pub(crate) mod variants;
pub(crate) mod viewport;

use eframe::egui::{self, Button, ComboBox, Label, Response, RichText, Role, Slider, SliderClamping, Ui, WidgetInfo};

use experiments::ExperimentsPanel;
use machine::MachinePanel;

use crate::model::panes::Pane;
use crate::model::state::Model;

/// Name of the modifier key of shortcuts on this system.
pub(crate) const COMMAND: &str = if cfg!(target_os = "macos") { "Cmd" } else { "Ctrl" };

/// The tooltip of a disabled button that needs a camera pose.
const NO_CAMERA: &str = "The camera pose is not known yet: wait for the next picture";

/// The states of those panels whose state is not a part of the model. These states do not depend on the scene.
#[derive(Default)]
pub(crate) struct Panels {
    machine: MachinePanel,
    experiments: ExperimentsPanel,
}

impl Panels {
    /// Draws the panel of a pane.
    pub(crate) fn show(&mut self, pane: Pane, model: &mut Model, ui: &mut Ui) {
        if pane == Pane::Viewport {
            // The picture fills its pane.
            viewport::show(model, ui);
            return;
        }
        egui::Frame::new().inner_margin(8.0).show(ui, |ui| {
            egui::ScrollArea::both().auto_shrink(false).show(ui, |ui| match pane {
                Pane::Viewport => {}
                Pane::Variants => variants::show(model, ui),
                Pane::Materials => materials::show(model, ui),
                Pane::Rules => rules::show(model, ui),
                Pane::Brush => brush::show(model, ui),
                Pane::Compare => compare::show(model, ui),
                Pane::Metrics => metrics::show(model, ui),
                Pane::Parameters => parameters::show(model, ui),
                Pane::Frame => frame::show(model, ui),
                Pane::Inspector => inspector::show(model, ui),
                Pane::Machine => machine::show(&mut self.machine, model, ui),
                Pane::Experiments => experiments::show(&mut self.experiments, model, ui),
                Pane::Places => places::show(model, ui),
                Pane::Help => help::show(ui),
            });
        });
    }
}

/// Shows a labelled drop-down list. `shown` is the name of the current value. `items` are the values with their names and tooltips; an empty tooltip
/// is not shown.
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

/// The description of a control for a number.
pub(crate) struct Number<'a> {
    /// The label of the number, which must be unique on screen.
    pub(crate) name: &'a str,
    /// The unit; empty = the number has no unit.
    pub(crate) unit: &'a str,
    /// Smallest and largest value of the slider.
    pub(crate) range: [f64; 2],
    /// Whether the slider is logarithmic.
    pub(crate) logarithmic: bool,
    /// A description of the number; the first line of the tooltip.
    pub(crate) about: &'a str,
}

/// A row of a grid with three columns: label, slider, and a button that resets the value to `usual`. `None` = there is no value to reset to.
pub(crate) fn number(ui: &mut Ui, number: &Number<'_>, value: &mut f64, usual: Option<f64>) {
    let Number { name, unit, range, logarithmic, about } = *number;
    let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let back = usual.map_or_else(String::new, |usual| format!("; `Reset` restores {usual}{unit}"));
    let hint = format!("{about}\nFrom {} to {}{unit}{back}.", range[0], range[1]);
    let label = ui.label(name).on_hover_text(&hint);
    let slider = Slider::new(value, range[0]..=range[1]).logarithmic(logarithmic).clamping(SliderClamping::Edits);
    ui.add(slider.suffix(unit).max_decimals(3)).labelled_by(label.id).on_hover_text(&hint);
    reset(ui, name, value, usual.as_ref());
    ui.end_row();
}

/// A button that resets a value to `usual`. `None` = there is no value to reset to, so the button is disabled.
pub(crate) fn reset<T: Clone + PartialEq>(ui: &mut Ui, name: &str, value: &mut T, usual: Option<&T>) {
    let changed = usual.is_some_and(|usual| *usual != *value);
    let button = ui.add_enabled(changed, Button::new("Reset").small());
    button.widget_info(|| WidgetInfo::labeled(Role::Button, changed, format!("Reset {name}")));
    let why = match usual {
        Some(_) => "The value is the original one already",
        None => "There is no original value: the scene as it was opened or last saved does not have this material",
    };
    let hint = "Restores the original value. For a value of the scene, it is the value when the scene was opened or last saved; for other values, \
                it is the default.";
    if button.on_hover_text(hint).on_disabled_hover_text(why).clicked()
        && let Some(usual) = usual
    {
        value.clone_from(usual);
    }
}

/// A hint for a field in which a path is typed. It names the folder at which relative paths start.
pub(crate) fn from_here() -> String {
    let here = std::env::current_dir().map_or_else(|_| "the working directory".to_owned(), |folder| folder.display().to_string());
    format!("A relative file path starts at {here}")
}

/// Shows the result or the error of the last action in a part of a panel, and scrolls to it if it is new. `what` names that part.
pub(crate) fn outcome(ui: &mut Ui, what: &str, said: Option<&Result<String, String>>) {
    let id = ui.scope_id().with(("outcome", what));
    let Some(said) = said else {
        ui.data_mut(|data| data.remove::<String>(id));
        return;
    };
    let (text, colour) = match said {
        Ok(done) => (done, None),
        Err(wrong) => (wrong, Some(ui.visuals().error_fg_color)),
    };
    let shown = colour.into_iter().fold(RichText::new(text), RichText::color);
    // Panels also scroll sideways, so a long line would continue out of sight. Wrap the text at the visible edge.
    let place = ui.scope(|ui| {
        ui.set_max_width(ui.clip_rect().right() - ui.cursor().left());
        ui.add(Label::new(shown).wrap())
    });
    let before = ui.data_mut(|data| data.get_temp::<String>(id));
    if before.as_ref() != Some(text) {
        place.inner.scroll_to_me(None);
        ui.data_mut(|data| data.insert_temp(id, text.clone()));
    }
}

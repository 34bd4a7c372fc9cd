//! The control of a setting. Its label, range and tooltip come from the table of settings.

use eframe::egui::{DragValue, Response, Slider, SliderClamping, Ui};
use kernels::settings::{Kind, Setting, shown};
use toml::Value;

use super::{choose, reset};

/// Shows a label and the control of a setting. In a grid, they take two columns. A flag takes one column, because the checkbox includes its label.
/// `owner` stores the value. `about_item` returns the tooltip of a value in a list; an empty tooltip is not shown. Returns `None`, and shows nothing,
/// if there is no control for settings of this kind.
pub(crate) fn control<T>(ui: &mut Ui, setting: &Setting<T>, owner: &mut T, about_item: fn(&str) -> &'static str) -> Option<Response> {
    let before = setting.get(owner)?;
    let mut value = before.clone();
    let about = setting.about;
    let response = match (setting.kind, &mut value) {
        (Kind::Flag, Value::Boolean(on)) => ui.checkbox(on, setting.label()).on_hover_text(about),
        (Kind::Number(range), Value::Float(number)) => {
            let ends = setting.listing.slider.map_or([range.least, range.most], |slider| slider.ends);
            let logarithmic = setting.listing.slider.is_some_and(|slider| slider.logarithmic);
            let suffix = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
            let label = ui.label(setting.label()).on_hover_text(about);
            // The user may type a number that is outside the ends of the slider, but within the range of the setting.
            let slider = Slider::new(number, ends[0]..=ends[1]).logarithmic(logarithmic).clamping(SliderClamping::Never);
            let response = ui.add(slider.suffix(suffix).max_decimals(2)).labelled_by(label.id).on_hover_text(about);
            *number = number.clamp(range.least, range.most);
            response
        }
        (Kind::Whole(least, most), Value::Integer(whole)) => {
            let label = ui.label(setting.label()).on_hover_text(about);
            ui.add(DragValue::new(whole).range(least..=most)).labelled_by(label.id).on_hover_text(about)
        }
        (Kind::Name(names), value) => {
            let items = names().into_iter().map(|name| (Value::String(name.to_owned()), name.to_owned(), about_item(name))).collect();
            let current = value.as_str().unwrap_or_default().to_owned();
            choose(ui, setting.label(), value, &current, items).on_hover_text(about)
        }
        (Kind::OneOf(numbers), value) => {
            let items = numbers.iter().map(|&n| (Value::Integer(n.into()), n.to_string(), "")).collect();
            let current = shown(value);
            choose(ui, setting.label(), value, &current, items).on_hover_text(about)
        }
        // The setting with a text (the forced variant) has a control elsewhere. The workbench does not show settings with lists of numbers.
        _ => return None,
    };
    if value != before {
        // A control offers only values that the setting accepts.
        let set = setting.set(owner, &value);
        debug_assert!(set.is_ok(), "{set:?}");
    }
    Some(response)
}

/// A button that resets a setting to the value `usual`.
pub(crate) fn reset_setting<T>(ui: &mut Ui, setting: &Setting<T>, owner: &mut T, usual: &Value) {
    let Some(mut value) = setting.get(owner) else { return };
    let before = value.clone();
    reset(ui, setting.label(), &mut value, Some(usual));
    if value != before {
        let set = setting.set(owner, &value);
        debug_assert!(set.is_ok(), "{set:?}");
    }
}

//! The control of a setting, as its table says: what it is called, what it accepts, and what it does.

use eframe::egui::{DragValue, Response, Slider, SliderClamping, Ui};
use kernels::settings::{Kind, Setting, shown};
use toml::Value;

use super::{choose, reset};

/// A label and the control of a setting; a flag has its label within. Inside a grid they are two columns. `about_item` says more of one value in a
/// list; it may be empty.
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
            let slider = Slider::new(number, ends[0]..=ends[1]).logarithmic(logarithmic).clamping(SliderClamping::Always);
            ui.add(slider.suffix(suffix).max_decimals(2)).labelled_by(label.id).on_hover_text(about)
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
        // Texts and lists of numbers have controls of their own.
        _ => return None,
    };
    if value != before {
        // A control offers only what the setting accepts.
        let set = setting.set(owner, &value);
        debug_assert!(set.is_ok(), "{set:?}");
    }
    Some(response)
}

/// A button that takes a setting back to its usual value.
pub(crate) fn reset_setting<T>(ui: &mut Ui, setting: &Setting<T>, owner: &mut T, usual: &Value) {
    let Some(mut value) = setting.get(owner) else { return };
    let before = value.clone();
    reset(ui, setting.label(), &mut value, Some(usual));
    if value != before {
        let set = setting.set(owner, &value);
        debug_assert!(set.is_ok(), "{set:?}");
    }
}

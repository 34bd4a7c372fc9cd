//! The documentation of settings: tables in Markdown and in plain text, generated from the declarations.

use std::fmt::Write as _;

use serde::Serialize;
use toml::Value;

use super::{Kind, Setting, shown};

/// Where a setting can be set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Home {
    /// In the scene file, under the key of the setting.
    SceneFile,
    /// In `[set]` or `[vary]` of an experiment's definition, under the key of the setting.
    Definition,
    /// In a list of an experiment's definition. The list has this key.
    DefinitionList(&'static str),
    /// By an option of `experiments render` that is named after the setting.
    Option,
    /// By `experiments render --set KEY=VALUE`.
    Set,
    /// In a panel of the workbench. The workbench keeps the value in its state file.
    Workbench,
}

/// The data of a [`Setting`] without the type of its owner, for display and for output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Key of the setting.
    pub key: &'static str,
    /// Group of the setting.
    pub group: &'static str,
    /// The value that an owner stores; `None` if [`Setting::row`] was called without an owner, or if the owner does not have the setting.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub value: Option<Value>,
    /// The default value; `None` = a value must be given, unless `about` states an exception.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub default: Option<Value>,
    /// Description of the accepted values.
    pub accepts: String,
    /// Ends of the range of accepted numbers; the lower end may itself be refused. `None` if the accepted values are not a range.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub range: Option<[f64; 2]>,
    /// Unit of the value; empty = none.
    pub unit: &'static str,
    /// Description of the setting.
    pub about: &'static str,
    /// Where the setting can be set.
    #[serde(skip)]
    pub places: Vec<String>,
}

impl<T> Setting<T> {
    /// Name of this setting as an option of `experiments render`, without dashes in front: `lod-bias`. The option exists if the setting has
    /// [`Home::Option`].
    pub fn option(&self) -> String {
        self.name().replace('_', "-")
    }

    /// Whether the setting can be set in `home`.
    pub fn has_home(&self, home: Home) -> bool {
        self.listing.homes.contains(&home) || home == Home::Workbench && self.listing.label.is_some()
    }

    /// The setting as a row, with its value in `owner`, if an owner is given.
    pub fn row(&self, owner: Option<&T>) -> Row {
        let mut places: Vec<String> = self
            .listing
            .homes
            .iter()
            .filter(|home| **home != Home::Workbench)
            .map(|home| match home {
                Home::SceneFile => "scene file".to_owned(),
                Home::Definition => "definition".to_owned(),
                Home::DefinitionList(list) => format!("definition (`{list}`)"),
                Home::Option => format!("`render --{}`", self.option()),
                Home::Set => "`render --set`".to_owned(),
                Home::Workbench => String::new(),
            })
            .collect();
        if self.has_home(Home::Workbench) {
            places.push("workbench".to_owned());
        }
        Row {
            key: self.key,
            group: self.listing.group,
            value: owner.and_then(|owner| self.get(owner)),
            default: (self.default)(),
            accepts: self.kind.to_string(),
            range: match self.kind {
                Kind::Number(range) | Kind::Numbers(_, range) => Some([range.least, range.most]),
                Kind::Whole(least, most) => Some([least, most].map(f64::from)),
                Kind::OneOf(_) | Kind::Flag | Kind::Name(_) | Kind::Text(_) => None,
            },
            unit: self.unit,
            about: self.about,
            places,
        }
    }
}

/// The rows by group, in the order in which the groups first appear.
fn by_group(rows: &[Row]) -> Vec<(&'static str, Vec<&Row>)> {
    let mut groups: Vec<(&'static str, Vec<&Row>)> = Vec::new();
    for row in rows {
        match groups.iter_mut().find(|(group, _)| *group == row.group) {
            Some((_, members)) => members.push(row),
            None => groups.push((row.group, vec![row])),
        }
    }
    groups
}

/// Lists values as a table in plain text, each with its unit, default and accepted values.
pub fn values(rows: &[Row]) -> String {
    let mut text = String::new();
    for (group, rows) in by_group(rows) {
        let _ = writeln!(text, "  {group}");
        for row in rows {
            let value = row.value.as_ref().map_or_else(|| "none".to_owned(), shown);
            let default = row.default.as_ref().map_or_else(|| "no default".to_owned(), |value| format!("default {}", shown(value)));
            let _ = writeln!(text, "    {:<28} {value:>18} {:<6} {default}; {}", row.key, row.unit, row.accepts);
        }
    }
    text
}

/// The text of `docs/settings.md`.
pub fn reference(rows: &[Row]) -> String {
    let mut text = INTRODUCTION.to_owned();
    let cell = |text: &str| text.replace('|', "\\|");
    for (group, rows) in by_group(rows) {
        let _ = write!(
            text,
            "\n## {group}\n\n| key | unit | accepted values | default | where | description |\n| --- | --- | --- | --- | --- | --- |\n"
        );
        for row in rows {
            let default = row.default.as_ref().map_or_else(|| "none".to_owned(), |value| format!("`{}`", shown(value)));
            let (accepts, about) = (cell(&row.accepts), cell(row.about));
            let _ = writeln!(text, "| `{}` | {} | {accepts} | {default} | {} | {about} |", row.key, row.unit, row.places.join(", "));
        }
    }
    text
}

const INTRODUCTION: &str = "\
# Settings

This file is generated from the tables of settings in the code. Do not edit it: change the tables, then run
`SCREE_RECORD=1 cargo test --release --test scree settings_reference`.

A setting has the same key, accepted values and default wherever it is set:

- **scene file**: under its key. `blend.hash_scale` is the key `hash_scale` in the table `[blend]`.
- **definition** of an experiment: under its key in `[set]`, as `\"blend.hash_scale\" = 2.0`, or as `parameter` in `[vary]`. If the
  column `where` names a list, the definition gives several values in that list instead.
- **render**: `experiments render --set blend.hash_scale=2`, or an option of its own, such as `--lod-bias 1`.
- **workbench**: a control in a panel. The value is kept in the state file. A setting of the frame is kept in `[look]`, under the last part of its
  key. A number of the scene is kept in `[scene.NAME.numbers]`, under its whole key.

A value that is not accepted is refused with the same sentence everywhere, such as \"`frame.lod_bias` is 9, must be -2 to 4\". If the value
comes from the state file, the sentence is a warning, and the value is ignored.

A scene file has more values, in lists: materials, rules, strokes, cameras and paths. `kernels/src/scene/mod.rs` explains them.
";

//! Settings: values that a user chooses. Each setting is declared once, with its key, unit, accepted values, default, description and accessor.
//!
//! A table is an array of [`Setting`]s for one type, which stores the values. There are tables for a scene ([`crate::scene::settings`]), for the
//! choices of a frame and of its stages ([`crate::frame::settings`]), and for the choices of the workbench alone. Scene files, definitions of
//! experiments, the command line, the workbench with its state file, and the reference documentation all use these tables. [`Setting::accept`] makes
//! the sentence that describes a value that is not accepted.

use std::fmt;

use toml::Value;

use crate::base::document::{At, Checked};
use crate::base::names::{did_you_mean, nearest};

mod reference;

pub use reference::{Home, Row, reference, values};

/// The numbers that a setting accepts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Smallest number.
    pub least: f64,
    /// Largest number; it is accepted.
    pub most: f64,
    /// Whether `least` itself is refused.
    above: bool,
}

impl Range {
    /// From `least` to `most`, both accepted.
    pub const fn new(least: f64, most: f64) -> Range {
        Range { least, most, above: false }
    }

    /// From `least`, which is refused, to `most`, which is accepted.
    pub const fn above(least: f64, most: f64) -> Range {
        Range { least, most, above: true }
    }

    /// Whether a number is accepted. NaN is refused.
    pub fn contains(self, value: f64) -> bool {
        (self.least..=self.most).contains(&value) && !(self.above && value <= self.least)
    }
}

impl fmt::Display for Range {
    /// The accepted numbers, as text: `-2 to 4`, `above 0 and at most 1000`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.above { write!(f, "above {} and at most {}", self.least, self.most) } else { write!(f, "{} to {}", self.least, self.most) }
    }
}

/// The values that a setting accepts.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    /// A number.
    Number(Range),
    /// A list of this many numbers, each in this range.
    Numbers(usize, Range),
    /// A whole number in this range; both ends are accepted.
    Whole(u32, u32),
    /// One of these whole numbers.
    OneOf(&'static [u32]),
    /// True or false.
    Flag,
    /// One of these names.
    Name(fn() -> Vec<&'static str>),
    /// A text of several parts. The argument describes the form of the text; the field decides which texts it accepts.
    Text(&'static str),
}

/// Lists items as text: `a, b or c`.
fn alternatives<T: fmt::Display>(items: &[T]) -> String {
    match items {
        [] => String::new(),
        [only] => only.to_string(),
        [first @ .., last] => format!("{} or {last}", first.iter().map(T::to_string).collect::<Vec<_>>().join(", ")),
    }
}

impl fmt::Display for Kind {
    /// The accepted values, as text.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Kind::Number(range) => range.fmt(f),
            Kind::Numbers(count, range) => write!(f, "{count} numbers, each {range}"),
            Kind::Whole(least, most) => write!(f, "a whole number from {least} to {most}"),
            Kind::OneOf(numbers) => f.write_str(&alternatives(numbers)),
            Kind::Flag => f.write_str("true or false"),
            Kind::Name(names) => f.write_str(&alternatives(&names())),
            Kind::Text(what) => f.write_str(what),
        }
    }
}

impl Kind {
    /// Converts a text from the command line to a value. The kind need not accept the result. A text that cannot be parsed is returned as a string
    /// value; so are all texts for [`Kind::Name`] and [`Kind::Text`].
    pub fn read(self, text: &str) -> Value {
        let value = match self {
            Kind::Number(_) => text.parse().ok().map(Value::Float),
            Kind::Whole(..) | Kind::OneOf(_) => text.parse().ok().map(Value::Integer),
            Kind::Flag => text.parse().ok().map(Value::Boolean),
            Kind::Numbers(..) => {
                let numbers: Option<Vec<Value>> = text
                    .trim()
                    .trim_start_matches('[')
                    .trim_end_matches(']')
                    .split(',')
                    .map(|part| part.trim().parse().ok().map(Value::Float))
                    .collect();
                numbers.map(Value::Array)
            }
            Kind::Name(_) | Kind::Text(_) => None,
        };
        value.unwrap_or_else(|| Value::String(text.to_owned()))
    }

    fn accepts(self, value: &Value) -> bool {
        let within = |range: Range, value: &Value| number(value).is_some_and(|number| range.contains(number));
        match self {
            Kind::Number(range) => within(range, value),
            Kind::Numbers(count, range) => {
                value.as_array().is_some_and(|values| values.len() == count && values.iter().all(|v| within(range, v)))
            }
            Kind::Whole(least, most) => value.as_integer().is_some_and(|n| (i64::from(least)..=i64::from(most)).contains(&n)),
            Kind::OneOf(numbers) => value.as_integer().is_some_and(|n| numbers.iter().any(|&known| i64::from(known) == n)),
            Kind::Flag => value.is_bool(),
            Kind::Name(names) => value.as_str().is_some_and(|name| names().contains(&name)),
            Kind::Text(_) => value.is_str(),
        }
    }
}

/// The value as a number, whole or not.
fn number(value: &Value) -> Option<f64> {
    #[allow(clippy::cast_precision_loss, reason = "whole numbers of settings have at most 32 bits")]
    value.as_float().or_else(|| value.as_integer().map(|whole| whole as f64))
}

/// A value as text. Real numbers have the fewest significant digits from which the same number can be read again.
pub fn shown(value: &Value) -> String {
    match value {
        Value::Float(number) => number.to_string(),
        Value::Array(items) => format!("[{}]", items.iter().map(shown).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

/// A stored value that a setting reads and writes.
pub trait Field {
    /// The value in TOML.
    fn value(&self) -> Value;

    /// Stores a value of the setting's [`Kind`].
    ///
    /// # Errors
    /// The value does not fit this type. The error is a hint, which [`Setting::set`] adds to its message; it may be empty.
    fn store(&mut self, value: &Value) -> Result<(), String>;

    /// A mutable reference to the number; `None` if the value is not a single `f64`.
    fn number(&mut self) -> Option<&mut f64> {
        None
    }
}

impl Field for f64 {
    fn value(&self) -> Value {
        Value::Float(*self)
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        *self = number(value).ok_or_else(String::new)?;
        Ok(())
    }

    fn number(&mut self) -> Option<&mut f64> {
        Some(self)
    }
}

impl<const N: usize> Field for [f64; N] {
    fn value(&self) -> Value {
        Value::Array(self.iter().map(|&number| Value::Float(number)).collect())
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        let numbers: Option<Vec<f64>> = value.as_array().and_then(|values| values.iter().map(number).collect());
        *self = numbers.and_then(|numbers| numbers.try_into().ok()).ok_or_else(String::new)?;
        Ok(())
    }
}

impl Field for u32 {
    fn value(&self) -> Value {
        Value::Integer((*self).into())
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        *self = value.as_integer().and_then(|whole| whole.try_into().ok()).ok_or_else(String::new)?;
        Ok(())
    }
}

impl Field for u16 {
    fn value(&self) -> Value {
        Value::Integer((*self).into())
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        *self = value.as_integer().and_then(|whole| whole.try_into().ok()).ok_or_else(String::new)?;
        Ok(())
    }
}

impl Field for bool {
    fn value(&self) -> Value {
        Value::Boolean(*self)
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        *self = value.as_bool().ok_or_else(String::new)?;
        Ok(())
    }
}

/// How a setting is listed: its group, the places where it can be set, and its control in the workbench.
#[derive(Clone, Copy, Debug)]
pub struct Listing {
    /// Group of the setting.
    pub group: &'static str,
    /// Where the setting can be set.
    pub homes: &'static [Home],
    /// The workbench's short label, different for each setting; `None` = the workbench does not show the setting.
    pub label: Option<&'static str>,
    /// Slider of the setting; `None` = the workbench does not use a slider.
    pub slider: Option<Slider>,
}

/// The slider of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Slider {
    /// Smallest and largest number of the slider, within the accepted range. Accepted numbers outside the slider can be typed.
    pub ends: [f64; 2],
    /// Whether the scale of the slider is logarithmic.
    pub logarithmic: bool,
}

impl Listing {
    /// A listing that the workbench does not show.
    pub const fn new(group: &'static str, homes: &'static [Home]) -> Listing {
        Listing { group, homes, label: None, slider: None }
    }

    /// This listing, shown by the workbench under `label`.
    #[must_use]
    pub const fn shown(self, label: &'static str) -> Listing {
        Listing { label: Some(label), ..self }
    }

    /// This listing, shown by the workbench as a slider from `least` to `most`.
    #[must_use]
    pub const fn slider(self, label: &'static str, least: f64, most: f64) -> Listing {
        Listing { slider: Some(Slider { ends: [least, most], logarithmic: false }), ..self.shown(label) }
    }

    /// This listing, shown by the workbench as a logarithmic slider from `least` to `most`.
    #[must_use]
    pub const fn logarithmic(self, label: &'static str, least: f64, most: f64) -> Listing {
        Listing { slider: Some(Slider { ends: [least, most], logarithmic: true }), ..self.shown(label) }
    }
}

/// A setting whose value is stored in a `T`, its owner.
pub struct Setting<T: 'static> {
    /// Key of the setting. For a setting of a scene: its path in the scene file. For a setting of a frame: `frame.` and its name. For a setting of
    /// the workbench alone: `look.` and its name.
    pub key: &'static str,
    /// Unit of the value; empty = none.
    pub unit: &'static str,
    /// The values that the setting accepts.
    pub kind: Kind,
    /// The default value; `None` = a value must be given, unless `about` states an exception.
    pub default: fn() -> Option<Value>,
    /// Description of the setting, in whole sentences.
    pub about: &'static str,
    /// Group of the setting, where it can be set, and how it is shown.
    pub listing: Listing,
    /// Where the value is stored; `None` = this `T` does not have the setting.
    pub field: fn(&T) -> Option<&dyn Field>,
    /// Like `field`, but returns a mutable reference.
    pub field_mut: fn(&mut T) -> Option<&mut dyn Field>,
}

/// A type that holds one part of an owner's settings. The settings of a stage, for example, are a part of the settings of a frame.
pub trait Part: Copy + Default + PartialEq + fmt::Debug + 'static {
    /// The table of these settings, for an owner `O` that stores them as its part `P`.
    fn table<P, O: Holds<P, Part = Self>>() -> &'static [Setting<O>];
}

/// A part that has no settings.
impl Part for () {
    fn table<P, O: Holds<P, Part = ()>>() -> &'static [Setting<O>] {
        &[]
    }
}

/// An owner that stores the settings of a part. The type `P` identifies the part, because an owner may have several.
pub trait Holds<P>: 'static {
    /// The type that holds the settings of the part.
    type Part: Part;

    /// The settings.
    fn part(&self) -> &Self::Part;

    /// A mutable reference to the settings.
    fn part_mut(&mut self) -> &mut Self::Part;
}

/// Declares a type whose fields are settings: the type, its default values, and the table of the settings.
///
/// - `Name of Owner as "prefix" at |owner| place`: a value `owner` of the type `Owner` stores a `Name`, and the expression `place` refers to it. The
///   table is `Name::SETTINGS`. With `parts field: Type`, the type has one more field, which is not a setting.
/// - `Name as "prefix"`: any type can be the owner if it implements [`Holds`]. The table is [`Part::table`].
///
/// Keys begin with `prefix`. A field is declared as `name: type = default, unit, kind, listing;`, after its documentation, which is also the
/// description of the setting.
macro_rules! table {
    (
        $(#[$meta:meta])*
        $Table:ident of $Owner:ty as $prefix:literal at |$owner:ident| $place:expr,
        $(parts $(#[doc = $about_parts:literal])+ $parts:ident: $Parts:ty,)?
        { $($fields:tt)+ }
    ) => {
        $crate::settings::table!(@type [$(#[$meta])*] $Table [$($(#[doc = $about_parts])+ $parts: $Parts)?] { $($fields)+ });

        impl $Table {
            /// The settings in the fields of this type.
            pub const SETTINGS: &[$crate::settings::Setting<$Owner>] =
                $crate::settings::table!(@rows $Table $prefix |$owner| ($place) ($place) { $($fields)+ });
        }
    };
    (
        $(#[$meta:meta])*
        $Table:ident as $prefix:literal, { $($fields:tt)+ }
    ) => {
        $crate::settings::table!(@type [$(#[$meta])*] $Table [] { $($fields)+ });

        impl $crate::settings::Part for $Table {
            fn table<P, O: $crate::settings::Holds<P, Part = Self>>() -> &'static [$crate::settings::Setting<O>] {
                struct Rows<P, O>(std::marker::PhantomData<(P, O)>);
                impl<P, O: $crate::settings::Holds<P, Part = $Table>> Rows<P, O> {
                    const ROWS: &'static [$crate::settings::Setting<O>] =
                        $crate::settings::table!(@rows $Table $prefix |owner| (<O as $crate::settings::Holds<P>>::part(owner)) (<O as $crate::settings::Holds<P>>::part_mut(owner)) { $($fields)+ });
                }
                Rows::<P, O>::ROWS
            }
        }
    };
    (
        @type [$(#[$meta:meta])*] $Table:ident [$($(#[doc = $about_parts:literal])+ $parts:ident: $Parts:ty)?] {
            $(
                $(#[doc = $about:literal])+
                $field:ident: $type:ty = $default:expr, $unit:literal, $kind:expr, $listing:expr;
            )+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Debug, PartialEq)]
        pub struct $Table {
            $(
                $(#[doc = $about])+
                pub $field: $type,
            )+
            $(
                $(#[doc = $about_parts])+
                pub $parts: $Parts,
            )?
        }

        impl Default for $Table {
            fn default() -> Self {
                $Table { $($field: $default,)+ $($parts: Default::default())? }
            }
        }
    };
    (
        @rows $Table:ident $prefix:literal |$owner:ident| ($place:expr) ($place_mut:expr) {
            $(
                $(#[doc = $about:literal])+
                $field:ident: $type:ty = $default:expr, $unit:literal, $kind:expr, $listing:expr;
            )+
        }
    ) => {
        &[
            $(
                $crate::settings::Setting {
                    key: concat!($prefix, ".", stringify!($field)),
                    unit: $unit,
                    kind: $kind,
                    default: || Some($crate::settings::Field::value(&$Table::default().$field)),
                    about: concat!($($about,)+).trim_ascii(),
                    listing: $listing,
                    field: |$owner| Some(&$place.$field),
                    field_mut: |$owner| Some(&mut $place_mut.$field),
                },
            )+
        ]
    };
}

pub(crate) use table;

/// Implements [`Field`] for types whose values have names: `ALL` lists the values, and `name` returns the name of a value.
macro_rules! named {
    ($($Type:ty),+) => {
        $(
            impl $crate::settings::Field for $Type {
                fn value(&self) -> toml::Value {
                    toml::Value::String(self.name().to_owned())
                }

                fn store(&mut self, value: &toml::Value) -> std::result::Result<(), String> {
                    let known = <$Type>::ALL.into_iter().find(|known| value.as_str() == Some(known.name()));
                    *self = known.ok_or_else(String::new)?;
                    Ok(())
                }
            }
        )+
    };
}

pub(crate) use named;

impl<T> Setting<T> {
    /// The last part of the key.
    pub fn name(&self) -> &'static str {
        self.key.rsplit('.').next().unwrap_or(self.key)
    }

    /// Place of the setting in a document.
    pub fn place(&self) -> At {
        self.key.split('.').fold(At::top(), |at, step| at.key(step))
    }

    /// The value that `owner` stores; `None` if `owner` does not have this setting.
    pub fn get(&self, owner: &T) -> Option<Value> {
        (self.field)(owner).map(Field::value)
    }

    /// Label of the setting in the workbench, or its name if the workbench does not show it.
    pub fn label(&self) -> &'static str {
        self.listing.label.unwrap_or_else(|| self.name())
    }

    /// A mutable reference to the number that `owner` stores; `None` if the value is not a single real number.
    pub fn number<'a>(&self, owner: &'a mut T) -> Option<&'a mut f64> {
        (self.field_mut)(owner)?.number()
    }

    /// Stores a value in an owner.
    ///
    /// # Errors
    /// The value is not accepted, or the owner does not have this setting. The owner then does not change. The error is one sentence. For a value
    /// that is not accepted, it names the key, the value, and what the value must be.
    pub fn set(&self, owner: &mut T, value: &Value) -> Result<(), String> {
        self.accept(value)?;
        match (self.field_mut)(owner) {
            Some(field) => field.store(value).map_err(|hint| self.refusal(value, &hint)),
            None => Err(format!("`{}` does not apply to this kind of world: leave it out", self.key)),
        }
    }

    /// Checks a value against the kind of the setting, without storing it. [`Setting::set`] also makes the checks that depend on the field's type.
    ///
    /// # Errors
    /// The kind does not accept the value. The error is the sentence that [`Setting::set`] returns for such a value.
    pub fn accept(&self, value: &Value) -> Result<(), String> {
        if self.kind.accepts(value) {
            return Ok(());
        }
        let hint = match (self.kind, value) {
            // The sentence already lists all names, so the hint gives only the nearest one.
            (Kind::Name(names), Value::String(name)) => nearest(name, &names()).map_or_else(String::new, did_you_mean),
            _ => String::new(),
        };
        Err(self.refusal(value, &hint))
    }

    /// The sentence that describes a value that is not accepted.
    fn refusal(&self, value: &Value, hint: &str) -> String {
        let colon = if hint.is_empty() { "" } else { ": " };
        format!("`{}` is {}, must be {}{colon}{hint}", self.key, shown(value), self.kind)
    }
}

/// Checks the values of an owner by [`Setting::accept`]. Settings that the owner does not have are skipped.
///
/// # Errors
/// A value is not accepted. The error describes the first such value in the order of the table.
pub fn check<T: 'static>(mut table: impl Iterator<Item = &'static Setting<T>>, owner: &T) -> Checked {
    let wrong = |setting: &'static Setting<T>| {
        let value = setting.get(owner)?;
        setting.accept(&value).err().map(|what| setting.place().sentence(what))
    };
    table.find_map(wrong).map_or(Ok(()), Err)
}

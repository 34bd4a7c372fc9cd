//! A row of the tables `metrics` and `times`: one measured number, with the columns that identify it.

use std::cmp::Ordering;

use serde::{Deserialize, Serialize};

/// A measured number of a run. Each row contains one value. A column that does not apply to the row is empty (text) or absent (number).
///
/// The fields have the order of the columns ([`COLUMNS`]). [`Row::order`] compares rows by the columns in this order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Row {
    /// Name of the definition.
    pub experiment: String,
    /// Name of the scene.
    pub scene: String,
    /// Name of the view: a camera, a path, or a camera with a motion.
    pub view: String,
    /// The variant. `auto` = the variant of each tile is chosen automatically. `generic` = the same, but the generic kernel shades all tiles. Any
    /// other name is a variant that is forced on every tile, such as `vt+near-cliff`, or `generic-vt` with the generic kernel. `reference` in rows
    /// about the reference.
    pub variant: String,
    /// Estimator of the stochastic flavours, such as `fc5`.
    pub estimator: String,
    /// Noise of the stochastic flavours, such as `hashed`.
    pub noise: String,
    /// Temporal resolve, such as `off`.
    pub temporal: String,
    /// The quantity that was measured: `albedo`, or `lit` for the lit picture as a screen shows it; empty = the metric does not depend on a signal.
    pub signal: String,
    /// The parameter that the definition varies, such as `blend.hash_scale`; empty = none.
    pub parameter: String,
    /// Value of the varied parameter, as text; empty = none.
    pub setting: String,
    /// Frame index, from 0; absent = the value applies to all frames together.
    pub frame: Option<u32>,
    /// Number of frames from the earlier to the later of two compared frames, k = 1..4; absent = the metric is not measured for each lag.
    pub lag: Option<u32>,
    /// Centre of a frequency band of a spectrum, cycles per pixel; absent = the metric is not a spectrum.
    pub frequency: Option<f64>,
    /// Name of the metric, as METHODOLOGY defines it.
    pub metric: String,
    /// Unit of the value.
    pub unit: String,
    /// The measured number.
    pub value: f64,
    /// Standard error of the value, in the unit of the value; absent = it is unknown or does not exist.
    pub standard_error: Option<f64>,
    /// Degrees of freedom of the standard error; absent = they are unknown or do not exist.
    pub freedom: Option<f64>,
}

/// The type of a column, with the functions that read and write it.
#[derive(Clone, Copy, Debug)]
pub enum Field {
    /// A text; empty = the column does not apply to the row.
    Text(fn(&Row) -> &str, fn(&mut Row) -> &mut String),
    /// A whole number; absent = the column does not apply to the row.
    Count(fn(&Row) -> Option<u32>, fn(&mut Row) -> &mut Option<u32>),
    /// A number; absent = the column does not apply to the row, or the number is not known.
    Number(fn(&Row) -> Option<f64>, fn(&mut Row) -> &mut Option<f64>),
    /// A number; NaN if the metric has no value.
    Value(fn(&Row) -> f64, fn(&mut Row) -> &mut f64),
}

/// A column of the tables.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    /// Name of the column.
    pub name: &'static str,
    /// Meaning and unit of the column.
    pub meaning: &'static str,
    /// Type of the column, with its accessors.
    pub field: Field,
}

const fn column(name: &'static str, meaning: &'static str, field: Field) -> Column {
    Column { name, meaning, field }
}

/// The columns of `metrics` and `times`, in their order.
pub const COLUMNS: [Column; 18] = [
    column("experiment", "name of the definition", Field::Text(|r| &r.experiment, |r| &mut r.experiment)),
    column("scene", "name of the scene", Field::Text(|r| &r.scene, |r| &mut r.scene)),
    column("view", "name of the camera, path, or camera with a motion", Field::Text(|r| &r.view, |r| &mut r.view)),
    column("variant", "`auto`, `generic`, or the variant forced on every tile", Field::Text(|r| &r.variant, |r| &mut r.variant)),
    column("estimator", "estimator of the stochastic flavours; empty = none", Field::Text(|r| &r.estimator, |r| &mut r.estimator)),
    column("noise", "noise of the stochastic flavours; empty = none", Field::Text(|r| &r.noise, |r| &mut r.noise)),
    column("temporal", "temporal resolve; empty = none", Field::Text(|r| &r.temporal, |r| &mut r.temporal)),
    column(
        "signal",
        "`albedo`, or `lit` for the lit picture; empty = the metric has no signal",
        Field::Text(|r| &r.signal, |r| &mut r.signal),
    ),
    column("parameter", "parameter that the definition varies; empty = none", Field::Text(|r| &r.parameter, |r| &mut r.parameter)),
    column("setting", "the parameter's value, as text; empty = none", Field::Text(|r| &r.setting, |r| &mut r.setting)),
    column("frame", "frame index, from 0; absent = value over all frames", Field::Count(|r| r.frame, |r| &mut r.frame)),
    column(
        "lag",
        "number of frames from the earlier to the later of the two compared frames, 1 to 4; absent = the metric is not measured for each lag",
        Field::Count(|r| r.lag, |r| &mut r.lag),
    ),
    column(
        "frequency",
        "centre of a frequency band of a spectrum, cycles per pixel; absent = not a spectrum",
        Field::Number(|r| r.frequency, |r| &mut r.frequency),
    ),
    column("metric", "name of the metric", Field::Text(|r| &r.metric, |r| &mut r.metric)),
    column("unit", "unit of value and standard error", Field::Text(|r| &r.unit, |r| &mut r.unit)),
    column("value", "the number; NaN if the metric has no value", Field::Value(|r| r.value, |r| &mut r.value)),
    column(
        "standard_error",
        "standard error of the value, in the unit of the value; absent = unknown or not applicable",
        Field::Number(|r| r.standard_error, |r| &mut r.standard_error),
    ),
    column(
        "freedom",
        "degrees of freedom of the standard error; absent = unknown or not applicable",
        Field::Number(|r| r.freedom, |r| &mut r.freedom),
    ),
];

impl Row {
    /// Returns the column with this name.
    pub fn column(name: &str) -> Option<&'static Column> {
        COLUMNS.iter().find(|column| column.name == name)
    }

    /// Compares two rows column by column, from left to right. Absent numbers come before numbers that are present. The order is total, even if
    /// numbers are NaN.
    pub fn order(&self, other: &Row) -> Ordering {
        let number = |a: Option<f64>, b: Option<f64>| match (a, b) {
            (Some(a), Some(b)) => a.total_cmp(&b),
            (a, b) => a.is_some().cmp(&b.is_some()),
        };
        COLUMNS
            .iter()
            .map(|column| match column.field {
                Field::Text(get, _) => get(self).cmp(get(other)),
                Field::Count(get, _) => get(self).cmp(&get(other)),
                Field::Number(get, _) => number(get(self), get(other)),
                Field::Value(get, _) => get(self).total_cmp(&get(other)),
            })
            .find(|order| order.is_ne())
            .unwrap_or(Ordering::Equal)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_the_fields_in_their_order() {
        let mut writer = csv::Writer::from_writer(Vec::new());
        writer.serialize(Row::default()).unwrap();
        let text = String::from_utf8(writer.into_inner().unwrap()).unwrap();
        let header: Vec<&str> = text.lines().next().unwrap().split(',').collect();
        assert_eq!(header, COLUMNS.map(|column| column.name));
        // Each accessor must access the field with the name of its column: a value that is set through one column must appear in this column of the
        // file and in no other.
        for (i, column) in COLUMNS.iter().enumerate() {
            let mut row = Row::default();
            match column.field {
                Field::Text(get, set) => {
                    *set(&mut row) = "7".to_owned();
                    assert_eq!(get(&row), "7");
                }
                Field::Count(get, set) => {
                    *set(&mut row) = Some(7);
                    assert_eq!(get(&row), Some(7));
                }
                Field::Number(get, set) => {
                    *set(&mut row) = Some(7.0);
                    assert_eq!(get(&row), Some(7.0));
                }
                Field::Value(get, set) => {
                    *set(&mut row) = 7.0;
                    assert_eq!(get(&row), 7.0);
                }
            }
            let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
            writer.serialize(&row).unwrap();
            let text = String::from_utf8(writer.into_inner().unwrap()).unwrap();
            let set: Vec<usize> =
                text.trim_end().split(',').enumerate().filter(|(_, cell)| cell.starts_with('7')).map(|(at, _)| at).collect();
            assert_eq!(set, [i], "{}: {text}", column.name);
            assert!(Row::default().order(&row).is_lt() && row.order(&Row::default()).is_gt() && row.order(&row).is_eq(), "{}", column.name);
        }
    }

    #[test]
    fn order_is_total_with_nan_and_absent_numbers() {
        let value = |value| Row { value, ..Row::default() };
        assert!(value(1.0).order(&value(f64::NAN)).is_lt() && value(f64::NAN).order(&value(f64::NAN)).is_eq());
        let lag = |lag| Row { lag, ..Row::default() };
        assert!(lag(None).order(&lag(Some(1))).is_lt() && lag(Some(2)).order(&lag(Some(10))).is_lt());
    }
}

//! The table of extreme values with which the lab tests kernels. It is read from a TOML file.

use anyhow::{Result, anyhow, bail, ensure};
use kernels::base::document;
use kernels::base::names::suggestion;
use kernels::probe::{PROBES, Probe};
use serde::{Deserialize, Serialize};

/// The built-in table.
pub const DEFAULT_TEXT: &str = include_str!("extremes.toml");

/// Default number of rows for each value of a parameter.
const ROWS: u32 = 1024;
/// Limit of the number of rows for each value of a parameter.
const MOST_ROWS: u32 = 1 << 20;
/// Limit of the number of rows of a case, summed over its values. For the kernel with the most columns, this number of rows takes some gigabytes of
/// memory.
const MOST_OF_CASE: u64 = 1 << 24;

/// The whole table of extremes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Extremes {
    /// Named lists of values.
    #[serde(default, rename = "axis")]
    pub axes: Vec<Axis>,
    /// The tests of kernels.
    #[serde(rename = "case")]
    pub cases: Vec<Case>,
    /// Descriptions of the arguments for which kernels deviate from their formulas, each with the cost of the deviation.
    #[serde(default, rename = "bend")]
    pub bends: Vec<Bend>,
}

/// The description of a deviation of a kernel from its formula. Such a deviation is a clamp or a fallback.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bend {
    /// Name of the probe, which evaluates the kernel for rows of inputs.
    pub kernel: String,
    /// The arguments for which the kernel deviates.
    pub when: String,
    /// The result for these arguments.
    pub then: String,
    /// The cost of the deviation in a unit that is relevant to users.
    pub price: String,
}

/// A named list of values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// The name by which cases refer to the axis.
    pub name: String,
    /// First and last value, both above 0. The values are evenly spaced on a logarithmic scale. If the spacing does not fit the range, the last value
    /// is approximate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub log: Option<[f64; 2]>,
    /// Number of values of `log` per decade; absent = 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub per_decade: Option<u32>,
    /// First and last exponent of powers of two. Each power is tested together with its two neighbours in f32.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub powers_of_two: Option<[i32; 2]>,
    /// Additional values of the axis.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub also: Vec<f64>,
}

/// A test of a kernel with extreme values of one parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Case {
    /// Name of the probe, which evaluates the kernel for rows of inputs.
    pub kernel: String,
    /// Name of the parameter.
    pub parameter: String,
    /// Values of the parameter. They are tested in addition to the values of `axis`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub values: Vec<f64>,
    /// Name of the axis whose values the parameter takes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub axis: Option<String>,
    /// Number of rows for each value; absent = 1024. The other inputs of a row are random.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rows: Option<u32>,
    /// Largest accepted error, in the unit of the kernel's first measure. It applies in addition to the derived tolerance. Absent = only the derived
    /// tolerance applies.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub allow: Option<f64>,
    /// Whether results must only be finite. They are then not compared with the reference. This is intended for values outside the range for which
    /// the kernel is made.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub only_finite: bool,
    /// Explanation of the choice of values.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub why: String,
}

fn probe(kernel: &str) -> Result<&'static Probe> {
    PROBES.iter().find(|probe| probe.name == kernel).ok_or_else(|| {
        let names: Vec<&str> = PROBES.iter().map(|probe| probe.name).collect();
        anyhow!("no kernel is called `{kernel}`: {}", suggestion(kernel, &names))
    })
}

impl Case {
    /// Returns the probe of the case.
    ///
    /// # Errors
    /// No probe has this name.
    pub fn probe(&self) -> Result<&'static Probe> {
        probe(&self.kernel)
    }

    /// Returns the number of rows for each value.
    pub fn rows(&self) -> u32 {
        self.rows.unwrap_or(ROWS)
    }
}

impl Axis {
    /// Returns the values of the axis in ascending order. NaN comes last.
    pub fn values(&self) -> Vec<f64> {
        let mut values = self.also.clone();
        if let Some([low, high]) = self.log {
            let per_decade = f64::from(self.per_decade.unwrap_or(1));
            let steps = ((high.log10() - low.log10()) * per_decade).round() as i32;
            values.extend((0..=steps).map(|i| low * 10.0_f64.powf(f64::from(i) / per_decade)));
        }
        if let Some([low, high]) = self.powers_of_two {
            values.extend((low..=high).flat_map(|exponent| {
                let power = 2.0_f32.powi(exponent);
                [power.next_down(), power, power.next_up()].map(f64::from)
            }));
        }
        values.sort_by(f64::total_cmp);
        values.dedup_by(|a, b| a == b);
        values
    }
}

impl Extremes {
    /// Reads a table from `text`. `name` is the name of the text in error messages.
    ///
    /// # Errors
    /// The message is one line that contains the place and the remedy. Possible causes are: invalid TOML, an unknown key, kernel, parameter or axis,
    /// and an invalid number.
    pub fn parse(text: &str, name: &str) -> Result<Extremes> {
        let read: Extremes = document::read(text, |_| "").map_err(|wrong| anyhow!("{}: {}", wrong.place(name), wrong.what))?;
        for axis in &read.axes {
            let is_range = |[low, high]: [f64; 2]| low >= 1e-45 && high > low && high <= f64::from(f32::MAX);
            ensure!(
                axis.log.is_none_or(is_range),
                "{name}: axis `{}`: `log` takes two numbers above 0 that f32 can represent, the smaller one first",
                axis.name
            );
            ensure!(axis.per_decade.is_none_or(|n| (1..=100).contains(&n)), "{name}: axis `{}`: `per_decade` must be 1 to 100", axis.name);
            let is_exponents = |[low, high]: [i32; 2]| (-126..=127).contains(&low) && (low..=127).contains(&high);
            let exponents = axis.powers_of_two.is_none_or(is_exponents);
            ensure!(exponents, "{name}: axis `{}`: `powers_of_two` takes two exponents of -126 to 127, the smaller one first", axis.name);
        }
        for (case, number) in read.cases.iter().zip(1..) {
            let place = format!("{name}: case {number}");
            let probe = case.probe().map_err(|error| anyhow!("{place}: {error}"))?;
            let names: Vec<&str> = probe.parameter_names().collect();
            ensure!(
                names.contains(&case.parameter.as_str()),
                "{place}: `{}` has no parameter `{}`: {}",
                probe.name,
                case.parameter,
                suggestion(&case.parameter, &names)
            );
            ensure!((1..=MOST_ROWS).contains(&case.rows()), "{place}: `rows` must be 1 to {MOST_ROWS}");
            let values = read.values(case).map_err(|error| anyhow!("{place}: {error}"))?;
            if let Some(axis) = case.axis.as_ref().filter(|_| values.is_empty()) {
                bail!("{place}: axis `{axis}` has no values: give it `log`, `powers_of_two` or `also`");
            }
            ensure!(!values.is_empty(), "{place}: give `values`, or the name of an `axis`");
            let rows = values.len() as u64 * u64::from(case.rows());
            ensure!(
                rows <= MOST_OF_CASE,
                "{place}: {} values with {} rows each make more than {MOST_OF_CASE} rows in total: give fewer values, or reduce `rows`",
                values.len(),
                case.rows()
            );
            if let Some(column) = probe.inputs.iter().find(|column| column.name == case.parameter) {
                for value in values {
                    column.accepts(value).map_err(|what| anyhow!("{place}: {what}"))?;
                }
            }
        }
        for (bend, number) in read.bends.iter().zip(1..) {
            probe(&bend.kernel).map_err(|error| anyhow!("{name}: bend {number}: {error}"))?;
        }
        Ok(read)
    }

    /// Returns the values of a case.
    ///
    /// # Errors
    /// The case names an axis that does not exist.
    pub fn values(&self, case: &Case) -> Result<Vec<f64>> {
        let Some(wanted) = &case.axis else { return Ok(case.values.clone()) };
        let names: Vec<&str> = self.axes.iter().map(|axis| axis.name.as_str()).collect();
        let axis = self.axes.iter().find(|axis| axis.name == *wanted);
        let axis = axis.ok_or_else(|| anyhow!("there is no axis `{wanted}`: {}", suggestion(wanted, &names)))?;
        Ok([case.values.clone(), axis.values()].concat())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_are_in_order_and_have_the_neighbours_of_powers() {
        let axis = Axis {
            name: "a".to_owned(),
            log: Some([1e-2, 1e1]),
            per_decade: Some(2),
            powers_of_two: Some([0, 1]),
            also: vec![0.0, f64::NAN],
        };
        let values = axis.values();
        assert_eq!(values.len(), 7 + 6 + 2 - 1, "the value 1 is in `log` and in `powers_of_two` and counts once: {values:?}");
        assert!(
            values[0] == 0.0 && values[values.len() - 1].is_nan() && values.windows(2).all(|pair| pair[0] < pair[1] || pair[1].is_nan())
        );
        assert!(values.contains(&f64::from(2.0_f32.next_down())) && values.iter().any(|v| (v - 10.0).abs() < 1e-9));
    }

    #[test]
    fn what_cannot_be_asked_is_refused_in_one_line() {
        Extremes::parse(DEFAULT_TEXT, "extremes.toml").expect("the built-in table");
        let case = |more: &str| format!("[[case]]\nkernel = \"octahedral\"\nparameter = \"length\"\n{more}");
        for (text, says) in [
            (case(""), "give `values`"),
            (case("axis = \"metres\""), "no axis `metres`"),
            (case("values = [1]\nrows = 0"), "`rows` must be 1"),
            (case("valus = [1]"), "did you mean `values`"),
            (case("values = [1]").replace("octahedral", "octahedron"), "did you mean `octahedral`"),
            (case("values = [1]").replace("length", "lenght"), "did you mean `length`"),
            ("[[case]]\nkernel = \"weld\"\nparameter = \"x\"\nvalues = [129]".to_owned(), "whole numbers from 0 to 128"),
            (case("values = [1]") + "\n[[axis]]\nname = \"a\"\nlog = [0, 1]", "above 0"),
            (case("values = [1]") + "\n[[axis]]\nname = \"a\"\npowers_of_two = [3, 2]", "two exponents"),
            (case("axis = \"a\"") + "\n[[axis]]\nname = \"a\"\nlog = [1e-300, 1e300]", "that f32 can represent"),
            (case("axis = \"a\"\nrows = 1048576") + "\n[[axis]]\nname = \"a\"\nlog = [1e-30, 1e30]", "give fewer"),
            (case("axis = \"a\"") + "\n[[axis]]\nname = \"a\"", "axis `a` has no values"),
            ("case = 3".to_owned(), "case"),
            (case("values = [1]") + "\n[[bend]]\nkernel = \"weldd\"\nwhen = \"\"\nthen = \"\"\nprice = \"\"", "did you mean `weld`"),
        ] {
            let error = Extremes::parse(&text, "x.toml").expect_err(&text).to_string();
            assert!(error.contains(says) && error.starts_with("x.toml") && !error.contains('\n'), "{text}: {error}");
        }
    }
}

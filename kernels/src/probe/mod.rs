//! Evaluates shared functions for tables: each row of input numbers gives a row of results, computed on the GPU or by the reference in f32 or f64.
//!
//! The command line and the agreement tests share the list [`PROBES`], so that both evaluate the same functions. The GPU and both references take the
//! same columns. The results of the reference in f64 are the truth. The reference in f32 shows how large errors from rounding alone are, so the error
//! of the shader is compared with its error. Real numbers are rounded to f32 for the f32 reference and the GPU, so comparisons should use numbers
//! that f32 represents exactly.

use serde::Serialize;

use crate::base::error::{Error, Result};
use crate::base::names::suggestion;
use crate::gpu::Gpu;
use crate::probe::table::Cells;
use crate::shared::blue_noise::{RANKS, SLICES};
use crate::shared::real::Real;

mod blocks;
mod culling;
mod directions;
mod frames;
mod geometry;
mod judge;
mod light;
mod noise;
pub mod table;
mod tilings;
mod weights;
mod words;

pub use judge::{Draw, EPS, FEW, UNIT_TOLERANCE, Verdict, both, close, equal};

/// Largest magnitude of whole numbers that are passed as f32. Up to this magnitude, f32 represents every whole number exactly.
const EXACT: i32 = 1 << 24;

/// Largest index into [`crate::shared::blue_noise::ranks`].
const MASK_PLACES: i32 = (RANKS * (1 + SLICES)).cast_signed() - 1;

/// A column of a probe's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Name in the table's header.
    pub name: &'static str,
    /// Unit of the numbers, or their meaning.
    pub unit: &'static str,
    /// Smallest and largest value of a column of whole numbers; `None` = every number is accepted.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub whole: Option<[i64; 2]>,
}

impl Column {
    const fn real(name: &'static str, unit: &'static str) -> Column {
        Column { name, unit, whole: None }
    }

    const fn whole(name: &'static str, unit: &'static str, low: i32, high: i32) -> Column {
        Column { name, unit, whole: Some([low as i64, high as i64]) }
    }

    const fn word(name: &'static str, unit: &'static str) -> Column {
        Column { name, unit, whole: Some([0, u32::MAX as i64]) }
    }

    /// Whether the column contains words of 32 bits. An f32 cannot represent the value of every word, so words are passed as bits.
    pub fn is_word(&self) -> bool {
        self.whole == Some([0, i64::from(u32::MAX)])
    }

    /// Checks whether the column accepts a value.
    ///
    /// # Errors
    /// A message that says which values the column accepts.
    pub fn accepts(&self, value: f64) -> std::result::Result<(), String> {
        match self.whole {
            Some([low, high]) if value.fract() != 0.0 || !(low as f64..=high as f64).contains(&value) => {
                Err(format!("`{}` takes whole numbers from {low} to {high}, not {value}", self.name))
            }
            _ => Ok(()),
        }
    }
}

type Reference<T> = fn(&[T], &mut Vec<T>);

/// The number type of the cells that a reference reads and writes. A cell is a real number or a word (an integer of 32 bits). For a word, an f32 cell
/// holds the bits of the word, and an f64 cell holds its value.
trait Cell: Real {
    fn word(self) -> u32;
    fn of_word(word: u32) -> Self;
}

impl Cell for f32 {
    fn word(self) -> u32 {
        self.to_bits()
    }
    fn of_word(word: u32) -> f32 {
        f32::from_bits(word)
    }
}

impl Cell for f64 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "Column::accepts keeps these columns whole and in range")]
    fn word(self) -> u32 {
        self as u32
    }
    fn of_word(word: u32) -> f64 {
        f64::from(word)
    }
}

fn cells<T: Cell>(columns: &[Column], rows: &[f64]) -> Vec<T> {
    rows.iter().zip(columns.iter().cycle()).map(|(&x, column)| if column.is_word() { T::of_word(x.word()) } else { T::of(x) }).collect()
}

fn numbers<T: Cell>(columns: &[Column], cells: &[T]) -> Vec<f64> {
    let number = |(x, column): (&T, &Column)| if column.is_word() { f64::from(x.word()) } else { Real::to_f64(*x) };
    cells.iter().zip(columns.iter().cycle()).map(number).collect()
}

/// A shared function that is evaluated for the rows of a table.
pub struct Probe {
    /// The name used on the command line.
    pub name: &'static str,
    /// Description in one sentence.
    pub about: &'static str,
    /// Input columns.
    pub inputs: &'static [Column],
    /// Output columns.
    pub outputs: &'static [Column],
    /// WGSL that defines the function `probe`, which calls the shared functions. [`Probe::layout`] gives the types of its argument and of its result.
    pub wgsl: &'static str,
    /// Format of a block-compressed texture, if the first words of each row are a block that the device decodes; `None` = the rows have no
    /// blocks.
    blocks: Option<wgpu::TextureFormat>,
    single: Reference<f32>,
    double: Reference<f64>,
    /// Draws a random row of inputs.
    pub random: fn(&mut Draw) -> Vec<f64>,
    /// Compares a result with the truth. The arguments are the input row, the result, and the truth, which is the result of the f64 reference.
    pub judge: Judge,
    /// Measures of the error of a result, in units that are meaningful to users.
    pub measures: &'static [Measure],
    /// Parameters that [`Probe::row`] can set, in addition to the columns.
    pub parameters: &'static [Parameter],
}

/// Compares a result with the truth. The arguments are the input row, the result, and the truth, which is the result of the f64 reference.
pub type Judge = fn(&[f64], &[f64], &[f64]) -> Verdict;

/// A measure of the error of a result, in a unit that is meaningful to users.
pub struct Measure {
    /// What is compared.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Computes the error from the input row, the result, and the truth.
    pub error: fn(&[f64], &[f64], &[f64]) -> f64,
}

/// A quantity that [`Probe::row`] can set: a common value of several columns, or a value from which columns are computed.
pub struct Parameter {
    /// Name. It must not be the name of a column.
    pub name: &'static str,
    /// Unit of the numbers, or their meaning.
    pub unit: &'static str,
    set: fn(&mut Vec<f64>, f64, &mut Draw),
}

impl std::fmt::Debug for Probe {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Probe").field("name", &self.name).finish_non_exhaustive()
    }
}

impl Probe {
    /// The probe of this name.
    ///
    /// # Errors
    /// No probe has this name; the message suggests a similar name or, if there is none, lists all names.
    pub fn find(name: &str) -> Result<&'static Probe> {
        PROBES.iter().find(|probe| probe.name == name).ok_or_else(|| {
            let names: Vec<&str> = PROBES.iter().map(|probe| probe.name).collect();
            Error::Request(format!("no kernel is called `{name}`: {}", suggestion(name, &names)))
        })
    }

    /// Evaluates the reference in single precision. `rows` holds whole rows of `inputs`, one after the other; real numbers are rounded to f32 first.
    pub fn on_f32(&self, rows: &[f64]) -> Vec<f64> {
        self.evaluate(self.single, rows)
    }

    /// Evaluates the reference in double precision. `rows` holds whole rows of `inputs`, one after the other.
    pub fn on_f64(&self, rows: &[f64]) -> Vec<f64> {
        self.evaluate(self.double, rows)
    }

    /// Evaluates the shader. `rows` holds whole rows of `inputs`, one after the other; real numbers are rounded to f32 first.
    ///
    /// # Errors
    /// The device is lost or refuses the shader.
    pub fn on_gpu(&self, gpu: &Gpu, rows: &[f64]) -> Result<Vec<f64>> {
        self.on_gpu_by(gpu, self.wgsl, rows)
    }

    /// Evaluates `wgsl` instead of the probe's shader.
    ///
    /// # Errors
    /// See [`Probe::on_gpu`].
    pub fn on_gpu_by(&self, gpu: &Gpu, wgsl: &str, rows: &[f64]) -> Result<Vec<f64>> {
        let columns = [self.inputs.len(), self.outputs.len()];
        let table = table::Table::new(gpu, wgsl, columns, self.layout())?;
        let mut all = Vec::with_capacity(rows.len() / columns[0] * columns[1]);
        for part in rows.chunks(table.most_rows() * columns[0]) {
            let bits: Vec<u32> = cells::<f32>(self.inputs, part).into_iter().map(f32::to_bits).collect();
            let results: Vec<f32> = table.run(&bits)?.into_iter().map(f32::from_bits).collect();
            all.extend(numbers(self.outputs, &results));
        }
        Ok(all)
    }

    /// The types that the shader takes and returns: [`Cells::Texel`] if the rows begin with a compressed block, else [`Cells::Bits`] if a column
    /// holds words (integers of 32 bits), else [`Cells::Reals`].
    pub fn layout(&self) -> Cells {
        match self.blocks {
            Some(format) => Cells::Texel(format),
            None if self.inputs.iter().chain(self.outputs).any(Column::is_word) => Cells::Bits,
            None => Cells::Reals,
        }
    }

    /// Rows as the f32 reference and the GPU receive them: reals are rounded to f32.
    pub fn rounded(&self, rows: &[f64]) -> Vec<f64> {
        numbers(self.inputs, &cells::<f32>(self.inputs, rows))
    }

    /// Names of the parameters and columns that [`Probe::row`] can set.
    pub fn parameter_names(&self) -> impl Iterator<Item = &'static str> {
        self.inputs.iter().map(|column| column.name).chain(self.parameters.iter().map(|parameter| parameter.name))
    }

    /// Unit of a parameter or column; `None` if the name is unknown.
    pub fn parameter_unit(&self, name: &str) -> Option<&'static str> {
        let columns = self.inputs.iter().map(|column| (column.name, column.unit));
        columns
            .chain(self.parameters.iter().map(|parameter| (parameter.name, parameter.unit)))
            .find(|(own, _)| *own == name)
            .map(|(_, unit)| unit)
    }

    /// Returns a random row of inputs in which the parameter or column named `parameter` has the value `value`. The row is rounded to f32, so that
    /// the GPU and both references receive the same numbers. `None` if the name is unknown or the column does not accept the value.
    pub fn row(&self, parameter: &str, value: f64, draw: &mut Draw) -> Option<Vec<f64>> {
        let mut row = (self.random)(draw);
        if let Some(found) = self.parameters.iter().find(|known| known.name == parameter) {
            (found.set)(&mut row, value, draw);
        } else {
            let column = self.inputs.iter().position(|column| column.name == parameter)?;
            self.inputs[column].accepts(value).ok()?;
            row[column] = value;
        }
        Some(self.rounded(&row))
    }

    fn evaluate<T: Cell>(&self, reference: Reference<T>, rows: &[f64]) -> Vec<f64> {
        let mut all = Vec::with_capacity(rows.len() / self.inputs.len() * self.outputs.len());
        for row in cells::<T>(self.inputs, rows).chunks_exact(self.inputs.len()) {
            reference(row, &mut all);
        }
        numbers(self.outputs, &all)
    }
}

const fn real(name: &'static str, unit: &'static str) -> Column {
    Column::real(name, unit)
}

const fn whole(name: &'static str, unit: &'static str, low: i32, high: i32) -> Column {
    Column::whole(name, unit, low, high)
}

const fn word(name: &'static str, unit: &'static str) -> Column {
    Column::word(name, unit)
}

/// Every probe.
pub const PROBES: &[Probe] = &[
    words::HASH,
    directions::OCTAHEDRAL,
    directions::OCTAHEDRAL_CODES,
    directions::NORMAL_PAIR,
    noise::HASHED_ALPHA,
    noise::NOISE,
    directions::DERIVATIVES,
    weights::SPLAT_BLEND,
    directions::TRI_PLANAR,
    directions::BIPLANAR,
    directions::SNAPPED_PROJECTION,
    weights::SELECT,
    weights::LAYERS,
    weights::FLAVOUR_WEIGHTS,
    tilings::TILING,
    tilings::HEX_TILING,
    tilings::TEXEL_CHOICE,
    geometry::DEPTH_POSITION,
    geometry::WELD,
    culling::FRUSTUM,
    culling::NORMAL_CONE,
    culling::OCCLUSION,
    blocks::BC1,
    blocks::BC3,
    light::REFLECTION,
    frames::MOMENTS,
    frames::REPROJECTION,
];

/// `N` values of a row, starting at index `at`.
fn take<T: Real, const N: usize>(row: &[T], at: usize) -> [T; N] {
    std::array::from_fn(|i| row[at + i])
}

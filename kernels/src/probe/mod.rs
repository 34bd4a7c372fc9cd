//! Shared functions as tables: rows of numbers in, rows of numbers out, on the GPU or by the reference in f32 or f64.
//!
//! One table serves the command line and the tests of agreement, so that both look at the same thing. f64 is the truth, f32 the
//! yardstick for the shader's error. All three take the same columns; values are rounded to f32 on the way to f32 and GPU, so a
//! comparison should be given values that f32 holds.

use serde::Serialize;

use crate::base::error::{Error, Result};
use crate::base::names::nearest;
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

/// Whole numbers that travel as f32, which holds them exactly up to this magnitude.
const EXACT: i32 = 1 << 24;

/// Last place of [`crate::shared::blue_noise::ranks`].
const MASK_PLACES: i32 = (RANKS * (1 + SLICES)).cast_signed() - 1;

/// A column of a probe's table.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Column {
    /// Name in the table's header.
    pub name: &'static str,
    /// Unit, or what the number means.
    pub unit: &'static str,
    /// Smallest and largest value of a column of whole numbers; absent where any number will do.
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

    /// Whether its numbers are words of 32 bits, of which f32 does not hold all: they travel as they are.
    pub fn is_word(&self) -> bool {
        self.whole == Some([0, i64::from(u32::MAX)])
    }

    /// Whether a value may stand in this column.
    ///
    /// # Errors
    /// Says what the column takes.
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

/// What a reference reads and writes: a real, or a word, which stands in f32 as its bits.
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

/// A shared function as a table.
pub struct Probe {
    /// The name used on the command line.
    pub name: &'static str,
    /// One sentence for people.
    pub about: &'static str,
    /// Columns read.
    pub inputs: &'static [Column],
    /// Columns made.
    pub outputs: &'static [Column],
    /// WGSL that defines `probe` over the shared functions, as [`Probe::layout`] says.
    pub wgsl: &'static str,
    /// Block format of the texture from which a row's first words are decoded, if it has one.
    blocks: Option<wgpu::TextureFormat>,
    single: Reference<f32>,
    double: Reference<f64>,
    /// A random row of inputs.
    pub random: fn(&mut Draw) -> Vec<f64>,
    /// Compares a result with the truth: given row, result, truth.
    pub judge: Judge,
    /// How far a result is off, in units that a person cares about.
    pub measures: &'static [Measure],
    /// Parameters that rows can be made for, besides the columns.
    pub parameters: &'static [Parameter],
}

/// Compares a result with the truth: given row, result, truth.
pub type Judge = fn(&[f64], &[f64], &[f64]) -> Verdict;

/// How far a result is off, in a unit that a person cares about.
pub struct Measure {
    /// What is off.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Given row, result, truth.
    pub error: fn(&[f64], &[f64], &[f64]) -> f64,
}

/// Something that a row can be made to have, be it a column or derived from some.
pub struct Parameter {
    /// Name, unlike that of a column.
    pub name: &'static str,
    /// Unit, or what the number means.
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
    /// There is none: names the nearest.
    pub fn find(name: &str) -> Result<&'static Probe> {
        PROBES.iter().find(|probe| probe.name == name).ok_or_else(|| {
            let names: Vec<&str> = PROBES.iter().map(|probe| probe.name).collect();
            let hint =
                nearest(name, &names).map_or_else(|| format!("there are {}", names.join(", ")), |near| format!("did you mean `{near}`?"));
            Error::Request(format!("no kernel is called `{name}`: {hint}"))
        })
    }

    /// Evaluates the reference in single precision over row-major `rows` (a whole number of rows of `inputs`), rounded to f32.
    pub fn on_f32(&self, rows: &[f64]) -> Vec<f64> {
        self.evaluate(self.single, rows)
    }

    /// Evaluates the reference in double precision over row-major `rows` (a whole number of rows of `inputs`).
    pub fn on_f64(&self, rows: &[f64]) -> Vec<f64> {
        self.evaluate(self.double, rows)
    }

    /// Evaluates the shader over row-major `rows` (a whole number of rows of `inputs`), rounded to f32.
    ///
    /// # Errors
    /// The device is lost or refuses the shader.
    pub fn on_gpu(&self, gpu: &Gpu, rows: &[f64]) -> Result<Vec<f64>> {
        self.on_gpu_by(gpu, self.wgsl, rows)
    }

    /// Evaluates another text in place of the probe's shader.
    ///
    /// # Errors
    /// As [`Probe::on_gpu`].
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

    /// What the shader takes and returns: reals; with a column of words, bits.
    pub fn layout(&self) -> Cells {
        match self.blocks {
            Some(format) => Cells::Texel(format),
            None if self.inputs.iter().chain(self.outputs).any(Column::is_word) => Cells::Bits,
            None => Cells::Reals,
        }
    }

    /// Rows as f32 and GPU see them: reals rounded to f32.
    pub fn rounded(&self, rows: &[f64]) -> Vec<f64> {
        numbers(self.inputs, &cells::<f32>(self.inputs, rows))
    }

    /// Names of what [`Probe::row`] can give a value.
    pub fn parameter_names(&self) -> impl Iterator<Item = &'static str> {
        self.inputs.iter().map(|column| column.name).chain(self.parameters.iter().map(|parameter| parameter.name))
    }

    /// Unit of a parameter, or of a column by its name.
    pub fn parameter_unit(&self, name: &str) -> Option<&'static str> {
        let columns = self.inputs.iter().map(|column| (column.name, column.unit));
        columns
            .chain(self.parameters.iter().map(|parameter| (parameter.name, parameter.unit)))
            .find(|(own, _)| *own == name)
            .map(|(_, unit)| unit)
    }

    /// A random row that has this value of a parameter, or in the column of this name; rounded to f32, as everyone is given it. Absent if there is
    /// none of the name, or if the column does not take the value.
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

/// `N` values of a row from place `at` on.
fn take<T: Real, const N: usize>(row: &[T], at: usize) -> [T; N] {
    std::array::from_fn(|i| row[at + i])
}

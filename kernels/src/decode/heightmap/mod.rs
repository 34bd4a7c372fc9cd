//! Reads heightmaps from files: 16-bit PNG, RAW (16-bit integers or 32-bit floats), OpenEXR and (Geo)TIFF.
//!
//! A sample is the elevation at a grid point. Row 0 is the northern edge, column 0 the western edge. The size is read before the samples, so that a
//! file that is too large is refused before memory is allocated for its samples.
//!
//! The reader of each format returns the samples as they are stored, and what the file says about them (`raster.rs`). Then, in this order:
//! samples without data are found (`voids.rs`), samples become metres (`scaling.rs`), and gaps are filled (`fill.rs`). If a file makes a known
//! statement about its heights that cannot be applied, the result is usually an error of one line, or a note in the [`Report`]. The report says how
//! the file was interpreted.

use std::collections::BTreeSet;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::{Path, PathBuf};

use crate::base::error::{Error, Result, one_line};
use crate::decode::fault::Fault;
use depth::Depth;
use options::Format;
use raster::Raster;
use scaling::{Mapping, Statement};
use voids::Found;

mod channels;
mod depth;
mod fill;
mod gdal;
mod geotiff;
mod lzw;
mod options;
mod png;
mod raster;
mod raw;
mod report;
mod scaling;
mod spacing;
mod systems;
mod tiff;
mod units;
mod voids;

pub use options::{MAX_SIDE, NoData, ReadOptions, Voids};
pub use report::Report;

/// Largest absolute value of an elevation that is accepted, metres.
const MAX_ELEVATION_M: f32 = 100_000.0;

/// If float samples differ by at most this many metres, and neither the file nor the user says how they are scaled, a note says that they may be
/// normalised to 0..1.
const NORMALISED_RELIEF_M: f64 = 1.0;

/// If consecutive half floats at the largest absolute sample differ by more than this many metres, a note says that precision is lost.
const COARSE_STEP_M: f64 = 0.25;

/// XML elements that say what the samples of a heightmap mean. GDAL may write them to a file of metadata beside the heightmap (`.aux.xml`,
/// *PAM: persistent auxiliary metadata*).
const STATEMENTS_BESIDE: [&str; 4] = ["Scale", "Offset", "NoDataValue", "UnitType"];

/// Largest length of a `.aux.xml` file that is searched, bytes.
const LARGEST_METADATA: u64 = 1 << 26;

/// Elevations on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Heightmap {
    /// Samples from west to east, at least 2.
    pub width: u32,
    /// Samples from north to south, at least 2.
    pub height: u32,
    /// Distance between neighbouring samples, metres.
    pub metres_per_texel: f64,
    /// Elevations in metres, row by row, row 0 = north.
    pub samples: Vec<f32>,
}

/// A heightmap, and the report on its file.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// The heightmap. All samples are finite.
    pub map: Heightmap,
    /// How the file was interpreted.
    pub report: Report,
    /// Columns and rows of the samples without data that become holes in the ground; empty unless the options contain [`Voids::Holes`]. In
    /// `map`, these samples are filled, too.
    pub holes: Vec<[u32; 2]>,
}

impl Heightmap {
    /// Width (west to east) and depth (south to north) of the covered area, metres.
    pub fn extent_m(&self) -> [f64; 2] {
        [self.width, self.height].map(|n| f64::from(n - 1) * self.metres_per_texel)
    }

    /// Lowest and highest sample, metres.
    pub fn elevation_range_m(&self) -> (f64, f64) {
        let fold = |(low, high): (f32, f32), &s: &f32| (low.min(s), high.max(s));
        let (low, high) = self.samples.iter().fold((f32::INFINITY, f32::NEG_INFINITY), fold);
        (f64::from(low), f64::from(high))
    }

    /// Elevation (metres) and its derivatives along x (east) and y (north) at a position in metres relative to the centre of the map, by bicubic
    /// Catmull-Rom interpolation (Catmull & Rom 1974). A position outside the map is moved to the nearest point on its edge.
    pub fn sample(&self, x: f64, y: f64) -> (f64, f64, f64) {
        let extent = self.extent_m();
        let place = |v: f64, extent: f64, count: u32| {
            let at = ((v + extent / 2.0) / self.metres_per_texel).clamp(0.0, f64::from(count - 1));
            let cell = at.floor().min(f64::from(count - 2));
            (cell as i64, at - cell)
        };
        let (column, u) = place(x, extent[0], self.width);
        let (row, v) = place(-y, extent[1], self.height);
        let ((wu, du), (wv, dv)) = (catmull_rom(u), catmull_rom(v));
        let (width, last_column, last_row) = (self.width as usize, i64::from(self.width) - 1, i64::from(self.height) - 1);
        let columns: [usize; 4] = std::array::from_fn(|i| (column + i as i64 - 1).clamp(0, last_column) as usize);
        let (mut value, mut dx, mut dy) = (0.0, 0.0, 0.0);
        for j in 0..4 {
            let start = (row + j as i64 - 1).clamp(0, last_row) as usize * width;
            let (mut line, mut slope) = (0.0, 0.0);
            for i in 0..4 {
                let s = f64::from(self.samples[start + columns[i]]);
                line += wu[i] * s;
                slope += du[i] * s;
            }
            value += wv[j] * line;
            dx += wv[j] * slope;
            dy += dv[j] * line;
        }
        (value, dx / self.metres_per_texel, -dy / self.metres_per_texel)
    }

    /// Steepest slope (tangent) of all triangles between neighbouring samples. Both ways to split a square into two triangles are included.
    pub fn max_slope(&self) -> f64 {
        let width = self.width as usize;
        let mut steepest = 0.0f64;
        for rows in self.samples.windows(2 * width).step_by(width) {
            for i in 0..width - 1 {
                let corner = |k: usize| f64::from(rows[k / 2 * width + i + k % 2]);
                let [a, b, c, d] = [corner(0), corner(1), corner(2), corner(3)];
                for (east, north) in [(b - a, c - a), (b - a, d - b), (d - c, c - a), (d - c, d - b)] {
                    steepest = steepest.max(east * east + north * north);
                }
            }
        }
        steepest.sqrt() / self.metres_per_texel
    }
}

/// Returns the weights of four samples at -1, 0, 1, 2 for a point at t in 0..=1, and the derivatives of these weights.
fn catmull_rom(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    (
        [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)],
        [0.5 * (-3.0 * t2 + 4.0 * t - 1.0), 0.5 * (9.0 * t2 - 10.0 * t), 0.5 * (-9.0 * t2 + 8.0 * t + 1.0), 0.5 * (3.0 * t2 - 2.0 * t)],
    )
}

/// Reads a heightmap. The extension of the file determines its format (`png`, `raw`, `r16`, `r32`, `bin`, `exr`, `tif`, `tiff`).
///
/// # Errors
/// [`Error::File`] if the operating system cannot read the file, or metadata beside it.
///
/// [`Error::Heightmap`] in these cases:
/// - There is a mask beside the heightmap (GDAL's `.msk`), or a file of metadata (`.aux.xml`) that says what the samples mean or is too large.
/// - The heightmap is damaged, too large, or of a kind that is not supported.
/// - Its statements about its samples contradict each other or the options, or cannot be applied.
/// - An option is out of range or does not apply to the format.
/// - The spacing or the meaning of the samples is unknown.
/// - Samples have no data or a value that usually marks missing data, and the options do not say how to treat them; or no sample has data.
/// - The absolute value of an elevation is above 100 000 m, or all samples are equal.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Reading> {
    let file = File::open(path).map_err(|source| Error::File { file: path.to_owned(), source })?;
    let mut reading = decode(BufReader::new(file), path, options)?;
    reading.report.notes.extend(note_of_metadata_beside(path)?);
    Ok(reading)
}

/// Returns a note if there is a file with metadata of GDAL beside a heightmap (`.aux.xml`).
///
/// # Errors
/// These metadata say what the samples mean, cannot be read, or have more than [`LARGEST_METADATA`] bytes; or there is a mask (`.msk`).
fn note_of_metadata_beside(path: &Path) -> Result<Option<String>> {
    let beside = |suffix: &str| {
        let mut name = path.as_os_str().to_owned();
        name.push(suffix);
        PathBuf::from(name)
    };
    let name = |file: &Path| file.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    let refused = |what: String| Error::Heightmap { file: path.to_owned(), what: one_line(&what) };
    let mask = beside(".msk");
    if mask.is_file() {
        return Err(refused(format!(
            "the file {} beside it is a mask, which says which samples have no data, but is not read; \
             make one file of both with gdal_translate --config GDAL_TIFF_INTERNAL_MASK YES IN OUT.tif",
            name(&mask)
        )));
    }
    let metadata = beside(".aux.xml");
    if !metadata.is_file() {
        return Ok(None);
    }
    let failed = |source| Error::File { file: metadata.clone(), source };
    let mut text = Vec::new();
    File::open(&metadata).and_then(|file| file.take(LARGEST_METADATA + 1).read_to_end(&mut text)).map_err(failed)?;
    if text.len() as u64 > LARGEST_METADATA {
        return Err(refused(format!(
            "the file {} beside it has more than {LARGEST_METADATA} bytes, too many to see whether it says what the samples mean; \
             make one file of both with gdal_translate IN OUT.tif",
            name(&metadata)
        )));
    }
    let whole = String::from_utf8_lossy(&text);
    let text = gdal::without_comments(&whole).unwrap_or_else(|| whole.into_owned());
    if let Some(element) = STATEMENTS_BESIDE.into_iter().find(|element| text.contains(&format!("<{element}"))) {
        return Err(refused(format!(
            "the file {} beside it says what the samples mean ({element}), but is not read; make one file of both with gdal_translate IN OUT.tif",
            name(&metadata)
        )));
    }
    Ok(Some(one_line(&format!("the file {} beside it is not read", name(&metadata)))))
}

/// Reads a heightmap from the contents of a file. `path` is used in messages, and its extension determines the format, as in [`read`].
///
/// # Errors
/// The same errors as [`read`], except those about files beside the heightmap, which this function does not look for.
pub fn decode(input: impl BufRead + Seek, path: &Path, options: &ReadOptions) -> Result<Reading> {
    understand(input, path, options).map_err(|fault| match fault {
        Fault::Io(source) => Error::File { file: path.to_owned(), source },
        other => Error::Heightmap { file: path.to_owned(), what: one_line(&other.to_string()) },
    })
}

fn understand(input: impl BufRead + Seek, path: &Path, options: &ReadOptions) -> std::result::Result<Reading, Fault> {
    let format = Format::of(path)?;
    options.check(format)?;
    let raster = match format {
        Format::Png => png::read(input, options),
        Format::Raw => raw::read(input, options, Depth::Unsigned16),
        Format::RawFloat => raw::read(input, options, Depth::Single),
        Format::OpenExr => channels::read(input, options),
        Format::Tiff => tiff::read(input, options),
    }?;
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    finish(raster, &name, options)
}

/// Converts stored samples to a heightmap.
fn finish(raster: Raster, name: &str, options: &ReadOptions) -> std::result::Result<Reading, Fault> {
    let found = voids::find(&raster, &options.no_data, options.voids)?;
    let spacing = raster.spacing.resolve(options.metres_per_texel)?;
    let scaled = Scaled::of(&raster, &found, options)?;
    let mut notes = [raster.notes.as_slice(), found.notes.as_slice()].concat();
    notes.extend(spacing.note);
    notes.extend(scaled.mapping.note.clone());
    notes.extend(notes_of_samples(&raster, &found, &scaled, options));
    let fate = if options.voids == Voids::Holes { "holes in the ground" } else { "filled with a membrane" };
    let report = Report {
        file: one_line(&format!("{name}, {}", raster.format)),
        file_size: raster.file_size,
        window: raster.window,
        spacing_m: spacing.metres,
        spacing_from: spacing.from,
        stored: scaled.stored.map(|sample| raster.stored.shown(sample)),
        elevations_m: scaled.elevations_m,
        mapping: scaled.mapping.how,
        orientation: raster.orientation.to_owned(),
        void_count: found.count,
        voids: if found.count == 0 { "no sample".to_owned() } else { format!("{fate}: {}", found.words) },
        notes: notes.iter().map(|note| one_line(note)).collect(),
    };
    let [_, _, width, height] = raster.window;
    let mut samples = raster.stored.scaled(scaled.mapping.scale, scaled.mapping.offset);
    let mut holes = Vec::new();
    if found.count > 0 {
        fill::fill(&mut samples, &found.mask, width as usize);
        if options.voids == Voids::Holes {
            let without_data = (0..samples.len()).filter(|&index| !found.has_data(index));
            holes.extend(without_data.map(|index| [index as u32 % width, index as u32 / width]));
        }
    }
    Ok(Reading { map: Heightmap { width, height, metres_per_texel: spacing.metres, samples }, report, holes })
}

/// The conversion of the samples to metres, and their range before and after it.
struct Scaled {
    /// The lowest and the highest sample with data.
    stored: [f64; 2],
    mapping: Mapping,
    /// The lowest and the highest elevation, metres.
    elevations_m: [f64; 2],
}

impl Scaled {
    /// Finds the conversion from stored samples to metres. Refuses elevations beyond 100 000 m, and a map without relief, because both probably mean
    /// that the samples were misinterpreted.
    fn of(raster: &Raster, found: &Found, options: &ReadOptions) -> std::result::Result<Scaled, Fault> {
        let with_data = move || (0..raster.stored.len()).filter(move |&index| found.has_data(index));
        let stored = range(with_data().map(|index| raster.stored.at(index)));
        let mapping = scaling::mapping(raster.depth, &raster.statement, stored, options.height_range_m)?;
        let metres = |index: usize| (raster.stored.at(index) * mapping.scale + mapping.offset) as f32;
        if let Some(index) = with_data().find(|&index| !(-MAX_ELEVATION_M..=MAX_ELEVATION_M).contains(&metres(index))) {
            return Err(Fault::Unsupported(format!(
                "the sample at {} is {} m, which is no elevation on Earth; name a value that marks missing data with --no-data, or correct \
                 --height-range or the unit of the file",
                raster.place(index),
                metres(index)
            )));
        }
        let elevations_m = range(with_data().map(|index| f64::from(metres(index))));
        let [low, high] = elevations_m;
        if low >= high {
            return Err(Fault::Unsupported(format!(
                "all samples are {low} m: there is no relief; check that the right channel and bit depth were exported"
            )));
        }
        Ok(Scaled { stored, mapping, elevations_m })
    }
}

/// Notes for the user that follow from the values of the samples, one line each.
fn notes_of_samples(raster: &Raster, found: &Found, scaled: &Scaled, options: &ReadOptions) -> Vec<String> {
    let metres_per_unit = scaled.mapping.scale.abs();
    let of_zeros = || if options.no_data == NoData::Nothing { None } else { voids::note_of_zeros(raster, found) };
    let of_half = if raster.depth == Depth::Half { note_of_half(scaled.stored, metres_per_unit) } else { None };
    let [low, high] = scaled.elevations_m;
    let is_plain_float = raster.depth.is_float() && raster.statement == Statement::default() && options.height_range_m.is_none();
    let of_low_relief = (is_plain_float && high - low <= NORMALISED_RELIEF_M).then(|| {
        format!(
            "the whole relief is {} m; if the samples are normalised to 0..1, give their elevations with --height-range LOW,HIGH",
            high - low
        )
    });
    let of_voids = voids::remark(raster, found).or_else(of_zeros);
    [of_voids, note_of_8_bits(raster, metres_per_unit), of_half, of_low_relief].into_iter().flatten().collect()
}

/// Returns a note if all samples of a PNG or RAW file of 16-bit integers are multiples of 257, or all are multiples of 256, and they have more than
/// two values. Such samples are probably 8-bit numbers that were converted to 16 bits. `scale`: metres per unit of the samples.
fn note_of_8_bits(raster: &Raster, scale: f64) -> Option<String> {
    if !(raster.holds_codes && raster.depth == Depth::Unsigned16) {
        return None;
    }
    let codes = move || (0..raster.stored.len()).map(move |index| raster.stored.at(index) as u32);
    let step = [257, 256].into_iter().find(|step| codes().all(|code| code % step == 0))?;
    let levels: BTreeSet<u32> = codes().collect();
    // A file with only two levels may be a plain test picture.
    (levels.len() > 2).then(|| {
        format!(
            "all samples are multiples of {step}, as 8-bit numbers in a file of 16 bits are: {} levels in steps of {:.3} m, which show as terraces; \
             export the heights with 16 bits",
            levels.len(),
            f64::from(step) * scale
        )
    })
}

/// Lowest and highest value.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// Returns a note if half floats at the sample farthest from 0 are more than [`COARSE_STEP_M`] apart. `low` and `high`: the lowest and the highest
/// sample. `scale`: metres per unit of the samples.
///
/// Between 2^e and 2^(e + 1), half floats are 2^(e - 10) apart (IEEE 754 binary16). Below 2^-14, they are 2^-24 apart.
fn note_of_half([low, high]: [f64; 2], scale: f64) -> Option<String> {
    let largest = low.abs().max(high.abs());
    let exponent = largest.log2().ceil() - 1.0;
    let step = (exponent.max(-14.0) - 10.0).exp2() * scale;
    (step > COARSE_STEP_M)
        .then(|| format!("half floats: the samples farthest from 0 are in steps of {step} m; export 32-bit floats for more precision"))
}

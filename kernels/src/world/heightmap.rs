//! Heightmaps from files: 16-bit PNG, 16-bit RAW, OpenEXR and (Geo)TIFF; and their import as scenes.
//!
//! Samples are vertices; row 0 of a file is north, column 0 west. Sizes are read before samples, so that a file too large to use is
//! refused without room being made for it.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use super::World;
use super::rules::Rules;
use super::viewpoints;
use crate::error::{Error, Result, one_line};
use crate::scene::{self, Material, Rule, Scene};

/// Samples along an edge that are read at most; beyond it, a window has to be named.
pub const MAX_SIDE: u32 = 16_385;

/// Elevations beyond this, metres, are taken for a mistake in the file.
const MAX_ELEVATION_M: f32 = 100_000.0;

/// Elevations on a regular grid.
#[derive(Clone, Debug, PartialEq)]
pub struct Heightmap {
    /// Samples from west to east, at least 2.
    pub width: u32,
    /// Samples from north to south, at least 2.
    pub height: u32,
    /// Distance of two samples.
    pub metres_per_texel: f64,
    /// Elevations in metres, row by row, row 0 = north.
    pub samples: Vec<f32>,
}

/// How to read a heightmap.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// Distance of two samples, metres, > 0.
    pub metres_per_texel: f64,
    /// Elevations of the smallest and the largest value that an integer sample can take (0 and 65535; -32768 and 32767 for signed
    /// TIFF). Needed for integer samples; float samples are metres already.
    pub height_range_m: Option<[f64; 2]>,
    /// Width and height of a RAW file, samples. `None`: it is square.
    pub raw_size: Option<[u32; 2]>,
    /// Whether the high byte of a RAW sample comes first.
    pub raw_big_endian: bool,
    /// The part to read: x, y (from the north-west corner), width, height in samples. `None`: all.
    pub window: Option<[u32; 4]>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        ReadOptions { metres_per_texel: 1.0, height_range_m: None, raw_size: None, raw_big_endian: false, window: None }
    }
}

impl Heightmap {
    /// Width and depth covered, metres.
    pub fn extent_m(&self) -> [f64; 2] {
        [self.width, self.height].map(|n| f64::from(n - 1) * self.metres_per_texel)
    }

    /// Lowest and highest sample, metres.
    pub fn elevation_range_m(&self) -> (f64, f64) {
        let fold = |(low, high): (f32, f32), &s: &f32| (low.min(s), high.max(s));
        let (low, high) = self.samples.iter().fold((f32::INFINITY, f32::NEG_INFINITY), fold);
        (f64::from(low), f64::from(high))
    }

    /// Elevation (metres) and its derivatives along x (east) and y (north) at a place relative to the map's centre, by bicubic
    /// Catmull-Rom interpolation (Catmull & Rom 1974); beyond the edge, of the nearest place on it.
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

    /// Steepest slope (tangent) of the triangles between neighbouring samples, over both ways to split each square.
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

/// Weights of four samples at -1, 0, 1, 2 for a point at t in 0..=1, and their derivatives.
fn catmull_rom(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3) = (t * t, t * t * t);
    (
        [0.5 * (-t3 + 2.0 * t2 - t), 0.5 * (3.0 * t3 - 5.0 * t2 + 2.0), 0.5 * (-3.0 * t3 + 4.0 * t2 + t), 0.5 * (t3 - t2)],
        [0.5 * (-3.0 * t2 + 4.0 * t - 1.0), 0.5 * (9.0 * t2 - 10.0 * t), 0.5 * (-9.0 * t2 + 8.0 * t + 1.0), 0.5 * (3.0 * t2 - 2.0 * t)],
    )
}

/// What a file's samples are.
enum Samples {
    /// Values in 0..=1 of the integer range.
    Normalised(Vec<f32>),
    /// Metres.
    Metres(Vec<f32>),
}

struct Reader<'a> {
    path: &'a Path,
    options: &'a ReadOptions,
}

/// Reads a heightmap; the format follows from the file's extension (`png`, `raw`, `r16`, `bin`, `exr`, `tif`, `tiff`).
///
/// # Errors
/// [`Error::File`] where the file cannot be read; [`Error::Heightmap`] where it is truncated, of the wrong size or depth, too large, all
/// of one height, has NaN, infinite or missing samples, or where an option does not fit it.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Heightmap> {
    let file = File::open(path).map_err(|source| Error::File { file: path.to_owned(), source })?;
    decode(BufReader::new(file), path, options)
}

/// Reads a heightmap from the contents of a file. `path` names it in errors, and its extension tells the format, as for [`read`].
///
/// # Errors
/// As [`read`].
pub fn decode(input: impl BufRead + Seek, path: &Path, options: &ReadOptions) -> Result<Heightmap> {
    let reader = Reader { path, options };
    if !(options.metres_per_texel.is_finite() && options.metres_per_texel > 0.0) {
        return Err(reader.error(format!("metres per texel is {}; it must be a number above 0", options.metres_per_texel)));
    }
    if let Some([low, high]) = options.height_range_m
        && !(low.is_finite() && high.is_finite() && low < high)
    {
        return Err(reader.error(format!("the height range {low}..{high} m is empty; give the lower elevation first")));
    }
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let (size, samples) = match extension.as_str() {
        "png" => reader.png(input)?,
        "raw" | "r16" | "bin" => reader.raw(input)?,
        "exr" => reader.exr(input)?,
        "tif" | "tiff" => reader.tiff(input)?,
        _ => return Err(reader.error("the extension names no known format; use .png, .raw, .r16, .exr, .tif or .tiff".to_owned())),
    };
    reader.finish(size, samples)
}

impl Reader<'_> {
    fn error(&self, what: String) -> Error {
        Error::Heightmap { file: self.path.to_owned(), what: one_line(&what) }
    }

    fn unreadable(&self, source: std::io::Error) -> Error {
        Error::File { file: self.path.to_owned(), source }
    }

    /// The window to read of an image of this size, after the checks that need no samples.
    fn window(&self, width: u32, height: u32, can_read_part: bool) -> Result<[u32; 4]> {
        let too_large = width > MAX_SIDE || height > MAX_SIDE;
        if too_large && !can_read_part {
            return Err(self.error(format!(
                "{width} x {height} samples are too many for this format, which is read whole (limit {MAX_SIDE} a side); \
                 convert it to .tif or .raw and name a window"
            )));
        }
        let window = match self.options.window {
            None if too_large => {
                return Err(self.error(format!(
                    "{width} x {height} samples are more than the {MAX_SIDE} a side that fit a world; name a window of it (x, y, width, height)"
                )));
            }
            None => [0, 0, width, height],
            Some([x, y, w, h]) => {
                let fits = |start: u32, length: u32, all: u32| start.checked_add(length).is_some_and(|end| end <= all);
                if !fits(x, w, width) || !fits(y, h, height) {
                    return Err(self.error(format!(
                        "the window {w} x {h} at {x}, {y} leaves the file's {width} x {height} samples; move or shrink it"
                    )));
                }
                if w > MAX_SIDE || h > MAX_SIDE {
                    return Err(self.error(format!("a window of {w} x {h} samples is more than {MAX_SIDE} a side; shrink it")));
                }
                [x, y, w, h]
            }
        };
        if window[2] < 2 || window[3] < 2 {
            let [_, _, w, h] = window;
            return Err(self.error(format!("{w} x {h} samples make no ground; at least 2 x 2 are needed")));
        }
        Ok(window)
    }

    fn png(&self, input: impl BufRead + Seek) -> Result<([u32; 2], Samples)> {
        use image::{ColorType, ExtendedColorType, ImageDecoder};
        let decoder = image::codecs::png::PngDecoder::new(input).map_err(|e| self.undecodable(&e))?;
        let (width, height) = decoder.dimensions();
        if decoder.color_type() != ColorType::L16 || decoder.original_color_type() != ExtendedColorType::L16 {
            let bits = decoder.original_color_type();
            return Err(self.error(format!(
                "its samples are {}, not 16-bit grey: 256 levels would be terraces; export the heightmap as 16-bit greyscale",
                colour_words(bits)
            )));
        }
        let window = self.window(width, height, false)?;
        self.height_range()?;
        let mut bytes = vec![0; width as usize * height as usize * 2];
        decoder.read_image(&mut bytes).map_err(|e| self.undecodable(&e))?;
        let whole: Vec<f32> = bytes.chunks_exact(2).map(|b| unit(u16::from_ne_bytes([b[0], b[1]]))).collect();
        Ok(([window[2], window[3]], Samples::Normalised(crop(whole, width, window))))
    }

    fn raw(&self, mut input: impl BufRead + Seek) -> Result<([u32; 2], Samples)> {
        let length = input.seek(SeekFrom::End(0)).map_err(|source| self.unreadable(source))?;
        let [width, height] = match self.options.raw_size {
            Some(size) => size,
            None => {
                let side = ((length / 2) as f64).sqrt().round() as u64;
                let side = u32::try_from(side).ok().filter(|&s| u64::from(s) * u64::from(s) * 2 == length && s > 0);
                let Some(side) = side else {
                    return Err(self.error(format!(
                        "{length} bytes are not a square of 16-bit samples; the file is truncated, or its size must be given (width x height)"
                    )));
                };
                [side, side]
            }
        };
        let expected = u64::from(width) * u64::from(height) * 2;
        if expected != length {
            return Err(self.error(format!(
                "{width} x {height} 16-bit samples are {expected} bytes, but the file has {length}; it is truncated or the size is wrong"
            )));
        }
        let window = self.window(width, height, true)?;
        self.height_range()?;
        let [x, y, w, h] = window;
        let mut samples = Vec::with_capacity(w as usize * h as usize);
        let mut row = vec![0; w as usize * 2];
        for line in y..y + h {
            let start = (u64::from(line) * u64::from(width) + u64::from(x)) * 2;
            let read = input.seek(SeekFrom::Start(start)).and_then(|_| input.read_exact(&mut row));
            read.map_err(|source| self.unreadable(source))?;
            let value = |b: &[u8]| {
                let pair = [b[0], b[1]];
                unit(if self.options.raw_big_endian { u16::from_be_bytes(pair) } else { u16::from_le_bytes(pair) })
            };
            samples.extend(row.chunks_exact(2).map(value));
        }
        Ok(([w, h], Samples::Normalised(samples)))
    }

    fn exr(&self, mut input: impl BufRead + Seek) -> Result<([u32; 2], Samples)> {
        use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read};
        let meta = exr::meta::MetaData::read_from_buffered(&mut input, false).map_err(|e| self.undecodable(&e))?;
        let header = meta.headers.first().ok_or_else(|| self.error("it holds no layer; export one with a height channel".to_owned()))?;
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let (width, height) = (side(header.layer_size.0), side(header.layer_size.1));
        let window = self.window(width, height, false)?;
        // Room is made for every layer that is read, and which of them that is, the first may not tell.
        for other in &meta.headers {
            self.window(side(other.layer_size.0), side(other.layer_size.1), false)?;
        }
        input.rewind().map_err(|source| self.unreadable(source))?;
        let reading = read().no_deep_data().largest_resolution_level().all_channels().first_valid_layer().all_attributes();
        let image = reading.non_parallel().from_buffered(input).map_err(|e| self.undecodable(&e))?;
        let channels = &image.layer_data.channel_data.list;
        let named = |name: &str| channels.iter().find(|c| c.name.to_string().eq_ignore_ascii_case(name));
        let channel =
            if channels.len() == 1 { channels.first() } else { ["height", "elevation", "Y", "Z", "V", "R"].into_iter().find_map(named) };
        let Some(channel) = channel else {
            let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
            let names = names.join(", ");
            return Err(self.error(format!("none of its channels ({names}) is a height; name one `height`, `Y`, `Z`, `V` or `R`")));
        };
        let samples: Vec<f32> = match &channel.sample_data {
            FlatSamples::F32(samples) => samples.clone(),
            FlatSamples::F16(samples) => samples.iter().map(|s| s.to_f32()).collect(),
            FlatSamples::U32(_) => {
                return Err(self.error(format!("channel {} holds integers; export the heights as float, in metres", channel.name)));
            }
        };
        if samples.len() != width as usize * height as usize {
            return Err(self.error(format!("channel {} is subsampled; export it at full resolution", channel.name)));
        }
        Ok(([window[2], window[3]], Samples::Metres(crop(samples, width, window))))
    }

    fn tiff(&self, input: impl BufRead + Seek) -> Result<([u32; 2], Samples)> {
        use tiff::ColorType;
        use tiff::decoder::{Decoder, DecodingResult};
        let mut decoder = Decoder::new(input).map_err(|e| self.undecodable(&e))?;
        let (width, height) = decoder.dimensions().map_err(|e| self.undecodable(&e))?;
        let colour = decoder.colortype().map_err(|e| self.undecodable(&e))?;
        let ColorType::Gray(bits) = colour else {
            return Err(self.error(format!("its pixels are {colour:?}, not one height each; export a single band")));
        };
        if bits < 16 {
            return Err(
                self.error(format!("its samples have {bits} bits: 256 levels would be terraces; export 16-bit integers or 32-bit floats"))
            );
        }
        let [x0, y0, w, h] = self.window(width, height, true)?;
        // GDAL writes its no-data value as text.
        let no_data = decoder.get_tag_ascii_string(tiff::tags::Tag::GdalNodata).ok();
        let no_data: Option<f64> = no_data.and_then(|text| text.trim_matches(['\0', ' ']).parse().ok());
        let (w, h, x0, y0) = (w as usize, h as usize, x0 as usize, y0 as usize);
        let mut samples: Vec<f32> = Vec::new();
        let mut is_integer = false;
        let (chunk_width, chunk_height) = decoder.chunk_dimensions();
        let (chunk_width, chunk_height) = (chunk_width.max(1) as usize, chunk_height.max(1) as usize);
        let across = (width as usize).div_ceil(chunk_width);
        for chunk_y in y0 / chunk_height..=(y0 + h - 1) / chunk_height {
            for chunk_x in x0 / chunk_width..=(x0 + w - 1) / chunk_width {
                let index = u32::try_from(chunk_y * across + chunk_x).map_err(|e| self.undecodable(&e))?;
                let (data_width, data_height) = decoder.chunk_data_dimensions(index);
                let (data_width, data_height) = (data_width as usize, data_height as usize);
                let missing = |v: f64| no_data.is_some_and(|n| (v - n).abs() <= n.abs() * 1e-6);
                let keep = |v: f64, s: f32| if missing(v) { f32::NAN } else { s };
                let values: Vec<f32> = match decoder.read_chunk(index).map_err(|e| self.undecodable(&e))? {
                    DecodingResult::U16(v) => {
                        is_integer = true;
                        v.into_iter().map(|s| keep(f64::from(s), unit(s))).collect()
                    }
                    DecodingResult::I16(v) => {
                        is_integer = true;
                        v.into_iter().map(|s| keep(f64::from(s), (f32::from(s) + 32768.0) / 65535.0)).collect()
                    }
                    DecodingResult::F16(v) => v.into_iter().map(|s| keep(s.to_f64(), s.to_f32())).collect(),
                    DecodingResult::F32(v) => v.into_iter().map(|s| keep(f64::from(s), s)).collect(),
                    DecodingResult::F64(v) => v.into_iter().map(|s| keep(s, s as f32)).collect(),
                    _ => {
                        return Err(self.error(format!("its samples are {bits}-bit integers; export 16-bit integers or 32-bit floats")));
                    }
                };
                if values.len() < data_width * data_height {
                    return Err(
                        self.error("a strip or tile is shorter than it says; the file is truncated: copy or export it again".to_owned())
                    );
                }
                // Only now: a size is quickly claimed.
                if samples.is_empty() {
                    samples.resize(w * h, f32::NAN);
                }
                for row in 0..data_height {
                    let y = chunk_y * chunk_height + row;
                    if y < y0 || y >= y0 + h {
                        continue;
                    }
                    let left = chunk_x * chunk_width;
                    let (from, to) = (left.max(x0), (left + data_width).min(x0 + w));
                    if from < to {
                        samples[(y - y0) * w + from - x0..][..to - from]
                            .copy_from_slice(&values[row * data_width + from - left..][..to - from]);
                    }
                }
            }
        }
        if is_integer {
            self.height_range()?;
        }
        let samples = if is_integer { Samples::Normalised(samples) } else { Samples::Metres(samples) };
        Ok(([w as u32, h as u32], samples))
    }

    fn undecodable(&self, reason: &dyn std::fmt::Display) -> Error {
        self.error(format!("cannot be decoded ({reason}); the file is truncated or damaged: copy or export it again"))
    }

    fn height_range(&self) -> Result<[f64; 2]> {
        self.options.height_range_m.ok_or_else(|| {
            self.error("integer samples need elevations to stand for; give the height range in metres (lowest, highest)".to_owned())
        })
    }

    fn finish(&self, [width, height]: [u32; 2], samples: Samples) -> Result<Heightmap> {
        let samples = match samples {
            Samples::Metres(samples) => samples,
            Samples::Normalised(samples) => {
                let [low, high] = self.height_range()?;
                samples.into_iter().map(|s| (low + (high - low) * f64::from(s)) as f32).collect()
            }
        };
        let place = |i: usize| (i % width as usize, i / width as usize);
        // -9999 and -32768 m lie on no land: files without a no-data tag mark gaps with them.
        let gap = |s: f32| !s.is_finite() || [-9999.0, -32_768.0].contains(&s);
        if let Some(i) = samples.iter().position(|&s| gap(s)) {
            let (x, y) = place(i);
            let count = samples.iter().filter(|&&s| gap(s)).count();
            return Err(self.error(format!(
                "{count} samples are NaN, infinite or marks of no data (-9999, -32768), the first at column {x}, row {y}; fill the gaps or name a window without them"
            )));
        }
        if let Some(i) = samples.iter().position(|s| s.abs() > MAX_ELEVATION_M) {
            let (x, y) = place(i);
            return Err(self.error(format!(
                "the sample at column {x}, row {y} is {} m, which is no elevation; a no-data value has to be filled, or the range is wrong",
                samples[i]
            )));
        }
        if samples.iter().all(|&s| s == samples[0]) {
            return Err(self.error(format!(
                "all samples are {} m: there is no relief; check that the right channel and bit depth were exported",
                samples[0]
            )));
        }
        Ok(Heightmap { width, height, metres_per_texel: self.options.metres_per_texel, samples })
    }
}

fn unit(sample: u16) -> f32 {
    f32::from(sample) / 65535.0
}

fn crop(samples: Vec<f32>, width: u32, [x, y, w, h]: [u32; 4]) -> Vec<f32> {
    let (width, x, y, w, h) = (width as usize, x as usize, y as usize, w as usize, h as usize);
    if w == width && y == 0 && samples.len() == w * h {
        return samples;
    }
    (y..y + h).flat_map(|row| samples[row * width + x..][..w].iter().copied()).collect()
}

fn colour_words(colour: image::ExtendedColorType) -> String {
    use image::ExtendedColorType as C;
    match colour {
        C::L1 | C::L2 | C::L4 => "grey of fewer than 8 bits".to_owned(),
        C::L8 => "8-bit grey".to_owned(),
        C::La8 => "8-bit grey with alpha".to_owned(),
        C::La16 => "16-bit grey with alpha".to_owned(),
        C::Rgb8 | C::Rgba8 => "8-bit colour".to_owned(),
        C::Rgb16 | C::Rgba16 => "16-bit colour".to_owned(),
        other => format!("{other:?}"),
    }
}

/// Makes a scene folder of a heightmap: `heightmap.png` (16 bits over its own lowest and highest elevation), `scene.toml` with materials,
/// rules suited to its slopes and elevations and four cameras found in it, and `materials/` with the images of `materials`, if given
/// (a folder of folders, one per material; without it, procedural materials).
///
/// `detail_m` is the relief added below the data's resolution, metres; 0 = none, and LODs only as deep as the data.
/// The folder appears whole or not at all. Returns the scene as written.
///
/// # Errors
/// Those of [`read`]; [`Error::Request`] if `out_dir` exists and is not an empty folder or `detail_m` is negative;
/// [`Error::Material`] for a folder without materials; [`Error::File`] and [`Error::Image`] where writing fails.
pub fn import(source: &Path, options: &ReadOptions, materials: Option<&Path>, detail_m: f64, out_dir: &Path) -> Result<Scene> {
    if !(detail_m.is_finite() && detail_m >= 0.0) {
        return Err(Error::Request(format!("detail of {detail_m} m: give 0 (none) or more metres of relief")));
    }
    refuse_occupied(out_dir)?;
    let map = read(source, options)?;
    let staging = Staging::beside(out_dir)?;
    let scene = write_scene(&map, source, materials, detail_m, &staging.folder)?;
    // An empty folder of that name may stand there, and renaming onto it works on some systems only.
    if out_dir.exists() {
        std::fs::remove_dir(out_dir).map_err(|source| Error::File { file: out_dir.to_owned(), source })?;
    }
    std::fs::rename(&staging.folder, out_dir).map_err(|source| Error::File { file: out_dir.to_owned(), source })?;
    Ok(Scene { folder: out_dir.to_owned(), ..scene })
}

fn refuse_occupied(out_dir: &Path) -> Result<()> {
    let occupied = match std::fs::read_dir(out_dir) {
        Ok(mut entries) => entries.next().is_some(),
        Err(_) => out_dir.exists(),
    };
    if occupied {
        return Err(Error::Request(format!("{} exists and is not an empty folder; name another or remove it first", out_dir.display())));
    }
    Ok(())
}

/// A folder under a temporary name, removed again unless it was renamed away.
struct Staging {
    folder: PathBuf,
}

impl Staging {
    fn beside(out_dir: &Path) -> Result<Staging> {
        let name = out_dir.file_name().map_or_else(|| "scene".to_owned(), |n| n.to_string_lossy().into_owned());
        let parent = out_dir.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let folder = parent.join(format!(".{name}.part-{}", std::process::id()));
        std::fs::create_dir_all(&folder).map_err(|source| Error::File { file: folder.clone(), source })?;
        Ok(Staging { folder })
    }
}

impl Drop for Staging {
    fn drop(&mut self) {
        // Nothing is left to do about a temporary folder that cannot be removed.
        drop(std::fs::remove_dir_all(&self.folder));
    }
}

fn write_scene(map: &Heightmap, source: &Path, materials: Option<&Path>, detail_m: f64, folder: &Path) -> Result<Scene> {
    let (low, high) = map.elevation_range_m();
    write_png(map, [low, high], &folder.join("heightmap.png"))?;
    let materials = match materials {
        Some(from) => copy_materials(from, &folder.join("materials"))?,
        None => PROCEDURAL.iter().map(|name| material(name, true)).collect(),
    };
    let name = source.file_stem().map_or_else(|| "imported".to_owned(), |s| s.to_string_lossy().into_owned());
    let mut scene = Scene {
        description: format!("{name}: {} x {} samples, {} m apart, {low:.1} to {high:.1} m.", map.width, map.height, map.metres_per_texel),
        name,
        world: scene::World::Heightmap {
            file: PathBuf::from("heightmap.png"),
            metres_per_texel: map.metres_per_texel,
            height_range_m: [low, high],
            detail_m,
            seed: 1,
            holes: Vec::new(),
            colour_modulation: 0.0,
        },
        rules: Vec::new(),
        strokes: Vec::new(),
        materials,
        detail_size: 1024,
        flavours: Default::default(),
        blend: Default::default(),
        sun: Default::default(),
        sky: Default::default(),
        cameras: Vec::new(),
        paths: Vec::new(),
        folder: folder.to_owned(),
    };
    let bare = World::from_heightmap(map.clone(), detail_m, 1, Vec::new(), 0.0, Rules::new(&scene), scene.materials.len());
    let steepest = bare.max_slope_deg();
    // Cliffs are what is steep here: 45 degrees where there is enough of it, less in gentle country, none in a plain.
    scene.flavours.cliff_slope_deg = match steepest {
        s if s >= 55.0 => 45.0,
        s if s >= 25.0 => (0.8 * s).round(),
        _ => 90.0,
    };
    scene.rules = rules_for(&scene.materials, [low, high], scene.flavours.cliff_slope_deg.min(60.0).min(steepest.max(10.0)));
    // The cameras stand on the ground as the written file has it.
    let world = World::new(&scene)?;
    scene.cameras = viewpoints::find(&world, &scene);
    let text = toml::to_string(&scene).map_err(|e| Error::Scene { where_: "scene.toml".to_owned(), what: e.to_string() })?;
    let file = folder.join("scene.toml");
    std::fs::write(&file, text).map_err(|source| Error::File { file, source })?;
    Ok(scene)
}

fn write_png(map: &Heightmap, [low, high]: [f64; 2], file: &Path) -> Result<()> {
    use image::ImageEncoder;
    let code = |s: &f32| ((f64::from(*s) - low) / (high - low) * 65535.0).round().clamp(0.0, 65535.0) as u16;
    let bytes: Vec<u8> = map.samples.iter().flat_map(|s| code(s).to_ne_bytes()).collect();
    let output = File::create(file).map_err(|source| Error::File { file: file.to_owned(), source })?;
    let encoder = image::codecs::png::PngEncoder::new(std::io::BufWriter::new(output));
    encoder
        .write_image(&bytes, map.width, map.height, image::ExtendedColorType::L16)
        .map_err(|e| Error::Image { file: file.to_owned(), what: e.to_string() })
}

/// Materials of an import without a material folder.
const PROCEDURAL: [&str; 9] = ["grass", "meadow", "forest-floor", "dirt", "gravel", "scree", "limestone", "granite", "snow"];

fn material(name: &str, procedural: bool) -> Material {
    Material {
        name: name.to_owned(),
        procedural: procedural.then(|| name.to_owned()),
        folder: (!procedural).then(|| Path::new("materials").join(name)),
        tile_m: match Role::of(name) {
            Role::Rock => 5.0,
            Role::Rubble | Role::Snow => 3.5,
            Role::Green | Role::Soil => 2.5,
        },
        orientation_deg: 0.0,
        tint: [1.0; 3],
        normal_strength: 1.0,
    }
}

fn copy_materials(from: &Path, to: &Path) -> Result<Vec<Material>> {
    let failed = |file: &Path| {
        let file = file.to_owned();
        move |source| Error::File { file, source }
    };
    let mut folders: Vec<PathBuf> =
        std::fs::read_dir(from).map_err(failed(from))?.filter_map(|entry| entry.ok().map(|e| e.path())).filter(|p| p.is_dir()).collect();
    folders.sort();
    let mut materials = Vec::new();
    for folder in folders {
        let Some(name) = folder.file_name().map(|n| n.to_string_lossy().into_owned()) else {
            continue;
        };
        let entries = std::fs::read_dir(&folder).map_err(failed(&folder))?;
        let mut files: Vec<PathBuf> = entries.filter_map(|e| e.ok().map(|e| e.path())).filter(|p| p.is_file()).collect();
        files.sort();
        if !files.iter().any(|f| f.file_stem().is_some_and(|s| s.eq_ignore_ascii_case("albedo"))) {
            continue;
        }
        let target = to.join(&name);
        std::fs::create_dir_all(&target).map_err(failed(&target))?;
        for file in files {
            let extension = file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
            // Source notes travel with the images: licences ask for it.
            if ["png", "jpg", "jpeg", "exr", "txt", "md"].contains(&extension.as_str())
                && let Some(file_name) = file.file_name()
            {
                std::fs::copy(&file, target.join(file_name)).map_err(failed(&file))?;
            }
        }
        materials.push(material(&name, false));
    }
    match materials.len() {
        0 => Err(Error::Material {
            name: from.display().to_string(),
            what: "no sub-folder holds an `albedo` image; give a folder with one folder per material".to_owned(),
        }),
        1..=256 => Ok(materials),
        n => Err(Error::Material { name: from.display().to_string(), what: format!("{n} materials; a palette holds at most 256") }),
    }
}

/// Where a material belongs, judged by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    Green,
    Soil,
    Rubble,
    Rock,
    Snow,
}

impl Role {
    fn of(name: &str) -> Role {
        let name = name.to_lowercase();
        let has = |words: &[&str]| words.iter().any(|w| name.contains(w));
        if has(&["snow", "ice"]) {
            Role::Snow
        } else if has(&["cliff", "granite", "limestone", "basalt"]) {
            Role::Rock
        } else if has(&["grass", "meadow", "moss", "forest", "heath"]) {
            Role::Green
        } else if has(&["scree", "gravel", "pebble", "rubble", "talus", "boulder"]) {
            Role::Rubble
        } else if has(&["rock", "stone"]) {
            Role::Rock
        } else {
            Role::Soil
        }
    }
}

/// Rules by slope and elevation: vegetation low and gentle, soil in patches, rubble on steep ground, rock above `cliff_deg`, snow high up.
fn rules_for(materials: &[Material], [low, high]: [f64; 2], cliff_deg: f64) -> Vec<Rule> {
    let relief = high - low;
    let at = |share: f64| (low + relief * share).round();
    let fade = (0.08 * relief).max(1.0).round();
    let mut rules = Vec::new();
    for role in [Role::Green, Role::Soil, Role::Rubble, Role::Rock, Role::Snow] {
        for (nth, material) in materials.iter().filter(|m| Role::of(&m.name) == role).enumerate() {
            // The first of a role covers its whole domain, further ones lie on it in patches of various sizes.
            let (noise_m, noise_cover) = match (role, nth) {
                (Role::Green | Role::Rock | Role::Snow, 0) => (0.0, 0.5),
                (Role::Soil, 0) => (35.0, 0.22),
                (Role::Rubble, 0) => (28.0, 0.6),
                _ => (40.0 + 25.0 * nth as f64, 0.35),
            };
            let slope = |from: f64, to: f64, fade: f64| {
                (Some([(from * cliff_deg).round(), (to * cliff_deg).round()]), (fade * cliff_deg).round().max(1.0))
            };
            let (weight, height_m, (slope_deg, slope_fade_deg)) = match role {
                Role::Green => (1.0 + 0.1 * nth as f64, Some([low - 1.0, at(0.6)]), slope(0.0, 0.7, 0.2)),
                Role::Soil => (1.1 + 0.1 * nth as f64, Some([low - 1.0, at(0.75)]), slope(0.0, 0.8, 0.2)),
                Role::Rubble => (1.3 + 0.05 * nth as f64, None, slope(0.55, 0.9, 0.15)),
                Role::Rock => {
                    (2.0 + 0.1 * nth as f64, None, (Some([(0.92 * cliff_deg).round(), 90.0]), (0.15 * cliff_deg).round().max(1.0)))
                }
                Role::Snow => (1.6 + 0.1 * nth as f64, Some([at(0.72), high + 1.0]), slope(0.0, 0.75, 0.15)),
            };
            rules.push(Rule {
                material: material.name.clone(),
                weight,
                height_m,
                height_fade_m: if height_m.is_some() { fade } else { 0.0 },
                slope_deg,
                slope_fade_deg,
                noise_m,
                noise_cover,
                ..Rule::default()
            });
        }
    }
    // What no rule reaches: bare rubble or rock, and failing these the first material there is, below all others.
    let ground =
        [Role::Rubble, Role::Rock, Role::Soil, Role::Green].into_iter().find_map(|r| materials.iter().find(|m| Role::of(&m.name) == r));
    if let Some(ground) = ground.or(materials.first()) {
        rules.insert(0, Rule { material: ground.name.clone(), weight: 0.05, noise_cover: 0.5, ..Rule::default() });
    }
    rules
}

//! Heightmaps from files: 16-bit PNG, 16-bit RAW, OpenEXR and (Geo)TIFF.
//!
//! A sample is the elevation at a grid point. Row 0 of a file is the northern edge, column 0 the western edge. The size is read before the samples,
//! so that a file that is too large is refused before memory is allocated for it.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

use crate::base::error::{Error, Result, one_line};

/// Limit of the number of samples that are read along each edge. For a larger file, the caller must give a window.
pub const MAX_SIDE: u32 = 16_385;

/// Limit of the absolute value of an elevation, metres. A larger value is reported as an error in the file.
const MAX_ELEVATION_M: f32 = 100_000.0;

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

/// How to read a heightmap.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// Distance between neighbouring samples, metres, > 0.
    pub metres_per_texel: f64,
    /// Elevations, in metres, of the smallest and the largest possible integer sample (0 and 65535; in signed TIFF -32768 and 32767). Required
    /// for integer samples; float samples are already in metres.
    pub height_range_m: Option<[f64; 2]>,
    /// Width and height of a RAW file, in samples. `None`: the file is square.
    pub raw_size: Option<[u32; 2]>,
    /// Whether the high byte of a RAW sample comes first.
    pub raw_big_endian: bool,
    /// The part to read: x, y (from the north-west corner), width, height in samples. `None`: the whole file.
    pub window: Option<[u32; 4]>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        ReadOptions { metres_per_texel: 1.0, height_range_m: None, raw_size: None, raw_big_endian: false, window: None }
    }
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

    /// Elevation (metres) and its derivatives along x (east) and y (north) at a position relative to the centre of the map, by bicubic
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

/// Samples of a file, before integers are converted to metres.
enum Samples {
    /// Integer samples, scaled to 0..=1.
    Normalised(Vec<f32>),
    /// Float samples, in metres.
    Metres(Vec<f32>),
}

struct Reader<'a> {
    path: &'a Path,
    options: &'a ReadOptions,
}

/// Reads a heightmap. The extension of the file determines its format (`png`, `raw`, `r16`, `bin`, `exr`, `tif`, `tiff`).
///
/// # Errors
/// [`Error::File`] if the file cannot be read. [`Error::Heightmap`] if the file is truncated or too large, if all its samples are equal, if
/// its size or bit depth is wrong, if samples are NaN, infinite or missing, or if an option does not fit the file.
pub fn read(path: &Path, options: &ReadOptions) -> Result<Heightmap> {
    let file = File::open(path).map_err(|source| Error::File { file: path.to_owned(), source })?;
    decode(BufReader::new(file), path, options)
}

/// Reads a heightmap from the contents of a file. `path` is used in error messages, and its extension determines the format, as in
/// [`read`].
///
/// # Errors
/// The same errors as [`read`].
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
        _ => return Err(reader.error("the extension is unknown; use .png, .raw, .r16, .exr, .tif or .tiff".to_owned())),
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

    /// Runs the checks that need no samples and returns the window to read from an image of this size.
    fn window(&self, width: u32, height: u32, can_read_part: bool) -> Result<[u32; 4]> {
        let too_large = width > MAX_SIDE || height > MAX_SIDE;
        if too_large && !can_read_part {
            return Err(self.error(format!(
                "{width} x {height} samples are too many: files of this format are read completely (limit: {MAX_SIDE} per side); \
                 convert the file to .tif or .raw and give a window"
            )));
        }
        let window = match self.options.window {
            None if too_large => {
                return Err(self.error(format!(
                    "{width} x {height} samples do not fit in a world (limit: {MAX_SIDE} per side); give a window (x, y, width, height)"
                )));
            }
            None => [0, 0, width, height],
            Some([x, y, w, h]) => {
                let fits = |start: u32, length: u32, all: u32| start.checked_add(length).is_some_and(|end| end <= all);
                if !fits(x, w, width) || !fits(y, h, height) {
                    return Err(self.error(format!(
                        "the window {w} x {h} at {x}, {y} is not inside the file's {width} x {height} samples; move or shrink it"
                    )));
                }
                if w > MAX_SIDE || h > MAX_SIDE {
                    return Err(self.error(format!("a window of {w} x {h} samples exceeds {MAX_SIDE} per side; shrink it")));
                }
                [x, y, w, h]
            }
        };
        if window[2] < 2 || window[3] < 2 {
            let [_, _, w, h] = window;
            return Err(self.error(format!("{w} x {h} samples are too few; at least 2 x 2 are needed")));
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
                "its samples are {}, but must be 16-bit grey, because 8 bits would show as terraces; export the heightmap as 16-bit greyscale",
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
        let header = meta.headers.first().ok_or_else(|| self.error("it has no layer; export one with a height channel".to_owned()))?;
        let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let (width, height) = (side(header.layer_size.0), side(header.layer_size.1));
        let window = self.window(width, height, false)?;
        // Memory is allocated for the layer that is read: the first valid one, which is not always the first one. So the sizes of all
        // layers are checked.
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
            return Err(self.error(format!("it has no height channel (only {names}); name one `height`, `Y`, `Z`, `V` or `R`")));
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
            return Err(self.error(format!("its pixels are {colour:?} instead of one height each; export a single band")));
        };
        if bits < 16 {
            return Err(
                self.error(format!("its samples have {bits} bits: 256 levels show as terraces; export 16-bit integers or 32-bit floats"))
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
                        self.error("a strip or tile is shorter than declared; the file is truncated: copy or export it again".to_owned())
                    );
                }
                // Memory is allocated only after a chunk has been decoded, because a damaged header can claim any size.
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
            self.error("the elevations of integer samples are unknown; give the height range in metres (lowest, highest)".to_owned())
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
        // Files without a no-data tag mark gaps by -9999 or -32768. No ground has such an elevation.
        let gap = |s: f32| !s.is_finite() || [-9999.0, -32_768.0].contains(&s);
        if let Some(i) = samples.iter().position(|&s| gap(s)) {
            let (x, y) = place(i);
            let count = samples.iter().filter(|&&s| gap(s)).count();
            return Err(self.error(format!(
                "{count} samples are NaN, infinite or no-data values (-9999, -32768), the first at column {x}, row {y}; fill the gaps or give a window without them"
            )));
        }
        if let Some(i) = samples.iter().position(|s| s.abs() > MAX_ELEVATION_M) {
            let (x, y) = place(i);
            return Err(self.error(format!(
                "the sample at column {x}, row {y} is {} m, which is no elevation on Earth; fill no-data values or correct the height range",
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
        C::L1 | C::L2 | C::L4 => "grey with fewer than 8 bits".to_owned(),
        C::L8 => "8-bit grey".to_owned(),
        C::La8 => "8-bit grey with alpha".to_owned(),
        C::La16 => "16-bit grey with alpha".to_owned(),
        C::Rgb8 | C::Rgba8 => "8-bit colour".to_owned(),
        C::Rgb16 | C::Rgba16 => "16-bit colour".to_owned(),
        other => format!("{other:?}"),
    }
}

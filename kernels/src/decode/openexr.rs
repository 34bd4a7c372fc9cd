//! Reads OpenEXR files: all parts, each with its windows, its chromaticities and the samples of all channels.
//!
//! Source: *OpenEXR File Layout* and *Technical Introduction to OpenEXR* (Academy Software Foundation). The crate `exr` parses headers
//! and decompresses blocks. This module decides what is supported, checks sizes before memory is allocated, and refuses files with missing
//! blocks, because the crate would leave their pixels at 0. If a file has several resolution levels, only the largest level is read.

use std::collections::HashSet;
use std::fmt;
use std::io::{BufRead, ErrorKind, Seek};

use exr::block::chunk::CompressedBlock;
use exr::block::reader::ChunksReader;
use exr::block::{BlockIndex, UncompressedBlock};
use exr::error::Error;
use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{Compression, IntegerBounds, SampleType, Text};
use exr::meta::header::Header;
use half::f16;

use super::fault::Fault;
use crate::base::error::one_line;

pub use super::chromaticities::Chromaticities;

/// Largest number of samples of a file, all parts and channels together: 8 GiB of f32.
const MAX_SAMPLES: u64 = 1 << 31;

/// Largest number of bytes of one decompressed block (a tile, or 1 to 256 rows). The crate allocates memory for the size that the header
/// states, before it reads the block.
const MAX_BLOCK_BYTES: u64 = 1 << 28;

/// Limits of the size of a file. They are checked before memory is allocated.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest width and height of a data window and of a display window, pixels.
    pub side: u32,
    /// Largest number of pixels of a data window and of a display window.
    pub pixels: u64,
}

/// The samples and the description of one part of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// Name of the part; empty if the file gives none.
    pub name: String,
    /// Rectangle of the pixels that are stored.
    pub data_window: Window,
    /// Rectangle of the pixels that a viewer shows.
    pub display_window: Window,
    /// Width of a pixel divided by its height; 1 for square pixels.
    pub pixel_aspect: f32,
    /// Primaries and white point that the file states. `None`: by convention, those of Rec. ITU-R BT.709.
    pub chromaticities: Option<Chromaticities>,
    /// Name of the compression, such as `DWAA`, if it is lossy for the type of at least one channel.
    pub lossy: Option<&'static str>,
    /// All channels, in the order of the file. Names include the layer ("terrain.height").
    pub channels: Vec<Channel>,
}

/// A rectangle of pixels. `Display` writes it like this: `48 x 30 at (12, 10)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Left column and top row; may be negative.
    pub position: [i32; 2],
    /// Width and height, at least 1.
    pub size: [u32; 2],
}

/// One channel of a part.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// Full name, with the layer: "terrain.height".
    pub name: String,
    /// How the file stores the samples.
    pub kind: Kind,
    /// The samples, row by row over the data window. They may be NaN or infinite.
    pub samples: Vec<f32>,
}

/// How a file stores the samples of a channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// 16-bit float, 11 bits of precision.
    Half,
    /// 32-bit float.
    Float,
    /// 32-bit unsigned integer.
    Uint,
}

impl Channel {
    /// The last component of the name, after the last '.': "height" of "terrain.height".
    pub fn base_name(&self) -> &str {
        self.name.rsplit_once('.').map_or(self.name.as_str(), |(_, base)| base)
    }

    /// The layer, which is the name before the last '.': "terrain" of "terrain.height"; empty if there is none.
    pub fn layer(&self) -> &str {
        self.name.rsplit_once('.').map_or("", |(layer, _)| layer)
    }

    /// Whether the channel is alpha: its base name is A or a.
    pub fn is_alpha(&self) -> bool {
        self.base_name().eq_ignore_ascii_case("A")
    }
}

/// A list of channels in which channels are looked up by name.
#[derive(Clone, Debug, Default)]
pub struct Channels<'a>(
    /// The channels, in the order of the file.
    pub Vec<&'a Channel>,
);

impl<'a> Channels<'a> {
    /// The only channel for which `is` returns true; None if there is none or more than one.
    fn only(&self, is: impl Fn(&Channel) -> bool) -> Option<&'a Channel> {
        let mut found = self.0.iter().copied().filter(|channel| is(channel));
        found.next().filter(|_| found.next().is_none())
    }

    /// The channel with this base name; None if there is none or more than one. A name in the same case takes precedence over names in
    /// another case. Both cases occur, because some programs write R G B and others r g b.
    pub fn with_base(&self, name: &str) -> Option<&'a Channel> {
        self.only(|channel| channel.base_name() == name).or_else(|| self.only(|channel| channel.base_name().eq_ignore_ascii_case(name)))
    }

    /// The channel whose full or base name is `name`; None if there is none or more than one. A full name takes precedence over base names, and a
    /// name in the same case over names in another case. For example, "y" is the channel "Y", even if there is a channel "mask.y".
    pub fn named(&self, name: &str) -> Option<&'a Channel> {
        self.only(|channel| channel.name == name)
            .or_else(|| self.only(|channel| channel.name.eq_ignore_ascii_case(name)))
            .or_else(|| self.with_base(name))
    }

    /// The only channel that is not alpha; None if there is none or more than one.
    pub fn single(&self) -> Option<&'a Channel> {
        self.only(|channel| !channel.is_alpha())
    }
}

impl Part {
    /// All channels, for look-ups by name.
    pub fn all(&self) -> Channels<'_> {
        Channels(self.channels.iter().collect())
    }

    /// The channel with this name, see [`Channels::named`].
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.all().named(name)
    }
}

impl fmt::Display for Window {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([width, height], [left, top]) = (self.size, self.position);
        write!(f, "{width} x {height} at ({left}, {top})")
    }
}

/// Reads all parts. `max_side` is the largest allowed width and height of the data window and of the display window, pixels. Both
/// windows are checked against it before memory is allocated.
///
/// # Errors
/// See [`read_within`].
pub fn read(input: impl BufRead + Seek, max_side: u32) -> Result<Vec<Part>, Fault> {
    read_within(input, Limits { side: max_side, pixels: u64::MAX })
}

/// Reads all parts of a file. The windows of the parts must be within the limits.
///
/// # Errors
/// [`Fault::Io`]: the operating system cannot read the file. [`Fault::Unsupported`]: deep data, subsampled channels, HTJ2K compression, integers
/// that f32 cannot represent exactly, or a feature that the crate `exr` does not support. [`Fault::TooLarge`]: a window exceeds the limits, there
/// are more than 2^31 samples, or a block has more than 2^28 bytes. [`Fault::Damaged`]: the file contradicts itself or ends too early, a block is
/// missing, or two channels have the same name.
pub fn read_within(mut input: impl BufRead + Seek, limits: Limits) -> Result<Vec<Part>, Fault> {
    // The argument `true` makes the crate refuse attributes that it cannot decode. Otherwise, the crate would report an unknown compression
    // as a missing compression.
    let meta = MetaData::read_from_buffered(&mut input, true).map_err(fault)?;
    check(&meta.headers, limits)?;
    input.rewind().map_err(Fault::of_io)?;
    let reader = exr::block::read(input, false).map_err(fault)?;
    let mut blocks = reader.filter_chunks(false, |_, tile, _| tile.is_largest_resolution_level()).map_err(fault)?;
    let headers = &meta.headers;
    let mut samples: Vec<Vec<Vec<f32>>> = vec![Vec::new(); headers.len()];
    // The table of blocks has one entry for each block: its position in the file. The crate reads one entry for each block in the largest levels of
    // all parts. So if no two entries lead to the same block, all blocks are present.
    let mut known: HashSet<BlockIndex> = HashSet::new();
    while let Some(block) = blocks.read_next_chunk() {
        let block = block.map_err(fault)?;
        let (Some(header), Some(channels)) = (headers.get(block.layer_index), samples.get_mut(block.layer_index)) else {
            return Err(damaged("a block of pixels belongs to no part"));
        };
        check_counters(&block.compressed_block, header)?;
        let block = UncompressedBlock::decompress_chunk(block, blocks.meta_data(), false).map_err(fault)?;
        if block.index.level != Vec2(0, 0) || !known.insert(block.index) {
            return Err(damaged("a block of pixels is missing: its entry in the table leads to another one"));
        }
        if channels.is_empty() {
            // Memory is allocated only after the first block has been decoded, because a damaged header can claim any size.
            *channels = header.channels.list.iter().map(|_| vec![0.0; header.layer_size.area()]).collect();
        }
        store(&block, header, channels)?;
    }
    Ok(headers.iter().zip(samples).map(|(header, samples)| part(header, samples)).collect())
}

/// Checks what the headers alone tell: features that are not supported, channels with the same name, and sizes beyond the limits are refused.
fn check(headers: &[Header], limits: Limits) -> Result<(), Fault> {
    let mut all_samples = 0_u64;
    for header in headers {
        let name = header.own_attributes.layer_name.as_ref().map(text).filter(|_| headers.len() > 1);
        let of_part = name.map_or_else(String::new, |name| format!(" of part `{}`", one_line(&name)));
        if header.deep {
            return Err(Fault::Unsupported(format!("the pixels{of_part} are deep data, which are not supported; export flat pixels")));
        }
        if matches!(header.compression, Compression::HTJ2K32 | Compression::HTJ2K256) {
            let compression = name_of(header.compression);
            return Err(Fault::Unsupported(format!(
                "compression {compression}{of_part} is not supported; export with ZIP or PIZ compression"
            )));
        }
        let mut names = HashSet::new();
        for channel in &header.channels.list {
            let name = text(&channel.name);
            if channel.sampling != Vec2(1, 1) {
                let Vec2(across, down) = channel.sampling;
                return Err(Fault::Unsupported(format!(
                    "channel `{}`{of_part} is subsampled (one sample for {across} x {down} pixels); export it at full resolution",
                    one_line(&name)
                )));
            }
            if let Some(name) = names.replace(name) {
                return Err(damaged(&format!("there are two channels `{}`{of_part}", one_line(&name))));
            }
        }
        for (what, window) in [("data", header.data_window()), ("display", header.shared_attributes.display_window)] {
            let [width, height] = [window.size.width() as u64, window.size.height() as u64];
            let Limits { side, pixels } = limits;
            if width > u64::from(side) || height > u64::from(side) {
                return Err(Fault::TooLarge(format!(
                    "the {what} window{of_part} has {width} x {height} pixels (limit: {side} per side); export a smaller picture"
                )));
            }
            if width.saturating_mul(height) > pixels {
                return Err(Fault::TooLarge(format!(
                    "the {what} window{of_part} has {width} x {height} pixels (limit: {pixels}); export a smaller picture"
                )));
            }
        }
        let block = header.max_block_pixel_size();
        let block_bytes =
            [block.height(), header.channels.bytes_per_pixel].iter().fold(block.width() as u64, |n, &by| n.saturating_mul(by as u64));
        if block_bytes > MAX_BLOCK_BYTES {
            let Vec2(width, height) = block;
            return Err(Fault::TooLarge(format!(
                "the blocks{of_part} have {width} x {height} pixels and {block_bytes} bytes (limit: {MAX_BLOCK_BYTES}); export scan lines or smaller tiles"
            )));
        }
        let pixels = (header.layer_size.width() as u64).saturating_mul(header.layer_size.height() as u64);
        all_samples = all_samples.saturating_add(pixels.saturating_mul(header.channels.list.len() as u64));
    }
    if all_samples > MAX_SAMPLES {
        return Err(Fault::TooLarge(format!(
            "all channels together have {all_samples} samples (limit: {MAX_SAMPLES}); export fewer channels"
        )));
    }
    Ok(())
}

/// Refuses a block of DWAA or DWAB whose counters claim more data than its pixels can have. The crate allocates as much memory as
/// the counters claim.
///
/// Such a block begins with eleven little-endian u64. The elements with the indices 1, 6 and 7 are numbers of bytes after decompression. The elements
/// 8 and 9 are numbers of 16-bit coefficients.
///
/// The limit `most` follows from two facts. A channel is divided into squares of 8 x 8 pixels, also at the edges of the block, and a square has at
/// most 64 coefficients. Run-length coding enlarges data by less than a factor of 2.
fn check_counters(block: &CompressedBlock, header: &Header) -> Result<(), Fault> {
    if !matches!(header.compression, Compression::DWAA(_) | Compression::DWAB(_)) {
        return Ok(());
    }
    let bytes = match block {
        CompressedBlock::ScanLine(rows) => &rows.compressed_pixels_le,
        CompressedBlock::Tile(tile) => &tile.compressed_pixels_le,
        // The function `check` has already refused deep data.
        CompressedBlock::DeepScanLine(_) | CompressedBlock::DeepTile(_) => return Ok(()),
    };
    let place = header.get_block_data_indices(block).map_err(fault)?;
    let size = header.get_absolute_block_pixel_coordinates(place).map_err(fault)?.size;
    let bytes_per_pixel = header.channels.bytes_per_pixel;
    // A block that would become larger by compression is stored without compression, and has no counters.
    if bytes.len() == size.area() * bytes_per_pixel {
        return Ok(());
    }
    let most = 2 * (size.width() + 8) * (size.height() + 8) * bytes_per_pixel;
    let (counters, _) = bytes.as_chunks::<8>();
    let claims = [1_usize, 6, 7, 8, 9].into_iter().filter_map(|index| counters.get(index)).map(|counter| u64::from_le_bytes(*counter));
    match claims.max() {
        Some(claim) if claim > most as u64 => Err(damaged("a block of pixels states more data than its number of pixels can have")),
        _ => Ok(()),
    }
}

/// Writes the rows of a block into the samples of all channels of its part.
fn store(block: &UncompressedBlock, header: &Header, channels: &mut [Vec<f32>]) -> Result<(), Fault> {
    for line in block.lines(&header.channels) {
        let at = line.location;
        let start = at.position.y() * header.layer_size.width() + at.position.x();
        let row = channels.get_mut(at.channel).and_then(|samples| samples.get_mut(start..start + at.sample_count));
        let (Some(row), Some(channel)) = (row, header.channels.list.get(at.channel)) else {
            return Err(damaged("a block of pixels lies outside the data window"));
        };
        match channel.sample_type {
            SampleType::F16 => {
                for (sample, bytes) in row.iter_mut().zip(line.value.as_chunks::<2>().0) {
                    *sample = f16::from_ne_bytes(*bytes).to_f32();
                }
            }
            SampleType::F32 => {
                for (sample, bytes) in row.iter_mut().zip(line.value.as_chunks::<4>().0) {
                    *sample = f32::from_ne_bytes(*bytes);
                }
            }
            SampleType::U32 => {
                for (sample, bytes) in row.iter_mut().zip(line.value.as_chunks::<4>().0) {
                    let value = u32::from_ne_bytes(*bytes);
                    *sample = value as f32;
                    if f64::from(*sample) != f64::from(value) {
                        return Err(Fault::Unsupported(format!(
                            "channel `{}` holds the integer {value}, which a 32-bit float cannot hold exactly; export the channel as float, or omit it",
                            one_line(&text(&channel.name))
                        )));
                    }
                }
            }
        }
    }
    Ok(())
}

fn part(header: &Header, samples: Vec<Vec<f32>>) -> Part {
    let descriptions = &header.channels.list;
    let lossy = descriptions.iter().any(|channel| !header.compression.is_lossless_for(channel.sample_type));
    let kind = |stored: SampleType| match stored {
        SampleType::F16 => Kind::Half,
        SampleType::F32 => Kind::Float,
        SampleType::U32 => Kind::Uint,
    };
    let channels = descriptions.iter().zip(samples);
    let pair = |Vec2(x, y): Vec2<f32>| [x, y];
    Part {
        name: header.own_attributes.layer_name.as_ref().map(text).unwrap_or_default(),
        data_window: window(header.data_window()),
        display_window: window(header.shared_attributes.display_window),
        pixel_aspect: header.shared_attributes.pixel_aspect,
        chromaticities: header.shared_attributes.chromaticities.map(|stated| Chromaticities {
            red: pair(stated.red),
            green: pair(stated.green),
            blue: pair(stated.blue),
            white: pair(stated.white),
        }),
        lossy: lossy.then(|| name_of(header.compression)),
        channels: channels
            .map(|(channel, samples)| Channel { name: text(&channel.name), kind: kind(channel.sample_type), samples })
            .collect(),
    }
}

/// Converts a window of the crate. The crate limits windows to fewer than 2^31 pixels per side.
fn window(bounds: IntegerBounds) -> Window {
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    Window { position: [bounds.position.x(), bounds.position.y()], size: [side(bounds.size.width()), side(bounds.size.height())] }
}

/// Decodes a name in a file. It is in UTF-8 or, in old files, in Latin-1.
fn text(name: &Text) -> String {
    String::from_utf8(name.as_slice().to_vec()).unwrap_or_else(|_| name.to_string())
}

/// The name that the export dialogs of other programs usually show for a compression.
fn name_of(compression: Compression) -> &'static str {
    match compression {
        Compression::Uncompressed => "NONE",
        Compression::RLE => "RLE",
        Compression::ZIP1 => "ZIPS",
        Compression::ZIP16 => "ZIP",
        Compression::PIZ => "PIZ",
        Compression::PXR24 => "PXR24",
        Compression::B44 => "B44",
        Compression::B44A => "B44A",
        Compression::DWAA(_) => "DWAA",
        Compression::DWAB(_) => "DWAB",
        Compression::HTJ2K32 => "HTJ2K32",
        Compression::HTJ2K256 => "HTJ2K256",
    }
}

fn damaged(what: &str) -> Fault {
    Fault::Damaged(format!("OpenEXR: {what}"))
}

/// Converts an error of the crate.
fn fault(error: Error) -> Fault {
    match error {
        Error::NotSupported(what) => Fault::Unsupported(format!(
            "it uses a feature of OpenEXR that is not supported ({}); export flat scan lines with ZIP compression",
            one_line(&what)
        )),
        // The table of blocks contains a position to which the operating system cannot seek.
        Error::Io(source) if source.kind() == ErrorKind::InvalidInput => damaged("a block of pixels lies outside the file"),
        Error::Io(source) => Fault::of_io(source),
        Error::Invalid(what) => damaged(&one_line(&what)),
        // The crate returns this error only if its caller stops it. This module does not stop it.
        Error::Aborted => damaged("reading was stopped"),
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use e::WritableImage as _;
    use exr::prelude as e;

    use super::*;

    type Layer = e::Layer<e::AnyChannels<e::FlatSamples>>;

    const SCAN_LINES: e::Encoding =
        e::Encoding { compression: e::Compression::Uncompressed, blocks: e::Blocks::ScanLines, line_order: e::LineOrder::Increasing };

    fn ramp(count: usize) -> Vec<f32> {
        (0..count).map(|i| i as f32 + 0.5).collect()
    }

    fn layer(
        name: Option<&str>,
        at: (i32, i32),
        size: (usize, usize),
        encoding: e::Encoding,
        channels: &[(&str, e::FlatSamples)],
    ) -> Layer {
        let channels = channels.iter().map(|(name, samples)| e::AnyChannel::new(*name, samples.clone()));
        let attributes =
            e::LayerAttributes { layer_name: name.map(e::Text::from), layer_position: e::Vec2(at.0, at.1), ..Default::default() };
        e::Layer::new(size, attributes, encoding, e::AnyChannels::sort(channels.collect()))
    }

    fn bytes_of(layer: Layer) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        e::Image::from_layer(layer).write().to_buffered(&mut file).unwrap();
        file.into_inner()
    }

    /// A file of 3 x 2 pixels with the channels R and Y, one block for each row.
    fn small() -> Vec<u8> {
        let samples = e::FlatSamples::F32(ramp(6));
        bytes_of(layer(None, (0, 0), (3, 2), SCAN_LINES, &[("R", samples.clone()), ("Y", samples)]))
    }

    fn read_all(bytes: &[u8]) -> Result<Vec<Part>, String> {
        read(Cursor::new(bytes), 100).map_err(|fault| {
            let text = fault.to_string();
            assert!(!text.is_empty() && !text.contains(char::is_control), "{text:?}");
            text
        })
    }

    /// The bytes with the first occurrence of `old` replaced.
    fn changed(mut bytes: Vec<u8>, old: &[u8], new: &[u8]) -> Vec<u8> {
        let at = bytes.windows(old.len()).position(|part| part == old).expect("the bytes are in the file");
        bytes.splice(at..at + old.len(), new.iter().copied());
        bytes
    }

    /// Position of the table of blocks, in a file with this number of blocks. The table is found by its first entry, which is the position
    /// right after the table.
    fn table(bytes: &[u8], blocks: usize) -> usize {
        let is_table = |at: &usize| bytes.get(*at..*at + 8).is_some_and(|entry| entry == ((*at + 8 * blocks) as u64).to_le_bytes());
        (0..bytes.len()).find(is_table).expect("a table of blocks")
    }

    #[test]
    fn parts_windows_and_samples_are_read() {
        let half = e::FlatSamples::F16(ramp(6).into_iter().map(e::f16::from_f32).collect());
        let whole = e::FlatSamples::U32(vec![0, 1, 2, 16_777_214, 16_777_216, 4_294_967_040]);
        let tiles = e::Encoding { compression: e::Compression::ZIP16, blocks: e::Blocks::Tiles(e::Vec2(2, 2)), ..SCAN_LINES };
        let colour = layer(Some("colour"), (-7, 5), (3, 2), SCAN_LINES, &[("sun.R", half), ("id", whole)]);
        let height = layer(Some("height"), (1, 1), (5, 3), tiles, &[("Y", e::FlatSamples::F32(ramp(15)))]);
        let white = e::Vec2(0.32168, 0.33767);
        let chromaticities = e::attribute::Chromaticities { red: white, green: white, blue: white, white };
        let display = e::IntegerBounds::new((-8, 4), (20, 10));
        let attributes = e::ImageAttributes { chromaticities: Some(chromaticities), pixel_aspect: 2.0, ..e::ImageAttributes::new(display) };
        let mut file = Cursor::new(Vec::new());
        e::Image::from_layers(attributes, vec![colour, height]).write().to_buffered(&mut file).unwrap();
        let parts = read_all(&file.into_inner()).unwrap();
        let names: Vec<&str> = parts.iter().map(|part| part.name.as_str()).collect();
        assert_eq!(names, ["colour", "height"]);
        assert_eq!(parts[0].data_window, Window { position: [-7, 5], size: [3, 2] });
        assert_eq!(parts[1].data_window, Window { position: [1, 1], size: [5, 3] });
        for part in &parts {
            assert_eq!((part.display_window, part.pixel_aspect), (Window { position: [-8, 4], size: [20, 10] }, 2.0));
            assert_eq!(part.chromaticities.map(|stated| stated.white), Some([0.32168, 0.33767]));
            assert_eq!(part.lossy, None);
        }
        let [id, sun] = parts[0].channels.as_slice() else { panic!("{:?}", parts[0].channels) };
        assert_eq!((id.name.as_str(), id.kind, id.layer(), id.base_name()), ("id", Kind::Uint, "", "id"));
        assert_eq!(id.samples, [0.0, 1.0, 2.0, 16_777_214.0, 16_777_216.0, 4_294_967_040.0]);
        assert_eq!((sun.name.as_str(), sun.kind, sun.layer(), sun.base_name()), ("sun.R", Kind::Half, "sun", "R"));
        assert_eq!(sun.samples, ramp(6));
        assert_eq!((parts[1].channels[0].kind, &parts[1].channels[0].samples), (Kind::Float, &ramp(15)));
        assert_eq!(parts[0].data_window.to_string(), "3 x 2 at (-7, 5)");
    }

    #[test]
    fn the_largest_of_several_levels_is_read() {
        for decreasing in [false, true] {
            let level = |size: usize, value: f32| e::FlatSamples::F32(vec![value; size * size]);
            let levels = vec![e::FlatSamples::F32(ramp(16)), level(2, -1.0), level(1, -2.0)];
            let levels = e::Levels::Mip { level_data: levels, rounding_mode: exr::math::RoundingMode::Down };
            let line_order = if decreasing { e::LineOrder::Decreasing } else { e::LineOrder::Increasing };
            let tiles = e::Encoding { compression: e::Compression::RLE, blocks: e::Blocks::Tiles(e::Vec2(2, 2)), line_order };
            let channels = e::AnyChannels::sort([e::AnyChannel::new("Y", levels)].into_iter().collect());
            let image = e::Image::from_layer(e::Layer::new((4, 4), e::LayerAttributes::default(), tiles, channels));
            let mut file = Cursor::new(Vec::new());
            image.write().to_buffered(&mut file).unwrap();
            assert_eq!(read_all(&file.into_inner()).unwrap()[0].channels[0].samples, ramp(16), "decreasing: {decreasing}");
        }
    }

    #[test]
    fn channels_are_found_by_their_names() {
        let channel = |name: &str| Channel { name: name.to_owned(), kind: Kind::Float, samples: Vec::new() };
        let window = Window { position: [0, 0], size: [1, 1] };
        let part = |names: &[&str]| Part {
            name: String::new(),
            data_window: window,
            display_window: window,
            pixel_aspect: 1.0,
            chromaticities: None,
            lossy: None,
            channels: names.iter().map(|name| channel(name)).collect(),
        };
        for (names, wanted, found) in [
            (&["terrain.height", "mask"][..], "HEIGHT", Some("terrain.height")),
            (&["terrain.height", "mask"][..], "terrain.Height", Some("terrain.height")),
            (&["Y", "mask.Y"][..], "y", Some("Y")),
            (&["Y", "y"][..], "y", Some("y")),
            (&["a.Y", "b.Y"][..], "Y", None),
            (&["a.Y", "b.Y"][..], "Z", None),
            (&["a.Y", "b.y"][..], "Y", Some("a.Y")),
        ] {
            assert_eq!(part(names).channel(wanted).map(|channel| channel.name.as_str()), found, "{wanted} of {names:?}");
        }
        let chosen = |names: &[&str], choose: fn(&Channels<'_>) -> Option<String>| choose(&part(names).all());
        let base: fn(&Channels<'_>) -> Option<String> = |all| all.with_base("Y").map(|channel| channel.name.clone());
        assert_eq!(chosen(&["Y", "mask.Y"], base), None, "base names alone do not tell these apart");
        assert_eq!([chosen(&["y", "X"], base), chosen(&["y", "a.Y"], base)], [Some("y".to_owned()), Some("a.Y".to_owned())]);
        let single: fn(&Channels<'_>) -> Option<String> = |all| all.single().map(|channel| channel.name.clone());
        assert_eq!([chosen(&["A", "Z"], single), chosen(&["x.a", "x.Z"], single)], [Some("Z".to_owned()), Some("x.Z".to_owned())]);
        assert_eq!([chosen(&["A"], single), chosen(&["Y", "Z"], single)], [None, None]);
    }

    #[test]
    fn what_is_not_supported_is_named() {
        let refused = |bytes: &[u8], says: &[&str]| {
            let text = read_all(bytes).unwrap_err();
            assert!(says.iter().all(|part| text.contains(part)), "{text}");
        };
        assert!(read_all(&small()).is_ok());
        let deep = changed(small(), b"type\0string\0\x0d\0\0\0scanlineimage", b"type\0string\0\x0c\0\0\0deepscanline");
        refused(&deep, &["deep data"]);
        // The fields of a channel: name, type, linearity, and the numbers of columns and rows for each sample.
        let channel = |across: u8| [b"R\0\x02\0\0\0\0\0\0\0".as_slice(), &[across, 0, 0, 0, 1, 0, 0, 0]].concat();
        refused(&changed(small(), &channel(1), &channel(2)), &["`R`", "subsampled", "2 x 1"]);
        refused(&changed(small(), b"Y\0\x02\0\0\0", b"R\0\x02\0\0\0"), &["two channels `R`"]);
        let compression = |code: u8| [b"compression\0compression\0\x01\0\0\0".as_slice(), &[code]].concat();
        refused(&changed(small(), &compression(0), &compression(99)), &["compression", "not supported"]);
        let inexact = e::FlatSamples::U32(vec![0, 1, 2, 3, 4, 16_777_217]);
        refused(&bytes_of(layer(None, (0, 0), (3, 2), SCAN_LINES, &[("id", inexact)])), &["`id`", "16777217", "exactly"]);
    }

    #[test]
    fn sizes_are_checked_before_memory_is_allocated() {
        let window = |name: &str, [left, top, right, bottom]: [i32; 4]| {
            [name.as_bytes(), b"\0box2i\0\x10\0\0\0", &[left, top, right, bottom].map(i32::to_le_bytes).concat()].concat()
        };
        let whole = [0, 0, 2, 1];
        for name in ["dataWindow", "displayWindow"] {
            // Corners are inclusive, so 0 to 100 is one pixel wider than the limit of 100. The second window is nearly the largest one that
            // the crate accepts. The third is the largest one of the format, which the crate refuses.
            for corners in [[0, 0, 100, 1], [-1_000_000_000, 0, 1_000_000_000, 1], [i32::MIN, i32::MIN, i32::MAX, i32::MAX]] {
                let text = read_all(&changed(small(), &window(name, whole), &window(name, corners))).unwrap_err();
                assert!(text.contains("window") || text.contains("box") || text.contains("chunk count"), "{text}");
            }
        }
        let wide = changed(small(), &window("displayWindow", whole), &window("displayWindow", [0, 0, 100, 1]));
        assert!(matches!(read(Cursor::new(&wide), 100), Err(Fault::TooLarge(_))));
        assert!(read(Cursor::new(&wide), 101).is_ok());
        let limits = |pixels| Limits { side: 100, pixels };
        assert!(matches!(read_within(Cursor::new(small()), limits(5)), Err(Fault::TooLarge(_))));
        assert!(read_within(Cursor::new(small()), limits(6)).is_ok());
        // A single tile that claims 65536 x 65536 pixels.
        let tiles = e::Encoding { blocks: e::Blocks::Tiles(e::Vec2(4, 4)), ..SCAN_LINES };
        let tiled = bytes_of(layer(None, (0, 0), (3, 2), tiles, &[("Y", e::FlatSamples::F32(ramp(6)))]));
        assert!(read_all(&tiled).is_ok());
        let size = |edge: u32| [b"tiles\0tiledesc\0\x09\0\0\0".as_slice(), &edge.to_le_bytes(), &edge.to_le_bytes()].concat();
        let text = read_all(&changed(tiled, &size(4), &size(65_536))).unwrap_err();
        assert!(text.contains("65536 x 65536"), "{text}");
    }

    #[test]
    fn a_block_may_not_claim_more_than_its_pixels() {
        let encoding = e::Encoding { compression: e::Compression::DWAA(None), ..SCAN_LINES };
        let samples = e::FlatSamples::F32((0..1024).map(|i| 0.25 + (i % 32) as f32 / 64.0).collect());
        let channels = ["R", "G", "B"].map(|name| (name, samples.clone()));
        let bytes = bytes_of(layer(None, (0, 0), (32, 32), encoding, &channels));
        let parts = read_all(&bytes).unwrap();
        assert_eq!(parts[0].lossy, Some("DWAA"));
        // DWAA has an error that is relative to the value. The tolerance of 1/16 is far above this error.
        let red = parts[0].channel("R").expect("a channel R");
        assert!(red.samples.iter().enumerate().all(|(i, v)| (v - 0.25 - (i % 32) as f32 / 64.0).abs() < 0.0625), "{:?}", red.samples);
        // The table has 8 bytes, because there is one block. The block begins with its row and its length, which take 8 bytes. The eleven
        // counters follow.
        let counters = table(&bytes, 1) + 8 + 8;
        for index in [1, 6, 7, 8, 9] {
            let mut claims = bytes.clone();
            claims[counters + 8 * index..][..8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
            let text = read_all(&claims).unwrap_err();
            assert!(text.contains("more data than its number of pixels"), "{index}: {text}");
        }
    }

    #[test]
    fn missing_blocks_and_missing_bytes_are_noticed() {
        let bytes = small();
        let table = table(&bytes, 2);
        // Both entries lead to the first row. If the reader did not notice it, the pixels of the second row would stay 0.
        let mut twice = bytes.clone();
        twice.copy_within(table..table + 8, table + 8);
        let text = read_all(&twice).unwrap_err();
        assert!(text.contains("missing"), "{text}");
        for length in 0..bytes.len() {
            assert!(matches!(read(Cursor::new(&bytes[..length]), 100), Err(Fault::Damaged(_))), "{length} of {}", bytes.len());
        }
    }
}

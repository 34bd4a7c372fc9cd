//! Reads TIFF and GeoTIFF files.
//!
//! First, the statements of a file about its samples are read into a [`Description`]. Then the samples are read as they are stored. Strips and tiles
//! of an image with LZW compression are decoded in `lzw.rs`, others by the crate `tiff` (TIFF 6.0, sections 7 to 15; *TIFF Technical Note 3* for
//! float predictors).
//!
//! A height is the stored number, as in GDAL. But the crate would invert samples if the photometric interpretation of the image is WhiteIsZero, and
//! would refuse masks. Therefore the crate reads a [`Patched`] file, in which the interpretation is BlackIsZero.
//!
//! Of several images, the first one of full resolution is read; if there is none, the first image. Images that belong to another image (SubIFDs) are
//! not searched.

use std::io::{self, BufRead, Read, Seek, SeekFrom};

use ::tiff::decoder::ifd::Value;
use ::tiff::decoder::{ChunkType, Decoder, DecodingResult};
use ::tiff::tags::{ByteOrder, IfdPointer, Tag, Type};
use ::tiff::{TiffError, TiffUnsupportedError};

use super::depth::Depth;
use super::gdal;
use super::geotiff::{Georeference, Tags};
use super::lzw;
use super::options::ReadOptions;
use super::raster::{Absent, Raster, Stored, turn};
use super::scaling::Statement;
use crate::decode::fault::Fault;

/// The tag GDAL_METADATA, whose value is a text.
const GDAL_METADATA: Tag = Tag::Unknown(42_112);

/// Largest length of the text of a tag, bytes.
const LONGEST_TEXT: u64 = 1 << 20;
/// Largest number of images in a file: pages, overviews and masks.
const MOST_IMAGES: usize = 1024;

/// Values of the tag Compression that can be decoded, with their names.
const COMPRESSIONS: [(u16, &str); 6] =
    [(1, "not compressed"), (5, "LZW"), (8, "Deflate"), (32_946, "Deflate"), (32_773, "PackBits"), (50_000, "ZSTD")];
/// Names of other compressions (TIFF 6.0, its supplements, and the registry of libtiff).
const UNSUPPORTED_COMPRESSIONS: [(u16, &str); 17] = [
    (2, "CCITT RLE"),
    (3, "CCITT Group 3"),
    (4, "CCITT Group 4"),
    (6, "JPEG (old)"),
    (7, "JPEG"),
    (9, "JBIG"),
    (10, "JBIG"),
    (33_003, "JPEG 2000"),
    (33_005, "JPEG 2000"),
    (34_661, "JBIG"),
    (34_676, "SGI LogL"),
    (34_712, "JPEG 2000"),
    (34_887, "LERC"),
    (34_925, "LZMA"),
    (50_001, "WebP"),
    (50_002, "JPEG XL"),
    (52_546, "JPEG XL"),
];

/// A file in which some bytes are replaced when they are read.
struct Patched<R> {
    inner: R,
    length: u64,
    position: u64,
    /// Positions in the file, and the bytes that are read there instead.
    patches: Vec<(u64, u8)>,
}

impl<R: Read> Read for Patched<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.inner.read(buffer)?;
        for &(position, byte) in &self.patches {
            let place = position.checked_sub(self.position).and_then(|offset| usize::try_from(offset).ok());
            if let Some(read) = place.and_then(|place| buffer[..count].get_mut(place)) {
                *read = byte;
            }
        }
        self.position += count as u64;
        Ok(count)
    }
}

impl<R: Seek> Seek for Patched<R> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        // A position beyond the end is reported as damage. Without this check, the operating system could refuse a huge position, and that would
        // look like an error of the disk.
        if let SeekFrom::Start(position) = to
            && position > self.length
        {
            return Err(io::ErrorKind::UnexpectedEof.into());
        }
        self.position = self.inner.seek(to)?;
        Ok(self.position)
    }
}

type File<R> = Decoder<Patched<R>>;

/// The statements of a file about one of its images, and the positions of the samples.
struct Layout {
    size: [u32; 2],
    bits: u64,
    /// The tag SampleFormat: 1 = unsigned, 2 = signed, 3 = float.
    format: u64,
    bands: u64,
    photometric: u64,
    /// Whether a band beyond those of the photometric interpretation is alpha.
    has_alpha: bool,
    compression: &'static str,
    is_compressed: bool,
    /// The tag Predictor, if the compression is LZW.
    lzw_predictor: Option<u64>,
    /// Width and height of a strip or tile, in samples.
    chunk: [u32; 2],
    is_tiled: bool,
    offsets: Vec<u64>,
    byte_counts: Vec<u64>,
}

/// An image of a file.
#[derive(Clone, Copy)]
struct Place {
    /// Index in the list of images, from 0.
    index: usize,
    directory: IfdPointer,
}

/// The images of a file that are used.
struct Images {
    /// The image that is read: the first one of full resolution; if there is none, the first image of the file.
    main: Place,
    /// The mask, which says which samples have data.
    mask: Option<Place>,
    /// Number of other images of full resolution.
    others: usize,
    /// Whether all images are of reduced resolution, or masks.
    is_reduced: bool,
}

/// The statements of a file that are used.
struct Description {
    layout: Layout,
    depth: Depth,
    statement: Statement,
    no_data: Option<f64>,
    georeference: Georeference,
    is_geotiff: bool,
}

/// The part of a strip or tile inside the image, in samples of the image.
#[derive(Clone, Copy)]
struct Chunk {
    index: u32,
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

/// Reads a file with one band.
pub(super) fn read(mut input: impl BufRead + Seek, options: &ReadOptions) -> Result<Raster, Fault> {
    let length = input.seek(SeekFrom::End(0)).and_then(|length| input.rewind().map(|()| length)).map_err(Fault::of_io)?;
    let mut file = Decoder::new(Patched { inner: input, length, position: 0, patches: Vec::new() }).map_err(fault)?;
    let images = Images::find(&mut file)?;
    if images.main.index > 0 {
        file.seek_to_image(images.main.index).map_err(fault)?;
    }
    let description = Description::read(&mut file)?;
    let [width, height] = description.layout.size;
    let window = options.window_of([width, height], true)?;
    let Georeference { is_south_up, is_mirrored, .. } = description.georeference;
    // The window is counted from the north-west corner; in the file, this corner need not be the first sample.
    let [x, y, w, h] = window;
    let in_file = [if is_mirrored { width - x - w } else { x }, if is_south_up { height - y - h } else { y }, w, h];
    let mut notes = images.notes();
    notes.extend(description.notes());
    read_as_black_is_zero(&mut file, images.main)?;
    let (mut stored, mut absent) = samples(&mut file, &description, in_file, &mut notes)?;
    if let Some(mask) = images.mask {
        hide(&mut file, mask, &description.layout, in_file, &mut absent)?;
    }
    match &mut stored {
        Stored::Single(samples) => turn(samples, w as usize, is_south_up, is_mirrored),
        Stored::Double(samples) => turn(samples, w as usize, is_south_up, is_mirrored),
    }
    turn(&mut absent, w as usize, is_south_up, is_mirrored);
    Ok(Raster {
        format: description.words(),
        file_size: [width, height],
        window,
        depth: description.depth,
        holds_codes: false,
        stored,
        absent,
        no_data: description.no_data,
        statement: description.statement,
        orientation: match (is_south_up, is_mirrored, description.is_geotiff) {
            (true, true, _) => "rows run from south to north and columns from east to west in the file; turned",
            (true, false, _) => "rows run from south to north in the file; turned",
            (false, true, _) => "columns run from east to west in the file; turned",
            (false, false, true) => "row 0 is north",
            (false, false, false) => "row 0 is taken as north",
        },
        spacing: description.georeference.spacing,
        notes,
    })
}

impl Layout {
    /// Reads the layout of the current image of the file.
    fn read<R: Read + Seek>(file: &mut File<R>) -> Result<Layout, Fault> {
        let (width, height) = file.dimensions().map_err(fault)?;
        let code = first(file, Tag::Compression)?.unwrap_or(1);
        let supported = COMPRESSIONS.iter().find(|(known, _)| u64::from(*known) == code);
        let Some(&(_, compression)) = supported else {
            let name = UNSUPPORTED_COMPRESSIONS.iter().find(|(known, _)| u64::from(*known) == code);
            let name = name.map_or_else(|| code.to_string(), |(_, name)| (*name).to_owned());
            return Err(Fault::Unsupported(format!(
                "compression {name} is not supported; convert it with gdal_translate -co COMPRESS=DEFLATE IN OUT.tif"
            )));
        };
        for (tag, usual, what) in [
            (Tag::FillOrder, 1, "its bits are stored in reverse order (FillOrder"),
            (Tag::Orientation, 1, "its rows and columns do not run from the top left corner (Orientation"),
        ] {
            if let Some(other) = first(file, tag)?.filter(|&value| value != usual) {
                return Err(Fault::Unsupported(format!(
                    "{what} {other}); write it anew with gdal_translate IN OUT.tif, and check which edge is north"
                )));
            }
        }
        let is_tiled = file.get_chunk_type() == ChunkType::Tile;
        let (chunk_width, chunk_height) = file.chunk_dimensions();
        let places = if is_tiled { [Tag::TileOffsets, Tag::TileByteCounts] } else { [Tag::StripOffsets, Tag::StripByteCounts] };
        let [offsets, byte_counts] = places.map(|tag| file.find_tag_unsigned_vec::<u64>(tag));
        let extra = file.find_tag_unsigned_vec::<u64>(Tag::ExtraSamples).map_err(fault)?.unwrap_or_default();
        Ok(Layout {
            size: [width, height],
            bits: first(file, Tag::BitsPerSample)?.unwrap_or(1),
            format: first(file, Tag::SampleFormat)?.unwrap_or(1),
            bands: first(file, Tag::SamplesPerPixel)?.unwrap_or(1),
            photometric: first(file, Tag::PhotometricInterpretation)?.unwrap_or(1),
            has_alpha: extra.iter().any(|kind| [1, 2].contains(kind)),
            compression,
            is_compressed: code != 1,
            lzw_predictor: if code == 5 { Some(lzw_predictor(file)?) } else { None },
            chunk: [chunk_width.max(1), chunk_height.max(1)],
            is_tiled,
            offsets: offsets.map_err(fault)?.unwrap_or_default(),
            byte_counts: byte_counts.map_err(fault)?.unwrap_or_default(),
        })
    }

    /// The type of the samples. An error if a heightmap cannot have such samples.
    fn depth(&self) -> Result<Depth, Fault> {
        let refuse = |what: String| Err(Fault::Unsupported(what));
        let bits = self.bits;
        if self.bands != 1 {
            let bands = self.bands;
            let what = match (self.photometric, self.has_alpha) {
                (2, _) => "red, green and blue",
                (_, true) => "the last one is alpha",
                _ => "which may all be heights",
            };
            return refuse(format!(
                "it has {bands} bands ({what}), but a heightmap has one; export the band of heights, for example with gdal_translate -b 1 IN OUT.tif"
            ));
        }
        if !matches!(self.photometric, 0 | 1) {
            let what = if self.photometric == 3 { "numbers of colours in a palette" } else { "colours" };
            return refuse(format!(
                "its samples are {what} (photometric interpretation {}), not heights; export the heights as one grey band",
                self.photometric
            ));
        }
        match (self.format, bits) {
            (1 | 2, ..=8) => refuse(format!(
                "its samples have {bits} bits, which are {} levels and show as terraces; export 16-bit integers or 32-bit floats",
                1u32 << bits
            )),
            (1, 16) => Ok(Depth::Unsigned16),
            (2, 16) => Ok(Depth::Signed16),
            (1, 32) => Ok(Depth::Unsigned32),
            (2, 32) => Ok(Depth::Signed32),
            (3, 16) => Ok(Depth::Half),
            (3, 32) => Ok(Depth::Single),
            (3, 64) => Ok(Depth::Double),
            (1 | 2, 64) => refuse(
                "its samples are 64-bit integers, which are not supported; convert them with gdal_translate -ot Float64 IN OUT.tif"
                    .to_owned(),
            ),
            (1 | 2, 9..=15) => refuse(format!(
                "its samples have {bits} bits, which is not supported; convert them with gdal_translate -ot UInt16 -co NBITS=16 IN OUT.tif"
            )),
            (1..=3, _) => {
                let kind = if self.format == 3 { "floats" } else { "integers" };
                refuse(format!(
                    "its samples are {bits}-bit {kind}, which are not supported; convert them with gdal_translate -ot Float32 IN OUT.tif"
                ))
            }
            (format, _) => refuse(format!(
                "its samples are of an unknown or complex type (SampleFormat {format}); convert them with gdal_translate -ot Float32 IN OUT.tif"
            )),
        }
    }

    /// Calls `with` for each strip or tile that overlaps a window of a one-band image.
    fn each_chunk(&self, [x, y, w, h]: [u32; 4], mut with: impl FnMut(Chunk) -> Result<(), Fault>) -> Result<(), Fault> {
        let [width, height] = self.size.map(|n| n as usize);
        let [chunk_width, chunk_height] = self.chunk.map(|n| n as usize);
        let (x, y, w, h) = (x as usize, y as usize, w as usize, h as usize);
        let across = width.div_ceil(chunk_width);
        for row in y / chunk_height..=(y + h - 1) / chunk_height {
            for column in x / chunk_width..=(x + w - 1) / chunk_width {
                let index =
                    u32::try_from(row * across + column).map_err(|_| Fault::Damaged("it has too many strips or tiles".to_owned()))?;
                let (left, top) = (column * chunk_width, row * chunk_height);
                with(Chunk { index, left, top, width: chunk_width.min(width - left), height: chunk_height.min(height - top) })?;
            }
        }
        Ok(())
    }

    /// Reads the bytes of a strip or tile.
    fn stream<R: Read + Seek>(&self, file: &mut File<R>, chunk: Chunk) -> Result<Vec<u8>, Fault> {
        let [Some(&offset), Some(&length)] = [&self.offsets, &self.byte_counts].map(|places| places.get(chunk.index as usize)) else {
            return Err(Fault::Damaged(format!("its {} {} has no place in the file", self.chunk_name(), chunk.index)));
        };
        let input = file.inner();
        input.seek(SeekFrom::Start(offset)).map_err(Fault::of_io)?;
        let mut bytes = Vec::new();
        // Memory is allocated only for bytes that the file holds, even if `length` is larger.
        input.take(length).read_to_end(&mut bytes).map_err(Fault::of_io)?;
        Ok(bytes)
    }

    /// Whether the file holds a strip or tile. GDAL may leave out strips and tiles without data; their offset and length are then 0.
    fn holds(&self, chunk: Chunk) -> Result<bool, Fault> {
        let at = chunk.index as usize;
        let (Some(&offset), Some(&length)) = (self.offsets.get(at), self.byte_counts.get(at)) else {
            return Err(Fault::Damaged(format!("it has no {} {at}", self.chunk_name())));
        };
        if offset == 0 && length == 0 {
            return Ok(false);
        }
        if offset == 0 || length == 0 {
            return Err(Fault::Damaged(format!("its {} {at} has the offset {offset}, but the length {length}", self.chunk_name())));
        }
        if !self.is_compressed {
            // A tile is stored whole, a strip only as far as the image reaches.
            let [columns, rows] = if self.is_tiled { self.chunk.map(u64::from) } else { [chunk.width as u64, chunk.height as u64] };
            let row_bytes = columns.saturating_mul(self.bits).saturating_mul(self.bands).div_ceil(8);
            let needed = row_bytes.saturating_mul(rows);
            if length < needed {
                return Err(Fault::Damaged(format!("its {} {at} has {length} bytes, but needs {needed}", self.chunk_name())));
            }
        }
        Ok(true)
    }

    fn chunk_name(&self) -> &'static str {
        if self.is_tiled { "tile" } else { "strip" }
    }
}

impl Description {
    fn read<R: Read + Seek>(file: &mut File<R>) -> Result<Description, Fault> {
        let layout = Layout::read(file)?;
        let depth = layout.depth()?;
        let xml = text(file, GDAL_METADATA)?;
        let mut statement = xml.as_deref().map(gdal::statement).transpose()?.unwrap_or_default();
        let no_data = text(file, Tag::GdalNodata)?.as_deref().map(gdal::no_data).transpose()?.flatten();
        let tags = Tags {
            pixel_scale: floats(file, Tag::ModelPixelScaleTag)?,
            tie_points: floats(file, Tag::ModelTiepointTag)?,
            transformation: floats(file, Tag::ModelTransformationTag)?,
            keys: file.find_tag_unsigned_vec::<u64>(Tag::GeoKeyDirectoryTag).map_err(fault)?,
            doubles: floats(file, Tag::GeoDoubleParamsTag)?.unwrap_or_default(),
        };
        let georeference = Georeference::read(&tags, layout.size)?;
        match (statement.unit, georeference.vertical_unit) {
            (Some(one), Some(other)) if one != other => {
                return Err(Fault::Contradictory(format!(
                    "its metadata state the unit {} for heights, but its vertical system the unit {}",
                    one.name, other.name
                )));
            }
            (one, other) => statement.unit = one.or(other),
        }
        Ok(Description { layout, depth, statement, no_data, georeference, is_geotiff: !tags.is_empty() })
    }

    /// Kind of file and of samples, in words.
    fn words(&self) -> String {
        let Layout { compression, chunk: [width, height], size: [_, rows], is_tiled, .. } = self.layout;
        let chunks = if is_tiled { format!("tiles of {width} x {height}") } else { format!("strips of {} rows", height.min(rows)) };
        format!("{}, {}, {compression}, {chunks}", if self.is_geotiff { "GeoTIFF" } else { "TIFF" }, self.depth.words())
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        if self.layout.photometric == 0 {
            notes.push("photometric interpretation WhiteIsZero: heights are the stored numbers, not inverted".to_owned());
        }
        if let (Some([smallest, largest]), Some(value)) = (self.depth.limits(), self.no_data)
            && !((smallest..=largest).contains(&value) && value.fract() == 0.0)
        {
            notes.push(format!("no sample can have the no-data value {value} of the file: samples are {}", self.depth.words()));
        }
        if let (Some(linear), None) = (self.georeference.linear_unit.filter(|unit| !unit.is_metre()), self.statement.unit) {
            notes.push(format!(
                "the unit of distances is the {}, but the unit of heights is not stated; heights are not converted",
                linear.name
            ));
        }
        if let (Some(system), None) = (self.georeference.vertical_system_without_unit, self.statement.unit) {
            notes.push(format!(
                "the unit of its vertical system (code {system}) is not known, and the file does not state one; heights are not converted"
            ));
        }
        notes
    }
}

impl Images {
    /// Goes through the list of images, and finds those that are used (TIFF 6.0, NewSubfileType: bit 0 = reduced resolution, bit 2 = mask).
    fn find<R: Read + Seek>(file: &mut File<R>) -> Result<Images, Fault> {
        let first = file.ifd_pointer().ok_or_else(|| Fault::Damaged("it has no image".to_owned()))?;
        let (mut full, mut mask, mut others, mut index) = (None, None, 0, 0);
        let mut next = Some(first);
        while let Some(directory) = next {
            if index >= MOST_IMAGES {
                return Err(Fault::Damaged(format!("its list of images has no end, or more than {MOST_IMAGES} images")));
            }
            let tags = file.read_directory(directory).map_err(fault)?;
            let kind = file.read_directory_tags(&tags).find_tag_unsigned::<u64>(Tag::NewSubfileType).map_err(fault)?.unwrap_or(0);
            let image = Place { index, directory };
            match (kind & 4 != 0, kind & 1 != 0) {
                (true, false) if mask.is_none() => mask = Some(image),
                (true, false) => return Err(Fault::Contradictory("it has two masks".to_owned())),
                (false, false) if full.is_none() => full = Some(image),
                (false, false) => others += 1,
                (_, true) => {}
            }
            index += 1;
            next = tags.next();
        }
        let main = full.unwrap_or(Place { index: 0, directory: first });
        Ok(Images { main, mask: mask.filter(|mask| mask.index != main.index), others, is_reduced: full.is_none() })
    }

    fn notes(&self) -> Vec<String> {
        let mut notes = Vec::new();
        let number = self.main.index + 1;
        if self.is_reduced {
            notes.push(
                "the file says that its first image is of reduced resolution or a mask, but has no other; that image is read".to_owned(),
            );
        } else if number > 1 {
            notes.push(format!(
                "image {number} of the file is read, the first one of full resolution; those before it are thumbnails or masks"
            ));
        }
        if self.others > 0 {
            let noun = if self.others == 1 { "image" } else { "images" };
            notes.push(format!("the file has {} more {noun} of full resolution; the first one is read", self.others));
        }
        notes
    }
}

/// Patches the file so that the photometric interpretation of an image reads as BlackIsZero, and goes to that image.
fn read_as_black_is_zero<R: Read + Seek>(file: &mut File<R>, image: Place) -> Result<(), Fault> {
    let patches = photometric_bytes(file, image.directory).map_err(Fault::of_io)?;
    file.inner().patches.extend(patches);
    file.seek_to_image(image.index).map_err(fault)
}

/// Returns the positions of the bytes of the photometric interpretation in a directory, with the bytes of BlackIsZero (the number 1).
///
/// A directory is a count and entries of tag, type, count and value (TIFF 6.0, section 2). In BigTIFF, counts and values have 8 bytes.
fn photometric_bytes<R: Read + Seek>(file: &mut File<R>, directory: IfdPointer) -> io::Result<Vec<(u64, u8)>> {
    file.goto_offset_u64(2)?;
    let is_big = file.read_short()? == 43;
    file.goto_offset_u64(directory.0)?;
    let count = if is_big { file.read_long8()? } else { u64::from(file.read_short()?) };
    let (head, entry_bytes, value_at) = if is_big { (8, 20, 12) } else { (2, 12, 8) };
    let mut patches = Vec::new();
    for number in 0..count {
        // The directory has been read before, so it is inside the file, and positions in it do not overflow.
        let entry = directory.0 + head + number * entry_bytes;
        file.goto_offset_u64(entry)?;
        let tag = file.read_short()?;
        let kind = file.read_short()?;
        if tag != Tag::PhotometricInterpretation.to_u16() {
            continue;
        }
        let width: u64 = match Type::from_u16(kind) {
            Some(Type::BYTE) => 1,
            Some(Type::SHORT) => 2,
            Some(Type::LONG) => 4,
            _ => return Err(io::Error::new(io::ErrorKind::InvalidData, "its photometric interpretation has an unusual type")),
        };
        let one_at = if file.byte_order() == ByteOrder::LittleEndian { 0 } else { width - 1 };
        patches.extend((0..width).map(|byte| (entry + value_at + byte, u8::from(byte == one_at))));
    }
    Ok(patches)
}

/// Reads the samples of a window of the current image of the file. Samples in missing strips and tiles are marked as absent if the file names a
/// no-data value. Otherwise they are 0, and a note says so.
fn samples<R: Read + Seek>(
    file: &mut File<R>,
    description: &Description,
    window: [u32; 4],
    notes: &mut Vec<String>,
) -> Result<(Stored, Vec<Option<Absent>>), Fault> {
    let Description { layout, depth, no_data, .. } = description;
    let [x, y, w, h] = window.map(|n| n as usize);
    let mut stored: Option<Stored> = None;
    let mut missing = Vec::new();
    let mut chunks = 0;
    layout.each_chunk(window, |chunk| {
        chunks += 1;
        if !layout.holds(chunk)? {
            missing.push(chunk);
            return Ok(());
        }
        let decoded = match layout.lzw_predictor {
            Some(predictor) => {
                let stream = layout.stream(file, chunk)?;
                let size = layout.chunk.map(|n| n as usize);
                let coding = lzw::Coding { depth: *depth, predictor, order: file.byte_order(), size };
                lzw::decode(&stream, coding, [chunk.width, chunk.height])?
            }
            None => file.read_chunk(chunk.index).map_err(fault)?,
        };
        // Memory is allocated only after a chunk has been decoded, because a damaged header can claim any size.
        let stored = stored.get_or_insert_with(|| Stored::zeros(*depth, w * h));
        for (row, columns) in overlap(chunk, [x, y, w, h]) {
            let from = (row - chunk.top) * chunk.width + columns.start - chunk.left;
            if !stored.put((row - y) * w + columns.start - x, &decoded, from, columns.len()) {
                return Err(Fault::Damaged(format!("its {} {} is shorter than declared", layout.chunk_name(), chunk.index)));
            }
        }
        Ok(())
    })?;
    let Some(stored) = stored else {
        return Err(Fault::Unsupported(format!(
            "it holds none of the {chunks} {}s of the part to read, so no sample has data; use another file, or choose another part of it with --window",
            layout.chunk_name()
        )));
    };
    let mut absent = Vec::new();
    if !missing.is_empty() {
        if no_data.is_some() {
            absent = vec![None; w * h];
            for (row, columns) in missing.iter().flat_map(|&chunk| overlap(chunk, [x, y, w, h])) {
                absent[(row - y) * w + columns.start - x..][..columns.len()].fill(Some(Absent::Missing));
            }
        } else {
            notes.push(format!(
                "{} of {chunks} {}s are not in the file, and the file states no no-data value, so their samples are 0",
                missing.len(),
                layout.chunk_name()
            ));
        }
    }
    Ok((stored, absent))
}

/// The rows of a chunk that are inside a window, each with the range of its columns inside the window. Rows and columns are counted in the
/// image.
fn overlap(chunk: Chunk, [x, y, w, h]: [usize; 4]) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> {
    let columns = chunk.left.max(x)..(chunk.left + chunk.width).min(x + w);
    let rows = chunk.top.max(y)..(chunk.top + chunk.height).min(y + h);
    rows.map(move |row| (row, columns.clone())).filter(|(_, columns)| !columns.is_empty())
}

/// Marks the samples that the mask hides: those whose mask value is 0, and those whose strip or tile is missing in the mask.
fn hide<R: Read + Seek>(
    file: &mut File<R>,
    mask: Place,
    image: &Layout,
    window: [u32; 4],
    absent: &mut Vec<Option<Absent>>,
) -> Result<(), Fault> {
    read_as_black_is_zero(file, mask)?;
    let layout = Layout::read(file)?;
    if layout.size != image.size {
        let ([mask_width, mask_height], [width, height]) = (layout.size, image.size);
        return Err(Fault::Contradictory(format!("its mask has {mask_width} x {mask_height} samples, but the image {width} x {height}")));
    }
    if layout.bands != 1 || layout.format != 1 || ![1, 8].contains(&layout.bits) {
        return Err(Fault::Unsupported(format!(
            "its mask has {} of {} bits, but must have one band of 1 or 8 bits; write it anew with gdal_translate IN OUT.tif",
            if layout.bands == 1 { "1 band".to_owned() } else { format!("{} bands", layout.bands) },
            layout.bits
        )));
    }
    let [x, y, w, h] = window.map(|n| n as usize);
    absent.resize(w * h, None);
    layout.each_chunk(window, |chunk| {
        let decoded = if layout.holds(chunk)? { Some(file.read_chunk(chunk.index).map_err(fault)?) } else { None };
        let bytes: &[u8] = match &decoded {
            None => &[],
            Some(DecodingResult::U8(bytes)) => bytes,
            Some(_) => return Err(Fault::Damaged("its mask has samples of an unexpected type".to_owned())),
        };
        let row_bytes = if layout.bits == 1 { chunk.width.div_ceil(8) } else { chunk.width };
        if decoded.is_some() && bytes.len() < row_bytes * chunk.height {
            return Err(Fault::Damaged(format!("{} {} of its mask is shorter than declared", layout.chunk_name(), chunk.index)));
        }
        for (row, columns) in overlap(chunk, [x, y, w, h]) {
            for column in columns {
                let (across, start) = (column - chunk.left, (row - chunk.top) * row_bytes);
                // In a mask with 1 bit per sample, the first sample of a byte is its highest bit.
                let byte = bytes.get(start + if layout.bits == 1 { across / 8 } else { across }).copied().unwrap_or(0);
                let is_data = if layout.bits == 1 { (byte >> (7 - across % 8)) & 1 == 1 } else { byte != 0 };
                let sample = &mut absent[(row - y) * w + column - x];
                if !is_data && sample.is_none() {
                    *sample = Some(Absent::Masked);
                }
            }
        }
        Ok(())
    })?;
    if absent.iter().all(Option::is_none) {
        absent.clear();
    }
    Ok(())
}

/// The first number of a tag.
fn first<R: Read + Seek>(file: &mut File<R>, tag: Tag) -> Result<Option<u64>, Fault> {
    Ok(file.find_tag_unsigned_vec::<u64>(tag).map_err(fault)?.and_then(|numbers| numbers.first().copied()))
}

/// The floats of a tag.
fn floats<R: Read + Seek>(file: &mut File<R>, tag: Tag) -> Result<Option<Vec<f64>>, Fault> {
    let one = |value: &Value| match value {
        Value::Double(number) => Some(*number),
        Value::Float(number) => Some(f64::from(*number)),
        _ => None,
    };
    let Some(value) = file.find_tag(tag).map_err(fault)? else { return Ok(None) };
    let numbers: Option<Vec<f64>> = match &value {
        Value::List(values) => values.iter().map(one).collect(),
        single => one(single).map(|number| vec![number]),
    };
    numbers.map(Some).ok_or_else(|| Fault::Damaged(format!("its tag {} holds no floats", tag.to_u16())))
}

/// The text of a tag, up to the first NUL.
fn text<R: Read + Seek>(file: &mut File<R>, tag: Tag) -> Result<Option<String>, Fault> {
    let mut tags = file.image_ifd();
    let Some(entry) = tags.find_entry(tag) else { return Ok(None) };
    let damaged = |what: &str| Fault::Damaged(format!("its tag {} {what}", tag.to_u16()));
    if !matches!(entry.field_type(), Type::ASCII | Type::BYTE | Type::UNDEFINED) {
        return Err(damaged("holds no text"));
    }
    if entry.count() > LONGEST_TEXT {
        return Err(damaged("claims a text of more than 1 MiB"));
    }
    let mut bytes = vec![0; entry.count() as usize];
    tags.find_tag_bytes(tag, &mut bytes, 0).map_err(fault)?;
    let end = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    Ok(Some(String::from_utf8_lossy(&bytes[..end]).into_owned()))
}

/// The tag Predictor of an LZW-compressed image (TIFF 6.0, section 14; *TIFF Technical Note 3*).
fn lzw_predictor<R: Read + Seek>(file: &mut File<R>) -> Result<u64, Fault> {
    match first(file, Tag::Predictor)?.unwrap_or(1) {
        predictor @ 1..=3 => Ok(predictor),
        other => Err(Fault::Unsupported(format!("its predictor {other} is not known; write it anew with gdal_translate IN OUT.tif"))),
    }
}

/// Converts an error of the decoder.
fn fault(error: TiffError) -> Fault {
    match error {
        TiffError::IoError(source) => Fault::of_io(source),
        TiffError::LimitsExceeded => Fault::TooLarge(
            "a strip, a tile or a tag is larger than 256 MiB; write it anew with gdal_translate -co TILED=YES -co COMPRESS=DEFLATE IN OUT.tif"
                .to_owned(),
        ),
        TiffError::UnsupportedError(what) => Fault::Unsupported(match what {
            TiffUnsupportedError::InconsistentBitsPerSample(_) => {
                "its bands have different numbers of bits; export the band of heights with gdal_translate -b 1 IN OUT.tif".to_owned()
            }
            TiffUnsupportedError::UnsupportedSampleFormat(_) => {
                "its bands have different or unknown types; export the band of heights with gdal_translate -b 1 IN OUT.tif".to_owned()
            }
            TiffUnsupportedError::UnknownInterpretation => {
                "its photometric interpretation is missing or unknown; write it anew with gdal_translate IN OUT.tif".to_owned()
            }
            other => format!("its layout is not supported ({other}); write it anew with gdal_translate -co COMPRESS=DEFLATE IN OUT.tif"),
        }),
        other => Fault::Damaged(other.to_string()),
    }
}

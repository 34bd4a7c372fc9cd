//! Tests of heightmap files: formats, windows (rectangular parts of a file), imports as scenes, and the errors for bad files.

use std::fs;
use std::path::{Path, PathBuf};

use kernels::base::error::Error;
use kernels::decode::heightmap::{self, Heightmap, ReadOptions};
use kernels::import::scene_folder::{self, ImportOptions};
use kernels::scene::{self, Scene};
use kernels::world::{NodeId, PaletteMeans, World};

/// A temporary folder of one test, removed when it is dropped.
struct Temp(PathBuf);

impl Temp {
    fn new(name: &str) -> Temp {
        let folder = std::env::temp_dir().join(format!("scree-test-{name}-{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a temporary folder");
        Temp(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }
}

impl Drop for Temp {
    fn drop(&mut self) {
        drop(fs::remove_dir_all(&self.0));
    }
}

fn read(path: &Path, options: &ReadOptions) -> Result<Heightmap, Error> {
    heightmap::read(path, options).map(|reading| reading.map)
}

fn import(source: &Path, read: &ReadOptions, materials: Option<&Path>, detail_m: f64, out: &Path) -> Result<Scene, Error> {
    let options = ImportOptions { read: read.clone(), materials: materials.map(Path::to_owned), tile_m: None, detail_m };
    scene_folder::import(source, &options, out)
}

const SIZE: [u32; 2] = [37, 29];
const RANGE: [f64; 2] = [100.0, 900.0];

/// Sample of a bumpy slope that rises to the east. No two rows or columns are equal.
fn value(x: u32, y: u32) -> u16 {
    (x * 1100 + y * 310 + (x * y) % 97 * 60) as u16
}

fn options() -> ReadOptions {
    ReadOptions { metres_per_texel: Some(5.0), height_range_m: Some(RANGE), ..ReadOptions::default() }
}

fn values(size: [u32; 2]) -> Vec<u16> {
    (0..size[0] * size[1]).map(|i| value(i % size[0], i / size[0])).collect()
}

fn metres(v: u16) -> f32 {
    (RANGE[0] + (RANGE[1] - RANGE[0]) * f64::from(v) / 65535.0) as f32
}

fn write_png16(path: &Path, size: [u32; 2], values: &[u16]) {
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(size[0], size[1], values.to_vec())
        .expect("as many samples")
        .save(path)
        .expect("written");
}

fn write_exr(path: &Path, size: [u32; 2], at: impl Fn(usize, usize) -> f32 + Sync) {
    use exr::prelude::*;
    let channels = SpecificChannels::build().with_channel("Y").with_pixel_fn(|p: Vec2<usize>| (at(p.0, p.1),));
    Image::from_channels((size[0] as usize, size[1] as usize), channels).write().non_parallel().to_file(path).expect("written");
}

/// Writes a little-endian TIFF with one band, uncompressed, with `rows` rows per strip; `format`: 1 = unsigned, 2 = signed, 3 = float.
fn write_tiff(path: &Path, size: [u32; 2], rows: u32, bits: u32, format: u32, samples: &[u8]) {
    let strips = size[1].div_ceil(rows);
    let row_bytes = size[0] * bits / 8;
    let data_start = 8 + 2 + 11 * 12 + 4 + strips * 8;
    let tables = data_start - strips * 8;
    let mut file = b"II*\0\x08\0\0\0\x0b\0".to_vec();
    let mut entry = |tag: u16, kind: u16, count: u32, value: u32| {
        file.extend_from_slice(&tag.to_le_bytes());
        file.extend_from_slice(&kind.to_le_bytes());
        file.extend_from_slice(&count.to_le_bytes());
        file.extend_from_slice(&value.to_le_bytes());
    };
    let strip_bytes = |s: u32| rows.min(size[1] - s * rows) * row_bytes;
    entry(256, 4, 1, size[0]);
    entry(257, 4, 1, size[1]);
    entry(258, 3, 1, bits);
    entry(259, 3, 1, 1);
    entry(262, 3, 1, 1);
    // If there is only one strip, its offset and length are stored in the entries themselves.
    entry(273, 4, strips, if strips == 1 { data_start } else { tables });
    entry(277, 3, 1, 1);
    entry(278, 4, 1, rows);
    entry(279, 4, strips, if strips == 1 { strip_bytes(0) } else { tables + strips * 4 });
    entry(284, 3, 1, 1);
    entry(339, 3, 1, format);
    file.extend_from_slice(&[0; 4]);
    for s in 0..strips {
        file.extend_from_slice(&(data_start + s * rows * row_bytes).to_le_bytes());
    }
    for s in 0..strips {
        file.extend_from_slice(&strip_bytes(s).to_le_bytes());
    }
    file.extend_from_slice(samples);
    fs::write(path, file).expect("written");
}

fn bytes(values: &[u16], big: bool) -> Vec<u8> {
    values.iter().flat_map(|v| if big { v.to_be_bytes() } else { v.to_le_bytes() }).collect()
}

/// Writes the same ground as PNG, as raw files of both byte orders, as OpenEXR, and as TIFF of three sample types. Returns the files, with the
/// options for reading each of them.
fn every_format(temp: &Temp) -> Vec<(PathBuf, ReadOptions)> {
    let values = values(SIZE);
    write_png16(&temp.path("h.png"), SIZE, &values);
    fs::write(temp.path("little.raw"), bytes(&values, false)).expect("written");
    fs::write(temp.path("big.r16"), bytes(&values, true)).expect("written");
    write_exr(&temp.path("h.exr"), SIZE, |x, y| metres(value(x as u32, y as u32)));
    write_tiff(&temp.path("h.tif"), SIZE, 8, 16, 1, &bytes(&values, false));
    let signed: Vec<u8> = values.iter().flat_map(|&v| ((i32::from(v) - 32768) as i16).to_le_bytes()).collect();
    write_tiff(&temp.path("signed.tif"), SIZE, 29, 16, 2, &signed);
    let floats: Vec<u8> = values.iter().flat_map(|&v| metres(v).to_le_bytes()).collect();
    write_tiff(&temp.path("float.tiff"), SIZE, 5, 32, 3, &floats);
    let raw = ReadOptions { raw_size: Some(SIZE), ..options() };
    let float = ReadOptions { height_range_m: None, ..options() };
    vec![
        (temp.path("h.png"), options()),
        (temp.path("little.raw"), raw.clone()),
        (temp.path("big.r16"), ReadOptions { raw_big_endian: true, ..raw }),
        (temp.path("h.exr"), float.clone()),
        (temp.path("h.tif"), options()),
        (temp.path("signed.tif"), options()),
        (temp.path("float.tiff"), float),
    ]
}

#[test]
fn every_format_holds_the_same_ground() {
    let temp = Temp::new("formats");
    for (path, options) in every_format(&temp) {
        let map = read(&path, &options).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!([map.width, map.height], SIZE);
        assert_eq!(map.extent_m(), [180.0, 140.0]);
        for (i, (&got, v)) in map.samples.iter().zip(values(SIZE)).enumerate() {
            assert!((got - metres(v)).abs() < 1e-3, "{}: sample {i} is {got}, not {}", path.display(), metres(v));
        }
    }
    let wrong_order = ReadOptions { raw_size: Some(SIZE), raw_big_endian: true, ..options() };
    expect_error(read(&temp.path("little.raw"), &wrong_order), &["noise, but like terrain in the other byte order", "leave out"]);
}

#[test]
fn a_window_is_the_part_it_names() {
    let temp = Temp::new("windows");
    for (path, options) in every_format(&temp) {
        let map = read(&path, &ReadOptions { window: Some([9, 6, 13, 17]), ..options.clone() }).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!([map.width, map.height], [13, 17]);
        for y in 0..17 {
            for x in 0..13 {
                let got = map.samples[(y * 13 + x) as usize];
                assert!((got - metres(value(x + 9, y + 6))).abs() < 1e-3, "{}: {x}, {y}", path.display());
            }
        }
        let outside = ReadOptions { window: Some([30, 6, 13, 17]), ..options };
        expect_error(read(&path, &outside), &["window", "37 x 29", "move or shrink"]);
    }
}

#[test]
fn sampling_meets_the_samples_and_row_0_is_north() {
    let temp = Temp::new("sampling");
    write_png16(&temp.path("h.png"), SIZE, &values(SIZE));
    let map = read(&temp.path("h.png"), &options()).expect("readable");
    for (column, row) in [(0u32, 0u32), (36, 0), (0, 28), (12, 7), (36, 28)] {
        let (x, y) = (f64::from(column) * 5.0 - 90.0, 70.0 - f64::from(row) * 5.0);
        assert!((map.sample(x, y).0 - f64::from(metres(value(column, row)))).abs() < 1e-3, "{column}, {row}");
    }
    // Derivatives must equal difference quotients.
    for (x, y) in [(3.3, -11.9), (-42.0, 33.3), (61.0, 8.8)] {
        let (_, dx, dy) = map.sample(x, y);
        let e = 1e-4;
        let slope = |ax: f64, ay: f64| (map.sample(x + ax * e, y + ay * e).0 - map.sample(x - ax * e, y - ay * e).0) / (2.0 * e);
        assert!((dx - slope(1.0, 0.0)).abs() < 1e-5 && (dy - slope(0.0, 1.0)).abs() < 1e-5, "{x}, {y}");
    }
    let ramp = Heightmap { width: 4, height: 3, metres_per_texel: 2.0, samples: (0..12).map(|i| (i % 4) as f32 * 2.0).collect() };
    assert!((ramp.max_slope() - 1.0).abs() < 1e-12, "45 degrees");
}

fn expect_error<T>(result: Result<T, Error>, words: &[&str]) {
    let Err(error) = result else { panic!("nothing refused; expected an error with {words:?}") };
    let text = error.to_string();
    assert!(!text.contains('\n'), "one line: {text}");
    for word in words {
        assert!(text.contains(word), "`{word}` is missing in: {text}");
    }
}

#[test]
fn bad_files_are_refused_with_what_where_and_how() {
    let temp = Temp::new("bad");
    let refuse = |name: &str, options: &ReadOptions, words: &[&str]| {
        let mut all = vec![name];
        all.extend_from_slice(words);
        expect_error(read(&temp.path(name), options), &all);
    };
    let [w, h] = SIZE;

    write_png16(&temp.path("whole.png"), SIZE, &values(SIZE));
    let png = fs::read(temp.path("whole.png")).expect("just written");
    fs::write(temp.path("short.png"), &png[..png.len() / 2]).expect("written");
    refuse("short.png", &options(), &["truncated", "export it again"]);
    refuse("missing.png", &options(), &[]);
    fs::write(temp.path("h.jp2"), b"").expect("written");
    refuse("h.jp2", &options(), &["extension", ".png", ".exr"]);

    fs::write(temp.path("odd.raw"), vec![1; 1001]).expect("written");
    refuse("odd.raw", &options(), &["1001 bytes", "not a square", "size must be given"]);
    fs::write(temp.path("short.raw"), vec![1; 1000]).expect("written");
    refuse("short.raw", &ReadOptions { raw_size: Some(SIZE), ..options() }, &["37 x 29", "2146 bytes", "has 1000", "truncated"]);

    write_png16(&temp.path("flat.png"), SIZE, &vec![700; (w * h) as usize]);
    refuse("flat.png", &options(), &["all samples are", "no relief"]);
    write_png16(&temp.path("dot.png"), [1, 1], &[5]);
    refuse("dot.png", &options(), &["1 x 1", "at least 2 x 2"]);
    image::GrayImage::new(w, h).save(temp.path("bytes.png")).expect("written");
    refuse("bytes.png", &options(), &["8-bit grey", "16-bit"]);
    image::RgbImage::new(w, h).save(temp.path("colour.png")).expect("written");
    refuse("colour.png", &options(), &["8-bit colour", "16-bit"]);
    write_tiff(&temp.path("bytes.tif"), SIZE, 29, 8, 1, &vec![3; (w * h) as usize]);
    refuse("bytes.tif", &options(), &["8 bits", "16-bit"]);
    write_tiff(&temp.path("short.tif"), SIZE, 29, 16, 1, &bytes(&values(SIZE), false)[..900]);
    refuse("short.tif", &options(), &["truncated"]);

    for (name, bad, words) in [
        ("nan.exr", f32::NAN, "1 that are NaN"),
        ("infinite.exr", f32::INFINITY, "1 that are infinite"),
        ("gap.exr", -9999.0, "1 sample has the value -9999"),
    ] {
        write_exr(&temp.path(name), SIZE, |x, y| if (x, y) == (20, 11) { bad } else { x as f32 });
        refuse(name, &options(), &[words, "column 20, row 11", "--fill-voids"]);
    }
    write_exr(&temp.path("huge.exr"), SIZE, |x, y| if (x, y) == (3, 4) { 1e30 } else { x as f32 });
    refuse("huge.exr", &options(), &["column 3, row 4", "no elevation"]);

    refuse("whole.png", &ReadOptions { height_range_m: None, ..options() }, &["unknown", "--height-range LOW,HIGH"]);
    refuse("whole.png", &ReadOptions { height_range_m: Some([9.0, 1.0]), ..options() }, &["9..1", "lower elevation first"]);
    refuse("whole.png", &ReadOptions { metres_per_texel: Some(0.0), ..options() }, &["metres per texel", "above 0"]);
    refuse("whole.png", &ReadOptions { metres_per_texel: None, ..options() }, &["how far apart", "--metres-per-texel"]);
    assert!(read(&temp.path("whole.png"), &options()).is_ok(), "negative control: the good file is read");
}

#[test]
fn files_40_000_wide_are_refused_before_room_is_made() {
    let temp = Temp::new("wide");
    // The TIFF file and the PNG file consist of headers only; they hold no samples.
    write_tiff(&temp.path("wide.tif"), [40_000, 40_000], 40_000, 16, 1, &[]);
    expect_error(read(&temp.path("wide.tif"), &options()), &["40000 x 40000", "16385", "window"]);
    let mut png = b"\x89PNG\r\n\x1a\n".to_vec();
    png.extend_from_slice(&13u32.to_be_bytes());
    let header: Vec<u8> = [b"IHDR".as_slice(), &40_000u32.to_be_bytes(), &40_000u32.to_be_bytes(), &[16, 0, 0, 0, 0]].concat();
    png.extend_from_slice(&header);
    png.extend_from_slice(&crc32(&header).to_be_bytes());
    png.extend_from_slice(&[0, 0, 0, 9, b'I', b'D', b'A', b'T']);
    fs::write(temp.path("wide.png"), png).expect("written");
    expect_error(read(&temp.path("wide.png"), &options()), &["40000 x 40000", "16385", "window"]);
    // A sparse file of 3.2 GB, all zeros. The whole file is refused because of its size. A window of it is read, and refused only because it is flat.
    let file = fs::File::create(temp.path("wide.raw")).expect("created");
    if file.set_len(40_000 * 40_000 * 2).is_ok() {
        let path = temp.path("wide.raw");
        expect_error(read(&path, &options()), &["40000 x 40000", "16385", "window"]);
        let window = ReadOptions { window: Some([39_990, 39_990, 10, 10]), ..options() };
        expect_error(read(&path, &window), &["all samples are 100 m"]);
    }
}

/// CRC-32 of a PNG chunk (PNG specification, annex D).
fn crc32(data: &[u8]) -> u32 {
    !data
        .iter()
        .fold(!0u32, |crc, &byte| (0..8).fold(crc ^ u32::from(byte), |c, _| if c & 1 == 1 { 0xedb8_8320 ^ (c >> 1) } else { c >> 1 }))
}

/// Height of a sample of a valley between two walls, with cliffs, slopes and flats, as a 16-bit number.
fn valley(x: u32, y: u32) -> u16 {
    let across = (f64::from(x) - 60.0 + 9.0 * (f64::from(y) * 0.13).sin()).abs();
    let wall = ((across - 14.0) / 9.0).clamp(0.0, 1.0);
    let slope = ((across - 23.0) / 40.0).clamp(0.0, 1.0);
    let bumps = (f64::from(x) * 0.9).sin() * (f64::from(y) * 0.7).cos() * 0.01;
    ((0.1 + 0.45 * wall + 0.4 * slope + bumps) * 65535.0) as u16
}

#[test]
fn an_import_is_a_scene_that_loads_and_stands_on_its_ground() {
    let temp = Temp::new("import");
    let size = [121, 97];
    let samples: Vec<u16> = (0..size[0] * size[1]).map(|i| valley(i % size[0], i / size[0])).collect();
    write_png16(&temp.path("valley.png"), size, &samples);
    let out = temp.path("scene");
    let read_options = ReadOptions { metres_per_texel: Some(8.0), height_range_m: Some([300.0, 900.0]), ..ReadOptions::default() };
    let written = import(&temp.path("valley.png"), &read_options, None, 0.0, &out).unwrap_or_else(|e| panic!("{e}"));
    let loaded = scene::load(&out.to_string_lossy()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(written.rules, loaded.rules);
    let names: Vec<&str> = loaded.cameras.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["cliff", "ground", "vista", "grazing"]);
    let world = World::new(&loaded).expect("the scene's world");
    let source = read(&temp.path("valley.png"), &read_options).expect("readable");
    let (low, high) = world.height_range_m();
    for (x, y) in [(0.0, 0.0), (-200.0, 100.0), (479.0, -383.0)] {
        let step = (high - low) / 65535.0;
        assert!((world.height_m(x, y) - source.sample(x, y).0.clamp(low, high)).abs() < 3.0 * step, "{x}, {y}");
    }
    for camera in &loaded.cameras {
        let [x, y, z] = camera.position;
        let above = z - world.surface_height_m(x, y);
        assert!(!world.is_hole(x, y) && above > 0.5 && above < 6.0, "{}: {above} m above the ground", camera.name);
    }
    // At least four materials are used, and nodes beyond the data do not exist.
    let means = PaletteMeans {
        albedo: vec![[0.2; 3]; loaded.materials.len()],
        smoothness: vec![0.2; loaded.materials.len()],
        specular_occlusion: vec![1.0; loaded.materials.len()],
    };
    let node = world.layout().node_at(world.layout().finest_lod, 0.0, 0.0).expect("inside");
    let payload = world.bake(node, &means);
    let mut used = payload.splat.clone();
    used.sort_unstable();
    used.dedup();
    assert!(used.len() >= 4, "materials {used:?}");
    assert_eq!(world.layout().finest_lod, 3, "8 m data must have heights 4 m apart");
    assert!(!world.exists(NodeId { lod: 3, x: 0, y: 0 }) && !world.exists(NodeId { lod: 2, ..node }));
    assert!(world.is_hole(481.0, 0.0) && !world.is_hole(480.0, 384.0));

    // A second import into the same folder is refused, and no temporary files are left behind.
    expect_error(import(&temp.path("valley.png"), &read_options, None, 0.0, &out), &["scene", "not an empty folder", "remove this one"]);
    expect_error(import(&temp.path("missing.png"), &read_options, None, 0.0, &temp.path("other")), &["missing.png"]);
    expect_error(import(&temp.path("valley.png"), &read_options, Some(&temp.path("scene")), 0.0, &temp.path("other")), &["albedo"]);
    let left: Vec<_> = fs::read_dir(&temp.0).expect("readable").filter_map(|e| e.ok()).map(|e| e.file_name()).collect();
    assert_eq!(left.len(), 2, "{left:?}");
}

#[test]
fn an_import_takes_its_materials_along() {
    let temp = Temp::new("materials");
    let samples: Vec<u16> = (0..61 * 61).map(|i| valley(i % 61 + 20, i / 61)).collect();
    write_png16(&temp.path("v.png"), [61, 61], &samples);
    for name in ["alpine_grass", "cliff_rock"] {
        fs::create_dir_all(temp.path("mine").join(name)).expect("created");
        for map in ["albedo", "normal", "height", "roughness"] {
            let colour = if map == "normal" { [128, 128, 255] } else { [128; 3] };
            image::RgbImage::from_pixel(4, 4, image::Rgb(colour))
                .save(temp.path("mine").join(name).join(format!("{map}.png")))
                .expect("written");
        }
        fs::write(temp.path("mine").join(name).join("SOURCE.txt"), "licence").expect("written");
    }
    let read_options = ReadOptions { metres_per_texel: Some(8.0), height_range_m: Some([300.0, 900.0]), ..ReadOptions::default() };
    let out = temp.path("scene");
    import(&temp.path("v.png"), &read_options, Some(&temp.path("mine")), 2.0, &out).unwrap_or_else(|e| panic!("{e}"));
    assert!(out.join("materials/cliff_rock/height.png").is_file() && out.join("materials/alpine_grass/SOURCE.txt").is_file());
    let loaded = scene::load(&out.to_string_lossy()).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(loaded.materials.len(), 2);
    let world = World::new(&loaded).expect("valid");
    assert_eq!(world.layout().finest_lod, 0, "added relief needs the finest LOD");
    // The added relief is not zero, and stays within the 2 m that the import requests.
    let map = read(&temp.path("v.png"), &read_options).expect("readable");
    let offsets = (0..400).map(|i| {
        let (x, y) = (f64::from(i % 20) * 21.7 - 210.0, f64::from(i / 20) * 20.3 - 200.0);
        (world.height_m(x, y) - map.sample(x, y).0).abs()
    });
    let largest = offsets.fold(0.0, f64::max);
    assert!(largest > 0.5 && largest < 2.1, "{largest} m");
}

#[test]
fn files_beside_a_heightmap_are_refused_if_they_say_what_its_samples_mean() {
    let temp = Temp::new("beside");
    let bytes: Vec<u8> = values(SIZE).into_iter().flat_map(u16::to_le_bytes).collect();
    let options = ReadOptions { raw_size: Some(SIZE), ..options() };
    let notes = |path: &Path| heightmap::read(path, &options).unwrap_or_else(|e| panic!("{e}")).report.notes;
    let (path, metadata, mask) = (temp.path("a.raw"), temp.path("a.raw.aux.xml"), temp.path("a.raw.msk"));
    fs::write(&path, &bytes).expect("a heightmap");
    assert!(!notes(&path).iter().any(|note| note.contains("beside")), "negative control");
    fs::write(&metadata, "<PAMDataset><Metadata/></PAMDataset>").expect("metadata");
    assert!(notes(&path).iter().any(|note| note.contains("a.raw.aux.xml beside it is not read")));
    fs::write(&metadata, "<PAMDataset><!-- <Scale>2</Scale> --></PAMDataset>").expect("metadata");
    assert!(notes(&path).iter().any(|note| note.contains("a.raw.aux.xml beside it is not read")), "a comment says nothing");
    for element in ["Scale", "Offset", "NoDataValue", "UnitType"] {
        let band = format!("<PAMDataset><PAMRasterBand band=\"1\"><{element}>2</{element}></PAMRasterBand></PAMDataset>");
        fs::write(&metadata, band).expect("metadata");
        expect_error(read(&path, &options), &["a.raw.aux.xml", element, "gdal_translate"]);
    }
    fs::remove_file(&metadata).expect("it is there");
    fs::write(&mask, b"mask").expect("a mask");
    expect_error(read(&path, &options), &["a.raw.msk", "GDAL_TIFF_INTERNAL_MASK"]);
    // Names of files need not be Unicode.
    #[cfg(target_os = "linux")]
    {
        use std::ffi::OsStr;
        use std::os::unix::ffi::OsStrExt;
        fs::write(temp.0.join(OsStr::from_bytes(b"b\xff.raw")), &bytes).expect("a heightmap");
        fs::write(temp.0.join(OsStr::from_bytes(b"b\xff.raw.msk")), b"mask").expect("a mask");
        expect_error(read(&temp.0.join(OsStr::from_bytes(b"b\xff.raw")), &options), &["is a mask"]);
    }
}

#[test]
fn real_terrain_imports() {
    let Some(data) = std::env::var_os("SCREE_DATA").map(PathBuf::from) else {
        eprintln!("left out: import of real terrain (Stubai, Yosemite), since SCREE_DATA is not set");
        return;
    };
    let temp = Temp::new("real");
    // Columns: file, spacing (m), lowest and highest elevation (m), samples per side, finest LOD, sector edge (m), published steepest slope
    // (degrees).
    let maps = [
        ("stubai_alps_lidar_321.png", 10.0, [1_399.145_019_531_25, 2_716.058_105_468_75], 321, 4, 64.0, 84.9),
        ("yosemite_valley_1025.png", 24.45, [1_175.487_381_552_286, 3_563.615_723_354_426], 1025, 3, 256.0, 86.3),
    ];
    for (file, metres_per_texel, range, side, finest_lod, sector_m, steepest) in maps {
        let read_options = ReadOptions { metres_per_texel: Some(metres_per_texel), height_range_m: Some(range), ..ReadOptions::default() };
        let out = temp.path(file.split('_').next().unwrap_or("map"));
        let scene = import(&data.join("dem").join(file), &read_options, None, 0.0, &out).unwrap_or_else(|e| panic!("{e}"));
        let world = World::new(&scene).expect("the scene's world");
        assert_eq!((world.layout().finest_lod, world.layout().sector_m), (finest_lod, sector_m));
        assert!((world.extent_m()[0] - f64::from(side - 1) * metres_per_texel).abs() < 1e-6);
        assert!((world.height_range_m().0 - range[0]).abs() < 0.1 && (world.height_range_m().1 - range[1]).abs() < 0.1);
        // The published slope comes from central differences. A gradient from central differences is the mean of the gradients of four triangles, and
        // at least one of these triangles is as steep as the mean. So the steepest triangle of the world is at least as steep as published.
        assert!((steepest - 0.1..89.0).contains(&world.max_slope_deg()), "{file}: {} degrees", world.max_slope_deg());
        assert_eq!(scene.cameras.len(), 4);
        for camera in &scene.cameras {
            eprintln!("{file}: {} {:?} yaw {} pitch {}", camera.name, camera.position, camera.yaw_deg, camera.pitch_deg);
        }
    }
}

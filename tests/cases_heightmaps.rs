//! Tests the import of heightmaps that other programs wrote (`tests/cases`), and of small files that the tests make. Either all statements of a file
//! about its samples are applied, and the heights agree with the correct heights (for files of other programs: `truth.f32`, which does not come from
//! this project); or the file is refused in one line that says how to mend it.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use kernels::base::error::Error;
use kernels::base::files::WholeFolder;
use kernels::decode::heightmap::{self, NoData, ReadOptions, Reading, Voids};
use kernels::import::scene_folder::{self, ImportOptions};
use kernels::scene;
use kernels::world::World;

use crate::fixtures::{Folder, case, failure, has, import_scene, one_line, success, usage_error};

/// Height ranges, metres. `I16` and `U16` map 16-bit integers to metres of the same value. `R` is the range of the cases whose samples are shares
/// of a range.
const I16: [f64; 2] = [-32_768.0, 32_767.0];
const U16: [f64; 2] = [0.0, 65_535.0];
const R: [f64; 2] = [300.0, 900.0];

/// Reads the correct heights of a case, metres, row by row from the north.
fn truth(name: &str) -> Vec<f32> {
    let bytes = fs::read(case(name)).expect("the case has a truth");
    assert!(bytes.len() > 1000);
    bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
}

/// Options of most cases: a spacing of 10 m, and nothing else.
fn plain() -> ReadOptions {
    ReadOptions { metres_per_texel: Some(10.0), ..ReadOptions::default() }
}

fn ranged(range: [f64; 2]) -> ReadOptions {
    ReadOptions { height_range_m: Some(range), ..plain() }
}

fn read(name: &str, options: &ReadOptions) -> Reading {
    let reading = heightmap::read(&case(name), options).unwrap_or_else(|error| panic!("{error}"));
    let text = reading.report.to_string();
    assert!(text.lines().all(|line| !line.contains(char::is_control)) && !text.ends_with('\n'), "{text:?}");
    reading
}

fn refused(name: &str, options: &ReadOptions, words: &[&str]) {
    let text = one_line(heightmap::read(&case(name), options));
    has(&text, &[name.rsplit('/').next().expect("a name")]);
    has(&text, words);
}

/// Largest difference between heights, metres.
fn difference(heights: &[f32], truth: &[f32]) -> f32 {
    assert_eq!(heights.len(), truth.len());
    heights.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

fn same(reading: &Reading, truth_file: &str, tolerance: f32) {
    let truth = truth(truth_file);
    let largest = difference(&reading.map.samples, &truth);
    assert!(largest <= tolerance, "{}: {largest} m off\n{}", truth_file, reading.report);
    // Negative control: the comparison must notice rows in the wrong order.
    let reversed: Vec<f32> = truth.chunks(reading.map.width as usize).rev().flatten().copied().collect();
    assert!(difference(&reading.map.samples, &reversed) > 10.0, "{truth_file} is symmetric");
}

fn notes(reading: &Reading) -> String {
    reading.report.notes.join("\n")
}

#[test]
fn scale_and_offset_are_applied() {
    // The correct heights are those of the integer file, which are rounded to 0.1 m. So the file of floats may differ from them by 0.05 m.
    for options in [plain(), ranged(I16)] {
        same(&read("01-geotiff-scale-offset/int16_scale.tif", &options), "01-geotiff-scale-offset/truth.f32", 1e-3);
    }
    let float = read("01-geotiff-scale-offset/f32_scale.tif", &plain());
    same(&float, "01-geotiff-scale-offset/truth.f32", 0.0501);
    has(&float.report.to_string(), &["samples: -2000 to 4000", "scale 0.1, offset 500", "elevations: 300.00 to 900.00 m"]);
    refused("01-geotiff-scale-offset/int16_scale.tif", &ranged(R), &["--height-range 300,900 contradicts", "scale 0.1"]);
}

#[test]
fn feet_become_metres() {
    let feet = ReadOptions { metres_per_texel: Some(3.048), ..ReadOptions::default() };
    for options in [feet, ReadOptions::default()] {
        let reading = read("02-geotiff-feet/us_survey_foot.tif", &options);
        same(&reading, "02-geotiff-feet/truth.f32", 1e-3);
        assert!((reading.map.metres_per_texel - 12_000.0 / 3937.0).abs() < 1e-9);
        has(&reading.report.to_string(), &["unit US survey foot", "10 US survey foot"]);
    }
}

#[test]
fn undeclared_marks_of_missing_data_are_refused_until_they_are_named() {
    let decimetres = [-3276.8, 3276.7];
    for (file, marker, range) in [
        ("03-int16-untagged-void/int16_9999.tif", "-9999", Some(I16)),
        ("03-int16-untagged-void/int16_32768.tif", "-32768", Some(I16)),
        ("03-int16-untagged-void/int16_32767.tif", "-32767", Some(I16)),
        ("03-int16-untagged-void/int16_dm_9999.tif", "-9999", Some(decimetres)),
        ("03-int16-untagged-void/int16_dm_32768.tif", "-32768", Some(decimetres)),
        ("04-float-untagged-void/f32_-9999.tif", "-9999", None),
        ("04-float-untagged-void/f32_-10000.tif", "-10000", None),
        ("04-float-untagged-void/f32_-32767.tif", "-32767", None),
        ("04-float-untagged-void/f32_-99999.tif", "-99999", None),
        ("04-float-untagged-void/f32_9999.tif", "9999", None),
    ] {
        let options = ReadOptions { height_range_m: range, ..plain() };
        let mention = format!("20 samples have the value {marker}");
        for voids in [Voids::Refuse, Voids::Fill, Voids::Holes] {
            refused(file, &ReadOptions { voids, ..options.clone() }, &[&mention, &format!("--no-data {marker}"), "--no-data none"]);
        }
        let named = ReadOptions { no_data: NoData::Named(vec![marker.parse().expect("a number")]), ..options.clone() };
        refused(file, &named, &["20 of 3185 samples have no data", marker, "the first at column", "--fill-voids"]);
        let filled = read(file, &ReadOptions { voids: Voids::Fill, ..named });
        let (low, high) = filled.map.elevation_range_m();
        assert_eq!(filled.report.void_count, 20);
        assert!((low - 300.0).abs() < 0.1 && (high - 900.0).abs() < 0.1, "{file}: {low} to {high} m");
        let kept = read(file, &ReadOptions { no_data: NoData::Nothing, ..options });
        let (low, high) = kept.map.elevation_range_m();
        assert!(low < 0.0 || high > 900.1, "{file}: as ground, the value is there: {low} to {high} m");
    }
    let lowest = "04-float-untagged-void/f32_-3.40282e+38.tif";
    refused(lowest, &plain(), &["20 with values such as -3.4028235e38", "--fill-voids"]);
    refused(lowest, &ReadOptions { no_data: NoData::Nothing, ..plain() }, &["-3.4028235e38"]);
    assert_eq!(read(lowest, &ReadOptions { voids: Voids::Fill, ..plain() }).report.void_count, 20);
}

#[test]
fn masks_hide_samples() {
    let masked = "05-internal-mask/masked.tif";
    refused(masked, &plain(), &["20 of 3185 samples have no data: 20 that its mask hides"]);
    let filled = read(masked, &ReadOptions { voids: Voids::Fill, ..plain() });
    let (low, high) = filled.map.elevation_range_m();
    assert!(low > 299.9 && high < 900.1 && filled.report.void_count == 20 && filled.holes.is_empty(), "{low} to {high} m");
    let open = read(masked, &ReadOptions { voids: Voids::Holes, ..plain() });
    assert_eq!((open.holes.len(), open.map.samples), (20, filled.map.samples));
}

#[test]
fn tiles_that_are_not_in_the_file_have_no_data_or_are_0() {
    let in_gap = |index: usize| (64..96).contains(&(index % 160)) && (32..64).contains(&(index / 160));
    for (file, range, tolerance) in [
        ("sparse_none.tif", None, 1e-3),
        ("sparse_nodata.tif", None, 1e-3),
        ("sparse_lzw.tif", None, 1e-3),
        ("sparse_packbits.tif", None, 1e-3),
        ("sparse_u16_none.tif", Some(U16), 0.501),
    ] {
        let (file, options) = (format!("06-sparse-tiles/{file}"), ReadOptions { height_range_m: range, ..plain() });
        refused(
            &file,
            &options,
            &["1024 of 15360 samples have no data: 1024 in strips or tiles that are not in the file", "column 64, row 32"],
        );
        let filled = read(&file, &ReadOptions { voids: Voids::Fill, ..options });
        for (index, (sample, truth)) in filled.map.samples.iter().zip(truth("06-sparse-tiles/truth.f32")).enumerate() {
            let is_right = if in_gap(index) { (299.9..=900.1).contains(sample) } else { (sample - truth).abs() <= tolerance };
            assert!(is_right, "{file}: sample {index} is {sample} instead of {truth}");
        }
    }
    for (file, range) in
        [("sparse_float32_none_untagged.tif", None), ("sparse_no_tag.tif", None), ("sparse_uint16_none_untagged.tif", Some(U16))]
    {
        let reading = read(&format!("06-sparse-tiles/{file}"), &ReadOptions { height_range_m: range, ..plain() });
        same(&reading, "06-sparse-tiles/truth_untagged.f32", 0.501);
        has(&notes(&reading), &["1 of 15 tiles are not in the file", "their samples are 0"]);
        // In a map of floats, a block of samples that are exactly 0 is reported if all other samples are far from 0. It is not reported if the user
        // states that no sample marks missing data.
        if range.is_none() {
            has(&notes(&reading), &["1024 samples are exactly 0 (the first at column 64, row 32)", "all others are 300 to 900"]);
            let kept = read(&format!("06-sparse-tiles/{file}"), &ReadOptions { no_data: NoData::Nothing, ..plain() });
            assert!(!notes(&kept).contains("exactly 0"), "{}", notes(&kept));
        }
    }
}

#[test]
fn rows_that_run_from_south_to_north_are_turned() {
    let reading = read("07-south-up/south_up.tif", &plain());
    same(&reading, "07-south-up/truth.f32", 1e-3);
    has(&reading.report.to_string(), &["orientation: rows run from south to north in the file; turned"]);
    // A window is given from the north-west corner, even if the file begins with another corner.
    let part = read("07-south-up/south_up.tif", &ReadOptions { window: Some([9, 6, 13, 17]), ..plain() });
    let all = truth("07-south-up/truth.f32");
    let expected: Vec<f32> = (6..23).flat_map(|row| all[row * 65 + 9..][..13].to_vec()).collect();
    assert!(difference(&part.map.samples, &expected) < 1e-3);
}

#[test]
fn the_spacing_is_that_of_the_file() {
    for (file, metres) in [("ten_metres.tif", 10.0), ("ten_feet.tif", 12_000.0 / 3937.0)] {
        let file = format!("08-spacing-in-file/{file}");
        let reading = read(&file, &ReadOptions::default());
        assert!((reading.map.metres_per_texel - metres).abs() < 1e-9, "{file}");
        has(&reading.report.to_string(), &["from the file: 10 ", "a pixel is an area"]);
        refused(
            &file,
            &ReadOptions { metres_per_texel: Some(30.0), ..ReadOptions::default() },
            &["--metres-per-texel 30 contradicts the file"],
        );
    }
    has(&notes(&read("08-spacing-in-file/ten_feet.tif", &ReadOptions::default())), &["unit of distances is the US survey foot"]);
    for given in [None, Some(30.0)] {
        let options = ReadOptions { metres_per_texel: given, ..ReadOptions::default() };
        refused(
            "08-spacing-in-file/degrees.tif",
            &options,
            &["degrees", "gdalwarp -t_srs EPSG:32632 -tr 30.9 30.9 -r bilinear IN OUT.tif"],
        );
        refused("08-spacing-in-file/non_square.tif", &options, &["10 metre apart from west to east, but 25 metre", "gdalwarp -tr 10 10"]);
    }
}

#[test]
fn compressions_are_read_or_named() {
    for file in ["deflate", "lzw", "packbits", "zstd"] {
        same(&read(&format!("09-compressions/{file}.tif"), &plain()), "09-compressions/truth.f32", 1e-3);
    }
    for (file, name) in [("lerc", "LERC"), ("lerc_deflate", "LERC"), ("lzma", "LZMA")] {
        let words = format!("compression {name} is not supported; convert it with gdal_translate -co COMPRESS=DEFLATE");
        refused(&format!("09-compressions/{file}.tif"), &plain(), &[&words]);
    }
}

#[test]
fn lzw_tiles_at_the_edge_of_an_image_are_read() {
    // GDAL wrote both files from the same samples. Their tiles of 16 x 16 samples extend beyond the right and the lower edge of the image.
    let [lzw, deflate] =
        ["lzw_tiles", "deflate_tiles"].map(|file| read(&format!("09-compressions/{file}.tif"), &ReadOptions::default()).map);
    assert_eq!((lzw.width, lzw.height), (83, 61));
    assert!(lzw == deflate && lzw.samples.iter().any(|sample| *sample > 300.0), "LZW and Deflate differ");
}

#[test]
fn samples_that_are_not_one_height_are_refused_in_words() {
    for (file, words) in [
        ("11-bands/rgb16.tif", "it has 3 bands (red, green and blue)"),
        ("11-bands/grey_alpha.tif", "it has 2 bands (the last one is alpha)"),
        ("11-bands/two_band_pixel.tif", "it has 2 bands (which may all be heights)"),
        ("11-bands/two_band_planar.tif", "it has 2 bands (which may all be heights)"),
        ("12-int32/nbits12.tif", "its samples have 12 bits, which is not supported"),
        ("12-int32/int32_mm.tif", "32-bit signed integers, and the file does not say what they mean"),
        ("12-int32/uint32_mm.tif", "32-bit unsigned integers, and the file does not say what they mean"),
    ] {
        refused(file, &ranged(U16), &[words, "gdal_translate"]);
    }
    let half = read("12-int32/float16.tif", &plain());
    same(&half, "12-int32/truth_f16.f32", 1e-6);
    has(&notes(&half), &["half floats", "steps of 0.5 m"]);
    refused("12-int32/float16.tif", &ranged(U16), &["--height-range does not apply", "leave the option out"]);
}

#[test]
fn white_is_zero_inverts_nothing() {
    let reading = read("13-miniswhite/f32_miniswhite.tif", &plain());
    same(&reading, "13-miniswhite/truth.f32", 0.0);
    has(&notes(&reading), &["WhiteIsZero"]);
    same(&read("13-miniswhite/i16_miniswhite.tif", &ranged(I16)), "13-miniswhite/truth_int.f32", 0.0);
    same(&read("13-miniswhite/u16_miniswhite.tif", &ranged(U16)), "13-miniswhite/truth_int.f32", 0.0);
    refused("13-miniswhite/f32_miniswhite_nodata.tif", &plain(), &["20 with its no-data value -9999"]);
}

#[test]
fn declared_values_without_data_are_found_in_every_type() {
    for (file, words) in [
        ("-32768_int16.tif", "20 with its no-data value -32768;"),
        ("-9999_int16.tif", "20 with its no-data value -9999;"),
        ("0_uint16.tif", "20 with its no-data value 0;"),
        ("65535_uint16.tif", "20 with its no-data value 65535;"),
        ("1e20_float64.tif", "20 with its no-data value 1e20;"),
        ("flt_min_float32.tif", "20 with its no-data value -3.4028235e38;"),
        ("nan_float32.tif", "20 that are NaN;"),
    ] {
        refused(&format!("14-tagged-nodata/{file}"), &plain(), &["20 of 3185 samples have no data", words, "--fill-voids"]);
    }
}

#[test]
fn maps_of_every_size_are_drawn_to_the_edge_of_their_data() {
    let temp = Folder::new("sizes");
    let options = |spacing: Option<f64>, size: Option<[u32; 2]>| {
        let read = ReadOptions { metres_per_texel: spacing, raw_size: size, ..ReadOptions::default() };
        ImportOptions { read, ..ImportOptions::default() }
    };
    for (file, [width, height]) in [("2x2.tif", [2, 2]), ("3x2.tif", [3, 2]), ("sq_5x5.tif", [5, 5]), ("sq_100x70.tif", [100, 70])] {
        let path = case("16-sizes").join(file);
        let contradicted = scene_folder::examine(&path, &options(Some(30.0), None), &|| false);
        has(&one_line(contradicted), &["--metres-per-texel 30 contradicts the file"]);
        // The same heights in a raw file, which states no spacing. It is imported with a spacing of 30 m.
        let heights = heightmap::read(&path, &ReadOptions::default()).unwrap_or_else(|error| panic!("{error}")).map.samples;
        let bare = temp.0.join(format!("{file}.r32"));
        fs::write(&bare, heights.iter().flat_map(|height| height.to_le_bytes()).collect::<Vec<u8>>()).expect("written");
        let imports = [(&path, options(None, None), "own"), (&bare, options(Some(30.0), Some([width, height])), "30")];
        for (source, options, name) in imports {
            let scene = import_scene(source, &options, &temp.0.join(format!("{file}-{name}")));
            let world = World::new(&scene).unwrap_or_else(|error| panic!("{error}"));
            let [east, north] = world.extent_m().map(|length| length / 2.0);
            assert!(!world.is_hole(east, north) && world.is_hole(east + 1e-3, 0.0) && world.is_hole(0.0, -north - 1e-3), "{file}");
            // The corners of the drawn surface are the corners of the data. Heights are rounded to 16 bits twice: in the heightmap of the scene, and
            // in the payload of a node. Each rounding changes a height by at most one step, so a tolerance of three steps covers both.
            let (low, high) = world.height_range_m();
            let tolerance = 3.0 * (high - low) / 65_535.0;
            let (last_column, last_row) = (width as usize - 1, height as usize - 1);
            for (column, row) in [(0, 0), (last_column, 0), (0, last_row), (last_column, last_row)] {
                let x = if column == 0 { -east } else { east };
                let y = if row == 0 { north } else { -north };
                let sample = f64::from(heights[row * width as usize + column]);
                let off = (world.surface_height_m(x, y) - sample).abs();
                assert!(off < tolerance, "{file}, {name}: the corner {column}, {row} is {off} m off");
            }
        }
    }
    // If samples are closer together than vertices can be, the map is drawn, and a note states the loss of detail.
    let notes = |spacing: f64| {
        let understood = scene_folder::examine(&temp.0.join("sq_5x5.tif.r32"), &options(Some(spacing), Some([5, 5])), &|| false);
        understood.unwrap_or_else(|error| panic!("{error}")).notes().join("; ")
    };
    has(&notes(0.1), &["samples are 0.1 m apart, but vertices cannot be closer together than 0.5 m"]);
    assert!(!notes(1.0).contains("apart"), "{}", notes(1.0));
}

#[test]
fn png_files_are_read_if_their_channels_agree() {
    for file in ["rgb16", "grey_alpha16"] {
        same(&read(&format!("21-png-not-grey/{file}.png"), &ranged(R)), "21-png-not-grey/truth.f32", 0.005);
    }
    let transparent = "21-png-not-grey/trns.png";
    refused(transparent, &ranged(R), &["1 that are transparent", "--fill-voids"]);
    same(&read(transparent, &ReadOptions { no_data: NoData::Nothing, ..ranged(R) }), "21-png-not-grey/truth.f32", 0.005);
    refused(
        "21-png-not-grey/terrarium8.png",
        &ranged(R),
        &["8-bit colour", "high byte is red and whose low byte is green", "gdal_calc.py"],
    );
    refused(transparent, &ReadOptions { raw_size: Some([65, 49]), ..ranged(R) }, &["--raw-size does not apply"]);
    refused(transparent, &ReadOptions { raw_big_endian: true, ..ranged(R) }, &["--raw-big-endian does not apply"]);
    refused(transparent, &ReadOptions { channel: Some("Y".to_owned()), ..ranged(R) }, &["--channel does not apply"]);
}

#[test]
fn eight_bit_numbers_in_a_file_of_16_bits_are_reported() {
    let read_codes = |codes: &[u16]| {
        let mut file = Cursor::new(Vec::new());
        let picture = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(8, 6, codes.to_vec()).expect("48 pixels");
        picture.write_to(&mut file, image::ImageFormat::Png).expect("written");
        file.set_position(0);
        notes(&heightmap::decode(file, Path::new("made.png"), &ranged(R)).unwrap_or_else(|error| panic!("{error}")))
    };
    let stretched: Vec<u16> = (0..48).map(|k| 257 * (k * 5)).collect();
    // 257 is 1/255 of 65535, so a step of 257 codes is 1/255 of the range of 600 m, which is 2.353 m.
    has(
        &read_codes(&stretched),
        &["all samples are multiples of 257", "48 levels in steps of 2.353 m", "terraces", "export the heights with 16 bits"],
    );
    let shifted: Vec<u16> = stretched.iter().map(|code| code & 0xff00).collect();
    has(&read_codes(&shifted), &["all samples are multiples of 256"]);
    let mut finer = stretched.clone();
    finer[17] += 1;
    assert_eq!(read_codes(&finer), "", "one sample has 16 bits");
    let steps: Vec<u16> = (0..48).map(|k| u16::MAX * (k % 2)).collect();
    assert_eq!(read_codes(&steps), "", "two levels");
}

#[test]
fn raw_files_are_read_in_their_depth_and_byte_order() {
    let sized = |options: ReadOptions| ReadOptions { raw_size: Some([65, 49]), ..options };
    let big = |options: ReadOptions| ReadOptions { raw_big_endian: true, ..options };
    // `truth.f32` has the heights of the integer files. The heights of the float file are not rounded to integers, so they differ by up to half a
    // step.
    same(&read("22-raw/float.r32", &sized(plain())), "22-raw/truth.f32", 0.005);
    same(&read("22-raw/le.raw", &sized(ranged(R))), "22-raw/truth.f32", 1e-3);
    same(&read("22-raw/be.r16", &big(sized(ranged(R)))), "22-raw/truth.f32", 1e-3);
    same(&read("22-raw/square_le.raw", &ranged(R)), "22-raw/truth_square.f32", 0.005);
    same(&read("22-raw/square_be.raw", &big(ranged(R))), "22-raw/truth_square.f32", 0.005);
    refused("22-raw/be.r16", &sized(ranged(R)), &["other byte order", "give --raw-big-endian"]);
    refused("22-raw/le.raw", &big(sized(ranged(R))), &["other byte order", "leave out --raw-big-endian"]);
    refused("22-raw/float.r32", &big(sized(plain())), &["other byte order"]);
    refused("22-raw/float.r32", &sized(ranged(R)), &["--height-range does not apply"]);
    refused("22-raw/odd.raw", &sized(ranged(R)), &["65 x 49", "6370 bytes", "has 6371"]);
    refused("22-raw/float.raw", &sized(ranged(R)), &["has 12740", "32-bit floats: call it .r32"]);
    refused("22-raw/square_8bit.raw", &ranged(R), &["8 bits per sample", "terraces"]);
    refused("22-raw/le.raw", &ranged(R), &["not a square", "--raw-size"]);
}

#[test]
fn floats_of_0_to_1_are_mapped_to_a_range() {
    for (file, tolerance) in [("unit.exr", 1e-3), ("unit.tif", 1e-3), ("unit_half.exr", 0.15)] {
        let file = format!("23-exr-normalised/{file}");
        let mapped = read(&file, &ranged(R));
        same(&mapped, "23-exr-normalised/truth.f32", tolerance);
        assert_eq!(notes(&mapped).contains("half floats"), file.contains("half"), "{}", notes(&mapped));
        has(&notes(&read(&file, &plain())), &["the whole relief is 1 m", "normalised", "--height-range"]);
    }
    refused("24-exr-half-high/float.exr", &ranged(R), &["--height-range does not apply", "2100 to 2130"]);
}

#[test]
fn half_floats_lose_precision_and_say_so() {
    let half = read("24-exr-half-high/half.exr", &plain());
    same_within(&half, "24-exr-half-high/truth.f32", 1.0);
    has(&notes(&half), &["half floats", "steps of 2 m"]);
    let float = read("24-exr-half-high/float.exr", &plain());
    same_within(&float, "24-exr-half-high/truth.f32", 1e-3);
    assert!(!notes(&float).contains("half"));
}

/// Like [`same`], for a relief that is too low for the negative control of `same`.
fn same_within(reading: &Reading, truth_file: &str, tolerance: f32) {
    let truth = truth(truth_file);
    assert!(difference(&reading.map.samples, &truth) <= tolerance);
    let reversed: Vec<f32> = truth.iter().rev().copied().collect();
    assert!(difference(&reading.map.samples, &reversed) > 4.0 * tolerance, "the comparison notices a turned map");
}

#[test]
fn the_height_channel_of_an_openexr_file_is_found_or_asked_for() {
    for file in ["26-exr-multipart/colour_then_height", "26-exr-multipart/height_then_colour"] {
        let reading = read(&format!("{file}.exr"), &plain());
        same(&reading, "26-exr-multipart/truth.f32", 1e-3);
        has(&reading.report.file, &["channel `height.Y`"]);
    }
    for (file, channel) in [
        ("beauty_and_height", "height.Y"),
        ("layer_height", "terrain.height"),
        ("layer_single", "heightfield.V"),
        ("lower_y", "y"),
        ("alpha_y", "Y"),
        ("rgb_equal", "R"),
    ] {
        let reading = read(&format!("27-exr-channels/{file}.exr"), &plain());
        same(&reading, "27-exr-channels/truth.f32", 1e-3);
        has(&reading.report.file, &[&format!("channel `{channel}`")]);
    }
    refused("27-exr-channels/colour_rgb.exr", &plain(), &["--channel, one of: B, G, R", "alone and equal"]);
    refused("27-exr-channels/uint.exr", &plain(), &["channel `Y` holds integers", "export the heights as float"]);
    let named = |name: &str| ReadOptions { channel: Some(name.to_owned()), ..plain() };
    for name in ["height.Y", "HEIGHT.y", "y"] {
        same(&read("27-exr-channels/beauty_and_height.exr", &named(name)), "27-exr-channels/truth.f32", 1e-3);
    }
    let red = read("27-exr-channels/beauty_and_height.exr", &named("R")).map.elevation_range_m();
    assert!(red.1 <= 1.0, "a channel that is named is read: {red:?}");
    refused("27-exr-channels/beauty_and_height.exr", &named("Z"), &["no channel `Z`; give one of: B, G, R, height.Y"]);
    same(&read("26-exr-multipart/colour_then_height.exr", &named("height.Y")), "26-exr-multipart/truth.f32", 1e-3);
}

#[test]
fn cropped_openexr_files_are_refused_and_moved_ones_read() {
    same(&read("28-exr-windows/offset_whole.exr", &plain()), "28-exr-windows/truth.f32", 1e-3);
    refused("28-exr-windows/cropped.exr", &plain(), &["cropped", "48 x 30 at (12, 10)", "65 x 49 at (0, 0)"]);
}

/// An OpenEXR file of 6 x 5 samples with heights of a slope, and the given alpha.
fn exr_with_alpha(alpha: &[f32]) -> Vec<u8> {
    use exr::prelude::*;
    let heights: Vec<f32> = (0..30).map(|index| 100.0 + 7.0 * index as f32).collect();
    let samples = [("A", alpha.to_vec()), ("Y", heights)].map(|(name, samples)| AnyChannel::new(name, FlatSamples::F32(samples)));
    let channels = AnyChannels::sort(samples.into_iter().collect());
    let image = Image::from_layer(Layer::new((6, 5), LayerAttributes::default(), Encoding::UNCOMPRESSED, channels));
    let mut file = Cursor::new(Vec::new());
    image.write().to_buffered(&mut file).expect("written");
    file.into_inner()
}

#[test]
fn alpha_hides_samples_of_openexr_files() {
    let read = |alpha: &[f32], options: &ReadOptions| heightmap::decode(Cursor::new(exr_with_alpha(alpha)), Path::new("made.exr"), options);
    let mut alpha = vec![1.0; 30];
    let whole = read(&alpha, &plain()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((whole.report.void_count, whole.map.elevation_range_m()), (0, (100.0, 303.0)));
    alpha[13] = 0.0;
    alpha[14] = 0.0;
    let says = ["2 of 30 samples have no data: 2 that are transparent; the first at column 1, row 2", "--fill-voids"];
    has(&one_line(read(&alpha, &plain())), &says);
    let filled = read(&alpha, &ReadOptions { voids: Voids::Fill, ..plain() }).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(filled.report.void_count, 2);
    let ground = ReadOptions { no_data: NoData::Nothing, ..plain() };
    let kept = read(&alpha, &ground).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((kept.report.void_count, kept.map.samples), (0, whole.map.samples), "the user says that all numbers are ground");
    // A file in which alpha is 0 everywhere, as some programs write it.
    has(&one_line(read(&[0.0; 30], &plain())), &["no sample has data", "30 that are transparent", "--no-data none"]);
    alpha[14] = 0.5;
    has(&one_line(read(&alpha, &plain())), &["partly transparent (first at column 2, row 2: channel `A` is 0.5)"]);
    assert!(read(&alpha, &ground).is_ok());
}

/// A tag of a TIFF: number, type (2 = text, 3 = 16 bits, 4 = 32 bits, 12 = double), and value.
struct Tag(u16, u16, Vec<u8>);

fn shorts(tag: u16, values: &[u16]) -> Tag {
    Tag(tag, 3, values.iter().flat_map(|value| value.to_le_bytes()).collect())
}

fn doubles(tag: u16, values: &[f64]) -> Tag {
    Tag(tag, 12, values.iter().flat_map(|value| value.to_le_bytes()).collect())
}

fn words(tag: u16, text: &str) -> Tag {
    Tag(tag, 2, [text.as_bytes(), b"\0"].concat())
}

/// Metadata of GDAL with items of these roles and values.
fn metadata(items: &[(&str, &str)]) -> Tag {
    let items: String =
        items.iter().map(|(role, value)| format!("  <Item name=\"X\" sample=\"0\" role=\"{role}\">{value}</Item>\n")).collect();
    words(42_112, &format!("<GDALMetadata>\n{items}</GDALMetadata>\n"))
}

/// An image of a TIFF: its size, its bits per sample, its further tags, and its samples.
type Directory = ([u16; 2], u16, Vec<Tag>, Vec<u8>);

/// Returns a little-endian TIFF with these images. Each image is stored in one uncompressed strip.
fn tiff(images: &[Directory]) -> Vec<u8> {
    let mut file = b"II*\0\x08\0\0\0".to_vec();
    for (index, (size, bits, more, samples)) in images.iter().enumerate() {
        let start = file.len() as u32;
        let long = |tag: u16, value: u32| Tag(tag, 4, value.to_le_bytes().to_vec());
        let format = if *bits == 32 { 3 } else { 1 };
        let mut tags = vec![
            shorts(256, &[size[0]]),
            shorts(257, &[size[1]]),
            shorts(258, &[*bits]),
            shorts(259, &[1]),
            shorts(277, &[1]),
            shorts(278, &[size[1]]),
            long(279, samples.len() as u32),
            shorts(339, &[format]),
        ];
        tags.extend(more.iter().map(|Tag(tag, kind, value)| Tag(*tag, *kind, value.clone())));
        if !tags.iter().any(|tag| tag.0 == 262) {
            tags.push(shorts(262, &[1]));
        }
        let mut data_at = start + 2 + 12 * (tags.len() as u32 + 1) + 4;
        tags.push(long(273, data_at));
        tags.sort_by_key(|tag| tag.0);
        let mut data = samples.clone();
        data_at += samples.len() as u32;
        file.extend((tags.len() as u16).to_le_bytes());
        for Tag(tag, kind, value) in &tags {
            let bytes_each = match kind {
                2 => 1,
                3 => 2,
                4 => 4,
                _ => 8,
            };
            file.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            file.extend((value.len() as u32 / bytes_each).to_le_bytes());
            if value.len() <= 4 {
                file.extend(value.iter().copied().chain([0; 4]).take(4));
            } else {
                file.extend(data_at.to_le_bytes());
                data.extend(value);
                data_at += value.len() as u32;
            }
        }
        let next = if index + 1 < images.len() { data_at } else { 0 };
        file.extend(next.to_le_bytes());
        file.extend(data);
    }
    file
}

/// Samples of an image of 6 x 5 floats, each 7 m higher than the one before.
fn slope() -> Vec<u8> {
    (0..30).flat_map(|index| (100.0f32 + 7.0 * index as f32).to_le_bytes()).collect()
}

/// Reads a TIFF of 6 x 5 floats with these tags.
fn with_tags(tags: Vec<Tag>, options: &ReadOptions) -> Result<Reading, Error> {
    heightmap::decode(Cursor::new(tiff(&[([6, 5], 32, tags, slope())])), Path::new("made.tif"), options)
}

#[test]
fn statements_that_mean_nothing_or_contradict_each_other_are_refused() {
    let whole = with_tags(Vec::new(), &plain()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(whole.map.elevation_range_m(), (100.0, 303.0), "negative control: the file itself is read");
    let utm = || {
        vec![
            doubles(33_550, &[10.0, 10.0, 0.0]),
            doubles(33_922, &[0.0, 0.0, 0.0, 6e5, 52e5, 0.0]),
            shorts(34_735, &[1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 32_632]),
        ]
    };
    let and = |more: Vec<Tag>| utm().into_iter().chain(more).collect::<Vec<Tag>>();
    for (tags, words) in [
        (vec![metadata(&[("scale", "0")])], "the scale of its heights is 0"),
        (vec![metadata(&[("scale", "nan")])], "`nan`, which is not a number"),
        (vec![metadata(&[("offset", "-inf")])], "`-inf`, which is not a number"),
        (vec![metadata(&[("unittype", "cubit")])], "`cubit`, is not known"),
        (vec![metadata(&[("scale", "2"), ("scale", "3")])], "two values of scale"),
        (vec![words(42_113, "void")], "no-data value is `void`"),
        (vec![shorts(266, &[2])], "FillOrder 2"),
        (vec![shorts(274, &[4])], "Orientation 4"),
        (vec![shorts(262, &[3])], "palette"),
        (vec![shorts(262, &[2])], "colours"),
        (
            and(vec![doubles(34_264, &[20.0, 0.0, 0.0, 6e5, 0.0, -20.0, 0.0, 52e5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])]),
            "contradict each other",
        ),
        (vec![doubles(33_550, &[-10.0, 10.0, 0.0])], "ModelPixelScale is -10 x 10"),
        (vec![doubles(33_550, &[10.0])], "ModelPixelScale"),
        (vec![shorts(34_735, &[1, 1, 0, 9, 1024, 0, 1, 1])], "states 9 keys, but holds 1"),
        (vec![shorts(34_735, &[1, 1, 0, 1, 1024, 0, 1, 3])], "geocentric"),
        (vec![shorts(33_550, &[10, 10, 0])], "tag 33550 holds no floats"),
    ] {
        has(&one_line(with_tags(tags, &plain())), &["made.tif", words]);
    }
    // The metadata and the vertical system state different units.
    let vertical = shorts(34_735, &[1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 32_632, 4099, 0, 1, 9001]);
    let both = vec![doubles(33_550, &[10.0, 10.0, 0.0]), vertical, metadata(&[("unittype", "ft")])];
    has(&one_line(with_tags(both, &plain())), &["contradicts itself", "unit foot", "unit metre"]);
    // The reader does not know the unit of the vertical system 5103. It knows the unit of 5703 (negative control).
    let vertical = |system: u16| shorts(34_735, &[1, 1, 0, 3, 1024, 0, 1, 1, 3072, 0, 1, 32_632, 4096, 0, 1, system]);
    let with_system = |system: u16| with_tags(vec![doubles(33_550, &[10.0, 10.0, 0.0]), vertical(system)], &plain());
    let unknown = with_system(5103).unwrap_or_else(|error| panic!("{error}"));
    has(&notes(&unknown), &["the unit of its vertical system (code 5103) is not known"]);
    let known = with_system(5703).unwrap_or_else(|error| panic!("{error}"));
    assert!(!notes(&known).contains("vertical system"), "negative control");
    // A negative scale is applied, as GDAL does.
    let turned = with_tags(vec![metadata(&[("scale", "-1")])], &plain()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(turned.map.elevation_range_m(), (-303.0, -100.0));
    has(&notes(&turned), &["scale of the file is negative"]);
    // It is not an error if no sample has the no-data value.
    let tagged = with_tags(vec![words(42_113, "-9999")], &plain()).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((tagged.report.void_count, tagged.map.samples), (0, whole.map.samples));
    assert!(with_tags(and(Vec::new()), &ReadOptions::default()).is_ok(), "negative control: the tags of UTM are right");
    // A coordinate system in feet (EPSG:2229), in a file whose keys do not state the unit.
    let california = || vec![doubles(33_550, &[10.0, 10.0, 0.0]), shorts(34_735, &[1, 1, 0, 2, 1024, 0, 1, 1, 3072, 0, 1, 2229])];
    let says = [
        "spacing of 10, but not its unit",
        "--metres-per-texel, for example 3.048006, because the unit of EPSG:2229 is the US survey foot",
    ];
    has(&one_line(with_tags(california(), &ReadOptions::default())), &says);
    let given = ReadOptions { metres_per_texel: Some(3.048), ..ReadOptions::default() };
    let given = with_tags(california(), &given).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!((given.map.metres_per_texel, notes(&given).contains("without a unit")), (3.048, false));
}

#[test]
fn masks_must_fit_their_image() {
    let masked = |size: [u16; 2], bits: u16, samples: Vec<u8>| {
        let mask = (size, bits, vec![Tag(254, 4, 4u32.to_le_bytes().to_vec()), shorts(262, &[4])], samples);
        let file = tiff(&[([6, 5], 32, Vec::new(), slope()), mask]);
        heightmap::decode(Cursor::new(file), Path::new("made.tif"), &ReadOptions { voids: Voids::Fill, ..plain() })
    };
    // In the first row, samples 0 and 5 are hidden.
    let bits = masked([6, 5], 1, vec![0b0111_1000, 0xff, 0xff, 0xff, 0xff]).unwrap_or_else(|error| panic!("{error}"));
    let bytes: Vec<u8> = (0..30).map(|index| if [0, 5].contains(&index) { 0 } else { 255 }).collect();
    let bytes = masked([6, 5], 8, bytes).unwrap_or_else(|error| panic!("{error}"));
    for reading in [&bits, &bytes] {
        assert_eq!(reading.report.void_count, 2);
        has(&reading.report.voids, &["2 that its mask hides; the first at column 0, row 0"]);
    }
    assert_eq!(bits.map, bytes.map);
    let open = masked([6, 5], 1, vec![0xff; 5]).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(open.report.void_count, 0);
    has(&one_line(masked([5, 5], 1, vec![0xff; 5])), &["contradicts itself: its mask has 5 x 5 samples, but the image 6 x 5"]);
    has(&one_line(masked([6, 5], 16, vec![0xff; 60])), &["mask has 1 band of 16 bits"]);
    let mask = || ([6, 5], 1, vec![Tag(254, 4, 4u32.to_le_bytes().to_vec()), shorts(262, &[4])], vec![0xff; 5]);
    let two = tiff(&[([6, 5], 32, Vec::new(), slope()), mask(), mask()]);
    has(&one_line(heightmap::decode(Cursor::new(two), Path::new("made.tif"), &plain())), &["contradicts itself: it has two masks"]);
    has(&one_line(masked([6, 5], 1, vec![0; 5])), &["no sample has data", "mask"]);
    has(&one_line(masked([6, 5], 1, vec![0xff; 3])), &["3 bytes, but needs 5"]);
}

#[test]
fn thumbnails_are_left_out_and_named() {
    let kind = |kind: u32| Tag(254, 4, kind.to_le_bytes().to_vec());
    let thumbnail = |kinds: Vec<Tag>| -> Directory { ([2, 2], 32, kinds, [1.0f32, 2.0, 3.0, 4.0].map(f32::to_le_bytes).concat()) };
    let whole = |kinds: Vec<Tag>| -> Directory { ([6, 5], 32, kinds, slope()) };
    let mask = || -> Directory { ([6, 5], 1, vec![kind(4), shorts(262, &[4])], vec![0b0111_1000, 0xff, 0xff, 0xff, 0xff]) };
    let read = |images: &[Directory]| {
        let options = ReadOptions { voids: Voids::Fill, ..plain() };
        heightmap::decode(Cursor::new(tiff(images)), Path::new("made.tif"), &options).unwrap_or_else(|error| panic!("{error}"))
    };
    let says = "image 2 of the file is read, the first one of full resolution";
    for images in [
        vec![thumbnail(vec![kind(1)]), whole(Vec::new())],
        vec![thumbnail(vec![kind(1)]), whole(vec![kind(0)]), thumbnail(vec![kind(1)])],
        vec![thumbnail(vec![kind(1)]), whole(Vec::new()), mask()],
    ] {
        let reading = read(&images);
        assert_eq!((reading.report.file_size, reading.map.width, reading.map.height), ([6, 5], 6, 5));
        has(&notes(&reading), &[says]);
        assert!(!notes(&reading).contains("more image"), "{}", notes(&reading));
        // The mask belongs to the image that is read.
        assert_eq!(reading.report.void_count, if images.len() == 3 && images[2].1 == 1 { 2 } else { 0 });
        let (low, high) = reading.map.elevation_range_m();
        assert!(low >= 100.0 && high == 303.0, "{low} to {high}");
    }
    let usual = read(&[whole(Vec::new()), thumbnail(vec![kind(1)])]);
    assert_eq!((usual.map.width, notes(&usual).as_str()), (6, ""), "overviews come after the image");
    let pages = read(&[whole(Vec::new()), whole(vec![kind(2)])]);
    has(&notes(&pages), &["the file has 1 more image of full resolution; the first one is read"]);
    let only = read(&[thumbnail(vec![kind(1)])]);
    assert_eq!(only.map.width, 2);
    has(&notes(&only), &["first image is of reduced resolution or a mask, but has no other"]);
}

#[test]
fn strips_that_are_shorter_than_declared_are_damaged() {
    let mut file = tiff(&[([6, 5], 32, Vec::new(), slope())]);
    let read = |file: &[u8]| heightmap::decode(Cursor::new(file), Path::new("made.tif"), &plain());
    assert!(read(&file).is_ok());
    // The entry that states the length of the strip begins with tag 279, type 4 and count 1.
    let at = file.windows(8).position(|part| part == [23, 1, 4, 0, 1, 0, 0, 0]).expect("it states the length of its strip") + 8;
    file[at] = 100;
    has(&one_line(read(&file)), &["strip 0 has 100 bytes, but needs 120", "damaged"]);
    file[at] = 0;
    has(&one_line(read(&file)), &["strip 0 has the offset", "the length 0", "damaged"]);
    file[at] = 120;
    has(&one_line(read(&file[..file.len() - 8])), &["ends too early", "truncated or damaged"]);
}

fn strs(arguments: &[String]) -> Vec<&str> {
    arguments.iter().map(String::as_str).collect()
}

/// Returns the heights that the heightmap of a scene folder stores, and the step between neighbouring codes, both in metres.
fn imported(folder: &str) -> (Vec<f32>, f32) {
    let scene = scene::load(folder).unwrap_or_else(|error| panic!("{error}"));
    let scene::World::Heightmap { height_range_m: [low, high], .. } = scene.world else { panic!("another world") };
    let codes = image::open(Path::new(folder).join("heightmap.png")).expect("readable").into_luma16();
    (codes.pixels().map(|p| (low + (high - low) * f64::from(p.0[0]) / 65_535.0) as f32).collect(), ((high - low) / 65_535.0) as f32)
}

#[test]
fn the_program_imports_what_it_says_or_leaves_nothing_behind() {
    let temp = Folder::new("cases-heightmaps");
    let path = |name: &str| case(name).display().to_string();
    let call = |name: &str, more: &[&str], out: &str| {
        let file = path(name);
        let mut arguments = vec!["import".to_owned(), file];
        arguments.extend(more.iter().map(|argument| (*argument).to_owned()));
        arguments.extend(["--out".to_owned(), temp.path(out)]);
        arguments
    };
    // The file states its spacing, scale and offset.
    let said = success(&strs(&call("01-geotiff-scale-offset/int16_scale.tif", &[], "scaled")));
    has(
        &said,
        &["65 x 49 samples", "spacing: 10 m, from the file", "scale 0.1, offset 500", "elevations: 300.00 to 900.00 m", "procedural"],
    );
    let (heights, step) = imported(&temp.path("scaled"));
    assert!(difference(&heights, &truth("01-geotiff-scale-offset/truth.f32")) <= 1e-3 + step);
    // With `--holes`, samples without data become holes in the ground.
    let said = success(&strs(&call("05-internal-mask/masked.tif", &["--holes"], "holes")));
    has(&said, &["holes in the ground: 20 that its mask hides", "holes: 20"]);
    let scene = scene::load(&temp.path("holes")).unwrap_or_else(|error| panic!("{error}"));
    let world = World::new(&scene).expect("valid");
    let reading = read("05-internal-mask/masked.tif", &ReadOptions { voids: Voids::Holes, ..plain() });
    let is_open = |column: u32, row: u32| world.is_hole(f64::from(column) * 10.0 - 320.0, 240.0 - f64::from(row) * 10.0);
    let open = (0..49).flat_map(|row| (0..65).map(move |column| [column, row])).filter(|&[column, row]| is_open(column, row));
    assert!(open.eq(reading.holes.iter().copied()), "ground is open at the samples without data, and nowhere else");
    // A dry run writes nothing.
    let said = success(&strs(&call("07-south-up/south_up.tif", &["--dry-run"], "dry")));
    has(&said, &["rows run from south to north in the file; turned", "nothing is written"]);
    let without_out = success(&["import", &path("07-south-up/south_up.tif"), "--dry-run"]);
    assert_eq!(said, without_out);
    // The smallest possible map, with 2 x 2 samples, is also imported as a scene.
    has(&success(&strs(&call("16-sizes/2x2.tif", &[], "smallest"))), &["2 x 2 samples"]);
    let cases: [(&str, &[&str], &[&str]); 6] = [
        ("05-internal-mask/masked.tif", &[], &["20 that its mask hides"]),
        ("03-int16-untagged-void/int16_9999.tif", &["--height-range", "-32768,32767"], &["value -9999"]),
        ("08-spacing-in-file/degrees.tif", &["--metres-per-texel", "30"], &["gdalwarp"]),
        ("08-spacing-in-file/ten_metres.tif", &["--metres-per-texel", "30"], &["contradicts"]),
        ("08-spacing-in-file/ten_metres.tif", &["--raw-size", "65x49"], &["--raw-size does not apply"]),
        ("27-exr-channels/colour_rgb.exr", &["--metres-per-texel", "10"], &["--channel"]),
    ];
    for (name, more, words) in cases {
        failure(&strs(&call(name, more, "refused")), words);
    }
    usage_error(&["import", "x.tif"], &["--out"]);
    failure(&strs(&call("23-exr-normalised/unit.exr", &[], "refused")), &["does not say how far apart", "give --metres-per-texel"]);
    usage_error(&["import", "x.tif", "--out", "y", "--no-data", "ground"], &["neither a number nor `none`"]);
    usage_error(&["import", "x.tif", "--out", "y", "--no-data", "none", "--no-data", "-9999"], &["none excludes"]);
    usage_error(&["import", "x.tif", "--out", "y", "--fill-voids", "--holes"], &["--holes"]);
    usage_error(&["import", "x.tif", "--out", "y", "--tile-size", "2"], &["--materials"]);
    let mut left: Vec<String> = fs::read_dir(&temp.0).expect("readable").filter_map(|e| e.ok()?.file_name().into_string().ok()).collect();
    left.sort();
    assert_eq!(left, ["holes", "scaled", "smallest"], "nothing is half-written");
}

/// A place (metres east and north of the centre of a world), and the correct height there, metres.
type Place = ([f64; 2], f64);

/// Heights of most cases at six places: the corners, the centre, and a place in the north-west. GDAL and OpenEXR wrote the files of these cases from
/// one array of 65 x 49 samples. The positions are those for a spacing of 10 m.
const PLACES: [Place; 6] = [
    ([-320.0, 240.0], 805.748),
    ([320.0, 240.0], 822.5),
    ([-320.0, -240.0], 867.298),
    ([320.0, -240.0], 837.4),
    ([0.0, 0.0], 367.502),
    ([-120.0, 170.0], 375.268),
];

/// The corners of the case with 160 x 96 samples.
const SPARSE_PLACES: [Place; 4] =
    [([-795.0, 475.0], 763.916), ([795.0, 475.0], 732.158), ([-795.0, -475.0], 875.682), ([795.0, -475.0], 888.061)];

/// A file that the program imports as a whole, and the expected result.
struct Imported {
    file: &'static str,
    options: &'static [&'static str],
    truth: &'static str,
    /// Metres from one sample to the next.
    spacing_m: f64,
    /// Largest accepted errors, metres: against `truth`, and against the heights in `PLACES` or `SPARSE_PLACES`. They cover the rounding of the
    /// samples or of the truth to integers or tenths.
    tolerances: [f64; 2],
    /// Columns and rows of the samples without data.
    without_data: Option<[std::ops::Range<usize>; 2]>,
}

#[test]
fn worlds_of_imported_files_have_the_right_heights_at_the_right_places() {
    let temp = Folder::new("cases-worlds");
    let whole = |file: &'static str, options: &'static [&'static str], truth: &'static str, tolerances: [f64; 2]| Imported {
        file,
        options,
        truth,
        spacing_m: 10.0,
        tolerances,
        without_data: None,
    };
    let exact = [1e-3; 2];
    let void = Some([20..25, 10..14]);
    let cases = [
        whole(
            "01-geotiff-scale-offset/int16_scale.tif",
            &["--metres-per-texel", "10", "--height-range", "-32768,32767"],
            "01-geotiff-scale-offset/truth.f32",
            [1e-3, 0.0501],
        ),
        whole("01-geotiff-scale-offset/f32_scale.tif", &["--metres-per-texel", "10"], "01-geotiff-scale-offset/truth.f32", [0.0501, 1e-3]),
        Imported {
            spacing_m: 12_000.0 / 3937.0,
            ..whole("02-geotiff-feet/us_survey_foot.tif", &["--metres-per-texel", "3.048"], "02-geotiff-feet/truth.f32", exact)
        },
        Imported {
            without_data: void.clone(),
            ..whole(
                "04-float-untagged-void/f32_-9999.tif",
                &["--metres-per-texel", "10", "--no-data", "-9999", "--fill-voids"],
                "09-compressions/truth.f32",
                exact,
            )
        },
        Imported {
            without_data: void.clone(),
            ..whole(
                "14-tagged-nodata/-9999_int16.tif",
                &["--metres-per-texel", "10", "--height-range", "-32768,32767", "--fill-voids"],
                "09-compressions/truth.f32",
                [0.501; 2],
            )
        },
        Imported { without_data: void.clone(), ..whole("05-internal-mask/masked.tif", &["--holes"], "09-compressions/truth.f32", exact) },
        Imported {
            without_data: Some([64..96, 32..64]),
            ..whole("06-sparse-tiles/sparse_nodata.tif", &["--fill-voids"], "06-sparse-tiles/truth.f32", exact)
        },
        whole("06-sparse-tiles/sparse_no_tag.tif", &[], "06-sparse-tiles/truth_untagged.f32", [0.501; 2]),
        whole("07-south-up/south_up.tif", &["--metres-per-texel", "10"], "07-south-up/truth.f32", exact),
        whole("13-miniswhite/f32_miniswhite.tif", &["--metres-per-texel", "10"], "13-miniswhite/truth.f32", exact),
        whole(
            "13-miniswhite/u16_miniswhite.tif",
            &["--metres-per-texel", "10", "--height-range", "0,65535"],
            "13-miniswhite/truth_int.f32",
            [1e-3, 0.501],
        ),
        whole(
            "23-exr-normalised/unit.exr",
            &["--metres-per-texel", "10", "--height-range", "300,900"],
            "23-exr-normalised/truth.f32",
            exact,
        ),
        whole("28-exr-windows/offset_whole.exr", &["--metres-per-texel", "10"], "28-exr-windows/truth.f32", exact),
        whole("26-exr-multipart/colour_then_height.exr", &["--metres-per-texel", "10"], "26-exr-multipart/truth.f32", exact),
    ];
    for (index, case_of) in cases.iter().enumerate() {
        let out = temp.path(&format!("scene-{index}"));
        let source = case(case_of.file).display().to_string();
        let mut arguments = vec!["import", source.as_str(), "--out", out.as_str()];
        arguments.extend(case_of.options);
        success(&arguments);
        let scene = scene::load(&out).unwrap_or_else(|error| panic!("{error}"));
        let world = World::new(&scene).unwrap_or_else(|error| panic!("{error}"));
        check_world(&world, case_of);
    }
}

/// Checks the extent, the heights and the holes of a world. The heights are compared at the samples, and at the places whose heights are stated in
/// this file.
fn check_world(world: &World, of: &Imported) {
    let Imported { file, spacing_m, .. } = of;
    let truth = truth(of.truth);
    let (width, places) = if truth.len() == 160 * 96 { (160, &SPARSE_PLACES[..]) } else { (65, &PLACES[..]) };
    let depth = truth.len() / width;
    // The heightmap of the scene has 16 bits, so one of its steps is added to the tolerances.
    let (low, high) = world.height_range_m();
    let [tolerance, of_stated] = of.tolerances.map(|tolerance| tolerance + (high - low) / 65_535.0);
    let east = |column: usize| (column as f64 - (width - 1) as f64 / 2.0) * spacing_m;
    let north = |row: usize| ((depth - 1) as f64 / 2.0 - row as f64) * spacing_m;
    let [east_edge, north_edge] = world.extent_m().map(|length| length / 2.0);
    assert!((east_edge - east(width - 1)).abs() < 1e-6 && (north_edge - north(0)).abs() < 1e-6, "{file}: {east_edge}, {north_edge}");
    let has_data = |column: usize, row: usize| {
        of.without_data.as_ref().is_none_or(|[columns, rows]| !(columns.contains(&column) && rows.contains(&row)))
    };
    let opens = of.options.contains(&"--holes");
    let (mut mirrored, mut turned, mut filled) = (0.0f64, 0.0f64, 0);
    for (k, &right) in truth.iter().enumerate() {
        let (column, row) = (k % width, k / width);
        let (x, y, right) = (east(column), north(row), f64::from(right));
        let found = world.height_m(x, y);
        if has_data(column, row) {
            assert!((found - right).abs() <= tolerance, "{file}: {found} m instead of {right} m at sample {column}, {row}");
            assert!(!world.is_hole(x, y), "{file}: a hole at sample {column}, {row}");
            mirrored = mirrored.max((world.height_m(-x, y) - right).abs());
            turned = turned.max((world.height_m(x, -y) - right).abs());
        } else {
            // Samples without data are filled from the samples around them. The ground has a hole there only if the option `--holes` is given.
            assert!((299.0..901.0).contains(&found), "{file}: {found} m in the gap");
            assert_eq!(world.is_hole(x, y), opens, "{file}: sample {column}, {row}");
            filled += 1;
        }
    }
    assert!(mirrored > 50.0 && turned > 50.0, "{file}: a mirrored map passes");
    assert_eq!(filled > 0, of.without_data.is_some(), "{file}");
    for ([x, y], right) in places {
        let found = world.height_m(x / 10.0 * spacing_m, y / 10.0 * spacing_m);
        assert!((found - right).abs() <= of_stated, "{file}: {found} m instead of {right} m at {x}, {y}");
    }
}

#[test]
fn what_a_killed_import_left_behind_is_removed_by_the_next_one() {
    let temp = Folder::new("cases-killed");
    let (source, out) = (case("07-south-up/south_up.tif").display().to_string(), temp.path("scene"));
    // No process locks the folder `dead`, so it counts as left behind by a killed import. Its number is too high to be the process id of this test.
    // The names in `others` are only similar, so their folders must be kept.
    let (dead, others) = (temp.0.join(".scene.part-4294967294"), [".scene.part-", ".scene.part-x", ".other.part-4294967294"]);
    for name in [".scene.part-4294967294"].iter().chain(&others) {
        fs::create_dir(temp.0.join(name)).expect("created");
        fs::write(temp.0.join(name).join("heightmap.png"), "half").expect("written");
    }
    fs::write(temp.0.join(".scene.part-4294967294.lock"), "").expect("written");
    // A folder that this process fills at the moment.
    let filled = WholeFolder::beside(Path::new(&out)).unwrap_or_else(|error| panic!("{error}"));
    fs::write(filled.folder().join("heightmap.png"), "half").expect("written");
    let dry = success(&["import", &source, "--out", &out, "--dry-run"]);
    assert!(dead.is_dir() && !dry.contains("removed"), "a dry run removes nothing");
    let said = success(&["import", &source, "--out", &out]);
    has(&said, &[&format!("removed {}, which an import left behind", dead.display())]);
    assert_eq!(said.matches("removed").count(), 1, "{said}");
    assert!(!dead.exists() && !temp.0.join(".scene.part-4294967294.lock").exists());
    assert!(others.iter().all(|name| temp.0.join(name).is_dir()) && filled.folder().join("heightmap.png").is_file());
    let files = fs::read_dir(&out).expect("imported").count();
    assert_eq!((files, Path::new(&out).join("scene.toml").is_file()), (2, true), "nothing else is in the scene");
    drop(filled);
    let left = fs::read_dir(&temp.0).expect("readable").count();
    assert_eq!(left, 1 + others.len(), "neither folders nor locks are left");
    // A killed process may have had the same process id as this process. The files that it left behind must not become part of the folder.
    let place = temp.0.join("again");
    let own = temp.0.join(format!(".again.part-{}", std::process::id()));
    fs::create_dir(&own).expect("created");
    fs::write(own.join("old"), "").expect("written");
    let whole = WholeFolder::beside(&place).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(whole.folder(), own);
    has(&one_line(WholeFolder::beside(&place)), &["again", "is being written already"]);
    fs::write(whole.folder().join("new"), "").expect("written");
    whole.finish().unwrap_or_else(|error| panic!("{error}"));
    assert!(place.join("new").is_file() && !place.join("old").exists());
}

#[test]
fn an_import_that_is_stopped_leaves_nothing_behind() {
    let temp = Folder::new("cases-stopped");
    let out = temp.0.join("scene");
    let understood = scene_folder::examine(&case("07-south-up/south_up.tif"), &ImportOptions::default(), &|| false)
        .unwrap_or_else(|error| panic!("{error}"));
    let asked = std::cell::Cell::new(0);
    for stops_at in 1..=5 {
        asked.set(0);
        let stopped = || {
            asked.set(asked.get() + 1);
            asked.get() >= stops_at
        };
        has(&one_line(understood.write(&out, &stopped)), &["stopped", "nothing was written"]);
        assert_eq!(fs::read_dir(&temp.0).expect("readable").count(), 0, "stopped at {stops_at}");
    }
    understood.write(&out, &|| false).unwrap_or_else(|error| panic!("{error}"));
    assert!(out.join("scene.toml").is_file(), "negative control: not stopped");
}

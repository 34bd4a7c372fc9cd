//! Tests `experiments compare` and `experiments probe` with files that other programs wrote (`tests/cases`), and with files that the tests make.
//! Pictures may state windows, primaries, exponents, profiles, an orientation, alpha and layers; tables have different encodings, delimiters and
//! decimal signs. Each of these properties must be applied, reported or refused.

use std::fs;
use std::io::BufReader;
use std::path::Path;

use exr::prelude as e;
use image::ImageEncoder as _;
use kernels::decode::openexr::{self, Part};
use serde_json::Value;

use crate::fixtures::{self, Folder, failure, success};

const SIZE: [u32; 2] = [12, 8];

fn case(name: &str) -> String {
    fixtures::case(name).display().to_string()
}

fn part(name: &str) -> Part {
    let file = fs::File::open(case(name)).expect("the case is in the repository");
    let parts = openexr::read(BufReader::new(file), 1000).unwrap_or_else(|fault| panic!("{name}: {fault}"));
    parts.into_iter().next().expect("a part")
}

fn json(arguments: &[&str]) -> Value {
    serde_json::from_str(&success(&[&["compare", "--json"][..], arguments].concat())).expect("JSON")
}

/// Returns the texts of the notes about one subject in the JSON output of `compare`.
fn notes(answer: &Value, about: &str) -> Vec<String> {
    let all = answer["notes"].as_array().cloned().unwrap_or_default();
    all.iter().filter(|note| note["about"] == about).map(|note| note["text"].as_str().expect("a text").to_owned()).collect()
}

/// Checks that there is one note about the subject, and that it contains all of `says`.
fn noted(answer: &Value, about: &str, says: &[&str]) {
    let found = notes(answer, about);
    assert!(found.len() == 1 && says.iter().all(|part| found[0].contains(part)), "{says:?} is not what is noted about {about}: {answer}");
}

fn below(value: &Value, limit: f64) -> bool {
    value.as_f64().expect("a number") < limit
}

fn close(value: &Value, expected: f64, relative: f64) {
    let value = value.as_f64().unwrap_or(f64::NAN);
    assert!((value - expected).abs() <= relative * expected.abs(), "{value} is not {expected}");
}

/// Lossless compression of tiles in a fixed order, so that the bytes of a file do not depend on the timing of threads.
const ENCODING: e::Encoding = e::Encoding { line_order: e::LineOrder::Increasing, ..e::Encoding::FAST_LOSSLESS };

/// Writes an OpenEXR file of `SIZE` with these channels, which are uniform, and these chromaticities. Returns its path.
fn exr(folder: &Folder, name: &str, channels: &[(&str, f32)], chromaticities: Option<e::attribute::Chromaticities>) -> String {
    let size = SIZE.map(|n| n as usize);
    let channels = channels.iter().map(|(name, value)| e::AnyChannel::new(*name, e::FlatSamples::F32(vec![*value; size[0] * size[1]])));
    let channels = e::AnyChannels::sort(channels.collect());
    let layer = e::Layer::new((size[0], size[1]), e::LayerAttributes::default(), ENCODING, channels);
    let attributes = e::ImageAttributes { chromaticities, ..e::ImageAttributes::with_size(e::Vec2(size[0], size[1])) };
    let path = folder.path(name);
    e::WritableImage::write(&e::Image::new(attributes, layer)).to_file(&path).expect("an OpenEXR file can be written");
    path
}

fn grey(folder: &Folder, name: &str, value: f32) -> String {
    exr(folder, name, &[("R", value), ("G", value), ("B", value)], None)
}

/// Writes a PNG of one colour, with this ICC profile unless it is empty. Returns its path.
fn png(folder: &Folder, name: &str, colour: [u8; 3], profile: &[u8]) -> String {
    let path = folder.path(name);
    let picture = image::RgbImage::from_pixel(SIZE[0], SIZE[1], image::Rgb(colour));
    let mut bytes = Vec::new();
    let mut encoder = image::codecs::png::PngEncoder::new(&mut bytes);
    if !profile.is_empty() {
        encoder.set_icc_profile(profile.to_vec()).expect("PNG can have a profile");
    }
    encoder.write_image(&picture, SIZE[0], SIZE[1], image::ExtendedColorType::Rgb8).expect("a PNG can be encoded");
    fs::write(&path, bytes).expect("a temporary file can be written");
    path
}

/// Adds a chunk to a PNG, after its header.
fn add_chunk(file: &str, kind: &[u8; 4], content: &[u8]) {
    let covered = [kind.as_slice(), content].concat();
    let crc = !covered.iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 })
    });
    let length = u32::try_from(content.len()).expect("a small chunk").to_be_bytes();
    let mut bytes = fs::read(file).expect("the PNG is there");
    // The signature has 8 bytes, and the chunk of the header has 25 bytes.
    bytes.splice(33..33, [length.as_slice(), &covered, &crc.to_be_bytes()].concat());
    fs::write(file, bytes).expect("a temporary file can be written");
}

#[test]
fn pictures_are_aligned_by_their_windows() {
    let [auto, full] = ["black_auto_crop", "black_full"].map(|name| case(&format!("52-compare-data-window/{name}.exr")));
    for arguments in [[&auto, &full], [&full, &auto]] {
        let found = json(&arguments.map(String::as_str));
        assert!(found["identical"] == true && found["flip"]["max"] == 0.0 && found["pixels"] == 128 * 96, "{found}");
        // The number of pixels without data: 128 x 96 - 70 x 50.
        noted(&found, "window", &["black_auto_crop.exr", "70 x 50 at (30, 20)", "128 x 96 at (0, 0)", "8788 pixels", "count as black"]);
    }
    assert!(success(&["compare", &auto, &full]).contains("\nnote       "), "notes are not printed");
    let same = json(&[&full, &full]);
    assert!(same.get("notes").is_none(), "nothing is to be said: {same}");
}

#[test]
fn pixels_that_only_one_file_has_are_not_guessed() {
    let [left, right, full] = ["left", "right", "full"].map(|name| case(&format!("52-compare-data-window/{name}.exr")));
    // Each of these two files lacks 16 columns of 96 rows that the other file has, so 2 x 16 x 96 pixels are in only one file.
    failure(&["compare", &left, &right], &["left.exr stores 112 x 96 at (0, 0)", "right.exr stores 112 x 96 at (16, 0)", "3072 pixels"]);
    failure(&["compare", &full, &left], &["full.exr stores 128 x 96 at (0, 0)", "left.exr stores 112 x 96 at (0, 0)", "1536 pixels"]);
    // Viewers show pixels without data as black. A picture that is really black there must be equal to the cropped file.
    let folder = Folder::new("compare-windows");
    let whole = part("52-compare-data-window/full.exr");
    for (file, columns) in [(&left, 0..112), (&right, 16..128)] {
        let black = whole.channels.iter().map(|channel| {
            let keep = |(index, value): (usize, &f32)| if columns.contains(&(index % 128)) { *value } else { 0.0 };
            let samples = channel.samples.iter().enumerate().map(keep).collect();
            e::AnyChannel::new(channel.name.as_str(), e::FlatSamples::F32(samples))
        });
        let channels = e::AnyChannels::sort(black.collect());
        let layer = e::Layer::new((128, 96), e::LayerAttributes::default(), ENCODING, channels);
        let path = folder.path("black.exr");
        e::WritableImage::write(&e::Image::from_layer(layer)).to_file(&path).expect("an OpenEXR file can be written");
        let found = json(&[file, &path, "--metric", "mse"]);
        assert!(found["identical"] == true && found["mse"] == 0.0, "{file}: {found}");
        noted(&found, "window", &["1536 pixels without data count as black"]);
    }
}

#[test]
fn pictures_at_different_places_are_refused() {
    let folder = Folder::new("compare-places");
    let at = |name: &str, x: i32| {
        let size = SIZE.map(|n| n as usize);
        let channel = |name: &str| e::AnyChannel::new(name, e::FlatSamples::F32(vec![0.5; size[0] * size[1]]));
        let channels = e::AnyChannels::sort(["R", "G", "B"].map(channel).into_iter().collect());
        let own = e::LayerAttributes { layer_position: e::Vec2(x, 0), ..e::LayerAttributes::default() };
        let layer = e::Layer::new((size[0], size[1]), own, ENCODING, channels);
        let attributes = e::ImageAttributes::new(e::attribute::IntegerBounds::new((x, 0), (size[0], size[1])));
        let path = folder.path(name);
        e::WritableImage::write(&e::Image::new(attributes, layer)).to_file(&path).expect("an OpenEXR file can be written");
        path
    };
    let (here, there) = (at("here.exr", 0), at("there.exr", 5));
    failure(&["compare", &here, &there], &["here.exr shows 12 x 8 at (0, 0)", "there.exr shows 12 x 8 at (5, 0)", "same display window"]);
    let found = json(&[&there, &at("also.exr", 5)]);
    assert!(found["identical"] == true && found.get("notes").is_none(), "{found}");
}

#[test]
fn names_of_channels_may_be_lower_case() {
    let [test, reference, upper] = ["lower_test", "lower_ref", "ref"].map(|name| case(&format!("54-compare-channels/{name}.exr")));
    let expected: Value = serde_json::from_slice(&fs::read(case("54-compare-channels/expected.json")).expect("the case")).expect("JSON");
    close(&json(&[&test, &reference])["mse"], expected["mse"].as_f64().expect("a number"), 1e-6);
    // The two references differ only in the names of their channels.
    assert_eq!(json(&[&reference, &upper])["identical"], true);
}

#[test]
fn colours_are_converted_to_the_same_primaries() {
    let [test, reference] = ["xyz_chroma", "ref"].map(|name| case(&format!("54-compare-channels/{name}.exr")));
    let found = json(&[&test, &reference]);
    assert_eq!(found["identical"], false);
    noted(&found, "primaries", &["xyz_chroma.exr", "R 0.713 0.293", "white 0.32168 0.33767", "converted to Rec. 709"]);
    // The published matrix from these primaries (ACEScg) to Rec. 709, with Bradford adaptation, to 6 decimals. Both files store the same numbers, so
    // the expected error is the difference between converted and unconverted numbers.
    let matrix = [[1.705_051, -0.621_792, -0.083_259], [-0.130_256, 1.140_805, -0.010_548], [-0.024_003, -0.128_969, 1.152_972]];
    let pixels = part("54-compare-channels/ref.exr");
    let channels = ["R", "G", "B"].map(|name| &pixels.channel(name).expect("a colour").samples);
    let mut sum = 0.0;
    for index in 0..channels[0].len() {
        let colour = channels.map(|samples| f64::from(samples[index]));
        for (row, own) in matrix.iter().zip(colour) {
            let converted: f64 = row.iter().zip(colour).map(|(weight, value)| weight * value).sum();
            sum += (converted - own).powi(2);
        }
    }
    close(&found["mse"], sum / (3 * channels[0].len()) as f64, 1e-4);
    // If both files have the same primaries, nothing differs, and there is a note about each of the two conversions.
    let same = json(&[&test, &test]);
    assert!(same["identical"] == true && notes(&same, "primaries").len() == 2, "{same}");
    let folder = Folder::new("compare-primaries");
    let point = |x, y| e::Vec2(x, y);
    let line =
        e::attribute::Chromaticities { red: point(0.1, 0.1), green: point(0.25, 0.25), blue: point(0.5, 0.5), white: point(0.3, 0.3) };
    let wrong = exr(&folder, "line.exr", &[("R", 0.5), ("G", 0.5), ("B", 0.5)], Some(line));
    failure(&["compare", &wrong, &reference], &["line.exr", "no colour space"]);
    // In a file without colours, the same chromaticities have no effect.
    let depth = exr(&folder, "depth.exr", &[("Z", 0.5)], Some(line));
    assert!(json(&[&depth, &depth]).get("notes").is_none());
}

#[test]
fn layers_are_not_chosen_in_silence() {
    let folder = Folder::new("compare-layer-names");
    let two = ["beauty.R", "beauty.G", "beauty.B", "albedo.r", "albedo.g", "albedo.b"].map(|name| (name, 0.5));
    let ambiguous = exr(&folder, "two.exr", &two, None);
    failure(&["compare", &ambiguous, &ambiguous], &["two.exr", "2 layers", "albedo, beauty", "--layer"]);
    assert!(json(&[&ambiguous, &ambiguous, "--layer", "Albedo"]).get("notes").is_none());
    // In each file, only one layer has colours, so this layer is compared. The other layer is `depth`.
    let [colour, plain] = [("one.exr", &two[..3]), ("plain.exr", &[("R", 0.5), ("G", 0.5), ("B", 0.5)][..])].map(|(name, channels)| {
        let channels = [channels, &[("depth.V", 9.0)]].concat();
        exr(&folder, name, &channels, None)
    });
    let found = json(&[&colour, &plain]);
    assert_eq!(found["identical"], true);
    noted(&found, "layer", &["one.exr", "`beauty`"]);
}

#[test]
fn the_exponent_and_primaries_of_a_png_are_used() {
    let folder = Folder::new("compare-png");
    let linear = png(&folder, "linear.png", [128, 128, 128], &[]);
    add_chunk(&linear, b"gAMA", &100_000_u32.to_be_bytes());
    let found = json(&[&linear, &grey(&folder, "grey.exr", 128.0 / 255.0), "--metric", "mse"]);
    assert!(below(&found["mse"], 1e-12), "{found}");
    noted(&found, "gamma", &["linear.png", "gamma of 1"]);
    // Programs write the exponent 1/2.2 for sRGB, so it is read as sRGB.
    let [usual, bare] = ["usual.png", "bare.png"].map(|name| png(&folder, name, [128, 10, 200], &[]));
    add_chunk(&usual, b"gAMA", &45_455_u32.to_be_bytes());
    let found = json(&[&usual, &bare]);
    assert!(found["identical"] == true && found.get("notes").is_none(), "{found}");
    // A PNG with the primaries of Rec. 2020, whose pure red lies outside the range of Rec. 709.
    let wide = png(&folder, "wide.png", [255, 0, 0], &[]);
    let chromaticities = [31_270_u32, 32_900, 70_800, 29_200, 17_000, 79_700, 13_100, 4_600].map(u32::to_be_bytes).concat();
    add_chunk(&wide, b"cHRM", &chromaticities);
    // The expected colour is the first column of a matrix from Rec. 2020 to Rec. 709: the inverse of the matrix in Rec. ITU-R BT.2087-0.
    let red = exr(&folder, "red.exr", &[("R", 1.6605), ("G", -0.1246), ("B", -0.0182)], None);
    let found = json(&[&wide, &red]);
    // The expected colour has only four decimals.
    assert!(below(&found["mse"], 1e-7), "{found}");
    noted(&found, "primaries", &["wide.png", "R 0.708 0.292"]);
    noted(&found, "clamped", &["flip, psnr, ssim"]);
    // If a PNG has the chunk sRGB, its exponent and its primaries are not used.
    add_chunk(&wide, b"sRGB", &[0]);
    let found = json(&[&wide, &png(&folder, "red.png", [255, 0, 0], &[])]);
    assert!(found["identical"] == true && found.get("notes").is_none(), "{found}");
    let zero = png(&folder, "zero.png", [1, 2, 3], &[]);
    add_chunk(&zero, b"gAMA", &[0; 4]);
    // An exponent of 0 is invalid and is ignored, as in libpng.
    assert!(json(&[&zero, &png(&folder, "none.png", [1, 2, 3], &[])])["identical"] == true);
}

#[test]
fn profiles_and_code_points_that_are_not_applied_are_named() {
    let folder = Folder::new("compare-profile");
    // Returns a profile that has only a description (ICC.1:2001-04, 6.5.17).
    let profile = |name: &str| {
        let text = [name.as_bytes(), b"\0"].concat();
        let length = u32::try_from(text.len()).expect("a short text");
        let content = [b"desc\0\0\0\0".as_slice(), &length.to_be_bytes(), &text].concat();
        let tag = [b"desc".as_slice(), &144_u32.to_be_bytes(), &u32::try_from(content.len()).expect("a short text").to_be_bytes()].concat();
        [vec![0; 128], 1_u32.to_be_bytes().to_vec(), tag, content].concat()
    };
    let bare = png(&folder, "bare.png", [200, 100, 50], &[]);
    let other = png(&folder, "other.png", [200, 100, 50], &profile("Display P3"));
    noted(&json(&[&other, &bare]), "colours", &["other.png", "ICC profile `Display P3`", "not applied"]);
    let usual = png(&folder, "usual.png", [200, 100, 50], &profile("sRGB IEC61966-2.1"));
    assert!(json(&[&usual, &bare]).get("notes").is_none());
    // The code points of Rec. 2100 PQ cause a note. The code points of sRGB cause none.
    for (points, is_noted) in [([9, 16, 0, 1], true), ([1, 13, 0, 1], false)] {
        let coded = png(&folder, "coded.png", [200, 100, 50], &[]);
        add_chunk(&coded, b"cICP", &points);
        let found = json(&[&coded, &bare]);
        assert_eq!(notes(&found, "colours").len(), usize::from(is_noted), "{found}");
    }
}

#[test]
fn pictures_are_turned_as_their_orientation_says() {
    let folder = Folder::new("compare-orientation");
    let ramp = image::RgbImage::from_fn(16, 12, |x, y| image::Rgb([(x * 15) as u8, (y * 20) as u8, 128]));
    let upright = folder.path("upright.png");
    ramp.save(&upright).expect("a PNG can be written");
    // The picture as a turned camera stores it. It must be rotated by 90 degrees clockwise to be upright.
    let stored = image::imageops::rotate270(&ramp);
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new_with_quality(&mut bytes, 100).encode_image(&stored).expect("a JPEG can be encoded");
    // Exif 2.3: a TIFF header and one entry, the orientation (tag 274), which is one 16-bit number with the value 6.
    let exif = b"Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
    let length = u16::try_from(exif.len() + 2).expect("a short segment").to_be_bytes();
    bytes.splice(2..2, [b"\xff\xe1".as_slice(), &length, exif].concat());
    let turned = folder.path("turned.jpg");
    fs::write(&turned, &bytes).expect("a temporary file can be written");
    let found = json(&[&turned, &upright]);
    // The best quality of JPEG leaves errors of a few codes.
    assert!(found["size"] == serde_json::json!([16, 12]) && found["psnr_db"].as_f64() > Some(30.0), "{found}");
    noted(&found, "orientation", &["turned.jpg", "90 degrees clockwise", "EXIF"]);
    noted(&found, "compression", &["turned.jpg", "JPEG"]);
    // A truncated picture is refused. A preview that is stored before the picture has an end marker, which must not be taken for that of the picture.
    let length = u16::try_from(bytes.len() + 2).expect("a small preview").to_be_bytes();
    let (start, rest) = bytes.split_at(2);
    let with_preview = [start, b"\xff\xe1", &length, &bytes, rest].concat();
    let whole = folder.path("whole.jpg");
    fs::write(&whole, &with_preview).expect("a temporary file can be written");
    json(&[&whole, &whole]);
    let cut = folder.path("cut.jpg");
    fs::write(&cut, &with_preview[..with_preview.len() - 20]).expect("a temporary file can be written");
    failure(&["compare", &cut, &upright], &["cut.jpg", "truncated"]);
    // Negative control: the picture differs much from one that is turned by 180 degrees.
    let flipped = folder.path("flipped.png");
    image::imageops::rotate180(&ramp).save(&flipped).expect("a PNG can be written");
    assert!(below(&json(&[&turned, &flipped])["psnr_db"], 15.0));
}

#[test]
fn what_the_metrics_do_not_see_is_said() {
    let folder = Folder::new("compare-unseen");
    let colour = [("R", 0.25), ("G", 0.5), ("B", 0.75)];
    let opaque = exr(&folder, "opaque.exr", &colour, None);
    let clear = exr(&folder, "clear.exr", &[&colour[..], &[("A", 0.5)]].concat(), None);
    let found = json(&[&clear, &opaque]);
    assert_eq!(found["identical"], true);
    noted(&found, "alpha", &["differs in 96 pixels", "not compared"]);
    assert!(json(&[&clear, &clear]).get("notes").is_none(), "equal alpha is nothing special");
    // Both files have the same alpha, but only OpenEXR stores colours that are multiplied by alpha.
    let png_of = |name: &str, alpha: u8| {
        let path = folder.path(name);
        image::RgbaImage::from_pixel(SIZE[0], SIZE[1], image::Rgba([188, 188, 188, alpha])).save(&path).expect("a PNG can be written");
        path
    };
    let exr_of = |name: &str, alpha: f32| exr(&folder, name, &[("R", 0.5), ("G", 0.5), ("B", 0.5), ("A", alpha)], None);
    let found = json(&[&png_of("half.png", 128), &exr_of("alpha.exr", 128.0 / 255.0)]);
    noted(&found, "alpha", &["96 pixels are not opaque", "OpenEXR are multiplied by alpha, those of PNG are not"]);
    assert!(!notes(&found, "alpha")[0].contains("differs"), "{found}");
    let found = json(&[&png_of("whole.png", 255), &exr_of("one.exr", 1.0)]);
    assert!(notes(&found, "alpha").is_empty(), "opaque colours are the same in both: {found}");
    // Values above 1 are clamped for the metrics of displayed pictures, but not for the other metrics.
    let (bright, white) = (grey(&folder, "bright.exr", 3.0), grey(&folder, "white.exr", 1.0));
    let found = json(&[&bright, &white]);
    assert!(found["flip"]["max"] == 0.0 && found["mse"] == 4.0, "{found}");
    noted(&found, "clamped", &["288 values of", "bright.exr and 0 of", "white.exr", "flip, psnr, ssim"]);
    noted(&json(&[&bright, &white, "--metric", "ssim"]), "clamped", &["clamped for ssim"]);
    assert!(json(&[&bright, &white, "--metric", "mse,mrse"]).get("notes").is_none());
    // A picture of 8-bit codes is compared with a picture of floats.
    let codes = png(&folder, "codes.png", [188, 188, 188], &[]);
    noted(&json(&[&codes, &grey(&folder, "half.exr", 0.5)]), "precision", &["codes.png has 8-bit codes", "half.exr has floats", "1/510"]);
}

/// Runs the probe `select` on a table, and returns what was printed and written.
fn probe(folder: &Folder, table: &str) -> [String; 2] {
    let out = folder.path("out.csv");
    let printed = success(&["probe", "select", "--on", "f64", "--input", table, "--output", &out]);
    [printed, fs::read_to_string(&out).expect("the table was written")]
}

#[test]
fn tables_of_other_programs_are_read() {
    let folder = Folder::new("probe-tables");
    let plain = folder.write("plain.csv", "w_0,w_1,w_2,w_3,u\n1,1,1,1,0.1\n");
    let [printed, expected] = probe(&folder, &plain);
    assert_eq!((printed.as_str(), expected.as_str()), ("", "w_0,w_1,w_2,w_3,u,of_4,of_3\n1,1,1,1,0.1,0,0\n"));
    for (file, says) in [
        ("semicolon", &["semicolon.csv", "`;` between cells", "decimal commas"][..]),
        ("tab", &["tabs between cells"][..]),
        ("utf16", &["UTF-16 text"][..]),
        ("sep", &[][..]),
        ("bom", &[][..]),
        ("bom_quoted", &[][..]),
        ("blank_end", &[][..]),
        ("crlf", &[][..]),
    ] {
        let [printed, written] = probe(&folder, &case(&format!("61-probe-csv/{file}.csv")));
        assert_eq!(written, expected, "{file}");
        assert!(printed.is_empty() == says.is_empty() && says.iter().all(|part| printed.contains(part)), "{file}: {printed}");
    }
    // Commas in columns that the probe does not read are kept. Spaces around names and numbers are removed.
    let notes = folder.write("notes.csv", " w_0 ; w_1 ; w_2 ; w_3 ; u ; note \n 1 ; 1 ; 1 ; 1 ; 0,1 ; 1,5 or 2 \n");
    assert_eq!(probe(&folder, &notes)[1], "w_0,w_1,w_2,w_3,u,note,of_4,of_3\n1,1,1,1,0.1,\"1,5 or 2\",0,0\n");
}

#[test]
fn tables_that_may_mean_two_things_are_refused() {
    let folder = Folder::new("probe-ambiguous");
    let out = folder.path("out.csv");
    let refused = |input: &str, says: &[&str]| failure(&["probe", "select", "--on", "f64", "--input", input, "--output", &out], says);
    refused(&case("61-probe-csv/comma.csv"), &["comma.csv", "line 2", "`u`", "`0,1` has a decimal comma", "write 0.1"]);
    let table = |contents: &str| folder.write("table.csv", contents);
    refused(&table("w_0\tw_1\tw_2\tw_3\tu\n1\t1\t1\t1\t0,1\n"), &["line 2", "decimal comma"]);
    refused(&table("w_0;w_1;w_2;w_3;u\n1;1;1;1;0,1\n1.5;1;1;1;0\n"), &["line 3 has a decimal point", "line 2 a decimal comma"]);
    refused(&table("w_0;w_1;w_2;w_3;u\n1;1;1;1;1.000,5\n"), &["line 2", "`1.000,5` is not a number"]);
    refused(&table("w_0,w_1,w_2,w_3,u\n1,1,1,1,0,1\n"), &["line 2 has 6 cells (separated by `,`)", "decimal comma"]);
    refused(&table("w_0:w_1:w_2:w_3:u\n1:1:1:1:0\n"), &["no column `w_0`", "separated by `,`", "w_0:w_1:w_2:w_3:u"]);
    refused(&table("sep=:\nw_0:w_1:w_2:w_3:u\n"), &["table.csv", "first line", "delimiter"]);
    // The line that names the delimiter is line 1, and the header is line 2, so the row with the fault is line 3.
    refused(&table("sep=;\nw_0;w_1;w_2;w_3;u\n1;1;1;1;x\n"), &["line 3", "`x` is not a number"]);
    fs::write(folder.path("table.csv"), b"w_0,w_1,w_2,w_3,u\n1,1,1,1,\xb2\n").expect("a temporary file can be written");
    refused(&folder.path("table.csv"), &["not UTF-8", "line 2"]);
    assert!(!Path::new(&out).exists(), "a refused table left results");
}

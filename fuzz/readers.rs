//! Gives bytes to every reader of files and checks the outcome. The fuzz targets call these functions; `tests/parsers.rs` calls them without a
//! fuzzer.
//!
//! For any bytes, a reader must return a value or an error. It must not panic, it must not allocate more memory than the number of bytes justifies,
//! and its error must be one line. A value must be within the documented ranges. If a function below also writes the value, reading what was written
//! must give an equal value. Each function panics if a value or an error violates this; libFuzzer limits the memory. Otherwise, the function returns
//! whether a reader accepted the bytes.

use std::fmt::Display;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use eframe::egui;
use experiments::definition;
use experiments::judge;
use experiments::store::{Manifest, table};
use kernels::base::document;
use kernels::decode::heightmap::{self, ReadOptions};
use kernels::decode::openexr;
use kernels::materials::folder::{self, Convention, Reading};
use kernels::scene::{self, Scene};
use workbench::model::kept::{Kept, Refused};
use workbench::model::places::Recorded;
use workbench::model::settings::Settings;

/// The file name that is passed to readers together with the bytes. No file has this name.
const NAME: &str = "fuzz";

/// Returns the accepted value, if there is one. Panics if the error is not one line of text.
fn told<T, E: Display>(outcome: Result<T, E>) -> Option<T> {
    outcome.map_err(|refusal| is_told(&format!("{refusal:#}"))).ok()
}

fn is_told(line: &str) {
    assert!(!line.trim().is_empty() && !line.contains(char::is_control), "the error is not one line of text: {line:?}");
}

/// Reads a scene file.
pub fn scene(bytes: &[u8]) -> bool {
    let Some(text) = told(document::text(bytes.to_vec(), "scene")) else { return false };
    let Some(scene) = told(scene::parse(&text, NAME, Path::new(""))) else { return false };
    let again = toml::to_string(&scene).map(|text| scene::parse(&text, NAME, Path::new("")));
    assert!(matches!(&again, Ok(Ok(same)) if *same == scene), "writing and reading {scene:?} gave {again:?}");
    true
}

/// Reads an experiment's definition as a file, and in the form in which a run stores it. Returns whether it was accepted as a file.
pub fn definition(bytes: &[u8]) -> bool {
    let Some(text) = told(document::text(bytes.to_vec(), "definition")) else { return false };
    let is_whole = told(definition::parse(&text, NAME, Path::new(""))).is_some();
    let Some(stored) = told(definition::stored(&text)) else {
        assert!(!is_whole, "the definition was accepted as a file, but not in the form in which a run stores it");
        return false;
    };
    // Definitions are compared as texts, because a varied value may be NaN, which is not equal to itself.
    let text = stored.to_toml().unwrap_or_else(|error| panic!("{error:#}"));
    let again = definition::stored(&text).and_then(|again| again.to_toml());
    assert!(again.as_ref().is_ok_and(|again| *again == text), "writing and reading {text} gave {again:?}");
    is_whole
}

/// Reads the bytes as a heightmap with several sets of options. The first bytes determine the extension of the file name that the reader gets, and
/// thereby the format.
pub fn heightmap(bytes: &[u8]) -> bool {
    let names: &[&str] = match bytes {
        [0x89, b'P', b'N', b'G', ..] => &["fuzz.png"],
        [0x76, 0x2f, 0x31, 0x01, ..] => &["fuzz.exr"],
        [b'I', b'I', ..] | [b'M', b'M', ..] => &["fuzz.tif"],
        _ => &["fuzz.raw", "fuzz.r32"],
    };
    let is_raw = names.len() > 1;
    let range = Some([-500.0, 9000.0]);
    let unspaced =
        ReadOptions { voids: heightmap::Voids::Holes, no_data: heightmap::NoData::Named(vec![0.0, -9999.0]), ..ReadOptions::default() };
    let spaced = ReadOptions { metres_per_texel: Some(1.0), ..ReadOptions::default() };
    let ways = [
        ReadOptions { height_range_m: range, ..spaced.clone() },
        ReadOptions { voids: heightmap::Voids::Fill, ..spaced.clone() },
        ReadOptions { height_range_m: range, ..unspaced.clone() },
        ReadOptions {
            window: Some([1, 0, 2, 3]),
            raw_size: is_raw.then_some([4, 3]),
            raw_big_endian: is_raw,
            height_range_m: range,
            no_data: heightmap::NoData::Nothing,
            ..spaced
        },
        unspaced,
    ];
    let mut is_accepted = false;
    for (name, options) in names.iter().flat_map(|name| ways.iter().map(move |options| (name, options))) {
        let Some(reading) = told(heightmap::decode(Cursor::new(bytes), Path::new(name), options)) else { continue };
        let map = &reading.map;
        assert_eq!(map.samples.len(), map.width as usize * map.height as usize);
        assert!(map.samples.iter().all(|s| s.is_finite()) && map.max_slope().is_finite(), "{map:?}");
        assert!(map.metres_per_texel > 0.0 && map.metres_per_texel <= 1e5, "{}", map.metres_per_texel);
        assert!(reading.holes.iter().all(|&[column, row]| column < map.width && row < map.height));
        reading.report.to_string().lines().for_each(is_told);
        is_accepted = true;
    }
    is_accepted
}

/// Reads the bytes as an image of a material, once for each of several meanings of its channels. Also takes each line of the bytes as the
/// name of an image file, and assigns these files to materials. Returns whether the image was accepted with at least one meaning.
pub fn material(bytes: &[u8]) -> bool {
    let mut is_accepted = false;
    for reading in [
        Reading::Colour,
        Reading::Normal(Convention::OpenGl),
        Reading::Normal(Convention::DirectX),
        Reading::Height(None),
        Reading::Height(Some(2)),
        Reading::Share { channel: None, inverted: true },
        Reading::Share { channel: Some(1), inverted: false },
    ] {
        // TGA files have no signature. With this extension, bytes without the signature of another image format are read as TGA.
        let Some(map) = told(folder::read(Cursor::new(bytes), Path::new("fuzz.tga"), reading)) else { continue };
        assert!(map.edge > 0 && map.texels.len() == map.edge * map.edge);
        let lowest = if matches!(reading, Reading::Normal(_)) { -1.0001 } else { -1e-6 };
        assert!(map.texels.iter().flatten().all(|c| (lowest..=1.0001).contains(c)), "a value is out of range: {reading:?}");
        map.remarks.iter().for_each(|line| is_told(line));
        is_accepted = true;
    }
    let text = String::from_utf8_lossy(bytes);
    let files: Vec<PathBuf> = text.lines().map(|name| Path::new(NAME).join(name)).collect();
    for set in folder::sort_out(&files).sets {
        told(set.choose(Path::new(NAME), &files));
    }
    is_accepted
}

/// Reads the bytes as a picture, as the command `compare` reads a file.
pub fn texture(bytes: &[u8]) -> bool {
    let pictures = [None, Some("albedo")].map(|layer| told(judge::Image::decode(Cursor::new(bytes), Path::new(NAME), layer)));
    for picture in pictures.iter().flatten() {
        let area = picture.size[0] as usize * picture.size[1] as usize;
        assert_eq!(picture.texels.len(), area);
        assert!(picture.alpha.as_ref().is_none_or(|alpha| alpha.len() == area), "alpha has another size");
        assert!(picture.texels.iter().flatten().all(|c| c.is_finite()), "a texel is not finite");
        let side = judge::Side { file: Path::new(NAME), image: picture };
        judge::notes(side, side, None, &judge::Metric::ALL).iter().for_each(|note| is_told(&note.text));
        assert!(judge::check_windows(side, side, None).is_ok(), "a picture cannot be laid on itself");
    }
    pictures.iter().any(Option::is_some)
}

/// Reads all parts of an OpenEXR file.
pub fn openexr(bytes: &[u8]) -> bool {
    let Some(parts) = told(openexr::read(Cursor::new(bytes), 4096)) else { return false };
    assert!(!parts.is_empty() && parts.iter().all(|part| !part.channels.is_empty()), "a part has no channel");
    for part in &parts {
        let [width, height] = part.data_window.size.map(|n| n as usize);
        assert!((1..=4096).contains(&width) && (1..=4096).contains(&height), "{}", part.data_window);
        for channel in &part.channels {
            assert_eq!(channel.samples.len(), width * height);
            assert!(part.channel(&channel.name).is_some_and(|found| found.name == channel.name), "{:?} is not found", channel.name);
        }
        if let Some(stated) = part.chromaticities {
            assert!(stated.to_rec_709().is_none_or(|matrix| matrix.is_finite()), "{stated}");
        }
    }
    true
}

/// Reads the bytes as files that the programs write themselves: a table or a manifest of a run, the state of the workbench, and a recorded camera
/// path.
pub fn cache(bytes: &[u8]) -> bool {
    let table = told(table::decode_parquet(Bytes::copy_from_slice(bytes), Path::new(NAME)));
    let path = told(Recorded::from_csv(NAME, bytes, NAME));
    if let Some(path) = &path {
        assert_eq!(Recorded::from_csv(NAME, path.to_csv().as_bytes(), NAME).as_ref(), Ok(path));
    }
    let manifest = std::str::from_utf8(bytes).ok().and_then(|text| told(Manifest::parse(text, Path::new(NAME))));
    table.is_some() || path.is_some() || manifest.is_some() || kept(bytes)
}

fn kept(bytes: &[u8]) -> bool {
    let kept = match Kept::parse(bytes.to_vec(), NAME) {
        Ok(kept) => kept,
        Err(Refused::Foreign(line)) => {
            is_told(&line);
            return false;
        }
        Err(Refused::Newer(_)) => return false,
    };
    let mut settings = Settings::new(default_scene());
    let said = [kept.apply_look(&mut settings), kept.apply_numbers(scene::DEFAULT, &mut settings.scene)].concat();
    said.iter().for_each(|line| is_told(line));
    assert!(scene::validate(&settings.scene).is_ok(), "the stored numbers made the scene invalid");
    kept.tree(egui::Id::unique(NAME));
    kept.places(scene::DEFAULT);
    // States are compared as texts, because a number may be NaN, which is not equal to itself.
    let text = toml::to_string(&kept).unwrap_or_else(|error| panic!("{error}"));
    let again = Kept::parse(text.clone().into_bytes(), NAME).map(|again| toml::to_string(&again));
    assert!(again.as_ref().is_ok_and(|again| again.as_ref() == Ok(&text)), "writing and reading {text} gave {again:?}");
    true
}

fn default_scene() -> Scene {
    scene::parse(scene::DEFAULT_TEXT, scene::DEFAULT, Path::new("")).unwrap_or_else(|error| panic!("the built-in scene: {error}"))
}

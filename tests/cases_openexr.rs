//! Tests the OpenEXR reader with files that other programs wrote (`tests/cases`): parts, layers, channels, windows, and a compression that is not
//! supported.

use std::fs::{self, File};
use std::io::BufReader;

use kernels::decode::fault::Fault;
use kernels::decode::openexr::{self, Kind, Part, Window};

use crate::fixtures::case;

fn read(name: &str) -> Result<Vec<Part>, Fault> {
    openexr::read(BufReader::new(File::open(case(name)).expect("the case is in the repository")), 1000)
}

fn parts(name: &str) -> Vec<Part> {
    read(name).unwrap_or_else(|fault| panic!("{name}: {fault}"))
}

/// Reads the correct heights of a case, metres.
fn truth(folder: &str) -> Vec<f32> {
    let bytes = fs::read(case(folder).join("truth.f32")).expect("the case has a truth");
    let heights: Vec<f32> = bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    assert_eq!(heights.len(), 65 * 49);
    heights
}

/// Names of the channels of all parts.
fn names(parts: &[Part]) -> Vec<&str> {
    parts.iter().flat_map(|part| &part.channels).map(|channel| channel.name.as_str()).collect()
}

#[test]
fn compressions_that_are_not_supported_are_named() {
    let fault = read("25-exr-compressions/htj2k32.exr").expect_err("HTJ2K is not supported");
    let text = fault.to_string();
    assert!(matches!(fault, Fault::Unsupported(_)) && text.contains("compression HTJ2K32 is not supported"), "{text}");
}

#[test]
fn all_parts_are_read_in_their_order() {
    let heights = truth("26-exr-multipart");
    for (file, order) in [("colour_then_height", ["colour", "height"]), ("height_then_colour", ["height", "colour"])] {
        let parts = parts(&format!("26-exr-multipart/{file}.exr"));
        assert_eq!(parts.iter().map(|part| part.name.as_str()).collect::<Vec<_>>(), order);
        let height = parts.iter().find(|part| part.name == "height").expect("a part of this name");
        assert_eq!(height.channel("Y").expect("a channel Y").samples, heights, "{file}");
        assert!(height.channel("R").is_none(), "red belongs to the other part");
    }
}

#[test]
fn channels_are_read_with_their_layers() {
    let heights = truth("27-exr-channels");
    for (file, all, height) in [
        ("beauty_and_height", &["B", "G", "R", "height.Y"][..], "height.Y"),
        ("layer_height", &["terrain.height", "terrain.mask"][..], "height"),
        ("layer_single", &["heightfield.V"][..], "V"),
        ("lower_y", &["y"][..], "Y"),
        ("alpha_y", &["A", "Y"][..], "y"),
        ("rgb_equal", &["B", "G", "R"][..], "G"),
    ] {
        let parts = parts(&format!("27-exr-channels/{file}.exr"));
        assert_eq!(names(&parts), all, "{file}");
        let channel = parts[0].channel(height).unwrap_or_else(|| panic!("{file} has no channel {height}"));
        assert_eq!((channel.kind, &channel.samples), (Kind::Float, &heights), "{file}");
    }
    let whole = parts("27-exr-channels/uint.exr");
    assert_eq!(whole[0].channels[0].kind, Kind::Uint);
    // The integers are millimetres.
    let far = whole[0].channels[0].samples.iter().zip(&heights).map(|(mm, m)| (mm / 1000.0 - m).abs()).fold(0.0, f32::max);
    assert!(far <= 0.001, "{far} m");
}

#[test]
fn windows_are_told_apart() {
    let cropped = &parts("28-exr-windows/cropped.exr")[0];
    assert_eq!(cropped.data_window, Window { position: [12, 10], size: [48, 30] });
    assert_eq!(cropped.display_window, Window { position: [0, 0], size: [65, 49] });
    let offset = &parts("28-exr-windows/offset_whole.exr")[0];
    assert_eq!(offset.data_window, Window { position: [-7, 5], size: [65, 49] });
    assert_eq!(offset.display_window, offset.data_window);
    let heights = truth("28-exr-windows");
    assert_eq!(offset.channels[0].samples, heights);
    // The correct heights cover the whole picture. The cropped file has a part of them.
    let inside: Vec<f32> = (10..40).flat_map(|row| heights[row * 65 + 12..][..48].to_vec()).collect();
    assert_eq!(cropped.channels[0].samples, inside);
}

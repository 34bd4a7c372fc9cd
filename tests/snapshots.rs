//! Compares the panels of the application with stored pictures. The pictures reveal faults that names and values of controls cannot reveal, such as a
//! control that is cut off.
//!
//! `SCREE_RECORD=1 cargo test --release --test scree snapshots` replaces the pictures in `tests/snapshots`. Look at them, and commit those whose
//! change is intended. The panels *Frame* and *Machine* are left out: *Frame* shows times, and some counts in *Machine* depend on what earlier tests
//! loaded. Other tests check the picture of the terrain.

use std::path::{Path, PathBuf};

use image::RgbImage;

use crate::workbench::{cheap_stage, take};

/// Panels, by the names on their tabs.
const PANES: [&str; 11] =
    ["Variants", "Materials", "Rules", "Brush", "Compare", "Places", "Help", "Parameters", "Metrics", "Inspector", "Experiments"];

/// Limit of the number of pixels that may differ. A few pixels may differ, because GPUs blend the edges of letters differently.
const MOST_PIXELS: usize = 12;
/// Limit of the difference in a channel, on the scale from 0 to 255. A pixel counts as different if one of its channels exceeds this limit.
const CODES: u8 = 48;

fn file(pane: &str) -> PathBuf {
    let name: String = pane.to_lowercase().chars().map(|c| if c.is_ascii_alphabetic() { c } else { '-' }).collect();
    Path::new(env!("CARGO_MANIFEST_DIR")).join("snapshots").join(format!("{}.png", name.trim_matches('-')))
}

/// Returns the number of pixels that differ. If the pictures have different sizes, this is the number of pixels of the larger picture.
fn differing(a: &RgbImage, b: &RgbImage) -> usize {
    if a.dimensions() != b.dimensions() {
        return a.as_raw().len().max(b.as_raw().len()) / 3;
    }
    a.pixels().zip(b.pixels()).filter(|(a, b)| a.0.iter().zip(b.0).any(|(a, b)| a.abs_diff(b) > CODES)).count()
}

#[test]
fn panels_look_as_they_did() {
    let record = std::env::var_os("SCREE_RECORD").is_some_and(|value| value == "1");
    let mut stage = cheap_stage();
    let mut wrong = Vec::new();
    for pane in PANES {
        take(&mut stage, &format!("click {pane}"));
        if pane == "Experiments" {
            // The panel must show a fixed folder. The default folder depends on the working directory and on where the program lies, and some of its
            // definitions need data that are not on every machine.
            take(&mut stage, "type Definitions = snapshots/definitions");
        }
        let ([width, height], texels) = stage.pane(pane).unwrap_or_else(|error| panic!("{pane}: {error:#}"));
        let now = RgbImage::from_raw(width, height, texels.into_flattened()).expect("three bytes a pixel");
        assert!(now.pixels().any(|pixel| *pixel != now[(0, 0)]), "{pane} is empty");
        if record {
            now.save(file(pane)).expect("the picture can be written");
            continue;
        }
        let kept = image::open(file(pane)).unwrap_or_else(|error| panic!("{pane}: {error}")).to_rgb8();
        let pixels = differing(&now, &kept);
        if pixels > MOST_PIXELS {
            let beside = std::env::temp_dir().join(file(pane).file_name().expect("a file"));
            now.save(&beside).expect("the picture can be written");
            wrong.push(format!("{pane}: {pixels} pixels differ; the new picture is {}", beside.display()));
        }
    }
    assert!(wrong.is_empty(), "{}\nif the change is intended, SCREE_RECORD=1 replaces the stored pictures", wrong.join("\n"));
}

//! Panels of the application as they look, against pictures that are kept: what a name or a value cannot tell, such as a control that is cut off.
//!
//! `SCREE_RECORD=1 cargo test --release --test scree snapshots` draws the pictures in `tests/snapshots` anew; look at them, and commit those that are
//! meant. *Frame* and *Machine* are not among them: they show times. Of the picture of the terrain other tests speak.

use std::path::{Path, PathBuf};

use image::RgbImage;

use crate::workbench::{cheap_stage, take};

/// Panels, by the names on their tabs.
const PANES: [&str; 11] =
    ["Variants", "Materials", "Rules", "Brush", "Compare", "Places", "Help", "Parameters", "Metrics", "Inspector", "Experiments"];

/// Pixels that may differ, and from when on one does, in codes of 8 bits: another device blends the edges of letters otherwise.
const MOST_PIXELS: usize = 12;
const CODES: u8 = 48;

fn file(pane: &str) -> PathBuf {
    let name: String = pane.to_lowercase().chars().map(|c| if c.is_ascii_alphabetic() { c } else { '-' }).collect();
    Path::new(env!("CARGO_MANIFEST_DIR")).join("snapshots").join(format!("{}.png", name.trim_matches('-')))
}

/// How many pixels differ; all of them where the sizes do.
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
            // Where the program was built is not everybody's, and not everybody has the data that some of its definitions need.
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
            wrong.push(format!("{pane}: {pixels} pixels differ; as it is now: {}", beside.display()));
        }
    }
    assert!(wrong.is_empty(), "{}\nSCREE_RECORD=1 draws the kept pictures anew if that is meant", wrong.join("\n"));
}

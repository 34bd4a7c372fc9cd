//! Puts the pictures of a run into contact sheets that are small enough to be mailed inside the page.

use std::io::Cursor;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::{DynamicImage, ImageFormat};

use super::html::{self, escape};
use crate::store::{PICTURES, RunPicture};

/// Width to which larger pictures are scaled down, pixels.
const WIDTH: u32 = 480;
/// Pictures with a PNG larger than this number of bytes are stored as JPEG instead, with the quality below.
const PNG_BYTES: usize = 96 << 10;
const JPEG_QUALITY: u8 = 88;

/// The known kinds of pictures in the order in which they are shown, with their headings. Other kinds come after these.
const KINDS: [(&str, &str); 5] = [
    ("reference", "References"),
    ("frame", "Frames"),
    ("tile-map", "Variants of tiles"),
    ("residual-map", "Maps of residual flicker"),
    ("error-map", "Error maps"),
];

/// Returns the contact sheets of a run with their heading. The data of the pictures have at most `room` characters. Notes report how many pictures
/// had no room, and which pictures could not be read.
pub(super) fn sheets(run_folders: &[PathBuf], room: usize) -> String {
    let mut html = "<section id=\"pictures\"><h2>Pictures</h2>\n".to_owned();
    let lists = run_folders.iter().map(|folder| read_lists(&folder.join(PICTURES))).collect::<Result<Vec<_>>>();
    let pictures = match lists.map(|lists| lists.concat()) {
        Ok(pictures) if !pictures.is_empty() => pictures,
        Ok(_) => return html + "<p>The run kept no pictures.</p></section>\n",
        Err(error) => return html + &format!("<p class=\"bad\">{}</p></section>\n", escape(&format!("{error:#}"))),
    };
    let mut kinds: Vec<(&str, &str)> = KINDS.to_vec();
    for picture in &pictures {
        if !kinds.iter().any(|(kind, _)| *kind == picture.kind) {
            kinds.push((&picture.kind, if picture.kind.is_empty() { "Others" } else { &picture.kind }));
        }
    }
    // Pictures are added in turns, one of each kind per turn. If there is no room for all, the last pictures of several kinds are usually missing,
    // and not a whole kind.
    let of_kind = |kind: &str| pictures.iter().filter(|p| p.kind == kind).collect::<Vec<_>>();
    let queues: Vec<Vec<&RunPicture>> = kinds.iter().map(|(kind, _)| of_kind(kind)).collect();
    let longest = queues.iter().map(Vec::len).max().unwrap_or(0);
    let mut shown: Vec<Vec<String>> = vec![Vec::new(); kinds.len()];
    let (mut spent, mut left_out, mut failures) = (0, 0usize, Vec::new());
    for turn in 0..longest {
        for (queue, shown) in queues.iter().zip(&mut shown) {
            let Some(picture) = queue.get(turn) else { continue };
            // If there is no room, the picture is not even decoded, because decoding all pictures of a large run would take minutes.
            if spent >= room {
                left_out += 1;
                continue;
            }
            match thumbnail(picture) {
                Ok((size, source)) if spent + source.len() <= room => {
                    spent += source.len();
                    let hint = words(picture);
                    shown.push(html::picture(&picture.title, &picture.caption, &hint, size, &source));
                }
                Ok(_) => left_out += 1,
                Err(error) => failures.push(format!("{error:#}")),
            }
        }
    }
    html += &format!(
        "<p>The pictures are reduced to at most {WIDTH} pixels in width; the originals are in <code>{PICTURES}/</code>. Click a picture to enlarge it.</p>\n"
    );
    if left_out > 0 {
        html += &format!(
            "<p class=\"note\">{left_out} of {} pictures are left out to limit the size of the page; they are in <code>{PICTURES}/</code>.</p>\n",
            pictures.len()
        );
    }
    for failure in &failures {
        html += &format!("<p class=\"bad\">{}</p>\n", escape(failure));
    }
    for ((_, heading), sheet) in kinds.iter().zip(shown).filter(|(_, sheet)| !sheet.is_empty()) {
        html += &format!("<h3>{}</h3>\n<div class=\"sheet\">{}</div>\n", escape(heading), sheet.concat());
    }
    html + "</section>\n"
}

/// Returns a text for the tooltip of a picture: the columns of its choice, and its file.
fn words(picture: &RunPicture) -> String {
    let RunPicture { view, variant, estimator, noise, temporal, setting, file, .. } = picture;
    let columns =
        [("view", view), ("variant", variant), ("estimator", estimator), ("noise", noise), ("temporal", temporal), ("setting", setting)];
    let known = columns.iter().filter(|(_, v)| !v.is_empty()).map(|(name, value)| format!("{name} = {value}, "));
    known.collect::<String>() + &format!("file = {PICTURES}/{file}")
}

/// Returns the entries of all lists in a folder of pictures, ordered by the file names of the lists; empty if the folder does not exist.
fn read_lists(folder: &Path) -> Result<Vec<RunPicture>> {
    if !folder.is_dir() {
        return Ok(Vec::new());
    }
    let entries = std::fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?;
    let mut files: Vec<_> =
        entries.filter_map(Result::ok).map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "json")).collect();
    files.sort();
    let mut all = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).with_context(|| format!("cannot read {}", file.display()))?;
        let mut list: Vec<RunPicture> =
            serde_json::from_str(&text).with_context(|| format!("{} is damaged: repeat the run to rewrite it", file.display()))?;
        list.iter_mut().for_each(|picture| folder.clone_into(&mut picture.folder));
        all.extend(list);
    }
    Ok(all)
}

/// Returns the size and the data URL of a picture. A picture wider than [`WIDTH`] is scaled down to this width.
fn thumbnail(picture: &RunPicture) -> Result<([u32; 2], String)> {
    let name = Path::new(&picture.file);
    // The list may come from an untrusted source. It must not be able to put arbitrary files of this machine into a page, which is then mailed.
    anyhow::ensure!(
        name.file_name().is_some_and(|n| n == name.as_os_str()),
        "`{}` in a list of {PICTURES}/ is not a plain file name: its picture is omitted",
        picture.file
    );
    let file = picture.folder.join(name);
    let bytes = std::fs::read(&file).with_context(|| format!("cannot read the picture {}: was it moved?", file.display()))?;
    let damaged = || format!("{} is not a complete PNG", file.display());
    let original = image::load_from_memory_with_format(&bytes, ImageFormat::Png).with_context(damaged)?;
    let small = original.width() <= WIDTH;
    let (scaled, bytes) = if small {
        (original, bytes)
    } else {
        let height = (u64::from(original.height()) * u64::from(WIDTH)).div_ceil(u64::from(original.width()));
        let scaled = original.thumbnail_exact(WIDTH, u32::try_from(height).unwrap_or(u32::MAX).max(1));
        let mut packed = Vec::new();
        scaled.write_to(&mut Cursor::new(&mut packed), ImageFormat::Png).with_context(damaged)?;
        (scaled, packed)
    };
    let size = [scaled.width(), scaled.height()];
    if bytes.len() <= PNG_BYTES {
        return Ok((size, format!("data:image/png;base64,{}", STANDARD.encode(bytes))));
    }
    let mut packed = Vec::new();
    JpegEncoder::new_with_quality(&mut packed, JPEG_QUALITY)
        .encode_image(&DynamicImage::ImageRgb8(scaled.into_rgb8()))
        .with_context(damaged)?;
    Ok((size, format!("data:image/jpeg;base64,{}", STANDARD.encode(packed))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::fake::Folder;

    const ROOM: usize = 6 << 20;

    /// A picture that compresses badly, like a noisy frame.
    fn noisy(width: u32, height: u32, seed: u32) -> DynamicImage {
        let texel = |x: u32, y: u32| kernels::shared::hash::pcg(x + y * width + seed * 7919).to_le_bytes();
        DynamicImage::ImageRgb8(image::RgbImage::from_fn(width, height, |x, y| {
            let [r, g, b, _] = texel(x, y);
            image::Rgb([r, g, b])
        }))
    }

    fn write(folder: &Path, pictures: &[RunPicture]) {
        std::fs::write(folder.join("part.json"), serde_json::to_string(pictures).expect("plain data")).expect("writable");
    }

    fn picture(file: &str, kind: &str) -> RunPicture {
        RunPicture { file: file.to_owned(), title: format!("<{file}>"), kind: kind.to_owned(), ..RunPicture::default() }
    }

    #[test]
    fn pictures_are_scaled_and_what_is_wrong_is_said() {
        let run = Folder::new("pictures");
        let folder = run.path().join(PICTURES);
        assert!(sheets(&[run.path().to_owned()], ROOM).contains("kept no pictures"));
        std::fs::create_dir_all(&folder).expect("writable");
        noisy(960, 500, 1).save(folder.join("large.png")).expect("writable");
        image::RgbImage::new(40, 30).save(folder.join("small.png")).expect("writable");
        std::fs::write(folder.join("broken.png"), b"no picture").expect("writable");
        std::fs::write(run.path().join("secret.png"), b"x").expect("writable");
        let files =
            [("large.png", "frame"), ("small.png", "reference"), ("broken.png", "frame"), ("gone.png", "frame"), ("../secret.png", "odd")];
        write(&folder, &files.map(|(file, kind)| picture(file, kind)));
        let html = sheets(&[run.path().to_owned()], ROOM);
        assert!(html.contains("width=\"480\" height=\"250\"") && html.contains("data:image/jpeg;base64,"));
        assert!(html.contains("width=\"40\" height=\"30\"") && html.contains("data:image/png;base64,"));
        assert!(
            html.contains("broken.png is not a complete PNG")
                && html.contains("gone.png: was it moved?")
                && html.contains("not a plain file name")
        );
        assert_eq!(html.matches("<img").count(), 2);
        assert!(html.contains("&lt;large.png&gt;") && !html.contains("<large.png>"));
        assert!(html.find("References").expect("a heading") < html.find("Frames").expect("a heading"));
        std::fs::write(folder.join("part.json"), b"[{").expect("writable");
        assert!(sheets(&[run.path().to_owned()], ROOM).contains("is damaged"));
    }

    #[test]
    fn a_page_has_room_for_some_of_each_kind() {
        let run = Folder::new("many-pictures");
        let folder = run.path().join(PICTURES);
        std::fs::create_dir_all(&folder).expect("writable");
        noisy(480, 480, 1).save(folder.join("a.png")).expect("writable");
        let all: Vec<RunPicture> = (0..120).map(|i| picture("a.png", if i < 100 { "frame" } else { "residual-map" })).collect();
        write(&folder, &all);
        let html = sheets(&[run.path().to_owned()], ROOM);
        let shown = html.matches("<img").count();
        assert!(html.len() < ROOM + (1 << 18) && shown > 10 && shown < 120, "{shown} in {}", html.len());
        assert!(html.contains(&format!("{} of 120 pictures are left out", 120 - shown)));
        let maps = html.split("Maps of residual flicker").nth(1).expect("a heading").matches("<img").count();
        assert!(maps * 3 > shown, "{maps} of {shown}");
    }
}

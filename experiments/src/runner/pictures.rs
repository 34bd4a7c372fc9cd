//! Pictures that a run stores, and the list that describes them.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use kernels::base::colour::{linear_from_srgb, srgb_code};
use kernels::frame::export::write_png_texels;
use kernels::gpu::{Gpu, read_buffer};
use kernels::metrics::Meter;
use kernels::motion::NO_LINK;
use kernels::shared::signal::{self, Signal};
use kernels::variant::Variant;

use super::Labels;
use crate::definition::setting_text;
use crate::judge::flip::magma;
use crate::judge::video::commands;
use crate::store::{PICTURES, RunPicture, VIDEO, write_with};
use crate::unit::Unit;

/// The beginning of error messages about pictures that cannot be written. It contains the remedy.
const ROOM: &str = "cannot store a picture (make room if the disk is full)";
/// The number that stands for a pixel without terrain in a file of links.
const NO_TERRAIN: u32 = NO_LINK - 1;
/// White point of a map of residual flicker. Changes of the error of at least this size, in the unit of the signal's luminance, have the last colour
/// of the scale, which is almost white.
const MAP_WHITE: f64 = 0.25;

/// The kind of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// The picture of a frame: the lit picture, or the albedo if the run does not measure lit pictures.
    Frame,
    /// Change of the error of each surface point since the previous frame.
    ResidualMap,
    /// The converged reference.
    Reference,
    /// The flavours that are shaded in each tile.
    TileMap,
}

impl Kind {
    /// Returns the name of the kind in the list of pictures.
    fn name(self) -> &'static str {
        match self {
            Kind::Frame => "frame",
            Kind::ResidualMap => "residual-map",
            Kind::Reference => "reference",
            Kind::TileMap => "tile-map",
        }
    }
}

/// The pictures of one part of a run.
pub(super) struct Sheet {
    folder: PathBuf,
    part: String,
    blank: RunPicture,
    entries: Vec<RunPicture>,
}

impl Sheet {
    /// Returns a sheet without pictures.
    pub(super) fn new(run: &Path, unit: &Unit) -> Sheet {
        let setting = unit.setting.as_ref().map_or_else(String::new, setting_text);
        let blank = RunPicture { view: unit.view.clone(), setting, ..RunPicture::default() };
        Sheet { folder: run.join(PICTURES), part: unit.id.clone(), blank, entries: Vec::new() }
    }

    /// Sets the variant, estimator, noise and resolve of the pictures that are added until the next call.
    pub(super) fn of(&mut self, labels: &Labels<'_>, variant: &str) -> &mut Sheet {
        let text = |s: &str| s.to_owned();
        self.blank.variant = text(variant);
        self.blank.estimator = text(labels.estimator);
        self.blank.noise = text(labels.noise);
        self.blank.temporal = text(labels.temporal);
        self
    }

    /// Writes a picture and adds it to the list. `name` must be unique among the pictures of the part.
    pub(super) fn keep(&mut self, kind: Kind, name: &str, title: &str, caption: &str, size: [u32; 2], texels: &[[u8; 3]]) -> Result<()> {
        fs::create_dir_all(&self.folder).with_context(|| format!("cannot make the folder {}", self.folder.display()))?;
        let file = format!("{}-{name}.png", self.part);
        write_png_texels(&self.folder.join(&file), size, texels).context(ROOM)?;
        self.entries.push(RunPicture {
            file,
            title: title.to_owned(),
            caption: caption.to_owned(),
            kind: kind.name().to_owned(),
            ..self.blank.clone()
        });
        Ok(())
    }

    /// Writes the list of pictures, unless it is empty.
    pub(super) fn finish(self) -> Result<()> {
        if self.entries.is_empty() {
            return Ok(());
        }
        let file = self.folder.join(format!("{}.json", self.part));
        let bytes = serde_json::to_vec_pretty(&self.entries).context("cannot convert the list of pictures to JSON")?;
        write_with(&file, |output| output.write_all(&bytes))
    }
}

/// Returns the folder of a PNG sequence of a part. `of` is the variant of a sweep, or the temporal resolve of a reference.
pub(super) fn sequence(run: &Path, part: &str, of: &str) -> PathBuf {
    run.join(VIDEO).join(format!("{part}-{of}"))
}

/// Writes one frame of a sequence as PNG.
pub(super) fn write_frame(folder: &Path, frame: u32, size: [u32; 2], codes: &[[u8; 3]]) -> Result<()> {
    fs::create_dir_all(folder).with_context(|| format!("cannot make the folder {}", folder.display()))?;
    write_png_texels(&folder.join(format!("{frame:04}.png")), size, codes).context(ROOM)
}

/// Writes the links of a frame as `NNNN.links` in the folder of a sequence. The link of a pixel is the index of the pixel that showed the same
/// surface point in the previous frame. It is [`NO_LINK`] if no pixel showed this point, and [`NO_TERRAIN`] if the pixel shows no terrain. The file
/// has a little-endian 32-bit number per pixel, row by row from the top. `picture` is the frame; it says which pixels show terrain.
pub(super) fn write_links(gpu: &Gpu, meter: &Meter, folder: &Path, frame: u32, picture: &[[u32; 2]]) -> Result<()> {
    let links: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &meter.motion.links, picture.len() as u64 * 4)?);
    write_with(&folder.join(format!("{frame:04}.links")), |output| {
        for (&link, &pixel) in links.iter().zip(picture) {
            let known = if signal::is_terrain(pixel) { link } else { NO_TERRAIN };
            output.write_all(&known.to_le_bytes())?;
        }
        Ok(())
    })
}

/// Writes `judge.txt` into the folder of a sequence. The file contains the command lines that compare the sequence with the reference sequence.
pub(super) fn write_judges(test: &Path, reference: &Path, size: [u32; 2], frames_per_second: f64) -> Result<()> {
    let pattern = |folder: &Path| format!("../{}/%04d.png", folder.file_name().unwrap_or_default().to_string_lossy());
    let text = commands(&pattern(test), &pattern(reference), frames_per_second, size);
    let file = test.join("judge.txt");
    write_with(&file, |output| output.write_all(text.as_bytes()))
}

/// Encodes linear colour as sRGB for display. There is no tone mapping: albedo is not light, and lit pictures were mapped before.
pub(super) fn display(texels: &[[f32; 3]]) -> Vec<[u8; 3]> {
    texels.iter().map(|t| t.map(srgb_code)).collect()
}

/// Returns the linear colours of a measured picture; black where it shows no terrain. For the lit picture, they are the linear form of the display
/// values.
pub(super) fn linear(picture: &[[u32; 2]], signal: Signal) -> Vec<[f32; 3]> {
    let colour = |s: &[u32; 2]| if signal::is_terrain(*s) { signal::colour(*s) } else { [0.0; 3] };
    picture.iter().map(|s| if signal == Signal::Lit { colour(s).map(linear_from_srgb) } else { colour(s) }).collect()
}

/// Returns the 8-bit sRGB codes with which a measured picture is displayed.
pub(super) fn displayed(picture: &[[u32; 2]], signal: Signal) -> Vec<[u8; 3]> {
    display(&linear(picture, signal))
}

/// Returns a map of residual flicker in the colour map magma. For each pixel of the last picture of `stream`, it shows by how much the error of the
/// surface point has changed since the previous frame. `stream` is the index of a stream of `meter`, which must have a reference. Pixels whose change
/// is not known are black, for example because their surface point was not visible in the previous frame.
pub(super) fn residual_map(gpu: &Gpu, meter: &Meter, stream: usize, size: [u32; 2]) -> Result<Vec<[u8; 3]>> {
    let pixels = u64::from(size[0]) * u64::from(size[1]);
    let (now, before) = (meter.picture(gpu, stream, 0)?, meter.picture(gpu, stream, 1)?);
    let signal = meter.streams[stream].track.signal;
    let (truth, truth_before) = (meter.reference(gpu, signal, 0)?, meter.reference(gpu, signal, 1)?);
    let links: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &meter.motion.links, pixels * 4)?);
    let scale = magma();
    let luminance = |s: [u32; 2]| signal::is_terrain(s).then(|| signal::luminance(signal::colour(s)));
    let error = |test: [u32; 2], truth: [u32; 2]| Some(luminance(test)? - luminance(truth)?);
    let colour = |at: usize| {
        let link = links[at];
        let change = (link != NO_LINK)
            .then_some(link as usize)
            .and_then(|link| Some(error(now[at], truth[at])? - error(before[link], truth_before[link])?));
        change.map_or([0; 3], |change| scale[((change.abs() / MAP_WHITE * 255.0) as usize).min(scale.len() - 1)])
    };
    Ok((0..now.len()).map(colour).collect())
}

/// Legend of the colours of a tile map.
pub(super) const TILE_MAP_LEGEND: &str =
    "Green: virtual texture, blue: far atlas, red: near cliff, orange: far cliff, violet: splat; mixed colours: several flavours.";

/// Mixes each pixel of `picture`, in equal parts, with the colour that stands for its set of flavours. `sets` contains the set of each pixel. If the
/// set is 0, the pixel has no flavour and is unchanged.
pub(super) fn tile_map(sets: &[u8], picture: &[[u8; 3]]) -> Vec<[u8; 3]> {
    let colour = |(&set, &seen): (&u8, &[u8; 3])| {
        let Some(variant) = Variant::new(set) else { return seen };
        let own = variant.colour();
        std::array::from_fn(|k| own[k].midpoint(seen[k]))
    };
    sets.iter().zip(picture).map(colour).collect()
}

//! Converts the texels of a file to the values of a map.

use std::io::{BufRead, Seek};
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::decode::{Encoding, Stored, Want, decode};
use super::names::Convention;
use super::recognition::{Reading, shown};
use crate::base::colour::linear_from_srgb;
use crate::base::error::{Error, Result, one_line};
use crate::decode::fault::Fault;
use crate::shared::real::{length, normalize};

/// Share of texels that must have a property before it counts as a property of the map. The rest may be noise of a lossy compression.
const NEARLY_ALL: f64 = 0.999;
/// Largest difference between the channels of a grey texel. If a map with one value per texel is stored as RGB, nearly all its texels must be grey.
/// [`refuse_grey`] uses the same limit for another test: a grey image whose values do not differ by more than this counts as uniform.
const GREY: f32 = 8.0 / 255.0;
/// Largest difference between channels that count as equal, in the test whether a normal map is in fact a grey image.
const EQUAL: f32 = 2.5 / 255.0;
/// If the z of a normal differs from a constant by at most this number, the difference counts as noise.
const CONSTANT_Z: f32 = 0.12;
/// Largest difference between 1 and the length of a vector at which the vector counts as a unit vector. Averaged normals may be shorter than 1.
const LENGTH: f32 = 0.2;
/// Largest distance by which floats may lie outside their range, for example because they were resampled.
const OVERSHOOT: f32 = 0.05;

/// A square map in memory; row 0 is at v = 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Map {
    /// Texels along an edge, at least 1.
    pub edge: usize,
    /// The values, row by row. [`Reading::Colour`]: linear red, green and blue, 0..1. [`Reading::Normal`]: a unit vector, x towards +u, y towards +v.
    /// Otherwise: one number in 0..1, three times.
    pub texels: Vec<[f32; 3]>,
    /// Notes for the user about the file, one line each.
    pub remarks: Vec<String>,
}

/// Reads a map from the contents of a file. `path` is used in error messages. PNG, JPEG and OpenEXR are distinguished by content; anything else is
/// read as TGA if the extension of `path` is `tga`.
///
/// # Errors
/// If the file is not a readable image, is not square, or is larger than 8192 texels per side; if its values cannot be those of the map, such as a
/// normal map in grey, a roughness map in colour, or an albedo with floats far outside 0..1; or if the file states a property that cannot be applied,
/// such as a rotation, a cropped data window or primaries that form no colour space.
pub fn read(input: impl BufRead + Seek, path: &Path, reading: Reading) -> Result<Map> {
    let file = || PathBuf::from(shown(path));
    let want = match reading {
        Reading::Colour => Want::Colour,
        Reading::Normal(_) => Want::Vector,
        Reading::Height(_) | Reading::Share { .. } => Want::Number,
    };
    let stored = decode(input, path, want).map_err(|fault| match fault {
        Fault::Io(source) => Error::File { file: file(), source },
        other => Error::Image { file: file(), what: one_line(&other.to_string()) },
    })?;
    let map = match reading {
        Reading::Colour => colour(stored),
        Reading::Normal(convention) => normal(stored, convention),
        Reading::Height(channel) => number(stored, channel).and_then(height),
        Reading::Share { channel, inverted } => number(stored, channel).and_then(|stored| share(stored, inverted)),
    };
    map.map_err(|what| Error::Image { file: file(), what: one_line(&what) })
}

/// Applies a function to all texels.
fn mapped(stored: Stored, f: impl Fn([f32; 3]) -> [f32; 3] + Sync) -> Map {
    let Stored { edge, mut texels, remarks, .. } = stored;
    texels.par_iter_mut().for_each(|texel| *texel = f(*texel));
    Map { edge, texels, remarks }
}

fn count(texels: &[[f32; 3]], is: impl Fn(&[f32; 3]) -> bool + Sync) -> usize {
    texels.par_iter().filter(|texel| is(texel)).count()
}

/// Lowest and highest value of the first `channels` channels.
fn range(texels: &[[f32; 3]], channels: usize) -> (f32, f32) {
    let values = texels.iter().flat_map(|texel| texel.iter().take(channels));
    values.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), &value| (low.min(value), high.max(value)))
}

/// Refuses floats that leave the range 0..1 by more than [`OVERSHOOT`].
fn within_unit(stored: &Stored, what: &str) -> std::result::Result<(), String> {
    if stored.encoding != Encoding::Floats {
        return Ok(());
    }
    let (low, high) = range(&stored.texels, stored.channels);
    if low < -OVERSHOOT || high > 1.0 + OVERSHOOT {
        return Err(format!("its values reach from {low} to {high}, but {what} lies in 0..1: scale it to that range"));
    }
    Ok(())
}

fn colour(stored: Stored) -> std::result::Result<Map, String> {
    match stored.encoding {
        Encoding::Codes => Ok(mapped(stored, |texel| texel.map(linear_from_srgb))),
        Encoding::Gamma(gamma) => {
            let exponent = (1.0 / gamma) as f32;
            Ok(mapped(stored, |texel| texel.map(|code| code.powf(exponent))))
        }
        Encoding::Floats => {
            within_unit(&stored, "an albedo")?;
            Ok(mapped(stored, |texel| texel.map(|value| value.clamp(0.0, 1.0))))
        }
    }
}

/// Selects the channel that holds the number, and repeats it in all three channels. `channel`: its index; `None`: the image must be grey.
fn number(mut stored: Stored, channel: Option<usize>) -> std::result::Result<Stored, String> {
    match channel {
        None if stored.channels > 1 => {
            let coloured = count(&stored.texels, |t| (t[0] - t[1]).abs() > GREY || (t[0] - t[2]).abs() > GREY);
            if coloured as f64 > (1.0 - NEARLY_ALL) * stored.texels.len() as f64 {
                return Err(format!(
                    "red, green and blue differ in {coloured} of {} texels, but this map has one value per texel: save it in grey or, if it packs several maps, name it `arm`",
                    stored.texels.len()
                ));
            }
        }
        Some(_) if stored.channels < 3 => {
            return Err("its name states that red, green and blue hold different maps, but the image is grey: rename it".to_owned());
        }
        _ => {}
    }
    let channel = channel.unwrap_or(0);
    stored.texels.par_iter_mut().for_each(|texel| *texel = [texel.get(channel).copied().unwrap_or_default(); 3]);
    Ok(stored)
}

/// Converts a height map. Heights are relative. So if some floats lie outside 0..1, as with metres, the heights are scaled to 0..1.
fn height(stored: Stored) -> std::result::Result<Map, String> {
    // Integer codes always lie in 0..1, so the range is computed only for floats.
    let (low, high) = if stored.encoding == Encoding::Floats { range(&stored.texels, 1) } else { (0.0, 1.0) };
    if low >= 0.0 && high <= 1.0 {
        return Ok(mapped(stored, |texel| texel));
    }
    let scale = if high > low { 1.0 / (f64::from(high) - f64::from(low)) } else { 0.0 };
    let mut map = mapped(stored, |texel| texel.map(|value| ((f64::from(value) - f64::from(low)) * scale) as f32));
    map.remarks.push(format!("its heights from {low} to {high} are scaled to 0..1"));
    Ok(map)
}

fn share(stored: Stored, inverted: bool) -> std::result::Result<Map, String> {
    within_unit(&stored, "this map")?;
    Ok(mapped(stored, |texel| {
        texel.map(|value| {
            let value = value.clamp(0.0, 1.0);
            if inverted { 1.0 - value } else { value }
        })
    }))
}

/// Decodes normals: n = value if [`is_signed`] is true, otherwise n = 2 value - 1. Inverts y if the convention is DirectX, computes z if the file
/// lacks it, mirrors vectors that point into the surface, and scales n to unit length. n = 0 becomes the normal of a flat surface.
fn normal(stored: Stored, convention: Convention) -> std::result::Result<Map, String> {
    refuse_grey(&stored)?;
    let has_z = stored.channels == 3;
    let is_signed = is_signed(&stored)?;
    let sign = if convention == Convention::DirectX { -1.0 } else { 1.0 };
    let mut map = mapped(stored, move |t| {
        let n = if is_signed { t } else { t.map(|v| 2.0 * v - 1.0) };
        [n[0], sign * n[1], n[2]]
    });
    if is_signed {
        map.remarks.push("its values are read as -1..1".to_owned());
    }
    if has_z && !lacks_z(&map.texels) {
        check_vectors(&mut map)?;
    } else {
        compute_z(&mut map)?;
    }
    map.texels.par_iter_mut().for_each(|t| *t = normalize(*t));
    Ok(map)
}

fn share_of(texels: &[[f32; 3]], is: impl Fn(&[f32; 3]) -> bool + Sync) -> f64 {
    count(texels, is) as f64 / texels.len() as f64
}

/// Refuses a grey image, which is probably a height or bump map.
fn refuse_grey(stored: &Stored) -> std::result::Result<(), String> {
    if stored.channels == 1 {
        return Err("the image is grey, but a normal map needs at least red and green: is it a height or bump map?".to_owned());
    }
    // A two-channel map of a flat surface, stored as RGB, may be grey, too, but its values do not vary. So a grey RGB image is refused only if its
    // values vary.
    let is_grey = share_of(&stored.texels, |t| (t[0] - t[1]).abs() <= EQUAL && (t[0] - t[2]).abs() <= EQUAL) >= NEARLY_ALL;
    let (low, high) = range(&stored.texels, stored.channels);
    if is_grey && high - low > GREY {
        return Err("red, green and blue are equal, as in a height or bump map, but not in a normal map: give the normal map".to_owned());
    }
    Ok(())
}

/// Whether the values are the normal n itself (-1..1) rather than (n + 1) / 2 (0..1). Values outside the range that applies are refused.
///
/// Floats are n itself if an x or y is below -[`OVERSHOOT`], or if the mean of all x and y is nearer to 0 than to 0.5. The mean of n.x and n.y is
/// usually near 0, because a texture is flat on average.
fn is_signed(stored: &Stored) -> std::result::Result<bool, String> {
    let is_signed = stored.encoding == Encoding::Floats && {
        let sum = stored.texels.iter().map(|t| f64::from(t[0]) + f64::from(t[1])).sum::<f64>();
        range(&stored.texels, 2).0 < -OVERSHOOT || sum / (2.0 * stored.texels.len() as f64) < 0.25
    };
    let (low, high) = range(&stored.texels, stored.channels);
    let lowest = if is_signed { -1.0 - OVERSHOOT } else { -OVERSHOOT };
    if low < lowest || high > 1.0 + OVERSHOOT {
        return Err(format!("its values reach from {low} to {high}, but normals lie in 0..1 or -1..1: export it again"));
    }
    Ok(is_signed)
}

/// Whether z is about the same in nearly all texels and cannot be that of unit vectors, so that the file is a two-channel map.
fn lacks_z(texels: &[[f32; 3]]) -> bool {
    let is_nearly_always = |is: fn(&[f32; 3]) -> bool| share_of(texels, is) >= NEARLY_ALL;
    is_nearly_always(|t| t[2].abs() <= CONSTANT_Z)
        || is_nearly_always(|t| t[2] <= CONSTANT_Z - 1.0)
        || (is_nearly_always(|t| t[2] >= 1.0 - CONSTANT_Z) && share_of(texels, |t| length(*t) > 1.05) > 1.0 - NEARLY_ALL)
}

/// Computes z = sqrt(1 - x² - y²), or 0 where the vector (x, y) is longer than 1. Refuses the map if this vector is clearly longer than 1 in more
/// than half of the texels.
fn compute_z(map: &mut Map) -> std::result::Result<(), String> {
    let outside = share_of(&map.texels, |t| t[0].hypot(t[1]) > 1.05);
    if outside > 0.5 {
        return Err(format!(
            "x and y exceed length 1 in {:.0} % of the texels, so it is not a normal map: give the normal map",
            100.0 * outside
        ));
    }
    map.remarks.push("z is computed from x and y, because the file has no z".to_owned());
    if outside > 1.0 - NEARLY_ALL {
        map.remarks.push(format!("x and y exceed length 1 in {:.1} % of the texels", 100.0 * outside));
    }
    map.texels.par_iter_mut().for_each(|t| t[2] = (1.0 - t[0] * t[0] - t[1] * t[1]).max(0.0).sqrt());
    Ok(())
}

/// Refuses a map if more than half of its vectors point into the surface. Otherwise, these vectors are mirrored out of it. A remark is added if they
/// are more than noise ([`NEARLY_ALL`]). Another remark is added if the lengths of more than half of the vectors differ from 1 by more than
/// [`LENGTH`].
fn check_vectors(map: &mut Map) -> std::result::Result<(), String> {
    let below = share_of(&map.texels, |t| t[2] < -0.02);
    if below > 0.5 {
        return Err(format!(
            "{:.0} % of its vectors point into the surface, so it is not a tangent-space normal map: give the tangent-space map",
            100.0 * below
        ));
    }
    if below > 1.0 - NEARLY_ALL {
        map.remarks.push(format!("{:.1} % of its vectors point into the surface; they are mirrored out of it", 100.0 * below));
    }
    map.texels.par_iter_mut().for_each(|t| t[2] = t[2].abs());
    let uneven = share_of(&map.texels, |t| (length(*t) - 1.0).abs() > LENGTH);
    if uneven > 0.5 {
        map.remarks.push(format!(
            "the lengths of {:.0} % of its vectors differ from 1 by more than {LENGTH}; they are scaled to 1",
            100.0 * uneven
        ));
    }
    Ok(())
}

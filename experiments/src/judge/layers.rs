//! Reads pictures from OpenEXR files: finds a layer, places its pixels in the display window, and converts its colours to the primaries of
//! Rec. 709.
//!
//! The layer of a channel is given by the text before the last '.' of the channel's name (Technical Introduction to OpenEXR, "Channel
//! names"), and by the name of the part of the file that contains the channel. Some programs write r g b instead of R G B, so upper and
//! lower case are treated as equal unless this is ambiguous.

use std::collections::HashMap;
use std::io::{BufRead, Seek};

use glam::DVec3;
use kernels::base::error::one_line;
use kernels::base::names::nearest;
use kernels::decode::openexr::{self, Channel, Channels, Chromaticities, Kind, Limits, Part};
use kernels::frame::MAX_PIXELS;

use super::picture::{Content, Image, Origin};
use super::windows::Windows;

/// Limit of the number of names in an error message.
const NAMES: usize = 24;

/// The channels of a layer.
struct Layer<'a> {
    /// Name of the layer; empty if the channels belong to no layer.
    name: String,
    part: &'a Part,
    channels: Channels<'a>,
}

impl<'a> Layer<'a> {
    /// Returns the channels R G B, or else X Y Z, or else the single channel besides A, with the meaning of their values. `None` if the layer has
    /// none of these.
    fn picture(&self) -> Option<(Content, [&'a Channel; 3])> {
        let of = &self.channels;
        let three = |[a, b, c]: [&str; 3]| Some([of.with_base(a)?, of.with_base(b)?, of.with_base(c)?]);
        if let Some(colour) = three(["R", "G", "B"]) {
            return Some((Content::Colour, colour));
        }
        if let Some(vector) = three(["X", "Y", "Z"]) {
            return Some((Content::Vector, vector));
        }
        Some((Content::Value, [of.single()?; 3]))
    }

    fn is_colour(&self) -> bool {
        matches!(self.picture(), Some((Content::Colour, _)))
    }

    /// Returns a description of the layer for messages.
    fn title(&self) -> String {
        if self.name.is_empty() { "the picture itself".to_owned() } else { format!("layer `{}`", one_line(&self.name)) }
    }
}

/// Reads a picture. `wanted` is the name of a layer. If it is `None`, `only` chooses the layer.
///
/// # Errors
/// The message is one clause that does not contain the name of the file.
pub(super) fn read(input: impl BufRead + Seek, wanted: Option<&str>) -> Result<Image, String> {
    let parts = openexr::read_within(input, Limits { side: u32::MAX, pixels: MAX_PIXELS }).map_err(|fault| fault.to_string())?;
    let layers = layers(&parts);
    let layer = match wanted {
        Some(name) => named(&layers, name)?,
        None => only(&layers)?,
    };
    let Some((content, channels)) = layer.picture() else {
        let names = list(layer.channels.0.iter().map(|channel| channel.base_name()));
        return Err(format!(
            "{} has channels {names}: choose a layer with the channels R G B or X Y Z, or with a single channel",
            layer.title()
        ));
    };
    let part = layer.part;
    let windows = Windows { data: part.data_window, display: part.display_window };
    let lay = |channel: &Channel| {
        let nothing =
            || format!("stores {}, which is outside its picture of {}: there is nothing to compare", windows.data, windows.display);
        windows.lay(&channel.samples).ok_or_else(nothing)
    };
    let [x, y, z] = channels.map(lay);
    let (x, y, z) = (x?, y?, z?);
    let mut texels: Vec<[f32; 3]> = x.iter().zip(&y).zip(&z).map(|((x, y), z)| [*x, *y, *z]).collect();
    let converted_from = match (content, part.chromaticities) {
        (Content::Colour, Some(stated)) if !stated.is_rec_709() => Some(convert(&mut texels, stated)?),
        _ => None,
    };
    let alpha = alpha(&layers, layer).map(lay).transpose()?;
    Ok(Image {
        size: windows.display.size,
        texels,
        alpha,
        content,
        origin: Origin {
            layer: (wanted.is_none() && layers.len() > 1 && !layer.name.is_empty()).then(|| one_line(&layer.name)),
            windows: Some(windows),
            converted_from,
            bits: channels.iter().all(|channel| channel.kind == Kind::Uint).then_some(32),
            lossy: part.lossy,
            multiplied_by_alpha: true,
            pixel_aspect: Some(part.pixel_aspect).filter(|aspect| (aspect - 1.0).abs() > 1e-3 || aspect.is_nan()),
            ..Origin::default()
        },
    })
}

/// Converts linear colours to the primaries of Rec. 709. Returns the primaries that they had.
///
/// # Errors
/// The chromaticities do not define a colour space.
pub(super) fn convert(texels: &mut [[f32; 3]], from: Chromaticities) -> Result<Chromaticities, String> {
    let matrix = from.to_rec_709();
    let matrix = matrix.ok_or_else(|| format!("states chromaticities that are no colour space ({from}): correct them or remove them"))?;
    for texel in texels {
        // The decoded samples have the precision of f32, so the converted values are rounded to f32, too.
        *texel = (matrix * DVec3::from_array(texel.map(f64::from))).to_array().map(|v| v as f32);
    }
    Ok(from)
}

/// Groups the channels of each part by their layers, in the order of the file.
fn layers(parts: &[Part]) -> Vec<Layer<'_>> {
    let mut layers: Vec<Layer<'_>> = Vec::new();
    for part in parts {
        let mut places: HashMap<String, usize> = HashMap::new();
        for channel in &part.channels {
            let place = *places.entry(layer_name(&part.name, channel.layer())).or_insert_with_key(|name| {
                layers.push(Layer { name: name.clone(), part, channels: Channels::default() });
                layers.len() - 1
            });
            if let Some(layer) = layers.get_mut(place) {
                layer.channels.0.push(channel);
            }
        }
    }
    layers
}

/// Returns the name of a layer. `prefix` is the text before the last '.' in the names of its channels. The name of the part is put before `prefix`,
/// unless `prefix` equals it or begins with it and a '.'.
fn layer_name(part: &str, prefix: &str) -> String {
    match (part, prefix) {
        (part, "") => part.to_owned(),
        ("", prefix) => prefix.to_owned(),
        (part, prefix) if prefix.strip_prefix(part).is_some_and(|rest| rest.is_empty() || rest.starts_with('.')) => prefix.to_owned(),
        (part, prefix) => format!("{part}.{prefix}"),
    }
}

/// Returns the layer with this name. A name that is exactly equal takes precedence over names that differ in case. It is an error if no layer or
/// several layers have the name.
fn named<'l, 'a>(layers: &'l [Layer<'a>], wanted: &str) -> Result<&'l Layer<'a>, String> {
    let exact: Vec<&'l Layer<'a>> = layers.iter().filter(|layer| layer.name == wanted).collect();
    let alike: Vec<&'l Layer<'a>> = layers.iter().filter(|layer| layer.name.eq_ignore_ascii_case(wanted)).collect();
    let found = if exact.is_empty() { alike } else { exact };
    match found.as_slice() {
        [layer] => Ok(*layer),
        [] => {
            let known: Vec<&str> = layers.iter().map(|layer| layer.name.as_str()).filter(|name| !name.is_empty()).collect();
            let hint = nearest(wanted, &known).map_or_else(String::new, |near| format!("; did you mean `{}`?", one_line(near)));
            let known = if known.is_empty() { "only the picture itself".to_owned() } else { list(known.into_iter()) };
            Err(format!("has no layer `{wanted}`: it has {known}{hint}"))
        }
        several => Err(format!("has {} layers `{wanted}`: rename them, so that each has its own name", several.len())),
    }
}

/// Returns the layer that is read if the caller names none. Layers that are no pictures ([`Layer::picture`]) are left out. If there are layers with
/// colours, layers of vectors and values are left out, too. If a remaining layer has no name, layers with names are left out. If several layers
/// remain after these steps, the function returns an error.
fn only<'l, 'a>(layers: &'l [Layer<'a>]) -> Result<&'l Layer<'a>, String> {
    let pictures: Vec<&'l Layer<'a>> = layers.iter().filter(|layer| layer.picture().is_some()).collect();
    let colours: Vec<&'l Layer<'a>> = pictures.iter().copied().filter(|layer| layer.is_colour()).collect();
    let candidates = if colours.is_empty() { pictures } else { colours };
    let unnamed: Vec<&'l Layer<'a>> = candidates.iter().copied().filter(|layer| layer.name.is_empty()).collect();
    let candidates = if unnamed.is_empty() { candidates } else { unnamed };
    match candidates.as_slice() {
        [layer] => Ok(*layer),
        // No layer can be read as a picture. The first layer is returned, because the caller then reports the channels that it has.
        [] => layers.first().ok_or_else(|| "has no channel: export it again".to_owned()),
        several if several.iter().all(|layer| layer.name.is_empty()) => {
            Err(format!("has {} parts without a name that could be compared: name the parts, and choose one (--layer)", several.len()))
        }
        several => Err(format!(
            "has {} layers that could be compared, {}: choose one (--layer)",
            several.len(),
            list(several.iter().map(|layer| layer.name.as_str()))
        )),
    }
}

/// Returns the channel A (alpha) of the picture itself, which is the layer without a name or, if all layers have names, the first layer. The picture
/// itself may be stored in a different part of the file than `layer`, if both parts have the same windows. If no channel is found in this way, the
/// function returns the channel A of `layer`.
fn alpha<'a>(layers: &[Layer<'a>], layer: &Layer<'a>) -> Option<&'a Channel> {
    let main = if layers.iter().any(|other| other.name.is_empty()) { "" } else { layers.first().map_or("", |first| first.name.as_str()) };
    let of_main = layers.iter().filter(|other| other.name == main);
    let same_part = of_main.clone().filter(|other| std::ptr::eq(other.part, layer.part));
    // With other windows, the samples of a part belong to other pixels.
    let same_windows =
        |other: &&Layer<'a>| other.part.data_window == layer.part.data_window && other.part.display_window == layer.part.display_window;
    same_part.chain(of_main.filter(same_windows)).find_map(|other| other.channels.with_base("A")).or_else(|| layer.channels.with_base("A"))
}

/// Joins names from a file into one line. The names after the first [`NAMES`] are only counted. Equal neighbours are written once.
fn list<'n>(names: impl ExactSizeIterator<Item = &'n str>) -> String {
    let more = names.len().saturating_sub(NAMES);
    let mut shown: Vec<String> = names.take(NAMES).map(one_line).collect();
    shown.dedup();
    if more > 0 {
        shown.push(format!("and {more} more"));
    }
    shown.join(", ")
}

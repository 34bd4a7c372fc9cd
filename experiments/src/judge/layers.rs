//! Pictures in OpenEXR files: finds a layer, lays it into the picture that a viewer shows, and converts its colours to the primaries of Rec. 709.
//!
//! A channel belongs to a layer by the part of its name before the last '.' (Technical Introduction to OpenEXR, "Channel names"), and by the name of its
//! part. Upper and lower case count as equal where that is not ambiguous, because programs write R G B or r g b.

use std::collections::HashMap;
use std::io::{BufRead, Seek};

use glam::DVec3;
use kernels::base::error::one_line;
use kernels::base::names::nearest;
use kernels::decode::openexr::{self, Channel, Chromaticities, Kind, Limits, Part};
use kernels::frame::MAX_PIXELS;

use super::picture::{Content, Image, Origin};
use super::windows::Windows;

/// Largest number of names in an error.
const NAMES: usize = 24;

/// The channels of a layer.
struct Layer<'a> {
    /// Name of the layer; empty if the channels belong to no layer.
    name: String,
    part: &'a Part,
    channels: Vec<&'a Channel>,
}

impl<'a> Layer<'a> {
    /// The channel of this name, if there is one. A name in the same case counts before names in another case.
    fn channel(&self, name: &str) -> Option<&'a Channel> {
        let of_name = |is: fn(&str, &str) -> bool| sole(self.channels.iter().copied().filter(move |channel| is(channel.base_name(), name)));
        of_name(|own, name| own == name).or_else(|| of_name(str::eq_ignore_ascii_case))
    }

    /// The channels R G B, X Y Z, or the only channel except A. `None` if the layer has none of these.
    fn picture(&self) -> Option<(Content, [&'a Channel; 3])> {
        let three = |[a, b, c]: [&str; 3]| Some([self.channel(a)?, self.channel(b)?, self.channel(c)?]);
        if let Some(colour) = three(["R", "G", "B"]) {
            return Some((Content::Colour, colour));
        }
        if let Some(vector) = three(["X", "Y", "Z"]) {
            return Some((Content::Vector, vector));
        }
        let value = sole(self.channels.iter().copied().filter(|channel| !channel.base_name().eq_ignore_ascii_case("A")))?;
        Some((Content::Value, [value; 3]))
    }

    fn is_colour(&self) -> bool {
        matches!(self.picture(), Some((Content::Colour, _)))
    }

    /// The layer in words.
    fn title(&self) -> String {
        if self.name.is_empty() { "the picture itself".to_owned() } else { format!("layer `{}`", one_line(&self.name)) }
    }
}

/// The item of an iterator that has exactly one.
fn sole<T>(mut items: impl Iterator<Item = T>) -> Option<T> {
    let first = items.next()?;
    items.next().is_none().then_some(first)
}

/// Reads a picture. `wanted` = the layer; `None` = the channels that belong to no layer or, if they form no picture, the only layer that does.
///
/// # Errors
/// In words, without the name of the file.
pub(super) fn read(input: impl BufRead + Seek, wanted: Option<&str>) -> Result<Image, String> {
    let parts = openexr::read_within(input, Limits { side: u32::MAX, pixels: MAX_PIXELS }).map_err(|fault| fault.to_string())?;
    let layers = layers(&parts);
    let layer = match wanted {
        Some(name) => named(&layers, name)?,
        None => only(&layers)?,
    };
    let Some((content, channels)) = layer.picture() else {
        let names = list(layer.channels.iter().map(|channel| channel.base_name()));
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
/// The chromaticities are no colour space.
pub(super) fn convert(texels: &mut [[f32; 3]], from: Chromaticities) -> Result<Chromaticities, String> {
    let matrix = from.to_rec_709();
    let matrix = matrix.ok_or_else(|| format!("states chromaticities that are no colour space ({from}): correct them or remove them"))?;
    for texel in texels {
        // Rounded to f32 as the samples were.
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
                layers.push(Layer { name: name.clone(), part, channels: Vec::new() });
                layers.len() - 1
            });
            if let Some(layer) = layers.get_mut(place) {
                layer.channels.push(channel);
            }
        }
    }
    layers
}

/// The name of the part is added before the name of the layer, unless the name of the layer already begins with it.
fn layer_name(part: &str, prefix: &str) -> String {
    match (part, prefix) {
        (part, "") => part.to_owned(),
        ("", prefix) => prefix.to_owned(),
        (part, prefix) if prefix.strip_prefix(part).is_some_and(|rest| rest.is_empty() || rest.starts_with('.')) => prefix.to_owned(),
        (part, prefix) => format!("{part}.{prefix}"),
    }
}

/// The layer of this name.
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
            Err(format!("has no layer `{wanted}`: there are {known}{hint}"))
        }
        several => Err(format!("has {} layers `{wanted}`: rename them, so that each has its own name", several.len())),
    }
}

/// The layer to read if none was asked for: that without a name if it has colour, else the only one with colour. If there is no colour, the same holds
/// for layers of vectors and values.
fn only<'l, 'a>(layers: &'l [Layer<'a>]) -> Result<&'l Layer<'a>, String> {
    let pictures: Vec<&'l Layer<'a>> = layers.iter().filter(|layer| layer.picture().is_some()).collect();
    let colours: Vec<&'l Layer<'a>> = pictures.iter().copied().filter(|layer| layer.is_colour()).collect();
    let candidates = if colours.is_empty() { pictures } else { colours };
    let unnamed: Vec<&'l Layer<'a>> = candidates.iter().copied().filter(|layer| layer.name.is_empty()).collect();
    let candidates = if unnamed.is_empty() { candidates } else { unnamed };
    match candidates.as_slice() {
        [layer] => Ok(*layer),
        // What is wrong with the first layer is said when its channels are read.
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

/// The channel A of the picture itself, also if `layer` has its own part; else that of `layer`.
fn alpha<'a>(layers: &[Layer<'a>], layer: &Layer<'a>) -> Option<&'a Channel> {
    let main = if layers.iter().any(|other| other.name.is_empty()) { "" } else { layers.first().map_or("", |first| first.name.as_str()) };
    let of_main = layers.iter().filter(|other| other.name == main);
    let same_part = of_main.clone().filter(|other| std::ptr::eq(other.part, layer.part));
    // The samples of another part lie elsewhere if its windows differ.
    let same_windows =
        |other: &&Layer<'a>| other.part.data_window == layer.part.data_window && other.part.display_window == layer.part.display_window;
    same_part.chain(of_main.filter(same_windows)).find_map(|other| other.channel("A")).or_else(|| layer.channel("A"))
}

/// Names from a file, as one line. A long list is cut.
fn list<'n>(names: impl ExactSizeIterator<Item = &'n str>) -> String {
    let more = names.len().saturating_sub(NAMES);
    let mut shown: Vec<String> = names.take(NAMES).map(one_line).collect();
    shown.dedup();
    if more > 0 {
        shown.push(format!("and {more} more"));
    }
    shown.join(", ")
}

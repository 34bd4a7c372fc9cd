//! Reads heights from OpenEXR files, and decides which channel holds them.

use std::io::{BufRead, Seek};

use super::depth::Depth;
use super::options::{MAX_SIDE, NoData, ReadOptions};
use super::raster::{Absent, Raster, Stored, crop};
use super::scaling::Statement;
use super::spacing::Spacing;
use crate::base::error::one_line;
use crate::decode::fault::Fault;
use crate::decode::openexr::{self, Channel, Channels, Kind, Part, Window};

/// Names of parts, layers and channels that hold heights, in lower case.
const HEIGHTS: [&str; 7] = ["height", "heights", "elevation", "heightmap", "heightfield", "altitude", "dem"];
/// Names of channels that may hold heights if a file has no colours, in lower case: luminance, depth, value.
const PLAIN: [&str; 3] = ["y", "z", "v"];
/// Names of channels of colours, in lower case; `ry` and `by` are the chroma channels that belong to the luminance `y`.
const COLOURS: [&str; 5] = ["r", "g", "b", "ry", "by"];

/// Largest difference of alpha from 0 or 1 that counts as rounding.
const ALPHA_ROUNDING: f32 = 1e-4;

/// Largest number of channels that a message lists.
const LISTED: usize = 24;

/// A channel of a file.
#[derive(Clone, Copy)]
struct Candidate<'a> {
    part: &'a Part,
    channel: &'a Channel,
}

impl Candidate<'_> {
    /// The name with part and layer, which the option --channel accepts.
    fn full_name(&self) -> String {
        let Candidate { part, channel } = self;
        one_line(&if part.name.is_empty() { channel.name.clone() } else { format!("{}.{}", part.name, channel.name) })
    }

    fn base(&self) -> String {
        self.channel.base_name().to_lowercase()
    }

    /// Whether the name says that the channel contains heights. This is so if the channel itself has one of the names in [`HEIGHTS`]. It is also so
    /// if its part or layer has such a name, and the channel has one of the names in [`PLAIN`] or [`COLOURS`]. The name of the channel matters in
    /// this case, because the layer may also contain other data, such as `height.mask`.
    fn is_named(&self) -> bool {
        let base = self.base();
        let layer = self.channel.layer();
        let is_height = |name: &str| HEIGHTS.contains(&name.trim().to_lowercase().as_str());
        let is_in_layer = self.part.name.split('.').chain(layer.split('.')).any(is_height);
        is_height(&base) || (is_in_layer && (PLAIN.contains(&base.as_str()) || COLOURS.contains(&base.as_str())))
    }
}

/// Reads the channel that contains the heights: the channel that the user names or, if the user names none, the one that [`found`] returns.
/// Samples are marked as transparent where the alpha of the same part and layer is 0. If the options contain [`NoData::Nothing`], alpha is ignored.
pub(super) fn read(input: impl BufRead + Seek, options: &ReadOptions) -> Result<Raster, Fault> {
    let parts = openexr::read(input, MAX_SIDE)?;
    let all: Vec<Candidate<'_>> =
        parts.iter().flat_map(|part| part.channels.iter().map(move |channel| Candidate { part, channel })).collect();
    let chosen = match &options.channel {
        Some(name) => named(&all, name)?,
        None => found(&all)?,
    };
    let Candidate { part, channel } = chosen;
    let name = chosen.full_name();
    let depth = match channel.kind {
        Kind::Half => Depth::Half,
        Kind::Float => Depth::Single,
        Kind::Uint => {
            return Err(Fault::Unsupported(format!(
                "channel `{name}` holds integers, whose unit is unknown; export the heights as float, in metres"
            )));
        }
    };
    if part.pixel_aspect.is_normal() && (part.pixel_aspect - 1.0).abs() > 1e-3 {
        return Err(Fault::Unsupported(format!(
            "its pixels are {} times as wide as high, but a world needs equal spacing; export square pixels",
            part.pixel_aspect
        )));
    }
    let mut notes = Vec::new();
    let shown = shown(part, &mut notes)?;
    let [width, height] = part.display_window.size;
    let window = options.window_of([width, height], false)?;
    let samples_of = |candidate: Candidate<'_>| {
        let [stored_width, stored_height] = part.data_window.size;
        if candidate.channel.samples.len() != stored_width as usize * stored_height as usize {
            return Err(Fault::Damaged(format!("channel `{}` does not fill its data window", candidate.full_name())));
        }
        Ok(crop(crop(candidate.channel.samples.clone(), stored_width, shown), width, window))
    };
    let samples = samples_of(chosen)?;
    let absent = match alpha_of(&all, chosen).filter(|_| options.no_data != NoData::Nothing) {
        Some(alpha) => transparent(&samples_of(alpha)?, &alpha.full_name(), window)?,
        None => Vec::new(),
    };
    if let Some(compression) = part.lossy {
        notes.push(format!("compression {compression} is lossy: the elevations are not exactly those that were exported"));
    }
    Ok(Raster {
        format: format!("OpenEXR, channel `{name}`, {}", depth.words()),
        file_size: [width, height],
        window,
        depth,
        holds_codes: false,
        stored: Stored::Single(samples),
        absent,
        no_data: None,
        statement: Statement::default(),
        spacing: Spacing::Unknown,
        orientation: "row 0 is taken as north",
        notes,
    })
}

/// The alpha channel that belongs to a channel: the one of the same part and layer. `None` if there is none.
fn alpha_of<'a>(all: &[Candidate<'a>], of: Candidate<'a>) -> Option<Candidate<'a>> {
    let belongs = |other: &Candidate<'a>| std::ptr::eq(other.part, of.part) && other.channel.layer() == of.channel.layer();
    all.iter().copied().find(|other| other.channel.is_alpha() && belongs(other) && !std::ptr::eq(other.channel, of.channel))
}

/// Returns an entry for each sample of a window: [`Absent::Transparent`] where `alpha` is 0, otherwise `None`. The list is empty if `alpha` is 0
/// nowhere. `name`: the name of the alpha channel, for messages.
///
/// # Errors
/// The alpha of a sample is neither 0 nor 1, apart from rounding. By convention, the other channels of an OpenEXR file are multiplied by alpha, so a
/// height would be wrong there.
fn transparent(alpha: &[f32], name: &str, [x, y, width, _]: [u32; 4]) -> Result<Vec<Option<Absent>>, Fault> {
    let is = |alpha: f32, value: f32| (alpha - value).abs() <= ALPHA_ROUNDING;
    if let Some((index, other)) = alpha.iter().enumerate().find(|&(_, &alpha)| !is(alpha, 0.0) && !is(alpha, 1.0)) {
        let (column, row) = (x as usize + index % width as usize, y as usize + index / width as usize);
        return Err(Fault::Unsupported(format!(
            "its pixels are partly transparent (first at column {column}, row {row}: channel `{name}` is {other}), but a sample either has a height \
             or has none; export the heights without alpha or, if alpha says nothing about them, give --no-data none"
        )));
    }
    if !alpha.iter().any(|&alpha| is(alpha, 0.0)) {
        return Ok(Vec::new());
    }
    Ok(alpha.iter().map(|&alpha| is(alpha, 0.0).then_some(Absent::Transparent)).collect())
}

/// The part of the data window that the display window shows, as x, y (from the top left corner of the data window), width, height. The result is
/// an error if the data window does not cover the display window.
fn shown(part: &Part, notes: &mut Vec<String>) -> Result<[u32; 4], Fault> {
    let (data, display) = (part.data_window, part.display_window);
    let offset = [0, 1].map(|axis| i64::from(display.position[axis]) - i64::from(data.position[axis]));
    let is_inside = (0..2).all(|axis| offset[axis] >= 0 && offset[axis] + i64::from(display.size[axis]) <= i64::from(data.size[axis]));
    let [Ok(x), Ok(y)] = offset.map(u32::try_from) else { return Err(cropped(data, display)) };
    if !is_inside {
        return Err(cropped(data, display));
    }
    if data != display {
        notes.push(format!("of the data window ({data}), only the display window ({display}) is read"));
    }
    Ok([x, y, display.size[0], display.size[1]])
}

fn cropped(data: Window, display: Window) -> Fault {
    Fault::Unsupported(format!(
        "it is cropped: the data window ({data}) does not cover the display window ({display}); export the whole map without auto-crop"
    ))
}

/// The channel with this name, in upper or lower case. The name is compared with the full names of the channels, then with the names without the
/// part, then with the last components. The first comparison that finds a channel counts. If it finds several, the result is an error.
fn named<'a>(all: &[Candidate<'a>], name: &str) -> Result<Candidate<'a>, Fault> {
    let same = |other: &str| other.eq_ignore_ascii_case(name);
    let ways: [&dyn Fn(&Candidate<'_>) -> bool; 3] =
        [&|candidate| same(&candidate.full_name()), &|candidate| same(&candidate.channel.name), &|candidate| {
            same(candidate.channel.base_name())
        }];
    for way in ways {
        let fitting: Vec<Candidate<'a>> = all.iter().copied().filter(|candidate| way(candidate)).collect();
        match fitting.as_slice() {
            [] => {}
            [one] => return Ok(*one),
            _ => {
                return Err(Fault::Unsupported(format!(
                    "{} channels are named `{}`; give one of: {}",
                    fitting.len(),
                    one_line(name),
                    list(&fitting)
                )));
            }
        }
    }
    Err(Fault::Unsupported(format!("it has no channel `{}`; give one of: {}", one_line(name), list(all))))
}

/// The channel that contains the heights. The candidates are the channels other than alpha whose names say so ([`Candidate::is_named`]). If there are
/// none, all channels other than alpha are candidates. A single candidate is the result. If there are several, the first of these rules that finds a
/// channel decides:
/// - the only candidate whose last component is one of [`HEIGHTS`];
/// - if no candidate is a colour: the only candidate whose last component is one of [`PLAIN`];
/// - red, if the candidates are red, green and blue, and are equal in all pixels ([`grey`]).
///
/// If no rule finds a channel, the result is an error with a list of the channels.
fn found<'a>(all: &[Candidate<'a>]) -> Result<Candidate<'a>, Fault> {
    let solid: Vec<Candidate<'a>> = all.iter().copied().filter(|candidate| !candidate.channel.is_alpha()).collect();
    let named: Vec<Candidate<'a>> = solid.iter().copied().filter(Candidate::is_named).collect();
    let scope = if named.is_empty() { solid } else { named };
    let with_base =
        |names: &[&str]| scope.iter().copied().filter(|candidate| names.contains(&candidate.base().as_str())).collect::<Vec<_>>();
    let colours = with_base(&COLOURS);
    let one_of = |candidates: &[Candidate<'a>]| if let [one] = candidates { Some(*one) } else { None };
    let plain = if colours.is_empty() { one_of(&with_base(&PLAIN)) } else { None };
    let certain = one_of(&scope).or_else(|| one_of(&with_base(&HEIGHTS))).or(plain).or_else(|| grey(&scope));
    certain.ok_or_else(|| {
        let why = match colours.as_slice() {
            [] => "none is named after heights",
            _ => "there are colours; they are read as heights only if red, green and blue are alone and equal in all pixels",
        };
        Fault::Unsupported(format!(
            "it is not certain which channel holds the heights ({why}); name it with --channel, one of: {}; or call it `height`",
            list(all)
        ))
    })
}

/// Red, if the channels are red, green and blue of one part, layer and type, and are equal in all pixels; otherwise `None`.
fn grey<'a>(scope: &[Candidate<'a>]) -> Option<Candidate<'a>> {
    let channels = Channels(scope.iter().map(|candidate| candidate.channel).collect());
    let [red, green, blue] = ["R", "G", "B"].map(|name| channels.with_base(name));
    let (red, green, blue) = (red?, green?, blue?);
    let own = scope.iter().copied().find(|candidate| std::ptr::eq(candidate.channel, red))?;
    let belongs = |other: &Candidate<'a>| {
        std::ptr::eq(own.part, other.part) && red.layer() == other.channel.layer() && red.kind == other.channel.kind
    };
    let is_equal = |other: &Channel| red.samples.iter().zip(&other.samples).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()));
    (scope.len() == 3 && scope.iter().all(belongs) && is_equal(green) && is_equal(blue)).then_some(own)
}

fn list(candidates: &[Candidate<'_>]) -> String {
    let mut names: Vec<String> = candidates.iter().take(LISTED).map(Candidate::full_name).collect();
    if candidates.len() > LISTED {
        names.push(format!("and {} more", candidates.len() - LISTED));
    }
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A part of 2 x 1 pixels with channels of these names and samples.
    fn part(name: &str, channels: &[(&str, [f32; 2])]) -> Part {
        let window = Window { position: [0, 0], size: [2, 1] };
        let channel = |&(name, samples): &(&str, [f32; 2])| Channel { name: name.to_owned(), kind: Kind::Float, samples: samples.to_vec() };
        Part {
            name: name.to_owned(),
            data_window: window,
            display_window: window,
            pixel_aspect: 1.0,
            chromaticities: None,
            lossy: None,
            channels: channels.iter().map(channel).collect(),
        }
    }

    fn candidates(parts: &[Part]) -> Vec<Candidate<'_>> {
        parts.iter().flat_map(|part| part.channels.iter().map(move |channel| Candidate { part, channel })).collect()
    }

    fn chosen(parts: &[Part]) -> Result<String, String> {
        found(&candidates(parts)).map(|candidate| candidate.full_name()).map_err(|fault| fault.to_string())
    }

    const A: [f32; 2] = [1.0, 2.0];
    const B: [f32; 2] = [3.0, 4.0];

    #[test]
    fn the_channel_named_after_heights_is_found_in_any_part_layer_and_case() {
        for (parts, expected) in [
            (vec![part("", &[("y", A)])], "y"),
            (vec![part("", &[("A", A), ("Y", B)])], "Y"),
            (vec![part("", &[("heightfield.V", A)])], "heightfield.V"),
            (vec![part("", &[("B", A), ("G", A), ("R", B), ("height.Y", A)])], "height.Y"),
            (vec![part("", &[("terrain.Height", A), ("terrain.mask", A)])], "terrain.Height"),
            (vec![part("colour", &[("B", A), ("G", A), ("R", B)]), part("Elevation", &[("Y", A)])], "Elevation.Y"),
            (vec![part("height", &[("A", A), ("Y", A)]), part("colour", &[("R", A)])], "height.Y"),
            (vec![part("", &[("B", A), ("G", A), ("R", A)])], "R"),
            (vec![part("", &[("A", B), ("B", A), ("G", A), ("R", A)])], "R"),
            (vec![part("", &[("flow", A), ("Z", A)])], "Z"),
            (vec![part("", &[("anything", A)])], "anything"),
            (vec![part("", &[("height.mask", A)])], "height.mask"),
            (vec![part("", &[("height.mask", A), ("height.Y", B)])], "height.Y"),
        ] {
            assert_eq!(chosen(&parts), Ok(expected.to_owned()));
        }
    }

    #[test]
    fn what_is_not_certain_is_refused_with_the_list() {
        for (parts, words) in [
            (vec![part("", &[("B", A), ("G", A), ("R", B)])], "red, green and blue are alone and equal"),
            (vec![part("", &[("B", A), ("G", A), ("R", A), ("Z", B)])], "one of: B, G, R, Z"),
            (vec![part("", &[("BY", A), ("RY", A), ("Y", A)])], "one of: BY, RY, Y"),
            (vec![part("", &[("flow", A), ("wear", A)])], "none is named after heights"),
            (vec![part("a", &[("Y", A)]), part("b", &[("Y", A)])], "one of: a.Y, b.Y"),
            (vec![part("", &[("one.height", A), ("two.height", A)])], "one of: one.height, two.height"),
            (vec![part("", &[("x.B", A), ("x.G", A), ("y.R", A)])], "colours"),
            (vec![part("", &[("A", A)])], "one of: A"),
            (vec![part("", &[("height.mask", A), ("flow", B)])], "one of: height.mask, flow"),
            (vec![part("height", &[("mask", A)]), part("colour", &[("R", A)])], "one of: height.mask, colour.R"),
        ] {
            let text = chosen(&parts).expect_err(words);
            assert!(text.contains(words) && text.contains("--channel"), "`{words}` is missing in: {text}");
        }
    }

    #[test]
    fn a_channel_is_named_with_or_without_part_and_layer() {
        let parts = [part("one", &[("low.Y", A), ("high.Y", A)]), part("two", &[("flow", A), ("high.Y", A)])];
        let named = |name: &str| named(&candidates(&parts), name).map(|candidate| candidate.full_name()).map_err(|fault| fault.to_string());
        assert_eq!(named("FLOW"), Ok("two.flow".to_owned()));
        assert_eq!(named("low.y"), Ok("one.low.Y".to_owned()));
        assert_eq!(named("two.high.Y"), Ok("two.high.Y".to_owned()));
        assert!(named("high.Y").expect_err("two").contains("2 channels are named `high.Y`; give one of: one.high.Y, two.high.Y"));
        assert!(named("Y").expect_err("three").contains("3 channels"));
        assert!(named("Q").expect_err("none").contains("no channel `Q`"));
    }

    #[test]
    fn alpha_belongs_to_the_channels_of_its_part_and_layer() {
        let parts = [part("", &[("A", A), ("Y", A), ("height.Y", A), ("sea.a", A), ("sea.Y", A)]), part("two", &[("Y", A)])];
        let all = candidates(&parts);
        let alpha = |name: &str| alpha_of(&all, named(&all, name).expect("one")).map(|candidate| candidate.full_name());
        assert_eq!([alpha("Y"), alpha("height.Y"), alpha("sea.Y")], [Some("A".to_owned()), None, Some("sea.a".to_owned())]);
        assert_eq!((alpha("two.Y"), alpha("A")), (None, None));
        let marks = |alpha: &[f32]| transparent(alpha, "A", [7, 2, 3, 2]).map_err(|fault| fault.to_string());
        assert_eq!(marks(&[1.0; 6]), Ok(Vec::new()));
        let void = Some(Absent::Transparent);
        assert_eq!(marks(&[1.0, 0.0, 1.0, 0.99995, 0.00005, 1.0]), Ok(vec![None, void, None, None, void, None]));
        for (value, shown) in [(0.5, "0.5"), (0.999, "0.999"), (1.5, "1.5"), (f32::NAN, "NaN")] {
            let text = marks(&[1.0, 1.0, 1.0, 1.0, value, 1.0]).expect_err("partly transparent");
            assert!(text.contains(&format!("column 8, row 3: channel `A` is {shown}")) && text.contains("--no-data none"), "{text}");
        }
    }

    #[test]
    fn the_display_window_is_what_counts() {
        let with = |position: [i32; 2], size: [u32; 2]| {
            let whole = part("", &[("Y", A)]);
            let display_window = Window { position: [0, 0], size: [65, 49] };
            shown(&Part { data_window: Window { position, size }, display_window, ..whole }, &mut Vec::new())
                .map_err(|fault| fault.to_string())
        };
        assert_eq!(with([0, 0], [65, 49]), Ok([0, 0, 65, 49]));
        assert_eq!(with([-3, -2], [80, 60]), Ok([3, 2, 65, 49]), "overscan is left out");
        for (position, size) in
            [([12, 10], [48, 30]), ([0, 0], [64, 49]), ([-3, 1], [80, 60]), ([i32::MIN, 0], [65, 49]), ([i32::MAX, 0], [65, 49])]
        {
            let text = with(position, size).expect_err("cropped");
            let [w, h] = size;
            assert!(text.contains(&format!("{w} x {h} at")) && text.contains("65 x 49 at (0, 0)"), "{text}");
        }
        let mut notes = Vec::new();
        let offset = Window { position: [-7, 5], size: [2, 1] };
        let moved = Part { data_window: offset, display_window: offset, ..part("", &[("Y", A)]) };
        assert_eq!((shown(&moved, &mut notes).expect("whole"), notes.len()), ([0, 0, 2, 1], 0));
    }
}

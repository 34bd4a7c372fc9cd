//! Facts about the files of two pictures that affect the metrics: pixels that cannot be compared, and notes for readers of the numbers.

use std::path::Path;

use kernels::base::error::{Error, Result};
use serde::Serialize;

use super::Metric;
use super::picture::{Content, Image};
use super::windows::Windows;

/// Distance from 0..=1 up to which a value outside this range is not reported. Clamping such a value changes its 8-bit sRGB code by less than half a
/// step, because the slope of the encoding is 12.92 at 0 and 0.44 at 1.
const CLAMP_TOLERANCE: f32 = 1e-4;

/// A fact about the files that affects the metrics.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Note {
    /// The subject: `layer`, `window`, `primaries`, `gamma`, `colours`, `orientation`, `aspect`, `compression`, `precision`, `alpha` or `clamped`.
    pub about: &'static str,
    /// The fact, in one line.
    pub text: String,
}

/// One side of a comparison: the test or the reference.
#[derive(Clone, Copy, Debug)]
pub struct Side<'a> {
    /// The file.
    pub file: &'a Path,
    /// Its picture.
    pub image: &'a Image,
}

/// Checks that two pictures of the same size can be compared pixel by pixel. Their display windows must lie at the same place. If only one
/// of the files stores a pixel, its value must be black, because viewers show black where a file stores no pixel. Pixels for which `mask`
/// is false are not checked.
///
/// # Errors
/// The display windows lie at different places, or a pixel that only one file stores is not black. The message names both files and what they store
/// or show.
pub fn check_windows(test: Side<'_>, reference: Side<'_>, mask: Option<&[bool]>) -> Result<()> {
    if let (Some(a), Some(b)) = (test.image.origin.windows, reference.image.origin.windows)
        && a.display.position != b.display.position
    {
        return Err(Error::Request(format!(
            "{} shows {} and {} shows {}: these are different parts of the picture plane; save both with the same display window",
            test.file.display(),
            a.display,
            reference.file.display(),
            b.display
        )));
    }
    let all = |windows: Option<Windows>| windows.is_none_or(|windows| windows.missing() == 0);
    if all(test.image.origin.windows) && all(reference.image.origin.windows) {
        return Ok(());
    }
    let texels = test.image.texels.iter().zip(&reference.image.texels).enumerate();
    let is_black = |texel: &[f32; 3]| texel.iter().all(|value| *value == 0.0);
    let unknown = |index: usize, t: &[f32; 3], r: &[f32; 3]| match (test.image.stores(index), reference.image.stores(index)) {
        (true, false) => !is_black(t),
        (false, true) => !is_black(r),
        _ => false,
    };
    let count = texels.filter(|(index, (t, r))| counts(mask, *index) && unknown(*index, t, r)).count();
    if count == 0 {
        return Ok(());
    }
    let stores = |side: Side<'_>| {
        let [width, height] = side.image.size;
        let windows = side.image.origin.windows.map_or_else(|| format!("all {width} x {height}"), |windows| windows.data.to_string());
        format!("{} stores {windows}", side.file.display())
    };
    let [width, height] = test.image.size;
    Err(Error::Request(format!(
        "{} and {} of a picture of {width} x {height}; {count} pixels that only one of them stores are not black, so there is nothing to compare \
         them with: save both with the same data window",
        stores(test),
        stores(reference)
    )))
}

/// Returns notes about the properties of the files that affect the metrics, in a fixed order; empty if there are none. The notes about alpha and
/// about clamped values count only pixels for which `mask` is true. The two pictures must have the same size and content.
pub fn notes(test: Side<'_>, reference: Side<'_>, mask: Option<&[bool]>, metrics: &[Metric]) -> Vec<Note> {
    let mut notes: Vec<Note> = [test, reference].into_iter().flat_map(of_file).collect();
    notes.extend(precision(test, reference));
    notes.extend(alpha(test, reference, mask));
    notes.extend(clamped(test, reference, mask, metrics));
    notes
}

fn counts(mask: Option<&[bool]>, index: usize) -> bool {
    mask.is_none_or(|mask| mask.get(index).copied().unwrap_or(false))
}

/// Returns the notes that depend on only one of the two files.
fn of_file(side: Side<'_>) -> Vec<Note> {
    let (name, origin) = (side.file.display(), &side.image.origin);
    let mut notes = Vec::new();
    let mut note = |about, text: Option<String>| notes.extend(text.map(|text| Note { about, text: format!("{name}: {text}") }));
    note("layer", origin.layer.as_ref().map(|layer| format!("its layer `{layer}` was read, because it is the only one that can be meant")));
    let windows = origin.windows.filter(|windows| windows.data != windows.display);
    note(
        "window",
        windows.map(|windows| {
            let Windows { data, display } = windows;
            let missing = Some(windows.missing()).filter(|n| *n > 0).map(|n| format!("; {n} pixels without data count as black"));
            let left_out = Some(windows.left_out()).filter(|n| *n > 0).map(|n| format!("; {n} stored pixels outside are left out"));
            format!("stores {data} of its picture of {display}{}{}", missing.unwrap_or_default(), left_out.unwrap_or_default())
        }),
    );
    note("primaries", origin.converted_from.map(|stated| format!("its primaries ({stated}) were converted to Rec. 709")));
    note("gamma", origin.gamma.map(|gamma| format!("its gamma of {gamma} was used instead of sRGB")));
    note("colours", origin.ignored.as_ref().map(|what| format!("it has {what}, which is not applied: its colours were read as sRGB")));
    note("orientation", origin.turned.map(|how| format!("it was {how}, as its EXIF orientation says")));
    note(
        "aspect",
        origin.pixel_aspect.map(|ratio| format!("its pixels are {ratio} times as wide as high, but pixels are compared one by one")),
    );
    note("compression", origin.lossy.map(|compression| format!("its compression ({compression}) changes pixels")));
    notes
}

/// Returns a note if one of the files has 8-bit samples and the other has floats.
fn precision(test: Side<'_>, reference: Side<'_>) -> Option<Note> {
    let (codes, floats) = match (test.image.origin.bits, reference.image.origin.bits) {
        (Some(8), None) => (test, reference),
        (None, Some(8)) => (reference, test),
        _ => return None,
    };
    let text = format!(
        "{} has 8-bit codes, and {} has floats: rounding alone gives errors of up to half a code, 1/510 of the sRGB encoding",
        codes.file.display(),
        floats.file.display()
    );
    Some(Note { about: "precision", text })
}

/// Returns a note about alpha, which no metric compares. A picture without alpha counts as opaque. The note gives up to two numbers, each only if it
/// is above 0. The first is the number of pixels with different alpha. The second is the number of pixels that are not opaque in at least one of the
/// pictures. It is given only if the colours of exactly one of the files are multiplied by alpha.
fn alpha(test: Side<'_>, reference: Side<'_>, mask: Option<&[bool]>) -> Option<Note> {
    if test.image.content != Content::Colour {
        return None;
    }
    let of = |side: Side<'_>, index: usize| side.image.alpha.as_ref().map_or(1.0, |alpha| alpha.get(index).copied().unwrap_or(1.0));
    // If one of the files has 8-bit codes, rounding alone can cause a difference of half a code.
    let tolerance = if [test, reference].iter().any(|side| side.image.origin.bits == Some(8)) { 1.0 / 510.0 } else { 0.0 };
    let compared = (0..test.image.texels.len()).filter(|index| counts(mask, *index));
    let differs = |index: usize| {
        let distance = (of(test, index) - of(reference, index)).abs();
        distance > tolerance || distance.is_nan()
    };
    let count = compared.clone().filter(|index| differs(*index)).count();
    let differing = (count > 0).then(|| format!("alpha differs in {count} pixels, and is not compared"));
    // For opaque pixels, it makes no difference whether colours are multiplied by alpha.
    let is_clear = |index: usize| of(test, index) < 1.0 || of(reference, index) < 1.0;
    let conventions_differ = test.image.origin.multiplied_by_alpha != reference.image.origin.multiplied_by_alpha;
    let clear = if conventions_differ { compared.filter(|index| is_clear(*index)).count() } else { 0 };
    let conventions = (clear > 0).then(|| {
        format!(
            "{clear} pixels are not opaque: colours of OpenEXR are multiplied by alpha, those of PNG are not, and they are compared as stored"
        )
    });
    let texts: Vec<String> = [differing, conventions].into_iter().flatten().collect();
    (!texts.is_empty()).then(|| Note { about: "alpha", text: texts.join("; ") })
}

/// Returns a note about values outside 0..=1, which are clamped before the sRGB encoding.
fn clamped(test: Side<'_>, reference: Side<'_>, mask: Option<&[bool]>, metrics: &[Metric]) -> Option<Note> {
    let affected: Vec<&str> = metrics.iter().filter(|metric| metric.needs_colour()).map(|metric| metric.name()).collect();
    if affected.is_empty() || test.image.content != Content::Colour {
        return None;
    }
    let outside = |value: &&f32| !(-CLAMP_TOLERANCE..=1.0 + CLAMP_TOLERANCE).contains(*value);
    let count = |side: Side<'_>| {
        let compared = side.image.texels.iter().enumerate().filter(|(index, _)| counts(mask, *index));
        compared.map(|(_, texel)| texel.iter().filter(outside).count()).sum::<usize>()
    };
    let [of_test, of_reference] = [count(test), count(reference)];
    (of_test + of_reference > 0).then(|| Note {
        about: "clamped",
        text: format!(
            "{of_test} values of {} and {of_reference} of {} lie outside 0..1, and are clamped for {}",
            test.file.display(),
            reference.file.display(),
            affected.join(", ")
        ),
    })
}

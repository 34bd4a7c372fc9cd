//! Reads the statements of image files about their colours: chunks of PNG files, and ICC profiles.

use std::io::{BufRead, Seek};

use super::openexr::Chromaticities;
use crate::base::error::one_line;

/// Limit of the memory for the metadata of a PNG file, and for one row of its pixels, bytes.
pub(super) const MAX_INFO_BYTES: usize = 1 << 26;

/// Largest relative difference between a stated exponent and 1/2.2 at which the exponent counts as that of sRGB. Programs write 1/2.2 for
/// sRGB. Source: libpng, `PNG_GAMMA_THRESHOLD_FIXED`.
const GAMMA_TOLERANCE: f64 = 0.05;

/// Descriptions of ICC profiles that count as sRGB.
const SRGB_PROFILES: [&str; 7] =
    ["sRGB", "sRGB IEC61966-2.1", "sRGB IEC61966-2-1", "sRGB IEC61966-2-1 black scaled", "sRGB built-in", "GIMP built-in sRGB", "sRGB2014"];

/// The statements of a PNG file about its colours. An exponent or primaries that are those of sRGB, apart from rounding, are left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Colours {
    /// Codes are linear values to the power of this number.
    pub gamma: Option<f64>,
    /// Primaries and white point.
    pub primaries: Option<Chromaticities>,
    /// Code points, which take precedence over all other statements.
    pub code_points: Option<CodePoints>,
}

/// The code points (chunk cICP) of a PNG file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CodePoints {
    /// Whether the code points are those of sRGB.
    pub is_srgb: bool,
    /// Description of the code points, for a message.
    pub text: String,
}

impl Colours {
    /// Describes, for a message, the statement about colours that the readers do not apply; `None` if there is no such statement. It is a statement
    /// by code points or by an ICC profile, if they are not those of sRGB. `profile` is the ICC profile of the file. Code points take precedence over
    /// a profile (PNG, third edition, "Color chunk precedence").
    pub fn unapplied(&self, profile: Option<&[u8]>) -> Option<String> {
        match (&self.code_points, profile) {
            (Some(points), _) => (!points.is_srgb).then(|| points.text.clone()),
            (None, Some(profile)) => unapplied_profile(profile),
            (None, None) => None,
        }
    }

    /// Reads the statements of a PNG file about its colours. Their precedence follows PNG (third edition), "Color chunk precedence": code
    /// points (cICP), then a profile (iCCP), then sRGB, then exponent and primaries (gAMA, cHRM). Without any of these, a picture counts as sRGB.
    /// A profile is not part of the result, see [`Colours::unapplied`].
    ///
    /// # Errors
    /// The header or the metadata cannot be read or are damaged, or the metadata or a row of pixels exceed 64 MiB.
    pub fn of_png(input: impl BufRead + Seek) -> Result<Colours, png::DecodingError> {
        let decoder = png::Decoder::new_with_limits(input, png::Limits { bytes: MAX_INFO_BYTES });
        let reader = decoder.read_info()?;
        let info = reader.info();
        if let Some(points) = &info.coding_independent_code_points {
            let (primaries, transfer) = (points.color_primaries, points.transfer_function);
            // The codes of sRGB in Rec. ITU-T H.273, tables 2 and 3.
            let is_srgb = primaries == 1 && transfer == 13 && points.is_video_full_range_image;
            let text = format!("primaries {primaries} and transfer function {transfer} of Rec. ITU-T H.273 (cICP)");
            return Ok(Colours { code_points: Some(CodePoints { is_srgb, text }), ..Colours::default() });
        }
        if info.icc_profile.is_some() || info.srgb.is_some() {
            return Ok(Colours::default());
        }
        // The decoder ignores an exponent of 0, as libpng does.
        let gamma = info.gama_chunk.map(|gamma| f64::from(gamma.into_scaled()) / 100_000.0);
        let value = |stated: png::ScaledFloat| (f64::from(stated.into_scaled()) / 100_000.0) as f32;
        let pair = |(x, y): (png::ScaledFloat, png::ScaledFloat)| [value(x), value(y)];
        let primaries = info.chrm_chunk.map(|stated| Chromaticities {
            red: pair(stated.red),
            green: pair(stated.green),
            blue: pair(stated.blue),
            white: pair(stated.white),
        });
        Ok(Colours {
            gamma: gamma.filter(|gamma| (gamma * 2.2 - 1.0).abs() > GAMMA_TOLERANCE),
            primaries: primaries.filter(|stated| !stated.is_rec_709()),
            code_points: None,
        })
    }
}

/// Returns the name of an ICC profile, for a message; `None` if its description is one of [`SRGB_PROFILES`], so that nothing needs to be applied.
fn unapplied_profile(profile: &[u8]) -> Option<String> {
    match description(profile) {
        Some(name) if SRGB_PROFILES.contains(&name.as_str()) => None,
        Some(name) => Some(format!("the ICC profile `{}`", one_line(&name))),
        None => Some("an ICC profile".to_owned()),
    }
}

/// The description of an ICC profile: the tag `desc`, as multi-localised Unicode (ICC.1:2022, 10.15) or as text (ICC.1:2001-04, 6.5.17). `None` if
/// it is missing or damaged.
fn description(profile: &[u8]) -> Option<String> {
    let number = |bytes: &[u8], at: usize| -> Option<usize> {
        let four: [u8; 4] = bytes.get(at..at.checked_add(4)?)?.try_into().ok()?;
        usize::try_from(u32::from_be_bytes(four)).ok()
    };
    // The table of tags follows the header of 128 bytes: the number of tags, then 12 bytes for each tag (signature, position, length).
    let mut tags = profile.get(132..)?.chunks_exact(12).take(number(profile, 128)?);
    let tag = tags.find(|tag| tag.starts_with(b"desc"))?;
    let begin = number(tag, 4)?;
    let content = profile.get(begin..begin.checked_add(number(tag, 8)?)?)?;
    if content.starts_with(b"mluc") {
        let begin = number(content, 24)?;
        let text = content.get(begin..begin.checked_add(number(content, 20)?)?)?;
        let units: Vec<u16> = text.as_chunks::<2>().0.iter().map(|pair| u16::from_be_bytes(*pair)).collect();
        return String::from_utf16(&units).ok();
    }
    let length = content.starts_with(b"desc").then(|| number(content, 8)).flatten()?;
    let text = content.get(12..length.checked_add(12)?)?;
    Some(String::from_utf8_lossy(text).trim_end_matches('\0').to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ICC profile with nothing but a description.
    fn profile(content: &[u8]) -> Vec<u8> {
        let tag = [b"desc".as_slice(), &144_u32.to_be_bytes(), &u32::try_from(content.len()).unwrap().to_be_bytes()].concat();
        [vec![0; 128], 1_u32.to_be_bytes().to_vec(), tag, content.to_vec()].concat()
    }

    #[test]
    fn rows_that_exceed_the_limit_of_memory_are_refused() {
        let colours = |width: u32| {
            let mut bytes = Vec::new();
            let mut encoder = png::Encoder::new(&mut bytes, width, 1);
            encoder.set_color(png::ColorType::Rgba);
            encoder.set_depth(png::BitDepth::Sixteen);
            let mut writer = encoder.write_header().unwrap();
            writer.write_chunk(png::chunk::IDAT, &[0; 8]).unwrap();
            drop(writer);
            Colours::of_png(std::io::Cursor::new(bytes))
        };
        assert_eq!(colours(1 << 10).unwrap(), Colours::default());
        // 2^25 pixels of 8 bytes are 256 MiB, and the limit is 64 MiB.
        assert!(matches!(colours(1 << 25), Err(png::DecodingError::LimitsExceeded)));
    }

    #[test]
    fn code_points_count_before_a_profile() {
        let points =
            |is_srgb: bool| Colours { code_points: Some(CodePoints { is_srgb, text: "primaries 9".to_owned() }), ..Colours::default() };
        let profile = profile(b"desc\0\0\0\0\0\0\0\x02P\0");
        assert_eq!(points(false).unapplied(Some(&profile)).as_deref(), Some("primaries 9"));
        assert_eq!((points(true).unapplied(Some(&profile)), points(true).unapplied(None)), (None, None));
        assert_eq!(Colours::default().unapplied(Some(&profile)).as_deref(), Some("the ICC profile `P`"));
        assert_eq!(Colours::default().unapplied(None), None);
    }

    #[test]
    fn profiles_are_named() {
        let text = |name: &str| {
            let length = u32::try_from(name.len() + 1).unwrap().to_be_bytes();
            profile(&[b"desc\0\0\0\0".as_slice(), &length, name.as_bytes(), b"\0"].concat())
        };
        let unicode = |name: &str| {
            let units: Vec<u8> = name.encode_utf16().flat_map(u16::to_be_bytes).collect();
            let length = u32::try_from(units.len()).unwrap().to_be_bytes();
            let head = [b"mluc\0\0\0\0\0\0\0\x01\0\0\0\x0cenUS".as_slice(), &length, &28_u32.to_be_bytes()].concat();
            profile(&[head, units].concat())
        };
        for profile in [text("Display P3"), unicode("Display P3")] {
            assert_eq!(unapplied_profile(&profile).as_deref(), Some("the ICC profile `Display P3`"));
            // A truncated profile must not count as sRGB.
            for length in 0..profile.len() {
                assert!(unapplied_profile(&profile[..length]).is_some());
            }
        }
        for profile in [text("sRGB IEC61966-2.1"), unicode("GIMP built-in sRGB")] {
            assert_eq!(unapplied_profile(&profile), None);
        }
        assert_eq!(
            unapplied_profile(&unicode("GIMP built-in Linear sRGB")).as_deref(),
            Some("the ICC profile `GIMP built-in Linear sRGB`")
        );
        assert_eq!(unapplied_profile(&profile(b"desc\0\0\0\0\xff\xff\xff\xff")).as_deref(), Some("an ICC profile"));
    }
}

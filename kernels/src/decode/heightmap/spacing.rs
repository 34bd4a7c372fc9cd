//! The distance between samples: from the file, or from the user.

use super::options::MAX_SPACING_M;
use super::units::Unit;
use crate::decode::fault::Fault;

/// Largest relative difference between the spacing in the file and the spacing from the user that counts as rounding. Rounding to four significant
/// digits changes a number by at most half of this.
const SAME: f64 = 1e-3;

/// The statement of a file about the distance between its samples.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Spacing {
    /// The file states no distance.
    Unknown,
    /// A number without a unit of length.
    WithoutUnit {
        stated: f64,
        /// EPSG code and unit of the coordinate system that the file names, if this system is known to be in feet.
        usual: Option<(u16, Unit)>,
    },
    /// A distance in metres.
    Stated {
        metres: f64,
        /// How the file states it, in words.
        how: String,
    },
}

/// The distance between samples that is used.
#[derive(Debug)]
pub(super) struct Resolved {
    /// The distance, metres, above 0 and at most 100 000.
    pub(super) metres: f64,
    /// Where the distance is stated, in words: in the file or by the user.
    pub(super) from: String,
    /// A note for the user.
    pub(super) note: Option<String>,
}

impl Spacing {
    /// Returns the spacing to use. `given`: the spacing that the user gives, metres.
    pub(super) fn resolve(&self, given: Option<f64>) -> Result<Resolved, Fault> {
        let given_only = |metres: f64, note: Option<String>| Ok(Resolved { metres, from: "as given".to_owned(), note });
        match (self, given) {
            (Spacing::Stated { metres, how }, _) => {
                let metres = *metres;
                if !(metres > 0.0 && metres <= MAX_SPACING_M) {
                    return Err(Fault::Unsupported(format!(
                        "the file says that its samples are {metres} m apart; a spacing must be above 0 and at most {MAX_SPACING_M} m: correct the file"
                    )));
                }
                if let Some(given) = given.filter(|given| !is_same(*given, metres)) {
                    return Err(Fault::Unsupported(format!(
                        "--metres-per-texel {given} contradicts the file, which says {metres} m ({how}); leave the option out, or correct the file"
                    )));
                }
                Ok(Resolved { metres, from: format!("from the file: {how}"), note: None })
            }
            (Spacing::WithoutUnit { stated, usual }, Some(given)) => {
                let note = (!is_same(usual.map_or(*stated, |(_, unit)| stated * unit.metres), given)).then(|| {
                    let meant = usual.map_or_else(String::new, |usual| format!(" ({})", in_usual(*stated, usual)));
                    format!("the file states a spacing of {stated} without a unit{meant}; the {given} m of --metres-per-texel are used")
                });
                given_only(given, note)
            }
            (Spacing::Unknown, Some(given)) => given_only(given, None),
            (Spacing::WithoutUnit { stated, usual }, None) => {
                let example = match usual {
                    Some(usual) => in_usual(*stated, *usual),
                    None => format!("{stated} if the unit is the metre"),
                };
                Err(Fault::Unsupported(format!(
                    "the file states a spacing of {stated}, but not its unit; give --metres-per-texel, for example {example}"
                )))
            }
            (Spacing::Unknown, None) => {
                Err(Fault::Unsupported("the file does not say how far apart its samples are; give --metres-per-texel METRES".to_owned()))
            }
        }
    }
}

/// Text for a message: a spacing, converted from the unit of a coordinate system to metres, and the reason for the conversion.
fn in_usual(stated: f64, (system, unit): (u16, Unit)) -> String {
    // The number is rounded to micrometres, so that it is short.
    let metres = (stated * unit.metres * 1e6).round() / 1e6;
    format!("{metres}, because the unit of EPSG:{system} is the {}", unit.name)
}

fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() <= SAME * a.abs().max(b.abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_decides_and_the_user_may_not_contradict_it() {
        let feet = Spacing::Stated { metres: 12_000.0 / 3937.0, how: "10 US survey foot".to_owned() };
        for given in [None, Some(3.048), Some(3.05)] {
            let resolved = feet.resolve(given).expect("no contradiction");
            assert!((resolved.metres - 3.048_006_096).abs() < 1e-9 && resolved.from.contains("10 US survey foot"));
        }
        for given in [3.04, 10.0, 30.0] {
            let text = feet.resolve(Some(given)).expect_err("a contradiction").to_string();
            assert!(text.contains(&format!("--metres-per-texel {given} contradicts")) && text.contains("3.048"), "{text}");
        }
        for wrong in [0.0, -1.0, f64::NAN, f64::INFINITY, 2e5] {
            let spacing = Spacing::Stated { metres: wrong, how: String::new() };
            assert!(spacing.resolve(None).is_err() && spacing.resolve(Some(10.0)).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_spacing_that_nobody_states_is_asked_for() {
        assert!(Spacing::Unknown.resolve(None).expect_err("unknown").to_string().contains("--metres-per-texel"));
        let without = |usual: Option<(u16, Unit)>| Spacing::WithoutUnit { stated: 25.0, usual };
        let text = without(None).resolve(None).expect_err("no unit").to_string();
        assert!(text.contains("25, but not its unit") && text.contains("for example 25 if the unit is the metre"), "{text}");
        assert!(Spacing::Unknown.resolve(Some(4.0)).expect("given").note.is_none());
        assert!(without(None).resolve(Some(25.0)).expect("the same").note.is_none());
        let other = without(None).resolve(Some(7.62)).expect("given");
        assert!((other.metres - 7.62).abs() < 1e-12 && other.note.is_some_and(|note| note.contains("25 without a unit;")));
        // If the coordinate system is in feet, the message converts the spacing to metres.
        let feet = without(Unit::of_code(9003).map(|unit| (2229, unit)));
        let text = feet.resolve(None).expect_err("no unit").to_string();
        assert!(text.contains("for example 7.620015, because the unit of EPSG:2229 is the US survey foot"), "{text}");
        assert!(feet.resolve(Some(7.62)).expect("given").note.is_none());
        let metres = feet.resolve(Some(25.0)).expect("given").note.expect("another unit");
        assert!(metres.contains("25 without a unit (7.620015, because the unit of EPSG:2229") && metres.contains("the 25 m"), "{metres}");
    }
}

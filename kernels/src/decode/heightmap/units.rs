//! Units of length that files name, by code (EPSG, as in GeoTIFF keys) or by word (GDAL's UNITTYPE).

/// A unit of length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Unit {
    pub(super) name: &'static str,
    /// Length of the unit, metres, above 0.
    pub(super) metres: f64,
}

/// The metre.
pub(super) const METRE: Unit = Unit { name: "metre", metres: 1.0 };

/// Units: EPSG code if there is one, unit, and other names in lower case. The US survey foot is 1200 / 3937 m (US National Bureau of Standards,
/// 1959).
const UNITS: [(Option<u16>, Unit, &[&str]); 12] = [
    (Some(9001), METRE, &["m", "metres", "meter", "meters"]),
    (Some(9002), Unit { name: "foot", metres: 0.3048 }, &["ft", "feet", "international foot", "international feet"]),
    (
        Some(9003),
        Unit { name: "US survey foot", metres: 1200.0 / 3937.0 },
        &["us survey feet", "us-ft", "us_ft", "us ft", "us foot", "ftus", "us_survey_foot", "survey foot", "foot_us"],
    ),
    (Some(9005), Unit { name: "Clarke's foot", metres: 0.304_797_265_4 }, &[]),
    (Some(9095), Unit { name: "British foot (1936)", metres: 0.304_800_749_1 }, &[]),
    (Some(9096), Unit { name: "yard", metres: 0.9144 }, &["yd", "yards"]),
    (Some(1025), Unit { name: "millimetre", metres: 0.001 }, &["mm", "millimetres", "millimeter", "millimeters"]),
    (Some(1033), Unit { name: "centimetre", metres: 0.01 }, &["cm", "centimetres", "centimeter", "centimeters"]),
    (None, Unit { name: "decimetre", metres: 0.1 }, &["dm", "decimetres", "decimeter", "decimeters"]),
    (Some(9036), Unit { name: "kilometre", metres: 1000.0 }, &["km", "kilometres", "kilometer", "kilometers"]),
    (Some(9093), Unit { name: "statute mile", metres: 1609.344 }, &["mile", "miles", "mi"]),
    (Some(9030), Unit { name: "nautical mile", metres: 1852.0 }, &["nmi", "nautical miles"]),
];

impl Unit {
    /// The unit with an EPSG code; `None` if no unit of length with this code is known.
    pub(super) fn of_code(code: u16) -> Option<Unit> {
        UNITS.iter().find(|(of, ..)| *of == Some(code)).map(|&(_, unit, _)| unit)
    }

    /// The unit with a name, in upper or lower case; `None` if the name is not known.
    pub(super) fn of_name(name: &str) -> Option<Unit> {
        let name = name.trim().to_lowercase();
        UNITS.iter().find(|(_, unit, names)| unit.name.to_lowercase() == name || names.contains(&name.as_str())).map(|&(_, unit, _)| unit)
    }

    /// Whether this is the metre.
    pub(super) fn is_metre(self) -> bool {
        self == METRE
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_found_by_code_and_by_name() {
        let survey_foot = Unit::of_code(9003).expect("known");
        assert!((survey_foot.metres - 0.304_800_609_6).abs() < 1e-10);
        assert_eq!(Unit::of_name(" US Survey Foot "), Some(survey_foot));
        assert_eq!(Unit::of_name("ftUS"), Some(survey_foot));
        assert_eq!(Unit::of_name("ft"), Unit::of_code(9002));
        assert_ne!(Unit::of_name("ft"), Some(survey_foot), "negative control: the two feet differ");
        assert!(Unit::of_name("M").is_some_and(Unit::is_metre) && Unit::of_code(9001).is_some_and(Unit::is_metre));
        assert_eq!((Unit::of_code(9102), Unit::of_name("fathom"), Unit::of_name("")), (None, None, None));
    }
}

//! Finds the conversion of stored samples to metres, from the statements of the file and of the user, and checks that these agree.

use super::depth::Depth;
use super::units::Unit;
use crate::decode::fault::Fault;

/// The statement of a file about its heights: height = (sample x scale + offset) x unit. Each part may be absent.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Statement {
    pub(super) scale: Option<f64>,
    pub(super) offset: Option<f64>,
    pub(super) unit: Option<Unit>,
}

/// The conversion of a sample to metres: sample x scale + offset.
#[derive(Debug, PartialEq)]
pub(super) struct Mapping {
    pub(super) scale: f64,
    pub(super) offset: f64,
    /// The conversion and where it comes from, in words.
    pub(super) how: String,
    /// A note for the user.
    pub(super) note: Option<String>,
}

/// Largest difference that counts as rounding between an elevation from the file and one from the user. It is relative to the larger of the two
/// absolute values. If both are below 1 m, it is in metres.
const SAME: f64 = 1e-6;

impl Statement {
    fn is_silent(&self) -> bool {
        *self == Statement::default()
    }

    /// Scale and offset of the conversion to metres.
    fn factors(&self) -> [f64; 2] {
        let metres = self.unit.map_or(1.0, |unit| unit.metres);
        [self.scale.unwrap_or(1.0) * metres, self.offset.unwrap_or(0.0) * metres]
    }

    fn words(&self) -> String {
        let mut parts = Vec::new();
        if let Some(scale) = self.scale {
            parts.push(format!("scale {scale}"));
        }
        if let Some(offset) = self.offset {
            parts.push(format!("offset {offset}"));
        }
        parts.push(match self.unit {
            Some(unit) if unit.is_metre() => "unit metre".to_owned(),
            Some(unit) => format!("unit {} ({} m)", unit.name, unit.metres),
            None => "no unit, so metres".to_owned(),
        });
        parts.join(", ")
    }
}

/// Returns the conversion to metres. `stored`: lowest and highest sample that has data. `range`: elevations of the smallest and largest
/// possible integer, or of the floats 0 and 1, metres.
///
/// # Errors
/// The meaning of integers is unknown; `range` contradicts the file, or does not apply to the samples.
pub(super) fn mapping(depth: Depth, statement: &Statement, stored: [f64; 2], range: Option<[f64; 2]>) -> Result<Mapping, Fault> {
    if statement.is_silent() {
        return match depth.limits() {
            Some(limits) => of_integers(depth, limits, range),
            None => of_floats(stored, range),
        };
    }
    let [scale, offset] = statement.factors();
    // The two samples whose elevations `range` gives.
    let ends = depth.limits().unwrap_or([0.0, 1.0]);
    if let Some(range) = range {
        let [low, high] = ends.map(|sample| sample * scale + offset);
        let agree = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs()).max(1.0);
        // A range equal to the limits of the integers does not change the samples, so it is accepted. The statement of the file is then applied.
        let keeps = !depth.is_float() && range == ends;
        let agrees = agree(range[0], low) && agree(range[1], high);
        if !(keeps || agrees) {
            return Err(Fault::Unsupported(format!(
                "--height-range {},{} contradicts the file, which says {}: {low} to {high} m; leave the option out",
                range[0],
                range[1],
                statement.words()
            )));
        }
    }
    let note = (scale < 0.0).then(|| "the scale of the file is negative: the largest sample is the lowest ground".to_owned());
    Ok(Mapping { scale, offset, how: format!("as the file states: {}", statement.words()), note })
}

fn of_integers(depth: Depth, [smallest, largest]: [f64; 2], range: Option<[f64; 2]>) -> Result<Mapping, Fault> {
    if depth.bits() > 16 {
        return Err(Fault::Unsupported(format!(
            "its samples are {}, and the file does not say what they mean (--height-range is for 16 bits); convert them to metres, for example from \
             millimetres with gdal_translate -ot Float32 -scale 0 1000 0 1 IN OUT.tif",
            depth.words()
        )));
    }
    let Some([low, high]) = range else {
        return Err(Fault::Unsupported(format!(
            "the elevations of its samples, {}, are unknown; give --height-range LOW,HIGH: the elevations, in metres, of the samples {smallest} and {largest} \
             ({smallest},{largest} if the samples are metres)",
            depth.words()
        )));
    };
    let scale = (high - low) / (largest - smallest);
    let how = format!("as given: {smallest} is {low} m, {largest} is {high} m");
    Ok(Mapping { scale, offset: low - smallest * scale, how, note: None })
}

fn of_floats([lowest, highest]: [f64; 2], range: Option<[f64; 2]>) -> Result<Mapping, Fault> {
    match range {
        None => Ok(Mapping { scale: 1.0, offset: 0.0, how: "floats, taken as metres: the file states no unit".to_owned(), note: None }),
        Some([low, high]) if lowest >= 0.0 && highest <= 1.0 => {
            Ok(Mapping { scale: high - low, offset: low, how: format!("as given: 0 is {low} m, 1 is {high} m"), note: None })
        }
        Some(_) => Err(Fault::Unsupported(format!(
            "--height-range does not apply: float samples are metres unless all lie in 0..1, but these are {lowest} to {highest}; leave the option out"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FEET: Statement = Statement { scale: None, offset: None, unit: Some(Unit { name: "foot", metres: 0.3048 }) };
    const DECIMETRES: Statement = Statement { scale: Some(0.1), offset: Some(500.0), unit: None };
    const SILENT: Statement = Statement { scale: None, offset: None, unit: None };
    const I16: [f64; 2] = [-32_768.0, 32_767.0];

    /// Elevation of a sample.
    fn metres(depth: Depth, statement: &Statement, range: Option<[f64; 2]>, sample: f64) -> f64 {
        let mapping = mapping(depth, statement, [0.0, 4000.0], range).unwrap_or_else(|fault| panic!("{fault}"));
        mapping.scale * sample + mapping.offset
    }

    fn refused(depth: Depth, statement: &Statement, range: Option<[f64; 2]>, words: &str) {
        let text = mapping(depth, statement, [300.0, 900.0], range).expect_err("refused").to_string();
        assert!(text.contains(words), "`{words}` is missing in: {text}");
    }

    #[test]
    fn what_the_file_says_is_applied() {
        for depth in [Depth::Signed16, Depth::Unsigned32, Depth::Single, Depth::Double] {
            assert!((metres(depth, &DECIMETRES, None, 4000.0) - 900.0).abs() < 1e-9, "{depth:?}");
            assert!((metres(depth, &FEET, None, 1000.0) - 304.8).abs() < 1e-9, "{depth:?}");
        }
        let both = Statement { unit: FEET.unit, ..DECIMETRES };
        assert!((metres(Depth::Signed16, &both, None, 4000.0) - 900.0 * 0.3048).abs() < 1e-9, "the unit applies to scaled samples");
        let turned = Statement { scale: Some(-1.0), ..SILENT };
        assert!((metres(Depth::Single, &turned, None, 30.0) + 30.0).abs() < 1e-9);
        assert!(mapping(Depth::Single, &turned, [0.0, 1.0], None).expect("usable").note.is_some_and(|note| note.contains("negative")));
    }

    #[test]
    fn a_range_may_repeat_the_file_but_not_contradict_it() {
        assert!(
            (metres(Depth::Signed16, &DECIMETRES, Some(I16), 4000.0) - 900.0).abs() < 1e-9,
            "samples as they are, then the file's scale"
        );
        assert!((metres(Depth::Signed16, &DECIMETRES, Some([-2776.8, 3776.7]), 4000.0) - 900.0).abs() < 1e-9);
        refused(Depth::Signed16, &DECIMETRES, Some([-3276.8, 3276.7]), "contradicts the file, which says scale 0.1, offset 500");
        refused(Depth::Signed16, &FEET, Some([0.0, 900.0]), "unit foot (0.3048 m)");
        refused(Depth::Single, &DECIMETRES, Some([300.0, 900.0]), "contradicts the file");
        refused(Depth::Single, &FEET, Some([0.0, 1.0]), "contradicts the file");
    }

    #[test]
    fn integers_need_a_meaning() {
        assert!((metres(Depth::Signed16, &SILENT, Some(I16), 355.0) - 355.0).abs() < 1e-12);
        assert!((metres(Depth::Signed16, &SILENT, Some([-3276.8, 3276.7]), 3550.0) - 355.0).abs() < 1e-9);
        assert!((metres(Depth::Unsigned16, &SILENT, Some([300.0, 900.0]), 65_535.0) - 900.0).abs() < 1e-9);
        refused(Depth::Unsigned16, &SILENT, None, "give --height-range LOW,HIGH");
        refused(Depth::Signed16, &SILENT, None, "(-32768,32767 if the samples are metres)");
        refused(Depth::Signed32, &SILENT, Some([0.0, 65_535.0]), "32-bit signed integers");
        refused(Depth::Unsigned32, &SILENT, None, "32-bit unsigned integers");
    }

    #[test]
    fn a_range_maps_floats_of_0_to_1_only() {
        let unit = mapping(Depth::Single, &SILENT, [0.0, 1.0], Some([300.0, 900.0])).expect("usable");
        assert!((unit.scale - 600.0).abs() < 1e-12 && (unit.offset - 300.0).abs() < 1e-12);
        assert!((metres(Depth::Half, &SILENT, None, 355.0) - 355.0).abs() < 1e-12);
        refused(Depth::Single, &SILENT, Some([300.0, 900.0]), "300 to 900");
        let below = mapping(Depth::Single, &SILENT, [-0.001, 0.5], Some([300.0, 900.0]));
        assert!(below.is_err());
    }
}

//! Chromaticities of red, green, blue and white, and the conversion of linear colours to the primaries of Rec. ITU-R BT.709.

use std::fmt;

use glam::{DMat3, DVec3};

/// CIE 1931 chromaticities x, y of the primaries and of white, as a file states them. They may form no colour space, or be NaN. `Display`
/// writes them like this: `R 0.64 0.33, G 0.3 0.6, B 0.15 0.06, white 0.3127 0.329`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chromaticities {
    /// Red primary.
    pub red: [f32; 2],
    /// Green primary.
    pub green: [f32; 2],
    /// Blue primary.
    pub blue: [f32; 2],
    /// White point: the colour of R = G = B.
    pub white: [f32; 2],
}

/// The matrix from XYZ to Bradford's cone responses. Lam 1985, *Metamerism and Colour Constancy*; ICC.1:2022, annex E.
const BRADFORD: DMat3 =
    DMat3::from_cols(DVec3::new(0.8951, -0.7502, 0.0389), DVec3::new(0.2664, 1.7135, -0.0685), DVec3::new(-0.1614, 0.0367, 1.0296));

/// Largest difference from a coordinate of Rec. 709 that counts as rounding. Programs round the coordinates differently. Other common colour
/// spaces differ by more.
const SAME: f32 = 1e-3;

impl Chromaticities {
    /// The chromaticities of Rec. ITU-R BT.709, which are also those of sRGB (IEC 61966-2-1).
    pub const REC_709: Chromaticities = Chromaticities { red: [0.64, 0.33], green: [0.3, 0.6], blue: [0.15, 0.06], white: [0.3127, 0.329] };

    /// Whether these are the chromaticities of Rec. 709, apart from rounding.
    pub fn is_rec_709(&self) -> bool {
        let all = |c: &Chromaticities| [c.red, c.green, c.blue, c.white];
        let mut pairs = all(self).into_iter().flatten().zip(all(&Chromaticities::REC_709).into_iter().flatten());
        pairs.all(|(a, b)| (a - b).abs() <= SAME)
    }

    /// The matrix that converts linear colours of these primaries to linear colours of Rec. 709 (SMPTE RP 177-1993). If the whites differ,
    /// they are adapted by Bradford's transform, so R = G = B stays R = G = B. `None` if the chromaticities form no colour space, for
    /// example because the primaries lie on one line, y of the white point is not above 0, or a number is NaN.
    pub fn to_rec_709(self) -> Option<DMat3> {
        if self.white[1] <= 0.0 {
            return None;
        }
        let target = Chromaticities::REC_709;
        let cones = |white: [f32; 2]| BRADFORD * xyz_of_white(white);
        let adaptation = BRADFORD.try_inverse()? * DMat3::from_diagonal(cones(target.white) / cones(self.white)) * BRADFORD;
        let matrix = target.to_xyz()?.try_inverse()? * adaptation * self.to_xyz()?;
        matrix.is_finite().then_some(matrix)
    }

    /// The matrix from RGB to XYZ, with Y = 1 for R = G = B = 1. `None` if the primaries lie on one line or are NaN.
    fn to_xyz(self) -> Option<DMat3> {
        let column = |[x, y]: [f32; 2]| DVec3::new(f64::from(x), f64::from(y), 1.0 - f64::from(x) - f64::from(y));
        let primaries = DMat3::from_cols(column(self.red), column(self.green), column(self.blue));
        Some(primaries * DMat3::from_diagonal(primaries.try_inverse()? * xyz_of_white(self.white)))
    }
}

/// XYZ of a white with Y = 1.
fn xyz_of_white([x, y]: [f32; 2]) -> DVec3 {
    let [x, y] = [f64::from(x), f64::from(y)];
    DVec3::new(x / y, 1.0, (1.0 - x - y) / y)
}

impl fmt::Display for Chromaticities {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Chromaticities { red, green, blue, white } = self;
        write!(f, "R {} {}, G {} {}, B {} {}, white {} {}", red[0], red[1], green[0], green[1], blue[0], blue[1], white[0], white[1])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AP1: Chromaticities =
        Chromaticities { red: [0.713, 0.293], green: [0.165, 0.83], blue: [0.128, 0.044], white: [0.32168, 0.33767] };

    #[test]
    fn acescg_becomes_rec_709_as_published() {
        let matrix = AP1.to_rec_709().expect("AP1 is a colour space");
        // The matrix from ACEScg to linear Rec. 709, with Bradford adaptation, as OpenColorIO's ACES 1.3 configuration has it; 6 decimals.
        let published = [[1.705_051, -0.621_792, -0.083_259], [-0.130_256, 1.140_805, -0.010_548], [-0.024_003, -0.128_969, 1.152_972]];
        for (row, expected) in published.iter().enumerate() {
            for (column, expected) in expected.iter().enumerate() {
                let found = matrix.row(row)[column];
                assert!((found - expected).abs() < 2e-5, "row {row}, column {column}: {found} is not {expected}");
            }
        }
        // White stays white, whatever the white point is.
        assert!((matrix * DVec3::ONE - DVec3::ONE).abs().max_element() < 1e-9);
    }

    #[test]
    fn rec_709_is_known_and_left_alone() {
        let rounded = Chromaticities { white: [0.31271, 0.32902], ..Chromaticities::REC_709 };
        assert!(Chromaticities::REC_709.is_rec_709() && rounded.is_rec_709() && !AP1.is_rec_709());
        let matrix = Chromaticities::REC_709.to_rec_709().expect("Rec. 709 is a colour space");
        assert!((matrix - DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-12), "{matrix}");
    }

    #[test]
    fn what_is_no_colour_space_has_no_matrix() {
        let on_a_line = Chromaticities { red: [0.1, 0.1], green: [0.25, 0.25], blue: [0.5, 0.5], ..AP1 };
        let dark_white = Chromaticities { white: [0.3, 0.0], ..AP1 };
        let nan = Chromaticities { green: [f32::NAN, 0.5], ..AP1 };
        for wrong in [on_a_line, dark_white, nan] {
            assert_eq!(wrong.to_rec_709(), None, "{wrong}");
            assert!(!wrong.is_rec_709());
        }
    }
}

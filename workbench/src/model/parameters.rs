//! The numbers of a scene that can be turned while it is drawn, by their keys in the scene file.

use kernels::scene::Scene;

/// One number.
pub struct Parameter {
    /// Its key in a scene, as experiments name it, too.
    pub key: &'static str,
    /// What it is called.
    pub name: &'static str,
    /// Its unit; empty = none.
    pub unit: &'static str,
    /// Smallest and largest value offered.
    pub range: [f64; 2],
    /// Whether the slider is logarithmic.
    pub logarithmic: bool,
    /// What it does.
    pub about: &'static str,
    /// Where it is.
    pub at: fn(&mut Scene) -> &mut f64,
}

/// Numbers that belong together.
pub struct Group {
    /// What they are called.
    pub name: &'static str,
    /// The numbers.
    pub parameters: &'static [Parameter],
}

macro_rules! parameter {
    ($table:ident . $field:ident, $name:literal, $unit:literal, $range:expr, $logarithmic:literal, $about:literal) => {
        Parameter {
            key: concat!(stringify!($table), ".", stringify!($field)),
            name: $name,
            unit: $unit,
            range: $range,
            logarithmic: $logarithmic,
            about: $about,
            at: |scene| &mut scene.$table.$field,
        }
    };
}

/// All of them. Ranges are those that make sense to look at; a scene file may go further.
pub const GROUPS: [Group; 3] = [
    Group {
        name: "Blend",
        parameters: &[
            parameter!(
                blend.hash_scale,
                "Noise cell",
                "px",
                [0.05, 8.0],
                true,
                "Size of the cells of hashed noise on the screen: larger flips less and clumps more."
            ),
            parameter!(
                blend.height_sharpness,
                "Height blend",
                "",
                [0.0, 64.0],
                false,
                "k in w' = w 2^(k h): how strongly the higher material wins. 0 is plain bilinear."
            ),
            parameter!(
                blend.triplanar_sharpness,
                "Tri-planar blend",
                "",
                [0.5, 32.0],
                true,
                "k in w = |n|^k: how sharply three projections meet."
            ),
            parameter!(
                blend.mip_bias,
                "LOD bias",
                "mip",
                [-4.0, 4.0],
                false,
                "Added to mip levels: below 0 is sharper and flickers, above 0 is blurrier."
            ),
        ],
    },
    Group {
        name: "Where flavours apply",
        parameters: &[
            parameter!(
                flavours.far_atlas_m,
                "Far atlas from",
                "m",
                [1.0, 5000.0],
                true,
                "Ground beyond this is shaded from the far atlas, nearer from the virtual texture."
            ),
            parameter!(
                flavours.cliff_near_m,
                "Far cliff from",
                "m",
                [1.0, 1000.0],
                true,
                "Cliffs nearer than this take near stochastic shading, beyond it far stochastic shading."
            ),
            parameter!(
                flavours.cliff_far_atlas_m,
                "Cliff far atlas from",
                "m",
                [10.0, 10_000.0],
                true,
                "Beyond this cliffs, too, are shaded from the far atlas."
            ),
            parameter!(
                flavours.distance_blend,
                "Distance blend",
                "x",
                [0.0, 1.0],
                false,
                "Width of every blend between distances, as a share of the distance."
            ),
            parameter!(flavours.cliff_slope_deg, "Cliffs above", "deg", [5.0, 90.0], false, "Slopes steeper than this are cliff."),
            parameter!(flavours.slope_blend_deg, "Slope blend", "deg", [0.0, 20.0], false, "Width of the blend between ground and cliff."),
            parameter!(
                flavours.splat_band_deg,
                "Splat band",
                "deg",
                [0.0, 30.0],
                false,
                "Width of the band below cliffs that takes full tri-planar splat. 0: none."
            ),
        ],
    },
    Group {
        name: "Light",
        parameters: &[
            parameter!(
                sun.azimuth_deg,
                "Sun from",
                "deg",
                [0.0, 360.0],
                false,
                "Compass bearing the light comes from, clockwise from north."
            ),
            parameter!(sun.elevation_deg, "Sun above", "deg", [0.5, 90.0], false, "Height of the sun above the horizon."),
        ],
    },
];

/// The numbers in which `own` differs from `other`, with both values.
pub fn differences(own: &Scene, other: &Scene) -> Vec<(&'static Parameter, [f64; 2])> {
    let (mut own, mut other) = (own.clone(), other.clone());
    let both = GROUPS.iter().flat_map(|g| g.parameters).map(|p| (p, [*(p.at)(&mut own), *(p.at)(&mut other)]));
    both.filter(|(_, [a, b])| a.to_bits() != b.to_bits()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_and_no_name_comes_twice() {
        let all: Vec<&Parameter> = GROUPS.iter().flat_map(|g| g.parameters).collect();
        for (i, a) in all.iter().enumerate() {
            assert!(all[..i].iter().all(|b| a.key != b.key && a.name != b.name), "{}", a.key);
        }
    }
}

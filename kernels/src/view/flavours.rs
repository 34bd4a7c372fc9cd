//! A scene's flavour rules, in the form that shaders read.

use crate::scene::FlavourRules;
use crate::shared::flavour_weights::FlavourParams;

impl FlavourParams {
    /// The parameters for a scene's rules. Slopes in degrees are converted to values of the normal's z. Two flavours that meet at a slope are blended
    /// over a band of `slope_blend_deg` degrees, centred at this slope.
    #[allow(clippy::cast_possible_truncation, reason = "shaders read f32")]
    pub fn new(rules: &FlavourRules) -> Self {
        let band = |slope_deg: f64| {
            let half = 0.5 * rules.slope_blend_deg.max(0.0);
            [slope_deg + half, slope_deg - half].map(|deg| deg.clamp(0.0, 180.0).to_radians().cos() as f32)
        };
        FlavourParams {
            far_atlas_m: rules.far_atlas_m as f32,
            cliff_far_atlas_m: rules.cliff_far_atlas_m as f32,
            cliff_near_m: rules.cliff_near_m as f32,
            distance_blend: rules.distance_blend as f32,
            cliff_cos: if rules.has_cliffs() { band(rules.cliff_slope_deg) } else { [-2.0, -1.0] },
            splat_cos: band(rules.cliff_slope_deg - rules.splat_band_deg),
            splat_enabled: u32::from(rules.splat_band_deg > 0.0 && rules.has_cliffs()),
            vt_enabled: u32::from(rules.far_atlas_m > 0.0),
            padding: [0; 2],
        }
    }
}

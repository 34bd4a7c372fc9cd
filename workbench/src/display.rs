//! From a picture's numbers to colours on the screen.

use experiments::judge::flip::magma;
use kernels::picture::{Layer as Values, Picture, srgb_code, tone_map};
use kernels::variant::Variant;
use rayon::prelude::*;

/// What the viewport shows of a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layer {
    /// Lit and tone-mapped.
    #[default]
    Lit,
    /// Linear albedo, as sRGB.
    Albedo,
    /// World normals: x, y, z from -1 to 1 as red, green, blue.
    Normal,
    /// Distance along the view direction, logarithmic.
    Depth,
    /// The flavours that each pixel needs.
    Mask,
    /// The variant that each tile runs.
    Tiles,
    /// Counted texture fetches.
    Fetches,
    /// The first random choice of each pixel.
    Choice,
}

/// Distances that the depth scale ends at, metres.
const DEPTHS_M: [f32; 2] = [1.0, 10_000.0];
/// Fetches that the scale ends at: full splat on two tilings.
const MOST_FETCHES: f32 = 96.0;
/// Colours of choices, which have no order: by turns around the circle of hues, neighbours far apart.
const CHOICES: [[u8; 3]; 8] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [204, 121, 167], [160, 160, 160]];

impl Layer {
    /// All of them, in the order of the menu.
    pub const ALL: [Layer; 8] =
        [Layer::Lit, Layer::Albedo, Layer::Normal, Layer::Depth, Layer::Mask, Layer::Tiles, Layer::Fetches, Layer::Choice];

    /// Its name in the menu.
    pub const fn name(self) -> &'static str {
        match self {
            Layer::Lit => "Lit",
            Layer::Albedo => "Albedo",
            Layer::Normal => "Normals",
            Layer::Depth => "Depth",
            Layer::Mask => "Flavours needed",
            Layer::Tiles => "Tiles by variant",
            Layer::Fetches => "Fetches",
            Layer::Choice => "Choices",
        }
    }

    /// What its colours mean.
    pub const fn legend(self) -> &'static str {
        match self {
            Layer::Lit => "linear radiance, Reinhard's curve, white at 4",
            Layer::Albedo => "linear albedo as sRGB",
            Layer::Normal => "x, y, z from -1 to 1 as red, green, blue",
            Layer::Depth => "1 m black to 10 km white, logarithmic",
            Layer::Mask => "flavours that a pixel needs; mixtures are means",
            Layer::Tiles => "variant that a tile runs; mixtures are means",
            Layer::Fetches => "0 black to 96 white texture fetches a pixel",
            Layer::Choice => "a colour a choice; black: no random choice",
        }
    }

    /// The layer of the renderer that it is made from; `None` = the picture itself.
    pub const fn aov(self) -> Option<&'static str> {
        match self {
            Layer::Lit => None,
            Layer::Albedo => Some("albedo"),
            Layer::Normal => Some("normal"),
            Layer::Depth => Some("depth"),
            Layer::Mask => Some("mask"),
            Layer::Tiles => Some("variant"),
            Layer::Fetches => Some("fetches"),
            Layer::Choice => Some("choice"),
        }
    }

    /// The colours of a picture that was made with this layer, row by row from the top. Where the layer is missing, the lit picture.
    pub fn colours(self, picture: &Picture) -> Vec<[u8; 3]> {
        let lit = |t: &[f32; 4]| tone_map([t[0], t[1], t[2]]);
        let scale = magma();
        let on_scale = |share: f32| scale[((share.clamp(0.0, 1.0) * 255.0) as usize).min(scale.len() - 1)];
        match (self, self.aov().and_then(|name| picture.layer(name))) {
            (Layer::Albedo, Some(Values::Rgb(texels))) => texels.par_iter().map(|t| t.map(srgb_code)).collect(),
            (Layer::Normal, Some(Values::Xyz(texels))) => {
                texels.par_iter().map(|t| t.map(|c| ((c * 0.5 + 0.5).clamp(0.0, 1.0) * 255.0) as u8)).collect()
            }
            (Layer::Depth, Some(Values::Value(metres))) => {
                let span = (DEPTHS_M[1] / DEPTHS_M[0]).ln();
                metres.par_iter().map(|&m| if m > 0.0 { on_scale((m / DEPTHS_M[0]).max(1.0).ln() / span) } else { [0; 3] }).collect()
            }
            (Layer::Mask | Layer::Tiles, Some(Values::Value(masks))) => {
                let colour = |(&mask, seen): (&f32, &[f32; 4])| {
                    let seen = lit(seen);
                    let Some(variant) = Variant::new(mask as u8) else { return seen };
                    let own = variant.colour();
                    std::array::from_fn(|k| own[k].midpoint(seen[k]))
                };
                masks.par_iter().zip(&picture.hdr).map(colour).collect()
            }
            (Layer::Fetches, Some(Values::Value(counts))) => counts.par_iter().map(|&n| on_scale(n / MOST_FETCHES)).collect(),
            (Layer::Choice, Some(Values::Value(choices))) => {
                choices.par_iter().map(|&c| if c > 0.0 { CHOICES[(c as usize - 1) % CHOICES.len()] } else { [0; 3] }).collect()
            }
            _ => picture.hdr.par_iter().map(lit).collect(),
        }
    }
}

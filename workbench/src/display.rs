//! From a picture's numbers to colours on the screen.

use experiments::judge::flip::magma;
use kernels::metrics::{Followed, Point};
use kernels::picture::{Layer as Values, Picture, srgb_code, tone_map};
use kernels::shared::signal::luminance;
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
    /// Standard deviation of luminance over the frames followed.
    Deviation,
    /// Mean absolute difference in luminance from frame to frame.
    Flicker,
    /// Share of choices that differ from the frame before.
    Flips,
    /// Mean difference in luminance from the picture compared with.
    Bias,
}

/// Distances that the depth scale ends at, metres.
const DEPTHS_M: [f32; 2] = [1.0, 10_000.0];
/// Fetches that the scale ends at: full splat on two tilings.
const MOST_FETCHES: f32 = 96.0;
/// Colours of choices, which have no order: by turns around the circle of hues, neighbours far apart.
const CHOICES: [[u8; 3]; 8] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [204, 121, 167], [160, 160, 160]];

/// Bias that the diverging scale ends at, luminance.
const LARGEST_BIAS: f32 = 0.1;
/// Differences that logarithmic scales begin at, luminance; they end at 1.
const SMALLEST_DIFFERENCE: f32 = 1e-3;

fn lit(texel: &[f32; 4]) -> [u8; 3] {
    tone_map([texel[0], texel[1], texel[2]])
}

fn on_scale(scale: &[[u8; 3]], share: f32) -> [u8; 3] {
    scale[((share.clamp(0.0, 1.0) * 255.0) as usize).min(scale.len() - 1)]
}

/// Place of a difference on a scale from [`SMALLEST_DIFFERENCE`] to 1.
fn logarithmic(difference: f32) -> f32 {
    1.0 - (difference.max(SMALLEST_DIFFERENCE).ln() / SMALLEST_DIFFERENCE.ln())
}

/// Blue below 0, grey at 0, orange above, as far apart for those who tell red and green with trouble; -1 to 1.
fn diverging(value: f32) -> [u8; 3] {
    const ENDS: [[f32; 3]; 3] = [[0.0, 114.0, 178.0], [70.0, 70.0, 70.0], [240.0, 160.0, 0.0]];
    let value = value.clamp(-1.0, 1.0);
    let end = if value < 0.0 { ENDS[0] } else { ENDS[2] };
    std::array::from_fn(|k| (ENDS[1][k] + (end[k] - ENDS[1][k]) * value.abs()) as u8)
}

/// How much the lit luminance of two pictures differs, on the logarithmic scale.
pub fn difference(a: &Picture, b: &Picture) -> Vec<[u8; 3]> {
    let scale = magma();
    let lit = |t: &[f32; 4]| luminance([t[0], t[1], t[2]]) as f32;
    let colour = |(a, b): (&[f32; 4], &[f32; 4])| on_scale(&scale, logarithmic((lit(a) - lit(b)).abs()));
    a.hdr.par_iter().zip(&b.hdr).map(colour).collect()
}

impl Layer {
    /// All of them, in the order of the menu.
    pub const ALL: [Layer; 12] = [
        Layer::Lit,
        Layer::Albedo,
        Layer::Normal,
        Layer::Depth,
        Layer::Mask,
        Layer::Tiles,
        Layer::Fetches,
        Layer::Choice,
        Layer::Deviation,
        Layer::Flicker,
        Layer::Flips,
        Layer::Bias,
    ];

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
            Layer::Deviation => "Deviation",
            Layer::Flicker => "Flicker",
            Layer::Flips => "Flips",
            Layer::Bias => "Bias",
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
            Layer::Deviation => "standard deviation of luminance over frames, 0.001 black to 1 white, logarithmic",
            Layer::Flicker => "mean |difference| in luminance to the frame before, 0.001 black to 1 white, logarithmic",
            Layer::Flips => "share of choices other than the frame before, 0 black to 1 white",
            Layer::Bias => "mean A - B, -0.1 blue, 0 grey, 0.1 orange; grey where B is not drawn",
        }
    }

    /// The layer of the renderer that it is made from; `None` = the picture itself.
    pub const fn aov(self) -> Option<&'static str> {
        match self {
            Layer::Lit | Layer::Deviation | Layer::Flicker | Layer::Flips | Layer::Bias => None,
            Layer::Albedo => Some("albedo"),
            Layer::Normal => Some("normal"),
            Layer::Depth => Some("depth"),
            Layer::Mask => Some("mask"),
            Layer::Tiles => Some("variant"),
            Layer::Fetches => Some("fetches"),
            Layer::Choice => Some("choice"),
        }
    }

    /// What is shown of B: nothing is measured of it against another picture, so that in place of its bias there is the picture.
    pub fn of_second(self) -> Layer {
        if self == Layer::Bias { Layer::Lit } else { self }
    }

    /// Whether it shows what live metrics follow.
    pub const fn is_measured(self) -> bool {
        matches!(self, Layer::Deviation | Layer::Flicker | Layer::Flips | Layer::Bias)
    }

    /// The colours of what was followed, over a darkened picture where there is no terrain or nothing to say yet.
    fn measured(self, picture: &Picture, followed: &Followed) -> Vec<[u8; 3]> {
        let scale = magma();
        let colour = |(point, seen): (&Point, &[f32; 4])| {
            let value = match self {
                Layer::Deviation => (point.frames > 1.0).then(|| logarithmic(point.variance.max(0.0).sqrt())),
                Layer::Flicker => (point.frames > 1.0).then(|| logarithmic(point.flicker)),
                Layer::Flips => (point.chosen > 0.0).then_some(point.flips),
                _ => return if point.frames > 0.0 { diverging(point.bias / LARGEST_BIAS) } else { lit(seen).map(|c| c / 3) },
            };
            value.map_or_else(|| lit(seen).map(|c| c / 3), |share| on_scale(&scale, share))
        };
        followed.points().par_iter().zip(&picture.hdr).map(colour).collect()
    }

    /// The colours of a picture that was made with this layer, row by row from the top. Where the layer is missing, the lit picture.
    pub fn colours(self, picture: &Picture, followed: &Followed) -> Vec<[u8; 3]> {
        if self.is_measured() && followed.points().len() == picture.hdr.len() {
            return self.measured(picture, followed);
        }
        let scale = magma();
        let on_scale = |share: f32| on_scale(&scale, share);
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

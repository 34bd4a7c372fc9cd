//! Colours for the values of a picture, and legends for them. Pictures and legends use the same [`Scale`]s, so that they agree.

use std::sync::LazyLock;

use experiments::judge::flip::magma;
use kernels::base::colour::srgb_code;
use kernels::culling::LOG2_LARGEST_STRIDE;
use kernels::display::Exposure;
use kernels::frame::picture::{Layer as Values, Picture};
use kernels::metrics::{Followed, Point};
use kernels::shared::signal::luminance;
use kernels::variant::Variant;
use kernels::world::LODS;
use rayon::prelude::*;

/// The quantity of a picture that the viewport shows as colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Layer {
    /// Lit and tone-mapped.
    #[default]
    Lit,
    /// Linear albedo, encoded as sRGB for display.
    Albedo,
    /// World normals: x, y, z from -1 to 1 as red, green, blue.
    Normal,
    /// Distance along the view direction, logarithmic.
    Depth,
    /// The flavours that each pixel needs.
    Mask,
    /// The flavours with which each tile is shaded.
    Tiles,
    /// Counted texture fetches.
    Fetches,
    /// The first random choice of each pixel.
    Choice,
    /// The LOD of the terrain node in each pixel.
    Lod,
    /// The vertex stride of the patch in each pixel.
    Stride,
    /// Standard deviation of the luminance of albedo over frames, for the surface point in each pixel.
    Deviation,
    /// Mean absolute difference in luminance of albedo from frame to frame.
    Flicker,
    /// Share of random choices that differ from those in the previous frame.
    Flips,
    /// Mean of A - B in luminance of albedo over frames.
    Bias,
    /// Mean absolute change of A - B in luminance of albedo from frame to frame.
    Residual,
}

/// The mapping of a value to a colour, in the picture and on the bar of the legend.
#[derive(Debug, PartialEq)]
pub struct Scale {
    /// The name of the quantity.
    pub name: &'static str,
    colours: Colours,
    /// Values at the ends of the bar. Values beyond them are clamped.
    ends: [f32; 2],
    logarithmic: bool,
    /// Values that are marked on the bar, and their labels.
    pub ticks: &'static [(f32, &'static str)],
}

/// The colours along a bar.
#[derive(Debug, PartialEq)]
enum Colours {
    /// From black to pale yellow, perceptually uniform.
    Magma,
    /// From blue through grey to orange.
    Diverging,
    /// From black to red (0), green (1) or blue (2).
    Channel(usize),
}

impl Scale {
    /// Position of a value on the bar, from 0 at the left to 1 at the right.
    pub fn place(&self, value: f32) -> f32 {
        let [low, high] = self.ends;
        let place = if self.logarithmic { (value.max(low) / low).ln() / (high / low).ln() } else { (value - low) / (high - low) };
        place.clamp(0.0, 1.0)
    }

    /// The colour at a position on the bar, sRGB.
    pub fn at(&self, place: f32) -> [u8; 3] {
        match self.colours {
            Colours::Magma => MAGMA[((place.clamp(0.0, 1.0) * 255.0) as usize).min(MAGMA.len() - 1)],
            Colours::Diverging => diverging(2.0 * place - 1.0),
            Colours::Channel(channel) => {
                let mut colour = [0; 3];
                colour[channel] = (place.clamp(0.0, 1.0) * 255.0) as u8;
                colour
            }
        }
    }

    /// The colour of a value, sRGB.
    pub fn colour(&self, value: f32) -> [u8; 3] {
        self.at(self.place(value))
    }
}

static MAGMA: LazyLock<Vec<[u8; 3]>> = LazyLock::new(magma);

/// Depth, metres.
static DEPTH: [Scale; 1] = [Scale {
    name: "distance along the view direction",
    colours: Colours::Magma,
    ends: [1.0, 10_000.0],
    logarithmic: true,
    ticks: &[(1.0, "1 m"), (10.0, "10 m"), (100.0, "100 m"), (1000.0, "1 km"), (10_000.0, "10 km")],
}];
/// Texture fetches. The bar ends at 96, the number that `fc5` takes for full splat with two tilings. Larger numbers have the last colour.
static FETCHES: [Scale; 1] = [Scale {
    name: "texture fetches per pixel",
    colours: Colours::Magma,
    ends: [0.0, 96.0],
    logarithmic: false,
    ticks: &[(0.0, "0"), (24.0, "24"), (48.0, "48"), (72.0, "72"), (96.0, "96")],
}];
static NORMAL: [Scale; 3] = [
    Scale { name: "x, east", colours: Colours::Channel(0), ends: [-1.0, 1.0], logarithmic: false, ticks: COMPONENTS },
    Scale { name: "y, north", colours: Colours::Channel(1), ends: [-1.0, 1.0], logarithmic: false, ticks: COMPONENTS },
    Scale { name: "z, up", colours: Colours::Channel(2), ends: [-1.0, 1.0], logarithmic: false, ticks: COMPONENTS },
];
const COMPONENTS: &[(f32, &str)] = &[(-1.0, "-1"), (0.0, "0"), (1.0, "1")];
static DEVIATION: [Scale; 1] =
    [Scale { name: "standard deviation of luminance", colours: Colours::Magma, ends: [1e-3, 1.0], logarithmic: true, ticks: LUMINANCES }];
static FLICKER: [Scale; 1] = [Scale {
    name: "mean |difference| in luminance from frame to frame",
    colours: Colours::Magma,
    ends: [1e-3, 1.0],
    logarithmic: true,
    ticks: LUMINANCES,
}];
static RESIDUAL: [Scale; 1] = [Scale {
    name: "mean |change of A - B| in luminance from frame to frame",
    colours: Colours::Magma,
    ends: [1e-3, 1.0],
    logarithmic: true,
    ticks: LUMINANCES,
}];
static DIFFERENCE: [Scale; 1] =
    [Scale { name: "|A - B| in luminance", colours: Colours::Magma, ends: [1e-3, 1.0], logarithmic: true, ticks: LUMINANCES }];
const LUMINANCES: &[(f32, &str)] = &[(1e-3, "0.001"), (0.01, "0.01"), (0.1, "0.1"), (1.0, "1")];
static FLIPS: [Scale; 1] = [Scale {
    name: "share of choices that differ from those in the previous frame",
    colours: Colours::Magma,
    ends: [0.0, 1.0],
    logarithmic: false,
    ticks: &[(0.0, "0"), (0.25, "0.25"), (0.5, "0.5"), (0.75, "0.75"), (1.0, "1")],
}];
static BIAS: [Scale; 1] = [Scale {
    name: "mean A - B in luminance",
    colours: Colours::Diverging,
    ends: [-0.1, 0.1],
    logarithmic: false,
    ticks: &[(-0.1, "-0.1"), (0.0, "0"), (0.1, "0.1")],
}];

/// Colours of random choices. There are more choices than colours, so the colours repeat. Choices have no order, so neighbouring colours have very
/// different hues. LODs and vertex strides have the first of these colours.
const CHOICES: [[u8; 3]; 8] =
    [[230, 159, 0], [86, 180, 233], [0, 158, 115], [240, 228, 66], [0, 114, 178], [213, 94, 0], [204, 121, 167], [160, 160, 160]];
/// Names of the vertex strides 1, 2, 4, 8 and 16, to follow the word `every`.
const ORDINALS: [&str; 5] = ["vertex", "2nd vertex", "4th vertex", "8th vertex", "16th vertex"];
/// The largest value of the layer `choice`. The values from 1 on are the combinations of four splat texels and three projection axes.
const MOST_CHOICES: usize = 12;

/// The meanings of the colours of a picture.
#[derive(Clone, Debug, PartialEq)]
pub enum Legend {
    /// The text [`Layer::legend`], because neither bars nor swatches apply.
    Words,
    /// One bar for each component of the value: three for a normal, one for a number.
    Bars(&'static [Scale]),
    /// One colour for each meaning.
    Swatches(Vec<Swatch>),
}

/// A colour with its meaning.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Swatch {
    /// The colour: sRGB-encoded, 8 bits per channel.
    pub colour: [u8; 3],
    /// The meaning of the colour.
    pub name: String,
}

/// Blue below 0, grey at 0, orange above 0, for values from -1 to 1. These colours can also be distinguished with red-green colour blindness.
fn diverging(value: f32) -> [u8; 3] {
    const ENDS: [[f32; 3]; 3] = [[0.0, 114.0, 178.0], [70.0, 70.0, 70.0], [240.0, 160.0, 0.0]];
    let value = value.clamp(-1.0, 1.0);
    let end = if value < 0.0 { ENDS[0] } else { ENDS[2] };
    std::array::from_fn(|k| (ENDS[1][k] + (end[k] - ENDS[1][k]) * value.abs()) as u8)
}

/// The absolute difference in lit luminance of two pictures, in the colours of [`difference_legend`].
pub fn difference(a: &Picture, b: &Picture) -> Vec<[u8; 3]> {
    let lit = |t: &[f32; 4]| luminance([t[0], t[1], t[2]]) as f32;
    let colour = |(a, b): (&[f32; 4], &[f32; 4])| DIFFERENCE[0].colour((lit(a) - lit(b)).abs());
    a.hdr.par_iter().zip(&b.hdr).map(colour).collect()
}

/// Returns the meanings of the colours of a difference.
pub fn difference_legend() -> Legend {
    Legend::Bars(&DIFFERENCE)
}

/// The colour of a value of the layer `choice`; black = there was no random choice.
fn choice(code: f32) -> [u8; 3] {
    if code >= 1.0 { CHOICES[(code as usize - 1) % CHOICES.len()] } else { [0; 3] }
}

/// The set of flavours in the mask of a pixel or tile; `None` = the set is empty.
fn flavours(mask: f32) -> Option<Variant> {
    Variant::new(mask as u8)
}

/// The sets of flavours that occur, in the order of their masks.
fn occurring(masks: &[f32]) -> Vec<Variant> {
    let bit = |mask: &f32| flavours(*mask).map_or(0, |variant| 1_u32 << variant.mask());
    let seen = masks.par_iter().map(bit).reduce(|| 0, |a, b| a | b);
    Variant::all().filter(|variant| seen >> variant.mask() & 1 == 1).collect()
}

impl Layer {
    /// All layers, in the order of the menu.
    pub const ALL: [Layer; 15] = [
        Layer::Lit,
        Layer::Albedo,
        Layer::Normal,
        Layer::Depth,
        Layer::Mask,
        Layer::Tiles,
        Layer::Fetches,
        Layer::Choice,
        Layer::Lod,
        Layer::Stride,
        Layer::Deviation,
        Layer::Flicker,
        Layer::Flips,
        Layer::Bias,
        Layer::Residual,
    ];

    /// Returns the name of the layer in the menu.
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
            Layer::Lod => "LODs",
            Layer::Stride => "Vertex strides",
            Layer::Deviation => "Deviation",
            Layer::Flicker => "Flicker",
            Layer::Flips => "Flips",
            Layer::Bias => "Bias",
            Layer::Residual => "Residual",
        }
    }

    /// Returns a text that explains the colours of the layer.
    pub const fn legend(self) -> &'static str {
        match self {
            Layer::Lit => "linear radiance, exposed and tone-mapped as set in Parameters",
            Layer::Albedo => "linear albedo, encoded as sRGB",
            Layer::Normal => "normal with normal maps applied: x (east), y (north), z (up) from -1 to 1 as red, green, blue",
            Layer::Depth => "distance along the view direction, from 1 m (black) to 10 km (pale yellow), logarithmic; black = sky",
            Layer::Mask => {
                "flavours that a pixel needs; a set of flavours has their mean colour; in the picture, colours are mixed half and half with the \
                 lit picture"
            }
            Layer::Tiles => {
                "variant that a tile runs; a set of flavours has their mean colour; in the picture, colours are mixed half and half with the lit \
                 picture"
            }
            Layer::Fetches => "texture fetches per pixel, from 0 (black) to 96 or more (pale yellow)",
            Layer::Choice => {
                "first random choice of a pixel: 1 + splat texel (0 to 3) + 4 x projection (0 to 2; 0 if the projection is not chosen at random); \
                 8 colours for 12 choices; black = no random choice"
            }
            Layer::Lod => {
                "LOD of the terrain node, from 0 (fine) to 5 (coarse); in the picture, colours are mixed half and half with the lit picture"
            }
            Layer::Stride => {
                "vertex stride of the patch: with a stride of n, every n-th vertex along the side of a patch is drawn; in the picture, colours \
                 are mixed half and half with the lit picture"
            }
            Layer::Deviation => {
                "standard deviation of the luminance of albedo over frames, from 0.001 (black) to 1 (pale yellow), logarithmic; pixels without a \
                 value show the lit picture, darkened"
            }
            Layer::Flicker => {
                "mean |change| in luminance of albedo since the previous frame, from 0.001 (black) to 1 (pale yellow), logarithmic; pixels \
                 without a value show the lit picture, darkened"
            }
            Layer::Flips => {
                "share of choices that differ from those in the previous frame, from 0 (black) to 1 (pale yellow); pixels without a value show \
                 the lit picture, darkened"
            }
            Layer::Bias => {
                "mean A - B in luminance of albedo over frames, from -0.1 (blue) through 0 (grey, also if B is not drawn) to 0.1 (orange); pixels \
                 without a value show the lit picture, darkened"
            }
            Layer::Residual => {
                "mean |change of A - B| in luminance of albedo since the previous frame, from 0.001 (black, also if B is not drawn) to 1 (pale \
                 yellow), logarithmic; pixels without a value show the lit picture, darkened"
            }
        }
    }

    /// The layer of the renderer that this layer shows; `None` = it is computed from the lit picture or from the live metrics.
    pub const fn aov(self) -> Option<&'static str> {
        match self {
            Layer::Lit | Layer::Deviation | Layer::Flicker | Layer::Flips | Layer::Bias | Layer::Residual => None,
            Layer::Albedo => Some("albedo"),
            Layer::Normal => Some("normal"),
            Layer::Depth => Some("depth"),
            Layer::Mask => Some("mask"),
            Layer::Tiles => Some("variant"),
            Layer::Fetches => Some("fetches"),
            Layer::Choice => Some("choice"),
            Layer::Lod => Some("lod"),
            Layer::Stride => Some("stride"),
        }
    }

    /// The layer to show for B. B has neither bias nor residual, because it is not compared with another picture; the lit picture is shown
    /// instead.
    pub fn of_second(self) -> Layer {
        if matches!(self, Layer::Bias | Layer::Residual) { Layer::Lit } else { self }
    }

    /// Whether the layer shows a live metric.
    pub const fn is_measured(self) -> bool {
        matches!(self, Layer::Deviation | Layer::Flicker | Layer::Flips | Layer::Bias | Layer::Residual)
    }

    /// The scales of the values of this layer; empty = the values are colours, or codes without an order.
    fn scales(self) -> &'static [Scale] {
        match self {
            Layer::Normal => &NORMAL,
            Layer::Depth => &DEPTH,
            Layer::Fetches => &FETCHES,
            Layer::Deviation => &DEVIATION,
            Layer::Flicker => &FLICKER,
            Layer::Flips => &FLIPS,
            Layer::Bias => &BIAS,
            Layer::Residual => &RESIDUAL,
            Layer::Lit | Layer::Albedo | Layer::Mask | Layer::Tiles | Layer::Choice | Layer::Lod | Layer::Stride => &[],
        }
    }

    /// The legend for a picture that was drawn with this layer.
    pub fn legend_for(self, picture: &Picture) -> Legend {
        let swatches = match (self, self.aov().and_then(|name| picture.layer(name))) {
            (Layer::Mask | Layer::Tiles, Some(Values::Value(masks))) => {
                let swatch = |variant: Variant| Swatch { colour: variant.colour(), name: format!("{variant} ({})", variant.mask()) };
                occurring(masks).into_iter().map(swatch).collect()
            }
            (Layer::Choice, Some(Values::Value(_))) => {
                let none = Swatch { colour: choice(0.0), name: "none".to_owned() };
                let some = (1..=CHOICES.len()).map(|code| {
                    let also = code + CHOICES.len();
                    let name = if also <= MOST_CHOICES { format!("{code}, {also}") } else { code.to_string() };
                    Swatch { colour: choice(code as f32), name }
                });
                std::iter::once(none).chain(some).collect()
            }
            (Layer::Lod, Some(Values::Value(_))) => {
                (0..LODS).map(|lod| Swatch { colour: CHOICES[usize::from(lod)], name: format!("LOD {lod}") }).collect()
            }
            (Layer::Stride, Some(Values::Value(_))) => (0..=LOG2_LARGEST_STRIDE)
                .map(|log2| Swatch { colour: CHOICES[log2 as usize], name: format!("every {}", ORDINALS[log2 as usize]) })
                .collect(),
            _ => Vec::new(),
        };
        match (self.scales(), swatches.is_empty()) {
            ([], true) => Legend::Words,
            ([], false) => Legend::Swatches(swatches),
            (scales, _) => Legend::Bars(scales),
        }
    }

    /// The colours of a live metric. A pixel that shows no terrain, or has no value yet, shows the lit picture, darkened.
    fn measured(self, picture: &Picture, followed: &Followed) -> Vec<[u8; 3]> {
        let colour = |(point, seen): (&Point, &[u8; 3])| {
            let value = match self {
                Layer::Deviation => (point.frames > 1.0).then(|| point.variance.max(0.0).sqrt()),
                Layer::Flicker => (point.frames > 1.0).then_some(point.flicker),
                Layer::Flips => (point.chosen > 0.0).then_some(point.flips),
                Layer::Residual => (point.frames > 1.0).then_some(point.residual),
                _ => (point.frames > 0.0).then_some(point.bias),
            };
            match (value, self.scales()) {
                (Some(value), [scale]) => scale.colour(value),
                _ => seen.map(|c| c / 3),
            }
        };
        followed.points().par_iter().zip(&picture.displayed(Exposure::default())).map(colour).collect()
    }

    /// The colours of a picture that was drawn with this layer, row by row from the top. If the picture does not have the layer, the colours of the
    /// lit picture are returned.
    pub fn colours(self, picture: &Picture, followed: &Followed) -> Vec<[u8; 3]> {
        if self.is_measured() && followed.points().len() == picture.hdr.len() {
            return self.measured(picture, followed);
        }
        match (self, self.aov().and_then(|name| picture.layer(name))) {
            (Layer::Albedo, Some(Values::Rgb(texels))) => texels.par_iter().map(|t| t.map(srgb_code)).collect(),
            (Layer::Normal, Some(Values::Xyz(texels))) => {
                let colour = |texel: &[f32; 3]| std::array::from_fn(|k| NORMAL[k].colour(texel[k])[k]);
                texels.par_iter().map(colour).collect()
            }
            (Layer::Depth, Some(Values::Value(metres))) => {
                metres.par_iter().map(|&m| if m > 0.0 { DEPTH[0].colour(m) } else { [0; 3] }).collect()
            }
            (Layer::Mask | Layer::Tiles, Some(Values::Value(masks))) => {
                let colour = |(&mask, &seen): (&f32, &[u8; 3])| {
                    let Some(variant) = flavours(mask) else { return seen };
                    let own = variant.colour();
                    std::array::from_fn(|k| own[k].midpoint(seen[k]))
                };
                masks.par_iter().zip(&picture.displayed(Exposure::default())).map(colour).collect()
            }
            (Layer::Lod | Layer::Stride, Some(Values::Value(values))) => {
                // The index of a swatch is the LOD itself, or log2 of the stride.
                let swatch = |value: f32| match self {
                    Layer::Lod => (value >= 0.0).then_some(value as usize),
                    _ => (value >= 1.0).then(|| value.log2() as usize),
                };
                let colour = |(&value, &seen): (&f32, &[u8; 3])| match swatch(value).and_then(|number| CHOICES.get(number)) {
                    Some(own) => std::array::from_fn(|k| own[k].midpoint(seen[k])),
                    None => seen,
                };
                values.par_iter().zip(&picture.displayed(Exposure::default())).map(colour).collect()
            }
            (Layer::Fetches, Some(Values::Value(counts))) => counts.par_iter().map(|&n| FETCHES[0].colour(n)).collect(),
            (Layer::Choice, Some(Values::Value(choices))) => choices.par_iter().map(|&code| choice(code)).collect(),
            _ => picture.displayed(Exposure::default()),
        }
    }
}

#[cfg(test)]
mod tests {
    use kernels::frame::FrameReport;
    use kernels::metrics::Sample;

    use super::*;

    /// A picture of a single row of pixels of grey terrain, with one layer.
    fn picture(name: &str, values: Values, pixels: usize) -> Picture {
        let width = u32::try_from(pixels).expect("few");
        Picture {
            size: [width, 1],
            hdr: vec![[0.2, 0.2, 0.2, 1.0]; pixels],
            displayed: None,
            layers: vec![(name.to_owned(), values)],
            passes: Vec::new(),
            fetches_per_px: None,
            report: FrameReport::default(),
        }
    }

    fn bars(legend: &Legend) -> &'static [Scale] {
        match legend {
            Legend::Bars(scales) => scales,
            other => panic!("no bars: {other:?}"),
        }
    }

    /// Colours of the bar at its ticks.
    fn at_ticks(scale: &Scale) -> Vec<[u8; 3]> {
        scale.ticks.iter().map(|(value, _)| scale.at(scale.place(*value))).collect()
    }

    fn values(scale: &Scale) -> Vec<f32> {
        scale.ticks.iter().map(|(value, _)| *value).collect()
    }

    #[test]
    fn a_pixel_has_the_colour_that_the_bar_has_at_its_value() {
        for (layer, name) in [(Layer::Depth, "depth"), (Layer::Fetches, "fetches")] {
            let scale = &layer.scales()[0];
            let picture = picture(name, Values::Value(values(scale)), scale.ticks.len());
            assert_eq!(layer.colours(&picture, &Followed::default()), at_ticks(scale), "{}", layer.name());
            assert_eq!(bars(&layer.legend_for(&picture)), layer.scales());
        }
        // A normal has three bars, one per component.
        let components = values(&NORMAL[0]);
        let normals: Vec<[f32; 3]> = components.iter().map(|&c| [c, -c, 0.5 * c]).collect();
        let picture = picture("normal", Values::Xyz(normals.clone()), normals.len());
        let expected: Vec<[u8; 3]> = normals.iter().map(|n| std::array::from_fn(|k| NORMAL[k].at(NORMAL[k].place(n[k]))[k])).collect();
        assert_eq!(Layer::Normal.colours(&picture, &Followed::default()), expected);
        assert_eq!(bars(&Layer::Normal.legend_for(&picture)).len(), 3);
        assert_eq!((expected[0], expected[2]), ([0, 255, 63], [255, 0, 191]));
    }

    #[test]
    fn what_is_measured_has_the_colours_of_its_bar() {
        // There is one pixel per tick. In each pixel, the second frame is brighter than the first by the value of its tick. This difference is the
        // flicker, and half of it is the standard deviation.
        let ticks = values(&FLICKER[0]);
        let count = u32::try_from(ticks.len()).expect("few");
        let links: Vec<u32> = (0..count).collect();
        let sample = |luminance: f32, error: f32| Sample { luminance, choice: 1, error };
        let mut followed = Followed::default();
        // The error falls by the value of the same tick, so the residual equals the flicker.
        let second: Vec<Sample> = ticks.iter().map(|&tick| sample(tick, 0.1 - tick)).collect();
        for samples in [vec![sample(0.0, 0.1); ticks.len()], second] {
            followed.take([count, 1], &samples, &links, 8, true);
        }
        let picture = picture("albedo", Values::Rgb(Vec::new()), ticks.len());
        let of = |layer: Layer| layer.colours(&picture, &followed);
        let points = followed.points();
        let along = |scale: &Scale, value: fn(&Point) -> f32| points.iter().map(|p| scale.at(scale.place(value(p)))).collect::<Vec<_>>();
        assert_eq!(of(Layer::Flicker), along(&FLICKER[0], |p| p.flicker));
        assert_eq!(of(Layer::Deviation), along(&DEVIATION[0], |p| p.variance.sqrt()));
        assert_eq!(of(Layer::Flips), along(&FLIPS[0], |p| p.flips));
        assert_eq!(of(Layer::Bias), along(&BIAS[0], |p| p.bias));
        assert_eq!(of(Layer::Residual), along(&RESIDUAL[0], |p| p.residual));
        assert!((points[2].residual - ticks[2]).abs() < 1e-6);
        assert!((points[2].flicker - ticks[2]).abs() < 1e-6 && (points[2].variance.sqrt() - ticks[2] / 2.0).abs() < 1e-6);
        for layer in Layer::ALL.into_iter().filter(|layer| layer.is_measured()) {
            assert_eq!(bars(&layer.legend_for(&picture)), layer.scales());
        }
    }

    #[test]
    fn a_difference_has_the_colours_of_its_bar() {
        let scale = &DIFFERENCE[0];
        let a = picture("albedo", Values::Rgb(Vec::new()), scale.ticks.len());
        let mut b = a.clone();
        for (texel, (value, _)) in b.hdr.iter_mut().zip(scale.ticks) {
            *texel = [0.2 + value, 0.2 + value, 0.2 + value, 1.0];
        }
        // The bar has 256 colours. Rounding may give a value the colour next to its own.
        for (colour, (value, _)) in difference(&a, &b).into_iter().zip(scale.ticks) {
            let beside = [-1.0, 0.0, 1.0].map(|step| scale.at(scale.place(*value) + step / 255.0));
            assert!(beside.contains(&colour), "{colour:?} at {value} is none of {beside:?}");
        }
        assert_eq!(difference_legend(), Legend::Bars(&DIFFERENCE));
    }

    #[test]
    fn ticks_lie_on_their_bar_in_order_and_colours_tell_them_apart() {
        let all = Layer::ALL.into_iter().flat_map(Layer::scales).chain(&DIFFERENCE);
        for scale in all {
            let places: Vec<f32> = values(scale).into_iter().map(|value| scale.place(value)).collect();
            assert!(places.len() >= 3 && places.windows(2).all(|pair| pair[0] + 0.1 < pair[1]), "{}: {places:?}", scale.name);
            let ends = [places[0], places[places.len() - 1]];
            assert!(ends[0].abs() < 1e-6 && (ends[1] - 1.0).abs() < 1e-6, "{}: {places:?}", scale.name);
            assert!(at_ticks(scale).windows(2).all(|pair| pair[0] != pair[1]), "{}", scale.name);
            // Values beyond the ends are clamped. NaN must not cause a panic.
            assert_eq!(scale.colour(f32::MAX), scale.at(1.0), "{}", scale.name);
            assert_eq!(scale.colour(f32::MIN), scale.at(0.0), "{}", scale.name);
            let _ = scale.colour(f32::NAN);
        }
        assert!((DEPTH[0].place(100.0) - 0.5).abs() < 1e-6 && (BIAS[0].place(0.0) - 0.5).abs() < 1e-6);
        assert_eq!(BIAS[0].colour(0.0), diverging(0.0));
    }

    #[test]
    fn swatches_are_what_occurs_in_the_colours_that_it_has() {
        let masks = vec![16.0, 0.0, 3.0, 16.0, 1.0];
        for (layer, name) in [(Layer::Mask, "mask"), (Layer::Tiles, "variant")] {
            let picture = picture(name, Values::Value(masks.clone()), masks.len());
            let Legend::Swatches(swatches) = layer.legend_for(&picture) else { panic!("no swatches") };
            let names: Vec<&str> = swatches.iter().map(|swatch| swatch.name.as_str()).collect();
            assert_eq!(names, ["vt (1)", "vt+far-atlas (3)", "splat (16)"]);
            // The colour of a pixel is halfway between the colour of its swatch and the lit picture.
            let seen = picture.displayed(Exposure::default())[0];
            let colours = layer.colours(&picture, &Followed::default());
            let mixed = |swatch: &Swatch| std::array::from_fn(|k| swatch.colour[k].midpoint(seen[k]));
            assert_eq!(colours, [mixed(&swatches[2]), seen, mixed(&swatches[1]), mixed(&swatches[2]), mixed(&swatches[0])]);
        }
        let codes: Vec<f32> = (0..=8_u8).map(f32::from).collect();
        let picture = picture("choice", Values::Value(codes.clone()), codes.len());
        let Legend::Swatches(swatches) = Layer::Choice.legend_for(&picture) else { panic!("no swatches") };
        let colours: Vec<[u8; 3]> = swatches.iter().map(|swatch| swatch.colour).collect();
        assert_eq!(Layer::Choice.colours(&picture, &Followed::default()), colours);
        assert_eq!((swatches[0].name.as_str(), swatches[1].name.as_str(), swatches[8].name.as_str()), ("none", "1, 9", "8"));
        // Neither sky (-1, or stride 0) nor an unknown number has a swatch.
        for (layer, name, values, names) in [
            (Layer::Lod, "lod", vec![0.0, 5.0, -1.0], ["LOD 0", "LOD 5"]),
            (Layer::Stride, "stride", vec![1.0, 16.0, 0.0], ["every vertex", "every 16th vertex"]),
        ] {
            let picture = self::picture(name, Values::Value(values), 3);
            let Legend::Swatches(swatches) = layer.legend_for(&picture) else { panic!("no swatches") };
            let ends = [&swatches[0], &swatches[swatches.len() - 1]];
            assert_eq!(ends.map(|swatch| swatch.name.as_str()), names);
            let seen = picture.displayed(Exposure::default())[0];
            let mixed = ends.map(|swatch| std::array::from_fn(|k| swatch.colour[k].midpoint(seen[k])));
            assert_eq!(layer.colours(&picture, &Followed::default()), [mixed[0], mixed[1], seen]);
        }
        // Layers without bars and swatches have a text as legend. So does a layer with swatches that the picture does not have.
        for layer in [Layer::Lit, Layer::Albedo, Layer::Mask] {
            assert_eq!(layer.legend_for(&picture), Legend::Words, "{}", layer.name());
        }
    }
}

//! What is on screen, but for where the camera stands: what undo takes back, together with the comparison.

use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, VariantChoice};
use kernels::scene::Scene;
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use kernels::view::normals::NormalEncoding;

use super::display::Layer;

/// Smallest and largest side of a picture relative to its place on the screen.
pub const SCALES: [f64; 2] = [0.1, 2.0];

/// Everything that decides how the terrain looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The scene, with the numbers that were changed.
    pub scene: Scene,
    /// The variant on every tile; `None` = each tile what its pixels need.
    pub forced: Option<Variant>,
    /// Whether the generic kernel shades in place of the variants' own.
    pub generic: bool,
    /// How stochastic flavours arrive at a value.
    pub estimator: Estimator,
    /// Their noise.
    pub noise: NoiseKind,
    /// Their seed.
    pub seed: u32,
    /// Whether each frame has a seed of its own: the seed above, plus the frame.
    pub reseeds: bool,
    /// Full splat with two tiling scales.
    pub two_tilings: bool,
    /// How the geometry pass stores normals.
    pub normals: NormalEncoding,
    /// Pixels drawn per pixel of the screen, along a side.
    pub scale: f64,
    /// What the viewport shows.
    pub layer: Layer,
    /// Levels that the terrain's nodes are drawn coarser, below 0 finer.
    pub lod_bias: f64,
    /// Of a node's vertices along a side every so many-th is drawn: 1, 2 or 4.
    pub vertex_stride: u32,
    /// Whether fetches are counted (a slower shader).
    pub counts: bool,
    /// Whether each variant is shaded, and timed, in a pass of its own.
    pub times_variants: bool,
}

impl Settings {
    /// A scene as its file says, automatic variants, the estimators of Far Cry 5.
    pub fn new(scene: Scene) -> Settings {
        Settings {
            scene,
            forced: None,
            generic: false,
            estimator: Estimator::default(),
            noise: NoiseKind::HashedIsotropic,
            seed: 0,
            reseeds: false,
            two_tilings: false,
            normals: NormalEncoding::default(),
            scale: 1.0,
            layer: Layer::Lit,
            lod_bias: 0.0,
            vertex_stride: 1,
            counts: false,
            times_variants: false,
        }
    }

    /// Which shader shades which tile.
    pub fn choice(&self) -> VariantChoice {
        match (self.forced, self.generic) {
            (None, false) => VariantChoice::Auto,
            (None, true) => VariantChoice::GenericAuto,
            (Some(variant), false) => VariantChoice::Forced(variant),
            (Some(variant), true) => VariantChoice::GenericForced(variant),
        }
    }

    /// What the choice of shaders is called: `auto`, `splat`, `generic vt+splat`.
    pub fn choice_name(&self) -> String {
        let what = self.forced.map_or_else(|| "auto".to_owned(), |variant| variant.to_string());
        if self.generic { format!("generic {what}") } else { what }
    }

    /// Adds a flavour to those forced, or takes it away; without any left the choice is automatic again.
    pub fn toggle(&mut self, flavour: Flavour) {
        let mask = self.forced.map_or(0, Variant::mask) ^ flavour.bit();
        self.forced = Variant::new(mask);
    }

    /// Whether both make the same pictures, however those are looked at.
    pub fn looks_like(&self, other: &Settings) -> bool {
        let Settings { scale, layer, counts, times_variants, .. } = *self;
        *self == Settings { scale, layer, counts, times_variants, ..other.clone() }
    }

    /// The picture of one frame, with the layer on show and `others`.
    pub fn request(&self, pose: Pose, size: [u32; 2], frame: u32, others: &[&str]) -> RenderRequest {
        let layers: Vec<&str> = self.layer.aov().into_iter().chain(others.iter().copied()).collect();
        RenderRequest::new(pose, size).with(|r| {
            r.shading.variant = self.choice();
            r.shading.estimator = self.estimator;
            r.shading.noise = self.noise;
            r.shading.seed = if self.reseeds { self.seed.wrapping_add(frame) } else { self.seed };
            r.shading.frame = frame;
            r.shading.two_tilings = self.two_tilings;
            r.geometry.normals = self.normals;
            r.outputs.aovs = AovSet::from_names(&layers).unwrap_or_default();
            r.outputs.count_fetches = self.counts;
            r.outputs.time_variants = self.times_variants;
            r.geometry.lod_bias = self.lod_bias;
            r.geometry.vertex_stride = self.vertex_stride;
        })
    }
}

#[cfg(test)]
mod tests {
    use kernels::scene;

    use super::*;

    #[test]
    fn flavours_are_added_and_taken_away_one_by_one() {
        let mut settings = Settings::new(scene::load(scene::DEFAULT).expect("built in"));
        settings.toggle(Flavour::Splat);
        settings.toggle(Flavour::VirtualTexture);
        assert_eq!(
            (settings.choice_name().as_str(), settings.choice()),
            ("vt+splat", VariantChoice::Forced(Variant::new(17).expect("a set")))
        );
        settings.generic = true;
        assert_eq!(settings.choice_name(), "generic vt+splat");
        settings.toggle(Flavour::Splat);
        settings.toggle(Flavour::VirtualTexture);
        assert_eq!((settings.choice_name().as_str(), settings.choice()), ("generic auto", VariantChoice::GenericAuto));
    }

    #[test]
    fn what_is_only_looked_at_otherwise_looks_the_same() {
        let settings = Settings::new(scene::load(scene::DEFAULT).expect("built in"));
        let otherwise = Settings { scale: 0.5, layer: Layer::Depth, counts: true, times_variants: true, ..settings.clone() };
        assert!(settings.looks_like(&otherwise) && otherwise.looks_like(&settings));
        assert!(!settings.looks_like(&Settings { seed: 1, ..settings.clone() }));
    }

    #[test]
    fn every_layer_is_one_that_the_renderer_knows() {
        for layer in Layer::ALL {
            if let Some(name) = layer.aov() {
                assert!(AovSet::from_names(&[name]).is_ok(), "{name}");
            }
        }
    }
}

//! Everything that decides how the terrain looks, except the camera. Undo restores it, together with the comparison.

use kernels::base::names::suggestion;
use kernels::frame::picture::AovSet;
use kernels::frame::{self, FrameSettings, RenderRequest, VariantChoice};
use kernels::scene::{self, Scene};
use kernels::settings::{self, Field, Home, Kind, Listing, Range, Setting, Slider};
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use toml::Value;

use super::display::Layer;

/// Everything that decides how the terrain looks.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// The scene, with the edits made in the workbench.
    pub scene: Scene,
    /// Settings of the frame.
    pub frame: FrameSettings,
    /// Pixels drawn per pixel of the screen, along a side.
    pub scale: f64,
    /// The layer of the picture that the viewport shows.
    pub layer: Layer,
    /// Whether texture fetches are counted. Counting uses a slower shader.
    pub counts: bool,
    /// Whether each variant is shaded and timed in a separate pass.
    pub times_variants: bool,
}

const VIEW: Listing = Listing::new("Workbench", &[Home::Workbench]);

/// The setting for [`Settings::scale`].
pub const SCALE: Setting<Settings> = Setting {
    key: "look.scale",
    unit: "",
    kind: Kind::Number(Range::new(0.1, 2.0)),
    default: || Some(Value::Float(1.0)),
    about: "Number of pixels drawn per pixel of the screen, along each side. On a software adapter, the default is 0.5.",
    listing: VIEW.logarithmic("Render scale", 0.1, 2.0),
    field: |settings| Some(&settings.scale),
    field_mut: |settings| Some(&mut settings.scale),
};

/// The setting for [`Settings::counts`].
pub const COUNTS: Setting<Settings> = Setting {
    key: "look.counts",
    unit: "",
    kind: Kind::Flag,
    default: || Some(Value::Boolean(false)),
    about: "Count texture fetches. This uses a slower shader, so the times differ from those of the normal shader.",
    listing: VIEW.shown("Count fetches"),
    field: |settings| Some(&settings.counts),
    field_mut: |settings| Some(&mut settings.counts),
};

/// The setting for [`Settings::times_variants`].
pub const TIMES_VARIANTS: Setting<Settings> = Setting {
    key: "look.times_variants",
    unit: "",
    kind: Kind::Flag,
    default: || Some(Value::Boolean(false)),
    about: "Shade the tiles of each variant in a pass of their own, to compare the times of variants. The sum of these times differs from the time \
            of a single pass for all variants.",
    listing: VIEW.shown("Time variants"),
    field: |settings| Some(&settings.times_variants),
    field_mut: |settings| Some(&mut settings.times_variants),
};

/// The setting for the layer of the picture that the viewport shows.
pub const LAYER: Setting<Settings> = Setting {
    key: "look.layer",
    unit: "",
    kind: Kind::Name(|| Layer::ALL.map(Layer::name).to_vec()),
    default: || Some(Layer::Lit.value()),
    about: "The layer of the picture that the viewport shows.",
    listing: VIEW.shown("Layer"),
    field: |settings| Some(&settings.layer),
    field_mut: |settings| Some(&mut settings.layer),
};

/// The settings that only the workbench has: render scale, layer, counting of fetches, and timing of variants.
pub const OWN: [&Setting<Settings>; 4] = [&SCALE, &LAYER, &COUNTS, &TIMES_VARIANTS];

impl Field for Layer {
    fn value(&self) -> Value {
        Value::String(self.name().to_owned())
    }

    fn store(&mut self, value: &Value) -> Result<(), String> {
        let known = Layer::ALL.into_iter().find(|layer| value.as_str() == Some(layer.name()));
        *self = known.ok_or_else(String::new)?;
        Ok(())
    }
}

/// The numbers of a scene that the workbench shows, with their sliders.
pub fn numbers() -> impl Iterator<Item = (&'static Setting<Scene>, Slider)> {
    scene::settings().filter_map(|setting| setting.listing.slider.map(|slider| (setting, slider)))
}

/// The numbers in which `own` differs from `other`, with both values.
pub fn differences(own: &Scene, other: &Scene) -> Vec<(&'static Setting<Scene>, [f64; 2])> {
    let both = numbers().filter_map(|(setting, _)| {
        let value = |scene: &Scene| setting.get(scene)?.as_float();
        Some((setting, [value(own)?, value(other)?]))
    });
    both.filter(|(_, [a, b])| a.to_bits() != b.to_bits()).collect()
}

impl Settings {
    /// The settings for a scene; everything else has its default.
    pub fn new(scene: Scene) -> Settings {
        Settings { scene, frame: FrameSettings::default(), scale: 1.0, layer: Layer::Lit, counts: false, times_variants: false }
    }

    /// The settings that are saved from one start to the next, by the last part of their keys. The settings of the scene are saved separately.
    pub fn kept(&self) -> impl Iterator<Item = (&'static str, Value)> {
        let of_frame = frame_settings().filter_map(move |setting| Some((setting.name(), setting.get(&self.frame)?)));
        of_frame.chain(OWN.into_iter().filter_map(move |setting| Some((setting.name(), setting.get(self)?))))
    }

    /// Sets a setting to a saved value.
    ///
    /// # Errors
    /// One sentence: no setting has this name, or the setting does not accept the value. Nothing is changed.
    pub fn take(&mut self, name: &str, value: &Value) -> Result<(), String> {
        if let Some(setting) = frame_settings().find(|setting| setting.name() == name) {
            return setting.set(&mut self.frame, value);
        }
        match OWN.into_iter().find(|setting| setting.name() == name) {
            Some(setting) => setting.set(self, value),
            None => Err(format!("no setting is called `{name}`: {}", suggestion(name, &kept_names()))),
        }
    }

    /// How the variant of each tile is chosen.
    pub fn choice(&self) -> VariantChoice {
        self.frame.choice()
    }

    /// Name of the choice that [`Settings::choice`] returns, such as `auto`, `splat` or `generic vt+splat`.
    pub fn choice_name(&self) -> String {
        let what = self.frame.variant.map_or_else(|| "auto".to_owned(), |variant| variant.to_string());
        if self.frame.generic { format!("generic {what}") } else { what }
    }

    /// Adds a flavour to the forced flavours, or removes it. If no flavour is left, the choice is automatic.
    pub fn toggle(&mut self, flavour: Flavour) {
        let mask = self.frame.variant.map_or(0, Variant::mask) ^ flavour.bit();
        self.frame.variant = Variant::new(mask);
    }

    /// Whether both settings are equal, apart from settings of the display: render scale, layer, counting, timing, exposure and tone curve.
    pub fn looks_like(&self, other: &Settings) -> bool {
        let Settings { scale, layer, counts, times_variants, .. } = *self;
        let frame = other.frame.looked_at_as(&self.frame);
        *self == Settings { frame, scale, layer, counts, times_variants, ..other.clone() }
    }

    /// The request for the picture of a frame, with the layer on screen and the layers `others`.
    pub fn request(&self, pose: Pose, size: [u32; 2], frame: u32, others: &[&str]) -> RenderRequest {
        let layers: Vec<&str> = self.layer.aov().into_iter().chain(others.iter().copied()).collect();
        self.frame.request(pose, size, frame).with(|r| {
            r.outputs.aovs = AovSet::from_names(&layers).unwrap_or_default();
            r.outputs.count_fetches = self.counts;
            r.outputs.displayed = true;
            r.outputs.time_variants = self.times_variants;
        })
    }
}

/// The settings of a frame that the workbench shows, without the settings of the stages.
pub fn own_settings() -> impl Iterator<Item = &'static Setting<FrameSettings>> {
    FrameSettings::SETTINGS.iter().filter(|setting| setting.has_home(Home::Workbench))
}

/// The settings of stages that the workbench shows.
pub fn stage_settings() -> impl Iterator<Item = &'static Setting<FrameSettings>> {
    frame::stage_settings().filter(|setting| setting.has_home(Home::Workbench))
}

/// The settings of a frame and its stages that the workbench shows and saves.
pub fn frame_settings() -> impl Iterator<Item = &'static Setting<FrameSettings>> {
    frame::settings().filter(|setting| setting.has_home(Home::Workbench))
}

/// The text of `docs/settings.md`: every setting of a scene, of a frame, and of the workbench.
pub fn reference() -> String {
    let rows = scene::settings().map(|setting| setting.row(None)).chain(frame::settings().map(|setting| setting.row(None)));
    let rows: Vec<_> = rows.chain(OWN.into_iter().map(|setting| setting.row(None))).collect();
    settings::reference(&rows)
}

/// The names of the settings that [`Settings::kept`] returns.
pub fn kept_names() -> Vec<&'static str> {
    frame_settings().map(Setting::name).chain(OWN.into_iter().map(Setting::name)).collect()
}

#[cfg(test)]
mod tests {
    use kernels::display::{Exposure, ToneCurve};
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
        settings.frame.generic = true;
        assert_eq!(settings.choice_name(), "generic vt+splat");
        settings.toggle(Flavour::Splat);
        settings.toggle(Flavour::VirtualTexture);
        assert_eq!((settings.choice_name().as_str(), settings.choice()), ("generic auto", VariantChoice::GenericAuto));
    }

    #[test]
    fn what_is_only_looked_at_otherwise_looks_the_same() {
        let settings = Settings::new(scene::load(scene::DEFAULT).expect("built in"));
        let mut frame = settings.frame;
        frame.stages.display = Exposure { exposure: 2.0, tone_curve: ToneCurve::Clip };
        let otherwise = Settings { frame, scale: 0.5, layer: Layer::Depth, counts: true, times_variants: true, ..settings.clone() };
        assert!(settings.looks_like(&otherwise) && otherwise.looks_like(&settings));
        let mut otherwise = settings.clone();
        otherwise.frame.seed = 1;
        assert!(!settings.looks_like(&otherwise));
    }

    #[test]
    fn every_layer_is_one_that_the_renderer_knows() {
        for layer in Layer::ALL {
            if let Some(name) = layer.aov() {
                assert!(AovSet::from_names(&[name]).is_ok(), "{name}");
            }
        }
    }

    #[test]
    fn own_settings_are_what_their_table_says() {
        let settings = Settings::new(scene::load(scene::DEFAULT).expect("built in"));
        for setting in OWN {
            assert_eq!(setting.get(&settings), (setting.default)(), "{}", setting.key);
        }
        let names = kept_names();
        assert!(names.iter().enumerate().all(|(i, name)| !names[..i].contains(name)), "{names:?}");
    }

    #[test]
    fn no_label_comes_twice_and_sliders_lie_within_what_is_accepted() {
        let labels = scene::settings().filter_map(|s| s.listing.label).chain(frame::settings().filter_map(|s| s.listing.label));
        let labels: Vec<&str> = labels.chain(OWN.into_iter().filter_map(|s| s.listing.label)).collect();
        assert!(labels.iter().enumerate().all(|(i, label)| !labels[..i].contains(label)), "{labels:?}");
        let kinds = scene::settings().map(|s| (s.key, s.kind, s.listing.slider));
        let kinds = kinds.chain(frame::settings().map(|s| (s.key, s.kind, s.listing.slider)));
        let kinds: Vec<_> = kinds.chain(OWN.into_iter().map(|s| (s.key, s.kind, s.listing.slider))).collect();
        let sliders = kinds.into_iter().filter_map(|(key, kind, slider)| Some((key, kind, slider?)));
        let mut count = 0;
        for (key, kind, slider) in sliders {
            let Kind::Number(range) = kind else { panic!("{key} is no number") };
            assert!(slider.ends.iter().all(|&end| range.contains(end)) && slider.ends[0] < slider.ends[1], "{key}");
            count += 1;
        }
        assert!(count > 10, "{count} sliders");
    }
}

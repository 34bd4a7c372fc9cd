//! The comparison of two ways to shade a view, A and B. A has the settings that the panels edit, and B has other settings.

use kernels::frame::FrameSettings;
use kernels::shading::Estimator;
use kernels::variant::{Flavour, Variant};

use super::settings::{Settings, differences};

/// How A and B share the viewport.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mode {
    /// Only A is drawn.
    #[default]
    Off,
    /// A is shown to the left of a line, B to its right.
    Wipe,
    /// The same part of both pictures, next to each other.
    SideBySide,
    /// One picture at a time; a key switches between them.
    Flicker,
    /// The absolute difference of the two lit pictures in luminance.
    Difference,
}

impl Mode {
    /// All modes, in the order of the menu.
    pub const ALL: [Mode; 5] = [Mode::Off, Mode::Wipe, Mode::SideBySide, Mode::Flicker, Mode::Difference];

    /// Returns the name of the mode in the menu.
    pub const fn name(self) -> &'static str {
        match self {
            Mode::Off => "Only A",
            Mode::Wipe => "Wipe",
            Mode::SideBySide => "Side by side",
            Mode::Flicker => "Flicker",
            Mode::Difference => "Difference",
        }
    }

    /// Returns a text that describes the contents of the viewport in this mode.
    pub const fn about(self) -> &'static str {
        match self {
            Mode::Off => "B is not drawn",
            Mode::Wipe => "A is left of the line, B is right of it. Drag the line to move it.",
            Mode::SideBySide => "The same part of A and B, next to each other",
            Mode::Flicker => "One picture at a time. The key X switches between A and B.",
            Mode::Difference => "Absolute difference in lit linear luminance, from 0.001 (black) to 1 (pale yellow), logarithmic",
        }
    }
}

/// The settings with which B is drawn.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Other {
    /// The exact blend for the settings of A: the mean of the estimator `fc5` over all its random choices. It has no noise.
    #[default]
    Exact,
    /// The reference blend: the flavour splat with two tilings on every pixel. Without colour modulation, it takes 96 fetches per pixel.
    Full,
    /// Settings that were stored with `Keep A as B`.
    Kept(Box<Settings>),
}

impl Other {
    /// Returns the name in the menu.
    pub const fn name(&self) -> &'static str {
        match self {
            Other::Exact => "exact blend of A",
            Other::Full => "full splat, 96 fetches",
            Other::Kept(_) => "kept settings",
        }
    }
}

/// The comparison.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Compare {
    /// How A and B are shown.
    pub mode: Mode,
    /// The settings with which B is drawn.
    pub other: Other,
}

impl Compare {
    /// Returns the settings of B; `None` = B is not drawn. The settings of the display (layer, scale, exposure, tone curve, counting, timing) are
    /// those of A.
    pub fn b(&self, a: &Settings) -> Option<Settings> {
        let Settings { layer, scale, counts, times_variants, .. } = *a;
        let looked_at_as_a =
            |b: &Settings| Settings { frame: b.frame.looked_at_as(&a.frame), layer, scale, counts, times_variants, ..b.clone() };
        match (self.mode, &self.other) {
            (Mode::Off, _) => None,
            (_, Other::Exact) => Some(Settings { frame: FrameSettings { estimator: Estimator::Exact, ..a.frame }, ..a.clone() }),
            (_, Other::Full) => {
                let variant = Some(Variant::only(Flavour::Splat));
                let frame = FrameSettings { estimator: Estimator::Exact, variant, generic: false, two_tilings: true, ..a.frame };
                Some(Settings { frame, ..a.clone() })
            }
            (_, Other::Kept(b)) => Some(looked_at_as_a(b)),
        }
    }

    /// Stores the settings of A as B. If B was not drawn, the mode changes to [`Mode::Wipe`].
    pub fn keep(&mut self, a: &Settings) {
        self.other = Other::Kept(Box::new(a.clone()));
        if self.mode == Mode::Off {
            self.mode = Mode::Wipe;
        }
    }

    /// Exchanges the settings of A and B, except those of the display.
    pub fn swap(&mut self, a: &mut Settings) {
        let drawn = Compare { mode: Mode::Wipe, other: self.other.clone() };
        if let Some(b) = drawn.b(a) {
            self.other = Other::Kept(Box::new(std::mem::replace(a, b)));
        }
    }
}

/// Describes in words how `own` differs from `other`. Differences that no panel of the workbench can make, and differences in display, are left out.
/// If there is nothing to describe, returns the choice of variant.
pub fn label(own: &Settings, other: &Settings) -> String {
    let mut parts = Vec::new();
    if own.choice() != other.choice() {
        parts.push(own.choice_name());
    }
    let (mine, theirs) = (&own.frame, &other.frame);
    if mine.estimator != theirs.estimator {
        parts.push(mine.estimator.name().to_owned());
    }
    if mine.noise != theirs.noise {
        parts.push(mine.noise.name().to_owned());
    }
    if mine.seed != theirs.seed {
        parts.push(format!("seed {}", mine.seed));
    }
    if mine.reseeds != theirs.reseeds {
        parts.push(if mine.reseeds { "a seed per frame" } else { "one seed" }.to_owned());
    }
    if mine.two_tilings != theirs.two_tilings {
        parts.push(if mine.two_tilings { "two tilings" } else { "one tiling" }.to_owned());
    }
    if mine.normals != theirs.normals {
        parts.push(format!("{} normals", mine.normals));
    }
    if (mine.lod_bias - theirs.lod_bias).abs() > 0.0 {
        parts.push(format!("node LOD bias {}", mine.lod_bias));
    }
    if mine.vertex_stride != theirs.vertex_stride {
        parts.push(format!("vertex stride {}", mine.vertex_stride));
    }
    if (mine.geometry_error - theirs.geometry_error).abs() > 0.0 {
        parts.push(format!("geometry error {} px", mine.geometry_error));
    }
    for (setting, [number, _]) in differences(&own.scene, &other.scene) {
        let unit = if setting.unit.is_empty() { String::new() } else { format!(" {}", setting.unit) };
        parts.push(format!("{} {}{unit}", setting.label(), (number * 1000.0).round() / 1000.0));
    }
    if own.scene.materials != other.scene.materials {
        parts.push("different materials".to_owned());
    }
    if own.scene.rules != other.scene.rules {
        parts.push("different rules".to_owned());
    }
    if own.scene.strokes != other.scene.strokes {
        parts.push(format!("strokes: {}", own.scene.strokes.len()));
    }
    if parts.is_empty() { own.choice_name() } else { parts.join(", ") }
}

#[cfg(test)]
mod tests {
    use kernels::scene;
    use kernels::shared::noise::NoiseKind;

    use super::*;

    fn settings() -> Settings {
        Settings::new(scene::load(scene::DEFAULT).expect("built in"))
    }

    #[test]
    fn b_is_what_it_is_called_and_looked_at_as_a_is() {
        let mut a = settings();
        a.frame.noise = NoiseKind::WhiteScreen;
        let mut compare = Compare::default();
        assert_eq!(compare.b(&a), None, "off");
        compare.keep(&a);
        assert_eq!((compare.mode, compare.b(&a)), (Mode::Wipe, Some(a.clone())));
        let kept = a.clone();
        a.frame.noise = NoiseKind::WhiteWorld;
        a.scale = 0.25;
        a.scene.blend.hash_scale = 2.0;
        let b = compare.b(&a).expect("drawn");
        assert_eq!((b.frame.noise, b.scale), (NoiseKind::WhiteScreen, 0.25));
        assert_eq!(
            (label(&a, &b), label(&b, &a)),
            ("world, Noise cell 2 px".to_owned(), format!("white, Noise cell {} px", kept.scene.blend.hash_scale))
        );
        let mut painted = b.clone();
        painted.scene.materials[0].tint[1] = 0.5;
        painted.scene.rules.pop();
        assert_eq!(label(&painted, &b), "different materials, different rules");
        let mut coarse = b.clone();
        (coarse.frame.lod_bias, coarse.frame.vertex_stride, coarse.frame.geometry_error) = (1.5, 4, 0.5);
        assert_eq!(label(&coarse, &b), "node LOD bias 1.5, vertex stride 4, geometry error 0.5 px");
        assert_eq!(label(&b, &coarse), "node LOD bias 0, vertex stride 1, geometry error 0 px");
        compare.other = Other::Exact;
        assert_eq!(compare.b(&a).map(|b| (b.frame.estimator, b.frame.noise)), Some((Estimator::Exact, NoiseKind::WhiteWorld)));
        compare.other = Other::Full;
        let full = compare.b(&a).expect("drawn");
        assert_eq!(
            (full.choice_name().as_str(), full.frame.two_tilings, label(&full, &a).as_str()),
            ("splat", true, "splat, exact, two tilings")
        );
    }

    #[test]
    fn a_swap_and_another_one_are_none() {
        let (mut a, mut compare) = (settings(), Compare::default());
        compare.keep(&a);
        a.frame.noise = NoiseKind::Blue;
        let (before, was) = (a.clone(), compare.clone());
        compare.swap(&mut a);
        assert_eq!(a.frame.noise, NoiseKind::HashedIsotropic);
        compare.swap(&mut a);
        assert_eq!((a, compare), (before, was));
    }
}

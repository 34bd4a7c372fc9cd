//! Carries out the parts of a run on a device. A part renders a reference, measures a sweep, or measures times.
//!
//! A *sweep* measures one view with one estimator, noise and temporal resolve. In each frame, the geometry is drawn once. Each flavour is then shaded
//! once on every pixel and stored as a layer, unless an earlier sweep has stored the same layer. The pictures of all variants are composed from these
//! layers (`kernels::composition`). *Times* are measured differently: pixels are shaded directly, by pipelines that do not count fetches.

mod costs;
mod followed;
mod pictures;
mod reference;
mod sequence;
mod streamed;
mod sweep;
mod timing;
mod views;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Error, Result, anyhow};
use kernels::base::progress::Progress;
use kernels::composition::Layers;
use kernels::frame::{ClassifyBy, FrameSettings, RenderRequest, Renderer, RendererOptions, VariantChoice};
use kernels::gpu::Gpu;
use kernels::residency::Residency;
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;
use kernels::shared::signal::Signal;
use kernels::temporal::{Resolve, SamplePattern};
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;

use crate::definition::{Definition, Setting, setting_text};
use crate::metrics;
use crate::row::Row;
use crate::significance::Mean;
use crate::unit::{Measure, Outcome, Unit, Work, plan};

/// A callback that ignores the progress of the renderer. The runner reports the steps of each part instead.
const QUIET: &(dyn Fn(Progress) + Sync) = &|_| {};

/// Carries out the parts of one definition.
pub struct Runner<'a> {
    gpu: &'a Gpu,
    definition: &'a Definition,
    imported: Option<PathBuf>,
    variants: Vec<(String, VariantChoice)>,
    stage: Option<Stage<'a>>,
}

/// The renderer, and the results that successive parts with the same value of the varied parameter share.
struct Stage<'a> {
    setting: Setting,
    choices: FrameSettings,
    renderer: Renderer<'a>,
    layers: Layers,
    /// Layers of the exact blend, with the pose and frame for which they were drawn.
    exact: Option<(Pose, u32, Layers)>,
    fixed: Fixed,
    streamed: streamed::Streamed,
}

/// Results that do not depend on the noise. Successive parts with the same setting, view and estimator share them.
#[derive(Default)]
struct Fixed {
    view: String,
    estimator: Option<Estimator>,
    /// For each frame and sample pattern: layers of the flavours that draw no random numbers.
    frames: HashMap<(u32, SamplePattern), Layers>,
    /// For each resolve: rows of the variants that draw no random numbers. Parts with a different noise copy these rows and only change the column
    /// `noise`.
    rows: HashMap<Resolve, Vec<Row>>,
}

/// Limit of the total size of the layers in [`Fixed::frames`], bytes. Layers beyond the limit are not kept, so they are shaded again for each noise.
const FIXED_BYTES: u64 = 1 << 30;

impl Fixed {
    /// Prepares for results of this view and estimator. Stored results of a different view or estimator are discarded.
    fn of(&mut self, view: &str, estimator: Estimator) {
        if self.view != view || self.estimator != Some(estimator) {
            *self = Fixed { view: view.to_owned(), estimator: Some(estimator), ..Fixed::default() };
        }
    }
}

impl<'a> Runner<'a> {
    /// Returns a runner for a valid definition. `imported` = folder of the imported scene, if the definition imports one.
    ///
    /// # Errors
    /// A variant does not exist.
    pub fn new(gpu: &'a Gpu, definition: &'a Definition, imported: Option<&Path>) -> Result<Runner<'a>> {
        let variants = definition.variant_choices()?;
        Ok(Runner { gpu, definition, imported: imported.map(Path::to_owned), variants, stage: None })
    }

    /// Ensures that the renderer has the scene and the frame settings for a value of the varied parameter. An existing renderer is changed
    /// if this is possible, and is otherwise replaced by a new one.
    fn prepare(&mut self, setting: &Setting) -> Result<()> {
        if self.stage.as_ref().is_some_and(|stage| &stage.setting == setting) {
            return Ok(());
        }
        let scene = self.definition.scene(setting, self.imported.as_deref())?;
        let choices = self.definition.frame_settings(setting).map_err(|what| anyhow!("experiment `{}`: {what}", self.definition.name))?;
        if let Some(stage) = self.stage.as_mut().filter(|stage| stage.choices == choices) {
            // `retune` can succeed if both scenes require the same flavours and differ only in settings such as the light or the distances at which
            // flavours change. In this case, the world and the textures are kept.
            if stage.renderer.retune(&scene)? {
                stage.setting.clone_from(setting);
                stage.exact = None;
                stage.fixed = Fixed::default();
                stage.streamed = streamed::Streamed::default();
                return Ok(());
            }
        }
        // The old renderer is dropped before the new one is created, so that its memory is free.
        self.stage = None;
        let options = RendererOptions { tile: choices.tile, ..RendererOptions::default() };
        let renderer = Renderer::with(self.gpu, &scene, options, QUIET)?;
        let layers = Layers::new(self.gpu, self.definition.size);
        self.stage = Some(Stage {
            setting: setting.clone(),
            choices,
            renderer,
            layers,
            exact: None,
            fixed: Fixed::default(),
            streamed: streamed::Streamed::default(),
        });
        Ok(())
    }

    /// Finds the part of the run that renders the reference for the view and the setting of `unit`.
    fn reference_of(&self, unit: &Unit) -> Result<Unit> {
        let is_its = |other: &Unit| other.work == Work::Reference && other.view == unit.view && other.setting == unit.setting;
        plan(self.definition).into_iter().find(is_its).with_context(|| format!("the run has no reference of view `{}`", unit.view))
    }
}

impl Measure for Runner<'_> {
    fn measure(&mut self, unit: &Unit, folder: &Path, step: &dyn Fn(u64, u64)) -> Result<Outcome> {
        self.prepare(&unit.setting)?;
        match &unit.work {
            Work::Reference => self.reference(unit, folder, step),
            Work::Sweep { estimator, noise, temporal } => {
                let how = sweep::How { estimator: parse(estimator)?, noise: parse(noise)?, resolve: parse(temporal)? };
                self.sweep(unit, &how, folder, step)
            }
            Work::Timing { estimator, noise } => self.time(unit, parse(estimator)?, parse(noise)?, step),
        }
    }
}

fn parse<T: FromStr>(text: &str) -> Result<T>
where
    T::Err: std::error::Error + Send + Sync + 'static,
{
    Ok(text.parse::<T>()?)
}

/// The values of the columns that the rows of a part have in common.
struct Labels<'a> {
    definition: &'a Definition,
    scene: &'a str,
    unit: &'a Unit,
    estimator: &'a str,
    noise: &'a str,
    temporal: &'a str,
}

/// The columns that identify the frames and the frequency band of a row.
#[derive(Clone, Copy, Default)]
struct Mark {
    frame: Option<u32>,
    lag: Option<u32>,
    frequency: Option<f64>,
}

impl Mark {
    fn frame(frame: u32) -> Mark {
        Mark { frame: Some(frame), ..Mark::default() }
    }

    /// Returns a copy with the given lag. Lags are counted from 1.
    fn lag(self, lag: usize) -> Mark {
        Mark { lag: u32::try_from(lag).ok(), ..self }
    }
}

impl Labels<'_> {
    /// Whether the part's noise is the first noise of the definition.
    fn is_first_noise(&self) -> bool {
        self.definition.noises.first().is_some_and(|noise| noise == self.noise)
    }

    /// Adds a row if the run measures the metric ([`Definition::measures`]). If the metric depends on a signal, the row is about albedo.
    ///
    /// # Errors
    /// `metric` is not in the table of metrics.
    fn put(&self, rows: &mut Vec<Row>, variant: &str, metric: &str, mark: Mark, value: f64, standard_error: Option<f64>) -> Result<()> {
        self.put_of(rows, variant, Signal::Albedo, metric, mark, value, standard_error)
    }

    /// Adds a row for a signal if the run measures the metric ([`Definition::measures`]).
    ///
    /// # Errors
    /// `metric` is not in the table of metrics.
    #[allow(clippy::too_many_arguments, reason = "the columns of a row")]
    fn put_of(
        &self,
        rows: &mut Vec<Row>,
        variant: &str,
        signal: Signal,
        metric: &str,
        mark: Mark,
        value: f64,
        standard_error: Option<f64>,
    ) -> Result<()> {
        self.put_mean(rows, variant, signal, metric, mark, Mean { value, standard_error, freedom: None })
    }

    /// Does the same as [`Labels::put_of`], with the degrees of freedom of the standard error.
    ///
    /// # Errors
    /// The same errors as [`Labels::put_of`].
    fn put_mean(&self, rows: &mut Vec<Row>, variant: &str, signal: Signal, metric: &str, mark: Mark, mean: Mean) -> Result<()> {
        let known = metrics::known(metric).map_err(Error::msg)?;
        if !self.definition.measures(metric) {
            return Ok(());
        }
        let parameter = self.definition.vary.as_ref().map_or_else(String::new, |vary| vary.parameter.clone());
        rows.push(Row {
            experiment: self.definition.name.clone(),
            scene: self.scene.to_owned(),
            view: self.unit.view.clone(),
            variant: variant.to_owned(),
            estimator: self.estimator.to_owned(),
            noise: self.noise.to_owned(),
            temporal: self.temporal.to_owned(),
            signal: known.signal_column(signal).to_owned(),
            setting: self.unit.setting.as_ref().map_or_else(String::new, setting_text),
            parameter,
            frame: mark.frame,
            lag: mark.lag,
            frequency: mark.frequency,
            metric: metric.to_owned(),
            unit: known.unit_of(signal),
            value: mean.value,
            standard_error: mean.standard_error,
            freedom: mean.freedom,
        });
        Ok(())
    }
}

/// Returns the flavours that any of the variants may need. The virtual texture is left out if the renderer's scene does not use it. `None` if no
/// flavour remains.
fn flavours_of(renderer: &Renderer<'_>, variants: &[(String, VariantChoice)]) -> Option<Variant> {
    let available = |flavour: Flavour| flavour != Flavour::VirtualTexture || renderer.demands().has(flavour);
    let wanted = |flavour: &Flavour| available(*flavour) && variants.iter().any(|(_, choice)| choice.may_use(*flavour));
    Variant::new(Flavour::ALL.into_iter().filter(wanted).fold(0, |mask, flavour| mask | flavour.bit()))
}

/// Splits a set of flavours into those that draw random numbers with this estimator and those that do not. `None` = an empty set.
fn split(set: Variant, estimator: Estimator) -> [Option<Variant>; 2] {
    let (drawing, fixed): (Vec<Flavour>, Vec<Flavour>) =
        set.flavours().partition(|&flavour| estimator.is_stochastic(Variant::only(flavour)));
    [drawing, fixed].map(|list| Variant::new(list.into_iter().fold(0, |mask, flavour| mask | flavour.bit())))
}

impl Stage<'_> {
    /// Returns the layers of a view, one for each flavour of `needed`. Flavours that draw random numbers are shaded in each call. The layers of the
    /// other flavours do not depend on the noise: they are stored and used again for other noises, as long as the stored layers fit into
    /// [`FIXED_BYTES`]. If no flavour of `needed` draws random numbers, nothing is stored.
    fn draw(&mut self, request: &RenderRequest, needed: Variant) -> Result<Layers> {
        let [drawing, fixed] = split(needed, request.shading.estimator);
        let key = (request.shading.frame, request.shading.sample_pattern);
        let known = &self.fixed.frames;
        let fits = known.contains_key(&key) || (known.len() as u64 + 1) * Layers::bytes(request.view.size) <= FIXED_BYTES;
        let (Some(drawing), Some(fixed), true) = (drawing, fixed, fits) else {
            self.renderer.draw_flavours(request, needed, &self.layers)?;
            return Ok(self.layers.clone());
        };
        if !self.fixed.frames.contains_key(&key) {
            let layers = Layers::new(self.renderer.gpu(), request.view.size);
            self.renderer.draw_flavours(request, fixed, &layers)?;
            self.fixed.frames.insert(key, layers);
        }
        // The measurements read the geometry of the frame that was drawn last. Flavours that draw random numbers are shaded in every call,
        // so this is always the geometry of `request`.
        self.renderer.draw_flavours(request, drawing, &self.layers)?;
        Ok(self.layers.with(&self.fixed.frames[&key], fixed))
    }
}

/// Returns the variant whose flavours are composed at every pixel. `None` = each pixel is composed from the flavours that it needs.
fn composed(choice: VariantChoice) -> Option<Variant> {
    match choice {
        VariantChoice::Auto | VariantChoice::GenericAuto => None,
        VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant) => Some(variant),
    }
}

/// Returns a copy of the request that renders the reference blend. The copy uses all terrain nodes that the view needs, even if streaming is
/// simulated. If nodes are late in the picture under test, the difference therefore counts as its error.
fn truth(request: &RenderRequest) -> RenderRequest {
    request.with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::Splat));
        r.shading.estimator = Estimator::Exact;
        r.shading.noise = NoiseKind::HashedIsotropic;
        r.shading.two_tilings = true;
        r.geometry.residency = Residency::Settled;
    })
}

/// Whether the cost of automatic choice is computed as if a variant were chosen for each patch of terrain. Otherwise it is computed for the tiles of
/// the screen.
fn by_patch(choices: &FrameSettings) -> bool {
    choices.classification == ClassifyBy::Patch
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::definition::parse;

    #[test]
    fn a_metric_that_is_not_in_the_table_is_an_error() {
        let text = "name = 'a'\nquestion = 'b'\nviews = ['cliff']\nsize = [64, 64]\nframes = 2\nvariants = ['auto']\nmetrics = ['rmse']";
        let definition = parse(text, "a", Path::new("")).expect("a definition");
        let unit = plan(&definition).remove(0);
        let labels = Labels { definition: &definition, scene: "default", unit: &unit, estimator: "", noise: "", temporal: "" };
        let mut rows = Vec::new();
        let error = labels.put(&mut rows, "auto", "flip-rate", Mark::frame(0), 1.0, None).expect_err("no such metric");
        assert!(rows.is_empty() && error.to_string().contains("`flip_rate`"), "{error}");
        // A metric that the definition does not request adds no row.
        labels.put(&mut rows, "auto", metrics::FLIP, Mark::frame(0), 1.0, None).expect("a metric");
        assert!(rows.is_empty());
        labels.put(&mut rows, "auto", metrics::RMSE, Mark::frame(0), 1.0, None).expect("a metric");
        assert_eq!((rows.len(), rows[0].metric.as_str(), rows[0].unit.as_str()), (1, "rmse", "linear albedo"));
    }
}

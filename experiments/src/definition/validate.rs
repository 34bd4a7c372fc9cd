//! Checks the values of a definition and their combinations. The types of the values are already checked when the file is read. Most errors in a
//! definition are thus reported before anything is measured.

use std::path::Path;

use anyhow::{Result, anyhow};
use kernels::base::document::{At, Checked, Problem, Step};
use kernels::base::names::suggestion;
use kernels::frame::requirements::Requirements;
use kernels::frame::{FRAME, FrameSettings, MAX_PIXELS, MAX_SIDE, VariantChoice};
use kernels::import::viewpoints;
use kernels::scene::{self, Scene, SceneText};
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;
use kernels::shared::signal::Signal;
use kernels::temporal::Resolve;
use kernels::variant::Flavour;
use toml::Value;

use super::parameters::{apply, frame_parameters};
use super::{ALL_VARIANTS, Definition, Expectation, Import, MAX_TIMES_BUDGET_S, Motion, Small, Times, Viewing, setting_text, variant_name};
use crate::metrics::{self, Axis, LAGS, Needs, Signals};
use crate::row::{Field, Row};

// Limits of the values in a definition, of the lengths of its lists, and of the number of parts of a run. Larger numbers are considered mistakes.
const MAX_FRAMES: u32 = 100_000;
const MAX_SEEDS: u32 = 4096;
const MAX_SPP: u32 = 65_536;
const MAX_LIST: usize = 1000;
const MAX_UNITS: usize = 100_000;

/// Number of samples in a batch of the reference. The standard error of the reference is computed from at least [`BATCHES`] batches.
const BATCH: u32 = 8;
const BATCHES: u32 = 4;

/// The facts about a scene that are needed to check a definition: cameras, paths, passes, and the text of the scene.
struct Facts {
    /// Names of cameras, each with its field of view in degrees if it is known.
    cameras: Vec<(String, Option<f64>)>,
    /// Names of paths, each with its number of frames.
    paths: Vec<(String, u64)>,
    passes: Vec<&'static str>,
    /// The text of the scene; `None` = the scene has not been imported yet.
    text: Option<SceneText>,
}

impl Facts {
    fn of(scene: &Scene, text: SceneText) -> Facts {
        Facts {
            cameras: scene.cameras.iter().map(|camera| (camera.name.clone(), Some(camera.fov_deg))).collect(),
            paths: scene.paths.iter().map(|path| (path.name.clone(), path.frames())).collect(),
            passes: Requirements::of(scene).passes.iter().map(|pass| pass.name).collect(),
            text: Some(text),
        }
    }

    /// Returns what is known about a scene before it is imported. An imported scene has four cameras and no path. Settings that the import does not
    /// write have their defaults.
    fn before_import() -> Result<Facts, String> {
        let like = scene::load(scene::DEFAULT).map_err(|error| error.to_string())?;
        Ok(Facts {
            cameras: viewpoints::NAMES.iter().map(|&name| (name.to_owned(), None)).collect(),
            paths: Vec::new(),
            passes: Requirements::of(&like).passes.iter().map(|pass| pass.name).collect(),
            text: None,
        })
    }
}

impl Definition {
    /// Checks the definition and its scene. If `small` changes anything, repeats the checks for the definition with these changes.
    pub(super) fn check(&self) -> Checked {
        shape(self)?;
        let scene = At::top().key("scene");
        let facts = if self.import.is_some() {
            Facts::before_import().or_else(|what| refuse(&scene, what))?
        } else {
            let text = self.scene_text(None).or_else(|what| refuse(&scene, what))?;
            let plain = scene::parse(&text.text, &text.name, &text.folder).or_else(|error| refuse(&scene, error.to_string()))?;
            Facts::of(&plain, text)
        };
        self.check_with(&facts)
    }

    /// Checks everything that depends on the imported scene in `folder`.
    ///
    /// # Errors
    /// The imported scene lacks something that the definition needs, or a parameter is invalid for it.
    pub(crate) fn check_imported(&self, folder: &Path) -> Result<()> {
        let fail = |what: String| anyhow!("experiment `{}`: {what}", self.name);
        let text = self.scene_text(Some(folder)).map_err(fail)?;
        let plain = scene::parse(&text.text, &text.name, &text.folder)?;
        self.check_with(&Facts::of(&plain, text)).map_err(|problem| fail(problem.to_string()))
    }

    fn check_with(&self, facts: &Facts) -> Checked {
        against(self, facts)?;
        if self.small == Small::default() {
            return Ok(());
        }
        small_lists(self)?;
        let small = self.small();
        shape(&small).and_then(|()| against(&small, facts)).map_err(|problem| in_small(self, problem))
    }
}

/// Returns an error that reports the problem `what` of the key `at`.
fn refuse<T>(at: &At, what: impl Into<String>) -> Result<T, Problem> {
    Err(at.problem(what))
}

/// Corrects the place of a problem that was found after the changes of `small` were applied. If the problem is at a key that `small` replaces, it
/// gets the place of this key in `small`. Otherwise the place is unchanged, and the message mentions `small`.
fn in_small(definition: &Definition, mut problem: Problem) -> Problem {
    let small = &definition.small;
    let changed = |key: &str| match key {
        "size" => small.size.is_some(),
        "frames" => small.frames.is_some(),
        "warm_up" => small.warm_up.is_some(),
        "seeds" => small.seeds.is_some(),
        "views" => small.views.is_some(),
        "variants" => small.variants.is_some(),
        _ => false,
    };
    let keys: Vec<&str> =
        problem.path.iter().filter_map(|step| if let Step::Key(key) = step { Some(key.as_ref()) } else { None }).collect();
    if keys.starts_with(&["vary", "values"]) && small.values.is_some() {
        problem.path[0] = Step::Key("small".into());
    } else if keys.first().is_some_and(|key| changed(key)) {
        problem.path.insert(0, Step::Key("small".into()));
    } else {
        problem.what = format!("with the changes of [small], {}", problem.what);
    }
    problem
}

fn small_lists(definition: &Definition) -> Checked {
    let at = At::top().key("small");
    if let Some(views) = &definition.small.views {
        let known: Vec<&str> = definition.view_names().collect();
        list(&at.key("views"), views, |name| match known.contains(&name) {
            true => Ok(name.to_owned()),
            false => Err(format!("no view is called `{name}`: {}", suggestion(name, &known))),
        })?;
    }
    if definition.small.values.is_some() && definition.vary.is_none() {
        at.key("values").fail("the definition varies no parameter: remove `values`, or add a [vary] section")?;
    }
    Ok(())
}

/// Checks that a list is neither empty nor too long, that `parse` accepts each entry, and that `parse` returns a different name for each entry.
fn list(at: &At, texts: &[String], parse: impl Fn(&str) -> Result<String, String>) -> Checked {
    if texts.is_empty() {
        return at.fail("is empty: give at least one entry");
    }
    if texts.len() > MAX_LIST {
        return at.fail(format!("has {} entries, more than {MAX_LIST}: split the experiment", texts.len()));
    }
    let mut names: Vec<String> = Vec::new();
    for (i, text) in texts.iter().enumerate() {
        let name = parse(text).or_else(|what| refuse(&at.index(i), what))?;
        if let Some(before) = names.iter().position(|known| *known == name) {
            return at.index(i).fail(format!("`{text}` is a duplicate of entry {}: remove one of them", before + 1));
        }
        names.push(name);
    }
    Ok(())
}

/// Checks what does not depend on the scene. [`small_lists`] checks the lists of `small`, and [`expected`] checks the expectations.
fn shape(definition: &Definition) -> Checked {
    let top = At::top();
    let name = top.key("name");
    name.file_stem(&definition.name)?;
    if !definition.name.is_ascii() {
        name.fail(format!(
            "`{}` names a folder, so it must be ASCII text: use letters A to Z and a to z, digits, - and _",
            definition.name
        ))?;
    }
    if definition.question.trim().is_empty() {
        top.key("question").fail("is empty: write the question that the run answers")?;
    }
    if definition.scene.is_some() && definition.import.is_some() {
        top.key("import").fail("`scene` and `import` are both given: remove one of them")?;
    }
    if let Some(import) = &definition.import {
        import_of(&top.key("import"), import, &definition.folder)?;
    }
    let [width, height] = definition.size;
    let pixels = u64::from(width) * u64::from(height);
    if !(1..=MAX_SIDE).contains(&width) || !(1..=MAX_SIDE).contains(&height) || pixels > MAX_PIXELS {
        top.key("size").fail(format!(
            "is {width} x {height}: each side must be 1 to {MAX_SIDE} pixels, and the picture must have at most {MAX_PIXELS} pixels"
        ))?;
    }
    let frames = top.key("frames");
    if definition.frames == 0 {
        frames.fail("is 0: give at least 1, or at least 2 for metrics that compare frames")?;
    }
    frames.within(f64::from(definition.frames), 1.0, f64::from(MAX_FRAMES))?;
    if definition.warm_up >= definition.frames {
        top.key("warm_up").fail(format!(
            "is {}, but there are {} frames, so none would be measured: give fewer frames to warm up, or more `frames`",
            definition.warm_up, definition.frames
        ))?;
    }
    let seeds = top.key("seeds");
    if definition.seeds == 1 {
        seeds.fail("is 1, but one seed has no variance: give 0 to omit bias and variance, or at least 2")?;
    }
    seeds.within(f64::from(definition.seeds), 0.0, f64::from(MAX_SEEDS))?;
    views(&top, definition)?;
    choices(&top, definition)?;
    let known = Signal::ALL.map(Signal::name);
    list(&top.key("signals"), &definition.signals, |text| match known.contains(&text) {
        true => Ok(text.to_owned()),
        false => Err(format!("`{text}` is not a signal: {}", suggestion(text, &known))),
    })?;
    let viewing = top.key("viewing");
    let Viewing { frames_per_second, pixels_per_degree } = definition.viewing;
    viewing.key("frames_per_second").within(frames_per_second, 1.0, 1000.0)?;
    let [low, high] = metrics::PIXELS_PER_DEGREE_RANGE.map(f64::from);
    viewing.key("pixels_per_degree").within(pixels_per_degree, low, high)?;
    top.key("times_budget_s").positive(definition.times_budget_s, MAX_TIMES_BUDGET_S)?;
    let reference = top.key("reference");
    let (spp, max_spp) = (definition.reference.spp, definition.reference.max_spp);
    if !spp.is_multiple_of(BATCH) || spp < BATCH * BATCHES {
        reference.key("spp").fail(format!(
            "is {spp}, must be a multiple of {BATCH} and at least {}: the reference takes at least {BATCHES} batches of {BATCH} samples",
            BATCH * BATCHES
        ))?;
    }
    if max_spp < spp || max_spp > MAX_SPP {
        reference.key("max_spp").fail(format!("is {max_spp}, must be at least `spp` ({spp}) and at most {MAX_SPP}"))?;
    }
    parameters(&top, definition)?;
    let count = plan_size(definition);
    if count > MAX_UNITS as u64 {
        top.fail(format!("the run would have {count} parts, but at most {MAX_UNITS} are allowed: split the definition into several"))?;
    }
    Ok(())
}

/// Returns an upper bound of the number of parts of the run, without listing the parts.
fn plan_size(definition: &Definition) -> u64 {
    let count = |length: usize| length.max(1) as u64;
    let settings = count(definition.vary.as_ref().map_or(1, |vary| vary.values.len()));
    let estimators = count(definition.estimators.len());
    let sweeps = estimators * count(definition.noises.len()) * count(definition.temporal.len());
    settings * count(definition.view_names().count()) * (1 + 2 * sweeps)
}

fn import_of(at: &At, import: &Import, folder: &Path) -> Checked {
    let of_world = |key: &'static str, value: Value| {
        let mut of_key = scene::settings().filter(|setting| setting.key.strip_prefix("world.") == Some(key));
        of_key.try_for_each(|setting| setting.accept(&value)).map_err(|what| at.key(key).problem(what))
    };
    import.metres_per_texel.map_or(Ok(()), |spacing| of_world("metres_per_texel", Value::Float(spacing)))?;
    if let Some([low, high]) = import.height_range_m {
        let range = at.key("height_range_m");
        of_world("height_range_m", Value::Array([low, high].map(Value::Float).to_vec()))?;
        if low >= high {
            range.fail(format!(
                "[{low}, {high}] must go from low to high: give the elevation of the smallest sample value, then that of the largest"
            ))?;
        }
    }
    of_world("detail_m", Value::Float(import.detail_m))?;
    let job = import.job(folder).or_else(|what| refuse(&at.key("heightmap"), what))?;
    if !job.heightmap.is_file() {
        at.key("heightmap").fail(format!(
            "there is no file {}: correct the name; relative names start at the folder of the definition",
            job.heightmap.display()
        ))?;
    }
    match &job.options.materials {
        Some(materials) if !materials.is_dir() => {
            at.key("materials").fail(format!("there is no folder {}: give a folder that holds images of materials", materials.display()))
        }
        _ => Ok(()),
    }
}

fn views(top: &At, definition: &Definition) -> Checked {
    if definition.view_names().next().is_none() {
        return top.key("views").fail("there is no view: name cameras and paths of the scene in `views`, or add a [[view]] that moves");
    }
    if !definition.views.is_empty() {
        list(&top.key("views"), &definition.views, |name| Ok(name.to_owned()))?;
    }
    let at = top.key("view");
    at.unique_names(definition.moving_views.iter().map(|view| view.name.as_str()))?;
    for (i, view) in definition.moving_views.iter().enumerate() {
        let at = at.index(i);
        at.key("name").file_stem(&view.name)?;
        if definition.views.contains(&view.name) {
            at.key("name").fail(format!("`{}` is among `views`, too: give the moving view a different name", view.name))?;
        }
        let step = at.key("step");
        let limit = match view.motion {
            Motion::Sideways | Motion::Forwards => 1.0e6,
            Motion::Turn => 180.0,
            Motion::Zoom => 170.0,
        };
        step.within(view.step, -limit, limit)?;
        // A step whose absolute value is below the smallest normal f64 number counts as 0.
        if view.step.abs() < f64::MIN_POSITIVE {
            step.fail(format!("is 0, so nothing moves: remove this [[view]], and name the camera `{}` in `views` instead", view.camera))?;
        }
    }
    Ok(())
}

/// Checks the names of variants, estimators, noises, resolves and metrics, and that a run of this definition can measure the metrics.
fn choices(top: &At, definition: &Definition) -> Checked {
    let variants = top.key("variants");
    list(&variants, &definition.variants, |text| match text {
        ALL_VARIANTS => Ok(text.to_owned()),
        _ => {
            super::variant_choice(text).map(variant_name).map_err(|error| format!("{error}; `auto`, `generic` and `all` are accepted, too"))
        }
    })?;
    if definition.variants.iter().any(|text| text == ALL_VARIANTS) {
        let forced = |text: &&String| matches!(super::variant_choice(text), Ok(VariantChoice::Forced(_)));
        if let Some(index) = definition.variants.iter().position(|text| forced(&text)) {
            variants.index(index).fail(format!(
                "`{}` is already included in `all`, which stands for all 31 variants: remove one of the two entries",
                definition.variants[index]
            ))?;
        }
    }
    list(&top.key("estimators"), &definition.estimators, |text| one_of("estimator", text, &Estimator::ALL.map(Estimator::name)))?;
    list(&top.key("noises"), &definition.noises, |text| one_of("noise", text, &NoiseKind::ALL.map(NoiseKind::name)))?;
    list(&top.key("temporal"), &definition.temporal, |text| one_of("temporal resolve", text, &Resolve::ALL.map(Resolve::name)))?;
    let at = top.key("metrics");
    if !definition.metrics.is_empty() {
        list(&at, &definition.metrics, |text| match metrics::known(text)?.needs {
            Needs::Clock => Err(format!("`{text}` is a device time, and the key `times` requests device times: remove it from `metrics`")),
            _ => Ok(text.to_owned()),
        })?;
    }
    for (i, text) in definition.metrics.iter().enumerate() {
        if text == metrics::POWER && definition.size.iter().any(|&side| side < metrics::SMALLEST_SIDE) {
            let least = metrics::SMALLEST_SIDE;
            at.index(i)
                .fail(format!("`power` is computed from a square with a side of at least {least} pixels: make both numbers of `size` {least} or more, or remove `power`"))?;
        }
        definition.why_not(text).or_else(|what| at.index(i).fail(what))?;
    }
    Ok(())
}

fn one_of(what: &str, text: &str, known: &[&str]) -> Result<String, String> {
    match known.contains(&text) {
        true => Ok(text.to_owned()),
        false => Err(format!("`{text}` is not a known {what}: {}", suggestion(text, known))),
    }
}

/// Checks the parameters of `vary` and `set` as far as this is possible without a scene. [`scenes`] does the other checks.
fn parameters(top: &At, definition: &Definition) -> Checked {
    let at = top.key("set");
    for (parameter, value) in &definition.settings {
        apply(&mut FrameSettings::default(), parameter, value).map_err(|what| at.key(parameter.clone()).sentence(what))?;
        finite(&at.key(parameter.clone()), value)?;
    }
    let Some(vary) = &definition.vary else { return Ok(()) };
    let at = top.key("vary");
    let texts: Vec<String> = vary.values.iter().map(setting_text).collect();
    if vary.parameter.trim().is_empty() {
        at.key("parameter").fail("is empty: name a scene setting (for example `blend.hash_scale`) or a frame setting (`frame.tile`)")?;
    }
    if definition.settings.contains_key(&vary.parameter) {
        at.key("parameter").fail(format!("`{}` is set in [set], too: remove one of the two keys", vary.parameter))?;
    }
    list(&at.key("values"), &texts, |text| Ok(text.to_owned()))?;
    for (i, value) in vary.values.iter().enumerate() {
        let at = at.key("values").index(i);
        finite(&at, value)?;
        if vary.parameter.starts_with(FRAME) {
            let place = if frame_parameters().contains(&vary.parameter.as_str()) { at } else { top.key("vary").key("parameter") };
            apply(&mut FrameSettings::default(), &vary.parameter, value).or_else(|what| place.fail(what))?;
        }
    }
    Ok(())
}

fn finite(at: &At, value: &Value) -> Checked {
    match value {
        Value::Float(number) if !number.is_finite() => at.fail(format!("is {number}: give a finite number")),
        Value::Array(items) => items.iter().try_for_each(|item| finite(at, item)),
        _ => Ok(()),
    }
}

/// Checks what depends on the scene, such as the cameras and paths that the definition names, the number of frames of paths, the fields of view of
/// zooms, and the settings of the scene. Also checks the expectations.
fn against(definition: &Definition, facts: &Facts) -> Checked {
    let top = At::top();
    let cameras: Vec<&str> = facts.cameras.iter().map(|(name, _)| name.as_str()).collect();
    let known: Vec<&str> = cameras.iter().copied().chain(facts.paths.iter().map(|(name, _)| name.as_str())).collect();
    for (i, name) in definition.views.iter().enumerate() {
        if !known.contains(&name.as_str()) {
            let what = format!("the scene has no camera or path `{name}`: {}", suggestion(name, &known));
            top.key("views").index(i).fail(what)?;
        }
        if let Some((_, most)) = facts.paths.iter().find(|(path, frames)| path == name && *frames < u64::from(definition.frames)) {
            let what = format!("{} frames are more than path `{name}` has: give at most {most}, or lengthen the path", definition.frames);
            top.key("frames").fail(what)?;
        }
    }
    for (i, view) in definition.moving_views.iter().enumerate() {
        let at = top.key("view").index(i);
        if known.contains(&view.name.as_str()) {
            at.key("name").fail(format!("`{}` is a camera or path of the scene: give the moving view its own name", view.name))?;
        }
        let Some((_, fov_deg)) = facts.cameras.iter().find(|(name, _)| *name == view.camera) else {
            at.key("camera").fail(format!("the scene has no camera `{}`: {}", view.camera, suggestion(&view.camera, &cameras)))?;
            continue;
        };
        if let (Motion::Zoom, Some(fov_deg)) = (view.motion, fov_deg) {
            let last = fov_deg - view.step * f64::from(definition.frames - 1);
            if !(1.0..=175.0).contains(&last) {
                at.key("step").fail(format!(
                    "gives a field of view of {last} degrees in the last of {} frames, but it must lie in 1..=175: reduce the step",
                    definition.frames
                ))?;
            }
        }
    }
    scenes(&top, definition, facts)?;
    let expect = top.key("expect");
    for (i, expectation) in definition.expectations.iter().enumerate() {
        expected(&expect.index(i), expectation, definition, facts)?;
    }
    Ok(())
}

/// Checks that the scene is valid with the settings in `set`, and with each value of the varied parameter. If a variant needs the virtual texture,
/// also checks that each of these scenes has one.
fn scenes(top: &At, definition: &Definition, facts: &Facts) -> Checked {
    let like;
    let text = match &facts.text {
        Some(text) => text,
        None => {
            // Before the import, settings that the import writes cannot be checked. If the definition changes one of them, this function checks
            // nothing; `check_imported` calls it again after the import.
            let data = |parameter: &str| {
                ["world", "material", "rule", "stroke", "camera", "path", "name", "description", "detail_size"]
                    .contains(&parameter.split('.').next().unwrap_or_default())
            };
            let varied = definition.vary.as_ref().is_some_and(|vary| data(&vary.parameter));
            if varied || definition.settings.keys().any(|parameter| data(parameter)) {
                return Ok(());
            }
            like = scene::text(scene::DEFAULT).or_else(|error| refuse(&top.key("import"), error.to_string()))?;
            &like
        }
    };
    let set = match definition.settings.keys().next() {
        Some(only) if definition.settings.len() == 1 => top.key("set").key(only.clone()),
        _ => top.key("set"),
    };
    let plain = definition.altered(text, &None).or_else(|refused| refuse(&set, refused.what))?;
    forced(top, definition, &plain)?;
    let Some(vary) = &definition.vary else { return Ok(()) };
    let at = top.key("vary");
    for (i, value) in vary.values.iter().enumerate() {
        let scene = definition.altered(text, &Some(value.clone())).or_else(|refused| match refused.unknown_key {
            true => refuse(&at.key("parameter"), refused.what),
            false => refuse(&at.key("values").index(i), refused.what),
        })?;
        forced(top, definition, &scene)?;
    }
    Ok(())
}

/// Refuses variants that use the virtual texture if the scene has no virtual texture.
fn forced(top: &At, definition: &Definition, scene: &Scene) -> Checked {
    if Requirements::of(scene).has(Flavour::VirtualTexture) {
        return Ok(());
    }
    let needs = |text: &String| match super::variant_choice(text) {
        Ok(VariantChoice::Forced(variant) | VariantChoice::GenericForced(variant)) => variant.has(Flavour::VirtualTexture),
        _ => text == ALL_VARIANTS,
    };
    match definition.variants.iter().position(needs) {
        None => Ok(()),
        Some(index) => top.key("variants").index(index).fail(format!(
            "`{}` needs `vt`, but the scene has no virtual texture: name variants without `vt`, or set flavours.far_atlas_m to more than 0",
            definition.variants[index]
        )),
    }
}

fn expected(at: &At, expectation: &Expectation, definition: &Definition, facts: &Facts) -> Checked {
    if expectation.claim.trim().is_empty() {
        at.key("claim").fail("is empty: say in a sentence what is expected")?;
    }
    let metric = metrics::known(&expectation.metric).or_else(|what| refuse(&at.key("metric"), what))?;
    // A metric that is measured although `metrics` does not list it is accepted, too.
    let measured = |name: &str| if definition.measures(name) { Ok(()) } else { definition.why_not(name) };
    measured(&expectation.metric).or_else(|what| at.key("metric").fail(what))?;
    if metric.needs == Needs::Clock {
        let pass = expectation.metric.split_once(':').map_or("", |(_, pass)| pass);
        if !facts.passes.contains(&pass) {
            at.key("metric").fail(format!("no pass is called `{pass}`: {}", suggestion(pass, &facts.passes)))?;
        }
        if expectation.over.is_none() && metrics::timed_pass(&expectation.metric).is_some() {
            let ratio = metrics::ratio_of(pass);
            at.key("metric")
                .fail(format!("a time is only meaningful relative to another time of the same run: write `{ratio}`, or give `over`"))?;
        }
    }
    let [low, high] = expectation.range;
    let range = at.key("range");
    if low.is_nan() || high.is_nan() {
        range.fail("has a limit that is not a number: give the smallest and the largest value; inf and -inf are allowed")?;
    }
    if low > high {
        range.fail(format!("[{low}, {high}] is reversed: write [{high}, {low}]"))?;
    }
    let selection = at.key("where");
    let without_albedo = !definition.measured_signals().contains(&Signal::Albedo);
    if metric.signals == Signals::Each && without_albedo && !expectation.selection.contains_key("signal") {
        selection.fail("selects no rows, because the run measures only the lit picture: give `signal = \"lit\"` in it")?;
    }
    for (column, value) in &expectation.selection {
        selected(&selection.key(column.clone()), column, value, metric, definition)?;
    }
    let Some(over) = &expectation.over else { return Ok(()) };
    let place = at.key("over");
    let mut other = metric;
    if let Some(value) = over.get("metric") {
        let name = value.as_str().unwrap_or_default();
        other = metrics::known(name).or_else(|what| refuse(&place.key("metric"), what))?;
        measured(name).or_else(|what| place.key("metric").fail(what))?;
    }
    for (column, value) in over.iter().filter(|(column, _)| *column != "metric") {
        selected(&place.key(column.clone()), column, value, other, definition)?;
    }
    let same_metric = over.get("metric").is_none_or(|value| value.as_str() == Some(expectation.metric.as_str()));
    let same = |(column, value): (&String, &Value)| column == "metric" || expectation.selection.get(column) == Some(value);
    if same_metric && over.iter().all(same) {
        place.fail("selects the same rows as `where`, so the ratio is always 1: give a column a different value than in `where`")?;
    }
    Ok(())
}

/// Checks that a row of the run can have this value in this column, as far as this is known before the run.
fn selected(at: &At, column: &str, value: &Value, metric: &metrics::Metric, definition: &Definition) -> Checked {
    let columns =
        ["scene", "view", "variant", "estimator", "noise", "temporal", "signal", "parameter", "setting", "frame", "lag", "frequency"];
    if !columns.contains(&column) {
        return at.fail(format!("rows cannot be selected by `{column}`: {}", suggestion(column, &columns)));
    }
    let Some(known) = Row::column(column) else { return at.fail("is not a column") };
    let among = |what: &str, names: &[&str]| {
        let text = setting_text(value);
        match text.is_empty() || names.contains(&text.as_str()) {
            true => Ok(()),
            false => at.fail(format!("no row has {what} `{text}`: {}", suggestion(&text, names))),
        }
    };
    let texts = |list: &[String]| -> Vec<String> { list.to_vec() };
    let names: Vec<String> = match column {
        "view" => definition.view_names().map(str::to_owned).collect(),
        "variant" => {
            definition.variant_choices().or_else(|error| refuse(at, error.to_string()))?.into_iter().map(|(name, _)| name).collect()
        }
        "estimator" => texts(&definition.estimators),
        "noise" if metric.needs == Needs::Clock && definition.times == Times::FirstNoise => texts(&definition.noises[..1]),
        "noise" => texts(&definition.noises),
        "temporal" => texts(&definition.temporal),
        "signal" => match metric.signals {
            Signals::None => return at.fail(format!("`{}` has no signal: remove `signal`", metric.name)),
            Signals::Albedo => vec![Signal::Albedo.name().to_owned()],
            Signals::Each => texts(&definition.signals),
        },
        "parameter" => definition.vary.iter().map(|vary| vary.parameter.clone()).collect(),
        "setting" => definition.vary.iter().flat_map(|vary| vary.values.iter().map(setting_text)).collect(),
        _ => Vec::new(),
    };
    match known.field {
        // Any name of a scene is accepted, because the name of an imported scene is not known before the import.
        Field::Text(..) if column == "scene" => Ok(()),
        Field::Text(..) => among(column, &names.iter().map(String::as_str).collect::<Vec<_>>()),
        Field::Count(..) => {
            let last = definition.frames - 1;
            let (low, high) = if column == "lag" { (1, last.min(LAGS)) } else { (0, last) };
            if column == "lag" && metric.axis != Axis::Lag {
                at.fail(format!("`{}` is not measured for each lag: remove `lag`", metric.name))?;
            }
            match value.as_integer() {
                Some(number) if (i64::from(low)..=i64::from(high)).contains(&number) => Ok(()),
                _ => at.fail(format!("no row has {column} {value}: give a whole number from {low} to {high}")),
            }
        }
        Field::Number(..) | Field::Value(..) => {
            if metric.axis != Axis::Frequency {
                at.fail(format!("`{}` is not a spectrum, so its rows have no frequency: remove `frequency`", metric.name))?;
            }
            match value.as_float().or_else(|| value.as_integer().map(|number| number as f64)) {
                Some(number) if number.is_finite() => Ok(()),
                _ => at.fail(format!("{value} is not a frequency: give cycles per pixel, 0 to 0.5")),
            }
        }
    }
}

//! `demo`: the main job in small. One view of the built-in world by all 31 variants, automatic choice and the generic kernel, over many seeds;
//! what each costs and how far it is from the exact blend, as tables, pictures and a report.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context, Result};
use kernels::camera::Pose;
use kernels::frame::{Progress, RenderRequest, Renderer, VariantChoice};
use kernels::gpu::Gpu;
use kernels::picture::{self, AovSet, Picture};
use kernels::scene;
use kernels::shading::{Estimator, VARIANCE_SCALE};
use kernels::variant::{Flavour, Variant};

use super::{Reporter, check_interrupted, print, watch_interrupts};
use crate::cli::DemoArgs;
use crate::measure::{Reference, SeedStatistics, rmse};
use crate::report::{self, DemoResults, GoldenRow, Mode, PictureEntry, VariantRow};

/// What the demo renders: a way to choose variants, and its name in tables.
struct Candidate {
    name: String,
    mode: Mode,
    choice: VariantChoice,
    variant: Option<Variant>,
}

fn candidates() -> Vec<Candidate> {
    let forced =
        Variant::all().map(|v| Candidate { name: v.to_string(), mode: Mode::Forced, choice: VariantChoice::Forced(v), variant: Some(v) });
    let auto = Candidate { name: "auto".to_owned(), mode: Mode::Auto, choice: VariantChoice::Auto, variant: None };
    let generic = Candidate { name: "generic".to_owned(), mode: Mode::Generic, choice: VariantChoice::GenericAuto, variant: None };
    [auto, generic].into_iter().chain(forced).collect()
}

/// Runs the demo and writes its report.
pub(crate) fn run(args: &DemoArgs) -> Result<()> {
    let started = Instant::now();
    fs::create_dir_all(&args.out).with_context(|| format!("cannot make the folder {}: choose another with --out", args.out.display()))?;
    super::check_writable(&args.out)?;
    let scene = scene::load(scene::DEFAULT)?;
    let camera = scene
        .cameras
        .iter()
        .find(|c| c.name == args.camera)
        .with_context(|| super::render::no_such("camera", &args.camera, &scene, scene.cameras.iter().map(|c| c.name.as_str())))?;
    watch_interrupts()?;
    let gpu = Gpu::new()?;
    let reporter = Reporter::new();
    // Once the sweep runs, its own count is the progress; nodes and shaders come by the way.
    let sweeping = AtomicBool::new(false);
    let show = |p: Progress| {
        if !sweeping.load(Ordering::Relaxed) {
            reporter.report(&p.stage, p.done, p.total);
        }
    };
    let mut renderer = Renderer::new(&gpu, &scene, &show)?;
    let pose = Pose::of(camera, |x, y| renderer.ground_m(x, y));
    let albedo = AovSet::from_names(&["albedo"])?;
    let base = RenderRequest { aovs: albedo, keep_geometry: true, ..RenderRequest::new(pose, args.size) };

    // The 96-fetch blend at the same sample points: what every variant is an approximation of.
    let truth = renderer.render(&RenderRequest {
        variant: VariantChoice::Forced(Variant::only(Flavour::Splat)),
        two_tilings: true,
        ..base.clone()
    })?;
    let truth = Reference::of(&truth)?;

    sweeping.store(true, Ordering::Relaxed);
    let mut pictures = Gallery { folder: &args.out, entries: Vec::new() };
    let candidates = candidates();
    let total = candidates.len() as u64 * u64::from(args.seeds);
    let mut rows = Vec::new();
    for (index, candidate) in (0..).zip(&candidates) {
        let request = RenderRequest { variant: candidate.choice, ..base.clone() };
        let step = |done: u32| reporter.report("variants x seeds", index * u64::from(args.seeds) + u64::from(done), total);
        step(0);
        rows.push(measure(&mut renderer, &request, candidate, args.seeds, &truth, &mut pictures, &step)?);
    }
    pictures.keep(
        "reference",
        "96-fetch reference",
        "Every pixel: three projections, four materials, two tilings, all blended.",
        &truth.picture,
    )?;
    pictures.variants(&mut renderer, &base)?;

    let results = DemoResults {
        adapter: gpu.info.name.clone(),
        driver: format!("{} {}", gpu.info.driver, gpu.info.driver_info).trim().to_owned(),
        software: gpu.is_software(),
        command: format!(
            "experiments demo --out {} --size {}x{} --seeds {} --camera {}",
            args.out.display(),
            args.size[0],
            args.size[1],
            args.seeds,
            args.camera
        ),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        scene: scene.name.clone(),
        camera: args.camera.clone(),
        size: args.size,
        seeds: args.seeds,
        seconds: started.elapsed().as_secs_f64(),
        golden: golden(&rows),
        rows,
        pictures: pictures.entries,
    };
    report::write(&args.out, &results)?;
    reporter.finish();
    print(&summary(&results, &args.out))
}

/// One candidate over all seeds: cost, bias and variance against the exact blend, error against the reference.
fn measure(
    renderer: &mut Renderer<'_>,
    request: &RenderRequest,
    candidate: &Candidate,
    seeds: u32,
    truth: &Reference,
    pictures: &mut Gallery<'_>,
    step: &dyn Fn(u32),
) -> Result<VariantRow> {
    // The generic kernel equals the variants in colour and in fetches (tested on all 31), and one pipeline of it serves all sets of flavours;
    // what stands in the golden table is counted by the variant's own kernel.
    let generic = match request.variant {
        VariantChoice::Forced(v) => VariantChoice::GenericForced(v),
        _ => VariantChoice::GenericAuto,
    };
    let single = candidate.variant.is_some_and(|v| v.flavours().count() == 1);
    let counter = if single { request.variant } else { generic };
    let counted = renderer.render(&RenderRequest { count_fetches: true, variant: counter, ..request.clone() })?;
    let stochastic = candidate.variant.is_none_or(|v| v.has(Flavour::NearCliff) || v.has(Flavour::FarCliff));
    // The fastest run of each pass: candidates run one after the other, so the machine's other work must not pass for a slow shader.
    let mut times: BTreeMap<String, f64> = BTreeMap::new();
    let mut statistics = SeedStatistics::new(truth.terrain());
    let mut first_error = 0.0;
    // Flavours that draw nothing look the same for every seed; they still run often enough for a median of their times.
    let runs = if stochastic { seeds } else { seeds.min(3) };
    for seed in 0..runs {
        check_interrupted()?;
        let picture = renderer.render(&RenderRequest { seed, keep_geometry: seed >= 3, ..request.clone() })?;
        for (pass, ms) in &picture.passes {
            let fastest = times.entry(pass.clone()).or_insert(f64::INFINITY);
            *fastest = fastest.min(*ms);
        }
        let albedo = picture.vectors("albedo").context("the albedo layer was asked for")?;
        if seed == 0 {
            first_error = rmse(albedo, truth.albedo(), truth.terrain());
            if candidate.variant.is_none_or(|v| v.flavours().count() == 1) {
                let caption = format!("{:.1} fetches per pixel", counted.fetches_per_px.unwrap_or(0.0));
                pictures.keep(&candidate.name, &candidate.name, &caption, &picture)?;
            }
        }
        statistics.add(albedo);
        step(seed + 1);
    }
    let (mut bias, mut bias_standard_error, mut variance_theory) = (0.0, 0.0, 0.0);
    if stochastic {
        let exact = renderer.render(&RenderRequest { estimator: Estimator::Exact, variant: generic, ..request.clone() })?;
        let bias_of = statistics.bias(exact.vectors("albedo").context("the albedo layer was asked for")?);
        (bias, bias_standard_error) = (bias_of.value, bias_of.standard_error);
        let theory = renderer.render(&RenderRequest { estimator: Estimator::Variance, variant: generic, ..request.clone() })?;
        let theory = theory.vectors("albedo").context("the albedo layer was asked for")?;
        variance_theory = truth.terrain_mean(theory) / VARIANCE_SCALE;
    }
    Ok(VariantRow {
        name: candidate.name.clone(),
        mode: candidate.mode,
        mask: candidate.variant.map_or(0, Variant::mask),
        promised_fetches: candidate.variant.map(Variant::promised_fetches),
        fetches_per_px: counted.fetches_per_px.unwrap_or(0.0),
        gpu_ms: times,
        bias,
        bias_standard_error,
        variance: statistics.variance(),
        variance_theory,
        rmse_reference: first_error,
    })
}

/// The promised fetch counts of the five flavours beside the counted ones.
fn golden(rows: &[VariantRow]) -> Vec<GoldenRow> {
    Flavour::ALL
        .into_iter()
        .filter_map(|flavour| {
            let row = rows.iter().find(|r| r.mode == Mode::Forced && r.mask == flavour.bit())?;
            // The built-in scene has no colour modulation.
            Some(GoldenRow::of(flavour.name().to_owned(), flavour, row.fetches_per_px, false))
        })
        .collect()
}

/// The pictures of the report.
struct Gallery<'a> {
    folder: &'a Path,
    entries: Vec<PictureEntry>,
}

/// A colour for each flavour in maps of variants; a tile of several has their mean.
const FLAVOUR_COLOURS: [[u16; 3]; 5] = [[86, 180, 90], [70, 110, 200], [213, 94, 60], [230, 170, 60], [150, 90, 190]];

impl Gallery<'_> {
    fn keep(&mut self, name: &str, title: &str, caption: &str, picture: &Picture) -> Result<()> {
        let file = format!("{name}.png");
        picture::write_png(&self.folder.join(&file), picture)?;
        self.entries.push(PictureEntry { file, title: title.to_owned(), caption: caption.to_owned() });
        Ok(())
    }

    /// Which tile runs which variant, mixed half and half with the picture.
    fn variants(&mut self, renderer: &mut Renderer<'_>, base: &RenderRequest) -> Result<()> {
        let picture = renderer.render(&RenderRequest { aovs: AovSet::from_names(&["variant"])?, ..base.clone() })?;
        let masks = picture.values("variant").context("the variant layer was asked for")?;
        let texels: Vec<[u8; 3]> = masks
            .iter()
            .zip(&picture.hdr)
            .map(|(&mask, hdr)| {
                let seen = picture::tone_map([hdr[0], hdr[1], hdr[2]]);
                let mask = mask as u32;
                let set: Vec<_> = (0..5).filter(|bit| mask >> bit & 1 == 1).map(|bit| FLAVOUR_COLOURS[bit]).collect();
                if set.is_empty() {
                    return seen;
                }
                std::array::from_fn(|k| {
                    let mean = set.iter().map(|c| c[k]).sum::<u16>() / set.len() as u16;
                    u8::try_from((mean + u16::from(seen[k])) / 2).unwrap_or(u8::MAX)
                })
            })
            .collect();
        let file = "variants.png".to_owned();
        picture::write_png_texels(&self.folder.join(&file), picture.size, &texels)?;
        let caption =
            "Green: virtual texture, blue: far atlas, red: near cliff, orange: far cliff, violet: splat; mixtures: tiles of several.";
        self.entries.push(PictureEntry { file, title: "Which tile runs what (auto)".to_owned(), caption: caption.to_owned() });
        Ok(())
    }
}

fn summary(results: &DemoResults, out: &Path) -> String {
    let ms = |name: &str| results.rows.iter().find(|r| r.name == name).and_then(|r| r.gpu_ms.get("shading")).copied().unwrap_or(f64::NAN);
    let mut text = format!("{} of scene `{}`, camera `{}`\n", results.adapter, results.scene, results.camera);
    for row in &results.golden {
        text += &format!(
            "  {:<11} {:>6.2} fetches per pixel, promised {:<4} {}\n",
            row.flavour,
            row.counted,
            row.promised,
            if row.agrees { "agrees" } else { "DIFFERS" }
        );
    }
    text += &format!(
        "shading by auto is {:.1} times as fast as full splat everywhere and {:.2} times as fast as the generic kernel\n",
        ms("splat") / ms("auto"),
        ms("generic") / ms("auto")
    );
    text += &format!("{:.0} s; report: {}\n", results.seconds, out.join("report.html").display());
    text
}

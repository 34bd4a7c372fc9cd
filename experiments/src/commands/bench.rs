//! `bench`: measures times on the built-in world, and prints ratios of times. Next to each ratio, it prints the target of the project.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use kernels::base::files::write_whole;
use kernels::base::progress::Progress;
use kernels::composition::{Destination, Layers};
use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::gpu::Gpu;
use kernels::motion::LAGS;
use kernels::scene;
use kernels::temporal::Resolve;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use statrs::statistics::{Data, Median as _};

use super::{Reporter, check_output_file, print};
use crate::cli::BenchArgs;
use crate::metrics;
use crate::process::{check_interrupted, watch_interrupts};

/// The median times in milliseconds. The key is camera, choice of variants, and pass.
type Times = BTreeMap<(String, String, String), f64>;

// The three passes below are timed with the wall clock. Timestamps of the device are not used for them, because those of a software adapter include
// waiting.
/// The time of rendering a frame, from the request to the end of the device's work.
const FRAME: &str = "frame (wall clock)";
/// The time of reading a frame back as the workbench does: the linear picture, the displayed picture, and the layers of live metrics.
const READING: &str = "reading back (wall clock)";
/// The time of measuring a frame with the metrics that compare the frames of a sequence.
const MEASURING: &str = "measuring (wall clock)";

fn is_wall_clock(pass: &str) -> bool {
    [FRAME, READING, MEASURING].contains(&pass)
}

const AUTO: &str = "auto";
const GENERIC: &str = "generic";
const VIEWS: [&str; 2] = ["cliff", "ground"];

/// Measures the times and prints their ratios.
pub(crate) fn run(args: &BenchArgs) -> Result<()> {
    if let Some(file) = &args.record {
        check_output_file(file)?;
    }
    watch_interrupts()?;
    let scene = scene::load(scene::DEFAULT)?;
    let gpu = Gpu::new()?;
    let reporter = Reporter::new();
    let show = |p: Progress| reporter.report(&p.stage, p.done, p.total);
    let mut renderer = Renderer::new(&gpu, &scene, &show)?;
    let mut choices = vec![(AUTO.to_owned(), VariantChoice::Auto), (GENERIC.to_owned(), VariantChoice::GenericAuto)];
    choices.extend(Flavour::ALL.map(|f| (f.name().to_owned(), VariantChoice::Forced(Variant::only(f)))));
    let mut times = Times::new();
    for camera in scene.cameras.iter().filter(|c| VIEWS.contains(&c.name.as_str())) {
        let pose = Pose::of(camera, |x, y| renderer.ground_m(x, y));
        // The first round warms up pipelines, nodes and pages. In each round, all choices take turns, so that a drift of the machine's speed affects
        // them equally.
        let mut samples: BTreeMap<(String, String), Vec<f64>> = BTreeMap::new();
        for round in 0..=args.repeats {
            for (name, choice) in &choices {
                check_interrupted()?;
                let report = renderer.draw(&RenderRequest::new(pose, args.size).with(|r| r.shading.variant = *choice))?.into_report();
                if round > 0 {
                    for pass in report.passes {
                        samples.entry((name.clone(), pass.name)).or_default().push(pass.time_ms);
                    }
                }
            }
        }
        for (pass, ms) in measuring(&mut renderer, pose, args)? {
            samples.insert((AUTO.to_owned(), pass.to_owned()), ms);
        }
        for ((name, pass), ms) in samples {
            times.insert((camera.name.clone(), name, pass), Data::new(ms).median());
        }
    }
    reporter.finish();
    if let Some(file) = &args.record {
        record(file, &gpu, args, &times)?;
    }
    print(&text(&gpu, args, &times))
}

/// Measures three durations for each frame, in milliseconds: rendering the frame with automatically chosen variants, reading it back, and measuring
/// the changes from the four previous frames. The measurement also composes the picture; the duration of this step is subtracted.
fn measuring(renderer: &mut Renderer<'_>, pose: Pose, args: &BenchArgs) -> Result<[(&'static str, Vec<f64>); 3]> {
    let layers = Layers::new(renderer.gpu(), args.size);
    let mut meter = renderer.meter(args.size, &[Resolve::Off])?;
    let all = Flavour::ALL.into_iter().fold(0, |mask, flavour| mask | flavour.bit());
    let all = Variant::new(all).context("the set of all flavours is not a variant")?;
    let (mut frames, mut readings, mut measures) = (Vec::new(), Vec::new(), Vec::new());
    let layers_read = AovSet::from_names(&["albedo", "choice"])?;
    for frame in 0..LAGS as u32 + args.repeats {
        check_interrupted()?;
        let request = RenderRequest::new(pose, args.size).with(|r| r.shading.frame = frame);
        let began = Instant::now();
        renderer.draw(&request)?;
        let drawn = began.elapsed();
        let shown = renderer.draw(&request.with(|r| {
            r.outputs.aovs = layers_read;
            r.outputs.displayed = true;
        }))?;
        let began = Instant::now();
        shown.read()?;
        let read = began.elapsed();
        let stream = renderer.composition().stream(None);
        let shaded = renderer.draw_flavours(&request, all, &layers)?;
        let began = Instant::now();
        shaded.compose(&layers, &[Destination { stream, signal: &meter.streams[0].signal, offset: meter.slots().now }])?;
        let composed = began.elapsed();
        let began = Instant::now();
        shaded.measure(&layers, &mut meter, &[None])?;
        let measured = began.elapsed();
        if frame >= LAGS as u32 {
            frames.push(drawn.as_secs_f64() * 1e3);
            readings.push(read.as_secs_f64() * 1e3);
            measures.push((measured.as_secs_f64() - composed.as_secs_f64()) * 1e3);
        }
    }
    Ok([(FRAME, frames), (READING, readings), (MEASURING, measures)])
}

fn shading(times: &Times, camera: &str, choice: &str) -> f64 {
    times.get(&(camera.to_owned(), choice.to_owned(), "shading".to_owned())).copied().unwrap_or(f64::NAN)
}

/// Returns the time of the classification pass as a share of the device time of a frame with automatically chosen variants.
fn classification_share(times: &Times, camera: &str) -> f64 {
    let of_frame: Vec<_> = times.iter().filter(|((c, name, pass), _)| c == camera && name == AUTO && !is_wall_clock(pass)).collect();
    let all: f64 = of_frame.iter().map(|(_, ms)| **ms).sum();
    of_frame.iter().filter(|((_, _, pass), _)| pass == "classification").map(|(_, ms)| **ms).sum::<f64>() / all
}

fn text(gpu: &Gpu, args: &BenchArgs, times: &Times) -> String {
    let kind = if gpu.is_software() { ", a software adapter" } else { "" };
    let mut out = format!("{}{kind}; {}x{}, median of {}\n", gpu.info.name, args.size[0], args.size[1], args.repeats);
    for camera in VIEWS {
        let ms = |choice: &str| shading(times, camera, choice);
        out += &format!("camera {camera}\n");
        out += &format!("  {:<46} {:>6.2}   target: 3\n", "full splat / auto, shading", ms("splat") / ms(AUTO));
        out += &format!("  {:<46} {:>6.2}   target: above 1\n", "generic kernel / auto, shading", ms(GENERIC) / ms(AUTO));
        out += &format!("  {:<46} {:>6.2}   target: 3\n", "full splat / far cliff, same pixels", ms("splat") / ms("far-cliff"));
        out += &format!("  {:<46} {:>6.2}   target: 2\n", "full splat / near cliff, same pixels", ms("splat") / ms("near-cliff"));
        out += &format!(
            "  {:<46} {:>5.1} %  target: below 10 %\n",
            "classification, share of the frame",
            100.0 * classification_share(times, camera)
        );
        let wall = |pass: &str| times.get(&(camera.to_owned(), AUTO.to_owned(), pass.to_owned())).copied().unwrap_or(f64::NAN);
        out += &format!(
            "  {:<46} {:>5.1} %  target: below 5 %\n",
            "reading back / rendering a frame, wall clock",
            100.0 * wall(READING) / wall(FRAME)
        );
        out += &format!(
            "  {:<46} {:>5.1} %  target: below 10 %\n",
            "measuring / rendering a frame, wall clock",
            100.0 * wall(MEASURING) / wall(FRAME)
        );
    }
    out
}

fn record(file: &Path, gpu: &Gpu, args: &BenchArgs, times: &Times) -> Result<()> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record([
        "adapter", "driver", "software", "scene", "camera", "width", "height", "variant", "pass", "metric", "unit", "value",
    ])?;
    for ((camera, variant, pass), ms) in times {
        let software = gpu.is_software().to_string();
        let [width, height] = args.size.map(|n| n.to_string());
        let row = [&gpu.info.name, &gpu.info.driver_info, &software, scene::DEFAULT, camera, &width, &height, variant, pass];
        csv.write_record(row.into_iter().map(ToString::to_string).chain([
            if is_wall_clock(pass) { "wall_ms" } else { metrics::TIME }.to_owned(),
            "ms".to_owned(),
            format!("{ms:.4}"),
        ]))?;
    }
    let bytes = csv.into_inner().context("cannot complete the CSV table")?;
    Ok(write_whole(file, |temporary| {
        std::fs::write(temporary, &bytes).map_err(|source| kernels::base::error::Error::File { file: temporary.to_owned(), source })
    })?)
}

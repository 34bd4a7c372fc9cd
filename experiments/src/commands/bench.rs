//! `bench`: measures times on the built-in world, and counts the patches that culling removes on a flight of 10 km. Prints ratios of times and the
//! share of removed patches, each next to the target of the project. Then simulates streaming of terrain nodes on the same flight, and measures starts
//! with an empty and a filled cache.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use anyhow::{Context, Result};
use kernels::base::files::write_whole;
use kernels::base::progress::Progress;
use kernels::composition::{Destination, Layers};
use kernels::culling::Culls;
use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, Renderer, VariantChoice};
use kernels::gpu::Gpu;
use kernels::metrics::{PerceivedFilter, Track, Viewing, read_signal};
use kernels::motion::LAGS;
use kernels::scene;
use kernels::shared::signal::Signal;
use kernels::temporal::Resolve;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera::Pose;
use serde::Serialize;

use super::{Reporter, check_output_file, print, print_json};
use crate::cli::BenchArgs;
use crate::metrics::{self, SHADING_PASS};
use crate::process::{check_interrupted, watch_interrupts};
use crate::rounds::{self, Estimate, Key, Plan, Samples, Timed, Turn, Wanted};

mod flight;
mod start;
mod streaming;

use flight::Flight;
use streaming::Streamed;

// The next four times are measured with the wall clock, apart from the occlusion culling in `DECIDING`. Timestamps of the device are not used,
// because on a software adapter the time between two timestamps includes waiting.
/// The time of rendering a frame, from the request to the end of the device's work.
const FRAME: &str = "frame (wall clock)";
/// The time of reading a frame back as the workbench does: the linear picture, the displayed picture, and the layers of live metrics.
const READING: &str = "reading back (wall clock)";
/// The time of measuring a frame with the metrics that compare the frames of a sequence.
const MEASURING: &str = "measuring (wall clock)";
/// The time of deciding what is drawn: a CPU time plus the device times of occlusion culling. The CPU time is the wall-clock time of selecting and
/// loading nodes, culling patches, and uploading the list of patches. The wall clock cannot separate occlusion culling from the other passes. This
/// time is therefore not measured on an adapter without timestamps.
const DECIDING: &str = "deciding what is drawn";

/// Whether a time is measured in the rounds for wall-clock times.
fn is_wall_clock(pass: &str) -> bool {
    [FRAME, READING, MEASURING, DECIDING].contains(&pass)
}

/// The sum of the device times of a picture's passes.
const ALL_PASSES: &str = "all passes";

const AUTO: &str = "auto";
const GENERIC: &str = "generic";
const VIEWS: [&str; 2] = ["cliff", "ground"];

/// The candidate that culls patches only by the frustum test. As the height range of a patch, it uses that of the node.
const FRUSTUM_ONLY: &str = "frustum only";
/// The candidate with an accepted geometry error of half a pixel.
const HALF_A_PIXEL: &str = "geometry error of half a pixel";
/// The sum of the device times of the passes of geometry and occlusion culling.
const GEOMETRY: &str = "geometry and occlusion";
/// Name of the passes of occlusion culling.
const OCCLUSION_PASS: &str = "occlusion";

/// One of the timed ways to draw the frame.
struct Candidate {
    name: &'static str,
    variant: VariantChoice,
    culls: Culls,
    /// The accepted geometry error (`frame.geometry_error`), pixels.
    error_px: f64,
}

/// Returns the timed ways to draw the frame. First are the variants, with `auto` at index 0. Then follow candidates with less culling. The last
/// candidate has all culling and fewer vertices.
fn candidates() -> Vec<Candidate> {
    let of = |(name, variant)| Candidate { name, variant, culls: Culls::ALL, error_px: 0.0 };
    let without = |name, culls| Candidate { culls, ..of((name, VariantChoice::Auto)) };
    let coarse = Candidate { error_px: 0.5, ..of((HALF_A_PIXEL, VariantChoice::Auto)) };
    let variants = [(AUTO, VariantChoice::Auto), (GENERIC, VariantChoice::GenericAuto)].into_iter();
    let flavours = Flavour::ALL.map(|flavour| (flavour.name(), VariantChoice::Forced(Variant::only(flavour))));
    let culls = [
        without(FRUSTUM_ONLY, Culls::FRUSTUM),
        without("without patch heights", Culls { patch_heights: false, ..Culls::ALL }),
        without("without cones", Culls { back_faces: false, ..Culls::ALL }),
        without("without occlusion", Culls { occlusion: false, ..Culls::ALL }),
        without("without order and occlusion", Culls { nearest_first: false, ..Culls::ALL }),
    ];
    variants.chain(flavours).map(of).chain(culls).chain([coarse]).collect()
}

/// A ratio of two times that is printed.
struct Ratio {
    /// Name in the output of `--json`.
    name: &'static str,
    /// Name in the text.
    words: &'static str,
    /// Candidate and pass of the numerator.
    of: (&'static str, &'static str),
    /// Candidate and pass of the denominator.
    over: (&'static str, &'static str),
    /// The target of the project for this ratio, as text.
    target: &'static str,
    /// Whether the ratio is printed in percent.
    is_share: bool,
}

/// Returns a ratio of two shading times.
const fn shading(name: &'static str, words: &'static str, of: &'static str, over: &'static str, target: &'static str) -> Ratio {
    Ratio { name, words, of: (of, SHADING_PASS), over: (over, SHADING_PASS), target, is_share: false }
}

/// Returns a ratio of two times of the candidate `auto`. The ratio is printed in percent.
const fn share(name: &'static str, words: &'static str, of: &'static str, over: &'static str, target: &'static str) -> Ratio {
    Ratio { name, words, of: (AUTO, of), over: (AUTO, over), target, is_share: true }
}

/// Returns the ratio of the geometry time of `auto` to that of a candidate with less culling.
const fn geometry(name: &'static str, words: &'static str, over: &'static str, target: &'static str) -> Ratio {
    Ratio { name, words, of: (AUTO, GEOMETRY), over: (over, GEOMETRY), target, is_share: false }
}

static RATIOS: [Ratio; 14] = [
    shading("splat_over_auto", "full splat / auto, shading", "splat", AUTO, "3"),
    shading("generic_over_auto", "generic kernel / auto, shading", GENERIC, AUTO, "above 1"),
    shading("splat_over_far_cliff", "full splat / far cliff, same pixels", "splat", "far-cliff", "3"),
    shading("splat_over_near_cliff", "full splat / near cliff, same pixels", "splat", "near-cliff", "2"),
    geometry("geometry_over_frustum_only", "geometry, all culling / frustum only", FRUSTUM_ONLY, "at most 0.5"),
    geometry("geometry_over_node_heights", "geometry, all culling / without patch heights", "without patch heights", "below 1"),
    geometry("geometry_over_back_faces", "geometry, all culling / without cones", "without cones", "below 1"),
    geometry("geometry_over_no_occlusion", "geometry, all culling / without occlusion", "without occlusion", "below 1"),
    geometry("geometry_over_any_order", "geometry, all culling / without order and occlusion", "without order and occlusion", "below 1"),
    Ratio {
        name: "half_a_pixel_over_every_vertex",
        words: "geometry, error of 0.5 px / every vertex",
        of: (HALF_A_PIXEL, GEOMETRY),
        over: (AUTO, GEOMETRY),
        target: "below 1",
        is_share: false,
    },
    share("classification_share", "classification, share of the frame", "classification", ALL_PASSES, "below 10 %"),
    share("reading_share", "reading back / rendering a frame, wall clock", READING, FRAME, "below 5 %"),
    share("pipeline_share", "selecting and culling / rendering a frame", DECIDING, FRAME, "at most 5 %"),
    share("measuring_share", "measuring / rendering a frame, wall clock", MEASURING, FRAME, "below 12 %"),
];

impl Ratio {
    fn is_wall_clock(&self) -> bool {
        is_wall_clock(self.of.1)
    }

    /// Returns the keys of the two times; `None` if a candidate has an unknown name. The candidate `auto` has index 0 both in the device times and in
    /// the wall-clock times, so its keys are valid in both.
    fn keys(&self) -> Option<[Key<'static>; 2]> {
        let key = |(name, pass): (&'static str, &'static str)| Some((candidates().iter().position(|other| other.name == name)?, pass));
        Some([key(self.of)?, key(self.over)?])
    }
}

/// Returns the ratios for which `decides` holds. Further rounds are drawn while the interval of one of these ratios is too wide and the budget lasts.
fn wanted(decides: fn(&Ratio) -> bool) -> Vec<Wanted<'static>> {
    RATIOS.iter().filter(|ratio| decides(ratio)).filter_map(Ratio::keys).map(|[of, over]| Wanted { of, over: Some(over) }).collect()
}

/// The times that were measured with one camera of the scene.
struct Measured {
    camera: String,
    /// Device times of all [`candidates`].
    device: Samples,
    /// Wall-clock times of the candidate `auto`.
    wall: Samples,
}

/// All results.
struct Found {
    all: Vec<Measured>,
    flown: Flight,
    streamed: Vec<Streamed>,
    /// The times of starts with an empty and with a filled cache.
    starts: Samples,
}

impl Measured {
    fn estimate(&self, ratio: &Ratio) -> Option<Estimate> {
        let [of, over] = ratio.keys()?;
        let samples = if ratio.is_wall_clock() { &self.wall } else { &self.device };
        samples.ratio(of, over)
    }
}

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
    let mut all = Vec::new();
    for camera in scene.cameras.iter().filter(|c| VIEWS.contains(&c.name.as_str())) {
        let pose = Pose::of(camera, |x, y| renderer.ground_m(x, y));
        let step = |what: &str, done: u64, total: u64| {
            reporter.report(&format!("{what}, camera {} (%)", camera.name), done * 100 / total.max(1), 100);
        };
        let device = passes(&mut renderer, pose, args, &|done, total| step("passes", done, total))?;
        let wall = measuring(&mut renderer, pose, args, &|done, total| step("wall clock", done, total))?;
        all.push(Measured { camera: camera.name.clone(), device, wall });
    }
    let flown = Flight::new(&mut renderer, args, &|done, total| reporter.report("flight", done, total))?;
    let streamed = Streamed::all(&mut renderer, args, &|done, total| reporter.report("streamed flight", done, total))?;
    let starts = start::measure(&gpu, &scene, args, &|done, total| reporter.report("start (%)", done * 100 / total.max(1), 100))?;
    reporter.finish();
    let found = Found { all, flown, streamed, starts };
    if let Some(file) = &args.record {
        record(file, &gpu, args, &found)?;
    }
    if args.json { print_json(&Answer::of(&gpu, args, &found)) } else { print(&text(&gpu, args, &found)) }
}

/// Draws rounds until the intervals of the wanted ratios are narrow, or until the time budget of the options is spent.
fn measure(
    candidates: usize,
    wanted: &[Wanted<'_>],
    args: &BenchArgs,
    step: &dyn Fn(u64, u64),
    draw: &mut dyn FnMut(Turn) -> Result<Vec<Timed>>,
) -> Result<Samples> {
    let began = Instant::now();
    let plan = Plan { candidates, wanted, least: args.repeats, budget_s: args.budget, seed: 0 };
    rounds::measure(&plan, &|| began.elapsed().as_secs_f64(), step, draw)
}

/// Measures the device times of all passes of each candidate. The ratios of shading times and of geometry times decide how many rounds are drawn.
fn passes(renderer: &mut Renderer<'_>, pose: Pose, args: &BenchArgs, step: &dyn Fn(u64, u64)) -> Result<Samples> {
    let candidates = candidates();
    let wanted = wanted(|ratio| !ratio.is_share);
    measure(candidates.len(), &wanted, args, step, &mut |turn| {
        check_interrupted()?;
        let Candidate { variant, culls, error_px, .. } = candidates[turn.candidate];
        let request = RenderRequest::new(pose, args.size).with(|r| {
            r.shading.variant = variant;
            (r.geometry.culls, r.geometry.error_px) = (culls, error_px);
        });
        let passes = renderer.draw(&request)?.into_report().passes;
        if passes.is_empty() {
            return Ok(Vec::new());
        }
        let timed = |pass: String, ms: f64| Timed { candidate: turn.candidate, pass, ms };
        let sum = passes.iter().map(|pass| pass.time_ms).sum();
        let geometry =
            passes.iter().filter(|pass| ["geometry", OCCLUSION_PASS].contains(&pass.name.as_str())).map(|pass| pass.time_ms).sum();
        let all = passes.into_iter().map(|pass| timed(pass.name, pass.time_ms));
        Ok(all.chain([timed(GEOMETRY.to_owned(), geometry), timed(ALL_PASSES.to_owned(), sum)]).collect())
    })
}

/// Share of the time for perceived noise that is added to the measuring time of each frame. A sequence has perceived noise in at most 4 frames, which
/// are a quarter of 16 measured frames.
const SHARE_SEEN: f64 = 0.25;

/// Measures four durations for each frame: rendering the frame with automatically chosen variants, the part of it that decides what is drawn, reading
/// the frame back, and measuring two streams of metrics, one for each signal. The measurement of a stream includes its changes from the four previous
/// frames, the changes of its error, and its perceived noise. The call that measures also composes the pictures, so the duration of a separate
/// composition is subtracted. Each stream is compared with itself in place of a reference, because only the durations count. A timed round is one
/// frame.
fn measuring(renderer: &mut Renderer<'_>, pose: Pose, args: &BenchArgs, step: &dyn Fn(u64, u64)) -> Result<Samples> {
    let layers = Layers::new(renderer.gpu(), args.size);
    let viewing = Viewing::default();
    let tracks = Signal::ALL.map(|signal| Track { signal, resolve: Resolve::Off });
    let mut meter = renderer.meter(args.size, &tracks, Some(viewing))?;
    let all = Flavour::ALL.into_iter().fold(0, |mask, flavour| mask | flavour.bit());
    let all = Variant::new(all).context("the set of all flavours is not a variant")?;
    let layers_read = AovSet::from_names(&["albedo", "choice"])?;
    let mut frame = 0;
    let mut next_frame = || -> Result<[f64; 4]> {
        check_interrupted()?;
        let request = RenderRequest::new(pose, args.size).with(|r| r.shading.frame = frame);
        let began = Instant::now();
        let report = renderer.draw(&request)?.into_report();
        let drawn = began.elapsed();
        let occlusion_ms: f64 = report.passes.iter().filter(|pass| pass.name == OCCLUSION_PASS).map(|pass| pass.time_ms).sum();
        let deciding_ms = if report.passes.is_empty() { f64::NAN } else { report.selection_ms + occlusion_ms };
        let shown = renderer.draw(&request.with(|r| {
            r.outputs.aovs = layers_read;
            r.outputs.displayed = true;
        }))?;
        let began = Instant::now();
        shown.read()?;
        let read = began.elapsed();
        let stream = renderer.composition().stream(None);
        let shaded = renderer.draw_flavours(&request, all, &layers)?;
        let gpu = shaded.renderer().gpu();
        let slots = meter.slots();
        let destinations: Vec<_> = meter
            .streams
            .iter()
            .map(|own| Destination { stream: stream.of(own.track.signal), signal: &own.signal, offset: slots.now })
            .collect();
        let began = Instant::now();
        shaded.compose(&layers, &destinations)?;
        let composed = began.elapsed();
        let area = args.size[0] * args.size[1];
        let own = meter.streams.iter().map(|own| read_signal(gpu, &own.signal, slots.now, area)).collect::<Result<Vec<_>, _>>()?;
        let began = Instant::now();
        for (signal, picture) in Signal::ALL.into_iter().zip(&own) {
            meter.write_reference(gpu, signal, picture);
        }
        shaded.measure(&layers, &mut meter, &[None; 2])?;
        let measured = began.elapsed();
        let began = Instant::now();
        // A filter stores results that depend only on which pixels show terrain. In a run with a moving camera, these pixels change from frame to
        // frame, so the results cannot be used again. Therefore, a new filter is made for each frame here, too.
        let mut filter = PerceivedFilter::new(args.size, viewing.pixels_per_degree);
        for index in 0..tracks.len() {
            filter.perceived_noise(&meter.memory(gpu, index)?);
        }
        let measured = measured + began.elapsed().mul_f64(SHARE_SEEN);
        frame += 1;
        let [drawn_ms, read_ms, measured_ms, composed_ms] = [drawn, read, measured, composed].map(|time| time.as_secs_f64() * 1e3);
        Ok([drawn_ms, read_ms, measured_ms - composed_ms, deciding_ms])
    };
    measure(1, &wanted(Ratio::is_wall_clock), args, step, &mut |turn| {
        // The metrics compare a frame with the four frames before it. Round 0, which is not timed, therefore draws four frames.
        let frames = if turn.round == 0 { LAGS } else { 1 };
        for _ in 1..frames {
            next_frame()?;
        }
        let ms = next_frame()?;
        let timed = |(pass, ms): (&str, f64)| Timed { candidate: 0, pass: pass.to_owned(), ms };
        Ok([FRAME, READING, MEASURING, DECIDING].into_iter().zip(ms).filter(|(_, ms)| !ms.is_nan()).map(timed).collect())
    })
}

/// Returns a ratio with the half-width of its 95 % interval as text.
fn shown(estimate: Option<Estimate>, is_share: bool) -> String {
    let Some(estimate) = estimate else { return "not measured".to_owned() };
    let (scale, unit, digits) = if is_share { (100.0, " %", 1) } else { (1.0, "", 2) };
    let Estimate { value, half_width } = estimate;
    let number = |value: f64| format!("{:.digits$}", scale * value);
    if half_width.is_infinite() {
        return format!("{}{unit}, no interval", number(value));
    }
    let word = if estimate.is_stable() { "" } else { ", unstable" };
    format!("{} \u{b1} {}{unit}{word}", number(value), number(value * half_width))
}

fn text(gpu: &Gpu, args: &BenchArgs, Found { all, flown, streamed, starts }: &Found) -> String {
    let kind = if gpu.is_software() { ", a software adapter" } else { "" };
    let [width, height] = args.size;
    let mut out = format!(
        "{}{kind}; {width}x{height}, at least {} rounds, at most {} s for each camera and clock\n",
        gpu.info.name, args.repeats, args.budget
    );
    for measured in all {
        for (words, is_wall_clock) in [("passes", false), ("wall clock", true)] {
            out += &format!("camera {}, {words}\n", measured.camera);
            for ratio in RATIOS.iter().filter(|ratio| ratio.is_wall_clock() == is_wall_clock) {
                out +=
                    &format!("  {:<46} {:>24}   target: {}\n", ratio.words, shown(measured.estimate(ratio), ratio.is_share), ratio.target);
            }
        }
    }
    out += &flown.text();
    streamed.iter().for_each(|streamed| out += &streamed.text());
    out += &start::text(starts);
    if all.iter().all(|measured| measured.device == Samples::default()) {
        out += "The adapter has no timestamp queries, so passes were not timed.\n";
    }
    out
}

/// The output of `--json`.
#[derive(Serialize)]
struct Answer<'a> {
    adapter: &'a str,
    driver: &'a str,
    software: bool,
    size: [u32; 2],
    /// For each camera, the ratios by name.
    cameras: BTreeMap<&'a str, BTreeMap<&'static str, Figure>>,
    flight: flight::Figures,
    /// The streamed flight, once for each schedule.
    streamed: &'a [Streamed],
    start_warm_over_cold: Figure,
}

/// A ratio in the output of `--json`.
#[derive(Debug, PartialEq, Serialize)]
struct Figure {
    /// The ratio. null = the ratio was not measured.
    ratio: Option<f64>,
    /// The ends of the 95 % interval. null = the ratio was not measured, or there are too few rounds.
    low: Option<f64>,
    high: Option<f64>,
    /// Whether the interval is at most 5 % wide on each side.
    stable: bool,
    target: &'static str,
}

impl Figure {
    fn of(estimate: Option<Estimate>, target: &'static str) -> Figure {
        let side = |factor: fn(f64) -> f64| {
            let estimate = estimate.filter(|estimate| estimate.half_width.is_finite())?;
            Some(estimate.value * factor(1.0 + estimate.half_width))
        };
        let stable = estimate.is_some_and(|estimate| estimate.is_stable());
        Figure { ratio: estimate.map(|estimate| estimate.value), low: side(f64::recip), high: side(|factor| factor), stable, target }
    }
}

impl<'a> Answer<'a> {
    fn of(gpu: &'a Gpu, args: &BenchArgs, Found { all, flown, streamed, starts }: &'a Found) -> Answer<'a> {
        let figures = |measured: &Measured| -> BTreeMap<&'static str, Figure> {
            RATIOS.iter().map(|ratio| (ratio.name, Figure::of(measured.estimate(ratio), ratio.target))).collect()
        };
        Answer {
            adapter: &gpu.info.name,
            driver: &gpu.info.driver_info,
            software: gpu.is_software(),
            size: args.size,
            cameras: all.iter().map(|measured| (measured.camera.as_str(), figures(measured))).collect(),
            flight: flown.figures(),
            streamed,
            start_warm_over_cold: Figure::of(start::ratio(starts), start::TARGET),
        }
    }
}

fn record(file: &Path, gpu: &Gpu, args: &BenchArgs, Found { all, flown, starts, .. }: &Found) -> Result<()> {
    let mut csv = csv::Writer::from_writer(Vec::new());
    csv.write_record([
        "adapter",
        "driver",
        "software",
        "scene",
        "camera",
        "width",
        "height",
        "variant",
        "pass",
        "metric",
        "unit",
        "value",
        "standard_error",
    ])?;
    let candidates = candidates();
    let software = gpu.is_software().to_string();
    let [width, height] = args.size.map(|n| n.to_string());
    for Measured { camera, device, wall } in all {
        let mut put = |(candidate, pass): Key<'_>, metric: &str, unit: &str, found: Option<Estimate>| -> Result<()> {
            let (Some(found), Some(Candidate { name: variant, .. })) = (found, candidates.get(candidate)) else { return Ok(()) };
            let error = found.standard_error().map_or_else(String::new, |error| format!("{error:.6}"));
            let value = format!("{:.4}", found.value);
            let place: [&str; 7] = [&gpu.info.name, &gpu.info.driver_info, &software, scene::DEFAULT, camera, &width, &height];
            Ok(csv.write_record(place.into_iter().chain([*variant, pass, metric, unit, &value, &error]))?)
        };
        // Of the candidates with less culling or fewer vertices, only the ratios of geometry times are recorded.
        let is_usual = |candidate: usize| candidates[candidate].culls == Culls::ALL && candidates[candidate].error_px <= 0.0;
        for key in device.keys().filter(|(candidate, pass)| is_usual(*candidate) && *pass != ALL_PASSES) {
            put(key, metrics::TIME, "ms", device.time(key))?;
            if key.1 == SHADING_PASS {
                put(key, metrics::TIME_RATIO, "1", device.ratio(key, (0, SHADING_PASS)))?;
            }
        }
        for ratio in RATIOS.iter().filter(|ratio| ratio.of.1 == GEOMETRY) {
            if let Some([of, over]) = ratio.keys() {
                put(of, ratio.name, "1", device.ratio(of, over))?;
            }
        }
        for key in wall.keys() {
            put(key, "wall_ms", "ms", wall.time(key))?;
        }
    }
    let share = format!("{:.4}", flown.share());
    let place: [&str; 7] = [&gpu.info.name, &gpu.info.driver_info, &software, scene::DEFAULT, "flight", &width, &height];
    csv.write_record(place.into_iter().chain([AUTO, GEOMETRY, "patches_culled_share", "1", &share, ""]))?;
    if let Some(start) = start::ratio(starts) {
        let place: [&str; 7] = [&gpu.info.name, &gpu.info.driver_info, &software, scene::DEFAULT, "first", &width, &height];
        let error = start.standard_error().map_or_else(String::new, |error| format!("{error:.6}"));
        csv.write_record(place.into_iter().chain([AUTO, "start", start::NAME, "1", &format!("{:.4}", start.value), &error]))?;
    }
    let bytes = csv.into_inner().context("cannot complete the CSV table")?;
    Ok(write_whole(file, |temporary| {
        std::fs::write(temporary, &bytes).map_err(|source| kernels::base::error::Error::File { file: temporary.to_owned(), source })
    })?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_ratio_has_its_own_name_and_times_of_known_choices() {
        for (i, ratio) in RATIOS.iter().enumerate() {
            assert!(ratio.keys().is_some(), "{}", ratio.name);
            assert!(RATIOS[..i].iter().all(|other| other.name != ratio.name && other.words != ratio.words), "{}", ratio.name);
            // The times of a ratio come from one clock. Only the first candidate has times of the wall clock.
            assert_eq!(is_wall_clock(ratio.of.1), is_wall_clock(ratio.over.1), "{}", ratio.name);
            assert!(!ratio.is_wall_clock() || ratio.keys().is_some_and(|keys| keys.iter().all(|(candidate, _)| *candidate == 0)));
        }
        assert_eq!(candidates()[0].name, AUTO);
        // All ratios except the share of classification decide how many rounds are drawn.
        assert_eq!(wanted(|ratio| !ratio.is_share).len() + wanted(Ratio::is_wall_clock).len(), RATIOS.len() - 1);
    }

    #[test]
    fn ratios_are_shown_with_their_intervals() {
        let of = |value: f64, half_width: f64| Some(Estimate { value, half_width });
        assert_eq!(shown(of(2.5, 0.04), false), "2.50 \u{b1} 0.10");
        assert_eq!(shown(of(2.5, 0.12), false), "2.50 \u{b1} 0.30, unstable");
        assert_eq!(shown(of(0.05, 0.04), true), "5.0 \u{b1} 0.2 %");
        assert_eq!(shown(of(2.5, f64::INFINITY), false), "2.50, no interval");
        assert_eq!(shown(None, true), "not measured");
        let figure = Figure::of(of(3.0, 1.0), "3");
        assert_eq!(figure, Figure { ratio: Some(3.0), low: Some(1.5), high: Some(6.0), stable: false, target: "3" });
        assert!(Figure::of(of(3.0, 0.05), "3").stable);
        let nothing = Figure { ratio: None, low: None, high: None, stable: false, target: "3" };
        assert_eq!(Figure::of(None, "3"), nothing);
        assert_eq!(Figure::of(of(3.0, f64::INFINITY), "3"), Figure { ratio: Some(3.0), ..nothing });
    }
}

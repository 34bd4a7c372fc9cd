//! `render`: renders pictures of a scene with any variant, estimator and noise, or renders the converged reference.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use kernels::base::names::nearest;
use kernels::base::progress::Progress;
use kernels::display::Exposure;
use kernels::frame::export;
use kernels::frame::picture::{AovSet, Layer, Picture};
use kernels::frame::{self, RenderRequest, Renderer, RendererOptions, VariantChoice};
use kernels::gpu::Gpu;
use kernels::residency::Residency;
use kernels::scene::{CameraPath, CameraPose, Scene};
use kernels::shading::Estimator;
use kernels::variant::{Flavour, Variant};
use kernels::view::camera;
use kernels::view::camera::Pose;
use serde::Serialize;

use super::{Reporter, check_output_file, print, print_json};
use crate::cli::{RenderArgs, extension};
use crate::definition::variant_name;
use crate::process::{check_interrupted, watch_interrupts};

#[derive(Serialize)]
struct Summary {
    scene: String,
    size: [u32; 2],
    variant: String,
    estimator: String,
    noise: String,
    seed: u32,
    /// The values of the settings of the frame, by their keys.
    settings: serde_json::Map<String, serde_json::Value>,
    /// Settings of the scene that `--set` replaced, by their keys.
    set: serde_json::Map<String, serde_json::Value>,
    /// Samples per pixel of the reference; absent unless `--reference` was given.
    #[serde(skip_serializing_if = "Option::is_none")]
    reference: Option<u32>,
    adapter: String,
    /// Whether the adapter renders on the CPU. Only ratios of its times are then meaningful.
    software: bool,
    frames: Vec<FrameSummary>,
}

#[derive(Serialize)]
struct FrameSummary {
    frame: u32,
    file: PathBuf,
    /// GPU time of each pass, milliseconds. For a reference, it is the sum over all samples. If one of the layers `fetches`, `choice` or `variant` is
    /// requested, pixels are shaded by counting pipelines, which are slower.
    gpu_ms: serde_json::Map<String, serde_json::Value>,
    /// Mean number of fetches over terrain pixels; absent if none of the layers `fetches`, `choice` and `variant` is requested.
    #[serde(skip_serializing_if = "Option::is_none")]
    fetches_per_px: Option<f64>,
    /// Number of screen tiles that each variant shades. Variants that shade no tile are absent.
    tiles: serde_json::Map<String, serde_json::Value>,
}

/// Returns the value of a setting as JSON.
fn json(value: &toml::Value) -> serde_json::Value {
    serde_json::to_value(value).unwrap_or_default()
}

/// The camera of the pictures: a fixed pose, which comes from the scene or the command line, or a camera path.
enum Shot<'a> {
    Still(CameraPose),
    Along(&'a CameraPath),
}

/// Renders and writes all frames. Each file is written completely or not at all.
pub(crate) fn run(args: &RenderArgs) -> Result<()> {
    check_output_file(&args.out)?;
    let scene = args.scene_settings.scene(&args.scene)?;
    let frame_settings = args.frame.0;
    let is_png = extension(&args.out) == "png";
    if !is_png && frame_settings.stages.display != Exposure::default() {
        bail!(
            "--exposure and --tone-curve do not apply to {}, because OpenEXR holds linear radiance: omit them, or write a PNG",
            args.out.display()
        );
    }
    let shot = shot(args, &scene)?;
    let frames = match (&shot, args.frames) {
        (_, Some(frames)) => frames,
        (Shot::Still(_), None) => 1,
        (Shot::Along(path), None) => u32::try_from(path.frames()).unwrap_or(u32::MAX),
    };
    let numbered = args.frames.is_some() || matches!(shot, Shot::Along(_));

    watch_interrupts()?;
    let gpu = Gpu::new()?;
    let reporter = Reporter::new();
    let show = |p: Progress| reporter.report(&p.stage, p.done, p.total);
    let options = RendererOptions { tile: frame_settings.tile, ..RendererOptions::default() };
    let mut renderer = Renderer::with(&gpu, &scene, options, &show)?;
    let aovs = AovSet::from_names(&args.aov)?;
    let mut summary = Summary {
        scene: scene.name.clone(),
        size: args.size,
        variant: args.reference.map_or_else(|| variant_name(frame_settings.choice()), |_| Flavour::Splat.name().to_owned()),
        estimator: args.reference.map_or(frame_settings.estimator, |_| Estimator::Exact).to_string(),
        noise: frame_settings.noise.to_string(),
        seed: frame_settings.seed,
        settings: frame::settings().filter_map(|setting| Some((setting.key.to_owned(), json(&setting.get(&frame_settings)?)))).collect(),
        set: args.scene_settings.replaced().map(|(key, value)| (key.to_owned(), json(value))).collect(),
        reference: args.reference,
        adapter: gpu.info.name.clone(),
        software: gpu.is_software(),
        frames: Vec::new(),
    };
    let mut arrivals = None;
    for frame in 0..frames {
        check_interrupted().with_context(|| format!("{frame} of {frames} pictures were written"))?;
        let mut pose = match &shot {
            Shot::Still(camera) => Pose::of(camera, |x, y| renderer.ground_m(x, y)),
            Shot::Along(path) => camera::along(path, frame, |x, y| renderer.ground_m(x, y)),
        };
        pose.fov = args.fov.map_or(pose.fov, f64::to_radians);
        let plain = frame_settings.request(pose, args.size, frame);
        let residency = match frame_settings.schedule() {
            Some(schedule) => {
                let mut own = arrivals.take().map_or_else(|| renderer.arrivals(schedule, &plain), Ok)?;
                let (residency, _) = renderer.arrive(&mut own, &plain)?;
                arrivals = Some(own);
                residency
            }
            None => Residency::Settled,
        };
        let request = plain.with(|r| {
            r.geometry.residency = residency;
            r.outputs.aovs = aovs;
            // If a picture is the mean of several samples, it is converted for display after the mean is computed.
            r.outputs.displayed = is_png && args.reference.is_none();
        });
        let picture = match args.reference {
            None => {
                if frames > 1 {
                    reporter.report("rendering", u64::from(frame), u64::from(frames));
                }
                renderer.render(&request)?
            }
            Some(samples) => reference(&mut renderer, &request, samples, &reporter)?,
        };
        if picture.report.tiles.first() == Some(&0) {
            eprintln!("note: frame {frame} shows no terrain: the camera looks away from it, is outside the world, or is under the ground");
        }
        let file = if numbered { numbered_file(&args.out, frame) } else { args.out.clone() };
        if is_png {
            export::write_png(&file, &picture, frame_settings.stages.display)?;
        } else {
            export::write_exr(&file, &picture)?;
        }
        let gpu_ms = picture.passes.iter().map(|(name, ms)| (name.clone(), (*ms).into())).collect();
        // `tiles[0]` counts all tiles that show terrain, and `tiles[i]` counts the tiles of variant i.
        let tiles = Variant::all().zip(picture.report.tiles.iter().skip(1)).filter(|(_, count)| **count > 0);
        let tiles = tiles.map(|(variant, &count)| (variant.to_string(), count.into())).collect();
        summary.frames.push(FrameSummary { frame, file, gpu_ms, fetches_per_px: picture.fetches_per_px, tiles });
    }
    reporter.finish();
    if args.json { print_json(&summary) } else { print(&text(&summary)) }
}

fn shot<'a>(args: &RenderArgs, scene: &'a Scene) -> Result<Shot<'a>> {
    if let Some(name) = &args.path {
        let path = scene.paths.iter().find(|path| &path.name == name);
        return path.map(Shot::Along).with_context(|| no_such("path", name, scene, scene.paths.iter().map(|path| path.name.as_str())));
    }
    let camera = match (&args.camera, args.pose) {
        (Some(name), _) => scene
            .cameras
            .iter()
            .find(|camera| &camera.name == name)
            .cloned()
            .with_context(|| no_such("camera", name, scene, scene.cameras.iter().map(|camera| camera.name.as_str())))?,
        (None, Some([x, y, z, yaw_deg, pitch_deg])) => {
            CameraPose { name: "pose".to_owned(), position: [x, y, z], above_ground: false, yaw_deg, pitch_deg, fov_deg: 55.0 }
        }
        (None, None) => bail!("give --camera, --pose or --path"),
    };
    Ok(Shot::Still(camera))
}

/// Returns a message such as: scene `alps` has no camera `vsita`: did you mean `vista`?
pub(crate) fn no_such<'a>(kind: &str, name: &str, scene: &Scene, known: impl Iterator<Item = &'a str>) -> String {
    let known: Vec<&str> = known.collect();
    let hint = match nearest(name, &known) {
        Some(near) => format!("did you mean `{near}`?"),
        None if known.is_empty() => "it has none".to_owned(),
        None => format!("it has {}", known.join(", ")),
    };
    format!("scene `{}` has no {kind} `{name}`: {hint}", scene.name)
}

/// Renders the converged reference. It is the blend of four materials in three projections and two tilings (96 fetches), averaged over `samples`
/// points in the square of each pixel. Of the layers, only colours are averaged. The averages of the others, such as ids, directions and distances,
/// would be meaningless, so these layers have the values at the centre of the pixel.
pub(crate) fn reference(renderer: &mut Renderer<'_>, request: &RenderRequest, samples: u32, reporter: &Reporter) -> Result<Picture> {
    let truth = request.with(|r| {
        r.shading.variant = VariantChoice::Forced(Variant::only(Flavour::Splat));
        r.shading.estimator = Estimator::Exact;
        r.shading.two_tilings = true;
        r.geometry.residency = Residency::Settled;
    });
    // The first sample is at the centre of the pixel.
    let centre = renderer.render(&truth.with(|r| r.view.jitter = sample_point(0)))?;
    let mut sums = Sums::of(&centre);
    for sample in 1..samples {
        check_interrupted()?;
        reporter.report("reference samples", u64::from(sample), u64::from(samples));
        sums.add(&renderer.render(&truth.with(|r| r.view.jitter = sample_point(sample)))?)?;
    }
    sums.mean(centre, samples)
}

/// Returns point `i` of the R2 sequence, relative to the centre of the pixel, in -0.5..0.5. Point 0 is the centre.
///
/// Source: Roberts, *The Unreasonable Effectiveness of Quasirandom Sequences*, 2018. The steps along x and y are 1/g and 1/g² with g³ = g + 1.
fn sample_point(i: u32) -> [f64; 2] {
    const G: f64 = 1.324_717_957_244_746;
    [1.0 / G, 1.0 / (G * G)].map(|step| (0.5 + f64::from(i) * step).fract() - 0.5)
}

/// Sums of colours and of pass times over the samples of a reference. Their means are the reference. The sums are in f64, so that they stay accurate
/// with thousands of samples.
struct Sums {
    hdr: Vec<[f64; 4]>,
    colours: Vec<(String, Vec<[f64; 3]>)>,
    passes: Vec<(String, f64)>,
}

impl Sums {
    fn of(picture: &Picture) -> Sums {
        let colours = picture.layers.iter().filter_map(|(name, layer)| match layer {
            Layer::Rgb(texels) => Some((name.clone(), texels.iter().map(|t| t.map(f64::from)).collect())),
            Layer::Xyz(_) | Layer::Value(_) => None,
        });
        Sums { hdr: picture.hdr.iter().map(|t| t.map(f64::from)).collect(), colours: colours.collect(), passes: picture.passes.clone() }
    }

    fn add(&mut self, picture: &Picture) -> Result<()> {
        for (sum, texel) in self.hdr.iter_mut().zip(&picture.hdr) {
            *sum = std::array::from_fn(|i| sum[i] + f64::from(texel[i]));
        }
        for (name, sums) in &mut self.colours {
            let Some((_, Layer::Rgb(texels))) = picture.layers.iter().find(|(other, _)| other == name) else {
                bail!("layer `{name}` is missing from a sample of the reference");
            };
            for (sum, texel) in sums.iter_mut().zip(texels) {
                *sum = std::array::from_fn(|i| sum[i] + f64::from(texel[i]));
            }
        }
        for (name, ms) in &mut self.passes {
            *ms += picture.passes.iter().find(|(other, _)| other == name).map_or(0.0, |(_, ms)| *ms);
        }
        Ok(())
    }

    #[allow(clippy::cast_possible_truncation, reason = "a mean of f32 values, rounded back to f32")]
    fn mean(self, mut picture: Picture, samples: u32) -> Result<Picture> {
        let scale = 1.0 / f64::from(samples);
        picture.hdr = self.hdr.iter().map(|t| t.map(|v| (v * scale) as f32)).collect();
        for (name, sums) in self.colours {
            let layer = picture.layers.iter_mut().find(|(other, _)| *other == name);
            let (_, layer) = layer.with_context(|| format!("layer `{name}` is missing from the reference"))?;
            *layer = Layer::Rgb(sums.iter().map(|t| t.map(|v| (v * scale) as f32)).collect());
        }
        picture.passes = self.passes;
        Ok(picture)
    }
}

/// Inserts the frame number into a file name: `out.exr` and 3 give `out-0003.exr`.
fn numbered_file(out: &Path, frame: u32) -> PathBuf {
    let part = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    out.with_file_name(format!("{}-{frame:04}.{}", part(out.file_stem()), part(out.extension())))
}

fn text(summary: &Summary) -> String {
    let software = if summary.software { " (software: only ratios of its times are meaningful)" } else { "" };
    let mut lines = Vec::new();
    for frame in &summary.frames {
        let total: f64 = frame.gpu_ms.values().filter_map(serde_json::Value::as_f64).sum();
        let time = if frame.gpu_ms.is_empty() { String::new() } else { format!("  {total:.2} ms on the GPU") };
        lines.push(format!("{}{time}", frame.file.display()));
    }
    if let [frame] = summary.frames.as_slice() {
        lines.extend(frame.gpu_ms.iter().map(|(name, ms)| format!("  {name:<28} {:>9.3} ms", ms.as_f64().unwrap_or(f64::NAN))));
    }
    lines.push(format!("adapter: {}{software}", summary.adapter));
    lines.push(String::new());
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_numbers_go_before_the_extension() {
        assert_eq!(numbered_file(Path::new("a/b.c.exr"), 3), Path::new("a/b.c-0003.exr"));
        assert_eq!(numbered_file(Path::new("a/B.EXR"), 12), Path::new("a/B-0012.EXR"));
    }

    #[test]
    fn sample_points_fill_the_pixel_evenly() {
        assert_eq!(sample_point(0), [0.0, 0.0]);
        let mut counts = [0; 16];
        for i in 0..1024 {
            let [x, y] = sample_point(i);
            assert!(x.abs() <= 0.5 && y.abs() <= 0.5);
            let cell = |v: f64| (0..4).rev().find(|&k| v >= f64::from(k) * 0.25 - 0.5).unwrap_or(0) as usize;
            counts[cell(x) + 4 * cell(y)] += 1;
        }
        // Each of the 16 cells contains 64 of the 1024 points on average. The limits allow a deviation of 4. With independent random points, the
        // count would have a standard deviation of 8.
        assert!(counts.iter().all(|&count| (60..=68).contains(&count)), "{counts:?}");
    }
}

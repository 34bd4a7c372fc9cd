//! `compare`: compares a picture with its reference.

use std::fmt::Write as _;
use std::path::Path;

use crate::judge::{Content, Image, Metric, Note, Pair, Side, check_windows, flip, notes};
use anyhow::{Result, bail};
use kernels::frame::export::write_png_texels;
use serde::Serialize;

use super::{check_output_file, print, print_json};
use crate::cli::CompareArgs;

/// The output of `--json`. Metrics that were not requested are absent.
#[derive(Serialize)]
struct Answer<'a> {
    test: &'a Path,
    reference: &'a Path,
    layer: Option<&'a str>,
    size: [u32; 2],
    /// Number of compared pixels.
    pixels: usize,
    terrain_only: bool,
    identical: bool,
    #[serde(skip_serializing_if = "Option::is_none")]
    flip: Option<FlipAnswer>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mse: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    mrse: Option<f64>,
    /// PSNR, dB. null = the PSNR is infinite, which JSON cannot represent.
    #[serde(skip_serializing_if = "Option::is_none")]
    psnr_db: Option<Option<f64>>,
    /// SSIM. null = no window of 11 x 11 pixels fits into the picture around a compared pixel.
    #[serde(skip_serializing_if = "Option::is_none")]
    ssim: Option<Option<f64>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    map: Option<&'a Path>,
    /// Notes about properties of the files that affect the metrics; absent if there are none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<Note>,
}

#[derive(Serialize)]
struct FlipAnswer {
    pixels_per_degree: f32,
    mean: f64,
    weighted_quartiles: [f64; 3],
    max: f64,
}

/// Compares two pictures, prints the requested metrics, and writes the map of FLIP errors if it is requested.
pub(crate) fn run(args: &CompareArgs) -> Result<()> {
    let inputs = [&args.test, &args.reference];
    if let Some(map) = &args.map {
        check_output_file(map)?;
        let same = |input: &&std::path::PathBuf| matches!((input.canonicalize(), map.canonicalize()), (Ok(a), Ok(b)) if a == b);
        if let Some(input) = inputs.into_iter().find(same) {
            bail!("--map {} is a picture to compare: give another file, or {} would be lost", map.display(), input.display());
        }
    }
    let layer = args.layer.as_deref();
    let (test, reference) = (Image::read(&args.test, layer)?, Image::read(&args.reference, layer)?);
    if test.size != reference.size {
        let [a, b] = [&test, &reference].map(|image| format!("{}x{}", image.size[0], image.size[1]));
        bail!("sizes differ: {} is {a}, {} is {b}; render both at the same size", args.test.display(), args.reference.display());
    }
    if test.content != reference.content {
        bail!(
            "{} and {} hold different contents (colour, vector or value): give two files with the same content",
            args.test.display(),
            args.reference.display()
        );
    }
    let metrics = metrics(args, test.content)?;
    let mask = if args.terrain {
        let Some(mask) = reference.terrain() else {
            bail!("--terrain needs alpha, but {} has none: give a reference with alpha, or omit --terrain", args.reference.display());
        };
        if !mask.contains(&true) {
            bail!("{} shows no terrain, because no pixel has alpha 1: omit --terrain", args.reference.display());
        }
        Some(mask)
    } else {
        None
    };
    let sides = [(&args.test, &test), (&args.reference, &reference)].map(|(file, image)| Side { file, image });
    check_windows(sides[0], sides[1], mask.as_deref())?;
    let pair = Pair::new(test.size, &test.texels, &reference.texels, mask.as_deref())?;
    let asked = |metric: Metric| metrics.contains(&metric);
    let map = if asked(Metric::Flip) || args.map.is_some() { Some(pair.flip(args.pixels_per_degree)?) } else { None };
    if let (Some(file), Some(map)) = (&args.map, &map) {
        write_png_texels(file, map.size, &map.coloured())?;
    }
    let flip = map.filter(|_| asked(Metric::Flip)).map(|map| {
        let flip::Flip { mean, weighted_quartiles, max } = map.pool(mask.as_deref());
        FlipAnswer { pixels_per_degree: args.pixels_per_degree, mean, weighted_quartiles, max }
    });
    let answer = Answer {
        test: &args.test,
        reference: &args.reference,
        layer,
        size: pair.size(),
        pixels: pair.pixels(),
        terrain_only: args.terrain,
        identical: pair.identical(),
        flip,
        mse: asked(Metric::Mse).then(|| pair.mse()),
        mrse: asked(Metric::Mrse).then(|| pair.mrse()),
        psnr_db: asked(Metric::Psnr).then(|| Some(pair.psnr()).filter(|db| db.is_finite())),
        ssim: asked(Metric::Ssim).then(|| pair.ssim()),
        map: args.map.as_deref(),
        notes: notes(sides[0], sides[1], mask.as_deref(), &metrics),
    };
    if args.json { print_json(&answer) } else { print(&table(&answer, &metrics)) }
}

/// Returns the requested metrics without duplicates. If none was requested, returns all metrics that are meaningful for the content.
fn metrics(args: &CompareArgs, content: Content) -> Result<Vec<Metric>> {
    let colour = content == Content::Colour;
    if !colour {
        let of_colour = args.metric.iter().find(|metric| metric.needs_colour()).map(|metric| format!("--metric {metric}"));
        if let Some(option) = of_colour.or_else(|| args.map.as_ref().map(|_| "--map".to_owned())) {
            let layer = args.layer.as_deref().unwrap_or("picture");
            bail!("{option} needs colour, and `{layer}` has none: use the metrics mse and mrse, or give a different --layer");
        }
    }
    let given = |metric: &Metric| args.metric.contains(metric) || args.metric.is_empty() && (colour || !metric.needs_colour());
    Ok(Metric::ALL.into_iter().filter(given).collect())
}

fn table(answer: &Answer<'_>, metrics: &[Metric]) -> String {
    let mut text = String::new();
    // Writing into a String cannot fail.
    let _ = writeln!(text, "test       {}", answer.test.display());
    let _ = writeln!(text, "reference  {}", answer.reference.display());
    if let Some(layer) = answer.layer {
        let _ = writeln!(text, "layer      {layer}");
    }
    let [width, height] = answer.size;
    let which = if answer.terrain_only { "only terrain" } else { "all" };
    let like = if answer.identical { "; the pictures are identical there" } else { "" };
    let _ = writeln!(text, "pixels     {} of {width}x{height}, {which}{like}", answer.pixels);
    for note in &answer.notes {
        let _ = writeln!(text, "note       {}", note.text);
    }
    text.push('\n');
    for metric in metrics {
        let value = match metric {
            Metric::Flip => answer.flip.as_ref().map_or_else(String::new, |flip| number(flip.mean)),
            Metric::Mse => answer.mse.map_or_else(String::new, number),
            Metric::Mrse => answer.mrse.map_or_else(String::new, number),
            Metric::Psnr => answer.psnr_db.map_or_else(String::new, |db| db.map_or_else(|| "infinite".to_owned(), |db| format!("{db:.3}"))),
            Metric::Ssim => {
                answer.ssim.map_or_else(String::new, |ssim| ssim.map_or_else(|| "none".to_owned(), |ssim| format!("{ssim:.6}")))
            }
        };
        let _ = writeln!(text, "{:<6} {value:<12} {}", metric.name(), metric.definition());
        if let (Metric::Flip, Some(flip)) = (metric, &answer.flip) {
            let [low, middle, high] = flip.weighted_quartiles;
            let _ = writeln!(text, "  at {} pixels per degree; maximum {:.6}", flip.pixels_per_degree, flip.max);
            let _ = writeln!(
                text,
                "  weighted quartiles {low:.6} {middle:.6} {high:.6}: smaller errors make up 1/4, 1/2, 3/4 of the sum of errors"
            );
        }
    }
    if let Some(file) = answer.map {
        let _ = writeln!(text, "\nmap        {}: FLIP error in magma", file.display());
        let colours = flip::magma();
        let legend =
            [("0", 0, "black"), ("0.25", 64, "purple"), ("0.5", 128, "magenta"), ("0.75", 191, "orange"), ("1", 255, "pale yellow")];
        for (error, index, look) in legend {
            let [r, g, b] = colours[index];
            let _ = writeln!(text, "  {error:<4} #{r:02x}{g:02x}{b:02x} {look}");
        }
    }
    text
}

/// Formats a number with six decimals. Very small and very large numbers are written with six significant digits and an exponent.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e6).contains(&value.abs()) { format!("{value:.6}") } else { format!("{value:.5e}") }
}

//! Renders the converged reference of a view, and measures the differences between the frames of the reference sequence.
//!
//! The reference is the 96-fetch blend, averaged over the square of each pixel. Samples are taken in batches. A batch consists of 8 points of the R2
//! sequence, all shifted by the same random vector (Cranley & Patterson 1976). The mean of a batch is an unbiased estimate, and different batches are
//! independent. The scatter of the batches therefore gives the standard error of their mean. The number of batches is doubled until the standard
//! error is at most a tenth of the error of the 96-fetch blend with one sample per pixel. Without a temporal resolve, no shading is expected to have
//! a smaller error than that blend.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use kernels::frame::export;
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer};
use kernels::metrics::{BINS, quantile};
use kernels::motion::LAGS;
use kernels::shared::hash;
use kernels::shared::moments::Moments;
use kernels::shared::signal;
use kernels::temporal::Resolve;
use kernels::variant::{Flavour, Variant};
use serde::{Deserialize, Serialize};

use super::{Labels, Mark, Runner, pictures, truth, views};
use crate::judge::Image;
use crate::metrics;
use crate::process::check_interrupted;
use crate::store::{REFERENCE, write_with};
use crate::unit::{Outcome, Unit};

/// Samples per batch.
const BATCH: u32 = 8;
/// Smallest number of batches. The standard error cannot be estimated well from fewer batches.
const MIN_BATCHES: u32 = 4;
/// No more samples are taken when the standard error of the reference is at most this share of the error of the 96-fetch blend with one
/// sample per pixel.
pub(super) const SHARE: f64 = 0.1;

/// Facts about a reference, which are stored next to its picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Record {
    /// Samples per pixel.
    pub(super) spp: u32,
    /// Root mean square, over terrain pixels and channels, of the standard error.
    pub(super) standard_error: f64,
    /// For each frame, the mean absolute difference in luminance from each of the four previous frames. `None` if the earlier frame does not exist,
    /// or if no terrain point is visible in both frames.
    pub(super) differences: Vec<[Option<f64>; LAGS]>,
    /// 95th percentile of the difference in luminance from the previous frame, over all frames.
    pub(super) difference_p95: Option<f64>,
}

/// A reference: its picture, the pixels that may be compared with it, and facts about it.
pub(super) struct Reference {
    /// Linear albedo.
    pub(super) albedo: Vec<[f32; 3]>,
    /// Whether a pixel is compared. All samples of a compared pixel show terrain.
    pub(super) mask: Vec<bool>,
    /// The facts about the reference.
    pub(super) record: Record,
}

impl Reference {
    /// Reads a reference from the files that an earlier part wrote.
    pub(super) fn read(folder: &Path, part: &Unit) -> Result<Reference> {
        let file = &picture_file(folder, part);
        let image = Image::read(file, None).with_context(|| format!("the reference {} cannot be used", file.display()))?;
        let mask = image.terrain().with_context(|| format!("{} has no alpha that marks terrain", file.display()))?;
        let record = file.with_extension("json");
        let bytes = fs::read(&record).with_context(|| format!("cannot read {}", record.display()))?;
        let record = serde_json::from_slice(&bytes).with_context(|| format!("{} is corrupt", record.display()))?;
        Ok(Reference { albedo: image.texels, mask, record })
    }
}

/// Returns the file of a reference's picture in the folder of a run. The facts about the reference are stored next to it.
fn picture_file(folder: &Path, part: &Unit) -> PathBuf {
    folder.join(REFERENCE).join(format!("{}.exr", part.id))
}

/// Moments of the batches of samples at each pixel.
struct Accumulated {
    batches: Vec<[Moments<f64>; 3]>,
    terrain: Vec<bool>,
    count: u32,
}

impl Accumulated {
    fn new(pixels: usize) -> Accumulated {
        Accumulated { batches: vec![[Moments::new(); 3]; pixels], terrain: vec![true; pixels], count: 0 }
    }

    /// Renders a batch of samples and adds its mean.
    fn add(&mut self, renderer: &mut Renderer<'_>, request: &RenderRequest) -> Result<()> {
        let mut sums = vec![[0.0f64; 3]; self.batches.len()];
        for i in 0..BATCH {
            let jitter = sample_point(self.count, i);
            let picture = renderer.render(&request.with(|r| r.view.jitter = jitter))?;
            let albedo = picture.vectors("albedo").context("the layer `albedo` is missing")?;
            for ((sum, texel), (terrain, hdr)) in sums.iter_mut().zip(albedo).zip(self.terrain.iter_mut().zip(&picture.hdr)) {
                *sum = std::array::from_fn(|k| sum[k] + f64::from(texel[k]));
                *terrain &= hdr[3] > 0.0;
            }
        }
        for (moments, sum) in self.batches.iter_mut().zip(&sums) {
            moments.iter_mut().zip(sum).for_each(|(m, s)| m.add([s / f64::from(BATCH), 0.0]));
        }
        self.count += 1;
        Ok(())
    }

    #[allow(clippy::cast_possible_truncation, reason = "a mean of f16 values, rounded to f32")]
    fn mean(&self) -> Vec<[f32; 3]> {
        self.batches.iter().map(|m| std::array::from_fn(|k| m[k].mean() as f32)).collect()
    }

    /// Returns the root mean square, over terrain pixels and channels, of the standard error.
    fn standard_error(&self) -> f64 {
        let squares = self.batches.iter().zip(&self.terrain).filter(|(_, on)| **on);
        let all = squares.flat_map(|(m, _)| m.iter().map(|m| m.standard_error().unwrap_or(0.0).powi(2)));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
        if n > 0.0 { (sum / n).sqrt() } else { 0.0 }
    }

    /// Returns the root mean square, over terrain pixels and channels, of the difference between a picture and the mean of all samples.
    fn distance(&self, texels: &[[f32; 3]]) -> f64 {
        let pairs = self.batches.iter().zip(texels).zip(&self.terrain).filter(|(_, on)| **on);
        let all = pairs.flat_map(|((m, t), _)| (0..3).map(move |k| (m[k].mean() - f64::from(t[k])).powi(2)));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
        if n > 0.0 { (sum / n).sqrt() } else { 0.0 }
    }
}

/// Returns point `i` of batch `batch`, relative to the centre of the pixel. It is a point of the R2 sequence (Roberts 2018), shifted by a hash of the
/// batch.
fn sample_point(batch: u32, i: u32) -> [f64; 2] {
    const G: f64 = 1.324_717_957_244_746;
    let shift = hash::pcg4d([batch, 0, 0, 0x5c1ee]);
    std::array::from_fn(|k| {
        let step = if k == 0 { 1.0 / G } else { 1.0 / (G * G) };
        (f64::from(shift[k]) / 4_294_967_296.0 + f64::from(i) * step).fract() - 0.5
    })
}

impl Runner<'_> {
    /// Renders the reference of a view at its last frame. The differences between frames are measured in a sequence of 96-fetch pictures with one
    /// sample per pixel.
    pub(super) fn reference(&mut self, unit: &Unit, folder: &Path, step: &dyn Fn(u64, u64)) -> Result<Outcome> {
        let (gpu, definition) = (self.gpu, self.definition);
        let stage = self.stage.as_mut().context("the renderer was not prepared")?;
        let renderer = &mut stage.renderer;
        let size = definition.size;
        let splat = Variant::only(Flavour::Splat);
        let settings = definition.reference;
        let batches = (settings.spp / BATCH).max(MIN_BATCHES);
        let most = (settings.max_spp / BATCH).max(batches);
        let total = u64::from(definition.frames + most);

        // The reference and the sweeps have the same frame settings, so their pictures differ only because of the shading.
        let choices = stage.choices;
        let mut meter = renderer.meter(size, &[Resolve::Off])?;
        let mut differences = Vec::new();
        let mut histogram = [0u64; BINS];
        let mut pose = views::pose(definition, renderer, &unit.view, 0)?;
        for frame in 0..definition.frames {
            step(u64::from(frame), total);
            check_interrupted()?;
            pose = views::pose(definition, renderer, &unit.view, frame)?;
            let request = truth(&choices.request(pose, size, frame));
            let shaded = renderer.draw_flavours(&request, splat, &stage.layers)?;
            let (sums, _) = shaded.measure(&stage.layers, &mut meter, &[Some(splat)])?;
            if definition.video {
                let texels: Vec<[f32; 3]> = meter.picture(gpu, 0, 0)?.iter().map(|s| signal::colour(*s)).collect();
                pictures::write_frame(&pictures::sequence(folder, &unit.id, &unit.id, ""), frame, size, &texels)?;
            }
            let lags = sums[0].lags;
            differences.push(lags.map(|lag| (lag.linked > 0).then(|| lag.difference / lag.linked as f64)));
            histogram.iter_mut().zip(&sums[0].histogram).for_each(|(all, &n)| *all += u64::from(n));
        }

        let request = {
            let mut r = truth(&choices.request(pose, size, 0));
            r.outputs.aovs = AovSet::from_names(&["albedo"])?;
            r
        };
        let single = renderer.render(&request)?;
        let single = single.vectors("albedo").context("the layer `albedo` is missing")?.to_vec();
        let mut all = Accumulated::new(single.len());
        let mut wanted = batches;
        loop {
            while all.count < wanted {
                step(u64::from(definition.frames + all.count), total);
                check_interrupted()?;
                all.add(renderer, &request)?;
            }
            if wanted >= most || all.standard_error() <= SHARE * all.distance(&single) {
                break;
            }
            wanted = (wanted * 2).min(most);
        }

        let record = Record {
            spp: all.count * BATCH,
            standard_error: all.standard_error(),
            difference_p95: quantile(&histogram, 0.95),
            differences,
        };
        ensure!(
            all.terrain.contains(&true),
            "view `{}` shows no terrain in its last frame: move its camera, or give fewer frames",
            unit.view
        );
        let albedo = all.mean();
        let file = picture_file(folder, unit);
        let own = folder.join(REFERENCE);
        fs::create_dir_all(&own).with_context(|| format!("cannot make the folder {}", own.display()))?;
        let hdr = albedo.iter().zip(&all.terrain).map(|(c, &on)| [c[0], c[1], c[2], f32::from(u8::from(on))]).collect();
        let picture = Picture {
            size,
            hdr,
            displayed: None,
            layers: Vec::new(),
            passes: Vec::new(),
            fetches_per_px: None,
            report: Default::default(),
        };
        export::write_exr(&file, &picture).context("cannot write the reference picture; if the disk is full, free some space")?;
        let json = file.with_extension("json");
        let bytes = serde_json::to_vec_pretty(&record).context("cannot convert the facts about the reference to JSON")?;
        write_with(&json, |output| output.write_all(&bytes))?;
        let mut sheet = pictures::Sheet::new(folder, unit);
        let caption = format!("96 fetches, {} samples per pixel, standard error {:.2e}", record.spp, record.standard_error);
        sheet.keep(
            pictures::Kind::Reference,
            "reference",
            &format!("Reference, {}", unit.view),
            &caption,
            size,
            &pictures::display(&albedo),
        )?;
        sheet.finish()?;

        let labels = Labels { definition, scene: &renderer.scene().name, unit, estimator: "", noise: "", temporal: "" };
        let mut rows = Vec::new();
        let last = Mark::frame(definition.frames - 1);
        labels.put(&mut rows, "reference", metrics::REFERENCE_SPP, last, f64::from(record.spp), None)?;
        labels.put(&mut rows, "reference", metrics::REFERENCE_SE, last, record.standard_error, None)?;
        let terrain = all.terrain.iter().filter(|on| **on).count() as f64 / all.terrain.len() as f64;
        labels.put(&mut rows, "reference", metrics::TERRAIN, last, terrain, None)?;
        for lag in 0..LAGS {
            let mut over = Moments::<f64>::new();
            for (frame, lags) in (0..).zip(&record.differences) {
                if let Some(value) = lags[lag] {
                    over.add([value, 0.0]);
                    labels.put(&mut rows, "reference", metrics::REFERENCE_DIFFERENCE, Mark::frame(frame).lag(lag + 1), value, None)?;
                }
            }
            if over.count > 0 {
                let error = over.standard_error();
                labels.put(&mut rows, "reference", metrics::REFERENCE_DIFFERENCE, Mark::default().lag(lag + 1), over.mean(), error)?;
            }
        }
        if let Some(p95) = record.difference_p95 {
            labels.put(&mut rows, "reference", metrics::REFERENCE_DIFFERENCE_P95, Mark::default().lag(1), p95, None)?;
        }
        gpu.check()?;
        Ok(Outcome { rows, times: Vec::new() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_fill_the_pixel_and_differ() {
        let mut counts = [0; 16];
        for batch in 0..128 {
            for i in 0..BATCH {
                let [x, y] = sample_point(batch, i);
                assert!(x.abs() <= 0.5 && y.abs() <= 0.5);
                let cell = |v: f64| (0..4).rev().find(|&k| v >= f64::from(k) * 0.25 - 0.5).unwrap_or(0) as usize;
                counts[cell(x) + 4 * cell(y)] += 1;
            }
        }
        // Each of the 16 cells contains 64 of the 1024 points on average. The limits allow a deviation of 20. With independent random points, the
        // count would have a standard deviation of 8.
        assert!(counts.iter().all(|&count| (44..=84).contains(&count)), "{counts:?}");
        assert_ne!(sample_point(0, 0), sample_point(1, 0));
    }

    #[test]
    fn standard_error_is_that_of_the_mean_of_batches() {
        let mut all = Accumulated::new(2);
        all.terrain[1] = false;
        for value in [1.0, 2.0, 3.0] {
            all.batches[0].iter_mut().for_each(|m| m.add([value, 0.0]));
            all.batches[1].iter_mut().for_each(|m| m.add([100.0 * value, 0.0]));
        }
        // At the first pixel, the means of the three batches are 1, 2 and 3. Their variance is 1, so the standard error of the overall mean is
        // sqrt(1 / 3). The second pixel is ignored, because it is not terrain.
        assert!((all.standard_error() - (1.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((all.distance(&[[2.5; 3], [0.0; 3]]) - 0.5).abs() < 1e-12);
        assert_eq!(all.mean()[0], [2.0; 3]);
    }
}

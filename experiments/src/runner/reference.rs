//! Renders the references of a view. The last frame is compared with the converged reference, and the sequences of frames are compared with the
//! reference sequences.
//!
//! A reference sequence consists of pictures of the reference blend (96 fetches). They have one sample per pixel and the camera poses of the pictures
//! under test. Each temporal resolve has its own sequence, which is rendered with the sample points of this resolve and passes through this resolve.
//! The pictures of the sequences are stored for the sweeps of the view.
//!
//! The converged reference is the 96-fetch blend, averaged over the square of each pixel. Samples are taken in batches. A batch consists of 8 points
//! of the R2 sequence, all shifted by the same random vector (Cranley & Patterson 1976). The mean of a batch is an unbiased estimate, and different
//! batches are independent. The scatter of the batches therefore gives the standard error of their mean. The number of batches is doubled until the
//! standard error is at most a tenth of the error of the 96-fetch blend with one sample per pixel, or until the definition's `reference.max_spp` is
//! reached. The error of that blend sets the accuracy, because it is expected to be the smallest error that is measured without a temporal resolve.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use kernels::base::colour::linear_from_srgb;
use kernels::display::Exposure;
use kernels::display::reference::tone_map;
use kernels::frame::export;
use kernels::frame::picture::{AovSet, Picture};
use kernels::frame::{RenderRequest, Renderer};
use kernels::metrics::{BINS, LagSums, Track, quantile};
use kernels::motion::LAGS;
use kernels::shared::hash;
use kernels::shared::moments::Moments;
use kernels::shared::signal::Signal;
use kernels::temporal::Resolve;
use kernels::variant::{Flavour, Variant};
use serde::{Deserialize, Serialize};

use super::sequence::{AGAIN, Pictures, Writer};
use super::{Labels, Mark, Runner, parse, pictures, truth, views};
use crate::judge::Image;
use crate::metrics;
use crate::process::{Unfit, check_interrupted};
use crate::row::Row;
use crate::store::{REFERENCE, SEQUENCE, write_with};
use crate::unit::{Outcome, Unit};

/// Samples per batch.
const BATCH: u32 = 8;
/// Smallest number of batches. The standard error cannot be estimated well from fewer batches.
const MIN_BATCHES: u32 = 4;
/// No more samples are taken when the standard error of the reference is at most this share of the error of the 96-fetch blend with one
/// sample per pixel. Both errors are those of albedo.
pub(super) const SHARE: f64 = 0.1;

/// Facts about a reference, which are stored next to its picture.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(super) struct Record {
    /// Samples per pixel.
    pub(super) spp: u32,
    /// For each signal, by name: root mean square, over terrain pixels and channels, of the standard error.
    pub(super) standard_error: BTreeMap<String, f64>,
    /// The reference sequence of each temporal resolve, by name.
    sequences: BTreeMap<String, Sequence>,
    /// Byte offset of the lit picture of the reference in the file of pictures; `None` = the run does not measure the lit picture.
    lit: Option<u64>,
}

/// The reference sequence of one temporal resolve.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Sequence {
    /// Byte offset, in the file of pictures, of the section that contains this sequence.
    place: u64,
    /// Number of pictures of each frame in this section. Resolves with the same sample points share a section.
    pictures: usize,
    /// Index of the first picture of this sequence among the pictures of a frame. The pictures of the other signals of this sequence follow.
    first: usize,
    /// For each signal, by name: how it changes from frame to frame.
    pub(super) changes: BTreeMap<String, Changes>,
}

/// How a reference sequence changes from frame to frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(super) struct Changes {
    /// For each frame: the mean absolute difference in luminance from each of the four previous frames (lags 1 to 4), at the same surface points. A
    /// lag of 1 uses all pixels, a larger lag a quarter of them. `None` if the frame is not measured, if the earlier frame does not exist, or if none
    /// of these pixels shows a terrain point that is visible in both frames.
    pub(super) differences: Vec<[Option<f64>; LAGS]>,
    /// 95th percentile of the absolute difference in luminance from the previous frame, over a quarter of the pixels of each measured frame.
    pub(super) p95: Option<f64>,
}

/// A reference: its pictures, the pixels that may be compared with it, and facts about it.
pub(super) struct Reference {
    /// For each measured signal: linear colour. For the lit picture, it is the linear form of the display values.
    pub(super) colours: BTreeMap<&'static str, Vec<[f32; 3]>>,
    /// For each pixel, whether it may be compared. All samples of such a pixel show terrain.
    pub(super) mask: Vec<bool>,
    /// The facts about the reference.
    pub(super) record: Record,
    file: PathBuf,
}

impl Reference {
    /// Reads a reference from the files that an earlier part wrote.
    pub(super) fn read(folder: &Path, part: &Unit, signals: &[Signal]) -> Result<Reference> {
        let file = picture_file(folder, part);
        let image = Image::read(&file, None).with_context(|| format!("the reference {} cannot be used", file.display()))?;
        let mask = image.terrain().with_context(|| format!("{} has no alpha that marks terrain", file.display()))?;
        let json = file.with_extension("json");
        let bytes = fs::read(&json).with_context(|| format!("cannot read {}: {AGAIN}", json.display()))?;
        let record: Record = serde_json::from_slice(&bytes).with_context(|| format!("{} is damaged: {AGAIN}", json.display()))?;
        let file = file.with_extension(SEQUENCE);
        let mut colours = BTreeMap::new();
        for signal in signals {
            let texels = match signal {
                Signal::Albedo => image.texels.clone(),
                Signal::Lit => {
                    let place = record.lit.with_context(|| format!("{} holds no lit picture", file.display()))?;
                    let mut pictures = Pictures::open(&file, place, mask.len())?;
                    unpacked(&pictures.next()?, &pictures.next()?)
                }
            };
            colours.insert(signal.name(), texels);
        }
        // The sequences are opened once, so that a missing file is noticed before anything is measured.
        Pictures::open(&file, 0, mask.len())?;
        Ok(Reference { colours, mask, record, file })
    }

    /// Opens the reference sequence of a temporal resolve.
    ///
    /// # Errors
    /// The sequence is missing or damaged.
    pub(super) fn sequence(&self, resolve: Resolve) -> Result<Frames<'_>> {
        let name = resolve.to_string();
        let sequence =
            self.record.sequences.get(&name).with_context(|| format!("{} has no sequence `{name}`: {AGAIN}", self.file.display()))?;
        Ok(Frames { pictures: Pictures::open(&self.file, sequence.place, self.mask.len())?, sequence })
    }
}

/// The frames of a reference sequence, read one after the other.
pub(super) struct Frames<'a> {
    pictures: Pictures,
    /// The facts about the sequence.
    pub(super) sequence: &'a Sequence,
}

impl Frames<'_> {
    /// Reads the pictures of the next frame, one per signal. `signals` is the number of measured signals.
    ///
    /// # Errors
    /// The file is damaged.
    pub(super) fn next(&mut self, signals: usize) -> Result<Vec<Vec<[u32; 2]>>> {
        let all = (0..self.sequence.pictures).map(|_| self.pictures.next()).collect::<Result<Vec<_>>>()?;
        Ok(all.into_iter().skip(self.sequence.first).take(signals).collect())
    }
}

/// Packs colours into two pictures of two words per pixel.
fn packed(texels: &[[f32; 3]]) -> [Vec<[u32; 2]>; 2] {
    let first = texels.iter().map(|[r, g, _]| [r.to_bits(), g.to_bits()]).collect();
    [first, texels.iter().map(|[_, _, b]| [b.to_bits(), 0]).collect()]
}

/// The inverse of [`packed`].
fn unpacked(first: &[[u32; 2]], second: &[[u32; 2]]) -> Vec<[f32; 3]> {
    first.iter().zip(second).map(|([r, g], [b, _])| [*r, *g, *b].map(f32::from_bits)).collect()
}

/// Returns the file of a reference's picture in the folder of a run. The facts about the reference and its sequences are stored next to it.
fn picture_file(folder: &Path, part: &Unit) -> PathBuf {
    folder.join(REFERENCE).join(format!("{}.exr", part.id))
}

/// Moments, over batches of samples, of the colour of each pixel.
struct Accumulated {
    batches: Vec<[Moments<f64>; 3]>,
}

impl Accumulated {
    fn new(pixels: usize) -> Accumulated {
        Accumulated { batches: vec![[Moments::new(); 3]; pixels] }
    }

    /// Adds a batch: the mean of its samples at each pixel.
    fn add(&mut self, means: impl Iterator<Item = [f64; 3]>) {
        for (moments, mean) in self.batches.iter_mut().zip(means) {
            moments.iter_mut().zip(mean).for_each(|(m, value)| m.add([value, 0.0]));
        }
    }

    #[allow(clippy::cast_possible_truncation, reason = "a mean of f16 values, rounded to f32")]
    fn mean(&self) -> Vec<[f32; 3]> {
        self.batches.iter().map(|m| std::array::from_fn(|k| m[k].mean() as f32)).collect()
    }

    /// Returns the root mean square, over terrain pixels and channels, of the standard error.
    fn standard_error(&self, terrain: &[bool]) -> f64 {
        let squares = self.batches.iter().zip(terrain).filter(|(_, on)| **on);
        let all = squares.flat_map(|(m, _)| m.iter().map(|m| m.standard_error().unwrap_or(0.0).powi(2)));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
        if n > 0.0 { (sum / n).sqrt() } else { 0.0 }
    }

    /// Returns the root mean square, over terrain pixels and channels, of the difference between a picture and the mean of all samples.
    fn distance(&self, terrain: &[bool], texels: &[[f32; 3]]) -> f64 {
        let pairs = self.batches.iter().zip(texels).zip(terrain).filter(|(_, on)| **on);
        let all = pairs.flat_map(|((m, t), _)| (0..3).map(move |k| (m[k].mean() - f64::from(t[k])).powi(2)));
        let (sum, n) = all.fold((0.0, 0.0), |(sum, n), v| (sum + v, n + 1.0));
        if n > 0.0 { (sum / n).sqrt() } else { 0.0 }
    }
}

/// The converged reference, computed from the batches so far.
struct Converging {
    /// Linear albedo.
    albedo: Accumulated,
    /// Linear radiance.
    radiance: Accumulated,
    /// The lit picture of each batch: the display values of its mean radiance, decoded to linear. The errors of lit pictures are measured in this
    /// form. Only the scatter of the batches is used, for the standard error. The lit picture of the reference is computed from the mean radiance
    /// over all batches.
    displayed: Accumulated,
    exposure: Exposure,
    terrain: Vec<bool>,
    count: u32,
}

impl Converging {
    fn new(pixels: usize, exposure: Exposure) -> Converging {
        let [albedo, radiance, displayed] = [(); 3].map(|()| Accumulated::new(pixels));
        Converging { albedo, radiance, displayed, exposure, terrain: vec![true; pixels], count: 0 }
    }

    /// Renders a batch of samples and adds its mean.
    fn add(&mut self, renderer: &mut Renderer<'_>, request: &RenderRequest) -> Result<()> {
        let mut sums = vec![[[0.0f64; 3]; 2]; self.terrain.len()];
        for i in 0..BATCH {
            let jitter = sample_point(self.count, i);
            let picture = renderer.render(&request.with(|r| r.view.jitter = jitter))?;
            let albedo = picture.vectors("albedo").context("the layer `albedo` is missing")?;
            for ((sum, texel), (terrain, hdr)) in sums.iter_mut().zip(albedo).zip(self.terrain.iter_mut().zip(&picture.hdr)) {
                for k in 0..3 {
                    sum[0][k] += f64::from(texel[k]);
                    sum[1][k] += f64::from(hdr[k]);
                }
                // A pixel with a colour that is not finite is excluded from all comparisons. The mean would hide this colour, because `Moments::add`
                // replaces numbers that are not finite.
                *terrain &= hdr[3] > 0.0 && hdr.iter().chain(texel).all(|value| value.is_finite());
            }
        }
        let mean = |sum: [f64; 3]| sum.map(|sum| sum / f64::from(BATCH));
        self.albedo.add(sums.iter().map(|[albedo, _]| mean(*albedo)));
        self.radiance.add(sums.iter().map(|[_, radiance]| mean(*radiance)));
        self.displayed.add(sums.iter().map(|[_, radiance]| tone_map(mean(*radiance), self.exposure).map(linear_from_srgb)));
        self.count += 1;
        Ok(())
    }

    /// Returns the linear form of the display values of the mean radiance.
    #[allow(clippy::cast_possible_truncation, reason = "display values, rounded to f32")]
    fn lit(&self) -> Vec<[f32; 3]> {
        let shown = |m: &[Moments<f64>; 3]| tone_map([0, 1, 2].map(|k| m[k].mean()), self.exposure);
        self.radiance.batches.iter().map(|m| shown(m).map(|value| linear_from_srgb(value) as f32)).collect()
    }
}

/// Returns point `i` of batch `batch`, in pixels relative to the centre of the pixel. It is a point of the R2 sequence (Roberts 2018), shifted by a
/// hash of the batch.
fn sample_point(batch: u32, i: u32) -> [f64; 2] {
    const G: f64 = 1.324_717_957_244_746;
    let shift = hash::pcg4d([batch, 0, 0, 0x5c1ee]);
    std::array::from_fn(|k| {
        let step = if k == 0 { 1.0 / G } else { 1.0 / (G * G) };
        (f64::from(shift[k]) / 4_294_967_296.0 + f64::from(i) * step).fract() - 0.5
    })
}

impl Runner<'_> {
    /// Renders the reference sequences of a view, and its converged reference at the last frame. Stores their pictures. Returns rows that say how
    /// accurate the converged reference is, how much of it shows terrain, how the sequences change from frame to frame, and how many pixels of the
    /// sequences are invalid.
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

        // The sequences have the frame settings and the sample points of the sweeps. Their pictures therefore differ from those of the sweeps only in
        // the shading and, with simulated streaming, in the terrain nodes.
        let choices = stage.choices;
        let signals = definition.measured_signals();
        let own = folder.join(REFERENCE);
        fs::create_dir_all(&own).with_context(|| format!("cannot make the folder {}", own.display()))?;
        let file = picture_file(folder, unit);
        let mut output = Writer::create(&file.with_extension(SEQUENCE))?;
        let mut sequences = BTreeMap::new();
        // For each signal: the number of invalid pixels, summed over all measured frames. Each set of sample points has its own sum; the largest sum
        // is kept.
        let mut invalid = vec![0u64; signals.len()];
        let mut pose = views::pose(definition, renderer, &unit.view, 0)?;
        for (index, resolves) in by_sample_points(&definition.temporal)?.into_iter().enumerate() {
            let tracks: Vec<Track> =
                resolves.iter().flat_map(|&resolve| signals.iter().map(move |&signal| Track { signal, resolve })).collect();
            let mut meter = renderer.meter(size, &tracks, None)?;
            let mut changes = vec![Changes::default(); tracks.len()];
            let mut histograms = vec![[0u64; BINS]; tracks.len()];
            let mut counted = vec![0; tracks.len()];
            let place = output.section(|add| {
                for frame in 0..definition.frames {
                    step(u64::from(frame), total);
                    check_interrupted()?;
                    pose = views::pose(definition, renderer, &unit.view, frame)?;
                    let request =
                        truth(&choices.request(pose, size, frame)).with(|r| r.shading.sample_pattern = resolves[0].sample_pattern(frame));
                    let shaded = renderer.draw_flavours(&request, splat, &stage.layers)?;
                    let (sums, _) = shaded.measure(&stage.layers, &mut meter, &vec![Some(splat); tracks.len()])?;
                    for (stream, sums) in sums.iter().enumerate() {
                        let picture = meter.picture(gpu, stream, 0)?;
                        add(&picture)?;
                        // Videos show the last signal, which is the lit picture, if it is measured.
                        if definition.video && signals.last() == Some(&tracks[stream].signal) {
                            let place = pictures::sequence(folder, &unit.id, tracks[stream].resolve.name());
                            pictures::write_frame(&place, frame, size, &pictures::displayed(&picture, tracks[stream].signal))?;
                            // Links do not depend on the shading, so they are written only once, with the first resolve, which is `off`.
                            if index == 0 && stream < signals.len() {
                                pictures::write_links(gpu, &meter, &place, frame, &picture)?;
                            }
                        }
                        let measured = frame >= definition.warm_up;
                        let mean = |lag: &LagSums| (measured && lag.linked > 0).then(|| lag.difference / lag.linked as f64);
                        changes[stream].differences.push(sums.lags.each_ref().map(mean));
                        if !measured {
                            continue;
                        }
                        counted[stream] += sums.invalid;
                        histograms[stream].iter_mut().zip(&sums.histogram).for_each(|(all, &n)| *all += u64::from(n));
                    }
                }
                Ok(())
            })?;
            // All resolves of a group get the same shaded pixels, so only the first one is counted. Its counts are the first ones in `counted`, one
            // per signal.
            invalid.iter_mut().zip(&counted).for_each(|(most, &count)| *most = count.max(*most));
            for (changes, histogram) in changes.iter_mut().zip(&histograms) {
                changes.p95 = quantile(histogram, 0.95);
            }
            for (k, &resolve) in resolves.iter().enumerate() {
                let first = k * signals.len();
                let own = signals.iter().zip(&changes[first..]).map(|(signal, changes)| (signal.name().to_owned(), changes.clone()));
                sequences.insert(resolve.to_string(), Sequence { place, pictures: tracks.len(), first, changes: own.collect() });
            }
        }

        let request = {
            let mut r = truth(&choices.request(pose, size, 0));
            r.outputs.aovs = AovSet::from_names(&["albedo"])?;
            r
        };
        let single = renderer.render(&request)?;
        let single = single.vectors("albedo").context("the layer `albedo` is missing")?.to_vec();
        let mut all = Converging::new(single.len(), choices.stages.display);
        let mut wanted = batches;
        loop {
            while all.count < wanted {
                step(u64::from(definition.frames + all.count), total);
                check_interrupted()?;
                all.add(renderer, &request)?;
            }
            if wanted >= most || all.albedo.standard_error(&all.terrain) <= SHARE * all.albedo.distance(&all.terrain, &single) {
                break;
            }
            wanted = (wanted * 2).min(most);
        }
        if !all.terrain.contains(&true) {
            return Err(Unfit(format!(
                "view `{}` shows no terrain in its last frame: move its camera, give fewer frames, or enlarge the picture; use another --out with the changed definition",
                unit.view
            ))
            .into());
        }
        let (albedo, lit) = (all.albedo.mean(), all.lit());
        let most_invalid = invalid.iter().copied().max().unwrap_or(0);
        if most_invalid > 0 {
            eprintln!(
                "note: view `{}`: {most_invalid} pixels of the reference sequence have a colour that is not finite; these pixels are not compared",
                unit.view
            );
        }
        let of_lit = if signals.contains(&Signal::Lit) {
            Some(output.section(|add| packed(&lit).iter().try_for_each(|picture| add(picture)))?)
        } else {
            None
        };
        output.finish()?;
        let standard_error = signals.iter().map(|signal| {
            let moments = if *signal == Signal::Lit { &all.displayed } else { &all.albedo };
            (signal.name().to_owned(), moments.standard_error(&all.terrain))
        });
        let record = Record { spp: all.count * BATCH, standard_error: standard_error.collect(), sequences, lit: of_lit };
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
        let (shown, what) = if of_lit.is_some() { (&lit, Signal::Lit) } else { (&albedo, Signal::Albedo) };
        let caption = format!(
            "96 fetches, {} samples per pixel, standard error {:.2e}; {}",
            record.spp,
            record.standard_error.get(what.name()).copied().unwrap_or(f64::NAN),
            what.name()
        );
        let title = format!("Reference, {}", unit.view);
        sheet.keep(pictures::Kind::Reference, "reference", &title, &caption, size, &pictures::display(shown))?;
        sheet.finish()?;

        let labels = Labels { definition, scene: &renderer.scene().name, unit, estimator: "", noise: "", temporal: "" };
        let mut rows = Vec::new();
        let last = Mark::frame(definition.frames - 1);
        labels.put(&mut rows, "reference", metrics::REFERENCE_SPP, last, f64::from(record.spp), None)?;
        let terrain = all.terrain.iter().filter(|on| **on).count() as f64 / all.terrain.len() as f64;
        labels.put(&mut rows, "reference", metrics::TERRAIN, last, terrain, None)?;
        for (&signal, &pixels) in signals.iter().zip(&invalid) {
            labels.put_of(&mut rows, "reference", signal, metrics::INVALID_PX, Mark::default(), pixels as f64, None)?;
            if let Some(error) = record.standard_error.get(signal.name()) {
                labels.put_of(&mut rows, "reference", signal, metrics::REFERENCE_SE, last, *error, None)?;
            }
            for (resolve, sequence) in &record.sequences {
                // The column `temporal` is empty in rows about the converged reference, which has no resolve. It is therefore also empty in rows
                // about the sequence without a resolve.
                let temporal = if *resolve == Resolve::Off.to_string() { "" } else { resolve.as_str() };
                let labels = Labels { temporal, ..labels };
                if let Some(changes) = sequence.changes.get(signal.name()) {
                    changes.put(&labels, signal, &mut rows)?;
                }
            }
        }
        gpu.check()?;
        Ok(Outcome { rows, times: Vec::new() })
    }
}

impl Changes {
    /// Adds the rows that say how the sequence changes from frame to frame.
    fn put(&self, labels: &Labels<'_>, signal: Signal, rows: &mut Vec<Row>) -> Result<()> {
        let name = metrics::REFERENCE_DIFFERENCE;
        for lag in 0..LAGS {
            let mut over = Moments::<f64>::new();
            for (frame, lags) in (0..).zip(&self.differences) {
                if let Some(value) = lags[lag] {
                    over.add([value, 0.0]);
                    labels.put_of(rows, "reference", signal, name, Mark::frame(frame).lag(lag + 1), value, None)?;
                }
            }
            if over.count > 0 {
                let mark = Mark::default().lag(lag + 1);
                labels.put_of(rows, "reference", signal, name, mark, over.mean(), over.standard_error())?;
            }
        }
        if let Some(p95) = self.p95 {
            labels.put_of(rows, "reference", signal, metrics::REFERENCE_DIFFERENCE_P95, Mark::default().lag(1), p95, None)?;
        }
        Ok(())
    }
}

/// Returns the temporal resolves of a definition, grouped by their sample points. Resolves of one group have the same sequence of shaded pictures.
/// The first group begins with [`Resolve::Off`], even if the definition does not list it.
fn by_sample_points(names: &[String]) -> Result<Vec<Vec<Resolve>>> {
    let mut groups = vec![vec![Resolve::Off]];
    for name in names {
        let resolve: Resolve = parse(name)?;
        let same = |group: &&mut Vec<Resolve>| (0..2).all(|frame| group[0].sample_pattern(frame) == resolve.sample_pattern(frame));
        match groups.iter_mut().find(same) {
            Some(group) if group.contains(&resolve) => {}
            Some(group) => group.push(resolve),
            None => groups.push(vec![resolve]),
        }
    }
    Ok(groups)
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
        let terrain = [true, false];
        for value in [1.0, 2.0, 3.0] {
            all.add([[value; 3], [100.0 * value; 3]].into_iter());
        }
        // At the first pixel, the means of the three batches are 1, 2 and 3. Their variance is 1, so the standard error of the overall mean is
        // sqrt(1 / 3). The second pixel is ignored, because it is not terrain.
        assert!((all.standard_error(&terrain) - (1.0f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!((all.distance(&terrain, &[[2.5; 3], [0.0; 3]]) - 0.5).abs() < 1e-12);
        assert_eq!(all.mean()[0], [2.0; 3]);
    }

    #[test]
    fn resolves_with_the_same_sample_points_share_their_pictures() {
        let groups = |names: &[&str]| by_sample_points(&names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>()).expect("resolves");
        assert_eq!(groups(&["off"]), [vec![Resolve::Off]]);
        assert_eq!(groups(&["flipquad"]), [vec![Resolve::Off], vec![Resolve::FlipQuad]]);
        let all = groups(&["exponential", "flipquad+exponential", "off", "flipquad"]);
        assert_eq!(all, [vec![Resolve::Off, Resolve::Exponential], vec![Resolve::FlipQuadExponential, Resolve::FlipQuad]]);
    }

    #[test]
    fn colours_of_the_lit_reference_are_stored_exactly() {
        let texels = [[0.1, 0.2, 0.3], [f32::MIN_POSITIVE, 1.0, 0.0]];
        let [first, second] = packed(&texels);
        assert_eq!(unpacked(&first, &second), texels);
    }
}

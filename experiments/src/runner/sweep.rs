//! Measures a sweep: all variants of one view, with one estimator, noise and temporal resolve.

use std::path::Path;

use anyhow::{Context, Result};
use kernels::composition::{CompositionStream, Destination, Layers};
use kernels::frame::picture::AovSet;
use kernels::frame::{RenderRequest, VariantChoice};
use kernels::metrics::{AreaSums, Meter, PerceivedFilter, SeedStream, Track, areas, read_signal};
use kernels::shading::{Estimator, VARIANCE_SCALE};
use kernels::shared::moments::Moments;
use kernels::shared::noise::NoiseKind;
use kernels::shared::signal::{self, Signal};
use kernels::temporal::Resolve;
use kernels::variant::{Flavour, Variant};
use rayon::prelude::*;

use super::followed::Followed;
use super::reference::Reference;
use super::{Labels, Mark, Runner, by_patch, composed, costs, flavours_of, pictures, split, views};
use crate::judge;
use crate::metrics::{self, SMALLEST_SIDE};
use crate::process::{Unfit, check_interrupted, error_line};
use crate::row::Row;
use crate::significance::Areas;
use crate::unit::{Outcome, Unit};

/// Limit of the number of bands of a spectrum.
const BANDS: u32 = 24;
/// The square from which a spectrum is computed has at least this many pixels per band along each side, so that each band contains enough
/// frequencies.
const PIXELS_PER_BAND: u32 = 8;
/// Limit of the side of the square from which a spectrum is computed, pixels.
const SPECTRUM_SIDE: u32 = 256;

/// The estimator, noise and resolve of a sweep.
pub(super) struct How {
    pub(super) estimator: Estimator,
    pub(super) noise: NoiseKind,
    pub(super) resolve: Resolve,
}

impl How {
    /// Whether pixels that are shaded by this choice of variants may draw random numbers. If they draw none, the result does not depend on
    /// the noise.
    fn draws(&self, choice: VariantChoice) -> bool {
        Flavour::ALL.into_iter().any(|f| choice.may_use(f) && self.estimator.is_stochastic(Variant::only(f)))
    }
}

impl Runner<'_> {
    /// Measures a sweep: first all frames, then the errors and costs of the last frame. Without a temporal resolve, several seeds of the last frame
    /// follow.
    pub(super) fn sweep(&mut self, unit: &Unit, how: &How, folder: &Path, step: &dyn Fn(u64, u64)) -> Result<Outcome> {
        let definition = self.definition;
        let reference_part = self.reference_of(unit)?;
        // A stream is the sequence of pictures of one variant in one signal. The streams below are ordered by signal, then by variant.
        let signals = definition.measured_signals();
        let reference = match Reference::read(folder, &reference_part, &signals) {
            Ok(reference) => reference,
            // The reference may have been removed or damaged since it was rendered. It is then rendered again.
            Err(error) => {
                eprintln!("note: {}; the reference is rendered again", error_line(&error));
                self.reference(&reference_part, folder, step)?;
                Reference::read(folder, &reference_part, &signals)?
            }
        };
        let size = definition.size;
        let (sequence, frames) = (definition.sequence(), definition.frames);
        let total = u64::from(frames + definition.seeds + 2);
        let mut rows = Vec::new();
        let (estimator, noise, temporal) = (how.estimator.to_string(), how.noise.to_string(), how.resolve.to_string());

        let stage = self.stage.as_mut().context("the renderer was not prepared")?;
        stage.fixed.of(&unit.view, how.estimator);
        // Variants that draw no random numbers may already have been measured by a sweep with a different noise. In this case, their rows
        // are reused.
        let known = stage.fixed.rows.get(&how.resolve).cloned();
        let choices: Vec<(String, VariantChoice)> =
            self.variants.iter().filter(|(_, choice)| known.is_none() || how.draws(*choice)).cloned().collect();
        let with_noise = |row| Row { noise: noise.clone(), ..row };
        if choices.is_empty() {
            // No variant draws random numbers, and all were measured with another noise.
            let known = known.unwrap_or_default();
            return Ok(Outcome { rows: known.into_iter().map(with_noise).collect(), times: Vec::new() });
        }
        let needed = flavours_of(&stage.renderer, &self.variants)
            .ok_or_else(|| Unfit("no variant can be shaded in this scene: give other variants, and another --out".to_owned()))?;
        let variants: Vec<Option<Variant>> = choices.iter().map(|(_, choice)| composed(*choice)).collect();
        let scene = stage.renderer.scene().name.clone();
        let labels = Labels { definition, scene: &scene, unit, estimator: &estimator, noise: &noise, temporal: &temporal };
        let of_frame = stage.choices;
        let request = |pose, frame: u32| {
            of_frame.request(pose, size, frame).with(|r| {
                r.shading.estimator = how.estimator;
                r.shading.noise = how.noise;
                r.shading.sample_pattern = how.resolve.sample_pattern(frame);
            })
        };

        let tracks: Vec<Track> =
            signals.iter().flat_map(|&signal| variants.iter().map(move |_| Track { signal, resolve: how.resolve })).collect();
        let composed: Vec<Option<Variant>> = signals.iter().flat_map(|_| variants.iter().copied()).collect();
        // The meter compares each frame with the 4 previous frames, or with fewer at the start of the sequence.
        let mut meter = stage.renderer.meter(size, &tracks, Some(definition.viewing.of_meter()))?;
        let mut followed: Vec<Followed> = tracks.iter().map(|track| Followed::new(track.signal, sequence)).collect();
        let mut filter = PerceivedFilter::new(size, definition.viewing.pixels_per_degree);
        let mut truth = reference.sequence(how.resolve)?;
        for frame in 0..frames {
            step(u64::from(frame), total);
            check_interrupted()?;
            let pose = views::pose(definition, &stage.renderer, &unit.view, frame)?;
            let request = stage.streamed.request(&mut stage.renderer, definition, &of_frame, &unit.view, frame, request(pose, frame))?;
            let layers = stage.draw(&request, needed)?;
            for (&signal, picture) in signals.iter().zip(truth.next(signals.len())?) {
                meter.write_reference(self.gpu, signal, &picture);
            }
            let (sums, _) = stage.renderer.drawn_as(&request)?.measure(&layers, &mut meter, &composed)?;
            let filmed = |choice: VariantChoice| definition.video && is_pictured(&labels, how, choice);
            for (index, (name, _)) in choices.iter().enumerate().filter(|(_, (_, choice))| filmed(*choice)) {
                // The last signal is the lit picture, if it is measured.
                let stream = tracks.len() - choices.len() + index;
                let codes = pictures::displayed(&meter.picture(self.gpu, stream, 0)?, tracks[stream].signal);
                let sequence = pictures::sequence(folder, &unit.id, name);
                pictures::write_frame(&sequence, frame, size, &codes)?;
                if frame + 1 == frames {
                    let reference = pictures::sequence(folder, &reference_part.id, how.resolve.name());
                    pictures::write_judges(&sequence, &reference, size, definition.viewing.frames_per_second)?;
                }
            }
            if frame < definition.warm_up {
                continue;
            }
            for (stream, (sums, followed)) in sums.iter().zip(&mut followed).enumerate() {
                let (name, _) = &choices[stream % choices.len()];
                followed.add(&labels, &mut rows, name, frame, sums, &truth.sequence.changes, how.resolve)?;
                if sequence.is_seen(frame) {
                    let remembered = meter.memory(self.gpu, stream)?;
                    followed.see(&labels, &mut rows, name, frame, &mut filter, &remembered)?;
                }
            }
        }
        for (stream, followed) in followed.iter().enumerate() {
            followed.over_frames(&labels, &mut rows, &choices[stream % choices.len()].0, &truth.sequence.changes, how.resolve)?;
        }

        // Measures the errors of the last frame and stores pictures of it.
        step(u64::from(frames), total);
        let last = frames - 1;
        let pose = views::pose(definition, &stage.renderer, &unit.view, last)?;
        let judged = stage.streamed.request(&mut stage.renderer, definition, &of_frame, &unit.view, last, request(pose, last))?;
        let mut sheet = pictures::Sheet::new(folder, unit);
        self.errors(how, &choices, &labels, &meter, &reference, &signals, &mut sheet, &mut rows)?;
        self.costs(&choices, &labels, &judged, &meter, &mut sheet, &mut rows)?;
        sheet.finish()?;

        // Bias, variance, clumping and spectrum are measured in pictures with different seeds, and only without a temporal resolve. All pictures are
        // of the last frame. Other frames would give no independent numbers: noise that is bound to the ground appears in them again, in other areas
        // of the picture.
        if how.resolve == Resolve::Off && definition.seeds >= 2 {
            let done = |seed: u32| step(u64::from(frames + 1 + seed), total);
            self.seeds(needed, how, &choices, &labels, &judged, &variants, &mut rows, &done)?;
        }
        self.gpu.check()?;
        let fixed = &mut self.stage.as_mut().context("the renderer was not prepared")?.fixed;
        match known {
            Some(known) => rows.extend(known.into_iter().map(with_noise)),
            None => {
                let names: Vec<&String> = self.variants.iter().filter(|(_, choice)| !how.draws(*choice)).map(|(name, _)| name).collect();
                fixed.rows.insert(how.resolve, rows.iter().filter(|row| names.contains(&&row.variant)).cloned().collect());
            }
        }
        Ok(Outcome { rows, times: Vec::new() })
    }

    /// Measures the errors of each variant in the last frame, and stores pictures.
    #[allow(clippy::too_many_arguments, reason = "the state of a sweep")]
    fn errors(
        &self,
        how: &How,
        choices: &[(String, VariantChoice)],
        labels: &Labels<'_>,
        meter: &Meter,
        reference: &Reference,
        signals: &[Signal],
        sheet: &mut pictures::Sheet,
        rows: &mut Vec<Row>,
    ) -> Result<()> {
        let definition = self.definition;
        let mark = Mark::frame(definition.frames - 1);
        let read = |stream: usize| meter.picture(self.gpu, stream, 0);
        let pictures: Vec<Vec<[u32; 2]>> = (0..meter.streams.len()).map(read).collect::<kernels::base::error::Result<_>>()?;
        // The errors are computed in parallel, because FLIP takes long.
        let judged: Vec<Option<judge::Errors>> = pictures
            .par_iter()
            .zip(&meter.streams)
            .map(|(picture, stream)| {
                let signal = stream.track.signal;
                let truth = reference.colours.get(signal.name()).context("the reference lacks a signal")?;
                let mask: Vec<bool> = picture.iter().zip(&reference.mask).map(|(s, on)| *on && signal::is_terrain(*s)).collect();
                // If no pixel can be compared, there are no errors. The metric `invalid_px` shows whether invalid pixels are the reason.
                let any = mask.contains(&true);
                Ok(if any { Some(judge::errors(definition.size, &pictures::linear(picture, signal), truth, &mask)?) } else { None })
            })
            .collect::<Result<_>>()?;
        for (stream, errors) in judged.iter().enumerate() {
            let Some(errors) = errors else { continue };
            let (name, choice) = &choices[stream % choices.len()];
            let signal = meter.streams[stream].track.signal;
            for (metric, value) in [
                (metrics::MSE, Some(errors.mse)),
                (metrics::RMSE, Some(errors.mse.sqrt())),
                (metrics::MRSE, Some(errors.mrse)),
                (metrics::PSNR, Some(errors.psnr)),
                (metrics::SSIM, errors.ssim),
                (metrics::FLIP, Some(errors.flip.mean)),
            ] {
                if let Some(value) = value {
                    labels.put_of(rows, name, signal, metric, mark, value, None)?;
                }
            }
            // Pictures show the last signal, which is the lit picture, if it is measured.
            if signals.last() == Some(&signal) && is_pictured(labels, how, *choice) {
                let title = format!("{name}, {}", labels.noise);
                let caption = format!("RMSE {:.4}, FLIP {:.4}; {}", errors.mse.sqrt(), errors.flip.mean, signal.name());
                // Where the variant's picture shows no terrain, the stored picture shows the reference.
                let truth = reference.colours.get(signal.name()).context("the reference lacks a signal")?;
                let seen = pictures::displayed(&pictures[stream], signal).into_iter().zip(pictures::display(truth)).zip(&pictures[stream]);
                let codes: Vec<[u8; 3]> = seen.map(|((own, sky), s)| if signal::is_terrain(*s) { own } else { sky }).collect();
                sheet.of(labels, name).keep(pictures::Kind::Frame, name, &title, &caption, definition.size, &codes)?;
                if how.draws(*choice) && definition.frames > 1 {
                    let map = pictures::residual_map(self.gpu, meter, stream, definition.size)?;
                    let caption =
                        "Change of the error since the previous frame, at the same surface points; white = 0.25 or more.".to_owned();
                    let title = format!("Residual flicker of {name}, {}", labels.noise);
                    sheet.keep(pictures::Kind::ResidualMap, &format!("{name}-residual"), &title, &caption, definition.size, &map)?;
                }
            }
        }
        Ok(())
    }

    /// Computes the cost of each variant under the assumption that all pixels of a tile or patch are shaded in lockstep. Also stores a map of the
    /// tiles if three conditions hold: the noise is the first one, the definition contains `auto` or `generic`, and these choose a variant for each
    /// tile, not for each patch.
    #[allow(clippy::too_many_arguments, reason = "the state of a sweep")]
    fn costs(
        &mut self,
        choices: &[(String, VariantChoice)],
        labels: &Labels<'_>,
        judged: &RenderRequest,
        meter: &Meter,
        sheet: &mut pictures::Sheet,
        rows: &mut Vec<Row>,
    ) -> Result<()> {
        let stage = self.stage.as_mut().context("the renderer was not prepared")?;
        let mark = Mark::frame(self.definition.frames - 1);
        let prices = costs::Prices { estimator: judged.shading.estimator, two_tilings: judged.shading.two_tilings };
        let mut mapped = !labels.is_first_noise();
        for (stream, (name, choice)) in choices.iter().enumerate() {
            let cost = match composed(*choice) {
                Some(variant) => Some(f64::from(prices.of(variant))),
                None => {
                    let aovs = AovSet::from_names(if by_patch(&stage.choices) { &["mask", "position"][..] } else { &["mask"][..] })?;
                    // Only the masks are needed, so the cheapest shading is used.
                    let cheap = VariantChoice::Forced(Variant::only(Flavour::FarAtlas));
                    let request = judged.with(|r| {
                        r.outputs.aovs = aovs;
                        r.shading.variant = cheap;
                        r.outputs.lit = false;
                        r.outputs.keep_geometry = true;
                    });
                    let picture = stage.renderer.render(&request)?;
                    let masks: Vec<u8> = picture.values("mask").context("the layer `mask` is missing")?.iter().map(|&m| m as u8).collect();
                    match picture.vectors("position") {
                        Some(positions) => costs::per_patch(&masks, positions, &stage.renderer, &picture.report.drawn, prices),
                        None => {
                            // One map is stored, because `auto` and `generic` choose the same variant for each tile.
                            if !mapped {
                                // If several signals are measured, the picture shows the last one: the lit picture.
                                let shown = meter.streams.len() - choices.len() + stream;
                                let codes = pictures::displayed(&meter.picture(self.gpu, shown, 0)?, meter.streams[shown].track.signal);
                                let sets = costs::tile_sets(&masks, judged.view.size, stage.choices.tile);
                                let map = pictures::tile_map(&sets, &codes);
                                let (kind, legend) = (pictures::Kind::TileMap, pictures::TILE_MAP_LEGEND);
                                sheet.of(labels, name).keep(kind, "tiles", "Tiles of automatic choice", legend, judged.view.size, &map)?;
                                mapped = true;
                            }
                            costs::per_tile(&masks, judged.view.size, stage.choices.tile, prices)
                        }
                    }
                }
            };
            if let Some(cost) = cost {
                labels.put(rows, name, metrics::TILE_FETCHES_PER_PX, mark, cost, None)?;
            }
        }
        Ok(())
    }

    /// Measures bias, variance and clumping of each variant over seeds, and the spectrum for the first seed. For the estimator of Far Cry 5, also
    /// computes the variance that theory predicts.
    #[allow(clippy::too_many_arguments, reason = "the state of a sweep")]
    fn seeds(
        &mut self,
        needed: Variant,
        how: &How,
        choices: &[(String, VariantChoice)],
        labels: &Labels<'_>,
        judged: &RenderRequest,
        variants: &[Option<Variant>],
        rows: &mut Vec<Row>,
        done: &dyn Fn(u32),
    ) -> Result<()> {
        let gpu = self.gpu;
        let stage = self.stage.as_mut().context("the renderer was not prepared")?;
        let renderer = &mut stage.renderer;
        let size = judged.view.size;
        let pixels = size[0] * size[1];
        let [drawing, fixed] = split(needed, how.estimator);

        // The exact blend does not depend on noise and seed, so successive parts with the same pose and frame share it.
        let same = stage.exact.as_ref().is_some_and(|(pose, frame, _)| *pose == judged.view.pose && *frame == judged.shading.frame);
        if !same {
            let layers = Layers::new(gpu, size);
            let request = judged.with(|r| {
                r.shading.estimator = Estimator::Exact;
                r.shading.noise = NoiseKind::HashedIsotropic;
            });
            renderer.draw_flavours(&request, needed, &layers)?;
            stage.exact = Some((judged.view.pose, judged.shading.frame, layers));
        }
        let exact = &stage.exact.as_ref().context("the exact blend was not drawn")?.2;

        let seeds = kernels::metrics::Seeds::new(gpu, size)?;
        let streams: Vec<_> = variants.iter().map(|_| seeds.stream(gpu)).collect();
        let composition: Vec<CompositionStream> = variants.iter().map(|&v| renderer.composition().stream(v)).collect();
        let into = |of: fn(&SeedStream) -> &wgpu::Buffer| -> Vec<Destination<'_>> {
            composition.iter().zip(&streams).map(|(&stream, s)| Destination { stream, signal: of(s), offset: 0 }).collect()
        };
        renderer.drawn_as(judged)?.compose(exact, &into(|s| &s.exact))?;
        if let Some(fixed) = fixed {
            renderer.draw_flavours(judged, fixed, &stage.layers)?;
        }

        let mut errors: Vec<Areas> = vec![Areas::new(areas(size)); variants.len()];
        let mut squared_errors = errors.clone();
        let mut clumping: Vec<Moments<f64>> = vec![Moments::new(); variants.len()];
        let mut taken = 0;
        for seed in 0..self.definition.seeds {
            done(seed);
            check_interrupted()?;
            let request = judged.with(|r| r.shading.seed = judged.shading.seed.wrapping_add(seed));
            if let Some(drawing) = drawing {
                renderer.draw_flavours(&request, drawing, &stage.layers)?;
            }
            renderer.drawn_as(&request)?.compose(&stage.layers, &into(|s| &s.signal))?;
            taken = seed + 1;
            let mut encoder = gpu.encoder("seeds");
            seeds.encode_add(gpu, &mut encoder, &streams, taken);
            gpu.submit_and_wait(encoder)?;
            for (i, sums) in seeds.read(gpu, &streams)?.into_iter().enumerate() {
                let of_areas = |sum: fn(&AreaSums) -> f64| sums.areas.iter().map(move |area| [sum(area), 3.0 * area.terrain]);
                errors[i].add(of_areas(|area| area.error));
                squared_errors[i].add(of_areas(|area| area.squared_error));
                if let Some(value) = sums.clumping() {
                    clumping[i].add([value, 0.0]);
                }
            }
            if seed == 0 && self.definition.measures(metrics::POWER) {
                for ((name, _), stream) in choices.iter().zip(&streams) {
                    let [now, exact] = [&stream.signal, &stream.exact].map(|buffer| read_signal(gpu, buffer, 0, pixels));
                    spectrum(labels, rows, name, size, &now?, &exact?)?;
                }
            }
            // If no flavour draws random numbers, all seeds give the same result, so the first seed is enough.
            if drawing.is_none() {
                break;
            }
        }
        let mut encoder = gpu.encoder("seeds");
        seeds.encode_finish(gpu, &mut encoder, &streams, taken);
        gpu.submit_and_wait(encoder)?;
        let finished = seeds.read_finished(gpu, &streams)?;
        let mark = Mark::frame(judged.shading.frame);
        for (i, (name, choice)) in choices.iter().enumerate() {
            let numbers = (finished[i].terrain * 3.0).max(1.0);
            labels.put_mean(rows, name, Signal::Albedo, metrics::BIAS, mark, errors[i].mean())?;
            if how.draws(*choice)
                && let Some(mean_square) = errors[i].mean_square()
            {
                labels.put_mean(rows, name, Signal::Albedo, metrics::BIAS_SQUARED, mark, mean_square)?;
                // The test of the bias applies only to estimators whose mean should equal the exact blend. The means of the others differ by design.
                // Testing these would also be slow: the test draws random signs until enough results are at least as large as the measured number, so
                // a small p-value takes many draws.
                if how.estimator.bias().is_none()
                    && labels.definition.measures(metrics::BIAS_SQUARED_P)
                    && let Some(probability) = errors[i].probability()
                {
                    labels.put(rows, name, metrics::BIAS_SQUARED_P, mark, probability, None)?;
                }
            }
            // The variance is stored without a standard error, because the scatter over pixels or areas would underestimate it. In some noises, each
            // seed shifts the thresholds of all pixels by one common amount. If the amounts of the seeds are similar by chance, the variance is too
            // small at every pixel. The mean squared error has a standard error, because each picture alone gives an estimate of it. If no pixel is
            // valid with all seeds, there is no variance.
            if finished[i].terrain > 0.0 {
                labels.put(rows, name, metrics::VARIANCE, mark, finished[i].variance / numbers, None)?;
            }
            labels.put_mean(rows, name, Signal::Albedo, metrics::EXACT_MSE, mark, squared_errors[i].mean())?;
            if clumping[i].count > 0 {
                labels.put(rows, name, metrics::CLUMPING, mark, clumping[i].mean(), clumping[i].standard_error())?;
            }
        }

        // The prediction exists only for the estimator of Far Cry 5.
        let cliffs = Variant::new(needed.mask() & (Flavour::NearCliff.bit() | Flavour::FarCliff.bit()));
        if let (Estimator::Fc5, Some(cliffs)) = (how.estimator, cliffs) {
            let theory = Layers::new(gpu, size);
            let frame = renderer.draw_flavours(&judged.with(|r| r.shading.estimator = Estimator::Variance), cliffs, &theory)?;
            let mut squares = into(|s| &s.signal);
            squares.iter_mut().for_each(|to| to.stream.squared = 1);
            frame.compose(&theory, &squares)?;
            for ((name, choice), stream) in choices.iter().zip(&streams) {
                if !cliffs.flavours().any(|flavour| choice.may_use(flavour)) {
                    labels.put(rows, name, metrics::VARIANCE_THEORY, mark, 0.0, None)?;
                    continue;
                }
                let texels = read_signal(gpu, &stream.signal, 0, pixels)?;
                let on = texels.iter().filter(|s| signal::is_terrain(**s));
                let (sum, n) = on.fold((0.0, 0.0f64), |(sum, n), s| (sum + signal::colour(*s).map(f64::from).iter().sum::<f64>(), n + 3.0));
                labels.put(rows, name, metrics::VARIANCE_THEORY, mark, sum / n.max(1.0) / VARIANCE_SCALE, None)?;
            }
        }
        Ok(())
    }
}

/// Whether pictures of a variant are stored. They are stored for single flavours, `auto` and `generic`. If the variant draws no random
/// numbers, its pictures are the same for every noise, so they are stored only for the first noise.
fn is_pictured(labels: &Labels<'_>, how: &How, choice: VariantChoice) -> bool {
    composed(choice).is_none_or(|variant| variant.flavours().count() == 1) && (how.draws(choice) || labels.is_first_noise())
}

/// Adds the rows of the spectrum of the error, which is the difference in luminance between the picture `now` and the exact blend. The spectrum is
/// computed from a square at the middle of the picture's lower border. It is the largest such square that shows only terrain and whose side is a
/// multiple of 16 pixels, at most [`SPECTRUM_SIDE`]. No rows are added if its side is smaller than [`SMALLEST_SIDE`], or if the error is below 1e-6
/// at every pixel of the square.
fn spectrum(labels: &Labels<'_>, rows: &mut Vec<Row>, name: &str, size: [u32; 2], now: &[[u32; 2]], exact: &[[u32; 2]]) -> Result<()> {
    let mut side = SPECTRUM_SIDE.min(size[0]).min(size[1]) / 16 * 16;
    let inside = |side: u32| {
        let (left, top) = ((size[0] - side) / 2, size[1] - side);
        (0..side * side).map(move |i| ((top + i / side) * size[0] + left + i % side) as usize)
    };
    while side >= SMALLEST_SIDE && !inside(side).all(|at| signal::is_terrain(now[at])) {
        side -= 16;
    }
    if side < SMALLEST_SIDE {
        return Ok(());
    }
    #[allow(clippy::cast_possible_truncation, reason = "the transform is in f32")]
    let error = |at: usize| (signal::luminance(signal::colour(now[at])) - signal::luminance(signal::colour(exact[at]))) as f32;
    let field: Vec<f32> = inside(side).map(error).collect();
    if field.iter().all(|e| e.abs() < 1e-6) {
        return Ok(());
    }
    let mark = Mark::frame(labels.definition.frames - 1);
    let bands = BANDS.min(side / PIXELS_PER_BAND) as usize;
    for band in judge::spectrum::radial_power(&field, [side, side], bands)? {
        let mark = Mark { frequency: Some(band.frequency_cycles_per_px), ..mark };
        labels.put(rows, name, metrics::POWER, mark, band.power, Some(band.standard_error))?;
    }
    Ok(())
}

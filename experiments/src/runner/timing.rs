//! Measures the device times of variants. Each variant is shaded by its own pipeline, which counts no fetches.

use std::collections::BTreeMap;

use anyhow::{Context, Result};
use kernels::shading::Estimator;
use kernels::shared::moments::Moments;
use kernels::shared::noise::NoiseKind;
use statrs::statistics::{Data, Median as _};

use super::{Labels, Mark, Runner, views};
use crate::metrics;
use crate::process::check_interrupted;
use crate::unit::{Outcome, Unit};

/// Number of timed pictures of each variant. An additional picture before them is not timed. It warms up pipelines, pages and caches.
const ROUNDS: u32 = 3;

impl Runner<'_> {
    /// Measures the times of all passes of each variant in the first frame. The result is the median of three pictures. The variants take turns, so
    /// that a drift of the machine's speed affects all variants equally.
    pub(super) fn time(&mut self, unit: &Unit, estimator: Estimator, noise: NoiseKind, step: &dyn Fn(u64, u64)) -> Result<Outcome> {
        let definition = self.definition;
        let stage = self.stage.as_mut().context("the renderer was not prepared")?;
        let choices = stage.choices;
        let renderer = &mut stage.renderer;
        let pose = views::pose(definition, renderer, &unit.view, 0)?;
        let total = u64::from(ROUNDS + 1) * self.variants.len() as u64;
        let mut times: BTreeMap<(usize, String), Vec<f64>> = BTreeMap::new();
        let mut done = 0;
        for round in 0..=ROUNDS {
            for (index, (_, choice)) in self.variants.iter().enumerate() {
                step(done, total);
                check_interrupted()?;
                done += 1;
                // All variants have the same geometry, so it is drawn only by the first picture of each round.
                let request = choices.request(pose, definition.size, 0).with(|r| {
                    r.shading.variant = *choice;
                    r.shading.estimator = estimator;
                    r.shading.noise = noise;
                    r.outputs.keep_geometry = index > 0;
                });
                let report = renderer.draw(&request)?.into_report();
                if round > 0 {
                    for pass in report.passes {
                        times.entry((index, pass.name)).or_default().push(pass.time_ms);
                    }
                }
            }
        }
        let (estimator, noise) = (estimator.to_string(), noise.to_string());
        let scene = renderer.scene().name.clone();
        let labels = Labels { definition, scene: &scene, unit, estimator: &estimator, noise: &noise, temporal: "off" };
        let mut rows = Vec::new();
        for ((index, pass), ms) in times {
            let mut spread = Moments::<f64>::new();
            ms.iter().for_each(|&v| spread.add([v, 0.0]));
            let name = &self.variants[index].0;
            labels.put(&mut rows, name, &metrics::time_of(&pass), Mark::frame(0), Data::new(ms).median(), spread.standard_error())?;
        }
        Ok(Outcome { rows: Vec::new(), times: rows })
    }
}

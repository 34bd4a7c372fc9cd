//! Measures the device times of variants. Pixels are shaded by pipelines that count no fetches.

use std::time::Instant;

use anyhow::{Context, Result};
use kernels::frame::VariantChoice;
use kernels::shading::Estimator;
use kernels::shared::noise::NoiseKind;

use super::{Labels, Mark, Runner, parse, views};
use crate::definition::Definition;
use crate::metrics::{self, SHADING_PASS, SHARED_PASSES};
use crate::process::check_interrupted;
use crate::rounds::{self, LEAST, Plan, Timed, Turn, Wanted};
use crate::unit::{Outcome, Unit};

/// A way to shade that is timed.
type Candidate = (VariantChoice, Estimator, NoiseKind);

/// Returns the candidates of a part, and the index of the candidate by whose times all times are divided. The candidates are the variants of the
/// definition, with the estimator and noise of the part. The divisor is the first variant with the first estimator and noise of the definition. It is
/// the same for all parts of a view with the same setting, so their ratios can be compared. If the part has another estimator or noise, the divisor
/// is added as the last candidate.
fn candidates(
    definition: &Definition,
    variants: &[(String, VariantChoice)],
    estimator: Estimator,
    noise: NoiseKind,
) -> Result<(Vec<Candidate>, usize)> {
    let mut candidates: Vec<Candidate> = variants.iter().map(|(_, choice)| (*choice, estimator, noise)).collect();
    let first = |names: &[String]| names.first().cloned().context("the definition has no estimator or no noise");
    let base: (Estimator, NoiseKind) = (parse(&first(&definition.estimators)?)?, parse(&first(&definition.noises)?)?);
    if base == (estimator, noise) {
        return Ok((candidates, 0));
    }
    let (_, choice) = variants.first().context("the definition has no variant")?;
    candidates.push((*choice, base.0, base.1));
    Ok((candidates, variants.len()))
}

/// Returns the numbers whose confidence intervals decide when timing ends. They are the ratios of shading times or, if there is only one candidate,
/// its shading time.
fn wanted(candidates: usize, base: usize) -> Vec<Wanted<'static>> {
    let over = (candidates > 1).then_some((base, SHADING_PASS));
    (0..candidates).filter(|&i| i != base || over.is_none()).map(|i| Wanted { of: (i, SHADING_PASS), over }).collect()
}

impl Runner<'_> {
    /// Measures the times of the passes of each variant in the first frame, and their ratios to the times of the first variant with the first
    /// estimator and noise. Passes that all variants share are stored with one variant. [`rounds`] decides in which order the pictures are drawn, and
    /// how many.
    pub(super) fn time(&mut self, unit: &Unit, estimator: Estimator, noise: NoiseKind, step: &dyn Fn(u64, u64)) -> Result<Outcome> {
        let definition = self.definition;
        let stage = self.stage.as_mut().context("the renderer was not prepared")?;
        let choices = stage.choices;
        let renderer = &mut stage.renderer;
        let pose = views::pose(definition, renderer, &unit.view, 0)?;
        let (candidates, base) = candidates(definition, &self.variants, estimator, noise)?;
        let wanted = wanted(candidates.len(), base);
        let plan = Plan {
            candidates: candidates.len(),
            wanted: &wanted,
            least: LEAST,
            budget_s: definition.times_budget_s,
            seed: u32::try_from(unit.index).unwrap_or(u32::MAX),
        };
        let mut draw = |turn: Turn| -> Result<Vec<Timed>> {
            check_interrupted()?;
            let (choice, estimator, noise) = candidates[turn.candidate];
            let request = choices.request(pose, definition.size, 0).with(|r| {
                r.shading.variant = choice;
                r.shading.estimator = estimator;
                r.shading.noise = noise;
                // All candidates have the same geometry, so it is drawn only by the first picture of each round.
                r.outputs.keep_geometry = !turn.is_first;
            });
            let passes = renderer.draw(&request)?.into_report().passes;
            // The geometry is drawn by the first picture of a round, which is a random candidate. All times of shared passes are assigned to
            // candidate 0, so that each of these passes has one series.
            let owner = |pass: &str| if SHARED_PASSES.contains(&pass) { 0 } else { turn.candidate };
            Ok(passes.into_iter().map(|pass| Timed { candidate: owner(&pass.name), pass: pass.name, ms: pass.time_ms }).collect())
        };
        let began = Instant::now();
        let samples = rounds::measure(&plan, &|| began.elapsed().as_secs_f64(), step, &mut draw)?;

        let (estimator, noise) = (estimator.to_string(), noise.to_string());
        let scene = renderer.scene().name.clone();
        let labels = Labels { definition, scene: &scene, unit, estimator: &estimator, noise: &noise, temporal: "off" };
        let mut rows = Vec::new();
        // If the candidate by which all times are divided belongs to another part, it is not among the variants of this part. It is then skipped,
        // because the other part stores its rows.
        for (candidate, pass) in samples.keys() {
            let Some((name, _)) = self.variants.get(candidate) else { continue };
            let (key, base) = ((candidate, pass), (base, pass));
            for (metric, estimate) in [(metrics::time_of(pass), samples.time(key)), (metrics::ratio_of(pass), samples.ratio(key, base))] {
                if let Some(found) = estimate {
                    labels.put(&mut rows, name, &metric, Mark::frame(0), found.value, found.standard_error())?;
                }
            }
        }
        Ok(Outcome { rows: Vec::new(), times: rows })
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::definition;

    fn definition() -> Definition {
        let text = "name = 'a'\nquestion = 'b'\nviews = ['cliff']\nsize = [64, 64]\nframes = 1\nvariants = ['auto', 'splat']\n\
                    estimators = ['fc5', 'exact']\nnoises = ['hashed', 'white']\ntimes = 'all'";
        definition::parse(text, "a", Path::new("")).expect("a definition")
    }

    #[test]
    fn all_parts_of_a_view_divide_by_the_same_candidate() {
        let definition = definition();
        let variants = definition.variant_choices().expect("variants");
        let first = (variants[0].1, Estimator::Fc5, NoiseKind::HashedIsotropic);
        for (estimator, noise, own) in [
            (Estimator::Fc5, NoiseKind::HashedIsotropic, true),
            (Estimator::Exact, NoiseKind::HashedIsotropic, false),
            (Estimator::Fc5, NoiseKind::WhiteScreen, false),
        ] {
            let (all, base) = candidates(&definition, &variants, estimator, noise).expect("candidates");
            assert_eq!(all[base], first);
            assert_eq!(all[..2], [(variants[0].1, estimator, noise), (variants[1].1, estimator, noise)]);
            assert_eq!((all.len(), base), if own { (2, 0) } else { (3, 2) });
        }
    }

    #[test]
    fn all_ratios_of_shading_times_are_wanted() {
        let keys = |candidates, base| wanted(candidates, base).into_iter().map(|wanted| (wanted.of.0, wanted.over)).collect::<Vec<_>>();
        let over = |base| Some((base, SHADING_PASS));
        assert_eq!(keys(3, 0), [(1, over(0)), (2, over(0))]);
        assert_eq!(keys(3, 2), [(0, over(2)), (1, over(2))]);
        // One variant alone has no ratio, so its own time is wanted.
        assert_eq!(keys(1, 0), [(0, None)]);
    }
}

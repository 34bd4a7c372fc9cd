//! Follows a stream, which is one way to shade with one signal, over the frames of a sequence. Makes the rows of each frame, and the rows over all
//! frames.

use std::collections::BTreeMap;

use anyhow::Result;
use kernels::metrics::{BINS, FrameSums, PerceivedFilter, Residual, quantile};
use kernels::motion::LAGS;
use kernels::shared::moments::Moments;
use kernels::shared::signal::Signal;
use kernels::temporal::Resolve;

use super::reference::Changes;
use super::{Labels, Mark};
use crate::metrics::{self, GROUPS, Sequence};
use crate::row::Row;
use crate::significance::Mean;

/// Sums of one stream over all frames. The values over all frames are computed from these sums.
pub(super) struct Followed {
    signal: Signal,
    sequence: Sequence,
    invalid: u64,
    fetches: Moments<f64>,
    rejections: Moments<f64>,
    perceived: Moments<f64>,
    lags: [Lag; LAGS],
    histogram: [u64; BINS],
    residual_histogram: [u64; BINS],
}

#[derive(Clone, Default)]
struct Lag {
    flips: Moments<f64>,
    difference: Moments<f64>,
    excess: Moments<f64>,
    disoccluded: Moments<f64>,
    /// For each group of consecutive frames: the sums of the comparison with the reference sequence.
    residuals: Vec<Residual>,
}

/// Computes a metric from the sums of the comparison with the reference sequence; `None` if there is nothing to compare.
type OfResidual = fn(&Residual) -> Option<f64>;

/// The metrics that are computed from a [`Residual`].
const OF_RESIDUAL: [(&str, OfResidual); 4] = [
    (metrics::RESIDUAL, Residual::mean),
    (metrics::RESIDUAL_RMS, Residual::rms),
    (metrics::ADDED, Residual::added),
    (metrics::LOST, Residual::lost),
];

/// Adds the value of one frame to `moments`, and returns the value.
fn add(moments: &mut Moments<f64>, value: f64) -> f64 {
    moments.add([value, 0.0]);
    value
}

impl Followed {
    /// Returns sums to which no frame has been added.
    pub(super) fn new(signal: Signal, sequence: Sequence) -> Followed {
        let groups = sequence.measured().min(GROUPS) as usize;
        Followed {
            signal,
            sequence,
            invalid: 0,
            fetches: Moments::new(),
            rejections: Moments::new(),
            perceived: Moments::new(),
            lags: std::array::from_fn(|_| Lag { residuals: vec![Residual::default(); groups], ..Lag::default() }),
            histogram: [0; BINS],
            residual_histogram: [0; BINS],
        }
    }

    /// Returns the index of the group of consecutive frames ([`GROUPS`]) to which a measured frame belongs.
    fn group(&self, frame: u32) -> usize {
        let (frames, frame) = (self.sequence.measured(), frame - self.sequence.warm_up);
        (u64::from(frame) * u64::from(frames.min(GROUPS)) / u64::from(frames)) as usize
    }

    /// Adds the sums of a frame, and the frame's rows. `name`: the variant. `changes`: the changes of the reference sequence, by signal.
    #[allow(clippy::too_many_arguments, reason = "the state of a sweep")]
    pub(super) fn add(
        &mut self,
        labels: &Labels<'_>,
        rows: &mut Vec<Row>,
        name: &str,
        frame: u32,
        sums: &FrameSums,
        changes: &BTreeMap<String, Changes>,
        resolve: Resolve,
    ) -> Result<()> {
        let (signal, group) = (self.signal, self.group(frame));
        let once = self.is_first_signal(labels);
        let mark = Mark::frame(frame);
        let terrain = (sums.terrain as f64).max(1.0);
        self.invalid += sums.invalid;
        let fetches = add(&mut self.fetches, sums.fetches as f64 / terrain);
        if once {
            labels.put(rows, name, metrics::FETCHES_PER_PX, mark, fetches, None)?;
        }
        if sums.tested > 0 && resolve == Resolve::Off {
            let share = add(&mut self.rejections, sums.rejected as f64 / sums.tested as f64);
            labels.put_of(rows, name, signal, metrics::TAA_REJECTIONS, mark, share, None)?;
        }
        for (lag, (sums, followed)) in sums.lags.iter().zip(&mut self.lags).enumerate().take(frame as usize) {
            let mark = mark.lag(lag + 1);
            if sums.terrain == 0 {
                // For lags above 1, the meter follows only a quarter of the pixels. It is possible that none of these pixels shows terrain.
                continue;
            }
            let linked = sums.linked as f64;
            let disoccluded = add(&mut followed.disoccluded, 1.0 - linked / sums.terrain as f64);
            if once {
                labels.put(rows, name, metrics::DISOCCLUDED, mark, disoccluded, None)?;
            }
            if sums.linked == 0 {
                continue;
            }
            let difference = add(&mut followed.difference, sums.difference / linked);
            labels.put_of(rows, name, signal, metrics::DIFFERENCE, mark, difference, None)?;
            let of_reference = changes.get(signal.name()).and_then(|changes| changes.differences.get(frame as usize)?[lag]);
            if let Some(own) = of_reference {
                let excess = add(&mut followed.excess, difference - own);
                labels.put_of(rows, name, signal, metrics::EXCESS_DIFFERENCE, mark, excess, None)?;
            }
            followed.residuals[group].add(&sums.residual);
            for (metric, of) in OF_RESIDUAL {
                if let Some(value) = of(&sums.residual) {
                    labels.put_of(rows, name, signal, metric, mark, value, None)?;
                }
            }
            if sums.chosen > 0 {
                let share = add(&mut followed.flips, sums.flipped as f64 / sums.chosen as f64);
                if once {
                    labels.put(rows, name, metrics::FLIP_RATE, mark, share, None)?;
                }
            }
        }
        self.histogram.iter_mut().zip(&sums.histogram).for_each(|(all, &n)| *all += u64::from(n));
        self.residual_histogram.iter_mut().zip(&sums.residual_histogram).for_each(|(all, &n)| *all += u64::from(n));
        Ok(())
    }

    /// Adds the perceived noise of a frame. `remembered`: for each pixel, the mean over time of the stream's error, and the number of frames in this
    /// mean, as `Meter::memory` returns them after this frame.
    pub(super) fn see(
        &mut self,
        labels: &Labels<'_>,
        rows: &mut Vec<Row>,
        name: &str,
        frame: u32,
        filter: &mut PerceivedFilter,
        remembered: &[[f32; 2]],
    ) -> Result<()> {
        if let Some(noise) = filter.perceived_noise(remembered) {
            let noise = add(&mut self.perceived, noise);
            labels.put_of(rows, name, self.signal, metrics::PERCEIVED_NOISE, Mark::frame(frame), noise, None)?;
        }
        Ok(())
    }

    /// Whether the metrics that do not depend on the signal are reported for this stream. The other signals have the same values.
    fn is_first_signal(&self, labels: &Labels<'_>) -> bool {
        labels.definition.measured_signals().first() == Some(&self.signal)
    }

    /// Adds the rows over all frames.
    pub(super) fn over_frames(
        &self,
        labels: &Labels<'_>,
        rows: &mut Vec<Row>,
        name: &str,
        changes: &BTreeMap<String, Changes>,
        resolve: Resolve,
    ) -> Result<()> {
        let all = Mark::default();
        let once = self.is_first_signal(labels);
        let mut put = |metric: &str, mark: Mark, moments: &Moments<f64>| {
            if moments.count == 0 {
                return Ok(());
            }
            labels.put_mean(rows, name, self.signal, metric, mark, mean_of(moments))
        };
        if once {
            put(metrics::FETCHES_PER_PX, all, &self.fetches)?;
        }
        if resolve == Resolve::Off {
            put(metrics::TAA_REJECTIONS, all, &self.rejections)?;
        }
        put(metrics::PERCEIVED_NOISE, all, &self.perceived)?;
        for (lag, sums) in self.lags.iter().enumerate() {
            let mark = all.lag(lag + 1);
            if once {
                put(metrics::DISOCCLUDED, mark, &sums.disoccluded)?;
                put(metrics::FLIP_RATE, mark, &sums.flips)?;
            }
            put(metrics::DIFFERENCE, mark, &sums.difference)?;
            put(metrics::EXCESS_DIFFERENCE, mark, &sums.excess)?;
        }
        for (lag, sums) in self.lags.iter().enumerate() {
            for (metric, of) in OF_RESIDUAL {
                if let Some(mean) = jackknife(&sums.residuals, of) {
                    labels.put_mean(rows, name, self.signal, metric, all.lag(lag + 1), mean)?;
                }
            }
        }
        let first = all.lag(1);
        let of_reference = changes.get(self.signal.name()).and_then(|changes| changes.p95);
        if let (Some(p95), Some(own)) = (quantile(&self.histogram, 0.95), of_reference) {
            labels.put_of(rows, name, self.signal, metrics::EXCESS_DIFFERENCE_P95, first, p95 - own, None)?;
        }
        if let Some(p95) = quantile(&self.residual_histogram, 0.95) {
            labels.put_of(rows, name, self.signal, metrics::RESIDUAL_P95, first, p95, None)?;
        }
        labels.put_of(rows, name, self.signal, metrics::INVALID_PX, all, self.invalid as f64, None)
    }
}

/// Returns the mean over frames. The degrees of freedom of its standard error are the number of frames less one. For fewer than two frames, the
/// standard error and its degrees of freedom are `None`.
fn mean_of(moments: &Moments<f64>) -> Mean {
    let standard_error = moments.standard_error();
    Mean { value: moments.mean(), standard_error, freedom: standard_error.map(|_| f64::from(moments.count - 1)) }
}

/// Returns the value over all groups and its standard error, by the delete-one jackknife over groups (Efron and Tibshirani 1993, *An Introduction to
/// the Bootstrap*, chapter 11). The degrees of freedom of the standard error are the number of groups with compared pixels, less one. With fewer than
/// two such groups, the standard error and its degrees of freedom are `None`. Returns `None` if there is no value.
fn jackknife(groups: &[Residual], of: OfResidual) -> Option<Mean> {
    let mut all = Residual::default();
    groups.iter().for_each(|group| all.add(group));
    let value = of(&all)?;
    let without: Vec<f64> = groups.iter().filter(|group| group.compared > 0).filter_map(|group| of(&all.without(group))).collect();
    let count = without.len() as f64;
    if without.len() < 2 {
        return Some(Mean { value, standard_error: None, freedom: None });
    }
    let mean = without.iter().sum::<f64>() / count;
    let squares: f64 = without.iter().map(|v| (v - mean).powi(2)).sum();
    Some(Mean { value, standard_error: Some(((count - 1.0) / count * squares).sqrt()), freedom: Some(count - 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_jackknife_of_a_mean_is_its_standard_error() {
        let group = |mean: f64| Residual { compared: 10, sum: 10.0 * mean, ..Residual::default() };
        let values = [0.3, 0.1, 0.4, 0.1, 0.5];
        let mut moments = Moments::<f64>::new();
        values.iter().for_each(|&v| moments.add([v, 0.0]));
        let mut groups: Vec<Residual> = values.iter().map(|&v| group(v)).collect();
        // Groups without linked pixels do not count, such as a group that contains only the first frame.
        groups.push(Residual::default());
        let Mean { value, standard_error, freedom } = jackknife(&groups, Residual::mean).expect("a value");
        assert!((value - moments.mean()).abs() < 1e-12);
        assert!((standard_error.expect("five groups") - moments.standard_error().expect("five values")).abs() < 1e-12);
        assert_eq!([freedom, mean_of(&moments).freedom], [Some(4.0); 2]);
        let one = Mean { value: 0.3, standard_error: None, freedom: None };
        assert_eq!(jackknife(&groups[..1], Residual::mean), Some(one), "one group has no scatter");
        let mut first = Moments::<f64>::new();
        first.add([0.3, 0.0]);
        assert_eq!(mean_of(&first), one, "one frame has no scatter");
        assert_eq!(jackknife(&[Residual::default()], Residual::mean), None, "no linked pixel");
    }

    #[test]
    fn frames_fill_the_groups_in_order() {
        for (frames, warm_up) in [(1, 0), (2, 0), (2, 1), (19, 0), (20, 0), (21, 0), (40, 24), (400, 0), (100_000, 7)] {
            let followed = Followed::new(Signal::Albedo, Sequence { frames, warm_up });
            let groups: Vec<usize> = (warm_up..frames).map(|frame| followed.group(frame)).collect();
            assert!(groups.is_sorted() && groups[0] == 0, "{frames} frames");
            assert_eq!(groups[groups.len() - 1] + 1, followed.lags[0].residuals.len(), "{frames} frames");
        }
    }
}

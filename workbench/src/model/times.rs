//! Statistics of the times to draw pictures. They cover the last pictures that were drawn under the same conditions, see `Load`. The first of these
//! pictures is left out.

use std::collections::VecDeque;
use std::time::Duration;

use kernels::gpu::PassTime;

use super::compare::Compare;
use super::picture::Shown;
use super::settings::Settings;

/// Largest number of pictures whose times are kept: more than a screen shows in two seconds.
const PICTURES: usize = 600;
/// Length of the period, ending now, over which the number of pictures per second is averaged.
const RATE_OVER: Duration = Duration::from_secs(2);

/// The conditions that affect how long a picture takes to draw, except the frame number and the camera. A picture with other conditions starts new
/// statistics.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Load {
    settings: Settings,
    compare: Compare,
    measures: bool,
    inspects: bool,
    seeks: bool,
    culled_from_elsewhere: bool,
    size: [u32; 2],
    draft: bool,
    shaders: u64,
}

impl Load {
    /// The conditions under which a picture was drawn.
    pub(crate) fn of(shown: &Shown) -> Load {
        let Shown { wish, draft, shaders, .. } = shown;
        Load {
            settings: wish.settings.clone(),
            compare: wish.compare.clone(),
            measures: wish.metrics.on && !wish.metrics.frozen,
            inspects: wish.probe.is_some(),
            seeks: wish.seeks,
            culled_from_elsewhere: wish.culled_from.is_some(),
            size: wish.size,
            draft: *draft,
            shaders: *shaders,
        }
    }
}

/// Median and spread of some times, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Spread {
    pub(crate) median: f64,
    /// First and third quartile.
    pub(crate) quartiles: [f64; 2],
    pub(crate) longest: f64,
    /// Number of times.
    pub(crate) count: usize,
}

impl Spread {
    /// Computes median and spread. `None` = there are no times. With an even number of times, the median is the higher of the two middle times.
    pub(crate) fn of(times: impl IntoIterator<Item = f64>) -> Option<Spread> {
        let mut sorted: Vec<f64> = times.into_iter().collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied();
        Some(Spread { median: at(0.5)?, quartiles: [at(0.25)?, at(0.75)?], longest: *sorted.last()?, count: sorted.len() })
    }
}

/// The times of the last pictures that were drawn under the same conditions.
#[derive(Debug, Default)]
pub(crate) struct Times {
    load: Option<Load>,
    /// Time to draw the first picture after a change of conditions; `None` = a second picture has been drawn since, or there is no picture.
    first: Option<Duration>,
    drawing: VecDeque<f64>,
    intervals: VecDeque<f64>,
    /// The passes of the last picture, in their order, with the times of the last pictures.
    passes: Vec<(String, VecDeque<f64>)>,
}

impl Times {
    /// Adds the times of a picture. `interval` is the time since the previous picture; `None` = time was paused in between. If `load` is not that of
    /// the previous picture, all earlier times are removed, and the statistics do not include this picture. The reason is that it may have waited for
    /// shaders to be compiled or for terrain to be loaded.
    pub(crate) fn add(&mut self, load: Load, took: Duration, interval: Option<Duration>, passes: &[PassTime]) {
        if self.load.as_ref() != Some(&load) {
            *self = Times { load: Some(load), first: Some(took), ..Times::default() };
            return;
        }
        self.first = None;
        remember(&mut self.drawing, took.as_secs_f64() * 1e3);
        if let Some(interval) = interval {
            remember(&mut self.intervals, interval.as_secs_f64() * 1e3);
        }
        let mut before = std::mem::take(&mut self.passes);
        for PassTime { name, time_ms } in passes {
            let known = before.iter().position(|(known, _)| known == name);
            let mut times = known.map(|at| before.swap_remove(at).1).unwrap_or_default();
            remember(&mut times, *time_ms);
            self.passes.push((name.clone(), times));
        }
    }

    /// Time to draw the first picture after a change of conditions; `None` = a second picture has been drawn since, or there is no picture.
    pub(crate) fn first(&self) -> Option<Duration> {
        self.first
    }

    /// Pictures per second over the last two seconds in which time ran; `None` = there are no intervals.
    pub(crate) fn rate(&self) -> Option<f64> {
        let (mut count, mut sum) = (0, 0.0);
        for interval in self.intervals.iter().rev() {
            if count > 0 && sum + interval > RATE_OVER.as_secs_f64() * 1e3 {
                break;
            }
            (count, sum) = (count + 1, sum + interval);
        }
        (sum > 0.0).then(|| 1e3 * f64::from(count) / sum)
    }

    /// Times from picture to picture, milliseconds, the newest last.
    pub(crate) fn intervals(&self) -> &VecDeque<f64> {
        &self.intervals
    }

    /// Times from the start of drawing to the finished pictures.
    pub(crate) fn drawing(&self) -> Option<Spread> {
        Spread::of(self.drawing.iter().copied())
    }

    /// The passes of the last picture with their device times.
    pub(crate) fn passes(&self) -> impl Iterator<Item = (&str, Spread)> {
        self.passes.iter().filter_map(|(name, times)| Some((name.as_str(), Spread::of(times.iter().copied())?)))
    }
}

/// Adds a time to a list, and removes the oldest time if there are more than [`PICTURES`].
pub(super) fn remember<T>(times: &mut VecDeque<T>, time: T) {
    times.push_back(time);
    if times.len() > PICTURES {
        times.pop_front();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load() -> Load {
        let scene = kernels::scene::load(kernels::scene::DEFAULT).expect("the built-in scene");
        Load {
            settings: Settings::new(scene),
            compare: Compare::default(),
            measures: false,
            inspects: false,
            seeks: false,
            culled_from_elsewhere: false,
            size: [640, 360],
            draft: false,
            shaders: 1,
        }
    }

    fn ms(time: u64) -> Duration {
        Duration::from_millis(time)
    }

    fn passes(times: &[(&str, f64)]) -> Vec<PassTime> {
        times.iter().map(|(name, time_ms)| PassTime { name: (*name).to_owned(), time_ms: *time_ms }).collect()
    }

    #[test]
    fn median_quartiles_and_longest_of_times() {
        assert_eq!(Spread::of([]), None);
        let spread = Spread::of([30.0, 10.0, 200.0, 20.0, 15.0]).expect("times");
        assert_eq!(spread, Spread { median: 20.0, quartiles: [15.0, 30.0], longest: 200.0, count: 5 });
        assert_eq!(Spread::of([7.0]), Some(Spread { median: 7.0, quartiles: [7.0; 2], longest: 7.0, count: 1 }));
    }

    #[test]
    fn the_first_picture_after_a_change_does_not_count() {
        let mut times = Times::default();
        times.add(load(), ms(900), None, &passes(&[("geometry", 700.0)]));
        assert_eq!((times.first(), times.drawing(), times.rate()), (Some(ms(900)), None, None));
        assert_eq!(times.passes().count(), 0);
        for took in [10, 30, 20] {
            times.add(load(), ms(took), Some(ms(100)), &passes(&[("geometry", took as f64), ("shading", 1.0)]));
        }
        assert_eq!(times.first(), None);
        assert_eq!(times.drawing().map(|spread| (spread.median, spread.longest, spread.count)), Some((20.0, 30.0, 3)));
        let of_passes: Vec<(String, f64, usize)> = times.passes().map(|(name, s)| (name.to_owned(), s.median, s.count)).collect();
        assert_eq!(of_passes, [("geometry".to_owned(), 20.0, 3), ("shading".to_owned(), 1.0, 3)]);
        for changed in [Load { size: [1, 1], ..load() }, Load { shaders: 2, ..load() }] {
            times.add(changed, ms(500), Some(ms(700)), &[]);
            assert_eq!((times.first(), times.drawing(), times.rate()), (Some(ms(500)), None, None));
        }
    }

    #[test]
    fn the_rate_is_that_of_the_last_two_seconds_without_pauses() {
        let mut times = Times::default();
        times.add(load(), ms(1), None, &[]);
        // Slow pictures, a pause, and then fast pictures for more than two seconds.
        (0..5).for_each(|_| times.add(load(), ms(1), Some(ms(400)), &[]));
        times.add(load(), ms(1), None, &[]);
        assert!((times.rate().expect("intervals") - 2.5).abs() < 1e-9);
        (0..25).for_each(|_| times.add(load(), ms(1), Some(ms(100)), &[]));
        assert!((times.rate().expect("intervals") - 10.0).abs() < 1e-9);
        // A single picture that took longer than two seconds still has a rate.
        times.add(load(), ms(1), Some(ms(4000)), &[]);
        assert!((times.rate().expect("intervals") - 0.25).abs() < 1e-9);
        (0..1000).for_each(|_| times.add(load(), ms(1), Some(ms(10)), &[]));
        assert_eq!(times.intervals().len(), PICTURES);
    }
}

//! Statistics of surface points over frames, for live views of noise and flicker.
//!
//! [`Links`](crate::motion::Links) finds, for each pixel, the pixel that showed the same surface point one frame earlier. [`Followed`] takes the
//! moments (mean, variance and others) from that pixel and adds the new frame. The moments are exponential averages over a window of n frames: a new
//! frame has the weight 1/n, and a new difference between two frames has the weight 1/(n - 1). While a point has been visible in fewer than n frames,
//! all these frames have the same weight. If a point was not visible one frame earlier, its statistics start again.

use rayon::prelude::*;

use crate::motion::NO_LINK;

/// Edge length of the blocks from which clumping is computed, pixels. The metrics of experiments use blocks of the same size.
const BLOCK: usize = super::BLOCK as usize;

/// One pixel of one picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Luminance of linear albedo; a negative value = no terrain.
    pub luminance: f32,
    /// The first random choice, 0 = none.
    pub choice: u8,
    /// Luminance minus the luminance of the comparison picture; 0 without a comparison.
    pub error: f32,
}

/// Running moments of a pixel's surface point.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Number of frames included, at most the length of the window; 0 = no terrain, or a luminance that is not finite.
    pub frames: f32,
    /// Mean luminance.
    pub mean: f32,
    /// Variance of luminance over frames.
    pub variance: f32,
    /// Mean absolute difference in luminance from one frame to the next.
    pub flicker: f32,
    /// Number of frames whose choice can be compared with the choice of the previous frame, at most the length of the window.
    pub chosen: f32,
    /// Share of the frames counted in `chosen` whose choice differs from the choice of the previous frame.
    pub flips: f32,
    /// Mean of [`Sample::error`].
    pub bias: f32,
    /// Mean absolute change of [`Sample::error`] from one frame to the next.
    pub residual: f32,
    last: f32,
    last_error: f32,
    last_choice: u8,
}

impl Point {
    /// Returns the moments after one more frame. `before`: the moments of the linked pixel one frame earlier; `None` = there is no such pixel.
    fn with(before: Option<&Point>, now: Sample, window: f32) -> Point {
        // Sky has a negative luminance. A number that is not finite would spoil the moments of all later frames.
        if now.luminance < 0.0 || !now.luminance.is_finite() || !now.error.is_finite() {
            return Point::default();
        }
        let Some(p) = before.filter(|p| p.frames > 0.0) else {
            return Point {
                frames: 1.0,
                mean: now.luminance,
                bias: now.error,
                last: now.luminance,
                last_error: now.error,
                last_choice: now.choice,
                ..Point::default()
            };
        };
        let frames = (p.frames + 1.0).min(window);
        let share = 1.0 / frames;
        let deviation = now.luminance - p.mean;
        // n frames have n - 1 differences from one frame to the next, so a new difference has the weight 1 / (n - 1).
        let share_of_steps = 1.0 / (frames - 1.0).max(1.0);
        let comparable = now.choice != 0 && p.last_choice != 0;
        let chosen = if comparable { (p.chosen + 1.0).min(window) } else { p.chosen };
        let flipped = f32::from(u8::from(now.choice != p.last_choice));
        Point {
            frames,
            mean: p.mean + share * deviation,
            variance: (1.0 - share) * (p.variance + share * deviation * deviation),
            flicker: p.flicker + share_of_steps * ((now.luminance - p.last).abs() - p.flicker),
            chosen,
            flips: if comparable { p.flips + (flipped - p.flips) / chosen } else { p.flips },
            bias: p.bias + share * (now.error - p.bias),
            residual: p.residual + share_of_steps * ((now.error - p.last_error).abs() - p.residual),
            last: now.luminance,
            last_error: now.error,
            last_choice: now.choice,
        }
    }
}

/// Statistics of the surface points in a region of the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Summary {
    /// Number of pixels with terrain and a finite luminance.
    pub terrain: usize,
    /// Median over pixels of [`Point::frames`].
    pub frames: f32,
    /// Mean over pixels of the variance of luminance over frames.
    pub variance: f64,
    /// Mean absolute difference in luminance from frame to frame.
    pub flicker: f64,
    /// Share of choices that differ from the choice one frame earlier; `None` without choices.
    pub flip_rate: Option<f64>,
    /// Mean difference in luminance from the comparison picture; `None` without a comparison.
    pub bias: Option<f64>,
    /// Mean absolute change, from frame to frame, of the difference in luminance from the comparison picture; `None` without a comparison.
    pub residual: Option<f64>,
    /// Clumping of the noise of the last frame: the variance of its means over blocks, relative to white noise of the same variance; about 1 for
    /// white noise. `None` if there is no noise, or no block whose pixels are all terrain.
    pub clumping: Option<f64>,
}

/// The statistics of the surface points of a picture, one per pixel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Followed {
    size: [usize; 2],
    points: Vec<Point>,
    /// Luminance minus the expected luminance, which is the luminance of the comparison picture or, without a comparison, the running mean. NaN for
    /// pixels without terrain.
    noise: Vec<f32>,
    compared: bool,
}

impl Followed {
    /// Adds a picture. `links` lead to the picture that was added by the previous call. A picture of a different size starts all statistics again.
    /// `window`: the length of the window in frames; values below 2 count as 2. `compared`: whether the errors of the samples are differences from a
    /// comparison picture. If so, they are used as the noise.
    ///
    /// # Panics
    /// When the number of samples or links is not the number of pixels.
    pub fn take(&mut self, size: [u32; 2], samples: &[Sample], links: &[u32], window: u32, compared: bool) {
        let size = size.map(|n| n as usize);
        assert!(samples.len() == size[0] * size[1] && links.len() == samples.len(), "there must be one sample and one link per pixel");
        let before = if self.size == size { std::mem::take(&mut self.points) } else { Vec::new() };
        let window = window.max(2) as f32;
        let at = |link: u32| if link == NO_LINK { None } else { before.get(link as usize) };
        self.points = samples.par_iter().zip(links).map(|(&now, &link)| Point::with(at(link), now, window)).collect();
        let points = &self.points;
        let noise = |(s, p): (&Sample, &Point)| match (s.luminance >= 0.0, compared) {
            (false, _) => f32::NAN,
            (true, true) => s.error,
            (true, false) => s.luminance - p.mean,
        };
        self.noise = samples.par_iter().zip(points).map(noise).collect();
        (self.size, self.compared) = (size, compared);
    }

    /// Discards all pictures and their statistics.
    pub fn reset(&mut self) {
        *self = Followed::default();
    }

    /// The points, row by row from the top; empty before the first picture.
    pub fn points(&self) -> &[Point] {
        &self.points
    }

    /// Returns statistics of the pixels from `low` up to, but not including, `high`; `None` if these pixels have no terrain.
    pub fn summary(&self, low: [usize; 2], high: [usize; 2]) -> Option<Summary> {
        let high = [high[0].min(self.size[0]), high[1].min(self.size[1])];
        let row = |y: usize| y * self.size[0] + low[0]..y * self.size[0] + high[0].max(low[0]);
        let points: Vec<&Point> = (low[1]..high[1]).flat_map(|y| &self.points[row(y)]).filter(|p| p.frames > 0.0).collect();
        let terrain = points.len();
        if terrain == 0 {
            return None;
        }
        let mean = |f: fn(&Point) -> f32| points.iter().map(|&p| f64::from(f(p))).sum::<f64>() / terrain as f64;
        let chosen: f64 = points.iter().map(|p| f64::from(p.chosen)).sum();
        let flipped: f64 = points.iter().map(|p| f64::from(p.chosen * p.flips)).sum();
        let mut frames: Vec<f32> = points.iter().map(|p| p.frames).collect();
        let middle = terrain / 2;
        frames.select_nth_unstable_by(middle, f32::total_cmp);
        Some(Summary {
            terrain,
            frames: frames[middle],
            variance: mean(|p| p.variance),
            flicker: mean(|p| p.flicker),
            flip_rate: (chosen > 0.0).then(|| flipped / chosen),
            bias: self.compared.then(|| mean(|p| p.bias)),
            residual: self.compared.then(|| mean(|p| p.residual)),
            clumping: self.clumping(low, high),
        })
    }

    /// Computes clumping by the formula of METHODOLOGY.md, from the noise of the last picture, over the blocks whose pixels are all terrain.
    fn clumping(&self, low: [usize; 2], high: [usize; 2]) -> Option<f64> {
        let (mut blocks, mut pixels) = (0.0, 0.0);
        for y in (low[1]..high[1].saturating_sub(BLOCK - 1)).step_by(BLOCK) {
            for x in (low[0]..high[0].saturating_sub(BLOCK - 1)).step_by(BLOCK) {
                let block = (y..y + BLOCK).flat_map(|y| &self.noise[y * self.size[0] + x..][..BLOCK]);
                let (sum, squares) = block.fold((0.0, 0.0), |(s, q), &e| (s + f64::from(e), q + f64::from(e) * f64::from(e)));
                if squares.is_finite() {
                    let count = (BLOCK * BLOCK) as f64;
                    blocks += (sum / count) * (sum / count);
                    pixels += squares / count;
                }
            }
        }
        (pixels > 0.0).then(|| (BLOCK * BLOCK) as f64 * blocks / pixels)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [20, 15];
    const PIXELS: usize = 300;

    fn still() -> Vec<u32> {
        (0..300).collect()
    }

    fn picture(f: impl Fn(usize) -> Sample) -> Vec<Sample> {
        (0..PIXELS).map(f).collect()
    }

    fn grey(luminance: f32) -> Sample {
        Sample { luminance, ..Sample::default() }
    }

    #[test]
    fn a_value_that_alternates_has_the_variance_flicker_and_flips_of_its_closed_form() {
        let mut followed = Followed::default();
        for frame in 0..64_u8 {
            let luminance = if frame % 2 == 0 { 0.25 } else { 0.75 };
            // The error alternates with half the amplitude of the luminance.
            let samples = picture(|_| Sample { luminance, choice: 1 + frame % 2, error: 0.5 * luminance - 0.15 });
            followed.take(SIZE, &samples, &still(), 64, true);
        }
        let all = followed.summary([0, 0], [20, 15]).expect("terrain");
        assert_eq!((all.terrain, all.frames), (PIXELS, 64.0));
        assert!((all.variance - 0.0625).abs() < 1e-6, "{}", all.variance);
        assert!((all.flicker - 0.5).abs() < 1e-6 && all.flip_rate == Some(1.0), "{all:?}");
        assert!((all.bias.expect("compared") - 0.1).abs() < 1e-6, "{:?}", all.bias);
        assert!((all.residual.expect("compared") - 0.25).abs() < 1e-6, "{:?}", all.residual);
        // All pixels have the same error. Clumping then has its largest possible value, the number of pixels in a block: 25.
        assert!((all.clumping.expect("noise") - 25.0).abs() < 1e-3, "{:?}", all.clumping);
    }

    #[test]
    fn numbers_move_with_the_point_and_begin_anew_where_it_was_hidden() {
        let mut followed = Followed::default();
        followed.take(SIZE, &picture(|i| grey(i as f32 + 1.0)), &vec![NO_LINK; PIXELS], 8, false);
        // Everything moves one pixel to the right; the first column is new, the last row is sky.
        let samples = picture(|i| if i >= 280 { grey(-1.0) } else { grey(i as f32) });
        let links: Vec<u32> = (0..300).map(|i| if i % 20 == 0 { NO_LINK } else { i - 1 }).collect();
        followed.take(SIZE, &samples, &links, 8, false);
        for (i, point) in followed.points().iter().enumerate() {
            let expected = if i >= 280 {
                0.0
            } else if i % 20 == 0 {
                1.0
            } else {
                2.0
            };
            assert_eq!((point.frames, point.flicker, point.variance), (expected, 0.0, 0.0), "pixel {i}");
        }
        let region = followed.summary([0, 0], [2, 14]).expect("terrain");
        assert_eq!((region.terrain, region.clumping), (28, None));
        assert_eq!(followed.summary([0, 14], [20, 15]), None, "sky");
        // A picture of a different size also starts the statistics again.
        followed.take([10, 30], &samples, &links, 8, false);
        assert!(followed.points().iter().all(|p| p.frames <= 1.0));
    }

    #[test]
    fn a_number_that_is_not_finite_starts_the_statistics_again() {
        for spoilt in [
            Sample { luminance: f32::NAN, ..grey(0.5) },
            Sample { error: f32::NAN, ..grey(0.5) },
            Sample { error: f32::INFINITY, ..grey(0.5) },
        ] {
            let mut followed = Followed::default();
            for frame in 0..5 {
                let samples = picture(|i| if frame == 2 && i < 100 { spoilt } else { grey(0.5) });
                followed.take(SIZE, &samples, &still(), 64, true);
            }
            for (i, point) in followed.points().iter().enumerate() {
                let frames = if i < 100 { 2.0 } else { 5.0 };
                assert_eq!((point.frames, point.bias, point.residual), (frames, 0.0, 0.0), "{spoilt:?}, pixel {i}");
            }
        }
    }

    #[test]
    fn white_noise_has_a_clumping_of_one_and_its_flicker() {
        let uniform = |i: usize, frame: u32| {
            let h = crate::shared::hash::pcg4d([u32::try_from(i).unwrap_or(0), frame, 5, 9])[0];
            (f64::from(h) / 4_294_967_296.0) as f32
        };
        let size = [200, 200];
        let links: Vec<u32> = (0..40_000).collect();
        let mut followed = Followed::default();
        for frame in 0..32 {
            let samples: Vec<Sample> = (0..40_000).map(|i| grey(uniform(i, frame))).collect();
            followed.take(size, &samples, &links, 1000, false);
        }
        let all = followed.summary([0, 0], [200, 200]).expect("terrain");
        // Luminance is uniform in 0..1, so its variance is 1/12. The measured variance is smaller by the factor 31/32, because deviations are taken
        // from the mean of the 32 frames. The mean absolute difference of two uniform numbers is 1/3.
        // Each tolerance is six standard errors: 6 times the standard deviation of one term, divided by the root of the number of terms. The variance
        // has 40 000 x 32 terms, squared deviations with the standard deviation 0.0745. The flicker has 40 000 x 31 terms, absolute differences with
        // the standard deviation 0.236. The factors 1.2 and 1.5 are margins, because the terms of a pixel are not independent: its deviations share a
        // mean, and successive differences share a frame.
        assert!((all.variance - 31.0 / 32.0 / 12.0).abs() < 6.0 * 0.0745 / 40_000_f64.sqrt() / 32_f64.sqrt() * 1.2, "{}", all.variance);
        assert!((all.flicker - 1.0 / 3.0).abs() < 6.0 * 0.236 / 40_000_f64.sqrt() / 31_f64.sqrt() * 1.5, "{}", all.flicker);
        // The mean error of a block is close to normally distributed. Its square, divided by the expected square, therefore has the standard
        // deviation sqrt(2). The tolerance is six standard errors of the mean over 1 600 blocks: 6 * sqrt(2) / sqrt(1 600).
        assert!((all.clumping.expect("noise") - 1.0).abs() < 6.0 * 2_f64.sqrt() / 40.0, "{:?}", all.clumping);
        assert_eq!(all.flip_rate, None, "no choices");
    }
}

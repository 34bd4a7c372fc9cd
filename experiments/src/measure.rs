//! The metrics of one view: defined in METHODOLOGY.md, computed in f64 from linear albedo.

use anyhow::{Context, Result};
use kernels::picture::Picture;

/// The picture that others are compared with, and where it shows terrain.
pub(crate) struct Reference {
    /// The picture itself.
    pub(crate) picture: Picture,
    terrain: Vec<bool>,
}

impl Reference {
    /// Takes a picture that has its albedo layer.
    pub(crate) fn of(picture: &Picture) -> Result<Reference> {
        picture.vectors("albedo").context("a reference needs the albedo layer")?;
        Ok(Reference { terrain: picture.hdr.iter().map(|t| t[3] > 0.0).collect(), picture: picture.clone() })
    }

    /// Which pixels show terrain.
    pub(crate) fn terrain(&self) -> &[bool] {
        &self.terrain
    }

    /// Linear albedo.
    pub(crate) fn albedo(&self) -> &[[f32; 3]] {
        self.picture.vectors("albedo").unwrap_or_default()
    }

    /// Mean over terrain pixels and channels.
    pub(crate) fn terrain_mean(&self, texels: &[[f32; 3]]) -> f64 {
        mean(texels.iter().zip(&self.terrain).filter(|(_, t)| **t).flat_map(|(texel, _)| texel.map(f64::from)))
    }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0u64), |(sum, count), v| (sum + v, count + 1));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// Root of the mean squared difference over the pixels marked and their channels.
pub(crate) fn rmse(a: &[[f32; 3]], b: &[[f32; 3]], marked: &[bool]) -> f64 {
    let squares = a.iter().zip(b).zip(marked).filter(|(_, m)| **m).flat_map(|((a, b), _)| {
        (0..3).map(move |k| {
            let d = f64::from(a[k]) - f64::from(b[k]);
            d * d
        })
    });
    mean(squares).sqrt()
}

/// The middle value; NaN of nothing. Sorts in place.
pub(crate) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    match values.len() {
        0 => f64::NAN,
        n if n % 2 == 1 => values[n / 2],
        n => f64::midpoint(values[n / 2 - 1], values[n / 2]),
    }
}

/// A number and how far chance can move it.
pub(crate) struct Measured {
    /// The number.
    pub(crate) value: f64,
    /// Its standard error.
    pub(crate) standard_error: f64,
}

/// Mean and variance over seeds, per pixel and channel, by Welford's recurrence, which holds where sums of squares cancel.
pub(crate) struct SeedStatistics<'a> {
    marked: &'a [bool],
    count: u32,
    moments: Vec<[(f64, f64); 3]>,
}

impl<'a> SeedStatistics<'a> {
    /// Of the pixels marked.
    pub(crate) fn new(marked: &'a [bool]) -> SeedStatistics<'a> {
        SeedStatistics { marked, count: 0, moments: vec![[(0.0, 0.0); 3]; marked.len()] }
    }

    /// Adds the picture of another seed.
    pub(crate) fn add(&mut self, texels: &[[f32; 3]]) {
        self.count += 1;
        let count = f64::from(self.count);
        for (moments, texel) in self.moments.iter_mut().zip(texels) {
            for (moment, &value) in moments.iter_mut().zip(texel) {
                let value = f64::from(value);
                let before = value - moment.0;
                moment.0 += before / count;
                moment.1 += before * (value - moment.0);
            }
        }
    }

    fn marked_moments(&self) -> impl Iterator<Item = (f64, f64)> + '_ {
        self.moments.iter().zip(self.marked).filter(|(_, m)| **m).flat_map(|(moments, _)| *moments)
    }

    /// Unbiased variance over seeds, averaged over pixels and channels.
    pub(crate) fn variance(&self) -> f64 {
        let degrees = f64::from(self.count.saturating_sub(1));
        if degrees > 0.0 { mean(self.marked_moments().map(|(_, squares)| squares / degrees)) } else { 0.0 }
    }

    /// Mean signed difference between the mean over seeds and the exact blend. Its standard error follows from the variance over seeds,
    /// taking pixels as independent in blocks of 8 x 8 (hashed noise repeats within a cell): a factor of 8 on that of independent pixels.
    pub(crate) fn bias(&self, exact: &[[f32; 3]]) -> Measured {
        let differences = self
            .moments
            .iter()
            .zip(exact)
            .zip(self.marked)
            .filter(|(_, m)| **m)
            .flat_map(|((moments, exact), _)| (0..3).map(move |k| moments[k].0 - f64::from(exact[k])));
        let pixels = self.marked.iter().filter(|m| **m).count() as f64;
        let spread = (self.variance() / f64::from(self.count.max(1)) / pixels.max(1.0)).sqrt();
        Measured { value: mean(differences), standard_error: 8.0 * spread }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_of_a_known_sequence() {
        let marked = [true, false];
        let mut statistics = SeedStatistics::new(&marked);
        // Far from zero, where a difference of sums of squares has no digits left.
        for value in [4096.0, 4097.0, 4098.0] {
            statistics.add(&[[value; 3], [0.0; 3]]);
        }
        assert!((statistics.variance() - 1.0).abs() < 1e-12);
        assert!((statistics.bias(&[[4096.5; 3], [7.0; 3]]).value - 0.5).abs() < 1e-12);
        // Negative control: a pixel that is not marked changes nothing, one that is does.
        assert!((statistics.bias(&[[4097.0; 3], [7.0; 3]]).value - 0.5).abs() > 0.4);
    }

    #[test]
    fn median_and_rmse() {
        assert_eq!(median(&mut [3.0, 1.0, 2.0]), 2.0);
        assert_eq!(median(&mut [4.0, 1.0, 2.0, 3.0]), 2.5);
        let error = rmse(&[[1.0; 3], [9.0; 3]], &[[0.0; 3], [0.0; 3]], &[true, false]);
        assert!((error - 1.0).abs() < 1e-12);
    }
}

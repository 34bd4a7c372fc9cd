//! The resolve of one frame in f64: the reference for `temporal.wgsl`.

use super::{Resolve, SHARE, TemporalFrame};
use crate::motion::NO_LINK;
use crate::shared::signal;

/// The shaded pictures of a frame and of the previous frame, the links between them, the earlier positions of the surface points, and the history.
pub struct Frame<'a> {
    /// The shaded picture of this frame.
    pub now: &'a [[u32; 2]],
    /// The shaded picture of the previous frame.
    pub before: &'a [[u32; 2]],
    /// For each pixel, the index of the linked pixel one frame before; [`NO_LINK`] = none.
    pub links: &'a [u32],
    /// For each pixel, the position of its surface point one frame before, pixels.
    pub positions: &'a [[f32; 2]],
    /// The previous history: colour, and 1 if the pixel has a history, else 0.
    pub history: &'a [[f64; 4]],
}

fn colour(signal: [u32; 2]) -> [f64; 3] {
    signal::colour(signal).map(f64::from)
}

fn mix(a: [f64; 3], b: [f64; 3], share: f64) -> [f64; 3] {
    std::array::from_fn(|k| a[k] + (b[k] - a[k]) * share)
}

/// Returns the new history of a frame, as `temporal_main` computes it. For terrain pixels, its colours are those of the resolved picture.
pub fn resolve(resolve: Resolve, size: [u32; 2], index: u32, frame: &Frame<'_>) -> Vec<[f64; 4]> {
    let setup = TemporalFrame::new(resolve, size, index, &crate::motion::Slots::default());
    let [width, height] = size.map(|n| n as usize);
    let pair = |picture: &[[u32; 2]], x: usize, y: usize, step: [u32; 2]| {
        let own = colour(picture[y * width + x]);
        let (x, y) = (x + step[0] as usize, y + step[1] as usize);
        if x >= width || y >= height || !signal::is_terrain(picture[y * width + x]) {
            return own;
        }
        mix(own, colour(picture[y * width + x]), 0.5)
    };
    let past_at = |position: [f32; 2]| {
        let mut sum = [0.0; 4];
        let [px, py] = position.map(f64::from);
        for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
            let (x, y) = (px.floor() + dx, py.floor() + dy);
            if x < 0.0 || y < 0.0 || x >= width as f64 || y >= height as f64 {
                continue;
            }
            let weight = (1.0 - (px - x).abs()) * (1.0 - (py - y).abs());
            let texel = frame.history[y as usize * width + x as usize];
            for k in 0..3 {
                sum[k] += weight * texel[k] * texel[3];
            }
            sum[3] += weight * texel[3];
        }
        (sum[3] > 1e-3).then(|| [sum[0] / sum[3], sum[1] / sum[3], sum[2] / sum[3]])
    };
    let mut out = vec![[0.0; 4]; frame.now.len()];
    for y in 0..height {
        for x in 0..width {
            let at = y * width + x;
            if !signal::is_terrain(frame.now[at]) {
                continue;
            }
            let link = frame.links[at];
            let linked = index > 0 && link != NO_LINK;
            let mut value = colour(frame.now[at]);
            if resolve.has_flipquad() {
                value = pair(frame.now, x, y, setup.neighbour);
                if linked && signal::is_terrain(frame.before[link as usize]) {
                    let link = link as usize;
                    value = mix(value, pair(frame.before, link % width, link / width, setup.past_neighbour), 0.5);
                }
            }
            let past = if resolve.has_history() && linked { past_at(frame.positions[at]) } else { None };
            if let Some(past) = past {
                let (mut low, mut high) = (value, value);
                for ny in y.saturating_sub(1)..=(y + 1).min(height - 1) {
                    for nx in x.saturating_sub(1)..=(x + 1).min(width - 1) {
                        let neighbour = frame.now[ny * width + nx];
                        if signal::is_terrain(neighbour) {
                            let c = colour(neighbour);
                            low = std::array::from_fn(|k| low[k].min(c[k]));
                            high = std::array::from_fn(|k| high[k].max(c[k]));
                        }
                    }
                }
                let clamped = std::array::from_fn(|k| past[k].clamp(low[k], high[k]));
                value = mix(clamped, value, f64::from(SHARE));
            }
            out[at] = [value[0], value[1], value[2], 1.0];
        }
    }
    out
}

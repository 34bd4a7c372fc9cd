//! Twelve ground materials made from noise, cells and stamped shapes, without image files.
//!
//! A recipe makes height, albedo, smoothness and colour mask on a torus, so every map tiles. The other two maps are computed from the height:
//! the normal from the gradient of the height, and the specular occlusion from the depth of hollows. Sources: gradient noise, Perlin,
//! *Improving Noise*, SIGGRAPH 2002; cell noise, Worley, *A Cellular Texture Basis Function*, SIGGRAPH 1996 (F2 - F1, the difference of the
//! distances to the two nearest points, is 0 on cell borders); hash, Jarzynski and Olano, *Hash Functions for GPU Rendering*, JCGT 9(3), 2020.
//!
//! The unit of length is one repeat of the texture (u, v in 0..1), so a recipe looks about the same at every resolution. Octaves of noise that
//! are too fine for the resolution are left out.

use std::f32::consts::{PI, TAU};

use rayon::prelude::*;

use super::{MaterialMaps, wrong};
use crate::base::colour::luminance;
use crate::base::error::Result;
use crate::shared::hash::pcg4d;

/// Names of the built-in materials.
pub const NAMES: [&str; 12] =
    ["granite", "limestone", "scree", "gravel", "grass", "meadow", "dirt", "mud", "sand", "snow", "moss", "forest-floor"];

/// How to make one material.
struct Recipe {
    name: &'static str,
    /// Difference in height between the lowest and the highest texel, in repeats.
    relief: f32,
    /// Mean luminance of the albedo (Rec. 709 weights), before the albedo is limited to 0.004..0.95. It is near published values for this kind of
    /// ground.
    luminance: f32,
    sketch: fn(&Bench) -> Sketch,
}

const RECIPES: [Recipe; 12] = [
    Recipe { name: "granite", relief: 0.10, luminance: 0.25, sketch: granite },
    Recipe { name: "limestone", relief: 0.09, luminance: 0.42, sketch: limestone },
    Recipe { name: "scree", relief: 0.10, luminance: 0.24, sketch: scree },
    Recipe { name: "gravel", relief: 0.045, luminance: 0.22, sketch: gravel },
    Recipe { name: "grass", relief: 0.05, luminance: 0.075, sketch: grass },
    Recipe { name: "meadow", relief: 0.06, luminance: 0.10, sketch: meadow },
    Recipe { name: "dirt", relief: 0.04, luminance: 0.13, sketch: dirt },
    Recipe { name: "mud", relief: 0.035, luminance: 0.065, sketch: mud },
    Recipe { name: "sand", relief: 0.025, luminance: 0.36, sketch: sand },
    Recipe { name: "snow", relief: 0.04, luminance: 0.80, sketch: snow },
    Recipe { name: "moss", relief: 0.05, luminance: 0.085, sketch: moss },
    Recipe { name: "forest-floor", relief: 0.045, luminance: 0.07, sketch: forest_floor },
];

fn recipe(kind: &str, material: &str) -> Result<&'static Recipe> {
    RECIPES.iter().find(|r| r.name == kind).ok_or_else(|| {
        let hint = crate::base::names::nearest(kind, &NAMES).map_or_else(String::new, |near| format!("did you mean `{near}`? "));
        wrong(material, format!("there is no procedural material `{kind}`: {hint}the procedural materials are {}", NAMES.join(", ")))
    })
}

/// Checks that `kind` is one of [`NAMES`]. `material` is the name of the material, for the error message.
pub(super) fn known(kind: &str, material: &str) -> Result<()> {
    recipe(kind, material).map(|_| ())
}

/// Difference in height between the lowest and the highest texel of a material, as a share of the size of one repeat. The normals of the
/// material belong to the height field `relief * height` on a repeat of size 1.
///
/// # Errors
/// If `name` is not one of [`NAMES`]; the message suggests the nearest name.
pub fn relief(name: &str) -> Result<f32> {
    Ok(recipe(name, name)?.relief)
}

/// Makes a material: `size` x `size` texels (at least 8) that tile in both directions. On one machine, equal `name`, `size` and `seed` give equal
/// results.
///
/// The normal is (-A dh/du, -A dh/dv, 1), normalised, where h is the height map and A = [`relief`]`(name)`. The derivatives are central
/// differences that wrap around. The features have natural sizes if one repeat is 2 to 4 m wide.
///
/// # Errors
/// If `name` is not one of [`NAMES`]; the message suggests the nearest name.
pub fn make(name: &str, size: u32, seed: u32) -> Result<MaterialMaps> {
    let recipe = recipe(name, name)?;
    let bench = Bench { n: size as usize, seed };
    let sketch = (recipe.sketch)(&bench);
    let n = bench.n;
    let height = sketch.height.stretched();
    let scale = recipe.relief * n as f32 * 0.5;
    let next = |k: usize| if k + 1 == n { 0 } else { k + 1 };
    let previous = |k: usize| if k == 0 { n - 1 } else { k - 1 };
    let mut normal = vec![[0.0; 2]; n * n];
    normal.par_chunks_mut(n).enumerate().for_each(|(y, row)| {
        let line = |y: usize| &height.v[y * n..][..n];
        let (below, here, above) = (line(previous(y)), line(y), line(next(y)));
        for (x, out) in row.iter_mut().enumerate() {
            let gx = scale * (here[next(x)] - here[previous(x)]);
            let gy = scale * (above[x] - below[x]);
            let inverse = 1.0 / (gx * gx + gy * gy + 1.0).sqrt();
            *out = [-gx * inverse, -gy * inverse];
        }
    });
    // A texel below its surroundings receives less light from the sky. So its occlusion is computed from its depths below two mean heights, one
    // within a small and one within a large radius. Each depth is divided by its radius.
    let near = height.blur(0.008);
    let wide = height.blur(0.03);
    let specular_occlusion = bench.par(|i| {
        let depth = recipe.relief * ((near.v[i] - height.v[i]).max(0.0) / 0.008 + (wide.v[i] - height.v[i]).max(0.0) / 0.03);
        1.0 / (1.0 + 0.7 * depth)
    });
    let mean = sketch.albedo.iter().map(|&c| f64::from(luminance(c))).sum::<f64>() / (n * n) as f64;
    let gain = recipe.luminance / mean as f32;
    Ok(MaterialMaps {
        size,
        albedo: sketch.albedo.into_par_iter().map(|c| c.map(|x| (x * gain).clamp(0.004, 0.95))).collect(),
        normal,
        smoothness: sketch.smoothness.v.into_iter().map(|s| s.clamp(0.0, 1.0)).collect(),
        specular_occlusion,
        height: height.v,
        colour_mask: sketch.mask.v.into_iter().map(|m| m.clamp(0.0, 1.0)).collect(),
    })
}

/// The result of a recipe. The height may have any unit, because it is later scaled to 0..1.
struct Sketch {
    albedo: Vec<[f32; 3]>,
    height: Field,
    smoothness: Field,
    mask: Field,
}

// ---------------------------------------------------------------------------------------------------------------------------------
// Tools: images on the torus

fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + (b - a) * t
}

fn mix3(a: [f32; 3], b: [f32; 3], t: f32) -> [f32; 3] {
    std::array::from_fn(|c| mix(a[c], b[c], t))
}

fn times(c: [f32; 3], s: f32) -> [f32; 3] {
    c.map(|x| x * s)
}

/// 0 below `low`, 1 above `high`, smooth in between.
fn ramp(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn unit(word: u32) -> f32 {
    (word >> 8) as f32 / 16_777_216.0
}

/// Random numbers of one element, such as a stone or a blade of grass.
struct Dice {
    /// Index of the element, salt of its layer, seed, and a counter.
    key: [u32; 4],
    words: [u32; 4],
    used: usize,
}

impl Dice {
    /// Uniform in 0..1.
    fn unit(&mut self) -> f32 {
        if self.used == 4 {
            self.words = pcg4d(self.key);
            self.key[3] = self.key[3].wrapping_add(1);
            self.used = 0;
        }
        self.used += 1;
        unit(self.words[self.used - 1])
    }

    fn between(&mut self, low: f32, high: f32) -> f32 {
        mix(low, high, self.unit())
    }
}

/// A scalar image on the torus.
struct Field {
    n: usize,
    v: Vec<f32>,
}

impl Field {
    /// Maps the values linearly to 0..1, so that the smallest becomes 0 and the largest becomes 1. Equal values become 0.
    fn stretched(self) -> Field {
        let (low, high) = self.v.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), &x| (l.min(x), h.max(x)));
        let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
        Field { n: self.n, v: self.v.into_iter().map(|x| ((x - low) * scale).clamp(0.0, 1.0)).collect() }
    }

    /// Returns the image with displaced coordinates: its value at (u, v) is the value of this image at (u, v) + `amount` * `by`.
    fn warped(&self, by: [&Field; 2], amount: f32) -> Field {
        let n = self.n;
        let axis = |texel: usize, offset: f32| {
            let at = texel as f32 + amount * offset * n as f32;
            let low = at.floor();
            let first = (low as i64).rem_euclid(n as i64) as usize;
            (first, if first + 1 == n { 0 } else { first + 1 }, at - low)
        };
        let mut v = vec![0.0; n * n];
        v.par_chunks_mut(n).enumerate().for_each(|(y, row)| {
            for (x, out) in row.iter_mut().enumerate() {
                let i = y * n + x;
                let (x0, x1, tx) = axis(x, by[0].v[i]);
                let (y0, y1, ty) = axis(y, by[1].v[i]);
                *out = mix(mix(self.v[y0 * n + x0], self.v[y0 * n + x1], tx), mix(self.v[y1 * n + x0], self.v[y1 * n + x1], tx), ty);
            }
        });
        Field { n, v }
    }

    /// Applies three equal box filters, which together are nearly a Gaussian. `radius` is in repeats. Each box extends by 0.6 times `radius` to
    /// either side, rounded to whole texels and limited to the range from 1 texel to a quarter of the edge.
    fn blur(&self, radius: f32) -> Field {
        let reach = ((radius * self.n as f32 * 0.6).round() as usize).clamp(1, self.n / 4);
        let mut v = self.v.clone();
        for _ in 0..3 {
            v = box_rows(&v, self.n, reach);
            v = box_rows(&transposed(&v, self.n), self.n, reach);
            v = transposed(&v, self.n);
        }
        Field { n: self.n, v }
    }
}

/// Returns, for each texel, the mean of the 2 * `reach` + 1 texels around it in its row. The running sum starts again in each row, so that rounding
/// errors do not spread to other rows.
fn box_rows(v: &[f32], n: usize, reach: usize) -> Vec<f32> {
    let mut out = vec![0.0; n * n];
    let inverse = 1.0 / (2 * reach + 1) as f32;
    out.par_chunks_mut(n).zip(v.par_chunks(n)).for_each(|(to, from)| {
        let wrapped: Vec<f32> = [&from[n - reach..], from, &from[..=reach]].concat();
        let mut sum: f32 = wrapped[..=2 * reach].iter().sum();
        for (x, out) in to.iter_mut().enumerate() {
            *out = sum * inverse;
            sum += wrapped[x + 2 * reach + 1] - wrapped[x];
        }
    });
    out
}

fn transposed(v: &[f32], n: usize) -> Vec<f32> {
    const TILE: usize = 16;
    let mut out = vec![0.0; n * n];
    out.par_chunks_mut(n * TILE.min(n)).enumerate().for_each(|(band, rows)| {
        let height = rows.len() / n;
        for x0 in (0..n).step_by(TILE) {
            for y in 0..height {
                for x in x0..(x0 + TILE).min(n) {
                    rows[y * n + x] = v[x * n + band * TILE + y];
                }
            }
        }
    });
    out
}

/// Cell noise: for each texel, properties of the nearest feature points.
struct Cells {
    /// Random 32-bit number of the nearest point.
    id: Vec<u32>,
    /// Distance to the nearest point, in cells.
    near: Vec<f32>,
    /// Distance to the second nearest point minus the distance to the nearest, in cells: 0 on the border between two cells.
    edge: Vec<f32>,
    /// Vector from the nearest point to the texel, in cells.
    from: Vec<[f32; 2]>,
}

/// The inputs of a recipe: the edge length of the maps in texels, and the seed.
struct Bench {
    n: usize,
    seed: u32,
}

impl Bench {
    fn par<T: Send>(&self, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
        (0..self.n * self.n).into_par_iter().with_min_len(self.n).map(f).collect()
    }

    fn field(&self, f: impl Fn(usize) -> f32 + Sync + Send) -> Field {
        Field { n: self.n, v: self.par(f) }
    }

    fn uv(&self, i: usize) -> [f32; 2] {
        [((i % self.n) as f32 + 0.5) / self.n as f32, ((i / self.n) as f32 + 0.5) / self.n as f32]
    }

    fn dice(&self, salt: u32, index: u32) -> Dice {
        Dice { key: [index, salt, self.seed, 0], words: [0; 4], used: 4 }
    }

    /// Adds gradient noise with `waves` lattice cells along u and along v. The noise is about -1..1; `shape` is applied to it, and the
    /// result is multiplied by `amplitude`.
    fn add_noise(&self, sum: &mut [f32], waves: [u32; 2], salt: u32, amplitude: f32, shape: impl Fn(f32) -> f32 + Sync) {
        let [wx, wy] = waves.map(|w| w as usize);
        let lattice: Vec<[f32; 2]> = (0..wx * wy)
            .map(|i| {
                let [word, ..] = pcg4d([(i % wx) as u32, (i / wx) as u32, salt, self.seed]);
                let (sin, cos) = (unit(word) * TAU).sin_cos();
                [cos, sin]
            })
            .collect();
        let n = self.n;
        let axis = |texel: usize, w: usize| {
            let at = (texel as f32 + 0.5) * w as f32 / n as f32;
            let cell = (at as usize).min(w - 1);
            let t = at - cell as f32;
            (cell, (cell + 1) % w, t, t * t * t * (t * (t * 6.0 - 15.0) + 10.0))
        };
        let columns: Vec<_> = (0..n).map(|x| axis(x, wx)).collect();
        sum.par_chunks_mut(n).enumerate().for_each(|(y, row)| {
            let (y0, y1, ty, sy) = axis(y, wy);
            for (out, &(x0, x1, tx, sx)) in row.iter_mut().zip(&columns) {
                let dot = |g: [f32; 2], dx: f32, dy: f32| g[0] * dx + g[1] * dy;
                let low = mix(dot(lattice[y0 * wx + x0], tx, ty), dot(lattice[y0 * wx + x1], tx - 1.0, ty), sx);
                let high = mix(dot(lattice[y1 * wx + x0], tx, ty - 1.0), dot(lattice[y1 * wx + x1], tx - 1.0, ty - 1.0), sx);
                *out += amplitude * shape(1.5 * mix(low, high, sy));
            }
        });
    }

    /// Returns a sum of octaves of noise. Each octave has twice the frequency of the previous one, and its amplitude is multiplied by `gain`. `shape`
    /// is applied to each octave. Octaves with a frequency above half the number of texels along an edge are left out.
    fn octaves(&self, waves: [u32; 2], count: u32, gain: f32, salt: u32, shape: impl Fn(f32) -> f32 + Sync) -> Field {
        let mut sum = vec![0.0; self.n * self.n];
        let mut amplitude = 1.0;
        for octave in 0..count {
            let waves = waves.map(|w| w << octave);
            if waves[0].max(waves[1]) as usize * 2 > self.n {
                break;
            }
            self.add_noise(&mut sum, waves, salt.wrapping_add(octave * 101), amplitude, &shape);
            amplitude *= gain;
        }
        Field { n: self.n, v: sum }
    }

    /// Fractal noise, about -1..1: the amplitude of each octave is half that of the previous one.
    fn fbm(&self, waves: u32, count: u32, salt: u32) -> Field {
        let mut f = self.octaves([waves, waves], count, 0.5, salt, |x| x);
        f.v.iter_mut().for_each(|x| *x *= 0.7);
        f
    }

    /// Cell noise with `cells` points along u and along v, sampled at coordinates that are displaced by `amount` * `warp`, in repeats.
    fn cells(&self, cells: [u32; 2], salt: u32, warp: Option<[&Field; 2]>, amount: f32) -> Cells {
        let [cx, cy] = cells.map(|c| c as usize);
        // One cell of padding on each side, so that the search needs no wrapping.
        let stride = cx + 2;
        let points: Vec<([f32; 2], u32)> = (0..stride * (cy + 2))
            .map(|i| {
                let cell = [(i % stride + cx - 1) % cx, (i / stride + cy - 1) % cy];
                let [a, b, id, _] = pcg4d([cell[0] as u32, cell[1] as u32, salt, self.seed ^ 0x9e37_79b9]);
                ([unit(a) * 0.9 + 0.05, unit(b) * 0.9 + 0.05], id)
            })
            .collect();
        let found: Vec<(u32, f32, f32, [f32; 2])> = self.par(|i| {
            let [mut u, mut v] = self.uv(i);
            if let Some([du, dv]) = warp {
                u += amount * du.v[i];
                v += amount * dv.v[i];
            }
            let (x, y) = ((u - u.floor()) * cx as f32, (v - v.floor()) * cy as f32);
            let (ix, iy) = ((x as usize).min(cx - 1), (y as usize).min(cy - 1));
            let (fx, fy) = (x - ix as f32, y - iy as f32);
            let (mut first, mut second, mut id, mut from) = (9.0_f32, 9.0_f32, 0, [0.0; 2]);
            for row in 0..3 {
                for column in 0..3 {
                    let (point, word) = points[(iy + row) * stride + ix + column];
                    let d = [fx + 1.0 - column as f32 - point[0], fy + 1.0 - row as f32 - point[1]];
                    let square = d[0] * d[0] + d[1] * d[1];
                    if square < first {
                        (second, first, id, from) = (first, square, word, d);
                    } else {
                        second = second.min(square);
                    }
                }
            }
            let near = first.sqrt();
            (id, near, second.sqrt() - near, from)
        });
        let mut out = Cells { id: Vec::new(), near: Vec::new(), edge: Vec::new(), from: Vec::new() };
        for (id, near, edge, from) in found {
            out.id.push(id);
            out.near.push(near);
            out.edge.push(edge);
            out.from.push(from);
        }
        out
    }

    /// Elements on a jittered grid: one at a random position in each of `across` x `across` cells. Each element has a position and a separate
    /// sequence of random numbers.
    fn scatter(&self, across: u32, salt: u32) -> impl Iterator<Item = ([f32; 2], Dice)> {
        (0..across * across).map(move |i| {
            let mut dice = self.dice(salt, i);
            let jitter = [dice.unit(), dice.unit()];
            let position = [((i % across) as f32 + jitter[0]) / across as f32, ((i / across) as f32 + jitter[1]) / across as f32];
            (position, dice)
        })
    }
}

/// How a stamped shape changes a texel that it covers.
struct Touch {
    height: f32,
    /// Weight with which the shape is blended in: 1 or more inside, falling to 0 at its edge.
    coverage: f32,
    colour: [f32; 3],
    smoothness: f32,
    mask: f32,
}

/// One stamped shape, its position, and its bounding box.
struct Stamp<S> {
    origin: [f32; 2],
    /// Corners of the box relative to the origin, in repeats.
    low: [f32; 2],
    high: [f32; 2],
    shape: S,
}

/// A surface on which shapes are drawn. Where several shapes overlap, the highest is visible; at its edge, it is blended with the others.
struct Canvas {
    n: usize,
    texels: Vec<Texel>,
}

#[derive(Clone, Copy)]
struct Texel {
    height: f32,
    colour: [f32; 3],
    smoothness: f32,
    mask: f32,
}

impl Canvas {
    fn new(bench: &Bench, f: impl Fn(usize) -> Texel + Sync + Send) -> Canvas {
        Canvas { n: bench.n, texels: bench.par(f) }
    }

    /// Draws all shapes in order. `touch` receives the shape, the offset from its origin and the index of the texel. It
    /// returns how the shape changes the texel; `None` = the shape does not cover the texel.
    fn draw<S: Sync>(&mut self, stamps: &[Stamp<S>], touch: impl Fn(&S, [f32; 2], usize) -> Option<Touch> + Sync) {
        let n = self.n;
        let band_rows = n.div_ceil(16);
        // Bands are independent of each other, and in each band the shapes are drawn in the order of the list: the result is the same for
        // any number of threads.
        self.texels.par_chunks_mut(n * band_rows).enumerate().for_each(|(band, texels)| {
            let (first, end) = ((band * band_rows) as i64, (band * band_rows + texels.len() / n) as i64);
            for stamp in stamps {
                let texel = |c: usize, offset: f32| ((stamp.origin[c] + offset) * n as f32).floor() as i64;
                let (x0, x1) = (texel(0, stamp.low[0]), texel(0, stamp.high[0]));
                let (y0, y1) = (texel(1, stamp.low[1]), texel(1, stamp.high[1]));
                for y in y0..=y1 {
                    let row = y.rem_euclid(n as i64);
                    if row < first || row >= end {
                        continue;
                    }
                    let dy = (y as f32 + 0.5) / n as f32 - stamp.origin[1];
                    for x in x0..=x1 {
                        let column = x.rem_euclid(n as i64) as usize;
                        let dx = (x as f32 + 0.5) / n as f32 - stamp.origin[0];
                        let index = row as usize * n + column;
                        let Some(t) = touch(&stamp.shape, [dx, dy], index) else { continue };
                        let texel = &mut texels[(row - first) as usize * n + column];
                        if t.height > texel.height && t.coverage > 0.0 {
                            let c = t.coverage.min(1.0);
                            texel.height = mix(texel.height, t.height, c);
                            texel.colour = mix3(texel.colour, t.colour, c);
                            texel.smoothness = mix(texel.smoothness, t.smoothness, c);
                            texel.mask = mix(texel.mask, t.mask, c);
                        }
                    }
                }
            }
        });
    }

    fn sketch(self) -> Sketch {
        let n = self.n;
        let pick = |f: fn(&Texel) -> f32| Field { n, v: self.texels.iter().map(f).collect() };
        Sketch {
            height: pick(|t| t.height),
            smoothness: pick(|t| t.smoothness),
            mask: pick(|t| t.mask),
            albedo: self.texels.iter().map(|t| t.colour).collect(),
        }
    }
}

/// A stone: the upper side of a convex polyhedron. Its height is the minimum of the heights of the planes and, if the stone is rounded, of a dome.
struct Stone {
    /// Coefficients a, b, c of each plane: height = a x + b y + c.
    planes: [[f32; 3]; 9],
    /// Inverse squares of the dome's semi-axes, along and across `direction`; 0 = there is no dome.
    round: [f32; 2],
    direction: [f32; 2],
    top: f32,
    colour: [f32; 3],
    smoothness: f32,
}

impl Stone {
    fn stamp(
        position: [f32; 2],
        radius: f32,
        rounded: bool,
        sunk: f32,
        dice: &mut Dice,
        colour: [f32; 3],
        smoothness: f32,
    ) -> Stamp<Stone> {
        let (sin, cos) = dice.between(0.0, TAU).sin_cos();
        let aspect = dice.between(0.55, 0.95);
        let top = radius * dice.between(0.45, 0.8) * if rounded { 0.75 } else { 1.0 };
        let start = dice.unit() * TAU;
        let planes = std::array::from_fn(|k| {
            if k < 2 {
                // Two gently sloping faces on top, which meet in a line.
                let (s, c) = dice.between(0.0, TAU).sin_cos();
                let tilt = dice.between(0.05, 0.45);
                [c * tilt, s * tilt, top - sunk]
            } else {
                let angle = start + (k as f32 - 2.0 + dice.between(-0.3, 0.3)) * TAU / 7.0;
                let (s, c) = angle.sin_cos();
                // On average, faces whose normal lies across the long axis are closer to the centre.
                let along = c * cos + s * sin;
                let distance = radius * mix(aspect, 1.0, along * along) * dice.between(0.75, 1.0);
                let steep = dice.between(0.7, 2.2);
                [-c * steep, -s * steep, distance * steep - sunk]
            }
        });
        let axes = [radius, radius * aspect];
        Stamp {
            origin: position,
            low: [-radius * 1.05; 2],
            high: [radius * 1.05; 2],
            shape: Stone {
                planes,
                round: if rounded { axes.map(|a| 1.0 / (a * a)) } else { [0.0; 2] },
                direction: [cos, sin],
                top: top - sunk,
                colour,
                smoothness,
            },
        }
    }

    /// Height relative to the ground plane, negative below it, and the index of the face; 99 = the dome.
    fn height(&self, d: [f32; 2]) -> (f32, usize) {
        let mut lowest = (f32::INFINITY, 0);
        for (k, p) in self.planes.iter().enumerate() {
            let h = p[0] * d[0] + p[1] * d[1] + p[2];
            if h < lowest.0 {
                lowest = (h, k);
            }
        }
        if self.round[0] > 0.0 {
            let x = d[0] * self.direction[0] + d[1] * self.direction[1];
            let y = d[1] * self.direction[0] - d[0] * self.direction[1];
            let q = x * x * self.round[0] + y * y * self.round[1];
            let dome = if q < 1.0 { self.top * (1.0 - q * q).sqrt() } else { -1.0 };
            if dome < lowest.0 {
                lowest = (dome, 99);
            }
        }
        lowest
    }
}

/// A curved strip: grass blade, needle, twig or leaf. `length` and the half-width `width` are in repeats.
struct Strip {
    direction: [f32; 2],
    length: f32,
    width: f32,
    /// Sideways displacement of the tip, in units of `length`.
    bend: f32,
    /// Height of the root; `rise` is the height of the tip above it.
    base: f32,
    rise: f32,
    kind: StripKind,
    root: [f32; 3],
    tip: [f32; 3],
    smoothness: f32,
    mask: f32,
}

#[derive(Clone, Copy, PartialEq)]
enum StripKind {
    /// Widest at a quarter of its length, pointed, with a V-shaped cross-section.
    Blade,
    /// Widest in the middle, pointed at both ends, edges curled up.
    Leaf,
    /// Constant width, round cross-section.
    Twig,
}

impl Strip {
    /// The stamp of this strip, with the root at `root`.
    fn stamp(self, root: [f32; 2]) -> Stamp<Strip> {
        // The centre line is a parabola. It lies inside the triangle of its two ends and its middle control point, so the box of this
        // triangle contains it.
        let extent = |c: usize, sign: f32| {
            let across = [-self.direction[1], self.direction[0]][c];
            let end = self.length * (self.direction[c] + self.bend * across);
            let middle = self.length * 0.5 * self.direction[c];
            sign * (sign * end).max(sign * middle).max(0.0) + sign * self.width
        };
        Stamp { origin: root, low: [extent(0, -1.0), extent(1, -1.0)], high: [extent(0, 1.0), extent(1, 1.0)], shape: self }
    }

    fn touch(&self, d: [f32; 2], texel: f32) -> Option<Touch> {
        let x = d[0] * self.direction[0] + d[1] * self.direction[1];
        let t = x / self.length;
        if !(0.0..1.0).contains(&t) {
            return None;
        }
        let y = d[1] * self.direction[0] - d[0] * self.direction[1] - self.bend * self.length * t * t;
        let width = self.width
            * match self.kind {
                StripKind::Blade => (1.0 - t).sqrt() * (0.6 + 0.4 * (4.0 * t).min(1.0)),
                StripKind::Leaf => (PI * t).sin().max(0.0).powf(0.8),
                StripKind::Twig => 1.0,
            };
        let across = y.abs();
        let coverage = (width - across) / texel + 0.5;
        if coverage <= 0.0 {
            return None;
        }
        let s = (across / width.max(1e-6)).min(1.0);
        let (profile, shade) = match self.kind {
            StripKind::Blade => (self.width * 0.5 * s, mix(0.86, 1.06, s)),
            StripKind::Leaf => (self.width * 0.45 * s * s, if s < 0.09 { 1.3 } else { 0.92 + 0.1 * (t * 60.0 + s * 9.0).sin() }),
            StripKind::Twig => (self.width * (1.0 - s * s).sqrt(), mix(1.1, 0.75, s)),
        };
        Some(Touch {
            height: self.base + self.rise * t * (1.6 - 0.6 * t) + profile,
            coverage,
            colour: times(mix3(self.root, self.tip, t), shade),
            smoothness: self.smoothness,
            mask: self.mask,
        })
    }
}

// ---------------------------------------------------------------------------------------------------------------------------------
// Recipes

/// Two displacement fields, along u and along v, for warping other fields and cell noise.
fn warp(bench: &Bench, waves: u32, salt: u32) -> [Field; 2] {
    [bench.fbm(waves, 4, salt), bench.fbm(waves, 4, salt + 1)]
}

/// Facets: each cell is a plane, tilted in a random direction, with a random offset in -1..1. `tilt` is the slope of the plane: the change of height
/// per width of a cell.
fn facet(cells: &Cells, i: usize, tilt: f32) -> f32 {
    let id = cells.id[i];
    let (sin, cos) = (unit(id.wrapping_mul(0x9e37_79b1)) * TAU).sin_cos();
    let offset = unit(id.wrapping_mul(0x85eb_ca6b)) * 2.0 - 1.0;
    offset + tilt * (cells.from[i][0] * cos + cells.from[i][1] * sin)
}

/// Massive rock: jointed blocks with broken faces, speckled with feldspar, quartz and biotite, with stains and lichen.
fn granite(bench: &Bench) -> Sketch {
    let [wx, wy] = warp(bench, 4, 1);
    let small = bench.cells([22, 20], 12, Some([&wx, &wy]), 0.03);
    let rough = bench.octaves([24, 24], 5, 0.6, 21, |x| x);
    let stain = bench.fbm(4, 5, 22);
    let lichen = bench.fbm(9, 5, 23);
    let grain = bench.cells([150, 150], 24, None, 0.0);
    let mut canvas = Canvas::new(bench, |i| Texel { height: -0.04 + 0.02 * wx.v[i], colour: [0.8; 3], smoothness: 0.0, mask: 1.0 });
    let mut blocks = Vec::new();
    for (layer, (across, low, high)) in [(5, 0.17, 0.30), (8, 0.08, 0.16), (14, 0.035, 0.07)].into_iter().enumerate() {
        for (position, mut dice) in bench.scatter(across, 40 + layer as u32) {
            let radius = dice.between(low, high);
            let shade = [dice.between(0.85, 1.15); 3];
            let sunk = 0.42 * radius + dice.between(-0.02, 0.05);
            blocks.push(Stone::stamp(position, radius, false, sunk, &mut dice, shade, 0.0));
        }
    }
    let texel = 1.0 / bench.n as f32;
    // Straight joints look artificial, so the blocks are drawn in slightly bent coordinates.
    canvas.draw(&blocks, |block, d, i| {
        let (h, face) = block.height([d[0] + 0.02 * wx.v[i], d[1] + 0.02 * wy.v[i]]);
        (h > -0.08).then(|| Touch {
            height: h,
            coverage: ((h + 0.08) / texel).clamp(0.0, 1.0),
            colour: times(block.colour, 0.94 + 0.02 * (face % 7) as f32),
            smoothness: 0.0,
            mask: 1.0,
        })
    });
    let mut sketch = canvas.sketch();
    for (i, h) in sketch.height.v.iter_mut().enumerate() {
        *h += 0.006 * facet(&small, i, 1.5) + 0.0032 * rough.v[i];
    }
    let patch = |i: usize| ramp(0.25, 0.36, lichen.v[i] - 0.12 * stain.v[i]);
    sketch.albedo = bench.par(|i| {
        let g = unit(grain.id[i]);
        let mineral = match () {
            () if g < 0.17 => [0.11, 0.105, 0.10],
            () if g < 0.5 => [0.28, 0.235, 0.21],
            () if g < 0.8 => [0.26, 0.25, 0.24],
            () => [0.35, 0.335, 0.32],
        };
        let rock = mix3([0.25, 0.235, 0.22], mineral, 0.55);
        let rock = times(rock, sketch.albedo[i][0] * (1.0 + 0.05 * facet(&small, i, 0.0)));
        let rust = mix3(rock, [0.22, 0.15, 0.095], 0.4 * ramp(0.1, 0.6, wy.v[i] - 0.5 * stain.v[i]));
        let dark = times(rust, mix(1.0, 0.62, ramp(0.1, 0.6, stain.v[i])));
        mix3(dark, [0.29, 0.30, 0.21], 0.5 * patch(i))
    });
    sketch.smoothness = bench.field(|i| 0.34 - 0.12 * patch(i) + 0.05 * (unit(grain.id[i]) - 0.5));
    sketch.mask = bench.field(|i| 1.0 - 0.7 * patch(i));
    shade_hollows(&mut sketch, 0.012, 25.0);
    sketch
}

/// Bedded rock: broken layers along u, with pits where water has dissolved the rock, and dark streaks along v.
fn limestone(bench: &Bench) -> Sketch {
    let [wx, wy] = warp(bench, 3, 1);
    let beds = bench.cells([2, 10], 10, Some([&wx, &wy]), 0.035);
    let blocks = bench.cells([6, 26], 11, Some([&wy, &wx]), 0.03);
    let lamina = bench.octaves([3, 40], 3, 0.6, 12, |x| x).warped([&wx, &wy], 0.05);
    let rough = bench.octaves([20, 20], 5, 0.6, 13, |x| x);
    let pits = bench.cells([40, 40], 14, Some([&wx, &wy]), 0.05);
    let streak = bench.octaves([16, 2], 3, 0.6, 15, |x| x).warped([&wx, &wy], 0.06);
    let tone = bench.fbm(3, 5, 16);
    let open = bench.fbm(7, 3, 17);
    let gap = |edge: f32, i: usize| 1.0 - ramp(0.0, 0.06, edge + 0.015 * rough.v[i]);
    let crack =
        |i: usize| (ramp(-0.5, 0.15, open.v[i]) * gap(beds.edge[i], i)).max(0.6 * ramp(0.0, 0.4, open.v[i]) * gap(blocks.edge[i], i));
    let pit = |i: usize| {
        let size = 0.08 + 0.3 * unit(pits.id[i].wrapping_mul(0x9e37_79b1)).powi(2);
        if unit(pits.id[i]) < 0.3 { 1.0 - ramp(0.3 * size, size, pits.near[i]) } else { 0.0 }
    };
    // A bed stands out at its upper edge and recedes below.
    let height = bench.field(|i| {
        0.6 * tone.v[i]
            + 0.45 * (facet(&beds, i, 0.4) + 0.5 * beds.from[i][1])
            + 0.22 * (facet(&blocks, i, 0.5) + 0.6 * blocks.from[i][1])
            + 0.05 * lamina.v[i]
            + 0.05 * rough.v[i]
            - 0.25 * crack(i)
            - 0.10 * pit(i)
    });
    let albedo = bench.par(|i| {
        let bed = mix3([0.56, 0.49, 0.37], [0.34, 0.325, 0.295], unit(beds.id[i]));
        let rock = times(bed, 1.0 + 0.15 * lamina.v[i] + 0.13 * facet(&blocks, i, 0.0) + 0.10 * rough.v[i]);
        let ochre = mix3(rock, [0.42, 0.29, 0.16], 0.4 * ramp(0.05, 0.6, tone.v[i]));
        let grey = mix3(ochre, [0.15, 0.147, 0.14], 0.6 * ramp(0.15, 0.8, streak.v[i]));
        times(grey, (1.0 - 0.6 * crack(i)) * (1.0 - 0.3 * pit(i)))
    });
    let smoothness = bench.field(|i| 0.3 + 0.05 * lamina.v[i] - 0.12 * crack(i) - 0.1 * pit(i));
    let mut sketch = Sketch { albedo, height, smoothness, mask: bench.field(|_| 1.0) };
    shade_hollows(&mut sketch, 0.012, 1.6);
    sketch
}

/// Draws stones with rough faces. `rough` is the noise on the faces; `roughness` is its amplitude, as a share of the height of the stone.
fn lay_stones(bench: &Bench, canvas: &mut Canvas, stones: &[Stamp<Stone>], rough: &Field, roughness: f32) {
    let texel = 1.0 / bench.n as f32;
    canvas.draw(stones, |stone, d, i| {
        let (h, face) = stone.height(d);
        // The faces of a stone weather differently, so the brightness depends on the face.
        let shade = 0.92 + 0.03 * (face % 7) as f32;
        (h > -stone.top).then(|| Touch {
            height: h + roughness * stone.top * rough.v[i],
            coverage: ((h + 0.3 * stone.top) / texel).clamp(0.0, 1.0),
            colour: times(stone.colour, shade * (1.0 + 0.16 * rough.v[i])),
            smoothness: stone.smoothness,
            mask: 1.0,
        })
    });
}

/// Angular debris of many sizes, in a thick layer.
fn scree(bench: &Bench) -> Sketch {
    let ground = bench.fbm(6, 5, 1);
    let rough = bench.octaves([40, 40], 4, 0.65, 2, |x| x);
    let tone = bench.fbm(3, 3, 3);
    let mut canvas = Canvas::new(bench, |i| Texel {
        height: 0.01 * ground.v[i] - 0.012,
        colour: times([0.15, 0.135, 0.115], 1.0 + 0.3 * rough.v[i]),
        smoothness: 0.2,
        mask: 1.0,
    });
    let mut stones = Vec::new();
    for (layer, (across, low, high)) in [(64, 0.007, 0.014), (34, 0.014, 0.028), (15, 0.03, 0.055), (6, 0.05, 0.10)].into_iter().enumerate()
    {
        for (position, mut dice) in bench.scatter(across, 40 + layer as u32) {
            let radius = mix(low, high, dice.unit().powi(2));
            let warm = dice.unit();
            let value = dice.between(0.7, 1.25);
            let colour = times(mix3([0.235, 0.235, 0.235], [0.27, 0.235, 0.19], warm), value);
            stones.push(Stone::stamp(position, radius, false, radius * dice.between(-0.1, 0.35), &mut dice, colour, 0.3));
        }
    }
    lay_stones(bench, &mut canvas, &stones, &rough, 0.06);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.012, 26.0);
    sketch.albedo.iter_mut().zip(&tone.v).for_each(|(c, t)| *c = times(*c, 1.0 + 0.12 * t));
    sketch
}

/// Darkens hollows, where dust and moisture collect. The depth d of a texel is measured below the mean height within `radius`; its colour is
/// divided by 1 + `strength` * d.
fn shade_hollows(sketch: &mut Sketch, radius: f32, strength: f32) {
    let mean = sketch.height.blur(radius);
    for ((colour, h), m) in sketch.albedo.iter_mut().zip(&sketch.height.v).zip(&mean.v) {
        *colour = times(*colour, 1.0 / (1.0 + strength * (m - h).max(0.0)));
    }
}

/// Rounded pebbles of mixed rock, in sand.
fn gravel(bench: &Bench) -> Sketch {
    let rough = bench.octaves([48, 48], 4, 0.65, 1, |x| x);
    let ground = bench.fbm(5, 4, 2);
    let mut canvas = Canvas::new(bench, |i| Texel {
        height: 0.006 * ground.v[i] + 0.001 * rough.v[i],
        colour: times([0.22, 0.185, 0.14], 1.0 + 0.3 * rough.v[i]),
        smoothness: 0.15,
        mask: 1.0,
    });
    const ROCKS: [[f32; 3]; 6] =
        [[0.24, 0.235, 0.23], [0.15, 0.15, 0.155], [0.31, 0.27, 0.215], [0.40, 0.38, 0.35], [0.235, 0.16, 0.125], [0.20, 0.21, 0.195]];
    let mut stones = Vec::new();
    for (layer, (across, low, high)) in [(80, 0.006, 0.010), (44, 0.010, 0.018), (19, 0.018, 0.040)].into_iter().enumerate() {
        for (position, mut dice) in bench.scatter(across, 40 + layer as u32) {
            let radius = mix(low, high, dice.unit().powi(2));
            let colour = times(ROCKS[(dice.unit() * 6.0) as usize], dice.between(0.8, 1.2));
            let smoothness = dice.between(0.3, 0.5);
            stones.push(Stone::stamp(position, radius, true, radius * dice.between(0.0, 0.3), &mut dice, colour, smoothness));
        }
    }
    lay_stones(bench, &mut canvas, &stones, &rough, 0.025);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.008, 60.0);
    sketch
}

/// Draws strips on the canvas.
fn lay_strips(bench: &Bench, canvas: &mut Canvas, strips: &[Stamp<Strip>]) {
    let texel = 1.0 / bench.n as f32;
    canvas.draw(strips, |strip, d, _| strip.touch(d, texel));
}

/// `across`² blades of grass that lean in all directions. `length` is the range of their lengths where `clump` is 0, in repeats. Their half-widths
/// are 0.7 to 1.2 times `width`. The colour of a tip lies between two neighbouring entries of `colours`, times a random factor of 0.8 to 1.2. The
/// root is half as bright. Where `clump`, about -1..1, is larger, blades are longer and higher.
fn blades(bench: &Bench, across: u32, salt: u32, length: [f32; 2], width: f32, colours: &[[f32; 3]], clump: &Field) -> Vec<Stamp<Strip>> {
    bench
        .scatter(across, salt)
        .map(|(root, mut dice)| {
            let texel = [0, 1].map(|c| ((root[c] * bench.n as f32) as usize).min(bench.n - 1));
            let vigour = clump.v[texel[1] * bench.n + texel[0]];
            let (sin, cos) = dice.between(0.0, TAU).sin_cos();
            let length = dice.between(length[0], length[1]) * (1.0 + 0.35 * vigour);
            let pick = dice.unit() * (colours.len() - 1) as f32;
            let at = (pick as usize).min(colours.len() - 2);
            let tip = times(mix3(colours[at], colours[at + 1], pick - at as f32), dice.between(0.8, 1.2));
            let base = 0.012 * dice.unit() + 0.012 * vigour;
            let rise = length * dice.between(0.15, 0.5);
            let width = width * dice.between(0.7, 1.2);
            let bend = dice.between(-0.5, 0.5);
            Strip {
                direction: [cos, sin],
                length,
                width,
                bend,
                base,
                rise,
                kind: StripKind::Blade,
                root: times(tip, 0.5),
                tip,
                smoothness: 0.35,
                mask: 1.0,
            }
            .stamp(root)
        })
        .collect()
}

/// A lawn of broad blades.
fn grass(bench: &Bench) -> Sketch {
    let clump = bench.fbm(5, 4, 1);
    let soil = bench.octaves([40, 40], 4, 0.6, 2, |x| x);
    let mut canvas = Canvas::new(bench, |i| Texel {
        height: -0.006 + 0.004 * clump.v[i] + 0.002 * soil.v[i],
        colour: times([0.032, 0.038, 0.014], 1.0 + 0.4 * soil.v[i]),
        smoothness: 0.12,
        mask: 0.5,
    });
    let green = [[0.035, 0.075, 0.014], [0.05, 0.105, 0.018], [0.075, 0.125, 0.025], [0.13, 0.135, 0.045]];
    let strips = blades(bench, 90, 40, [0.03, 0.065], 0.0030, &green, &clump);
    lay_strips(bench, &mut canvas, &strips);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.01, 45.0);
    sketch
}

/// Long mixed grass, clover and flowers.
fn meadow(bench: &Bench) -> Sketch {
    let clump = bench.fbm(4, 4, 1);
    let soil = bench.octaves([40, 40], 4, 0.6, 2, |x| x);
    let mut canvas = Canvas::new(bench, |i| Texel {
        height: -0.006 + 0.006 * clump.v[i] + 0.002 * soil.v[i],
        colour: times([0.045, 0.042, 0.018], 1.0 + 0.4 * soil.v[i]),
        smoothness: 0.12,
        mask: 0.5,
    });
    let mixed = [[0.04, 0.075, 0.018], [0.06, 0.105, 0.022], [0.085, 0.125, 0.03], [0.125, 0.14, 0.04], [0.22, 0.18, 0.08]];
    let mut strips = blades(bench, 96, 40, [0.04, 0.085], 0.0032, &mixed, &clump);
    // Clover has three round leaflets.
    for (centre, mut dice) in bench.scatter(17, 50) {
        if dice.unit() < 0.45 {
            continue;
        }
        let start = dice.unit() * TAU;
        let size = dice.between(0.011, 0.018);
        let green = times([0.04, 0.095, 0.022], dice.between(0.8, 1.3));
        let base = dice.between(0.02, 0.04);
        for k in 0..3 {
            let (sin, cos) = (start + k as f32 * TAU / 3.0).sin_cos();
            strips.push(leaf(centre, [cos, sin], size, 0.5, base, 0.002, green, times(green, 1.25), 1.0));
        }
    }
    // A flower has five petals and a centre.
    for (centre, mut dice) in bench.scatter(13, 51) {
        if dice.unit() < 0.68 {
            continue;
        }
        const PETALS: [[f32; 3]; 3] = [[0.62, 0.62, 0.58], [0.60, 0.42, 0.03], [0.30, 0.17, 0.45]];
        let petal = PETALS[(dice.unit() * 2.999) as usize];
        let start = dice.unit() * TAU;
        let size = dice.between(0.008, 0.013);
        let base = dice.between(0.04, 0.06);
        for k in 0..5 {
            let (sin, cos) = (start + k as f32 * TAU / 5.0).sin_cos();
            strips.push(leaf(centre, [cos, sin], size, 0.36, base, 0.003, times(petal, 0.8), petal, 0.0));
        }
        strips.push(leaf(
            [centre[0] - 0.25 * size, centre[1]],
            [1.0, 0.0],
            0.5 * size,
            0.45,
            base + 0.004,
            0.0,
            [0.45, 0.28, 0.02],
            [0.45, 0.28, 0.02],
            0.0,
        ));
    }
    lay_strips(bench, &mut canvas, &strips);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.012, 35.0);
    sketch
}

/// A leaf or petal. `breadth` is its half-width divided by its length.
#[allow(clippy::too_many_arguments, reason = "a shape's plain numbers; a struct would name each twice")]
fn leaf(
    root: [f32; 2],
    direction: [f32; 2],
    length: f32,
    breadth: f32,
    base: f32,
    rise: f32,
    from: [f32; 3],
    to: [f32; 3],
    mask: f32,
) -> Stamp<Strip> {
    Strip {
        direction,
        length,
        width: length * breadth,
        bend: 0.0,
        base,
        rise,
        kind: StripKind::Leaf,
        root: from,
        tip: to,
        smoothness: 0.38,
        mask,
    }
    .stamp(root)
}

/// Dry soil: clods, crumbs and a few stones.
fn dirt(bench: &Bench) -> Sketch {
    let [wx, wy] = warp(bench, 8, 1);
    let swell = bench.fbm(4, 4, 3);
    let clods = bench.cells([26, 26], 4, Some([&wx, &wy]), 0.03);
    let crumbs = bench.cells([80, 80], 5, Some([&wy, &wx]), 0.012);
    let rough = bench.octaves([32, 32], 4, 0.7, 6, |x| x);
    let trodden = bench.fbm(3, 3, 7);
    let mut canvas = Canvas::new(bench, |i| {
        let loose = ramp(-0.25, 0.3, trodden.v[i]);
        let clod = (0.75 - clods.near[i]).max(0.0) * unit(clods.id[i]) * loose;
        let crumb = (0.7 - crumbs.near[i]).max(0.0) * unit(crumbs.id[i]);
        let h = 0.012 * swell.v[i] + 0.014 * clod + 0.005 * crumb * mix(0.4, 1.0, loose) + 0.0022 * rough.v[i];
        let tone = mix3([0.15, 0.105, 0.066], [0.185, 0.14, 0.098], ramp(-0.5, 0.5, swell.v[i] + 0.4 * rough.v[i]));
        Texel {
            height: h,
            colour: times(tone, (0.82 + 0.35 * crumb + 0.25 * clod) * mix(1.06, 0.92, loose) * (1.0 + 0.12 * rough.v[i])),
            smoothness: mix(0.24, 0.14, loose),
            mask: 1.0,
        }
    });
    let mut stones = Vec::new();
    for (layer, (across, low, high, share)) in [(34, 0.004, 0.009, 0.45), (11, 0.009, 0.024, 0.55)].into_iter().enumerate() {
        for (position, mut dice) in bench.scatter(across, 40 + layer as u32) {
            if dice.unit() > share {
                continue;
            }
            let radius = mix(low, high, dice.unit().powi(2));
            let colour = times(mix3([0.19, 0.18, 0.165], [0.25, 0.20, 0.14], dice.unit()), dice.between(0.8, 1.15));
            stones.push(Stone::stamp(
                position,
                radius,
                dice.unit() < 0.6,
                radius * dice.between(0.05, 0.3) - 0.004,
                &mut dice,
                colour,
                0.28,
            ));
        }
    }
    lay_stones(bench, &mut canvas, &stones, &rough, 0.05);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.01, 60.0);
    sketch
}

/// Wet, kneaded soil with water in the hollows.
fn mud(bench: &Bench) -> Sketch {
    let [wx, wy] = warp(bench, 4, 1);
    let swell = bench.fbm(3, 4, 3);
    let lumps = bench.cells([9, 9], 4, Some([&wx, &wy]), 0.09);
    let small = bench.cells([30, 30], 5, Some([&wy, &wx]), 0.03);
    let ridge = bench.octaves([6, 6], 4, 0.5, 6, |x| 1.0 - 2.0 * x.abs());
    let rough = bench.octaves([48, 48], 3, 0.6, 7, |x| x);
    let soil = bench.field(|i| {
        0.5 * swell.v[i]
            + 0.35 * (0.6 - lumps.near[i]) * (0.4 + unit(lumps.id[i]))
            + 0.10 * (0.6 - small.near[i])
            + 0.13 * ridge.v[i]
            + 0.02 * rough.v[i]
    });
    // Water level: the height below which about a sixth of the ground lies.
    let mut sorted: Vec<f32> = soil.v.iter().step_by(7).copied().collect();
    sorted.sort_by(f32::total_cmp);
    let level = sorted[sorted.len() / 6];
    let ripple = bench.octaves([12, 12], 2, 0.5, 8, |x| x);
    let depth = |i: usize| level - soil.v[i];
    let wet = |i: usize| ramp(-0.14, 0.0, depth(i));
    let height = bench.field(|i| soil.v[i].max(level) + 0.002 * ripple.v[i] * ramp(0.0, 0.1, depth(i)));
    let albedo = bench.par(|i| {
        let drier = mix3([0.07, 0.05, 0.032], [0.115, 0.085, 0.056], ramp(0.0, 0.6, soil.v[i] - level));
        let soil_colour = times(drier, 1.0 + 0.2 * rough.v[i] + 0.15 * ridge.v[i]);
        let soaked = times(soil_colour, mix(1.0, 0.6, wet(i)));
        mix3(soaked, [0.045, 0.037, 0.026], ramp(0.0, 0.12, depth(i)))
    });
    let smoothness = bench.field(|i| mix(mix(0.34, 0.68, wet(i)), 0.93, ramp(0.0, 0.03, depth(i))) + 0.04 * rough.v[i] * (1.0 - wet(i)));
    Sketch { albedo, height, smoothness, mask: bench.field(|i| 1.0 - ramp(0.0, 0.08, depth(i))) }
}

/// Wind ripples: gentle windward and steep lee sides.
fn sand(bench: &Bench) -> Sketch {
    let bend = bench.fbm(2, 3, 1);
    let fork = bench.fbm(5, 3, 2);
    let strength = bench.fbm(3, 2, 3);
    let grain = bench.octaves([128, 128], 2, 0.9, 4, |x| x);
    let swell = bench.fbm(2, 3, 5);
    let phase = |i: usize| {
        let [u, v] = bench.uv(i);
        (5.0 * u + 19.0 * v + 1.9 * bend.v[i] + 0.75 * fork.v[i]).rem_euclid(1.0)
    };
    let ripple = |i: usize| {
        let p = phase(i);
        // The ripple rises over 70 % of the wavelength and falls over the rest.
        let saw = if p < 0.7 { p / 0.7 } else { (1.0 - p) / 0.3 };
        saw * saw * (3.0 - 2.0 * saw)
    };
    let height = bench.field(|i| 0.3 * (1.0 + 0.6 * strength.v[i]) * ripple(i) + 0.5 * swell.v[i] + 0.018 * grain.v[i]);
    let albedo = bench.par(|i| {
        let dry = mix3([0.36, 0.27, 0.175], [0.45, 0.36, 0.25], ramp(0.1, 0.9, ripple(i)));
        times(dry, 1.0 + 0.075 * grain.v[i] + 0.08 * swell.v[i])
    });
    Sketch { albedo, height, smoothness: bench.field(|i| 0.22 + 0.04 * grain.v[i]), mask: bench.field(|_| 1.0) }
}

/// Wind-packed snow: soft drifts, low ripples, fine crystals.
fn snow(bench: &Bench) -> Sketch {
    let [wx, wy] = warp(bench, 3, 1);
    let drift = bench.fbm(2, 4, 3);
    let packed = bench.octaves([5, 14], 3, 0.5, 4, |x| 1.0 - 2.0 * x.abs()).warped([&wx, &wy], 0.12);
    let lumps = bench.cells([14, 14], 5, Some([&wx, &wy]), 0.08);
    let crystal = bench.octaves([96, 96], 3, 0.8, 6, |x| x);
    let height = bench.field(|i| drift.v[i] + 0.16 * packed.v[i] + 0.16 * (0.5 - lumps.near[i]).max(0.0) + 0.022 * crystal.v[i]);
    let low = height.blur(0.03);
    let albedo = bench.par(|i| {
        let hollow = ramp(0.0, 0.25, low.v[i] - height.v[i]);
        let white = mix3([0.82, 0.83, 0.84], [0.70, 0.75, 0.81], hollow);
        times(white, 1.0 + 0.025 * crystal.v[i] + 0.03 * drift.v[i])
    });
    let smoothness = bench.field(|i| 0.42 + 0.1 * packed.v[i] + 0.1 * crystal.v[i]);
    Sketch { albedo, height, smoothness, mask: bench.field(|_| 1.0) }
}

/// Cushions of moss: domes covered in short shoots, with dark gaps between them.
fn moss(bench: &Bench) -> Sketch {
    let [wx, wy] = warp(bench, 5, 1);
    let cushion = bench.cells([7, 7], 3, Some([&wx, &wy]), 0.07);
    let tuft = bench.cells([24, 24], 4, Some([&wy, &wx]), 0.035);
    let swell = bench.fbm(3, 4, 6);
    let tone = bench.fbm(4, 4, 7);
    let dome = |near: f32| (1.0 - near * near * 1.3).max(0.0);
    let body = bench
        .field(|i| 0.010 * swell.v[i] + 0.022 * dome(cushion.near[i]) * (0.6 + 0.5 * unit(cushion.id[i])) + 0.008 * dome(tuft.near[i]));
    let green = |i: usize| {
        let fresh = mix3([0.05, 0.085, 0.012], [0.125, 0.15, 0.02], ramp(-0.5, 0.6, tone.v[i] + 0.5 * (unit(cushion.id[i]) - 0.5)));
        mix3(fresh, [0.13, 0.09, 0.035], 0.55 * ramp(0.80, 0.97, unit(tuft.id[i])))
    };
    let mut canvas = Canvas::new(bench, |i| Texel { height: body.v[i], colour: times(green(i), 0.55), smoothness: 0.12, mask: 1.0 });
    let shoots: Vec<_> = bench
        .scatter(150, 40)
        .map(|(root, mut dice)| {
            let [x, y] = root.map(|c| ((c * bench.n as f32) as usize).min(bench.n - 1));
            let i = y * bench.n + x;
            let (sin, cos) = dice.between(0.0, TAU).sin_cos();
            let tip = times(green(i), dice.between(0.75, 1.35));
            Strip {
                direction: [cos, sin],
                length: dice.between(0.006, 0.013),
                width: dice.between(0.0016, 0.0026),
                bend: dice.between(-0.3, 0.3),
                base: body.v[i],
                rise: dice.between(0.001, 0.005),
                kind: StripKind::Leaf,
                root: times(tip, 0.7),
                tip,
                smoothness: 0.2,
                mask: 1.0,
            }
            .stamp(root)
        })
        .collect();
    lay_strips(bench, &mut canvas, &shoots);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.012, 70.0);
    sketch
}

/// Humus under needles, twigs and fallen leaves.
fn forest_floor(bench: &Bench) -> Sketch {
    let swell = bench.fbm(3, 5, 1);
    let humus = bench.octaves([30, 30], 5, 0.65, 2, |x| x);
    let mut canvas = Canvas::new(bench, |i| Texel {
        height: 0.011 * swell.v[i] + 0.003 * humus.v[i],
        colour: times([0.042, 0.030, 0.019], 1.0 + 0.45 * humus.v[i]),
        smoothness: 0.14,
        mask: 1.0,
    });
    let ground = |p: [f32; 2]| {
        let t = p.map(|x| ((x * bench.n as f32) as usize).min(bench.n - 1));
        0.011 * swell.v[t[1] * bench.n + t[0]]
    };
    let mut strips = Vec::new();
    for (root, mut dice) in bench.scatter(72, 40) {
        let (sin, cos) = dice.between(0.0, TAU).sin_cos();
        let colour = times(mix3([0.10, 0.062, 0.030], [0.19, 0.12, 0.06], dice.unit()), dice.between(0.6, 1.3));
        strips.push(
            Strip {
                direction: [cos, sin],
                length: dice.between(0.016, 0.036),
                width: dice.between(0.0011, 0.0018),
                bend: dice.between(-0.2, 0.2),
                base: ground(root) + dice.between(0.0, 0.007),
                rise: dice.between(-0.001, 0.003),
                kind: StripKind::Twig,
                root: colour,
                tip: times(colour, 1.15),
                smoothness: 0.28,
                mask: 1.0,
            }
            .stamp(root),
        );
    }
    for (root, mut dice) in bench.scatter(17, 41) {
        let (sin, cos) = dice.between(0.0, TAU).sin_cos();
        const FALLEN: [[f32; 3]; 5] =
            [[0.17, 0.085, 0.030], [0.12, 0.065, 0.032], [0.21, 0.13, 0.045], [0.085, 0.052, 0.032], [0.085, 0.095, 0.028]];
        let colour = times(FALLEN[(dice.unit() * 4.999) as usize], dice.between(0.8, 1.2));
        let mut stamp = leaf(
            root,
            [cos, sin],
            dice.between(0.028, 0.06),
            dice.between(0.22, 0.36),
            ground(root) + dice.between(0.002, 0.010),
            dice.between(-0.002, 0.006),
            times(colour, 0.85),
            colour,
            1.0,
        );
        stamp.shape.smoothness = 0.32;
        strips.push(stamp);
    }
    for (root, mut dice) in bench.scatter(7, 42) {
        if dice.unit() < 0.35 {
            continue;
        }
        let (sin, cos) = dice.between(0.0, TAU).sin_cos();
        let colour = times([0.075, 0.058, 0.043], dice.between(0.7, 1.5));
        strips.push(
            Strip {
                direction: [cos, sin],
                length: dice.between(0.08, 0.24),
                width: dice.between(0.0025, 0.006),
                bend: dice.between(-0.15, 0.15),
                base: ground(root) + dice.between(0.002, 0.008),
                rise: dice.between(-0.002, 0.004),
                kind: StripKind::Twig,
                root: colour,
                tip: times(colour, 1.2),
                smoothness: 0.22,
                mask: 1.0,
            }
            .stamp(root),
        );
    }
    lay_strips(bench, &mut canvas, &strips);
    let mut sketch = canvas.sketch();
    shade_hollows(&mut sketch, 0.01, 60.0);
    sketch
}

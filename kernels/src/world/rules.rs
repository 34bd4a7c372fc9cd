//! Splat rules decide which material lies where, by height, slope, curvature and noise. Brush strokes change their result.
//!
//! The weight of a rule is the product of its constant factor, its masks (see [`crate::scene::Rule`]) and the masks that were painted for its
//! material. The material of the rule with the largest weight is used. Where a material itself was painted (see [`crate::scene::Stroke`]), the
//! painted material is used instead.

use crate::scene::{Rule, Scene, Stroke, StrokeKind, World};
use crate::shared::hash;

/// Prepared rules: names are resolved to palette indices, and the share of the ground that each noise mask covers (`Rule::noise_cover`) is
/// converted to a noise threshold.
#[derive(Clone, Debug)]
pub struct Rules {
    rules: Vec<Prepared>,
    /// The strokes, in the order in which they were painted.
    strokes: Vec<Painted>,
}

/// A prepared stroke.
#[derive(Clone, Debug)]
struct Painted {
    material: u8,
    stroke: Stroke,
    /// Bounding box of the line with its width: south-west and north-east corner, world metres.
    bounds: [[f64; 2]; 2],
}

#[derive(Clone, Debug)]
struct Prepared {
    material: u8,
    rule: Rule,
    seed: u32,
    threshold: f64,
}

/// Half the width of the range of noise values over which a noise mask rises from 0 to 1.
const NOISE_RAMP: f64 = 0.08;

impl Rules {
    /// Prepares the rules of a validated scene.
    ///
    /// # Panics
    /// If a rule or a stroke names a material that the scene lacks, or there are more than 256 materials: validation refuses both.
    pub fn new(scene: &Scene) -> Rules {
        let seed = match scene.world {
            World::Procedural { seed, .. } | World::Heightmap { seed, .. } => seed,
        };
        let quantiles = noise_quantiles();
        let index_of = |name: &str| {
            let position = scene.materials.iter().position(|m| m.name == name);
            let material = position.expect("validation checks that the material of every rule and stroke exists");
            u8::try_from(material).expect("validation allows at most 256 materials")
        };
        let rules = scene.rules.iter().zip(0u32..).map(|(rule, index)| {
            let at = (1.0 - rule.noise_cover).clamp(0.0, 1.0) * (quantiles.len() - 1) as f64;
            Prepared {
                material: index_of(&rule.material),
                rule: rule.clone(),
                seed: hash::pcg4d([seed, index, 0x51a7, 1])[0],
                threshold: quantiles[at.round() as usize],
            }
        });
        let strokes = scene.strokes.iter().map(|stroke| Painted::new(index_of(&stroke.material), stroke));
        Rules { rules: rules.collect(), strokes: strokes.collect() }
    }

    /// The strokes of one kind that may reach a position, the last one first.
    fn painted(&self, kind: StrokeKind, x: f64, y: f64) -> impl Iterator<Item = &Painted> {
        self.strokes.iter().rev().filter(move |p| p.stroke.kind == kind && p.may_reach(x, y))
    }

    /// Returns the factor by which painted masks multiply the weights of a material's rules at a position.
    fn mask_of(&self, material: u8, x: f64, y: f64) -> f64 {
        self.painted(StrokeKind::Mask, x, y).filter(|p| p.material == material).map(|p| p.factor(x, y)).product()
    }

    /// Returns the palette index of the material at a position. Arguments: height in metres, slope in degrees, mean curvature in 1/m (positive where
    /// convex), world position in metres. If materials were painted at the position, the one that was painted last replaces the result of the rules.
    /// If the weight of every rule is 0, the material of the first rule is used.
    pub fn material_at(&self, height_m: f64, slope_deg: f64, curvature: f64, x: f64, y: f64) -> u8 {
        if let Some(painted) = self.painted(StrokeKind::Splat, x, y).find(|p| p.depth_m(x, y) > 0.0) {
            return painted.material;
        }
        let mut best = (0.0, self.rules.first().map_or(0, |r| r.material));
        for prepared in &self.rules {
            let mut weight = prepared.geometric_weight(height_m, slope_deg, curvature);
            if weight > 0.0 {
                weight *= self.mask_of(prepared.material, x, y);
            }
            // The noise mask is expensive, and it can only lower a weight, so it is skipped for rules that cannot win.
            if weight > 0.0 && weight >= best.0 {
                weight *= prepared.noise_mask(x, y);
                if weight > 0.0 && weight >= best.0 {
                    best = (weight, prepared.material);
                }
            }
        }
        best.1
    }

    /// Weights of all rules at a position, in the order of the scene. They include painted masks, but not painted materials.
    pub fn weights_at(&self, height_m: f64, slope_deg: f64, curvature: f64, x: f64, y: f64) -> Vec<f64> {
        let weight =
            |p: &Prepared| p.geometric_weight(height_m, slope_deg, curvature) * self.mask_of(p.material, x, y) * p.noise_mask(x, y);
        self.rules.iter().map(weight).collect()
    }
}

impl Prepared {
    fn geometric_weight(&self, height_m: f64, slope_deg: f64, curvature: f64) -> f64 {
        let rule = &self.rule;
        rule.weight
            * trapezoid(height_m, rule.height_m, rule.height_fade_m)
            * trapezoid(slope_deg, rule.slope_deg, rule.slope_fade_deg)
            * trapezoid(curvature, rule.curvature, rule.curvature_fade)
    }

    fn noise_mask(&self, x: f64, y: f64) -> f64 {
        let rule = &self.rule;
        if rule.noise_m <= 0.0 || rule.noise_cover >= 1.0 {
            return 1.0;
        }
        if rule.noise_cover <= 0.0 {
            return 0.0;
        }
        let noise = value_noise(x / rule.noise_m, y / rule.noise_m, self.seed);
        let t = ((noise - self.threshold) / (2.0 * NOISE_RAMP) + 0.5).clamp(0.0, 1.0);
        t * t * (3.0 - 2.0 * t)
    }
}

impl Painted {
    fn new(material: u8, stroke: &Stroke) -> Painted {
        let bound = |k: usize, of: fn(f64, f64) -> f64, none: f64| stroke.points.iter().map(|p| p[k]).fold(none, of);
        let low = [0, 1].map(|k| bound(k, f64::min, f64::INFINITY) - stroke.radius_m);
        let high = [0, 1].map(|k| bound(k, f64::max, f64::NEG_INFINITY) + stroke.radius_m);
        Painted { material, stroke: stroke.clone(), bounds: [low, high] }
    }

    fn may_reach(&self, x: f64, y: f64) -> bool {
        let [low, high] = self.bounds;
        (low[0]..=high[0]).contains(&x) && (low[1]..=high[1]).contains(&y)
    }

    /// Distance of a position from the edge of the painted line, metres: positive inside, negative outside.
    fn depth_m(&self, x: f64, y: f64) -> f64 {
        let points = &self.stroke.points;
        let to = |a: [f64; 2], b: [f64; 2]| {
            let (along, from) = ([b[0] - a[0], b[1] - a[1]], [x - a[0], y - a[1]]);
            let length_2 = along[0] * along[0] + along[1] * along[1];
            let t = if length_2 > 0.0 { ((from[0] * along[0] + from[1] * along[1]) / length_2).clamp(0.0, 1.0) } else { 0.0 };
            let (dx, dy) = (from[0] - t * along[0], from[1] - t * along[1]);
            dx * dx + dy * dy
        };
        let first = points.first().map_or(f64::INFINITY, |&p| to(p, p));
        let nearest = points.windows(2).map(|pair| to(pair[0], pair[1])).fold(first, f64::min);
        self.stroke.radius_m - nearest.sqrt()
    }

    /// Factor of a mask stroke: 1 outside the line, the stroke's `amount` at `fade_m` or more inside its edge, smooth in between.
    fn factor(&self, x: f64, y: f64) -> f64 {
        let depth = self.depth_m(x, y);
        let t = if self.stroke.fade_m > 0.0 { (depth / self.stroke.fade_m).clamp(0.0, 1.0) } else { f64::from(u8::from(depth > 0.0)) };
        1.0 + (self.stroke.amount - 1.0) * (t * t * (3.0 - 2.0 * t))
    }
}

/// Returns 1 inside the band and falls linearly to 0 over the distance `fade` on either side. Without a band, the result is always 1.
fn trapezoid(value: f64, band: Option<[f64; 2]>, fade: f64) -> f64 {
    let Some([from, to]) = band else { return 1.0 };
    let outside = (from - value).max(value - to).max(0.0);
    if outside <= 0.0 {
        1.0
    } else if outside < fade {
        1.0 - outside / fade
    } else {
        0.0
    }
}

/// Value noise in 0..=1 on a unit lattice: two octaves, the finer at 2.7 times the frequency and a third of the weight.
pub fn value_noise(x: f64, y: f64, seed: u32) -> f64 {
    let coarse = lattice_noise(x, y, seed);
    // The lattice is rotated (by the angle of a 3-4-5 triangle), so that the cells of the two octaves do not line up.
    let fine = lattice_noise((0.8 * x - 0.6 * y) * 2.7, (0.6 * x + 0.8 * y) * 2.7, seed ^ 0x9e37_79b9);
    0.75 * coarse + 0.25 * fine
}

fn lattice_noise(x: f64, y: f64, seed: u32) -> f64 {
    let (cell_x, cell_y) = (x.floor(), y.floor());
    let (fx, fy) = (x - cell_x, y - cell_y);
    // Lattice indices wrap at 2^32. Worlds with usual wavelengths are far smaller.
    let (ix, iy) = (cell_x as i64 as u32, cell_y as i64 as u32);
    let row = |j: u32| {
        let corner = |i: u32| f64::from(hash::pcg4d([ix.wrapping_add(i), iy.wrapping_add(j), seed, 0x0a7e])[0]) / f64::from(u32::MAX);
        let t = fx * fx * (3.0 - 2.0 * fx);
        let (a, b) = (corner(0), corner(1));
        a + (b - a) * t
    };
    let t = fy * fy * (3.0 - 2.0 * fy);
    let (a, b) = (row(0), row(1));
    a + (b - a) * t
}

/// Returns 257 measured quantiles of [`value_noise`]. They convert the share of the ground that a noise mask covers to a threshold. The
/// quantiles are measured, because the noise is not uniformly distributed.
fn noise_quantiles() -> Vec<f64> {
    const SIDE: u32 = 128;
    let mut values: Vec<f64> = (0..SIDE * SIDE)
        .map(|i| value_noise(f64::from(i % SIDE) * 0.618_034 + 0.31, f64::from(i / SIDE) * 0.618_034 + 0.17, 0x7157))
        .collect();
    values.sort_by(f64::total_cmp);
    (0..=256usize).map(|q| values[q * (values.len() - 1) / 256]).collect()
}

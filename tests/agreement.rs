//! The GPU against the references: every probe's function, the hashes, and both paths of classification.
//!
//! Truth is the reference in f64; values given are f32, so that all see the same input. The tolerance of each probe follows from the
//! accuracy that WGSL demands (W3C, *WebGPU Shading Language*, "Floating Point Accuracy"): sums, differences and products rounded once;
//! `x / y` 2.5 ULP; `inverseSqrt` 2 ULP and `sqrt` = 1 / `inverseSqrt`; `log2` 2^-21 absolute in [0.5, 2], 3 ULP elsewhere;
//! `exp2(x)` 3 + 2 |x| ULP; `pow` through those two; products may be contracted into sums, denormals may be flushed to zero. Bounds grow
//! with the conditioning of the row, computed in f64. NaN and infinity are not given: WGSL lets a shader assume that there are none.
//!
//! Where a result jumps (an index, a code, a cell), a row within the tolerance of its threshold may fall on either side: such rows are
//! counted, and may be few. Beside every comparison stand mutants of the shader that the same comparison must reject; the reference in
//! f32 must pass it.

use std::collections::BTreeSet;
use std::sync::OnceLock;

use bytemuck::{Zeroable, bytes_of};
use kernels::classification::{self, Classification, Lists, reference::tile_masks, tiles};
use kernels::frame::FrameUniforms;
use kernels::geometry;
use kernels::gpu::bindings::{Binding, aspect, view};
use kernels::gpu::{self, Gpu, GpuOptions, Timer};
use kernels::probe::{PROBES, Probe};
use kernels::shared::flavour_weights::FlavourParams;
use kernels::shared::real::{dot, length, sub};
use kernels::shared::{brdf, flavour_weights, hash, hex_tiling, octahedral, snapped_projection, splat_blend, tiling, triplanar};

/// A unit in the last place at 1: twice the rounding error of one operation.
const EPS: f64 = f32::EPSILON as f64;

/// Random rows of a probe.
const ROWS: u32 = 4096;

fn gpu() -> &'static Gpu {
    static GPU: OnceLock<Result<Gpu, String>> = OnceLock::new();
    GPU.get_or_init(|| Gpu::new().map_err(|e| e.to_string()))
        .as_ref()
        .unwrap_or_else(|e| panic!("these tests need a GPU or a software one, and there is none: {e}"))
}

/// Numbers of a row, from its index: independent of order.
struct Draw {
    row: u32,
    column: u32,
    table: u32,
}

impl Draw {
    fn word(&mut self) -> u32 {
        self.column += 1;
        hash::pcg4d([self.row, self.column, self.table, 2018])[0]
    }
    fn unit(&mut self) -> f64 {
        f64::from(self.word()) / 4_294_967_296.0
    }
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }
    fn direction(&mut self) -> [f64; 3] {
        let z = self.between(-1.0, 1.0);
        let (sin, cos) = self.between(0.0, std::f64::consts::TAU).sin_cos();
        let r = (1.0 - z * z).sqrt();
        [r * cos, r * sin, z]
    }
    /// A vector of any direction, 2^`low`..2^`high` long.
    fn vector(&mut self, low: f64, high: f64) -> [f64; 3] {
        let length = self.between(low, high).exp2();
        self.direction().map(|x| x * length)
    }
    fn whole(&mut self, below: u32) -> f64 {
        f64::from(self.word() % below)
    }
}

// ---------------------------------------------------------------- the comparator

/// What one row's comparison says.
#[derive(Debug, PartialEq)]
enum Verdict {
    /// Within the tolerance: the largest share of it that is used.
    Agrees(f64),
    /// On the other side of a threshold that lies within the tolerance.
    OtherSide,
    Differs,
}

/// Largest |got - want| / tolerance.
fn close(got: &[f64], want: &[f64], tolerance: f64) -> Verdict {
    let share = got.iter().zip(want).map(|(g, w)| (g - w).abs() / tolerance).fold(0.0, f64::max);
    if share <= 1.0 { Verdict::Agrees(share) } else { Verdict::Differs }
}

/// Both: the worse one.
fn both(a: Verdict, b: Verdict) -> Verdict {
    use Verdict::{Agrees, Differs, OtherSide};
    match (a, b) {
        (Differs, _) | (_, Differs) => Differs,
        (OtherSide, _) | (_, OtherSide) => OtherSide,
        (Agrees(a), Agrees(b)) => Agrees(a.max(b)),
    }
}

/// How a probe is compared.
struct Case {
    probe: &'static str,
    /// A random row.
    random: fn(&mut Draw) -> Vec<f64>,
    /// Rows at the ends of the ranges.
    extremes: fn() -> Vec<Vec<f64>>,
    /// Given row, result, truth.
    judge: fn(&[f64], &[f64], &[f64]) -> Verdict,
    /// Rows that may lie on the other side of a threshold.
    other_side_at_most: usize,
    /// Mutants: (shared file or "" for the probe's own text, what stands there once, what to put there).
    mutants: &'static [(&'static str, &'static str, &'static str)],
}

impl Case {
    fn probe(&self) -> &'static Probe {
        Probe::find(self.probe).unwrap_or_else(|e| panic!("{e}"))
    }

    #[allow(clippy::cast_possible_truncation, reason = "rows are rounded to f32, and that is what everyone is given")]
    fn rows(&self, table: u32) -> Vec<f32> {
        let random = (0..ROWS).map(|row| (self.random)(&mut Draw { row, column: 0, table }));
        let rows: Vec<f32> = (self.extremes)().into_iter().chain(random).flatten().map(|x| x as f32).collect();
        let probe = self.probe();
        for row in rows.chunks(probe.inputs.len()) {
            for (column, &x) in probe.inputs.iter().zip(row) {
                column.accepts(f64::from(x)).unwrap_or_else(|e| panic!("{}: {e}", self.probe));
            }
        }
        rows
    }

    /// Compares results with the truth: the share of the tolerance used and the rows on the other side of a threshold, or what differs.
    fn compare(&self, rows: &[f32], got: &[f32]) -> Result<(f64, usize), String> {
        let probe = self.probe();
        let (columns, results) = (probe.inputs.len(), probe.outputs.len());
        let wide = |v: &[f32]| v.iter().copied().map(f64::from).collect::<Vec<_>>();
        let (rows, got) = (wide(rows), wide(got));
        let truth = probe.on_f64(&rows);
        if got.len() != truth.len() {
            return Err(format!("{} results instead of {}", got.len(), truth.len()));
        }
        let (mut share, mut other_side, mut differing, mut first) = (0.0_f64, 0, 0, String::new());
        for ((row, got), want) in rows.chunks(columns).zip(got.chunks(results)).zip(truth.chunks(results)) {
            let verdict = if got.iter().all(|x| x.is_finite()) { (self.judge)(row, got, want) } else { Verdict::Differs };
            match verdict {
                Verdict::Agrees(s) => share = share.max(s),
                Verdict::OtherSide => other_side += 1,
                Verdict::Differs => {
                    differing += 1;
                    if differing == 1 {
                        first = format!("of {row:?} is {got:?}, truth {want:?}");
                    }
                }
            }
        }
        if differing > 0 {
            return Err(format!("{}: {differing} of {} rows differ, the first: {first}", self.probe, rows.len() / columns));
        }
        if other_side > self.other_side_at_most {
            let most = self.other_side_at_most;
            return Err(format!("{}: {other_side} rows are on the other side of a threshold, at most {most} may be", self.probe));
        }
        Ok((share, other_side))
    }
}

// ---------------------------------------------------------------- the probes

/// Unit vector: division by the largest (2.5 ULP), dot (3 roundings), sqrt (2 + 2.5 ULP), division (2.5 ULP): 11 ULP of at most 1, and
/// 5 more for the code's own division and sums.
const UNIT_TOLERANCE: f64 = 16.0 * EPS;

fn three(row: &[f64], at: usize) -> [f64; 3] {
    [row[at], row[at + 1], row[at + 2]]
}

/// A vector along an axis is exact in any precision; one step of f32 off it is the least that is not.
fn directions() -> Vec<[f64; 3]> {
    let mut all = vec![[0.0; 3], [2e-30, 0.0, 0.0], [1e-31, -1e-31, 1e-31], [9e29, -5e29, 1e29], [3e-30, 4e-30, -5e-30]];
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut v = [0.0; 3];
            v[axis] = sign;
            all.push(v);
            v[(axis + 1) % 3] = EPS;
            v[(axis + 2) % 3] = -EPS;
            all.push(v);
        }
    }
    for k in 0..8 {
        all.push([0, 1, 2].map(|i| if k >> i & 1 == 0 { 0.25 } else { -0.25 }));
    }
    all
}

fn octahedral_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let n = octahedral::unit(three(row, 0));
    let mut encoded = close(&got[..2], &want[..2], UNIT_TOLERANCE);
    // Below the equator a code jumps from edge to edge of the square where x or y changes sign, to the same direction.
    if encoded == Verdict::Differs && close(&octahedral::decode([got[0], got[1]]), &n, 4.0 * UNIT_TOLERANCE) != Verdict::Differs {
        encoded = Verdict::OtherSide;
    }
    let code = |v: &[f64]| -> Option<[u32; 2]> {
        let whole = |x: f64| (x.fract().abs() < EPS && (0.0..=254.0).contains(&x)).then_some(x as u32);
        Some([whole(v[2])?, whole(v[3])?])
    };
    let (Some(code), Some(best)) = (code(got), code(want)) else { return Verdict::Differs };
    let decoded = |code: [u32; 2]| octahedral::decode::<f64>(octahedral::dequantise(code, 8));
    let error = |code| length(sub(decoded(code), n));
    // Two codes may be equally near: then either will do.
    let chosen = if code == best {
        Verdict::Agrees(0.0)
    } else if error(code) - error(best) <= UNIT_TOLERANCE {
        Verdict::OtherSide
    } else {
        Verdict::Differs
    };
    both(both(encoded, chosen), close(&got[4..], &decoded(code), UNIT_TOLERANCE))
}

/// Level of a footprint, log2 of cells per metre, as wide as the noise sees it.
fn noise_level(footprint: f64) -> f64 {
    (-footprint.clamp(1e-6, 1e6).log2()).clamp(-5.0, 16.0)
}

/// Error of a level: `log2`'s own, and that of its argument, of relative error `ulps`, divided by ln 2.
fn level_error(level: f64, ulps: f64) -> f64 {
    2.0_f64.powi(-21) + EPS * (3.0 * level.abs() + 1.443 * ulps)
}

fn hashed_alpha_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (ddx, ddy) = (three(row, 7), three(row, 10));
    let (levels, ulps): (Vec<f64>, f64) = if row[0] < 1.0 {
        // A length: dot 3 roundings, sqrt 4.5 ULP, and the product with the cell size.
        (vec![noise_level(row[13] * length(ddx).max(length(ddy)))], 8.0)
    } else {
        let widen = std::f64::consts::SQRT_2 * row[13];
        ((0..3).map(|i| noise_level(widen * ddx[i].abs().max(ddy[i].abs()))).collect(), 3.0)
    };
    let error = levels.iter().map(|&l| level_error(l, ulps)).fold(0.0, f64::max);
    // Cells are products with powers of two, floored: exact. What is left is the blend, whose factor has the level's error; blend and
    // correction together change by at most 2.5 times that. 12 ULP for their own operations.
    let verdict = close(got, want, 3.0 * error + 12.0 * EPS);
    // With a scale per axis, another cell is looked up where one axis' level passes a whole number and the others' do not. (With one
    // scale for all, the blend is continuous there. At the ends of the range the scale stays what it is.)
    let at_threshold = |&l: &f64| (l - l.round()).abs() <= error && l.round() > -5.0 && l.round() < 16.0;
    if verdict == Verdict::Differs && row[0] >= 1.0 && levels.iter().any(at_threshold) { Verdict::OtherSide } else { verdict }
}

/// Integers throughout, and one exact conversion.
fn equal_judge(_: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    if got == want { Verdict::Agrees(0.0) } else { Verdict::Differs }
}

fn derivatives_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (ray, step, t, n) = (three(row, 0), three(row, 3), row[6], octahedral::unit(three(row, 7)));
    let neighbour = [0, 1, 2].map(|i| ray[i] + step[i]);
    let (s, r, facing) = (length(step), length(neighbour), dot(n, neighbour).abs().max(0.01 * length(neighbour)));
    let seen = dot(n, step).abs();
    // t (s - r' (n.s / n.r')): n is off by 11 ULP, so each dot by some 16 ULP of its vector's length, and the quotient, of which r'
    // takes r / facing times as much, by that of both.
    let relative = s + s * (r / facing) + seen * (r / facing) * (r / facing);
    let verdict = close(got, want, t.abs() * 20.0 * EPS * relative + f64::from(f32::MIN_POSITIVE));
    // Which side of the plane is seen: undecided where the ray lies in it.
    if verdict == Verdict::Differs && dot(n, ray).abs() <= 20.0 * EPS * length(ray) { Verdict::OtherSide } else { verdict }
}

fn splat_blend_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let used: Vec<f64> =
        splat_blend::bilinear([row[0], row[1]]).into_iter().filter(|&w| w > splat_blend::MIN_WEIGHT).map(f64::log2).collect();
    let spread = used.iter().fold(f64::MIN, |m, &x| m.max(x)) - used.iter().fold(f64::MAX, |m, &x| m.min(x));
    // A term is (w_i / w_best) 2^x, at most 1, so x is at most the spread of log2 w, and |x| 2^x at most 0.54 below zero. exp2 errs by
    // 3 + 2 |x| ULP, x by 0.7 |x| more; two divisions, products and the sum make 16 ULP.
    close(got, want, EPS * (16.0 + 4.0 * spread))
}

fn tri_planar_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let (n, k) = (three(row, 0), row[3].clamp(0.0, 1e4));
    let weights = triplanar::weights(n, row[3]);
    // 2^(k log2 r): log2 errs by 2^-21 = 4 ULP at 1, r by 12 ULP, which k magnifies and ln 2 and 1 undo in part: 16 k. A weight that is
    // nearly 0 or 1 cannot move: its derivative is w (1 - w).
    let sensitivity = weights.iter().map(|w| 4.0 * w * (1.0 - w)).fold(0.0, f64::max);
    let of_weights = EPS * (16.0 + 16.0 * k * sensitivity);
    let gradients: [[f64; 3]; 3] = [
        triplanar::from_gradient([row[4], row[5]], 0),
        triplanar::from_gradient([row[6], row[7]], 1),
        triplanar::from_gradient([row[8], row[9]], 2),
    ];
    let gradient: [f64; 3] = std::array::from_fn(|c| (0..3).map(|i| weights[i] * gradients[i][c]).sum());
    let unit = octahedral::unit(n);
    let bent = sub(unit, sub(gradient, unit.map(|x| x * dot(unit, gradient))));
    // The gradient inherits the weights' error. Its part along the normal cancels, so errors are those of the whole gradient, over the
    // length that is divided by, at least 1.
    let of_gradient = of_weights * gradients.iter().map(|&g| length(g)).sum::<f64>() + 24.0 * EPS * (1.0 + length(gradient));
    both(close(&got[..3], &want[..3], of_weights), close(&got[3..], &want[3..], of_gradient / length(bent).max(1.0) + UNIT_TOLERANCE))
}

fn select_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let mut verdict = Verdict::Agrees(0.0);
    for (count, index, best) in [(4, got[0], want[0]), (3, got[1], want[1])] {
        if (index - best).abs() < 0.5 && index.fract().abs() < EPS {
            continue;
        }
        if index.fract() != 0.0 || !(0.0..count as f64).contains(&index) {
            return Verdict::Differs;
        }
        // Three sums and a product, rounded once each: 4 half ULPs of the total.
        let (weights, chosen) = (row[..count].iter().map(|w| w.max(0.0)).collect::<Vec<_>>(), index as usize);
        let total: f64 = weights.iter().sum();
        let below: f64 = weights[..chosen].iter().sum();
        let (target, slack) = (row[4].clamp(0.0, 1.0) * total, 2.0 * EPS * total);
        if weights[chosen] <= 0.0 || target < below - slack || target > below + weights[chosen] + slack {
            return Verdict::Differs;
        }
        verdict = Verdict::OtherSide;
    }
    verdict
}

/// Compares weights by the key each belongs to; what one side does not name has weight 0. Another set of keys is the other side of a
/// threshold, if the weights agree.
fn keyed(got: &[(u64, f64)], want: &[(u64, f64)], tolerance: f64) -> Verdict {
    let weight = |of: &[(u64, f64)], key: u64| of.iter().filter(|(k, _)| *k == key).map(|(_, w)| w).sum::<f64>();
    let keys: BTreeSet<u64> = got.iter().chain(want).map(|(key, _)| *key).collect();
    let side = |of: &[(u64, f64)]| keys.iter().map(|&key| weight(of, key)).collect::<Vec<_>>();
    let verdict = close(&side(got), &side(want), tolerance);
    let same = |of: &[(u64, f64)]| of.iter().map(|(key, _)| *key).collect::<BTreeSet<_>>();
    if verdict != Verdict::Differs && same(got) != same(want) { Verdict::OtherSide } else { verdict }
}

fn biplanar_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let n = octahedral::unit(three(row, 0)).map(f64::abs);
    let k = row[3].clamp(0.0, 1e4) / 8.0;
    let above = [want[0], want[1]].map(|axis| (n[axis as usize] - 1.0 / 3.0_f64.sqrt()).max(0.0));
    let top = above[0].max(above[1]);
    if (got[2] + got[3] - 1.0).abs() > 4.0 * EPS || got[2].min(got[3]) < 0.0 {
        return Verdict::Differs;
    }
    // On a diagonal the blend jumps, and next to it rounding decides.
    if top <= 2.0 * UNIT_TOLERANCE {
        return Verdict::OtherSide;
    }
    // Error of the ratio of what is above, and of its k-th power: of slope k r^(k-1) where r is well above its error, at most error^k
    // where it is not and k is below 1. log2 errs by 2^-21 = 4 ULP at 1, which k magnifies; w 2^-w undoes that in part.
    let (r, e) = (above[0].min(above[1]) / top, 2.0 * UNIT_TOLERANCE / top);
    let slope = if k >= 1.0 { k } else { k * (r - e).max(1e-300).powf(k - 1.0) };
    let power = if r > 2.0 * e || k >= 1.0 { slope * e } else { (3.0 * e).powf(k) };
    let pairs = |v: &[f64]| [(v[0] as u64, v[2]), (v[1] as u64, v[3])];
    keyed(&pairs(got), &pairs(want), power + EPS * (16.0 + 4.0 * k))
}

fn hex_tiling_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    if (got[0] - want[0]).abs() > 0.5 {
        // Half-way between two powers of two.
        let spacings = (row[5] * 12.0_f64.sqrt()).log2();
        let near = (spacings - spacings.floor() - 0.5).abs() <= level_error(spacings, 2.0);
        return if near && (got[0] - want[0]).abs() < 1.5 { Verdict::OtherSide } else { Verdict::Differs };
    }
    let id = |v: &[f64], i: usize| v[1 + 2 * i] as u64 * 65_536 + v[2 + 2 * i] as u64;
    let first = [got[1] as u32, got[2] as u32];
    if close(&got[10..], &hex_tiling::offset::<f64>(first, row[6] as u32), 0.5 * f64::from(f32::MIN_POSITIVE)) == Verdict::Differs {
        return Verdict::Differs;
    }
    // Products with powers of two are exact; a coordinate in spacings has three more roundings. A barycentric one sums two, and is
    // divided by at least 1/3: 6 times their error; the 7th power magnifies by 7, and normalising at most doubles.
    let reach = row[2].abs().max(row[3].abs()) / row[4] * got[0].exp2();
    let coordinate = 1.5 * EPS * (1.2 * reach + 1.0);
    let pairs = |v: &[f64]| [0, 1, 2].map(|i| (id(v, i), v[7 + i]));
    keyed(&pairs(got), &pairs(want), 2.0 * 7.0 * 6.0 * coordinate + 24.0 * EPS)
}

fn texel_choice_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    if got.iter().zip(want).all(|(g, w)| (g - w).abs() < 0.5) {
        return Verdict::Agrees(0.0);
    }
    // A level and a coordinate in texels have an ULP of their size; what u is compared with is their fraction.
    let lod = row[0].clamp(0.0, row[1] - 1.0);
    let texels = (row[3] - row[3].floor()) * row[4] - 0.5;
    let may = |x: f64, u: f64, error: f64| {
        let part = x - x.floor();
        (u - part).abs() <= error || part <= error || part >= 1.0 - error
    };
    let level = (got[0] - want[0]).abs() < 0.5 || ((got[0] - want[0]).abs() < 1.5 && may(lod, row[2], EPS * (lod + 1.0)));
    let steps = (got[1] - want[1]).abs().min(row[4] - (got[1] - want[1]).abs());
    let texel = steps < 0.5 || (steps < 1.5 && may(texels, row[5], EPS * (row[4] + 1.0)));
    if level && texel { Verdict::OtherSide } else { Verdict::Differs }
}

fn layers_judge(_: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    // A quotient (2.5 ULP and a sum) and a mixture (4 roundings) a layer, each of numbers up to 1.
    close(got, want, 8.0 * 8.0 * EPS)
}

fn snapped_projection_judge(row: &[f64], got: &[f64], want: &[f64]) -> Verdict {
    let n = octahedral::unit(three(row, 0));
    let plane = got[0] as u32;
    let step = (std::f64::consts::PI / 8.0).tan();
    // Thresholds: the slope, 22.5 degrees either side of the axes, and the sign of a component that is zero.
    let [x, y] = [n[0].abs(), n[1].abs()];
    let margins = [n[2].abs() - row[3], y - step * x, x - step * y];
    let near = margins.iter().any(|m| m.abs() <= 2.0 * UNIT_TOLERANCE);
    let verdict = if plane == want[0] as u32 {
        Verdict::Agrees(0.0)
    } else if near {
        Verdict::OtherSide
    } else {
        return Verdict::Differs;
    };
    let sectors = snapped_projection::sectors([row[7] as i32, row[8] as i32, row[9] as i32], plane).map(f64::from);
    let rate = f64::from(snapped_projection::fixed(row[10] as i32, plane));
    let position = three(row, 4);
    let gradient = [row[11], row[12]];
    let sizes = (length(position), gradient[0].abs() + gradient[1].abs());
    let whole = close(&got[1..4], &[sectors[0], sectors[1], rate], 0.25);
    // A sum and a product: two roundings.
    let coordinates = close(&got[4..6], &snapped_projection::coordinates(position, plane), 2.0 * EPS * sizes.0 + 1e-30);
    let volume = close(&got[6..], &snapped_projection::from_gradient(gradient, plane), 2.0 * EPS * sizes.1 + 1e-30);
    both(both(verdict, whole), both(coordinates, volume))
}

const CASES: &[Case] = &[
    Case {
        probe: "octahedral",
        random: |d| d.vector(-20.0, 20.0).to_vec(),
        extremes: || directions().into_iter().map(|n| n.to_vec()).collect(),
        judge: octahedral_judge,
        // Equally near codes: a part of some 16 ULP / 2^-7 = 2^-12 of the random rows, so 1 is expected; and the symmetric extremes, which
        // lie between codes: 8 diagonals, 12 a step off an axis.
        other_side_at_most: 4 + 20,
        mutants: &[
            ("octahedral", "(vec2<f32>(1.0) - abs(flat.yx)) * octahedral_sign(flat)", "vec2<f32>(1.0) - abs(flat.yx)"),
            // The nearest code of each coordinate instead of the nearest direction.
            ("", "octahedral_encode8_precise(n)", "octahedral_quantise8(e)"),
            ("octahedral", "if error < best_error", "if i == 0u"),
            ("octahedral", "return v / sqrt(dot(v, v));", "return v;"),
        ],
    },
    Case {
        probe: "hashed-alpha",
        random: |d| {
            let sector_m = d.between(5.0, 15.0).floor().exp2();
            let kind = d.whole(2);
            let reach = if d.whole(2) < 0.5 { 160 } else { 1 << 24 };
            let sector = [0; 2].map(|_: i32| d.whole(2 * reach) - f64::from(reach));
            let position = [d.unit() * sector_m * 0.999_999, d.unit() * sector_m * 0.999_999, d.between(-500.0, 3000.0)];
            let size = d.between(-18.0, 7.0);
            let (ddx, ddy) = (d.vector(size - 3.0, size), d.vector(size - 3.0, size));
            let scale = d.between(-2.0, 2.0).exp2();
            let seeds = [d.whole(1 << 24), d.whole(1 << 24)];
            [&[kind][..], &sector, &position, &[sector_m], &ddx, &ddy, &[scale], &seeds].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for kind in [0.0, 1.0] {
                for sector in [[0.0, 0.0], [16_777_216.0, -16_777_216.0]] {
                    for position in [[0.0, 0.0, 0.0], [31.999_998, 1e-3, 8848.0], [0.0, 0.0, -1e9], [1e20, -1e20, 9e29]] {
                        // Footprints of zero, below and beyond the range of scales, and whole powers of two of one scale for all.
                        for [x, y] in [[0.0, 0.0], [1e-9, 1e-9], [1e9, 1e12], [0.25, 0.125], [1.0, 1.0], [32.0, 4.0], [0.03, 3.0]] {
                            for seed in [0.0, 16_777_216.0] {
                                let row = [&[kind][..], &sector, &position, &[32.0, x, 0.0, 0.0, 0.0, y, 0.0, 1.0, seed, seed]];
                                rows.push(row.concat());
                            }
                        }
                    }
                }
            }
            rows
        },
        judge: hashed_alpha_judge,
        // Three levels within 1e-5 of a whole number in half of the rows: 0.1 of 4096 expected.
        other_side_at_most: 4,
        mutants: &[
            // Not uniform; both scales alike; one seed for all decisions; cells of a sector too few.
            ("noise", "noise_correct(x.x, lerp_factor)", "x.x"),
            ("noise", "return noise_blend(coarse, fine, level - lower);", "return noise_blend(coarse, coarse, level - lower);"),
            ("noise", "hash_mix(seed, salt, level)", "hash_mix(seed, seed, level)"),
            ("noise", "bitcast<u32>(sector) * cells_per_sector +", "bitcast<u32>(sector) * (cells_per_sector - 1u) +"),
        ],
    },
    Case {
        probe: "noise",
        random: |d| {
            let sector_m = d.between(5.0, 15.0).floor().exp2();
            let reach = if d.whole(2) < 0.5 { 160 } else { 1 << 24 };
            let kind = 2.0 + d.whole(5);
            let sector = [0; 2].map(|_: i32| d.whole(2 * reach) - f64::from(reach));
            let position = [d.unit() * sector_m * 0.999_999, d.unit() * sector_m * 0.999_999, d.between(-500.0, 3000.0)];
            let level = d.whole(24) - 6.0;
            let pixel = [d.whole(4096), d.whole(4096)];
            let times = [d.whole(2000), d.whole(1 << 24), d.whole(1 << 24)];
            let ranks = [0; 4].map(|_: i32| d.whole(4096));
            [&[kind][..], &sector, &position, &[sector_m, level], &pixel, &times, &ranks].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for kind in [2.0, 3.0, 4.0, 5.0, 6.0] {
                for place in [[0.0; 5], [16_777_216.0, -16_777_216.0, 31.999_998, 1e-3, 8848.0], [1.0, -1.0, 1e20, -1e20, -9e29]] {
                    for level in [0.0, -5.0, 16.0, 17.0, -16_777_216.0, 16_777_216.0] {
                        for [pixel, word] in [[0.0, 0.0], [63.0, 15.0], [64.0, 16.0], [16_777_216.0, 16_777_216.0]] {
                            for rank in [0.0, 4095.0, 4096.0, 16_777_216.0] {
                                let row = [&[kind][..], &place, &[32.0, level, pixel, pixel, word, word, word, rank, rank, 0.0, 1.0]];
                                rows.push(row.concat());
                            }
                        }
                    }
                }
            }
            rows
        },
        judge: equal_judge,
        other_side_at_most: 0,
        mutants: &[
            // A word of the product forgotten; one symmetry for two decisions; no rotation; a frame that does not move the lattice.
            ("noise", "+ (other >> 16u)", ""),
            ("noise", "select(shifted, shifted.yx, decision >= 2u)", "shifted"),
            ("noise", "noise_interleaved_gradient_value(turned, frame) + h.z", "noise_interleaved_gradient_value(turned, frame)"),
            ("noise", "+ frame * NOISE_IGN_FRAME", ""),
            // Slices not repeated, or the blue mask for the first of them; rows for columns; a shift for all decisions; no jitter; the
            // jitter of static noise fresh in every frame; ranks beyond the last.
            ("noise", "frame % NOISE_MASK_SLICES", "frame % 15u"),
            ("noise", "1u + frame % NOISE_MASK_SLICES", "frame % NOISE_MASK_SLICES"),
            ("noise", "shifted.y * NOISE_MASK_EDGE + shifted.x", "shifted.x * NOISE_MASK_EDGE + shifted.y"),
            ("noise", "vec4<u32>(seed, salt, decision, NOISE_MASK_EDGE)", "vec4<u32>(seed, salt, 0u, NOISE_MASK_EDGE)"),
            ("noise", "(jitter >> vec4<u32>(12u))", "vec4<u32>(0u)"),
            ("noise", "select(0u, frame, kind == NOISE_SPATIO_TEMPORAL_BLUE)", "frame"),
            ("noise", "min(ranks, vec4<u32>(NOISE_MASK_RANKS - 1u))", "ranks"),
            // Cells of another size; a level that is not held; white noise that stands still.
            ("noise", "vec3<i32>(k), seed, salt);\n}\n\n// The high", "vec3<i32>(k + 1), seed, salt);\n}\n\n// The high"),
            ("noise", "let k = clamp(level, i32(NOISE_LEVEL_MIN), i32(NOISE_LEVEL_MAX));", "let k = level;"),
            ("noise", "vec4<u32>(pixel, frame, hash_mix(seed, salt, 0u))", "vec4<u32>(pixel, 0u, hash_mix(seed, salt, 0u))"),
        ],
    },
    Case {
        probe: "derivatives",
        random: |d| {
            let ray = d.vector(-1.0, 1.0);
            let step = d.vector(-14.0, -7.0);
            let t = d.between(-4.0, 14.0).exp2();
            [&ray[..], &step, &[t], &d.vector(-10.0, 10.0)].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for t in [0.0, 0.1, 20_000.0] {
                    rows.push([&[0.3, 0.9, -0.2, 0.0009, 0.0, 0.0, t][..], &n].concat());
                    rows.push([&[0.0, 1.0, 0.0, 0.0, -0.0002, -0.0009, t][..], &n].concat());
                }
                // No step, and one as long as the ray.
                rows.push([&[0.3, 0.9, -0.2, 0.0, 0.0, 0.0, 10.0][..], &n].concat());
                rows.push([&[0.3, 0.9, -0.2, 0.9, -0.3, 0.1, 10.0][..], &n].concat());
            }
            rows
        },
        judge: derivatives_judge,
        // The ray lies in the plane in 2^-19 of the random rows and some of the extremes made of axes.
        other_side_at_most: 16,
        mutants: &[
            // One coordinate of the step twice; the point's own ray; no limit at grazing angles; the plane's normal not brought to length 1
            // changes nothing but the limit.
            ("", "vec3<f32>(row[3], row[4], row[5])", "vec3<f32>(row[3], row[3], row[5])"),
            ("derivatives", "ray_step - neighbour *", "ray_step - ray *"),
            ("derivatives", "max(side * dot(n, neighbour), limit)", "(side * dot(n, neighbour))"),
            ("derivatives", "octahedral_unit(normal)", "normal"),
        ],
    },
    Case {
        probe: "splat-blend",
        random: |d| {
            let sharpness = if d.whole(8) < 0.5 { 0.0 } else { d.between(-2.0, 7.0).exp2() };
            vec![d.unit(), d.unit(), d.unit(), d.unit(), d.unit(), d.unit(), sharpness]
        },
        extremes: || {
            let mut rows = Vec::new();
            let ends = [0.0, 1e-20, 1e-6, 0.5, 1.0 - 0.5 * EPS, 1.0, -3.0, 7.0];
            for x in ends {
                for y in ends {
                    for k in [0.0, 8.0, 1e4, 1e9, -1.0] {
                        rows.push(vec![x, y, 0.0, 1.0, 0.25, 1.0, k]);
                        rows.push(vec![x, y, -1e6, 1e6, 0.0, 0.5, k]);
                    }
                }
            }
            rows
        },
        judge: splat_blend_judge,
        other_side_at_most: 0,
        mutants: &[
            ("splat_blend", "return bent / (bent.x + bent.y + bent.z + bent.w);", "return bent;"),
            ("splat_blend", "f.x * g.y, g.x * f.y,", "g.x * f.y, f.x * g.y,"),
            ("splat_blend", "exp2(exponent)", "exp(exponent)"),
            ("splat_blend", "min(sharpness, SPLAT_BLEND_MAX_SHARPNESS)", "min(sharpness, 64.0)"),
            // Term by term: what was summed is not measured anew; the winner is the first term.
            ("splat_blend", "(run.weight / w) * exp2(min(k * (run.height - h), 120.0)), 1.0", "1.0, 1.0"),
            ("splat_blend", "if score > run.score {", "if run.weight <= 0.0 {"),
        ],
    },
    Case {
        probe: "tri-planar",
        random: |d| {
            let n = d.vector(-10.0, 10.0);
            let k = if d.whole(8) < 0.5 { 0.0 } else { d.between(-2.0, 5.0).exp2() };
            let slope = d.between(-6.0, 3.0).exp2();
            let gradients = [0; 6].map(|_| d.between(-slope, slope));
            [&n[..], &[k], &gradients].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for k in [0.0, 4.0, 1e4, 1e9, -1.0] {
                    for slope in [0.0, 1.0, 1e5] {
                        rows.push([&n[..], &[k, slope, -slope, slope, slope, -slope, slope]].concat());
                    }
                }
            }
            rows
        },
        judge: tri_planar_judge,
        other_side_at_most: 0,
        mutants: &[
            // Weights not normalised; a power of 0 that is 0 always; a gradient along the wrong axis; a normal that bends the wrong way, and one
            // bent by the whole gradient instead of its part along the surface.
            ("triplanar", "return w / (w.x + w.y + w.z);", "return w;"),
            ("triplanar", "select(0.0, 1.0, sharpness <= 0.0)", "0.0"),
            ("triplanar", "return vec3<f32>(g.x, 0.0, g.y);", "return vec3<f32>(g.x, g.y, 0.0);"),
            ("triplanar", "unit - (g -", "unit + (g -"),
            ("triplanar", "(g - unit * dot(unit, g))", "g"),
        ],
    },
    Case {
        probe: "select",
        random: |d| {
            let mut row: Vec<f64> = (0..4).map(|_| if d.whole(5) < 0.5 { 0.0 } else { d.between(-10.0, 3.0).exp2() }).collect();
            row.push(d.unit());
            row
        },
        extremes: || {
            let mut rows = Vec::new();
            for bits in 0..16 {
                for u in [0.0, 0.25, 0.5, 0.75, 1.0 - 0.5 * EPS, 1.0, -1.0, 2.0] {
                    for size in [1.0, 1e-20, 1e29] {
                        // Sums and products with these are exact: the threshold itself is compared.
                        rows.push((0..4).map(|i| if bits >> i & 1 == 0 { 0.0 } else { size }).chain([u]).collect());
                        rows.push((0..4).map(|i| if bits >> i & 1 == 0 { -size } else { size }).chain([u]).collect());
                    }
                }
            }
            rows
        },
        judge: select_judge,
        // Random rows hit a threshold with 4096 * 6 * 2^-23; extremes where a sum of three rounded weights meets u = 3/4 of four.
        other_side_at_most: 8,
        mutants: &[
            // Index 0 although its weight is 0; a threshold forgotten; the last index although its weight is 0; negative weights counted.
            ("select", "if target_sum < below_1 {", "if target_sum <= below_1 {"),
            ("select", "if target_sum < below_2 {", "if target_sum < below_1 {"),
            ("select", "if w.w > 0.0 {", "if w.w >= 0.0 {"),
            ("select", "select(vec4<f32>(0.0), min(weights, vec4<f32>(SELECT_MAX_WEIGHT)), weights > vec4<f32>(0.0))", "weights"),
        ],
    },
    Case {
        probe: "biplanar",
        random: |d| {
            let k = if d.whole(8) < 0.5 { 0.0 } else { d.between(-2.0, 6.0).exp2() };
            [&d.vector(-10.0, 10.0)[..], &[k]].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for k in [0.0, 4.0, 8.0, 1e4, 1e9, -1.0] {
                    rows.push([&n[..], &[k]].concat());
                }
            }
            // Where the second projection changes: two components alike, below and above the third.
            for third in [0.0, 0.5, 1.0 - EPS, 1.0 + EPS, 2.0] {
                rows.push(vec![1.0, 1.0, third, 8.0]);
                rows.push(vec![third, -1.0, 1.0, 4.0]);
                rows.push(vec![1.0, third, -1.0, 2.0]);
            }
            rows
        },
        judge: biplanar_judge,
        // Extremes: 8 diagonals with 6 powers, 6 rows a step off a diagonal, and a few where two components that count for nothing are alike.
        other_side_at_most: 80,
        mutants: &[
            // A third projection that leaves with a seam; weights not normalised; another power; the wrong axis left out.
            ("biplanar", "max(kept - BIPLANAR_DIAGONAL, vec2<f32>(0.0))", "kept"),
            ("biplanar", "w / (w.x + w.y)", "w"),
            ("biplanar", "0.125 * select", "select"),
            ("biplanar", "a.x <= a.y && a.x <= a.z", "a.x <= a.y"),
        ],
    },
    Case {
        probe: "hex-tiling",
        random: |d| {
            let sector_m = d.between(5.0, 15.0).floor().exp2();
            let reach = if d.whole(2) < 0.5 { 160 } else { 1 << 24 };
            let sector = [0; 2].map(|_: i32| d.whole(2 * reach) - f64::from(reach));
            let position = [0; 2].map(|_: i32| d.between(-1.0, 1.0) * sector_m);
            [&sector[..], &position, &[sector_m, d.between(-10.0, 7.0).exp2(), d.whole(1 << 24)]].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for sector in [[0.0, 0.0], [16_777_216.0, -16_777_216.0], [-1.0, 1.0]] {
                for position in [[0.0, 0.0], [64.0, 64.0], [-1e-6, 1e-6], [31.999_998, 0.0], [3e30, -1e20]] {
                    for repeats in [0.0, 1e-9, 16.0, 32.0, -4.0] {
                        rows.push([&sector[..], &position, &[64.0, repeats, 7.0]].concat());
                    }
                }
            }
            rows
        },
        judge: hex_tiling_judge,
        // Within an error of a cell's border, where the hexagon that goes has weight 0, or of half-way between two levels: a few random rows,
        // and the extremes at and a step off a corner.
        other_side_at_most: 32,
        mutants: &[
            // Blended without sharpening; a seam at sector borders; one offset for all; weights not normalised; the upper triangle's weights.
            ("hex_tiling", "return square * square * square * w;", "return w;"),
            ("hex_tiling", "(s.x << (HEX_TILING_SKEW_BITS + step)) - skewed_y", "(s.x << (HEX_TILING_SKEW_BITS + step))"),
            ("hex_tiling", "vec4<u32>(id, salt, 0u)", "vec4<u32>(id.xx, salt, 0u)"),
            ("hex_tiling", "sharp / (sharp.x + sharp.y + sharp.z)", "sharp"),
            ("hex_tiling", "vec3<f32>(f.x + f.y - 1.0, 1.0 - f.y, 1.0 - f.x)", "vec3<f32>(f.x + f.y - 1.0, 1.0 - f.x, 1.0 - f.y)"),
        ],
    },
    Case {
        probe: "texel-choice",
        random: |d| {
            let levels = 1.0 + d.whole(12);
            let size = d.whole(13).exp2();
            vec![d.between(-2.0, 14.0), levels, d.unit(), d.between(-200.0, 200.0), size, d.unit()]
        },
        extremes: || {
            let mut rows = Vec::new();
            for u in [0.0, 0.5, 1.0 - 0.5 * EPS] {
                for lod in [-1e30, -1.0, 0.0, 0.5, 3.0, 1e30] {
                    for coordinate in [0.0, 0.999_999, -1e-7, 0.5, -3.25, 1e5, 1e20] {
                        for size in [1.0, 2.0, 1024.0, 3.0] {
                            rows.push(vec![lod, 5.0, u, coordinate, size, u]);
                        }
                    }
                }
            }
            rows
        },
        judge: texel_choice_judge,
        // u is within 2^-23 times some hundred texels of a threshold: 0.1 of 4096 expected; extremes with a size of 3 and a centre at 1 - 5e-7.
        other_side_at_most: 24,
        mutants: &[
            // Always the level below; the nearest texel; corners for centres; no repeat; the farther texel more often.
            ("texel_choice", "select(0.0, 1.0, u < l - below)", "0.0"),
            ("texel_choice", "select(0.0, 1.0, u < x - below)", "select(0.0, 1.0, 0.5 < x - below)"),
            ("texel_choice", "* texels - 0.5", "* texels"),
            ("texel_choice", "texels - 1.0, texel < 0.0", "0.0, texel < 0.0"),
            ("texel_choice", "u < x - below", "u >= x - below"),
        ],
    },
    Case {
        probe: "layers",
        random: |d| {
            let weights = splat_blend::bilinear([d.unit(), d.unit()]);
            [&weights[..], &[0; 4].map(|_| d.whole(8))].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for fraction in [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [1e-20, 1.0 - EPS], [0.5, 0.5]] {
                for layers in [[0.0; 4], [7.0; 4], [7.0, 6.0, 1.0, 0.0], [0.0, 1.0, 6.0, 7.0], [3.0, 3.0, 5.0, 5.0]] {
                    rows.push([&splat_blend::bilinear(fraction)[..], &layers].concat());
                }
            }
            rows
        },
        judge: layers_judge,
        other_side_at_most: 0,
        mutants: &[
            // A share for an opacity; layer 0 transparent; a layer that counts those above it; a weight forgotten.
            ("layers", "share / max(share + below, 1e-30)", "share"),
            ("layers", "1.0, layer == 0u", "share, layer == 0u"),
            ("layers", "layers == vec4<u32>(layer)", "layers >= vec4<u32>(layer)"),
            ("layers", "vec4<f32>(1.0));", "vec4<f32>(1.0, 1.0, 1.0, 0.0));"),
        ],
    },
    Case {
        probe: "snapped-projection",
        random: |d| {
            let sectors = [0; 3].map(|_| d.whole(1 << 21) - f64::from(1 << 20));
            let fixed = d.whole(1 << 25) - f64::from(1 << 24);
            let (n, p) = (d.vector(-10.0, 10.0), d.vector(-3.0, 12.0));
            [&n[..], &[0.8], &p, &sectors, &[fixed, d.between(-2.0, 2.0), d.between(-2.0, 2.0)]].concat()
        },
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for cosine in [0.0, 0.8, 1.0] {
                    for fixed in [0.0, 1.0, -1.0, 255.0, -256.0, 16_777_216.0, -16_777_216.0] {
                        rows.push([&n[..], &[cosine, 1.0, -2.0, 3.0, 5.0, -7.0, 11.0, fixed, 0.5, -0.25]].concat());
                    }
                }
            }
            rows
        },
        judge: snapped_projection_judge,
        // Directions without x and y, or with z at the threshold.
        other_side_at_most: 100,
        mutants: &[
            // The other diagonal; sectors and positions that disagree; a rate of whole 45 degree steps; steep and gentle exchanged.
            ("snapped_projection", "(u.x > 0.0) == (u.y > 0.0)", "(u.x > 0.0) != (u.y > 0.0)"),
            ("snapped_projection", "place.y - place.x", "place.x - place.y"),
            ("snapped_projection", "(((per_sector_fixed & 255) * SNAPPED_DIAGONAL) >> 8u)", "0"),
            ("snapped_projection", "a.z >= cosine", "a.z < cosine"),
            ("snapped_projection", "a.y <= SNAPPED_HALF_STEP * a.x", "a.y <= a.x"),
            ("snapped_projection", "vec3<f32>(-along, along, g.y)", "vec3<f32>(along, along, g.y)"),
        ],
    },
];

/// Whether a byte belongs to an identifier.
fn is_word(byte: Option<&u8>) -> bool {
    byte.is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_')
}

/// Replaces an identifier wherever it stands whole.
fn rename(text: &str, from: &str, to: &str) -> String {
    let mut out = String::new();
    let mut rest = text;
    while let Some(at) = rest.find(from) {
        let (before, after) = (rest.as_bytes()[..at].last(), rest.as_bytes().get(at + from.len()));
        out.push_str(&rest[..at]);
        out.push_str(if is_word(before) || is_word(after) { from } else { to });
        rest = &rest[at + from.len()..];
    }
    out + rest
}

/// A probe's text with one thing in it, or in a shared file it calls, changed. The changed file is appended under other names.
fn mutant(body: &str, file: &str, from: &str, to: &str) -> String {
    if file.is_empty() {
        assert_eq!(body.matches(from).count(), 1, "`{from}` is not there once");
        return body.replace(from, to);
    }
    let text = kernels::shared::WGSL.iter().find(|(name, _)| *name == file).expect("a shared file").1;
    // The function of three calls that of four; a mutation of a text that stands twice would be two.
    let count = text.matches(from).count();
    assert!(count >= 1, "{file}.wgsl: `{from}` is not there");
    let mut all = format!("{}\n{body}", text.replacen(from, to, 1));
    for line in text.lines() {
        let declared = ["fn ", "const ", "struct "].iter().find_map(|keyword| line.strip_prefix(keyword));
        if let Some(name) = declared.and_then(|d| d.split(['(', ':', ' ']).next()) {
            all = rename(&all, name, &format!("{name}_mutant"));
        }
    }
    all
}

/// A probe's text with results rounded to 11 bits: a shader of half precision.
fn in_half_precision(probe: &Probe) -> String {
    let (columns, results) = (probe.inputs.len(), probe.outputs.len());
    format!(
        "{}
fn probe(row: array<f32, {columns}>) -> array<f32, {results}> {{
    var rounded = probe_exact(row);
    for (var i = 0u; i < {results}u; i++) {{ rounded[i] = quantizeToF16(rounded[i]); }}
    return rounded;
}}",
        rename(probe.wgsl, "probe", "probe_exact")
    )
}

fn check(name: &str) {
    let table = u32::try_from(CASES.iter().position(|c| c.probe == name).expect("a case")).expect("few");
    let case = &CASES[table as usize];
    let probe = case.probe();
    let rows = case.rows(table);
    let run = |body: &str| {
        gpu::probe::run(gpu(), body, &rows, probe.inputs.len(), probe.outputs.len()).unwrap_or_else(|e| panic!("{name}: {e}\n{body}"))
    };

    let got = probe.on_gpu(gpu(), &rows).unwrap_or_else(|e| panic!("{e}"));
    let single = case.compare(&rows, &probe.on_f32(&rows)).unwrap_or_else(|e| panic!("the reference in f32: {e}"));
    let (share, other_side) = case.compare(&rows, &got).unwrap_or_else(|e| panic!("{e}"));
    println!("{name}: {share:.4} of the tolerance used, {other_side} rows on the other side of a threshold; in f32 {single:?}");

    // Negative controls.
    for &(file, from, to) in case.mutants {
        assert!(case.compare(&rows, &run(&mutant(probe.wgsl, file, from, to))).is_err(), "{name}: `{to}` for `{from}` was not noticed");
    }
    if probe.outputs.iter().any(|c| c.whole.is_none()) {
        assert!(case.compare(&rows, &run(&in_half_precision(probe))).is_err(), "{name}: half precision was not noticed");
    }
    let mut broken = got.clone();
    broken[0] = f32::NAN;
    assert!(case.compare(&rows, &broken).is_err(), "{name}: NaN was not noticed");
}

#[test]
fn every_probe_has_a_case() {
    let probes: BTreeSet<_> = PROBES.iter().map(|p| p.name).collect();
    assert_eq!(probes, CASES.iter().map(|c| c.probe).collect());
}

#[test]
fn octahedral_agrees() {
    check("octahedral");
}

#[test]
fn hashed_alpha_agrees() {
    check("hashed-alpha");
}

#[test]
fn noise_is_bit_equal() {
    check("noise");
}

#[test]
fn derivatives_agree() {
    check("derivatives");
}

#[test]
fn splat_blend_agrees() {
    check("splat-blend");
}

#[test]
fn tri_planar_agrees() {
    check("tri-planar");
}

#[test]
fn select_agrees() {
    check("select");
}

#[test]
fn biplanar_agrees() {
    check("biplanar");
}

#[test]
fn hex_tiling_agrees() {
    check("hex-tiling");
}

#[test]
fn texel_choice_agrees() {
    check("texel-choice");
}

#[test]
fn layers_agree() {
    check("layers");
}

#[test]
fn snapped_projection_agrees() {
    check("snapped-projection");
}

// ---------------------------------------------------------------- hashes

/// Words travel in halves, which f32 holds exactly: as bits of f32 they would be NaN or denormal at times, and need not survive.
const HASHES: &str = "\
fn word(low: f32, high: f32) -> u32 { return u32(low) | (u32(high) << 16u); }
fn probe(row: array<f32, 8>) -> array<f32, 13> {
    let v = vec4<u32>(word(row[0], row[1]), word(row[2], row[3]), word(row[4], row[5]), word(row[6], row[7]));
    let four = hash_pcg4d(v);
    var words = array<u32, 6>(hash_pcg(v.x), four.x, four.y, four.z, four.w, hash_mix(v.x, v.y, v.z));
    var out: array<f32, 13>;
    for (var i = 0u; i < 6u; i++) {
        out[2u * i] = f32(words[i] & 0xffffu);
        out[2u * i + 1u] = f32(words[i] >> 16u);
    }
    out[12] = hash_to_unit(v.w);
    return out;
}";

#[test]
fn hashes_are_bit_equal() {
    let ends = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7fc0_0001];
    let mut inputs: Vec<[u32; 4]> = (0..6 * 6 * 6 * 6).map(|k: usize| [0, 1, 2, 3].map(|i| ends[k / 6_usize.pow(i) % 6])).collect();
    // Neither of the two words of a row depends on the function under test alone: SplitMix64 (Steele et al. 2014).
    let mut state = 7_u64;
    let mut word = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        u32::try_from((z ^ (z >> 27)) >> 32).expect("32 bits")
    };
    inputs.extend((0..ROWS).map(|_| [word(), word(), word(), word()]));
    let halves = |w: u32| [w & 0xffff, w >> 16].map(|h| h as f32);
    let rows: Vec<f32> = inputs.iter().flat_map(|v| v.map(halves)).flatten().collect();
    let expected: Vec<f32> = inputs
        .iter()
        .flat_map(|&[a, b, c, d]| {
            let four = hash::pcg4d([a, b, c, d]);
            let words = [hash::pcg(a), four[0], four[1], four[2], four[3], hash::mix(a, b, c)];
            words.into_iter().flat_map(halves).chain([hash::to_unit::<f32>(d)]).collect::<Vec<_>>()
        })
        .collect();
    let run = |body: &str| gpu::probe::run(gpu(), body, &rows, 8, 13).unwrap_or_else(|e| panic!("{e}"));
    let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert!(bits(&run(HASHES)) == bits(&expected), "a hash of the GPU differs");
    // Negative controls: OR for XOR, twice; a constant one off; a hash added where it is chained; a rounding unit.
    for (from, to) in [
        ("h ^= h >>", "h |= h >>"),
        ("(word >> 22u) ^ word", "(word >> 22u) | word"),
        ("2891336453u", "2891336454u"),
        ("hash_pcg(level + hash_pcg(salt + hash_pcg(seed)))", "hash_pcg(level + salt + seed)"),
        ("h >> 8u) * 5.96", "h) * 2.3283064365386963e-10 + 0.0 * 5.96"),
    ] {
        assert!(bits(&run(&mutant(HASHES, "hash", from, to))) != bits(&expected), "`{to}` for `{from}` was not noticed");
    }
}

// ---------------------------------------------------------------- classification

/// A picture as the geometry pass would leave it.
struct Scenery {
    size: [u32; 2],
    mask: Vec<u8>,
    terrain: Vec<bool>,
}

impl Scenery {
    /// Random masks: tiles without terrain, with a pixel of it, and full; masks of single flavours, of any, and of none.
    fn random(size: [u32; 2], table: u32) -> Scenery {
        let columns = tiles(size)[0];
        let (mut mask, mut terrain) = (Vec::new(), Vec::new());
        for pixel in 0..size[0] * size[1] {
            let (x, y) = (pixel % size[0], pixel / size[0]);
            let mut tile = Draw { row: y / 8 * columns + x / 8, column: 0, table };
            let density = [0.0, 0.03, 0.5, 1.0][tile.whole(4) as usize];
            let any = tile.whole(32) as u8;
            let kind = tile.whole(3) as u8;
            let mut draw = Draw { row: pixel, column: 0, table: table + 1000 };
            terrain.push(draw.unit() < density);
            mask.push(match kind {
                0 => any,
                1 => 1 << draw.whole(5) as u8,
                _ => any & draw.whole(32) as u8,
            });
        }
        Scenery { size, mask, terrain }
    }

    fn upload(&self, gpu: &Gpu) -> geometry::Targets {
        let [width, height] = self.size;
        let texture = |label, format, aspect, texels: Option<&[u8]>| {
            let size = wgpu::Extent3d { width, height, depth_or_array_layers: 1 };
            let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
                label: Some(label),
                size,
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format,
                usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
                view_formats: &[],
            });
            if let Some(texels) = texels {
                gpu.queue.write_texture(
                    wgpu::TexelCopyTextureInfo { texture: &texture, mip_level: 0, origin: wgpu::Origin3d::ZERO, aspect },
                    texels,
                    wgpu::TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(width), rows_per_image: None },
                    size,
                );
            }
            texture
        };
        let stencil: Vec<u8> = self.terrain.iter().map(|&t| u8::from(t)).collect();
        geometry::Targets {
            depth_stencil: texture("depth and stencil", geometry::DEPTH_FORMAT, wgpu::TextureAspect::StencilOnly, Some(&stencil)),
            mask: texture("mask", wgpu::TextureFormat::R8Uint, wgpu::TextureAspect::All, Some(&self.mask)),
            normals: texture("normals", wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureAspect::All, None),
        }
    }

    fn classify(&self, gpu: &Gpu, pass: &Classification, layout: &wgpu::BindGroupLayout, forced: Option<u8>) -> Vec<Vec<u32>> {
        let mut uniforms = FrameUniforms::zeroed();
        uniforms.size = self.size;
        uniforms.tiles = tiles(self.size);
        uniforms.forced_mask = forced.map_or(0, u32::from);
        let buffer = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
        let frame = gpu.group("frame", layout, &[buffer.as_entire_binding()]);
        let (targets, lists) = (self.upload(gpu), Lists::new(gpu, self.size, classification::TILE));
        let mut encoder = gpu.encoder("classification");
        pass.encode(gpu, &mut encoder, &mut Timer::new(gpu), &frame, &targets, &lists);
        gpu.submit_and_wait(encoder).unwrap_or_else(|e| panic!("{e}"));
        lists.read(gpu).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Compares 32 lists, whose order is free, with the masks of the tiles.
    fn compare(&self, lists: &[Vec<u32>], masks: &[u8]) -> Result<(), String> {
        let columns = tiles(self.size)[0];
        let mut expected = vec![Vec::new(); 32];
        for (tile, &mask) in (0u32..).zip(masks) {
            if mask != 0 {
                let entry = (tile % columns) | (tile / columns) << 12 | u32::from(mask) << 24;
                expected[0].push(entry);
                expected[usize::from(mask)].push(entry);
            }
        }
        for (list, (got, want)) in lists.iter().zip(&mut expected).enumerate() {
            let mut got = got.clone();
            got.sort_unstable();
            want.sort_unstable();
            if got != *want {
                return Err(format!("{:?}, list {list}: {} tiles, {} expected, or others", self.size, got.len(), want.len()));
            }
        }
        if lists.len() == 32 { Ok(()) } else { Err(format!("{} lists", lists.len())) }
    }
}

/// Both paths of the pass against the reference. The subgroup path is the one taken where the adapter has subgroup operations.
#[test]
fn classification_agrees_on_both_paths() {
    let plain = Gpu::with(GpuOptions { plain: true }).unwrap_or_else(|e| panic!("a GPU is needed, or a software one: {e}"));
    assert!(!plain.features.contains(wgpu::Features::SUBGROUP));
    for (path, gpu) in [("the adapter's best", gpu()), ("plain", &plain)] {
        let layout = gpu.layout("frame", wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
        let pass = Classification::new(gpu, &layout, classification::TILE).unwrap_or_else(|e| panic!("{e}"));
        for (table, size) in (0..).zip([[150, 91], [64, 64], [1, 1], [7, 17], [8, 8], [1021, 9], [640, 361]]) {
            let scenery = Scenery::random(size, table);
            for forced in [None, Some(2), Some(31)] {
                let lists = scenery.classify(gpu, &pass, &layout, forced);
                let masks = tile_masks(size, &scenery.mask, &scenery.terrain, forced);
                scenery.compare(&lists, &masks).unwrap_or_else(|e| panic!("{path}, forced {forced:?}: {e}"));
            }
        }
    }
}

/// Classifies by other files than the stage's own: its layout, as `Classification` binds it.
fn classify_by(gpu: &Gpu, files: &[(&str, &str)], scenery: &Scenery) -> Vec<Vec<u32>> {
    let shader = gpu::Shader::new(gpu, "mutant", files).unwrap_or_else(|e| panic!("{e}"));
    let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some("mutant"),
        layout: None,
        module: &shader.module,
        entry_point: Some("classification_main"),
        compilation_options: Default::default(),
        cache: None,
    });
    let mut uniforms = FrameUniforms::zeroed();
    uniforms.size = scenery.size;
    uniforms.tiles = tiles(scenery.size);
    let buffer = gpu.buffer_with("frame", wgpu::BufferUsages::UNIFORM, bytes_of(&uniforms));
    let (targets, lists) = (scenery.upload(gpu), Lists::new(gpu, scenery.size, classification::TILE));
    let frame = gpu.group("frame", &pipeline.get_bind_group_layout(0), &[buffer.as_entire_binding()]);
    let group = gpu.group(
        "mutant",
        &pipeline.get_bind_group_layout(1),
        &[
            wgpu::BindingResource::TextureView(&view(&targets.mask)),
            wgpu::BindingResource::TextureView(&aspect(&targets.depth_stencil, wgpu::TextureAspect::StencilOnly)),
            lists.tiles.as_entire_binding(),
            lists.arguments.as_entire_binding(),
        ],
    );
    let mut encoder = gpu.encoder("mutant");
    {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &frame, &[]);
        pass.set_bind_group(1, &group, &[]);
        pass.dispatch_workgroups(uniforms.tiles[0], uniforms.tiles[1], 1);
    }
    gpu.submit_and_wait(encoder).unwrap_or_else(|e| panic!("{e}"));
    lists.read(gpu).unwrap_or_else(|e| panic!("{e}"))
}

/// Negative controls: passes that are wrong in one place.
#[test]
fn wrong_classification_is_noticed() {
    let scenery = Scenery::random([150, 91], 0);
    let masks = tile_masks(scenery.size, &scenery.mask, &scenery.terrain, None);
    for subgroups in [false, true] {
        if subgroups && !gpu().features.contains(wgpu::Features::SUBGROUP) {
            continue;
        }
        let run = |from: &str, to: &str| {
            let count: usize = classification::files(subgroups).iter().map(|(_, text)| text.matches(from).count()).sum();
            assert_eq!(count, 1, "`{from}` is not there once");
            let files: Vec<_> = classification::files(subgroups).iter().map(|(name, text)| (*name, text.replace(from, to))).collect();
            let files: Vec<_> = files.iter().map(|(name, text)| (*name, text.as_str())).collect();
            scenery.compare(&classify_by(gpu(), &files, &scenery), &masks)
        };
        run("fn classification_main", "fn classification_main").unwrap_or_else(|e| panic!("{e}"));
        // The largest mask instead of all; terrain not looked at; a neighbouring pixel; the list of all tiles not kept.
        let one = if subgroups { "subgroupOr(" } else { "atomicOr(" };
        let largest = if subgroups { "subgroupMax(" } else { "atomicMax(" };
        let mut mutants = vec![
            (one, largest),
            ("textureLoad(stencil_target, pixel, 0).r == 0u", "textureLoad(stencil_target, pixel, 0).r == 2u"),
            ("vec2<u32>(thread % TILE, thread / TILE)", "vec2<u32>(thread % TILE, thread / 4u)"),
            ("atomicAdd(&arguments[0].instance_count, 1u)", "atomicAdd(&arguments[0].instance_count, 0u)"),
        ];
        if subgroups {
            mutants.push(("if lane == 0u {", "if thread == 0u {"));
        }
        for (from, to) in mutants {
            // A subgroup may be as large as the workgroup: then its first lane is the workgroup's.
            let whole = from.starts_with("if lane") && gpu().info.subgroup_max_size >= 64;
            assert!(whole || run(from, to).is_err(), "subgroups {subgroups}: `{to}` for `{from}` was not noticed");
        }
    }
}

/// Negative controls of the comparison above, on lists that are as the reference wants them but for one thing.
#[test]
fn classification_comparison_notices_differences() {
    let scenery = Scenery::random([150, 91], 0);
    let masks = tile_masks(scenery.size, &scenery.mask, &scenery.terrain, None);
    assert!(masks.contains(&0) && masks.iter().collect::<BTreeSet<_>>().len() > 16, "the scenery is too plain");
    let layout = gpu().layout("frame", wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
    let pass = Classification::new(gpu(), &layout, classification::TILE).unwrap_or_else(|e| panic!("{e}"));
    let lists = scenery.classify(gpu(), &pass, &layout, None);
    scenery.compare(&lists, &masks).unwrap_or_else(|e| panic!("{e}"));
    let rejects = |what: &str, change: &dyn Fn(&mut Vec<Vec<u32>>)| {
        let mut changed = lists.clone();
        change(&mut changed);
        assert!(scenery.compare(&changed, &masks).is_err(), "{what}: not noticed");
    };
    let used = (1..32).find(|&i| !lists[i].is_empty()).expect("tiles");
    rejects("a tile lost", &|l| {
        l[used].pop();
    });
    rejects("a tile twice", &|l| l[0].push(lists[0][0]));
    rejects("a tile in the wrong list", &|l| {
        let tile = l[used].pop().expect("used");
        l[if used == 1 { 2 } else { 1 }].push(tile);
    });
    rejects("a mask with a bit too many", &|l| l[0][0] ^= 1 << 28);
    rejects("column and row exchanged", &|l| {
        for entry in &mut l[0] {
            *entry = (*entry & 0xff00_0000) | (*entry & 4095) << 12 | (*entry >> 12 & 4095);
        }
    });
    // References that are wrong: pixels without terrain counted, one mask of a tile instead of all, the picture's last column forgotten.
    let everywhere = vec![true; scenery.terrain.len()];
    assert!(scenery.compare(&lists, &tile_masks(scenery.size, &scenery.mask, &everywhere, None)).is_err());
    let only_first: Vec<bool> = scenery.terrain.iter().enumerate().map(|(i, &t)| t && i % 150 % 8 == 0 && i / 150 % 8 == 0).collect();
    assert!(scenery.compare(&lists, &tile_masks(scenery.size, &scenery.mask, &only_first, None)).is_err());
    let narrower: Vec<bool> = scenery.terrain.iter().enumerate().map(|(i, &t)| t && i % 150 != 149).collect();
    let others = tile_masks(scenery.size, &scenery.mask, &narrower, None);
    assert_ne!(others, masks, "the last column must matter");
    assert!(scenery.compare(&lists, &others).is_err());
}

// ---------------------------------------------------------------- shared functions that have no probe

/// A table of a shared function, compared as the probes are, with one tolerance a result.
struct Table {
    name: &'static str,
    columns: usize,
    wgsl: String,
    random: fn(&mut Draw) -> Vec<f64>,
    /// Truth and tolerance of each result.
    truth: fn(&[f64]) -> Vec<(f64, f64)>,
    mutants: &'static [(&'static str, &'static str, &'static str)],
}

const RULES: FlavourParams = FlavourParams {
    far_atlas_m: 300.0,
    cliff_far_atlas_m: 1500.0,
    cliff_near_m: 30.0,
    distance_blend: 0.15,
    cliff_cos: [0.682, 0.731],
    splat_cos: [0.777, 0.819],
    splat_enabled: 1,
    vt_enabled: 1,
    padding: [0; 2],
};

/// Every result takes at most 8 operations whose errors do not cancel: 16 ULP.
const FEW: f64 = 16.0 * EPS;

fn tables() -> Vec<Table> {
    vec![
        Table {
            name: "flavour weights",
            columns: 9,
            wgsl: format!(
                "fn probe(row: array<f32, 9>) -> array<f32, 11> {{
    let rules = FlavourParams({:?}, {:?}, {:?}, {:?}, vec2<f32>({:?}, {:?}), vec2<f32>({:?}, {:?}), 1u, 1u, vec2<u32>(0u));
    let w = flavour_weights(row[0], row[1], rules);
    let given = array<f32, 5>(row[2], row[3], row[4], row[5], row[6]);
    let held = flavour_weights_for(given, u32(row[7]), u32(row[8]));
    return array<f32, 11>(w[0], w[1], w[2], w[3], w[4], f32(flavour_mask(given)), held[0], held[1], held[2], held[3], held[4]);
}}",
                RULES.far_atlas_m,
                RULES.cliff_far_atlas_m,
                RULES.cliff_near_m,
                RULES.distance_blend,
                RULES.cliff_cos[0],
                RULES.cliff_cos[1],
                RULES.splat_cos[0],
                RULES.splat_cos[1],
            ),
            random: |d| {
                let weights = [0; 5].map(|_| if d.whole(3) < 0.5 { 0.0 } else { d.between(-12.0, 0.0).exp2() });
                [&[d.between(-1.0, 12.0).exp2(), d.between(0.4, 1.0)][..], &weights, &[d.whole(32), d.whole(2)]].concat()
            },
            truth: |row| {
                // A ramp is at least a 20th as wide as its place, and at most 1.5 steep: it magnifies 8 roundings by 30.
                let weights = flavour_weights::weights(row[0], row[1], &RULES).map(|w| (w, 256.0 * EPS));
                let given: [f64; 5] = std::array::from_fn(|i| row[2 + i]);
                let held = flavour_weights::weights_for(given, row[7] as u32, row[8] > 0.5).map(|w| (w, FEW));
                [&weights[..], &[(f64::from(flavour_weights::mask(given)), 0.25)], &held].concat()
            },
            mutants: &[
                ("flavour_weights", "t * t * (3.0 - 2.0 * t)", "t"),
                ("flavour_weights", "flavour_behind(d, params.cliff_near_m,", "flavour_behind(d, params.cliff_far_atlas_m,"),
                ("flavour_weights", "mask |= select(0u, 16u, weights[4] > FLAVOUR_MIN_WEIGHT);", ""),
                ("flavour_weights", "w[i] /= sum;", "w[i] /= max(sum, 1.0);"),
            ],
        },
        Table {
            name: "tiling",
            columns: 7,
            wgsl: "fn probe(row: array<f32, 7>) -> array<f32, 2> {
    let scales = tiling_scales(row[0], row[1], row[2]);
    let per_sector = bitcast<i32>((u32(row[4]) << 16u) | u32(row[5]));
    return array<f32, 2>(scales.x + scales.y, tiling_fixed(i32(row[3]), per_sector, u32(row[6])));
}"
            .to_owned(),
            random: |d| {
                let far = d.between(-3.0, 14.0).exp2();
                vec![far, 30.0, d.between(-0.1, 1.1), d.whole(320) - 160.0, d.whole(1 << 16), d.whole(1 << 16), d.whole(9)]
            },
            truth: |row| {
                let (scale, part) = tiling::scales(row[0], row[1], row[2]);
                let per_sector = ((row[4] as u32) << 16 | row[5] as u32).cast_signed();
                let fixed = tiling::fixed(row[3] as i32, per_sector, row[6] as u32);
                // Scale and blend as one number, which is continuous where the scale steps. The fixed-point coordinate is exact.
                vec![(f64::from(scale) + part, level_error(7.0, 4.0)), (fixed, 1e-9)]
            },
            mutants: &[
                ("tiling", "log2(ratio)", "log(ratio)"),
                ("tiling", "f32(repeat >> s)", "f32((repeat >> s) | 1u)"),
                ("tiling", "(0xffffffffu >> (8u - s))", "0x00ffffffu"),
            ],
        },
        Table {
            name: "reflection",
            columns: 6,
            wgsl: "fn probe(row: array<f32, 6>) -> array<f32, 5> {
    let alpha = brdf_alpha(row[1]);
    let f0 = vec3<f32>(row[4]);
    return array<f32, 5>(
        alpha,
        brdf_d_ggx(row[0], row[5]),
        brdf_v_smith_ggx_correlated(row[2], row[3], row[5]),
        brdf_f_schlick(f0, row[2]).x,
        brdf_env_approx(f0, row[1], row[2]).x,
    );
}"
            .to_owned(),
            random: |d| {
                let near_one = 1.0 - d.between(-20.0, 0.0).exp2();
                vec![near_one, d.unit(), d.between(-0.1, 1.0), d.unit(), d.unit(), d.between(-8.0, 0.0).exp2()]
            },
            truth: |row| {
                let f0 = [row[4]; 3];
                let (d, v) = (brdf::d_ggx(row[0], row[5]), brdf::v_smith_ggx_correlated(row[2], row[3], row[5]));
                vec![
                    (brdf::alpha(row[1]), FEW),
                    // Sums of positive terms and quotients: relative errors. The quotient is squared, the root takes 4.5 ULP twice.
                    (d, 2.0 * FEW * d),
                    (v, 2.0 * FEW * v),
                    (brdf::f_schlick(f0, row[2])[0], FEW),
                    // exp2 of -9.28 at most: 22 ULP.
                    (brdf::env_approx(f0, row[1], row[2])[0], 3.0 * FEW),
                ]
            },
            mutants: &[
                ("brdf", "(1.0 - c) * (1.0 + c) + c * c * a * a", "1.0 - c * c * (1.0 - a * a)"),
                ("brdf", "let lambda_l = v * sqrt(l * l", "let lambda_l = v * sqrt(v * v"),
                ("brdf", "(m2 * m2 * m)", "(m2 * m2)"),
                ("brdf", "-9.28", "-9.27"),
            ],
        },
    ]
}

#[test]
fn functions_without_probe_agree() {
    for (number, table) in (100..).zip(tables()) {
        let rows: Vec<f32> =
            (0..ROWS).flat_map(|row| (table.random)(&mut Draw { row, column: 0, table: number })).map(|x| x as f32).collect();
        let wide: Vec<f64> = rows.iter().copied().map(f64::from).collect();
        let truth: Vec<Vec<(f64, f64)>> = wide.chunks(table.columns).map(table.truth).collect();
        let results = truth[0].len();
        // The largest share of a tolerance that is used.
        let used = |body: &str| {
            let got = gpu::probe::run(gpu(), body, &rows, table.columns, results).unwrap_or_else(|e| panic!("{}: {e}", table.name));
            let shares = got.iter().zip(truth.iter().flatten()).map(|(&g, &(want, tolerance))| (f64::from(g) - want).abs() / tolerance);
            // NaN counts as infinitely far.
            shares.fold(0.0_f64, |most, share| {
                if share <= most {
                    most
                } else if share.is_nan() {
                    f64::INFINITY
                } else {
                    share
                }
            })
        };
        let share = used(&table.wgsl);
        println!("{}: {share:.4} of the tolerance used", table.name);
        assert!(share <= 1.0, "{}: {share} times the tolerance", table.name);
        for &(file, from, to) in table.mutants {
            assert!(used(&mutant(&table.wgsl, file, from, to)) > 1.0, "{}: `{to}` for `{from}` was not noticed", table.name);
        }
    }
}

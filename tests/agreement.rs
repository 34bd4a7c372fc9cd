//! Compares results of the GPU with the CPU references: for every probe, and for both paths of the classification pass (with subgroup operations and
//! without).
//!
//! A probe (`kernels::probe`) evaluates shared functions for a table of inputs, and defines which error of a result is accepted. WGSL lets a shader
//! assume that no number is NaN or infinite, so the inputs of most probes contain no such numbers. Only the culling probes receive them.
//!
//! Some results are discontinuous (an index, a code, a cell). If the inputs of a row lie within the tolerance of a threshold, the results of both
//! sides of the threshold are accepted. Rows with the result of the other side are counted, and each case limits their number. Each comparison must
//! accept the reference in f32, and must reject mutants of the shader, each of which has one deliberate fault.

use std::collections::BTreeSet;

use bytemuck::{Zeroable, bytes_of};
use glam::DVec3;
use kernels::base::wgsl::Piece;
use kernels::classification::{self, Classification, Lists, reference::tile_masks, tiles};
use kernels::geometry;
use kernels::gpu::bindings::{Binding, aspect, view};
use kernels::gpu::{self, Gpu, GpuOptions, Recording};
use kernels::probe::table::{self, Cells};
use kernels::probe::{Draw, EPS, PROBES, Probe, Verdict};
use kernels::shared::hash;
use kernels::shared::motion::{Past, reproject};
use kernels::shared::noise::BORDER;
use kernels::shared::splat_blend;
use kernels::view::FrameUniforms;
use kernels::view::camera::{Pose, View};

use crate::fixtures::{gpu, open};

/// Number of random rows of each probe.
const ROWS: u32 = 4096;

// ---------------------------------------------------------------- the comparator

/// How a probe is compared.
struct Case {
    probe: &'static str,
    /// Returns special rows, which are compared in addition to the random rows: values at the ends of their ranges, on thresholds, or with
    /// symmetries.
    extremes: fn() -> Vec<Vec<f64>>,
    /// Limit of the number of rows whose result belongs to the other side of a threshold.
    other_side_at_most: usize,
    /// Mutants of the shader: the file to change, the text to replace in it, and the replacement. The file is given by the name of a shared file, by
    /// a path in `kernels/src`, or as "" for the probe's own text.
    mutants: &'static [(&'static str, &'static str, &'static str)],
}

/// Returns copies of a row. In each copy, one of the given columns is NaN, infinite, denormal, near 1e-15 or 1e15 (the limits of the culling tests),
/// or far beyond these limits.
fn with_ends(plain: &[f64], columns: impl Iterator<Item = usize>) -> Vec<Vec<f64>> {
    let ends = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e-45, -1e-45, 0.9e-15, 1e-15, 1.1e-15, 0.9e15, 1e15, 1.1e15, -1e16, 3e38];
    let row = |column: usize, end: f64| {
        let mut row = plain.to_vec();
        row[column] = end;
        row
    };
    columns.flat_map(|column| ends.map(|end| row(column, end))).collect()
}

impl Case {
    fn probe(&self) -> &'static Probe {
        Probe::find(self.probe).unwrap_or_else(|e| panic!("{e}"))
    }

    fn rows(&self, table: u32) -> Vec<f64> {
        let random = (0..ROWS).map(|row| (self.probe().random)(&mut Draw { row, column: 0, table }));
        let rows: Vec<f64> = (self.extremes)().into_iter().chain(random).flatten().collect();
        let probe = self.probe();
        let rows = probe.rounded(&rows);
        for row in rows.chunks(probe.inputs.len()) {
            for (column, &x) in probe.inputs.iter().zip(row) {
                column.accepts(x).unwrap_or_else(|e| panic!("{}: {e}", self.probe));
            }
        }
        rows
    }

    /// Compares results with the truth, which is the reference in f64. Returns the largest error, as a share of its tolerance, and the number of rows
    /// whose result belongs to the other side of a threshold. Returns an error message if results differ by more than their tolerance, or if this
    /// number of rows exceeds its limit.
    fn compare(&self, rows: &[f64], got: &[f64]) -> Result<(f64, usize), String> {
        let probe = self.probe();
        let (columns, results) = (probe.inputs.len(), probe.outputs.len());
        let truth = probe.on_f64(rows);
        if got.len() != truth.len() {
            return Err(format!("{} results instead of {}", got.len(), truth.len()));
        }
        let (mut share, mut other_side, mut differing, mut first) = (0.0_f64, 0, 0, String::new());
        for ((row, got), want) in rows.chunks(columns).zip(got.chunks(results)).zip(truth.chunks(results)) {
            let verdict = if got.iter().all(|x| x.is_finite()) { (probe.judge)(row, got, want) } else { Verdict::Differs };
            match verdict {
                Verdict::Agrees(s) => share = share.max(s),
                Verdict::OtherSide => other_side += 1,
                Verdict::Differs => {
                    differing += 1;
                    if differing == 1 {
                        first = format!("row {row:?} gives {got:?}, the truth is {want:?}");
                    }
                }
            }
        }
        if differing > 0 {
            return Err(format!("{}: {differing} of {} rows differ; the first: {first}", self.probe, rows.len() / columns));
        }
        if other_side > self.other_side_at_most {
            let most = self.other_side_at_most;
            return Err(format!("{}: {other_side} rows are on the other side of a threshold; the limit is {most}", self.probe));
        }
        Ok((share, other_side))
    }
}

// ---------------------------------------------------------------- the probes

/// Special vectors: too short to have a direction, very short or very long, along an axis, one step of f32 off an axis, and along a diagonal. The
/// octahedral code of a direction along an axis is exact in any precision. "One step of f32" means a change by [`EPS`], the step of f32 at 1.
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

const CASES: &[Case] = &[
    Case {
        probe: "octahedral",
        extremes: || directions().into_iter().map(|n| n.to_vec()).collect(),
        // Limit of rows in which two octahedral codes are almost equally near to the direction, so that the GPU may choose the other one. The error
        // of a direction is 16 ULP (2^-19). The distance between neighbouring codes is 2^-7, which is 2^12 times larger. So about 1 of the 4096
        // random rows is expected. The limit leaves room for 20 special rows in symmetric directions (8 diagonals, and 6 directions one step of f32
        // off an axis), to which several codes may be equally near.
        other_side_at_most: 4 + 20,
        mutants: &[
            ("octahedral", "(vec2<f32>(1.0) - abs(flat.yx)) * octahedral_sign(flat)", "vec2<f32>(1.0) - abs(flat.yx)"),
            // This mutant rounds each coordinate to the nearest code. The shader chooses the code that decodes to the nearest direction.
            ("", "octahedral_encode8_precise(n)", "octahedral_quantise8(e)"),
            ("octahedral", "if error < best_error", "if i == 0u"),
            ("octahedral", "return v / sqrt(dot(v, v));", "return v;"),
        ],
    },
    Case {
        probe: "octahedral-codes",
        extremes: || directions().into_iter().flat_map(|n| [2.0, 8.0, 12.0, 16.0].map(|bits| [&n[..], &[bits]].concat())).collect(),
        // Limit of rows in which two octahedral codes are almost equally near, so that the GPU may choose the other one. The error of a coordinate is
        // 16 ULP (2^-19). With 16 bits, the distance between neighbouring codes is 2^-15, which is 16 times the error. So a coordinate lies within
        // the error of the middle between two codes with a probability of 1/8. A quarter of the 4096 random rows has 16 bits. Of these 1024 rows, 128
        // are expected for each of the two separately rounded coordinates, and about 256 for the code of the nearest direction. Rows with 12 bits add
        // a sixteenth of this sum.
        other_side_at_most: 600,
        mutants: &[
            // Mutants, in this order: coordinates are rounded down instead of to the nearest code; the number of steps is wrong; each coordinate is
            // rounded to the nearest code instead of choosing the code of the nearest direction; the first of the four codes around the direction is
            // chosen instead of the best.
            ("octahedral", "round(usable_2(e) * half)", "floor(usable_2(e) * half)"),
            ("", "- 1u)) - 1u)", "- 1u)) - 2u)"),
            ("", "octahedral_encode_precise(n, half, step)", "fast"),
            ("octahedral", "if error < best_error", "if i == 0u"),
        ],
    },
    Case {
        probe: "normal-pair",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for ray in [[0.0; 3], [0.0, 1.0, 0.0], [-3e3, 0.0, 0.0], [0.1, 0.2, -0.3], n] {
                    for shading in [n, [0.0, 0.0, 1.0], [0.0, -1.0, -1.0]] {
                        rows.push([n, ray, shading].concat());
                    }
                }
            }
            rows
        },
        // Limit of rows in which two points of the fine lattice are almost equally near to the plane's normal, so that the GPU may choose the other
        // one. The encoding rounds the normal to such a point (see `kernels::shared::normal_pair`). The error of a direction is 16 ULP (2^-19). The
        // distance between neighbouring points is 2^-10, which is 2^9 times larger. So 8 of the 4096 random rows are expected. Special rows have
        // symmetric normals (8 diagonals, and 6 normals one step of f32 off an axis), to which several points may be equally near. There are 14 x 15
        // of them, so the limit leaves room for 300.
        other_side_at_most: 24 + 300,
        mutants: &[
            // Mutants, in this order: the predicted code of the shading normal is rounded down; the decoder assumes a different range of differences
            // from the prediction than the encoder; two lattice points share an index; a plane is rounded to the fine lattice instead of the coarse
            // (plain) one; the ray may see the stored plane from behind; the plane's normal may have z < 0; the first lattice point around the normal
            // is chosen instead of the nearest; a vector is not normalised.
            ("normal_pair", "(p + NORMAL_PAIR_FINE + 4) >>", "(p + NORMAL_PAIR_FINE) >>"),
            ("normal_pair", "(low - predicted + 16)", "(low - predicted)"),
            ("normal_pair", "* (2 * half + 1) + (p.x", "* (2 * half) + (p.x"),
            ("normal_pair", "normal_pair_nearest(upper, seen, NORMAL_PAIR_PLAIN)", "normal_pair_nearest(upper, seen, NORMAL_PAIR_FINE)"),
            ("normal_pair", "dot(decoded, ray) * along <= 0.0", "false"),
            ("normal_pair", "select(n, -n, n.z < 0.0)", "n"),
            ("normal_pair", "if error < best_error", "if i == 0"),
            ("normal_pair", "return v / sqrt(dot(v, v));", "return v;"),
        ],
    },
    Case {
        probe: "hashed-alpha",
        extremes: || {
            let mut rows = Vec::new();
            for kind in [0.0, 1.0] {
                for sector in [[0.0, 0.0], [16_777_216.0, -16_777_216.0]] {
                    for position in [[0.0, 0.0, 0.0], [31.999_998, 1e-3, 8848.0], [0.0, 0.0, -1e9], [1e20, -1e20, 9e29]] {
                        // Footprints of a pixel, m: zero; below and above the range of noise scales; powers of two, for which the level of the noise
                        // (log2 of cells per metre) is a whole number; and one other.
                        for [x, y] in [[0.0, 0.0], [1e-9, 1e-9], [1e9, 1e12], [0.25, 0.125], [1.0, 1.0], [32.0, 4.0], [0.03, 3.0]] {
                            for seed in [0.0, 4_294_967_295.0] {
                                let row = [&[kind][..], &sector, &position, &[32.0, x, 0.0, 0.0, 0.0, y, 0.0, 1.0, seed, seed]];
                                rows.push(row.concat());
                            }
                        }
                    }
                }
                // Horizontal ground at critical elevations, and at the f32 values next below and next above each of them. They are: a third of a
                // metre, which is a border between cells; √2 times powers of two, at which the finest scale changes; and the power of two 1024, at
                // which it must not change.
                let root = std::f32::consts::SQRT_2.next_up();
                for border in [BORDER as f32, root, 512.0 * root, -512.0 * root, 1024.0] {
                    for z in [border.next_down(), border, border.next_up()] {
                        for sector_m in [32.0, 64.0, 16_384.0] {
                            for footprint in [0.0, 1e-4, 0.01, 1.0] {
                                let place = [3.0, -4.0, 31.7, 0.3, f64::from(z), sector_m];
                                let step = [footprint, 0.0, 0.0, 0.0, 3.0 * footprint, 0.0, 1.0, 7.0, 9.0];
                                rows.push([&[kind][..], &place, &step].concat());
                            }
                        }
                    }
                }
            }
            rows
        },
        // Limit of rows in which the level of an axis (log2 of cells per metre) lies within the rounding error of a whole number. There, rounding
        // decides which cell is hashed. The error is below 1e-5. Half of the 4096 random rows are anisotropic noise, which has three levels, so about
        // 0.1 such rows are expected.
        other_side_at_most: 4,
        mutants: &[
            // Mutant: after two scales are blended, the first threshold is not made uniform again.
            ("noise", "noise_correct(x.x, lerp_factor)", "x.x"),
            // Mutant: the coarse scale is blended with itself.
            ("noise", "return noise_blend(coarse, fine, level - lower);", "return noise_blend(coarse, coarse, level - lower);"),
            // Mutant: the seed is hashed without the salt.
            ("noise", "hash_mix(seed, salt, level)", "hash_mix(seed, seed, level)"),
            // Mutant: a sector has one cell too few.
            ("noise", "bitcast<u32>(sector) * cells_per_sector +", "bitcast<u32>(sector) * (cells_per_sector - 1u) +"),
            // Mutant: an axis along which the position does not change has the smallest cells.
            ("noise", "max(width, vec3<f32>(NOISE_LEAST_SHARE * max(width.x, max(width.y, width.z))))", "width"),
            // Mutant: along the elevation, cells may be narrower than the distance between neighbouring f32 values.
            ("noise", "vec3<i32>(across, across, noise_finest_along(usable_1(elevation)))", "vec3<i32>(across)"),
            // Mutant: along east and north, cells may be narrower than the distance between neighbouring f32 values.
            ("noise", "let across = noise_finest_along(usable_positive_1(sector_m, 1e12));", "let across = i32(NOISE_LEVEL_MAX);"),
            // Mutant: along the elevation, borders between cells lie exactly at multiples of the height of a cell.
            ("noise", "scaled - floor(scaled) >= NOISE_BORDER", "false"),
            // Mutant: the finest scale changes exactly at powers of two.
            ("noise", "(bits & 0x7fffffu) >= NOISE_OCTAVE_BORDER", "false"),
        ],
    },
    Case {
        probe: "noise",
        extremes: || {
            let mut rows = Vec::new();
            for kind in [2.0, 3.0, 4.0, 5.0, 6.0] {
                let border = [2.0, -3.0, 31.7, 0.3, BORDER];
                let below = [2.0, -3.0, 31.7, 0.3, f64::from((BORDER as f32).next_down())];
                let far = [[16_777_216.0, -16_777_216.0, 31.999_998, 1e-3, 8848.0], [1.0, -1.0, 1e20, -1e20, -9e29]];
                for place in [[0.0; 5], far[0], far[1], border, below] {
                    for level in [0.0, -5.0, 16.0, 17.0, -16_777_216.0, 16_777_216.0] {
                        for [pixel, word] in
                            [[0.0, 0.0], [63.0, 15.0], [64.0, 16.0], [16_777_216.0, 36_288_000.0], [16_777_216.0, 4_294_967_295.0]]
                        {
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
        other_side_at_most: 0,
        mutants: &[
            // Mutants of interleaved gradient noise, in this order: the high word of a product lacks one of its parts; x and y are not exchanged for
            // the last two of a pixel's four thresholds; the thresholds have no random offset; the pattern does not move from frame to frame.
            ("noise", "+ (other >> 16u)", ""),
            ("noise", "select(shifted, shifted.yx, decision >= 2u)", "shifted"),
            ("noise", "noise_interleaved_gradient_value(turned, frame) + h.z", "noise_interleaved_gradient_value(turned, frame)"),
            ("noise", "+ frame * NOISE_IGN_FRAME", ""),
            // Mutants of the blue-noise masks, in this order: the slices of the spatio-temporal mask repeat after 15 frames; the static mask is used
            // as the first slice of the spatio-temporal one; rows and columns are exchanged; the four thresholds of a pixel use the same shift of the
            // mask; no jitter is added to the rank; the jitter of the static mask changes in every frame; ranks are not clamped to the last one.
            ("noise", "frame % NOISE_MASK_SLICES", "frame % 15u"),
            ("noise", "1u + frame % NOISE_MASK_SLICES", "frame % NOISE_MASK_SLICES"),
            ("noise", "shifted.y * NOISE_MASK_EDGE + shifted.x", "shifted.x * NOISE_MASK_EDGE + shifted.y"),
            ("noise", "vec4<u32>(seed, salt, decision, NOISE_MASK_EDGE)", "vec4<u32>(seed, salt, 0u, NOISE_MASK_EDGE)"),
            ("noise", "(jitter >> vec4<u32>(12u))", "vec4<u32>(0u)"),
            ("noise", "select(0u, frame, kind == NOISE_SPATIO_TEMPORAL_BLUE)", "frame"),
            ("noise", "min(ranks, vec4<u32>(NOISE_MASK_RANKS - 1u))", "ranks"),
            // Mutants of the noises `world` and `white`, in this order: the cells of the next finer level are hashed; the level is not clamped; cells
            // may be smaller than the distance between neighbouring f32 values at the position; along the elevation, borders between cells lie at
            // multiples of the cell's height; `white` noise does not change from frame to frame.
            ("noise", "vec3<i32>(k), seed, salt);\n}\n\n// The high", "vec3<i32>(k + 1), seed, salt);\n}\n\n// The high"),
            ("noise", "let k = clamp(level, i32(NOISE_LEVEL_MIN), noise_finest_of_all(sector_m, position.z));", "let k = level;"),
            ("noise", "i32(NOISE_LEVEL_MIN), noise_finest_of_all(sector_m, position.z)", "i32(NOISE_LEVEL_MIN), i32(NOISE_LEVEL_MAX)"),
            ("noise", "scaled - floor(scaled) >= NOISE_BORDER", "false"),
            ("noise", "vec4<u32>(pixel, frame, hash_mix(seed, salt, 0u))", "vec4<u32>(pixel, 0u, hash_mix(seed, salt, 0u))"),
        ],
    },
    Case {
        probe: "derivatives",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for t in [0.0, 0.1, 20_000.0] {
                    rows.push([&[0.3, 0.9, -0.2, 0.0009, 0.0, 0.0, t][..], &n].concat());
                    rows.push([&[0.0, 1.0, 0.0, 0.0, -0.0002, -0.0009, t][..], &n].concat());
                }
                // A step of zero, and a step about as long as the ray.
                rows.push([&[0.3, 0.9, -0.2, 0.0, 0.0, 0.0, 10.0][..], &n].concat());
                rows.push([&[0.3, 0.9, -0.2, 0.9, -0.3, 0.1, 10.0][..], &n].concat());
                // Rays of very different lengths: the squares of the shortest are denormal in f32, and the squares of the longest do not fit f32.
                for size in [1e-20, 1e-15, 1e15, 1e20, 1e30, 3e38] {
                    let ray = [0.3, 0.9, -0.2, 0.0009, 0.0, 0.0].map(|x: f64| x * size);
                    rows.push([&ray[..], &[1.0 / size], &n].concat());
                }
            }
            rows
        },
        // Limit for rows whose ray is so nearly parallel to the plane that rounding decides which side of the plane it sees. A share of about 2^-19
        // of the random rows is expected. Some special rows are also expected: those in which both the ray and the normal lie along axes.
        other_side_at_most: 16,
        mutants: &[
            // Mutants, in this order: one coordinate of the step is used twice; the pixel's own ray is used instead of the neighbour's; the cosine
            // has no lower limit at grazing angles; the normal is not normalised, which changes only the effect of that limit; the length of the
            // neighbour's ray has no upper limit.
            ("", "vec3<f32>(row[3], row[4], row[5])", "vec3<f32>(row[3], row[3], row[5])"),
            ("derivatives", "ray_step - neighbour *", "ray_step - ray *"),
            ("derivatives", "max(side * dot(n, neighbour), limit)", "(side * dot(n, neighbour))"),
            ("derivatives", "octahedral_unit(normal)", "normal"),
            ("derivatives", "usable_within_3(neighbour, 1e18) && ", ""),
        ],
    },
    Case {
        probe: "splat-blend",
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
        other_side_at_most: 0,
        mutants: &[
            ("splat_blend", "return bent / (bent.x + bent.y + bent.z + bent.w);", "return bent;"),
            ("splat_blend", "f.x * g.y, g.x * f.y,", "g.x * f.y, f.x * g.y,"),
            ("splat_blend", "exp2(exponent)", "exp(exponent)"),
            ("splat_blend", "usable_positive_1(sharpness, SPLAT_BLEND_MAX_SHARPNESS)", "usable_positive_1(sharpness, 64.0)"),
            // The next two mutants change the code that accumulates the weights term by term. The first does not scale down the previous sum when a
            // new term is the largest. The second always treats the first term as the largest.
            ("splat_blend", "(run.weight / w) * exp2(min(k * (run.height - h), 120.0)), 1.0", "1.0, 1.0"),
            ("splat_blend", "if score > run.score {", "if run.weight <= 0.0 {"),
        ],
    },
    Case {
        probe: "tri-planar",
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
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: weights are not normalised; 0 to the power of 0 gives 0 instead of 1; a height gradient points along the wrong
            // axis; the normal is bent in the opposite direction; the normal is bent by the whole gradient instead of the gradient's part along the
            // surface.
            ("triplanar", "return w / (w.x + w.y + w.z);", "return w;"),
            ("triplanar", "select(0.0, 1.0, sharpness <= 0.0)", "0.0"),
            ("triplanar", "return vec3<f32>(g.x, 0.0, g.y);", "return vec3<f32>(g.x, g.y, 0.0);"),
            ("triplanar", "unit - (g -", "unit + (g -"),
            ("triplanar", "(g - unit * dot(unit, g))", "g"),
        ],
    },
    Case {
        probe: "select",
        extremes: || {
            let mut rows = Vec::new();
            for bits in 0..16 {
                for u in [0.0, 0.25, 0.5, 0.75, 1.0 - 0.5 * EPS, 1.0, -1.0, 2.0] {
                    for size in [1.0, 1e-20, 1e29] {
                        // Sums of one, two or four equal weights are exact, so several of the values of u lie exactly on a threshold.
                        rows.push((0..4).map(|i| if bits >> i & 1 == 0 { 0.0 } else { size }).chain([u]).collect());
                        rows.push((0..4).map(|i| if bits >> i & 1 == 0 { -size } else { size }).chain([u]).collect());
                    }
                }
            }
            rows
        },
        // Limit of rows in which u lies within rounding of a threshold between two indices. For a random row, the probability is about 6 * 2^-23, so
        // none of the 4096 is expected. Special rows with u = 3/4 and four equal weights are expected, because the sum of three of the weights is
        // rounded.
        other_side_at_most: 8,
        mutants: &[
            // Mutants, in this order: index 0 is chosen although its weight is 0; the first threshold is used in place of the second; the last index
            // is chosen although its weight is 0; negative weights are not treated as 0.
            ("select", "if target_sum < below_1 {", "if target_sum <= below_1 {"),
            ("select", "if target_sum < below_2 {", "if target_sum < below_1 {"),
            ("select", "if w.w > 0.0 {", "if w.w >= 0.0 {"),
            ("select", "usable_positive_4(weights, SELECT_MAX_WEIGHT)", "weights"),
        ],
    },
    Case {
        probe: "biplanar",
        extremes: || {
            let mut rows = Vec::new();
            for n in directions() {
                for k in [0.0, 4.0, 8.0, 1e4, 1e9, -1.0] {
                    rows.push([&n[..], &[k]].concat());
                }
            }
            // Rows around the normals at which the second projection changes: two components are equal, and the third is below or above them.
            for third in [0.0, 0.5, 1.0 - EPS, 1.0 + EPS, 2.0] {
                rows.push(vec![1.0, 1.0, third, 8.0]);
                rows.push(vec![third, -1.0, 1.0, 4.0]);
                rows.push(vec![1.0, third, -1.0, 2.0]);
            }
            rows
        },
        // Limit for special rows: the 8 diagonals with 6 sharpnesses each, 6 rows one step of f32 off a diagonal, and some rows in which two
        // components are equal and both have weight 0, so that either of their axes may be returned.
        other_side_at_most: 80,
        mutants: &[
            // Mutants, in this order: the third projection is dropped while its weight is above 0, which gives a seam; weights are not normalised;
            // the exponent is wrong; the wrong axis is left out.
            ("biplanar", "max(kept - BIPLANAR_DIAGONAL, vec2<f32>(0.0))", "kept"),
            ("biplanar", "w / (w.x + w.y)", "w"),
            ("biplanar", "0.125 * usable_positive_1", "usable_positive_1"),
            ("biplanar", "a.x <= a.y && a.x <= a.z", "a.x <= a.y"),
        ],
    },
    Case {
        probe: "hex-tiling",
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
        // Limit of two kinds of rows. In the first kind, the point lies within the error of a border between two cells of the lattice. There, one
        // hexagon replaces another, and both have weight 0. In the second kind, the number of hexagons per sector changes to the next power of two.
        // The expected rows are some random rows, and the special rows at or next to a corner of a cell.
        other_side_at_most: 32,
        mutants: &[
            // Mutants, in this order: weights are not sharpened; the lattice has a seam at sector borders; all hexagons of a column have the same
            // texture offset; weights are not normalised; the weights in the upper triangle of a cell are wrong.
            ("hex_tiling", "return square * square * square * w;", "return w;"),
            ("hex_tiling", "(s.x << (HEX_TILING_SKEW_BITS + step)) - skewed_y", "(s.x << (HEX_TILING_SKEW_BITS + step))"),
            ("hex_tiling", "vec4<u32>(id, salt, 0u)", "vec4<u32>(id.xx, salt, 0u)"),
            ("hex_tiling", "sharp / (sharp.x + sharp.y + sharp.z)", "sharp"),
            ("hex_tiling", "vec3<f32>(f.x + f.y - 1.0, 1.0 - f.y, 1.0 - f.x)", "vec3<f32>(f.x + f.y - 1.0, 1.0 - f.x, 1.0 - f.y)"),
        ],
    },
    Case {
        probe: "texel-choice",
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
        // Limit of rows in which the random number u lies within rounding of the threshold between two texels. The threshold comes from a position of
        // some hundred texels, so its error is some hundred times 2^-23, and fewer than 1 of the 4096 random rows is expected. The limit leaves room
        // for special rows: a texture of 3 texels, and a coordinate just below a whole repeat, whose product with the size is rounded.
        other_side_at_most: 24,
        mutants: &[
            // Mutants, in this order: the level of detail is always rounded down; the nearest texel is always chosen; texel corners are used in place
            // of texel centres; the texture does not repeat; the farther of the two texels gets the larger probability.
            ("texel_choice", "select(0.0, 1.0, u < l - below)", "0.0"),
            ("texel_choice", "select(0.0, 1.0, u < x - below)", "select(0.0, 1.0, 0.5 < x - below)"),
            ("texel_choice", "* texels - 0.5", "* texels"),
            ("texel_choice", "texels - 1.0, texel < 0.0", "0.0, texel < 0.0"),
            ("texel_choice", "u < x - below", "u >= x - below"),
        ],
    },
    Case {
        probe: "layers",
        extremes: || {
            let mut rows = Vec::new();
            for fraction in [[0.0, 0.0], [1.0, 0.0], [0.5, 1.0], [1e-20, 1.0 - EPS], [0.5, 0.5]] {
                for layers in [[0.0; 4], [7.0; 4], [7.0, 6.0, 1.0, 0.0], [0.0, 1.0, 6.0, 7.0], [3.0, 3.0, 5.0, 5.0]] {
                    rows.push([&splat_blend::bilinear(fraction)[..], &layers].concat());
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: a layer's share of the four texels is used as its opacity; layer 0 is not opaque; the share of a layer includes
            // the layers above it; one of the four texels is left out.
            ("layers", "m.x / max(m.x + m.y, 1e-30)", "m.x"),
            ("layers", "1.0, layer == 0u", "m.x, layer == 0u"),
            ("layers", "layers == vec4<u32>(layer)", "layers >= vec4<u32>(layer)"),
            ("layers", "vec4<f32>(1.0));", "vec4<f32>(1.0, 1.0, 1.0, 0.0));"),
        ],
    },
    Case {
        probe: "snapped-projection",
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
        // Limit for special rows: vertical directions, whose x and y are 0, and directions whose z equals the given cosine, which is the threshold
        // between gentle and steep slopes.
        other_side_at_most: 100,
        mutants: &[
            // Mutants, in this order: the two diagonal planes are exchanged; the sector coordinate of a diagonal plane has the wrong sign; the number
            // of repeats per sector loses its low 8 bits; steep and gentle slopes are exchanged; the border between two planes lies at 45 degrees
            // instead of 22.5; a gradient has the wrong sign.
            ("snapped_projection", "(u.x > 0.0) == (u.y > 0.0)", "(u.x > 0.0) != (u.y > 0.0)"),
            ("snapped_projection", "place.y - place.x", "place.x - place.y"),
            ("snapped_projection", "(((per_sector_fixed & 255) * SNAPPED_DIAGONAL) >> 8u)", "0"),
            ("snapped_projection", "a.z >= cosine", "a.z < cosine"),
            ("snapped_projection", "a.y <= SNAPPED_HALF_STEP * a.x", "a.y <= a.x"),
            ("snapped_projection", "vec3<f32>(-along, along, g.y)", "vec3<f32>(along, along, g.y)"),
        ],
    },
    Case {
        probe: "hash",
        extremes: || {
            let ends = [0, 1, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff_u32, 0x7fc0_0001];
            let words = (0..6 * 6 * 6 * 6).map(|k: usize| [0, 1, 2, 3].map(|i| ends[k / 6_usize.pow(i) % 6]));
            words.map(|v| v.map(f64::from).to_vec()).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: OR replaces XOR, in each of the two hash functions; a constant is off by one; level, salt and seed are added
            // instead of hashed in turn; all 32 bits are converted to f32 instead of the upper 24, so the result is rounded.
            ("hash", "h ^= h >>", "h |= h >>"),
            ("hash", "(word >> 22u) ^ word", "(word >> 22u) | word"),
            ("hash", "2891336453u", "2891336454u"),
            ("hash", "hash_pcg(level + hash_pcg(salt + hash_pcg(seed)))", "hash_pcg(level + salt + seed)"),
            ("hash", "h >> 8u) * 5.96", "h) * 2.3283064365386963e-10 + 0.0 * 5.96"),
        ],
    },
    Case {
        probe: "flavour-weights",
        extremes: || {
            let mut rows = Vec::new();
            for distance in [0.0, 30.0, 300.0, 1500.0, 1e9] {
                for normal_z in [-1.0, 0.0, 0.682, 0.731, 0.777, 0.819, 1.0] {
                    for given in [0.0, 1.0] {
                        rows.push(vec![distance, normal_z, given, 0.0, given, 1.0, given, 21.0, given]);
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("flavour_weights", "t * t * (3.0 - 2.0 * t)", "t"),
            ("flavour_weights", "flavour_behind(d, params.cliff_near_m,", "flavour_behind(d, params.cliff_far_atlas_m,"),
            ("flavour_weights", "mask |= select(0u, 16u, weights[4] > FLAVOUR_MIN_WEIGHT);", ""),
            ("flavour_weights", "w[i] /= sum;", "w[i] /= max(sum, 1.0);"),
        ],
    },
    Case {
        probe: "frustum",
        extremes: || {
            let mut rows = Vec::new();
            for n in [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [0.6, 0.0, -0.8], [0.0; 3]] {
                for w in [-1.0, 0.0, 1.0, 1e6] {
                    for (low, high) in [([0.0; 3], [0.0; 3]), ([-1.0; 3], [1.0; 3]), ([-1e7, 0.0, -500.0], [1e7, 64.0, 3000.0])] {
                        rows.push([&n[..], &[w], &low, &high].concat());
                    }
                }
            }
            // Copies of two rows in which one number is NaN, infinite or near a limit. In one row the box lies beyond the plane, in the other it does
            // not.
            for w in [-5.0, 5.0] {
                rows.extend(with_ends(&[0.6, 0.0, -0.8, w, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0], 0..10));
            }
            rows
        },
        // Limit of boxes that lie beyond the plane by less than the margin of the test, so that they may be culled or kept. Let r be the distance of
        // the box from the plane, divided by its distance from the origin. In half of the random rows, r is 2^-24 to 1, with equally many rows in
        // each octave. The margin is an r of 2^-21 to 2^-20, so an eighth of these rows lies within it. Half of them lie on the visible side of the
        // plane, where a box must always be kept.
        other_side_at_most: 400,
        mutants: &[
            // Mutants, in this order: the opposite corner of the box is tested; the plane passes through the origin; the margin is applied to the
            // wrong side.
            ("culling", "select(low, high,", "select(high, low,"),
            ("culling", "+ plane.w < -(", "< -("),
            ("culling", "-(CULLING_SLACK * size + CULLING_FLUSHED)", "CULLING_SLACK * size"),
            // This mutant does not check whether the numbers of box and plane are finite and below the limit of the test.
            ("culling", "return known && terms.x", "return terms.x"),
        ],
    },
    Case {
        probe: "normal-cone",
        extremes: || {
            let mut rows = Vec::new();
            for axis in directions() {
                for sine in [0.0, 0.5, 1.0 - 0.5 * EPS, 1.0] {
                    for [far, radius] in [[1.0, 0.0], [1.0, 0.5], [100.0, 100.0], [1e6, 1.0]] {
                        rows.push([&axis[..], &[sine, 0.0, 0.6 * far, -0.8 * far, radius]].concat());
                    }
                }
            }
            // Copies of two rows in which one number is NaN, infinite or near a limit. In one row the patch faces away, in the other it does not.
            for z in [-100.0, 100.0] {
                rows.extend(with_ends(&[0.0, 0.0, -1.0, 0.5, 0.0, 0.0, z, 1.0], 0..8));
            }
            rows
        },
        // Limit of patches that face away by less than the margin of the test, so that they may be culled or kept. The test compares the angle
        // between the axis of the cone and the direction to the patch with a threshold. In half of the random rows, the two differ by 2^-24 to 1
        // radians, with equally many rows in each octave. The margin applies to the cosine of the angle. If the sine of the angle is small, a small
        // change of the cosine is a large change of the angle, so many rows lie within the margin.
        other_side_at_most: 900,
        mutants: &[
            // Mutants, in this order: the radius of the bounding sphere is ignored; the angle of the cone is ignored; the larger of the two angles is
            // used instead of their sum; the sum of the angles may exceed a right angle; the margin is applied to the wrong side.
            ("culling", "radius / distance);", "0.0);"),
            ("culling", "vec2<f32>(sin_half_angle, radius", "vec2<f32>(0.0, radius"),
            ("culling", "sines.x * cosines.y + cosines.x * sines.y + CULLING_ROUNDING", "max(sines.x, sines.y)"),
            ("culling", "cosines.x * cosines.y - sines.x * sines.y <= CULLING_ROUNDING", "false"),
            ("culling", "cosines.x * sines.y + CULLING_ROUNDING", "cosines.x * sines.y - 0.01"),
            // This mutant does not check whether the vector to the patch is finite and below the limit of the test.
            ("culling", "usable_within_3(to_patch, CULLING_MOST)", "true"),
        ],
    },
    Case {
        probe: "occlusion",
        extremes: || {
            let mut rows = Vec::new();
            // Cameras, in this order: a camera that looks along y; a camera that looks along -z, with a field of view of 1 degree horizontally and
            // 175 degrees vertically; a camera so far from the origin that distances have few correct digits in f32; a matrix of zeros, for which all
            // distances are 0.
            let cameras = [
                [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
                [[114.6, 0.0, 0.0, 0.0], [0.0, 0.0437, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]],
                [[1.0, 0.0, 0.0, -5e6], [0.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, -1e6]],
                [[0.0; 4]; 3],
            ];
            for camera in cameras {
                for near in [1e-7, 1e-3, 0.1, 1e6] {
                    for (low, high) in [
                        ([0.0; 3], [0.0; 3]),
                        ([-1.0; 3], [1.0; 3]),
                        ([-0.5, 0.1, -0.5], [0.5, 0.1, 0.5]),
                        ([-0.5, 1e6, -0.5], [0.5, 1e6 + 1.0, 0.5]),
                        ([-1e7, 64.0, -500.0], [1e7, 128.0, 3000.0]),
                        ([5.0, 5.0, -20.0], [-5.0, 6.0, -10.0]),
                    ] {
                        for size in [[1.0, 1.0], [1.0, 8192.0], [1920.0, 1080.0]] {
                            for stored in [0.0, 1e-6, near / 10.0, 1.0] {
                                rows.push([&camera.concat()[..], &[near], &low, &high, &size, &[stored; 4]].concat());
                            }
                        }
                    }
                }
            }
            // Copies of one row in which one number is NaN, infinite or near a limit. In that row, the box is in front of the camera and hidden.
            let plain = [&cameras[0].concat()[..], &[0.1], &[-1.0, 5.0, -1.0], &[1.0, 6.0, 1.0], &[16_384.0, 16_384.0], &[0.5; 4]].concat();
            rows.extend(with_ends(&plain, (0..19).chain(21..25)));
            // A box far outside the picture, whose screen position has few correct digits in f32.
            rows.push(
                [
                    &cameras[2].concat()[..8],
                    &[0.0, 1.0, 0.0, 0.0],
                    &[0.1],
                    &[5_000_100.0, 1.0, 0.0],
                    &[5_000_100.0, 1.0, 0.0],
                    &[100.0; 2],
                    &[1.0; 4],
                ]
                .concat(),
            );
            rows
        },
        // Limit of two kinds of rows. In the first kind, a side of the rectangle that the box covers in the picture lies close to a border between
        // two pixels, and the margin of the test moves it to the next pixel. The margin of each side is about 2^-20 times the size of the picture,
        // which is up to 4096 pixels. In the second kind, the box is only slightly nearer or farther than the stored depth. In half of the random
        // rows, the relative difference of these depths is 2^-24 to 2^-1, with equally many rows in each octave. Some of these differences are below
        // the margin of the depth.
        other_side_at_most: 1500,
        mutants: &[
            // Mutants, in this order: one corner of the box is left out; some corners are used twice; the image is upside down; the first column and
            // row have no margin; the margin of the last column and row points inwards; the depth of the farthest corner is used; the level of the
            // depth pyramid is too fine; a box counts as hidden if it is hidden in one texel instead of all; boxes in front of the stored depth count
            // as hidden instead of boxes behind it; a box that reaches behind the near plane may count as hidden; the numbers of the box are not
            // checked; the depth is rounded to the wrong side; the sizes of levels are rounded down.
            ("culling", "corner < 8u", "corner < 7u"),
            ("culling", "vec3<u32>(1u, 2u, 4u)", "vec3<u32>(1u, 2u, 2u)"),
            ("culling", "vec2<f32>(x.x, -y.x) / w.x", "vec2<f32>(x.x, y.x) / w.x"),
            ("culling", "0.5 * (q - margin)", "0.5 * q"),
            ("culling", "0.5 * (q + margin)", "0.5 * (q - margin)"),
            ("culling", "nearest = min(nearest, sure)", "nearest = select(max(nearest, sure), sure, nearest > 1e38)"),
            ("culling", "select(vec2<u32>(0u), vec2<u32>(1u), (last", "select(vec2<u32>(0u), vec2<u32>(0u), (last"),
            ("culling", "all(vec4<f32>(depth) < farthest)", "any(vec4<f32>(depth) < farthest)"),
            ("culling", "all(vec4<f32>(depth) < farthest)", "all(vec4<f32>(depth) >= farthest)"),
            ("culling", "sure >= near && w.y", "w.y"),
            (
                "culling",
                "usable_within_3(low, CULLING_MOST) && usable_within_3(high, CULLING_MOST)\n        && usable_within_3(row_x",
                "usable_within_3(row_x",
            ),
            ("culling", "near / nearest * (1.0 + CULLING_FEW)", "near / nearest * (1.0 - CULLING_FEW)"),
            (
                "culling",
                "return ((max(size, vec2<u32>(1u)) - vec2<u32>(1u)) >> vec2<u32>(level)) + vec2<u32>(1u);",
                "return max(size >> vec2<u32>(level), vec2<u32>(1u));",
            ),
        ],
    },
    Case {
        probe: "bc1",
        extremes: || {
            let ends = [0x0000_0000_u32, 0xffff_0000, 0x0000_ffff, 0xffff_ffff, 0x8410_07e0, 0x07e0_8410, 0x0001_0000];
            let indices = [0_u32, 0x5555_5555, 0xaaaa_aaaa, 0xffff_ffff, 0xe4e4_e4e4];
            let row = |k: usize| vec![f64::from(ends[k % 7]), f64::from(indices[k / 7 % 5]), (k / 35) as f64];
            (0..7 * 5 * 16).map(row).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: red and blue are exchanged; alpha is always 1; texels are 5 % darker, which is more than the accepted error.
            ("", "bits.x, bits.y, bits.z, bits.w", "bits.z, bits.y, bits.x, bits.w"),
            ("", "bits.z, bits.w", "bits.z, bitcast<u32>(1.0)"),
            ("", "bitcast<vec4<u32>>(texel)", "bitcast<vec4<u32>>(texel * 0.95)"),
        ],
    },
    Case {
        probe: "bc3",
        extremes: || {
            let alphas = [0x0000_u32, 0x00ff, 0xff00, 0xffff, 0x8040, 0x4080, 0xfac6_8040, 0x5342_ff00];
            let row = |k: usize| {
                let upper = [0x8888_c6fa_u32, 0xffff_ffff, 0, 0x0539_7fac][k / 8 % 4];
                vec![f64::from(alphas[k % 8]), f64::from(upper), f64::from(0x07e0_f800_u32), f64::from(0xe4e4_e4e4_u32), (k / 32) as f64]
            };
            (0..8 * 4 * 16).map(row).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            ("", "bits.x, bits.y, bits.z, bits.w", "bits.z, bits.y, bits.x, bits.w"),
            ("", "bits.z, bits.w", "bits.z, bitcast<u32>(1.0)"),
            ("", "bitcast<vec4<u32>>(texel)", "bitcast<vec4<u32>>(texel * 0.95)"),
        ],
    },
    Case {
        probe: "tiling",
        extremes: || {
            let mut rows = Vec::new();
            for distance in [0.0, 30.0, 30.0 * (1.0 + EPS), 60.0, 1e9] {
                for sector in [0.0, -16_777_216.0, 16_777_216.0] {
                    for fixed in [0.0, 1.0, 65_535.0] {
                        rows.push(vec![distance, 30.0, 1.0, sector, fixed, fixed, 8.0]);
                        rows.push(vec![distance, 1e-3, 0.0, sector, fixed, fixed, 0.0]);
                    }
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("tiling", "log2(ratio)", "log(ratio)"),
            ("tiling", "f32(repeat >> s)", "f32((repeat >> s) | 1u)"),
            ("tiling", "(0xffffffffu >> (8u - s))", "0x00ffffffu"),
        ],
    },
    Case {
        probe: "reflection",
        extremes: || {
            let mut rows = Vec::new();
            for cosine in [0.0, 0.5, 1.0 - 0.5 * EPS, 1.0] {
                for rough in [0.0, 0.002, 1.0] {
                    rows.push(vec![cosine, rough, cosine, 1.0, 0.04, rough]);
                    rows.push(vec![cosine, rough, 1.0, cosine, 1.0, rough]);
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            ("brdf", "(1.0 - c) * (1.0 + c) + c * c * a * a", "1.0 - c * c * (1.0 - a * a)"),
            ("brdf", "let lambda_l = v * sqrt(l * l", "let lambda_l = v * sqrt(v * v"),
            ("brdf", "(m2 * m2 * m)", "(m2 * m2)"),
            ("brdf", "-9.28", "-9.27"),
        ],
    },
    Case {
        probe: "depth-position",
        extremes: || {
            let mut rows = Vec::new();
            for width in [1.0, 8192.0] {
                // Tangents of half the field of view, for fields of view of 1, 55 and 175 degrees.
                for half in [0.008_727, 0.5206, 22.9] {
                    for distance in [1e-3, 1.0, 1e6] {
                        rows.push(vec![0.0, 0.0, 1e-3 / distance, 1e-3, half, width]);
                        rows.push(vec![width - 1.0, 0.5 * width, 1e-3 / distance, 1e-3, half, width]);
                    }
                }
            }
            // A pixel at which nothing was drawn: depth 0.
            rows.push(vec![3.0, 4.0, 0.0, 0.1, 0.5, 64.0]);
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: the ray does not depend on the row of the pixel; rows and columns are exchanged; the distance is proportional
            // to the depth instead of its reciprocal; the distance is infinite where nothing was drawn; the centre of the first row is a quarter of a
            // pixel too high.
            ("view", "ray_00 + ray_dx * pixel.x + ray_dy * pixel.y", "ray_00 + ray_dx * pixel.x"),
            ("view", "ray_dx * pixel.x + ray_dy * pixel.y", "ray_dx * pixel.y + ray_dy * pixel.x"),
            ("view", "near_m / usable,", "near_m * usable,"),
            ("view", "usable > VIEW_MIN_DEPTH", "true"),
            ("", "1.0, first.y", "1.0, 0.5 * first.x"),
        ],
    },
    Case {
        probe: "weld",
        extremes: || {
            let deltas = [0.0, 1.0, 2.0, 7.0, 15.0];
            let edge = |i: u32| [[f64::from(i), 0.0], [f64::from(i), 128.0], [0.0, f64::from(i)], [128.0, f64::from(i)]];
            let places = (0..=128).flat_map(edge);
            places.flat_map(|[x, y]| deltas.map(|d| vec![x, y, d, d, d, d])).collect()
        },
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: a vertex halfway between two vertices of the neighbour moves to the one with the higher index instead of the
            // lower; vertices on the western border do not move; vertices on the southern border use the LOD difference (delta) of the western
            // neighbour.
            ("geometry/stitch.wgsl", "(step - 1u) / 2u", "step / 2u"),
            ("geometry/stitch.wgsl", "if index.x == first.x { kept.y = geometry_weld(index.y, deltas & 15u); }", ""),
            ("geometry/stitch.wgsl", "(deltas >> 4u) & 15u", "deltas & 15u"),
        ],
    },
    Case {
        probe: "moments",
        extremes: || {
            let mut rows = Vec::new();
            for [mean, spread] in [[0.0, 0.0], [1e6, 1e-3], [1e6, 0.0], [-1e6, 1.0], [1e-3, 1e3]] {
                for count in [1.0, 2.0, 3.0, 4096.0] {
                    rows.push(vec![mean, spread, count]);
                }
            }
            rows
        },
        other_side_at_most: 0,
        mutants: &[
            // Mutants, in this order: sums have no compensation of rounding errors; squares lack the factor (n - 1) / n; the variance is biased; the
            // lower part of a two-part sample is left out.
            ("moments", "(a.x - rest) + (b - part)", "0.0"),
            ("moments", "delta * (delta * ((n - 1.0) / n))", "delta * delta"),
            ("moments", "max(count - 1.0, 1.0)", "max(count, 1.0)"),
            ("moments", "moments_rounded(sample.y - state.y, zero)", "0.0"),
        ],
    },
    Case {
        probe: "reprojection",
        extremes: || {
            let mut rows = Vec::new();
            for y in [-5.0, 0.0, 1e-4, 1.0, 1e6, 1e9] {
                for normal in [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0; 3]] {
                    for [half, width] in [[0.008_727, 8192.0], [0.5, 1.0], [22.9, 640.0]] {
                        rows.push([&[0.1 * y, y, -0.05 * y, 0.0, 0.0, 0.0, half, width][..], &normal].concat());
                        rows.push([&[0.0, y, 0.0, 0.5, -0.25, 0.125, half, width][..], &normal].concat());
                    }
                }
            }
            rows
        },
        // Limit of three kinds of rows: the distance is the smallest or the largest that reprojection accepts; the plane contains the eye of the
        // earlier frame; or the earlier camera saw the point about halfway between two pixels. About one random row of the last kind is expected.
        other_side_at_most: 64,
        mutants: &[
            // Mutants, in this order: the vector between the two eyes has the wrong sign; the shift of the pixel coordinates is added instead of
            // subtracted; the distance is computed from the wrong row of the camera; the plane ignores the vector between the eyes; the x of the ray
            // has the wrong sign; the centre of the first row is a quarter of a pixel too high; the distance is expected at the exact position, or at
            // the pixel above and to the left, instead of the nearest pixel.
            ("motion", "let q = point + past.offset;", "let q = point - past.offset;"),
            ("motion", "/ distance - vec2<f32>(past.x_shift, past.y_shift)", "/ distance + vec2<f32>(past.x_shift, past.y_shift)"),
            ("motion", "dot(q, past.forward)", "dot(q, past.x_row)"),
            ("motion", "dot(normal, point + past.offset)", "dot(normal, point)"),
            ("motion", "past.forward + past.x_row * x", "past.forward - past.x_row * x"),
            ("", "-shift.y", "-0.5 * shift.x"),
            ("", "floor(seen.xy + vec2<f32>(0.5))", "seen.xy"),
            ("", "floor(seen.xy + vec2<f32>(0.5))", "floor(seen.xy)"),
        ],
    },
];

/// Whether a byte belongs to an identifier.
fn is_word(byte: Option<&u8>) -> bool {
    byte.is_some_and(|b| b.is_ascii_alphanumeric() || *b == b'_')
}

/// Replaces each occurrence of an identifier, except inside longer identifiers.
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

/// Returns the WGSL of a probe with one replacement. If `file` is empty, the replacement is made in `body`, the probe's own text; otherwise, it is
/// made in a copy of this file. The copy is placed before the probe's text, and its declarations are renamed, so that they do not collide with
/// the original ones.
fn mutant(body: &str, file: &str, from: &str, to: &str) -> String {
    if file.is_empty() {
        assert_eq!(body.matches(from).count(), 1, "`{from}` must occur exactly once");
        return body.replace(from, to);
    }
    let mut files = kernels::shared::WGSL.iter().copied().chain([&geometry::STITCH_WGSL]);
    let text = files.find(|wgsl| wgsl.path == file || wgsl.path == format!("shared/{file}.wgsl")).expect("a file of a probe").text;
    // Only the first occurrence is replaced, so that a mutant has one change.
    let count = text.matches(from).count();
    assert!(count >= 1, "{file}.wgsl: `{from}` does not occur");
    let mut all = format!("{}\n{body}", text.replacen(from, to, 1));
    for line in text.lines() {
        let declared = ["fn ", "const ", "struct "].iter().find_map(|keyword| line.strip_prefix(keyword));
        if let Some(name) = declared.and_then(|d| d.split(['(', ':', ' ']).next()) {
            all = rename(&all, name, &format!("{name}_mutant"));
        }
    }
    all
}

/// Returns the WGSL of a probe whose real results are rounded to f16 (11 significant bits), as a shader in half precision would return them.
fn in_half_precision(probe: &Probe) -> String {
    let (columns, results) = (probe.inputs.len(), probe.outputs.len());
    let (cell, texel, [given, from, to]) = match probe.layout() {
        Cells::Reals => ("f32", "", ["", "", ""]),
        Cells::Bits => ("u32", "", ["", "bitcast<f32>", "bitcast<u32>"]),
        Cells::Texel(_) => ("u32", ", texel: vec4<f32>", [", texel", "bitcast<f32>", "bitcast<u32>"]),
    };
    let mut text = rename(probe.wgsl, "probe", "probe_exact");
    text += &format!(
        "\nfn probe(row: array<{cell}, {columns}>{texel}) -> array<{cell}, {results}> {{\n    var rounded = probe_exact(row{given});\n"
    );
    for (i, _) in probe.outputs.iter().enumerate().filter(|(_, column)| !column.is_word()) {
        text += &format!("    rounded[{i}] = {to}(quantizeToF16({from}(rounded[{i}])));\n");
    }
    text + "    return rounded;\n}"
}

fn check(name: &str) {
    let table = u32::try_from(CASES.iter().position(|c| c.probe == name).expect("a case")).expect("few");
    let case = &CASES[table as usize];
    let probe = case.probe();
    let rows = case.rows(table);
    let run = |body: &str| probe.on_gpu_by(gpu(), body, &rows).unwrap_or_else(|e| panic!("{name}: {e}\n{body}"));

    let got = probe.on_gpu(gpu(), &rows).unwrap_or_else(|e| panic!("{e}"));
    let single = case.compare(&rows, &probe.on_f32(&rows)).unwrap_or_else(|e| panic!("the reference in f32: {e}"));
    let (share, other_side) = case.compare(&rows, &got).unwrap_or_else(|e| panic!("{e}"));
    println!("{name}: {share:.4} of the tolerance used, {other_side} rows beyond a threshold; f32 reference: {single:?}");

    // Negative controls: each of these results must be rejected.
    for &(file, from, to) in case.mutants {
        assert!(
            case.compare(&rows, &run(&mutant(probe.wgsl, file, from, to))).is_err(),
            "{name}: no row differs if `{to}` replaces `{from}`"
        );
    }
    // Block decoders are left out: their accepted error is at least two steps of 8 bits, which is larger than the error of half precision.
    if probe.outputs.iter().any(|c| c.whole.is_none()) && !matches!(probe.layout(), Cells::Texel(_)) {
        assert!(case.compare(&rows, &run(&in_half_precision(probe))).is_err(), "{name}: results in half precision were accepted");
    }
    let mut broken = got.clone();
    broken[0] = f64::NAN;
    assert!(case.compare(&rows, &broken).is_err(), "{name}: NaN was accepted");
}

/// A camera at `position` that looks along y, with a picture that is half as high as wide. `half_width` is the tangent of half the horizontal field
/// of view.
fn along_y(position: DVec3, half_width: f64, width: u32) -> View {
    let pose = Pose { position, yaw: 0.0, pitch: 0.0, fov: 2.0 * (half_width / 2.0).atan() };
    View::new(pose, [width, width / 2], [0.0; 2], 64.0, 0.0)
}

#[test]
fn pixels_of_probes_are_those_of_the_frame() {
    // The probes `depth-position` and `reprojection` compute their cameras themselves. The positions of their pixels must agree with those of the
    // renderer's camera, at two opposite corners of the picture, in its middle, and at a random point.
    let [depth_position, reprojection] = ["depth-position", "reprojection"].map(|name| Probe::find(name).unwrap_or_else(|e| panic!("{e}")));
    let mut draw = Draw { row: 0, column: 0, table: 77 };
    for width in [2_u32, 64, 640, 1920, 8192] {
        for half_width in [0.01, 0.5, 2.0] {
            let [w, h] = [f64::from(width), f64::from(width / 2)];
            let pitch = 2.0 * half_width / w;
            for [x, y] in [[0.0, 0.0], [w - 1.0, h - 1.0], [(w - 1.0) / 2.0, (h - 1.0) / 2.0], [draw.unit() * w, draw.unit() * h]] {
                let distance = draw.between(0.0, 10.0).exp2();
                let now = along_y(DVec3::ZERO, half_width, width);
                let point = now.ray(x, y) * distance;
                let got = depth_position.on_f64(&[x, y, 0.1 / distance, 0.1, half_width, w]);
                let off_px = point.distance(DVec3::new(got[0], got[1], got[2])) / (pitch * distance);
                assert!(off_px < 1e-3, "pixel {x}, {y} of {width}: {got:?} instead of {point}, off by {off_px} pixels");

                // The pixel at which an earlier camera saw the point.
                let offset = DVec3::from_array(draw.vector(-6.0, -1.0)) * distance;
                let past = along_y(-offset, half_width, width);
                let want = reproject(point.to_array(), &Past::between(&now, &past));
                let got = reprojection.on_f64(&[&point.to_array()[..], &offset.to_array(), &[half_width, w], &draw.direction()].concat());
                let off_px = (got[0] - want[0]).abs().max((got[1] - want[1]).abs());
                assert!(off_px < 1e-3, "pixel {x}, {y} of {width}: {got:?} instead of {want:?}, off by {off_px} pixels");
            }
        }
    }
}

/// Pairs of columns that are equal on purpose: the probe, and the names of two results. The two results are computed in different ways, and both are
/// compared with the truth.
const ALIKE: [(&str, &str, &str); 4] = [
    ("splat-blend", "run_00", "w_00"),
    ("splat-blend", "run_10", "w_10"),
    ("splat-blend", "run_01", "w_01"),
    ("splat-blend", "run_11", "w_11"),
];

/// Finds results that test nothing. Returns each result that equals an input or an earlier result in every row, with the name of that column. Also
/// returns the results that have the same value in all rows. A column is given by its name and its values in all rows.
fn tautologies(inputs: &[(&str, Vec<f64>)], outputs: &[(&str, Vec<f64>)]) -> Vec<(String, String)> {
    let equal = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-6 * a.abs().max(b.abs()) + 1e-12);
    let mut found = Vec::new();
    for (i, (name, values)) in outputs.iter().enumerate() {
        let others = inputs.iter().chain(&outputs[..i]);
        found.extend(others.filter(|(_, other)| equal(values, other)).map(|(other, _)| ((*name).to_owned(), (*other).to_owned())));
        if values.iter().all(|&value| value == values[0]) {
            found.push(((*name).to_owned(), "a constant".to_owned()));
        }
    }
    found
}

#[test]
fn no_result_of_a_probe_equals_another_column_by_construction() {
    // A result that always equals an input, or another result, does not test the function that computes it.
    const DRAWN: u32 = 2000;
    for probe in PROBES {
        let rows: Vec<f64> = (0..DRAWN).flat_map(|row| (probe.random)(&mut Draw { row, column: 0, table: 91 })).collect();
        let rows = probe.rounded(&rows);
        let column = |table: &[f64], width: usize, at: usize| table.iter().skip(at).step_by(width).copied().collect::<Vec<f64>>();
        let truth = probe.on_f64(&rows);
        let [inputs, outputs] = [(probe.inputs, &rows), (probe.outputs, &truth)].map(|(columns, table)| {
            columns.iter().enumerate().map(|(at, c)| (c.name, column(table, columns.len(), at))).collect::<Vec<_>>()
        });
        let mut found = tautologies(&inputs, &outputs);
        let before = found.len();
        found.retain(|(a, b)| !ALIKE.contains(&(probe.name, a.as_str(), b.as_str())));
        assert_eq!(
            before - found.len(),
            ALIKE.iter().filter(|(name, ..)| *name == probe.name).count(),
            "{}: a pair of ALIKE differs",
            probe.name
        );
        assert!(found.is_empty(), "{}: these results equal another column in each of {DRAWN} rows: {found:?}", probe.name);
        // Negative control: a copy of an input is found, and so is a constant.
        let copies = [("copy", inputs[0].1.clone()), ("fixed", vec![3.0; DRAWN as usize])];
        assert_eq!(tautologies(&inputs, &copies).len(), 2, "{}", probe.name);
    }
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
fn octahedral_codes_agree() {
    check("octahedral-codes");
}

#[test]
fn frustum_agrees() {
    check("frustum");
}

#[test]
fn normal_cone_agrees() {
    check("normal-cone");
}

#[test]
fn occlusion_agrees() {
    check("occlusion");
}

#[test]
fn blocks_agree() {
    check("bc1");
    check("bc3");
}

#[test]
fn normal_pair_agrees() {
    check("normal-pair");
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

#[test]
fn hashes_are_bit_equal() {
    check("hash");
}

#[test]
fn flavour_weights_agree() {
    check("flavour-weights");
}

#[test]
fn tiling_agrees() {
    check("tiling");
}

#[test]
fn reflection_agrees() {
    check("reflection");
}

#[test]
fn depth_position_agrees() {
    check("depth-position");
}

#[test]
fn weld_is_equal() {
    check("weld");
}

#[test]
fn moments_agree() {
    check("moments");
}

#[test]
fn reprojection_agrees() {
    check("reprojection");
}

// ---------------------------------------------------------------- classification

/// For each pixel of a picture: a mask of flavours (shading methods, one bit each), and whether the pixel shows terrain. The formats are those of the
/// geometry pass. Pixels of sky have random masks, too.
struct Scenery {
    size: [u32; 2],
    mask: Vec<u8>,
    terrain: Vec<bool>,
}

impl Scenery {
    /// Returns random terrain and masks. Each tile has a probability, 0, 3, 50 or 100 %, with which each of its pixels shows terrain. Each tile also
    /// has a random mask and one of three kinds. Depending on the kind, each pixel has the mask of the tile, one random flavour, or a random subset
    /// of the mask.
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
        let groups = [&frame];
        let mut rec = Recording::new(gpu, &groups);
        pass.encode(&mut rec, &targets, &lists);
        rec.submit().unwrap_or_else(|e| panic!("{e}"));
        lists.read(gpu).unwrap_or_else(|e| panic!("{e}"))
    }

    /// Compares the 32 lists of tiles with the expected masks of the tiles. List 0 has all tiles whose mask is not 0, and list m has the tiles with
    /// mask m. The order of the tiles in a list does not matter.
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
                return Err(format!("{:?}, list {list} differs: {} tiles, {} expected", self.size, got.len(), want.len()));
            }
        }
        if lists.len() == 32 { Ok(()) } else { Err(format!("{} lists", lists.len())) }
    }
}

/// Compares both paths of the pass with the reference: the path without subgroup operations, and the path with them, if the adapter has subgroup
/// operations.
#[test]
fn classification_agrees_on_both_paths() {
    let plain = open(GpuOptions { plain: true });
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

/// Runs the classification pass with the given source files instead of the stage's own. The bindings are those of `Classification`.
fn classify_by(gpu: &Gpu, pieces: Vec<Piece>, scenery: &Scenery) -> Vec<Vec<u32>> {
    let shader = gpu::Shader::new(gpu, "mutant", pieces).unwrap_or_else(|e| panic!("{e}"));
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

/// Negative controls: the comparison must reject passes that have one error each.
#[test]
fn wrong_classification_is_noticed() {
    let scenery = Scenery::random([150, 91], 0);
    let masks = tile_masks(scenery.size, &scenery.mask, &scenery.terrain, None);
    for subgroups in [false, true] {
        if subgroups && !gpu().features.contains(wgpu::Features::SUBGROUP) {
            println!("left out: this adapter has no subgroup operations");
            continue;
        }
        let run = |from: &str, to: &str| {
            let mut pieces = if subgroups { &classification::SUBGROUP_MODULE } else { &classification::PLAIN_MODULE }.pieces();
            let count: usize = pieces.iter().map(|piece| piece.text.matches(from).count()).sum();
            assert_eq!(count, 1, "`{from}` must occur exactly once");
            pieces.iter_mut().for_each(|piece| piece.text = piece.text.replace(from, to));
            scenery.compare(&classify_by(gpu(), pieces, &scenery), &masks)
        };
        run("fn classification_main", "fn classification_main").unwrap_or_else(|e| panic!("{e}"));
        // Mutants, in this order: a tile gets the largest mask of its pixels instead of the OR of their masks; sky counts as terrain; the wrong rows
        // of a tile are read; the list of all tiles has no entries.
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
            // If a subgroup is as large as the workgroup, its first lane is the workgroup's first thread, so the mutant of `if lane == 0u` changes
            // nothing.
            let whole = from.starts_with("if lane") && gpu().info.subgroup_max_size >= 64;
            assert!(whole || run(from, to).is_err(), "subgroups {subgroups}: no list differs if `{to}` replaces `{from}`");
        }
    }
}

/// Negative controls of `Scenery::compare`: it must reject lists that differ from those of the reference in one respect.
#[test]
fn classification_comparison_notices_differences() {
    let scenery = Scenery::random([150, 91], 0);
    let masks = tile_masks(scenery.size, &scenery.mask, &scenery.terrain, None);
    assert!(masks.contains(&0) && masks.iter().collect::<BTreeSet<_>>().len() > 16, "the tiles have too few different masks");
    let layout = gpu().layout("frame", wgpu::ShaderStages::COMPUTE, &[Binding::Uniform]);
    let pass = Classification::new(gpu(), &layout, classification::TILE).unwrap_or_else(|e| panic!("{e}"));
    let lists = scenery.classify(gpu(), &pass, &layout, None);
    scenery.compare(&lists, &masks).unwrap_or_else(|e| panic!("{e}"));
    let rejects = |what: &str, change: &dyn Fn(&mut Vec<Vec<u32>>)| {
        let mut changed = lists.clone();
        change(&mut changed);
        assert!(scenery.compare(&changed, &masks).is_err(), "the lists were accepted with this fault: {what}");
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
    rejects("a mask with one wrong bit", &|l| l[0][0] ^= 1 << 28);
    rejects("column and row exchanged", &|l| {
        for entry in &mut l[0] {
            *entry = (*entry & 0xff00_0000) | (*entry & 4095) << 12 | (*entry >> 12 & 4095);
        }
    });
    // Masks of wrong references must be rejected, too. In this order: pixels without terrain count; only the first pixel of a tile counts; the last
    // column of the picture is left out.
    let everywhere = vec![true; scenery.terrain.len()];
    assert!(scenery.compare(&lists, &tile_masks(scenery.size, &scenery.mask, &everywhere, None)).is_err());
    let only_first: Vec<bool> = scenery.terrain.iter().enumerate().map(|(i, &t)| t && i % 150 % 8 == 0 && i / 150 % 8 == 0).collect();
    assert!(scenery.compare(&lists, &tile_masks(scenery.size, &scenery.mask, &only_first, None)).is_err());
    let narrower: Vec<bool> = scenery.terrain.iter().enumerate().map(|(i, &t)| t && i % 150 != 149).collect();
    let others = tile_masks(scenery.size, &scenery.mask, &narrower, None);
    assert_ne!(others, masks, "the last column must matter");
    assert!(scenery.compare(&lists, &others).is_err());
}

/// Inputs that the rows of the probes do not reach: a weight that equals the threshold, borders that are NaN, and a tolerance of 1.
#[test]
fn edges_of_shared_functions() {
    // Each expression has the value that the comment of its function defines. `row[0]` is NaN.
    const PAST: &str =
        "MotionPast(vec3<f32>(0.0), 0.0, vec3<f32>(0.0, 0.0, 1.0), 0.0, vec3<f32>(1e12, 0.0, 0.0), 0.0, vec3<f32>(0.0, 1.0, 0.0), 0.0)";
    const EDGES: [(&str, f32); 17] = [
        // A flavour whose weight equals the threshold is not in the set, for each of the five. The far atlas then stands alone.
        ("f32(flavour_mask(array<f32, 5>(FLAVOUR_MIN_WEIGHT, 0.0, 0.0, 0.0, 1.0)))", 16.0),
        ("f32(flavour_mask(array<f32, 5>(0.0, FLAVOUR_MIN_WEIGHT, 0.0, 0.0, 1.0)))", 16.0),
        ("f32(flavour_mask(array<f32, 5>(0.0, 0.0, FLAVOUR_MIN_WEIGHT, 0.0, 1.0)))", 16.0),
        ("f32(flavour_mask(array<f32, 5>(0.0, 0.0, 0.0, FLAVOUR_MIN_WEIGHT, 1.0)))", 16.0),
        ("f32(flavour_mask(array<f32, 5>(1.0, 0.0, 0.0, 0.0, FLAVOUR_MIN_WEIGHT)))", 1.0),
        // An end of the band that is NaN counts as -1. From -1 to 0.5, the smooth step at 0 is t^2 (3 - 2 t) with t = 2/3, which is 20/27.
        ("flavour_steep(0.0, vec2<f32>(row[0], 0.5))", 7.0 / 27.0),
        ("flavour_steep(-0.5, vec2<f32>(-1.0, row[0]))", 0.0),
        // Without a surface, nothing is the same surface, even if the tolerance accepts every distance.
        ("f32(motion_same_surface(0.0, 1.0, 1.0))", 0.0),
        ("f32(motion_same_surface(1.0, 0.0, 1.0))", 0.0),
        ("f32(motion_same_surface(2.0, 1.0, 1.0))", 1.0),
        // A pixel beyond 1e9 is not in the picture, and neither is a point behind the camera.
        ("motion_reproject(vec3<f32>(1.0, 0.0, 1.0), PAST).x", -1e9),
        ("motion_reproject(vec3<f32>(1.0, 0.0, 1.0), PAST).y", -1e9),
        ("motion_reproject(vec3<f32>(0.0, 1.0, -1.0), PAST).x", -1e9),
        ("motion_reproject(vec3<f32>(0.0, 1.0, -1.0), PAST).y", -1e9),
        // A texel whose bilinear weight equals the least one does not count, even if it is by far the highest.
        ("splat_blend_weights(vec2<f32>(SPLAT_BLEND_MIN_WEIGHT, 0.0), vec4<f32>(0.0, 1.0, 0.0, 0.0), 1000.0).y", 0.0),
        // A number above 1 counts as 1.
        ("noise_correct(1.2, 0.5)", 1.0),
        ("noise_correct(0.0, 0.5)", 0.0),
    ];
    let values = EDGES.map(|(expression, _)| expression).join(", ").replace("PAST", PAST);
    let body = format!("fn probe(row: array<f32, 1>) -> array<f32, {0}> {{ return array<f32, {0}>({values}); }}", EDGES.len());
    let found = table::run(gpu(), &body, &[f32::NAN], 1, EDGES.len()).expect("the WGSL compiles");
    for ((expression, expected), found) in EDGES.iter().zip(found) {
        // Smooth steps have a rounding error below 1e-6; the other values are exact.
        assert!((found - expected).abs() < 1e-6, "{expression} is {found}, not {expected}");
    }
}

/// A gradient along the normal does not bend it. Gradients are limited to 1e6, so that rounding turns the normal by a few degrees at most. Without
/// the limit, longer gradients would leave only rounding errors.
#[test]
fn a_long_gradient_along_the_normal_does_not_bend_it() {
    let body = "fn probe(row: array<f32, 6>) -> array<f32, 3> {
        let bent = triplanar_perturb(vec3<f32>(row[0], row[1], row[2]), vec3<f32>(row[3], row[4], row[5]));
        return array<f32, 3>(bent.x, bent.y, bent.z);
    }";
    let row = |index: u32| {
        let random = |column: u32| f64::from(hash::pcg4d([index, column, 3, 61])[0]) / 4_294_967_296.0 * 2.0 - 1.0;
        let mut n = DVec3::new(random(0), random(1), random(2)) * 0.2;
        // Each component dominates with each sign.
        n[index as usize % 3] = if (index / 3).is_multiple_of(2) { 1.0 } else { -1.0 };
        let n = n.normalize();
        let gradient = n * if (index / 6).is_multiple_of(2) { 1e10 } else { -1e10 };
        [n.x, n.y, n.z, gradient.x, gradient.y, gradient.z].map(|x| x as f32)
    };
    let rows: Vec<[f32; 6]> = (0..1200).map(row).collect();
    let found = table::run(gpu(), body, rows.as_flattened(), 6, 3).expect("the WGSL compiles");
    // The result is n - (g - n dot(n, g)), with g limited to 1e6. Here, g is along n, so the last two terms cancel, and their rounding errors remain
    // beside n. Errors along n change only the length. Errors of the components across n are about 0.1, so the unit normal turns by a few degrees.
    // The limit of 12 degrees leaves a margin.
    for (row, found) in rows.iter().zip(found.chunks_exact(3)) {
        let [n, found] = [&row[..3], found].map(|v| DVec3::new(f64::from(v[0]), f64::from(v[1]), f64::from(v[2])));
        let angle = n.angle_between(found).to_degrees();
        assert!(angle < 12.0, "{row:?}: {found:?} is {angle} degrees off");
    }
}
